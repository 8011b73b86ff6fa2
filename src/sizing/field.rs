//! The sizing field: how far apart samples of dO are to be, from place to place.
//!
//! Where nothing is thin that is delta, but no more than a part of the largest circumradius that
//! tets there may have (`PER_SIZE`): such tets need vertices nearer to the interface than its
//! samples are to each other, and rule R6 would remove what rule R5 inserts.
//!
//! A structure of thickness t (`sizing/thickness`) wants samples `PER_THICKNESS` t apart on both of
//! its sides: farther apart, the tets between its sides reach out of it, and it tears. Away from
//! there the field grows by no more than `GRADING` per unit of distance (along the image axes one
//! after the other), so that elements grow smoothly. What is thin never takes it below the floor.
//!
//! Places ([`Place`]) where the mesh must come closer to the image make it small as well, whatever
//! is thin there. From these the field grows faster: they are small, and may be many.
//!
//! It is kept for each voxel of the region, in a byte, and constant within a voxel. Where nothing
//! makes it small there is no table, and every answer is delta.
//!
//! Cost: a few nanoseconds per voxel; a question is one load. Memory: a byte per voxel of the
//! region, when there is a table.

use glam::DVec3;
use rayon::prelude::*;

use super::thickness::{self, NOT_THIN, ThinVoxels, thin_voxels};
use crate::Result;
use crate::image::bricks::Bricks;
use crate::image::region::{Region, Rows};
use crate::image::{Grid, LabelImage, Palette};
use crate::memory::{filled, zeroed};
use crate::params::{Adaptive, MeshParams};

/// Samples of a thin structure are this part of its thickness apart.
const PER_THICKNESS: f64 = 0.75;

/// Samples beside tets of a largest circumradius are this part of it apart, or less. Measured
/// (docs/notes/design-notes.md): with 1 a fifth of what R5 inserts is removed again, with 0.7
/// nothing is, and the mesh has as many tets.
const PER_SIZE: f64 = 0.7;

/// Growth of the field per distance.
const GRADING: f64 = 0.4;

/// The same away from places. Measured on the atlas of the brain at delta 3: with 0.4 the mesh has
/// a tenth more tets, and no fewer differences from the image (docs/notes/sampling.md).
const PLACE_GRADING: f64 = 0.6;

/// Distances that differ by a smaller part are the same: two fields count in different steps.
const SAME: f64 = 0.999;

/// Levels between the floor and delta.
const LEVELS: u8 = u8::MAX;

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
        }
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

    /// The smallest value that what is thin, and that what labels are asked for leads to.
    fn lowest(&self, image: &LabelImage) -> [f64; 2] {
        let of_thin = match self.adaptive {
            Adaptive::Thickness => self.floor(image),
            Adaptive::Off | Adaptive::Topology => self.delta,
        };
        [of_thin, self.of_labels.iter().copied().fold(self.delta, f64::min)]
    }
}

/// The distance of samples at each place.
#[derive(Debug)]
pub struct Sizing {
    max: f64,
    min: f64,
    /// What each level adds to the smallest; 0 without a table.
    step: f64,
    field: Option<Field>,
}

#[derive(Debug)]
struct Field {
    grid: Grid,
    /// The field, from `min` on in steps, in bricks of one cache line: who asks about one place
    /// asks about others nearby.
    levels: Vec<u8>,
}

impl Sizing {
    /// The same everywhere.
    pub fn uniform(delta: f64) -> Self {
        Self { max: delta, min: delta, step: 0.0, field: None }
    }

