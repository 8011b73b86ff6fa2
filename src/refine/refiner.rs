//! One worker's loop over the poor elements.
//!
//! First the samples of the isosurface are inserted. Then all tets are looked at, in the order of the PEL (`pel`): looking asks the surface rule R3, then the
//! volume rules. A surface demand is carried out at once; a tet that only a volume rule finds poor waits until no tet is left to be looked at.
//!
//! Limits end the loop between two operations, so the triangulation is whole then: a mesh can be made of it. Time and memory are looked at every
//! thousand steps, as is the cancel flag; a step takes microseconds.

use std::time::Instant;

use super::pel::{Pel, Task};
use super::rules::{Demand, Facets, Lookups, Rule, Rules};
use super::sampling::sample_isosurface;
use crate::delaunay::worker::Counters;
use crate::delaunay::{Insertion, Removal, Solo, TetStamp, Triangulation, VertexId, VertexKind, Worker};
use crate::monitor::Monitor;
use crate::{Error, Result};

/// Steps between two looks at the cancel flag and the limits.
const LOOK_EVERY: u64 = 1024;

/// Entries that a stack has room for at each look: more than the steps until the next one push, unless cavities are monstrous.
const ROOM: usize = 64 * LOOK_EVERY as usize;

/// Tets of the whole triangulation that a sample of the isosurface comes to have about it, for progress only.
const TETS_PER_SAMPLE: u64 = 8;

/// What the loop is told beside the rules.
pub struct Schedule {
    /// Tets expected in the end, beside those around samples of the isosurface; progress is measured against it.
    pub expected_tets: u64,
    /// Where to end, whether rules still apply or not.
    pub limits: Limits,
}

/// Limits of a run; `None` is no limit.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Most vertices, those of the box not counted.
    pub max_vertices: Option<usize>,
    /// When to end, and how many seconds that was after the run's start.
    pub deadline: Option<(Instant, f64)>,
    /// Most bytes: of the oracle, the triangulation, the grids, the stacks, and of what comes after the refinement.
    pub max_memory: Option<u64>,
    /// Bytes that are needed after the refinement for each slot of a tet.
    pub bytes_per_slot: u64,
}

impl Limits {
    /// # Errors
    /// [`Error::TimeLimit`] past the deadline.
    pub fn check_time(&self) -> Result<()> {
        match self.deadline {
            Some((end, seconds)) if Instant::now() >= end => {
                Err(Error::TimeLimit(format!("the time limit of {seconds} seconds was reached")))
            }
            _ => Ok(()),
        }
    }

    /// # Errors
    /// [`Error::MemoryLimit`] when `needed`, in bytes, is more than allowed.
    pub fn check_memory(&self, needed: u64) -> Result<()> {
        match self.max_memory {
            Some(most) if needed > most => {
                Err(Error::MemoryLimit(format!("the memory limit of {most} bytes was reached: {needed} are needed")))
            }
            _ => Ok(()),
        }
    }
}

/// What a refinement did beside the operations of the kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Vertices that each of R1 to R5 inserted, and those that R6 removed.
    pub by_rule: [u64; 6],
    /// Tets that were looked at.
    pub looks: u64,
    /// What was asked of the oracle meanwhile.
    pub lookups: Lookups,
}

/// How a refinement ended.
#[derive(Debug)]
pub struct Refinement {
    /// Operations.
    pub counters: Counters,
    /// Rules and lookups.
    pub work: Work,
    /// The limit that ended it; `None`: no rule applies any more.
    pub ended_by: Option<Error>,
}

struct Refiner<'r, 'a> {
    rules: &'r Rules<'a>,
    triangulation: &'a Triangulation,
    worker: Worker<Solo>,
    pel: Pel,
    near: Vec<VertexId>,
    most_vertices: u64,
    expected_tets: u64,
    work: Work,
}

/// Refines until no rule applies, or a limit is reached: one of the schedule's, or that of the ids.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]; [`Error::Internal`].
pub fn refine(rules: &Rules<'_>, schedule: &Schedule, monitor: &Monitor<'_>) -> Result<Refinement> {
    let mut refiner = Refiner {
        rules,
        triangulation: rules.triangulation,
        worker: Worker::new(Solo),
        pel: Pel::default(),
        near: Vec::new(),
        most_vertices: schedule.limits.max_vertices.map_or(u64::MAX, |most| most as u64),
        expected_tets: schedule.expected_tets,
        work: Work::default(),
    };
    let done = refiner.insert_samples(schedule, monitor).and_then(|()| refiner.run(schedule, monitor));
    let ended_by = match done {
        Ok(()) => None,
        Err(limit) if limit.is_limit() => Some(limit),
        Err(error) => return Err(error),
    };
    Ok(Refinement { counters: refiner.worker.counters, work: refiner.work, ended_by })
}

impl Refiner<'_, '_> {
    /// R1. Afterwards all tets are new.
    fn insert_samples(&mut self, schedule: &Schedule, monitor: &Monitor<'_>) -> Result<()> {
        let go_on = || monitor.check_cancelled().and_then(|()| schedule.limits.check_time());
        let samples = sample_isosurface(self.rules.oracle, self.rules.delta, go_on)?;
        self.expected_tets += TETS_PER_SAMPLE * samples.len() as u64;
        let mut at = self
            .triangulation
            .living_tets()
            .next()
            .ok_or_else(|| Error::Internal("a triangulation is empty".into()))?;
        for (steps, &p) in samples.iter().enumerate() {
            if (steps as u64).is_multiple_of(LOOK_EVERY) {
                self.look_around(schedule, monitor)?;
            }
            self.check_vertices()?;
            at = self.triangulation.locate(at, p);
            match self.worker.insert(self.triangulation, at, p, VertexKind::Isovertex)? {
                Insertion::Done(_) => {
                    self.work.by_rule[Rule::R1 as usize] += 1;
                    at = self.worker.created()[0];
                }
                Insertion::Duplicate | Insertion::NotInConflict => {}
                Insertion::Blocked => return Err(blocked()),
            }
        }
        self.pel.make_room(self.triangulation.tet_bound() as usize)?;
        for t in self.triangulation.living_tets() {
            self.pel.push_waiting(self.triangulation.stamp(t));
        }
        Ok(())
    }

