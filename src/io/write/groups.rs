//! Things sorted into groups of equal keys: the tets of each label, the facets of each boundary.
//!
//! Keys are in increasing order, the things of a group in their own order. A counting sort: two
//! passes with a binary search per thing among the keys, which are few; 4 bytes per thing.

use crate::Result;
use crate::memory::zeroed;

/// The different values of `items`, in increasing order.
pub(super) fn distinct<K: Copy + Ord>(items: &[K]) -> Vec<K> {
    let mut keys = Vec::new();
    for item in items {
        // There are few keys, and neighbouring things mostly have the same.
        if keys.last() != Some(item) {
            if keys.len() == keys.capacity() {
                keys.sort_unstable();
                keys.dedup();
                // As much room again, so that the sorting is paid for by what comes between.
                keys.reserve(keys.len().max(64));
            }
            keys.push(*item);
        }
    }
    keys.sort_unstable();
    keys.dedup();
    keys
}

/// Indices of things, by their keys.
pub(super) struct Groups<K> {
    keys: Vec<K>,
    /// Group g has places `starts[g]..starts[g + 1]` of `order`.
    starts: Vec<usize>,
    order: Vec<u32>,
}

impl<K: Copy + Ord> Groups<K> {
    /// Groups the things whose keys are `items`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(items: &[K]) -> Result<Self> {
        let keys = distinct(items);
        let group = |item: &K| keys.partition_point(|key| key < item);
        let mut starts = vec![0; keys.len() + 1];
        items.iter().for_each(|item| starts[group(item) + 1] += 1);
        for g in 0..keys.len() {
            starts[g + 1] += starts[g];
        }
        let mut next = starts.clone();
        let mut order: Vec<u32> = zeroed(items.len(), "elements in groups")?;
        for (i, item) in items.iter().enumerate() {
            let place = &mut next[group(item)];
            order[*place] = i as u32;
            *place += 1;
        }
        Ok(Self { keys, starts, order })
    }

    /// Each key with the indices of its things.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (K, &[u32])> + ExactSizeIterator {
        self.keys
            .iter()
            .enumerate()
            .map(|(g, &key)| (key, &self.order[self.starts[g]..self.starts[g + 1]]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_keep_the_order() {
        let groups = Groups::new(&[5, -2, 5, 5, i32::MAX, -2]).unwrap();
        assert_eq!(groups.keys, [-2, 5, i32::MAX]);
        let all: Vec<_> = groups.iter().map(|(key, things)| (key, things.to_vec())).collect();
        assert_eq!(all, [(-2, vec![1, 5]), (5, vec![0, 2, 3]), (i32::MAX, vec![4])]);
        assert_eq!(Groups::<i32>::new(&[]).unwrap().iter().len(), 0);
    }

    #[test]
    fn distinct_values_of_many() {
        let items: Vec<i32> = (0..100_000).map(|i| i * 7919 % 300 - 150).collect();
        assert_eq!(distinct(&items), (-150..150).collect::<Vec<_>>());
    }
}
