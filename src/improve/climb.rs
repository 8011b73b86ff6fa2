//! The climb of a vertex: a place, and the way on which the least measure around it rises fastest.
//!
//! The least measure of the tets around a vertex is a function of where the vertex is, with kinks
//! where another tet becomes the worst. It rises fastest along the shortest vector in the convex
//! hull of the gradients of the worst tets (L. A. Freitag, M. Jones, P. Plassmann, "An efficient
//! parallel algorithm for mesh smoothing", 1995).

use glam::DVec3;

use super::batch::Batch;
use super::interfaces::facet_measure;
use super::measure::Measure;
use super::star::Star;
use super::worker::GAIN;

/// Tets whose measure is below the least by this factor, or a little more, shape the direction.
const ACTIVE: f64 = 1.5;
/// Most of them.
const MAX_ACTIVE: usize = 12;
/// The step by which gradients are taken, in parts of the length of an edge.
pub(super) const DIFFERENCE: f64 = 1e-6;
/// Steps towards the shortest vector of a convex hull.
const MAX_APPROACHES: usize = 24;

/// Interface facets at a vertex whose angles must not get smaller.
pub(super) struct Tight {
    count: usize,
    /// Where the other vertices are.
    others: [[DVec3; 2]; MAX_ACTIVE],
}

impl Tight {
    pub const NONE: Self = Self { count: 0, others: [[DVec3::ZERO; 2]; MAX_ACTIVE] };

    /// Adds a facet, by where its other vertices are. There is room for a dozen.
    pub fn push(&mut self, others: [DVec3; 2]) {
        if self.count < MAX_ACTIVE {
            self.others[self.count] = others;
            self.count += 1;
        }
    }
}

/// The climb of a vertex. Kept from one to the next for its memory.
#[derive(Default)]
pub(super) struct Climb {
    /// Where the vertex is by now.
    pub at: DVec3,
    /// The least measure of the tets that count with the vertex there.
    pub min: f64,
    /// The tets that count. The vertex is their first corner: where it was tried last.
    tets: Batch,
    /// Their measures with the vertex at `at`.
    measures: Vec<f64>,
    /// The worst of them with the vertex beside `at`.
    beside: Batch,
}

impl Climb {
    /// Begins with the vertex of a star at a place.
    pub fn begin(&mut self, star: &Star, measure: &Measure, at: DVec3) {
        self.tets.clear();
        let counting = star.labels.iter().zip(&star.points).filter(|(label, _)| **label != 0);
        counting.for_each(|(_, &[x, y, z])| self.tets.push([at, x, y, z].map(|p| p.to_array())));
        let min = self.tets.measure(measure);
        self.go(at, min);
    }

    /// The least measure with the vertex at `p`.
    pub fn measure_at(&mut self, measure: &Measure, p: DVec3) -> f64 {
        self.tets.set_first(p);
        self.tets.measure(measure)
    }

    /// Goes to `p`, where the vertex was tried last and the least measure is `min`.
    pub fn go(&mut self, p: DVec3, min: f64) {
        (self.at, self.min) = (p, min);
        self.measures.clear();
        self.tets.measures().for_each(|measures| self.measures.extend_from_slice(measures));
    }

