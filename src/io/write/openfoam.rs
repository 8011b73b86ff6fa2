//! OpenFOAM's polyMesh (OpenFOAM User Guide, "Mesh description"), ascii.
//!
//! The name of the file is that of ParaView's mark of a case, `case.foam`, an empty file; the mesh
//! lies beside it, in `constant/polyMesh`. Each region is a zone of cells. Each boundary to the
//! outside is a patch, each boundary between two regions a zone of faces, its faces flipped where
//! their normals point to its first label. Where the background was kept, the patch `outside` is
//! all around it.
//!
//! Cells are the tets in the order of the mesh. Inner faces come first, by the lower of their cells
//! and then by the other, which is the order that OpenFOAM wants; then those of the patches.
//! Normals point to the higher cell, or out of the mesh.

use std::io::{self, Write};
use std::path::Path;

use rayon::prelude::*;

use super::groups::Groups;
use super::output::{Output, in_folder};
use super::records::{push_floats, push_int, write_records};
use super::regions::{Boundaries, Regions};
use super::{WriteOptions, check_count, refuse_second_order};
use crate::delaunay::tet::FACET;
use crate::memory::{reserve, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::CancelFlag;
use crate::{Error, Result};

/// Numbers are signed and have 32 bits where programs were not built otherwise.
const MAX: usize = i32::MAX as usize;

/// Tets between two of the places where inner faces are counted.
const STEP: usize = 16;

/// The patch around the background.
const OUTSIDE: &str = "outside";

/// Writes the files of a case.
pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    refuse_second_order(mesh, path, "OpenFOAM's files")?;
    check_count(path, "OpenFOAM", "vertices", mesh.points.len(), MAX)?;
    check_count(path, "OpenFOAM", "tets", mesh.tets.len(), MAX / 4)?;
    let folder = path.parent().unwrap_or(Path::new("")).join("constant").join("polyMesh");
    in_folder(&folder, || write_into(mesh, options, path, &folder, cancel))
}

fn write_into(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    folder: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    let faces = Faces::new(mesh, options)?;
    let (inner, all) = (faces.inner(), faces.inner() + faces.outer.len());
    let (cells, points) = (mesh.tets.len(), mesh.points.len());
    let note = format!("nPoints:{points}  nCells:{cells}  nFaces:{all}  nInternalFaces:{inner}");
    let mut outputs = Vec::new();
    let mut file =
        |name: &str, class: &str, note: &str, fill: &dyn Fn(&mut Output<'_>) -> io::Result<()>| {
            let mut output = Output::create_among_others(&folder.join(name))?.watching(cancel);
            output.fill(|out| {
                write_head(out, options, name, class, note)?;
                fill(out)
            })?;
            outputs.push(output);
            Ok::<_, Error>(())
        };
    file("points", "vectorField", "", &|out| {
        write_list(out, points, points, |v, bytes| {
            bytes.push(b'(');
            push_floats(bytes, &mesh.points[v], b' ');
            bytes.extend_from_slice(b")\n");
        })
    })?;
    file("faces", "faceList", "", &|out| {
        writeln!(out, "{all}\n(")?;
        write_records(out, cells, |t, bytes| {
            higher(mesh, t).for_each(|(_, i)| push_face(bytes, side(mesh, t, i)));
        })?;
        write_records(out, faces.outer.len(), |f, bytes| {
            let Side { tet, facet } = faces.outer[f];
            push_face(bytes, side(mesh, tet as usize, facet as usize));
        })?;
        out.write_all(b")\n")
    })?;
    file("owner", "labelList", &note, &|out| {
        writeln!(out, "{all}\n(")?;
        write_records(out, cells, |t, bytes| {
            higher(mesh, t).for_each(|_| push_line(bytes, t as i64));
        })?;
        write_records(out, faces.outer.len(), |f, bytes| {
            push_line(bytes, faces.outer[f].tet.into());
        })?;
        out.write_all(b")\n")
    })?;
    file("neighbour", "labelList", &note, &|out| {
        write_list(out, inner, cells, |t, bytes| {
            higher(mesh, t).for_each(|(other, _)| push_line(bytes, other.into()));
        })
    })?;
    file("boundary", "polyBoundaryMesh", "", &|out| {
        writeln!(out, "{}\n(", faces.patches.len())?;
        let mut start = inner;
        for (name, count) in &faces.patches {
            write!(
                out,
                "    {name}\n    {{\n        type            patch;\n        nFaces          \
                 {count};\n        startFace       {start};\n    }}\n"
            )?;
            start += count;
        }
        out.write_all(b")\n")
    })?;
    file("cellZones", "regIOobject", "", &|out| {
        let zones = Groups::new(&mesh.labels).map_err(io::Error::other)?;
        writeln!(out, "{}\n(", zones.iter().len())?;
        for (label, tets) in zones.iter() {
            let name = faces.regions.name(label);
            write!(out, "{name}\n{{\n    type cellZone;\n    cellLabels List<label>\n")?;
            writeln!(out, "{}\n(", tets.len())?;
            tets.write_records(out, |_, t, bytes| push_line(bytes, t.into()))?;
            out.write_all(b")\n    ;\n}\n")?;
        }
        out.write_all(b")\n")
    })?;
    file("faceZones", "regIOobject", "", &|out| {
        writeln!(out, "{}\n(", faces.zones.len())?;
        for (name, facets) in &faces.zones {
            let count = facets.len();
            write!(out, "{name}\n{{\n    type faceZone;\n    faceLabels List<label>\n")?;
            write_list(out, count, count, |i, bytes| {
                push_line(bytes, faces.number(mesh.facet_tets[facets[i] as usize]) as i64);
            })?;
            out.write_all(b"    ;\n    flipMap List<bool>\n")?;
            write_list(out, count, count, |i, bytes| {
                let [first, second] = mesh.facet_tets[facets[i] as usize];
                push_line(bytes, (first > second).into());
            })?;
            out.write_all(b"    ;\n}\n")?;
        }
        out.write_all(b")\n")
    })?;
    outputs.push(Output::create(path)?);
    Output::commit(outputs)
}

