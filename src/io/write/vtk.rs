//! VTK legacy file, version 4.2, binary (The VTK User's Guide, "Simple legacy formats").
//!
//! Version 4.2 rather than 5.1: every reader knows it. Its data are big-endian and its indices 32
//! bits wide; the five integers per tet (eleven in a mesh of second order) are counted in 32 bits
//! by some readers, which bounds the tets.

use std::io::{self, Write};
use std::path::Path;

use super::WriteOptions;
use super::output::Output;
use super::records::write_records;
use crate::error::shown;
use crate::mesh::TetMesh;
use crate::{Error, Result};

/// VTK's cell types of tets of order 1 and 2. Nodes on edges come in the mesh's own order.
const TETRA: u8 = 10;
const QUADRATIC_TETRA: u8 = 24;

/// VTK's cell type of the tets of a mesh.
pub(super) fn cell_type(mesh: &TetMesh) -> u8 {
    if mesh.mid_nodes.is_some() { QUADRATIC_TETRA } else { TETRA }
}

/// Whether the format can number what `mesh` has.
pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    let max = i32::MAX as usize;
    let max_tets = max / (mesh.nodes_per_tet() + 1);
    if mesh.points.len() > max || mesh.tets.len() > max_tets {
        return Err(Error::LimitReached(format!(
            "{}: {} nodes and {} tets are too many for a legacy VTK file ({max} and {max_tets}); \
             .vtu has no such limit",
            shown(path),
            mesh.points.len(),
            mesh.tets.len()
        )));
    }
    Ok(())
}

pub(super) fn write(mesh: &TetMesh, options: &WriteOptions, out: &mut Output) -> io::Result<()> {
    let (points, tets) = (mesh.points.len(), mesh.tets.len());
    let space = options.space(" ", "");
    write!(
        out,
        "# vtk DataFile Version 4.2\nlapd mesh{space}\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
    )?;
    writeln!(out, "POINTS {points} double")?;
    write_records(out, points, |v, bytes| {
        mesh.points[v].iter().for_each(|x| bytes.extend_from_slice(&x.to_be_bytes()));
    })?;
    let nodes = mesh.nodes_per_tet();
    write!(out, "\nCELLS {tets} {}\n", (nodes + 1) * tets)?;
    write_records(out, tets, |t, bytes| {
        bytes.extend_from_slice(&(nodes as u32).to_be_bytes());
        mesh.tet_nodes(t)[..nodes].iter().for_each(|v| bytes.extend_from_slice(&v.to_be_bytes()));
    })?;
    write!(out, "\nCELL_TYPES {tets}\n")?;
    write_records(out, tets, |_, bytes| {
        bytes.extend_from_slice(&u32::from(cell_type(mesh)).to_be_bytes())
    })?;
    write!(out, "\nCELL_DATA {tets}\nSCALARS label int 1\nLOOKUP_TABLE default\n")?;
    write_records(out, tets, |t, bytes| bytes.extend_from_slice(&mesh.labels[t].to_be_bytes()))?;
    out.write_all(b"\n")
}
