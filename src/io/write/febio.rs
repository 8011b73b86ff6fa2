//! FEBio's input files, specification 4.0 (Maas et al., "FEBio: Finite elements for biomechanics",
//! Journal of Biomechanical Engineering 134, 2012; "FEBio User Manual", Mesh section).
//!
//! Each region is a set of elements tet4, or tet10 in a mesh of second order, whose nodes on edges
//! come in the mesh's own order, and a solid domain with a material of its own: elastic, with
//! values to be replaced. Each boundary is a surface of tri3 or tri6. Numbers of nodes and elements
//! are those of the mesh, from 1.

use std::io::{self, Write};
use std::path::Path;

use super::groups::Groups;
use super::output::Output;
use super::records::{push_floats, push_int, write_records};
use super::regions::regions_and_boundaries;
use super::{WriteOptions, check_count};
use crate::Result;
use crate::mesh::TetMesh;

pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    check_count(path, "FEBio", "nodes", mesh.points.len(), i32::MAX as usize)?;
    check_count(path, "FEBio", "tets", mesh.tets.len(), i32::MAX as usize)
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output<'_>,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let (of_tet, of_facet) = (mesh.nodes_per_tet(), mesh.nodes_per_facet());
    let space = options.space("<!-- ", " -->\n");
    write!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<febio_spec version=\"4.0\">\n{space}\
         <Module type=\"solid\"/>\n<!-- Materials hold places: give them values of your own. -->\n\
         <Material>\n"
    )?;
    for ((_, name), number) in regions.iter().zip(1..) {
        write!(
            out,
            "<material id=\"{number}\" name=\"{name}\" type=\"neo-Hookean\">\n\
             <density>1</density>\n<E>1</E>\n<v>0.3</v>\n</material>\n"
        )?;
    }
    out.write_all(b"</Material>\n<Mesh>\n<Nodes name=\"mesh\">\n")?;
    write_records(out, mesh.points.len(), |v, bytes| {
        push_open(bytes, b"node", v);
        push_floats(bytes, &mesh.points[v], b',');
        bytes.extend_from_slice(b"</node>\n");
    })?;
    out.write_all(b"</Nodes>\n")?;
    for (label, tets) in Groups::new(&mesh.labels).map_err(io::Error::other)?.iter() {
        writeln!(out, "<Elements type=\"tet{of_tet}\" name=\"{}\">", regions.name(label))?;
        tets.write_records(out, |_, t, bytes| {
            push_open(bytes, b"elem", t as usize);
            push_nodes(bytes, &mesh.tet_nodes(t as usize)[..of_tet]);
            bytes.extend_from_slice(b"</elem>\n");
        })?;
        out.write_all(b"</Elements>\n")?;
    }
    let of_boundaries = Groups::new(&boundaries).map_err(io::Error::other)?;
    for (name, (_, facets)) in boundaries.names.iter().zip(of_boundaries.iter()) {
        writeln!(out, "<Surface name=\"{name}\">")?;
        let tag: &[u8] = if of_facet == 3 { b"tri3" } else { b"tri6" };
        facets.write_records(out, |i, f, bytes| {
            push_open(bytes, tag, i);
            push_nodes(bytes, &mesh.facet_nodes(f as usize)[..of_facet]);
            bytes.extend_from_slice(b"</");
            bytes.extend_from_slice(tag);
            bytes.extend_from_slice(b">\n");
        })?;
        out.write_all(b"</Surface>\n")?;
    }
    out.write_all(b"</Mesh>\n<MeshDomains>\n")?;
    for (_, name) in regions.iter() {
        writeln!(out, "<SolidDomain name=\"{name}\" mat=\"{name}\"/>")?;
    }
    out.write_all(b"</MeshDomains>\n</febio_spec>\n")
}

/// Opens an element with a number, which is the index and 1.
fn push_open(bytes: &mut Vec<u8>, tag: &[u8], index: usize) {
    bytes.push(b'<');
    bytes.extend_from_slice(tag);
    bytes.extend_from_slice(b" id=\"");
    push_int(bytes, index as i64 + 1);
    bytes.extend_from_slice(b"\">");
}

fn push_nodes(bytes: &mut Vec<u8>, nodes: &[u32]) {
    for (i, &v) in nodes.iter().enumerate() {
        if i > 0 {
            bytes.push(b',');
        }
        push_int(bytes, i64::from(v) + 1);
    }
}
