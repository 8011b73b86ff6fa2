//! The tables of the certificate: labels, components, defects.

use super::boundary::{Failure, Growing, Out, Outcome, borrow, fill_struct, status_of};
use super::mesh::lapd_mesh;
use super::report::{certificate_of, max, mean, own_size};
use super::status::lapd_status;
use crate::verify::certificate::{Certificate, MIN_COMPONENT_VOXELS};
use crate::verify::{DefectKind, Fate};

/// One label, mesh against image. Set struct_size to sizeof(lapd_label_row) before the call.
/// Volumes are in cubic world units. Distances are NaN unless the certificate has the level
/// LAPD_CERTIFICATE_FULL.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_label_row {
    /// sizeof(lapd_label_row), set by the caller.
    pub struct_size: u64,
    /// The label.
    pub label: i64,
    /// Its tets.
    pub tets: u64,
    /// Their volume.
    pub mesh_volume: f64,
    /// The volume of its voxels.
    pub image_volume: f64,
    /// Its voxels.
    pub image_voxels: u64,
    /// Connected components of its voxels, joined with all 26 around them.
    pub components_image: u64,
    /// Connected components of its tets, joined where they share a facet, an edge or a vertex.
    pub components_mesh: u64,
    /// Components of the image, of LAPD_MIN_COMPONENT_VOXELS or more, in which it has no tet.
    pub components_lost: u64,
    /// Components of the image, of LAPD_MIN_COMPONENT_VOXELS or more, that the mesh has joined to
    /// another one.
    pub components_merged: u64,
    /// Components of the mesh that are torn off from the one they belong to, or lie in none of the
    /// image.
    pub pieces: u64,
    /// Euler characteristic of its boundary in the image, whose voxels are joined with all 26
    /// around them.
    pub euler_image: i64,
    /// Euler characteristic of its boundary in the mesh, of a surface just inside: 2 for a ball, 0
    /// for a torus, added up over all parts.
    pub euler_mesh: i64,
    /// Edges at which more than two facets of its boundary meet.
    pub non_manifold_edges: u64,
    /// Vertices, on no such edge, at which more than one sheet of its boundary meet.
    pub non_manifold_vertices: u64,
    /// Mean distance from its boundary in the mesh to that in the image.
    pub mesh_to_image_mean: f64,
    /// Largest distance from its boundary in the mesh to that in the image.
    pub mesh_to_image_max: f64,
    /// Mean distance from its boundary in the image to that in the mesh; infinite when it has no
    /// tet.
    pub image_to_mesh_mean: f64,
    /// Largest distance from its boundary in the image to that in the mesh; infinite when it has no
    /// tet.
    pub image_to_mesh_max: f64,
    /// Mean distance from its boundary in the mesh to the smooth interfaces.
    pub mesh_to_surface_mean: f64,
    /// Largest distance from its boundary in the mesh to the smooth interfaces.
    pub mesh_to_surface_max: f64,
    /// Mean distance from the smooth interfaces around it to its boundary in the mesh; infinite
    /// when it has no tet.
    pub surface_to_mesh_mean: f64,
    /// Largest distance from the smooth interfaces around it to its boundary in the mesh; infinite
    /// when it has no tet.
    pub surface_to_mesh_max: f64,
    /// By how much its volume grew when slivers were removed.
    pub volume_change: f64,
}

/// Components of the image with fewer voxels have no row of their own, and are not listed when they
/// are lost or merged.
pub const LAPD_MIN_COMPONENT_VOXELS: u64 = 8;

const _: () = assert!(LAPD_MIN_COMPONENT_VOXELS == MIN_COMPONENT_VOXELS);

/// What the mesh made of a component of the image.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_fate {
    /// A component of the mesh stands for it.
    LAPD_FATE_KEPT = 0,
    /// It is part of a component of the mesh that stands for another one.
    LAPD_FATE_MERGED = 1,
    /// No tet of its label lies in it.
    LAPD_FATE_LOST = 2,
}

