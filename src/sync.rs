//! The primitives of coordination between workers, from the standard library; a model checker puts its own in their place (`verification/loom`).

pub use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU64, AtomicUsize, Ordering};
pub use std::sync::{Mutex, MutexGuard};
use std::thread::{self, Thread};
use std::time::Duration;

/// Turns of a loop before a waiting thread offers its processor to others: about as long as one operation takes.
const SPINS: u32 = 200;
/// Offers before it sleeps.
const OFFERS: u32 = 16;
const YIELDS_END: u32 = SPINS + OFFERS;
/// Longest sleep: who waits also watches what nobody wakes it for.
const NAP: Duration = Duration::from_millis(1);

/// Locks; a panic of another thread that held the lock is that thread's to report.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Waits until `done`.
pub fn wait_until(done: impl Fn() -> bool) {
    for turn in 0.. {
        if done() {
            return;
        }
        match turn {
            0..SPINS => std::hint::spin_loop(),
            SPINS..YIELDS_END => thread::yield_now(),
            _ => thread::park_timeout(NAP),
        }
    }
}

/// A thread that may wait.
#[derive(Debug)]
pub struct Waiter(Thread);

impl Waiter {
    /// The calling thread.
    pub fn current() -> Self {
        Self(thread::current())
    }

    /// Lets the thread look again whether it still has to wait.
    pub fn wake(&self) {
        self.0.unpark();
    }
}

/// Offers the processor to other threads.
pub use std::thread::yield_now;

/// Sleeps for about so many microseconds.
pub fn sleep_micros(micros: u64) {
    thread::sleep(Duration::from_micros(micros));
}
