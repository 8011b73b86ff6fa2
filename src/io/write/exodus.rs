//! Exodus II files (Schoof, Yarberry, "EXODUS II: A finite element data model", SAND92-2137), as
//! netCDF with 64-bit offsets.
//!
//! Each region is an element block of TETRA or TETRA10, whose nodes on edges come in the mesh's own
//! order. Each boundary is a side set of sides of tets of its first label; one between two regions
//! has a second side set with the same sides seen from the other region: `liver__spleen` and
//! `spleen__liver`. Block numbers are labels where these are positive; labels of 0 and below get
//! the numbers after the largest label. Side sets have numbers of their own, from 1 on.
//!
//! Elements are numbered block by block; `elem_num_map` has the number of each tet in the mesh,
//! from 1.
//!
//! Memory: beside the mesh, what the groups take (see `groups`). The number of a tet's element is
//! counted anew for each side.

use std::io::{self, Write};
use std::path::Path;

use super::groups::{Groups, Members};
use super::netcdf::{Kind, MAX_BYTES, NetCdf, Value};
use super::output::Output;
use super::records::write_records;
use super::regions::{Boundaries, Tags, regions_and_boundaries};
use super::{WriteOptions, check_count};
use crate::Result;
use crate::image::Wall;
use crate::mesh::TetMesh;

/// The longest name, less the zero behind it.
const NAME: usize = 80;

/// Whether the format can hold what `mesh` has.
pub(super) fn check_limits(mesh: &TetMesh, path: &Path) -> Result<()> {
    let format = "Exodus II of 64-bit offsets";
    check_count(path, format, "nodes", mesh.points.len(), (MAX_BYTES / 8) as usize)?;
    let max_tets = (MAX_BYTES / (4 * mesh.nodes_per_tet() as u64)) as usize;
    check_count(path, format, "tets", mesh.tets.len(), max_tets)
}

/// A side set: its name, the facets that it has, and which of their two sides.
struct SideSet<'a> {
    name: String,
    facets: Members<'a, Boundaries<'a>>,
    side: usize,
}

pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output<'_>,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let blocks = Groups::new(&mesh.labels).map_err(io::Error::other)?;
    let of_boundaries = Groups::new(&boundaries).map_err(io::Error::other)?;
    let mut sets = Vec::new();
    for (b, (boundary, facets)) in of_boundaries.iter().enumerate() {
        let name = &boundaries.names[b];
        sets.push(SideSet { name: name.clone(), facets, side: 0 });
        if boundaries.has_two_sides(b) && boundary.wall == Wall::None {
            sets.push(SideSet { name: boundaries.reversed_name(b, &regions), facets, side: 1 });
        }
    }
    let parts = Parts {
        mesh,
        tags: Tags::new(&regions.labels, 0, i32::MAX).volumes,
        names: regions.iter().map(|(_, name)| name).collect(),
        blocks: &blocks,
        starts: blocks.starts(),
        set_names: sets.iter().map(|set| &*set.name).collect(),
        sets: &sets,
    };
    parts.file(options).write(out)
}

/// What a file is made of.
struct Parts<'a> {
    mesh: &'a TetMesh,
    /// Blocks with their numbers and names.
    blocks: &'a Groups<'a, Vec<i32>>,
    tags: Vec<i32>,
    names: Vec<&'a str>,
    /// How many elements are before each block.
    starts: Vec<usize>,
    sets: &'a [SideSet<'a>],
    set_names: Vec<&'a str>,
}

