//! Which labels of the image are meshed, and as what.

use super::boundary::{Failure, Out, borrow, slice, status_of};
use super::context::lapd_context;
use super::params::{change, edit, lapd_params, read};
use super::status::lapd_status;
use crate::params::MeshParams;

/// Gives labels of the image another one before all else: each of `labels` becomes `target`. All
/// labels are changed at once, so that two can be exchanged by two calls. 0 may be among them, and
/// may be the target, which makes them background. A second call for a label replaces the first.
/// lapd_mesh_image refuses a label that the image does not have. The values are copied. No other
/// thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `count` is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_merge(
    context: *mut lapd_context,
    params: *mut lapd_params,
    labels: *const i32,
    count: usize,
    target: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        edit(context, params, |p| {
            let labels = slice(labels, count, "labels")?;
            if labels.is_empty() {
                return Err(Failure::invalid(format!("there are no labels to become {target}")));
            }
            p.merge.extend(labels.iter().map(|&label| (label, target)));
            Ok(())
        })
    }
}

/// What becomes of a label of the image: the target of the last lapd_params_set_merge for it, or
/// the label itself. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_merge(
    params: *const lapd_params,
    label: i32,
    target: *mut i32,
) -> lapd_status {
    let merged = |p: &MeshParams| p.merge.get(&label).copied().unwrap_or(label);
    // SAFETY: see the module's head.
    unsafe { read(params, target, "target", merged) }
}

/// Forgets which labels were to become others. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_clear_merge(
    context: *mut lapd_context,
    params: *mut lapd_params,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        edit(context, params, |p| {
            p.merge.clear();
            Ok(())
        })
    }
}

/// Sets the label that counts as background, after merging; the default is 0. Its voxels are as the
/// outside of the image, which has label 0 in the mesh. lapd_mesh_image refuses a label that the
/// image does not have, and, for another background than 0, an image that has label 0 as well:
/// merge 0 into that label or into another one. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_background_label(
    context: *mut lapd_context,
    params: *mut lapd_params,
    label: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.background_label = label;
            Ok(())
        })
    }
}

/// The label that counts as background. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_background_label(
    params: *const lapd_params,
    label: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, label, "label", |p| p.background_label) }
}

/// Sets the labels to mesh (after merging); all others count as background. A count of 0 means all
/// labels, and `labels` may then be NULL. lapd_mesh_image refuses a label that the image does not
/// have. The values are copied. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_keep(
    context: *mut lapd_context,
    params: *mut lapd_params,
    labels: *const i32,
    count: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.keep = if count == 0 { Vec::new() } else { slice(labels, count, "labels")?.to_vec() };
            Ok(())
        })
    }
}

/// The labels to mesh, and how many they are; 0 means all.
///
/// `*labels` belongs to the parameters and is valid until they are changed or freed; with a count
/// of 0 it must not be read. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_keep(
    params: *const lapd_params,
    labels: *mut *const i32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let (labels, count) = (Out::new(labels, "labels")?, Out::new(count, "count")?);
        let keep = &borrow(params, "params")?.params.keep;
        labels.set(keep.as_ptr());
        count.set(keep.len());
        Ok(())
    })
}

/// Sets the standard deviation of the Gaussian that smooths the labels of a coarse segmentation, in
/// voxels along each axis of the image; 0 to 5, 0 (the default) for none. For images of labels and
/// smooth surfaces only: lapd_mesh_image refuses images made of intensities or probabilities. Voxel
/// centres keep their labels, so that nothing thin or small is lost. No other thread may use
/// `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, the value is out of range, or it is
/// above 0 and the surface is LAPD_SURFACE_VOXEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_sigma(
    context: *mut lapd_context,
    params: *mut lapd_params,
    sigma: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.sigma = sigma;
            Ok(())
        })
    }
}

/// The standard deviation of the Gaussian that smooths labels, in voxels, 0 for none. Any thread,
/// unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_sigma(
    params: *const lapd_params,
    sigma: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, sigma, "sigma", |p| p.sigma) }
}
