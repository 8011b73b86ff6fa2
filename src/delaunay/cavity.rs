//! Digging: the cavity of a point is the set of tets whose circumball holds it. It is connected and star-shaped around the point
//! (Bowyer 1981, Watson 1981); with the symbolic perturbation this holds exactly, whatever the degeneracy.

use glam::DVec3;

use super::access::{Access, Effort};
use super::tet::{FACET, Facet, TetId, TetRecord, VertexId, is_free};
use super::triangulation::Triangulation;
use super::worker::Worker;
use crate::geometry::predicates::in_sphere_perturbed;

/// A facet of the cavity's boundary.
#[derive(Clone, Copy, Debug)]
pub struct CavityFacet {
    /// Its vertices, the normal pointing into the cavity: with the point they make a positive tet.
    pub vertices: [VertexId; 3],
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
    /// The tet to start from is no longer what the caller took it for.
    Stale,
    /// The tet to start from is not in conflict with the point.
    NotInConflict,
    /// A vertex lies exactly there already.
    Duplicate,
}

impl<A: Access> Worker<A> {
    /// Comes to own a tet of which nothing is owned yet; see `ownership`, the way in.
    fn own_first(&mut self, triangulation: &Triangulation, t: TetId) -> Dig {
        if !(A::SHARED || A::HEARS) {
            return Dig::Done;
        }
        let vertices = triangulation.tet(t).vertices();
        if is_free(vertices) {
            return Dig::Stale;
        }
        vertices.into_iter().for_each(|v| self.access.visit_vertex(v));
        if !vertices.iter().all(|&v| self.access.try_own(triangulation, v)) {
            return Dig::Blocked;
        }
        if triangulation.tet(t).vertices() == vertices { Dig::Done } else { Dig::Stale }
    }

    /// Whether `p` is in conflict with a tet: the cached sphere first, then the exact predicate. `None` when `p` is a vertex of it.
    #[inline(always)]
    fn conflict(&mut self, triangulation: &Triangulation, tet: &TetRecord, p: DVec3) -> Option<bool> {
        self.counters.in_sphere_tests += 1;
        let answer = tet.sphere().contains(p);
        if answer.is_some() { answer } else { self.exact_conflict(triangulation, tet, p) }
    }

    #[cold]
    fn exact_conflict(&mut self, triangulation: &Triangulation, tet: &TetRecord, p: DVec3) -> Option<bool> {
        self.counters.exact_predicates += 1;
        self.access.spend(Effort::Exact(1));
        let corners = triangulation.corners(tet.vertices());
        (!corners.contains(&p)).then(|| in_sphere_perturbed(corners, p))
    }

    /// Finds the cavity of `p`, starting from a tet in conflict with it. Marks stay until the tets die or [`Self::undig`]. With others at work, `holds` is asked, when
    /// the first tet is owned, whether what the caller knows of it is still true.
    pub(super) fn dig(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        holds: impl FnOnce() -> bool,
    ) -> Dig {
        self.cavity.clear();
        self.boundary.clear();
        match self.own_first(triangulation, start) {
            Dig::Done => {}
            end => return end,
        }
        if A::SHARED && !holds() {
            return Dig::Stale;
        }
        debug_assert!(triangulation.holds(p));
        self.access.visit_tet(start);
        match self.conflict(triangulation, triangulation.tet(start), p) {
            None => return Dig::Duplicate,
            Some(false) => return Dig::NotInConflict,
            Some(true) => {}
        }
        let end = self.spread(triangulation, start, p);
        if end != Dig::Done {
            self.undig(triangulation);
        }
        end
    }

    /// Digs from a first tet of the cavity, breadth first: between its mark and its turn a tet's neighbours come into the cache.
    fn spread(&mut self, triangulation: &Triangulation, start: TetId, p: DVec3) -> Dig {
        // Through no facet did one come to the first tet. Facet 0 stands for it, and is looked through here.
        let first = triangulation.tet(start);
        self.take_in(triangulation, Facet::new(start, 0), first);
        let mut end = self.look_through(triangulation, first, 0, p);
        let mut next = 0;
        while let (Dig::Done, Some(&entry)) = (end, self.cavity.get(next)) {
            next += 1;
            let record = triangulation.tet(entry.tet());
            for k in 1..4 {
                end = self.look_through(triangulation, record, (entry.index() + k) % 4, p);
                if end != Dig::Done {
                    break;
                }
            }
        }
        end
    }

    /// Asks the tet across facet `index` of a tet of the cavity of `p`: either it is one of the cavity too, or the facet one of the boundary.
    #[inline(always)]
    fn look_through(&mut self, triangulation: &Triangulation, record: &TetRecord, index: usize, p: DVec3) -> Dig {
        let outside = record.neighbor(index);
        if !outside.is_none() {
            // Looked up once: the compiler may not assume that a second time would give the same.
            let other = triangulation.tet(outside.tet());
            if other.is_in_cavity() {
                return Dig::Done;
            }
            self.access.visit_tet(outside.tet());
            match self.conflict(triangulation, other, p) {
                None => return Dig::Duplicate,
                Some(true) => {
                    // It shares its other vertices with a tet that is owned.
                    let opposite = other.vertex(outside.index());
                    self.access.visit_vertex(opposite);
                    if !self.access.try_own(triangulation, opposite) {
                        return Dig::Blocked;
                    }
                    self.take_in(triangulation, outside, other);
                    return Dig::Done;
                }
                Some(false) => {}
            }
        }
        let vertices = record.vertices();
        self.boundary.push(CavityFacet { vertices: FACET[index].map(|k| vertices[k]), outside });
        Dig::Done
    }

    /// Takes `tet` into the cavity, found through facet `entry` of it.
    #[inline(always)]
    fn take_in(&mut self, triangulation: &Triangulation, entry: Facet, tet: &TetRecord) {
        tet.set_in_cavity(true);
        // The neighbours are tested when the tet's turn comes, the rest is needed when the star is filled.
        triangulation.prefetch_neighbors(tet);
        triangulation.prefetch_rest(tet, entry.index());
        self.cavity.push(entry);
    }

    /// Takes the marks of an unfinished dig back.
    pub(super) fn undig(&mut self, triangulation: &Triangulation) {
        for entry in &self.cavity {
            triangulation.tet(entry.tet()).set_in_cavity(false);
        }
        self.cavity.clear();
        self.boundary.clear();
    }
}
