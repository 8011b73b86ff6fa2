//! Shape measures that the refinement rules ask for.

use glam::DVec3;

/// Squared length of the shortest edge of a tet.
#[inline]
pub fn shortest_squared_edge(v: [DVec3; 4]) -> f64 {
    let edge = |i: usize, j: usize| v[i].distance_squared(v[j]);
    edge(0, 1).min(edge(0, 2)).min(edge(0, 3)).min(edge(1, 2)).min(edge(1, 3)).min(edge(2, 3))
}

/// Whether the smallest planar angle of a triangle, at most 60 degrees, has a squared cosine above `cosine_squared`. True when two corners coincide.
#[inline]
pub fn has_angle_below(a: DVec3, b: DVec3, c: DVec3, cosine_squared: f64) -> bool {
    let (bc, ca, ab) = ((c - b).length_squared(), (a - c).length_squared(), (b - a).length_squared());
    let shortest = bc.min(ca).min(ab);
    // Law of cosines at the corner opposite to the shortest edge, between the two longer ones, whose squared lengths multiply to bc * ca * ab / shortest.
    let twice = bc + ca + ab - 2.0 * shortest;
    twice * twice * shortest > 4.0 * cosine_squared * bc * ca * ab || shortest == 0.0
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

#[cfg(test)]
mod tests {
    use super::*;

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
        let below = |angle: f64| has_angle_below(DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.1, 0.0), angle.cos().powi(2));
        assert!(below(0.1_f64.atan() + 1e-9) && !below(0.1_f64.atan() - 1e-9));
        assert!(has_angle_below(DVec3::ZERO, DVec3::ZERO, DVec3::X, 1.0));
    }
}
