//! Where the mesh of a refinement differs from the image, as far as it counts.
//!
//! The mesh is compared voxel by voxel ([`differences`](crate::verify::topology::differences)).
//!
//! **What counts.** Where delta is less than two voxels all differences do. At larger deltas many
//! are far smaller than samples are apart: tunnels of a voxel, or voxels that touch. Samples would
//! have to be closer than a voxel there, and mostly the components of labels are right without. So
//! what counts then is looked for in steps, the next one when nothing can be done any more about
//! what came before: most of it is gone by then.
//!
//! 1. What is farther than a voxel ([`Difference::is_far`]), as in the middle of a hole three
//!    voxels wide. Euler characteristics do not tell of all of these: a hole in a sheet and a
//!    cavity that is missing cancel out. Voxels alone are compared. The first [`FAR_FIRST`]
//!    comparisons begin so.
//! 2. The mesh is mended for trial, as the finished one will be first ([`mend`](super::mend)), and
//!    its components are measured as the certificate measures them. A label is *wrong* if even so
//!    it has a component merged, torn, or of another Euler characteristic than the image's. If no
//!    label is, nothing is far, and no wall is missed, that is all.
//! 3. What is far, or in components that are lost; nicks, where the mesh ends before a wall; voxels
//!    and pieces of wrong labels. Those of wrong labels are left out, in this step and the next
//!    two, where they are so near to a tet that mending has changed that it most likely has dealt
//!    with them.
//! 4. Places where wrong labels touch themselves, and should not. Most of these change no Euler
//!    characteristic.
//! 5. Places where they do not, and should. Samples about these are the closest.
//! 6. All that is wrong with wrong labels.
//!
//! The last four are the [`Scope`]s.
//!
//! Where the mesh has changed in few places no more is looked at than these (`changes`): the tets
//! near to those that are new or gone. Wrong labels are then those that were found last, but for
//! no more than [`WRONG_FOR`] comparisons, and for the third step only.
//!
//! What one trial of mending changed is tried first in the next one (`mend/earlier`).
//!
//! Parallel in the current rayon pool, the same for any number of threads. Cost: for what is far
//! alone, a pass through tets and voxels; for the rest that of a mesh copied, mended, and its
//! components and boundaries measured, and another such pass. Where little has changed one look at
//! each slot of a tet, and all of this but for mending for a part of the mesh.

use std::collections::HashSet;

use glam::DVec3;
use rayon::prelude::*;

use super::changes::SeenTets;
use super::mend::{
    Earlier, Left, Mended, Mending, is_mended, left_unmended, mend_measured, passes,
};
use super::prepare::Prepared;
use super::refine::{Part, background_of, collect, collect_near, tets_near};
use crate::Result;
use crate::delaunay::TetId;
use crate::image::LabelImage;
use crate::image::region::Region;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::room;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::{Improve, MeshParams};
use crate::refine::rules::Rules;
use crate::verify::topology::differences::{Change, Difference, Differences, Kind};
use crate::verify::topology::measured::MeshTopology;

/// So many comparisons begin with far differences alone. After them these are few, and are sampled
/// together with others.
const FAR_FIRST: usize = 3;

/// In so many comparisons of parts of the mesh labels are taken to be as wrong as they were.
const WRONG_FOR: usize = 2;

/// Tets of one piece of work, between two looks at the cancel flag.
const CHUNK: usize = 1 << 12;

/// Mending deals with what is so near to the box around a tet that it changes, in voxels.
const BESIDE: f64 = 0.5;

/// Which differences count at a coarse delta, in this order. Each holds those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Scope {
    /// What is far, or lost, and nicks. Voxels and pieces of wrong labels, but for what mending has
    /// dealt with, which is left out of the next two, too.
    Apart,
    /// Places where wrong labels touch themselves, and should not.
    Touching,
    /// Places where they do not, and should.
    Parted,
    /// All of wrong labels.
    OfWrongLabels,
}

