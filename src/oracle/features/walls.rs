//! Walls: the flat faces where the image cuts the object off.
//!
//! Which walls a point is on, and the labels continued straight beyond them: `border` says where
//! they are. Between the outermost voxel centres and a wall the model does not change along the
//! wall's normal. So the model on a wall has one dimension less, and its junctions are found on a
//! square (a wall), on a segment (an edge of two walls) and in a point (a corner of three).
//!
//! - On a wall: the *rims*, where the label changes, and their ends and branchings, where three
//!   labels meet. From these a line runs straight to the plane of the outermost centres.
//! - On the edge of two walls: the edge itself where the object has it, and where the label
//!   changes.
//! - The corner of three walls, where the object has it.
//!
//! Coordinates on walls are exact. All this holds for labels, intensities, probabilities and
//! smoothed labels alike: what is asked of a cell is the labels that may win and their values at
//! its corners.

use glam::DVec3;

use super::junctions::{JunctionKind, JunctionPlanes, low_corner, random_of};
use super::ties::Square;
use crate::Result;
use crate::image::Wall;
use crate::oracle::Oracle;
use crate::oracle::model::field::MAX_RIVALS;
use crate::oracle::model::indicator;
use crate::params::SurfaceModel;

/// The walls that a point is on: for each axis of the image the coordinate of the wall across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walls([Option<f64>; 3]);

impl Walls {
    /// No walls.
    pub const NONE: Self = Self([None; 3]);

    /// How many.
    pub fn count(&self) -> usize {
        self.0.iter().flatten().count()
    }

    /// Whether they are the far ones: for each axis the wall across it, if there is one here.
    fn far(&self, upper: DVec3) -> [Option<bool>; 3] {
        [0, 1, 2].map(|a| self.0[a].map(|x| x == upper[a]))
    }

    /// The walls that two points are both on.
    pub fn common(&self, other: &Self) -> Self {
        Self([0, 1, 2].map(|a| self.0[a].filter(|_| self.0[a] == other.0[a])))
    }
}

/// How far around a vertex of an interface background is looked for, in voxels: more than what
/// vertices are moved by, but where a mesh is coarsened. Improvement does nothing that makes a
/// facet count as off a wall.
const AROUND: f64 = 0.25;

impl Oracle {
    /// Whether an outer facet should lie on a wall and does not; its normal times `outwards` points
    /// out of the mesh.
    ///
    /// An outer facet with a vertex on a wall either lies on the wall or is part of an interface
    /// that ends there. If it is part of an interface, the image has background next to it on its
    /// outer side. If the way from its centroid along its outer normal stays within the object up
    /// to the wall, and one of its vertices has no background around it, what lies between is
    /// missing. (The vertices of an interface are on it, its facets only near it.)
    pub fn is_off_wall(&self, corners @ [a, b, c]: [DVec3; 3], outwards: f64) -> bool {
        let walls = corners.map(|p| self.walls_at(p));
        let [first, second, third] = &walls;
        if walls.iter().all(|walls| *walls == Walls::NONE)
            || first.common(second).common(third).count() > 0
        {
            return false;
        }
        let normal = (b - a).cross(c - a).normalize_or_zero() * outwards;
        let reach = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let centroid = (a + b + c) / 3.0;
        if self.label(centroid) == 0 {
            return false;
        }
        // As far as the facet reaches.
        self.first_background(centroid, centroid + reach * normal).is_some_and(|end| {
            self.is_on_wall(end) && corners.iter().any(|&p| !self.has_label_near(p, 0, AROUND))
        })
    }

    /// Whether a point is on a wall, but for rounding.
    pub fn is_on_wall(&self, p: DVec3) -> bool {
        self.walls.around(self.walls.onto_face(self.grid.index_at(p))).next().is_some()
    }

    /// The walls that a point is on, but for rounding.
    #[inline]
    pub fn walls_at(&self, p: DVec3) -> Walls {
        if self.walls.has_walls { self.walls_there(p) } else { Walls::NONE }
    }

    fn walls_there(&self, p: DVec3) -> Walls {
        let x = self.walls.onto_face(self.grid.index_at(p));
        let mut walls = Walls::NONE;
        for a in self.walls.around(x) {
            walls.0[a] = Some(x[a]);
        }
        walls
    }

    /// The wall that a facet lies on.
    pub fn wall_of_facet(&self, corners: [DVec3; 3]) -> Wall {
        if !self.walls.has_walls {
            return Wall::None;
        }
        let [first, second, third] = corners.map(|p| self.walls_at(p));
        let common = first.common(&second).common(&third);
        let far = common.far(self.walls.upper);
        // A facet lies on one, since its corners are not on a line.
        let on = (0..3).find_map(|a| Some(Wall::OF_AXES[a][usize::from(far[a]?)]));
        on.unwrap_or_default()
    }

