//! The tets around an edge, and the ways to fill their place without the edge.
//!
//! **Ring.** The tets around edge ab are (a, b, r_0, r_1), (a, b, r_1, r_2), ..., all positive. The
//! vertices r_i form a closed polygon around the edge, counterclockwise as seen from b.
//!
//! **Edge removal** (L. A. Freitag, C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping
//! and smoothing", 1997). The polygon is divided into triangles, and each triangle (r_i, r_j, r_k)
//! with i < j < k makes two tets: one with b, one with a. If all are positive they fill the same
//! place as the ring. The best division is found by dynamic programming (G. T. Klincsek, "Minimal
//! triangulations of polygonal domains", 1980): a part of the polygon between r_i and r_k is
//! divided by the best triangle on its closing side.

use glam::DVec3;

use super::measure::{Measure, is_positive};
use super::shared::Shared;
use crate::mesh::NONE;

/// Rings of more tets are left as they are: their edge is hardly ever worth removing, and the
/// number of ways grows fast.
pub(super) const MAX_RING: usize = 10;

/// Vertices of the edges of a tet and the two others, in an order that is an even permutation: (a,
/// b, c, d) is positive.
pub(super) const EDGES: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]];

/// The tets around an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    /// The edge.
    pub ends: [u32; 2],
    /// How many tets there are.
    pub len: usize,
    /// The tets; number i is (a, b, r_i, r_(i+1)).
    pub tets: [u32; MAX_RING],
    /// The vertices r_i.
    pub vertices: [u32; MAX_RING],
    /// The labels of the tets.
    pub labels: [i32; MAX_RING],
}

/// What came of a walk around an edge.
pub(super) enum Around {
    /// All tets.
    Ring(Ring),
    /// A tet that the block does not own.
    Foreign,
    /// The border of what was kept of the triangulation, or too many tets.
    Open,
}

/// Collects the tets around edge `edge` (a number in [`EDGES`]) of tet `t`, all of which must be
/// owned.
pub(super) fn around(
    shared: &Shared<'_>,
    t: u32,
    edge: usize,
    is_owned: impl Fn([u32; 4]) -> bool,
) -> Around {
    let tet = shared.tet(t);
    let [i, j, k, l] = EDGES[edge];
    let [a, b] = [tet[i], tet[j]];
    let mut ring = Ring {
        ends: [a, b],
        len: 0,
        tets: [0; MAX_RING],
        vertices: [0; MAX_RING],
        labels: [0; MAX_RING],
    };
    let (mut at, mut leave, mut next) = (t, k, tet[l]);
    let mut from = tet[k];
    loop {
        if ring.len == MAX_RING {
            return Around::Open;
        }
        ring.tets[ring.len] = at;
        ring.vertices[ring.len] = from;
        ring.labels[ring.len] = shared.label(at);
        ring.len += 1;
        // Across the facet opposite to the vertex where this tet begins.
        at = shared.neighbor(at, leave);
        if at == t {
            return Around::Ring(ring);
        }
        if at == NONE {
            return Around::Open;
        }
        let tet = shared.tet(at);
        if !is_owned(tet) {
            return Around::Foreign;
        }
        from = next;
        let Some(facet) = (0..4).find(|&i| tet[i] == from) else { return Around::Open };
        leave = facet;
        next = match tet.into_iter().find(|&v| v != a && v != b && v != from) {
            Some(next) => next,
            None => return Around::Open,
        };
    }
}

/// A division of a part of a ring's polygon into triangles, by their places in the ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Division {
    pub len: usize,
    pub triangles: [[u8; 3]; MAX_RING],
    /// The least measure of the tets; infinite without tets that count.
    pub min: f64,
}

impl Division {
    pub const EMPTY: Self = Self { len: 0, triangles: [[0; 3]; MAX_RING], min: f64::INFINITY };

    pub fn triangles(&self) -> &[[u8; 3]] {
        &self.triangles[..self.len]
    }

    /// Two divisions of different parts.
    pub fn join(mut self, other: &Self) -> Self {
        for &triangle in other.triangles() {
            self.push(triangle);
        }
        self.min = self.min.min(other.min);
        self
    }

    fn push(&mut self, triangle: [u8; 3]) {
        self.triangles[self.len] = triangle;
        self.len += 1;
    }
}

/// Where the vertices of a ring are.
pub(super) struct RingPoints {
    pub measure: Measure,
    pub ends: [DVec3; 2],
    pub ring: [DVec3; MAX_RING],
}

impl RingPoints {
    pub fn new(shared: &Shared<'_>, ring: &Ring, measure: Measure) -> Self {
        let mut points = Self {
            measure,
            ends: ring.ends.map(|v| shared.point(v)),
            ring: [DVec3::ZERO; MAX_RING],
        };
        for (p, &v) in points.ring.iter_mut().zip(&ring.vertices[..ring.len]) {
            *p = shared.point(v);
        }
        points
    }

    /// The lesser measure of the two tets that a triangle makes; 0 if one does not measure more
    /// than `above`. Tets that do not `count` need only be positive.
    #[inline]
    fn of_triangle(&self, [i, j, k]: [u8; 3], counts: bool, above: f64) -> f64 {
        let [p, q, r] = [i, j, k].map(|n| self.ring[usize::from(n)]);
        let tets = [[p, q, r, self.ends[1]], [q, p, r, self.ends[0]]];
        if counts {
            let exceeds = tets.iter().all(|tet| self.measure.exceeds(tet, above));
            return if exceeds {
                self.measure.of(&tets[0]).min(self.measure.of(&tets[1]))
            } else {
                0.0
            };
        }
        if tets.iter().all(is_positive) { f64::INFINITY } else { 0.0 }
    }

