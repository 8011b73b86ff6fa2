//! Where the image cuts an object off.
//!
//! Outside of the grid all is background, and the grid ends half a voxel beyond its outermost voxel
//! centres. Where the object reaches that border it gets a flat wall there. Interpolation between
//! the outermost voxels and a background beyond them would round the edges of that wall, and what
//! it so loses would be paid for by label weights that move all other faces. So the smooth model
//! does not look beyond: between the outermost centres and the wall a point has the label of its
//! projection onto the plane of these centres.
//!
//! Region coordinates, whose first voxel lies outside of the image where the object reaches the
//! border.

use glam::{BVec3, DVec3};

use super::indicator::Corners;

/// The box in which labels may differ from the background, and how the labels within go on from the
/// outermost voxel centres to its faces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Border {
    /// The box: the walls, or the box of the region's voxel centres where there is none. On the
    /// faces without a wall all is background.
    pub(crate) lower: DVec3,
    pub(crate) upper: DVec3,
    /// The box of the voxel centres that count.
    pub(crate) first: DVec3,
    pub(crate) last: DVec3,
    /// Whether any face of the box is a wall.
    pub(crate) has_walls: bool,
}

impl Border {
    /// No walls.
    pub(crate) fn none(dims: [usize; 3]) -> Self {
        let last = DVec3::from(dims.map(|n| (n - 1) as f64));
        Self { lower: DVec3::ZERO, upper: last, first: DVec3::ZERO, last, has_walls: false }
    }

    /// Walls where the region of `dims` voxels from voxel `first` on reaches out of an image of
    /// `image` voxels.
    pub(crate) fn new(first: [isize; 3], dims: [usize; 3], image: [usize; 3]) -> Self {
        let mut border = Self::none(dims);
        for a in 0..3 {
            if first[a] < 0 {
                (border.lower[a], border.first[a]) = (0.5, 1.0);
                border.has_walls = true;
            }
            if first[a] + dims[a] as isize > image[a] as isize {
                border.upper[a] -= 0.5;
                border.last[a] -= 1.0;
                border.has_walls = true;
            }
        }
        border
    }

    /// Whether a point is inside; a NaN is not.
    #[inline(always)]
    pub(crate) fn holds(&self, x: DVec3) -> bool {
        x.cmpge(self.lower).all() && x.cmple(self.upper).all()
    }

    /// How many of a voxel's faces are on walls.
    #[inline]
    pub(crate) fn faces_of(&self, voxel: [usize; 3]) -> u32 {
        let at = DVec3::from(voxel.map(|c| c as f64));
        let lower = at.cmpeq(self.first) & self.lower.cmplt(self.first);
        let upper = at.cmpeq(self.last) & self.last.cmplt(self.upper);
        lower.bitmask().count_ones() + upper.bitmask().count_ones()
    }

    /// Whether a point is beyond a wall: not where a face of the box is none.
    #[inline]
    pub(crate) fn is_beyond(&self, x: DVec3) -> bool {
        let below = x.cmplt(self.lower) & self.lower.cmplt(self.first);
        (below | (x.cmpgt(self.upper) & self.last.cmplt(self.upper))).any()
    }

    /// The axes across which walls are no farther from a point of the box than `max` and than the
    /// outermost centres are; and the point of all these walls nearest to it.
    #[inline]
    pub(crate) fn drawn(&self, x: DVec3, max: DVec3) -> (BVec3, DVec3) {
        let lower = x.cmplt(self.first) & x.cmple(self.lower + max);
        let upper = x.cmpgt(self.last) & x.cmpge(self.upper - max);
        (lower | upper, DVec3::select(lower, self.lower, DVec3::select(upper, self.upper, x)))
    }

    /// The point of the box nearest to one.
    #[inline]
    pub(crate) fn back(&self, x: DVec3) -> DVec3 {
        x.max(self.lower).min(self.upper)
    }

    /// A point that is on a face of the box but for rounding, exactly there.
    #[inline]
    pub(crate) fn onto_face(&self, x: DVec3) -> DVec3 {
        const ROUNDING: f64 = 1e-6;
        let face = |x: f64, face: f64| if (x - face).abs() <= ROUNDING { face } else { x };
        DVec3::from([0, 1, 2].map(|a| face(face(x[a], self.lower[a]), self.upper[a])))
    }

