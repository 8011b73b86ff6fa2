//! VTK legacy file, version 4.2, binary (The VTK User's Guide, "Simple legacy formats").
//!
//! Version 4.2 rather than 5.1: every reader knows it. Its data are big-endian and its indices 32
//! bits wide; the five integers per tet and four per facet (eleven and seven in a mesh of second
//! order) are counted in 32 bits by some readers, which bounds the mesh. What the cells are and
//! what their arrays tell: [`cells`](super::cells).

use std::io::{self, Write};
use std::path::Path;

use super::WriteOptions;
use super::cells::Cells;
use super::output::Output;
use super::records::write_records;
use crate::error::shown;
use crate::mesh::TetMesh;
use crate::{Error, Result};

/// Whether the format can number what `mesh` has.
pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    let max = i32::MAX as usize;
    let (tets, facets) = (mesh.tets.len(), mesh.facets.len());
    let integers = (mesh.nodes_per_tet() + 1) * tets + (mesh.nodes_per_facet() + 1) * facets;
    if mesh.points.len() > max || integers > max {
        return Err(Error::LimitReached(format!(
            "{}: {} nodes, {tets} tets and {facets} facets are too many for a legacy VTK file; \
             .vtu has no such limit",
            shown(path),
            mesh.points.len(),
        )));
    }
    Ok(())
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let cells = Cells::new(mesh, options).map_err(io::Error::other)?;
    let (points, count) = (mesh.points.len(), cells.count());
    let space = options.space(" ", "");
    write!(
        out,
        "# vtk DataFile Version 4.2\nlapd mesh{space}\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
    )?;
    writeln!(out, "FIELD FieldData {}", cells.names().count())?;
    for (name, [number, dimension]) in cells.names() {
        writeln!(out, "{name} 1 2 int")?;
        out.write_all(&number.to_be_bytes())?;
        out.write_all(&dimension.to_be_bytes())?;
        out.write_all(b"\n")?;
    }
    writeln!(out, "POINTS {points} double")?;
    write_records(out, points, |v, bytes| {
        mesh.points[v].iter().for_each(|x| bytes.extend_from_slice(&x.to_be_bytes()));
    })?;
    write!(out, "\nCELLS {count} {}\n", count + cells.node_count())?;
    write_records(out, count, |c, bytes| {
        let nodes = cells.nodes(c);
        bytes.extend_from_slice(&(nodes.len() as u32).to_be_bytes());
        nodes.for_each(|v| bytes.extend_from_slice(&v.to_be_bytes()));
    })?;
    write!(out, "\nCELL_TYPES {count}\n")?;
    write_records(out, count, |c, bytes| {
        bytes.extend_from_slice(&u32::from(cells.kind(c)).to_be_bytes())
    })?;
    write!(out, "\nCELL_DATA {count}\nSCALARS label int 1\nLOOKUP_TABLE default\n")?;
    write_records(out, count, |c, bytes| bytes.extend_from_slice(&cells.label(c).to_be_bytes()))?;
    write!(out, "\nFIELD FieldData 2\nBoundaryLabels 2 {count} int\n")?;
    write_records(out, count, |c, bytes| {
        cells.labels(c).iter().for_each(|label| bytes.extend_from_slice(&label.to_be_bytes()));
    })?;
    write!(out, "\nboundary 1 {count} int\n")?;
    write_records(out, count, |c, bytes| {
        bytes.extend_from_slice(&cells.boundary(c).to_be_bytes())
    })?;
    out.write_all(b"\n")
}
