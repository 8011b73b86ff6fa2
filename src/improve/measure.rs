//! How good a tet is: the square of the sine of its worst dihedral angle, or less where it is long
//! and thin.
//!
//! The sine falls to 0 as an angle goes to 0 and as it goes to 180 degrees, so one number tells of
//! both. All six are at least sin^2(15 degrees) when all angles lie between 15 and 165. At an edge
//! of length l between facets of areas A and B, in a tet of volume V, the sine is 3 V l / (2 A B)
//! (J. R. Shewchuk, "What is a good linear finite element?", 2002). Its square takes no root, which
//! is why it is what tets are compared by.
//!
//! A needle can have good dihedral angles. So the ratio of circumradius to shortest edge counts,
//! too, which refinement keeps below 2: a tet whose ratio is [`WORST_RATIO`] times as large
//! measures as much as one that is just at the target. So no operation makes a tet with a larger
//! ratio while it has another way.

use glam::DVec3;

use crate::geometry::predicates::orient;

/// The measure of a tet whose worst angle is so many degrees, or 180 less so many.
pub fn measure_of(degrees: f64) -> f64 {
    degrees.to_radians().sin().powi(2)
}

/// The angle in degrees, 0 to 90, of a measure.
pub fn degrees_of(measure: f64) -> f64 {
    measure.clamp(0.0, 1.0).sqrt().asin().to_degrees()
}

/// The lesser of two numbers; `a` where one is not a number. One instruction, unlike `f64::min`.
#[inline(always)]
pub fn lesser(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// A tet is below the target if its ratio of circumradius to shortest edge is more than this many
/// times what refinement was asked for.
pub const WORST_RATIO: f64 = 1.25;
/// The same where nothing else helps.
pub const LAST_RATIO: f64 = 2.0;

/// The measure for a target.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// What is to be reached.
    pub target: f64,
    /// The target times four squared worst ratios, which stands in the formula of the circumradius.
    ratio: f64,
}

impl Measure {
    /// For dihedral angles of so many degrees and more, after a refinement with that bound of the
    /// ratio.
    pub fn new(degrees: f64, radius_edge: f64) -> Self {
        // A little more than is asked for, so that rounding in another program's angles does not
        // matter.
        let target = measure_of(degrees) * (1.0 + 1e-6);
        Self { target, ratio: 4.0 * target * (WORST_RATIO * radius_edge).powi(2) }
    }

    /// Whether a tet measures more than `bound`: the same comparison, but for rounding, without the
    /// divisions.
    #[inline]
    pub fn exceeds(&self, &[a, b, c, d]: &[DVec3; 4], bound: f64) -> bool {
        let (u, v, w) = (b - a, c - a, d - a);
        let (x, y, z) = (c - b, d - b, d - c);
        let (of_b, of_c, of_d) = (v.cross(w), w.cross(u), u.cross(v));
        let six_volumes = u.dot(of_b);
        let squared = six_volumes * six_volumes;
        let (uu, vv, ww) = (u.length_squared(), v.length_squared(), w.length_squared());
        let (xx, yy, zz) = (x.length_squared(), y.length_squared(), z.length_squared());
        let (area_a, area_b) = (x.cross(y).length_squared(), of_b.length_squared());
        let (area_c, area_d) = (of_c.length_squared(), of_d.length_squared());
        let to_center = (uu * of_b + vv * of_c + ww * of_d).length_squared();
        let shortest = uu.min(vv).min(ww).min(xx).min(yy).min(zz);
        // All at once: which of them fails is as good as random.
        (six_volumes > 0.0)
            & (uu * squared > bound * area_c * area_d)
            & (vv * squared > bound * area_d * area_b)
            & (ww * squared > bound * area_b * area_c)
            & (xx * squared > bound * area_d * area_a)
            & (yy * squared > bound * area_a * area_c)
            & (zz * squared > bound * area_a * area_b)
            & (self.ratio * shortest * squared > bound * to_center)
    }

    /// The measure that allows the last ratio, for what nothing else helps.
    pub fn last(self) -> Self {
        Self { ratio: self.ratio * (LAST_RATIO / WORST_RATIO).powi(2), ..self }
    }

    /// The measure of a tet; 0 where the computed volume is not above 0. At most 8/9, that of a
    /// regular tet.
    #[inline(always)]
    pub fn of(&self, corners: &[DVec3; 4]) -> f64 {
        let (six_volumes, parts) = self.volume_and_parts(corners);
        let least = parts.into_iter().fold(f64::INFINITY, lesser);
        // Selected, not branched on, so that loops over tets vectorise.
        if six_volumes > 0.0 { least } else { 0.0 }
    }

    /// What the measure is the least of, each a smooth function of the corners but for the last:
    /// the squared sines of the six angles, and what the ratio measures. All are 0 where the
    /// computed volume is not above 0.
    #[inline]
    pub fn parts(&self, corners: &[DVec3; 4]) -> [f64; 7] {
        let (six_volumes, parts) = self.volume_and_parts(corners);
        // Also where it is not a number.
        if six_volumes > 0.0 { parts } else { [0.0; 7] }
    }

