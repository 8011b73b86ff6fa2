//! From the mesh to dO, the surface of the oracle.

use glam::DVec3;
use rayon::prelude::*;

use super::triangle_bins::Triangle;
use super::{CHECK_EVERY, CHUNK, Distance, Sum};
use crate::Result;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::reduce::NO_SET;
use crate::reduce::{KeyedSums, Sums};

/// How far from a facet dO is looked for, in largest spacings.
const FAR: f64 = 2.0;

/// Distances from the mesh to dO: over the whole, and the sums of each component that has any
/// facets. `to_world` leads from the coordinates of the triangles to the oracle's, and `longest` is
/// the largest side of a voxel.
pub(crate) fn mesh_to_surface(
    triangles: &[Triangle],
    longest: f64,
    to_world: impl Fn(DVec3) -> DVec3 + Sync,
    oracle: &Oracle,
    monitor: &Monitor<'_>,
) -> Result<(Distance, Sums<Sum>)> {
    let parts = triangles.par_chunks(CHUNK).map(|triangles| {
        let mut whole = Sum::default();
        let mut keyed_sums = KeyedSums::default();
        for (t, triangle) in triangles.iter().enumerate() {
            if t.is_multiple_of(CHECK_EVERY) {
                monitor.advance(0)?;
            }
            let facet @ [a, b, c] = triangle.corners.map(&to_world);
            let normal = (b - a).cross(c - a);
            let distance = from_centroid(
                oracle,
                facet,
                normal.normalize_or_zero(),
                triangle.ids,
                FAR * longest,
            );
            let sum = Sum::of(0.5 * normal.length(), distance);
            whole += sum;
            for component in
                triangle.components.into_iter().filter(|&component| component != NO_SET)
            {
                keyed_sums.add(component.into(), sum);
            }
        }
        Ok((whole, keyed_sums.sums()))
    });
    let (wholes, sums): (Vec<Sum>, Vec<Sums<Sum>>) =
        parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok((wholes.into_iter().sum::<Sum>().distance(), KeyedSums::total(sums)))
}

/// Distance from the centroid of a facet to the nearest change of label that is found along its
/// normal: towards the side whose label the centroid does not have; where that is far, the other
/// way, and then beside the normal. No more than `far`. The normal leads from the first label of
/// `ids` to the second.
fn from_centroid(
    oracle: &Oracle,
    [a, b, c]: [DVec3; 3],
    normal: DVec3,
    ids: [u16; 2],
    far: f64,
) -> f64 {
    let p = (a + b + c) / 3.0;
    let here = oracle.label(p);
    let mut nearest = far;
    let mut look = |way: DVec3| {
        if let Some(crossing) = oracle.first_crossing_from(here, p, p + way * nearest) {
            nearest = crossing.point.distance(p).min(nearest);
        }
        nearest
    };
    let half = 0.5 * oracle.spacing().min_element();
    // Mostly it is near, on the side of the other label.
    let first = if here == ids[1] { -normal } else { normal };
    if look(first) > half && look(-first) > half {
        // Beside the end of an interface, which may lie in the facet's very plane.
        let along = (b - a).normalize_or_zero();
        let across = normal.cross(along);
        for way in [along, -along, across, -across] {
            look((way + 0.25 * normal).normalize_or_zero());
            look((way - 0.25 * normal).normalize_or_zero());
        }
    }
    nearest
}
