//! Slivers go, and nothing else: angles, topology, interfaces, walls, and the same mesh on any
//! number of threads.

mod coarsen;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use glam::DVec3;
use lapd::Error;
use lapd::geometry::predicates::orient;
use lapd::geometry::shape::closest_point;
use lapd::image::phantom::*;
use lapd::image::{Frame, LabelImage};
use lapd::improve::{Cause, Earlier, Improvement, Settings, improve, tolerance};
use lapd::io::read::read_image;
use lapd::mesh::extract::Background;
use lapd::mesh::{NONE, TetMesh};
use lapd::monitor::Monitor;
use lapd::oracle::Oracle;
use lapd::params::{Adaptive, Improve, MeshParams, SurfaceModel};
use lapd::pipeline::refine::{collect, triangulation_around};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::refine::options::RefineOptions;
use lapd::refine::refine;
use lapd::refine::rules::Rules;
use lapd::sizing::Sizing;
use lapd::verify::Certificate;

/// Labels at random, in clumps: contacts, lines and corners everywhere, cut by walls.
fn noise(dims: [usize; 3], spacing: [f64; 3], labels: u64, seed: u64) -> LabelImage {
    sampled(dims, spacing, |p| {
        let cell = (p / 2.1).floor();
        let mut state = seed
            ^ (cell.x as i64 as u64)
            ^ (cell.y as i64 as u64) << 20
            ^ (cell.z as i64 as u64) << 40;
        for _ in 0..3 {
            state = (state ^ state >> 31).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        }
        (state >> 33) as i32 % labels as i32
    })
    .unwrap()
}

fn subjects() -> Vec<(&'static str, LabelImage, f64)> {
    let oblique = {
        let (s, c) = 0.4_f64.sin_cos();
        let frame = Frame::new(
            [3.0, -2.0, 5.0],
            [0.8, 1.0, 1.3],
            [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
        )
        .unwrap();
        LabelImage::from_fn([16, 18, 14], frame, |p: DVec3| {
            1 + i32::from(p.x + 0.3 * p.y > 6.0) + 2 * i32::from(p.z > 13.0 + 0.2 * p.x)
        })
        .unwrap()
    };
    vec![
        ("ball", ball([26; 3], [1.0; 3], 10.0).unwrap(), 1.5),
        ("torus", torus([28, 28, 12], [1.0; 3], 8.0, 3.0).unwrap(), 1.2),
        ("eight labels", eight_labels_at_a_point([24; 3], [1.0; 3], 10.0).unwrap(), 1.0),
        ("shells", nested_shells([32; 3], [1.0, 0.9, 1.1], &[6.0, 13.0]).unwrap(), 1.3),
        ("noise", noise([14, 12, 13], [1.0, 1.2, 0.8], 4, 7), 1.0),
        ("walls", oblique, 1.2),
    ]
}

fn params(delta: f64) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() }
}

/// A refined mesh with the background around it.
struct Refined {
    oracle: Oracle,
    sizing: Sizing,
    labels: Vec<i32>,
    volumes: Vec<f64>,
    mesh: TetMesh,
    box_volume: f64,
}

fn refined(image: &LabelImage, params: &MeshParams) -> Refined {
    let oracle = Oracle::new(image, params.surface, &|| Ok(())).unwrap();
    let triangulation = triangulation_around(&oracle, params.delta).unwrap();
    let sizing = Sizing::uniform(params.delta);
    let rules = Rules::new(&triangulation, &oracle, &sizing, params, image.labels());
    let monitor = Monitor::silent();
    refine(&rules, &RefineOptions::solo(), &monitor).unwrap();
    let mesh = collect(&rules, image.labels(), Background::Last, &monitor).unwrap();
    let corners = [0, 7].map(|v| triangulation.position(v));
    let box_volume = (corners[1] - corners[0]).element_product().abs();
    let of_voxel = image.voxel_volume();
    let volumes = image.voxel_counts().into_iter().map(|voxels| voxels as f64 * of_voxel).collect();
    Refined { oracle, sizing, labels: image.labels().to_vec(), volumes, mesh, box_volume }
}

fn improved(
    refined: &Refined,
    mode: Improve,
    target: f64,
    check_time: &(dyn Fn() -> lapd::Result<()> + Sync),
) -> (TetMesh, Improvement, Option<Error>) {
    improved_within(refined, mode, target, &refined.volumes, check_time)
}

