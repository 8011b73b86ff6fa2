//! Junctions in meshes: lines where three labels or more meet, points where more do, and the sharp
//! edges where the image cuts the object off.

mod random;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use lapd::geometry::measures::tet_volume;
use lapd::image::Palette;
use lapd::image::phantom::{ball_volume, three_labels_in_a_line};
use lapd::image::{Frame, LabelImage};
use lapd::io::read::read_image;
use lapd::mesh::TetMesh;
use lapd::monitor::Monitor;
use lapd::oracle::{JunctionKind, Oracle};
use lapd::params::{CertificateLevel, ImageBorder, MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};
use random::Random;

/// The edges of a mesh around which three labels or more are, background included.
fn junction_edges(mesh: &TetMesh) -> Vec<[DVec3; 2]> {
    let mut around: BTreeMap<[u32; 2], BTreeSet<i32>> = BTreeMap::new();
    for (facet, labels) in mesh.facets.iter().zip(&mesh.facet_labels) {
        for n in 0..3 {
            let mut edge = [facet[n], facet[(n + 1) % 3]];
            edge.sort_unstable();
            around.entry(edge).or_default().extend(labels);
        }
    }
    let junctions = around.into_iter().filter(|(_, labels)| labels.len() >= 3);
    junctions.map(|(edge, _)| edge.map(|v| mesh.point(v))).collect()
}

/// Points in cells of an edge, for the nearest of them.
struct Cloud {
    cell: f64,
    cells: BTreeMap<[i64; 3], Vec<DVec3>>,
}

impl Cloud {
    fn new(cell: f64, points: impl Iterator<Item = DVec3>) -> Self {
        let mut cells: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
        for p in points {
            cells.entry((p / cell).floor().as_i64vec3().to_array()).or_default().push(p);
        }
        Self { cell, cells }
    }

    /// The distance to the nearest point, up to `max`.
    fn distance(&self, p: DVec3, max: f64) -> f64 {
        let at = (p / self.cell).floor().as_i64vec3().to_array();
        let mut nearest = max;
        for ring in 0.. {
            if (ring - 1) as f64 * self.cell > nearest {
                break;
            }
            let range = |a: usize| at[a] - ring..=at[a] + ring;
            for x in range(0) {
                for y in range(1) {
                    for z in range(2) {
                        let cell = [x, y, z];
                        if (0..3).any(|a| cell[a] == at[a] - ring || cell[a] == at[a] + ring) {
                            for q in self.cells.get(&cell).into_iter().flatten() {
                                nearest = nearest.min(q.distance(p));
                            }
                        }
                    }
                }
            }
        }
        nearest
    }
}

/// The points of the junctions of an oracle, about an eighth of a voxel apart.
fn junction_points(oracle: &Oracle) -> Vec<(JunctionKind, DVec3)> {
    let voxel = oracle.spacing().min_element();
    let planes = oracle.junction_planes(&Palette::uniform(voxel / 8.0));
    let mut points = Vec::new();
    for row in 0..oracle.edge_grid(&Palette::uniform(voxel)).rows() {
        let keep = |kind, p| {
            points.push((kind, p));
            Ok(())
        };
        planes.visit_row(row, keep).unwrap();
    }
    points
}

/// Lines of a cell that mirror each other are cut by one plane in points that do, too, and by the
/// next one again: four points in one plane and on one circle.
#[test]
fn points_of_lines_lie_on_no_common_planes() {
    const N: usize = 8;
    let noise =
        (0..(N * N * N) as u64).map(|at| 1 + (at.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 62) as u16);
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let image = LabelImage::from_ids([N; 3], frame, noise.collect(), (0..5).collect()).unwrap();
    let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
    // At walls lines follow the grid.
    let is_inside =
        |p: &DVec3| p.cmpgt(DVec3::splat(1.0)).all() && p.cmplt(DVec3::splat(N as f64 - 2.0)).all();
    let lines =
        junction_points(&oracle).into_iter().filter(|(kind, _)| *kind == JunctionKind::Line);
    let points: Vec<DVec3> = lines.map(|(_, p)| p).filter(is_inside).collect();
    assert!(points.len() > 500, "{} points", points.len());
    for axis in 0..3 {
        let mut places: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        places.sort_unstable_by(f64::total_cmp);
        let shared = places.array_windows().filter(|[a, b]| b - a < 1e-12).count();
        assert_eq!(shared, 0, "of {} points that share a place on axis {axis}", points.len());
    }
}

