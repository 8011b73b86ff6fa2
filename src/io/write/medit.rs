//! MEDIT ascii file (Frey, "MEDIT: an interactive mesh visualization software", INRIA RT-0253,
//! 2001).
//!
//! The reference of a tet is its label, that of a triangle the number of its pair of labels, that
//! of every vertex 0. Comment lines before the triangles say which labels a number stands for.
//! Indices start at 1.
//!
//! In a mesh of second order they are `TetrahedraP2` and `TrianglesP2`, with the nodes on edges in
//! the mesh's own order (libMeshb's default). Orders of nodes are not declared: readers other than
//! libMeshb's do not know these sections.

use std::io::{self, Write};

use super::WriteOptions;
use super::output::Output;
use super::records::{push_float, push_int, write_records};
use super::regions::regions_and_boundaries;
use crate::mesh::TetMesh;

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    // Version 2 is double precision. Some readers take these two lines by position, so nothing may
    // stand between them.
    write!(out, "MeshVersionFormatted 2\nDimension 3\nVertices\n{}\n", mesh.points.len())?;
    write_records(out, mesh.points.len(), |v, bytes| {
        for &x in &mesh.points[v] {
            push_float(bytes, x);
            bytes.push(b' ');
        }
        bytes.extend_from_slice(b"0\n");
    })?;
    let suffix = if mesh.mid_nodes.is_some() { "P2" } else { "" };
    write!(out, "Tetrahedra{suffix}\n{}\n", mesh.tets.len())?;
    let (of_tet, of_facet) = (mesh.nodes_per_tet(), mesh.nodes_per_facet());
    write_records(out, mesh.tets.len(), |t, bytes| {
        push_line(bytes, &mesh.tet_nodes(t)[..of_tet], i64::from(mesh.labels[t]));
    })?;
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    out.write_all(options.space("# ", "\n").as_bytes())?;
    let comments = regions.comments() + &boundaries.comments();
    write!(out, "{comments}Triangles{suffix}\n{}\n", mesh.facets.len())?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        push_line(bytes, &mesh.facet_nodes(f)[..of_facet], i64::from(boundaries.number(f)));
    })?;
    out.write_all(b"End\n")
}

/// Appends a line of nodes, counted from 1, and a reference.
fn push_line(bytes: &mut Vec<u8>, vertices: &[u32], reference: i64) {
    for &v in vertices {
        push_int(bytes, i64::from(v) + 1);
        bytes.push(b' ');
    }
    push_int(bytes, reference);
    bytes.push(b'\n');
}
