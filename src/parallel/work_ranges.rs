//! A list that all workers work off. Each begins with a range of its own, so that what lies
//! together in the list is done by one worker, and takes from the ends of others' ranges when
//! its own is done. Where workers are in groups, each takes from those of its own group alone.
//!
//! Nobody helps with the last of a range: many workers would crowd around what lies together
//! there, and wait for each other longer than its own worker needs.

use std::ops::Range;

use crate::sync::{AtomicU64, Ordering::Relaxed};

/// Entries that a worker takes at once.
const BLOCK: usize = 32;

/// Entries up to which a range is left to its own worker.
const OWN: usize = 8 * BLOCK;

/// What is left to do.
#[derive(Debug)]
pub struct WorkRanges {
    /// Of each worker's range: first entry, and the one after the last in the upper half.
    left: Vec<AtomicU64>,
    /// The group of each worker.
    groups: Vec<usize>,
    /// Workers that have a part in it, the first of all.
    active: usize,
}

fn pack(range: Range<usize>) -> u64 {
    range.start as u64 | (range.end as u64) << 32
}

fn unpack(word: u64) -> Range<usize> {
    word as u32 as usize..(word >> 32) as usize
}

impl WorkRanges {
    /// Divides a range, of numbers below 2^32, among `size` workers of one group.
    pub fn new(range: Range<usize>, size: usize) -> Self {
        let at =
            |part: usize| range.start + (range.len() as u64 * part as u64 / size as u64) as usize;
        Self::of_groups((0..size).map(|part| at(part)..at(part + 1)), vec![0; size])
    }

    /// A range, of numbers below 2^32, for each worker, and the group of each.
    pub fn of_groups(work_ranges: impl Iterator<Item = Range<usize>>, groups: Vec<usize>) -> Self {
        let left: Vec<AtomicU64> =
            work_ranges.map(|work_range| AtomicU64::new(pack(work_range))).collect();
        debug_assert_eq!(left.len(), groups.len());
        Self { active: left.len(), left, groups }
    }

    /// Divides a range among the first `active` of `size` workers; the others have nothing to do
    /// with it.
    pub fn of_some(range: Range<usize>, active: usize, size: usize) -> Self {
        let mut some = Self::new(range, active);
        some.left.resize_with(size, || AtomicU64::new(pack(0..0)));
        // Apart, so that they do not help.
        some.groups.resize(size, 1);
        some
    }

    /// Whether all workers have a part in it.
    pub fn is_for_all(&self) -> bool {
        self.active == self.left.len()
    }

    /// Whether worker `me` has a part in it.
    pub fn is_for(&self, me: usize) -> bool {
        me < self.active
    }

    /// Whether all entries are taken.
    pub fn is_taken(&self) -> bool {
        self.left.iter().all(|left| unpack(left.load(Relaxed)).is_empty())
    }

    /// The next entries for worker `me`; `None`: its own are taken, and what is left of its group's
    /// is left to others.
    pub fn take(&self, me: usize) -> Option<Range<usize>> {
        self.take_of(
            me,
            |left| left.start..(left.start + BLOCK).min(left.end),
            |left, taken| taken.end..left.end,
        )
        .or_else(|| {
            let group = || (0..self.left.len()).filter(|&who| self.groups[who] == self.groups[me]);
            let left = |who: usize| (unpack(self.left[who].load(Relaxed)).len(), who);
            // Another worker may be faster: then there is another longest, until none is long. Each
            // is read once: ranges only shrink, so those that are all found short are.
            loop {
                let (_, longest) = group().map(left).max().filter(|&(entries, _)| entries > OWN)?;
                let from =
                    |left: &Range<usize>| left.end.saturating_sub(BLOCK).max(left.start)..left.end;
                if let Some(taken) =
                    self.take_of(longest, from, |left, taken| left.start..taken.start)
                {
                    return Some(taken);
                }
            }
        })
    }

    /// Takes a part of a range. Relaxed: the words say who does what, and publish nothing.
    fn take_of(
        &self,
        who: usize,
        part: impl Fn(&Range<usize>) -> Range<usize>,
        rest: impl Fn(&Range<usize>, &Range<usize>) -> Range<usize>,
    ) -> Option<Range<usize>> {
        let mut now = self.left[who].load(Relaxed);
        loop {
            let left = unpack(now);
            if left.is_empty() {
                return None;
            }
            let taken = part(&left);
            match self.left[who].compare_exchange_weak(
                now,
                pack(rest(&left, &taken)),
                Relaxed,
                Relaxed,
            ) {
                Ok(_) => return Some(taken),
                Err(other) => now = other,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_entry_is_taken_once() {
        let work_ranges = WorkRanges::new(5..10_000, 3);
        let taken = std::thread::scope(|scope| {
            let work = |me| {
                let work_ranges = &work_ranges;
                scope.spawn(move || {
                    std::iter::from_fn(|| work_ranges.take(me)).flatten().collect::<Vec<_>>()
                })
            };
            let workers = [work(0), work(1), work(2)];
            workers.map(|worker| worker.join().unwrap()).concat()
        });
        let mut sorted = taken;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(5..10_000));
    }

    #[test]
    fn groups_do_each_their_own() {
        let parts = [10..40, 40..200, 200..201, 201..700];
        let work_ranges = WorkRanges::of_groups(parts.into_iter(), vec![0, 1, 1, 0]);
        let take_all =
            |me| std::iter::from_fn(|| work_ranges.take(me)).flatten().collect::<Vec<usize>>();
        let mut first = take_all(0);
        first.sort_unstable();
        // It helps until what is left is for its own worker.
        assert!(first.into_iter().eq((10..40).chain(444..700)));
        assert!(take_all(3).into_iter().eq(201..444));
        assert!(take_all(2).into_iter().eq(200..201));
    }

    #[test]
    fn an_empty_list_has_nothing_to_take() {
        assert_eq!(WorkRanges::new(7..7, 4).take(2), None);
    }
}
