//! Models of what workers do with each other: locks of tets and rollback, contention, begging and
//! the end, stopping, ranges. Loom runs each in every order of steps with a bounded number of
//! preemptions, and with every value that a load may see under the memory order that was asked for.
//!
//! # That they can fail
//! Each of these changes of the sources was made once, and a model failed:
//!
//! | change | model |
//! |---|---|
//! | `Owner::release` relaxed | `neighbors_exclude_each_other`, and two more |
//! | `Owner::look` relaxed, or an acquire alone, or left out | the same |
//! | the link not read again; a slot's new owner written after the link to it | the same |
//! | a free slot nobody's; `claim` by a load and a store | `an_old_note_of_a_slot_does_no_harm` |
//! | `Owner::free_slot`, a refused `claim` relaxed | `a_vertex_leads_from_a_free_slot_elsewhere` |
//! | `stop` relaxed | `who_waits_is_stopped_*` |
//! | Local: the look and the raising of the flag not under the locks of both | `local_*` |
//! | Local: `open` not asked; followers not woken by `leave` | `local_*` |
//! | Global: the last one waits too; `leave` wakes nobody | `global_*` |
//! | a beggar taken off the count of the idle after its gift | `begging_*` |
//! | that count or the word of the end relaxed | `begging_*` |
//! | `ready` raised before the gift is in the slot; a wake forgotten | `begging_*` |
//! | `WorkRanges`: the longest range read twice | `work_ranges_*` |
//!
//! # What they cannot see
//! Three workers with few steps each, not sixteen with millions; at most so many preemptions;
//! sequential consistency only by fences, which hide that of the exchange, and what a link may be
//! that was read before it; wakes that are forgotten, and how long anything takes; the policies
//! Random and Aggressive, which wait for nobody. Records of tets are a stand-in with the same order
//! of accesses: `delaunay` itself is too large. The meeting of a team is one counter in
//! `refine/team.rs`, whose wait is that of `Parking`.

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicU32, AtomicUsize, Ordering::*};
use loom::thread;

use lapd_loom::ownership::{Claim, FREE, Holder, NOBODY, Owner, OwnerId};
use lapd_loom::parallel::begging::Begging;
use lapd_loom::parallel::contention::{Contention, Streak};
use lapd_loom::parallel::parking::Parking;
use lapd_loom::parallel::policy::Contention as Policy;
use lapd_loom::parallel::topology::Levels;
use lapd_loom::parallel::work_ranges::WorkRanges;

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

// ---- Locks of tets ----

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

/// The record of a piece of a ring, in place of a tet: side 0 leads to the piece before it, side 1
/// to the one behind it. Links and owners are accessed in the order in which the kernel accesses
/// those of tets.
#[derive(Default)]
struct Piece {
    links: [AtomicU32; 2],
    owner: Owner,
    /// In place of the sphere.
    content: Guarded,
}

const SLOTS: usize = 6;

/// A ring of pieces, which operations divide and join.
struct Ring {
    pieces: [Piece; SLOTS],
    /// A piece, in place of the star of a vertex that all have.
    hint: AtomicU32,
}

/// The content of a slot that was never used.
const FRESH: u32 = 2;

/// Side `side` of a piece, in place of a facet.
fn side_of(slot: usize, side: usize) -> u32 {
    (slot * 2 + side) as u32
}

impl Ring {
    /// Of so many pieces, in the first slots; the others were never used. The hint leads to slot 1.
    fn new(size: usize) -> Self {
        let ring = Self { pieces: Default::default(), hint: AtomicU32::new(1) };
        for (slot, piece) in ring.pieces.iter().enumerate() {
            piece.content.set(if slot < size { 1 } else { FRESH });
        }
        (0..size).for_each(|slot| ring.join([slot, (slot + 1) % size]));
        ring
    }

    /// Makes two pieces neighbours.
    fn join(&self, [before, behind]: [usize; 2]) {
        self.pieces[before].links[1].store(side_of(behind, 0), Release);
        self.pieces[behind].links[0].store(side_of(before, 1), Release);
    }

    /// The owned piece `slot` is looked across; the piece there, if nobody owns it.
    fn inspect_across(&self, slot: usize, side: usize, me: OwnerId) -> Option<usize> {
        let link = self.pieces[slot].links[side].load(Acquire);
        let other = link as usize / 2;
        if self.pieces[other].owner.inspect(me) != Holder::Unowned
            || self.pieces[slot].links[side].load(Acquire) != link
        {
            return None;
        }
        assert_ne!(self.pieces[other].content.get(), 0);
        Some(other)
    }

    fn claim(&self, slot: usize, me: OwnerId) -> bool {
        self.pieces[slot].owner.claim(me) == Claim::Acquired
    }

    fn release(&self, slot: usize) {
        self.pieces[slot].owner.release();
    }

