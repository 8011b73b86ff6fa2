//! What the workers of one refinement share: the rules, the limits, the way to stop, and who waits
//! for whom.

use std::ops::Range;

use crossbeam_utils::CachePadded;
use glam::DVec3;

use super::lapd::Regions;
use super::options::{ALL_TETS_PER_SAMPLE, Limits, RefineOptions};
use super::pel::Gift;
use super::rules::Rules;
use super::state::State;
use super::unmet::LeftOver;
use crate::delaunay::numa::NodeId;
use crate::delaunay::worker::Counters;
use crate::delaunay::{Locks, Probe, TetId, TetStamp, VertexId, Worker};
use crate::image::voxel_blocks::NearBlocks;
use crate::parallel::begging::Begging;
use crate::parallel::contention::Contention;
use crate::parallel::machine::Machine;
use crate::parallel::parking::Parking;
use crate::parallel::topology::Levels;
use crate::sync::{AtomicU64, AtomicUsize, Mutex, Ordering::*, lock};
use crate::system::binding::{Bound, CoreMap};
use crate::{Error, Result};

/// Permits to insert a vertex that a worker takes at once, at most.
pub(super) const PERMITS: u64 = 64;

/// Told which part is done, and how many tets there are; an error stops the team.
pub(super) type Report<'a> = dyn Fn(f64, u64) -> Result<()> + Sync + 'a;

/// What is there when a refinement goes on.
pub(super) struct There<'a> {
    /// What was done.
    pub counters: Counters,
    /// The slots of all tets.
    pub slots: Range<TetId>,
    /// Vertices that come now have this id or a larger one.
    pub first_vertex: VertexId,
    /// Where the sizing field has become smaller.
    pub denser: &'a NearBlocks,
    /// The tets that were left over; they may be gone by now.
    pub left_over: &'a [TetStamp],
}

/// The team.
pub(super) struct Team<'a> {
    pub rules: &'a Rules<'a>,
    pub state: &'a State<'a>,
    pub samples: Vec<DVec3>,
    /// What was there before, when a refinement goes on.
    pub there: Option<There<'a>>,
    pub keeps_timeline: bool,
    pub parking: Parking,
    pub contention: Contention,
    pub begging: Begging<Gift>,
    /// Where each worker works, under LAPD.
    pub regions: Option<Regions>,
    pub machine: &'a Machine,
    places: Option<&'a CoreMap>,
    limits: &'a Limits,
    report: &'a Report<'a>,
    expected_tets: u64,
    size: usize,
    /// Vertices that may still be inserted and that no worker has a permit for.
    permits: CachePadded<AtomicU64>,
    /// Tets, and bytes of the workers, as they last told; sums that wrap.
    tets: CachePadded<AtomicU64>,
    bytes: CachePadded<AtomicU64>,
    /// Workers that came to each meeting.
    meetings: [AtomicUsize; 2],
    /// Why the team was stopped: the first reason.
    failure: Mutex<Option<Error>>,
    /// What workers could not carry out.
    left_over: Mutex<LeftOver>,
}

/// The part of the work that is done, 0 to 1, where so large a part of the tets that were expected
/// is there. Below 1 however wrong the expectation is.
fn part_done(tets: f64) -> f64 {
    const TRUSTED: f64 = 0.8;
    const REST: f64 = 1.0 - TRUSTED;
    if tets < TRUSTED { tets } else { 1.0 - REST * ((TRUSTED - tets) / REST).exp() }
}

impl<'a> Team<'a> {
    pub fn new(
        state: &'a State<'a>,
        samples: Vec<DVec3>,
        regions: Option<Regions>,
        options: &'a RefineOptions,
        report: &'a Report<'a>,
        there: Option<There<'a>>,
    ) -> Self {
        let size = options.threads;
        // What there is already: of the box's tets nobody keeps count.
        let counters = there.as_ref().map(|there| there.counters).unwrap_or_default();
        let vertices = counters.insertions.saturating_sub(counters.removals);
        let tets = counters.created.saturating_sub(counters.destroyed);
        let left = |max: usize| (max as u64).saturating_sub(vertices);
        let levels = match &regions {
            Some(regions) => regions.levels(),
            None => Levels::of(&options.machine, size, options.begging),
        };
        Self {
            rules: state.rules,
            state,
            keeps_timeline: options.timeline,
            parking: Parking::new(size),
            contention: Contention::new(options.contention, size),
            begging: Begging::new(levels),
            regions,
            machine: &options.machine,
            places: options.places.as_ref(),
            limits: &options.limits,
            report,
            expected_tets: options
                .expected_tets
                .saturating_add(ALL_TETS_PER_SAMPLE * samples.len() as u64)
                .saturating_add(tets),
            size,
            samples,
            there,
            permits: AtomicU64::new(options.limits.max_vertices.map_or(u64::MAX / 2, left)).into(),
            tets: AtomicU64::new(tets).into(),
            bytes: CachePadded::default(),
            meetings: [AtomicUsize::new(0), AtomicUsize::new(0)],
            failure: Mutex::new(None),
            left_over: Mutex::new(LeftOver::default()),
        }
    }

