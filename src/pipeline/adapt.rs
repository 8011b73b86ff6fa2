//! Sampling that follows what is connected: refined, compared with the image, refined further where
//! it differs, until nothing does that counts.
//!
//! A mesh of samples delta apart is right nearly everywhere, however thin structures are: a sheet
//! between two others is whole as long as the samples on its sides see each other. Where it is
//! wrong is known only when it is there. So the mesh of the finished refinement is compared with
//! the image (`compare`), and about each difference that counts the sizing field
//! is made smaller:
//!
//! - By three tenths at a coarse delta, else by half, within half of what it was, and within the
//!   voxel at least; so a place takes some dozens of samples each time.
//! - Where samples are as close as the floor already, to the floor within a voxel, two, or three,
//!   of the smallest side: the least of these distances in which they are not so close everywhere.
//! - Where delta is coarse and differences are few (`SLOTS_PER_PLACE`) the floor at once, within
//!   half of the spacing and three sides at most; or within three sides where samples are as close
//!   already. At finer deltas that costs more than it saves.
//! - Contacts along lines (`sizing/contact_lines`) have such samples from the start, and all
//!   contacts where delta is about a voxel.
//! - Other contacts need the octahedron around them (`oracle/features/edges`), whose points are
//!   half of a voxel's smallest side away: at once so small that these are sampled.
//! - Nicks wait until after the first round, if there is anything else: most are gone then.
//!
//! The refinement then goes on, on the same triangulation. Most differences are gone after some
//! rounds; the last ones move about for some more. Samples are looked for no farther than they are
//! to be closer.
//!
//! It ends: the field only gets smaller, not below the floor, and rounds are counted. Whether
//! differences are left is not an error: the certificate tells of them.

use std::collections::HashMap;
use std::sync::Arc;

use super::compare::Comparison;
use super::mend::Mending;
use super::messages;
use super::prepare::{Prepared, places_of_contacts};
use super::refine::options;
use crate::Result;
use crate::delaunay::Triangulation;
use crate::image::LabelImage;
use crate::image::region::{Region, Rows};
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{self, reserve};
use crate::monitor::Monitor;
use crate::params::{Adaptive, MeshParams};
use crate::refine::options::Limits;
use crate::refine::podm::{Before, Refinement};
use crate::refine::refine_further;
use crate::refine::rules::Rules;
use crate::sizing::{Place, Sizing, Spacing};
use crate::verify::topology::differences::{Difference, Kind};

/// Most rounds of refinement after the first one.
const ROUNDS: usize = 40;

/// The part of the step of refinement that the first round is taken to have, for progress. Of what
/// is left each round has a half.
const FIRST_PART: f64 = 0.6;

/// The part of their spacing that is left when samples about a difference come closer in a step,
/// where delta is coarse. Larger steps take fewer rounds, but make samples closer than they need to
/// be.
const CLOSER_COARSE: f64 = 0.7;

/// The same where all differences count. The floor is one or two steps away there.
const CLOSER: f64 = 0.5;

/// A round costs about as much as the closest samples about one place for each so many slots of
/// tets. Where delta is coarse and differences are fewer they get these samples at once.
const SLOTS_PER_PLACE: usize = 1 << 17;

/// How far around it, in spacings that are there.
const REACH: f64 = 0.5;

/// Samples come as close as the floor no farther from it than so many smallest sides of a voxel.
const LARGEST_REACH: usize = 3;

/// How far around it at least, in voxels: no point is farther than half of a voxel's diagonal from
/// the centre of the voxel that holds it.
const LEAST_REACH: f64 = 0.87;

/// Places so near each other, in parts of how far they reach, are one. Where deltas are some voxels
/// no two are; where labels are lost because delta is as large as they are, all of their voxels
/// differ, and each place would have thousands of voxels.
const SAME_PLACE: f64 = 0.125;

/// A spacing so little above the floor is the floor: fields count in steps.
const AT_FLOOR: f64 = 1.01;

/// What came of it.
#[derive(Debug, Default)]
pub struct Adapted {
    /// The sizing field in the end; `None`: the one that there was.
    pub sizing: Option<Sizing>,
    /// How many differences that count each comparison found, as far as samples were given to them
    /// in that round.
    pub differences: Vec<u64>,
    /// What mending the mesh comes to with the first of its passes, numbered with the background
    /// that is kept for improvement; `None`: it is not known.
    pub(super) mended: Option<Mending>,
}

/// The part of the step of refinement that is done when a round begins, 0 for the first, and when
/// it ends; of the `whole` that all rounds have.
pub fn parts(params: &MeshParams, round: usize, whole: [f64; 2]) -> [f64; 2] {
    let done = |rounds: usize| match rounds {
        0 => 0.0,
        _ => 1.0 - (1.0 - FIRST_PART) * 0.5_f64.powi(rounds as i32 - 1),
    };
    match params.adaptive {
        Adaptive::Topology => {
            [done(round), done(round + 1)].map(|part| whole[0] + (whole[1] - whole[0]) * part)
        }
        Adaptive::Off | Adaptive::Thickness => whole,
    }
}

