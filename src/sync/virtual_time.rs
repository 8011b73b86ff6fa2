//! Virtual time: many workers on one thread, each with a clock of its own, run in the order of
//! their clocks.
//!
//! **How.** Every worker is a coroutine with a stack of its own. One runs at a time. What it does
//! costs no virtual time until it says so ([`advance`]); before it looks at, or changes, what
//! others see it [pauses](pause): if the clock of another worker is behind its own, that one runs
//! first. So all that workers do to each other happens in the order of virtual time, ties by their
//! numbers, whatever the machine underneath: the same run gives the same result always. A
//! discrete-event simulation, driven by the program itself (J. Misra, "Distributed discrete-event
//! simulation", ACM Computing Surveys 18, 1986, has the terms).
//!
//! **Who uses it.** This module's parent alone: where a thread would wait, wake, sleep or offer its
//! processor, the worker does so in virtual time. So the code above runs as it is. Outside of
//! [`run`] all of this is asleep.
//!
//! **Waiting.** A worker that waits looks again when it is woken, and every [`NAP`], as a thread
//! does. If all wait for longer than [`PATIENCE`] they wait for ever: that is a panic.
//!
//! **State** is that of the thread: simulations on several threads know nothing of each other.
//! Cost: a switch some tens of nanoseconds, two of them for each pause that lets another run.

use std::cell::{Cell, RefCell};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use corosensei::stack::DefaultStack;
use corosensei::{Coroutine, CoroutineResult, Yielder};

use super::Ticks;

/// Ticks of a nanosecond: a tick is a picosecond. 2^64 of them are 200 days.
pub const NANOSECOND: Ticks = 1000;
/// Seconds of a tick.
pub const SECONDS_PER_TICK: f64 = 1e-12;
const MICROSECOND: Ticks = 1000 * NANOSECOND;
/// Longest sleep of a worker that waits.
const NAP: Ticks = 1000 * MICROSECOND;
/// From being woken to looking again: a line of memory that comes from another core, and a branch.
const WAKING: Ticks = 200 * NANOSECOND;
/// From offering the processor to getting it back when nobody wants it.
const OFFER: Ticks = MICROSECOND;
/// Naps in sequence, for each worker, after which all are taken to wait for ever.
const PATIENCE: usize = 10_000;
/// Bytes of a worker's stack; what is not used is never touched.
const STACK: usize = 1 << 20;

type Turn = Yielder<(), ()>;

/// The number of a virtual worker: they are numbered as they are made.
pub type Number = usize;

/// One virtual worker.
struct Worker {
    /// `None` while it runs, and when it has ended.
    part: Option<Coroutine<(), (), (), DefaultStack>>,
    /// Where it gives up its turn; null before its first.
    turn: *const Turn,
    /// When it goes on; entries of the queue that say otherwise are out of date.
    due: Ticks,
    /// Since when it waits to be woken.
    waits_since: Option<Ticks>,
}

#[derive(Default)]
struct State {
    workers: Vec<Worker>,
    /// Who goes on when, the earliest first.
    queue: BinaryHeap<Reverse<(Ticks, Number)>>,
    /// Naps since anybody did anything else.
    naps: usize,
}

thread_local! {
    static RUNNING: Cell<bool> = const { Cell::new(false) };
    /// The worker that runs, and its clock.
    static ME: Cell<Number> = const { Cell::new(0) };
    static CLOCK: Cell<Ticks> = const { Cell::new(0) };
    /// Who goes on next, and when.
    static NEXT: Cell<(Ticks, Number)> = const { Cell::new((Ticks::MAX, Number::MAX)) };
    /// Never borrowed while workers take turns.
    static STATE: RefCell<State> = RefCell::default();
}

/// Whether the calling thread runs virtual workers.
#[inline]
pub fn is_running() -> bool {
    RUNNING.get()
}

/// The worker that runs; `None` outside of simulations.
pub fn current() -> Option<Number> {
    is_running().then(|| ME.get())
}

/// The clock of the worker that runs; it begins with 0.
#[inline]
pub fn now() -> Ticks {
    CLOCK.get()
}

/// Lets time pass for the worker that runs.
#[inline]
pub fn advance(ticks: Ticks) {
    CLOCK.set(CLOCK.get() + ticks);
}

/// Lets those run first whose clocks are behind.
#[inline]
pub fn pause() {
    if NEXT.get() < (CLOCK.get(), ME.get()) {
        STATE.with_borrow_mut(|state| state.naps = 0);
        give_turn(CLOCK.get());
    }
}