    /// Delta, and less where the image, the rows of whose region are given, is thin, where labels
    /// want it, and about `places`. `check` is called many times in each step, from several
    /// threads.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(
        image: &LabelImage,
        rows: &Rows,
        wanted: &Spacing,
        places: &[Place],
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let spacing = image.frame().spacing();
        let &Spacing { delta, ref of_labels, .. } = wanted;
        let [of_thin, of_label] = wanted.lowest(image);
        // The same for any places, so that fields of one run count in the same steps.
        let of_places = if places.is_empty() { delta } else { wanted.floor(image) };
        let min = of_thin.min(of_label).min(of_places);
        if delta <= min {
            return Ok(Self::uniform(delta));
        }
        let thin = if of_thin < delta {
            thin_voxels(image, rows, delta / PER_THICKNESS, check)?
        } else {
            ThinVoxels::none(*rows.region())
        };
        let ThinVoxels { region, thicknesses, of_voxels: mut levels } = thin;
        let [nx, ny, nz] = region.dims;
        let layer = nx * nz;
        if levels.is_empty() {
            if of_label.min(of_places) >= delta {
                return Ok(Self::uniform(delta));
            }
            levels = filled(layer * ny, NOT_THIN, "voxels of the sizing field", check)?;
        }
        let step = (delta - min) / f64::from(LEVELS);
        let level = |value: f64| ((value - min) / step).clamp(0.0, f64::from(LEVELS)) as u8;
        // What is not thin has delta.
        let mut level_of = [LEVELS; NOT_THIN as usize + 1];
        for (level_of, thickness) in level_of.iter_mut().zip(thicknesses) {
            *level_of = level((PER_THICKNESS * thickness).max(of_thin));
        }
        levels.par_iter_mut().for_each(|level| *level = level_of[usize::from(*level)]);
        if of_label < delta {
            let of_id: Vec<u8> = of_labels.iter().map(|&value| level(value)).collect();
            levels.par_chunks_mut(layer).enumerate().for_each(|(j, levels)| {
                for (k, levels) in levels.chunks_mut(nx).enumerate() {
                    for (level, &id) in levels.iter_mut().zip(rows.row(j, k)) {
                        *level = (*level).min(of_id[usize::from(id)]);
                    }
                }
            });
        }
        // The side of a thin voxel is as much the next one's, and so is that of a label.
        widen(&mut levels, nx, layer);
        let growth = |grading: f64| {
            [0, 1, 2].map(|a| (grading * spacing[a] / step).clamp(1.0, f64::from(LEVELS)) as u8)
        };
        if of_thin.min(of_label) < delta {
            grade(&mut levels, [nx, ny, nz], growth(GRADING));
        }
        if !places.is_empty() {
            for place in places {
                lower(&mut levels, &region, spacing, place, level(place.spacing));
            }
            check()?;
            grade(&mut levels, [nx, ny, nz], growth(PLACE_GRADING));
        }
        let grid = Grid::new(image.frame(), &region);
        let levels = in_bricks(&levels, &grid.bricks)?;
        let field = Field { grid, levels };
        Ok(Self { max: delta, min, step, field: Some(field) })
    }

    /// Bytes that [`Self::new`] needs at its peak, beside the rows, but for some per contact of
    /// voxels.
    pub fn bytes_needed(image: &LabelImage, region: &Region, wanted: &Spacing) -> u64 {
        let [of_thin, of_label] = wanted.lowest(image);
        let has_places = wanted.adaptive == Adaptive::Topology;
        if !has_places && wanted.delta <= of_thin.min(of_label) {
            return 0;
        }
        // The table, twice while it is put into bricks, comes when what finds thin voxels has gone.
        let table = 2 * Bricks::new(region.dims).len() as u64;
        if wanted.delta <= of_thin {
            return table;
        }
        table.max(thickness::bytes_needed(image, region, wanted.delta / PER_THICKNESS))
    }

    /// The distance of samples at `p`.
    #[inline(always)]
    pub fn at(&self, p: DVec3) -> f64 {
        self.min + self.step * f64::from(self.level(p))
    }

    /// Whether the distance at `p` is less than that of another field.
    #[inline]
    pub fn is_below(&self, other: &Self, p: DVec3) -> bool {
        self.at(p) < SAME * other.at(p)
    }

    /// The distance of samples in each cell of the oracle that is made from the same image.
    pub fn palette(&self) -> Palette<'_, f64> {
        match &self.field {
            Some(field) => Palette::of_levels(self.levels().collect(), &field.levels),
            None => Palette::uniform(self.max),
        }
    }

    /// Which of the table's levels the distance at `p` is: to be kept with a place, so that it need
    /// not be looked up again.
    #[inline(always)]
    pub fn level(&self, p: DVec3) -> u8 {
        self.field.as_ref().map_or(0, |field| field.level(p))
    }

    /// The distance of samples at each level.
    pub fn levels(&self) -> impl Iterator<Item = f64> {
        let count = if self.field.is_some() { LEVELS } else { 0 };
        (0..=count).map(|level| self.min + self.step * f64::from(level))
    }

    /// The level of a voxel of the region.
    #[inline]
    pub fn level_of_voxel(&self, [i, j, k]: [usize; 3]) -> u8 {
        self.field.as_ref().map_or(0, |field| field.levels[field.grid.bricks.index(i, j, k)])
    }

    /// The sum of the distances at `count` places, by the sum of their levels.
    #[inline(always)]
    pub fn sum(&self, count: u32, levels: u32) -> f64 {
        self.min * f64::from(count) + self.step * f64::from(levels)
    }

    /// No place has less.
    pub fn min(&self) -> f64 {
        self.min
    }

    /// No place has more.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.field.as_ref().map_or(0, |field| field.levels.len())
    }
}

impl Field {
    #[inline(always)]
    fn level(&self, p: DVec3) -> u8 {
        // Outside of the region there is nothing to sample; NaN falls to 0.
        let [i, j, k] = self.grid.voxel(self.grid.inside(self.grid.index_at(p)));
        self.levels[self.grid.bricks.index(i, j, k)]
    }
}

/// Levels of rows, x fastest, then z, then y, in bricks.
fn in_bricks(levels: &[u8], bricks: &Bricks) -> Result<Vec<u8>> {
    let [nx, ny, nz] = bricks.dims();
    let mut placed = zeroed(bricks.len(), "voxels of the sizing field")?;
    placed.par_chunks_mut(bricks.layer()).enumerate().for_each(|(n, placed)| {
        for y in (n * Bricks::EDGE..ny).take(Bricks::EDGE) {
            for z in 0..nz {
                let row = &levels[nx * (z + nz * y)..][..nx];
                let at = bricks.index(0, y, z) - n * bricks.layer();
                for (x, along_x) in row.chunks(Bricks::EDGE).enumerate() {
                    placed[at + bricks.x(x * Bricks::EDGE)..][..along_x.len()]
                        .copy_from_slice(along_x);
                }
            }
        }
    });
    Ok(placed)
}

