//! What is measured on a finished mesh: its shape, and how far it is from the image.
//!
//! | file | what it is |
//! |---|---|
//! | [`quality`] | the shape and orientation of tets, the shape of interface facets |
//! | [`topology`] | components, boundaries and their Euler characteristics, in mesh and image |
//! | [`distance`] | distances between mesh and image, both ways |
//! | `off_walls` | outer facets that should lie where the image ends |
//! | [`certificate`] | all of this in one report |
//!
//! Nothing here is shared with the refinement but the exact predicate, and the oracle for the
//! distances to the smooth interfaces.

pub mod certificate;
pub mod distance;
mod off_walls;
pub mod quality;
pub mod topology;

pub use certificate::{Certificate, ComponentRow, Defect, DefectKind, Examined, Extent, LabelRow};
pub use quality::Quality;
pub use topology::matching::Fate;