/// One component of the image that has LAPD_MIN_COMPONENT_VOXELS or more. Set struct_size to
/// sizeof(lapd_component_row) before the call.
///
/// Voxels are joined with all 26 around them, tets where they share a facet, an edge or a vertex.
/// Volumes are in cubic world units, positions and distances in world units. Distances are NaN
/// unless the certificate has the level LAPD_CERTIFICATE_FULL.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_component_row {
    /// sizeof(lapd_component_row), set by the caller.
    pub struct_size: u64,
    /// Its label.
    pub label: i64,
    /// What became of it, a lapd_fate.
    pub fate: i64,
    /// The centre of its first voxel, x fastest.
    pub position: [f64; 3],
    /// Its voxels.
    pub image_voxels: u64,
    /// Their volume.
    pub image_volume: f64,
    /// Tets of its label that lie in it.
    pub tets: u64,
    /// Their volume.
    pub mesh_volume: f64,
    /// Components of the mesh that belong to it: 1 where all is well, 0 where it is lost or merged.
    pub components_mesh: u64,
    /// Euler characteristic of its boundary.
    pub euler_image: i64,
    /// That of the components of the mesh that belong to it, of a surface just inside, added up.
    pub euler_mesh: i64,
    /// Mean distance from the boundary of the components of the mesh that belong to it to that of
    /// its label in the image.
    pub mesh_to_image_mean: f64,
    /// The largest such distance.
    pub mesh_to_image_max: f64,
    /// Mean distance from its boundary to that of its label in the mesh; infinite when the label
    /// has no tet.
    pub image_to_mesh_mean: f64,
    /// The largest such distance.
    pub image_to_mesh_max: f64,
    /// Mean distance from the boundary of the components of the mesh that belong to it to the
    /// smooth interfaces.
    pub mesh_to_surface_mean: f64,
    /// The largest such distance.
    pub mesh_to_surface_max: f64,
    /// Mean distance from the smooth interfaces around it to its label's boundary in the mesh;
    /// infinite when the label has no tet.
    pub surface_to_mesh_mean: f64,
    /// The largest such distance.
    pub surface_to_mesh_max: f64,
}

/// What is wrong with the topology of a label somewhere.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_defect_kind {
    /// A component of the image, of LAPD_MIN_COMPONENT_VOXELS or more, in which no tet of its label
    /// lies.
    LAPD_DEFECT_LOST = 0,
    /// A component of the image, of LAPD_MIN_COMPONENT_VOXELS or more, that the mesh has joined to
    /// another one of its label.
    LAPD_DEFECT_MERGED = 1,
    /// A component of the mesh that is torn off from the one that stands for its component of the
    /// image.
    LAPD_DEFECT_TORN = 2,
    /// A component of the mesh that lies in no component of its label.
    LAPD_DEFECT_STRAY = 3,
    /// An edge at which more than two facets of the label's boundary meet.
    LAPD_DEFECT_NON_MANIFOLD_EDGE = 4,
    /// A vertex, on no such edge, at which more than one sheet of the label's boundary meet.
    LAPD_DEFECT_NON_MANIFOLD_VERTEX = 5,
    /// A component of the image that was left out for its size, as asked
    /// (lapd_params_set_min_voxels).
    LAPD_DEFECT_DROPPED = 6,
}

/// A place where the topology of a label in the mesh is not that of a solid, or not that of the
/// image. Set struct_size to sizeof(lapd_defect) before the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_defect {
    /// sizeof(lapd_defect), set by the caller.
    pub struct_size: u64,
    /// What is wrong, a lapd_defect_kind.
    pub kind: i64,
    /// The label.
    pub label: i64,
    /// Where, in world units: the centre of the component's first voxel, the centroid of its first
    /// tet, the middle of the edge, the vertex.
    pub position: [f64; 3],
    /// Voxels of the component of the image, tets of that of the mesh; 0 for an edge or vertex.
    pub size: u64,
}

// SAFETY of all three: repr(C), numbers only, `struct_size: u64` first. FIRST_SIZE is that of the
// first version that had it and stays when fields are appended.
unsafe impl Growing for lapd_label_row {
    const FIRST_SIZE: u64 = 64;
}
unsafe impl Growing for lapd_component_row {
    const FIRST_SIZE: u64 = 136;
}
unsafe impl Growing for lapd_defect {
    const FIRST_SIZE: u64 = 56;
}

/// Writes how many rows a table of the certificate has.
unsafe fn count_rows(
    mesh: *const lapd_mesh,
    count: *mut usize,
    rows: impl FnOnce(&Certificate) -> usize,
) -> Outcome<()> {
    // SAFETY: the caller's pointers, as the module's head demands.
    unsafe {
        let out = Out::new(count, "count")?;
        out.set(rows(certificate_of(mesh)?));
    }
    Ok(())
}

/// Row `index` of a table whose rows are called `what`.
fn row_of<'a, T>(rows: &'a [T], index: usize, what: &str) -> Outcome<&'a T> {
    rows.get(index).ok_or_else(|| Failure::invalid(format!("there is no {what} {index}")))
}

/// The number of rows that lapd_mesh_get_label_row has: one for each label that was meshed. Any
/// thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
/// mesh has no certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_label_row_count(
    mesh: *const lapd_mesh,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe { count_rows(mesh, count, |certificate| certificate.labels.len()) })
}

