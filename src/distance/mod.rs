//! Exact anisotropic Euclidean feature transform: the nearest site of every voxel of a grid.
//!
//! Source: C. R. Maurer, R. Qi, V. Raghavan, "A linear time algorithm for computing exact Euclidean distance transforms of binary
//! images in arbitrary dimensions", IEEE PAMI 25(2), 2003 (section 3; the voxel spacing of section 4); the lower envelope of
//! parabolas is that of P. Felzenszwalb, D. Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 8, 2012.
//!
//! One pass per axis. After the pass along x each voxel knows the nearest site of its row, after y that of its plane, after z that of
//! the grid. In a pass, the candidates along a line are parabolas (squared distance so far at their vertex); those that appear
//! in the lower envelope are found by one scan with a stack and read off by a second scan: linear time.
//!
//! Ties go to the site that comes first in the order z, y, x. Lines are independent of each other, so the result does not depend on the number
//! of threads. Memory: 4 bytes per voxel kept, 8 while it is built.

mod bricks;

pub use bricks::Bricks;
use rayon::prelude::*;

use crate::memory::filled;
use crate::{Error, Result};

/// "No site in this row or plane", in the passes only.
const NONE: u32 = u32::MAX;

/// The nearest site of every voxel of a grid.
#[derive(Clone, Debug)]
pub struct FeatureTransform {
    bricks: Bricks,
    spacing: [f64; 3],
    /// x + nx * (y + ny * z) of the nearest site, in the bricked layout.
    sites: Vec<u32>,
    by_row: Divisor,
    by_column: Divisor,
}

impl FeatureTransform {
    /// Computes the transform. `mark(y, z, row)` sets `row[x]` of each site of a row (handed over all `false`) and is called once per
    /// row, from several threads. `check` is called before each line or layer of lines; its error ends the computation.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: no voxel, no site, or 2^32 - 1 voxels or more; [`Error::OutOfMemory`]; whatever `check` returns.
    pub fn compute(
        dims: [usize; 3],
        spacing: [f64; 3],
        mark: impl Fn(usize, usize, &mut [bool]) + Sync,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let [nx, ny, nz] = dims;
        let voxels = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)).filter(|&n| n < NONE as usize);
        let voxels = match voxels {
            None => {
                return Err(Error::InvalidArgument(format!(
                    "the object spans {nx} x {ny} x {nz} voxels; a feature transform holds at most {}",
                    NONE - 1
                )));
            }
            Some(0) => {
                return Err(Error::InvalidArgument(format!(
                    "the feature transform needs a voxel, got {nx} x {ny} x {nz}"
                )));
            }
            Some(n) => n,
        };
        let (by_row, by_column) = (Divisor::new(nx as u32), Divisor::new(ny as u32));

        // Passes along x and y, plane by plane: in_plane holds x + nx * y of the nearest site of the same plane.
        let mut in_plane = filled(voxels, NONE, "voxels of the feature transform", check)?;
        in_plane.par_chunks_mut(nx * ny).enumerate().try_for_each_init(
            || (vec![false; nx], Envelope::default()),
            |(row, envelope), (z, plane)| {
                for (y, nearest) in plane.chunks_mut(nx).enumerate() {
                    check()?;
                    row.fill(false);
                    mark(y, z, row);
                    nearest_in_row(row, nearest);
                }
                for x in 0..nx {
                    check()?;
                    envelope.clear();
                    for y in 0..ny {
                        let site_x = plane[x + nx * y];
                        if site_x != NONE {
                            let height = squared((x as f64 - f64::from(site_x)) * spacing[0]);
                            envelope.push(y as f64 * spacing[1], height, site_x + (nx * y) as u32);
                        }
                    }
                    envelope.sweep(ny, spacing[1], |y, site| plane[x + nx * y] = site);
                }
                Ok(())
            },
        )?;
        if in_plane.iter().step_by(nx * ny).all(|&site| site == NONE) {
            return Err(Error::InvalidArgument("the feature transform needs at least one site".into()));
        }

        // The pass along z, by layers of bricks: each is contiguous in the result.
        let bricks = Bricks::new(dims);
        let mut sites = filled(bricks.len(), 0, "voxels of the feature transform", check)?;
        sites.par_chunks_mut(bricks.layer()).enumerate().try_for_each_init(
            Envelope::default,
            |envelope, (layer, out)| {
                let first = layer * Bricks::EDGE;
                for y in first..(first + Bricks::EDGE).min(ny) {
                    check()?;
                    for x in 0..nx {
                        envelope.clear();
                        for z in 0..nz {
                            let site = in_plane[x + nx * (y + ny * z)];
                            if site != NONE {
                                let (site_y, site_x) = by_row.divide(site);
                                let height = squared((x as f64 - f64::from(site_x)) * spacing[0])
                                    + squared((y as f64 - f64::from(site_y)) * spacing[1]);
                                envelope.push(z as f64 * spacing[2], height, site + (nx * ny * z) as u32);
                            }
                        }
                        let at = bricks.x(x) + bricks.y(y) - layer * bricks.layer();
                        envelope.sweep(nz, spacing[2], |z, site| out[at + bricks.z(z)] = site);
                    }
                }
                Ok(())
            },
        )?;
        Ok(Self { bricks, spacing, sites, by_row, by_column })
    }

    /// The layout that [`FeatureTransform::site_at`] addresses.
    pub fn bricks(&self) -> &Bricks {
        &self.bricks
    }

    /// The site nearest to voxel (i, j, k).
    ///
    /// # Panics
    /// May panic when the voxel is outside the grid.
    #[inline]
    pub fn site(&self, i: usize, j: usize, k: usize) -> [u32; 3] {
        self.site_at(self.bricks.index(i, j, k))
    }

    /// As [`FeatureTransform::site`], for the voxel at an address of the layout.
    #[inline(always)]
    pub fn site_at(&self, address: usize) -> [u32; 3] {
        let (row, x) = self.by_row.divide(self.sites[address]);
        let (z, y) = self.by_column.divide(row);
        [x, y, z]
    }

    /// Distance from the centre of voxel (i, j, k) to that of its nearest site, in the units of the spacing.
    ///
    /// # Panics
    /// May panic when the voxel is outside the grid.
    #[inline]
    pub fn distance(&self, i: usize, j: usize, k: usize) -> f64 {
        let site = self.site(i, j, k);
        let d = |axis: usize, at: usize| squared((at as f64 - f64::from(site[axis])) * self.spacing[axis]);
        (d(0, i) + d(1, j) + d(2, k)).sqrt()
    }
}

