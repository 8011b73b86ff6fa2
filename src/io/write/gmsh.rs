//! Gmsh's MSH files, versions 4.1 and 2.2, binary (Geuzaine, Remacle, "Gmsh: a 3-D finite element
//! mesh generator with built-in pre- and post-processing facilities", IJNME 79, 2009; its reference
//! manual, "MSH file format").
//!
//! Each region is one volume entity and one physical group of dimension 3; each boundary is one
//! surface entity and one physical group of dimension 2, its triangles with normals from the first
//! label to the second. An entity and its physical group have the same tag. The tag of a volume is
//! its label. Gmsh's tags must be positive, so that labels of 0 and below (0 is the background,
//! where it was kept) get numbers that no label has; their names tell the label. Surfaces have the
//! numbers after these: some programs take groups of equal numbers for one, whatever their
//! dimensions.
//!
//! The tag of a node is its index + 1, that of a tet its index + 1, triangles are counted on from
//! there. Version 2.2 keeps the order of the mesh. Version 4.1 has its nodes and elements by
//! entity, in the order of the mesh within each; volumes list the surfaces that bound them, a
//! surface with normals into the volume negative. A node on interfaces belongs to the surface of
//! the smallest number among them (Gmsh would make curves where three labels meet; we have none),
//! any other to its volume.
//!
//! In a mesh of second order elements have types 11 and 9. Of the nodes on the edges of a tet (a,
//! b, c, d) Gmsh has that of cd before that of bd; those of facets come in the mesh's own order.
//!
//! Memory: beside the mesh, 8 bytes per vertex for the order of version 4.1, and what the groups
//! take (see `groups`).

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::groups::{Groups, Keyed, Members};
use super::output::Output;
use super::records::write_records;
use super::regions::{Boundaries, Regions, Tags, regions_and_boundaries};
use super::{WriteOptions, check_count};
use crate::Result;
use crate::memory::filled;
use crate::mesh::TetMesh;

/// Gmsh's types of elements, of order 1 and 2.
const TRIANGLE: [i32; 2] = [2, 9];
const TETRAHEDRON: [i32; 2] = [4, 11];

/// What the blocks of elements need to know: their types, how many nodes they have, and which.
struct Elements<'m> {
    mesh: &'m TetMesh,
    order: usize,
}

impl<'m> Elements<'m> {
    fn new(mesh: &'m TetMesh) -> Self {
        Self { mesh, order: if mesh.mid_nodes.is_some() { 2 } else { 1 } }
    }

    fn kind_of_tets(&self) -> i32 {
        TETRAHEDRON[self.order - 1]
    }

    fn kind_of_facets(&self) -> i32 {
        TRIANGLE[self.order - 1]
    }

    /// Calls `push` for the nodes of a tet. Gmsh has the last two edges the other way round.
    fn nodes_of_tet(&self, t: usize, push: &mut dyn FnMut(u32)) {
        let [a, b, c, d, ab, bc, ca, ad, bd, cd] = self.mesh.tet_nodes(t);
        [a, b, c, d, ab, bc, ca, ad, cd, bd][..self.mesh.nodes_per_tet()]
            .iter()
            .for_each(|&node| push(node));
    }

    /// Calls `push` for the nodes of a facet.
    fn nodes_of_facet(&self, f: usize, push: &mut dyn FnMut(u32)) {
        self.mesh.nodes_of_facet(f as u32).for_each(push);
    }
}

/// Calls its second argument for the nodes of an element.
type Nodes<'a> = dyn Fn(usize, &mut dyn FnMut(u32)) + Sync + 'a;

/// Dimensions of entities.
const SURFACE: i32 = 2;
const VOLUME: i32 = 3;

/// The sections before entities and nodes.
fn write_head(
    out: &mut Output,
    options: &WriteOptions<'_>,
    version: &str,
    tags: &Tags,
    regions: &Regions,
    boundaries: &Boundaries<'_>,
) -> io::Result<()> {
    // The binary integer 1 tells the order of bytes.
    write!(out, "$MeshFormat\n{version} 1 8\n")?;
    out.write_all(&1i32.to_le_bytes())?;
    let space = options.space("$Comments\n", "\n$EndComments\n");
    let count = tags.volumes.len() + tags.surfaces.len();
    write!(out, "\n$EndMeshFormat\n{space}$PhysicalNames\n{count}\n")?;
    for (tag, name) in tags.surfaces.iter().zip(&boundaries.names) {
        writeln!(out, "{SURFACE} {tag} \"{name}\"")?;
    }
    for (tag, (_, name)) in tags.volumes.iter().zip(regions.iter()) {
        writeln!(out, "{VOLUME} {tag} \"{name}\"")?;
    }
    out.write_all(b"$EndPhysicalNames\n")
}

