//! Two-sided distance between the interfaces of a mesh and those of the image it was made from.
//!
//! The image's interfaces are the faces between voxels of different label (see `voxel_faces`), whatever surface model the mesh
//! was made with: a smooth mesh of a perfect image has a distance above 0. The measure follows Aspert, Santa-Cruz, Ebrahimi ("MESH: measuring errors between surfaces
//! using the Hausdorff distance", ICME 2002): one side is sampled densely, the distance of each sample to the other side is exact.
//!
//! - Mesh to image: each facet is cut into n x n similar triangles with edges of at most half the smallest spacing; samples are their vertices,
//!   weighted by area (the trapezoidal rule, exact for a linear distance). What lies between the samples can only raise the maximum where bounds permit it; there facets are cut
//!   further, until the maximum is known to a hundredth of the smallest spacing (`Facet::raise`).
//! - Image to mesh: the mean is over the centres of the voxel faces, weighted by area; the maximum is over centres and corners, and may miss the true one by at most the
//!   distance to the nearest of these.
//!
//! Labels are not compared: a facet between labels 1 and 2 may be nearest to a face between 1 and 3.
//!
//! Safe from any thread; parallel inside; sums are combined in a fixed order, so equal input gives equal bits. Linear in samples and faces, but for a logarithm.

use glam::DVec3;
use rayon::prelude::*;

use super::TetMesh;
use super::triangle_tree::TriangleTree;
use super::voxel_faces::{Face, VoxelFaces};
use crate::image::LabelImage;
use crate::memory::{room, zeroed};
use crate::monitor::{Monitor, Step};
use crate::{Error, Result};

/// Facets, and rows of voxel faces, per parallel work item; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 256;

/// Samples between two looks at the cancel flag: far from any interface one may take a millisecond.
const CHECK_EVERY: usize = 64;

/// The largest distance from the mesh may be farther by this part of the smallest spacing.
const TOLERANCE: f64 = 0.01;

/// One-sided distance in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distance {
    /// Area-weighted mean over the samples.
    pub mean: f64,
    /// The one-sided Hausdorff distance: from the mesh to a hundredth of the smallest spacing, from the image as a maximum over samples.
    pub max: f64,
}

/// Two-sided distance between interfaces. Where there are samples on one side and nothing on the other, mean and maximum are infinite;
/// where there are no samples they are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceDistance {
    /// From interface facets to the image.
    pub mesh_to_image: Distance,
    /// From faces of voxels to the mesh.
    pub image_to_mesh: Distance,
}

impl SurfaceDistance {
    /// Measures `mesh` against `image`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] when a vertex is not finite, [`Error::OutOfMemory`], [`Error::Cancelled`].
    pub fn measure(mesh: &TetMesh, image: &LabelImage, monitor: &Monitor<'_>) -> Result<Self> {
        if let Some(v) = mesh.points.par_iter().position_first(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(Error::InvalidArgument(format!("vertex {v} is not finite: {:?}", mesh.points[v])));
        }
        monitor.enter(Step::MeshToImage, mesh.facets.len())?;
        let faces = VoxelFaces::new(image, monitor)?;
        let frame = image.frame();
        let to_local = frame.direction().transpose();
        let local = |v: u32| to_local * (mesh.point(v) - frame.origin()) + 0.5 * frame.spacing();
        let mut triangles: Vec<[DVec3; 3]> = room(mesh.facets.len(), "triangles of the interfaces")?;
        for facets in mesh.facets.chunks(1 << 16) {
            monitor.advance(0)?;
            triangles.par_extend(facets.par_iter().map(|facet| facet.map(local)));
        }
        let mesh_to_image = mesh_to_image(&triangles, &faces, frame.spacing().min_element(), monitor)?;
        let [_, ny, nz] = faces.dims();
        monitor.enter(Step::ImageToMesh, ny * nz)?;
        let tree = TriangleTree::new(triangles, monitor)?;
        let image_to_mesh = image_to_mesh(&tree, &faces, monitor)?;
        Ok(Self { mesh_to_image, image_to_mesh })
    }
}

