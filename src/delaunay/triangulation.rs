//! The shared structure: all tets and vertices, and the virtual box they live in.
//!
//! The box's eight corners are vertices like others, so every facet has two sides or lies on the
//! box and no case for infinity exists.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::*};
use std::sync::{Mutex, MutexGuard};

use glam::DVec3;

use super::chunked::{CHUNK, Chunked};
use super::numa::{NodeId, NodeMap};
use super::ownership::{FREE, NOBODY, Owner, OwnerId};
use super::tet::{
    FACET, Facet, MAX_TETS, MAX_VERTICES, TETS_PER_VERTEX, TetId, TetRecord, TetStamp, VertexId,
    VertexKind, VertexRecord, is_free, is_tet,
};
use crate::geometry::predicates::{in_sphere_perturbed, orient};
use crate::geometry::sphere::Circumsphere;
use crate::memory::aside::or_drop_aside;
use crate::sync::lock;
use crate::{Error, Result};

/// Number of box vertices; they have the first ids.
pub const BOX_VERTICES: u32 = 8;

/// Room for vertices, where there is as much for tets: every worker begins with a chunk of each.
const LEAST_ROOM: usize = 64 * CHUNK;

/// Tets by their slots.
pub type TetRecords = Chunked<TetRecord>;

/// A Delaunay triangulation of points strictly inside an axis-aligned box.
pub struct Triangulation {
    tets: TetRecords,
    vertices: Chunked<VertexRecord>,
    nodes: NodeMap,
    tet_chunks: AtomicU32,
    vertex_chunks: AtomicU32,
    /// Held while a chunk is made and counted, so that every chunk that is counted exists.
    growing: Mutex<()>,
    lower: DVec3,
    upper: DVec3,
}

impl Triangulation {
    /// The triangulation of the corners of a box.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] when the box is empty or not finite; [`Error::OutOfMemory`].
    pub fn new(lower: DVec3, upper: DVec3) -> Result<Self> {
        if !(lower.is_finite() && upper.is_finite() && lower.cmplt(upper).all()) {
            return Err(Error::InvalidArgument(format!(
                "the box from {lower} to {upper} is empty or not finite"
            )));
        }
        let tets = TetRecords::with_capacity_at_most(MAX_TETS)?;
        let room = (tets.capacity() / TETS_PER_VERTEX).max(LEAST_ROOM.min(tets.capacity()));
        let triangulation = Self {
            vertices: Chunked::with_capacity(room)?,
            tets,
            nodes: NodeMap::new()?,
            tet_chunks: AtomicU32::new(0),
            vertex_chunks: AtomicU32::new(0),
            growing: Mutex::new(()),
            lower,
            upper,
        };
        triangulation.triangulate_box()?;
        Ok(triangulation)
    }

    /// Gives the memory back, in the caller's rayon pool, as long as `go_on` says so; then aside.
    ///
    /// # Errors
    /// Those of `go_on`.
    pub fn give_back(self, go_on: &(dyn Fn() -> Result<()> + Sync)) -> Result<()> {
        self.into_tets(go_on)?.give_back(go_on)
    }

    /// The records of the tets alone; the memory of all others is given back.
    ///
    /// # Errors
    /// Those of `go_on`; after a cancellation all is given back aside.
    pub fn into_tets(self, go_on: &(dyn Fn() -> Result<()> + Sync)) -> Result<TetRecords> {
        let (tets, ()) = or_drop_aside(self.tets, |_| self.vertices.give_back(go_on))?;
        Ok(tets)
    }

    /// The records of all slots of tets.
    pub fn tets(&self) -> &TetRecords {
        &self.tets
    }

