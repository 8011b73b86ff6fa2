//! Meshes that are made coarser: fewer tets, and nothing else.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use glam::DVec3;
use lapd::Error;
use lapd::geometry::measures::triangle_angles;
use lapd::image::LabelImage;
use lapd::image::phantom::*;
use lapd::improve::{Coarsened, Coarseness, Settings, coarse_tolerance, coarsen};
use lapd::mesh::{NONE, TetMesh};
use lapd::monitor::Monitor;
use lapd::params::{Adaptive, Improve, MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};

use super::{Refined, check_cover, noise, params, refined, subjects};

/// What is known of a mesh after it was made coarser to samples `delta` apart.
struct Coarse {
    mesh: TetMesh,
    refined: Vec<[f64; 3]>,
    points_kept: usize,
    contractions: u64,
    ended: Option<Error>,
}

fn coarsened(
    refined: &Refined,
    delta: f64,
    facet_angle: f64,
    check_time: &(dyn Fn() -> lapd::Result<()> + Sync),
) -> Coarse {
    let mut mesh = refined.mesh.clone();
    let settings = Settings {
        oracle: &refined.oracle,
        labels: &refined.labels,
        volumes: &refined.volumes,
        sizing: &refined.sizing,
        improve: Improve::Full,
        tolerance: 0.1 * refined.oracle.spacing().min_element(),
        target: 15.0,
        radius_edge: 2.0,
        facet_angle: 30.0,
        is_delaunay: true,
        parts: [0.0, 1.0],
        check_time,
    };
    let coarseness = Coarseness {
        facet_angle,
        delta,
        tolerance: coarse_tolerance(15.0, refined.oracle.spacing().min_element(), delta),
        delta_between: &|_, _| delta,
        size_of: &|_, _| 2.0 * delta,
    };
    let done = coarsen(&mut mesh, &settings, &coarseness, &Monitor::silent()).unwrap();
    let contractions = done.improvement.counts.contractions;
    let Coarsened { points_kept, refined, ended, .. } = done;
    Coarse { mesh, refined, points_kept, contractions, ended }
}

/// The interface facets of a mesh with its background, as sorted vertices, and their labels.
fn facets(mesh: &TetMesh) -> Vec<([u32; 3], [i32; 2])> {
    let mut facets = Vec::new();
    for (t, tet) in mesh.tets.iter().enumerate().filter(|(_, tet)| tet[0] != NONE) {
        for (i, &n) in mesh.neighbors[t].iter().enumerate().filter(|&(_, &n)| n != NONE) {
            let labels = [mesh.labels[n as usize], mesh.labels[t]];
            if labels[0] < labels[1] {
                let mut facet = [0, 1, 2, 3].map(|k| tet[k]).to_vec();
                facet.remove(i);
                facet.sort_unstable();
                facets.push((facet.try_into().unwrap(), labels));
            }
        }
    }
    facets
}

/// Euler characteristics that no contraction may change: of the closed tets of each label, of the
/// facets between each two labels, and of the edges that two facets do not meet in.
fn characteristics(mesh: &TetMesh) -> (BTreeMap<i32, i64>, BTreeMap<[i32; 2], i64>, i64) {
    let of = |cells: &[Vec<u32>]| {
        let mut faces: BTreeSet<Vec<u32>> = BTreeSet::new();
        for cell in cells {
            for subset in 1_u32..1 << cell.len() {
                let face = (0..cell.len()).filter(|&i| subset >> i & 1 == 1).map(|i| cell[i]);
                faces.insert(face.collect());
            }
        }
        faces.iter().map(|face| if face.len() % 2 == 1 { 1 } else { -1 }).sum::<i64>()
    };
    let mut of_labels: BTreeMap<i32, Vec<Vec<u32>>> = BTreeMap::new();
    for (tet, &label) in mesh.tets.iter().zip(&mesh.labels).filter(|(tet, _)| tet[0] != NONE) {
        let mut tet = tet.to_vec();
        tet.sort_unstable();
        of_labels.entry(label).or_default().push(tet);
    }
    let facets = facets(mesh);
    let (mut of_pairs, mut of_edges) = (BTreeMap::<_, Vec<_>>::new(), BTreeMap::new());
    for &(facet @ [a, b, c], labels) in &facets {
        of_pairs.entry(labels).or_default().push(facet.to_vec());
        for edge in [[a, b], [a, c], [b, c]] {
            *of_edges.entry(edge).or_insert(0) += 1;
        }
    }
    let lines: Vec<Vec<u32>> =
        of_edges.into_iter().filter(|&(_, n)| n != 2).map(|(edge, _)| edge.to_vec()).collect();
    (
        of_labels.into_iter().map(|(label, tets)| (label, of(&tets))).collect(),
        of_pairs.into_iter().map(|(pair, facets)| (pair, of(&facets))).collect(),
        of(&lines),
    )
}

