//! The rules R1 to R6 and the loop that applies them.
//!
//! | file | what |
//! |---|---|
//! | [`sampling`] | R1: samples of the isosurface, before there are tets |
//! | [`rules`] | what each rule asks for; reads only |
//! | [`state`] | what is written down of tets and vertices, for the rules to read |
//! | [`cell_table`] | cells of points, for the two that look for near points |
//! | [`vertex_grid`] | which vertices lie near a point |
//! | `recent` | points found last, asked before a search |
//! | [`pel`] | the poor element list: what a worker does next |
//! | [`activity`] | what each thread did, and with what it lost time |
//! | [`probe`] | who is told of inspections and lookups |
//! | [`options`] | what a refinement is told: limits, threads, the machine |
//! | [`team`] | what the workers of a refinement share: limits, the way to stop |
//! | [`podm`] | all workers on one triangulation: the phases of a refinement |
//! | `lapd` | each memory node in a region of its own: whose are which samples and tets |
//! | [`partition`] | the regions: blocks, bisection |
//! | [`refiner`] | one worker's loop: inspect, insert, remove |
//! | [`unmet`] | what the rules still apply to in the end |

pub mod activity;
pub mod cell_table;
mod lapd;
pub mod options;
pub mod partition;
pub mod pel;
pub mod podm;
pub mod probe;
mod recent;
pub mod refiner;
pub mod rules;
pub mod sampling;
pub mod state;
pub mod team;
pub mod unmet;
pub mod vertex_grid;

pub use podm::{refine, refine_further};
pub use unmet::{Asked, examine};