    /// The point of these walls nearest to `p`; `p` itself where there is none.
    pub fn onto_walls(&self, p: DVec3, walls: Walls) -> DVec3 {
        if walls.count() == 0 {
            return p;
        }
        let mut x = self.grid.index_at(p);
        for a in 0..3 {
            x[a] = walls.0[a].unwrap_or(x[a]);
        }
        self.grid.point_at(x)
    }

    /// A point of the same wall no farther than `max` from `p`, if that lies on one wall and not
    /// on the edge of two. Points on walls that meet at a right angle mirror each other, in fours
    /// on a circle; where it is moved to looks random.
    pub fn moved_on_wall(&self, p: DVec3, max: f64) -> Option<DVec3> {
        let mut x = self.walls.onto_face(self.grid.index_at(p));
        let mut walls = self.walls.around(x);
        let [Some(normal), None] = [walls.next(), walls.next()] else {
            return None;
        };
        let random = random_of(p);
        for a in [(normal + 1) % 3, (normal + 2) % 3] {
            x[a] += std::f64::consts::FRAC_1_SQRT_2 * max * random[a] / self.grid.spacing[a];
        }
        (self.label_at(x) != 0).then(|| self.grid.point_at(x))
    }

    /// Whether a point is no farther than `max` from a wall, or beyond it.
    #[inline]
    pub fn is_near_wall(&self, p: DVec3, max: f64) -> bool {
        self.walls.has_walls && {
            let (x, max) = (self.grid.index_at(p), max / self.grid.spacing);
            self.walls.is_beyond(x + max) || self.walls.is_beyond(x - max)
        }
    }

    /// Whether a label, continued beyond the walls, is found around a point, `voxels` away.
    pub fn has_label_near(&self, p: DVec3, label: u16, voxels: f64) -> bool {
        let x = self.grid.index_at(p);
        let step = |n: usize| {
            DVec3::from([n % 3, n / 3 % 3, n / 9].map(|c| c as f64 - 1.0)).normalize_or_zero()
        };
        (0..27).any(|n| self.continued_label_at(x + voxels * step(n)) == label)
    }

    /// Where a point of dO may be moved onto walls that are no farther than `max` from it: first
    /// onto all of them, then onto the nearest one, and so on. It stays on dO, as it is beyond the
    /// outermost voxel centres.
    pub fn drawn_to_walls(&self, p: DVec3, max: f64) -> impl Iterator<Item = DVec3> {
        let x = self.grid.index_at(p);
        let (axes, all) = self.walls.drawn(x, max / self.grid.spacing);
        let mut moves = [0, 1, 2].map(|a| (((all[a] - x[a]) * self.grid.spacing[a]).abs(), a));
        moves.sort_by(|a, b| a.0.total_cmp(&b.0));
        let single = moves.map(|(by, a)| {
            let mut y = x;
            y[a] = all[a];
            (axes.test(a) && by > 0.0).then_some(y)
        });
        let is_several = single.iter().flatten().count() > 1;
        let points = [is_several.then_some(all)].into_iter().chain(single).flatten();
        points.map(|y| self.grid.point_at(y))
    }

    /// Whether the image cuts the object off anywhere.
    #[inline]
    pub fn has_walls(&self) -> bool {
        self.walls.has_walls
    }

    /// Whether a point is beyond a wall.
    #[inline]
    pub fn is_beyond_walls(&self, p: DVec3) -> bool {
        self.walls.has_walls && self.walls.is_beyond(self.grid.index_at(p))
    }

    /// The point within the walls nearest to `p`, if that is beyond a wall: on the wall, or where
    /// walls meet.
    pub fn back_to_walls(&self, p: DVec3) -> Option<DVec3> {
        let x = self.grid.index_at(p);
        self.walls.is_beyond(x).then(|| self.grid.point_at(self.walls.back(x)))
    }

    /// The dense id at a point, the labels being continued straight beyond the walls.
    #[inline]
    pub fn continued_label(&self, p: DVec3) -> u16 {
        self.continued_label_at(self.grid.index_at(p))
    }

    #[inline]
    pub(crate) fn continued_label_at(&self, x: DVec3) -> u16 {
        match self.model {
            SurfaceModel::Smooth => self.label_inside(x),
            // Of the voxel that it is nearest to.
            SurfaceModel::Voxel => self.label_inside(self.walls.extend(x)),
        }
    }
}

/// A square on a wall: the numbers of its labels are places in `ids`.
type WallSquare = Square<MAX_RIVALS>;

/// The model of a cell that walls halve, on the walls' side of its outermost voxel centres.
struct CellAtWall {
    ids: Vec<u16>,
    /// Of each label the value at each corner, all of which are projected into the walls.
    values: Vec<[f64; 8]>,
}

