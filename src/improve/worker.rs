//! What works in one block: a queue of the tets that are to be improved, the worst first.
//!
//! Each tet below the target is reconnected if that helps (`removal`). What can't be helped so
//! waits until nothing is left to reconnect; then its vertices are moved (`smoothing`), or an edge
//! is split (`split`), at last several vertices are moved at the same time (`joint`). After each
//! change the tets that changed are inspected again if they are below the target. Every change
//! raises the least measure of the tets that it changes by [`GAIN`] at least, so the work ends.
//! What follows in the end (`volumes`) ends after a fixed number of rounds.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

use glam::DVec3;

use super::blocks::owner;
use super::climb::Climb;
use super::flips::Flips;
use super::interfaces::Interfaces;
use super::measure::Measure;
use super::report::Counts;
use super::shared::Shared;
use super::star::Star;
use crate::mesh::NONE;
use crate::{Error, Result};

/// An operation must raise the least measure by this much.
pub(super) const GAIN: f64 = 1e-4;
/// Steps between two checks.
const REPORT_EVERY: usize = 32;

/// So many tets go into the queue between two steps of fetching what is around one.
const AHEAD: usize = 8;

/// What all blocks of a round share.
pub(super) struct Round<'a> {
    pub shared: Shared<'a>,
    /// The block of each vertex.
    pub blocks: &'a [u32],
    /// Where moves of each vertex are counted from: see [`Earlier::refined`](super::Earlier).
    pub refined: &'a [[f64; 3]],
    /// What was flipped in earlier rounds.
    pub flips: &'a Flips,
    pub interfaces: &'a Interfaces<'a>,
    /// How tets are measured, and what is to be reached.
    pub measure: Measure,
    /// What may be done besides.
    pub last: LastResorts,
    /// Told how many tets were dealt with; an error ends the work.
    pub report_and_check: &'a (dyn Fn(usize) -> Result<()> + Sync),
}

/// What is done only for tets that nothing else has helped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastResorts {
    /// Vertices may go farther along interfaces and lines.
    pub go_farther: bool,
    /// Several vertices are moved at the same time, and the surroundings of a tet are relaxed.
    pub relax: bool,
}

/// What became of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The mesh was changed.
    Done,
    /// Nothing helps.
    Failed,
    /// Something might help, but needs a tet that the block does not own, or more room.
    Foreign,
}

/// What comes of the work in a block.
pub(super) struct Done {
    pub counts: Counts,
    /// What was flipped.
    pub flips: Flips,
    /// Tets to be tried again in a round of other blocks.
    pub deferred: Vec<u32>,
    /// Tets that nothing helped.
    pub left: Vec<u32>,
    /// What ended it early.
    pub error: Option<Error>,
}

/// A tet in a queue: worst first, ties by slot. Vertices and measure tell whether it is still what
/// it was. Where it is not, what changed it has put it into the queue again, if it is still below
/// the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    measure: Reverse<u64>,
    tet: Reverse<u32>,
    vertices: [u32; 4],
}

/// What a worker leaves to the next one of its thread, for its memory.
#[derive(Default)]
pub(super) struct Scratch {
    queue: BinaryHeap<Entry>,
    late: BinaryHeap<Entry>,
    free: Vec<u32>,
    star: Star,
    climb: Climb,
}

/// The worker of a block.
pub(super) struct Worker<'r, 'a> {
    pub round: &'r Round<'a>,
    pub me: u32,
    /// To be reconnected.
    queue: BinaryHeap<Entry>,
    /// To be moved or split.
    late: BinaryHeap<Entry>,
    /// Slots of tets that are free.
    free: Vec<u32>,
    /// Slots at the end that nobody has used yet.
    fresh: Range<u32>,
    /// Numbers of vertices that nobody has used yet.
    fresh_vertices: Range<u32>,
    /// Tets to be tried again in a round of other blocks.
    deferred: Vec<u32>,
    /// Tets that nothing helped.
    left: Vec<u32>,
    /// What was flipped in this round.
    pub flips: Flips,
    /// So many more tets that nothing helps are tried.
    patience: usize,
    pub counts: Counts,
    /// The measure at which a vertex need not be moved any farther: the target, or more while the
    /// surroundings of a tet that nothing helped are relaxed.
    pub aim: f64,
    /// The star at hand.
    pub star: Star,
    /// The climb of its vertex.
    pub climb: Climb,
}

