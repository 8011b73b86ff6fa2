//! Parameters of a run; those of its labels are in [`labels`](super::labels), those of its threads
//! in [`threads`](super::threads).
//!
//! Every setter tries its value on a copy and lets [`MeshParams::validate`] judge, so that ranges
//! are stated in one place.

use std::ffi::CString;

use super::boundary::{Failure, Out, Outcome, borrow, borrow_mut, status_of, value_or};
use super::context::{lapd_context, with_context};
use super::status::lapd_status;
use crate::params::{Algorithm, ImageBorder, Improve, MeshParams, SurfaceModel, check_label_size};

/// Parameters of a run, with defaults for all. Not to be changed while another thread uses them; a
/// run takes a copy.
pub struct lapd_params {
    pub(super) params: MeshParams,
    /// The description of the machine in `params`; empty where that is the one at hand.
    pub(super) topology: CString,
}

/// How labels between voxel centres are decided.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_surface {
    /// The label whose indicator, interpolated trilinearly, is largest; of images made of
    /// intensities or probabilities, these are interpolated. The default.
    LAPD_SURFACE_SMOOTH = 0,
    /// The label of the nearest voxel: interfaces are voxel faces.
    LAPD_SURFACE_VOXEL = 1,
}

/// How the object is closed where it reaches the border of the image.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_border {
    /// By flat walls with sharp edges, the outer faces of the outermost voxels. The default.
    LAPD_BORDER_FLAT = 0,
    /// By the smooth surface, as if one more layer of background lay around the image. With
    /// LAPD_SURFACE_VOXEL the same as LAPD_BORDER_FLAT.
    LAPD_BORDER_SMOOTH = 1,
}

/// How the work is shared by threads.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_algorithm {
    /// Speculative refinement of one triangulation by all threads, each where it comes to. The
    /// default.
    LAPD_ALGORITHM_PODM = 0,
    /// The same, with a region for the threads of each memory node, whose memory they visit most of
    /// the time. On a machine of one memory node the same as LAPD_ALGORITHM_PODM.
    LAPD_ALGORITHM_LAPD = 1,
}

/// What may be changed to remove slivers from the refined mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_improve {
    /// Nothing: the mesh is Delaunay, as refinement leaves it, and has slivers.
    LAPD_IMPROVE_NONE = 0,
    /// What lies inside of the labels. Their interfaces stay bit for bit as refinement leaves them.
    LAPD_IMPROVE_INTERIOR = 1,
    /// Interfaces, too: edges on them are flipped, and vertices move along what they belong to. The
    /// default.
    LAPD_IMPROVE_FULL = 2,
}

pub(super) fn unknown(argument: &str, type_name: &str, number: i32) -> Failure {
    Failure::invalid(format!("{argument} must be {type_name}, got {number}"))
}

/// `on` or `off` of a C flag.
pub(super) fn flag(number: i32, argument: &str) -> Outcome<bool> {
    match number {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(unknown(argument, "0 or 1", number)),
    }
}

/// Makes a change in place: one that leaves all as it was where it fails, and all valid where it
/// does not. Of single labels there may be many: no time may be spent on all for each of them.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn edit(
    context: *mut lapd_context,
    params: *mut lapd_params,
    edit: impl FnOnce(&mut MeshParams) -> Outcome<()>,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    unsafe { with_context(context, |_| edit(&mut borrow_mut(params, "params")?.params)) }
}

/// Applies a change if the result is valid.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn change(
    context: *mut lapd_context,
    params: *mut lapd_params,
    edit: impl FnOnce(&mut MeshParams) -> Outcome<()>,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    unsafe {
        with_context(context, |_| {
            let params = &mut borrow_mut(params, "params")?.params;
            let mut changed = params.clone();
            edit(&mut changed)?;
            changed.validate()?;
            *params = changed;
            Ok(())
        })
    }
}

/// Reads a value.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn read<T>(
    params: *const lapd_params,
    out: *mut T,
    name: &str,
    value: impl FnOnce(&MeshParams) -> T,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    status_of(|| unsafe {
        let out = Out::new(out, name)?;
        out.set(value(&borrow(params, "params")?.params));
        Ok(())
    })
}

/// Creates parameters with the defaults: delta 1, size 2, radius-edge bound 2, facet angle 30
/// degrees, slivers removed to a dihedral angle of 15 degrees, smooth surfaces, flat walls at the
/// border of the image, all labels, no background, 1 thread, no limits.
///
/// The caller owns `*params` and frees it with lapd_params_free. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `params` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_create(params: *mut *mut lapd_params) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(params, "params")?;
        out.set(Box::into_raw(Box::new(lapd_params {
            params: MeshParams::default(),
            topology: CString::default(),
        })));
        Ok(())
    })
}

