//! What the rules still apply to when refinement has ended: demands that could not be carried out,
//! for rounding placed a point on a vertex or out of its conflict zone, or since a limit ended the
//! run.
//!
//! Refinement asks every tet after it was made, and each facet with the second of its tets. What it
//! finds it carries out, or notes as left over: what could not be inserted, and facets where a
//! vertex nearby stands in the way that may be removed. So when it has come to its end, a tet to
//! which a rule applies was noted, or the one across a facet was, or its circumcenter cannot be
//! computed and nothing was asked of it: asking these again counts what all tets would
//! ([`Asked::LeftOver`]). [`Asked::All`] relies on none of this. Debug builds compare the two.
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
use crate::delaunay::check::{CHECK_EVERY, Check};
use crate::delaunay::{TetId, TetStamp};
use crate::memory::{reserve, room};
use crate::monitor::{Monitor, Step};
use crate::oracle::CrossedEdge;

/// What refinement could not carry out.
#[derive(Clone, Debug, Default)]
pub struct LeftOver {
    /// The tets that demanded it; they may be gone by now.
    pub tets: Vec<TetStamp>,
    /// Samples of R1 that were not inserted.
    pub samples: u64,
}

impl LeftOver {
    /// Notes a tet.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    #[cold]
    pub(super) fn push(&mut self, stamp: TetStamp) -> Result<()> {
        reserve(&mut self.tets, 1, "demands that stay unmet")?;
        self.tets.push(stamp);
        Ok(())
    }

    /// Adds what another worker left over.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub(super) fn append(&mut self, mut other: Self) -> Result<()> {
        reserve(&mut self.tets, other.tets.len(), "demands that stay unmet")?;
        self.tets.append(&mut other.tets);
        self.samples += other.samples;
        Ok(())
    }
}

/// Which tets are asked whether a rule applies.
#[derive(Clone, Copy, Debug)]
pub enum Asked<'a> {
    /// All.
    All,
    /// Those that a refinement that came to its end has left over.
    LeftOver(&'a LeftOver),
}

/// Vertices of one piece of work, between two checks of the cancel flag.
const PIECE: u32 = 1 << 12;

/// Checks the triangulation, and counts the tets to which a rule still applies, by rule; `asked`
/// tells which tets are looked at for that, `order` is that of
/// [`Triangulation::tets_by_place`](crate::delaunay::Triangulation::tets_by_place). A tet of the
/// object that is too flat for its circumcenter to be computed counts under R4, and each
/// misshapen interface facet of such a tet under R3; under R1 count the crossed edges of the
/// image's grid that have no isovertex within delta.
///
/// # Errors
/// [`crate::Error::Cancelled`]; [`crate::Error::OutOfMemory`].
pub fn examine(
    rules: &Rules<'_>,
    order: &[TetId],
    asked: Asked<'_>,
    monitor: &Monitor<'_>,
) -> Result<(Check, [u64; 6])> {
    monitor.enter(Step::Unmet, 1)?;
    let uncovered = match asked {
        // All crossed edges have a sample, and all samples were inserted.
        Asked::LeftOver(LeftOver { samples: 0, .. }) => 0,
        _ => rules.uncovered_edges(monitor)?,
    };
    monitor.enter(Step::Validate, order.len() + rules.triangulation.vertex_bound() as usize)?;
    // Relaxed: sums, read when all pieces are done.
    let unmet: [AtomicU64; 6] = Default::default();
    let ask = |t: TetId| {
        if let Some(rule) = rules.unmet_rule(t) {
            unmet[rule as usize].fetch_add(1, Relaxed);
        }
        let undecided = rules.undecided_facets(t);
        if undecided > 0 {
            unmet[Rule::R3 as usize].fetch_add(undecided, Relaxed);
        }
    };
    let is_certain = |t: TetId| rules.triangulation.tet(t).sphere().is_certain();
    // Piece by piece, so that the tets are still in the cache.
    let check = rules.triangulation.check_in(order, |tets| {
        match asked {
            Asked::All => tets.iter().for_each(|&t| ask(t)),
            Asked::LeftOver(_) => tets.iter().filter(|&&t| !is_certain(t)).for_each(|&t| ask(t)),
        }
        monitor.advance(CHECK_EVERY)
    })?;
    if let Asked::LeftOver(left_over) = asked {
        let around = rules.with_neighbors(&left_over.tets)?;
        around.into_iter().filter(|&t| is_certain(t)).for_each(ask);
    }
    unmet[Rule::R1 as usize].fetch_add(uncovered, Relaxed);
    let unmet = unmet.map(AtomicU64::into_inner);
    if cfg!(debug_assertions) && matches!(asked, Asked::LeftOver(_)) {
        let (_, all) = examine(rules, order, Asked::All, &Monitor::silent())?;
        debug_assert_eq!(unmet, all, "what is left over, and what all tets demand");
    }
    Ok((check, unmet))
}

impl Rules<'_> {
    /// The tets of those stamps that are still there, and their neighbours, each once.
    fn with_neighbors(&self, stamps: &[TetStamp]) -> Result<Vec<TetId>> {
        let mut tets = room(5 * stamps.len(), "demands that stay unmet")?;
        for stamp in stamps.iter().filter(|&&stamp| self.triangulation.is_current(stamp)) {
            tets.push(stamp.tet);
            let record = self.triangulation.tet(stamp.tet);
            let neighbors = (0..4).map(|i| record.neighbor(i));
            tets.extend(neighbors.filter(|facet| !facet.is_none()).map(|facet| facet.tet()));
        }
        tets.sort_unstable();
        tets.dedup();
        Ok(tets)
    }

    /// The first rule that applies to a tet. With all tets each facet is asked once.
    fn unmet_rule(&self, t: TetId) -> Option<Rule> {
        let record = self.triangulation.tet(t);
        let mut interfaces = self.interfaces(t, record, Facets::Once);
        let wanted = self
            .surface_point(t, &mut interfaces, &mut Lookups::default())
            .or_else(|| self.volume_point(t, record));
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
            monitor.advance(0)?;
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
            monitor.advance(0)?;
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
