//! Images that know more than labels, and coarse ones whose labels are smoothed: intensities with
//! isovalues, probability maps, sigma. Bodies with a formula.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::DVec3;
use lapd::Error;
use lapd::image::phantom::ball_volume;
use lapd::image::{Frame, GrayImage, LabelImage, ProbabilityImage};
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::params::{MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::verify::certificate::DefectKind;

use super::{boundary_topology, mesh, params, run, volumes};

/// A function of the place, at voxel centres; the origin lies in the middle of the grid, a little
/// beside its centre.
fn sampled(dims: [usize; 3], spacing: [f64; 3], value: impl Fn(DVec3) -> f64) -> (Frame, Vec<f32>) {
    let middle =
        [0, 1, 2].map(|a| -spacing[a] * (0.5 * (dims[a] as f64 - 1.0) + [0.13, -0.27, 0.38][a]));
    let frame =
        Frame::new(middle, spacing, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).unwrap();
    let mut values = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                values.push(value(frame.to_world(DVec3::new(x as f64, y as f64, z as f64))) as f32);
            }
        }
    }
    (frame, values)
}

/// A scan of which a surface is at intensity 100, with a slope of 40 per unit of length and bounded
/// as scanners do.
fn gray(dims: [usize; 3], depth: impl Fn(DVec3) -> f64) -> GrayImage {
    let (frame, values) =
        sampled(dims, [1.0; 3], |p| (100.0 + 40.0 * depth(p)).clamp(-50.0, 400.0));
    GrayImage::new(dims, frame, values).unwrap()
}

/// Largest distance of the vertices between two labels from a surface, of which `distance` tells.
fn farthest(mesh: &TetMesh, sides: [i32; 2], distance: impl Fn(DVec3) -> f64) -> f64 {
    assert!(mesh.facet_labels.contains(&sides), "no facets between {sides:?}");
    let between =
        mesh.facets.iter().zip(&mesh.facet_labels).filter(|&(_, &labels)| labels == sides);
    between.flat_map(|(facet, _)| facet).map(|&v| distance(mesh.point(v)).abs()).fold(0.0, f64::max)
}

fn assert_volume(meshing: &MeshResult, label: i32, expected: f64, tolerance: f64) {
    let error = volumes(&meshing.mesh)[&label] / expected - 1.0;
    println!("volume of label {label}: {:+.3} %", 100.0 * error);
    assert!(error.abs() < tolerance, "volume of label {label} is off by {error}");
}

/// The radius of a ball as interpolation sees it: the interpolant of a function is off by a twelfth
/// of its second derivatives, in the mean, whose sum is 2 / r here.
fn seen(radius: f64) -> f64 {
    radius - 1.0 / (6.0 * radius)
}

#[test]
fn the_ball_of_a_scan_is_exact() {
    let radius = 14.2;
    let image =
        gray([35, 36, 34], |p| radius - p.length()).label_image(&[100.0], Some(&[-4])).unwrap();
    let meshing = mesh(&image, &params(0.7));
    assert_volume(&meshing, -4, ball_volume(radius), 0.005);
    let distance = farthest(&meshing.mesh, [-4, 0], |p| p.length() - radius);
    println!("farthest vertex: {distance:.4} voxels");
    assert!(distance < 0.05, "{distance}");
    assert_eq!(boundary_topology(&meshing.mesh, &[-4]), (2, 0));
}

#[test]
fn two_isovalues_make_a_shell_in_a_shell() {
    let radius = 11.3;
    let scan = gray([29, 30, 28], |p| radius - p.length());
    // At intensity 260 the ball is 4 smaller.
    let image = scan.label_image(&[100.0, 260.0], None).unwrap();
    let meshing = mesh(&image, &params(0.5));
    let [outer, inner] = [radius, radius - 4.0].map(|r| ball_volume(seen(r)));
    assert_volume(&meshing, 1, outer - inner, 0.004);
    assert_volume(&meshing, 2, inner, 0.005);
    assert!(farthest(&meshing.mesh, [1, 0], |p| p.length() - radius) < 0.05);
    assert!(farthest(&meshing.mesh, [1, 2], |p| p.length() - radius + 4.0) < 0.05);
    assert_eq!(boundary_topology(&meshing.mesh, &[2]), (2, 0));
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (4, 0));
    // The same interval alone, above it background; and both as one label.
    let window = mesh(&scan.label_image(&[100.0, 260.0], Some(&[7, 0])).unwrap(), &params(0.5));
    assert_volume(&window, 7, outer - inner, 0.004);
    let merged = mesh(&image, &MeshParams { merge: BTreeMap::from([(1, 2)]), ..params(0.5) });
    assert_volume(&merged, 2, outer, 0.004);
    let kept = mesh(&image, &MeshParams { keep: vec![2], ..params(0.5) });
    assert_volume(&kept, 2, inner, 0.005);
}

