//! Disjoint sets of numbers that any number of threads may join at once, and their numbering.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::Result;
use crate::memory::{room, zeroed};

/// Numbers of one piece of work.
const CHUNK: usize = 1 << 14;

/// "In no set", where sets are numbered.
pub(crate) const NO_SET: u32 = u32::MAX;

/// Disjoint sets of the numbers from 0 on.
///
/// Path halving and union by index (Tarjan and van Leeuwen 1984), the union by compare-and-swap of
/// the root (Anderson and Woll, "Wait-free parallel algorithms for the union-find problem", 1991).
/// What must hold: a number that is no root never becomes one again, and what it points to is a
/// smaller number of the same set. So there are no cycles, a shortcut written late is still right,
/// and of two threads that give a root a parent one fails and looks again; and the root of a set is
/// its smallest number. Relaxed order suffices: the words carry no other data, and each is changed
/// in one order that all threads agree on.
pub(crate) struct UnionFind {
    /// How far below a number its parent is; 0 for a root. Zeroed memory holds sets of one.
    steps: Vec<AtomicU32>,
}

impl UnionFind {
    /// As many sets of one.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(count: usize, what: &'static str) -> Result<Self> {
        Ok(Self { steps: zeroed(count, what)? })
    }

    /// The smallest number of the set of `x`.
    pub fn root(&self, mut x: u32) -> u32 {
        loop {
            let step = self.steps[x as usize].load(Relaxed);
            let parent = x - step;
            let next = self.steps[parent as usize].load(Relaxed);
            if next == 0 {
                return parent;
            }
            self.steps[x as usize].store(step + next, Relaxed);
            x = parent - next;
        }
    }

    /// Joins two sets; whether they were different.
    pub fn join(&self, mut x: u32, mut y: u32) -> bool {
        loop {
            (x, y) = (self.root(x), self.root(y));
            if x == y {
                return false;
            }
            // The older one becomes the root, which keeps paths short in scan order.
            let (root, other) = (x.min(y), x.max(y));
            if self.steps[other as usize]
                .compare_exchange(0, other - root, Relaxed, Relaxed)
                .is_ok()
            {
                return true;
            }
        }
    }

    /// Numbers the sets in the order of their smallest numbers, those alone whose root `counts`.
    /// Does not depend on the number of threads. Nobody may join sets any more. `go_on` is asked
    /// for each some thousand numbers.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); those of `go_on`.
    pub fn numbered(
        self,
        counts: impl Fn(u32) -> bool + Sync,
        what: &'static str,
        go_on: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Numbered> {
        let numbers: Vec<AtomicU32> = zeroed(self.steps.len(), what)?;
        let is_root = |x: u32| self.steps[x as usize].load(Relaxed) == 0 && counts(x);
        let chunks = 0..self.steps.len().div_ceil(CHUNK);
        let range = |chunk: usize| {
            (chunk * CHUNK) as u32..((chunk + 1) * CHUNK).min(self.steps.len()) as u32
        };
        let roots_in = |chunk: usize| {
            let roots = || range(chunk).filter(|&x| is_root(x));
            let mut list = room(roots().count(), what)?;
            list.extend(roots());
            Ok(list)
        };
        let roots: Vec<Vec<u32>> =
            chunks.clone().into_par_iter().map(roots_in).collect::<Result<_>>()?;
        let starts = roots
            .iter()
            .scan(0, |next, roots| Some(std::mem::replace(next, *next + roots.len() as u32)));
        let firsts: Vec<u32> = starts.collect();
        let each = |pass: &(dyn Fn(usize) + Sync)| {
            chunks.clone().into_par_iter().try_for_each(|chunk| {
                go_on()?;
                pass(chunk);
                Ok(())
            })
        };
        each(&|chunk| {
            roots[chunk]
                .iter()
                .zip(firsts[chunk]..)
                .for_each(|(&x, number)| numbers[x as usize].store(number, Relaxed));
        })?;
        // A number's root has been numbered by the pass before.
        each(&|chunk| {
            for x in range(chunk) {
                let root = self.root(x);
                if !counts(root) {
                    numbers[x as usize].store(NO_SET, Relaxed);
                } else if root != x {
                    numbers[x as usize].store(numbers[root as usize].load(Relaxed), Relaxed);
                }
            }
        })?;
        let mut all = room(roots.iter().map(Vec::len).sum(), what)?;
        roots.iter().for_each(|roots| all.extend_from_slice(roots));
        Ok(Numbered { numbers, roots: all })
    }
}

/// Numbered sets.
pub(crate) struct Numbered {
    numbers: Vec<AtomicU32>,
    /// The smallest number of each set.
    pub roots: Vec<u32>,
}

impl Numbered {
    /// The number of the set of `x`, or [`NO_SET`].
    #[inline]
    pub fn of(&self, x: u32) -> u32 {
        self.numbers[x as usize].load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_joined_by_many_threads_at_once() {
        let count = 3 * CHUNK as u32;
        let sets = UnionFind::new(count as usize, "numbers").unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        // Each thread joins x with x + 7, in another order: 7 sets remain.
        let (joins, numbered) = pool.install(|| {
            let order = |n: u32| (0..count - 7).map(move |i| i * (2 * n + 1) % (count - 7));
            let joined = |n| order(n).filter(|&x| sets.join(x, x + 7)).count();
            let joins: usize = (0..6_u32).into_par_iter().map(joined).sum();
            (joins, sets.numbered(|x| x != 3, "numbers", &|| Ok(())).unwrap())
        });
        assert_eq!((joins, &numbered.roots[..]), (count as usize - 7, &[0, 1, 2, 4, 5, 6][..]));
        let expected = |x: u32| [0, 1, 2, NO_SET, 3, 4, 5][x as usize % 7];
        (0..count).for_each(|x| assert_eq!(numbered.of(x), expected(x), "{x}"));
    }
}
