//! Finished meshes: their arrays, without copying or into a caller's buffers.

use std::ffi::c_char;
use std::ptr;

use super::boundary::{Failure, Out, borrow, c_str, catch, check_buffer, status_of, value_or};
use super::context::{lapd_context, with_context};
use super::image::to_path;
use super::label_names::Names;
use super::params::unknown;
use super::pool::{processors, with_pool};
use super::status::lapd_status;
use crate::geometry::measures::TetMeasure;
use crate::image::{Wall, WorldAxes};
use crate::io::write::write_timeline;
use crate::mesh::TetMesh;
use crate::params::MeshParams;
use crate::pipeline::MeshResult;
use crate::pipeline::report::{About, write_report};

/// A finished tetrahedral mesh in world coordinates, with its report. Nothing but
/// lapd_mesh_certify and lapd_mesh_split_interfaces changes it after it was made, so any number of
/// threads may use it at once.
///
/// Every tet (a, b, c, d) has (b - a) x (c - a) . (d - a) > 0, as in VTK; facet i of a tet is the
/// one opposite to its vertex i.
pub struct lapd_mesh {
    pub(super) result: MeshResult,
    /// What the world axes of its image mean.
    pub(super) world: Option<WorldAxes>,
    /// Each node that was made where interfaces were split, behind the one that it is a copy of.
    /// `None` where none were.
    pub(super) node_pairs: Option<Vec<[u32; 2]>>,
    /// What the run was asked for; `None` of a mesh that no run made.
    pub(super) params: Option<MeshParams>,
    /// The names of labels.
    pub(super) names: Names,
    /// The values that labels 1, 2, ... stand for, where distinct values became labels.
    pub(super) values: Vec<String>,
}

/// A face of the image's box; x, y, z are the axes of the image, and MIN is the face of the voxels
/// with the smallest indices.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_wall {
    /// None of them.
    LAPD_WALL_NONE = 0,
    /// In front of the first voxels along x.
    LAPD_WALL_X_MIN = 1,
    /// Behind the last voxels along x.
    LAPD_WALL_X_MAX = 2,
    /// In front of the first voxels along y.
    LAPD_WALL_Y_MIN = 3,
    /// Behind the last voxels along y.
    LAPD_WALL_Y_MAX = 4,
    /// In front of the first voxels along z.
    LAPD_WALL_Z_MIN = 5,
    /// Behind the last voxels along z.
    LAPD_WALL_Z_MAX = 6,
}

const _: () = {
    assert!(lapd_wall::LAPD_WALL_NONE as u8 == Wall::None as u8);
    assert!(lapd_wall::LAPD_WALL_X_MIN as u8 == Wall::XMin as u8);
    assert!(lapd_wall::LAPD_WALL_Z_MAX as u8 == Wall::ZMax as u8);
};

/// "No tet", among the neighbours of a tet and beside a facet.
pub const LAPD_NO_TET: u32 = u32::MAX;

const _: () = assert!(LAPD_NO_TET == crate::mesh::NONE);

/// Frees a mesh. NULL is allowed and does nothing. Any thread; no call may be using it, and every
/// array got from it is invalid from now on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_free(mesh: *mut lapd_mesh) {
    value_or((), || {
        if !mesh.is_null() {
            // SAFETY: see the module's head.
            drop(unsafe { Box::from_raw(mesh) });
        }
    });
}

/// The limit that ended the refinement of a partial mesh (see lapd_params_set_partial):
/// LAPD_ERROR_LIMIT_REACHED, LAPD_ERROR_TIME_LIMIT or LAPD_ERROR_MEMORY_LIMIT; LAPD_OK for a mesh
/// whose refinement came to its end. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_limit_reached(
    mesh: *const lapd_mesh,
    limit: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(limit, "limit")?;
        let ended_by = borrow(mesh, "mesh")?.result.ended_by.as_ref();
        out.set(ended_by.map_or(lapd_status::LAPD_OK, lapd_status::from) as i32);
        Ok(())
    })
}

