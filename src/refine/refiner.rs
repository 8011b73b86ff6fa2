//! One worker's loop over its poor element list.
//!
//! First the samples of the isosurface are inserted. Then all tets are inspected, in the order of
//! the PEL (`pel`): inspecting asks the surface rule R3, then the volume rules. A surface demand is
//! carried out at once; a tet that only a volume rule finds poor waits until no tet is left to be
//! inspected.
//!
//! The same loop serves a lone worker and one of a team (`podm`): the locking policy of the kernel
//! is a type parameter, and what concerns others is compiled out for a lone worker. With others at
//! work an inspection is a hint, checked when the operation owns what it inspected
//! (`delaunay/ownership`); an operation that is given up leaves its tet in the list.
//!
//! Limits end the loop between two operations, so the triangulation is whole then: a mesh can be
//! made of it. Time and memory are checked every thousand steps, as is the cancel flag; a step
//! takes microseconds.

use std::ops::Range;

use glam::DVec3;

use super::activity::{Accesses, Doing, Lost, Timeline, Work};
use super::lapd::Outbox;
use super::pel::{Gift, Pel, Task};
use super::probe::RefineProbe;
use super::rules::{Facets, ISOVERTEX, RefinementPoint, Rule, Rules};
use super::state::State;
use super::team::{PERMITS, Team, There};
use super::unmet::LeftOver;
use crate::delaunay::numa::MAX_NODES;
use crate::delaunay::tet::TetRecord;
use crate::delaunay::worker::mark_of;
use crate::delaunay::{
    Insertion, Locks, Removal, TetId, TetStamp, Triangulation, VertexId, Worker,
};
use crate::memory::{reserve, room};
use crate::parallel::contention::Streak;
use crate::sync::Ticks;
use crate::sync::clock::ticks;
use crate::{Error, Result};

/// Steps between two checks of the cancel flag and the limits.
pub(super) const REPORT_EVERY: u64 = 1024;

/// Steps between two checks of what other workers want or have sent. Most steps inspect a tet,
/// some hundred instructions, of which asking each time would be a tenth.
const ASK_EVERY: u64 = 8;
const _: () = assert!(REPORT_EVERY.is_multiple_of(ASK_EVERY));

/// Entries that the list has room for at each check: more than the steps until the next one push,
/// unless cavities are monstrous.
const ROOM: usize = 64 * REPORT_EVERY as usize;

/// Slots that are collected at once: their records stay in the nearest cache from one step to the
/// next.
const COLLECTED: usize = 256;

/// How often facets that R3 put off are asked again. A few rounds, so that the asking ends.
const ROUNDS: u32 = 8;

/// The part of slots that worker `me` of so many has.
fn part_of(slots: &Range<TetId>, me: usize, workers: usize) -> Range<TetId> {
    let count = u64::from(slots.end - slots.start);
    let place = |n: usize| slots.start + (count * n as u64 / workers as u64) as TetId;
    place(me)..place(me + 1)
}

/// What came of an operation that a rule asked for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fate {
    Done,
    /// Others were in the way: the tet is to be asked again.
    GivenUp,
    /// Rounding placed the point on a vertex or out of the conflict zone; the demand stays unmet,
    /// and is counted so in the end.
    Dropped,
}

/// A worker with its list.
pub(super) struct Refiner<'t, 'a, L, P> {
    team: &'t Team<'a>,
    rules: &'t Rules<'a>,
    state: &'t State<'a>,
    triangulation: &'a Triangulation,
    /// Its number in the team.
    me: usize,
    pub worker: Worker<L, P>,
    pel: Pel,
    near: Vec<VertexId>,
    outbox: Outbox,
    /// Vertices that it may insert before it asks the team again.
    permits: u64,
    /// What it told the team of its tets and its memory.
    told: (u64, u64),
    streak: Streak,
    pub work: Work,
    pub lost: Lost,
    pub timeline: Timeline,
    left_over: LeftOver,
    /// Tets with a facet for which R3 demanded nothing because of a vertex nearby; since the list
    /// was last empty.
    put_off: Vec<TetStamp>,
    /// How often some of these went back into the list.
    rounds: u32,
    /// The tets that samples made, where these are few.
    made: Vec<TetStamp>,
}

