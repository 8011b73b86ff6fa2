//! Who may touch a tet: the locking policy of a worker, a type parameter of the kernel.
//!
//! An operation asks to own every tet that it will destroy, and reads whose the tets around are,
//! before it writes anything (invariant 4). A refusal ends the operation with *blocked* and nothing
//! changed. Nobody waits while owning. The protocol is told in `ownership`.

#[cfg(feature = "force-conflicts")]
use super::forced_conflicts::ForcedConflicts;
use super::ownership::{Claim, Holder, MAX_OWNERS, NOBODY, Owner, OwnerId};

/// A locking policy.
pub trait Locks {
    /// Whether others may operate at the same time: what was read without owning is to be checked.
    const SHARED: bool;

    /// Asks for the tet with this `owner`.
    fn try_own(&mut self, owner: &Owner) -> Claim;

    /// Reads whose the tet with this `owner` is, across a facet of one that is owned.
    fn inspect_across(&mut self, owner: &Owner) -> Holder;

    /// Whose a tet is that the worker writes.
    fn owner_of_new(&self) -> OwnerId;

    /// Told that the worker is about to give back all that it owns.
    #[inline(always)]
    fn end_operation(&mut self) {}

    /// The number of the worker that caused the last refusal, from 0; `None`: there was none.
    fn met(&self) -> Option<usize>;
}

/// The name of one who works alone.
const LONE: OwnerId = 1;

/// Nobody else is there: one thread refines, and that a tet is owned means that it is in the
/// cavity.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Locks for Solo {
    const SHARED: bool = false;

    #[inline(always)]
    fn try_own(&mut self, owner: &Owner) -> Claim {
        debug_assert!(owner.is(NOBODY));
        owner.set(LONE);
        Claim::Acquired
    }

    #[inline(always)]
    fn inspect_across(&mut self, owner: &Owner) -> Holder {
        if owner.is(NOBODY) { Holder::Unowned } else { Holder::Own }
    }

    #[inline(always)]
    fn owner_of_new(&self) -> OwnerId {
        NOBODY
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
    forced: Option<ForcedConflicts>,
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
            forced: ForcedConflicts::if_asked_for(me),
        }
    }

    /// Remembers whom it met.
    #[inline(always)]
    fn meet(&mut self, claim: Claim) {
        if let Claim::Conflict(other) = claim {
            self.met = other;
        }
    }
}

impl Locks for TryLock {
    const SHARED: bool = true;

    #[inline(always)]
    fn try_own(&mut self, owner: &Owner) -> Claim {
        #[cfg(feature = "force-conflicts")]
        if let Some(holder) = self.forced.as_mut().and_then(ForcedConflicts::refuses) {
            self.meet(holder.into());
            return holder.into();
        }
        let claim = owner.claim(self.me);
        self.meet(claim);
        claim
    }

    #[inline(always)]
    fn inspect_across(&mut self, owner: &Owner) -> Holder {
        #[cfg(feature = "force-conflicts")]
        if let Some(holder) = self.forced.as_mut().and_then(ForcedConflicts::refuses) {
            self.meet(holder.into());
            return holder;
        }
        let holder = owner.inspect(self.me);
        self.meet(holder.into());
        holder
    }

    #[inline(always)]
    fn owner_of_new(&self) -> OwnerId {
        self.me
    }

    #[inline(always)]
    fn end_operation(&mut self) {
        #[cfg(feature = "force-conflicts")]
        if let Some(forced) = &mut self.forced {
            forced.next_operation();
        }
    }

    fn met(&self) -> Option<usize> {
        (self.met != self.me).then(|| usize::from(self.met) - 1)
    }
}