fn write_head(
    out: &mut Output<'_>,
    options: &WriteOptions<'_>,
    object: &str,
    class: &str,
    note: &str,
) -> io::Result<()> {
    let note =
        if note.is_empty() { String::new() } else { format!("    note        \"{note}\";\n") };
    write!(
        out,
        "{}FoamFile\n{{\n    version     2.0;\n    format      ascii;\n    class       \
         {class};\n{note}    location    \"constant/polyMesh\";\n    object      {object};\n}}\n\n",
        options.space("// ", "\n")
    )
}

/// A list of `count` lines, made of so many records.
fn write_list(
    out: &mut Output<'_>,
    count: usize,
    records: usize,
    record: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    writeln!(out, "{count}\n(")?;
    write_records(out, records, record)?;
    out.write_all(b")\n")
}

fn push_line(bytes: &mut Vec<u8>, number: i64) {
    push_int(bytes, number);
    bytes.push(b'\n');
}

fn push_face(bytes: &mut Vec<u8>, [a, b, c]: [u32; 3]) {
    bytes.extend_from_slice(b"3(");
    push_int(bytes, a.into());
    bytes.push(b' ');
    push_int(bytes, b.into());
    bytes.push(b' ');
    push_int(bytes, c.into());
    bytes.extend_from_slice(b")\n");
}

/// Facet `i` of a tet, its normal pointing out of it.
fn side(mesh: &TetMesh, t: usize, i: usize) -> [u32; 3] {
    // FACET's normals point into the tet.
    let [a, b, c] = FACET[i].map(|j| mesh.tets[t][j]);
    [a, c, b]
}

/// The neighbours of a tet that have higher numbers, in increasing order, each with the index of
/// the facet between them.
fn higher(mesh: &TetMesh, t: usize) -> impl Iterator<Item = (u32, usize)> + use<> {
    let mut others = [0, 1, 2, 3].map(|i| (mesh.neighbors[t][i], i));
    others.sort_unstable();
    others.into_iter().filter(move |&(other, _)| other != NONE && other as usize > t)
}

/// A side of a tet.
#[derive(Clone, Copy)]
struct Side {
    tet: u32,
    facet: u32,
}

