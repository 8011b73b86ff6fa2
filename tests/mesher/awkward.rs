//! Images and sizes that nobody plans for: the mesher ends, and what it makes is sound.

use std::collections::BTreeMap;

use glam::DVec3;
use lapd::Error;
use lapd::image::phantom::{ball, ball_volume, sampled};
use lapd::image::{Frame, LabelImage, Voxels};
use lapd::monitor::Monitor;
use lapd::params::{Adaptive, MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};

use super::{assert_sound, boundary_topology, mesh, params, run, volumes};

const MODELS: [SurfaceModel; 2] = [SurfaceModel::Smooth, SurfaceModel::Voxel];

/// Meshes under either surface model. `max_unmet` is the part of the facets that may stay unmet.
fn each_model(
    image: &LabelImage,
    params: &MeshParams,
    max_unmet: f64,
    mut check: impl FnMut(&MeshResult, SurfaceModel),
) {
    for surface in MODELS {
        let start = std::time::Instant::now();
        let meshing = run(image, &MeshParams { surface, ..params.clone() });
        let report = &meshing.report;
        println!(
            "{surface:?}: tets {} facets {} unmet {:?} ratio {:.3} angle {:.2} volume error {:.4} \
             {} insertions {} removals in {:.2} s",
            report.quality.tets,
            report.quality.facets,
            report.certificate.unmet,
            report.quality.max_radius_edge,
            report.quality.min_facet_angle,
            report.certificate.mesh_volume() / report.certificate.image_volume() - 1.0,
            report.operations.insertions,
            report.operations.removals,
            start.elapsed().as_secs_f64(),
        );
        assert_sound(&meshing);
        let unmet = report.certificate.unmet.expect("counted by the run");
        let all = unmet.iter().sum::<u64>() as f64;
        assert!(all <= max_unmet * report.quality.facets as f64, "unmet {unmet:?}");
        check(&meshing, surface);
    }
}

fn image_of(dims: [usize; 3], labels: &[u8]) -> LabelImage {
    LabelImage::from_voxels(
        Voxels::U8(labels),
        dims,
        None,
        0,
        Frame::axis_aligned([1.0; 3]).unwrap(),
    )
    .unwrap()
}

/// Numbers that look random.
fn noise(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |n| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    }
}

#[test]
fn empty_image() {
    for dims in [[1, 1, 1], [5, 4, 3]] {
        let image = image_of(dims, &vec![0; dims.iter().product()]);
        let result = mesh_image(&image, &params(1.0), &Monitor::silent());
        assert!(matches!(result, Err(Error::EmptyImage)));
    }
}

#[test]
fn keeping_only_the_background_leaves_an_empty_image() {
    let image = image_of([2, 1, 1], &[0, 5]);
    let result =
        mesh_image(&image, &MeshParams { keep: vec![0], ..params(1.0) }, &Monitor::silent());
    assert!(matches!(result, Err(Error::EmptyImage)));
}

#[test]
fn one_label_fills_the_image() {
    let image = image_of([9, 7, 8], &[3; 9 * 7 * 8]);
    each_model(&image, &params(1.0), 0.0, |meshing, _| {
        let volume = volumes(&meshing.mesh)[&3];
        assert!((volume / (9.0 * 7.0 * 8.0) - 1.0).abs() < 0.06, "volume {volume}");
        assert_eq!(boundary_topology(&meshing.mesh, &[3]), (2, 0));
    });
}

#[test]
fn one_voxel() {
    let alone = image_of([1, 1, 1], &[200]);
    let mut labels = [0; 125];
    labels[62] = 200;
    let surrounded = image_of([5, 5, 5], &labels);
    for image in [alone, surrounded] {
        each_model(&image, &params(0.25), 0.0, |meshing, surface| {
            let volume = volumes(&meshing.mesh)[&200];
            assert_eq!(boundary_topology(&meshing.mesh, &[200]), (2, 0));
            // The smooth model takes the corners off, but for those of the image, which are sharp.
            let range =
                if surface == SurfaceModel::Smooth { 0.15..1.0 + 1e-9 } else { 0.8..1.0 + 1e-9 };
            assert!(range.contains(&volume), "{surface:?}: volume {volume}");
        });
    }
}

#[test]
fn single_slice_row_and_column() {
    for dims in [[10, 8, 1], [1, 10, 8], [10, 1, 8], [12, 1, 1], [1, 1, 12]] {
        let image = image_of(dims, &vec![1; dims.iter().product()]);
        println!("{dims:?}");
        each_model(&image, &params(0.5), 0.0, |meshing, _| {
            let wanted = dims.iter().product::<usize>() as f64;
            let volume = volumes(&meshing.mesh)[&1];
            assert!((0.35..1.01).contains(&(volume / wanted)), "volume {volume} of {wanted}");
            assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
        });
    }
}

#[test]
fn checkerboards() {
    let two = sampled([8, 7, 6], [1.0; 3], |p| {
        (p.x.floor() + p.y.floor() + p.z.floor()).rem_euclid(2.0) as i32
    })
    .unwrap();
    let three = sampled([7; 3], [1.0, 0.5, 2.0], |p| {
        1 + ((p.x + 2.0 * p.y + 0.5 * p.z).round().rem_euclid(2.0)) as i32
    })
    .unwrap();
    for image in [two, three] {
        each_model(&image, &params(0.8), 0.05, |meshing, _| assert!(!meshing.mesh.tets.is_empty()));
    }
}

