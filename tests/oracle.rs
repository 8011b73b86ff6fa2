//! The oracle against definitions evaluated by brute force, on random images: anisotropic, rotated,
//! cut by the border, both models.

mod random;

use glam::{DMat3, DVec3};
use lapd::{
    Error,
    image::{Frame, LabelImage},
    oracle::Oracle,
    params::SurfaceModel,
};
use random::Random;

const MODELS: [SurfaceModel; 2] = [SurfaceModel::Smooth, SurfaceModel::Voxel];

impl Random {
    fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// A point of the image's grid and up to `margin` voxels around it.
    fn near(&mut self, image: &LabelImage, margin: f64) -> DVec3 {
        let size = DVec3::from(image.dims().map(|n| n as f64 - 1.0)) + 2.0 * margin;
        image.frame().to_world(self.point() * size - margin)
    }

    fn frame(&mut self) -> Frame {
        let turn = DMat3::from_euler(
            glam::EulerRot::XYZ,
            self.unit() * 6.0,
            self.unit() * 6.0,
            self.unit() * 6.0,
        );
        let mut axes = turn.to_cols_array_2d();
        if self.unit() < 0.5 {
            axes[2] = axes[2].map(|c| -c);
        }
        let spacing = (self.point() * 1.5 + 0.4).to_array();
        Frame::new((self.point() * 100.0 - 50.0).to_array(), spacing, axes).unwrap()
    }

    /// Blocks of labels with noise on top: flat interfaces, lines and points where labels meet,
    /// single voxels; up to the border.
    fn image(&mut self) -> LabelImage {
        let dims = [0; 3].map(|_: i32| 1 + self.below(8));
        let cut = [0; 3].map(|_: i32| self.below(8));
        let noise = if self.unit() < 0.5 { 0.05 } else { 0.5 };
        let mut ids: Vec<u16> = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let block =
                        u16::from(x > cut[0]) + u16::from(y > cut[1]) + u16::from(z > cut[2]);
                    ids.push(if self.unit() < noise { self.below(5) as u16 } else { block });
                }
            }
        }
        ids[0] = 3;
        LabelImage::from_ids(dims, self.frame(), ids, vec![0, 10, 20, 30, 40]).unwrap()
    }
}

/// The id of a voxel; 0 outside the grid.
fn voxel(image: &LabelImage, at: [i64; 3]) -> u16 {
    let dims = image.dims().map(|n| n as i64);
    if (0..3).any(|a| at[a] < 0 || at[a] >= dims[a]) {
        return 0;
    }
    image.ids()[(at[0] + dims[0] * (at[1] + dims[1] * at[2])) as usize]
}

