//! How many tets a mesh will have, before it is made.
//!
//! Tets are smallest at interfaces, and grow away from them. So most of them are about interfaces:
//! their number follows from the area of the labels' boundaries over the square of the distance of
//! samples there. Where a largest circumradius is asked for, those inside of labels follow from
//! volumes, as far as tets that grow from the interfaces would be larger.
//!
//! The constants are measured: docs/notes/sampling.md has the images, and by how much the estimate
//! misses. Structure that is lost at a coarse delta, or that the voxels do not show, is not seen.
//!
//! With [`Adaptive::Topology`] samples come closer where the mesh would differ from the image.
//! Where that is cannot be known before. But most of it is about contacts, and about what is much
//! thinner than samples are apart. So for each of these a sizing field is made that is small there,
//! and a part of what it adds is counted.
//!
//! Cost: two passes through the voxels of the region, and a sweep along each axis, up to four times
//! that with topology. Memory: a byte per voxel of the region, where a largest circumradius is
//! asked for.

use glam::DVec3;
use rayon::prelude::*;

use super::contact_lines::divided_by_lines;
use super::levels::grade;
use super::{Place, Sizing, Spacing, TetSizes};
use crate::Result;
use crate::image::LabelImage;
use crate::image::region::Rows;
use crate::memory::{collected, filled};
use crate::params::{Adaptive, MeshParams};

/// Tets of a label for each square of its boundary whose side is the distance of samples, by that
/// distance in voxels. Faces of voxels have more area than the surface that runs between them; but
/// where samples are far apart, tets reach deeper.
const PER_SQUARE: [(f64, f64); 7] =
    [(1.0, 3.1), (1.5, 3.5), (2.0, 3.55), (3.0, 3.76), (4.5, 3.9), (6.0, 3.85), (9.0, 3.4)];

/// How many times as many there are where the distance of samples changes from place to place, as
/// beside thin structures: tets there must fit to both. Not where sizes follow thickness, too
/// (`across`): there tets are small on both sides of a transition.
const GRADED: f64 = 1.3;

/// The parts of what such fields add that [`Adaptive::Topology`] adds: of a field that is small
/// about contacts along lines, about other contacts, and where something is thin
/// ([`Spacing::by_topology`]). Fitted to eight images at up to seven deltas
/// (docs/notes/sampling.md).
const OF_LINES: f64 = 3.0;
const OF_CONTACTS: f64 = 0.75;
const OF_THIN: f64 = 0.4;

/// The same where not all differences count
/// ([`all_differences_count`](MeshParams::all_differences_count)): of contacts; and of what is
/// thin, for each voxel that delta is above three.
const OF_CONTACTS_COARSE: f64 = 0.182;
const OF_THIN_BY_DELTA: f64 = 0.0141;

/// With so many contacts for each thousand tets at a delta of three voxels labels are so near to
/// each other that this part of them counts; with fewer, less, and no more with more than that many
/// times as many.
const MANY_CONTACTS: f64 = 11.85;
const MOST_CONTACTS: f64 = 1.33;
const BY_CONTACTS: f64 = 1.6;

/// Coarsening leaves this part of what [`Spacing::coarsened`] leads to.
const LEFT: f64 = 0.68;

/// Tets in the cube of a largest circumradius.
const PER_CUBE: f64 = 4.6;

/// How large tets are at interfaces, in distances of samples.
const AT_INTERFACE: f64 = 1.2;

/// By how much they grow per distance from there.
const GROWTH: f64 = 0.6;

/// Steps of a distance in the smallest side of a voxel.
const STEPS: f64 = 4.0;

/// Tets to be expected, within a fifth for most images.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Of labels.
    pub of_labels: f64,
    /// Of the background about them, which refinement makes, too.
    pub of_background: f64,
}

impl Expected {
    /// With a part of what another one has more.
    fn with_part(self, part: f64, other: Self, none: Self) -> Self {
        Self {
            of_labels: self.of_labels + part * (other.of_labels - none.of_labels),
            of_background: self.of_background + part * (other.of_background - none.of_background),
        }
    }
}

