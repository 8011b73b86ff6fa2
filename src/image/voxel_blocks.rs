//! Sets of blocks of a region's voxels: where something has changed.
//!
//! A block is a brick (`bricks`): a cube of voxels, with all points that are nearest to one of
//! these. What lies beyond the region belongs to the blocks at its rim. Many threads may add blocks
//! at the same time.
//!
//! Memory: a bit per block. A box is looked up row by row along x, 64 blocks at a time.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::DVec3;

use super::bits::{masks, ones};
use super::bricks::Bricks;
use super::region::Region;
use super::{Frame, Grid};
use crate::Result;
use crate::memory::zeroed;

/// A set of blocks.
#[derive(Debug)]
pub struct VoxelBlocks {
    grid: Grid,
    /// How many blocks there are along each axis.
    counts: [usize; 3],
    /// Words of a row of blocks.
    row_words: usize,
    /// Rows along x, z fastest: as the oracle numbers rows. Relaxed: whoever reads them has met all
    /// who wrote.
    words: Vec<AtomicU64>,
}

impl VoxelBlocks {
    /// Blocks reach so far beyond their voxels, in voxels: what is that near to a change counts as
    /// changed. More than rounding, and than vertices on contacts are away from these.
    const MARGIN: f64 = 0.1;

    /// No block of a region.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn none(frame: &Frame, region: &Region) -> Result<Self> {
        let counts = region.dims.map(|n| n.div_ceil(Bricks::EDGE));
        let row_words = counts[0].div_ceil(64);
        let words = zeroed(row_words * counts[1] * counts[2], "blocks of voxels")?;
        Ok(Self { grid: Grid::new(frame, region), counts, row_words, words })
    }

    /// Adds the block of a voxel of the region.
    pub fn add_voxel(&self, voxel: [usize; 3]) {
        let [x, y, z] = voxel.map(|c| c / Bricks::EDGE);
        self.row([y, z])[x / 64].fetch_or(1 << (x % 64), Relaxed);
    }

    /// Adds blocks of the same region.
    pub fn add_blocks(&self, others: &Self) {
        for (word, other) in self.words.iter().zip(&others.words) {
            word.fetch_or(other.load(Relaxed), Relaxed);
        }
    }

    /// Adds the blocks of a box around points of the world.
    pub fn add_around<const N: usize>(&self, points: [DVec3; N]) {
        self.add_box(self.around(points));
    }

    /// Whether a block meets such a box.
    #[inline]
    pub fn meet_around<const N: usize>(&self, points: [DVec3; N]) -> bool {
        self.meet(self.around(points))
    }

    /// The box around points of the world, in voxels of the region.
    #[inline]
    fn around<const N: usize>(&self, points: [DVec3; N]) -> [DVec3; 2] {
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let at = points.map(|p| self.grid.index_at(p)).into_iter();
        at.fold(none, |[low, high], at| [low.min(at), high.max(at)])
    }

    /// Adds the blocks of a box, given by its corners in voxels of the region.
    pub fn add_box(&self, [low, high]: [DVec3; 2]) {
        self.add(self.within(low, high));
    }

    /// Adds all blocks.
    pub fn add_all(&self) {
        self.add(self.counts.map(|count| 0..count));
    }

    fn add(&self, [along_x, rest @ ..]: [Range<usize>; 3]) {
        self.visit_rows(rest, |row| {
            for (word, mask) in masks(&along_x) {
                // Most are there already.
                if row[word].load(Relaxed) & mask != mask {
                    row[word].fetch_or(mask, Relaxed);
                }
            }
            false
        });
    }

    /// These blocks, and those around them.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn and_around(self) -> Result<NearBlocks> {
        let words = zeroed(self.words.len(), "blocks of voxels")?;
        let Self { counts, row_words, .. } = self;
        let near = Self { grid: self.grid.clone(), counts, row_words, words };
        self.all().for_each(|block| {
            near.add(
                [0, 1, 2].map(|a| block[a].saturating_sub(1)..(block[a] + 2).min(self.counts[a])),
            );
        });
        let largest = (Bricks::EDGE as f64 - Self::MARGIN) * near.grid.spacing.min_element();
        Ok(NearBlocks { blocks: self, near, largest_squared: largest * largest })
    }

    /// Whether there are all blocks of such a box.
    pub fn hold(&self, [low, high]: [DVec3; 2]) -> bool {
        let [along_x, rest @ ..] = self.within(low, high);
        let lacks = |row: &[AtomicU64]| {
            masks(&along_x).any(|(word, mask)| row[word].load(Relaxed) & mask != mask)
        };
        !self.visit_rows(rest, lacks)
    }

    /// Whether there is the block of a point, in voxels of the region.
    pub fn has(&self, index: DVec3) -> bool {
        self.has_voxel(self.grid.voxel(self.grid.inside(index)))
    }

    /// Whether there is the block of a voxel of the region.
    pub fn has_voxel(&self, voxel: [usize; 3]) -> bool {
        let [x, y, z] = voxel.map(|c| c / Bricks::EDGE);
        self.row([y, z])[x / 64].load(Relaxed) >> (x % 64) & 1 == 1
    }

    /// Whether there is a block in a row of bricks along x, as the oracle numbers them.
    pub fn has_in_row(&self, row: usize) -> bool {
        self.words[self.row_words * row..][..self.row_words].iter().any(|w| w.load(Relaxed) != 0)
    }

    /// Calls `visit` for each run of voxels along x that a block, made larger by `beyond` voxels on
    /// all sides, has: where it begins, and how many voxels it has.
    ///
    /// # Errors
    /// The first of `visit`, which ends the visit.
    pub fn try_visit_voxels(
        &self,
        beyond: usize,
        mut visit: impl FnMut([usize; 3], usize) -> Result<()>,
    ) -> Result<()> {
        let dims = self.grid.bricks.dims();
        self.all().try_for_each(|block| {
            let [xs, ys, mut zs] = [0, 1, 2].map(|a| {
                let first = Bricks::EDGE * block[a];
                first.saturating_sub(beyond)..(first + Bricks::EDGE + beyond).min(dims[a])
            });
            zs.try_for_each(|z| ys.clone().try_for_each(|y| visit([xs.start, y, z], xs.len())))
        })
    }

    /// All blocks, in the order of the rows.
    fn all(&self) -> impl Iterator<Item = [usize; 3]> {
        let rows = self.words.chunks(self.row_words).enumerate();
        rows.flat_map(move |(row, words)| {
            let [y, z] = [row / self.counts[2], row % self.counts[2]];
            let words = words.iter().enumerate();
            words.flat_map(move |(n, word)| {
                ones(word.load(Relaxed)).map(move |x| [64 * n + x, y, z])
            })
        })
    }

    /// Whether a block meets a box, given by its corners in voxels of the region.
    #[inline]
    pub fn meet(&self, [low, high]: [DVec3; 2]) -> bool {
        let [along_x, rest @ ..] = self.within(low, high);
        self.visit_rows(rest, |row| {
            masks(&along_x).any(|(word, mask)| row[word].load(Relaxed) & mask != 0)
        })
    }

    /// The blocks along each axis of a box, in voxels of the region.
    #[inline]
    fn within(&self, low: DVec3, high: DVec3) -> [Range<usize>; 3] {
        let [low, high] = [low - Self::MARGIN, high + Self::MARGIN]
            .map(|at| self.grid.voxel(self.grid.inside(at)).map(|voxel| voxel / Bricks::EDGE));
        [0, 1, 2].map(|a| low[a]..high[a] + 1)
    }

    /// Calls `visit` for these rows, until it says `true`: then so does this.
    #[inline]
    fn visit_rows(
        &self,
        [ys, zs]: [Range<usize>; 2],
        visit: impl Fn(&[AtomicU64]) -> bool,
    ) -> bool {
        ys.into_iter().any(|y| zs.clone().any(|z| visit(self.row([y, z]))))
    }

    #[inline]
    fn row(&self, [y, z]: [usize; 2]) -> &[AtomicU64] {
        &self.words[self.row_words * (y * self.counts[2] + z)..][..self.row_words]
    }
}

