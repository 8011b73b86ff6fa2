//! Things sorted into groups of equal keys: the tets of each label, the facets of each boundary.
//!
//! Keys are in increasing order, the things of a group in their own order. Neighbouring things
//! mostly have the same key. So nothing is sorted: things are cut into chunks, and each group knows
//! the chunks that it has things in, and how many of them come before. The things themselves are
//! found again by their keys. Reading all groups looks at a thing as often as its chunk has keys.
//! Memory is at most half a byte per thing, mostly next to nothing.
//!
//! Where neighbours have too many keys for that, the things are listed by group: 4 bytes each.

use std::io::{self, Write};
use std::ops::Range;

use super::records::write_ranges;
use crate::Result;
use crate::memory::filled;

/// Things numbered from 0, each of which has a key: a table, or what knows its keys without one.
pub(super) trait Keyed: Sync {
    type Key: Copy + Ord + Sync;

    /// How many things there are.
    fn count(&self) -> usize;

    /// The key of a thing.
    fn key(&self, i: usize) -> Self::Key;
}

impl<K: Copy + Ord + Sync> Keyed for Vec<K> {
    type Key = K;

    fn count(&self) -> usize {
        self.len()
    }

    fn key(&self, i: usize) -> K {
        self[i]
    }
}

/// The different values of `items`, in increasing order.
pub(super) fn distinct<K: Copy + Ord>(items: impl Iterator<Item = K>) -> Vec<K> {
    let mut keys = Vec::new();
    for item in items {
        // There are few keys, and neighbouring things mostly have the same.
        if keys.last() != Some(&item) {
            if keys.len() == keys.capacity() {
                keys.sort_unstable();
                keys.dedup();
                // As much room again, so that the sorting is paid for by what comes between.
                keys.reserve(keys.len().max(64));
            }
            keys.push(item);
        }
    }
    keys.sort_unstable();
    keys.dedup();
    keys
}

/// Things of a chunk, where neighbours mostly have the same key; and where they do less.
const CHUNKS: [usize; 2] = [256, 1024];

/// How many things there are at least for each place of a chunk in a group, which takes 8 bytes.
const THINGS_PER_PLACE: usize = 16;

/// A chunk that a group has things in.
#[derive(Clone, Copy)]
struct Place {
    chunk: u32,
    /// How many things of the group are in the chunks before.
    before: u32,
}

/// Indices of things, by their keys.
pub(super) struct Groups<'a, I: Keyed> {
    items: &'a I,
    /// Things of a chunk.
    chunk: usize,
    keys: Vec<I::Key>,
    /// How many things each group has.
    counts: Vec<u32>,
    /// Group g has `starts[g]..starts[g + 1]` of `places`, or of `listed`.
    starts: Vec<usize>,
    places: Vec<Place>,
    /// The things, group by group; empty where places are enough.
    listed: Vec<u32>,
}