impl CellAtWall {
    fn new(oracle: &Oracle, cell: [usize; 3]) -> Self {
        let (inner, _) = oracle.walls.inner_corners(cell);
        let mut model = Self { ids: Vec::new(), values: Vec::new() };
        match &oracle.field {
            Some(field) => field.visit_rivals(&oracle.grid.bricks, cell, |id, values| {
                model.ids.push(id);
                model.values.push(inner.map(|c| f64::from(values[c])));
            }),
            None => {
                let corners = oracle.corners(cell);
                let ids = inner.map(|c| corners[c]);
                for id in indicator::labels(&ids, 0xff) {
                    let weight = f64::from(oracle.weights[usize::from(id)]);
                    model.ids.push(id);
                    model.values.push(ids.map(|other| if other == id { weight } else { 0.0 }));
                }
            }
        }
        model
    }

    /// The square whose corners are these four of the cell.
    fn square(&self, corners: [usize; 4]) -> WallSquare {
        Square::new(self.values.iter().map(|values| corners.map(|c| values[c])))
    }

    fn leader(&self, square: &WallSquare, at: [f64; 2]) -> u16 {
        self.ids[square.leader(at)]
    }

    /// Calls `visit` where the label changes along a line of a square; see [`Square::changes`].
    fn changes(&self, square: &WallSquare, along: usize, at: f64, mut visit: impl FnMut(f64)) {
        square.changes(along, at, |s, [before, past]| {
            if self.ids[before] != self.ids[past] {
                visit(s);
            }
        });
    }
}

impl JunctionPlanes<'_> {
    /// A cell of the smooth model that one, two or three walls halve.
    pub(crate) fn visit_cell_at_wall(
        &self,
        cell: [usize; 3],
        visit: &mut impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        let oracle = self.oracle();
        let model = CellAtWall::new(oracle, cell);
        let low = low_corner(cell);
        let across = [0, 1, 2].map(|a| oracle.walls.wall_of(a, cell[a]));
        let mut x = DVec3::from([0, 1, 2].map(|a| across[a].unwrap_or(low[a])));
        match across {
            [Some(_), Some(_), Some(_)] => {
                if model.leader(&model.square([0; 4]), [0.0; 2]) != 0 {
                    self.visit_end(JunctionKind::BoxCorner, cell, x, across, visit)?;
                }
            }
            // A wall.
            [Some(_), None, None] | [None, Some(_), None] | [None, None, Some(_)] => {
                let normal = across.iter().position(Option::is_some).unwrap_or(0);
                let axes @ [u, v] = [(normal + 1) % 3, (normal + 2) % 3];
                let square = model.square(std::array::from_fn(|c| (c & 1) << u | (c >> 1) << v));
                let mut ties = Vec::new();
                square.ties_of_three(|_, at| ties.push(at));
                for at in ties {
                    (x[u], x[v]) = (low[u] + at[0], low[v] + at[1]);
                    self.visit_end(JunctionKind::Corner, cell, x, across, visit)?;
                }
                for (n, along) in axes.into_iter().enumerate() {
                    let beside = axes[1 - n];
                    for at in self.cuts(cell, beside) {
                        let mut changes = Vec::new();
                        model.changes(&square, n, at, |s| changes.push(s));
                        for s in changes {
                            (x[along], x[beside]) = (low[along] + s, low[beside] + at);
                            visit(JunctionKind::Line, x)?;
                        }
                    }
                }
            }
            // The edge of two walls: a square that does not change along its second axis.
            _ => {
                let along = across.iter().position(Option::is_none).unwrap_or(0);
                let edge = model.square([0, 1 << along, 0, 1 << along]);
                for at in self.cuts(cell, along) {
                    if model.leader(&edge, [at, 0.0]) != 0 {
                        x[along] = low[along] + at;
                        visit(JunctionKind::Line, x)?;
                    }
                }
                let mut changes = Vec::new();
                model.changes(&edge, 0, 0.0, |s| changes.push(s));
                for s in changes {
                    x[along] = low[along] + s;
                    self.visit_end(JunctionKind::Corner, cell, x, across, visit)?;
                }
            }
        }
        Ok(())
    }

    /// A corner `x`, of that kind, on the walls `across` some axes, and the lines that run from it
    /// straight to the outermost voxel centres: each leaves one of the walls.
    fn visit_end(
        &self,
        kind: JunctionKind,
        cell: [usize; 3],
        x: DVec3,
        across: [Option<f64>; 3],
        visit: &mut impl FnMut(JunctionKind, DVec3) -> Result<()>,
    ) -> Result<()> {
        visit(kind, x)?;
        let walls = &self.oracle().walls;
        for a in (0..3).filter(|&a| across[a].is_some()) {
            for at in self.cuts(cell, a).map(|at| cell[a] as f64 + at) {
                if at > walls.lower[a] && at < walls.upper[a] {
                    let mut on_line = x;
                    on_line[a] = at;
                    visit(JunctionKind::Line, on_line)?;
                }
            }
        }
        Ok(())
    }
}