impl<'t, 'a, L: Locks, P: RefineProbe> Refiner<'t, 'a, L, P> {
    pub fn new(team: &'t Team<'a>, me: usize, worker: Worker<L, P>) -> Self {
        Self {
            team,
            rules: team.rules,
            state: team.state,
            triangulation: team.rules.triangulation,
            me,
            worker,
            pel: Pel::default(),
            near: Vec::new(),
            outbox: Outbox::default(),
            permits: 0,
            told: (0, 0),
            streak: Streak::new(me),
            work: Work::default(),
            lost: Lost::default(),
            timeline: Timeline::new(team.keeps_timeline),
            left_over: LeftOver::default(),
            put_off: Vec::new(),
            rounds: 0,
            made: Vec::new(),
        }
    }

    /// The same worker under another locking policy.
    pub fn with_locks<M: Locks>(self, locks: M) -> Refiner<'t, 'a, M, P> {
        let Self {
            team,
            rules,
            state,
            triangulation,
            me,
            worker,
            pel,
            near,
            outbox,
            permits,
            told,
            streak,
            work,
            lost,
            timeline,
            left_over,
            put_off,
            rounds,
            made,
        } = self;
        let worker = worker.with_locks(locks);
        Refiner {
            team,
            rules,
            state,
            triangulation,
            me,
            worker,
            pel,
            near,
            outbox,
            permits,
            told,
            streak,
            work,
            lost,
            timeline,
            left_over,
            put_off,
            rounds,
            made,
        }
    }

    /// Gives the team what it could not carry out.
    pub fn hand_in_left_over(&mut self) {
        let put_off = LeftOver { tets: std::mem::take(&mut self.put_off), samples: 0 };
        self.team.take_left_over(std::mem::take(&mut self.left_over));
        self.team.take_left_over(put_off);
    }

    /// Where what its operations visited was, if that is counted.
    pub fn accesses(&self) -> Accesses {
        let mut accesses = Accesses::default();
        if let Some(visits) = self.worker.probe.visits() {
            let machine = self.team.machine;
            let own = machine.node_of_worker(self.me);
            let nodes = 0..machine.nodes().min(MAX_NODES);
            nodes.for_each(|node| accesses.count(machine.hops(own, node), visits.at(node)));
        }
        accesses
    }

    /// R1: inserts the samples that `next` gives, some at a time.
    pub fn insert_samples(&mut self, mut next: impl FnMut() -> Option<Range<usize>>) -> Result<()> {
        let mut at = self.triangulation.vertex(0).star();
        let are_few = self.team.there.as_ref().is_some_and(|there| there.denser.are_few());
        let mut again: Vec<DVec3> = Vec::new();
        let mut steps = 0_u64;
        while let Some(block) = next() {
            let mut waiting = block.map(|sample| self.team.samples[sample]);
            while let Some(p) = waiting.next().or_else(|| again.pop()) {
                if steps.is_multiple_of(REPORT_EVERY) {
                    self.report_and_check()?;
                }
                steps += 1;
                self.worker.probe.pause();
                let begin = self.stamp_time();
                at = self.worker.locate(self.triangulation, at, p);
                self.take_permit()?;
                let (state, kind) = (self.state, ISOVERTEX);
                let made = &mut self.made;
                // While its tets are owned: later they may be gone, and others in their slots.
                let note = |v, tets: &[TetId]| {
                    state.note_vertex(v, p, kind)?;
                    if are_few {
                        reserve(made, tets.len(), "tets that samples made")?;
                        made.extend(tets.iter().map(|&tet| TetStamp { tet, last: v }));
                    }
                    Ok(())
                };
                match self.worker.insert_if(self.triangulation, at, p, kind, || true, note)? {
                    Insertion::Done(_) => {
                        self.work.by_rule[Rule::R1 as usize] += 1;
                        at = self.worker.created()[0];
                        // In the beginning there are only samples.
                        if self.team.there.is_some() {
                            self.state.near_free_vertices(p, &mut self.near);
                            self.pel.push_removals(&self.near)?;
                        }
                        self.after_success();
                        continue;
                    }
                    // Others have changed the tet since the walk came to it.
                    Insertion::NotInConflict | Insertion::Stale if L::SHARED => {
                        again.push(p);
                        // Corners of the box always have a tet.
                        at = self.triangulation.vertex(0).star();
                        self.after_stale(begin);
                    }
                    Insertion::Duplicate | Insertion::NotInConflict | Insertion::Stale => {
                        self.left_over.samples += 1;
                    }
                    Insertion::Blocked => {
                        again.push(p);
                        self.after_conflict(Rule::R1, begin)?;
                    }
                }
                self.permits += 1;
            }
        }
        Ok(())
    }