/// By how much the indicator of the voxel at corner `own` is raised in its octant of a cell: near
/// the centres of faces around which two labels alternate, and of cells whose faces do not join a
/// label's corners as a tree.
fn bonus(corners: &[u16; 8], own: usize, f: DVec3) -> f64 {
    let alternates = |axis: usize, side: usize| {
        let [c, u, v] = [side << axis, 1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
        corners[c] == corners[c | u | v]
            && corners[c | u] == corners[c | v]
            && corners[c] != corners[c | u]
    };
    // From 0 at the voxel's centre to 1 at the cell's.
    let near = [0, 1, 2].map(|a| 2.0 * f[a].min(1.0 - f[a]));
    let at_face = |axis: usize| {
        (0..3).map(|a| if a == axis { 1.0 - near[a] } else { near[a] }).product::<f64>()
    };
    let faces = (0..3).filter(|&axis| alternates(axis, own >> axis & 1)).map(at_face).sum::<f64>();
    let needs_center = |label: u16| {
        let pairs = || {
            (0..8_usize)
                .flat_map(|c| (0..c).map(move |d| [c, d]))
                .filter(|pair| pair.iter().all(|&c| corners[c] == label))
        };
        let mut set: [usize; 8] = std::array::from_fn(|c| c);
        let join = |set: &mut [usize; 8], [c, d]: [usize; 2]| {
            let (from, to) = (set[c], set[d]);
            set.iter_mut().filter(|s| **s == from).for_each(|s| *s = to);
        };
        pairs().filter(|[c, d]| (c ^ d).count_ones() == 1).for_each(|pair| join(&mut set, pair));
        let pieces = set;
        // Across a face, of which the other two corners have other labels.
        let across = |[c, d]: [usize; 2]| {
            let e = (c ^ d) & (c ^ d).wrapping_neg();
            ((c ^ d).count_ones() == 2 && pieces[c] != pieces[d])
                .then(|| [corners[c ^ e], corners[d ^ e]])
        };
        let is_joined =
            |pair| across(pair).is_some_and(|[x, y]| x != label && y != label && x != y);
        pairs().filter(|&pair| is_joined(pair)).for_each(|pair| join(&mut set, pair));
        for pair in pairs().filter(|&pair| across(pair).is_some_and(|[x, y]| x != label && x == y))
        {
            if set[pair[0]] == set[pair[1]] {
                return true;
            }
            join(&mut set, pair);
        }
        pairs().any(|[c, d]| set[c] != set[d])
    };
    let center = (1..5).any(needs_center);
    4.0 * (faces + if center { near.iter().product::<f64>() } else { 0.0 })
}

/// The label by definition, and by how much it is ahead of the next (smooth), or how far the next
/// voxel is (voxel model, without weights; in voxels).
fn naive(image: &LabelImage, weights: &[f32], p: DVec3) -> (u16, f64) {
    let x = image.frame().to_index(p);
    if weights.is_empty() {
        let at = x + 0.5;
        let ahead = (0..3).map(|a| (at[a] - at[a].round()).abs()).fold(1.0, f64::min);
        return (voxel(image, [0, 1, 2].map(|a| at[a].floor() as i64)), ahead);
    }
    // The image ends half a voxel beyond its outermost centres; up to there a point has the label
    // of its projection onto these.
    let last = DVec3::from(image.dims().map(|n| n as f64 - 1.0));
    let inside = (x + 0.5).min(last + 0.5 - x).min_element();
    if inside < 0.0 {
        return (0, -inside);
    }
    let x = x.clamp(DVec3::ZERO, last);
    let low = x.floor();
    let f = x - low;
    let mut sums = [0.0; 5];
    for c in 0..8 {
        let bit = [0, 1, 2].map(|a| c >> a & 1);
        let weight: f64 = (0..3).map(|a| if bit[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
        sums[usize::from(voxel(image, [0, 1, 2].map(|a| low[a] as i64 + bit[a])))] += weight;
    }
    let corners = std::array::from_fn(|c| {
        voxel(image, [0, 1, 2].map(|a| low[a] as i64 + (c >> a & 1) as i64))
    });
    let own = (0..3).fold(0, |own, a| own | usize::from(f[a] > 0.5) << a);
    sums[usize::from(corners[own])] += bonus(&corners, own, f);
    sums.iter_mut().zip(weights).for_each(|(sum, &w)| *sum *= f64::from(w));
    let best = (0..5).fold(0, |best, l| if sums[l] > sums[best] { l } else { best });
    let ahead = (0..5).filter(|&l| l != best).map(|l| sums[best] - sums[l]).fold(inside, f64::min);
    (best as u16, ahead)
}

/// Cases of random images; smaller ones first.
fn cases(count: u64, mut test: impl FnMut(&mut Random, &LabelImage, SurfaceModel, &Oracle)) {
    for seed in 0..count {
        let mut random = Random(seed + 1);
        random.unit();
        let image = random.image();
        for model in MODELS {
            let oracle = Oracle::new(&image, model, &|| Ok(())).unwrap();
            test(&mut random, &image, model, &oracle);
        }
    }
}

/// Points of dO by brute force: changes of `label` on random segments, narrowed by halving.
fn surface_points(
    random: &mut Random,
    image: &LabelImage,
    label: impl Fn(DVec3) -> u16,
    segments: usize,
) -> Vec<DVec3> {
    let mut found = Vec::new();
    for _ in 0..segments {
        let (a, b) = (random.near(image, 1.0), random.near(image, 1.0));
        let steps = 200;
        for n in 0..steps {
            let (mut p, mut q) =
                (a.lerp(b, n as f64 / steps as f64), a.lerp(b, (n + 1) as f64 / steps as f64));
            let from = label(p);
            if label(q) != from {
                for _ in 0..30 {
                    let middle = p.midpoint(q);
                    if label(middle) == from { p = middle } else { q = middle }
                }
                found.push(p);
            }
        }
    }
    found
}

/// Whether the label changes within `tolerance` voxels of p.
fn is_on_surface(oracle: &Oracle, image: &LabelImage, p: DVec3, tolerance: f64) -> bool {
    let frame = image.frame();
    let x = frame.to_index(p);
    let mut labels: Vec<u16> = vec![oracle.label(p)];
    for c in 0..27 {
        let step = DVec3::new((c % 3) as f64, (c / 3 % 3) as f64, (c / 9) as f64) - 1.0;
        labels.push(oracle.label(frame.to_world(x + step * tolerance)));
    }
    labels.iter().any(|&l| l != labels[0])
}

#[test]
fn labels_are_the_definition() {
    cases(150, |random, image, model, oracle| {
        for _ in 0..200 {
            let p = random.near(image, 2.0);
            let (label, ahead) = naive(image, oracle.weights(), p);
            if ahead > 1e-5 {
                assert_eq!(oracle.label(p), label, "{model:?} {p}");
            }
        }
    });
}

/// Where the oracle's label changes a voxel is near that has another label than one beside it:
/// weights, and what is done around contacts, move no interface into the middle of a label's
/// voxels.
#[test]
fn every_change_of_label_has_a_surface_voxel_within_half_a_diagonal() {
    let mut points = 0;
    cases(60, |random, image, model, oracle| {
        let half = 0.5 * image.frame().spacing().length();
        let surface = surface_points(random, image, |p| oracle.label(p), 20);
        points += surface.len();
        for x in surface {
            let near = image.frame().to_index(x).round();
            let mut nearest = f64::INFINITY;
            for c in 0..27 {
                let v = [
                    near.x as i64 + c % 3 - 1,
                    near.y as i64 + c / 3 % 3 - 1,
                    near.z as i64 + c / 9 - 1,
                ];
                let differs = (0..6).any(|n| {
                    let mut w = v;
                    w[n / 2] += if n % 2 == 0 { 1 } else { -1 };
                    voxel(image, w) != voxel(image, v)
                });
                if differs {
                    let centre = image.frame().to_world(DVec3::from(v.map(|c| c as f64)));
                    nearest = nearest.min(centre.distance(x));
                }
            }
            assert!(nearest <= half * (1.0 + 1e-6), "{model:?}: {nearest} over {half}");
        }
    });
    assert!(points > 1000, "{points} changes of label");
}

/// Whether a cell at most `rings` cells away from the cell of `p` along each axis has several
/// labels.
fn has_surface(image: &LabelImage, p: DVec3, rings: i64) -> bool {
    let cell = image.frame().to_index(p).floor().as_i64vec3().to_array();
    let block = |a: usize| cell[a] - rings..=cell[a] + 1 + rings;
    let id = voxel(image, cell);
    block(0).any(|i| block(1).any(|j| block(2).any(|k| voxel(image, [i, j, k]) != id)))
}

/// Whether a point is in the box of the object's voxel centres, or no more than a voxel beside it.
fn is_in_region(image: &LabelImage, p: DVec3) -> bool {
    let [nx, ny, _] = image.dims();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (at, _) in image.ids().iter().enumerate().filter(|&(_, &id)| id != 0) {
        let centre = DVec3::new((at % nx) as f64, (at / nx % ny) as f64, (at / nx / ny) as f64);
        (low, high) = (low.min(centre), high.max(centre));
    }
    let x = image.frame().to_index(p);
    x.cmpgt(low - 1.0).all() && x.cmplt(high + 1.0).all()
}

#[test]
fn the_distance_bound_is_a_bound_and_not_a_poor_one() {
    cases(60, |random, image, model, oracle| {
        let surface = surface_points(random, image, |p| naive(image, oracle.weights(), p).0, 60);
        for n in 0..100 {
            let p = random.near(image, if n % 2 == 0 { 1.0 } else { 20.0 });
            let nearest = surface.iter().map(|x| x.distance(p)).fold(f64::INFINITY, f64::min);
            let bound = oracle.distance_bound(p);
            assert!(
                bound <= nearest * (1.0 + 1e-9),
                "{model:?}: a bound of {bound} but a surface point at {nearest}"
            );
            // Where all cells around are of one label, so is what lies between their faces.
            let min = (0..3).find(|&rings| has_surface(image, p, rings)).unwrap_or(3) - 1;
            if is_in_region(image, p) {
                let spacing = image.frame().spacing().min_element();
                assert!(
                    bound >= min as f64 * spacing - 1e-6,
                    "{model:?}: a bound of {bound}, {min} cells"
                );
            }
        }
    });
}

#[test]
fn first_crossings_are_the_first_change_of_label() {
    let (mut segments, mut earlier) = (0, 0);
    cases(150, |random, image, model, oracle| {
        for _ in 0..60 {
            let (a, b) = (random.near(image, 2.0), random.near(image, 2.0));
            let from = oracle.label(a);
            let index = |t: f64| image.frame().to_index(a.lerp(b, t));
            let voxels = (index(1.0) - index(0.0)).abs().max_element();
            let steps = (voxels * 300.0).ceil() as usize + 1;
            let change = (1..=steps)
                .map(|n| n as f64 / steps as f64)
                .find(|&t| naive(image, oracle.weights(), a.lerp(b, t)).0 != from);
            let found = oracle.first_crossing(a, b);
            segments += 1;
            let Some(crossing) = found else {
                if let Some(t) = change {
                    let (_, ahead) = naive(image, oracle.weights(), a.lerp(b, t));
                    assert!(
                        ahead < 1e-4,
                        "{model:?}: a change at {t} was missed, ahead by {ahead}"
                    );
                }
                assert_eq!(oracle.label(b), from);
                continue;
            };
            let t = (crossing.point - a).dot(b - a) / (b - a).length_squared();
            assert!((a.lerp(b, t) - crossing.point).length() < 1e-9);
            assert_eq!(crossing.from, from);
            assert_ne!(crossing.to, from);
            assert!(
                is_on_surface(oracle, image, crossing.point, 1e-3),
                "{model:?}: {a} {b} gave {}",
                crossing.point
            );
            match change {
                Some(change) if (change - t).abs() * voxels <= 5e-3 => {}
                Some(change) if change < t => {
                    let (_, ahead) = naive(image, oracle.weights(), a.lerp(b, change));
                    assert!(ahead < 1e-4, "{model:?}: {t} found, but a change at {change}");
                }
                _ => earlier += 1,
            }
        }
    });
    // Shorter stays than the samples resolve are found too.
    println!(
        "{segments} segments, {earlier} with a crossing that sampling at 1/300 voxel did not see"
    );
    assert!(earlier * 200 < segments);
}

#[test]
fn segments_that_end_in_another_label_always_cross() {
    cases(60, |random, image, _, oracle| {
        let frame = image.frame();
        // Points on voxel centres, faces, edges and corners, where ties are.
        let mut snapped =
            || frame.to_world((frame.to_index(random.near(image, 2.0)) * 2.0).round() / 2.0);
        for _ in 0..200 {
            let (a, b) = (snapped(), snapped());
            let crossing = oracle.first_crossing(a, b);
            if oracle.label(a) != oracle.label(b) {
                let crossing = crossing.unwrap_or_else(|| panic!("{a} {b}"));
                assert!(crossing.from == oracle.label(a) && crossing.to != crossing.from);
            }
        }
    });
}

#[test]
fn far_and_broken_points_are_answered() {
    cases(10, |_, image, _, oracle| {
        let inside = image.frame().to_world(DVec3::ZERO);
        for far in [1e6, 1e12, 1e100, f64::MAX] {
            for away in [DVec3::X, DVec3::new(-1.0, 0.7, 0.1), DVec3::splat(1.0)] {
                let p = away * far;
                assert_eq!(oracle.label(p), 0);
                assert!(far > 1e150 || oracle.distance_bound(p) > 0.9 * far);
                if far <= 1e12 {
                    assert!(oracle.first_crossing(inside, p).is_some());
                    assert!(oracle.first_crossing(p, inside).is_some());
                }
            }
        }
        for p in [DVec3::NAN, DVec3::INFINITY, DVec3::new(0.0, f64::NAN, f64::NEG_INFINITY)] {
            assert_eq!(oracle.label(p), 0);
            oracle.distance_bound(p);
            assert_eq!(oracle.first_crossing(p, inside), None);
            assert_eq!(oracle.first_crossing(inside, p), None);
        }
    });
}

#[test]
fn one_label_to_the_border_is_a_box() {
    let image = LabelImage::from_ids(
        [4, 3, 2],
        Frame::axis_aligned([1.0, 2.0, 3.0]).unwrap(),
        vec![1; 24],
        vec![0, 7],
    )
    .unwrap();
    for model in MODELS {
        let oracle = Oracle::new(&image, model, &|| Ok(())).unwrap();
        let crossing =
            oracle.first_crossing(DVec3::new(1.0, 2.0, 1.5), DVec3::new(11.0, 2.0, 1.5)).unwrap();
        assert!((crossing.point.x - 3.5).abs() < 1e-9, "{model:?}: {}", crossing.point);
        assert_eq!((crossing.from, crossing.to), (1, 0));
        let [low, high] = oracle.bounds();
        assert!(
            low.cmple(DVec3::new(-0.5, -1.0, -1.5)).all()
                && high.cmpge(DVec3::new(3.5, 5.0, 4.5)).all()
        );
    }
}

#[test]
fn empty_images_and_cancelling_are_errors() {
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let empty = LabelImage::from_ids([3, 3, 3], frame, vec![0; 27], vec![0]).unwrap();
    assert!(matches!(
        Oracle::new(&empty, SurfaceModel::Smooth, &|| Ok(())),
        Err(Error::EmptyImage)
    ));
    let full = LabelImage::from_ids([3, 3, 3], frame, vec![1; 27], vec![0, 1]).unwrap();
    assert!(matches!(
        Oracle::new(&full, SurfaceModel::Smooth, &|| Err(Error::Cancelled)),
        Err(Error::Cancelled)
    ));
}

#[test]
fn contacts_are_where_voxels_touch_in_an_edge_or_a_corner_alone() {
    let dims = [9, 9, 9];
    let mut ids = vec![0; 729];
    // A pair that shares a face, one that shares an edge, and one that shares a corner.
    for [x, y, z] in [[1, 1, 2], [2, 1, 2], [5, 1, 2], [6, 2, 2], [2, 5, 5], [3, 6, 6]] {
        ids[x + 9 * (y + 9 * z)] = 1;
    }
    let frame = Frame::new([0.0; 3], [2.0, 1.0, 1.0], DMat3::IDENTITY.to_cols_array_2d()).unwrap();
    let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1]).unwrap();
    let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
    let mut found = oracle.contacts(&|| Ok(())).unwrap();
    found.sort_by(|a, b| a.y.total_cmp(&b.y));
    let wanted = [DVec3::new(11.0, 1.5, 2.0), DVec3::new(5.0, 5.5, 5.5)];
    assert_eq!(found.len(), wanted.len(), "{found:?}");
    for (found, wanted) in found.iter().zip(wanted) {
        // Moved a little off the planes of the grid.
        assert!(found.distance(wanted) < 0.2, "{found} instead of {wanted}");
    }
    let cancelled = oracle.contacts(&|| Err(Error::Cancelled));
    assert!(matches!(cancelled, Err(Error::Cancelled)));
}
