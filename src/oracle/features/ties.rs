//! Where the weighted indicators of several labels tie: on a rectangle across a cell three, in its
//! interior four.
//!
//! On a plane across a cell, parallel to two of its axes, each label's weighted indicator is
//! bilinear. Where three are equal, their two differences P and Q vanish. P is linear in y, so y
//! can be eliminated: what is left is a quadratic equation in x, and no point is missed. The tie of
//! four labels is found by Newton's method, from the mean of points known to lie on lines that end
//! there.
//!
//! A tie is kept when no other label is ahead, and when its labels' gradients are in general
//! position. Then each of them leads in a sector around the point: a label's indicator grows
//! fastest of all in some direction exactly if its gradient is a corner of the hull of all of them,
//! and the corners of a triangle (a tetrahedron) all are.

use glam::{DMat3, DVec3};

use crate::image::bits::ones;
use crate::oracle::model::indicator::Corners;

/// Most labels of a cell.
pub(crate) const MAX: usize = 8;
/// By how much others may be ahead at a tie, and its own labels apart: rounding.
const SLACK: f64 = 1e-7;
/// The least determinant of differences of gradients: below, the labels' interfaces touch rather
/// than cross.
const MIN_DETERMINANT: f64 = 1e-6;
/// Newton steps; four or five are usual.
const NEWTON_STEPS: usize = 20;
/// How far outside of a cell Newton's method may look.
const MARGIN: f64 = 0.25;

/// Weighted indicators of the labels of a cell: of each its weight, and at each corner which of
/// them is there.
pub(crate) struct Cube {
    count: usize,
    weights: [f64; MAX],
    labels: [u8; 8],
}

/// Weighted indicators, or other values, of at most N labels on a rectangle, given in [0, 1]^2, by
/// their values at its corners; corner c lies at (c & 1, c >> 1).
pub(crate) struct Square<const N: usize = MAX> {
    /// A bit for each label that is somewhere on it.
    present: u64,
    values: [[f64; 4]; N],
}

impl Cube {
    pub(crate) fn new(ids: &Corners, weights: &[f32]) -> Self {
        let mut cube = Self { count: 0, weights: [0.0; MAX], labels: [0; 8] };
        for (c, id) in ids.iter().enumerate() {
            cube.labels[c] = match ids[..c].iter().position(|other| other == id) {
                Some(earlier) => cube.labels[earlier],
                None => {
                    cube.weights[cube.count] = f64::from(weights[usize::from(*id)]);
                    cube.count += 1;
                    cube.count as u8 - 1
                }
            };
        }
        cube
    }

    /// How many labels there are.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The rectangle across the cube at `at` in [0, 1] on an axis. Its own axes are the next two,
    /// in cyclic order.
    pub(crate) fn cut(&self, axis: usize, at: f64) -> Square {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut square = Square { present: 0, values: [[0.0; 4]; MAX] };
        for c in 0..4 {
            let low = (c & 1) << u | (c >> 1) << v;
            for (corner, part) in [(low, 1.0 - at), (low | 1 << axis, at)] {
                let label = usize::from(self.labels[corner]);
                square.values[label][c] += part * self.weights[label];
                square.present |= u64::from(part > 0.0) << label;
            }
        }
        square
    }

    /// The point where four labels, given by their numbers, tie and no other is ahead; Newton's
    /// method from `start`.
    pub(crate) fn tie_of_four(&self, labels: [usize; 4], start: DVec3) -> Option<DVec3> {
        let mut x = start;
        for _ in 0..NEWTON_STEPS {
            let [(base, slope), rest @ ..] = labels.map(|l| self.value_and_gradient(l, x));
            let apart = DVec3::from(rest.map(|(value, _)| value - base));
            let differences =
                DMat3::from_cols_array_2d(&rest.map(|(_, gradient)| (gradient - slope).to_array()));
            if differences.determinant().abs() < MIN_DETERMINANT {
                return None;
            }
            let step = differences.transpose().inverse() * apart;
            x -= step;
            if !(x.cmpge(DVec3::splat(-MARGIN)).all() && x.cmple(DVec3::splat(1.0 + MARGIN)).all())
            {
                return None;
            }
            if step.abs().max_element() < 1e-10 {
                let inside =
                    x.cmpge(DVec3::splat(-1e-9)).all() && x.cmple(DVec3::splat(1.0 + 1e-9)).all();
                return (inside && self.leads(labels, x)).then(|| x.clamp(DVec3::ZERO, DVec3::ONE));
            }
        }
        None
    }

