//! Label images: a grid of tissue labels and its place in the world.
//!
//! | file | what it is |
//! |---|---|
//! | [`frame`] | origin, spacing and direction of a voxel grid |
//! | [`volume`] | the image: dense ids, their labels, the frame |
//! | `relabel` | merging labels, another background, selection |
//! | [`islands`] | small components, and an image without them |
//! | [`phantom`] | analytic images with known volumes |
//! | [`readers`] | NRRD, NIfTI, MetaImage and INR files |

mod builder;
pub mod frame;
pub mod islands;
pub mod phantom;
pub mod readers;
mod relabel;
pub mod volume;

pub use frame::Frame;
pub use volume::{LabelImage, Voxels};
