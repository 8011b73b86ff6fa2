//! Where the image cuts the object off the mesh ends in flat walls: random images of all kinds.

mod random;

use std::collections::HashMap;
use std::f64::consts::PI;

use glam::{DMat3, DVec3, EulerRot};
use lapd::image::{Frame, GrayImage, LabelImage, ProbabilityImage};
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::params::{Adaptive, Improve, MeshParams};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::verify::LabelRow;
use random::Random;

impl Random {
    fn direction(&mut self) -> DVec3 {
        loop {
            let v = 2.0 * DVec3::new(self.unit(), self.unit(), self.unit()) - 1.0;
            if (0.1..1.0).contains(&v.length()) {
                return v.normalize();
            }
        }
    }

    fn dims(&mut self) -> [usize; 3] {
        [0; 3].map(|_| self.between(8.0, 18.0) as usize)
    }

    /// A frame of voxels of side 1, its axes turned at random for each third seed.
    fn frame(&mut self, seed: u64) -> Frame {
        let turn = match seed % 3 {
            0 => DMat3::from_euler(EulerRot::XYZ, self.unit(), self.unit(), self.unit()),
            _ => DMat3::IDENTITY,
        };
        Frame::new([3.0, -7.0, 11.0], [1.0; 3], turn.to_cols_array_2d()).unwrap()
    }
}

/// A value for each voxel, by its place.
fn volume<T>(dims: [usize; 3], mut value: impl FnMut(DVec3) -> T) -> Vec<T> {
    let mut all = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            all.extend((0..dims[0]).map(|x| value(DVec3::new(x as f64, y as f64, z as f64))));
        }
    }
    all
}

fn params(delta: f64) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() }
}

/// The outer facets of a mesh, from its tets alone, in voxels.
fn outer_facets(mesh: &TetMesh, frame: &Frame) -> Vec<[DVec3; 3]> {
    let mut facets = HashMap::new();
    for tet in &mesh.tets {
        for i in 0..4 {
            let mut facet: Vec<u32> = (0..4).filter(|&k| k != i).map(|k| tet[k]).collect();
            facet.sort_unstable();
            *facets.entry([facet[0], facet[1], facet[2]]).or_insert(0) += 1;
        }
    }
    let outer = facets.into_iter().filter(|&(_, count)| count == 1);
    outer.map(|(facet, _)| facet.map(|v| frame.to_index(mesh.point(v)))).collect()
}

/// The area of the facets on each of the six walls, lower ones first, and how many facets are on
/// none.
fn walls(mesh: &TetMesh, image: &LabelImage) -> ([f64; 6], usize) {
    let (mut areas, mut off) = ([0.0; 6], 0);
    for [a, b, c] in outer_facets(mesh, image.frame()) {
        let area = 0.5 * (b - a).cross(c - a).length();
        let on = (0..6).find(|&wall| {
            let axis = wall % 3;
            let at = if wall < 3 { -0.5 } else { image.dims()[axis] as f64 - 0.5 };
            [a, b, c].iter().all(|p| (p[axis] - at).abs() < 1e-6)
        });
        match on {
            Some(wall) => areas[wall] += area,
            None => off += 1,
        }
    }
    (areas, off)
}

/// Meshes an image that its object fills: all of the box, and nothing else.
fn fills_its_box(image: &LabelImage, params: &MeshParams, what: &str) -> MeshResult {
    let meshing =
        mesh_image(image, params, &Monitor::silent()).unwrap_or_else(|e| panic!("{what}: {e}"));
    let (areas, off) = walls(&meshing.mesh, image);
    assert_eq!(off, 0, "{what}: outer facets on no wall");
    let dims = image.dims().map(|n| n as f64);
    for wall in 0..6 {
        let whole = dims[(wall + 1) % 3] * dims[(wall + 2) % 3];
        assert!(
            (areas[wall] / whole - 1.0).abs() < 1e-9,
            "{what}: wall {wall} has {} of {whole}",
            areas[wall]
        );
    }
    let certificate = &meshing.report.certificate;
    let part = certificate.mesh_volume() / dims.iter().product::<f64>();
    assert!((part - 1.0).abs() < 1e-9, "{what}: {part} of the volume");
    assert_eq!(certificate.facets_off_walls, 0, "{what}");
    assert_eq!((certificate.inverted_tets, certificate.open_edges), (0, 0), "{what}");
    meshing
}

