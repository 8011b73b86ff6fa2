//! What connects a run to the program that hosts it: progress and log lines out, cancellation in.
//!
//! A run is a sequence of [`Step`]s. Each announces how many pieces of work it has and says after
//! every few of them how far it is; that is also where it looks at the cancel flag. Pieces are made
//! so small that the next look comes within some milliseconds.
//!
//! Thread safety: a [`Monitor`] is shared by all threads of a run. The callbacks are called by
//! whichever of them comes by, one call at a time.
//!
//! Cost: without a progress callback a look is some relaxed loads; with one, also a clock, read no
//! more often than pieces are finished.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use crate::memory::Watch;
use crate::{Error, Result};

/// The phases of a run, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(i32)]
pub enum Phase {
    /// The image is prepared: the oracle is built.
    Prepare = 0,
    /// Delaunay refinement.
    Refine = 1,
    /// The mesh is collected, and the triangulation checked.
    Extract = 2,
    /// Slivers are removed.
    Improve = 3,
    /// Quality and certificate are measured.
    Certify = 4,
}

/// The steps of a run, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(usize)]
pub enum Step {
    /// The oracle: labels, their weights.
    Oracle,
    /// Delaunay refinement.
    Refine,
    /// What is kept of the triangulation is numbered.
    Number,
    /// What rules still apply to is counted.
    Unmet,
    /// The triangulation is checked.
    Validate,
    /// The mesh is copied.
    Extract,
    /// Slivers are removed.
    Improve,
    /// Shapes and orientations are measured.
    Quality,
    /// Orphans, components and their boundaries.
    Counts,
    /// The image's interfaces are collected, and the mesh's distance to them is measured.
    MeshToImage,
    /// The mesh's interfaces are sorted, and the image's distance to them is measured.
    ImageToMesh,
    /// Nothing is left to do.
    Done,
}

/// Phase of each step, and the part of a run's time at which it starts: about as on the abdomen at
/// delta 2, one thread, with all that is measured, when every tet was asked for unmet rules.
const STEPS: [(Phase, f64); 12] = [
    (Phase::Prepare, 0.0),
    (Phase::Refine, 0.01),
    (Phase::Extract, 0.385),
    (Phase::Extract, 0.42),
    (Phase::Extract, 0.485),
    (Phase::Extract, 0.545),
    (Phase::Improve, 0.565),
    (Phase::Certify, 0.665),
    (Phase::Certify, 0.70),
    (Phase::Certify, 0.80),
    (Phase::Certify, 0.91),
    (Phase::Certify, 1.0),
];

/// Time between two reports of progress, those at the start of steps apart.
pub(crate) const INTERVAL: Duration = Duration::from_millis(50);

/// One report of progress.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// The phase.
    pub phase: Phase,
    /// Part of the whole run that is done, 0 to 1; an estimate that never decreases.
    pub fraction: f64,
    /// Tets of the triangulation so far (background included).
    pub tets: u64,
}

/// How much a log line matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// The result may not be what the caller expects.
    Warning,
    /// What the run does.
    Info,
}

/// A flag that any thread may raise to end a run.
#[derive(Debug, Default)]
pub struct CancelFlag(AtomicBool);

impl CancelFlag {
    /// Asks the run to end.
    pub fn cancel(&self) {
        // Relaxed: the flag carries no data; the run only has to see it in the end.
        self.0.store(true, Relaxed);
    }

    /// Makes the flag ready for another run.
    pub fn reset(&self) {
        self.0.store(false, Relaxed);
    }

    /// Whether the run was asked to end.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }
}

/// Receives progress, on any thread of the run; `false` cancels.
pub type ProgressFn<'a> = dyn FnMut(Progress) -> bool + Send + 'a;

/// Receives log lines, on any thread of the run.
pub type LogFn<'a> = dyn FnMut(Level, &str) + Send + 'a;

