//! Insertion and removal, for points spread evenly: nanoseconds per vertex. As in refinement,
//! nothing walks: the tet to start from is known.

use criterion::{BatchSize, Criterion, Throughput};
use glam::DVec3;
use lapd::Result;
use lapd::delaunay::{Insertion, Solo, TetId, Triangulation, VertexId, VertexKind, Worker};

use crate::{Random, sort_along_curve};

const POINTS: usize = 20_000;
/// Each of the removed has this many points.
const REMOVED_OF: usize = 4;

pub fn run(criterion: &mut Criterion) -> Result<()> {
    let mut random = Random(1);
    let mut points: Vec<DVec3> = std::iter::repeat_with(|| random.point()).take(POINTS).collect();
    let mut group = criterion.benchmark_group("delaunay");
    for order in ["random", "coherent"] {
        if order == "coherent" {
            sort_along_curve(&mut points, [DVec3::ZERO, DVec3::ONE]);
        }
        // Slots are handed out in the same way each time, so the tets to start from are the same.
        let starts = starts(&points)?;
        let empty = || new().expect("there is memory for a small triangulation");
        let full = || {
            let (triangulation, mut worker) = empty();
            let vertices = insert_all(&triangulation, &mut worker, &points, &starts);
            (triangulation, worker, vertices)
        };
        group.throughput(Throughput::Elements(POINTS as u64));
        group.bench_function(format!("insert/{order}"), |bencher| {
            bencher.iter_batched_ref(
                empty,
                |(triangulation, worker)| insert_all(triangulation, worker, &points, &starts),
                BatchSize::PerIteration,
            );
        });
        group.throughput(Throughput::Elements((POINTS / REMOVED_OF) as u64));
        group.bench_function(format!("remove/{order}"), |bencher| {
            bencher.iter_batched_ref(
                full,
                |(triangulation, worker, vertices)| {
                    for &v in vertices.iter().step_by(REMOVED_OF) {
                        worker.remove(triangulation, v).expect("its link has a triangulation");
                    }
                },
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
    Ok(())
}

fn new() -> Result<(Triangulation, Worker<Solo>)> {
    Ok((Triangulation::new(DVec3::splat(-1.0), DVec3::splat(2.0))?, Worker::new(Solo, 0)))
}

/// For each point the tet that holds it when it is inserted.
fn starts(points: &[DVec3]) -> Result<Vec<TetId>> {
    let (triangulation, mut worker) = new()?;
    let mut last = 0;
    points
        .iter()
        .map(|&p| {
            let start = triangulation.locate(last, p);
            worker.insert(&triangulation, start, p, VertexKind::Free)?;
            last = worker.created()[0];
            Ok(start)
        })
        .collect()
}

fn insert_all(
    triangulation: &Triangulation,
    worker: &mut Worker<Solo>,
    points: &[DVec3],
    starts: &[TetId],
) -> Vec<VertexId> {
    let insert = |(&p, &start)| match worker.insert(triangulation, start, p, VertexKind::Free) {
        Ok(Insertion::Done(v)) => v,
        other => panic!("a point was not inserted: {other:?}"),
    };
    points.iter().zip(starts).map(insert).collect()
}
