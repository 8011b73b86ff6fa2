//! Two-sided distance between the interfaces of a mesh and those of the image it was made from.
//!
//! The image's interfaces are the faces between voxels of different label (see `voxel_faces`),
//! whatever surface model the mesh was made with: a smooth mesh of a perfect image has a distance
//! above 0. The measure follows Aspert, Santa-Cruz, Ebrahimi ("MESH: measuring errors between
//! surfaces using the Hausdorff distance", ICME 2002): one side is sampled densely, the distance of
//! each sample to the other side is exact.
//!
//! - Mesh to image: each facet is cut into n x n similar triangles; samples are their centroids, no
//!   more than 0.34 smallest spacings from any point of the facet (a 64th of the facet's radius,
//!   where that is more), weighted by area (the midpoint rule, exact for a linear distance). What
//!   lies between the samples can only raise the maximum where bounds permit it; there facets are
//!   cut further, until the maximum is known to a hundredth of the smallest spacing (`Search`).
//! - Image to mesh: the mean is over the centres of the voxel faces, weighted by area; the maximum
//!   is over centres and corners, and may miss the true one by at most the distance to the nearest
//!   of these.
//!
//! Over the whole, labels are not compared: a facet between labels 1 and 2 may be nearest to a face
//! between 1 and 3. For a component they are: its boundary, a part of its label's, is held against
//! the boundary of that label alone, so that a component that is lost is as far away as the next
//! part of its label. Mostly the nearest of all is of the label; otherwise it is searched for. The
//! largest distance of a mesh's component is that of its samples, not refined further.
//!
//! The distances to dO, the surface of the oracle, are for its samples, not for all its points:
//!
//! - Mesh to dO: from the centroid of each facet, where it is as a rule farthest, along the facet's
//!   normal to where the label changes: towards the side whose label the centroid does not have,
//!   and where that is more than half a voxel away, the other way, too, and then in directions
//!   about the facet's plane. That is no less than the distance. It is looked for up to two largest
//!   spacings away; what is farther counts as that far.
//! - dO to mesh: from the points where dO crosses the edges between voxel centres, one for each
//!   voxel face, weighted by its area. The maximum over them is exact; in the mean counts the
//!   distance to the triangle that is nearest to the centre of the voxel face: no less than the
//!   distance, and mostly equal.
//!
//! Safe from any thread; parallel inside; sums are combined in a fixed order, so equal input gives
//! equal bits. Linear in samples and faces where mesh and image are near each other.

mod from_image;
mod from_mesh;
mod grid_corners;
mod points;
mod to_surface;
mod triangle_bins;
mod voxel_faces;

use std::ops::AddAssign;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::memory::{filled, room};
use crate::mesh::TetMesh;
use crate::monitor::{Monitor, Step};
use crate::oracle::Oracle;
use crate::reduce::NO_SET;
use crate::reduce::Sums;
use crate::verify::topology::mesh_components::MeshComponents;
use crate::{Error, Result};
use triangle_bins::{Triangle, TriangleBins};
pub(crate) use voxel_faces::VoxelFaces;

/// Facets, and rows of voxel faces, per parallel work item; fixed, so that sums do not depend on
/// the number of threads.
const CHUNK: usize = 256;

/// Samples between two looks at the cancel flag: far from any interface one may take a millisecond.
const CHECK_EVERY: usize = 64;

/// Facets whose triangles are made between two looks at the cancel flag.
const FILL: usize = 1 << 16;

/// How far a point of a facet may be from a sample, in smallest spacings. Facets have their corners
/// where edges of the grid are crossed, near voxel faces, and their middles elsewhere: with one
/// sample for most facets the mean is 12 % too large, with this distance less than a per cent.
const PART: f64 = 0.34;

/// A facet is cut into no more than the square of this many triangles: else slices a thousand times
/// as thick as pixels would need millions for each. Facets of up to 20 smallest spacings have all
/// that they need.
const MAX_ALONG: usize = 64;

/// The largest distance from the mesh may be farther by this part of the smallest spacing.
const TOLERANCE: f64 = 0.01;

/// How far from a triangle, in smallest spacings, it is shown to the faces of voxels: most have one
/// within half a voxel.
const REACH: f64 = 0.5;

/// One-sided distance in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distance {
    /// Area-weighted mean over the samples.
    pub mean: f64,
    /// The one-sided Hausdorff distance: from the mesh to a hundredth of the smallest spacing, from
    /// the image as a maximum over samples.
    pub max: f64,
}

/// Two-sided distance between interfaces. Where there are samples on one side and nothing on the
/// other, mean and maximum are infinite; where there are no samples they are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceDistance {
    /// From interface facets to the image: to the faces of voxels, or to dO.
    pub mesh_to_image: Distance,
    /// From the image to the mesh.
    pub image_to_mesh: Distance,
}

