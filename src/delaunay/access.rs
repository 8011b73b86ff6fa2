//! Who may touch a tet: the policy under which a worker operates, a type parameter of the kernel.
//!
//! An operation asks to own every tet that it will destroy, and looks whose the tets around are,
//! before it writes anything (invariant 4). A refusal ends the operation with *blocked* and nothing
//! changed. Nobody waits while owning. The protocol is told in `ownership`.

use super::counted::Visits;
#[cfg(feature = "force-conflicts")]
use super::forced_conflicts::ForcedConflicts;
use super::ownership::{Holder, MAX_OWNERS, NOBODY, Owner, OwnerId};
use super::triangulation::Triangulation;
use super::{TetId, VertexId};
#[cfg(feature = "simulation")]
use crate::simulation::hooks;

/// What an operation, or a look, consists of beside visits, as policies are told that keep account
/// of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// An insertion or removal begins.
    Operation,
    /// Exact predicates.
    Exact(u64),
    /// Tets made.
    Fill(usize),
    /// Facets of a removal, each against the vertices of the link.
    Pairs(usize),
    /// A tet is looked at for what the rules demand.
    Look,
    /// Labels looked up.
    Labels(u64),
    /// Crossings looked up.
    Crossings(u64),
    /// A tet is asked for.
    Claim,
}

/// A locking policy.
pub trait Access {
    /// Whether others may operate at the same time: what was read without owning is to be checked.
    const SHARED: bool;

    /// Whether it wants to be told of visits: what would be done only to tell it is left out
    /// otherwise.
    const HEARS: bool = true;

    /// Asks for the tet with this `owner`: [`Holder::Nobody`]: it is the worker's now.
    fn try_own(&mut self, owner: &Owner) -> Holder;

    /// Looks whose the tet with this `owner` is, across a facet of one that is owned.
    fn look_across(&mut self, owner: &Owner) -> Holder;

    /// Whose a tet is that the worker writes.
    fn owner_of_new(&self) -> OwnerId;

    /// Told that the worker is about to give back all that it owns.
    #[inline(always)]
    fn end_operation(&mut self) {}

    /// Told of work, when it has been done; for those that keep account.
    #[inline(always)]
    fn spend(&mut self, _: Effort) {}

    /// Told that the worker looks at tet `t`, of which it owns nothing, for what the rules demand.
    #[inline(always)]
    fn look(&mut self, _: &Triangulation, _: TetId) {}

    /// Told that the worker looks around between two steps, owning nothing.
    #[inline(always)]
    fn pause(&mut self) {}

    /// The number of the worker that caused the last refusal, from 0; `None`: there was none.
    fn met(&self) -> Option<usize>;

    /// Told of each tet to which an operation comes: on a walk; tested against the point of a
    /// cavity, once for each facet through which that happens; in the star of a vertex to be
    /// removed or across its link; written. Nothing happens, and nothing is compiled, unless a
    /// policy counts.
    #[inline(always)]
    fn visit_tet(&mut self, _: TetId) {}

    /// Told of each vertex whose record an operation comes to, once in each of its parts: on a
    /// walk, taken into a cavity, on the boundary when the star is filled, in the link of a vertex
    /// to be removed.
    #[inline(always)]
    fn visit_vertex(&mut self, _: VertexId) {}

    /// What was counted; `None`: the policy does not count.
    fn visits(&self) -> Option<&Visits> {
        None
    }
}

/// The name of one who works alone.
const LONE: OwnerId = 1;

