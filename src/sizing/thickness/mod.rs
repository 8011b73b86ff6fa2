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
//! **Throats.** Where the corners of two bodies face each other, what is between them may be narrow
//! though each of its voxels is thick: one cube holds it on the one side, another one on the other.
//! A *throat* less than m thick is a plate of one label, m voxels along two axes and one along the
//! third, that no cube of m voxels holds, though all of its voxels are in cubes about twice as
//! large. Its voxels count as less than m thick. A plate within a half-space is held by a cube. If
//! throats did not count, samples could be as far apart as on the thick parts, and join the two
//! bodies. They are looked for up to half of the largest cube.
//!
//! The background is a label like others here: a slit between two objects is thin as well. Beyond
//! walls it goes on straight from the outermost voxels, as the model does there: what a label
//! surrounds at a wall is narrow, though it is open outwards. Labels end at walls.
//!
//! All of this is done for all labels at once, with sets of voxels as bits, 64 in a word: a bit for
//! each pair of neighbours that says whether they have the same label is all that is asked of
//! labels.
//!
//! Cost: about a nanosecond per voxel and level. Memory while it lasts: seven bits per voxel of the
//! region with as many voxels more on each side as the largest cube has along an axis, up to 32, in
//! rows of whole words; beside these a byte per voxel of the region, where anything is thin.

mod necks;
mod runs;

use std::ops::Range;

use rayon::prelude::*;

use crate::Result;
use crate::image::LabelImage;
use crate::image::bits::ones;
use crate::image::region::{Region, Rows};
use crate::memory::filled;
use necks::contacts;
use runs::{Check, Labels, Padded, Set, both, either};

