//! One thread's view of the triangulation: its locks, its free slots, its scratch memory, its
//! counters.

pub mod cavity;
pub mod insert;
pub mod remove;

pub use insert::Insertion;
pub use remove::Removal;

use std::ops::Range;

use super::chunked::CHUNK;
use super::locks::Locks;
use super::numa::NodeId;
use super::ownership::{Claim, Owner};
use super::probe::{NoProbe, Probe};
use super::tet::{Facet, TetId, VertexId, VertexKind};
use super::triangulation::Triangulation;
use crate::Result;
use crate::memory::reserve;
use cavity::CavityFacet;
use glam::DVec3;
use insert::StarScratch;
use remove::LinkScratch;

/// What a worker has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Vertices inserted.
    pub insertions: u64,
    /// Vertices removed.
    pub removals: u64,
    /// Operations given up because another worker owned a tet.
    pub rollbacks: u64,
    /// In-sphere tests of insertions: a tet of a cavity or around it against the point.
    pub in_sphere_tests: u64,
    /// Of these, and of the in-sphere and orientation tests of removals, those that their error
    /// bound in floating point left undecided.
    pub exact_predicates: u64,
    /// Tets created, living or not.
    pub created: u64,
    /// Tets destroyed.
    pub destroyed: u64,
    /// Of these, by insertions: the tets of all cavities.
    pub cavity_tets: u64,
}

/// Most different marks of workers.
pub const MARKS: usize = 255;

/// The mark of the tets of worker `number`.
pub fn mark_of(number: usize) -> u8 {
    (number % MARKS) as u8
}

/// Slots of one other node that a worker frees before it sends them home.
const PARCEL: usize = 64;

/// Slots whose pages a worker asks for at once: 64 KiB, so that hardly any memory is held before it
/// is used.
const POPULATED: u32 = 1024;
const _: () = assert!((CHUNK as u32).is_multiple_of(POPULATED));

/// A worker. Slots that it frees it uses again at once, last in first out: a cavity's new tets land
/// on the lines that are hot.
pub struct Worker<L, P = NoProbe> {
    /// The locking policy, which knows whom the worker met.
    pub locks: L,
    /// Who is told of what it does.
    pub probe: P,
    /// What this worker has done.
    pub counters: Counters,
    /// The mark of the tets that it makes.
    pub(super) mark: u8,
    /// Its memory node.
    node: NodeId,
    /// Freed slots of other nodes that are to be sent home, by node; `None`: it uses them itself.
    foreign: Option<Vec<Vec<TetId>>>,
    /// The chunks of tets that it claimed.
    claimed: Vec<Range<TetId>>,
    free: Vec<TetId>,
    fresh_tets: Range<u32>,
    fresh_vertices: Range<u32>,
    /// The cavity's tets, each by the facet through which it was found.
    pub(super) cavity: Vec<Facet>,
    pub(super) boundary: Vec<CavityFacet>,
    pub(super) star: StarScratch,
    pub(super) created: Vec<TetId>,
    /// Slots that the operation frees when it ends.
    freed: Vec<TetId>,
    pub(super) link: LinkScratch,
}

impl Counters {
    /// Adds what another worker has done.
    pub fn add(&mut self, other: &Self) {
        self.insertions += other.insertions;
        self.removals += other.removals;
        self.rollbacks += other.rollbacks;
        self.in_sphere_tests += other.in_sphere_tests;
        self.exact_predicates += other.exact_predicates;
        self.created += other.created;
        self.destroyed += other.destroyed;
        self.cavity_tets += other.cavity_tets;
    }
}

impl<L: Locks> Worker<L> {
    /// A worker that tells nobody; see [`Self::with_probe`].
    pub fn new(locks: L, number: usize) -> Self {
        Self::with_probe(locks, NoProbe, number)
    }
}

