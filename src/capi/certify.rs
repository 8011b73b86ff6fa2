//! Meshes that are finished: from another program's arrays, and certified later.

use super::boundary::{Failure, Out, Outcome, borrow, borrow_mut, catch, slice};
use super::context::{lapd_context, with_context};
use super::image::lapd_image;
use super::mesh::lapd_mesh;
use super::params::lapd_params;
use super::pool::{processors, with_pool};
use super::run::run;
use super::status::lapd_status;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::pipeline::certify::{certify, from_elsewhere};

/// Makes a mesh of arrays that another program made, to certify it (lapd_mesh_certify) or to write
/// it: `points` is [point_count][3] in world coordinates, `tets` [tet_count][4], `labels`
/// [tet_count]; label 0 is background. The arrays are copied. Tets keep their order and their
/// vertices; neighbours and interface facets are found.
///
/// Every tet (a, b, c, d) should have (b - a) x (c - a) . (d - a) > 0, as in VTK, Gmsh and MEDIT;
/// the certificate counts those that have not.
///
/// What tells of a run is LAPD_ERROR_NOT_MEASURED for such a mesh: operations, improvement,
/// certificate, quality; lapd_counts has 0 for the whole triangulation.
///
/// The caller owns `*mesh` and frees it with lapd_mesh_free. Any thread; the work is done on as
/// many threads as the calling one may use processors, joined at return.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, a coordinate is not finite, a tet
/// has a vertex twice or one that is not there, a facet is one of more than two tets, or two
/// positive tets lie on the same side of a facet; LAPD_ERROR_LIMIT_REACHED for more tets than can
/// be numbered; LAPD_ERROR_CANCELLED after lapd_context_cancel; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_from_arrays(
    context: *mut lapd_context,
    points: *const f64,
    point_count: usize,
    tets: *const u32,
    tet_count: usize,
    labels: *const i32,
    mesh: *mut *mut lapd_mesh,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(mesh, "mesh")?;
            let points = rows::<f64, 3>(points, point_count, "points")?;
            let tets = rows::<u32, 4>(tets, tet_count, "tets")?;
            let labels = slice(labels, tet_count, "labels")?;
            let cancel = &context.cancel;
            let make = || {
                let monitor = Monitor::new(None, Some(cancel));
                Ok(TetMesh::from_arrays(points, tets, labels, &monitor)?)
            };
            let made = with_pool(processors(), |pool| pool.install(|| catch(make)))??;
            let result = from_elsewhere(made);
            let (names, values, node_pairs) = Default::default();
            let mesh = lapd_mesh { result, world: None, node_pairs, params: None, names, values };
            out.set(Box::into_raw(Box::new(mesh)));
            Ok(())
        })
    }
}

/// A caller's array of `count` rows.
///
/// # Safety
/// As [`slice`], with `count * N` values.
unsafe fn rows<'a, T, const N: usize>(
    pointer: *const T,
    count: usize,
    name: &str,
) -> Outcome<&'a [[T; N]]> {
    let values = count.checked_mul(N).ok_or_else(|| {
        Failure::invalid(format!("{name}: {count} rows of {N} values do not fit in memory"))
    })?;
    // SAFETY: passed on to the caller.
    Ok(unsafe { slice(pointer, values, name) }?.as_chunks().0)
}

/// Measures the certificate of a finished mesh, and its quality, against an image: of a mesh from
/// other arrays, of one whose run had no certificate, or to add what a level has more. They take
/// the place of what was measured before.
///
/// Of `params` count: the certificate's level, threads, the time and memory limits; and what tells
/// which image the mesh is to be compared with, as it was told the run: labels merged, kept and of
/// the background, the fewest voxels, sigma, surface and border. With another image or others of
/// these the certificate tells how far the mesh is from that.
///
/// A run counts facets that are not Delaunay before it improves the mesh, and rules that stay
/// unmet; these counts stay. Where a run had no certificate, or there was none, the facets are
/// counted now, unless the mesh was improved; what is not counted is LAPD_NOT_COUNTED, null in
/// JSON.
///
/// Runs like lapd_mesh_image: callbacks are called on this thread, the work is done by threads that
/// are joined at return, `*mesh` stays as it is when the call fails. No other thread may use the
/// mesh meanwhile, or the context but to cancel, nor change `params`.
///
/// Errors: those of lapd_mesh_image for an argument, an image and its labels;
/// LAPD_ERROR_INVALID_ARGUMENT for LAPD_CERTIFICATE_NONE and for a mesh whose interfaces were
/// split; LAPD_ERROR_EMPTY_IMAGE; LAPD_ERROR_CANCELLED; LAPD_ERROR_TIME_LIMIT;
/// LAPD_ERROR_MEMORY_LIMIT; LAPD_ERROR_OUT_OF_MEMORY; LAPD_ERROR_BUSY when the context is in use by
/// a run.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_certify(
    context: *mut lapd_context,
    mesh: *mut lapd_mesh,
    image: *const lapd_image,
    params: *const lapd_params,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let mesh = borrow_mut(mesh, "mesh")?;
            let image = borrow(image, "image")?;
            let params = borrow(params, "params")?.params.clone();
            if mesh.node_pairs.is_some() {
                return Err(Failure::invalid(
                    "interfaces of the mesh were split: certify it before that",
                ));
            }
            let _run = context.start_run()?;
            let callbacks = context.callbacks();
            let result = &mut mesh.result;
            run(params.threads, &context.cancel, &callbacks, |monitor| {
                Ok(certify(result, &image.image, &params, monitor)?)
            })?;
            if mesh.params.is_none() {
                mesh.names = image.names.merged(&params.merge);
                mesh.values = image.values();
                mesh.world = image.world;
            }
            Ok(())
        })
    }
}
