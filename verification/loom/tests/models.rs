//! Models of what workers do with each other: locks of vertices and rollback, contention, begging and the end, stopping, stretches. Loom runs each in every order of steps
//! with a bounded number of preemptions, and with every value that a load may see under the memory order that was asked for.
//!
//! # That they can fail
//! Each of these changes of the sources was made once, and a model failed:
//!
//! | change | model |
//! |---|---|
//! | `Owner::release` relaxed; `Owner::claim` relaxed; `claim` by a load and a store | `owners_exclude_each_other` |
//! | the vertices not read again when they are owned | `who_owns_the_vertices_of_a_tet_owns_the_tet`, `a_slot_that_was_freed_is_not_taken_for_a_tet` |
//! | `stop` relaxed | `who_waits_is_stopped_*` |
//! | Local: the look and the raising of the flag not under the locks of both; `open` not asked; followers not woken by `leave` | `local_*` |
//! | Global: the last one waits too; `leave` wakes nobody | `global_*` |
//! | a beggar taken off the count of the idle after its gift; that count or the word of the end relaxed; `ready` raised before the gift is in the slot; a wake forgotten | `begging_*` |
//! | `Stretches`: the longest stretch read twice | `stretches_*` |
//!
//! # What they cannot see
//! Three workers with few steps each, not sixteen with millions; at most so many preemptions; sequential consistency only by fences, a little stronger than it is; wakes that are
//! forgotten, and how long anything takes; the policies Random and Aggressive, which wait for nobody. Records of tets are a stand-in with the same order of accesses: `delaunay` itself is too
//! large. The meeting of a team is one counter in `refine/team.rs`, whose wait is that of `Waiters`.

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicU32, AtomicUsize, Ordering::*};
use loom::thread;

use lapd_loom::lock::{Claim, Owner, OwnerId};
use lapd_loom::parallel::begging::Begging;
use lapd_loom::parallel::contention::{Contention, Streak};
use lapd_loom::parallel::stretches::Stretches;
use lapd_loom::parallel::topology::Levels;
use lapd_loom::parallel::waiters::Waiters;
use lapd_loom::params::Contention as Policy;

/// Checks a model of `size` workers, the first of which is the model's own thread.
fn check<S: Send + Sync + 'static>(
    size: usize,
    shared: impl Fn() -> S + Send + Sync + 'static,
    worker: impl Fn(usize, &S) + Send + Sync + Copy + 'static,
    at_the_end: impl Fn(&S) + Send + Sync + 'static,
) {
    let mut builder = loom::model::Builder::new();
    // LOOM_MAX_PREEMPTIONS, if set, is another bound.
    builder.preemption_bound = builder.preemption_bound.or(Some(if size == 2 { 4 } else { 2 }));
    builder.check(move || {
        let shared = Arc::new(shared());
        let others: Vec<_> = (1..size)
            .map(|me| {
                let shared = shared.clone();
                thread::spawn(move || worker(me, &shared))
            })
            .collect();
        worker(0, &shared);
        others.into_iter().for_each(|other| other.join().unwrap());
        at_the_end(&shared);
    });
}

// ---- Locks of vertices ----

/// Claims vertices one after the other until one is refused; the claims that are to be given back, and whether there was no refusal.
fn claim<'a>(owners: impl IntoIterator<Item = &'a Owner>, me: usize) -> (Vec<&'a Owner>, bool) {
    let mut taken = Vec::new();
    for owner in owners {
        match owner.claim(me as OwnerId + 1) {
            Claim::Taken => taken.push(owner),
            Claim::Held => {}
            Claim::Refused(other) => {
                assert_ne!(usize::from(other), me + 1);
                return (taken, false);
            }
        }
    }
    (taken, true)
}

fn release(taken: Vec<&Owner>) {
    taken.into_iter().for_each(Owner::release);
}

/// What is written under ownership: a race on it is what the models look for.
#[derive(Default)]
struct Guarded(UnsafeCell<u32>);

// SAFETY: that nobody uses it while another one writes is what loom checks.
unsafe impl Sync for Guarded {}

impl Guarded {
    fn get(&self) -> u32 {
        // SAFETY: as above.
        self.0.with(|value| unsafe { *value })
    }

    fn set(&self, new: u32) {
        // SAFETY: as above.
        self.0.with_mut(|value| unsafe { *value = new });
    }
}

