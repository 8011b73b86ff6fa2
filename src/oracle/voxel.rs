//! What the oracle keeps of a voxel and of the cell between it and the next voxel along each axis, in four bytes: the voxel's label, and in a word about the cell the number of its
//! rings or, for a mixed cell, which corners have the label of the first one, and whether all others have one other label.
//!
//! One look at this record tells a cell's label, or which two labels it has, so that the labels of all eight corners are hardly ever read.
//!
//! Built in one pass over the rows of the region. Some nanoseconds per voxel.

use rayon::prelude::*;

use super::{
    border::Border,
    bricks::Bricks,
    cells::Cells,
    indicator::{self, Corners},
    region::Rows,
    weights::{Sampling, Tally},
};
use crate::{Result, memory::filled};

/// Rings are counted up to this.
const MOST_RINGS: u16 = 3;

/// A voxel and its cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// Dense id of the voxel's label; of a uniform cell too.
    pub(super) id: u16,
    /// The lowest two bits have the rings, 0 for a mixed cell. Above, for a mixed one: a bit "two labels", and in the upper byte a bit
    /// for each corner that has the label of the first.
    cell: u16,
}

impl Voxel {
    const TWO: u16 = 1 << 2;

    fn mixed(id: u16, first: u32, is_two: bool) -> Self {
        Self { id, cell: (first << 8) as u16 | if is_two { Self::TWO } else { 0 } }
    }

    /// Rings of cells of one label around the point's cell, that cell being one; 0 for a mixed cell, at most [`MOST_RINGS`].
    #[inline(always)]
    pub(super) fn rings(self) -> u16 {
        self.cell & 3
    }

    /// Of a mixed cell: a bit for each corner that has the label of the first.
    #[inline(always)]
    pub(super) fn first_corners(self) -> u32 {
        u32::from(self.cell >> 8)
    }

    /// Of a mixed cell: whether all other corners have one label.
    #[inline(always)]
    pub(super) fn is_two(self) -> bool {
        self.cell & Self::TWO != 0
    }
}

/// The records of a region, in the bricked layout, and what is counted in its mixed cells for the weights of labels, if that is wanted.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub(super) fn records<'a>(
    rows: &Rows,
    mixed: &Cells,
    weighing: Option<(&'a Sampling, &Border)>,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<(Vec<Voxel>, Option<Tally<'a>>)> {
    let beside = mixed.dilated(check)?;
    let near = beside.dilated(check)?;
    let bricks = Bricks::new(rows.dims());
    let [nx, ny, nz] = bricks.dims();
    let mut voxels = filled(bricks.len(), Voxel::default(), "voxels of the label volume", check)?;
    let none = || weighing.map(|(sampling, _)| Tally::new(sampling));
    let layers = voxels.par_chunks_mut(bricks.layer()).enumerate();
    let tally = layers.try_fold(none, |mut tally, (layer, out)| {
        for j in (layer * Bricks::EDGE..ny).take(Bricks::EDGE) {
            check()?;
            for k in 0..nz {
                let at = bricks.y(j) + bricks.z(k) - layer * bricks.layer();
                let sets = [mixed, &beside, &near].map(|set| set.row(j, k));
                for (i, &id) in rows.row(j, k)[..nx].iter().enumerate() {
                    // Each set holds the one before.
                    let held: u64 = sets.iter().map(|row| row[i / 64] >> (i % 64) & 1).sum();
                    out[at + bricks.x(i)] = Voxel { id, cell: MOST_RINGS - held as u16 };
                }
                for (w, &mixed_word) in sets[0].iter().enumerate() {
                    if mixed_word == 0 {
                        continue;
                    }
                    let around = rows.around(j, k);
                    let mut rest = mixed_word;
                    while rest != 0 {
                        let i = 64 * w + rest.trailing_zeros() as usize;
                        rest &= rest - 1;
                        let ids: Corners = std::array::from_fn(|c| around[c >> 1][i + (c & 1)]);
                        let first = indicator::corners_of(&ids, ids[0]);
                        let other = ids[(!first).trailing_zeros() as usize];
                        let is_two = first | indicator::corners_of(&ids, other) == 0xff;
                        out[at + bricks.x(i)] = Voxel::mixed(ids[0], first, is_two);
                        if let (Some(tally), Some((_, border))) = (&mut tally, weighing) {
                            tally.add(border, [i, j, k], &ids)?;
                        }
                    }
                }
            }
        }
        Ok(tally)
    });
    let tally = tally.try_reduce(none, |a, b| match (a, b) {
        (Some(a), Some(b)) => a.merge(b).map(Some),
        (a, b) => Ok(a.or(b)),
    })?;
    Ok((voxels, tally))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Frame, LabelImage};
    use crate::oracle::region::Region;

    /// Few voxels of other labels, at both ends of words too: rings by definition.
    #[test]
    fn records_are_those_of_the_definition() {
        let mut ids = vec![0; 68 * 12 * 11];
        for ([i, j, k], id) in
            [([4, 3, 3], 1), ([40, 0, 5], 1), ([41, 0, 6], 2), ([61, 2, 2], 1), ([67, 11, 10], 2), ([0, 0, 0], 1)]
        {
            ids[i + 68 * (j + 12 * k)] = id;
        }
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let image = LabelImage::from_ids([68, 12, 11], frame, ids, vec![0, 5, 6]).unwrap();
        let check: &(dyn Fn() -> Result<()> + Sync) = &|| Ok(());
        let region = Region::new(&image, check).unwrap();
        let rows = Rows::new(&image, &region, check).unwrap();
        let cells = Cells::mixed(&rows, check).unwrap();
        let (voxels, _) = records(&rows, &cells, None, check).unwrap();
        let dims = rows.dims();
        let bricks = Bricks::new(dims);
        let id = |at: [usize; 3]| rows.row(at[1], at[2])[at[0]];
        let corners =
            |cell: [usize; 3]| -> Corners { std::array::from_fn(|c| id([0, 1, 2].map(|a| cell[a] + (c >> a & 1)))) };
        let mut mixed = Vec::new();
        let mut all = Vec::new();
        for k in 0..dims[2] - 1 {
            for j in 0..dims[1] - 1 {
                for i in 0..dims[0] - 1 {
                    let ids = corners([i, j, k]);
                    all.push([i, j, k]);
                    if ids.iter().any(|&other| other != ids[0]) {
                        mixed.push([i, j, k]);
                    }
                }
            }
        }
        for cell in all {
            let (voxel, ids) = (voxels[bricks.index(cell[0], cell[1], cell[2])], corners(cell));
            let steps = |m: &[usize; 3]| (0..3).map(|a| m[a].abs_diff(cell[a])).max().unwrap() as u16;
            let rings = mixed.iter().map(steps).min().unwrap().min(MOST_RINGS);
            assert_eq!((voxel.id, voxel.rings()), (ids[0], rings), "{cell:?}");
            if rings == 0 {
                assert_eq!(voxel.first_corners(), indicator::corners_of(&ids, ids[0]));
                let mut labels = ids.to_vec();
                labels.sort_unstable();
                labels.dedup();
                assert_eq!(voxel.is_two(), labels.len() == 2, "{cell:?}");
            }
        }
    }
}
