//! Split interfaces.

use super::boundary::{Failure, Out, borrow, borrow_mut, catch, slice, status_of};
use super::context::{lapd_context, with_context};
use super::mesh::lapd_mesh;
use super::pool::{processors, with_pool};
use super::status::lapd_status;
use crate::mesh::split::{Split, SplitMesh};
use crate::monitor::Monitor;

/// Gives regions nodes of their own at their interfaces, for contact and cohesive elements: nodes
/// on these interfaces are doubled, or made once for each region where more meet.
///
/// `pairs` is [pair_count][2], the labels on both sides of the interfaces to split, in any order; a
/// `pair_count` of 0, with `pairs` NULL, means all interfaces between regions. Where only some of
/// the interfaces around a line are split, the line is where the cut ends, and its nodes stay one.
///
/// The background is no region, even where it was kept. Facets of split interfaces become two, one
/// for each side, with nodes of that side and its label first; their tets are no neighbours any
/// more. In files they are two boundaries: "liver__spleen" and "spleen__liver". The report, the
/// certificate with it, speaks of the mesh before. Nodes that are copies stand behind the vertices,
/// or, on edges, behind all: lapd_mesh_get_node_pairs.
///
/// Arrays got from the mesh before are invalid afterwards. No other thread may use the mesh
/// meanwhile, or the context but to cancel. The mesh stays as it is when the call fails.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, two labels do not meet or are the
/// same, or interfaces were split before; LAPD_ERROR_LIMIT_REACHED for too many nodes;
/// LAPD_ERROR_CANCELLED after lapd_context_cancel; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_split_interfaces(
    context: *mut lapd_context,
    mesh: *mut lapd_mesh,
    pairs: *const i32,
    pair_count: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let mesh = borrow_mut(mesh, "mesh")?;
            let split = if pair_count == 0 && pairs.is_null() {
                Split::All
            } else {
                let count = pair_count.checked_mul(2).ok_or_else(|| {
                    Failure::invalid(format!("{pair_count} pairs do not fit in memory"))
                })?;
                Split::pairs(slice(pairs, count, "pairs")?.as_chunks().0)?
            };
            if mesh.node_pairs.is_some() {
                return Err(Failure::invalid("interfaces of the mesh were split before"));
            }
            let before = &mesh.result.mesh;
            let cancel = &context.cancel;
            let work = || Ok(before.split(&split, &Monitor::new(None, Some(cancel)))?);
            let SplitMesh { mesh: after, pairs } =
                with_pool(processors(), |pool| pool.install(|| catch(work)))??;
            (mesh.result.mesh, mesh.node_pairs) = (after, Some(pairs));
            Ok(())
        })
    }
}

/// The nodes that were made where interfaces were split: `*pairs` is [count][2], each one behind
/// the node that it is a copy of, as rows of the points. No rows where nothing was split.
///
/// The array belongs to the mesh and is valid until it is freed or its interfaces are split; with a
/// count of 0 it must not be read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_node_pairs(
    mesh: *const lapd_mesh,
    pairs: *mut *const u32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let (pairs, count) = (Out::new(pairs, "pairs")?, Out::new(count, "count")?);
        let rows = borrow(mesh, "mesh")?.node_pairs.as_deref().unwrap_or_default();
        pairs.set(rows.as_ptr().cast());
        count.set(rows.len());
        Ok(())
    })
}
