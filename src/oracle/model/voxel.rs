//! What the oracle keeps of a voxel and of the cell between it and the next voxel along each axis,
//! in four bytes: the voxel's label, and in a word about the cell the number of its rings or, for a
//! mixed cell, which corners have the label of the first one, and whether all others have one other
//! label.
//!
//! One look at this record tells a cell's label, or which two labels it has, so that the labels of
//! all eight corners are hardly ever read.
//!
//! Built in one pass over the rows of the region, 64 cells at a time. A few nanoseconds per voxel.

use std::sync::PoisonError;

use bytemuck::Zeroable;
use rayon::prelude::*;

use super::{
    border::Border,
    cells::Cells,
    contacts::{Contacts, IS_PLAIN},
    indicator::Corners,
    weights::{Sampling, Tally, UNITS},
};
use crate::Result;
use crate::image::bits::{gathered, ones};
use crate::image::bricks::Bricks;
use crate::image::region::Rows;
use crate::memory::zeroed_huge;
use crate::sync::{Mutex, lock};

/// Rings are counted up to this.
const MAX_RINGS: u16 = 3;

/// A voxel and its cell, in one word: one load tells a uniform cell and its label. From the lowest
/// bit on: two bits for the rings, 0 for a mixed cell; of mixed cells a bit "two labels, no
/// contacts", one for contacts and one for the centre as one, and, in the second byte, a bit for
/// each corner that has the label of the first; the dense id of the voxel's label in the upper
/// half.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Voxel(u32);

// SAFETY: an integer; all of its bytes zero are the number 0.
unsafe impl Zeroable for Voxel {}

impl Voxel {
    const TWO: u16 = 1 << 2;
    const CONTACT: u16 = 1 << 3;
    const CENTER: u16 = 1 << 4;

    fn new(id: u16, cell: u16) -> Self {
        Self(u32::from(id) << 16 | u32::from(cell))
    }

    /// Dense id of the voxel's label; of a uniform cell too.
    #[inline(always)]
    pub(crate) fn id(self) -> u16 {
        (self.0 >> 16) as u16
    }

    /// Rings of cells of one label around the point's cell, that cell being one; 0 for a mixed
    /// cell, at most [`MAX_RINGS`].
    #[inline(always)]
    pub(crate) fn rings(self) -> u32 {
        self.0 & 3
    }

    /// Of a mixed cell: a bit for each corner that has the label of the first.
    #[inline(always)]
    pub(crate) fn first_corners(self) -> u32 {
        self.0 >> 8 & 0xff
    }

    /// Of a mixed cell: whether all other corners have one label, and nothing touches in it.
    #[inline(always)]
    pub(crate) fn is_two(self) -> bool {
        self.0 & u32::from(Self::TWO) != 0
    }

    /// Of a mixed cell: its contacts.
    #[inline(always)]
    pub(crate) fn contacts(self) -> Contacts {
        match () {
            () if self.0 & u32::from(Self::CONTACT) == 0 => Contacts::None,
            () if self.0 & u32::from(Self::CENTER) == 0 => Contacts::Faces,
            () => Contacts::Center,
        }
    }
}

/// What the records have of 64 cells of a row.
struct Block {
    /// The word of each cell.
    cells: [u16; 64],
    /// Of mixed cells of two labels: the first one's id XOR the other's.
    differences: [u16; 64],
}