/// Blocks, and with them those around each, so that what is far from them is soon known to be.
#[derive(Debug)]
pub struct NearBlocks {
    blocks: VoxelBlocks,
    near: VoxelBlocks,
    /// A ball of this squared radius, or less, that meets one of the blocks has its centre in one
    /// of those around.
    largest_squared: f64,
}

impl NearBlocks {
    /// Up to this part of the region they are few. Measured (docs/notes/sampling.md).
    const FEW: f64 = 1.0 / 128.0;

    /// Whether they are so few that what is near to them is found sooner by going there than by
    /// going through all.
    pub fn are_few(&self) -> bool {
        self.part() <= Self::FEW
    }

    /// The part of the region's blocks that they are.
    pub fn part(&self) -> f64 {
        let count: u32 = self.blocks.words.iter().map(|word| word.load(Relaxed).count_ones()).sum();
        let all: usize = self.blocks.counts.iter().product();
        f64::from(count) / all as f64
    }

    /// A point of the world in each.
    pub fn points(&self) -> impl Iterator<Item = DVec3> {
        let first = |block: [usize; 3]| DVec3::from(block.map(|n| (Bricks::EDGE * n) as f64));
        self.blocks.all().map(move |block| self.blocks.grid.point_at(first(block)))
    }

    /// The blocks.
    pub fn blocks(&self) -> &VoxelBlocks {
        &self.blocks
    }

