//! Digging: the cavity of a point is the set of tets whose circumball holds it. It is connected and star-shaped around the point
//! (Bowyer 1981, Watson 1981); with the symbolic perturbation this holds exactly, whatever the degeneracy.

use glam::DVec3;

use super::access::Access;
use super::tet::{FACET, Facet, TetId, VertexId};
use super::triangulation::Triangulation;
use super::worker::Worker;
use crate::geometry::predicates::in_sphere_perturbed;

/// A facet of the cavity's boundary.
#[derive(Clone, Copy, Debug)]
pub struct CavityFacet {
    /// The vertices of the tet inside, whose facet `index` this is: the new tet has the point in place of vertex `index`.
    pub vertices: [VertexId; 4],
    /// Which facet of that tet.
    pub index: usize,
    /// The facet outside, [`Facet::NONE`] on the box.
    pub outside: Facet,
}

/// What came of digging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dig {
    /// `cavity` and `boundary` of the worker are filled, all their vertices owned.
    Done,
    /// Another worker owns a vertex of the cavity.
    Blocked,
    /// The tet to start from is not in conflict with the point.
    NotInConflict,
    /// A vertex lies exactly there already.
    Duplicate,
}

/// Whether `p` is in conflict with tet `t`: the cached sphere first, then the exact predicate. `None` when `p` is a vertex of `t`.
#[inline]
pub(super) fn conflict<A>(worker: &mut Worker<A>, triangulation: &Triangulation, t: TetId, p: DVec3) -> Option<bool> {
    let record = triangulation.tet(t);
    match record.sphere().contains(p) {
        Some(answer) => Some(answer),
        None => {
            worker.counters.exact_predicates += 1;
            let corners = triangulation.corners(record.vertices());
            (!corners.contains(&p)).then(|| in_sphere_perturbed(corners, p))
        }
    }
}

impl<A: Access> Worker<A> {
    fn own_tet(&mut self, triangulation: &Triangulation, t: TetId) -> bool {
        triangulation.tet(t).vertices().iter().all(|&v| self.access.try_own(triangulation, v))
    }

    /// Finds the cavity of `p`, starting from a tet in conflict with it. Marks stay until the tets die or [`Self::undig`].
    pub(super) fn dig(&mut self, triangulation: &Triangulation, start: TetId, p: DVec3) -> Dig {
        self.cavity.clear();
        self.boundary.clear();
        if !self.own_tet(triangulation, start) {
            return Dig::Blocked;
        }
        match conflict(self, triangulation, start, p) {
            None => return Dig::Duplicate,
            Some(false) => return Dig::NotInConflict,
            Some(true) => {}
        }
        self.mark(triangulation, start);
        let mut next = 0;
        while let Some(&t) = self.cavity.get(next) {
            next += 1;
            let record = triangulation.tet(t);
            let vertices = record.vertices();
            for index in 0..4 {
                let outside = record.neighbor(index);
                if !outside.is_none() {
                    let neighbor = outside.tet();
                    if triangulation.tet(neighbor).is_in_cavity() {
                        continue;
                    }
                    match conflict(self, triangulation, neighbor, p) {
                        None => {
                            self.undig(triangulation);
                            return Dig::Duplicate;
                        }
                        Some(true) => {
                            if !self.own_tet(triangulation, neighbor) {
                                self.undig(triangulation);
                                return Dig::Blocked;
                            }
                            self.mark(triangulation, neighbor);
                            continue;
                        }
                        Some(false) => {}
                    }
                }
                self.boundary.push(CavityFacet { vertices, index, outside });
            }
        }
        Dig::Done
    }

    fn mark(&mut self, triangulation: &Triangulation, t: TetId) {
        triangulation.tet(t).set_in_cavity(true);
        // They are tested when the tet's turn comes.
        triangulation.prefetch_neighbors(t);
        self.cavity.push(t);
    }

    /// Takes the marks of an unfinished dig back.
    pub(super) fn undig(&mut self, triangulation: &Triangulation) {
        for &t in &self.cavity {
            triangulation.tet(t).set_in_cavity(false);
        }
        self.cavity.clear();
        self.boundary.clear();
    }
}

impl CavityFacet {
    /// The facet's vertices, the normal pointing into the cavity.
    pub fn facet(&self) -> [VertexId; 3] {
        FACET[self.index].map(|i| self.vertices[i])
    }
}
