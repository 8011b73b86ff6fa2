//! Measures of single tets and triangles: angles, ratios, volumes.
//!
//! Angles come from a sine and a cosine that share their scale, by `atan2`: unlike `acos` it loses
//! no digits near 0 and 180 degrees, where slivers are.

use glam::DVec3;

/// The vertices of the edges of a tet, and the two others, in the order of [`dihedral_angles`].
const EDGES: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]];

/// The edges at each vertex, as places in [`EDGES`], and the vertices at their other ends.
const STARS: [[(usize, usize); 3]; 4] = [
    [(0, 1), (1, 2), (2, 3)],
    [(0, 0), (3, 2), (4, 3)],
    [(1, 0), (3, 1), (5, 3)],
    [(2, 0), (4, 1), (5, 2)],
];

/// What all measures of a tet are made of. Selects instead of branches, so that loops over tets
/// vectorise.
pub(crate) struct TetShape {
    /// Squared lengths of the edges.
    pub(crate) squares: [f64; 6],
    /// Of the facet opposite to each vertex: normals that all point out, or all in; twice the area
    /// long.
    pub(crate) normals: [DVec3; 4],
    /// Six times the signed volume.
    pub(crate) six_volumes: f64,
}

impl TetShape {
    #[inline(always)]
    pub(crate) fn new(&[a, b, c, d]: &[DVec3; 4]) -> Self {
        let (ab, ac, ad, bc, bd, cd) = (b - a, c - a, d - a, c - b, d - b, d - c);
        let square = DVec3::length_squared;
        Self {
            // Written out, here and below: such a loop would be vectorised in place of that over
            // tets.
            squares: [square(ab), square(ac), square(ad), square(bc), square(bd), square(cd)],
            normals: [bc.cross(bd), ad.cross(ac), ab.cross(ad), ac.cross(ab)],
            six_volumes: ab.cross(ac).dot(ad),
        }
    }

    /// At each edge, the cosine of the dihedral angle and the square of its sine, both to the scale
    /// of the two areas.
    #[inline(always)]
    pub(crate) fn dihedrals(&self) -> [(f64, f64); 6] {
        // Two facets with normals n and m at an edge: |n x m| = |edge| * 6 |volume|. Both normals
        // point out, so that the angle is that of n and -m.
        let squared_volume = self.six_volumes * self.six_volumes;
        let at = |edge: usize| {
            let [.., k, l] = EDGES[edge];
            (-self.normals[k].dot(self.normals[l]), self.squares[edge] * squared_volume)
        };
        [at(0), at(1), at(2), at(3), at(4), at(5)]
    }

    /// Infinite for a flat tet.
    #[inline(always)]
    pub(crate) fn circumradius(&self) -> f64 {
        // Relative to the vertex with the shortest edges, which keeps the cancellation of the sum
        // smallest.
        let star = |vertex: usize| {
            let edges =
                STARS[vertex].map(|(edge, other)| (self.squares[edge], self.normals[other]));
            let [(p, n), (q, m), (r, o)] = edges;
            (p + q + r, p * n + q * m + r * o)
        };
        let (mut size, mut sum) = star(0);
        for vertex in 1..4 {
            let (other_size, other_sum) = star(vertex);
            let pick = |x: f64, y: f64| if other_size < size { x } else { y };
            sum = DVec3::new(
                pick(other_sum.x, sum.x),
                pick(other_sum.y, sum.y),
                pick(other_sum.z, sum.z),
            );
            size = pick(other_size, size);
        }
        let radius = sum.length() / (2.0 * self.six_volumes.abs());
        if self.six_volumes == 0.0 { f64::INFINITY } else { radius }
    }

