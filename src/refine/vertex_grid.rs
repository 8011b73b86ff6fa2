//! Which vertices lie near a point: R1 asks for isovertices, R6 for free vertices.
//!
//! Uniform cells folded into a table of chains. Vertices are pushed and never taken out; a removed vertex stays in its chain and is passed over by its
//! kind, which is sound because vertex ids are never used twice.
//!
//! Thread safety: `push` and queries may run at once on any number of threads; a query may miss what is pushed meanwhile.

use std::sync::atomic::{AtomicU32, Ordering::*};

use glam::{DVec3, I64Vec3};

use crate::Result;
use crate::delaunay::chunked::{CHUNK, Chunked};
use crate::delaunay::tet::NO_VERTEX;
use crate::delaunay::{Triangulation, VertexId, VertexKind};
use crate::memory::room;

/// Most chain heads a grid has; more cells share them.
const MAX_HEADS: usize = 1 << 22;

/// Vertices of one kind by position.
pub struct VertexGrid {
    kind: VertexKind,
    lower: DVec3,
    per_cell: f64,
    row: u64,
    slice: u64,
    mask: u64,
    heads: Vec<AtomicU32>,
    next: Chunked<AtomicU32>,
}

impl VertexGrid {
    /// A grid over the triangulation's box, for vertices of `kind`; queries with radii up to half of `cell` look at no more than eight cells.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(triangulation: &Triangulation, kind: VertexKind, cell: f64) -> Result<Self> {
        let cells = ((triangulation.upper() - triangulation.lower()) / cell).ceil().max(DVec3::ONE);
        let heads = (cells.x * cells.y * cells.z).min(MAX_HEADS as f64) as usize;
        let heads = heads.next_power_of_two();
        let mut no_chains = room(heads, "cells of a vertex grid")?;
        no_chains.resize_with(heads, || AtomicU32::new(NO_VERTEX));
        Ok(Self {
            kind,
            lower: triangulation.lower(),
            per_cell: 1.0 / cell,
            row: cells.x as u64,
            slice: (cells.x * cells.y) as u64,
            mask: heads as u64 - 1,
            heads: no_chains,
            next: Chunked::with_capacity(crate::delaunay::tet::MAX_TETS / 4)?,
        })
    }

    /// Bytes held when the triangulation has ids up to `vertex_bound`; at most, for chunks without a vertex of the grid do not exist.
    pub fn bytes(&self, vertex_bound: u32) -> u64 {
        size_of::<AtomicU32>() as u64 * (self.heads.len() as u64 + u64::from(vertex_bound))
    }

    #[inline]
    fn cell(&self, p: DVec3) -> I64Vec3 {
        ((p - self.lower) * self.per_cell).as_i64vec3()
    }

    #[inline]
    fn head(&self, x: i64, y: i64, z: i64) -> &AtomicU32 {
        let index = (x as u64)
            .wrapping_add((y as u64).wrapping_mul(self.row))
            .wrapping_add((z as u64).wrapping_mul(self.slice));
        &self.heads[(index & self.mask) as usize]
    }

    /// Adds vertex `v` at `p`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]; the vertex is not in the grid then.
    pub fn push(&self, v: VertexId, p: DVec3) -> Result<()> {
        self.next.make_chunk(v as usize / CHUNK)?;
        let cell = self.cell(p);
        let head = self.head(cell.x, cell.y, cell.z);
        let mut first = head.load(Relaxed);
        loop {
            self.next.get(v).store(first, Relaxed);
            // Release: whoever finds v in the chain sees its link.
            match head.compare_exchange_weak(first, v, Release, Relaxed) {
                Ok(_) => return Ok(()),
                Err(now) => first = now,
            }
        }
    }

    /// Calls `visit` for every vertex of the grid's kind closer than `radius` to `p`, until it returns `false`. Cells that share a chain can
    /// show a vertex twice.
    #[inline]
    pub fn visit_within(
        &self,
        triangulation: &Triangulation,
        p: DVec3,
        radius: f64,
        mut visit: impl FnMut(VertexId) -> bool,
    ) {
        let (from, to) = (self.cell(p - radius), self.cell(p + radius));
        let squared = radius * radius;
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    // Acquire: pairs with the release of push.
                    let mut v = self.head(x, y, z).load(Acquire);
                    while v != NO_VERTEX {
                        let vertex = triangulation.vertex(v);
                        if vertex.position().distance_squared(p) < squared && vertex.kind() == self.kind && !visit(v) {
                            return;
                        }
                        v = self.next.get(v).load(Relaxed);
                    }
                }
            }
        }
    }

    /// Whether a vertex of the grid's kind lies closer than `radius` to `p`.
    #[inline]
    pub fn any_within(&self, triangulation: &Triangulation, p: DVec3, radius: f64) -> bool {
        let mut found = false;
        self.visit_within(triangulation, p, radius, |_| {
            found = true;
            false
        });
        found
    }
}
