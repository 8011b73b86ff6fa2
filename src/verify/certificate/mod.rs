//! The certificate of a finished mesh: what a user can rely on without trusting the mesher.
//!
//! All of it is computed from the finished mesh and the image alone, by code that refinement does
//! not use, except two counts that only the triangulation knows and that the caller hands in:
//! facets that are not locally Delaunay, and elements that some rule still wants changed.
//! Orientation is exact: Shewchuk's adaptive predicate ("Adaptive precision floating-point
//! arithmetic and fast robust geometric predicates", 1997) from the `robust` crate. Distances are
//! those of [`distance`](super::distance), components those of `image_components` and
//! `mesh_components`, boundaries those of [`boundary_surface`](super::topology::boundary_surface),
//! and which component stands for which is told by [`matching`](super::topology::matching).
//!
//! Deterministic whatever the number of threads; parallel in the current rayon pool; safe from any
//! thread. Linear, but for the distances.

mod rows;

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use rayon::prelude::*;

use crate::image::LabelImage;
use crate::image::components::{ImageComponents, SLICE};
use crate::memory::zeroed;
use crate::mesh::TetMesh;
use crate::monitor::{Monitor, Step};
use crate::oracle::Oracle;
use crate::params::CertificateLevel;
use crate::verify::distance::{BothDistances, Distance, Distances, SurfaceDistance, VoxelFaces};
use crate::verify::off_walls::facets_off_walls;
use crate::verify::quality::Quality;
use crate::verify::topology::boundary_surface::BoundarySurfaces;
use crate::verify::topology::matching::{Fate, Matching};
use crate::verify::topology::mesh_components::MeshComponents;
use crate::{Error, Result};
use rows::Tables;

/// Tets per work item.
const CHUNK: usize = 1 << 12;

/// Components of the image with fewer voxels have no row of their own, and are not listed when they
/// are lost or merged.
pub const MIN_COMPONENT_VOXELS: u64 = 8;

/// Small components that are lost, together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SmallLost {
    /// How many.
    pub count: u64,
    /// Their voxels.
    pub voxels: u64,
    /// The label of the first one, and the world position of its first voxel.
    pub first: Option<(i32, [f64; 3])>,
}

/// What the finished mesh does not tell: what was counted on the triangulation. `None` is "not
/// counted".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Examined {
    /// Facets that are not locally Delaunay.
    pub non_delaunay_facets: Option<u64>,
    /// Elements that rules R1 to R6 still apply to.
    pub unmet: Option<[u64; 6]>,
}

/// How much of a certificate is to be measured.
#[derive(Clone, Copy)]
pub struct Extent<'a> {
    /// What.
    pub level: CertificateLevel,
    /// When the measuring of distances is to end, and the limit in seconds that this comes from.
    pub distances_until: Option<(Instant, f64)>,
    /// Told how many bytes distances need, before they are taken; an error ends the measuring.
    pub check_memory: &'a (dyn Fn(u64) -> Result<()> + Sync),
}

/// One label, in the mesh and in the image. Volumes are in cubic world units, distances in world
/// units, and `None` where they were not measured.
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
    /// Components in the image, of voxels joined with all 26 around them.
    pub components_image: u64,
    /// Components in the mesh, of tets joined where they share a facet, an edge or a vertex.
    pub components_mesh: u64,
    /// Components of the image, of at least [`MIN_COMPONENT_VOXELS`], in which no tet of the label
    /// lies.
    pub components_lost: u64,
    /// Components of the image, of at least [`MIN_COMPONENT_VOXELS`], that the mesh has joined to
    /// another one.
    pub components_merged: u64,
    /// Components of the mesh that are torn off from the one they belong to, or lie in none of the
    /// image.
    pub pieces: u64,
    /// Euler characteristic of the label's boundary in the image: twice that of the union of its
    /// closed voxels, so that voxels that meet in an edge or a corner are joined (26-connectivity,
    /// 6 for what is around).
    pub euler_image: i64,
    /// Euler characteristic of the label's boundary in the mesh: twice that of the union of its
    /// closed tets, so that tets that meet in an edge or a vertex are joined.
    pub euler_mesh: i64,
    /// Edges of the mesh at which more than two facets of the label's boundary meet.
    pub non_manifold_edges: u64,
    /// Vertices of the mesh, on no such edge, at which more than one sheet of the label's boundary
    /// meet.
    pub non_manifold_vertices: u64,
    /// From the label's boundary in the mesh to that in the image.
    pub mesh_to_image: Option<Distance>,
    /// From the label's boundary in the image to that in the mesh; infinite if the mesh lost it.
    pub image_to_mesh: Option<Distance>,
    /// From the label's boundary in the mesh to the smooth interfaces.
    pub mesh_to_surface: Option<Distance>,
    /// From the smooth interfaces around the label to its boundary in the mesh; infinite if the
    /// mesh lost it.
    pub surface_to_mesh: Option<Distance>,
}