/// The same; labels keep these volumes, if there are any.
fn improved_within(
    refined: &Refined,
    mode: Improve,
    target: f64,
    volumes: &[f64],
    check_time: &(dyn Fn() -> lapd::Result<()> + Sync),
) -> (TetMesh, Improvement, Option<Error>) {
    let mut mesh = refined.mesh.clone();
    let settings = Settings {
        oracle: &refined.oracle,
        labels: &refined.labels,
        volumes,
        sizing: &refined.sizing,
        improve: mode,
        tolerance: tolerance(target) * refined.oracle.spacing().min_element(),
        target,
        radius_edge: 2.0,
        facet_angle: 30.0,
        is_delaunay: true,
        parts: [0.0, 1.0],
        check_time,
    };
    let (improvement, ended) =
        improve(&mut mesh, &settings, Earlier::default(), &Monitor::silent()).unwrap();
    (mesh, improvement, ended)
}

/// Asserts that a mesh that still has its background is what it says: neighbours of each other, all
/// tets positive, together as large as the box. So they cover it once, and no two facets cross.
fn check_cover(mesh: &TetMesh, box_volume: f64, what: &str) {
    let mut volume = 0.0;
    for (t, tet) in mesh.tets.iter().enumerate().filter(|(_, tet)| tet[0] != NONE) {
        let [a, b, c, d] = tet.map(|v| mesh.point(v));
        assert!(orient(a, b, c, d) > 0.0, "{what}: tet {t} is not positive");
        volume += (b - a).cross(c - a).dot(d - a) / 6.0;
        for (i, &n) in mesh.neighbors[t].iter().enumerate().filter(|&(_, &n)| n != NONE) {
            let other = mesh.tets[n as usize];
            assert!(other[0] != NONE, "{what}: tet {t} has a neighbour that is gone");
            assert!(
                (0..4).all(|j| j == i || other.contains(&tet[j])),
                "{what}: tets {t} and {n} share no facet"
            );
            assert!(
                mesh.neighbors[n as usize].contains(&(t as u32)),
                "{what}: tet {n} does not know {t}"
            );
        }
    }
    assert!((volume / box_volume - 1.0).abs() < 1e-9, "{what}: {volume} is not {box_volume}");
}

/// Smallest and largest dihedral angle, by projections along the edges: another formula than the
/// library's.
fn angle_range(p: [DVec3; 4]) -> [f64; 2] {
    let mut range = [180.0_f64, 0.0];
    for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
        let mut others = (0..4).filter(|&k| k != i && k != j);
        let (k, l) = (others.next().unwrap(), others.next().unwrap());
        let axis = (p[j] - p[i]).normalize();
        let across = |q: DVec3| (q - p[i]) - axis * axis.dot(q - p[i]);
        let angle = across(p[k]).angle_between(across(p[l])).to_degrees();
        range = [range[0].min(angle), range[1].max(angle)];
    }
    range
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    for (name, image, delta) in subjects() {
        let refined = refined(&image, &params(delta));
        for (mode, target) in
            [(Improve::Full, 15.0), (Improve::Full, 20.0), (Improve::Interior, 15.0)]
        {
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let (mesh, improvement, ended) = improved(&refined, mode, target, &|| Ok(()));
                    assert!(ended.is_none());
                    let bits: Vec<u64> =
                        mesh.points.iter().flatten().map(|x| x.to_bits()).collect();
                    (bits, mesh.tets, mesh.neighbors, mesh.labels, improvement)
                })
            };
            let one = on(1);
            assert!(one.4.counts.operations() > 0, "{name}: nothing to do");
            for threads in [2, 3, 8] {
                assert!(
                    one == on(threads),
                    "{name}, {mode:?}, {target}: {threads} threads differ from one"
                );
            }
        }
    }
}

#[test]
fn all_tets_are_positive_and_cover_the_box() {
    for (name, image, delta) in subjects() {
        let refined = refined(&image, &params(delta));
        check_cover(&refined.mesh, refined.box_volume, name);
        for mode in [Improve::Full, Improve::Interior] {
            let (mesh, ..) = improved(&refined, mode, 15.0, &|| Ok(()));
            check_cover(&mesh, refined.box_volume, name);
        }
    }
    for seed in 0..12 {
        let image = noise([9, 8, 10], [1.0, 0.7, 1.4], 2 + seed % 4, seed);
        let refined = refined(&image, &params(0.8 + 0.1 * seed as f64));
        let (mesh, ..) =
            improved(&refined, Improve::Full, 10.0 + 2.0 * (seed % 6) as f64, &|| Ok(()));
        check_cover(&mesh, refined.box_volume, &format!("noise {seed}"));
    }
}

