//! Tiles of the image, which are sampled side by side.
//!
//! A tile is a range of layers of bricks along y and one along z, whole along x. Its *colour* is
//! which of its two numbers are odd, so no two of one colour are beside each other: whoever works
//! on the tiles in the order of their colours, each after those beside it of a lower one, has the
//! same result whatever the number of threads. What is found in the rows of two tiles that are not
//! beside each other is apart by the distance that was asked for.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering::AcqRel};

use glam::DVec3;
use rayon::Scope;

use super::edges::EdgeGrid;
use crate::image::bricks::Bricks;
use crate::{Error, Result};

/// Least layers of bricks of a tile, along y and z: smaller ones have more to learn from their
/// neighbours than there are threads to gain.
const MIN_LAYERS: [usize; 2] = [2, 8];

/// How far, in voxels, what is found in a row may be outside of its voxels: the sides of narrow
/// voxels come from the voxel behind them, up to a voxel before it, and are moved a little.
const BEYOND: f64 = 1.1;

/// A division of an [`EdgeGrid`]'s rows.
pub struct Tiles {
    /// Layers of bricks along z: the rows of one layer along y.
    per_layer: usize,
    /// Ranges of layers along y, and along z.
    ranges: [Vec<Range<usize>>; 2],
    /// World boxes of the tiles.
    bounds: Vec<[DVec3; 2]>,
}

impl EdgeGrid<'_> {
    /// Cuts the rows into tiles; what is found in those that are not beside each other is `apart`
    /// in world units at least. All but the last along an axis are equally thick.
    pub fn tiles(&self, apart: f64) -> Tiles {
        let oracle = self.oracle;
        let dims = oracle.grid.bricks.dims();
        let layers = [1, 2].map(|axis| dims[axis].div_ceil(Bricks::EDGE));
        let ranges = [0, 1].map(|n| {
            let voxels = apart / oracle.grid.spacing[n + 1] + 2.0 * BEYOND;
            let min = MIN_LAYERS[n].min(layers[n]);
            let thick = ((voxels / Bricks::EDGE as f64).ceil() as usize).clamp(min, layers[n]);
            (0..layers[n])
                .step_by(thick)
                .map(|first| first..(first + thick).min(layers[n]))
                .collect()
        });
        let [along_y, along_z]: &[Vec<Range<usize>>; 2] = &ranges;
        let box_of = |[y, z]: [&Range<usize>; 2]| {
            let (mut lower, mut upper) = (DVec3::ZERO, oracle.grid.last);
            (lower.y, lower.z) = ((y.start * Bricks::EDGE) as f64, (z.start * Bricks::EDGE) as f64);
            upper.y = upper.y.min((y.end * Bricks::EDGE) as f64);
            upper.z = upper.z.min((z.end * Bricks::EDGE) as f64);
            oracle.grid.bounds_of(lower - BEYOND, upper + BEYOND)
        };
        let bounds =
            along_y.iter().flat_map(|y| along_z.iter().map(move |z| box_of([y, z]))).collect();
        Tiles { per_layer: layers[1], ranges, bounds }
    }
}

impl Tiles {
    /// The rows of a tile.
    pub fn rows(&self, tile: usize) -> impl Iterator<Item = usize> + use<> {
        let ([y, z], per_layer) = (self.place(tile), self.per_layer);
        let along_z = self.ranges[1][z].clone();
        self.ranges[0][y].clone().flat_map(move |y| along_z.clone().map(move |z| y * per_layer + z))
    }

    /// A world box that holds all that is found in a tile's rows.
    pub fn bounds(&self, tile: usize) -> [DVec3; 2] {
        self.bounds[tile]
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.bounds.len()
    }

    /// The up to eight tiles beside one, also across its edges.
    pub fn beside(&self, tile: usize) -> impl Iterator<Item = usize> + use<> {
        let [y, z] = self.place(tile);
        let [ny, nz] = [0, 1].map(|n| self.ranges[n].len());
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        around(y, ny)
            .flat_map(move |y| around(z, nz).map(move |z| y * nz + z))
            .filter(move |&other| other != tile)
    }

