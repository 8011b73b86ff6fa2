//! One mesh of a prepared image: refined, collected, rid of slivers.

use rayon::prelude::*;

use super::adapt::{self, Adapted};
use super::improve::Known;
use super::mend::Mending;
use super::prepare::Prepared;
use super::refine::Ordered;
use super::{Stopwatch, improve, messages, refine};
use crate::delaunay::Triangulation;
use crate::delaunay::check::Check;
use crate::delaunay::worker::Counters;
use crate::image::LabelImage;
use crate::improve::{Improvement, facets_below};
use crate::memory::aside::or_drop_aside;
use crate::mesh::TetMesh;
use crate::mesh::extract::Numbered;
use crate::monitor::Monitor;
use crate::params::{Adaptive, CertificateLevel, Improve, MeshParams};
use crate::refine::Asked;
use crate::refine::options::{Limits, RefineOptions};
use crate::refine::podm::Refinement;
use crate::refine::rules::Rules;
use crate::verify::Examined;
use crate::{Error, Result};

/// Vertices of a triangulation that nothing has been inserted into.
const BOX_CORNERS: u64 = 8;

/// What is meshed, and how.
#[derive(Clone, Copy)]
pub(super) struct Attempt<'a> {
    pub(super) image: &'a LabelImage,
    pub(super) params: &'a MeshParams,
    pub(super) limits: &'a Limits,
}

/// A refined triangulation.
pub(super) struct Refined {
    triangulation: Triangulation,
    refinement: Refinement,
    differences: Vec<u64>,
    mended: Option<Mending>,
}

/// A mesh without its facets.
pub(super) struct Made {
    pub(super) mesh: TetMesh,
    /// What led to it; a limit that ended the improvement is here, too.
    pub(super) refinement: Refinement,
    /// How many differences from the image in what is connected each comparison found.
    pub(super) differences: Vec<u64>,
    pub(super) check: Check,
    pub(super) examined: Examined,
    pub(super) improvement: Improvement,
}

/// A triangulation that is numbered and checked, ready to be copied.
struct Checked {
    numbered: Numbered,
    check: Check,
    examined: Examined,
}

impl Refined {
    /// Whether no limit ended the refinement.
    pub(super) fn is_complete(&self) -> bool {
        self.refinement.ended_by.is_none()
    }

    /// Gives the memory back, with a look at the cancel flag now and then.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn give_back(self, monitor: &Monitor<'_>) -> Result<()> {
        self.triangulation.give_back(&|| monitor.advance(0))
    }

    /// How many tets of labels there are.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::OutOfMemory`].
    pub(super) fn count_tets(
        &self,
        attempt: &Attempt<'_>,
        prepared: &Prepared,
        monitor: &Monitor<'_>,
    ) -> Result<u64> {
        let rules = attempt.rules(&self.triangulation, prepared);
        let order = self.triangulation.tets_by_place(|| monitor.advance(0))?;
        Ok(order.par_iter().filter(|&&t| rules.label(t) != 0).count() as u64)
    }
}

impl Made {
    /// How many tets of labels there are.
    pub(super) fn count_tets(&self) -> u64 {
        self.mesh.labels.par_iter().filter(|&&label| label != 0).count() as u64
    }
}

