//! What a run will need, before it is done: tets, memory, time.
//!
//! Tets follow from the image ([`expected_tets`]); memory from these, from the tables that the
//! image needs, and from what is measured on the mesh; time from all of these and from how fast
//! this machine refines a small ball just now.

use std::borrow::Cow;
use std::time::Instant;

use glam::DVec3;

use super::{budget, prepare};
use crate::Result;
use crate::image::region::{Region, Rows};
use crate::image::{Frame, LabelImage};
use crate::mesh::extract::BYTES_PER_SLOT;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::{Adaptive, CertificateLevel, Improve, MeshParams};
use crate::refine::options::Limits;
use crate::sizing::Sizing;
use crate::sizing::expected::{Expected, expected_tets};
use crate::verify::topology::differences::Differences;

/// Seconds that the refinement of the ball of [`machine`] took on the machine on which the costs
/// below were measured, with one thread.
const REFERENCE: f64 = 0.0068;

/// Nanoseconds for each voxel of the object's box, and for each tet of the triangulation. The
/// distances of the full certificate depend on the area of interfaces, not on the voxels: from 120
/// to 200 for each of them on the atlases.
const PREPARE_VOXEL: f64 = 14.0;
const REFINE_TET: f64 = 670.0;
const IMPROVE_TET: f64 = 235.0;
/// Sampling by topology, its comparisons and rounds: for each voxel, contact and tet; and mending,
/// for each tet.
const TOPOLOGY_VOXEL: f64 = 200.0;
const TOPOLOGY_CONTACT: f64 = 800_000.0;
/// The same of a contact where not all differences count.
const TOPOLOGY_CONTACT_COARSE: f64 = 300_000.0;
const TOPOLOGY_TET: f64 = 150.0;
const MEND_TET: f64 = 300.0;
/// Coarsening and improvement together, for each tet that is left, and for each that has gone: from
/// 2600 to 5400 and from 9000 to 12,400 on the atlases.
const COARSEN_LEFT: f64 = 3400.0;
const COARSEN_GONE: f64 = 10_300.0;
const SOUND_TET: f64 = 235.0;
const SOUND_VOXEL: f64 = 15.0;
const FULL_TET: f64 = 527.0;
const FULL_VOXEL: f64 = 160.0;

/// Bytes for each tet of the triangulation while the mesh is copied, for each tet that is kept when
/// it has gone, and of a process that does nothing. Distances need as much again as the tables of
/// the image, and a third of that.
const BYTES_PER_TET: f64 = 98.0;
const BYTES_AFTER: f64 = 60.0;
/// What comparisons need for each tet, beside their tables.
const BYTES_COMPARED: f64 = 45.0;
const OF_DISTANCES: f64 = 1.3;
const BYTES_AT_REST: u64 = 6 << 20;

/// What a run is to be expected to need. Measured on atlases: docs/notes/sampling.md.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Tets of labels.
    pub tets: u64,
    /// Bytes of memory at the peak, the image among them.
    pub peak_bytes: u64,
    /// Seconds on this machine, as busy as it is now, with the threads that are asked for.
    pub seconds: f64,
}