const DELTAS: [f64; 3] = [0.75, 1.5, 3.0];

/// Facets of interfaces and walls are asked to have angles of 30 degrees. Where an interface meets
/// an edge of the box, at a delta of several voxels, a few have less; the report counts them.
fn most_have_their_angles(meshings: &[MeshResult], max_below: usize) {
    let angle = |meshing: &MeshResult| meshing.report.quality.min_facet_angle;
    let is_below = |meshing: &&MeshResult| angle(meshing) < 30.0 - 1e-9;
    let below = meshings.iter().filter(is_below).count();
    let least = meshings.iter().map(angle).fold(90.0, f64::min);
    println!(
        "{below} of {} meshes have a facet angle below 30, the least is {least}",
        meshings.len()
    );
    assert!(below <= max_below, "{below} meshes have facets with angles below 30");
    for meshing in meshings {
        let counted = meshing.report.improvement.facets_below > 0;
        assert_eq!(counted, is_below(&meshing));
    }
}

#[test]
fn two_labels_fill_their_box() {
    let mut meshings = Vec::new();
    for seed in 0..200 {
        let mut random = Random(seed);
        let (dims, frame, normal) = (random.dims(), random.frame(seed), random.direction());
        let center = 0.5 * DVec3::from(dims.map(|n| n as f64)) + random.between(-2.0, 2.0);
        let ids = volume(dims, |x| u16::from(normal.dot(x - center) > 0.0) + 1);
        let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2]).unwrap();
        let params = params(DELTAS[seed as usize % 3]);
        meshings.push(fills_its_box(&image, &params, &format!("half-spaces {seed}")));
    }
    most_have_their_angles(&meshings, 6);
}

#[test]
fn voronoi_cells_fill_their_box() {
    let mut all = [Vec::new(), Vec::new()];
    for seed in 0..200 {
        let mut random = Random(1000 + seed);
        let (dims, frame) = (random.dims(), random.frame(seed));
        let count = random.between(3.0, 9.0) as usize;
        let size = DVec3::from(dims.map(|n| n as f64));
        let points: Vec<DVec3> = (0..count)
            .map(|_| DVec3::new(random.unit(), random.unit(), random.unit()) * size)
            .collect();
        let nearest = |x: DVec3| {
            (0..count)
                .min_by(|&a, &b| points[a].distance(x).total_cmp(&points[b].distance(x)))
                .unwrap() as u16
        };
        let image = LabelImage::from_ids(
            dims,
            frame,
            volume(dims, |x| nearest(x) + 1),
            (0..=count as i32).collect(),
        );
        let image = image.unwrap();
        for (adaptive, meshings) in [Adaptive::Thickness, Adaptive::Topology].iter().zip(&mut all) {
            // What is counted does not depend on what is done afterwards.
            let improve = [Improve::Full, Improve::None][seed as usize / 3 % 2];
            let params = params(DELTAS[seed as usize % 3]);
            let params = MeshParams { adaptive: *adaptive, improve, ..params };
            meshings.push(fills_its_box(&image, &params, &format!("{adaptive:?}, cells {seed}")));
        }
    }
    // What is thin is sampled densely by the first from the start, and has good facets then.
    let [thickness, topology] = all;
    most_have_their_angles(&thickness, 6);
    most_have_their_angles(&topology, 13);
}

/// Three soft blobs, of which at each point one has the largest part.
#[test]
fn fields_fill_their_box() {
    for seed in 0..30 {
        let mut random = Random(2000 + seed);
        let (dims, frame) = (random.dims(), random.frame(seed));
        let size = DVec3::from(dims.map(|n| n as f64));
        let points: Vec<DVec3> = (0..3)
            .map(|_| DVec3::new(random.unit(), random.unit(), random.unit()) * size)
            .collect();
        let part = |x: DVec3, k: usize| {
            let near = |p: DVec3| (-0.02 * p.distance_squared(x)).exp();
            (near(points[k]) / points.iter().map(|&p| near(p)).sum::<f64>()) as f32
        };
        let maps = (0..3).map(|k| volume(dims, |x| part(x, k))).collect();
        let delta = DELTAS[seed as usize % 3];
        let maps = ProbabilityImage::new(dims, frame, maps, &[1, 2, 3]).unwrap();
        fills_its_box(&maps.label_image().unwrap(), &params(delta), &format!("maps {seed}"));
        let normal = random.direction();
        let scan = volume(dims, |x| 100.0 + normal.dot(x - 0.5 * size) as f32);
        let scan = GrayImage::new(dims, frame, scan).unwrap();
        let image = scan.label_image(&[0.0, 100.0, 102.0], None).unwrap();
        if image.labels().len() == 4 {
            fills_its_box(&image, &params(delta), &format!("scan {seed}"));
        }
        let ids = volume(dims, |x| u16::from(normal.dot(x - 0.5 * size) > 0.0) + 1);
        let labels = LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2]).unwrap();
        let smoothed = MeshParams { sigma: 1.0, ..params(delta) };
        let meshing = mesh_image(&labels, &smoothed, &Monitor::silent()).unwrap();
        assert_eq!(walls(&meshing.mesh, &labels).1, 0, "smoothed {seed}");
    }
}

