//! Meshes of second order: nodes in the middles of edges, on the interfaces where asked for, in
//! tets that stay valid.

use std::collections::HashMap;

use glam::DVec3;
use lapd::Error;
use lapd::image::phantom::*;
use lapd::image::{Frame, GrayImage, LabelImage};
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::oracle::Oracle;
use lapd::params::{Adaptive, MeshParams};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::second_order::TET_EDGES;

fn params(delta: f64, curved: bool) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, order: 2, curved, ..MeshParams::default() }
}

fn run(image: &LabelImage, params: &MeshParams) -> MeshResult {
    mesh_image(image, params, &Monitor::silent()).unwrap()
}

fn subjects() -> Vec<(&'static str, LabelImage, f64)> {
    let walls = sampled([16, 18, 14], [0.8, 1.0, 1.3], |p| {
        1 + i32::from(p.x + 0.3 * p.y > 6.0) + 2 * i32::from(p.z > 9.0 + 0.2 * p.x)
    });
    vec![
        ("ball", ball([26; 3], [1.0; 3], 10.0).unwrap(), 2.0),
        ("torus", torus([28, 28, 12], [1.0; 3], 8.0, 3.0).unwrap(), 1.5),
        ("eight labels", eight_labels_at_a_point([24; 3], [1.0; 3], 10.0).unwrap(), 1.5),
        ("walls", walls.unwrap(), 1.5),
        ("cubes", cubes(3, 4, |[i, j, k]| ((i + 2 * j + 3 * k) % 3) as i32).unwrap(), 1.5),
    ]
}

/// The determinant of the Jacobian of a tet at a place, by the derivatives of its shape functions.
fn determinant(mesh: &TetMesh, t: usize, at: [f64; 4]) -> f64 {
    let gradients = [DVec3::NEG_ONE, DVec3::X, DVec3::Y, DVec3::Z];
    let nodes = mesh.tet_nodes(t).map(|v| mesh.point(v));
    let mut rows = [DVec3::ZERO; 3];
    let mut add = |gradient: DVec3, point: DVec3| {
        (0..3).for_each(|axis| rows[axis] += gradient[axis] * point)
    };
    (0..4).for_each(|i| add((4.0 * at[i] - 1.0) * gradients[i], nodes[i]));
    for (e, [i, j]) in TET_EDGES.into_iter().enumerate() {
        add(4.0 * (at[j] * gradients[i] + at[i] * gradients[j]), nodes[4 + e]);
    }
    rows[0].cross(rows[1]).dot(rows[2])
}

/// CoreMap all over a tet, its vertices and edges among them.
fn places() -> Vec<[f64; 4]> {
    const PARTS: usize = 4;
    let mut places = Vec::new();
    for a in 0..=PARTS {
        for b in 0..=PARTS - a {
            for c in 0..=PARTS - a - b {
                places.push([a, b, c, PARTS - a - b - c].map(|x| x as f64 / PARTS as f64));
            }
        }
    }
    places
}

