//! The measures of many tets at once, by vector instructions, for two or four tets side by side.
//! The formulas are those of [`measures`](super::measures) and [`sphere`](super::sphere).
//!
//! As in [`star`](super::star), the loops are written so that the compiler vectorises them
//! ([`vectors`](super::vectors)).

use glam::DVec3;

use super::measures::{Cotangent, TetMeasures, TetShape, tet_centroid, tet_volume};
use super::sphere::{Circumsphere, Origin, relative_to};
use super::vectors::vectorized;

/// Tets of one block: what is known of them stays in the nearest cache.
pub(crate) const BLOCK: usize = 64;

/// A value of each tet.
pub(crate) type Row = [f64; BLOCK];

/// Some tets, at most [`BLOCK`].
#[repr(align(64))]
pub(crate) struct TetBlock {
    /// Of each vertex and axis.
    corners: [[Row; 3]; 4],
    len: usize,
}

/// The shapes of the tets of a block. What lies beyond its last tet means nothing.
#[repr(align(64))]
pub(crate) struct Shapes {
    /// Of the six dihedral angles.
    pub cotangents: [Row; 6],
    /// See [`TetMeasures`].
    pub scaled_jacobian: Row,
    /// See [`TetMeasures`].
    pub edge_ratio: Row,
    /// See [`TetMeasures`].
    pub radius_ratio: Row,
    /// Infinite for a flat tet.
    pub circumradius: Row,
    pub shortest_edge: Row,
    /// Circumradius over shortest edge; infinite for a flat tet.
    pub radius_edge: Row,
    pub volume: Row,
}

/// Volumes and centroids of the tets of a block. What lies beyond its last tet means nothing.
#[repr(align(64))]
pub(crate) struct Places {
    pub volume: Row,
    /// By axis.
    pub centroid: [Row; 3],
}

/// The circumspheres of the tets of a block, if they are positive.
#[repr(align(64))]
pub(crate) struct Spheres {
    /// Centre, inside and outside bounds.
    rows: [Row; 5],
}

impl Spheres {
    /// That of tet `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Circumsphere {
        Circumsphere::from_row([0, 1, 2, 3, 4].map(|row: usize| self.rows[row][i]))
    }
}

impl Default for TetBlock {
    fn default() -> Self {
        Self { corners: [[[0.0; BLOCK]; 3]; 4], len: 0 }
    }
}

impl Default for Shapes {
    fn default() -> Self {
        const ZERO: Row = [0.0; BLOCK];
        Self {
            cotangents: [ZERO; 6],
            scaled_jacobian: ZERO,
            edge_ratio: ZERO,
            radius_ratio: ZERO,
            circumradius: ZERO,
            shortest_edge: ZERO,
            radius_edge: ZERO,
            volume: ZERO,
        }
    }
}

impl Default for Spheres {
    fn default() -> Self {
        Self { rows: [[0.0; BLOCK]; 5] }
    }
}

impl Default for Places {
    fn default() -> Self {
        Self { volume: [0.0; BLOCK], centroid: [[0.0; BLOCK]; 3] }
    }
}

impl TetBlock {
    /// How many tets there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no room for another one.
    pub fn is_full(&self) -> bool {
        self.len == BLOCK
    }

    /// Leaves no tet.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a tet, where there is room.
    #[inline(always)]
    pub fn push(&mut self, corners: [[f64; 3]; 4]) {
        for (rows, corner) in self.corners.iter_mut().zip(corners) {
            (0..3).for_each(|axis| rows[axis][self.len] = corner[axis]);
        }
        self.len += 1;
    }

    /// Moves the first vertex of all tets to `p`.
    pub fn set_first(&mut self, p: DVec3) {
        for (row, x) in self.corners[0].iter_mut().zip(p.to_array()) {
            row[..self.len].fill(x);
        }
    }

    /// The vertices of tet `i`.
    #[inline(always)]
    pub fn corners(&self, i: usize) -> [DVec3; 4] {
        corners_of(&self.corners, i)
    }

    /// Measures the shapes, and adds to `counts` how many of the cotangents are no more than each
    /// of `ends`.
    pub fn shapes<const N: usize>(
        &self,
        ends: &[Cotangent; N],
        shapes: &mut Shapes,
        counts: &mut [u64; N],
    ) {
        shapes_of(self, ends, shapes, counts);
    }

