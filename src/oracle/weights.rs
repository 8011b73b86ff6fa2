//! Weights of the labels with which the smooth model keeps the volume of each.
//!
//! Interpolation blurs: the indicator of a label is its image convolved with the hat function, of variance h^2/6 along each axis. Where the
//! interface is curved with principal radii R1 and R2, the level 1/2 of the blurred indicator lies h^2/12 (1/R1 + 1/R2) inside, so that thin
//! convex labels lose some percent of their volume, a single voxel nearly all. Multiplied by a weight, an indicator's interface moves outwards:
//! by h/4 ln(w/v) to first order, where the weights of the two sides are w and v. One number per label cannot follow its curvature from place
//! to place, but can follow its mean, which is what the volume depends on to first order.
//!
//! **Volumes** are counted on samples, in units of 1/64 of a cell. A cell of one label counts as a whole. In the others samples are taken at the points of a
//! fixed sequence (M. Roberts' R3, a generalised golden ratio), shifted by a hash of the cell's index: more in cells with a label of few voxels.
//! A label takes part in a sample when some choice of weights lets it win there; where only one does, the sample is settled for good. The
//! others are kept, so that a count for other weights costs some nanoseconds per contested sample.
//!
//! **Steps.** With the logarithms of the weights as unknowns, the derivative of the volumes is about a graph Laplacian: two labels exchange what is contested
//! between them, spread evenly over the range of their ratio. A few Newton steps with this matrix, kept, bring the volumes to their targets, as
//! far as the bounds on the weights permit; each is solved by projected Gauss-Seidel, and halved when it leads away. The background's weight stays 1, because only ratios matter.
//!
//! Cost: on the brain atlas (256^3 voxels, 312 labels) a third to half of a second on two cores, and for that time 8 bytes per contested sample, about 70 MB.
//!
//! Only integers are summed by several threads: the weights do not depend on their number.

use glam::DVec3;
use rayon::prelude::*;

use super::{Voxel, border::Border, corners, indicator};
use crate::{Error, Result, distance::Bricks};

/// Weights lie in [1/LIMIT, LIMIT]. The proof of the oracle's clearance needs ratios below 3.
pub(super) const LIMIT: f32 = 1.5;
/// Samples in a cell at most: also the units in a cell. Powers of two.
const MOST: u32 = 64;
/// Samples in a cell at least.
const LEAST: u32 = 4;
/// How many sizes samples have: powers of two from 1 to MOST / LEAST units.
const SIZES: usize = (MOST / LEAST).ilog2() as usize + 1;
/// A label is sampled about this often, as long as a cell's samples are in their range: the error of its volume is then below some tenths of a percent.
const ENOUGH: u64 = 1 << 17;
/// Newton steps. On the atlases two bring the volumes of labels of 1000 voxels within 0.04 % of their targets, as counted here.
const STEPS: usize = 4;
/// Lengths that are tried of a step that does not bring the volumes nearer, each half of the one before; then it is given up: in a checkerboard, say, where volumes leap with the weights.
const LENGTHS: usize = 5;
/// Sweeps of Gauss-Seidel per step, over some numbers per label only.
const SWEEPS: usize = 60;
/// Labels that take part in one sample at most; more than four with values so much alike hardly occur, and then the least is left out.
const RIVALS: usize = 4;

/// A sample that two labels may win: the first does when its weight is at least `ratio` times that of the second.
struct Pair {
    labels: [u16; 2],
    ratio: f32,
}

/// A sample that more labels may win; values that are not needed are 0.
struct Many {
    labels: [u16; RIVALS],
    values: [f32; RIVALS],
    units: u32,
}

/// What sampling a layer of cells found.
struct Layer {
    /// Units of each label for any weights.
    settled: Vec<u64>,
    /// The pairs of 1, 2, 4... units each.
    pairs: [Vec<Pair>; SIZES],
    many: Vec<Many>,
}

impl Many {
    fn winner(&self, weights: &[f32]) -> u16 {
        let value = |n: usize| self.values[n] * weights[usize::from(self.labels[n])];
        self.labels[(1..RIVALS).fold(0, |best, n| if value(n) > value(best) { n } else { best })]
    }
}

