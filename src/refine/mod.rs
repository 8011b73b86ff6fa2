//! The rules R1 to R6 and the loop that applies them.
//!
//! | file | what |
//! |---|---|
//! | [`rules`] | what each rule asks for; reads only |
//! | [`vertex_grid`] | which vertices lie near a point |
//! | [`refiner`] | one worker's loop: look, insert, remove |

pub mod refiner;
pub mod rules;
pub mod vertex_grid;

pub use refiner::{refine, unmet_rules};
