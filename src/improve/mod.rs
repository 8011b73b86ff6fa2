//! Mesh improvement: slivers go, the interfaces stay.
//!
//! Delaunay refinement bounds the ratio of circumradius to shortest edge, which flat tets (slivers)
//! can satisfy. Solvers need dihedral angles that are neither small nor near 180 degrees. So the
//! finished mesh is changed where it is worse than the target, and nowhere else. It is no longer
//! Delaunay there.
//!
//! These operations are tried in this order, worst tet first:
//! 1. Edge removal, inside of a label and on interfaces (`removal`, `ring`).
//! 2. Smoothing of the vertices, each along what it belongs to (`smoothing`, `climb`, `star`).
//! 3. Splits of edges inside of labels (`split`).
//!
//! An operation is carried out only if the least measure of the tets that it changes rises
//! (`measure`), and if every new tet is positive by its exact sign. So nothing is ever inverted,
//! and the work ends. Labels, their topology and the places of interfaces are kept; each
//! operation's file says how.
//!
//! The tets of the background around the object take part: they must stay positive, so that no two
//! parts of the object ever meet. They are dropped at the end.
//!
//! The mesh is divided into blocks that are improved side by side (`blocks`). **The result is the
//! same on any number of threads**, given the same refined mesh.
//!
//! Sources: L. A. Freitag and C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping and
//! smoothing", 1997; B. M. Klingner and J. R. Shewchuk, "Aggressive tetrahedral mesh improvement",
//! 2007. docs/reference/improvement.md has the measurements.
//!
//! | file | what |
//! |---|---|
//! | [`measure`], `batch` | how good a tet is, how good many are |
//! | `blocks` | which part of the mesh may be changed by whom |
//! | `shared` | the mesh's arrays for several threads |
//! | `rounds` | which block begins with what, round by round |
//! | `worker` | the queue of a block |
//! | `ring`, `removal` | edge removal |
//! | `star`, `climb`, `smoothing` | moves of vertices, one at a time |
//! | `joint`, `patch`, `minmax` | moves of several vertices at the same time |
//! | `split` | new vertices on edges |
//! | `volumes` | in the end: labels get back what they lost |
//! | `interfaces`, `flips` | what is asked about the image, and about refinement's interface |
//! | `coarsen`, `contraction`, `meeting`, `link` | before, where it is asked for: fewer tets |
//! | [`report`] | what was done |

mod batch;
mod blocks;
mod climb;
mod coarsen;
mod contraction;
mod flips;
mod interfaces;
mod joint;
mod link;
pub mod measure;
mod meeting;
mod minmax;
mod nicks;
mod patch;
mod removal;
pub mod report;
mod ring;
mod rounds;
mod shared;
mod smoothing;
mod split;
mod star;
mod volumes;
mod worker;

use rayon::prelude::*;

use crate::geometry::measures::{dihedral_angles, tet_centroid};
use crate::geometry::tet_block::BLOCK;
use crate::memory::bits::Bits;
use crate::memory::{concatenated, prefetch, reserve};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::{Monitor, Step};
use crate::oracle::Oracle;
use crate::params::Improve;
use crate::sizing::Sizing;
use crate::{Error, Result};

use batch::Batch;
pub use coarsen::{
    Coarsened, Coarseness, PART as PART_OF_COARSENING, TIMES as TIMES_OF_COARSENING, coarsen,
    tolerance as coarse_tolerance,
};
use interfaces::Interfaces;
pub use interfaces::facets_below;
use measure::Measure;
pub use nicks::fill_nicks;
pub use report::{Cause, Counts, Improvement, Left};
use rounds::Run;
use shared::Shared;
use star::Star;

/// Tets per piece of work.
const CHUNK: usize = 1 << 12;
/// So many tets ahead the vertices are fetched.
const AHEAD: usize = 16;
/// How far interfaces may be moved, in parts of the smallest side of a voxel: for targets up to
/// that many degrees, and for the largest ones.
const TOLERANCE: f64 = 0.1;
const TOLERANCE_UP_TO: f64 = 15.0;
const MAX_TOLERANCE: f64 = 0.2;
const TOLERANCE_PER_DEGREE: f64 = 0.02;

