//! The sizing field: how far apart samples of dO are to be, from place to place.
//!
//! Where nothing is thin that is delta, but no more than a part of the largest circumradius that
//! tets there may have (`PER_SIZE`): such tets need vertices nearer to the interface than its
//! samples are to each other, and rule R6 would remove what rule R5 inserts.
//!
//! A structure of thickness t (`sizing/thickness`) wants samples `PER_THICKNESS` t apart on both of
//! its sides: farther apart, the tets between its sides reach out of it, and it tears. For no
//! structure need they be closer than `LEAST_OF_THIN`. Away from there the field grows by no more
//! than `GRADING` per unit of distance (along the image axes one after the other), so that elements
//! grow smoothly. What is thin never takes it below the floor.
//!
//! Places ([`Place`]) where the mesh must come closer to the image make it small as well, whatever
//! is thin there: contacts of voxels, and where the mesh was found to differ from the image. From
//! these the field grows faster: they are small, and may be many.
//!
//! Where nothing makes it small there is no table (`sizing/levels`), and every answer is
//! delta. Where there is one, nothing is above `MAX_GRADED` voxels.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::levels::{LEVELS, Scale, Table, grade, widen};
use super::tet_sizes::{PER_SIZE, TetSizes};
use super::thickness::{self, NOT_THIN, Necks, ThinVoxels, thin_voxels};
use crate::Result;
use crate::image::bricks::Bricks;
use crate::image::region::{Region, Rows};
use crate::image::voxel_blocks::VoxelBlocks;
use crate::image::{LabelImage, Palette};
use crate::memory::{collected, filled};
use crate::params::{Adaptive, MeshParams};

/// Samples of a thin structure are this part of its thickness apart.
const PER_THICKNESS: f64 = 0.75;

/// For what is thin samples are no closer than this, in smallest sides of a voxel. Measured
/// (docs/notes/sampling.md): with 0.5 there are a sixth more tets, and no fewer faults; with 1,
/// points around contacts are left out.
const LEAST_OF_THIN: f64 = 0.9;

/// The spacing about a contact, in smallest sides of a voxel: samples around contacts may be half
/// as far apart, so all of the octahedron are taken.
const CONTACT_SPACING: f64 = 0.75;

/// How far around a contact that is, in smallest sides of a voxel: so far that those beside it are
/// sampled as well. Measured on the brain at delta 3, where contacts that are open are sampled so:
/// with 1, components with the image's Euler characteristic are 219 of 280, with 1.5 238, with 2.2
/// 237.
const CONTACT_REACH: f64 = 1.5;

/// The same in voxels, at least: the voxels around a contact are to be sampled so, too.
const AROUND_CONTACT: f64 = 0.6;

/// Up to this delta, in smallest sides of a voxel, all contacts are sampled so from the start: it
/// costs 2 % of tets at most, and differences that are found later would take rounds and mending
/// (docs/notes/sampling.md).
const ALL_CONTACTS_UP_TO: f64 = 1.25;

/// Growth of the field per distance.
const GRADING: f64 = 0.4;

/// What coarsening leaves of both: samples are so many thicknesses apart where delta is so many
/// smallest sides of a voxel, an eighth more for each side more, and no grading is asked for.
/// Measured (docs/notes/sampling.md).
const COARSENED_PER_THICKNESS: f64 = 2.35;
const COARSENED_AT: f64 = 3.0;
const COARSENED_PER_SIDE: f64 = 0.29;
const COARSENED_UP_TO: f64 = 6.0;
const COARSENED_GRADING: f64 = 2.0;

/// What sampling by topology leads to where something is thin, in thicknesses. Measured
/// (docs/notes/sampling.md).
const BY_TOPOLOGY_PER_THICKNESS: f64 = 2.0;

/// Growth of the field per distance away from places. Measured on the atlas of the brain at delta
/// 3: with 0.4 the mesh has a tenth more tets, and no fewer differences from the image
/// (docs/notes/sampling.md).
const PLACE_GRADING: f64 = 0.6;

