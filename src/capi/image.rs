//! Label images.

use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;
use std::ptr;

use glam::DMat3;

use super::boundary::{
    Failure, Out, Outcome, array, borrow, borrow_mut, c_str, check_buffer, slice, status_of,
    value_or,
};
use super::context::{lapd_context, lapd_log_level, with_context};
use super::label_names::Names;
use super::params::unknown;
use super::status::lapd_status;
use crate::image::volume::packed_strides;
use crate::image::{Frame, LabelImage, Voxels, WorldAxes, numbered_voxels};
use crate::io::read::{LabelValues, ReadOptions, WorldFrame, read_image_with};

/// A label image: a grid of integer labels, and its place in the world. Label 0 is the background.
/// Its voxels never change after it was made, so any number of threads may use it at once, unless
/// one names its labels.
pub struct lapd_image {
    pub(super) image: LabelImage,
    /// As far as a file said.
    pub(super) world: Option<WorldAxes>,
    warnings: Vec<CString>,
    /// The values that labels 1, 2, ... stand for, where distinct values became labels.
    values: Vec<CString>,
    /// The names of labels: those of the file, and those that were given later.
    pub(super) names: Names,
}

impl lapd_image {
    /// The values that labels 1, 2, ... stand for.
    pub(super) fn values(&self) -> Vec<String> {
        self.values.iter().map(|value| value.to_string_lossy().into_owned()).collect()
    }
}

/// Type of the voxels in a caller's buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_voxel_type {
    /// uint8_t
    LAPD_VOXEL_U8 = 0,
    /// int8_t
    LAPD_VOXEL_I8 = 1,
    /// uint16_t
    LAPD_VOXEL_U16 = 2,
    /// int16_t
    LAPD_VOXEL_I16 = 3,
    /// uint32_t; labels must fit int32_t
    LAPD_VOXEL_U32 = 4,
    /// int32_t
    LAPD_VOXEL_I32 = 5,
    /// uint64_t; labels must fit int32_t
    LAPD_VOXEL_U64 = 6,
    /// int64_t; labels must fit int32_t
    LAPD_VOXEL_I64 = 7,
}

/// The frame of world coordinates that an image from a file, and so its mesh, is to have. LPS and
/// RAS differ by a half turn about z: x and y change their signs.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_world_frame {
    /// Coordinates as the file gives them: RAS for NIfTI, LPS for MetaImage, what `space` says for
    /// NRRD; INRIMAGE does not say.
    LAPD_WORLD_AS_STORED = 0,
    /// x, y, z grow towards the patient's left, posterior, superior: DICOM, ITK.
    LAPD_WORLD_LPS = 1,
    /// x, y, z grow towards the patient's right, anterior, superior: NIfTI, 3D Slicer.
    LAPD_WORLD_RAS = 2,
}

/// What becomes of voxels of a label image that are no whole numbers. Those within 1e-3 of one are
/// always rounded, with a warning.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_label_values {
    /// They are refused: the file may be no label image.
    LAPD_LABELS_WHOLE = 0,
    /// They are rounded, with a warning.
    LAPD_LABELS_ROUNDED = 1,
    /// Each distinct value becomes a label, those of 64-bit integers, too: 0 stays 0, the others
    /// become 1, 2, ... in increasing order. lapd_image_get_value tells which is which.
    LAPD_LABELS_DISTINCT = 2,
}

/// What the world axes of an image mean in the patient.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_world_axes {
    /// The image comes from memory, or from a file that does not say.
    LAPD_AXES_UNKNOWN = 0,
    /// Left, posterior, superior.
    LAPD_AXES_LPS = 1,
    /// Right, anterior, superior.
    LAPD_AXES_RAS = 2,
    /// Left, anterior, superior: some NRRD files, as stored.
    LAPD_AXES_LAS = 3,
}

