//! The rounds of a run: which block begins with which tets, and what is tried again.

use std::cmp::Reverse;
use std::ops::Range;

use rayon::iter::repeat_n;
use rayon::prelude::*;

use super::blocks::{Blocks, owner};
use super::flips::Flips;
use super::interfaces::Interfaces;
use super::measure::Measure;
use super::report::Counts;
use super::shared::Shared;
use super::worker::{HOPELESS_PART, LastResorts, Round, Scratch, Worker};
use super::{Earlier, Effort, is_below};
use crate::memory::bits::Bits;
use crate::memory::{reserve, room, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::{Error, Result};

/// Most rounds with one measure.
const MAX_ROUNDS: u32 = 30;
/// Rounds in sequence in which nothing helped: enough that each tet was inside of a block in one of
/// them.
const MAX_IDLE: u32 = 4;
/// So few tets are improved in one block that holds all: there are no borders then, at which some
/// would have to wait. One thread works alone there, and the last tets take milliseconds each.
const ALONE: usize = 6;
/// So few tets that are left are never too many to go on.
const FEW: usize = 16;
/// Where no more than one in so many tets of the mesh is left, it is not hopeless to go on.
const FEW_OF: usize = 64;
/// Surroundings are relaxed only where no more than one in so many tets of the mesh is left: a tet
/// takes some milliseconds. Where more are left, as in slabs that are thinner than tets can be,
/// that would not end within minutes. Measured with coarsening on the brain at 6 and 9 voxels: with
/// one in 64, 149 and 373 tets stay below the target, with one in 256 206 and 474, in two thirds
/// and in nine tenths of the time.
const RELAXED_OF: usize = 256;
/// Slots of new tets that a block gets, and those that it gets for each tet to be improved.
const SLOTS: u32 = 16;
const SLOTS_PER_TET: f64 = 1.0;
/// The same for new vertices.
const VERTICES: u32 = 4;
const VERTICES_PER_TET: f64 = 0.1;

/// The number of no block.
const NOBODY: u32 = u32::MAX - 1;
/// What stands for a tet that is gone: behind all others.
const GONE: (u32, u32) = (u32::MAX, 0);
/// Tets per piece of work.
const CHUNK: usize = 1 << 10;

/// A run of rounds.
pub(super) struct Run<'m, 'a> {
    pub mesh: &'m mut TetMesh,
    pub interfaces: &'a Interfaces<'a>,
    pub measure: Measure,
    /// What is done for the tets that nothing has helped so far.
    last: LastResorts,
    /// Told how many tets were dealt with; an error ends the run.
    pub report_and_check: &'a (dyn Fn(usize) -> Result<()> + Sync),
    /// Where moves of each vertex are counted from: see [`Earlier::refined`](super::Earlier).
    pub refined: Vec<[f64; 3]>,
    /// By how much the volume of labels grew before.
    pub volumes: Vec<(i32, f64)>,
    /// What was flipped on interfaces.
    flips: Flips,
    /// Which tets are not those that refinement made.
    pub changed: Bits,
    /// Tets to be improved.
    pub queue: Vec<u32>,
    /// Tets that nothing helped.
    pub left: Vec<u32>,
    pub counts: Counts,
    pub rounds: u32,
}

impl<'m, 'a> Run<'m, 'a> {
    /// # Errors
    /// [`OutOfMemory`](Error::OutOfMemory).
    pub fn new(
        mesh: &'m mut TetMesh,
        interfaces: &'a Interfaces<'a>,
        measure: Measure,
        earlier: Earlier,
        queue: Vec<u32>,
        report_and_check: &'a (dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<Self> {
        let Earlier { mut refined, volumes } = earlier;
        if refined.len() != mesh.points.len() {
            refined = room(mesh.points.len(), "vertices of the mesh")?;
            refined.par_extend(mesh.points.par_iter().copied());
        }
        let changed = Bits::new(mesh.tets.len(), "tets of the mesh")?;
        let (left, counts, rounds) = (Vec::new(), Counts::default(), 0);
        let last = LastResorts::default();
        Ok(Self {
            mesh,
            interfaces,
            measure,
            last,
            report_and_check,
            refined,
            volumes,
            flips: Flips::default(),
            changed,
            queue,
            left,
            counts,
            rounds,
        })
    }

    /// Works until nothing helps any more. Returns what ended the work early.
    ///
    /// # Errors
    /// [`OutOfMemory`](Error::OutOfMemory), with the mesh valid.
    pub fn run(&mut self, effort: Effort) -> Result<Option<Error>> {
        let (tets, below) = (self.mesh.tets.len(), self.queue.len());
        let blocks = Blocks::new(&self.mesh.points, tets);
        let few = |of: usize| FEW.max(tets / of);
        // With more tets left than this it is hopeless to go on.
        let many = few(FEW_OF).max(below / HOPELESS_PART);
        let ended = self.run_until_idle(&blocks, many)?;
        if ended.is_some() || effort == Effort::Quick || self.left.len() > many {
            return Ok(ended);
        }
        // What is left may get long and thin tets around it, and move farther.
        std::mem::swap(&mut self.queue, &mut self.left);
        self.queue.append(&mut self.left);
        let relax = self.queue.len() <= few(RELAXED_OF);
        self.last = LastResorts { go_farther: true, relax };
        self.measure = self.measure.last();
        self.run_until_idle(&blocks, many)
    }

    /// Works until some rounds in sequence did nothing, or more than `many` tets are left: then it
    /// is in vain to go on.
    fn run_until_idle(&mut self, blocks: &Blocks, many: usize) -> Result<Option<Error>> {
        let (mut seen, mut idle, mut tried) = (self.counts.operations(), 0, usize::MAX);
        let first = self.rounds;
        while self.rounds < first + MAX_ROUNDS && idle < MAX_IDLE {
            // What nothing helped may be helped by now. Where as many are left as the last time,
            // last resorts help sooner.
            let is_worth_it = self.left.len() < tried || self.last.go_farther;
            if self.queue.is_empty() && seen < self.counts.operations() && is_worth_it {
                (seen, tried) = (self.counts.operations(), self.left.len());
                std::mem::swap(&mut self.queue, &mut self.left);
            }
            if self.queue.is_empty() {
                break;
            }
            let before = self.counts.operations();
            let ended = self.round(blocks)?;
            self.left.sort_unstable();
            self.left.dedup();
            let Self { mesh, measure, left, .. } = self;
            left.retain(|&t| is_below(mesh, t, *measure));
            if ended.is_some() || self.left.len() > many {
                return Ok(ended);
            }
            idle = if self.counts.operations() == before { idle + 1 } else { 0 };
        }
        Ok(None)
    }

    /// Improves what is in the queue, block by block. Afterwards the queue has what is to be tried
    /// again.
    fn round(&mut self, blocks: &Blocks) -> Result<Option<Error>> {
        let mut of_vertices = if self.queue.len() <= ALONE {
            zeroed(self.mesh.points.len(), "blocks of vertices")?
        } else {
            blocks.of_vertices(self.mesh, self.rounds)?
        };
        self.rounds += 1;
        let mut jobs = self.jobs(&of_vertices)?;
        let (mut slots, mut vertices) =
            (self.mesh.tets.len() as u32, self.mesh.points.len() as u32);
        for job in &mut jobs {
            let count = job.tets.len() as f64;
            job.slots = slots..slots + SLOTS + (SLOTS_PER_TET * count) as u32;
            job.vertices = vertices..vertices + VERTICES + (VERTICES_PER_TET * count) as u32;
            (slots, vertices) = (job.slots.end, job.vertices.end);
            reserve(&mut of_vertices, job.vertices.len(), "blocks of vertices")?;
            of_vertices.resize(vertices as usize, job.block);
        }
        self.make_room(slots as usize, vertices as usize)?;
        let lengths = jobs.iter().map(|job| job.tets.len());
        let done = self.side_by_side(&of_vertices, lengths, |round, job, scratch| {
            let Job { block, ref tets, ref slots, ref vertices } = jobs[job];
            let mut worker = Worker::new(round, block, slots.clone(), vertices.clone(), scratch);
            let done = worker.run(tets);
            worker.end(done.err())
        });
        let mut ended = None;
        for done in done {
            self.counts.add(&done.counts);
            self.flips.extend(done.flips)?;
            reserve(&mut self.queue, done.deferred.len(), "tets to be improved")?;
            self.queue.extend(done.deferred);
            reserve(&mut self.left, done.left.len(), "tets to be improved")?;
            self.left.extend(done.left);
            ended = ended.or(done.error);
        }
        Ok(ended)
    }

    /// Does jobs of these lengths, of different blocks, side by side. Returns what comes of them,
    /// in their order.
    pub(super) fn side_by_side<R: Send>(
        &mut self,
        of_vertices: &[u32],
        lengths: impl Iterator<Item = usize>,
        work: impl Fn(&Round<'_>, usize, Scratch) -> (R, Scratch) + Sync,
    ) -> Vec<R> {
        let round = Round {
            shared: Shared::new(self.mesh, &self.changed),
            blocks: of_vertices,
            refined: &self.refined,
            flips: &self.flips,
            interfaces: self.interfaces,
            measure: self.measure,
            last: self.last,
            report_and_check: self.report_and_check,
        };
        // The longest first, so that all threads end at the same time.
        let mut order: Vec<(Reverse<usize>, usize)> = lengths.map(Reverse).zip(0..).collect();
        order.sort_unstable();
        let on_thread = |scratch: &mut Scratch, (_, job): (Reverse<usize>, usize)| {
            let (done, left) = work(&round, job, std::mem::take(scratch));
            *scratch = left;
            (job, done)
        };
        let mut done: Vec<(usize, R)> =
            order.into_iter().par_bridge().map_init(Scratch::default, on_thread).collect();
        // What is added up is so in an order that depends on the mesh alone.
        done.sort_unstable_by_key(|&(job, _)| job);
        done.into_iter().map(|(_, done)| done).collect()
    }

    /// What each block has to do, in an order that depends on the mesh alone; keeps in the queue
    /// what no block owns.
    fn jobs(&mut self, of_vertices: &[u32]) -> Result<Vec<Job>> {
        let mut owned: Vec<(u32, u32)> = zeroed(self.queue.len(), "tets to be improved")?;
        let tets = &self.mesh.tets;
        owned.par_iter_mut().zip(&self.queue).with_min_len(CHUNK).for_each(|(owned, &t)| {
            let tet = tets[t as usize];
            let owner = (tet[0] != NONE).then(|| owner(tet.map(|v| of_vertices[v as usize])));
            *owned = match owner {
                None => GONE,
                Some(owner) => (owner.unwrap_or(NOBODY), t),
            };
        });
        owned.par_sort_unstable();
        owned.dedup();
        // Those that no block owns, and those that are gone, are the last ones now.
        let gone = owned.partition_point(|&owned| owned < GONE);
        owned.truncate(gone);
        self.queue.clear();
        let foreign = owned.partition_point(|&(block, _)| block < NOBODY);
        self.queue.extend(owned.drain(foreign..).map(|(_, t)| t));
        let job = |job: &[(u32, u32)]| Job {
            block: job[0].0,
            tets: job.iter().map(|&(_, t)| t).collect(),
            slots: 0..0,
            vertices: 0..0,
        };
        Ok(owned.chunk_by(|a, b| a.0 == b.0).map(job).collect())
    }

    /// Appends empty slots of tets, and vertices that nobody has: they are nowhere.
    fn make_room(&mut self, slots: usize, vertices: usize) -> Result<()> {
        let Self { mesh, changed, .. } = self;
        let more = slots - mesh.tets.len();
        reserve(&mut mesh.tets, more, "tets of the mesh")?;
        reserve(&mut mesh.neighbors, more, "tets of the mesh")?;
        reserve(&mut mesh.labels, more, "tets of the mesh")?;
        changed.grow(slots, "tets of the mesh")?;
        let points = vertices - mesh.points.len();
        reserve(&mut mesh.points, points, "vertices of the mesh")?;
        // By all threads, as the system hands out memory where it is first written to.
        mesh.tets.par_extend(repeat_n([NONE; 4], more));
        mesh.neighbors.par_extend(repeat_n([NONE; 4], more));
        mesh.labels.par_extend(repeat_n(0, more));
        mesh.points.resize(vertices, [f64::NAN; 3]);
        Ok(())
    }
}

/// What a block does in a round.
struct Job {
    block: u32,
    /// The tets that it begins with.
    tets: Vec<u32>,
    /// Empty slots that it may fill.
    slots: Range<u32>,
    /// Numbers of vertices that it may use.
    vertices: Range<u32>,
}