/// The run whose sampling is adapted.
pub struct Run<'a> {
    /// What is meshed.
    pub image: &'a LabelImage,
    /// Its oracle, and the sizing field of the first round.
    pub prepared: &'a Prepared,
    /// The triangulation that is refined.
    pub triangulation: &'a Triangulation,
    /// What the run is asked for.
    pub params: &'a MeshParams,
    /// Its limits.
    pub limits: &'a Limits,
    /// The part of the step of refinement that is done when the first round begins, and when the
    /// last one ends.
    pub parts: [f64; 2],
}

impl Run<'_> {
    /// Goes on with a refinement that has come to its end, as long as the mesh differs from the
    /// image. A limit ends it as it ends a refinement.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory),
    /// [`Internal`](crate::Error::Internal).
    pub fn adapt(&self, refinement: &mut Refinement, monitor: &Monitor<'_>) -> Result<Adapted> {
        let mut adapted = Adapted::default();
        match self.go_on(refinement, &mut adapted, monitor) {
            Err(limit) if limit.is_limit() => refinement.ended_by = Some(limit),
            done => done?,
        }
        Ok(adapted)
    }

    fn go_on(
        &self,
        refinement: &mut Refinement,
        adapted: &mut Adapted,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        let Self { image, prepared, triangulation, params, limits, .. } = *self;
        let look = || monitor.advance(0).and_then(|()| limits.check_time());
        let quiet = Monitor::within(&look);
        let region = Region::new(image, &look)?;
        self.check_memory(&region)?;
        let mut comparison = Comparison::new(image, prepared, params, region, &quiet)?;
        let mut places = Places::new(image, params);
        places.list = places_of_contacts(image, &prepared.oracle, &places.spacing, &look)?;
        let mut how = options(params, limits.clone(), 0)?;
        how.limits.bytes_per_slot += Comparison::BYTES_PER_SLOT;
        how.limits.bytes_beside += comparison.bytes();
        for round in 1..=ROUNDS {
            let sizing = adapted.sizing.as_ref().unwrap_or(&prepared.sizing);
            let rules = self.rules(sizing);
            let (mut count, slots) = (0, triangulation.tet_bound() as usize);
            let mut sample = |counting: &[Difference]| {
                count = counting.len();
                let is_coarse = !params.all_differences_count(places.side);
                let are_few = is_coarse && counting.len() <= slots / SLOTS_PER_PLACE;
                places.add(counting, sizing, round, are_few)
            };
            let has_more = comparison.find(&rules, &mut sample, &quiet)?;
            adapted.differences.push(count as u64);
            messages::log_differences(monitor, round, count, has_more);
            if !has_more {
                adapted.mended = comparison.mended.take();
                break;
            }
            let rows = Rows::new(image, region, &look)?;
            let tets = Arc::clone(sizing.tets());
            let denser = Sizing::new(image, &rows, &places.spacing, tets, &places.list, &look)?;
            drop(rows);
            let blocks = VoxelBlocks::none(image.frame(), &region)?;
            denser.add_below(sizing, &blocks);
            how.parts = parts(params, round, self.parts);
            let before = Before { sizing, refinement, denser: &blocks.and_around()? };
            let later = refine_further(&self.rules(&denser), &before, &how, monitor)?;
            refinement.add(later)?;
            adapted.sizing = Some(denser);
            if refinement.ended_by.is_some() {
                break;
            }
            self.check_memory(&region)?;
        }
        Ok(())
    }

    fn rules<'s>(&'s self, sizing: &'s Sizing) -> Rules<'s> {
        let Self { image, prepared, triangulation, params, .. } = *self;
        Rules::new(triangulation, &prepared.oracle, sizing, params, image.labels())
    }

    /// Checks that a mesh of what there is can be compared.
    fn check_memory(&self, region: &Region) -> Result<()> {
        let Self { image, prepared, triangulation, limits, .. } = *self;
        let per_slot = limits.bytes_per_slot + Comparison::BYTES_PER_SLOT;
        let mesh = u64::from(triangulation.tet_bound()) * per_slot;
        let tables = Comparison::bytes_needed(image, region);
        let there = prepared.oracle.bytes() + prepared.sizing.bytes();
        limits.check_memory(there as u64 + triangulation.bytes() + mesh + tables)
    }
}

