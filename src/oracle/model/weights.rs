//! Weights of the labels with which the smooth model of indicators keeps the volume of each; other
//! values (`field`) have none.
//!
//! Interpolation blurs: the indicator of a label is its image convolved with the hat function, of
//! variance h^2/6 along each axis. Where the interface is curved with principal radii R1 and R2,
//! the level 1/2 of the blurred indicator lies h^2/12 (1/R1 + 1/R2) inside, so that thin convex
//! labels lose some percent of their volume, a single voxel nearly all. Multiplied by a weight, an
//! indicator's interface moves outwards: by h/4 ln(w/v) to first order, where the weights of the
//! two sides are w and v. One number per label cannot follow its curvature from place to place, but
//! can follow its mean, which is what the volume depends on to first order.
//!
//! **Volumes** need the mixed cells only. Every cell gives each label an eighth of its own volume
//! per corner; summed over all cells that is the label's count of voxels, the target. So the
//! *surplus* of a label is the sum over cells of what the model gives to it less its corners'
//! eighths, and is 0 in a cell of one label.
//! - Two labels a and b: a has the part of the cell where its indicator is at least the level w_b /
//!   (w_a + w_b). That part depends on the level and on which corners are a's, up to symmetries of
//!   the cube: 22 shapes, whose curves are tabulated once. For each pair of labels the cells of
//!   each shape are counted. No sampling.
//! - More labels: samples at the points of a fixed sequence (M. Roberts' R3, a generalised golden
//!   ratio), shifted by a hash of the cell's index. Cells with a label of few voxels get more
//!   samples; of the cells of large labels alone only a part, chosen by the hash, is looked at and
//!   stands for the others. A label takes part in a sample when some choice of weights lets it win
//!   there. Where two do, the sample is counted by the level at which it changes hands; the few
//!   with more rivals are kept.
//!
//! **Steps.** With the logarithms of the weights as unknowns, the derivative of the volumes is
//! about a graph Laplacian: two labels exchange what is contested between them, spread evenly over
//! the range of their ratio. A few Newton steps with this matrix, kept, bring the volumes to their
//! targets, as far as the bounds on the weights permit; each is solved by projected Gauss-Seidel,
//! and halved when it leads away. The background's weight stays 1, because only ratios matter.
//!
//! Only integers are summed by several threads: the weights do not depend on their number.

use std::collections::HashMap;
use std::sync::LazyLock;

use rayon::prelude::*;

use super::{border::Border, indicator};
use crate::memory::reserve;
use crate::{Error, Result};

/// Weights lie in [1/LIMIT, LIMIT].
pub(crate) const LIMIT: f32 = 1.5;
/// The largest ratio of two weights.
const RATIO: f32 = LIMIT * LIMIT;
/// Volumes are counted in parts of a cell, so that a sample is a whole number of them even where
/// walls leave an eighth of a cell.
pub(crate) const UNITS: u32 = 512;
/// Samples in a cell at most. Powers of two.
const MAX: u32 = 64;
/// Samples in a cell at least, if it is looked at.
const MIN: u32 = 4;
/// One in so many cells at least is looked at.
const SPARSEST: u32 = 16;
/// Samples of a cell times the square of the voxels of its smallest label: so that labels of 1000
/// voxels and more are off by some tenths of a percent at most, even where they only have cells of
/// several labels. A label's share of error goes with the root of its cells, and so is smaller for
/// larger ones anyway.
const ENOUGH: u64 = 1 << 27;
/// Intervals of the tabulated levels.
const LEVELS: usize = 32;
/// The levels of the largest ratio of weights and of the smallest.
const LOWEST: f32 = 1.0 / (1.0 + RATIO);
const HIGHEST: f32 = RATIO / (1.0 + RATIO);
/// Sets of corners that differ by more than a symmetry of the cube, the empty and the full one
/// among them.
const SHAPES: usize = 22;
/// Points at which a shape is sampled: the error of its part of the cell is some thousandths.
const SHAPE_POINTS: usize = 1 << 14;
/// Newton steps. On the atlases two bring the volumes of labels of 1000 voxels within 0.04 % of
/// their targets, as counted here.
const STEPS: usize = 4;
/// Lengths that are tried of a step that does not bring the volumes nearer, each half of the one
/// before; then it is given up: in a checkerboard, say, where volumes leap with the weights.
const LENGTHS: usize = 5;
/// Sweeps of Gauss-Seidel per step, over some numbers per label only.
const SWEEPS: usize = 60;
/// Labels that take part in one sample at most; more than four with values so much alike hardly
/// occur, and then the least is left out.
const RIVALS: usize = 4;
/// Samples that a thread takes at a time, at least.
const AT_ONCE: usize = 1 << 12;

