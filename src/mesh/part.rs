//! A few tets of a triangulation as a mesh, for what looks at some places of it again and again.
//!
//! Unlike extraction it does not go through all slots. Tets and vertices come in the order of
//! their ids, so the number of each is how many there are before it: bits tell, counted word by
//! word.

use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::{TetId, Triangulation};
use crate::memory::bits::{Bits, Ranks};
use crate::memory::{room, zeroed};
use crate::monitor::Monitor;

/// Tets of one piece of work, between two looks at the cancel flag.
const PIECE: usize = 1 << 12;

/// The mesh of some tets of a triangulation at rest, without its facets; `tets` are in the order of
/// their slots, and `is_in_part` has their bits. Beyond tets that are not in the part there is
/// none.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn part(
    triangulation: &Triangulation,
    tets: &[TetId],
    is_in_part: &Bits,
    label: impl Fn(TetId) -> i32 + Sync,
    monitor: &Monitor<'_>,
) -> Result<TetMesh> {
    const TETS: &str = "tets of a part of the mesh";
    const VERTICES: &str = "vertices of a part of the mesh";
    let in_use = Bits::new(triangulation.vertex_bound() as usize, VERTICES)?;
    tets.par_chunks(PIECE).try_for_each(|tets| {
        monitor.advance(0)?;
        let vertices = tets.iter().flat_map(|&t| triangulation.tet(t).vertices());
        vertices.for_each(|v| in_use.set(v));
        Ok(())
    })?;
    let (tet_ranks, vertex_ranks) = (Ranks::new(is_in_part, TETS)?, Ranks::new(&in_use, VERTICES)?);
    let mut mesh = TetMesh {
        points: room(vertex_ranks.count(), VERTICES)?,
        tets: zeroed(tets.len(), TETS)?,
        neighbors: zeroed(tets.len(), TETS)?,
        labels: zeroed(tets.len(), TETS)?,
        ..TetMesh::default()
    };
    mesh.points.extend(in_use.ones().map(|v| triangulation.position(v).to_array()));
    let columns = mesh.tets.par_chunks_mut(PIECE).zip(mesh.neighbors.par_chunks_mut(PIECE));
    let columns = columns.zip(mesh.labels.par_chunks_mut(PIECE)).zip(tets.par_chunks(PIECE));
    columns.try_for_each(|(((vertices, neighbors), labels), tets)| {
        monitor.advance(0)?;
        for (n, &t) in tets.iter().enumerate() {
            let record = triangulation.tet(t);
            vertices[n] = record.vertices().map(|v| vertex_ranks.of(&in_use, v));
            neighbors[n] = [0, 1, 2, 3].map(|i| {
                let beyond = record.neighbor(i);
                let is_here = !beyond.is_none() && is_in_part.has(beyond.tet());
                if is_here { tet_ranks.of(is_in_part, beyond.tet()) } else { NONE }
            });
            labels[n] = label(t);
        }
        Ok(())
    })?;
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::delaunay::{Insertion, Solo, VertexKind, Worker};

    #[test]
    fn a_part_has_its_tets_and_nothing_beyond() {
        let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut worker = Worker::new(Solo, 0);
        for i in 1..3000 {
            let p =
                (DVec3::new(0.754_877_666, 0.569_840_291, 0.430_159_709) * f64::from(i)).fract();
            let start = triangulation.locate(triangulation.vertex(0).star(), p);
            let inserted = worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
            assert!(matches!(inserted, Insertion::Done(_)));
        }
        let center = |t: TetId| triangulation.tet(t).sphere().center;
        let tets: Vec<TetId> = triangulation.living_tets().filter(|&t| center(t).x < 0.4).collect();
        assert!(tets.len() > PIECE);
        let is_in_part = Bits::new(triangulation.tet_bound() as usize, "tets").unwrap();
        tets.iter().for_each(|&t| is_in_part.set(t));
        let label = |t: TetId| 1 + (t % 3) as i32;
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let monitor = Monitor::silent();
            pool.install(|| part(&triangulation, &tets, &is_in_part, label, &monitor).unwrap())
        };
        let mesh = on(1);
        assert_eq!(mesh, on(3));
        let mut in_use = vec![false; mesh.points.len()];
        for (n, &t) in tets.iter().enumerate() {
            let record = triangulation.tet(t);
            let corners = mesh.tets[n].map(|v| mesh.point(v));
            assert_eq!(corners, triangulation.corners(record.vertices()));
            assert_eq!(mesh.labels[n], label(t));
            mesh.tets[n].iter().for_each(|&v| in_use[v as usize] = true);
            for (i, &beside) in mesh.neighbors[n].iter().enumerate() {
                let beyond = record.neighbor(i);
                let expected =
                    if beyond.is_none() { None } else { tets.binary_search(&beyond.tet()).ok() };
                assert_eq!(beside, expected.map_or(NONE, |at| at as u32));
            }
        }
        assert!(in_use.into_iter().all(|used| used));
        assert_eq!(mesh.tets.len(), tets.len());
    }
}
