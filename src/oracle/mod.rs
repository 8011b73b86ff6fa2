//! The isosurface oracle: what label a point has, where the nearest interface is, where a segment crosses one. Knows no mesh.
//!
//! The isosurface dO is where the label changes; everything outside the image's grid is background. The oracle keeps the **region**: the
//! bounding box of the object and one voxel more on each side, so its outermost voxels are background and no query needs a special
//! case at the border of the image. It works in region coordinates: continuous indices whose origin is the region's first voxel
//! centre. World distances there are those of the spacing, because image axes are orthonormal.
//!
//! **Cells** are the cubes between eight voxel centres; a cell is *mixed* when its corners have several labels. In both surface models dO lies in the mixed cells:
//! - Smooth model: in a cell of one label all other indicators are 0. Between the outermost voxel centres and a wall (see `border`) a point has the label of its projection onto the face of
//!   its cell; beyond the wall are background corners, so the cell is mixed unless that face is background.
//! - Voxel model: a point of dO is on the common face of two voxels of different labels, and every cell that holds a part of this face has both centres as corners.
//!
//! **Clearance** is a lower bound of the distance to dO.
//! - In a mixed cell it is 0.
//! - A uniform cell has one ring or more of cells of one label around it (see `cells`), and dO is no nearer than the faces of that block.
//! - From three rings on, the *far* cells, there is a second bound. A point of a mixed cell is at most h = half of a voxel's diagonal away from its centre, so if s is the distance to the nearest centre of a mixed
//!   cell, dO is no nearer than s - h. The feature transform has s exactly at every fourth voxel centre along each axis, and a proven lower bound between; see `distance`.
//! - For p outside the region, with q its nearest point in the region's box, which is convex and holds dO: the squared distance is at least |p - q|^2 + clearance(q)^2.
//!
//! **Target.** The way to the nearest surface leads to a voxel centre of another label: the nearest corner of that kind of a mixed cell. In a mixed cell it is this very cell. In a uniform cell with one or two
//! rings it is the mixed cell nearest to its centre, exactly. In a far cell it is the nearest to the point of the eight that are nearest to the nodes of the feature transform around: nearly, not always, the
//! nearest. So whether a large ball meets dO may be decided with a surface point that is slightly farther away than the closest.
//!
//! **Volumes.** The smooth model without weights loses volume where interfaces are convex, about h^2/12 per unit of area and curvature (h here the spacing); the weights
//! restore that of each label, see `weights`. Single voxels stay single voxels: the label at a voxel's centre is its own, whatever the weights, because
//! all other indicators are 0 there. On the edge between two voxels the change of label lies at a part from 1/(1 + W) to W/(1 + W) of it. A flat interface between two
//! labels moves by about a quarter of the logarithm of their ratio, in voxels.
//!
//! The oracle is immutable and `Sync`. Memory: a little more than 4 bytes per voxel of the region.
//!
//! Sources: the walk to the nearest surface voxel is that of P. Foteinos, N. Chrisochoides, "High quality real-time image-to-mesh conversion for finite element
//! simulations", J. Parallel and Distributed Computing 74, 2014 (section 3); stepping by a distance bound is sphere tracing (J. C. Hart, The Visual
//! Computer 12, 1996).

mod border;
mod cells;
mod crossing;
mod edges;
mod indicator;
mod region;
mod voxel;
mod weights;

use glam::{DMat3, DVec3};

use border::Border;
pub use edges::{CrossedEdge, EdgeGrid};
use cells::Cells;
use region::{Region, Rows};
use voxel::Voxel;
use weights::Sampling;

use crate::{
    Result,
    distance::{Bricks, FeatureTransform},
    image::LabelImage,
    params::SurfaceModel,
};

/// Answers questions about the isosurface. Built once from an image; points are in world coordinates.
#[derive(Clone, Debug)]
pub struct Oracle {
    model: SurfaceModel,
    /// World to region coordinates: to_region * (p - origin).
    to_region: DMat3,
    to_world: DMat3,
    origin: DVec3,
    spacing: DVec3,
    /// Region coordinates of the last voxel centre.
    last: DVec3,
    /// Where the smooth model ends.
    border: Border,
    /// Half of a voxel's diagonal, and more than rounding can eat.
    slack: f64,
    bricks: Bricks,
    /// The voxels of the region, in the bricked layout.
    voxels: Vec<Voxel>,
    /// Where near cells have their nearest mixed cell.
    offsets: Vec<[i8; 3]>,
    /// Weight of each dense id in the smooth model; empty in the voxel model.
    weights: Vec<f32>,
    /// The largest weight.
    greatest: f32,
    /// The mixed cells near far points.
    features: FeatureTransform,
}

