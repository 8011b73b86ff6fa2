//! Names of labels.

use std::ffi::c_char;

use super::boundary::{Failure, Out, borrow, borrow_mut, c_str, status_of};
use super::context::{lapd_context, with_context};
use super::image::{lapd_image, to_path};
use super::label_names::Names;
use super::mesh::lapd_mesh;
use super::status::lapd_status;
use crate::error::one_line;
use crate::io::read::label_table::read_label_table;

/// Names a label, in place of the name that the image's file gave it. Meshes made of the image have
/// the name, and files of these. Labels that lapd_params_set_merge makes others are named by those
/// of the image: their names are joined by '+', unless the label that they become has a name of its
/// own, which may be one that the image does not have.
///
/// `name` is UTF-8, one line; it is copied. No other thread may use the image or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, or `name` is empty, not UTF-8, or
/// has control characters.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_set_label_name(
    context: *mut lapd_context,
    image: *mut lapd_image,
    label: i32,
    name: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let image = borrow_mut(image, "image")?;
            let text = c_str(name, "name")?;
            let refused = |why: &str| Failure::invalid(format!("the name of label {label} {why}"));
            let name = text.to_str().map_err(|_| refused("is not UTF-8"))?;
            if name.trim().is_empty() {
                return Err(refused("is empty"));
            }
            if one_line(name) != name {
                return Err(refused("has control characters"));
            }
            image.names.insert(label, text, name.to_owned());
            Ok(())
        })
    }
}

/// Names labels by a table, in place of the names that they have: a label a line, its number, its
/// name, and perhaps its red, green and blue. Such are the tables of 3D Slicer (.ctbl), FreeSurfer
/// (FreeSurferColorLUT.txt) and ITK-SNAP (label descriptions), tables with commas, and lists like
/// "7 liver". Labels that the image does not have may be among them.
///
/// `path` is as in lapd_image_read, with any ending. No other thread may use the image or the
/// context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_IO when the file cannot
/// be read; LAPD_ERROR_FORMAT when it is no such table.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_read_label_names(
    context: *mut lapd_context,
    image: *mut lapd_image,
    path: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let image = borrow_mut(image, "image")?;
            let mut names = image.names.all().clone();
            names.extend(read_label_table(to_path(c_str(path, "path")?)?)?);
            image.names = Names::new(names);
            Ok(())
        })
    }
}

/// The name of a label: one that it was given (lapd_image_set_label_name,
/// lapd_image_read_label_names), or that the image's file has for it, as 3D Slicer's segmentations
/// do; `*name` is NULL where it has none.
///
/// `*name` belongs to the image and is valid until that is freed or its labels are named. Any
/// thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_image_get_label_name(
    image: *const lapd_image,
    label: i32,
    name: *mut *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(name, "name")?;
        out.set(borrow(image, "image")?.names.text(label));
        Ok(())
    })
}

/// The name that a label of the image gave to a label of the mesh, as lapd_image_set_label_name
/// tells; `*name` is NULL where it has none.
///
/// `*name` belongs to the mesh and is valid until that is freed or certified. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_label_name(
    mesh: *const lapd_mesh,
    label: i32,
    name: *mut *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(name, "name")?;
        out.set(borrow(mesh, "mesh")?.names.text(label));
        Ok(())
    })
}

/// The colour of a label, red, green and blue from 0 to 255, where the image's file or a table of
/// names gave it one: `color` has room for 3 values, `*known` is 1. Else nothing is written to
/// `color`, and `*known` is 0. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_label_color(
    mesh: *const lapd_mesh,
    label: i32,
    color: *mut u8,
    known: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(color.cast::<[u8; 3]>(), "color")?;
        let known = Out::new(known, "known")?;
        let found = borrow(mesh, "mesh")?.names.all().get(label).and_then(|name| name.color);
        known.set(found.is_some().into());
        if let Some(color) = found {
            out.set(color);
        }
        Ok(())
    })
}
