//! Who is told of what a worker does: the probe of a worker, a type parameter of the kernel.
//!
//! [`NoProbe`] hears nothing, and nothing is compiled for it. [`CountVisits`] counts how many tets
//! and vertices operations visited, by the memory node where these are at home (paper, sections 3
//! and 5.2: remote memory accesses). A simulation has a probe of its own.
//!
//! What is a visit is said at [`Probe::visit_tet`]. Looking, which is no part of an operation, is
//! not counted, nor is what an operation reads a second time while it has it at hand.
//!
//! Cost of counting: a byte of a small table read and a number added to for each visit.

use super::numa::{MAX_NODES, NodeMap};
use super::triangulation::Triangulation;
use super::{TetId, VertexId};

/// What an operation consists of beside visits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// An insertion or removal begins.
    Operation,
    /// Exact predicates.
    Exact(u64),
    /// Tets made.
    Fill(usize),
    /// Facets of a removal, each against the vertices of the link.
    Pairs(usize),
}

/// One who is told of a worker's operations. Each method does nothing unless a probe says
/// otherwise.
pub trait Probe {
    /// Whether it wants to be told of visits: what would be done only to tell it is left out
    /// otherwise.
    const HEARS: bool = true;

    /// Told of work, when it has been done.
    #[inline(always)]
    fn spend(&mut self, _: Effort) {}

    /// Told that the worker is about to ask for a tet that others may ask for, too.
    #[inline(always)]
    fn before_claim(&mut self) {}

    /// Told that the worker is about to give back what others may wait for.
    #[inline(always)]
    fn before_release(&mut self) {}

    /// Told of each tet to which an operation comes: on a walk; tested against the point of a
    /// cavity, once for each facet through which that happens; in the star of a vertex to be
    /// removed or across its link; written.
    #[inline(always)]
    fn visit_tet(&mut self, _: TetId) {}

    /// Told of each vertex whose record an operation comes to, once in each of its parts: on a
    /// walk, taken into a cavity, on the boundary when the star is filled, in the link of a vertex
    /// to be removed.
    #[inline(always)]
    fn visit_vertex(&mut self, _: VertexId) {}

    /// What was counted; `None`: the probe does not count.
    fn visits(&self) -> Option<&Visits> {
        None
    }
}

/// Hears nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    const HEARS: bool = false;
}

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

/// Counts visits.
pub struct CountVisits<'t> {
    nodes: &'t NodeMap,
    visits: Visits,
}

impl<'t> CountVisits<'t> {
    /// Counts from 0.
    pub fn new(triangulation: &'t Triangulation) -> Self {
        Self { nodes: triangulation.node_map(), visits: Visits::default() }
    }
}

impl Probe for CountVisits<'_> {
    #[inline(always)]
    fn visit_tet(&mut self, t: TetId) {
        self.visits.0[usize::from(self.nodes.of_tet(t))] += 1;
    }

    #[inline(always)]
    fn visit_vertex(&mut self, v: VertexId) {
        self.visits.0[usize::from(self.nodes.of_vertex(v))] += 1;
    }

    fn visits(&self) -> Option<&Visits> {
        Some(&self.visits)
    }
}