impl Parts<'_> {
    /// The file, without its data.
    fn file(&self, options: &WriteOptions<'_>) -> NetCdf<'_> {
        let Self { mesh, blocks, starts, tags, names, sets, set_names } = self;
        let mut file = NetCdf::default();
        file.attribute("api_version", Value::Float(8.03));
        file.attribute("version", Value::Float(8.03));
        file.attribute("floating_point_word_size", Value::Int(8));
        file.attribute("file_size", Value::Int(1));
        file.attribute("maximum_name_length", Value::Int(NAME as i32));
        file.attribute("int64_status", Value::Int(0));
        let title = format!("lapd mesh{}", options.space(" ", ""));
        file.attribute("title", Value::Text(title));

        let time_step = file.dimension("time_step", 0);
        file.dimension("len_string", 33);
        file.dimension("len_line", 81);
        file.dimension("four", 4);
        let len_name = file.dimension("len_name", NAME + 1);
        let num_dim = file.dimension("num_dim", 3);
        // A dimension of length 0 would be one of records.
        if !mesh.points.is_empty() {
            let num_nodes = file.dimension("num_nodes", mesh.points.len());
            for (axis, name) in ["coordx", "coordy", "coordz"].into_iter().enumerate() {
                file.variable(name, &[num_nodes], Kind::Double, None, move |out| {
                    write_records(out, mesh.points.len(), |v, bytes| {
                        bytes.extend_from_slice(&mesh.points[v][axis].to_be_bytes());
                    })
                });
            }
        }
        file.variable("coor_names", &[num_dim, len_name], Kind::Char, None, |out| {
            write_names(out, &["x", "y", "z"])
        });
        if !mesh.tets.is_empty() {
            let num_elem = file.dimension("num_elem", mesh.tets.len());
            file.variable("elem_num_map", &[num_elem], Kind::Int, None, |out| {
                blocks.iter().try_for_each(|(_, tets)| {
                    tets.write_records(out, |_, t, bytes| push_int(bytes, t as i32 + 1))
                })
            });
            let count = file.dimension("num_el_blk", tags.len());
            write_list(
                &mut file,
                ["eb_status", "eb_prop1", "eb_names"],
                [count, len_name],
                tags,
                names,
            );
        }
        let nodes = mesh.nodes_per_tet();
        let kind = if nodes == 4 { "TETRA" } else { "TETRA10" };
        for ((_, tets), n) in blocks.iter().zip(1..) {
            let in_block = file.dimension(format!("num_el_in_blk{n}"), tets.len());
            let per_element = file.dimension(format!("num_nod_per_el{n}"), nodes);
            let attribute = Some(("elem_type", Value::Text(kind.into())));
            let dimensions = [in_block, per_element];
            file.variable(format!("connect{n}"), &dimensions, Kind::Int, attribute, move |out| {
                tets.write_records(out, |_, t, bytes| {
                    for &v in &mesh.tet_nodes(t as usize)[..nodes] {
                        bytes.extend_from_slice(&(v + 1).to_be_bytes());
                    }
                })
            });
        }
        if !sets.is_empty() {
            let count = file.dimension("num_side_sets", sets.len());
            let ids: Vec<i32> = (1..=sets.len() as i32).collect();
            write_list(
                &mut file,
                ["ss_status", "ss_prop1", "ss_names"],
                [count, len_name],
                &ids,
                set_names,
            );
        }
        for (set, n) in sets.iter().zip(1..) {
            let count = file.dimension(format!("num_side_ss{n}"), set.facets.len());
            let tet_of = move |f: u32| mesh.facet_tets[f as usize][set.side] as usize;
            file.variable(format!("elem_ss{n}"), &[count], Kind::Int, None, move |out| {
                set.facets.write_records(out, |_, f, bytes| {
                    let (block, place) = blocks.place(tet_of(f));
                    push_int(bytes, (starts[block] + place) as i32 + 1);
                })
            });
            file.variable(format!("side_ss{n}"), &[count], Kind::Int, None, move |out| {
                set.facets.write_records(out, |_, f, bytes| {
                    push_int(bytes, side(&mesh.tets[tet_of(f)], &mesh.facets[f as usize]));
                })
            });
        }
        // Its data, records that are not there yet, come last.
        file.variable("time_whole", &[time_step], Kind::Double, None, |_| Ok(()));
        file
    }
}

/// Status, numbers and names of all blocks or sets.
fn write_list<'a>(
    file: &mut NetCdf<'a>,
    [status, property, name]: [&'static str; 3],
    [count, len_name]: [usize; 2],
    ids: &[i32],
    names: &'a [&'a str],
) {
    let (number, ids) = (ids.len(), ids.to_vec());
    file.variable(status, &[count], Kind::Int, None, move |out| write_ints(out, number, |_| 1));
    let attribute = Some(("name", Value::Text("ID".into())));
    file.variable(property, &[count], Kind::Int, attribute, move |out| {
        write_ints(out, number, |i| ids[i])
    });
    file.variable(name, &[count, len_name], Kind::Char, None, move |out| write_names(out, names));
}

fn write_ints(
    out: &mut Output<'_>,
    count: usize,
    value: impl Fn(usize) -> i32 + Sync,
) -> io::Result<()> {
    write_records(out, count, |i, bytes| push_int(bytes, value(i)))
}

fn push_int(bytes: &mut Vec<u8>, value: i32) {
    bytes.extend_from_slice(&value.to_be_bytes());
}

fn write_names(out: &mut Output<'_>, names: &[&str]) -> io::Result<()> {
    names.iter().try_for_each(|name| {
        let mut bytes = [0; NAME + 1];
        let length = name.len().min(NAME);
        bytes[..length].copy_from_slice(&name.as_bytes()[..length]);
        out.write_all(&bytes)
    })
}

/// The number of the side of `tet` that is `facet`: sides 1 to 4 are opposite to the vertices 2, 0,
/// 1, 3.
fn side(tet: &[u32; 4], facet: &[u32; 3]) -> i32 {
    match tet.iter().position(|v| !facet.contains(v)) {
        Some(2) => 1,
        Some(0) => 2,
        Some(1) => 3,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_those_of_the_manual() {
        let nodes = |numbers: [u32; 3]| numbers.map(|number| 10 * number);
        let sides = [[1, 2, 4], [2, 3, 4], [1, 4, 3], [1, 3, 2]].map(nodes);
        assert_eq!(sides.map(|facet| side(&[10, 20, 30, 40], &facet)), [1, 2, 3, 4]);
    }
}
