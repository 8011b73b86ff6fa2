//! The pipeline from image to mesh: oracle, refinement, extraction, certificate.
//!
//! Thread safety: any number of runs may go on at once; a run shares nothing but what it is given. Image passes run in the caller's rayon pool.

use std::time::Instant;

use crate::delaunay::Triangulation;
use crate::image::LabelImage;
use crate::mesh::TetMesh;
use crate::mesh::certificate::Certificate;
use crate::mesh::extract::extract;
use crate::mesh::quality::Quality;
use crate::monitor::{Monitor, Phase};
use crate::oracle::Oracle;
use crate::params::MeshParams;
use crate::refine::refiner::Schedule;
use crate::refine::rules::Rules;
use crate::refine::{refine, unmet_rules};
use crate::{Error, Result};

/// The virtual box leaves this part of the object's longest side free on every side, so that the circumcenters of tets between object and box lie inside it.
const BOX_MARGIN: f64 = 0.25;

/// A finished run.
#[derive(Clone, Debug)]
pub struct Meshing {
    /// The mesh.
    pub mesh: TetMesh,
    /// What the run did, and what was measured on the mesh.
    pub report: RunReport,
}

/// Wall-clock seconds of the phases.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// The oracle: feature transform, labels.
    pub distance: f64,
    /// From the finished oracle to the last rule satisfied.
    pub refine: f64,
    /// Collecting the mesh.
    pub extract: f64,
    /// Quality and certificate.
    pub certify: f64,
}

/// Operations of the kernel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Operations {
    /// Vertices inserted.
    pub insertions: u64,
    /// Vertices removed.
    pub removals: u64,
    /// Operations given up because of another thread.
    pub rollbacks: u64,
    /// Tests that floating point could not decide.
    pub exact_predicates: u64,
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
    /// Operations.
    pub operations: Operations,
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
/// [`Error::InvalidArgument`], [`Error::Unsupported`] for `params`; [`Error::EmptyImage`]; [`Error::Cancelled`]; [`Error::LimitReached`].
pub fn mesh_image(image: &LabelImage, params: &MeshParams, monitor: &mut Monitor<'_>) -> Result<Meshing> {
    params.validate()?;
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
    if image.is_all_background() {
        return Err(Error::EmptyImage);
    }
    let mut seconds = Seconds::default();
    let mut clock = Instant::now();
    let mut lap = || std::mem::replace(&mut clock, Instant::now()).elapsed().as_secs_f64();

    monitor.report(Phase::Distance, 0.0, 0)?;
    let flag = monitor.cancel_flag();
    let check = || if flag.is_some_and(|f| f.is_cancelled()) { Err(Error::Cancelled) } else { Ok(()) };
    let oracle = Oracle::new(image, params.surface, &check)?;
    seconds.distance = lap();

    let [lower, upper] = oracle.bounds();
    let margin = (upper - lower).max_element() * BOX_MARGIN + 4.0 * params.delta;
    let triangulation = Triangulation::new(lower - margin, upper + margin)?;
    let rules = Rules::new(&triangulation, &oracle, params, image.labels());
    let schedule = Schedule { expected_tets: expected_tets(image, params), max_vertices: params.max_vertices };
    monitor.report(Phase::Refine, Schedule::START, 0)?;
    let counters = refine(&rules, &schedule, monitor)?;
    seconds.refine = lap();

    monitor.report(Phase::Extract, Schedule::END, counters.created - counters.destroyed)?;
    let unmet = unmet_rules(&rules, monitor)?;
    let check = triangulation.check_while(|| monitor.check_cancelled())?;
    let label = |t| image.labels()[usize::from(rules.label(t))];
    let mesh = extract(&triangulation, label, params.background, monitor)?;
    if !mesh.labels.iter().any(|&label| label != 0) {
        return Err(Error::InvalidArgument(format!(
            "delta {} is too coarse for the object: no tet has its circumcenter inside",
            params.delta
        )));
    }
    drop(rules);
    drop(triangulation);
    drop(oracle);
    seconds.extract = lap();

    monitor.report(Phase::Certify, 0.94, check.tets)?;
    let quality = Quality::measure(&mesh);
    let certificate = Certificate::measure(&mesh, image, check.non_delaunay_facets, unmet, monitor)?;
    seconds.certify = lap();
    monitor.report(Phase::Certify, 1.0, check.tets)?;
    let operations = Operations {
        insertions: counters.insertions,
        removals: counters.removals,
        rollbacks: counters.rollbacks,
        exact_predicates: counters.exact_predicates,
    };
    let (all_tets, all_vertices) = (check.tets, check.vertices);
    Ok(Meshing { mesh, report: RunReport { seconds, all_tets, all_vertices, operations, unmet, quality, certificate } })
}

/// A guess of the tets of the whole triangulation, for progress only: some per delta^2 of interface and some per size^3 of object, as measured on the atlases.
fn expected_tets(image: &LabelImage, params: &MeshParams) -> u64 {
    let [nx, ny, _] = image.dims();
    let ids = image.ids();
    let changes = |stride: usize| ids.iter().zip(&ids[stride.min(ids.len())..]).filter(|(a, b)| a != b).count() as f64;
    let spacing = image.frame().spacing();
    let voxel = spacing.element_product();
    let area = changes(1) * voxel / spacing.x + changes(nx) * voxel / spacing.y + changes(nx * ny) * voxel / spacing.z;
    let volume = ids.iter().filter(|&&id| id != 0).count() as f64 * voxel;
    (4.0 * area / params.delta.powi(2) + 8.0 * volume / params.size.powi(3)) as u64
}
