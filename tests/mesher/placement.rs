//! Where an image lies in the world, and which parts of it are meshed.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3, EulerRot};
use lapd::Error;
use lapd::image::phantom::*;
use lapd::image::{Frame, LabelImage};
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::params::{Improve, MeshParams};
use lapd::pipeline::mesh_image;

use super::{boundary_topology, bounds, mesh, params, volumes};

/// A ball of radius 10 off the centre of its image, in another frame.
fn placed(origin: [f64; 3], spacing: [f64; 3], axes: [[f64; 3]; 3]) -> (LabelImage, DVec3) {
    let frame = Frame::new(origin, spacing, axes).unwrap();
    let dims = spacing.map(|s| (28.0 / s) as usize);
    let center =
        frame.to_world(DVec3::from(dims.map(|n| 0.5 * n as f64)) - DVec3::new(0.7, 0.3, 1.1));
    (LabelImage::from_fn(dims, frame, |p| i32::from(p.distance(center) <= 10.0)).unwrap(), center)
}

fn centroid(meshing: &lapd::pipeline::MeshResult) -> DVec3 {
    let mesh = &meshing.mesh;
    let sum = mesh.tets.iter().fold((DVec3::ZERO, 0.0), |(moment, volume), tet| {
        let p = tet.map(|v| mesh.point(v));
        let v = lapd::geometry::measures::tet_volume(&p);
        (moment + p.iter().sum::<DVec3>() * (0.25 * v), volume + v)
    });
    sum.0 / sum.1
}

fn assert_ball_at(image: &LabelImage, center: DVec3, delta: f64) {
    let meshing = mesh(image, &params(delta));
    let volume = volumes(&meshing.mesh)[&1];
    let off = centroid(&meshing).distance(center);
    println!(
        "tets {} volume error {:.4} off centre {off:.3}",
        meshing.mesh.tets.len(),
        volume / ball_volume(10.0) - 1.0
    );
    assert!((volume / ball_volume(10.0) - 1.0).abs() < 0.05, "volume {volume}");
    assert!(off < 0.2, "the mesh is {off} off the ball");
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
}

const UNIT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn turned() -> [[f64; 3]; 3] {
    DMat3::from_euler(EulerRot::XYZ, 0.4, -0.9, 2.1).to_cols_array_2d()
}

#[test]
fn anisotropic_spacing() {
    let (image, center) = placed([0.0; 3], [0.6, 1.0, 2.5], UNIT);
    assert_ball_at(&image, center, 1.5);
}

#[test]
fn rotated_direction() {
    let (image, center) = placed([40.0, -7.0, 3.0], [1.0, 0.8, 1.3], turned());
    assert_ball_at(&image, center, 1.5);
}

#[test]
fn reflected_direction_keeps_volumes_positive() {
    for axis in 0..3 {
        let mut axes = turned();
        axes[axis] = axes[axis].map(|c| -c);
        let (image, center) = placed([-5.0, 11.0, 60.0], [1.0, 0.8, 1.3], axes);
        assert!(image.frame().direction().determinant() < 0.0);
        assert_ball_at(&image, center, 2.0);
    }
}

