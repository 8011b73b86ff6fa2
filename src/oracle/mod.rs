//! The isosurface oracle: what label a point has, how far it is from all interfaces at least, where
//! a segment crosses one. Knows no mesh.
//!
//! The isosurface dO is where the label changes; everything outside the image's grid is background.
//! The oracle keeps the **region**: the bounding box of the object and one voxel more on each side,
//! so its outermost voxels are background and no query needs a special case at the border of the
//! image. It works in region coordinates: continuous indices whose origin is the region's first
//! voxel centre. World distances there are those of the spacing, because image axes are
//! orthonormal.
//!
//! **Cells** are the cubes between eight voxel centres; a cell is *mixed* when its corners have
//! several labels. In both surface models dO lies in the mixed cells:
//! - Smooth model: in a cell of one label all other indicators are 0. Between the outermost voxel
//!   centres and a wall (see `border`) a point has the label of its projection onto the face of its
//!   cell; beyond the wall are background corners, so the cell is mixed unless that face is
//!   background. With other values than indicators (see `field`) likewise: a cell whose corners
//!   have one label has it everywhere.
//! - Voxel model: a point of dO is on the common face of two voxels of different labels, and every
//!   cell that holds a part of this face has both centres as corners.
//!
//! **The distance bound** is a lower bound of the distance to dO.
//! - In a mixed cell it is 0.
//! - A uniform cell has one ring or more of cells of one label around it, counted up to three (see
//!   `cells`), and dO is no nearer than the faces of that block.
//! - For p outside the region, with q its nearest point in the region's box, which is convex and
//!   holds dO: the squared distance is at least |p - q|^2 + distance bound(q)^2.
//!
//! **Volumes.** The smooth model without weights loses volume where interfaces are convex, about
//! h^2/12 per unit of area and curvature (h here the spacing); the weights restore that of each
//! label, see `weights`. Single voxels stay single voxels: the label at a voxel's centre is its
//! own, whatever the weights, because all other indicators are 0 there. On the edge between two
//! voxels the change of label lies at a part from 1/(1 + W) to W/(1 + W) of it. A flat interface
//! between two labels moves by about a quarter of the logarithm of their ratio, in voxels.
//!
//! The oracle is immutable and `Sync`. Memory: a little more than 4 bytes per voxel of the region;
//! 8 with intensities, probabilities or smoothed labels.

mod features;
mod model;
mod query;

use glam::DVec3;

pub use features::edges::{BrickRow, CrossedEdge, EdgeGrid, FeaturePoint};
pub use features::junctions::{JunctionKind, JunctionPlanes};
pub use features::tiles::Tiles;
pub use features::walls::Walls;
use model::border::Border;
use model::cells::Cells;
use model::field::Field;
use model::voxel::{self, Pairs, Records, Voxel};
use model::weights::Sampling;

use crate::Result;
use crate::image::bricks::Bricks;
use crate::image::region::{Region, Rows};
use crate::image::{Grid, LabelImage};
use crate::params::{ImageBorder, SurfaceModel};

/// What dO is, beside the image.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surface {
    /// How labels between voxel centres are decided.
    pub model: SurfaceModel,
    /// How the object is closed at the border of the image.
    pub border: ImageBorder,
    /// In the smooth model of a segmentation: the standard deviation, in voxels, of the Gaussian
    /// that the indicators are convolved with first.
    pub sigma: Option<f64>,
}

impl From<SurfaceModel> for Surface {
    fn from(model: SurfaceModel) -> Self {
        Self { model, ..Self::default() }
    }
}

/// Answers questions about the isosurface. Built once from an image; points are in world
/// coordinates.
#[derive(Clone, Debug)]
pub struct Oracle {
    model: SurfaceModel,
    /// The region.
    grid: Grid,
    /// Where the smooth model ends.
    border: Border,
    /// Where the image cuts the object off: in the smooth model the same.
    walls: Border,
    /// The voxels of the region, in the bricked layout.
    voxels: Vec<Voxel>,
    /// The mixed cells that can have points of junctions; with a field only those that walls halve.
    junction_cells: Cells,
    /// What the smooth model interpolates where that is not the indicators of labels. Then no
    /// record says that a cell has two labels, which leaves mixed cells to the field.
    field: Option<Field>,
    /// Whether the field is that of smoothed labels.
    is_smoothed: bool,
    /// Weight of each dense id in the smooth model; empty in the voxel model, and with a field.
    weights: Vec<f32>,
    /// The largest weight.
    max_weight: f32,
}

