//! Coarsening: edges are contracted as long as what was asked for allows it.
//!
//! Refinement samples densely wherever something is thin, for it can't know where fewer samples
//! would do. The finished mesh knows: what a contraction ([`contraction`](super::contraction))
//! changes is seen at once. So a mesh that has all that the image has is made coarse afterwards,
//! and nothing is lost.
//!
//! It goes in passes. Each [improves](super::improve) the mesh, and contracts edges then; what
//! flips and moves have made better can be contracted further. The passes end after the fifth, or
//! when one contracts little. At delta 3 the brain's 4.7 M tets become 0.58 M.
//!
//! Improvement moves vertices. Each pass counts moves from where refinement put a vertex, so those
//! of several passes do not add up. Those of a vertex that two became count from the place on the
//! image's interface or line that they met at ([`meeting`](super::meeting)). (Flips count within
//! their pass alone.)
//! The volumes that labels gain and lose are counted, too; what comes after gives them back
//! ([`volumes`](super::volumes)).
//!
//! Within a pass vertices are tried in rounds of [blocks](super::blocks), the same for any number
//! of threads. A vertex that could not go anywhere is tried again once something around it has
//! changed.

use std::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::blocks::{Blocks, owner};
use super::contraction::{Bounds, Contractor, Round};
use super::interfaces::Interfaces;
use super::measure::{Measure, measure_of};
use super::report::{Counts, Improvement};
use super::shared::Shared;
use super::{CHUNK, Earlier, Effort, Settings, change};
use crate::memory::bits::Bits;
use crate::memory::{concatenated, reserve, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::{Monitor, Step};
use crate::{Error, Result};

/// New tets may have dihedral angles down to this, in degrees, where there were none as small: one
/// number for each pass. The first pass makes slivers for the sake of fewer tets; what comes after
/// removes nearly all of them. Measured on the abdomen at delta 6 with three passes: with 2, 6 and
/// 10 degrees 260 000 tets, of which 110 stay below 15 degrees; with 2 in each 226 000 and 5 200;
/// with 8 in each 307 000 and 98. The fourth pass leaves 12 % fewer tets there, the fifth 6 %.
const LEAST_DIHEDRALS: [f64; 5] = [2.0, 4.0, 7.0, 9.0, 10.0];
/// The passes before whose contractions no last resort of improvement is used: most of what it
/// could help is contracted then, and it takes a tenth to a fifth of the time.
const QUICK_PASSES: usize = 2;
/// The dihedral target of improvement from the second pass on, in degrees, if no larger one is
/// asked for. The better the tets are, the more edges can be contracted. Measured on AAL,
/// abdomen and brain at deltas of 3 and 6 mm: 9 to 16 % fewer tets than with a target of 15, and 7
/// to 30 % more time (three passes). Fewer tets stay below 15 degrees, but on AAL at 3, where there
/// are few. With a target of 25 in the third pass there are 5 % fewer tets, and it takes half as
/// long again.
const LATER_TARGET: f64 = 20.0;
/// How far from interfaces two vertices may meet, and how far interfaces may be moved from the
/// second pass on, if that is more than what the target allows: in parts of the smallest delta of
/// any label, but no more than this part of the smallest side of a voxel. Facets may stray by
/// `FACET_DISTANCE` of delta already. Without it the abdomen at delta 6 has 3 % more tets; with
/// 0.15 it has as many.
const TOLERANCE: f64 = 0.1;
const MAX_TOLERANCE: f64 = 0.5;
/// The passes end when one contracts less than this part of the vertices. With 0.03 the brain at
/// delta 3 has 2 % fewer tets, in a fifth more time.
const WORTHWHILE_PASS: f64 = 0.125;
/// Most rounds of a pass.
const MAX_ROUNDS: u32 = 24;
/// The rounds of a pass end when one contracts less than this part of the vertices. The next pass
/// tries them all again; after the last one few would still go.
const WORTHWHILE_ROUND: f64 = 4e-3;
/// Blocks have so many times the tets that they have in improvement: all tets of a vertex must be
/// the block's own, so more has to wait at borders.
const LARGER_BLOCKS: usize = 4;
/// How far the step of improvement is when the improvement of each pass ends, and when its
/// contractions do: about as on AAL and the abdomen at delta 6, one thread.
const PARTS: [[f64; 2]; 5] = [[0.03, 0.31], [0.48, 0.53], [0.66, 0.69], [0.81, 0.83], [0.93, PART]];
/// How many times as long the step of improvement takes with coarsening, for progress: 18 to 30
/// where what is thin was sampled densely, 2.4 where it was not.
pub const TIMES: [f64; 2] = [25.0, 3.0];
/// The part of the step of improvement that the passes are taken to have, for progress.
pub const PART: f64 = 0.95;

/// How coarse a mesh may become.
pub struct Coarseness<'a> {
    /// The least angle of new interface facets, in degrees.
    pub facet_angle: f64,
    /// How far apart samples may be anywhere.
    pub delta: f64,
    /// How far from the interface two vertices may meet, and how far interfaces may be moved from
    /// the second pass on.
    pub tolerance: f64,
    /// How far apart they may be on the interface of two labels, about a place.
    pub delta_between: &'a (dyn Fn([i32; 2], DVec3) -> f64 + Sync),
    /// The largest circumradius of a label's tets, about a place.
    pub size_of: &'a (dyn Fn(i32, DVec3) -> f64 + Sync),
}

