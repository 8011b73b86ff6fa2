//! Tets and vertices by place, so that who goes through them meets neighbours one soon after the
//! other.
//!
//! Slots and ids are given out as the refinement goes: it ends with neighbours anywhere in memory,
//! and a sweep that inspects each tet's neighbours and vertices waits for memory most of the time.
//! In the order of their places what one needs the next one has in the cache.
//!
//! Places are cells of a grid over the box, along Morton's curve ([`morton`]); within a cell the
//! order is that of the numbers. So the order depends on the triangulation alone, not on the number
//! of threads.
//!
//! A radix sort of two digits, linear and stable, parallel in the current rayon pool. Not to be
//! used while others operate.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::tet::{TetId, VertexId};
use super::triangulation::Triangulation;
use crate::Result;
use crate::geometry::morton;
use crate::memory::{parts, room, zeroed};

/// Consecutive numbers of one piece of work, which has counters of its own: some hundred
/// microseconds, between two questions whether to go on.
const PIECE: usize = 1 << 15;

/// As many numbers come to a cell at least, on average; in the object, which fills a part of the
/// box, some more.
const PER_CELL: u32 = 4;

/// Most bits of a cell's place along an axis.
const MAX_BITS: u32 = 8;

impl Triangulation {
    /// All living tets, by their circumcenters.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `go_on`.
    pub fn tets_by_place(&self, go_on: impl Fn() -> Result<()> + Sync) -> Result<Vec<TetId>> {
        let center = |t| {
            self.prefetch_next(t);
            self.is_living(t).then(|| self.tet(t).sphere().center)
        };
        self.by_place(self.tet_bound(), center, go_on)
    }

    /// The vertices that `wanted` names.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `go_on`.
    pub fn vertices_by_place(
        &self,
        wanted: impl Fn(VertexId) -> bool + Sync,
        go_on: impl Fn() -> Result<()> + Sync,
    ) -> Result<Vec<VertexId>> {
        let position = |v| wanted(v).then(|| self.position(v));
        self.by_place(self.vertex_bound(), position, go_on)
    }

    /// The numbers below `bound` that have a place.
    fn by_place(
        &self,
        bound: u32,
        place: impl Fn(u32) -> Option<DVec3> + Sync,
        go_on: impl Fn() -> Result<()> + Sync,
    ) -> Result<Vec<u32>> {
        let bits = ((bound / PER_CELL).max(1).ilog2() / 3).min(MAX_BITS);
        let side = f64::from(1_u32 << bits);
        let per_cell = side / (self.upper() - self.lower());
        // Circumcenters may lie outside of the box.
        let cell = |p: DVec3| {
            let cell = ((p - self.lower()) * per_cell).clamp(DVec3::ZERO, DVec3::splat(side - 1.0));
            morton::place(cell.to_array().map(|c| c as u32))
        };
        // The cell of each number, from 1 on; 0 for one without a place.
        let mut cells: Vec<u32> = zeroed(bound as usize, "cells of tets")?;
        // Block by block of cells, then the cells of a block: counters that stay in the cache, and
        // that no two threads share.
        let low = 3 * bits / 2;
        let block = |own: u32| ((own - 1) >> low) as usize;
        let blocks = 1 << (3 * bits - low);
        let counts =
            cells.par_chunks_mut(PIECE).enumerate().with_max_len(1).map(|(piece, cells)| {
                go_on()?;
                let mut counts: Vec<u32> = zeroed(blocks, "blocks of cells")?;
                for (own, number) in cells.iter_mut().zip((piece * PIECE) as u32..) {
                    if let Some(p) = place(number) {
                        *own = 1 + cell(p);
                        counts[block(*own)] += 1;
                    }
                }
                Ok(counts)
            });
        let mut starts: Vec<Vec<u32>> = counts.collect::<Result<_>>()?;
        let mut end = 0;
        let mut ends: Vec<u32> = zeroed(blocks, "blocks of cells")?;
        for (block, block_end) in ends.iter_mut().enumerate() {
            for starts in &mut starts {
                end += std::mem::replace(&mut starts[block], end);
            }
            *block_end = end;
        }
        // Relaxed: each is written by one thread, and the pass is joined before they are read.
        let mut sorted: Vec<AtomicU32> = zeroed(end as usize, "tets by place")?;
        let pieces = cells.par_chunks(PIECE).zip(starts).enumerate().with_max_len(1);
        pieces.try_for_each(|(piece, (cells, mut starts))| {
            go_on()?;
            for (&own, number) in
                cells.iter().zip((piece * PIECE) as u32..).filter(|&(&own, _)| own > 0)
            {
                let at = &mut starts[block(own)];
                sorted[*at as usize].store(number, Relaxed);
                *at += 1;
            }
            Ok(())
        })?;
        let mut start = 0;
        let lengths = ends.iter().map(|&end| (end - std::mem::replace(&mut start, end)) as usize);
        parts(&mut sorted, lengths, "blocks of tets")?.into_par_iter().try_for_each(|numbers| {
            go_on()?;
            sort_block(
                numbers,
                |number| (cells[number as usize] - 1) as usize % (1 << low),
                1 << low,
            )
        })?;
        Ok(sorted.into_iter().map(AtomicU32::into_inner).collect())
    }
}