/// Goes on at `due`, after all who are due before.
fn give_turn(due: Ticks) {
    let me = ME.get();
    let turn = STATE.with_borrow_mut(|state| {
        state.workers[me].due = due;
        state.queue.push(Reverse((due, me)));
        state.workers[me].turn
    });
    // SAFETY: the pointer is that of the coroutine of the worker that runs, on whose stack this
    // call stands: its yielder lives as long. It was set when the coroutine began, before anything
    // else in it.
    unsafe { &*turn }.suspend(());
}

/// Waits until `done`.
pub fn wait_until(done: impl Fn() -> bool) {
    pause();
    let me = ME.get();
    while !done() {
        let nap = CLOCK.get() + NAP;
        STATE.with_borrow_mut(|state| state.workers[me].waits_since = Some(nap - NAP));
        give_turn(nap);
        let still = STATE.with_borrow_mut(|state| {
            // Who is woken does not wait any more.
            let still = state.workers[me].waits_since.take().is_some();
            state.naps = if still { state.naps + 1 } else { 0 };
            state.naps > PATIENCE * state.workers.len()
        });
        assert!(!still, "all virtual workers wait for ever");
    }
}

/// Lets worker `who` look again whether it still has to wait.
pub fn wake(who: Number) {
    STATE.with_borrow_mut(|state| {
        let worker = &mut state.workers[who];
        if let Some(since) = worker.waits_since.take() {
            let due = (CLOCK.get() + WAKING).max(since).min(worker.due);
            worker.due = due;
            state.queue.push(Reverse((due, who)));
            NEXT.set(NEXT.get().min((due, who)));
        }
    });
}

/// Offers the processor to others.
pub fn offer() {
    advance(OFFER);
    pause();
}

/// Sleeps.
pub fn sleep_micros(micros: u64) {
    advance(micros * MICROSECOND);
    pause();
}

/// Makes a worker, which begins now.
///
/// # Safety
/// What `part` borrows must stay until the worker has ended or was dropped by the end of the
/// simulation; workers are dropped in the opposite order of their making.
unsafe fn spawn(part: impl FnOnce()) -> io::Result<()> {
    let stack = DefaultStack::new(STACK)?;
    let body = move |turn: &Turn, ()| {
        STATE.with_borrow_mut(|state| state.workers[ME.get()].turn = turn);
        part();
    };
    // SAFETY: the caller's promise. The coroutine is never forgotten: it stands in the state until
    // it has ended, or is dropped.
    let part = unsafe { Coroutine::with_stack_unchecked(stack, body) };
    STATE.with_borrow_mut(|state| {
        let (due, me) = (CLOCK.get(), state.workers.len());
        state.workers.push(Worker {
            part: Some(part),
            turn: std::ptr::null(),
            due,
            waits_since: None,
        });
        state.queue.push(Reverse((due, me)));
        NEXT.set(NEXT.get().min((due, me)));
    });
    Ok(())
}

/// Runs `lead` as the first virtual worker, and all that it makes, until they have ended.
///
/// # Errors
/// When there is no memory for a stack.
///
/// # Panics
/// When a worker does; when all wait for ever; within another simulation of the thread.
pub fn run<T>(lead: impl FnOnce() -> T) -> io::Result<T> {
    assert!(!is_running(), "a simulation within a simulation");
    let mut result = None;
    let _end = End;
    RUNNING.set(true);
    // SAFETY: what it borrows, `result` and what `lead` does, outlives `_end`, which drops all
    // workers that have not ended.
    unsafe { spawn(|| result = Some(lead())) }?;
    while let Some((who, mut part)) = next_turn() {
        let done = part.resume(());
        if let CoroutineResult::Yield(()) = done {
            STATE.with_borrow_mut(|state| state.workers[who].part = Some(part));
        }
    }
    drop(_end);
    Ok(result.expect("all workers have ended"))
}

/// The worker that is due first.
fn next_turn() -> Option<(Number, Coroutine<(), (), (), DefaultStack>)> {
    STATE.with_borrow_mut(|state| {
        while let Some(Reverse((due, who))) = state.queue.pop() {
            let worker = &mut state.workers[who];
            if worker.due == due
                && let Some(part) = worker.part.take()
            {
                // Whatever else the queue has for it is out of date.
                worker.due = Ticks::MAX;
                ME.set(who);
                CLOCK.set(due);
                NEXT.set(
                    state.queue.peek().map_or((Ticks::MAX, Number::MAX), |&Reverse(next)| next),
                );
                return Some((who, part));
            }
        }
        None
    })
}

/// Ends a simulation of the thread, however it ends.
struct End;

