//! Extraction, per tet of the whole triangulation, of which six in ten are kept. Points are
//! inserted in random order: slots of neighbours are farther apart than refinement leaves them.
//! Freeing the mesh is not in the figure.

use criterion::{Criterion, Throughput};
use glam::DVec3;
use lapd::Result;
use lapd::delaunay::{Solo, TetId, Triangulation, VertexKind, Worker};
use lapd::mesh::extract::{Background, number};
use lapd::monitor::Monitor;

use crate::Random;

const POINTS: usize = 50_000;

pub fn run(criterion: &mut Criterion) -> Result<()> {
    let triangulation = triangulation()?;
    // Shells of three labels, in a table: a run has them at hand too.
    let radii = [0.15, 0.3, 0.45];
    let mut ids = vec![0_u16; triangulation.tet_bound() as usize];
    let mut tets = 0;
    for t in triangulation.living_tets() {
        let radius = triangulation.tet(t).sphere().center.distance(DVec3::splat(0.5));
        ids[t as usize] = radii.iter().filter(|&&shell| radius < shell).count() as u16;
        tets += 1;
    }
    let order = triangulation.tets_by_place(|| Ok(()))?;
    let mut group = criterion.benchmark_group("mesh");
    group.throughput(Throughput::Elements(tets));
    group.bench_function("extract", |bencher| {
        let label_id = |t: TetId| ids[t as usize];
        let labels = [0, 1, 2, 3];
        bencher.iter_with_large_drop(|| {
            let monitor = Monitor::silent();
            number(&triangulation, &order, label_id, &labels, Background::Dropped, &monitor)
                .and_then(|numbered| numbered.copy(triangulation.tets(), &monitor))
        });
    });
    group.finish();
    Ok(())
}

/// Of points in a ball.
fn triangulation() -> Result<Triangulation> {
    let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE)?;
    let mut worker = Worker::new(Solo, 0);
    let mut random = Random(1);
    let mut start = 0;
    for _ in 0..POINTS {
        let p = DVec3::splat(0.5) + random.direction() * 0.49 * random.unit().cbrt();
        start = triangulation.locate(start, p);
        worker.insert(&triangulation, start, p, VertexKind::Free)?;
        start = worker.created()[0];
    }
    Ok(triangulation)
}
