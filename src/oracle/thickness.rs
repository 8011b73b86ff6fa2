//! How thick what a voxel belongs to is: where a label, or a part of it, is thinner than the samples of its interfaces are apart.
//!
//! **Thickness.** A voxel is *m thick* when some cube of m voxels along each axis, all of its label, holds it: the granulometry of openings by cubes (Serra, "Image analysis and mathematical
//! morphology", 1982). Cubes and not balls, because a sheet of two voxels must be told from a sheet of one, which distances between voxel centres do not tell apart. Any half-space holds a cube at each of its voxels, so
//! plane interfaces of any direction are not thin. Where voxels are no cubes, the cube has as many voxels along each axis as make up its edge.
//!
//! **What counts.** A thin voxel next to a thick part of its label is a step or a bump on that part's surface, of which every segmentation is full: to cut it off loses no component, and tears nothing. So of the voxels less than m thick, those count
//! - that lie m - 1 steps or more, within their label, from all that are m thick: sheets, tubes, small components;
//! - that have such on both sides along an axis, in runs of their label: bridges;
//! - and those less than m thick within m steps of these.
//!
//! Two voxels of a label that meet in an edge, and are not joined by a third one beside both, are a neck: they count as one thick.
//!
//! The background is a label like others here: a slit between two objects is thin as well.
//!
//! All of this is done for all labels at once, with sets of voxels as rows of bits: a bit for each pair of neighbours that says whether they have the same label is all that is asked of labels.
//!
//! Cost: about two nanoseconds per voxel and level; ten bits per voxel while it lasts.

use rayon::prelude::*;

use super::cells::gathered;
use super::region::{Region, Rows};
use crate::memory::{filled, reserve, room, zeroed};
use crate::{Result, image::LabelImage};

/// Called for each plane of voxels and step: whether to go on.
type Check<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// A set of the voxels of a padded region; bit i of row (j, k) is voxel (i, j, k).
#[derive(Clone)]
struct Set {
    words: usize,
    rows: [usize; 2],
    bits: Vec<u64>,
}

impl Set {
    /// The set whose words are `word(j, k, w)`.
    fn new(
        words: usize,
        rows: [usize; 2],
        check: Check<'_>,
        word: impl Fn(usize, usize, usize) -> u64 + Sync,
    ) -> Result<Self> {
        let mut bits: Vec<u64> = zeroed(words * rows[0] * rows[1], "words of the sets of thin voxels")?;
        bits.par_chunks_mut(words * rows[1]).enumerate().try_for_each(|(j, layer)| {
            check()?;
            for (k, row) in layer.chunks_mut(words).enumerate() {
                row.iter_mut().enumerate().for_each(|(w, out)| *out = word(j, k, w));
            }
            Ok(())
        })?;
        Ok(Self { words, rows, bits })
    }

    fn like(&self, check: Check<'_>, word: impl Fn(usize, usize, usize) -> u64 + Sync) -> Result<Self> {
        Self::new(self.words, self.rows, check, word)
    }

    #[inline]
    fn word(&self, j: usize, k: usize, w: usize) -> u64 {
        self.bits[(j * self.rows[1] + k) * self.words + w]
    }

    /// The word of the voxels `by` further on along an axis, fewer than 64; outside of the region there are none.
    #[inline]
    fn ahead(&self, [j, k, w]: [usize; 3], axis: usize, by: usize) -> u64 {
        match axis {
            0 if by == 0 => self.word(j, k, w),
            0 => {
                let next = if w + 1 < self.words { self.word(j, k, w + 1) } else { 0 };
                self.word(j, k, w) >> by | next << (64 - by)
            }
            1 if j + by < self.rows[0] => self.word(j + by, k, w),
            2 if k + by < self.rows[1] => self.word(j, k + by, w),
            _ => 0,
        }
    }

