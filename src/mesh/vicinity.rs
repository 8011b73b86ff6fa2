//! What one tet, or two that share a facet, have in common with the tets around them: the part of
//! their surface along which a label touches them. From it follows what the topology of the label
//! becomes when it gains or loses these tets.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::memory::bits::{Bits, Ranks};
use crate::memory::{parts, reserve, zeroed};
use crate::monitor::Monitor;

/// Tets of one piece of work.
const CHUNK: usize = 1 << 13;

/// What the tables of this module have, as errors name it.
const WHAT: &str = "tets around vertices";

/// The stars of some vertices: the tets that have them, in their order.
pub(crate) struct Stars {
    vertices: Bits,
    ranks: Ranks,
    /// Where the star of each begins, and where the last one ends.
    firsts: Vec<u32>,
    tets: Vec<u32>,
}

impl Stars {
    /// Those of `vertices`, which no longer change. Empty slots of the mesh have no vertices.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(mesh: &TetMesh, vertices: Bits, monitor: &Monitor<'_>) -> Result<Self> {
        let ranks = Ranks::new(&vertices, WHAT)?;
        let each = |visit: &(dyn Fn(u32, u32) + Sync)| {
            mesh.tets.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, tets)| {
                monitor.advance(0)?;
                for (t, corners) in ((CHUNK * chunk) as u32..).zip(tets) {
                    let of_list = corners.iter().filter(|&&v| v != NONE && vertices.has(v));
                    of_list.for_each(|&v| visit(ranks.of(&vertices, v), t));
                }
                Ok(())
            })
        };
        // Relaxed: sums are read when the loop over all tets has ended, as are the tets below.
        let counts: Vec<AtomicU32> = zeroed(ranks.count(), WHAT)?;
        each(&|n, _| _ = counts[n as usize].fetch_add(1, Relaxed))?;
        let mut firsts = Vec::new();
        reserve(&mut firsts, ranks.count() + 1, WHAT)?;
        firsts.push(0);
        for mut count in counts {
            firsts.push(firsts[firsts.len() - 1] + *count.get_mut());
        }
        let next: Vec<AtomicU32> = zeroed(ranks.count(), WHAT)?;
        let tets: Vec<AtomicU32> = zeroed(firsts[firsts.len() - 1] as usize, WHAT)?;
        each(&|n, t| {
            let place = firsts[n as usize] + next[n as usize].fetch_add(1, Relaxed);
            tets[place as usize].store(t, Relaxed);
        })?;
        let mut tets: Vec<u32> = tets.into_iter().map(AtomicU32::into_inner).collect();
        let chunks = || firsts[..ranks.count()].chunks(CHUNK).zip(firsts[1..].chunks(CHUNK));
        let lengths = chunks().map(|(firsts, ends)| (ends[ends.len() - 1] - firsts[0]) as usize);
        let pieces = parts(&mut tets, lengths, WHAT)?;
        pieces.into_par_iter().zip(chunks().collect::<Vec<_>>()).for_each(
            |(piece, (firsts, ends))| {
                let star = |(first, end): (&u32, &u32)| (first - firsts[0], end - firsts[0]);
                for (first, end) in firsts.iter().zip(ends).map(star) {
                    piece[first as usize..end as usize].sort_unstable();
                }
            },
        );
        Ok(Self { vertices, ranks, firsts, tets })
    }

    /// That of a vertex, which must be one of those.
    pub fn of(&self, v: u32) -> &[u32] {
        debug_assert!(self.vertices.has(v), "the star of vertex {v}");
        let n = self.ranks.of(&self.vertices, v) as usize;
        &self.tets[self.firsts[n] as usize..self.firsts[n + 1] as usize]
    }
}

/// The tets that have a vertex `v` of `tet`, in their order: for who needs a few.
pub(crate) fn star_of(mesh: &TetMesh, v: u32, tet: u32) -> Vec<u32> {
    // From tet to tet across the facets that have it.
    let mut found = vec![tet];
    let mut next = 0;
    while let Some(&here) = found.get(next) {
        next += 1;
        let (vertices, neighbors) = (mesh.tets[here as usize], mesh.neighbors[here as usize]);
        for (i, &other) in neighbors.iter().enumerate() {
            if vertices[i] != v && other != NONE && !found.contains(&other) {
                found.push(other);
            }
        }
    }
    found.sort_unstable();
    found
}

