//! The step that raises the least of some functions most, by their values and gradients.
//!
//! With values v_i and gradients g_i at a place, the step d maximizes
//! min_i (v_i + g_i . d) - |d|^2 / (2 r): the least of the linear models, with a price on the
//! length (the proximal step of bundle methods: K. C. Kiwiel, "Methods of Descent for
//! Nondifferentiable Optimization", 1985). A function that is well above the least counts, too, as
//! soon as the step would bring it down to that. The larger the *reach* r, the longer the step.
//!
//! By duality d = r sum_i w_i g_i. The weights w_i >= 0, of sum 1, minimize
//! r/2 |sum_i w_i g_i|^2 + sum_i w_i v_i. They are found by moving weight from one model to the
//! lowest one, again and again (J. C. Platt, "Fast training of support vector machines using
//! sequential minimal optimization", 1999), which takes nothing but the products of gradients.

use glam::DVec3;

/// Most moves of weight.
const MAX_MOVES: usize = 400;
/// The weights are good when the models that have weight are as high as the least one, but for this
/// part of how far they rise.
const PRECISION: f64 = 0.02;
/// Values that differ by less are equal. Measures are between 0 and 1.
const NEGLIGIBLE: f64 = 1e-7;

/// A gradient by the places of some vertices: the numbers of at most four, and its part for each.
pub(super) type Gradient = [(usize, DVec3); 4];
/// The number of no vertex, in a gradient.
pub(super) const NO_VERTEX: usize = usize::MAX;

/// The linear models of some functions, one at least.
#[derive(Debug)]
pub(super) struct Models {
    /// What the functions are at the place.
    start: Vec<f64>,
    /// The same, lower where corrected.
    values: Vec<f64>,
    gradients: Vec<Gradient>,
    /// The products of all pairs of gradients, row by row.
    products: Vec<f64>,
}

/// A step of some vertices.
pub(super) struct Step {
    pub way: Vec<DVec3>,
    /// What the least model is after it.
    pub least: f64,
    /// Whether it is the best one, nearly. With a shorter reach it is found sooner.
    pub is_best: bool,
}

struct Weights {
    weights: Vec<f64>,
    /// What the least model is after the step that they make.
    least: f64,
    are_best: bool,
}

impl Models {
    pub fn new(values: Vec<f64>, gradients: Vec<Gradient>) -> Self {
        let mut products = Vec::with_capacity(gradients.len() * gradients.len());
        for a in &gradients {
            products.extend(gradients.iter().map(|b| product(a, b)));
        }
        Self { start: values.clone(), values, gradients, products }
    }

    /// The squared length of the first gradient.
    pub fn steepness(&self) -> f64 {
        self.products[0]
    }

    /// Undoes all corrections.
    pub fn restore(&mut self) {
        self.values.clone_from(&self.start);
    }

    /// Lowers the functions that have less than their models say after a `step`, so that the next
    /// one takes their curvature into account. Returns whether there are any.
    pub fn correct(&mut self, step: &[DVec3], reached: &[f64]) -> bool {
        let mut any = false;
        for ((value, gradient), &reached) in
            self.values.iter_mut().zip(&self.gradients).zip(reached)
        {
            let rise: f64 = parts(gradient).map(|(v, part)| part.dot(step[v])).sum();
            let off = reached - *value - rise;
            if off < 0.0 {
                (*value, any) = (*value + off, true);
            }
        }
        any
    }

    /// The step of so many vertices with a reach.
    pub fn step(&self, vertices: usize, reach: f64) -> Step {
        let Weights { weights, least, are_best } = self.weights(reach, MAX_MOVES);
        Step { way: self.step_of(&weights, vertices, reach), least, is_best: are_best }
    }

    fn step_of(&self, weights: &[f64], vertices: usize, reach: f64) -> Vec<DVec3> {
        let mut step = vec![DVec3::ZERO; vertices];
        for (gradient, weight) in self.gradients.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
            for (v, part) in parts(gradient) {
                step[v] += part * (weight * reach);
            }
        }
        step
    }

    /// The weights after so many moves.
    fn weights(&self, reach: f64, moves: usize) -> Weights {
        let count = self.values.len();
        let row = |i: usize| &self.products[i * count..(i + 1) * count];
        let lowest = |heights: &[f64]| {
            (0..count).min_by(|&i, &j| heights[i].total_cmp(&heights[j])).unwrap_or(0)
        };
        let first = lowest(&self.values);
        let mut weights = vec![0.0_f64; count];
        weights[first] = 1.0;
        // What the models are after the step.
        let mut heights: Vec<f64> =
            self.values.iter().zip(row(first)).map(|(value, by)| value + reach * by).collect();
        for _ in 0..moves {
            let low = lowest(&heights);
            let weighty = || (0..count).filter(|&i| weights[i] > 0.0);
            let highest = weighty().map(|i| heights[i]).fold(f64::NEG_INFINITY, f64::max);
            if highest - heights[low] <= PRECISION * highest.abs() + NEGLIGIBLE {
                return Weights { weights, least: heights[low], are_best: true };
            }
            // By how much the gap to a model closes as weight moves from it to the lowest one.
            let slope_of = |i: usize| reach * (row(low)[low] + row(i)[i] - 2.0 * row(low)[i]);
            // The one from which it brings most (R.-E. Fan, P.-H. Chen, C.-J. Lin, "Working set
            // selection using second order information", 2005).
            let gain = |i: usize| {
                let gap = (heights[i] - heights[low]).max(0.0);
                gap * gap / slope_of(i).max(f64::MIN_POSITIVE)
            };
            let from = weighty().max_by(|&i, &j| gain(i).total_cmp(&gain(j))).unwrap_or(first);
            let (slope, gap) = (slope_of(from), heights[from] - heights[low]);
            let moved = if slope > 0.0 { weights[from].min(gap / slope) } else { weights[from] };
            weights[low] += moved;
            weights[from] -= moved;
            for ((height, to), from) in heights.iter_mut().zip(row(low)).zip(row(from)) {
                *height += reach * moved * (to - from);
            }
        }
        let least = heights[lowest(&heights)];
        Weights { weights, least, are_best: false }
    }
}