/// What moves along lines while a mesh is improved stays where it is unless it is moved, and goes
/// on by little where it is moved by little.
#[test]
fn points_of_lines_are_their_own_nearest_ones() {
    const N: usize = 8;
    const REACH: f64 = 0.3;
    const SHIFT: f64 = 1e-3;
    let mut random = Random(1);
    for frame in frames() {
        let noise = (0..N * N * N).map(|_| random.between(1.0, 5.0) as u16).collect();
        let image = LabelImage::from_ids([N; 3], frame, noise, (0..5).collect()).unwrap();
        let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
        let voxel = oracle.spacing().min_element();
        let nearest = |p: DVec3| oracle.nearest_junction(p, REACH * voxel);
        let mut found = 0;
        for _ in 0..2000 {
            let mut at = || random.between(1.0, N as f64 - 2.0);
            let p = frame.to_world(DVec3::new(at(), at(), at()));
            let Some(on_line) = nearest(p) else { continue };
            found += 1;
            let itself = nearest(on_line).expect("a point of a junction");
            assert!(itself.distance(on_line) < 1e-6 * voxel, "{on_line}, {itself}");
            let mut shift = || SHIFT * voxel * random.between(-1.0, 1.0);
            let by = DVec3::new(shift(), shift(), shift());
            let beside = nearest(on_line + by).expect("a point of a junction");
            assert!(beside.distance(on_line) < 4.0 * by.length(), "{on_line}, {by}, {beside}");
        }
        assert!(found > 100, "{found} points near lines");
    }
}

/// Points along an edge.
fn along([p, q]: [DVec3; 2]) -> impl Iterator<Item = DVec3> {
    (0..=4).map(move |n| p.lerp(q, f64::from(n) / 4.0))
}

fn run(image: &LabelImage, params: &MeshParams) -> MeshResult {
    let meshing = mesh_image(image, params, &Monitor::silent()).unwrap_or_else(|e| panic!("{e}"));
    // Points on both sides of a right edge mirror each other: four of them may lie in one plane and
    // on one circle, but for rounding.
    let [r1, r2, r3, r4, r5, r6] = meshing.report.certificate.unmet.unwrap();
    assert_eq!([r1, r2, r3, r5, r6], [0; 5], "unmet rules");
    assert!(r4 <= 1, "R4 is unmet {r4} times");
    meshing
}

fn params(delta: f64) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() }
}

fn volume(mesh: &TetMesh) -> f64 {
    mesh.tets.iter().map(|tet| tet_volume(&tet.map(|v| mesh.point(v)))).sum()
}

/// Frames of different spacing, one of them with its axes oblique.
fn frames() -> [Frame; 3] {
    let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7).to_cols_array_2d();
    [
        Frame::axis_aligned([1.0; 3]).unwrap(),
        Frame::new(
            [-3.3, 7.7, 0.1],
            [0.7, 0.9, 1.3],
            [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]],
        )
        .unwrap(),
        Frame::new([10.0, -20.0, 5.0], [1.0, 0.8, 0.9], turn).unwrap(),
    ]
}

/// Octants of a box of `n` voxels along each axis, which fill the image; labels 1 to 8, by bits: x,
/// y, z in the upper half.
fn octants(n: usize, frame: Frame) -> LabelImage {
    let ids = (0..n * n * n).map(|at| {
        1 + [at % n, at / n % n, at / n / n]
            .iter()
            .rev()
            .fold(0, |id, &c| 2 * id + u16::from(2 * c >= n))
    });
    LabelImage::from_ids([n; 3], frame, ids.collect(), (0..9).collect()).unwrap()
}