/// Writes what each thread of the refinement did when, for a mesh whose parameters asked for it
/// (lapd_params_set_timeline): JSON in Chrome's trace format, which chrome://tracing and
/// ui.perfetto.dev show as one row for each thread.
///
/// Each span of time is an event with "ph": "X"; "tid" is the thread's number as in
/// lapd_mesh_get_thread_report, "ts" and "dur" are microseconds since the refinement began. "name"
/// is "sampling" (inserting samples of the interfaces), "refining", "rolling back" (work on an
/// operation that was given up), "waiting" (after a conflict) or "begging" (without work). The
/// events of a thread stand in the order of time.
///
/// `path` is as in lapd_mesh_write, with any ending. An existing file is replaced. Any thread;
/// several may write at once, to different files. The work is shared by threads as that of
/// lapd_mesh_write.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or no timeline was kept;
/// LAPD_ERROR_IO when the file cannot be written; LAPD_ERROR_CANCELLED after lapd_context_cancel,
/// which leaves an existing file as it is; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_write_timeline(
    context: *mut lapd_context,
    mesh: *const lapd_mesh,
    path: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let threads = &borrow(mesh, "mesh")?.result.report.threads;
            let path = to_path(c_str(path, "path")?)?;
            let cancel = &context.cancel;
            let write = || Ok(write_timeline(threads, path, Some(cancel))?);
            with_pool(processors(), |pool| pool.install(|| catch(write)))?
        })
    }
}

/// Writes all that is known about a mesh, its arrays apart, as one JSON object: what the getters of
/// this interface tell, with the names and values of labels that the image had. A number that is
/// infinite or undefined is null.
///
/// `extra` is NULL, or a JSON object in UTF-8 with what only the caller knows. Its members come
/// beside the library's, and must have other names; but for those of its member "seconds", an
/// object, which join the library's times.
///
/// `path` is as in lapd_mesh_write, with any ending. An existing file is replaced. Any thread;
/// several may write at once, to different files.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument other than `extra` is NULL, or `extra` is
/// no such object; LAPD_ERROR_IO when the file cannot be written; LAPD_ERROR_CANCELLED after
/// lapd_context_cancel, which leaves an existing file as it is; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_write_report(
    context: *mut lapd_context,
    mesh: *const lapd_mesh,
    path: *const c_char,
    extra: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let mesh = borrow(mesh, "mesh")?;
            let path = to_path(c_str(path, "path")?)?;
            let extra = if extra.is_null() {
                serde_json::Map::new()
            } else {
                // Names of files may be any bytes: what is no UTF-8 is replaced.
                let text = c_str(extra, "extra")?.to_string_lossy();
                serde_json::from_str(&text).map_err(|error| {
                    Failure::invalid(format!("extra is no JSON object: {error}"))
                })?
            };
            let about = About {
                params: mesh.params.clone(),
                world: mesh.world,
                names: mesh.names.all().clone(),
                values: &mesh.values,
                extra,
            };
            Ok(write_report(&mesh.result, &about, path, Some(&context.cancel))?)
        })
    }
}

/// Hands out an array of the mesh, flat, with the number of its rows.
///
/// # Safety
/// See the module's head.
unsafe fn lend<T, const N: usize>(
    mesh: *const lapd_mesh,
    array: *mut *const T,
    count: *mut usize,
    rows: impl FnOnce(&TetMesh) -> &[[T; N]],
) -> lapd_status {
    // SAFETY: passed on to the caller.
    status_of(|| unsafe {
        let (array, count) = (Out::new(array, "array")?, Out::new(count, "count")?);
        let rows = rows(&borrow(mesh, "mesh")?.result.mesh);
        array.set(rows.as_ptr().cast());
        count.set(rows.len());
        Ok(())
    })
}

/// Copies an array of the mesh, flat, if `capacity` values are enough.
///
/// # Safety
/// See the module's head.
unsafe fn copy<T: Copy, const N: usize>(
    mesh: *const lapd_mesh,
    buffer: *mut T,
    capacity: usize,
    rows: impl FnOnce(&TetMesh) -> &[[T; N]],
) -> lapd_status {
    // SAFETY: passed on to the caller.
    status_of(|| unsafe {
        let values = rows(&borrow(mesh, "mesh")?.result.mesh).as_flattened();
        check_buffer(buffer, capacity, values.len())?;
        buffer.copy_from_nonoverlapping(values.as_ptr(), values.len());
        Ok(())
    })
}