/// What a mesh is improved with.
pub struct Settings<'a> {
    /// Where the interfaces are.
    pub oracle: &'a Oracle,
    /// The label of each id of the oracle.
    pub labels: &'a [i32],
    /// The volume of each id in the image; empty: labels need not keep theirs.
    pub volumes: &'a [f64],
    /// How far apart refinement sampled the interfaces.
    pub sizing: &'a Sizing,
    /// What may be changed.
    pub improve: Improve,
    /// How far a vertex of an interface may be moved in all, and how far a facet may be from those
    /// it replaces; see [`tolerance`].
    pub tolerance: f64,
    /// Dihedral angles below this, or above 180 less this, are to go; in degrees.
    pub target: f64,
    /// The ratio of circumradius to shortest edge that refinement was asked for.
    pub radius_edge: f64,
    /// The least angle of interface facets that refinement was asked for, in degrees.
    pub facet_angle: f64,
    /// Whether the mesh is as refinement made it, Delaunay in all of its tets.
    pub is_delaunay: bool,
    /// The part of the step that is done when this begins, and when it ends, for progress.
    pub parts: [f64; 2],
    /// Whether there is time left.
    pub check_time: &'a (dyn Fn() -> Result<()> + Sync),
}

/// What was done to a mesh before it is improved.
#[derive(Default)]
pub struct Earlier {
    /// Where refinement put each vertex, or where two met on an interface or line of the image
    /// (`meeting`); if these are not as many as there are: where it is.
    pub refined: Vec<[f64; 3]>,
    /// By how much the volume of labels grew.
    pub volumes: Vec<(i32, f64)>,
}

/// Improves `mesh`, which has the tets of the background around the object, too. Slots of tets that
/// are gone are left empty: their first vertex is [`NONE`]. Returns besides what ended the work
/// early; the mesh is valid then as well, improved as far as it came.
///
/// # Errors
/// [`OutOfMemory`](Error::OutOfMemory), with the mesh valid.
pub fn improve(
    mesh: &mut TetMesh,
    settings: &Settings<'_>,
    earlier: Earlier,
    monitor: &Monitor<'_>,
) -> Result<(Improvement, Option<Error>)> {
    let (mut improvement, improved, ended) =
        change(mesh, settings, earlier, Effort::Full, monitor)?;
    if let Some(cancelled @ Error::Cancelled) = ended {
        return Ok((improvement, Some(cancelled)));
    }
    let measure = Measure::new(settings.target, settings.radius_edge);
    let Improved { mut left, changed, .. } = improved;
    left.sort_unstable();
    left.dedup();
    left.retain(|&t| is_below(mesh, t, measure));
    improvement.left = describe(mesh, &left, settings.target, &Interfaces::new(settings))?;
    // In a Delaunay mesh only changed tets have facets that are not.
    let counted = mesh.non_delaunay_facets(
        |t| mesh.tets[t as usize][0] != NONE && mesh.labels[t as usize] != 0,
        |t| !settings.is_delaunay || changed.has(t),
        monitor,
    );
    match counted {
        Ok(facets) => improvement.non_delaunay_facets = facets,
        Err(error) => return Ok((improvement, Some(error))),
    }
    Ok((improvement, ended))
}

/// What is to be described when a mesh has been improved.
#[derive(Default)]
struct Improved {
    /// Tets that may still be below the target.
    left: Vec<u32>,
    /// Which slots have changed.
    changed: Bits,
    /// As [`Earlier::refined`]. Vertices of splits are not among them; they come last.
    refined: Vec<[f64; 3]>,
}

/// What is done for tets that nothing helps at first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effort {
    /// Nothing more.
    Quick,
    /// The last resorts: vertices may go farther, and several move together.
    Full,
}

/// Improves as [`improve`] does, and tells what was done, but not of the mesh that comes of it.
fn change(
    mesh: &mut TetMesh,
    settings: &Settings<'_>,
    earlier: Earlier,
    effort: Effort,
    monitor: &Monitor<'_>,
) -> Result<(Improvement, Improved, Option<Error>)> {
    let measure = Measure::new(settings.target, settings.radius_edge);
    let interfaces = Interfaces::new(settings);
    let mut improvement = Improvement {
        target: settings.target,
        tolerance: interfaces.tolerance,
        ..Improvement::default()
    };
    let queue = match below(mesh, measure, interfaces.change, monitor) {
        Err(cancelled @ Error::Cancelled) => {
            return Ok((improvement, Improved::default(), Some(cancelled)));
        }
        queue => queue?,
    };
    improvement.below_before =
        queue.iter().filter(|&&t| mesh.labels[t as usize] != 0).count() as u64;
    if let Err(cancelled) = monitor.enter_part(Step::Improve, queue.len(), settings.parts) {
        return Ok((improvement, Improved::default(), Some(cancelled)));
    }
    let report_and_check = |done| monitor.advance(done).and_then(|()| (settings.check_time)());
    let mut run = Run::new(mesh, &interfaces, measure, earlier, queue, &report_and_check)?;
    let mut ended = run.run(effort)?;
    if ended.is_none() {
        run.measure = measure;
        ended = run.give_back(settings.volumes)?;
    }
    let Run { refined, changed, queue, mut left, counts, rounds, .. } = run;
    left.extend(queue);
    improvement.counts = counts;
    improvement.rounds = rounds;
    improvement.max_move = max_move(mesh, &refined);
    Ok((improvement, Improved { left, changed, refined }, ended))
}

