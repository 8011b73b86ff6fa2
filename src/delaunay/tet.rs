//! Records and ids.
//!
//! # Anatomy of a tet
//! ```text
//!            3            positive: (v1 - v0) x (v2 - v0) . (v3 - v0) > 0
//!           /|\           facet i is opposite to vertex i
//!          / | \          neighbour i lies across facet i
//!         /  |  \
//!        0---|---2        FACET[i]: the other three vertices, ordered so that
//!         \  |  /         (v[FACET[i][0]], v[FACET[i][1]], v[FACET[i][2]], v[i])
//!          \ | /          is a positive tet: the facet's normal points inwards
//!            1
//! ```
//! One tet is one 64-byte cache line: vertices, neighbours, circumcenter, squared radius with its
//! slack, words for the layer above, and whose it is.

use std::sync::atomic::{AtomicU8, AtomicU16, AtomicU32, AtomicU64, Ordering::*};

use bytemuck::Zeroable;
use glam::DVec3;

use super::chunked::CHUNK;
use super::ownership::{Owner, OwnerId};
use crate::geometry::sphere::Circumsphere;

/// Index of a vertex. Ids are never used twice in one triangulation.
pub type VertexId = u32;

/// The corners of the virtual box are the vertices before this one.
pub const BOX_VERTICES: VertexId = 8;
/// Index of a tet's slot. Slots are used again; a [`TetStamp`] tells whether the tet is still the
/// same.
pub type TetId = u32;

/// No vertex; as the last vertex of a tet it marks a slot that was freed.
pub const NO_VERTEX: VertexId = u32::MAX;

/// Whether these words stand in a slot that was freed.
#[inline(always)]
pub fn is_free(vertices: [VertexId; 4]) -> bool {
    vertices[3] == NO_VERTEX
}

/// Whether these are the vertices of a tet, and not what stands in a slot that was freed, or in one
/// that was never used, where all are 0. Of a triangulation at rest.
#[inline(always)]
pub fn is_tet(vertices: [VertexId; 4]) -> bool {
    !is_free(vertices) && vertices[0] != vertices[1]
}

/// `FACET[i]` lists the vertices of facet i, see the picture above.
pub const FACET: [[usize; 3]; 4] = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];

/// A tet and one of its facets, packed as `tet << 2 | facet`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Facet(u32);

impl Facet {
    /// No facet: the neighbour of a facet on the box.
    pub const NONE: Self = Self(u32::MAX);

    /// Facet `index` (0 to 3) of `tet`.
    #[inline(always)]
    pub fn new(tet: TetId, index: usize) -> Self {
        Self(tet << 2 | index as u32)
    }

    /// The tet.
    #[inline(always)]
    pub fn tet(self) -> TetId {
        self.0 >> 2
    }

    /// Which facet of the tet.
    #[inline(always)]
    pub fn index(self) -> usize {
        (self.0 & 3) as usize
    }

    /// Whether this is [`Facet::NONE`].
    #[inline(always)]
    pub fn is_none(self) -> bool {
        self == Self::NONE
    }
}

/// Most tets that packed facets can name, but for a chunk: its last facet would be [`Facet::NONE`].
pub const MAX_TETS: usize = (1 << 30) - CHUNK;
/// There is room for a vertex for so many tets: a triangulation has some six.
pub const TETS_PER_VERTEX: usize = 4;
/// Most vertices, removed ones included.
pub const MAX_VERTICES: usize = MAX_TETS / TETS_PER_VERTEX / CHUNK * CHUNK;

/// The record of a tet: one cache line.
#[repr(C, align(64))]
pub struct TetRecord {
    vertices: [AtomicU32; 4],
    neighbors: [AtomicU32; 4],
    center: [AtomicU64; 3],
    /// Both bounds of the sphere, see [`pack_bounds`].
    bounds: AtomicU32,
    /// Two words of the layer above, apart from the owner because the mark is written without
    /// owning the tet.
    tag: AtomicU16,
    mark: AtomicU8,
    owner: Owner,
}

/// What the word of the layer above is in a new tet.
pub const NO_TAG: u16 = u16::MAX;

/// The lowest bits of the packed outside bound, in which the slack stands.
const SLACK: u32 = 15;

