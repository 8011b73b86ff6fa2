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
//! **Clearance** is a lower bound of the distance to dO.
//! - In a mixed cell it is 0.
//! - A uniform cell has one ring or more of cells of one label around it, counted up to three (see
//!   `cells`), and dO is no nearer than the faces of that block.
//! - For p outside the region, with q its nearest point in the region's box, which is convex and
//!   holds dO: the squared distance is at least |p - q|^2 + clearance(q)^2.
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

mod border;
pub(crate) mod bricks;
mod cells;
mod contacts;
mod crossing;
mod edges;
mod estimate;
mod field;
mod indicator;
mod junctions;
mod mixtures;
mod palette;
pub mod region;
mod smoothing;
pub mod thickness;
mod ties;
mod tiles;
mod voxel;
mod walls;
mod weights;

use glam::{DMat3, DVec3};

use border::Border;
use bricks::Bricks;
use cells::Cells;
use contacts::Contacts;
pub use edges::{CrossedEdge, EdgeGrid, FeaturePoint};
use field::Field;
pub use junctions::{JunctionKind, JunctionPlanes};
pub use palette::Palette;
use region::{Region, Rows};
pub use tiles::Tiles;
use voxel::{Pairs, Records, Voxel};
pub use walls::Walls;
use weights::Sampling;

