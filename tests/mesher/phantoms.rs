//! Analytic bodies: each is meshed at a delta of one or two voxels; volumes, distances and topology
//! must come out.

use lapd::image::LabelImage;
use lapd::image::phantom::*;
use lapd::params::{MeshParams, SurfaceModel};
use lapd::pipeline::MeshResult;

use super::{boundary_topology, mesh, params, volumes};

/// Golden ranges: how far a mesh may be from the body it was sampled from, about a third to a half
/// more than what was measured when they were written.
struct Golden<'a> {
    /// Volume of each label, by the formula.
    volumes: &'a [f64],
    /// Largest relative error of a label's volume.
    volume: f64,
    /// Largest distance from mesh to voxel faces, in voxels.
    mesh_to_image: f64,
    /// Largest distance from voxel faces to mesh, in voxels.
    image_to_mesh: f64,
    /// Least and most tets.
    tets: [u64; 2],
}

/// Meshes and checks against the golden ranges. Every label of a phantom is one component, in the
/// image and in the mesh: voxels and tets that touch in an edge or a vertex are joined.
fn check(image: &LabelImage, params: &MeshParams, golden: &Golden<'_>) -> MeshResult {
    let meshing = mesh(image, params);
    let (certificate, quality) = (&meshing.report.certificate, &meshing.report.quality);
    let found = volumes(&meshing.mesh);
    let errors: Vec<f64> =
        found.values().zip(golden.volumes).map(|(found, wanted)| found / wanted - 1.0).collect();
    let to_image = certificate.mesh_to_image.unwrap().max / certificate.voxel;
    let to_mesh = certificate.image_to_mesh.unwrap().max / certificate.voxel;
    println!(
        "tets {} facets {} volume errors {errors:.4?} distances {to_image:.3} {to_mesh:.3} voxels, \
         means {:.3} {:.3}",
        quality.tets,
        quality.facets,
        certificate.mesh_to_image.unwrap().mean / certificate.voxel,
        certificate.image_to_mesh.unwrap().mean / certificate.voxel,
    );
    let labels: Vec<i32> = (1..=golden.volumes.len() as i32).collect();
    assert_eq!(found.keys().copied().collect::<Vec<_>>(), labels);
    assert!(errors.iter().all(|e| e.abs() < golden.volume), "volume errors {errors:?}");
    assert!(to_image < golden.mesh_to_image, "mesh to image: {to_image} voxels");
    assert!(to_mesh < golden.image_to_mesh, "image to mesh: {to_mesh} voxels");
    assert!((golden.tets[0]..=golden.tets[1]).contains(&quality.tets), "{} tets", quality.tets);
    for row in &certificate.labels {
        assert_eq!(
            (row.components_image, row.components_mesh),
            (1, 1),
            "components of label {}",
            row.label
        );
        assert_eq!(row.euler_mesh, row.euler_image, "Euler characteristic of label {}", row.label);
        assert_eq!(
            (row.components_lost, row.components_merged, row.pieces),
            (0, 0, 0),
            "label {}",
            row.label
        );
        let measured = found[&row.label];
        assert!(
            (row.mesh_volume / measured - 1.0).abs() < 1e-12,
            "the certificate's volume of label {}",
            row.label
        );
    }
    meshing
}

