//! Contention managers: what a worker does after a conflict, when it has given up its operation and
//! owns nothing.
//!
//! **Why there is no livelock.** A worker that waits owns nothing, so conflicts are with workers
//! that run.
//! - *Local*. A worker waits for the one it met, unless that one waits itself. Suppose the workers
//!   that run met only each other for ever. Each conflict makes one of the two wait, unless the
//!   other has begun to wait meanwhile; so fewer and fewer run, and the last one meets nobody. It
//!   completes its operations, and wakes those who wait for it. *No cycle of waits*: a worker looks
//!   at the other's flag and raises its own under the locks of both. Of the members of a cycle, the
//!   one that raised its flag last would have seen the flag of the one that it waits for. So the
//!   chain of waits from any worker ends at one that runs; that one wakes its followers when it has
//!   completed an operation, or has no work left.
//! - *Global*. The same with one list; the last worker that runs never waits (counted under the
//!   list's lock).
//! - *Random*. Two workers that meet again and again sleep for times that differ sooner or later.
//!   Certain only in probability.
//! - *Aggressive*. None: workers go on with another element, which makes meeting again unlikely,
//!   not impossible. After some conflicts in sequence they offer their processor: with more workers
//!   than processors the one that they met may have lost its own while it owns tets, and would get
//!   it back only when their time is up. They offer it a random number of times, more the longer
//!   the sequence: two that own neighbouring tets refuse each other, and if they went on in step
//!   would do so again.
//!
//! The first two are the published Local-CM and Global-CM.

use std::collections::VecDeque;

use crossbeam_utils::CachePadded;

use super::parking::Parking;
use super::policy::Contention as Policy;
use crate::sync::{AtomicBool, AtomicUsize, Mutex, Ordering::*, lock};

/// Conflicts in sequence after which a worker sleeps, under the policy Random, or offers its
/// processor, under Aggressive.
const PATIENCE: u32 = 3;
/// Longest sleep after that many conflicts, as a power of two in microseconds; twice as long after
/// each more.
const SLEEP_LOG: u32 = 4;
/// Longest sleep at all, as such a power.
const MAX_SLEEP_LOG: u32 = 10;

/// Most offers of its processor after a conflict, under the policy Aggressive.
const MAX_OFFERS: u32 = 64;

/// What a worker remembers of its own conflicts.
#[derive(Debug)]
pub struct Streak {
    conflicts: u32,
    random: u64,
}

impl Streak {
    /// That of worker `me` in the beginning.
    pub fn new(me: usize) -> Self {
        Self { conflicts: 0, random: (me as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) }
    }

    /// The next pseudo-random number (G. Marsaglia, "Xorshift RNGs", 2003).
    fn next_random(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random
    }
}

/// The manager of a team.
#[derive(Debug)]
pub struct Contention {
    policy: Policy,
    /// Each on cache lines of its own: a worker asks for its followers after every operation.
    workers: Vec<CachePadded<Place>>,
    line: Mutex<Line>,
}

/// A worker as one that waits and is waited for.
#[derive(Debug)]
struct Place {
    waits: AtomicBool,
    followers: Mutex<Followers>,
    /// How many there are, to be inspected without the lock.
    following: AtomicUsize,
}

/// Who waits for a worker.
#[derive(Debug)]
struct Followers {
    /// Whether the worker has work: nobody waits for one that has none.
    open: bool,
    list: VecDeque<usize>,
}

/// Who waits, under the policy Global.
#[derive(Debug)]
struct Line {
    /// Workers that have work and do not wait.
    running: usize,
    list: VecDeque<usize>,
}

impl Contention {
    /// For `size` workers, all of which run.
    pub fn new(policy: Policy, size: usize) -> Self {
        let place = |_| {
            CachePadded::new(Place {
                waits: AtomicBool::new(false),
                followers: Mutex::new(Followers { open: true, list: VecDeque::new() }),
                following: AtomicUsize::new(0),
            })
        };
        let line = Mutex::new(Line { running: size, list: VecDeque::new() });
        Self { policy, workers: (0..size).map(place).collect(), line }
    }

