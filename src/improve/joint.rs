//! Joint smoothing: the vertices of a tet are moved at the same time, then those around it, too.
//!
//! Where no vertex alone can make the worst tet around it any better (`smoothing`), several may:
//! one makes room for the next, but alone it would make another tet worse. The least measure of all
//! tets around them is a function of all their coordinates. It rises fastest along the shortest
//! vector in the convex hull of the gradients of the worst tets, as that of one vertex does. Each
//! vertex keeps to what it belongs to.
//!
//! It takes many times as long as to move one vertex, so it is for tets that nothing else helped.
//! With a target of 20 degrees a tenth of the tets is left (docs/reference/improvement.md).

use glam::DVec3;

use super::interfaces::facet_measure;
use super::measure::is_positive;
use super::smoothing::{Place, SHORTEST_STEP, Support, Vector, gradient_of, uphill};
use super::star::{Collected, Star};
use super::worker::{GAIN, Outcome, Worker};

/// Steps of all vertices.
const MAX_STEPS: usize = 80;
/// Halvings of a step.
const MAX_HALVINGS: usize = 8;
/// Tets whose measure is below the least by this factor, or a little more, shape the direction. A
/// larger one leaves more tets: on the brain at delta 3 1.25 left 31, and this one 19.
const ACTIVE: f64 = 1.05;
/// Most of them, and most tight facets.
const MAX_ACTIVE: usize = 24;
/// An interface facet shapes the direction, too, if the squared sine of its least angle is below
/// the bound by this factor.
const TIGHT: f64 = 1.1;
/// The least measure must rise to the target, or by this part of it: more than one vertex alone has
/// to bring about. So there are no endless small gains where nothing can reach the target.
const WORTHWHILE: f64 = 0.05;
/// No more vertices are moved together; mostly there are some forty. So one attempt, which mostly
/// takes milliseconds, ends within tenths of a second, whatever the mesh.
const MAX_MOVERS: usize = 80;

/// A vertex that is moved.
struct Mover {
    star: Star,
    place: Place,
}

/// Some vertices with all that is around them. Vertices are numbered within it, the movers first.
#[derive(Default)]
struct Patch {
    movers: Vec<Mover>,
    vertices: Vec<u32>,
    /// Where they are.
    start: Vec<DVec3>,
    /// The tets with a mover, and whether they belong to the object.
    tets: Vec<([usize; 4], bool)>,
    /// Their slots.
    slots: Vec<u32>,
    /// The interface facets with a mover.
    facets: Vec<[usize; 3]>,
}

