//! Walking to the tet that holds a point, for callers that know none in conflict with it: samples.
//! Circumcenters need no walk.

use glam::DVec3;

use super::locks::Locks;
use super::probe::{NoProbe, Probe};
use super::tet::{FACET, TetId, is_free};
use super::triangulation::Triangulation;
use super::worker::Worker;
use crate::geometry::predicates::orient;

impl Triangulation {
    /// The tet that holds `p`, by a visibility walk from `start`: through a facet that separates
    /// the tet from `p`, the facets tried from the one after that through which the walk came. In a
    /// Delaunay triangulation the visibility walk ends (Edelsbrunner 1990, acyclicity of the
    /// in-front relation). `p` must lie inside the box. While others operate the walk may meet
    /// records that are being rewritten, and its answer is a hint: whether the tet's circumball
    /// holds `p` is to be asked again when it is owned.
    pub fn locate(&self, start: TetId, p: DVec3) -> TetId {
        self.walk(start, p, &mut NoProbe)
    }

    /// The walk, of which `probe` is told.
    #[inline(always)]
    fn walk<P: Probe>(&self, start: TetId, p: DVec3, probe: &mut P) -> TetId {
        let mut t = start;
        // The facet through which the walk came, which it need not try: at first none.
        let mut entry = 3;
        let mut tries = 1..=4;
        'walk: loop {
            let record = self.tet(t);
            self.prefetch_neighbors(record);
            let vertices = record.vertices();
            if is_free(vertices) {
                // Another worker has just freed the slot: the caller finds that out, and begins
                // elsewhere.
                return t;
            }
            if P::HEARS {
                probe.visit_tet(t);
                match tries.end() {
                    4 => vertices.into_iter().for_each(|v| probe.visit_vertex(v)),
                    // It shares the others with the tet before it.
                    _ => probe.visit_vertex(vertices[entry]),
                }
            }
            let corners = self.corners(vertices);
            let arms = corners.map(|corner| corner - p);
            let reach = arms.iter().fold(0.0_f64, |reach, arm| reach.max(arm.abs().max_element()));
            // Six products of three rounded differences, each with at most 8 roundings, 48 units; a
            // third more for the terms of higher order.
            let error = 32.0 * f64::EPSILON * reach * reach * reach;
            for k in tries {
                let i = (entry + k) & 3;
                let [a, b, c] = FACET[i].map(|j| arms[j]);
                let det = a.dot(b.cross(c));
                let beyond = if det.abs() > error {
                    det > 0.0
                } else {
                    let [a, b, c] = FACET[i].map(|j| corners[j]);
                    orient(a, b, c, p) < 0.0
                };
                if beyond {
                    let neighbor = record.neighbor(i);
                    if !neighbor.is_none() {
                        (t, entry) = (neighbor.tet(), neighbor.index());
                        tries = 1..=3;
                        continue 'walk;
                    }
                }
            }
            return t;
        }
    }
}

impl<L: Locks, P: Probe> Worker<L, P> {
    /// [`Triangulation::locate`] as a part of an operation.
    pub fn locate(&mut self, triangulation: &Triangulation, start: TetId, p: DVec3) -> TetId {
        triangulation.walk(start, p, &mut self.probe)
    }
}