fn owners_exclude(size: usize) {
    struct Shared {
        owners: [Owner; 2],
        operations: Guarded,
        completed: AtomicU32,
    }
    check(
        size,
        || Shared { owners: Default::default(), operations: Guarded::default(), completed: AtomicU32::new(0) },
        |me, shared| {
            let [a, b] = &shared.owners;
            // In opposite orders, and one vertex twice.
            let (taken, complete) = claim(if me % 2 == 0 { [a, b, a] } else { [b, a, b] }, me);
            if complete {
                shared.operations.set(shared.operations.get() + 1);
                shared.completed.fetch_add(1, Relaxed);
            }
            release(taken);
        },
        |shared| {
            assert_eq!(shared.operations.get(), shared.completed.load(Relaxed));
            assert!(shared.owners.iter().all(|owner| !owner.is_owned()));
        },
    );
}

#[test]
fn owners_exclude_each_other() {
    owners_exclude(2);
    owners_exclude(3);
}

const NONE: u32 = u32::MAX;

/// A triangle in place of a tet: its neighbours share two of its three vertices, and of a new one all but the last are owned. Its order of accesses is that of `TetRecord`.
struct Record {
    vertices: [AtomicU32; 3],
    content: Guarded,
}

struct Mesh {
    owners: [Owner; 8],
    record: Record,
}

impl Mesh {
    fn new() -> Self {
        let mesh = Self {
            owners: Default::default(),
            record: Record { vertices: std::array::from_fn(|_| AtomicU32::new(0)), content: Guarded::default() },
        };
        mesh.fill([0, 1, 2]);
        mesh
    }

    fn vertices(&self) -> [u32; 3] {
        [0, 1, 2].map(|i: usize| self.record.vertices[i].load(Acquire))
    }

    fn fill(&self, vertices: [u32; 3]) {
        for (slot, v) in self.record.vertices.iter().zip(vertices) {
            slot.store(v, Release);
        }
        self.record.content.set(vertices.iter().sum());
    }

    fn claim(&self, vertices: &[u32], me: usize) -> (Vec<&Owner>, bool) {
        claim(vertices.iter().map(|&v| &self.owners[v as usize]), me)
    }

    /// The way in: what the kernel does with a tet that it knows from a note.
    fn come_in(&self, me: usize) {
        let vertices = self.vertices();
        if vertices[0] == NONE {
            return;
        }
        let (taken, complete) = self.claim(&vertices, me);
        if complete && self.vertices() == vertices {
            assert_eq!(self.record.content.get(), vertices.iter().sum());
            self.record.content.set(vertices.iter().sum());
        }
        release(taken);
    }
}

#[test]
fn who_owns_the_vertices_of_a_tet_owns_the_tet() {
    for size in [2, 3] {
        check(
            size,
            Mesh::new,
            |me, mesh| {
                if me > 0 {
                    return mesh.come_in(me);
                }
                let (taken, complete) = mesh.claim(&[0, 1, 2, 3], me);
                if complete {
                    // 4 is new.
                    mesh.fill([1, 3, 4]);
                }
                release(taken);
            },
            |mesh| assert!(mesh.owners.iter().all(|owner| !owner.is_owned())),
        );
    }
}

#[test]
fn a_slot_that_was_freed_is_not_taken_for_a_tet() {
    check(
        2,
        Mesh::new,
        |me, mesh| {
            if me > 0 {
                return mesh.come_in(me);
            }
            let (taken, complete) = mesh.claim(&[0, 1, 2], me);
            if complete {
                mesh.record.vertices[0].store(NONE, Relaxed);
            }
            release(taken);
            if complete {
                // The slot is this worker's now. It is used again elsewhere; 7 is new.
                let (taken, complete) = mesh.claim(&[5, 6], me);
                if complete {
                    mesh.fill([5, 6, 7]);
                }
                release(taken);
            }
        },
        |mesh| assert!(mesh.owners.iter().all(|owner| !owner.is_owned())),
    );
}

// ---- Contention ----

struct Managed {
    contention: Contention,
    waiters: Waiters,
}

impl Managed {
    fn new(policy: Policy, size: usize) -> Self {
        let waiters = Waiters::new(size);
        // All hear one bell, whoever registers them.
        (0..size).for_each(|who| waiters.register(who));
        Self { contention: Contention::new(policy, size), waiters }
    }

    /// A worker that meets others, makes some progress after each, and then has no work left. How often it waited.
    fn work(&self, me: usize, mets: &[usize]) -> usize {
        let mut streak = Streak::new(me);
        let mut waits = 0;
        for &met in mets {
            waits += usize::from(self.contention.after_conflict(me, met, &mut streak, &self.waiters));
            for _ in 0..2 {
                self.contention.after_success(me, &mut streak, &self.waiters);
            }
        }
        self.contention.leave(me, &self.waiters);
        waits
    }
}

