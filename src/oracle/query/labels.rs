//! The label of a point, and a lower bound of its distance to all interfaces.

use glam::DVec3;

use crate::image::bricks::Bricks;
use crate::memory::prefetch;
use crate::oracle::Oracle;
use crate::oracle::model::contacts::{self, Contacts};
use crate::oracle::model::indicator;
use crate::oracle::model::voxel::Voxel;
use crate::params::SurfaceModel;

impl Oracle {
    /// The dense id at a point; 0 outside the image.
    #[inline]
    pub fn label(&self, p: DVec3) -> u16 {
        self.label_at(self.grid.index_at(p))
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
            return (0..count).for_each(|i| found(i, label(i, self.grid.index_at(point(i)))));
        }
        let mut places = [(DVec3::ZERO, [0; 3], OUTSIDE); AT_ONCE];
        for from in (0..count).step_by(AT_ONCE) {
            let points = from..(from + AT_ONCE).min(count);
            for (i, place) in points.clone().zip(&mut places) {
                let x = self.grid.index_at(point(i));
                *place = if self.border.holds(x) || is_continued(i) {
                    let x = self.border.extend(x);
                    let cell = self.grid.cell(x);
                    let index = self.grid.bricks.index(cell[0], cell[1], cell[2]);
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
    pub fn distance_bound(&self, p: DVec3) -> f64 {
        self.distance_bound_at(self.grid.index_at(p))
    }

    #[inline(always)]
    pub(crate) fn label_at(&self, x: DVec3) -> u16 {
        if self.border.holds(x) { self.label_inside(x) } else { 0 }
    }

    /// The label of a point within the border.
    #[inline(always)]
    pub(crate) fn label_inside(&self, x: DVec3) -> u16 {
        match self.model {
            SurfaceModel::Smooth => {
                let x = self.border.extend(x);
                let cell = self.grid.cell(x);
                self.label_of(cell, self.at(cell), x)
            }
            SurfaceModel::Voxel => self.at(self.grid.voxel(x)).id(),
        }
    }

    /// The label in a cell of the smooth model.
    #[inline(always)]
    pub(crate) fn label_of(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> u16 {
        if voxel.rings() > 0 { voxel.id() } else { self.label_in(cell, voxel, x) }
    }

    /// The label in a mixed cell of the smooth model.
    #[inline(always)]
    pub(crate) fn label_in(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> u16 {
        if voxel.is_two() {
            let first = voxel.first_corners();
            let other = self.corner(cell, (!first).trailing_zeros());
            indicator::label_of_two(first, [voxel.id(), other], &self.weights, place(x, cell))
        } else if let Some(field) = &self.field {
            field.label(&self.grid.bricks, cell, place(x, cell))
        } else if voxel.contacts() != Contacts::None {
            self.label_at_contact(cell, x)
        } else {
            indicator::label(&self.corners(cell), &self.weights, self.max_weight, place(x, cell))
        }
    }

    /// The label in a cell with contacts.
    #[cold]
    fn label_at_contact(&self, cell: [usize; 3], x: DVec3) -> u16 {
        self.contact_cell(cell).label(place(x, cell))
    }

    /// A cell with contacts.
    pub(crate) fn contact_cell(&self, cell: [usize; 3]) -> contacts::Cell<'_> {
        let center = self.at(cell).contacts() == Contacts::Center;
        contacts::Cell { ids: self.corners(cell), weights: &self.weights, center }
    }

    #[inline(always)]
    pub(crate) fn distance_bound_at(&self, x: DVec3) -> f64 {
        if self.border.holds(x) {
            let cell = self.grid.cell(x);
            self.distance_bound_in(cell, self.at(cell), x)
        } else {
            self.distance_bound_outside(x)
        }
    }

    /// The distance bound of a point outside of the border.
    fn distance_bound_outside(&self, x: DVec3) -> f64 {
        let q = self.grid.inside(x);
        let cell = self.grid.cell(q);
        let within = self.distance_bound_in(cell, self.at(cell), q);
        let outside = ((x - q) * self.grid.spacing).length();
        if outside > 0.0 { outside.hypot(within) } else { within }
    }

    /// The distance bound of a point of a cell.
    #[inline(always)]
    pub(crate) fn distance_bound_in(&self, cell: [usize; 3], voxel: Voxel, x: DVec3) -> f64 {
        let rings = voxel.rings();
        if rings == 0 { 0.0 } else { self.to_faces(x, cell, f64::from(rings - 1)) }
    }

    /// Distance from a point of a cell to the faces of the block of cells around it, `more` on each
    /// side.
    #[inline(always)]
    pub(crate) fn to_faces(&self, x: DVec3, cell: [usize; 3], more: f64) -> f64 {
        let at = x - DVec3::from(cell.map(|c| c as f64));
        // Rounding of x must not matter.
        let min = at.min(1.0 - at) + (more - 1e-9);
        (min * self.grid.spacing).min_element().max(0.0)
    }

    #[inline(always)]
    pub(crate) fn at(&self, [i, j, k]: [usize; 3]) -> Voxel {
        self.voxels[self.grid.bricks.index(i, j, k)]
    }

    #[inline(always)]
    pub(crate) fn corners(&self, cell: [usize; 3]) -> indicator::Corners {
        corners(&self.voxels, &self.grid.bricks, cell)
    }

    /// The label of a corner of a cell.
    #[inline(always)]
    pub(crate) fn corner(&self, [i, j, k]: [usize; 3], corner: u32) -> u16 {
        let c = corner as usize;
        self.at([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)]).id()
    }
}

/// The place of no voxel.
const OUTSIDE: usize = usize::MAX;

/// The ids at the corners of a cell.
#[inline(always)]
pub(crate) fn corners(voxels: &[Voxel], b: &Bricks, [i, j, k]: [usize; 3]) -> indicator::Corners {
    let x = [b.x(i), b.x(i + 1)];
    let y = [b.y(j), b.y(j + 1)];
    let z = [b.z(k), b.z(k + 1)];
    std::array::from_fn(|c| voxels[x[c & 1] + y[c >> 1 & 1] + z[c >> 2]].id())
}

/// Coordinates of a point within its cell.
#[inline(always)]
pub(crate) fn place(x: DVec3, cell: [usize; 3]) -> [f32; 3] {
    [0, 1, 2].map(|a| (x[a] - cell[a] as f64) as f32)
}
