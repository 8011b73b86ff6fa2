//! What each thread of a refinement did, and with what it lost time.
//!
//! The overheads are those of the paper's section 5.2: operations that were rolled back, waiting
//! after conflicts, and waiting for work. Remote accesses are counted, where that is asked for, not
//! timed.

use super::rules::Lookups;
use crate::delaunay::worker::Counters;
use crate::sync::Ticks;
use crate::sync::clock::{Clock, ticks};

/// What a worker of a refinement did beside the operations of the kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Vertices that each of R1 to R5 inserted, and those that R6 removed.
    pub by_rule: [u64; 6],
    /// Tets that were inspected.
    pub inspections: u64,
    /// What was asked of the oracle meanwhile.
    pub lookups: Lookups,
}

impl Work {
    /// Adds what another worker did.
    pub fn add(&mut self, other: &Self) {
        for (sum, count) in self.by_rule.iter_mut().zip(other.by_rule) {
            *sum += count;
        }
        self.inspections += other.inspections;
        self.lookups.labels += other.lookups.labels;
        self.lookups.crossings += other.lookups.crossings;
        self.lookups.put_off += other.lookups.put_off;
    }
}

/// What a thread does in a span of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// It inserts samples of the isosurface.
    Sampling,
    /// It inspects tets and serves those that are poor.
    Refining,
    /// It made a part of an operation that it gave up.
    RollingBack,
    /// It waits after a conflict, as the contention manager said.
    Waiting,
    /// It has no work and waits for some, or for the others to end.
    Begging,
}

/// A span of time, in seconds since the refinement began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// What the thread did.
    pub doing: Doing,
    /// When it began.
    pub start: f64,
    /// When it ended.
    pub end: f64,
}

/// Time lost, and how often for what.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overhead {
    /// Operations given up because another thread owned a tet: insertions for each of R1 to R5,
    /// removals for R6.
    pub rollbacks: [u64; 6],
    /// Operations given up because the tet or its neighbour had changed when it was owned at last,
    /// or one changed that was come to.
    pub stale: u64,
    /// Seconds spent in operations that were given up.
    pub rollback_seconds: f64,
    /// Seconds spent waiting after conflicts.
    pub contention_seconds: f64,
    /// Seconds spent without work.
    pub idle_seconds: f64,
    /// How often the thread waited after a conflict.
    pub waits: u64,
    /// How often it asked for work.
    pub begs: u64,
    /// How often it gave work to another thread.
    pub gifts: u64,
}

/// Tets and vertices that operations visited (`delaunay::Probe::visit_tet`), by the hops from the
/// thread's memory node to that where they are; nothing where they were not counted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Accesses {
    /// The first: visits within the thread's own node.
    pub by_hops: Vec<u64>,
}

impl Accesses {
    /// Adds visits over so many hops.
    pub fn count(&mut self, hops: u32, visits: u64) {
        let hops = hops as usize;
        if visits > 0 && self.by_hops.len() <= hops {
            self.by_hops.resize(hops + 1, 0);
        }
        if let Some(sum) = self.by_hops.get_mut(hops) {
            *sum += visits;
        }
    }

    /// Adds those of another thread.
    pub fn add(&mut self, other: &Self) {
        (0..).zip(&other.by_hops).for_each(|(hops, &visits)| self.count(hops, visits));
    }

    /// Visits within the own node.
    pub fn local(&self) -> u64 {
        self.by_hops.first().copied().unwrap_or(0)
    }

    /// Visits of other nodes' memory.
    pub fn remote(&self) -> u64 {
        self.by_hops.iter().skip(1).sum()
    }

    /// The sum of the hops of all visits.
    pub fn hops(&self) -> u64 {
        (0..).zip(&self.by_hops).map(|(hops, &visits): (u64, _)| hops * visits).sum()
    }