/// The least angle of an interface facet, in degrees.
fn least_angle(mesh: &TetMesh) -> f64 {
    let angles = facets(mesh).into_iter().map(|(facet, _)| {
        triangle_angles(&facet.map(|v| mesh.point(v))).into_iter().fold(180.0, f64::min)
    });
    angles.fold(180.0, f64::min)
}

/// Random labels with contacts, lines, corners and walls everywhere, and bodies without them.
#[test]
fn what_is_connected_stays() {
    let mut contracted = 0;
    let mut check = |refined: &Refined, delta: f64, facet_angle: f64, what: &str| {
        let before = characteristics(&refined.mesh);
        let least = least_angle(&refined.mesh).min(facet_angle);
        let coarse = coarsened(refined, delta, facet_angle, &|| Ok(()));
        check_cover(&coarse.mesh, refined.box_volume, what);
        assert_eq!(characteristics(&coarse.mesh), before, "{what}");
        let angle = least_angle(&coarse.mesh);
        assert!(angle > least - 1e-9, "{what}: {angle} degrees, {least} before");
        // Vertices of the object come first, and each has a tet.
        let of = |labelled: bool| -> BTreeSet<u32> {
            let tets = coarse.mesh.tets.iter().zip(&coarse.mesh.labels);
            tets.filter(|(_, label)| !labelled || **label != 0).flat_map(|(tet, _)| *tet).collect()
        };
        assert!(of(true).into_iter().eq(0..coarse.points_kept as u32), "{what}");
        assert!(of(false).into_iter().eq(0..coarse.mesh.points.len() as u32), "{what}");
        contracted += coarse.contractions;
    };
    for (name, image, delta) in subjects() {
        check(&refined(&image, &params(0.8 * delta)), 2.5 * delta, 15.0, name);
    }
    for seed in 0..16 {
        let image = noise([9, 8, 10], [1.0, 0.7, 1.4], 2 + seed % 4, seed);
        let delta = 0.5 + 0.05 * seed as f64;
        let angle = [5.0, 15.0, 25.0][seed as usize % 3];
        check(&refined(&image, &params(delta)), 4.0 * delta, angle, &format!("noise {seed}"));
    }
    assert!(contracted > 20_000, "{contracted}");
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    for (name, image, delta) in subjects() {
        let refined = refined(&image, &params(0.8 * delta));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let coarse = pool.install(|| coarsened(&refined, 3.0 * delta, 15.0, &|| Ok(())));
            let bits = |p: &[f64; 3]| p.map(f64::to_bits);
            let points: Vec<_> = coarse.mesh.points.iter().map(bits).collect();
            (points, coarse.mesh.tets, coarse.mesh.neighbors, coarse.contractions)
        };
        let one = on(1);
        assert!(one.3 > 100, "{name}: {} contractions", one.3);
        for threads in [2, 3, 8] {
            assert!(one == on(threads), "{name}: {threads} threads differ from one");
        }
    }
}

#[test]
fn an_early_end_leaves_a_valid_mesh() {
    let image = noise([14, 12, 13], [1.0, 1.2, 0.8], 4, 3);
    let refined = refined(&image, &params(0.7));
    let before = characteristics(&refined.mesh);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut ends = 0;
    for looks in [0, 3, 50, 300, 1000, 3000] {
        let left = AtomicUsize::new(looks);
        let check_time = || match left.try_update(Relaxed, Relaxed, |left| left.checked_sub(1)) {
            Ok(_) => Ok(()),
            Err(_) => Err(Error::TimeLimit("the time is over".into())),
        };
        let coarse = alone.install(|| coarsened(&refined, 2.5, 15.0, &check_time));
        check_cover(&coarse.mesh, refined.box_volume, "ended early");
        assert_eq!(characteristics(&coarse.mesh), before, "{looks}");
        ends += usize::from(matches!(coarse.ended, Some(Error::TimeLimit(_))));
    }
    assert!(ends >= 4, "{ends}");
}

fn coarse(params: MeshParams) -> MeshParams {
    MeshParams { coarsen: Some(15.0), ..params }
}