/// Where more than this part of the tets below the target is left once they have been tried, the
/// mesh cannot have the target: it is as coarse as what it stands for is thin. The work ends there.
/// On meshes that can have it a fiftieth is left at most.
pub(super) const HOPELESS_PART: usize = 4;

/// A block gives up once nothing has helped so many of its tets, or one in [`HOPELESS_PART`] of
/// those that it began with, whichever is more. An attempt takes up to milliseconds. Where changes
/// make new tets below the target, there may be many times more attempts than tets.
const PATIENCE: usize = 256;

impl<'r, 'a> Worker<'r, 'a> {
    /// The worker of block `me`, which may fill the slots `fresh` and use the numbers
    /// `fresh_vertices`.
    pub fn new(
        round: &'r Round<'a>,
        me: u32,
        fresh: Range<u32>,
        fresh_vertices: Range<u32>,
        scratch: Scratch,
    ) -> Self {
        let Scratch { queue, late, free, star, climb } = scratch;
        let (deferred, left, counts) = (Vec::new(), Vec::new(), Counts::default());
        Self {
            round,
            me,
            queue,
            late,
            free,
            fresh,
            fresh_vertices,
            deferred,
            left,
            flips: Flips::default(),
            patience: 0,
            counts,
            aim: round.measure.target,
            star,
            climb,
        }
    }

    /// Ends the work: what comes of it, and what the next worker may use.
    pub fn end(self, error: Option<Error>) -> (Done, Scratch) {
        let Self { mut queue, mut late, mut free, star, climb, .. } = self;
        queue.clear();
        late.clear();
        free.clear();
        let Self { counts, flips, deferred, left, .. } = self;
        let done = Done { counts, flips, deferred, left, error };
        (done, Scratch { queue, late, free, star, climb })
    }

    /// Improves `tets`, which the block owns. What changes is in order when this ends early, too.
    ///
    /// # Errors
    /// Those of the round's `report_and_check`.
    pub fn run(&mut self, tets: &[u32]) -> Result<()> {
        for (i, &t) in tets.iter().enumerate() {
            // Most of what is around them is looked at, and all of a block stays in the processor's
            // cache.
            let ahead = [3, 2, 1].map(|n| tets.get(i + n * AHEAD).copied());
            self.round.shared.prefetch_steps(ahead);
            self.enqueue(t);
        }
        self.patience = PATIENCE.max(tets.len() / HOPELESS_PART);
        let mut steps = 0;
        loop {
            steps += 1;
            if steps == REPORT_EVERY {
                (self.round.report_and_check)(steps)?;
                steps = 0;
            }
            if let Some(entry) = pop(&mut self.queue) {
                self.reconnect_or_defer(entry);
            } else if let Some(entry) = pop(&mut self.late) {
                self.move_or_give_up(entry);
                // Some of these take milliseconds.
                (self.round.report_and_check)(0)?;
            } else {
                return (self.round.report_and_check)(steps);
            }
        }
    }

    fn reconnect_or_defer(&mut self, entry: Entry) {
        let t = entry.tet.0;
        if !self.is_current(&entry) {
            return;
        }
        // What is done for the background depends on what labels lose.
        if self.round.shared.label(t) == 0 || self.reconnect(t) != Outcome::Done {
            self.late.push(entry);
        } else {
            self.enqueue_again(&entry);
        }
    }

    fn move_or_give_up(&mut self, entry: Entry) {
        let t = entry.tet.0;
        if !self.is_current(&entry) {
            return;
        }
        if self.round.shared.label(t) == 0 {
            self.reconnect(t);
            return;
        }
        if self.patience == 0 {
            self.left.push(t);
            return;
        }
        let mut outcome = Outcome::Failed;
        // Reconnecting may help by now.
        let attempts: &[fn(&mut Self, u32) -> Outcome] =
            &[Self::reconnect, Self::smooth, Self::split, Self::make_way];
        let last: &[fn(&mut Self, u32) -> Outcome] = match self.round.last.relax {
            true => &[Self::smooth_jointly, Self::relax, Self::smooth_around],
            false => &[],
        };
        for attempt in attempts.iter().chain(last) {
            match attempt(self, t) {
                Outcome::Done => return self.enqueue_again(&entry),
                Outcome::Foreign => outcome = Outcome::Foreign,
                Outcome::Failed => {}
            }
        }
        match outcome {
            Outcome::Foreign => self.deferred.push(t),
            _ => {
                self.patience -= 1;
                self.left.push(t);
            }
        }
    }

