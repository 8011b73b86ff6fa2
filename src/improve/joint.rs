//! Joint smoothing: the vertices of a tet are moved at the same time, at last those around it, too.
//!
//! Where no vertex alone can make the worst tet around it any better (`smoothing`), several may:
//! one makes room for the next, but alone it would make another tet worse. The least measure of all
//! tets around them is a function of all their coordinates, the least of the measure's parts:
//! squared sines of angles, mostly. These are smooth, so the way up is found by their values and
//! gradients (`minmax`). Each vertex keeps to what it belongs to. The angles of interface facets
//! that are hardly larger than what was asked for count like those of tets.
//!
//! A trial that does not raise the least measure tells how far off the linear models are; the next
//! one takes that into account. Only if it fails, too, shorter steps are tried.
//!
//! It takes many times as long as to move one vertex, so it is for tets that nothing else helped.
//! With a target of 20 degrees, nine of ten are helped by their own four vertices
//! (docs/reference/improvement.md).

use glam::DVec3;

use super::measure::is_positive;
use super::minmax::{Gradient, Models, Step};
use super::patch::{Mover, Patch, PatchFacet};
use super::worker::{GAIN, Outcome, Worker};

/// Steps of all vertices.
const MAX_STEPS: usize = 80;
/// Trials of one step.
const MAX_TRIALS: usize = 12;
/// Parts of measures that are below the aim by this factor shape a step.
const ACTIVE: f64 = 3.0;
/// Most of them, and most angles of facets.
const MAX_ACTIVE: usize = 96;
/// An angle of an interface facet shapes a step if its squared sine is below the bound by this
/// factor.
const TIGHT: f64 = 1.3;
/// By so many times the aim a term of a facet rises where the squared sine of its angle rises by
/// the bound. A tet's rises by the aim where its measure does. So a small rise of the angle makes
/// room for a large one of the measure.
const WEIGHT_OF_FACETS: f64 = 10.0;
/// The first reach is so many times that which would bring the worst tet to the aim alone.
const FIRST_REACH: f64 = 4.0;
/// The reach after a step, and after trials that failed.
const LONGER: f64 = 2.0;
const SHORTER: f64 = 0.25;
/// A step is to end above the aim by this part of what is missing, or by that part of the aim if
/// that is more: what is shorter is lost in how precisely places on interfaces are found.
const BEYOND: f64 = 0.2;
const BEYOND_AIM: f64 = 0.02;
/// The least measure must rise to the target, or by this part of it: more than one vertex alone has
/// to bring about. So there are no endless small gains where nothing can reach the target.
const WORTHWHILE: f64 = 0.05;

/// A function of the places of some vertices, the least of which a step is to raise.
struct Term {
    /// What it is at the place, less the least measure.
    value: f64,
    of: Of,
    /// Which of the functions of this tet or facet.
    part: usize,
    gradient: Gradient,
}

#[derive(Clone, Copy)]
enum Of {
    /// A part of a tet's measure.
    Tet([usize; 4]),
    /// By how much the squared sine of a facet's angle is above the least one allowed.
    Facet { facet: [usize; 3], least: f64 },
}

impl Worker<'_, '_> {
    /// Moves the vertices of a tet together until it reaches the target or nothing helps.
    pub fn smooth_jointly(&mut self, t: u32) -> Outcome {
        match self.stars_of(t) {
            Some(stars) => self.smooth_patch(self.patch(stars)),
            None => Outcome::Foreign,
        }
    }