#[test]
fn tets_of_second_order_are_valid_and_fit_together() {
    for (name, image, delta) in subjects() {
        for curved in [false, true] {
            let MeshResult { mesh, report, .. } = run(&image, &params(delta, curved));
            let nodes = mesh.mid_nodes.as_ref().unwrap();
            assert_eq!(
                mesh.points.len(),
                nodes.vertices + report.second_order.nodes as usize,
                "{name}"
            );
            let mut of_edge: HashMap<[u32; 2], u32> = HashMap::new();
            let mut min = f64::INFINITY;
            for t in 0..mesh.tets.len() {
                let corners = mesh.tets[t];
                for ([i, j], node) in TET_EDGES.into_iter().zip(nodes.tets[t]) {
                    let edge = [corners[i].min(corners[j]), corners[i].max(corners[j])];
                    assert_eq!(
                        *of_edge.entry(edge).or_insert(node),
                        node,
                        "{name}: one node for each edge"
                    );
                    let middle = (mesh.point(corners[i]) + mesh.point(corners[j])) * 0.5;
                    let (off, length) = (
                        mesh.point(node).distance(middle),
                        mesh.point(edge[0]).distance(mesh.point(edge[1])),
                    );
                    assert!(off <= if curved { 0.25 * length } else { 0.0 }, "{name}");
                }
                let [a, b, c, d] = corners.map(|v| mesh.point(v));
                let straight = (b - a).cross(c - a).dot(d - a);
                for at in places() {
                    min = min.min(determinant(&mesh, t, at) / straight);
                }
            }
            assert_eq!(of_edge.len() as u64, report.second_order.nodes, "{name}");
            let curving = &report.second_order.curving;
            assert!(min > 0.09, "{name}: {min}");
            assert!(!curved || min >= curving.min_jacobian - 1e-9, "{name}: {min} {curving:?}");
            assert_eq!(curved, curving.curved > 0, "{name}");
            // Half of the nodes at least have room to go all the way.
            assert!(2 * curving.shortened <= curving.curved, "{name}: {curving:?}");
        }
    }
}

/// Where a node went all the way it is on the interface: a step to either side has the two labels.
#[test]
fn nodes_are_on_the_interfaces() {
    for (name, image, delta) in subjects() {
        let MeshResult { mesh, report, .. } = run(&image, &params(delta, true));
        let oracle = Oracle::new(&image, lapd::params::SurfaceModel::Smooth, &|| Ok(())).unwrap();
        let id = |label: i32| image.labels().iter().position(|&l| l == label).unwrap() as u16;
        let nodes = mesh.mid_nodes.as_ref().unwrap();
        let (mut on, mut all) = (0, 0_u32);
        for (f, of_facet) in nodes.facets.iter().enumerate() {
            let [a, b, c] = mesh.facets[f].map(|v| mesh.point(v));
            let normal = (b - a).cross(c - a).normalize();
            let [first, second] = mesh.facet_labels[f].map(id);
            for &node in of_facet {
                let at = mesh.point(node);
                let off = 0.02 * normal;
                all += 1;
                on +=
                    u32::from(oracle.label(at - off) == first && oracle.label(at + off) == second);
            }
        }
        // All but shortened ones and those on lines, beside which other labels may be.
        let shortened = report.second_order.curving.shortened as f64
            / report.second_order.curving.curved as f64;
        let part = f64::from(on) / f64::from(all);
        println!("{name}: {part:.3} on, {shortened:.3} shortened");
        assert!(part >= 1.0 - shortened - 0.2, "{name}: {part}, {shortened}");
    }
}

/// Nodes in walls stay there, exactly.
#[test]
fn walls_stay_flat() {
    let (_, image, delta) = subjects().swap_remove(3);
    let straight = run(&image, &params(delta, false)).mesh;
    let curved = run(&image, &params(delta, true)).mesh;
    let (low, high) = image_box(&image);
    let vertices = curved.vertex_count();
    let mut count = 0;
    for v in vertices..curved.points.len() {
        let (from, to) = (straight.point(v as u32), curved.point(v as u32));
        for axis in 0..3 {
            for wall in [low[axis], high[axis]] {
                if (from[axis] - wall).abs() < 1e-9 {
                    count += 1;
                    assert!((to[axis] - wall).abs() < 1e-9, "{from} went to {to}");
                }
            }
        }
    }
    assert!(count > 1000, "{count}");
}

/// Corners of the image: half a voxel beyond the outermost voxel centres.
fn image_box(image: &LabelImage) -> (DVec3, DVec3) {
    let last = DVec3::from(image.dims().map(|n| n as f64 - 0.5));
    (image.frame().to_world(DVec3::splat(-0.5)), image.frame().to_world(last))
}

