//! Waiting, waking, and ending all waits.

use std::sync::OnceLock;

use crate::sync::{AtomicBool, Ordering::*, Waiter, wait_until};

/// The threads of a team of workers.
#[derive(Debug)]
pub struct Parking {
    threads: Vec<OnceLock<Waiter>>,
    stopped: AtomicBool,
}

impl Parking {
    /// Places for `size` workers.
    pub fn new(size: usize) -> Self {
        Self {
            threads: (0..size).map(|_| OnceLock::new()).collect(),
            stopped: AtomicBool::new(false),
        }
    }

    /// Says that worker `me` runs on the calling thread.
    pub fn register(&self, me: usize) {
        let _ = self.threads[me].set(Waiter::current());
    }

    /// Waits until `done`, or all waits are ended. What makes `done` true is to be followed by a
    /// [`Self::wake`]; a wake that is forgotten costs a millisecond.
    pub fn wait(&self, done: impl Fn() -> bool) {
        wait_until(|| done() || self.is_stopped());
    }

    /// Lets worker `who` look again.
    pub fn wake(&self, who: usize) {
        // Who is not registered yet does not sleep either.
        if let Some(thread) = self.threads[who].get() {
            thread.wake();
        }
    }

    /// Lets all look again.
    pub fn wake_all(&self) {
        (0..self.threads.len()).for_each(|who| self.wake(who));
    }

    /// Ends all waits, now and from now on.
    pub fn stop(&self) {
        // Release: who finds the waits ended finds the reason.
        self.stopped.store(true, Release);
        self.wake_all();
    }

    /// Whether all waits are ended.
    #[inline]
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Acquire)
    }
}
