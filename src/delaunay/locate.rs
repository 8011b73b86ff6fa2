//! Walking to the tet that holds a point, for callers that know none in conflict with it. Refinement never walks.

use glam::DVec3;

use super::tet::{FACET, TetId};
use super::triangulation::Triangulation;
use crate::geometry::predicates::orient;

impl Triangulation {
    /// The tet that holds `p`, by a visibility walk from `start`: through a facet that separates the tet from `p`, the facets tried
    /// from a different one at each step. In a Delaunay triangulation the visibility walk ends (Edelsbrunner 1990, acyclicity of the in-front relation).
    /// Not to be used while others operate. `p` must lie inside the box.
    pub fn locate(&self, start: TetId, p: DVec3) -> TetId {
        let mut t = start;
        let mut step = 0;
        'walk: loop {
            let record = self.tet(t);
            let vertices = record.vertices();
            for k in 0..4 {
                let i = (k + step) & 3;
                let [a, b, c] = FACET[i].map(|j| self.position(vertices[j]));
                if orient(a, b, c, p) < 0.0 {
                    let neighbor = record.neighbor(i);
                    if !neighbor.is_none() {
                        t = neighbor.tet();
                        step += 1;
                        continue 'walk;
                    }
                }
            }
            return t;
        }
    }
}