#[test]
fn the_torus_of_a_scan_has_one_hole() {
    let image = gray([32, 32, 14], |p| 4.2 - (p.truncate().length() - 10.0).hypot(p.z))
        .label_image(&[100.0], None)
        .unwrap();
    let meshing = mesh(&image, &params(0.5));
    assert_eq!(boundary_topology(&meshing.mesh, &[1]), (0, 0));
    assert_volume(
        &meshing,
        1,
        2.0 * PI * PI * 10.0 * (4.2_f64 - 1.0 / (12.0 * 4.2)).powi(2),
        0.005,
    );
}

/// Cut by the border of the image: flat walls at the outer faces of the outermost voxels.
#[test]
fn a_scan_ends_at_the_border_of_the_image() {
    let image = gray([12, 12, 24], |p| 5.0 - p.y.hypot(p.x)).label_image(&[100.0], None).unwrap();
    let meshing = mesh(&image, &params(0.5));
    assert_volume(&meshing, 1, 24.0 * PI * (5.0_f64 - 1.0 / 60.0).powi(2), 0.005);
    let ends = [-11.5 - 0.38 - 0.5, 11.5 - 0.38 + 0.5];
    let walls =
        meshing.mesh.facets.iter().map(|facet| facet.map(|v| meshing.mesh.point(v))).filter(
            |corners| {
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
                // Without the rims, which are not followed.
                normal.z.abs() > 0.9 && corners.iter().all(|p| p.x.hypot(p.y) < 4.0)
            },
        );
    let mut facets = [0; 2];
    for corners in walls {
        for p in corners {
            let off = ends.iter().map(|end| (p.z - end).abs()).fold(f64::INFINITY, f64::min);
            assert!(off < 2e-3, "a wall's vertex at {p}");
        }
        facets[usize::from(corners[0].z > 0.0)] += 1;
    }
    // No circumradius is above the size, 1: all within 2 of the axis lies in facets that are looked
    // at, of an area of at most 1.3.
    assert!(facets.iter().all(|&count| count >= 10), "{facets:?} facets of the two walls");
}

fn two_balls(spacing: [f64; 3]) -> ProbabilityImage {
    // Two balls that overlap; where both are likely the nearer centre wins: a plane between them.
    let dims = [40, 26, 26].map(|n: usize| n);
    let dims = [0, 1, 2].map(|a| (dims[a] as f64 / spacing[a]).ceil() as usize);
    let likely = |centre: f64| {
        move |p: DVec3| 1.0 / (1.0 + (p.distance(DVec3::new(centre, 0.0, 0.0)) - 8.3).exp())
    };
    let (left, right) = (likely(-5.0), likely(5.0));
    // Shares of what is not background.
    let (frame, a) = sampled(dims, spacing, |p| left(p) / (1.0 + right(p)));
    let (_, b) = sampled(dims, spacing, |p| right(p) / (1.0 + left(p)));
    ProbabilityImage::new(dims, frame, vec![a, b], &[20, -1]).unwrap()
}

#[test]
fn likely_labels_meet_where_they_are_equally_likely() {
    for spacing in [[1.0; 3], [0.8, 1.0, 1.4]] {
        let image = two_balls(spacing).label_image().unwrap();
        let meshing = mesh(&image, &params(0.5));
        // By symmetry the labels meet in the plane x = 0.
        // Not where the plane ends: there the mesh goes from plane to ball within about delta.
        let distance =
            farthest(&meshing.mesh, [-1, 20], |p| if p.y.hypot(p.z) < 5.2 { p.x } else { 0.0 });
        println!("farthest vertex from the plane: {distance:.4}");
        assert!(distance < 0.08, "{distance}");
        let found = volumes(&meshing.mesh);
        assert!((found[&20] / found[&-1] - 1.0).abs() < 0.01, "{found:?}");
        assert_eq!(boundary_topology(&meshing.mesh, &[20, -1]), (2, 0));
        // As one label the sum of both counts.
        let merged =
            mesh(&image, &MeshParams { merge: BTreeMap::from([(20, 3), (-1, 3)]), ..params(0.5) });
        assert!(volumes(&merged.mesh)[&3] >= 0.99 * (found[&20] + found[&-1]));
    }
}

/// The maps of a ball and of what is around it, of any scale.
#[test]
fn a_map_of_the_background_may_be_given() {
    let dims = [25, 25, 25];
    let (frame, ball) = sampled(dims, [1.0; 3], |p| 255.0 / (1.0 + (p.length() - 9.0).exp()));
    let around = ball.iter().map(|p| 255.0 - p).collect();
    let image = ProbabilityImage::new(dims, frame, vec![around, ball], &[0, 6])
        .unwrap()
        .label_image()
        .unwrap();
    let meshing = mesh(&image, &params(0.5));
    assert_volume(&meshing, 6, ball_volume(seen(9.0)), 0.004);
    assert!(farthest(&meshing.mesh, [6, 0], |p| p.length() - 9.0) < 0.05);
}