    /// Takes the tets that are to be inspected first into its list, or sends them to the workers in
    /// whose regions they lie. While nobody operates.
    pub fn collect(&mut self) -> Result<()> {
        let mut parcels: Vec<Vec<TetStamp>> = Vec::new();
        parcels.resize_with(self.team.size(), Vec::new);
        match &self.team.there {
            Some(there) if there.denser.are_few() => self.collect_few(there, &mut parcels)?,
            _ => self.collect_slots(&mut parcels)?,
        }
        if let Some(there) = self.team.there.as_ref().filter(|_| self.me == 0) {
            self.pel.make_room(there.left_over.len())?;
            let left =
                there.left_over.iter().filter(|&&stamp| self.triangulation.is_current(stamp));
            left.map(|stamp| stamp.tet).try_for_each(|t| self.put(t, &mut parcels))?;
        }
        let Some(regions) = self.team.regions.as_ref() else { return Ok(()) };
        let mut filled = parcels.into_iter().enumerate().filter(|(_, parcel)| !parcel.is_empty());
        filled.try_for_each(|(worker, parcel)| regions.send(worker, parcel))
    }

    /// Where the field has become smaller in few places: the tets that this worker's samples made,
    /// and, for all workers, the older ones near to these places.
    fn collect_few(&mut self, there: &There<'_>, parcels: &mut [Vec<TetStamp>]) -> Result<()> {
        self.report_and_check()?;
        let mut tets: Vec<TetId> = room(self.made.len(), "tets to collect")?;
        let made = std::mem::take(&mut self.made);
        let current = made.into_iter().filter(|&stamp| self.triangulation.is_current(stamp));
        tets.extend(current.map(|stamp| stamp.tet));
        tets.chunks(COLLECTED).for_each(|tets| self.state.find_labels(tets));
        self.note_labels(tets.len());
        let check = || self.team.report_and_check((0, 0));
        if self.me == 0
            && let Some(near) = self.rules.few_near(there.denser, check)?
        {
            // Tets that were made since have a new vertex, their last: none was removed yet.
            let is_older = |&t: &TetId| self.triangulation.tet(t).vertex(3) < there.first_vertex;
            reserve(&mut tets, near.len(), "tets to collect")?;
            tets.extend(near.into_iter().filter(is_older));
        }
        // In the order in which they would come slot by slot: first those that were claimed since.
        tets.sort_unstable_by_key(|&t| (t < there.slots.end, t));
        self.pel.make_room(tets.len())?;
        tets.into_iter().try_for_each(|t| self.put(t, parcels))
    }

