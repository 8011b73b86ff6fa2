//! How workers share work and stay out of each other's way; knows no mesh.
//!
//! From the paper's sections 1 to 3, and P. Foteinos, N. Chrisochoides, "High quality real-time
//! image-to-mesh conversion for finite element simulations" (2014), where the contention managers
//! and the hierarchical begging lists are published.
//!
//! | file | what |
//! |---|---|
//! | [`policy`] | what a caller may choose |
//! | [`contention`] | what a worker does after a conflict; why there is no livelock |
//! | [`begging`] | who gets work from whom; how the end is noticed |
//! | [`work_ranges`] | a list that all work off, each from its own place |
//! | [`machine`], [`bisection`] | cores, memory nodes, hops between them; groups of nodes halved |
//! | [`topology`] | which workers are near to each other, on a machine |
//! | [`parking`] | waiting, waking, and ending all waits |
//!
//! All of it is modelled with the loom model checker, together with the locks of tets:
//! `verification/loom`.

pub mod begging;
pub mod bisection;
pub mod contention;
pub mod machine;
pub mod parking;
pub mod policy;
pub mod topology;
pub mod work_ranges;
