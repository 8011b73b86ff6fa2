//! Circumspheres with a guaranteed error bound: the fast in-sphere test.
//!
//! Refinement needs every circumcenter anyway. Kept beside the tet it turns the in-sphere test into one distance:
//! `|p - center|^2 < inside` is certainly inside, `> outside` certainly outside, between the two the exact predicate decides.
//!
//! # Why the two bounds hold
//! Let c be the true circumcenter, c' = c + e the computed one, a a vertex. For any p
//! |p - c'|^2 - |a - c'|^2 = (|p - c|^2 - |a - c|^2) + 2 e . (a - p), so the sign of the left side is the exact in-sphere sign
//! wherever its magnitude exceeds 2 |e| |a - p|. When |p - c'| <= 2 r' then |a - p| <= 3 r' and 6 |e| r' bounds the error; when p
//! is farther, the left side exceeds 3/4 |p - c'|^2 while the error is at most 3 |e| |p - c'|, smaller for |e| < r'/4.
//! Rounding of the two squared lengths is a few units in the last place of f64; the bounds are kept as f32, rounded
//! away from each other by 2^-22, which covers it a millionfold. The bound on |e| is the forward error of the formula
//! below: sums of products of exactly rounded differences, divided by the determinant.

use glam::DVec3;

/// Unit roundoff of f64.
const UNIT: f64 = f64::EPSILON / 2.0;
/// Roundings met by each term of the numerator and of the determinant, generously counted.
const ROUNDINGS: f64 = 32.0;
/// Widening of the bounds when they are rounded to f32.
const WIDEN: f64 = 1.0 / 4_194_304.0;

/// A circumsphere: centre and the two squared radii that bound the exact one for the in-sphere test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circumsphere {
    /// The computed circumcenter.
    pub center: DVec3,
    /// Squared distances from `center` below this are inside; negative when nothing is certain.
    pub inside: f32,
    /// Squared distances from `center` above this are outside; infinite when nothing is certain.
    pub outside: f32,
}

impl Circumsphere {
    /// The circumsphere of a positive tet. When the tet is too flat for f64 the result is centred at its centroid and certain of nothing.
    #[inline]
    pub fn of_tet(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Self {
        let (u, v, w) = (b - a, c - a, d - a);
        let (uu, vv, ww) = (u.length_squared(), v.length_squared(), w.length_squared());
        let (vw, wu, uv) = (v.cross(w), w.cross(u), u.cross(v));
        let det = u.dot(vw);
        let longest_squared = uu.max(vv).max(ww);
        let longest = longest_squared.sqrt();
        // The determinant is a sum of products of three lengths, the numerator below one of four.
        let det_error = ROUNDINGS * UNIT * longest_squared * longest;
        if det <= 4.0 * det_error {
            return Self::uncertain((a + b + c + d) * 0.25);
        }
        let per_det = 1.0 / det;
        let x = (uu * vw + vv * wu + ww * uv) * (0.5 * per_det);
        let center = a + x;
        let squared_radius = (a - center).length_squared();
        let radius = squared_radius.sqrt();
        let error = (1.5 * longest + radius) * det_error * per_det
            + 2.0 * UNIT * (center.abs().max_element() + a.abs().max_element());
        if !(error < 0.01 * radius && squared_radius.is_finite()) {
            return Self::uncertain((a + b + c + d) * 0.25);
        }
        let slack = 6.0 * error * radius;
        Self {
            center,
            inside: ((squared_radius - slack) * (1.0 - WIDEN)) as f32,
            outside: ((squared_radius + slack) * (1.0 + WIDEN)) as f32,
        }
    }

    fn uncertain(center: DVec3) -> Self {
        Self { center, inside: -1.0, outside: f32::INFINITY }
    }

    /// Whether the centre is usable (the tet was not too flat for f64).
    pub fn is_certain(&self) -> bool {
        self.outside.is_finite()
    }

    /// The squared circumradius: the outside bound, above the exact one by its error (below 1e-6 of it unless the tet is nearly flat);
    /// infinite when the tet is too flat.
    pub fn squared_radius(&self) -> f64 {
        f64::from(self.outside)
    }

    /// `Some(true)` certainly inside, `Some(false)` certainly outside, `None` ask the exact predicate.
    #[inline]
    pub fn contains(&self, p: DVec3) -> Option<bool> {
        let squared = (p - self.center).length_squared();
        if squared > f64::from(self.outside) {
            Some(false)
        } else if squared < f64::from(self.inside) {
            Some(true)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::predicates::{in_sphere, orient};
    use proptest::prelude::*;

    fn point(scale: f64) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0_f64)
            .prop_map(move |p| DVec3::from(p) * scale + DVec3::new(250.0, -119.53, 84.0))
    }

    proptest! {
        // Points chosen close to the sphere, on tets down to nearly flat, far from the origin as image coordinates are.
        #[test]
        fn a_certain_answer_is_the_exact_one(
            p in prop::array::uniform4(point(1.0)), flatten in 0..14_i32, dir in prop::array::uniform3(-1.0..1.0_f64), off in -1e-6..1e-6_f64,
        ) {
            let [a, b, c, mut d] = p;
            let n = (b - a).cross(c - a).normalize();
            d -= n * n.dot(d - a) * (1.0 - 10.0_f64.powi(-flatten));
            let [a, b] = if orient(a, b, c, d) > 0.0 { [a, b] } else { [b, a] };
            prop_assume!(orient(a, b, c, d) > 0.0);
            let sphere = Circumsphere::of_tet(a, b, c, d);
            prop_assume!(sphere.is_certain());
            let radius = sphere.squared_radius().sqrt();
            let q = sphere.center + DVec3::from(dir).normalize() * radius * (1.0 + off);
            if let Some(inside) = sphere.contains(q) {
                prop_assert_eq!(inside, in_sphere(a, b, c, d, q) > 0.0);
            }
            prop_assert_ne!(sphere.contains(a), Some(true));
            prop_assert_ne!(sphere.contains(d), Some(false));
        }
    }

    #[test]
    fn the_unit_tet() {
        let s = Circumsphere::of_tet(DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        assert!((s.center - DVec3::splat(0.5)).length() < 1e-15);
        assert!((s.squared_radius() - 0.75).abs() < 1e-6);
    }
}