/// Whether version 2.2, which has 32-bit numbers, can number what `mesh` has.
pub(super) fn check_limits_2_2(mesh: &TetMesh, path: &Path) -> Result<()> {
    let max = i32::MAX as usize;
    let format = "MSH 2.2 (.msh, version 4.1, has no such limit)";
    check_count(path, format, "vertices", mesh.points.len(), max)?;
    check_count(path, format, "tets and facets", mesh.tets.len() + mesh.facets.len(), max)
}

pub(super) fn write_2_2(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let labels = &regions.labels;
    let tags = Tags::new(labels, boundaries.all.len(), i32::MAX);
    write_head(out, options, "2.2", &tags, &regions, &boundaries)?;
    write!(out, "$Nodes\n{}\n", mesh.points.len())?;
    write_records(out, mesh.points.len(), |v, bytes| {
        bytes.extend_from_slice(&(v as i32 + 1).to_le_bytes());
        push_point(bytes, &mesh.points[v]);
    })?;
    write!(out, "\n$EndNodes\n$Elements\n{}\n", mesh.tets.len() + mesh.facets.len())?;
    let elements = Elements::new(mesh);
    let tag_of_tet = |t: usize| tags.volumes[regions.place(mesh.labels[t])];
    let tets = |t: usize, push: &mut dyn FnMut(u32)| elements.nodes_of_tet(t, push);
    write_block_2_2(out, elements.kind_of_tets(), 0, mesh.tets.len(), &tets, tag_of_tet)?;
    let tag_of_facet = |f: usize| tags.surfaces[boundaries.of_facet(f)];
    let facets = |f: usize, push: &mut dyn FnMut(u32)| elements.nodes_of_facet(f, push);
    write_block_2_2(
        out,
        elements.kind_of_facets(),
        mesh.tets.len(),
        mesh.facets.len(),
        &facets,
        tag_of_facet,
    )?;
    out.write_all(b"\n$EndElements\n")
}

/// Elements of one type: type, count, number of tags; then of each its number, physical and
/// elementary tag, and nodes.
fn write_block_2_2(
    out: &mut Output,
    kind: i32,
    first: usize,
    count: usize,
    nodes: &Nodes<'_>,
    tag: impl Fn(usize) -> i32 + Sync,
) -> io::Result<()> {
    if count == 0 {
        return Ok(());
    }
    write_ints(out, &[kind, count as i32, 2])?;
    write_records(out, count, |i, bytes| {
        let tag = tag(i);
        push_ints(bytes, [(first + i) as i32 + 1, tag, tag]);
        nodes(i, &mut |v| push_ints(bytes, [v as i32 + 1]));
    })
}

pub(super) fn write_4_1(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let (regions, boundaries) = regions_and_boundaries(mesh, options)?;
    let volumes = Groups::new(&mesh.labels).map_err(io::Error::other)?;
    let surfaces = Groups::new(&boundaries).map_err(io::Error::other)?;
    let tags = Tags::new(&regions.labels, boundaries.all.len(), i32::MAX);
    write_head(out, options, "4.1", &tags, &regions, &boundaries)?;

    out.write_all(b"$Entities\n")?;
    write_longs(out, &[0, 0, surfaces.iter().len(), volumes.iter().len()])?;
    for (&tag, (_, facets)) in tags.surfaces.iter().zip(surfaces.iter()) {
        write_entity(out, mesh, tag, facets.iter().flat_map(|f| mesh.nodes_of_facet(f)), &[])?;
    }
    for (&tag, (label, tets)) in tags.volumes.iter().zip(volumes.iter()) {
        let boundary: Vec<i32> = tags
            .surfaces
            .iter()
            .enumerate()
            .filter(|&(b, _)| boundaries.bounds(b, label))
            .map(|(b, &tag)| if boundaries.all[b].labels[0] == label { tag } else { -tag })
            .collect();
        write_entity(out, mesh, tag, tets.iter().flat_map(|t| mesh.nodes_of_tet(t)), &boundary)?;
    }
    out.write_all(b"\n$EndEntities\n$Nodes\n")?;

    let owners = owners(mesh, &tags, &volumes, &surfaces).map_err(io::Error::other)?;
    let nodes = Groups::new(&owners).map_err(io::Error::other)?;
    write_longs(
        out,
        &[nodes.iter().len(), mesh.points.len(), 1.min(mesh.points.len()), mesh.points.len()],
    )?;
    for ([dimension, tag], vertices) in nodes.iter() {
        // The third integer says that the nodes have no parameters on their entity.
        write_ints(out, &[dimension, tag, 0])?;
        write_longs(out, &[vertices.len()])?;
        vertices.write_records(out, |_, v, bytes| push_long(bytes, u64::from(v) + 1))?;
        vertices.write_records(out, |_, v, bytes| push_point(bytes, &mesh.points[v as usize]))?;
    }
    out.write_all(b"\n$EndNodes\n$Elements\n")?;

    let count = mesh.tets.len() + mesh.facets.len();
    write_longs(out, &[surfaces.iter().len() + volumes.iter().len(), count, 1.min(count), count])?;
    let elements = Elements::new(mesh);
    let nodes = |f: usize, push: &mut dyn FnMut(u32)| elements.nodes_of_facet(f, push);
    for (&tag, (_, members)) in tags.surfaces.iter().zip(surfaces.iter()) {
        write_block_4_1(
            out,
            [SURFACE, tag, elements.kind_of_facets()],
            mesh.tets.len(),
            &nodes,
            &members,
        )?;
    }
    let nodes = |t: usize, push: &mut dyn FnMut(u32)| elements.nodes_of_tet(t, push);
    for (&tag, (_, members)) in tags.volumes.iter().zip(volumes.iter()) {
        write_block_4_1(out, [VOLUME, tag, elements.kind_of_tets()], 0, &nodes, &members)?;
    }
    out.write_all(b"\n$EndElements\n")
}

