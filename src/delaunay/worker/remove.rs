//! Removal of a vertex: its star is taken out and the hole filled with tets of the Delaunay
//! triangulation of its link.
//!
//! Every tet that fills the hole has its vertices in the link (Devillers and Teillaud 2003), so the
//! hole is filled by wrapping: for an open facet, of all link vertices on its inner side, the one
//! whose circumsphere through the facet holds none of the others. The perturbation makes that
//! vertex unique, and the tets of all facets fit together.
//!
//! # Finding the apex
//! Spheres through a facet have their centres on its axis, at o + s n (o: circumcenter of the
//! facet, n: its inward normal); the empty one has the smallest s. For a link vertex e, q = e - a:
//! s = (|q|^2 - 2 q . (o - a)) / (2 n . q). Each s is computed with an error bound; vertices whose
//! intervals overlap the best go to the exact predicates.
//!
//! Cost: facets times link vertices, some 20 times 15 pairs of a few nanoseconds.

use glam::DVec3;

use super::Worker;
use crate::delaunay::locks::Locks;
use crate::delaunay::ownership::{Claim, Holder};
use crate::delaunay::probe::{Effort, Probe};
use crate::delaunay::tet::{FACET, Facet, TetId, VertexId, VertexKind};
use crate::delaunay::triangulation::Triangulation;
use crate::geometry::predicates::{in_sphere_perturbed, orient};
use crate::{Error, Result};

/// What came of a removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Removal {
    /// The vertex is out; the tets that fill its place are what [`Worker::created`] lists.
    Done,
    /// Another worker owned a tet of the star, or one beside it; nothing changed.
    Blocked,
    /// The vertex was removed before.
    Stale,
}

/// What lies on the other side of a facet of a new tet.
#[derive(Clone, Copy)]
enum Side {
    Outside(Facet),
    New { tet: usize, index: usize },
}

/// A facet of the hole that no new tet touches yet. Vertices are indices into the link, the normal
/// points into the hole.
#[derive(Clone, Copy)]
struct OpenFacet {
    vertices: [usize; 3],
    key: u64,
    behind: Side,
}

struct NewTet {
    vertices: [usize; 4],
    sides: [Side; 4],
}

/// Scratch of a removal.
#[derive(Default)]
pub struct LinkScratch {
    vertices: Vec<VertexId>,
    positions: Vec<DVec3>,
    open: Vec<OpenFacet>,
    tets: Vec<NewTet>,
    close_calls: Vec<usize>,
}

/// The same for a facet's vertices in any order, and another for any other facet: indices into a
/// link are far below 2^21, as ids of tets are below 2^32.
fn key(vertices: [usize; 3]) -> u64 {
    let mut sorted = vertices;
    sorted.sort_unstable();
    sorted.into_iter().fold(0, |key, v| key << 21 | v as u64)
}

impl LinkScratch {
    fn index_of(&mut self, triangulation: &Triangulation, v: VertexId) -> usize {
        match self.vertices.iter().position(|&w| w == v) {
            Some(i) => i,
            None => {
                self.vertices.push(v);
                self.positions.push(triangulation.position(v));
                self.vertices.len() - 1
            }
        }
    }

