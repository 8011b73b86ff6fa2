//! How thick what a voxel belongs to is: where a label, or a part of it, is thinner than the
//! samples of its interfaces are apart.
//!
//! **Thickness.** A voxel is *m thick* when some cube of m voxels along each axis, all of its
//! label, holds it: the granulometry of openings by cubes (Serra, "Image analysis and mathematical
//! morphology", 1982). Cubes and not balls, because a sheet of two voxels must be told from a sheet
//! of one, which distances between voxel centres do not tell apart. Any half-space holds a cube at
//! each of its voxels, so plane interfaces of any direction are not thin. Where voxels are no
//! cubes, the cube has as many voxels along each axis as make up its edge.
//!
//! **What counts.** A thin voxel next to a thick part of its label is a step or a bump on that
//! part's surface, of which every segmentation is full: to cut it off loses no component, and tears
//! nothing. So of the voxels less than m thick, those count
//! - that lie m - 1 steps or more, within their label, from all that are m thick: sheets, tubes,
//!   small components;
//! - that have such on both sides along an axis, in runs of their label: bridges;
//! - and those less than m thick within m steps of these.
//!
//! Two voxels of a label that meet in an edge, and are not joined by a third one beside both, are a
//! neck: they count as one thick. So do two that meet in a corner, around which no third one is.
//!
//! The background is a label like others here: a slit between two objects is thin as well.
//!
//! All of this is done for all labels at once, with sets of voxels as bits, 64 in a word: a bit for
//! each pair of neighbours that says whether they have the same label is all that is asked of
//! labels.
//!
//! Cost: about a nanosecond per voxel and level. Memory while it lasts: seven bits per voxel of the
//! region with as many voxels more on each side as the largest cube has along an axis, up to 32, in
//! rows of whole words; beside these a byte per voxel of the region, where anything is thin.

use rayon::prelude::*;

use crate::image::bits::{gathered, ones};
use crate::image::region::{Region, Rows};
use crate::memory::{filled, reserve, zeroed};
use crate::{Result, image::LabelImage};

/// Called for each few thousand words of a set and each step: whether to go on.
type Check<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// What is made on the way to a block.
const ROOMS: usize = 4;

/// Words, at least, that are changed at a time: they, their neighbours and what is made on the way
/// stay in the nearest cache.
const BLOCK: usize = 512;

/// Blocks that a thread changes one after the other.
const BLOCKS: usize = 8;

/// A set of the voxels of a padded region, as whole words of 64 for each row along x: row (j, k) is
/// number j * rows\[1\] + k, and its bit i is voxel (i, j, k).
struct Set {
    words: usize,
    rows: [usize; 2],
    bits: Vec<u64>,
}

impl Set {
    /// No voxels.
    fn new(words: usize, rows: [usize; 2]) -> Result<Self> {
        let bits = zeroed(words * rows[0] * rows[1], "words of the sets of thin voxels")?;
        Ok(Self { words, rows, bits })
    }

    fn row(&self, j: usize, k: usize) -> &[u64] {
        &self.bits[(j * self.rows[1] + k) * self.words..][..self.words]
    }

    /// Words of a block: those of whole rows.
    fn block(&self) -> usize {
        self.words * BLOCK.div_ceil(self.words)
    }

    /// Calls `change` for each block, given by its first word, with room for some more, in
    /// parallel.
    fn change(
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
    fn at<'a>(&'a self, first: usize, like: &[u64]) -> &'a [u64] {
        &self.bits[first..][..like.len()]
    }

    /// How far apart in bits voxels are that are so many steps apart along each axis.
    fn steps(&self, [x, y, z]: [isize; 3]) -> isize {
        x + 64 * self.words as isize * (y * self.rows[1] as isize + z)
    }

    /// How far apart in bits voxels are that are so many steps apart along an axis.
    fn along(&self, axis: usize, steps: isize) -> isize {
        self.steps([0, 1, 2].map(|a| if a == axis { steps } else { 0 }))
    }

    /// A block as large as `room`, of which each bit is the one that is `bits` further on, or back:
    /// [`Set::steps`]. Beyond the end of a row along x or along z it is one of the next row or
    /// layer, beyond the first layer and the last there is nothing.
    fn beside<'a>(&'a self, first: usize, bits: isize, room: &'a mut [u64]) -> &'a [u64] {
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

    fn is_empty(&self) -> bool {
        self.bits
            .par_chunks(self.block())
            .all(|words| words.iter().fold(0, |all, &word| all | word) == 0)
    }
}