    /// Visits each tile, on all threads of the current rayon pool: as soon as those beside it of
    /// lower colours have been visited, and before any of those of higher ones. So no two beside
    /// each other are visited at the same time, and what a visit finds there does not depend on the
    /// number of threads.
    ///
    /// # Errors
    /// The first of `visit`; nothing is begun after it.
    pub fn in_colors(&self, visit: impl Fn(usize) -> Result<()> + Sync) -> Result<()> {
        let missing =
            (0..self.count()).map(|tile| AtomicUsize::new(self.before(tile).count())).collect();
        let coloring = Coloring { tiles: self, visit, missing, failure: OnceLock::new() };
        rayon::scope(|scope| {
            let coloring = &coloring;
            for tile in (0..self.count()).filter(|&tile| self.before(tile).next().is_none()) {
                scope.spawn(move |scope| coloring.visit(tile, scope));
            }
        });
        coloring.failure.into_inner().map_or(Ok(()), Err)
    }

    fn place(&self, tile: usize) -> [usize; 2] {
        let along_z = self.ranges[1].len();
        [tile / along_z, tile % along_z]
    }

    /// Which of a tile's two numbers are odd.
    fn color(&self, tile: usize) -> usize {
        let [y, z] = self.place(tile);
        y % 2 + 2 * (z % 2)
    }

    /// Those beside a tile of lower colours.
    fn before(&self, tile: usize) -> impl Iterator<Item = usize> {
        self.beside(tile).filter(move |&other| self.color(other) < self.color(tile))
    }
}

/// A way through all tiles.
struct Coloring<'a, V> {
    tiles: &'a Tiles,
    visit: V,
    /// How many of those before each tile have not been visited yet.
    missing: Vec<AtomicUsize>,
    failure: OnceLock<Error>,
}

impl<V: Fn(usize) -> Result<()> + Sync> Coloring<'_, V> {
    /// Visits a tile, and has those visited that waited for it alone.
    fn visit<'s>(&'s self, tile: usize, scope: &Scope<'s>) {
        if self.failure.get().is_some() {
            return;
        }
        if let Err(error) = (self.visit)(tile) {
            // The first is told.
            let _ = self.failure.set(error);
            return;
        }
        for after in self
            .tiles
            .beside(tile)
            .filter(|&other| self.tiles.color(other) > self.tiles.color(tile))
        {
            // AcqRel: the visit that comes last sees what the others have done.
            if self.missing[after].fetch_sub(1, AcqRel) == 1 {
                scope.spawn(move |scope| self.visit(after, scope));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering::Acquire;

    /// So many tiles along y and z.
    fn tiles(counts: [usize; 2]) -> Tiles {
        let ranges = counts.map(|count| (0..count).map(|n| 2 * n..2 * n + 2).collect());
        Tiles {
            per_layer: 2 * counts[1],
            ranges,
            bounds: vec![[DVec3::ZERO; 2]; counts[0] * counts[1]],
        }
    }

    #[test]
    fn each_row_is_in_one_tile() {
        let tiles = tiles([3, 5]);
        let mut rows: Vec<usize> = (0..tiles.count()).flat_map(|tile| tiles.rows(tile)).collect();
        rows.sort_unstable();
        assert!(rows.into_iter().eq(0..6 * 10));
    }

    #[test]
    fn each_is_visited_once_after_those_beside_it_of_lower_colors() {
        for counts in [[0, 0], [1, 1], [2, 1], [3, 4], [8, 8]] {
            let tiles = tiles(counts);
            let visits: Vec<AtomicUsize> =
                (0..tiles.count()).map(|_| AtomicUsize::new(0)).collect();
            let visited = tiles.in_colors(|tile| {
                for other in tiles.beside(tile) {
                    let is_lower = tiles.color(other) < tiles.color(tile);
                    assert_eq!(visits[other].load(Acquire), usize::from(is_lower));
                }
                visits[tile].fetch_add(1, AcqRel);
                Ok(())
            });
            visited.unwrap();
            assert!(visits.into_iter().all(|count| count.into_inner() == 1));
            for tile in 0..tiles.count() {
                assert!(tiles.beside(tile).all(|other| tiles.color(other) != tiles.color(tile)));
                assert!(
                    tiles.beside(tile).all(|other| tiles.beside(other).any(|back| back == tile))
                );
            }
        }
    }

    #[test]
    fn nothing_is_begun_that_waits_for_an_error() {
        let tiles = tiles([8, 8]);
        let begun = AtomicUsize::new(0);
        let visited = tiles.in_colors(|tile| {
            begun.fetch_add(1, AcqRel);
            if tiles.color(tile) == 1 { Err(Error::Cancelled) } else { Ok(()) }
        });
        assert!(matches!(visited, Err(Error::Cancelled)));
        // A quarter is of the last colour, and none of it has all that it waits for.
        assert!(begun.into_inner() <= 48);
    }
}
