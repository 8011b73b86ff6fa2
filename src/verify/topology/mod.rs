//! Components of a mesh's labels, their boundaries, and which component of the image is which.
//!
//! | file | what it is |
//! |---|---|
//! | `mesh_components` | the components of the mesh, and where in the image they lie |
//! | [`matching`] | which component of the mesh stands for which of the image |
//! | [`boundary_surface`] | the boundary of each component: Euler characteristic, open edges |
//! | [`differences`] | where a mesh differs from its image in what is connected |
//! | `measured` | components and boundaries at once |
//! | `voxel_labels` | which label of the mesh each voxel's centre has |
//! | `deform`, `simple` | labellings of voxels, compared but for where boundaries lie |
//! | `touching` | where labels touch themselves, and where they should |
//! | `vertex_links` | vertices and edges where a boundary is no surface |

pub mod boundary_surface;
mod deform;
pub mod differences;
pub mod matching;
pub(crate) mod measured;
pub(crate) mod mesh_components;
mod simple;
mod touching;
mod vertex_links;
mod voxel_labels;
