//! Sums by key, gathered in parallel.
//!
//! Each piece of work keeps sums of its own. Entries of one key are added up in the order
//! in which they came, pieces in their order: equal input gives equal bits, whatever the number of
//! threads. Cost: two comparisons for an entry of the same key as one of the two before, a sort of
//! the others.

use std::ops::AddAssign;

/// Entries of one piece of work.
pub(crate) struct KeyedSums<T>(Vec<(u64, T)>);

impl<T> Default for KeyedSums<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// The sums, in increasing order of key.
pub(crate) type Sums<T> = Vec<(u64, T)>;

impl<T: AddAssign + Copy> KeyedSums<T> {
    /// Adds `value` to the sum of `key`.
    #[inline]
    pub fn add(&mut self, key: u64, value: T) {
        // Often two keys take turns: those of the two sides of an interface.
        let last = self.0.len().saturating_sub(2);
        match self.0[last..].iter_mut().rev().find(|entry| entry.0 == key) {
            Some((_, sum)) => *sum += value,
            None => self.0.push((key, value)),
        }
    }

    /// The sums of this piece of work.
    pub fn sums(mut self) -> Sums<T> {
        // Stable: entries of one key keep their order.
        self.0.sort_by_key(|&(key, _)| key);
        let mut sums: Sums<T> = Vec::with_capacity(self.0.len().min(64));
        for (key, value) in self.0 {
            match sums.last_mut() {
                Some((last, sum)) if *last == key => *sum += value,
                _ => sums.push((key, value)),
            }
        }
        sums
    }

    /// The sums of all pieces.
    pub fn total(pieces: Vec<Sums<T>>) -> Sums<T> {
        Self(pieces.into_iter().flatten().collect()).sums()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_by_key() {
        let sums = |entries: &[(u64, i64)]| {
            let mut keyed_sums = KeyedSums::default();
            entries.iter().for_each(|&(key, value)| keyed_sums.add(key, value));
            keyed_sums.sums()
        };
        let pieces =
            vec![sums(&[(3, 1), (3, 1), (1, 5), (3, 10)]), sums(&[]), sums(&[(1, -5), (0, 7)])];
        assert_eq!(pieces[0], [(1, 5), (3, 12)]);
        assert_eq!(KeyedSums::total(pieces), [(0, 7), (1, 0), (3, 12)]);
    }
}