    fn leads(&self, labels: [usize; 4], x: DVec3) -> bool {
        let tie = self.value_and_gradient(labels[0], x).0;
        (0..self.count)
            .all(|l| labels.contains(&l) || self.value_and_gradient(l, x).0 <= tie + SLACK)
    }

    fn value_and_gradient(&self, label: usize, x: DVec3) -> (f64, DVec3) {
        let at_corner = self.weights[label];
        let parts = [0, 1, 2].map(|a| [1.0 - x[a], x[a]]);
        let (mut value, mut gradient) = (0.0, DVec3::ZERO);
        for c in (0..8).filter(|&c| usize::from(self.labels[c]) == label) {
            let [p, q, r] = [0, 1, 2].map(|a| parts[a][c >> a & 1]);
            let sign = |a: usize| if c >> a & 1 == 1 { at_corner } else { -at_corner };
            value += at_corner * p * q * r;
            gradient += DVec3::new(sign(0) * q * r, sign(1) * p * r, sign(2) * p * q);
        }
        (value, gradient)
    }
}

impl<const N: usize> Square<N> {
    /// The square on which the labels, numbered in turn, have these values at the corners.
    pub(crate) fn new(values: impl Iterator<Item = [f64; 4]>) -> Self {
        const { assert!(N <= u64::BITS as usize, "a bit for each label") };
        let mut square = Self { present: 0, values: [[0.0; 4]; N] };
        for (label, (slot, values)) in square.values.iter_mut().zip(values).enumerate() {
            *slot = values;
            square.present |= 1 << label;
        }
        square
    }

    /// The number of a label that no other one is ahead of at a point.
    pub(crate) fn leader(&self, at: [f64; 2]) -> usize {
        let ahead = |a: usize, b: usize| if self.value(b, at) > self.value(a, at) { b } else { a };
        self.labels(0).reduce(ahead).unwrap_or(0)
    }

    /// The labels that are somewhere on the square, from number `from` on.
    fn labels(&self, from: usize) -> impl Iterator<Item = usize> + Clone + use<N> {
        ones(self.present & u64::MAX << from)
    }

    /// Calls `visit` for each point where three labels tie and no other is ahead, with a bit for
    /// each of the three.
    pub(crate) fn ties_of_three(&self, mut visit: impl FnMut(u64, [f64; 2])) {
        let apart = |a: usize, b: usize| {
            let difference = Bilinear::difference(&self.values[a], &self.values[b]);
            // Otherwise one of the two is ahead everywhere.
            difference.has_zero().then_some(difference)
        };
        for a in self.labels(0) {
            for b in self.labels(a + 1) {
                let mut others = self.labels(b + 1).peekable();
                if others.peek().is_none() {
                    // Nor do later labels have two after them.
                    break;
                }
                let Some(p) = apart(a, b) else { continue };
                for c in others {
                    if let Some(q) = apart(a, c)
                        && apart(b, c).is_some()
                    {
                        self.ties_of([a, b, c], &p, &q, &mut visit);
                    }
                }
            }
        }
    }

