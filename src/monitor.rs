//! What connects a run to the program that hosts it: progress out, cancellation in.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::{Error, Result};

/// The phases of a run, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(i32)]
pub enum Phase {
    /// The feature transform of the image.
    Distance = 0,
    /// Delaunay refinement.
    Refine = 1,
    /// The finished mesh is collected.
    Extract = 2,
    /// Quality and certificate are measured.
    Certify = 3,
}

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

/// A flag that any thread may raise to end a run.
#[derive(Debug, Default)]
pub struct CancelFlag(AtomicBool);

impl CancelFlag {
    /// Asks the run to end.
    pub fn cancel(&self) {
        // Relaxed: the flag carries no data; the run only has to see it in the end.
        self.0.store(true, Ordering::Relaxed);
    }

    /// Makes the flag ready for another run.
    pub fn reset(&self) {
        self.0.store(false, Ordering::Relaxed);
    }

    /// Whether the run was asked to end.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Receives progress on the thread that called the run; `false` cancels.
pub type ProgressFn<'a> = dyn FnMut(Progress) -> bool + 'a;

/// What a run reports to and listens to.
#[derive(Default)]
pub struct Monitor<'a> {
    progress: Option<&'a mut ProgressFn<'a>>,
    cancel: Option<&'a CancelFlag>,
    last_fraction: f64,
}

impl<'a> Monitor<'a> {
    /// Reports nowhere and is never cancelled.
    pub fn silent() -> Self {
        Self::default()
    }

    /// Reports to `progress` and watches `cancel`.
    pub fn new(progress: Option<&'a mut ProgressFn<'a>>, cancel: Option<&'a CancelFlag>) -> Self {
        Self { progress, cancel, last_fraction: 0.0 }
    }

    /// Reports progress and checks for cancellation. Fractions are made monotone here.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when the flag is raised or the callback returned `false`.
    pub fn report(&mut self, phase: Phase, fraction: f64, tets: u64) -> Result<()> {
        self.last_fraction = self.last_fraction.max(fraction.clamp(0.0, 1.0));
        let go_on = match &mut self.progress {
            Some(callback) => callback(Progress { phase, fraction: self.last_fraction, tets }),
            None => true,
        };
        if go_on { self.check_cancelled() } else { Err(Error::Cancelled) }
    }

    /// Checks for cancellation alone; a relaxed load.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when the flag is raised.
    #[inline]
    pub fn check_cancelled(&self) -> Result<()> {
        match self.cancel {
            Some(flag) if flag.is_cancelled() => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }

    /// The flag, for worker threads.
    pub fn cancel_flag(&self) -> Option<&'a CancelFlag> {
        self.cancel
    }
}