/// Where anything is sampled more densely, nothing is sampled less densely than this, in smallest
/// sides of a voxel: levels would be too far apart to grade by.
const MAX_GRADED: f64 = 64.0;

/// So many places are put into a field between two looks at whether to go on.
const PLACES: usize = 1 << 14;

/// What seems farther away than a place reaches, but by rounding alone, is held, too.
const AS_FAR: f64 = 1.0 + 1e-9;

/// What is rounded is no less than this part of what it was.
const ROUNDED: f64 = 1.0 - 1e-9;

/// Distances that differ by a smaller part are the same: two fields count in different steps.
const SAME: f64 = 0.999;

/// What a field is made for.
#[derive(Debug)]
pub struct Spacing {
    /// How far apart samples are at most.
    pub delta: f64,
    /// The same where the interface bounds a label, for each id.
    of_labels: Vec<f64>,
    /// What is sampled more densely than that.
    adaptive: Adaptive,
    /// No more densely than this times the smallest side of a voxel.
    floor: f64,
    /// Samples of a thin structure are this part of its thickness apart.
    per_thickness: f64,
    /// Growth per distance from there.
    grading: f64,
    /// Whether the image ends with walls.
    has_walls: bool,
}

/// A place about which samples are to be closer than elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Its middle, in voxels of the image.
    pub index: DVec3,
    /// How far apart samples are to be, in world units.
    pub spacing: f64,
    /// It holds the voxels whose centres are so near to its middle, in world units.
    pub radius: f64,
    /// And those so near when distances are counted in voxels.
    pub voxels: f64,
}

impl Place {
    /// That about a contact; `side` is the smallest side of a voxel.
    pub fn about_contact(index: DVec3, spacing: f64, side: f64) -> Self {
        Self { index, spacing, radius: CONTACT_REACH * side, voxels: AROUND_CONTACT }
    }

    /// The layers, numbers y, of a region whose voxels are `spacing` apart that it may reach.
    fn layers(&self, region: &Region, spacing: DVec3) -> Range<usize> {
        let middle = region.offset(self.index).y;
        // One more on both sides: more than rounding.
        let reach = self.voxels.max(self.radius / spacing.y) + 1.0;
        let [from, to] = [middle - reach, middle + reach].map(|y| y.max(0.0) as usize);
        from..to.saturating_add(1).min(region.dims[1])
    }

    /// The voxels that it holds of a layer, number `y`, of a region whose voxels are `spacing`
    /// apart: in each row along x, number z, a run.
    fn voxels_in_layer(
        &self,
        y: usize,
        region: &Region,
        spacing: DVec3,
    ) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
        let (middle, [nx, _, nz]) = (region.offset(self.index), region.dims);
        let [voxels, radius] = [self.voxels, self.radius].map(|reach| AS_FAR * reach);
        // How far the place reaches along an axis, squared, at these squared distances from its
        // middle along the others, in voxels and in world units.
        let left = move |axis: usize, [apart, apart_in_world]: [f64; 2]| {
            let in_world = (radius * radius - apart_in_world) / (spacing[axis] * spacing[axis]);
            in_world.max(voxels * voxels - apart)
        };
        let apart = move |axis: usize, at: usize| {
            let apart = at as f64 - middle[axis];
            [apart * apart, (apart * spacing[axis]) * (apart * spacing[axis])]
        };
        // The numbers that near to the middle, of so many. Where `left` is below 0 its root is NaN,
        // both ends are 0, and there are none.
        let within = move |axis: usize, left: f64, count: usize| {
            let reach = left.sqrt();
            let (low, high) = (middle[axis] - reach, middle[axis] + reach);
            low.ceil().max(0.0) as usize..((high + 1.0).floor().max(0.0) as usize).min(count)
        };
        let of_y = apart(1, y);
        let rows = within(2, left(2, of_y), nz).map(move |z| {
            let of_z = apart(2, z);
            (z, within(0, left(0, [of_y[0] + of_z[0], of_y[1] + of_z[1]]), nx))
        });
        rows.filter(|(_, row)| !row.is_empty())
    }
}

