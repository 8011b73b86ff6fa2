//! VTK XML multi-block ("VTK file formats", XML file formats): an index, `mesh.vtm`, and a folder
//! of the same name beside it, `mesh`, of a VTU file for each region and each boundary.
//!
//! The index has two blocks, `regions` and `boundaries`, and in them a grid each, by name; its file
//! is called the same. A grid has the points of its own cells alone. Its cell arrays are those of
//! [`cells`](super::cells), and so is its field data: its name, its number and dimension, and what
//! the world axes mean.
//!
//! The index takes its name last: what it refers to is always there. Files of other names that are
//! in the folder stay there.
//!
//! Memory: beside the mesh, 2 bits per point, and what the groups take (see `groups`).

use std::io::{self, Write};
use std::path::Path;

use super::WriteOptions;
use super::cells::{TETRA, TRIANGLE};
use super::groups::{Groups, Keyed, Members};
use super::output::{Finished, Output, in_folder};
use super::regions::{Boundaries, Regions};
use super::subset::Subset;
use super::vtu::{Array, BOUNDARY, ENDS, Encoders, Grid, KINDS, LABEL, LABELS, NODES, POINTS};
use super::xml::told_name;
use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;

/// Writes the index and the files that it refers to.
pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    let folder = path.with_extension("");
    let told = told_name(&folder, path)?;
    let mut index = Output::create(path)?.watching(cancel);
    in_folder(&folder, || {
        let regions = Regions::new(mesh, options);
        let boundaries = Boundaries::new(mesh, options, &regions)?;
        let encoders = Encoders::default();
        let blocks = Blocks { mesh, options, folder: &folder, cancel, encoders: &encoders };
        let order = usize::from(mesh.mid_nodes.is_some());
        let mut files = Vec::new();
        for (label, tets) in Groups::new(&mesh.labels)?.iter() {
            let block = Block {
                name: regions.name(label),
                number: [label, 3],
                labels: [label; 2],
                boundary: 0,
                kind: TETRA[order],
                width: mesh.nodes_per_tet(),
            };
            let nodes = |t: u32| mesh.nodes_of_tet(t);
            files.push(blocks.write(&block, &tets, &nodes)?);
        }
        for (b, (boundary, facets)) in Groups::new(&boundaries)?.iter().enumerate() {
            let block = Block {
                name: &boundaries.names[b],
                number: [b as i32 + 1, 2],
                labels: boundary.labels,
                boundary: b as i32 + 1,
                kind: TRIANGLE[order],
                width: mesh.nodes_per_facet(),
            };
            let nodes = |f: u32| mesh.nodes_of_facet(f);
            files.push(blocks.write(&block, &facets, &nodes)?);
        }
        index.fill(|out| write_index(&regions, &boundaries, &told, out))?;
        files.push(index.finish()?);
        Finished::commit(files)
    })
}

/// A region or a boundary.
struct Block<'a> {
    name: &'a str,
    /// Its number, and its dimension.
    number: [i32; 2],
    /// What the cell arrays say of all its cells.
    labels: [i32; 2],
    boundary: i32,
    /// The type of its cells, and how many nodes each has.
    kind: u8,
    width: usize,
}

/// What all blocks need.
struct Blocks<'a> {
    mesh: &'a TetMesh,
    options: &'a WriteOptions<'a>,
    folder: &'a Path,
    cancel: Option<&'a CancelFlag>,
    encoders: &'a Encoders,
}

impl Blocks<'_> {
    /// Writes the file of a block, whose cells are `members` with these nodes.
    fn write<I: Keyed, N: Iterator<Item = u32>>(
        &self,
        block: &Block<'_>,
        members: &Members<'_, I>,
        nodes: &(impl Fn(u32) -> N + Sync),
    ) -> Result<Finished> {
        let &Block { name, number, labels, boundary, kind, width } = block;
        let points = Subset::new(self.mesh.points.len(), members.iter().flat_map(nodes))?;
        let cells = members.len();
        let of_cells = vec![
            Array::new(LABEL, cells, |_| labels[0].to_le_bytes()),
            Array::new(LABELS, 2 * cells, |i| labels[i % 2].to_le_bytes()),
            Array::new(BOUNDARY, cells, |_| boundary.to_le_bytes()),
        ];
        let coordinates = Array::of_ranges::<8>(POINTS, 3 * points.len(), |range, bytes| {
            let (first, count) = (range.start % 3, range.len());
            let points = points.range(range.start / 3..range.end.div_ceil(3));
            let coordinates = points.flat_map(|v| self.mesh.points[v as usize]);
            coordinates.skip(first).take(count).for_each(|x| bytes.extend(x.to_le_bytes()));
        });
        let places = Array::of_ranges::<8>(NODES, width * cells, |range, bytes| {
            let (first, count) = (range.start % width, range.len());
            let members = members.range(range.start / width..range.end.div_ceil(width));
            let nodes = members.flat_map(nodes).skip(first).take(count);
            nodes.for_each(|v| bytes.extend(i64::from(points.place(v)).to_le_bytes()));
        });
        let of_nodes = vec![
            places,
            Array::new(ENDS, cells, |c| ((c + 1) as i64 * width as i64).to_le_bytes()),
            Array::new(KINDS, cells, |_| [kind]),
        ];
        let of_points = vec![coordinates];
        let grid = Grid { points: points.len(), cells, of_cells, of_points, of_nodes };
        let path = self.folder.join(format!("{name}.vtu"));
        let mut output = Output::create_among_others(&path)?.watching(self.cancel);
        let names = [(name, number)].into_iter();
        output.fill(|out| grid.write(self.options, names, self.encoders, out))?;
        output.finish()
    }
}

/// Writes the index of the files in the folder.
fn write_index(
    regions: &Regions,
    boundaries: &Boundaries<'_>,
    folder: &str,
    out: &mut Output,
) -> io::Result<()> {
    out.write_all(
        b"<?xml version=\"1.0\"?>\n<VTKFile type=\"vtkMultiBlockDataSet\" version=\"1.0\" \
          byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<vtkMultiBlockDataSet>\n",
    )?;
    let mut number = 0;
    let mut group = |title: &str, names: &mut dyn Iterator<Item = &str>| {
        writeln!(out, "<Block index=\"{number}\" name=\"{title}\">")?;
        for (i, name) in names.enumerate() {
            let file = format!("{folder}/{name}.vtu");
            writeln!(out, "<DataSet index=\"{i}\" name=\"{name}\" file=\"{file}\"/>")?;
        }
        number += 1;
        writeln!(out, "</Block>")
    };
    group("regions", &mut regions.iter().map(|(_, name)| name))?;
    group("boundaries", &mut boundaries.names.iter().map(|name| &**name))?;
    out.write_all(b"</vtkMultiBlockDataSet>\n</VTKFile>\n")
}
