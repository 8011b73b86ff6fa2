//! A worker's poor element list (PEL): the tets that it has still to look at, and those that it found poor.
//!
//! **Looks** come in rounds. A round holds the tets that one made of the tets of the round before it, in the order of their making; when none is left, the next round
//! begins with some of the tets that wait. So a tet that the demand of another of its round destroys is never looked at, while all
//! tets of a round still lie close together. **Poor** tets are served, some at a time, only when none is left to look at: a tet that lives only for a moment is never refined for
//! its own shape, and all interfaces are sampled before the first circumcenter is inserted, which leaves R6 next to nothing to do.
//!
//! An entry is never taken out when its tet dies: the stamp tells.

use crate::delaunay::TetStamp;
use crate::{Error, Result};

/// Waiting tets that begin a round.
const ROUND: usize = 512;
/// Poor tets that are served before the tets that this makes are looked at.
const SERVED: usize = 64;

/// What a worker does next.
#[derive(Clone, Copy, Debug)]
pub enum Task {
    /// Looks at a tet.
    Look(TetStamp),
    /// Serves a poor tet.
    Serve(TetStamp),
}

/// The list.
#[derive(Default)]
pub struct Pel {
    /// To be looked at in a later round: last in, first out.
    waiting: Vec<TetStamp>,
    /// To be looked at in this round, the first at the end.
    round: Vec<TetStamp>,
    /// To be looked at in the next round, the first at the front.
    made: Vec<TetStamp>,
    /// Found poor: last in, first out.
    poor: Vec<TetStamp>,
    /// Poor tets to be served before the next round.
    served: Vec<TetStamp>,
}

impl Pel {
    /// Adds a tet to be looked at after all that was made of others.
    pub fn push_waiting(&mut self, stamp: TetStamp) {
        self.waiting.push(stamp);
    }

    /// Adds a tet that an operation made, or that is to be looked at again.
    #[inline]
    pub fn push_made(&mut self, stamp: TetStamp) {
        self.made.push(stamp);
    }

    /// Adds a poor tet.
    #[inline]
    pub fn push_poor(&mut self, stamp: TetStamp) {
        self.poor.push(stamp);
    }

    /// The next task; `None`: nothing is left.
    #[inline]
    pub fn pop(&mut self) -> Option<Task> {
        if let Some(stamp) = self.served.pop() {
            return Some(Task::Serve(stamp));
        }
        if let Some(stamp) = self.round.pop() {
            return Some(Task::Look(stamp));
        }
        self.turn()
    }

    /// Begins the next round.
    fn turn(&mut self) -> Option<Task> {
        std::mem::swap(&mut self.round, &mut self.made);
        self.round.reverse();
        if self.round.is_empty() {
            let from = self.waiting.len().saturating_sub(ROUND);
            self.round.extend(self.waiting.drain(from..));
        }
        if let Some(stamp) = self.round.pop() {
            return Some(Task::Look(stamp));
        }
        let from = self.poor.len().saturating_sub(SERVED);
        self.served.extend(self.poor.drain(from..));
        self.served.pop().map(Task::Serve)
    }

    /// Makes room for `count` more entries wherever they go, so that pushing so many need not ask for memory.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn make_room(&mut self, count: usize) -> Result<()> {
        let lack = |_| Error::OutOfMemory { count, what: "entries of a poor element list" };
        self.waiting.try_reserve(count).map_err(lack)?;
        self.made.try_reserve(count).map_err(lack)?;
        self.poor.try_reserve(count).map_err(lack)?;
        self.round.try_reserve(ROUND).map_err(lack)?;
        self.served.try_reserve(SERVED).map_err(lack)
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let lists = [&self.waiting, &self.round, &self.made, &self.poor, &self.served];
        lists.map(|list| (list.capacity() * size_of::<TetStamp>()) as u64).iter().sum()
    }
}