/// Something that changes with the level, at the ends of the tabulated intervals.
type Curve = [f64; LEVELS + 1];

/// Points whose coordinates along an axis lie side by side: samples are taken several at a time,
/// which vectorises.
type Points = [[f32; MAX as usize]; 3];
/// Samples taken at a time.
const LANES: usize = MIN as usize;

/// The two-label cells: which shape a set of corners has, and the part of the cell that a shape
/// takes, less its corners' eighths.
struct Shapes {
    of: [u8; 256],
    curves: [Curve; SHAPES],
    /// First points of the sequence.
    points: Points,
}

static TABLES: LazyLock<Shapes> = LazyLock::new(Shapes::new);

impl Shapes {
    fn new() -> Self {
        // Symmetries: the axes in any order, each turned round or not. The least image of a set of
        // corners stands for its shape.
        const ORDERS: [[usize; 3]; 6] =
            [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let min = |set: usize| {
            let images = ORDERS.iter().flat_map(|order| (0..8).map(move |turned| (order, turned)));
            let image = |(order, turned): (&[usize; 3], usize)| {
                let corner =
                    |c: usize| (0..3).fold(0, |to, a| to | (c >> order[a] & 1) << a) ^ turned;
                (0..8).filter(|c| set >> c & 1 == 1).fold(0, |all, c| all | 1 << corner(c))
            };
            images.map(image).min().unwrap_or(set)
        };
        let mut shapes = Self {
            of: [0; 256],
            curves: [[0.0; LEVELS + 1]; SHAPES],
            points: std::array::from_fn(|a| std::array::from_fn(|n| point(n)[a])),
        };
        // Each point with its mirror images, as the shapes are those of sets and of their mirror
        // images.
        let mirrored = |n: usize| {
            let at = point(n / 8);
            [0, 1, 2].map(|a| if n >> a & 1 == 1 { 1.0 - at[a] } else { at[a] })
        };
        let (mut sets, mut count) = ([0usize; SHAPES], 0);
        for set in 0..256 {
            let min = min(set);
            if min < set {
                shapes.of[set] = shapes.of[min];
            } else {
                shapes.of[set] = count as u8;
                sets[count] = set;
                count += 1;
            }
        }
        let mut held = [[0_u32; LEVELS + 2]; SHAPES];
        for n in 0..SHAPE_POINTS {
            let parts = indicator::parts(mirrored(n));
            let levels = sets.map(|set| level_above(indicator::sum_of(set as u32, &parts)));
            held.iter_mut().zip(levels).for_each(|(held, level)| held[level] += 1);
        }
        for ((curve, held), set) in shapes.curves.iter_mut().zip(&held).zip(sets) {
            // A point is held at all levels up to its own.
            let mut part = 0.0;
            for level in (0..=LEVELS).rev() {
                part += f64::from(held[level + 1]) / SHAPE_POINTS as f64;
                curve[level] = part - f64::from(set.count_ones()) / 8.0;
            }
        }
        shapes
    }
}

/// The first tabulated level above a value; 0 below all, LEVELS + 1 above all.
fn level_above(value: f32) -> usize {
    let above = (value - LOWEST) * (LEVELS as f32 / (HIGHEST - LOWEST)) + 1.0;
    // By way of a signed number, which vectorises.
    above.clamp(0.0, (LEVELS + 1) as f32) as i32 as usize
}

/// Point n of the sequence.
fn point(n: usize) -> [f32; 3] {
    // Powers of the inverse of the root of x^4 = x + 1.
    const STRIDE: [f64; 3] =
        [0.819_172_513_396_164_5, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
    STRIDE.map(|s| (n as f64 * s + 0.5).fract() as f32)
}

/// What was counted of two labels, in units; the first is the smaller id.
#[derive(Clone)]
struct Contest {
    /// Cells of these two labels, by the shape of the first one's corners.
    cells: [u64; SHAPES],
    /// Samples by the first level at which the second label wins; never 0.
    samples: [u64; LEVELS + 1],
    /// Samples in which these two lead without weights, and a third label takes part.
    with_more: u64,
}

/// What two labels have between them, as their weights decide it.
struct Pair {
    labels: [u16; 2],
    /// What goes from the second one to the first at each level.
    surplus: Curve,
    /// Units that change hands between the last level and the first, and those in which these two
    /// lead and a third label takes part.
    contested: f64,
}

/// A sample that more labels may win; values that are not needed are 0.
#[derive(Clone)]
struct Many {
    labels: [u16; RIVALS],
    values: [f32; RIVALS],
    units: u32,
}

impl Many {
    /// Of values and labels, at most eight.
    fn new(values: impl Iterator<Item = (f32, u16)>, units: u32) -> Self {
        let (mut rivals, mut count) = ([(0.0, 0); 8], 0);
        for value in values {
            rivals[count] = value;
            count += 1;
        }
        rivals[..count].sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let rival = |n: usize| if n < count { rivals[n] } else { (0.0, rivals[0].1) };
        Self {
            labels: std::array::from_fn(|n| rival(n).1),
            values: std::array::from_fn(|n| rival(n).0),
            units,
        }
    }

    fn winner(&self, weights: &[f32]) -> u16 {
        let value = |n: usize| self.values[n] * weights[usize::from(self.labels[n])];
        self.labels[(1..RIVALS).fold(0, |best, n| if value(n) > value(best) { n } else { best })]
    }
}

/// Samples of a cell, side by side. Those of cells before it stay where this one has none: to clear
/// them would take as long as a few samples.
struct Samples {
    /// The indicators of its labels.
    values: [[f32; MAX as usize]; 8],
    /// The labels that some weights let win, one bit each; at least one.
    rivals: [u32; MAX as usize],
}

impl Default for Samples {
    fn default() -> Self {
        Self { values: [[0.0; MAX as usize]; 8], rivals: [0; MAX as usize] }
    }
}

impl Samples {
    /// Takes samples from number `start` on at the points `at` of a cell of so many labels; `held`
    /// are the indicators of the labels at the corners.
    #[inline(always)]
    fn take(&mut self, start: usize, labels: usize, held: &[[f32; 8]; 8], at: [[f32; LANES]; 3]) {
        let parts: [[f32; 8]; LANES] =
            std::array::from_fn(|lane| indicator::parts(at.map(|along| along[lane])));
        let mut values = [[0.0_f32; LANES]; 8];
        let mut largest = [0.0_f32; LANES];
        for (values, held) in values.iter_mut().zip(held).take(labels) {
            for lane in 0..LANES {
                let w: [f32; 8] = std::array::from_fn(|c| held[c] * parts[lane][c]);
                values[lane] = ((w[0] + w[4]) + (w[2] + w[6])) + ((w[1] + w[5]) + (w[3] + w[7]));
                largest[lane] = largest[lane].max(values[lane]);
            }
        }
        let mut rivals = [0_u32; LANES];
        for (n, values) in values[..labels].iter().enumerate() {
            self.values[n][start..start + LANES].copy_from_slice(values);
            for lane in 0..LANES {
                rivals[lane] |= u32::from(values[lane] * RATIO >= largest[lane]) << n;
            }
        }
        self.rivals[start..start + LANES].copy_from_slice(&rivals);
    }
}

/// How many samples the cells with a voxel of each label get.
pub(crate) struct Sampling(Vec<u32>);

impl Sampling {
    /// `voxels`: about how many each label has.
    pub(crate) fn new(voxels: impl Iterator<Item = u64>) -> Self {
        // In sixteenths of a sample, so that fewer than MIN stand for some of the cells.
        let samples = |n: u64| {
            let min = u64::from(MIN * 16 / SPARSEST);
            (16 * ENOUGH / n.saturating_mul(n).max(1)).clamp(min, u64::from(16 * MAX)) as u32
        };
        Self(voxels.map(|n| samples(n).next_power_of_two()).collect())
    }
}

/// Slots of the cache in front of the map of contests; neighbouring cells have few pairs of labels.
const SLOTS: usize = 256;

/// What was counted in some mixed cells. Several are merged into one.
pub(crate) struct Tally<'a> {
    sampling: &'a Sampling,
    contests: Vec<Contest>,
    of_pair: HashMap<[u16; 2], usize>,
    cache: Vec<([u16; 2], usize)>,
    /// Units of each label whatever the weights, less those of the corners; of the cells of more
    /// than two labels.
    surplus: Vec<i64>,
    /// Samples that more labels may win.
    many: Vec<Many>,
    /// Those of tallies that were merged into this one.
    merged: Vec<Vec<Many>>,
    /// Of the cell that was sampled last.
    samples: Box<Samples>,
}

impl<'a> Tally<'a> {
    pub(crate) fn new(sampling: &'a Sampling) -> Self {
        Self {
            sampling,
            contests: Vec::new(),
            of_pair: HashMap::new(),
            // No pair has twice the same label.
            cache: vec![([0, 0], 0); SLOTS],
            surplus: vec![0; sampling.0.len()],
            many: Vec::new(),
            merged: Vec::new(),
            samples: Box::default(),
        }
    }

