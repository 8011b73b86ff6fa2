//! Label images: a grid of tissue labels and its place in the world.
//!
//! | file | what it is |
//! |---|---|
//! | [`frame`] | origin, spacing and direction of a voxel grid |
//! | [`volume`] | the image: dense ids, their labels, the frame |
//! | [`gray`] | scans, cut into labels at isovalues |
//! | [`probabilities`] | probability maps, one per label |
//! | `field` | the values that labels of these two come from |
//! | `relabel` | merging labels, another background, selection |
//! | `components` | the connected components of labels |
//! | [`small_components`] | small components, and an image without them |
//! | `division` | long voxels, divided into parts that are nearly cubes |
//! | [`region`] | the bounding box of the object, as rows of labels |
//! | `grid` | the region's voxels in the world |
//! | `bricks` | how values of voxels lie in memory |
//! | [`palette`] | a value per voxel out of a few |
//! | `bits` | sets of voxels as bits |
//! | [`voxel_blocks`] | sets of blocks of voxels: where something has changed |
//! | [`label_names`] | names and colours of labels |
//! | `wall` | the six faces of the image's box |
//! | [`phantom`] | analytic images with known volumes |

pub(crate) mod bits;
pub(crate) mod bricks;
mod builder;
pub(crate) mod components;
mod division;
mod field;
pub mod frame;
pub mod gray;
pub(crate) mod grid;
pub mod label_names;
pub mod palette;
pub mod phantom;
pub mod probabilities;
pub mod region;
mod relabel;
pub mod small_components;
pub mod volume;
pub mod voxel_blocks;
mod wall;

pub(crate) use builder::{LabelBuilder, numbered_voxels, voxel_count};
pub use field::MapValues;
pub(crate) use field::{Field, Maps};
pub use frame::{Frame, WorldAxes};
pub use gray::GrayImage;
pub(crate) use grid::Grid;
pub use label_names::LabelNames;
pub use palette::Palette;
pub use probabilities::ProbabilityImage;
pub use volume::{LabelImage, Voxels};
pub use wall::Wall;

/// Ids of labels are u16, id 0 is the background, and `u16::MAX` is left for what has none yet.
pub const MAX_IDS: usize = u16::MAX as usize;