/// The callback for progress, and what keeps its reports in order.
struct Reporter<'a> {
    callback: &'a mut ProgressFn<'a>,
    last_fraction: f64,
}

/// What a run reports to and listens to.
pub struct Monitor<'a> {
    progress: Option<Mutex<Reporter<'a>>>,
    log: Option<Mutex<&'a mut LogFn<'a>>>,
    cancel: Option<&'a CancelFlag>,
    /// The callback said that the run is to end.
    stopped: AtomicBool,
    /// The step, its pieces, and how many of them are done.
    step: AtomicUsize,
    pieces: AtomicUsize,
    done: AtomicUsize,
    /// The parts of the step between which its pieces lie, as bits.
    parts: [AtomicU64; 2],
    tets: AtomicU64,
    start: Instant,
    /// When the next report is due, in milliseconds after `start`.
    due: AtomicU64,
    /// When the step is to end, in the same measure, and the limit in seconds that this comes from,
    /// as bits.
    ends_at: AtomicU64,
    time_limit: AtomicU64,
    /// The first step that counts for progress, but for the preparation, and the first one that
    /// the run leaves out at its end.
    first: AtomicUsize,
    last: AtomicUsize,
    /// How many times as long improvement takes as [`STEPS`] has it, as bits.
    improvement: AtomicU64,
    /// Whether the system refuses memory.
    memory: Watch,
    /// Asked besides at each look at the cancel flag.
    also: Option<&'a (dyn Fn() -> Result<()> + Sync)>,
}

/// All of a step.
const WHOLE: [f64; 2] = [0.0, 1.0];

/// `ends_at` without an end.
const NEVER: u64 = u64::MAX;

impl Default for Monitor<'_> {
    fn default() -> Self {
        Self::new(None, None)
    }
}

impl<'a> Monitor<'a> {
    /// Reports nowhere and is never cancelled.
    pub fn silent() -> Self {
        Self::default()
    }

    /// Reports to `progress` and watches `cancel`.
    pub fn new(progress: Option<&'a mut ProgressFn<'a>>, cancel: Option<&'a CancelFlag>) -> Self {
        Self {
            progress: progress
                .map(|callback| Mutex::new(Reporter { callback, last_fraction: 0.0 })),
            log: None,
            cancel,
            stopped: AtomicBool::new(false),
            step: AtomicUsize::new(0),
            pieces: AtomicUsize::new(1),
            done: AtomicUsize::new(0),
            parts: WHOLE.map(|part| AtomicU64::new(part.to_bits())),
            tets: AtomicU64::new(0),
            start: Instant::now(),
            due: AtomicU64::new(0),
            ends_at: AtomicU64::new(NEVER),
            time_limit: AtomicU64::new(0),
            first: AtomicUsize::new(Step::Oracle as usize),
            last: AtomicUsize::new(Step::Done as usize),
            improvement: AtomicU64::new(1.0_f64.to_bits()),
            memory: Watch::new(),
            also: None,
        }
    }

    /// Reports nowhere and asks `look` whenever it looks at the cancel flag: for work within a step
    /// of another monitor, which `look` tells that the work goes on.
    pub fn within(look: &'a (dyn Fn() -> Result<()> + Sync)) -> Self {
        Self { also: Some(look), ..Self::silent() }
    }

    /// Sends log lines to `log`.
    pub fn with_log(self, log: Option<&'a mut LogFn<'a>>) -> Self {
        Self { log: log.map(Mutex::new), ..self }
    }

    /// Logs a line.
    pub fn log(&self, level: Level, line: &str) {
        if let Some(mut log) = self.log.as_ref().and_then(|log| log.lock().ok()) {
            log(level, line);
        }
    }

