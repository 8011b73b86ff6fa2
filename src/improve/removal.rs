//! Edge removal: the tets around an edge are replaced by others that do without it.
//!
//! *Inside* a label any division of the ring will do (see [`ring`](super::ring)).
//!
//! *On an interface*, where just two of the facets around edge ab are interface facets, abc and
//! abd, these become acd and bcd: the edge is flipped on the interface. The ring's polygon is
//! divided along the chord cd, and each of its two parts keeps its label. A part with a single tet
//! vanishes. That is the case that matters most: two nearly coplanar interface facets, closed by
//! one flat tet, that no change inside of a label can help.
//!
//! What keeps the interface where it is:
//! - ab and cd are no farther apart than the tolerance, or cd is closer to the image's interface
//!   than ab was;
//! - the new facets have the angles that were asked for;
//! - the image has the two labels on the two sides of the new facets, within the facet distance of
//!   refinement;
//! - both old facets lie on the same walls of the image, or on none: edges of walls stay;
//! - no new facet is off a wall that it should lie on, where none was before.
//!
//! What keeps the topology: where a part has a single tet, cd was an edge before. No interface may
//! pass through it, or the two would touch there. Anywhere else cd cannot have been an edge,
//! because it runs through the ring.

use glam::DVec3;

use super::ring::{self, Around, Division, EDGES, MAX_RING, Ring, RingPoints};
use super::star::Collected;
use super::worker::{Outcome, Worker};
use crate::Error;
use crate::mesh::NONE;

/// A flip farther than the tolerance, but toward the image's interface, may be this many times as
/// far.
const FARTHEST_FLIP: f64 = 5.0;

/// A way to do without an edge.
struct Removal {
    ring: Ring,
    division: Division,
    /// On an interface: the places of the chord's ends in the ring.
    chord: Option<[usize; 2]>,
}

impl Worker<'_, '_> {
    /// Removes the edge of a tet with whose removal the tets around it get best, if they get better
    /// than they are: the first edge by which they reach the target.
    pub fn reconnect(&mut self, t: u32) -> Outcome {
        let is_background = self.round.shared.label(t) == 0;
        let mut outcome = Outcome::Failed;
        let mut rings: [Option<Ring>; 6] = [None; 6];
        // Most edges are removed with all tets at the target: how good those around them are does
        // not matter then.
        for (edge, to) in self.edges_by_angle(t).into_iter().zip(&mut rings) {
            let ring = match ring::around(&self.round.shared, t, edge, |tet| self.owns(tet)) {
                Around::Ring(ring) => ring,
                Around::Foreign => {
                    outcome = Outcome::Foreign;
                    continue;
                }
                Around::Open => continue,
            };
            let found = match is_background {
                true => self.background_removal(&ring, t),
                false => self.removal(&ring, self.round.measure.target),
            };
            match found {
                Ok(removal) if self.carry_out(&removal) => return Outcome::Done,
                Ok(_) | Err(Outcome::Foreign) => outcome = Outcome::Foreign,
                Err(_) => *to = Some(ring),
            }
        }
        if is_background {
            return outcome;
        }
        let mut best: Option<Removal> = None;
        for ring in rings.iter().flatten() {
            let above = best.as_ref().map_or(0.0, |removal| removal.division.min);
            match self.removal(ring, above.max(self.to_exceed(self.min_of(ring)))) {
                Ok(removal) => best = Some(removal),
                Err(Outcome::Foreign) => outcome = Outcome::Foreign,
                Err(_) => {}
            }
        }
        match best {
            Some(removal) if self.carry_out(&removal) => Outcome::Done,
            Some(_) => Outcome::Foreign,
            None => outcome,
        }
    }