impl From<Option<WorldAxes>> for lapd_world_axes {
    fn from(world: Option<WorldAxes>) -> Self {
        match world {
            None => Self::LAPD_AXES_UNKNOWN,
            Some(WorldAxes::Lps) => Self::LAPD_AXES_LPS,
            Some(WorldAxes::Ras) => Self::LAPD_AXES_RAS,
            Some(WorldAxes::Las) => Self::LAPD_AXES_LAS,
        }
    }
}

/// How to read, by a caller's `world`.
pub(super) fn read_options(world: i32) -> Outcome<ReadOptions> {
    let world = match world {
        w if w == lapd_world_frame::LAPD_WORLD_AS_STORED as i32 => WorldFrame::AsStored,
        w if w == lapd_world_frame::LAPD_WORLD_LPS as i32 => WorldFrame::Lps,
        w if w == lapd_world_frame::LAPD_WORLD_RAS as i32 => WorldFrame::Ras,
        _ => return Err(unknown("world", "a lapd_world_frame", world)),
    };
    Ok(ReadOptions { world, ..ReadOptions::default() })
}

impl lapd_voxel_type {
    fn from_number(number: i32) -> Outcome<Self> {
        use lapd_voxel_type::*;
        [
            LAPD_VOXEL_U8,
            LAPD_VOXEL_I8,
            LAPD_VOXEL_U16,
            LAPD_VOXEL_I16,
            LAPD_VOXEL_U32,
            LAPD_VOXEL_I32,
            LAPD_VOXEL_U64,
            LAPD_VOXEL_I64,
        ]
        .into_iter()
        .find(|&known| known as i32 == number)
        .ok_or_else(|| {
            Failure::invalid(format!("voxel_type must be a lapd_voxel_type, got {number}"))
        })
    }
}

/// The elements a strided image touches: how far the first one lies before voxel (0, 0, 0), and how
/// many there are from the first to the last.
fn extent(dims: [usize; 3], strides: [isize; 3]) -> Option<(usize, usize)> {
    let (mut before, mut after) = (0_usize, 0_usize);
    for (dim, stride) in dims.into_iter().zip(strides) {
        let reach = stride.unsigned_abs().checked_mul(dim - 1)?;
        let side = if stride < 0 { &mut before } else { &mut after };
        *side = side.checked_add(reach)?;
    }
    Some((before, before.checked_add(after)?.checked_add(1)?))
}

/// As [`extent`], with a failure for more voxels than u32 can number and for what does not fit in
/// memory; and the strides, which for NULL are those of packed voxels.
pub(super) fn strided(
    dims: [usize; 3],
    strides: Option<[isize; 3]>,
) -> Outcome<(usize, usize, [isize; 3])> {
    if let Some(axis) = dims.iter().position(|&n| n == 0) {
        return Err(Failure::invalid(format!("dims[{axis}] must be at least 1, got 0")));
    }
    let too_large = || {
        Failure::invalid(format!(
            "an image of {dims:?} voxels is too large: at most 2^32 - 1 voxels"
        ))
    };
    // Where addresses have 32 bits the latter is the smaller one.
    numbered_voxels(dims).filter(|&voxels| voxels <= isize::MAX as usize).ok_or_else(too_large)?;
    let strides = strides.unwrap_or_else(|| packed_strides(dims));
    let (before, count) = extent(dims, strides).ok_or_else(|| {
        Failure::invalid(format!("strides {strides:?} of {dims:?} voxels do not fit in memory"))
    })?;
    Ok((before, count, strides))
}

/// Where a caller's grid lies.
///
/// # Safety
/// As [`array`], `direction` may be NULL.
pub(super) unsafe fn frame_of(
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
) -> Outcome<Frame> {
    // SAFETY: passed on to the caller.
    unsafe {
        let origin = array(origin, "origin")?;
        let spacing = array(spacing, "spacing")?;
        let direction = if direction.is_null() {
            DMat3::IDENTITY
        } else {
            rows_to_matrix(array(direction, "direction")?)
        };
        Ok(Frame::new(origin, spacing, direction.to_cols_array_2d())?)
    }
}

