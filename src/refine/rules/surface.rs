//! R3: facets between labels have isovertices, angles that are not too small, and stay near the
//! interface.

use glam::DVec3;

use super::walls::FacetAtWall;
use super::{
    FACET_DISTANCE, Facets, ISOVERTEX, LABEL_UNKNOWN, Lookups, MIN_DISTANCE, RefinementPoint, Rule,
    Rules, SPACING_FLOOR, Seen,
};
use crate::delaunay::tet::{FACET, TetRecord, is_free};
use crate::delaunay::{Facet, TetId, VertexId};
use crate::geometry::predicates::perturbation_order;
use crate::geometry::shape::{has_angle_below, triangle_circumcircle};

/// How far a surface center on a wall is moved, in parts of its distance to the vertices.
const MOVE_ON_WALL: f64 = 0.02;
/// How near to a junction a surface center is left to it: in parts of its distance to the vertices,
/// and of delta.
const NEAR_JUNCTION: [f64; 2] = [0.7, 0.5];

/// An interface facet that R3 may ask for something at.
struct InterfaceFacet {
    t: TetId,
    /// The facet as the tet across has it.
    neighbor: Facet,
    /// What `t` and the tet across were seen to be.
    seen: Seen,
    other: Seen,
    vertices: [VertexId; 3],
    at_wall: Option<FacetAtWall>,
    misshapen: bool,
}

