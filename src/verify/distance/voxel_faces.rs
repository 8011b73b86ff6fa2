//! The interfaces of a label image: the faces between voxels of different label, everything outside
//! the grid counting as label 0.
//!
//! Coordinates here are local: image axes, world units, voxel (i, j, k) fills [i, i + 1] x [j, j +
//! 1] x [k, k + 1] times the spacing. The step from world to local is an isometry, so distances are
//! world distances.
//!
//! A face belongs to the cell on its upper side; there is one more cell along each axis than there
//! are voxels. One byte per cell holds which of its three lower faces are interfaces; bricks of 8 x
//! 8 x 8 cells tell where there are any. Within half a voxel of an interface the eight voxels
//! around the nearest corner of the grid tell the distance (`grid_corners`). Elsewhere a query
//! looks at the sides of the voxel that holds the point, and mostly ends there, since a mesh lies
//! close to its interfaces; then at the cells of the ball that can still hold something nearer;
//! only when that ball is large does it search brick by brick, in growing shells. A query may ask
//! for faces of one label alone.
//!
//! Read-only after `new`, so any number of threads may ask. Linear in the voxels to build, layer of
//! bricks by layer of bricks in parallel.

use glam::DVec3;
use rayon::prelude::*;

use super::grid_corners::Corners;
use crate::Result;
use crate::image::LabelImage;
use crate::memory::zeroed;
use crate::monitor::Monitor;

/// Cells along each axis of a brick.
pub(crate) const BRICK: usize = 8;

/// An interface face: the lower face along `axis` of `cell`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Face {
    pub cell: [usize; 3],
    pub axis: usize,
}

/// The interface faces of an image.
pub(crate) struct VoxelFaces<'i> {
    image: &'i LabelImage,
    /// Cells along each axis: voxels + 1.
    dims: [usize; 3],
    spacing: DVec3,
    per_spacing: DVec3,
    /// Of the faces across each axis.
    half_diagonals: [f64; 3],
    /// Bit `axis` of `masks[i + dims[0] * (j + dims[1] * k)]`: the lower face along `axis` is an
    /// interface.
    masks: Vec<u8>,
    brick_dims: [usize; 3],
    bricks: Vec<bool>,
}

impl<'i> VoxelFaces<'i> {
    /// Collects the faces of `image`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], [`Error::Cancelled`].
    pub fn new(image: &'i LabelImage, monitor: &Monitor<'_>) -> Result<Self> {
        let voxels = image.dims();
        let dims = voxels.map(|n| n + 1);
        let brick_dims = dims.map(|n| n.div_ceil(BRICK));
        let cells = dims[0] * dims[1] * dims[2];
        let mut masks: Vec<u8> = zeroed(cells, "cells of voxel faces")?;
        let mut bricks =
            zeroed(brick_dims[0] * brick_dims[1] * brick_dims[2], "bricks of voxel faces")?;
        let row_of = |j: usize, k: usize| -> &[u16] {
            if j < voxels[1] && k < voxels[2] {
                let start = voxels[0] * (j + voxels[1] * k);
                &image.ids()[start..start + voxels[0]]
            } else {
                &[]
            }
        };
        let layers = masks
            .par_chunks_mut(dims[0] * dims[1] * BRICK)
            .zip(bricks.par_chunks_mut(brick_dims[0] * brick_dims[1]));
        layers.enumerate().try_for_each(|(layer, (masks, bricks))| {
            for (row, cells) in masks.chunks_exact_mut(dims[0]).enumerate() {
                let (j, k) = (row % dims[1], layer * BRICK + row / dims[1]);
                if j == 0 {
                    monitor.advance(0)?;
                }
                // Below 0 wraps to an index past the end, which is outside just as well.
                fill_row(
                    cells,
                    row_of(j, k),
                    row_of(j.wrapping_sub(1), k),
                    row_of(j, k.wrapping_sub(1)),
                );
                let bricks = &mut bricks[brick_dims[0] * (j / BRICK)..];
                for (brick, cells) in bricks.iter_mut().zip(cells.chunks(BRICK)) {
                    *brick |= cells.iter().any(|&mask| mask != 0);
                }
            }
            Ok(())
        })?;
        let spacing = image.frame().spacing();
        let half_diagonals =
            [0, 1, 2].map(|axis| 0.5 * spacing[(axis + 1) % 3].hypot(spacing[(axis + 2) % 3]));
        Ok(Self {
            image,
            dims,
            spacing,
            per_spacing: 1.0 / spacing,
            half_diagonals,
            masks,
            brick_dims,
            bricks,
        })
    }