    /// Reconnects flat tets of the background around the vertices of a tet, so that these can be
    /// moved: no tet of the background may be inverted.
    pub fn make_way(&mut self, t: u32) -> Outcome {
        let mut star = std::mem::take(&mut self.star);
        let mut outcome = Outcome::Failed;
        for v in self.round.shared.tet(t) {
            match star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) {
                Collected::Star => {}
                Collected::Foreign if outcome == Outcome::Failed => outcome = Outcome::Foreign,
                _ => continue,
            }
            for (&at, &label) in star.tets.iter().zip(&star.labels) {
                let shared = &self.round.shared;
                // An earlier one may have taken this one's place.
                let is_there = shared.tet(at)[0] != NONE && shared.label(at) == 0;
                if label == 0
                    && is_there
                    && self.measure_of(at) < self.round.measure.target
                    && self.reconnect_background(at)
                {
                    outcome = Outcome::Done;
                }
            }
        }
        self.star = star;
        outcome
    }

    /// Removes an edge of a tet of the background inside of it, if that makes the tets there
    /// better.
    fn reconnect_background(&mut self, t: u32) -> bool {
        for edge in self.edges_by_angle(t) {
            let Around::Ring(ring) =
                ring::around(&self.round.shared, t, edge, |tet| self.owns(tet))
            else {
                continue;
            };
            if ring.labels[..ring.len].iter().any(|&label| label != 0) {
                continue;
            }
            let old =
                (0..ring.len).map(|i| self.measure_of(ring.tets[i])).fold(f64::INFINITY, f64::min);
            let places: [u8; MAX_RING] = std::array::from_fn(|i| i as u8);
            let points = RingPoints::new(&self.round.shared, &ring, self.round.measure);
            let division = points.divide(&places[..ring.len], true, self.to_exceed(old));
            if let Some(division) = division
                && self.carry_out(&Removal { ring, division, chord: None })
            {
                return true;
            }
        }
        false
    }

    /// The edges of a tet, that with the largest dihedral angle first: around it are the fewest
    /// other tets.
    pub fn edges_by_angle(&self, t: u32) -> [usize; 6] {
        let [a, b, c, d] = self.round.shared.corners(self.round.shared.tet(t));
        let (u, v, w) = (b - a, c - a, d - a);
        let normals = [(c - b).cross(d - b), w.cross(v), u.cross(w), v.cross(u)]
            .map(|n| n.normalize_or_zero());
        let mut edges = [0, 1, 2, 3, 4, 5].map(|edge| {
            let [.., k, l] = EDGES[edge];
            // The cosine of the angle is the negative of this.
            (normals[k].dot(normals[l]), edge)
        });
        edges.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        edges.map(|(_, edge)| edge)
    }

    /// The best way to do without the edge of a ring, if all its tets measure more than `above`.
    fn removal(&self, ring: &Ring, above: f64) -> Result<Removal, Outcome> {
        let points = RingPoints::new(&self.round.shared, ring, self.round.measure);
        match changes_of(ring).ok_or(Outcome::Failed)? {
            Some(chord) => {
                let near = self.round.interfaces.tolerance;
                self.flip(ring, &points, chord, above, near)
            }
            None => {
                let places: [u8; MAX_RING] = std::array::from_fn(|i| i as u8);
                let division =
                    points.divide(&places[..ring.len], true, above).ok_or(Outcome::Failed)?;
                Ok(Removal { ring: *ring, division, chord: None })
            }
        }
    }

    /// The flip by which tet `t` of the background vanishes from a ring, if that brings the
    /// interface closer to the image's, makes no tet of the object worse, and gives a label back
    /// some of the volume that it lost in this block.
    fn background_removal(&self, ring: &Ring, t: u32) -> Result<Removal, Outcome> {
        let chord = changes_of(ring).flatten().ok_or(Outcome::Failed)?;
        let is_alone = ring.labels[..ring.len].iter().filter(|&&label| label == 0).count() == 1;
        if !is_alone
            || !ring.tets[..ring.len]
                .iter()
                .zip(&ring.labels)
                .any(|(&at, &label)| at == t && label == 0)
        {
            return Err(Outcome::Failed);
        }
        let gains =
            ring.labels[..ring.len].iter().find(|&&label| label != 0).ok_or(Outcome::Failed)?;
        if self.counts.volume_of(*gains) >= 0.0 {
            return Err(Outcome::Failed);
        }
        let points = RingPoints::new(&self.round.shared, ring, self.round.measure);
        let above = self.min_of(ring).min(self.round.measure.target).next_down();
        self.flip(ring, &points, chord, above, 0.0)
    }

    /// The least measure of the tets of a ring that count.
    fn min_of(&self, ring: &Ring) -> f64 {
        let counting = (0..ring.len).filter(|&i| ring.labels[i] != 0);
        counting.map(|i| self.measure_of(ring.tets[i])).fold(f64::INFINITY, f64::min)
    }

    /// The flip of an interface edge, see the module's head; edges `near` each other may be farther
    /// from the image's interface than before.
    fn flip(
        &self,
        ring: &Ring,
        points: &RingPoints,
        chord @ [from, to]: [usize; 2],
        above: f64,
        near: f64,
    ) -> Result<Removal, Outcome> {
        if !self.round.interfaces.change || !self.may_flip(ring, points, chord, near) {
            return Err(Outcome::Failed);
        }
        let part = |from: usize, to: usize| {
            let mut places = [0; MAX_RING];
            let len = (to + ring.len - from) % ring.len + 1;
            (0..len).for_each(|n| places[n] = ((from + n) % ring.len) as u8);
            points.divide(&places[..len], ring.labels[from] != 0, above)
        };
        let division = part(from, to).and_then(|first| Some(first.join(&part(to, from)?)));
        let division = division.ok_or(Outcome::Failed)?;
        for [from, to] in [[from, to], [to, from]] {
            if (to + ring.len - from) % ring.len == 1 {
                self.check_chord(ring, from)?;
            }
        }
        Ok(Removal { ring: *ring, division, chord: Some(chord) })
    }

    /// Whether the edge of a ring may be flipped on the interface: all conditions but that on an
    /// edge that was there before.
    fn may_flip(
        &self,
        ring: &Ring,
        points: &RingPoints,
        [from, to]: [usize; 2],
        near: f64,
    ) -> bool {
        let interfaces = self.round.interfaces;
        let [a, b] = points.ends;
        let [c, d] = [points.ring[from], points.ring[to]];
        let Some([on_old, on_new]) = nearest_points([a, b], [c, d]) else { return false };
        // Both normals point to the side of the part from c to d.
        let facets = [[c, d, b], [d, c, a]];
        let labels = [ring.labels[to], ring.labels[from]];
        if on_old.distance(on_new) > near {
            let up = (d - c).cross(b - c) + (c - d).cross(a - d);
            let is_near = on_old.distance(on_new) <= FARTHEST_FLIP * interfaces.tolerance;
            if !is_near || !interfaces.is_closer(on_new, on_old, up, labels) {
                return false;
            }
        }
        if !interfaces.keep_facets(facets, [[d, b, a], [b, c, a]], labels) {
            return false;
        }
        if labels.contains(&0) {
            let [old, other] = [[a, b, c], [a, b, d]].map(|facet| interfaces.walls_of(facet));
            if old != other {
                return false;
            }
            // A facet on a wall is where it belongs.
            if old.count() > 0 {
                return true;
            }
        }
        facets.iter().all(|&facet| interfaces.holds_facet(facet, labels))
    }

    /// Whether no interface passes through the edge that a part of the ring with a single tet, at
    /// place `at`, leaves.
    fn check_chord(&self, ring: &Ring, at: usize) -> Result<(), Outcome> {
        let (t, c, d) = (ring.tets[at], ring.vertices[at], ring.vertices[(at + 1) % ring.len]);
        let tet = self.round.shared.tet(t);
        let is_chord = |edge: &usize| EDGES[*edge][..2].iter().all(|&i| tet[i] == c || tet[i] == d);
        let edge = (0..6).find(is_chord).ok_or(Outcome::Failed)?;
        match ring::around(&self.round.shared, t, edge, |tet| self.owns(tet)) {
            Around::Ring(around)
                if around.labels[..around.len].iter().all(|&l| l == ring.labels[at]) =>
            {
                Ok(())
            }
            Around::Foreign => Err(Outcome::Foreign),
            _ => Err(Outcome::Failed),
        }
    }

    /// Replaces the tets of a ring; `false`, with nothing changed, if the new tets would not be the
    /// block's own, or there is no room for them or no memory.
    fn carry_out(&mut self, removal: &Removal) -> bool {
        let Removal { ring, division, chord } = removal;
        let shared = &self.round.shared;
        let [a, b] = ring.ends;
        let len = ring.len;
        let vertex = |place: u8| ring.vertices[usize::from(place)];
        let new_tets = |&[i, j, k]: &[u8; 3]| {
            let [p, q, r] = [i, j, k].map(vertex);
            [[p, q, r, b], [q, p, r, a]]
        };
        let triangles = division.triangles();
        if !triangles.iter().flat_map(new_tets).all(|tet| self.owns(tet)) {
            return false;
        }
        if len + self.room() < 2 * triangles.len() {
            return false;
        }
        // What lies beyond the ring: across the facet opposite to a, and to b, the tet there and
        // its facet.
        let mut beyond = [[(NONE, 0); 2]; MAX_RING];
        for i in 0..len {
            let t = ring.tets[i];
            let tet = shared.tet(t);
            for (side, end) in [a, b].into_iter().enumerate() {
                let facet = (0..4).find(|&n| tet[n] == end).unwrap_or(0);
                let other = shared.neighbor(t, facet);
                if other != NONE {
                    beyond[i][side] = (other, shared.facet_to(other, t).unwrap_or(0));
                }
            }
        }
        let label_of = |&[i, _, k]: &[u8; 3]| match *chord {
            // The part between the chord's ends, or the other one.
            Some([from, to]) if usize::from(i) >= from && usize::from(k) <= to => ring.labels[from],
            Some([_, to]) => ring.labels[to],
            None => ring.labels[0],
        };
        if let Some(chord @ [from, to]) = *chord {
            debug_assert!(from < to);
            // Without memory to remember it, it is not done.
            if self.note_flip(ring, chord).is_err() {
                return false;
            }
        }
        let shared = &self.round.shared;
        // Old slots first.
        let mut slots = [[NONE; 2]; MAX_RING];
        let mut old = ring.tets[..len].iter().copied();
        for slots in &mut slots[..triangles.len()] {
            for slot in slots {
                *slot = old.next().or_else(|| self.take_slot()).unwrap_or(NONE);
            }
        }
        let rest: Vec<u32> = old.collect();
        // Which triangle has been seen at a side of the polygon's division.
        let mut first_at = [[usize::MAX; MAX_RING]; MAX_RING];
        for (n, triangle) in triangles.iter().enumerate() {
            let label = label_of(triangle);
            for (slot, tet) in slots[n].into_iter().zip(new_tets(triangle)) {
                shared.put(slot, tet, label);
            }
            let [upper, lower] = slots[n];
            shared.set_neighbor(upper, 3, lower);
            shared.set_neighbor(lower, 3, upper);
            let [i, j, k] = triangle.map(usize::from);
            // Facets of the upper and of the lower tet at each side, see `new_tets`.
            for (p, q, facets) in [(i, j, [2, 2]), (j, k, [0, 1]), (i, k, [1, 0])] {
                let outside = if q == p + 1 {
                    Some(p)
                } else if p == 0 && q == len - 1 {
                    Some(q)
                } else {
                    None
                };
                if let Some(at) = outside {
                    // The upper tet has b, so it lies across the facet opposite to a.
                    for (side, (slot, facet)) in [upper, lower].into_iter().zip(facets).enumerate()
                    {
                        let (other, back) = beyond[at][side];
                        shared.set_neighbor(slot, facet, other);
                        if other != NONE {
                            shared.set_neighbor(other, back, slot);
                        }
                    }
                } else if first_at[p][q] == usize::MAX {
                    first_at[p][q] = n;
                } else {
                    let other = first_at[p][q];
                    let [oi, oj, _] = triangles[other].map(usize::from);
                    let other_facets = if (oi, oj) == (p, q) {
                        [2, 2]
                    } else if oj == p {
                        [0, 1]
                    } else {
                        [1, 0]
                    };
                    for side in 0..2 {
                        shared.set_neighbor(slots[n][side], facets[side], slots[other][side]);
                        shared.set_neighbor(slots[other][side], other_facets[side], slots[n][side]);
                    }
                }
            }
        }
        // A part with a single tet leaves the tets beyond it beside those of the other part, which
        // the loop above has done: its chord is a side of the polygon.
        rest.into_iter().for_each(|t| self.give_slot(t));
        match chord {
            Some(_) => self.counts.interface_flips += 1,
            None => self.counts.edge_removals += 1,
        }
        for slots in &slots[..triangles.len()] {
            slots.iter().for_each(|&t| self.enqueue(t));
        }
        true
    }

    /// Counts what a flip on an interface changes, and remembers how far its facets are from
    /// refinement's.
    fn note_flip(&mut self, ring: &Ring, [from, to]: [usize; 2]) -> Result<(), Error> {
        self.note_distance(ring.ends, [from, to].map(|i| ring.vertices[i]))?;
        let [a, b] = ring.ends.map(|v| self.point(v));
        let [c, d] = [from, to].map(|i| self.point(ring.vertices[i]));
        // Positive where the flip cuts the tet abcd off from the part between c and d.
        let volume = (b - a).cross(c - a).dot(d - a) / 6.0;
        self.counts.add_volume(ring.labels[from], -volume);
        self.counts.add_volume(ring.labels[to], volume);
        let distance = nearest_points([a, b], [c, d]).map_or(0.0, |[p, q]| p.distance(q));
        self.counts.max_flip = self.counts.max_flip.max(distance);
        Ok(())
    }

    /// Notes how far the facets acd and bcd, which replace abc and abd, are from refinement's
    /// interface.
    fn note_distance(&mut self, [a, b]: [u32; 2], [c, d]: [u32; 2]) -> Result<(), Error> {
        let of_old = self.distance_of_flip([a, b, c]).max(self.distance_of_flip([a, b, d]));
        let edges = [[a, b], [c, d]].map(|edge| edge.map(|v| self.refined(v)));
        // Where the edges do not cross at refinement's places nothing is known.
        let of_flip =
            nearest_points(edges[0], edges[1]).map_or(f64::INFINITY, |[p, q]| p.distance(q));
        [[a, c, d], [b, c, d]].into_iter().try_for_each(|f| self.flips.note(f, of_old + of_flip))
    }
}

/// The places in a ring where the label changes, if there are just two; `Some(None)` if there are
/// none.
fn changes_of(ring: &Ring) -> Option<Option<[usize; 2]>> {
    let (mut changes, mut count) = ([0; 2], 0);
    for i in 0..ring.len {
        if ring.labels[(i + ring.len - 1) % ring.len] != ring.labels[i] {
            if count == 2 {
                return None;
            }
            changes[count] = i;
            count += 1;
        }
    }
    Some((count == 2).then_some(changes))
}

/// The points of the lines through two edges where these are nearest to each other, if they are on
/// the edges.
fn nearest_points([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> Option<[DVec3; 2]> {
    let (u, v, w) = (b - a, d - c, c - a);
    let normal = u.cross(v);
    let squared = normal.length_squared();
    let (s, t) = (w.cross(v).dot(normal) / squared, w.cross(u).dot(normal) / squared);
    // False, too, for what is no number because the lines are parallel.
    let on_both = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    on_both.then(|| [a + u * s, c + v * t])
}