/// Frees parameters. NULL is allowed and does nothing. Any thread; no call may be using them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_free(params: *mut lapd_params) {
    value_or((), || {
        if !params.is_null() {
            // SAFETY: see the module's head.
            drop(unsafe { Box::from_raw(params) });
        }
    });
}

/// Sets the distance between samples on the interfaces, in world units; above 0. Smaller means
/// closer to the image. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_delta(
    context: *mut lapd_context,
    params: *mut lapd_params,
    delta: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.delta = delta;
            Ok(())
        })
    }
}

/// The distance between samples on the interfaces. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_delta(
    params: *const lapd_params,
    delta: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, delta, "delta", |p| p.delta) }
}

/// Sets the largest circumradius of tets, in world units; above 0. Samples on the interfaces are no
/// farther apart than 0.7 of it: a larger delta is lowered to that, with a warning. No other thread
/// may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_size(
    context: *mut lapd_context,
    params: *mut lapd_params,
    size: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.size = size;
            Ok(())
        })
    }
}

/// The largest circumradius of tets. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_size(
    params: *const lapd_params,
    size: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, size, "size", |p| p.size) }
}

/// Sets the largest circumradius of the tets of one label (after merging), in world units; above 0.
/// Around the label delta is lowered to 0.7 of that, if it is more. A second call for the label
/// replaces the first. lapd_mesh_image refuses a label that the image
/// does not have. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_label_size(
    context: *mut lapd_context,
    params: *mut lapd_params,
    label: i32,
    size: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        edit(context, params, |p| {
            check_label_size(label, size)?;
            p.label_sizes.insert(label, size);
            Ok(())
        })
    }
}

/// The largest circumradius of the tets of a label: its own, or that of all. Any thread, unless
/// another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_label_size(
    params: *const lapd_params,
    label: i32,
    size: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, size, "size", |p| p.size_of(label)) }
}

/// Forgets the sizes of single labels. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_clear_label_sizes(
    context: *mut lapd_context,
    params: *mut lapd_params,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        edit(context, params, |p| {
            p.label_sizes.clear();
            Ok(())
        })
    }
}

/// Sets the largest ratio of circumradius to shortest edge of tets; at least 2 (below, refinement
/// need not end). No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_radius_edge(
    context: *mut lapd_context,
    params: *mut lapd_params,
    radius_edge: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.radius_edge = radius_edge;
            Ok(())
        })
    }
}

/// The largest ratio of circumradius to shortest edge. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_radius_edge(
    params: *const lapd_params,
    radius_edge: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, radius_edge, "radius_edge", |p| p.radius_edge) }
}

/// Sets the smallest planar angle of interface facets, in degrees; 0 to 30 (above, refinement need
/// not end). No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_facet_angle(
    context: *mut lapd_context,
    params: *mut lapd_params,
    degrees: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.facet_angle = degrees;
            Ok(())
        })
    }
}

/// The smallest planar angle of interface facets, in degrees. Any thread, unless another one
/// changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_facet_angle(
    params: *const lapd_params,
    degrees: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, degrees, "degrees", |p| p.facet_angle) }
}

/// Sets the surface model, a lapd_surface. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, the value is unknown, or it is
/// LAPD_SURFACE_VOXEL and labels are to be smoothed (lapd_params_set_sigma).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_surface(
    context: *mut lapd_context,
    params: *mut lapd_params,
    surface: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.surface = match surface {
                s if s == lapd_surface::LAPD_SURFACE_SMOOTH as i32 => SurfaceModel::Smooth,
                s if s == lapd_surface::LAPD_SURFACE_VOXEL as i32 => SurfaceModel::Voxel,
                _ => return Err(unknown("surface", "a lapd_surface", surface)),
            };
            Ok(())
        })
    }
}

/// The surface model, a lapd_surface. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_surface(
    params: *const lapd_params,
    surface: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, surface, "surface", |p| match p.surface {
            SurfaceModel::Smooth => lapd_surface::LAPD_SURFACE_SMOOTH as i32,
            SurfaceModel::Voxel => lapd_surface::LAPD_SURFACE_VOXEL as i32,
        })
    }
}

/// Sets how the object is closed at the border of the image, a lapd_border. No other thread may use
/// `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_border(
    context: *mut lapd_context,
    params: *mut lapd_params,
    border: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.border = match border {
                b if b == lapd_border::LAPD_BORDER_FLAT as i32 => ImageBorder::Flat,
                b if b == lapd_border::LAPD_BORDER_SMOOTH as i32 => ImageBorder::Smooth,
                _ => return Err(unknown("border", "a lapd_border", border)),
            };
            Ok(())
        })
    }
}

