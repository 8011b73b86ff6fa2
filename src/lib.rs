//! lapd turns a segmented 3D image into a quality tetrahedral Delaunay mesh of all its tissues.
//!
//! The map, from the inside out (a module uses only those named before it):
//!
//! | module | what it is |
//! |---|---|
//! | [`error`] | the one error type |
//! | `memory`, `panics` | tables that may not fit, blocks in reserve, panics caught |
//! | `sync` | waiting, waking and time stamps; chooses threads or virtual time |
//! | [`parallel`] | how workers wait, and share work; knows no mesh |
//! | [`params`], [`monitor`] | what a run is asked for; progress and cancellation |
//! | `reduce` | what parallel passes gather: disjoint sets, sums by key |
//! | [`geometry`] | predicates, circumspheres, shape measures; the one sign convention |
//! | [`image`] | label images, their place in the world, components, phantoms |
//! | [`sizing`] | how far apart samples are to be, from place to place |
//! | [`oracle`] | where the interfaces are; knows no mesh |
//! | [`system`] | the machine at hand, synthetic ones, threads bound to cores |
//! | [`delaunay`] | the Delaunay triangulation; knows no image |
//! | [`refine`] | the rules R1 to R6 and the loop that applies them |
//! | `simulation` | a cargo feature: many workers in virtual time, on machines not at hand |
//! | [`mesh`] | the finished mesh, collected from the triangulation |
//! | [`improve`] | slivers removed from the finished mesh |
//! | [`second_order`] | nodes in the middles of edges, put on the interfaces |
//! | [`verify`] | what is measured on the finished mesh: quality, topology, distance, certificate |
//! | [`io`] | files: images read, meshes written |
//! | [`pipeline`] | the stages, and the run that goes through all of them |
//! | [`capi`] | the C interface |
#![deny(unsafe_op_in_unsafe_fn)]
#![warn(missing_docs)]

pub mod capi;
pub mod delaunay;
pub mod error;
pub mod geometry;
pub mod image;
pub mod improve;
pub mod io;
mod memory;
pub mod mesh;
pub mod monitor;
pub mod oracle;
mod panics;
pub mod parallel;
pub mod params;
pub mod pipeline;
mod reduce;
pub mod refine;
pub mod second_order;
#[cfg(feature = "simulation")]
pub mod simulation;
pub mod sizing;
mod sync;
pub mod system;
pub mod verify;

pub use error::{Error, Result};
