//! Where the map of a curved tet is one to one.
//!
//! The determinant of the Jacobian of a tet of second order is a polynomial of degree three. In
//! Bezier form it lies between the least and the largest of its twenty coefficients, so that it is
//! positive in the whole tet where all of them are (A. Johnen, J.-F. Remacle, C. Geuzaine,
//! "Geometrical validity of curvilinear finite elements", J. Comput. Phys. 233, 2013).

use glam::DVec3;

use super::TET_EDGES;

/// The coefficients, each with the number of terms that it is the mean of.
struct Coefficients {
    sums: [f64; 20],
    counts: [u8; 20],
}

/// The number of the coefficient of three vertices of a tet.
const NUMBER: [[[usize; 4]; 4]; 4] = {
    let mut numbers = [[[0; 4]; 4]; 4];
    let mut next = 0;
    let mut a = 0;
    while a < 4 {
        let mut b = a;
        while b < 4 {
            let mut c = b;
            while c < 4 {
                let orders = [[a, b, c], [a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]];
                let mut i = 0;
                while i < 6 {
                    numbers[orders[i][0]][orders[i][1]][orders[i][2]] = next;
                    i += 1;
                }
                next += 1;
                c += 1;
            }
            b += 1;
        }
        a += 1;
    }
    numbers
};

/// The least of the coefficients, and their mean: six times the volume.
pub fn min_and_mean(vertices: &[DVec3; 4], nodes: &[DVec3; 6]) -> [f64; 2] {
    // The control points: a vertex for i = j, else so that the curve of an edge passes through its
    // node.
    let mut control = [[DVec3::ZERO; 4]; 4];
    for i in 0..4 {
        control[i][i] = vertices[i];
    }
    for ([i, j], &node) in TET_EDGES.into_iter().zip(nodes) {
        let point = 2.0 * node - (vertices[i] + vertices[j]) * 0.5;
        (control[i][j], control[j][i]) = (point, point);
    }
    // The derivative along edge 0j is linear, with these values at the vertices.
    let along = |j: usize| [0, 1, 2, 3].map(|k: usize| 2.0 * (control[k][j] - control[k][0]));
    let [u, v, w] = [along(1), along(2), along(3)];
    let mut found = Coefficients { sums: [0.0; 20], counts: [0; 20] };
    for a in 0..4 {
        for b in 0..4 {
            let normal = u[a].cross(v[b]);
            for c in 0..4 {
                let number = NUMBER[a][b][c];
                found.sums[number] += normal.dot(w[c]);
                found.counts[number] += 1;
            }
        }
    }
    let values = found.sums.iter().zip(found.counts).map(|(sum, count)| sum / f64::from(count));
    let (min, sum) =
        values.fold((f64::INFINITY, 0.0), |(min, sum), value| (value.min(min), sum + value));
    [min, sum / 20.0]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const VERTICES: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];

    fn straight(vertices: &[DVec3; 4]) -> [DVec3; 6] {
        TET_EDGES.map(|[i, j]| (vertices[i] + vertices[j]) * 0.5)
    }

    /// The determinant at a place, by the derivatives of the shape functions.
    fn determinant(vertices: &[DVec3; 4], nodes: &[DVec3; 6], at: [f64; 4]) -> f64 {
        let gradients = [DVec3::NEG_ONE, DVec3::X, DVec3::Y, DVec3::Z];
        let mut rows = [DVec3::ZERO; 3];
        let mut add = |gradient: DVec3, point: DVec3| {
            (0..3).for_each(|axis| rows[axis] += gradient[axis] * point);
        };
        for i in 0..4 {
            add((4.0 * at[i] - 1.0) * gradients[i], vertices[i]);
        }
        for ([i, j], &node) in TET_EDGES.into_iter().zip(nodes) {
            add(4.0 * (at[j] * gradients[i] + at[i] * gradients[j]), node);
        }
        rows[0].cross(rows[1]).dot(rows[2])
    }

    #[test]
    fn straight_tets_have_one_value() {
        let [min, mean] = min_and_mean(&VERTICES, &straight(&VERTICES));
        assert!((min - 1.0).abs() < 1e-12 && (mean - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_node_near_a_vertex_turns_the_tet_over() {
        let mut nodes = straight(&VERTICES);
        nodes[0] = DVec3::new(0.2, 0.0, 0.0);
        // The derivative along the edge is negative at its start.
        assert!(min_and_mean(&VERTICES, &nodes)[0] < 0.0);
    }

    proptest! {
        #[test]
        fn the_determinant_lies_above_the_least_coefficient(
            moves in prop::array::uniform18(-0.3..0.3_f64),
            place in prop::array::uniform4(0.0..1.0_f64),
        ) {
            let mut nodes = straight(&VERTICES);
            for (node, by) in nodes.iter_mut().zip(moves.as_chunks::<3>().0) {
                *node += DVec3::from_array(*by);
            }
            let sum: f64 = place.iter().sum::<f64>().max(1e-9);
            let found = determinant(&VERTICES, &nodes, place.map(|x| x / sum));
            let [min, mean] = min_and_mean(&VERTICES, &nodes);
            prop_assert!(found >= min - 1e-9, "{found} {min}");
            // At vertices coefficients are values.
            for i in 0..4 {
                let mut at = [0.0; 4];
                at[i] = 1.0;
                prop_assert!(determinant(&VERTICES, &nodes, at) >= min - 1e-9);
            }
            // A rule that is exact for degree three: its mean is the mean of the coefficients.
            let others = (0..4).map(|i| {
                let mut at = [1.0 / 6.0; 4];
                at[i] = 0.5;
                determinant(&VERTICES, &nodes, at)
            });
            let by_rule =
                -0.8 * determinant(&VERTICES, &nodes, [0.25; 4]) + 0.45 * others.sum::<f64>();
            prop_assert!((by_rule - mean).abs() < 1e-9, "{by_rule} {mean}");
        }
    }
}