    /// Finds volumes and centroids, the latter as `moved` has them.
    pub fn places(&self, moved: impl Fn(DVec3) -> DVec3, places: &mut Places) {
        places_of(self, &moved, places);
    }

    /// Computes the circumspheres.
    pub fn spheres(&self, spheres: &mut Spheres) {
        spheres_of(self, spheres);
    }
}

#[inline(always)]
fn corners_of(corners: &[[Row; 3]; 4], i: usize) -> [DVec3; 4] {
    [0, 1, 2, 3].map(|k: usize| DVec3::new(corners[k][0][i], corners[k][1][i], corners[k][2][i]))
}

vectorized! {
    fn shapes_of[const N: usize](
        block: &TetBlock,
        ends: &[Cotangent; N],
        shapes: &mut Shapes,
        counts: &mut [u64; N]
    ) = measure_shapes;
    shapes_avx2, shapes_portably
}

#[inline(always)]
fn measure_shapes<const N: usize>(
    block: &TetBlock,
    ends: &[Cotangent; N],
    shapes: &mut Shapes,
    counts: &mut [u64; N],
) {
    // All of them, as the length of a loop that is known is the best; what lies beyond the last tet
    // is what lay there before, measured in vain.
    for i in 0..BLOCK {
        let shape = TetShape::new(&corners_of(&block.corners, i));
        let dihedrals = shape.dihedrals();
        for e in 0..6 {
            shapes.cotangents[e][i] = Cotangent::new(dihedrals[e]).0;
        }
        let TetMeasures { scaled_jacobian, edge_ratio, radius_ratio } = shape.measures();
        shapes.scaled_jacobian[i] = scaled_jacobian;
        shapes.edge_ratio[i] = edge_ratio;
        shapes.radius_ratio[i] = radius_ratio;
        shapes.circumradius[i] = shape.circumradius();
        shapes.shortest_edge[i] = shape.shortest_edge();
        shapes.radius_edge[i] = shape.radius_edge();
        shapes.volume[i] = shape.six_volumes / 6.0;
    }
    for row in &mut shapes.cotangents {
        row[block.len..].fill(Cotangent::OF_ZERO.0);
        for (count, end) in counts.iter_mut().zip(ends) {
            *count += row.iter().map(|&cotangent| u64::from(cotangent <= end.0)).sum::<u64>();
        }
    }
}

vectorized! {
    fn places_of[M: Fn(DVec3) -> DVec3](
        block: &TetBlock,
        moved: &M,
        places: &mut Places
    ) = find_places;
    places_avx2, places_portably
}

#[inline(always)]
fn find_places(block: &TetBlock, moved: &impl Fn(DVec3) -> DVec3, places: &mut Places) {
    for i in 0..BLOCK {
        let corners = corners_of(&block.corners, i);
        places.volume[i] = tet_volume(&corners);
        let centroid = moved(tet_centroid(&corners));
        (0..3).for_each(|axis| places.centroid[axis][i] = centroid[axis]);
    }
}

vectorized! {
    fn spheres_of[](block: &TetBlock, spheres: &mut Spheres) = compute_spheres;
    spheres_avx2, spheres_portably
}

