//! The shape of the tets and interface facets of a finished mesh, summed up.
//!
//! The radius-edge ratio is the measure that Delaunay refinement bounds (Shewchuk, "Tetrahedral
//! mesh generation by Delaunay refinement", 1998); it says nothing about slivers, which is why
//! dihedral angles are reported beside it.
//!
//! Where only the order of angles matters they are told by the squared cotangent with its sign,
//! which takes no root and loses no digits near 0 and 180 degrees, where slivers are. Only tets
//! with a label other than 0 count; background that was kept is not part of the object. But tets
//! that are not positive are counted among all.
//!
//! Pure functions of the mesh, safe from any thread. Linear in the number of tets and parallel in
//! the current rayon pool; the partial results are combined in the order of the tets, so that equal
//! meshes give equal bits whatever the number of threads.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::geometry::measures::{Cotangent, corner_angles};
use crate::geometry::predicates::orient;
use crate::geometry::tet_block::{Shapes, TetBlock};
use crate::mesh::TetMesh;
use crate::monitor::{Monitor, Step};

/// Tets or facets per parallel work item; fixed, so that sums do not depend on the number of
/// threads.
const CHUNK: usize = 4096;

/// The ends of the bins of dihedral angles: 10 to 170 degrees.
fn bin_ends() -> [Cotangent; 17] {
    std::array::from_fn(|bin| match bin + 1 {
        // Right angles are common: theirs is exact.
        9 => Cotangent(0.0),
        end => {
            let (sine, cosine) = (10.0 * end as f64).to_radians().sin_cos();
            Cotangent::new((cosine, sine * sine))
        }
    })
}

/// Shape of the tets with a label other than 0 and of the interface facets. Lengths are in world
/// units, angles in degrees. Where there is nothing to measure, every figure is 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quality {
    /// Tets measured: those with a label other than 0.
    pub tets: u64,
    /// Interface facets measured: all of them.
    pub facets: u64,
    /// Smallest dihedral angle.
    pub min_dihedral: f64,
    /// Largest dihedral angle.
    pub max_dihedral: f64,
    /// Six dihedral angles per tet, in bins of 10 degrees; an angle of exactly 180 is in the last
    /// bin.
    pub dihedral_histogram: [u64; 18],
    /// Scaled Jacobians, in bins of 1/20 from 0 on; for these measures see
    /// [`TetMeasures`](crate::geometry::measures::TetMeasures).
    pub scaled_jacobian: Spread,
    /// Edge ratios, in bins of 1/4 from 1 on.
    pub edge_ratio: Spread,
    /// Radius ratios, in bins of 1/4 from 1 on.
    pub radius_ratio: Spread,
    /// Largest circumradius over shortest edge.
    pub max_radius_edge: f64,
    /// Mean of circumradius over shortest edge.
    pub mean_radius_edge: f64,
    /// Largest circumradius.
    pub max_circumradius: f64,
    /// Shortest edge of any tet.
    pub min_edge: f64,
    /// Smallest volume of a tet; negative if a tet is inverted.
    pub min_volume: f64,
    /// Largest volume of a tet.
    pub max_volume: f64,
    /// Volume of all tets together.
    pub total_volume: f64,
    /// Smallest planar angle of an interface facet.
    pub min_facet_angle: f64,
    /// Largest planar angle of an interface facet.
    pub max_facet_angle: f64,
}

/// Bins of a [`Spread`].
pub const BINS: usize = 20;
/// The first bin of each spread, and how many bins there are to 1.
const OF_JACOBIANS: (f64, f64) = (0.0, 20.0);
const OF_RATIOS: (f64, f64) = (1.0, 4.0);

/// How the values of a measure are spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The least.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// How many tets have values in each bin; what lies beyond the first or the last is in that.
    pub histogram: [u64; BINS],
}

impl Default for Spread {
    /// That of nothing.
    fn default() -> Self {
        Self { min: 0.0, max: 0.0, histogram: [0; BINS] }
    }
}

impl Spread {
    const NEUTRAL: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY, histogram: [0; BINS] };

    fn add(&mut self, values: &[f64], (first, per_one): (f64, f64)) {
        let [min, max] = range(values);
        self.min = self.min.min(min);
        self.max = self.max.max(max);
        for value in values {
            // The cast cuts off what lies outside, infinity too.
            let bin = ((value - first) * per_one) as usize;
            self.histogram[bin.min(BINS - 1)] += 1;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.histogram.iter_mut().zip(other.histogram).for_each(|(bin, more)| *bin += more);
    }
}

