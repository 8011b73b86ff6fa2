//! The isosurface oracle: what label a point has, where the nearest interface is, where a segment crosses one. Knows no mesh.
//!
//! The isosurface dO is where the label changes; everything outside the image's grid is background. The oracle keeps the **region**: the
//! bounding box of the object and one voxel more on each side, so its outermost voxels are background and no query needs a special
//! case at the border of the image. It works in region coordinates: continuous indices whose origin is the region's first voxel
//! centre. World distances there are those of the spacing, because image axes are orthonormal.
//!
//! **Clearance** rests on one fact, for both surface models: every point x of dO has a surface voxel (one with a face neighbour of
//! another label) whose centre is at most h = half of a voxel's diagonal away.
//! - Voxel model: x is on a face of a voxel whose neighbour across it has another label, and no point of a voxel is farther than h from its centre.
//! - Smooth model: labels have weights with ratios of at most W = 2.25 (`weights::LIMIT` squared; below 3 is what the proof needs). Let v be the corner of x's
//!   cell nearest to x, L its label, and (a, b, c) in [0, 1/2]^3 the offsets of x from v. If v is a surface voxel, it is at most h away. If not, v and
//!   its three neighbours in the cell have label L, so the indicators of all other labels sum to at most u = ab + ac + bc - 2abc, what is left for the other four
//!   corners. As x is in dO, the indicator of some other label M is at least 1/W of that of L. So u >= (1 - u)/W, u >= 1/(1 + W) > 1/4.
//!   - Of the three corners that share a face of the cell with v but no edge, two or more are not L: with one of them, and the corner opposite to v,
//!     M's indicator would be at most ab <= 1/4, and L's at least 3/4. Each of the three has two of v's neighbours beside it, any two have
//!     all: all three neighbours of v in the cell are surface voxels.
//!   - In e_i = 1 - 2 (a, b, c)_i, the squared distance from x to the nearest of the three is h^2 + m - sum(e_i (2 - e_i) s_i^2) / 4, where s is the spacing
//!     and m = min(e_i s_i^2); the last sum is at least m (6 - sum(e_i)), so the distance is at most h when sum(e_i) <= 2.
//!   - 1 - 2u = (sum(e_i) - product(e_i)) / 2 (u is the chance that of three coins most show heads). With u > 1/4 it is below 1/2, and the product is at most the least e_i: the other
//!     two sum to less than 1, all three to less than 3/2.
//!   - Where the object reaches the border of the image (see `border`), x may lie up to half a voxel beyond the outermost voxel centres. Let v be the centre nearest to x. If its label
//!     is not background, v is a surface voxel, because the voxel beyond it is background. If it is, and v is no surface voxel, three of the four centres around x's projection are
//!     background, the fourth has a part of at most 1/4, and no other label leads there.
//!
//! So if s(p) is the distance from p to the nearest surface voxel centre, the distance from p to dO is at least s(p) - h. The feature transform has s
//! at voxel centres, and s(p) >= s(v) - |p - v|. For p outside the region, with q its nearest point in the region's box, which is convex and
//! holds all surface voxels: s(p)^2 >= |p - q|^2 + s(q)^2.
//!
//! **Volumes.** The smooth model without weights loses volume where interfaces are convex, about h^2/12 per unit of area and curvature (h here the spacing); the weights
//! restore that of each label, see `weights`. Single voxels stay single voxels: the label at a voxel's centre is its own, whatever the weights, because
//! all other indicators are 0 there. On the edge between two voxels the change of label lies at a part from 1/(1 + W) to W/(1 + W) of it. A flat interface between two
//! labels moves by about a quarter of the logarithm of their ratio, in voxels.
//!
//! **Near dO** this bound is often 0, half a voxel's diagonal and more away. There the smooth model counts cells: dO lies in cells whose corners have several labels, so
//! it is no nearer than the faces of the block of cells of one label around the point, see `rings`. In a cell of one label the label needs no interpolation.
//!
//! The oracle is immutable and `Sync`. Memory: 8 bytes per voxel of the region.
//!
//! Sources: the walk to the nearest surface voxel is that of P. Foteinos, N. Chrisochoides, "High quality real-time image-to-mesh conversion for finite element
//! simulations", J. Parallel and Distributed Computing 74, 2014 (section 3); stepping by a distance bound is sphere tracing (J. C. Hart, The Visual
//! Computer 12, 1996).

mod border;
mod crossing;
mod edges;
mod indicator;
mod region;
mod rings;
mod weights;

use glam::{DMat3, DVec3};