impl<'a, I: Keyed> Groups<'a, I> {
    /// Groups the things by their keys.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(items: &'a I) -> Result<Self> {
        let count = items.count();
        let keys = distinct((0..count).map(|i| items.key(i)));
        let mut groups = Self {
            items,
            chunk: 0,
            keys,
            counts: vec![],
            starts: vec![],
            places: vec![],
            listed: vec![],
        };
        for chunk in CHUNKS {
            let mut starts = vec![0; groups.keys.len() + 1];
            for_each_part(items, chunk, &groups.keys, |g, _, _| starts[g + 1] += 1);
            if THINGS_PER_PLACE * starts.iter().sum::<usize>() <= count.max(THINGS_PER_PLACE) {
                groups.note_places(chunk, starts)?;
                return Ok(groups);
            }
        }
        groups.list()?;
        Ok(groups)
    }

    /// Notes where each group has things; `starts[g + 1]` is the number of chunks of group g.
    fn note_places(&mut self, chunk: usize, mut starts: Vec<usize>) -> Result<()> {
        sum_up(&mut starts);
        let mut counts = vec![0; self.keys.len()];
        let mut next = starts.clone();
        let nothing = Place { chunk: 0, before: 0 };
        let mut places = filled(starts[self.keys.len()], nothing, "chunks of groups", || Ok(()))?;
        for_each_part(self.items, chunk, &self.keys, |g, chunk, count| {
            places[next[g]] = Place { chunk, before: counts[g] };
            next[g] += 1;
            counts[g] += count;
        });
        (self.chunk, self.counts, self.starts, self.places) = (chunk, counts, starts, places);
        Ok(())
    }

    /// Lists the things group by group.
    fn list(&mut self) -> Result<()> {
        let count = self.items.count();
        let group_of = |i| self.keys.partition_point(|other| *other < self.items.key(i));
        let mut starts = vec![0; self.keys.len() + 1];
        (0..count).for_each(|i| starts[group_of(i) + 1] += 1);
        let counts = starts[1..].iter().map(|&count| count as u32).collect();
        sum_up(&mut starts);
        let mut next = starts.clone();
        let mut listed = filled(count, 0, "things of groups", || Ok(()))?;
        for i in 0..count {
            let next = &mut next[group_of(i)];
            listed[*next] = i as u32;
            *next += 1;
        }
        (self.counts, self.starts, self.listed) = (counts, starts, listed);
        Ok(())
    }

    /// Each key with its things.
    pub fn iter(
        &self,
    ) -> impl DoubleEndedIterator<Item = (I::Key, Members<'_, I>)> + ExactSizeIterator {
        (0..self.keys.len()).map(|g| (self.keys[g], self.members(g)))
    }

    fn members(&self, g: usize) -> Members<'_, I> {
        Members {
            items: self.items,
            chunk: self.chunk,
            key: self.keys[g],
            count: self.counts[g],
            places: self.part(&self.places, g),
            listed: self.part(&self.listed, g),
        }
    }

    /// The part of group g of one of the two tables; nothing of that which is not used.
    fn part<'t, T>(&self, table: &'t [T], g: usize) -> &'t [T] {
        table.get(self.starts[g]..self.starts[g + 1]).unwrap_or_default()
    }

    /// The place of each group's first thing in the list of all groups' things, one behind the
    /// other.
    pub fn starts(&self) -> Vec<usize> {
        let sums = self.counts.iter().scan(0, |sum, &count| {
            let start = *sum;
            *sum += count as usize;
            Some(start)
        });
        sums.collect()
    }

    /// Which group a thing is in, and its place there.
    pub fn place(&self, i: usize) -> (usize, usize) {
        let key = self.items.key(i);
        let g = self.keys.partition_point(|other| *other < key);
        if !self.listed.is_empty() {
            return (g, self.part(&self.listed, g).partition_point(|&other| (other as usize) < i));
        }
        let start = i - i % self.chunk;
        let places = self.part(&self.places, g);
        let here = places.partition_point(|place| (place.chunk as usize) < i / self.chunk);
        let before = places.get(here).map_or(0, |place| place.before as usize);
        let same = (start..i).filter(|&i| self.items.key(i) == key).count();
        (g, before + same)
    }
}

/// Numbers of things, each behind that of another group, become where each group starts.
fn sum_up(starts: &mut [usize]) {
    for g in 1..starts.len() {
        starts[g] += starts[g - 1];
    }
}

/// Calls `part(group, chunk, count)` for the groups that each chunk has things of.
fn for_each_part<I: Keyed>(
    items: &I,
    chunk: usize,
    keys: &[I::Key],
    mut part: impl FnMut(usize, u32, u32),
) {
    let mut counts = vec![0; keys.len()];
    let mut here = Vec::new();
    let mut last = None;
    for (number, start) in (0..).zip((0..items.count()).step_by(chunk)) {
        for i in start..items.count().min(start + chunk) {
            let key = items.key(i);
            let g = match last {
                Some((same, g)) if same == key => g,
                _ => keys.partition_point(|other| *other < key),
            };
            last = Some((key, g));
            if counts[g] == 0 {
                here.push(g);
            }
            counts[g] += 1;
        }
        for g in here.drain(..) {
            part(g, number, std::mem::take(&mut counts[g]));
        }
    }
}

/// The things of a group.
pub(super) struct Members<'a, I: Keyed> {
    items: &'a I,
    chunk: usize,
    key: I::Key,
    count: u32,
    places: &'a [Place],
    listed: &'a [u32],
}

