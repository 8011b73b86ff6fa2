//! The region's voxels in the world: where each lies, and which is nearest to a point.

use glam::{DMat3, DVec3};

use super::Frame;
use super::bricks::Bricks;
use super::region::Region;

/// A region of an image as a grid of points, in bricks. Its coordinates are continuous indices:
/// voxel (i, j, k) of the region has its centre at (i, j, k). World distances are those of the
/// spacing, because image axes are orthonormal.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// World to grid coordinates: `to_grid * (p - origin)`.
    to_grid: DMat3,
    to_world: DMat3,
    origin: DVec3,
    /// Distance between voxel centres along each axis.
    pub(crate) spacing: DVec3,
    /// Image index of the first voxel; -1 where the object reaches the border.
    pub(crate) first: [isize; 3],
    /// Coordinates of the last voxel.
    pub(crate) last: DVec3,
    /// How values of voxels lie in memory.
    pub(crate) bricks: Bricks,
}

impl Grid {
    /// That of a region of an image with this frame.
    pub(crate) fn new(frame: &Frame, &Region { first, dims }: &Region) -> Self {
        let spacing = frame.spacing();
        Self {
            to_grid: DMat3::from_diagonal(spacing.recip()) * frame.direction().transpose(),
            to_world: frame.direction() * DMat3::from_diagonal(spacing),
            origin: frame.to_world(DVec3::from(first.map(|c| c as f64))),
            spacing,
            first,
            last: DVec3::from(dims.map(|n| (n - 1) as f64)),
            bricks: Bricks::new(dims),
        }
    }

    /// The coordinates of a point of the world.
    #[inline(always)]
    pub(crate) fn index_at(&self, p: DVec3) -> DVec3 {
        self.to_grid * (p - self.origin)
    }

    /// The point of the world that has these coordinates.
    #[inline(always)]
    pub(crate) fn point_at(&self, x: DVec3) -> DVec3 {
        self.origin + self.to_world * x
    }

    /// The nearest point in the box of voxel centres; 0 where x is no number.
    #[inline(always)]
    pub(crate) fn inside(&self, x: DVec3) -> DVec3 {
        x.max(DVec3::ZERO).min(self.last)
    }

    /// The cell, named by its first corner, that holds a point of the box of voxel centres.
    #[inline(always)]
    pub(crate) fn cell(&self, x: DVec3) -> [usize; 3] {
        // Rounded, not cut off: a point on a face is in either cell. A region has at least three
        // voxels along each axis.
        (x - 0.5).max(DVec3::ZERO).min(self.last - 1.0).to_array().map(rounded)
    }

    /// The voxel that holds a point of the region.
    #[inline(always)]
    pub(crate) fn voxel(&self, x: DVec3) -> [usize; 3] {
        x.min(self.last).to_array().map(rounded)
    }

    /// Corners of an axis-aligned box of the world that holds the box of voxel centres.
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        self.bounds_of(DVec3::ZERO, self.last)
    }

    /// Corners of an axis-aligned box of the world that holds a box of grid coordinates.
    pub(crate) fn bounds_of(&self, lower: DVec3, upper: DVec3) -> [DVec3; 2] {
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for corner in 0..8 {
            let x = DVec3::from(
                [0, 1, 2].map(|a| if corner >> a & 1 == 1 { upper[a] } else { lower[a] }),
            );
            let p = self.point_at(x);
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        bounds
    }
}

/// The integer nearest to x in [0, 2^31], even on a tie. The sum with 2^52 has it in its low bits;
/// several times faster than a conversion that saturates.
#[inline(always)]
fn rounded(x: f64) -> usize {
    const SHIFT: f64 = (1_u64 << 52) as f64;
    (x + SHIFT).to_bits() as u32 as usize
}