    /// The part of all visits that was remote; 0 without visits.
    pub fn remote_share(&self) -> f64 {
        self.remote() as f64 / (self.local() + self.remote()).max(1) as f64
    }
}

/// What one thread did.
#[derive(Clone, Debug, Default)]
pub struct ThreadReport {
    /// Operations of the kernel.
    pub operations: Counters,
    /// The rules' part.
    pub work: Work,
    /// Time lost.
    pub overhead: Overhead,
    /// Where what its operations visited was.
    pub accesses: Accesses,
    /// What it did when, if that was asked for: one thing after the other.
    pub timeline: Vec<Span>,
}

impl ThreadReport {
    /// Adds what the thread did later.
    pub fn add(&mut self, later: Self) {
        self.operations.add(&later.operations);
        self.work.add(&later.work);
        self.overhead.add(&later.overhead);
        self.accesses.add(&later.accesses);
        self.timeline.extend(later.timeline);
    }
}

impl Overhead {
    /// Adds what another thread lost.
    pub fn add(&mut self, other: &Self) {
        for (sum, count) in self.rollbacks.iter_mut().zip(other.rollbacks) {
            *sum += count;
        }
        self.stale += other.stale;
        self.rollback_seconds += other.rollback_seconds;
        self.contention_seconds += other.contention_seconds;
        self.idle_seconds += other.idle_seconds;
        self.waits += other.waits;
        self.begs += other.begs;
        self.gifts += other.gifts;
    }
}

/// Time lost, while it is being counted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lost {
    /// All but the times.
    pub overhead: Overhead,
    pub rolling_back: Ticks,
    pub waiting: Ticks,
    pub idle: Ticks,
}

impl Lost {
    /// With the times in seconds.
    pub fn overhead(&self, seconds_per_tick: f64) -> Overhead {
        let seconds = |ticks: Ticks| ticks as f64 * seconds_per_tick;
        Overhead {
            rollback_seconds: seconds(self.rolling_back),
            contention_seconds: seconds(self.waiting),
            idle_seconds: seconds(self.idle),
            ..self.overhead
        }
    }
}

/// Most spans that a thread keeps; later ones are dropped.
const MAX_SPANS: usize = 1 << 18;

/// What a thread does when, while it does it: one thing after the other.
#[derive(Debug)]
pub(super) struct Timeline {
    keeps: bool,
    spans: Vec<(Doing, Ticks, Ticks)>,
    /// What it does when nothing else is noted, and since when that is so.
    now: Doing,
    since: Ticks,
}

impl Timeline {
    pub fn new(keeps: bool) -> Self {
        Self { keeps, spans: Vec::new(), now: Doing::Sampling, since: ticks() }
    }

    /// From `start` on the thread does something else by default.
    pub fn turn_to(&mut self, doing: Doing, start: Ticks) {
        self.push(self.now, self.since, start);
        (self.now, self.since) = (doing, start);
    }

    /// Between the two the thread did something else.
    pub fn interrupt(&mut self, doing: Doing, start: Ticks, end: Ticks) {
        self.push(self.now, self.since, start);
        self.push(doing, start, end);
        self.since = end;
    }

    fn push(&mut self, doing: Doing, start: Ticks, end: Ticks) {
        if self.keeps
            && end > start
            && self.spans.len() < MAX_SPANS
            && self.spans.try_reserve(1).is_ok()
        {
            self.spans.push((doing, start, end));
        }
    }

    /// The spans; the thread ends here.
    pub fn spans(mut self, clock: &Clock, seconds_per_tick: f64) -> Vec<Span> {
        self.push(self.now, self.since, ticks());
        let seconds = |ticks: Ticks| ticks.saturating_sub(clock.first()) as f64 * seconds_per_tick;
        let span = |&(doing, start, end): &(Doing, Ticks, Ticks)| Span {
            doing,
            start: seconds(start),
            end: seconds(end),
        };
        self.spans.iter().map(span).collect()
    }
}
