//! Binary STL of all interface facets (3D Systems, StereoLithography Interface Specification,
//! 1989).
//!
//! One solid with every facet once. Normals point from the facet's first label to its second one:
//! outwards on the outside of the object, from the larger label to the smaller one inside. STL has
//! no place for labels, and single precision only.

use std::io::{self, Write};

use super::WriteOptions;
use super::output::Output;
use super::records::write_records;
use crate::mesh::TetMesh;

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let mut header = [b' '; 80];
    // It must not begin with "solid", which marks ascii.
    let text = format!("binary STL: interfaces of a lapd mesh{}", options.space("; ", ""));
    header[..text.len()].copy_from_slice(text.as_bytes());
    out.write_all(&header)?;
    out.write_all(&(mesh.facets.len() as u32).to_le_bytes())?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        let [a, b, c] = mesh.facets[f].map(|v| mesh.point(v));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for x in [normal, a, b, c].into_iter().flat_map(|p| p.to_array()) {
            bytes.extend_from_slice(&(x as f32).to_le_bytes());
        }
        bytes.extend_from_slice(&[0; 2]);
    })
}