#[test]
fn ball_is_a_sphere() {
    let image = ball([26; 3], [1.0; 3], 10.0).unwrap();
    let golden = Golden {
        volumes: &[ball_volume(10.0)],
        volume: 0.02,
        mesh_to_image: 0.75,
        image_to_mesh: 1.2,
        tets: [1200, 2700],
    };
    let meshing = check(&image, &params(1.5), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
}

#[test]
fn nested_shells_are_spheres() {
    let radii = [4.0, 8.0, 12.0];
    let image = nested_shells([30; 3], [1.0; 3], &radii).unwrap();
    let balls = radii.map(ball_volume);
    let golden = Golden {
        volumes: &[balls[0], balls[1] - balls[0], balls[2] - balls[1]],
        volume: 0.03,
        mesh_to_image: 0.75,
        image_to_mesh: 1.3,
        tets: [3300, 7400],
    };
    let meshing = check(&image, &params(1.5), &golden);
    for union in [&[1][..], &[1, 2], &[1, 2, 3]] {
        assert_eq!(boundary_topology(&meshing.mesh, union), (2, 0), "labels {union:?}");
    }
    assert!(!meshing.mesh.facet_labels.contains(&[1, 3]), "the core touches the outermost shell");
}

#[test]
fn torus_has_a_hole() {
    let image = torus([36, 36, 14], [1.0; 3], 11.0, 4.5).unwrap();
    let golden = Golden {
        volumes: &[torus_volume(11.0, 4.5)],
        volume: 0.075,
        mesh_to_image: 0.75,
        image_to_mesh: 1.2,
        tets: [1400, 3100],
    };
    let meshing = check(&image, &params(1.5), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (0, 0));
}

#[test]
fn three_labels_meet_in_a_line() {
    let image = three_labels_in_a_line([26; 3], [1.0; 3], 10.0).unwrap();
    let golden = Golden {
        volumes: &[ball_volume(10.0) / 3.0; 3],
        volume: 0.03,
        mesh_to_image: 0.75,
        image_to_mesh: 1.45,
        tets: [2200, 4900],
    };
    let meshing = check(&image, &params(1.5), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1, 2, 3]), (2, 0));
    for pair in [[1, 2], [1, 3], [2, 3], [1, 0], [2, 0], [3, 0]] {
        assert!(meshing.mesh.facet_labels.contains(&pair), "no facet between {pair:?}");
    }
}

#[test]
fn four_labels_meet_at_a_point() {
    let image = four_labels_at_a_point([26; 3], [1.0, 1.02, 0.98], 10.0).unwrap();
    let golden = Golden {
        volumes: &[ball_volume(10.0) / 4.0; 4],
        volume: 0.03,
        mesh_to_image: 0.75,
        image_to_mesh: 1.45,
        tets: [2300, 5100],
    };
    let meshing = check(&image, &params(1.5), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1, 2, 3, 4]), (2, 0));
}

#[test]
fn eight_labels_meet_at_a_point() {
    let image = eight_labels_at_a_point([26; 3], [1.0; 3], 10.0).unwrap();
    let golden = Golden {
        volumes: &[ball_volume(10.0) / 8.0; 8],
        volume: 0.03,
        mesh_to_image: 0.75,
        image_to_mesh: 1.2,
        tets: [2450, 5500],
    };
    let meshing = check(&image, &params(1.5), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1, 2, 3, 4, 5, 6, 7, 8]), (2, 0));
}

#[test]
fn thin_sheet_has_no_holes() {
    // Samples closer to each other than the two sides of the sheet are.
    let image = thin_sheet([20, 20, 8], [1.0; 3], 14.0, 2.0).unwrap();
    let golden = Golden {
        volumes: &[14.0 * 14.0 * 2.0],
        volume: 0.075,
        mesh_to_image: 0.5,
        image_to_mesh: 0.9,
        tets: [950, 2150],
    };
    let meshing = check(&image, &params(0.8), &golden);
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (2, 0));
}

#[test]
fn voxel_model_follows_the_voxels() {
    let image = ball([16; 3], [1.0; 3], 5.5).unwrap();
    let golden = Golden {
        volumes: &[ball_volume(5.5)],
        volume: 0.06,
        mesh_to_image: 0.45,
        image_to_mesh: 0.65,
        tets: [2900, 6500],
    };
    check(&image, &MeshParams { surface: SurfaceModel::Voxel, ..params(0.7) }, &golden);
}

#[test]
fn finer_samples_bring_the_mesh_closer() {
    let image = ball([34; 3], [0.75; 3], 10.0).unwrap();
    let error = |delta: f64| {
        (volumes(&mesh(&image, &params(delta)).mesh)[&1] / ball_volume(10.0) - 1.0).abs()
    };
    let (coarse, fine) = (error(3.0), error(1.0));
    println!("volume errors {coarse:.4} {fine:.4}");
    assert!(fine < 0.5 * coarse, "volume errors: {coarse} at delta 3, {fine} at delta 1");
}
