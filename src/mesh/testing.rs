//! Small structured meshes and images for the tests of this crate.

use std::collections::BTreeMap;

use super::{NONE, TetMesh};
use crate::image::{Frame, LabelImage};

/// The six monotone paths from corner 000 to corner 111 of a cube; each is a tet of Kuhn's
/// subdivision.
const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]];

/// The frame of an image whose voxels are the cubes of [`kuhn_box`].
pub fn box_frame(step: [f64; 3]) -> Frame {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Frame::new(step.map(|s| 0.5 * s), step, axes).unwrap()
}

/// Kuhn's subdivision of a box of `cubes` cubes with edges `step` and one corner at the origin.
/// `label(i, j, k)` labels the six tets of a cube; label 0 is kept as background. The outside of
/// the box counts as background that was not kept.
pub fn kuhn_box(
    cubes: [usize; 3],
    step: [f64; 3],
    label: impl Fn(usize, usize, usize) -> i32,
) -> TetMesh {
    let [nx, ny, nz] = cubes;
    let mut mesh = TetMesh::default();
    for k in 0..=nz {
        for j in 0..=ny {
            for i in 0..=nx {
                mesh.points.push([i as f64 * step[0], j as f64 * step[1], k as f64 * step[2]]);
            }
        }
    }
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                for (which, path) in PATHS.iter().enumerate() {
                    let mut corner = [i, j, k];
                    let mut tet = [0; 4];
                    for step in 0..4 {
                        tet[step] =
                            (corner[0] + (nx + 1) * (corner[1] + (ny + 1) * corner[2])) as u32;
                        if step < 3 {
                            corner[path[step]] += 1;
                        }
                    }
                    // The odd permutations of the axes are negative.
                    if which >= 3 {
                        tet.swap(2, 3);
                    }
                    mesh.tets.push(tet);
                    mesh.labels.push(label(i, j, k));
                }
            }
        }
    }
    connect(&mut mesh);
    mesh
}

/// Facet i of a positive tet, ordered so that its normal points out of the tet.
pub fn outward_facet(tet: &[u32; 4], i: usize) -> [u32; 3] {
    let [a, b, c, d] = *tet;
    [[b, c, d], [a, d, c], [a, b, d], [a, c, b]][i]
}

/// Fills neighbours and interface facets from tets and labels, slowly.
pub fn connect(mesh: &mut TetMesh) {
    let mut sides: BTreeMap<[u32; 3], Vec<(u32, usize)>> = BTreeMap::new();
    for (t, tet) in mesh.tets.iter().enumerate() {
        for i in 0..4 {
            let mut key = outward_facet(tet, i);
            key.sort_unstable();
            sides.entry(key).or_default().push((t as u32, i));
        }
    }
    mesh.neighbors = vec![[NONE; 4]; mesh.tets.len()];
    (mesh.facets, mesh.facet_labels, mesh.facet_tets) = Default::default();
    for side in sides.values() {
        let (t, i) = side[0];
        let (u, other) = match side.get(1) {
            Some(&(u, j)) => {
                mesh.neighbors[t as usize][i] = u;
                mesh.neighbors[u as usize][j] = t;
                (u, mesh.labels[u as usize])
            }
            None => (NONE, 0),
        };
        let own = mesh.labels[t as usize];
        if own != other {
            let [a, b, c] = outward_facet(&mesh.tets[t as usize], i);
            let swap = !super::facets::is_before(own, other);
            mesh.facets.push(if swap { [a, c, b] } else { [a, b, c] });
            mesh.facet_labels.push(if swap { [other, own] } else { [own, other] });
            mesh.facet_tets.push(if swap { [u, t] } else { [t, u] });
        }
    }
}

/// An image with labels `label(i, j, k)`, all of them at least 0.
pub fn image(
    dims: [usize; 3],
    frame: Frame,
    label: impl Fn(usize, usize, usize) -> i32,
) -> LabelImage {
    let mut values = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                values.push(label(i, j, k));
            }
        }
    }
    let mut labels = values.clone();
    labels.push(0);
    labels.sort_unstable();
    labels.dedup();
    let ids = values
        .iter()
        .map(|value| labels.iter().position(|label| label == value).unwrap_or(0) as u16)
        .collect();
    LabelImage::from_ids(dims, frame, ids, labels).expect("a valid image")
}