/// The bounds of a sphere in one word. It is an f32, the outside bound, made larger by less than 4
/// millionths: rounded up to what the last four bits leave. These, c, tell the inside bound:
/// outside * (1 - 2^-2c), rounded down; c = 0 is certain of nothing.
#[inline(always)]
fn pack_bounds(sphere: &Circumsphere) -> u32 {
    let rounded = (sphere.outside.to_bits() + SLACK) & !SLACK;
    // Of the largest bound that it may become.
    let slack = 1.0 - sphere.inside / f32::from_bits(rounded | SLACK);
    // A power of two at least as large as the slack: the exponent above that of the slack. NaN and
    // slack >= 1/2 give 0.
    let exponent =
        if slack < 0.5 { 126 - (slack.max(f32::MIN_POSITIVE).to_bits() >> 23) } else { 0 };
    rounded | (exponent / 2).min(SLACK)
}

/// The inside and the outside bound.
#[inline(always)]
fn unpack_bounds(bounds: u32) -> (f32, f32) {
    let outside = f32::from_bits(bounds);
    let part = f32::from_bits((127 << 23) - ((bounds & SLACK) << 24));
    (outside - outside * part, outside)
}

impl TetRecord {
    /// The four vertices.
    #[inline(always)]
    pub fn vertices(&self) -> [VertexId; 4] {
        // Acquire: pairs with the release of fill, for those who inspect without owning.
        [0, 1, 2, 3].map(|i: usize| self.vertices[i].load(Acquire))
    }

    /// Vertex `i`, opposite to facet `i`.
    #[inline(always)]
    pub fn vertex(&self, i: usize) -> VertexId {
        // Acquire: as above.
        self.vertices[i].load(Acquire)
    }

    /// Makes this the record of a new tet with tag [`NO_TAG`], the given mark and owner; its
    /// neighbours follow by [`Self::set_neighbor`].
    #[inline(always)]
    pub(super) fn fill(
        &self,
        vertices: [VertexId; 4],
        sphere: &Circumsphere,
        mark: u8,
        owner: OwnerId,
    ) {
        for (slot, v) in self.vertices.iter().zip(vertices) {
            // Release: who reads the id finds the chunk of the vertex.
            slot.store(v, Release);
        }
        for (slot, x) in self.center.iter().zip(sphere.center.to_array()) {
            slot.store(x.to_bits(), Relaxed);
        }
        self.bounds.store(pack_bounds(sphere), Relaxed);
        self.tag.store(NO_TAG, Relaxed);
        self.mark.store(mark, Relaxed);
        self.owner.set(owner);
    }

    /// Marks the slot free.
    #[inline(always)]
    pub(super) fn clear(&self) {
        self.vertices[3].store(NO_VERTEX, Relaxed);
    }

    /// The facet of the neighbour that is this tet's facet `i`.
    #[inline(always)]
    pub fn neighbor(&self, i: usize) -> Facet {
        // Acquire: pairs with the release of set_neighbor, for those who inspect without owning.
        Facet(self.neighbors[i].load(Acquire))
    }

    #[inline(always)]
    pub(super) fn set_neighbor(&self, i: usize, facet: Facet) {
        // Release: who comes through the link finds a chunk, and a record that was filled or is all
        // zeros (`ownership`, memory order).
        self.neighbors[i].store(facet.0, Release);
    }

    /// The circumsphere.
    #[inline(always)]
    pub fn sphere(&self) -> Circumsphere {
        let (inside, outside) = unpack_bounds(self.bounds.load(Relaxed));
        let center = DVec3::from_array(
            [0, 1, 2].map(|i: usize| f64::from_bits(self.center[i].load(Relaxed))),
        );
        Circumsphere { center, inside, outside }
    }

    /// The first word of the layer above; [`NO_TAG`] in a new tet.
    #[inline(always)]
    pub fn tag(&self) -> u16 {
        self.tag.load(Relaxed)
    }

    /// Sets the first word of the layer above.
    #[inline(always)]
    pub fn set_tag(&self, tag: u16) {
        self.tag.store(tag, Relaxed);
    }

    /// The second word of the layer above; in a new tet the mark of the worker that made it.
    #[inline(always)]
    pub fn mark(&self) -> u8 {
        self.mark.load(Relaxed)
    }

    /// Sets the second word of the layer above.
    #[inline(always)]
    pub fn set_mark(&self, mark: u8) {
        self.mark.store(mark, Relaxed);
    }

    /// Whose it is.
    #[inline(always)]
    pub(super) fn owner(&self) -> &Owner {
        &self.owner
    }
}

/// A tet as it was when the stamp was taken: stale when the slot is free or holds another one.
///
/// The last vertex tells. Where an insertion made the tet that is the new vertex, whose id is never
/// used again: no other insertion gives it to the slot. A removal makes tets of old vertices, and
/// may give a slot the last vertex that it had before; then a stamp of the former tet is taken for
/// one of the new one. What is inspected for such a stamp is inspected once too often; what was
/// found out about the former tet is to be compared with the new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TetStamp {
    /// The slot.
    pub tet: TetId,
    /// The tet's last vertex.
    pub last: VertexId,
}