    /// The tets in the slots that this worker claimed, and those that are to be inspected of its
    /// part of the slots that were there before.
    fn collect_slots(&mut self, parcels: &mut [Vec<TetStamp>]) -> Result<()> {
        let mut living = room(COLLECTED, "tets to collect")?;
        let mut unlabelled: Vec<TetId> = room(COLLECTED, "tets to collect")?;
        let unclaimed = match &self.team.there {
            Some(there) => part_of(&there.slots, self.me, self.team.size()),
            // Slots of the box are nobody's claim.
            None if self.me == 0 => self.triangulation.box_slots(),
            None => 0..0,
        };
        let used: Vec<Range<TetId>> = self.worker.used_slots().chain([unclaimed]).collect();
        for slots in used {
            self.report_and_check()?;
            self.pel.make_room(slots.len())?;
            for first in slots.clone().step_by(COLLECTED) {
                living.clear();
                living.extend((first..slots.end).take(COLLECTED).filter(|&t| {
                    self.triangulation.prefetch_next(t);
                    self.triangulation.is_living(t)
                }));
                // Those that there were before have labels. Their marks say that they wait in no
                // list.
                unlabelled.clear();
                unlabelled.extend(living.iter().filter(|&&t| !self.rules.has_label(t)));
                if let Some(there) = &self.team.there {
                    let is_new = |t| !self.rules.has_label(t);
                    living.retain(|&t| is_new(t) || self.rules.is_near(t, there.denser));
                }
                self.state.find_labels(&unlabelled);
                self.note_labels(unlabelled.len());
                living.iter().try_for_each(|&t| self.put(t, parcels))?;
            }
        }
        Ok(())
    }

    /// Puts a tet into the list, or into the parcel for the worker in whose region it lies.
    fn put(&mut self, t: TetId, parcels: &mut [Vec<TetStamp>]) -> Result<()> {
        let (record, regions) = (self.triangulation.tet(t), self.team.regions.as_ref());
        let owner = regions.map_or(self.me, |regions| regions.worker_of(record.sphere().center));
        record.set_mark(mark_of(owner));
        if owner == self.me {
            self.pel.push_waiting(self.triangulation.stamp(t));
        } else {
            reserve(&mut parcels[owner], 1, "tets of other regions")?;
            parcels[owner].push(self.triangulation.stamp(t));
        }
        Ok(())
    }

    /// Takes the tets that others sent into the list. When all have collected theirs.
    pub fn receive(&mut self) -> Result<()> {
        for parcel in self.team.regions.iter().flat_map(|regions| regions.receive(self.me)) {
            self.pel.make_room(parcel.len())?;
            parcel.into_iter().for_each(|stamp| self.pel.push_waiting(stamp));
        }
        Ok(())
    }

    /// Works until no rule applies, for the whole team.
    pub fn run(&mut self) -> Result<()> {
        self.timeline.turn_to(Doing::Refining, ticks());
        let beggars = self.team.begging.beggars(self.me);
        let divided = L::SHARED && self.team.regions.is_some();
        let mut steps = 0_u64;
        loop {
            if steps.is_multiple_of(ASK_EVERY) {
                if steps.is_multiple_of(REPORT_EVERY) {
                    self.report_and_check()?;
                }
                if L::SHARED && beggars.any() {
                    self.give()?;
                }
                if divided && let Some(sent) = self.team.begging.open_inbox(self.me) {
                    self.accept(sent)?;
                }
            }
            steps += 1;
            self.worker.probe.pause();
            match self.pel.pop() {
                Some(Task::Remove(v)) => self.remove(v)?,
                Some(Task::Inspect(stamp)) => {
                    // Looked up once: the compiler may not assume that a second time would give
                    // the same.
                    let record = self.triangulation.tet(stamp.tet);
                    if record.vertex(3) == stamp.last {
                        self.inspect(stamp, record)?;
                    }
                }
                Some(Task::Serve(stamp)) if self.triangulation.is_current(stamp) => {
                    self.serve(stamp)?
                }
                Some(Task::Serve(_)) => {}
                // Among several workers what is put off stays left over: a vertex nearby may be
                // another one's to remove.
                None if !L::SHARED && self.ask_again()? => {}
                None if L::SHARED && self.beg()? => {}
                None => return Ok(()),
            }
        }
    }