    /// The word of the voxels `by` further back along an axis.
    #[inline]
    fn behind(&self, [j, k, w]: [usize; 3], axis: usize, by: usize) -> u64 {
        match axis {
            0 if by == 0 => self.word(j, k, w),
            0 => {
                let next = if w > 0 { self.word(j, k, w - 1) } else { 0 };
                self.word(j, k, w) << by | next >> (64 - by)
            }
            1 if by <= j => self.word(j - by, k, w),
            2 if by <= k => self.word(j, k - by, w),
            _ => 0,
        }
    }

    fn is_empty(&self) -> bool {
        self.bits.par_iter().all(|&word| word == 0)
    }
}

/// The voxels of a region, and for each axis whether a voxel and the next one have the same label.
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
            let mut bits: Vec<u64> = zeroed(words * size[0] * size[1], "words of the sets of thin voxels")?;
            bits.par_chunks_mut(words * size[1]).enumerate().take(size[0] - step[1]).try_for_each(|(j, layer)| {
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
                            own.iter_mut().zip(pairs).for_each(|(flag, (a, b))| *flag = u8::from(a == b));
                        }
                    }
                    for (word, flags) in out.iter_mut().zip(flags.as_chunks::<64>().0) {
                        *word = gathered(flags);
                    }
                }
                Ok(())
            })?;
            Ok(Set { words, rows: size, bits })
        };
        Ok(Self { equal: [of_axis(0)?, of_axis(1)?, of_axis(2)?] })
    }

    /// The voxels in cubes of one label, of so many voxels along each axis.
    fn thick(&self, all: &Set, cube: [usize; 3], check: Check<'_>) -> Result<Set> {
        let mut set = all.clone();
        for (axis, &count) in cube.iter().enumerate() {
            let equal = &self.equal[axis];
            let runs = set.like(check, |j, k, w| {
                let at = [j, k, w];
                let same = (0..count - 1).fold(u64::MAX, |word, by| word & equal.ahead(at, axis, by));
                (0..count).fold(same, |word, by| word & set.ahead(at, axis, by))
            })?;
            set = runs;
        }
        for (axis, &count) in cube.iter().enumerate() {
            set = set.like(check, |j, k, w| (0..count).fold(0, |word, by| word | set.behind([j, k, w], axis, by)))?;
        }
        Ok(set)
    }

    /// A set and what lies up to `steps` further on, or back, along an axis, in runs of one label.
    fn spread(&self, set: &Set, axis: usize, steps: usize, forward: bool, check: Check<'_>) -> Result<Set> {
        let equal = &self.equal[axis];
        set.like(check, |j, k, w| {
            let at = [j, k, w];
            let mut same = u64::MAX;
            (1..=steps).fold(set.word(j, k, w), |word, by| {
                if forward {
                    same &= equal.behind(at, axis, by);
                    word | same & set.behind(at, axis, by)
                } else {
                    same &= equal.ahead(at, axis, by - 1);
                    word | same & set.ahead(at, axis, by)
                }
            })
        })
    }

    /// A set and what is within so many steps of it along each axis, one axis after the other, within its label.
    fn grown(&self, set: &Set, steps: [usize; 3], check: Check<'_>) -> Result<Set> {
        let mut grown = set.clone();
        for (axis, &count) in steps.iter().enumerate().filter(|&(_, &count)| count > 0) {
            let (on, back) =
                (self.spread(&grown, axis, count, true, check)?, self.spread(&grown, axis, count, false, check)?);
            grown = grown.like(check, |j, k, w| on.word(j, k, w) | back.word(j, k, w))?;
        }
        Ok(grown)
    }

    /// Of the voxels that are less than a cube thick, those that count; `None`: there are none.
    fn thin(&self, all: &Set, cube: [usize; 3], check: Check<'_>) -> Result<Option<Set>> {
        let thick = self.thick(all, cube, check)?;
        let thin = all.like(check, |j, k, w| all.word(j, k, w) & !thick.word(j, k, w))?;
        if thin.is_empty() {
            return Ok(None);
        }
        let near = cube.map(|count| count - 1);
        let beside = self.grown(&thick, near, check)?;
        let mut counts = thin.like(check, |j, k, w| thin.word(j, k, w) & !beside.word(j, k, w))?;
        // Longer ones have voxels that are far from both ends.
        let between = near.map(|steps| 2 * steps);
        for (axis, &steps) in between.iter().enumerate().filter(|&(_, &steps)| steps > 0) {
            let (on, back) =
                (self.spread(&thick, axis, steps, true, check)?, self.spread(&thick, axis, steps, false, check)?);
            counts = counts.like(check, |j, k, w| {
                counts.word(j, k, w) | thin.word(j, k, w) & on.word(j, k, w) & back.word(j, k, w)
            })?;
        }
        if counts.is_empty() {
            return Ok(None);
        }
        let around = self.grown(&counts, cube, check)?;
        thin.like(check, |j, k, w| thin.word(j, k, w) & around.word(j, k, w)).map(Some)
    }
}

