//! The first stage: what is to be meshed, where its interfaces are, how densely they are sampled.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use glam::DVec3;
use rayon::prelude::*;

use crate::image::LabelImage;
use crate::image::region::{Region, Rows};
use crate::image::small_components::SmallComponent;
use crate::memory::collected;
use crate::mesh::extract::BYTES_PER_SLOT;
use crate::monitor::{Level, Monitor, Step};
use crate::oracle::{Oracle, Surface};
use crate::params::{Adaptive, CertificateLevel, MeshParams, SurfaceModel};
use crate::pipeline::messages;
use crate::refine::options::Limits;
use crate::second_order;
use crate::sizing::contact_lines::along_lines;
use crate::sizing::{Place, SampledContacts, Sizing, Spacing, TetSizes};
use crate::verify::Certificate;
use crate::{Error, Result};

/// An image whose labels are those to be meshed.
pub struct Selected<'a> {
    /// The image.
    pub image: Cow<'a, LabelImage>,
    /// The components that were left out for their size.
    pub dropped: Vec<SmallComponent>,
}

/// Merges labels, keeps those that are wanted, and leaves out components that are too small, as
/// `params` ask.
///
/// # Errors
/// [`Error::InvalidArgument`] for a label that does not occur; [`Error::EmptyImage`] when nothing
/// is left; [`Error::Unsupported`]; [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn select_labels<'a>(
    image: &'a LabelImage,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) -> Result<Selected<'a>> {
    let mut image = Cow::Borrowed(image);
    if !params.merge.is_empty() || params.background_label != 0 {
        image = Cow::Owned(image.merged(&params.merge, params.background_label)?);
    }
    if let Some(label) = params.label_sizes.keys().find(|&&label| image.id_of(label).is_none()) {
        return Err(Error::InvalidArgument(format!(
            "a size is given for label {label}, which does not occur in the image"
        )));
    }
    if !params.keep.is_empty() {
        image = Cow::Owned(image.restricted_to(&params.keep)?);
    }
    let mut dropped = Vec::new();
    if params.min_voxels > 1 {
        let cleared;
        let go_on = |_| monitor.advance(0);
        (cleared, dropped) = image.without_small_components(params.min_voxels, &go_on)?;
        image = Cow::Owned(cleared);
    }
    if image.is_all_background() {
        return Err(Error::EmptyImage);
    }
    Ok(Selected { image, dropped })
}

/// An image that is ready to be meshed.
pub struct Divided<'a> {
    /// The image.
    pub image: Cow<'a, LabelImage>,
    /// The limits, which count what it takes, as long as it is held.
    pub limits: Limits,
}

/// Divides the long voxels of an image for the smooth surface model, which is the one that bulges
/// between them, but for smoothed labels.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]; those of `limits`.
pub fn divide<'a>(
    image: &'a LabelImage,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<Divided<'a>> {
    let mut limits = limits.clone();
    if params.sigma > 0.0 || params.surface == SurfaceModel::Voxel {
        return Ok(Divided { image: Cow::Borrowed(image), limits });
    }
    let go_on = || monitor.advance(0).and_then(|()| limits.check_time());
    let divided = image.with_cubes(&|bytes| limits.check_memory(bytes), &go_on)?;
    if image.is_too_large_for_cubes() {
        messages::warn_of_long_voxels(monitor);
    }
    if let Cow::Owned(divided) = &divided {
        limits.bytes_beside += size_of_val(divided.ids()) as u64;
        monitor.log(Level::Info, &messages::describe_division(image, divided));
    }
    Ok(Divided { image: divided, limits })
}

/// What refinement asks about an image.
pub struct Prepared {
    /// Where the interfaces are.
    pub oracle: Oracle,
    /// How far apart their samples are.
    pub sizing: Sizing,
    /// The volume of the object.
    pub volume: f64,
}