    /// Counts a mixed cell whose corners have the labels `ids`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub(crate) fn add(
        &mut self,
        border: &Border,
        cell: [usize; 3],
        ids: &indicator::Corners,
    ) -> Result<()> {
        let (ids, halvings) = border.extend_corners(cell, ids);
        let first = indicator::corners_of(&ids, ids[0]);
        if first == 0xff {
            return Ok(());
        }
        let other = ids[(!first).trailing_zeros() as usize];
        if first | indicator::corners_of(&ids, other) == 0xff {
            self.add_two(first, [ids[0], other], UNITS >> halvings)
        } else {
            self.sample(cell, &ids, UNITS >> halvings)
        }
    }

    /// Counts a cell of two labels, the first of which the `corners` have; `units` of it are inside
    /// of the walls.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    #[inline(always)]
    pub(crate) fn add_two(
        &mut self,
        corners: u32,
        [id, other]: [u16; 2],
        units: u32,
    ) -> Result<()> {
        let (pair, corners) =
            if id < other { ([id, other], corners) } else { ([other, id], !corners & 0xff) };
        let shape = TABLES.of[corners as usize];
        self.contest(pair)?.cells[usize::from(shape)] += u64::from(units);
        Ok(())
    }

    /// Samples a cell of more than two labels; `units` of it are inside of the walls.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub(crate) fn sample(
        &mut self,
        cell: [usize; 3],
        ids: &indicator::Corners,
        units: u32,
    ) -> Result<()> {
        let sixteenths =
            ids.iter().filter(|&&id| id != 0).map(|&id| self.sampling.0[usize::from(id)]).max();
        let sixteenths = sixteenths.unwrap_or(16 * MAX);
        let count = (sixteenths / 16).max(MIN);
        let stands_for = 16 * count / sixteenths;
        let hash = hash(cell);
        // Bits that the shift does not use.
        if (hash >> 60) as u32 & (stands_for - 1) != 0 {
            return Ok(());
        }
        let of_cell = i64::from(units * stands_for);
        ids.iter().for_each(|&id| self.surplus[usize::from(id)] -= of_cell / 8);
        let shift = [0, 20, 40].map(|low| (hash >> low & 0xf_ffff) as f32 / (1 << 20) as f32);
        let units = units / count * stands_for;
        let (present, labels) = distinct(ids);
        let present = &present[..labels];
        let held: [[f32; 8]; 8] = std::array::from_fn(|n| {
            ids.map(|id| if n < labels && id == present[n] { 1.0 } else { 0.0 })
        });
        for start in (0..count as usize).step_by(LANES) {
            let at = [0, 1, 2].map(|a| {
                std::array::from_fn(|lane| {
                    let t = TABLES.points[a][start + lane] + shift[a];
                    if t < 1.0 { t } else { t - 1.0 }
                })
            });
            self.samples.take(start, labels, &held, at);
        }
        self.add_samples(present, count as usize, units)
    }

    /// Counts the first `count` samples of a cell whose labels are `present`.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    #[inline(always)]
    fn add_samples(&mut self, present: &[u16], count: usize, units: u32) -> Result<()> {
        // Sorted by the number of rivals first, without a branch on it, which is as good as random:
        // what one label wins is counted, the others are listed.
        let mut won = [0_u32; 8];
        let mut lists = [[0_u8; MAX as usize]; 2];
        let mut lengths = [0; 2];
        for (i, &rivals) in self.samples.rivals[..count].iter().enumerate() {
            let rest = rivals & (rivals - 1);
            let (is_contested, is_many) = (rest != 0, rest & rest.wrapping_sub(1) != 0);
            won[rivals.trailing_zeros() as usize % 8] += u32::from(!is_contested);
            for (n, is_listed) in [is_contested & !is_many, is_many].into_iter().enumerate() {
                lists[n][lengths[n]] = i as u8;
                lengths[n] += usize::from(is_listed);
            }
        }
        for (&id, &won) in present.iter().zip(&won) {
            self.surplus[usize::from(id)] += i64::from(won * units);
        }
        for i in lists[0][..lengths[0]].iter().map(|&i| usize::from(i)) {
            let rivals = self.samples.rivals[i];
            let [a, b] = [rivals, rivals & (rivals - 1)].map(|set| {
                let n = set.trailing_zeros() as usize;
                (present[n], self.samples.values[n][i])
            });
            self.add_contested(a, b, units)?;
        }
        let short =
            |_| Error::OutOfMemory { count: lengths[1], what: "samples for the weights of labels" };
        self.many.try_reserve(lengths[1]).map_err(short)?;
        for i in lists[1][..lengths[1]].iter().map(|&i| usize::from(i)) {
            let rivals = (0..present.len()).filter(|&n| self.samples.rivals[i] >> n & 1 == 1);
            let many = Many::new(rivals.map(|n| (self.samples.values[n][i], present[n])), units);
            let [a, b, ..] = many.labels;
            self.contest([a.min(b), a.max(b)])?.with_more += u64::from(units);
            self.many.push(many);
        }
        Ok(())
    }

    /// Counts a sample that either of two labels may win.
    #[inline(always)]
    fn add_contested(&mut self, a: (u16, f32), b: (u16, f32), units: u32) -> Result<()> {
        let [a, b] = if a.0 < b.0 { [a, b] } else { [b, a] };
        match level_above(a.1 / (a.1 + b.1)) {
            0 => self.surplus[usize::from(b.0)] += i64::from(units),
            level if level > LEVELS => self.surplus[usize::from(a.0)] += i64::from(units),
            level => {
                // As if b won; what a wins is taken from that.
                self.surplus[usize::from(b.0)] += i64::from(units);
                self.contest([a.0, b.0])?.samples[level] += u64::from(units);
            }
        }
        Ok(())
    }

    #[inline]
    fn contest(&mut self, pair: [u16; 2]) -> Result<&mut Contest> {
        let slot = (usize::from(pair[0]) ^ usize::from(pair[1]).wrapping_mul(37)) % SLOTS;
        if self.cache[slot].0 != pair {
            self.cache[slot] = (pair, self.find_contest(pair)?);
        }
        Ok(&mut self.contests[self.cache[slot].1])
    }

    #[cold]
    fn find_contest(&mut self, pair: [u16; 2]) -> Result<usize> {
        let next = self.contests.len();
        // An image with many labels has many pairs of them.
        const WHAT: &str = "pairs of labels";
        self.of_pair
            .try_reserve(1)
            .map_err(|_| Error::OutOfMemory { count: next + 1, what: WHAT })?;
        reserve(&mut self.contests, 1, WHAT)?;
        let at = *self.of_pair.entry(pair).or_insert(next);
        if at == next {
            self.contests.push(Contest {
                cells: [0; SHAPES],
                samples: [0; LEVELS + 1],
                with_more: 0,
            });
        }
        Ok(at)
    }

    /// The sum of two.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub(crate) fn merge(self, other: Self) -> Result<Self> {
        let (mut all, mut part) =
            if self.contests.len() < other.contests.len() { (other, self) } else { (self, other) };
        for (&pair, &at) in &part.of_pair {
            let (to, from) = (all.contest(pair)?, &part.contests[at]);
            to.cells.iter_mut().zip(&from.cells).for_each(|(a, b)| *a += b);
            to.samples.iter_mut().zip(&from.samples).for_each(|(a, b)| *a += b);
            to.with_more += from.with_more;
        }
        all.surplus.iter_mut().zip(&part.surplus).for_each(|(a, b)| *a += b);
        let count = 1 + part.merged.len();
        let short = |_| Error::OutOfMemory { count, what: "tallies for the weights of labels" };
        all.merged.try_reserve(count).map_err(short)?;
        all.merged.append(&mut part.merged);
        all.merged.push(part.many);
        Ok(all)
    }

    /// All samples that more than two labels may win.
    fn many(&self) -> impl ParallelIterator<Item = &Many> {
        let lists = self.merged.par_iter().chain([&self.many]);
        lists.flat_map(|list| list.par_iter().with_min_len(AT_ONCE))
    }

    /// The weight of each label. `check` is called before each evaluation of the volumes.
    ///
    /// # Errors
    /// Whatever `check` returns.
    pub(crate) fn weights(self, check: &dyn Fn() -> Result<()>) -> Result<Vec<f32>> {
        let mut met: Vec<_> =
            self.of_pair.iter().map(|(&pair, &at)| (pair, &self.contests[at])).collect();
        // In the order of labels, so that sums of floats do not depend on the order in which pairs
        // were met.
        met.sort_unstable_by_key(|&(pair, _)| pair);
        let pairs: Vec<Pair> =
            met.into_par_iter().map(|(labels, contest)| contest.pair(labels)).collect();
        let exchange = exchange(&pairs, self.surplus.len());
        let missing = |logs: &[f64]| -> Result<Missing> {
            check()?;
            let weights: Vec<f32> = logs.iter().map(|log| log.exp() as f32).collect();
            let by_label = self.missing(&pairs, &weights);
            // The background has no target: its volume is that of the box less the others.
            Ok(Missing { all: by_label[1..].iter().map(|m| m.abs()).sum(), by_label })
        };
        let mut logs = vec![0.0_f64; self.surplus.len()];
        let mut now = missing(&logs)?;
        'steps: for _ in 0..STEPS {
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

    /// What each label lacks under the given weights, in units; negative for too much.
    fn missing(&self, pairs: &[Pair], weights: &[f32]) -> Vec<f64> {
        let none = || vec![0; weights.len()];
        let won = |mut units: Vec<i64>, m: &Many| {
            units[usize::from(m.winner(weights))] += i64::from(m.units);
            units
        };
        let sum = |mut a: Vec<i64>, b: Vec<i64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let samples = self.many().fold(none, won);
        let units = samples.chain([self.surplus.clone()]).reduce(none, sum);
        let mut missing: Vec<f64> = units.iter().map(|&u| -u as f64).collect();
        for &Pair { labels: [a, b], surplus: ref curve, .. } in pairs {
            let (wa, wb) = (weights[usize::from(a)], weights[usize::from(b)]);
            let level = wb / (wa + wb);
            let at = f64::from((level - LOWEST) / (HIGHEST - LOWEST)) * LEVELS as f64;
            let n = (at.max(0.0) as usize).min(LEVELS - 1);
            let surplus = curve[n] + (curve[n + 1] - curve[n]) * (at - n as f64);
            missing[usize::from(a)] -= surplus;
            missing[usize::from(b)] += surplus;
        }
        missing
    }
}

