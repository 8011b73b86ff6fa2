//! Who owns which tets: the locks of speculative refinement.
//!
//! # The protocol
//! **What is locked.** Tets, each by a byte of its own record, whose line an operation needs and
//! writes anyway. An operation owns every tet that it destroys (the cavity of a point, the star of
//! a vertex) from before it inspects across that tet's facets, and what it makes from before
//! anything leads there, until it has ended, completed or not. Nothing else is locked: an operation
//! writes to the tets that it owns, to the links that lead to them from the tets around, and of the
//! vertices around which tet is of their star, and a number that means nothing afterwards
//! (`insert`).
//!
//! **Looking across a facet** of an owned tet t: the link, whose the tet behind it is, the link
//! once more. Is the tet the worker's own, it is one of those that it came to before. Is it another
//! worker's, the operation is given up; has the link changed, too. Otherwise the tet u behind it is
//! nobody's, and neither it nor its link to t changes as long as t is owned. For whoever changes u
//! owns it and inspects across its facet to t, from u or from t. Of the two inspections the later
//! one finds the other's tet owned, and its operation gives up. That is why a worker takes *before*
//! it inspects. Only after the link was read again may the sphere of u be read: before, u's slot
//! may have been freed, and used again anywhere.
//!
//! **Which operations exclude each other.** Two that destroy the same tet: one of them is refused
//! it. Two whose cavities share a facet: at least one inspects across it when the other's tet is
//! owned, or comes when the other has completed. Two that share an edge or a vertex alone do each
//! other no harm, and run side by side.
//!
//! **The way in.** A worker comes to its first tet by a note that may be out of date. It owns it,
//! and inspects across its four facets: then the tet and its neighbours stay what they are, and it
//! asks whether they are what the note said. A vertex to be removed leads to a tet of its star; if
//! the tet, when owned, is without the vertex, others have rewritten the star meanwhile, and the
//! vertex leads elsewhere or has been removed.
//!
//! **Free slots**, once used, say so until one takes them who has them in its list. To ask for one
//! is to hear that something has changed, not that another worker is in the way. A slot is freed,
//! and may go to another worker's list, after the last link from a living tet to it was rewritten.
//! It becomes its taker's before the first link to it is written. A slot that was never used says
//! that it is nobody's; nothing leads there.
//!
//! **A vertex's star.** The tets that an operation makes have all vertices of those that it
//! destroyed, but one that it removes, and each of these is told a new tet as its star. Whoever
//! destroys the tet that the last of these writes names has owned it after that, and writes again.
//! So the last one names a tet that lives.
//!
//! **No deadlock.** A refusal ends the operation: its worker gives back all that it owns before it
//! does anything else. Nobody waits while owning.
//!
//! **No livelock.** What a worker does after a refusal is the contention manager's business
//! (`parallel/contention.rs`, which argues for each). What has changed was changed by an operation
//! that completes.
//!
//! **What is not locked.** Looking. Rules read tets and neighbours that they do not own, and may
//! read a record while another worker rewrites it. All words are atomics, so this is no undefined
//! behaviour, but what was read is a hint. It is checked on the way in: the tet that asks and,
//! where it matters, the one across the facet have the vertices, circumsphere and label that were
//! read.
//!
//! # Memory order
//! *Taking and inspecting* are sequentially consistent. Let a own t and inspect u, b own u and
//! inspect t. Of the four accesses one order is agreed upon, in which each takes before it
//! inspects; so the later inspection comes after both takings, and sees the other's name or what
//! was written after it.
//!
//! *Giving back* is `Release`, inspecting is an `Acquire` too, as is a refusal: who finds a tet
//! nobody's that was owned meanwhile, or finds its slot freed, sees all that was written under that
//! ownership, first of all the links; therefore the link is read again after the inspection.
//!
//! One case is left, by the language's model alone and on no processor that we know: the first link
//! is older than the taking, the same bits are there again in the second, and the tet behind them
//! is owned still, by the worker that wrote them. It is harmless because a tet's own links are
//! written before the link that leads back to it: who read that link writes its own over what it
//! leads to, not the other way round.
//!
//! So all other words can be relaxed. The ids in a tet's record, of its neighbours and its
//! vertices, and a vertex's star are written with `Release` and read with `Acquire`: who reads an
//! id finds the memory that it names, the name of the owner in a slot that was just taken, and for
//! those who inspect without owning a record that was filled once or is all zeros. One who sees
//! zeros sees four vertices of id 0, which is what a walk is blocked by or finds stale, and a
//! demand is not true of. On x86 all of these are plain loads and stores but the exchange itself.

