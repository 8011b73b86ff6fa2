//! Who may touch a vertex: the policy under which a worker operates, a type parameter of the kernel.
//!
//! An operation asks to own every vertex of every tet that it will rewrite, before it writes anything (invariant 4). A refusal ends the operation
//! with *blocked* and nothing changed. Nobody waits while owning. The protocol is told in `ownership`.

use super::counted::Visits;
#[cfg(feature = "force-conflicts")]
use super::forced_conflicts::ForcedConflicts;
use super::lock::{Claim, OwnerId};
use super::ownership::word;
use super::triangulation::Triangulation;
use super::{TetId, VertexId};

/// A locking policy.
pub trait Access {
    /// Whether others may operate at the same time: what was read without owning is to be checked.
    const SHARED: bool;

    /// Whether it wants to be told of visits: what would be done only to tell it is left out otherwise.
    const HEARS: bool = true;

    /// Asks for `vertex` until [`Access::release_all`]; `false` when another worker owns it. Asking twice is fine.
    fn try_own(&mut self, triangulation: &Triangulation, vertex: VertexId) -> bool;

    /// Gives back every vertex.
    fn release_all(&mut self, triangulation: &Triangulation);

    /// The number of the worker that caused the last refusal, from 0; `None`: there was none.
    fn met(&self) -> Option<usize>;

    /// Told of each tet to which an operation comes: on a walk; tested against the point of a cavity, once for each facet through which that happens; in the star of a vertex
    /// to be removed or across its link; written. Nothing happens, and nothing is compiled, unless a policy counts.
    #[inline(always)]
    fn visit_tet(&mut self, _: TetId) {}

    /// Told of each vertex whose record an operation comes to, once in each of its parts: on a walk, taken into a cavity, on the boundary when the star is filled, in the link of a vertex to be removed.
    #[inline(always)]
    fn visit_vertex(&mut self, _: VertexId) {}

    /// What was counted; `None`: the policy does not count.
    fn visits(&self) -> Option<&Visits> {
        None
    }
}

/// Nobody else is there: one thread refines, locks compile to nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Access for Solo {
    const SHARED: bool = false;
    const HEARS: bool = false;

    #[inline(always)]
    fn try_own(&mut self, _: &Triangulation, _: VertexId) -> bool {
        true
    }

    #[inline(always)]
    fn release_all(&mut self, _: &Triangulation) {}

    fn met(&self) -> Option<usize> {
        None
    }
}

/// One of many workers on one triangulation: vertices are owned by the word in their record.
#[derive(Debug)]
pub struct TryLock {
    me: OwnerId,
    /// Words of groups of vertices.
    owned: Vec<u32>,
    met: OwnerId,
    #[cfg(feature = "force-conflicts")]
    forced: ForcedConflicts,
}

impl TryLock {
    /// Worker `number`, from 0; no two of a triangulation have the same.
    pub fn new(number: usize) -> Self {
        let me = OwnerId::try_from(number + 1).expect("fewer workers than owner words can name");
        Self {
            me,
            owned: Vec::new(),
            met: me,
            #[cfg(feature = "force-conflicts")]
            forced: ForcedConflicts::new(me),
        }
    }
}

impl Access for TryLock {
    const SHARED: bool = true;
    const HEARS: bool = false;

    #[inline]
    fn try_own(&mut self, triangulation: &Triangulation, vertex: VertexId) -> bool {
        #[cfg(feature = "force-conflicts")]
        if let Some(other) = self.forced.refuses() {
            self.met = other;
            return false;
        }
        let word = word(vertex);
        match triangulation.owner(word).claim(self.me) {
            Claim::Taken => self.owned.push(word),
            Claim::Held => {}
            Claim::Refused(other) => {
                self.met = other;
                return false;
            }
        }
        true
    }

    #[inline]
    fn release_all(&mut self, triangulation: &Triangulation) {
        for word in self.owned.drain(..) {
            triangulation.owner(word).release();
        }
        #[cfg(feature = "force-conflicts")]
        self.forced.next_operation();
    }

    fn met(&self) -> Option<usize> {
        (self.met != self.me).then(|| usize::from(self.met) - 1)
    }
}