/// The weight of each of `labels` dense ids, for the voxels of a region whose outermost ones are background.
pub(super) fn calibrate(
    bricks: &Bricks,
    voxels: &[Voxel],
    border: &Border,
    labels: usize,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<f32>> {
    let targets = voxel_counts(bricks, voxels, labels, check)?;
    let samples: Vec<u32> = targets
        .iter()
        .map(|&n| (ENOUGH / n.max(1)).clamp(u64::from(LEAST), u64::from(MOST)) as u32)
        .map(u32::next_power_of_two)
        .collect();
    let layers = (0..bricks.dims()[1] - 1)
        .into_par_iter()
        .map(|j| {
            check()?;
            sample_layer(bricks, voxels, border, j, &samples, check)
        })
        .collect::<Result<Vec<Layer>>>()?;
    let mut settled = vec![0; labels];
    layers.iter().for_each(|layer| add(&mut settled, &layer.settled));
    let exchange = exchange(&layers, labels, check)?;
    let missing = |logs: &[f64]| -> Result<Missing> {
        let weights: Vec<f32> = logs.iter().map(|log| log.exp() as f32).collect();
        let volumes = volumes(&layers, &settled, &weights, check)?;
        let by_label: Vec<f64> =
            targets.iter().zip(&volumes).map(|(&n, &v)| n as f64 * f64::from(MOST) - v as f64).collect();
        // The background has no target: its volume is that of the box less the others.
        Ok(Missing { all: by_label[1..].iter().map(|m| m.abs()).sum(), by_label })
    };
    let mut logs = vec![0.0_f64; labels];
    let mut now = missing(&logs)?;
    'steps: for _ in 0..STEPS {
        check()?;
        let mut aim = logs.clone();
        step(&exchange, &now.by_label, &mut aim);
        for _ in 0..LENGTHS {
            let then = missing(&aim)?;
            if then.all < now.all {
                (logs, now) = (aim, then);
                continue 'steps;
            }
            aim.iter_mut().zip(&logs).for_each(|(aim, log)| *aim = 0.5 * (*aim + log));
        }
        break;
    }
    Ok(logs.iter().map(|log| log.exp() as f32).collect())
}

/// What the labels' volumes lack, in units; negative for too much.
struct Missing {
    by_label: Vec<f64>,
    /// Sum of the magnitudes over all labels but the background.
    all: f64,
}

fn add(to: &mut [u64], more: &[u64]) {
    to.iter_mut().zip(more).for_each(|(a, b)| *a += b);
}