/// About which contacts samples are closer from the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampledContacts {
    /// None: samples are as close without them, or that is not asked for.
    None,
    /// Those [along lines](super::contact_lines).
    AlongLines,
    /// All.
    All,
}

impl Spacing {
    /// What `params` ask for in an image of these labels, background first.
    pub fn new(params: &MeshParams, labels: &[i32]) -> Self {
        let tissues = labels.iter().skip(1).map(|&label| PER_SIZE * params.size_of(label));
        let of_labels: Vec<f64> = std::iter::once(f64::INFINITY).chain(tissues).collect();
        let largest = of_labels.iter().skip(1).copied().fold(0.0, f64::max);
        // Of no label nothing is asked.
        let largest = if largest > 0.0 { largest } else { f64::INFINITY };
        Self {
            delta: params.delta.min(largest),
            of_labels,
            adaptive: params.adaptive,
            floor: params.spacing_floor,
            per_thickness: PER_THICKNESS,
            grading: GRADING,
            has_walls: params.border.has_walls(params.surface),
        }
    }

    /// How far apart samples are in the end, about, where the mesh is coarsened. For estimates.
    pub fn coarsened(params: &MeshParams, image: &LabelImage) -> Self {
        let wanted = Self::new(params, image.labels());
        let sides = wanted.delta / image.frame().spacing().min_element();
        let more = sides.clamp(COARSENED_AT, COARSENED_UP_TO) - COARSENED_AT;
        let per_thickness = COARSENED_PER_THICKNESS + COARSENED_PER_SIDE * more;
        let (adaptive, grading) = (Adaptive::Thickness, COARSENED_GRADING);
        Self { adaptive, per_thickness, grading, ..wanted }
    }

    /// How far apart samples of what is thin are in the end, about, where they follow topology. For
    /// estimates.
    pub fn by_topology(params: &MeshParams, image: &LabelImage) -> Self {
        let (adaptive, per_thickness) = (Adaptive::Thickness, BY_TOPOLOGY_PER_THICKNESS);
        let wanted = Self::new(params, image.labels());
        Self { adaptive, per_thickness, grading: PLACE_GRADING, ..wanted }
    }

    /// How far apart samples of the interface of two labels may be where nothing is thin.
    pub fn between(params: &MeshParams, labels: [i32; 2]) -> f64 {
        let of_labels = labels.into_iter().filter(|&label| label != 0);
        of_labels.fold(params.delta, |delta, label| delta.min(PER_SIZE * params.size_of(label)))
    }

    /// Samples are no closer than this because of what is thin, or of places, and no farther apart
    /// than delta.
    pub fn floor(&self, image: &LabelImage) -> f64 {
        (self.floor * image.frame().spacing().min_element()).min(self.delta)
    }

    /// How far apart samples are to be about contacts.
    pub fn at_contacts(&self, image: &LabelImage) -> f64 {
        (CONTACT_SPACING * image.frame().spacing().min_element()).max(self.floor(image))
    }

    /// About which contacts samples are to be closer than elsewhere from the start.
    pub fn sampled_contacts(&self, image: &LabelImage) -> SampledContacts {
        let [elsewhere, _] = self.lowest(image);
        let all_up_to = ALL_CONTACTS_UP_TO * image.frame().spacing().min_element();
        match self.adaptive {
            _ if self.at_contacts(image) >= elsewhere => SampledContacts::None,
            Adaptive::Off => SampledContacts::None,
            Adaptive::Topology if self.delta > all_up_to => SampledContacts::AlongLines,
            Adaptive::Topology | Adaptive::Thickness => SampledContacts::All,
        }
    }

    /// The smallest value that what is thin, and that what labels are asked for leads to.
    fn lowest(&self, image: &LabelImage) -> [f64; 2] {
        let of_thin = match self.adaptive {
            Adaptive::Thickness => {
                let least = LEAST_OF_THIN * image.frame().spacing().min_element();
                least.min(self.delta).max(self.floor(image))
            }
            Adaptive::Off | Adaptive::Topology => self.delta,
        };
        [of_thin, self.of_labels.iter().copied().fold(self.delta, f64::min)]
    }

