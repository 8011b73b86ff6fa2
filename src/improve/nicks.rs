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
    let of = |t: u32| if t == NONE { 0 } else { mesh.labels[t as usize] };
    if of(t) != 0 {
        return false;
    }
    let vertices = mesh.tets[t as usize];
    // Which of the tets around have the label, and which are background, as sets of the vertices
    // that they share with the tet: bit i for vertex i.
    let (mut labelled, mut background) = (Vec::new(), Vec::new());
    for around in vertices.map(|v| star(mesh, t, v)) {
        for other in around {
            let bit = |i: usize| u8::from(mesh.tets[other as usize].contains(&vertices[i])) << i;
            let shared = (0..4).map(bit).sum::<u8>();
            match of(other) {
                0 => background.push(shared),
                l if l == label => labelled.push(shared),
                // What another label consists of does not change.
                _ => {}
            }
        }
    }
    is_disc(&labelled) && is_disc(&background)
}

/// The tets around vertex `v` of tet `t`, without that.
fn star(mesh: &TetMesh, t: u32, v: u32) -> Vec<u32> {
    let mut found = vec![t];
    let mut next = 0;
    while let Some(&here) = found.get(next) {
        next += 1;
        let (vertices, neighbors) = (mesh.tets[here as usize], mesh.neighbors[here as usize]);
        for (i, &other) in neighbors.iter().enumerate() {
            // The facet opposite to v does not have it.
            if vertices[i] != v && other != NONE && !found.contains(&other) {
                found.push(other);
            }
        }
    }
    found.remove(0);
    found
}

/// Whether what a tet has in common with others, given as sets of its vertices, is a disc: one to
/// three of its facets, with nothing beside them.
fn is_disc(shared: &[u8]) -> bool {
    let mut facets: Vec<u8> =
        shared.iter().copied().filter(|bits| bits.count_ones() == 3).collect();
    facets.sort_unstable();
    facets.dedup();
    (1..=3).contains(&facets.len())
        && shared.iter().all(|bits| facets.iter().any(|facet| bits & !facet == 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs() {
        assert!(is_disc(&[0b0111, 0b0011, 0b0001]));
        assert!(is_disc(&[0b0111, 0b1011, 0b1101]));
        // An edge beside the facet, all facets, none.
        assert!(!is_disc(&[0b0111, 0b1001]));
        assert!(!is_disc(&[0b0111, 0b1011, 0b1101, 0b1110]));
        assert!(!is_disc(&[0b0011]));
    }
}