/// A point where a segment crosses dO.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// World position; within a thousandth of a voxel of a change of label on the segment.
    pub point: DVec3,
    /// Dense id before the point.
    pub from: u16,
    /// Dense id past the point.
    pub to: u16,
}

impl Oracle {
    /// Builds the oracle, on all threads of the current rayon pool. `check` is called at least once
    /// per plane of voxels and pass, from several threads; its error ends the computation.
    ///
    /// # Errors
    /// [`crate::Error::EmptyImage`] when no voxel differs from the background;
    /// [`crate::Error::InvalidArgument`] when the object's bounding box has 2^32 voxels or more, or
    /// indicators are to be smoothed that intensities or probabilities give;
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(
        image: &LabelImage,
        surface: impl Into<Surface>,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let rows = Rows::new(image, Region::new(image, check)?, check)?;
        Self::of_rows(image, &rows, surface.into(), check)
    }

    /// As [`Self::new`], by a caller who has the rows of the image's region.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn of_rows(
        image: &LabelImage,
        rows: &Rows,
        surface: Surface,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let &Region { first, dims } = rows.region();
        let mixed = Cells::mixed(rows, check)?;
        let Surface { model, border, sigma } = surface;
        let walls = if border.has_walls(model) {
            Border::new(first, dims, image.dims())
        } else {
            Border::none(dims)
        };
        let has_field = image.field().is_some() || sigma.is_some();
        let sampling;
        let records = |pairs| voxel::records(rows, mixed, &walls, pairs, check);
        let (border, Records { voxels, junction_cells, .. }, weights, field) = match model {
            SurfaceModel::Smooth if has_field => {
                let records = records(Pairs::Unmarked)?;
                let field = Field::new(image, sigma, rows.region(), &records.voxels, check)?;
                (walls, records, Vec::new(), field)
            }
            SurfaceModel::Smooth => {
                sampling = Sampling::new(rows.rough_counts(image.labels().len()).into_iter());
                let mut records = records(Pairs::Counted(&sampling))?;
                let weights = records
                    .tally
                    .take()
                    .map_or(Ok(Vec::new()), |tally| tally.weights(&|| check()))?;
                (walls, records, weights, None)
            }
            SurfaceModel::Voxel => (Border::none(dims), records(Pairs::Marked)?, Vec::new(), None),
        };
        Ok(Self {
            model,
            grid: Grid::new(image.frame(), rows.region()),
            border,
            walls,
            voxels,
            junction_cells,
            field,
            is_smoothed: sigma.is_some(),
            max_weight: weights.iter().copied().fold(1.0, f32::max),
            weights,
        })
    }

    /// Corners of an axis-aligned world box that holds dO and everything that is not background.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.grid.bounds()
    }

    /// The weight of each dense id in the smooth model, by which the indicators are multiplied;
    /// empty in the voxel model, and where other values than indicators are interpolated.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Distance between voxel centres along each image axis.
    pub fn spacing(&self) -> DVec3 {
        self.grid.spacing
    }

    /// Bytes that [`Oracle::of_rows`] needs at its peak, with the rows, for `image` and its region,
    /// but for some per contested sample of the labels' weights (see `weights`) or per share of a
    /// voxel near interfaces (see `mixtures`), whose number is not known in advance.
    pub fn bytes_needed(image: &LabelImage, &Region { dims, .. }: &Region) -> u64 {
        let values = if image.field().is_some() { size_of::<f32>() } else { 0 };
        let voxels = Bricks::new(dims).len() as u64 * (size_of::<Voxel>() + values) as u64;
        // While the voxels are filled in there are three sets of cells.
        Rows::bytes(dims) + voxels + 3 * Cells::bytes(dims)
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        let records = self.voxels.len() * size_of::<Voxel>();
        records + self.junction_cells.held() + self.field.as_ref().map_or(0, Field::bytes)
    }
}