#[test]
fn permuted_axes() {
    let (image, center) =
        placed([0.0; 3], [1.0; 3], [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_ball_at(&image, center, 2.0);
}

#[test]
fn the_mesh_moves_with_the_origin() {
    // Coordinates are rounded otherwise after a shift, which may turn a tie between labels, and
    // with it all that follows: the number of tets of a mesh as small as this one scatters by some
    // 5 % (one standard deviation). So several near places are compared with several far ones.
    let image = three_labels_in_a_line([20; 3], [1.0; 3], 7.0).unwrap();
    let meshes = |shift: DVec3| -> Vec<_> {
        let places = (0..6).map(|n| shift + f64::from(n) * 0.137);
        let frame = image.frame();
        let mesh_at = |place: DVec3| {
            let origin = (frame.origin() + place).to_array();
            let moved = Frame::new(origin, frame.spacing().to_array(), UNIT).unwrap();
            (place, mesh(&image.clone().with_frame(moved), &params(1.5)).mesh)
        };
        places.map(mesh_at).collect()
    };
    let tets = |meshes: &[(DVec3, TetMesh)]| {
        meshes.iter().map(|(_, mesh)| mesh.tets.len()).sum::<usize>() as f64
    };
    let home = meshes(DVec3::ZERO);
    let (volumes_home, [low, high]) = (volumes(&home[0].1), bounds(&home[0].1));
    for shift in [DVec3::new(64.0, -32.0, 128.0), DVec3::splat(1e6)] {
        let away = meshes(shift);
        for (place, mesh) in &away {
            let volumes = volumes(mesh);
            for (label, volume) in &volumes_home {
                let there = volumes[label];
                assert!(
                    (there / volume - 1.0).abs() < 0.03,
                    "volume of label {label}: {volume} and {there}"
                );
            }
            let [low_away, high_away] = bounds(mesh);
            assert!(
                (low_away - low - *place).abs().max_element() < 0.25,
                "{low} moved to {low_away}"
            );
            assert!(
                (high_away - high - *place).abs().max_element() < 0.25,
                "{high} moved to {high_away}"
            );
        }
        let ratio = tets(&away) / tets(&home);
        println!("tets, moved against not: {ratio:.3}");
        assert!((ratio - 1.0).abs() < 0.1, "{ratio} times the tets when moved");
    }
}

#[test]
fn an_object_cut_by_the_border_is_closed_there() {
    // The ball is larger than the image along every axis; it ends half a voxel beyond the outermost
    // voxel centres.
    let image = ball([16, 16, 12], [1.0; 3], 9.5).unwrap();
    let meshing = mesh(&image, &params(1.2));
    let row = meshing.report.certificate.labels[0];
    println!(
        "volume error {:.4} bounds {:?}",
        row.mesh_volume / row.image_volume - 1.0,
        bounds(&meshing.mesh)
    );
    assert!((row.mesh_volume / row.image_volume - 1.0).abs() < 0.05, "{row:?}");
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
    let [low, high] = bounds(&meshing.mesh);
    let half = DVec3::new(8.0, 8.0, 6.0);
    assert!(
        low.cmpge(-half - 1e-6).all() && high.cmple(half + 1e-6).all(),
        "the mesh reaches out of the image: {low} to {high}"
    );
    assert!(
        low.cmple(-half + 1e-6).all() && high.cmpge(half - 1e-6).all(),
        "the mesh ends inside: {low} to {high}"
    );
}

#[test]
fn keep_meshes_some_labels_only() {
    let image = nested_shells([24; 3], [1.0; 3], &[5.0, 9.0]).unwrap();
    let all = mesh(&image, &params(1.5));
    let shell = mesh(&image, &MeshParams { keep: vec![2], ..params(1.5) });
    assert_eq!(volumes(&shell.mesh).keys().copied().collect::<Vec<_>>(), [2]);
    let (a, b) = (volumes(&all.mesh)[&2], volumes(&shell.mesh)[&2]);
    assert!((a / b - 1.0).abs() < 0.02, "volume of the shell: {a} with its core, {b} without");
    // Two spheres.
    assert_eq!(boundary_topology(&shell.mesh, &[2]), (4, 0));
    assert!(shell.mesh.facet_labels.iter().all(|&sides| sides == [2, 0]));
    assert!(shell.report.certificate.labels.iter().all(|row| row.label == 2));
    let missing =
        mesh_image(&image, &MeshParams { keep: vec![2, 7], ..params(1.5) }, &Monitor::silent());
    assert!(matches!(missing, Err(Error::InvalidArgument(m)) if m.contains('7')));
}

#[test]
fn labels_are_merged_and_the_background_is_chosen() {
    let image = nested_shells([24; 3], [1.0; 3], &[4.0, 7.0, 10.0]).unwrap();
    // Labels from the ends of what 32 bits hold come back as they are.
    let (first, last) = (i32::MIN, i32::MAX);
    let merge = BTreeMap::from([(1, first), (2, first), (3, last), (0, 5)]);
    let merged = mesh(
        &image,
        &MeshParams {
            merge: merge.clone(),
            label_sizes: BTreeMap::from([(first, 1.5)]),
            ..params(1.5)
        },
    );
    assert_eq!(volumes(&merged.mesh).keys().copied().collect::<Vec<_>>(), [first, 5, last]);
    let rows: Vec<_> = merged.report.certificate.labels.iter().map(|row| row.label).collect();
    assert_eq!(rows, [first, 5, last]);
    assert_eq!(boundary_topology(&merged.mesh, &[first]), (2, 0));
    assert_eq!(boundary_topology(&merged.mesh, &[last]), (4, 0));

    // The outer shell as background leaves the core; what was around it must not be background as
    // well without being told.
    let inverted = MeshParams {
        merge: BTreeMap::from([(0, 3)]),
        background_label: 3,
        keep: vec![2],
        ..params(1.5)
    };
    let shell = mesh(&image, &inverted);
    assert_eq!(volumes(&shell.mesh).keys().copied().collect::<Vec<_>>(), [2]);
    for (merge, background_label, said) in [
        (BTreeMap::new(), 3, "label 0 occurs beside the background label 3"),
        (BTreeMap::new(), 9, "label 9 is to be the background, but does not occur"),
        (BTreeMap::from([(8, 1)]), 0, "label 8 is to become 1, but does not occur"),
    ] {
        let refused = mesh_image(
            &image,
            &MeshParams { merge, background_label, ..params(1.5) },
            &Monitor::silent(),
        );
        assert!(
            matches!(&refused, Err(Error::InvalidArgument(m)) if m.contains(said)),
            "{refused:?}"
        );
    }
}

#[test]
fn background_fills_the_box() {
    let image = ball([20; 3], [1.0; 3], 7.0).unwrap();
    // As refinement leaves it: improvement goes another way where the background has another place
    // in the arrays.
    let refined = MeshParams { improve: Improve::None, ..params(1.5) };
    let object = mesh(&image, &refined);
    let whole = mesh(&image, &MeshParams { background: true, ..refined });
    assert_eq!(volumes(&object.mesh), volumes(&whole.mesh));
    assert_eq!(whole.mesh.facets.len(), object.mesh.facets.len());
    assert_eq!(whole.mesh.tets.len() as u64, whole.report.all_tets);
    assert_eq!(whole.mesh.points.len() as u64, whole.report.all_vertices);
    assert_eq!(whole.report.quality.tets, object.report.quality.tets);
    // The background closes the mesh to a box.
    let [low, high] = bounds(&whole.mesh);
    let volume: f64 = whole
        .mesh
        .tets
        .iter()
        .map(|t| lapd::geometry::measures::tet_volume(&t.map(|v| whole.mesh.point(v))))
        .sum();
    assert!((volume / (high - low).element_product() - 1.0).abs() < 1e-12);
    assert!(
        low.cmplt(DVec3::splat(-7.5)).all() && high.cmpgt(DVec3::splat(7.5)).all(),
        "{low} to {high}"
    );
}

#[test]
fn labels_have_their_own_sizes() {
    let image = nested_shells([24; 3], [1.0; 3], &[6.0, 10.0]).unwrap();
    let one_size = mesh(&image, &MeshParams { size: 4.0, ..params(1.5) });
    let fine_core = mesh(
        &image,
        &MeshParams { size: 4.0, label_sizes: BTreeMap::from([(1, 0.8)]), ..params(1.5) },
    );
    let tets = |m: &lapd::pipeline::MeshResult, label| {
        m.mesh.labels.iter().filter(|&&l| l == label).count()
    };
    let (coarse, fine) = (tets(&one_size, 1), tets(&fine_core, 1));
    println!("core {coarse} -> {fine}, shell {} -> {}", tets(&one_size, 2), tets(&fine_core, 2));
    assert!(fine > 4 * coarse, "the core has {fine} tets, {coarse} without a size of its own");
    let missing = mesh_image(
        &image,
        &MeshParams { label_sizes: BTreeMap::from([(9, 1.0)]), ..params(1.5) },
        &Monitor::silent(),
    );
    assert!(matches!(missing, Err(Error::InvalidArgument(m)) if m.contains('9')));
}
