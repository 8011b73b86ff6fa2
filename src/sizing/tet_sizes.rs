//! How large tets may be, from place to place: as many of them across each layer as are asked for.
//!
//! A part of a label is t thick (`sizing/thickness`), and N elements are to lie across it. Then the
//! edges of its tets are to be t / N long on average. So their circumradii are at most `PER_EDGE`
//! of that, but never bound to less than the least size, or than the floor of spacing allows.
//!
//! Away from there the bound grows by the gradation per distance, along the image axes one after
//! the other; by a level per voxel at least, for levels are whole numbers. What it has grown to
//! above 32 voxels is no bound any more. The background has no tets that count, so it wants
//! nothing. Nor do contacts of two voxels, which are no layers.
//!
//! Thicknesses are those of cubes: between two cubes of the list the smaller one counts, and in a
//! layer across a diagonal a cube is smaller than the layer is thick. So N is what there is at
//! least; in slanted layers there may be 1.7 times as many.
//!
//! What SimNIBS calls the slope and the range of element sizes (Puonti et al., "Accurate and robust
//! whole-head segmentation from magnetic resonance images for individualized head modeling", 2020)
//! is 1 / N, and the least and the largest size.
//!
//! Bounds of labels hold beside these. Samples of interfaces follow: `sizing/field`.
//!
//! Cost: that of finding what is thin, and a few nanoseconds per voxel. Memory: a byte per voxel,
//! twice while it is made.

use glam::DVec3;
use rayon::prelude::*;

use super::levels::{LEVELS, Scale, Table, grade};
use super::thickness::{self, LARGEST, NOT_THIN, Necks, ThinVoxels, thin_voxels};
use crate::Result;
use crate::image::LabelImage;
use crate::image::bricks::Bricks;
use crate::image::region::{Region, Rows};
use crate::memory::room;
use crate::params::MeshParams;

/// Samples beside tets of a largest circumradius are this part of it apart, or less. Measured
/// (docs/notes/design-notes.md): with 1 a fifth of what R5 inserts is removed again, with 0.7
/// nothing is, and the mesh has as many tets.
pub(super) const PER_SIZE: f64 = 0.7;

/// Tets have circumradii of at most this times the length that their edges have on average.
/// Measured on sheets of 2 to 8 voxels with 2 to 4 elements across (docs/notes/design-notes.md).
const PER_EDGE: f64 = 0.85;

/// The field goes up to so many times the least size, if that is more than 32 voxels. Above, tets
/// are bounded by the sizes of their labels alone.
const FAR_ABOVE: f64 = 4.0;

/// The largest circumradius that thickness allows at each place; none without a table.
#[derive(Debug, Default)]
pub struct TetSizes {
    field: Option<(Scale, Table)>,
    /// How many cubes of these sizes fill the voxels of labels where thickness bounds them.
    cubes: f64,
}

/// What is asked for.
struct Wanted {
    across: f64,
    /// The least and the largest bound.
    range: [f64; 2],
    gradation: f64,
}

impl Wanted {
    /// `None` where nothing is asked for, or where it changes nothing.
    fn new(image: &LabelImage, params: &MeshParams) -> Option<Self> {
        let across = params.across?;
        let side = image.frame().spacing().min_element();
        let least = params.least_size.max(params.spacing_floor * side / PER_SIZE);
        let sizes = image.labels().iter().filter(|&&label| label != 0);
        let sizes = sizes.map(|&label| params.size_of(label)).fold(0.0, f64::max);
        // Nothing thicker than the largest cube is looked for, so no layer wants a bound above it;
        // nor above so many times its size where less than one element is to lie across.
        let farthest = LARGEST as f64 * side * (PER_EDGE / across).max(1.0);
        let largest = sizes.min(farthest.max(FAR_ABOVE * least));
        let gradation = params.gradation;
        (least < largest).then_some(Self { across, range: [least, largest], gradation })
    }

    /// What is thicker wants no smaller tets.
    fn max_thickness(&self) -> f64 {
        self.range[1] / self.per_thickness()
    }

    /// The bound over the thickness.
    fn per_thickness(&self) -> f64 {
        PER_EDGE / self.across
    }
}

