//! Which label of the mesh the centre of each voxel has.
//!
//! Each tet goes through the rows of voxels that it may hold centres of, and clips each to its four
//! planes. In floating point: a centre on a facet, but for rounding, belongs to either side, the
//! larger id where both claim it. So the result does not depend on the number of threads. Linear in
//! the tets and in the voxels.

use std::sync::atomic::{AtomicU16, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::image::LabelImage;
use crate::image::region::Region;
use crate::memory::atomic::atomic;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;

/// Tets of one piece of work.
const CHUNK: usize = 1 << 12;

/// The corners of each facet of a tet, and the corner across from it.
const FACETS: [[usize; 4]; 4] = [[1, 2, 3, 0], [0, 3, 2, 1], [0, 1, 3, 2], [0, 2, 1, 3]];

/// The id of the mesh's label at the centre of each voxel of a region, x fastest, then y; 0 where
/// there is no mesh.
pub(super) struct VoxelLabels<'a> {
    found: &'a [AtomicU16],
    region: &'a Region,
    last: DVec3,
}

impl<'a> VoxelLabels<'a> {
    /// `found` holds 0 for voxels that are to be found; others keep their ids, if these are those
    /// of the mesh. So it may be a part of a mesh that holds these voxels.
    pub fn new(found: &'a mut [u16], region: &'a Region) -> Self {
        let last = DVec3::from(region.dims.map(|n| (n - 1) as f64));
        Self { found: atomic(found), region, last }
    }

    /// Adds a tet, of the label `id`: all of the mesh, or of a part, are to be added.
    #[inline]
    pub fn add(&self, id: u16, corners: &Corners) {
        let [low, high] = corners.bounds.map(|p| self.region.offset(p));
        let (low, high) = (low.max(DVec3::ZERO), high.min(self.last));
        let [from, to] = [low.to_array().map(rounded_up), high.to_array().map(|c| c as i64)];
        // Most tets are smaller than a voxel, or a few, and hold no centre.
        if (0..3).any(|a| from[a] > to[a]) {
            return;
        }
        let [nx, ny, _] = self.region.dims;
        let planes = planes_of(&corners.points.map(|p| self.region.offset(p)));
        for z in from[2] as usize..=to[2] as usize {
            for y in from[1] as usize..=to[1] as usize {
                let row = DVec3::new(0.0, y as f64, z as f64);
                let clipped = clipped(&planes, row, from[0] as f64, to[0] as f64);
                if let Some((from, to)) = clipped {
                    // Relaxed: read when all is done.
                    self.found[nx * (y + ny * z)..][from..=to]
                        .iter()
                        .for_each(|voxel| _ = voxel.fetch_max(id, Relaxed));
                }
            }
        }
    }
}

/// The corners of a tet in voxels of the image, and those of the box around it.
pub(super) struct Corners {
    pub points: [DVec3; 4],
    pub bounds: [DVec3; 2],
}

/// Calls `visit` for each tet whose label is not 0, with the label's id.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub(super) fn visit_tets(
    mesh: &TetMesh,
    image: &LabelImage,
    monitor: &Monitor<'_>,
    visit: impl Fn(u16, &Corners) + Sync,
) -> Result<()> {
    mesh.tets.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, tets)| {
        monitor.advance(tets.len())?;
        for (tet, &label) in tets.iter().zip(&mesh.labels[chunk * CHUNK..]) {
            if let Some(id) = image.id_of(label).filter(|&id| id != 0) {
                let points = tet.map(|v| image.frame().to_index(mesh.point(v)));
                let [a, b, c, d] = points;
                let bounds = [a.min(b).min(c).min(d), a.max(b).max(c).max(d)];
                visit(id, &Corners { points, bounds });
            }
        }
        Ok(())
    })
}

/// The least whole number that is not below one that is not negative.
fn rounded_up(x: f64) -> i64 {
    let down = x as i64;
    down + i64::from(down as f64 != x)
}

/// The planes of a tet's facets: normals to the inside, and what is to be added so that the sum is
/// not negative inside.
pub(super) fn planes_of(corners: &[DVec3; 4]) -> [(DVec3, f64); 4] {
    FACETS.map(|facet| {
        let [a, b, c, d] = facet.map(|i| corners[i]);
        let normal = (b - a).cross(c - a);
        let normal = if normal.dot(d - a) < 0.0 { -normal } else { normal };
        (normal, -normal.dot(a))
    })
}

/// The whole numbers from `from`, which is not negative, to `to` at which a row along x lies within
/// planes: the first and the last.
fn clipped(
    planes: &[(DVec3, f64); 4],
    row: DVec3,
    mut from: f64,
    mut to: f64,
) -> Option<(usize, usize)> {
    for &(normal, offset) in planes {
        let at_zero = normal.dot(row) + offset;
        if normal.x > 0.0 {
            from = from.max(-at_zero / normal.x);
        } else if normal.x < 0.0 {
            to = to.min(at_zero / -normal.x);
        } else if at_zero < 0.0 {
            return None;
        }
    }
    if from > to {
        return None;
    }
    // Neither is negative here.
    let (from, to) = (rounded_up(from) as usize, to as usize);
    (from <= to).then_some((from, to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Frame;
    use crate::mesh::testing;

    #[test]
    fn a_mesh_of_voxels_has_their_labels() {
        let label = |i: usize, j: usize, k: usize| ((i * 7 + j * 3 + k * 5) % 4) as i32;
        let dims = [6, 5, 4];
        let frame = Frame::new(
            [0.3, 0.4, 0.5],
            [0.6, 0.8, 1.0],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        );
        // Centres half a step inside of the cubes of the mesh.
        let image = testing::image(dims, frame.unwrap(), label);
        let mesh = testing::kuhn_box(dims, [0.6, 0.8, 1.0], label);
        let region = Region::new(&image, &|| Ok(())).unwrap();
        let [nx, ny, nz] = region.dims;
        let mut found = vec![0; nx * ny * nz];
        let labels = VoxelLabels::new(&mut found, &region);
        visit_tets(&mesh, &image, &Monitor::silent(), |id, corners| labels.add(id, corners))
            .unwrap();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let at = [0, 1, 2].map(|a| region.place([x, y, z], a, dims[a]));
                    let expected = match at {
                        [Some(i), Some(j), Some(k)] => image.id_of(label(i, j, k)).unwrap(),
                        _ => 0,
                    };
                    assert_eq!(found[x + nx * (y + ny * z)], expected, "{x} {y} {z}");
                }
            }
        }
    }
}
