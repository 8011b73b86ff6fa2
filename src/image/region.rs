//! The region: the bounding box of the object and one voxel more on each side, as rows of labels
//! from which the oracle is built.

use glam::DVec3;
use rayon::prelude::*;

use crate::image::{LabelImage, numbered_voxels};
use crate::memory::zeroed_huge;
use crate::{Error, Result};

/// Where a region lies in its image.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// The image coordinates of its first voxel; may be -1.
    pub first: [isize; 3],
    /// Voxels along each axis; at least three.
    pub dims: [usize; 3],
}

impl Region {
    /// The object's bounding box with one voxel more on each side.
    ///
    /// # Errors
    /// [`Error::EmptyImage`]; [`Error::InvalidArgument`] when its voxels cannot be numbered by u32;
    /// whatever `check` returns.
    pub fn new(image: &LabelImage, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let [nx, ny, _] = image.dims();
        let empty = ([usize::MAX; 3], [0; 3]);
        let join = |a: ([usize; 3], [usize; 3]), b: ([usize; 3], [usize; 3])| {
            ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
        };
        let (low, high) = image
            .ids()
            .par_chunks(nx * ny)
            .enumerate()
            .map(|(z, plane)| {
                check()?;
                let mut bounds = empty;
                for (y, row) in plane.chunks(nx).enumerate() {
                    // Most rows are told apart without looking for where they begin.
                    if row.iter().fold(0, |all, &id| all | id) == 0 {
                        continue;
                    }
                    let left =
                        row.iter().take(bounds.0[0]).position(|&id| id != 0).unwrap_or(bounds.0[0]);
                    let right = row.iter().skip(bounds.1[0] + 1).rposition(|&id| id != 0);
                    let right = right.map_or(bounds.1[0].max(left), |n| n + bounds.1[0] + 1);
                    bounds = join(bounds, ([left, y, z], [right, y, z]));
                }
                Ok(bounds)
            })
            .try_reduce(|| empty, |a, b| Ok(join(a, b)))?;
        if low[0] > high[0] {
            return Err(Error::EmptyImage);
        }
        let dims = [0, 1, 2].map(|a| high[a] - low[a] + 3);
        if numbered_voxels(dims).is_none() {
            return Err(Error::InvalidArgument(format!(
                "the object's box of {dims:?} voxels, one more on each side, is too large: at most \
                 2^32 - 1 voxels"
            )));
        }
        Ok(Self { first: low.map(|c| c as isize - 1), dims })
    }

    /// The image coordinate, along an axis of `count` voxels, of a voxel of the region; `None`
    /// beyond the image.
    #[inline]
    pub fn place(&self, voxel: [usize; 3], axis: usize, count: usize) -> Option<usize> {
        usize::try_from(voxel[axis] as isize + self.first[axis]).ok().filter(|&at| at < count)
    }

    /// A place in the image, in voxels, counted from the region's first voxel.
    #[inline]
    pub fn offset(&self, index: DVec3) -> DVec3 {
        index - DVec3::from(self.first.map(|c| c as f64))
    }

    /// As [`Self::place`], of the nearest voxel in the image.
    #[inline]
    pub fn nearest(&self, voxel: [usize; 3], axis: usize, count: usize) -> usize {
        (voxel[axis] as isize + self.first[axis]).clamp(0, count as isize - 1) as usize
    }
}

/// The dense ids of a region in rows along x, each padded with background to whole words of 64
/// voxels and one more. Its outermost voxels are background.
pub struct Rows {
    region: Region,
    stride: usize,
    ids: Vec<u16>,
}

impl Rows {
    /// Those of a region of `image`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(
        image: &LabelImage,
        region: Region,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let [nx, ny, _] = image.dims();
        let dims = region.dims;
        let stride = Self::stride(dims);
        let mut ids = zeroed_huge(stride * dims[1] * dims[2], "voxels of the label volume")?;
        // All but the region's outermost voxels are in the image.
        let inner = (region.first[0] + 1) as usize;
        let count = dims[0] - 2;
        ids.par_chunks_mut(stride * dims[2]).enumerate().take(dims[1] - 1).skip(1).try_for_each(
            |(j, layer)| {
                check()?;
                let y = (region.first[1] + j as isize) as usize;
                for (k, row) in layer.chunks_mut(stride).enumerate().take(dims[2] - 1).skip(1) {
                    let z = (region.first[2] + k as isize) as usize;
                    row[1..=count]
                        .copy_from_slice(&image.ids()[inner + nx * (y + ny * z)..][..count]);
                }
                Ok(())
            },
        )?;
        Ok(Self { region, stride, ids })
    }

    fn stride(dims: [usize; 3]) -> usize {
        // One voxel more would do; whole vectors are copied faster.
        dims[0].div_ceil(64) * 64 + 16
    }

    /// Bytes that the rows of a region of `dims` voxels take.
    pub(crate) fn bytes(dims: [usize; 3]) -> u64 {
        (size_of::<u16>() * Self::stride(dims)) as u64 * dims[1] as u64 * dims[2] as u64
    }

    pub(crate) fn region(&self) -> &Region {
        &self.region
    }

    pub(crate) fn dims(&self) -> [usize; 3] {
        self.region.dims
    }

    /// Row (j, k) with its padding.
    #[inline]
    pub(crate) fn row(&self, j: usize, k: usize) -> &[u16] {
        &self.ids[(j * self.region.dims[2] + k) * self.stride..][..self.stride]
    }

    /// The rows that bound row (j, k) of cells: corner c of cell i is `rows[c >> 1][i + (c & 1)]`.
    #[inline]
    pub(crate) fn around(&self, j: usize, k: usize) -> [&[u16]; 4] {
        [self.row(j, k), self.row(j + 1, k), self.row(j, k + 1), self.row(j + 1, k + 1)]
    }

    /// About how many voxels each of `labels` ids has: of every fourth voxel along each axis.
    pub(crate) fn rough_counts(&self, labels: usize) -> Vec<u64> {
        const STEP: usize = 4;
        let mut counts = vec![0; labels];
        let [_, ny, nz] = self.dims();
        for j in (0..ny).step_by(STEP) {
            for k in (0..nz).step_by(STEP) {
                self.row(j, k)
                    .iter()
                    .step_by(STEP)
                    .for_each(|&id| counts[usize::from(id)] += (STEP * STEP * STEP) as u64);
            }
        }
        counts
    }
}
