//! What the parts of a run cost: predicates, insertion and removal, the oracle and its queries,
//! extraction. One thread, on phantoms; where an image is needed, LAPD_BENCH_IMAGE names another
//! one.
//!
//! `cargo bench --bench micro` runs all in some two minutes,
//! `cargo bench --bench micro -- oracle/smooth` what has that in its name. Criterion says by how
//! much a figure has changed since the run before. `cargo test --bench micro` tries everything
//! once.

mod delaunay;
mod geometry;
mod mesh;
mod oracle;

use std::path::Path;
use std::time::Duration;

use criterion::Criterion;
use glam::DVec3;
use lapd::Result;
use lapd::image::{LabelImage, phantom};
use lapd::io::read;

fn main() -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("nobody uses rayon yet");
    let mut criterion = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .sample_size(20)
        .configure_from_args();
    let image = image()?;
    geometry::run(&mut criterion);
    delaunay::run(&mut criterion)?;
    oracle::run(&mut criterion, &image)?;
    mesh::run(&mut criterion)?;
    criterion.final_summary();
    Ok(())
}

/// The image to ask about: four labels that meet in a point, in a ball that nearly fills the image.
fn image() -> Result<LabelImage> {
    match std::env::var("LAPD_BENCH_IMAGE") {
        Ok(path) => Ok(read::read_image(Path::new(&path))?.image),
        Err(_) => phantom::four_labels_at_a_point([96; 3], [1.0; 3], 44.0),
    }
}

/// The same numbers on every machine.
struct Random(u64);

impl Random {
    /// From 0 to 1, both excluded.
    fn unit(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// A point of the unit cube.
    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// A point of the unit sphere.
    fn direction(&mut self) -> DVec3 {
        loop {
            let p = 2.0 * self.point() - 1.0;
            if p.length_squared() < 1.0 {
                return p.normalize();
            }
        }
    }
}

/// Sorts points so that neighbours follow each other: along the Morton curve of the box from
/// `lower` to `upper`.
fn sort_along_curve(points: &mut [DVec3], [lower, upper]: [DVec3; 2]) {
    points.sort_by_cached_key(|p| {
        let cell = ((p - lower) / (upper - lower) * f64::from(1 << 20)).as_u64vec3().to_array();
        (0..20).fold(0, |key, bit| {
            (0..3).fold(key, |key, axis| key | (cell[axis] >> bit & 1) << (3 * bit + axis))
        })
    });
}