    /// The direction in which the least measure rises fastest, and how fast; `None` where it rises
    /// in none in which the angles of the `tight` facets do not fall.
    pub fn ascent(
        &mut self,
        measure: &Measure,
        tight: &Tight,
        allowed: impl Fn(DVec3) -> DVec3,
    ) -> Option<(DVec3, f64)> {
        let (at, bound) = (self.at, ACTIVE * self.min + GAIN);
        let mut active = [(f64::INFINITY, 0); MAX_ACTIVE];
        let mut count = 0;
        for (tet, &value) in self.measures.iter().enumerate().filter(|(_, m)| **m <= bound) {
            // Keeps the worst, in order.
            let mut to = count.min(MAX_ACTIVE - 1);
            if count == MAX_ACTIVE && active[to].0 <= value {
                continue;
            }
            while to > 0 && active[to - 1].0 > value {
                active[to] = active[to - 1];
                to -= 1;
            }
            active[to] = (value, tet);
            count = (count + 1).min(MAX_ACTIVE);
        }
        let active = &active[..count];
        self.beside.clear();
        let step_of = |other: DVec3| DIFFERENCE * (other - at).length();
        for &(_, tet) in active {
            let [_, x, y, z] = self.tets.corners(tet);
            let step = step_of(x);
            for axis in DVec3::AXES {
                self.beside.push([at + axis * step, x, y, z].map(|p| p.to_array()));
            }
        }
        self.beside.measure(measure);
        let mut gradients = [DVec3::ZERO; 2 * MAX_ACTIVE];
        let mut beside = self.beside.measures().flatten();
        for (gradient, &(value, tet)) in gradients.iter_mut().zip(active) {
            let step = step_of(self.tets.corners(tet)[1]);
            let mut slope = || beside.next().map_or(0.0, |&beside| (beside - value) / step);
            *gradient = allowed(DVec3::new(slope(), slope(), slope()));
        }
        let steepest = gradients[..count].iter().map(|g| g.length()).fold(0.0, f64::max);
        // Only the directions of these matter.
        for others in &tight.others[..tight.count] {
            let (value, step) = (facet_measure(at, others), step_of(others[0]));
            let slopes =
                DVec3::AXES.map(|axis| (facet_measure(at + axis * step, others) - value) / step);
            gradients[count] = allowed(DVec3::from(slopes)).normalize_or_zero() * steepest;
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The star of the middle of an octahedron whose corners are moved a little.
    fn star(off: &[[f64; 3]; 6], label: i32) -> Star {
        let mut star = Star::default();
        star.clear(0);
        let corner = |axis: usize, sign: f64| {
            let moved = off[2 * axis + usize::from(sign > 0.0)];
            DVec3::AXES[axis] * sign + DVec3::from_array(moved)
        };
        for signs in 0..8 {
            let sign = |axis: usize| if signs >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let [x, y, z] = [0, 1, 2].map(|axis| corner(axis, sign(axis)));
            // Positive seen from the middle.
            let is_even = sign(0) * sign(1) * sign(2) > 0.0;
            star.points.push(if is_even { [x, y, z] } else { [x, z, y] });
            star.labels.push(label);
        }
        star
    }

    fn corners() -> impl Strategy<Value = [[f64; 3]; 6]> {
        prop::array::uniform6(prop::array::uniform3(-0.2..0.2_f64))
    }

    proptest! {
        /// A small step goes uphill, at the rate that was said or a little less.
        #[test]
        fn the_way_leads_up(off in corners(), at in prop::array::uniform3(-0.3..0.3_f64)) {
            let (measure, at) = (Measure::new(15.0, 2.0), DVec3::from_array(at));
            let star = star(&off, 1);
            let mut climb = Climb::default();
            climb.begin(&star, &measure, at);
            prop_assume!(climb.min > 1e-3);
            let Some((way, rate)) = climb.ascent(&measure, &Tight::NONE, |way| way) else {
                return Ok(());
            };
            prop_assert!((way.length() - 1.0).abs() < 1e-9 && rate > 0.0);
            let reached = climb.measure_at(&measure, at + way * 1e-5);
            prop_assert!(reached > climb.min, "{reached} is not above {}", climb.min);
        }

        /// What was tried in vain leaves no trace.
        #[test]
        fn a_trial_changes_nothing(off in corners(), p in prop::array::uniform3(-0.9..0.9_f64)) {
            let (measure, star) = (Measure::new(15.0, 2.0), star(&off, 1));
            let [mut climb, mut other] = [Climb::default(), Climb::default()];
            for climb in [&mut climb, &mut other] {
                climb.begin(&star, &measure, DVec3::new(0.1, -0.2, 0.05));
            }
            climb.measure_at(&measure, DVec3::from_array(p));
            let ways = [&mut climb, &mut other]
                .map(|climb| climb.ascent(&measure, &Tight::NONE, |way| way));
            prop_assert_eq!(ways[0], ways[1]);
            // But where it goes it is.
            let min = climb.measure_at(&measure, DVec3::ZERO);
            climb.go(DVec3::ZERO, min);
            other.begin(&star, &measure, DVec3::ZERO);
            prop_assert_eq!((climb.at, climb.min), (other.at, other.min));
            prop_assert_eq!(&climb.measures, &other.measures);
        }
    }

    #[test]
    fn where_no_tet_counts_there_is_no_way() {
        let measure = Measure::new(15.0, 2.0);
        let mut climb = Climb::default();
        climb.begin(&star(&[[0.0; 3]; 6], 0), &measure, DVec3::ZERO);
        assert_eq!(climb.min, f64::INFINITY);
        assert_eq!(climb.ascent(&measure, &Tight::NONE, |way| way), None);
    }
}
