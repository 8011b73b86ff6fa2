//! Junctions: lines where three or more labels meet, points where four or more do, and where the
//! image cuts the object off the sharp edges and corners of the wall.
//!
//! Lines are found where they cross planes, as many in each cell along each axis as asked for. In
//! the smooth model the ties of three labels on such a plane, and of four within a cell, are those
//! of `ties`. The outside of a wall counts as a label of its own: an interface, or an edge of the
//! object, ends at a wall in a line, and walls meet in lines and corners. Between the outermost
//! voxel centres and a wall the model does not change along the wall's normal (`border`), so
//! junctions there are those of a model of one dimension less, continued straight to the wall;
//! their coordinates on walls are exact.
//!
//! Each cell has planes of its own: on those of a grid the points of straight junctions would be
//! massively cocircular.
//!
//! In the voxel model lines run from the centres of cells, where eight voxels meet, to the centres
//! of faces of cells around which three or more labels are; of the centres themselves only those on
//! walls are given.
//!
//! Which cells there are to be looked at is kept as a set of bits: `Block::junctions` in `voxel`.
//!
//! Not junctions: lines in which the boundary of a label touches itself between two labels. Of
//! intensities, probabilities and smoothed labels only those on walls are looked for.
//!
//! Cost: a microsecond or so for a cell of three labels or more; others are passed over.

use glam::DVec3;

use super::edges::{BrickRow, parts_of};
use super::ties::Cube;
use crate::Result;
use crate::image::bits::ones;
use crate::image::palette::Palette;
use crate::oracle::Oracle;
use crate::oracle::model::indicator::Corners;
use crate::oracle::model::weights::hash;
use crate::params::SurfaceModel;

/// How far samples of lines are moved along each axis at most, in voxels. Where lines of a cell
/// mirror each other so do the points in which a plane cuts them: with those of another plane they
/// would be in one plane and on one circle.
const MOVE: f64 = 0.005;

/// How far beside a point the planes are by which a junction near it is found, in parts of the
/// reach.
const BESIDE: f64 = 0.1;

/// What meets at a point of a junction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JunctionKind {
    /// A corner of the image's box that the object has: where three walls meet.
    BoxCorner,
    /// Four labels or more, the outside of each wall one of them: where lines meet.
    Corner,
    /// Three labels: a point of a line.
    Line,
}

/// The planes on which junctions are looked for; see [`Oracle::junction_planes`].
pub struct JunctionPlanes<'a> {
    oracle: &'a Oracle,
    cuts: Cuts<'a>,
}

/// Which planes cut cells.
enum Cuts<'a> {
    /// For each cell its own: so many across each axis.
    Spaced(Palette<'a, [usize; 3]>),
    /// Those through a point, in region coordinates.
    Through(DVec3),
}

/// A tie of three labels in a cell: their bits, and where it is in the cell.
type Tie = (u64, DVec3);

impl Oracle {
    /// Planes as far apart as `spacings` tell of cells, about; one to eight between two voxel
    /// centres.
    pub fn junction_planes<'a>(&'a self, spacings: &Palette<'a, f64>) -> JunctionPlanes<'a> {
        let parts = spacings.map(|&spacing| parts_of((self.grid.spacing / spacing).ceil()));
        JunctionPlanes { oracle: self, cuts: Cuts::Spaced(parts) }
    }

    /// About the nearest point of a junction to `p`, if one is nearer than `reach`: the nearest of
    /// those on the planes across the axes through `p`, one of which cuts a straight line no
    /// farther from `p` than the square root of three times the line's distance. A point of a
    /// junction is its own nearest one, but for rounding.
    pub fn nearest_junction(&self, p: DVec3, reach: f64) -> Option<DVec3> {
        self.nearest_on_planes(p, DVec3::ZERO, reach)
    }

    /// The same for what is inserted, by planes beside `p`: for points that mirror each other on
    /// parallel lines it would be in fours on a circle.
    pub fn nearest_junction_to_insert(&self, p: DVec3, reach: f64) -> Option<DVec3> {
        self.nearest_on_planes(p, BESIDE * reach * random_of(p), reach)
    }

