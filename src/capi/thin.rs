//! What becomes of what is thin or small.

use super::context::lapd_context;
use super::params::{change, flag, lapd_params, read};
use super::status::lapd_status;

/// Whether components and layers of a label that are thinner than 4/3 of the distance of samples
/// (lapd_params_set_delta) are sampled more densely, and their surroundings too, ever less so
/// farther away (1, the default), or not (0). The mesh then has as many more elements as it takes
/// to keep them whole. What holds cubes of 32 times the smallest side of a voxel is never thin. No
/// other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_adaptive(
    context: *mut lapd_context,
    params: *mut lapd_params,
    adaptive: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.adaptive = flag(adaptive, "adaptive")?;
            Ok(())
        })
    }
}

/// Whether thin structures are sampled more densely, 1 or 0. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_adaptive(
    params: *const lapd_params,
    adaptive: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, adaptive, "adaptive", |p| i32::from(p.adaptive)) }
}

/// Sets how close samples of thin structures come at most: this times the smallest side of a voxel;
/// above 0, by default 0.5. No other thread may use `params` or the context meanwhile.
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

/// How close samples of thin structures come at most, in smallest sides of a voxel. Any thread,
/// unless another one changes `params`.
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