// Derived, they would ask the things themselves to be copied.
impl<I: Keyed> Clone for Members<'_, I> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<I: Keyed> Copy for Members<'_, I> {}

impl<'a, I: Keyed> Members<'a, I> {
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// All things.
    pub fn iter(&self) -> impl Iterator<Item = u32> + use<'a, I> {
        self.range(0..self.len())
    }

    /// The things of some places.
    pub fn range(&self, places: Range<usize>) -> impl Iterator<Item = u32> + use<'a, I> {
        let Self { items, chunk, key, places: chunks, listed, .. } = *self;
        let listed = listed.get(places.clone()).unwrap_or_default();
        let first = chunks.partition_point(|place| place.before as usize <= places.start);
        let first = first.saturating_sub(1);
        let before = chunks.get(first).map_or(0, |place| place.before as usize);
        let things = chunks[first..].iter().flat_map(move |place| {
            let start = place.chunk as usize * chunk;
            let here = start..items.count().min(start + chunk);
            here.filter(move |&i| items.key(i) == key).map(|i| i as u32)
        });
        let things = things.skip(places.start - before).take(places.len());
        listed.iter().copied().chain(things)
    }

    /// Calls `record(i, thing, bytes)`, which appends the record of the thing at place `i`, for all
    /// of them, and writes the bytes in this order.
    pub fn write_records(
        &self,
        out: &mut (impl Write + Send),
        record: impl Fn(usize, u32, &mut Vec<u8>) + Sync,
    ) -> io::Result<()> {
        write_ranges(out, self.len(), |range, bytes| {
            range.clone().zip(self.range(range)).for_each(|(i, thing)| record(i, thing, bytes));
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_keep_the_order() {
        let items = vec![5, -2, 5, 5, i32::MAX, -2];
        let groups = Groups::new(&items).unwrap();
        let all: Vec<_> =
            groups.iter().map(|(key, things)| (key, things.iter().collect::<Vec<_>>())).collect();
        assert_eq!(all, [(-2, vec![1, 5]), (5, vec![0, 2, 3]), (i32::MAX, vec![4])]);
        assert_eq!(Groups::<Vec<i32>>::new(&vec![]).unwrap().iter().len(), 0);
    }

    /// Few keys and many, neighbours of one key and not, over several chunks.
    #[test]
    fn things_are_found_again() {
        for (count, keys, same) in
            [(0, 1, 1), (1, 1, 1), (5000, 3, 1), (70_000, 900, 1), (70_000, 900, 64), (90, 90, 1)]
        {
            let items: Vec<i32> = (0..count).map(|i| i / same * 7919 % keys - 5).collect();
            let groups = Groups::new(&items).unwrap();
            let is_listed = !groups.listed.is_empty();
            assert_eq!(is_listed, same == 1 && keys > 3, "{count} {keys} {same}");
            assert!(groups.places.len() * size_of::<Place>() <= items.len().max(16) / 2);
            let starts = groups.starts();
            let mut found = 0;
            for (g, (key, members)) in groups.iter().enumerate() {
                assert_eq!(starts[g], found);
                let expected: Vec<u32> =
                    (0..count as u32).filter(|&i| items[i as usize] == key).collect();
                assert_eq!(members.iter().collect::<Vec<_>>(), expected);
                let (third, end) = (members.len() / 3, members.len());
                for range in [0..0, third..end, third..third + 1, end..end] {
                    assert!(members.range(range.clone()).eq(expected[range].iter().copied()));
                }
                for (place, &i) in expected.iter().enumerate() {
                    assert_eq!(groups.place(i as usize), (g, place));
                }
                let mut bytes = Vec::new();
                members
                    .write_records(&mut bytes, |i, thing, bytes| {
                        assert_eq!(expected[i], thing);
                        bytes.push(thing as u8);
                    })
                    .unwrap();
                assert!(bytes.into_iter().eq(expected.iter().map(|&i| i as u8)));
                found += members.len();
            }
            assert_eq!(found, items.len());
        }
    }

    #[test]
    fn distinct_values_of_many() {
        let items = (0..100_000).map(|i| i * 7919 % 300 - 150);
        assert_eq!(distinct(items), (-150..150).collect::<Vec<_>>());
    }
}
