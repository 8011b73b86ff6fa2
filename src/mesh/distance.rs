//! Two-sided distance between the interfaces of a mesh and those of the image it was made from.
//!
//! The image's interfaces are the faces between voxels of different label (see `voxel_faces`), whatever surface model the mesh
//! was made with: a smooth mesh of a perfect image has a distance above 0. The measure follows Aspert, Santa-Cruz, Ebrahimi ("MESH: measuring errors between surfaces
//! using the Hausdorff distance", ICME 2002): one side is sampled densely, the distance of each sample to the other side is exact.
//!
//! - Mesh to image: each facet is cut into n x n similar triangles with edges of at most half the smallest spacing; samples are their centroids,
//!   weighted by area (the midpoint rule, exact for a linear distance). What lies between the samples can only raise the maximum where bounds permit it; there facets are cut
//!   further, until the maximum is known to a hundredth of the smallest spacing (`Facet::raise`).
//! - Image to mesh: the mean is over the centres of the voxel faces, weighted by area; the maximum is over centres and corners, and may miss the true one by at most the
//!   distance to the nearest of these.
//!
//! Over the whole, labels are not compared: a facet between labels 1 and 2 may be nearest to a face between 1 and 3. For a component they are: its boundary, a part of its
//! label's, is held against the boundary of that label alone, so that a component that is lost is as far away as the next part of its label. Mostly the nearest of
//! all is of the label; otherwise it is searched for. The largest distance of a mesh's component is that of its samples, not refined further.
//!
//! Safe from any thread; parallel inside; sums are combined in a fixed order, so equal input gives equal bits. Linear in samples and faces, but for a logarithm.

use std::ops::AddAssign;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::TetMesh;
use super::image_components::ImageComponents;
use super::ledger::{Ledger, Sums};
use super::mesh_components::MeshComponents;
use super::triangle_tree::{Triangle, TriangleTree};
use super::voxel_faces::{Face, VoxelFaces};
use crate::image::LabelImage;
use crate::memory::{room, zeroed};
use crate::monitor::{Monitor, Step};
use crate::{Error, Result};

/// Facets, and rows of voxel faces, per parallel work item; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 256;

/// Samples between two looks at the cancel flag: far from any interface one may take a millisecond.
const CHECK_EVERY: usize = 64;

/// Facets whose triangles are made between two looks at the cancel flag.
const FILL: usize = 1 << 16;

/// Longest edge of the parts of a facet, in smallest spacings. Facets have their corners where edges of the grid are crossed, near voxel faces, and their middles elsewhere: with one
/// sample for most facets the mean is 12 % too large.
const PART: f64 = 0.5;

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

/// Distances over the whole, and for each component.
pub(super) struct Distances {
    /// Between all interfaces.
    pub whole: SurfaceDistance,
    /// From the boundary of each component of the mesh.
    pub of_mesh: Vec<Sum>,
    /// From the boundary of each component of the image.
    pub of_image: Vec<Sum>,
}

impl Distances {
    /// Measures `mesh` against `image`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] when a vertex is not finite, [`Error::OutOfMemory`], [`Error::Cancelled`].
    pub fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        mesh_components: &MeshComponents,
        image_components: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        if let Some(v) = mesh.points.par_iter().position_first(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(Error::InvalidArgument(format!("vertex {v} is not finite: {:?}", mesh.points[v])));
        }
        monitor.enter(Step::MeshToImage, mesh.facets.len())?;
        let faces = VoxelFaces::new(image, monitor)?;
        let frame = image.frame();
        let to_local = frame.direction().transpose();
        let local = |v: u32| to_local * (mesh.point(v) - frame.origin()) + 0.5 * frame.spacing();
        // A label that the image does not have is on no face; nor is any sought there.
        let id_of = |label: i32| image.id_of(label).unwrap_or(0);
        let mut triangles: Vec<Triangle> = room(mesh.facets.len(), "triangles of the interfaces")?;
        for chunk in (0..mesh.facets.len()).step_by(FILL) {
            monitor.advance(0)?;
            let facets = chunk..(chunk + FILL).min(mesh.facets.len());
            triangles.par_extend(
                facets
                    .into_par_iter()
                    .map(|f| Triangle { corners: mesh.facets[f].map(local), ids: mesh.facet_labels[f].map(id_of) }),
            );
        }
        let (mesh_to_image, sums) = mesh_to_image(&triangles, mesh, mesh_components, &faces, monitor)?;
        let of_mesh = spread(sums, mesh_components.list.len());
        let [_, ny, nz] = faces.dims();
        monitor.enter(Step::ImageToMesh, ny * nz)?;
        let tree = TriangleTree::new(triangles, monitor)?;
        let (image_to_mesh, of_image) = image_to_mesh(&tree, &faces, image_components, monitor)?;
        Ok(Self { whole: SurfaceDistance { mesh_to_image, image_to_mesh }, of_mesh, of_image })
    }
}