/// The labels as rows of one.
fn tet_labels(mesh: &TetMesh) -> &[[i32; 1]] {
    mesh.labels.as_chunks().0
}

/// The positions of the vertices in world units: `*points` is [count][3]. In a mesh of order 2 the
/// nodes in the middles of edges come behind them.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_points(
    mesh: *const lapd_mesh,
    points: *mut *const f64,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, points, count, |m| &m.points) }
}

/// The vertices of the tets, as row numbers of the points: `*tets` is [count][4].
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_tets(
    mesh: *const lapd_mesh,
    tets: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, tets, count, |m| &m.tets) }
}

/// The label of every tet: `*labels` is [count]. 0 stands for the background, where that was kept.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_labels(
    mesh: *const lapd_mesh,
    labels: *mut *const i32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, labels, count, tet_labels) }
}

/// The neighbours of the tets across their four facets, or LAPD_NO_TET: `*neighbors` is [count][4].
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_neighbors(
    mesh: *const lapd_mesh,
    neighbors: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, neighbors, count, |m| &m.neighbors) }
}

/// The vertices of the interface facets, those between two labels: `*facets` is [count][3]. The
/// normal (b - a) x (c - a) points from the facet's first label to its second one.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_facets(
    mesh: *const lapd_mesh,
    facets: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, facets, count, |m| &m.facets) }
}

/// The labels on the two sides of the interface facets: `*labels` is [count][2]. The smaller label
/// comes first, and the background, 0, last: the order of BoundaryLabels in VTK's surface filters.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_facet_labels(
    mesh: *const lapd_mesh,
    labels: *mut *const i32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, labels, count, |m| &m.facet_labels) }
}

/// The face of the image's box that each interface facet lies on, a lapd_wall; `*walls` is [count].
/// Where the image cuts the object off, facets lie on a face exactly, and are LAPD_WALL_NONE
/// everywhere else. So are all facets of a mesh from other arrays, until lapd_mesh_certify has
/// compared it with its image.
///
/// The array belongs to the mesh and is valid until it is freed or certified; NULL with a count of
/// 0 where no image is known. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_facet_walls(
    mesh: *const lapd_mesh,
    walls: *mut *const u8,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let (walls, count) = (Out::new(walls, "walls")?, Out::new(count, "count")?);
        let known = &borrow(mesh, "mesh")?.result.mesh.facet_walls;
        // `Wall` is a byte; an empty array has no place.
        walls.set(if known.is_empty() { ptr::null() } else { known.as_ptr().cast() });
        count.set(known.len());
        Ok(())
    })
}

/// The tets on the two sides of the interface facets, in the order of their labels: `*tets` is
/// [count][2]. LAPD_NO_TET where that side is background that was not kept.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_facet_tets(
    mesh: *const lapd_mesh,
    tets: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, tets, count, |m| &m.facet_tets) }
}

/// The nodes in the middles of the edges of the tets, as row numbers of the points: `*nodes` is
/// [count][6]; of a tet (a, b, c, d) they are those of its edges ab, bc, ca, ad, bd, cd, as in VTK.
/// The count is 0 for a mesh of order 1 (see lapd_params_set_order).
///
/// Of the points those of the vertices come first, as many as lapd_counts.vertices tells; then
/// these nodes.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_tet_mid_nodes(
    mesh: *const lapd_mesh,
    nodes: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, nodes, count, |m| m.mid_nodes.as_ref().map_or(&[], |nodes| &nodes.tets)) }
}

/// The nodes in the middles of the edges of the interface facets: `*nodes` is [count][3]; of a
/// facet (a, b, c) they are those of its edges ab, bc, ca. Otherwise as
/// lapd_mesh_get_tet_mid_nodes.
///
/// The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_facet_mid_nodes(
    mesh: *const lapd_mesh,
    nodes: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { lend(mesh, nodes, count, |m| m.mid_nodes.as_ref().map_or(&[], |nodes| &nodes.facets)) }
}