/// # Safety
/// `data` is NULL or points to voxel (0, 0, 0) of an image of `voxel_type` with these dimensions
/// and strides.
unsafe fn copy_voxels(
    data: *const c_void,
    voxel_type: lapd_voxel_type,
    dims: [usize; 3],
    strides: Option<[isize; 3]>,
    frame: Frame,
) -> Outcome<LabelImage> {
    let (before, count, _) = strided(dims, strides)?;

    // SAFETY: the caller's promise about `data`; `strided` says which elements around it belong to
    // the image.
    unsafe fn elements<'a, T>(
        data: *const c_void,
        before: usize,
        count: usize,
    ) -> Outcome<&'a [T]> {
        if data.is_null() {
            return Err(Failure::invalid("data is NULL"));
        }
        unsafe { slice(data.cast::<T>().wrapping_sub(before), count, "data") }
    }
    use lapd_voxel_type::*;
    // SAFETY: as above.
    let voxels = unsafe {
        match voxel_type {
            LAPD_VOXEL_U8 => Voxels::U8(elements(data, before, count)?),
            LAPD_VOXEL_I8 => Voxels::I8(elements(data, before, count)?),
            LAPD_VOXEL_U16 => Voxels::U16(elements(data, before, count)?),
            LAPD_VOXEL_I16 => Voxels::I16(elements(data, before, count)?),
            LAPD_VOXEL_U32 => Voxels::U32(elements(data, before, count)?),
            LAPD_VOXEL_I32 => Voxels::I32(elements(data, before, count)?),
            LAPD_VOXEL_U64 => Voxels::U64(elements(data, before, count)?),
            LAPD_VOXEL_I64 => Voxels::I64(elements(data, before, count)?),
        }
    };
    Ok(LabelImage::from_voxels(voxels, dims, strides, before, frame)?)
}

/// Makes an image from a caller's buffer. The voxels are copied (into dense ids of 2 bytes each),
/// so the buffer may be freed or changed as soon as the call returns.
///
/// - `data` points to voxel (0, 0, 0), aligned for its type, which `voxel_type` (a lapd_voxel_type)
///   names.
/// - `dims`: 3 values, voxels along x, y, z; at least 1 each, and at most 2^32 - 1 voxels in all.
/// - `strides`: 3 values, the distance from a voxel to the next one along x, y, z, counted in
///   elements (not bytes); negative ones are allowed. NULL means packed, x fastest: 1, dims[0],
///   dims[0] * dims[1].
/// - `origin`: 3 values, the world position of the centre of voxel (0, 0, 0); at most 1e9 of the
///   smallest spacing away from that of the world.
/// - `spacing`: 3 values, the distance between voxel centres along x, y, z; between 1e-12 and 1e9,
///   and no more than a factor of 1e5 apart.
/// - `direction`: 9 values, row by row; column k is the world direction of image axis k. Must be
///   orthonormal; reflections are allowed, and tets have positive volumes all the same. NULL means
///   the identity.
///
/// World position of voxel (i, j, k): origin + direction * (i * spacing[0], j * spacing[1], k *
/// spacing[2]). Lengths are in one unit, millimetres for medical images, and so are those of the
/// mesh.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer other than `strides` and `direction` is NULL,
/// for an unknown voxel type, a dimension of 0, more than 2^32 - 1 voxels, strides beyond the
/// address space, a spacing not above 0, a value that is not finite, axes that are sheared, a label
/// that does not fit int32_t, more than 65534 labels besides 0; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_create(
    context: *mut lapd_context,
    data: *const c_void,
    voxel_type: i32,
    dims: *const usize,
    strides: *const isize,
    origin: *const f64,
    spacing: *const f64,
    direction: *const f64,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let out = Out::new(image, "image")?;
            let voxel_type = lapd_voxel_type::from_number(voxel_type)?;
            let dims = array(dims, "dims")?;
            let strides = strides_of(strides)?;
            let frame = frame_of(origin, spacing, direction)?;
            let image = copy_voxels(data, voxel_type, dims, strides, frame)?;
            out.set(handle(image, None, Vec::new()));
            Ok(())
        })
    }
}

