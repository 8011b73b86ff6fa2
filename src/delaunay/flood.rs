//! Going from tet to tet across facets, through all that have something in common.
//!
//! **Tets near to a place.** All tets whose circumballs meet a convex place are reached from one
//! that holds a point of it, through tets of that kind alone:
//!
//! - The tets whose circumballs hold a point are connected across facets: they are the point's
//!   cavity. So each tet of the kind is connected to one that holds a point of the place.
//! - Between two points of the place lies a segment of it, and the tets that this meets follow one
//!   another across facets. Where it leads through an edge or a vertex all tets around that one
//!   have it in their circumballs.
//!
//! Of several places, each needs a tet to begin with.

use glam::DVec3;

use super::tet::{BOX_VERTICES, TetId};
use super::triangulation::Triangulation;
use crate::Result;
use crate::memory::bits::Bits;
use crate::memory::reserve;

/// Tets that are looked at between two looks at whether to go on.
const PIECE: usize = 1 << 12;

impl Triangulation {
    /// The tets of which `is_wanted` is true and that are reached through such from those that hold
    /// one of these points of the box, in the order of their slots. Of a triangulation at rest.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); those of `go_on`, which is asked again and
    /// again.
    pub fn tets_reached(
        &self,
        from: impl Iterator<Item = DVec3>,
        is_wanted: impl Fn(TetId) -> bool,
        go_on: impl Fn() -> Result<()>,
    ) -> Result<Vec<TetId>> {
        const WHAT: &str = "tets near to a place";
        let was_seen = Bits::new(self.tet_bound() as usize, WHAT)?;
        let mut reached = Vec::new();
        let mut next = 0;
        // Corners of the box always have a tet.
        let mut at = self.vertex(BOX_VERTICES - 1).star();
        for p in from {
            at = self.locate(at, p);
            let see = |t: TetId, reached: &mut Vec<TetId>| {
                if was_seen.has(t) {
                    return Ok(());
                }
                was_seen.set(t);
                if is_wanted(t) {
                    reserve(reached, 1, WHAT)?;
                    reached.push(t);
                }
                Ok(())
            };
            see(at, &mut reached)?;
            while let Some(&t) = reached.get(next) {
                if next.is_multiple_of(PIECE) {
                    go_on()?;
                }
                next += 1;
                let record = self.tet(t);
                self.prefetch_neighbors(record);
                let beyond = (0..4).map(|i| record.neighbor(i)).filter(|facet| !facet.is_none());
                beyond.map(|facet| facet.tet()).try_for_each(|t| see(t, &mut reached))?;
            }
        }
        reached.sort_unstable();
        Ok(reached)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::delaunay::{Insertion, Solo, VertexKind, Worker};

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(0.001..0.999).prop_map(DVec3::from)
    }

    proptest! {
        /// All tets whose circumballs meet one of some boxes are reached from the boxes.
        #[test]
        fn all_tets_near_to_boxes_are_reached(
            points in prop::collection::vec(point(), 0..300),
            boxes in prop::collection::vec((point(), point()), 0..4),
        ) {
            let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
            let mut worker = Worker::new(Solo, 0);
            for p in points {
                let start = triangulation.locate(triangulation.vertex(0).star(), p);
                let inserted = worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
                prop_assert!(matches!(inserted, Insertion::Done(_)));
            }
            // Small ones, which most tets are not near to.
            let small = |(low, side): (DVec3, DVec3)| [low, (low + 0.2 * side).min(DVec3::ONE)];
            let boxes: Vec<[DVec3; 2]> = boxes.into_iter().map(small).collect();
            let is_near = |t| {
                let sphere = triangulation.tet(t).sphere();
                boxes.iter().any(|[low, high]| {
                    let nearest = sphere.center.clamp(*low, *high);
                    nearest.distance_squared(sphere.center) <= sphere.squared_radius()
                })
            };
            let from = boxes.iter().map(|[low, high]| low.midpoint(*high));
            let reached = triangulation.tets_reached(from, is_near, || Ok(())).unwrap();
            prop_assert!(reached.is_sorted());
            let all: Vec<TetId> = triangulation.living_tets().filter(|&t| is_near(t)).collect();
            // A flat tet has no ball that is known.
            let is_certain = |t: &&TetId| triangulation.tet(**t).sphere().is_certain();
            prop_assert!(all.iter().filter(is_certain).eq(reached.iter().filter(is_certain)));
            prop_assert!(reached.iter().all(|&t| is_near(t)));
        }
    }
}
