//! Who may touch a vertex: the policy under which a worker operates, a type parameter of the kernel.
//!
//! An operation asks to own every vertex of every tet that it will rewrite, before it writes anything (invariant 4). A refusal ends the operation
//! with *blocked* and nothing changed. Nobody waits while owning.

use super::VertexId;
use super::triangulation::Triangulation;

/// A locking policy.
pub trait Access {
    /// Asks for `vertex` until [`Access::release_all`]; `false` when another worker owns it. Asking twice is fine.
    fn try_own(&mut self, triangulation: &Triangulation, vertex: VertexId) -> bool;

    /// Gives back every vertex.
    fn release_all(&mut self, triangulation: &Triangulation);
}

/// Nobody else is there: one thread refines, locks compile to nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Access for Solo {
    #[inline(always)]
    fn try_own(&mut self, _: &Triangulation, _: VertexId) -> bool {
        true
    }

    #[inline(always)]
    fn release_all(&mut self, _: &Triangulation) {}
}
