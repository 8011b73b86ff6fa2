//! TetGen's .node, .ele and .face files (Si, "TetGen, a Delaunay-based quality tetrahedral mesh
//! generator", ACM TOMS 41, 2015; its manual, "File formats").
//!
//! Indices start at 0. The first attribute of a tet is its label; the boundary marker of a face is
//! the number of its pair of labels, listed in comment lines at the end of the .face file. TetGen
//! itself writes tets with (b - a) x (c - a) . (d - a) > 0, as ours are.

use std::io::Write;
use std::path::Path;

use super::output::Output;
use super::records::{push_float, push_int, push_ints, write_records};
use super::regions::{Boundaries, Regions};
use super::{WriteOptions, refuse_second_order};
use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;

/// Writes the three files that `path`, with any of their endings, stands for.
pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    refuse_second_order(mesh, path, "TetGen's files")?;
    let create = |ending: &str| Ok(Output::create(&path.with_extension(ending))?.watching(cancel));
    let (mut node, mut ele, mut face) = (create("node")?, create("ele")?, create("face")?);
    let space = options.space("# ", "\n");
    node.fill(|out| {
        writeln!(out, "{} 3 0 0", mesh.points.len())?;
        write_records(out, mesh.points.len(), |v, bytes| {
            push_int(bytes, v as i64);
            for &x in &mesh.points[v] {
                bytes.push(b' ');
                push_float(bytes, x);
            }
            bytes.push(b'\n');
        })?;
        out.write_all(space.as_bytes())
    })?;
    ele.fill(|out| {
        writeln!(out, "{} 4 1", mesh.tets.len())?;
        write_records(out, mesh.tets.len(), |t, bytes| {
            push_line(bytes, t, &mesh.tets[t], i64::from(mesh.labels[t]))
        })?;
        out.write_all(space.as_bytes())
    })?;
    let regions = Regions::new(mesh, options);
    let boundaries = Boundaries::new(mesh, options, &regions)?;
    face.fill(|out| {
        writeln!(out, "{} 1", mesh.facets.len())?;
        write_records(out, mesh.facets.len(), |f, bytes| {
            push_line(bytes, f, &mesh.facets[f], boundaries.number(f).into());
        })?;
        out.write_all((regions.comments() + &boundaries.comments()).as_bytes())?;
        out.write_all(space.as_bytes())
    })?;
    Output::commit(vec![node, ele, face])
}

/// Appends a line: number, vertices, mark.
fn push_line(bytes: &mut Vec<u8>, number: usize, vertices: &[u32], mark: i64) {
    push_int(bytes, number as i64);
    push_ints(bytes, vertices.iter().map(|&v| i64::from(v)).chain([mark]));
    bytes.push(b'\n');
}
