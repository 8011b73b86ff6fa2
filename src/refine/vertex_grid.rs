//! Which vertices lie near a point: R1 asks for isovertices, R6 for free vertices.
//!
//! Uniform cells folded into a table of chains. Vertices are pushed and never taken out; a removed
//! vertex stays in its chain and is passed over by its kind, which is sound because vertex ids are
//! never used twice.
//!
//! Thread safety: `push` and queries may run at once on any number of threads; a query may miss
//! what is pushed meanwhile.

use std::sync::atomic::{AtomicU32, Ordering::*};

use glam::DVec3;

use super::cell_table::CellTable;
use crate::Result;
use crate::delaunay::chunked::{CHUNK, Chunked};
use crate::delaunay::tet::NO_VERTEX;
use crate::delaunay::{Triangulation, VertexId, VertexKind};
use crate::memory::room;

/// Vertices of one kind by position.
pub struct VertexGrid {
    kind: VertexKind,
    cells: CellTable,
    heads: Vec<AtomicU32>,
    next: Chunked<AtomicU32>,
}

impl VertexGrid {
    /// A grid over the triangulation's box, for vertices of `kind`, with no more than `max_heads`
    /// chains, at least 1; queries with radii up to half of `cell` look at no more than eight
    /// cells.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        triangulation: &Triangulation,
        kind: VertexKind,
        cell: f64,
        max_heads: usize,
    ) -> Result<Self> {
        let cells = CellTable::new(triangulation.lower(), triangulation.upper(), cell, max_heads);
        let mut no_chains = room(cells.heads(), "cells of a vertex grid")?;
        no_chains.resize_with(cells.heads(), || AtomicU32::new(NO_VERTEX));
        Ok(Self {
            kind,
            cells,
            heads: no_chains,
            next: Chunked::with_capacity(triangulation.vertex_capacity())?,
        })
    }

    /// Bytes held when the triangulation has ids up to `vertex_bound`; at most, for pages without a
    /// vertex of the grid are never touched.
    pub fn bytes(&self, vertex_bound: u32) -> u64 {
        size_of::<AtomicU32>() as u64 * (self.heads.len() as u64 + u64::from(vertex_bound))
    }

    /// Adds vertex `v` at `p`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; the vertex is not in the grid then.
    pub fn push(&self, v: VertexId, p: DVec3) -> Result<()> {
        self.next.make_chunk(v as usize / CHUNK)?;
        let head = &self.heads[self.cells.head_of(p)];
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

    /// Calls `visit` for every vertex of the grid's kind closer than `radius` to `p`, until it
    /// returns `false`. Cells that share a chain can show a vertex twice.
    #[inline]
    pub fn visit_within(
        &self,
        triangulation: &Triangulation,
        p: DVec3,
        radius: f64,
        mut visit: impl FnMut(VertexId) -> bool,
    ) {
        let (from, to) = (self.cells.cell(p - radius), self.cells.cell(p + radius));
        let squared = radius * radius;
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    // Acquire: pairs with the release of push.
                    let mut v = self.heads[self.cells.head(x, y, z)].load(Acquire);
                    while v != NO_VERTEX {
                        let vertex = triangulation.vertex(v);
                        if vertex.position().distance_squared(p) < squared
                            && vertex.kind() == self.kind
                            && !visit(v)
                        {
                            return;
                        }
                        v = self.next.get(v).load(Relaxed);
                    }
                }
            }
        }
    }

    /// A vertex of the grid's kind that lies closer than `radius` to `p`.
    #[inline]
    pub fn any_within(
        &self,
        triangulation: &Triangulation,
        p: DVec3,
        radius: f64,
    ) -> Option<VertexId> {
        let mut found = None;
        self.visit_within(triangulation, p, radius, |v| {
            found = Some(v);
            false
        });
        found
    }
}
