//! The certificate of a finished mesh: what a user can rely on without trusting the mesher.
//!
//! All of it is computed from the finished mesh and the image alone, by code that refinement does not use, except two counts that only the
//! triangulation knows and that the caller hands in: facets that are not locally Delaunay, and elements that some rule still wants changed.
//! Orientation is exact: Shewchuk's adaptive predicate ("Adaptive precision floating-point arithmetic and fast robust geometric
//! predicates", 1997) from the `robust` crate. Distances are those of [`distance`](super::distance), components those of
//! [`components`](super::components).
//!
//! Deterministic whatever the number of threads; parallel in the current rayon pool; safe from any thread. Linear, but for the distances.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::TetMesh;
use super::components::{SLICE, TetCount, image_components, mesh_components};
use super::distance::SurfaceDistance;
use crate::Result;
use crate::image::LabelImage;
use crate::memory::zeroed;
use crate::monitor::{Monitor, Step};

/// Tets per work item.
const CHUNK: usize = 1 << 12;

/// One label, in the mesh and in the image. Volumes are in cubic world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LabelRow {
    /// The label; never 0.
    pub label: i32,
    /// Tets with the label; 0 if the mesh lost it.
    pub tets: u64,
    /// Sum of their volumes.
    pub mesh_volume: f64,
    /// Voxels times the volume of a voxel.
    pub image_volume: f64,
    /// Voxels with the label.
    pub image_voxels: u64,
    /// Face-connected components in the image.
    pub components_image: u64,
    /// Facet-connected components in the mesh.
    pub components_mesh: u64,
}

/// What holds for a finished mesh. Distances are in world units; divided by [`voxel`](Self::voxel) they are in voxels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Certificate {
    /// Facets whose tets' circumspheres hold the opposite vertex; counted by the caller on the triangulation.
    pub non_delaunay_facets: u64,
    /// Tets, of any label, whose orientation is not positive by the exact predicate.
    pub inverted_tets: u64,
    /// Vertices in no tet.
    pub orphan_vertices: u64,
    /// Edges where the boundary of some label (0 included) is not closed: an odd number of its facets meet there.
    pub open_edges: u64,
    /// Largest distance from the mesh's interfaces to the faces between voxels of different label, to within a hundredth of the smallest spacing.
    pub hausdorff_mesh_to_image: f64,
    /// Largest distance from those faces to the mesh's interfaces; infinite if the mesh has none.
    pub hausdorff_image_to_mesh: f64,
    /// Area-weighted mean of the distance from the mesh's interfaces.
    pub mean_mesh_to_image: f64,
    /// Area-weighted mean of the distance from the faces of the voxels.
    pub mean_image_to_mesh: f64,
    /// The smallest spacing of the image.
    pub voxel: f64,
    /// Elements that rules R1 to R6 still apply to, and that the spacing floor leaves as they are; counted by the caller.
    pub unmet: [u64; 6],
    /// Every label other than 0 that the image or the mesh holds, in increasing order.
    pub labels: Vec<LabelRow>,
}

impl Certificate {
    /// Certifies `mesh` against the `image` it was made from (with the labels that were not to be meshed already set to 0).
    ///
    /// # Errors
    /// [`InvalidArgument`](crate::Error::InvalidArgument) when a vertex is not finite; [`OutOfMemory`](crate::Error::OutOfMemory);
    /// [`Cancelled`](crate::Error::Cancelled).
    pub fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        non_delaunay_facets: u64,
        unmet: [u64; 6],
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let distance = SurfaceDistance::measure(mesh, image, monitor)?;
        let [_, _, nz] = image.dims();
        // Tets are gone over three times, facets twice, slices of voxels once; these count as some thousand tets each.
        monitor.enter(Step::Counts, 3 * mesh.tets.len() + 2 * mesh.facets.len() + SLICE * nz)?;
        Ok(Self {
            non_delaunay_facets,
            inverted_tets: inverted_tets(mesh, monitor)?,
            orphan_vertices: orphan_vertices(mesh, monitor)?,
            open_edges: open_edges(mesh, monitor)?,
            hausdorff_mesh_to_image: distance.mesh_to_image.max,
            hausdorff_image_to_mesh: distance.image_to_mesh.max,
            mean_mesh_to_image: distance.mesh_to_image.mean,
            mean_image_to_mesh: distance.image_to_mesh.mean,
            voxel: image.frame().spacing().min_element(),
            unmet,
            labels: label_rows(mesh, image, monitor)?,
        })
    }

    /// Volume of all labels together in the mesh.
    pub fn mesh_volume(&self) -> f64 {
        self.labels.iter().map(|row| row.mesh_volume).sum()
    }

    /// Volume of all labels together in the image.
    pub fn image_volume(&self) -> f64 {
        self.labels.iter().map(|row| row.image_volume).sum()
    }
}

