//! Components of a mesh's labels, their boundaries, and which component of the image is which.
//!
//! | file | what it is |
//! |---|---|
//! | `mesh_components` | the components of the mesh, and where in the image they lie |
//! | [`matching`] | which component of the mesh stands for which of the image |
//! | [`boundary_surface`] | the boundary of each component: Euler characteristic, open edges |
//! | `vertex_links` | vertices and edges where a boundary is no surface |

pub mod boundary_surface;
pub mod matching;
pub(crate) mod mesh_components;
mod vertex_links;