/// Weighted sum and maximum of distances.
#[derive(Clone, Copy, Default)]
struct Sum {
    weight: f64,
    weighted: f64,
    max: f64,
}

impl Sum {
    fn add(&mut self, weight: f64, distance: f64) {
        self.weight += weight;
        self.weighted += weight * distance;
        self.max = self.max.max(distance);
    }

    fn total(parts: Vec<Sum>) -> Distance {
        let all = parts.into_iter().fold(Sum::default(), |a, b| Sum {
            weight: a.weight + b.weight,
            weighted: a.weighted + b.weighted,
            max: a.max.max(b.max),
        });
        // Facets without area have no weight, but may have a maximum.
        Distance { mean: if all.weight > 0.0 { all.weighted / all.weight } else { all.max }, max: all.max }
    }
}

fn mesh_to_image(
    triangles: &[[DVec3; 3]],
    faces: &VoxelFaces,
    spacing: f64,
    monitor: &Monitor<'_>,
) -> Result<Distance> {
    let step = 0.5 * spacing;
    // No point of a triangle is farther than this; see `Facet::bound`.
    let mut bounds: Vec<f64> = zeroed(triangles.len(), "distances of facets")?;
    let parts = triangles.par_chunks(CHUNK).zip(bounds.par_chunks_mut(CHUNK)).map(|(triangles, bounds)| {
        let mut sum = Sum::default();
        let mut start = None;
        let mut samples = 0_usize;
        for (triangle, bound) in triangles.iter().zip(bounds) {
            let mut farthest = 0.0_f64;
            let edge = for_each_sample(triangle, step, |p, weight| {
                samples += 1;
                if samples.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                let found = faces.nearest(p, start);
                start = found.map(|(face, _)| face);
                let distance = found.map_or(f64::INFINITY, |(_, squared)| squared.sqrt());
                farthest = farthest.max(distance);
                sum.add(weight, distance);
                Ok(())
            })?;
            *bound = farthest + edge / 3.0_f64.sqrt();
        }
        monitor.advance(triangles.len())?;
        Ok(sum)
    });
    let sampled = Sum::total(parts.collect::<Result<_>>()?);
    if sampled.max.is_infinite() {
        return Ok(sampled);
    }
    let enough = sampled.max + TOLERANCE * spacing;
    // Each chunk starts from the maximum of the samples, not from what others have found, so that equal input gives equal bits.
    let raised = triangles.par_chunks(CHUNK).zip(bounds.par_chunks(CHUNK)).map(|(triangles, bounds)| {
        monitor.advance(0)?;
        let mut max = sampled.max;
        let mut start = None;
        for (triangle, _) in triangles.iter().zip(bounds).filter(|&(_, &bound)| bound > enough) {
            if let Some(facet) = Facet::new(triangle, faces, &mut start) {
                facet.raise(faces, TOLERANCE * spacing, &mut max, &mut || monitor.advance(0))?;
            }
        }
        Ok(max)
    });
    let max = raised.try_reduce(|| sampled.max, |a, b| Ok(a.max(b)))?;
    Ok(Distance { max, ..sampled })
}

/// A triangle, each corner with the voxel face nearest to it and that distance.
struct Facet([Corner; 3]);

#[derive(Clone, Copy)]
struct Corner {
    at: DVec3,
    face: Face,
    distance: f64,
}

impl Corner {
    fn new(at: DVec3, faces: &VoxelFaces, start: &mut Option<Face>) -> Option<Self> {
        let (face, squared) = faces.nearest(at, *start)?;
        *start = Some(face);
        Some(Self { at, face, distance: squared.sqrt() })
    }
}

impl Facet {
    /// `None` when there is no face.
    fn new(triangle: &[DVec3; 3], faces: &VoxelFaces, start: &mut Option<Face>) -> Option<Self> {
        let [a, b, c] = triangle.map(|at| Corner::new(at, faces, start));
        Some(Self([a?, b?, c?]))
    }

