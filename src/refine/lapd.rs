//! LAPD: the two-level, locality-aware algorithm, the paper's section 4. The region of each memory
//! node is refined by PODM (`podm`) with the workers of that node; operations may cross the
//! boundary of two regions, and what a tet demands beyond it is handed over.
//!
//! The paper refines in steps. In step 1 all workers refine the whole domain to the size r_1; in
//! step i its 2^(i-2) subregions are bisected, so are the groups of memory nodes that refine them,
//! and each group refines its half to r_i = r_(i-1) / 2. A group keeps the half that it holds.
//! After 1 + log2(nodes) steps each node has a subregion of its own.
//!
//! # What a step is here
//! R1 has sampled dO before there are tets (`sampling`); samples go in first, in rounds, and tets
//! are inspected when all are in. A round that makes 4 times as many points of a surface halves
//! their spacing, so **rounds are steps**: r_i = r_(i-1) / 2 down to the delta of the surface. The
//! volume rules come when dO has its last sample, and need no steps of their own: rows of tets get
//! their final size at once.
//!
//! # What is known before
//! The paper learns from the mesh of one step how to divide the next. Here the samples, and the
//! volume of each label in each block, tell how many elements there will be, so all bisections are
//! computed before the first tet is made (`partition`), and no group has to begin with a half that
//! another one meshed. Then nothing is gained by working in common regions in the early rounds, and
//! memory that others wrote would be left behind: each node works in its own region from the first
//! round on that all workers share. Rounds before that are too small for all; one worker inserts
//! the first, some the next (`podm`). [`RefineOptions::halving`] has the paper's scheme instead:
//! the last round of samples is inserted node by node, the round before by pairs of nodes in the
//! two regions of both, and so on. It visits up to twice as much remote memory
//! (docs/notes/design-notes.md).
//!
//! # Invariants
//! - A vertex is inserted by a worker of the node in whose region it lies, but for the first
//!   samples. Samples are dealt so. What a tet demands elsewhere is handed over to the node there:
//!   a circumcenter with its tet, a point of dO with what was seen about it, which is checked when
//!   it is carried out, as always (`Rules::still_applies`). The circumcenter of a tet between two
//!   surfaces is far from its facets, so this is not rare as long as tets are large.
//! - Tets are assigned by circumcenter when all samples are in: every living tet is then in one
//!   list, that of the worker in whose region its circumcenter lies. A worker that makes a tet
//!   later keeps it.
//! - Work is given away only within a node (`Levels::apart`).
//! - New tets lie in slots of the worker's own node: slots of other nodes that a cavity frees are
//!   sent home (`delaunay/numa`).
//! - The end: all workers of all nodes are idle, and nothing is handed over any more
//!   (`parallel/begging`).
//!
//! On one memory node there are no regions: the algorithm is PODM.
//!
//! Cost, beside PODM's: a lookup of a label for each block, a sort of the samples, tets by
//! circumcenter once, the region of each point.

use std::ops::Range;
use std::sync::Mutex;

use glam::DVec3;
use rayon::prelude::*;

use super::options::{RefineOptions, TETS_PER_SAMPLE};
use super::partition::{Blocks, Load, Partition};
use super::pel::Gift;
use super::rules::{RefinementPoint, Rules};
use super::sampling::Samples;
use crate::Result;
use crate::delaunay::{TetStamp, VertexKind};
use crate::memory::{reserve, room};
use crate::parallel::topology::Levels;
use crate::parallel::work_ranges::WorkRanges;
use crate::params::Algorithm;
use crate::sync::lock;

/// Whether memory nodes get regions of their own: the options ask for LAPD, and not all workers
/// are on one node.
pub(super) fn divides(options: &RefineOptions) -> bool {
    let node = |me| options.machine.node_of_worker(me);
    options.algorithm == Algorithm::Lapd && (1..options.threads).any(|me| node(me) != node(0))
}

/// The regions of a team's workers, and the tets on their way to the workers in whose regions they
/// lie.
pub(super) struct Regions {
    partition: Partition,
    /// The first worker of each worker's node.
    hosts: Vec<usize>,
    /// Whether groups are halved step by step.
    halving: bool,
    /// For each worker.
    parcels: Vec<Mutex<Vec<Vec<TetStamp>>>>,
}

