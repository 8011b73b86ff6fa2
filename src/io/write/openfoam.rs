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
//!
//! Memory: beside the mesh, a quarter of a byte per tet, and what the groups take (see `groups`).

use std::io::{self, Write};
use std::path::Path;

use rayon::prelude::*;

use super::groups::{Groups, Keyed};
use super::output::{Finished, Output, in_folder};
use super::records::{push_floats, push_int, write_records};
use super::regions::{Boundaries, Boundary, Regions};
use super::{WriteOptions, check_count, refuse_second_order};
use crate::delaunay::tet::FACET;
use crate::memory::zeroed;
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
    let regions = Regions::new(mesh, options);
    let boundaries = Boundaries::new(mesh, options, &regions)?;
    let sides = Sides { mesh, boundaries: &boundaries };
    let groups = Groups::new(&sides)?;
    let named = |is_inner: bool| {
        let of_kind = groups.iter().filter(move |&((kind, _), _)| kind == is_inner);
        of_kind.map(|((_, boundary), facets)| (boundaries.name(&boundary), facets))
    };
    let faces = InnerFaces::new(mesh)?;
    let inner = faces.count();
    let around: usize = (0..mesh.tets.len()).map(|t| outside(mesh, t).count()).sum();
    let outer = named(false).map(|(_, facets)| facets.len()).sum::<usize>() + around;
    let all = inner + outer;
    let (cells, points) = (mesh.tets.len(), mesh.points.len());
    let note = format!("nPoints:{points}  nCells:{cells}  nFaces:{all}  nInternalFaces:{inner}");
    let mut files = Vec::new();
    let mut file =
        |name: &str, class: &str, note: &str, fill: &dyn Fn(&mut Output<'_>) -> io::Result<()>| {
            let mut output = Output::create_among_others(&folder.join(name))?.watching(cancel);
            output.fill(|out| {
                write_head(out, options, name, class, note)?;
                fill(out)
            })?;
            files.push(output.finish()?);
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
        for (_, facets) in named(false) {
            facets.write_records(out, |_, f, bytes| push_face(bytes, outward(mesh, f as usize)))?;
        }
        write_records(out, cells, |t, bytes| {
            outside(mesh, t).for_each(|i| push_face(bytes, side(mesh, t, i)));
        })?;
        out.write_all(b")\n")
    })?;
    file("owner", "labelList", &note, &|out| {
        writeln!(out, "{all}\n(")?;
        write_records(out, cells, |t, bytes| {
            higher(mesh, t).for_each(|_| push_line(bytes, t as i64));
        })?;
        for (_, facets) in named(false) {
            facets.write_records(out, |_, f, bytes| {
                push_line(bytes, mesh.facet_tets[f as usize][0].into());
            })?;
        }
        write_records(out, cells, |t, bytes| {
            outside(mesh, t).for_each(|_| push_line(bytes, t as i64));
        })?;
        out.write_all(b")\n")
    })?;
    file("neighbour", "labelList", &note, &|out| {
        write_list(out, inner, cells, |t, bytes| {
            higher(mesh, t).for_each(|(other, _)| push_line(bytes, other.into()));
        })
    })?;
    file("boundary", "polyBoundaryMesh", "", &|out| {
        let of_boundaries = named(false).map(|(name, facets)| (name, facets.len()));
        let around = (around > 0).then_some((OUTSIDE, around));
        let patches: Vec<(&str, usize)> = of_boundaries.chain(around).collect();
        writeln!(out, "{}\n(", patches.len())?;
        let mut start = inner;
        for (name, count) in patches {
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
            let name = regions.name(label);
            write!(out, "{name}\n{{\n    type cellZone;\n    cellLabels List<label>\n")?;
            writeln!(out, "{}\n(", tets.len())?;
            tets.write_records(out, |_, t, bytes| push_line(bytes, t.into()))?;
            out.write_all(b")\n    ;\n}\n")?;
        }
        out.write_all(b")\n")
    })?;
    file("faceZones", "regIOobject", "", &|out| {
        writeln!(out, "{}\n(", named(true).count())?;
        for (name, facets) in named(true) {
            let count = facets.len();
            write!(
                out,
                "{name}\n{{\n    type faceZone;\n    faceLabels List<label>\n{count}\n(\n"
            )?;
            facets.write_records(out, |_, f, bytes| {
                push_line(bytes, faces.number(mesh.facet_tets[f as usize]) as i64);
            })?;
            write!(out, ")\n    ;\n    flipMap List<bool>\n{count}\n(\n")?;
            facets.write_records(out, |_, f, bytes| {
                let [first, second] = mesh.facet_tets[f as usize];
                push_line(bytes, (first > second).into());
            })?;
            out.write_all(b")\n    ;\n}\n")?;
        }
        out.write_all(b")\n")
    })?;
    files.push(Output::create(path)?.finish()?);
    Finished::commit(files)
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

