//! Sets of voxels as bits, 64 in a word, and the runs and cubes of one label in them.

use std::ops::Range;

use rayon::prelude::*;

use crate::Result;
use crate::image::LabelImage;
use crate::image::bits::gathered;
use crate::image::region::Rows;
use crate::memory::{filled, zeroed};

/// Called for each few thousand words of a set and each step: whether to go on.
pub(super) type Check<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// What is made on the way to a block.
const ROOMS: usize = 4;

/// Words, at least, that are changed at a time: they, their neighbours and what is made on the way
/// stay in the nearest cache.
const BLOCK: usize = 512;

/// Blocks that a thread changes one after the other.
const BLOCKS: usize = 8;

/// A set of the voxels of a padded region, as whole words of 64 for each row along x: row (j, k) is
/// number j * rows\[1\] + k, and its bit i is voxel (i, j, k).
pub(super) struct Set {
    pub words: usize,
    pub rows: [usize; 2],
    pub bits: Vec<u64>,
}

impl Set {
    /// No voxels.
    pub fn new(words: usize, rows: [usize; 2]) -> Result<Self> {
        let bits = zeroed(words * rows[0] * rows[1], "words of the sets of thin voxels")?;
        Ok(Self { words, rows, bits })
    }

    pub fn row(&self, j: usize, k: usize) -> &[u64] {
        &self.bits[(j * self.rows[1] + k) * self.words..][..self.words]
    }

    /// Words of a block: those of whole rows.
    pub fn block(&self) -> usize {
        self.words * BLOCK.div_ceil(self.words)
    }

    /// Calls `change` for each block, given by its first word, with room for some more, in
    /// parallel.
    pub fn change(
        &mut self,
        check: Check<'_>,
        change: impl Fn(usize, &mut [u64], [&mut [u64]; ROOMS]) + Sync,
    ) -> Result<()> {
        let size = self.block();
        self.bits.par_chunks_mut(BLOCKS * size).enumerate().try_for_each(|(n, blocks)| {
            check()?;
            let mut room = filled(ROOMS * size, 0, "words of the sets of thin voxels", || Ok(()))?;
            for (m, block) in blocks.chunks_mut(size).enumerate() {
                let mut rooms = room.chunks_mut(size).map(|room| &mut room[..block.len()]);
                let rooms = [(); ROOMS].map(|()| rooms.next().unwrap_or_default());
                change((n * BLOCKS + m) * size, block, rooms);
            }
            Ok(())
        })
    }

    /// The block from word `first` on.
    pub fn at<'a>(&'a self, first: usize, like: &[u64]) -> &'a [u64] {
        &self.bits[first..][..like.len()]
    }

    /// How far apart in bits voxels are that are so many steps apart along each axis.
    pub fn steps(&self, [x, y, z]: [isize; 3]) -> isize {
        x + 64 * self.words as isize * (y * self.rows[1] as isize + z)
    }

    /// How far apart in bits voxels are that are so many steps apart along an axis.
    pub fn along(&self, axis: usize, steps: isize) -> isize {
        self.steps([0, 1, 2].map(|a| if a == axis { steps } else { 0 }))
    }

    /// A block as large as `room`, of which each bit is the one that is `bits` further on, or back:
    /// [`Set::steps`]. Beyond the end of a row along x or along z it is one of the next row or
    /// layer, beyond the first layer and the last there is nothing.
    pub fn beside<'a>(&'a self, first: usize, bits: isize, room: &'a mut [u64]) -> &'a [u64] {
        let (from, part) = (first as isize + bits.div_euclid(64), bits.rem_euclid(64) as u32);
        let inside = usize::try_from(from).ok().filter(|from| from + room.len() < self.bits.len());
        match (inside, part) {
            (Some(from), 0) => return &self.bits[from..][..room.len()],
            (Some(from), _) => {
                let pairs = self.bits[from..].iter().zip(&self.bits[from + 1..]);
                room.iter_mut()
                    .zip(pairs)
                    .for_each(|(out, (low, high))| *out = low >> part | high << (64 - part));
            }
            (None, _) => {
                let word = |at: isize| {
                    usize::try_from(at)
                        .ok()
                        .and_then(|at| self.bits.get(at))
                        .map_or(0, |&word| word)
                };
                for (out, at) in room.iter_mut().zip(from..) {
                    *out = word(at) >> part | word(at + 1).checked_shl(64 - part).unwrap_or(0);
                }
            }
        }
        room
    }

    pub fn is_empty(&self) -> bool {
        self.bits
            .par_chunks(self.block())
            .all(|words| words.iter().fold(0, |all, &word| all | word) == 0)
    }
}

/// A region and what is around it: background, except beyond walls.
///
/// Beyond walls background goes on straight from the outermost voxels of the image, and all else is
/// [`BEYOND`]. So background that a label surrounds at a wall is as narrow as it is in the image,
/// and a label that lies flat at a wall is as thin.
pub(super) struct Padded<'a> {
    rows: &'a Rows,
    /// Voxels around the region on each side.
    pad: usize,
    /// The voxels of the region along each axis that are within its walls.
    pub within: [Range<usize>; 3],
}

