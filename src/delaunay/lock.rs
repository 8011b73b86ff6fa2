//! The word of one lock. The protocol, and the memory orders, are told in `ownership`.

use crate::sync::{AtomicU16, Ordering::*};

/// A worker as the owner of vertices: its number, from 1.
pub type OwnerId = u16;

const NOBODY: OwnerId = 0;

/// What came of asking for a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Claim {
    /// It is the worker's now, and was nobody's before.
    Taken,
    /// It was the worker's before.
    Held,
    /// Another worker owns it.
    Refused(OwnerId),
}

/// Who owns a vertex. All bytes zero: nobody.
#[derive(Debug, Default)]
pub struct Owner(AtomicU16);

impl Owner {
    /// Asks for the vertex in the name of worker `me`, without waiting.
    #[inline]
    pub fn claim(&self, me: OwnerId) -> Claim {
        // Relaxed: only `me` itself can have written `me`, and a refusal needs no more than a name.
        match self.0.load(Relaxed) {
            NOBODY => match self.0.compare_exchange(NOBODY, me, Acquire, Relaxed) {
                Ok(_) => Claim::Taken,
                Err(other) => Claim::Refused(other),
            },
            owner if owner == me => Claim::Held,
            other => Claim::Refused(other),
        }
    }

    /// Whether somebody owns it; out of date at once while others are at work.
    pub fn is_owned(&self) -> bool {
        self.0.load(Relaxed) != NOBODY
    }

    /// Gives the vertex back; only its owner does.
    #[inline]
    pub fn release(&self) {
        self.0.store(NOBODY, Release);
    }
}
