//! XDMF with HDF5 (xdmf.org, "XDMF Model and Format", version 3): a small XML file that describes
//! the arrays of an HDF5 file of the same name beside it, `mesh.xdmf` and `mesh.h5`.
//!
//! Two grids share the points: `mesh` of the tets, with the attribute `label`, and `boundaries` of
//! the interface facets, with `boundary`, their number, and `BoundaryLabels`. Each grid lists its
//! names as elements `Information`: the number, and what it stands for. DOLFINx reads the mesh and
//! both sets of tags by the names of the grids; it takes the first attribute, so numbers stand
//! first. ParaView shows both grids.
//!
//! Arrays are contiguous and not compressed. They are written in batches, by the HDF5 library, into
//! a temporary file that takes its name in the end, the XML file last: what it names is always
//! there.

use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

use hdf5_metno as hdf5;
use ndarray::{Array2, s};

use super::WriteOptions;
use super::output::Output;
use super::regions::{Boundaries, Regions};
use crate::error::shown;
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;
use crate::{Error, Result};

/// Rows that are handed to HDF5 at once.
const BATCH: usize = 1 << 15;

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
    let name = data.file_name().and_then(|name| name.to_str()).filter(|_| path.to_str().is_some());
    // Readers take what is behind a colon for the name of an array, and leave out blanks at ends.
    let is_told =
        |name: &&str| name.trim() == *name && !name.contains(|c: char| c == ':' || c.is_control());
    let name = name.filter(is_told).ok_or_else(|| {
        Error::InvalidArgument(format!(
            "{}: the name of the HDF5 file stands in the XML file, so it must be UTF-8, without \
             colons, control characters, and blanks at its ends",
            shown(path)
        ))
    })?;
    let arrays = Output::create(&data)?.watching(cancel);
    arrays.by_path(|temporary| write_arrays(mesh, &boundaries, temporary, cancel)).map_err(
        |error| match error {
            Failure::Ours(error) => error,
            Failure::Hdf5(error) => Error::io(&data, io::Error::other(said(&error.to_string()))),
        },
    )?;
    let mut text = Output::create(path)?.watching(cancel);
    text.fill(|out| write_text(mesh, options, &regions, &boundaries, name, out))?;
    Output::commit(vec![arrays, text])
}

enum Failure {
    Ours(Error),
    Hdf5(hdf5::Error),
}

impl From<hdf5::Error> for Failure {
    fn from(error: hdf5::Error) -> Self {
        Self::Hdf5(error)
    }
}

/// Writes the arrays into an HDF5 file.
fn write_arrays(
    mesh: &TetMesh,
    boundaries: &Boundaries,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> std::result::Result<(), Failure> {
    let file = hdf5::File::create(path)?;
    let (tets, facets) = (mesh.tets.len(), mesh.facets.len());
    let (of_tet, of_facet) = (mesh.nodes_per_tet(), mesh.nodes_per_facet());
    let rows = Rows { file: &file, cancel };
    rows.write("points", mesh.points.len(), 3, |i, row| row.copy_from_slice(&mesh.points[i]))?;
    rows.write("tets", tets, of_tet, |t, row| row.copy_from_slice(&mesh.tet_nodes(t)[..of_tet]))?;
    rows.write("label", tets, 1, |t, row| row[0] = mesh.labels[t])?;
    rows.write("facets", facets, of_facet, |f, row| {
        row.copy_from_slice(&mesh.facet_nodes(f)[..of_facet]);
    })?;
    rows.write("boundary", facets, 1, |f, row| row[0] = boundaries.number(f) as i32)?;
    rows.write("BoundaryLabels", facets, 2, |f, row| row.copy_from_slice(&mesh.facet_labels[f]))?;
    // Dropping the file would keep its error to itself.
    file.flush()?;
    Ok(file.close()?)
}

/// Where arrays go.
struct Rows<'a> {
    file: &'a hdf5::File,
    cancel: Option<&'a CancelFlag>,
}

impl Rows<'_> {
    /// Writes an array of `count` rows.
    fn write<T: hdf5::H5Type + Copy + Default>(
        &self,
        name: &str,
        count: usize,
        width: usize,
        fill: impl Fn(usize, &mut [T]),
    ) -> std::result::Result<(), Failure> {
        let set = self.file.new_dataset::<T>().shape((count, width)).create(name)?;
        let batches = (0..count).step_by(BATCH).map(|at| at..count.min(at + BATCH));
        batches.into_iter().try_for_each(|range: Range<usize>| {
            if self.cancel.is_some_and(CancelFlag::is_cancelled) {
                return Err(Failure::Ours(Error::Cancelled));
            }
            let mut batch = Array2::<T>::default((range.len(), width));
            for (mut row, i) in batch.rows_mut().into_iter().zip(range.clone()) {
                fill(i, row.as_slice_mut().unwrap_or_default());
            }
            Ok(set.write_slice(&batch, s![range, ..])?)
        })
    }
}

/// What the system said, where HDF5 tells it among addresses and the names of temporary files.
fn said(message: &str) -> &str {
    let behind = message.split_once("error message = '").map(|(_, behind)| behind);
    behind.and_then(|behind| behind.split_once('\'')).map_or(message, |(said, _)| said)
}

/// Text as XML takes it. Names of regions and boundaries have nothing to escape.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Writes what the arrays are.
fn write_text(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    regions: &Regions,
    boundaries: &Boundaries,
    data: &str,
    out: &mut Output,
) -> io::Result<()> {
    let data = escaped(data);
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
