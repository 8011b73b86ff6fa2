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
//! 2. The mesh is mended for trial, as the finished one will be first ([`trial`](super::trial)),
//!    and its components are measured as the certificate measures them. A label is *wrong* if even
//!    so it has a component merged, torn, or of another Euler characteristic than the image's. If
//!    no label is, nothing is far, and no wall is missed, that is all.
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
//! Where the mesh has changed in a small part of the region no more is looked at than that
//! (`changes`): the tets near to those that are new or gone. Wrong labels are then those of the
//! last trial, but for no more than [`WRONG_FOR`] comparisons, and for the third step only. After
//! that wrong labels alone are tried again, up to [`AGAIN`] times. All are when these are right,
//! and when there is nothing more to be done about them.
//!
//! Parallel in the current rayon pool, the same for any number of threads. Cost: for what is far
//! alone, a pass through tets and voxels; for the rest that of a mesh copied, mended, and its
//! components and boundaries measured, and another such pass. Where little has changed some looks
//! at each slot of a tet, all of this but for mending for a part of the mesh, and mending for the
//! part around wrong labels.

use std::mem::take;

use glam::DVec3;
use rayon::prelude::*;

use super::changes::SeenTets;
use super::mend::Mending;
use super::prepare::Prepared;
use super::refine::{Part, background_of, collect, collect_part, tets_near};
use super::trial::{Given, Trial};
use crate::Result;
use crate::delaunay::TetId;
use crate::image::LabelImage;
use crate::image::region::Region;
use crate::image::voxel_blocks::{NearBlocks, VoxelBlocks};
use crate::memory::room;
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::params::{Improve, MeshParams};
use crate::refine::rules::Rules;
use crate::verify::topology::differences::{Change, Difference, Differences, Kind};
use crate::verify::topology::measured::MeshTopology;

/// So many comparisons begin with far differences alone. After them these are few, and are sampled
/// together with others.
const FAR_FIRST: usize = 5;

/// In so many comparisons of parts of the mesh labels are taken to be as wrong as they were.
const WRONG_FOR: usize = 2;

/// So often wrong labels alone are tried again, one time after the other: others may have become
/// wrong meanwhile.
const AGAIN: usize = 6;

/// Up to this part of the region's blocks the tets near to those that have changed are looked at
/// alone.
const LARGEST_PART: f64 = 1.0 / 16.0;

