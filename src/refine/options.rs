//! What a refinement is told beside the rules: limits, threads, the machine.

use std::time::Instant;

use crate::parallel::machine::Machine;
use crate::params;
use crate::system::binding::CoreMap;
use crate::{Error, Result};

/// Tets of the whole triangulation that a sample of the isosurface comes to have about it, for the
/// sharing of work alone.
pub(super) const TETS_PER_SAMPLE: u64 = 8;

/// Tets of the whole triangulation for each sample of the isosurface, those far from it included,
/// for progress alone: 12 to 17 on the atlases, 8 of noise.
pub(super) const ALL_TETS_PER_SAMPLE: u64 = 14;

/// What a refinement is told beside the rules.
pub struct RefineOptions {
    /// Tets expected in the end, beside those around samples of the isosurface; progress is
    /// measured against it.
    pub expected_tets: u64,
    /// Which parts of the step are done when this begins and when it ends, for progress.
    pub parts: [f64; 2],
    /// Where to end, whether rules still apply or not.
    pub limits: Limits,
    /// Workers; at least 1.
    pub threads: usize,
    /// What workers do after conflicts.
    pub contention: params::Contention,
    /// Whom workers without work ask.
    pub begging: params::Begging,
    /// The machine that workers are taken to run on.
    pub machine: Machine,
    /// The cores that workers are bound to; `None`: they are not.
    pub places: Option<CoreMap>,
    /// Whether to keep what each worker did when.
    pub timeline: bool,
    /// How the work is shared.
    pub algorithm: params::Algorithm,
    /// Under LAPD: halve the groups of memory nodes step by step, as the paper does, instead of
    /// beginning with the last step's.
    pub halving: bool,
    /// Whether to count visits of tets and vertices by memory node.
    pub count_accesses: bool,
}

impl RefineOptions {
    /// One worker without limits.
    pub fn solo() -> Self {
        Self {
            expected_tets: 1,
            parts: [0.0, 1.0],
            limits: Limits::default(),
            threads: 1,
            contention: params::Contention::default(),
            begging: params::Begging::default(),
            machine: Machine::one_node(1),
            places: None,
            timeline: false,
            algorithm: params::Algorithm::Podm,
            halving: false,
            count_accesses: false,
        }
    }
}

/// Limits of a run; `None` is no limit.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Most vertices, those of the box not counted.
    pub max_vertices: Option<usize>,
    /// When to end, and how many seconds that was after the run's start.
    pub deadline: Option<(Instant, f64)>,
    /// Most bytes: of the oracle, the triangulation, the grids, the lists, and of what comes after
    /// the refinement.
    pub max_memory: Option<u64>,
    /// Bytes that are needed after the refinement for each slot of a tet.
    pub bytes_per_slot: u64,
    /// Bytes that are needed in the end, when the triangulation has gone, beside the oracle and
    /// what `bytes_per_slot` counts.
    pub bytes_after: u64,
    /// Bytes that are held all the time besides.
    pub bytes_beside: u64,
}

impl Limits {
    /// # Errors
    /// [`Error::TimeLimit`] past the deadline.
    pub fn check_time(&self) -> Result<()> {
        match self.deadline {
            Some((end, seconds)) if Instant::now() >= end => Err(Error::time_limit(seconds)),
            _ => Ok(()),
        }
    }

    /// # Errors
    /// [`Error::MemoryLimit`] when `needed`, in bytes, is more than allowed.
    pub fn check_memory(&self, needed: u64) -> Result<()> {
        let needed = needed.saturating_add(self.bytes_beside);
        match self.max_memory {
            Some(max) if needed > max => Err(Error::MemoryLimit(format!(
                "the memory limit of {max} bytes was reached: {needed} are needed"
            ))),
            _ => Ok(()),
        }
    }
}