/// Tubes through two walls, at a slant. The caps are ellipses.
#[test]
fn tubes_have_their_caps() {
    let (mut off, mut filled) = (0, 0);
    for seed in 0..200 {
        let mut random = Random(3000 + seed);
        let axis = seed as usize % 3;
        let mut dims = [28; 3];
        dims[axis] = random.between(8.0, 16.0) as usize;
        let frame = random.frame(seed);
        let radius = random.between(4.5, 7.0);
        let mut way = DVec3::from([
            random.between(-0.3, 0.3),
            random.between(-0.3, 0.3),
            random.between(-0.3, 0.3),
        ]);
        way[axis] = 1.0;
        let way = way.normalize();
        let center = 0.5 * (DVec3::from(dims.map(|n| n as f64)) - 1.0)
            + DVec3::new(random.unit(), random.unit(), random.unit())
            - 0.5;
        let from_axis = |x: DVec3| (x - center).reject_from(way).length();
        let soft = |x: DVec3| (radius - from_axis(x)) as f32;
        let ids = volume(dims, |x| u16::from(from_axis(x) < radius));
        let labels = LabelImage::from_ids(dims, frame, ids.clone(), vec![0, 1]).unwrap();
        let scan = GrayImage::new(dims, frame, volume(dims, soft)).unwrap();
        let map = volume(dims, |x| (0.5 + 0.25 * soft(x)).clamp(0.0, 1.0));
        let maps = ProbabilityImage::new(dims, frame, vec![map], &[1]).unwrap();
        // Of voxels the cap has those of the outermost slice.
        let in_slice = |end: usize| {
            let at = volume(dims, |x| x[axis] as usize);
            ids.iter().zip(at).filter(|&(&id, at)| id == 1 && at == end * (dims[axis] - 1)).count()
                as f64
        };
        let ellipse = PI * radius * radius / way[axis];
        let kinds = [
            ("labels", labels, [in_slice(0), in_slice(1)]),
            ("scan", scan.label_image(&[0.0], None).unwrap(), [ellipse; 2]),
            ("maps", maps.label_image().unwrap(), [ellipse; 2]),
        ];
        for (kind, image, wanted) in kinds {
            // Sampling by topology leaves no nicks to be filled.
            let adaptive = [Adaptive::Thickness, Adaptive::Topology][seed as usize / 3 % 2];
            let params = MeshParams { adaptive, ..params(1.0) };
            let meshing = mesh_image(&image, &params, &Monitor::silent()).unwrap();
            let (areas, _) = walls(&meshing.mesh, &image);
            for (end, wanted) in wanted.into_iter().enumerate() {
                let part = areas[axis + 3 * end] / wanted;
                assert!((part - 1.0).abs() < 0.02, "{kind} {seed}: a cap of {part} of {wanted}");
            }
            off += meshing.report.certificate.facets_off_walls;
            filled += meshing.report.improvement.nicks_filled;
        }
    }
    // At the rim of a cap a tet may have its circumcenter outside of the object.
    println!("{filled} nicks were filled");
    assert!(filled > 0);
    assert_eq!(off, 0, "facets of 600 meshes are off the walls");
}

