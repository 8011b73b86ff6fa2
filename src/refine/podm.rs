//! PODM: parallel optimistic Delaunay meshing, the paper's sections 1 to 3. All workers refine one
//! triangulation, each from its own poor element list; tets are locked by trial
//! (`delaunay/ownership`), an operation that meets another worker's lock is given up
//! (`parallel/contention`), and who has no work begs for some (`parallel/begging`).
//!
//! 1. The image is sampled (`sampling`), on all threads.
//! 2. One worker inserts the first rounds of samples: some hundreds, of which each cavity takes a
//!    large part of the triangulation. Then as many workers insert the next as there is room for,
//!    until there is for all.
//! 3. All workers insert the rest, each along its own range of each round's curve, or, under
//!    LAPD, in its own region (`lapd`).
//! 4. When all samples are in, each worker takes the tets of the memory that it claimed into its
//!    list; under LAPD those whose circumcenters lie in its region.
//! 5. All work off their lists until nobody has any work.
//!
//! A refinement may go on ([`refine_further`]) when the sizing field has become smaller in places:
//! these are sampled again, the samples are dealt to all workers at once, and what the rules may
//! ask for there is inspected again: tets whose circumballs come near to these places. All that R3
//! asks the field about lies in the circumballs of a facet's two tets: its vertices, and its dual
//! segment, since a ball around a point of that, through the vertices, lies within the two. So this
//! is as good as inspecting all. Where the places are few the tets are not looked for in all slots:
//! each worker keeps those that its samples made, and the first one goes from tet to tet for the
//! others (`delaunay/flood`); who has none begs.
//!
//! With one worker the same steps run on the calling thread, and nothing is locked. The result of
//! one worker is the same in every run; that of several depends on who came first.
//!
//! A worker that ends early, because of a limit, a cancel or a panic, stops the team: every wait
//! ends at once, and the others end at their next check, between two operations.

use super::activity::{ThreadReport, Work};
use super::lapd::{self, Regions};
use super::options::RefineOptions;
use super::probe::RefineProbe;
use super::refiner::Refiner;
use super::rules::Rules;
use super::sampling::{Earlier, Growth, Samples, sample_isosurface};
use super::state::State;
use super::team::{Team, There};
use super::unmet::LeftOver;
use crate::delaunay::ownership::MAX_OWNERS;
use crate::delaunay::worker::Counters;
use crate::delaunay::{CountVisits, Locks, NoProbe, Solo, TetId, TryLock};
use crate::image::voxel_blocks::NearBlocks;
use crate::memory::{reserve, room};
use crate::monitor::Monitor;
use crate::panics;
use crate::parallel::work_ranges::WorkRanges;
use crate::params::MAX_THREADS;
use crate::sizing::Sizing;
use crate::sync::clock::{Clock, ticks};
use crate::sync::run_together;
use crate::{Error, Result};

/// Least samples that all workers insert at once, for each of them: with fewer in the triangulation
/// cavities meet too often.
const SAMPLES_PER_WORKER: usize = 100;
const _: () = assert!(MAX_THREADS <= MAX_OWNERS);
/// Tets whose labels are found at a time when a limit has ended a run.
const LABELLED: usize = 1 << 14;

/// How a refinement ended.
#[derive(Debug)]
pub struct Refinement {
    /// Operations of all threads.
    pub counters: Counters,
    /// Rules and lookups.
    pub work: Work,
    /// The same for each thread, and what it lost.
    pub threads: Vec<ThreadReport>,
    /// The limit that ended it; `None`: no rule applies any more, but to what is left over.
    pub ended_by: Option<Error>,
    /// What could not be carried out.
    pub left_over: LeftOver,
    /// Runs from its start.
    clock: Clock,
}

/// What a refinement goes on from.
pub struct Before<'a> {
    /// How far apart its samples were to be: nowhere less than they are to be now.
    pub sizing: &'a Sizing,
    /// What was done until now.
    pub refinement: &'a Refinement,
    /// Where the field has become smaller.
    pub denser: &'a NearBlocks,
}