/// Prepares an image, on all threads of the current rayon pool.
///
/// # Errors
/// [`Error::EmptyImage`]; [`Error::InvalidArgument`] for an object that is too large;
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]; those of `limits`.
pub fn prepare(
    image: &LabelImage,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<Prepared> {
    let go_on = || monitor.advance(1).and_then(|()| limits.check_time());
    let region = Region::new(image, &go_on)?;
    let spacing = Spacing::new(params, image.labels());
    messages::warn_of_lowered(params, spacing.delta, monitor);
    if limits.max_memory.is_some() {
        let sizing = Sizing::bytes_needed(image, &region, params);
        let first = Oracle::bytes_needed(image, &region) + sizing;
        limits.check_memory(first.max(limits.bytes_after))?;
    }
    let surface = surface(params);
    let rows = Rows::new(image, region, &go_on)?;
    let oracle = Oracle::of_rows(image, &rows, surface, &go_on)?;
    let sizing = sizing_of_rows(image, &rows, &oracle, params, &go_on)?;
    Ok(Prepared { oracle, sizing, volume: object_volume(image) })
}

/// The sizing field alone, for other lengths than those that the image was prepared for.
///
/// # Errors
/// Those of [`prepare`].
pub fn sizing(
    image: &LabelImage,
    oracle: &Oracle,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<Sizing> {
    let go_on = || monitor.advance(0).and_then(|()| limits.check_time());
    let rows = Rows::new(image, Region::new(image, &go_on)?, &go_on)?;
    sizing_of_rows(image, &rows, oracle, params, &go_on)
}

fn sizing_of_rows(
    image: &LabelImage,
    rows: &Rows,
    oracle: &Oracle,
    params: &MeshParams,
    go_on: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Sizing> {
    let tets = TetSizes::new(image, rows, params, go_on)?.into();
    let spacing = Spacing::new(params, image.labels());
    let contacts = places_of_contacts(image, oracle, &spacing, go_on)?;
    Sizing::new(image, rows, &spacing, tets, &contacts, go_on)
}

/// The places about the contacts of the image that are sampled from the start.
///
/// # Errors
/// [`Error::OutOfMemory`]; those of `go_on`.
pub(super) fn places_of_contacts(
    image: &LabelImage,
    oracle: &Oracle,
    spacing: &Spacing,
    go_on: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<Place>> {
    let sampled = spacing.sampled_contacts(image);
    if sampled == SampledContacts::None {
        return Ok(Vec::new());
    }
    let apart = spacing.at_contacts(image);
    let side = image.frame().spacing().min_element();
    let mut contacts = contacts_in_voxels(image, oracle, go_on)?;
    if sampled == SampledContacts::AlongLines {
        contacts = along_lines(&contacts)?;
    }
    let place = |&index| Place::about_contact(index, apart, side);
    collected(contacts.iter().map(place), "places of contacts")
}

/// The contacts of an image, in voxels, where samples follow topology; else none. For estimates,
/// which have no oracle: one is made here, and dropped.
///
/// # Errors
/// [`Error::OutOfMemory`]; those of `go_on`.
pub(super) fn contacts_of(
    image: &LabelImage,
    rows: &Rows,
    params: &MeshParams,
    go_on: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<DVec3>> {
    if params.adaptive != Adaptive::Topology {
        return Ok(Vec::new());
    }
    contacts_in_voxels(image, &Oracle::of_rows(image, rows, surface(params), go_on)?, go_on)
}

fn contacts_in_voxels(
    image: &LabelImage,
    oracle: &Oracle,
    go_on: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<DVec3>> {
    let mut contacts = oracle.contacts(go_on)?;
    contacts.iter_mut().for_each(|p| *p = image.frame().to_index(*p));
    Ok(contacts)
}

/// The oracle alone, for a mesh that is finished already.
///
/// # Errors
/// Those of [`prepare`].
pub fn oracle_of(
    image: &LabelImage,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<Oracle> {
    let go_on = || monitor.advance(1).and_then(|()| limits.check_time());
    let region = Region::new(image, &go_on)?;
    if limits.max_memory.is_some() {
        limits.check_memory(Oracle::bytes_needed(image, &region) + limits.bytes_after)?;
    }
    let rows = Rows::new(image, region, &go_on)?;
    Oracle::of_rows(image, &rows, surface(params), &go_on)
}

fn surface(params: &MeshParams) -> Surface {
    Surface {
        model: params.surface,
        border: params.border,
        sigma: (params.sigma > 0.0).then_some(params.sigma),
    }
}

/// Enters the step of the preparation, with the most that it asks whether to go on: per plane, per
/// layer in five passes, where a table is filled in, in each step of the weights, and per 512 rows
/// for contacts.
pub(super) fn enter(image: &LabelImage, monitor: &Monitor<'_>) -> Result<()> {
    let [nx, ny, nz] = image.dims_in_cubes();
    let of_contacts = ny * nz / 512;
    monitor.enter(Step::Oracle, nz + 5 * (ny + 2) + nx * ny * nz / (1 << 15) + of_contacts + 64)
}

/// The limits of `params` for a run on `image`, or on one of other labels; `start` is when it
/// began.
pub fn limits(params: &MeshParams, image: &LabelImage, start: Instant) -> Limits {
    // A deadline that the clock cannot hold never comes.
    let deadline = params.time_limit.and_then(|seconds| {
        let end = start.checked_add(Duration::try_from_secs_f64(seconds).ok()?)?;
        Some((end, seconds))
    });
    let (max_vertices, max_memory) = (params.max_vertices, params.max_memory);
    let bytes_after = match params.certificate {
        CertificateLevel::Full => Certificate::bytes_needed(image),
        CertificateLevel::None | CertificateLevel::Sound => 0,
    };
    let of_nodes = if params.order == 2 { second_order::BYTES_PER_TET } else { 0 };
    Limits {
        max_vertices,
        deadline,
        max_memory,
        bytes_per_slot: BYTES_PER_SLOT + of_nodes,
        bytes_after,
        bytes_beside: 0,
    }
}

/// The volume of the object, by its voxels.
fn object_volume(image: &LabelImage) -> f64 {
    // Few enough at once that 16 bits hold their number, which lets many be counted at a time.
    let count = |ids: &[u16]| u64::from(ids.iter().map(|&id| u16::from(id != 0)).sum::<u16>());
    let voxels: u64 = image.ids().par_chunks(1 << 15).map(count).sum();
    voxels as f64 * image.voxel_volume()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::phantom::sampled;

    /// Two cubes that touch along an edge, and a sheet of one voxel.
    #[test]
    fn samples_are_closest_about_contacts() {
        let cube = |p: DVec3, center: DVec3| (p - center).abs().max_element() < 3.0;
        let label = |p: DVec3| {
            let is_body = cube(p, DVec3::new(-3.0, -3.0, -9.0))
                || cube(p, DVec3::new(3.0, 3.0, -9.0))
                || p.z > 11.0 && p.z < 12.0 && p.x.abs().max(p.y.abs()) < 9.0;
            i32::from(is_body)
        };
        let image = sampled([30, 30, 40], [1.0; 3], label).unwrap();
        let lengths = |spacing_floor: f64| {
            let adaptive = Adaptive::Thickness;
            let params =
                MeshParams { delta: 4.0, size: 8.0, adaptive, spacing_floor, ..Default::default() };
            let limits = Limits::default();
            let prepared = prepare(&image, &params, &limits, &Monitor::silent()).unwrap();
            let at = |x: f64, y: f64, z: f64| prepared.sizing.at(DVec3::new(x, y, z));
            [at(0.1, 0.1, -9.0), at(5.0, 0.5, 11.5), at(0.0, 0.0, 5.0)]
        };
        let [contact, thin, elsewhere] = lengths(0.5);
        assert!((0.7..=0.75).contains(&contact), "{contact}");
        assert!((0.85..=0.9).contains(&thin), "{thin}");
        assert!(elsewhere > 2.0, "{elsewhere}");
        // What is asked for is the least.
        let [contact, thin, _] = lengths(1.2);
        assert!(contact.min(thin) >= 1.2, "{contact}, {thin}");
    }
}
