//! The feature transform, and the whole oracle, per voxel of the image.

use criterion::{Criterion, Throughput};
use lapd::Result;
use lapd::distance::FeatureTransform;
use lapd::image::LabelImage;
use lapd::oracle::Oracle;
use lapd::params::SurfaceModel;

pub fn run(criterion: &mut Criterion, image: &LabelImage) -> Result<()> {
    let [nx, ny, nz] = image.dims();
    let ids = image.ids();
    // Sites as the oracle has them in number and place: voxels whose next one along an axis has another label.
    let is_site = |at: usize| [1, nx, nx * ny].iter().any(|step| ids.get(at + step).is_some_and(|&id| id != ids[at]));
    let sites: Vec<bool> = (0..ids.len()).map(is_site).collect();
    let spacing = image.frame().spacing().to_array();
    let mut group = criterion.benchmark_group("distance");
    group.throughput(Throughput::Elements((nx * ny * nz) as u64));
    group.bench_function("feature transform", |bencher| {
        let mark = |y: usize, z: usize, row: &mut [bool]| {
            let first = nx * (y + ny * z);
            row.copy_from_slice(&sites[first..first + nx]);
        };
        bencher.iter(|| FeatureTransform::compute([nx, ny, nz], spacing, mark, &|| Ok(())));
    });
    for (name, model) in [("smooth", SurfaceModel::Smooth), ("voxel", SurfaceModel::Voxel)] {
        group.bench_function(format!("oracle/{name}"), |bencher| {
            bencher.iter(|| Oracle::new(image, model, &|| Ok(())));
        });
    }
    group.finish();
    Ok(())
}