/// The volume of a ball converges with the square of delta by straight tets, and by one order
/// faster at least by curved ones.
#[test]
fn the_volume_of_a_ball_converges_faster() {
    // Interpolated between voxels the squared distance is a sum of functions of one coordinate
    // each, so that the volume within is known.
    const RADIUS: f64 = 24.0;
    let n = 56;
    let center = DVec3::splat(f64::from(n - 1) / 2.0) + DVec3::new(0.13, -0.21, 0.08);
    let between = |x: f64| {
        let (low, part) = (x.floor(), x - x.floor());
        let square = |x: f64| x * x;
        move |c: f64| square(low - c) * (1.0 - part) + square(low + 1.0 - c) * part
    };
    let squared =
        |p: DVec3| between(p.x)(center.x) + between(p.y)(center.y) + between(p.z)(center.z);
    let mut voxels = Vec::new();
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let p = DVec3::new(f64::from(i), f64::from(j), f64::from(k));
                voxels.push((RADIUS * RADIUS - (p - center).length_squared()) as f32);
            }
        }
    }
    let frame = Frame::new([0.0; 3], [1.0; 3], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        .unwrap();
    let image =
        GrayImage::new([n as usize; 3], frame, voxels).unwrap().label_image(&[0.0], None).unwrap();
    // By rays from the center in evenly spread directions.
    let rays = 200_000;
    let cubes = (0..rays).map(|i| {
        let z: f64 = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(rays);
        let angle = 2.399_963_229_728_653 * f64::from(i);
        let way =
            DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z);
        let (mut low, mut high) = (RADIUS - 2.0, RADIUS + 2.0);
        for _ in 0..50 {
            let middle = (low + high) * 0.5;
            if squared(center + middle * way) < RADIUS * RADIUS {
                low = middle
            } else {
                high = middle
            }
        }
        low.powi(3)
    });
    let wanted = 4.0 / 3.0 * std::f64::consts::PI * cubes.sum::<f64>() / f64::from(rays);
    let errors: Vec<[f64; 2]> = [12.0, 6.0, 3.0]
        .map(|delta| {
            let MeshResult { report, .. } =
                run(&image, &MeshParams { adaptive: Adaptive::Off, ..params(delta, true) });
            let flat: f64 = report.certificate.labels.iter().map(|row| row.mesh_volume).sum();
            let curved = report.second_order.curving.volume;
            [flat, curved].map(|volume| (volume / wanted - 1.0).abs())
        })
        .to_vec();
    println!("errors of the volume, flat and curved, at delta 12, 6, 3: {errors:?}");
    for pair in errors.windows(2) {
        let [flat, curved] = [0, 1].map(|i| (pair[0][i] / pair[1][i]).log2());
        assert!((1.5..2.5).contains(&flat) && curved >= 3.0, "orders {flat} and {curved}");
    }
}

#[test]
fn any_number_of_threads_numbers_and_curves_alike() {
    let image = eight_labels_at_a_point([24; 3], [1.0; 3], 10.0).unwrap();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&image, &params(1.5, true)).mesh)
    };
    let one = on(1);
    assert!([2, 3].into_iter().all(|threads| on(threads) == one));
}

#[test]
fn bad_asks_are_one_clear_error() {
    let image = ball([12; 3], [1.0; 3], 4.0).unwrap();
    let message = |params: MeshParams| match mesh_image(&image, &params, &Monitor::silent()) {
        Err(Error::InvalidArgument(message)) => message,
        other => panic!("{:?}", other.map(|_| ())),
    };
    assert_eq!(
        message(MeshParams { order: 3, ..params(2.0, false) }),
        "order must be 1 or 2, got 3"
    );
    assert_eq!(
        message(MeshParams { order: 0, ..params(2.0, false) }),
        "order must be 1 or 2, got 0"
    );
    assert_eq!(
        message(MeshParams { order: 1, ..params(2.0, true) }),
        "curved tets need order 2, got 1"
    );
    let folder = tempfile::tempdir().unwrap();
    let mesh = run(&image, &params(2.0, false)).mesh;
    let error =
        lapd::io::write::write_mesh(&mesh, &folder.path().join("a.node")).unwrap_err().to_string();
    assert!(error.contains("order 1 only") && !error.contains('\n'), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