    /// Divides the piece in `slot`, which may not be one any more, into one there and one in the
    /// free slot `spare`; whether it did.
    fn divide(&self, slot: usize, spare: usize, me: OwnerId) -> bool {
        if !self.claim(slot, me) {
            return false;
        }
        let around = (self.inspect_across(slot, 0, me), self.inspect_across(slot, 1, me));
        let (Some(before), Some(behind)) = around else {
            self.release(slot);
            return false;
        };
        assert_ne!(self.pieces[slot].content.get(), 0);
        self.pieces[slot].content.set(0);
        self.pieces[spare].owner.set(me);
        self.pieces[spare].content.set(0);
        self.join([before, spare]);
        self.join([spare, slot]);
        self.join([slot, behind]);
        self.hint.store(slot as u32, Release);
        self.pieces[slot].content.set(1);
        self.pieces[spare].content.set(1);
        self.release(slot);
        self.release(spare);
        true
    }

    /// Joins the piece in `slot` with the one behind it, whose slot is free then, and returned.
    fn unite(&self, slot: usize, me: OwnerId) -> Option<usize> {
        if !self.claim(slot, me) {
            return None;
        }
        let around = (self.inspect_across(slot, 0, me), self.inspect_across(slot, 1, me));
        let (Some(before), Some(gone)) = around else {
            self.release(slot);
            return None;
        };
        if !self.claim(gone, me) {
            self.release(slot);
            return None;
        }
        let Some(behind) = self.inspect_across(gone, 1, me) else {
            self.release(slot);
            self.release(gone);
            return None;
        };
        self.pieces[gone].content.set(0);
        self.pieces[slot].content.set(0);
        self.join([before, slot]);
        self.join([slot, behind]);
        self.hint.store(slot as u32, Release);
        self.pieces[slot].content.set(1);
        self.release(slot);
        self.pieces[gone].owner.free_slot();
        Some(gone)
    }

    /// Every piece is nobody's and its neighbours' neighbour; every other slot is free.
    fn check(&self) {
        let mut size = 0;
        for (slot, piece) in self.pieces.iter().enumerate() {
            if piece.owner.is(FREE) || piece.content.get() == FRESH {
                continue;
            }
            assert!(piece.owner.is(NOBODY));
            assert_eq!(piece.content.get(), 1);
            size += 1;
            for (side, link) in piece.links.iter().enumerate() {
                let link = link.load(Relaxed);
                let back = self.pieces[link as usize / 2].links[link as usize % 2].load(Relaxed);
                assert_eq!((back, link % 2), (side_of(slot, side), 1 - side as u32));
            }
        }
        let start = self.hint.load(Relaxed) as usize;
        let mut at = start;
        for left in (0..size).rev() {
            assert!(self.pieces[at].owner.is(NOBODY));
            at = self.pieces[at].links[1].load(Relaxed) as usize / 2;
            assert_eq!(at == start, left == 0);
        }
    }
}

fn name(me: usize) -> OwnerId {
    me as OwnerId + 1
}

#[test]
fn neighbors_exclude_each_other() {
    for size in [2, 3] {
        check(
            size,
            || Ring::new(3),
            // Each divides a piece; all pieces are neighbours.
            |me, ring| {
                ring.divide(me, 3 + me, name(me));
            },
            Ring::check,
        );
    }
}
/// One worker frees slot 1 and uses it again elsewhere; the other one divides the piece in `slot`.
fn beside_a_slot_that_is_used_again(slot: usize) {
    check(
        2,
        || Ring::new(4),
        move |me, ring| {
            let me = name(me);
            if me > 1 {
                ring.divide(slot, 4, me);
            } else if let Some(free) = ring.unite(0, me) {
                ring.divide(3, free, me);
            }
        },
        Ring::check,
    );
}

#[test]
fn a_slot_that_was_used_again_is_not_taken_for_a_neighbor() {
    // Before this piece lies slot 1, then slot 0; slot 1 comes to lie behind it.
    beside_a_slot_that_is_used_again(2);
}

#[test]
fn an_old_note_of_a_slot_does_no_harm() {
    beside_a_slot_that_is_used_again(1);
}

#[test]
fn a_vertex_leads_from_a_free_slot_elsewhere() {
    check(
        2,
        || Ring::new(4),
        |me, ring| {
            let me = name(me);
            if me == 1 {
                ring.unite(0, me);
                return;
            }
            let star = ring.hint.load(Acquire);
            match ring.pieces[star as usize].owner.claim(me) {
                Claim::Acquired => ring.release(star as usize),
                Claim::Stale => assert_ne!(ring.hint.load(Acquire), star),
                Claim::Owned | Claim::Conflict(_) => {}
            }
        },
        Ring::check,
    );
}

// ---- Contention ----

struct Managed {
    contention: Contention,
    parking: Parking,
}

impl Managed {
    fn new(policy: Policy, size: usize) -> Self {
        let parking = Parking::new(size);
        // All hear one bell, whoever registers them.
        (0..size).for_each(|who| parking.register(who));
        Self { contention: Contention::new(policy, size), parking }
    }

