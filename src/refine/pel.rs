//! A worker's poor element list (PEL): the tets that it has still to inspect, and those that it
//! found poor.
//!
//! **Inspections** come in rounds. A round holds the tets that one made of the tets of the round
//! before it, in the order of their making; when none is left, the next round begins with some of
//! the tets that wait. So a tet that the demand of another of its round destroys is never looked
//! at, while all tets of a round still lie close together. Where each round makes more than it had,
//! rounds would become a front that spreads over all of the worker's region, and no cache holds it:
//! so the tets of a large round that were made last wait, and are the first to begin a round later.
//! **Poor** tets are served, some at a time, only when none is left to inspect: a tet that lives
//! only for a moment is never refined for its own shape, and all interfaces are sampled before the
//! first circumcenter is inserted, which leaves R6 next to nothing to do.
//!
//! An entry is never taken out when its tet dies: the stamp tells.

use super::rules::RefinementPoint;
use crate::delaunay::{TetStamp, VertexId};
use crate::memory::room;
use crate::{Error, Result};

/// Tets of a round at most, and so many waiting tets that begin one.
const ROUND: usize = 512;
/// Poor tets that are served before the tets that this makes are inspected.
const SERVED: usize = 64;

/// Least tets that wait of which some are given away.
const MANY_WAITING: usize = 64;
/// Least poor tets of which some are given away.
const MANY_POOR: usize = 16;

/// What lists hold, as errors name it.
const ENTRIES: &str = "entries of a poor element list";

/// What a worker does next.
#[derive(Clone, Copy, Debug)]
pub enum Task {
    /// Removes a free vertex near a new isovertex.
    Remove(VertexId),
    /// Looks at a tet.
    Inspect(TetStamp),
    /// Serves a poor tet.
    Serve(TetStamp),
}

/// Work for another worker: a part of a list, of the tets that came first, which lie farthest from
/// those at hand; or what is to be done in another region.
#[derive(Debug, Default)]
pub struct Gift {
    /// To be inspected.
    pub waiting: Vec<TetStamp>,
    /// Poor.
    pub poor: Vec<TetStamp>,
    /// Tets, what they demanded when they were inspected, and which of their facets had not been
    /// asked yet, as bits.
    pub points: Vec<(TetStamp, RefinementPoint, u32)>,
}

/// The list.
#[derive(Default)]
pub struct Pel {
    /// Vertices to be removed.
    removals: Vec<VertexId>,
    /// To be inspected in a later round: last in, first out.
    waiting: Vec<TetStamp>,
    /// To be inspected in this round, the first at the end.
    round: Vec<TetStamp>,
    /// To be inspected in the next round, the first at the front.
    made: Vec<TetStamp>,
    /// Found poor: last in, first out.
    poor: Vec<TetStamp>,
    /// Poor tets to be served before the next round.
    served: Vec<TetStamp>,
}

impl Pel {
    /// Adds a tet to be inspected after all that was made of others.
    pub fn push_waiting(&mut self, stamp: TetStamp) {
        self.waiting.push(stamp);
    }

    /// Adds a tet that an operation made, or that is to be inspected again.
    #[inline]
    pub fn push_made(&mut self, stamp: TetStamp) {
        self.made.push(stamp);
    }

    /// Adds vertices to be removed, before anything else is done.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn push_removals(&mut self, vertices: &[VertexId]) -> Result<()> {
        let count = vertices.len();
        self.removals
            .try_reserve(count)
            .map_err(|_| Error::OutOfMemory { count, what: "vertices to remove" })?;
        self.removals.extend_from_slice(vertices);
        Ok(())
    }

    /// Whether there is enough to give some away.
    #[inline]
    pub fn can_give(&self) -> bool {
        self.waiting.len() >= MANY_WAITING || self.poor.len() >= MANY_POOR
    }

    /// Takes half of the tets out that wait, or of the poor ones where few wait. The lists keep the
    /// room that was made in them.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn gift(&mut self) -> Result<Gift> {
        let half = |list: &mut Vec<TetStamp>| -> Result<Vec<TetStamp>> {
            let mut given = room(list.len() / 2, ENTRIES)?;
            given.extend(list.drain(..list.len() / 2));
            Ok(given)
        };
        Ok(if self.waiting.len() >= MANY_WAITING {
            Gift { waiting: half(&mut self.waiting)?, ..Gift::default() }
        } else {
            Gift { poor: half(&mut self.poor)?, ..Gift::default() }
        })
    }

    /// Takes the tets of a gift in.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn accept(&mut self, gift: &mut Gift) -> Result<()> {
        self.make_room(gift.waiting.len().max(gift.poor.len()))?;
        self.waiting.append(&mut gift.waiting);
        self.poor.append(&mut gift.poor);
        Ok(())
    }

    /// Adds a poor tet.
    #[inline]
    pub fn push_poor(&mut self, stamp: TetStamp) {
        self.poor.push(stamp);
    }

    /// The next task; `None`: nothing is left.
    #[inline]
    pub fn pop(&mut self) -> Option<Task> {
        if let Some(v) = self.removals.pop() {
            return Some(Task::Remove(v));
        }
        if let Some(stamp) = self.served.pop() {
            return Some(Task::Serve(stamp));
        }
        if let Some(stamp) = self.round.pop() {
            return Some(Task::Inspect(stamp));
        }
        self.turn()
    }

    /// Begins the next round.
    fn turn(&mut self) -> Option<Task> {
        std::mem::swap(&mut self.round, &mut self.made);
        self.waiting.extend(self.round.drain(ROUND.min(self.round.len())..));
        self.round.reverse();
        if self.round.is_empty() {
            let from = self.waiting.len().saturating_sub(ROUND);
            self.round.extend(self.waiting.drain(from..));
        }
        if let Some(stamp) = self.round.pop() {
            return Some(Task::Inspect(stamp));
        }
        let from = self.poor.len().saturating_sub(SERVED);
        self.served.extend(self.poor.drain(from..));
        self.served.pop().map(Task::Serve)
    }

    /// Makes room for `count` more entries wherever they go, so that pushing so many need not ask
    /// for memory.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn make_room(&mut self, count: usize) -> Result<()> {
        let lack = |_| Error::OutOfMemory { count, what: ENTRIES };
        // What is made may come to wait.
        self.waiting.try_reserve(count + self.made.len()).map_err(lack)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_rounds_are_cut_and_nothing_is_lost() {
        let mut pel = Pel::default();
        let count = 3 * ROUND as u32 + 7;
        pel.make_room(count as usize).unwrap();
        (0..count).for_each(|tet| pel.push_made(TetStamp { tet, last: 0 }));
        let inspections: Vec<u32> = std::iter::from_fn(|| pel.pop())
            .map(|task| match task {
                Task::Inspect(stamp) => stamp.tet,
                other => panic!("{other:?}"),
            })
            .collect();
        // In the order of their making, then those that were made last.
        assert!(inspections[..ROUND].iter().copied().eq(0..ROUND as u32));
        assert_eq!(inspections[ROUND], count - 1);
        let mut all = inspections;
        all.sort_unstable();
        assert!(all.into_iter().eq(0..count));
    }
}
