//! From image to mesh: the stages, and the run that goes through all of them.
//!
//! | stage | file | from | to |
//! |---|---|---|---|
//! | prepare | [`prepare`] | image | oracle, sizing field |
//! | refine | [`refine`], [`adapt`] | these | refined mesh |
//! | improve | `mend`, [`improve`] | that | mesh without slivers |
//! | finish | [`finish`] | that | quality, certificate, nodes of second order |
//!
//! [`certify`] measures a mesh that is finished already. [`report`] writes all that is known about
//! a run to a file.
//!
//! Each stage is a few functions on plain values, which tests and benches call, too.
//!
//! A limit that is reached ends the refinement between two operations. The mesh of what there is
//! then has all properties but those that the rules bring about: it is Delaunay, labelled by
//! circumcenters, its interfaces closed; the certificate says how far it is from the image.
//!
//! Thread safety: any number of runs may go on at once; a run shares nothing but what it is given.
//! Image passes run in the caller's rayon pool.

pub mod adapt;
mod attempt;
mod budget;
pub mod certify;
mod changes;
mod compare;
pub mod estimate;
pub mod finish;
pub mod improve;
mod mend;
mod messages;
pub mod prepare;
pub mod refine;
pub mod report;
mod trial;

use std::time::Instant;

use crate::delaunay::worker::Counters;
use crate::image::LabelImage;
use crate::improve::{Improvement, TIMES_OF_COARSENING};
use crate::memory::aside::{AtEnd, or_drop_aside};
use crate::mesh::TetMesh;
use crate::monitor::{Level, Monitor, Step};
use crate::oracle::Oracle;
use crate::params::{Adaptive, CertificateLevel, MeshParams};
use crate::refine::activity::Work;
use crate::refine::activity::{Accesses, Overhead, ThreadReport};
use crate::refine::options::Limits;
use crate::refine::podm::Refinement;
use crate::second_order::SecondOrder;
use crate::verify::{Certificate, Extent, Quality};
use crate::{Error, Result};
use attempt::{Attempt, Made};
use prepare::{Divided, Selected};

/// A finished run.
#[derive(Debug)]
pub struct MeshResult {
    /// The mesh.
    pub mesh: TetMesh,
    /// What the run did, and what was measured on the mesh.
    pub report: RunReport,
    /// The limit that ended the refinement, where a partial mesh is allowed; `None`: the refinement
    /// is complete.
    pub ended_by: Option<Error>,
}

/// Wall-clock seconds of the phases.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Preparing the image: the labels' volumes and weights, where interfaces are, what is thin.
    pub prepare: f64,
    /// From the finished oracle to the last rule satisfied.
    pub refine: f64,
    /// Collecting the mesh, and giving back the memory of the triangulation.
    pub extract: f64,
    /// Removing slivers.
    pub improve: f64,
    /// Quality and certificate.
    pub certify: f64,
}

/// The report of a run.
#[derive(Clone, Debug, Default)]
pub struct RunReport {
    /// Times.
    pub seconds: Seconds,
    /// By which lengths were multiplied for the number of tets asked for: [`MeshParams::scaled`]; 1
    /// where none was.
    pub factor: f64,
    /// Tets of the whole triangulation.
    pub all_tets: u64,
    /// Vertices of the whole triangulation, corners of the box included.
    pub all_vertices: u64,
    /// Memory of the oracle, held to the end.
    pub oracle_bytes: u64,
    /// Operations of the kernel.
    pub operations: Counters,
    /// The rules' part.
    pub work: Work,
    /// The same for each thread that refined, and what it lost.
    pub threads: Vec<ThreadReport>,
    /// What the removal of slivers did.
    pub improvement: Improvement,
    /// How many places each comparison found where the mesh differs from the image in what is
    /// connected, or ends before a wall, where sampling follows these.
    pub differences: Vec<u64>,
    /// The nodes of second order.
    pub second_order: SecondOrder,
    /// Shape of tets and interface facets; measured with the certificate, so nothing without one.
    pub quality: Quality,
    /// What was checked.
    pub certificate: Certificate,
}

