//! Images made of real numbers: scans with isovalues, probability maps.
//!
//! They are images like any other afterwards: what differs is where smooth interfaces lie.

use std::ffi::{CStr, c_char};
use std::path::Path;

use super::boundary::{Failure, Out, Outcome, array, c_str, slice};
use super::context::{lapd_context, with_context};
use super::image::{
    frame_of, handle, lapd_image, read_options, strided, strides_of, tell, to_path,
};
use super::status::lapd_status;
use crate::image::{Frame, GrayImage, LabelImage, MapValues, ProbabilityImage};
use crate::io::read::values::{read_gray, read_maps};

/// Copies the numbers of a strided volume, x fastest. Nothing is reserved for a volume that is too
/// large.
///
/// # Safety
/// `data` is NULL or points to voxel (0, 0, 0) of a volume with these dimensions and strides.
unsafe fn copy_numbers(
    data: *const f32,
    dims: [usize; 3],
    strides: Option<[isize; 3]>,
    name: &str,
) -> Outcome<Vec<f32>> {
    if data.is_null() {
        return Err(Failure::invalid(format!("{name} is NULL")));
    }
    let (before, count, strides) = strided(dims, strides)?;
    // SAFETY: the caller's promise about `data`; `strided` says which elements around it belong to
    // the volume.
    let elements = unsafe { slice(data.wrapping_sub(before), count, name)? };
    let voxels = dims.iter().product();
    let mut numbers = crate::memory::room(voxels, "voxels of an image")?;
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            // In bounds by `strided`.
            let start = before as isize + j as isize * strides[1] + k as isize * strides[2];
            numbers
                .extend((0..dims[0]).map(|i| elements[(start + i as isize * strides[0]) as usize]));
        }
    }
    Ok(numbers)
}

/// Labels that may be left out, as many as `count`.
///
/// # Safety
/// As [`slice`].
unsafe fn optional_labels<'a>(labels: *const i32, count: usize) -> Outcome<Option<&'a [i32]>> {
    // SAFETY: passed on to the caller.
    if labels.is_null() { Ok(None) } else { unsafe { slice(labels, count, "labels") }.map(Some) }
}

/// The most likely labels, and warnings for values below 0, for maps that tie and for those that
/// win nowhere.
fn likeliest(probabilities: &ProbabilityImage, warnings: &mut Vec<String>) -> Outcome<LabelImage> {
    let image = probabilities.label_image()?;
    warnings.extend(probabilities.below_zero());
    warnings.extend(probabilities.ties());
    warnings.extend(probabilities.nowhere_likeliest(&image).iter().map(|label| {
        format!("label {label} is the most likely one at no voxel, and so will not be in the mesh")
    }));
    Ok(image)
}

/// Makes an image of a scan, by isovalues v1 < v2 < ...: background below v1, the first label from
/// v1 on, the second from v2 on, and so forth. Smooth interfaces (LAPD_SURFACE_SMOOTH) are the
/// isosurfaces of the intensity, interpolated trilinearly between voxel centres, which is much
/// closer to the object than a segmentation can be. In everything else the image is that of the
/// labels at the voxel centres.
///
/// - `data` points to the intensity of voxel (0, 0, 0). The voxels are copied (4 bytes each, and 2
///   for labels).
/// - `dims` (at most 2^32 - 1 voxels), `strides`, `origin`, `spacing`, `direction`: as in
///   lapd_image_create; `strides` and `direction` may be NULL.
/// - `isovalues`: `isovalue_count` values, 1 to 31, increasing. An isovalue that many voxels have
///   exactly puts the surface through their centres; half a unit beside it is better.
/// - `labels`: as many labels as isovalues, or NULL for 1, 2, ... Label 0 is background here too,
///   so that a range of intensities can be meshed alone.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT as lapd_image_create, and for isovalues that are not finite
/// or do not increase, none or too many of them, an intensity that is not finite, an isovalue that
/// no voxel reaches, or no voxel between two of them; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_create_gray(
    context: *mut lapd_context,
    data: *const f32,
    dims: *const usize,
    strides: *const isize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
    isovalues: *const f64,
    isovalue_count: usize,
    labels: *const i32,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let out = Out::new(image, "image")?;
            let dims = array(dims, "dims")?;
            let strides = strides_of(strides)?;
            let frame = frame_of(origin, spacing, direction)?;
            let isovalues = slice(isovalues, isovalue_count, "isovalues")?;
            let labels = optional_labels(labels, isovalue_count)?;
            let gray = GrayImage::new(dims, frame, copy_numbers(data, dims, strides, "data")?)?;
            out.set(handle(gray.label_image(isovalues, labels)?, None, Vec::new()));
            Ok(())
        })
    }
}

