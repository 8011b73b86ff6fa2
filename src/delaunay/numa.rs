//! The memory node of each chunk of tets and vertices: that of the worker that claimed it and first
//! wrote to it (`chunked`).
//!
//! **Slots sent back.** A worker uses the slots of a cavity again at once, whoever claimed them.
//! Where the region of one node was meshed by others before, its tets would so stay in their memory
//! for ever: an insertion frees some 18 slots and takes the same 18 and 6 more. A worker that keeps
//! to its node (paper, section 4.2: new elements are stored in the memory of the node that made
//! them) sends a slot of another node back to that node, and takes one of its own instead. Slots
//! wait here until a worker of their node needs some.
//!
//! Thread safety: a chunk's node is written before its ids are given out, by whoever claims it, and
//! never changes. The slots sent back are behind a lock for each node; who takes one sees all that
//! was done to it before.
//!
//! Cost: a byte for each chunk that there may be, 80 KiB; 4 bytes for each slot that waits.

use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard};

use super::chunked::CHUNK;
use super::tet::{MAX_TETS, MAX_VERTICES, TetId, VertexId};
use crate::Result;
use crate::memory::{reserve, room};
use crate::sync::lock;

/// A memory node, by number.
pub type NodeId = u8;

/// Numbers that nodes may have.
pub const MAX_NODES: usize = NodeId::MAX as usize + 1;

/// The nodes of all chunks, and the slots on their way back to theirs.
pub struct NodeMap {
    tets: Vec<AtomicU8>,
    vertices: Vec<AtomicU8>,
    returned: Vec<Returned>,
}

/// Free slots of one node that others sent back.
#[derive(Default)]
struct Returned {
    slots: Mutex<Vec<TetId>>,
    /// How many there are, to be inspected without the lock.
    count: AtomicUsize,
}

impl Returned {
    fn slots(&self) -> MutexGuard<'_, Vec<TetId>> {
        lock(&self.slots)
    }
}

impl NodeMap {
    /// All chunks on node 0, until they are claimed.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub(super) fn new() -> Result<Self> {
        let chunks = |count: usize| -> Result<Vec<AtomicU8>> {
            let mut nodes = room(count, "nodes of chunks")?;
            nodes.resize_with(count, AtomicU8::default);
            Ok(nodes)
        };
        let mut returned = room(MAX_NODES, "memory nodes")?;
        returned.resize_with(MAX_NODES, Returned::default);
        Ok(Self {
            tets: chunks(MAX_TETS / CHUNK)?,
            vertices: chunks(MAX_VERTICES / CHUNK)?,
            returned,
        })
    }

    /// The node of a slot.
    #[inline(always)]
    pub fn of_tet(&self, t: TetId) -> NodeId {
        // Relaxed: who knows the id knows the chunk, and the node was written before both were
        // given out.
        self.tets[t as usize / CHUNK].load(Relaxed)
    }

    /// The node of a vertex.
    #[inline(always)]
    pub fn of_vertex(&self, v: VertexId) -> NodeId {
        // Relaxed: as above.
        self.vertices[v as usize / CHUNK].load(Relaxed)
    }

    pub(super) fn set_tets(&self, chunk: usize, node: NodeId) {
        self.tets[chunk].store(node, Relaxed);
    }

    pub(super) fn set_vertices(&self, chunk: usize, node: NodeId) {
        self.vertices[chunk].store(node, Relaxed);
    }

    /// Sends free slots of `node` back to it.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; the slots stay where they are.
    pub(super) fn give_back(&self, node: NodeId, slots: &mut Vec<TetId>) -> Result<()> {
        let returned = &self.returned[usize::from(node)];
        let mut waiting = returned.slots();
        reserve(&mut waiting, slots.len(), "slots sent back")?;
        waiting.append(slots);
        // Relaxed: a hint.
        returned.count.store(waiting.len(), Relaxed);
        Ok(())
    }

    /// Takes slots that were sent back to `node`, at most a chunk's, and puts them behind `free`;
    /// `false`: there were none.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub(super) fn take_returned(&self, node: NodeId, free: &mut Vec<TetId>) -> Result<bool> {
        let returned = &self.returned[usize::from(node)];
        if returned.count.load(Relaxed) == 0 {
            return Ok(false);
        }
        let mut waiting = returned.slots();
        let rest = waiting.len().saturating_sub(CHUNK);
        let count = waiting.len() - rest;
        reserve(free, count, "free slots")?;
        free.extend(waiting.drain(rest..));
        returned.count.store(waiting.len(), Relaxed);
        Ok(count > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_come_back_once() {
        let nodes = NodeMap::new().unwrap();
        nodes.set_tets(3, 7);
        assert_eq!(
            (nodes.of_tet(3 * CHUNK as u32 + 5), nodes.of_tet(5), nodes.of_vertex(5)),
            (7, 0, 0)
        );
        let mut sent: Vec<TetId> = (0..CHUNK as u32 + 10).collect();
        nodes.give_back(7, &mut sent).unwrap();
        assert!(sent.is_empty());
        let mut free = Vec::new();
        assert!(!nodes.take_returned(6, &mut free).unwrap());
        assert!(nodes.take_returned(7, &mut free).unwrap());
        assert_eq!(free.len(), CHUNK);
        assert!(nodes.take_returned(7, &mut free).unwrap());
        assert!(!nodes.take_returned(7, &mut free).unwrap());
        free.sort_unstable();
        assert!(free.into_iter().eq(0..CHUNK as u32 + 10));
    }
}