/// Tets of one piece of work, between two looks at the cancel flag.
const CHUNK: usize = 1 << 12;

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
    /// What came of mending the mesh for trial the last time; nothing was wrong before.
    trial: Trial,
    /// The comparison in which that was.
    tried: usize,
    /// How often wrong labels alone have been tried since all were.
    again: usize,
    /// What mending the mesh comes to with the first of its passes, if it was mended for trial the
    /// last time. Tets are numbered as in the finished mesh before improvement.
    pub mended: Option<Mending>,
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
        let (count, seen, found, changed_since, trial, tried, again, mended) = Default::default();
        Ok(Self {
            image,
            prepared,
            params,
            differences,
            count,
            seen,
            found,
            changed_since,
            trial,
            tried,
            again,
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
        let changed = self.look(rules, monitor)?;
        if self.all_count() {
            if !self.compare_part(rules, monitor)? {
                let (mesh, topology) = self.measure(rules, monitor)?;
                self.found = self.differences.of(&mesh, &topology, None, monitor)?;
            }
            return sample(&self.found);
        }
        let is_far_first = self.count <= FAR_FIRST;
        if is_far_first && sample(&self.far(changed, rules, monitor)?)? {
            return Ok(true);
        }
        let is_found = self.compare_part(rules, monitor)?;
        let is_known = self.count <= self.tried + WRONG_FOR;
        if is_found && is_known && sample(&self.within(Scope::Apart)?)? {
            return Ok(true);
        }
        if is_found && !self.trial.is_right() && self.again < AGAIN {
            let mut trial = take(&mut self.trial);
            let is_tried = trial.again(&self.seen, rules, self.given(), monitor)?;
            self.trial = trial;
            if is_tried {
                (self.tried, self.again) = (self.count, self.again + 1);
                if self.sample_scopes(sample)? {
                    return Ok(true);
                }
            }
        }
        let (mut mesh, topology) = self.measure(rules, monitor)?;
        (self.tried, self.again) = (self.count, 0);
        let trial = take(&mut self.trial);
        (self.trial, self.mended) = trial.of_all(&mut mesh, &topology, self.given(), monitor)?;
        // What counts even so is far, or a nick.
        let is_right = self.trial.is_right();
        if is_right && is_far_first && !self.differences.has_nicks(&mesh, monitor)? {
            // All differences were not looked for.
            self.changed_since = None;
            return Ok(false);
        }
        if !is_found {
            self.found = self.differences.of(&mesh, &topology, None, monitor)?;
        }
        self.sample_scopes(sample)
    }

    fn given(&self) -> Given<'_> {
        let Self { image, params, .. } = *self;
        let (oracle, of_image) = (&self.prepared.oracle, self.differences.of_image());
        Given { image, oracle, params, of_image }
    }

    /// The voxels that are farther than a voxel, in a mesh that has changed in some blocks. No mesh
    /// is made for it, and no topology measured.
    fn far(
        &mut self,
        changed: VoxelBlocks,
        rules: &Rules<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<Difference>> {
        let is_first = self.count == 1;
        let near = changed.and_around()?;
        let tets = if is_first { None } else { self.tets_of_part(&near, rules, monitor)? };
        let triangulation = rules.triangulation();
        let corners = |t: TetId| triangulation.corners(triangulation.tet(t).vertices());
        let visit_tets = |visit: &(dyn Fn(u16, [DVec3; 4]) + Sync)| {
            let Some(tets) = &tets else { return self.seen.visit(triangulation, visit, monitor) };
            tets.par_chunks(CHUNK).try_for_each(|tets| {
                monitor.advance(0)?;
                tets.iter().for_each(|&t| visit(rules.label(t), corners(t)));
                Ok(())
            })
        };
        let changed = tets.is_some().then(|| near.blocks());
        self.differences.far(changed, visit_tets, monitor)
    }

    /// Looks at the tets that there are; where they have changed since that was done last, nowhere
    /// the first time.
    fn look(&mut self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<VoxelBlocks> {
        let changed = VoxelBlocks::none(self.image.frame(), self.differences.region())?;
        self.seen.update(rules, &changed, monitor)?;
        if let Some(since) = &self.changed_since {
            since.add_blocks(&changed);
        }
        Ok(changed)
    }

    /// Finds all differences, if the mesh has changed in a small part of the region since that was
    /// done last.
    fn compare_part(&mut self, rules: &Rules<'_>, monitor: &Monitor<'_>) -> Result<bool> {
        let none = VoxelBlocks::none(self.image.frame(), self.differences.region())?;
        let Some(changed) = self.changed_since.replace(none) else { return Ok(false) };
        let found = self.of_part(changed, rules, monitor)?;
        let is_found = found.is_some();
        self.found = found.unwrap_or_default();
        Ok(is_found)
    }

    /// The tets of labels that come near to some blocks, in the order of their slots; `None` if the
    /// blocks are too large a part of the region.
    fn tets_of_part(
        &self,
        blocks: &NearBlocks,
        rules: &Rules<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<Option<Vec<TetId>>> {
        if let Some(few) = tets_near(rules, blocks, monitor)? {
            return Ok(Some(few));
        }
        let of_seen = || self.seen.near(rules.triangulation(), blocks, monitor);
        (blocks.part() <= LARGEST_PART).then(of_seen).transpose()
    }

    /// Whether all differences count.
    fn all_count(&self) -> bool {
        self.params.all_differences_count(self.image.frame().spacing().min_element())
    }

    /// Calls `sample` with the differences within one scope after the other, until it says `true`:
    /// then so does this.
    fn sample_scopes(
        &self,
        sample: &mut impl FnMut(&[Difference]) -> Result<bool>,
    ) -> Result<bool> {
        for scope in [Scope::Apart, Scope::Touching, Scope::Parted, Scope::OfWrongLabels] {
            if sample(&self.within(scope)?)? {
                return Ok(true);
            }
        }
        Ok(false)
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
        let labels = difference.ids.map(|id| self.image.labels()[usize::from(id)]);
        let counts_for = |label| {
            let is_dealt_with = || self.trial.has_changed(label, difference.index);
            self.trial.left.labels.contains(&label)
                && (scope == Scope::OfWrongLabels || !is_dealt_with())
        };
        scope >= least && labels.into_iter().any(counts_for)
    }

    /// Whether a voxel lies in a component that is lost.
    fn is_lost(&self, &Difference { index, ids, .. }: &Difference) -> bool {
        let component = self.differences.of_image().near(self.image, ids[0], index);
        component.is_some_and(|component| self.trial.left.lost.contains(&component))
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
    /// too large a part of the region.
    fn of_part(
        &mut self,
        changed: VoxelBlocks,
        rules: &Rules<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<Option<Vec<Difference>>> {
        self.differences.add_pieces(&changed);
        let near = changed.and_around()?;
        let Some(tets) = self.tets_of_part(&near, rules, monitor)? else { return Ok(None) };
        let Part { mut mesh, cut } = collect_part(rules, self.image.labels(), &tets, monitor)?;
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