    /// The axes across which a point lies on a face of the box.
    #[inline]
    pub(crate) fn around(&self, x: DVec3) -> impl Iterator<Item = usize> + use<> {
        let on_face = x.cmpeq(self.lower) | x.cmpeq(self.upper);
        (0..3).filter(move |&a| on_face.test(a))
    }

    /// The point that has the label of the inside point `x`: its projection, between outermost
    /// centres and wall.
    #[inline(always)]
    pub(crate) fn extend(&self, x: DVec3) -> DVec3 {
        x.max(self.first).min(self.last)
    }

    /// The coordinate of the wall that halves the cells of number `cell` along an axis.
    #[inline]
    pub(crate) fn wall_of(&self, axis: usize, cell: usize) -> Option<f64> {
        let at = cell as f64;
        match () {
            () if at < self.first[axis] => Some(self.lower[axis]),
            () if at >= self.last[axis] => Some(self.upper[axis]),
            () => None,
        }
    }

    /// Whether the model in a cell is that between its eight voxel centres, without walls.
    #[inline]
    pub(crate) fn leaves(&self, cell: [usize; 3]) -> bool {
        let at = DVec3::from(cell.map(|c| c as f64));
        at.cmpge(self.first).all() && at.cmplt(self.last).all()
    }

    /// [`Self::leaves`] of 64 cells along x from `cell` on, a bit for each.
    #[inline]
    pub(crate) fn leaves_of_row(&self, [i, j, k]: [usize; 3]) -> u64 {
        let [first, last] = [self.first.x as usize, self.last.x as usize];
        if !self.leaves([first, j, k]) {
            return 0;
        }
        let before = |end: usize| {
            u64::MAX.checked_shr(64 - end.saturating_sub(i).min(64) as u32).unwrap_or(0)
        };
        before(last) & !before(first)
    }

    /// The corner of a cell that each of its corners is projected onto: one that lies inside of the
    /// walls. In the cell's part there all points are projected onto its faces away from the walls.
    /// And how many walls halve the cell.
    #[inline]
    pub(crate) fn inner_corners(&self, cell: [usize; 3]) -> ([usize; 8], u32) {
        let (mut inner, mut halvings) = (std::array::from_fn(|c| c), 0);
        for a in 0..3 {
            let at = cell[a] as f64;
            // To which side corners are projected.
            let side = match () {
                () if at < self.first[a] => 1,
                () if at >= self.last[a] => 0,
                () => continue,
            };
            inner = inner.map(|c: usize| c & !(1 << a) | side << a);
            halvings += 1;
        }
        (inner, halvings)
    }

    /// The labels at the corners of a cell as the model has them inside of the walls, and how many
    /// walls halve the cell.
    #[inline]
    pub(crate) fn extend_corners(&self, cell: [usize; 3], ids: &Corners) -> (Corners, u32) {
        let (inner, halvings) = self.inner_corners(cell);
        (inner.map(|c| ids[c]), halvings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_row_are_those_told_one_by_one() {
        for (dims, first) in [
            ([150, 5, 4], [-1, -1, 0]),
            ([64, 4, 4], [0; 3]),
            ([66, 3, 4], [-1; 3]),
            ([3, 3, 3], [-1; 3]),
        ] {
            let image = [0, 1, 2].map(|a| dims[a] - [2, 0, 1][a]);
            let border = Border::new(first, dims, image);
            for i in [0, 64, 128] {
                for (j, k) in (0..dims[1]).flat_map(|j| (0..dims[2]).map(move |k| (j, k))) {
                    let one_by_one = (0..64)
                        .fold(0, |bits, n| bits | u64::from(border.leaves([i + n, j, k])) << n);
                    assert_eq!(
                        border.leaves_of_row([i, j, k]),
                        one_by_one,
                        "{dims:?} {first:?}: {i} {j} {k}"
                    );
                }
            }
        }
    }
}