#[test]
fn random_noise() {
    for seed in 1..4 {
        let mut next = noise(seed);
        let labels: Vec<u8> = (0..12 * 12 * 12).map(|_| next(6) as u8).collect();
        each_model(&image_of([12; 3], &labels), &params(1.0), 0.05, |meshing, _| {
            assert_eq!(volumes(&meshing.mesh).len(), 5);
        });
    }
}

#[test]
fn labels_of_any_sign_and_size() {
    let image = sampled([14; 3], [1.0; 3], |p| match p.length() {
        r if r > 6.0 => 0,
        _ if p.x < 0.0 => i32::MIN,
        _ => i32::MAX,
    });
    let meshing = mesh(&image.unwrap(), &params(1.2));
    assert_eq!(volumes(&meshing.mesh).keys().copied().collect::<Vec<_>>(), [i32::MIN, i32::MAX]);
}

#[test]
fn delta_far_below_a_voxel() {
    let image = ball([6; 3], [1.0; 3], 1.8).unwrap();
    each_model(&image, &params(0.15), 0.0, |meshing, _| {
        let row = meshing.report.certificate.labels[0];
        assert!((row.mesh_volume / row.image_volume - 1.0).abs() < 0.15, "{row:?}");
        assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
    });
}

#[test]
fn delta_far_above_a_voxel() {
    let image = ball([50; 3], [0.5; 3], 10.0).unwrap();
    each_model(&image, &params(5.0), 0.0, |meshing, _| {
        let volume = volumes(&meshing.mesh)[&1];
        assert!((0.6..1.1).contains(&(volume / ball_volume(10.0))), "volume {volume}");
    });
}

#[test]
fn delta_above_the_object() {
    let image = ball([10; 3], [1.0; 3], 3.5).unwrap();
    for delta in [10.0, 1e3, 1e9] {
        println!("delta {delta}");
        // An object that is lost altogether is an error, never an empty mesh.
        match mesh_image(&image, &params(delta), &Monitor::silent()) {
            Ok(meshing) => assert!(!meshing.mesh.tets.is_empty()),
            Err(error) => assert_eq!(
                error.to_string(),
                format!(
                    "delta {delta} is too coarse for the object: no tet has its circumcenter inside"
                )
            ),
        }
    }
}

#[test]
fn size_below_delta() {
    let image = ball([16; 3], [1.0; 3], 6.0).unwrap();
    let sizes = MeshParams { size: 0.7, ..params(2.0) };
    each_model(&image, &sizes, 0.0, |meshing, _| {
        let volume = volumes(&meshing.mesh)[&1];
        assert!((volume / ball_volume(6.0) - 1.0).abs() < 0.08, "volume {volume}");
        assert!(meshing.report.quality.max_circumradius <= 0.7 * super::IMPROVED);
    });
}

/// R6 removes what R5 inserts where samples are far apart for the size of tets: delta gives way.
#[test]
fn what_size_inserts_stays() {
    let image = ball([20; 3], [1.0; 3], 8.0).unwrap();
    let mut last = None;
    for (delta, size) in [(0.35, 0.5), (0.5, 0.5), (2.0, 0.5), (40.0, 0.5), (2.0, 1.0), (2.0, 2.4)]
    {
        let meshing = run(&image, &MeshParams { size, ..params(delta) });
        let (operations, quality) = (&meshing.report.operations, &meshing.report.quality);
        assert!(
            20 * operations.removals < operations.insertions,
            "delta {delta}, size {size}: {} of {} removed",
            operations.removals,
            operations.insertions
        );
        assert!(quality.max_circumradius <= size * super::IMPROVED);
        // With the size given, any larger delta gives the same mesh.
        if let Some((of_size, tets)) = last.replace((size, meshing.mesh.tets))
            && of_size == size
            && delta > 0.5
        {
            assert!(last.as_ref().is_some_and(|(_, now)| *now == tets), "delta {delta}");
        }
    }
}

/// A label with a size of its own is sampled for it, and what is far from it is not.
#[test]
fn what_a_label_size_inserts_stays() {
    let image = two_balls();
    for adaptive in [Adaptive::Thickness, Adaptive::Topology, Adaptive::Off] {
        let plain = run(&image, &MeshParams { adaptive, ..params(2.0) });
        let sizes = BTreeMap::from([(1, 0.6)]);
        let fine = run(&image, &MeshParams { adaptive, label_sizes: sizes, ..params(2.0) });
        let operations = &fine.report.operations;
        assert!(
            20 * operations.removals < operations.insertions,
            "{} of {} removed",
            operations.removals,
            operations.insertions
        );
        let tets = |meshing: &MeshResult, label| {
            meshing.mesh.labels.iter().filter(|&&l| l == label).count()
        };
        assert!(tets(&fine, 1) > 10 * tets(&plain, 1), "{}", tets(&fine, 1));
        assert!(tets(&fine, 2) < 2 * tets(&plain, 2), "{}", tets(&fine, 2));
    }
}

/// Of labels 1 and 2, far apart.
fn two_balls() -> LabelImage {
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    LabelImage::from_fn([40, 14, 14], frame, |p: DVec3| {
        let in_ball = |x: f64| p.distance(DVec3::new(x, 6.5, 6.5)) < 5.0;
        i32::from(in_ball(6.5)) + 2 * i32::from(in_ball(32.5))
    })
    .unwrap()
}
