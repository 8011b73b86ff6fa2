//! How far apart samples are to be, and how large tets, from place to place.
//!
//! | file | what it is |
//! |---|---|
//! | [`field`] | the sizing field: a distance for each voxel, graded |
//! | [`contact_lines`] | where bodies touch along edges some voxels long |
//! | [`expected`] | how many tets will come of it |
//! | [`tet_sizes`] | the largest circumradius of tets for each voxel, by thickness |
//! | [`thickness`] | where a label is thin, which makes the fields small there |
//! | `levels` | how a length for each voxel is kept, and graded |

pub mod contact_lines;
pub mod expected;
pub mod field;
mod levels;
pub mod tet_sizes;
pub mod thickness;

pub use field::{Place, SampledContacts, Sizing, Spacing};
pub use tet_sizes::TetSizes;