/// What the caller owns; warnings with a zero byte, of which C has no string, are left out.
pub(super) fn handle(
    image: LabelImage,
    world: Option<WorldAxes>,
    warnings: Vec<String>,
) -> *mut lapd_image {
    let warnings = warnings.into_iter().filter_map(|line| CString::new(line).ok()).collect();
    Box::into_raw(Box::new(lapd_image {
        image,
        world,
        warnings,
        values: Vec::new(),
        names: Names::default(),
    }))
}

/// Hands warnings to the log.
pub(super) fn tell(context: &lapd_context, warnings: &[String]) {
    let callbacks = context.callbacks();
    warnings.iter().for_each(|warning| callbacks.log(lapd_log_level::LAPD_LOG_WARNING, warning));
}

/// Strides that may be left out.
///
/// # Safety
/// As [`array`].
pub(super) unsafe fn strides_of(strides: *const isize) -> Outcome<Option<[isize; 3]>> {
    // SAFETY: passed on to the caller.
    if strides.is_null() { Ok(None) } else { unsafe { array(strides, "strides") }.map(Some) }
}

fn rows_to_matrix(rows: [f64; 9]) -> DMat3 {
    DMat3::from_cols_array(&rows).transpose()
}

/// Reads an image file; its format is told by the end of its name: .nrrd .nhdr .nii .nii.gz .mha
/// .mhd .inr .inr.gz .npy .tif .tiff.
///
/// `path` is UTF-8; on Unix any bytes that name a file are taken. `world` is the frame that the
/// image is to have, a lapd_world_frame. The coordinates of a file that does not say its own stay
/// as stored, with a warning; lapd_image_get_world_axes tells what the axes of the image mean. What
/// a file says ambiguously goes to the log callback, and is kept with the image
/// (lapd_image_get_warning).
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one. What files may ask for is limited: see lapd_context_set_max_read_bytes and
/// lapd_context_set_allow_outside.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `world` is unknown, or no format
/// has this ending; LAPD_ERROR_IO when the file cannot be read; LAPD_ERROR_FORMAT when it is not a
/// valid image, is cut off, or uses what this version does not read; LAPD_ERROR_MEMORY_LIMIT when
/// it asks for more memory than it may; LAPD_ERROR_CANCELLED; LAPD_ERROR_OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read(
    context: *mut lapd_context,
    path: *const c_char,
    world: i32,
    image: *mut *mut lapd_image,
) -> lapd_status {
    let values = lapd_label_values::LAPD_LABELS_WHOLE as i32;
    // SAFETY: passed on to the caller; there is no array of layers.
    unsafe { lapd_image_read_labels(context, path, world, values, ptr::null(), 0, image) }
}

/// As lapd_image_read, with choices.
///
/// - `values`: what becomes of voxels that are no whole numbers, a lapd_label_values.
/// - `layer_order`: for segmentations of 3D Slicer with several layers, whose segments may overlap:
///   the `layer_count` layers of the file, counted from 0, each once. Where segments overlap, that
///   of the later layer of this order counts. NULL for the order of the file.
///
/// The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
/// this one.
///
/// Errors: those of lapd_image_read; LAPD_ERROR_INVALID_ARGUMENT when `values` is unknown, when
/// `layer_order` does not name each layer once or the file has no layers, and for
/// LAPD_LABELS_DISTINCT of several layers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read_labels(
    context: *mut lapd_context,
    path: *const c_char,
    world: i32,
    values: i32,
    layer_order: *const usize,
    layer_count: usize,
    image: *mut *mut lapd_image,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(image, "image")?;
            let path = to_path(c_str(path, "path")?)?;
            let values = match values {
                v if v == lapd_label_values::LAPD_LABELS_WHOLE as i32 => LabelValues::Whole,
                v if v == lapd_label_values::LAPD_LABELS_ROUNDED as i32 => LabelValues::Rounded,
                v if v == lapd_label_values::LAPD_LABELS_DISTINCT as i32 => LabelValues::Distinct,
                _ => return Err(unknown("values", "a lapd_label_values", values)),
            };
            let layer_order = if layer_order.is_null() {
                None
            } else {
                Some(slice(layer_order, layer_count, "layer_order")?.to_vec())
            };
            let options = ReadOptions { values, layer_order, ..read_options(world)? };
            let read =
                context.reading(options, |options, go_on| read_image_with(path, options, go_on))?;
            tell(context, &read.warnings);
            let image = handle(read.image, read.world, read.warnings);
            // What the caller will own, and nobody else knows yet.
            (*image).values =
                read.values.into_iter().filter_map(|text| CString::new(text).ok()).collect();
            (*image).names = Names::new(read.names);
            out.set(image);
            Ok(())
        })
    }
}

