//! The oracle of images made of intensities or probabilities, and of smoothed labels, against
//! definitions evaluated by brute force on random images, cut by the border.

mod random;

use std::cell::Cell;

use glam::DVec3;
use lapd::Error;
use lapd::image::Palette;
use lapd::image::{Frame, GrayImage, LabelImage, ProbabilityImage};
use lapd::monitor::Monitor;
use lapd::oracle::{Oracle, Surface};
use lapd::params::{ImageBorder, MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};
use random::Random;

impl Random {
    /// A smooth function with noise: flat and steep places, leaps of several isovalues.
    fn volume(&mut self, dims: [usize; 3], scale: f64) -> Vec<f32> {
        let way = DVec3::new(self.unit(), self.unit(), self.unit()) - 0.5;
        let noise = if self.unit() < 0.5 { 0.1 } else { 1.0 };
        let mut values = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let along = way.dot(DVec3::new(x as f64, y as f64, z as f64)).sin();
                    values.push((scale * (along + noise * self.unit())) as f32);
                }
            }
        }
        values
    }

    fn dims(&mut self) -> [usize; 3] {
        [0; 3].map(|_: i32| 2 + (self.unit() * 7.0) as usize)
    }

    /// A point of the image's grid and up to one voxel around it.
    fn near(&mut self, image: &LabelImage) -> DVec3 {
        let size = DVec3::from(image.dims().map(|n| n as f64 + 1.0));
        image.frame().to_world(DVec3::new(self.unit(), self.unit(), self.unit()) * size - 1.0)
    }
}

