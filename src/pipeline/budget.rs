//! How coarse a mesh of so many tets is: the factor by which delta, the sizes and the spacing floor
//! are multiplied ([`MeshParams::scaled`]).
//!
//! First the factor at which as many tets are to be expected
//! ([`expected_tets`](crate::sizing::expected)): no mesh is made for that. Then the mesh is made
//! with it, and its tets are counted. Where they are too many or too few, it is made again with
//! another factor, by the power law through the two nearest tries. Mostly one or two tries do.
//! Where the refined mesh is far off already, it is not improved. If it is to be coarsened only the
//! mesh in the end tells, and the spacing floor stays as it is.
//!
//! It ends: tries are counted.

use super::prepare::contacts_of;
use crate::Result;
use crate::image::LabelImage;
use crate::image::region::{Region, Rows};
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::{Adaptive, Improve, MeshParams};
use crate::refine::options::Limits;
use crate::sizing::Sizing;
use crate::sizing::expected::{expected_coarsened, expected_tets};

/// How far from what was asked for the number of tets may be.
const WITHIN: f64 = 0.1;

/// How far from it a refined mesh may be that is worth being improved.
const FAR_OFF: f64 = 0.3;

/// Most meshes that are refined.
const TRIES: usize = 7;

/// Most times that tets to be expected are counted before, and how near these come.
const GUESSES: usize = 8;
const GUESS_WITHIN: f64 = 0.02;

/// How the number of tets depends on the factor before two tries have told: about as that of
/// samples on surfaces.
const EXPONENT: f64 = 2.0;

/// What two tries that lie close may tell of it is believed within these.
const EXPONENTS: [f64; 2] = [0.7, 3.5];

/// No step is larger than this factor, or smaller than its inverse.
const LARGEST_STEP: f64 = 8.0;

/// The step after a mesh without tets.
const NO_TETS_STEP: f64 = 0.25;

/// The part of the tets of a refined mesh that is left when slivers have been removed, before one
/// has told: 0.95 to 0.97 on the atlases, less where a mesh has few tets.
const LEFT_BY_IMPROVEMENT: f64 = 0.96;

/// A coarsened mesh that was sampled by topology has 1 / (1 + `FEWER_PER_SIDE` delta) of the tets
/// that it has when sampled by thickness; delta in smallest sides of a voxel. Measured at 3 and 6
/// sides (docs/notes/sampling.md).
const FEWER_PER_SIDE: f64 = 0.05;

