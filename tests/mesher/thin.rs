//! Bodies thinner than the distance of samples, or that touch themselves: none is torn, merged or
//! lost.

use glam::DVec3;
use lapd::image::LabelImage;
use lapd::image::phantom::*;
use lapd::monitor::Monitor;
use lapd::parallel::machine::Machine;
use lapd::params::{Adaptive, Algorithm, Improve, MeshParams};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::verify::{ComponentRow, DefectKind};

use super::random::Random;
use super::{assert_sound, mesh, params, run};

/// Every component of the image is one of the mesh, and bounded alike.
fn assert_same_topology(meshing: &MeshResult, what: &str) {
    for row in &meshing.report.certificate.labels {
        let found =
            (row.components_mesh, row.euler_mesh, row.components_lost, row.components_merged);
        assert_eq!(
            found,
            (row.components_image, row.euler_image, 0, 0),
            "label {} of {what}",
            row.label
        );
    }
}

/// Meshes at a delta of one voxel and of more, sampled more densely where the image is thin, and
/// where the mesh differs from it; and made coarse again.
fn keeps_its_topology(image: &LabelImage, what: &str) {
    for adaptive in [Adaptive::Thickness, Adaptive::Topology] {
        for delta in [1.0, 2.0, 3.0, 4.0] {
            let meshing = mesh(image, &MeshParams { size: 8.0, adaptive, ..params(delta) });
            assert_same_topology(&meshing, &format!("{what} at delta {delta}, {adaptive:?}"));
        }
    }
    for delta in [1.0, 2.0, 3.0, 4.0] {
        assert_coarsened_alike(image, &format!("{what} at delta {delta}, coarsened"), delta);
    }
}

/// A mesh that is made coarse has the topology of the image, and is sound.
fn assert_coarsened_alike(image: &LabelImage, what: &str, delta: f64) {
    let coarse = MeshParams { size: 2.0 * delta, coarsen: Some(15.0), ..params(delta) };
    let meshing = run(image, &coarse);
    assert_sound(&meshing);
    assert_same_topology(&meshing, what);
    let improvement = &meshing.report.improvement;
    assert!(
        improvement.tets_before > 0 && meshing.report.quality.min_facet_angle > 14.99,
        "{what}"
    );
}

#[test]
fn a_sheet_of_one_voxel_does_not_tear() {
    let image = thin_sheet([140, 140, 13], [1.0; 3], 128.0, 1.0).unwrap();
    assert_eq!(image.voxel_counts()[1], 128 * 128);
    keeps_its_topology(&image, "the sheet");
}

#[test]
fn an_oblique_sheet_does_not_tear() {
    let normal = DVec3::new(0.3, 0.5, 0.81).normalize();
    let label = |p: DVec3| i32::from(p.dot(normal).abs() <= 0.75 && p.abs().max_element() < 24.0);
    keeps_its_topology(&sampled([56; 3], [1.0; 3], label).unwrap(), "the oblique sheet");
}

#[test]
fn a_tube_of_two_voxels_stays_connected() {
    keeps_its_topology(&helical_tube([64; 3], 20.0, 4.0).unwrap(), "the tube");
}

/// However far apart samples may be elsewhere.
#[test]
fn any_delta_keeps_what_is_thin() {
    for delta in [30.0, 1e3, 1e6] {
        for (image, what) in
            [(comb(4).unwrap(), "comb"), (helical_tube([40; 3], 10.0, 2.0).unwrap(), "tube")]
        {
            let meshing = run(&image, &MeshParams { size: 2.0 * delta, ..params(delta) });
            assert_sound(&meshing);
            assert_same_topology(&meshing, &format!("the {what} at delta {delta}"));
        }
    }
}

#[test]
fn slits_of_one_voxel_stay_open() {
    keeps_its_topology(&comb(12).unwrap(), "the comb");
}

/// Two labels alternate: each is joined to itself along all edges of cells, and at all corners.
/// Eight labels nowhere.
#[test]
fn checkerboards_touch_where_their_cells_do() {
    let two = cubes(8, 4, |[a, b, c]| 1 + ((a + b + c) % 2) as i32).unwrap();
    let eight = cubes(8, 4, |[a, b, c]| 1 + (a % 2 + 2 * (b % 2) + 4 * (c % 2)) as i32).unwrap();
    for delta in [1.0, 2.0, 3.0, 4.0] {
        for adaptive in [Adaptive::Thickness, Adaptive::Topology] {
            let params = MeshParams { size: 8.0, adaptive, ..params(delta) };
            let meshing = mesh(&two, &params);
            for row in &meshing.report.certificate.labels {
                assert_eq!((row.euler_image, row.euler_mesh), (218, 218), "label {}", row.label);
            }
            let what = format!("a checkerboard of two labels at delta {delta}, {adaptive:?}");
            assert_same_topology(&meshing, &what);
        }
        assert_coarsened_alike(&two, "a checkerboard of two labels, coarsened", delta);
    }
    keeps_its_topology(&eight, "a checkerboard of eight labels");
}