/// Refines a triangulation of nothing but its box until no rule applies, or a limit is reached: one
/// of the options, or that of the ids. Worker threads are joined before this returns.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`], also when a thread cannot be had;
/// [`Error::Internal`], also when a worker panics.
pub fn refine(
    rules: &Rules<'_>,
    options: &RefineOptions,
    monitor: &Monitor<'_>,
) -> Result<Refinement> {
    refine_from(rules, None, options, monitor)
}

/// Goes on with a refinement that no limit has ended, on the same triangulation, by `rules` whose
/// sizing field is smaller in places. Returns what is done here alone: see [`Refinement::add`].
///
/// # Errors
/// As [`refine`].
pub fn refine_further(
    rules: &Rules<'_>,
    before: &Before<'_>,
    options: &RefineOptions,
    monitor: &Monitor<'_>,
) -> Result<Refinement> {
    refine_from(rules, Some(before), options, monitor)
}

fn refine_from(
    rules: &Rules<'_>,
    before: Option<&Before<'_>>,
    options: &RefineOptions,
    monitor: &Monitor<'_>,
) -> Result<Refinement> {
    let triangulation = rules.triangulation;
    if options.count_accesses {
        refine_with(rules, before, options, monitor, &|_| CountVisits::new(triangulation))
    } else {
        refine_with(rules, before, options, monitor, &|_| NoProbe)
    }
}

/// As [`refine`], or [`refine_further`]; each worker tells a probe of what it does, which `probe`
/// makes for its number.
///
/// # Errors
/// As [`refine`].
pub fn refine_with<P: RefineProbe>(
    rules: &Rules<'_>,
    before: Option<&Before<'_>>,
    options: &RefineOptions,
    monitor: &Monitor<'_>,
    probe: &(impl Fn(usize) -> P + Sync),
) -> Result<Refinement> {
    let clock = before.map_or_else(Clock::start, |before| before.refinement.clock);
    // Samples are the smaller part: until they are there, reports say that nothing is done.
    let go_on = || monitor.advance(0).and_then(|()| options.limits.check_time());
    let (state, isovertices) = match before {
        None => (State::new(rules)?, Vec::new()),
        Some(_) => State::resumed(rules, || monitor.advance(0))?,
    };
    let earlier = before.map(|&Before { sizing, denser, .. }| Earlier {
        sizing,
        denser,
        isovertices: &isovertices,
    });
    let growth = if lapd::divides(options) { Growth::Fourfold } else { Growth::Eightfold };
    let samples = sample_isosurface(rules.oracle, rules.sizing, growth, earlier.as_ref(), go_on);
    let Dealt { samples, regions, work_ranges } =
        match samples.and_then(|samples| deal(rules, before, options, samples, go_on)) {
            Err(limit) if limit.is_limit() => {
                label_all(&state, monitor)?;
                return Ok(Refinement::none(limit, clock));
            }
            dealt => dealt?,
        };
    drop(isovertices);
    let total = samples.points.len();
    let [begin, end] = options.parts;
    let report_progress = |part: f64, tets| monitor.advance_to(begin + (end - begin) * part, tets);
    let there = before.map(|&Before { refinement, denser, .. }| There {
        counters: refinement.counters,
        slots: 0..rules.triangulation.tet_bound(),
        first_vertex: rules.triangulation.vertex_bound(),
        denser,
        left_over: &refinement.left_over.tets,
    });
    let team = Team::new(&state, samples.points, regions, options, &report_progress, there);
    // From here on: what a worker touches first lies in its core's memory. The samples were made by
    // all threads.
    let bound = team.bind(0);
    let mut lead = Refiner::new(&team, 0, team.worker(0, Solo, probe(0)));
    let end = match (options.threads, before) {
        (1, _) => total,
        (_, None) => first_for(2, &samples.rounds, total),
        // There is room for all.
        (_, Some(_)) => 0,
    };
    let mut first_samples = Some(0..end);
    // Before the triangulation takes what memory there is: what has been done is said even if that
    // was too little.
    let mut threads = room(options.threads, "reports of threads")?;
    let done = lead.insert_samples(|| first_samples.take());
    match done {
        Err(error) => {
            team.stop(error);
            threads.push(report(lead, &clock));
        }
        Ok(()) if options.threads == 1 => {
            if let Err(error) = lead.collect().and_then(|()| lead.run()) {
                team.stop(error);
            }
            threads.push(report(lead, &clock));
        }
        Ok(()) => {
            let lead = lead.with_locks(TryLock::new(0));
            threads.extend(work_together(&team, lead, probe, &work_ranges, &clock));
        }
    }
    drop(bound);
    let left_over = team.left_over();
    let (mut counters, mut work) = (Counters::default(), Work::default());
    for thread in &threads {
        counters.add(&thread.operations);
        work.add(&thread.work);
    }
    let ended_by = match team.failure() {
        Some(limit) if limit.is_limit() => Some(limit),
        Some(error) => return Err(error),
        None => None,
    };
    if ended_by.is_some() {
        label_all(&state, monitor)?;
    }
    Ok(Refinement { counters, work, threads, ended_by, left_over, clock })
}