    /// The ties of labels a, b and c, where `p` is a - b and `q` is a - c.
    fn ties_of(
        &self,
        labels @ [a, _, _]: [usize; 3],
        p: &Bilinear,
        q: &Bilinear,
        visit: &mut impl FnMut(u64, [f64; 2]),
    ) {
        let roots = quadratic_roots(
            q.x * p.xy - q.xy * p.x,
            q.one * p.xy + q.x * p.y - q.y * p.x - q.xy * p.one,
            q.one * p.y - q.y * p.one,
        );
        for x in roots.into_iter().flatten() {
            let [of_p, of_q] = [p, q].map(|f| f.y + f.xy * x);
            let by = if of_p.abs() >= of_q.abs() { p } else { q };
            let y = -(by.one + by.x * x) / (by.y + by.xy * x);
            // Also where this is no number.
            if !([x, y].iter().all(|c| (-1e-12..=1.0 + 1e-12).contains(c))) {
                continue;
            }
            let at = [x, y].map(|c| c.clamp(0.0, 1.0));
            let tie = self.value(a, at);
            let determinant = (p.x + p.xy * y) * of_q - (q.x + q.xy * y) * of_p;
            let is_tie = p.at(at).abs() <= SLACK
                && q.at(at).abs() <= SLACK
                && determinant.abs() >= MIN_DETERMINANT;
            if is_tie
                && self.labels(0).all(|l| labels.contains(&l) || self.value(l, at) <= tie + SLACK)
            {
                visit(labels.iter().fold(0, |bits, l| bits | 1 << l), at);
            }
        }
    }

    /// Calls `visit` where the label changes along the line of the square on which the coordinate
    /// that is not `along` is `at`: with the place, and the numbers of the labels before and past
    /// it.
    pub(crate) fn changes(&self, along: usize, at: f64, mut visit: impl FnMut(f64, [usize; 2])) {
        let other = 1 - along;
        let ends = |label: usize| -> [f64; 2] {
            let v = &self.values[label];
            [0, 1 << along].map(|c| v[c] + (v[c | 1 << other] - v[c]) * at)
        };
        // The upper envelope of linear functions: of those that overtake the leader the next to do
        // so, the steepest of these.
        let leader_at_start =
            self.labels(0).fold(0, |best, l| if ends(l)[0] > ends(best)[0] { l } else { best });
        let (mut leader, mut from) = (leader_at_start, 0.0);
        while let Some((s, _, next)) = self
            .labels(0)
            .filter_map(|l| {
                let ([a, b], [p, q]) = (ends(leader), ends(l));
                let gain = (q - p) - (b - a);
                let s = (a - p) / gain;
                (gain > 0.0 && s >= from && s < 1.0).then_some((s, -gain, l))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)))
        {
            if s > 0.0 {
                visit(s, [leader, next]);
            }
            (leader, from) = (next, s);
        }
    }

    fn value(&self, label: usize, [x, y]: [f64; 2]) -> f64 {
        let v = &self.values[label];
        (1.0 - y) * ((1.0 - x) * v[0] + x * v[1]) + y * ((1.0 - x) * v[2] + x * v[3])
    }
}

/// A bilinear function by its coefficients, and by its values at the corners.
struct Bilinear {
    one: f64,
    x: f64,
    y: f64,
    xy: f64,
    corners: [f64; 4],
}

impl Bilinear {
    /// Of two functions given by their values at the corners.
    fn difference(f: &[f64; 4], g: &[f64; 4]) -> Self {
        let d: [f64; 4] = std::array::from_fn(|c| f[c] - g[c]);
        Self {
            one: d[0],
            x: d[1] - d[0],
            y: d[2] - d[0],
            xy: d[0] - d[1] - d[2] + d[3],
            corners: d,
        }
    }

    /// Whether it has 0 somewhere within the square. Not where it is 0 at corners alone: of two
    /// labels that differ by 0 there neither leads, because one of others does.
    fn has_zero(&self) -> bool {
        let below = self.corners.iter().filter(|value| value.is_sign_negative()).count();
        below != 0 && below != 4
    }

    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.one + self.x * x + (self.y + self.xy * x) * y
    }
}