impl Labels {
    /// Makes the first set those voxels of `all`, the words of a block, that are less than a cube
    /// thick and count; the second one is those that are a cube thick. Whether there are any.
    fn thin(
        &self,
        all: &[u64],
        cube: [usize; 3],
        sets: &mut [Set; 4],
        check: Check<'_>,
    ) -> Result<bool> {
        let [counts, thick, thin, spare] = sets;
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

/// What is thin in an image.
pub struct ThinVoxels {
    /// The region that holds all of it.
    pub region: Region,
    /// The thicknesses that were looked for, in world units, increasing.
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

    /// The table of the voxels' thicknesses, which is made when it is asked for first.
    fn table(&mut self, check: Check<'_>) -> Result<&mut [u8]> {
        if self.of_voxels.is_empty() {
            self.of_voxels =
                filled(self.region.dims.iter().product(), NOT_THIN, "voxels of the region", check)?;
        }
        Ok(&mut self.of_voxels)
    }
}

/// Gives voxels the thickness of a number, where they have no lower one.
fn lower(voxels: &mut [u8], number: usize) {
    voxels.iter_mut().for_each(|voxel| *voxel = (*voxel).min(number as u8));
}

/// What joins parts of a label: two of its voxels that meet in an edge or a corner alone, and
/// throats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Necks {
    /// Counts as thin: as one voxel where voxels meet.
    Thin,
    /// Counts as what it belongs to.
    Ignored,
}

/// Finds what is thinner than `max`, in world units; what holds cubes of [`LARGEST`] of the
/// smallest sides of a voxel is not searched for, however large `max` is. `check` is called many
/// times in each step, from several threads. `has_walls`: whether the image ends with walls, beyond
/// which background goes on.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; whatever `check` returns.
pub fn thin_voxels(
    image: &LabelImage,
    rows: &Rows,
    max: f64,
    necks: Necks,
    has_walls: bool,
    check: Check<'_>,
) -> Result<ThinVoxels> {
    let region = *rows.region();
    let mut thin = ThinVoxels::none(region);
    let spacing = image.frame().spacing();
    let unit = spacing.min_element();
    let Some(largest) = largest_cube(unit, max) else { return Ok(thin) };
    let padded = Padded::new(image, rows, has_walls, largest);
    let labels = Labels::new(&padded, check)?;
    let [nx, _, nz] = region.dims;
    let (words, along) = (labels.equal[0].words, nx + 2 * largest);
    let of_row = |w: usize| if 64 * (w + 1) <= along { u64::MAX } else { (1 << (along % 64)) - 1 };
    let all: Vec<u64> = (0..labels.equal[0].block()).map(|n| of_row(n % words)).collect();
    if necks == Necks::Thin {
        for v in contacts(rows, &labels, &all, largest, check)? {
            lower(&mut thin.table(check)?[v as usize..][..1], 0);
        }
    }
    let set = || Set::new(words, labels.equal[0].rows);
    let mut sets = [set()?, set()?, set()?, set()?];
    debug_assert_eq!(SETS, labels.equal.len() + sets.len());
    // The cubes of the last two sizes.
    let mut smaller: [Option<[usize; 3]>; 2] = [None; 2];
    for (number, count) in sizes().take_while(|&count| count <= largest).enumerate() {
        thin.thicknesses.push(thickness_below(count) as f64 * unit);
        let edge = count as f64 * unit;
        let cube = spacing.to_array().map(|side| (edge / side).round().max(1.0) as usize);
        let [spare, thick, first, second] = &mut sets;
        labels.thick(&all, cube, thick, spare, check)?;
        if let Some(half) = smaller[0]
            && necks == Necks::Thin
        {
            let sets = [spare, first, second];
            labels.throats(&all, half, thick, sets, check, |at, plate| {
                let [x, y, z] = [0, 1, 2].map(|a| {
                    // What is around the region, or beyond a wall, counts for nothing.
                    let Range { start, end } = padded.within[a];
                    let inside = |at: usize| at.saturating_sub(largest).clamp(start, end);
                    inside(at[a])..inside(at[a] + plate[a])
                });
                let table = thin.table(check)?;
                for row in y.flat_map(|j| z.clone().map(move |k| (j * nz + k) * nx)) {
                    lower(&mut table[row + x.start..row + x.end], number - smaller.len());
                }
                Ok(())
            })?;
        }
        smaller = [smaller[1], Some(cube)];
        if !labels.thin(&all, cube, &mut sets, check)? {
            continue;
        }
        let [set, ..] = &sets;
        let table = thin.table(check)?;
        let [along, across, through] = &padded.within;
        table.par_chunks_mut(nx * nz).enumerate().for_each(|(j, layer)| {
            let is_within = |k| across.contains(&j) && through.contains(&k);
            for (k, voxels) in layer.chunks_mut(nx).enumerate().filter(|&(k, _)| is_within(k)) {
                for (w, &word) in set.row(j + largest, k + largest).iter().enumerate() {
                    let inside = ones(word)
                        .map(|bit| (64 * w + bit).wrapping_sub(largest))
                        .filter(|i| along.contains(i));
                    inside.for_each(|i| lower(&mut voxels[i..=i], number));
                }
            }
        });
    }
    // Perhaps nothing is thin but what is beyond walls.
    if thin.of_voxels.par_iter().all(|&voxel| voxel == NOT_THIN) {
        thin.of_voxels = Vec::new();
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
    use proptest::prelude::*;

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
        let thin = thin_voxels(&image, &rows, max, Necks::Thin, true, &|| Ok(())).unwrap();
        let Region { first, dims: [nx, _, nz] } = thin.region;
        let place = |v: usize| {
            let at = [v % nx, v / nx / nz, v / nx % nz];
            [0, 1, 2].map(|a| (at[a] as isize + first[a]) as usize)
        };
        let voxels_of = |number: usize| {
            let voxels =
                thin.of_voxels.iter().enumerate().filter(|&(_, &of)| usize::from(of) == number);
            voxels.map(|(v, _)| place(v)).collect::<Vec<_>>()
        };
        let found = thin.thicknesses.iter().enumerate();
        found
            .map(|(number, &thickness)| (thickness, voxels_of(number)))
            .filter(|(_, voxels)| !voxels.is_empty())
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
    fn throats_count() {
        // Two blocks whose corners face each other across so many voxels.
        for width in 1..4 {
            let label = |[i, j, k]: [usize; 3]| {
                let below = i < 12 && j < 12 && (2..12).contains(&k);
                let above = i >= 12 && j >= 12 && (12 + width..22 + width).contains(&k);
                i32::from((2..24).contains(&i) && (2..24).contains(&j) && (below || above))
            };
            let found = thin([26, 26, 28], [1.0; 3], 8.0, label);
            let (thickness, voxels) = &found[0];
            assert_eq!(*thickness, width as f64);
            let between = |at: &[usize; 3]| (12..12 + width).contains(&at[2]);
            assert!(voxels.contains(&[11, 11, 12]) && voxels.contains(&[12, 12, 12]), "{voxels:?}");
            assert!(voxels.iter().all(between), "{width}: {voxels:?}");
        }
        // One that is to the side of the other is joined to it by nothing.
        let label = |[i, j, k]: [usize; 3]| {
            i32::from((2..22).contains(&j) && [2..8, 16..22][usize::from(k > 11)].contains(&i))
        };
        assert_eq!(thin([24, 24, 24], [1.0; 3], 6.0, label), []);
    }

    #[test]
    fn walls_bound_labels_and_background_goes_on() {
        // A label fills the image but for a pit at the wall below, and lies flat at the wall above.
        let label = |[i, j, k]: [usize; 3]| match k {
            0 if [i, j] == [9, 9] => 0,
            19 => 2,
            _ => 1,
        };
        let found = thin([20; 3], [1.0; 3], 4.0, label);
        assert_eq!(found.len(), 1, "{found:?}");
        let (thickness, voxels) = &found[0];
        assert_eq!(*thickness, 1.0);
        let pit = voxels.iter().filter(|at| at[2] < 19);
        assert_eq!(pit.collect::<Vec<_>>(), [&[9, 9, 0]]);
        assert_eq!(voxels.len(), 1 + 20 * 20);
        // Background between a body and a wall is not thin.
        let label = |at: [usize; 3]| i32::from(at.iter().all(|x| (1..18).contains(x)));
        assert_eq!(thin([20; 3], [1.0; 3], 4.0, label), []);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]

        #[test]
        fn plane_interfaces_are_not_thin(normal in prop::array::uniform3(-1.0..1.0)) {
            let label = |at: [usize; 3]| {
                let along = |a: usize| normal[a] * (at[a] as f64 - 20.0);
                1 + i32::from(along(0) + along(1) + along(2) > 0.0)
            };
            let found = thin([40; 3], [1.0, 1.0, 1.6], 8.0, label);
            // Where the image ends both sides are wedges.
            let inside = |at: &[usize; 3]| at.iter().all(|x| (12..28).contains(x));
            prop_assert!(found.iter().all(|(_, voxels)| !voxels.iter().any(inside)));
        }
    }

    #[test]
    fn nothing_is_thin_for_dense_samples() {
        assert_eq!(thin([8, 8, 8], [1.0; 3], 0.9, |[_, _, k]| i32::from(k == 4)), []);
    }
}