/// What is thin is sampled densely, and made as coarse again as if nothing were.
#[test]
fn thin_bodies_become_coarse() {
    let image = thin_sheet([140, 140, 13], [1.0; 3], 128.0, 1.0).unwrap();
    let dense = MeshParams { adaptive: Adaptive::Thickness, ..params(4.0) };
    let [dense, coarse] = [dense.clone(), coarse(dense)]
        .map(|params| mesh_image(&image, &params, &Monitor::silent()).unwrap());
    let tets = [&dense, &coarse].map(|run| run.mesh.tets.len());
    println!("{tets:?}");
    assert!(5 * tets[1] < tets[0], "{tets:?}");
    let improvement = &coarse.report.improvement;
    assert!(improvement.tets_before as f64 > 0.9 * tets[0] as f64 && improvement.facets_below > 0);
    assert!(coarse.report.quality.min_facet_angle > 14.999);
    let [dense, coarse] = [dense, coarse].map(|run| run.report.certificate.labels[0]);
    assert_eq!(coarse.euler_mesh, dense.euler_mesh);
    // The sheet keeps its thickness, one voxel.
    assert!((coarse.mesh_volume / dense.mesh_volume - 1.0).abs() < 0.03, "{}", coarse.mesh_volume);
}

/// Each pass moves vertices, and all of them together no farther than one might: from a place of
/// refinement's, or from one of the image's interfaces where two vertices met.
#[test]
fn moves_of_passes_do_not_add_up() {
    let (mut moved, mut met, mut met_on_lines): (f64, usize, usize) = (0.0, 0, 0);
    let mut check = |refined: &Refined, delta: f64, what: &str| {
        let coarse = coarsened(refined, delta, 15.0, &|| Ok(()));
        let side = refined.oracle.spacing().min_element();
        // Along interfaces and lines up to four times as far, where nothing else helped.
        let max = 4.0 * coarse_tolerance(15.0, side, delta);
        let bits = |p: [f64; 3]| p.map(f64::to_bits);
        let places: HashSet<_> = refined.mesh.points.iter().map(|&p| bits(p)).collect();
        // Whether a label is beside a place.
        let is_beside = |place: DVec3, label: &i32| {
            let id = refined.labels.iter().position(|other| other == label).unwrap();
            refined.oracle.has_label_near(place, id as u16, 0.05)
        };
        let mut labels_of: BTreeMap<u32, BTreeSet<i32>> = BTreeMap::new();
        for (facet, labels) in facets(&coarse.mesh) {
            facet.into_iter().for_each(|v| labels_of.entry(v).or_default().extend(labels));
        }
        for (v, labels) in labels_of {
            let (at, place) = (coarse.mesh.point(v), DVec3::from_array(coarse.refined[v as usize]));
            // The image goes on beyond its walls there.
            if !places.contains(&bits(place.into())) && refined.oracle.walls_at(place).count() == 0
            {
                met += 1;
                met_on_lines += usize::from(labels.len() > 2);
                let is_there = labels.iter().all(|label| is_beside(place, label));
                assert!(is_there, "{what}: the image has not {labels:?} at {place}");
            }
            let [walls, of_place] = [at, place].map(|p| refined.oracle.walls_at(p));
            assert!(walls == of_place, "{what}: {at} is in {walls:?}, {place} in {of_place:?}");
            let distance = at.distance(place);
            assert!(distance <= max, "{what}: moved by {distance}, {max} are allowed");
            moved = moved.max(distance / max);
        }
    };
    for (name, image, delta) in subjects() {
        check(&refined(&image, &params(0.8 * delta)), 4.0 * delta, name);
    }
    for seed in 0..6 {
        let image = noise([12, 13, 10], [1.0, 0.9, 1.2], 2 + seed % 4, 200 + seed);
        check(&refined(&image, &params(1.0)), 2.0 + seed as f64, &format!("noise {seed}"));
    }
    assert!(moved > 0.4 && met > 100 && met_on_lines > 10, "{moved} {met} {met_on_lines}");
}