/// Shells with a gap of one voxel between them, all around or but for one voxel.
#[test]
fn shells_with_a_gap_of_a_voxel_stay_apart() {
    let shells = |radius: fn(DVec3) -> f64, gap: std::ops::Range<f64>, bridge: f64| {
        let label = |p: DVec3| {
            let is_bridge = p.distance(DVec3::X * bridge) < 0.1;
            i32::from(radius(p) < 8.5 && (!gap.contains(&radius(p)) || is_bridge))
        };
        sampled([23; 3], [1.0; 3], label).unwrap()
    };
    let cube = |p: DVec3| p.abs().max_element();
    let ball = |p: DVec3| p.length();
    let apart = [shells(cube, 4.5..5.5, 0.0), shells(ball, 4.5..6.3, 0.0)];
    let joined = shells(cube, 4.5..5.5, 5.0);
    for image in apart.iter().chain([&joined]) {
        keeps_its_topology(image, "shells");
    }
    // Spheres: three of them, or two that are one inside of the other.
    for (image, components, euler) in [(&apart[0], 2, 6), (&apart[1], 2, 6), (&joined, 1, 4)] {
        let row = &mesh(image, &params(2.0)).report.certificate.labels[0];
        assert_eq!((row.components_mesh, row.euler_mesh), (components, euler));
    }
    // Voxels of balls meet across a gap so narrow, in edges and corners.
    for delta in [1.0, 2.0, 3.0, 4.0] {
        let params = MeshParams { size: 8.0, ..params(delta) };
        assert_same_topology(&mesh(&shells(ball, 4.5..5.5, 0.0), &params), "balls that touch");
    }
}

/// Blocks of one label whose corners face each other stay apart, and so do hollows in a block.
#[test]
fn corners_that_face_each_other_stay_apart() {
    let mut random = Random(2811);
    for number in 0..24 {
        let mut below = |end: usize| (random.unit() * end as f64) as i32;
        let gap = [below(3), below(3), 1 + below(3)];
        let sides = [(); 6].map(|()| 6 + below(7));
        let (across, flipped, hollow) = (below(3) as usize, [(); 3].map(|()| below(2)), below(2));
        let label = |p: DVec3| {
            let at = p.to_array();
            // The first block ends at 0 along each axis, the second one begins beyond the gap.
            let x = [0, 1, 2].map(|a| {
                let x = at[a].round() as i32;
                if flipped[a] == 1 { -x } else { x }
            });
            let gap = [0, 1, 2].map(|a| gap[(a + across) % 3]);
            let first = (0..3).all(|a| (-sides[a]..0).contains(&x[a]));
            let second = (0..3).all(|a| (gap[a]..gap[a] + sides[a + 3]).contains(&x[a]));
            let is_inside = x.iter().all(|x| x.abs() < 18);
            i32::from(if hollow == 1 { is_inside && !first && !second } else { first || second })
        };
        let image = sampled([43; 3], [1.0; 3], label).unwrap();
        for delta in [2.0, 3.0, 6.0, 9.0] {
            let what = format!("pair {number} at delta {delta}");
            let params = MeshParams { size: 2.0 * delta, ..params(delta) };
            assert_same_topology(&mesh(&image, &params), &what);
        }
        assert_coarsened_alike(&image, &format!("pair {number}, coarsened"), 6.0);
    }
}

/// Two cubes that meet in a corner alone are one body, and what is around them has no channel.
#[test]
fn cubes_touch_in_a_corner() {
    let image = cubes(2, 6, |at| if at == [0; 3] || at == [1; 3] { 1 } else { 2 }).unwrap();
    for delta in [1.0, 3.0] {
        let meshing = mesh(&image, &params(delta));
        let euler = |n: usize| {
            (
                meshing.report.certificate.labels[n].euler_image,
                meshing.report.certificate.labels[n].euler_mesh,
            )
        };
        assert_eq!((euler(0), euler(1)), ((2, 2), (2, 2)), "delta {delta}");
    }
}

