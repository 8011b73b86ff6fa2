//! From image to mesh: the stages, and the run that goes through all of them.
//!
//! | stage | file | from | to |
//! |---|---|---|---|
//! | prepare | [`prepare`] | image | oracle, sizing field |
//! | refine | [`refine`], [`adapt`] | these | refined mesh |
//! | improve | [`improve`] | that | mesh without slivers |
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
pub mod certify;
pub mod finish;
pub mod improve;
mod messages;
pub mod prepare;
pub mod refine;
pub mod report;

use std::time::Instant;

use rayon::prelude::*;

use crate::delaunay::check::Check;
use crate::delaunay::worker::Counters;
use crate::image::LabelImage;
use crate::improve::Improvement;
use crate::mesh::TetMesh;
use crate::mesh::extract::Background;
use crate::monitor::{Level, Monitor, Step};
use crate::params::{Adaptive, CertificateLevel, Improve, MeshParams};
use crate::refine::Asked;
use crate::refine::activity::Work;
use crate::refine::activity::{Accesses, Overhead, ThreadReport};
use crate::refine::options::{Limits, RefineOptions};
use crate::refine::podm::Refinement;
use crate::refine::rules::Rules;
use crate::second_order::SecondOrder;
use crate::verify::{Certificate, Examined, Extent, Quality};
use crate::{Error, Result};
use adapt::Adapted;
use prepare::{Prepared, Selected};
use refine::Collected;

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
    /// Collecting the mesh.
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
    /// How many differences from the image in what is connected each comparison found, where
    /// sampling follows these.
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
    let mut watch = Stopwatch::new(start);
    let limits = prepare::limits(params, image, start);

    monitor.leave_out_from(match params.certificate {
        CertificateLevel::None => Step::Quality,
        CertificateLevel::Sound => Step::MeshToImage,
        CertificateLevel::Full => Step::Done,
    });
    prepare::enter(image, monitor)?;
    let Selected { image, dropped } = prepare::select_labels(image, params, monitor)?;
    monitor.log(Level::Info, &messages::describe(&image, params));
    let mut prepared = prepare::prepare(&image, params, &limits, monitor)?;
    let seconds = watch.add_to(|seconds| &mut seconds.prepare);
    monitor.log(Level::Info, &format!("image prepared in {seconds:.2} s"));

    let refined = refine_and_collect(&image, &prepared, params, &limits, &mut watch, monitor)?;
    let Refined { mut mesh, points_kept, improves, refinement, adapted, check, examined } = refined;
    if let Some(sizing) = adapted.sizing {
        prepared.sizing = sizing;
    }
    let Refinement { counters, work, threads, mut ended_by, .. } = refinement;
    let mut improvement = Improvement::default();
    if improves {
        let done = improve::improve_mesh(
            &mut mesh,
            points_kept,
            &prepared,
            &image,
            params,
            &limits,
            monitor,
        )?;
        (improvement, ended_by) = done;
    }
    // The certificate needs room, and no sizing field.
    let Prepared { oracle, sizing, .. } = prepared;
    drop(sizing);
    let seconds = watch.add_to(|seconds| &mut seconds.improve);
    mesh.collect_facets(monitor)?;
    mesh.find_walls(|corners| oracle.wall_of_facet(corners), monitor)?;
    watch.add_to(|seconds| &mut seconds.extract);
    if improves {
        messages::log_improvement(monitor, &improvement, seconds);
    }

    if let Some(limit) = &ended_by {
        monitor.log(Level::Warning, &format!("the mesh is partial: {limit}"));
    }

    let level = params.certificate;
    let (quality, certificate) = if level == CertificateLevel::None {
        (Quality::default(), Certificate::none())
    } else {
        // Of a mesh that may be partial what is exact is always told, only distances are left out.
        monitor.end_at(limits.deadline.filter(|_| !params.partial));
        let extent = Extent { level, distances_until: limits.deadline };
        let measured = finish::measure(&mesh, &image, &oracle, examined, &dropped, extent, monitor);
        monitor.end_at(None);
        let (quality, certificate, limit) = measured?;
        match limit {
            Some(limit) if !params.partial => return Err(limit),
            Some(limit) if ended_by.is_none() => {
                monitor.log(Level::Warning, &format!("the certificate has no distances: {limit}"));
                ended_by = Some(limit);
            }
            _ => {}
        }
        (quality, certificate)
    };
    let seconds = watch.add_to(|seconds| &mut seconds.certify);
    let second_order = finish::add_nodes(&mut mesh, &image, &oracle, params, monitor)?;
    watch.add_to(|seconds| &mut seconds.extract);
    monitor.log(Level::Info, &format!("certificate measured in {seconds:.2} s"));
    messages::warnings(&certificate).iter().for_each(|line| monitor.log(Level::Warning, line));
    monitor.enter(Step::Done, 0)?;
    let report = RunReport {
        seconds: watch.seconds,
        all_tets: check.tets,
        all_vertices: check.vertices,
        oracle_bytes: oracle.bytes() as u64,
        operations: counters,
        work,
        threads,
        improvement,
        differences: adapted.differences,
        second_order,
        quality,
        certificate,
    };
    Ok(MeshResult { mesh, report, ended_by })
}

