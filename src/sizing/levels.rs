//! A length for each voxel of a region, in a byte, graded.
//!
//! A byte counts steps from the least length on: [`Scale`]. A [`Table`] has one for each voxel, and
//! is constant within a voxel. Rows that are not in bricks yet are x fastest, then z, then y.
//!
//! Cost: a few nanoseconds per voxel; a question is one load. Memory: a byte per voxel.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::image::bricks::Bricks;
use crate::image::region::Region;
use crate::image::{Frame, Grid};
use crate::memory::zeroed;

/// The largest level.
pub(super) const LEVELS: u8 = u8::MAX;

/// What a level stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// The least length.
    pub(super) min: f64,
    /// What each level adds to it.
    pub(super) step: f64,
}

impl Scale {
    /// The same length for every level.
    pub(super) fn uniform(length: f64) -> Self {
        Self { min: length, step: 0.0 }
    }

    /// From one length to a larger one.
    pub(super) fn between(min: f64, max: f64) -> Self {
        Self { min, step: (max - min) / f64::from(LEVELS) }
    }

    /// The last level that is no longer than `length`, but the first at least.
    pub(super) fn level(&self, length: f64) -> u8 {
        ((length - self.min) / self.step).clamp(0.0, f64::from(LEVELS)) as u8
    }

    #[inline(always)]
    pub(super) fn length(&self, level: u8) -> f64 {
        self.min + self.step * f64::from(level)
    }

    /// By how many levels neighbours along each axis may differ where lengths grow by `grading` per
    /// distance.
    pub(super) fn growth(&self, grading: f64, spacing: DVec3) -> [u8; 3] {
        [0, 1, 2].map(|a| (grading * spacing[a] / self.step).clamp(1.0, f64::from(LEVELS)) as u8)
    }
}

/// Levels of the voxels of a region, in bricks of one cache line: who asks about one place asks
/// about others nearby.
#[derive(Debug)]
pub(super) struct Table {
    grid: Grid,
    levels: Vec<u8>,
}

impl Table {
    /// Of levels in rows.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub(super) fn new(frame: &Frame, region: &Region, levels: &[u8]) -> Result<Self> {
        let grid = Grid::new(frame, region);
        let levels = in_bricks(levels, &grid.bricks)?;
        Ok(Self { grid, levels })
    }

    /// Where its voxels are.
    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The level at `p`.
    #[inline(always)]
    pub(super) fn at(&self, p: DVec3) -> u8 {
        // Outside of the region there is nothing to sample; NaN falls to 0.
        let [i, j, k] = self.grid.voxel(self.grid.inside(self.grid.index_at(p)));
        self.of_voxel([i, j, k])
    }

    /// The level of a voxel of the region.
    #[inline]
    pub(super) fn of_voxel(&self, [i, j, k]: [usize; 3]) -> u8 {
        self.levels[self.grid.bricks.index(i, j, k)]
    }

    /// All levels, in bricks.
    pub(super) fn levels(&self) -> &[u8] {
        &self.levels
    }

    /// The levels of each brick.
    pub(super) fn bricks(&self) -> impl IndexedParallelIterator<Item = &[u8]> {
        self.levels.par_chunks(Bricks::VOLUME)
    }

    /// The voxel of the region at a place of all levels; `None` where a brick reaches beyond it.
    pub(super) fn voxel(&self, at: usize) -> Option<[usize; 3]> {
        let (voxel, dims) = (self.grid.bricks.voxel(at), self.grid.bricks.dims());
        (0..3).all(|a| voxel[a] < dims[a]).then_some(voxel)
    }
}

/// Levels of rows, x fastest, then z, then y, in bricks.
fn in_bricks(levels: &[u8], bricks: &Bricks) -> Result<Vec<u8>> {
    let [nx, ny, nz] = bricks.dims();
    let mut placed = zeroed(bricks.len(), "voxels of the sizing field")?;
    placed.par_chunks_mut(bricks.layer()).enumerate().for_each(|(n, placed)| {
        for y in (n * Bricks::EDGE..ny).take(Bricks::EDGE) {
            for z in 0..nz {
                let row = &levels[nx * (z + nz * y)..][..nx];
                let at = bricks.index(0, y, z) - n * bricks.layer();
                for (x, along_x) in row.chunks(Bricks::EDGE).enumerate() {
                    placed[at + bricks.x(x * Bricks::EDGE)..][..along_x.len()]
                        .copy_from_slice(along_x);
                }
            }
        }
    });
    Ok(placed)
}

