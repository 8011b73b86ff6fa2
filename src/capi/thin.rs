//! What becomes of what is thin or small.

use super::context::lapd_context;
use super::params::{change, lapd_params, read, unknown};
use super::status::lapd_status;
use crate::params::Adaptive;

/// What is sampled more densely than lapd_params_set_delta says, and its surroundings too, ever
/// less so farther away.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_adaptive {
    /// Nothing: structures that are thinner than samples are apart may tear.
    LAPD_ADAPTIVE_OFF = 0,
    /// Components and layers of a label that are thinner than 4/3 of the distance of samples. What
    /// holds cubes of 32 times the smallest side of a voxel is never thin.
    LAPD_ADAPTIVE_THICKNESS = 1,
    /// Places where the mesh turns out to differ from the image in what is connected: where labels
    /// are torn, merged, or have a hole too many or too few, or where it ends before a wall that
    /// the object reaches. Far fewer elements where samples are farther apart than structures are
    /// thick. Holes that are left although samples are close get mended with LAPD_IMPROVE_FULL: a
    /// few tets get another label. The default.
    LAPD_ADAPTIVE_TOPOLOGY = 2,
}

/// Sets what is sampled more densely than lapd_params_set_delta says, a lapd_adaptive. The mesh
/// then has as many more elements as that takes. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is no lapd_adaptive.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_adaptive(
    context: *mut lapd_context,
    params: *mut lapd_params,
    adaptive: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.adaptive = match adaptive {
                a if a == lapd_adaptive::LAPD_ADAPTIVE_OFF as i32 => Adaptive::Off,
                a if a == lapd_adaptive::LAPD_ADAPTIVE_THICKNESS as i32 => Adaptive::Thickness,
                a if a == lapd_adaptive::LAPD_ADAPTIVE_TOPOLOGY as i32 => Adaptive::Topology,
                _ => return Err(unknown("adaptive", "a lapd_adaptive", adaptive)),
            };
            Ok(())
        })
    }
}

/// What is sampled more densely, a lapd_adaptive. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_adaptive(
    params: *const lapd_params,
    adaptive: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, adaptive, "adaptive", |p| match p.adaptive {
            Adaptive::Off => lapd_adaptive::LAPD_ADAPTIVE_OFF as i32,
            Adaptive::Thickness => lapd_adaptive::LAPD_ADAPTIVE_THICKNESS as i32,
            Adaptive::Topology => lapd_adaptive::LAPD_ADAPTIVE_TOPOLOGY as i32,
        })
    }
}

/// Sets how close samples come at most where they are closer than lapd_params_set_delta says: this
/// times the smallest side of a voxel; above 0, by default 0.5. With LAPD_ADAPTIVE_THICKNESS they
/// come no closer than 0.9 sides anyway, nor than 0.75 where voxels of a label touch in an edge or
/// a corner alone. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_spacing_floor(
    context: *mut lapd_context,
    params: *mut lapd_params,
    spacing_floor: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.spacing_floor = spacing_floor;
            Ok(())
        })
    }
}

/// How close samples come at most where they are closer than lapd_params_set_delta says, in
/// smallest sides of a voxel. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_spacing_floor(
    params: *const lapd_params,
    spacing_floor: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, spacing_floor, "spacing_floor", |p| p.spacing_floor) }
}

/// Sets how many elements are to lie across each layer of a label: where a label is t thick, the
/// edges of its tets are about t over this long on average. Their circumradii are at most 0.85 of
/// that, and samples of interfaces at most 0.6 of it apart. 1 to 100; 0, the default: thickness
/// does not matter for the sizes of tets. Across slanted layers there may be 1.7 times as many.
/// lapd_params_set_target_tets multiplies these bounds, too. The size of lapd_params_set_size is
/// the largest then, lapd_params_set_least_size sets the least, and lapd_params_set_gradation how
/// fast sizes grow away from a layer. What holds cubes of 32 times the smallest side of a voxel
/// counts as thick. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_across(
    context: *mut lapd_context,
    params: *mut lapd_params,
    elements: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.across = (elements != 0.0).then_some(elements);
            Ok(())
        })
    }
}

/// How many elements are to lie across each layer of a label; 0: thickness does not matter. Any
/// thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_across(
    params: *const lapd_params,
    elements: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, elements, "elements", |p| p.across.unwrap_or(0.0)) }
}

/// Sets the least size that lapd_params_set_across leads to, a circumradius in world units; at
/// least 0, the default. No layer leads to less than the spacing floor over 0.7 either: by default
/// 0.71 times the smallest side of a voxel. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_least_size(
    context: *mut lapd_context,
    params: *mut lapd_params,
    least_size: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.least_size = least_size;
            Ok(())
        })
    }
}

/// The least size that lapd_params_set_across leads to. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_least_size(
    params: *const lapd_params,
    least_size: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, least_size, "least_size", |p| p.least_size) }
}

/// Sets by how much sizes grow per distance away from a layer, where lapd_params_set_across asks
/// for elements across it; above 0, by default 0.4. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_gradation(
    context: *mut lapd_context,
    params: *mut lapd_params,
    gradation: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.gradation = gradation;
            Ok(())
        })
    }
}

/// By how much sizes grow per distance away from a layer. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_gradation(
    params: *const lapd_params,
    gradation: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, gradation, "gradation", |p| p.gradation) }
}

/// Leaves out components of a label (after lapd_params_set_merge, of voxels joined with all 26
/// around them) of fewer voxels than this: they become a part of the label, or the background, that
/// most voxels around them have. lapd_mesh_get_defect lists them. 0, the default, and 1 leave out
/// nothing. For images of labels only: lapd_mesh_image refuses images made of intensities or
/// probabilities where this is 2 or more. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_min_voxels(
    context: *mut lapd_context,
    params: *mut lapd_params,
    min_voxels: u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.min_voxels = min_voxels;
            Ok(())
        })
    }
}

/// The voxels that a component has at least, not to be left out. Any thread, unless another one
/// changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_min_voxels(
    params: *const lapd_params,
    min_voxels: *mut u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, min_voxels, "min_voxels", |p| p.min_voxels) }
}