/// Tets to be expected of an image, whose rows are given, and whose contacts, in voxels: these
/// matter with [`Adaptive::Topology`] alone.
///
/// # Errors
/// [`OutOfMemory`](crate::Error::OutOfMemory); whatever `check` returns.
pub fn expected_tets(
    image: &LabelImage,
    rows: &Rows,
    params: &MeshParams,
    contacts: &[DVec3],
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Expected> {
    let spacing = Spacing::new(params, image.labels());
    let with = |spacing: &Spacing, places: &[Place]| {
        expected_of(image, rows, params, spacing, places, GRADED, check)
    };
    let none = with(&spacing, &[])?;
    if params.adaptive != Adaptive::Topology {
        return Ok(none);
    }
    let (side, apart) = (image.frame().spacing().min_element(), spacing.at_contacts(image));
    let (in_lines, others) = divided_by_lines(contacts)?;
    let mut expected = none;
    let [of_contacts, of_thin] = parts_of_topology(params, side, none.of_labels, contacts.len());
    for (part, contacts) in [(OF_LINES, in_lines), (of_contacts, others)] {
        let about = contacts.iter().map(|&index| Place::about_contact(index, apart, side));
        let places: Vec<Place> = collected(about, "contacts of the estimate")?;
        if !places.is_empty() && apart < spacing.delta {
            expected = expected.with_part(part, with(&spacing, &places)?, none);
        }
    }
    let with_thin = with(&Spacing::by_topology(params, image), &[])?;
    Ok(expected.with_part(of_thin, with_thin, none))
}

/// The parts of what is added about contacts, and where something is thin; `tets` are those without
/// anything added, `side` is the smallest one of a voxel.
fn parts_of_topology(params: &MeshParams, side: f64, tets: f64, contacts: usize) -> [f64; 2] {
    if params.all_differences_count(side) {
        return [OF_CONTACTS, OF_THIN];
    }
    let voxels = params.delta / side;
    let per_thousand = 1e3 * contacts as f64 / (tets * (voxels / 3.0).powi(2)).max(1.0);
    let dense = (per_thousand / MANY_CONTACTS).min(MOST_CONTACTS).powf(BY_CONTACTS);
    [OF_CONTACTS_COARSE * dense, OF_THIN_BY_DELTA * (voxels - 3.0).max(0.0)]
}

/// The same where the mesh is coarsened.
///
/// # Errors
/// As [`expected_tets`].
pub fn expected_coarsened(
    image: &LabelImage,
    rows: &Rows,
    params: &MeshParams,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Expected> {
    let spacing = Spacing::coarsened(params, image);
    // Between edges that are contracted and others there is no such transition.
    let Expected { of_labels, of_background } =
        expected_of(image, rows, params, &spacing, &[], 1.0, check)?;
    Ok(Expected { of_labels: LEFT * of_labels, of_background: LEFT * of_background })
}

fn expected_of(
    image: &LabelImage,
    rows: &Rows,
    params: &MeshParams,
    spacing: &Spacing,
    places: &[Place],
    graded: f64,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Expected> {
    let tets = TetSizes::new(image, rows, params, check)?.into();
    let sizing = &Sizing::new(image, rows, spacing, tets, places, check)?;
    let graded = if sizing.tets().min().is_finite() { 1.0 } else { graded };
    let boundaries = Boundaries { image, rows, spacing, sizing, graded, check };
    let [of_background, about_interfaces] = boundaries.tets()?;
    let sizes: Vec<f64> = image.labels().iter().map(|&label| params.size_of(label)).collect();
    let sides = rows.dims().into_iter().zip(image.frame().spacing().to_array());
    let longest = sides.map(|(n, side)| n as f64 * side).fold(0.0, f64::max);
    let bounds_any = sizes.iter().skip(1).any(|&size| size.min(sizing.tets().min()) < longest);
    let inside = if bounds_any { boundaries.tets_inside(&sizes)? } else { 0.0 };
    Ok(Expected { of_labels: about_interfaces + inside, of_background })
}

/// The boundaries of labels, as faces of voxels.
struct Boundaries<'a> {
    image: &'a LabelImage,
    rows: &'a Rows,
    spacing: &'a Spacing,
    sizing: &'a Sizing,
    /// [`GRADED`], or 1.
    graded: f64,
    check: &'a (dyn Fn() -> Result<()> + Sync),
}

impl Boundaries<'_> {
    /// Tets about the boundaries: of the background, and of labels.
    fn tets(&self) -> Result<[f64; 2]> {
        let spacing = self.image.frame().spacing();
        let areas = spacing.element_product() / spacing;
        let voxel = spacing.element_product().cbrt();
        // For each distance of samples that there is.
        let per_area = |apart: f64| per_square(apart / voxel) / (apart * apart);
        let mut per_area: Vec<f64> = self.sizing.levels().map(per_area).collect();
        let asked_for = self.spacing.asked_for(self.image);
        let asked_for: Vec<u8> = asked_for.map(|apart| self.sizing.level_of(apart)).collect();
        for (level, tets) in (0..=u8::MAX).zip(&mut per_area) {
            if !asked_for.contains(&level) {
                *tets *= self.graded;
            }
        }
        let [_, ny, nz] = self.rows.dims();
        let of_layer = |y: usize| {
            (self.check)()?;
            let mut sums = [0.0; 2];
            for z in 0..nz {
                self.visit_row(y, z, |x, id, faces| {
                    let area = areas.dot(DVec3::from(faces.map(f64::from)));
                    let level = self.sizing.level_of_voxel([x, y, z]);
                    sums[usize::from(id != 0)] += area * per_area[usize::from(level)];
                });
            }
            Ok(sums)
        };
        let add = |a: [f64; 2], b: [f64; 2]| Ok([a[0] + b[0], a[1] + b[1]]);
        (0..ny).into_par_iter().map(of_layer).try_reduce(|| [0.0; 2], add)
    }

    /// Tets that a largest circumradius brings inside of labels; `sizes` are by id.
    fn tets_inside(&self, sizes: &[f64]) -> Result<f64> {
        let &Self { image, rows, sizing, check, .. } = self;
        let [nx, ny, nz] = rows.dims();
        let layer = nx * nz;
        let what = "voxels of the distances for the estimate";
        let mut distances = filled(layer * ny, u8::MAX, what, check)?;
        distances.par_chunks_mut(layer).enumerate().try_for_each(|(y, layer)| {
            check()?;
            for z in 0..nz {
                self.visit_row(y, z, |x, _, _| layer[x + nx * z] = 0);
            }
            Ok(())
        })?;
        let spacing = image.frame().spacing();
        let step = spacing.min_element() / STEPS;
        let growth = (spacing / step).to_array().map(|steps| steps.clamp(1.0, 255.0) as u8);
        grade(&mut distances, [nx, ny, nz], growth);
        let apart: Vec<f64> = sizing.levels().collect();
        let volume = PER_CUBE * image.voxel_volume();
        let of_layer = |y: usize| {
            check()?;
            let mut sum = 0.0;
            for z in 0..nz {
                let ids = &rows.row(y, z)[..nx];
                for (x, &id) in ids.iter().enumerate().filter(|&(_, &id)| id != 0) {
                    let apart = apart[usize::from(sizing.level_of_voxel([x, y, z]))];
                    let distance = step * f64::from(distances[x + nx * (z + nz * y)]);
                    let grown = (AT_INTERFACE * apart + GROWTH * distance).powi(-3);
                    let size = sizes[usize::from(id)].min(sizing.tets().of_voxel([x, y, z]));
                    sum += volume * (size.powi(-3) - grown).max(0.0);
                }
            }
            Ok(sum)
        };
        (0..ny).into_par_iter().map(of_layer).try_reduce(|| 0.0, |a, b| Ok(a + b))
    }

    /// Visits the voxels of a row along x that have faces with another label behind them, with how
    /// many along each axis. Beyond the region is background.
    fn visit_row(&self, y: usize, z: usize, mut visit: impl FnMut(usize, u16, [u8; 3])) {
        let [nx, ny, nz] = self.rows.dims();
        let row = self.rows.row(y, z);
        // The row itself where there is no other: its voxels are background, as those beyond.
        let [before_y, after_y] = [y.saturating_sub(1), (y + 1).min(ny - 1)];
        let [before_z, after_z] = [z.saturating_sub(1), (z + 1).min(nz - 1)];
        let along_y = [self.rows.row(before_y, z), self.rows.row(after_y, z)];
        let along_z = [self.rows.row(y, before_z), self.rows.row(y, after_z)];
        for x in 0..nx {
            let id = row[x];
            let differ = |[a, b]: [u16; 2]| u8::from(a != id) + u8::from(b != id);
            let faces = [
                differ([row[x.saturating_sub(1)], row[x + 1]]),
                differ(along_y.map(|row| row[x])),
                differ(along_z.map(|row| row[x])),
            ];
            if faces != [0; 3] {
                visit(x, id, faces);
            }
        }
    }
}

/// [`PER_SQUARE`] at a distance of samples, in voxels; between two of them in proportion to the
/// logarithm.
fn per_square(voxels: f64) -> f64 {
    let [(first, least), .., (last, most)] = PER_SQUARE;
    if voxels <= first {
        return least;
    }
    if voxels >= last {
        return most;
    }
    let at = PER_SQUARE.iter().position(|&(upper, _)| voxels <= upper).unwrap_or(1).max(1);
    let [(a, low), (b, high)] = [PER_SQUARE[at - 1], PER_SQUARE[at]];
    low + (high - low) * (voxels / a).ln() / (b / a).ln()
}