    /// The distances that are asked for somewhere; between these others lead from one to the next.
    pub(super) fn asked_for(&self, image: &LabelImage) -> impl Iterator<Item = f64> {
        let [of_thin, _] = self.lowest(image);
        [self.delta, of_thin].into_iter().chain(self.of_labels.iter().copied())
    }
}

/// The distance of samples at each place, and how large tets may be there.
#[derive(Debug)]
pub struct Sizing {
    max: f64,
    scale: Scale,
    table: Option<Table>,
    /// Shared with other fields of the run.
    tets: Arc<TetSizes>,
}

impl Sizing {
    /// The same everywhere, and tets of any size.
    pub fn uniform(delta: f64) -> Self {
        Self::uniform_with(delta, Arc::default())
    }

    fn uniform_with(delta: f64, tets: Arc<TetSizes>) -> Self {
        Self { max: delta, scale: Scale::uniform(delta), table: None, tets }
    }

    /// Delta, and less where the image, the rows of whose region are given, is thin, where labels
    /// or `tets` want it, and about `places`. `check` is called many times in each step, from
    /// several threads.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(
        image: &LabelImage,
        rows: &Rows,
        wanted: &Spacing,
        tets: Arc<TetSizes>,
        places: &[Place],
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let spacing = image.frame().spacing();
        let &Spacing { delta, ref of_labels, .. } = wanted;
        let [of_thin, of_label] = wanted.lowest(image);
        let of_tets = PER_SIZE * tets.min();
        let mut min = of_thin.min(of_label).min(of_tets);
        if places.is_empty() && delta <= min {
            return Ok(Self::uniform_with(delta, tets));
        }
        // The same for any places and for none, so that fields of one run count in the same steps.
        if wanted.adaptive == Adaptive::Topology || !places.is_empty() {
            min = min.min(wanted.floor(image));
        }
        if delta <= min {
            return Ok(Self::uniform_with(delta, tets));
        }
        let thin = if of_thin < delta {
            let max = delta / wanted.per_thickness;
            thin_voxels(image, rows, max, Necks::Thin, wanted.has_walls, check)?
        } else {
            ThinVoxels::none(*rows.region())
        };
        let ThinVoxels { region, thicknesses, of_voxels: mut levels } = thin;
        let [nx, ny, nz] = region.dims;
        let layer = nx * nz;
        let is_even = levels.is_empty() && of_label.min(of_tets) >= delta;
        if is_even && places.is_empty() {
            return Ok(Self::uniform_with(delta, tets));
        }
        let delta = delta.min(MAX_GRADED * spacing.min_element());
        if delta <= min {
            return Ok(Self::uniform_with(min, tets));
        }
        let scale = Scale::between(min, delta);
        // What is not thin has delta.
        if levels.is_empty() {
            levels = filled(layer * ny, LEVELS, "voxels of the sizing field", check)?;
        } else {
            let mut level_of = [LEVELS; NOT_THIN as usize + 1];
            for (level_of, thickness) in level_of.iter_mut().zip(thicknesses) {
                *level_of = scale.level((wanted.per_thickness * thickness).max(of_thin));
            }
            levels.par_iter_mut().for_each(|level| *level = level_of[usize::from(*level)]);
        }
        if of_label < delta {
            let of_id: Vec<u8> = of_labels.iter().map(|&value| scale.level(value)).collect();
            levels.par_chunks_mut(layer).enumerate().for_each(|(j, levels)| {
                for (k, levels) in levels.chunks_mut(nx).enumerate() {
                    for (level, &id) in levels.iter_mut().zip(rows.row(j, k)) {
                        *level = (*level).min(of_id[usize::from(id)]);
                    }
                }
            });
        }
        if of_tets < delta {
            levels.par_chunks_mut(nx).enumerate().for_each(|(row, levels)| {
                for (i, level) in levels.iter_mut().enumerate() {
                    let size = tets.of_voxel([i, row / nz, row % nz]);
                    *level = (*level).min(scale.level(PER_SIZE * size));
                }
            });
        }
        check()?;
        if !is_even {
            // The side of a thin voxel is as much the next one's, and so is that of a label.
            widen(&mut levels, nx, layer);
            grade(&mut levels, [nx, ny, nz], scale.growth(wanted.grading, spacing));
        }
        if !places.is_empty() {
            for places in places.chunks(PLACES) {
                check()?;
                let with_layers = |place: &Place| (*place, place.layers(&region, spacing));
                let places = collected(places.iter().map(with_layers), "places")?;
                levels.par_chunks_mut(layer).enumerate().for_each(|(y, levels)| {
                    for (place, _) in places.iter().filter(|(_, layers)| layers.contains(&y)) {
                        lower(y, levels, &region, spacing, place, scale.level(place.spacing));
                    }
                });
            }
            grade(&mut levels, [nx, ny, nz], scale.growth(PLACE_GRADING, spacing));
        }
        let table = Table::new(image.frame(), &region, &levels)?;
        Ok(Self { max: delta, scale, table: Some(table), tets })
    }

    /// Bytes that [`Self::new`] and [`TetSizes::new`] need at their peak for what `params` ask,
    /// beside the rows, but for some per contact of voxels.
    pub fn bytes_needed(image: &LabelImage, region: &Region, params: &MeshParams) -> u64 {
        let wanted = Spacing::new(params, image.labels());
        let of_tets = TetSizes::bytes_needed(image, region, params);
        let [of_thin, of_label] = wanted.lowest(image);
        let has_places = wanted.adaptive == Adaptive::Topology
            || wanted.sampled_contacts(image) != SampledContacts::None;
        if of_tets == 0 && !has_places && wanted.delta <= of_thin.min(of_label) {
            return 0;
        }
        // The table, twice while it is put into bricks, comes when what finds thin voxels has gone.
        let one = Bricks::new(region.dims).len() as u64;
        let mut own = 2 * one;
        if wanted.delta > of_thin {
            let max = wanted.delta / PER_THICKNESS;
            own = own.max(thickness::bytes_needed(image, region, max));
        }
        if of_tets > 0 { of_tets.max(one + own) } else { own }
    }

    /// The distance of samples at `p`.
    #[inline(always)]
    pub fn at(&self, p: DVec3) -> f64 {
        self.scale.length(self.level(p))
    }

    /// Whether samples are farther apart than a place asks, in a voxel that it holds.
    pub fn is_above(&self, place: &Place) -> bool {
        let Some(table) = &self.table else { return self.max > place.spacing };
        let (grid, level) = (table.grid(), self.scale.level(place.spacing));
        let region = Region { first: grid.first, dims: grid.bricks.dims() };
        place.layers(&region, grid.spacing).any(|y| {
            let mut rows = place.voxels_in_layer(y, &region, grid.spacing);
            rows.any(|(z, mut row)| row.any(|x| table.of_voxel([x, y, z]) > level))
        })
    }

    /// Whether the distance at `p` is less than that of another field.
    #[inline]
    pub fn is_below(&self, other: &Self, p: DVec3) -> bool {
        self.at(p) < SAME * other.at(p)
    }

    /// Adds the blocks in which the distance is somewhere less than that of another field of the
    /// same region.
    pub fn add_below(&self, other: &Self, blocks: &VoxelBlocks) {
        let Some(table) = &self.table else {
            if self.max < ROUNDED * other.max {
                blocks.add_all();
            }
            return;
        };
        let than = other.table.as_ref().map(Table::levels);
        let other_length =
            |at: usize| than.map_or(other.max, |levels| other.scale.length(levels[at]));
        table.bricks().enumerate().for_each(|(brick, levels)| {
            let first = Bricks::VOLUME * brick;
            // Mostly nothing has changed.
            if self.scale == other.scale
                && than.is_some_and(|than| &than[first..][..Bricks::VOLUME] == levels)
            {
                return;
            }
            // By any difference but rounding: rules ask for the exact distance.
            let is_below =
                |n: &usize| self.scale.length(levels[*n]) < ROUNDED * other_length(first + n);
            let mut below = (0..levels.len()).filter(is_below);
            if let Some(voxel) = below.find_map(|n| table.voxel(first + n)) {
                blocks.add_voxel(voxel);
            }
        });
    }

    /// The distance of samples in each cell of the oracle that is made from the same image.
    pub fn palette(&self) -> Palette<'_, f64> {
        match &self.table {
            Some(table) => Palette::of_levels(self.levels().collect(), table.levels()),
            None => Palette::uniform(self.max),
        }
    }

    /// Which of the table's levels the distance at `p` is: to be kept with a place, so that it need
    /// not be looked up again.
    #[inline(always)]
    pub fn level(&self, p: DVec3) -> u8 {
        self.table.as_ref().map_or(0, |table| table.at(p))
    }

    /// The distance of samples at each level.
    pub fn levels(&self) -> impl Iterator<Item = f64> {
        let count = if self.table.is_some() { LEVELS } else { 0 };
        (0..=count).map(|level| self.scale.length(level))
    }

    /// The level of a voxel of the region.
    #[inline]
    pub fn level_of_voxel(&self, voxel: [usize; 3]) -> u8 {
        self.table.as_ref().map_or(0, |table| table.of_voxel(voxel))
    }

    /// The sum of the distances at `count` places, by the sum of their levels.
    #[inline(always)]
    pub fn sum(&self, count: u32, levels: u32) -> f64 {
        self.scale.min * f64::from(count) + self.scale.step * f64::from(levels)
    }

    /// The level of a distance of samples.
    pub(super) fn level_of(&self, length: f64) -> u8 {
        self.scale.level(length)
    }

    /// No place has less.
    pub fn min(&self) -> f64 {
        self.scale.min
    }

    /// No place has more.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// How large tets may be at each place, beside what is asked of their labels.
    pub fn tets(&self) -> &Arc<TetSizes> {
        &self.tets
    }

    /// How far apart samples of the interface of two labels may be at `p`, where nothing is thin.
    pub fn largest_between(&self, params: &MeshParams, labels: [i32; 2], p: DVec3) -> f64 {
        Spacing::between(params, labels).min(PER_SIZE * self.tets.at(p))
    }

    /// The least that [`Self::largest_between`] says anywhere, for interfaces of these labels.
    pub fn least_between(&self, params: &MeshParams, labels: &[i32]) -> f64 {
        let of_labels = labels.iter().map(|&label| Spacing::between(params, [label, 0]));
        of_labels.fold(PER_SIZE * self.tets.min(), f64::min)
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.table.as_ref().map_or(0, |table| table.levels().len()) + self.tets.bytes()
    }
}

