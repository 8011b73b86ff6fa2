//! Sets of voxels as bits, 64 in a word, and the runs and cubes of one label in them.

use rayon::prelude::*;

use crate::Result;
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

/// The voxels of a region, and for each axis whether a voxel and the next one have the same label:
/// never so at the end of a row or layer, so no run goes on in the next one.
pub(super) struct Labels {
    pub equal: [Set; 3],
}

impl Labels {
    /// Of a region with `pad` voxels of background around it.
    pub fn new(rows: &Rows, pad: usize, check: Check<'_>) -> Result<Self> {
        let [nx, ny, nz] = rows.dims();
        let padded = [nx, ny, nz].map(|n| n + 2 * pad);
        let words = padded[0].div_ceil(64);
        let size = [padded[1], padded[2]];
        let row = |j: usize, k: usize| {
            let (j, k) = (j.wrapping_sub(pad), k.wrapping_sub(pad));
            (j < ny && k < nz).then(|| &rows.row(j, k)[..nx])
        };
        let of_axis = |axis: usize| {
            let step = [0, 1, 2].map(|a| usize::from(a == axis));
            let mut bits: Vec<u64> =
                zeroed(words * size[0] * size[1], "words of the sets of thin voxels")?;
            bits.par_chunks_mut(words * size[1]).enumerate().take(size[0] - step[1]).try_for_each(
                |(j, layer)| {
                    check()?;
                    // Outside of the region, and at its ends, all is background.
                    let mut flags = filled(64 * words, 1_u8, "flags of a row", || Ok(()))?;
                    flags[padded[0] - step[0]..].fill(0);
                    for (k, out) in layer.chunks_mut(words).enumerate().take(size[1] - step[2]) {
                        let beside = row(j, k).zip(row(j + step[1], k + step[2]));
                        let own = &mut flags[pad..pad + nx - step[0]];
                        match beside {
                            None => own.fill(1),
                            Some((here, there)) => {
                                let pairs = here.iter().zip(&there[step[0]..]);
                                own.iter_mut()
                                    .zip(pairs)
                                    .for_each(|(flag, (a, b))| *flag = u8::from(a == b));
                            }
                        }
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
        // None begins so near to an end that it would go on in the next row.
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
