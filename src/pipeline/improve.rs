//! The third stage: nicks are filled, slivers go, and then the background that is not to be kept.

use crate::Error;
use crate::Result;
use crate::image::LabelImage;
use crate::improve::{Improvement, Settings, fill_nicks, improve};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::params::{Improve, MeshParams};
use crate::pipeline::prepare::Prepared;
use crate::refine::options::Limits;

/// Improves a mesh that has the background around the object, and keeps of it what `params` ask
/// for; `points_kept` is as [`collect`](super::refine::collect) has it. Told besides: the limit
/// that ended the work early, where a partial mesh is allowed.
///
/// # Errors
/// Limits, where none is allowed; [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn improve_mesh(
    mesh: &mut TetMesh,
    points_kept: usize,
    prepared: &Prepared,
    image: &LabelImage,
    params: &MeshParams,
    limits: &Limits,
    monitor: &Monitor<'_>,
) -> Result<(Improvement, Option<Error>)> {
    let settings = Settings {
        oracle: &prepared.oracle,
        labels: image.labels(),
        sizing: &prepared.sizing,
        improve: params.improve,
        target: params.target_dihedral,
        radius_edge: params.radius_edge,
        facet_angle: params.facet_angle,
        check_time: &|| limits.check_time(),
    };
    let points_before = mesh.points.len();
    // Whoever asks for the inside alone keeps interfaces bit for bit.
    let filled = match params.improve {
        Improve::Full => fill_nicks(mesh, &prepared.oracle, points_kept, monitor)?,
        Improve::None | Improve::Interior => Vec::new(),
    };
    let (mut improvement, ended) = improve(mesh, &settings, monitor)?;
    let ended_by = match ended {
        Some(limit) if limit.is_limit() && params.partial => Some(limit),
        Some(error) => return Err(error),
        None => None,
    };
    improvement.add_filled(&filled);
    let left: Vec<u32> = improvement.left.iter().map(|left| left.tet).collect();
    let places = mesh.finish(params.background, points_kept, points_before, &left, monitor)?;
    improvement.left.iter_mut().zip(places).for_each(|(left, place)| left.tet = place);
    Ok((improvement, ended_by))
}