#[test]
fn eight_cubes_meet_at_a_point() {
    const N: usize = 10;
    for frame in frames() {
        let image = octants(N, frame);
        let voxel = frame.spacing().min_element();
        for delta in [1.0, 1.7] {
            let MeshResult { mesh, report, .. } = run(&image, &params(delta * voxel));
            let half = 0.5 * N as f64;
            // From the centre, in voxels.
            let place = |p: DVec3| frame.to_index(p) - (half - 0.5);
            let nearest =
                mesh.points.iter().map(|&p| place(p.into()).length()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.02, "the nearest vertex is {nearest} voxels from the centre");
            let (mut worst, mut inner) = (0.0_f64, 0.0);
            for edge in junction_edges(&mesh) {
                let [p, q] = edge.map(place);
                // Of each line two coordinates are 0 or on a wall, not both on walls.
                for x in along([p, q]) {
                    let mut off = x.abs().min((x.abs() - half).abs()).to_array();
                    off.sort_by(f64::total_cmp);
                    worst = worst.max(off[0].hypot(off[1]));
                }
                if [p, q].iter().all(|x| x.abs().max_element() < half + 1e-6) {
                    let axes = (0..3).filter(|&a| p[a].abs().max(q[a].abs()) < 0.01).count();
                    inner += if axes == 2 { p.distance(q) } else { 0.0 };
                }
            }
            println!(
                "delta {delta}: edges with three labels up to {worst} voxels off lines, {inner} \
                 long along axes; volume off by {:e}",
                volume(&mesh) / (frame.spacing().element_product() * (N * N * N) as f64) - 1.0
            );
            assert!(worst < 0.03, "an edge with three labels is {worst} voxels from all lines");
            assert!(
                (inner - 6.0 * half).abs() < 0.02,
                "mesh edges along the six lines: {inner} voxels"
            );
            for row in &report.certificate.labels {
                assert_eq!(
                    (row.components_image, row.components_mesh),
                    (1, 1),
                    "parts of label {}",
                    row.label
                );
                assert_eq!(row.euler_mesh, 2, "Euler characteristic of label {}", row.label);
            }
        }
    }
}

#[test]
fn sectors_meet_in_a_chain_of_edges() {
    let image = three_labels_in_a_line([26; 3], [1.0; 3], 10.0).unwrap();
    let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
    let cloud = Cloud::new(1.0, junction_points(&oracle).into_iter().map(|(_, p)| p));
    for delta in [1.0, 2.0] {
        let MeshResult { mesh, .. } = run(&image, &params(delta));
        let mut off: Vec<f64> = junction_edges(&mesh)
            .into_iter()
            .flat_map(along)
            .map(|p| cloud.distance(p, 10.0) / delta)
            .collect();
        off.sort_by(f64::total_cmp);
        let (max, worst) = (off[off.len() * 19 / 20], off[off.len() - 1]);
        println!(
            "delta {delta}: edges with three labels up to {max} deltas off lines, the worst \
             {worst}"
        );
        assert!(max < 0.2 && worst < 0.55, "{max} deltas off lines, the worst {worst}");
    }
}

/// The mesh of a box that fills its image.
fn assert_box(dims: [usize; 3], frame: Frame, params: &MeshParams) {
    let image =
        LabelImage::from_ids(dims, frame, vec![1; dims.iter().product()], vec![0, 7]).unwrap();
    let MeshResult { mesh, report, .. } = run(&image, params);
    let size = DVec3::from(dims.map(|n| n as f64));
    let place = |v: u32| frame.to_index(mesh.point(v)) + 0.5;
    let on_walls =
        |x: DVec3| (0..3).filter(|&a| x[a].abs() < 1e-9 || (x[a] - size[a]).abs() < 1e-9).count();
    // Mesh edges along the edges of the box, each beside two facets.
    let mut edges = BTreeMap::new();
    let mut corners = BTreeSet::new();
    for facet in &mesh.facets {
        let at = facet.map(place);
        let flat = (0..3).any(|a| {
            at.iter().all(|x| x[a].abs() < 1e-9) || at.iter().all(|x| (x[a] - size[a]).abs() < 1e-9)
        });
        assert!(flat, "a facet is on no wall: {at:?}");
        for n in 0..3 {
            let (p, q) = (at[n], at[(n + 1) % 3]);
            if on_walls(p) == 3 {
                corners.insert(facet[n]);
            }
            let common = |a: usize| {
                (p[a] - q[a]).abs() < 1e-9 && (p[a].abs() < 1e-9 || (p[a] - size[a]).abs() < 1e-9)
            };
            if (0..3).filter(|&a| common(a)).count() == 2 {
                let mut edge = [facet[n], facet[(n + 1) % 3]];
                edge.sort_unstable();
                edges.insert(edge, p.distance(q));
            }
        }
    }
    assert_eq!(corners.len(), 8, "corners of the box");
    let total: f64 = edges.values().sum();
    assert!(
        (total / (4.0 * size.element_sum()) - 1.0).abs() < 1e-9,
        "{total} voxels of {size} along edges"
    );
    let exact = frame.spacing().element_product() * size.element_product();
    assert!((volume(&mesh) / exact - 1.0).abs() < 1e-9, "volume {} of {exact}", volume(&mesh));
    assert_eq!(report.certificate.labels[0].euler_mesh, 2);
}