/// That it ends is one thing that is checked: nobody waits for ever. The other: somebody waits, so that not all meet again at once.
fn all_meet(policy: Policy, size: usize, mets: fn(usize) -> &'static [usize]) {
    check(
        size,
        move || (Managed::new(policy, size), AtomicUsize::new(0)),
        move |me, (managed, waits)| {
            waits.fetch_add(managed.work(me, mets(me)), Relaxed);
        },
        move |(_, waits)| assert!(waits.load(Relaxed) > 0 || !(0..size).all(|me| mets(me).len() == 1)),
    );
}

const IN_A_CIRCLE: fn(usize) -> &'static [usize] = |me| [&[1], &[2], &[0]][me];
const EACH_OTHER: fn(usize) -> &'static [usize] = |me| [&[1], &[0]][me];
const TWICE: fn(usize) -> &'static [usize] = |me| [&[1, 1], &[0, 0]][me];
/// A chain whose last worker has no work.
const A_CHAIN: fn(usize) -> &'static [usize] = |me| [&[1][..], &[2], &[]][me];

#[test]
fn local_no_cycle_of_waits() {
    all_meet(Policy::Local, 2, EACH_OTHER);
    all_meet(Policy::Local, 2, TWICE);
    all_meet(Policy::Local, 3, IN_A_CIRCLE);
}

#[test]
fn local_nobody_waits_for_who_has_no_work() {
    all_meet(Policy::Local, 3, A_CHAIN);
}

#[test]
fn global_the_last_never_waits() {
    all_meet(Policy::Global, 2, EACH_OTHER);
    all_meet(Policy::Global, 2, TWICE);
    all_meet(Policy::Global, 3, IN_A_CIRCLE);
}

#[test]
fn global_who_leaves_wakes_the_first() {
    all_meet(Policy::Global, 3, A_CHAIN);
}

// ---- Begging, and the end ----

struct Team {
    managed: Managed,
    begging: Begging<usize>,
    done: AtomicUsize,
}

impl Team {
    fn new(policy: Policy, groups: &[Vec<usize>]) -> Self {
        Self {
            managed: Managed::new(policy, groups[0].len()),
            begging: Begging::new(Levels::new(groups)),
            done: AtomicUsize::new(0),
        }
    }

    /// A worker with some tasks, who meets another at its first, as `refine/refiner.rs` does it.
    fn work(&self, me: usize, mut tasks: usize, mut met: Option<usize>, all: usize) {
        let Managed { contention, waiters } = &self.managed;
        let mut streak = Streak::new(me);
        loop {
            while tasks > 0 {
                if self.begging.beggars(me).any()
                    && tasks > 1
                    && let Some(beggar) = self.begging.take_beggar(me)
                {
                    tasks -= 1;
                    self.begging.give(beggar, 1, waiters);
                }
                if let Some(met) = met.take() {
                    contention.after_conflict(me, met, &mut streak, waiters);
                }
                self.done.fetch_add(1, Relaxed);
                tasks -= 1;
                contention.after_success(me, &mut streak, waiters);
            }
            contention.leave(me, waiters);
            match self.begging.beg(me, waiters) {
                Some(gift) => tasks = gift,
                None => break,
            }
            contention.come_back(me);
        }
        // Who is told of the end sees all that was done.
        assert_eq!(self.done.load(Relaxed), all);
    }
}

#[test]
fn begging_ends_when_all_is_done() {
    let team = || Team::new(Policy::Aggressive, &[vec![0, 0]]);
    check(2, team, |me, team| team.work(me, [3, 0][me], None, 3), |_| {});
}

#[test]
fn begging_of_three() {
    let team = || Team::new(Policy::Aggressive, &[vec![0, 0, 0]]);
    check(3, team, |me, team| team.work(me, [2, 0, 0][me], None, 2), |_| {});
}

#[test]
fn begging_by_level() {
    let team = || Team::new(Policy::Aggressive, &[vec![0, 0, 1], vec![0, 0, 0]]);
    check(3, team, |me, team| team.work(me, [0, 0, 2][me], None, 2), |_| {});
}

#[test]
fn local_and_begging() {
    let team = || Team::new(Policy::Local, &[vec![0, 0]]);
    check(2, team, |me, team| team.work(me, [2, 0][me], [Some(1), Some(0)][me], 2), |_| {});
    check(2, team, |me, team| team.work(me, [1, 1][me], [Some(1), Some(0)][me], 2), |_| {});
}

