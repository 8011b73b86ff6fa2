//! The surfaces that bound the components of a mesh: their Euler characteristic, and where they
//! touch themselves.
//!
//! First the boundary of each part, of tets joined across facets, is taken as a closed surface that
//! lies just inside of it: so it is one whatever touches, and its Euler characteristic is 2 - 2 *
//! (genus) for each piece of it. It is counted on the boundary facets, V - E + F. At an edge the
//! surface passes once through each wedge of the part's tets; which of its facets bound one wedge
//! is found out, where there are more than two, by going around the edge from tet to tet. At a
//! vertex the part's facets form *cycles*; where the tets there are joined across their
//! facets at the vertex to a cone with n cycles, the surface passes through it as a disk with n
//! - 1 holes, which counts 2 - n: mostly 1.
//!
//! **Touching.** The union of a component's closed tets is another solid: there wedges that meet in
//! an edge are one, cones that meet in a vertex too, and so is a cone with several cycles around
//! its vertex. Its characteristic, twice V - E + F - T, is that of the boundary, and at each such
//! vertex 2 (1 - c), at each such edge 2 (c - 1) more: c is the characteristic of what the solid
//! just inside of the tets has around there, 2 - n for a cone with n cycles and 1 for a wedge.
//! Parts that meet in such places are one component.
//!
//! A place where a label's boundary is no surface is *non-manifold*: an edge with more than two of
//! its facets, or a vertex, at no such edge, with more than one cycle. An edge where the boundary
//! of a label (0 included) has an odd number of facets is *open*: the boundary of a union of tets
//! has none.
//!
//! Deterministic whatever the number of threads; parallel in the current rayon pool. Each
//! vertex has a list of its facets: linear in them.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::mesh_components::MeshComponents;
pub use super::vertex_links::NonManifold;
use super::vertex_links::{Corner, Touch, VertexLinks};
use crate::memory::{filled, zeroed};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::reduce::Sums;
use crate::{Error, Result};

/// Facets, or vertices, per work item.
const CHUNK: usize = 1 << 12;

/// What is measured on the boundaries of components.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundarySurfaces {
    /// Edges where the boundary of some label is open.
    pub open_edges: u64,
    /// The Euler characteristic of the boundary of each component: twice that of the union of its
    /// closed tets.
    pub euler: Vec<i64>,
    /// In the order of their vertices.
    pub non_manifold: Vec<NonManifold>,
}

impl BoundarySurfaces {
    /// Measures the boundaries of the parts of a mesh, and joins those that touch to `components`.
    ///
    /// # Errors
    /// [`Error::Cancelled`], [`Error::OutOfMemory`]; [`Error::LimitReached`] for more than
    /// 1431655764 facets.
    pub(crate) fn measure(
        mesh: &TetMesh,
        components: &mut MeshComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let mut parts = Parts::measure(mesh, components, monitor)?;
        for touch in &parts.touches {
            // All that it joins come to be one component.
            if let Some(&part) = touch.parts.first() {
                parts.euler[part as usize] += touch.euler;
            }
        }
        components.join(parts.touches.iter().map(|touch| &touch.parts[..]), monitor)?;
        let mut euler = filled(components.list.len(), 0, "components of the mesh", || Ok(()))?;
        for (component, part) in components.of_parts().iter().zip(parts.euler) {
            euler[*component as usize] += part;
        }
        Ok(Self { open_edges: parts.open_edges, euler, non_manifold: parts.non_manifold })
    }
}

/// What is measured part by part, just inside of the tets.
#[derive(Default)]
struct Parts {
    open_edges: u64,
    euler: Vec<i64>,
    non_manifold: Vec<NonManifold>,
    touches: Vec<Touch>,
}