    fn check_vertices(&self) -> Result<()> {
        let counters = &self.worker.counters;
        if counters.insertions - counters.removals >= self.most_vertices {
            return Err(Error::LimitReached(format!("the limit of {} vertices was reached", self.most_vertices)));
        }
        Ok(())
    }

    fn run(&mut self, schedule: &Schedule, monitor: &Monitor<'_>) -> Result<()> {
        let mut steps = 0_u64;
        loop {
            if steps.is_multiple_of(LOOK_EVERY) {
                self.look_around(schedule, monitor)?;
            }
            steps += 1;
            let Some(task) = self.pel.pop() else { return Ok(()) };
            match task {
                Task::Look(stamp) if self.triangulation.is_current(stamp) => self.look(stamp)?,
                Task::Serve(stamp) if self.triangulation.is_current(stamp) => {
                    if let Some(demand) = self.rules.volume_demand(stamp.tet) {
                        self.carry_out(demand)?;
                    }
                }
                Task::Look(..) | Task::Serve(_) => {}
            }
        }
    }

    /// Reports, looks at the limits, and makes room on the stacks, so that pushing need not ask for memory.
    #[cold]
    fn look_around(&mut self, schedule: &Schedule, monitor: &Monitor<'_>) -> Result<()> {
        // Of the box there are some more.
        let tets = self.worker.counters.created.saturating_sub(self.worker.counters.destroyed);
        // Approaches 1 from below however wrong the expectation is.
        let part = 1.0 - (-2.0 * tets as f64 / self.expected_tets.max(1) as f64).exp();
        monitor.advance_to(part, tets)?;
        self.pel.make_room(ROOM)?;
        let later = u64::from(self.triangulation.tet_bound()) * schedule.limits.bytes_per_slot;
        schedule.limits.check_memory(self.rules.bytes() + self.worker.bytes() + self.pel.bytes() + later)?;
        schedule.limits.check_time()
    }

    fn look(&mut self, stamp: TetStamp) -> Result<()> {
        self.work.looks += 1;
        self.rules.mark_looked(stamp.tet);
        if let Some(demand) = self.rules.surface_demand(stamp.tet, Facets::Second, &mut self.work.lookups) {
            // What was inserted may lie in the neighbour's circumball alone: then the tet is looked at again.
            if self.carry_out(demand)? && self.triangulation.is_current(stamp) {
                self.pel.push_made(stamp);
            }
        } else if self.rules.volume_demand(stamp.tet).is_some() {
            self.pel.push_poor(stamp);
        }
        Ok(())
    }

    /// Inserts what a rule demanded, and applies R6. `false`: rounding placed the point on a vertex or out of the conflict zone; the demand stays unmet, and
    /// is counted so in the end.
    fn carry_out(&mut self, demand: Demand) -> Result<bool> {
        self.check_vertices()?;
        match self.worker.insert(self.triangulation, demand.start, demand.point, demand.kind)? {
            Insertion::Done(v) => {
                self.work.by_rule[demand.rule as usize] += 1;
                self.rules.note_vertex(v, demand.point, demand.kind)?;
                self.push_created();
                if demand.kind == VertexKind::Isovertex {
                    self.remove_near_free_vertices(demand)?;
                }
                Ok(true)
            }
            Insertion::Duplicate | Insertion::NotInConflict => Ok(false),
            Insertion::Blocked => Err(blocked()),
        }
    }

    fn remove_near_free_vertices(&mut self, demand: Demand) -> Result<()> {
        let mut near = std::mem::take(&mut self.near);
        self.rules.near_free_vertices(demand.point, &mut near);
        for &v in &near {
            if self.worker.remove(self.triangulation, v)? == Removal::Done {
                self.work.by_rule[Rule::R6 as usize] += 1;
                self.push_created();
            }
        }
        self.near = near;
        Ok(())
    }

    fn push_created(&mut self) {
        for &t in self.worker.created() {
            self.pel.push_made(self.triangulation.stamp(t));
        }
    }
}

fn blocked() -> Error {
    Error::Internal("a lone worker was blocked".into())
}

/// Counts the tets to which a rule still applies when refinement has ended, by rule: what was demanded and could not be inserted. A tet of the object that
/// is too flat for its circumcenter to be computed counts under R4.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn unmet_rules(rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<[u64; 6]> {
    let mut unmet = [rules.uncovered_edges(monitor)?, 0, 0, 0, 0, 0];
    let mut asked = Lookups::default();
    for (i, t) in rules.triangulation.living_tets().enumerate() {
        if (i as u64).is_multiple_of(LOOK_EVERY) {
            monitor.advance(LOOK_EVERY as usize)?;
        }
        if let Some(demand) = rules.surface_demand(t, Facets::Once, &mut asked).or_else(|| rules.volume_demand(t)) {
            unmet[demand.rule as usize] += 1;
        } else if rules.is_undecided(t) {
            unmet[Rule::R4 as usize] += 1;
        }
    }
    Ok(unmet)
}