impl Contest {
    fn pair(&self, labels: [u16; 2]) -> Pair {
        let surplus = self.surplus();
        let contested = surplus[0] - surplus[LEVELS] + self.with_more as f64;
        Pair { labels, surplus, contested }
    }

    /// What goes from the second label to the first at each level: in their cells beyond the first
    /// one's corners' eighths, and in the samples.
    fn surplus(&self) -> Curve {
        let mut curve = [0.0; LEVELS + 1];
        let mut won = 0;
        for level in (0..LEVELS).rev() {
            won += self.samples[level + 1];
            curve[level] = won as f64;
        }
        for (&cells, shape) in self.cells.iter().zip(&TABLES.curves) {
            curve.iter_mut().zip(shape).for_each(|(sum, part)| *sum += cells as f64 * part);
        }
        curve
    }
}

/// What the labels' volumes lack, in units; negative for too much.
struct Missing {
    by_label: Vec<f64>,
    /// Sum of the magnitudes over all labels but the background.
    all: f64,
}

/// The labels at the corners of a cell, and how many.
fn distinct(ids: &indicator::Corners) -> ([u16; 8], usize) {
    let mut present = [0; 8];
    let mut count = 0;
    for id in indicator::labels(ids, 0xff) {
        present[count] = id;
        count += 1;
    }
    (present, count)
}