impl RunReport {
    /// What all threads of the refinement did, as if they were one.
    pub fn all_threads(&self) -> ThreadReport {
        let (mut overhead, mut accesses) = (Overhead::default(), Accesses::default());
        for thread in &self.threads {
            overhead.add(&thread.overhead);
            accesses.add(&thread.accesses);
        }
        ThreadReport {
            operations: self.operations,
            work: self.work,
            overhead,
            accesses,
            timeline: Vec::new(),
        }
    }
}

/// Times the phases one after the other.
struct Stopwatch {
    last: Instant,
    seconds: Seconds,
}

impl Stopwatch {
    fn new(start: Instant) -> Self {
        Self { last: start, seconds: Seconds::default() }
    }

    /// Adds the time since the last call to that of a phase, which is told.
    fn add_to(&mut self, phase: impl FnOnce(&mut Seconds) -> &mut f64) -> f64 {
        let before = std::mem::replace(&mut self.last, Instant::now());
        let seconds = phase(&mut self.seconds);
        *seconds += (self.last - before).as_secs_f64();
        *seconds
    }
}

/// Meshes `image`.
///
/// # Errors
/// [`Error::InvalidArgument`], [`Error::Unsupported`] for `params`; [`Error::EmptyImage`];
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]. A limit of `params` gives [`Error::LimitReached`],
/// [`Error::TimeLimit`], [`Error::MemoryLimit`]; where a partial mesh is allowed, only if there is
/// none yet.
pub fn mesh_image(
    image: &LabelImage,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) -> Result<MeshResult> {
    let start = Instant::now();
    params.validate()?;
    params.validate_together()?;
    let _end = AtEnd;
    let mut watch = Stopwatch::new(start);
    let limits = prepare::limits(params, image, start);

    monitor.leave_out_from(match params.certificate {
        CertificateLevel::None => Step::Quality,
        CertificateLevel::Sound => Step::MeshToImage,
        CertificateLevel::Full => Step::Done,
    });
    if params.coarsen.is_some() {
        let [dense, other] = TIMES_OF_COARSENING;
        let is_dense = params.adaptive == Adaptive::Thickness;
        monitor.lengthen_improvement(if is_dense { dense } else { other });
    }
    prepare::enter(image, monitor)?;
    let Selected { image, dropped } = prepare::select_labels(image, params, monitor)?;
    monitor.log(Level::Info, &messages::describe(&image, params));
    let Found { factor, oracle, made } = {
        let Divided { image: divided, limits } =
            &prepare::divide(&image, params, &limits, monitor)?;
        find_mesh([&image, divided], params, limits, &mut watch, monitor)?
    };
    let Made { mesh, refinement, differences, check, examined, improvement } = made;
    let Refinement { counters, work, threads, mut ended_by, .. } = refinement;
    let (mesh, (quality, certificate, second_order)) = or_drop_aside(mesh, |mesh| {
        mesh.collect_facets(monitor)?;
        mesh.find_walls(|corners| oracle.wall_of_facet(corners), monitor)?;
        watch.add_to(|seconds| &mut seconds.extract);

        if let Some(limit) = &ended_by {
            monitor.log(Level::Warning, &format!("the mesh is partial: {limit}"));
        }

        let level = params.certificate;
        let (quality, certificate) = if level == CertificateLevel::None {
            (Quality::default(), Certificate::none())
        } else {
            // Of a mesh that may be partial what is exact is always told, only distances are left
            // out.
            monitor.end_at(limits.deadline.filter(|_| !params.partial));
            let check_memory = &finish::room_beside(mesh, &oracle, &limits);
            let extent = Extent { level, distances_until: limits.deadline, check_memory };
            let measured =
                finish::measure(mesh, &image, &oracle, examined, &dropped, extent, monitor);
            monitor.end_at(None);
            let (quality, certificate, limit) = measured?;
            match limit {
                Some(limit) if !params.partial => return Err(limit),
                Some(limit) if ended_by.is_none() => {
                    monitor
                        .log(Level::Warning, &format!("the certificate has no distances: {limit}"));
                    ended_by = Some(limit);
                }
                _ => {}
            }
            (quality, certificate)
        };
        let seconds = watch.add_to(|seconds| &mut seconds.certify);
        let second_order = finish::add_nodes(mesh, &image, &oracle, params, monitor)?;
        watch.add_to(|seconds| &mut seconds.extract);
        monitor.log(Level::Info, &format!("certificate measured in {seconds:.2} s"));
        Ok((quality, certificate, second_order))
    })?;
    messages::warnings(&certificate).iter().for_each(|line| monitor.log(Level::Warning, line));
    if let Some(target) = params.target_tets.filter(|_| ended_by.is_none()) {
        messages::warn_of_missed(target, &mesh, monitor);
    }
    monitor.enter(Step::Done, 0)?;
    let report = RunReport {
        seconds: watch.seconds,
        factor,
        all_tets: check.tets,
        all_vertices: check.vertices,
        oracle_bytes: oracle.bytes() as u64,
        operations: counters,
        work,
        threads,
        improvement,
        differences,
        second_order,
        quality,
        certificate,
    };
    Ok(MeshResult { mesh, report, ended_by })
}

