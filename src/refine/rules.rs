//! The rules R2 to R5 as questions about one tet; what they answer is to be inserted. R1 is asked
//! of the image, once, before there are tets: `sampling`. R6, which answers an insertion, is
//! [`Rules::near_free_vertices`].
//!
//! From Foteinos, Chernikov and Chrisochoides, Guaranteed quality tetrahedral Delaunay meshing for
//! medical images (2014), extended to many labels. docs/reference/algorithm.md states the rules as
//! they stand here, what was added to them, and why the refinement ends.
//!
//! A rule only reads. It looks at the tet and at its neighbours, so the answer changes only when
//! one of these does, and a changed neighbour is a new tet, which is looked at itself.

use glam::DVec3;

use super::cell_table::MAX_HEADS;
use super::vertex_grid::VertexGrid;
use super::walls::FacetAtWall;
use crate::Result;
use crate::delaunay::tet::{FACET, NO_TAG, TetRecord, is_free};
use crate::delaunay::worker::MARKS;
use crate::delaunay::{Facet, TetId, Triangulation, VertexId, VertexKind};
use crate::geometry::predicates::perturbation_order;
use crate::geometry::shape::{has_angle_below, shortest_squared_edge, triangle_circumcircle};
use crate::geometry::sphere::Circumsphere;
use crate::image::MAX_IDS;
use crate::oracle::Oracle;
use crate::params::MeshParams;
use crate::sizing::Sizing;

/// A rule of the paper's family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Rule {
    R1 = 0,
    R2 = 1,
    R3 = 2,
    R4 = 3,
    R5 = 4,
    R6 = 5,
}

/// The kernel's kind of isovertices, the vertices on interfaces (dO): they stay. Circumcenters are
/// free.
pub const ISOVERTEX: VertexKind = VertexKind::Fixed;

/// What a rule asks for: a vertex of `kind` at `point`, whose conflict zone holds tet `start`.
#[derive(Clone, Copy, Debug)]
pub struct RefinementPoint {
    /// The rule that asks.
    pub rule: Rule,
    /// Where.
    pub point: DVec3,
    /// An isovertex or a free vertex.
    pub kind: VertexKind,
    /// A tet whose circumball holds the point.
    pub start: TetId,
    /// The tet that asks.
    seen: Seen,
    /// The tet across one of its facets, by that tet's facet, where that matters.
    across: Option<(Facet, Seen)>,
}

/// A tet as a rule saw it. Another worker may have been rewriting it meanwhile, so that parts of
/// two tets were seen: what was concluded is true if the tet is all like this when it is owned.
#[derive(Clone, Copy, Debug)]
struct Seen {
    vertices: [VertexId; 4],
    sphere: Circumsphere,
    label: u16,
}

impl Seen {
    #[inline(always)]
    fn of(record: &TetRecord) -> Self {
        Self { vertices: record.vertices(), sphere: record.sphere(), label: record.tag() }
    }

    /// Whether a tet is like this; in bits. The inside bound says nothing more, and may be NaN.
    fn is(&self, record: &TetRecord) -> bool {
        let bits = |sphere: &Circumsphere| {
            (sphere.center.to_array().map(f64::to_bits), sphere.outside.to_bits())
        };
        let now = Self::of(record);
        self.vertices == now.vertices
            && self.label == now.label
            && bits(&self.sphere) == bits(&now.sphere)
    }
}

/// What was asked of the oracle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lookups {
    /// Labels of points.
    pub labels: u64,
    /// Crossings of segments.
    pub crossings: u64,
}

/// Tets carry the label of their circumcenter in the kernel's tag, once it is known.
const LABEL_UNKNOWN: u16 = NO_TAG;
const _: () = assert!(MAX_IDS <= LABEL_UNKNOWN as usize);

/// The mark of a tet that does not wait in the list that its mark names, that of the worker which
/// made it or was sent it: it was looked at, or waits in another list. No worker's mark.
const ELSEWHERE: u8 = MARKS as u8;

/// Which facets of a tet a look is to ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facets {
    /// All but those whose other tet still waits in the list of this worker, by its mark: a facet
    /// is looked at with the second of its tets. Where the two are in different workers' lists,
    /// each asks: both might believe to be the first.
    Second(u8),
    /// Those whose other tet has a smaller id: each facet of a triangulation at rest once, if all
    /// tets are asked.
    Once,
}

