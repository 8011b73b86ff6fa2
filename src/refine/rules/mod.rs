//! The rules R2 to R5 as questions about one tet; what they answer is to be inserted. R1 is asked
//! of the image, once, before there are tets: [`sampling`](super::sampling). R6, which answers an
//! insertion, is [`State::near_free_vertices`](super::state::State::near_free_vertices).
//!
//! | file | what it is |
//! |---|---|
//! | `surface` | R3 |
//! | `volume` | R2, R4, R5 |
//! | `walls` | what changes where the image ends |
//!
//! From Foteinos, Chernikov and Chrisochoides, Guaranteed quality tetrahedral Delaunay meshing for
//! medical images (2014), extended to many labels. docs/reference/algorithm.md states the rules as
//! they stand here, what was added to them, and why the refinement ends.
//!
//! A rule only reads; what it reads beside the triangulation is written by
//! [`State`](super::state::State). It inspects the tet and at its neighbours. So the answer changes
//! only when one of these does, and a changed neighbour is a new tet, which is inspected itself.

use glam::DVec3;

mod surface;
mod volume;
mod walls;

use crate::Result;
use crate::delaunay::tet::{NO_TAG, TetRecord};
use crate::delaunay::{Facet, TetId, Triangulation, VertexId, VertexKind};
use crate::geometry::sphere::Circumsphere;
use crate::image::MAX_IDS;
use crate::image::voxel_blocks::NearBlocks;
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
    /// Facets at walls that R3 would ask for, but for vertices around that are too close, or too
    /// many to look at. These may go, so the facet is to be asked again.
    pub put_off: u64,
}

/// Tets carry the label of their circumcenter in the kernel's tag, once it is known.
const LABEL_UNKNOWN: u16 = NO_TAG;
const _: () = assert!(MAX_IDS <= LABEL_UNKNOWN as usize);

/// Which facets of a tet an inspection is to ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facets {
    /// All but those whose other tet still waits in the list of this worker, by its mark: a facet
    /// is inspected with the second of its tets. Where the two are in different workers' lists,
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
    /// How far apart samples of dO are: delta, from place to place.
    pub(super) sizing: &'a Sizing,
    /// No squared radius below this is above R2's bound anywhere.
    large_squared: f64,
    /// Squared radius below which R4 cannot apply: vertices keep a distance from each other
    /// (docs/reference/algorithm.md, why it ends).
    small_squared: f64,
    radius_edge_squared: f64,
    facet_cosine_squared: f64,
    /// Squared size bound of each label id; infinite for the background.
    sizes_squared: Vec<f64>,
    /// No squared radius below this is above what R5 allows at some place, whatever the label.
    size_somewhere_squared: f64,
}

/// R2 splits circumballs with a radius of more than this many deltas. The proof of termination
/// needs at least 2.
const LARGE: f64 = 2.0;

/// R6 removes free vertices that are closer than this many deltas to a new isovertex. The proof of
/// termination needs at least 0.5; the paper has 2 (docs/reference/algorithm.md, R6).
pub(super) const CLEARED: f64 = 1.0;

/// An interface facet may stray from the interface, at its circumcenter, by this part of delta.
pub const FACET_DISTANCE: f64 = 0.22;
/// Sampling for the sake of the facet distance keeps isovertices this part of delta apart.
pub const SPACING_FLOOR: f64 = 0.5;

/// Isovertices no farther than this part of delta from a wall are moved onto it. The corners of the
/// box are at a finite distance, so the ball of a facet on the wall and one of them reaches a
/// little into the object; what lies there would part the facet from the wall.
pub(super) const DRAWN_TO_WALL: f64 = 0.25;
/// What is inserted in place of a surface center keeps this part of delta from all vertices.
pub(super) const MIN_DISTANCE: f64 = 0.25;
/// Tets of an object within the cube of its size, as measured on the atlases.
pub const TETS_PER_SIZE: f64 = 8.0;