/// Comparisons of one mesh with its image, again and again while it is made.
pub(super) struct Comparison<'a> {
    image: &'a LabelImage,
    prepared: &'a Prepared,
    params: &'a MeshParams,
    differences: Differences<'a>,
    /// How many there were.
    count: usize,
    /// The tets that there were the last time.
    seen: SeenTets,
    /// All differences that there were when all were looked for last.
    found: Vec<Difference>,
    /// Where the mesh has changed between then and the last time; `None`: all were never looked
    /// for.
    changed_since: Option<VoxelBlocks>,
    /// The components of the image that were lost when topology was measured last.
    lost: HashSet<u32>,
    /// The tets that mending for trial changed the last time.
    earlier: Earlier,
    /// What was wrong when the mesh was mended for trial last, if it ever was.
    trial: Option<Trial>,
    /// What mending the mesh comes to with the first of its passes, if it was mended for trial the
    /// last time. Tets are numbered as in the finished mesh before improvement.
    pub mended: Option<Mending>,
}

/// What came of mending a mesh for trial.
struct Trial {
    /// The comparison in which that was done.
    comparison: usize,
    /// The labels that were wrong even so.
    wrong: HashSet<i32>,
    /// For each tet that was changed the labels that it had and has, each with what is near to the
    /// tet, in voxels; by label.
    changed: Vec<(i32, [DVec3; 2])>,
}

impl Trial {
    /// Whether a label has lost or gained a tet near to a place, in voxels.
    fn has_changed(&self, label: i32, index: DVec3) -> bool {
        let first = self.changed.partition_point(|&(other, _)| other < label);
        let mut of_label = self.changed[first..].iter().take_while(|&&(other, _)| other == label);
        of_label.any(|&(_, [low, high])| index.cmpge(low).all() && index.cmple(high).all())
    }
}

impl<'a> Comparison<'a> {
    /// Bytes for each slot of a tet that are held between two comparisons.
    pub const BYTES_PER_SLOT: u64 = SeenTets::BYTES_PER_SLOT;