use border::Border;
pub use edges::{CrossedEdge, EdgeGrid};
use region::{calibrate, mark_surface, region, region_voxels, set_room};
use rings::Rings;

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
    /// Upper bound of the distance from a point of dO to its nearest surface voxel centre.
    slack: f64,
    bricks: Bricks,
    /// The voxels of the region, in the bricked layout.
    voxels: Vec<Voxel>,
    /// Weight of each dense id in the smooth model; empty in the voxel model.
    weights: Vec<f32>,
    /// The largest weight.
    greatest: f32,
    /// Unit of the voxels' distances.
    quantum: f64,
    /// Two and a half voxel diagonals in quanta.
    far: u16,
    /// Nearest surface voxel of each voxel of the region.
    features: FeatureTransform,
}

/// What most queries need of a voxel; together, so that one cache line has it. Decoding the feature instead costs a clearance twice the time.
#[derive(Clone, Copy, Debug, Default)]
struct Voxel {
    /// Dense id of the label.
    id: u16,
    /// Around the voxel: see `pack`.
    room: u16,
}

impl Voxel {
    const DISTANCES: u16 = u16::MAX >> 2;

    /// Two things in one word: the rings of the cell between this voxel and the next one along each axis (0 in the voxel model), and the distance to the nearest surface voxel, in quanta, rounded down.
    fn pack(rings: u16, distance: u16) -> u16 {
        debug_assert!(usize::from(rings) <= rings::MOST && distance <= Self::DISTANCES);
        distance << 2 | rings
    }

    #[inline(always)]
    fn rings(self) -> u16 {
        self.room & 3
    }

