//! Circumspheres with a guaranteed error bound: the fast in-sphere test.
//!
//! Refinement needs every circumcenter anyway. Kept beside the tet it turns the in-sphere test into
//! one distance: `|p - center|^2 < inside` is certainly inside, `> outside` certainly outside,
//! between the two the exact predicate decides.
//!
//! # Why the two bounds hold
//! Let c be the true circumcenter, c' = c + e the computed one, a a vertex. For any p
//!
//! ```text
//! |p - c'|^2 - |a - c'|^2 = (|p - c|^2 - |a - c|^2) + 2 e . (a - p),
//! ```
//!
//! so the sign of the left side is the exact in-sphere sign
//! wherever its magnitude exceeds 2 |e| |a - p|. When |p - c'| <= 2 r' then |a - p| <= 3 r' and 6
//! |e| r' bounds the error; when p is farther, the left side exceeds 3/4 |p - c'|^2 while the error
//! is at most 3 |e| |p - c'|, smaller for |e| < r'/4. Rounding of the two squared lengths is a few
//! units in the last place of f64; the bounds are kept as f32, rounded away from each other by
//! 2^-22, which covers it a millionfold.
//!
//! # The bound on |e|
//! It is the forward error of the formula below: sums of products of exactly rounded differences,
//! divided by the determinant. With D the determinant, L the longest of the three edges, r the true
//! radius and d = 32 units L^3, the error of D is at most d, that of the numerator 3/2 L d. With k
//! = d / D, and t for the rounding of the sum of the vertex and its offset to the centre, |e| <=
//! (3/2 L + r') k + t. The edges are chords, L <= 2 r <= 2 (r' + |e|), so
//! |e| (1 - 3 k) <= 4 r' k + t, and for k <= 1/16
//!
//! |e| <= 5 r' k + 5/4 t,  6 |e| r' <= 30 r'^2 k + 15/2 t r',
//!
//! where t is below 2 units of the largest coordinate of vertex plus that of the centre, the latter
//! below the former plus r'. No square root is taken for a bound: where L and r' stand alone, any
//! upper bound serves, at the price of a wider gap.

use glam::DVec3;

/// Unit roundoff of f64.
const UNIT: f64 = f64::EPSILON / 2.0;
/// Roundings met by each term of the numerator and of the determinant, generously counted.
const ROUNDINGS: f64 = 32.0;
/// Widening of the bounds when they are rounded to f32.
const WIDEN: f64 = 1.0 / 4_194_304.0;
/// Squared radii for which f32 keeps its full precision and no product of the formula overflows or
/// underflows.
const RANGE: std::ops::Range<f64> = 1e-30..1e30;

/// A circumsphere: centre and the two squared radii that bound the exact one for the in-sphere
/// test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circumsphere {
    /// The computed circumcenter.
    pub center: DVec3,
    /// Squared distances from `center` below this are inside; negative when nothing is certain.
    pub inside: f32,
    /// Squared distances from `center` above this are outside; infinite when nothing is certain.
    pub outside: f32,
}

/// The vertex that spheres are computed relative to; any vertex of the tet serves.
#[derive(Clone, Copy)]
pub(super) struct Origin {
    /// Where it is.
    pub at: DVec3,
    /// Twice its largest coordinate.
    reach: f64,
    /// A length, for upper bounds of other lengths.
    scale: f64,
    per_scale: f64,
}

impl Origin {
    /// `other`: a point about as far away as the other vertices are.
    #[inline(always)]
    pub fn new(at: DVec3, other: DVec3) -> Self {
        let scale = (other - at).length();
        Self { at, reach: 2.0 * at.abs().max_element(), scale, per_scale: 1.0 / scale }
    }

    /// An upper bound of the length whose square is `squared`, a good one when `scale` is about as
    /// long: the arithmetic mean of squared / scale and scale is above the geometric one. The
    /// sixteenth covers its roundings.
    #[inline(always)]
    fn length_bound(&self, squared: f64) -> f64 {
        0.5625 * (squared * self.per_scale + self.scale)
    }
}

/// Centre, inside and outside bound of the positive tet (origin, origin + u, origin + v, origin +
/// w). Selects instead of branches, so that loops over tets vectorise.
#[inline(always)]
pub(super) fn relative_to(origin: &Origin, u: DVec3, v: DVec3, w: DVec3) -> [f64; 5] {
    let larger = |x: f64, y: f64| if x > y { x } else { y };
    let (uu, vv, ww) = (u.length_squared(), v.length_squared(), w.length_squared());
    let (vw, wu, uv) = (v.cross(w), w.cross(u), u.cross(v));
    let det = u.dot(vw);
    let longest_squared = larger(larger(uu, vv), ww);
    let det_error = ROUNDINGS * UNIT * longest_squared * origin.length_bound(longest_squared);
    let per_det = 1.0 / det;
    let center = origin.at + (uu * vw + vv * wu + ww * uv) * (0.5 * per_det);
    let squared_radius = (origin.at - center).length_squared();
    let slack = 30.0 * squared_radius * (det_error * per_det)
        + 32.0 * UNIT * (origin.reach * origin.length_bound(squared_radius) + squared_radius);
    // Each comparison is false for a NaN.
    let certain = (det > 16.0 * det_error)
        & (slack < 0.06 * squared_radius)
        & (squared_radius > RANGE.start)
        & (squared_radius < RANGE.end);
    let centroid = origin.at + (u + v + w) * 0.25;
    let pick = |x: f64, y: f64| if certain { x } else { y };
    [
        pick(center.x, centroid.x),
        pick(center.y, centroid.y),
        pick(center.z, centroid.z),
        pick((squared_radius - slack) * (1.0 - WIDEN), -1.0),
        pick((squared_radius + slack) * (1.0 + WIDEN), f64::INFINITY),
    ]
}

impl Circumsphere {
    /// The circumsphere of a positive tet. When the tet is too flat for f64 the result is centred
    /// at its centroid and certain of nothing.
    #[inline]
    pub fn of_tet(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Self {
        Self::from_row(relative_to(&Origin::new(a, b), b - a, c - a, d - a))
    }

    /// f32 keeps the bounds apart, see `WIDEN`.
    #[inline(always)]
    pub(super) fn from_row([x, y, z, inside, outside]: [f64; 5]) -> Self {
        Self { center: DVec3::new(x, y, z), inside: inside as f32, outside: outside as f32 }
    }

    /// Whether the centre is usable (the tet was not too flat for f64).
    pub fn is_certain(&self) -> bool {
        self.outside.is_finite()
    }

    /// The squared circumradius: the outside bound, above the exact one by its error (below 1e-6 of
    /// it unless the tet is nearly flat; as a tet's record keeps it, up to 4e-6 more); infinite
    /// when the tet is too flat.
    pub fn squared_radius(&self) -> f64 {
        f64::from(self.outside)
    }

    /// `Some(true)` certainly inside, `Some(false)` certainly outside, `None` ask the exact
    /// predicate.
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
        // Points chosen close to the sphere, on tets down to nearly flat, far from the origin as
        // image coordinates are.
        #[test]
        fn a_certain_answer_is_the_exact_one(
            p in prop::array::uniform4(point(1.0)),
            flatten in 0..14_i32,
            dir in prop::array::uniform3(-1.0..1.0_f64),
            off in -1e-6..1e-6_f64,
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