/// How the object is closed at the border of the image, a lapd_border. Any thread, unless another
/// one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_border(
    params: *const lapd_params,
    border: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, border, "border", |p| match p.border {
            ImageBorder::Flat => lapd_border::LAPD_BORDER_FLAT as i32,
            ImageBorder::Smooth => lapd_border::LAPD_BORDER_SMOOTH as i32,
        })
    }
}

/// Whether to keep the whole triangulation (1) or the tissues alone (0). When kept, tets outside of
/// the object have label 0. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_background(
    context: *mut lapd_context,
    params: *mut lapd_params,
    background: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.background = flag(background, "background")?;
            Ok(())
        })
    }
}

/// Whether the whole triangulation is kept, 1 or 0. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_background(
    params: *const lapd_params,
    background: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, background, "background", |p| i32::from(p.background)) }
}

/// Sets the largest number of vertices; a run that needs more ends with LAPD_ERROR_LIMIT_REACHED,
/// or with a partial mesh where lapd_params_set_partial allows it. 0 means no limit. No other
/// thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_max_vertices(
    context: *mut lapd_context,
    params: *mut lapd_params,
    max_vertices: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.max_vertices = (max_vertices > 0).then_some(max_vertices);
            Ok(())
        })
    }
}

/// The largest number of vertices, 0 for no limit. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_max_vertices(
    params: *const lapd_params,
    max_vertices: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, max_vertices, "max_vertices", |p| p.max_vertices.unwrap_or(0)) }
}

/// Sets a limit of time, in wall-clock seconds from the call of lapd_mesh_image on; above 0, or 0
/// for no limit. A run whose refinement has not ended by then ends with LAPD_ERROR_TIME_LIMIT, or
/// with a partial mesh where lapd_params_set_partial allows it.
///
/// The limit ends the preparation of the image and refinement, within some ten milliseconds. What
/// follows is not cut short: collecting and certifying the mesh takes up to twice as long. No other
/// thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is negative or not
/// finite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_time_limit(
    context: *mut lapd_context,
    params: *mut lapd_params,
    seconds: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.time_limit = (seconds != 0.0).then_some(seconds);
            Ok(())
        })
    }
}

/// The limit of time in seconds, 0 for none. Any thread, unless another one changes `params`.
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_time_limit(
    params: *const lapd_params,
    seconds: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, seconds, "seconds", |p| p.time_limit.unwrap_or(0.0)) }
}

/// Sets a limit of memory in bytes, 0 for none. A run that needs more ends with
/// LAPD_ERROR_MEMORY_LIMIT, or with a partial mesh where lapd_params_set_partial allows it.
///
/// Counted are the tables of the run that grow with the image or the mesh: those made of the
/// image's labels, also to find what is thin, of the triangulation and the work that waits, and in
/// advance those of the mesh to come and what its certificate asks of the image, so that the limit
/// holds to the end of the run. What distances need for the mesh is checked only when they
/// are measured: if it does not fit, the run ends with LAPD_ERROR_MEMORY_LIMIT, or with
/// lapd_params_set_partial its certificate has no distances. Not counted are the caller's
/// image, the samples from which the smooth surface's label weights are found (gone before the
/// refinement begins; on a brain atlas of 256^3 voxels 70 MB), threads, and some 10 MB beside. No
/// other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_max_memory(
    context: *mut lapd_context,
    params: *mut lapd_params,
    bytes: u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.max_memory = (bytes > 0).then_some(bytes);
            Ok(())
        })
    }
}

/// The limit of memory in bytes, 0 for none. Any thread, unless another one changes `params`.
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_max_memory(
    params: *const lapd_params,
    bytes: *mut u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, bytes, "bytes", |p| p.max_memory.unwrap_or(0)) }
}

/// Whether a run whose refinement is ended by a limit (of vertices, time or memory) hands out the
/// mesh of what there is by then (1), or none (0, the default). Either way lapd_mesh_image returns
/// the status of the limit, which lapd_mesh_get_limit_reached gives later.
///
/// A partial mesh is a valid Delaunay mesh whose labels are those at the circumcenters of its tets,
/// and whose interfaces are closed. It is coarser than asked for, may be far from the image and
/// miss labels; its certificate says how much, and counts the rules that are still unmet. A limit
/// reached before the object has any tet gives no mesh. A cancelled run never gives a mesh. No
/// other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_partial(
    context: *mut lapd_context,
    params: *mut lapd_params,
    partial: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.partial = flag(partial, "partial")?;
            Ok(())
        })
    }
}

/// Whether a partial mesh is allowed, 1 or 0. Any thread, unless another one changes `params`.
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_partial(
    params: *const lapd_params,
    partial: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, partial, "partial", |p| i32::from(p.partial)) }
}

