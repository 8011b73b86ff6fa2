//! OFF of all interface facets, ascii (Geomview manual, "OFF files").
//!
//! Every facet stands once, vertices are shared. The format has no place for labels; the order of
//! facets is the mesh's.

use std::io::{self, Write};

use super::WriteOptions;
use super::output::Output;
use super::records::{push_floats, push_ints, write_ranges, write_records};
use super::subset::Subset;
use crate::mesh::TetMesh;

pub(super) fn write(mesh: &TetMesh, _: &WriteOptions, out: &mut Output) -> io::Result<()> {
    let vertices = Subset::of_surface(mesh).map_err(io::Error::other)?;
    write!(out, "OFF\n{} {} 0\n", vertices.len(), mesh.facets.len())?;
    write_ranges(out, vertices.len(), |range, bytes| {
        for v in vertices.range(range) {
            push_floats(bytes, &mesh.points[v as usize], b' ');
            bytes.push(b'\n');
        }
    })?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        bytes.push(b'3');
        push_ints(bytes, mesh.facets[f].map(|v| vertices.place(v).into()));
        bytes.push(b'\n');
    })
}