fn frame() -> Frame {
    Frame::new(
        [3.0, -2.0, 5.0],
        [0.7, 1.1, 2.0],
        [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    )
    .unwrap()
}

/// A value at a point: interpolated within the outermost voxel centres, from there to the border of
/// the image that of the projection; `None` outside.
fn interpolated(dims: [usize; 3], values: &[f32], x: DVec3) -> Option<f64> {
    let last = DVec3::from(dims.map(|n| n as f64 - 1.0));
    if (x + 0.5).min(last + 0.5 - x).min_element() < 0.0 {
        return None;
    }
    let x = x.clamp(DVec3::ZERO, last);
    let low = x.floor().min(last - 1.0);
    let f = x - low;
    Some(
        (0..8)
            .map(|c| {
                let bit = [0, 1, 2].map(|a| c >> a & 1);
                let part: f64 =
                    (0..3).map(|a| if bit[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
                let at = [0, 1, 2].map(|a| low[a] as usize + bit[a]);
                part * f64::from(values[at[0] + dims[0] * (at[1] + dims[1] * at[2])])
            })
            .sum(),
    )
}

/// Compares the oracle with a definition: the label of a point, and how clear it is.
fn compare(
    random: &mut Random,
    image: &LabelImage,
    oracle: &Oracle,
    label: impl Fn(DVec3) -> (i32, f64),
) {
    const CLEAR: f64 = 1e-4;
    let mut found = 0;
    for _ in 0..200 {
        let [a, b] = [random.near(image), random.near(image)];
        let (expected, ahead) = label(a);
        let from = oracle.label(a);
        if ahead > CLEAR {
            assert_eq!(
                image.labels()[usize::from(from)],
                expected,
                "label at {a}, ahead by {ahead}"
            );
        }
        let bound = oracle.distance_bound(a);
        let crossing = oracle.first_crossing(a, b);
        let length = a.distance(b);
        // Nothing before the crossing is clearly another label.
        let until = crossing.map_or(1.0, |c| c.point.distance(a) / length - 2e-3);
        for n in 0..200 {
            let s = f64::from(n) / 200.0;
            let (other, ahead) = label(a.lerp(b, s));
            if s < until && ahead > 1e-2 {
                assert_eq!(
                    image.labels()[usize::from(from)],
                    other,
                    "{a} to {b} at {s}, crossing {crossing:?}"
                );
            }
        }
        if let Some(c) = crossing {
            found += 1;
            assert!(
                c.point.distance(a) >= bound - 1e-6,
                "a crossing within the distance bound {bound}"
            );
            assert_eq!((c.from, c.from == c.to), (from, false));
        } else {
            assert_eq!(from, oracle.label(b), "no crossing from {a} to {b}");
        }
    }
    assert!(found > 20, "{found} crossings");
    // Crossed edges have a point of the isosurface: labels differ nearby. Not where two crossings
    // are close together.
    let grid = oracle.edge_grid(&Palette::uniform(10.0));
    let step = 2e-3 * oracle.spacing().min_element();
    let (mut edges, mut close) = (0, 0);
    for row in 0..grid.rows() {
        grid.visit_row(row, |edge| {
            let around = |d: DVec3| oracle.label(edge.point + d * step);
            let axes = [DVec3::X, DVec3::Y, DVec3::Z];
            edges += 1;
            close += u32::from(axes.iter().all(|&d| around(d) == around(-d)));
            Ok(())
        })
        .unwrap();
    }
    assert!(
        edges > 10 && close * 50 <= edges,
        "{close} of {edges} edges have no change of label at their crossing"
    );
}

fn oracle_of(image: &LabelImage, sigma: Option<f64>) -> Oracle {
    Oracle::new(image, Surface { sigma, ..Surface::default() }, &|| Ok(())).unwrap()
}

#[test]
fn interfaces_of_a_gray_image_are_isosurfaces() {
    let mut compared = 0;
    for seed in 1..12 {
        let mut random = Random(seed);
        let dims = random.dims();
        let values = random.volume(dims, 2.0);
        let gray = GrayImage::new(dims, frame(), values.clone()).unwrap();
        let isovalues = [-0.8, 0.3, 0.9];
        // Not where an interval has no voxel.
        let Ok(image) = gray.label_image(&isovalues, None) else { continue };
        let oracle = oracle_of(&image, None);
        assert!(oracle.weights().is_empty() && oracle.bytes() > 0);
        compare(&mut random, &image, &oracle, |p| {
            let index = image.frame().to_index(p);
            let outside = (DVec3::from(dims.map(|n| n as f64)) - 0.5 - index)
                .min(index + 0.5)
                .min_element()
                .abs();
            match interpolated(dims, &values, index) {
                None => (0, outside),
                Some(x) => {
                    let label = isovalues.iter().filter(|&&v| v <= x).count() as i32;
                    (label, isovalues.iter().map(|v| (x - v).abs()).fold(outside, f64::min))
                }
            }
        });
        compared += 1;
    }
    assert!(compared >= 8, "{compared} images of intensities");
}

#[test]
fn interfaces_of_probabilities_are_where_the_largest_changes() {
    let mut compared = 0;
    for seed in 1..12 {
        let mut random = Random(100 + seed);
        let dims = random.dims();
        let maps: Vec<Vec<f32>> = (0..3)
            .map(|_| {
                random.volume(dims, 0.15).iter().map(|x| (x + 0.17).clamp(0.0, 0.33)).collect()
            })
            .collect();
        let probabilities =
            ProbabilityImage::new(dims, frame(), maps.clone(), &[5, -3, 9]).unwrap();
        let image = probabilities.label_image().unwrap();
        if !probabilities.nowhere_likeliest(&image).is_empty() {
            continue;
        }
        let rest: Vec<f32> =
            (0..maps[0].len()).map(|n| 1.0 - maps[0][n] - maps[1][n] - maps[2][n]).collect();
        let values = [&rest, &maps[0], &maps[1], &maps[2]];
        compare(&mut random, &image, &oracle_of(&image, None), |p| {
            let index = image.frame().to_index(p);
            let outside = (DVec3::from(dims.map(|n| n as f64)) - 0.5 - index)
                .min(index + 0.5)
                .min_element()
                .abs();
            let at = values.map(|values| interpolated(dims, values, index));
            let [Some(a), Some(b), Some(c), Some(d)] = at else { return (0, outside) };
            let mut ranked = [(a, 0), (b, 5), (c, -3), (d, 9)];
            ranked.sort_by(|x, y| y.0.total_cmp(&x.0));
            (ranked[0].1, (ranked[0].0 - ranked[1].0).min(outside))
        });
        compared += 1;
    }
    assert!(compared >= 6, "{compared} images of probabilities");
}

/// However much is smoothed, the voxel centres keep their labels, a mixed cell stays one, and
/// crossings fit the labels.
#[test]
fn smoothing_takes_no_voxel_centre() {
    // How near to a change of label nothing is clear, in voxels along an axis: crossings are placed
    // to half a thousandth along each, which adds up, and labels found in single precision.
    const NEAR: f64 = 2e-3;
    let (asked, near_ties) = (Cell::new(0_u32), Cell::new(0_u32));
    for seed in 1..8 {
        let mut random = Random(200 + seed);
        let dims = random.dims();
        let ids: Vec<u16> =
            random.volume(dims, 1.0).iter().map(|x| ((x + 1.0) * 1.6) as u16).collect();
        let labels = vec![0, 4, 7, 8, 9];
        let image = LabelImage::from_ids(dims, frame(), ids, labels).unwrap();
        for sigma in [0.4, 1.0, 3.0] {
            let oracle = oracle_of(&image, Some(sigma));
            for (n, &id) in image.ids().iter().enumerate() {
                let at = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
                let p = image.frame().to_world(DVec3::from(at.map(|c| c as f64)));
                assert_eq!(oracle.label(p), id, "voxel {at:?} at sigma {sigma}");
            }
            // No definition but the oracle's own labels, of which a segment's crossing has to be
            // the first change.
            compare(&mut random, &image, &oracle, |p| {
                let (id, index) = (oracle.label(p), image.frame().to_index(p));
                let is_same =
                    |step: DVec3| oracle.label(image.frame().to_world(index + step)) == id;
                let is_clear =
                    DVec3::AXES.iter().all(|&axis| is_same(axis * NEAR) && is_same(axis * -NEAR));
                asked.set(asked.get() + 1);
                near_ties.set(near_ties.get() + u32::from(!is_clear));
                (image.labels()[usize::from(id)], f64::from(is_clear))
            });
        }
    }
    let (asked, near_ties) = (asked.get(), near_ties.get());
    assert!(near_ties * 50 <= asked, "{near_ties} of {asked} points are near a change of label");
}

#[test]
fn smoothing_is_for_label_images() {
    let gray = GrayImage::new([2, 2, 1], frame(), vec![0.0, 1.0, 2.0, 3.0]).unwrap();
    let image = gray.label_image(&[1.5], None).unwrap();
    let error = Oracle::new(&image, Surface { sigma: Some(1.0), ..Surface::default() }, &|| Ok(()))
        .unwrap_err();
    assert!(
        matches!(&error, Error::InvalidArgument(message) if message.starts_with("sigma 1 smooths \
            label images only"))
    );
    // The voxel model takes the labels alone.
    let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
    assert_eq!(oracle.label(image.frame().to_world(DVec3::new(0.0, 1.4, 0.0))), 1);
}

/// With a smooth border what lies beyond the image is background, and what has a voxel at the
/// border ends half a voxel beyond its centre: as a segmentation does whose labels weigh the same.
#[test]
fn a_smooth_border_is_half_a_voxel_beyond_the_centres() {
    let smooth = |image: &LabelImage, sigma| {
        Oracle::new(
            image,
            Surface { sigma, border: ImageBorder::Smooth, ..Surface::default() },
            &|| Ok(()),
        )
        .unwrap()
    };
    let check = |image: &LabelImage, oracle: &Oracle, what: &str| {
        let dims = image.dims();
        let mut ends = 0;
        for (n, &id) in image.ids().iter().enumerate() {
            let at = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            for (axis, &along) in DVec3::AXES.iter().enumerate() {
                for (is_end, way) in [(at[axis] == 0, -along), (at[axis] == dims[axis] - 1, along)]
                {
                    if !is_end {
                        continue;
                    }
                    let center = DVec3::from(at.map(|c| c as f64));
                    let label = |far: f64| oracle.label(image.frame().to_world(center + far * way));
                    assert_eq!(label(0.0), id, "{what}: voxel {at:?}");
                    assert_eq!(label(0.49) == 0, id == 0, "{what}: voxel {at:?} along {way}");
                    assert_eq!(
                        (label(0.51), label(0.99), label(1.5)),
                        (0, 0, 0),
                        "{what}: voxel {at:?} along {way}"
                    );
                    ends += u32::from(id != 0);
                }
            }
        }
        ends
    };
    let mut ends = [0; 3];
    for seed in 1..200 {
        let mut random = Random(300 + seed);
        let dims = random.dims();
        let values = random.volume(dims, 2.0);
        let gray = GrayImage::new(dims, frame(), values).unwrap();
        if let Ok(image) = gray.label_image(&[-0.8, 0.3, 0.9], None) {
            ends[0] += check(&image, &smooth(&image, None), "intensities");
        }
        let maps: Vec<Vec<f32>> = (0..3)
            .map(|_| {
                random.volume(dims, 0.15).iter().map(|x| (x + 0.17).clamp(0.0, 0.33)).collect()
            })
            .collect();
        let image =
            ProbabilityImage::new(dims, frame(), maps, &[5, -3, 9]).unwrap().label_image().unwrap();
        if !image.is_all_background() {
            ends[1] += check(&image, &smooth(&image, None), "probabilities");
        }
        let ids: Vec<u16> =
            random.volume(dims, 1.0).iter().map(|x| ((x + 1.0) * 1.6) as u16).collect();
        let image = LabelImage::from_ids(dims, frame(), ids, vec![0, 4, 7, 8, 9]).unwrap();
        ends[2] += check(&image, &smooth(&image, Some(1.0)), "smoothed labels");
    }
    assert!(ends.iter().all(|&n| n > 1000), "{ends:?}");
}

/// Sparse images, smoothed: a component without a tet is told, however small it is.
#[test]
fn what_smoothing_loses_is_told() {
    let mut vanished_in_all = 0;
    for seed in 0..200 {
        let mut random = Random(500 + seed);
        let dims = [0; 3].map(|_: i32| 6 + (random.unit() * 6.0) as usize);
        let part = [0.01, 0.05, 0.2][seed as usize % 3];
        let count: usize = dims.iter().product();
        let ids: Vec<u16> = (0..count)
            .map(|_| if random.unit() < part { 1 + (random.unit() * 3.0) as u16 } else { 0 })
            .collect();
        let image = LabelImage::from_ids(
            dims,
            Frame::axis_aligned([1.0; 3]).unwrap(),
            ids,
            vec![0, 1, 2, 3],
        )
        .unwrap();
        if image.is_all_background() {
            continue;
        }
        let sigma = [0.5, 1.0, 2.0][seed as usize / 3 % 3];
        let params = MeshParams { delta: 1.5, size: 3.0, sigma, ..MeshParams::default() };
        let MeshResult { mesh, report, .. } =
            mesh_image(&image, &params, &Monitor::silent()).unwrap();
        // Labels at voxels where a tet of the label is within a voxel.
        let mut is_met = vec![false; count];
        for (tet, &label) in mesh.tets.iter().zip(&mesh.labels) {
            let at = (tet.iter().map(|&v| mesh.point(v)).sum::<DVec3>() / 4.0).round();
            for n in 0..27_i32 {
                let c = [n % 3, n / 3 % 3, n / 9].map(|c| f64::from(c - 1));
                let x = at + DVec3::from(c);
                if x.min_element() >= 0.0 && (0..3).all(|a| (x[a] as usize) < dims[a]) {
                    let voxel = [x.x, x.y, x.z].map(|c| c as usize);
                    if image.label_at(voxel) == Some(label) {
                        is_met[voxel[0] + dims[0] * (voxel[1] + dims[1] * voxel[2])] = true;
                    }
                }
            }
        }
        let vanished =
            components(&image).iter().filter(|voxels| voxels.iter().all(|&v| !is_met[v])).count()
                as u64;
        let certificate = &report.certificate;
        let lost = certificate.labels.iter().map(|row| row.components_lost).sum::<u64>();
        let told = lost + certificate.small_lost.count;
        assert!(
            vanished <= told,
            "{seed}: {vanished} components have no tet near, {told} are told"
        );
        assert_eq!(certificate.small_lost.count > 0, certificate.small_lost.first.is_some());
        vanished_in_all += vanished;
    }
    println!("{vanished_in_all} components have vanished");
}

/// The voxels of each component of one label, joined with all 26 around.
fn components(image: &LabelImage) -> Vec<Vec<usize>> {
    let dims = image.dims();
    let (mut seen, mut all) = (vec![false; image.ids().len()], Vec::new());
    for start in 0..seen.len() {
        if seen[start] || image.ids()[start] == 0 {
            continue;
        }
        seen[start] = true;
        let (mut component, mut next) = (vec![start], 0);
        while let Some(&v) = component.get(next) {
            next += 1;
            let at = [v % dims[0], v / dims[0] % dims[1], v / (dims[0] * dims[1])];
            for n in 0..27 {
                let step = [n % 3, n / 3 % 3, n / 9];
                let beside = [0, 1, 2].map(|a| (at[a] + step[a]).wrapping_sub(1));
                if (0..3).any(|a| beside[a] >= dims[a]) {
                    continue;
                }
                let w = beside[0] + dims[0] * (beside[1] + dims[1] * beside[2]);
                if !seen[w] && image.ids()[w] == image.ids()[start] {
                    seen[w] = true;
                    component.push(w);
                }
            }
        }
        all.push(component);
    }
    all
}
