//! Where the mesh has changed since it was looked at last: found from the tets in the slots of the
//! triangulation then and now, whatever was done meanwhile.
//!
//! Of each tet of a label its vertices and its label are kept, in 18 bytes: a slot where one of
//! them is another has changed. Ids of vertices are never used twice, and a vertex that was removed
//! stays where it was: so where a tet was is known when it is gone.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::delaunay::{TetId, Triangulation, VertexId};
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{reserve, zeroed_with_room};
use crate::monitor::Monitor;
use crate::refine::rules::Rules;

/// There is room for one new slot in so many: tables that grow are copied, by one thread.
const SPARE_OF: usize = 4;

/// Slots of one piece of work, between two looks at the cancel flag.
const PIECE: usize = 1 << 13;

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
        const WHAT: &str = "tets that were seen";
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
