//! Exact predicates, and the symbolic perturbation that makes a Delaunay triangulation unique.
//!
//! Exact signs come from Shewchuk's adaptive predicates (Adaptive Precision Floating-Point
//! Arithmetic, 1997) in the `robust` crate.
//!
//! Label images are massively cospherical. Ties of the in-sphere test are broken as if every
//! point's lifted height (the |p|^2 of the paraboloid lifting) were raised by an infinitesimal of
//! its own, larger for points that come later in the lexicographic order of coordinates (Devillers
//! and Teillaud, Perturbations and vertex removal in a 3D Delaunay triangulation, 2003). The result
//! is the regular triangulation of a generic lifting: it has no flat tets, removal undoes
//! insertion, and it depends on the point set alone, not on ids or on the order of insertion.
//! Points must be distinct.

use std::cmp::Ordering;

use glam::DVec3;
use robust::Coord3D;

fn coord(p: DVec3) -> Coord3D<f64> {
    Coord3D { x: p.x, y: p.y, z: p.z }
}

/// Exact sign of (b - a) x (c - a) . (d - a): positive for a positive tet, 0 for coplanar points.
/// The magnitude approximates the determinant.
#[inline]
pub fn orient(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    -robust::orient3d(coord(a), coord(b), coord(c), coord(d))
}

/// Exact in-sphere sign: positive when `e` lies inside the circumsphere of the positive tet (a, b,
/// c, d), 0 when on it.
#[inline]
pub fn in_sphere(a: DVec3, b: DVec3, c: DVec3, d: DVec3, e: DVec3) -> f64 {
    -robust::insphere(coord(a), coord(b), coord(c), coord(d), coord(e))
}

/// The perturbation order: lexicographic by coordinates.
pub fn perturbation_order(a: DVec3, b: DVec3) -> Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

/// Whether `e` is in conflict with the positive tet `v`: inside its circumsphere, ties broken by
/// the perturbation. Never undecided for five distinct points.
pub fn in_sphere_perturbed(v: [DVec3; 4], e: DVec3) -> bool {
    let sign = in_sphere(v[0], v[1], v[2], v[3], e);
    if sign != 0.0 { sign > 0.0 } else { cospherical_conflict(v, e) }
}

/// The tie-break. Raising the lifted height of e lifts e above the hyperplane through the lifted
/// tet: no conflict. Raising that of vertex i raises the hyperplane at e by the barycentric
/// coordinate of e for vertex i, whose sign is that of the tet with e in the place of vertex i. The
/// largest perturbation whose coefficient is not 0 decides; that of e itself never is 0.
fn cospherical_conflict(v: [DVec3; 4], e: DVec3) -> bool {
    let mut order = [0_usize, 1, 2, 3, 4];
    let point = |i: usize| if i == 4 { e } else { v[i] };
    order.sort_unstable_by(|&i, &j| perturbation_order(point(j), point(i)));
    for i in order {
        if i == 4 {
            return false;
        }
        let mut replaced = v;
        replaced[i] = e;
        let barycentric = orient(replaced[0], replaced[1], replaced[2], replaced[3]);
        if barycentric != 0.0 {
            return barycentric > 0.0;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const O: DVec3 = DVec3::ZERO;
    const X: DVec3 = DVec3::X;
    const Y: DVec3 = DVec3::Y;
    const Z: DVec3 = DVec3::Z;

    #[test]
    fn the_unit_tet_is_positive_and_holds_its_centre() {
        assert!(orient(O, X, Y, Z) > 0.0);
        assert!(orient(X, O, Y, Z) < 0.0);
        assert!(in_sphere(O, X, Y, Z, DVec3::splat(0.5)) > 0.0);
        assert!(in_sphere(O, X, Y, Z, DVec3::splat(2.0)) < 0.0);
        assert_eq!(in_sphere(O, X, Y, Z, DVec3::ONE), 0.0);
    }

    fn lattice_point() -> impl Strategy<Value = DVec3> {
        (0..3_i32, 0..3_i32, 0..3_i32)
            .prop_map(|(x, y, z)| DVec3::new(f64::from(x), f64::from(y), f64::from(z)))
    }

    proptest! {
        // Most lattice points are coplanar, so most draws are rejected.
        #![proptest_config(ProptestConfig {
            max_global_rejects: 100_000,
            ..ProptestConfig::default()
        })]

        // Points on a 3x3x3 lattice are coplanar and cospherical all the time.
        #[test]
        fn swapping_two_points_negates_orientation(p in prop::array::uniform4(lattice_point())) {
            prop_assert_eq!(orient(p[0], p[1], p[2], p[3]), -orient(p[1], p[0], p[2], p[3]));
        }

        // Of the two ways to split five points in convex position around a facet exactly one is
        // Delaunay: d in conflict with (a,b,c,e) iff e with (a,b,c,d).
        #[test]
        fn conflict_is_mutual_across_a_facet(p in prop::array::uniform5(lattice_point())) {
            let [a, b, c, d, e] = p;
            prop_assume!(orient(a, b, c, d) > 0.0 && orient(b, a, c, e) > 0.0);
            prop_assert_eq!(
                in_sphere_perturbed([a, b, c, d], e),
                in_sphere_perturbed([b, a, c, e], d)
            );
        }

        #[test]
        fn conflict_does_not_depend_on_the_order_of_vertices(
            p in prop::array::uniform5(lattice_point()),
        ) {
            let [a, b, c, d, e] = p;
            prop_assume!(orient(a, b, c, d) > 0.0 && ![a, b, c, d].contains(&e));
            let expected = in_sphere_perturbed([a, b, c, d], e);
            prop_assert_eq!(in_sphere_perturbed([b, c, a, d], e), expected);
            prop_assert_eq!(in_sphere_perturbed([d, c, b, a], e), expected);
        }
    }
}
