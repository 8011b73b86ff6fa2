//! The validator: checks the invariants of the module exactly. Runs in tests after operations, and
//! as a part of every certificate.
//!
//! Checking every facet against the vertex across it suffices: a triangulation of a convex box that
//! is locally Delaunay at each facet is Delaunay (Delaunay 1934).
//!
//! Runs in the current rayon pool, tet by tet in the order of their places, so that neighbours are
//! at hand; the counts do not depend on the number of threads. Linear.

use rayon::prelude::*;

use super::tet::{FACET, Facet, TetId, VertexId, VertexKind, VertexRecord};
use super::triangulation::Triangulation;
use crate::Result;
use crate::geometry::predicates::{in_sphere_perturbed, orient};
use crate::geometry::sphere::Circumsphere;
use crate::geometry::tet_block::{BLOCK, Spheres, TetBlock};

/// Tets, or vertices, between two questions whether to go on: one piece of work.
pub const CHECK_EVERY: usize = 1 << 12;

/// A sweep fetches the tet this many places ahead: more than there are in a few cells, so that most
/// neighbours are there before they are asked for.
const AHEAD: usize = 96;

/// It fetches what the tet this many places ahead leads to, vertices and neighbours; its own record
/// is there by then.
const AHEAD_AROUND: usize = 32;

/// What the validator counted. All but `tets` and `vertices` are 0 for a sound triangulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Check {
    /// Living tets.
    pub tets: u64,
    /// Vertices in some tet.
    pub vertices: u64,
    /// Tets that are not positive.
    pub inverted_tets: u64,
    /// Facets whose two sides disagree about being neighbours.
    pub broken_adjacency: u64,
    /// Facets with the vertex across inside the circumball (perturbed).
    pub non_delaunay_facets: u64,
    /// Vertices that name a tet they are not part of, and tets that name a removed vertex.
    pub broken_stars: u64,
}

impl Check {
    /// Whether every invariant holds.
    pub fn is_sound(&self) -> bool {
        self.inverted_tets + self.broken_adjacency + self.non_delaunay_facets + self.broken_stars
            == 0
    }

    fn merged(self, other: Self) -> Self {
        Self {
            tets: self.tets + other.tets,
            vertices: self.vertices + other.vertices,
            inverted_tets: self.inverted_tets + other.inverted_tets,
            broken_adjacency: self.broken_adjacency + other.broken_adjacency,
            non_delaunay_facets: self.non_delaunay_facets + other.non_delaunay_facets,
            broken_stars: self.broken_stars + other.broken_stars,
        }
    }
}

impl Triangulation {
    /// Checks the whole triangulation. Not to be used while others operate.
    ///
    /// # Panics
    /// When there is no memory for the order of the tets.
    pub fn check(&self) -> Check {
        let order = self.tets_by_place(|| Ok(()));
        order
            .and_then(|order| self.check_in(&order, |_| Ok(())))
            .expect("memory for the order of the tets")
    }

    /// As [`Self::check`], by the `order` of [`Self::tets_by_place`]. Shows each piece of
    /// [`CHECK_EVERY`] tets to `inspect` after it was checked, while it is in the cache, on any
    /// thread of the pool; and as often no tets while it goes through the vertices.
    ///
    /// # Errors
    /// Those of `inspect`.
    pub fn check_in(
        &self,
        order: &[TetId],
        inspect: impl Fn(&[TetId]) -> Result<()> + Sync,
    ) -> Result<Check> {
        let tets = order.par_chunks(CHECK_EVERY).map(|tets| {
            let mut check = Check { tets: tets.len() as u64, ..Check::default() };
            let mut stars = 0;
            let (mut block, mut spheres) = (TetBlock::default(), Spheres::default());
            for (piece, of_block) in tets.chunks(BLOCK).enumerate() {
                block.clear();
                for (i, &t) in (piece * BLOCK..).zip(of_block) {
                    self.prefetch(tets[(i + AHEAD).min(tets.len() - 1)]);
                    self.prefetch_around(tets[(i + AHEAD_AROUND).min(tets.len() - 1)]);
                    self.gather(t, &mut block, &mut check, &mut stars);
                }
                // The spheres made anew: what the tets keep is not trusted here.
                block.spheres(&mut spheres);
                for (i, &t) in of_block.iter().enumerate() {
                    self.check_tet(t, &spheres.get(i), &mut check);
                }
            }
            inspect(tets)?;
            Ok((check, stars))
        });
        // Counts: their sums do not depend on the order.
        let (mut check, stars) =
            tets.try_reduce(Default::default, |a, b| Ok((a.0.merged(b.0), a.1 + b.1)))?;
        let bound = self.vertex_bound();
        let vertices = (0..bound.div_ceil(CHECK_EVERY as u32)).into_par_iter().map(|piece| {
            inspect(&[])?;
            let first = piece * CHECK_EVERY as u32;
            let pieces = first..(first + CHECK_EVERY as u32).min(bound);
            Ok(pieces.filter(|&v| self.vertex(v).kind() != VertexKind::Removed).count() as u64)
        });
        check.vertices = vertices.try_reduce(|| 0, |a, b| Ok(a + b))?;
        // Those whose tet was not met.
        check.broken_stars += check.vertices.saturating_sub(stars);
        Ok(check)
    }

