//! Outer facets that should lie on a wall and do not: nicks where the image cuts the object off.
//!
//! Which these are is told by [`Oracle::is_off_wall`].
//!
//! Cost: a ray for each outer facet that has a vertex on a wall and does not lie on it.

use rayon::prelude::*;

use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// Facets of one piece of work.
const CHUNK: usize = 1 << 12;

/// How many outer facets should lie on a wall and do not.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub fn facets_off_walls(mesh: &TetMesh, oracle: &Oracle, monitor: &Monitor<'_>) -> Result<u64> {
    if !oracle.has_walls() {
        return Ok(0);
    }
    let counts = mesh.facets.par_chunks(CHUNK).zip(mesh.facet_labels.par_chunks(CHUNK)).map(
        |(facets, labels)| {
            monitor.advance(0)?;
            let off = facets.iter().zip(labels).filter(|&(facet, &[inner, outer])| {
                let corners = facet.map(|v| mesh.point(v));
                // The normal points to the second label.
                let outwards = if outer == 0 { 1.0 } else { -1.0 };
                (inner == 0 || outer == 0) && oracle.is_off_wall(corners, outwards)
            });
            Ok(off.count() as u64)
        },
    );
    counts.try_reduce(|| 0, |a, b| Ok(a + b))
}