impl Parts {
    /// Measures the boundaries of all parts.
    fn measure(mesh: &TetMesh, parts: &MeshComponents, monitor: &Monitor<'_>) -> Result<Self> {
        let stars = Stars::new(mesh, monitor)?;
        let measure = |chunk: usize| {
            monitor.advance(CHUNK)?;
            let mut vertex_links = VertexLinks::new(mesh, parts);
            for v in chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.points.len()) {
                vertex_links.look_at(v as u32, stars.of(v));
            }
            let VertexLinks { open_edges, non_manifold, touches, euler, .. } = vertex_links;
            Ok((Self { open_edges, non_manifold, touches, euler: Vec::new() }, euler.sums()))
        };
        let chunks = (0..mesh.points.len().div_ceil(CHUNK)).into_par_iter();
        let pieces: Vec<(Self, Sums<i64>)> = chunks.map(measure).collect::<Result<_>>()?;
        let euler = filled(parts.list.len(), 0, "parts of the mesh", || Ok(()))?;
        let mut all = Self { euler, ..Self::default() };
        for (piece, euler) in pieces {
            all.open_edges += piece.open_edges;
            all.non_manifold.extend(piece.non_manifold);
            all.touches.extend(piece.touches);
            euler.into_iter().for_each(|(part, sum)| all.euler[part as usize] += sum);
        }
        // Around one vertex they come in no particular order.
        all.non_manifold.sort_unstable();
        Ok(all)
    }
}

/// The facets of each vertex, as lists of their corners.
struct Stars {
    /// The first corner of each vertex, plus 1; 0 where it has none.
    first: Vec<AtomicU32>,
    /// The corner after each corner, likewise. Corner 3 f + i is vertex i of facet f.
    next: Vec<AtomicU32>,
}