    /// Of the two ratios and the Jacobian that solvers look at; see [`TetMeasures`].
    #[inline(always)]
    pub(crate) fn measures(&self) -> TetMeasures {
        let [ab, ac, ad, bc, bd, cd] = self.squares;
        // The longest product of the three edges of a vertex.
        let product = (ab * ac * ad).max(ab * bc * bd).max(ac * bc * cd).max(ad * bd * cd);
        let min = ab.min(ac).min(ad).min(bc).min(bd).min(cd);
        let max = ab.max(ac).max(ad).max(bc).max(bd).max(cd);
        let scaled = std::f64::consts::SQRT_2 * self.six_volumes / product.sqrt();
        // The inradius is three volumes over the area of all facets, whose normals are twice their
        // area long.
        let [n, m, o, p] = self.normals.map(DVec3::length);
        let areas = n + m + o + p;
        let radius_ratio = self.circumradius() * areas / (3.0 * self.six_volumes.abs());
        let edge_ratio = (max / min).sqrt();
        TetMeasures {
            scaled_jacobian: if product > 0.0 { scaled } else { 0.0 },
            edge_ratio: if min > 0.0 { edge_ratio } else { f64::INFINITY },
            radius_ratio: if radius_ratio.is_nan() { f64::INFINITY } else { radius_ratio },
        }
    }

    /// Circumradius over shortest edge; infinite for a flat tet.
    #[inline(always)]
    pub(crate) fn radius_edge(&self) -> f64 {
        let (radius, ratio) = (self.circumradius(), self.circumradius() / self.shortest_edge());
        if radius == f64::INFINITY { radius } else { ratio }
    }

    #[inline(always)]
    pub(crate) fn shortest_edge(&self) -> f64 {
        let [ab, ac, ad, bc, bd, cd] = self.squares;
        ab.min(ac).min(ad).min(bc).min(bd).min(cd).sqrt()
    }
}

/// The square of an angle's cotangent, with its sign: it falls as the angle grows, from infinity at
/// 0 to minus infinity at 180 degrees.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub(crate) struct Cotangent(pub(crate) f64);

impl Cotangent {
    pub(crate) const OF_ZERO: Self = Self(f64::INFINITY);
    pub(crate) const OF_STRAIGHT: Self = Self(f64::NEG_INFINITY);

    #[inline(always)]
    pub(crate) fn new((cosine, squared_sine): (f64, f64)) -> Self {
        let ratio = cosine * cosine.abs() / squared_sine;
        // 0 / 0, where vertices coincide: as atan2 has it, an angle of 0.
        if ratio.is_nan() { Self::OF_ZERO } else { Self(ratio) }
    }

    #[inline]
    pub(crate) fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    #[inline]
    pub(crate) fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    /// The angle in degrees.
    pub(crate) fn angle(self) -> f64 {
        1.0_f64.atan2(self.0.abs().sqrt().copysign(self.0)).to_degrees()
    }
}

/// What solvers look at, as Verdict defines it (C. J. Stimpson et al., "The Verdict Geometric
/// Quality Library", 2007), and so VTK, CUBIT and ParaView.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetMeasures {
    /// The Jacobian over the largest product of the three edges of a vertex, times the root of 2: 1
    /// for a regular tet, 0 for a flat one, negative for an inverted one.
    pub scaled_jacobian: f64,
    /// The longest edge over the shortest one: 1 for a regular tet.
    pub edge_ratio: f64,
    /// The circumradius over three times the inradius: 1 for a regular tet, infinite for a flat
    /// one.
    pub radius_ratio: f64,
}

/// The measures of a tet that solvers look at.
pub fn tet_measures(p: &[DVec3; 4]) -> TetMeasures {
    TetShape::new(p).measures()
}

/// A measure that each tet has a value of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TetMeasure {
    /// The smallest dihedral angle, in degrees.
    MinDihedral,
    /// The largest dihedral angle, in degrees.
    MaxDihedral,
    /// See [`TetMeasures`].
    ScaledJacobian,
    /// See [`TetMeasures`].
    EdgeRatio,
    /// See [`TetMeasures`].
    RadiusRatio,
    /// Circumradius over shortest edge.
    RadiusEdge,
}

impl TetMeasure {
    /// All of them, with their names in files.
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::MinDihedral, "min_dihedral"),
        (Self::MaxDihedral, "max_dihedral"),
        (Self::ScaledJacobian, "scaled_jacobian"),
        (Self::EdgeRatio, "edge_ratio"),
        (Self::RadiusRatio, "radius_ratio"),
        (Self::RadiusEdge, "radius_edge"),
    ];

    /// The value of a tet.
    pub fn of(self, p: &[DVec3; 4]) -> f64 {
        match self {
            Self::MinDihedral => dihedral_angles(p).into_iter().fold(180.0, f64::min),
            Self::MaxDihedral => dihedral_angles(p).into_iter().fold(0.0, f64::max),
            Self::ScaledJacobian => tet_measures(p).scaled_jacobian,
            Self::EdgeRatio => tet_measures(p).edge_ratio,
            Self::RadiusRatio => tet_measures(p).radius_ratio,
            Self::RadiusEdge => radius_edge_ratio(p),
        }
    }
}

