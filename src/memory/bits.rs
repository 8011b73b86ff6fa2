//! A bit for each of many things, which many threads set at the same time.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use super::{filled, reserve, zeroed};
use crate::Result;

/// Bits, none of which is set at first. Read and written with relaxed order: who asks for a bit
/// that another thread may be setting learns the one or the other.
#[derive(Debug, Default)]
pub struct Bits {
    words: Vec<AtomicU32>,
}

impl Bits {
    /// So many bits, counted as `what`.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(count: usize, what: &'static str) -> Result<Self> {
        Ok(Self { words: zeroed(words_for(count), what)? })
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Makes them so many, or more.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn grow(&mut self, count: usize, what: &'static str) -> Result<()> {
        let more = words_for(count).saturating_sub(self.words.len());
        reserve(&mut self.words, more, what)?;
        self.words.extend(std::iter::repeat_with(AtomicU32::default).take(more));
        Ok(())
    }

    /// Sets bit `i`.
    #[inline]
    pub fn set(&self, i: u32) {
        let (word, bit) = (&self.words[(i / u32::BITS) as usize], 1 << (i % u32::BITS));
        // Most are set already: looking first spares the locked operation.
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
    }

    /// Whether bit `i` is set.
    #[inline]
    pub fn has(&self, i: u32) -> bool {
        self.words[(i / u32::BITS) as usize].load(Relaxed) >> (i % u32::BITS) & 1 == 1
    }

    /// The bits that are set, in their order.
    pub fn ones(&self) -> impl Iterator<Item = u32> {
        (0_u32..).step_by(u32::BITS as usize).zip(&self.words).flat_map(|(first, word)| {
            let mut left = word.load(Relaxed);
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some(first + bit)
            })
        })
    }
}

/// How many bits that no longer change are set before each.
pub struct Ranks {
    /// Before each word, and before the end.
    before: Vec<u32>,
}

impl Ranks {
    /// Those of these bits, of which fewer than 2^32 are set.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(bits: &Bits, what: &'static str) -> Result<Self> {
        let mut before = filled(bits.words.len() + 1, 0, what, || Ok(()))?;
        let mut count = 0;
        for (word, after) in bits.words.iter().zip(&mut before[1..]) {
            count += word.load(Relaxed).count_ones();
            *after = count;
        }
        Ok(Self { before })
    }

    /// How many are set in all.
    pub fn count(&self) -> usize {
        self.before.last().map_or(0, |&count| count as usize)
    }

    /// How many are set before bit `i`.
    #[inline]
    pub fn of(&self, bits: &Bits, i: u32) -> u32 {
        let word = (i / u32::BITS) as usize;
        let before = bits.words[word].load(Relaxed) & ((1 << (i % u32::BITS)) - 1);
        self.before[word] + before.count_ones()
    }
}

fn words_for(count: usize) -> usize {
    count.div_ceil(u32::BITS as usize)
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn bits_that_many_set_are_set() {
        let is_set = |i: u32| i.is_multiple_of(3) || i.is_multiple_of(7);
        let mut bits = Bits::new(1000, "bits").unwrap();
        (0..1000).into_par_iter().filter(|&i| is_set(i)).for_each(|i| bits.set(i));
        bits.grow(1500, "bits").unwrap();
        bits.grow(100, "bits").unwrap();
        assert!((0..1500).all(|i| bits.has(i) == (i < 1000 && is_set(i))));
        assert!(!bits.is_empty() && Bits::default().is_empty());
        let ones: Vec<u32> = (0..1000).filter(|&i| is_set(i)).collect();
        assert!(bits.ones().eq(ones.iter().copied()));
        let ranks = Ranks::new(&bits, "bits").unwrap();
        let rank = |i: u32| ones.iter().filter(|&&one| one < i).count() as u32;
        assert!((0..1500).all(|i| ranks.of(&bits, i) == rank(i)));
        assert_eq!(ranks.count(), ones.len());
    }
}