/// Gives each voxel the least level of the 27 around it.
pub(super) fn widen(levels: &mut [u8], row: usize, layer: usize) {
    levels.par_chunks_mut(layer).for_each(|layer| {
        let mut rows: Vec<&mut [u8]> = layer.chunks_mut(row).collect();
        for row in &mut rows {
            let mut before = LEVELS;
            for x in 0..row.len() {
                let (here, after) = (row[x], row.get(x + 1).copied().unwrap_or(LEVELS));
                row[x] = before.min(here).min(after);
                before = here;
            }
        }
        min_of_three(&mut rows);
    });
    across_layers(levels, layer, min_of_three);
}

/// Lowers levels until none is above a neighbour's by more than the growth along that axis: along
/// x, along z and along y, each to and fro, which is exact for distances along the axes.
pub(super) fn grade(levels: &mut [u8], [nx, _, nz]: [usize; 3], growth: [u8; 3]) {
    let layer = nx * nz;
    levels.par_chunks_mut(layer).for_each(|layer| {
        let mut rows: Vec<&mut [u8]> = layer.chunks_mut(nx).collect();
        // Most rows are the same all along.
        for row in rows.iter_mut().filter(|row| row.iter().any(|level| *level != row[0])) {
            let lower = |before: u8, level: &mut u8| {
                *level = (*level).min(before.saturating_add(growth[0]));
                *level
            };
            row.iter_mut().fold(LEVELS, lower);
            row.iter_mut().rev().fold(LEVELS, lower);
        }
        sweep(&mut rows, growth[2]);
    });
    across_layers(levels, layer, |parts| sweep(parts, growth[1]));
}

/// Does something with the parts that lie above each other in all layers, for parts that fit into a
/// cache, in parallel.
fn across_layers(levels: &mut [u8], layer: usize, work: impl Fn(&mut [&mut [u8]]) + Sync) {
    const PART: usize = 1 << 11;
    let mut columns: Vec<Vec<&mut [u8]>> = (0..layer.div_ceil(PART)).map(|_| Vec::new()).collect();
    for layer in levels.chunks_mut(layer) {
        columns.iter_mut().zip(layer.chunks_mut(PART)).for_each(|(column, part)| column.push(part));
    }
    columns.par_iter_mut().for_each(|column| work(column));
}

/// Gives each element the least of itself and those at its place in the rows before and behind.
fn min_of_three(rows: &mut [&mut [u8]]) {
    let min = |to: &mut [u8], from: &[u8]| {
        to.iter_mut().zip(from).for_each(|(to, &from)| *to = (*to).min(from))
    };
    let (mut before, mut here) = (Vec::new(), Vec::new());
    for at in 0..rows.len() {
        let (own, behind) = rows[at..].split_at_mut(1);
        here.clear();
        here.extend_from_slice(own[0]);
        min(own[0], &before);
        if let Some(behind) = behind.first() {
            min(own[0], behind);
        }
        std::mem::swap(&mut before, &mut here);
    }
}

/// Lets no element be above the one at its place in the row before, or behind, by more than
/// `growth`.
fn sweep(rows: &mut [&mut [u8]], growth: u8) {
    let lower = |to: &mut [u8], from: &[u8]| {
        to.iter_mut()
            .zip(from)
            .for_each(|(to, &from)| *to = (*to).min(from.saturating_add(growth)));
    };
    for at in 1..rows.len() {
        let (before, behind) = rows.split_at_mut(at);
        lower(behind[0], before[at - 1]);
    }
    for at in (1..rows.len()).rev() {
        let (before, behind) = rows.split_at_mut(at);
        lower(before[at - 1], behind[0]);
    }
}
