//! Smoothing: a vertex is moved so that the worst tet around it gets better.
//!
//! It goes in the direction in which that rises fastest (see [`climb`](super::climb)). The step is
//! halved until the least measure rises.
//!
//! A vertex keeps to what it belongs to:
//!
//! | vertex | where it may go |
//! |---|---|
//! | inside of a label | anywhere |
//! | on an interface of two labels | along it: each step ends at the image's change of label |
//! | on a line (of three labels, or in a wall) | along it, as far off it as it is |
//! | at any other junction, or where the image's lines are not known | anywhere near |
//! | in a wall, on an edge of the image | in this wall, along this edge |
//! | at a contact of voxels | nowhere; those around it by half of the tolerance |
//!
//! All but vertices inside stay within the tolerance of where refinement put the interface.

use glam::DVec3;

use super::climb::{Climb, Tight};
use super::interfaces::facet_measure;
use super::measure::is_positive;
use super::report::Counts;
use super::star::{Collected, Star};
use super::worker::{GAIN, Outcome, Worker};
use crate::geometry::shape::closest_point;
use crate::oracle::Walls;

/// Steps of one vertex at a time.
const MAX_STEPS: usize = 6;
/// The same for a new vertex, which starts farther away from where it belongs.
const MAX_STEPS_INSIDE: usize = 20;
/// Around a tet that nothing helped measures are to be raised to this many times the target.
const RELAXED: f64 = 2.0;
/// Halvings of a step.
const MAX_HALVINGS: usize = 6;
/// The first step on an interface is this part of the tolerance at least.
const SHORTEST_STEP: f64 = 0.1;
/// A vertex inside moves by no more than this part of its shortest edge in a step.
const MAX_STEP: f64 = 0.5;
/// An interface facet shapes the direction, too, if the squared sine of its least angle is below
/// the bound by this factor.
const TIGHT: f64 = 1.03;
/// Along interfaces and lines vertices may go this many tolerances, if they stay as near as the
/// tolerance to where refinement put the interface.
const FARTHEST: f64 = 2.0;
/// The same around tets that nothing else helps.
const FARTHEST_LAST: f64 = 4.0;
/// The step by which the tangents of an interface are found, in tolerances.
const PROBE: f64 = 0.5;
/// What would leave the tolerance ends at this part of it, so that its way back to the interface
/// does not leave it.
pub(super) const TO_BORDER: f64 = 0.97;
/// How far points around contacts may go, in parts of the tolerance.
const AROUND_CONTACTS: f64 = 0.5;

/// What a vertex belongs to, with the walls it is in.
pub(super) struct Place {
    pub support: Support,
    walls: Walls,
}

/// Where a vertex may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Support {
    Inside,
    /// On the interface of two labels, whose normal leads from the first to the second; as far off
    /// it as refinement put it.
    Interface {
        labels: [i32; 2],
        normal: DVec3,
        off: DVec3,
    },
    /// In the walls of the image.
    Walls,
    /// On a line, which the image knows, in this direction; as far off it as the vertex is.
    Line {
        way: DVec3,
        off: DVec3,
    },
    /// Within the tolerance.
    Near,
    Fixed,
}

impl Support {
    /// The part of a direction in which the vertex may go.
    #[inline]
    pub fn allowed(&self, way: DVec3) -> DVec3 {
        match *self {
            Support::Interface { normal, .. } => way - normal * normal.dot(way),
            Support::Line { way: line, .. } => line * line.dot(way),
            Support::Fixed => DVec3::ZERO,
            Support::Inside | Support::Near | Support::Walls => way,
        }
    }
}

impl Worker<'_, '_> {
    /// Moves the vertices of a tet until it reaches the target, or nothing helps.
    pub fn smooth(&mut self, t: u32) -> Outcome {
        let mut star = std::mem::take(&mut self.star);
        let mut outcome = Outcome::Failed;
        for v in self.round.shared.tet(t) {
            match self.smooth_vertex(&mut star, t, v) {
                Outcome::Done => {
                    outcome = Outcome::Done;
                    if self.is_good(t) {
                        break;
                    }
                }
                Outcome::Foreign if outcome == Outcome::Failed => outcome = Outcome::Foreign,
                _ => {}
            }
        }
        self.star = star;
        outcome
    }

