//! Where the mesh has changed since it was looked at last: found from the tets in the slots of the
//! triangulation then and now, whatever was done meanwhile. And the tets that are in some places,
//! or about some labels.
//!
//! Of each tet of a label its vertices and its label are kept, in 18 bytes: a slot where one of
//! them is another has changed. Ids of vertices are never used twice, and a vertex that was removed
//! stays where it was: so where a tet was is known when it is gone.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::delaunay::{TetId, Triangulation, VertexId};
use crate::image::voxel_blocks::{NearBlocks, VoxelBlocks};
use crate::memory::bits::Bits;
use crate::memory::{concatenated, reserve, zeroed_with_room};
use crate::monitor::Monitor;
use crate::refine::rules::Rules;

/// There is room for one new slot in so many: tables that grow are copied, by one thread.
const SPARE_OF: usize = 4;

/// Slots of one piece of work, between two looks at the cancel flag.
const PIECE: usize = 1 << 13;

/// How often tets that share a vertex are taken in, where those around some labels are asked for.
/// Once for the tets that may come to these labels: each has a vertex on them. And once more for
/// all tets that these meet: they tell what may be done.
const RINGS: usize = 2;

/// What lists and tables of this module have, as errors name it.
const WHAT: &str = "tets that were seen";

/// Corners of a tet so many slots ahead are fetched.
const AHEAD: usize = 16;

/// The tets of labels that were there.
#[derive(Debug, Default)]
pub(super) struct SeenTets {
    /// For each slot the id of the tet's label; 0 where there was none.
    labels: Vec<u16>,
    /// For each slot; where the label is 0 they say nothing.
    tets: Vec<[VertexId; 4]>,
}

impl SeenTets {
    /// Bytes for each slot of a tet.
    pub const BYTES_PER_SLOT: u64 = (size_of::<u16>() + size_of::<[VertexId; 4]>()) as u64;

    /// How many slots were looked at.
    pub fn slots(&self) -> usize {
        self.labels.len()
    }

    /// Whether none have been seen.
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    /// Looks at the tets of a triangulation at rest, and adds the blocks where they have changed.
    /// The first time all of them are new, and no block is added.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); [`Cancelled`](crate::Error::Cancelled).
    pub fn update(
        &mut self,
        rules: &Rules<'_>,
        changed: &VoxelBlocks,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        let triangulation = rules.triangulation();
        let slots = triangulation.tet_bound() as usize;
        let is_first = self.is_empty();
        if is_first {
            let more = slots / SPARE_OF;
            self.labels = zeroed_with_room(slots, more, WHAT)?;
            self.tets = zeroed_with_room(slots, more, WHAT)?;
        } else {
            let more = slots.saturating_sub(self.labels.len());
            reserve(&mut self.labels, more, WHAT)?;
            reserve(&mut self.tets, more, WHAT)?;
            self.labels.resize(slots, 0);
            self.tets.resize(slots, [0; 4]);
        }
        let seen = self.labels.par_chunks_mut(PIECE).zip(self.tets.par_chunks_mut(PIECE));
        seen.enumerate().try_for_each(|(piece, (labels, tets))| {
            monitor.advance(0)?;
            let slots = (piece * PIECE) as TetId..;
            for (t, (label_before, before)) in slots.zip(labels.iter_mut().zip(tets)) {
                triangulation.prefetch_next(t);
                let label = if triangulation.is_living(t) { rules.label(t) } else { 0 };
                if label == 0 && *label_before == 0 {
                    continue;
                }
                let now = if label == 0 { *before } else { triangulation.tet(t).vertices() };
                if !is_first && (label, now) != (*label_before, *before) {
                    for (label, vertices) in [(*label_before, *before), (label, now)] {
                        if label != 0 {
                            changed.add_around(triangulation.corners(vertices));
                        }
                    }
                }
                (*label_before, *before) = (label, now);
            }
            Ok(())
        })
    }

