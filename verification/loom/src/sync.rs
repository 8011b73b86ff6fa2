//! What `lapd::sync` has, on loom's primitives.
//!
//! - Who waits looks once, and then sleeps until a bell rings that all wakes ring. Loom says so
//!   when all threads sleep or wait for a lock. So deadlocks are found, and wakes that are
//!   forgotten, which cost the library a millisecond. Loops that spin and yield would not do: of
//!   two such threads loom lets each run for the other's sake for ever.
//! - Loom takes sequentially consistent loads and stores for acquire and release, and exchanges for
//!   both, but knows fences. The library has such accesses in one place, an exchange before looks
//!   elsewhere ([`AtomicU8`]), so a fence stands before the look: no stronger than the accesses are
//!   for two threads each of which exchanges one byte and looks at the other's, and none between
//!   the exchange and what is read before the look.

pub use loom::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
pub use loom::sync::{Mutex, MutexGuard};
pub use loom::thread::yield_now;

use loom::sync::Condvar;

/// A byte whose sequentially consistent loads have a fence before them.
#[derive(Debug, Default)]
pub struct AtomicU8(loom::sync::atomic::AtomicU8);

#[allow(missing_docs)]
impl AtomicU8 {
    pub fn load(&self, order: Ordering) -> u8 {
        if order != Ordering::SeqCst {
            return self.0.load(order);
        }
        loom::sync::atomic::fence(Ordering::SeqCst);
        self.0.load(Ordering::Acquire)
    }

    pub fn store(&self, value: u8, order: Ordering) {
        self.0.store(value, order);
    }

    pub fn compare_exchange(
        &self,
        from: u8,
        to: u8,
        success: Ordering,
        failure: Ordering,
    ) -> Result<u8, u8> {
        self.0.compare_exchange(from, to, success, failure)
    }
}

/// Locks.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().expect("a model that panics has ended")
}

loom::lazy_static! {
    static ref BELL: (Mutex<()>, Condvar) = (Mutex::new(()), Condvar::new());
}

/// Waits until `done`. The first look is one without the order that the bell's lock brings.
pub fn wait_until(done: impl Fn() -> bool) {
    if done() {
        return;
    }
    let (lock_of_bell, bell) = &*BELL;
    let mut held = lock(lock_of_bell);
    while !done() {
        held = bell.wait(held).expect("a model that panics has ended");
    }
}

/// A thread that may wait.
#[derive(Debug)]
pub struct Waiter;

impl Waiter {
    /// Any thread: all hear the bell.
    pub fn current() -> Self {
        Self
    }

    /// Rings the bell.
    pub fn wake(&self) {
        let (lock_of_bell, bell) = &*BELL;
        drop(lock(lock_of_bell));
        bell.notify_all();
    }
}

/// No time passes here.
pub fn sleep_micros(_: u64) {
    yield_now();
}
