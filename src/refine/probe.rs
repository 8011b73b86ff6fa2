//! What a worker tells of beside its operations: inspects tets, and what the image was asked.

use crate::delaunay::probe::{CountVisits, NoProbe, Probe};
use crate::delaunay::{TetId, Triangulation};

/// One who is told of a worker's refinement. Each method does nothing unless a probe says
/// otherwise.
pub trait RefineProbe: Probe {
    /// Told that the worker looks around between two steps, owning nothing.
    #[inline(always)]
    fn pause(&mut self) {}

    /// Told that the worker inspects tet `t`, of which it owns nothing, for what the rules ask.
    #[inline(always)]
    fn inspect(&mut self, _: &Triangulation, _: TetId) {}

    /// Told that so many labels were looked up.
    #[inline(always)]
    fn look_up_labels(&mut self, _: u64) {}

    /// Told that so many crossings of segments with interfaces were looked up.
    #[inline(always)]
    fn look_up_crossings(&mut self, _: u64) {}
}

impl RefineProbe for NoProbe {}

impl RefineProbe for CountVisits<'_> {}