#[inline(always)]
fn compute_spheres(block: &TetBlock, spheres: &mut Spheres) {
    for i in 0..BLOCK {
        let [a, b, c, d] = corners_of(&block.corners, i);
        let sphere = relative_to(&Origin::new(a, b), b - a, c - a, d - a);
        for row in 0..5 {
            spheres.rows[row][i] = sphere[row];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::measures::{tet_circumradius, tet_measures};
    use crate::geometry::vectors::weyl;

    /// Tets of all shapes, the first ones flat, or with two equal vertices.
    fn block(len: usize) -> TetBlock {
        let point = |i| [weyl(i) + 7.0, weyl(7 * i + 1) - 2000.0, weyl(31 * i + 2)];
        let mut block = TetBlock::default();
        for i in 0..len {
            let mut corners = [0, 1, 2, 3].map(|k| point(4 * i + k));
            match i {
                0 => corners[3] = [0, 1, 2].map(|axis| corners[0][axis].midpoint(corners[1][axis])),
                1 => corners[3] = corners[0],
                2 => corners = [corners[0]; 4],
                _ => {}
            }
            block.push(corners);
        }
        block
    }

    const ENDS: [Cotangent; 3] = [Cotangent(4.0), Cotangent(0.0), Cotangent(-1.0)];

    #[test]
    fn a_block_has_the_measures_of_its_tets() {
        for len in [BLOCK, 11, 0] {
            let block = block(len);
            assert_eq!((block.len(), block.is_full()), (len, len == BLOCK));
            let (mut shapes, mut counts) = (Shapes::default(), [0; 3]);
            let (mut places, mut spheres) = (Places::default(), Spheres::default());
            // What another block left there.
            shapes.cotangents = [[-9.0; BLOCK]; 6];
            block.shapes(&ENDS, &mut shapes, &mut counts);
            block.places(|p| p * 2.0, &mut places);
            block.spheres(&mut spheres);
            let mut expected = [0; 3];
            for i in 0..len {
                let corners @ [a, b, c, d] = block.corners(i);
                let TetMeasures { scaled_jacobian, edge_ratio, radius_ratio } =
                    tet_measures(&corners);
                assert_eq!(
                    [shapes.scaled_jacobian[i], shapes.edge_ratio[i], shapes.radius_ratio[i]],
                    [scaled_jacobian, edge_ratio, radius_ratio]
                );
                assert_eq!(shapes.circumradius[i], tet_circumradius(&corners));
                assert_eq!([shapes.volume[i], places.volume[i]], [tet_volume(&corners); 2]);
                let [x, y, z] = places.centroid.map(|row| row[i]);
                assert_eq!(DVec3::new(x, y, z), tet_centroid(&corners) * 2.0);
                assert_eq!(spheres.get(i), Circumsphere::of_tet(a, b, c, d));
                let dihedrals = TetShape::new(&corners).dihedrals();
                for (row, dihedral) in shapes.cotangents.iter().zip(dihedrals) {
                    assert_eq!(row[i], Cotangent::new(dihedral).0);
                    for (expected, end) in expected.iter_mut().zip(ENDS) {
                        *expected += u64::from(row[i] <= end.0);
                    }
                }
            }
            assert_eq!(counts, expected);
        }
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn every_instance_of_the_loops_gives_the_same_bits() {
        if !std::arch::is_x86_feature_detected!("avx2") {
            println!("SKIPPED: this processor has no AVX2");
            return;
        }
        let block = block(BLOCK);
        let bits = |row: &Row| row.map(f64::to_bits);
        let (mut portable, mut vector) = (Shapes::default(), Shapes::default());
        let mut counts = [[0; 3]; 2];
        shapes_portably(&block, &ENDS, &mut portable, &mut counts[0]);
        // SAFETY: the processor has AVX2, see above.
        unsafe { shapes_avx2(&block, &ENDS, &mut vector, &mut counts[1]) };
        assert_eq!(counts[0], counts[1]);
        let rows = |shapes: &Shapes| {
            let [a, b, c, d, e, f] = shapes.cotangents;
            [a, b, c, d, e, f, shapes.scaled_jacobian, shapes.edge_ratio, shapes.radius_ratio]
        };
        assert_eq!(rows(&portable).each_ref().map(bits), rows(&vector).each_ref().map(bits));
        let more = |shapes: &Shapes| {
            [shapes.circumradius, shapes.shortest_edge, shapes.radius_edge, shapes.volume]
        };
        assert_eq!(more(&portable).each_ref().map(bits), more(&vector).each_ref().map(bits));

        let (mut portable, mut vector) = (Places::default(), Places::default());
        let moved = |p: DVec3| p / 3.0;
        places_portably(&block, &moved, &mut portable);
        // SAFETY: as above.
        unsafe { places_avx2(&block, &moved, &mut vector) };
        assert_eq!(bits(&portable.volume), bits(&vector.volume));
        assert_eq!(portable.centroid.each_ref().map(bits), vector.centroid.each_ref().map(bits));

        let (mut portable, mut vector) = (Spheres::default(), Spheres::default());
        spheres_portably(&block, &mut portable);
        // SAFETY: as above.
        unsafe { spheres_avx2(&block, &mut vector) };
        assert_eq!(portable.rows.each_ref().map(bits), vector.rows.each_ref().map(bits));
    }
}