/// Contractions cut corners; labels get back what they lost by that.
#[test]
fn labels_keep_their_volumes() {
    let images = [
        ("ball", ball([36; 3], [1.0; 3], 14.0).unwrap()),
        ("torus", torus([40, 40, 16], [1.0; 3], 12.0, 5.0).unwrap()),
        ("shells", nested_shells([36; 3], [1.0, 0.9, 1.1], &[8.0, 14.0]).unwrap()),
        ("sheet", thin_sheet([60, 60, 15], [1.0; 3], 50.0, 3.0).unwrap()),
    ];
    for (name, image) in images {
        for delta in [2.0, 4.0] {
            let dense = MeshParams { adaptive: Adaptive::Thickness, ..params(delta) };
            let [dense, coarse] = [dense.clone(), coarse(dense)]
                .map(|params| mesh_image(&image, &params, &Monitor::silent()).unwrap());
            let labels = |run: &MeshResult| run.report.certificate.labels.clone();
            let all = |run| labels(run).iter().map(|row| row.mesh_volume).sum::<f64>();
            let part = all(&coarse) / all(&dense) - 1.0;
            assert!(part.abs() < 1e-3, "{name}, delta {delta}: {part}");
            for (old, new) in labels(&dense).iter().zip(labels(&coarse)) {
                let part = new.mesh_volume / old.mesh_volume - 1.0;
                // Where samples are far apart few vertices of the smaller ball can move. What
                // they can't give stays with the shell around it.
                let max = if name == "shells" { 0.01 * delta } else { 1e-3 };
                assert!(part.abs() < max, "{name}, delta {delta}, label {}: {part}", new.label);
            }
        }
    }
}

/// Curved bodies stay as near to the image as samples so far apart make them.
#[test]
fn bodies_keep_their_shape() {
    let image = ball([40; 3], [1.0; 3], 16.0).unwrap();
    let full = |params| MeshParams { certificate: lapd::params::CertificateLevel::Full, ..params };
    let off = MeshParams { adaptive: Adaptive::Off, ..params(4.0) };
    // A label of its own size, which is fine, and made coarse.
    let fine = coarse(params(4.0));
    let [off, fine] =
        [off, fine].map(|params| mesh_image(&image, &full(params), &Monitor::silent()).unwrap());
    let worst = |run: &MeshResult| {
        let row = &run.report.certificate.labels[0];
        [row.mesh_to_image, row.image_to_mesh].map(|distance| distance.unwrap().max)
    };
    let [[a, b], [c, d]] = [&off, &fine].map(worst);
    assert!(c < 1.5 * a && d < 1.5 * b, "{a} {b} {c} {d}");
    assert!(fine.mesh.tets.len() <= off.mesh.tets.len());
}

/// Walls stay flat, and any surface will do.
#[test]
fn walls_and_other_surfaces_stay() {
    let mut contracted = 0;
    let mut check = |image: &LabelImage, params: MeshParams, what: &str| {
        let [before, after] = [params.clone(), coarse(params)]
            .map(|params| mesh_image(image, &params, &Monitor::silent()).unwrap());
        let [old, new] = [&before, &after].map(|run| &run.report.certificate);
        assert_eq!((new.facets_off_walls, new.open_edges, new.inverted_tets), (0, 0, 0), "{what}");
        for (old, new) in old.labels.iter().zip(&new.labels) {
            let topology = |row: &lapd::verify::LabelRow| {
                (row.components_mesh, row.euler_mesh, row.components_lost, row.components_merged)
            };
            assert_eq!(topology(old), topology(new), "{what}, label {}", new.label);
        }
        contracted += after.report.improvement.counts.contractions;
    };
    for (name, image, delta) in subjects() {
        let thin = MeshParams { size: 6.0 * delta, ..params(3.0 * delta) };
        check(&image, MeshParams { surface: SurfaceModel::Voxel, ..thin.clone() }, name);
        check(&image, MeshParams { background: true, ..thin.clone() }, name);
        check(&image, MeshParams { order: 2, curved: true, ..thin }, name);
    }
    for seed in 0..16 {
        let image = noise([12, 13, 10], [1.0, 0.9, 1.2], 2 + seed % 4, 100 + seed);
        check(&image, params(2.0 + 0.3 * seed as f64), &format!("noise {seed}"));
    }
    assert!(contracted > 5000, "{contracted}");
}

#[test]
fn bad_asks_are_refused() {
    for degrees in [0.0, -1.0, 30.5, f64::NAN, f64::INFINITY] {
        let asked = MeshParams { coarsen: Some(degrees), ..params(1.0) };
        let error = asked.validate().unwrap_err().to_string();
        assert!(error.contains("coarsening keeps facet angles above 0"), "{error}");
    }
    for improve in [Improve::None, Improve::Interior] {
        let error = coarse(MeshParams { improve, ..params(1.0) }).validate_together().unwrap_err();
        assert!(error.to_string().contains("coarsening needs improvement full"), "{error}");
    }
}