/// What is thin in an image.
pub struct ThinVoxels {
    /// Where the region that holds all of it begins, in voxels of the image; may be -1.
    pub first: [isize; 3],
    /// Voxels of the region along each axis.
    pub dims: [usize; 3],
    /// Thicknesses, in world units, and the voxels that count and are of that thickness, by their numbers in the region: x fastest, then z, then y. Of several thicknesses of a voxel the least is its own.
    pub found: Vec<(f64, Vec<u32>)>,
}

/// Finds what is thinner than `most`, in world units. `check` is called for each plane of voxels and step, from several threads.
///
/// # Errors
/// [`crate::Error::EmptyImage`]; [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub fn thin_voxels(image: &LabelImage, most: f64, check: Check<'_>) -> Result<ThinVoxels> {
    let region = Region::new(image, check)?;
    let mut thin = ThinVoxels { first: region.first, dims: region.dims, found: Vec::new() };
    let spacing = image.frame().spacing();
    let unit = spacing.min_element();
    // What is less than this many voxels thick is thinner than `most`, if it is a whole number less one at most.
    let largest = sizes().take_while(|&count| thickness_below(count) as f64 * unit < most).last();
    let Some(largest) = largest else { return Ok(thin) };
    let rows = Rows::new(image, &region, check)?;
    let labels = Labels::new(&rows, largest, check)?;
    let [nx, ny, nz] = region.dims;
    let padded = nx + 2 * largest;
    let all = labels.equal[0]
        .like(check, |_, _, w| if 64 * (w + 1) <= padded { u64::MAX } else { (1 << (padded % 64)) - 1 })?;
    let contacts = contacts(&rows, &labels, largest, check)?;
    if !contacts.is_empty() {
        thin.found.push((unit, contacts));
    }
    for count in sizes().take_while(|&count| count <= largest) {
        let edge = count as f64 * unit;
        let cube = spacing.to_array().map(|side| (edge / side).round().max(1.0) as usize);
        let Some(set) = labels.thin(&all, cube, check)? else { continue };
        let layers = (0..ny).into_par_iter().map(|j| {
            let mut numbers = Vec::new();
            for k in 0..nz {
                for w in 0..set.words {
                    let word = set.word(j + largest, k + largest, w);
                    reserve(&mut numbers, word.count_ones() as usize, "thin voxels")?;
                    // What surrounds the region counts for nothing.
                    let inside = ones(word).map(|bit| (64 * w + bit).wrapping_sub(largest)).filter(|&i| i < nx);
                    numbers.extend(inside.map(|i| ((j * nz + k) * nx + i) as u32));
                }
            }
            Ok(numbers)
        });
        let layers: Vec<Vec<u32>> = layers.collect::<Result<_>>()?;
        let mut voxels = room(layers.iter().map(Vec::len).sum(), "thin voxels")?;
        layers.iter().for_each(|layer| voxels.extend_from_slice(layer));
        thin.found.push((thickness_below(count) as f64 * unit, voxels));
    }
    Ok(thin)
}

