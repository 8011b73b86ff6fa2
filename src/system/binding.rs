//! Threads bound to cores: the calling thread of a run and those that it starts, each to a core of
//! its own, until the run ends.
//!
//! On Linux by the calls for a thread's affinity (`sched_setaffinity`), through rustix, which the
//! library links for its temporary files anyway. hwloc would make the same calls; doing it directly
//! lets the default build bind, too, and keeps hwloc to what only it knows. On other systems
//! threads are not bound; asking for it is an error.
//!
//! **Within what the caller may use.** A thread is bound only to processors that the caller's
//! thread was allowed to use when the run began; its affinity comes back when [`Bound`] is dropped,
//! also when a panic does that. Threads that are started while their parent is bound inherit its
//! one core, so the run's own threads bind themselves first of all, and no others may be started
//! meanwhile.
//!
//! **Memory follows.** A page of memory lies on the node of the thread that touches it first; see
//! `delaunay::chunked`.
//!
//! Thread safety: a binding concerns the thread that makes it, and cannot be dropped by another.
//! Cost: two system calls for a thread.

use std::marker::PhantomData;

use crate::parallel::machine::Machine;
use crate::{Error, Result};

/// The places of a run's workers: for each core in the machine's order the processors that may be
/// used.
#[derive(Clone, Debug)]
pub struct CoreMap {
    cores: Vec<Vec<usize>>,
}

/// A thread that is bound, until this is dropped.
#[derive(Debug)]
pub struct Bound {
    before: affinity::Set,
    /// Not to be sent to another thread, whose affinity it would change.
    thread: PhantomData<*const ()>,
}

impl CoreMap {
    /// The cores of `machine`; those of the system where no system is behind it, as with synthetic
    /// machines.
    ///
    /// # Errors
    /// [`Error::Unsupported`] where threads cannot be bound, or the calling thread may use none of
    /// these cores.
    pub fn new(machine: &Machine) -> Result<Self> {
        let allowed = affinity::get()
            .map(|set| affinity::processors(&set))
            .map_err(|why| unsupported(&why))?;
        let usable = |machine: &Machine| -> Vec<Vec<usize>> {
            let cores = machine.all_cores().iter();
            let usable = |processor: &&usize| allowed.binary_search(processor).is_ok();
            let cores = cores
                .map(|core| core.processors.iter().filter(usable).copied().collect::<Vec<_>>());
            cores.filter(|processors| !processors.is_empty()).collect()
        };
        let real = machine.all_cores().iter().any(|core| !core.processors.is_empty());
        let cores = if real { usable(machine) } else { usable(&Machine::of_system()) };
        if cores.is_empty() {
            return Err(unsupported("the calling thread may use none of the machine's processors"));
        }
        Ok(Self { cores })
    }

    /// The processors of a worker's core: workers take the cores in order, those beyond the last
    /// begin anew at the first.
    pub fn of_worker(&self, worker: usize) -> &[usize] {
        &self.cores[worker % self.cores.len()]
    }

    /// Binds the calling thread to the core of a worker.
    ///
    /// # Errors
    /// [`Error::Unsupported`] where the system refuses, because the processors that the process may
    /// use have changed since.
    pub fn bind(&self, worker: usize) -> Result<Bound> {
        let before = affinity::get().map_err(|why| unsupported(&why))?;
        let processors = self.of_worker(worker);
        affinity::set(&affinity::of_processors(processors))
            .map_err(|why| unsupported(&format!("processors {processors:?}: {why}")))?;
        Ok(Bound { before, thread: PhantomData })
    }
}

impl Drop for Bound {
    fn drop(&mut self) {
        // If the process may no longer use any of these, the system has moved the thread where it
        // may run: that must stay.
        let _ = affinity::set(&self.before);
    }
}

/// The processors that the calling thread may use, ascending; `None` where the system does not
/// tell.
pub fn allowed() -> Option<Vec<usize>> {
    Some(affinity::processors(&affinity::get().ok()?))
}

fn unsupported(why: &str) -> Error {
    Error::Unsupported(format!("threads cannot be bound to cores: {why}"))
}

/// The affinity of the calling thread. A machine of more processors than the set has room for
/// (1024) refuses to tell it.
#[cfg(target_os = "linux")]
mod affinity {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

    pub type Set = CpuSet;

    pub fn get() -> Result<Set, String> {
        sched_getaffinity(None).map_err(|error| error.to_string())
    }

    pub fn set(set: &Set) -> Result<(), String> {
        sched_setaffinity(None, set).map_err(|error| error.to_string())
    }

    pub fn processors(set: &Set) -> Vec<usize> {
        (0..CpuSet::MAX_CPU).filter(|&processor| set.is_set(processor)).collect()
    }

    /// Of processors that are in some set.
    pub fn of_processors(processors: &[usize]) -> Set {
        let mut set = CpuSet::new();
        processors.iter().for_each(|&processor| set.set(processor));
        set
    }
}

#[cfg(not(target_os = "linux"))]
mod affinity {
    pub type Set = ();

    pub fn get() -> Result<Set, String> {
        Err("that is done on Linux only".into())
    }

    pub fn set((): &Set) -> Result<(), String> {
        get()
    }

    pub fn processors((): &Set) -> Vec<usize> {
        Vec::new()
    }

    pub fn of_processors(_: &[usize]) -> Set {}
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn threads_are_bound_in_order_and_freed() {
        let before = allowed().unwrap();
        let places = CoreMap::new(&Machine::of_system()).unwrap();
        for worker in 0..2 * before.len() + 1 {
            let bound = places.bind(worker).unwrap();
            assert_eq!(allowed().unwrap(), places.of_worker(worker));
            // What a bound thread starts is bound to the same core, until it binds itself.
            let theirs = std::thread::scope(|scope| {
                scope
                    .spawn(|| places.bind(worker + 1).map(|_bound| allowed().unwrap()).unwrap())
                    .join()
                    .unwrap()
            });
            assert_eq!(theirs, places.of_worker(worker + 1));
            drop(bound);
            assert_eq!(allowed().unwrap(), before);
        }
    }

    #[test]
    fn a_panic_frees_the_thread() {
        let before = allowed().unwrap();
        let places = CoreMap::new(&Machine::one_node(1)).unwrap();
        let panicked = crate::panics::catch(|| {
            let _bound = places.bind(0).unwrap();
            panic!("while bound");
        });
        assert!(panicked.is_err());
        assert_eq!(allowed().unwrap(), before);
    }

    /// A thread that may use one processor is bound to that one, whatever machine it was told of;
    /// and a synthetic machine has the system's places.
    #[test]
    fn the_callers_processors_are_all_that_is_used() {
        let whole = Machine::of_system();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let last = *allowed().unwrap().last().unwrap();
                affinity::set(&affinity::of_processors(&[last])).unwrap();
                assert_eq!(Machine::of_system().total_cores(), 1);
                for machine in [&whole, &Machine::uniform(2, 4)] {
                    let places = CoreMap::new(machine).unwrap();
                    assert_eq!(
                        (places.of_worker(0), places.of_worker(3)),
                        (&[last][..], &[last][..])
                    );
                }
                let elsewhere = Machine::of_cores(
                    vec![crate::parallel::machine::Core {
                        node: 0,
                        cache: 0,
                        package: 0,
                        processors: vec![last + 1],
                    }],
                    vec![vec![0]],
                );
                let error = CoreMap::new(&elsewhere.unwrap()).unwrap_err();
                assert!(error.to_string().contains("none of the machine's processors"), "{error}");
            });
        });
    }
}