/// Row `index` (from 0) of the table of labels. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
/// struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
/// certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_label_row(
    mesh: *const lapd_mesh,
    index: usize,
    row: *mut lapd_label_row,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let found = row_of(&certificate_of(mesh)?.labels, index, "label row")?;
        let improvement = &borrow(mesh, "mesh")?.result.report.improvement;
        let value = lapd_label_row {
            struct_size: own_size::<lapd_label_row>(),
            label: found.label.into(),
            tets: found.tets,
            mesh_volume: found.mesh_volume,
            image_volume: found.image_volume,
            image_voxels: found.image_voxels,
            components_image: found.components_image,
            components_mesh: found.components_mesh,
            components_lost: found.components_lost,
            components_merged: found.components_merged,
            pieces: found.pieces,
            euler_image: found.euler_image,
            euler_mesh: found.euler_mesh,
            non_manifold_edges: found.non_manifold_edges,
            non_manifold_vertices: found.non_manifold_vertices,
            mesh_to_image_mean: mean(found.mesh_to_image),
            mesh_to_image_max: max(found.mesh_to_image),
            image_to_mesh_mean: mean(found.image_to_mesh),
            image_to_mesh_max: max(found.image_to_mesh),
            mesh_to_surface_mean: mean(found.mesh_to_surface),
            mesh_to_surface_max: max(found.mesh_to_surface),
            surface_to_mesh_mean: mean(found.surface_to_mesh),
            surface_to_mesh_max: max(found.surface_to_mesh),
            volume_change: improvement.counts.volume_of(found.label),
        };
        fill_struct(row, value, "row")
    })
}

/// The number of rows that lapd_mesh_get_component_row has: one for each component of the image
/// that has LAPD_MIN_COMPONENT_VOXELS or more. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
/// mesh has no certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_component_row_count(
    mesh: *const lapd_mesh,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe { count_rows(mesh, count, |certificate| certificate.components.len()) })
}

/// Row `index` (from 0) of the table of components. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
/// struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
/// certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_component_row(
    mesh: *const lapd_mesh,
    index: usize,
    row: *mut lapd_component_row,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let found = row_of(&certificate_of(mesh)?.components, index, "component row")?;
        let fate = match found.fate {
            Fate::Kept => lapd_fate::LAPD_FATE_KEPT,
            Fate::Merged => lapd_fate::LAPD_FATE_MERGED,
            Fate::Lost => lapd_fate::LAPD_FATE_LOST,
        };
        let value = lapd_component_row {
            struct_size: own_size::<lapd_component_row>(),
            label: found.label.into(),
            fate: fate as i64,
            position: found.position,
            image_voxels: found.image_voxels,
            image_volume: found.image_volume,
            tets: found.tets,
            mesh_volume: found.mesh_volume,
            components_mesh: found.components_mesh,
            euler_image: found.euler_image,
            euler_mesh: found.euler_mesh,
            mesh_to_image_mean: mean(found.mesh_to_image),
            mesh_to_image_max: max(found.mesh_to_image),
            image_to_mesh_mean: mean(found.image_to_mesh),
            image_to_mesh_max: max(found.image_to_mesh),
            mesh_to_surface_mean: mean(found.mesh_to_surface),
            mesh_to_surface_max: max(found.mesh_to_surface),
            surface_to_mesh_mean: mean(found.surface_to_mesh),
            surface_to_mesh_max: max(found.surface_to_mesh),
        };
        fill_struct(row, value, "row")
    })
}

/// The number of places that lapd_mesh_get_defect has. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
/// mesh has no certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_defect_count(
    mesh: *const lapd_mesh,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe { count_rows(mesh, count, |certificate| certificate.defects.len()) })
}

/// Place `index` (from 0) where the topology of a label is at fault; they are in the order of
/// lapd_defect_kind. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
/// struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
/// certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_defect(
    mesh: *const lapd_mesh,
    index: usize,
    defect: *mut lapd_defect,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let found = row_of(&certificate_of(mesh)?.defects, index, "defect")?;
        let kind = match found.kind {
            DefectKind::Lost => lapd_defect_kind::LAPD_DEFECT_LOST,
            DefectKind::Merged => lapd_defect_kind::LAPD_DEFECT_MERGED,
            DefectKind::Torn => lapd_defect_kind::LAPD_DEFECT_TORN,
            DefectKind::Stray => lapd_defect_kind::LAPD_DEFECT_STRAY,
            DefectKind::NonManifoldEdge => lapd_defect_kind::LAPD_DEFECT_NON_MANIFOLD_EDGE,
            DefectKind::NonManifoldVertex => lapd_defect_kind::LAPD_DEFECT_NON_MANIFOLD_VERTEX,
            DefectKind::Dropped => lapd_defect_kind::LAPD_DEFECT_DROPPED,
        };
        let value = lapd_defect {
            struct_size: own_size::<lapd_defect>(),
            kind: kind as i64,
            label: found.label.into(),
            position: found.position,
            size: found.size,
        };
        fill_struct(defect, value, "defect")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_sizes_fit() {
        own_size::<lapd_label_row>();
        own_size::<lapd_component_row>();
        own_size::<lapd_defect>();
    }
}