impl Quality {
    /// Measures `mesh`; and tells how many of all its tets, of any label, are not positive by the
    /// exact predicate.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub fn measure(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<(Self, u64)> {
        monitor.enter(Step::Quality, mesh.tets.len() + mesh.facets.len())?;
        let bin_ends = bin_ends();
        let tet_parts: Vec<TetSummary> = mesh
            .tets
            .par_chunks(CHUNK)
            .zip(mesh.labels.par_chunks(CHUNK))
            .map(|(tets, labels)| {
                monitor.advance(tets.len())?;
                let (mut part, mut block) = (TetSummary::default(), TetBlock::default());
                let mut shapes = Shapes::default();
                for (tet, &label) in tets.iter().zip(labels) {
                    if label == 0 {
                        let corners = tet.map(|v| mesh.point(v));
                        part.inverted_tets += u64::from(!is_positive(corners));
                        continue;
                    }
                    block.push(tet.map(|v| mesh.points[v as usize]));
                    if block.is_full() {
                        part.add(&block, &bin_ends, &mut shapes);
                        block.clear();
                    }
                }
                part.add(&block, &bin_ends, &mut shapes);
                Ok(part)
            })
            .collect::<Result<_>>()?;
        let facet_parts = mesh.facets.par_chunks(CHUNK).map(|facets| {
            monitor.advance(facets.len())?;
            let angles =
                facets.iter().flat_map(|facet| corner_angles(&facet.map(|v| mesh.point(v))));
            Ok(angles.map(Cotangent::new).fold(NO_ANGLES, |range, angle| merged(range, [angle; 2])))
        });
        let facet_angles = facet_parts.try_reduce(|| NO_ANGLES, |a, b| Ok(merged(a, b)))?;

        let mut quality = Quality::default();
        let all = tet_parts.into_iter().reduce(TetSummary::merged).unwrap_or_default();
        if all.tets > 0 {
            quality.tets = all.tets;
            [quality.min_dihedral, quality.max_dihedral] = all.dihedrals.map(Cotangent::angle);
            quality.dihedral_histogram = all.histogram();
            [quality.scaled_jacobian, quality.edge_ratio, quality.radius_ratio] = all.spreads;
            quality.max_radius_edge = all.max_radius_edge;
            quality.mean_radius_edge = all.sum_radius_edge / all.tets as f64;
            quality.max_circumradius = all.max_circumradius;
            quality.min_edge = all.min_edge;
            quality.min_volume = all.min_volume;
            quality.max_volume = all.max_volume;
            quality.total_volume = all.total_volume;
        }
        if !mesh.facets.is_empty() {
            quality.facets = mesh.facets.len() as u64;
            [quality.min_facet_angle, quality.max_facet_angle] = facet_angles.map(Cotangent::angle);
        }
        Ok((quality, all.inverted_tets))
    }
}

/// A tet with a larger scaled Jacobian is positive for certain: the exact predicate need not be
/// asked.
///
/// Six volumes are (b - a) x (c - a) . (d - a), computed with eight roundings: their error is below
/// 16 units of the last place of 1 times the sum of the products of coordinates, which is at most
/// 5.2 times the product of the three lengths; so it is below 1e-14 of that product. The scaled
/// Jacobian is six volumes over the largest such product of a vertex, times 1.4, and has itself an
/// error of some units. Where products underflow it is 0 or off by a root of 2; where they
/// overflow it is 0 or no number.
const POSITIVE: f64 = 1e-12;

/// Exact as long as no product of three coordinate differences over- or underflows; what is no
/// number, for products that overflow, proves nothing.
fn is_positive([a, b, c, d]: [DVec3; 4]) -> bool {
    orient(a, b, c, d) > 0.0
}

/// The smallest and the largest of some angles.
type AngleRange = [Cotangent; 2];

/// The range of no angles.
const NO_ANGLES: AngleRange = [Cotangent::OF_STRAIGHT, Cotangent::OF_ZERO];

#[inline]
fn merged(a: AngleRange, b: AngleRange) -> AngleRange {
    [a[0].max(b[0]), a[1].min(b[1])]
}

