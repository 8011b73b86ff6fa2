//! OFF of all interface facets, ascii (Geomview manual, "OFF files").
//!
//! Every facet stands once, vertices are shared. The format has no place for labels; the order of
//! facets is the mesh's.

use std::io::{self, Write};

use super::WriteOptions;
use super::output::Output;
use super::records::{push_float, push_ints, write_records};
use super::surface::SurfaceVertices;
use crate::mesh::TetMesh;

pub(super) fn write(mesh: &TetMesh, _: &WriteOptions, out: &mut Output) -> io::Result<()> {
    let vertices = SurfaceVertices::new(mesh).map_err(io::Error::other)?;
    write!(out, "OFF\n{} {} 0\n", vertices.used.len(), mesh.facets.len())?;
    write_records(out, vertices.used.len(), |i, bytes| {
        let [x, y, z] = mesh.points[vertices.used[i] as usize];
        push_float(bytes, x);
        for coordinate in [y, z] {
            bytes.push(b' ');
            push_float(bytes, coordinate);
        }
        bytes.push(b'\n');
    })?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        bytes.push(b'3');
        push_ints(bytes, vertices.facet(&mesh.facets[f]).map(i64::from));
        bytes.push(b'\n');
    })
}