/// The places about which samples are to be closer, of all rounds.
struct Places<'a> {
    image: &'a LabelImage,
    spacing: Spacing,
    floor: f64,
    /// How far apart samples are to be about contacts.
    at_contacts: f64,
    /// The smallest side of a voxel.
    side: f64,
    /// [`CLOSER_COARSE`] or [`CLOSER`].
    closer: f64,
    list: Vec<Place>,
}

impl<'a> Places<'a> {
    fn new(image: &'a LabelImage, params: &MeshParams) -> Self {
        let spacing = Spacing::new(params, image.labels());
        let (floor, at_contacts) = (spacing.floor(image), spacing.at_contacts(image));
        let side = image.frame().spacing().min_element();
        let closer = if params.all_differences_count(side) { CLOSER } else { CLOSER_COARSE };
        Self { image, spacing, floor, at_contacts, side, closer, list: Vec::new() }
    }

    /// Adds those about the differences of a round, of a mesh whose samples are `sizing` apart.
    /// Where differences are few, samples come as close as the floor at once. `false`: no place is
    /// added, for all that can be done has been done.
    fn add(
        &mut self,
        differences: &[Difference],
        sizing: &Sizing,
        round: usize,
        are_few: bool,
    ) -> Result<bool> {
        const WHAT: &str = "places that differ";
        let before = self.list.len();
        // One in each cell, of those with the same spacing and reach.
        let mut cells = HashMap::new();
        for are_nicks in [false, true] {
            // Most nicks go with what else is done in the first round.
            if are_nicks && round == 1 && self.list.len() > before {
                break;
            }
            let of_kind = differences.iter().filter(|d| (d.kind == Kind::Nick) == are_nicks);
            for difference in of_kind {
                let Some(place) = self.about(difference, sizing, are_few) else { continue };
                let per_cell = self.image.frame().spacing() / (SAME_PLACE * place.radius);
                let cell = (place.index * per_cell).to_array().map(|c| c.floor() as i64);
                let alike = [place.spacing, place.radius].map(f64::to_bits);
                if memory::insert(&mut cells, (cell, alike), (), WHAT)?.is_none() {
                    reserve(&mut self.list, 1, WHAT)?;
                    self.list.push(place);
                }
            }
        }
        Ok(self.list.len() > before)
    }

    /// The place about a difference; `None` if samples are as close there as they may be.
    fn about(
        &self,
        &Difference { kind, index, .. }: &Difference,
        sizing: &Sizing,
        are_few: bool,
    ) -> Option<Place> {
        if self.floor >= self.spacing.delta {
            return None;
        }
        let now = sizing.at(self.image.frame().to_world(index));
        let is_at_floor = now <= AT_FLOOR * self.floor;
        let closer = if are_few { self.floor } else { (self.closer * now).max(self.floor) };
        match kind {
            Kind::Contact if is_at_floor => None,
            Kind::Contact => {
                let spacing = closer.min(self.at_contacts);
                Some(Place::about_contact(index, spacing, self.side))
            }
            Kind::Voxel | Kind::Touch | Kind::Piece | Kind::Nick if is_at_floor => {
                let about = |sides: usize| Place {
                    index,
                    spacing: self.floor,
                    radius: sides as f64 * self.side,
                    voxels: LEAST_REACH,
                };
                let least = if are_few { LARGEST_REACH } else { 1 };
                (least..=LARGEST_REACH).map(about).find(|place| sizing.is_above(place))
            }
            Kind::Voxel | Kind::Touch | Kind::Piece | Kind::Nick => {
                let largest = LARGEST_REACH as f64 * self.side;
                let radius = if are_few { (REACH * now).min(largest) } else { REACH * now };
                Some(Place { index, spacing: closer, radius, voxels: LEAST_REACH })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::frame::Frame;
    use glam::DVec3;

    #[test]
    fn near_differences_are_one_place_that_holds_them() {
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let image = LabelImage::from_fn([40; 3], frame, |_| 1).unwrap();
        let params =
            MeshParams { delta: 32.0, adaptive: Adaptive::Topology, ..MeshParams::default() };
        let index = |n: usize| DVec3::from([n % 20, n / 20 % 20, n / 400].map(|c| c as f64));
        let difference =
            |n| Difference { kind: Kind::Voxel, index: index(n), ids: [1, 0], is_far: true };
        let differences: Vec<_> = (0..8000).map(difference).collect();
        let places_of = |spacing: f64| {
            let mut places = Places::new(&image, &params);
            assert!(places.add(&differences, &Sizing::uniform(spacing), 1, false).unwrap());
            places.list
        };
        let far = places_of(32.0);
        assert!(far.len() < 8000 / 5, "{} places", far.len());
        for difference in &differences {
            let holds = |place: &Place| place.index.distance(difference.index) <= place.radius;
            assert!(far.iter().any(holds));
        }
        // Where samples are a few voxels apart each is a place of its own.
        assert_eq!(places_of(4.0).len(), differences.len());
    }
}
