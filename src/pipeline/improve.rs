//! The third stage: topology is mended where sampling followed it, nicks are filled, the mesh is
//! coarsened if that is asked for, slivers go, and then the background that is not to be kept.

use crate::Error;
use crate::Result;
use crate::image::LabelImage;
use crate::improve::{
    Coarseness, Earlier, Improvement, PART_OF_COARSENING, Settings, coarse_tolerance, coarsen,
    facets_below, fill_nicks, improve, tolerance,
};
use crate::memory::reserve;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::params::{Improve, MeshParams};
use crate::pipeline::mend::{Left, Mending, is_mended, mend, passes};
use crate::pipeline::prepare::Prepared;
use crate::refine::options::Limits;

/// What is known of a mesh that is to be improved.
pub(super) struct Known {
    /// So many of its vertices, the first ones, are those of tets that are kept.
    pub points_kept: usize,
    /// What mending it comes to with the first of its passes.
    pub mended: Option<Mending>,
}

/// Improves a mesh that has the background around the object, and keeps of it what `params` ask
/// for. Told besides: the limit that ended the work early, where a partial mesh is allowed.
///
/// # Errors
/// Limits, where none is allowed; [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub(super) fn improve_mesh(
    mesh: &mut TetMesh,
    Known { mut points_kept, mended }: Known,
    prepared: &Prepared,
    image: &LabelImage,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<(Improvement, Option<Error>)> {
    let of_voxel = image.voxel_volume();
    let volumes: Vec<f64> =
        image.voxel_counts().into_iter().map(|voxels| voxels as f64 * of_voxel).collect();
    let side = prepared.oracle.spacing().min_element();
    let mut settings = Settings {
        oracle: &prepared.oracle,
        labels: image.labels(),
        volumes: &volumes,
        sizing: &prepared.sizing,
        improve: params.improve,
        tolerance: tolerance(params.target_dihedral) * side,
        target: params.target_dihedral,
        radius_edge: params.radius_edge,
        facet_angle: params.facet_angle,
        is_delaunay: true,
        parts: [0.0, 1.0],
        check_time: &|| limits.check_time(),
    };
    let mended = match mended {
        Some(Mending { mut tets, left }) => {
            tets.iter().for_each(|tet| mesh.labels[tet.tet as usize] = tet.to);
            if left != Left::default() {
                let passes = &passes(params)[1..];
                let more = mend(mesh, image, &prepared.oracle, passes, monitor)?.tets;
                reserve(&mut tets, more.len(), "tets that are mended")?;
                tets.extend(more);
            }
            tets
        }
        None if is_mended(params) => {
            mend(mesh, image, &prepared.oracle, &passes(params), monitor)?.tets
        }
        None => Vec::new(),
    };
    let filled = match params.improve {
        Improve::Full => fill_nicks(mesh, &prepared.oracle, points_kept, monitor)?,
        Improve::None | Improve::Interior => Vec::new(),
    };
    let (mut coarsened, mut earlier) = (None, Earlier::default());
    if let Some(facet_angle) = params.coarsen {
        let coarseness = Coarseness {
            facet_angle,
            delta: params.delta,
            tolerance: coarse_tolerance(
                params.target_dihedral,
                side,
                prepared.sizing.least_between(params, image.labels()),
            ),
            delta_between: &|labels, p| prepared.sizing.largest_between(params, labels, p),
            size_of: &|label, p| params.size_of(label).min(prepared.sizing.tets().at(p)),
        };
        let mut done = coarsen(mesh, &settings, &coarseness, monitor)?;
        if let Some(limit) = done.ended.take_if(|_| !params.partial) {
            return Err(limit);
        }
        settings.tolerance = coarseness.tolerance;
        settings.is_delaunay = false;
        settings.parts[0] = PART_OF_COARSENING;
        points_kept = if params.background { mesh.points.len() } else { done.points_kept };
        earlier.refined = std::mem::take(&mut done.refined);
        earlier.volumes = done.improvement.counts.volumes.clone();
        coarsened = Some(done);
    }
    let points_before = mesh.points.len();
    let (mut improvement, mut ended) = improve(mesh, &settings, earlier, monitor)?;
    if let Some(coarsened) = coarsened {
        improvement.add_earlier(&coarsened.improvement);
        ended = ended.or(coarsened.ended);
    }
    improvement.facets_below = facets_below(mesh, params.facet_angle, monitor)?;
    let ended_by = match ended {
        Some(limit) if limit.is_limit() && params.partial => Some(limit),
        Some(error) => return Err(error),
        None => None,
    };
    improvement.add_mended(mended.iter().map(|tet| (tet.from, tet.to, tet.volume)));
    improvement.add_filled(&filled);
    let left: Vec<u32> = improvement.left.iter().map(|left| left.tet).collect();
    let places = mesh.finish(params.background, points_kept, points_before, &left, monitor)?;
    improvement.left.iter_mut().zip(places).for_each(|(left, place)| left.tet = place);
    Ok((improvement, ended_by))
}