/// Voxels of each label in the region.
fn voxel_counts(
    bricks: &Bricks,
    voxels: &[Voxel],
    labels: usize,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<u64>> {
    let [nx, ny, nz] = bricks.dims();
    let count = |mut counts: Vec<u64>, j: usize| {
        check()?;
        for k in 0..nz {
            for i in 0..nx {
                counts[usize::from(voxels[bricks.index(i, j, k)].id)] += 1;
            }
        }
        Ok(counts)
    };
    let zero = || vec![0; labels];
    (0..ny).into_par_iter().try_fold(zero, count).try_reduce(zero, |mut a, b| {
        add(&mut a, &b);
        Ok(a)
    })
}

/// The cells between planes j and j + 1 of voxels. `samples`: how many a cell with a voxel of each label gets.
fn sample_layer(
    bricks: &Bricks,
    voxels: &[Voxel],
    border: &Border,
    j: usize,
    samples: &[u32],
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Layer> {
    let [nx, _, nz] = bricks.dims();
    let mut layer = Layer { settled: vec![0; samples.len()], pairs: Default::default(), many: Vec::new() };
    let points = points();
    for k in 0..nz - 1 {
        check()?;
        for i in 0..nx - 1 {
            let ids = corners(voxels, bricks, [i, j, k]);
            if indicator::is_uniform(&ids) {
                layer.settled[usize::from(ids[0])] += u64::from(MOST);
                continue;
            }
            let (present, count) = distinct(&ids);
            let present = &present[..count];
            let n = present.iter().filter(|&&id| id != 0).map(|&id| samples[usize::from(id)]).max().unwrap_or(LEAST);
            layer.make_room(MOST / n, n as usize)?;
            let shift = shift([i, j, k]);
            for point in &points[..n as usize] {
                let at = [0, 1, 2].map(|a| {
                    let t = point[a] + shift[a];
                    if t < 1.0 { t } else { t - 1.0 }
                });
                let low = DVec3::new(i as f64, j as f64, k as f64);
                let x = low + DVec3::from(at.map(f64::from));
                if border.holds(x) {
                    let at = (border.extend(x) - low).as_vec3().to_array();
                    layer.add_sample(&ids, present, at, MOST / n);
                } else {
                    layer.settled[0] += u64::from(MOST / n);
                }
            }
        }
    }
    // Layers wait for each other: what growing left unused adds up.
    layer.pairs.iter_mut().for_each(Vec::shrink_to_fit);
    layer.many.shrink_to_fit();
    Ok(layer)
}

impl Layer {
    /// Makes room for `count` more samples of `units` each.
    fn make_room(&mut self, units: u32, count: usize) -> Result<()> {
        let short = |_| Error::OutOfMemory { count, what: "samples for the weights of labels" };
        self.pairs[units.ilog2() as usize].try_reserve(count).map_err(short)?;
        self.many.try_reserve(count).map_err(short)
    }

    fn add_sample(&mut self, ids: &indicator::Corners, present: &[u16], at: [f32; 3], units: u32) {
        const RATIO: f32 = LIMIT * LIMIT;
        let corners = indicator::parts(at);
        if let &[a, b] = present {
            let value = indicator::indicator(ids, &corners, a);
            let other = 1.0 - value;
            if value > RATIO * other {
                self.settled[usize::from(a)] += u64::from(units);
            } else if other > RATIO * value {
                self.settled[usize::from(b)] += u64::from(units);
            } else {
                self.pairs[units.ilog2() as usize].push(Pair { labels: [a, b], ratio: other / value });
            }
            return;
        }
        let mut rivals = [(0.0_f32, 0_u16); 8];
        for (rival, &id) in rivals.iter_mut().zip(present) {
            *rival = (indicator::indicator(ids, &corners, id), id);
        }
        rivals.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let least = rivals[0].0 / RATIO;
        match rivals.iter().take_while(|r| r.0 >= least).count() {
            1 => self.settled[usize::from(rivals[0].1)] += u64::from(units),
            2 => self.pairs[units.ilog2() as usize]
                .push(Pair { labels: [rivals[0].1, rivals[1].1], ratio: rivals[1].0 / rivals[0].0 }),
            _ => self.many.push(Many {
                labels: std::array::from_fn(|n| rivals[n].1),
                values: std::array::from_fn(|n| if rivals[n].0 >= least { rivals[n].0 } else { 0.0 }),
                units,
            }),
        }
    }
}

/// The labels at the corners of a cell, and how many.
fn distinct(ids: &indicator::Corners) -> ([u16; 8], usize) {
    let mut present = [0; 8];
    let mut count = 0;
    for id in ids {
        if !present[..count].contains(id) {
            present[count] = *id;
            count += 1;
        }
    }
    (present, count)
}

/// The first points of the sequence.
fn points() -> [[f32; 3]; MOST as usize] {
    // Powers of the inverse of the root of x^4 = x + 1.
    const STRIDE: [f64; 3] = [0.819_172_513_396_164_5, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
    std::array::from_fn(|n| STRIDE.map(|s| (n as f64 * s).fract() as f32))
}

/// Where the sequence starts in a cell: in [0, 1)^3, without order.
fn shift([i, j, k]: [usize; 3]) -> [f32; 3] {
    // The finalizer of splitmix64 (G. Steele, D. Lea, C. Flood, OOPSLA 2014).
    let mut h =
        (i as u64 ^ (j as u64).rotate_left(21) ^ (k as u64).rotate_left(42)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ h >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ h >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^= h >> 31;
    [0, 21, 42].map(|low| (h >> low & 0x1f_ffff) as f32 / (1 << 21) as f32 * (1.0 - f32::EPSILON))
}

/// Units of each label under the given weights.
fn volumes(
    layers: &[Layer],
    settled: &[u64],
    weights: &[f32],
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<u64>> {
    let zero = || vec![0; weights.len()];
    let count = |mut counts: Vec<u64>, layer: &Layer| {
        check()?;
        for (size, pairs) in layer.pairs.iter().enumerate() {
            for &Pair { labels: [a, b], ratio } in pairs {
                let wins = weights[usize::from(a)] >= ratio * weights[usize::from(b)];
                counts[usize::from(if wins { a } else { b })] += 1 << size;
            }
        }
        for sample in &layer.many {
            counts[usize::from(sample.winner(weights))] += u64::from(sample.units);
        }
        Ok(counts)
    };
    let mut volumes = layers.par_iter().try_fold(zero, count).try_reduce(zero, |mut a, b| {
        add(&mut a, &b);
        Ok(a)
    })?;
    add(&mut volumes, settled);
    Ok(volumes)
}

/// For each label its rivals and the units that go over to it from each, per unit of the logarithm of their ratio.
fn exchange(layers: &[Layer], labels: usize, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Vec<Vec<(u16, f64)>>> {
    let mut units: std::collections::BTreeMap<[u16; 2], u64> = std::collections::BTreeMap::new();
    let mut note = |labels: [u16; 2], n: u64| {
        *units.entry([labels[0].min(labels[1]), labels[0].max(labels[1])]).or_default() += n;
    };
    for layer in layers {
        check()?;
        // Samples of a cell follow each other: runs of a pair are noted as one.
        for (size, pairs) in layer.pairs.iter().enumerate() {
            let runs = pairs.chunk_by(|p, q| p.labels == q.labels);
            runs.for_each(|run| note(run[0].labels, (run.len() as u64) << size));
        }
        layer.many.iter().for_each(|m| note([m.labels[0], m.labels[1]], u64::from(m.units)));
    }
    let mut exchange = vec![Vec::new(); labels];
    // Ratios from 1/LIMIT^2 to LIMIT^2 are contested.
    let width = 4.0 * f64::from(LIMIT).ln();
    for ([a, b], n) in units {
        let rate = n as f64 / width;
        exchange[usize::from(a)].push((b, rate));
        exchange[usize::from(b)].push((a, rate));
    }
    Ok(exchange)
}

/// One Newton step on the logarithms of the weights, towards the volumes that are `missing`.
fn step(exchange: &[Vec<(u16, f64)>], missing: &[f64], logs: &mut [f64]) {
    let limit = f64::from(LIMIT).ln();
    let before = logs.to_vec();
    for _ in 0..SWEEPS {
        for label in 1..logs.len() {
            let (mut gain, mut rate) = (missing[label], 0.0);
            for &(rival, r) in &exchange[label] {
                let rival = usize::from(rival);
                gain += r * (logs[rival] - before[rival]);
                rate += r;
            }
            if rate > 0.0 {
                logs[label] = (before[label] + gain / rate).clamp(-limit, limit);
            }
        }
    }
}
