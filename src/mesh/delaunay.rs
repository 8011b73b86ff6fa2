//! Which interior facets of a mesh are not locally Delaunay, by exact arithmetic.

use glam::DVec3;
use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::geometry::predicates::{in_sphere, orient};
use crate::geometry::sphere::Circumsphere;
use crate::geometry::tet_block::{BLOCK, Spheres, TetBlock};
use crate::memory::{prefetch, reserve};
use crate::monitor::Monitor;

/// Tets of one piece of work.
const CHUNK: usize = 1 << 12;

impl TetMesh {
    /// Facets between two tets of which each has the other's opposite vertex inside its
    /// circumsphere: of tets that `is_kept`, at least one of which `is_asked`. Points on the sphere
    /// are not inside of it. What an inverted tet would tell is left out. In parallel in the
    /// current rayon pool; linear.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn non_delaunay_facets(
        &self,
        is_kept: impl Fn(u32) -> bool + Sync,
        is_asked: impl Fn(u32) -> bool + Sync,
        monitor: &Monitor<'_>,
    ) -> Result<u64> {
        let ask_for = |t: u32| {
            let t = t as usize;
            for (v, other) in self.tets[t].into_iter().zip(self.neighbors[t]) {
                prefetch(self.points.as_ptr().wrapping_add(v as usize));
                prefetch(self.tets.as_ptr().wrapping_add(other as usize));
            }
        };
        let count = |t: u32, sphere: Circumsphere| {
            let tet = self.tets[t as usize];
            let [a, b, c, d] = tet.map(|v| self.point(v));
            if !sphere.is_certain() && orient(a, b, c, d) <= 0.0 {
                return 0;
            }
            let is_inside =
                |p: DVec3| sphere.contains(p).unwrap_or_else(|| in_sphere(a, b, c, d, p) > 0.0);
            let facets = (0..4).filter(|&i| {
                let other = self.neighbors[t as usize][i];
                // Each facet once.
                if other == NONE || !is_kept(other) || is_asked(other) && other < t {
                    return false;
                }
                let beyond = self.tets[other as usize].into_iter().find(|v| !tet.contains(v));
                beyond.is_some_and(|v| is_inside(self.point(v)))
            });
            facets.count() as u64
        };
        let pieces = (0..self.tets.len().div_ceil(CHUNK)).into_par_iter().with_max_len(1);
        let pieces = pieces.map(|piece| {
            monitor.advance(0)?;
            let (mut block, mut spheres) = (TetBlock::default(), Spheres::default());
            let tets = piece * CHUNK..((piece + 1) * CHUNK).min(self.tets.len());
            let mut asked = Vec::new();
            reserve(&mut asked, tets.len(), "tets of the mesh")?;
            asked.extend(tets.map(|t| t as u32).filter(|&t| is_asked(t) && is_kept(t)));
            let mut facets = 0;
            for asked in asked.chunks(BLOCK) {
                asked.iter().for_each(|&t| ask_for(t));
                block.clear();
                for &t in asked {
                    block.push(self.tets[t as usize].map(|v| self.points[v as usize]));
                }
                block.spheres(&mut spheres);
                let counted = asked.iter().enumerate().map(|(i, &t)| count(t, spheres.get(i)));
                facets += counted.sum::<u64>();
            }
            Ok(facets)
        });
        pieces.try_reduce(|| 0, |a, b| Ok(a + b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing::kuhn_box;

    #[test]
    fn facets_of_a_flattened_corner_are_counted() {
        let count = |mesh: &TetMesh| {
            mesh.non_delaunay_facets(|_| true, |_| true, &Monitor::silent()).unwrap()
        };
        let mut mesh = kuhn_box([2; 3], [1.0; 3], |_, _, _| 1);
        // All points of a cube lie on one sphere, none inside of it.
        assert_eq!(count(&mesh), 0);
        // The centre lies in 24 tets; moved, it is inside the spheres of some beyond.
        mesh.points[13] = [1.4, 1.0, 1.0];
        let all = count(&mesh);
        assert!(all > 0);
        // Asking tet by tet of those not asked before finds each facet once.
        let of_one = |t| {
            let (kept, asked) = (|s| s >= t, |s| s == t);
            mesh.non_delaunay_facets(kept, asked, &Monitor::silent()).unwrap()
        };
        assert_eq!((0..mesh.tets.len() as u32).map(of_one).sum::<u64>(), all);
    }
}
