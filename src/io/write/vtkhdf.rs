//! VTKHDF (docs.vtk.org, "VTKHDF file format"), an unstructured grid of version 1.0, which VTK 9.1,
//! ParaView 5.10 and later ones read: the same cells and arrays as in VTU, in one HDF5 file.
//!
//! What the cells are and what their arrays tell: [`cells`](super::cells). Names of regions and
//! boundaries are field data, and so is what the world axes mean, as codes of characters.

use std::path::Path;

use super::WriteOptions;
use super::cells::Cells;
use super::hdf::{Arrays, Failure, write_file};
use super::output::Output;
use super::regions::SPACE;
use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;

/// The type of the data.
const TYPE: &[u8; 16] = b"UnstructuredGrid";

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    let cells = Cells::new(mesh, options)?;
    let output = write_file(path, cancel, |root| fill(mesh, options, &cells, root))?;
    Output::commit(vec![output])
}

fn fill(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    cells: &Cells<'_>,
    root: &Arrays<'_>,
) -> std::result::Result<(), Failure> {
    let (points, count, nodes) = (mesh.points.len(), cells.count(), cells.node_count());
    let top = root.within("VTKHDF")?;
    top.attribute("Version", &[1_i64, 0])?;
    top.text_attribute("Type", TYPE)?;
    // One piece.
    for (name, number) in
        [("NumberOfPoints", points), ("NumberOfCells", count), ("NumberOfConnectivityIds", nodes)]
    {
        top.list(name, 1, |_| number as i64)?;
    }
    top.rows("Points", points, 3, |v, row| row.copy_from_slice(&mesh.points[v]))?;
    top.list("Connectivity", nodes, |i| i64::from(cells.node(i)))?;
    top.list("Offsets", count + 1, |c| c.checked_sub(1).map_or(0, |c| cells.end(c)))?;
    top.list("Types", count, |c| cells.kind(c))?;
    let of_cells = top.within("CellData")?;
    of_cells.list("label", count, |c| cells.label(c))?;
    of_cells.rows("BoundaryLabels", count, 2, |c, row| row.copy_from_slice(&cells.labels(c)))?;
    of_cells.list("boundary", count, |c| cells.boundary(c))?;
    let of_file = top.within("FieldData")?;
    if let Some(world) = options.world {
        let name = world.name().as_bytes();
        of_file.list(SPACE, name.len(), |i| name[i])?;
    }
    cells.names().try_for_each(|(name, numbers)| of_file.list(name, 2, |i| numbers[i]))
}
