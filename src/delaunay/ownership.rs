//! Who owns which vertices: the locks of speculative refinement.
//!
//! # The protocol
//! **What is locked.** Vertices, each by a word of its own, apart from the records: an operation asks for a vertex, and for most of them more than once, before it needs anything else of it, and 32 words are in a cache line.
//! An operation owns every vertex of every tet that it rewrites before it writes anything (invariant 4 of the module), and gives all back when it has
//! ended, completed or not. A tet can be rewritten only by a worker that owns its four vertices. Two tets that share a facet share three vertices, so from a tet that
//! one owns one can go to its neighbours safely: they stay as they are although one does not own their fourth vertex.
//!
//! **The way in.** A worker comes to its first tet by a note that may be out of date. It reads the four vertices, owns them, and reads them again: if they are the same, the tet lives
//! and nobody else can change it. (Whoever changes the slot owns all four old vertices meanwhile, and writes before giving them back; the last id of a free slot names no vertex.)
//!
//! **No deadlock.** A refusal ends the operation: its worker gives back all that it owns before it does anything else. Nobody waits while owning.
//!
//! **No livelock.** What a worker does after a refusal is the contention manager's business (`parallel/contention.rs`, which argues for each).
//!
//! **What is not locked.** Looking. Rules read tets and neighbours that they do not own, and may read a record while another worker rewrites it. All words are atomics, so this is no
//! undefined behaviour, but what was read is a hint. It is checked when the tet is owned: the tet that asks and, where it matters, the one across the facet have the vertices, circumsphere and label that
//! were read. A vertex that is being inserted need not be owned: each of its tets has three vertices that its worker owns.
//!
//! # Memory order
//! `Acquire` on taking pairs with `Release` on giving back: who owns a vertex sees all that its former owners wrote. So all other words can be relaxed. The ids in a tet's record, of its neighbours and its vertices, are written with `Release` and read with
//! `Acquire`, for those who look without owning: who reads an id finds the memory that it names, and a record that was filled once or is all zeros: a cavity's tets are linked while they are made. One who
//! sees zeros sees four vertices of id 0, which is what a walk is blocked by or finds stale, and a demand is not true of. On x86 all of these are plain loads and stores but the exchange itself.

use bytemuck::Zeroable;

use super::VertexId;
use super::lock::Owner;
use crate::memory::zeroed_box;

/// Words. Vertices whose ids are so many apart share one, and what is said of a vertex is true of both. So meshes beyond 4 million vertices have conflicts between operations far from each other: with 17 vertices
/// each, 64 workers have one in some 500 operations.
const WORDS: usize = 1 << 22;

/// The number of a vertex's word.
#[inline(always)]
pub fn word(v: VertexId) -> u32 {
    v % WORDS as u32
}

/// The words of a triangulation's vertices: 8 MiB, of which what is never used is never touched.
pub struct Owners(Box<[Owner; WORDS]>);

impl Owners {
    /// All nobody's.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new() -> crate::Result<Self> {
        Ok(Self(zeroed_box("bytes for the words of vertices")?))
    }

    /// How many are somebody's; out of date at once while others are at work.
    pub fn count_owned(&self) -> usize {
        self.0.iter().filter(|owner| owner.is_owned()).count()
    }

    /// Word `word`.
    #[inline(always)]
    pub fn get(&self, word: u32) -> &Owner {
        &self.0[word as usize % WORDS]
    }
}

// SAFETY: an atomic integer, for which 0 is a value.
unsafe impl Zeroable for Owner {}