impl Block {
    /// The rings, from words of the sets of cells with none, at most one and at most two.
    fn of_rings(sets: [u64; 3]) -> Self {
        let mut cells = [MAX_RINGS; 64];
        for (n, eight) in cells.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            for word in sets {
                let byte = (word >> (8 * n)) as u16;
                for (bit, cell) in eight.iter_mut().enumerate() {
                    *cell -= u16::from(byte & 1 << bit != 0);
                }
            }
        }
        Self { cells, differences: [0; 64] }
    }

    /// Adds what is known of mixed cells; `rows` are those around the row of cells, from the
    /// block's first voxel on. All cells are looked at, side by side.
    fn add_mixed(&mut self, rows: [&[u16]; 4], marks_pairs: bool) {
        let two = if marks_pairs { Voxel::TWO } else { 0 };
        let [a, b, c, d] = rows.map(|row| &row[..65]);
        for i in 0..64 {
            let id = a[i];
            let corners = [id, a[i + 1], b[i], b[i + 1], c[i], c[i + 1], d[i], d[i + 1]]
                .map(|corner| corner ^ id);
            let any = corners.iter().fold(0, |all, &corner| all | corner);
            let (mut first, mut is_two) = (0, true);
            for (n, &corner) in corners.iter().enumerate() {
                first |= u16::from(corner == 0) << n;
                // One label differs from the first in the same bits everywhere.
                is_two &= (corner == 0) | (corner == any);
            }
            let word = first << 8 | if is_two { two } else { 0 };
            self.cells[i] |= if any != 0 { word } else { 0 };
            self.differences[i] = any;
        }
    }

    /// Adds the contacts of the `mixed` ones of these cells.
    fn add_contacts(&mut self, mixed: u64, around: [&[u16]; 4]) {
        let around = around.map(|row| &row[..65]);
        for i in ones(mixed) {
            let is_two = self.cells[i] & Voxel::TWO != 0;
            if is_two && IS_PLAIN[usize::from(self.cells[i] >> 8)] {
                continue;
            }
            let corners: Corners = std::array::from_fn(|c| around[c >> 1][i + (c & 1)]);
            let bits = match Contacts::of(&corners) {
                Contacts::None => continue,
                Contacts::Faces => Voxel::CONTACT,
                Contacts::Center => Voxel::CONTACT | Voxel::CENTER,
            };
            self.cells[i] = self.cells[i] & !Voxel::TWO | bits;
        }
    }

    /// Which mixed cells can have points of junctions, a bit for each cell, where no wall cuts: two
    /// labels meet in no line. Around contacts of the smooth model lines run along the edges of
    /// voxels, and are sampled with these; in the voxel model not.
    fn junctions(&self, is_voxel_model: bool) -> u64 {
        let without = if is_voxel_model { Voxel::TWO } else { Voxel::TWO | Voxel::CONTACT };
        gathered(&self.cells.map(|cell| u8::from(cell & without == 0)))
    }
}

/// What becomes of cells of two labels.
#[derive(Clone, Copy)]
pub(crate) enum Pairs<'a> {
    /// Their records do not say so: what they look like is not told by labels alone.
    Unmarked,
    /// Their records say so, and which have contacts: the voxel model.
    Marked,
    /// And they are counted, with all mixed cells, for the weights of labels: the smooth model.
    Counted(&'a Sampling),
}

/// What is known of the voxels of a region and of its cells.
pub(crate) struct Records<'a> {
    /// In the bricked layout.
    pub(crate) voxels: Vec<Voxel>,
    /// The mixed cells that can have points of junctions; where pairs are not marked only those
    /// that walls halve.
    pub(crate) junction_cells: Cells,
    /// What was counted, if that was wanted.
    pub(crate) tally: Option<Tally<'a>>,
}