/// Tets a fiftieth as high as they are wide cannot have the target: that is given up soon, the same
/// way on any number of threads.
#[test]
fn what_is_hopeless_is_given_up() {
    let image = noise([60, 60, 1], [1.0, 1.0, 0.02], 4, 3);
    let refined = refined(&image, &params(1.0));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| improved(&refined, Improve::Full, 15.0, &|| Ok(())))
    };
    let (mesh, improvement, ended) = on(1);
    println!(
        "{} below, {} left, {} rounds",
        improvement.below_before,
        improvement.left.len(),
        improvement.rounds
    );
    assert!(ended.is_none());
    assert!(
        2 * improvement.left.len() as u64 > improvement.below_before
            && improvement.left.len() > 1000
    );
    assert!(improvement.rounds <= 10, "{} rounds", improvement.rounds);
    check_cover(&mesh, refined.box_volume, "slab");
    let bits = |mesh: &TetMesh| -> (Vec<u64>, Vec<[u32; 4]>) {
        (mesh.points.iter().flatten().map(|x| x.to_bits()).collect(), mesh.tets.clone())
    };
    assert!(bits(&on(3).0) == bits(&mesh));
}

#[test]
fn an_early_end_leaves_a_valid_mesh() {
    let image = noise([14, 12, 13], [1.0, 1.2, 0.8], 4, 3);
    let refined = refined(&image, &params(1.0));
    let (_, complete, _) = improved(&refined, Improve::Full, 20.0, &|| Ok(()));
    let mut reached = 0;
    // Of several threads each may be in another block when the time is over.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for looks in [0, 1, 2, 5, 13, 34, 89, 233] {
        let left = AtomicUsize::new(looks);
        let check_time = || match left.try_update(Relaxed, Relaxed, |left| left.checked_sub(1)) {
            Ok(_) => Ok(()),
            Err(_) => Err(Error::TimeLimit("the time is over".into())),
        };
        let (mesh, improvement, ended) =
            alone.install(|| improved(&refined, Improve::Full, 20.0, &check_time));
        check_cover(&mesh, refined.box_volume, "ended early");
        assert!(
            matches!(ended, Some(Error::TimeLimit(_))) || improvement == complete,
            "{looks}: {ended:?}"
        );
        assert!(improvement.counts.operations() >= reached, "{looks}");
        reached = improvement.counts.operations();
    }
    assert!(reached > 100);
}

/// The mesh of `image` without and with improvement; nothing is mended, which would change its
/// topology.
fn both(image: &LabelImage, params: &MeshParams, mode: Improve) -> [MeshResult; 2] {
    [Improve::None, mode].map(|improve| {
        let params = MeshParams { improve, adaptive: Adaptive::Thickness, ..params.clone() };
        mesh_image(image, &params, &Monitor::silent()).unwrap()
    })
}

/// Asserts what improvement promises of a finished mesh.
fn check_promises(name: &str, [before, after]: &[MeshResult; 2], max_left: usize) {
    let of = |meshing: &MeshResult| {
        let Certificate { labels, inverted_tets, orphan_vertices, open_edges, .. } =
            &meshing.report.certificate;
        assert_eq!([*inverted_tets, *orphan_vertices, *open_edges], [0; 3], "{name}");
        let rows = labels.iter().map(|row| {
            let topology = [
                row.components_mesh,
                row.pieces,
                row.non_manifold_edges,
                row.non_manifold_vertices,
            ];
            (row.label, topology, row.euler_mesh, row.components_lost, row.components_merged)
        });
        rows.collect::<Vec<_>>()
    };
    assert_eq!(of(before), of(after), "{name}: the topology differs");
    let improvement = &after.report.improvement;
    for (a, b) in before.report.certificate.labels.iter().zip(&after.report.certificate.labels) {
        let change = improvement.counts.volume_of(a.label);
        assert!(
            (b.mesh_volume - a.mesh_volume - change).abs() <= 1e-9 * a.mesh_volume,
            "{name}: label {}",
            a.label
        );
        let max = if a.image_voxels >= 1000 { 1e-3 } else { 2e-2 };
        assert!(
            change.abs() <= max * a.mesh_volume,
            "{name}: label {}: {change} of {}",
            a.label,
            a.mesh_volume
        );
    }
    let [volume, volume_after] =
        [before, after].map(|meshing| meshing.report.certificate.mesh_volume());
    assert!(
        (volume_after - volume).abs() <= 1e-4 * volume,
        "{name}: {volume_after} of {volume} in all"
    );
    check_angles(name, &after.mesh, improvement);
    let left = improvement.left.len();
    assert!(left <= max_left, "{name}: {left} tets are left: {:?}", improvement.left);
    assert!(
        after.report.quality.min_facet_angle >= 30.0 - 1e-9,
        "{name}: {}",
        after.report.quality.min_facet_angle
    );
    assert!(after.mesh.tets.len() <= before.mesh.tets.len(), "{name}: more tets than before");
    check_distance(name, before, after);
}

