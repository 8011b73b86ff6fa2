//! How many elements: a number that is asked for, and what is to be expected.

use super::boundary::{Out, borrow, status_of};
use super::context::{lapd_context, with_context};
use super::image::lapd_image;
use super::mesh::lapd_mesh;
use super::params::{change, lapd_params, read};
use super::run::run;
use super::status::lapd_status;
use crate::Error;
use crate::pipeline::estimate::estimate;

/// Sets how many tets of labels the mesh is to have. Delta, the sizes, and above 1 the floor of
/// spacing (but for a mesh that is coarsened), are then multiplied by one factor, which is
/// searched: the mesh has as many tets within a tenth, unless no factor leads to that, of which a
/// warning tells. With 0, the default, these lengths are taken as they are. lapd_mesh_get_bounds
/// tells what was found. It takes one to three refinements, seldom more, each with its coarsening
/// where that is asked for. Where a limit ends a later one, and partial meshes are allowed, the
/// mesh is that of an earlier one. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the number is above 4294967295.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_target_tets(
    context: *mut lapd_context,
    params: *mut lapd_params,
    tets: u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.target_tets = (tets > 0).then_some(tets);
            Ok(())
        })
    }
}

/// How many tets of labels the mesh is to have; 0: no number is asked for. Any thread, unless
/// another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_target_tets(
    params: *const lapd_params,
    tets: *mut u64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, tets, "tets", |p| p.target_tets.unwrap_or(0)) }
}

/// Makes the refined mesh coarser where that changes nothing in what is connected: edges are
/// contracted as long as tets stay within size, samples of the interfaces within delta, and the
/// facets between keep planar angles of at least so many degrees (or those that they had), above 0
/// and at most 30. 15 is a good choice; with more fewer edges can go. Most is gained at a large
/// delta: at one of three voxels a mesh of a brain has three tenths of the tets, and no component
/// less. It takes one to three times as long as the refinement, 7 to 17 times with
/// LAPD_ADAPTIVE_THICKNESS. A limit of time that ends it early leaves many slivers, where partial
/// meshes are allowed. lapd_mesh_get_improvement tells what was done. With 0, the default, the mesh
/// stays as refinement made it. Needs LAPD_IMPROVE_FULL, which lapd_mesh_image checks. No other
/// thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_coarsen(
    context: *mut lapd_context,
    params: *mut lapd_params,
    degrees: f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.coarsen = (degrees != 0.0).then_some(degrees);
            Ok(())
        })
    }
}

/// The planar angle in degrees that interface facets keep where the mesh is made coarser; 0: it is
/// not. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_coarsen(
    params: *const lapd_params,
    degrees: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, degrees, "degrees", |p| p.coarsen.unwrap_or(0.0)) }
}

/// Tells what bounds a mesh was made with: the distance of samples, and the largest circumradius of
/// tets where no label has its own; those that lapd_params_set_target_tets has led to. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_UNSUPPORTED for a mesh
/// that lapd_mesh_image did not make.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_bounds(
    mesh: *const lapd_mesh,
    delta: *mut f64,
    size: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let delta_out = Out::new(delta, "delta")?;
        let size_out = Out::new(size, "size")?;
        let params = borrow(mesh, "mesh")?.params.as_ref().ok_or_else(|| {
            Error::Unsupported("this mesh was not made from an image here".into())
        })?;
        delta_out.set(params.delta);
        size_out.set(params.size);
        Ok(())
    })
}

/// Tells what lapd_mesh_image is to be expected to need for an image, without making a mesh: tets
/// of labels, bytes of memory at the peak, the image among them, and seconds on this machine, as
/// busy as it is now. Mostly within a fifth, but seconds within a half with
/// LAPD_ADAPTIVE_TOPOLOGY. Where lapd_params_set_coarsen is set tets are within a quarter of what
/// is told, but with LAPD_ADAPTIVE_TOPOLOGY up to two fifths more; seconds are within a half then.
///
/// It takes as long as the preparation of the image, up to three times that with
/// LAPD_ADAPTIVE_TOPOLOGY, and some 20 milliseconds to find out how fast the machine is. Progress
/// callbacks of the context are called on this thread. No other thread may use the context
/// meanwhile, but to cancel, nor change `params`.
///
/// Errors: as lapd_mesh_image, as far as they come of the image and of `params`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_estimate(
    context: *mut lapd_context,
    image: *const lapd_image,
    params: *const lapd_params,
    tets: *mut u64,
    peak_bytes: *mut u64,
    seconds: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let tets_out = Out::new(tets, "tets")?;
            let peak_out = Out::new(peak_bytes, "peak_bytes")?;
            let seconds_out = Out::new(seconds, "seconds")?;
            let image = borrow(image, "image")?;
            let params = borrow(params, "params")?.params.clone();
            let _run = context.start_run()?;
            let found = run(params.threads, &context.cancel, &context.callbacks(), |monitor| {
                Ok(estimate(&image.image, &params, monitor)?)
            })?;
            tets_out.set(found.tets);
            peak_out.set(found.peak_bytes);
            seconds_out.set(found.seconds);
            Ok(())
        })
    }
}