/// How many tets of labels are to be expected of a mesh that is coarsened.
///
/// # Errors
/// As [`expected_tets`].
pub(super) fn expected_after_coarsening(
    image: &LabelImage,
    rows: &Rows,
    params: &MeshParams,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<f64> {
    let left = expected_coarsened(image, rows, params, check)?.of_labels;
    // It has no more than were refined, as far as that is known.
    let (refined, left) = match params.adaptive {
        Adaptive::Topology => {
            let sides = params.delta / image.frame().spacing().min_element();
            (&by_thickness(params), left / (1.0 + FEWER_PER_SIDE * sides))
        }
        Adaptive::Off | Adaptive::Thickness => (params, left),
    };
    Ok(left.min(expected_tets(image, rows, refined, &[], check)?.of_labels))
}

fn by_thickness(params: &MeshParams) -> MeshParams {
    MeshParams { adaptive: Adaptive::Thickness, ..params.clone() }
}

/// The search for the factor.
pub(super) struct Search {
    /// The tets that are wanted.
    wanted: f64,
    /// Those of the last refined mesh, and the part of these that improvement leaves.
    refined: f64,
    left: f64,
    /// Whether the refined mesh is coarsened: how many tets it has tells nothing then.
    coarsens: bool,
    /// Factors that were tried, and what came of them.
    tries: Vec<(f64, f64)>,
    factor: f64,
}

impl Search {
    /// A search that begins with the factor at which as many tets are to be expected.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory), [`Cancelled`](crate::Error::Cancelled).
    pub(super) fn new(
        image: &LabelImage,
        params: &MeshParams,
        target: u64,
        limits: &Limits,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let check = || monitor.advance(0).and_then(|()| limits.check_time());
        let region = Region::new(image, &check)?;
        // What coarsening leaves is told by thickness, whatever samples follow.
        let told_by = if params.coarsen.is_some() { &by_thickness(params) } else { params };
        let tables = Rows::bytes(region.dims) + Sizing::bytes_needed(image, &region, told_by);
        let coarsens = params.coarsen.is_some();
        let needs_contacts = !coarsens && params.adaptive == Adaptive::Topology;
        let of_oracle = if needs_contacts { Oracle::bytes_needed(image, &region) } else { 0 };
        limits.check_memory(tables + of_oracle)?;
        let rows = Rows::new(image, region, &check)?;
        let contacts =
            if needs_contacts { contacts_of(image, &rows, params, &check)? } else { Vec::new() };
        let left = if params.improve == Improve::Full { LEFT_BY_IMPROVEMENT } else { 1.0 };
        let wanted = target as f64;
        let mut guess = Self::of(wanted);
        for _ in 0..GUESSES {
            let scaled = params.scaled(guess.factor);
            let expected = if coarsens {
                expected_after_coarsening(image, &rows, &scaled, &check)?
            } else {
                expected_tets(image, &rows, &scaled, &contacts, &check)?.of_labels
            };
            if !guess.goes_on(expected, GUESS_WITHIN) {
                break;
            }
        }
        Ok(Self { left, coarsens, factor: guess.factor, ..Self::of(wanted) })
    }

    /// A search that knows nothing yet.
    fn of(wanted: f64) -> Self {
        let (tries, coarsens) = (Vec::new(), false);
        Self { wanted, refined: 0.0, left: 1.0, coarsens, tries, factor: 1.0 }
    }

    /// The factor to try.
    pub(super) fn factor(&self) -> f64 {
        self.factor
    }

    /// The parts of the step of refinement that the next try has: half of what is left.
    pub(super) fn parts(&self) -> [f64; 2] {
        let left = 0.5_f64.powi(self.tries.len() as i32);
        [1.0 - left, 1.0 - 0.5 * left]
    }

    /// Takes in how many tets the refined mesh with that factor has; whether they are so far from
    /// what is wanted that it is not worth going on with it, and there is another factor to try.
    pub(super) fn is_far_off(&mut self, tets: u64) -> bool {
        self.refined = tets as f64;
        !self.coarsens && self.may_try_again() && self.goes_on(self.left * self.refined, FAR_OFF)
    }

    /// Takes in how many tets the mesh with that factor has in the end; whether there is another
    /// one to try.
    pub(super) fn try_again(&mut self, tets: u64) -> bool {
        self.left = tets as f64 / self.refined;
        self.may_try_again() && self.goes_on(tets as f64, WITHIN)
    }

    fn may_try_again(&self) -> bool {
        self.tries.len() + 1 < TRIES
    }

    fn goes_on(&mut self, tets: f64, within: f64) -> bool {
        if (tets / self.wanted - 1.0).abs() <= within {
            return false;
        }
        // None is fewer than one.
        self.tries.push((self.factor, tets.max(0.1)));
        let off = |&(_, tets): &(f64, f64)| (tets / self.wanted).ln().abs();
        // Of those without tets the smallest factor.
        self.tries.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.0.total_cmp(&b.0)));
        let (factor, tets) = self.tries[0];
        if self.tries.len() + 1 == TRIES {
            // The last one is the best of all; without a tet there is no mesh.
            let best = self.tries.iter().find(|(_, tets)| *tets >= 1.0);
            self.factor = best.map_or(factor, |(factor, _)| *factor);
            return true;
        }
        // The nearest on the other side of what is wanted, else the nearest of all.
        let other_side = |&&(_, t): &&(f64, f64)| (t < self.wanted) != (tets < self.wanted);
        let second = self.tries.iter().find(other_side).or(self.tries.get(1));
        let exponent = second.map_or(EXPONENT, |&(other, others)| {
            let [least, most] = EXPONENTS;
            let found = -(others / tets).ln() / (other / factor).ln();
            if found.is_finite() { found.clamp(least, most) } else { EXPONENT }
        });
        // Where there is no tet there is nothing to go by.
        let step =
            if tets < 1.0 { NO_TETS_STEP } else { (tets / self.wanted).powf(1.0 / exponent) };
        let mut next = factor * step.clamp(1.0 / LARGEST_STEP, LARGEST_STEP);
        // Numbers of tets go up and down where they are few: then half the way.
        while self.tries.iter().any(|&(tried, _)| tried == next) && next != factor {
            next = (next * factor).sqrt();
        }
        self.factor = next;
        next != factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any power law is met, and steps of it.
    #[test]
    fn factors_are_found() {
        for exponent in [1.0, 1.8, 2.0, 2.7, 3.3] {
            for wanted in [1e2, 1e4, 1e6] {
                let tets = |factor: f64| 5e4 * factor.powf(-exponent) * (1.0 + 0.1 * factor.sin());
                let mut search = Search::of(wanted);
                let mut tries = 1;
                // A tenth goes when slivers do.
                while search.is_far_off((1.1 * tets(search.factor())) as u64)
                    || search.try_again(tets(search.factor()) as u64)
                {
                    tries += 1;
                }
                let got = tets(search.factor());
                assert!((got / wanted - 1.0).abs() <= 1.01 * WITHIN, "{exponent} {wanted} {got}");
                assert!(tries <= TRIES);
            }
        }
        // What cannot be had ends, too.
        let mut search = Search::of(1e6);
        let mut tries = 1;
        while search.is_far_off(10) || search.try_again(10) {
            tries += 1;
        }
        assert!(tries <= TRIES);
    }
}
