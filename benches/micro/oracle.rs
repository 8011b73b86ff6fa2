//! The cost of the oracle per voxel of the image, and of its queries at points near the interfaces,
//! where most circumcenters are: in random order, and coherent, so that neighbours follow each
//! other as refinement makes them. Freeing the oracle is not in the figure.

use std::hint::black_box;

use criterion::{Criterion, Throughput};
use glam::DVec3;
use lapd::Result;
use lapd::image::LabelImage;
use lapd::oracle::Oracle;
use lapd::params::SurfaceModel;

use crate::{Random, sort_along_curve};

const POINTS: usize = 1 << 16;
/// The points' distance bound at most and the segments' length at most, in voxels.
const NEAR: f64 = 2.0;
const LONGEST: f64 = 5.0;

pub fn run(criterion: &mut Criterion, image: &LabelImage) -> Result<()> {
    for (name, model) in [("smooth", SurfaceModel::Smooth), ("voxel", SurfaceModel::Voxel)] {
        let mut group = criterion.benchmark_group("oracle per voxel");
        let [nx, ny, nz] = image.dims();
        group.throughput(Throughput::Elements((nx * ny * nz) as u64));
        group.bench_function(name, |bencher| {
            bencher.iter_with_large_drop(|| Oracle::new(image, model, &|| Ok(())));
        });
        group.finish();

        let oracle = Oracle::new(image, model, &|| Ok(()))?;
        let voxel = oracle.spacing().min_element();
        let mut random = Random(1);
        let mut ends = near_interfaces(&oracle, NEAR * voxel, &mut random);
        let mut group = criterion.benchmark_group(format!("oracle/{name}"));
        group.throughput(Throughput::Elements(POINTS as u64));
        for order in ["random", "coherent"] {
            if order == "coherent" {
                sort_along_curve(&mut ends, oracle.bounds());
            }
            // Segments of about the length of the dual of a facet.
            let segments: Vec<[DVec3; 2]> = ends
                .iter()
                .map(|&p| [p, p + random.direction() * LONGEST * voxel * random.unit()])
                .collect();
            let mut bench = |query: &str, ask: &dyn Fn([DVec3; 2]) -> f64| {
                group.bench_function(format!("{query}/{order}"), |bencher| {
                    bencher.iter(|| {
                        black_box(&segments).iter().map(|&segment| ask(segment)).sum::<f64>()
                    });
                });
            };
            bench("label", &|[p, _]| f64::from(oracle.label(p)));
            bench("distance bound", &|[p, _]| oracle.distance_bound(p));
            bench("first crossing", &|[p, q]| {
                oracle.first_crossing(p, q).map_or(0.0, |crossing| crossing.point.x)
            });
        }
        group.finish();
    }
    Ok(())
}

/// Points from all over the image whose distance bound is below `near`.
fn near_interfaces(oracle: &Oracle, near: f64, random: &mut Random) -> Vec<DVec3> {
    let [lower, upper] = oracle.bounds();
    std::iter::repeat_with(|| lower + (upper - lower) * random.point())
        .filter(|&p| oracle.distance_bound(p) < near)
        .take(POINTS)
        .collect()
}
