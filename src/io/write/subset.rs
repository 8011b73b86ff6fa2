//! Some of the points of a mesh, numbered for files and blocks that hold no others.
//!
//! Few points are listed. Of many there is a bit for each point of the mesh, and for each word of
//! bits how many points are before it: 2 bits per point.

use std::ops::Range;

use crate::Result;
use crate::memory::{filled, reserve};
use crate::mesh::TetMesh;

/// 64 points of the mesh.
#[derive(Clone, Copy)]
pub(super) struct Word {
    bits: u64,
    /// Chosen points in the words before.
    before: u32,
}

/// So many points of the mesh for each node at least, and they are listed: the table of bits would
/// be the larger one.
const POINTS_PER_NODE: usize = 16;

/// Points in the order of the mesh, each with its place among them.
pub(super) enum Subset {
    Few(Vec<u32>),
    Many { words: Vec<Word>, count: usize },
}

impl Subset {
    /// The points that `nodes` has, each of them once or more often, of so many in the mesh.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(points: usize, mut nodes: impl Iterator<Item = u32>) -> Result<Self> {
        let mut few = Vec::new();
        for v in nodes.by_ref().take(points / POINTS_PER_NODE) {
            reserve(&mut few, 1, "points of a part")?;
            few.push(v);
        }
        let Some(next) = nodes.next() else {
            few.sort_unstable();
            few.dedup();
            return Ok(Self::Few(few));
        };
        let nothing = Word { bits: 0, before: 0 };
        let mut words = filled(points.div_ceil(64), nothing, "points of a part", || Ok(()))?;
        let nodes = few.into_iter().chain([next]).chain(nodes);
        nodes.for_each(|v| words[v as usize / 64].bits |= 1 << (v % 64));
        let mut count = 0;
        for word in &mut words {
            word.before = count;
            count += word.bits.count_ones();
        }
        Ok(Self::Many { words, count: count as usize })
    }

    /// The vertices of the interface facets.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn of_surface(mesh: &TetMesh) -> Result<Self> {
        Self::new(mesh.points.len(), mesh.facets.iter().flatten().copied())
    }

    pub fn len(&self) -> usize {
        match self {
            Self::Few(points) => points.len(),
            Self::Many { count, .. } => *count,
        }
    }

    /// The place of a point that was chosen.
    pub fn place(&self, v: u32) -> u32 {
        match self {
            Self::Few(points) => points.partition_point(|&point| point < v) as u32,
            Self::Many { words, .. } => {
                let word = words[v as usize / 64];
                word.before + (word.bits & ((1 << (v % 64)) - 1)).count_ones()
            }
        }
    }

    /// The points in some places.
    pub fn range(&self, places: Range<usize>) -> impl Iterator<Item = u32> {
        let (few, words): (&[u32], &[Word]) = match self {
            Self::Few(points) => (&points[places.clone()], &[]),
            Self::Many { words, .. } => (&[], words),
        };
        let first = words.partition_point(|word| word.before as usize <= places.start);
        let first = first.saturating_sub(1);
        let before = words.get(first).map_or(0, |word| word.before as usize);
        let points = words.iter().enumerate().skip(first).flat_map(|(i, word)| {
            let bits = word.bits;
            (0..64).filter(move |bit| bits >> bit & 1 == 1).map(move |bit| 64 * i as u32 + bit)
        });
        few.iter().copied().chain(points.skip(places.start - before).take(places.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_have_places() {
        let chosen = [200, 3, 64, 3, 63, 191];
        for (count, is_few) in [(201, false), (2000, true)] {
            let subset = Subset::new(count, chosen.into_iter().cycle().take(18)).unwrap();
            assert_eq!(matches!(subset, Subset::Few(_)), is_few);
            let points = [3, 63, 64, 191, 200];
            assert_eq!(subset.len(), 5);
            for (place, &point) in points.iter().enumerate() {
                assert_eq!(subset.place(point) as usize, place);
                assert!(subset.range(place..5).eq(points[place..].iter().copied()));
            }
        }
        assert_eq!(Subset::new(0, [].into_iter()).unwrap().range(0..0).count(), 0);
    }
}
