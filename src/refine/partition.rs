//! Over-decomposed block-based partition (paper, section 4.3 and Fig. 6): space is cut into many
//! more blocks than there are workers, those that hold elements are *active*, and the region of a
//! group of workers is bisected, along one dimension and between two layers of blocks, into
//! subregions of about equal load for each worker of the two halves of the group.
//!
//! The groups are halved as the machine says, memory node by memory node, each half physically
//! compact (`parallel::machine`); within a node, by number. The bisections are a k-d tree whose
//! leaves are the workers' regions. A point belongs to the leaf on whose side of every plane it
//! lies, so all of space is divided, not only the blocks.
//!
//! **Which plane.** Of the three dimensions each has a plane that divides the load best. Of these
//! planes that are about as good as the best, the one with the least load in the two layers beside
//! it is taken: what lies there is what both sides will visit.
//!
//! Pure geometry and counts: no mesh, no threads. Cost: for each level of the tree the blocks once,
//! some nanoseconds each; a point finds its leaf in the depth of the tree.

use glam::{DVec3, USizeVec3};

use crate::Result;
use crate::memory::filled;
use crate::parallel::machine::Machine;

/// Blocks for each worker.
const BLOCKS_PER_WORKER: usize = 1 << 14;
/// Most blocks at all.
const MAX_BLOCKS: usize = 1 << 20;
/// A plane is about as good as the best when it leaves at most this part of the load more on the
/// wrong side.
const TOLERANCE: f64 = 0.02;

/// What is divided equally.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Load {
    /// The elements that blocks hold.
    Elements,
    /// Blocks that hold elements, however many.
    ActiveBlocks,
}

/// The blocks, and how many elements each holds.
#[derive(Clone, Debug)]
pub struct Blocks {
    lower: DVec3,
    edge: f64,
    dims: USizeVec3,
    elements: Vec<f32>,
}

impl Blocks {
    /// Cubes that cover a box, many for each of `workers`, without elements.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(lower: DVec3, upper: DVec3, workers: usize) -> Result<Self> {
        let longest =
            Some((upper - lower).max_element()).filter(|&longest| longest > 0.0).unwrap_or(1.0);
        // A flat box is taken for one that is not quite so flat.
        let size = (upper - lower).max(DVec3::splat(longest / 1024.0));
        let wanted = (BLOCKS_PER_WORKER * workers).min(MAX_BLOCKS) as f64;
        let edge = (size.element_product() / wanted).cbrt();
        let dims = (size / edge).ceil().as_usizevec3();
        let elements = filled(dims.element_product(), 0.0, "blocks of a partition", || Ok(()))?;
        Ok(Self { lower, edge, dims, elements })
    }

    /// How many blocks there are.
    pub fn count(&self) -> usize {
        self.elements.len()
    }

    /// The centre of block `index`.
    pub fn center(&self, index: usize) -> DVec3 {
        let x = index % self.dims.x;
        let y = index / self.dims.x % self.dims.y;
        let z = index / (self.dims.x * self.dims.y);
        self.lower + (USizeVec3::new(x, y, z).as_dvec3() + 0.5) * self.edge
    }

    /// The volume of a block.
    pub fn volume(&self) -> f64 {
        self.edge.powi(3)
    }

    /// The block that holds `p`, or the nearest one.
    pub fn index_of(&self, p: DVec3) -> usize {
        let at = ((p - self.lower) / self.edge).as_usizevec3().min(self.dims - 1);
        (at.z * self.dims.y + at.y) * self.dims.x + at.x
    }

    /// Puts elements into a block.
    pub fn add(&mut self, index: usize, elements: f64) {
        self.elements[index] += elements as f32;
    }
}