    /// Bytes for an image of `voxels` along each axis.
    pub fn bytes(voxels: [usize; 3]) -> u64 {
        voxels.iter().map(|&n| n as u64 + 1).product()
    }

    /// Cells along each axis; one more than voxels.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Bricks along each axis.
    pub fn brick_dims(&self) -> [usize; 3] {
        self.brick_dims
    }

    /// Whether a brick, x fastest, has any faces.
    pub fn has_faces(&self, brick: usize) -> bool {
        self.bricks[brick]
    }

    /// Which of its three lower faces a cell has: a bit for each axis.
    #[inline]
    pub fn mask(&self, [i, j, k]: [usize; 3]) -> u8 {
        self.masks[i + self.dims[0] * (j + self.dims[1] * k)]
    }

    /// The label id of a voxel; 0 outside of the image.
    #[inline]
    pub fn id(&self, [i, j, k]: [usize; 3]) -> u16 {
        let [nx, ny, nz] = self.image.dims();
        if i < nx && j < ny && k < nz { self.image.ids()[i + nx * (j + ny * k)] } else { 0 }
    }

    /// Distance between planes of the grid along each axis.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// The smallest spacing of the image.
    pub fn smallest_spacing(&self) -> f64 {
        self.spacing.min_element()
    }

    /// Area of a face.
    pub fn area(&self, face: Face) -> f64 {
        self.spacing[(face.axis + 1) % 3] * self.spacing[(face.axis + 2) % 3]
    }

    /// Half the diagonal of a face.
    pub fn half_diagonal(&self, face: Face) -> f64 {
        self.half_diagonals[face.axis]
    }

    /// Centre of a face.
    pub fn centre(&self, face: Face) -> DVec3 {
        let mut index = DVec3::from(face.cell.map(|i| i as f64 + 0.5));
        index[face.axis] -= 0.5;
        index * self.spacing
    }