/// How far interfaces may be moved for a target in degrees, in parts of the smallest side of a
/// voxel.
pub fn tolerance(target: f64) -> f64 {
    (TOLERANCE + TOLERANCE_PER_DEGREE * (target - TOLERANCE_UP_TO)).clamp(TOLERANCE, MAX_TOLERANCE)
}

/// Whether a slot has a tet of the object below the target.
fn is_below(mesh: &TetMesh, t: u32, measure: Measure) -> bool {
    let tet = mesh.tets[t as usize];
    tet[0] != NONE
        && mesh.labels[t as usize] != 0
        && !measure.exceeds(&tet.map(|v| mesh.point(v)), measure.target)
}

/// Whether a tet of the background closes the angle between two facets of the object.
fn closes_angle(mesh: &TetMesh, t: usize) -> bool {
    let is_object = |&n: &u32| n != NONE && mesh.labels[n as usize] != 0;
    mesh.neighbors[t].iter().filter(|&n| is_object(n)).count() >= 2
}

/// The tets to be improved, in order.
fn below(
    mesh: &TetMesh,
    measure: Measure,
    background: bool,
    monitor: &Monitor<'_>,
) -> Result<Vec<u32>> {
    let is_candidate = |t: usize| {
        mesh.tets[t][0] != NONE && (mesh.labels[t] != 0 || background && closes_angle(mesh, t))
    };
    let count = mesh.tets.len();
    let chunks = (0..count.div_ceil(CHUNK)).into_par_iter().with_max_len(1);
    let chunks = chunks.map(|chunk| {
        monitor.advance(0)?;
        let (mut batch, mut measured) = (Batch::default(), [0; BLOCK]);
        let end = ((chunk + 1) * CHUNK).min(count);
        let mut found = Vec::new();
        for piece in (chunk * CHUNK..end).step_by(BLOCK) {
            batch.clear();
            let tets = piece..(piece + BLOCK).min(end);
            for (t, to) in tets.filter(|&t| is_candidate(t)).zip(measured.iter_mut()) {
                for v in mesh.tets[(t + AHEAD).min(end - 1)] {
                    prefetch(mesh.points.as_ptr().wrapping_add(v as usize));
                }
                batch.push(mesh.tets[t].map(|v| mesh.points[v as usize]));
                *to = t as u32;
            }
            batch.measure(&measure);
            let below = measured
                .iter()
                .zip(batch.measures().flatten())
                .filter(|&(_, m)| *m <= measure.target);
            for (&t, _) in below {
                reserve(&mut found, 1, "tets to be improved")?;
                found.push(t);
            }
        }
        Ok(found)
    });
    concatenated(chunks.collect::<Result<_>>()?, "tets to be improved")
}

/// What is to be told of those of the tets `left` that have angles beyond the target.
fn describe(
    mesh: &mut TetMesh,
    left: &[u32],
    target: f64,
    interfaces: &Interfaces<'_>,
) -> Result<Vec<Left>> {
    let mut described = Vec::new();
    reserve(&mut described, left.len(), "tets that are left")?;
    let changed = Bits::new(mesh.tets.len(), "tets of the mesh")?;
    let shared = Shared::new(mesh, &changed);
    let mut star = Star::default();
    for &tet in left {
        let vertices = shared.tet(tet);
        let corners = shared.corners(vertices);
        let angles = dihedral_angles(&corners);
        let angles =
            [angles.into_iter().fold(180.0, f64::min), angles.into_iter().fold(0.0, f64::max)];
        if angles[0] >= target && angles[1] <= 180.0 - target {
            continue;
        }
        let causes = vertices.map(|v| {
            let p = shared.point(v);
            star.collect(&shared, tet, v, |_| true);
            match () {
                () if star.facets.is_empty() => Cause::Inside,
                () if interfaces.oracle.is_near_contact(p) => Cause::Contact,
                () if interfaces.oracle.is_on_wall(p) => Cause::Wall,
                () if star.two_labels().is_none() => Cause::Junction,
                () => Cause::Interface,
            }
        });
        described.push(Left {
            tet,
            position: tet_centroid(&corners).to_array(),
            angles,
            cause: causes.into_iter().min().unwrap_or(Cause::Inside),
        });
    }
    Ok(described)
}

/// The largest distance of a vertex from where refinement put it, or where two met.
fn max_move(mesh: &TetMesh, refined: &[[f64; 3]]) -> f64 {
    let squares = mesh.points.par_iter().zip(refined).map(|(p, q)| {
        let [x, y, z] = [0, 1, 2].map(|a| p[a] - q[a]);
        x * x + y * y + z * z
    });
    squares.reduce(|| 0.0, f64::max).sqrt()
}