/// What came of coarsening.
pub struct Coarsened {
    /// How many vertices of the mesh belong to tets of the object; they come first.
    pub points_kept: usize,
    /// Where moves of each vertex that is left are counted from: see [`Earlier::refined`].
    pub refined: Vec<[f64; 3]>,
    /// What was done.
    pub improvement: Improvement,
    /// The limit that ended the work early.
    pub ended: Option<Error>,
}

/// How far interfaces may be moved once edges were contracted: for a dihedral target in degrees,
/// where the smallest side of a voxel is `side`, and samples are `delta` apart.
pub fn tolerance(target: f64, side: f64, delta: f64) -> f64 {
    let of_target = super::tolerance(target.max(LATER_TARGET)) * side;
    of_target.max((TOLERANCE * delta).min(MAX_TOLERANCE * side))
}

/// Makes `mesh` coarser, which has the tets of the background around the object, too. No slot of a
/// tet is empty afterwards, and no vertex without a tet. The mesh is valid where a limit ended the
/// work as well.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]. The mesh is of no use then.
pub fn coarsen(
    mesh: &mut TetMesh,
    settings: &Settings<'_>,
    coarseness: &Coarseness<'_>,
    monitor: &Monitor<'_>,
) -> Result<Coarsened> {
    let tets_before = mesh.labels.par_iter().filter(|&&label| label != 0).count() as u64;
    let mut coarsened = Coarsened {
        points_kept: 0,
        refined: Vec::new(),
        improvement: Improvement { tets_before, ..Improvement::default() },
        ended: None,
    };
    let mut from = 0.0;
    let passes = LEAST_DIHEDRALS.into_iter().zip(PARTS).enumerate();
    for (pass, (least_dihedral, [middle, to])) in passes {
        let improving = Settings {
            volumes: &[],
            tolerance: if pass == 0 { settings.tolerance } else { coarseness.tolerance },
            is_delaunay: settings.is_delaunay && pass == 0,
            target: if pass == 0 { settings.target } else { settings.target.max(LATER_TARGET) },
            parts: [from, middle],
            ..*settings
        };
        from = to;
        let earlier =
            Earlier { refined: std::mem::take(&mut coarsened.refined), ..Earlier::default() };
        let effort = if pass < QUICK_PASSES { Effort::Quick } else { Effort::Full };
        let (mut improvement, improved, ended) =
            change(mesh, &improving, earlier, effort, monitor)?;
        coarsened.refined = improved.refined;
        if pass > 0 {
            improvement.add_earlier(&coarsened.improvement);
        }
        coarsened.improvement = Improvement { tets_before, ..improvement };
        if coarsened.is_ended(mesh, ended, monitor)? {
            break;
        }
        let vertices = mesh.points.len();
        monitor.enter_part(Step::Improve, vertices, [middle, to])?;
        let run = Pass::new(settings, coarseness, least_dihedral);
        let report_and_check = |done| monitor.advance(done).and_then(|()| (settings.check_time)());
        let (counts, ended) = run.run(mesh, &mut coarsened.refined, &report_and_check)?;
        coarsened.improvement.counts.add(&counts);
        let little = (counts.contractions as f64) < WORTHWHILE_PASS * vertices as f64;
        if coarsened.is_ended(mesh, ended, monitor)? || little {
            break;
        }
    }
    Ok(coarsened)
}

impl Coarsened {
    /// Closes the gaps of a mesh after a part of the work, and notes the limit that ended this.
    /// Returns whether one did.
    fn is_ended(
        &mut self,
        mesh: &mut TetMesh,
        ended: Option<Error>,
        monitor: &Monitor<'_>,
    ) -> Result<bool> {
        if let Some(cancelled @ Error::Cancelled) = ended {
            return Err(cancelled);
        }
        // Nobody asks where those of splits were: they are inside of labels, and remain so.
        let of_splits = self.refined.len()..mesh.points.len();
        reserve(&mut self.refined, of_splits.len(), "vertices of the mesh")?;
        self.refined.extend_from_slice(&mesh.points[of_splits]);
        self.points_kept = mesh.compact(&mut self.refined, monitor)?;
        self.ended = ended;
        Ok(self.ended.is_some())
    }
}

