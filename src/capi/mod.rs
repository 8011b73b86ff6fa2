//! The C interface: opaque handles, status codes, plain structs. A thin layer: no function here
//! computes anything.
//!
//! The C header `include/lapd.h` is generated from these files by cbindgen (`tests/header.rs`), so
//! their doc comments are the documentation that C users read and speak of C.
//!
//! What holds for every function:
//! - `boundary` catches panics, which are bugs of lapd, and turns them into `LAPD_ERROR_INTERNAL`;
//!   nothing is printed.
//! - Pointers are checked for NULL and alignment before use; enums arrive as `int32_t` and are
//!   matched against the known values, because a Rust enum with an unknown value would be undefined
//!   behaviour.
//! - Out-parameters are written last, when nothing can fail any more.
//! - A handle is a `Box`; the caller owns it from the create function to the free function.
//! - Safety, the same for all of them and so said once, here: a pointer is NULL, or points to as
//!   many valid values as the header says and stays so during the call; a handle came from its
//!   create function and was not freed; nobody else writes to what a `const` pointer points to, nor
//!   uses what another one points to.
//!
//! Functions are written out one by one: cbindgen does not see those that a `macro_rules!` would
//! make.
#![allow(non_camel_case_types, clippy::missing_safety_doc)]
// The header's text names shapes such as [count][3], which look like links to rustdoc.
#![allow(rustdoc::broken_intra_doc_links)]

pub mod about;
mod boundary;
pub mod budget;
pub mod certify;
pub mod context;
pub mod image;
pub mod improvement;
mod label_names;
pub mod labels;
pub mod level;
pub mod mesh;
pub mod names;
pub mod params;
mod pool;
pub mod report;
pub mod run;
pub mod second_order;
pub mod split;
pub mod status;
pub mod tables;
pub mod thin;
pub mod threads;
pub mod values;
pub mod write;