    /// A worker that meets others, makes some progress after each, and then has no work left. How
    /// often it waited.
    fn work(&self, me: usize, mets: &[usize]) -> usize {
        let mut streak = Streak::new(me);
        let mut waits = 0;
        for &met in mets {
            waits +=
                usize::from(self.contention.after_conflict(me, met, &mut streak, &self.parking));
            for _ in 0..2 {
                self.contention.after_success(me, &mut streak, &self.parking);
            }
        }
        self.contention.leave(me, &self.parking);
        waits
    }
}

/// That it ends is one thing that is checked: nobody waits for ever. The other: somebody waits, so
/// that not all meet again at once.
fn all_meet(policy: Policy, size: usize, mets: fn(usize) -> &'static [usize]) {
    check(
        size,
        move || (Managed::new(policy, size), AtomicUsize::new(0)),
        move |me, (managed, waits)| {
            waits.fetch_add(managed.work(me, mets(me)), Relaxed);
        },
        move |(_, waits)| {
            assert!(waits.load(Relaxed) > 0 || !(0..size).all(|me| mets(me).len() == 1))
        },
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
        let Managed { contention, parking } = &self.managed;
        let mut streak = Streak::new(me);
        loop {
            while tasks > 0 {
                if self.begging.beggars(me).any()
                    && tasks > 1
                    && let Some(beggar) = self.begging.take_beggar(me)
                {
                    tasks -= 1;
                    self.begging.give(beggar, 1, parking);
                }
                if let Some(met) = met.take() {
                    contention.after_conflict(me, met, &mut streak, parking);
                }
                self.done.fetch_add(1, Relaxed);
                tasks -= 1;
                contention.after_success(me, &mut streak, parking);
            }
            contention.leave(me, parking);
            match self.begging.beg(me, parking) {
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

/// Groups that stand apart: each worker has tasks, after the first of which it sends one to another
/// group, as `refine/refiner.rs` hands demands over.
fn all_sent_is_done(
    groups: &'static [usize],
    tasks: &'static [usize],
    to: &'static [Option<usize>],
) {
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
        move |me, Shared { begging, managed: Managed { parking, .. }, done }| {
            let (mut tasks, mut to) = (tasks[me], to[me]);
            loop {
                while tasks > 0 {
                    done.fetch_add(1, Relaxed);
                    tasks -= 1;
                    if let Some(to) = to.take() {
                        begging.send(to, 1, parking);
                    }
                    tasks += begging.open_inbox(me).unwrap_or(0);
                }
                match begging.beg(me, parking) {
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
            move || Shared {
                team: Team::new(policy, &[vec![0, 0, 0]]),
                reason: Guarded::default(),
            },
            |me, Shared { team, reason }| {
                let Managed { contention, parking } = &team.managed;
                match me {
                    0 => {
                        // A panic: it neither leaves nor begs.
                        reason.set(1);
                        parking.stop();
                        return;
                    }
                    1 => {
                        contention.after_conflict(me, 0, &mut Streak::new(me), parking);
                    }
                    _ => {
                        contention.leave(me, parking);
                        assert_eq!(team.begging.beg(me, parking), None);
                        assert!(parking.is_stopped());
                    }
                }
                if parking.is_stopped() {
                    assert_eq!(reason.get(), 1);
                }
            },
            |_| {},
        );
    }
}

// ---- WorkRanges ----

/// Worker 0 has a range of its own, and helps with that of the last worker, whose end is long
/// enough for that.
fn all_taken_once(size: usize, own: usize, long: usize) {
    let entries = own + long;
    struct Shared {
        work_ranges: WorkRanges,
        taken: Vec<AtomicUsize>,
    }
    check(
        size,
        move || Shared {
            work_ranges: {
                let others = std::iter::repeat_n(own..own, size - 2);
                let work_ranges = std::iter::once(0..own).chain(others).chain([own..entries]);
                WorkRanges::of_groups(work_ranges, vec![0; size])
            },
            // One count for each sixteen entries: every block begins and ends at such.
            taken: (0..entries.div_ceil(16)).map(|_| AtomicUsize::new(0)).collect(),
        },
        |me, Shared { work_ranges, taken }| {
            while let Some(range) = work_ranges.take(me) {
                for count in &taken[range.start / 16..range.end / 16] {
                    count.fetch_add(1, Relaxed);
                }
            }
            assert_eq!(work_ranges.take(me), None, "there was something left");
        },
        |shared| {
            assert!(
                shared.work_ranges.is_taken()
                    && shared.taken.iter().all(|count| count.load(Relaxed) == 1)
            )
        },
    );
}

#[test]
fn work_ranges_of_two_are_taken_once() {
    all_taken_once(2, 32, 320);
}

#[test]
fn work_ranges_of_three_are_taken_once() {
    all_taken_once(3, 0, 320);
}
