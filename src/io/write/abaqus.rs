//! Abaqus input file, read by CalculiX and others too (Dassault Systemes, "Abaqus Keywords Guide":
//! *NODE, *ELEMENT, *SURFACE).
//!
//! Each region is an element set of elements C3D4, or C3D10 in a mesh of second order, whose nodes
//! on edges come in the mesh's own order. Each boundary is an element-based surface of faces of
//! tets of its first label, so that its normals point to the second one, and a node set of the same
//! name. The number of a node is its index + 1, that of an element the tet's index + 1.
//!
//! Programs read no more than 20 characters of a number, so longer ones are rounded to fit. That
//! concerns only numbers below 0.1 in size, and changes them by less than 1e-11 of their size.

use std::io::{self, Write};
use std::path::Path;

use super::groups::Groups;
use super::output::Output;
use super::records::{push_float, push_int, write_ranges, write_records};
use super::regions::{Boundaries, Regions};
use super::subset::Subset;
use super::{WriteOptions, check_count};
use crate::Result;
use crate::mesh::TetMesh;

/// Characters of a number.
const WIDTH: usize = 20;

/// Numbers in a line of a set.
const ENTRIES: usize = 8;

/// Numbers of nodes and of elements have at most 9 digits.
pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    check_count(path, "an Abaqus file", "nodes", mesh.points.len(), 999_999_999)?;
    check_count(path, "an Abaqus file", "tets", mesh.tets.len(), 999_999_999)
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    write!(out, "*HEADING\nlapd mesh\n{}*NODE\n", options.space("** ", "\n"))?;
    write_records(out, mesh.points.len(), |v, bytes| {
        push_int(bytes, v as i64 + 1);
        for &x in &mesh.points[v] {
            bytes.extend_from_slice(b", ");
            push_short_float(bytes, x);
        }
        bytes.push(b'\n');
    })?;
    let (nodes, kind) =
        (mesh.nodes_per_tet(), if mesh.mid_nodes.is_some() { "C3D10" } else { "C3D4" });
    let regions = Regions::new(mesh, options);
    for (label, tets) in Groups::new(&mesh.labels).map_err(io::Error::other)?.iter() {
        writeln!(out, "*ELEMENT, TYPE={kind}, ELSET={}", regions.name(label))?;
        tets.write_records(out, |_, t, bytes| {
            push_int(bytes, i64::from(t) + 1);
            for &v in &mesh.tet_nodes(t as usize)[..nodes] {
                bytes.extend_from_slice(b", ");
                push_int(bytes, i64::from(v) + 1);
            }
            bytes.push(b'\n');
        })?;
    }
    let boundaries = Boundaries::new(mesh, options, &regions).map_err(io::Error::other)?;
    let of_boundaries = Groups::new(&boundaries).map_err(io::Error::other)?;
    for (name, (_, facets)) in boundaries.names.iter().zip(of_boundaries.iter()) {
        writeln!(out, "*SURFACE, TYPE=ELEMENT, NAME={name}")?;
        facets.write_records(out, |_, facet, bytes| {
            let facet = facet as usize;
            // The first label is never background.
            let tet = mesh.facet_tets[facet][0];
            push_int(bytes, i64::from(tet) + 1);
            bytes.extend_from_slice(b", S");
            push_int(bytes, face(&mesh.tets[tet as usize], &mesh.facets[facet]));
            bytes.push(b'\n');
        })?;
        let nodes = facets.iter().flat_map(|f| mesh.nodes_of_facet(f));
        let nodes = Subset::new(mesh.points.len(), nodes).map_err(io::Error::other)?;
        writeln!(out, "*NSET, NSET={name}")?;
        write_ranges(out, nodes.len(), |range, bytes| {
            for (i, v) in range.clone().zip(nodes.range(range)) {
                push_int(bytes, i64::from(v) + 1);
                bytes.push(b',');
                if i % ENTRIES == ENTRIES - 1 || i + 1 == nodes.len() {
                    bytes.push(b'\n');
                }
            }
        })?;
    }
    Ok(())
}

/// The number of the face of `tet` that is `facet`: faces 1 to 4 are opposite to the vertices 3, 2,
/// 0, 1.
fn face(tet: &[u32; 4], facet: &[u32; 3]) -> i64 {
    match tet.iter().position(|v| !facet.contains(v)) {
        Some(3) => 1,
        Some(2) => 2,
        Some(0) => 3,
        _ => 4,
    }
}

/// Appends a number in its shortest form, or rounded to fit the width.
fn push_short_float(bytes: &mut Vec<u8>, value: f64) {
    let start = bytes.len();
    push_float(bytes, value);
    let mut digits = 15;
    while bytes.len() - start > WIDTH {
        bytes.truncate(start);
        bytes.extend_from_slice(format!("{value:.digits$e}").as_bytes());
        digits -= 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn faces_are_those_of_the_manual() {
        let nodes = |numbers: [u32; 3]| numbers.map(|number| 10 * number);
        let faces = [[1, 2, 3], [1, 4, 2], [2, 4, 3], [3, 4, 1]].map(nodes);
        assert_eq!(faces.map(|facet| face(&[10, 20, 30, 40], &facet)), [1, 2, 3, 4]);
    }

    proptest! {
        #[test]
        fn numbers_are_short_and_near(
            value in any::<f64>().prop_filter("finite", |x| x.is_finite()),
        ) {
            let mut bytes = Vec::new();
            push_short_float(&mut bytes, value);
            prop_assert!(bytes.len() <= WIDTH);
            let back: f64 = std::str::from_utf8(&bytes).unwrap().parse().unwrap();
            prop_assert!((back - value).abs() <= 1e-11 * value.abs());
        }

        #[test]
        fn coordinates_stay(value in -1e6..1e6) {
            let mut bytes = Vec::new();
            push_short_float(&mut bytes, value);
            let back: f64 = std::str::from_utf8(&bytes).unwrap().parse().unwrap();
            prop_assert!(back == value || value.abs() < 0.1);
        }
    }
}