/// What is beyond a wall and is not background. No label of an image has this number.
const BEYOND: u16 = u16::MAX;

impl<'a> Padded<'a> {
    /// The region of `image`, which ends with walls if `has_walls`.
    pub fn new(image: &LabelImage, rows: &'a Rows, has_walls: bool, pad: usize) -> Self {
        let region = rows.region();
        let within = [0, 1, 2].map(|axis| {
            let (mut within, count) = (0..region.dims[axis], image.dims()[axis]);
            if has_walls {
                // Of the region one voxel at most is beyond the image on each side.
                let is_beyond = |at| region.place([at; 3], axis, count).is_none();
                within.start += usize::from(is_beyond(within.start));
                within.end -= usize::from(is_beyond(within.end - 1));
            }
            within
        });
        Self { rows, pad, within }
    }

    /// Voxels along each axis, those around the region counted in.
    fn dims(&self) -> [usize; 3] {
        self.rows.dims().map(|n| n + 2 * self.pad)
    }

    /// For each voxel of row `here`, tells in `flags` whether the one that is `step` further along
    /// row `there` has the same label. `copies` is room for two rows.
    fn compare(
        &self,
        here: [usize; 2],
        there: [usize; 2],
        step: usize,
        flags: &mut [u8],
        copies: &mut [Vec<u16>; 2],
    ) {
        flags.fill(1);
        let compare = |flags: &mut [u8], here: &[u16], there: &[u16]| {
            let pairs = here.iter().zip(&there[step..]);
            flags.iter_mut().zip(pairs).for_each(|(flag, (a, b))| *flag = u8::from(a == b));
        };
        // Mostly there is nothing but background before a row and after it.
        if let Some((here, there)) = self.inner_row(here).zip(self.inner_row(there)) {
            return compare(&mut flags[self.pad..], here, there);
        }
        let [copy, copy_there] = copies;
        if self.copy_row(here, copy) | self.copy_row(there, copy_there) {
            compare(flags, copy, copy_there);
        }
    }

    /// A row of the region, unless it is beyond a wall or has a wall at one of its ends.
    fn inner_row(&self, row: [usize; 2]) -> Option<&'a [u16]> {
        let [j, k] = row.map(|at| at.wrapping_sub(self.pad));
        let [along, across @ ..] = &self.within;
        let count = self.rows.dims()[0];
        (across[0].contains(&j) && across[1].contains(&k) && *along == (0..count))
            .then(|| &self.rows.row(j, k)[..count])
    }

    /// Copies a row with what is before and after it. Whether it may have any but background.
    fn copy_row(&self, row: [usize; 2], copy: &mut [u16]) -> bool {
        copy.fill(0);
        let [j, k] = [1, 2].map(|axis| self.nearest(row[axis - 1], axis));
        let Some(((j, j_beyond), (k, k_beyond))) = j.zip(k) else { return false };
        let beyond = |id: u16| if id == 0 { 0 } else { BEYOND };
        let (within, count) = (&self.within[0], self.rows.dims()[0]);
        let ids = &self.rows.row(j, k)[within.clone()];
        let inside = self.pad + within.start..self.pad + within.end;
        copy[inside.clone()].copy_from_slice(ids);
        if j_beyond || k_beyond {
            copy[inside.clone()].iter_mut().for_each(|id| *id = beyond(*id));
        }
        if within.start > 0 {
            copy[..inside.start].fill(beyond(ids[0]));
        }
        if within.end < count {
            copy[inside.end..].fill(beyond(ids[ids.len() - 1]));
        }
        true
    }

    /// The voxel of the region along an axis that the labels at `at` come from, and whether `at` is
    /// beyond a wall; `None` where all is background.
    fn nearest(&self, at: usize, axis: usize) -> Option<(usize, bool)> {
        let (within, count) = (&self.within[axis], self.rows.dims()[axis]);
        match at.checked_sub(self.pad) {
            Some(at) if within.contains(&at) => Some((at, false)),
            Some(at) if at >= within.end => (within.end < count).then(|| (within.end - 1, true)),
            _ => (within.start > 0).then_some((within.start, true)),
        }
    }
}

/// The voxels of a padded region, and for each axis whether a voxel and the next one have the same
/// label: never so at the end of a row or layer, so no run goes on in the next one.
pub(super) struct Labels {
    pub equal: [Set; 3],
}