    /// Inspects a tet again that a change did not touch or not help enough.
    fn enqueue_again(&mut self, entry: &Entry) {
        if self.round.shared.tet(entry.tet.0) == entry.vertices {
            self.enqueue(entry.tet.0);
        }
    }

    /// Whether a tet is what it was when it came into the queue.
    fn is_current(&self, entry: &Entry) -> bool {
        let t = entry.tet.0;
        self.round.shared.tet(t) == entry.vertices
            && self.measure_of(t).to_bits() == entry.measure.0
    }

    /// Whether a tet is at the target or above.
    #[inline]
    pub fn is_good(&self, t: u32) -> bool {
        let Round { shared, measure, .. } = self.round;
        measure.exceeds(&shared.corners(shared.tet(t)), measure.target)
    }

    /// The measure of a tet.
    #[inline]
    pub fn measure_of(&self, t: u32) -> f64 {
        self.round.measure.of(&self.round.shared.corners(self.round.shared.tet(t)))
    }

    /// Puts a tet into the queue if it is below the target.
    pub fn enqueue(&mut self, t: u32) {
        let shared = &self.round.shared;
        let vertices = shared.tet(t);
        if vertices[0] == NONE {
            return;
        }
        let corners = shared.corners(vertices);
        if !self.round.measure.exceeds(&corners, self.round.measure.target) {
            let measure = self.round.measure.of(&corners);
            // Measures are not negative, so their bits are in their order.
            self.queue.push(Entry {
                measure: Reverse(measure.to_bits()),
                tet: Reverse(t),
                vertices,
            });
        }
    }

    /// What the least measure of the tets that an operation changes must exceed, if it was `old`.
    /// To reach the target is enough.
    #[inline]
    pub fn to_exceed(&self, old: f64) -> f64 {
        (old + GAIN).min(self.aim.next_down())
    }

    /// Whether the block owns a tet with these vertices.
    #[inline]
    pub fn owns(&self, vertices: [u32; 4]) -> bool {
        owner(vertices.map(|v| self.round.blocks[v as usize])) == Some(self.me)
    }

    /// Where a vertex is.
    #[inline]
    pub fn point(&self, v: u32) -> DVec3 {
        self.round.shared.point(v)
    }

    /// Where refinement put a vertex, or two met.
    #[inline]
    pub fn refined(&self, v: u32) -> DVec3 {
        DVec3::from_array(self.round.refined[v as usize])
    }

    /// How far an interface facet is from refinement's interface, at refinement's places of its
    /// vertices: 0 but where flips were.
    #[inline]
    pub fn distance_of_flip(&self, facet: [u32; 3]) -> f64 {
        let earlier = || self.round.flips.distance(facet);
        self.flips.distance(facet).or_else(earlier).unwrap_or(0.0)
    }

    /// How many more tets there is room for.
    pub fn room(&self) -> usize {
        self.free.len() + self.fresh.len()
    }

    /// An empty slot; there must be room.
    pub fn take_slot(&mut self) -> Option<u32> {
        self.free.pop().or_else(|| self.fresh.next())
    }

    /// A new vertex.
    pub fn take_vertex(&mut self, at: DVec3) -> Option<u32> {
        let v = self.fresh_vertices.next()?;
        self.round.shared.set_point(v, at);
        Some(v)
    }

    /// Empties a slot.
    pub fn give_slot(&mut self, t: u32) {
        self.round.shared.free(t);
        self.free.push(t);
    }
}

/// Takes the first entry out of a queue, as often as it is there.
fn pop(queue: &mut BinaryHeap<Entry>) -> Option<Entry> {
    let entry = queue.pop()?;
    while queue.peek() == Some(&entry) {
        queue.pop();
    }
    Some(entry)
}
