//! Elements across layers, against thicknesses that are known without looking for them.

use glam::{DMat3, DVec3};
use lapd::geometry::measures::tet_circumradius;
use lapd::image::phantom::{ball, sampled};
use lapd::image::{Frame, LabelImage};
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::params::{Adaptive, Improve, MeshParams};
use lapd::pipeline::mesh_image;

use super::random::Random;
use super::{mesh, params, run};

/// A layer of label 2 in a block of label 1, across the z axis, as many voxels thick.
fn layer(thickness: usize) -> LabelImage {
    let half = 0.5 * thickness as f64;
    let label = |p: DVec3| match p.abs() {
        p if p.max_element() > 18.0 => 0,
        p if p.z < half => 2,
        _ => 1,
    };
    // The number of layers of voxels has the parity of the thickness.
    sampled([40, 40, 40 + thickness % 2], [1.0; 3], label).unwrap()
}

/// Coarse, but for the layers.
fn across(elements: f64) -> MeshParams {
    MeshParams {
        across: Some(elements),
        adaptive: Adaptive::Off,
        improve: Improve::None,
        ..params(7.0)
    }
}

fn corners(mesh: &TetMesh, t: usize) -> [DVec3; 4] {
    mesh.tets[t].map(|v| mesh.point(v))
}

fn circumcenter([a, b, c, d]: &[DVec3; 4]) -> DVec3 {
    let edges = DMat3::from_cols(b - a, c - a, d - a);
    let halves = [b, c, d].map(|p| 0.5 * p.distance_squared(*a));
    *a + edges.transpose().inverse() * DVec3::from(halves)
}

/// The mean length of the edges of tets of label 2, far from the sides of the block.
fn mean_edge(mesh: &TetMesh) -> f64 {
    let inside = |corners: &[DVec3; 4]| corners.iter().all(|p| p.truncate().length() < 14.0);
    let tets = (0..mesh.tets.len()).filter(|&t| mesh.labels[t] == 2);
    let tets = tets.map(|t| corners(mesh, t)).filter(inside);
    let lengths: Vec<f64> = tets
        .flat_map(|tet| [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|e| (tet, e)))
        .map(|(tet, (i, j))| tet[i].distance(tet[j]))
        .collect();
    lengths.iter().sum::<f64>() / lengths.len() as f64
}

#[test]
fn layers_have_the_elements_asked_for() {
    for thickness in [3, 6, 8] {
        for elements in [1.0, 2.0, 3.0] {
            let wanted = MeshParams { improve: Improve::Full, ..across(elements) };
            let mesh = mesh(&layer(thickness), &wanted).mesh;
            let found = thickness as f64 / mean_edge(&mesh);
            assert!(
                (0.93 * elements..1.4 * elements).contains(&found),
                "{found} of {elements} elements across {thickness} voxels"
            );
        }
    }
}

/// Within a layer no circumradius is above the bound; away from it none is above what the bound has
/// grown to; and it does grow.
#[test]
fn sizes_grow_by_the_gradation() {
    let thickness = 4;
    for gradation in [0.2, 0.4, 1.0] {
        let params = MeshParams { gradation, ..across(2.0) };
        let mesh = run(&layer(thickness), &params).mesh;
        let bound = 0.85 * thickness as f64 / 2.0;
        let mut largest_far_away = 0.0_f64;
        for t in (0..mesh.tets.len()).filter(|&t| mesh.labels[t] != 0) {
            let corners = corners(&mesh, t);
            let (center, radius) = (circumcenter(&corners), tet_circumradius(&corners));
            let away = (center.z.abs() - 0.5 * thickness as f64).max(0.0);
            // Bounds are those of voxels: a voxel's side more.
            let allowed = bound + gradation * if away > 0.0 { away + 1.0 } else { 0.0 };
            assert!(radius <= allowed, "{radius} at {center}, {allowed} allowed");
            if away > 8.0 {
                largest_far_away = largest_far_away.max(radius);
            }
        }
        assert!(largest_far_away > 2.0 * bound, "{gradation}: {largest_far_away}");
    }
}

#[test]
fn no_layer_goes_below_the_least_size() {
    let image = layer(2);
    let least = MeshParams { least_size: 3.0, ..across(4.0) };
    let coarse = run(&image, &least).mesh.tets.len();
    let fine = run(&image, &across(4.0)).mesh.tets.len();
    assert!(fine > 5 * coarse, "{fine} and {coarse} tets");
    // Nor above the largest: the size of the label itself is all that holds then.
    let mut off = MeshParams { least_size: 1e3, ..across(4.0) };
    let with = run(&image, &off).mesh;
    off.across = None;
    assert_eq!(with, run(&image, &off).mesh);
}

