//! How far the interface facets that flips made are from where refinement put the interface.
//!
//! A vertex may slide along the interface as long as it keeps near to one of the facets around it,
//! as refinement put them (`smoothing`). A facet that a flip made is none of refinement's. How far
//! it may be from these is noted here, and counts, too.
//!
//! The two facets of a flip are no farther from the two that they replace than the new edge is from
//! the old one at the place where they cross: each point of the new edge is at most so far from one
//! of the old facets, and each point of a new facet is on the way from there to an end of the old
//! edge, which both have. With refinement's places of all vertices this holds for refinement's
//! interface, whatever moves afterwards.

use std::collections::HashMap;

use crate::{Result, memory};

/// How far facets are from refinement's interface, at refinement's places of their vertices.
#[derive(Default)]
pub(super) struct Flips(HashMap<[u32; 3], f64>);

impl Flips {
    /// The distance of a facet that a flip made; `None`: none did.
    pub fn distance(&self, facet: [u32; 3]) -> Option<f64> {
        if self.0.is_empty() { None } else { self.0.get(&sorted(facet)).copied() }
    }

    /// Notes how far a facet is.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn note(&mut self, facet: [u32; 3], distance: f64) -> Result<()> {
        memory::insert(&mut self.0, sorted(facet), distance, "flipped facets").map(drop)
    }

    /// Takes over what others know. Facets have one owner each, so the order does not matter.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn extend(&mut self, others: Self) -> Result<()> {
        others.0.into_iter().try_for_each(|(facet, distance)| self.note(facet, distance))
    }
}

fn sorted(mut facet: [u32; 3]) -> [u32; 3] {
    facet.sort_unstable();
    facet
}