/// Distances over the whole, and for each component.
#[derive(Default)]
pub(crate) struct Distances {
    /// Between all interfaces.
    pub whole: SurfaceDistance,
    /// From the boundary of each component of the mesh.
    pub of_mesh: Vec<Sum>,
    /// From the boundary of each component of the image.
    pub of_image: Vec<Sum>,
}

/// Distances to the faces of voxels, and to the smooth interfaces.
pub(crate) struct BothDistances {
    /// Between the mesh and the faces of voxels.
    pub faces: Distances,
    /// Between the mesh and dO.
    pub surface: Distances,
}

impl Distances {
    /// Measures `mesh` against `image`, and against the surface of the `oracle` that was made from
    /// it. `check_memory` is told how many bytes are needed before they are taken.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] when a vertex is not finite, [`Error::OutOfMemory`],
    /// [`Error::Cancelled`]; those of `check_memory`.
    pub fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        mesh_components: &MeshComponents,
        image_components: &ImageComponents,
        oracle: &Oracle,
        check_memory: &(dyn Fn(u64) -> Result<()> + Sync),
        monitor: &Monitor<'_>,
    ) -> Result<BothDistances> {
        if let Some(v) = mesh.points.par_iter().position_first(|p| p.iter().any(|x| !x.is_finite()))
        {
            return Err(Error::InvalidArgument(format!(
                "vertex {v} is not finite: {:?}",
                mesh.points[v]
            )));
        }
        let of_faces = VoxelFaces::bytes(image.dims());
        let of_triangles = TriangleBins::bytes(mesh.facets.len());
        check_memory(of_faces + of_triangles)?;
        monitor.enter(Step::MeshToImage, mesh.facets.len())?;
        let faces = VoxelFaces::new(image, monitor)?;
        let frame = image.frame();
        let to_local = frame.direction().transpose();
        let local = |v: u32| to_local * (mesh.point(v) - frame.origin()) + 0.5 * frame.spacing();
        let to_world = |p: DVec3| frame.direction() * (p - 0.5 * frame.spacing()) + frame.origin();
        // A label that the image does not have is on no face; nor is any sought there.
        let id_of = |label: i32| image.id_of(label).unwrap_or(0);
        let mut triangles: Vec<Triangle> = room(mesh.facets.len(), "triangles of the interfaces")?;
        for chunk in (0..mesh.facets.len()).step_by(FILL) {
            monitor.advance(0)?;
            let facets = chunk..(chunk + FILL).min(mesh.facets.len());
            triangles.par_extend(facets.into_par_iter().map(|f| Triangle {
                corners: mesh.facets[f].map(local),
                ids: mesh.facet_labels[f].map(id_of),
                components: mesh.facet_tets[f].map(|t| mesh_components.of(t).unwrap_or(NO_SET)),
            }));
        }
        let (mesh_to_image, sums) = from_mesh::mesh_to_image(&triangles, &faces, monitor)?;
        let of_mesh = spread(sums, mesh_components.list.len())?;
        let longest = faces.spacing().max_element();
        let (mesh_to_surface, sums) =
            to_surface::mesh_to_surface(&triangles, longest, to_world, oracle, monitor)?;
        let of_mesh_to_surface = spread(sums, mesh_components.list.len())?;
        let [_, ny, nz] = faces.brick_dims();
        monitor.enter(Step::ImageToMesh, ny * nz)?;
        let reach = REACH * faces.smallest_spacing();
        let check_lists = |of_lists| check_memory(of_faces + of_triangles + of_lists);
        let bins = TriangleBins::new(triangles, &faces, reach, &check_lists, monitor)?;
        let [from_faces, from_surface] =
            from_image::image_to_mesh(&bins, reach, &faces, image_components, oracle, monitor)?;
        let both = |mesh_to_image, of_mesh, (image_to_mesh, of_image)| Self {
            whole: SurfaceDistance { mesh_to_image, image_to_mesh },
            of_mesh,
            of_image,
        };
        Ok(BothDistances {
            faces: both(mesh_to_image, of_mesh, from_faces),
            surface: both(mesh_to_surface, of_mesh_to_surface, from_surface),
        })
    }
}

/// Weighted sum and maximum of distances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sum {
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
        Distance {
            mean: if self.weight > 0.0 { self.weighted / self.weight } else { self.max },
            max: self.max,
        }
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
///
/// # Errors
/// [`Error::OutOfMemory`].
fn spread(sums: Sums<Sum>, components: usize) -> Result<Vec<Sum>> {
    let mut spread = filled(components, Sum::default(), "components", || Ok(()))?;
    sums.into_iter().for_each(|(component, sum)| spread[component as usize] = sum);
    Ok(spread)
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

#[cfg(test)]
mod tests;
