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
    /// holds cubes of 32 times the smallest side of a voxel is never thin. The default.
    LAPD_ADAPTIVE_THICKNESS = 1,
    /// Places where the mesh turns out to differ from the image in what is connected: where labels
    /// are torn, merged, or have a hole too many or too few. Far fewer elements where samples are
    /// farther apart than structures are thick.
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