/// Voxels of a label, not background, that meet in an edge alone: two of the four around it, across from each other, while the others have other labels.
fn contacts(rows: &Rows, labels: &Labels, pad: usize, check: Check<'_>) -> Result<Vec<u32>> {
    let [nx, ny, nz] = rows.dims();
    let layers = (0..ny - 1).into_par_iter().map(|j| {
        check()?;
        let mut numbers = Vec::new();
        for k in 0..nz - 1 {
            let around = rows.around(j, k);
            for w in 0..labels.equal[0].words {
                let [x, y, z] = [0, 1, 2].map(|axis| !labels.equal[axis].word(j + pad, k + pad, w));
                // Whichever pair it is, the first corner differs from those beside it.
                for (candidates, u, v) in [(x & y, 1, 2), (y & z, 2, 4), (z & x, 4, 1)] {
                    for i in ones(candidates).map(|bit| (64 * w + bit).wrapping_sub(pad)).filter(|&i| i + 1 < nx) {
                        // Corner c of the cell from this voxel on, and its number in the region.
                        let id = |c: usize| around[c >> 1][i + (c & 1)];
                        let number = |c: usize| (((j + (c >> 1 & 1)) * nz + k + (c >> 2)) * nx + i + (c & 1)) as u32;
                        for (pair, beside) in [([0, u + v], [u, v]), ([u, v], [0, u + v])] {
                            let own = id(pair[0]);
                            if own != 0 && own == id(pair[1]) && beside.iter().all(|&c| id(c) != own) {
                                reserve(&mut numbers, 2, "thin voxels")?;
                                numbers.extend(pair.map(number));
                            }
                        }
                    }
                }
            }
        }
        Ok(numbers)
    });
    let layers: Vec<Vec<u32>> = layers.collect::<Result<_>>()?;
    Ok(layers.concat())
}

/// The places of the ones of a word, from the lowest on.
fn ones(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (place < 64).then_some(place)
    })
}

/// Edges of the cubes, in voxels: about a third apart, all from 2 to 4.
fn sizes() -> impl Iterator<Item = usize> {
    [2, 3, 4, 6, 8, 11, 16, 22, 32].into_iter()
}

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
        most: f64,
        label: impl Fn([usize; 3]) -> i32,
    ) -> Vec<(f64, Vec<[usize; 3]>)> {
        let half = dims.map(|n| (n as f64 - 1.0) / 2.0);
        let image = sampled(dims, spacing, |p| {
            let at = p.to_array();
            label([0, 1, 2].map(|a| (at[a] / spacing[a] + half[a]).round() as usize))
        });
        let ThinVoxels { first, dims: [nx, _, nz], found } = thin_voxels(&image.unwrap(), most, &|| Ok(())).unwrap();
        let place = |v: u32| {
            let v = v as usize;
            let at = [v % nx, v / nx / nz, v / nx % nz];
            [0, 1, 2].map(|a| (at[a] as isize + first[a]) as usize)
        };
        found
            .into_iter()
            .map(|(thickness, voxels)| {
                let mut voxels: Vec<_> = voxels.into_iter().map(place).collect();
                voxels.sort_unstable();
                voxels.dedup();
                (thickness, voxels)
            })
            .collect()
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
        assert!(slits.iter().any(|(thickness, voxels)| *thickness == 4.0 && voxels.contains(&[14, 14, 7])));
    }

    #[test]
    fn thickness_is_in_world_units() {
        // A sheet of one slice of thick slices is as thick as these.
        let label = |[i, j, k]: [usize; 3]| i32::from(k == 3 && (2..28).contains(&i) && (2..28).contains(&j));
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
            let block = |x: usize, y: usize| (x..x + 4).contains(&i) && (y..y + 4).contains(&j) && (2..6).contains(&k);
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