    /// The nearest point to `p` of those on the planes through `p + off`.
    fn nearest_on_planes(&self, p: DVec3, off: DVec3, reach: f64) -> Option<DVec3> {
        let x = self.grid.index_at(p);
        let through = x + off / self.grid.spacing;
        let planes = JunctionPlanes { oracle: self, cuts: Cuts::Through(through) };
        let last = self.grid.last - 1.0;
        let cell_of = |x: DVec3| x.max(DVec3::ZERO).min(last).to_array().map(|c| c as usize);
        let [low, high, cut] =
            [x - reach / self.grid.spacing, x + reach / self.grid.spacing, through].map(cell_of);
        let (mut nearest, mut squared) = (None, reach * reach);
        let mut ties = Vec::new();
        // Not inclusive: those ranges are slower.
        for j in low[1]..high[1] + 1 {
            for k in low[2]..high[2] + 1 {
                let mut first = low[0];
                while first <= high[0] {
                    let count = (high[0] + 1 - first).min(64);
                    for n in ones(self.junction_cells.bits([first, j, k], count)) {
                        let cell = [first + n, j, k];
                        // At a wall corners are known without planes.
                        let is_cut = (0..3).any(|a| cell[a] == cut[a]) || !self.walls.leaves(cell);
                        if !is_cut || self.squared_distance_to_cell(x, cell) >= squared {
                            continue;
                        }
                        // Never an error.
                        let _ = planes.visit_mixed_cell(cell, &mut ties, &mut |_, x| {
                            let q = self.grid.point_at(x);
                            if q.distance_squared(p) < squared {
                                (nearest, squared) = (Some(q), q.distance_squared(p));
                            }
                            Ok(())
                        });
                    }
                    first += count;
                }
            }
        }
        nearest
    }

    /// The squared distance, in world units, from a point to a cell, but for rounding.
    fn squared_distance_to_cell(&self, x: DVec3, cell: [usize; 3]) -> f64 {
        let from = x - low_corner(cell);
        let beside = (-from).max(from - 1.0).max(DVec3::ZERO);
        (beside * self.grid.spacing).length_squared() * (1.0 - 1e-9)
    }
}

