//! I-DEAS universal files (SDRC, "Universal file format": datasets 2411, 2412, 2467), which Salome,
//! FreeCAD, Gmsh, OpenFOAM and Elmer read.
//!
//! Dataset 2411 has the nodes, 2412 the tets and behind them the facets, 2467 a group for each
//! region and each boundary, by name. Readers that know no groups find the same in the tables of
//! properties: a positive label of at most 9 digits is its own number, others have those after the
//! largest, and boundaries those after these. In second order corners and nodes on edges take
//! turns: a, ab, b, bc, c, ca, then, of a tet, ad, bd, cd, d. Numbers are indices + 1; facets are
//! counted on from the tets.

use std::io::{self, Write};
use std::path::Path;

use super::groups::{Groups, Keyed, Members};
use super::output::Output;
use super::records::write_records;
use super::regions::{Tags, regions_and_boundaries};
use super::{WriteOptions, check_count};
use crate::Result;
use crate::mesh::TetMesh;

/// Types of elements, of order 1 and 2: plane triangles, solid tets.
const TRIANGLE: [u32; 2] = [91, 92];
const TETRAHEDRON: [u32; 2] = [111, 118];

/// The code of elements in groups.
const ELEMENT: u32 = 8;

/// Characters of a group's name.
const NAME: usize = 40;

/// Numbers have fields of 10 characters.
const MAX: usize = 999_999_999;

pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    check_count(path, "a universal file", "nodes", mesh.points.len(), MAX)?;
    check_count(
        path,
        "a universal file",
        "tets and facets",
        mesh.tets.len() + mesh.facets.len(),
        MAX,
    )
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output<'_>,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let tags = Tags::new(&regions.labels, boundaries.all.len(), MAX as i32);
    out.write_all(b"    -1\n  2411\n")?;
    write_records(out, mesh.points.len(), |v, bytes| {
        push_fields(bytes, &[v as u32 + 1, 1, 1, 11]);
        bytes.push(b'\n');
        for &x in &mesh.points[v] {
            push_real(bytes, x);
        }
        bytes.push(b'\n');
    })?;
    out.write_all(b"    -1\n    -1\n  2412\n")?;
    let order = usize::from(mesh.mid_nodes.is_some());
    write_records(out, mesh.tets.len(), |t, bytes| {
        let [a, b, c, d, ab, bc, ca, ad, bd, cd] = mesh.tet_nodes(t);
        let nodes: &[u32] =
            if order == 0 { &[a, b, c, d] } else { &[a, ab, b, bc, c, ca, ad, bd, cd, d] };
        let tag = tags.volumes[regions.place(mesh.labels[t])];
        push_element(bytes, t, TETRAHEDRON[order], tag as u32, nodes);
    })?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        let [a, b, c, ab, bc, ca] = mesh.facet_nodes(f);
        let nodes: &[u32] = if order == 0 { &[a, b, c] } else { &[a, ab, b, bc, c, ca] };
        let tag = tags.surfaces[boundaries.of_facet(f)];
        push_element(bytes, mesh.tets.len() + f, TRIANGLE[order], tag as u32, nodes);
    })?;
    out.write_all(b"    -1\n    -1\n  2467\n")?;
    let of_regions = Groups::new(&mesh.labels).map_err(io::Error::other)?;
    let of_boundaries = Groups::new(&boundaries).map_err(io::Error::other)?;
    for ((label, tets), number) in of_regions.iter().zip(1..) {
        write_group(out, regions.name(label), number, 0, &tets)?;
    }
    let behind = of_regions.iter().len() as u32 + 1;
    let of_boundaries = boundaries.names.iter().zip(of_boundaries.iter());
    for ((name, (_, facets)), number) in of_boundaries.zip(behind..) {
        write_group(out, name, number, mesh.tets.len(), &facets)?;
    }
    out.write_all(b"    -1\n")
}

/// A group: its number and name, and its elements, which come behind `first` others.
fn write_group<I: Keyed>(
    out: &mut Output,
    name: &str,
    number: u32,
    first: usize,
    members: &Members<'_, I>,
) -> io::Result<()> {
    let mut head = Vec::new();
    push_fields(&mut head, &[number, 0, 0, 0, 0, 0, 0, members.len() as u32]);
    out.write_all(&head)?;
    writeln!(out, "\n{}", short(name, number))?;
    members.write_records(out, |i, member, bytes| {
        push_fields(bytes, &[ELEMENT, first as u32 + member + 1, 0, 0]);
        // Two of them in a line.
        if i % 2 == 1 || i + 1 == members.len() {
            bytes.push(b'\n');
        }
    })
}

/// A group's name in the 40 characters that the format has for it; a longer one ends with the
/// number of the group.
fn short(name: &str, number: u32) -> String {
    if name.len() <= NAME {
        return name.to_owned();
    }
    let behind = format!("_{number}");
    format!("{}{behind}", &name[..NAME - behind.len()])
}

/// Appends numbers in fields of 10 characters.
fn push_fields(bytes: &mut Vec<u8>, numbers: &[u32]) {
    for &number in numbers {
        let mut buffer = itoa::Buffer::new();
        let text = buffer.format(number).as_bytes();
        bytes.resize(bytes.len() + 10 - text.len().min(10), b' ');
        bytes.extend_from_slice(text);
    }
}

/// Appends a number in a field of 25 characters, with all 17 digits.
fn push_real(bytes: &mut Vec<u8>, value: f64) {
    let text = format!("{value:.16e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let (sign, digits) = exponent.strip_prefix('-').map_or(('+', exponent), |digits| ('-', digits));
    // Two digits of the exponent at least, as Fortran has them.
    let field = format!("{mantissa}D{sign}{digits:0>2}");
    bytes.extend_from_slice(format!("{field:>25}").as_bytes());
}

/// Number, type, tables of physical and material properties, colour, how many nodes; then these, 8
/// in a line.
fn push_element(bytes: &mut Vec<u8>, index: usize, kind: u32, tag: u32, nodes: &[u32]) {
    push_fields(bytes, &[index as u32 + 1, kind, tag, tag, 7, nodes.len() as u32]);
    for (i, &v) in nodes.iter().enumerate() {
        if i % 8 == 0 {
            bytes.push(b'\n');
        }
        push_fields(bytes, &[v + 1]);
    }
    bytes.push(b'\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_groups_fit() {
        let name = "Left-Cerebral-White-Matter__Left-Cerebral-Cortex";
        assert_eq!(short(name, 12), "Left-Cerebral-White-Matter__Left-Cere_12");
        assert_eq!(short("liver", 1), "liver");
    }

    #[test]
    fn fields_have_their_widths() {
        let mut bytes = Vec::new();
        push_fields(&mut bytes, &[1, 999_999_999]);
        push_real(&mut bytes, -0.1);
        push_real(&mut bytes, 1e-300);
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(text, "         1 999999999  -1.0000000000000001D-01  1.0000000000000000D-300");
    }
}