/// One pass of contractions.
struct Pass<'a> {
    interfaces: Interfaces<'a>,
    measure: Measure,
    bounds: Bounds<'a>,
}

impl<'a> Pass<'a> {
    fn new(settings: &Settings<'a>, coarseness: &Coarseness<'a>, least_dihedral: f64) -> Self {
        let &Coarseness { facet_angle, delta, delta_between, size_of, .. } = coarseness;
        let bounds = Bounds {
            delta: delta_between,
            size: size_of,
            longest: delta,
            tet_measure: measure_of(least_dihedral),
            facet_measure: measure_of(facet_angle),
        };
        let measure = Measure::new(settings.target, settings.radius_edge);
        let settings = Settings { tolerance: coarseness.tolerance, ..*settings };
        Self { interfaces: Interfaces::new(&settings), measure, bounds }
    }

    /// Contracts edges. Slots of tets that are gone are left empty. Where two vertices met is noted
    /// in `refined`. Returns what was done, and what ended the work early; the mesh is then valid,
    /// too.
    fn run(
        &self,
        mesh: &mut TetMesh,
        refined: &mut [[f64; 3]],
        report_and_check: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<(Counts, Option<Error>)> {
        const WHAT: &str = "vertices to be contracted";
        let vertices = mesh.points.len();
        let blocks = Blocks::new(&mesh.points, mesh.tets.len() / LARGER_BLOCKS);
        let changed = Bits::new(mesh.tets.len(), "tets of the mesh")?;
        let mut to_try: Vec<u8> = zeroed(vertices, WHAT)?;
        to_try.fill(1);
        let mut counts = Counts::default();
        for round in 0..MAX_ROUNDS {
            if let Err(ended) = report_and_check(0) {
                return Ok((counts, Some(ended)));
            }
            let of_vertices = blocks.of_vertices(mesh, round)?;
            let owned = owned_tets(mesh, &of_vertices, &to_try)?;
            let block = |owned: u64| (owned >> 32) as u32;
            let jobs: Vec<&[u64]> = owned.chunk_by(|&a, &b| block(a) == block(b)).collect();
            let tets: Vec<AtomicU32> = zeroed(vertices, WHAT)?;
            tets.par_iter().for_each(|t| t.store(NONE, Relaxed));
            let next: Vec<AtomicU8> = zeroed(vertices, WHAT)?;
            let shared = Round {
                shared: Shared::new(mesh, &changed),
                blocks: &of_vertices,
                to_try: &to_try,
                tets: &tets,
                next: &next,
                interfaces: &self.interfaces,
                measure: self.measure,
                bounds: &self.bounds,
                report_and_check,
            };
            let work = |job: &[u64]| {
                let mut contractor = Contractor::new(&shared, block(job[0]));
                let ended = contractor.run(job.iter().map(|&owned| owned as u32)).err();
                (contractor.counts, contractor.met, ended)
            };
            let done: Vec<_> = jobs.into_par_iter().with_max_len(1).map(work).collect();
            let before = counts.contractions;
            let mut ended = None;
            for (of_block, met, ended_block) in done {
                counts.add(&of_block);
                met.into_iter().for_each(|(v, on)| refined[v as usize] = on.into());
                ended = ended.or(ended_block);
            }
            if ended.is_some() {
                return Ok((counts, ended));
            }
            // A vertex of which its block owned no tet has not been tried.
            to_try.par_iter_mut().zip(&next).zip(&tets).for_each(|((to_try, next), tet)| {
                let waits = *to_try == 1 && tet.load(Relaxed) == NONE;
                *to_try = u8::from(waits || next.load(Relaxed) == 1);
            });
            let contracted = counts.contractions - before;
            if (contracted as f64) < WORTHWHILE_ROUND * vertices as f64 {
                break;
            }
        }
        Ok((counts, None))
    }
}

/// The tets with a vertex that is to be tried and the blocks that own them, by these: the block in
/// the upper half of a number and the tet in the lower one.
fn owned_tets(mesh: &TetMesh, blocks: &[u32], to_try: &[u8]) -> Result<Vec<u64>> {
    let chunks = mesh.tets.par_chunks(CHUNK).enumerate().map(|(chunk, tets)| {
        let mut owned = Vec::new();
        reserve(&mut owned, tets.len(), "tets to be contracted")?;
        for (t, tet) in (chunk * CHUNK..).zip(tets) {
            if tet[0] != NONE
                && tet.iter().any(|&v| to_try[v as usize] == 1)
                && let Some(owner) = owner(tet.map(|v| blocks[v as usize]))
            {
                owned.push(u64::from(owner) << 32 | t as u64);
            }
        }
        Ok(owned)
    });
    let mut owned = concatenated(chunks.collect::<Result<_>>()?, "tets to be contracted")?;
    owned.par_sort_unstable();
    Ok(owned)
}