#[test]
fn a_box_that_fills_the_image_is_a_box() {
    for frame in frames() {
        for delta in [0.5, 1.0, 1.6, 2.5] {
            for surface in [SurfaceModel::Smooth, SurfaceModel::Voxel] {
                assert_box([7, 5, 6], frame, &MeshParams { surface, ..params(delta) });
            }
        }
    }
}

/// A ball about the middle of the image's lower x wall.
fn cut_ball(radius: f64, frame: Frame) -> LabelImage {
    let n = 2 * radius as usize + 5;
    let dims = [radius as usize + 4, n, n];
    let middle = DVec3::new(-0.5, 0.5 * (n - 1) as f64, 0.5 * (n - 1) as f64);
    let ids = (0..dims.iter().product()).map(|at| {
        let index = [at % dims[0], at / dims[0] % n, at / dims[0] / n].map(|c| c as f64);
        u16::from(DVec3::from(index).distance(middle) <= radius)
    });
    LabelImage::from_ids(dims, frame, ids.collect(), vec![0, 1]).unwrap()
}

#[test]
fn a_cut_ball_has_a_flat_wall_with_a_sharp_rim() {
    const RADIUS: f64 = 9.0;
    for frame in [
        frames()[0],
        Frame::new([0.0; 3], [1.0; 3], frames()[2].direction().to_cols_array_2d()).unwrap(),
    ] {
        let image = cut_ball(RADIUS, frame);
        for delta in [1.0, 1.5] {
            let MeshResult { mesh, report, .. } = run(&image, &params(delta));
            let x = |v: u32| frame.to_index(mesh.point(v)).x + 0.5;
            let (mut area, mut tilted) = (0.0, 0.0_f64);
            for facet in &mesh.facets {
                let [a, b, c] = facet.map(|v| frame.to_index(mesh.point(v)));
                let normal = (b - a).cross(c - a);
                // The ball's surface is across to the wall at the rim.
                if normal.x.abs() > 0.9 * normal.length() && facet.iter().all(|&v| x(v) < 1.0) {
                    tilted = facet.iter().map(|&v| x(v).abs()).fold(tilted, f64::max);
                    area += 0.5 * normal.length();
                }
            }
            let disc = std::f64::consts::PI * RADIUS * RADIUS;
            println!(
                "delta {delta}: off by {tilted:e}, wall {area} of {disc}, volume {}",
                volume(&mesh) / (0.5 * ball_volume(RADIUS))
            );
            assert!(tilted < 1e-9, "the wall deviates by {tilted} voxels");
            if frame.direction() == glam::DMat3::IDENTITY {
                assert!(
                    mesh.points.iter().all(|p| p[0] == -0.5 || p[0] > -0.45),
                    "vertices beside the wall"
                );
            }
            assert!(
                (area / disc - 1.0).abs() < 0.03,
                "area of the wall: {area}, of the disc {disc}"
            );
            assert_eq!(report.certificate.labels[0].euler_mesh, 2);
        }
    }
}

#[test]
fn a_smooth_border_rounds_the_box() {
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let image = LabelImage::from_ids([8; 3], frame, vec![1; 512], vec![0, 1]).unwrap();
    let smooth = MeshParams { border: ImageBorder::Smooth, ..params(1.0) };
    let MeshResult { mesh, report, .. } = run(&image, &smooth);
    let corner = mesh
        .points
        .iter()
        .map(|&p| DVec3::from(p).distance(DVec3::splat(-0.5)))
        .fold(f64::INFINITY, f64::min);
    assert!(corner > 0.2, "a vertex {corner} from the corner");
    assert!((volume(&mesh) / 512.0 - 1.0).abs() < 0.03, "volume {}", volume(&mesh));
    assert_eq!(report.certificate.labels[0].euler_mesh, 2);
    assert_eq!(report.certificate.open_edges, 0);
}

