//! Begging lists: workers without work wait in them, and workers with more than they need give to
//! the nearest.
//!
//! There is a list for every group of workers at every level: those that share a cache, those of a
//! socket, all. A worker begs in its lowest list, unless all others of that group beg already: the
//! last of a group begs one level higher, so that work comes in from outside when a group has none
//! (hierarchical work stealing; Foteinos and Chrisochoides 2014). To the list of a group of groups
//! each of these sends its last, so that the last of them goes on to the next level. With one level
//! there is one list for all.
//!
//! Where groups stand apart (`Levels::apart`), nobody gives to a beggar of another group. What a
//! worker comes to that is another group's by right it may send there: to a beggar of that group,
//! or, when all of it have work, into its inbox, into which each looks now and then, and before it
//! begs.
//!
//! **The end.** A worker that begins to beg is counted idle. A giver takes it off the count before
//! it gives, and is not idle itself. So while a gift is on its way the count is below the number of
//! workers; when it reaches that number, nobody has work and none is under way. No lock is needed
//! to notice, and the worker that completes the count is the one that notices. An inbox with
//! something in it belongs to a group of which one is not idle: a worker becomes idle under the
//! lock of its group's inbox, when that is empty, and something is put in under the same lock, when
//! no worker of the group is in its list. So inboxes are empty in the end.
//!
//! **No gift is lost.** A beggar leaves its list only by the hand of a giver, which then puts the
//! gift into the beggar's own slot.

use crossbeam_utils::CachePadded;

use super::parking::Parking;
use super::topology::Levels;
use crate::sync::{AtomicBool, AtomicUsize, Mutex, Ordering::*, lock};

/// The lists of a team; `G` is what is given.
#[derive(Debug)]
pub struct Begging<G> {
    levels: Levels,
    /// By level and group.
    lists: Vec<Vec<Mutex<Vec<usize>>>>,
    /// Of the groups, where they stand apart.
    inboxes: Vec<Inbox<G>>,
    slots: Vec<Slot<G>>,
    /// Workers in lists, for each group of the highest level; may be out of date.
    /// On cache lines of their own: workers of a group ask with every step.
    beggars: Vec<CachePadded<AtomicUsize>>,
    idle: AtomicUsize,
    over: AtomicBool,
}

/// What was sent to a group while all of it had work.
#[derive(Debug)]
struct Inbox<G> {
    gifts: Mutex<Vec<G>>,
    /// How many there are, to be inspected without the lock.
    count: AtomicUsize,
}

impl<G> Inbox<G> {
    fn open(&self, gifts: &mut Vec<G>) -> Option<G> {
        let gift = gifts.pop();
        self.count.store(gifts.len(), Relaxed);
        gift
    }
}

#[derive(Debug)]
struct Slot<G> {
    gift: Mutex<Option<G>>,
    ready: AtomicBool,
}

/// The beggars of a group, of whom its workers ask with every step: one load, and no way through
/// lists to it.
#[derive(Clone, Copy)]
pub struct Beggars<'b>(&'b AtomicUsize);

impl Beggars<'_> {
    /// Whether there seem to be some.
    #[inline(always)]
    pub fn any(self) -> bool {
        // Relaxed: a hint; the lists are inspected under their locks.
        self.0.load(Relaxed) != 0
    }
}

impl<G> Begging<G> {
    /// For the workers of `levels`, all of which have work.
    pub fn new(levels: Levels) -> Self {
        let lists = (0..levels.count())
            .map(|level| (0..levels.groups(level)).map(|_| Mutex::new(Vec::new())).collect())
            .collect();
        let top = levels.groups(levels.count() - 1);
        let inbox = |_| Inbox { gifts: Mutex::new(Vec::new()), count: AtomicUsize::new(0) };
        let inboxes = (0..if top > 1 { top } else { 0 }).map(inbox).collect();
        let slot = |_| Slot { gift: Mutex::new(None), ready: AtomicBool::new(false) };
        Self {
            lists,
            inboxes,
            slots: (0..levels.workers()).map(slot).collect(),
            beggars: (0..top).map(|_| CachePadded::default()).collect(),
            levels,
            idle: AtomicUsize::new(0),
            over: AtomicBool::new(false),
        }
    }