/// The least and the largest of `values`, infinite where there are none; what is no number is
/// passed over.
fn range(values: &[f64]) -> [f64; 2] {
    // Several side by side: none waits for the one before.
    const LANES: usize = 8;
    let less = |a: f64, b: f64| if a < b { a } else { b };
    let more = |a: f64, b: f64| if a > b { a } else { b };
    let (chunks, rest) = values.as_chunks::<LANES>();
    let (mut least, mut largest) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    for chunk in chunks {
        least = std::array::from_fn(|lane| less(chunk[lane], least[lane]));
        largest = std::array::from_fn(|lane| more(chunk[lane], largest[lane]));
    }
    for (lane, &value) in rest.iter().enumerate() {
        least[lane] = less(value, least[lane]);
        largest[lane] = more(value, largest[lane]);
    }
    [
        least.into_iter().fold(f64::INFINITY, f64::min),
        largest.into_iter().fold(f64::NEG_INFINITY, f64::max),
    ]
}

/// What is gathered over some tets; `default()` is neutral.
struct TetSummary {
    tets: u64,
    inverted_tets: u64,
    dihedrals: AngleRange,
    /// How many dihedral angles are at least as large as the end of each bin.
    beyond: [u64; 17],
    /// Of scaled Jacobians, edge ratios and radius ratios.
    spreads: [Spread; 3],
    max_radius_edge: f64,
    sum_radius_edge: f64,
    max_circumradius: f64,
    min_edge: f64,
    min_volume: f64,
    max_volume: f64,
    total_volume: f64,
}

impl Default for TetSummary {
    fn default() -> Self {
        Self {
            tets: 0,
            inverted_tets: 0,
            dihedrals: NO_ANGLES,
            beyond: [0; 17],
            spreads: [Spread::NEUTRAL; 3],
            max_radius_edge: 0.0,
            sum_radius_edge: 0.0,
            max_circumradius: 0.0,
            min_edge: f64::INFINITY,
            min_volume: f64::INFINITY,
            max_volume: f64::NEG_INFINITY,
            total_volume: 0.0,
        }
    }
}

impl TetSummary {
    fn add(&mut self, block: &TetBlock, bin_ends: &[Cotangent; 17], shapes: &mut Shapes) {
        let len = block.len();
        block.shapes(bin_ends, shapes, &mut self.beyond);
        self.tets += len as u64;
        for row in &shapes.cotangents {
            // The cotangent falls as the angle grows.
            let [largest, smallest] = range(&row[..len]).map(Cotangent);
            self.dihedrals = merged(self.dihedrals, [smallest, largest]);
        }
        let [jacobians, edges, radii] = &mut self.spreads;
        jacobians.add(&shapes.scaled_jacobian[..len], OF_JACOBIANS);
        edges.add(&shapes.edge_ratio[..len], OF_RATIOS);
        radii.add(&shapes.radius_ratio[..len], OF_RATIOS);
        let [_, radius] = range(&shapes.circumradius[..len]);
        let [edge, _] = range(&shapes.shortest_edge[..len]);
        let [_, ratio] = range(&shapes.radius_edge[..len]);
        let [min_volume, max_volume] = range(&shapes.volume[..len]);
        self.max_circumradius = self.max_circumradius.max(radius);
        self.min_edge = self.min_edge.min(edge);
        self.max_radius_edge = self.max_radius_edge.max(ratio);
        self.min_volume = self.min_volume.min(min_volume);
        self.max_volume = self.max_volume.max(max_volume);
        for (ratio, volume) in shapes.radius_edge[..len].iter().zip(&shapes.volume) {
            self.sum_radius_edge += ratio;
            self.total_volume += volume;
        }
        let is_certain = |&jacobian: &f64| jacobian > POSITIVE;
        if !shapes.scaled_jacobian[..len].iter().map(is_certain).fold(true, |all, is| all & is) {
            self.inverted_tets +=
                (0..len).filter(|&i| !is_positive(block.corners(i))).count() as u64;
        }
    }

    fn merged(mut self, other: Self) -> Self {
        self.tets += other.tets;
        self.inverted_tets += other.inverted_tets;
        self.dihedrals = merged(self.dihedrals, other.dihedrals);
        for (beyond, more) in self.beyond.iter_mut().zip(other.beyond) {
            *beyond += more;
        }
        self.spreads.iter_mut().zip(&other.spreads).for_each(|(spread, other)| spread.merge(other));
        self.max_radius_edge = self.max_radius_edge.max(other.max_radius_edge);
        self.sum_radius_edge += other.sum_radius_edge;
        self.max_circumradius = self.max_circumradius.max(other.max_circumradius);
        self.min_edge = self.min_edge.min(other.min_edge);
        self.min_volume = self.min_volume.min(other.min_volume);
        self.max_volume = self.max_volume.max(other.max_volume);
        self.total_volume += other.total_volume;
        self
    }