/// Weighted sum and maximum of distances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sum {
    weight: f64,
    weighted: f64,
    max: f64,
}

impl Sum {
    fn of(weight: f64, distance: f64) -> Self {
        Self { weight, weighted: weight * distance, max: distance }
    }

    /// Mean and maximum; 0 of nothing.
    pub fn distance(&self) -> Distance {
        // Facets without area have no weight, but may have a maximum.
        Distance { mean: if self.weight > 0.0 { self.weighted / self.weight } else { self.max }, max: self.max }
    }
}

impl AddAssign for Sum {
    fn add_assign(&mut self, other: Self) {
        self.weight += other.weight;
        self.weighted += other.weighted;
        self.max = self.max.max(other.max);
    }
}

impl std::iter::Sum for Sum {
    fn sum<I: Iterator<Item = Self>>(sums: I) -> Self {
        sums.fold(Self::default(), |mut all, sum| {
            all += sum;
            all
        })
    }
}

/// Sums by component, 0 for those that have none.
fn spread(sums: Sums<Sum>, components: usize) -> Vec<Sum> {
    let mut spread = vec![Sum::default(); components];
    sums.into_iter().for_each(|(component, sum)| spread[component as usize] = sum);
    spread
}

/// A maximum that any number of threads may raise. What it ends with depends on none of them.
#[derive(Default)]
struct Max(AtomicU64);

impl Max {
    fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Relaxed))
    }

    /// `value` is not negative: then bits are ordered as numbers are.
    fn raise(&self, value: f64) {
        if value > self.get() {
            self.0.fetch_max(value.to_bits(), Relaxed);
        }
    }
}

/// A side of an interface facet or of a voxel face: component, the id of its label, and what was last found to be nearest of that label.
struct Side<T> {
    component: u64,
    id: u16,
    last: Option<T>,
}

/// Distances from the mesh to the image: over the whole, and the sums of each component that has any facets.
fn mesh_to_image(
    triangles: &[Triangle],
    mesh: &TetMesh,
    components: &MeshComponents,
    faces: &VoxelFaces<'_>,
    monitor: &Monitor<'_>,
) -> Result<(Distance, Sums<Sum>)> {
    let spacing = faces.smallest_spacing();
    // No point of a triangle is farther than this.
    let mut bounds: Vec<f64> = zeroed(triangles.len(), "distances of facets")?;
    let chunks = triangles.par_chunks(CHUNK).zip(bounds.par_chunks_mut(CHUNK)).enumerate();
    let parts = chunks.map(|(chunk, (triangles, bounds))| {
        let mut whole = Sum::default();
        let mut ledger = Ledger::default();
        let mut start = None;
        let mut samples = 0_usize;
        let mut sides: [Option<Side<Face>>; 2] = [None, None];
        for ((triangle, bound), f) in triangles.iter().zip(bounds).zip(chunk * CHUNK..) {
            for (side, (t, &id)) in sides.iter_mut().zip(mesh.facet_tets[f].into_iter().zip(&triangle.ids)) {
                let last = side.take().filter(|side| side.id == id).and_then(|side| side.last);
                *side = components.of(t).map(|component| Side { component: component.into(), id, last });
            }
            let mut of_sides = [Sum::default(); 2];
            *bound = 0.0;
            for_each_sample(&triangle.corners, PART * spacing, |part, weight| {
                let p = (part[0] + part[1] + part[2]) / 3.0;
                samples += 1;
                if samples.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                let found = faces.nearest(p, start);
                start = found.map(|(face, _)| face);
                let distance = found.map_or(f64::INFINITY, |(_, squared)| squared.sqrt());
                whole += Sum::of(weight, distance);
                *bound = bound.max(bound_of_part(&part, p, distance, faces, found, whole.max));
                for (side, sum) in sides.iter_mut().zip(&mut of_sides) {
                    let Some(side) = side else { continue };
                    let own = match found.filter(|&(face, _)| faces.touches(face, side.id)) {
                        _ if side.id == 0 => None,
                        None => faces.nearest_of(side.id, p, side.last),
                        found => found,
                    };
                    side.last = own.map(|(face, _)| face);
                    *sum += Sum::of(weight, own.map_or(f64::INFINITY, |(_, squared)| squared.sqrt()));
                }
                Ok(())
            })?;
            for (side, sum) in sides.iter().zip(of_sides) {
                if let Some(side) = side {
                    ledger.add(side.component, sum);
                }
            }
        }
        monitor.advance(triangles.len())?;
        Ok((whole, ledger.sums()))
    });
    let (wholes, sums): (Vec<Sum>, Vec<Sums<Sum>>) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let sums = Ledger::total(sums);
    let sampled = wholes.into_iter().sum::<Sum>().distance();
    if sampled.max.is_infinite() {
        return Ok((sampled, sums));
    }
    let enough = sampled.max + TOLERANCE * spacing;
    // Each chunk starts from the maximum of the samples, not from what others have found, so that equal input gives equal bits.
    let raised = triangles.par_chunks(CHUNK).zip(bounds.par_chunks(CHUNK)).map(|(triangles, bounds)| {
        monitor.advance(0)?;
        let mut max = sampled.max;
        let mut start = None;
        for (triangle, _) in triangles.iter().zip(bounds).filter(|&(_, &bound)| bound > enough) {
            if let Some(facet) = Facet::new(&triangle.corners, faces, &mut start) {
                facet.raise(faces, TOLERANCE * spacing, &mut max, &mut || monitor.advance(0))?;
            }
        }
        Ok(max)
    });
    let max = raised.try_reduce(|| sampled.max, |a, b| Ok(a.max(b)))?;
    Ok((Distance { max, ..sampled }, sums))
}