/// Asserts that tets have the angles of the target, but for those that are listed as they are.
fn check_angles(name: &str, mesh: &TetMesh, improvement: &Improvement) {
    let target = improvement.target;
    let left: BTreeMap<u32, _> = improvement.left.iter().map(|left| (left.tet, left)).collect();
    let tets = mesh.tets.iter().enumerate();
    for (t, tet) in tets.filter(|&(t, tet)| tet[0] != NONE && mesh.labels[t] != 0) {
        let p = tet.map(|v| mesh.point(v));
        let [min, largest] = angle_range(p);
        let is_below = min < target - 1e-6 || largest > 180.0 - target + 1e-6;
        match left.get(&(t as u32)) {
            Some(left) => {
                assert!(
                    (left.angles[0] - min).abs() < 1e-4 && (left.angles[1] - largest).abs() < 1e-4,
                    "{name}"
                );
                let centroid = p.iter().sum::<DVec3>() / 4.0;
                assert!(DVec3::from_array(left.position).distance(centroid) < 1e-9, "{name}");
            }
            None => assert!(!is_below, "{name}: tet {t} has angles of {min} to {largest}"),
        }
    }
}

/// Vertices of interfaces must be near where refinement put the interface.
fn check_distance(name: &str, before: &MeshResult, after: &MeshResult) {
    let max = after.report.improvement.tolerance;
    let corners = |mesh: &TetMesh, f: usize| mesh.facets[f].map(|v| mesh.point(v));
    // Facets by cells of space.
    let edge = 4.0;
    let cell = |p: DVec3| (p / edge).floor().as_ivec3();
    let mut cells: HashMap<[i32; 3], Vec<usize>> = HashMap::new();
    for f in 0..before.mesh.facets.len() {
        let [a, b, c] = corners(&before.mesh, f);
        let (low, high) = (cell(a.min(b).min(c) - max), cell(a.max(b).max(c) + max));
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    cells.entry([x, y, z]).or_default().push(f);
                }
            }
        }
    }
    let mut farthest: f64 = 0.0;
    for facet in &after.mesh.facets {
        for p in facet.map(|v| after.mesh.point(v)) {
            let near = cells.get(&cell(p).to_array()).map_or(&[][..], Vec::as_slice);
            let distances =
                near.iter().map(|&f| closest_point(&corners(&before.mesh, f), p).distance(p));
            farthest = farthest.max(distances.fold(f64::INFINITY, f64::min));
        }
    }
    assert!(
        farthest <= max * (1.0 + 1e-9),
        "{name}: a vertex is {farthest} from the interface, {max} are allowed"
    );
}

#[test]
fn promises_are_kept() {
    for (name, image, delta) in subjects() {
        check_promises(name, &both(&image, &params(delta), Improve::Full), 10);
        // Where facets are large for what they bound, a flip changes its volume by more.
        check_promises(name, &both(&image, &params(3.0 * delta), Improve::Full), 10);
    }
}

/// Where voxels of a label touch in edges and corners alone, at contacts, points stay where they
/// are. They are placed so that no angle has to be small.
#[test]
fn contacts_force_no_small_angle() {
    let checkerboard = |edge: f64, first: i32| {
        sampled([12; 3], [1.0; 3], |p| {
            first + ((p / edge).floor().element_sum().rem_euclid(2.0)) as i32
        })
        .unwrap()
    };
    let random = (0..8).map(|seed| noise([10, 11, 12], [1.0; 3], 2 + seed % 4, 100 + seed));
    let regular = [(1.0, 0), (2.0, 0), (2.0, 1), (4.0, 1)];
    let images = regular.map(|(edge, first)| checkerboard(edge, first)).into_iter().chain(random);
    for (number, image) in images.enumerate() {
        for delta in [1.0, 3.0] {
            let [_, after] = both(&image, &params(delta), Improve::Full);
            let left = &after.report.improvement.left;
            let at_contacts = left.iter().filter(|left| left.cause == Cause::Contact).count();
            assert_eq!(at_contacts, 0, "image {number} at {delta}: {left:?}");
            assert!(left.len() <= 10, "image {number} at {delta}: {left:?}");
        }
    }
}