/// What is thick is meshed as if nothing had been asked for, bit for bit.
#[test]
fn what_is_thick_stays_as_it_is() {
    let image = ball([32; 3], [1.0; 3], 14.0).unwrap();
    let with = MeshParams { size: 2.0, delta: 1.4, ..across(2.0) };
    let without = MeshParams { across: None, ..with.clone() };
    assert_eq!(run(&image, &with).mesh, run(&image, &without).mesh);
}

/// With all that may stand beside it: other samplings, coarsening, a number of tets.
#[test]
fn elements_across_go_with_everything() {
    let image = layer(3);
    for adaptive in [Adaptive::Off, Adaptive::Thickness, Adaptive::Topology] {
        let params = MeshParams { adaptive, improve: Improve::Full, ..across(2.0) };
        let whole = run(&image, &params).mesh;
        let coarsened = run(&image, &MeshParams { coarsen: Some(15.0), ..params.clone() }).mesh;
        let [found, kept] = [&whole, &coarsened].map(|mesh| 3.0 / mean_edge(mesh));
        assert!(found > 1.8 && kept > 1.3, "{adaptive:?}: {found} elements, coarsened {kept}");
        let target = Random(7).between(2e4, 4e4);
        let many = MeshParams { target_tets: Some(target as u64), ..params };
        let many = mesh_image(&image, &many, &Monitor::silent()).unwrap().mesh;
        let ratio = many.labels.iter().filter(|&&label| label != 0).count() as f64 / target;
        assert!((0.9..=1.1).contains(&ratio), "{adaptive:?}: {ratio}");
    }
}

/// In layers of any thickness and direction there are as many elements as were asked for, or more.
#[test]
fn slanted_layers_have_enough_elements() {
    let normal = DVec3::new(0.3, 0.5, 0.81).normalize();
    for thickness in [2.0, 5.0, 7.0] {
        let label = |p: DVec3| match p.abs().max_element() {
            far if far > 17.0 => 0,
            _ if p.dot(normal).abs() < 0.5 * thickness => 2,
            _ => 1,
        };
        let image = sampled([38; 3], [1.0; 3], label).unwrap();
        let found = thickness / mean_edge(&run(&image, &across(2.0)).mesh);
        assert!((1.8..=5.0).contains(&found), "{found} of 2 elements across {thickness} voxels");
    }
}

/// The size of a label holds beside the bound of its layers, and what a layer wants does not depend
/// on how large others may be, nor on a floor far below it.
#[test]
fn what_a_layer_wants_depends_on_nothing_else() {
    let image = layer(3);
    let tets = |params: &MeshParams| run(&image, params).mesh.labels.len() as f64;
    let usual = tets(&across(2.0));
    for other in [
        MeshParams { size: 1e6, delta: 1e5, ..across(2.0) },
        MeshParams { spacing_floor: 1e-3, ..across(2.0) },
    ] {
        let ratio = tets(&other) / usual;
        assert!((0.6..1.6).contains(&ratio), "{ratio}");
    }
    let mut of_label = across(2.0);
    of_label.label_sizes.insert(2, 0.8);
    let small = run(&image, &of_label).mesh;
    for t in (0..small.tets.len()).filter(|&t| small.labels[t] == 2) {
        assert!(tet_circumradius(&corners(&small, t)) <= 0.8 + 1e-9);
    }
}

/// Numbers at the ends of their ranges, on images with little in them.
#[test]
fn any_numbers_are_taken() {
    let one =
        LabelImage::from_ids([1; 3], Frame::axis_aligned([1.0; 3]).unwrap(), vec![1], vec![0, 1]);
    for image in [one.unwrap(), layer(2)] {
        for (elements, gradation) in [(1.0, 1e-300), (100.0, 1e300), (3.0, 1e-3)] {
            for size in [1e-1, 3.0, 1e300] {
                let params = MeshParams {
                    delta: 0.7 * size,
                    size,
                    gradation,
                    max_vertices: Some(30_000),
                    partial: true,
                    ..across(elements)
                };
                super::assert_sound(&run(&image, &params));
            }
        }
    }
}
