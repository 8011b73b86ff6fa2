//! The pipeline from image to mesh: oracle, refinement, extraction, certificate.
//!
//! A limit that is reached ends the refinement between two operations. The mesh of what there is
//! then has all properties but those that the rules bring about: it is Delaunay, labelled by
//! circumcenters, its interfaces closed; the certificate says how far it is from the image.
//!
//! Thread safety: any number of runs may go on at once; a run shares nothing but what it is given.
//! Image passes run in the caller's rayon pool.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::delaunay::Triangulation;
use crate::delaunay::worker::Counters;
use crate::image::LabelImage;
use crate::image::region::{Region, Rows};
use crate::image::small_components::SmallComponent;
use crate::improve::{Improvement, Settings, improve};
use crate::memory::reserve;
use crate::mesh::TetMesh;
use crate::mesh::extract::{BYTES_PER_SLOT, Background, Extracted, extract};
use crate::monitor::{Level, Monitor, Step};
use crate::oracle::{Oracle, Surface};
use crate::parallel::machine::Machine;
use crate::params::{Improve, MeshParams};
use crate::refine::activity::ThreadReport;
use crate::refine::podm::Refinement;
use crate::refine::refiner::Work;
use crate::refine::rules::{Rules, TETS_PER_SIZE};
use crate::refine::team::{Limits, RefineOptions};
use crate::refine::{examine, refine};
use crate::second_order::{self, SecondOrder, add_mid_nodes, curve};
use crate::sizing::Sizing;
use crate::system::binding::Places;
use crate::verify::certificate::{Certificate, Defect, DefectKind, LEAST_VOXELS, SmallLost};
use crate::verify::quality::Quality;
use crate::{Error, Result};