/// Signed volume of a tet: positive when (b - a) x (c - a) . (d - a) > 0.
#[inline(always)]
pub fn tet_volume(p: &[DVec3; 4]) -> f64 {
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
}

/// The centroid of a tet.
#[inline(always)]
pub(crate) fn tet_centroid(&[a, b, c, d]: &[DVec3; 4]) -> DVec3 {
    (a + b + c + d) * 0.25
}

/// The six dihedral angles of a tet in degrees, 0 to 180, at the edges 01, 02, 03, 12, 13, 23. The
/// orientation does not matter; a flat tet gives angles of 0 and 180.
pub fn dihedral_angles(p: &[DVec3; 4]) -> [f64; 6] {
    TetShape::new(p)
        .dihedrals()
        .map(|(cosine, squared_sine)| squared_sine.sqrt().atan2(cosine).to_degrees())
}

/// Circumradius of a tet; infinite when it is flat.
pub fn tet_circumradius(p: &[DVec3; 4]) -> f64 {
    TetShape::new(p).circumradius()
}

/// Length of the shortest of the six edges.
pub fn shortest_edge(p: &[DVec3; 4]) -> f64 {
    TetShape::new(p).shortest_edge()
}

/// Circumradius over shortest edge; at least sqrt(6) / 4, infinite for a flat tet.
pub fn radius_edge_ratio(p: &[DVec3; 4]) -> f64 {
    TetShape::new(p).radius_edge()
}

/// At each vertex of a triangle, the cosine of its angle and the square of its sine, both to the
/// scale of twice the area.
#[inline]
pub(crate) fn corner_angles(&[a, b, c]: &[DVec3; 3]) -> [(f64, f64); 3] {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let squared_sine = ab.cross(ca).length_squared();
    [-ab.dot(ca), -bc.dot(ab), -ca.dot(bc)].map(|cosine| (cosine, squared_sine))
}

/// The planar angles of a triangle in degrees, at its vertices in their order.
pub fn triangle_angles(p: &[DVec3; 3]) -> [f64; 3] {
    corner_angles(p).map(|(cosine, squared_sine)| squared_sine.sqrt().atan2(cosine).to_degrees())
}