    /// Worker `me` has no work: waits for some. `None`: nobody has any, or all waits are ended.
    pub fn beg(&self, me: usize, parking: &Parking) -> Option<G> {
        {
            let inbox = self.inboxes.get(self.top_of(me));
            let mut gifts = inbox.map(|inbox| lock(&inbox.gifts));
            if let Some((inbox, gifts)) = inbox.zip(gifts.as_mut())
                && let sent @ Some(_) = inbox.open(gifts)
            {
                return sent;
            }
            // Release: who sees all idle sees what all have done. Acquire: the same for this
            // worker.
            if self.idle.fetch_add(1, AcqRel) + 1 == self.slots.len() {
                self.over.store(true, Release);
                parking.wake_all();
                return None;
            }
            self.join(me);
        }
        let slot = &self.slots[me];
        parking.wait(|| slot.ready.load(Acquire) || self.over.load(Acquire));
        if slot.ready.swap(false, AcqRel) { lock(&slot.gift).take() } else { None }
    }

    fn join(&self, me: usize) {
        // Counted first: a giver that looks too early finds nobody, one that looks too late would
        // never look.
        self.beggars_of(me).fetch_add(1, Relaxed);
        let top = self.lists.len() - 1;
        for (level, lists) in self.lists.iter().enumerate() {
            let group = self.levels.group(level, me);
            let mut list = lock(&lists[group]);
            if level == top || list.len() + 1 < self.levels.max_beggars(level, group) {
                list.push(me);
                return;
            }
        }
    }

    #[inline]
    fn top_of(&self, me: usize) -> usize {
        self.levels.group(self.levels.count() - 1, me)
    }

    #[inline]
    fn beggars_of(&self, me: usize) -> &AtomicUsize {
        &self.beggars[self.top_of(me)]
    }