    /// Goes through the tets with a facet that R3 put off. Those of which R3 demands something now,
    /// as the vertex nearby was removed, go back into the list; the others are left over. `false`:
    /// none went back.
    ///
    /// Rounds are counted, since a tet may have one facet that is put off and another whose demand
    /// is dropped each time that it is asked: it would go back for ever.
    #[cold]
    fn ask_again(&mut self) -> Result<bool> {
        let mut any = false;
        self.pel.make_room(self.put_off.len())?;
        for stamp in std::mem::take(&mut self.put_off) {
            if !self.triangulation.is_current(stamp) {
                continue;
            }
            let record = self.triangulation.tet(stamp.tet);
            let mut interfaces =
                self.rules.interfaces(stamp.tet, record, Facets::Second(self.worker.mark()));
            if self.rounds < ROUNDS && self.ask_surface(stamp.tet, &mut interfaces).is_some() {
                self.pel.push_made(stamp);
                any = true;
            } else {
                self.left_over.push(stamp)?;
            }
        }
        self.rounds += u32::from(any);
        Ok(any)
    }

    /// Reports, checks the limits, and makes room in the list, so that pushing need not ask for
    /// memory.
    #[cold]
    fn report_and_check(&mut self) -> Result<()> {
        // The box has some that nobody created.
        let tets = self.worker.counters.created.saturating_sub(self.worker.counters.destroyed);
        self.pel.make_room(ROOM)?;
        self.send_all();
        // Others may need what R6 gave.
        let surplus = self.permits.saturating_sub(PERMITS);
        self.permits -= surplus;
        self.team.return_permits(surplus);
        let made = (self.made.capacity() * size_of::<TetStamp>()) as u64;
        let bytes = self.worker.bytes() + self.pel.bytes() + made;
        let told = std::mem::replace(&mut self.told, (tets, bytes));
        self.team.report_and_check((tets.wrapping_sub(told.0), bytes.wrapping_sub(told.1)))
    }

    #[inline]
    fn take_permit(&mut self) -> Result<()> {
        if self.permits == 0 {
            self.permits = self.team.take_permits()?;
        }
        self.permits -= 1;
        Ok(())
    }

    #[inline(always)]
    fn inspect(&mut self, stamp: TetStamp, record: &TetRecord) -> Result<()> {
        self.work.inspections += 1;
        self.worker.probe.inspect(self.triangulation, stamp.tet);
        State::mark_elsewhere(record);
        let facets = Facets::Second(self.worker.mark());
        let interfaces = self.rules.interfaces(stamp.tet, record, facets);
        self.inspect_facets(stamp, record, interfaces)
    }

    /// Does what the surface demands of a tet at these of its facets, or notes what its volume
    /// does. Most inspections find nothing: for these a call would be 36 instructions more.
    #[inline(always)]
    fn inspect_facets(
        &mut self,
        stamp: TetStamp,
        record: &TetRecord,
        mut interfaces: u32,
    ) -> Result<()> {
        let put_off = self.work.lookups.put_off;
        // Demands stay where they were made: one is a hundred bytes and more, and a copy of what
        // was just written waits for that.
        while let Some(wanted) = &self.ask_surface(stamp.tet, &mut interfaces) {
            // What is dropped keeps nothing else from being asked.
            if self.hand_over(stamp, wanted, interfaces)?
                || self.settle(stamp, wanted)? != Fate::Dropped
            {
                return Ok(());
            }
        }
        if self.work.lookups.put_off != put_off {
            reserve(&mut self.put_off, 1, "facets at walls")?;
            self.put_off.push(stamp);
        }
        if let Some(wanted) = &self.rules.volume_point(stamp.tet, record)
            && !self.hand_over(stamp, wanted, 0)?
        {
            self.pel.push_poor(stamp);
        }
        Ok(())
    }

    /// The next demand of the surface, by R3.
    #[inline]
    fn ask_surface(&mut self, t: TetId, interfaces: &mut u32) -> Option<RefinementPoint> {
        let before = self.work.lookups;
        let wanted = self.rules.surface_point(t, interfaces, &mut self.work.lookups);
        self.worker.probe.look_up_labels(self.work.lookups.labels - before.labels);
        self.worker.probe.look_up_crossings(self.work.lookups.crossings - before.crossings);
        wanted
    }