/// Tets that are not positive: (b - a) x (c - a) . (d - a) > 0 fails. Exact as long as no product of three coordinate differences
/// over- or underflows.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub fn inverted_tets(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<u64> {
    let coordinates = |p: DVec3| robust::Coord3D { x: p.x, y: p.y, z: p.z };
    let counts = mesh.tets.par_chunks(CHUNK).map(|tets| {
        monitor.advance(tets.len())?;
        let inverted = tets.iter().filter(|tet| {
            let [a, b, c, d] = tet.map(|v| coordinates(mesh.point(v)));
            // The predicate's sign is opposite: positive when d is below the plane in which a, b, c turn left.
            robust::orient3d(a, b, c, d) >= 0.0
        });
        Ok(inverted.count() as u64)
    });
    counts.try_reduce(|| 0, |a, b| Ok(a + b))
}

/// Vertices that no tet has.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn orphan_vertices(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<u64> {
    let used: Vec<AtomicBool> = zeroed(mesh.points.len(), "vertices")?;
    mesh.tets.par_chunks(CHUNK).try_for_each(|tets| {
        monitor.advance(tets.len())?;
        for &v in tets.iter().flatten() {
            // Most are marked already: looking first lets threads share what they only read.
            if !used[v as usize].load(Relaxed) {
                used[v as usize].store(true, Relaxed);
            }
        }
        Ok(())
    })?;
    Ok(used.par_chunks(CHUNK).map(|used| used.iter().filter(|used| !used.load(Relaxed)).count() as u64).sum())
}

/// Edges at which the boundary between some label and all others is not closed. The boundary of a union of tets is a cycle modulo 2:
/// an even number of its facets meet at every edge, also where more than two labels do.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn open_edges(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<u64> {
    // The edges of all facets, gathered by their smaller vertex: a counting sort, since a sort of all of them would take seconds.
    let edges = |facet: &[u32; 3]| {
        let [a, b, c] = *facet;
        [[a, b], [b, c], [c, a]].map(|[v, w]| [v.min(w), v.max(w)])
    };
    let mut ends: Vec<AtomicUsize> = zeroed(mesh.points.len() + 1, "vertices")?;
    mesh.facets.par_chunks(CHUNK).try_for_each(|facets| {
        monitor.advance(facets.len())?;
        facets.iter().flat_map(edges).for_each(|[v, _]| _ = ends[v as usize + 1].fetch_add(1, Relaxed));
        Ok(())
    })?;
    let mut end = 0;
    for part in ends.chunks_mut(CHUNK) {
        monitor.check_cancelled()?;
        for count in part {
            end += *count.get_mut();
            *count.get_mut() = end;
        }
    }
    // The larger vertex of each edge, and its facet. `ends[v]` grows from the start of v's part to its end; who comes first does not matter, since each
    // part is sorted.
    let stars: Vec<AtomicU64> = zeroed(3 * mesh.facets.len(), "edges of the interfaces")?;
    mesh.facets.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, facets)| {
        monitor.advance(facets.len())?;
        for (facet, f) in facets.iter().zip((chunk * CHUNK) as u64..) {
            for [v, w] in edges(facet) {
                let place = ends[v as usize].fetch_add(1, Relaxed);
                stars[place].store(u64::from(w) << 32 | f, Relaxed);
            }
        }
        Ok(())
    })?;
    let open_in = |chunk: usize| {
        monitor.check_cancelled()?;
        let (mut star, mut sides) = (Vec::new(), Vec::new());
        let mut open = 0;
        let mut start = if chunk == 0 { 0 } else { ends[chunk * CHUNK - 1].load(Relaxed) };
        for v in chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.points.len()) {
            let end = ends[v].load(Relaxed);
            star.clear();
            star.extend(stars[start..end].iter().map(|entry| entry.load(Relaxed)));
            star.sort_unstable();
            let edges = star.chunk_by(|x, y| x >> 32 == y >> 32);
            open += edges.filter(|edge| is_open(edge, &mesh.facet_labels, &mut sides)).count() as u64;
            start = end;
        }
        Ok(open)
    };
    (0..mesh.points.len().div_ceil(CHUNK)).into_par_iter().map(open_in).try_reduce(|| 0, |a, b| Ok(a + b))
}