    /// The perturbed Delaunay triangulation of eight cospherical points, by its definition: of all
    /// positive tets of corners, those in conflict with no other corner.
    fn triangulate_box(&self) -> Result<()> {
        let first_tet = self.claim_tets(0)?.start;
        let first_vertex = self.claim_vertices(0)?.start;
        debug_assert!(first_tet == 0 && first_vertex == 0);
        let corners: [DVec3; 8] = std::array::from_fn(|i| {
            let pick =
                |axis: usize| if i >> axis & 1 == 0 { self.lower[axis] } else { self.upper[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        });
        for (i, &corner) in corners.iter().enumerate() {
            self.vertex(i as u32).fill(corner, VertexKind::Box);
        }
        let mut tets: Vec<[u32; 4]> = Vec::new();
        for subset in 0_u32..256 {
            if subset.count_ones() != 4 {
                continue;
            }
            let mut ids: Vec<u32> = (0..8).filter(|i| subset >> i & 1 == 1).collect();
            let points =
                |ids: &[u32]| -> [DVec3; 4] { std::array::from_fn(|k| corners[ids[k] as usize]) };
            let [a, b, c, d] = points(&ids);
            let sign = orient(a, b, c, d);
            if sign == 0.0 {
                continue;
            }
            if sign < 0.0 {
                ids.swap(0, 1);
            }
            let positive = points(&ids);
            let empty = (0..8_u32)
                .filter(|i| subset >> i & 1 == 0)
                .all(|i| !in_sphere_perturbed(positive, corners[i as usize]));
            if empty {
                tets.push([ids[0], ids[1], ids[2], ids[3]]);
            }
        }
        for (t, &vertices) in tets.iter().enumerate() {
            self.fill_tet(t as u32, vertices, 0, NOBODY);
            for v in vertices {
                self.vertex(v).set_star(t as u32);
            }
        }
        let sorted_facet = |t: usize, i: usize| {
            let mut f = FACET[i].map(|k| tets[t][k]);
            f.sort_unstable();
            f
        };
        for t in 0..tets.len() {
            for i in 0..4 {
                let twin = (0..tets.len())
                    .flat_map(|s| (0..4).map(move |j| (s, j)))
                    .find(|&(s, j)| s != t && sorted_facet(s, j) == sorted_facet(t, i));
                let neighbor = twin.map_or(Facet::NONE, |(s, j)| Facet::new(s as u32, j));
                self.tet(t as u32).set_neighbor(i, neighbor);
            }
        }
        Ok(())
    }

    /// The lower corner of the box.
    pub fn lower(&self) -> DVec3 {
        self.lower
    }

    /// The upper corner of the box.
    pub fn upper(&self) -> DVec3 {
        self.upper
    }

    /// Whether `p` lies strictly inside the box, as every inserted point must.
    #[inline]
    pub fn holds(&self, p: DVec3) -> bool {
        p.cmpgt(self.lower).all() && p.cmplt(self.upper).all()
    }

    /// The record of a tet slot.
    #[inline(always)]
    pub fn tet(&self, t: TetId) -> &TetRecord {
        self.tets.get(t)
    }

    /// Fetches the neighbours of a tet into the cache: whoever inspects them next need not wait.
    #[inline]
    pub fn prefetch_neighbors(&self, tet: &TetRecord) {
        for i in 0..4 {
            // A facet on the box names a tet far beyond all that exist.
            self.tets.prefetch(tet.neighbor(i).tet());
        }
    }

    /// Fetches the record of a slot into the cache, if there is such a slot.
    #[inline(always)]
    pub fn prefetch(&self, t: TetId) {
        self.tets.prefetch(t);
    }

    /// Fetches the record of a slot that a sweep in the order of slots, which is at slot `t`, comes
    /// to in the time of some accesses to memory: not every machine sees by itself that lines are
    /// read one after the other.
    #[inline(always)]
    pub fn prefetch_next(&self, t: TetId) {
        const AHEAD: u32 = 24;
        self.tets.prefetch(t + AHEAD);
    }

    /// Fetches the vertices and the neighbours of a tet, whose record should be in the cache.
    #[inline(always)]
    pub fn prefetch_around(&self, t: TetId) {
        let record = self.tet(t);
        self.prefetch_neighbors(record);
        (0..4).for_each(|i| self.vertices.prefetch(record.vertex(i)));
    }

    /// Fetches what [`Self::corners`] looks up.
    #[inline(always)]
    pub fn prefetch_corners(&self, vertices: [VertexId; 4]) {
        vertices.into_iter().for_each(|v| self.vertices.prefetch(v));
    }

    /// Fetches what an operation that destroys a tet needs of it besides its record: the vertex
    /// opposite to facet `entry`, through which the tet was found. The other three are those of the
    /// tet before it.
    #[inline]
    pub(super) fn prefetch_rest(&self, tet: &TetRecord, entry: usize) {
        self.vertices.prefetch(tet.vertex(entry));
    }

    /// The record of a vertex.
    #[inline(always)]
    pub fn vertex(&self, v: VertexId) -> &VertexRecord {
        self.vertices.get(v)
    }

    /// Whose the tet in a slot is.
    #[inline(always)]
    pub(super) fn owner(&self, t: TetId) -> &Owner {
        self.tet(t).owner()
    }

    /// Where chunks are at home.
    pub fn node_map(&self) -> &NodeMap {
        &self.nodes
    }

    /// Where a vertex is.
    #[inline(always)]
    pub fn position(&self, v: VertexId) -> DVec3 {
        self.vertex(v).position()
    }

    /// Where the vertices of a tet are.
    #[inline(always)]
    pub fn corners(&self, vertices: [VertexId; 4]) -> [DVec3; 4] {
        [
            self.position(vertices[0]),
            self.position(vertices[1]),
            self.position(vertices[2]),
            self.position(vertices[3]),
        ]
    }

    /// Whether `p` is in conflict with a positive tet of these vertices, by the exact predicate:
    /// for where the bounds of its sphere do not tell. `None` when `p` is one of them.
    pub fn exact_conflict(&self, vertices: [VertexId; 4], p: DVec3) -> Option<bool> {
        let corners = self.corners(vertices);
        (!corners.contains(&p)).then(|| in_sphere_perturbed(corners, p))
    }

    /// Whether the tet that the stamp was taken of still lives; [`TetStamp`] tells of the
    /// exception.
    #[inline(always)]
    pub fn is_current(&self, stamp: TetStamp) -> bool {
        self.tet(stamp.tet).vertex(3) == stamp.last
    }

    /// A stamp of the tet that is in the slot, or of none if another worker has just freed it.
    #[inline(always)]
    pub fn stamp(&self, tet: TetId) -> TetStamp {
        TetStamp { tet, last: self.tet(tet).vertex(3) }
    }

    /// All living tets, in the order of their slots. Not to be used while others operate.
    pub fn living_tets(&self) -> impl Iterator<Item = TetId> + '_ {
        (0..self.tet_bound()).filter(|&t| self.is_living(t))
    }

    /// Whether a tet lives in the slot. Not to be used while others operate.
    #[inline]
    pub fn is_living(&self, t: TetId) -> bool {
        is_tet(self.tet(t).vertices())
    }

    /// Tets and slots that a worker owns, and free slots that do not say so: 0 when no operation is
    /// under way. Not to be used while others operate.
    pub fn left_over(&self) -> usize {
        let is_left_over = |t: &TetId| {
            let record = self.tet(*t);
            !record.owner().is(if is_free(record.vertices()) { FREE } else { NOBODY })
        };
        (0..self.tet_bound()).filter(is_left_over).count()
    }

    /// The slots among which the tets of the box were made.
    pub fn box_slots(&self) -> Range<TetId> {
        0..CHUNK as u32
    }

    /// Slots below this may hold tets.
    pub fn tet_bound(&self) -> u32 {
        self.tet_chunks.load(Acquire) * CHUNK as u32
    }

    /// Bytes of all chunks.
    pub fn bytes(&self) -> u64 {
        u64::from(self.tet_chunks.load(Relaxed)) * TetRecords::CHUNK_BYTES as u64
            + u64::from(self.vertex_chunks.load(Relaxed))
                * Chunked::<VertexRecord>::CHUNK_BYTES as u64
    }

    /// No id of a vertex is as large.
    pub fn vertex_capacity(&self) -> usize {
        self.vertices.capacity()
    }

    /// Ids below this may be vertices.
    pub fn vertex_bound(&self) -> u32 {
        self.vertex_chunks.load(Acquire) * CHUNK as u32
    }

    /// The tet across facet `facet`, or `None` on the box.
    #[inline]
    pub fn across(&self, facet: Facet) -> Option<TetId> {
        let neighbor = self.tet(facet.tet()).neighbor(facet.index());
        (!neighbor.is_none()).then(|| neighbor.tet())
    }

    /// Writes a new tet into a free slot, with its circumsphere; neighbours follow.
    #[inline]
    pub(super) fn fill_tet(&self, t: TetId, vertices: [VertexId; 4], mark: u8, owner: OwnerId) {
        let [a, b, c, d] = self.corners(vertices);
        self.tet(t).fill(vertices, &Circumsphere::of_tet(a, b, c, d), mark, owner);
    }

    /// A range of fresh tet slots for one worker, at home on its node.
    pub(super) fn claim_tets(&self, node: NodeId) -> Result<Range<u32>> {
        let _growing = self.growing();
        let chunk = self.tet_chunks.load(Relaxed);
        if chunk as usize >= MAX_TETS / CHUNK {
            return Err(Error::LimitReached(format!(
                "the triangulation would exceed {MAX_TETS} tets"
            )));
        }
        self.tets.make_chunk(chunk as usize)?;
        self.nodes.set_tets(chunk as usize, node);
        let slots = chunk * CHUNK as u32..(chunk + 1) * CHUNK as u32;
        // Release: whoever counts the chunk finds it.
        self.tet_chunks.store(chunk + 1, Release);
        Ok(slots)
    }

    /// Gets memory for slots of one chunk that are about to be used for the first time.
    pub(super) fn populate(&self, slots: Range<TetId>) {
        self.tets.populate(slots);
    }

    /// A range of fresh vertex ids for one worker, at home on its node.
    pub(super) fn claim_vertices(&self, node: NodeId) -> Result<Range<u32>> {
        let _growing = self.growing();
        let chunk = self.vertex_chunks.load(Relaxed);
        if chunk as usize >= MAX_VERTICES / CHUNK {
            return Err(Error::LimitReached(format!(
                "the triangulation would exceed {MAX_VERTICES} vertices"
            )));
        }
        self.vertices.make_chunk(chunk as usize)?;
        self.nodes.set_vertices(chunk as usize, node);
        let ids = chunk * CHUNK as u32..(chunk + 1) * CHUNK as u32;
        // Release: as above.
        self.vertex_chunks.store(chunk + 1, Release);
        Ok(ids)
    }

    fn growing(&self) -> MutexGuard<'_, ()> {
        lock(&self.growing)
    }
}