impl<L: Locks, P: Probe> Worker<L, P> {
    /// A worker without memory; it claims some when it first needs it. Its tets get mark `number`.
    pub fn with_probe(locks: L, probe: P, number: usize) -> Self {
        Self {
            locks,
            probe,
            counters: Counters::default(),
            mark: mark_of(number),
            node: 0,
            foreign: None,
            claimed: Vec::new(),
            free: Vec::new(),
            fresh_tets: 0..0,
            fresh_vertices: 0..0,
            cavity: Vec::new(),
            boundary: Vec::new(),
            star: StarScratch::default(),
            created: Vec::new(),
            freed: Vec::new(),
            link: LinkScratch::default(),
        }
    }

    /// The same worker on memory node `node`; it is to have no memory yet. `keeps_home`: it uses
    /// only slots of its node (`numa`).
    pub fn at_node(self, node: NodeId, keeps_home: bool) -> Self {
        Self { node, foreign: keeps_home.then(Vec::new), ..self }
    }

    /// The same worker under another locking policy.
    pub fn with_locks<M: Locks>(self, locks: M) -> Worker<M, P> {
        let Self {
            locks: _,
            probe,
            counters,
            mark,
            node,
            foreign,
            claimed,
            free,
            fresh_tets,
            fresh_vertices,
            cavity,
            boundary,
            star,
            created,
            freed,
            link,
        } = self;
        Worker {
            locks,
            probe,
            counters,
            mark,
            node,
            foreign,
            claimed,
            free,
            fresh_tets,
            fresh_vertices,
            cavity,
            boundary,
            star,
            created,
            freed,
            link,
        }
    }

    /// The mark of the tets that this worker makes; below [`MARKS`].
    pub fn mark(&self) -> u8 {
        self.mark
    }

    /// The slots of tets that this worker claimed, other workers' tets in them or not, but for
    /// those that nobody has used yet: to read these would map pages that the first tet in them
    /// then makes the system map anew, which halts all other threads.
    pub fn used_slots(&self) -> impl Iterator<Item = Range<TetId>> {
        let fresh = &self.fresh_tets;
        self.claimed.iter().map(|slots| {
            if slots.end == fresh.end { slots.start..fresh.start } else { slots.clone() }
        })
    }

    /// The tets that the last completed operation made.
    pub fn created(&self) -> &[TetId] {
        &self.created
    }

    /// Bytes of the list of free slots; the scratch memory beside it is that of a few operations.
    pub fn bytes(&self) -> u64 {
        (self.free.capacity() * size_of::<TetId>()) as u64
    }

    /// Makes sure that the next `count` tets and one vertex can be had without failing: an
    /// operation asks before it writes (invariant 5).
    pub(super) fn reserve(&mut self, triangulation: &Triangulation, count: usize) -> Result<()> {
        while self.free.len() + self.fresh_tets.len() < count {
            if self.foreign.is_some()
                && triangulation.node_map().take_returned(self.node, &mut self.free)?
            {
                continue;
            }
            // For what is left of the range, and for most of what is freed until the next one.
            reserve(&mut self.free, CHUNK, "free slots")?;
            reserve(&mut self.claimed, 1, "chunks of a worker")?;
            let range = triangulation.claim_tets(self.node)?;
            self.claimed.push(range.clone());
            self.free.extend(std::mem::replace(&mut self.fresh_tets, range).rev());
        }
        if self.fresh_vertices.is_empty() {
            self.fresh_vertices = triangulation.claim_vertices(self.node)?;
        }
        reserve(&mut self.freed, self.cavity.len(), "slots that an operation frees")?;
        reserve(&mut self.created, count, "tets of an operation")
    }

    #[inline]
    fn take_tet(&mut self, triangulation: &Triangulation) -> TetId {
        let t = match self.free.pop() {
            Some(t) => t,
            None => self.take_fresh(triangulation),
        };
        // Before any link leads to it.
        triangulation.owner(t).set(self.locks.owner_of_new());
        t
    }