/// One component of the image that has at least [`MIN_COMPONENT_VOXELS`], and what the mesh made of
/// it. Volumes are in cubic world units, distances in world units, and `None` where they were not
/// measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ComponentRow {
    /// Its label.
    pub label: i32,
    /// What became of it.
    pub fate: Fate,
    /// World position of the centre of its first voxel (x fastest).
    pub position: [f64; 3],
    /// Its voxels.
    pub image_voxels: u64,
    /// Voxels times the volume of a voxel.
    pub image_volume: f64,
    /// Tets of the label that lie in it.
    pub tets: u64,
    /// Sum of their volumes.
    pub mesh_volume: f64,
    /// Components of the mesh that belong to it; 1 where all is well, 0 where it is lost or merged.
    pub components_mesh: u64,
    /// Euler characteristic of its boundary: twice that of the union of its closed voxels.
    pub euler_image: i64,
    /// The same of the union of the closed tets of the components of the mesh that belong to it; 0
    /// if there are none.
    pub euler_mesh: i64,
    /// From the boundary of the components of the mesh that belong to it to that of its label in
    /// the image.
    pub mesh_to_image: Option<Distance>,
    /// From its boundary to that of its label in the mesh.
    pub image_to_mesh: Option<Distance>,
    /// From the boundary of the components of the mesh that belong to it to the smooth interfaces.
    pub mesh_to_surface: Option<Distance>,
    /// From the smooth interfaces around it to its label's boundary in the mesh.
    pub surface_to_mesh: Option<Distance>,
}

/// What is wrong with the topology of a label somewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DefectKind {
    /// A component of the image, of at least [`MIN_COMPONENT_VOXELS`], in which no tet of its label
    /// lies.
    Lost,
    /// A component of the image, of at least [`MIN_COMPONENT_VOXELS`], that the mesh has joined to
    /// another one of its label.
    Merged,
    /// A component of the mesh that is torn off from the one that stands for its component of the
    /// image.
    Torn,
    /// A component of the mesh that lies in no component of its label in the image.
    Stray,
    /// An edge of the mesh at which more than two facets of the label's boundary meet.
    NonManifoldEdge,
    /// A vertex of the mesh, on no such edge, at which more than one sheet of the label's boundary
    /// meet.
    NonManifoldVertex,
    /// A component of the image that was left out for its size, as asked.
    Dropped,
}

/// A place where the topology of a label in the mesh is not that of a solid, or not that of the
/// image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defect {
    /// What is wrong.
    pub kind: DefectKind,
    /// The label.
    pub label: i32,
    /// Where, in world coordinates: the centre of the component's first voxel, the centroid of its
    /// first tet, the middle of the edge, the vertex.
    pub position: [f64; 3],
    /// Voxels of the component of the image, tets of that of the mesh; 0 for a place.
    pub size: u64,
}

