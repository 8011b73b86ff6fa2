//! The library's own coordination code, compiled against the primitives of the loom model checker
//! instead of those of the standard library. The models are in `tests/models.rs`.
//!
//! The sources are included as they are; `sync` stands in for the library's module of that name.

#[path = "../../../src/error.rs"]
pub mod error;
pub mod sync;

#[path = "../../../src/delaunay/ownership.rs"]
pub mod ownership;
#[path = "../../../src/parallel/mod.rs"]
pub mod parallel;

pub use error::{Error, Result};