fn squared(x: f64) -> f64 {
    x * x
}

/// For each voxel of a row the position of its nearest site in the row, the left one on a tie.
fn nearest_in_row(row: &[bool], nearest: &mut [u32]) {
    let mut left = NONE;
    for (x, (&is_site, out)) in row.iter().zip(nearest.iter_mut()).enumerate() {
        if is_site {
            left = x as u32;
        }
        *out = left;
    }
    let mut right = NONE;
    for (x, (&is_site, out)) in row.iter().zip(nearest.iter_mut()).enumerate().rev() {
        if is_site {
            right = x as u32;
        }
        if right != NONE && (*out == NONE || right - (x as u32) < x as u32 - *out) {
            *out = right;
        }
    }
}

/// The lower envelope of parabolas height + (q - position)^2 along a line.
#[derive(Default)]
struct Envelope {
    stack: Vec<Parabola>,
}

#[derive(Clone, Copy)]
struct Parabola {
    position: f64,
    height: f64,
    site: u32,
}

impl Envelope {
    fn clear(&mut self) {
        self.stack.clear();
    }

    /// Adds a parabola; positions must increase. Drops those before it that it hides from the envelope.
    #[inline]
    fn push(&mut self, position: f64, height: f64, site: u32) {
        while let [.., u, v] = self.stack[..] {
            // v lies on or above the envelope of u and the new one (Maurer et al., RemoveFT).
            let (a, b) = (v.position - u.position, position - v.position);
            let c = a + b;
            if c * v.height - b * u.height - a * height - a * b * c < 0.0 {
                break;
            }
            self.stack.pop();
        }
        self.stack.push(Parabola { position, height, site });
    }

    /// Calls `assign` with each of the `count` positions of the line and the site of the lowest parabola there; the first on a tie.
    /// Without any parabola nothing is assigned.
    #[inline]
    fn sweep(&self, count: usize, spacing: f64, mut assign: impl FnMut(usize, u32)) {
        let Some((&first, rest)) = self.stack.split_first() else { return };
        let mut rest = rest.iter();
        let (mut current, mut next) = (first, rest.next());
        for q in 0..count {
            let at = q as f64 * spacing;
            let value = |p: &Parabola| p.height + squared(at - p.position);
            let mut lowest = value(&current);
            while let Some(&candidate) = next {
                let v = value(&candidate);
                if v >= lowest {
                    break;
                }
                (current, lowest, next) = (candidate, v, rest.next());
            }
            assign(q, current.site);
        }
    }
}

/// Exact division of u32 by a constant by one multiplication (D. Lemire, O. Kaser, N. Kurz, "Faster remainder by direct computation",
/// Software: Practice and Experience 49(6), 2019): a lookup needs two of them, and a hardware division each would dominate it.
#[derive(Clone, Copy, Debug)]
struct Divisor {
    divisor: u32,
    /// ceil(2^64 / divisor); 0 stands for 2^64, divisor 1.
    inverse: u64,
}

impl Divisor {
    fn new(divisor: u32) -> Self {
        Self { divisor, inverse: (u64::MAX / u64::from(divisor)).wrapping_add(1) }
    }