    /// The blocks, and those around them.
    pub fn near(&self) -> &VoxelBlocks {
        &self.near
    }

    /// Whether a block may meet a ball of the world, whose squared radius may be infinite.
    #[inline]
    pub fn meet_ball(&self, center: DVec3, squared_radius: f64) -> bool {
        let at = self.blocks.grid.index_at(center);
        if squared_radius <= self.largest_squared && !self.near.has(at) {
            return false;
        }
        // Image axes are orthonormal.
        let reach = squared_radius.sqrt() / self.blocks.grid.spacing;
        self.blocks.meet([at - reach, at + reach])
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    const REGION: Region = Region { first: [2, -1, 0], dims: [274, 9, 14] };

    fn frame() -> Frame {
        Frame::new(
            [1.0, -2.0, 0.5],
            [0.5, 2.0, 1.0],
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        )
        .unwrap()
    }

    /// The blocks that a box of voxels meets.
    fn of_box(low: DVec3, high: DVec3) -> BTreeSet<[usize; 3]> {
        let block = |at: DVec3, by: f64| {
            [0, 1, 2].map(|a| {
                let last = REGION.dims[a] as f64 - 1.0;
                (at[a] + by).clamp(0.0, last).round() as usize / Bricks::EDGE
            })
        };
        let (low, high) = (block(low, -VoxelBlocks::MARGIN), block(high, VoxelBlocks::MARGIN));
        let range = |a: usize| low[a]..=high[a];
        let of_row = |y, z| range(0).map(move |x| [x, y, z]);
        range(1).flat_map(|y| range(2).flat_map(move |z| of_row(y, z))).collect()
    }

    proptest! {
        #[test]
        fn blocks_are_found_where_they_were_added(
            boxes in prop::collection::vec(
                prop::array::uniform2(prop::array::uniform3(-0.2..1.2_f64)), 0..5),
            (center, radius) in (prop::array::uniform3(-0.2..1.2_f64), 0.0..9.0_f64),
        ) {
            let dims = DVec3::from(REGION.dims.map(|n| n as f64));
            let first = DVec3::from(REGION.first.map(|c| c as f64));
            let blocks = VoxelBlocks::none(&frame(), &REGION).unwrap();
            let mut expected = BTreeSet::new();
            for corners in boxes {
                let [a, b] = corners.map(|at| DVec3::from(at) * dims);
                blocks.add_around([a, b].map(|at| frame().to_world(first + at)));
                expected.append(&mut of_box(a.min(b), a.max(b)));
            }
            let mut found = BTreeSet::new();
            let mut voxels = 0;
            blocks.try_visit_voxels(0, |at, count| {
                found.insert(at.map(|c| c / Bricks::EDGE));
                voxels += count;
                assert!(blocks.has_voxel(at) && at[0] + count <= REGION.dims[0]);
                Ok(())
            }).unwrap();
            prop_assert_eq!(&found, &expected);
            let of_block = |block: &[usize; 3]| {
                let along = |a: usize| Bricks::EDGE.min(REGION.dims[a] - Bricks::EDGE * block[a]);
                (0..3).map(along).product::<usize>()
            };
            prop_assert_eq!(voxels, expected.iter().map(of_block).sum::<usize>());

            let at = DVec3::from(center) * dims;
            let reach = radius / frame().spacing();
            let in_ball = !of_box(at - reach, at + reach).is_disjoint(&expected);
            let p = frame().to_world(first + at);
            let blocks = blocks.and_around().unwrap();
            prop_assert_eq!(blocks.meet_ball(p, radius * radius), in_ball);
            prop_assert_eq!(blocks.meet_ball(p, f64::INFINITY), !expected.is_empty());
            let bounds = [at - reach, at + reach];
            let of_point = |p: DVec3| {
                let voxel = frame().to_index(p) - first;
                [0, 1, 2].map(|a| voxel[a].round() as usize / Bricks::EDGE)
            };
            prop_assert!(blocks.points().map(of_point).eq(blocks.blocks().all()));
            let all = REGION.dims.map(|n| n.div_ceil(Bricks::EDGE)).iter().product::<usize>();
            let are_few = expected.len() as f64 <= NearBlocks::FEW * all as f64;
            prop_assert_eq!(blocks.are_few(), are_few);
            let held = of_box(bounds[0], bounds[1]).is_subset(&expected);
            prop_assert_eq!(blocks.blocks().hold(bounds), held);

            let mut grown = vec![false; REGION.dims.iter().product()];
            let [nx, ny, _] = REGION.dims;
            blocks.blocks().try_visit_voxels(1, |[x, y, z], count| {
                grown[x + nx * (y + ny * z)..][..count].fill(true);
                Ok(())
            }).unwrap();
            for (v, grown) in grown.into_iter().enumerate() {
                let voxel = [v % nx, v / nx % ny, v / (nx * ny)];
                let is_beside = |block: &[usize; 3]| (0..3).all(|a| {
                    let first = Bricks::EDGE * block[a];
                    (first..first + Bricks::EDGE + 2).contains(&(voxel[a] + 1))
                });
                prop_assert_eq!(grown, expected.iter().any(is_beside));
            }

            let counts = REGION.dims.map(|n| n.div_ceil(Bricks::EDGE));
            for row in 0..counts[1] * counts[2] {
                let [y, z] = [row / counts[2], row % counts[2]];
                let mut any = false;
                for x in 0..counts[0] {
                    let is_around =
                        |at: &[usize; 3]| (0..3).all(|a| at[a].abs_diff([x, y, z][a]) <= 1);
                    let is_near = expected.iter().any(is_around);
                    let voxel = [x, y, z].map(|c| Bricks::EDGE * c);
                    prop_assert_eq!(blocks.near().has_voxel(voxel), is_near);
                    any |= is_near;
                }
                prop_assert_eq!(blocks.near().has_in_row(row), any);
            }
        }
    }

    #[test]
    fn all_blocks_are_those_of_all_voxels() {
        let blocks = VoxelBlocks::none(&frame(), &REGION).unwrap();
        blocks.add_all();
        let mut voxels = 0;
        let count = |_, count| {
            voxels += count;
            Ok(())
        };
        blocks.try_visit_voxels(0, count).unwrap();
        assert_eq!(voxels, REGION.dims.iter().product::<usize>());
    }
}
