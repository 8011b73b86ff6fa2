//! Nastran bulk data ("NX Nastran Quick Reference Guide": GRID, CTETRA, CTRIA3, CTRIA6, PSOLID,
//! PSHELL).
//!
//! Each region is the CTETRA of a property PSOLID, each boundary the CTRIA3 or CTRIA6 of a property
//! PSHELL; comments before the properties have the names. Properties have different numbers: a
//! positive label of at most 8 digits is its own, others get those after the largest label,
//! boundaries those after these. The only material has values to be replaced. Nodes on edges come
//! in the mesh's own order. The number of a node is its index + 1; tets come first, then facets.
//!
//! Nodes are in the long format, of fields of 16 characters: coordinates are rounded to fit, which
//! changes them by less than 1e-9 of their size.

use std::io::{self, Write};
use std::path::Path;

use super::output::Output;
use super::records::{push_float, push_int, write_records};
use super::regions::{Tags, regions_and_boundaries};
use super::{WriteOptions, check_count};
use crate::Result;
use crate::mesh::TetMesh;

/// Characters of a field.
const WIDTH: usize = 16;

/// Numbers have at most 8 digits in fields of the short format.
const MAX: usize = 99_999_999;

pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    check_count(path, "Nastran", "nodes", mesh.points.len(), MAX)?;
    check_count(path, "Nastran", "tets and facets", mesh.tets.len() + mesh.facets.len(), MAX)
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output<'_>,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let tags = Tags::new(&regions.labels, boundaries.all.len(), MAX as i32);
    write!(out, "$ lapd mesh\n{}SOL 101\nCEND\nBEGIN BULK\n", options.space("$ ", "\n"))?;
    out.write_all(b"$ Properties hold places: give them materials and values of your own.\n")?;
    out.write_all(b"MAT1,1,1.0,,0.3\n")?;
    for (tag, (_, name)) in tags.volumes.iter().zip(regions.iter()) {
        write!(out, "$ PSOLID {tag}: {name}\nPSOLID,{tag},1\n")?;
    }
    for (tag, name) in tags.surfaces.iter().zip(&boundaries.names) {
        write!(out, "$ PSHELL {tag}: {name}\nPSHELL,{tag},1,1.0\n")?;
    }
    write_records(out, mesh.points.len(), |v, bytes| {
        let [x, y, z] = mesh.points[v];
        bytes.extend_from_slice(b"GRID*   ");
        push_field(bytes, |bytes| push_int(bytes, v as i64 + 1));
        bytes.extend_from_slice(&[b' '; WIDTH]);
        push_field(bytes, |bytes| push_real(bytes, x));
        push_field(bytes, |bytes| push_real(bytes, y));
        bytes.extend_from_slice(b"\n*       ");
        push_real(bytes, z);
        bytes.push(b'\n');
    })?;
    let of_tet = mesh.nodes_per_tet();
    write_records(out, mesh.tets.len(), |t, bytes| {
        let tag = tags.volumes[regions.place(mesh.labels[t])];
        push_element(bytes, b"CTETRA", t + 1, tag, &mesh.tet_nodes(t)[..of_tet]);
    })?;
    let of_facet = mesh.nodes_per_facet();
    let name: &[u8] = if of_facet == 3 { b"CTRIA3" } else { b"CTRIA6" };
    write_records(out, mesh.facets.len(), |f, bytes| {
        let tag = tags.surfaces[boundaries.of_facet(f)];
        let number = mesh.tets.len() + f + 1;
        push_element(bytes, name, number, tag, &mesh.facet_nodes(f)[..of_facet]);
    })?;
    out.write_all(b"ENDDATA\n")
}

/// An element in the free format: its name, number, property, and nodes, of which a line holds 6.
fn push_element(bytes: &mut Vec<u8>, name: &[u8], number: usize, tag: i32, nodes: &[u32]) {
    bytes.extend_from_slice(name);
    bytes.push(b',');
    push_int(bytes, number as i64);
    bytes.push(b',');
    push_int(bytes, tag.into());
    for (i, &v) in nodes.iter().enumerate() {
        bytes.extend_from_slice(if i == 6 { b",\n," } else { b"," });
        push_int(bytes, i64::from(v) + 1);
    }
    bytes.push(b'\n');
}

/// A field filled up with blanks.
fn push_field(bytes: &mut Vec<u8>, push: impl FnOnce(&mut Vec<u8>)) {
    let end = bytes.len() + WIDTH;
    push(bytes);
    bytes.resize(end, b' ');
}

/// Appends a real number of at most 16 characters: it has a point, and its exponent a sign but no
/// letter, which saves room: 1.5-7 is 1.5e-7.
fn push_real(bytes: &mut Vec<u8>, value: f64) {
    let mut shortest = Vec::new();
    push_float(&mut shortest, value);
    // Numbers are made of ascii.
    let mut text = String::from_utf8_lossy(&shortest).into_owned();
    let mut digits = 15;
    loop {
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, ""));
        let point = if mantissa.contains('.') { "" } else { "." };
        let sign = if exponent.starts_with(['-', '+']) || exponent.is_empty() { "" } else { "+" };
        let short = format!("{mantissa}{point}{sign}{exponent}");
        if short.len() <= WIDTH || digits == 0 {
            bytes.extend_from_slice(short.as_bytes());
            return;
        }
        text = format!("{value:.digits$e}");
        digits -= 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn real(value: f64) -> String {
        let mut bytes = Vec::new();
        push_real(&mut bytes, value);
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn reals_have_a_point() {
        for (value, text) in [(0.0, "0."), (-1.5, "-1.5"), (1e7, "10000000."), (12.25, "12.25")] {
            assert_eq!(real(value), text);
        }
        assert_eq!(real(1.0 / 3.0), "3.333333333333-1");
        assert_eq!(real(-1e-7), "-1.-7");
        assert_eq!(real(1.0 / 3e300), "3.3333333333-301");
    }

    proptest! {
        #[test]
        fn reals_are_short_and_near(value in -1e9..1e9) {
            let text = real(value);
            prop_assert!(text.len() <= WIDTH && text.contains('.'), "{}", text);
            let mark = text.rfind(['+', '-']).filter(|&at| at > 0);
            let plain = match mark {
                Some(at) => format!("{}e{}", &text[..at], &text[at..]),
                None => text,
            };
            let back: f64 = plain.parse().unwrap();
            prop_assert!((back - value).abs() <= 1e-9 * value.abs());
        }
    }
}