    /// Raises `max` to the largest distance from the triangle to the faces, if that is larger by more than `tolerance`: branch and bound.
    fn raise(
        &self,
        faces: &VoxelFaces,
        tolerance: f64,
        max: &mut f64,
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<()> {
        *max = self.0.iter().fold(*max, |max, corner| max.max(corner.distance));
        if self.bound(faces) <= *max + tolerance {
            return Ok(());
        }
        check()?;
        let [a, b, c] = self.0;
        let middle = |p: Corner, q: Corner| Corner::new(p.at.midpoint(q.at), faces, &mut Some(p.face));
        let (Some(ab), Some(bc), Some(ca)) = (middle(a, b), middle(b, c), middle(c, a)) else { return Ok(()) };
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            Self(part).raise(faces, tolerance, max, check)?;
        }
        Ok(())
    }

    /// No point of the triangle is farther than this. The distance to one face is convex, so largest at a corner. And a point x = sum(l_i p_i) is at most
    /// sum(l_i (d_i + |x - p_i|)) away, where sum(l_i |x - p_i|) is at most the radius of a circle around the triangle, which need not exceed the
    /// longest edge over the root of 3.
    fn bound(&self, faces: &VoxelFaces) -> f64 {
        let [a, b, c] = self.0.map(|corner| corner.at);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let farthest = self.0.iter().fold(0.0, |max: f64, corner| max.max(corner.distance));
        let to_one = |face: Face| self.0.iter().map(|p| faces.distance_squared(face, p.at)).fold(0.0, f64::max);
        let convex = self.0.iter().map(|p| to_one(p.face)).fold(f64::INFINITY, f64::min);
        (farthest + (longest / 3.0).sqrt()).min(convex.sqrt())
    }
}

/// Calls `sample` with the vertices of a subdivision of the triangle into n x n similar ones with edges of at most `step`, and with
/// the area each stands for. The areas sum up to that of the triangle. An error of `sample` ends the calls. Returns the longest edge of the similar triangles.
fn for_each_sample(
    &[a, b, c]: &[DVec3; 3],
    step: f64,
    mut sample: impl FnMut(DVec3, f64) -> Result<()>,
) -> Result<f64> {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt();
    let n = ((longest / step).ceil() as usize).max(1);
    let scale = 1.0 / n as f64;
    // Each small triangle gives a third of its area to each of its vertices: six meet inside, three on an edge, one in a corner.
    let third = (b - a).cross(c - a).length() * scale * scale / 6.0;
    for i in 0..=n {
        for j in 0..=n - i {
            let on_edges = usize::from(i == 0) + usize::from(j == 0) + usize::from(i + j == n);
            let weight = third * [6.0, 3.0, 1.0][on_edges.min(2)];
            sample(a + (b - a) * (i as f64 * scale) + (c - a) * (j as f64 * scale), weight)?;
        }
    }
    Ok(longest * scale)
}