    /// The beggars to whom worker `me` may give.
    pub fn beggars(&self, me: usize) -> Beggars<'_> {
        Beggars(self.beggars_of(me))
    }

    /// The beggar nearest to worker `me`, to whom it must [give](Self::give).
    pub fn take_beggar(&self, me: usize) -> Option<usize> {
        let beggar = self.lists.iter().enumerate().find_map(|(level, lists)| {
            // First come, first served.
            let mut list = lock(&lists[self.levels.group(level, me)]);
            (!list.is_empty()).then(|| list.remove(0))
        })?;
        self.beggars_of(me).fetch_sub(1, Relaxed);
        // Before the gift: the beggar counts as one with work from now on. This worker has some, so
        // the count was below the number of workers.
        self.idle.fetch_sub(1, AcqRel);
        Some(beggar)
    }

    /// What was sent to the group of worker `me`, if anything, while it has work.
    pub fn open_inbox(&self, me: usize) -> Option<G> {
        let inbox = self.inboxes.get(self.top_of(me))?;
        // Relaxed: who looks too early looks again.
        if inbox.count.load(Relaxed) == 0 { None } else { inbox.open(&mut lock(&inbox.gifts)) }
    }

    /// A worker sends something to the group of worker `to`, another one than its own, of groups
    /// that stand apart.
    pub fn send(&self, to: usize, gift: G, parking: &Parking) {
        let inbox = &self.inboxes[self.top_of(to)];
        let mut gifts = lock(&inbox.gifts);
        match self.take_beggar(to) {
            Some(beggar) => {
                drop(gifts);
                self.give(beggar, gift, parking);
            }
            None => {
                gifts.push(gift);
                inbox.count.store(gifts.len(), Relaxed);
            }
        }
    }

    /// Gives to a beggar that was taken.
    pub fn give(&self, beggar: usize, gift: G, parking: &Parking) {
        let slot = &self.slots[beggar];
        *lock(&slot.gift) = Some(gift);
        slot.ready.store(true, Release);
        parking.wake(beggar);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU64;

    /// Two sockets of two caches of two processors.
    fn two_sockets() -> Levels {
        let names = |size: usize| (0..8).map(|worker| worker / size).collect();
        Levels::new(&[names(2), names(4), names(8)])
    }

    #[test]
    fn a_socket_without_work_begs_at_the_others() {
        let begging = Begging::<()>::new(two_sockets());
        (0..4).for_each(|me| begging.join(me));
        // One in the list of each cache, one in that of the socket, one in that of the machine.
        assert_eq!(begging.take_beggar(7), Some(3));
        assert_eq!(begging.take_beggar(7), None);
        assert_eq!(begging.take_beggar(3), Some(2));
        assert_eq!(begging.take_beggar(3), Some(1));
        assert_eq!(begging.take_beggar(1), Some(0));
    }

    #[test]
    fn groups_that_stand_apart_give_nothing_to_each_other() {
        let (begging, parking) =
            (Begging::<()>::new(Levels::apart(&[0, 1, 0, 1])), Parking::new(4));
        begging.join(0);
        assert_eq!([0, 1, 2, 3].map(|me| begging.beggars(me).any()), [true, false, true, false]);
        assert_eq!(begging.take_beggar(3), None);
        assert_eq!(begging.take_beggar(2), Some(0));
        // All groups without work: the end.
        let begging = Begging::<()>::new(Levels::apart(&[0, 1, 0, 1]));
        let ended = std::thread::scope(|scope| {
            let (begging, parking) = (&begging, &parking);
            let workers = [0, 1, 2, 3].map(|me| scope.spawn(move || begging.beg(me, parking)));
            workers.map(|worker| worker.join().unwrap())
        });
        assert_eq!(ended, [None; 4]);
    }

    /// As below, with groups that stand apart, and work that is the other group's half of the time.
    #[test]
    fn what_is_sent_is_done_before_the_end() {
        const SIZE: u32 = 14;
        let (begging, parking) =
            (Begging::<Vec<u32>>::new(Levels::apart(&[0, 1, 0, 1])), Parking::new(4));
        let done = AtomicU64::new(0);
        std::thread::scope(|scope| {
            for me in 0..4 {
                let (begging, parking, done) = (&begging, &parking, &done);
                scope.spawn(move || {
                    parking.register(me);
                    let mut tasks = if me == 0 { vec![SIZE] } else { Vec::new() };
                    loop {
                        while let Some(task) = tasks.pop() {
                            done.fetch_add(1, Relaxed);
                            let theirs = (0..task).filter(|task| task % 2 == 1).collect::<Vec<_>>();
                            tasks.extend((0..task).filter(|task| task % 2 == 0));
                            if !theirs.is_empty() {
                                begging.send((me + 1) % 4, theirs, parking);
                            }
                            tasks.extend(begging.open_inbox(me).into_iter().flatten());
                        }
                        let Some(gift) = begging.beg(me, parking) else { return };
                        tasks = gift;
                    }
                });
            }
        });
        assert_eq!(done.into_inner(), 1 << SIZE);
    }

    /// Work that makes work: a task of size n makes one of each size below n.
    #[test]
    fn all_work_is_done_before_the_end() {
        const SIZE: u32 = 14;
        let (begging, parking) = (Begging::<Vec<u32>>::new(two_sockets()), Parking::new(8));
        let done = AtomicU64::new(0);
        std::thread::scope(|scope| {
            for me in 0..8 {
                let (begging, parking, done) = (&begging, &parking, &done);
                scope.spawn(move || {
                    parking.register(me);
                    let mut tasks = if me == 0 { vec![SIZE] } else { Vec::new() };
                    loop {
                        while let Some(task) = tasks.pop() {
                            done.fetch_add(1, Relaxed);
                            tasks.extend(0..task);
                            if begging.beggars(me).any()
                                && tasks.len() > 1
                                && let Some(beggar) = begging.take_beggar(me)
                            {
                                begging.give(beggar, tasks.split_off(tasks.len() / 2), parking);
                            }
                        }
                        let Some(gift) = begging.beg(me, parking) else { return };
                        tasks = gift;
                    }
                });
            }
        });
        assert_eq!(done.into_inner(), 1 << SIZE);
    }
}
