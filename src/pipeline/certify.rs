//! Measures a mesh that is finished already, against its image: one that a run made without a
//! certificate, or with less of one than is wanted; or one that another program made.

use std::time::Instant;

use super::finish;
use super::messages;
use super::prepare::{Divided, Selected, divide, enter, limits, oracle_of, select_labels};
use super::{MeshResult, RunReport};
use crate::image::LabelImage;
use crate::mesh::TetMesh;
use crate::monitor::{Level, Monitor, Step};
use crate::params::{CertificateLevel, MeshParams};
use crate::verify::{Certificate, Examined, Extent};
use crate::{Error, Result};

/// What there is of a mesh from elsewhere, before it is certified.
pub fn from_elsewhere(mesh: TetMesh) -> MeshResult {
    let report = RunReport { certificate: Certificate::none(), ..RunReport::default() };
    MeshResult { mesh, report, ended_by: None }
}

/// Measures the quality and the certificate of a finished mesh, as far as the level of `params`
/// asks, and puts them into its report. The labels of `image` that were merged, kept and left out
/// are those that `params` tell, and so are the interfaces that distances are measured to.
///
/// What was counted on the triangulation of a run stays as it was. Without that, facets that are
/// not Delaunay are counted on the mesh, unless it was improved; rules that stay unmet are not.
///
/// # Errors
/// Those of [`mesh_image`](super::mesh_image) for image and `params`, and
/// [`Error::InvalidArgument`] for the level [`None`](CertificateLevel::None); [`Error::TimeLimit`];
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]. The report is as it was then.
pub fn certify(
    result: &mut MeshResult,
    image: &LabelImage,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) -> Result<()> {
    let start = Instant::now();
    params.validate()?;
    params.validate_together()?;
    let level = params.certificate;
    let last = match level {
        CertificateLevel::None => {
            return Err(Error::InvalidArgument(
                "the certificate's level is none: there is nothing to measure".into(),
            ));
        }
        CertificateLevel::Sound => Step::MeshToImage,
        CertificateLevel::Full => Step::Done,
    };
    monitor.leave_out_from(last);
    monitor.leave_out_before(Step::Quality);
    let limits = limits(params, image, start);
    enter(image, monitor)?;
    let Selected { image, dropped } = select_labels(image, params, monitor)?;
    let oracle = {
        let Divided { image: divided, limits } = &divide(&image, params, &limits, monitor)?;
        oracle_of(divided, params, limits, monitor)?
    };

    let MeshResult { mesh, report, .. } = result;
    monitor.end_at(limits.deadline);
    if mesh.facet_walls.is_empty() {
        mesh.find_walls(|corners| oracle.wall_of_facet(corners), monitor)?;
    }
    let before = report.certificate.examined();
    let is_improved = report.improvement.counts.operations() > 0;
    let non_delaunay_facets = match before.non_delaunay_facets {
        None if !is_improved => Some(mesh.non_delaunay_facets(|_| true, |_| true, monitor)?),
        counted => counted,
    };
    let examined = Examined { non_delaunay_facets, ..before };
    let check_memory = &finish::room_beside(mesh, &oracle, &limits);
    let extent = Extent { level, distances_until: limits.deadline, check_memory };
    let measured = finish::measure(mesh, &image, &oracle, examined, &dropped, extent, monitor);
    monitor.end_at(None);
    let (quality, certificate, limit) = measured?;
    if let Some(limit) = limit {
        return Err(limit);
    }
    messages::warnings(&certificate).iter().for_each(|line| monitor.log(Level::Warning, line));
    monitor.enter(Step::Done, 0)?;
    report.seconds.certify = start.elapsed().as_secs_f64();
    (report.quality, report.certificate) = (quality, certificate);
    Ok(())
}