    /// Worker `me` met worker `met`, and owns nothing any more. Returns whether it waited.
    pub fn after_conflict(
        &self,
        me: usize,
        met: usize,
        streak: &mut Streak,
        parking: &Parking,
    ) -> bool {
        streak.conflicts += 1;
        match self.policy {
            Policy::Local => self.follow(me, met, parking),
            Policy::Global => self.stand_in_line(me, parking),
            Policy::Random => {
                let too_many = streak.conflicts.checked_sub(PATIENCE);
                if let Some(more) = too_many {
                    let max = 1 << (SLEEP_LOG + more).min(MAX_SLEEP_LOG);
                    crate::sync::sleep_micros(1 + streak.next_random() % max);
                }
                too_many.is_some()
            }
            Policy::Aggressive => {
                if streak.conflicts >= PATIENCE {
                    let max = u64::from(streak.conflicts.min(MAX_OFFERS));
                    (0..=streak.next_random() % max).for_each(|_| crate::sync::yield_now());
                }
                false
            }
        }
    }

    fn follow(&self, me: usize, met: usize, parking: &Parking) -> bool {
        let own = &self.workers[me].waits;
        let other = &self.workers[met];
        let follows = {
            // The locks of both, the smaller number's first: of two who meet each other at once,
            // one comes first and waits.
            let _first = (me < met).then(|| lock(&self.workers[me].followers));
            let mut followers = lock(&other.followers);
            let _second = (me > met).then(|| lock(&self.workers[me].followers));
            let may = followers.open && !other.waits.load(Relaxed);
            if may {
                // Relaxed: raised under this worker's lock, looked at by others under the same. A
                // worker that wakes lowers it without; who looks too early does not wait.
                own.store(true, Relaxed);
                followers.list.push_back(me);
                other.following.store(followers.list.len(), Relaxed);
            }
            may
        };
        if follows {
            parking.wait(|| !own.load(Acquire));
        }
        follows
    }

    fn stand_in_line(&self, me: usize, parking: &Parking) -> bool {
        let own = &self.workers[me].waits;
        {
            let mut line = lock(&self.line);
            if line.running == 1 {
                return false;
            }
            line.running -= 1;
            line.list.push_back(me);
            own.store(true, Relaxed);
        }
        parking.wait(|| !own.load(Acquire));
        true
    }

    /// Worker `me` completed an operation.
    #[inline]
    pub fn after_success(&self, me: usize, streak: &mut Streak, parking: &Parking) {
        streak.conflicts = 0;
        match self.policy {
            // Relaxed: who comes too late to be seen is seen after the next operations, or when
            // this worker has none left.
            Policy::Local if self.workers[me].following.load(Relaxed) == 0 => {}
            Policy::Local => self.wake_followers(me, parking),
            Policy::Global => self.wake_first(parking),
            Policy::Random | Policy::Aggressive => {}
        }
    }

    /// Wakes all: what they needed has been given back. One at a time they would wait for
    /// operations elsewhere, and those who wait for them as well.
    #[cold]
    fn wake_followers(&self, me: usize, parking: &Parking) {
        let own = &self.workers[me];
        let list = {
            let mut followers = lock(&own.followers);
            own.following.store(0, Relaxed);
            std::mem::take(&mut followers.list)
        };
        list.into_iter().for_each(|follower| self.wake(follower, parking));
    }

    fn wake_first(&self, parking: &Parking) {
        let first = {
            let mut line = lock(&self.line);
            let first = line.list.pop_front();
            line.running += usize::from(first.is_some());
            first
        };
        if let Some(first) = first {
            self.wake(first, parking);
        }
    }

    fn wake(&self, who: usize, parking: &Parking) {
        self.workers[who].waits.store(false, Release);
        parking.wake(who);
    }

    /// Worker `me` has no work left: nobody is to wait for it.
    pub fn leave(&self, me: usize, parking: &Parking) {
        match self.policy {
            Policy::Local => {
                let list = {
                    let mut followers = lock(&self.workers[me].followers);
                    followers.open = false;
                    self.workers[me].following.store(0, Relaxed);
                    std::mem::take(&mut followers.list)
                };
                list.into_iter().for_each(|follower| self.wake(follower, parking));
            }
            Policy::Global => {
                lock(&self.line).running -= 1;
                self.wake_first(parking);
            }
            Policy::Random | Policy::Aggressive => {}
        }
    }

    /// Worker `me`, which had left, has work again.
    pub fn come_back(&self, me: usize) {
        match self.policy {
            Policy::Local => lock(&self.workers[me].followers).open = true,
            Policy::Global => lock(&self.line).running += 1,
            Policy::Random | Policy::Aggressive => {}
        }
    }
}