    fn histogram(&self) -> [u64; 18] {
        std::array::from_fn(|bin| {
            let from = if bin == 0 { 6 * self.tets } else { self.beyond[bin - 1] };
            from - self.beyond.get(bin).unwrap_or(&0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::measures::{dihedral_angles, triangle_angles};
    use crate::mesh::testing;

    fn measured(mesh: &TetMesh) -> Quality {
        Quality::measure(mesh, &Monitor::silent()).unwrap().0
    }

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1.0), "{a} is not {b}");
    }

    #[test]
    fn summary_of_a_kuhn_box() {
        let mesh = testing::kuhn_box([3, 2, 2], [1.0; 3], |i, _, _| (i as i32 + 1) % 3);
        let quality = measured(&mesh);
        // A third of the cubes is background that was kept.
        assert_eq!(quality.tets, 6 * 8);
        assert_eq!(quality.facets, mesh.facets.len() as u64);
        close(quality.total_volume, 8.0);
        close(quality.min_volume, 1.0 / 6.0);
        close(quality.min_dihedral, 45.0);
        close(quality.max_dihedral, 90.0);
        close(quality.mean_radius_edge, 3.0_f64.sqrt() / 2.0);
        close(quality.max_circumradius, 3.0_f64.sqrt() / 2.0);
        close(quality.min_facet_angle, 45.0);
        close(quality.max_facet_angle, 90.0);
        assert_eq!(quality.dihedral_histogram.iter().sum::<u64>(), 6 * quality.tets);
    }

    /// Points of a grid, shaken, so that no two tets are alike and sums depend on their order.
    fn shaken_box() -> TetMesh {
        let mut mesh =
            testing::kuhn_box([20, 15, 12], [1.0, 0.7, 0.4], |i, j, k| ((i + j * k) % 4) as i32);
        for (v, p) in mesh.points.iter_mut().enumerate() {
            *p = p.map(|x| x + 0.3 * ((v * 37 % 101) as f64 / 101.0 - 0.5));
        }
        mesh
    }

    #[test]
    fn bins_and_extremes_are_those_of_the_angles() {
        let mesh = shaken_box();
        let quality = measured(&mesh);
        let corners = |tet: &[u32; 4]| tet.map(|v| mesh.point(v));
        let object = mesh.tets.iter().zip(&mesh.labels).filter(|&(_, &label)| label != 0);
        let angles: Vec<f64> = object.flat_map(|(tet, _)| dihedral_angles(&corners(tet))).collect();
        let mut bins = [0; 18];
        angles.iter().for_each(|angle| bins[(angle / 10.0) as usize] += 1);
        assert_eq!(quality.dihedral_histogram, bins);
        close(quality.min_dihedral, angles.iter().copied().fold(f64::INFINITY, f64::min));
        close(quality.max_dihedral, angles.iter().copied().fold(0.0, f64::max));
        let planar = || mesh.facets.iter().flat_map(|f| triangle_angles(&f.map(|v| mesh.point(v))));
        close(quality.min_facet_angle, planar().fold(f64::INFINITY, f64::min));
        close(quality.max_facet_angle, planar().fold(0.0, f64::max));
    }

    #[test]
    fn extreme_angles_are_counted() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let tet = |points: [[f64; 3]; 4]| TetMesh {
            points: points.to_vec(),
            tets: vec![[0, 1, 2, 3]],
            labels: vec![1],
            ..TetMesh::default()
        };
        let flat = measured(&tet(square));
        assert_eq!(
            (flat.min_dihedral, flat.max_dihedral, flat.max_radius_edge),
            (0.0, 180.0, f64::INFINITY)
        );
        assert_eq!((flat.dihedral_histogram[0], flat.dihedral_histogram[17]), (4, 2));
        let point = measured(&tet([[1.0; 3]; 4]));
        assert_eq!((point.dihedral_histogram[0], point.min_edge), (6, 0.0));
    }

    #[test]
    fn equal_bits_on_any_number_of_threads() {
        let mesh = shaken_box();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| measured(&mesh))
        };
        assert!(mesh.tets.len() > 5 * CHUNK);
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn nothing_to_measure() {
        assert_eq!(measured(&TetMesh::default()), Quality::default());
    }
}