    /// Carries out what the surface demands of a tet.
    fn settle(&mut self, stamp: TetStamp, wanted: &RefinementPoint) -> Result<Fate> {
        let fate = self.carry_out(stamp, wanted)?;
        // What was inserted may lie in the neighbour's circumball alone: then the tet is inspected
        // again.
        if fate != Fate::Dropped && self.triangulation.is_current(stamp) {
            self.pel.push_made(stamp);
        }
        Ok(fate)
    }

    /// Leaves to another node what is to be inserted in its region, with the facets that are still
    /// to be asked if it cannot be; `false`: it lies in a region of this node.
    #[inline]
    fn hand_over(
        &mut self,
        stamp: TetStamp,
        wanted: &RefinementPoint,
        interfaces: u32,
    ) -> Result<bool> {
        if !L::SHARED {
            return Ok(false);
        }
        match self
            .team
            .regions
            .as_ref()
            .and_then(|regions| regions.elsewhere(self.me, wanted.point))
        {
            Some(host) => {
                if self.outbox.put(host, stamp, wanted, interfaces)? {
                    self.send(host);
                }
                Ok(true)
            }
            None => Ok(false),
        }
    }

    /// Sends what is kept for the node of worker `host`.
    fn send(&mut self, host: usize) {
        if let Some(parcel) = self.outbox.take(host) {
            self.lost.overhead.gifts += 1;
            self.team.begging.send(host, parcel, &self.team.parking);
        }
    }

    fn send_all(&mut self) {
        self.outbox.hosts().for_each(|host| self.send(host));
    }

    fn serve(&mut self, stamp: TetStamp) -> Result<()> {
        let record = self.triangulation.tet(stamp.tet);
        let Some(wanted) = &self.rules.volume_point(stamp.tet, record) else { return Ok(()) };
        match self.carry_out(stamp, wanted)? {
            Fate::GivenUp => self.pel.push_poor(stamp),
            // What was inserted lies in its circumball, so it is gone; but for rounding.
            Fate::Done if self.triangulation.is_current(stamp) => self.left_over.push(stamp)?,
            Fate::Done | Fate::Dropped => {}
        }
        Ok(())
    }

    /// Inserts what the tet of `stamp` demanded.
    fn carry_out(&mut self, stamp: TetStamp, wanted: &RefinementPoint) -> Result<Fate> {
        self.take_permit()?;
        let begin = self.stamp_time();
        let (rules, state) = (self.rules, self.state);
        let triangulation = self.triangulation;
        let outcome = self.worker.insert_if(
            triangulation,
            wanted.start,
            wanted.point,
            wanted.kind,
            || rules.still_applies(stamp.tet, wanted),
            |v, tets| {
                state.find_labels(tets);
                // While its tets are owned: an isovertex that is inserted near it later finds it in
                // the grid.
                state.note_vertex(v, wanted.point, wanted.kind)
            },
        )?;
        let fate = match outcome {
            Insertion::Done(_) => {
                self.work.by_rule[wanted.rule as usize] += 1;
                self.push_created();
                if wanted.kind == ISOVERTEX {
                    self.state.near_free_vertices(wanted.point, &mut self.near);
                    self.pel.push_removals(&self.near)?;
                }
                self.after_success();
                return Ok(Fate::Done);
            }
            Insertion::Duplicate | Insertion::NotInConflict => {
                self.left_over.push(stamp)?;
                Fate::Dropped
            }
            Insertion::Stale => {
                self.after_stale(begin);
                Fate::GivenUp
            }
            Insertion::Blocked => {
                self.after_conflict(wanted.rule, begin)?;
                Fate::GivenUp
            }
        };
        self.permits += 1;
        Ok(fate)
    }

    /// R6.
    fn remove(&mut self, v: VertexId) -> Result<()> {
        let begin = self.stamp_time();
        let state = self.state;
        match self.worker.remove_and(self.triangulation, v, |tets| state.find_labels(tets))? {
            Removal::Done => {
                self.work.by_rule[Rule::R6 as usize] += 1;
                self.permits += 1;
                self.push_created();
                self.after_success();
            }
            Removal::Stale => {}
            Removal::Blocked => {
                self.pel.push_removals(&[v])?;
                self.after_conflict(Rule::R6, begin)?;
            }
        }
        Ok(())
    }