    /// The corners of the grid that a face has.
    pub fn corner_cells(&self, face: Face) -> [[usize; 3]; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(u, v)| {
            let mut cell = face.cell;
            cell[(face.axis + 1) % 3] += u;
            cell[(face.axis + 2) % 3] += v;
            cell
        })
    }

    /// Where a corner of the grid is.
    pub fn corner(&self, at: [usize; 3]) -> DVec3 {
        DVec3::from(at.map(|i| i as f64)) * self.spacing
    }

    /// Corners of a face.
    #[cfg(test)]
    pub fn corners(&self, face: Face) -> [DVec3; 4] {
        self.corner_cells(face).map(|at| self.corner(at))
    }

    /// Squared distance from `p` to a face.
    pub fn distance_squared(&self, face: Face, p: DVec3) -> f64 {
        (0..3)
            .map(|axis| {
                let low = face.cell[axis] as f64 * self.spacing[axis];
                let high = low + if axis == face.axis { 0.0 } else { self.spacing[axis] };
                outside(p[axis], low, high).powi(2)
            })
            .sum()
    }

    /// The voxels on the two sides of a face, below and above; `None` outside the image.
    pub fn voxels(&self, face: Face) -> [Option<[usize; 3]>; 2] {
        let inside =
            |cell: [usize; 3]| (0..3).all(|axis| cell[axis] + 1 < self.dims[axis]).then_some(cell);
        let below = face.cell[face.axis].checked_sub(1).map(|i| {
            let mut cell = face.cell;
            cell[face.axis] = i;
            cell
        });
        [below.and_then(inside), inside(face.cell)]
    }

    /// Whether label id `id` is on one side of a face.
    pub fn touches(&self, face: Face, id: u16) -> bool {
        let [nx, ny, _] = self.image.dims();
        let id_at = |[i, j, k]: [usize; 3]| self.image.ids()[i + nx * (j + ny * k)];
        self.voxels(face).into_iter().any(|voxel| voxel.map_or(0, id_at) == id)
    }

    /// What tells the distance near corners of the grid.
    pub fn corners_of_grid(&self) -> Corners<'i> {
        Corners::new(self.image)
    }

    /// The face nearest to `p` and its squared distance; `start` is one thought to be near and
    /// changes only the time taken. `None` if the image has no interfaces.
    pub fn nearest(&self, p: DVec3, start: Option<Face>) -> Option<(Face, f64)> {
        self.nearest_where(p, start, |_| true)
    }

    /// The same among the faces with label id `id` on one side; so has `start`.
    pub fn nearest_of(&self, id: u16, p: DVec3, start: Option<Face>) -> Option<(Face, f64)> {
        self.nearest_where(p, start, |face| self.touches(face, id))
    }

    fn nearest_where(
        &self,
        p: DVec3,
        start: Option<Face>,
        wanted: impl Fn(Face) -> bool,
    ) -> Option<(Face, f64)> {
        let mut best = start
            .map_or((None, f64::INFINITY), |face| (Some(face), self.distance_squared(face, p)));
        if self.scan_voxel(p, &wanted, &mut best) {
            return best.0.map(|face| (face, best.1));
        }
        let near = 1.5 * self.spacing.max_element();
        if best.1 > near * near {
            self.scan(p, self.spacing, &wanted, &mut best);
        }
        if best.1 <= 4.0 * near * near {
            self.scan(p, DVec3::splat(best.1.sqrt()), &wanted, &mut best);
        } else {
            self.scan_bricks(p, &wanted, &mut best);
        }
        best.0.map(|face| (face, best.1))
    }

    /// Looks at the six sides of the voxel that holds `p`. Whether nothing can be nearer: what is
    /// not inside the voxel is no nearer than its nearest side.
    #[inline]
    fn scan_voxel(
        &self,
        p: DVec3,
        wanted: &impl Fn(Face) -> bool,
        best: &mut (Option<Face>, f64),
    ) -> bool {
        let index = (p * self.per_spacing).floor();
        let voxels = DVec3::from(self.dims.map(|n| (n - 1) as f64));
        if !(index.cmpge(DVec3::ZERO).all() && index.cmplt(voxels).all()) {
            return false;
        }
        let cell = [index.x as usize, index.y as usize, index.z as usize];
        let at = cell[0] + self.dims[0] * (cell[1] + self.dims[1] * cell[2]);
        let steps = [1, self.dims[0], self.dims[0] * self.dims[1]];
        let mut wall = f64::INFINITY;
        for axis in 0..3 {
            let low = index[axis] * self.spacing[axis];
            let high = (index[axis] + 1.0) * self.spacing[axis];
            for (upper, plane) in [(0, low), (1, high)] {
                let distance = (p[axis] - plane).powi(2);
                wall = wall.min(distance);
                if self.masks[at + upper * steps[axis]] >> axis & 1 == 1 && distance < best.1 {
                    let mut face = Face { cell, axis };
                    face.cell[axis] += upper;
                    if wanted(face) {
                        *best = (Some(face), distance);
                    }
                }
            }
        }
        best.1 <= wall
    }

    /// Looks at all cells that come within `reach` of `p` along every axis.
    fn scan(
        &self,
        p: DVec3,
        reach: DVec3,
        wanted: &impl Fn(Face) -> bool,
        best: &mut (Option<Face>, f64),
    ) {
        let (low, high) = ((p - reach) / self.spacing, (p + reach) / self.spacing);
        let bounds = [0, 1, 2].map(|axis| {
            (cell_below(low[axis], self.dims[axis]), cell_below(high[axis], self.dims[axis]))
        });
        self.scan_cells(p, bounds, wanted, best);
    }

    /// Looks at the cells between `bounds` along each axis, both included.
    fn scan_cells(
        &self,
        p: DVec3,
        bounds: [(usize, usize); 3],
        wanted: &impl Fn(Face) -> bool,
        best: &mut (Option<Face>, f64),
    ) {
        // Squared distance along one axis to a cell, and to the plane of its lower face.
        let along = |axis: usize, i: usize| {
            let low = i as f64 * self.spacing[axis];
            (outside(p[axis], low, low + self.spacing[axis]).powi(2), (p[axis] - low).powi(2))
        };
        for k in bounds[2].0..=bounds[2].1 {
            let z = along(2, k);
            if z.0 >= best.1 {
                continue;
            }
            for j in bounds[1].0..=bounds[1].1 {
                let y = along(1, j);
                if y.0 + z.0 >= best.1 {
                    continue;
                }
                let row = self.dims[0] * (j + self.dims[1] * k);
                for i in bounds[0].0..=bounds[0].1 {
                    let mask = self.masks[row + i];
                    if mask == 0 {
                        continue;
                    }
                    let x = along(0, i);
                    for (axis, distance) in
                        [x.1 + y.0 + z.0, x.0 + y.1 + z.0, x.0 + y.0 + z.1].into_iter().enumerate()
                    {
                        let face = Face { cell: [i, j, k], axis };
                        if mask >> axis & 1 == 1 && distance < best.1 && wanted(face) {
                            *best = (Some(face), distance);
                        }
                    }
                }
            }
        }
    }

    /// Looks at all bricks in shells around the one that holds `p`, until the next shell is too
    /// far.
    fn scan_bricks(
        &self,
        p: DVec3,
        wanted: &impl Fn(Face) -> bool,
        best: &mut (Option<Face>, f64),
    ) {
        let size = self.spacing * BRICK as f64;
        let centre = [0, 1, 2].map(|axis| cell_below(p[axis] / size[axis], self.brick_dims[axis]));
        for shell in 0.. {
            let range = [0, 1, 2].map(|axis| {
                (
                    centre[axis].saturating_sub(shell),
                    (centre[axis] + shell).min(self.brick_dims[axis] - 1),
                )
            });
            for k in range[2].0..=range[2].1 {
                for j in range[1].0..=range[1].1 {
                    let inner = k.abs_diff(centre[2]) < shell && j.abs_diff(centre[1]) < shell;
                    for i in range[0].0..=range[0].1 {
                        if inner && i.abs_diff(centre[0]) < shell {
                            continue;
                        }
                        self.scan_brick(p, [i, j, k], wanted, best);
                    }
                }
            }
            // Where the shell touches the rim of the grid there is nothing beyond.
            let beyond = (0..3).fold(f64::INFINITY, |nearest, axis| {
                let (low, high) = range[axis];
                let below =
                    if low == 0 { f64::INFINITY } else { p[axis] - low as f64 * size[axis] };
                let above = if high + 1 == self.brick_dims[axis] {
                    f64::INFINITY
                } else {
                    (high + 1) as f64 * size[axis] - p[axis]
                };
                nearest.min(below).min(above)
            });
            if beyond.is_infinite() || beyond > 0.0 && beyond * beyond >= best.1 {
                return;
            }
        }
    }

    fn scan_brick(
        &self,
        p: DVec3,
        brick: [usize; 3],
        wanted: &impl Fn(Face) -> bool,
        best: &mut (Option<Face>, f64),
    ) {
        if !self.bricks[brick[0] + self.brick_dims[0] * (brick[1] + self.brick_dims[1] * brick[2])]
        {
            return;
        }
        let low = DVec3::from(brick.map(|i| (i * BRICK) as f64)) * self.spacing;
        let high = low + self.spacing * BRICK as f64;
        if p.distance_squared(p.clamp(low, high)) >= best.1 {
            return;
        }
        let bounds = [0, 1, 2].map(|axis| {
            (brick[axis] * BRICK, ((brick[axis] + 1) * BRICK).min(self.dims[axis]) - 1)
        });
        self.scan_cells(p, bounds, wanted, best);
    }
}