/// What `params` are to be expected to need. Takes as long as the preparation of the image, and
/// some 20 milliseconds to find out how fast the machine is.
///
/// # Errors
/// As [`mesh_image`](super::mesh_image), as far as they come of the image and of `params`.
pub fn estimate(
    image: &LabelImage,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) -> Result<Estimate> {
    params.validate()?;
    params.validate_together()?;
    prepare::enter(image, monitor)?;
    let prepare::Selected { image: selected, .. } = prepare::select_labels(image, params, monitor)?;
    let prepare::Divided { image, .. } =
        prepare::divide(&selected, params, &Limits::default(), monitor)?;
    let factor = match params.target_tets {
        Some(target) => {
            let limits = Limits::default();
            budget::Search::new(&image, params, target, &limits, monitor)?.factor()
        }
        None => 1.0,
    };
    let params = &params.scaled(factor);
    let check = || monitor.advance(1);
    let region = Region::new(&image, &check)?;
    let rows = Rows::new(&image, region, &check)?;
    let contacts = prepare::contacts_of(&image, &rows, params, &check)?;
    let Expected { of_labels, of_background } =
        expected_tets(&image, &rows, params, &contacts, &check)?;
    let all = of_labels + of_background;
    let left = if params.coarsen.is_some() {
        budget::expected_after_coarsening(&image, &rows, params, &check)?
    } else {
        of_labels
    };

    let divided = if matches!(image, Cow::Owned(_)) { image.ids().len() } else { 0 };
    let tables = Oracle::bytes_needed(&image, &region)
        + Sizing::bytes_needed(&image, &region, params)
        + (selected.ids().len() + divided) as u64 * size_of::<u16>() as u64;
    let limits = prepare::limits(params, &selected, Instant::now());
    let of_nodes = (limits.bytes_per_slot - BYTES_PER_SLOT) as f64;
    let of_distances = match params.certificate {
        CertificateLevel::Full => OF_DISTANCES * tables as f64 + limits.bytes_after as f64,
        CertificateLevel::None | CertificateLevel::Sound => 0.0,
    };
    let kept = if params.background { all } else { of_labels };
    let after = (BYTES_AFTER + of_nodes) * kept + of_distances;
    let voxels = region.dims.iter().product::<usize>() as f64;
    // The bytes of comparisons with the image, and the nanoseconds of these, of the rounds and of
    // mending.
    let [compared, of_topology] = match params.adaptive {
        Adaptive::Topology => {
            let of_mending = if params.improve == Improve::Full { MEND_TET } else { 0.0 };
            let side = image.frame().spacing().min_element();
            let per_contact = match params.all_differences_count(side) {
                true => TOPOLOGY_CONTACT,
                false => TOPOLOGY_CONTACT_COARSE,
            };
            let of_contacts = per_contact * contacts.len() as f64;
            [
                BYTES_COMPARED * all + Differences::bytes_needed(&image, &region) as f64,
                TOPOLOGY_VOXEL * voxels + of_contacts + (TOPOLOGY_TET + of_mending) * all,
            ]
        }
        Adaptive::Off | Adaptive::Thickness => [0.0; 2],
    };
    let peak = (BYTES_PER_TET * all + compared).max(after);

    // The certificate goes through the voxels that were given.
    let whole = voxels * selected.ids().len() as f64 / image.ids().len() as f64;
    let of_refinement = PREPARE_VOXEL * voxels + REFINE_TET * all + of_topology;
    let of_improvement = match params.coarsen {
        Some(_) => COARSEN_LEFT * left + COARSEN_GONE * (of_labels - left).max(0.0),
        None if params.improve != Improve::None => IMPROVE_TET * all,
        None => 0.0,
    };
    let of_certificate = match params.certificate {
        CertificateLevel::None => 0.0,
        CertificateLevel::Sound => SOUND_TET * all + SOUND_VOXEL * whole,
        CertificateLevel::Full => FULL_TET * all + FULL_VOXEL * whole,
    };
    let nanoseconds = of_refinement + of_improvement + of_certificate;
    let seconds = 1e-9 * nanoseconds * machine(monitor)? / speedup(params.threads);
    // What is too large for an integer becomes the largest one.
    let peak_bytes = ((BYTES_AT_REST + tables) as f64 + peak) as u64;
    Ok(Estimate { tets: left as u64, peak_bytes, seconds: seconds.min(f64::MAX) })
}

/// How many times as fast as one thread so many are, on as many cores: 1.9 for two, 9.6 for 16
/// (docs/notes/benchmarks.md).
fn speedup(threads: usize) -> f64 {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.min(cores) as f64;
    threads / (1.0 + 0.045 * (threads - 1.0))
}

/// How much slower this machine is than that on which the costs were measured: by refining a small
/// ball, twice, as what else goes on may disturb one.
fn machine(monitor: &Monitor<'_>) -> Result<f64> {
    let frame = Frame::axis_aligned([1.0; 3])?;
    let in_ball = |p: DVec3| i32::from((p - DVec3::splat(11.5)).length() < 10.0);
    let ball = LabelImage::from_fn([24; 3], frame, in_ball)?;
    let params = MeshParams {
        delta: 0.8,
        size: 1.6,
        adaptive: Adaptive::Off,
        improve: Improve::None,
        certificate: CertificateLevel::None,
        ..MeshParams::default()
    };
    let look = || monitor.advance(0);
    let mut least = f64::INFINITY;
    for _ in 0..2 {
        let run = super::mesh_image(&ball, &params, &Monitor::within(&look))?;
        least = least.min(run.report.seconds.refine);
    }
    Ok(least / REFERENCE)
}