#[test]
fn interfaces_stay_bit_for_bit_where_only_the_interior_is_improved() {
    for (name, image, delta) in subjects() {
        let [before, after] = both(&image, &params(delta), Improve::Interior);
        let facets = |meshing: &MeshResult| {
            let mesh = &meshing.mesh;
            let bits = |v: u32| mesh.points[v as usize].map(f64::to_bits);
            let mut facets: Vec<_> = mesh
                .facets
                .iter()
                .zip(&mesh.facet_labels)
                .map(|(facet, labels)| {
                    let mut corners = facet.map(bits);
                    corners.sort_unstable();
                    (corners, *labels)
                })
                .collect();
            facets.sort_unstable();
            facets
        };
        assert!(facets(&before) == facets(&after), "{name}: the interfaces differ");
        let below = |meshing: &MeshResult| meshing.report.quality.dihedral_histogram[0];
        assert!(
            below(&after) * 5 < below(&before),
            "{name}: {} and {}",
            below(&before),
            below(&after)
        );
        assert_eq!(after.report.improvement.counts.interface_flips, 0);
    }
}

#[test]
fn walls_stay_flat() {
    // An object that fills its image: six walls, twelve edges, and interfaces that end at them.
    let image =
        sampled([12, 10, 11], [1.0, 1.1, 0.9], |p| 1 + i32::from(p.x + 0.4 * p.y > 0.3)).unwrap();
    let [before, after] = both(&image, &params(1.3), Improve::Full);
    let bounds = |mesh: &TetMesh| {
        let points = mesh.points.iter().map(|&p| DVec3::from_array(p));
        points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
            [low.min(p), high.max(p)]
        })
    };
    let [low, high] = bounds(&before.mesh);
    assert_eq!(bounds(&after.mesh), [low, high]);
    // Refinement leaves a nick or two where an interface meets a wall at a slant.
    let off_walls = |mesh: &TetMesh| {
        let outer = (0..mesh.facets.len()).filter(|&f| mesh.facet_labels[f][1] == 0);
        let corners = outer.map(|f| mesh.facets[f].map(|v| mesh.point(v)));
        let is_on = |corners: &[DVec3; 3], a: usize, x: f64| corners.iter().all(|p| p[a] == x);
        corners
            .filter(|corners| {
                !(0..3).any(|a| is_on(corners, a, low[a]) || is_on(corners, a, high[a]))
            })
            .count()
    };
    assert!(off_walls(&after.mesh) <= off_walls(&before.mesh) && off_walls(&before.mesh) < 10);
    let volume = |meshing: &MeshResult| meshing.report.certificate.mesh_volume();
    assert!((volume(&before) - volume(&after)).abs() < 1e-9 * volume(&before));
}

#[test]
fn other_surfaces_keep_the_promises() {
    let image = nested_shells([24; 3], [1.0; 3], &[5.0, 10.0]).unwrap();
    let voxels = MeshParams { surface: SurfaceModel::Voxel, ..params(1.2) };
    check_promises("voxel faces", &both(&image, &voxels, Improve::Full), 200);
    let smoothed = MeshParams { sigma: 1.0, ..params(1.5) };
    check_promises("smoothed labels", &both(&image, &smoothed, Improve::Full), 10);
    let target = MeshParams { target_dihedral: 20.0, ..params(1.2) };
    check_promises("20 degrees", &both(&image, &target, Improve::Full), 40);
    let kept = MeshParams { background: true, ..params(1.2) };
    let [before, after] = both(&image, &kept, Improve::Full);
    check_promises("background kept", &[before, after], 10);
}

/// A facet that a flip made is none of refinement's. When places were measured against such facets,
/// too, two of 219 000 vertices were up to 1.16 tolerances away.
#[test]
fn flips_carry_no_vertex_away() {
    let path = Path::new("/usr/share/mricron/templates/aal.nii.gz");
    if !path.is_file() {
        eprintln!("SKIPPED: no atlas {}", path.display());
        return;
    }
    let image = read_image(path).unwrap().image;
    let [before, after] = both(&image, &params(2.0), Improve::Full);
    check_distance("AAL", &before, &after);
}

