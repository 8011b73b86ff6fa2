//! Digging: the cavity of a point is the set of tets whose circumball holds it. It is connected and
//! star-shaped around the point (Bowyer 1981, Watson 1981); with the symbolic perturbation this
//! holds exactly, whatever the degeneracy.

use glam::DVec3;

use super::Worker;
use crate::delaunay::locks::Locks;
use crate::delaunay::ownership::{Claim, Holder};
use crate::delaunay::probe::{Effort, Probe};
use crate::delaunay::tet::{FACET, Facet, TetId, TetRecord, VertexId};
use crate::delaunay::triangulation::Triangulation;

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
    /// `cavity` and `boundary` of the worker are filled, the tets of the cavity owned, and those
    /// beside it nobody's.
    Done,
    /// Another worker owns a tet of the cavity, or one beside it.
    Blocked,
    /// The tet to start from is no longer what the caller took it for, or another one changed
    /// meanwhile.
    Stale,
    /// The tet to start from is not in conflict with the point.
    NotInConflict,
    /// A vertex lies exactly there already.
    Duplicate,
}

impl<L: Locks, P: Probe> Worker<L, P> {
    /// Whether `p` is in conflict with a tet: the cached sphere first, then the exact predicate.
    /// `None` when `p` is a vertex of it.
    #[inline(always)]
    fn conflict(
        &mut self,
        triangulation: &Triangulation,
        tet: &TetRecord,
        p: DVec3,
    ) -> Option<bool> {
        self.counters.in_sphere_tests += 1;
        let answer = tet.sphere().contains(p);
        if answer.is_some() { answer } else { self.exact_conflict(triangulation, tet, p) }
    }

    #[cold]
    fn exact_conflict(
        &mut self,
        triangulation: &Triangulation,
        tet: &TetRecord,
        p: DVec3,
    ) -> Option<bool> {
        self.counters.exact_predicates += 1;
        self.probe.spend(Effort::Exact(1));
        triangulation.exact_conflict(tet.vertices(), p)
    }

    /// Finds the cavity of `p`, starting from a tet in conflict with it. Its tets are owned then,
    /// and are not if it ends otherwise. With others at work, `holds` is asked, when the first tet
    /// is owned and its neighbours cannot change either, whether what the caller knows of them is
    /// still true.
    pub(super) fn dig(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        holds: impl FnOnce() -> bool,
    ) -> Dig {
        debug_assert!(triangulation.holds(p));
        self.cavity.clear();
        self.boundary.clear();
        let mut end = self.come_in(triangulation, start, p, holds);
        if end == Dig::Done {
            end = self.spread(triangulation, start, p);
        }
        if end != Dig::Done {
            self.roll_back(triangulation);
        }
        end
    }

    /// Comes to own the first tet; see `ownership`, the way in.
    fn come_in(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        holds: impl FnOnce() -> bool,
    ) -> Dig {
        let first = triangulation.tet(start);
        let claim = self.try_own(first.owner());
        if claim != Claim::Acquired {
            return given_up(claim);
        }
        // Through no facet did one come to it. Facet 0 stands for it.
        self.take_in(triangulation, Facet::new(start, 0), first);
        if P::HEARS {
            first.vertices().into_iter().for_each(|v| self.probe.visit_vertex(v));
        }
        if L::SHARED {
            for index in 0..4 {
                let outside = first.neighbor(index);
                if outside.is_none() {
                    continue;
                }
                let holder =
                    self.inspect_across(first, index, outside, triangulation.tet(outside.tet()));
                if holder != Holder::Unowned {
                    return given_up(holder.into());
                }
            }
            if !holds() {
                return Dig::Stale;
            }
        }
        self.probe.visit_tet(start);
        match self.conflict(triangulation, first, p) {
            None => Dig::Duplicate,
            Some(false) => Dig::NotInConflict,
            Some(true) => Dig::Done,
        }
    }

    /// Whose the tet `other` across facet `index` of an owned one is, to which the link `outside`
    /// leads. If it is nobody's, neither the tet nor the link changes as long as the first is
    /// owned.
    #[inline(always)]
    pub(super) fn inspect_across(
        &mut self,
        record: &TetRecord,
        index: usize,
        outside: Facet,
        other: &TetRecord,
    ) -> Holder {
        let holder = self.locks.inspect_across(other.owner());
        // What was inspected might be another tet's slot by now.
        let changed = L::SHARED && holder == Holder::Unowned && record.neighbor(index) != outside;
        if changed { Holder::Changed } else { holder }
    }

    /// Digs from a first tet of the cavity, breadth first: between its mark and its turn a tet's
    /// neighbours come into the cache.
    fn spread(&mut self, triangulation: &Triangulation, start: TetId, p: DVec3) -> Dig {
        // Facet 0 of the first tet is looked through here.
        let mut end = self.inspect_facet(triangulation, triangulation.tet(start), 0, p);
        let mut next = 0;
        while let (Dig::Done, Some(&entry)) = (end, self.cavity.get(next)) {
            next += 1;
            let record = triangulation.tet(entry.tet());
            for k in 1..4 {
                end = self.inspect_facet(triangulation, record, (entry.index() + k) % 4, p);
                if end != Dig::Done {
                    break;
                }
            }
        }
        end
    }

    /// Asks the tet across facet `index` of a tet of the cavity of `p`: either it is one of the
    /// cavity too, or the facet one of the boundary.
    #[inline(always)]
    fn inspect_facet(
        &mut self,
        triangulation: &Triangulation,
        record: &TetRecord,
        index: usize,
        p: DVec3,
    ) -> Dig {
        let outside = record.neighbor(index);
        if !outside.is_none() {
            // Looked up once: the compiler may not assume that a second time would give the same.
            let other = triangulation.tet(outside.tet());
            match self.inspect_across(record, index, outside, other) {
                Holder::Unowned => {}
                Holder::Own => return Dig::Done,
                holder => return given_up(holder.into()),
            }
            self.probe.visit_tet(outside.tet());
            match self.conflict(triangulation, other, p) {
                None => return Dig::Duplicate,
                Some(true) => {
                    if P::HEARS {
                        // It shares its other vertices with the tet before it.
                        self.probe.visit_vertex(other.vertex(outside.index()));
                    }
                    let claim = self.try_own(other.owner());
                    if claim != Claim::Acquired {
                        return given_up(claim);
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

    /// Takes `tet`, which is owned, into the cavity; it was found through facet `entry` of it.
    #[inline(always)]
    fn take_in(&mut self, triangulation: &Triangulation, entry: Facet, tet: &TetRecord) {
        // The neighbours are tested when the tet's turn comes, the rest is needed when the star is
        // filled.
        triangulation.prefetch_neighbors(tet);
        triangulation.prefetch_rest(tet, entry.index());
        self.cavity.push(entry);
    }
}

/// How a dig ends that was refused a tet.
#[cold]
fn given_up(claim: Claim) -> Dig {
    if matches!(claim, Claim::Conflict(_)) { Dig::Blocked } else { Dig::Stale }
}
