//! Filling: Bowyer-Watson insertion. The cavity's tets give way to the star of the new vertex, one tet per boundary facet.
//!
//! Cost: proportional to the cavity (about 20 tets out, 26 in); no walk when the caller knows a tet in conflict, as refinement does.

use glam::DVec3;

use super::access::Access;
use super::cavity::Dig;
use super::tet::{FACET, Facet, TetId, VertexId, VertexKind};
use super::triangulation::Triangulation;
use super::worker::Worker;
use crate::Result;

/// What came of an insertion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Insertion {
    /// The vertex is in; its star is what [`Worker::created`] lists.
    Done(VertexId),
    /// Another worker owned a vertex of the cavity; nothing changed.
    Blocked,
    /// The tet to start from is not in conflict with the point; nothing changed.
    NotInConflict,
    /// A vertex lies exactly there; nothing changed.
    Duplicate,
}

impl<A: Access> Worker<A> {
    /// Inserts `p`, which must lie strictly inside the box, starting from `start`, a living tet whose circumball holds `p`.
    ///
    /// # Errors
    /// [`crate::Error::LimitReached`] when ids run out; nothing changed then.
    pub fn insert(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        kind: VertexKind,
    ) -> Result<Insertion> {
        debug_assert!(triangulation.holds(p));
        let outcome = match self.dig(triangulation, start, p) {
            Dig::Done => Insertion::Done(self.fill_star(triangulation, p, kind)?),
            Dig::Blocked => {
                self.counters.rollbacks += 1;
                Insertion::Blocked
            }
            Dig::NotInConflict => Insertion::NotInConflict,
            Dig::Duplicate => Insertion::Duplicate,
        };
        self.access.release_all(triangulation);
        Ok(outcome)
    }

    fn fill_star(&mut self, triangulation: &Triangulation, p: DVec3, kind: VertexKind) -> Result<VertexId> {
        if let Err(error) = self.reserve(triangulation, self.boundary.len()) {
            self.undig(triangulation);
            return Err(error);
        }
        let apex = self.take_vertex(triangulation, p, kind);
        // What is still needed of the dead tets stands in the boundary records, so that their slots serve the new ones.
        let mut cavity = std::mem::take(&mut self.cavity);
        for &t in &cavity {
            self.give_tet(triangulation, t);
        }
        cavity.clear();
        self.cavity = cavity;

        self.created.clear();
        let boundary = std::mem::take(&mut self.boundary);
        // Every facet has three edges, every edge two facets.
        self.edges.begin(boundary.len() * 3 / 2 + 1);
        for facet in &boundary {
            let t = self.take_tet();
            let mut vertices = facet.vertices;
            vertices[facet.index] = apex;
            triangulation.fill_tet(t, vertices);
            let record = triangulation.tet(t);
            record.set_neighbor(facet.index, facet.outside);
            if !facet.outside.is_none() {
                triangulation.tet(facet.outside.tet()).set_neighbor(facet.outside.index(), Facet::new(t, facet.index));
            }
            let base = FACET[facet.index];
            for k in 0..3 {
                // The facet opposite to base[k] holds the apex and the edge of the other two.
                let side = Facet::new(t, base[k]);
                let edge = (vertices[base[(k + 1) % 3]], vertices[base[(k + 2) % 3]]);
                if let Some(twin) = self.edges.meet(edge.0, edge.1, side) {
                    record.set_neighbor(base[k], twin);
                    triangulation.tet(twin.tet()).set_neighbor(twin.index(), side);
                }
                triangulation.vertex(vertices[base[k]]).set_star(t);
            }
            self.created.push(t);
        }
        triangulation.vertex(apex).set_star(self.created[0]);
        self.boundary = boundary;
        self.counters.insertions += 1;
        Ok(apex)
    }
}
