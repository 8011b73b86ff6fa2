//! Binary PLY of all interface facets, little-endian (Turk, "The PLY polygon file format",
//! Stanford, 1994).
//!
//! Every facet stands once; `first_label` and `second_label` are the labels behind and before it.
//! Where labels have colours, `red`, `green` and `blue` are those of the first label, grey for one
//! that has none.
//! Neighbouring facets share their vertices, and where more than two labels meet, an edge has more
//! than two facets.

use std::io::{self, Write};

use super::WriteOptions;
use super::groups::distinct;
use super::output::Output;
use super::records::{write_ranges, write_records};
use super::subset::Subset;
use crate::mesh::TetMesh;

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let vertices = Subset::of_surface(mesh).map_err(io::Error::other)?;
    let color_of = |label| options.names.and_then(|names| names.get(label)?.color);
    let has_colors =
        distinct(mesh.labels.iter().copied()).into_iter().any(|label| color_of(label).is_some());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\n\
         comment interfaces of a lapd mesh, normals point from first_label to second_label\n{}\
         element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\n\
         property int first_label\nproperty int second_label\n{}end_header\n",
        options.space("comment ", "\n"),
        vertices.len(),
        mesh.facets.len(),
        if has_colors {
            "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        } else {
            ""
        }
    )?;
    write_ranges(out, vertices.len(), |range, bytes| {
        let coordinates = vertices.range(range).flat_map(|v| mesh.points[v as usize]);
        coordinates.for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
    })?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        bytes.push(3);
        for v in mesh.facets[f] {
            bytes.extend_from_slice(&vertices.place(v).to_le_bytes());
        }
        mesh.facet_labels[f].iter().for_each(|label| bytes.extend_from_slice(&label.to_le_bytes()));
        if has_colors {
            bytes.extend_from_slice(&color_of(mesh.facet_labels[f][0]).unwrap_or([128; 3]));
        }
    })
}