/// The virtual box leaves this part of the object's longest side free on every side, so that the
/// circumcenters of tets between object and box lie inside it.
const BOX_MARGIN: f64 = 0.25;

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
#[derive(Clone, Debug)]
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
    /// The nodes of second order.
    pub second_order: SecondOrder,
    /// Tets and facets to which rules R1 to R6 still apply, but cannot be carried out.
    pub unmet: [u64; 6],
    /// Shape of tets and interface facets.
    pub quality: Quality,
    /// What was checked.
    pub certificate: Certificate,
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
    let mut clock = Instant::now();
    params.validate()?;
    // Not in `validate`: whoever sets parameters one by one may set this one first.
    if params.curved && params.order != 2 {
        return Err(Error::InvalidArgument(format!(
            "curved tets need order 2, got {}",
            params.order
        )));
    }
    let limits = limits(params, image, clock);
    let deadline = limits.clone();
    let [nx, ny, nz] = image.dims();
    // The most that the oracle asks whether to go on: per plane, per layer in five passes, where a
    // table is filled in, in each step of the weights.
    monitor.enter(Step::Oracle, nz + 5 * (ny + 2) + nx * ny * nz / (1 << 15) + 64)?;
    let merged;
    let image = if params.merge.is_empty() && params.background_label == 0 {
        image
    } else {
        merged = image.merged(&params.merge, params.background_label)?;
        &merged
    };
    if let Some(&(label, _)) = params.label_sizes.iter().find(|l| image.id_of(l.0).is_none()) {
        return Err(Error::InvalidArgument(format!(
            "a size is given for label {label}, which does not occur in the image"
        )));
    }
    let restricted;
    let image = if params.keep.is_empty() {
        image
    } else {
        restricted = image.restricted_to(&params.keep)?;
        &restricted
    };
    let (cleared, dropped);
    let image = if params.least_voxels > 1 {
        (cleared, dropped) =
            image.without_small_components(params.least_voxels, &|_| monitor.check_cancelled())?;
        &cleared
    } else {
        dropped = Vec::new();
        image
    };
    if image.is_all_background() {
        return Err(Error::EmptyImage);
    }
    let mut seconds = Seconds::default();
    let mut lap = || std::mem::replace(&mut clock, Instant::now()).elapsed().as_secs_f64();
    monitor.log(Level::Info, &describe(image, params));
    let go_on = || monitor.advance(1).and_then(|()| limits.check_time());
    let region = Region::new(image, &go_on)?;
    if limits.max_memory.is_some() {
        let sizing = match params.adaptive {
            true => Sizing::bytes_needed(image, &region, params.delta, params.spacing_floor),
            false => 0,
        };
        let first = Oracle::bytes_needed(image, &region) + sizing;
        limits.check_memory(first.max(limits.bytes_after))?;
    }
    let surface = Surface {
        model: params.surface,
        border: params.border,
        sigma: (params.sigma > 0.0).then_some(params.sigma),
    };
    let rows = Rows::new(image, region, &go_on)?;
    // Side by side: where the threads have nothing to do for the one they work on the other.
    let (oracle, sizing) = rayon::join(
        || Oracle::of_rows(image, &rows, surface, &go_on),
        || match params.adaptive {
            true => Sizing::new(image, &rows, params.delta, params.spacing_floor, &go_on),
            false => Ok(Sizing::uniform(params.delta)),
        },
    );
    let (oracle, sizing) = (oracle?, sizing?);
    drop(rows);
    seconds.prepare = lap();
    monitor.log(Level::Info, &format!("image prepared in {:.2} s", seconds.prepare));

    let voxels = object_voxels(image);
    let by_volume = TETS_PER_SIZE * voxels as f64 * image.voxel_volume() / params.size.powi(3);
    let about_interfaces = oracle.expected_tets(params.delta, &sizing.palette());
    warn_of_many(about_interfaces.map(|tets| tets + by_volume), voxels, monitor);

    monitor.enter(Step::Refine, 1)?;
    let [lower, upper] = oracle.bounds();
    let margin = (upper - lower).max_element() * BOX_MARGIN + 4.0 * params.delta;
    let triangulation = Triangulation::new(lower - margin, upper + margin)?;
    let rules = Rules::new(&triangulation, &oracle, params, image.labels())?.with_sizing(sizing);
    let machine = match &params.machine {
        Some(machine) => machine.clone(),
        // Has no others to be near to.
        None if params.threads == 1 => Machine::one_node(1),
        None => Machine::of_system(),
    };
    let options = RefineOptions {
        expected_tets: by_volume as u64,
        limits,
        threads: params.threads,
        contention: params.contention,
        begging: params.begging,
        places: params.bind.then(|| Places::new(&machine)).transpose()?,
        machine,
        timeline: params.timeline,
        algorithm: params.algorithm,
        halving: false,
        count_accesses: params.count_accesses,
    };
    let Refinement { counters, work, threads, ended_by } = refine(&rules, &options, monitor)?;
    let ended_by = match ended_by {
        Some(limit) if !params.partial => return Err(limit),
        ended_by => ended_by,
    };
    seconds.refine = lap();
    log_refinement(monitor, &counters, seconds.refine);

    monitor.enter(Step::Extract, triangulation.tet_bound() as usize)?;
    let mut order = triangulation.tets_by_place(|| monitor.check_cancelled())?;
    // Improvement needs the background around the object. What refinement did not finish is left as
    // it is.
    let improves = params.improve != Improve::None && ended_by.is_none();
    let background = match (params.background, improves) {
        (true, _) => Background::Kept,
        (false, true) => Background::Last,
        (false, false) => Background::Dropped,
    };
    let label = |t| rules.label(t);
    let extracted =
        extract(&triangulation, &mut order, label, image.labels(), background, monitor)?;
    let Extracted { mut mesh, points_kept } = extracted;
    if !mesh.labels.par_iter().any(|&label| label != 0) {
        return Err(ended_by.unwrap_or_else(|| {
            Error::InvalidArgument(format!(
                "delta {} is too coarse for the object: no tet has its circumcenter inside",
                params.delta
            ))
        }));
    }
    seconds.extract = lap();
    monitor.log(
        Level::Info,
        &format!(
            "mesh of {} tets, {} vertices collected in {:.2} s",
            mesh.tets.len(),
            mesh.points.len(),
            seconds.extract
        ),
    );

    let (check, unmet) = examine(&rules, &order, monitor)?;
    monitor.note_tets(check.tets);
    drop(order);
    let oracle_bytes = oracle.bytes() as u64;
    let sizing = rules.into_sizing();
    drop(triangulation);
    seconds.certify = lap();
    let mut ended_by = ended_by;
    let mut improvement = Improvement::default();
    if improves {
        let settings = Settings {
            oracle: &oracle,
            labels: image.labels(),
            sizing: &sizing,
            improve: params.improve,
            target: params.target_dihedral,
            radius_edge: params.radius_edge,
            facet_angle: params.facet_angle,
            check_time: &|| deadline.check_time(),
        };
        let points_before = mesh.points.len();
        let (done, ended) = improve(&mut mesh, &settings, monitor)?;
        improvement = done;
        match ended {
            Some(limit) if limit.is_limit() && params.partial => {
                ended_by = ended_by.or(Some(limit))
            }
            Some(error) => return Err(error),
            None => {}
        }
        let left: Vec<u32> = improvement.left.iter().map(|left| left.tet).collect();
        let places = mesh.finish(params.background, points_kept, points_before, &left)?;
        improvement.left.iter_mut().zip(places).for_each(|(left, place)| left.tet = place);
    }
    drop(sizing);
    seconds.improve = lap();
    mesh.collect_facets(monitor)?;
    seconds.extract += lap();
    if improves {
        log_improvement(monitor, &improvement, seconds.improve);
    }
    let quality = Quality::measure(&mesh, monitor)?;
    let mut certificate =
        Certificate::measure(&mesh, image, &oracle, check.non_delaunay_facets, unmet, monitor)?;
    reserve(&mut certificate.defects, dropped.len(), "defects")?;
    certificate.defects.extend(dropped.iter().map(
        |&SmallComponent { label, position, voxels }| Defect {
            kind: DefectKind::Dropped,
            label,
            position,
            size: voxels,
        },
    ));
    seconds.certify += lap();
    let mut second_order = SecondOrder::default();
    if params.order == 2 {
        second_order = add_mid_nodes(&mut mesh, monitor)?;
        if params.curved {
            second_order.curving = curve(&mut mesh, &oracle, image.labels(), monitor)?;
        }
        seconds.extract += lap();
    }
    monitor.log(Level::Info, &format!("certificate measured in {:.2} s", seconds.certify));
    if let Some(limit) = &ended_by {
        monitor.log(Level::Warning, &format!("the mesh is partial: {limit}"));
    }
    warnings(&certificate).iter().for_each(|line| monitor.log(Level::Warning, line));
    monitor.enter(Step::Done, 0)?;
    let (all_tets, all_vertices) = (check.tets, check.vertices);
    let report = RunReport {
        seconds,
        all_tets,
        all_vertices,
        oracle_bytes,
        operations: counters,
        work,
        threads,
        improvement,
        second_order,
        unmet,
        quality,
        certificate,
    };
    Ok(MeshResult { mesh, report, ended_by })
}

