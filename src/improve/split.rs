//! Splits: an edge inside of a label gets a vertex, which then moves where it helps.
//!
//! Where four vertices of an interface nearly lie in a plane, the tet between them is flat, and
//! nothing that keeps the vertices can help: three of its vertices would have to move. A new vertex
//! on the one edge that is not on the interface, moved away from it, does. So it is for other tets
//! that no reconnection helps (the rare insertions of B. M. Klingner and J. R. Shewchuk,
//! "Aggressive tetrahedral mesh improvement", 2007).
//!
//! The ring of the edge, n tets, becomes 2 n tets around the new vertex. The vertex starts in the
//! middle of the edge and is moved as in [`smoothing`](super::smoothing); if the least measure does
//! not rise above that of the ring, nothing is done.

use glam::DVec3;

use super::ring::{self, Around, MAX_RING, Ring};
use super::star::Star;
use super::worker::{Outcome, Worker};
use crate::mesh::NONE;

impl Worker<'_, '_> {
    /// Splits the edge of a tet by which the tets around it get best, if they get better than they
    /// are.
    pub fn split(&mut self, t: u32) -> Outcome {
        let mut star = std::mem::take(&mut self.star);
        let mut outcome = Outcome::Failed;
        for edge in self.edges_by_angle(t) {
            let ring = match ring::around(&self.round.shared, t, edge, |tet| self.owns(tet)) {
                Around::Ring(ring) => ring,
                Around::Foreign => {
                    outcome = Outcome::Foreign;
                    continue;
                }
                Around::Open => continue,
            };
            if ring.labels[..ring.len].iter().any(|&label| label != ring.labels[0]) {
                continue;
            }
            match self.split_ring(&ring, &mut star) {
                Outcome::Done => {
                    outcome = Outcome::Done;
                    break;
                }
                Outcome::Foreign => outcome = Outcome::Foreign,
                Outcome::Failed => {}
            }
        }
        self.star = star;
        outcome
    }

    fn split_ring(&mut self, ring: &Ring, star: &mut Star) -> Outcome {
        let old =
            (0..ring.len).map(|i| self.measure_of(ring.tets[i])).fold(f64::INFINITY, f64::min);
        self.star_of_split(ring, star);
        let [a, b] = ring.ends.map(|v| self.point(v));
        let middle = (a + b) / 2.0;
        let ring_points = ring.vertices[..ring.len].iter().map(|&v| self.point(v));
        let center = ring_points.sum::<DVec3>() / ring.len as f64;
        let starts = [middle.lerp(center, 0.5), middle, center];
        let above = self.to_exceed(old);
        let Some(at) = starts.into_iter().find_map(|start| self.best_inside(star, start, above))
        else {
            return Outcome::Failed;
        };
        if self.room() < ring.len {
            return Outcome::Foreign;
        }
        let Some(vertex) = self.take_vertex(at) else { return Outcome::Foreign };
        self.carry_out_split(ring, vertex);
        self.counts.splits += 1;
        Outcome::Done
    }

    /// The star of the vertex that would split the edge of a ring.
    fn star_of_split(&self, ring: &Ring, star: &mut Star) {
        star.clear(NONE);
        let [a, b] = ring.ends;
        for i in 0..ring.len {
            let [r, s] = [i, (i + 1) % ring.len].map(|i| ring.vertices[i]);
            for link in [[a, s, r], [b, r, s]] {
                star.links.push(link);
                star.points.push(link.map(|v| self.point(v)));
                star.labels.push(ring.labels[i]);
            }
        }
    }

    /// Replaces the tets (a, b, r, s) of a ring by (a, m, r, s) in the same slot and (m, b, r, s)
    /// in another one.
    fn carry_out_split(&mut self, ring: &Ring, m: u32) {
        let [a, b] = ring.ends;
        let mut upper = [NONE; MAX_RING];
        for slot in &mut upper[..ring.len] {
            *slot = self.take_slot().unwrap_or(NONE);
        }
        let shared = &self.round.shared;
        for i in 0..ring.len {
            let (t, new) = (ring.tets[i], upper[i]);
            let [r, s] = [i, (i + 1) % ring.len].map(|i| ring.vertices[i]);
            let old = shared.tet(t);
            let facet_of = |v: u32| (0..4).find(|&n| old[n] == v).unwrap_or(0);
            // Across the facet opposite to a: it becomes the new tet's.
            let beyond = shared.neighbor(t, facet_of(a));
            let back = if beyond == NONE { None } else { shared.facet_to(beyond, t) };
            let below = shared.neighbor(t, facet_of(b));
            let back_below = if below == NONE { None } else { shared.facet_to(below, t) };
            let [before, after] = [(i + ring.len - 1) % ring.len, (i + 1) % ring.len];
            shared.put(t, [a, m, r, s], ring.labels[i]);
            shared.put(new, [m, b, r, s], ring.labels[i]);
            // Opposite to a, m, r, s; the tet after this one in the ring is across the facet
            // without r.
            for (facet, other) in
                [new, below, ring.tets[after], ring.tets[before]].into_iter().enumerate()
            {
                shared.set_neighbor(t, facet, other);
            }
            for (facet, other) in [beyond, t, upper[after], upper[before]].into_iter().enumerate() {
                shared.set_neighbor(new, facet, other);
            }
            if let Some(back) = back {
                shared.set_neighbor(beyond, back, new);
            }
            if let Some(back) = back_below {
                shared.set_neighbor(below, back, t);
            }
        }
        for i in 0..ring.len {
            self.enqueue(ring.tets[i]);
            self.enqueue(upper[i]);
        }
    }
}