impl<'a> Rules<'a> {
    /// `sizing` tells how far apart samples are, nowhere above delta; `labels` are the labels of
    /// the oracle's ids.
    pub fn new(
        triangulation: &'a Triangulation,
        oracle: &'a Oracle,
        sizing: &'a Sizing,
        params: &MeshParams,
        labels: &[i32],
    ) -> Self {
        let size = |label| params.size_of(label);
        let sizes_squared = labels
            .iter()
            .enumerate()
            .map(|(id, &label)| if id == 0 { f64::INFINITY } else { size(label) * size(label) })
            .collect::<Vec<f64>>();
        let min_squared = sizing.min() * sizing.min();
        let size_somewhere_squared = sizing.tets().min().powi(2);
        let min_size_squared = sizes_squared.iter().copied().fold(size_somewhere_squared, f64::min);
        let closest_squared =
            (0.25 * min_size_squared).min(MIN_DISTANCE * MIN_DISTANCE * min_squared);
        let radius_edge_squared = params.radius_edge * params.radius_edge;
        Self {
            triangulation,
            oracle,
            sizing,
            large_squared: LARGE * LARGE * min_squared,
            radius_edge_squared,
            // Less a little, for rounding.
            small_squared: 0.999 * radius_edge_squared * closest_squared,
            facet_cosine_squared: params.facet_angle.to_radians().cos().powi(2),
            sizes_squared,
            size_somewhere_squared,
        }
    }

    /// The triangulation that they are asked about.
    pub fn triangulation(&self) -> &'a Triangulation {
        self.triangulation
    }

    /// Whether the label of a tet is known.
    pub(super) fn has_label(&self, t: TetId) -> bool {
        self.triangulation.tet(t).tag() != LABEL_UNKNOWN
    }

    /// Whether the box around a tet's circumball comes near to some blocks; that of a flat tet,
    /// whose circumball is not known, always does.
    pub fn is_near(&self, t: TetId, blocks: &NearBlocks) -> bool {
        let sphere = self.triangulation.tet(t).sphere();
        blocks.meet_ball(sphere.center, sphere.squared_radius())
    }

    /// All tets whose circumballs meet some blocks, and others [near](Self::is_near) to them, in
    /// the order of their slots, if the blocks are few; `None`: it takes less to go through all
    /// slots. Of a triangulation at rest.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); those of `go_on`.
    pub fn few_near(
        &self,
        blocks: &NearBlocks,
        go_on: impl Fn() -> Result<()>,
    ) -> Result<Option<Vec<TetId>>> {
        let is_near = |t| self.is_near(t, blocks);
        let reached = || self.triangulation.tets_reached(blocks.points(), is_near, go_on);
        blocks.are_few().then(reached).transpose()
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

    /// Whether a demand of tet `t` is true. To be asked when `wanted.start`, which is the tet or
    /// its neighbour across the facet in question, is owned and was inspected across: then neither
    /// of the two can change.
    pub fn still_applies(&self, t: TetId, wanted: &RefinementPoint) -> bool {
        let record = self.triangulation.tet(t);
        wanted.seen.is(record)
            && wanted.across.is_none_or(|(facet, seen)| {
                let other = self.triangulation.tet(facet.tet());
                let back = other.neighbor(facet.index());
                // Asked of both: which of the two is owned is not known, and a tet that has been
                // freed still names its neighbours.
                back.tet() == t && record.neighbor(back.index()) == facet && seen.is(other)
            })
    }

    /// Tets to be expected within `volume` about `p`, those around samples of dO apart: for
    /// progress and the sharing of work alone.
    pub fn expected_tets(&self, p: DVec3, volume: f64) -> f64 {
        match self.oracle.label(p) {
            0 => 0.0,
            label => {
                let of_label = self.sizes_squared[usize::from(label)].sqrt();
                TETS_PER_SIZE * volume / of_label.min(self.sizing.tets().at(p)).powi(3)
            }
        }
    }
}