#[test]
fn the_same_mesh_whatever_the_threads_of_the_image_passes() {
    let of_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let labels =
                lapd::image::phantom::nested_shells([20; 3], [1.0; 3], &[4.0, 8.5]).unwrap();
            let smoothed = run(&labels, &MeshParams { sigma: 1.0, ..params(1.0) }).mesh;
            [smoothed, run(&two_balls([1.3; 3]).label_image().unwrap(), &params(1.5)).mesh]
        })
    };
    let (one, three) = (of_threads(1), of_threads(3));
    for (a, b) in one.iter().zip(&three) {
        assert!(a.points == b.points && a.tets == b.tets && a.labels == b.labels);
    }
}

fn labelled(dims: [usize; 3], body: impl Fn([usize; 3]) -> bool) -> LabelImage {
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let label = |p: DVec3| i32::from(body(p.to_array().map(|c| c.round() as usize)));
    LabelImage::from_fn(dims, frame, label).unwrap()
}

/// What is thinner than the Gaussian keeps its place, and about the volume that interpolation alone
/// would leave it: of a line of single voxels that is less than half.
#[test]
fn smoothing_loses_nothing_thin_or_small() {
    let sheet =
        labelled([24, 24, 9], |[x, y, z]| z == 4 && (2..22).contains(&x) && (2..22).contains(&y));
    let block = labelled([9, 9, 9], |p| p.iter().all(|c| (3..5).contains(c)));
    let tube = labelled([9, 9, 30], |[x, y, z]| {
        (3..5).contains(&x) && (4..6).contains(&y) && (3..27).contains(&z)
    });
    let line = labelled([9, 9, 24], |[x, y, z]| x == 4 && y == 4 && (3..21).contains(&z));
    for (name, image) in [("sheet", &sheet), ("block", &block), ("tube", &tube), ("line", &line)] {
        for sigma in [0.5, 1.0, 2.0] {
            let meshing = run(image, &MeshParams { sigma, ..params(0.5) });
            let row = &meshing.report.certificate.labels[0];
            let ratio = row.mesh_volume / row.image_volume;
            println!(
                "{name} sigma {sigma}: {} tets, volume {ratio:.3}, Euler {}",
                row.tets, row.euler_mesh
            );
            let defects = &meshing.report.certificate.defects;
            let torn = [DefectKind::Lost, DefectKind::Torn, DefectKind::Merged];
            assert!(
                !defects.iter().any(|defect| torn.contains(&defect.kind)),
                "{name} sigma {sigma}: {defects:?}"
            );
            assert_eq!((row.components_mesh, row.euler_mesh), (1, 2), "{name} sigma {sigma}");
            assert!((0.35..1.4).contains(&ratio), "{name} sigma {sigma}: volume {ratio}");
        }
    }
}

/// The steps of a coarse ball go, and its volume stays within what curvature costs: 3 sigma^2 /
/// radius^2.
#[test]
fn smoothing_takes_the_steps_of_a_coarse_ball() {
    let radius = 9.3;
    let image = lapd::image::phantom::ball([24; 3], [1.0; 3], radius).unwrap();
    let plain = mesh(&image, &params(0.5));
    let smooth = mesh(&image, &MeshParams { sigma: 1.0, ..params(0.5) });
    let mean = |meshing: &MeshResult| {
        let mesh = &meshing.mesh;
        let distances: Vec<f64> =
            mesh.facets.iter().flatten().map(|&v| mesh.point(v).length()).collect();
        let middle = distances.iter().sum::<f64>() / distances.len() as f64;
        (distances.iter().map(|d| (d - middle).powi(2)).sum::<f64>() / distances.len() as f64)
            .sqrt()
    };
    println!("deviation from a sphere: {:.4} plain, {:.4} smoothed", mean(&plain), mean(&smooth));
    assert!(mean(&smooth) < 0.6 * mean(&plain));
    assert_volume(&smooth, 1, ball_volume(radius), 0.055);
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let message = |image: &LabelImage, params: &MeshParams| match mesh_image(
        image,
        params,
        &Monitor::silent(),
    ) {
        Err(Error::InvalidArgument(message)) => message,
        other => panic!("{other:?}"),
    };
    let labels = labelled([4; 3], |_| true);
    let sigma = |sigma: f64| MeshParams { sigma, ..params(1.0) };
    assert_eq!(message(&labels, &sigma(-1.0)), "sigma must lie in 0 to 5 voxels, got -1");
    assert_eq!(message(&labels, &sigma(f64::NAN)), "sigma must lie in 0 to 5 voxels, got NaN");
    let voxel = MeshParams { surface: SurfaceModel::Voxel, ..sigma(1.0) };
    assert_eq!(
        message(&labels, &voxel),
        "sigma 1 smooths interfaces, and the voxel model keeps the faces of voxels"
    );
    let scan = gray([8; 3], |p| 2.0 - p.length()).label_image(&[100.0], None).unwrap();
    assert!(message(&scan, &sigma(0.5)).starts_with("sigma 0.5 smooths label images only"));
    assert!(
        message(&scan, &MeshParams { keep: vec![9], ..params(1.0) })
            .starts_with("label 9 is to be kept")
    );
    let small_components = message(&scan, &MeshParams { min_voxels: 8, ..params(1.0) });
    assert!(
        small_components
            .starts_with("components of fewer than 8 voxels can be left out of label images only"),
        "{small_components}"
    );
}
