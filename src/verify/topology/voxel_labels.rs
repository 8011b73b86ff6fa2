//! Which label of the mesh the centre of each voxel has.
//!
//! Each tet goes through the rows of voxels that it may hold centres of, and clips each to its four
//! planes. In floating point: a centre on a facet, but for rounding, belongs to both sides, and has
//! the larger id. So no centre is left out, and the result does not depend on the number of
//! threads. Linear in the tets and in the voxels.

use std::sync::atomic::{AtomicU16, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::geometry::vectors::vectorized;
use crate::image::LabelImage;
use crate::image::region::Region;
use crate::memory::atomic::atomic;
use crate::memory::zeroed;
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
        let [from, to] = [from, to].map(|at| at.map(|c| c as usize));
        add_clipped(self, id, &corners.points.map(|p| self.region.offset(p)), [from, to]);
    }
}

/// So many rows are clipped at a time.
const ROWS: usize = 4;

vectorized! {
    fn add_clipped[](
        labels: &VoxelLabels<'_>,
        id: u16,
        corners: &[DVec3; 4],
        bounds: [[usize; 3]; 2]
    ) = add_rows;
    add_avx2, add_portably
}

/// Adds a tet whose box holds the voxels from one to another.
#[inline(always)]
fn add_rows(
    labels: &VoxelLabels<'_>,
    id: u16,
    corners: &[DVec3; 4],
    [first, last]: [[usize; 3]; 2],
) {
    // Taken from a corner, so that rounding does not depend on where the tet lies.
    let corner = corners[0];
    let arms = corners.map(|at| at - corner);
    let reach = arms.iter().fold(0.0_f64, |reach, arm| reach.max(arm.abs().max_element()));
    // The planes are moved out by more than rounding: at most 24 products of three arms, or twelve
    // of two differences of arms, each up to twice the reach, and one arm. Each is rounded some
    // times, to 200 units in all.
    let error = 256.0 * f64::EPSILON * reach * reach * reach;
    let planes = planes_from_first(&arms, error).map(|(normal, offset)| Plane {
        normal,
        offset: offset + error,
        per_x: if normal.x == 0.0 { f64::INFINITY } else { 1.0 / normal.x },
    });
    let [nx, ny, _] = labels.region.dims;
    let [from_x, to_x] = [first[0], last[0]].map(|x| x as f64);
    for z in first[2]..=last[2] {
        let at_z = z as f64 - corner.z;
        for y in (first[1]..=last[1]).step_by(ROWS) {
            let (mut from, mut to) = ([from_x; ROWS], [to_x; ROWS]);
            for &Plane { normal, offset, per_x } in &planes {
                let of_row = normal.z * at_z + offset;
                // Of a row in a plane this is no number, as 0 is divided by 0: nothing is clipped.
                let crossing = |row: usize| {
                    let at_y = (y + row) as f64 - corner.y;
                    corner.x - (normal.y * at_y + of_row) * per_x
                };
                if normal.x >= 0.0 {
                    for (row, from) in from.iter_mut().enumerate() {
                        let at = crossing(row);
                        *from = if at > *from { at } else { *from };
                    }
                } else {
                    for (row, to) in to.iter_mut().enumerate() {
                        let at = crossing(row);
                        *to = if at < *to { at } else { *to };
                    }
                }
            }
            let rows = from.into_iter().zip(to).take(last[1] + 1 - y).enumerate();
            for (row, (from, to)) in rows.filter(|(_, (from, to))| from <= to) {
                // Neither is negative here. Rounded, the first may come just after the last.
                let (from, to) = (rounded_up(from) as usize, to as usize);
                // Relaxed: read when all is done.
                labels.found[nx * (y + row + ny * z)..][from..=to]
                    .iter()
                    .for_each(|voxel| _ = voxel.fetch_max(id, Relaxed));
            }
        }
    }
}

/// A plane of a tet's facet.
struct Plane {
    /// To the inside.
    normal: DVec3,
    /// What is to be added to products with the normal, so that they are not negative inside.
    offset: f64,
    /// One over the normal's x; infinite where that is 0.
    per_x: f64,
}

/// The corners of a tet in voxels of the image, and those of the box around it.
pub(super) struct Corners {
    pub points: [DVec3; 4],
    pub bounds: [DVec3; 2],
}

impl Corners {
    #[inline]
    pub fn of(points: [DVec3; 4]) -> Self {
        let [a, b, c, d] = points;
        Self { points, bounds: [a.min(b).min(c).min(d), a.max(b).max(c).max(d)] }
    }
}

/// Calls `visit` for each tet whose label is not 0, with the label's id.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
pub(super) fn visit_tets(
    mesh: &TetMesh,
    image: &LabelImage,
    monitor: &Monitor<'_>,
    visit: impl Fn(u16, &Corners) + Sync,
) -> Result<()> {
    // A vertex belongs to more than twenty tets.
    let mut at: Vec<[f64; 3]> = zeroed(mesh.points.len(), "vertices of the mesh")?;
    at.par_chunks_mut(CHUNK).zip(mesh.points.par_chunks(CHUNK)).try_for_each(|(at, points)| {
        monitor.advance(0)?;
        for (at, &point) in at.iter_mut().zip(points) {
            *at = image.frame().to_index(DVec3::from(point)).to_array();
        }
        Ok(())
    })?;
    mesh.tets.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, tets)| {
        monitor.advance(tets.len())?;
        // Tets mostly have the label of the one before.
        let mut id_of_label = (0, Some(0));
        for (tet, &label) in tets.iter().zip(&mesh.labels[chunk * CHUNK..]) {
            if label != id_of_label.0 {
                id_of_label = (label, image.id_of(label));
            }
            if let Some(id) = id_of_label.1.filter(|&id| id != 0) {
                visit(id, &Corners::of(tet.map(|v| DVec3::from(at[v as usize]))));
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

/// The planes of a tet whose first corner is the origin, as [`planes_of`] has them, but for their
/// order and rounding; `error` bounds that of a product of three arms.
fn planes_from_first(arms: &[DVec3; 4], error: f64) -> [(DVec3, f64); 4] {
    let [_, a, b, c] = *arms;
    let normals = [b.cross(c), c.cross(a), a.cross(b)];
    let volume = a.dot(normals[0]);
    if volume.abs() <= error {
        return planes_of(arms);
    }
    let [p, q, r] = normals.map(|normal| normal * volume.signum());
    // Three lead through the origin. With the fourth normal all add up to nothing.
    [(p, 0.0), (q, 0.0), (r, 0.0), (-(p + q + r), volume.abs())]
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Frame;
    use crate::mesh::testing;

    proptest! {
        /// Those of a tet at the origin are on the same side of a point as those of any tet.
        #[test]
        fn both_ways_to_planes_lead_to_the_same(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0..2.0_f64)),
            p in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let [a, b, c] = corners.map(DVec3::from);
            let arms = [DVec3::ZERO, a, b, c];
            let inside = |planes: [(DVec3, f64); 4]| {
                let of = planes.map(|(normal, offset)| normal.dot(DVec3::from(p)) + offset);
                of.into_iter().fold(f64::INFINITY, f64::min)
            };
            let [found, expected] = [planes_from_first(&arms, 1e-12), planes_of(&arms)].map(inside);
            prop_assert!((found - expected).abs() < 1e-12, "{} instead of {}", found, expected);
        }
    }

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