    #[inline]
    fn take_fresh(&mut self, triangulation: &Triangulation) -> TetId {
        let t = self.fresh_tets.next().expect("reserve() was asked for enough slots");
        if t.is_multiple_of(POPULATED) {
            triangulation.populate(t..t + POPULATED);
        }
        t
    }

    /// Frees a slot to which no link leads any more.
    #[inline]
    fn give_tet(&mut self, triangulation: &Triangulation, t: TetId) {
        let record = triangulation.tet(t);
        record.clear();
        record.owner().free_slot();
        if self.foreign.is_some() && triangulation.node_map().of_tet(t) != self.node {
            self.send_home(triangulation, t);
        } else {
            self.free.push(t);
        }
    }

    /// Sends a free slot of another node home, with some more.
    #[cold]
    fn send_home(&mut self, triangulation: &Triangulation, t: TetId) {
        let home = triangulation.node_map().of_tet(t);
        let Some(foreign) = &mut self.foreign else { return };
        let at = usize::from(home);
        if foreign.len() <= at {
            foreign.resize_with(at + 1, Vec::new);
        }
        foreign[at].push(t);
        if foreign[at].len().is_multiple_of(PARCEL) {
            // Without memory for the way they stay here, until there are some more.
            let _ = triangulation.node_map().give_back(home, &mut foreign[at]);
        }
    }

    /// Exchanges the tets of the cavity for `count` new ones, listed in `created`: the slots stay,
    /// without a way through the free list. Those that are too many, or other nodes', are freed by
    /// [`Self::end_operation`].
    pub(super) fn exchange_slots(&mut self, triangulation: &Triangulation, count: usize) {
        self.created.clear();
        self.counters.destroyed += self.cavity.len() as u64;
        self.counters.created += count as u64;
        if self.foreign.is_some() {
            self.cavity.retain(|entry| {
                let own = triangulation.node_map().of_tet(entry.tet()) == self.node;
                if !own {
                    self.freed.push(entry.tet());
                }
                own
            });
        }
        let spare = self.cavity.len().saturating_sub(count);
        // The last found first: their lines are the hottest.
        self.created.extend(self.cavity.drain(spare..).rev().map(Facet::tet));
        self.freed.extend(self.cavity.drain(..).map(Facet::tet));
        while self.created.len() < count {
            let t = self.take_tet(triangulation);
            self.created.push(t);
        }
    }

    /// Asks for the tet with this `owner`.
    #[inline(always)]
    pub(super) fn try_own(&mut self, owner: &Owner) -> Claim {
        if L::SHARED {
            self.probe.before_claim();
        }
        self.locks.try_own(owner)
    }

    #[inline(always)]
    fn end_locking(&mut self) {
        if L::SHARED {
            self.probe.before_release();
        }
        self.locks.end_operation();
    }

    /// Gives back what a completed operation made, when all of it is written, and frees the slots
    /// that it has no use for.
    pub(super) fn end_operation(&mut self, triangulation: &Triangulation) {
        self.end_locking();
        if L::SHARED {
            for &t in &self.created {
                triangulation.owner(t).release();
            }
        }
        let mut freed = std::mem::take(&mut self.freed);
        for t in freed.drain(..) {
            self.give_tet(triangulation, t);
        }
        self.freed = freed;
    }

    /// Gives back what an operation owns that is given up.
    pub(super) fn roll_back(&mut self, triangulation: &Triangulation) {
        self.end_locking();
        for entry in self.cavity.drain(..) {
            triangulation.owner(entry.tet()).release();
        }
    }

    pub(super) fn take_vertex(
        &mut self,
        triangulation: &Triangulation,
        position: DVec3,
        kind: VertexKind,
    ) -> VertexId {
        let v = self.fresh_vertices.next().expect("reserve() keeps a vertex ready");
        triangulation.vertex(v).fill(position, kind);
        v
    }
}