use crate::sync::Ordering::*;

/// A worker as the owner of tets: its number, from 1. More than a byte has no room in the line of a
/// tet.
#[cfg(not(feature = "simulation"))]
pub type OwnerId = u8;
#[cfg(not(feature = "simulation"))]
type AtomicOwnerId = crate::sync::AtomicU8;

/// A worker as the owner of tets: its number, from 1. In a build with simulations, of more workers
/// than a byte can name, a tet has two lines.
#[cfg(feature = "simulation")]
pub type OwnerId = u16;
#[cfg(feature = "simulation")]
type AtomicOwnerId = crate::sync::AtomicU16;

/// No worker.
pub const NOBODY: OwnerId = 0;
/// Of a free slot.
pub const FREE: OwnerId = OwnerId::MAX;

/// Most workers that can be named.
pub const MAX_OWNERS: usize = FREE as usize - 1;

/// What came of asking for a tet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Claim {
    /// It is the worker's now.
    Acquired,
    /// It was the worker's own before.
    Owned,
    /// It is another worker's.
    Conflict(OwnerId),
    /// It is no tet that the worker could want: the slot is free, or another tet's than the link
    /// said.
    Stale,
}

impl From<Holder> for Claim {
    /// What asking would have come to.
    #[inline(always)]
    fn from(holder: Holder) -> Self {
        match holder {
            Holder::Unowned => Self::Acquired,
            Holder::Own => Self::Owned,
            Holder::Other(other) => Self::Conflict(other),
            Holder::Changed => Self::Stale,
        }
    }
}

/// Whose a tet is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// Nobody's.
    Unowned,
    /// The worker's own.
    Own,
    /// Another worker's.
    Other(OwnerId),
    /// No tet's that the worker could want: the slot is free, or another tet's than the link said.
    Changed,
}

/// Whose the tet in a slot is. All bytes zero: nobody's.
#[derive(Debug, Default)]
pub struct Owner(AtomicOwnerId);

impl Owner {
    /// Asks for the tet in the name of worker `me`, without waiting.
    #[inline(always)]
    pub fn claim(&self, me: OwnerId) -> Claim {
        // SeqCst: before it inspects across its facets. Acquire where it fails: the slot's freeing
        // comes after what made its links lead elsewhere.
        match self.0.compare_exchange(NOBODY, me, SeqCst, Acquire) {
            Ok(_) => Claim::Acquired,
            Err(holder) => Self::name(holder, me).into(),
        }
    }

    /// Whose it is; of a tet across a facet of one that is owned.
    #[inline(always)]
    pub fn inspect(&self, me: OwnerId) -> Holder {
        // SeqCst: after the taking of the tet that is owned.
        Self::name(self.0.load(SeqCst), me)
    }

    #[inline(always)]
    fn name(holder: OwnerId, me: OwnerId) -> Holder {
        match holder {
            NOBODY => Holder::Unowned,
            _ if holder == me => Holder::Own,
            FREE => Holder::Changed,
            _ => Holder::Other(holder),
        }
    }

    /// Says whose the tet is: of a slot that was free, before anything leads to it, or by its
    /// owner.
    #[inline(always)]
    pub fn set(&self, owner: OwnerId) {
        // Relaxed: whoever comes here by a link written later sees this or what came after it.
        self.0.store(owner, Relaxed);
    }

    /// Gives the tet back; only its owner does.
    #[inline(always)]
    pub fn release(&self) {
        // Release: who takes the tet, or inspects it, sees what was written under this ownership.
        self.0.store(NOBODY, Release);
    }

    /// Frees the slot, when nothing leads to it any more; only its owner does.
    #[inline(always)]
    pub fn free_slot(&self) {
        // Release: as above.
        self.0.store(FREE, Release);
    }

    /// Whether the tet is that of `owner`; out of date at once while others are at work.
    #[inline(always)]
    pub fn is(&self, owner: OwnerId) -> bool {
        self.0.load(Relaxed) == owner
    }
}