/// A number of a cell, without order: where its samples start and whether it stands for others, for
/// one.
pub(crate) fn hash([i, j, k]: [usize; 3]) -> u64 {
    // The finalizer of splitmix64 (G. Steele, D. Lea, C. Flood, OOPSLA 2014).
    let mut h = (i as u64 ^ (j as u64).rotate_left(21) ^ (k as u64).rotate_left(42))
        .wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ h >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ h >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ h >> 31
}

/// For each label its rivals and the units that go over to it from each, per unit of the logarithm
/// of their ratio.
fn exchange(pairs: &[Pair], labels: usize) -> Vec<Vec<(u16, f64)>> {
    let mut exchange = vec![Vec::new(); labels];
    // Levels are those of ratios from 1/RATIO to RATIO.
    let width = 2.0 * f64::from(RATIO).ln();
    for &Pair { labels: [a, b], contested, .. } in pairs {
        let rate = contested / width;
        exchange[usize::from(a)].push((b, rate));
        exchange[usize::from(b)].push((a, rate));
    }
    exchange
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_those_of_the_cube() {
        let classes: std::collections::BTreeSet<u8> = TABLES.of.iter().copied().collect();
        assert_eq!(classes.len(), SHAPES);
        // A half of the cell, cut by a plane: what is held at level t is 1 - t of the cell.
        let half = &TABLES.curves[usize::from(TABLES.of[0b1111])];
        for (n, &surplus) in half.iter().enumerate() {
            let level = f64::from(LOWEST) + f64::from(HIGHEST - LOWEST) * n as f64 / LEVELS as f64;
            assert!((surplus - (0.5 - level)).abs() < 2e-3, "{surplus} at level {level}");
        }
        // What a set of corners has not, the other corners have at the opposite level.
        for set in 0..256 {
            let curve = |set: usize| &TABLES.curves[usize::from(TABLES.of[set])];
            for n in 0..=LEVELS {
                let both = curve(set)[n] + curve(0xff ^ set)[LEVELS - n];
                assert!(both.abs() < 6e-3, "{set:b} at {n}: {both}");
            }
        }
    }

    /// The surplus of two labels in the cells of some corners, by samples of all cells and by
    /// shapes.
    #[test]
    fn samples_agree_with_shapes() {
        let sampling = Sampling::new([1_u64; 4].into_iter());
        let border = Border::none([1000; 3]);
        let mut by_shape = Tally::new(&sampling);
        let mut by_samples = Tally::new(&sampling);
        let mut seed = 1_u64;
        for n in 0..2000_usize {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let ids = std::array::from_fn(|c| 1 + (seed >> (40 + c) & 1) as u16);
            if indicator::corners_of(&ids, ids[0]) != 0xff {
                let cell = [n % 10, n / 10 % 10, n / 100];
                by_shape.add(&border, cell, &ids).unwrap();
                by_samples.sample(cell, &ids, UNITS).unwrap();
            }
        }
        let missing = |tally: &Tally, weights: &[f32]| {
            let pairs: Vec<Pair> =
                tally.of_pair.iter().map(|(&pair, &at)| tally.contests[at].pair(pair)).collect();
            tally.missing(&pairs, weights)
        };
        for ratio in [0.5, 0.7, 1.0, 1.3, 2.0] {
            let (a, b) = (
                missing(&by_shape, &[1.0, 1.0, ratio, 1.0]),
                missing(&by_samples, &[1.0, 1.0, ratio, 1.0]),
            );
            for label in 1..3 {
                let difference = (a[label] - b[label]) / f64::from(UNITS) / 2000.0;
                assert!(
                    difference.abs() < 2e-3,
                    "label {label} at ratio {ratio}: {difference} of a cell"
                );
            }
        }
    }
}