use crate::Result;
use crate::image::LabelImage;
use crate::memory::prefetch;
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
    /// World to region coordinates: to_region * (p - origin).
    to_region: DMat3,
    to_world: DMat3,
    origin: DVec3,
    spacing: DVec3,
    /// Image index of the region's first voxel; -1 where the object reaches the border.
    first: [isize; 3],
    /// Region coordinates of the last voxel centre.
    last: DVec3,
    /// Where the smooth model ends.
    border: Border,
    /// Where the image cuts the object off: in the smooth model the same.
    walls: Border,
    bricks: Bricks,
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
    greatest: f32,
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
        let frame = image.frame();
        let spacing = frame.spacing();
        let mixed = Cells::mixed(rows, check)?;
        let Surface { model, border, sigma } = surface;
        let walls = match (border, model) {
            (ImageBorder::Smooth, SurfaceModel::Smooth) => Border::none(dims),
            _ => Border::new(first, dims, image.dims()),
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
        let to_world = frame.direction() * DMat3::from_diagonal(spacing);
        Ok(Self {
            model,
            to_region: DMat3::from_diagonal(spacing.recip()) * frame.direction().transpose(),
            to_world,
            origin: frame.to_world(DVec3::from(first.map(|c| c as f64))),
            spacing,
            first,
            last: DVec3::from(dims.map(|n| (n - 1) as f64)),
            border,
            walls,
            bricks: Bricks::new(dims),
            voxels,
            junction_cells,
            field,
            is_smoothed: sigma.is_some(),
            greatest: weights.iter().copied().fold(1.0, f32::max),
            weights,
        })
    }

    /// The dense id at a point; 0 outside the image.
    #[inline]
    pub fn label(&self, p: DVec3) -> u16 {
        self.label_at(self.region_point(p))
    }

    /// As [`Self::label`] for `count` points, of which `point` tells each and `found` is told the
    /// label, in order. Of points beyond the border for which `is_continued` says so it is the
    /// [`Self::continued_label`]. The voxels of many points come into the cache at once.
    #[inline]
    pub fn labels(
        &self,
        count: usize,
        point: impl Fn(usize) -> DVec3,
        is_continued: impl Fn(usize) -> bool,
        mut found: impl FnMut(usize, u16),
    ) {
        const AT_ONCE: usize = 32;
        if self.model == SurfaceModel::Voxel {
            let label =
                |i, x| if is_continued(i) { self.continued_label_at(x) } else { self.label_at(x) };
            return (0..count).for_each(|i| found(i, label(i, self.region_point(point(i)))));
        }
        let mut places = [(DVec3::ZERO, [0; 3], OUTSIDE); AT_ONCE];
        for from in (0..count).step_by(AT_ONCE) {
            let points = from..(from + AT_ONCE).min(count);
            for (i, place) in points.clone().zip(&mut places) {
                let x = self.region_point(point(i));
                *place = if self.border.holds(x) || is_continued(i) {
                    let x = self.border.extend(x);
                    let cell = self.cell(x);
                    let index = self.bricks.index(cell[0], cell[1], cell[2]);
                    prefetch(self.voxels.as_ptr().wrapping_add(index));
                    (x, cell, index)
                } else {
                    (x, [0; 3], OUTSIDE)
                };
            }
            for (i, &(x, cell, index)) in points.zip(&places) {
                found(
                    i,
                    if index == OUTSIDE { 0 } else { self.label_of(cell, self.voxels[index], x) },
                );
            }
        }
    }

    /// A lower bound of the distance from `p` to dO; 0 in mixed cells. No more than about three
    /// voxels where `p` is in the region: enough to say what is near dO, not how far away the rest
    /// is.
    #[inline]
    pub fn clearance(&self, p: DVec3) -> f64 {
        self.clearance_at(self.region_point(p))
    }

    /// Where the segment from `a` to `b` first leaves the label of `a`. Never `None` when the
    /// labels of `a` and `b` differ. Nor is a shorter stay in another label missed, but for
    /// rounding.
    pub fn first_crossing(&self, a: DVec3, b: DVec3) -> Option<Crossing> {
        self.first_crossing_from(self.label(a), a, b)
    }

    /// As [`Self::first_crossing`], by a caller who knows the label `from` of `a`.
    pub fn first_crossing_from(&self, from: u16, a: DVec3, b: DVec3) -> Option<Crossing> {
        let (point, to) = self.trace(self.region_point(a), self.region_point(b), from)?;
        Some(Crossing { point: self.world_point(point), from, to })
    }

    /// The point of an interface near `p`, along `normal`, if the image has the first label of
    /// `pair` below it and the second one above, both at a distance of `reach`. `labels` has the
    /// label of each id.
    pub fn project(
        &self,
        p: DVec3,
        normal: DVec3,
        reach: f64,
        [below, above]: [i32; 2],
        labels: &[i32],
    ) -> Option<DVec3> {
        let off = reach * normal;
        let from = self.label(p - off);
        if labels[usize::from(from)] != below {
            return None;
        }
        let crossing = self.first_crossing_from(from, p - off, p + off)?;
        let [past, at_end] = [crossing.to, self.label(p + off)].map(|id| labels[usize::from(id)]);
        (past == above && at_end == above).then_some(crossing.point)
    }

    /// Corners of an axis-aligned world box that holds dO and everything that is not background.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.box_of(DVec3::ZERO, self.last)
    }

    /// An axis-aligned world box that holds a box in region coordinates.
    fn box_of(&self, lower: DVec3, upper: DVec3) -> [DVec3; 2] {
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for corner in 0..8 {
            let x = DVec3::from(
                [0, 1, 2].map(|a| if corner >> a & 1 == 1 { upper[a] } else { lower[a] }),
            );
            let p = self.world_point(x);
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        bounds
    }

    /// The weight of each dense id in the smooth model, by which the indicators are multiplied;
    /// empty in the voxel model, and where other values than indicators are interpolated.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Distance between voxel centres along each image axis.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
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

    #[inline(always)]
    fn region_point(&self, p: DVec3) -> DVec3 {
        self.to_region * (p - self.origin)
    }

    #[inline(always)]
    fn world_point(&self, x: DVec3) -> DVec3 {
        self.origin + self.to_world * x
    }

    #[inline(always)]
    fn label_at(&self, x: DVec3) -> u16 {
        if self.border.holds(x) { self.label_inside(x) } else { 0 }
    }

    /// The label of a point within the border.
    #[inline(always)]
    fn label_inside(&self, x: DVec3) -> u16 {
        match self.model {
            SurfaceModel::Smooth => {
                let x = self.border.extend(x);
                let cell = self.cell(x);
                self.label_of(cell, self.at(cell), x)
            }
            SurfaceModel::Voxel => self.at(self.voxel(x)).id(),
        }
    }

    /// The label in a cell of the smooth model.
    #[inline(always)]
    fn label_of(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> u16 {
        if voxel.rings() > 0 { voxel.id() } else { self.label_in(cell, voxel, x) }
    }

    /// The label in a mixed cell of the smooth model.
    #[inline(always)]
    fn label_in(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> u16 {
        if voxel.is_two() {
            let first = voxel.first_corners();
            let other = self.corner(cell, (!first).trailing_zeros());
            indicator::label_of_two(first, [voxel.id(), other], &self.weights, place(x, cell))
        } else if let Some(field) = &self.field {
            field.label(&self.bricks, cell, place(x, cell))
        } else if voxel.contacts() != Contacts::None {
            self.label_at_contact(cell, x)
        } else {
            indicator::label(&self.corners(cell), &self.weights, self.greatest, place(x, cell))
        }
    }

    /// The label in a cell with contacts.
    #[cold]
    fn label_at_contact(&self, cell: [usize; 3], x: DVec3) -> u16 {
        self.contact_cell(cell).label(place(x, cell))
    }

    /// A cell with contacts.
    fn contact_cell(&self, cell: [usize; 3]) -> contacts::Cell<'_> {
        let center = self.at(cell).contacts() == Contacts::Center;
        contacts::Cell { ids: self.corners(cell), weights: &self.weights, center }
    }

    #[inline(always)]
    fn clearance_at(&self, x: DVec3) -> f64 {
        if self.border.holds(x) {
            let cell = self.cell(x);
            self.clearance_in(cell, self.at(cell), x)
        } else {
            self.clearance_outside(x)
        }
    }

    /// The clearance of a point outside of the border.
    fn clearance_outside(&self, x: DVec3) -> f64 {
        let q = self.inside(x);
        let cell = self.cell(q);
        let within = self.clearance_in(cell, self.at(cell), q);
        let outside = ((x - q) * self.spacing).length();
        if outside > 0.0 { outside.hypot(within) } else { within }
    }

    /// The clearance of a point of a cell.
    #[inline(always)]
    fn clearance_in(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> f64 {
        let rings = voxel.rings();
        if rings == 0 { 0.0 } else { self.to_faces(x, cell, f64::from(rings - 1)) }
    }

    /// Distance from a point of a cell to the faces of the block of cells around it, `more` on each
    /// side.
    #[inline(always)]
    fn to_faces(&self, x: DVec3, cell: [usize; 3], more: f64) -> f64 {
        let at = x - DVec3::from(cell.map(|c| c as f64));
        // Rounding of x must not matter.
        let least = at.min(1.0 - at) + (more - 1e-9);
        (least * self.spacing).min_element().max(0.0)
    }

    /// The cell that holds a point of the region.
    #[inline(always)]
    fn cell(&self, x: DVec3) -> [usize; 3] {
        // Rounded, not cut off: a point on a face is in either cell, which agree there. A region
        // has at least three voxels along each axis.
        (x - 0.5).max(DVec3::ZERO).min(self.last - 1.0).to_array().map(rounded)
    }

    /// The voxel that holds a point of the region.
    #[inline(always)]
    fn voxel(&self, x: DVec3) -> [usize; 3] {
        x.min(self.last).to_array().map(rounded)
    }

    #[inline(always)]
    fn at(&self, [i, j, k]: [usize; 3]) -> Voxel {
        self.voxels[self.bricks.index(i, j, k)]
    }

    #[inline(always)]
    fn corners(&self, cell: [usize; 3]) -> indicator::Corners {
        corners(&self.voxels, &self.bricks, cell)
    }

    /// The label of a corner of a cell.
    #[inline(always)]
    fn corner(&self, [i, j, k]: [usize; 3], corner: u32) -> u16 {
        let c = corner as usize;
        self.at([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)]).id()
    }

    /// The nearest point in the region's box.
    #[inline(always)]
    fn inside(&self, x: DVec3) -> DVec3 {
        x.max(DVec3::ZERO).min(self.last)
    }
}

/// The integer nearest to x in [0, 2^31], even on a tie. The sum with 2^52 has it in its low bits;
/// several times faster than a conversion that saturates.
#[inline(always)]
pub(crate) fn rounded(x: f64) -> usize {
    const SHIFT: f64 = (1_u64 << 52) as f64;
    (x + SHIFT).to_bits() as u32 as usize
}

/// The place of no voxel.
const OUTSIDE: usize = usize::MAX;

/// The ids at the corners of a cell.
#[inline(always)]
fn corners(voxels: &[Voxel], b: &Bricks, [i, j, k]: [usize; 3]) -> indicator::Corners {
    let x = [b.x(i), b.x(i + 1)];
    let y = [b.y(j), b.y(j + 1)];
    let z = [b.z(k), b.z(k + 1)];
    std::array::from_fn(|c| voxels[x[c & 1] + y[c >> 1 & 1] + z[c >> 2]].id())
}

/// Coordinates of a point within its cell.
#[inline(always)]
fn place(x: DVec3, cell: [usize; 3]) -> [f32; 3] {
    [0, 1, 2].map(|a| (x[a] - cell[a] as f64) as f32)
}
