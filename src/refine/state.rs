//! What the refinement writes down beside the triangulation, for the rules to read.
//!
//! - The **label of a tet** is that of its circumcenter: the kernel's tag.
//! - The **mark of a tet** says in which worker's list it waits to be inspected.
//! - The **tag of an isovertex** is the level of the sizing field there.
//! - **Free vertices** near interfaces are in a grid, for R6.

use glam::DVec3;
use rayon::prelude::*;

use super::cell_table::MAX_HEADS;
use super::rules::{CLEARED, ISOVERTEX, Rules};
use super::vertex_grid::VertexGrid;
use crate::Result;
use crate::delaunay::tet::TetRecord;
use crate::delaunay::worker::MARKS;
use crate::delaunay::{TetId, VertexId, VertexKind};
use crate::memory::reserve;

/// The mark of a tet that does not wait in the list that its mark names, that of the worker which
/// made it or was sent it: it was inspected, or waits in another list. No worker's mark.
const ELSEWHERE: u8 = MARKS as u8;

/// Vertices of one piece of work, between two looks at the cancel flag.
const PIECE: u32 = 1 << 12;

/// What is kept of the tets and vertices that the rules are asked about.
pub struct State<'a> {
    pub(super) rules: &'a Rules<'a>,
    free_vertices: VertexGrid,
}

impl<'a> State<'a> {
    /// Of a triangulation of nothing but its box.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(rules: &'a Rules<'a>) -> Result<Self> {
        let side = 2.0 * CLEARED * rules.sizing.max();
        let free_vertices =
            VertexGrid::new(rules.triangulation, VertexKind::Free, side, MAX_HEADS)?;
        Ok(Self { rules, free_vertices })
    }

    /// Of a triangulation that was refined before; and where its isovertices are, in the order of
    /// their ids.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `go_on`, which is asked again and again.
    pub(super) fn resumed(
        rules: &'a Rules<'a>,
        go_on: impl Fn() -> Result<()> + Sync,
    ) -> Result<(Self, Vec<DVec3>)> {
        let state = Self::new(rules)?;
        let bound = rules.triangulation.vertex_bound();
        let pieces = (0..bound.div_ceil(PIECE)).into_par_iter().map(|piece| {
            go_on()?;
            let (mut isovertices, mut free) = (Vec::new(), Vec::new());
            for v in piece * PIECE..((piece + 1) * PIECE).min(bound) {
                let vertex = rules.triangulation.vertex(v);
                let (kind, p) = (vertex.kind(), vertex.position());
                match kind {
                    ISOVERTEX => {
                        reserve(&mut isovertices, 1, "isovertices")?;
                        isovertices.push(p);
                        state.note_vertex(v, p, kind)?;
                    }
                    VertexKind::Free => {
                        reserve(&mut free, 1, "free vertices")?;
                        free.push((v, p));
                    }
                    _ => {}
                }
            }
            Ok((isovertices, free))
        });
        let pieces: Vec<_> = pieces.collect::<Result<_>>()?;
        let mut isovertices = Vec::new();
        for (of_piece, free) in pieces {
            reserve(&mut isovertices, of_piece.len(), "isovertices")?;
            isovertices.extend(of_piece);
            // In their order, which is that in which R6 finds them.
            free.into_iter().try_for_each(|(v, p)| state.note_vertex(v, p, VertexKind::Free))?;
        }
        Ok((state, isovertices))
    }

    /// Bytes of the oracle, the triangulation and the grids.
    pub fn bytes(&self) -> u64 {
        let Rules { triangulation, oracle, sizing, .. } = self.rules;
        (oracle.bytes() + sizing.bytes()) as u64
            + triangulation.bytes()
            + self.free_vertices.bytes(triangulation.vertex_bound())
    }

    /// Finds the labels of tets that nobody else can have come to, or that all stand still. A tag
    /// is written at no other time: whoever found a label while the tet is destroyed would write it
    /// to the next tet in the slot.
    pub fn find_labels(&self, tets: &[TetId]) {
        let tet = |i: usize| self.rules.triangulation.tet(tets[i]);
        let center = |i: usize| tet(i).sphere().center;
        if !self.rules.oracle.has_walls() {
            return self.rules.oracle.labels(
                tets.len(),
                center,
                |_| false,
                |i, label| tet(i).set_tag(label),
            );
        }
        let is_continued = |i: usize| Rules::is_within_walls(tet(i).vertices());
        self.rules.oracle.labels(tets.len(), center, is_continued, |i, label| {
            let record = tet(i);
            let is_outside =
                !record.sphere().is_certain() && self.rules.is_flat_on_wall(record.vertices());
            record.set_tag(if is_outside { 0 } else { label });
        });
    }

    /// Notes that a tet is no longer one that waits in the list that its mark names. A note that
    /// comes too late, to the slot's next tet, only makes its facets be inspected twice.
    #[inline]
    pub fn mark_elsewhere(tet: &TetRecord) {
        tet.set_mark(ELSEWHERE);
    }

    /// Notes a vertex that was inserted, an isovertex or a free one.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn note_vertex(&self, v: VertexId, p: DVec3, kind: VertexKind) -> Result<()> {
        if kind == ISOVERTEX {
            self.rules.triangulation.vertex(v).set_tag(self.rules.sizing.level(p));
        } else if self.rules.oracle.distance_bound(p) < CLEARED * self.rules.sizing.max() {
            // R6 reaches no farther from the interface.
            self.free_vertices.push(v, p)?;
        }
        Ok(())
    }

    /// R6: the free vertices that are too close to a new isovertex.
    pub fn near_free_vertices(&self, z: DVec3, found: &mut Vec<VertexId>) {
        found.clear();
        self.free_vertices.visit_within(
            self.rules.triangulation,
            z,
            CLEARED * self.rules.sizing.at(z),
            |v| {
                found.push(v);
                true
            },
        );
    }
}
