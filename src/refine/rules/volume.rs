//! The volume rules: R2, circumballs with isovertices are not too large; R4, tets are not too
//! skinny; R5, none is larger than asked for.

use glam::DVec3;

use super::{ISOVERTEX, LABEL_UNKNOWN, LARGE, MIN_DISTANCE, RefinementPoint, Rule, Rules, Seen};
use crate::delaunay::tet::{TetRecord, is_free};
use crate::delaunay::{TetId, VertexId, VertexKind};
use crate::geometry::shape::shortest_squared_edge;

impl Rules<'_> {
    /// What the first volume rule (R2, R4, R5) that applies to `t` asks for.
    #[inline(always)]
    pub fn volume_point(&self, t: TetId, record: &TetRecord) -> Option<RefinementPoint> {
        // Of the background nothing is asked, but where a tet is flat.
        let is_plain_background = record.tag() == 0 && record.sphere().is_certain();
        if is_plain_background { None } else { self.volume_point_of(t, record) }
    }

    #[inline(never)]
    fn volume_point_of(&self, t: TetId, record: &TetRecord) -> Option<RefinementPoint> {
        let (label, sphere) = (record.tag(), record.sphere());
        // Asked again: with others at work the record may have changed since.
        if label == 0 && (sphere.is_certain() || !self.has_interface(record)) {
            return None;
        }
        let seen = Seen { vertices: record.vertices(), sphere, label };
        // With others at work the tet may have gone by now.
        if is_free(seen.vertices) {
            return None;
        }
        if !sphere.is_certain() {
            return self.flat_point(record, seen);
        }
        let squared_radius = sphere.squared_radius();
        // The cheapest first: all three ask for the same point.
        let &size_squared = self.sizes_squared.get(usize::from(label))?;
        let rule = if squared_radius > size_squared
            || squared_radius > self.size_somewhere_squared
                && self.is_above_size(sphere.center, squared_radius)
        {
            Rule::R5
        } else if squared_radius > self.large_squared
            && self.is_large(seen.vertices, squared_radius)
        {
            Rule::R2
        } else if squared_radius > self.small_squared
            && self.is_skinny(seen.vertices, squared_radius)
        {
            Rule::R4
        } else {
            return None;
        };
        self.center_of_ball(rule, t, seen)
    }

    /// The circumcenter of `t`, or the point of a wall in its place. Not inlined: most tets need
    /// none.
    #[inline(never)]
    fn center_of_ball(&self, rule: Rule, t: TetId, seen: Seen) -> Option<RefinementPoint> {
        let (mut point, mut kind) = (seen.sphere.center, VertexKind::Free);
        if let Some(back) = self.oracle.back_to_walls(point) {
            let radius = seen.sphere.squared_radius().sqrt();
            point = self.volume_point_at_wall(point, back, radius)?;
            kind = ISOVERTEX;
        }
        Some(RefinementPoint { rule, point, kind, start: t, seen, across: None })
    }

    /// Whether the radius of a tet of a label is larger than what is asked for at its circumcenter.
    #[inline(never)]
    fn is_above_size(&self, center: DVec3, squared_radius: f64) -> bool {
        let size = self.sizing.tets().at(center);
        squared_radius > size * size
    }

    /// Whether a radius is larger than R2 allows: 2 deltas of the vertices that are isovertices, on
    /// the average.
    #[inline]
    fn is_large(&self, vertices: [VertexId; 4], squared_radius: f64) -> bool {
        let (mut count, mut levels) = (0, 0);
        for vertex in vertices.map(|v| self.triangulation.vertex(v)) {
            let counts = u32::from(vertex.kind() == ISOVERTEX);
            count += counts;
            levels += counts * u32::from(vertex.tag());
        }
        squared_radius * f64::from(count * count) > (LARGE * self.sizing.sum(count, levels)).powi(2)
    }

    /// Whether a tet has a facet between it and one of another label. Of neighbours that are not
    /// owned, and are not asked again: a flat tet of the background is beside the object or was,
    /// and no harm is done.
    #[cold]
    fn has_interface(&self, record: &TetRecord) -> bool {
        let neighbors = (0..4).map(|i| record.neighbor(i)).filter(|neighbor| !neighbor.is_none());
        let mut labels = neighbors.map(|neighbor| self.triangulation.tet(neighbor.tet()).tag());
        labels.any(|label| label != record.tag() && label != LABEL_UNKNOWN)
    }

    /// What R4 asks for a tet of the object, or beside it, that is too flat to have a circumcenter,
    /// and was seen so: its centroid. Four points of which some mirror others lie in one plane and
    /// on one circle; the centroid lies within that, so in the circumballs of the tets around, and
    /// R3 and R6 see to what comes of it. Where the points are as close as sampling may bring them,
    /// or on a wall, whose edges R3 might then cut off, the tet is left, and counts as unmet.
    #[cold]
    fn flat_point(&self, record: &TetRecord, seen: Seen) -> Option<RefinementPoint> {
        let corners = self.triangulation.corners(seen.vertices);
        let centroid = seen.sphere.center;
        let delta = self.sizing.at(centroid);
        let is_close = |p: &DVec3| p.distance_squared(centroid) < (MIN_DISTANCE * delta).powi(2);
        if corners.iter().any(is_close) {
            return None;
        }
        let neighbors = (0..4).map(|i| record.neighbor(i)).filter(|neighbor| !neighbor.is_none());
        let mut seen_across =
            neighbors.map(|facet| (facet, Seen::of(self.triangulation.tet(facet.tet()))));
        let across @ (facet, _) =
            seen_across.find(|(_, seen)| seen.sphere.contains(centroid) == Some(true))?;
        Some(RefinementPoint {
            rule: Rule::R4,
            point: centroid,
            kind: VertexKind::Free,
            start: facet.tet(),
            seen,
            across: Some(across),
        })
    }

    #[inline]
    fn is_skinny(&self, vertices: [VertexId; 4], squared_radius: f64) -> bool {
        squared_radius
            > self.radius_edge_squared * shortest_squared_edge(self.triangulation.corners(vertices))
    }

    /// Whether a tet of the object is too flat for the rules, whose circumcenter f64 cannot
    /// compute.
    pub fn is_undecided(&self, t: TetId) -> bool {
        !self.triangulation.tet(t).sphere().is_certain() && self.label(t) != 0
    }
}
