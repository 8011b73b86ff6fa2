//! Tets that got another label when an earlier mesh was mended, found again in a later one.
//!
//! A mesh that is mended for trial again and again changes in few places in between. What was
//! changed in one is mostly right in the next one, too, so it is tried first. Then few components
//! are left around which tets must be looked for.

use glam::DVec3;
use rayon::prelude::*;

use super::standings::{Mended, corners, no_vertices};
use crate::Result;
use crate::memory::{concatenated, reserve, room};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;

/// Tets, or vertices, of one piece of work.
const CHUNK: usize = 1 << 12;

const WHAT: &str = "tets that were mended before";

/// The coordinates of a point as bits: the same point has the same ones in any mesh.
type Point = [u64; 3];

/// Tets of an earlier mesh, and the labels that they got.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Earlier {
    /// The corners of all, sorted, each once.
    points: Vec<Point>,
    /// Sorted; so are the corners of each.
    tets: Vec<([Point; 4], i32)>,
}

impl Earlier {
    /// Those of `mesh` that were changed, in order.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(mesh: &TetMesh, mended: &[Mended]) -> Result<Self> {
        let mut tets = room(mended.len(), WHAT)?;
        // One that was changed twice has the label that it got last.
        tets.extend(mended.iter().rev().map(|tet| (key(corners(mesh, tet.tet)), tet.to)));
        tets.sort_by_key(|&(corners, _)| corners);
        tets.dedup_by_key(|(corners, _)| *corners);
        let mut points: Vec<Point> = room(4 * tets.len(), WHAT)?;
        points.extend(tets.iter().flat_map(|(corners, _)| corners));
        points.sort_unstable();
        points.dedup();
        Ok(Self { points, tets })
    }

    /// Those that are in `mesh` too and have other labels there, in its order, with the labels that
    /// they got.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn found_in(&self, mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Vec<(u32, i32)>> {
        if self.tets.is_empty() {
            return Ok(Vec::new());
        }
        let is_corner = no_vertices(mesh)?;
        mesh.points.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, points)| {
            monitor.advance(0)?;
            let of_earlier = (0..points.len()).filter(|&n| {
                let point = points[n].map(f64::to_bits);
                self.points.binary_search(&point).is_ok()
            });
            of_earlier.for_each(|n| is_corner.set((chunk * CHUNK + n) as u32));
            Ok(())
        })?;
        let of_chunk = |(chunk, tets): (usize, &[[u32; 4]])| {
            monitor.advance(0)?;
            let mut found = Vec::new();
            for (t, tet) in ((chunk * CHUNK) as u32..).zip(tets) {
                if !tet.iter().all(|&v| v != NONE && is_corner.has(v)) {
                    continue;
                }
                let corners = key(corners(mesh, t));
                let known = self.tets.binary_search_by_key(&corners, |&(corners, _)| corners);
                let to = known.ok().map(|n| self.tets[n].1);
                if let Some(to) = to.filter(|&to| to != mesh.labels[t as usize]) {
                    reserve(&mut found, 1, WHAT)?;
                    found.push((t, to));
                }
            }
            Ok(found)
        };
        let chunks = mesh.tets.par_chunks(CHUNK).enumerate().map(of_chunk);
        concatenated(chunks.collect::<Result<_>>()?, WHAT)
    }
}

fn key(corners: [DVec3; 4]) -> [Point; 4] {
    let mut key = corners.map(|corner| corner.to_array().map(f64::to_bits));
    key.sort_unstable();
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing;

    #[test]
    fn tets_are_found_again_whatever_their_numbers() {
        let mesh = testing::kuhn_box([3; 3], [1.0; 3], |_, _, _| 1);
        let mended = |tet: u32, to: i32| Mended { tet, from: 1, to, volume: 0.0 };
        let earlier = Earlier::new(
            &mesh,
            &[mended(7, 2), mended(90, 3), mended(20, 2), mended(20, 1), mended(7, 4)],
        )
        .unwrap();
        let mut later = mesh.clone();
        later.tets.reverse();
        later.tets.iter_mut().for_each(|tet| tet.swap(0, 2));
        let last = mesh.tets.len() as u32 - 1;
        let found = earlier.found_in(&later, &Monitor::silent()).unwrap();
        assert_eq!(found, [(last - 90, 3), (last - 7, 4)]);
        // Another mesh has none of them.
        let other = testing::kuhn_box([3; 3], [1.1; 3], |_, _, _| 1);
        assert_eq!(earlier.found_in(&other, &Monitor::silent()).unwrap(), []);
    }
}