    /// The best division of the polygon of these places in a ring, in their order, all of whose
    /// tets measure more than `above`.
    pub fn divide(&self, places: &[u8], counts: bool, above: f64) -> Option<Division> {
        let n = places.len();
        // Of the part from place i to place k: the best least measure, and its triangle's third
        // place.
        let mut best = [[f64::INFINITY; MAX_RING]; MAX_RING];
        let mut apex = [[0_u8; MAX_RING]; MAX_RING];
        for width in 2..n {
            for i in 0..n - width {
                let k = i + width;
                let mut found = 0.0;
                for j in i + 1..k {
                    let parts = best[i][j].min(best[j][k]);
                    if parts <= above.max(found) {
                        continue;
                    }
                    let triangle = [places[i], places[j], places[k]];
                    let min = parts.min(self.of_triangle(triangle, counts, above.max(found)));
                    if min > found {
                        found = min;
                        apex[i][k] = j as u8;
                    }
                }
                best[i][k] = if found > above { found } else { 0.0 };
            }
        }
        let mut division = Division { min: best[0][n - 1], ..Division::EMPTY };
        if n > 2 && division.min <= above {
            return None;
        }
        let mut parts = [(0_u8, 0_u8); MAX_RING];
        let mut open = 1;
        parts[0] = (0, n as u8 - 1);
        while open > 0 {
            open -= 1;
            let (i, k) = parts[open];
            if k - i < 2 {
                continue;
            }
            let j = apex[usize::from(i)][usize::from(k)];
            division.push(rotated([i, j, k].map(|n| places[usize::from(n)])));
            parts[open] = (i, j);
            parts[open + 1] = (j, k);
            open += 2;
        }
        Some(division)
    }
}

/// The same triangle with its least place first; if the places are in the order of the ring, they
/// then rise.
fn rotated([i, j, k]: [u8; 3]) -> [u8; 3] {
    match () {
        () if i < j && i < k => [i, j, k],
        () if j < k => [j, k, i],
        () => [k, i, j],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of n points around the edge from (0, 0, -1) to (0, 0, 1), not quite regular.
    fn points(n: usize) -> RingPoints {
        let mut ring = [DVec3::ZERO; MAX_RING];
        for (i, p) in ring.iter_mut().enumerate().take(n) {
            let angle =
                std::f64::consts::TAU * (i as f64 + 0.2 * ((i * 5 % 7) as f64 / 7.0)) / n as f64;
            let radius = 1.0 + 0.3 * ((i * 3 % 5) as f64 / 5.0);
            *p = DVec3::new(
                radius * angle.cos(),
                radius * angle.sin(),
                0.2 * ((i * 2 % 3) as f64 - 1.0),
            );
        }
        RingPoints { measure: Measure::new(15.0, 2.0), ends: [-DVec3::Z, DVec3::Z], ring }
    }

    /// The best least measure over all divisions, by trying them.
    fn best_of_all(points: &RingPoints, places: &[u8]) -> f64 {
        let n = places.len();
        if n < 3 {
            return f64::INFINITY;
        }
        let tries = (1..n - 1).map(|j| {
            let own = points.of_triangle([places[0], places[j], places[n - 1]], true, 0.0);
            own.min(best_of_all(points, &places[..=j])).min(best_of_all(points, &places[j..]))
        });
        tries.fold(0.0, f64::max)
    }

    #[test]
    fn the_best_division_is_found() {
        for n in 3..=MAX_RING {
            let points = points(n);
            let places: Vec<u8> = (0..n as u8).collect();
            let best = best_of_all(&points, &places);
            let division = points.divide(&places, true, 0.0).expect("the polygon is nearly convex");
            assert_eq!((division.min, division.len), (best, n - 2), "{n}");
            assert!(points.divide(&places, true, best).is_none());
            // Its triangles fill the polygon: each has the places of the ring in rising order, all
            // their tets are positive, and volumes add up.
            let volume = |p: [DVec3; 4]| (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]);
            let mut sum = 0.0;
            for &[i, j, k] in division.triangles() {
                assert!(i < j && j < k);
                let [p, q, r] = [i, j, k].map(|n| points.ring[usize::from(n)]);
                for tet in [[p, q, r, points.ends[1]], [q, p, r, points.ends[0]]] {
                    assert!(is_positive(&tet));
                    sum += volume(tet);
                }
            }
            let [a, b] = points.ends;
            let ring: f64 =
                (0..n).map(|i| volume([a, b, points.ring[i], points.ring[(i + 1) % n]])).sum();
            assert!((sum - ring).abs() < 1e-12);
        }
    }

    #[test]
    fn parts_of_a_polygon_may_begin_anywhere() {
        let points = points(8);
        let division = points.divide(&[6, 7, 0, 1, 2], true, 0.0).expect("positive");
        assert_eq!(division.len, 3);
        assert!(division.triangles().iter().all(|&[i, j, k]| i < j && j < k));
        let none = points.divide(&[3, 4], true, 0.5).expect("nothing to divide");
        assert_eq!((none.len, none.min), (0, f64::INFINITY));
    }
}