/// Area of a triangle.
pub fn triangle_area(p: &[DVec3; 3]) -> f64 {
    0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1.0), "{a} is not {b}");
    }

    fn regular() -> [DVec3; 4] {
        [
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(-1.0, -1.0, 1.0),
        ]
    }

    fn corner() -> [DVec3; 4] {
        [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
    }

    #[test]
    fn regular_tet() {
        let p = regular();
        close(tet_volume(&p).abs(), 8.0 / 3.0);
        dihedral_angles(&p).into_iter().for_each(|a| close(a, (1.0_f64 / 3.0).acos().to_degrees()));
        close(tet_circumradius(&p), 3.0_f64.sqrt());
        let TetMeasures { scaled_jacobian, edge_ratio, radius_ratio } = tet_measures(&p);
        [scaled_jacobian.abs(), edge_ratio, radius_ratio]
            .into_iter()
            .for_each(|measure| close(measure, 1.0));
        close(shortest_edge(&p), 8.0_f64.sqrt());
        close(radius_edge_ratio(&p), 6.0_f64.sqrt() / 4.0);
    }

    #[test]
    fn corner_of_a_cube() {
        let p = corner();
        close(tet_volume(&p), 1.0 / 6.0);
        let slope = (1.0_f64 / 3.0).sqrt().acos().to_degrees();
        let angles = dihedral_angles(&p);
        for (angle, expected) in angles.into_iter().zip([90.0, 90.0, 90.0, slope, slope, slope]) {
            close(angle, expected);
        }
        close(tet_circumradius(&p), 3.0_f64.sqrt() / 2.0);
        // The inradius is that of x + y + z = 1: 1 over 3 + the root of 3.
        let TetMeasures { scaled_jacobian, edge_ratio, radius_ratio } = tet_measures(&p);
        close(scaled_jacobian, 2.0_f64.sqrt() / 2.0);
        close(edge_ratio, 2.0_f64.sqrt());
        close(radius_ratio, 3.0_f64.sqrt() / 2.0 * (3.0 + 3.0_f64.sqrt()) / 3.0);
        let flat = tet_measures(&[p[0], p[1], p[2], DVec3::new(1.0, 1.0, 0.0)]);
        assert_eq!((flat.scaled_jacobian, flat.radius_ratio), (0.0, f64::INFINITY));
        let point = tet_measures(&[p[0]; 4]);
        assert_eq!(
            (point.scaled_jacobian, point.edge_ratio, point.radius_ratio),
            (0.0, f64::INFINITY, f64::INFINITY)
        );
    }

    proptest! {
        /// Angles from outward normals and `acos`, circumradius from products of opposite edges:
        /// other formulas, same figures.
        #[test]
        fn other_formulas_agree(c in prop::array::uniform12(-1.0..1.0f64)) {
            let p = [0, 3, 6, 9].map(|i| DVec3::from_slice(&c[i..i + 3]));
            let volume = tet_volume(&p).abs();
            prop_assume!(volume > 1e-2);
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
            let normal = |skip: usize| {
                let [a, b, c] = [1, 2, 3].map(|i| p[(skip + i) % 4]);
                let n = (b - a).cross(c - a).normalize();
                if n.dot(p[skip] - a) > 0.0 { -n } else { n }
            };
            for (angle, [.., k, l]) in dihedral_angles(&p).into_iter().zip(EDGES) {
                prop_assert!(near(angle, 180.0 - normal(k).dot(normal(l)).acos().to_degrees()));
            }
            let product =
                |i: usize, j: usize, k: usize, l: usize| p[i].distance(p[j]) * p[k].distance(p[l]);
            let (a, b, c) = (product(0, 1, 2, 3), product(0, 2, 1, 3), product(0, 3, 1, 2));
            let heron = (a + b + c) * (a + b - c) * (a - b + c) * (b + c - a);
            prop_assert!(near(tet_circumradius(&p), heron.sqrt() / (24.0 * volume)));
            let [i, j, k, l] = p;
            prop_assert!(near(tet_circumradius(&[k, i, l, j]), tet_circumradius(&p)));
            prop_assert!(near(radius_edge_ratio(&p), tet_circumradius(&p) / shortest_edge(&p)));
        }
    }

    #[test]
    fn slivers_keep_their_angles() {
        for height in [1e-3, 1e-6, 1e-9] {
            let p = [
                DVec3::new(0.0, 0.0, 0.0),
                DVec3::new(1.0, 0.0, height),
                DVec3::new(1.0, 1.0, 0.0),
                DVec3::new(0.0, 1.0, height),
            ];
            // At the diagonal 02 the triangles meet at pi - 2 atan(h sqrt 2), at the sides at a
            // small angle.
            let angles = dihedral_angles(&p);
            close(angles[1], 180.0 - 2.0 * (height * 2.0_f64.sqrt()).atan().to_degrees());
            let smallest = angles.into_iter().fold(180.0, f64::min);
            assert!(smallest > 0.0 && smallest < 3.0 * height.to_degrees(), "{smallest}");
            // By symmetry the centre is (1/2, 1/2, height/2).
            close(tet_circumradius(&p), (0.5 + height * height / 4.0).sqrt());
        }
    }

    #[test]
    fn flat_tets_do_not_break_anything() {
        let p = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        assert_eq!(radius_edge_ratio(&p), f64::INFINITY);
        assert!(dihedral_angles(&p).iter().all(|&a| a == 0.0 || a == 180.0));
        assert_eq!(radius_edge_ratio(&[DVec3::ZERO; 4]), f64::INFINITY);
    }

    #[test]
    fn triangle() {
        let p = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(0.0, 3.0_f64.sqrt(), 0.0)];
        for (angle, expected) in triangle_angles(&p).into_iter().zip([90.0, 30.0, 60.0]) {
            close(angle, expected);
        }
        close(triangle_area(&p), 1.5 * 3.0_f64.sqrt());
    }
}
