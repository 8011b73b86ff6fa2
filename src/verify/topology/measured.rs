//! The components of a mesh and their boundaries, measured at once.

use super::boundary_surface::BoundarySurfaces;
use super::mesh_components::MeshComponents;
use crate::Result;
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;

/// What tells which component of the image each component of a mesh stands for, and whether it has
/// that one's Euler characteristic.
pub(crate) struct MeshTopology {
    /// The components.
    pub components: MeshComponents,
    /// The boundary of each.
    pub surfaces: BoundarySurfaces,
}

impl MeshTopology {
    /// Measures a mesh that has its facets.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        of_image: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let mut components = MeshComponents::to_match(mesh, image, of_image, monitor)?;
        let surfaces = BoundarySurfaces::measure(mesh, &mut components, monitor)?;
        Ok(Self { components, surfaces })
    }
}