/// The facets of a tet of the background that are on the outside.
fn outside(mesh: &TetMesh, t: usize) -> impl Iterator<Item = usize> + use<> {
    let neighbors = if mesh.labels[t] == 0 { mesh.neighbors[t] } else { [t as u32; 4] };
    (0..4).filter(move |&i| neighbors[i] == NONE)
}

/// An interface facet on the outside, its normal pointing out of the mesh.
fn outward(mesh: &TetMesh, f: usize) -> [u32; 3] {
    let t = mesh.facet_tets[f][0] as usize;
    let opposite = mesh.tets[t].iter().position(|v| !mesh.facets[f].contains(v));
    side(mesh, t, opposite.unwrap_or(0))
}

/// Interface facets by whether they are between two tets, then by their boundaries: those of
/// patches, then those of zones.
struct Sides<'a> {
    mesh: &'a TetMesh,
    boundaries: &'a Boundaries<'a>,
}

impl Keyed for Sides<'_> {
    type Key = (bool, Boundary);

    fn count(&self) -> usize {
        self.boundaries.count()
    }

    fn key(&self, f: usize) -> (bool, Boundary) {
        (self.mesh.facet_tets[f][1] != NONE, self.boundaries.key(f))
    }
}

/// The faces between two tets, numbered.
struct InnerFaces<'m> {
    mesh: &'m TetMesh,
    /// How many of them the tets before each `STEP`-th have.
    starts: Vec<u32>,
}

impl<'m> InnerFaces<'m> {
    fn new(mesh: &'m TetMesh) -> Result<Self> {
        let mut starts: Vec<u32> = zeroed(mesh.tets.len().div_ceil(STEP) + 1, "faces of the mesh")?;
        starts[1..].par_iter_mut().enumerate().for_each(|(step, count)| {
            let tets = step * STEP..((step + 1) * STEP).min(mesh.tets.len());
            *count = tets.map(|t| higher(mesh, t).count() as u32).sum();
        });
        for step in 1..starts.len() {
            starts[step] += starts[step - 1];
        }
        Ok(Self { mesh, starts })
    }

    /// How many there are.
    fn count(&self) -> usize {
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
        let faces = InnerFaces::new(&mesh).unwrap();
        let mut number = 0;
        for t in 0..mesh.tets.len() {
            for (other, i) in higher(&mesh, t) {
                assert_eq!(faces.number([other, t as u32]), number);
                assert_eq!(mesh.neighbors[t][i], other);
                number += 1;
            }
        }
        assert_eq!(faces.count(), number);
    }

    #[test]
    fn patches_have_all_outer_faces() {
        let mesh = kuhn_box([3, 2, 4], [1.0; 3], |i, _, k| [1, 2, 0][(i + k) % 3]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.foam");
        write(&mesh, &WriteOptions::default(), &path, None).unwrap();
        let read =
            |name| std::fs::read_to_string(folder.path().join("constant/polyMesh").join(name));
        let patches = read("boundary").unwrap();
        let after = |key: &str| -> Vec<&str> {
            let of_key = patches.lines().filter_map(|line| line.trim().strip_prefix(key));
            of_key.map(|value| value.trim().trim_end_matches(';')).collect()
        };
        let counts: Vec<usize> = after("nFaces").iter().map(|n| n.parse().unwrap()).collect();
        let starts: Vec<usize> = after("startFace").iter().map(|n| n.parse().unwrap()).collect();
        let inner = InnerFaces::new(&mesh).unwrap().count();
        assert_eq!(2 * inner + counts.iter().sum::<usize>(), 4 * mesh.tets.len());
        assert_eq!(starts, [inner, inner + counts[0], inner + counts[0] + counts[1]]);
        let names: Vec<&str> = patches
            .lines()
            .map(str::trim)
            .filter(|line| line.starts_with(['l', 'o']))
            .filter(|line| !line.ends_with(';'))
            .collect();
        assert_eq!(names, ["label_1__background", "label_2__background", "outside"]);
    }
}
