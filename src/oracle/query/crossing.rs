//! Where a segment first leaves a label.
//!
//! The segment is walked cell by cell. From a cell of one label the step leads to where the segment
//! leaves the rings of such cells around it (D. Cohen, Z. Sheffer, "Proximity clouds, an
//! acceleration technique for 3D grid traversal", The Visual Computer 11, 1994). In a cell of
//! several labels the first change along the segment is found exactly, as a root of a cubic
//! polynomial. In the voxel model cells are voxels, and the crossing is the face where one is
//! entered.
//!
//! Steps are measured in voxels along the image axis where the segment is longest.

use glam::DVec3;

use crate::oracle::model::contacts::Contacts;
use crate::oracle::model::{border::Border, indicator, voxel::Voxel};
use crate::oracle::{Crossing, Oracle};
use crate::params::SurfaceModel;

/// Width of the final bracket.
const TOLERANCE: f64 = 5e-4;

/// The points from + t * way, in region coordinates, and what does not change along them.
struct Line {
    from: DVec3,
    way: DVec3,
    inverse: DVec3,
    /// t of one step's measure.
    unit: f64,
}

impl Line {
    /// `None` when the way is zero or not finite.
    fn new(from: DVec3, way: DVec3) -> Option<Self> {
        let longest = way.abs().max_element();
        // Adding 0 makes zeros positive, which `exit` relies on.
        let inverse = (way + DVec3::ZERO).recip();
        (longest > 0.0 && way.is_finite() && from.is_finite()).then(|| Self {
            from,
            way,
            inverse,
            unit: 1.0 / longest,
        })
    }

    #[inline(always)]
    fn at(&self, t: f64) -> DVec3 {
        self.from + self.way * t
    }

    /// Position in a cell of the point that has the label of t, moved to its nearest point:
    /// rounding may place the ends of the line's part in the cell just outside.
    #[inline(always)]
    fn in_cell(&self, t: f64, cell: [usize; 3], border: &Border) -> [f32; 3] {
        // In one cell either no point is projected along an axis or all are, so that the part of
        // the line stays straight.
        let x = border.extend(self.at(t));
        [0, 1, 2].map(|a| ((x[a] - cell[a] as f64) as f32).clamp(0.0, 1.0))
    }

    /// The range of t in the box; empty (start above end) when the line misses it.
    fn span(&self, Border { lower, upper, .. }: &Border) -> (f64, f64) {
        let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
        for a in 0..3 {
            if self.way[a] == 0.0 {
                if !(lower[a]..=upper[a]).contains(&self.from[a]) {
                    return (f64::INFINITY, f64::NEG_INFINITY);
                }
            } else {
                let (p, q) = (
                    (lower[a] - self.from[a]) * self.inverse[a],
                    (upper[a] - self.from[a]) * self.inverse[a],
                );
                start = start.max(p.min(q));
                end = end.min(p.max(q));
            }
        }
        (start, end)
    }

    /// Where the line leaves the box, and along which axis.
    #[inline(always)]
    fn exit(&self, low: DVec3, high: DVec3) -> (f64, usize) {
        let mut first = (f64::INFINITY, 0);
        for a in 0..3 {
            // Along an axis on which the line does not move this is infinite or no number, and
            // never the first.
            let face = if self.way[a] < 0.0 { low[a] } else { high[a] };
            let t = (face - self.from[a]) * self.inverse[a];
            if t < first.0 {
                first = (t, a);
            }
        }
        first
    }
}

impl Oracle {
    /// Where the segment from `a` to `b` first leaves the label of `a`. Never `None` when the
    /// labels of `a` and `b` differ. Nor is a shorter stay in another label missed, but for
    /// rounding.
    pub fn first_crossing(&self, a: DVec3, b: DVec3) -> Option<Crossing> {
        self.first_crossing_from(self.label(a), a, b)
    }

    /// As [`Self::first_crossing`], by a caller who knows the label `from` of `a`.
    pub fn first_crossing_from(&self, from: u16, a: DVec3, b: DVec3) -> Option<Crossing> {
        let (point, to) = self.trace(self.grid.index_at(a), self.grid.index_at(b), from)?;
        Some(Crossing { point: self.grid.point_at(point), from, to })
    }

