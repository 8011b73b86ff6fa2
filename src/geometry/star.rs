//! Circumspheres of all tets of a star at once, by vector instructions: 60 multiplications and
//! additions and one division each, for two or four tets side by side. The formula is that of
//! [`sphere`](super::sphere).
//!
//! The loop is written so that the compiler vectorises it: coordinate by coordinate, selects
//! instead of branches, no two arrays that might overlap. On x86-64 a second instance for AVX2 is
//! chosen when the program runs. Neither contracts a product and a sum to one rounding, so that the
//! spheres are the same bits on every machine.

use glam::DVec3;

use super::sphere::{Circumsphere, Origin, relative_to};
use crate::Result;
use crate::memory::reserve;

/// Tets of one block; few stars have more.
const BLOCK: usize = 64;
/// A multiple of the lanes of a vector of f64.
const STEP: usize = 8;

/// The circumspheres of many tets that share their last vertex, as the tets of a star do.
#[derive(Default)]
pub struct StarSpheres {
    blocks: Vec<Block>,
}

/// Aligned, so that no vector of a row lies in two cache lines: an allocator may put one worker's
/// block so and another's otherwise.
#[repr(align(64))]
struct Block {
    corners: Corners,
    spheres: Spheres,
}

type Corners = [[[f64; BLOCK]; 3]; 3];

/// Centre, inside and outside bounds: one array of one type, so that the compiler can tell that no
/// two rows overlap.
type Spheres = [[f64; BLOCK]; 5];

impl StarSpheres {
    /// Makes room for `count` tets. Each is to be [set](Self::set) before [`Self::compute`].
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    #[inline]
    pub fn reserve(&mut self, count: usize) -> Result<()> {
        let (blocks, made) = (count.div_ceil(BLOCK), self.blocks.len());
        if made < blocks {
            reserve(&mut self.blocks, blocks - made, "circumspheres of a star")?;
            self.blocks.resize_with(blocks, || Block {
                corners: [[[0.0; BLOCK]; 3]; 3],
                spheres: [[0.0; BLOCK]; 5],
            });
        }
        Ok(())
    }

    /// Sets the position of vertex `k` (0 to 2) of tet `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, k: usize, position: DVec3) {
        let corner = &mut self.blocks[i / BLOCK].corners[k];
        corner[0][i % BLOCK] = position.x;
        corner[1][i % BLOCK] = position.y;
        corner[2][i % BLOCK] = position.z;
    }

    /// Computes the spheres of the tets 0 to `count` - 1, each (a, b, c, `apex`) and positive.
    pub fn compute(&mut self, count: usize, apex: DVec3) {
        for (k, block) in self.blocks[..count.div_ceil(BLOCK)].iter_mut().enumerate() {
            let first = DVec3::from_array(block.corners[0].map(|row| row[0]));
            compute(
                &block.corners,
                &mut block.spheres,
                (count - k * BLOCK).min(BLOCK),
                &Origin::new(apex, first),
            );
        }
    }

    /// The sphere of tet `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Circumsphere {
        let rows = &self.blocks[i / BLOCK].spheres;
        Circumsphere::from_row([0, 1, 2, 3, 4].map(|row: usize| rows[row][i % BLOCK]))
    }
}

fn compute(corners: &Corners, spheres: &mut Spheres, count: usize, origin: &Origin) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2, the only thing that the function needs.
        return unsafe { compute_avx2(corners, spheres, count, origin) };
    }
    compute_portably(corners, spheres, count, origin);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn compute_avx2(corners: &Corners, spheres: &mut Spheres, count: usize, origin: &Origin) {
    // There are more values than registers, and the compiler aligns a frame for vectors only if
    // something in it that cannot be left out asks for that.
    let aligned = std::hint::black_box(LineAligned(*origin));
    compute_block(corners, spheres, count, &aligned.0);
}

/// At the begin of a cache line, so that no vector in it, or beside it in a frame, lies in two.
#[cfg(target_arch = "x86_64")]
#[repr(align(64))]
struct LineAligned<T>(T);