    /// Quotient and remainder.
    #[inline(always)]
    fn divide(self, n: u32) -> (u32, u32) {
        let quotient = if self.inverse == 0 { n } else { ((u128::from(self.inverse) * u128::from(n)) >> 64) as u32 };
        (quotient, n - quotient * self.divisor)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn transform(dims: [usize; 3], spacing: [f64; 3], sites: &[bool]) -> Result<FeatureTransform> {
        let [nx, ny, _] = dims;
        FeatureTransform::compute(
            dims,
            spacing,
            |y, z, row| row.copy_from_slice(&sites[nx * (y + ny * z)..][..nx]),
            &|| Ok(()),
        )
    }

    /// Nearest site by looking at all of them; the first in the order z, y, x on a tie.
    fn brute_force(dims: [usize; 3], spacing: [f64; 3], sites: &[bool], v: [usize; 3]) -> ([u32; 3], f64) {
        let [nx, ny, _] = dims;
        let mut best = ([0; 3], f64::INFINITY);
        for at in (0..sites.len()).filter(|&at| sites[at]) {
            let s = [at % nx, at / nx % ny, at / nx / ny];
            let d2 = (0..3).map(|a| squared((v[a] as f64 - s[a] as f64) * spacing[a])).sum();
            if d2 < best.1 {
                best = (s.map(|c| c as u32), d2);
            }
        }
        (best.0, best.1.sqrt())
    }

    fn assert_exact(dims: [usize; 3], spacing: [f64; 3], sites: &[bool], ties: bool) {
        let ft = transform(dims, spacing, sites).unwrap();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let (site, distance) = brute_force(dims, spacing, sites, [i, j, k]);
                    let got = ft.distance(i, j, k);
                    assert!(
                        (got - distance).abs() <= 1e-12 * distance,
                        "{dims:?} {spacing:?} at {i} {j} {k}: {got} not {distance}"
                    );
                    if ties {
                        assert_eq!(ft.site(i, j, k), site, "{dims:?} {spacing:?} at {i} {j} {k}");
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn equals_brute_force(
            dims in prop_oneof![prop::array::uniform3(1_usize..9), Just([1, 17, 9]), Just([23, 1, 5]), Just([7, 19, 1]), Just([1, 1, 31])],
            spacing in prop::array::uniform3(0.1_f64..3.0),
            dyadic in prop::array::uniform3(1_u32..5),
            density in 0.01_f64..0.6,
            seed: u64,
        ) {
            let mut state = seed;
            let mut sites: Vec<bool> = (0..dims.iter().product())
                .map(|_| {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 11) as f64 / (1_u64 << 53) as f64 > 1.0 - density
                })
                .collect();
            let len = sites.len();
            sites[seed as usize % len] = true;
            assert_exact(dims, spacing, &sites, false);
            // Squared distances are exact here, so the rule for ties is seen.
            assert_exact(dims, dyadic.map(|d| f64::from(d) * 0.5), &sites, true);
        }

        #[test]
        fn divides_exactly(n: u32, d in 1_u32..) {
            prop_assert_eq!(Divisor::new(d).divide(n), (n / d, n % d));
            prop_assert_eq!(Divisor::new(d).divide(u32::MAX), (u32::MAX / d, u32::MAX % d));
        }
    }

    #[test]
    fn checkerboard_and_single_voxel() {
        let dims = [6, 5, 7];
        let board: Vec<bool> = (0..210).map(|at| (at % 6 + at / 6 % 5 + at / 30) % 2 == 0).collect();
        assert_exact(dims, [1.0, 2.0, 0.5], &board, true);
        assert_exact([1, 1, 1], [1.0; 3], &[true], true);
        let mut one = vec![false; 210];
        one[77] = true;
        assert_exact(dims, [0.3, 1.1, 2.0], &one, true);
    }

    #[test]
    fn any_number_of_threads_gives_the_same() {
        let dims = [31, 22, 27];
        let sites: Vec<bool> = (0..31 * 22 * 27).map(|at: usize| at.wrapping_mul(2654435761) % 97 == 3).collect();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| transform(dims, [1.0, 1.0, 2.0], &sites).unwrap().sites)
        };
        assert_eq!(on(1), on(4));
    }

    #[test]
    fn refuses_what_it_cannot_do() {
        assert!(matches!(transform([2, 2, 1], [1.0; 3], &[false; 4]), Err(Error::InvalidArgument(_))));
        assert!(matches!(transform([0, 2, 1], [1.0; 3], &[]), Err(Error::InvalidArgument(_))));
        let huge = FeatureTransform::compute([1 << 20, 1 << 20, 1 << 30], [1.0; 3], |_, _, _| (), &|| Ok(()));
        assert!(matches!(huge, Err(Error::InvalidArgument(_))));
        let cancelled =
            FeatureTransform::compute([4, 4, 4], [1.0; 3], |_, _, row| row.fill(true), &|| Err(Error::Cancelled));
        assert!(matches!(cancelled, Err(Error::Cancelled)));
    }
}