    /// The link vertex that makes the Delaunay tet on the inner side of a facet.
    fn apex(&mut self, facet: [usize; 3], exact_predicates: &mut u64) -> Option<usize> {
        const UNIT: f64 = f64::EPSILON;
        let [a, b, c] = facet.map(|i| self.positions[i]);
        let (u, v) = (b - a, c - a);
        let n = u.cross(v);
        let (uu, vv, nn) = (u.length_squared(), v.length_squared(), n.length_squared());
        // A facet too thin for f64 leaves its vertices' order to the exact predicates: every
        // interval is then infinite.
        let o = (uu * v.cross(n) + vv * n.cross(u)) * (0.5 / nn);
        let condition = uu * vv / nn;
        let (o_length, n_error) = (o.length() * condition, 16.0 * UNIT * (uu * vv).sqrt());
        let mut best = f64::INFINITY;
        self.close_calls.clear();
        let (squared_o, squared_n_error) = (o_length * o_length, n_error * n_error);
        // Whether e is certainly outside of the best sphere, that is s > best, multiplied by 2 dot
        // to be spared a root and a quotient. The numerator's error is at most 128 UNIT |q| (|q| +
        // o_length), and what that of the dot product makes of the other side is a FAR-th of it;
        // where that side is the larger one by far, the difference is as large.
        let is_outside = |q: DVec3, best: f64| {
            const FAR: f64 = (1_u64 << 20) as f64;
            let (dot, qq) = (n.dot(q), q.length_squared());
            let numerator = qq - 2.0 * q.dot(o);
            let error = 128.0 * UNIT * (2.0 * qq + squared_o) + (8.0 / FAR) * numerator.abs();
            dot > 0.0
                && dot * dot > FAR * FAR * squared_n_error * qq
                && numerator - 2.0 * best * dot > error
        };
        let bounds = |q: DVec3| -> Option<(f64, f64)> {
            let (dot, q_length) = (n.dot(q), q.length());
            let dot_error = n_error * q_length;
            if dot < -dot_error {
                return None;
            }
            let numerator = q_length * q_length - 2.0 * q.dot(o);
            let s = numerator / (2.0 * dot);
            let error =
                (64.0 * UNIT * q_length * (q_length + o_length) + 2.0 * s.abs() * dot_error) / dot;
            // Written so that a NaN (thin facet) and a point near the facet's plane give the
            // infinite interval.
            if dot > 4.0 * dot_error && error.is_finite() {
                Some((s - error, s + error))
            } else {
                Some((f64::NEG_INFINITY, f64::INFINITY))
            }
        };
        for (i, &e) in self.positions.iter().enumerate() {
            if facet.contains(&i) || is_outside(e - a, best) {
                continue;
            }
            let Some((low, high)) = bounds(e - a) else { continue };
            if low <= best {
                self.close_calls.push(i);
                best = best.min(high);
            }
        }
        let positions = &self.positions;
        self.close_calls.retain(|&i| bounds(positions[i] - a).is_some_and(|(low, _)| low <= best));
        if let [only] = self.close_calls[..]
            && best.is_finite()
        {
            return Some(only);
        }
        let mut apex: Option<usize> = None;
        for &i in &self.close_calls {
            let e = positions[i];
            *exact_predicates += 1;
            if orient(a, b, c, e) <= 0.0 {
                continue;
            }
            let better = apex.is_none_or(|d| {
                *exact_predicates += 1;
                in_sphere_perturbed([a, b, c, positions[d]], e)
            });
            if better {
                apex = Some(i);
            }
        }
        apex
    }

    /// Fills the hole: afterwards `tets` holds the new tets, all sides known.
    fn wrap(&mut self, exact_predicates: &mut u64) -> Result<()> {
        self.tets.clear();
        // A triangulation of k points has fewer tets than pairs of points.
        let limit = self.positions.len() * self.positions.len();
        while let Some(facet) = self.open.pop() {
            let apex = self.apex(facet.vertices, exact_predicates);
            let (Some(apex), true) = (apex, self.tets.len() < limit) else {
                return Err(Error::Internal(
                    "the link of a removed vertex has no Delaunay triangulation".into(),
                ));
            };
            let tet = self.tets.len();
            let [a, b, c] = facet.vertices;
            let vertices = [a, b, c, apex];
            self.tets.push(NewTet { vertices, sides: [facet.behind; 4] });
            self.connect(facet.behind, Side::New { tet, index: 3 });
            for index in 0..3 {
                let [x, y, z] = FACET[index].map(|k| vertices[k]);
                let side = Side::New { tet, index };
                // Seen from the rest of the hole the facet faces the other way.
                let seen = OpenFacet { vertices: [x, z, y], key: key([x, y, z]), behind: side };
                match self.open.iter().position(|f| f.key == seen.key) {
                    Some(at) => {
                        let met = self.open.swap_remove(at);
                        self.tets[tet].sides[index] = met.behind;
                        self.connect(met.behind, side);
                    }
                    None => self.open.push(seen),
                }
            }
        }
        Ok(())
    }

    fn connect(&mut self, side: Side, to: Side) {
        if let Side::New { tet, index } = side {
            self.tets[tet].sides[index] = to;
        }
    }
}

impl<L: Locks, P: Probe> Worker<L, P> {
    /// Removes vertex `v`, no corner of the box.
    ///
    /// # Errors
    /// [`Error::LimitReached`] when ids run out, [`Error::Internal`] when the link cannot be
    /// triangulated; nothing changed then.
    pub fn remove(&mut self, triangulation: &Triangulation, v: VertexId) -> Result<Removal> {
        self.remove_and(triangulation, v, |_| {})
    }