impl Rules<'_> {
    /// What R3 asks for the next of `interfaces`, facets of `t` as bits ([`Self::interfaces`]),
    /// that asks for anything; leaves those behind it.
    #[inline(always)]
    pub fn surface_point(
        &self,
        t: TetId,
        interfaces: &mut u32,
        asked: &mut Lookups,
    ) -> Option<RefinementPoint> {
        // Most tets have none: for these a call would be thirty instructions more.
        if *interfaces == 0 { None } else { self.next_surface_point(t, interfaces, asked) }
    }

    #[inline(never)]
    fn next_surface_point(
        &self,
        t: TetId,
        interfaces: &mut u32,
        asked: &mut Lookups,
    ) -> Option<RefinementPoint> {
        while *interfaces != 0 {
            let i = interfaces.trailing_zeros() as usize;
            *interfaces &= *interfaces - 1;
            if let Some(wanted) = self.facet_point(t, i, asked) {
                return Some(wanted);
            }
        }
        None
    }

    /// Those of `facets` of `t`, whose label is known, that are interfaces, as bits; none of a tet
    /// too flat to have a circumcenter. Which tets wait is as good as random, so there is no branch
    /// on it.
    #[inline(always)]
    pub fn interfaces(&self, t: TetId, record: &TetRecord, facets: Facets) -> u32 {
        if !record.sphere().is_certain() {
            return 0;
        }
        let label = record.tag();
        let mut bits = 0;
        for i in 0..4 {
            let neighbor = record.neighbor(i);
            if neighbor.is_none() {
                continue;
            }
            let other = self.triangulation.tet(neighbor.tet());
            let ask = match facets {
                Facets::Second(mark) => other.mark() != mark,
                Facets::Once => neighbor.tet() < t,
            };
            bits |= u32::from(ask & (other.tag() != label)) << i;
        }
        bits
    }

    /// R3 for an interface facet: facet `i` of `t`.
    #[inline(always)]
    fn facet_point(&self, t: TetId, i: usize, asked: &mut Lookups) -> Option<RefinementPoint> {
        let record = self.triangulation.tet(t);
        let seen = Seen::of(record);
        let neighbor = record.neighbor(i);
        // With others at work the tet may be another one by now, or none: then the answer does not
        // matter.
        if is_free(seen.vertices) || neighbor.is_none() {
            return None;
        }
        let other = Seen::of(self.triangulation.tet(neighbor.tet()));
        let (here, there) = (seen.sphere, other.sphere);
        let labels = [seen.label, other.label];
        if !here.is_certain()
            || !there.is_certain()
            || labels[0] == labels[1]
            || labels.contains(&LABEL_UNKNOWN)
        {
            return None;
        }
        let vertices = FACET[i].map(|k| seen.vertices[k]);
        let facet = vertices.map(|v| self.triangulation.position(v));
        let misshapen = self.is_misshapen(vertices, facet);
        let tets = [t, neighbor.tet()];
        let at_wall = self.at_wall([&seen, &other], tets);
        // Most facets are as they should be: what comes of the others is not inlined, for it needs
        // all registers.
        if at_wall.is_none()
            && !misshapen
            && !self.strays(vertices, facet, [here.center, there.center], labels, asked)
        {
            return None;
        }
        let facet = InterfaceFacet { t, neighbor, seen, other, vertices, at_wall, misshapen };
        self.surface_center(facet, asked)
    }

    /// What R3 inserts for a facet at a wall, one that is misshapen, or one that strays from the
    /// interface.
    #[inline(never)]
    fn surface_center(
        &self,
        facet: InterfaceFacet,
        asked: &mut Lookups,
    ) -> Option<RefinementPoint> {
        let InterfaceFacet { t, neighbor, seen, other, vertices, at_wall, misshapen } = facet;
        let (here, there) = (seen.sphere, other.sphere);
        let labels = [seen.label, other.label];
        let facet @ [a, ..] = vertices.map(|v| self.triangulation.position(v));
        let tets = [t, neighbor.tet()];
        let (x, radius) = if let Some(at_wall) = at_wall {
            asked.crossings += 1;
            let reach = self.facet_distance(vertices);
            self.surface_center_at_wall(&at_wall, facet, misshapen, reach, asked)?
        } else {
            // A segment that crosses more than once has one surface center, whichever side is
            // asked.
            let (label, from, to) = if perturbation_order(here.center, there.center).is_lt() {
                (labels[0], here.center, there.center)
            } else {
                (labels[1], there.center, here.center)
            };
            asked.crossings += 1;
            let x = self.oracle.first_crossing_from(label, from, to)?.point;
            let floor = SPACING_FLOOR * self.sizing.at(x);
            if !misshapen && x.distance_squared(a) <= floor * floor {
                return None;
            }
            (x, x.distance(a))
        };
        if !self.triangulation.holds(x) {
            return None;
        }
        let point = self.instead_of(x, radius, self.sizing.at(x), tets);
        let is_here = here.contains(point).unwrap_or_else(|| {
            // It is in conflict with one of the two at least, as a rule: insertion begins there.
            there.contains(point) != Some(true)
                && self.triangulation.exact_conflict(seen.vertices, point) != Some(false)
        });
        let start = if is_here { t } else { neighbor.tet() };
        let (kind, across) = (ISOVERTEX, Some((neighbor, other)));
        Some(RefinementPoint { rule: Rule::R3, point, kind, start, seen, across })
    }

    /// Whether an interface facet has a vertex that is no isovertex, or too small an angle.
    #[inline(always)]
    fn is_misshapen(&self, vertices: [VertexId; 3], [a, b, c]: [DVec3; 3]) -> bool {
        vertices.iter().any(|&v| self.triangulation.vertex(v).kind() != ISOVERTEX)
            || has_angle_below(a, b, c, self.facet_cosine_squared)
    }

    /// The misshapen interface facets of a tet too flat to have a circumcenter, of which R3 is not
    /// asked; of a triangulation at rest. Where two such tets meet the facet counts with the one of
    /// greater id.
    pub fn undecided_facets(&self, t: TetId) -> u64 {
        let record = self.triangulation.tet(t);
        if record.sphere().is_certain() {
            return 0;
        }
        let is_undecided = |i: &usize| {
            let neighbor = record.neighbor(*i);
            if neighbor.is_none() || self.label(t) == self.label(neighbor.tet()) {
                return false;
            }
            let vertices = FACET[*i].map(|k| record.vertices()[k]);
            let is_counted =
                neighbor.tet() < t || self.triangulation.tet(neighbor.tet()).sphere().is_certain();
            is_counted
                && self.is_misshapen(vertices, vertices.map(|v| self.triangulation.position(v)))
        };
        (0..4).filter(is_undecided).count() as u64
    }

    /// What is inserted for a surface center `x` of a facet of two tets, `radius` from the nearest
    /// vertices, where samples are to be `delta` apart. The point of a junction close to it: a
    /// vertex beside the junction, as far from it as its samples are from each other, would draw
    /// mesh edges away from it. Close to a wall a point of the wall, and on a wall a point beside
    /// it.
    fn instead_of(&self, x: DVec3, radius: f64, delta: f64, tets: [TetId; 2]) -> DVec3 {
        let [of_radius, of_delta] = NEAR_JUNCTION;
        let reach = (of_radius * radius).min(of_delta * delta);
        // What is this close keeps the least distance from all vertices.
        let max = radius - MIN_DISTANCE * delta;
        let at_wall = self.oracle.is_near_wall(x, reach);
        if max <= 0.0 && !at_wall {
            return x;
        }
        let near =
            self.oracle.nearest_junction_to_insert(x, if at_wall { reach } else { reach.min(max) });
        // Around contacts samples stand where they do for a reason.
        let near = near.filter(|&y| !self.oracle.is_near_contact(y));
        let near = near.filter(|&y| {
            y.distance(x) <= max || self.is_free_at_wall(y, MIN_DISTANCE * delta, tets)
        });
        let beside = || self.oracle.moved_on_wall(x, max.max(0.0).min(MOVE_ON_WALL * radius));
        let point = near.or_else(beside).filter(|&y| self.triangulation.holds(y)).unwrap_or(x);
        if at_wall { self.drawn_to_walls(point, tets) } else { point }
    }

    /// Whether an interface facet strays from its surface center by more than the facet distance:
    /// whether the dual segment, whose ends have different labels, keeps both labels within that
    /// distance of the facet's circumcenter. The segment lies on the facet's axis.
    fn strays(
        &self,
        vertices: [VertexId; 3],
        [a, b, c]: [DVec3; 3],
        centers: [DVec3; 2],
        labels: [u16; 2],
        asked: &mut Lookups,
    ) -> bool {
        let Some((o, _)) = triangle_circumcircle(a, b, c) else { return true };
        let length = centers[0].distance(centers[1]);
        let axis = (centers[1] - centers[0]) / length;
        let at = (o - centers[0]).dot(axis);
        let mut label_at = |s: f64| match s {
            s if s <= 0.0 => labels[0],
            s if s >= length => labels[1],
            s => {
                asked.labels += 1;
                self.oracle.label(centers[0] + axis * s)
            }
        };
        let distance = self.facet_distance(vertices);
        label_at(at - distance) == label_at(at + distance)
    }

    /// How far a facet of these vertices may stray from the interface.
    fn facet_distance(&self, vertices: [VertexId; 3]) -> f64 {
        let levels = vertices.map(|v| u32::from(self.triangulation.vertex(v).tag())).iter().sum();
        FACET_DISTANCE / 3.0 * self.sizing.sum(3, levels)
    }

    /// The facet between two tets, if the dual segment begins beyond a wall with a tet within the
    /// walls.
    fn at_wall(&self, seen: [&Seen; 2], tets: [TetId; 2]) -> Option<FacetAtWall> {
        let begins = |seen: &Seen| {
            self.oracle.is_beyond_walls(seen.sphere.center) && Self::is_within_walls(seen.vertices)
        };
        let [first, second] = seen;
        let (from, to) = match (begins(first), begins(second)) {
            (false, false) => return None,
            (true, false) => (first, second),
            (false, true) => (second, first),
            // One center, whichever side is asked.
            (true, true)
                if perturbation_order(first.sphere.center, second.sphere.center).is_lt() =>
            {
                (first, second)
            }
            (true, true) => (second, first),
        };
        Some(FacetAtWall {
            center: from.sphere.center,
            label: from.label,
            other: to.sphere.center,
            tets,
        })
    }
}