#[cfg(unix)]
pub(super) fn to_path(path: &CStr) -> Outcome<&Path> {
    use std::os::unix::ffi::OsStrExt;
    Ok(Path::new(std::ffi::OsStr::from_bytes(path.to_bytes())))
}

#[cfg(not(unix))]
pub(super) fn to_path(path: &CStr) -> Outcome<&Path> {
    path.to_str().map(Path::new).map_err(|_| Failure::invalid("path is not UTF-8"))
}

/// Frees an image. NULL is allowed and does nothing. Any thread; no call may be using it. Meshes
/// made from it live on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_free(image: *mut lapd_image) {
    value_or((), || {
        if !image.is_null() {
            // SAFETY: see the module's head.
            drop(unsafe { Box::from_raw(image) });
        }
    });
}

/// The voxels along x, y, z; `dims` has room for 3 values. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_dims(
    image: *const lapd_image,
    dims: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(dims.cast::<[usize; 3]>(), "dims")?;
        out.set(borrow(image, "image")?.image.dims());
        Ok(())
    })
}

/// The world position of the centre of voxel (0, 0, 0); `origin` has room for 3 values. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_origin(
    image: *const lapd_image,
    origin: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(origin.cast::<[f64; 3]>(), "origin")?;
        out.set(borrow(image, "image")?.image.frame().origin().to_array());
        Ok(())
    })
}

/// The distance between voxel centres along x, y, z; `spacing` has room for 3 values. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_spacing(
    image: *const lapd_image,
    spacing: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(spacing.cast::<[f64; 3]>(), "spacing")?;
        out.set(borrow(image, "image")?.image.frame().spacing().to_array());
        Ok(())
    })
}

/// Sets the distance between voxel centres along x, y, z, three values above 0: for files that do
/// not say it, as .npy and .tif. Origin and directions stay. No other thread may use the image
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, or a value is out of the range
/// that lapd_image_create takes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_set_spacing(
    context: *mut lapd_context,
    image: *mut lapd_image,
    spacing: *const f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let image = &mut borrow_mut(image, "image")?.image;
            let spacing = array(spacing, "spacing")?;
            let (origin, direction) = (image.frame().origin(), image.frame().direction());
            image.set_frame(Frame::new(origin.to_array(), spacing, direction.to_cols_array_2d())?);
            Ok(())
        })
    }
}

/// The direction matrix, row by row; column k is the world direction of image axis k. `direction`
/// has room for 9 values. The rounding of file headers is taken out of it. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_direction(
    image: *const lapd_image,
    direction: *mut f64,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(direction.cast::<[f64; 9]>(), "direction")?;
        out.set(borrow(image, "image")?.image.frame().direction().transpose().to_cols_array());
        Ok(())
    })
}

