//! The net of a tile: which samples there are so far, and whether one covers a point.
//!
//! Samples are kept in chains by cells of twice the largest spacing. Where spacings differ much a
//! cell may hold thousands, so a long chain becomes eight: those on either side of its middle along
//! each axis. Whether a sample is near does not depend on that.
//!
//! Cost: a few nanoseconds where one of the last samples is near; else a chain, or a few of them.
//! Memory: 32 bytes per sample, and 56 for each chain that was split, so some two more.

use glam::DVec3;

use super::super::cell_table::CellTable;
use super::super::recent::Recent;
use crate::memory::{filled, reserve};
use crate::{Error, Result};

/// No sample.
const NONE: u32 = u32::MAX;

/// A chain that is longer is split, unless all of its samples lie at one place.
const LONGEST: usize = 32;

/// A number from here on is that of a chain that was split, plus this.
const SPLIT: u32 = 1 << 31;

/// What a chain is split into: samples by their sides of a point. Bit a is set for those not below
/// it along axis a.
struct Parts {
    middle: DVec3,
    heads: [u32; 8],
}

impl Parts {
    #[inline]
    fn of(&self, p: DVec3) -> usize {
        p.cmpge(self.middle).bitmask() as usize
    }
}

/// The samples of a tile so far, and those beside it that matter here, in chains by cells of twice
/// the largest spacing.
pub(in crate::refine) struct Net {
    cells: CellTable,
    heads: Vec<u32>,
    next: Vec<u32>,
    points: Vec<DVec3>,
    /// Which of the points are the tile's own.
    own: Vec<u32>,
    /// How many of their own points the nets beside this one, in the order of [`Tiles::beside`],
    /// had when they were inspected last.
    learned: [usize; 8],
    /// Holds all that its samples cover, and all that covers what is offered.
    pub(super) reach: [DVec3; 2],
    /// Samples that were added or covered a point last.
    recent: Recent,
    /// Of chains that were split.
    parts: Vec<Parts>,
}

impl Net {
    /// For spacings up to `max`; to be opened first.
    pub(super) fn new(max: f64, [lower, upper]: [DVec3; 2], max_heads: usize) -> Self {
        let cells = CellTable::new(lower - 2.0 * max, upper + 2.0 * max, 2.0 * max, max_heads);
        let reach = [lower - 1.5 * max, upper + 1.5 * max];
        let (heads, next, points, own) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (recent, parts) = (Recent::new(), Vec::new());
        Self { cells, heads, next, points, own, learned: [0; 8], reach, recent, parts }
    }

    /// Makes the cells.
    pub(super) fn open(&mut self) -> Result<()> {
        self.heads = filled(self.cells.heads(), NONE, "cells of the net of samples", || Ok(()))?;
        Ok(())
    }

    /// Offers a point of the tile: unless a sample is within the spacing, what `sample` makes of it
    /// becomes one.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    #[inline]
    pub(super) fn offer(
        &mut self,
        p: DVec3,
        spacing: f64,
        sample: impl FnOnce() -> DVec3,
    ) -> Result<()> {
        if self.covers(p, spacing) {
            return Ok(());
        }
        let at = self.points.len() as u32;
        self.push(sample())?;
        reserve(&mut self.own, 1, "samples of the isosurface")?;
        self.own.push(at);
        Ok(())
    }

    /// Takes over from the net of the tile beside this one with number `n` what came to it since
    /// this was done last.
    pub(super) fn learn(&mut self, n: usize, beside: &Self) -> Result<()> {
        let since = std::mem::replace(&mut self.learned[n], beside.own.len());
        beside.own_from(since).try_for_each(|p| if self.reaches(p) { self.push(p) } else { Ok(()) })
    }

    /// The tile's own samples from number `first` on.
    fn own_from(&self, first: usize) -> impl Iterator<Item = DVec3> {
        self.own[first..].iter().map(|&at| self.points[at as usize])
    }

    /// The tile's own samples, without another table.
    pub(super) fn into_own(mut self) -> Vec<DVec3> {
        for (to, &at) in self.own.iter().enumerate() {
            self.points[to] = self.points[at as usize];
        }
        self.points.truncate(self.own.len());
        self.points
    }

    /// Whether a sample is closer than delta to `p`.
    #[inline]
    fn covers(&mut self, p: DVec3, delta: f64) -> bool {
        if self.recent.any_within(p, delta) {
            return true;
        }
        let near = self.sample_near(p, delta);
        near.into_iter().for_each(|q| self.recent.remember(q));
        near.is_some()
    }

    /// Whether a sample may be closer than delta to `p`.
    #[inline]
    pub(super) fn reaches(&self, p: DVec3) -> bool {
        p.cmpge(self.reach[0]).all() && p.cmple(self.reach[1]).all()
    }