/// A block of label 1, `side` voxels along each axis, in which some voxels have another label.
fn block_with(side: usize, others: &[([usize; 3], i32)]) -> LabelImage {
    let block = cubes(1, side, |_| 1).unwrap();
    let (dims, margin) = (block.dims(), (block.dims()[0] - side) / 2);
    let mut voxels: Vec<i32> = block.ids().iter().map(|&id| id.into()).collect();
    for &([i, j, k], label) in others {
        voxels[i + margin + dims[0] * (j + margin + dims[1] * (k + margin))] = label;
    }
    LabelImage::from_voxels(lapd::image::Voxels::I32(&voxels), dims, None, 0, *block.frame())
        .unwrap()
}

#[test]
fn single_voxels_are_kept() {
    keeps_its_topology(
        &block_with(12, &[([4; 3], 0), ([7, 7, 6], 2)]),
        "a block with two holes of a voxel",
    );
}

/// Small labels lie between others whose weights leave them little, and their voxels have most of
/// their sides in common with these.
#[test]
fn pairs_of_voxels_are_kept() {
    let mut others = Vec::new();
    for axis in 0..3 {
        for (n, label) in [0, 2, 0, 3].into_iter().enumerate() {
            let mut at = [3 + 4 * n; 3];
            at[(axis + 1) % 3] = 3 + 5 * axis;
            others.push((at, label));
            at[axis] += 1;
            others.push((at, label));
        }
    }
    keeps_its_topology(&block_with(19, &others), "a block with holes of two voxels");
}

/// Where the label of a row of voxels changes its body is thinnest; the mesh must not touch itself
/// off there.
#[test]
fn rows_of_changing_labels_stay_whole() {
    let mut others = Vec::new();
    for axis in 0..3 {
        for n in 0..9 {
            let mut at = [3 + 4 * axis; 3];
            at[axis] = 2 + n;
            at[(axis + 1) % 3] = 12 - 4 * axis;
            others.push((at, [2, 2, 3, 3, 3, 0, 4, 2, 2][n]));
        }
    }
    keeps_its_topology(&block_with(15, &others), "rows through a block");
}

#[test]
fn blocks_of_eight_voxels_have_tets() {
    let image = cubes(6, 4, |_| 0).unwrap();
    let dims = image.dims();
    let [nx, ny, _] = dims;
    let label = |v: usize| {
        let at = [v % nx, v / nx % ny, v / (nx * ny)];
        i32::from(at.iter().all(|c| (5..25).contains(c) && c % 5 < 2))
    };
    let voxels: Vec<i32> = (0..dims.iter().product()).map(label).collect();
    let image =
        LabelImage::from_voxels(lapd::image::Voxels::I32(&voxels), dims, None, 0, *image.frame())
            .unwrap();
    let meshing = mesh(&image, &MeshParams { size: 8.0, ..params(3.0) });
    assert_eq!(meshing.report.certificate.labels[0].components_image, 64);
    assert_same_topology(&meshing, "blocks");
    // Without adapting none is found.
    let uniform = MeshParams { size: 8.0, adaptive: Adaptive::Off, ..params(3.0) };
    let error = mesh_image(&image, &uniform, &Monitor::silent()).unwrap_err();
    assert!(error.to_string().contains("too coarse"), "{error}");
}

#[test]
fn what_is_too_small_is_left_out_and_listed() {
    // Two cubes of six voxels along each axis, each its own label, and a voxel of the second's
    // label elsewhere.
    let image = cubes(3, 6, |at| i32::from(at == [0; 3]) + 2 * i32::from(at == [2; 3])).unwrap();
    let params = params(1.0);
    let limit = |min_voxels| MeshParams { min_voxels, ..params.clone() };
    assert_eq!(mesh(&image, &limit(216)).report.certificate.defects, []);
    let (dims, frame) = (image.dims(), *image.frame());
    let mut voxels: Vec<i32> = image.ids().iter().map(|&id| id.into()).collect();
    voxels[14 + dims[0] * (4 + dims[1] * 4)] = 2;
    let image =
        LabelImage::from_voxels(lapd::image::Voxels::I32(&voxels), dims, None, 0, frame).unwrap();
    let meshing = mesh(&image, &limit(2));
    let defects = &meshing.report.certificate.defects;
    assert_eq!(
        defects.iter().map(|d| (d.kind, d.label, d.size)).collect::<Vec<_>>(),
        [(DefectKind::Dropped, 2, 1)]
    );
    assert_eq!(meshing.report.certificate.labels[1].components_image, 1);
}