/// What holds for a finished mesh. Distances are in world units; divided by [`voxel`](Self::voxel)
/// they are in voxels. Those that were not measured are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Certificate {
    /// What was measured. With [`CertificateLevel::None`] nothing below means anything.
    pub level: CertificateLevel,
    /// Facets whose tets' circumspheres hold the opposite vertex; counted by the caller on the
    /// triangulation, or on a mesh that was not improved.
    pub non_delaunay_facets: Option<u64>,
    /// Tets, of any label, whose orientation is not positive by the exact predicate.
    pub inverted_tets: u64,
    /// Vertices in no tet.
    pub orphan_vertices: u64,
    /// Edges where the boundary of some label (0 included) is not closed: an odd number of its
    /// facets meet there.
    pub open_edges: u64,
    /// The components of the image of fewer than [`MIN_COMPONENT_VOXELS`] in which no tet of their
    /// label lies.
    pub small_lost: SmallLost,
    /// Outer facets that should lie on a wall, where the image cuts the object off, and do not.
    pub facets_off_walls: u64,
    /// From the mesh's interfaces to the faces between voxels of different label; the largest to
    /// within a hundredth of the smallest spacing.
    pub mesh_to_image: Option<Distance>,
    /// From those faces to the mesh's interfaces; infinite if the mesh has none.
    pub image_to_mesh: Option<Distance>,
    /// From the mesh's interfaces to the smooth ones, those of the oracle: of its samples, as
    /// `distance` tells.
    pub mesh_to_surface: Option<Distance>,
    /// From the smooth interfaces to those of the mesh; infinite if the mesh has none.
    pub surface_to_mesh: Option<Distance>,
    /// The smallest spacing of the image.
    pub voxel: f64,
    /// Elements that rules R1 to R6 still apply to, and that the spacing floor leaves as they are;
    /// counted by the caller. `None` where no triangulation was there to count on.
    pub unmet: Option<[u64; 6]>,
    /// Every label other than 0 that the image or the mesh holds, in increasing order.
    pub labels: Vec<LabelRow>,
    /// The components of the image that have at least [`MIN_COMPONENT_VOXELS`], in the order of
    /// their first voxels.
    pub components: Vec<ComponentRow>,
    /// Where the topology is at fault, by kind.
    pub defects: Vec<Defect>,
}

impl Certificate {
    /// What was counted on the triangulation.
    pub fn examined(&self) -> Examined {
        Examined { non_delaunay_facets: self.non_delaunay_facets, unmet: self.unmet }
    }

    /// Of a mesh that nothing is measured on.
    pub fn none() -> Self {
        Self { level: CertificateLevel::None, ..Self::default() }
    }