/// Makes an image of probability maps, one for each label: each voxel has its most likely label, on
/// a tie the background, or else the smaller one. Smooth interfaces (LAPD_SURFACE_SMOOTH) are where
/// the largest of the probabilities, interpolated trilinearly between voxel centres, changes hands;
/// of a voxel the four largest count. In everything else the image is that of the labels at the
/// voxel centres. Merged labels have the sum of their probabilities, and labels that are not kept
/// count to the background.
///
/// - `maps`: `map_count` pointers, each to the value of voxel (0, 0, 0) in the map of one label.
///   The maps are copied (4 bytes per voxel and map, and 2 for labels).
/// - `labels`: `map_count` labels, all different. Where 0, the background, is among them, values
///   may be of any scale; else the background has what all others leave to 1, and values must not
///   exceed 1 nor be below -0.5. Values below 0 count as 0, with a warning below -0.001.
/// - `dims` (at most 2^32 - 1 voxels), `strides`, `origin`, `spacing`, `direction`: as in
///   lapd_image_create, the same for all maps; `strides` and `direction` may be NULL. With strides
///   maps may stand side by side, voxel by voxel.
///
/// A label that is nowhere the most likely one has no voxel, and will have no tet: a warning, for
/// the log callback and lapd_image_get_warning, names it. So does one where a hundredth or more of
/// the object is as likely of one label as of another, as with masks that overlap.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT as lapd_image_create, and for no maps, a label given twice,
/// a value that is not finite, or above 1 or below -0.5 without a map of label 0;
/// LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_create_probabilities(
    context: *mut lapd_context,
    maps: *const *const f32,
    labels: *const i32,
    map_count: usize,
    dims: *const usize,
    strides: *const isize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
    image: *mut *mut lapd_image,
) -> lapd_status {
    let given = Given { maps, labels, map_count, dims, strides, origin, spacing, direction };
    // SAFETY: see the module's head.
    unsafe { create_maps(context, &given, ProbabilityImage::new, image) }
}

/// As lapd_image_create_probabilities for level sets: functions above 0 inside of their label and
/// below it outside, such as signed distances. The largest value wins; the background has the level
/// 0, unless it has a map. Values may be of any scale, the same for all maps. Of merged labels the
/// largest value counts.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: those of lapd_image_create_probabilities, but for values out of a range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_create_level_sets(
    context: *mut lapd_context,
    maps: *const *const f32,
    labels: *const i32,
    map_count: usize,
    dims: *const usize,
    strides: *const isize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
    image: *mut *mut lapd_image,
) -> lapd_status {
    let given = Given { maps, labels, map_count, dims, strides, origin, spacing, direction };
    // SAFETY: see the module's head.
    unsafe { create_maps(context, &given, ProbabilityImage::level_sets, image) }
}

/// Maps in a caller's memory.
struct Given {
    maps: *const *const f32,
    labels: *const i32,
    map_count: usize,
    dims: *const usize,
    strides: *const isize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
}

/// Makes an image of maps.
///
/// # Safety
/// See the module's head.
unsafe fn create_maps(
    context: *mut lapd_context,
    given: &Given,
    make: impl FnOnce([usize; 3], Frame, Vec<Vec<f32>>, &[i32]) -> crate::Result<ProbabilityImage>,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(image, "image")?;
            let maps = slice(given.maps, given.map_count, "maps")?;
            let labels = slice(given.labels, given.map_count, "labels")?;
            let dims = array(given.dims, "dims")?;
            let strides = strides_of(given.strides)?;
            let frame = frame_of(given.origin, given.spacing, given.direction)?;
            let copied = maps.iter().enumerate();
            let copied =
                copied.map(|(n, &map)| copy_numbers(map, dims, strides, &format!("maps[{n}]")));
            let maps = make(dims, frame, copied.collect::<Outcome<_>>()?, labels)?;
            let mut warnings = Vec::new();
            let image = likeliest(&maps, &mut warnings)?;
            tell(context, &warnings);
            out.set(handle(image, None, warnings));
            Ok(())
        })
    }
}