/// Samples come in only where the mesh differs, and not at all where it does not.
#[test]
fn sampling_that_follows_topology_takes_fewer_tets() {
    let tets = |image: &LabelImage, adaptive| {
        let params = MeshParams { size: 8.0, adaptive, ..params(4.0) };
        let meshing = mesh_image(image, &params, &Monitor::silent()).unwrap();
        (meshing.mesh.tets.len(), meshing.report.differences)
    };
    let image = thin_sheet([140, 140, 13], [1.0; 3], 128.0, 3.0).unwrap();
    let [(off, _), (thickness, none), (topology, found)] =
        [Adaptive::Off, Adaptive::Thickness, Adaptive::Topology].map(|way| tets(&image, way));
    assert!(off <= topology && 3 * topology < 2 * thickness, "{off}, {topology}, {thickness}");
    assert_eq!((none.len(), found.last()), (0, Some(&0)), "{found:?}");
    let image = ball([26; 3], [1.0; 3], 10.0).unwrap();
    let [(off, _), (topology, found)] =
        [Adaptive::Off, Adaptive::Topology].map(|way| tets(&image, way));
    assert_eq!((off, found), (topology, vec![0]));
}

/// A block, and single voxels that have no more than an edge in common with it: as many components
/// as without them, bounded alike. They take samples where delta is less than two voxels only.
#[test]
fn what_is_smaller_than_two_voxels_takes_no_samples_at_a_coarse_delta() {
    let frame = lapd::image::Frame::axis_aligned([1.0; 3]).unwrap();
    let image = LabelImage::from_fn([26; 3], frame, |p| {
        let is_in_block = p.cmpge(DVec3::splat(6.0)).all() && p.cmplt(DVec3::splat(20.0)).all();
        let is_beside = p.x == 20.0 && p.y == 20.0 && [9.0, 13.0, 17.0].contains(&p.z);
        i32::from(is_in_block || is_beside)
    });
    let image = image.unwrap();
    for (delta, is_sampled) in [(3.0, false), (1.9, true)] {
        let [off, topology] = [Adaptive::Off, Adaptive::Topology]
            .map(|adaptive| mesh(&image, &MeshParams { size: 8.0, adaptive, ..params(delta) }));
        assert_same_topology(&topology, &format!("the block at delta {delta}"));
        assert_eq!(topology.report.differences[0] > 0, is_sampled, "delta {delta}");
        assert_eq!(off.mesh == topology.mesh, !is_sampled, "delta {delta}");
    }
}

/// A limit ends the rounds as it ends the first refinement.
#[test]
fn limits_end_sampling_that_follows_topology() {
    let image = comb(12).unwrap();
    let params = MeshParams { size: 8.0, adaptive: Adaptive::Topology, ..params(3.0) };
    let vertices = |adaptive| {
        let whole = MeshParams { adaptive, ..params.clone() };
        mesh_image(&image, &whole, &Monitor::silent()).unwrap().report.all_vertices as usize
    };
    let [first, all] = [Adaptive::Off, Adaptive::Topology].map(vertices);
    let limit = first.midpoint(all);
    let limited = MeshParams { max_vertices: Some(limit), ..params.clone() };
    let error = mesh_image(&image, &limited, &Monitor::silent()).unwrap_err();
    assert!(matches!(error, lapd::Error::LimitReached(_)), "{error}");
    let partial = MeshParams { partial: true, ..limited };
    let meshing = mesh_image(&image, &partial, &Monitor::silent()).unwrap();
    assert!(meshing.ended_by.is_some());
    assert_eq!(meshing.report.certificate.open_edges, 0);
    assert!(meshing.report.all_vertices <= limit as u64 + 8, "{}", meshing.report.all_vertices);
}

/// On several threads, with and without regions of their own, as on one: where places that differ
/// are most of the image, and where they are few.
#[test]
fn sampling_follows_topology_on_any_number_of_threads() {
    let few = block_with(72, &[([20; 3], 2), ([50; 3], 3)]);
    for (image, what) in [(comb(12).unwrap(), "the comb"), (few, "the block")] {
        let params = MeshParams { size: 8.0, adaptive: Adaptive::Topology, ..params(3.0) };
        let one = [0, 1].map(|_| mesh(&image, &params));
        assert!(one[0].mesh == one[1].mesh);
        assert!(one[0].report.differences.len() > 1, "{what} needs no round");
        for algorithm in [Algorithm::Podm, Algorithm::Lapd] {
            let machine = Some(Machine::uniform(2, 2));
            let several = MeshParams { threads: 4, algorithm, machine, ..params.clone() };
            let meshing = mesh(&image, &several);
            assert_same_topology(&meshing, &format!("{what}, 4 threads, {algorithm:?}"));
            let tets = [&one[0], &meshing].map(|meshing| meshing.mesh.tets.len() as f64);
            assert!((tets[0] / tets[1] - 1.0).abs() < 0.3, "{tets:?}");
        }
    }
}