/// Lowers the levels of a region's voxels within a place to `level`.
fn lower(levels: &mut [u8], region: &Region, spacing: DVec3, place: &Place, level: u8) {
    let [nx, ny, nz] = region.dims;
    let middle = place.index - DVec3::from(region.first.map(|c| c as f64));
    let reach = (place.radius / spacing).max(DVec3::splat(place.voxels));
    let last = DVec3::from([nx, ny, nz].map(|n| (n - 1) as f64));
    let low = (middle - reach).ceil().max(DVec3::ZERO);
    let high = (middle + reach).floor().min(last);
    if !low.cmple(high).all() {
        return;
    }
    let range = |a: usize| low[a] as usize..=high[a] as usize;
    for y in range(1) {
        for z in range(2) {
            for x in range(0) {
                let apart = DVec3::from([x, y, z].map(|c| c as f64)) - middle;
                if apart.length() <= place.voxels || (apart * spacing).length() <= place.radius {
                    let at = &mut levels[x + nx * (z + nz * y)];
                    *at = (*at).min(level);
                }
            }
        }
    }
}

/// Gives each voxel the least level of the 27 around it.
fn widen(levels: &mut [u8], row: usize, layer: usize) {
    levels.par_chunks_mut(layer).for_each(|layer| {
        let mut rows: Vec<&mut [u8]> = layer.chunks_mut(row).collect();
        for row in &mut rows {
            let mut before = LEVELS;
            for x in 0..row.len() {
                let (here, after) = (row[x], row.get(x + 1).copied().unwrap_or(LEVELS));
                row[x] = before.min(here).min(after);
                before = here;
            }
        }
        min_of_three(&mut rows);
    });
    across_layers(levels, layer, min_of_three);
}

/// Lowers levels until none is above a neighbour's by more than the growth along that axis: along
/// x, along z and along y, each to and fro, which is exact for distances along the axes.
pub(super) fn grade(levels: &mut [u8], [nx, _, nz]: [usize; 3], growth: [u8; 3]) {
    let layer = nx * nz;
    levels.par_chunks_mut(layer).for_each(|layer| {
        let mut rows: Vec<&mut [u8]> = layer.chunks_mut(nx).collect();
        for row in &mut rows {
            let lower = |before: u8, level: &mut u8| {
                *level = (*level).min(before.saturating_add(growth[0]));
                *level
            };
            row.iter_mut().fold(LEVELS, lower);
            row.iter_mut().rev().fold(LEVELS, lower);
        }
        sweep(&mut rows, growth[2]);
    });
    across_layers(levels, layer, |parts| sweep(parts, growth[1]));
}

/// Does something with the parts that lie above each other in all layers, for parts that fit into a
/// cache, in parallel.
fn across_layers(levels: &mut [u8], layer: usize, work: impl Fn(&mut [&mut [u8]]) + Sync) {
    const PART: usize = 1 << 11;
    let mut columns: Vec<Vec<&mut [u8]>> = (0..layer.div_ceil(PART)).map(|_| Vec::new()).collect();
    for layer in levels.chunks_mut(layer) {
        columns.iter_mut().zip(layer.chunks_mut(PART)).for_each(|(column, part)| column.push(part));
    }
    columns.par_iter_mut().for_each(|column| work(column));
}

/// Gives each element the least of itself and those at its place in the rows before and behind.
fn min_of_three(rows: &mut [&mut [u8]]) {
    let min = |to: &mut [u8], from: &[u8]| {
        to.iter_mut().zip(from).for_each(|(to, &from)| *to = (*to).min(from))
    };
    let (mut before, mut here) = (Vec::new(), Vec::new());
    for at in 0..rows.len() {
        let (own, behind) = rows[at..].split_at_mut(1);
        here.clear();
        here.extend_from_slice(own[0]);
        min(own[0], &before);
        if let Some(behind) = behind.first() {
            min(own[0], behind);
        }
        std::mem::swap(&mut before, &mut here);
    }
}

/// Lets no element be above the one at its place in the row before, or behind, by more than
/// `growth`.
fn sweep(rows: &mut [&mut [u8]], growth: u8) {
    let lower = |to: &mut [u8], from: &[u8]| {
        to.iter_mut()
            .zip(from)
            .for_each(|(to, &from)| *to = (*to).min(from.saturating_add(growth)));
    };
    for at in 1..rows.len() {
        let (before, behind) = rows.split_at_mut(at);
        lower(behind[0], before[at - 1]);
    }
    for at in (1..rows.len()).rev() {
        let (before, behind) = rows.split_at_mut(at);
        lower(before[at - 1], behind[0]);
    }
}