    /// Where the segment from `a` to `b` first reaches background, whatever labels come before.
    pub fn first_background(&self, a: DVec3, b: DVec3) -> Option<DVec3> {
        let [x, target] = [a, b].map(|p| self.grid.index_at(p));
        let line = Line::new(x, target - x)?;
        // Each part of the way begins a little past the crossing before it. Where three labels meet
        // rounding may give a crossing at the very start of a part, back to the label before it.
        let step = 2.0 * TOLERANCE * line.unit;
        let mut t = 0.0;
        while t < 1.0 {
            let from = line.at(t);
            let label = self.label_at(from);
            if label == 0 {
                return Some(self.grid.point_at(from));
            }
            let (crossing, to) = self.trace(from, target, label)?;
            if to == 0 {
                return Some(self.grid.point_at(crossing));
            }
            let reached = (crossing - x).dot(line.way) / line.way.length_squared();
            let next = reached.max(t) + step;
            // On a way so long that a step is lost in rounding the search ends.
            if next <= t {
                return None;
            }
            t = next;
        }
        None
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

    /// First point on the way from x, whose label is `from`, to `target` that leaves this label,
    /// and the label past it; region coordinates. Found for certain when the label of `target` is
    /// another one.
    pub(crate) fn trace(&self, x: DVec3, target: DVec3, from: u16) -> Option<(DVec3, u16)> {
        let mut line = Line::new(x, target - x)?;
        // Outside the border all is background.
        let (enter, leave) = line.span(&self.border);
        let first = enter.clamp(0.0, 1.0);
        let (stop, end) = (leave.min(1.0) - first, 1.0 - first);
        // From here t counts from the first point in the box: circumcenters may be so far away that
        // rounding would swallow the steps.
        line.from = line.at(first);
        // Cells are stepped by index (J. Amanatides, A. Woo, Eurographics 1987), not looked up by
        // position: on a face, rounding could find the same one again and again. The label is
        // `from` up to `known`; the part of the way in the cell starts there.
        let (shift, max) = match self.model {
            SurfaceModel::Smooth => (0.0, 2),
            SurfaceModel::Voxel => (-0.5, 1),
        };
        let locate = |t: f64| {
            let at = line.at(t).max(DVec3::ZERO).min(self.grid.last);
            if self.model == SurfaceModel::Smooth {
                self.grid.cell(at)
            } else {
                self.grid.voxel(at)
            }
        };
        if enter > 0.0 && enter < leave.min(1.0) {
            // Into a wall.
            let entry = self.border.onto_face(line.from);
            let id = self.label_inside(entry);
            if id != from {
                return Some((entry, id));
            }
        }
        let mut known = 0.0;
        let mut cell = locate(known);
        // The face through which the cell was entered: in the voxel model crossings are on it, not
        // beside it by rounding.
        let mut entrance = (0, line.from.x);
        while known < stop {
            let voxel = self.at(cell);
            // Cells of one label beside this one, on each side. In the voxel model as many voxels:
            // the corners of these cells.
            let beside = voxel.rings().saturating_sub(1) as usize;
            let low = DVec3::from(cell.map(|c| c as f64)) + shift;
            let (exit, axis) = line.exit(low - beside as f64, low + (1 + beside) as f64);
            let (exit, t) = (exit.max(known), known);
            let part = exit.min(stop);
            if self.model == SurfaceModel::Smooth && voxel.rings() == 0 {
                let ends = [t, part].map(|t| line.in_cell(t, cell, &self.border));
                // A part of no length has any tolerance, but no negative one: the exit may be -0.
                let tolerance = TOLERANCE * line.unit / (part - t).abs();
                if let Some((s, to)) = self.overtaken(cell, voxel, from, ends, tolerance) {
                    return Some((line.at(t + (part - t) * s), to));
                }
            } else if voxel.id() != from {
                let mut x = line.at(t);
                x[entrance.0] = entrance.1;
                return Some((x, voxel.id()));
            }
            known = part;
            // Across the face; along the other axes it may be any of the next cells that have it.
            let across = if line.way[axis] > 0.0 {
                cell[axis] + beside + 1
            } else {
                cell[axis].wrapping_sub(beside + 1)
            };
            if across > self.grid.bricks.dims()[axis] - max {
                break;
            }
            entrance =
                (axis, across as f64 + if line.way[axis] > 0.0 { shift } else { shift + 1.0 });
            if beside > 0 {
                cell = locate(known);
            }
            cell[axis] = across;
        }
        if from != 0 && leave < 1.0 {
            // Out of a wall.
            return Some((self.border.onto_face(line.at(stop)), 0));
        }
        // A change that rounding hid from the walk. Not the label at t = end: that point is the
        // target's but for rounding, and the target may lie on a tie.
        let to = self.label_at(target);
        (to != from).then(|| self.halve(&line, [known.min(end), end], from, to))
    }

    /// Where the segment from `a` to `b` leaves the label `from` of `a`, the labels being continued
    /// straight beyond the walls: the first change within the walls, or one beyond.
    pub fn continued_crossing(&self, from: u16, a: DVec3, b: DVec3) -> Option<DVec3> {
        let [x, target] = [a, b].map(|p| self.grid.index_at(p));
        let line = Line::new(x, target - x)?;
        let (enter, leave) = line.span(&self.walls);
        let (enter, leave) = (enter.max(0.0), leave.min(1.0));
        let found = if enter < leave {
            self.continued_change(&line, from, [0.0, enter])
                .or_else(|| self.change_within_walls(&line, from, [enter, leave]))
                .or_else(|| self.continued_change(&line, from, [leave, 1.0]))
        } else {
            self.continued_change(&line, from, [0.0, 1.0])
        };
        found.map(|x| self.grid.point_at(x))
    }

    /// The first change from a label on a part of a line, all within the walls.
    fn change_within_walls(&self, line: &Line, from: u16, [low, high]: [f64; 2]) -> Option<DVec3> {
        /// So far from a wall, in voxels, no rounding places a point beyond it.
        const INSIDE: f64 = 1e-6;
        let inside = INSIDE * line.unit;
        let ends = [low + inside, high - inside].map(|t| self.walls.back(line.at(t)));
        let (crossing, to) = self.trace(ends[0], ends[1], from)?;
        // Where the line leaves the walls the label goes on.
        let is_on_wall = self.walls.around(self.walls.onto_face(crossing)).next().is_some();
        (to != 0 || !is_on_wall).then_some(crossing)
    }

    /// A change from the label `from` on a part of a line beyond the walls, if its end has another
    /// one.
    fn continued_change(
        &self,
        line: &Line,
        from: u16,
        [mut low, mut high]: [f64; 2],
    ) -> Option<DVec3> {
        let is_from = |t: f64| self.continued_label_at(line.at(t)) == from;
        if low >= high || is_from(high) {
            return None;
        }
        while high - low > TOLERANCE * line.unit {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if is_from(middle) { low = middle } else { high = middle }
        }
        Some(line.at(0.5 * (low + high)))
    }

    /// The first change from the label `from` on a segment within a mixed cell, see
    /// [`indicator::overtaken`].
    #[inline(always)]
    fn overtaken(
        &self,
        cell: [usize; 3],
        voxel: Voxel,
        from: u16,
        ends: [[f32; 3]; 2],
        tolerance: f64,
    ) -> Option<(f64, u16)> {
        let first = voxel.first_corners();
        let other =
            if voxel.is_two() { self.corner(cell, (!first).trailing_zeros()) } else { from };
        // Rounding may find a third label leading where the segment enters the cell.
        let (corners, to) = match () {
            () if !voxel.is_two() => {
                return match &self.field {
                    Some(field) => field.overtaken(&self.grid.bricks, cell, from, ends, tolerance),
                    None if voxel.contacts() != Contacts::None => {
                        self.contact_cell(cell).overtaken(from, ends, tolerance)
                    }
                    None => indicator::overtaken(
                        &self.corners(cell),
                        &self.weights,
                        from,
                        ends,
                        tolerance,
                    ),
                };
            }
            () if from == voxel.id() => (first, other),
            () if from == other => (!first, voxel.id()),
            () => return Some((0.0, voxel.id())),
        };
        let [weight, against] = [from, to].map(|id| self.weights[usize::from(id)]);
        let s = indicator::overtaken_by_other(corners, weight, against, ends, tolerance)?;
        Some((s, to))
    }

    /// Narrows a bracket (label `from` at its start, `to` at its end) by labels alone.
    #[cold]
    fn halve(
        &self,
        line: &Line,
        [mut low, mut high]: [f64; 2],
        from: u16,
        mut to: u16,
    ) -> (DVec3, u16) {
        loop {
            let middle = 0.5 * (low + high);
            if high - low <= TOLERANCE * line.unit || middle <= low || middle >= high {
                return (line.at(middle), to);
            }
            match self.label_at(line.at(middle)) {
                id if id == from => low = middle,
                id => (high, to) = (middle, id),
            }
        }
    }
}