/// The roots of a x^2 + b x + c; a double root once or twice.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [Option<f64>; 2] {
    let discriminant = b * b - 4.0 * a * c;
    if discriminant < 0.0 || (a == 0.0 && b == 0.0) {
        return [None; 2];
    }
    // Without cancellation: the root of the larger size first, the other one by their product.
    let q = -0.5 * (b + discriminant.sqrt().copysign(b));
    [(a != 0.0).then(|| q / a), (q != 0.0).then(|| c / q)]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A square of labels by their ids at its corners.
    fn square(ids: [u16; 4], weights: &[f32]) -> Square {
        let row = |id: u16| {
            [0, 1, 2, 3]
                .map(|c| if ids[c] == id { f64::from(weights[usize::from(id)]) } else { 0.0 })
        };
        let is_first = |c: &usize| !ids[..*c].contains(&ids[*c]);
        Square::new((0..4).filter(is_first).map(|c| row(ids[c])))
    }

    #[test]
    fn ties_of_equal_weights_are_where_they_must_be() {
        let mut found = Vec::new();
        square([1, 1, 2, 3], &[1.0; 4]).ties_of_three(|_, at| found.push(at));
        assert_eq!(found.len(), 1);
        assert!((found[0][0] - 0.5).abs() < 1e-12 && (found[0][1] - 2.0 / 3.0).abs() < 1e-12);
        // Labels of opposite corners that join between the others.
        square([1, 2, 3, 1], &[1.0; 4]).ties_of_three(|_, at| panic!("no tie at {at:?}"));
        let octants = Cube::new(&std::array::from_fn(|c| c as u16), &[1.0; 8]);
        let center = octants.tie_of_four([0, 1, 2, 4], DVec3::new(0.4, 0.6, 0.3));
        assert!(center.is_some_and(|x| x.distance(DVec3::splat(0.5)) < 1e-9));
        // Four labels that meet in a line have no point of their own.
        let columns = Cube::new(&std::array::from_fn(|c| (c & 3) as u16), &[1.0; 4]);
        assert_eq!(columns.tie_of_four([0, 1, 2, 3], DVec3::splat(0.4)), None);
    }

    proptest! {
        #[test]
        fn faces_have_the_ties_that_their_corners_ask_for(
            weights in prop::array::uniform4(0.7_f32..1.5),
        ) {
            let ties = |ids: [u16; 4]| {
                let square = square(ids, &weights);
                let mut found = Vec::new();
                square.ties_of_three(|labels, at| {
                    let values: Vec<f64> = (0..MAX).map(|l| square.value(l, at)).collect();
                    let best = values.iter().copied().fold(0.0, f64::max);
                    let all_lead =
                        (0..MAX).all(|l| labels >> l & 1 == 0 || best - values[l] < 1e-9);
                    found.push((at, all_lead && labels.count_ones() == 3));
                });
                found
            };
            // Two corners beside each other of one label: the indicators of three are as the
            // inverses of their weights.
            let found = ties([0, 0, 1, 2]);
            let [a, b, c] = [0, 1, 2].map(|l: usize| 1.0 / f64::from(weights[l]));
            prop_assert_eq!(found.len(), 1);
            let (at, is_tie) = found[0];
            prop_assert!(
                is_tie
                    && (at[0] - c / (b + c)).abs() < 1e-9
                    && (at[1] - (b + c) / (a + b + c)).abs() < 1e-9
            );
            // Four labels: those of one diagonal touch, and have one of the others at each end.
            let [w, x, y, z] = weights.map(f64::from);
            prop_assume!((w * z / (x * y) - 1.0).abs() > 1e-2);
            let found = ties([0, 1, 2, 3]);
            prop_assert!(
                found.len() == 2 && found.iter().all(|&(_, is_tie)| is_tie),
                "{:?}",
                found
            );
        }

        #[test]
        fn ties_within_a_cell_are_ties(
            ids in prop::array::uniform8(0_u16..5),
            axis in 0..3_usize,
            at in 0.0..1.0_f64,
        ) {
            let cube = Cube::new(&ids, &[1.0, 1.3, 0.75, 1.2, 0.875]);
            cube.cut(axis, at).ties_of_three(|labels, [u, v]| {
                let mut x = DVec3::ZERO;
                (x[axis], x[(axis + 1) % 3], x[(axis + 2) % 3]) = (at, u, v);
                let values: Vec<f64> =
                    (0..cube.count()).map(|l| cube.value_and_gradient(l, x).0).collect();
                let best = values.iter().copied().fold(0.0, f64::max);
                assert!(
                    (0..cube.count()).all(|l| labels >> l & 1 == 0 || best - values[l] < 1e-6),
                    "no tie at {x}: {values:?}"
                );
            });
        }
    }
}