#[test]
fn high_targets_leave_few_tets() {
    let mut left = [0; 2];
    for (target_dihedral, left) in [20.0, 22.0].into_iter().zip(&mut left) {
        for (name, image, delta) in subjects() {
            let params = MeshParams { target_dihedral, ..params(delta) };
            let meshing = mesh_image(&image, &params, &Monitor::silent()).unwrap();
            let of_image = meshing.report.improvement.left.len();
            println!("{name}, {target_dihedral} degrees: {of_image} left");
            *left += of_image;
        }
    }
    assert!(left[0] <= 1 && left[1] <= 1, "{left:?}");
}

#[test]
fn background_that_is_kept_does_not_change_the_object() {
    let image = ball([22; 3], [1.0; 3], 8.0).unwrap();
    let object = |background| {
        let params = MeshParams { background, ..params(1.2) };
        let mesh = mesh_image(&image, &params, &Monitor::silent()).unwrap().mesh;
        let bits = |v: u32| mesh.points[v as usize].map(f64::to_bits);
        let mut tets: Vec<_> =
            mesh.tets.iter().zip(&mesh.labels).filter(|&(_, &label)| label != 0).collect();
        tets.sort_unstable();
        let mut corners: Vec<_> = tets.into_iter().map(|(tet, _)| tet.map(bits)).collect();
        corners.iter_mut().for_each(|tet| tet.sort_unstable());
        corners.sort_unstable();
        corners
    };
    // The blocks differ, so the meshes may, but for their size.
    let (dropped, kept) = (object(false).len() as f64, object(true).len() as f64);
    assert!((dropped / kept - 1.0).abs() < 0.01, "{dropped} {kept}");
}

#[test]
fn the_tolerance_grows_with_the_target() {
    assert_eq!([5.0, 15.0, 20.0, 30.0].map(tolerance), [0.1, 0.1, 0.2, 0.2]);
    assert!((tolerance(17.5) - 0.15).abs() < 1e-12);
}

#[test]
fn bad_targets_are_refused() {
    let image = ball([8; 3], [1.0; 3], 3.0).unwrap();
    for target_dihedral in [0.0, -1.0, 30.5, 40.0, f64::NAN, f64::INFINITY] {
        let params = MeshParams { target_dihedral, ..params(1.0) };
        let error = mesh_image(&image, &params, &Monitor::silent()).unwrap_err();
        let message = error.to_string();
        assert!(
            matches!(error, Error::InvalidArgument(_)) && message.contains("target dihedral"),
            "{message}"
        );
    }
}

/// Small meshes, in which single flips and moves count.
#[test]
fn labels_get_their_volumes_back() {
    let mut given_back = 0;
    let balls = (0..4).map(|i| ball([20; 3], [1.0; 3], 5.0 + f64::from(i)).unwrap());
    let noises = (0..4).map(|seed| noise([16, 15, 14], [1.0, 1.1, 0.9], 3, seed));
    for image in balls.chain(noises) {
        for (delta, target) in [(1.0, 15.0), (1.0, 20.0), (3.0, 15.0)] {
            let refined = refined(&image, &params(delta));
            let [kept, changed] = [&refined.volumes[..], &[]].map(|volumes| {
                let (mesh, improvement, _) =
                    improved_within(&refined, Improve::Full, target, volumes, &|| Ok(()));
                check_cover(&mesh, refined.box_volume, "volumes");
                check_angles("volumes", &mesh, &improvement);
                improvement.counts
            });
            // The background loses what the others gain, and has no limit.
            let (labels, volumes) = (&refined.labels[1..], &refined.volumes[1..]);
            let gained = labels.iter().map(|&label| kept.volume_of(label));
            let of_all: f64 = gained.clone().sum();
            assert!(of_all.abs() <= 1e-4 * volumes.iter().sum::<f64>(), "{of_all} in all");
            for (gained, &volume) in gained.zip(volumes) {
                let limit = if volume < 1000.0 { 2e-2 } else { 1e-3 };
                assert!(gained.abs() <= limit * volume, "{gained} of {volume}");
            }
            given_back += usize::from(kept != changed);
        }
    }
    assert!(given_back > 8, "{given_back}");
}
