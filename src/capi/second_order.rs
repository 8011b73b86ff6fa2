//! What is known of the nodes in the middles of edges.

use super::boundary::Growing;
use super::mesh::lapd_mesh;
use super::report::{fill, own_size};
use super::status::lapd_status;

/// The nodes in the middles of edges, and where curving put them. Set struct_size to
/// sizeof(lapd_second_order) before the call. All is 0 for a mesh of order 1, and all but `nodes`
/// without lapd_params_set_curved.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_second_order {
    /// sizeof(lapd_second_order), set by the caller.
    pub struct_size: u64,
    /// The nodes in the middles of edges: points behind the vertices.
    pub nodes: u64,
    /// Those on interfaces that were moved from the middle of their edge.
    pub curved: u64,
    /// Those among the moved ones that do not go all the way, so that tets stay valid.
    pub shortened: u64,
    /// Those on interfaces that stay, so that tets stay valid.
    pub straight: u64,
    /// The largest distance of a node from the middle of its edge.
    pub max_move: f64,
    /// The least determinant of the Jacobian in a tet with a moved node, in parts of the
    /// determinant of the straight tet: a bound from below, by Bezier coefficients.
    pub min_jacobian: f64,
    /// The volume of all tets, curved as they are.
    pub volume: f64,
}

// SAFETY: repr(C), numbers only, `struct_size: u64` first. FIRST_SIZE is that of the first version
// that had it and stays when fields are appended.
unsafe impl Growing for lapd_second_order {
    const FIRST_SIZE: u64 = 64;
}

/// The nodes in the middles of edges, and where curving put them. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_second_order(
    mesh: *const lapd_mesh,
    second_order: *mut lapd_second_order,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        fill(mesh, second_order, "second_order", |result| {
            let found = &result.report.second_order;
            let curving = &found.curving;
            lapd_second_order {
                struct_size: own_size::<lapd_second_order>(),
                nodes: found.nodes,
                curved: curving.curved,
                shortened: curving.shortened,
                straight: curving.straight,
                max_move: curving.max_move,
                min_jacobian: curving.min_jacobian,
                volume: curving.volume,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_size_fits() {
        own_size::<lapd_second_order>();
    }
}
