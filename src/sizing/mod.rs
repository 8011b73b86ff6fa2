//! How far apart samples are to be, from place to place.
//!
//! | file | what it is |
//! |---|---|
//! | [`field`] | the sizing field: a distance for each voxel, graded |
//! | [`expected`] | how many tets will come of it |
//! | [`thickness`] | where a label is thin, which makes the field small there |

pub mod expected;
pub mod field;
pub mod thickness;

pub use field::{Place, Sizing, Spacing};