    /// Puts a tet into a block, and checks its vertices; `stars` counts those that name it as
    /// theirs.
    #[inline(always)]
    fn gather(&self, t: TetId, block: &mut TetBlock, check: &mut Check, stars: &mut u64) {
        let records = self.tet(t).vertices().map(|v| self.vertex(v));
        let is_removed = |vertex: &&VertexRecord| vertex.kind() == VertexKind::Removed;
        check.broken_stars += u64::from(records.iter().any(is_removed));
        *stars += records.iter().filter(|vertex| !is_removed(vertex) && vertex.star() == t).count()
            as u64;
        block.push(records.map(|vertex| vertex.position().to_array()));
    }

    /// Checks a tet with this sphere, and its facets.
    #[inline(always)]
    fn check_tet(&self, t: TetId, sphere: &Circumsphere, check: &mut Check) {
        let vertices = self.tet(t).vertices();
        // It is certain only of tets that are positive by more than the error of the determinant.
        if !sphere.is_certain() && !self.is_positive(vertices) {
            check.inverted_tets += 1;
        }
        for i in 0..4 {
            let twin = self.tet(t).neighbor(i);
            if twin.is_none() {
                let [a, b, c] = FACET[i].map(|k| self.position(vertices[k]));
                let on_box = (0..3).any(|x| {
                    a[x] == b[x]
                        && b[x] == c[x]
                        && (a[x] == self.lower()[x] || a[x] == self.upper()[x])
                });
                check.broken_adjacency += u64::from(!on_box);
                continue;
            }
            if !self.is_living(twin.tet())
                || self.tet(twin.tet()).neighbor(twin.index()) != Facet::new(t, i)
            {
                check.broken_adjacency += 1;
                continue;
            }
            // The two sides name each other; what they share is inspected from one of them.
            if t > twin.tet() {
                continue;
            }
            let other = self.tet(twin.tet()).vertices();
            if !is_same_facet(FACET[i].map(|k| vertices[k]), FACET[twin.index()].map(|k| other[k]))
            {
                check.broken_adjacency += 1;
                continue;
            }
            let across = self.position(other[twin.index()]);
            // The bounds of the sphere are proved, so an answer is the exact one.
            let exactly = || in_sphere_perturbed(self.corners(vertices), across);
            let inside = sphere.contains(across).unwrap_or_else(exactly);
            check.non_delaunay_facets += u64::from(inside);
        }
    }

    #[cold]
    fn is_positive(&self, vertices: [VertexId; 4]) -> bool {
        let [a, b, c, d] = self.corners(vertices);
        orient(a, b, c, d) > 0.0
    }
}

/// Whether two facets have the same vertices, in any order. A facet of a positive tet has three
/// different ones.
fn is_same_facet(facet: [VertexId; 3], across: [VertexId; 3]) -> bool {
    facet.map(|v| across.map(|w| u32::from(v == w)).iter().sum::<u32>()) == [1; 3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;
    use crate::delaunay::{Solo, Worker};
    use glam::DVec3;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    /// A few thousand points of a lattice.
    fn triangulation() -> Triangulation {
        let triangulation = Triangulation::new(DVec3::splat(-1.0), DVec3::splat(12.5)).unwrap();
        let mut worker = Worker::new(Solo, 0);
        let mut start = 0;
        for i in 0..12 * 12 * 12 {
            let p = DVec3::new(f64::from(i % 12), f64::from(i / 12 % 12), f64::from(i / 144));
            start = triangulation.locate(start, p);
            worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
            start = worker.created()[0];
        }
        triangulation
    }

    fn check_on(threads: usize, triangulation: &Triangulation) -> Check {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| triangulation.check())
    }

    #[test]
    fn faults_are_found_by_any_number_of_threads() {
        let triangulation = triangulation();
        let sound = check_on(1, &triangulation);
        assert!(sound.is_sound() && sound.vertices == 8 + 12 * 12 * 12, "{sound:?}");
        assert_eq!(sound, check_on(3, &triangulation));

        // One side of a facet forgets the other; a vertex names a tet of another place.
        let living: Vec<TetId> = triangulation.living_tets().collect();
        let inner = |t: &TetId| (0..4).all(|i| !triangulation.tet(*t).neighbor(i).is_none());
        let t = *living.iter().find(|t| inner(t)).unwrap();
        let twin = triangulation.tet(t).neighbor(2);
        triangulation.tet(t).set_neighbor(2, Facet::new(twin.tet(), (twin.index() + 1) % 4));
        let v = triangulation.tet(t).vertices()[0];
        let far = *living.iter().find(|&&t| !triangulation.tet(t).vertices().contains(&v)).unwrap();
        triangulation.vertex(v).set_star(far);
        let broken = check_on(1, &triangulation);
        assert_eq!((broken.broken_adjacency, broken.broken_stars), (2, 1), "{broken:?}");
        assert_eq!(broken, check_on(3, &triangulation));
    }

    #[test]
    fn facets_are_the_same_in_any_order() {
        assert!(is_same_facet([1, 2, 3], [3, 1, 2]) && is_same_facet([1, 2, 3], [2, 1, 3]));
        assert!(!is_same_facet([1, 2, 3], [1, 2, 4]) && !is_same_facet([1, 2, 3], [1, 2, 2]));
    }

    #[test]
    fn the_check_ends_when_told_to() {
        let left = AtomicU32::new(1);
        let stop = |_: &[TetId]| {
            if left.fetch_sub(1, Relaxed) == 0 { Err(Error::Cancelled) } else { Ok(()) }
        };
        let triangulation = triangulation();
        let order = triangulation.tets_by_place(|| Ok(())).unwrap();
        assert!(matches!(triangulation.check_in(&order, stop), Err(Error::Cancelled)));
    }
}