/// The rules for one image and one set of parameters.
pub struct Rules<'a> {
    pub(super) triangulation: &'a Triangulation,
    pub(super) oracle: &'a Oracle,
    free_vertices: VertexGrid,
    /// How far apart samples of dO are: delta, from place to place.
    pub(super) sizing: Sizing,
    /// No squared radius below this is above R2's bound anywhere.
    large_squared: f64,
    /// Squared radius below which R4 cannot apply: vertices keep a distance from each other
    /// (docs/reference/algorithm.md, why it ends).
    small_squared: f64,
    radius_edge_squared: f64,
    facet_cosine_squared: f64,
    /// Squared size bound of each label id; infinite for the background.
    sizes_squared: Vec<f64>,
}

/// R2 splits circumballs with a radius of more than this many deltas. The proof of termination
/// needs at least 2.
const LARGE: f64 = 2.0;

/// An interface facet may stray from the interface, at its circumcenter, by this part of delta.
pub const FACET_DISTANCE: f64 = 0.22;
/// Sampling for the sake of the facet distance keeps isovertices this part of delta apart.
pub const SPACING_FLOOR: f64 = 0.5;

/// How far a surface center on a wall is moved, in parts of its distance to the vertices.
const MOVE_ON_WALL: f64 = 0.02;
/// Isovertices no farther than this part of delta from a wall are moved onto it. The corners of the
/// box are at a finite distance, so the ball of a facet on the wall and one of them reaches a
/// little into the object; what lies there would part the facet from the wall.
pub(super) const DRAWN_TO_WALL: f64 = 0.25;
/// What is inserted in place of a surface center keeps this part of delta from all vertices.
pub(super) const LEAST_DISTANCE: f64 = 0.25;
/// How near to a junction a surface center is left to it: in parts of its distance to the vertices,
/// and of delta.
const NEAR_JUNCTION: [f64; 2] = [0.7, 0.5];

/// Tets of an object within the cube of its size, as measured on the atlases.
pub const TETS_PER_SIZE: f64 = 8.0;