impl Drop for End {
    fn drop(&mut self) {
        RUNNING.set(false);
        CLOCK.set(0);
        NEXT.set((Ticks::MAX, Number::MAX));
        // The last made first: it may use what belongs to those that made it. Outside of the
        // borrow: what it drops may be anything.
        while let Some(worker) = STATE.with_borrow_mut(|state| state.workers.pop()) {
            drop(worker);
        }
        STATE.take();
    }
}

/// Runs `lead` as the worker that runs, and each of `others` as one of its own, until all have
/// ended. `None` for a worker that could not be made; then `lacking` is called.
pub fn run_together<T>(
    lead: impl FnOnce() -> T,
    others: Vec<impl FnOnce() -> T>,
    lacking: impl FnOnce(),
) -> (T, Vec<Option<T>>) {
    let results: Vec<Cell<Option<T>>> = others.iter().map(|_| Cell::new(None)).collect();
    let (left, me) = (Cell::new(0), ME.get());
    let mut lacks = false;
    for (part, result) in others.into_iter().zip(&results) {
        let left = &left;
        let part = move || {
            result.set(Some(part()));
            left.set(left.get() - 1);
            wake(me);
        };
        // SAFETY: this function ends when all have ended, a panic included. It can only be unwound
        // before by the end of the simulation, which drops them first: they were made after the
        // worker on whose stack this call stands.
        match unsafe { spawn(part) } {
            Ok(()) => left.set(left.get() + 1),
            Err(_) => lacks = true,
        }
    }
    if lacks {
        lacking();
    }
    let lead = catch_unwind(AssertUnwindSafe(lead));
    // Not when it is the simulation that ends: then the others have been dropped.
    if is_running() {
        wait_until(|| left.get() == 0);
    }
    match lead {
        Ok(lead) => (lead, results.into_iter().map(Cell::into_inner).collect()),
        Err(panic) => resume_unwind(panic),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What happens when: the numbers of those who acted, and the time.
    type Log = RefCell<Vec<(Number, Ticks)>>;

    fn act(log: &Log, cost: Ticks) {
        pause();
        log.borrow_mut().push((ME.get(), now()));
        advance(cost);
    }

    #[test]
    fn workers_act_in_the_order_of_their_clocks() {
        let log = Log::default();
        run(|| {
            let worker = |cost: Ticks| {
                let log = &log;
                move || (0..3).for_each(|_| act(log, cost))
            };
            run_together(worker(7), vec![worker(3), worker(5)], || ());
        })
        .unwrap();
        let expected = [(0, 0), (1, 0), (2, 0), (1, 3), (2, 5), (1, 6), (0, 7), (2, 10), (0, 14)];
        assert_eq!(log.into_inner(), expected);
    }

    #[test]
    fn who_is_woken_goes_on_when_it_was_woken() {
        let (done, woken) = (Cell::new(false), Cell::new(0));
        run(|| {
            let waits = || {
                wait_until(|| done.get());
                woken.set(now());
            };
            let works = || {
                advance(5 * MICROSECOND);
                pause();
                done.set(true);
                wake(1);
            };
            run_together(works, vec![waits], || ());
        })
        .unwrap();
        assert_eq!(woken.get(), 5 * MICROSECOND + WAKING);
    }

    #[test]
    fn a_wake_that_is_forgotten_costs_a_nap() {
        let done = Cell::new(false);
        let looked = run(|| {
            let waits = || {
                wait_until(|| done.get());
                now()
            };
            let works = || {
                advance(MICROSECOND);
                pause();
                done.set(true);
                // Its end would wake the first.
                advance(2 * NAP);
                pause();
                now()
            };
            run_together(waits, vec![works], || ()).0
        });
        assert_eq!(looked.unwrap(), NAP);
    }

    #[test]
    fn a_panic_drops_all_workers() {
        let dropped = Cell::new(0);
        struct Count<'a>(&'a Cell<u32>);
        impl Drop for Count<'_> {
            fn drop(&mut self) {
                self.0.set(self.0.get() + 1);
            }
        }
        let panic = crate::panics::catch(|| {
            run(|| {
                let worker = |me: u64| {
                    let dropped = &dropped;
                    move || {
                        let _count = Count(dropped);
                        advance(me);
                        pause();
                        assert!(me != 1, "worker one");
                        wait_until(|| false);
                    }
                };
                run_together(worker(0), (1..4).map(worker).collect(), || ());
            })
        });
        assert!(panic.unwrap_err().contains("worker one"));
        assert_eq!(dropped.get(), 4);
        assert!(!is_running());
    }

    #[test]
    fn waiting_for_ever_is_noticed() {
        let panic = crate::panics::catch(|| run(|| wait_until(|| false)));
        assert!(panic.unwrap_err().contains("wait for ever"));
    }
}