    /// The same with those around, as far as the block owns them.
    pub fn smooth_around(&mut self, t: u32) -> Outcome {
        let Some(stars) = self.stars_of(t) else { return Outcome::Foreign };
        let (around, are_all) = self.stars_around(&stars);
        match self.smooth_patch(self.patch(around)) {
            Outcome::Failed if !are_all => Outcome::Foreign,
            outcome => outcome,
        }
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
        let mut reach = None;
        for _ in 0..MAX_STEPS {
            match self.step_jointly(&patch, &at, min, &mut reach) {
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
        let measures = patch.tets.iter().map(|tet| self.round.measure.of(&tet.map(|v| at[v])));
        measures.fold(f64::INFINITY, f64::min)
    }

    /// One step uphill, where the least measure is `min`: where to, and what it is there. The
    /// `reach` of a step is kept for the next one.
    fn step_jointly(
        &self,
        patch: &Patch,
        at: &[DVec3],
        min: f64,
        reach: &mut Option<f64>,
    ) -> Option<(Vec<DVec3>, f64)> {
        let terms = self.terms(patch, at, min);
        let (values, gradients) = terms.iter().map(|term| (term.value, term.gradient)).unzip();
        let mut models = Models::new(values, gradients);
        let of_step = FIRST_REACH * (self.aim - min) / models.steepness();
        let reach = reach.get_or_insert(of_step);
        // Nothing rises, or nothing is a number.
        if !reach.is_finite() || *reach <= 0.0 {
            return None;
        }
        let enough = (min + 0.1 * GAIN).min(self.aim.next_down());
        let wanted = (self.aim - min) + (BEYOND * (self.aim - min)).max(BEYOND_AIM * self.aim);
        let mut is_corrected = false;
        for _ in 0..MAX_TRIALS {
            let Step { mut way, least: rise, is_best } = models.step(patch.movers.len(), *reach);
            let mut part = 1.0;
            // Also where nothing is a number.
            let is_uphill = rise > 0.1 * GAIN;
            if is_uphill {
                part = self.part_of_way(patch, at, &way).min(wanted / rise);
                way.iter_mut().for_each(|way| *way *= part);
            } else if is_best && !is_corrected {
                return None;
            }
            let to = if is_uphill { self.land_jointly(patch, at, &way) } else { None };
            if let Some(to) = to {
                let reached = self.min_in(patch, &to);
                if reached > enough && self.is_allowed(patch, &to) {
                    // A step that was cut short does not tell whether longer ones would do.
                    if !is_corrected && part == 1.0 {
                        *reach *= LONGER;
                    }
                    return Some((to, reached));
                }
                if !is_corrected {
                    let reached: Vec<f64> =
                        terms.iter().map(|term| self.value_of(term, &to, min)).collect();
                    if models.correct(&way, &reached) {
                        is_corrected = true;
                        continue;
                    }
                }
            }
            models.restore();
            is_corrected = false;
            *reach *= SHORTER * part;
        }
        None
    }

    /// The part of a way, 1 at most, on which no vertex goes farther than one may in one step.
    fn part_of_way(&self, patch: &Patch, at: &[DVec3], way: &[DVec3]) -> f64 {
        let parts = patch.movers.iter().zip(at).zip(way).map(|((mover, &at), way)| {
            self.max_step(&mover.star, mover.place.support, at) / way.length()
        });
        parts.fold(1.0, f64::min)
    }

    /// Where the vertices of a patch end whose movers are to go along their ways; `None`: one may
    /// not.
    fn land_jointly(&self, patch: &Patch, at: &[DVec3], way: &[DVec3]) -> Option<Vec<DVec3>> {
        let mut to = at.to_vec();
        for ((mover, way), to) in patch.movers.iter().zip(way).zip(&mut to) {
            if *way != DVec3::ZERO {
                *to = self.land(&mover.star, &mover.place, *to + *way)?;
            }
        }
        Some(to)
    }

    /// Whether all tets of a patch are positive, and the facets keep their angles and walls.
    fn is_allowed(&self, patch: &Patch, at: &[DVec3]) -> bool {
        let is_kept = |facet: &PatchFacet| {
            let [new, old] = [at, &patch.start].map(|at| facet.vertices.map(|v| at[v]));
            self.round.interfaces.keep_facets([new], [old], facet.labels)
        };
        let mut tets = patch.tets.iter().chain(&patch.background);
        tets.all(|tet| is_positive(&tet.map(|v| at[v]))) && patch.facets.iter().all(is_kept)
    }

    /// What shapes a step: the parts of measures that are low, the lowest first, then the angles of
    /// facets that are tight.
    fn terms(&self, patch: &Patch, at: &[DVec3], min: f64) -> Vec<Term> {
        let lowest = |mut terms: Vec<Term>| {
            terms.sort_by(|a, b| a.value.total_cmp(&b.value));
            terms.truncate(MAX_ACTIVE);
            terms
        };
        let (mut of_tets, mut of_facets) = (Vec::new(), Vec::new());
        for tet in &patch.tets {
            let parts = |corners: &[DVec3; 4]| self.parts_of_tet(corners, min);
            let max = ACTIVE * self.aim - min;
            of_tets.extend(patch.terms_below(max, at, tet, Of::Tet(*tet), parts));
        }
        for PatchFacet { vertices: facet, .. } in &patch.facets {
            let before = squared_sines(&facet.map(|v| patch.start[v]));
            let least = before.into_iter().fold(self.facet_bound(), f64::min);
            let parts = |corners: &[DVec3; 3]| self.parts_of_facet(corners, least);
            let max = WEIGHT_OF_FACETS * (TIGHT - 1.0) * self.aim;
            let of = Of::Facet { facet: *facet, least };
            of_facets.extend(patch.terms_below(max, at, facet, of, parts));
        }
        let mut terms = lowest(of_tets);
        terms.extend(lowest(of_facets));
        terms
    }

    /// What a term is at some places.
    fn value_of(&self, term: &Term, at: &[DVec3], min: f64) -> f64 {
        match term.of {
            Of::Tet(tet) => self.parts_of_tet(&tet.map(|v| at[v]), min)[term.part],
            Of::Facet { facet, least } => {
                self.parts_of_facet(&facet.map(|v| at[v]), least)[term.part]
            }
        }
    }

    /// By how much the parts of a tet's measure are above `min`.
    fn parts_of_tet(&self, corners: &[DVec3; 4], min: f64) -> [f64; 7] {
        self.round.measure.parts(corners).map(|part| part - min)
    }

    /// By how much the squared sines of a facet's angles are above the least one allowed, with the
    /// weight of facets.
    fn parts_of_facet(&self, corners: &[DVec3; 3], least: f64) -> [f64; 3] {
        let weight = WEIGHT_OF_FACETS * self.aim / self.facet_bound();
        squared_sines(corners).map(|squared| weight * (squared - least))
    }

    /// The squared sine of the smallest angle that a facet is asked for.
    fn facet_bound(&self) -> f64 {
        1.0 - self.round.interfaces.facet_cosine_squared
    }
}

impl Patch {
    /// The terms of a tet or facet that are not above `max`.
    fn terms_below<const N: usize, const M: usize>(
        &self,
        max: f64,
        at: &[DVec3],
        vertices: &[usize; N],
        of: Of,
        parts: impl Fn(&[DVec3; N]) -> [f64; M],
    ) -> Vec<Term> {
        let values = parts(&vertices.map(|v| at[v]));
        if values.iter().all(|&value| value > max) {
            return Vec::new();
        }
        let gradients = self.gradients(at, vertices, values, parts);
        let terms = values.into_iter().zip(gradients).enumerate();
        terms
            .filter(|&(_, (value, _))| value <= max)
            .map(|(part, (value, gradient))| Term { value, of, part, gradient })
            .collect()
    }
}

/// The squared sines of the angles of a triangle.
fn squared_sines(&[a, b, c]: &[DVec3; 3]) -> [f64; 3] {
    let (u, v, w) = ((b - a).length_squared(), (c - a).length_squared(), (c - b).length_squared());
    let squared_area = (b - a).cross(c - a).length_squared();
    [u * v, u * w, v * w].map(|product| squared_area / product)
}
