//! Outer facets that should lie on a wall and do not: nicks where the image cuts the object off.
//!
//! An outer facet with a vertex on a wall either lies on the wall or is part of an interface that
//! ends there. If it is part of an interface, the image has background next to it on its outer
//! side. If the way from its centroid along its outer normal stays within the object up to the
//! wall, and one of its vertices has no background around it, what lies between is missing: the
//! facet counts. (The vertices of an interface are on it, its facets only near it.)
//!
//! Cost: a ray for each outer facet that has a vertex on a wall and does not lie on it.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::{Oracle, Walls};

/// Facets of one piece of work.
const CHUNK: usize = 1 << 12;

/// How far around a vertex of an interface background is looked for, in voxels: more than what
/// vertices are moved by.
const AROUND: f64 = 0.25;

/// How many outer facets should lie on a wall and do not.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub fn facets_off_walls(mesh: &TetMesh, oracle: &Oracle, monitor: &Monitor<'_>) -> Result<u64> {
    if !oracle.has_walls() {
        return Ok(0);
    }
    let counts = mesh.facets.par_chunks(CHUNK).zip(mesh.facet_labels.par_chunks(CHUNK)).map(
        |(facets, labels)| {
            monitor.check_cancelled()?;
            let off = facets.iter().zip(labels).filter(|&(facet, &[inner, outer])| {
                let corners = facet.map(|v| mesh.point(v));
                // The normal points to the second label.
                let outwards = if outer == 0 { 1.0 } else { -1.0 };
                (inner == 0 || outer == 0) && is_off_wall(oracle, corners, outwards)
            });
            Ok(off.count() as u64)
        },
    );
    counts.try_reduce(|| 0, |a, b| Ok(a + b))
}

/// Whether the object goes on from an outer facet to a wall that the facet has a vertex on; the
/// facet's normal times `outwards` points out of the mesh.
fn is_off_wall(oracle: &Oracle, corners @ [a, b, c]: [DVec3; 3], outwards: f64) -> bool {
    let walls = corners.map(|p| oracle.walls_at(p));
    let [first, second, third] = &walls;
    if walls.iter().all(|walls| *walls == Walls::NONE)
        || first.common(second).common(third).count() > 0
    {
        return false;
    }
    let normal = (b - a).cross(c - a).normalize_or_zero() * outwards;
    let reach = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let (mut from, end) = ((a + b + c) / 3.0, (a + b + c) / 3.0 + reach * normal);
    let mut label = oracle.label(from);
    while label != 0 {
        match oracle.first_crossing_from(label, from, end) {
            // As far as a facet reaches there is no end of the object.
            None => return false,
            Some(crossing) if crossing.to == 0 => {
                return oracle.is_on_wall(crossing.point)
                    && corners.iter().any(|&p| !oracle.has_label_near(p, 0, AROUND));
            }
            Some(crossing) => (from, label) = (crossing.point, crossing.to),
        }
    }
    false
}