#[test]
#[ignore = "a minute or more for each: the figures of docs/notes/design-notes.md"]
fn figures_of_the_atlases() {
    let images = std::env::var_os("LAPD_IMAGES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"),
        PathBuf::from,
    );
    let paths = [
        images.join("spl/brain.nrrd"),
        images.join("spl/abdomen.nrrd"),
        PathBuf::from("/usr/share/mricron/templates/aal.nii.gz"),
    ];
    let only = std::env::var("ONLY").unwrap_or_default();
    for path in paths.iter().filter(|path| path.to_string_lossy().contains(&only)) {
        if !path.is_file() {
            eprintln!("SKIPPED: no atlas {}", path.display());
            continue;
        }
        let image = read_image(path).unwrap().image;
        let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
        let voxel = oracle.spacing().min_element();
        let points: Vec<DVec3> = junction_points(&oracle).into_iter().map(|(_, p)| p).collect();
        let cloud = Cloud::new(voxel, points.iter().copied());
        for voxels in [1.0, 2.0] {
            let delta = voxels * voxel;
            let certificate = CertificateLevel::Full;
            let params =
                MeshParams { delta, size: 2.0 * delta, certificate, ..MeshParams::default() };
            let MeshResult { mesh, report, .. } =
                mesh_image(&image, &params, &Monitor::silent()).unwrap();
            let edges = junction_edges(&mesh);
            let mut far: Vec<f64> = edges
                .iter()
                .flat_map(|&edge| along(edge))
                .map(|p| cloud.distance(p, 10.0 * voxel) / voxel)
                .collect();
            far.sort_by(f64::total_cmp);
            let mean = far.iter().sum::<f64>() / far.len() as f64;
            let quantile = |q: f64| far[(q * (far.len() - 1) as f64) as usize];
            let mesh_cloud = Cloud::new(
                voxel,
                edges
                    .iter()
                    .flat_map(|&[p, q]| (0..=16).map(move |n| p.lerp(q, f64::from(n) / 16.0))),
            );
            let mut back: Vec<f64> = points
                .iter()
                .step_by(7)
                .map(|&p| mesh_cloud.distance(p, 10.0 * voxel) / voxel)
                .collect();
            back.sort_by(f64::total_cmp);
            let back_mean = back.iter().sum::<f64>() / back.len() as f64;
            let off = |p: DVec3| cloud.distance(p, voxel) > 0.06 * voxel;
            let count = |n: usize| {
                edges.iter().filter(|e| e.iter().filter(|&&p| off(p)).count() == n).count()
            };
            println!("edges with 0, 1, 2 ends off lines: {} {} {}", count(0), count(1), count(2));
            let certificate = &report.certificate;
            println!(
                "{} delta {voxels}: {} tets, {} facets, {} junction edges; to lines: mean \
                 {mean:.3} median {:.3} 90% {:.3} 99% {:.3} max {:.3}; from lines: mean \
                 {back_mean:.3} 90% {:.3} 99% {:.3}; unmet {:?} angles {:.2} {:.2} ratio {:.3} \
                 refine {:.2} s defects {} mesh->image {:.3} {:.3}  image->mesh {:.3} {:.3}",
                path.file_name().unwrap().display(),
                mesh.tets.len(),
                mesh.facets.len(),
                edges.len(),
                quantile(0.5),
                quantile(0.9),
                quantile(0.99),
                quantile(1.0),
                back[(0.9 * back.len() as f64) as usize],
                back[(0.99 * back.len() as f64) as usize],
                report.certificate.unmet,
                report.quality.min_facet_angle,
                report.quality.min_dihedral,
                report.quality.max_radius_edge,
                report.seconds.refine,
                certificate.defects.len(),
                certificate.mesh_to_image.unwrap().mean / certificate.voxel,
                certificate.mesh_to_image.unwrap().max / certificate.voxel,
                certificate.image_to_mesh.unwrap().mean / certificate.voxel,
                certificate.image_to_mesh.unwrap().max / certificate.voxel,
            );
        }
    }
}