    #[inline(always)]
    fn distance(self) -> u16 {
        self.room >> 2
    }
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

/// The voxel nearest to a point.
struct Nearest {
    /// Its address.
    at: usize,
    /// Distance from the point, moved into the region, to the voxel's centre.
    offset: f64,
    /// Squared distance from the point to the region's box.
    outside2: f64,
}

impl Oracle {
    /// Builds the oracle; computes the feature transform on all threads of the current rayon pool. `check` is called at least once per
    /// plane of voxels and pass, from several threads; its error ends the computation.
    ///
    /// # Errors
    /// [`crate::Error::EmptyImage`] when no voxel differs from the background; [`crate::Error::InvalidArgument`] when the object's bounding box has
    /// 2^32 voxels or more; [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub fn new(image: &LabelImage, model: SurfaceModel, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let (first, dims) = region(image, check)?;
        let bricks = Bricks::new(dims);
        let mut voxels = region_voxels(image, first, &bricks, check)?;
        let frame = image.frame();
        let spacing = frame.spacing();
        let features = FeatureTransform::compute(
            dims,
            spacing.to_array(),
            |y, z, row| mark_surface(&voxels, &bricks, y, z, row),
            check,
        )?;
        // No distance in the region exceeds its diagonal.
        let quantum = (DVec3::from(dims.map(|n| n as f64)) * spacing).length() / f64::from(Voxel::DISTANCES);
        let (border, weights) = match model {
            SurfaceModel::Smooth => {
                let rings = Rings::new(&voxels, &bricks, check)?;
                set_room(&mut voxels, Some(rings), &features, quantum, check)?;
                let border = Border::new(first, dims, image.dims());
                let weights = calibrate(&voxels, &bricks, &border, image.labels().len(), check)?;
                (border, weights)
            }
            SurfaceModel::Voxel => {
                set_room(&mut voxels, None, &features, quantum, check)?;
                (Border::none(dims), Vec::new())
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
            // Above the exact bound by more than rounding can eat.
            slack: 0.5 * spacing.length() * (1.0 + 1e-9),
            bricks,
            voxels,
            greatest: weights.iter().copied().fold(1.0, f32::max),
            weights,
            quantum,
            far: (2.5 * spacing.length() / quantum) as u16,
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
        let (_, dims) = region(image, check)?;
        let voxels = dims.iter().map(|&n| n as u64).product::<u64>();
        // Beside what is held, the feature transform in its last pass has the sites of the planes, and later there are the rings.
        let passing = (voxels * size_of::<u32>() as u64).max(Rings::bytes(dims));
        Ok(Bricks::new(dims).len() as u64 * Self::BYTES_PER_VOXEL as u64 + passing)
    }

    /// Bytes held per voxel of the region: voxel and feature.
    const BYTES_PER_VOXEL: usize = size_of::<Voxel>() + size_of::<u32>();

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.bricks.len() * Self::BYTES_PER_VOXEL
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
                if voxel.rings() > 0 {
                    voxel.id
                } else {
                    indicator::label(&self.corners(cell), &self.weights, self.greatest, place(x, cell))
                }
            }
            SurfaceModel::Voxel => self.at(self.voxel(x)).id,
        }
    }

    #[inline(always)]
    fn approach_at(&self, x: DVec3) -> Approach {
        let sample = match self.model {
            SurfaceModel::Smooth => {
                let mixed = || Sample { label: self.label_inside(x), clearance: 0.0 };
                self.uniform_at(x).unwrap_or_else(mixed)
            }
            SurfaceModel::Voxel => {
                let nearest = self.nearest(x);
                let clearance = self.clearance_from(&nearest);
                // dO does not come between the point and the centre of its nearest voxel.
                let label = if clearance > 0.0 { self.voxels[nearest.at].id } else { self.label_at(x) };
                Sample { label, clearance }
            }
        };
        Approach { x, sample }
    }

    #[inline(always)]
    fn clearance_at(&self, x: DVec3) -> f64 {
        match self.model {
            SurfaceModel::Smooth => self.uniform_at(x).map_or(0.0, |sample| sample.clearance),
            SurfaceModel::Voxel => self.clearance_from(&self.nearest(x)),
        }
    }

    /// Label and clearance in the smooth model: of points outside of the border, and in uniform cells. `None`: in a mixed cell.
    #[inline(always)]
    fn uniform_at(&self, x: DVec3) -> Option<Sample> {
        if !self.border.holds(x) {
            return Some(Sample { label: 0, clearance: self.clearance_from(&self.nearest(x)) });
        }
        let cell = self.cell(x);
        let voxel = self.at(cell);
        let rings = voxel.rings();
        if rings == 0 {
            return None;
        }
        let clearance = self.to_faces(x, cell, f64::from(rings - 1));
        let is_far = usize::from(rings) == rings::MOST;
        let clearance = if is_far { clearance.max(self.clearance_from(&self.nearest(x))) } else { clearance };
        Some(Sample { label: voxel.id, clearance })
    }

    /// Whether the clearance may lead out of a cell of one label: in the smooth model out of the cell at a voxel, in the voxel model out of the voxel, within which one and
    /// a half diagonals may be lost.
    #[inline(always)]
    fn has_room(&self, voxel: Voxel) -> bool {
        match self.model {
            SurfaceModel::Smooth => voxel.rings() > 1,
            SurfaceModel::Voxel => voxel.distance() >= self.far,
        }
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

    #[inline(always)]
    fn nearest(&self, x: DVec3) -> Nearest {
        let q = x.max(DVec3::ZERO).min(self.last);
        let [i, j, k] = self.voxel(q);
        let centre = DVec3::new(i as f64, j as f64, k as f64);
        Nearest {
            at: self.bricks.index(i, j, k),
            offset: ((q - centre) * self.spacing).length(),
            outside2: ((x - q) * self.spacing).length_squared(),
        }
    }

    /// The lower bound of the head comment.
    #[inline(always)]
    fn clearance_from(&self, nearest: &Nearest) -> f64 {
        let to_site = (f64::from(self.voxels[nearest.at].distance()) * self.quantum - nearest.offset).max(0.0);
        let to_site = if nearest.outside2 > 0.0 { (nearest.outside2 + to_site * to_site).sqrt() } else { to_site };
        (to_site - self.slack).max(0.0)
    }

    /// A voxel centre near x that has another label than `from`: the nearest surface voxel, or else its neighbour nearest to x.
    fn region_target(&self, x: DVec3, from: u16) -> DVec3 {
        let [i, j, k] = self.voxel(x.max(DVec3::ZERO).min(self.last));
        let site = self.features.site_at(self.bricks.index(i, j, k)).map(|c| c as usize);
        let centre = DVec3::from(site.map(|c| c as f64));
        if self.at(site).id != from {
            return centre;
        }
        // Its six neighbours; where it lies at the end of an axis, itself in place of one. Without branches: which of them differ is as good as random.
        let (b, dims) = (&self.bricks, self.bricks.dims());
        let at = [b.x(site[0]), b.y(site[1]), b.z(site[2])];
        let all = at[0] + at[1] + at[2];
        let to_site = (centre - x) * self.spacing;
        let mut nearest = (f64::INFINITY, 0, 0.0);
        for axis in 0..3 {
            for step in [-1.0, 1.0] {
                let moved =
                    if step < 0.0 { site[axis].saturating_sub(1) } else { (site[axis] + 1).min(dims[axis] - 1) };
                let term = [b.x(moved), b.y(moved), b.z(moved)][axis];
                let differs = self.voxels[all - at[axis] + term].id != from;
                // Squared distance from x, less that of the site.
                let farther = self.spacing[axis] * (self.spacing[axis] + 2.0 * step * to_site[axis]);
                let farther = if differs { farther } else { f64::INFINITY };
                nearest = if farther < nearest.0 { (farther, axis, step) } else { nearest };
            }
        }
        let mut target = centre;
        target[nearest.1] += nearest.2;
        target
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