/// Filling nicks changes no topology: random blobs of four labels, cut by walls on all sides.
#[test]
fn filled_nicks_change_no_topology() {
    let mut filled = 0;
    for seed in 0..120 {
        let mut random = Random(9000 + seed);
        let (dims, frame) = (random.dims(), random.frame(seed));
        let balls: Vec<(DVec3, f64, u16)> = (0..14)
            .map(|n| {
                let [x, y, z] = dims.map(|n| random.between(0.0, n as f64 - 1.0));
                (DVec3::new(x, y, z), random.between(1.5, 5.0), 1 + n % 4)
            })
            .collect();
        let ids = volume(dims, |x| {
            let of = balls.iter().rev().find(|ball| ball.0.distance(x) < ball.1);
            of.map_or(0, |ball| ball.2)
        });
        let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2, 3, 4]).unwrap();
        let run = |improve| {
            // Nothing is mended, which would change topology.
            let params = MeshParams { improve, adaptive: Adaptive::Thickness, ..params(1.3) };
            mesh_image(&image, &params, &Monitor::silent()).unwrap()
        };
        let (before, after) = (run(Improve::Interior), run(Improve::Full));
        filled += after.report.improvement.nicks_filled;
        let topology = |meshing: &MeshResult| {
            let rows = meshing.report.certificate.labels.iter();
            let row = |row: &LabelRow| {
                let non_manifold = (row.non_manifold_edges, row.non_manifold_vertices);
                (row.label, row.components_mesh, row.pieces, row.euler_mesh, non_manifold)
            };
            rows.map(row).collect::<Vec<_>>()
        };
        assert_eq!(topology(&before), topology(&after), "{seed}");
        assert!(
            after.report.certificate.facets_off_walls <= before.report.certificate.facets_off_walls,
            "{seed}"
        );
    }
    println!("{filled} nicks were filled");
    assert!(filled > 0);
}

/// Pits of background in walls and edges of walls, one voxel wide and more, keep their shape at any
/// delta.
#[test]
fn pits_in_walls_change_no_topology() {
    for seed in 0..12 {
        let mut random = Random(28 + seed);
        let parts = [0.03, 0.06, 0.12][seed as usize % 3];
        let depth = 1.0 + (seed % 2) as f64;
        let ids = volume([26, 20, 14], |x| {
            let has_pit = random.unit() < parts;
            // The block ends at three walls of the image. Pits may be in those across y and z.
            let in_block = x.cmplt(DVec3::new(22.0, 17.0, 12.0)).all();
            let at_wall = x.y == 0.0 || x.z < depth;
            u16::from(in_block && !(at_wall && has_pit && x.x > 0.0))
        });
        let frame = Frame::new([0.0; 3], [1.0; 3], DMat3::IDENTITY.to_cols_array_2d()).unwrap();
        let image = LabelImage::from_ids([26, 20, 14], frame, ids, vec![0, 1]).unwrap();
        for delta in [1.0, 2.0, 3.0, 6.0] {
            let meshing = mesh_image(&image, &params(delta), &Monitor::silent()).unwrap();
            let rows = &meshing.report.certificate.labels;
            let row = rows.iter().find(|row| row.label == 1).unwrap();
            let [of_mesh, of_image] =
                [(row.components_mesh, row.euler_mesh), (row.components_image, row.euler_image)];
            assert_eq!(of_mesh, of_image, "{seed} at delta {delta}");
        }
    }
}

/// Clumps of two voxels of four labels and background: as thin as delta or thinner, and cut off by
/// all walls. Sampling by topology samples where the mesh does not reach them.
#[test]
fn clumps_end_on_walls() {
    let (mut off, mut filled) = (0, 0);
    for seed in 0..100 {
        let mut random = Random(17_000 + seed);
        let (dims, frame) = (random.dims(), random.frame(seed));
        let clumps = dims.map(|n| n / 2 + 1);
        let labels = volume(clumps, |_| random.between(0.0, 5.0) as u16);
        let ids = volume(dims, |x| {
            let [i, j, k] = x.to_array().map(|c| c as usize / 2);
            labels[i + clumps[0] * (j + clumps[1] * k)]
        });
        let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2, 3, 4]).unwrap();
        let params =
            MeshParams { adaptive: Adaptive::Topology, ..params(DELTAS[seed as usize % 3]) };
        let meshing = mesh_image(&image, &params, &Monitor::silent()).unwrap();
        off += meshing.report.certificate.facets_off_walls;
        filled += meshing.report.improvement.nicks_filled;
    }
    println!("{filled} nicks were filled, {off} are left");
    assert!(off <= 1, "{off} facets of 100 meshes are off the walls");
}