impl Attempt<'_> {
    fn rules<'s>(&'s self, triangulation: &'s Triangulation, prepared: &'s Prepared) -> Rules<'s> {
        let Prepared { oracle, sizing, .. } = prepared;
        Rules::new(triangulation, oracle, sizing, self.params, self.image.labels())
    }

    /// Refines a new triangulation; `parts` of the step of refinement are done when this begins and
    /// when it ends. Where sampling is adapted the sizing field is then another one.
    ///
    /// # Errors
    /// [`Error::Unsupported`] where threads cannot be bound; [`Error::Cancelled`];
    /// [`Error::OutOfMemory`]; limits, where no partial mesh is allowed.
    pub(super) fn refine(
        &self,
        prepared: &mut Prepared,
        parts: [f64; 2],
        watch: &mut Stopwatch,
        monitor: &Monitor<'_>,
    ) -> Result<Refined> {
        let triangulation = refine::triangulation_around(&prepared.oracle, prepared.sizing.max())?;
        let (triangulation, (refinement, adapted)) =
            or_drop_aside(triangulation, |triangulation| {
                self.refine_in(triangulation, prepared, parts, monitor)
            })?;
        let seconds = watch.add_to(|seconds| &mut seconds.refine);
        messages::log_refinement(monitor, &refinement.counters, seconds);
        let Adapted { differences, mended, .. } = adapted;
        Ok(Refined { triangulation, refinement, differences, mended })
    }

    fn refine_in(
        &self,
        triangulation: &Triangulation,
        prepared: &mut Prepared,
        parts: [f64; 2],
        monitor: &Monitor<'_>,
    ) -> Result<(Refinement, Adapted)> {
        let &Self { image, params, limits } = self;
        let by_volume = refine::expected_by_volume(prepared, params);
        let options = RefineOptions {
            parts: adapt::parts(params, 0, parts),
            ..refine::options(params, limits.clone(), by_volume as u64)?
        };
        let rules = self.rules(triangulation, prepared);
        let mut refinement = crate::refine::refine(&rules, &options, monitor)?;
        let mut adapted = Adapted::default();
        if params.adaptive == Adaptive::Topology && refinement.ended_by.is_none() {
            let prepared = &*prepared;
            let run = adapt::Run { image, prepared, triangulation, params, limits, parts };
            adapted = run.adapt(&mut refinement, monitor)?;
        }
        if let Some(sizing) = adapted.sizing.take() {
            prepared.sizing = sizing;
        }
        if let Some(limit) = refinement.ended_by.take_if(|_| !params.partial) {
            return Err(limit);
        }
        Ok((refinement, adapted))
    }

    /// The mesh of a refined triangulation, without slivers, and what was checked before these were
    /// removed.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] where delta is so coarse that there is no tet;
    /// [`Error::Cancelled`]; [`Error::OutOfMemory`]; limits, where no partial mesh is allowed.
    pub(super) fn finish(
        &self,
        refined: Refined,
        prepared: &Prepared,
        watch: &mut Stopwatch,
        monitor: &Monitor<'_>,
    ) -> Result<Made> {
        let &Self { image, params, limits } = self;
        let Refined { triangulation, mut refinement, differences, mended } = refined;
        let (triangulation, checked) = or_drop_aside(triangulation, |triangulation| {
            self.number_and_check(triangulation, &mut refinement, prepared, watch, monitor)
        })?;
        let Checked { numbered, check, examined } = checked;
        let points_kept = numbered.points_kept;
        let mesh = numbered.copy_and_give_back(triangulation, monitor)?;
        let seconds = watch.add_to(|seconds| &mut seconds.extract);
        messages::log_extraction(monitor, &mesh, seconds);

        if !self.improves(&refinement) {
            let facets_below = facets_below(&mesh, params.facet_angle, monitor)?;
            let improvement = Improvement { facets_below, ..Improvement::default() };
            return Ok(Made { mesh, refinement, differences, check, examined, improvement });
        }
        let (mesh, (improvement, ended_by)) = or_drop_aside(mesh, |mesh| {
            let known = Known { points_kept, mended };
            improve::improve_mesh(mesh, known, prepared, image, params, limits, monitor)
        })?;
        refinement.ended_by = ended_by;
        let seconds = watch.add_to(|seconds| &mut seconds.improve);
        messages::log_improvement(monitor, &improvement, seconds);
        Ok(Made { mesh, refinement, differences, check, examined, improvement })
    }

    /// Improvement needs the background around the object. What refinement did not finish is left
    /// as it is.
    fn improves(&self, refinement: &Refinement) -> bool {
        self.params.improve != Improve::None && refinement.ended_by.is_none()
    }

    /// What is kept of a triangulation, and what is checked before this is copied: the vertices
    /// and the order of the tets are in memory only until then.
    fn number_and_check(
        &self,
        triangulation: &Triangulation,
        refinement: &mut Refinement,
        prepared: &Prepared,
        watch: &mut Stopwatch,
        monitor: &Monitor<'_>,
    ) -> Result<Checked> {
        let &Self { image, params, .. } = self;
        let rules = self.rules(triangulation, prepared);
        let background = refine::background_of(params, self.improves(refinement));
        let Ordered { mut numbered, order } =
            refine::number(&rules, image.labels(), background, monitor)?;
        if !numbered.labels().par_iter().any(|&label| label != 0) {
            return Err(refinement.ended_by.take().unwrap_or_else(|| {
                Error::InvalidArgument(format!(
                    "delta {} is too coarse for the object: no tet has its circumcenter inside",
                    params.delta
                ))
            }));
        }
        watch.add_to(|seconds| &mut seconds.extract);
        let (check, examined) = if params.certificate == CertificateLevel::None {
            let Counters { insertions, removals, .. } = refinement.counters;
            let vertices = BOX_CORNERS + insertions - removals;
            (Check { tets: order.len() as u64, vertices, ..Check::default() }, Examined::default())
        } else {
            let asked = match &refinement.ended_by {
                None => Asked::LeftOver(&refinement.left_over),
                Some(_) => Asked::All,
            };
            let examine = || crate::refine::examine(&rules, &order, asked, monitor);
            let (kept, (check, unmet)) = or_drop_aside(numbered, |_| examine())?;
            numbered = kept;
            let non_delaunay_facets = Some(check.non_delaunay_facets);
            (check, Examined { non_delaunay_facets, unmet: Some(unmet) })
        };
        watch.add_to(|seconds| &mut seconds.certify);
        monitor.note_tets(check.tets);
        Ok(Checked { numbered, check, examined })
    }

    /// Both, as [`Self::refine`] and [`Self::finish`].
    ///
    /// # Errors
    /// Those of both.
    pub(super) fn make(
        &self,
        prepared: &mut Prepared,
        watch: &mut Stopwatch,
        monitor: &Monitor<'_>,
    ) -> Result<Made> {
        let refined = self.refine(prepared, [0.0, 1.0], watch, monitor)?;
        self.finish(refined, prepared, watch, monitor)
    }
}
