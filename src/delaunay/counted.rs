//! A policy that counts: how many tets and vertices a worker's operations visited, by the memory
//! node where these are at home (paper, sections 3 and 5.2: remote memory accesses).
//!
//! What is a visit is said at [`Access::visit_tet`]. Looking, which is no part of an operation, is
//! not counted, nor is what an operation reads a second time while it has it at hand.
//!
//! Cost: a byte of a small table read and a number added to for each visit.

use super::access::{Access, Effort};
use super::homes::{Homes, MAX_NODES};
use super::ownership::{Holder, Owner, OwnerId};
use super::triangulation::Triangulation;
use super::{TetId, VertexId};

/// Visits of tets and vertices by the node where these are at home.
#[derive(Clone, Debug)]
pub struct Visits(Box<[u64; MAX_NODES]>);

impl Default for Visits {
    fn default() -> Self {
        Self(Box::new([0; MAX_NODES]))
    }
}

impl Visits {
    /// Visits of tets and vertices at home on node `node`.
    pub fn at(&self, node: usize) -> u64 {
        self.0[node]
    }
}

/// Policy `A`, counted.
pub struct Counted<'t, A> {
    policy: A,
    homes: &'t Homes,
    visits: Visits,
}

impl<'t, A: Access> Counted<'t, A> {
    /// Counts what `policy` is told, from 0.
    pub fn new(policy: A, triangulation: &'t Triangulation) -> Self {
        Self { policy, homes: triangulation.homes(), visits: Visits::default() }
    }

    /// Counts on under another policy.
    pub fn over<B: Access>(self, policy: B) -> Counted<'t, B> {
        Counted { policy, homes: self.homes, visits: self.visits }
    }
}

impl<A: Access> Access for Counted<'_, A> {
    const SHARED: bool = A::SHARED;

    #[inline(always)]
    fn try_own(&mut self, owner: &Owner) -> Holder {
        self.policy.try_own(owner)
    }

    #[inline(always)]
    fn look_across(&mut self, owner: &Owner) -> Holder {
        self.policy.look_across(owner)
    }

    #[inline(always)]
    fn owner_of_new(&self) -> OwnerId {
        self.policy.owner_of_new()
    }

    #[inline(always)]
    fn end_operation(&mut self) {
        self.policy.end_operation();
    }

    fn met(&self) -> Option<usize> {
        self.policy.met()
    }

    #[inline(always)]
    fn visit_tet(&mut self, t: TetId) {
        self.visits.0[usize::from(self.homes.of_tet(t))] += 1;
        self.policy.visit_tet(t);
    }

    #[inline(always)]
    fn visit_vertex(&mut self, v: VertexId) {
        self.visits.0[usize::from(self.homes.of_vertex(v))] += 1;
        self.policy.visit_vertex(v);
    }

    #[inline(always)]
    fn spend(&mut self, effort: Effort) {
        self.policy.spend(effort);
    }

    #[inline(always)]
    fn look(&mut self, triangulation: &Triangulation, t: TetId) {
        self.policy.look(triangulation, t);
    }

    #[inline(always)]
    fn pause(&mut self) {
        self.policy.pause();
    }

    fn visits(&self) -> Option<&Visits> {
        Some(&self.visits)
    }
}