impl Stars {
    /// # Errors
    /// [`Error::LimitReached`] for more than 1431655764 facets, whose corners have no numbers;
    /// [`Error::Cancelled`], [`Error::OutOfMemory`].
    fn new(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Self> {
        if mesh.facets.len() >= (u32::MAX / 3) as usize {
            return Err(Error::LimitReached("more than 1431655764 interface facets".into()));
        }
        let first: Vec<AtomicU32> = zeroed(mesh.points.len(), "vertices")?;
        let next: Vec<AtomicU32> = zeroed(3 * mesh.facets.len(), "facets of vertices")?;
        // Relaxed: each list is read when all are made. Which corner comes first in it does not
        // matter to what is made of them.
        let pieces = mesh.facets.par_chunks(CHUNK).zip(next.par_chunks(3 * CHUNK)).enumerate();
        pieces.try_for_each(|(chunk, (facets, next))| {
            monitor.advance(2 * facets.len())?;
            let corners = facets.as_flattened().iter().zip(next);
            for (corner, (&v, next)) in ((3 * CHUNK * chunk) as u32..).zip(corners) {
                next.store(first[v as usize].swap(corner + 1, Relaxed), Relaxed);
            }
            Ok(())
        })?;
        Ok(Self { first, next })
    }

    /// The corners at `v`.
    fn of(&self, v: usize) -> impl Iterator<Item = Corner> {
        let mut corner = self.first[v].load(Relaxed);
        std::iter::from_fn(move || {
            let here = corner.checked_sub(1)?;
            corner = self.next[here as usize].load(Relaxed);
            Some(Corner { facet: here / 3, place: (here % 3) as usize })
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::components::ImageComponents;
    use crate::image::{Frame, LabelImage};
    use crate::mesh::testing;

    fn measured(mesh: &TetMesh, image: &LabelImage) -> (BoundarySurfaces, MeshComponents) {
        let monitor = Monitor::silent();
        let of_image = ImageComponents::new(image, &|_| Ok(())).unwrap();
        let mut of_mesh = MeshComponents::new(mesh, image, &of_image, &monitor).unwrap();
        (BoundarySurfaces::measure(mesh, &mut of_mesh, &monitor).unwrap(), of_mesh)
    }

    fn measured_by_part(mesh: &TetMesh, image: &LabelImage) -> (Parts, MeshComponents) {
        let monitor = Monitor::silent();
        let of_image = ImageComponents::new(image, &|_| Ok(())).unwrap();
        let parts = MeshComponents::new(mesh, image, &of_image, &monitor).unwrap();
        (Parts::measure(mesh, &parts, &monitor).unwrap(), parts)
    }

    /// The Euler characteristics of the boundaries of parts, just inside of the tets.
    fn by_part(dims: [usize; 3], label: impl Fn(usize, usize, usize) -> i32 + Copy) -> Vec<i64> {
        let image = testing::image(dims, Frame::axis_aligned([1.0; 3]).unwrap(), label);
        measured_by_part(&testing::kuhn_box(dims, [1.0; 3], label), &image).0.euler
    }

    fn of_voxels(
        dims: [usize; 3],
        label: impl Fn(usize, usize, usize) -> i32 + Copy,
    ) -> BoundarySurfaces {
        let image = testing::image(dims, Frame::axis_aligned([1.0; 3]).unwrap(), label);
        measured(&testing::kuhn_box(dims, [1.0; 3], label), &image).0
    }

    const DIMS: [usize; 3] = [6, 4, 4];

    proptest! {
        /// The closed tets of a Kuhn mesh fill the closed voxels.
        #[test]
        fn touching_tets_against_closed_voxels(
            values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2]),
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let (surfaces, components) =
                measured(&testing::kuhn_box(DIMS, [1.0; 3], label), &image);
            let of_image = ImageComponents::new(&image, &|_| Ok(())).unwrap();
            let first = |at: [usize; 3]| 6 * (at[0] + DIMS[0] * (at[1] + DIMS[1] * at[2])) as u32;
            let mut expected: Vec<_> =
                of_image.list.iter().map(|c| (first(c.first), 6 * c.voxels, 2 * c.euler)).collect();
            expected.sort_unstable();
            let found: Vec<_> = components
                .list
                .iter()
                .zip(&surfaces.euler)
                .map(|(c, &euler)| (c.first, c.tets.count, euler))
                .collect();
            prop_assert_eq!(found, expected);
        }

        /// The tets of a Kuhn mesh fill the voxels: the solid just inside is that of voxels, pairs
        /// across a face, squares of four and cubes of eight.
        #[test]
        fn a_mesh_of_voxels_against_their_complex(
            values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2]),
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            let (surfaces, components) = measured_by_part(&mesh, &image);
            let mut expected = vec![0_i64; surfaces.euler.len()];
            for (cell, component) in
                (0..values.len()).filter_map(|cell| Some((cell, components.of(6 * cell as u32)?)))
            {
                let at = [cell % DIMS[0], cell / DIMS[0] % DIMS[1], cell / (DIMS[0] * DIMS[1])];
                for size in 0..8 {
                    let upper = [size & 1, size >> 1 & 1, size >> 2];
                    let bricks = (0..8).map(|bits| {
                        [0, 1, 2].map(|axis| at[axis] + upper[axis] * (bits >> axis & 1))
                    });
                    let mut bricks = bricks.map(|at| {
                        (0..3).all(|axis| at[axis] < DIMS[axis])
                            && label(at[0], at[1], at[2]) == values[cell]
                    });
                    let sign = if upper.iter().sum::<usize>() % 2 == 0 { 1 } else { -1 };
                    expected[component as usize] +=
                        if bricks.all(|same| same) { 2 * sign } else { 0 };
                }
            }
            prop_assert_eq!(surfaces.euler, expected);
            prop_assert_eq!(surfaces.open_edges, 0);
            // An edge of the grid is non-manifold where two of the four voxels around it are of a
            // label and across from each other, and the others are not.
            let at = |[i, j, k]: [isize; 3]| {
                let inside = (0..DIMS[0] as isize).contains(&i)
                    && (0..DIMS[1] as isize).contains(&j)
                    && (0..DIMS[2] as isize).contains(&k);
                if inside {
                    values[i as usize + DIMS[0] * (j as usize + DIMS[1] * k as usize)]
                } else {
                    0
                }
            };
            let mut edges = 0;
            for (i, j, k, axis) in (0..7).flat_map(|i| {
                (0..5).flat_map(move |j| {
                    (0..5).flat_map(move |k| (0..3).map(move |axis| (i, j, k, axis)))
                })
            }) {
                let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                    let mut cell = [i, j, k];
                    cell[(axis + 1) % 3] -= u;
                    cell[(axis + 2) % 3] -= v;
                    at(cell)
                });
                for (one, other) in [(0, 1), (1, 0)] {
                    let label = around[one];
                    let touches = label != 0
                        && around[one + 2] == label
                        && around[other] != label
                        && around[(other + 2) % 4] != label;
                    edges += usize::from(touches);
                }
            }
            let of_edges = surfaces.non_manifold.iter().filter(|place| place.is_edge());
            prop_assert_eq!(of_edges.count(), edges);
        }
    }

    #[test]
    fn surfaces_that_everyone_knows() {
        let euler = |dims, label: fn(usize, usize, usize) -> i32| {
            let surfaces = of_voxels(dims, label);
            assert_eq!((surfaces.open_edges, surfaces.non_manifold), (0, Vec::new()));
            surfaces.euler
        };
        assert_eq!(euler([3; 3], |_, _, _| 1), [2], "a ball");
        assert_eq!(euler([3, 3, 1], |i, j, _| i32::from(!(i == 1 && j == 1))), [0], "a torus");
        assert_eq!(
            euler([5, 3, 1], |i, j, _| i32::from(!(i % 2 == 1 && j == 1))),
            [-2],
            "two holes"
        );
        assert_eq!(
            euler([3; 3], |i, j, k| 2 - i32::from(i == 1 && j == 1 && k == 1)),
            [2 + 2, 2],
            "a ball in a shell"
        );
        assert_eq!(euler([3, 1, 1], |i, _, _| i32::from(i != 1)), [2, 2], "two balls");
        assert_eq!(euler([2; 3], |i, j, k| 1 + (i + 2 * j + 4 * k) as i32), [2; 8], "eight balls");
    }

    #[test]
    fn what_touches_is_one_component() {
        // Two cubes with one edge in common, two with one vertex, and a ring of cubes closed by an
        // edge.
        let edge = |i: usize, j: usize, _: usize| i32::from(i == j);
        let surfaces = of_voxels([2, 2, 1], edge);
        assert_eq!(by_part([2, 2, 1], edge), [2, 2]);
        assert_eq!(
            (surfaces.euler, surfaces.non_manifold),
            (vec![2], vec![NonManifold { ends: [4, 13], label: 1 }])
        );
        let corner = |i: usize, j: usize, k: usize| i32::from(i == j && j == k);
        let surfaces = of_voxels([2; 3], corner);
        assert_eq!(by_part([2; 3], corner), [2, 2]);
        assert_eq!(
            (surfaces.euler, surfaces.non_manifold),
            (vec![2], vec![NonManifold { ends: [13, 13], label: 1 }])
        );
        // Two cavities with a vertex in common are two; just inside, one surface goes around both.
        let cavities =
            |i: usize, j: usize, k: usize| i32::from([i, j, k] != [1; 3] && [i, j, k] != [2; 3]);
        let surfaces = of_voxels([4; 3], cavities);
        assert_eq!(by_part([4; 3], cavities), [4]);
        assert_eq!(
            (surfaces.euler, surfaces.non_manifold),
            (vec![6], vec![NonManifold { ends: [62, 62], label: 1 }])
        );
        let ring = |i: usize, j: usize, _: usize| [[1, 1, 1], [1, 0, 2], [1, 1, 0]][j][i];
        let surfaces = of_voxels([3, 3, 1], ring);
        assert_eq!(
            (surfaces.euler, surfaces.non_manifold),
            (vec![2, 2], vec![]),
            "a bent bar and a cube"
        );
        let closed =
            |i: usize, j: usize, _: usize| i32::from([[1, 1, 1], [1, 0, 1], [1, 1, 0]][j][i] == 1);
        let surfaces = of_voxels([3, 3, 1], closed);
        assert_eq!(by_part([3, 3, 1], closed), [2]);
        assert_eq!(
            (surfaces.euler, surfaces.non_manifold),
            (vec![0], vec![NonManifold { ends: [10, 26], label: 1 }])
        );
    }

    #[test]
    fn many_labels_at_an_edge_are_closed() {
        // Cubes in a checkerboard of four labels and background meet in every way along edges.
        let surfaces = of_voxels([4, 4, 3], |i, j, k| ((i * 3 + j * 5 + k * 7 + i * j) % 5) as i32);
        assert_eq!(surfaces.open_edges, 0);
    }

    #[test]
    fn faults_are_survived_and_counted() {
        let label = |i: usize, j: usize, _: usize| i32::from(i == j);
        let image = testing::image([2, 2, 1], Frame::axis_aligned([1.0; 3]).unwrap(), label);
        let mut mesh = testing::kuhn_box([2, 2, 1], [1.0; 3], label);
        // One facet fewer leaves its three edges open; a tet that names a vertex twice leads
        // nowhere.
        mesh.facets.pop();
        mesh.facet_labels.pop();
        mesh.facet_tets.pop();
        for t in 0..mesh.tets.len() {
            mesh.tets[t][1] = mesh.tets[t][0];
        }
        assert_eq!(measured(&mesh, &image).0.open_edges, 3);
    }

    #[test]
    fn equal_on_any_number_of_threads() {
        let label = |i: usize, j: usize, k: usize| ((i / 3 + j / 4 * k) % 4) as i32;
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| of_voxels([18, 16, 12], label))
        };
        let one = on(1);
        assert!(one.non_manifold.len() > 10);
        assert_eq!(one, on(3));
    }
}
