//! Files of finished meshes, and how they are written.

use std::ffi::c_char;

use super::boundary::{Out, Outcome, borrow, borrow_mut, c_str, catch, status_of, value_or};
use super::context::{lapd_context, with_context};
use super::image::to_path;
use super::mesh::lapd_mesh;
use super::params::flag;
use super::pool::{processors, with_pool};
use super::status::lapd_status;
use crate::io::write::{MeshFormat, WriteOptions, write_mesh_watching};

/// Checks that lapd_mesh_write knows the end of this name, so that another one can be refused
/// before a mesh is made for it. Nothing is opened: whether the file can be written is seen when it
/// is. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or no format has this ending.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_check_path(
    context: *mut lapd_context,
    path: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            MeshFormat::from_path(to_path(c_str(path, "path")?)?)?;
            Ok(())
        })
    }
}

/// Writes a mesh to a file; the format is told by the end of its name:
/// - .vtu: VTK XML; .vtk: VTK legacy, binary; tets, then facets; cell arrays "label",
///   "BoundaryLabels" and "boundary"; .vtkhdf: the same in HDF5, where lapd_features has "hdf5";
/// - .vtm: VTK multi-block; a .vtu file for each region and each boundary in the folder of the same
///   name beside this file, "mesh" beside "mesh.vtm", which is the index of their names;
/// - .xdmf: XDMF with a .h5 file of the same name beside it, where lapd_features has "hdf5";
/// - .mesh: MEDIT; references of tets are labels, those of triangles number the boundaries;
/// - .node .ele .face: TetGen, always all three; first attribute and boundary marker likewise;
/// - .msh .msh4 .msh41: Gmsh MSH 4.1; .msh2 .msh22: MSH 2.2; both binary; a volume and a physical
///   group for each region, a surface and a physical group for each boundary. Tags are labels where
///   these are positive; labels of 0 and below get the numbers after the largest label, 0 first;
///   boundaries those after these;
/// - .inp: Abaqus; an element set for each region, an element-based surface for each boundary;
/// - .exo .ex2 .e: Exodus II; an element block for each region, a side set for each boundary, and a
///   second one for its other side where that is a region;
/// - .foam: OpenFOAM; the mesh is constant/polyMesh beside this file, which is empty; a zone of
///   cells for each region, a patch for each boundary to the outside, a zone of faces for others;
/// - .mfem: MFEM mesh 1.3; .feb: FEBio 4.0; .bdf .nas: Nastran; .unv: I-DEAS universal file;
///   attributes, element sets, properties or groups for regions and boundaries;
/// - .stl .ply .off: the interface facets alone, STL and PLY binary; PLY has properties first_label
///   and second_label.
///
/// A region is the tets of a label. It is called as the label is (lapd_mesh_get_label_name), or
/// "label_7". A boundary is the facets of two labels, "liver__spleen", the smaller label first, or
/// of one label and the outside, "liver__background". Where the image cuts a region off, each face
/// of the image's box is a boundary of its own, "liver__wall_x_min" (see lapd_wall). Names are made
/// of letters, digits, '_' and '-'; other characters become '_'.
///
/// Meshes of order 2 are written with all their nodes: VTK's cell type 24, MEDIT's TetrahedraP2 and
/// TrianglesP2, Gmsh's types 11 and 9, C3D10, and the like. TetGen's, OpenFOAM's and MFEM's files
/// can't hold them; surfaces hold their flat facets.
///
/// Where the image told what its world axes mean (lapd_image_get_world_axes) the file says so, as
/// SPACE=LPS, RAS or LAS: in the head of .vtk and .stl and in a comment of .ply, where 3D Slicer
/// looks for it, in comments of .mesh, .node, .ele, .face, .msh, .msh2, .inp, and in .vtu, .vtm and
/// .vtkhdf as the field array SPACE of character codes. .off and .unv have no place for it.
///
/// `path` is UTF-8; on Unix any bytes that name a file are taken. An existing file is replaced. Any
/// thread; several may write the same mesh at once, to different files. The work is shared by as
/// many threads as the calling one may use processors; they are joined at return.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, no format has this ending, or the
/// format has no tets of the mesh's order; LAPD_ERROR_IO when the file cannot be written;
/// LAPD_ERROR_LIMIT_REACHED when the mesh has more vertices or tets than the format can number;
/// LAPD_ERROR_CANCELLED after lapd_context_cancel, which leaves an existing file as it is;
/// LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_write(
    context: *mut lapd_context,
    mesh: *const lapd_mesh,
    path: *const c_char,
) -> lapd_status {
    // SAFETY: passed on to the caller; the defaults are meant.
    unsafe { lapd_mesh_write_with(context, mesh, path, std::ptr::null()) }
}