/// What one look at the volumes tells about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Dense id of the label at the point.
    pub label: u16,
    /// Lower bound of the distance to dO, as [`Oracle::clearance`].
    pub clearance: f64,
}

/// What the oracle found around a point, to ask on from.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// The point, in region coordinates.
    x: DVec3,
    /// Its label and clearance.
    pub sample: Sample,
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
    /// Builds the oracle; computes the feature transform on all threads of the current rayon pool. `check` is called at least once per
    /// plane of voxels and pass, from several threads; its error ends the computation.
    ///
    /// # Errors
    /// [`crate::Error::EmptyImage`] when no voxel differs from the background; [`crate::Error::InvalidArgument`] when the object's bounding box has
    /// 2^32 voxels or more; [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(image: &LabelImage, model: SurfaceModel, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let region = Region::new(image, check)?;
        let Region { first, dims } = region;
        let rows = Rows::new(image, &region, check)?;
        let frame = image.frame();
        let spacing = frame.spacing();
        let mixed = Cells::mixed(&rows, check)?;
        let features =
            FeatureTransform::compute(dims.map(|n| n - 1), spacing.to_array(), |j, k| mixed.row(j, k), check)?;
        let offsets = voxel::offsets(spacing);
        let (border, voxels, weights) = match model {
            SurfaceModel::Smooth => {
                let border = Border::new(first, dims, image.dims());
                let sampling = Sampling::new(rows.rough_counts(image.labels().len()).into_iter());
                let (voxels, tally) = voxel::records(&rows, &mixed, &offsets, Some((&sampling, &border)), check)?;
                let weights = tally.map_or(Ok(Vec::new()), |tally| tally.weights(&|| check()))?;
                (border, voxels, weights)
            }
            SurfaceModel::Voxel => {
                let (voxels, _) = voxel::records(&rows, &mixed, &offsets, None, check)?;
                (Border::none(dims), voxels, Vec::new())
            }
        };
        let to_world = frame.direction() * DMat3::from_diagonal(spacing);
        Ok(Self {
            model,
            to_region: DMat3::from_diagonal(spacing.recip()) * frame.direction().transpose(),
            to_world,
            origin: frame.to_world(DVec3::from(first.map(|c| c as f64))),
            spacing,
            last: DVec3::from(dims.map(|n| (n - 1) as f64)),
            border,
            slack: 0.5 * spacing.length() * (1.0 + 1e-9),
            bricks: Bricks::new(dims),
            voxels,
            offsets,
            greatest: weights.iter().copied().fold(1.0, f32::max),
            weights,
            features,
        })
    }

    /// The dense id at a point; 0 outside the image.
    #[inline]
    pub fn label(&self, p: DVec3) -> u16 {
        self.label_at(self.region_point(p))
    }

    /// A lower bound of the distance from `p` to dO; 0 where it may be nearer than the volumes resolve. At most three voxel diagonals below
    /// the true distance, when `p` is in the region.
    #[inline]
    pub fn clearance(&self, p: DVec3) -> f64 {
        self.clearance_at(self.region_point(p))
    }

    /// Label and clearance at the cost of about one of them: away from dO the label is that of the nearest voxel.
    #[inline]
    pub fn sample(&self, p: DVec3) -> Sample {
        self.approach(p).sample
    }

    /// All that the oracle knows of `p` at once: label, clearance, and on the way where the closest surface point is looked for.
    #[inline]
    pub fn approach(&self, p: DVec3) -> Approach {
        self.approach_at(self.region_point(p))
    }

    /// A point whose label is not that of the approach's: the closest surface point lies on the segment from the approach's point to it.
    #[inline]
    pub fn target(&self, approach: &Approach) -> DVec3 {
        self.world_point(self.region_target(approach.x, approach.sample.label))
    }

    /// A point of dO near the approach's point, about the closest one: on the way to the nearest surface voxel, and from there to its neighbour of
    /// another label, which [`Oracle::target`] gave. `None` when that point, or the bound by clearance, is farther than `within`.
    pub fn closest_on(&self, approach: &Approach, target: DVec3, within: f64) -> Option<DVec3> {
        let &Approach { x, sample: Sample { label, clearance }, .. } = approach;
        if clearance > within {
            return None;
        }
        let target = self.region_point(target);
        let way = (target - x) * self.spacing;
        let length = way.length();
        let (point, _) = self.trace(x, target, clearance / length, within / length, label)?;
        let squared = ((point - x) * self.spacing).length_squared();
        (squared <= within * within).then(|| self.world_point(point))
    }

    /// As [`Oracle::closest_on`], for callers that know nothing of `p` yet.
    pub fn closest_surface_point(&self, p: DVec3, within: f64) -> Option<DVec3> {
        let approach = self.approach(p);
        self.closest_on(&approach, self.target(&approach), within)
    }

    /// Where the segment from `a` to `b` first leaves the label of `a`. Never `None` when the labels of `a` and `b` differ. Nor is a shorter stay in another label missed, but for
    /// rounding.
    pub fn first_crossing(&self, a: DVec3, b: DVec3) -> Option<Crossing> {
        let x = self.region_point(a);
        let target = self.region_point(b);
        let length = ((target - x) * self.spacing).length();
        let Sample { label: from, clearance } = self.approach_at(x).sample;
        if clearance >= length {
            return None;
        }
        let (point, to) = self.trace(x, target, clearance / length, 1.0, from)?;
        Some(Crossing { point: self.world_point(point), from, to })
    }

    /// Corners of an axis-aligned world box that holds dO and everything that is not background.
    pub fn bounds(&self) -> [DVec3; 2] {
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for corner in 0..8 {
            let x = DVec3::from([0, 1, 2].map(|a| if corner >> a & 1 == 1 { self.last[a] } else { 0.0 }));
            let p = self.world_point(x);
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        bounds
    }

    /// The weight of each dense id in the smooth model, by which the indicators are multiplied; empty in the voxel model.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Distance between voxel centres along each image axis.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// Bytes that [`Oracle::new`] needs at its peak for `image`, but for some per contested sample of the labels' weights (see `weights`), whose number
    /// is not known in advance.
    ///
    /// # Errors
    /// [`crate::Error::EmptyImage`]; whatever `check` returns.
    pub fn bytes_needed(image: &LabelImage, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<u64> {
        let dims = Region::new(image, check)?.dims;
        let [held, passing] = FeatureTransform::bytes_needed(dims.map(|n| n - 1));
        let voxels = Bricks::new(dims).len() as u64 * size_of::<Voxel>() as u64;
        // While the feature transform is computed there is one set of cells; while the voxels are filled in, three.
        let building = (passing + Cells::bytes(dims)).max(voxels + 3 * Cells::bytes(dims));
        Ok(Rows::bytes(dims) + held + building)
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.voxels.len() * size_of::<Voxel>() + self.features.bytes()
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
                let voxel = self.at(cell);
                if voxel.rings() > 0 { voxel.id } else { self.label_in(cell, voxel, x) }
            }
            SurfaceModel::Voxel => self.at(self.voxel(x)).id,
        }
    }

    /// The label in a mixed cell of the smooth model.
    #[inline(always)]
    fn label_in(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> u16 {
        if voxel.is_two() {
            let first = voxel.first_corners();
            let other = self.corner(cell, (!first).trailing_zeros());
            indicator::label_of_two(first, [voxel.id, other], &self.weights, place(x, cell))
        } else {
            indicator::label(&self.corners(cell), &self.weights, self.greatest, place(x, cell))
        }
    }

    #[inline(always)]
    fn approach_at(&self, x: DVec3) -> Approach {
        let sample = self.uniform_at(x).unwrap_or_else(|| Sample { label: self.label_inside(x), clearance: 0.0 });
        Approach { x, sample }
    }

    #[inline(always)]
    fn clearance_at(&self, x: DVec3) -> f64 {
        self.uniform_at(x).map_or(0.0, |sample| sample.clearance)
    }

    /// Label and clearance of points outside of the border and in uniform cells. `None`: in a mixed cell.
    #[inline(always)]
    fn uniform_at(&self, x: DVec3) -> Option<Sample> {
        if !self.border.holds(x) {
            return Some(Sample { label: 0, clearance: self.clearance_outside(x) });
        }
        let cell = self.cell(x);
        let voxel = self.at(cell);
        (voxel.rings() > 0).then(|| Sample { label: voxel.id, clearance: self.clearance_in(cell, voxel, x) })
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
        if rings == 0 {
            return 0.0;
        }
        let clearance = self.to_faces(x, cell, f64::from(rings - 1));
        if rings < voxel::FAR { clearance } else { clearance.max(self.far_clearance(x)) }
    }

    fn far_clearance(&self, x: DVec3) -> f64 {
        (self.features.around(x).squared_distance.max(0.0) * (1.0 - 1e-9)).sqrt() - self.slack
    }

    /// Distance from a point of a cell to the faces of the block of cells around it, `more` on each side.
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
        let dims = self.bricks.dims();
        // Rounded, not cut off: a point on a face is in either cell, which agree there. A region has at least three voxels along each axis.
        [0, 1, 2].map(|a| rounded((x[a] - 0.5).max(0.0)).min(dims[a] - 2))
    }

    /// The voxel that holds a point of the region.
    #[inline(always)]
    fn voxel(&self, x: DVec3) -> [usize; 3] {
        let dims = self.bricks.dims();
        [0, 1, 2].map(|a| rounded(x[a]).min(dims[a] - 1))
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
        self.at([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)]).id
    }

    /// The nearest point in the region's box.
    #[inline(always)]
    fn inside(&self, x: DVec3) -> DVec3 {
        x.max(DVec3::ZERO).min(self.last)
    }

    /// A voxel centre near x that has another label than `from`, the label of x.
    #[inline(always)]
    fn region_target(&self, x: DVec3, from: u16) -> DVec3 {
        let q = self.inside(x);
        let cell = self.cell(q);
        let voxel = self.at(cell);
        let rings = voxel.rings();
        let (mixed, voxel) = match rings {
            0 => (cell, voxel),
            _ => {
                let mixed = if rings < voxel::FAR {
                    let offset = self.offsets[voxel.offset()];
                    [0, 1, 2].map(|a| cell[a].wrapping_add_signed(isize::from(offset[a])))
                } else {
                    self.features.around(q).site.map(|c| c as usize)
                };
                (mixed, self.at(mixed))
            }
        };
        let first = voxel.first_corners();
        let others = match () {
            () if voxel.id == from => !first & 0xff,
            () if voxel.is_two() => first,
            () => !indicator::corners_of(&self.corners(mixed), from) & 0xff,
        };
        // The nearest of these corners. Without branches: which they are is as good as random.
        let low = DVec3::from(mixed.map(|c| c as f64));
        let [to_low, to_high] = [low, low + 1.0].map(|corner| (corner - x) * self.spacing);
        let squared = [to_low * to_low, to_high * to_high];
        let mut nearest = (f64::INFINITY, 0);
        for c in 0..8 {
            let distance = squared[c & 1].x + squared[c >> 1 & 1].y + squared[c >> 2].z;
            let distance = if others >> c & 1 == 1 { distance } else { f64::INFINITY };
            nearest = if distance < nearest.0 { (distance, c) } else { nearest };
        }
        let corner = low + DVec3::from([0, 1, 2].map(|a| (nearest.1 >> a & 1) as f64));
        if rings > 1 { corner } else { self.beside(q, from).filter(|b| b.1 < nearest.0).map_or(corner, |b| b.0) }
    }

    /// Of the neighbours outside of x's cell that the voxel nearest to x has, the nearest one with another label than `from`; and its squared distance.
    #[inline(always)]
    fn beside(&self, x: DVec3, from: u16) -> Option<(DVec3, f64)> {
        let (voxel, cell, b, dims) = (self.voxel(x), self.cell(x), &self.bricks, self.bricks.dims());
        let terms = [b.x(voxel[0]), b.y(voxel[1]), b.z(voxel[2])];
        let all = terms[0] + terms[1] + terms[2];
        let centre = DVec3::from(voxel.map(|c| c as f64));
        let way = (centre - x) * self.spacing;
        let mut nearest = (f64::INFINITY, 0, 0.0);
        for axis in 0..3 {
            let is_upper = voxel[axis] > cell[axis];
            // At the end of the axis the voxel itself.
            let to = if is_upper { (voxel[axis] + 1).min(dims[axis] - 1) } else { voxel[axis].saturating_sub(1) };
            let differs = self.voxels[all - terms[axis] + [b.x(to), b.y(to), b.z(to)][axis]].id != from;
            // More than the squared distance to the centre.
            let step = if is_upper { 1.0 } else { -1.0 };
            let farther = self.spacing[axis] * (self.spacing[axis] + 2.0 * step * way[axis]);
            let farther = if differs { farther } else { f64::INFINITY };
            nearest = if farther < nearest.0 { (farther, axis, step) } else { nearest };
        }
        let mut target = centre;
        target[nearest.1] += nearest.2;
        (nearest.0 < f64::INFINITY).then(|| (target, nearest.0 + way.length_squared()))
    }
}

/// The integer nearest to x in [0, 2^31], even on a tie. The sum with 2^52 has it in its low bits; several times faster than a conversion that
/// saturates.
#[inline(always)]
fn rounded(x: f64) -> usize {
    const SHIFT: f64 = (1_u64 << 52) as f64;
    (x + SHIFT).to_bits() as u32 as usize
}

/// The ids at the corners of a cell.
#[inline(always)]
fn corners(voxels: &[Voxel], b: &Bricks, [i, j, k]: [usize; 3]) -> indicator::Corners {
    let x = [b.x(i), b.x(i + 1)];
    let y = [b.y(j), b.y(j + 1)];
    let z = [b.z(k), b.z(k + 1)];
    std::array::from_fn(|c| voxels[x[c & 1] + y[c >> 1 & 1] + z[c >> 2]].id)
}

/// Coordinates of a point within its cell.
#[inline(always)]
fn place(x: DVec3, cell: [usize; 3]) -> [f32; 3] {
    [0, 1, 2].map(|a| (x[a] - cell[a] as f64) as f32)
}