/// The limits of `params` for a run on `image`, or on one of other labels; `start` is when it
/// began.
fn limits(params: &MeshParams, image: &LabelImage, start: Instant) -> Limits {
    // A deadline that the clock cannot hold never comes.
    let deadline = params.time_limit.and_then(|seconds| {
        let end = start.checked_add(Duration::try_from_secs_f64(seconds).ok()?)?;
        Some((end, seconds))
    });
    let (max_vertices, max_memory) = (params.max_vertices, params.max_memory);
    let bytes_after = Certificate::bytes_needed(image);
    let of_nodes = if params.order == 2 { second_order::BYTES_PER_TET } else { 0 };
    Limits {
        max_vertices,
        deadline,
        max_memory,
        bytes_per_slot: BYTES_PER_SLOT + of_nodes,
        bytes_after,
    }
}

/// A line about what is meshed.
fn describe(image: &LabelImage, params: &MeshParams) -> String {
    let [nx, ny, nz] = image.dims();
    let spacing = image.frame().spacing();
    format!(
        "meshing {} labels of {nx} x {ny} x {nz} voxels of {} x {} x {} at delta {}, size {}",
        image.labels().len() - 1,
        spacing.x,
        spacing.y,
        spacing.z,
        params.delta,
        params.size
    )
}

fn log_refinement(monitor: &Monitor<'_>, counters: &Counters, seconds: f64) {
    let Counters { insertions, removals, created, destroyed, .. } = counters;
    let tets = created.saturating_sub(*destroyed);
    let rate = tets as f64 / seconds.max(1e-9);
    let line = format!(
        "refinement done in {seconds:.2} s: {tets} tets, {insertions} insertions, {removals} \
         removals, {rate:.0} tets per second"
    );
    monitor.log(Level::Info, &line);
}