/// Lowers the levels of a layer of a region's voxels, number `y`, within a place to `level`.
fn lower(y: usize, levels: &mut [u8], region: &Region, spacing: DVec3, place: &Place, level: u8) {
    let nx = region.dims[0];
    place.voxels_in_layer(y, region, spacing).for_each(|(z, row)| {
        levels[nx * z..][..nx][row].iter_mut().for_each(|at| *at = (*at).min(level));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// As the definition of a place has it, but for voxels on its border.
        #[test]
        fn places_lower_the_voxels_that_they_hold(
            index in prop::array::uniform3(-2.0..12.0_f64),
            spacing in prop::array::uniform3(0.3..3.0_f64),
            radius in 0.0..9.0_f64,
            voxels in 0.3..2.0_f64,
        ) {
            let dims = [7, 6, 8];
            let region = Region { first: [1, 2, -1], dims };
            let (index, spacing) = (DVec3::from(index), DVec3::from(spacing));
            let place = Place { index, spacing: 1.0, radius, voxels };
            let [nx, ny, nz] = dims;
            let mut levels = vec![9; nx * ny * nz];
            levels.chunks_mut(nx * nz).enumerate().for_each(|(y, levels)| {
                lower(y, levels, &region, spacing, &place, 4);
            });
            let layers = place.layers(&region, spacing);
            for (at, level) in levels.into_iter().enumerate() {
                let [x, y, z] = [at % nx, at / (nx * nz), at / nx % nz];
                prop_assert!(level == 9 || layers.contains(&y));
                let first = DVec3::from(region.first.map(|c| c as f64));
                let apart = first + DVec3::from([x, y, z].map(|c| c as f64)) - index;
                let beyond = [apart.length() - voxels, (apart * spacing).length() - radius];
                if beyond.iter().all(|by| by.abs() > 1e-6) {
                    prop_assert_eq!(level == 4, beyond.iter().any(|&by| by < 0.0));
                }
            }
        }
    }

    #[test]
    fn samples_are_above_a_place_until_it_is_there() {
        let frame = crate::image::Frame::axis_aligned([1.0, 1.5, 0.8]).unwrap();
        let image = LabelImage::from_fn([9, 8, 12], frame, |_| 1).unwrap();
        let go_on = || Ok(());
        let rows = Rows::new(&image, Region::new(&image, &go_on).unwrap(), &go_on).unwrap();
        let params =
            MeshParams { delta: 6.0, adaptive: Adaptive::Topology, ..MeshParams::default() };
        let wanted = Spacing::new(&params, image.labels());
        let place = |radius: f64| {
            let index = DVec3::new(4.3, 3.6, 5.5);
            Place { index, spacing: 0.5, radius, voxels: 0.87 }
        };
        let with = |places: &[Place]| {
            Sizing::new(&image, &rows, &wanted, Arc::default(), places, &go_on).unwrap()
        };
        assert!(with(&[]).is_above(&place(1.0)));
        for radius in [0.1, 1.0, 2.0, 3.0] {
            let sizing = with(&[place(radius)]);
            assert!(!sizing.is_above(&place(radius)), "radius {radius}");
            assert!(sizing.is_above(&place(radius + 1.0)), "radius {radius}");
        }
    }

    #[test]
    fn contacts_are_sampled_from_the_start_where_that_costs_little() {
        use SampledContacts::{All, AlongLines, None};
        let side = 0.8;
        let frame = crate::image::Frame::axis_aligned([side, 1.5, 1.0]).unwrap();
        let image = LabelImage::from_fn([3; 3], frame, |_| 1).unwrap();
        let cases = [
            (Adaptive::Topology, [(0.7, None), (1.0, All), (1.2, All), (1.3, AlongLines)]),
            (Adaptive::Thickness, [(0.7, None), (1.0, All), (1.3, All), (6.0, All)]),
            (Adaptive::Off, [(0.7, None), (1.0, None), (1.3, None), (6.0, None)]),
        ];
        for (adaptive, of_deltas) in cases {
            for (sides, expected) in of_deltas {
                let params = MeshParams { delta: sides * side, adaptive, ..MeshParams::default() };
                let sampled = Spacing::new(&params, image.labels()).sampled_contacts(&image);
                assert_eq!(sampled, expected, "{adaptive:?}, delta of {sides} voxels");
            }
        }
    }

    #[test]
    fn places_hold_voxels_on_their_border() {
        let region = Region { first: [0; 3], dims: [5; 3] };
        for side in [0.1, 0.3, 0.7, 0.937, 1.1] {
            let index = DVec3::splat(2.0);
            let place = Place { index, spacing: 1.0, radius: 2.0 * side, voxels: 0.5 };
            let mut levels = [9; 125];
            levels.chunks_mut(25).enumerate().for_each(|(y, levels)| {
                lower(y, levels, &region, DVec3::splat(side), &place, 4);
            });
            // The middle, 6, 12, 8 and 6 voxels at squared distances of 0, 1, 2, 3 and 4.
            assert_eq!(levels.iter().filter(|&&level| level == 4).count(), 33, "side {side}");
        }
    }
}