/// As lapd_mesh_write, with choices; NULL for `options` means the defaults.
///
/// Any thread, as lapd_mesh_write; none may change `options` meanwhile.
///
/// Errors: those of lapd_mesh_write; LAPD_ERROR_INVALID_ARGUMENT for measures in another file than
/// .vtu.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_write_with(
    context: *mut lapd_context,
    mesh: *const lapd_mesh,
    path: *const c_char,
    options: *const lapd_write_options,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let lapd_mesh { result, world, names, .. } = borrow(mesh, "mesh")?;
            let path = to_path(c_str(path, "path")?)?;
            let cancel = &context.cancel;
            let defaults = lapd_write_options::default();
            let chosen = if options.is_null() { &defaults } else { borrow(options, "options")? };
            let options = WriteOptions {
                measures: chosen.measures,
                world: *world,
                names: Some(names.all()),
                parts: chosen.parts,
            };
            let write = || Ok(write_mesh_watching(&result.mesh, path, options, Some(cancel))?);
            with_pool(processors(), |pool| pool.install(|| catch(write)))?
        })
    }
}

/// How a file of a mesh is written: lapd_mesh_write_with.
#[derive(Default)]
pub struct lapd_write_options {
    measures: bool,
    parts: bool,
}

/// Makes options, all of them as lapd_mesh_write has them.
///
/// The caller owns `*options` and frees it with lapd_write_options_free. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `options` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_write_options_create(
    options: *mut *mut lapd_write_options,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        Out::new(options, "options")?.set(Box::into_raw(Box::default()));
        Ok(())
    })
}

/// Frees options. NULL is allowed and does nothing. Any thread; no call may be using them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_write_options_free(options: *mut lapd_write_options) {
    value_or((), || {
        if !options.is_null() {
            // SAFETY: see the module's head.
            drop(unsafe { Box::from_raw(options) });
        }
    });
}

/// Whether a .vtu file gets a cell array (Float32) for each lapd_tet_measure: min_dihedral,
/// max_dihedral, scaled_jacobian, edge_ratio, radius_ratio, radius_edge; NaN for facets. 1 or 0,
/// the default. No other thread may use `options` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `measures` is neither 0 nor 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_write_options_set_measures(
    context: *mut lapd_context,
    options: *mut lapd_write_options,
    measures: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, options, |options| {
            options.measures = flag(measures, "measures")?;
            Ok(())
        })
    }
}

/// Whether each connected part of a boundary, of facets that have edges in common, is a boundary of
/// its own: "vessel__wall_x_min_1", "vessel__wall_x_min_2", the one with most facets first. 1 or 0,
/// the default. No other thread may use `options` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `parts` is neither 0 nor 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_write_options_set_boundary_parts(
    context: *mut lapd_context,
    options: *mut lapd_write_options,
    parts: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, options, |options| {
            options.parts = flag(parts, "parts")?;
            Ok(())
        })
    }
}

/// # Safety
/// See the module's head.
unsafe fn change(
    context: *mut lapd_context,
    options: *mut lapd_write_options,
    change: impl FnOnce(&mut lapd_write_options) -> Outcome<()>,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    unsafe { with_context(context, |_| change(borrow_mut(options, "options")?)) }
}
