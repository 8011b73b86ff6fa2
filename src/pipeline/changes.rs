//! Where the mesh has changed since it was looked at last: found from the tets in the slots of the
//! triangulation then and now, whatever was done meanwhile.
//!
//! Of each tet of a label its circumsphere and its label are kept, in 18 bytes: a slot where one of
//! them is another has changed. Where both are the same the tet may still be another one, if more
//! than four vertices lie on the sphere, as the eight corners of a cube do. But the tets of these
//! vertices all have the sphere's centre as circumcenter, and so one label: however they divide the
//! cube, it has this label as before. The same vertices divide it in the same way, for ties are
//! broken by their coordinates; so its facets are the same, too.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::delaunay::TetId;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{reserve, zeroed_with_room};
use crate::monitor::Monitor;
use crate::refine::rules::Rules;

/// Balls are larger than spheres by more than rounding, also where a nearly flat tet has a sphere
/// of a million voxels.
const LARGER: f64 = 1.0 + 1e-6;

/// There is room for one new slot in so many: tables that grow are copied, by one thread.
const SPARE_OF: usize = 4;

/// Slots of one piece of work, between two looks at the cancel flag.
const PIECE: usize = 1 << 13;

/// A ball that holds a tet: its centre in voxels of the region, so that rounding does not depend on
/// where in the world that lies, and its radius in world units.
type Ball = [f32; 4];

/// The tets of labels that were there.
#[derive(Debug, Default)]
pub(super) struct SeenTets {
    /// For each slot the id of the tet's label; 0 where there was none.
    labels: Vec<u16>,
    /// For each slot; where the label is 0 they say nothing.
    balls: Vec<Ball>,
}

impl SeenTets {
    /// Bytes for each slot of a tet.
    pub const BYTES_PER_SLOT: u64 = (size_of::<u16>() + size_of::<Ball>()) as u64;

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
            self.balls = zeroed_with_room(slots, more, WHAT)?;
        } else {
            let more = slots.saturating_sub(self.labels.len());
            reserve(&mut self.labels, more, WHAT)?;
            reserve(&mut self.balls, more, WHAT)?;
            self.labels.resize(slots, 0);
            self.balls.resize(slots, Ball::default());
        }
        let seen = self.labels.par_chunks_mut(PIECE).zip(self.balls.par_chunks_mut(PIECE));
        seen.enumerate().try_for_each(|(piece, (labels, balls))| {
            monitor.advance(0)?;
            let slots = (piece * PIECE) as TetId..;
            for (t, (label_before, before)) in slots.zip(labels.iter_mut().zip(balls)) {
                triangulation.prefetch_next(t);
                let label = if triangulation.is_living(t) { rules.label(t) } else { 0 };
                if label == 0 && *label_before == 0 {
                    continue;
                }
                let now = if label == 0 { *before } else { ball_of(rules, t, changed) };
                let has_changed = !is_first && (label, now) != (*label_before, *before);
                if has_changed && *label_before != 0 {
                    let [x, y, z, radius] = before.map(f64::from);
                    changed.add_ball(DVec3::new(x, y, z), radius);
                }
                if has_changed && label != 0 {
                    let vertices = triangulation.tet(t).vertices();
                    changed.add_around(vertices.map(|v| triangulation.position(v)));
                }
                (*label_before, *before) = (label, now);
            }
            Ok(())
        })
    }
}

/// The ball of a tet.
fn ball_of(rules: &Rules<'_>, t: TetId, blocks: &VoxelBlocks) -> Ball {
    let triangulation = rules.triangulation();
    let record = triangulation.tet(t);
    let sphere = record.sphere();
    let radius = if sphere.is_certain() {
        sphere.squared_radius().sqrt()
    } else {
        // Too flat to have a circumcenter: from its centroid on.
        let away = |v| triangulation.position(v).distance(sphere.center);
        record.vertices().into_iter().map(away).fold(0.0, f64::max)
    };
    let [x, y, z] = blocks.index_at(sphere.center).to_array();
    [x, y, z, LARGER * radius].map(|c| c as f32)
}