/// What the world axes of the image mean, a lapd_world_axes: those of the frame that its file was
/// read in. LAPD_AXES_UNKNOWN for images made from memory, and for files that do not say. Any
/// thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_world_axes(
    image: *const lapd_image,
    axes: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(axes, "axes")?;
        out.set(lapd_world_axes::from(borrow(image, "image")?.world) as i32);
        Ok(())
    })
}

/// The labels of the image other than 0, in increasing order, and how many they are.
///
/// `*labels` belongs to the image and is valid until it is freed; with a count of 0 it must not be
/// read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_labels(
    image: *const lapd_image,
    labels: *mut *const i32,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let (labels, count) = (Out::new(labels, "labels")?, Out::new(count, "count")?);
        // The first one is 0 in every image.
        let values = &borrow(image, "image")?.image.labels()[1..];
        labels.set(values.as_ptr());
        count.set(values.len());
        Ok(())
    })
}

/// Copies the label of every voxel, x fastest and packed, into a buffer with room for `capacity`
/// values; as many as there are voxels are needed. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_BUFFER_TOO_SMALL, and
/// nothing was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_copy_voxels(
    image: *const lapd_image,
    buffer: *mut i32,
    capacity: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let image = &borrow(image, "image")?.image;
        check_buffer(buffer, capacity, image.ids().len())?;
        for (i, &id) in image.ids().iter().enumerate() {
            // Written through the pointer: the caller's values need not be initialised.
            buffer.add(i).write(image.labels()[usize::from(id)]);
        }
        Ok(())
    })
}

/// The value that a label stands for in an image read with LAPD_LABELS_DISTINCT, as text with all
/// its digits.
///
/// `*value` belongs to the image and is valid until it is freed. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, or the label stands for no value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_value(
    image: *const lapd_image,
    label: i32,
    value: *mut *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(value, "value")?;
        let values = &borrow(image, "image")?.values;
        let known = usize::try_from(i64::from(label) - 1).ok().and_then(|n| values.get(n));
        out.set(
            known
                .ok_or_else(|| Failure::invalid(format!("label {label} stands for no value")))?
                .as_ptr(),
        );
        Ok(())
    })
}

/// The number of warnings that came up when the image was made or read. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_warning_count(
    image: *const lapd_image,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(count, "count")?;
        out.set(borrow(image, "image")?.warnings.len());
        Ok(())
    })
}

/// Warning `index` (from 0) that came up when the image was made or read: one line, UTF-8.
///
/// `*warning` belongs to the image and is valid until it is freed. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or `index` is not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_warning(
    image: *const lapd_image,
    index: usize,
    warning: *mut *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(warning, "warning")?;
        let warnings = &borrow(image, "image")?.warnings;
        let line = warnings
            .get(index)
            .ok_or_else(|| Failure::invalid(format!("there is no warning {index}")))?;
        out.set(line.as_ptr());
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::{extent, strided};

    #[test]
    fn extent_of_strided_images() {
        assert_eq!(extent([4, 3, 2], [1, 4, 12]), Some((0, 24)));
        assert_eq!(extent([4, 3, 2], [-1, 4, -12]), Some((15, 24)));
        assert_eq!(extent([1, 1, 1], [isize::MIN, 0, 0]), Some((0, 1)));
        assert_eq!(extent([3, 1, 1], [isize::MIN, 0, 0]), None);
    }

    #[test]
    fn more_voxels_than_have_a_number_are_refused() {
        assert_eq!(strided([1, 1, u32::MAX as usize], Some([0; 3])).unwrap(), (0, 1, [0; 3]));
        let message = |dims| strided(dims, Some([0; 3])).unwrap_err().message;
        assert_eq!(
            message([1 << 16, 1 << 16, 1]),
            "an image of [65536, 65536, 1] voxels is too large: at most 2^32 - 1 voxels"
        );
        assert!(message([usize::MAX, 2, 1]).ends_with("at most 2^32 - 1 voxels"));
        assert!(
            strided([3, 1, 1], Some([isize::MIN, 0, 0]))
                .unwrap_err()
                .message
                .starts_with("strides [-")
        );
    }
}