/// The voxels of a region, and for each axis whether a voxel and the next one have the same label:
/// never so at the end of a row or layer, so no run goes on in the next one.
struct Labels {
    equal: [Set; 3],
}

impl Labels {
    /// Of a region with `pad` voxels of background around it.
    fn new(rows: &Rows, pad: usize, check: Check<'_>) -> Result<Self> {
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

    /// Makes `set` the voxels of `all`, the words of a block, in cubes of one label, of so many
    /// voxels along each axis.
    fn thick(
        &self,
        all: &[u64],
        cube: [usize; 3],
        set: &mut Set,
        spare: &mut Set,
        check: Check<'_>,
    ) -> Result<()> {
        set.change(check, |_, block, _| block.copy_from_slice(&all[..block.len()]))?;
        // Where cubes begin: where runs of runs of runs do.
        for (axis, &count) in cube.iter().enumerate().filter(|&(_, &count)| count > 1) {
            let equal = &self.equal[axis];
            spare.change(check, |first, block, [room, ..]| {
                block.copy_from_slice(set.at(first, block));
                for by in 1..count as isize {
                    both(block, equal.beside(first, set.along(axis, by - 1), room));
                    both(block, set.beside(first, set.along(axis, by), room));
                }
            })?;
            std::mem::swap(set, spare);
        }
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
    fn add_in_runs(
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
    fn grow(
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

    /// Makes `counts` those voxels of `all`, the words of a block, that are less than a cube thick
    /// and count. Whether there are any.
    fn thin(
        &self,
        all: &[u64],
        cube: [usize; 3],
        sets: &mut [Set; 4],
        check: Check<'_>,
    ) -> Result<bool> {
        let [counts, thick, thin, spare] = sets;
        self.thick(all, cube, thick, spare, check)?;
        thin.change(check, |first, block, _| {
            let thick = thick.at(first, block);
            block
                .iter_mut()
                .zip(all.iter().zip(thick))
                .for_each(|(out, (all, thick))| *out = all & !thick);
        })?;
        if thin.is_empty() {
            return Ok(false);
        }
        // What lies between, on both sides along an axis. Longer bridges have voxels that are far
        // from both ends.
        let near = cube.map(|count| count - 1);
        counts.change(check, |first, block, [on, back, same, room]| {
            block.fill(0);
            for (axis, &steps) in near.iter().enumerate().filter(|&(_, &steps)| steps > 0) {
                let steps = 2 * steps as isize;
                for (side, steps) in [(&mut *on, steps), (&mut *back, -steps)] {
                    side.fill(0);
                    self.add_in_runs(side, thick, first, axis, steps, [&mut *same, &mut *room]);
                }
                both(on, back);
                either(block, on);
            }
            both(block, thin.at(first, block));
        })?;
        // And what is far from all that is thick.
        self.grow(thick, near, spare, check)?;
        counts.change(check, |first, block, _| {
            let far = thin
                .at(first, block)
                .iter()
                .zip(thick.at(first, block))
                .map(|(thin, thick)| thin & !thick);
            block.iter_mut().zip(far).for_each(|(out, far)| *out |= far);
        })?;
        if counts.is_empty() {
            return Ok(false);
        }
        self.grow(counts, cube, spare, check)?;
        counts.change(check, |first, block, _| both(block, thin.at(first, block)))?;
        Ok(true)
    }
}

/// Keeps of a block what the other has, too.
fn both(block: &mut [u64], other: &[u64]) {
    block.iter_mut().zip(other).for_each(|(word, other)| *word &= other);
}

/// Adds to a block what the other has.
fn either(block: &mut [u64], other: &[u64]) {
    block.iter_mut().zip(other).for_each(|(word, other)| *word |= other);
}

/// What is thin in an image.
pub struct ThinVoxels {
    /// The region that holds all of it.
    pub region: Region,
    /// The thicknesses that were found, in world units, increasing.
    pub thicknesses: Vec<f64>,
    /// For each voxel of the region, x fastest, then z, then y, which thickness it has, the least
    /// of several; [`NOT_THIN`] for those that do not count. Empty where there is none.
    pub of_voxels: Vec<u8>,
}

/// No number of a thickness.
pub const NOT_THIN: u8 = u8::MAX;

impl ThinVoxels {
    /// Of a region in which nothing is looked for.
    pub fn none(region: Region) -> Self {
        Self { region, thicknesses: Vec::new(), of_voxels: Vec::new() }
    }

    /// The number of a thickness, which is no smaller than those before it, and a table to note it
    /// in.
    fn number(&mut self, thickness: f64, check: Check<'_>) -> Result<u8> {
        if self.of_voxels.is_empty() {
            self.of_voxels =
                filled(self.region.dims.iter().product(), NOT_THIN, "voxels of the region", check)?;
        }
        if self.thicknesses.last() != Some(&thickness) {
            self.thicknesses.push(thickness);
        }
        Ok((self.thicknesses.len() - 1) as u8)
    }
}

/// What two voxels of a label count as that meet in an edge or a corner alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Necks {
    /// As one voxel thick.
    Thin,
    /// As what they belong to.
    Ignored,
}

/// Finds what is thinner than `max`, in world units; what holds cubes of [`LARGEST`] of the
/// smallest sides of a voxel is not searched for, however large `max` is. `check` is called many
/// times in each step, from several threads.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub fn thin_voxels(
    image: &LabelImage,
    rows: &Rows,
    max: f64,
    necks: Necks,
    check: Check<'_>,
) -> Result<ThinVoxels> {
    let region = *rows.region();
    let mut thin = ThinVoxels::none(region);
    let spacing = image.frame().spacing();
    let unit = spacing.min_element();
    let Some(largest) = largest_cube(unit, max) else { return Ok(thin) };
    let labels = Labels::new(rows, largest, check)?;
    let [nx, _, nz] = region.dims;
    let padded = nx + 2 * largest;
    let words = padded.div_ceil(64);
    let of_row =
        |w: usize| if 64 * (w + 1) <= padded { u64::MAX } else { (1 << (padded % 64)) - 1 };
    let all: Vec<u64> = (0..labels.equal[0].block()).map(|n| of_row(n % words)).collect();
    let contacts = match necks {
        Necks::Thin => contacts(rows, &labels, &all, largest, check)?,
        Necks::Ignored => Vec::new(),
    };
    if !contacts.is_empty() {
        let number = thin.number(unit, check)?;
        contacts.into_iter().for_each(|v| thin.of_voxels[v as usize] = number);
    }
    let set = || Set::new(words, labels.equal[0].rows);
    let mut sets = [set()?, set()?, set()?, set()?];
    debug_assert_eq!(SETS, labels.equal.len() + sets.len());
    for count in sizes().take_while(|&count| count <= largest) {
        let edge = count as f64 * unit;
        let cube = spacing.to_array().map(|side| (edge / side).round().max(1.0) as usize);
        if !labels.thin(&all, cube, &mut sets, check)? {
            continue;
        }
        let [set, ..] = &sets;
        let number = thin.number(thickness_below(count) as f64 * unit, check)?;
        thin.of_voxels.par_chunks_mut(nx * nz).enumerate().for_each(|(j, layer)| {
            for (k, voxels) in layer.chunks_mut(nx).enumerate() {
                for (w, &word) in set.row(j + largest, k + largest).iter().enumerate() {
                    // What surrounds the region counts for nothing.
                    let inside = ones(word)
                        .map(|bit| (64 * w + bit).wrapping_sub(largest))
                        .filter(|&i| i < nx);
                    inside.for_each(|i| voxels[i] = voxels[i].min(number));
                }
            }
        });
    }
    Ok(thin)
}

/// Sets that there are at a time, at most.
const SETS: usize = 7;

/// Bytes that [`thin_voxels`] needs at its peak beside the rows, but for some per contact of
/// voxels.
pub fn bytes_needed(image: &LabelImage, region: &Region, max: f64) -> u64 {
    largest_cube(image.frame().spacing().min_element(), max).map_or(0, |largest| {
        let [nx, ny, nz] = region.dims.map(|n| (n + 2 * largest) as u64);
        let sets = SETS as u64 * nx.div_ceil(64) * ny * nz * size_of::<u64>() as u64;
        sets + region.dims.iter().map(|&n| n as u64).product::<u64>()
    })
}

/// The largest edge of a cube to be tried, in voxels of side `unit`: what is less than so many
/// voxels thick is thinner than `max`, if it is a whole number less one at most.
fn largest_cube(unit: f64, max: f64) -> Option<usize> {
    sizes().take_while(|&count| thickness_below(count) as f64 * unit < max).last()
}

/// A way in which two voxels of a label can meet. Corner c of a cell is at (c & 1, c >> 1 & 1, c >>
/// 2).
struct Meeting {
    /// The edges of a cell along which the label must change: the corner where each begins, and its
    /// axis.
    edges: Vec<(usize, usize)>,
    /// The corners of which either two may be those that meet.
    pairs: Vec<[usize; 2]>,
    /// Whether all other corners of the cell must have other labels, too.
    alone: bool,
}

impl Meeting {
    /// In the edge across a cell's lower face along two axes.
    fn across_face([u, v]: [usize; 2]) -> Self {
        let edges = vec![(0, u), (0, v), (1 << u, v), (1 << v, u)];
        Self { edges, pairs: vec![[0, 1 << u | 1 << v], [1 << u, 1 << v]], alone: false }
    }

    /// In the middle of a cell, from one of its corners on.
    fn across_cell(corner: usize) -> Self {
        let ends = [corner, 7 - corner];
        let edges = (0..3).flat_map(|a| ends.map(|c| (c & !(1 << a), a))).collect();
        Self { edges, pairs: vec![ends], alone: true }
    }
}

/// Voxels of a label, not background, that meet in an edge alone: two of the four around it, across
/// from each other, while the others have other labels; or in a corner alone, around which all
/// others have.
fn contacts(
    rows: &Rows,
    labels: &Labels,
    all: &[u64],
    pad: usize,
    check: Check<'_>,
) -> Result<Vec<u32>> {
    let [nx, ny, nz] = rows.dims();
    let faces = [[0, 1], [1, 2], [2, 0]].map(Meeting::across_face);
    let cells = [0, 1, 2, 3].map(Meeting::across_cell);
    let [equal, ..] = &labels.equal;
    let mut candidates = Set::new(equal.words, equal.rows)?;
    let mut found = Vec::new();
    for Meeting { edges, pairs, alone } in faces.into_iter().chain(cells) {
        candidates.change(check, |first, block, [room, ..]| {
            block.copy_from_slice(&all[..block.len()]);
            for &(corner, axis) in &edges {
                let beside = labels.equal[axis].beside(
                    first,
                    equal.steps([0, 1, 2].map(|a| (corner >> a & 1) as isize)),
                    room,
                );
                block.iter_mut().zip(beside).for_each(|(word, equal)| *word &= !equal);
            }
        })?;
        let layers = (0..ny - 1).into_par_iter().map(|j| {
            let mut numbers = Vec::new();
            for k in 0..nz - 1 {
                let around = rows.around(j, k);
                for (w, &word) in candidates.row(j + pad, k + pad).iter().enumerate() {
                    for i in ones(word)
                        .map(|bit| (64 * w + bit).wrapping_sub(pad))
                        .filter(|&i| i + 1 < nx)
                    {
                        let id = |c: usize| around[c >> 1][i + (c & 1)];
                        let number = |c: usize| {
                            (((j + (c >> 1 & 1)) * nz + k + (c >> 2)) * nx + i + (c & 1)) as u32
                        };
                        for &pair in &pairs {
                            let own = id(pair[0]);
                            let meets = own != 0 && own == id(pair[1]);
                            if meets
                                && (!alone || (0..8).all(|c| pair.contains(&c) || id(c) != own))
                            {
                                reserve(&mut numbers, 2, "thin voxels")?;
                                numbers.extend(pair.map(number));
                            }
                        }
                    }
                }
            }
            Ok(numbers)
        });
        let layers: Vec<Vec<u32>> = layers.collect::<Result<_>>()?;
        reserve(&mut found, layers.iter().map(Vec::len).sum(), "thin voxels")?;
        layers.iter().for_each(|layer| found.extend_from_slice(layer));
    }
    Ok(found)
}

/// Edges of the cubes, in the smallest sides of a voxel: about a third apart, all from 2 to 4.
/// Thicker parts than the last are not searched for.
fn sizes() -> impl Iterator<Item = usize> {
    [2, 3, 4, 6, 8, 11, 16, 22, LARGEST].into_iter()
}

/// The largest of them.
pub const LARGEST: usize = 32;

/// How thick what no cube of `count` voxels holds is taken to be: as the next smaller cube.
fn thickness_below(count: usize) -> usize {
    sizes().take_while(|&size| size < count).last().unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::phantom::sampled;

    /// The thin voxels of each thickness, by image coordinates.
    fn thin(
        dims: [usize; 3],
        spacing: [f64; 3],
        max: f64,
        label: impl Fn([usize; 3]) -> i32,
    ) -> Vec<(f64, Vec<[usize; 3]>)> {
        let half = dims.map(|n| (n as f64 - 1.0) / 2.0);
        let image = sampled(dims, spacing, |p| {
            let at = p.to_array();
            label([0, 1, 2].map(|a| (at[a] / spacing[a] + half[a]).round() as usize))
        });
        let image = image.unwrap();
        let rows = Rows::new(&image, Region::new(&image, &|| Ok(())).unwrap(), &|| Ok(())).unwrap();
        let thin = thin_voxels(&image, &rows, max, Necks::Thin, &|| Ok(())).unwrap();
        let Region { first, dims: [nx, _, nz] } = thin.region;
        let place = |v: usize| {
            let at = [v % nx, v / nx / nz, v / nx % nz];
            [0, 1, 2].map(|a| (at[a] as isize + first[a]) as usize)
        };
        let voxels_of = |number: usize| {
            let voxels =
                thin.of_voxels.iter().enumerate().filter(|&(_, &of)| usize::from(of) == number);
            voxels.map(|(v, _)| place(v)).collect()
        };
        let found = thin.thicknesses.iter().enumerate();
        found.map(|(number, &thickness)| (thickness, voxels_of(number))).collect()
    }

    #[test]
    fn sheets_are_thin_and_blocks_with_steps_are_not() {
        // A sheet one voxel thick, and a block on whose top lies a bump of one voxel.
        let label = |[i, j, k]: [usize; 3]| match k {
            5 if (2..26).contains(&i) && (2..26).contains(&j) => 1,
            10..16 if (2..26).contains(&i) && (2..26).contains(&j) => 2,
            16 if [i, j] == [6, 7] => 2,
            _ => 0,
        };
        let found = thin([28, 28, 20], [1.0; 3], 3.0, label);
        assert_eq!(found[0].0, 1.0);
        assert!(found[0].1.iter().all(|at| at[2] == 5) && found[0].1.len() == 24 * 24);
        // The background between the two is four voxels thick.
        assert!(found[1..].iter().all(|(_, voxels)| voxels.iter().all(|at| at[2] == 5)));
        let slits = thin([28, 28, 20], [1.0; 3], 5.0, label);
        assert!(
            slits
                .iter()
                .any(|(thickness, voxels)| *thickness == 4.0 && voxels.contains(&[14, 14, 7]))
        );
    }

    #[test]
    fn thickness_is_in_world_units() {
        // A sheet of one slice of thick slices is as thick as these.
        let label = |[i, j, k]: [usize; 3]| {
            i32::from(k == 3 && (2..28).contains(&i) && (2..28).contains(&j))
        };
        assert_eq!(thin([30, 30, 7], [1.0, 1.0, 4.0], 3.5, label), []);
        let found = thin([30, 30, 7], [1.0, 1.0, 4.0], 5.0, label);
        assert_eq!(
            found.iter().map(|(thickness, voxels)| (*thickness, voxels.len())).collect::<Vec<_>>(),
            [(4.0, 26 * 26)]
        );
    }

    #[test]
    fn bridges_and_necks_count() {
        // Two blocks joined by two voxels in a row, and two more that meet in an edge.
        let label = |[i, j, k]: [usize; 3]| {
            let block = |x: usize, y: usize| {
                (x..x + 4).contains(&i) && (y..y + 4).contains(&j) && (2..6).contains(&k)
            };
            let bridge = (6..8).contains(&i) && [j, k] == [4, 4];
            i32::from(block(2, 2) || block(8, 2) || bridge || block(12, 6))
        };
        let found = thin([18, 12, 8], [1.0; 3], 1.5, label);
        let all: Vec<_> = found.iter().flat_map(|(_, voxels)| voxels.iter().copied()).collect();
        for at in [[6, 4, 4], [7, 4, 4], [11, 5, 3], [12, 6, 3]] {
            assert!(all.contains(&at), "{at:?} of {all:?}");
        }
        assert!(!all.contains(&[3, 3, 3]));
    }

    #[test]
    fn nothing_is_thin_for_dense_samples() {
        assert_eq!(thin([8, 8, 8], [1.0; 3], 0.9, |[_, _, k]| i32::from(k == 4)), []);
    }
}
