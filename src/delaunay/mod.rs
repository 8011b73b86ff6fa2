//! The Delaunay triangulation of a growing and shrinking point set in a box; knows no image.
//!
//! | file | what |
//! |---|---|
//! | [`chunked`] | memory in chunks that never move |
//! | [`tet`] | records of tets and vertices, ids, the facet notation |
//! | [`ownership`] | who owns which tets: why there is no deadlock, and which memory order |
//! | [`locks`] | who may touch a tet: the locking policy, a type parameter |
//! | [`probe`] | who is told of what a worker does, a type parameter |
//! | [`numa`] | the memory node of each chunk; slots on their way back to theirs |
//! | [`triangulation`] | the shared structure and the virtual box |
//! | [`worker`] | one thread's view: scratch memory, free slots, counters |
//! | [`locate`] | walking to the tet that holds a point |
//! | `flood` | the tets near to some places, without going through all |
//! | [`worker::cavity`] | the conflict zone of a point (digging) |
//! | [`worker::insert`] | Bowyer-Watson insertion (filling) |
//! | [`worker::remove`] | vertex removal by the Delaunay triangulation of the link |
//! | [`spatial_order`] | tets and vertices in the order of their places |
//! | `forced_conflicts` | locks refused at random, in a build for tests |
//! | [`check`] | the validator: every invariant below, exactly |
//!
//! # Invariants
//! 1. Every tet is positive (`geometry`), and its circumball is empty under the symbolic
//!    perturbation, so that the triangulation is a function of its vertex set.
//! 2. Adjacency is mutual; a facet without a neighbour lies on the box.
//! 3. Every vertex that is not removed names one tet of its star.
//! 4. An operation writes only to tets that its worker owns, to the adjacency slots that face these
//!    tets, and of the vertices around only which tet is of their star and a number of the moment.
//!    An owned tet keeps all others from changing the tets across its facets (`ownership`).
//! 5. An operation either completes or changes nothing.
//!
//! All shared words are atomics: a race is a logic error that the ownership protocol excludes,
//! never undefined behaviour.

pub mod check;
pub mod chunked;
mod flood;
#[cfg(feature = "force-conflicts")]
mod forced_conflicts;
pub mod locate;
pub mod locks;
pub mod numa;
pub mod ownership;
pub mod probe;
pub mod spatial_order;
pub mod tet;
pub mod triangulation;
pub mod worker;

pub use locks::{Locks, Solo, TryLock};
pub use probe::{CountVisits, NoProbe, Probe};
pub use tet::{BOX_VERTICES, Facet, TetId, TetStamp, VertexId, VertexKind};
pub use triangulation::Triangulation;
pub use worker::{Insertion, Removal, Worker};