    /// The quality of `mesh`, and its certificate against the `image` it was made from (with the
    /// labels that were not to be meshed already set to 0), and the `oracle` made from that. Told
    /// besides: the limit that ended the measuring of distances. The certificate is
    /// [`Sound`](CertificateLevel::Sound) then.
    ///
    /// # Errors
    /// [`InvalidArgument`](crate::Error::InvalidArgument) when a vertex is not finite;
    /// [`OutOfMemory`](crate::Error::OutOfMemory); [`Cancelled`](crate::Error::Cancelled); a limit,
    /// before the distances.
    pub fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        oracle: &Oracle,
        Examined { non_delaunay_facets, unmet }: Examined,
        extent: Extent<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<(Quality, Self, Option<Error>)> {
        let [_, _, nz] = image.dims();
        let (quality, inverted_tets) = Quality::measure(mesh, monitor)?;
        // Tets are gone over three times, facets twice, vertices and slices of voxels once; these
        // count as some thousand tets each.
        monitor.enter(
            Step::Counts,
            3 * mesh.tets.len() + 2 * mesh.facets.len() + mesh.points.len() + SLICE * nz,
        )?;
        let orphan_vertices = orphan_vertices(mesh, monitor)?;
        let facets_off_walls = facets_off_walls(mesh, oracle, monitor)?.len() as u64;
        let image_components = ImageComponents::new(image, &|steps| monitor.advance(steps))?;
        let mut mesh_components = MeshComponents::new(mesh, image, &image_components, monitor)?;
        let surfaces = BoundarySurfaces::measure(mesh, &mut mesh_components, monitor)?;
        let mut ended_by = None;
        let distances = match extent.level {
            CertificateLevel::None | CertificateLevel::Sound => None,
            CertificateLevel::Full => {
                monitor.end_at(extent.distances_until);
                let of_all = Distances::measure(
                    mesh,
                    image,
                    &mesh_components,
                    &image_components,
                    oracle,
                    extent.check_memory,
                    monitor,
                );
                monitor.end_at(None);
                match of_all {
                    Err(limit) if limit.is_limit() => {
                        ended_by = Some(limit);
                        None
                    }
                    distances => Some(distances?),
                }
            }
        };
        let level =
            if distances.is_some() { CertificateLevel::Full } else { CertificateLevel::Sound };
        let whole = |both: fn(&BothDistances) -> SurfaceDistance| distances.as_ref().map(both);
        let to_faces = whole(|both| both.faces.whole);
        let to_surface = whole(|both| both.surface.whole);
        let tables = Tables {
            mesh,
            image,
            matching: Matching::new(
                &image_components.list,
                &mesh_components.list,
                &mesh_components.overlaps,
            )?,
            image_components: &image_components,
            mesh_components: &mesh_components,
            surfaces: &surfaces,
            distances: distances.as_ref(),
        };
        let certificate = Self {
            level,
            non_delaunay_facets,
            inverted_tets,
            orphan_vertices,
            open_edges: surfaces.open_edges,
            facets_off_walls,
            small_lost: tables.small_lost(),
            mesh_to_image: to_faces.map(|distance| distance.mesh_to_image),
            image_to_mesh: to_faces.map(|distance| distance.image_to_mesh),
            mesh_to_surface: to_surface.map(|distance| distance.mesh_to_image),
            surface_to_mesh: to_surface.map(|distance| distance.image_to_mesh),
            voxel: image.frame().spacing().min_element(),
            unmet,
            labels: tables.labels(),
            components: tables.components()?,
            defects: tables.defects(),
        };
        Ok((quality, certificate, ended_by))
    }