/// A tet, or two that share a facet, and the tets that share at least a vertex with them.
pub(crate) struct Vicinity {
    /// The corners of the first tet.
    first: [u32; 4],
    /// The tets around, and which corners each shares: bit i for the i-th corner, bit 4 for that of
    /// the second tet alone.
    around: Vec<(u32, u32)>,
    /// The corners of each tet inside, likewise.
    inside: Vec<u32>,
}

/// A set of faces of the tets inside: corners, edges, facets. Bit n stands for the face whose
/// corners are the bits of n. Two tets have 5 corners, so 32 bits are enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Faces(u32);

impl Vicinity {
    /// That of a tet; `star_of` tells the stars of its corners.
    pub fn new<S: AsRef<[u32]>>(mesh: &TetMesh, tet: u32, star_of: impl Fn(u32) -> S) -> Self {
        let first = mesh.tets[tet as usize];
        let mut around = Vec::new();
        for (i, v) in first.into_iter().enumerate() {
            around = merged(&around, star_of(v).as_ref(), 1 << i);
        }
        around.retain(|&(t, _)| t != tet);
        Self { first, around, inside: vec![0b1111] }
    }

    /// That of its tet, and of another one with which that shares a facet; `star_of` tells the
    /// stars of its corners.
    pub fn with<S: AsRef<[u32]>>(
        &self,
        mesh: &TetMesh,
        other: u32,
        star_of: impl Fn(u32) -> S,
    ) -> Self {
        let corners = mesh.tets[other as usize];
        let is_shared = |v: &u32| corners.contains(v);
        let bits = self.first.iter().enumerate().map(|(i, v)| u32::from(is_shared(v)) << i);
        let inside = vec![0b1111, 1 << 4 | bits.sum::<u32>()];
        let mut around = self.around.clone();
        if let Some(&v) = corners.iter().find(|v| !self.first.contains(v)) {
            around = merged(&around, star_of(v).as_ref(), 1 << 4);
        }
        around.retain(|&(t, _)| t != other);
        Self { first: self.first, around, inside }
    }

    /// The tets around.
    pub fn around(&self) -> impl Iterator<Item = u32> {
        self.around.iter().map(|&(t, _)| t)
    }

    /// The faces that the tets inside share with those around of which `is` is true.
    pub fn shared_with(&self, is: impl Fn(u32) -> bool) -> Faces {
        let mut faces = 0;
        for &(_, shared) in self.around.iter().filter(|&&(t, _)| is(t)) {
            for inside in &self.inside {
                faces |= WITH_FACES[(shared & inside) as usize];
            }
        }
        Faces(faces)
    }

    /// Whether each corner is one of a tet around of which `is` is true.
    pub fn all_corners_on(&self, is: impl Fn(u32) -> bool) -> bool {
        let all = self.inside.iter().fold(0, |all, corners| all | corners);
        let around = self.around.iter().filter(|&&(t, _)| is(t));
        around.fold(0, |found, &(_, shared)| found | shared) == all
    }
}

/// Tets with bits, in their order, and those of a star with one bit more.
fn merged(tets: &[(u32, u32)], star: &[u32], bit: u32) -> Vec<(u32, u32)> {
    let mut all = Vec::with_capacity(tets.len() + star.len());
    let mut star = star.iter().copied().peekable();
    for &(t, bits) in tets {
        while let Some(before) = star.next_if(|&s| s < t) {
            all.push((before, bit));
        }
        let is_in_both = star.next_if_eq(&t).is_some();
        all.push((t, if is_in_both { bits | bit } else { bits }));
    }
    all.extend(star.map(|t| (t, bit)));
    all
}

/// For each set of corners its face and all faces of it, as [`Faces`].
const WITH_FACES: [u32; 32] = {
    let mut faces = [0; 32];
    let mut all = 0;
    while all < 32 {
        let mut face = all;
        while face != 0 {
            faces[all] |= 1 << face;
            face = (face - 1) & all;
        }
        all += 1;
    }
    faces
};

/// The faces with so many corners that there are, as [`Faces`].
const OF_SIZE: [u32; 4] = {
    let mut faces = [0; 4];
    let mut face = 1_u32;
    while face < 32 {
        if face.count_ones() < 4 {
            faces[face.count_ones() as usize] |= 1 << face;
        }
        face += 1;
    }
    faces
};

impl Faces {
    /// The faces with so many corners, as sets of these.
    fn with_corners(self, count: usize) -> impl Iterator<Item = u32> {
        let mut left = self.0 & OF_SIZE[count];
        std::iter::from_fn(move || {
            let face = (left != 0).then(|| left.trailing_zeros())?;
            left &= left - 1;
            Some(face)
        })
    }