/// The records of a region whose `mixed` cells are known.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub(crate) fn records<'a>(
    rows: &Rows,
    mut mixed: Cells,
    walls: &Border,
    pairs: Pairs<'a>,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Records<'a>> {
    let beside = mixed.dilated(check)?;
    let near = beside.dilated(check)?;
    let bricks = Bricks::new(rows.dims());
    let [nx, ny, nz] = bricks.dims();
    let mut voxels: Vec<Voxel> = zeroed_huge(bricks.len(), "voxels of the label volume")?;
    let none = || match pairs {
        Pairs::Counted(sampling) => Some(Tally::new(sampling)),
        _ => None,
    };
    // Layers differ in what they cost, so each is a piece of work of its own; tallies are as many
    // as threads at work.
    let idle = Mutex::new(Vec::new());
    let layers = voxels
        .par_chunks_mut(bricks.layer())
        .zip(mixed.layers_mut(Bricks::EDGE))
        .enumerate()
        .with_max_len(1);
    layers.try_for_each(|(layer, (out, mixed))| {
        let mut tally = lock(&idle).pop().unwrap_or_else(none);
        let mut mixed_rows = mixed.chunks_mut(beside.row(0, 0).len());
        for j in (layer * Bricks::EDGE..ny).take(Bricks::EDGE) {
            check()?;
            for (k, mixed) in mixed_rows.by_ref().take(nz).enumerate() {
                let at = bricks.y(j) + bricks.z(k) - layer * bricks.layer();
                let row = rows.row(j, k);
                let [beside, near] = [&beside, &near].map(|set| set.row(j, k));
                for (w, mixed) in mixed.iter_mut().enumerate() {
                    let mut block = Block::of_rings([*mixed, beside[w], near[w]]);
                    if *mixed != 0 {
                        let around = rows.around(j, k).map(|row| &row[64 * w..]);
                        block.add_mixed(around, !matches!(pairs, Pairs::Unmarked));
                        let first = [64 * w, j, k];
                        let leaves = walls.leaves_of_row(first);
                        if let Some(tally) = &mut tally {
                            count(tally, walls, leaves, first, *mixed, &block, around)?;
                        }
                        let mut junctions = 0;
                        if !matches!(pairs, Pairs::Unmarked) {
                            block.add_contacts(*mixed, around);
                            junctions = block.junctions(matches!(pairs, Pairs::Marked));
                        }
                        // Nobody asks for these mixed cells any more: the set becomes that of
                        // junction cells.
                        *mixed &= !leaves | junctions;
                    }
                    for (n, (ids, cells)) in row[64 * w..nx.min(64 * (w + 1))]
                        .chunks(Bricks::EDGE)
                        .zip(block.cells.chunks(Bricks::EDGE))
                        .enumerate()
                    {
                        let out = &mut out[at + bricks.x(64 * w + n * Bricks::EDGE)..];
                        out.iter_mut()
                            .zip(ids.iter().zip(cells))
                            .for_each(|(out, (&id, &cell))| *out = Voxel::new(id, cell));
                    }
                }
            }
        }
        lock(&idle).push(tally);
        Ok(())
    })?;
    let tallies = idle.into_inner().unwrap_or_else(PoisonError::into_inner);
    let tally = tallies
        .into_par_iter()
        .flatten()
        .map(Ok)
        .try_reduce_with(|a, b: Tally<'_>| a.merge(b))
        .transpose()?;
    Ok(Records { voxels, junction_cells: mixed, tally })
}

/// Counts the `mixed` ones of 64 cells from `first` on for the weights of labels; `leaves` tells
/// those that the walls leave.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
#[inline]
fn count(
    tally: &mut Tally<'_>,
    walls: &Border,
    leaves: u64,
    first: [usize; 3],
    mixed: u64,
    block: &Block,
    around: [&[u16]; 4],
) -> Result<()> {
    let around = around.map(|row| &row[..65]);
    for i in ones(mixed) {
        let cell = [first[0] + i, first[1], first[2]];
        let id = around[0][i];
        let voxel = Voxel::new(id, block.cells[i]);
        let corners = || -> Corners { std::array::from_fn(|c| around[c >> 1][i + (c & 1)]) };
        if leaves >> i & 1 == 0 {
            tally.add(walls, cell, &corners())?;
        } else if voxel.is_two() {
            tally.add_two(voxel.first_corners(), [id, id ^ block.differences[i]], UNITS)?;
        } else {
            tally.sample(cell, &corners(), UNITS)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::region::Region;
    use crate::image::{Frame, LabelImage};
    use crate::oracle::model::indicator;

    /// Few voxels of other labels, at both ends of words too: rings by definition.
    #[test]
    fn records_are_those_of_the_definition() {
        let mut ids = vec![0; 68 * 12 * 11];
        for ([i, j, k], id) in [
            ([4, 3, 3], 1),
            ([40, 0, 5], 1),
            ([41, 0, 6], 2),
            ([61, 2, 2], 1),
            ([67, 11, 10], 2),
            ([0, 0, 0], 1),
        ] {
            ids[i + 68 * (j + 12 * k)] = id;
        }
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let image = LabelImage::from_ids([68, 12, 11], frame, ids, vec![0, 5, 6]).unwrap();
        let check: &(dyn Fn() -> Result<()> + Sync) = &|| Ok(());
        let region = Region::new(&image, check).unwrap();
        let rows = Rows::new(&image, region, check).unwrap();
        let cells = Cells::mixed(&rows, check).unwrap();
        let dims = rows.dims();
        // A wall at the first voxels along x alone.
        let walls = Border::new([-1, 0, 0], dims, [usize::MAX / 4; 3]);
        let sampling = Sampling::new([1; 3].into_iter());
        let of = |pairs| records(&rows, cells.clone(), &walls, pairs, check).unwrap();
        let Records { voxels, junction_cells, .. } = of(Pairs::Marked);
        let smooth = of(Pairs::Counted(&sampling)).junction_cells;
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
            let steps =
                |m: &[usize; 3]| (0..3).map(|a| m[a].abs_diff(cell[a])).max().unwrap() as u32;
            let rings = mixed.iter().map(steps).min().unwrap().min(u32::from(MAX_RINGS));
            assert_eq!((voxel.id(), voxel.rings()), (ids[0], rings), "{cell:?}");
            if rings == 0 {
                assert_eq!(voxel.first_corners(), indicator::corners_of(&ids, ids[0]));
                let mut labels = ids.to_vec();
                labels.sort_unstable();
                labels.dedup();
                assert_eq!(voxel.is_two(), labels.len() == 2, "{cell:?}");
                let (many, at_wall) = (labels.len() > 2, cell[0] == 0);
                assert_eq!(junction_cells.bits(cell, 1) == 1, many || at_wall, "{cell:?}");
                let is_sampled = many && Contacts::of(&ids) == Contacts::None;
                assert_eq!(smooth.bits(cell, 1) == 1, is_sampled || at_wall, "{cell:?}");
            }
        }
    }
}