/// Who refines where.
#[derive(Clone, Debug)]
pub struct Partition {
    /// The k-d tree; the root is the first.
    tree: Vec<Branch>,
    /// The workers in the order of the tree's leaves.
    order: Vec<usize>,
    /// The memory node of each worker.
    nodes: Vec<usize>,
    /// The group of each worker, at each level: all, then each half of the memory nodes, and so on
    /// to single nodes.
    groups: Vec<Vec<usize>>,
}

#[derive(Clone, Copy, Debug)]
enum Branch {
    /// Below `at` along `axis`: the next branch of the tree; else branch `above`.
    Plane { axis: usize, at: f64, above: usize },
    /// The place of a worker in the order.
    Leaf(usize),
}

/// A box of blocks: the first, and one past the last, along each axis.
#[derive(Clone, Copy)]
struct Region {
    from: USizeVec3,
    to: USizeVec3,
}

/// A way to divide a region.
struct Cut {
    axis: usize,
    /// The first layer above the plane.
    layer: usize,
    /// Load on the wrong side.
    miss: f64,
    /// Load of the two layers beside the plane.
    beside: f64,
}

impl Partition {
    /// Divides `blocks` among `workers` workers, at least one, on the nodes of `machine`.
    pub fn new(blocks: &Blocks, load: Load, machine: &Machine, workers: usize) -> Self {
        let nodes: Vec<usize> = (0..workers).map(|worker| machine.node_of_worker(worker)).collect();
        let mut used = nodes.clone();
        used.sort_unstable();
        used.dedup();
        let mut partition = Self { tree: Vec::new(), order: Vec::new(), nodes, groups: Vec::new() };
        let whole = Region { from: USizeVec3::ZERO, to: blocks.dims };
        partition.divide(blocks, load, machine, (&used, 0), (0..workers).collect(), whole);
        // A single node is its own group at all further levels.
        for level in 1..partition.groups.len() {
            for worker in 0..workers {
                if partition.groups[level][worker] == NO_GROUP {
                    partition.groups[level][worker] = partition.nodes[worker];
                }
            }
        }
        partition
    }

    /// Divides a region among workers, which are those on `nodes`, a group of some level.
    fn divide(
        &mut self,
        blocks: &Blocks,
        load: Load,
        machine: &Machine,
        (nodes, level): (&[usize], usize),
        workers: Vec<usize>,
        region: Region,
    ) {
        if self.groups.len() == level {
            self.groups.push(vec![NO_GROUP; self.nodes.len()]);
        }
        // A node in the group is as good a name as any.
        workers.iter().for_each(|&worker| self.groups[level][worker] = nodes[0]);
        if let [worker] = workers[..] {
            self.tree.push(Branch::Leaf(self.order.len()));
            self.order.push(worker);
            return;
        }
        let (halves, level) = if nodes.len() > 1 {
            (machine.bisect(nodes), level + 1)
        } else {
            ([nodes.to_vec(), nodes.to_vec()], level)
        };
        let (low, high): (Vec<usize>, Vec<usize>) = if nodes.len() > 1 {
            workers.iter().partition(|&&worker| halves[0].contains(&self.nodes[worker]))
        } else {
            let (low, high) = workers.split_at(workers.len() / 2);
            (low.to_vec(), high.to_vec())
        };
        let part = low.len() as f64 / workers.len() as f64;
        let cut = best_cut(blocks, load, region, part);
        let at = self.tree.len();
        let plane = blocks.lower[cut.axis] + cut.layer as f64 * blocks.edge;
        self.tree.push(Branch::Plane { axis: cut.axis, at: plane, above: 0 });
        let (mut below, mut above) = (region, region);
        below.to[cut.axis] = cut.layer;
        above.from[cut.axis] = cut.layer;
        self.divide(blocks, load, machine, (&halves[0], level), low, below);
        self.tree[at] = Branch::Plane { axis: cut.axis, at: plane, above: self.tree.len() };
        self.divide(blocks, load, machine, (&halves[1], level), high, above);
    }

    /// How many workers there are.
    pub fn workers(&self) -> usize {
        self.order.len()
    }