impl JunctionPlanes<'_> {
    pub(crate) fn oracle(&self) -> &Oracle {
        self.oracle
    }

    /// Calls `visit` for the points, in world coordinates, of one row of bricks of voxels, numbered
    /// as by [`EdgeGrid::rows`](crate::oracle::EdgeGrid::rows). Each point is in one row, there
    /// once or more often.
    ///
    /// # Errors
    /// What `visit` returns; the first ends the visit.
    pub fn visit_row<'b>(
        &self,
        row: impl Into<BrickRow<'b>>,
        mut visit: impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        let mut ties = Vec::new();
        self.oracle.visit_junction_cells(row.into(), |cell| {
            self.visit_mixed_cell(cell, &mut ties, &mut |kind, x| {
                visit(kind, self.oracle.grid.point_at(x))
            })
        })
    }

    // Not inlined: what it needs of a cell would be computed for every row of cells, most of which
    // have none.
    #[inline(never)]
    fn visit_mixed_cell(
        &self,
        cell: [usize; 3],
        ties: &mut Vec<Tie>,
        visit: &mut impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        let oracle = self.oracle;
        let at_wall = !oracle.walls.leaves(cell);
        let corners = oracle.corners(cell);
        match oracle.model {
            SurfaceModel::Smooth if at_wall => self.visit_cell_at_wall(cell, visit),
            SurfaceModel::Smooth => self.visit_cell(cell, &corners, ties, visit),
            SurfaceModel::Voxel => self.visit_voxel_cell(cell, &corners, visit),
        }
    }

    /// Where the planes across an axis cut a cell.
    pub(crate) fn cuts(&self, cell: [usize; 3], axis: usize) -> impl Iterator<Item = f64> + use<> {
        let (parts, through) = match &self.cuts {
            Cuts::Spaced(parts) => {
                let [i, j, k] = cell;
                (parts.at(self.oracle.grid.bricks.index(i, j, k))[axis], None)
            }
            Cuts::Through(x) => {
                let at = x[axis] - cell[axis] as f64;
                (usize::from((0.0..1.0).contains(&at)), Some(at))
            }
        };
        // A plane for each part of the cell, which keeps off its ends.
        let random = hash(cell) >> (16 * axis) & 0xffff;
        (0..parts).map(move |part| {
            let random = ((random + 0x9e37 * part as u64) & 0xffff) as f64 / f64::from(1 << 16);
            through.unwrap_or((part as f64 + 0.25 + 0.5 * random) / parts as f64)
        })
    }

    /// A cell of the smooth model away from all walls.
    fn visit_cell(
        &self,
        cell: [usize; 3],
        corners: &Corners,
        ties: &mut Vec<Tie>,
        visit: &mut impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        let cube = Cube::new(corners, &self.oracle.weights);
        let low = low_corner(cell);
        ties.clear();
        let cut = |axis: usize, at: f64, ties: &mut Vec<Tie>| {
            cube.cut(axis, at).ties_of_three(|labels, [u, v]| {
                let mut x = DVec3::ZERO;
                (x[axis], x[(axis + 1) % 3], x[(axis + 2) % 3]) = (at, u, v);
                ties.push((labels, x));
            });
        };
        (0..3).for_each(|axis| self.cuts(cell, axis).for_each(|at| cut(axis, at, ties)));
        let of_lines = ties.len();
        if cube.count() >= 4 && matches!(self.cuts, Cuts::Spaced(_)) {
            // A line that ends in a corner within the cell, or its other end, crosses a face.
            (0..3).for_each(|axis| [0.0, 1.0].into_iter().for_each(|at| cut(axis, at, ties)));
            corners_between(&cube, ties)
                .into_iter()
                .try_for_each(|x| visit(JunctionKind::Corner, low + x))?;
        }
        let max = if matches!(self.cuts, Cuts::Spaced(_)) { MOVE } else { 0.0 };
        ties[..of_lines].iter().try_for_each(|&(_, x)| {
            let x = low + x;
            visit(JunctionKind::Line, x + max * random_of(x))
        })
    }

    /// A cell of the voxel model: what is on the rays from its centre to those of its faces.
    fn visit_voxel_cell(
        &self,
        cell: [usize; 3],
        corners: &Corners,
        visit: &mut impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        let walls = &self.oracle.walls;
        // What is outside of some walls counts as a label of its own.
        let labels: [u32; 8] = std::array::from_fn(|c| {
            let at = [0, 1, 2].map(|a| (cell[a] + (c >> a & 1)) as f64);
            let outside = (0..3).filter(|&a| at[a] < walls.first[a] || at[a] > walls.last[a]);
            outside.fold(u32::from(corners[c]), |label, a| label | 1 << (16 + a))
        });
        let is_line = |axis: usize, side: usize| {
            let mut around: Vec<u32> =
                (0..8).filter(|c| c >> axis & 1 == side).map(|c| labels[c]).collect();
            around.sort_unstable();
            around.dedup();
            around.len() >= 3 && around.iter().any(|&label| label as u16 != 0)
        };
        let low = low_corner(cell);
        let center = low + 0.5;
        let lines = [0, 1, 2].map(|axis| [is_line(axis, 0), is_line(axis, 1)]);
        // Inside of the image all centres of cells together would be massively cocircular.
        let straight = lines.iter().flatten().filter(|&&line| line).count() == 2
            && lines.contains(&[true, true]);
        if !walls.leaves(cell) && lines.as_flattened().contains(&true) && !straight {
            let is_of_box = (0..3).all(|a| walls.wall_of(a, cell[a]).is_some());
            visit(if is_of_box { JunctionKind::BoxCorner } else { JunctionKind::Corner }, center)?;
        }
        for (axis, sides) in lines.into_iter().enumerate() {
            for at in self.cuts(cell, axis).filter(|&at| sides[usize::from(at > 0.5)]) {
                let mut x = center;
                x[axis] = low[axis] + at;
                visit(JunctionKind::Line, x)?;
            }
        }
        Ok(())
    }
}

/// A vector with coordinates between -1 and 1 that looks random and depends on `p` alone.
pub(crate) fn random_of(p: DVec3) -> DVec3 {
    let bits = hash([0, 1, 2].map(|a| p[a].to_bits() as usize));
    DVec3::from([0, 1, 2].map(|a| (bits >> (21 * a) & 0x1f_ffff) as f64 / f64::from(1 << 20) - 1.0))
}

pub(crate) fn low_corner(cell: [usize; 3]) -> DVec3 {
    DVec3::from(cell.map(|c| c as f64))
}

/// Where four labels of a cell tie: where lines of it meet, of which these are points.
fn corners_between(cube: &Cube, ties: &[Tie]) -> Vec<DVec3> {
    let mut sets: Vec<u64> = Vec::new();
    for (n, &(first, _)) in ties.iter().enumerate() {
        for &(second, _) in &ties[..n] {
            let four = first | second;
            if four.count_ones() == 4 && !sets.contains(&four) {
                sets.push(four);
            }
        }
    }
    let corner = |four: u64| {
        let lines = ties.iter().filter(|&&(labels, _)| labels & !four == 0);
        let (sum, count) =
            lines.fold((DVec3::ZERO, 0.0), |(sum, count), &(_, x)| (sum + x, count + 1.0));
        let mut labels = (0..8).filter(|l| four >> l & 1 == 1);
        cube.tie_of_four([(); 4].map(|()| labels.next().unwrap_or(0)), sum / count)
    };
    sets.into_iter().filter_map(corner).collect()
}