/// Sorts numbers by their cells, of which a block has so many; stable.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
fn sort_block(numbers: &mut [AtomicU32], cell: impl Fn(u32) -> usize, cells: usize) -> Result<()> {
    let mut ends: Vec<u32> = zeroed(cells + 1, "cells of a block")?;
    let mut unsorted = room(numbers.len(), "tets of a block")?;
    unsorted.extend(numbers.iter_mut().map(|number| (*number.get_mut(), cell(*number.get_mut()))));
    unsorted.iter().for_each(|&(_, cell)| ends[cell + 1] += 1);
    (0..cells).for_each(|cell| ends[cell + 1] += ends[cell]);
    // `ends[c]` grows from the start of the cell's part to its end.
    for (number, cell) in unsorted {
        *numbers[ends[cell] as usize].get_mut() = number;
        ends[cell] += 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delaunay::{Insertion, Removal, Solo, VertexKind, Worker};

    #[test]
    fn every_tet_and_vertex_once_near_those_before() {
        let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut worker = Worker::new(Solo, 0);
        let mut start = 0;
        for i in 0..6000_u32 {
            // Far from the one before.
            let p = DVec3::new(0.754_877_666, 0.569_840_290_998, 0.430_159_709) * f64::from(i + 1);
            start = triangulation.locate(start, p.fract());
            let inserted =
                worker.insert(&triangulation, start, p.fract(), VertexKind::Free).unwrap();
            let Insertion::Done(v) = inserted else { panic!("{inserted:?}") };
            if i % 5 == 4 {
                assert_eq!(worker.remove(&triangulation, v - 2).unwrap(), Removal::Done);
            }
            start = worker.created()[0];
        }
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let is_free = |v| triangulation.vertex(v).kind() == VertexKind::Free;
                let vertices = triangulation.vertices_by_place(is_free, || Ok(())).unwrap();
                (triangulation.tets_by_place(|| Ok(())).unwrap(), vertices)
            })
        };
        let one = on(1);
        assert_eq!(one, on(3));
        let (tets, vertices) = one;
        let sorted = |list: &[u32]| {
            let mut list = list.to_vec();
            list.sort_unstable();
            list
        };
        assert_eq!(sorted(&tets), triangulation.living_tets().collect::<Vec<_>>());
        assert_eq!(vertices.len(), 6000 - 1200);
        let step = |p: &[u32]| triangulation.position(p[0]).distance(triangulation.position(p[1]));
        let mean = vertices.windows(2).map(step).sum::<f64>() / vertices.len() as f64;
        assert!(mean < 0.15, "{mean}");
    }
}
