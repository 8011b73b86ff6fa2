//! XDMF with HDF5 (xdmf.org, "XDMF Model and Format", version 3): a small XML file that describes
//! the arrays of an HDF5 file of the same name beside it, `mesh.xdmf` and `mesh.h5`.
//!
//! Two grids share the points: `mesh` of the tets, with the attribute `label`, and `boundaries` of
//! the interface facets, with `boundary`, their number, and `BoundaryLabels`. Each grid lists its
//! names as elements `Information`: the number, and what it stands for. DOLFINx reads the mesh and
//! both sets of tags by the names of the grids; it takes the first attribute, so numbers stand
//! first. ParaView shows both grids.
//!
//! How arrays are written: [`hdf`](super::hdf). The XML file takes its name last: what it names is
//! always there.

use std::io::{self, Write};
use std::path::Path;

use super::WriteOptions;
use super::hdf::{Arrays, Failure, write_file};
use super::output::Output;
use super::regions::{Boundaries, Regions};
use super::xml::told_name;
use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;

/// Writes both files.
pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    let regions = Regions::new(mesh, options);
    let boundaries = Boundaries::new(mesh, options, &regions)?;
    let data = path.with_extension("h5");
    let name = told_name(&data, path)?;
    let arrays = write_file(&data, cancel, |arrays| fill(mesh, &boundaries, arrays))?;
    let mut text = Output::create(path)?.watching(cancel);
    text.fill(|out| write_text(mesh, options, &regions, &boundaries, &name, out))?;
    Output::commit(vec![arrays, text])
}

/// Writes the arrays into an HDF5 file.
fn fill(
    mesh: &TetMesh,
    boundaries: &Boundaries<'_>,
    to: &Arrays<'_>,
) -> std::result::Result<(), Failure> {
    let (tets, facets) = (mesh.tets.len(), mesh.facets.len());
    let (of_tet, of_facet) = (mesh.nodes_per_tet(), mesh.nodes_per_facet());
    to.rows("points", mesh.points.len(), 3, |i, row| row.copy_from_slice(&mesh.points[i]))?;
    to.rows("tets", tets, of_tet, |t, row| row.copy_from_slice(&mesh.tet_nodes(t)[..of_tet]))?;
    to.rows("label", tets, 1, |t, row| row[0] = mesh.labels[t])?;
    to.rows("facets", facets, of_facet, |f, row| {
        row.copy_from_slice(&mesh.facet_nodes(f)[..of_facet]);
    })?;
    to.rows("boundary", facets, 1, |f, row| row[0] = boundaries.number(f) as i32)?;
    to.rows("BoundaryLabels", facets, 2, |f, row| row.copy_from_slice(&mesh.facet_labels[f]))
}

/// Writes what the arrays are.
fn write_text(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    regions: &Regions,
    boundaries: &Boundaries<'_>,
    data: &str,
    out: &mut Output,
) -> io::Result<()> {
    let item = |name: &str, kind: &str, rows: usize, width: usize| {
        format!(
            "<DataItem Dimensions=\"{rows} {width}\" {kind} Format=\"HDF\">{data}:/{name}\
             </DataItem>"
        )
    };
    const REAL: &str = "NumberType=\"Float\" Precision=\"8\"";
    const NODE: &str = "NumberType=\"UInt\" Precision=\"4\"";
    const INT: &str = "NumberType=\"Int\" Precision=\"4\"";
    let order = usize::from(mesh.mid_nodes.is_some());
    let tet = ["Tetrahedron", "Tetrahedron_10"][order];
    let triangle = ["Triangle", "Triangle_6"][order];
    let (tets, facets) = (mesh.tets.len(), mesh.facets.len());
    let points = item("points", REAL, mesh.points.len(), 3);
    writeln!(out, "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>")?;
    if let Some(world) = options.world {
        writeln!(out, "<Information Name=\"SPACE\" Value=\"{}\"/>", world.name())?;
    }
    let mut grid = |name: &str,
                    kind: &str,
                    nodes: String,
                    count: usize,
                    names: &mut dyn Iterator<Item = (i32, &str)>,
                    attributes: &[(&str, usize)]| {
        writeln!(out, "<Grid Name=\"{name}\" GridType=\"Uniform\">")?;
        for (number, name) in names {
            writeln!(out, "<Information Name=\"{number}\" Value=\"{name}\"/>")?;
        }
        writeln!(
            out,
            "<Topology TopologyType=\"{kind}\" NumberOfElements=\"{count}\">{nodes}</Topology>"
        )?;
        writeln!(out, "<Geometry GeometryType=\"XYZ\">{points}</Geometry>")?;
        for &(name, width) in attributes {
            let kind = if width == 1 { "Scalar" } else { "Matrix" };
            let item = item(name, INT, count, width);
            writeln!(
                out,
                "<Attribute Name=\"{name}\" AttributeType=\"{kind}\" Center=\"Cell\">{item}\
                 </Attribute>"
            )?;
        }
        writeln!(out, "</Grid>")
    };
    let nodes = item("tets", NODE, tets, mesh.nodes_per_tet());
    grid("mesh", tet, nodes, tets, &mut regions.iter(), &[("label", 1)])?;
    let nodes = item("facets", NODE, facets, mesh.nodes_per_facet());
    let names = &mut boundaries.names.iter().zip(1..).map(|(name, number)| (number, &**name));
    let attributes = [("boundary", 1), ("BoundaryLabels", 2)];
    grid("boundaries", triangle, nodes, facets, names, &attributes)?;
    writeln!(out, "</Domain>\n</Xdmf>")
}