/// What a vertex is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum VertexKind {
    /// Not in the triangulation: not any more, or not yet.
    Removed = 0,
    /// A corner of the virtual box.
    Box = 1,
    /// One that the layer above means to keep.
    Fixed = 2,
    /// One that the layer above may remove.
    Free = 3,
}

/// The record of a vertex.
#[repr(C, align(32))]
pub struct VertexRecord {
    position: [AtomicU64; 3],
    /// A tet of the star.
    star: AtomicU32,
    kind: AtomicU8,
    /// A number that the vertex has within an operation, see `insert`; means nothing between
    /// operations, and others may write theirs meanwhile.
    local: AtomicU8,
    /// A word of the layer above.
    tag: AtomicU8,
}

impl VertexRecord {
    /// Where it is.
    #[inline(always)]
    pub fn position(&self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|i| f64::from_bits(self.position[i].load(Relaxed))))
    }

    /// What it is.
    #[inline(always)]
    pub fn kind(&self) -> VertexKind {
        match self.kind.load(Relaxed) {
            1 => VertexKind::Box,
            2 => VertexKind::Fixed,
            3 => VertexKind::Free,
            _ => VertexKind::Removed,
        }
    }

    /// A tet that has this vertex.
    #[inline(always)]
    pub fn star(&self) -> TetId {
        // Acquire: pairs with the release of set_star, for walks that start here without owning.
        self.star.load(Acquire)
    }

    /// The word of the layer above; 0 in a new vertex.
    #[inline(always)]
    pub fn tag(&self) -> u8 {
        self.tag.load(Relaxed)
    }

    /// Sets the word of the layer above.
    #[inline(always)]
    pub fn set_tag(&self, tag: u8) {
        self.tag.store(tag, Relaxed);
    }

    pub(super) fn fill(&self, position: DVec3, kind: VertexKind) {
        for (slot, x) in self.position.iter().zip(position.to_array()) {
            slot.store(x.to_bits(), Relaxed);
        }
        self.kind.store(kind as u8, Relaxed);
    }

    #[inline(always)]
    pub(super) fn set_star(&self, tet: TetId) {
        // Release: who reads the id finds the chunk of the tet.
        self.star.store(tet, Release);
    }

    #[inline(always)]
    pub(super) fn local(&self) -> u8 {
        self.local.load(Relaxed)
    }

    #[inline(always)]
    pub(super) fn set_local(&self, local: u8) {
        self.local.store(local, Relaxed);
    }

    pub(super) fn set_removed(&self) {
        self.kind.store(VertexKind::Removed as u8, Relaxed);
    }
}

// SAFETY: both records are atomic integers only, for which 0 is a value.
unsafe impl Zeroable for TetRecord {}
// SAFETY: as above.
unsafe impl Zeroable for VertexRecord {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn records_have_the_size_of_their_lines() {
        assert_eq!(size_of::<TetRecord>(), if cfg!(feature = "simulation") { 128 } else { 64 });
        assert_eq!(size_of::<VertexRecord>(), 32);
    }

    proptest! {
        // The packed bounds never claim more than the sphere did, and not much less.
        #[test]
        fn packed_bounds_contain_the_bounds(outside in 1e-6..1e6_f32, slack in 1e-7..1.5_f32) {
            let sphere =
                Circumsphere { center: DVec3::ZERO, inside: outside * (1.0 - slack), outside };
            let (inside_packed, outside_packed) = unpack_bounds(pack_bounds(&sphere));
            prop_assert!(outside <= outside_packed && outside_packed <= outside * (1.0 + 4e-6));
            // One unit of f32, which the widening of the bounds covers.
            prop_assert!(inside_packed <= sphere.inside.max(0.0) * (1.0 + f32::EPSILON));
            prop_assert!(slack >= 0.12 || inside_packed >= outside * (1.0 - 4.1 * slack.max(4e-6)));
        }
    }

    #[test]
    fn an_uncertain_sphere_stays_uncertain() {
        let sphere = Circumsphere { center: DVec3::ZERO, inside: -1.0, outside: f32::INFINITY };
        // Infinite minus infinite: a NaN, below which nothing is.
        let (inside, outside) = unpack_bounds(pack_bounds(&sphere));
        assert!(inside.is_nan() && outside == f32::INFINITY);
        assert!(!Circumsphere { inside, outside, ..sphere }.is_certain());
    }
}