/// Sets the algorithm, a lapd_algorithm. Which memory nodes there are is read from the machine, or
/// given by lapd_params_set_topology. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_algorithm(
    context: *mut lapd_context,
    params: *mut lapd_params,
    algorithm: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.algorithm = match algorithm {
                a if a == lapd_algorithm::LAPD_ALGORITHM_PODM as i32 => Algorithm::Podm,
                a if a == lapd_algorithm::LAPD_ALGORITHM_LAPD as i32 => Algorithm::Lapd,
                _ => return Err(unknown("algorithm", "a lapd_algorithm", algorithm)),
            };
            Ok(())
        })
    }
}

/// The algorithm, a lapd_algorithm. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_algorithm(
    params: *const lapd_params,
    algorithm: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, algorithm, "algorithm", |p| match p.algorithm {
            Algorithm::Podm => lapd_algorithm::LAPD_ALGORITHM_PODM as i32,
            Algorithm::Lapd => lapd_algorithm::LAPD_ALGORITHM_LAPD as i32,
        })
    }
}

/// Sets what may be changed to remove slivers, a lapd_improve. Topology, labels and the angles of
/// interface facets (lapd_params_set_facet_angle) are kept by it in any case. With
/// LAPD_IMPROVE_FULL and LAPD_ADAPTIVE_TOPOLOGY the topology is mended before: a few tets get
/// another label, and a few facets may have smaller angles (lapd_improvement: tets_mended,
/// facets_below). No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is no lapd_improve.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_improve(
    context: *mut lapd_context,
    params: *mut lapd_params,
    improve: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.improve = match improve {
                i if i == lapd_improve::LAPD_IMPROVE_NONE as i32 => Improve::None,
                i if i == lapd_improve::LAPD_IMPROVE_INTERIOR as i32 => Improve::Interior,
                i if i == lapd_improve::LAPD_IMPROVE_FULL as i32 => Improve::Full,
                _ => return Err(unknown("improve", "a lapd_improve", improve)),
            };
            Ok(())
        })
    }
}

/// What may be changed to remove slivers, a lapd_improve. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_improve(
    params: *const lapd_params,
    improve: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, improve, "improve", |p| match p.improve {
            Improve::None => lapd_improve::LAPD_IMPROVE_NONE as i32,
            Improve::Interior => lapd_improve::LAPD_IMPROVE_INTERIOR as i32,
            Improve::Full => lapd_improve::LAPD_IMPROVE_FULL as i32,
        })
    }
}

/// Sets the dihedral angle that tets are to have at least, in degrees; none is to be above 180 less
/// this, either. Above 0 and at most 30. With the default, 15, interfaces move by at most 0.1 of
/// the smallest side of a voxel; with 20 and more, by 0.2; of a mesh that is coarsened, by 0.2 or
/// 0.1 of delta, whichever is more, but by no more than half of such a side. What can't be reached
/// is listed: lapd_mesh_get_left. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_target_dihedral(
    context: *mut lapd_context,
    params: *mut lapd_params,
    degrees: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.target_dihedral = degrees;
            Ok(())
        })
    }
}

/// The dihedral angle that tets are to have at least, in degrees. Any thread, unless another one
/// changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_target_dihedral(
    params: *const lapd_params,
    degrees: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, degrees, "degrees", |p| p.target_dihedral) }
}

/// Sets the order of tets: 1, the default, for four nodes each, or 2 for ten, one more in the
/// middle of each edge. See lapd_mesh_get_tet_mid_nodes. No other thread may use `params` or the
/// context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_order(
    context: *mut lapd_context,
    params: *mut lapd_params,
    order: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.order = u32::try_from(order)
                .map_err(|_| Failure::invalid(format!("order must be 1 or 2, got {order}")))?;
            Ok(())
        })
    }
}

/// The order of tets, 1 or 2. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_order(
    params: *const lapd_params,
    order: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, order, "order", |p| p.order as i32) }
}

/// Sets whether (1) or not (0, the default) the nodes in the middle of edges of interface facets go
/// from there to where the image has the interface, as far as tets stay valid: the determinant of
/// the Jacobian is positive in all of each tet. Needs order 2 when the mesh is made. See
/// lapd_mesh_get_second_order. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_curved(
    context: *mut lapd_context,
    params: *mut lapd_params,
    curved: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.curved = flag(curved, "curved")?;
            Ok(())
        })
    }
}

/// Whether nodes in the middle of edges of interface facets go to the image's interface. Any
/// thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_curved(
    params: *const lapd_params,
    curved: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, curved, "curved", |p| i32::from(p.curved)) }
}
