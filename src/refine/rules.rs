//! The rules R1 to R5 as questions about one tet; what they answer is to be inserted. R6, which answers an insertion, is [`Rules::near_free_vertices`].
//!
//! From Foteinos, Chernikov and Chrisochoides, Guaranteed quality tetrahedral Delaunay meshing for medical images (2014), extended to many
//! labels. docs/algorithm.md states the rules as they stand here, what was added to them, and why the refinement ends.
//!
//! A rule only reads. It looks at the tet, at its neighbours and at the isovertices near a point, so the answer changes only when one
//! of these does: isovertices are never removed, and a changed neighbour is a new tet, which is looked at itself.

use glam::DVec3;

use super::vertex_grid::VertexGrid;
use crate::Result;
use crate::delaunay::tet::FACET;
use crate::delaunay::{TetId, Triangulation, VertexId, VertexKind};
use crate::geometry::predicates::perturbation_order;
use crate::geometry::shape::{largest_cosine, shortest_squared_edge, triangle_circumcircle};
use crate::oracle::Oracle;
use crate::params::MeshParams;

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

/// What a rule asks for: a vertex of `kind` at `point`, whose conflict zone holds tet `start`.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// The rule that asks.
    pub rule: Rule,
    /// Where.
    pub point: DVec3,
    /// An isovertex or a free vertex.
    pub kind: VertexKind,
    /// A tet whose circumball holds the point.
    pub start: TetId,
}

/// Tets carry the label of their circumcenter in the kernel's tag word.
const LABEL_KNOWN: u32 = 1 << 16;
/// The tet waits to be looked at. Its facets are looked at then, so that no facet is looked at from both sides.
const PENDING: u32 = 1 << 17;

/// The rules for one image and one set of parameters.
pub struct Rules<'a> {
    pub(super) triangulation: &'a Triangulation,
    pub(super) oracle: &'a Oracle,
    pub(super) isovertices: VertexGrid,
    pub(super) free_vertices: VertexGrid,
    delta: f64,
    radius_edge_squared: f64,
    facet_cosine: f64,
    /// Squared size bound of each label id; infinite for the background.
    sizes_squared: Vec<f64>,
    facet_distance: f64,
    spacing_floor: f64,
    /// Dual segments with the same label at both ends are asked for a crossing when their squared length is at least this.
    stay_squared: f64,
}

/// R2 splits circumballs of tets of the object with a radius of more than this many deltas. The proof of termination needs at least 2.
const LARGE_OBJECT: f64 = 2.0;
/// The same for the background, whose tets only look for interfaces that nothing else has found: the size of interface facets is
/// bounded by their tets in the object.
const LARGE_BACKGROUND: f64 = 3.0;