impl Labels {
    /// Of a region and what is around it.
    pub fn new(padded: &Padded<'_>, check: Check<'_>) -> Result<Self> {
        let dims = padded.dims();
        let words = dims[0].div_ceil(64);
        let size = [dims[1], dims[2]];
        let of_axis = |axis: usize| {
            let step = [0, 1, 2].map(|a| usize::from(a == axis));
            let mut bits: Vec<u64> =
                zeroed(words * size[0] * size[1], "words of the sets of thin voxels")?;
            bits.par_chunks_mut(words * size[1]).enumerate().take(size[0] - step[1]).try_for_each(
                |(j, layer)| {
                    check()?;
                    let mut flags = filled(64 * words, 0_u8, "flags of a row", || Ok(()))?;
                    let copy = || filled(dims[0], 0, "labels of a row", || Ok(()));
                    let mut copies = [copy()?, copy()?];
                    for (k, out) in layer.chunks_mut(words).enumerate().take(size[1] - step[2]) {
                        let (here, there) = ([j, k], [j + step[1], k + step[2]]);
                        let flags_of_pairs = &mut flags[..dims[0] - step[0]];
                        padded.compare(here, there, step[0], flags_of_pairs, &mut copies);
                        for (word, flags) in out.iter_mut().zip(flags.as_chunks::<64>().0) {
                            *word = gathered(flags);
                        }
                    }
                    Ok(())
                },
            )?;
            Ok(Set { words, rows: size, bits })
        };
        Ok(Self { equal: [of_axis(0)?, of_axis(1)?, of_axis(2)?] })
    }

    /// Makes `to` the voxels at which runs of `count` voxels of one label begin, all of them of
    /// `from`.
    pub fn begin_runs(
        &self,
        from: &Set,
        to: &mut Set,
        axis: usize,
        count: usize,
        check: Check<'_>,
    ) -> Result<()> {
        to.change(check, |first, block, [room, ..]| {
            block.copy_from_slice(from.at(first, block));
            self.keep_runs(block, from, first, axis, count, room);
        })
    }

    /// Keeps of a block where runs of `count` voxels of one label begin, all of which `set` has.
    pub fn keep_runs(
        &self,
        block: &mut [u64],
        set: &Set,
        first: usize,
        axis: usize,
        count: usize,
        room: &mut [u64],
    ) {
        for by in 1..count as isize {
            both(block, self.equal[axis].beside(first, set.along(axis, by - 1), room));
            both(block, set.beside(first, set.along(axis, by), room));
        }
    }

    /// Makes `set` the voxels at which cubes of one label begin, of so many voxels along each axis:
    /// where runs of runs of runs do.
    pub fn begin_cubes(
        &self,
        all: &[u64],
        cube: [usize; 3],
        set: &mut Set,
        spare: &mut Set,
        check: Check<'_>,
    ) -> Result<()> {
        set.change(check, |_, block, _| block.copy_from_slice(&all[..block.len()]))?;
        for (axis, &count) in cube.iter().enumerate().filter(|&(_, &count)| count > 1) {
            self.begin_runs(set, spare, axis, count, check)?;
            std::mem::swap(set, spare);
        }
        Ok(())
    }

    /// Makes `set` the voxels of `all`, the words of a block, in cubes of one label, of so many
    /// voxels along each axis.
    pub fn thick(
        &self,
        all: &[u64],
        cube: [usize; 3],
        set: &mut Set,
        spare: &mut Set,
        check: Check<'_>,
    ) -> Result<()> {
        self.begin_cubes(all, cube, set, spare, check)?;
        // No cube begins so near to an end that it would go on in the next row.
        for (axis, &count) in cube.iter().enumerate().filter(|&(_, &count)| count > 1) {
            spare.change(check, |first, block, [room, ..]| {
                block.copy_from_slice(set.at(first, block));
                (1..count as isize)
                    .for_each(|by| either(block, set.beside(first, set.along(axis, -by), room)));
            })?;
            std::mem::swap(set, spare);
        }
        Ok(())
    }

    /// Adds to a block what a set has up to `steps` further on along an axis, in runs of one label,
    /// or further back.
    pub fn add_in_runs(
        &self,
        block: &mut [u64],
        set: &Set,
        first: usize,
        axis: usize,
        steps: isize,
        [same, room]: [&mut [u64]; 2],
    ) {
        same.fill(u64::MAX);
        for by in 1..=steps.abs() {
            let (pair, by) = if steps > 0 { (by - 1, by) } else { (-by, -by) };
            both(same, self.equal[axis].beside(first, set.along(axis, pair), room));
            let beside = set.beside(first, set.along(axis, by), room);
            block
                .iter_mut()
                .zip(beside.iter().zip(&*same))
                .for_each(|(out, (word, same))| *out |= word & same);
        }
    }

    /// Adds to a set what is within so many steps of it along each axis, one axis after the other,
    /// within its label.
    pub fn grow(
        &self,
        set: &mut Set,
        steps: [usize; 3],
        spare: &mut Set,
        check: Check<'_>,
    ) -> Result<()> {
        for (axis, &count) in steps.iter().enumerate().filter(|&(_, &count)| count > 0) {
            spare.change(check, |first, block, [same, room, ..]| {
                block.copy_from_slice(set.at(first, block));
                for steps in [count as isize, -(count as isize)] {
                    self.add_in_runs(block, set, first, axis, steps, [&mut *same, &mut *room]);
                }
            })?;
            std::mem::swap(set, spare);
        }
        Ok(())
    }
}

/// Keeps of a block what the other has, too.
pub(super) fn both(block: &mut [u64], other: &[u64]) {
    block.iter_mut().zip(other).for_each(|(word, other)| *word &= other);
}

/// Adds to a block what the other has.
pub(super) fn either(block: &mut [u64], other: &[u64]) {
    block.iter_mut().zip(other).for_each(|(word, other)| *word |= other);
}