    /// The Euler characteristic of their union.
    pub fn euler(self) -> i64 {
        let count = |corners: usize| i64::from((self.0 & OF_SIZE[corners]).count_ones());
        count(1) - count(2) + count(3)
    }

    /// How many pieces their union has.
    pub fn pieces(self) -> u32 {
        let mut left = self.with_corners(1).fold(0, |all, corner| all | corner);
        let mut count = 0;
        while left != 0 {
            let mut piece = left & left.wrapping_neg();
            loop {
                let edges = self.with_corners(2).filter(|edge| edge & piece != 0);
                let larger = edges.fold(piece, |all, edge| all | edge);
                if larger == piece {
                    break;
                }
                piece = larger;
            }
            left &= !piece;
            count += 1;
        }
        count
    }

    /// How many edges and corners are part of no facet among them: there they are no surface.
    pub fn loose(self) -> usize {
        let is_part = |face: u32| self.with_corners(3).any(|facet| face & !facet == 0);
        let smaller = self.with_corners(1).chain(self.with_corners(2));
        smaller.filter(|&face| !is_part(face)).count()
    }

    /// Of a single tet: whether they are one to three facets, with nothing beside them: a disc.
    pub fn is_disc(self) -> bool {
        (1..=3).contains(&self.with_corners(3).count()) && self.loose() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing;

    /// The faces with these corners, and all of their faces.
    fn closed(faces: &[u32]) -> Faces {
        let subsets = |&face: &u32| (1..=face).filter(move |sub| sub & !face == 0);
        Faces(faces.iter().flat_map(subsets).fold(0, |all, face| all | 1 << face))
    }

    #[test]
    fn shapes_on_a_tet() {
        // Faces, pieces, Euler characteristic, whether a disc.
        let cases = [
            (&[0b0111][..], 1, 1, true),
            (&[0b0111, 0b1011, 0b1101], 1, 1, true),
            (&[0b0111, 0b1001], 1, 1, false),
            (&[0b0111, 0b1000], 2, 2, false),
            (&[0b0011], 1, 1, false),
            (&[0b0011, 0b1100], 2, 2, false),
            (&[0b0011, 0b0110, 0b0101], 1, 0, false),
            (&[0b0111, 0b1100, 0b1001], 1, 0, false),
            (&[0b0111, 0b1011, 0b1101, 0b1110], 1, 2, false),
            (&[], 0, 0, false),
        ];
        for (faces, pieces, euler, is_disc) in cases {
            let found = closed(faces);
            assert_eq!((found.pieces(), found.euler()), (pieces, euler), "{faces:?}");
            assert_eq!(found.is_disc(), is_disc, "{faces:?}");
        }
    }

    #[test]
    fn all_around_is_a_sphere_and_nothing_is_missed() {
        let mesh = testing::kuhn_box([3; 3], [1.0; 3], |_, _, _| 1);
        let is_inner = |t: u32| {
            mesh.tets[t as usize]
                .iter()
                .all(|&v| mesh.points[v as usize].iter().all(|&c| (0.5..2.5).contains(&c)))
        };
        let inner: Vec<u32> = (0..mesh.tets.len() as u32).filter(|&t| is_inner(t)).collect();
        assert!(!inner.is_empty());
        let vertices = Bits::new(mesh.points.len(), WHAT).unwrap();
        (0..mesh.points.len() as u32).for_each(|v| vertices.set(v));
        let stars = Stars::new(&mesh, vertices, &Monitor::silent()).unwrap();
        for &t in &inner {
            for v in mesh.tets[t as usize] {
                assert_eq!(stars.of(v), star_of(&mesh, v, t));
            }
            let others = mesh.neighbors[t as usize].iter().filter(|&&n| is_inner(n));
            let alone = Vicinity::new(&mesh, t, |v| stars.of(v));
            let pairs = others.map(|&n| (vec![t, n], alone.with(&mesh, n, |v| stars.of(v))));
            let pairs: Vec<_> = pairs.collect();
            for (set, vicinity) in pairs.into_iter().chain([(vec![t], alone)]) {
                let all = vicinity.shared_with(|_| true);
                assert_eq!((all.pieces(), all.euler()), (1, 2));
                let of_set: Vec<u32> = set.iter().flat_map(|&t| mesh.tets[t as usize]).collect();
                let touches = |t: &u32| {
                    !set.contains(t) && mesh.tets[*t as usize].iter().any(|v| of_set.contains(v))
                };
                let expected: Vec<u32> = (0..mesh.tets.len() as u32).filter(touches).collect();
                assert_eq!(vicinity.around().collect::<Vec<_>>(), expected);
            }
        }
    }
}