    /// Begins a step that has `pieces` pieces of work, and reports it.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn enter(&self, step: Step, pieces: usize) -> Result<()> {
        self.enter_part(step, pieces, WHOLE)
    }

    /// The same for pieces of work that lie between two parts of the step.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn enter_part(&self, step: Step, pieces: usize, parts: [f64; 2]) -> Result<()> {
        self.step.store(step as usize, Relaxed);
        for (to, part) in self.parts.iter().zip(parts) {
            to.store(part.to_bits(), Relaxed);
        }
        self.pieces.store(pieces.max(1), Relaxed);
        self.done.store(0, Relaxed);
        // After a cancellation the callback is not called again.
        self.check_cancelled()?;
        self.report(0.0);
        self.check_cancelled()
    }

    /// Says that `pieces` more pieces of the step are done. Pieces beyond those announced count as
    /// none.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    #[inline]
    pub fn advance(&self, pieces: usize) -> Result<()> {
        self.check_cancelled()?;
        if self.progress.is_some() {
            let done = self.done.fetch_add(pieces, Relaxed) + pieces;
            if self.is_due() {
                self.report(done as f64 / self.pieces.load(Relaxed) as f64);
                return self.check_cancelled();
            }
        }
        Ok(())
    }

    /// Says how far the step is (0 to 1), and how many tets there are.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn advance_to(&self, part: f64, tets: u64) -> Result<()> {
        self.note_tets(tets);
        self.check_cancelled()?;
        if self.progress.is_some() && self.is_due() {
            self.report(part);
            return self.check_cancelled();
        }
        Ok(())
    }

    /// Says how many tets there are.
    pub fn note_tets(&self, tets: u64) {
        self.tets.store(tets, Relaxed);
    }

    /// Checks for cancellation, for memory that the system refuses, and for the end of time where
    /// [`Self::end_at`] has set one; relaxed loads.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when the flag is raised or the callback returned `false`;
    /// [`Error::OutOfMemory`]; [`Error::TimeLimit`].
    #[inline]
    pub fn check_cancelled(&self) -> Result<()> {
        if self.cancel.is_some_and(CancelFlag::is_cancelled) || self.stopped.load(Relaxed) {
            return Err(Error::Cancelled);
        }
        self.memory.check()?;
        if let Some(also) = self.also {
            also()?;
        }
        let ends_at = self.ends_at.load(Relaxed);
        if ends_at != NEVER && self.milliseconds() >= ends_at {
            return Err(Error::time_limit(f64::from_bits(self.time_limit.load(Relaxed))));
        }
        Ok(())
    }

    /// Says that the run goes from the step before this one to its end; before the run begins.
    pub fn leave_out_from(&self, step: Step) {
        self.last.store(step as usize, Relaxed);
    }

    /// Says that the run goes from its preparation to this step at once; before the run begins.
    pub fn leave_out_before(&self, step: Step) {
        self.first.store(step as usize, Relaxed);
    }

    /// Says that improvement will take so many times as long as it does where the mesh is not
    /// coarsened; before the run begins.
    pub fn lengthen_improvement(&self, times: f64) {
        self.improvement.store(times.to_bits(), Relaxed);
    }

    /// When a step starts, in units of [`STEPS`].
    fn start_of(&self, step: usize) -> f64 {
        let start = STEPS[step].1;
        let [improve, next] = [Step::Improve, Step::Quality].map(|step| step as usize);
        if step <= improve {
            return start;
        }
        let times = f64::from_bits(self.improvement.load(Relaxed));
        start + (times - 1.0) * (STEPS[next].1 - STEPS[improve].1)
    }

    /// Ends what follows at a time, which the limit `seconds` has led to; `None`: at no time. No
    /// step may be under way.
    pub fn end_at(&self, deadline: Option<(Instant, f64)>) {
        let ends_at = deadline.map_or(NEVER, |(end, seconds)| {
            self.time_limit.store(seconds.to_bits(), Relaxed);
            end.saturating_duration_since(self.start).as_millis() as u64
        });
        self.ends_at.store(ends_at, Relaxed);
    }

    fn milliseconds(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    fn is_due(&self) -> bool {
        self.milliseconds() >= self.due.load(Relaxed)
    }

    /// Calls the callback, unless another thread does. `part`: how far the step is.
    fn report(&self, part: f64) {
        let Some(mut reporter) =
            self.progress.as_ref().and_then(|progress| progress.try_lock().ok())
        else {
            return;
        };
        // The callback may have cancelled while this thread was on its way.
        if self.stopped.load(Relaxed) {
            return;
        }
        let step = self.step.load(Relaxed);
        let phase = STEPS[step].0;
        let [start, end] = [step, (step + 1).min(STEPS.len() - 1)].map(|step| self.start_of(step));
        let [from, to] = [&self.first, &self.last].map(|step| self.start_of(step.load(Relaxed)));
        let [begun, ended] = [0, 1].map(|i| f64::from_bits(self.parts[i].load(Relaxed)));
        let part = begun + (ended - begun) * part.clamp(0.0, 1.0);
        let fraction = (start + (end - start) * part - from) / (to - from);
        reporter.last_fraction = reporter.last_fraction.max(fraction.min(1.0));
        let progress =
            Progress { phase, fraction: reporter.last_fraction, tets: self.tets.load(Relaxed) };
        if !(reporter.callback)(progress) {
            self.stopped.store(true, Relaxed);
        }
        // From the end of the call: a slow callback does not take all the time there is.
        self.due.store(self.milliseconds() + INTERVAL.as_millis() as u64, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_in_order() {
        assert!(STEPS.is_sorted_by(|a, b| a.0 <= b.0 && a.1 <= b.1));
        assert_eq!(STEPS[Step::Done as usize].1, 1.0);
        assert_eq!(STEPS.len(), Step::Done as usize + 1);
    }

    #[test]
    fn reports_are_few_and_those_of_steps_complete() {
        let mut seen = Vec::new();
        let mut record = |p: Progress| {
            seen.push(p.phase);
            true
        };
        let monitor = Monitor::new(Some(&mut record), None);
        for step in [Step::Oracle, Step::Refine, Step::Unmet, Step::Quality, Step::Done] {
            monitor.enter(step, 1000).unwrap();
            (0..1000).for_each(|_| monitor.advance(1).unwrap());
        }
        // A machine that stands still for a while makes more.
        assert!((5..50).contains(&seen.len()), "{seen:?}");
        assert!(seen.is_sorted());
    }

    #[test]
    fn a_long_improvement_takes_most_of_the_way() {
        for (times, part) in [(1.0, 0.565), (10.0, 0.565 / 1.9)] {
            let mut seen = Vec::new();
            let mut record = |p: Progress| {
                seen.push(p.fraction);
                true
            };
            let monitor = Monitor::new(Some(&mut record), None);
            monitor.lengthen_improvement(times);
            for step in [Step::Oracle, Step::Improve, Step::Done] {
                monitor.enter(step, 1).unwrap();
            }
            assert!(seen[0] == 0.0 && (seen[1] - part).abs() < 1e-12 && seen[2] == 1.0, "{seen:?}");
        }
    }

    #[test]
    fn a_callback_stops_all_threads() {
        let mut calls = 0;
        let mut stop = |_| {
            calls += 1;
            false
        };
        let monitor = Monitor::new(Some(&mut stop), None);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| while monitor.advance(1).is_ok() {});
            }
        });
        assert!(matches!(monitor.enter(Step::Refine, 1), Err(Error::Cancelled)));
        assert_eq!(calls, 1);
    }

    #[test]
    fn log_lines_arrive() {
        let mut lines = Vec::new();
        let mut log = |level: Level, line: &str| lines.push((level, line.to_owned()));
        Monitor::silent().with_log(Some(&mut log)).log(Level::Info, "one");
        Monitor::silent().log(Level::Info, "nobody listens");
        assert_eq!(lines, [(Level::Info, "one".to_owned())]);
    }
}