    /// Of meshes of `image`, whose object lies in `region`.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(
        image: &'a LabelImage,
        prepared: &'a Prepared,
        params: &'a MeshParams,
        region: Region,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let differences = Differences::new(image, region, &prepared.oracle, monitor)?;
        let (count, seen, found, changed_since, lost, earlier, trial, mended) = Default::default();
        Ok(Self {
            image,
            prepared,
            params,
            differences,
            count,
            seen,
            found,
            changed_since,
            lost,
            earlier,
            trial,
            mended,
        })
    }

    /// Bytes that are held between two comparisons, beside those for each slot.
    pub fn bytes(&self) -> u64 {
        self.differences.bytes()
    }

    /// Bytes that are needed at once, beside the mesh and what finds its boundaries.
    pub fn bytes_needed(image: &LabelImage, region: &Region) -> u64 {
        Differences::bytes_needed(image, region)
    }

    /// Compares the mesh that there is, labelled by `rules`. `sample` gets the differences that
    /// count: those that are far in the first comparisons, then those of one [`Scope`] after the
    /// other, until it tells that there will be samples. `false`: there will be none.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory); those of
    /// `sample`.
    pub fn find(
        &mut self,
        rules: &Rules<'_>,
        sample: &mut impl FnMut(&[Difference]) -> Result<bool>,
        monitor: &Monitor<'_>,
    ) -> Result<bool> {
        self.mended = None;
        self.count += 1;
        if self.all_count() {
            if !self.compare_part(rules, monitor)? {
                let (mesh, topology) = self.measure(rules, monitor)?;
                self.found = self.differences.of(&mesh, &topology, None, monitor)?;
            }
            return sample(&self.found);
        }
        let is_far_first = self.count <= FAR_FIRST;
        if is_far_first && sample(&self.far(rules, monitor)?)? {
            return Ok(true);
        }
        let is_found = self.compare_part(rules, monitor)?;
        // What was wrong with an earlier mesh is a reason for few samples only.
        let is_known = |trial: &Trial| self.count <= trial.comparison + WRONG_FOR;
        if is_found
            && self.trial.as_ref().is_some_and(is_known)
            && sample(&self.within(Scope::Apart)?)?
        {
            return Ok(true);
        }
        let (mut mesh, topology) = self.measure(rules, monitor)?;
        self.lost = topology.lost(self.differences.of_image())?;
        let is_right = self.mend(&mut mesh, &topology, monitor)?;
        // What counts even so is far, or a nick.
        if is_right && is_far_first && !self.differences.has_nicks(&mesh, monitor)? {
            // All differences were not looked for.
            self.changed_since = None;
            return Ok(false);
        }
        if !is_found {
            self.found = self.differences.of(&mesh, &topology, None, monitor)?;
        }
        for scope in [Scope::Apart, Scope::Touching, Scope::Parted, Scope::OfWrongLabels] {
            if sample(&self.within(scope)?)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The voxels that are farther than a voxel. No mesh is made for it, and no topology measured.
    fn far(&mut self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<Vec<Difference>> {
        let is_first = self.seen.is_empty();
        let near = self.changed(rules, monitor)?.and_around()?;
        if let Some(since) = &self.changed_since {
            since.add_blocks(near.blocks());
        }
        let few = if is_first { None } else { tets_near(rules, &near, monitor)? };
        let triangulation = rules.triangulation();
        let corners = |t: TetId| triangulation.corners(triangulation.tet(t).vertices());
        let visit_tets = |visit: &(dyn Fn(u16, [DVec3; 4]) + Sync)| {
            let Some(tets) = &few else { return self.seen.visit(triangulation, visit, monitor) };
            tets.par_chunks(CHUNK).try_for_each(|tets| {
                monitor.advance(0)?;
                tets.iter().for_each(|&t| visit(rules.label(t), corners(t)));
                Ok(())
            })
        };
        let changed = few.is_some().then(|| near.blocks());
        self.differences.far(changed, visit_tets, monitor)
    }

    /// Where the mesh has changed since it was looked at last; nowhere the first time.
    fn changed(&mut self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<VoxelBlocks> {
        let changed = VoxelBlocks::none(self.image.frame(), self.differences.region())?;
        self.seen.update(rules, &changed, monitor)?;
        Ok(changed)
    }

    /// Finds all differences, if the mesh has changed in few places since that was done last.
    fn compare_part(&mut self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<bool> {
        let changed = self.changed(rules, monitor)?;
        let none = VoxelBlocks::none(self.image.frame(), self.differences.region())?;
        let Some(since) = self.changed_since.replace(none) else { return Ok(false) };
        changed.add_blocks(&since);
        let found = self.of_part(changed, rules, monitor)?;
        let is_found = found.is_some();
        self.found = found.unwrap_or_default();
        Ok(is_found)
    }

    /// Mends a mesh whose topology was measured, for trial: it gets its labels back. Told is
    /// whether nothing is left.
    fn mend(
        &mut self,
        mesh: &mut TetMesh,
        topology: &MeshTopology,
        monitor: &Monitor<'_>,
    ) -> Result<bool> {
        let of_image = self.differences.of_image();
        if !is_mended(self.params) {
            let left = left_unmended(topology, of_image)?;
            let is_right = left == Left::default();
            self.trial =
                Some(Trial { comparison: self.count, wrong: left.labels, changed: Vec::new() });
            return Ok(is_right);
        }
        // The first pass alone: where a mesh can have better facets with more samples it shall.
        let passes = &passes(self.params)[..1];
        let known = (topology, of_image, &self.earlier);
        let mending = mend_measured(mesh, known, self.image, self.oracle(), passes, monitor)?;
        let Mending { tets, left } = &mending;
        for &Mended { tet, from, .. } in tets.iter().rev() {
            mesh.labels[tet as usize] = from;
        }
        let mut changed = room(2 * tets.len(), "tets that are mended")?;
        changed.extend(tets.iter().flat_map(|&Mended { tet, from, to, .. }| {
            let corners = mesh.tets[tet as usize].map(|v| mesh.point(v));
            let corners = corners.map(|p| self.image.frame().to_index(p));
            let low = corners.into_iter().fold(DVec3::INFINITY, DVec3::min);
            let high = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
            [from, to].map(|label| (label, [low - BESIDE, high + BESIDE]))
        }));
        changed.sort_by_key(|&(label, _)| label);
        let is_right = *left == Left::default();
        self.earlier = Earlier::new(mesh, tets)?;
        self.trial = Some(Trial { comparison: self.count, wrong: left.labels.clone(), changed });
        self.mended = Some(mending);
        Ok(is_right)
    }

    fn oracle(&self) -> &'a Oracle {
        &self.prepared.oracle
    }

    /// Whether all differences count.
    fn all_count(&self) -> bool {
        self.params.all_differences_count(self.image.frame().spacing().min_element())
    }

    /// The differences within a scope.
    fn within(&self, scope: Scope) -> Result<Vec<Difference>> {
        let mut counting = room(self.found.len(), "differences")?;
        counting.extend(self.found.iter().filter(|found| self.is_within(scope, found)));
        Ok(counting)
    }

    fn is_within(&self, scope: Scope, difference: &Difference) -> bool {
        let least = match difference.kind {
            Kind::Nick => return true,
            Kind::Voxel if difference.is_far || self.is_lost(difference) => return true,
            Kind::Voxel | Kind::Piece => Scope::Apart,
            Kind::Touch => Scope::Touching,
            Kind::Contact => Scope::Parted,
        };
        let Some(trial) = &self.trial else { return false };
        let labels = difference.ids.map(|id| self.image.labels()[usize::from(id)]);
        let counts_for = |label| {
            let is_dealt_with = || trial.has_changed(label, difference.index);
            trial.wrong.contains(&label) && (scope == Scope::OfWrongLabels || !is_dealt_with())
        };
        scope >= least && labels.into_iter().any(counts_for)
    }

    /// Whether a voxel lies in a component that is lost.
    fn is_lost(&self, &Difference { index, ids, .. }: &Difference) -> bool {
        let component = self.differences.of_image().near(self.image, ids[0], index);
        component.is_some_and(|component| self.lost.contains(&component))
    }

    /// The mesh that there is, numbered as the finished one will be if that is mended, and its
    /// topology.
    fn measure(&self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<(TetMesh, MeshTopology)> {
        let keeps_last = self.params.improve != Improve::None && !self.all_count();
        let background = background_of(self.params, keeps_last);
        let mut mesh = collect(rules, self.image.labels(), background, monitor)?;
        mesh.collect_facets(monitor)?;
        let of_image = self.differences.of_image();
        let topology = MeshTopology::measure(&mesh, self.image, of_image, monitor)?;
        Ok((mesh, topology))
    }

    /// All differences that are known when the mesh has changed in some blocks; `None` if these are
    /// not few.
    fn of_part(
        &mut self,
        changed: VoxelBlocks,
        rules: &Rules<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<Option<Vec<Difference>>> {
        self.differences.add_pieces(&changed);
        let near = changed.and_around()?;
        let Some(part) = collect_near(rules, self.image.labels(), &near, monitor)? else {
            return Ok(None);
        };
        let Part { mut mesh, cut } = part;
        mesh.collect_facets(monitor)?;
        let change = Change { blocks: near.blocks(), cut: &cut };
        let of_image = self.differences.of_image();
        let topology = MeshTopology::measure(&mesh, self.image, of_image, monitor)?;
        let found = self.differences.of(&mesh, &topology, Some(&change), monitor)?;
        if cfg!(debug_assertions) {
            self.check_with_all(&found, rules)?;
        }
        Ok(Some(found))
    }

    /// For debug builds: the differences found in a part of the mesh, and those of before
    /// elsewhere, are those of all of it. But for pieces: of those that are cut a part cannot know.
    fn check_with_all(&self, found: &[Difference], rules: &Rules<'_>) -> Result<()> {
        let Self { image, prepared, .. } = *self;
        let (monitor, region) = (Monitor::silent(), *self.differences.region());
        let (mesh, topology) = self.measure(rules, &monitor)?;
        let mut differences = Differences::new(image, region, &prepared.oracle, &monitor)?;
        let all = differences.of(&mesh, &topology, None, &monitor)?;
        let sorted = |differences: &[Difference]| {
            let known = differences.iter().filter(|difference| difference.kind != Kind::Piece);
            let mut known: Vec<_> = known.map(|d| (d.kind as u8, d.index.to_array())).collect();
            known.sort_unstable_by(|a, b| a.partial_cmp(b).expect("no place is NaN"));
            known
        };
        debug_assert_eq!(sorted(found), sorted(&all), "of a part, and of all");
        Ok(())
    }
}