/// Whether some label has an odd number of the facets at an edge, whose numbers are the low halves of `edge`. `sides`: room to work in.
fn is_open(edge: &[u64], facet_labels: &[[i32; 2]], sides: &mut Vec<i32>) -> bool {
    let labels = |entry: u64| facet_labels[entry as u32 as usize];
    // Most edges are inside an interface.
    if let &[one, other] = edge
        && labels(one) == labels(other)
    {
        return false;
    }
    sides.clear();
    sides.extend(edge.iter().flat_map(|&entry| labels(entry)));
    sides.sort_unstable();
    sides.chunk_by(|x, y| x == y).any(|side| side.len() % 2 == 1)
}

/// The table of labels: those of the image, lost ones included, and those that only the mesh has.
///
/// # Errors
/// Those of [`image_components`] and [`mesh_components`].
pub fn label_rows(mesh: &TetMesh, image: &LabelImage, monitor: &Monitor<'_>) -> Result<Vec<LabelRow>> {
    let voxel_volume = image.frame().spacing().element_product();
    let counts = image_components(image, monitor)?;
    let mut rows: Vec<LabelRow> = counts
        .iter()
        .zip(image.labels())
        .filter(|(count, _)| count.voxels > 0)
        .map(|(count, &label)| LabelRow {
            label,
            image_volume: count.voxels as f64 * voxel_volume,
            image_voxels: count.voxels,
            components_image: count.components,
            ..LabelRow::default()
        })
        .collect();
    rows.sort_unstable_by_key(|row| row.label);
    for TetCount { label, tets, volume, components } in mesh_components(mesh, monitor)? {
        let at = rows.binary_search_by_key(&label, |row| row.label).unwrap_or_else(|at| {
            rows.insert(at, LabelRow { label, ..LabelRow::default() });
            at
        });
        rows[at] = LabelRow { tets, mesh_volume: volume, components_mesh: components, ..rows[at] };
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;
    use crate::image::Frame;

    fn nested(i: usize, j: usize, k: usize) -> i32 {
        let edge = |x: usize| x == 0 || x == 3;
        if edge(i) || edge(j) || edge(k) { 5 } else { 900 }
    }

    fn nested_pair() -> (TetMesh, LabelImage) {
        let spacing = [1.0, 0.5, 2.0];
        let frame = Frame::new([0.5, 0.25, 1.0], spacing, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).unwrap();
        (testing::kuhn_box([4; 3], spacing, nested), testing::image([4; 3], frame, nested))
    }

    #[test]
    fn a_perfect_mesh() {
        let (mesh, image) = nested_pair();
        let certificate = Certificate::measure(&mesh, &image, 3, [1, 2, 3, 4, 5, 6], &Monitor::silent()).unwrap();
        let row = |label, voxels: u64| LabelRow {
            label,
            tets: 6 * voxels,
            mesh_volume: voxels as f64,
            image_volume: voxels as f64,
            image_voxels: voxels,
            components_image: 1,
            components_mesh: 1,
        };
        let expected = Certificate {
            non_delaunay_facets: 3,
            unmet: [1, 2, 3, 4, 5, 6],
            voxel: 0.5,
            labels: vec![row(5, 56), row(900, 8)],
            ..Certificate::default()
        };
        assert_eq!(certificate.labels.len(), 2);
        for (row, expected) in certificate.labels.iter().zip(&expected.labels) {
            assert!((row.mesh_volume - expected.mesh_volume).abs() < 1e-12);
            assert_eq!(LabelRow { mesh_volume: expected.mesh_volume, ..*row }, *expected);
        }
        assert_eq!(Certificate { labels: expected.labels.clone(), ..certificate.clone() }, expected);
        assert_eq!(certificate.image_volume(), 64.0);
        assert!((certificate.mesh_volume() - 64.0).abs() < 1e-12);
    }

    #[test]
    fn faults_are_counted() {
        let (mut mesh, image) = nested_pair();
        mesh.points.push([0.0; 3]);
        mesh.tets[7].swap(0, 1);
        let flat = mesh.tets[9];
        mesh.tets[9][0] = flat[1];
        // One facet fewer leaves its three edges open.
        mesh.facets.pop();
        mesh.facet_labels.pop();
        mesh.facet_tets.pop();
        let certificate = Certificate::measure(&mesh, &image, 0, [0; 6], &Monitor::silent()).unwrap();
        assert_eq!((certificate.inverted_tets, certificate.orphan_vertices, certificate.open_edges), (2, 1, 3));
    }

    #[test]
    fn many_labels_at_an_edge_are_closed() {
        // Cubes in a checkerboard of four labels and background meet in every way along edges.
        let mesh = testing::kuhn_box([4, 4, 3], [1.0; 3], |i, j, k| ((i * 3 + j * 5 + k * 7 + i * j) % 5) as i32);
        assert_eq!(open_edges(&mesh, &Monitor::silent()).unwrap(), 0);
    }

    #[test]
    fn a_tet_that_is_flat_but_for_rounding() {
        // d is off the plane of a, b, c by less than the rounding of the plain determinant.
        let tet = |z: f64| TetMesh {
            points: vec![[12.0, 12.0, 12.0], [24.0, 24.0, 24.0], [0.5, 12.5, 0.5], [0.25, 6.25, z]],
            tets: vec![[0, 1, 2, 3]],
            labels: vec![1],
            neighbors: vec![[super::super::NONE; 4]],
            ..TetMesh::default()
        };
        let counts = [0.25 - f64::EPSILON / 4.0, 0.25, 0.25 + f64::EPSILON / 4.0]
            .map(|z| inverted_tets(&tet(z), &Monitor::silent()).unwrap());
        assert_eq!(counts[1], 1, "a flat tet counts");
        assert_eq!(counts[0] + counts[2], 1, "one side of the plane is inverted, the other is not");
    }

    #[test]
    fn equal_bits_on_any_number_of_threads() {
        // Some chunks of everything, with faults of every kind.
        let label = |i: usize, j: usize, k: usize| ((i / 3 + j / 4 * k) % 4) as i32;
        let mut mesh = testing::kuhn_box([18, 16, 12], [1.0; 3], label);
        let image = testing::image([18, 16, 12], Frame::axis_aligned([1.0; 3]).unwrap(), label);
        for (v, p) in mesh.points.iter_mut().enumerate() {
            *p = p.map(|x| x + 0.45 + 0.2 * ((v * 37 % 101) as f64 / 101.0));
        }
        mesh.points.push([5.0; 3]);
        for t in (0..mesh.tets.len()).step_by(1000) {
            mesh.tets[t].swap(1, 2);
        }
        for f in (0..mesh.facets.len()).rev().step_by(500) {
            mesh.facets.remove(f);
            mesh.facet_labels.remove(f);
            mesh.facet_tets.remove(f);
        }
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Certificate::measure(&mesh, &image, 0, [0; 6], &Monitor::silent()).unwrap())
        };
        let certificate = on(1);
        assert!(mesh.tets.len() > 4 * CHUNK && mesh.facets.len() > CHUNK);
        assert!(certificate.inverted_tets == 21 && certificate.orphan_vertices == 1 && certificate.open_edges > 10);
        assert_eq!(certificate, on(3));
    }

    #[test]
    fn labels_of_one_side_only_have_rows() {
        let image = testing::image([2, 1, 1], Frame::axis_aligned([1.0; 3]).unwrap(), |i, _, _| [1, 7][i]);
        let mesh = testing::kuhn_box([2, 1, 1], [1.0; 3], |i, _, _| [7, -3][i]);
        let rows = label_rows(&mesh, &image, &Monitor::silent()).unwrap();
        assert_eq!(
            rows.iter().map(|r| (r.label, r.tets, r.image_voxels)).collect::<Vec<_>>(),
            [(-3, 6, 0), (1, 0, 1), (7, 6, 1)]
        );
    }
}