fn image_to_mesh(tree: &TriangleTree, faces: &VoxelFaces, monitor: &Monitor<'_>) -> Result<Distance> {
    let [_, ny, nz] = faces.dims();
    let rows = ny * nz;
    let parts = (0..rows.div_ceil(CHUNK)).into_par_iter().map(|chunk| {
        let mut sum = Sum::default();
        let mut start = None;
        let mut samples = 0_usize;
        for row in chunk * CHUNK..((chunk + 1) * CHUNK).min(rows) {
            monitor.advance(1)?;
            for face in faces.row(row % ny, row / ny) {
                samples += 1;
                if samples.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                let Some(found) = tree.nearest(faces.centre(face), start) else {
                    return Ok(Sum { weight: 1.0, weighted: f64::INFINITY, max: f64::INFINITY });
                };
                let distance = found.distance_squared.sqrt();
                start = Some(found.slot);
                sum.add(faces.area(face), distance);
                if distance + faces.half_diagonal(face) <= sum.max {
                    continue;
                }
                for corner in faces.corners(face) {
                    // A corner with any triangle within the maximum so far cannot raise it.
                    if tree.distance_squared_to(found.slot, corner) > sum.max * sum.max
                        && let Some(nearest) = tree.nearest(corner, start)
                    {
                        sum.max = sum.max.max(nearest.distance_squared.sqrt());
                    }
                }
            }
        }
        Ok(sum)
    });
    Ok(Sum::total(parts.collect::<Result<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::super::triangle_tree::closest_point;
    use super::*;
    use crate::image::Frame;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{a} is not {b}");
    }

    /// An image and the mesh that reproduces its voxels exactly, both in the same turned and reflected frame.
    fn pair(label: impl Fn(usize, usize, usize) -> i32 + Copy) -> (TetMesh, LabelImage) {
        let (dims, spacing) = ([5, 4, 3], [0.5, 1.0, 2.0]);
        let direction = [[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [1.0, 0.0, 0.0]];
        let frame = Frame::new([10.0, -20.0, 30.0], spacing, direction).unwrap();
        let mut mesh = testing::kuhn_box(dims, [1.0; 3], label);
        for p in &mut mesh.points {
            *p = frame.to_world(DVec3::from_array(*p) - 0.5).to_array();
        }
        (mesh, testing::image(dims, frame, label))
    }

    fn two_labels(i: usize, j: usize, k: usize) -> i32 {
        if j == 0 && k == 0 { 0 } else { 1 + i32::from(i > 1) }
    }

    #[test]
    fn a_mesh_of_the_voxels_has_no_distance() {
        let (mesh, image) = pair(two_labels);
        let distance = SurfaceDistance::measure(&mesh, &image, &Monitor::silent()).unwrap();
        for side in [distance.mesh_to_image, distance.image_to_mesh] {
            assert!(side.max < 1e-12 && side.mean < 1e-12, "{distance:?}");
        }
    }

    #[test]
    fn a_shift_is_the_distance() {
        // A box shifted along its first axis: its two ends are 0.25 off, the sides do not notice but for the rim.
        let (mut mesh, image) = pair(|_, _, _| 1);
        for p in &mut mesh.points {
            *p = (DVec3::from_array(*p) + image.frame().direction().x_axis * 0.25).to_array();
        }
        let distance = SurfaceDistance::measure(&mesh, &image, &Monitor::silent()).unwrap();
        close(distance.mesh_to_image.max, 0.25);
        close(distance.image_to_mesh.max, 0.25);
        // The ends have area 2 * 24, the sides 2.5 * 20; of these only the samples on the rim (and none of the face centres) are off.
        close(distance.image_to_mesh.mean, 0.25 * 48.0 / 98.0);
        assert!(distance.mesh_to_image.mean > 0.25 * 48.0 / 98.0 && distance.mesh_to_image.mean < 0.25 * 60.0 / 98.0);
    }

    #[test]
    fn both_sides_against_brute_force() {
        let (mut mesh, image) = pair(|i, j, k| ((i * 7 + j * 5 + k * 3) % 4) as i32);
        for (v, p) in mesh.points.iter_mut().enumerate() {
            *p = p.map(|x| x + 0.4 * ((v * 37 % 11) as f64 / 11.0 - 0.5));
        }
        let measured = SurfaceDistance::measure(&mesh, &image, &Monitor::silent()).unwrap();

        let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
        let [_, ny, nz] = faces.dims();
        let all: Vec<_> = (0..ny * nz).flat_map(|row| faces.row(row % ny, row / ny)).collect();
        let frame = image.frame();
        let triangles: Vec<[DVec3; 3]> =
            mesh.facets.iter().map(|f| f.map(|v| (frame.to_index(mesh.point(v)) + 0.5) * frame.spacing())).collect();
        let sampled = |step: f64| {
            let mut sum = Sum::default();
            for triangle in &triangles {
                for_each_sample(triangle, step, |p, weight| {
                    let squared = all.iter().map(|&f| faces.distance_squared(f, p)).fold(f64::INFINITY, f64::min);
                    sum.add(weight, squared.sqrt());
                    Ok(())
                })
                .unwrap();
            }
            sum
        };
        let (there, finely) = (sampled(0.25), sampled(0.02));
        let to_mesh =
            |p: DVec3| triangles.iter().map(|t| p.distance(closest_point(t, p))).fold(f64::INFINITY, f64::min);
        let mut back = Sum::default();
        for &face in &all {
            back.add(faces.area(face), to_mesh(faces.centre(face)));
            for corner in faces.corners(face) {
                back.max = back.max.max(to_mesh(corner));
            }
        }
        let (there, back) = (Sum::total(vec![there]), Sum::total(vec![back]));
        close(measured.mesh_to_image.mean, there.mean);
        // Fine samples find no more than the tolerance allows, and miss no more than lies between them.
        let tolerance = TOLERANCE * 0.5;
        assert!(finely.max <= measured.mesh_to_image.max + tolerance, "{} {}", finely.max, measured.mesh_to_image.max);
        assert!(measured.mesh_to_image.max <= finely.max + 0.02, "{} {}", finely.max, measured.mesh_to_image.max);
        assert!(finely.max > there.max + tolerance, "the test's samples would have done");
        close(measured.image_to_mesh.mean, back.mean);
        close(measured.image_to_mesh.max, back.max);
        assert!(there.max > 0.1 && back.max > 0.1);
    }

    #[test]
    fn equal_bits_on_any_number_of_threads() {
        let dims = [14, 12, 11];
        let label = |i: usize, j: usize, k: usize| ((i / 2 + j / 3 * k) % 3) as i32;
        let frame = Frame::new([3.0, 2.0, 1.0], [0.5, 1.0, 0.8], [[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [1.0, 0.0, 0.0]]);
        let image = testing::image(dims, frame.unwrap(), label);
        let mut mesh = testing::kuhn_box(dims, [1.0; 3], label);
        for (v, p) in mesh.points.iter_mut().enumerate() {
            let index = DVec3::from_array(*p) - 0.5 + 0.4 * ((v * 37 % 101) as f64 / 101.0 - 0.5);
            *p = image.frame().to_world(index).to_array();
        }
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| SurfaceDistance::measure(&mesh, &image, &Monitor::silent()).unwrap())
        };
        assert!(mesh.facets.len() > 5 * CHUNK);
        let measured = on(1);
        assert!(measured.mesh_to_image.max > 0.1 && measured.image_to_mesh.max > 0.1);
        assert_eq!(measured, on(3));
    }

    #[test]
    fn samples_cover_the_triangle() {
        let triangle = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(1.0, 2.0, 0.0)];
        let (mut area, mut moment, mut count) = (0.0, DVec3::ZERO, 0);
        for_each_sample(&triangle, 0.3, |p, weight| {
            area += weight;
            moment += p * weight;
            count += 1;
            Ok(())
        })
        .unwrap();
        assert_eq!(count, 11 * 12 / 2);
        close(area, 3.0);
        assert!((moment / area).distance(DVec3::new(4.0, 2.0, 0.0) / 3.0) < 1e-12);
    }

    #[test]
    fn a_missing_side_is_infinitely_far() {
        let (mesh, image) = pair(|_, _, _| 1);
        let measured = SurfaceDistance::measure(&TetMesh::default(), &image, &Monitor::silent()).unwrap();
        assert_eq!(measured.mesh_to_image, Distance::default());
        assert_eq!(measured.image_to_mesh, Distance { mean: f64::INFINITY, max: f64::INFINITY });
        let (_, empty) = pair(|_, _, _| 0);
        let measured = SurfaceDistance::measure(&mesh, &empty, &Monitor::silent()).unwrap();
        assert_eq!(measured.mesh_to_image.max, f64::INFINITY);
        assert_eq!(measured.image_to_mesh, Distance::default());
    }

    #[test]
    fn bad_vertices_and_cancellation_are_errors() {
        let (mut mesh, image) = pair(|_, _, _| 1);
        let flag = crate::monitor::CancelFlag::default();
        flag.cancel();
        let cancelled = SurfaceDistance::measure(&mesh, &image, &Monitor::new(None, Some(&flag)));
        assert!(matches!(cancelled, Err(Error::Cancelled)));
        mesh.points[3][1] = f64::NAN;
        let message = SurfaceDistance::measure(&mesh, &image, &Monitor::silent()).unwrap_err().to_string();
        assert!(message.starts_with("vertex 3 is not finite"), "{message}");
    }
}