    /// A sample closer than delta to `p`.
    #[inline]
    fn sample_near(&self, p: DVec3, delta: f64) -> Option<DVec3> {
        // The cell of the point most likely has it.
        let own = self.cells.head_of(p);
        if let near @ Some(_) = self.sample_in(self.heads[own], p, delta) {
            return near;
        }
        let (from, to) = (self.cells.cell(p - delta), self.cells.cell(p + delta));
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let head = self.cells.head(x, y, z);
                    if head != own
                        && let near @ Some(_) = self.sample_in(self.heads[head], p, delta)
                    {
                        return near;
                    }
                }
            }
        }
        None
    }

    /// A sample of a chain, or of its parts, closer than delta to `p`.
    #[inline]
    fn sample_in(&self, head: u32, p: DVec3, delta: f64) -> Option<DVec3> {
        if (SPLIT..NONE).contains(&head) {
            return self.sample_in_parts(&self.parts[(head - SPLIT) as usize], p, delta);
        }
        self.chain(head).find(|q| q.distance_squared(p) < delta * delta)
    }

    fn sample_in_parts(&self, parts: &Parts, p: DVec3, delta: f64) -> Option<DVec3> {
        let own = parts.of(p);
        let apart = (p - parts.middle).to_array();
        let mut all = (0..8).filter(|across| {
            // Nothing beyond the middle along these axes is nearer than that. Nor does it seem so
            // by rounding: differences, squares and their sums are rounded in order.
            let beyond = |a: usize| if across >> a & 1 == 1 { apart[a] } else { 0.0 };
            DVec3::new(beyond(0), beyond(1), beyond(2)).length_squared() < delta * delta
        });
        all.find_map(|across| self.sample_in(parts.heads[own ^ across], p, delta))
    }

    /// The samples of a chain that was not split.
    #[inline]
    fn chain(&self, head: u32) -> impl Iterator<Item = DVec3> {
        self.numbers(head).map(|at| self.points[at as usize])
    }

    #[inline]
    fn numbers(&self, head: u32) -> impl Iterator<Item = u32> {
        let after = |&at: &u32| Some(self.next[at as usize]).filter(|&at| at != NONE);
        std::iter::successors(Some(head).filter(|&at| at != NONE), after)
    }

    /// Adds a sample.
    pub(super) fn push(&mut self, p: DVec3) -> Result<()> {
        const WHAT: &str = "samples of the isosurface";
        reserve(&mut self.next, 1, WHAT)?;
        reserve(&mut self.points, 1, WHAT)?;
        let at = u32::try_from(self.points.len()).ok().filter(|&at| at < SPLIT);
        let at = at.ok_or(Error::OutOfMemory { count: self.points.len(), what: WHAT })?;
        self.points.push(p);
        let cell = self.cells.head_of(p);
        let (mut head, mut of) = (self.heads[cell], None);
        while (SPLIT..NONE).contains(&head) {
            let split = (head - SPLIT) as usize;
            let part = self.parts[split].of(p);
            (head, of) = (self.parts[split].heads[part], Some((split, part)));
        }
        self.next.push(head);
        let longer =
            if self.numbers(head).nth(LONGEST - 1).is_some() { self.split(at)? } else { at };
        match of {
            Some((split, part)) => self.parts[split].heads[part] = longer,
            None => self.heads[cell] = longer,
        }
        self.recent.remember(p);
        Ok(())
    }

    /// Splits a chain at the mean of its samples; what it has become. Where all are at one place it
    /// stays as it is.
    fn split(&mut self, head: u32) -> Result<u32> {
        const WHAT: &str = "chains of samples";
        let mut numbers = Vec::new();
        for at in self.numbers(head) {
            reserve(&mut numbers, 1, WHAT)?;
            numbers.push(at);
        }
        let sum: DVec3 = numbers.iter().map(|&at| self.points[at as usize]).sum();
        let mut parts = Parts { middle: sum / numbers.len() as f64, heads: [NONE; 8] };
        let part_of = |at: u32| parts.of(self.points[at as usize]);
        if numbers.iter().all(|&at| part_of(at) == part_of(head)) {
            return Ok(head);
        }
        reserve(&mut self.parts, 1, WHAT)?;
        // From the last on, so that the order stays.
        for &at in numbers.iter().rev() {
            let part = parts.of(self.points[at as usize]);
            self.next[at as usize] = std::mem::replace(&mut parts.heads[part], at);
        }
        self.parts.push(parts);
        Ok(SPLIT + (self.parts.len() - 1) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against all samples, one by one, where they lie as densely as their spacings say: from far
    /// apart to a thousandth of that.
    #[test]
    fn nets_find_what_is_near() {
        let mut state = 1_u64;
        let mut unit = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        for max in [0.5, 10.0] {
            let mut net = Net::new(max, [DVec3::ZERO, DVec3::splat(10.0)], 1 << 6);
            net.open().unwrap();
            let mut samples: Vec<DVec3> = Vec::new();
            for n in 0..6000 {
                // Dense about the origin.
                let p = 10.0 * DVec3::new(unit(), unit(), unit()) * unit().powi(3);
                let spacing = (0.1 * p.length()).clamp(1e-3 * max, max);
                let is_covered = samples.iter().any(|q| q.distance(p) < spacing);
                let before = net.points.len();
                net.offer(p, spacing, || p).unwrap();
                assert_eq!(net.points.len() == before, is_covered, "point {n}");
                if !is_covered {
                    samples.push(p);
                }
            }
            assert!(samples.len() > 300, "{} samples", samples.len());
            assert!(max < 1.0 || !net.parts.is_empty(), "no chain was split");
        }
        // Samples at one place stay one chain.
        let mut net = Net::new(1.0, [DVec3::ZERO, DVec3::ONE], 1);
        net.open().unwrap();
        (0..100).for_each(|_| net.push(DVec3::splat(0.5)).unwrap());
        assert!(net.parts.is_empty() && net.sample_near(DVec3::splat(0.4), 0.2).is_some());
    }
}
