//! Time stamps that cost next to nothing: one before every operation of every worker, so that the
//! time of those that are given up is known.

use std::time::Instant;

use super::{Ticks, virtual_time};

/// Now. On x86-64 the processor's time stamp counter, some 20 cycles; it runs at one rate on all
/// cores of the machines of the last decade. Elsewhere nanoseconds of the system's monotonic clock.
/// A thread that moves to another core may find a stamp that is a little smaller than its last:
/// differences are to be taken with `saturating_sub`. A virtual worker's own clock in a simulation.
#[inline(always)]
pub fn ticks() -> Ticks {
    if virtual_time::is_running() {
        return virtual_time::now();
    }
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: every x86-64 processor has the counter.
        unsafe { std::arch::x86_64::_rdtsc() }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        use std::sync::OnceLock;
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed().as_nanos() as u64
    }
}

/// Turns ticks into seconds, by a look at both clocks in the beginning and in the end.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: (Ticks, Instant),
}

impl Clock {
    /// Starts.
    pub fn start() -> Self {
        Self { start: (ticks(), Instant::now()) }
    }

    /// The first tick.
    pub fn first(&self) -> Ticks {
        self.start.0
    }

    /// Seconds of one tick, as measured from the start until now.
    pub fn seconds_per_tick(&self) -> f64 {
        if virtual_time::is_running() {
            return virtual_time::SECONDS_PER_TICK;
        }
        let passed = ticks().saturating_sub(self.start.0);
        self.start.1.elapsed().as_secs_f64() / passed.max(1) as f64
    }
}
