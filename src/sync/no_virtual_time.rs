//! What stands in the place of `virtual_time` in a build without simulations: nothing is ever
//! simulated, and the compiler leaves out what would be done then.

use std::convert::Infallible;

use super::Ticks;

/// The number of a virtual worker: there is none.
pub type Number = Infallible;
/// Of no meaning.
pub const SECONDS_PER_TICK: f64 = 0.0;

/// Whether the calling thread runs virtual workers.
#[inline(always)]
pub fn is_running() -> bool {
    false
}

/// The worker that runs.
pub fn current() -> Option<Number> {
    None
}

/// Of a worker that runs.
pub fn now() -> Ticks {
    0
}

/// Of a worker that runs.
pub fn wait_until(_: impl Fn() -> bool) {}

/// Of a worker that runs.
pub fn wake(who: Number) {
    match who {}
}

/// Of a worker that runs.
pub fn offer() {}

/// Of a worker that runs.
pub fn sleep_micros(_: u64) {}

/// Of a worker that runs.
pub fn run_together<T>(
    lead: impl FnOnce() -> T,
    _: Vec<impl FnOnce() -> T>,
    _: impl FnOnce(),
) -> (T, Vec<Option<T>>) {
    (lead(), Vec::new())
}