fn log_improvement(monitor: &Monitor<'_>, improvement: &Improvement, seconds: f64) {
    let Improvement { below_before, left, counts, .. } = improvement;
    let (operations, left) = (counts.operations(), left.len());
    let line = format!(
        "slivers removed in {seconds:.2} s: {below_before} tets below the target, {operations} \
         operations, {left} left"
    );
    monitor.log(Level::Info, &line);
}

/// What a caller should know before relying on the mesh, a line for each kind of defect.
fn warnings(certificate: &Certificate) -> Vec<String> {
    let mut lines = Vec::new();
    for (rule, &unmet) in certificate.unmet.iter().enumerate().filter(|&(_, &unmet)| unmet > 0) {
        lines.push(format!("rule R{} stays unmet {unmet} times", rule + 1));
    }
    let lost = || certificate.labels.iter().filter(|row| row.tets == 0);
    if let Some(first) = lost().next() {
        let voxels: u64 = lost().map(|row| row.image_voxels).sum();
        lines.push(format!(
            "labels without a tet: {}, of {voxels} voxels in all; the first is {}",
            lost().count(),
            first.label
        ));
    }
    let topology = [
        (DefectKind::Lost, "components without a tet"),
        (DefectKind::Merged, "components merged with another one of their label"),
        (DefectKind::Torn, "pieces torn off from their component"),
        (DefectKind::Stray, "pieces where the image does not have their label"),
        (DefectKind::Dropped, "components left out, as asked"),
        (DefectKind::PinchedEdge, "edges where a label's boundary touches itself"),
        (DefectKind::PinchedVertex, "vertices where a label's boundary touches itself"),
    ];
    for (kind, what) in topology {
        let mut of_kind = certificate.defects.iter().filter(|defect| defect.kind == kind);
        if let Some(Defect { label, position: [x, y, z], .. }) = of_kind.next() {
            let count = 1 + of_kind.count();
            lines.push(format!(
                "{what}: {count}; the first, of label {label}, at ({x:.2}, {y:.2}, {z:.2})"
            ));
        }
    }
    let SmallLost { count, voxels, first } = certificate.small_lost;
    if let Some((label, [x, y, z])) = first {
        lines.push(format!(
            "components of fewer than {LEAST_VOXELS} voxels without a tet: {count}, of {voxels} \
             voxels in all; the first, of label {label}, at ({x:.2}, {y:.2}, {z:.2})"
        ));
    }
    let defects = [
        (certificate.non_delaunay_facets, "facets that are not Delaunay"),
        (certificate.inverted_tets, "inverted tets"),
        (certificate.orphan_vertices, "vertices in no tet"),
        (certificate.open_edges, "open edges of interfaces"),
        (certificate.facets_off_walls, "outer facets that should lie where the image ends"),
    ];
    for (count, what) in defects.into_iter().filter(|&(count, _)| count > 0) {
        lines.push(format!("certificate: {count} {what}"));
    }
    lines
}

/// Says so if a mesh will have very many tets for its image, and not because delta and size ask for
/// them: `asked_for` are those that these alone make.
fn warn_of_many([asked_for, expected]: [f64; 2], voxels: u64, monitor: &Monitor<'_>) {
    /// At half a voxel between samples a mesh has some ten tets per voxel.
    const MANY_PER_VOXEL: f64 = 100.0;
    /// How many times as many as asked for are worth a word.
    const MANY_TIMES: f64 = 4.0;
    let voxels = voxels as f64;
    if expected > MANY_PER_VOXEL * voxels && expected > MANY_TIMES * asked_for {
        let line = format!(
            "about {expected:.1e} tets are to be expected, {:.0} for each voxel of the object: \
             what is thin makes all around it small; a larger delta with --no-adaptive, or a \
             larger --spacing-floor, makes fewer, unless the image itself is thin",
            expected / voxels
        );
        monitor.log(Level::Warning, &line);
    }
}

/// The voxels of the object.
fn object_voxels(image: &LabelImage) -> u64 {
    // Few enough at once that 16 bits hold their number, which lets many be counted at a time.
    let count = |ids: &[u16]| u64::from(ids.iter().map(|&id| u16::from(id != 0)).sum::<u16>());
    image.ids().par_chunks(1 << 15).map(count).sum()
}