    /// Six volumes of a tet, and the parts of its measure where these are positive.
    #[inline(always)]
    fn volume_and_parts(&self, &[a, b, c, d]: &[DVec3; 4]) -> (f64, [f64; 7]) {
        let (u, v, w) = (b - a, c - a, d - a);
        let (x, y, z) = (c - b, d - b, d - c);
        let (of_b, of_c, of_d) = (v.cross(w), w.cross(u), u.cross(v));
        let six_volumes = u.dot(of_b);
        let (uu, vv, ww) = (u.length_squared(), v.length_squared(), w.length_squared());
        let (xx, yy, zz) = (x.length_squared(), y.length_squared(), z.length_squared());
        // Of the facet opposite to each vertex: one over four times its squared area.
        let over_a = x.cross(y).length_squared().recip();
        let over_b = of_b.length_squared().recip();
        let over_c = of_c.length_squared().recip();
        let over_d = of_d.length_squared().recip();
        // The circumradius is the length of this over twice six volumes.
        let to_center = uu * of_b + vv * of_c + ww * of_d;
        let shortest = [vv, ww, xx, yy, zz].into_iter().fold(uu, lesser);
        let parts = [
            uu * over_c * over_d,
            vv * over_d * over_b,
            ww * over_b * over_c,
            xx * over_d * over_a,
            yy * over_a * over_c,
            zz * over_a * over_b,
            self.ratio * shortest / to_center.length_squared(),
        ];
        (six_volumes, parts.map(|part| part * six_volumes * six_volumes))
    }
}

/// Whether the circumradius of a positive tet is at most `radius`.
#[inline]
pub fn has_circumradius_within(&[a, b, c, d]: &[DVec3; 4], radius: f64) -> bool {
    let (u, v, w) = (b - a, c - a, d - a);
    let of_b = v.cross(w);
    let six_volumes = u.dot(of_b);
    let to_center = u.length_squared() * of_b
        + v.length_squared() * w.cross(u)
        + w.length_squared() * u.cross(v);
    to_center.length_squared() <= (2.0 * six_volumes * radius).powi(2)
}

/// Whether a tet is positive, by its exact sign.
#[inline]
pub fn is_positive(&[a, b, c, d]: &[DVec3; 4]) -> bool {
    let (u, v, w) = (b - a, c - a, d - a);
    let det = u.dot(v.cross(w));
    // The error of the determinant is below 30 roundings of |u| |v| |w|, 4e-15 of it. What is far
    // above that has its sign.
    let scale = u.length_squared() * v.length_squared() * w.length_squared();
    if det * det > 1e-24 * scale { det > 0.0 } else { orient(a, b, c, d) > 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::measures::{dihedral_angles, radius_edge_ratio};

    proptest! {
        /// Against the six angles themselves.
        #[test]
        fn the_measure_is_that_of_the_worst_angle_or_the_ratio(
            p in prop::array::uniform4(prop::array::uniform3(-1.0..1.0_f64)),
        ) {
            let [a, b, c, d] = p.map(DVec3::from_array);
            let [a, b] = if orient(a, b, c, d) > 0.0 { [a, b] } else { [b, a] };
            let p = [a, b, c, d];
            prop_assume!(orient(a, b, c, d) > 1e-6);
            prop_assert!(is_positive(&p) && !is_positive(&[b, a, c, d]));
            let worst = dihedral_angles(&p)
                .into_iter()
                .map(|angle| angle.min(180.0 - angle))
                .fold(90.0, f64::min);
            let measure = Measure::new(15.0, 2.0);
            let expected = measure_of(worst)
                .min(measure.target * (2.0 * WORST_RATIO / radius_edge_ratio(&p)).powi(2));
            prop_assert!(
                (measure.of(&p) - expected).abs() < 1e-9,
                "{} is not {expected}",
                measure.of(&p)
            );
            prop_assert_eq!(measure.of(&[b, a, c, d]), 0.0);
            let value = measure.of(&p);
            prop_assert!(
                measure.exceeds(&p, value * (1.0 - 1e-9))
                    && !measure.exceeds(&p, value * (1.0 + 1e-9))
            );
            prop_assert!(!measure.exceeds(&[b, a, c, d], 0.0));
            prop_assert!((degrees_of(measure_of(worst)) - worst).abs() < 1e-9);
        }
    }

    #[test]
    fn flat_tets_are_not_positive() {
        let p = [[12.0; 3], [24.0; 3], [0.5, 12.5, 0.5], [0.25, 6.25, 0.25]].map(DVec3::from_array);
        assert!(!is_positive(&p) && !is_positive(&[p[1], p[0], p[2], p[3]]));
        let off = DVec3::Z * (f64::EPSILON / 4.0);
        let sides = [off, -off].map(|off| is_positive(&[p[0], p[1], p[2], p[3] + off]));
        assert_eq!(sides.into_iter().filter(|&positive| positive).count(), 1);
    }
}