impl Regions {
    /// The regions for these samples, if there are to be any.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        rules: &Rules<'_>,
        samples: &[DVec3],
        options: &RefineOptions,
    ) -> Result<Option<Self>> {
        if !divides(options) {
            return Ok(None);
        }
        let RefineOptions { threads, ref machine, .. } = *options;
        let partition = Partition::new(
            &expected_elements(rules, samples, threads)?,
            Load::Elements,
            machine,
            threads,
        );
        let nodes = partition.nodes();
        let hosts = nodes
            .iter()
            .map(|node| nodes.iter().position(|other| other == node).unwrap_or(0))
            .collect();
        let halving = options.halving;
        Ok(Some(Self {
            partition,
            hosts,
            halving,
            parcels: (0..threads).map(|_| Mutex::default()).collect(),
        }))
    }

    /// Deals the samples of each round from `first` on: sorts them by regions, and gives each
    /// worker those of its own, to be helped by the workers of its group at that round's step.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `go_on`, which is asked before each round.
    pub fn deal(
        &self,
        samples: &mut Samples,
        first: usize,
        go_on: impl Fn() -> Result<()>,
    ) -> Result<Vec<WorkRanges>> {
        let rounds: Vec<Range<usize>> = samples.rounds_from(first).collect();
        let points = &mut samples.points;
        let count = rounds.len();
        let deal = |(round, range): (usize, Range<usize>)| {
            go_on()?;
            let last = self.partition.levels();
            let level = if self.halving { (last + 1 + round).saturating_sub(count) } else { last };
            let places = self.sort_by_place(&mut points[range.clone()])?;
            let workers = self.partition.order();
            let mut work_ranges = vec![0..0; workers.len()];
            for (place, &worker) in workers.iter().enumerate() {
                work_ranges[worker] = range.start + places[place]..range.start + places[place + 1];
            }
            Ok(WorkRanges::of_groups(
                work_ranges.into_iter(),
                self.partition.groups(level).to_vec(),
            ))
        };
        rounds.into_iter().enumerate().map(deal).collect()
    }

    /// Sorts points by the places of their regions, and leaves those of each in their order;
    /// returns where each place begins, and the end.
    fn sort_by_place(&self, points: &mut [DVec3]) -> Result<Vec<usize>> {
        let mut keys = room(points.len(), "places of samples")?;
        let place = |(at, &p): (usize, &DVec3)| (self.partition.place_of(p) as u32, at as u32);
        points.par_iter().enumerate().map(place).collect_into_vec(&mut keys);
        keys.par_sort_unstable();
        let mut sorted = room(points.len(), "samples of the isosurface")?;
        keys.par_iter().map(|&(_, at)| points[at as usize]).collect_into_vec(&mut sorted);
        points.copy_from_slice(&sorted);
        let begin = |place: usize| keys.partition_point(|key| (key.0 as usize) < place);
        Ok((0..=self.partition.workers()).map(begin).collect())
    }

    /// The worker in whose region `p` lies.
    #[inline]
    pub fn worker_of(&self, p: DVec3) -> usize {
        self.partition.worker_of(p)
    }

    /// The first worker of the memory node in whose region `p` lies, if that is not the node of
    /// worker `me`.
    #[inline]
    pub fn elsewhere(&self, me: usize, p: DVec3) -> Option<usize> {
        let host = self.hosts[self.worker_of(p)];
        (host != self.hosts[me]).then_some(host)
    }

    /// Who may give work to whom: the workers of each memory node.
    pub fn levels(&self) -> Levels {
        Levels::apart(self.partition.nodes())
    }

    /// Sends tets to a worker.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn send(&self, worker: usize, tets: Vec<TetStamp>) -> Result<()> {
        let mut parcels = lock(&self.parcels[worker]);
        reserve(&mut parcels, 1, "parcels of tets")?;
        parcels.push(tets);
        Ok(())
    }

    /// What was sent to a worker.
    pub fn receive(&self, worker: usize) -> Vec<Vec<TetStamp>> {
        std::mem::take(&mut lock(&self.parcels[worker]))
    }
}

/// What a worker keeps for each other node, named by that node's first worker, until it is enough
/// to be sent.
#[derive(Default)]
pub(super) struct Outbox(Vec<Gift>);

/// Demands for the regions of one node that are enough.
const PARCEL: usize = 32;

impl Outbox {
    /// Adds what a tet points: a poor tet asks for its circumcenter, whenever it is asked; a point
    /// of dO was searched for, and goes with the `interfaces` behind it. Returns whether there is
    /// enough for `host`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn put(
        &mut self,
        host: usize,
        stamp: TetStamp,
        wanted: &RefinementPoint,
        interfaces: u32,
    ) -> Result<bool> {
        if self.0.len() <= host {
            self.0.resize_with(host + 1, Gift::default);
        }
        let parcel = &mut self.0[host];
        if wanted.kind == VertexKind::Free {
            reserve(&mut parcel.poor, 1, "tets of other regions")?;
            parcel.poor.push(stamp);
        } else {
            reserve(&mut parcel.points, 1, "points of other regions")?;
            parcel.points.push((stamp, *wanted, interfaces));
        }
        Ok(parcel.poor.len() + parcel.points.len() >= PARCEL)
    }

    /// Takes out what is kept for `host`, if anything.
    pub fn take(&mut self, host: usize) -> Option<Gift> {
        let parcel = std::mem::take(self.0.get_mut(host)?);
        (parcel.poor.len() + parcel.points.len() > 0).then_some(parcel)
    }

    /// All for whom something may be kept.
    pub fn hosts(&self) -> Range<usize> {
        0..self.0.len()
    }
}

/// Blocks with the elements that are to be expected in each, from samples and sizes.
fn expected_elements(rules: &Rules<'_>, samples: &[DVec3], workers: usize) -> Result<Blocks> {
    let [lower, upper] = rules.oracle.bounds();
    let mut blocks = Blocks::new(lower, upper, workers)?;
    let volume = blocks.volume();
    let mut inside = room(blocks.count(), "blocks of a partition")?;
    let expected = |index: usize| rules.expected_tets(blocks.center(index), volume);
    (0..blocks.count()).into_par_iter().map(expected).collect_into_vec(&mut inside);
    inside.into_iter().enumerate().for_each(|(index, tets)| blocks.add(index, tets));
    for &p in samples {
        blocks.add(blocks.index_of(p), TETS_PER_SAMPLE as f64);
    }
    Ok(blocks)
}