/// An interface facet may stray from the interface, at its circumcenter, by this part of delta.
pub const FACET_DISTANCE: f64 = 0.25;
/// Sampling for the sake of the facet distance keeps isovertices this part of delta apart.
pub const SPACING_FLOOR: f64 = 0.5;

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
        let size = |label: i32| params.label_sizes.iter().rev().find(|l| l.0 == label).map_or(params.size, |l| l.1);
        let sizes_squared = labels
            .iter()
            .enumerate()
            .map(|(id, &label)| if id == 0 { f64::INFINITY } else { size(label) * size(label) })
            .collect();
        Ok(Self {
            triangulation,
            oracle,
            isovertices: VertexGrid::new(triangulation, VertexKind::Isovertex, 2.0 * params.delta)?,
            free_vertices: VertexGrid::new(triangulation, VertexKind::Free, 4.0 * params.delta)?,
            delta: params.delta,
            radius_edge_squared: params.radius_edge * params.radius_edge,
            facet_cosine: params.facet_angle.to_radians().cos(),
            sizes_squared,
            facet_distance: FACET_DISTANCE * params.delta,
            stay_squared: oracle.spacing().min_element().powi(2),
            spacing_floor: SPACING_FLOOR * params.delta,
        })
    }

    /// Bytes of the oracle, the triangulation and the grids.
    pub fn bytes(&self) -> u64 {
        let vertices = self.triangulation.vertex_bound();
        let grids = self.isovertices.bytes(vertices) + self.free_vertices.bytes(vertices);
        self.oracle.bytes() as u64 + self.triangulation.bytes() + grids
    }

    /// Marks a tet as waiting.
    #[inline]
    pub fn set_pending(&self, t: TetId) {
        let record = self.triangulation.tet(t);
        record.set_tag(record.tag() | PENDING);
    }

    /// Takes the mark off.
    #[inline]
    pub fn clear_pending(&self, t: TetId) {
        let record = self.triangulation.tet(t);
        record.set_tag(record.tag() & !PENDING);
    }

    #[inline]
    fn is_pending(&self, t: TetId) -> bool {
        self.triangulation.tet(t).tag() & PENDING != 0
    }

    /// The label id of the tet's circumcenter: the tet's label.
    #[inline(always)]
    pub fn label(&self, t: TetId) -> u16 {
        let record = self.triangulation.tet(t);
        let tag = record.tag();
        if tag & LABEL_KNOWN != 0 {
            return tag as u16;
        }
        self.find_label(t)
    }

    #[cold]
    fn find_label(&self, t: TetId) -> u16 {
        let record = self.triangulation.tet(t);
        let label = self.oracle.label(record.sphere().center);
        record.set_tag(record.tag() | LABEL_KNOWN | u32::from(label));
        label
    }

    /// What the first surface rule (R1, R2, R3) that applies to `t` asks for.
    pub fn surface_demand(&self, t: TetId) -> Option<Demand> {
        let record = self.triangulation.tet(t);
        self.triangulation.prefetch_neighbors(t);
        let sphere = record.sphere();
        if !sphere.is_certain() {
            return None;
        }
        let (center, squared_radius) = (sphere.center, sphere.squared_radius());
        let approach = self.oracle.approach(center);
        let sample = approach.sample;
        record.set_tag(record.tag() | LABEL_KNOWN | u32::from(sample.label));
        let radius = squared_radius.sqrt();
        let vertices = record.vertices();
        if sample.clearance < radius {
            // The closest surface point z lies between the circumcenter and the target. Without R2 there is a quick way to refuse R1.
            let target = self.oracle.target(&approach);
            let large = if sample.label == 0 { LARGE_BACKGROUND } else { LARGE_OBJECT };
            let is_large = radius > large * self.delta;
            if (is_large || !self.covers(vertices, center, sample.label, target))
                && let Some(z) = self.oracle.closest_on(&approach, target, radius)
            {
                if self.is_sparse(vertices, z) && self.triangulation.holds(z) {
                    return Some(Demand { rule: Rule::R1, point: z, kind: VertexKind::Isovertex, start: t });
                }
                if is_large && self.triangulation.holds(center) {
                    return Some(Demand { rule: Rule::R2, point: center, kind: VertexKind::Free, start: t });
                }
            }
        }
        (0..4).find_map(|i| self.facet_demand(t, i, sample.clearance))
    }

    /// Whether an isovertex of the tet is closer than delta to the surface point on the way from the circumcenter to `target`, found without looking
    /// for that point: the way crosses the interface inside the isovertex's ball of radius delta when the labels where it enters and leaves
    /// the ball differ. Then R1 does not apply. Two labels are much cheaper than a crossing, and nearly always decide.
    #[inline]
    fn covers(&self, vertices: [VertexId; 4], center: DVec3, label: u16, target: DVec3) -> bool {
        let way = target - center;
        let (squared_way, squared_delta) = (way.length_squared(), self.delta * self.delta);
        // The ball with the longest chord.
        let (mut best, mut middle) = (0.0_f64, 0.0);
        for v in vertices {
            let vertex = self.triangulation.vertex(v);
            if vertex.kind() == VertexKind::Isovertex {
                let to = vertex.position() - center;
                let along = to.dot(way);
                let discriminant = along * along - squared_way * (to.length_squared() - squared_delta);
                if discriminant > best {
                    (best, middle) = (discriminant, along);
                }
            }
        }
        if best == 0.0 {
            return false;
        }
        // Rounding must not place the ends outside of the ball.
        let half = best.sqrt() * (1.0 - 1e-9);
        let (enter, leave) = ((middle - half) / squared_way, (middle + half) / squared_way);
        leave > 0.0
            && enter < 1.0
            && (leave >= 1.0 || self.oracle.label(center + way * leave) != label)
            && (enter <= 0.0 || self.oracle.label(center + way * enter) == label)
    }

    /// Whether no isovertex is closer than delta to `z`; the tet's own are asked first.
    #[inline]
    fn is_sparse(&self, vertices: [VertexId; 4], z: DVec3) -> bool {
        let close = |v: VertexId| {
            let vertex = self.triangulation.vertex(v);
            vertex.kind() == VertexKind::Isovertex && vertex.position().distance_squared(z) < self.delta * self.delta
        };
        !vertices.into_iter().any(close) && !self.isovertices.any_within(self.triangulation, z, self.delta)
    }

    /// R3 for facet `i` of `t`. `clearance` is that of the tet's circumcenter.
    fn facet_demand(&self, t: TetId, i: usize, clearance: f64) -> Option<Demand> {
        let record = self.triangulation.tet(t);
        let neighbor = record.neighbor(i);
        if neighbor.is_none() || self.is_pending(neighbor.tet()) {
            return None;
        }
        let (here, there) = (record.sphere(), self.triangulation.tet(neighbor.tet()).sphere());
        if !there.is_certain() {
            return None;
        }
        let squared_length = here.center.distance_squared(there.center);
        let is_interface = self.label(t) != self.label(neighbor.tet());
        if squared_length <= clearance * clearance || !is_interface && squared_length < self.stay_squared {
            return None;
        }
        let vertices = FACET[i].map(|k| record.vertices()[k]);
        let facet @ [a, b, c] = vertices.map(|v| self.triangulation.position(v));
        let misshapen = vertices.iter().any(|&v| self.triangulation.vertex(v).kind() != VertexKind::Isovertex)
            || largest_cosine(a, b, c) > self.facet_cosine;
        // A good facet is asked for its surface center only where that lies on the interface of the finished mesh.
        let strays = || self.strays(facet, [here.center, there.center], [self.label(t), self.label(neighbor.tet())]);
        if !(misshapen || is_interface && strays()) {
            return None;
        }
        // A segment that crosses more than once has one surface center, whichever side is asked.
        let (from, to) = if perturbation_order(here.center, there.center).is_lt() {
            (here.center, there.center)
        } else {
            (there.center, here.center)
        };
        let x = self.oracle.first_crossing(from, to)?.point;
        if !misshapen && x.distance_squared(a) <= self.spacing_floor * self.spacing_floor
            || !self.triangulation.holds(x)
        {
            return None;
        }
        let start = if here.contains(x) == Some(true) { t } else { neighbor.tet() };
        Some(Demand { rule: Rule::R3, point: x, kind: VertexKind::Isovertex, start })
    }

    /// Whether an interface facet strays from its surface center by more than the facet distance: whether the dual segment, whose ends have
    /// different labels, keeps both labels within that distance of the facet's circumcenter. The segment lies on the facet's axis.
    fn strays(&self, [a, b, c]: [DVec3; 3], centers: [DVec3; 2], labels: [u16; 2]) -> bool {
        let Some((o, _)) = triangle_circumcircle(a, b, c) else { return true };
        let length = centers[0].distance(centers[1]);
        let axis = (centers[1] - centers[0]) / length;
        let at = (o - centers[0]).dot(axis);
        let label_at = |s: f64| match s {
            s if s <= 0.0 => labels[0],
            s if s >= length => labels[1],
            s => self.oracle.label(centers[0] + axis * s),
        };
        label_at(at - self.facet_distance) == label_at(at + self.facet_distance)
    }

    /// What the first volume rule (R4, R5) that applies to `t` asks for.
    pub fn volume_demand(&self, t: TetId) -> Option<Demand> {
        let label = self.label(t);
        if label == 0 {
            return None;
        }
        let record = self.triangulation.tet(t);
        let sphere = record.sphere();
        let squared_radius = sphere.squared_radius();
        let demand = |rule| Some(Demand { rule, point: sphere.center, kind: VertexKind::Free, start: t });
        if !sphere.is_certain() {
            return None;
        }
        let shortest = shortest_squared_edge(self.triangulation.corners(record.vertices()));
        if squared_radius > self.radius_edge_squared * shortest {
            demand(Rule::R4)
        } else if squared_radius > self.sizes_squared[usize::from(label)] {
            demand(Rule::R5)
        } else {
            None
        }
    }

    /// Whether a tet of the object is too flat for the rules, whose circumcenter f64 cannot compute.
    pub fn is_undecided(&self, t: TetId) -> bool {
        !self.triangulation.tet(t).sphere().is_certain() && self.label(t) != 0
    }

    /// Notes a vertex that was inserted.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn note_vertex(&self, v: VertexId, p: DVec3, kind: VertexKind) -> Result<()> {
        match kind {
            VertexKind::Isovertex => self.isovertices.push(v, p),
            // R6 reaches 2 delta from the interface.
            VertexKind::Free if self.oracle.clearance(p) < 2.0 * self.delta => self.free_vertices.push(v, p),
            _ => Ok(()),
        }
    }

    /// R6: the free vertices closer than 2 delta to a new isovertex.
    pub fn near_free_vertices(&self, z: DVec3, found: &mut Vec<VertexId>) {
        found.clear();
        self.free_vertices.visit_within(self.triangulation, z, 2.0 * self.delta, |v| {
            found.push(v);
            true
        });
    }
}