#[test]
fn global_and_begging() {
    let team = || Team::new(Policy::Global, &[vec![0, 0]]);
    check(2, team, |me, team| team.work(me, [2, 0][me], [Some(1), Some(0)][me], 2), |_| {});
    check(2, team, |me, team| team.work(me, [1, 1][me], [Some(1), Some(0)][me], 2), |_| {});
}

/// Groups that stand apart: each worker has tasks, after the first of which it sends one to another group, as `refine/refiner.rs` hands demands over.
fn all_sent_is_done(groups: &'static [usize], tasks: &'static [usize], to: &'static [Option<usize>]) {
    struct Shared {
        begging: Begging<usize>,
        managed: Managed,
        done: AtomicUsize,
    }
    let all = tasks.iter().sum::<usize>() + to.iter().flatten().count();
    check(
        groups.len(),
        move || Shared {
            begging: Begging::new(Levels::apart(groups)),
            managed: Managed::new(Policy::Aggressive, groups.len()),
            done: AtomicUsize::new(0),
        },
        move |me, Shared { begging, managed: Managed { waiters, .. }, done }| {
            let (mut tasks, mut to) = (tasks[me], to[me]);
            loop {
                while tasks > 0 {
                    done.fetch_add(1, Relaxed);
                    tasks -= 1;
                    if let Some(to) = to.take() {
                        begging.send(to, 1, waiters);
                    }
                    tasks += begging.open_inbox(me).unwrap_or(0);
                }
                match begging.beg(me, waiters) {
                    Some(gift) => tasks = gift,
                    None => break,
                }
            }
            assert_eq!(done.load(Relaxed), all);
        },
        |_| {},
    );
}

#[test]
fn what_is_sent_to_one_that_begs_or_works_is_done() {
    all_sent_is_done(&[0, 1], &[1, 0], &[Some(1), None]);
    all_sent_is_done(&[0, 1], &[1, 1], &[Some(1), Some(0)]);
}

#[test]
fn what_is_sent_to_a_group_of_two_is_done_by_one() {
    all_sent_is_done(&[0, 1, 1], &[1, 0, 0], &[Some(1), None, None]);
}

// ---- Stopping ----

#[test]
fn who_waits_is_stopped_and_finds_the_reason() {
    struct Shared {
        team: Team,
        reason: Guarded,
    }
    for policy in [Policy::Local, Policy::Global] {
        check(
            3,
            move || Shared { team: Team::new(policy, &[vec![0, 0, 0]]), reason: Guarded::default() },
            |me, Shared { team, reason }| {
                let Managed { contention, waiters } = &team.managed;
                match me {
                    0 => {
                        // A panic: it neither leaves nor begs.
                        reason.set(1);
                        waiters.stop();
                        return;
                    }
                    1 => {
                        contention.after_conflict(me, 0, &mut Streak::new(me), waiters);
                    }
                    _ => {
                        contention.leave(me, waiters);
                        assert_eq!(team.begging.beg(me, waiters), None);
                        assert!(waiters.is_stopped());
                    }
                }
                if waiters.is_stopped() {
                    assert_eq!(reason.get(), 1);
                }
            },
            |_| {},
        );
    }
}

// ---- Stretches ----

/// Worker 0 has a stretch of its own, and helps with that of the last worker, whose end is long enough for that.
fn all_taken_once(size: usize, own: usize, long: usize) {
    let entries = own + long;
    struct Shared {
        stretches: Stretches,
        taken: Vec<AtomicUsize>,
    }
    check(
        size,
        move || Shared {
            stretches: {
                let others = std::iter::repeat_n(own..own, size - 2);
                let stretches = std::iter::once(0..own).chain(others).chain([own..entries]);
                Stretches::of_groups(stretches, vec![0; size])
            },
            // One count for each sixteen entries: every block begins and ends at such.
            taken: (0..entries.div_ceil(16)).map(|_| AtomicUsize::new(0)).collect(),
        },
        |me, Shared { stretches, taken }| {
            while let Some(range) = stretches.take(me) {
                for count in &taken[range.start / 16..range.end / 16] {
                    count.fetch_add(1, Relaxed);
                }
            }
            assert_eq!(stretches.take(me), None, "there was something left");
        },
        |shared| assert!(shared.stretches.is_taken() && shared.taken.iter().all(|count| count.load(Relaxed) == 1)),
    );
}

#[test]
fn stretches_of_two_are_taken_once() {
    all_taken_once(2, 32, 320);
}

#[test]
fn stretches_of_three_are_taken_once() {
    all_taken_once(3, 0, 320);
}
