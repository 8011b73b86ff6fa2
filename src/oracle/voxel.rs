//! What the oracle keeps of a voxel and of the cell between it and the next voxel along each axis, in four bytes: the voxel's label, and in a word about the cell either
//! - *mixed*: which corners have the label of the first one, and whether all others have one other label;
//! - *near*, with one or two rings: where the nearest mixed cell is, as the number of an offset (see [`offsets`]);
//! - *far*, with more: nothing else; the coarse feature transform knows of these cells.
//!
//! One look at this record tells a cell's label, or which two labels it has, so that the labels of all eight corners are hardly ever read.
//!
//! Built in one pass over the rows of the region: mixed cells one by one, near cells 64 at a time, offset by offset from the shortest one on. Some nanoseconds per voxel.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    border::Border,
    cells::{Cells, REACH, for_each_bit},
    indicator::{self, Corners},
    region::Rows,
    weights::{Sampling, Tally},
};
use crate::{Result, distance::Bricks, memory::filled};

/// Rings of a far cell: this many at least.
pub(super) const FAR: u16 = 3;

/// A voxel and its cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// Dense id of the voxel's label; of a uniform cell too.
    pub(super) id: u16,
    /// The lowest two bits have the rings, 0 for a mixed cell. Above, for a near cell: the number of the offset. For a mixed one: a bit "two labels", and in the upper byte a bit
    /// for each corner that has the label of the first.
    cell: u16,
}

impl Voxel {
    const TWO: u16 = 1 << 2;

    fn mixed(id: u16, first: u32, is_two: bool) -> Self {
        Self { id, cell: (first << 8) as u16 | if is_two { Self::TWO } else { 0 } }
    }

    /// Rings of cells of one label around the point's cell, that cell being one; 0 for a mixed cell, at most [`FAR`].
    #[inline(always)]
    pub(super) fn rings(self) -> u16 {
        self.cell & 3
    }

    /// Of a near cell: the number of the offset to the nearest mixed cell.
    #[inline(always)]
    pub(super) fn offset(self) -> usize {
        usize::from(self.cell >> 2)
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

/// Offsets from a near cell to the nearest mixed one, the shortest first: all of up to [`REACH`] cells along each axis that are no longer than the diagonal of two cells. A cell of at most two rings
/// has a mixed cell within two cells along each axis, so one of these offsets leads to a mixed cell, and the first that does leads to the nearest one (but where voxels are so flat
/// that a farther cell along the short axes is nearer).
pub(super) fn offsets(spacing: DVec3) -> Vec<[i8; 3]> {
    let squared = |offset: &[i8; 3]| (DVec3::from(offset.map(f64::from)) * spacing).length_squared();
    let longest = squared(&[FAR as i8 - 1; 3]) * (1.0 + 1e-9);
    let reach = || -REACH as i8..=REACH as i8;
    let all = reach().flat_map(|k| reach().flat_map(move |j| reach().map(move |i| [i, j, k])));
    let mut offsets: Vec<[i8; 3]> = all.filter(|o| *o != [0; 3] && squared(o) <= longest).collect();
    offsets.sort_by(|a, b| squared(a).total_cmp(&squared(b)));
    offsets
}

/// The records of a region, in the bricked layout, and what is counted in its mixed cells for the weights of labels, if that is wanted.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub(super) fn records<'a>(
    rows: &Rows,
    mixed: &Cells,
    offsets: &[[i8; 3]],
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
                for (i, &id) in rows.row(j, k)[..nx].iter().enumerate() {
                    out[at + bricks.x(i)] = Voxel { id, cell: FAR };
                }
                let sets = [mixed, &beside, &near].map(|set| set.row(j, k));
                for w in 0..sets[0].len() {
                    let [mixed_word, beside_word, near_word] = sets.map(|row| row[w]);
                    let valid = if nx - 64 * w < 64 { (1 << (nx - 64 * w)) - 1 } else { u64::MAX };
                    let mut uniform = near_word & !mixed_word & valid;
                    if uniform != 0 {
                        let window = mixed.window(j, k, w);
                        for (n, &offset) in offsets.iter().enumerate() {
                            let found = uniform & window.shifted(offset);
                            if found != 0 {
                                uniform ^= found;
                                for_each_bit(found, |bit| {
                                    let rings = if beside_word >> bit & 1 == 1 { 1 } else { 2 };
                                    out[at + bricks.x(64 * w + bit)].cell = (n as u16) << 2 | rings;
                                });
                                if uniform == 0 {
                                    break;
                                }
                            }
                        }
                    }
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

    /// Few voxels of other labels, at both ends of words too: rings and offsets by definition, in flat voxels as well.
    #[test]
    fn records_are_those_of_the_definition() {
        for spacing in [[1.0; 3], [1.0, 1.0, 1.6], [0.5, 1.0, 3.0]] {
            let mut ids = vec![0; 68 * 12 * 11];
            for ([i, j, k], id) in
                [([4, 3, 3], 1), ([40, 0, 5], 1), ([41, 0, 6], 2), ([61, 2, 2], 1), ([67, 11, 10], 2), ([0, 0, 0], 1)]
            {
                ids[i + 68 * (j + 12 * k)] = id;
            }
            let frame = Frame::axis_aligned(spacing).unwrap();
            let image = LabelImage::from_ids([68, 12, 11], frame, ids, vec![0, 5, 6]).unwrap();
            let check: &(dyn Fn() -> Result<()> + Sync) = &|| Ok(());
            let region = Region::new(&image, check).unwrap();
            let rows = Rows::new(&image, &region, check).unwrap();
            let cells = Cells::mixed(&rows, check).unwrap();
            let offsets = offsets(spacing.into());
            let (voxels, _) = records(&rows, &cells, &offsets, None, check).unwrap();
            let dims = rows.dims();
            let bricks = Bricks::new(dims);
            let id = |at: [usize; 3]| rows.row(at[1], at[2])[at[0]];
            let corners = |cell: [usize; 3]| -> Corners {
                std::array::from_fn(|c| id([0, 1, 2].map(|a| cell[a] + (c >> a & 1))))
            };
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
                let away = |m: &[usize; 3]| [0, 1, 2].map(|a| m[a] as f64 - cell[a] as f64);
                let steps = |m: &[usize; 3]| away(m).iter().fold(0.0, |most: f64, d| most.max(d.abs())) as u16;
                let rings = mixed.iter().map(steps).min().unwrap().min(FAR);
                assert_eq!((voxel.id, voxel.rings()), (ids[0], rings), "{cell:?}");
                match rings {
                    0 => {
                        assert_eq!(voxel.first_corners(), indicator::corners_of(&ids, ids[0]));
                        let mut labels = ids.to_vec();
                        labels.sort_unstable();
                        labels.dedup();
                        assert_eq!(voxel.is_two(), labels.len() == 2, "{cell:?}");
                    }
                    FAR => {}
                    _ => {
                        let offset = offsets[voxel.offset()];
                        let to = [0, 1, 2].map(|a| (cell[a] as isize + isize::from(offset[a])) as usize);
                        assert!(mixed.contains(&to), "{cell:?} {offset:?}");
                        let length = |away: [f64; 3]| (DVec3::from(away) * DVec3::from(spacing)).length();
                        let reach = REACH as u16;
                        let nearest = mixed
                            .iter()
                            .filter(|m| steps(m) <= reach)
                            .map(|m| length(away(m)))
                            .fold(f64::INFINITY, f64::min);
                        assert!((length(offset.map(f64::from)) - nearest).abs() < 1e-12, "{cell:?} {offset:?}");
                    }
                }
            }
        }
    }
}