    /// How often the memory nodes were halved until each was alone: 0 for one node, log2 of their
    /// number, rounded up, where their cores are alike.
    pub fn levels(&self) -> usize {
        self.groups.len() - 1
    }

    /// The groups after `level` halvings, at most [`Self::levels`]: for each worker the number of a
    /// memory node of its group, the same for all of the group.
    pub fn groups(&self, level: usize) -> &[usize] {
        &self.groups[level]
    }

    /// The memory node of each worker.
    pub fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// The workers in the order of their regions' places: a group's stand together at every level.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// The place, in the order of regions, of the one that holds `p`.
    #[inline]
    pub fn place_of(&self, p: DVec3) -> usize {
        let mut branch = 0;
        loop {
            match self.tree[branch] {
                Branch::Plane { axis, at, above } => {
                    branch = if p[axis] < at { branch + 1 } else { above }
                }
                Branch::Leaf(place) => return place,
            }
        }
    }

    /// The worker in whose region `p` lies.
    #[inline]
    pub fn worker_of(&self, p: DVec3) -> usize {
        self.order[self.place_of(p)]
    }
}

/// No group yet.
const NO_GROUP: usize = usize::MAX;

/// The plane below which about `part` of a region's load lies.
fn best_cut(blocks: &Blocks, load: Load, region: Region, part: f64) -> Cut {
    let Region { from, to } = region;
    let mut layers = [0, 1, 2].map(|axis| vec![0.0_f64; to[axis] - from[axis]]);
    for z in from.z..to.z {
        for y in from.y..to.y {
            let row = (z * blocks.dims.y + y) * blocks.dims.x;
            let mut of_row = 0.0;
            for (layer, &elements) in
                layers[0].iter_mut().zip(&blocks.elements[row + from.x..row + to.x])
            {
                let elements = match load {
                    Load::Elements => f64::from(elements),
                    Load::ActiveBlocks => f64::from(u8::from(elements > 0.0)),
                };
                *layer += elements;
                of_row += elements;
            }
            layers[1][y - from.y] += of_row;
            layers[2][z - from.z] += of_row;
        }
    }
    let total: f64 = layers[2].iter().sum();
    let cuts = [0, 1, 2].map(|axis| cut_along(&layers[axis], axis, from[axis], part * total));
    let min = cuts.iter().map(|cut| cut.miss).fold(f64::INFINITY, f64::min);
    let good = cuts.into_iter().filter(|cut| cut.miss <= min + TOLERANCE * total);
    good.min_by(|a, b| a.beside.total_cmp(&b.beside)).expect("the best is as good as itself")
}