/// The masks of one row of cells, from the ids of its voxels and of the rows below it along y and
/// z; rows outside the image are empty.
fn fill_row(masks: &mut [u8], own: &[u16], below_y: &[u16], below_z: &[u16]) {
    let at = |row: &[u16], i: usize| row.get(i).copied().unwrap_or(0);
    let mut left = 0;
    for (i, mask) in masks.iter_mut().enumerate() {
        let id = at(own, i);
        *mask = u8::from(id != left)
            | u8::from(id != at(below_y, i)) << 1
            | u8::from(id != at(below_z, i)) << 2;
        left = id;
    }
}

/// How far `x` is outside [low, high].
#[inline]
fn outside(x: f64, low: f64, high: f64) -> f64 {
    (low - x).max(x - high).max(0.0)
}

/// The cell, of `n`, that holds index coordinate `x`, or the first or last one. (`as` saturates.)
#[inline]
fn cell_below(x: f64, n: usize) -> usize {
    (x.max(0.0) as usize).min(n - 1)
}

#[cfg(test)]
impl VoxelFaces<'_> {
    /// All interface faces of the image.
    pub(super) fn all(&self) -> Vec<Face> {
        let [nx, ny, nz] = self.dims();
        let cells = (0..nx * ny * nz).map(|at| [at % nx, at / nx % ny, at / (nx * ny)]);
        let of = |cell| {
            (0..3)
                .filter(move |axis| self.mask(cell) >> axis & 1 == 1)
                .map(move |axis| Face { cell, axis })
        };
        cells.flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Frame;
    use crate::mesh::testing;

    #[test]
    fn one_voxel_has_six_faces() {
        let image =
            testing::image([1, 1, 1], Frame::axis_aligned([1.0, 2.0, 3.0]).unwrap(), |_, _, _| 7);
        let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
        let all = faces.all();
        assert_eq!(all.len(), 6);
        assert_eq!(all.iter().map(|&f| faces.area(f)).sum::<f64>(), 22.0);
        assert_eq!(faces.centre(Face { cell: [1, 0, 0], axis: 0 }), DVec3::new(1.0, 1.0, 1.5));
        assert!(faces.corners(Face { cell: [0, 1, 0], axis: 1 }).iter().all(|c| c.y == 2.0));
    }

    #[test]
    fn empty_image_has_none() {
        let image = testing::image([3, 2, 1], Frame::axis_aligned([1.0; 3]).unwrap(), |_, _, _| 0);
        let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
        assert!(faces.nearest(DVec3::ONE, None).is_none());
    }

    #[test]
    fn equal_tables_on_any_number_of_threads() {
        let image =
            testing::image([19, 18, 21], Frame::axis_aligned([1.0; 3]).unwrap(), |i, j, k| {
                i32::from(i * 7 + j * j + k * 3 > 300 && k > 9)
            });
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let faces = pool.install(|| VoxelFaces::new(&image, &Monitor::silent()).unwrap());
            (faces.masks, faces.bricks)
        };
        let (masks, bricks) = on(1);
        assert!(bricks.contains(&true) && bricks.contains(&false));
        assert_eq!((masks, bricks), on(3));
    }

    proptest! {
        #[test]
        fn nearest_against_all(
            seed in prop::collection::vec(0u8..40, 30 * 5 * 11),
            p in [-20.0..60.0f64, -20.0..30.0, -20.0..60.0],
            spacing in prop::sample::select(vec![[1.0, 1.0, 1.0], [0.5, 0.7, 4.0]]),
            pick in 0usize..10_000,
        ) {
            let image =
                testing::image([30, 5, 11], Frame::axis_aligned(spacing).unwrap(), |i, j, k| {
                    // Sparse, so that both kinds of search are met.
                    let seed = seed[i + 30 * (j + 5 * k)];
                    if seed < 2 { 1 + i32::from(seed) } else { 0 }
                });
            let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
            let all = faces.all();
            let p = DVec3::from(p);
            let expected =
                all.iter().map(|&f| faces.distance_squared(f, p)).fold(f64::INFINITY, f64::min);
            let start = all.get(pick % all.len().max(1)).copied().filter(|_| pick % 2 == 0);
            match faces.nearest(p, start) {
                Some((face, distance)) => {
                    prop_assert!((distance - expected).abs() <= 1e-12 * expected.max(1.0));
                    prop_assert_eq!(faces.distance_squared(face, p), distance);
                }
                None => prop_assert!(all.is_empty()),
            }
            for id in 0..image.labels().len() as u16 {
                let of_label = || all.iter().copied().filter(|&f| faces.touches(f, id));
                let expected =
                    of_label().map(|f| faces.distance_squared(f, p)).fold(f64::INFINITY, f64::min);
                let start = start.filter(|&f| faces.touches(f, id));
                let found = faces.nearest_of(id, p, start);
                prop_assert_eq!(found.is_some(), expected.is_finite());
                prop_assert!(found.is_none_or(|(f, d)| faces.touches(f, id)
                    && (d - expected).abs() <= 1e-12 * expected.max(1.0)));
            }
        }

    }
}
