//! What the removal of slivers did, and the tets that it left.

use super::boundary::{Failure, Growing, Out, borrow, fill_struct, status_of};
use super::mesh::lapd_mesh;
use super::report::{of_run, own_size};
use super::status::lapd_status;
use crate::improve::Cause;

/// What coarsening and the removal of slivers did. Set struct_size to sizeof(lapd_improvement)
/// before the call. All is 0 with LAPD_IMPROVE_NONE.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_improvement {
    /// sizeof(lapd_improvement), set by the caller.
    pub struct_size: u64,
    /// The dihedral angle that was asked for, degrees.
    pub target_dihedral: f64,
    /// How far interfaces might be moved.
    pub tolerance: f64,
    /// Tets with a label other than 0 below the target before.
    pub below_before: u64,
    /// Those that are left below it: lapd_mesh_get_left.
    pub left: u64,
    /// Edges removed inside of labels.
    pub edge_removals: u64,
    /// Edges flipped on interfaces.
    pub interface_flips: u64,
    /// Moves of vertices inside of labels.
    pub moves_inside: u64,
    /// Moves of vertices on interfaces between two labels and in walls.
    pub moves_on_interfaces: u64,
    /// Moves of vertices where three labels or more meet, or an interface meets a wall.
    pub moves_on_junctions: u64,
    /// Edges split inside of labels: vertices that were added.
    pub splits: u64,
    /// The largest distance between an interface edge that was flipped and the one in its place.
    pub max_flip: f64,
    /// The largest distance of a vertex on an interface from where refinement put the interface; of
    /// a mesh that was coarsened, from the facets that are left, with refinement's vertices. Where
    /// coarsening made one vertex of two on an interface, it counts from the image's interface.
    pub max_interface_move: f64,
    /// The largest distance of any vertex from where refinement put it. Where coarsening made one
    /// of two on an interface or a line, it counts from the place there.
    pub max_move: f64,
    /// Facets between tets with labels other than 0 that are not Delaunay any more.
    pub non_delaunay_facets: u64,
    /// Tets of background within the image that became a part of the label beside them, where the
    /// image cuts that off.
    pub nicks_filled: u64,
    /// Edges contracted, as lapd_params_set_coarsen asks for: vertices that are gone.
    pub contractions: u64,
    /// Tets with a label other than 0 before the first of them; 0 where none was asked for.
    pub tets_before: u64,
    /// Interface facets with an angle below that of lapd_params_set_facet_angle. Refinement leaves
    /// a few where the image cuts the object off; others come of tets_mended and of contractions.
    pub facets_below: u64,
    /// Tets that got another label, with LAPD_ADAPTIVE_TOPOLOGY and LAPD_IMPROVE_FULL: so that a
    /// component has the Euler characteristic that it has in the image, or is joined with a piece
    /// that was torn off.
    pub tets_mended: u64,
}

/// Why a tet is left: the first of these that one of its vertices belongs to.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_left_cause {
    /// Voxels of a label that touch in an edge or a corner, within a voxel.
    LAPD_LEFT_CONTACT = 0,
    /// A wall, where the image cuts the object off.
    LAPD_LEFT_WALL = 1,
    /// A line or corner where three labels or more meet.
    LAPD_LEFT_JUNCTION = 2,
    /// An interface between two labels.
    LAPD_LEFT_INTERFACE = 3,
    /// None of these: all vertices are inside of the label.
    LAPD_LEFT_INSIDE = 4,
}

/// A tet that is left below the target. Set struct_size to sizeof(lapd_left) before the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_left {
    /// sizeof(lapd_left), set by the caller.
    pub struct_size: u64,
    /// Its index among the tets of the mesh.
    pub tet: u64,
    /// Its label.
    pub label: i64,
    /// What was in the way, a lapd_left_cause.
    pub cause: i64,
    /// Its centroid, in world units.
    pub position: [f64; 3],
    /// Its smallest dihedral angle, degrees.
    pub min_dihedral: f64,
    /// Its largest dihedral angle, degrees.
    pub max_dihedral: f64,
}

// SAFETY of both: repr(C), numbers only, `struct_size: u64` first. FIRST_SIZE is that of the first
// version that had it and stays when fields are appended.
unsafe impl Growing for lapd_improvement {
    const FIRST_SIZE: u64 = 120;
}
unsafe impl Growing for lapd_left {
    const FIRST_SIZE: u64 = 72;
}

/// What the removal of slivers did. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_improvement(
    mesh: *const lapd_mesh,
    improvement: *mut lapd_improvement,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        of_run(mesh, improvement, "improvement", |result| {
            let found = &result.report.improvement;
            let counts = &found.counts;
            lapd_improvement {
                struct_size: own_size::<lapd_improvement>(),
                target_dihedral: found.target,
                tolerance: found.tolerance,
                below_before: found.below_before,
                left: found.left.len() as u64,
                edge_removals: counts.edge_removals,
                interface_flips: counts.interface_flips,
                moves_inside: counts.moves_inside,
                moves_on_interfaces: counts.moves_on_interfaces,
                moves_on_junctions: counts.moves_on_junctions,
                splits: counts.splits,
                max_flip: counts.max_flip,
                max_interface_move: counts.max_interface_move,
                max_move: found.max_move,
                non_delaunay_facets: found.non_delaunay_facets,
                nicks_filled: found.nicks_filled,
                contractions: counts.contractions,
                tets_before: found.tets_before,
                facets_below: found.facets_below,
                tets_mended: found.tets_mended,
            }
        })
    }
}

/// The number of tets that lapd_mesh_get_left has. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_left_count(
    mesh: *const lapd_mesh,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(count, "count")?;
        out.set(borrow(mesh, "mesh")?.result.report.improvement.left.len());
        Ok(())
    })
}

/// Tet `index` (from 0) of those that are left below the target. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
/// struct_size is not that of a known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_left(
    mesh: *const lapd_mesh,
    index: usize,
    left: *mut lapd_left,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let result = &borrow(mesh, "mesh")?.result;
        let found = result.report.improvement.left.get(index);
        let found = found
            .ok_or_else(|| Failure::invalid(format!("there is no tet {index} that is left")))?;
        let cause = match found.cause {
            Cause::Contact => lapd_left_cause::LAPD_LEFT_CONTACT,
            Cause::Wall => lapd_left_cause::LAPD_LEFT_WALL,
            Cause::Junction => lapd_left_cause::LAPD_LEFT_JUNCTION,
            Cause::Interface => lapd_left_cause::LAPD_LEFT_INTERFACE,
            Cause::Inside => lapd_left_cause::LAPD_LEFT_INSIDE,
        };
        let value = lapd_left {
            struct_size: own_size::<lapd_left>(),
            tet: found.tet.into(),
            label: result.mesh.labels[found.tet as usize].into(),
            cause: cause as i64,
            position: found.position,
            min_dihedral: found.angles[0],
            max_dihedral: found.angles[1],
        };
        fill_struct(left, value, "left")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_sizes_fit() {
        own_size::<lapd_improvement>();
        own_size::<lapd_left>();
    }
}
