//! Outer facets that should lie on a wall and do not: nicks where the image cuts the object off.
//!
//! Which these are is told by [`Oracle::is_off_wall`].
//!
//! The same for any number of threads. Cost: a ray for each outer facet that has a vertex on a wall
//! and does not lie on it.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::geometry::predicates::perturbation_order;
use crate::memory::{concatenated, reserve};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// Facets of one piece of work.
const CHUNK: usize = 1 << 12;

/// The centroids of outer facets that should lie on a wall and do not, in the order of the facets.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn facets_off_walls(
    mesh: &TetMesh,
    oracle: &Oracle,
    monitor: &Monitor<'_>,
) -> Result<Vec<DVec3>> {
    if !oracle.has_walls() {
        return Ok(Vec::new());
    }
    let chunks = mesh.facets.par_chunks(CHUNK).zip(mesh.facet_labels.par_chunks(CHUNK)).map(
        |(facets, labels)| {
            monitor.advance(0)?;
            let mut off = Vec::new();
            for (facet, &[inner, outer]) in facets.iter().zip(labels) {
                let corners = facet.map(|v| mesh.point(v));
                // The normal points to the second label.
                let outwards = if outer == 0 { 1.0 } else { -1.0 };
                if (inner == 0 || outer == 0) && oracle.is_off_wall(corners, outwards) {
                    reserve(&mut off, 1, WHAT)?;
                    off.push(centroid(corners));
                }
            }
            Ok(off)
        },
    );
    concatenated(chunks.collect::<Result<_>>()?, WHAT)
}

/// The centroid of a facet, the same for any order of its corners: it is compared with that of
/// other meshes.
fn centroid(mut corners: [DVec3; 3]) -> DVec3 {
    corners.sort_unstable_by(|&a, &b| perturbation_order(a, b));
    corners.iter().sum::<DVec3>() / 3.0
}

/// What the lists of this module have, as errors name it.
const WHAT: &str = "facets off walls";
