//! The interface facets of a mesh, from its tets, labels and neighbours; and the end of a mesh that
//! was improved.
//!
//! Facets come in the order of the tets that list them, each from the side of the label that
//! comes first: the smaller one, the background last.
//! Work goes by ranges of tets, so the result does not depend on the number of threads.

use glam::DVec3;
use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::tet::{FACET, Facet};
use crate::image::Wall;
use crate::memory::{filled, parts, reserve, zeroed};
use crate::monitor::Monitor;

/// Tets of one piece of work.
const RANGE: usize = 1 << 13;

/// Whether a label comes first at the interface with another.
pub(super) fn is_before(label: i32, other: i32) -> bool {
    label != 0 && (other == 0 || label < other)
}

impl TetMesh {
    /// Fills in `facets`, `facet_labels` and `facet_tets`. What lies across a facet without a
    /// neighbour is background.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn collect_facets(&mut self, monitor: &Monitor<'_>) -> Result<()> {
        let (tets, neighbors, labels) = (&self.tets, &self.neighbors, &self.labels);
        let list = |range: usize| {
            monitor.advance(0)?;
            let mut listed = Vec::new();
            for t in range * RANGE..((range + 1) * RANGE).min(tets.len()) {
                for (i, &other) in neighbors[t].iter().enumerate() {
                    // Each facet once.
                    let (label, is_listed) = if other == NONE {
                        (0, true)
                    } else {
                        (labels[other as usize], (other as usize) < t)
                    };
                    if is_listed && labels[t] != label {
                        reserve(&mut listed, 1, "interface facets of the mesh")?;
                        listed.push(Facet::new(t as u32, i));
                    }
                }
            }
            Ok(listed)
        };
        let ranges = (0..tets.len().div_ceil(RANGE)).into_par_iter().with_max_len(1);
        let listed: Vec<Vec<Facet>> = ranges.map(list).collect::<Result<_>>()?;
        let count = listed.iter().map(Vec::len).sum();
        self.facets = zeroed(count, "interface facets of the mesh")?;
        self.facet_labels = zeroed(count, "interface facets of the mesh")?;
        self.facet_tets = zeroed(count, "interface facets of the mesh")?;
        let lengths = || listed.iter().map(Vec::len);
        let pieces = parts(&mut self.facets, lengths(), "ranges of facets")?
            .into_par_iter()
            .zip(parts(&mut self.facet_labels, lengths(), "ranges of facets")?)
            .zip(parts(&mut self.facet_tets, lengths(), "ranges of facets")?)
            .zip(&listed)
            .with_max_len(1);
        pieces.try_for_each(|(((facets, facet_labels), facet_tets), listed)| {
            monitor.advance(0)?;
            for (k, facet) in listed.iter().enumerate() {
                let (t, i) = (facet.tet(), facet.index());
                let other = neighbors[t as usize][i];
                let (here, there) =
                    (labels[t as usize], if other == NONE { 0 } else { labels[other as usize] });
                let [a, b, c] = FACET[i].map(|j| tets[t as usize][j]);
                // FACET's normals point into the tet.
                (facets[k], facet_labels[k], facet_tets[k]) = if is_before(here, there) {
                    ([a, c, b], [here, there], [t, other])
                } else {
                    ([a, b, c], [there, here], [other, t])
                };
            }
            Ok(())
        })
    }

    /// Fills in `facet_walls`: `wall` tells which wall the facet with these corners lies on, and is
    /// asked for facets on the outside only.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn find_walls(
        &mut self,
        wall: impl Fn([DVec3; 3]) -> Wall + Sync,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        let mut walls = filled(self.facets.len(), Wall::None, "walls of facets", || Ok(()))?;
        let pieces = walls.par_chunks_mut(RANGE).enumerate().with_max_len(1);
        pieces.try_for_each(|(piece, walls)| {
            monitor.advance(0)?;
            for (f, slot) in (piece * RANGE..).zip(walls) {
                if self.facet_labels[f][1] == 0 {
                    *slot = wall(self.facets[f].map(|v| self.point(v)));
                }
            }
            Ok(())
        })?;
        self.facet_walls = walls;
        Ok(())
    }

    /// Closes the gaps that improvement left, and drops the background unless it is to be `kept`:
    /// of the vertices those between number `points_kept` and `points_before`, the count before
    /// improvement. Returns where each of `tets` is now.
    ///
    /// The last tets go where there are gaps, so that all others keep their places. An empty slot
    /// has label 0, and no tet names it as its neighbour.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory), with the mesh unchanged.
    pub(crate) fn finish(
        &mut self,
        kept: bool,
        points_kept: usize,
        points_before: usize,
        tets: &[u32],
        monitor: &Monitor<'_>,
    ) -> Result<Vec<u32>> {
        // Only to report: a mesh that is half changed would be of no use to anybody.
        let report = || drop(monitor.advance(0));
        let is_empty = |t: &usize| self.tets[*t][0] == NONE;
        debug_assert!((0..self.tets.len()).filter(is_empty).all(|t| self.labels[t] == 0));
        let is_kept = |t: usize| match kept {
            true => self.tets[t][0] != NONE,
            false => self.labels[t] != 0,
        };
        let of_chunk = |chunk: usize| chunk * RANGE..((chunk + 1) * RANGE).min(self.tets.len());
        let chunks = (0..self.tets.len().div_ceil(RANGE)).into_par_iter().with_max_len(1);
        let counts: Vec<usize> =
            chunks.clone().map(|chunk| of_chunk(chunk).filter(|&t| is_kept(t)).count()).collect();
        let count = counts.iter().sum();
        // As many gaps before `count` as tets behind it. Most chunks have no gap, or no tet.
        let gaps: Vec<u32> = chunks
            .clone()
            .filter(|&chunk| counts[chunk] < of_chunk(chunk).len())
            .flat_map_iter(|chunk| {
                of_chunk(chunk).filter(|&t| t < count && !is_kept(t)).map(|t| t as u32)
            })
            .collect();
        let moved: Vec<u32> = chunks
            .filter(|&chunk| counts[chunk] > 0)
            .flat_map_iter(|chunk| {
                of_chunk(chunk).filter(|&t| t >= count && is_kept(t)).map(|t| t as u32)
            })
            .collect();
        debug_assert_eq!(gaps.len(), moved.len());
        report();
        let behind = self.tets.len() - count;
        // Where each tet behind `count` goes; nowhere what is dropped.
        let mut to: Vec<u32> = zeroed(behind, "tets of the mesh")?;
        to.iter_mut().for_each(|to| *to = NONE);
        for (&from, &gap) in moved.iter().zip(&gaps) {
            to[from as usize - count] = gap;
        }
        let place = |t: u32| match t {
            NONE => NONE,
            t if (t as usize) < count => t,
            t => to[t as usize - count],
        };
        let mut places = Vec::new();
        reserve(&mut places, tets.len(), "tets of the mesh")?;
        places.extend(tets.iter().map(|&t| place(t)));
        let (mut next, mut numbers) = (points_kept as u32, Vec::new());
        reserve(&mut numbers, self.points.len() - points_before, "vertices of the mesh")?;
        // What is dropped before `count` is nobody's neighbour any more.
        for &gap in gaps.iter().filter(|&&gap| self.tets[gap as usize][0] != NONE) {
            for t in self.neighbors[gap as usize].into_iter().filter(|&t| t != NONE) {
                let other = self.neighbors[t as usize].iter_mut().find(|other| **other == gap);
                other.into_iter().for_each(|other| *other = NONE);
            }
        }
        // Of what comes after the vertices that were there before some are nowhere, and nobody's.
        for v in points_before..self.points.len() {
            numbers.push(next);
            if !self.points[v][0].is_nan() {
                self.points[next as usize] = self.points[v];
                next += 1;
            }
        }
        self.points.truncate(next as usize);
        let (tets, last_tets) = self.tets.split_at_mut(count);
        let (neighbors, last_neighbors) = self.neighbors.split_at_mut(count);
        let (labels, last_labels) = self.labels.split_at_mut(count);
        let chunks = tets
            .par_chunks_mut(RANGE)
            .zip(neighbors.par_chunks_mut(RANGE))
            .zip(labels.par_chunks_mut(RANGE));
        chunks.enumerate().for_each(|(chunk, ((tets, neighbors), labels))| {
            report();
            let first = chunk * RANGE;
            let number_of = |t: usize| gaps.partition_point(|&gap| (gap as usize) < t);
            let own = number_of(first)..number_of(first + tets.len());
            for (&from, &gap) in moved[own.clone()].iter().zip(&gaps[own]) {
                let (from, to) = (from as usize - count, gap as usize - first);
                tets[to] = last_tets[from];
                neighbors[to] = last_neighbors[from];
                labels[to] = last_labels[from];
            }
            for v in tets.iter_mut().flatten().filter(|v| **v as usize >= points_before) {
                *v = numbers[*v as usize - points_before];
            }
            for t in neighbors.iter_mut().flatten() {
                *t = place(*t);
            }
        });
        self.tets.truncate(count);
        self.labels.truncate(count);
        self.neighbors.truncate(count);
        Ok(places)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EMPTY: [u32; 4] = [NONE, 7, 8, 9];
    const NO: u32 = NONE;

    /// Tets in a row: an empty slot that names what was there, one of the background between two of
    /// the object, and behind them two new ones beside each other, and a second empty slot.
    fn mesh() -> TetMesh {
        let mut points: Vec<[f64; 3]> = (0..8).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        // Two new vertices, and one that is nowhere between them.
        points.extend([[8.0, 0.0, 0.0], [f64::NAN; 3], [10.0, 0.0, 0.0]]);
        TetMesh {
            points,
            tets: vec![
                [0, 1, 2, 3],
                EMPTY,
                [1, 2, 3, 4],
                [2, 3, 4, 5],
                [3, 4, 5, 6],
                EMPTY,
                [3, 4, 5, 8],
                [4, 5, 8, 10],
            ],
            labels: vec![5, 0, 0, 5, 0, 0, 6, 7],
            neighbors: vec![
                [2, NO, NO, NO],
                [0, 3, 4, 6],
                [3, NO, NO, 0],
                [4, 6, NO, 2],
                [NO, NO, NO, 3],
                [1, 1, 1, 1],
                [7, NO, NO, 3],
                [NO, NO, NO, 6],
            ],
            ..TetMesh::default()
        }
    }

    #[test]
    fn gaps_are_closed_and_the_background_goes() {
        let mut mesh = mesh();
        // Vertices 6 and 7 belong to the background alone.
        let places = mesh.finish(false, 6, 8, &[0, 3, 6, 7], &Monitor::silent()).unwrap();
        assert_eq!(places, [0, 3, 1, 2]);
        assert_eq!(mesh.tets, [[0, 1, 2, 3], [3, 4, 5, 6], [4, 5, 6, 7], [2, 3, 4, 5]]);
        assert_eq!(mesh.labels, [5, 6, 7, 5]);
        let neighbors = [[NO, NO, NO, NO], [2, NO, NO, 3], [NO, NO, NO, 1], [NO, 1, NO, NO]];
        assert_eq!(mesh.neighbors, neighbors);
        assert_eq!(
            mesh.points.iter().map(|p| p[0]).collect::<Vec<_>>(),
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0]
        );
    }

    #[test]
    fn background_that_is_kept_stays_in_its_place() {
        let mut mesh = mesh();
        let places = mesh.finish(true, 8, 8, &[6, 7], &Monitor::silent()).unwrap();
        assert_eq!(places, [1, 5]);
        assert_eq!(mesh.labels, [5, 6, 0, 5, 0, 7]);
        assert_eq!(mesh.tets[1], [3, 4, 5, 8]);
        assert_eq!(mesh.tets[5], [4, 5, 8, 9]);
        let neighbors = [
            [2, NO, NO, NO],
            [5, NO, NO, 3],
            [3, NO, NO, 0],
            [4, 1, NO, 2],
            [NO, NO, NO, 3],
            [NO, NO, NO, 1],
        ];
        assert_eq!(mesh.neighbors, neighbors);
        assert_eq!(mesh.points.len(), 10);
    }

    #[test]
    fn nothing_may_be_left() {
        for mut mesh in [TetMesh::default(), TetMesh { labels: vec![0; 8], ..mesh() }] {
            let points = mesh.points.len();
            let places = mesh.finish(false, 0, points, &[], &Monitor::silent()).unwrap();
            assert!(places.is_empty() && mesh.tets.is_empty() && mesh.neighbors.is_empty());
            assert!(mesh.labels.is_empty() && mesh.points.is_empty());
        }
    }
}
