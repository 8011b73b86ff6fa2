//! Simulations of many workers on machines that are not at hand: the real algorithms, in virtual
//! time.
//!
//! The refinement runs as it is: its workers, lists, begging, contention managers, locks, on a real
//! triangulation whose mesh is as good as any. But the workers are coroutines on one thread, run in
//! the order of their virtual clocks, which advance by counted work. A lock that another worker
//! holds at that time refuses, a worker waits until another one wakes it, and so on: conflicts,
//! rollbacks and idle time are not modelled, they happen. What is modelled is what work costs, and
//! what data from another node costs.
//!
//! | file | what |
//! |---|---|
//! | [`probe`] | what workers tell of what they do |
//! | [`world`] | where data lies, which caches have it, which routers are in use |
//! | [`platform`] | the constants of a machine |
//! | [`course`] | what had been done when, and the steady state in the middle of a run |
//!
//! Deterministic: a run is a function of image, parameters and platform. Thread safety: a
//! simulation is the calling thread's; others may run their own, or the real thing. Not simulated:
//! the sampling of the image, which takes no virtual time (it runs on all threads of the pool);
//! contention for memory within a node; the operating system.

pub mod course;
pub mod platform;
pub mod probe;
pub mod world;

use crate::monitor::Monitor;
use crate::panics;
use crate::refine::options::RefineOptions;
use crate::refine::podm::{Refinement, refine_with};
use crate::refine::rules::Rules;
use crate::sync::virtual_time;
use crate::{Error, Result};
use course::{Mark, STEADY};
use platform::Platform;
use probe::SimProbe;
use world::{Tally, Traffic, World};

/// A simulated refinement.
#[derive(Debug)]
pub struct Simulated {
    /// What a real one returns. Its times are virtual.
    pub refinement: Refinement,
    /// Virtual seconds from the samples to the end.
    pub seconds: f64,
    /// The run's course: marks, each after some thousand tets were made, and one at the end.
    pub course: Vec<Mark>,
    /// Where each worker's data came from.
    pub traffic: Vec<Traffic>,
    /// Records that each router served, by level and group.
    pub served: Vec<Vec<u64>>,
    /// All work.
    pub tally: Tally,
}

/// Refines as [`refine`](crate::refine::refine) does, with `options.threads` workers on a
/// simulated platform: worker i on core i of the machine.
///
/// # Errors
/// Those of [`refine`](crate::refine::refine). [`Error::InvalidArgument`] when there are more
/// workers than cores; [`Error::OutOfMemory`] also when there is none for a stack.
pub fn simulate(
    rules: &Rules<'_>,
    options: &RefineOptions,
    platform: &Platform,
    monitor: &Monitor<'_>,
) -> Result<Simulated> {
    let (workers, cores) = (options.threads, platform.machine.total_cores());
    if workers > cores {
        return Err(Error::InvalidArgument(format!(
            "{workers} workers are simulated on a machine of {cores} cores"
        )));
    }
    probe::exchange(Some(World::new(platform, workers)));
    let ran = panics::catch(|| {
        virtual_time::run(|| {
            let refined = refine_with(rules, None, options, monitor, &SimProbe::new);
            (refined, virtual_time::now())
        })
    });
    let world = probe::exchange(None);
    let ran = ran.map_err(Error::Internal)?;
    let (refined, end) =
        ran.map_err(|_| Error::OutOfMemory { count: workers, what: "stacks of virtual workers" })?;
    let mut world =
        world.ok_or_else(|| Error::Internal("the world of a simulation was lost".into()))?;
    let refinement = refined?;
    let served = world.served();
    world.mark_end(end);
    let World { traffic, tally, mut course, .. } = world;
    course::add_timelines(&mut course, &refinement.threads);
    let seconds = end as f64 * virtual_time::SECONDS_PER_TICK;
    Ok(Simulated { refinement, seconds, course, traffic, served, tally })
}

impl Simulated {
    /// What had happened when that part of all tets had been made.
    pub fn mark_at(&self, part: f64) -> Mark {
        course::at(&self.course, part)
    }

    /// What happened in the steady state.
    pub fn steady(&self) -> Mark {
        let [from, to] = STEADY.map(|part| self.mark_at(part));
        to - from
    }
}

#[cfg(test)]
mod tests;
