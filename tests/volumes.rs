//! The smooth model keeps the volume of every label: phantoms, and atlases when they are there.
//!
//! Volumes of the model are measured here on points of their own: jittered, `EDGE`^3 in every cell
//! of several labels.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use lapd::{
    image::{LabelImage, phantom},
    io::read::read_image,
    oracle::Oracle,
    params::SurfaceModel,
};
use rayon::prelude::*;

/// Samples along the edge of a cell.
const EDGE: usize = 6;

fn smooth(image: &LabelImage) -> Oracle {
    Oracle::new(image, SurfaceModel::Smooth, &|| Ok(())).unwrap()
}

/// A number in [0, 1) without order.
fn jitter(seed: usize) -> f64 {
    let h = (seed as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let h = (h ^ h >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    ((h ^ h >> 32) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Volume of each dense id in the model, in voxels. What lies outside the grid is background and
/// not counted, so a label must not be cut by the border.
fn volumes(image: &LabelImage, oracle: &Oracle) -> Vec<f64> {
    let [nx, ny, nz] = image.dims();
    let labels = image.labels().len();
    let samples = EDGE.pow(3);
    let counts = (0..nz - 1)
        .into_par_iter()
        .map(|z| {
            let mut counts = vec![0_u64; labels];
            for (y, x) in (0..ny - 1).flat_map(|y| (0..nx - 1).map(move |x| (y, x))) {
                let first = x + nx * (y + ny * z);
                let corner =
                    |c: usize| image.ids()[first + (c & 1) + nx * ((c >> 1 & 1) + ny * (c >> 2))];
                if (1..8).all(|c| corner(c) == corner(0)) {
                    counts[usize::from(corner(0))] += samples as u64;
                    continue;
                }
                for s in 0..samples {
                    let place = |stride: usize, axis: usize| {
                        ((s / stride % EDGE) as f64 + jitter(3 * (first * samples + s) + axis))
                            / EDGE as f64
                    };
                    let at = DVec3::new(
                        x as f64 + place(1, 0),
                        y as f64 + place(EDGE, 1),
                        z as f64 + place(EDGE * EDGE, 2),
                    );
                    counts[usize::from(oracle.label(image.frame().to_world(at)))] += 1;
                }
            }
            counts
        })
        .reduce(|| vec![0; labels], |a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect());
    counts.iter().map(|&n| n as f64 / samples as f64).collect()
}

/// Relative errors of the volumes of the labels above 0, with their voxels.
fn errors(image: &LabelImage, oracle: &Oracle) -> Vec<(f64, u64)> {
    let targets = image.voxel_counts();
    volumes(image, oracle)
        .iter()
        .zip(targets)
        .skip(1)
        .map(|(&v, n)| (v / n as f64 - 1.0, n))
        .collect()
}

#[test]
fn phantoms_keep_their_volumes() {
    let tube = |radius: f64| {
        move |p: DVec3| i32::from(p.truncate().length() <= radius && p.z.abs() < 14.0)
    };
    let images = [
        ("ball of radius 3", phantom::ball([12; 3], [1.0; 3], 3.0)),
        ("flat voxels", phantom::ball([16, 16, 8], [0.5, 0.5, 1.25], 3.0)),
        ("tube of radius 1.5", phantom::sampled([9, 9, 36], [1.0; 3], tube(1.5))),
        ("tube of radius 2.5", phantom::sampled([9, 9, 36], [1.0; 3], tube(2.5))),
        ("nested shells", phantom::nested_shells([24; 3], [1.0; 3], &[3.0, 5.5, 8.5])),
        ("three labels in a line", phantom::three_labels_in_a_line([24; 3], [1.0; 3], 9.0)),
        ("eight labels at a point", phantom::eight_labels_at_a_point([20; 3], [1.0; 3], 7.0)),
        ("torus", phantom::torus([28, 28, 9], [1.0; 3], 8.0, 2.5)),
    ];
    for (name, image) in images {
        let image = image.unwrap();
        let oracle = smooth(&image);
        for (error, voxels) in errors(&image, &oracle) {
            println!(
                "{name}: {voxels} voxels, {:.3} %, weights {:?}",
                100.0 * error,
                oracle.weights()
            );
            assert!(
                error.abs() < 0.01,
                "{name}: {voxels} voxels, volume off by {:.2} %",
                100.0 * error
            );
        }
    }
}

#[test]
fn weights_are_bounded_and_do_not_depend_on_threads() {
    let noise = phantom::sampled([20; 3], [1.0, 0.7, 1.9], |p| {
        if p.length() > 12.0 {
            0
        } else {
            (jitter((p.x * 31.0 + p.y * 977.0 + p.z * 4099.0) as i64 as usize) * 40.0) as i32
        }
    })
    .unwrap();
    let single = phantom::ball([5; 3], [1.0; 3], 0.5).unwrap();
    for image in [noise, single] {
        let weights = [1, 2, 7].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| smooth(&image).weights().to_vec())
        });
        assert!(weights[0] == weights[1] && weights[0] == weights[2]);
        assert_eq!(weights[0].len(), image.labels().len());
        assert_eq!(weights[0][0], 1.0);
        assert!(weights[0].iter().all(|w| (0.6666..=1.5001).contains(w)), "{:?}", weights[0]);
        assert!(Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap().weights().is_empty());
    }
}

#[test]
fn atlases_keep_their_volumes() {
    let folder = std::env::var_os("LAPD_IMAGES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"),
        PathBuf::from,
    );
    let paths = [
        folder.join("spl/abdomen.nrrd"),
        folder.join("spl/brain.nrrd"),
        PathBuf::from("/usr/share/mricron/templates/aal.nii.gz"),
    ];
    for path in paths {
        let name = path.display();
        if !path.is_file() {
            eprintln!("SKIPPED: atlases_keep_their_volumes: no file {name}");
            continue;
        }
        let image = read_image(&path).unwrap_or_else(|e| panic!("{e}")).image;
        let start = Instant::now();
        Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
        let voxel = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let oracle = smooth(&image);
        println!(
            "{name}: oracle in {:.2} s, the voxel model's in {voxel:.2} s",
            start.elapsed().as_secs_f64()
        );
        let mut sorted = oracle.weights().to_vec();
        sorted.sort_by(f32::total_cmp);
        println!(
            "weights: {:?}",
            [0, 5, 25, 50, 75, 95, 100].map(|p| (p, sorted[(sorted.len() - 1) * p / 100]))
        );
        let mut errors = errors(&image, &oracle);
        errors.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        println!("worst, of any size: {:?}", &errors[..8.min(errors.len())]);
        errors.retain(|e| e.1 >= 1000);
        println!("worst from 1000 voxels on: {:?}", &errors[..8.min(errors.len())]);
        // A label cut by the border of the image loses half a voxel here.
        assert!(errors.iter().all(|e| e.0.abs() < 0.003), "{name}");
    }
}