/// Reads a scan, as lapd_image_read reads labels, and makes an image of it by isovalues, as
/// lapd_image_create_gray does. Numbers of all types are read, scaled as the file says, and rounded
/// to single precision. `path` and `world`, a lapd_world_frame, are as in lapd_image_read.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: those of lapd_image_read, and those of lapd_image_create_gray for isovalues and labels;
/// LAPD_ERROR_FORMAT for an intensity that is not finite, and for more than one value per voxel.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read_gray(
    context: *mut lapd_context,
    path: *const c_char,
    world: i32,
    isovalues: *const f64,
    isovalue_count: usize,
    labels: *const i32,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(image, "image")?;
            let path = to_path(c_str(path, "path")?)?;
            let options = read_options(world)?;
            let isovalues = slice(isovalues, isovalue_count, "isovalues")?;
            let labels = optional_labels(labels, isovalue_count)?;
            let read =
                context.reading(options, |options, go_on| read_gray(path, options, go_on))?;
            let image = read.image.label_image(isovalues, labels)?;
            tell(context, &read.warnings);
            out.set(handle(image, read.world, read.warnings));
            Ok(())
        })
    }
}

/// Reads probability maps, as lapd_image_read reads labels, and makes an image of them, as
/// lapd_image_create_probabilities does. There may be several files, and several volumes in a file:
/// a fourth axis (NIfTI, NRRD, MetaImage) or several values for each voxel (NRRD, MetaImage, INR).
/// All volumes of all files count, in their order.
///
/// - `paths`: `path_count` names of files. All must have the grid of the first, in the frame that
///   is asked for.
/// - `world`: that frame, a lapd_world_frame, as in lapd_image_read.
/// - `labels`: `label_count` labels, all different, as many as there are volumes; or NULL for 1, 2,
///   ..., `label_count` is not read then.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: those of lapd_image_read; LAPD_ERROR_INVALID_ARGUMENT for no files, a label given twice,
/// and not as many labels as volumes; LAPD_ERROR_FORMAT, naming the file, for files whose grids
/// differ, and for a value that is not finite, or above 1 without a map of label 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read_probabilities(
    context: *mut lapd_context,
    paths: *const *const c_char,
    path_count: usize,
    world: i32,
    labels: *const i32,
    label_count: usize,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read_files(
            context,
            (paths, path_count),
            world,
            (labels, label_count),
            MapValues::Probabilities,
            image,
        )
    }
}

/// Reads level sets, as lapd_image_read_probabilities reads probability maps, and makes an image of
/// them, as lapd_image_create_level_sets does.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: those of lapd_image_read_probabilities, but for values out of a range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read_level_sets(
    context: *mut lapd_context,
    paths: *const *const c_char,
    path_count: usize,
    world: i32,
    labels: *const i32,
    label_count: usize,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read_files(
            context,
            (paths, path_count),
            world,
            (labels, label_count),
            MapValues::LevelSets,
            image,
        )
    }
}

/// Makes an image of maps in files: names and labels by pointers and counts.
///
/// # Safety
/// See the module's head.
unsafe fn read_files(
    context: *mut lapd_context,
    (paths, path_count): (*const *const c_char, usize),
    world: i32,
    (labels, label_count): (*const i32, usize),
    values: MapValues,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(image, "image")?;
            let paths = slice(paths, path_count, "paths")?.iter().enumerate();
            let paths: Vec<&CStr> = paths
                .map(|(n, &path)| c_str(path, &format!("paths[{n}]")))
                .collect::<Outcome<_>>()?;
            let paths: Vec<&Path> = paths.into_iter().map(to_path).collect::<Outcome<_>>()?;
            let options = read_options(world)?;
            let labels = optional_labels(labels, label_count)?;
            let mut read = context.reading(options, |options, go_on| {
                read_maps(&paths, values, labels, options, go_on)
            })?;
            let image = likeliest(&read.image, &mut read.warnings)?;
            tell(context, &read.warnings);
            out.set(handle(image, read.world, read.warnings));
            Ok(())
        })
    }
}