/// The faces of a mesh.
struct Faces<'m> {
    mesh: &'m TetMesh,
    regions: Regions,
    /// How many inner faces the tets before each `STEP`-th have.
    starts: Vec<u32>,
    /// Those on the outside, patch by patch.
    outer: Vec<Side>,
    /// Names of patches, and how many faces they have.
    patches: Vec<(String, usize)>,
    /// Names of boundaries between regions, and their facets.
    zones: Vec<(String, Vec<u32>)>,
}

/// What is counted where there is no memory.
const WHAT: &str = "faces of the mesh";

impl<'m> Faces<'m> {
    fn new(mesh: &'m TetMesh, options: &WriteOptions<'_>) -> Result<Self> {
        let regions = Regions::new(mesh, options);
        let boundaries = Boundaries::new(mesh, options, &regions)?;
        let mut starts: Vec<u32> = zeroed(mesh.tets.len().div_ceil(STEP) + 1, WHAT)?;
        starts[1..].par_iter_mut().enumerate().for_each(|(step, count)| {
            let tets = step * STEP..((step + 1) * STEP).min(mesh.tets.len());
            *count = tets.map(|t| higher(mesh, t).count() as u32).sum();
        });
        for step in 1..starts.len() {
            starts[step] += starts[step - 1];
        }
        let (mut outer, mut patches, mut zones) = (Vec::new(), Vec::new(), Vec::new());
        for (boundary, facets) in Groups::new(&boundaries.of_facets)?.iter() {
            let name = &boundaries.names[boundary as usize];
            let before = outer.len();
            let mut zone = Vec::new();
            for f in facets.iter() {
                let [tet, other] = mesh.facet_tets[f as usize];
                if other == NONE {
                    let corners = mesh.tets[tet as usize];
                    let opposite =
                        corners.iter().position(|v| !mesh.facets[f as usize].contains(v));
                    reserve(&mut outer, 1, WHAT)?;
                    outer.push(Side { tet, facet: opposite.unwrap_or(0) as u32 });
                } else {
                    reserve(&mut zone, 1, WHAT)?;
                    zone.push(f);
                }
            }
            if outer.len() > before {
                patches.push((name.clone(), outer.len() - before));
            }
            if !zone.is_empty() {
                zones.push((name.clone(), zone));
            }
        }
        let before = outer.len();
        for (t, (neighbors, &label)) in (0..).zip(mesh.neighbors.iter().zip(&mesh.labels)) {
            for (facet, _) in
                (0..).zip(neighbors).filter(|&(_, &other)| other == NONE && label == 0)
            {
                reserve(&mut outer, 1, WHAT)?;
                outer.push(Side { tet: t, facet });
            }
        }
        if outer.len() > before {
            patches.push((OUTSIDE.into(), outer.len() - before));
        }
        Ok(Self { mesh, regions, starts, outer, patches, zones })
    }

    /// How many faces are between two cells.
    fn inner(&self) -> usize {
        self.starts.last().map_or(0, |&count| count as usize)
    }

    /// The number of the face between two tets.
    fn number(&self, tets: [u32; 2]) -> usize {
        let (low, high) = (tets[0].min(tets[1]) as usize, tets[0].max(tets[1]));
        let step = low / STEP;
        let before: usize = (step * STEP..low).map(|t| higher(self.mesh, t).count()).sum();
        let rank = higher(self.mesh, low).position(|(other, _)| other == high);
        self.starts[step] as usize + before + rank.unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing::kuhn_box;

    #[test]
    fn faces_are_numbered_in_the_order_of_their_cells() {
        let mesh = kuhn_box([3, 2, 4], [1.0; 3], |i, _, k| [1, 2, 0][(i + k) % 3]);
        let faces = Faces::new(&mesh, &WriteOptions::default()).unwrap();
        let mut number = 0;
        for t in 0..mesh.tets.len() {
            for (other, i) in higher(&mesh, t) {
                assert_eq!(faces.number([other, t as u32]), number);
                assert_eq!(mesh.neighbors[t][i], other);
                number += 1;
            }
        }
        assert_eq!(faces.inner(), number);
        assert_eq!(2 * number + faces.outer.len(), 4 * mesh.tets.len());
        let of_patches: usize = faces.patches.iter().map(|(_, count)| count).sum();
        assert_eq!(of_patches, faces.outer.len());
        let names: Vec<&str> = faces.patches.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["label_1__background", "label_2__background", "outside"]);
    }
}