/// Not inlined: only the arguments of a function are known not to overlap.
#[inline(never)]
fn compute_portably(corners: &Corners, spheres: &mut Spheres, count: usize, origin: &Origin) {
    compute_block(corners, spheres, count, origin);
}

#[inline(always)]
fn compute_block(corners: &Corners, spheres: &mut Spheres, count: usize, origin: &Origin) {
    // What lies beyond the last tet is what lay there before, computed in vain.
    for i in 0..count.next_multiple_of(STEP).min(BLOCK) {
        let [a, b, c] = [0, 1, 2].map(|k: usize| {
            DVec3::new(corners[k][0][i], corners[k][1][i], corners[k][2][i]) - origin.at
        });
        // (a, b, c, origin) is positive, and so is (origin, b, a, c).
        let sphere = relative_to(origin, b, a, c);
        for row in 0..5 {
            spheres[row][i] = sphere[row];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::predicates::orient;
    use crate::geometry::vectors::weyl;

    /// Positive tets of a star around `apex`, more than one block of them, each tenth one flat.
    fn tets(apex: DVec3) -> Vec<[DVec3; 3]> {
        let point =
            |i| apex + DVec3::new(weyl(i) - 0.5, weyl(7 * i + 1) - 0.5, weyl(31 * i + 2) - 0.5);
        let mut tets: Vec<[DVec3; 3]> =
            (0..100).map(|i| [point(3 * i), point(3 * i + 1), point(3 * i + 2)]).collect();
        for tet in &mut tets {
            if orient(tet[0], tet[1], tet[2], apex) < 0.0 {
                tet.swap(0, 1);
            }
        }
        for tet in tets.iter_mut().step_by(10) {
            tet[2] = tet[0].lerp(tet[1], 0.5);
        }
        tets
    }

    #[test]
    fn a_star_has_the_spheres_of_its_tets() {
        let apex = DVec3::new(81.25, -33.1, 7.7);
        let tets = tets(apex);
        let mut star = StarSpheres::default();
        star.reserve(tets.len()).expect("memory");
        for (i, corners) in tets.iter().enumerate() {
            (0..3).for_each(|k| star.set(i, k, corners[k]));
        }
        star.compute(tets.len(), apex);
        for (i, &[a, b, c]) in tets.iter().enumerate() {
            let (one, other) = (star.get(i), Circumsphere::of_tet(apex, b, a, c));
            assert_eq!(one.is_certain(), i % 10 != 0);
            assert_eq!(one.center, other.center);
            // The two take their lengths for upper bounds from different vertices.
            assert_eq!(one.is_certain(), other.is_certain());
            assert!(
                !one.is_certain() || (one.outside - other.outside).abs() <= 1e-6 * other.outside
            );
        }
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn every_instance_of_the_loop_gives_the_same_bits() {
        if !std::arch::is_x86_feature_detected!("avx2") {
            println!("SKIPPED: this processor has no AVX2");
            return;
        }
        let apex = DVec3::new(0.3, 2000.1, -7.0);
        let mut corners: Corners = [[[0.0; BLOCK]; 3]; 3];
        for (i, tet) in tets(apex).iter().take(BLOCK).enumerate() {
            for (k, corner) in tet.iter().enumerate() {
                corner.to_array().iter().enumerate().for_each(|(axis, &x)| corners[k][axis][i] = x);
            }
        }
        let origin = Origin::new(apex, apex + DVec3::X);
        let (mut portable, mut vector): (Spheres, Spheres) = ([[0.0; BLOCK]; 5], [[0.0; BLOCK]; 5]);
        compute_portably(&corners, &mut portable, BLOCK, &origin);
        // SAFETY: the processor has AVX2, see above.
        unsafe { compute_avx2(&corners, &mut vector, BLOCK, &origin) };
        assert_eq!(
            portable.map(|row| row.map(f64::to_bits)),
            vector.map(|row| row.map(f64::to_bits))
        );
    }
}
