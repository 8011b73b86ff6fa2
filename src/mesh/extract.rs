//! From the triangulation to the finished mesh: the tets whose circumcenter lies in the object, each with the label there.
//!
//! Vertices keep the order in which they were inserted, tets that of their slots; vertices of no kept tet are left out.

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::tet::{FACET, NO_VERTEX};
use crate::delaunay::{TetId, Triangulation};
use crate::monitor::Monitor;

/// Tets between two looks at the cancel flag.
const CHECK_EVERY: usize = 1 << 16;

/// Collects the mesh. `label` is the label of a tet, 0 for background; `background` keeps the tets of label 0 too.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub fn extract(
    triangulation: &Triangulation,
    label: impl Fn(TetId) -> i32,
    background: bool,
    monitor: &Monitor<'_>,
) -> Result<TetMesh> {
    let mut mesh = TetMesh::default();
    let mut kept: Vec<TetId> = Vec::new();
    for t in triangulation.living_tets() {
        let label = label(t);
        if label != 0 || background {
            kept.push(t);
            mesh.labels.push(label);
        }
    }
    let slots = kept.last().map_or(0, |&t| t as usize + 1);
    let mut tet_index = vec![NONE; slots];
    let mut vertex_index = vec![NO_VERTEX; triangulation.vertex_bound() as usize];
    for (index, &t) in kept.iter().enumerate() {
        tet_index[t as usize] = index as u32;
        for v in triangulation.tet(t).vertices() {
            vertex_index[v as usize] = 0;
        }
    }
    for (v, index) in vertex_index.iter_mut().enumerate().filter(|(_, index)| **index != NO_VERTEX) {
        *index = mesh.points.len() as u32;
        mesh.points.push(triangulation.position(v as u32).to_array());
    }
    mesh.tets.reserve_exact(kept.len());
    mesh.neighbors.reserve_exact(kept.len());
    for (index, &t) in kept.iter().enumerate() {
        if index % CHECK_EVERY == 0 {
            monitor.check_cancelled()?;
        }
        let record = triangulation.tet(t);
        let vertices = record.vertices().map(|v| vertex_index[v as usize]);
        let across: [Option<TetId>; 4] = std::array::from_fn(|i| {
            let neighbor = record.neighbor(i);
            (!neighbor.is_none()).then(|| neighbor.tet())
        });
        mesh.tets.push(vertices);
        mesh.neighbors.push(across.map(|n| n.and_then(|n| tet_index.get(n as usize).copied()).unwrap_or(NONE)));
        let here = mesh.labels[index];
        for (i, n) in across.into_iter().enumerate() {
            // A facet on the box has background on both sides.
            let Some(n) = n else { continue };
            let there = label(n);
            // Each interface facet once: from its tet with the larger label, or from the only one that was kept.
            let other = tet_index.get(n as usize).copied().unwrap_or(NONE);
            if here == there || (here < there && other != NONE) {
                continue;
            }
            let [a, b, c] = FACET[i].map(|k| vertices[k]);
            // FACET's normals point into the tet.
            if here > there {
                mesh.facets.push([a, c, b]);
                mesh.facet_labels.push([here, there]);
                mesh.facet_tets.push([index as u32, other]);
            } else {
                mesh.facets.push([a, b, c]);
                mesh.facet_labels.push([there, here]);
                mesh.facet_tets.push([other, index as u32]);
            }
        }
    }
    Ok(mesh)
}
