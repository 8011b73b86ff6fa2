//! The last stage: what is measured on the mesh, and the nodes of second order.

use crate::image::LabelImage;
use crate::image::small_components::SmallComponent;
use crate::memory::reserve;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::MeshParams;
use crate::refine::options::Limits;
use crate::second_order::{SecondOrder, add_mid_nodes, curve};
use crate::verify::{Certificate, Defect, DefectKind, Examined, Extent, Quality};
use crate::{Error, Result};

/// Measures a mesh with its facets: its quality, and how well it stands for the image. `examined`
/// is what was counted on the triangulation, `dropped` are the components that were left out. Told
/// besides: the limit that ended the measuring of distances.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory); a limit,
/// before the distances.
pub fn measure(
    mesh: &TetMesh,
    image: &LabelImage,
    oracle: &Oracle,
    examined: Examined,
    dropped: &[SmallComponent],
    extent: Extent<'_>,
    monitor: &Monitor<'_>,
) -> Result<(Quality, Certificate, Option<Error>)> {
    let (quality, mut certificate, ended_by) =
        Certificate::measure(mesh, image, oracle, examined, extent, monitor)?;
    reserve(&mut certificate.defects, dropped.len(), "defects")?;
    certificate.defects.extend(dropped.iter().map(
        |&SmallComponent { label, position, voxels }| Defect {
            kind: DefectKind::Dropped,
            label,
            position,
            size: voxels,
        },
    ));
    Ok((quality, certificate, ended_by))
}

/// Whether the limit on memory leaves room for so many more bytes beside a finished mesh.
pub fn room_beside<'a>(
    mesh: &TetMesh,
    oracle: &Oracle,
    limits: &'a Limits,
) -> impl Fn(u64) -> Result<()> + Sync + use<'a> {
    let held = mesh.bytes() + oracle.bytes() as u64;
    move |needed| limits.check_memory(held + needed)
}

/// Adds the nodes of second order, if `params` ask for them.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory);
/// [`LimitReached`](crate::Error::LimitReached) for too many nodes.
pub fn add_nodes(
    mesh: &mut TetMesh,
    image: &LabelImage,
    oracle: &Oracle,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) -> Result<SecondOrder> {
    if params.order < 2 {
        return Ok(SecondOrder::default());
    }
    let mut second_order = add_mid_nodes(mesh, monitor)?;
    if params.curved {
        second_order.curving = curve(mesh, oracle, image.labels(), monitor)?;
    }
    Ok(second_order)
}
