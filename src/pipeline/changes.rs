//! Where the mesh has changed since it was looked at last: found from the tets in the slots of the
//! triangulation then and now, whatever was done meanwhile.
//!
//! Of each tet of a label its circumsphere and its label are kept, in 20 bytes: a slot where one of
//! them is another has changed. Where both are the same the tet may still be another one, if more
//! than four vertices lie on the sphere, as the eight corners of a cube do. But the tets of these
//! vertices all have the sphere's centre as circumcenter, and so one label: however they divide the
//! cube, it has this label as before.

use glam::Vec3;
use rayon::prelude::*;

use crate::Result;
use crate::delaunay::TetId;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::reserve;
use crate::monitor::Monitor;
use crate::refine::rules::Rules;

/// Balls are larger than spheres by more than rounding, also where a nearly flat tet has a sphere
/// of a million voxels.
const LARGER: f64 = 1.0 + 1e-6;

/// Slots of one piece of work, between two looks at the cancel flag.
const PIECE: usize = 1 << 13;

/// A ball that holds a tet, and the id of the tet's label; 0 where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ball {
    label: u16,
    /// In voxels of the region, so that rounding does not depend on where in the world that lies.
    center: Vec3,
    /// In world units.
    radius: f32,
}

/// The tets of labels that were there.
#[derive(Debug, Default)]
pub(super) struct SeenTets {
    /// For each slot.
    balls: Vec<Ball>,
}

impl SeenTets {
    /// Bytes for each slot of a tet.
    pub const BYTES_PER_SLOT: u64 = size_of::<Ball>() as u64;

    /// Whether none have been seen.
    pub fn is_empty(&self) -> bool {
        self.balls.is_empty()
    }

    /// Looks at the tets of a triangulation at rest, and adds the blocks where they have changed.
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
        let more = slots.saturating_sub(self.balls.len());
        reserve(&mut self.balls, more, "tets that were seen")?;
        self.balls.resize(slots, Ball::default());
        self.balls.par_chunks_mut(PIECE).enumerate().try_for_each(|(piece, balls)| {
            monitor.advance(0)?;
            for (t, before) in ((piece * PIECE) as TetId..).zip(balls) {
                let label = if triangulation.is_living(t) { rules.label(t) } else { 0 };
                let now = match label {
                    0 => Ball::default(),
                    label => ball_of(rules, t, label, changed),
                };
                if now == *before {
                    continue;
                }
                if before.label != 0 {
                    changed.add_ball(before.center.as_dvec3(), f64::from(before.radius));
                }
                if label != 0 {
                    let vertices = triangulation.tet(t).vertices();
                    changed.add_around(vertices.map(|v| triangulation.position(v)));
                }
                *before = now;
            }
            Ok(())
        })
    }
}

/// The ball of a tet of a label.
fn ball_of(rules: &Rules<'_>, t: TetId, label: u16, blocks: &VoxelBlocks) -> Ball {
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
    let radius = (LARGER * radius) as f32;
    Ball { label, center: blocks.index_at(sphere.center).as_vec3(), radius }
}