/// The parts of a gradient.
fn parts(gradient: &Gradient) -> impl Iterator<Item = (usize, DVec3)> {
    gradient.iter().copied().filter(|&(v, _)| v != NO_VERTEX)
}

fn product(a: &Gradient, b: &Gradient) -> f64 {
    let of = |(v, part): (usize, DVec3)| -> f64 {
        parts(b).filter(|&(w, _)| w == v).map(|(_, other)| part.dot(other)).sum()
    };
    parts(a).map(of).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const VERTICES: usize = 6;

    /// Functions of four of six vertices.
    fn models() -> impl Strategy<Value = Models> {
        let part = (0..VERTICES, prop::array::uniform3(-1.0..1.0_f64));
        let gradient = prop::array::uniform4(part).prop_map(|parts| {
            let mut gradient = parts.map(|(v, part)| (v, DVec3::from_array(part)));
            for i in 1..4 {
                if gradient[..i].iter().any(|&(v, _)| v == gradient[i].0) {
                    gradient[i] = (NO_VERTEX, DVec3::ZERO);
                }
            }
            gradient
        });
        prop::collection::vec((0.0..1.0_f64, gradient), 1..40).prop_map(|functions| {
            let (values, gradients) = functions.into_iter().unzip();
            Models::new(values, gradients)
        })
    }

    proptest! {
        /// With the best weights each model that has weight is the least one, nearly. The models
        /// are after the step what they are said to be.
        #[test]
        fn the_step_is_the_best_one(models in models(), reach in 0.01..10.0_f64) {
            let Weights { weights, least, are_best } = models.weights(reach, 100 * MAX_MOVES);
            prop_assert!(are_best);
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let step = models.step_of(&weights, VERTICES, reach);
            for ((gradient, value), weight) in
                models.gradients.iter().zip(&models.values).zip(weights)
            {
                let rise: f64 = parts(gradient).map(|(v, part)| part.dot(step[v])).sum();
                let height = value + rise;
                prop_assert!(height > least - 1e-9, "{height} is below {least}");
                let most = least + PRECISION * height.abs() + 2.0 * NEGLIGIBLE;
                prop_assert!(weight == 0.0 || weight > 0.0 && height <= most, "{height} {least}");
            }
        }

        /// However far the weights are from the best ones, the models are what they are said to be.
        #[test]
        fn the_least_model_is_told(models in models(), reach in 0.01..1e6_f64) {
            let Step { way: step, least, .. } = models.step(VERTICES, reach);
            let rise = |gradient: &Gradient| -> f64 {
                parts(gradient).map(|(v, part)| part.dot(step[v])).sum()
            };
            let heights = models.values.iter().zip(&models.gradients);
            let lowest = heights.map(|(value, g)| value + rise(g)).fold(f64::INFINITY, f64::min);
            prop_assert!((lowest - least).abs() < 1e-9 * reach.max(1.0), "{lowest} {least}");
        }

        /// After a correction the models have no more than what was reached.
        #[test]
        fn corrected_models_have_what_was_reached(
            mut models in models(),
            step in prop::array::uniform6(prop::array::uniform3(-0.5..0.5_f64)),
            less in 0.0..0.5_f64,
        ) {
            let step = step.map(DVec3::from_array);
            let heights = |models: &Models| -> Vec<f64> {
                let rise = |gradient: &Gradient| -> f64 {
                    parts(gradient).map(|(v, part)| part.dot(step[v])).sum()
                };
                let rises = models.gradients.iter().map(rise);
                models.values.iter().zip(rises).map(|(value, rise)| value + rise).collect()
            };
            let before = heights(&models);
            // Every second one is lower than its model says, the others are higher.
            let off = |i: usize| if i.is_multiple_of(2) { -less } else { less };
            let reached: Vec<f64> = before.iter().enumerate().map(|(i, h)| h + off(i)).collect();
            prop_assert_eq!(models.correct(&step, &reached), less > 0.0);
            for (i, height) in heights(&models).into_iter().enumerate() {
                prop_assert!((height - before[i].min(reached[i])).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn opposite_functions_meet_in_the_middle() {
        let gradient = |x: f64| {
            let mut gradient = [(NO_VERTEX, DVec3::ZERO); 4];
            gradient[0] = (0, DVec3::X * x);
            gradient
        };
        let models = Models::new(vec![0.0, 1.0], vec![gradient(1.0), gradient(-1.0)]);
        let Step { way: step, least, .. } = models.step(1, 100.0);
        assert!((step[0] - DVec3::X * 0.5).length() < 0.01 && (least - 0.5).abs() < 0.01);
        let Step { way: step, least, .. } = models.step(1, 0.1);
        assert!((step[0] - DVec3::X * 0.1).length() < 1e-9 && (least - 0.1).abs() < 1e-9);
    }
}