    /// Bytes that distances need for the voxels of `image`, beside what the mesh and the components
    /// need.
    pub fn bytes_needed(image: &LabelImage) -> u64 {
        VoxelFaces::bytes(image.dims())
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

/// Vertices that no tet has.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn orphan_vertices(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<u64> {
    let used: Vec<AtomicBool> = zeroed(mesh.vertex_count(), "vertices")?;
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
    Ok(used
        .par_chunks(CHUNK)
        .map(|used| used.iter().filter(|used| !used.load(Relaxed)).count() as u64)
        .sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Frame;
    use crate::mesh::{NONE, testing};
    use crate::params::SurfaceModel;

    fn oracle(image: &LabelImage) -> Oracle {
        Oracle::new(image, SurfaceModel::Smooth, &|| Ok(())).unwrap()
    }

    fn nested(i: usize, j: usize, k: usize) -> i32 {
        let edge = |x: usize| x == 0 || x == 3;
        if edge(i) || edge(j) || edge(k) { 5 } else { 900 }
    }

    fn nested_pair() -> (TetMesh, LabelImage) {
        let spacing = [1.0, 0.5, 2.0];
        let frame = Frame::new(
            [0.5, 0.25, 1.0],
            spacing,
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        )
        .unwrap();
        (testing::kuhn_box([4; 3], spacing, nested), testing::image([4; 3], frame, nested))
    }

    fn full(
        mesh: &TetMesh,
        image: &LabelImage,
        oracle: &Oracle,
        non_delaunay_facets: u64,
        unmet: [u64; 6],
    ) -> Certificate {
        let extent = Extent {
            level: CertificateLevel::Full,
            distances_until: None,
            check_memory: &|_| Ok(()),
        };
        let measured = Certificate::measure(
            mesh,
            image,
            oracle,
            Examined { non_delaunay_facets: Some(non_delaunay_facets), unmet: Some(unmet) },
            extent,
            &Monitor::silent(),
        );
        let (_, certificate, ended_by) = measured.unwrap();
        assert!(ended_by.is_none());
        certificate
    }

    #[test]
    fn a_perfect_mesh() {
        let (mesh, image) = nested_pair();
        // Its surface is the faces of the voxels; crossings are found to a thousandth of a voxel.
        let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
        let mut certificate = full(&mesh, &image, &oracle, 3, [1, 2, 3, 4, 5, 6]);
        let in_rows = certificate
            .labels
            .iter_mut()
            .flat_map(|row| [&mut row.mesh_to_surface, &mut row.surface_to_mesh]);
        for distance in
            in_rows.chain([&mut certificate.mesh_to_surface, &mut certificate.surface_to_mesh])
        {
            assert!(distance.unwrap().max < 2e-3, "{distance:?}");
            *distance = Some(Distance::default());
        }
        let zero = Some(Distance::default());
        let row = |label, voxels: u64| LabelRow {
            label,
            tets: 6 * voxels,
            mesh_volume: voxels as f64,
            image_volume: voxels as f64,
            image_voxels: voxels,
            components_image: 1,
            components_mesh: 1,
            euler_image: if label == 5 { 4 } else { 2 },
            euler_mesh: if label == 5 { 4 } else { 2 },
            mesh_to_image: zero,
            image_to_mesh: zero,
            mesh_to_surface: zero,
            surface_to_mesh: zero,
            ..LabelRow::default()
        };
        let expected = Certificate {
            non_delaunay_facets: Some(3),
            unmet: Some([1, 2, 3, 4, 5, 6]),
            voxel: 0.5,
            labels: vec![row(5, 56), row(900, 8)],
            level: CertificateLevel::Full,
            mesh_to_image: zero,
            image_to_mesh: zero,
            mesh_to_surface: zero,
            surface_to_mesh: zero,
            ..Certificate::default()
        };
        assert_eq!(certificate.labels.len(), 2);
        for (row, expected) in certificate.labels.iter().zip(&expected.labels) {
            assert!((row.mesh_volume - expected.mesh_volume).abs() < 1e-12);
            assert_eq!(LabelRow { mesh_volume: expected.mesh_volume, ..*row }, *expected);
        }
        let components = std::mem::take(&mut certificate.components);
        assert_eq!(
            Certificate { labels: expected.labels.clone(), ..certificate.clone() },
            expected
        );
        let rows: Vec<_> = components
            .iter()
            .map(|c| (c.label, c.fate, c.tets, c.euler_image, c.euler_mesh, c.components_mesh))
            .collect();
        assert_eq!(rows, [(5, Fate::Kept, 6 * 56, 4, 4, 1), (900, Fate::Kept, 6 * 8, 2, 2, 1)]);
        assert_eq!(components[1].position, [1.5, 0.75, 3.0]);
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
        let certificate = full(&mesh, &image, &oracle(&image), 0, [0; 6]);
        assert_eq!(
            (certificate.inverted_tets, certificate.orphan_vertices, certificate.open_edges),
            (2, 1, 3)
        );
    }

    #[test]
    fn a_tet_that_is_flat_but_for_rounding() {
        // d is off the plane of a, b, c by less than the rounding of the plain determinant.
        let tet = |z: f64| TetMesh {
            points: vec![[12.0, 12.0, 12.0], [24.0, 24.0, 24.0], [0.5, 12.5, 0.5], [0.25, 6.25, z]],
            tets: vec![[0, 1, 2, 3]],
            labels: vec![1],
            neighbors: vec![[NONE; 4]],
            ..TetMesh::default()
        };
        let counts = [0.25 - f64::EPSILON / 4.0, 0.25, 0.25 + f64::EPSILON / 4.0]
            .map(|z| Quality::measure(&tet(z), &Monitor::silent()).unwrap().1);
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
            pool.install(|| full(&mesh, &image, &oracle(&image), 0, [0; 6]))
        };
        let certificate = on(1);
        assert!(mesh.tets.len() > 4 * CHUNK && mesh.facets.len() > CHUNK);
        assert!(
            certificate.inverted_tets == 21
                && certificate.orphan_vertices == 1
                && certificate.open_edges > 10
        );
        assert_eq!(certificate, on(3));
    }

    #[test]
    fn labels_of_one_side_only_have_rows() {
        let image =
            testing::image([2, 1, 1], Frame::axis_aligned([1.0; 3]).unwrap(), |i, _, _| [1, 7][i]);
        let mesh = testing::kuhn_box([2, 1, 1], [1.0; 3], |i, _, _| [7, -3][i]);
        let rows = full(&mesh, &image, &oracle(&image), 0, [0; 6]).labels;
        assert_eq!(
            rows.iter().map(|r| (r.label, r.tets, r.image_voxels)).collect::<Vec<_>>(),
            [(-3, 6, 0), (1, 0, 1), (7, 6, 1)]
        );
        assert_eq!(
            (rows[0].mesh_to_image.unwrap().max, rows[1].image_to_mesh.unwrap().max),
            (f64::INFINITY, f64::INFINITY)
        );
    }

    #[test]
    fn what_is_lost_merged_torn_or_non_manifold_is_listed() {
        // Bars of eight voxels along y, 3 apart. In the mesh the second hangs on to the first, the
        // third is gone, the fourth is cut in two, and a piece of label 2, which the image does not
        // have there, floats beside; a bar of three voxels is gone, too, but is too small to be
        // listed.
        let bars = |i: usize, j: usize, k: usize| {
            let bar = [1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1][i];
            if k == 0 && (i < 13 || j < 3) { bar } else { 0 }
        };
        let meshed = |i: usize, j: usize, k: usize| match (i, j, k) {
            (1 | 2, 0, 0) => 1,
            (6 | 13, _, _) | (3, 7, 0) => 0,
            (9, 5, 0) => 0,
            (11, 4, 1) => 2,
            // Touches the first bar along an edge, and is in no voxel of the label.
            (1, 3, 1) => 1,
            _ => bars(i, j, k),
        };
        let dims = [14, 8, 2];
        let spacing = [1.0; 3];
        let mesh = testing::kuhn_box(dims, spacing, meshed);
        let image = testing::image(dims, testing::box_frame(spacing), bars);
        let certificate = full(&mesh, &image, &oracle(&image), 0, [0; 6]);
        let fates: Vec<_> = certificate
            .components
            .iter()
            .map(|c| (c.position[0], c.fate, c.components_mesh))
            .collect();
        assert_eq!(
            fates,
            [
                (0.5, Fate::Kept, 1),
                (3.5, Fate::Merged, 0),
                (6.5, Fate::Lost, 0),
                (9.5, Fate::Kept, 2)
            ]
        );
        let defects: Vec<_> =
            certificate.defects.iter().map(|d| (d.kind, d.label, d.size)).collect();
        let expected = [
            (DefectKind::Lost, 1, 8),
            (DefectKind::Merged, 1, 8),
            (DefectKind::Torn, 1, 12),
            (DefectKind::Stray, 2, 6),
            (DefectKind::NonManifoldEdge, 1, 0),
        ];
        assert_eq!(defects, expected);
        assert_eq!(certificate.defects[0].position, [6.5, 0.5, 0.5]);
        assert_eq!(certificate.defects[4].position, [1.0, 3.5, 1.0]);
        let row = &certificate.labels[0];
        assert_eq!((row.components_image, row.components_lost, row.components_merged), (5, 1, 1));
        assert_eq!(
            (row.components_mesh, row.pieces, row.non_manifold_edges, row.non_manifold_vertices),
            (3, 1, 1, 0)
        );
        // What touches along an edge is joined, what was cut in two is not.
        assert_eq!((row.euler_image, row.euler_mesh), (10, 6));
        // The lost bar is three voxels from what is left of its label on the one side, two and a
        // bit on the other.
        assert!(
            certificate.components[2].image_to_mesh.unwrap().max >= 2.0,
            "{:?}",
            certificate.components[2]
        );
    }
}