/// Nobody else is there: one thread refines, and that a tet is owned means that it is in the
/// cavity.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Access for Solo {
    const SHARED: bool = false;
    const HEARS: bool = cfg!(feature = "simulation");

    #[inline(always)]
    fn try_own(&mut self, owner: &Owner) -> Holder {
        debug_assert!(owner.is(NOBODY));
        owner.set(LONE);
        Holder::Nobody
    }

    #[inline(always)]
    fn look_across(&mut self, owner: &Owner) -> Holder {
        if owner.is(NOBODY) { Holder::Nobody } else { Holder::Own }
    }

    #[inline(always)]
    fn owner_of_new(&self) -> OwnerId {
        NOBODY
    }

    #[cfg(feature = "simulation")]
    fn spend(&mut self, effort: Effort) {
        hooks::spend(effort);
    }

    #[cfg(feature = "simulation")]
    fn look(&mut self, triangulation: &Triangulation, t: TetId) {
        hooks::look(0, triangulation, t);
    }

    #[cfg(feature = "simulation")]
    fn visit_tet(&mut self, t: TetId) {
        hooks::visit_tet(0, t);
    }

    #[cfg(feature = "simulation")]
    fn visit_vertex(&mut self, v: VertexId) {
        hooks::visit_vertex(0, v);
    }

    fn met(&self) -> Option<usize> {
        None
    }
}

/// One of many workers on one triangulation.
#[derive(Debug)]
pub struct TryLock {
    me: OwnerId,
    met: OwnerId,
    #[cfg(feature = "force-conflicts")]
    forced: ForcedConflicts,
}

impl TryLock {
    /// Worker `number`, from 0; no two of a triangulation have the same.
    pub fn new(number: usize) -> Self {
        assert!(number < MAX_OWNERS, "no more workers than can be named");
        let me = (number + 1) as OwnerId;
        Self {
            me,
            met: me,
            #[cfg(feature = "force-conflicts")]
            forced: ForcedConflicts::new(me),
        }
    }

    /// Remembers whom it met.
    #[inline(always)]
    fn meet(&mut self, holder: Holder) -> Holder {
        if let Holder::Other(other) = holder {
            self.met = other;
        }
        holder
    }

    #[cfg(feature = "simulation")]
    fn number(&self) -> usize {
        usize::from(self.me) - 1
    }
}

impl Access for TryLock {
    const SHARED: bool = true;
    const HEARS: bool = cfg!(feature = "simulation");

    #[inline(always)]
    fn try_own(&mut self, owner: &Owner) -> Holder {
        #[cfg(feature = "force-conflicts")]
        if let Some(holder) = self.forced.refuses() {
            return self.meet(holder);
        }
        #[cfg(feature = "simulation")]
        {
            hooks::spend(Effort::Claim);
            hooks::pause();
        }
        let holder = owner.claim(self.me);
        self.meet(holder)
    }

    #[inline(always)]
    fn look_across(&mut self, owner: &Owner) -> Holder {
        #[cfg(feature = "force-conflicts")]
        if let Some(holder) = self.forced.refuses() {
            return self.meet(holder);
        }
        let holder = owner.look(self.me);
        self.meet(holder)
    }

    #[inline(always)]
    fn owner_of_new(&self) -> OwnerId {
        self.me
    }

    #[inline(always)]
    fn end_operation(&mut self) {
        #[cfg(feature = "simulation")]
        hooks::pause();
        #[cfg(feature = "force-conflicts")]
        self.forced.next_operation();
    }

    #[cfg(feature = "simulation")]
    fn spend(&mut self, effort: Effort) {
        hooks::spend(effort);
    }

    #[cfg(feature = "simulation")]
    fn look(&mut self, triangulation: &Triangulation, t: TetId) {
        hooks::look(self.number(), triangulation, t);
    }

    #[cfg(feature = "simulation")]
    fn pause(&mut self) {
        hooks::pause();
    }

    #[cfg(feature = "simulation")]
    fn visit_tet(&mut self, t: TetId) {
        hooks::visit_tet(self.number(), t);
    }

    #[cfg(feature = "simulation")]
    fn visit_vertex(&mut self, v: VertexId) {
        hooks::visit_vertex(self.number(), v);
    }

    fn met(&self) -> Option<usize> {
        (self.met != self.me).then(|| usize::from(self.met) - 1)
    }
}
