//! Geometry on plain points: exact predicates, circumspheres, shape measures; places along a curve.
//!
//! # The one sign convention
//! A tet (a, b, c, d) is *positive* when (b - a) x (c - a) . (d - a) > 0: by the right-hand rule,
//! the normal of (a, b, c) points towards d. Every tet in this crate is positive, as in VTK. Facet
//! i of a tet is opposite to its vertex i; replacing vertex i by a point on the same side of facet
//! i keeps the tet positive.
//!
//! Shewchuk's `orient3d` and `insphere` (and so the `robust` crate) use the opposite sign; only
//! [`predicates`] knows that.

pub mod measures;
pub mod morton;
pub mod predicates;
pub mod shape;
pub mod sphere;
pub mod star;
pub(crate) mod tet_block;
pub(crate) mod vectors;

pub use glam::DVec3;
