//! Triangles and edges: the measures that the refinement rules ask for, and the point of a triangle
//! closest to another.

use glam::DVec3;

/// Squared length of the shortest edge of a tet.
#[inline]
pub fn shortest_squared_edge(v: [DVec3; 4]) -> f64 {
    let edge = |i: usize, j: usize| v[i].distance_squared(v[j]);
    let (a, b) = (smaller(edge(0, 1), edge(0, 2)), smaller(edge(0, 3), edge(1, 2)));
    smaller(smaller(a, b), smaller(edge(1, 3), edge(2, 3)))
}

/// The smaller of two numbers, neither NaN: one instruction, where `f64::min` takes five.
#[inline(always)]
pub(crate) fn smaller(x: f64, y: f64) -> f64 {
    if x < y { x } else { y }
}

/// The larger of two numbers, neither NaN.
#[inline(always)]
fn larger(x: f64, y: f64) -> f64 {
    if x > y { x } else { y }
}

/// Whether the smallest planar angle of a triangle, at most 60 degrees, has a squared cosine above
/// `cosine_squared`. True when two corners coincide. The same for any order of the corners: those
/// of a facet come in another one from each side, and its angle may be the bound itself.
#[inline]
pub fn has_angle_below(a: DVec3, b: DVec3, c: DVec3, cosine_squared: f64) -> bool {
    let (bc, ca, ab) =
        ((c - b).length_squared(), (a - c).length_squared(), (b - a).length_squared());
    let (low, high) = (smaller(bc, ca), larger(bc, ca));
    let (shortest, longest) = (smaller(low, ab), larger(high, ab));
    let middle = larger(low, smaller(high, ab));
    // Law of cosines at the corner opposite to the shortest edge, between the two longer ones.
    let twice = middle + longest - shortest;
    twice * twice > 4.0 * cosine_squared * middle * longest || shortest == 0.0
}

/// Circumcenter and squared circumradius of a triangle; `None` when it is degenerate.
#[inline]
pub fn triangle_circumcircle(a: DVec3, b: DVec3, c: DVec3) -> Option<(DVec3, f64)> {
    let (u, v) = (b - a, c - a);
    let n = u.cross(v);
    let area = n.length_squared();
    if area <= f64::EPSILON * u.length_squared() * v.length_squared() {
        return None;
    }
    let x = (u.length_squared() * v.cross(n) + v.length_squared() * n.cross(u)) * (0.5 / area);
    Some((a + x, x.length_squared()))
}

/// The point of triangle (a, b, c) closest to `p`, by the Voronoi region of the feature that holds
/// it (C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
pub fn closest_point(&[a, b, c]: &[DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let area = va + vb + vc;
    // Also false for a degenerate triangle, which has no interior and whose regions above overlap.
    if va > 0.0 && vb > 0.0 && vc > 0.0 && area > 0.0 {
        return a + (ab * vb + ac * vc) / area;
    }
    let candidates =
        [closest_on_segment(a, b, p), closest_on_segment(b, c, p), closest_on_segment(c, a, p)];
    candidates
        .into_iter()
        .min_by(|q, r| p.distance_squared(*q).total_cmp(&p.distance_squared(*r)))
        .unwrap_or(a)
}

fn closest_on_segment(a: DVec3, b: DVec3, p: DVec3) -> DVec3 {
    let ab = b - a;
    let length_squared = ab.length_squared();
    if length_squared == 0.0 {
        return a;
    }
    a + ab * ((p - a).dot(ab) / length_squared).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-4..=4i32, -4..=4, -4..=4]
            .prop_map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into()) * 0.5)
    }

    proptest! {
        /// Two sides of equal length at 120 degrees: both other angles are the bound, but for
        /// rounding.
        #[test]
        fn the_order_of_corners_does_not_matter(
            at in prop::array::uniform3(-8.0..8.0),
            along in prop::array::uniform3(-1.0..1.0),
            beside in prop::array::uniform3(-1.0..1.0),
        ) {
            let (a, u) = (DVec3::from(at), DVec3::from(along));
            let v = u.cross(DVec3::from(beside)).normalize_or_zero() * u.length();
            let corners = [a, a + u, a - 0.5 * u + 0.75_f64.sqrt() * v];
            let bound = 30.0_f64.to_radians().cos().powi(2);
            let is_below = |[i, j, k]: [usize; 3]| {
                has_angle_below(corners[i], corners[j], corners[k], bound)
            };
            for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                prop_assert_eq!(is_below(order), is_below([0, 1, 2]));
            }
        }

        /// The closest point is on the triangle and no point of a fine sampling is closer. Small
        /// integer coordinates meet every degenerate case: coinciding vertices, vertices on a line,
        /// query points on the triangle.
        #[test]
        fn closest_point_against_samples(t in [point(), point(), point()], p in point()) {
            let q = closest_point(&t, p);
            prop_assert!(q.is_finite());
            let n = 60;
            let mut sampled = f64::INFINITY;
            for i in 0..=n {
                for j in 0..=n - i {
                    let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    sampled = sampled.min(p.distance(t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v));
                }
            }
            prop_assert!(p.distance(q) <= sampled + 1e-12);
            prop_assert!(p.distance(q) >= sampled - 0.25);
        }
    }

    #[test]
    fn an_equilateral_triangle_has_60_degrees() {
        let c = DVec3::new(0.5, 0.75_f64.sqrt(), 0.0);
        assert!(
            has_angle_below(DVec3::ZERO, DVec3::X, c, 0.25 - 1e-12)
                && !has_angle_below(DVec3::ZERO, DVec3::X, c, 0.25 + 1e-12)
        );
        let (o, r2) = triangle_circumcircle(DVec3::ZERO, DVec3::X, c).expect("not degenerate");
        assert!((r2 - 1.0 / 3.0).abs() < 1e-12 && (o.distance_squared(c) - r2).abs() < 1e-12);
    }

    #[test]
    fn a_needle_has_a_small_angle() {
        let below = |angle: f64| {
            has_angle_below(DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.1, 0.0), angle.cos().powi(2))
        };
        assert!(below(0.1_f64.atan() + 1e-9) && !below(0.1_f64.atan() - 1e-9));
        assert!(has_angle_below(DVec3::ZERO, DVec3::ZERO, DVec3::X, 1.0));
    }
}
