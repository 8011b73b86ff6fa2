//! One thread's view of the triangulation: its policy, its free slots, its scratch memory, its counters.

use std::ops::Range;

use super::access::Access;
use super::cavity::CavityFacet;
use super::chunked::CHUNK;
use super::remove::LinkScratch;
use super::tet::{Facet, TetId, VertexId, VertexKind};
use super::triangulation::Triangulation;
use crate::{Error, Result};
use glam::DVec3;

/// What a worker has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Vertices inserted.
    pub insertions: u64,
    /// Vertices removed.
    pub removals: u64,
    /// Operations given up because another worker owned a vertex.
    pub rollbacks: u64,
    /// In-sphere and orientation tests that went to exact arithmetic's door.
    pub exact_predicates: u64,
    /// Tets created, living or not.
    pub created: u64,
    /// Tets destroyed.
    pub destroyed: u64,
}

/// A worker. Slots that it frees it uses again at once, last in first out: a cavity's new tets land on the lines that are hot.
pub struct Worker<A> {
    pub(super) access: A,
    /// What this worker has done.
    pub counters: Counters,
    free: Vec<TetId>,
    fresh_tets: Range<u32>,
    fresh_vertices: Range<u32>,
    pub(super) cavity: Vec<TetId>,
    pub(super) boundary: Vec<CavityFacet>,
    pub(super) edges: EdgeTable,
    pub(super) created: Vec<TetId>,
    pub(super) link: LinkScratch,
}

impl<A: Access> Worker<A> {
    /// A worker without memory; it claims some when it first needs it.
    pub fn new(access: A) -> Self {
        Self {
            access,
            counters: Counters::default(),
            free: Vec::new(),
            fresh_tets: 0..0,
            fresh_vertices: 0..0,
            cavity: Vec::new(),
            boundary: Vec::new(),
            edges: EdgeTable::default(),
            created: Vec::new(),
            link: LinkScratch::default(),
        }
    }

    /// The tets that the last completed operation made.
    pub fn created(&self) -> &[TetId] {
        &self.created
    }

    /// Bytes of the list of free slots; the scratch memory beside it is that of a few operations.
    pub fn bytes(&self) -> u64 {
        (self.free.capacity() * size_of::<TetId>()) as u64
    }

    /// Makes sure that the next `count` tets and one vertex can be had without failing: an operation asks before it writes (invariant 5).
    pub(super) fn reserve(&mut self, triangulation: &Triangulation, count: usize) -> Result<()> {
        while self.free.len() + self.fresh_tets.len() < count {
            // For what is left of the range, and for most of what is freed until the next one.
            self.free.try_reserve(CHUNK).map_err(|_| Error::OutOfMemory { count: CHUNK, what: "free slots" })?;
            let range = triangulation.claim_tets()?;
            self.free.extend(std::mem::replace(&mut self.fresh_tets, range).rev());
        }
        if self.fresh_vertices.is_empty() {
            self.fresh_vertices = triangulation.claim_vertices()?;
        }
        Ok(())
    }

    #[inline]
    pub(super) fn take_tet(&mut self) -> TetId {
        self.counters.created += 1;
        match self.free.pop() {
            Some(t) => t,
            None => self.fresh_tets.next().expect("reserve() was asked for enough slots"),
        }
    }

    #[inline]
    pub(super) fn give_tet(&mut self, triangulation: &Triangulation, t: TetId) {
        triangulation.clear_tet(t);
        self.counters.destroyed += 1;
        self.free.push(t);
    }

    pub(super) fn take_vertex(&mut self, triangulation: &Triangulation, position: DVec3, kind: VertexKind) -> VertexId {
        let v = self.fresh_vertices.next().expect("reserve() keeps a vertex ready");
        triangulation.vertex(v).fill(position, kind);
        v
    }
}

/// Finds the two new facets that share an edge: a small open-addressed table, emptied by moving its epoch.
///
/// While a cavity is filled every boundary edge is met exactly twice; the second meeting joins the facets.
pub struct EdgeTable {
    entries: Vec<EdgeEntry>,
    epoch: u32,
}

#[derive(Clone, Copy)]
struct EdgeEntry {
    key: u64,
    epoch: u32,
    facet: Facet,
}

const EMPTY: EdgeEntry = EdgeEntry { key: 0, epoch: 0, facet: Facet::NONE };

impl Default for EdgeTable {
    fn default() -> Self {
        Self { entries: vec![EMPTY; 256], epoch: 0 }
    }
}

impl EdgeTable {
    /// Empties the table and gives it room for `edges` edges.
    pub fn begin(&mut self, edges: usize) {
        let wanted = (2 * edges).next_power_of_two();
        if wanted > self.entries.len() || self.epoch == u32::MAX {
            self.entries = vec![EMPTY; wanted.max(self.entries.len())];
            self.epoch = 0;
        }
        self.epoch += 1;
    }

    /// Notes `facet` under the edge (a, b) in either direction; returns the facet noted there before.
    #[inline]
    pub fn meet(&mut self, a: VertexId, b: VertexId, facet: Facet) -> Option<Facet> {
        let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
        let mask = self.entries.len() - 1;
        // Fibonacci hashing; the table is a power of two and at most half full, so the probe ends.
        let mut slot = (key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as usize & mask;
        loop {
            let entry = &mut self.entries[slot];
            if entry.epoch != self.epoch {
                *entry = EdgeEntry { key, epoch: self.epoch, facet };
                return None;
            }
            if entry.key == key {
                return Some(entry.facet);
            }
            slot = (slot + 1) & mask;
        }
    }
}