    /// As [`Self::remove`], with others at work: `note` is told the tets that fill the place while
    /// nobody else can have come to them.
    ///
    /// # Errors
    /// As [`Self::remove`].
    pub fn remove_and(
        &mut self,
        triangulation: &Triangulation,
        v: VertexId,
        note: impl FnOnce(&[TetId]),
    ) -> Result<Removal> {
        self.probe.spend(Effort::Operation);
        loop {
            self.probe.visit_vertex(v);
            if triangulation.vertex(v).kind() == VertexKind::Removed {
                return Ok(Removal::Stale);
            }
            match self.gather_star(triangulation, v) {
                Claim::Acquired => break,
                Claim::Conflict(_) => {
                    self.roll_back(triangulation);
                    self.counters.rollbacks += 1;
                    return Ok(Removal::Blocked);
                }
                // Others have rewritten the star, or what is around it: the vertex names another
                // tet, or has been removed.
                Claim::Stale => self.roll_back(triangulation),
                Claim::Owned => {
                    self.roll_back(triangulation);
                    return Err(Error::Internal("a tet of a vertex's star is its own link".into()));
                }
            }
        }
        let mut link = std::mem::take(&mut self.link);
        let exact = self.counters.exact_predicates;
        let filled = link
            .wrap(&mut self.counters.exact_predicates)
            .and_then(|()| self.reserve(triangulation, link.tets.len()));
        self.probe.spend(Effort::Exact(self.counters.exact_predicates - exact));
        self.probe.spend(Effort::Pairs(2 * link.tets.len() * link.positions.len()));
        self.probe.spend(Effort::Fill(link.tets.len()));
        match filled {
            Ok(()) => {
                self.sew(triangulation, &link);
                triangulation.vertex(v).set_removed();
                self.counters.removals += 1;
                note(&self.created);
                self.end_operation(triangulation);
            }
            Err(_) => self.roll_back(triangulation),
        }
        self.link = link;
        filled.map(|()| Removal::Done)
    }

    /// Collects the star of `v` into `cavity`, owning its tets, and its link into the scratch.
    /// [`Claim::Acquired`]: all are owned, and the tets around are nobody's. Otherwise the star is
    /// not complete, and what is owned of it is in `cavity`.
    fn gather_star(&mut self, triangulation: &Triangulation, v: VertexId) -> Claim {
        self.cavity.clear();
        let mut link = std::mem::take(&mut self.link);
        link.vertices.clear();
        link.positions.clear();
        link.open.clear();
        let claim = self.gather(triangulation, v, &mut link);
        link.vertices.iter().for_each(|&w| self.probe.visit_vertex(w));
        self.link = link;
        claim
    }

    fn gather(
        &mut self,
        triangulation: &Triangulation,
        v: VertexId,
        link: &mut LinkScratch,
    ) -> Claim {
        let start = triangulation.vertex(v).star();
        let claim = self.try_own(triangulation.owner(start));
        if claim != Claim::Acquired {
            return claim;
        }
        self.cavity.push(Facet::new(start, 0));
        if L::SHARED && !triangulation.tet(start).vertices().contains(&v) {
            return Claim::Stale;
        }
        let mut next = 0;
        while let Some(entry) = self.cavity.get(next) {
            next += 1;
            self.probe.visit_tet(entry.tet());
            let record = triangulation.tet(entry.tet());
            let vertices = record.vertices();
            for index in 0..4 {
                let neighbor = record.neighbor(index);
                let is_of_link = vertices[index] == v;
                // Facets of the link may lie on the box, those between tets of the star do not.
                if !neighbor.is_none() {
                    let other = triangulation.tet(neighbor.tet());
                    match self.inspect_across(record, index, neighbor, other) {
                        Holder::Unowned => {}
                        Holder::Own if !is_of_link => continue,
                        holder => return holder.into(),
                    }
                    if !is_of_link {
                        let claim = self.try_own(other.owner());
                        if claim != Claim::Acquired {
                            return claim;
                        }
                        self.cavity.push(neighbor);
                    }
                }
                if is_of_link {
                    let facet = FACET[index].map(|k| link.index_of(triangulation, vertices[k]));
                    link.open.push(OpenFacet {
                        vertices: facet,
                        key: key(facet),
                        behind: Side::Outside(neighbor),
                    });
                }
            }
        }
        Claim::Acquired
    }

    /// Writes the tets that fill the hole, for which there is room.
    fn sew(&mut self, triangulation: &Triangulation, link: &LinkScratch) {
        self.exchange_slots(triangulation, link.tets.len());
        let slots = &self.created;
        for (&t, new) in slots.iter().zip(&link.tets) {
            let vertices = new.vertices.map(|i| link.vertices[i]);
            self.probe.visit_tet(t);
            triangulation.fill_tet(t, vertices, self.mark, self.locks.owner_of_new());
            for (index, side) in new.sides.iter().enumerate() {
                let neighbor = match *side {
                    Side::Outside(outside) => outside,
                    Side::New { tet, index } => Facet::new(slots[tet], index),
                };
                triangulation.tet(t).set_neighbor(index, neighbor);
                // The link back comes last: who comes by it finds this one.
                if let Side::Outside(outside) = *side
                    && !outside.is_none()
                {
                    self.probe.visit_tet(outside.tet());
                    triangulation
                        .tet(outside.tet())
                        .set_neighbor(outside.index(), Facet::new(t, index));
                }
            }
            for v in vertices {
                triangulation.vertex(v).set_star(t);
            }
        }
    }
}