    /// A worker of the kernel for worker `me`, on its node.
    pub fn worker<L: Locks, P: Probe>(&self, me: usize, locks: L, probe: P) -> Worker<L, P> {
        // Nodes are no more than workers: each has a core.
        let node = self.machine.node_of_worker(me) as NodeId;
        Worker::with_probe(locks, probe, me).at_node(node, self.regions.is_some())
    }

    /// How many workers there are.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Binds the calling thread, which is worker `me`, to its core until the answer is dropped, if
    /// workers are to be bound. A failure stops the team.
    pub fn bind(&self, me: usize) -> Option<Bound> {
        self.places?.bind(me).map_err(|error| self.stop(error)).ok()
    }

    /// Reports, and checks limits and the cancel flag; a worker's tets and bytes have grown by
    /// `more`, which may be less than nothing, wrapped.
    pub fn report_and_check(&self, more: (u64, u64)) -> Result<()> {
        self.go_on()?;
        // Relaxed: sums for people and limits.
        let tets = self.tets.fetch_add(more.0, Relaxed).wrapping_add(more.0);
        let bytes = self.bytes.fetch_add(more.1, Relaxed).wrapping_add(more.1);
        (self.report)(part_done(tets as f64 / self.expected_tets.max(1) as f64), tets)?;
        let later = u64::from(self.rules.triangulation.tet_bound()) * self.limits.bytes_per_slot;
        let samples = size_of_val(self.samples.as_slice()) as u64;
        let in_the_end = self.rules.oracle.bytes() as u64 + self.limits.bytes_after;
        self.limits.check_memory((self.state.bytes() + samples + bytes).max(in_the_end) + later)?;
        self.limits.check_time()
    }

    /// Ends all waits; each worker ends at its next look around. The first reason counts, but for a
    /// broken invariant, which outweighs all others: no mesh can be made then.
    pub fn stop(&self, reason: Error) {
        {
            let mut failure = lock(&self.failure);
            if failure.is_none() || matches!(reason, Error::Internal(_)) {
                *failure = Some(reason);
            }
        }
        self.parking.stop();
    }

    /// Nothing while the team works on.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when it was stopped; the reason is told by [`Self::failure`].
    #[inline]
    pub fn go_on(&self) -> Result<()> {
        if self.parking.is_stopped() { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Takes what a worker could not carry out. A failure stops the team.
    pub fn take_left_over(&self, of_worker: LeftOver) {
        if let Err(error) = lock(&self.left_over).append(of_worker) {
            self.stop(error);
        }
    }

    /// What all workers could not carry out.
    pub fn left_over(&self) -> LeftOver {
        std::mem::take(&mut lock(&self.left_over))
    }

    /// Why the team was stopped.
    pub fn failure(self) -> Option<Error> {
        lock(&self.failure).take()
    }

    /// Some permits to insert a vertex: the fewer, the fewer are left, so that hardly any are in
    /// the hands of others when the last one is taken.
    ///
    /// # Errors
    /// [`Error::LimitReached`] when none is left.
    pub fn take_permits(&self) -> Result<u64> {
        let share = |left: u64| (left / (2 * self.size as u64)).clamp(1, PERMITS).min(left);
        // Relaxed: a number of which each takes a part.
        let left = self.permits.fetch_update(Relaxed, Relaxed, |left| Some(left - share(left)));
        match share(left.unwrap_or_else(|left| left)) {
            0 => {
                let max = self.limits.max_vertices.unwrap_or(usize::MAX);
                Err(Error::LimitReached(format!("the limit of {max} vertices was reached")))
            }
            permits => Ok(permits),
        }
    }

    /// Gives back permits that were not used.
    pub fn return_permits(&self, permits: u64) {
        self.permits.fetch_add(permits, Relaxed);
    }

    /// Waits until all workers have come to meeting `which`.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when the team was stopped.
    pub fn meet(&self, which: usize) -> Result<()> {
        let come = &self.meetings[which];
        // What each did before the meeting all see after it.
        if come.fetch_add(1, AcqRel) + 1 == self.size {
            self.parking.wake_all();
        }
        self.parking.wait(|| come.load(Acquire) == self.size);
        self.go_on()
    }
}
