//! Threads that live during one call only.
//!
//! Rayon's global pool is never used: it would start threads that outlive the call, and read the
//! environment. Whatever the engine spawns through rayon goes to a pool of the call's own, whose
//! threads are joined before the call returns.

use std::thread;

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::boundary::{Failure, Outcome};
use super::status::lapd_status;
use crate::panics::silently;
use crate::sync::STACK;

/// Runs `f` on the caller's thread with a pool of `threads` workers (at least 1), which are gone
/// when this returns.
pub(super) fn with_pool<T>(threads: usize, f: impl FnOnce(&ThreadPool) -> T) -> Outcome<T> {
    thread::scope(|scope| {
        let mut workers = Vec::new();
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .spawn_handler(|worker| {
                let builder = thread::Builder::new()
                    .name(format!("lapd-{}", worker.index()))
                    .stack_size(STACK);
                workers.push(builder.spawn_scoped(scope, || silently(|| worker.run()))?);
                Ok(())
            })
            .build()
            .map_err(|error| {
                Failure::new(
                    lapd_status::LAPD_ERROR_OUT_OF_MEMORY,
                    format!("no thread for the work: {error}"),
                )
            })?;
        let result = f(&pool);
        // Its threads end when it is dropped. They are joined here, because the scope's end would
        // only wait for their closures.
        drop(pool);
        for worker in workers {
            let _ = worker.join();
        }
        Ok(result)
    })
}

/// As many threads as the calling thread may use processors.
pub(super) fn processors() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}
