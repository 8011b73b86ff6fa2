//! Smoothing: a vertex is moved so that the worst tet around it gets better.
//!
//! The least measure of the tets around a vertex is a function of where the vertex is, with kinks
//! where another tet becomes the worst. It rises fastest along the shortest vector in the convex
//! hull of the gradients of the worst tets (L. A. Freitag, M. Jones, P. Plassmann, "An efficient
//! parallel algorithm for mesh smoothing", 1995). Along this direction the step is halved until the
//! least measure rises.
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

use super::interfaces::facet_measure;
use super::measure::{Measure, is_positive};
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
/// Tets whose measure is below the least by this factor, or a little more, shape the direction.
const ACTIVE: f64 = 1.5;
/// Most of them.
const MAX_ACTIVE: usize = 12;
/// The step by which gradients are taken, in parts of the length of an edge.
pub(super) const DIFFERENCE: f64 = 1e-6;
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
/// Steps towards the shortest vector of a convex hull.
const MAX_APPROACHES: usize = 24;
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

/// The other vertices of interface facets whose angles must not get smaller.
struct Tight {
    count: usize,
    others: [[DVec3; 2]; MAX_ACTIVE],
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
        let before = min_at(star, self.round.measure, start);
        // The worst tet may not be one of this vertex's.
        if before >= self.aim {
            return Outcome::Failed;
        }
        let walls = self.round.interfaces.oracle.walls_at(start);
        let supports = self.supports(star, start, &walls);
        for support in supports {
            let (mut at, mut min) = (start, before);
            for _ in 0..MAX_STEPS {
                match self.step(star, support, &walls, at, min) {
                    Some(better) => (at, min) = better,
                    None => break,
                }
                if min >= self.aim {
                    break;
                }
            }
            if min > self.to_exceed(before) && is_valid(star, at) {
                self.commit(star, support, at);
                return Outcome::Done;
            }
        }
        Outcome::Failed
    }

    /// Where a vertex inside of a label makes the least measure of its star exceed `above`, from
    /// `start` on.
    pub fn best_inside(&self, star: &Star, start: DVec3, above: f64) -> Option<DVec3> {
        let (mut at, mut min) = (start, min_at(star, self.round.measure, start));
        for _ in 0..MAX_STEPS_INSIDE {
            match self.step(star, Support::Inside, &Walls::NONE, at, min) {
                Some(better) => (at, min) = better,
                None => break,
            }
            if min >= self.round.measure.target {
                break;
            }
        }
        (min > above && is_valid(star, at)).then_some(at)
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

    /// One step uphill from `at`, where the least measure is `min`: where to, and what it is
    /// there.
    fn step(
        &self,
        star: &Star,
        support: Support,
        walls: &Walls,
        at: DVec3,
        min: f64,
    ) -> Option<(DVec3, f64)> {
        let facets = self.tight_facets(star, support, at);
        let (way, rate) =
            ascent(star, self.round.measure, at, min, &facets, |way| support.allowed(way))?;
        let max = self.max_step(star, support, at);
        // To where the worst tet would reach a little more than the target, if it went on so.
        // Places on interfaces are found to less than a hundredth of the tolerance, so a step is
        // longer than that.
        let shortest = SHORTEST_STEP * self.round.interfaces.tolerance;
        let mut length = (1.2 * (self.aim - min) / rate).max(shortest).min(max);
        for _ in 0..MAX_HALVINGS {
            if let Some(p) = self.settle(star, support, walls, at + way * length) {
                let enough = (min + 0.1 * GAIN).min(self.aim.next_down());
                if exceeds_at(star, self.round.measure, p, enough) && is_valid(star, p) {
                    return Some((p, min_at(star, self.round.measure, p)));
                }
            }
            length *= 0.5;
        }
        None
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
    fn settle(&self, star: &Star, support: Support, walls: &Walls, p: DVec3) -> Option<DVec3> {
        let p = self.land(star, &Place { support, walls: *walls }, p)?;
        (support == Support::Inside || self.keeps_facets(star, p)).then_some(p)
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
        let mut tight = Tight { count: 0, others: [[DVec3::ZERO; 2]; MAX_ACTIVE] };
        if support == Support::Inside {
            return tight;
        }
        let bound = TIGHT * (1.0 - self.round.interfaces.facet_cosine_squared);
        for facet in &star.facets {
            let others = facet.others.map(|v| self.point(v));
            if tight.count < MAX_ACTIVE && facet_measure(at, &others) < bound {
                tight.others[tight.count] = others;
                tight.count += 1;
            }
        }
        tight
    }

    /// Whether the interface facets around a vertex that is moved keep the angles that were asked
    /// for.
    pub fn keeps_facets(&self, star: &Star, at: DVec3) -> bool {
        let from = self.point(star.vertex);
        star.facets.iter().all(|facet| {
            let [p, q] = facet.others.map(|v| self.point(v));
            self.round.interfaces.keep_angles([[at, p, q]], [[from, p, q]])
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
        for (&label, &[x, y, z]) in star.labels.iter().zip(&star.points) {
            if !star.facets.is_empty() {
                // What the tet gains.
                let volume = (from - at).dot((y - x).cross(z - x)) / 6.0;
                self.counts.add_volume(label, volume);
            }
        }
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

/// Whether all tets that count measure more than `bound` with the vertex at `p`.
fn exceeds_at(star: &Star, measure: Measure, p: DVec3, bound: f64) -> bool {
    let mut tets = star.labels.iter().zip(&star.points);
    tets.all(|(&label, &[x, y, z])| label == 0 || measure.exceeds(&[p, x, y, z], bound))
}

/// The least measure of the tets that count, with the vertex at `p`.
fn min_at(star: &Star, measure: Measure, p: DVec3) -> f64 {
    let counting = star.labels.iter().zip(&star.points).filter(|(label, _)| **label != 0);
    counting.map(|(_, &[x, y, z])| measure.of(&[p, x, y, z])).fold(f64::INFINITY, f64::min)
}

/// Whether all tets are positive with the vertex at `p`.
pub(super) fn is_valid(star: &Star, p: DVec3) -> bool {
    star.points.iter().all(|&[x, y, z]| is_positive(&[p, x, y, z]))
}

/// The direction in which the least measure rises fastest, and how fast; `None` where it rises in
/// none in which the angles of the `tight` facets do not fall.
fn ascent(
    star: &Star,
    measure: Measure,
    at: DVec3,
    min: f64,
    tight: &Tight,
    allowed: impl Fn(DVec3) -> DVec3,
) -> Option<(DVec3, f64)> {
    let bound = ACTIVE * min + GAIN;
    let mut active: [(f64, [DVec3; 3]); MAX_ACTIVE] =
        [(f64::INFINITY, [DVec3::ZERO; 3]); MAX_ACTIVE];
    let mut count = 0;
    for (_, &others @ [x, y, z]) in
        star.labels.iter().zip(&star.points).filter(|(label, _)| **label != 0)
    {
        let value = measure.of(&[at, x, y, z]);
        if value > bound {
            continue;
        }
        // Keeps the worst, in order.
        let mut to = count.min(MAX_ACTIVE - 1);
        if count == MAX_ACTIVE && active[to].0 <= value {
            continue;
        }
        while to > 0 && active[to - 1].0 > value {
            active[to] = active[to - 1];
            to -= 1;
        }
        active[to] = (value, others);
        count = (count + 1).min(MAX_ACTIVE);
    }
    let mut gradients = [DVec3::ZERO; 2 * MAX_ACTIVE];
    for (gradient, &(value, others)) in gradients.iter_mut().zip(&active[..count]) {
        *gradient = allowed(gradient_of(at, others[0], value, |p| {
            measure.of(&[p, others[0], others[1], others[2]])
        }));
    }
    let steepest = gradients[..count].iter().map(|g| g.length()).fold(0.0, f64::max);
    // Only the directions of these matter.
    for others in &tight.others[..tight.count] {
        gradients[count] = allowed(gradient_of(at, others[0], facet_measure(at, others), |p| {
            facet_measure(p, others)
        }))
        .normalize_or_zero()
            * steepest;
        count += 1;
    }
    let way = nearest_to_zero(&gradients[..count]);
    let length = way.length();
    // Also where nothing is a number.
    if length.is_nan() || length <= 1e-3 * steepest {
        return None;
    }
    let way = way / length;
    // The worst tet rises by at least this.
    let rate = way.dot(gradients[0]);
    (rate > 0.0).then_some((way, rate))
}

/// The gradient of a function that has `value` at a place, by differences; `other` is some point as
/// far away as what the function depends on.
fn gradient_of(at: DVec3, other: DVec3, value: f64, of: impl Fn(DVec3) -> f64) -> DVec3 {
    let step = DIFFERENCE * (other - at).length();
    DVec3::from([DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (of(at + axis * step) - value) / step))
}

/// The point of the convex hull of some vectors that is nearest to zero, nearly (E. G. Gilbert, "An
/// iterative procedure for computing the minimum of a quadratic form on a convex set", 1966).
fn nearest_to_zero(vectors: &[DVec3]) -> DVec3 {
    let Some(&first) = vectors.first() else { return DVec3::ZERO };
    let mut nearest = first;
    for _ in 0..MAX_APPROACHES {
        let Some(&far) = vectors.iter().min_by(|a, b| a.dot(nearest).total_cmp(&b.dot(nearest)))
        else {
            break;
        };
        let way = far - nearest;
        let gain = -nearest.dot(way);
        if gain <= 1e-6 * nearest.length_squared() {
            break;
        }
        nearest += way * (gain / way.length_squared()).min(1.0);
    }
    nearest
}
