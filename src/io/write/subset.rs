//! Some of the points of a mesh, numbered for files and blocks that hold no others.
//!
//! A bit for each point of the mesh, and for each word of bits how many points are before it: 2
//! bits per point.

use std::ops::Range;

use crate::Result;
use crate::memory::filled;
use crate::mesh::TetMesh;

/// 64 points of the mesh.
#[derive(Clone, Copy)]
struct Word {
    bits: u64,
    /// Chosen points in the words before.
    before: u32,
}

/// Points in the order of the mesh, each with its place among them.
pub(super) struct Subset {
    words: Vec<Word>,
    count: usize,
}

impl Subset {
    /// The points that `nodes` has, each of them once or more often, of so many in the mesh.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(points: usize, nodes: impl Iterator<Item = u32>) -> Result<Self> {
        let nothing = Word { bits: 0, before: 0 };
        let mut words = filled(points.div_ceil(64), nothing, "points of a part", || Ok(()))?;
        nodes.for_each(|v| words[v as usize / 64].bits |= 1 << (v % 64));
        let mut count = 0;
        for word in &mut words {
            word.before = count;
            count += word.bits.count_ones();
        }
        Ok(Self { words, count: count as usize })
    }

    /// The vertices of the interface facets.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn of_surface(mesh: &TetMesh) -> Result<Self> {
        Self::new(mesh.points.len(), mesh.facets.iter().flatten().copied())
    }

    pub fn len(&self) -> usize {
        self.count
    }

    /// The place of a point that was chosen.
    pub fn place(&self, v: u32) -> u32 {
        let word = self.words[v as usize / 64];
        word.before + (word.bits & ((1 << (v % 64)) - 1)).count_ones()
    }

    /// The points in some places.
    pub fn range(&self, places: Range<usize>) -> impl Iterator<Item = u32> {
        let first = self.words.partition_point(|word| word.before as usize <= places.start);
        let first = first.saturating_sub(1);
        let before = self.words.get(first).map_or(0, |word| word.before as usize);
        let points = self.words.iter().enumerate().skip(first).flat_map(|(i, word)| {
            let bits = word.bits;
            (0..64).filter(move |bit| bits >> bit & 1 == 1).map(move |bit| 64 * i as u32 + bit)
        });
        points.skip(places.start - before).take(places.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_have_places() {
        let chosen = [200, 3, 64, 3, 63, 191];
        let subset = Subset::new(201, chosen.into_iter()).unwrap();
        let points = [3, 63, 64, 191, 200];
        assert_eq!(subset.len(), 5);
        for (place, &point) in points.iter().enumerate() {
            assert_eq!(subset.place(point) as usize, place);
            assert!(subset.range(place..5).eq(points[place..].iter().copied()));
        }
        assert_eq!(Subset::new(0, [].into_iter()).unwrap().range(0..0).count(), 0);
    }
}
