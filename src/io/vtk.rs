//! VTK legacy file, version 4.2, binary (The VTK User's Guide, "Simple legacy formats").
//!
//! Version 4.2 rather than 5.1: every reader knows it. Its data are big-endian and its indices 32 bits wide; the five integers per tet
//! are counted in 32 bits by some readers, which bounds the tets.

use std::io::{self, Write};
use std::path::Path;

use super::output::Output;
use super::records::write_records;
use crate::mesh::TetMesh;
use crate::{Error, Result};

/// VTK's cell type of a tet.
pub(super) const TETRA: u8 = 10;

/// Whether the format can number what `mesh` has.
pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    let most = i32::MAX as usize;
    if mesh.points.len() > most || mesh.tets.len() > most / 5 {
        return Err(Error::LimitReached(format!(
            "{}: {} vertices and {} tets are too many for a legacy VTK file (2147483647 and 429496729); .vtu has no such limit",
            path.display(),
            mesh.points.len(),
            mesh.tets.len()
        )));
    }
    Ok(())
}

pub(super) fn write(mesh: &TetMesh, out: &mut Output) -> io::Result<()> {
    let (points, tets) = (mesh.points.len(), mesh.tets.len());
    write!(out, "# vtk DataFile Version 4.2\nlapd mesh\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {points} double\n")?;
    write_records(out, points, |v, bytes| {
        mesh.points[v].iter().for_each(|x| bytes.extend_from_slice(&x.to_be_bytes()));
    })?;
    write!(out, "\nCELLS {tets} {}\n", 5 * tets)?;
    write_records(out, tets, |t, bytes| {
        bytes.extend_from_slice(&4u32.to_be_bytes());
        mesh.tets[t].iter().for_each(|v| bytes.extend_from_slice(&v.to_be_bytes()));
    })?;
    write!(out, "\nCELL_TYPES {tets}\n")?;
    write_records(out, tets, |_, bytes| bytes.extend_from_slice(&u32::from(TETRA).to_be_bytes()))?;
    write!(out, "\nCELL_DATA {tets}\nSCALARS label int 1\nLOOKUP_TABLE default\n")?;
    write_records(out, tets, |t, bytes| bytes.extend_from_slice(&mesh.labels[t].to_be_bytes()))?;
    out.write_all(b"\n")
}