/// No point of the triangle `part` is farther from the faces than this. Its centroid `p` is `distance` away from the face that was `found`; what is not beyond `max` is not
/// made out more closely.
fn bound_of_part(
    part: &[DVec3; 3],
    p: DVec3,
    distance: f64,
    faces: &VoxelFaces<'_>,
    found: Option<(Face, f64)>,
    max: f64,
) -> f64 {
    let radius = part.iter().map(|corner| corner.distance_squared(p)).fold(0.0, f64::max).sqrt();
    let bound = distance + radius;
    match found {
        // The distance to one face is convex, so largest at a corner.
        Some((face, _)) if bound > max => {
            let convex = part.iter().map(|&corner| faces.distance_squared(face, corner)).fold(0.0, f64::max);
            bound.min(convex.sqrt())
        }
        _ => bound,
    }
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
    fn new(at: DVec3, faces: &VoxelFaces<'_>, start: &mut Option<Face>) -> Option<Self> {
        let (face, squared) = faces.nearest(at, *start)?;
        *start = Some(face);
        Some(Self { at, face, distance: squared.sqrt() })
    }
}

impl Facet {
    /// `None` when there is no face.
    fn new(triangle: &[DVec3; 3], faces: &VoxelFaces<'_>, start: &mut Option<Face>) -> Option<Self> {
        let [a, b, c] = triangle.map(|at| Corner::new(at, faces, start));
        Some(Self([a?, b?, c?]))
    }