/// An entity: tag, bounding box, physical groups, bounding entities.
fn write_entity(
    out: &mut Output,
    mesh: &TetMesh,
    tag: i32,
    vertices: impl Iterator<Item = u32>,
    boundary: &[i32],
) -> io::Result<()> {
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) =
        vertices.map(|v| mesh.point(v)).fold(nowhere, |(low, high), p| (low.min(p), high.max(p)));
    write_ints(out, &[tag])?;
    for x in [low, high].into_iter().flat_map(|corner| corner.to_array()) {
        out.write_all(&x.to_le_bytes())?;
    }
    write_longs(out, &[1])?;
    write_ints(out, &[tag])?;
    write_longs(out, &[boundary.len()])?;
    write_ints(out, boundary)
}

/// Dimension and tag of the entity that each vertex belongs to.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
fn owners(
    mesh: &TetMesh,
    tags: &Tags,
    volumes: &Groups<'_, Vec<i32>>,
    surfaces: &Groups<'_, Boundaries<'_>>,
) -> Result<Vec<[i32; 2]>> {
    // A vertex of no tet has to be somewhere as well.
    let nowhere = [VOLUME, tags.volumes.first().copied().unwrap_or(1)];
    let mut owners = filled(mesh.points.len(), nowhere, "owners of vertices", || Ok(()))?;
    for (&tag, (_, tets)) in tags.volumes.iter().zip(volumes.iter()) {
        tets.iter()
            .flat_map(|t| mesh.nodes_of_tet(t))
            .for_each(|v| owners[v as usize] = [VOLUME, tag]);
    }
    for (&tag, (_, facets)) in tags.surfaces.iter().zip(surfaces.iter()).rev() {
        facets
            .iter()
            .flat_map(|f| mesh.nodes_of_facet(f))
            .for_each(|v| owners[v as usize] = [SURFACE, tag]);
    }
    Ok(owners)
}

/// Elements of one entity: dimension and tag of the entity, type, count; then of each element its
/// tag and nodes.
fn write_block_4_1<I: Keyed>(
    out: &mut Output,
    kind: [i32; 3],
    first: usize,
    nodes: &Nodes<'_>,
    members: &Members<'_, I>,
) -> io::Result<()> {
    write_ints(out, &kind)?;
    write_longs(out, &[members.len()])?;
    members.write_records(out, |_, element, bytes| {
        let element = element as usize;
        push_long(bytes, (first + element) as u64 + 1);
        nodes(element, &mut |v| push_long(bytes, u64::from(v) + 1));
    })
}

fn write_ints(out: &mut Output, values: &[i32]) -> io::Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

fn write_longs(out: &mut Output, values: &[usize]) -> io::Result<()> {
    values.iter().try_for_each(|&value| out.write_all(&(value as u64).to_le_bytes()))
}

fn push_ints<const N: usize>(bytes: &mut Vec<u8>, values: [i32; N]) {
    values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
}

fn push_long(bytes: &mut Vec<u8>, value: u64) {
    bytes.extend_from_slice(&value.to_le_bytes());
}

fn push_point(bytes: &mut Vec<u8>, point: &[f64; 3]) {
    point.iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
}