impl Refinement {
    /// Adds what was done when it went on.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn add(&mut self, later: Self) -> Result<()> {
        self.counters.add(&later.counters);
        self.work.add(&later.work);
        reserve(&mut self.threads, later.threads.len(), "reports of threads")?;
        let mut reports = later.threads.into_iter();
        self.threads.iter_mut().zip(&mut reports).for_each(|(thread, later)| thread.add(later));
        self.threads.extend(reports);
        self.ended_by = later.ended_by;
        // Tets were asked again; samples that were not inserted are not offered again.
        self.left_over.tets = later.left_over.tets;
        self.left_over.samples += later.left_over.samples;
        Ok(())
    }

    fn none(limit: Error, clock: Clock) -> Self {
        Self {
            clock,
            counters: Counters::default(),
            work: Work::default(),
            threads: Vec::new(),
            ended_by: Some(limit),
            left_over: LeftOver::default(),
        }
    }
}

/// Samples, and who inserts which of them.
struct Dealt {
    samples: Samples,
    regions: Option<Regions>,
    /// Of the rounds that are for several workers.
    work_ranges: Vec<WorkRanges>,
}

/// Deals samples to the workers.
///
/// # Errors
/// [`Error::OutOfMemory`]; those of `go_on`.
fn deal(
    rules: &Rules<'_>,
    before: Option<&Before<'_>>,
    options: &RefineOptions,
    mut samples: Samples,
    go_on: impl Fn() -> Result<()>,
) -> Result<Dealt> {
    let (first, mut work_ranges) = match before {
        None => {
            let first = first_for(options.threads, &samples.rounds, samples.points.len());
            (first, deal_to_some(&samples, first, options.threads))
        }
        Some(_) => (0, Vec::new()),
    };
    let regions = Regions::new(rules, &samples.points, options)?;
    work_ranges.extend(match &regions {
        Some(regions) => regions.deal(&mut samples, first, go_on)?,
        None => deal_alike(&samples, first, options.threads),
    });
    Ok(Dealt { samples, regions, work_ranges })
}

/// Finds the labels of all tets: those that were made before the samples were complete have none.
/// Some at a time: memory may be what a run has ended by.
fn label_all(state: &State<'_>, monitor: &Monitor<'_>) -> Result<()> {
    let mut tets: Vec<TetId> = room(LABELLED, "tets without a label")?;
    let mut living = state.rules.triangulation.living_tets().peekable();
    while living.peek().is_some() {
        monitor.advance(0)?;
        tets.clear();
        tets.extend(living.by_ref().take(LABELLED));
        state.find_labels(&tets);
    }
    Ok(())
}

