//! MFEM mesh v1.3, ascii (Anderson et al., "MFEM: A modular finite element methods library",
//! Computers & Mathematics with Applications 81, 2021; "Mesh formats" on mfem.org).
//!
//! The attribute of an element is the tag of its region: its label where that is positive. The
//! attribute of a boundary element is the number of its boundary, from 1; those between two regions
//! are among them. The sets of attributes have the names, and a set for each region holds all
//! boundaries around it. MFEM before 4.7 does not know version 1.3.

use std::io::{self, Write};
use std::path::Path;

use super::output::Output;
use super::records::{push_floats, push_int, push_ints, write_records};
use super::regions::{Tags, regions_and_boundaries};
use super::{WriteOptions, check_count, refuse_second_order};
use crate::Result;
use crate::mesh::TetMesh;

/// MFEM's types of elements.
const TRIANGLE: i64 = 2;
const TETRAHEDRON: i64 = 4;

pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    refuse_second_order(mesh, path, "MFEM's files")?;
    check_count(path, "MFEM", "vertices", mesh.points.len(), i32::MAX as usize)?;
    check_count(path, "MFEM", "tets", mesh.tets.len(), i32::MAX as usize)
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output<'_>,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let tags = Tags::new(&regions.labels, 0, i32::MAX).volumes;
    let space = options.space("# ", "\n");
    write!(out, "MFEM mesh v1.3\n\n{space}dimension\n3\n\nelements\n{}\n", mesh.tets.len())?;
    write_records(out, mesh.tets.len(), |t, bytes| {
        let tag = tags[regions.place(mesh.labels[t])];
        push_element(bytes, tag.into(), TETRAHEDRON, &mesh.tets[t]);
    })?;
    let of_regions = regions.iter().zip(&tags).map(|((_, name), &tag)| (name, vec![tag]));
    write_sets(out, "attribute_sets", of_regions.collect())?;
    write!(out, "\nboundary\n{}\n", mesh.facets.len())?;
    write_records(out, mesh.facets.len(), |f, bytes| {
        push_element(bytes, boundaries.number(f).into(), TRIANGLE, &mesh.facets[f]);
    })?;
    let mut sets: Vec<(&str, Vec<i32>)> =
        boundaries.names.iter().zip(1..).map(|(name, number)| (&**name, vec![number])).collect();
    for (label, name) in regions.iter() {
        let around = (0..boundaries.all.len()).filter(|&b| boundaries.bounds(b, label));
        sets.push((name, around.map(|b| b as i32 + 1).collect()));
    }
    write_sets(out, "bdr_attribute_sets", sets)?;
    write!(out, "\nvertices\n{}\n3\n", mesh.points.len())?;
    write_records(out, mesh.points.len(), |v, bytes| {
        push_floats(bytes, &mesh.points[v], b' ');
        bytes.push(b'\n');
    })?;
    out.write_all(b"\nmfem_mesh_end\n")
}

fn push_element(bytes: &mut Vec<u8>, attribute: i64, kind: i64, vertices: &[u32]) {
    push_int(bytes, attribute);
    push_ints(bytes, std::iter::once(kind).chain(vertices.iter().map(|&v| i64::from(v))));
    bytes.push(b'\n');
}

/// Sets of attributes: in each line a name, how many there are, and which.
fn write_sets(out: &mut Output<'_>, what: &str, sets: Vec<(&str, Vec<i32>)>) -> io::Result<()> {
    write!(out, "\n{what}\n{}\n", sets.len())?;
    for (name, members) in sets {
        write!(out, "\"{name}\" {}", members.len())?;
        members.iter().try_for_each(|member| write!(out, " {member}"))?;
        out.write_all(b"\n")?;
    }
    Ok(())
}