impl TetSizes {
    /// Of the image whose rows are given. `check` is called many times, from several threads.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(
        image: &LabelImage,
        rows: &Rows,
        params: &MeshParams,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let Some(wanted) = Wanted::new(image, params) else { return Ok(Self::default()) };
        // Walls matter to background alone, which asks for nothing.
        let thin = thin_voxels(image, rows, wanted.max_thickness(), Necks::Ignored, false, check)?;
        let ThinVoxels { region, thicknesses, of_voxels: mut levels } = thin;
        let thinnest =
            levels.par_iter().min().and_then(|&least| thicknesses.get(usize::from(least)));
        let Some(thinnest) = thinnest else { return Ok(Self::default()) };
        let [nx, _, nz] = region.dims;
        // From what there is, not from what there might be: steps would be coarser.
        let min = wanted.range[0].max(wanted.per_thickness() * thinnest);
        if min >= wanted.range[1] {
            return Ok(Self::default());
        }
        let scale = Scale::between(min, wanted.range[1]);
        let mut level_of = [LEVELS; NOT_THIN as usize + 1];
        for (level_of, thickness) in level_of.iter_mut().zip(thicknesses) {
            *level_of = scale.level(wanted.per_thickness() * thickness);
        }
        levels.par_chunks_mut(nx).enumerate().for_each(|(row, levels)| {
            for (level, &id) in levels.iter_mut().zip(rows.row(row / nz, row % nz)) {
                *level = if id == 0 { LEVELS } else { level_of[usize::from(*level)] };
            }
        });
        check()?;
        if levels.par_iter().all(|&level| level == LEVELS) {
            return Ok(Self::default());
        }
        let growth = scale.growth(wanted.gradation, image.frame().spacing());
        grade(&mut levels, region.dims, growth);
        check()?;
        let per_voxel = |level| image.voxel_volume() * of_level(&scale, level).powi(-3);
        let per_voxel: Vec<f64> = (0..=LEVELS).map(per_voxel).collect();
        let of_row = |(row, levels): (usize, &[u8])| {
            let voxels = levels.iter().zip(rows.row(row / nz, row % nz));
            voxels.filter(|&(_, &id)| id != 0).map(|(&l, _)| per_voxel[usize::from(l)]).sum::<f64>()
        };
        // In order, so that the sum is the same in each run.
        let mut of_rows = room(levels.len() / nx, "rows of the sizes of tets")?;
        levels.par_chunks(nx).enumerate().map(of_row).collect_into_vec(&mut of_rows);
        let cubes = of_rows.into_iter().sum();
        check()?;
        let table = Table::new(image.frame(), &region, &levels)?;
        Ok(Self { field: Some((scale, table)), cubes })
    }

    /// How many cubes of these sizes fill the voxels of labels where thickness bounds them.
    pub fn cubes(&self) -> f64 {
        self.cubes
    }

    /// Bytes that [`Self::new`] needs at its peak, beside the rows.
    pub fn bytes_needed(image: &LabelImage, region: &Region, params: &MeshParams) -> u64 {
        Wanted::new(image, params).map_or(0, |wanted| {
            let table = 2 * Bricks::new(region.dims).len() as u64;
            table.max(thickness::bytes_needed(image, region, wanted.max_thickness()))
        })
    }

    /// The largest circumradius of tets at `p`; infinite where nothing is asked for.
    #[inline]
    pub fn at(&self, p: DVec3) -> f64 {
        self.field.as_ref().map_or(f64::INFINITY, |(scale, table)| of_level(scale, table.at(p)))
    }

    /// That of a voxel of the region.
    #[inline]
    pub fn of_voxel(&self, voxel: [usize; 3]) -> f64 {
        let of_voxel = |(scale, table): &(Scale, Table)| of_level(scale, table.of_voxel(voxel));
        self.field.as_ref().map_or(f64::INFINITY, of_voxel)
    }

    /// No place has less.
    pub fn min(&self) -> f64 {
        self.field.as_ref().map_or(f64::INFINITY, |(scale, _)| scale.min)
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.field.as_ref().map_or(0, |(_, table)| table.levels().len())
    }
}

/// The last level is no bound.
#[inline]
fn of_level(scale: &Scale, level: u8) -> f64 {
    if level == LEVELS { f64::INFINITY } else { scale.length(level) }
}