/// What comes before facets and certificate.
struct Found {
    /// By which lengths were multiplied: [`MeshParams::scaled`].
    factor: f64,
    oracle: Oracle,
    made: Made,
}

/// Prepares an image, given before and after its long voxels were divided, and makes its mesh;
/// again with other lengths, as long as a number of tets is asked for and missed.
fn find_mesh(
    [whole, image]: [&LabelImage; 2],
    params: &MeshParams,
    limits: &Limits,
    watch: &mut Stopwatch,
    monitor: &Monitor<'_>,
) -> Result<Found> {
    let search = |target| budget::Search::new(image, params, target, limits, monitor);
    let mut search = params.target_tets.map(search).transpose()?;
    let mut factor = search.as_ref().map_or(1.0, budget::Search::factor);
    let mut used = params.scaled(factor);
    let mut prepared = prepare::prepare(image, &used, limits, monitor)?;
    let seconds = watch.add_to(|seconds| &mut seconds.prepare);
    monitor.log(Level::Info, &format!("image prepared in {seconds:.2} s"));
    refine::warn_of_many(whole, &prepared, &used, monitor);
    monitor.enter(Step::Refine, 1)?;
    // A mesh of an earlier try, for when a limit ends a later one.
    let mut earlier = None;
    let mut is_first = true;
    let made = loop {
        let attempt = Attempt { image, params: &used, limits };
        let Some(search) = &mut search else {
            break attempt.make(&mut prepared, watch, monitor)?;
        };
        // Progress stays in the step of refinement until the mesh has the tets asked for.
        let look = || monitor.advance(0);
        let quiet = Monitor::within(&look);
        let mut try_once = |search: &mut budget::Search| {
            if !is_first {
                prepared.sizing = prepare::sizing(image, &prepared.oracle, &used, limits, monitor)?;
            }
            let refined = attempt.refine(&mut prepared, search.parts(), watch, monitor)?;
            let is_complete = refined.is_complete();
            if is_complete && search.is_far_off(refined.count_tets(&attempt, &prepared, monitor)?) {
                refined.give_back(monitor)?;
                return Ok::<_, Error>((None, true));
            }
            let made = attempt.finish(refined, &prepared, watch, &quiet)?;
            messages::log_try(monitor, &used, made.count_tets());
            let goes_on = made.refinement.ended_by.is_none() && search.try_again(made.count_tets());
            Ok((Some(made), goes_on))
        };
        match (try_once(search), earlier.take()) {
            (Ok((made, true)), before) => {
                let made = made.filter(|_| params.partial).map(|made| (factor, made));
                earlier = made.or(before);
            }
            // Better a whole mesh of another number of tets than the beginning of one.
            (Ok((Some(made), false)), Some(before)) if made.refinement.ended_by.is_some() => {
                break ended_early(before, made.refinement.ended_by, &mut factor);
            }
            (Ok((Some(made), false)), _) => break made,
            (Err(limit), Some(before)) if limit.is_limit() => {
                break ended_early(before, Some(limit), &mut factor);
            }
            (Err(error), _) => return Err(error),
            (Ok((None, false)), _) => return Err(Error::Internal("a try gave no mesh".into())),
        }
        is_first = false;
        factor = search.factor();
        used = params.scaled(factor);
    };
    // The certificate needs room, and no sizing field.
    Ok(Found { factor, oracle: prepared.oracle, made })
}

/// The mesh of an earlier try, where a limit has ended a later one.
fn ended_early((of, mut made): (f64, Made), limit: Option<Error>, factor: &mut f64) -> Made {
    *factor = of;
    made.refinement.ended_by = limit;
    made
}
