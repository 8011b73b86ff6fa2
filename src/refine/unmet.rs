//! What the rules still apply to when refinement has ended: demands that could not be carried out,
//! for rounding placed a point on a vertex or out of its conflict zone, or since a limit ended the
//! run.
//!
//! Reads only, in parallel in the current rayon pool; nobody may operate on the triangulation
//! meanwhile. The counts do not depend on the number of threads. Linear in the tets, which are gone
//! through in the order of their places, and in the cells of the image through which interfaces
//! pass.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::cell_table::MAX_HEADS;
use super::recent::Recent;
use super::rules::{Facets, ISOVERTEX, Lookups, Rule, Rules};
use super::vertex_grid::VertexGrid;
use crate::Result;
use crate::delaunay::TetId;
use crate::delaunay::check::{CHECK_EVERY, Check};
use crate::monitor::{Monitor, Step};
use crate::oracle::CrossedEdge;

/// Vertices of one piece of work, between two checks of the cancel flag.
const PIECE: u32 = 1 << 12;

/// Checks the triangulation, and counts the tets to which a rule still applies, by rule; `order` is
/// that of [`Triangulation::tets_by_place`](crate::delaunay::Triangulation::tets_by_place). A tet
/// of the object that is too flat for its circumcenter to be computed counts under R4, and each
/// misshapen interface facet of such a tet under R3; under R1 count the crossed edges of the
/// image's grid that have no isovertex within delta.
///
/// # Errors
/// [`crate::Error::Cancelled`]; [`crate::Error::OutOfMemory`].
pub fn examine(
    rules: &Rules<'_>,
    order: &[TetId],
    monitor: &Monitor<'_>,
) -> Result<(Check, [u64; 6])> {
    monitor.enter(Step::Unmet, 1)?;
    let uncovered = rules.uncovered_edges(monitor)?;
    monitor.enter(Step::Validate, order.len() + rules.triangulation.vertex_bound() as usize)?;
    // Relaxed: sums, read when all pieces are done.
    let unmet: [AtomicU64; 6] = Default::default();
    // Piece by piece, so that the tets are still in the cache.
    let check = rules.triangulation.check_in(order, |tets| {
        let mut undecided = 0;
        for &t in tets {
            if let Some(rule) = rules.unmet_rule(t) {
                unmet[rule as usize].fetch_add(1, Relaxed);
            }
            undecided += rules.undecided_facets(t);
        }
        unmet[Rule::R3 as usize].fetch_add(undecided, Relaxed);
        monitor.advance(CHECK_EVERY)
    })?;
    unmet[Rule::R1 as usize].fetch_add(uncovered, Relaxed);
    Ok((check, unmet.map(AtomicU64::into_inner)))
}

impl Rules<'_> {
    /// The first rule that applies to a tet. With all tets each facet is asked once.
    fn unmet_rule(&self, t: TetId) -> Option<Rule> {
        let mut interfaces = self.interfaces(t, Facets::Once);
        let wanted = self
            .surface_point(t, &mut interfaces, &mut Lookups::default())
            .or_else(|| self.volume_point(t));
        wanted.map(|wanted| wanted.rule).or_else(|| self.is_undecided(t).then_some(Rule::R4))
    }

    /// How many crossed edges of the image's grid have no isovertex within delta: where R1 is
    /// unmet.
    fn uncovered_edges(&self, monitor: &Monitor<'_>) -> Result<u64> {
        let bound = self.triangulation.vertex_bound();
        // Chains of about one vertex: the triangulation and the mesh are there as well, so memory
        // is short.
        let heads = (bound as usize).clamp(1, MAX_HEADS);
        let cell = 2.0 * self.sizing.max();
        let isovertices = VertexGrid::new(self.triangulation, ISOVERTEX, cell, heads)?;
        (0..bound.div_ceil(PIECE)).into_par_iter().try_for_each(|piece| {
            monitor.check_cancelled()?;
            for v in piece * PIECE..((piece + 1) * PIECE).min(bound) {
                let vertex = self.triangulation.vertex(v);
                if vertex.kind() == ISOVERTEX {
                    isovertices.push(v, vertex.position())?;
                }
            }
            Ok(())
        })?;
        let grid = self.oracle.edge_grid(&self.sizing.palette());
        let rows = (0..grid.rows()).into_par_iter().map(|row| {
            monitor.check_cancelled()?;
            let mut uncovered = 0;
            let mut recent = Recent::new();
            grid.visit_row(row, |CrossedEdge { point, spacing, .. }| {
                if !recent.any_within(point, spacing) {
                    match isovertices.any_within(self.triangulation, point, spacing) {
                        Some(v) => recent.remember(self.triangulation.position(v)),
                        None => uncovered += 1,
                    }
                }
                Ok(())
            })?;
            Ok(uncovered)
        });
        rows.try_reduce(|| 0, |a, b| Ok(a + b))
    }
}