    /// The tets that come near to some blocks, in the order of their slots.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); [`Cancelled`](crate::Error::Cancelled).
    pub fn near(
        &self,
        triangulation: &Triangulation,
        blocks: &NearBlocks,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<TetId>> {
        self.chosen(
            |label, tet| label != 0 && blocks.blocks().meet_around(triangulation.corners(tet)),
            monitor,
        )
    }

    /// The tets of some labels, and those around them, of the background too, in the order of their
    /// slots, and their bits; `None` if there are more than `most` of these labels. Around them are
    /// tets that share a vertex with them, and those that share one with these. One thread does it.
    ///
    /// # Errors
    /// As [`Self::near`].
    pub fn and_around(
        &self,
        triangulation: &Triangulation,
        is_chosen: impl Fn(u16) -> bool + Sync,
        most: usize,
        monitor: &Monitor<'_>,
    ) -> Result<Option<(Vec<TetId>, Bits)>> {
        let mut tets = self.chosen(|label, _| label != 0 && is_chosen(label), monitor)?;
        if tets.len() > most {
            return Ok(None);
        }
        let are_there = Bits::new(self.labels.len(), WHAT)?;
        tets.par_iter().for_each(|&t| are_there.set(t));
        for _ in 0..RINGS {
            let is_corner = Bits::new(triangulation.vertex_bound() as usize, WHAT)?;
            let corners = |&t: &TetId| triangulation.tet(t).vertices();
            tets.par_iter().flat_map_iter(corners).for_each(|v| is_corner.set(v));
            // The tets of a vertex are joined across facets.
            let mut next = 0;
            while let Some(&t) = tets.get(next) {
                if next.is_multiple_of(PIECE) {
                    monitor.advance(0)?;
                }
                next += 1;
                let record = triangulation.tet(t);
                for facet in (0..4).map(|i| record.neighbor(i)).filter(|facet| !facet.is_none()) {
                    let u = facet.tet();
                    let is_around =
                        || triangulation.tet(u).vertices().iter().any(|&v| is_corner.has(v));
                    if !are_there.has(u) && is_around() {
                        are_there.set(u);
                        reserve(&mut tets, 1, WHAT)?;
                        tets.push(u);
                    }
                }
            }
        }
        tets.par_sort_unstable();
        Ok(Some((tets, are_there)))
    }

    /// Those with such a label and such vertices, in the order of their slots.
    fn chosen(
        &self,
        is_chosen: impl Fn(u16, [VertexId; 4]) -> bool + Sync,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<TetId>> {
        let seen = self.labels.par_chunks(PIECE).zip(self.tets.par_chunks(PIECE));
        let pieces = seen.enumerate().map(|(piece, (labels, tets))| {
            monitor.advance(0)?;
            let mut chosen = Vec::new();
            let slots = (piece * PIECE) as TetId..;
            for (t, (&label, &tet)) in slots.zip(labels.iter().zip(tets)) {
                if is_chosen(label, tet) {
                    reserve(&mut chosen, 1, WHAT)?;
                    chosen.push(t);
                }
            }
            Ok(chosen)
        });
        concatenated(pieces.collect::<Result<_>>()?, WHAT)
    }

    /// Calls `visit` for each of the tets that were there, with the id of its label and its
    /// corners.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled).
    pub fn visit(
        &self,
        triangulation: &Triangulation,
        visit: impl Fn(u16, [DVec3; 4]) + Sync,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        let seen = self.labels.par_chunks(PIECE).zip(self.tets.par_chunks(PIECE));
        seen.try_for_each(|(labels, tets)| {
            monitor.advance(0)?;
            for (n, (&label, &tet)) in labels.iter().zip(tets).enumerate() {
                // Corners lie anywhere in memory.
                if let Some(&ahead) = tets.get(n + AHEAD) {
                    triangulation.prefetch_corners(ahead);
                }
                if label != 0 {
                    visit(label, triangulation.corners(tet));
                }
            }
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::delaunay::{Insertion, Solo, VertexKind, Worker};

    #[test]
    fn what_shares_vertices_is_around() {
        let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut worker = Worker::new(Solo, 0);
        for i in 1..2000 {
            let p =
                (DVec3::new(0.819_172_513, 0.671_043_607, 0.549_700_478) * f64::from(i)).fract();
            let start = triangulation.locate(triangulation.vertex(0).star(), p);
            let inserted = worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
            assert!(matches!(inserted, Insertion::Done(_)));
        }
        // Label 1 within a small ball, 2 within a larger one.
        let slots = 0..triangulation.tet_bound();
        let vertices = |t: TetId| triangulation.tet(t).vertices();
        let label = |t: TetId| {
            if !triangulation.is_living(t) {
                return 0;
            }
            let middle = triangulation.corners(vertices(t)).iter().sum::<DVec3>() / 4.0;
            match middle.distance(DVec3::splat(0.5)) {
                0.0..0.1 => 1,
                0.1..0.3 => 2,
                _ => 0,
            }
        };
        let seen = SeenTets {
            labels: slots.clone().map(label).collect(),
            tets: slots.map(vertices).collect(),
        };
        let around = |most: usize| {
            seen.and_around(&triangulation, |id| id == 1, most, &Monitor::silent()).unwrap()
        };
        let (found, bits) = around(usize::MAX).unwrap();
        assert!(bits.ones().eq(found.iter().copied()));
        let mut expected: BTreeSet<TetId> =
            triangulation.living_tets().filter(|&t| label(t) == 1).collect();
        let inner = expected.len();
        for _ in 0..RINGS {
            let corners: BTreeSet<VertexId> = expected.iter().flat_map(|&t| vertices(t)).collect();
            let is_around = |&t: &TetId| vertices(t).iter().any(|v| corners.contains(v));
            expected = triangulation.living_tets().filter(is_around).collect();
        }
        assert!(0 < inner && inner < expected.len(), "{inner} of {}", expected.len());
        assert!(expected.into_iter().eq(found));
        assert!(around(inner).is_some() && around(inner - 1).is_none());
    }
}
