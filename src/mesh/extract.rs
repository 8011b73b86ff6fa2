//! From the triangulation to the finished mesh: the tets whose circumcenter lies in the object, each with the label there.
//!
//! Vertices keep the order in which they were inserted, tets that of their slots; vertices of no kept tet are left out.
//!
//! Every array gets its memory at once, after counting: nothing is copied while it grows.

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::tet::{FACET, NO_VERTEX};
use crate::delaunay::{TetId, Triangulation};
use crate::memory::{filled, room};
use crate::monitor::Monitor;

/// Tets between two looks at the cancel flag.
const CHECK_EVERY: usize = 1 << 12;

/// Bytes per slot of a tet that extraction needs at most, mesh included: 44 for a kept tet and its index, 5 for the vertices (some six tets have
/// one), 15 for the interface facets (fewer than one for two tets).
pub const BYTES_PER_SLOT: u64 = 64;

/// Collects the mesh. `label` is the label of a tet, 0 for background; `background` keeps the tets of label 0 too.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn extract(
    triangulation: &Triangulation,
    label: impl Fn(TetId) -> i32,
    background: bool,
    monitor: &Monitor<'_>,
) -> Result<TetMesh> {
    let is_kept = |label: i32| label != 0 || background;
    let mut count = 0;
    for (i, t) in triangulation.living_tets().enumerate() {
        if i % CHECK_EVERY == 0 {
            monitor.check_cancelled()?;
        }
        count += usize::from(is_kept(label(t)));
    }
    let mut mesh = TetMesh { labels: room(count, "labels of the mesh")?, ..TetMesh::default() };
    let mut kept: Vec<TetId> = room(count, "tets of the mesh")?;
    for (i, t) in triangulation.living_tets().enumerate() {
        if i % CHECK_EVERY == 0 {
            monitor.check_cancelled()?;
        }
        let label = label(t);
        if is_kept(label) {
            kept.push(t);
            mesh.labels.push(label);
        }
    }
    let slots = kept.last().map_or(0, |&t| t as usize + 1);
    let mut tet_index = filled(slots, NONE, "tets of the mesh", || monitor.advance(0))?;
    let mut vertex_index =
        filled(triangulation.vertex_bound() as usize, NO_VERTEX, "vertices of the mesh", || monitor.advance(0))?;
    let mut used = 0;
    for (index, &t) in kept.iter().enumerate() {
        if index % CHECK_EVERY == 0 {
            monitor.check_cancelled()?;
        }
        tet_index[t as usize] = index as u32;
        for v in triangulation.tet(t).vertices() {
            used += usize::from(vertex_index[v as usize] != 0);
            vertex_index[v as usize] = 0;
        }
    }
    mesh.points = room(used, "vertices of the mesh")?;
    for (v, index) in vertex_index.iter_mut().enumerate().filter(|(_, index)| **index != NO_VERTEX) {
        *index = mesh.points.len() as u32;
        if mesh.points.len().is_multiple_of(CHECK_EVERY) {
            monitor.check_cancelled()?;
        }
        mesh.points.push(triangulation.position(v as u32).to_array());
    }
    mesh.tets = room(count, "tets of the mesh")?;
    mesh.neighbors = room(count, "tets of the mesh")?;
    for (index, &t) in kept.iter().enumerate() {
        if index % CHECK_EVERY == 0 {
            monitor.advance(CHECK_EVERY)?;
        }
        let record = triangulation.tet(t);
        let vertices = record.vertices().map(|v| vertex_index[v as usize]);
        let across: [Option<TetId>; 4] = std::array::from_fn(|i| {
            let neighbor = record.neighbor(i);
            (!neighbor.is_none()).then(|| neighbor.tet())
        });
        mesh.tets.push(vertices);
        mesh.neighbors.push(across.map(|n| n.and_then(|n| tet_index.get(n as usize).copied()).unwrap_or(NONE)));
    }
    collect_facets(&mut mesh, monitor)?;
    Ok(mesh)
}

/// Fills in the interface facets: where labels differ, or where a tet with a label other than 0 has no neighbour. What was not kept is background, and so
/// is what lies outside of the box: in a finished refinement nothing else lies along it, but a partial mesh may reach it.
fn collect_facets(mesh: &mut TetMesh, monitor: &Monitor<'_>) -> Result<()> {
    let label = |mesh: &TetMesh, t: u32| if t == NONE { 0 } else { mesh.labels[t as usize] };
    // Each interface facet once: from its tet with the larger label, or from the only one that was kept.
    let is_listed = |here: i32, there: i32, other: u32| here > there || (here < there && other == NONE);
    let mut count = 0;
    for (index, neighbors) in mesh.neighbors.iter().enumerate() {
        if index % CHECK_EVERY == 0 {
            monitor.advance(0)?;
        }
        let here = mesh.labels[index];
        count += neighbors.iter().filter(|&&other| is_listed(here, label(mesh, other), other)).count();
    }
    mesh.facets = room(count, "interface facets of the mesh")?;
    mesh.facet_labels = room(count, "interface facets of the mesh")?;
    mesh.facet_tets = room(count, "interface facets of the mesh")?;
    for index in 0..mesh.tets.len() {
        if index % CHECK_EVERY == 0 {
            monitor.advance(0)?;
        }
        let here = mesh.labels[index];
        for i in 0..4 {
            let other = mesh.neighbors[index][i];
            let there = label(mesh, other);
            if !is_listed(here, there, other) {
                continue;
            }
            let [a, b, c] = FACET[i].map(|k| mesh.tets[index][k]);
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
    Ok(())
}