/// Copies the points into a buffer of `capacity` values, 3 for each vertex and node. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_points(
    mesh: *const lapd_mesh,
    buffer: *mut f64,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.points) }
}

/// Copies the tets into a buffer of `capacity` values, 4 for each tet. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_tets(
    mesh: *const lapd_mesh,
    buffer: *mut u32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.tets) }
}

/// Copies the labels of the tets into a buffer of `capacity` values, 1 for each tet. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_labels(
    mesh: *const lapd_mesh,
    buffer: *mut i32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, tet_labels) }
}

/// Copies the neighbours of the tets into a buffer of `capacity` values, 4 for each tet. Any
/// thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_neighbors(
    mesh: *const lapd_mesh,
    buffer: *mut u32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.neighbors) }
}

/// Copies the interface facets into a buffer of `capacity` values, 3 for each facet. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_facets(
    mesh: *const lapd_mesh,
    buffer: *mut u32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.facets) }
}

/// Copies the labels of the interface facets into a buffer of `capacity` values, 2 for each facet.
/// Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_facet_labels(
    mesh: *const lapd_mesh,
    buffer: *mut i32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.facet_labels) }
}

/// Copies the tets beside the interface facets into a buffer of `capacity` values, 2 for each
/// facet. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_facet_tets(
    mesh: *const lapd_mesh,
    buffer: *mut u32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { copy(mesh, buffer, capacity, |m| &m.facet_tets) }
}

/// A measure that each tet has a value of. But for the last, they are those of Verdict and VTK.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_tet_measure {
    /// The smallest dihedral angle, degrees.
    LAPD_MEASURE_MIN_DIHEDRAL = 0,
    /// The largest dihedral angle, degrees.
    LAPD_MEASURE_MAX_DIHEDRAL = 1,
    /// The Jacobian over the largest product of the three edges of a vertex, times the root of 2: 1
    /// for a regular tet, 0 for a flat one.
    LAPD_MEASURE_SCALED_JACOBIAN = 2,
    /// The longest edge over the shortest one: 1 for a regular tet.
    LAPD_MEASURE_EDGE_RATIO = 3,
    /// The circumradius over three times the inradius: 1 for a regular tet.
    LAPD_MEASURE_RADIUS_RATIO = 4,
    /// The circumradius over the shortest edge, which Delaunay refinement bounds: 0.61 for a
    /// regular tet.
    LAPD_MEASURE_RADIUS_EDGE = 5,
}

/// Writes a measure of every tet, a lapd_tet_measure, into a buffer of `capacity` values, one for
/// each tet. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `measure` is no lapd_tet_measure;
/// LAPD_ERROR_BUFFER_TOO_SMALL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_copy_measure(
    mesh: *const lapd_mesh,
    measure: i32,
    buffer: *mut f64,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let mesh = &borrow(mesh, "mesh")?.result.mesh;
        let measure = match measure {
            m if m == lapd_tet_measure::LAPD_MEASURE_MIN_DIHEDRAL as i32 => TetMeasure::MinDihedral,
            m if m == lapd_tet_measure::LAPD_MEASURE_MAX_DIHEDRAL as i32 => TetMeasure::MaxDihedral,
            m if m == lapd_tet_measure::LAPD_MEASURE_SCALED_JACOBIAN as i32 => {
                TetMeasure::ScaledJacobian
            }
            m if m == lapd_tet_measure::LAPD_MEASURE_EDGE_RATIO as i32 => TetMeasure::EdgeRatio,
            m if m == lapd_tet_measure::LAPD_MEASURE_RADIUS_RATIO as i32 => TetMeasure::RadiusRatio,
            m if m == lapd_tet_measure::LAPD_MEASURE_RADIUS_EDGE as i32 => TetMeasure::RadiusEdge,
            _ => return Err(unknown("measure", "a lapd_tet_measure", measure)),
        };
        check_buffer(buffer, capacity, mesh.tets.len())?;
        for (t, tet) in mesh.tets.iter().enumerate() {
            buffer.add(t).write(measure.of(&tet.map(|v| mesh.point(v))));
        }
        Ok(())
    })
}