/// The first sample that so many workers may insert at once: a round's first.
fn first_for(workers: usize, rounds: &[usize], total: usize) -> usize {
    let enough = SAMPLES_PER_WORKER * workers;
    rounds.iter().copied().find(|&start| start >= enough).unwrap_or(total)
}

/// Deals the samples of each round for which there is room for several workers, but not for all,
/// which have those from `first` on.
fn deal_to_some(samples: &Samples, first: usize, threads: usize) -> Vec<WorkRanges> {
    let rounds = samples.rounds_from(first_for(2, &samples.rounds, samples.points.len()));
    let before = rounds.take_while(|round| round.start < first);
    before
        .map(|round| WorkRanges::of_some(round.clone(), round.start / SAMPLES_PER_WORKER, threads))
        .collect()
}

/// Deals the samples of each round from `first` on: to each worker a range of the round's curve.
fn deal_alike(samples: &Samples, first: usize, threads: usize) -> Vec<WorkRanges> {
    samples.rounds_from(first).map(|round| WorkRanges::new(round, threads)).collect()
}

/// Lets all workers do their part; the first is the calling thread.
fn work_together<'t, 'a, P: RefineProbe>(
    team: &'t Team<'a>,
    lead: Refiner<'t, 'a, TryLock, P>,
    probe: &(impl Fn(usize) -> P + Sync),
    work_ranges: &[WorkRanges],
    clock: &Clock,
) -> impl Iterator<Item = ThreadReport> {
    let part = |me| {
        move || {
            let _bound = team.bind(me);
            let worker = Refiner::new(team, me, team.worker(me, TryLock::new(me), probe(me)));
            do_part(team, me, worker, work_ranges, clock)
        }
    };
    let lacking = || team.stop(Error::OutOfMemory { count: team.size(), what: "threads" });
    let lead = || do_part(team, 0, lead, work_ranges, clock);
    let (lead, others) = run_together(lead, (1..team.size()).map(part).collect(), lacking);
    // A worker's panic is caught within its part.
    std::iter::once(lead).chain(others.into_iter().map(Option::unwrap_or_default))
}

/// A worker's part.
fn do_part(
    team: &Team<'_>,
    me: usize,
    mut worker: Refiner<'_, '_, TryLock, impl RefineProbe>,
    work_ranges: &[WorkRanges],
    clock: &Clock,
) -> ThreadReport {
    team.parking.register(me);
    let done = panics::catch(|| {
        for round in work_ranges {
            worker.insert_samples(|| round.take(me))?;
            if !round.is_for(me) {
                let begin = ticks();
                team.contention.leave(me, &team.parking);
                team.parking.wait(|| round.is_taken());
                team.contention.come_back(me);
                worker.lose_idle(begin);
            } else if !round.is_for_all() {
                // All but what is under way is done: the others may begin.
                team.parking.wake_all();
            }
        }
        // Nobody waits any more for one who waits for all.
        team.contention.leave(me, &team.parking);
        let begin = ticks();
        team.meet(0)?;
        team.contention.come_back(me);
        worker.lose_idle(begin);
        worker.collect()?;
        let begin = ticks();
        team.meet(1)?;
        worker.lose_idle(begin);
        worker.receive()?;
        worker.run()
    });
    // A worker that panicked has lost count, and may own tets for ever: all others are stopped.
    let done = done.unwrap_or_else(|panic| Err(Error::Internal(panic)));
    if let Err(error) = done {
        team.stop(error);
    }
    report(worker, clock)
}

fn report<L: Locks, P: RefineProbe>(
    mut worker: Refiner<'_, '_, L, P>,
    clock: &Clock,
) -> ThreadReport {
    worker.hand_in_left_over();
    let seconds_per_tick = clock.seconds_per_tick();
    ThreadReport {
        accesses: worker.accesses(),
        operations: worker.worker.counters,
        work: worker.work,
        overhead: worker.lost.overhead(seconds_per_tick),
        timeline: worker.timeline.spans(clock, seconds_per_tick),
    }
}
