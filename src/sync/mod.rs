//! The primitives of coordination between workers, from the standard library; a model checker puts
//! its own in their place (`verification/loom`). In a build with the feature `simulation`, virtual
//! workers wait and wake in virtual time (`virtual_time`). This is the one place where that is
//! chosen.

pub mod clock;
#[cfg_attr(not(feature = "simulation"), path = "no_virtual_time.rs")]
pub mod virtual_time;

#[cfg(not(feature = "simulation"))]
pub use std::sync::atomic::AtomicU8;
#[cfg(feature = "simulation")]
pub use std::sync::atomic::AtomicU16;
pub use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
pub use std::sync::{Mutex, MutexGuard};
use std::thread::{self, Thread};
use std::time::Duration;

use crossbeam_utils::Backoff;

/// A time stamp: see [`clock::ticks`].
pub type Ticks = u64;

/// Longest sleep: who waits also watches what nobody wakes it for.
const NAP: Duration = Duration::from_millis(1);

/// Bytes of the stack of a worker's thread. Said, because the standard library would ask the
/// environment.
pub const STACK: usize = 2 << 20;

/// Locks; a panic of another thread that held the lock is that thread's to report.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Waits until `done`.
pub fn wait_until(done: impl Fn() -> bool) {
    if virtual_time::is_running() {
        return virtual_time::wait_until(done);
    }
    // Spins about as long as one operation takes, then offers the processor to others, then sleeps.
    let backoff = Backoff::new();
    while !done() {
        if backoff.is_completed() {
            thread::park_timeout(NAP);
        } else {
            backoff.snooze();
        }
    }
}

/// A thread that may wait.
#[derive(Debug)]
pub struct Waiter {
    thread: Thread,
    worker: Option<virtual_time::Number>,
}

impl Waiter {
    /// The calling thread.
    pub fn current() -> Self {
        Self { thread: thread::current(), worker: virtual_time::current() }
    }

    /// Lets the thread look again whether it still has to wait.
    pub fn wake(&self) {
        if let Some(worker) = self.worker {
            return virtual_time::wake(worker);
        }
        self.thread.unpark();
    }
}

/// Offers the processor to other threads.
pub fn yield_now() {
    if virtual_time::is_running() {
        return virtual_time::offer();
    }
    thread::yield_now();
}

/// Sleeps for about so many microseconds.
pub fn sleep_micros(micros: u64) {
    if virtual_time::is_running() {
        return virtual_time::sleep_micros(micros);
    }
    thread::sleep(Duration::from_micros(micros));
}

/// Runs `lead` on the calling thread and each of `others` on one of its own, named `lapd-1` and so
/// on, until all have ended. `None` for a thread that could not be had, whereupon `lacking` is
/// called before `lead`, and for one that panicked.
pub fn run_together<T: Send>(
    lead: impl FnOnce() -> T,
    others: Vec<impl FnOnce() -> T + Send>,
    lacking: impl FnOnce(),
) -> (T, Vec<Option<T>>) {
    if virtual_time::is_running() {
        return virtual_time::run_together(lead, others, lacking);
    }
    thread::scope(|scope| {
        let begin = |(at, part)| {
            thread::Builder::new()
                .name(format!("lapd-{}", at + 1))
                .stack_size(STACK)
                .spawn_scoped(scope, part)
        };
        let others: Vec<_> = others.into_iter().enumerate().map(begin).collect();
        if others.iter().any(|thread| thread.is_err()) {
            lacking();
        }
        let lead = lead();
        (lead, others.into_iter().map(|thread| thread.ok()?.join().ok()).collect())
    })
}