impl Worker<'_, '_> {
    /// Moves the vertices of a tet together, and those around if that does not help, until the tet
    /// reaches the target or nothing helps.
    pub fn smooth_jointly(&mut self, t: u32) -> Outcome {
        let mut of_tet: Vec<Star> = Vec::new();
        for v in self.round.shared.tet(t) {
            let mut star = Star::default();
            match star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) {
                Collected::Star => of_tet.push(star),
                Collected::Foreign => return Outcome::Foreign,
                Collected::Open => {}
            }
        }
        let around = self.stars_around(&of_tet);
        if self.smooth_patch(self.patch(of_tet)) == Outcome::Done {
            return Outcome::Done;
        }
        self.smooth_patch(self.patch(around))
    }

    /// The stars of the vertices of some stars, as far as the block owns them.
    fn stars_around(&self, of_tet: &[Star]) -> Vec<Star> {
        let mut around: Vec<(u32, u32)> = Vec::new();
        for star in of_tet {
            for (link, &t) in star.links.iter().zip(&star.tets) {
                for v in link.iter().copied().chain([star.vertex]) {
                    if !around.iter().any(|&(w, _)| w == v) {
                        around.push((v, t));
                    }
                }
            }
        }
        let star = |(v, t)| {
            let mut star = Star::default();
            let collected = star.collect(&self.round.shared, t, v, |tet| self.owns(tet));
            (collected == Collected::Star).then_some(star)
        };
        around.into_iter().filter_map(star).take(MAX_MOVERS).collect()
    }

    /// What the vertices of some stars have around them.
    fn patch(&self, stars: Vec<Star>) -> Patch {
        let mut patch = Patch::default();
        for star in stars {
            let at = self.point(star.vertex);
            let place = self.place(&star, at);
            if place.support != Support::Fixed {
                patch.vertices.push(star.vertex);
                patch.start.push(at);
                patch.movers.push(Mover { star, place });
            }
        }
        for mover in 0..patch.movers.len() {
            let star = std::mem::take(&mut patch.movers[mover].star);
            for ((&t, &[x, y, z]), &label) in star.tets.iter().zip(&star.links).zip(&star.labels) {
                if !patch.slots.contains(&t) {
                    patch.slots.push(t);
                    let tet = [star.vertex, x, y, z].map(|v| self.number(&mut patch, v));
                    patch.tets.push((tet, label != 0));
                }
            }
            for facet in &star.facets {
                let [p, q] = facet.others;
                let facet = [star.vertex, p, q].map(|v| self.number(&mut patch, v));
                let is_same = |known: &[usize; 3]| facet.iter().all(|v| known.contains(v));
                if !patch.facets.iter().any(is_same) {
                    patch.facets.push(facet);
                }
            }
            patch.movers[mover].star = star;
        }
        patch
    }

    /// The number of a vertex in a patch, which gets one if it has none.
    fn number(&self, patch: &mut Patch, v: u32) -> usize {
        patch.vertices.iter().position(|&w| w == v).unwrap_or_else(|| {
            patch.vertices.push(v);
            patch.start.push(self.point(v));
            patch.vertices.len() - 1
        })
    }

    fn smooth_patch(&mut self, patch: Patch) -> Outcome {
        if patch.movers.len() < 2 {
            return Outcome::Failed;
        }
        let before = self.min_in(&patch, &patch.start);
        // The tet may be no part of it, where all of its own vertices are fixed.
        if before >= self.aim {
            return Outcome::Failed;
        }
        let (mut at, mut min) = (patch.start.clone(), before);
        for _ in 0..MAX_STEPS {
            match self.step_jointly(&patch, &at, min) {
                Some(better) => (at, min) = better,
                None => break,
            }
            if min >= self.aim {
                break;
            }
        }
        // Also where nothing is a number.
        let is_worth_it = min > (before + WORTHWHILE * self.aim).min(self.aim.next_down());
        if !is_worth_it {
            return Outcome::Failed;
        }
        for ((Mover { mut star, place }, from), to) in
            patch.movers.into_iter().zip(patch.start).zip(at)
        {
            if from != to {
                // Those around it may have moved.
                let (t, v) = (star.tets[0], star.vertex);
                star.collect(&self.round.shared, t, v, |_| true);
                self.move_vertex(&star, place.support, to);
            }
        }
        // Only now are all where they belong.
        patch.slots.iter().for_each(|&t| self.note_and_enqueue(t));
        Outcome::Done
    }

    /// The least measure in a patch with its vertices at some places.
    fn min_in(&self, patch: &Patch, at: &[DVec3]) -> f64 {
        let of_object = patch.tets.iter().filter(|(_, counts)| *counts);
        let measures = of_object.map(|(tet, _)| self.round.measure.of(&tet.map(|v| at[v])));
        measures.fold(f64::INFINITY, f64::min)
    }

    /// One step uphill, where the least measure is `min`: where to, and what it is there.
    fn step_jointly(&self, patch: &Patch, at: &[DVec3], min: f64) -> Option<(Vec<DVec3>, f64)> {
        let (way, rate) = self.joint_ascent(patch, at, min)?;
        let longest = way.iter().map(|way| way.length()).fold(0.0, f64::max);
        let shortest = SHORTEST_STEP * self.round.interfaces.tolerance / longest;
        // To where the worst tet would reach a little more than the target, if it went on so.
        let length = (1.2 * (self.aim - min) / rate).max(shortest);
        let most = patch.movers.iter().zip(at).zip(&way).map(|((mover, &at), way)| {
            self.max_step(&mover.star, mover.place.support, at) / way.length()
        });
        let mut length = most.fold(length, f64::min);
        let enough = (min + 0.1 * GAIN).min(self.aim.next_down());
        for _ in 0..MAX_HALVINGS {
            if let Some(to) = self.settle_jointly(patch, at, &way, length) {
                let min = self.min_in(patch, &to);
                if min > enough
                    && patch.tets.iter().all(|(tet, _)| is_positive(&tet.map(|v| to[v])))
                {
                    return Some((to, min));
                }
            }
            length *= 0.5;
        }
        None
    }

    /// Where the vertices of a patch end whose movers are to go so far along their ways; `None`:
    /// they may not.
    fn settle_jointly(
        &self,
        patch: &Patch,
        at: &[DVec3],
        way: &[DVec3],
        length: f64,
    ) -> Option<Vec<DVec3>> {
        let mut to = at.to_vec();
        for ((mover, way), to) in patch.movers.iter().zip(way).zip(&mut to) {
            if *way != DVec3::ZERO {
                *to = self.land(&mover.star, &mover.place, *to + *way * length)?;
            }
        }
        let keeps_angles = |facet: &[usize; 3]| {
            let [new, old] = [&to, &patch.start].map(|at| facet.map(|v| at[v]));
            self.round.interfaces.keep_angles([new], [old])
        };
        patch.facets.iter().all(keeps_angles).then_some(to)
    }

    /// The direction in which the least measure rises fastest, for each mover, and how fast; `None`
    /// where it rises in none in which the angles of tight facets do not fall.
    fn joint_ascent(&self, patch: &Patch, at: &[DVec3], min: f64) -> Option<(Vec<DVec3>, f64)> {
        let measure = self.round.measure;
        let of_object = patch.tets.iter().filter(|(_, counts)| *counts);
        let mut active: Vec<(f64, &[usize; 4])> = of_object
            .map(|(tet, _)| (measure.of(&tet.map(|v| at[v])), tet))
            .filter(|&(value, _)| value <= ACTIVE * min + GAIN)
            .collect();
        active.sort_by(|a, b| a.0.total_cmp(&b.0));
        active.truncate(MAX_ACTIVE);
        let of_tet = |corners: [DVec3; 4]| measure.of(&corners);
        let mut gradients: Vec<Vec<DVec3>> =
            active.iter().map(|&(value, tet)| patch.gradient(at, tet, value, of_tet)).collect();
        let steepest = gradients.iter().map(|gradient| gradient.length()).fold(0.0, f64::max);
        let bound = TIGHT * (1.0 - self.round.interfaces.facet_cosine_squared);
        let of_facet = |[a, b, c]: [DVec3; 3]| facet_measure(a, &[b, c]);
        let facets = patch.facets.iter().map(|facet| (of_facet(facet.map(|v| at[v])), facet));
        let mut tight: Vec<_> = facets.filter(|&(value, _)| value < bound).collect();
        tight.sort_by(|a, b| a.0.total_cmp(&b.0));
        tight.truncate(MAX_ACTIVE);
        for (value, facet) in tight {
            // Only the directions of these matter.
            let mut gradient = patch.gradient(at, facet, value, of_facet);
            let own = gradient.length();
            if own > 0.0 {
                gradient.iter_mut().for_each(|way| *way *= steepest / own);
                gradients.push(gradient);
            }
        }
        uphill(&gradients, steepest)
    }
}

impl Patch {
    /// The gradient of a function of some vertices, which has `value` there, by the movers; each in
    /// the directions in which it may go.
    fn gradient<const N: usize>(
        &self,
        at: &[DVec3],
        vertices: &[usize; N],
        value: f64,
        of: impl Fn([DVec3; N]) -> f64,
    ) -> Vec<DVec3> {
        let there = vertices.map(|v| at[v]);
        let mut gradient = vec![DVec3::ZERO; self.movers.len()];
        for (i, &v) in vertices.iter().enumerate() {
            let Some(mover) = self.movers.get(v) else { continue };
            let with = |p: DVec3| {
                let mut there = there;
                there[i] = p;
                of(there)
            };
            let free = gradient_of(there[i], there[(i + 1) % N], value, with);
            gradient[v] = mover.place.support.allowed(free);
        }
        gradient
    }
}