impl<'a> Rules<'a> {
    /// `labels` are the labels of the oracle's ids.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        triangulation: &'a Triangulation,
        oracle: &'a Oracle,
        params: &MeshParams,
        labels: &[i32],
    ) -> Result<Self> {
        let size = |label: i32| {
            params.label_sizes.iter().rev().find(|l| l.0 == label).map_or(params.size, |l| l.1)
        };
        let sizes_squared = labels
            .iter()
            .enumerate()
            .map(|(id, &label)| if id == 0 { f64::INFINITY } else { size(label) * size(label) })
            .collect::<Vec<f64>>();
        let rules = Self {
            triangulation,
            oracle,
            free_vertices: VertexGrid::new(
                triangulation,
                VertexKind::Free,
                4.0 * params.delta,
                MAX_HEADS,
            )?,
            sizing: Sizing::uniform(params.delta),
            large_squared: 0.0,
            radius_edge_squared: params.radius_edge * params.radius_edge,
            small_squared: 0.0,
            facet_cosine_squared: params.facet_angle.to_radians().cos().powi(2),
            sizes_squared,
        };
        Ok(rules.with_sizing(Sizing::uniform(params.delta)))
    }

    /// The same rules for samples whose distance differs from place to place, nowhere above delta.
    pub fn with_sizing(self, sizing: Sizing) -> Self {
        let least_squared = sizing.least() * sizing.least();
        let least_size_squared = self.sizes_squared.iter().copied().fold(f64::INFINITY, f64::min);
        let closest_squared =
            (0.25 * least_size_squared).min(LEAST_DISTANCE * LEAST_DISTANCE * least_squared);
        Self {
            large_squared: LARGE * LARGE * least_squared,
            // Less a little, for rounding.
            small_squared: 0.999 * self.radius_edge_squared * closest_squared,
            sizing,
            ..self
        }
    }

    /// The sizing field, which outlives the triangulation.
    pub fn into_sizing(self) -> Sizing {
        self.sizing
    }

    /// Bytes of the oracle, the triangulation and the grids.
    pub fn bytes(&self) -> u64 {
        let vertices = self.triangulation.vertex_bound();
        (self.oracle.bytes() + self.sizing.bytes()) as u64
            + self.triangulation.bytes()
            + self.free_vertices.bytes(vertices)
    }

    /// Finds the labels of tets that nobody else can have come to, or that all stand still. A tag
    /// is written at no other time: whoever found a label while the tet is destroyed would write it
    /// to the next tet in the slot.
    pub fn find_labels(&self, tets: &[TetId]) {
        let tet = |i: usize| self.triangulation.tet(tets[i]);
        let center = |i: usize| tet(i).sphere().center;
        if !self.oracle.has_walls() {
            return self.oracle.labels(
                tets.len(),
                center,
                |_| false,
                |i, label| tet(i).set_tag(label),
            );
        }
        let is_continued = |i: usize| Self::is_within_walls(tet(i).vertices());
        self.oracle.labels(tets.len(), center, is_continued, |i, label| {
            let record = tet(i);
            let is_outside =
                !record.sphere().is_certain() && self.is_flat_on_wall(record.vertices());
            record.set_tag(if is_outside { 0 } else { label });
        });
    }

    /// The label id of the tet's circumcenter: the tet's label. Of a triangulation at rest; tets
    /// that were made before the samples were complete have no tag.
    #[inline(always)]
    pub fn label(&self, t: TetId) -> u16 {
        let record = self.triangulation.tet(t);
        let (vertices, sphere) = (record.vertices(), record.sphere());
        match record.tag() {
            LABEL_UNKNOWN if !sphere.is_certain() && self.is_flat_on_wall(vertices) => 0,
            LABEL_UNKNOWN if Self::is_within_walls(vertices) => {
                self.oracle.continued_label(sphere.center)
            }
            LABEL_UNKNOWN => self.oracle.label(sphere.center),
            label => label,
        }
    }

    /// Notes that a tet is no longer one that waits in the list that its mark names. A note that
    /// comes too late, to the slot's next tet, only makes its facets be looked at twice.
    #[inline]
    pub fn mark_elsewhere(&self, t: TetId) {
        self.triangulation.tet(t).set_mark(ELSEWHERE);
    }

    /// What R3 asks for the next of `interfaces`, facets of `t` as bits ([`Self::interfaces`]),
    /// that asks for anything; leaves those behind it.
    #[inline]
    pub fn surface_demand(
        &self,
        t: TetId,
        interfaces: &mut u32,
        asked: &mut Lookups,
    ) -> Option<RefinementPoint> {
        while *interfaces != 0 {
            let i = interfaces.trailing_zeros() as usize;
            *interfaces &= *interfaces - 1;
            if let Some(demand) = self.interface_demand(t, i, asked) {
                return Some(demand);
            }
        }
        None
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

    /// Those of `facets` of `t`, whose label is known, that are interfaces, as bits; none of a tet
    /// too flat to have a circumcenter. Which tets wait is as good as random, so there is no branch
    /// on it.
    #[inline]
    pub fn interfaces(&self, t: TetId, facets: Facets) -> u32 {
        let record = self.triangulation.tet(t);
        self.triangulation.prefetch_neighbors(record);
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
    fn interface_demand(&self, t: TetId, i: usize, asked: &mut Lookups) -> Option<RefinementPoint> {
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
        let facet @ [a, ..] = vertices.map(|v| self.triangulation.position(v));
        let misshapen = self.is_misshapen(vertices, facet);
        let tets = [t, neighbor.tet()];
        let (x, radius) = if let Some(at_wall) = self.at_wall([&seen, &other], tets) {
            asked.crossings += 1;
            self.surface_center_at_wall(&at_wall, facet, misshapen, self.facet_distance(vertices))?
        } else {
            if !misshapen
                && !self.strays(vertices, facet, [here.center, there.center], labels, asked)
            {
                return None;
            }
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
        let start = if here.contains(point) == Some(true) { t } else { neighbor.tet() };
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
        let most = radius - LEAST_DISTANCE * delta;
        let at_wall = self.oracle.is_near_wall(x, reach);
        if most <= 0.0 && !at_wall {
            return x;
        }
        let near = self.oracle.nearest_junction(x, if at_wall { reach } else { reach.min(most) });
        // Around contacts samples stand where they do for a reason.
        let near = near.filter(|&y| !self.oracle.is_near_contact(y));
        let near = near.filter(|&y| {
            y.distance(x) <= most || self.is_free_at_wall(y, LEAST_DISTANCE * delta, tets)
        });
        let beside = || self.oracle.moved_on_wall(x, most.max(0.0).min(MOVE_ON_WALL * radius));
        let point = near.or_else(beside).filter(|&y| self.triangulation.holds(y)).unwrap_or(x);
        if at_wall { self.drawn_to_walls(point, tets) } else { point }
    }

    /// Whether a demand of tet `t` is true. To be asked when `demand.start`, which is the tet or
    /// its neighbour across the facet in question, is owned and was looked across: then neither of
    /// the two can change.
    pub fn is_demanded(&self, t: TetId, demand: &RefinementPoint) -> bool {
        let record = self.triangulation.tet(t);
        demand.seen.is(record)
            && demand.across.is_none_or(|(facet, seen)| {
                let other = self.triangulation.tet(facet.tet());
                let back = other.neighbor(facet.index());
                // Asked of both: which of the two is owned is not known, and a tet that has been
                // freed still names its neighbours.
                back.tet() == t && record.neighbor(back.index()) == facet && seen.is(other)
            })
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

    /// What the first volume rule (R2, R4, R5) that applies to `t` asks for.
    pub fn volume_demand(&self, t: TetId) -> Option<RefinementPoint> {
        let record = self.triangulation.tet(t);
        let (label, sphere) = (record.tag(), record.sphere());
        if label == 0 && (sphere.is_certain() || !self.has_interface(record)) {
            return None;
        }
        let seen = Seen { vertices: record.vertices(), sphere, label };
        // With others at work the tet may have gone by now.
        if is_free(seen.vertices) {
            return None;
        }
        if !sphere.is_certain() {
            return self.flat_demand(record, seen);
        }
        let squared_radius = sphere.squared_radius();
        let demand = |rule| {
            let (mut point, mut kind) = (sphere.center, VertexKind::Free);
            if let Some(back) = self.oracle.back_to_walls(point) {
                point = self.volume_point_at_wall(point, back, squared_radius.sqrt())?;
                kind = ISOVERTEX;
            }
            Some(RefinementPoint { rule, point, kind, start: t, seen, across: None })
        };
        // The cheapest first: all three ask for the same point.
        let &size_squared = self.sizes_squared.get(usize::from(label))?;
        if squared_radius > size_squared {
            demand(Rule::R5)
        } else if squared_radius > self.large_squared
            && self.is_large(seen.vertices, squared_radius)
        {
            demand(Rule::R2)
        } else if squared_radius > self.small_squared
            && self.is_skinny(seen.vertices, squared_radius)
        {
            demand(Rule::R4)
        } else {
            None
        }
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
    fn flat_demand(&self, record: &TetRecord, seen: Seen) -> Option<RefinementPoint> {
        let corners = self.triangulation.corners(seen.vertices);
        let centroid = seen.sphere.center;
        let delta = self.sizing.at(centroid);
        let is_close = |p: &DVec3| p.distance_squared(centroid) < (LEAST_DISTANCE * delta).powi(2);
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

    /// Tets to be expected within `volume` about `p`, those around samples of dO apart: for
    /// progress and the sharing of work alone.
    pub fn expected_tets(&self, p: DVec3, volume: f64) -> f64 {
        let size_squared = self.sizes_squared[usize::from(self.oracle.label(p))];
        TETS_PER_SIZE * volume / (size_squared * size_squared.sqrt())
    }

    /// Notes a vertex that was inserted, an isovertex or a free one.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn note_vertex(&self, v: VertexId, p: DVec3, kind: VertexKind) -> Result<()> {
        if kind == ISOVERTEX {
            self.triangulation.vertex(v).set_tag(self.sizing.level(p));
        } else if self.oracle.clearance(p) < 2.0 * self.sizing.greatest() {
            // R6 reaches 2 delta from the interface.
            self.free_vertices.push(v, p)?;
        }
        Ok(())
    }

    /// R6: the free vertices closer than 2 delta to a new isovertex.
    pub fn near_free_vertices(&self, z: DVec3, found: &mut Vec<VertexId>) {
        found.clear();
        self.free_vertices.visit_within(self.triangulation, z, 2.0 * self.sizing.at(z), |v| {
            found.push(v);
            true
        });
    }
}
