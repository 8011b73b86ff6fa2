//! What parallel passes gather, to the same bits on any number of threads.
//!
//! | file | what it is |
//! |---|---|
//! | `union_find` | disjoint sets that many threads join at once |
//! | `keyed_sums` | sums by key |

mod keyed_sums;
mod union_find;

pub(crate) use keyed_sums::{KeyedSums, Sums};
pub(crate) use union_find::{NO_SET, Numbered, UnionFind};