#[test]
fn thick_bodies_are_sampled_as_before() {
    let image = ball([26; 3], [1.0; 3], 10.0).unwrap();
    let adaptive = mesh(&image, &params(1.5));
    let uniform = mesh(&image, &MeshParams { adaptive: Adaptive::Off, ..params(1.5) });
    assert!(adaptive.mesh == uniform.mesh);
}

/// Slices are many times thicker than voxels are wide in most clinical images: where boundaries are
/// oblique, these are terraces. Cells of random seeds, some of which have the same label, so that
/// labels meet in all kinds of lines, edges and corners.
#[test]
fn thick_slices_keep_what_is_connected() {
    let mut random = Random(1);
    for (n, thick) in [4.0, 6.4, 2.9].into_iter().cycle().take(18).enumerate() {
        let mut spacing = [1.0, 1.1, 0.95];
        spacing[n % 3] = thick;
        if n % 2 == 1 {
            spacing[(n + 1) % 3] = 0.6 * thick;
        }
        let dims = spacing.map(|side| (22.0 / side) as usize);
        let seeds: Vec<(DVec3, i32)> =
            (0..16).map(|n| (22.0 * DVec3::from([(); 3].map(|()| random.unit())), n % 5)).collect();
        let nearest = |p: DVec3| {
            let mut seeds = seeds.iter().map(|(q, label)| (q.distance(p), *label));
            let first = seeds.next().unwrap();
            seeds.fold(first, |a, b| if b.0 < a.0 { b } else { a }).1
        };
        let frame = lapd::image::Frame::axis_aligned(spacing).unwrap();
        let image = LabelImage::from_fn(dims, frame, nearest).unwrap();
        for delta in [1.0, 3.0] {
            let meshing = mesh_image(&image, &params(delta), &Monitor::silent()).unwrap();
            assert_same_topology(&meshing, &format!("slices {n}, {spacing:?}, at delta {delta}"));
        }
    }
}

/// Cells of random seeds, parted by sheets of one to two voxels that have labels of their own. What
/// sampling leaves are tunnels and bridges smaller than a voxel: all of them are mended. Where all
/// differences are sampled first few tets are left to be.
#[test]
fn tunnels_smaller_than_a_voxel_are_mended() {
    let mut random = Random(36);
    let (mut wrong, mut mended) = ([[0; 2]; 2], [0; 2]);
    for _ in 0..12 {
        let seeds: Vec<(DVec3, i32)> = (0..14)
            .map(|n| (DVec3::from([(); 3].map(|()| random.between(4.0, 26.0))), n))
            .collect();
        let thick = random.between(0.7, 1.3);
        let label = |p: DVec3| {
            let mut near: Vec<(f64, i32)> =
                seeds.iter().map(|(q, label)| (q.distance(p), *label)).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let [first, second] = [near[0], near[1]];
            match () {
                () if first.0 > 11.0 => 0,
                () if second.0 - first.0 < thick => 1 + first.1 % 4,
                () => 5 * (first.1 % 2),
            }
        };
        let frame = lapd::image::Frame::axis_aligned([1.0; 3]).unwrap();
        let image = LabelImage::from_fn([31; 3], frame, label).unwrap();
        for (n, delta) in [1.5, 3.0].into_iter().enumerate() {
            // The first keeps interfaces as refinement made them.
            for (m, improve) in [Improve::Interior, Improve::Full].into_iter().enumerate() {
                let params = MeshParams { improve, adaptive: Adaptive::Topology, ..params(delta) };
                let meshing = run(&image, &params);
                assert_sound(&meshing);
                let components = meshing.report.certificate.components.iter();
                let differ = |row: &&ComponentRow| {
                    row.components_mesh != 1
                        || row.image_voxels >= 100 && row.euler_mesh != row.euler_image
                };
                wrong[n][m] += components.filter(differ).count();
                mended[n] += meshing.report.improvement.tets_mended;
            }
        }
    }
    println!("components that differ: {wrong:?}; tets that got another label: {mended:?}");
    let all_mended = |[before, after]: [usize; 2]| before >= 10 && after == 0;
    assert!(wrong.into_iter().all(all_mended), "components that differ: {wrong:?}");
    assert!((1..100).contains(&mended[0]), "{mended:?} tets got another label");
}