    /// Raises `max` to the largest distance from the triangle to the faces, if that is larger by more than `tolerance`: branch and bound.
    fn raise(
        &self,
        faces: &VoxelFaces<'_>,
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
    fn bound(&self, faces: &VoxelFaces<'_>) -> f64 {
        let [a, b, c] = self.0.map(|corner| corner.at);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let farthest = self.0.iter().fold(0.0, |max: f64, corner| max.max(corner.distance));
        let to_one = |face: Face| self.0.iter().map(|p| faces.distance_squared(face, p.at)).fold(0.0, f64::max);
        let convex = self.0.iter().map(|p| to_one(p.face)).fold(f64::INFINITY, f64::min);
        (farthest + (longest / 3.0).sqrt()).min(convex.sqrt())
    }
}

/// Calls `sample` with the parts of a subdivision of the triangle into n x n similar ones with edges of at most `step`, and with the area of each. An error of
/// `sample` ends the calls.
fn for_each_sample(
    &[a, b, c]: &[DVec3; 3],
    step: f64,
    mut sample: impl FnMut([DVec3; 3], f64) -> Result<()>,
) -> Result<()> {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt();
    let n = ((longest / step).ceil() as usize).max(1);
    let scale = 1.0 / n as f64;
    let area = (b - a).cross(c - a).length() * 0.5 * scale * scale;
    let (u, v) = ((b - a) * scale, (c - a) * scale);
    for i in 0..n {
        for j in 0..n - i {
            // One triangle like the whole, and one upside down, which the last of a row lacks.
            let corner = a + u * i as f64 + v * j as f64;
            sample([corner, corner + u, corner + v], area)?;
            if i + j + 1 < n {
                sample([corner + u + v, corner + v, corner + u], area)?;
            }
        }
    }
    Ok(())
}

/// Distances from the image to the mesh: over the whole, and the sums of each component.
fn image_to_mesh(
    tree: &TriangleTree,
    faces: &VoxelFaces<'_>,
    components: &ImageComponents,
    monitor: &Monitor<'_>,
) -> Result<(Distance, Vec<Sum>)> {
    let [_, ny, nz] = faces.dims();
    let rows = ny * nz;
    // What is no farther than the maximum that any thread knows need not be looked at.
    let max = Max::default();
    let maxima: Vec<Max> = (0..components.list.len()).map(|_| Max::default()).collect();
    let parts = (0..rows.div_ceil(CHUNK)).into_par_iter().map(|chunk| {
        let mut whole = Sum::default();
        let mut ledger = Ledger::default();
        let mut start = None;
        let mut samples = 0_usize;
        let mut sides: [Option<Side<usize>>; 2] = [None, None];
        for row in chunk * CHUNK..((chunk + 1) * CHUNK).min(rows) {
            monitor.advance(1)?;
            for face in faces.row(row % ny, row / ny) {
                samples += 1;
                if samples.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                let (centre, area) = (faces.centre(face), faces.area(face));
                let found = tree.nearest(centre, start);
                start = found.map(|found| found.slot);
                let distance = found.map_or(f64::INFINITY, |found| found.distance_squared.sqrt());
                whole += Sum::of(area, distance);
                max.raise(distance);
                let mut corners = Corners::of(face, faces);
                if let Some(slot) = start {
                    corners.look_at(slot, distance, tree, None, &max);
                }
                for (side, voxel) in sides.iter_mut().zip(faces.voxels(face)) {
                    let component = voxel.and_then(|voxel| components.at(voxel));
                    let id = component.map_or(0, |component| components.list[component as usize].id);
                    let last = side.take().filter(|side| side.id == id).and_then(|side| side.last);
                    *side = component.map(|component| Side { component: component.into(), id, last });
                    let Some(side) = side else { continue };
                    let max = &maxima[side.component as usize];
                    let own = match found.filter(|found| tree.touches(found.slot, id)) {
                        None => tree.nearest_of(id, centre, side.last),
                        found => found,
                    };
                    side.last = own.map(|found| found.slot);
                    let distance = own.map_or(f64::INFINITY, |found| found.distance_squared.sqrt());
                    ledger.add(side.component, Sum::of(area, distance));
                    max.raise(distance);
                    if let Some(slot) = side.last {
                        corners.look_at(slot, distance, tree, Some(id), max);
                    }
                }
            }
        }
        Ok((whole, ledger.sums()))
    });
    let (wholes, sums): (Vec<Sum>, Vec<Sums<Sum>>) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let whole = Sum { max: max.get(), ..wholes.into_iter().sum() };
    let mut of_components = spread(Ledger::total(sums), components.list.len());
    of_components.iter_mut().zip(&maxima).for_each(|(sum, max)| sum.max = max.get());
    Ok((whole.distance(), of_components))
}

/// The corners of a voxel face.
struct Corners {
    at: [DVec3; 4],
    half_diagonal: f64,
    /// A triangle, and the distances of the corners from it.
    known: Option<(usize, [f64; 4])>,
}

impl Corners {
    fn of(face: Face, faces: &VoxelFaces<'_>) -> Self {
        Self { at: faces.corners(face), half_diagonal: faces.half_diagonal(face), known: None }
    }

    /// Raises `max` to the largest distance from a corner to the triangles, or to those of label `id`. The triangle in `slot` is one of them, and the centre is
    /// no farther from it than `distance`.
    fn look_at(&mut self, slot: usize, distance: f64, tree: &TriangleTree, id: Option<u16>, max: &Max) {
        // A corner with any triangle within the maximum so far cannot raise it. The margin keeps rounding from deciding.
        if distance + self.half_diagonal <= max.get() * (1.0 - 1e-12) {
            return;
        }
        let bounds = match self.known {
            Some((known, bounds)) if known == slot => bounds,
            _ => self.at.map(|corner| tree.distance_squared_to(slot, corner).sqrt()),
        };
        self.known = Some((slot, bounds));
        for (corner, bound) in self.at.into_iter().zip(bounds) {
            if bound > max.get() {
                let nearest = match id {
                    None => tree.nearest(corner, Some(slot)),
                    Some(id) => tree.nearest_of(id, corner, Some(slot)),
                };
                if let Some(nearest) = nearest {
                    max.raise(nearest.distance_squared.sqrt());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