    /// Moves the vertices of the tets that keep those of tet `t` from moving: the ones around it
    /// that are hardly above the target, to well above it.
    pub fn relax(&mut self, t: u32) -> Outcome {
        let mut star = std::mem::take(&mut self.star);
        let mut tight: Vec<u32> = Vec::new();
        for v in self.round.shared.tet(t) {
            if star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) == Collected::Star {
                let bound = RELAXED * self.round.measure.target;
                tight.extend(star.tets.iter().filter(|&&at| {
                    self.round.shared.label(at) != 0 && self.measure_of(at) < bound
                }));
            }
        }
        tight.sort_unstable();
        tight.dedup();
        let mut outcome = Outcome::Failed;
        self.aim = RELAXED * self.round.measure.target;
        for at in tight {
            for v in self.round.shared.tet(at) {
                if self.smooth_vertex(&mut star, at, v) == Outcome::Done {
                    outcome = Outcome::Done;
                }
            }
        }
        self.aim = self.round.measure.target;
        self.star = star;
        outcome
    }

    /// How far a vertex may go along an interface or line, in tolerances.
    pub fn farthest(&self) -> f64 {
        if self.round.last.go_farther { FARTHEST_LAST } else { FARTHEST }
    }

    fn smooth_vertex(&mut self, star: &mut Star, t: u32, v: u32) -> Outcome {
        match star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) {
            Collected::Star => {}
            Collected::Foreign => return Outcome::Foreign,
            Collected::Open => return Outcome::Failed,
        }
        let start = self.point(v);
        let mut climb = std::mem::take(&mut self.climb);
        let outcome = self.smooth_star(star, start, &mut climb);
        self.climb = climb;
        outcome
    }

    /// The same for the vertex of a star, which is at `start`.
    fn smooth_star(&mut self, star: &Star, start: DVec3, climb: &mut Climb) -> Outcome {
        climb.begin(star, &self.round.measure, start);
        let before = climb.min;
        // The worst tet may not be one of this vertex's.
        if before >= self.aim {
            return Outcome::Failed;
        }
        let walls = self.round.interfaces.oracle.walls_at(start);
        let supports = self.supports(star, start, &walls);
        let may_move = supports.into_iter().filter(|&support| support != Support::Fixed);
        for (n, place) in may_move.map(|support| Place { support, walls }).enumerate() {
            if n > 0 {
                climb.begin(star, &self.round.measure, start);
            }
            self.climb(star, &place, climb, MAX_STEPS, self.aim);
            if climb.min > self.to_exceed(before) && is_valid(star, climb.at) {
                self.commit(star, place.support, climb.at);
                return Outcome::Done;
            }
        }
        Outcome::Failed
    }

    /// Where a vertex inside of a label makes the least measure of its star exceed `above`, from
    /// `start` on.
    pub fn best_inside(&mut self, star: &Star, start: DVec3, above: f64) -> Option<DVec3> {
        let mut climb = std::mem::take(&mut self.climb);
        climb.begin(star, &self.round.measure, start);
        let place = Place { support: Support::Inside, walls: Walls::NONE };
        self.climb(star, &place, &mut climb, MAX_STEPS_INSIDE, self.round.measure.target);
        let Climb { at, min, .. } = climb;
        self.climb = climb;
        (min > above && is_valid(star, at)).then_some(at)
    }

    /// Takes so many steps uphill, or fewer until the least measure is `enough`.
    fn climb(&self, star: &Star, place: &Place, climb: &mut Climb, steps: usize, enough: f64) {
        for _ in 0..steps {
            if !self.step(star, place, climb) || climb.min >= enough {
                break;
            }
        }
    }

    /// Where the vertex of a star may go: first along what it belongs to, then, for junctions,
    /// anywhere near.
    fn supports(&self, star: &Star, at: DVec3, walls: &Walls) -> [Support; 2] {
        let interfaces = self.round.interfaces;
        if star.facets.is_empty() {
            return if walls.count() == 0 {
                [Support::Inside, Support::Fixed]
            } else {
                [Support::Fixed; 2]
            };
        }
        if !interfaces.change || walls.count() == 3 {
            return [Support::Fixed; 2];
        }
        let surface = star.surface();
        if interfaces.oracle.is_near_contact(at) {
            // A contact is where the boundary of a label touches itself.
            let is_contact = surface.is_none() && star.two_labels().is_some();
            return [if is_contact { Support::Fixed } else { Support::Near }, Support::Fixed];
        }
        if walls.count() > 0 {
            let is_in_walls =
                |v: u32| walls.common(&interfaces.oracle.walls_at(self.point(v))) == *walls;
            let all_in_walls = star.facets.iter().flat_map(|facet| facet.others).all(is_in_walls);
            return match () {
                () if all_in_walls && surface.is_some() => [Support::Walls, Support::Fixed],
                () => [self.line_of(star, at), Support::Near],
            };
        }
        match surface {
            Some([inner, outer]) => {
                let normal = star.facets.iter().map(|facet| {
                    let [p, q] = facet.others.map(|v| self.point(v) - at);
                    p.cross(q)
                });
                [
                    self.on_interface(
                        star,
                        at,
                        normal.sum::<DVec3>().normalize_or_zero(),
                        [inner, outer],
                    ),
                    Support::Fixed,
                ]
            }
            None => [self.line_of(star, at), Support::Near],
        }
    }

    /// The support of a vertex on the interface of two labels; `normal` is that of the facets
    /// around it.
    fn on_interface(&self, star: &Star, at: DVec3, normal: DVec3, labels: [i32; 2]) -> Support {
        let interfaces = self.round.interfaces;
        let project = |p: DVec3| interfaces.project(p, normal, interfaces.tolerance, labels);
        let refined = self.refined(star.vertex);
        let [Some(own), Some(here)] = [project(refined), project(at)] else {
            return Support::Fixed;
        };
        // The interface's own tangents: it may be inclined against the facets.
        let step = PROBE * interfaces.tolerance;
        let (side, other) = normal.any_orthonormal_pair();
        let tangents = [side, other].map(|way| project(here + way * step).map(|p| p - here));
        let [Some(u), Some(v)] = tangents else { return Support::Fixed };
        let own_normal = u.cross(v).normalize_or_zero();
        let own_normal = if own_normal.dot(normal) < 0.0 { -own_normal } else { own_normal };
        Support::Interface { labels, normal: own_normal, off: refined - own }
    }

    /// The support of the vertex of a star if it is on a line.
    fn line_of(&self, star: &Star, at: DVec3) -> Support {
        let interfaces = self.round.interfaces;
        let (ends, lines) = star.line_edges();
        if lines != 2 {
            return Support::Fixed;
        }
        let Some(here) = interfaces.oracle.nearest_junction(at, interfaces.tolerance) else {
            return Support::Fixed;
        };
        let way = self.point(ends[1]) - self.point(ends[0]);
        Support::Line { way: way.normalize_or_zero(), off: at - here }
    }

    /// One step uphill, if there is one.
    fn step(&self, star: &Star, place: &Place, climb: &mut Climb) -> bool {
        let (support, at, measure) = (place.support, climb.at, &self.round.measure);
        let tight = self.tight_facets(star, support, at);
        let Some((way, rate)) = climb.ascent(measure, &tight, |way| support.allowed(way)) else {
            return false;
        };
        let max = self.max_step(star, support, at);
        // To where the worst tet would reach a little more than the target, if it went on so.
        // Places on interfaces are found to less than a hundredth of the tolerance, so a step is
        // longer than that.
        let shortest = SHORTEST_STEP * self.round.interfaces.tolerance;
        let enough = (climb.min + 0.1 * GAIN).min(self.aim.next_down());
        let mut length = (1.2 * (self.aim - climb.min) / rate).max(shortest).min(max);
        for _ in 0..MAX_HALVINGS {
            if let Some(p) = self.settle(star, place, at + way * length) {
                let min = climb.measure_at(measure, p);
                if min > enough && is_valid(star, p) {
                    climb.go(p, min);
                    return true;
                }
            }
            length *= 0.5;
        }
        false
    }

    /// How far a vertex may go in one step.
    pub fn max_step(&self, star: &Star, support: Support, at: DVec3) -> f64 {
        match support {
            Support::Inside => MAX_STEP * star.shortest_edge(at),
            Support::Interface { .. } | Support::Line { .. } => {
                self.farthest() * self.round.interfaces.tolerance
            }
            _ => self.round.interfaces.tolerance,
        }
    }

    /// What the vertex of a star belongs to first.
    pub fn place(&self, star: &Star, at: DVec3) -> Place {
        let walls = self.round.interfaces.oracle.walls_at(at);
        let [support, _] = self.supports(star, at, &walls);
        Place { support, walls }
    }

    /// Where a vertex ends that is to go to `p`; `None`: it may not.
    fn settle(&self, star: &Star, place: &Place, p: DVec3) -> Option<DVec3> {
        let p = self.land(star, place, p)?;
        (place.support == Support::Inside || self.keeps_facets(star, p)).then_some(p)
    }

    /// The same, without a look at the facets around.
    pub fn land(&self, star: &Star, place: &Place, p: DVec3) -> Option<DVec3> {
        let Place { support, walls } = *place;
        if support == Support::Inside {
            return Some(p);
        }
        let interfaces = self.round.interfaces;
        let mut max = interfaces.tolerance;
        let refined = self.refined(star.vertex);
        // What would leave the tolerance goes along its border.
        let within = |p: DVec3, max: f64| refined + (p - refined).clamp_length_max(TO_BORDER * max);
        let p = match support {
            Support::Inside | Support::Fixed => return None,
            Support::Interface { labels, normal, off } => {
                max = self.farthest() * interfaces.tolerance;
                interfaces.project(within(p, max) - off, normal, interfaces.tolerance, labels)?
                    + off
            }
            Support::Line { off, .. } => {
                max = self.farthest() * interfaces.tolerance;
                let p = within(p, max) - off;
                interfaces.oracle.nearest_junction(p, interfaces.tolerance)? + off
            }
            Support::Walls | Support::Near => {
                if interfaces.oracle.is_near_contact(refined) {
                    max *= AROUND_CONTACTS;
                }
                within(p, max)
            }
        };
        let p = interfaces.oracle.onto_walls(p, walls);
        let is_near = p.distance_squared(refined) <= max * max;
        (is_near && self.distance_from_refined(star, p) <= interfaces.tolerance).then_some(p)
    }

    /// How far a place of the vertex is from where refinement put the interface around it, at most.
    pub fn distance_from_refined(&self, star: &Star, at: DVec3) -> f64 {
        let own = self.refined(star.vertex);
        let distances = star.facets.iter().map(|facet| {
            let [p, q] = facet.others;
            let of_flip = self.distance_of_flip([star.vertex, p, q]);
            let nearest = closest_point(&[own, self.refined(p), self.refined(q)], at);
            of_flip + nearest.distance(at)
        });
        distances.fold(at.distance(own), f64::min)
    }

    /// The other vertices of the interface facets whose angles are hardly larger than what was
    /// asked for.
    fn tight_facets(&self, star: &Star, support: Support, at: DVec3) -> Tight {
        let mut tight = Tight::NONE;
        if support == Support::Inside {
            return tight;
        }
        let bound = TIGHT * (1.0 - self.round.interfaces.facet_cosine_squared);
        for facet in &star.facets {
            let others = facet.others.map(|v| self.point(v));
            if facet_measure(at, &others) < bound {
                tight.push(others);
            }
        }
        tight
    }

    /// Whether the interface facets around a vertex that is moved keep the angles that were asked
    /// for, and none leaves the wall that it should lie on.
    pub fn keeps_facets(&self, star: &Star, at: DVec3) -> bool {
        let from = self.point(star.vertex);
        star.facets.iter().all(|facet| {
            let [p, q] = facet.others.map(|v| self.point(v));
            let [new, old] = [[at, p, q], [from, p, q]];
            self.round.interfaces.keep_facets([new], [old], facet.labels)
        })
    }

    fn commit(&mut self, star: &Star, support: Support, at: DVec3) {
        self.move_vertex(star, support, at);
        star.tets.iter().for_each(|&t| self.note_and_enqueue(t));
    }

    /// Has a tet that changed inspected again.
    pub fn note_and_enqueue(&mut self, t: u32) {
        self.round.shared.note_changed(t);
        self.enqueue(t);
    }

    /// Puts the vertex of a star where it is to be, and counts that.
    pub fn move_vertex(&mut self, star: &Star, support: Support, at: DVec3) {
        let from = self.point(star.vertex);
        star.count_move(from, at, &mut self.counts);
        if !star.facets.is_empty() {
            let moved = self.distance_from_refined(star, at);
            self.counts.max_interface_move = self.counts.max_interface_move.max(moved);
        }
        self.round.shared.set_point(star.vertex, at);
        let Counts { moves_inside, moves_on_interfaces, moves_on_junctions, .. } = &mut self.counts;
        *match support {
            Support::Inside => moves_inside,
            Support::Interface { .. } | Support::Walls => moves_on_interfaces,
            Support::Line { .. } | Support::Near | Support::Fixed => moves_on_junctions,
        } += 1;
    }
}

impl Star {
    /// The length of the shortest edge from its vertex, if this is at `at`.
    fn shortest_edge(&self, at: DVec3) -> f64 {
        let squares = self.points.iter().flatten().map(|p| p.distance_squared(at));
        squares.fold(f64::INFINITY, f64::min).sqrt()
    }
}

/// Whether all tets are positive with the vertex at `p`.
pub(super) fn is_valid(star: &Star, p: DVec3) -> bool {
    star.points.iter().all(|&[x, y, z]| is_positive(&[p, x, y, z]))
}