    fn push_created(&mut self) {
        self.note_labels(self.worker.created().len());
        for &t in self.worker.created() {
            self.pel.push_made(self.triangulation.stamp(t));
        }
    }

    fn note_labels(&mut self, found: usize) {
        self.work.lookups.labels += found as u64;
        self.worker.probe.look_up_labels(found as u64);
    }

    /// The time, if others might make this operation a vain one.
    #[inline(always)]
    fn stamp_time(&self) -> Ticks {
        if L::SHARED { ticks() } else { 0 }
    }

    #[inline(always)]
    fn after_success(&mut self) {
        if L::SHARED {
            self.team.contention.after_success(self.me, &mut self.streak, &self.team.parking);
        }
    }

    #[cold]
    fn after_stale(&mut self, begin: Ticks) {
        let end = ticks();
        self.lost.overhead.stale += 1;
        self.lost.rolling_back += end.saturating_sub(begin);
        self.timeline.interrupt(Doing::RollingBack, begin, end);
    }

    #[cold]
    fn after_conflict(&mut self, rule: Rule, begin: Ticks) -> Result<()> {
        let met = self
            .worker
            .locks
            .met()
            .ok_or_else(|| Error::Internal("a lone worker was blocked".into()))?;
        let end = ticks();
        self.lost.overhead.rollbacks[rule as usize] += 1;
        self.lost.rolling_back += end.saturating_sub(begin);
        self.timeline.interrupt(Doing::RollingBack, begin, end);
        if self.team.contention.after_conflict(self.me, met, &mut self.streak, &self.team.parking) {
            let woken = ticks();
            self.lost.overhead.waits += 1;
            self.lost.waiting += woken.saturating_sub(end);
            self.timeline.interrupt(Doing::Waiting, end, woken);
        }
        self.team.go_on()
    }

    /// Gives a beggar a part of the list, if there is enough of it.
    #[cold]
    fn give(&mut self) -> Result<()> {
        if self.pel.can_give()
            && let Some(beggar) = self.team.begging.take_beggar(self.me)
        {
            let gift = self.pel.gift()?;
            for stamp in &gift.waiting {
                // Where the tet has died meanwhile, its slot's next one is inspected twice at
                // worst.
                State::mark_elsewhere(self.triangulation.tet(stamp.tet));
            }
            self.lost.overhead.gifts += 1;
            self.team.begging.give(beggar, gift, &self.team.parking);
        }
        Ok(())
    }

    /// Waits for work; `false`: nobody has any.
    fn beg(&mut self) -> Result<bool> {
        self.send_all();
        let begin = ticks();
        self.team.return_permits(std::mem::take(&mut self.permits));
        self.team.contention.leave(self.me, &self.team.parking);
        self.lost.overhead.begs += 1;
        let gift: Option<Gift> = self.team.begging.beg(self.me, &self.team.parking);
        self.lose_idle(begin);
        self.team.go_on()?;
        let Some(gift) = gift else { return Ok(false) };
        self.team.contention.come_back(self.me);
        self.accept(gift)?;
        Ok(true)
    }

    /// Takes work of another worker in; what it demands of the surface is done at once.
    fn accept(&mut self, mut gift: Gift) -> Result<()> {
        self.pel.accept(&mut gift)?;
        // Each demand is a step.
        self.pel.make_room(ROOM)?;
        for (stamp, wanted, interfaces) in gift.points {
            if self.triangulation.is_current(stamp) && self.settle(stamp, &wanted)? == Fate::Dropped
            {
                self.inspect_facets(stamp, self.triangulation.tet(stamp.tet), interfaces)?;
            }
        }
        Ok(())
    }

    /// Notes that the worker had nothing to do since `begin`.
    pub fn lose_idle(&mut self, begin: Ticks) {
        let end = ticks();
        self.lost.idle += end.saturating_sub(begin);
        self.timeline.interrupt(Doing::Begging, begin, end);
    }
}
