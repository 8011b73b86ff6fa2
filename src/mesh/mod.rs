//! The finished mesh: plain arrays, and what is measured on them.

pub mod certificate;
pub mod distance;
pub mod extract;
mod facets;
mod grid_corners;
mod image_components;
mod ledger;
pub mod matching;
mod mesh_components;
pub mod quality;
mod sets;
pub mod sheets;
mod tables;
mod triangle_bins;
mod umbrellas;
mod voxel_faces;

#[cfg(test)]
pub(crate) mod testing;

pub use certificate::{Certificate, ComponentRow, Defect, DefectKind, LabelRow};
pub use matching::Fate;
pub use quality::Quality;

use glam::DVec3;

/// "No tet" in [`TetMesh::neighbors`] and [`TetMesh::facet_tets`].
pub const NONE: u32 = u32::MAX;

/// A finished tetrahedral mesh in world coordinates.
///
/// Sign convention: every tet (a, b, c, d) has (b - a) x (c - a) . (d - a) > 0, as in VTK. Facet i of a tet is the one opposite to
/// its vertex i. Interface facets are ordered so that their normal (b - a) x (c - a) points from `facet_labels[f][0]` to
/// `facet_labels[f][1]`, and the first label is the larger one (so that facets on the outside point outwards, towards label 0, unless labels are negative).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    /// Vertex positions.
    pub points: Vec<[f64; 3]>,
    /// Vertex indices of each tet.
    pub tets: Vec<[u32; 4]>,
    /// Label of each tet.
    pub labels: Vec<i32>,
    /// Neighbour across facet i of each tet, or [`NONE`].
    pub neighbors: Vec<[u32; 4]>,
    /// Vertex indices of each interface facet.
    pub facets: Vec<[u32; 3]>,
    /// The labels on the two sides of each interface facet.
    pub facet_labels: Vec<[i32; 2]>,
    /// The tets on the two sides of each interface facet; [`NONE`] where that side is background that was not kept.
    pub facet_tets: Vec<[u32; 2]>,
}

impl TetMesh {
    /// Position of vertex `v`.
    #[inline]
    pub fn point(&self, v: u32) -> DVec3 {
        DVec3::from_array(self.points[v as usize])
    }
}
