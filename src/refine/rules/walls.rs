//! The rules where the image cuts the object off.
//!
//! **The label of a tet beyond a wall.** Vertices of the object lie within the walls, but a tet
//! close to one may have its circumcenter beyond it, above all where an interface meets the wall at
//! a slant: the ball of a facet on the wall then holds vertices of the interface. With the label
//! there, the background, the tet would be missing: a nick. But it lies within the walls, as all
//! tets do that have no corner of the box. So the labels are continued straight beyond the walls,
//! for these tets alone. Tets with a corner of the box lie outside of the walls, or are split. What
//! separates the two are facets on the walls, if these have their rims, edges and corners as
//! samples.
//!
//! **What the rules insert.** A point beyond a wall would be outside of the object. Instead comes
//! the point of the walls nearest to it:
//! - R3: where the dual segment of a facet crosses a continued interface, the point of the rim
//!   below it; for a misshapen facet on a wall its circumcenter.
//! - R2, R4, R5: the projection of the circumcenter.
//!
//! In all cases only if no vertex is nearer than the least spacing. So these insertions do not
//! disturb the proof of termination (docs/reference/algorithm.md).

use glam::DVec3;

use super::{DRAWN_TO_WALL, Lookups, MIN_DISTANCE, Rules, SPACING_FLOOR};
use crate::delaunay::tet::is_free;
use crate::delaunay::{BOX_VERTICES, TetId, VertexId};
use crate::geometry::shape::triangle_circumcircle;
use crate::oracle::Walls;

/// A facet whose dual segment has an end beyond a wall, of a tet within the walls.
pub(super) struct FacetAtWall {
    /// The circumcenter of that tet, and its label.
    pub(super) center: DVec3,
    pub(super) label: u16,
    /// The circumcenter of the other tet.
    pub(super) other: DVec3,
    /// The two tets.
    pub(super) tets: [TetId; 2],
}

impl Rules<'_> {
    /// Whether a tet has no corner of the box, and so lies within the walls: then labels are
    /// continued to its circumcenter.
    #[inline]
    pub(in crate::refine) fn is_within_walls(vertices: [VertexId; 4]) -> bool {
        vertices.iter().all(|&v| v >= BOX_VERTICES)
    }

    /// Whether a tet that is too flat to have a circumcenter lies on a wall: rounding makes those
    /// where the axes of the image are oblique. They are outside.
    #[cold]
    pub(in crate::refine) fn is_flat_on_wall(&self, vertices: [VertexId; 4]) -> bool {
        Self::is_within_walls(vertices)
            && self.common_walls(&self.triangulation.corners(vertices)).count() > 0
    }

    /// The walls that all of these points are on.
    fn common_walls(&self, points: &[DVec3]) -> Walls {
        let walls = points.iter().map(|&p| self.oracle.walls_at(p));
        walls.reduce(|all, walls| all.common(&walls)).unwrap_or(Walls::NONE)
    }

    /// The surface center of a facet at a wall, which may be `misshapen`, if anything is to be
    /// inserted for it, and how far it is from the nearest vertex; `reach` is the facet distance.
    /// `asked` tells whether something would be, but for the vertices around.
    pub(super) fn surface_center_at_wall(
        &self,
        facet: &FacetAtWall,
        corners: [DVec3; 3],
        misshapen: bool,
        reach: f64,
        asked: &mut Lookups,
    ) -> Option<(DVec3, f64)> {
        let [a, b, c] = corners;
        let (o, _) = triangle_circumcircle(a, b, c)?;
        let crossing = self.oracle.continued_crossing(facet.label, facet.center, facet.other);
        if !misshapen && crossing.is_none_or(|x| x.distance(o) <= reach) {
            return None;
        }
        let x = crossing.or_else(|| {
            // No interface, so the wall itself, on which the facet lies.
            let walls = self.common_walls(&corners);
            (walls.count() > 0).then(|| self.oracle.onto_walls(o, walls))
        })?;
        let back = self.oracle.back_to_walls(x);
        if crossing.is_some() && back.is_none() {
            let radius = x.distance(a);
            return (misshapen || radius > SPACING_FLOOR * self.sizing.at(x))
                .then_some((x, radius));
        }
        // On the edge of a wall where the circumcenter lies beyond that.
        let x = back.unwrap_or(x);
        let floor = if misshapen { MIN_DISTANCE } else { SPACING_FLOOR };
        let distance = self.nearest_vertex(x, facet.tets);
        let distance = distance.filter(|&distance| distance > floor * self.sizing.at(x));
        asked.put_off += u64::from(distance.is_none());
        Some((x, distance?))
    }

    /// How far the nearest vertex is from a point in a circumball of one of these tets: one of a
    /// tet whose circumball holds the point. `None` where that is not so, or too many do.
    fn nearest_vertex(&self, x: DVec3, tets: [TetId; 2]) -> Option<f64> {
        const MAX: usize = 100;
        let holds = |t: TetId| self.triangulation.tet(t).sphere().contains(x) != Some(false);
        let mut zone: Vec<TetId> = tets.into_iter().filter(|&t| holds(t)).take(1).collect();
        let (mut next, mut squared) = (0, f64::INFINITY);
        while let Some(&t) = zone.get(next) {
            next += 1;
            let record = self.triangulation.tet(t);
            // With others at work it may be freed by now.
            if is_free(record.vertices()) || zone.len() > MAX {
                return None;
            }
            for p in self.triangulation.corners(record.vertices()) {
                squared = p.distance_squared(x).min(squared);
            }
            for neighbor in
                (0..4).map(|i| record.neighbor(i)).filter(|neighbor| !neighbor.is_none())
            {
                if !zone.contains(&neighbor.tet()) && holds(neighbor.tet()) {
                    zone.push(neighbor.tet());
                }
            }
        }
        (next > 0).then(|| squared.sqrt())
    }

    /// Whether a point in a circumball of one of these tets is farther than that from all vertices.
    #[cold]
    pub(super) fn is_free_at_wall(&self, p: DVec3, min: f64, tets: [TetId; 2]) -> bool {
        self.triangulation.holds(p)
            && self.nearest_vertex(p, tets).is_some_and(|distance| distance > min)
    }

    /// A point of dO, in a circumball of one of these tets, or the point of a wall close to it if
    /// that keeps the least distance from all vertices.
    pub(super) fn drawn_to_walls(&self, p: DVec3, tets: [TetId; 2]) -> DVec3 {
        // The least distance is that of where samples are closest: nothing is nearer to anything
        // anywhere.
        let is_free = |&q: &DVec3| self.is_free_at_wall(q, MIN_DISTANCE * self.sizing.min(), tets);
        self.oracle.drawn_to_walls(p, DRAWN_TO_WALL * self.sizing.at(p)).find(is_free).unwrap_or(p)
    }

    /// What R2, R4 and R5 insert for a tet whose circumcenter, `radius` from its vertices, is
    /// beyond a wall; `back` is the point of the wall. `None` if the tet is to be left.
    #[cold]
    pub(super) fn volume_point_at_wall(
        &self,
        center: DVec3,
        back: DVec3,
        radius: f64,
    ) -> Option<DVec3> {
        let vertices_from = radius - center.distance(back);
        (vertices_from > SPACING_FLOOR * self.sizing.at(back) && self.triangulation.holds(back))
            .then_some(back)
    }
}