/// The plane across one axis below which the load is nearest to `wanted`; `layers` begin with
/// number `first`. It may leave one side without blocks: a region one block wide cannot be divided.
fn cut_along(layers: &[f64], axis: usize, first: usize, wanted: f64) -> Cut {
    let mut best =
        Cut { axis, layer: first, miss: wanted, beside: layers.first().copied().unwrap_or(0.0) };
    let mut below = 0.0;
    for (i, &layer) in layers.iter().enumerate() {
        below += layer;
        let miss = (below - wanted).abs();
        if miss < best.miss {
            let beside = layer + layers.get(i + 1).copied().unwrap_or(0.0);
            best = Cut { axis, layer: first + i + 1, miss, beside };
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of 40 x 30 x 20 with a uniform load of one element a block.
    fn uniform(workers: usize) -> Blocks {
        let mut blocks = Blocks::new(DVec3::ZERO, DVec3::new(40.0, 30.0, 20.0), workers).unwrap();
        (0..blocks.count()).for_each(|index| blocks.add(index, 1.0));
        blocks
    }

    /// The elements in each worker's region.
    fn shares(blocks: &Blocks, partition: &Partition) -> Vec<f64> {
        let mut shares = vec![0.0; partition.workers()];
        for (index, &elements) in blocks.elements.iter().enumerate() {
            shares[partition.worker_of(blocks.center(index))] += f64::from(elements);
        }
        shares
    }

    fn imbalance(shares: &[f64]) -> f64 {
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        shares.iter().fold(0.0_f64, |max, &share| max.max(share)) / mean
    }

    #[test]
    fn regions_have_about_equal_loads() {
        for (nodes, cores, workers) in [(1, 4, 4), (2, 1, 2), (3, 2, 6), (4, 2, 16), (12, 2, 24)] {
            let blocks = uniform(workers);
            let machine = Machine::uniform(nodes, cores);
            let partition = Partition::new(&blocks, Load::Elements, &machine, workers);
            let shares = shares(&blocks, &partition);
            assert!(imbalance(&shares) < 1.15, "{nodes} nodes, {workers} workers: {shares:?}");
            assert_eq!(partition.levels(), (nodes as f64).log2().ceil() as usize);
        }
    }

    #[test]
    fn a_group_is_a_run_of_places_at_every_level() {
        let machine = Machine::uniform(6, 2);
        let partition = Partition::new(&uniform(20), Load::Elements, &machine, 20);
        assert_eq!(partition.groups(0).iter().collect::<std::collections::HashSet<_>>().len(), 1);
        for level in 0..=partition.levels() {
            let groups = partition.groups(level);
            let mut runs: Vec<usize> =
                partition.order().iter().map(|&worker| groups[worker]).collect();
            runs.dedup();
            let all = runs.len();
            runs.sort_unstable();
            runs.dedup();
            assert_eq!(runs.len(), all, "level {level}: a group is in two places");
        }
        // At the last, groups are nodes.
        let last = partition.groups(partition.levels());
        for (a, b) in (0..20).flat_map(|a| (0..20).map(move |b| (a, b))) {
            assert_eq!(last[a] == last[b], machine.node_of_worker(a) == machine.node_of_worker(b));
        }
    }

    #[test]
    fn all_of_space_belongs_to_somebody() {
        let partition = Partition::new(&uniform(7), Load::Elements, &Machine::uniform(7, 1), 7);
        for p in [DVec3::splat(-1e9), DVec3::splat(1e9), DVec3::NAN, DVec3::new(20.0, 15.0, -1.0)] {
            assert!(partition.worker_of(p) < 7);
        }
        // Every region holds something.
        let blocks = uniform(7);
        assert!(shares(&blocks, &partition).iter().all(|&share| share > 0.0));
    }

    /// Most elements are in a corner: that many blocks are active there and elsewhere says little
    /// of the work.
    #[test]
    fn counting_elements_balances_what_counting_blocks_does_not() {
        let mut blocks = uniform(8);
        for index in 0..blocks.count() {
            if blocks.center(index).cmplt(DVec3::splat(10.0)).all() {
                blocks.add(index, 99.0);
            }
        }
        let machine = Machine::uniform(4, 2);
        let by = |load| imbalance(&shares(&blocks, &Partition::new(&blocks, load, &machine, 8)));
        assert!(by(Load::Elements) < 1.25, "{}", by(Load::Elements));
        assert!(by(Load::ActiveBlocks) > 4.0, "{}", by(Load::ActiveBlocks));
    }

    #[test]
    fn no_elements_or_no_extent_is_no_failure() {
        for (lower, upper) in [(DVec3::ZERO, DVec3::ZERO), (DVec3::ZERO, DVec3::new(1.0, 0.0, 1e9))]
        {
            let blocks = Blocks::new(lower, upper, 4).unwrap();
            assert!(blocks.count() <= 8 * BLOCKS_PER_WORKER * 4, "{}", blocks.count());
            let partition = Partition::new(&blocks, Load::Elements, &Machine::uniform(2, 2), 4);
            assert!(partition.worker_of(DVec3::ONE) < 4);
        }
    }
}
