//! Nicks: where the object should go on to a wall, and a tet of background is in the way.
//!
//! At the rim of a cap a tet within the walls may have its circumcenter outside of the object. It
//! is background then, and a facet that should lie on the wall does not. Such a tet becomes a part
//! of the label that the facet bounds, if that changes no topology: with the closed tets of that
//! label around it, and with those of the background, it must have a disc in common. It is glued on
//! to the one along a disc, and cut off from the other along one. So components, Euler numbers and
//! non-manifold places stay what they are. Other labels keep their tets.
//!
//! Serial but for the search, and in the order of the tets: the same for any number of threads.
//! Cost: a ray for each outer facet that has a vertex on a wall and does not lie on it.

use rayon::prelude::*;

use super::CHUNK;
use crate::Result;
use crate::delaunay::tet::FACET;
use crate::geometry::measures::tet_volume;
use crate::mesh::vicinity::{Vicinity, star_of};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// Tets behind a nick that was filled may be in the way, too.
const MAX_ROUNDS: usize = 4;

/// Fills nicks of a mesh that has the background around the object; the vertices of tets that are
/// kept come before number `points_kept`. Told are the labels and the volumes that they gained.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub fn fill_nicks(
    mesh: &mut TetMesh,
    oracle: &Oracle,
    points_kept: usize,
    monitor: &Monitor<'_>,
) -> Result<Vec<(i32, f64)>> {
    let mut filled = Vec::new();
    if !oracle.has_walls() {
        return Ok(filled);
    }
    for _ in 0..MAX_ROUNDS {
        let before = filled.len();
        for (tet, label) in nicks(mesh, oracle, points_kept, monitor)? {
            if may_become(mesh, tet, label) {
                mesh.labels[tet as usize] = label;
                let corners = mesh.tets[tet as usize].map(|v| mesh.point(v));
                filled.push((label, tet_volume(&corners)));
            }
        }
        if filled.len() == before {
            break;
        }
    }
    Ok(filled)
}

/// The tets of background behind facets that should lie on a wall, and the labels before these, in
/// the order of the labelled tets.
fn nicks(
    mesh: &TetMesh,
    oracle: &Oracle,
    points_kept: usize,
    monitor: &Monitor<'_>,
) -> Result<Vec<(u32, i32)>> {
    let of_chunk = |(chunk, neighbors): (usize, &[[u32; 4]])| {
        monitor.advance(0)?;
        let mut found = Vec::new();
        for (t, neighbors) in (chunk * CHUNK..).zip(neighbors) {
            let label = mesh.labels[t];
            if label == 0 || mesh.tets[t][0] == NONE {
                continue;
            }
            for (i, &other) in neighbors.iter().enumerate() {
                let is_background = other != NONE && mesh.labels[other as usize] == 0;
                if !is_background || !is_within(mesh, other, points_kept) {
                    continue;
                }
                // FACET's normals point into the tet.
                let corners = FACET[i].map(|k| mesh.point(mesh.tets[t][k]));
                if oracle.is_off_wall(corners, -1.0) {
                    found.push((other, label));
                }
            }
        }
        Ok(found)
    };
    let chunks: Vec<Vec<_>> =
        mesh.neighbors.par_chunks(CHUNK).enumerate().map(of_chunk).collect::<Result<_>>()?;
    Ok(chunks.into_iter().flatten().collect())
}

/// Whether all vertices of a tet are kept in the end.
fn is_within(mesh: &TetMesh, t: u32, points_kept: usize) -> bool {
    mesh.tets[t as usize].iter().all(|&v| (v as usize) < points_kept)
}

/// Whether a tet of background may become one of a label without a change of topology.
fn may_become(mesh: &TetMesh, t: u32, label: i32) -> bool {
    if mesh.labels[t as usize] != 0 {
        return false;
    }
    // What another label consists of does not change.
    let vicinity = Vicinity::new(mesh, t, |v| star_of(mesh, v, t));
    let is_disc = |of| vicinity.shared_with(|t| mesh.labels[t as usize] == of).is_disc();
    is_disc(label) && is_disc(0)
}