/// Vertices of a triangulation that nothing has been inserted into.
const BOX_CORNERS: u64 = 8;

/// What the stage of refinement leaves; the triangulation is gone.
struct Refined {
    mesh: TetMesh,
    points_kept: usize,
    /// Whether the mesh is to be improved, and so has the background around the object.
    improves: bool,
    refinement: Refinement,
    adapted: Adapted,
    check: Check,
    examined: Examined,
}

/// The stage of refinement.
fn refine_and_collect(
    image: &LabelImage,
    prepared: &Prepared,
    params: &MeshParams,
    limits: &Limits,
    watch: &mut Stopwatch,
    monitor: &Monitor<'_>,
) -> Result<Refined> {
    let Prepared { oracle, sizing, voxels } = prepared;
    let by_volume = refine::expected_by_volume(prepared, image, params);
    let about_interfaces = oracle.expected_tets(sizing.max(), &sizing.palette());
    messages::warn_of_many(about_interfaces.map(|tets| tets + by_volume), *voxels, monitor);
    monitor.enter(Step::Refine, 1)?;
    let triangulation = refine::triangulation_around(oracle, sizing.max())?;
    let rules = Rules::new(&triangulation, oracle, sizing, params, image.labels());
    let options = RefineOptions {
        parts: adapt::parts(params, 0),
        ..refine::options(params, limits.clone(), by_volume as u64)?
    };
    let mut refinement = crate::refine::refine(&rules, &options, monitor)?;
    let mut adapted = Adapted::default();
    if params.adaptive == Adaptive::Topology && refinement.ended_by.is_none() {
        let triangulation = &triangulation;
        let run = adapt::Run { image, prepared, triangulation, params, limits };
        adapted = run.adapt(&mut refinement, monitor)?;
    }
    let sizing = adapted.sizing.as_ref().unwrap_or(sizing);
    let rules = Rules::new(&triangulation, oracle, sizing, params, image.labels());
    if let Some(limit) = refinement.ended_by.take_if(|_| !params.partial) {
        return Err(limit);
    }
    let seconds = watch.add_to(|seconds| &mut seconds.refine);
    messages::log_refinement(monitor, &refinement.counters, seconds);

    // Improvement needs the background around the object. What refinement did not finish is left as
    // it is.
    let improves = params.improve != Improve::None && refinement.ended_by.is_none();
    let background = match (params.background, improves) {
        (true, _) => Background::Kept,
        (false, true) => Background::Last,
        (false, false) => Background::Dropped,
    };
    let collected = refine::collect(&rules, image.labels(), background, monitor)?;
    let Collected { mesh, points_kept, order } = collected;
    if !mesh.labels.par_iter().any(|&label| label != 0) {
        return Err(refinement.ended_by.unwrap_or_else(|| {
            Error::InvalidArgument(format!(
                "delta {} is too coarse for the object: no tet has its circumcenter inside",
                params.delta
            ))
        }));
    }
    let seconds = watch.add_to(|seconds| &mut seconds.extract);
    monitor.log(
        Level::Info,
        &format!(
            "mesh of {} tets, {} vertices collected in {seconds:.2} s",
            mesh.tets.len(),
            mesh.points.len(),
        ),
    );
    let (check, examined) = if params.certificate == CertificateLevel::None {
        let Counters { insertions, removals, .. } = refinement.counters;
        let vertices = BOX_CORNERS + insertions - removals;
        (Check { tets: order.len() as u64, vertices, ..Check::default() }, Examined::default())
    } else {
        // The sound level is to cost little; beside distances there is time to ask all tets again.
        let asked = match (params.certificate, &refinement.ended_by) {
            (CertificateLevel::Sound, None) => Asked::LeftOver(&refinement.left_over),
            _ => Asked::All,
        };
        let (check, unmet) = crate::refine::examine(&rules, &order, asked, monitor)?;
        let non_delaunay_facets = Some(check.non_delaunay_facets);
        (check, Examined { non_delaunay_facets, unmet: Some(unmet) })
    };
    monitor.note_tets(check.tets);
    drop(triangulation);
    watch.add_to(|seconds| &mut seconds.certify);
    Ok(Refined { mesh, points_kept, improves, refinement, adapted, check, examined })
}
