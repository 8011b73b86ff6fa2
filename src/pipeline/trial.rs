//! Mending for trial, while sampling goes on: which labels are wrong even when the mesh is mended.
//!
//! First all of the mesh is mended, as the finished one will be ([`mend`](super::mend)). Few labels
//! are wrong then, and small ones: in the brain at a delta of three voxels 31 of 312, twelve after
//! the next round. So after samples have come closer there these labels alone are tried again
//! ([`Trial::again`]), in the part of the mesh that holds all of their tets and what is around
//! them. That part tells how these labels stand. Of others it has pieces, which must stay as they
//! are.
//!
//! That may find labels wrong that are right when others are mended, too: these take samples that
//! they would not need. And it does not find others that have become wrong. So all of the mesh is
//! tried once more when these labels are right, when nothing more can be done about them, and after
//! some times in any case.
//!
//! What one trial of all changed is tried first in those after it (`mend/earlier`).
//!
//! Parallel in the current rayon pool, but for gathering such a part; the same for any number of
//! threads.

use std::collections::HashSet;

use glam::DVec3;

use super::changes::SeenTets;
use super::mend::{
    Earlier, Known, Left, Mended, Mending, is_mended, left_unmended, mend_measured, passes,
};
use crate::Result;
use crate::image::components::ImageComponents;
use crate::image::{Frame, LabelImage};
use crate::memory::room;
use crate::mesh::TetMesh;
use crate::mesh::part::part;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::MeshParams;
use crate::refine::rules::Rules;
use crate::verify::topology::measured::MeshTopology;

/// Mending deals with what is so near to the box around a tet that it changes, in voxels.
const BESIDE: f64 = 0.5;

/// Labels are tried without the others if they have one tet in so many slots at most. With more,
/// and with all that is around them, that would take about as long as trying all.
const SLOTS_PER_TET: usize = 32;

/// What does not depend on the mesh.
#[derive(Clone, Copy)]
pub(super) struct Given<'a> {
    pub image: &'a LabelImage,
    pub oracle: &'a Oracle,
    pub params: &'a MeshParams,
    pub of_image: &'a ImageComponents,
}

/// What came of mending a mesh for trial.
#[derive(Default)]
pub(super) struct Trial {
    /// What was wrong even so.
    pub left: Left,
    /// For each tet that was changed the labels that it had and has, each with what is near to the
    /// tet, in voxels; by label.
    changed: Vec<(i32, [DVec3; 2])>,
    /// The tets that were changed when all of the mesh was tried last.
    earlier: Earlier,
}

impl Trial {
    /// Whether nothing was wrong.
    pub fn is_right(&self) -> bool {
        self.left == Left::default()
    }

    /// Whether a label has lost or gained a tet near to a place, in voxels.
    pub fn has_changed(&self, label: i32, index: DVec3) -> bool {
        let first = self.changed.partition_point(|&(other, _)| other < label);
        let mut of_label = self.changed[first..].iter().take_while(|&&(other, _)| other == label);
        of_label.any(|&(_, [low, high])| index.cmpge(low).all() && index.cmple(high).all())
    }

    /// Tries all of a mesh that has its facets, and whose topology was measured: it gets its labels
    /// back. Told besides is what mending comes to, if `params` ask for it.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn of_all(
        self,
        mesh: &mut TetMesh,
        topology: &MeshTopology,
        given: Given<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<(Self, Option<Mending>)> {
        let of_image = given.of_image;
        let known = Known { topology, of_image, earlier: &self.earlier, labels: None };
        let mending = given.mend(mesh, known, monitor)?;
        for &Mended { tet, from, .. } in mending.tets.iter().rev() {
            mesh.labels[tet as usize] = from;
        }
        let changed = places_of(&mending.tets, mesh, given.image.frame())?;
        let earlier = Earlier::new(mesh, &mending.tets)?;
        let trial = Self { left: mending.left.clone(), changed, earlier };
        Ok((trial, is_mended(given.params).then_some(mending)))
    }

    /// Tries those labels again that were wrong the last time, in a triangulation whose tets are
    /// those that were `seen`. `false`: they have too many tets, and nothing is done.
    ///
    /// # Errors
    /// As [`Self::of_all`].
    pub fn again(
        &mut self,
        seen: &SeenTets,
        rules: &Rules<'_>,
        given: Given<'_>,
        monitor: &Monitor<'_>,
    ) -> Result<bool> {
        let Given { image, of_image, .. } = given;
        let label_of =
            |component: &u32| image.labels()[usize::from(of_image.list[*component as usize].id)];
        let Left { labels, lost } = &self.left;
        let labels: HashSet<i32> =
            labels.iter().copied().chain(lost.iter().map(label_of)).collect();
        let are_tried: Vec<bool> =
            image.labels().iter().map(|label| labels.contains(label)).collect();
        let is_tried = |id: u16| are_tried[usize::from(id)];
        let (triangulation, most) = (rules.triangulation(), seen.slots() / SLOTS_PER_TET);
        let Some(part_of) = seen.and_around(triangulation, is_tried, most, monitor)? else {
            return Ok(false);
        };
        let (tets, are_in_part) = part_of;
        let label = |t| image.labels()[usize::from(rules.label(t))];
        let mut mesh = part(triangulation, &tets, &are_in_part, label, monitor)?;
        mesh.collect_facets(monitor)?;
        let topology = &MeshTopology::measure(&mesh, image, of_image, monitor)?;
        let known = Known { topology, of_image, earlier: &self.earlier, labels: Some(&labels) };
        let Mending { tets, left } = given.mend(&mut mesh, known, monitor)?;
        (self.left, self.changed) = (left, places_of(&tets, &mesh, image.frame())?);
        Ok(true)
    }
}

impl Given<'_> {
    /// Mends a mesh as far as `params` ask for that.
    fn mend(&self, mesh: &mut TetMesh, known: Known<'_>, monitor: &Monitor<'_>) -> Result<Mending> {
        if !is_mended(self.params) {
            return Ok(Mending { tets: Vec::new(), left: left_unmended(known, self.image)? });
        }
        // The first pass alone: where a mesh can have better facets with more samples it shall.
        mend_measured(mesh, known, self.image, self.oracle, &passes(self.params)[..1], monitor)
    }
}

/// What is near to each of some tets, in voxels, with the labels that it had and has; by label.
fn places_of(mended: &[Mended], mesh: &TetMesh, frame: &Frame) -> Result<Vec<(i32, [DVec3; 2])>> {
    let mut places = room(2 * mended.len(), "tets that are mended")?;
    places.extend(mended.iter().flat_map(|&Mended { tet, from, to, .. }| {
        let corners = mesh.tets[tet as usize].map(|v| frame.to_index(mesh.point(v)));
        let low = corners.into_iter().fold(DVec3::INFINITY, DVec3::min);
        let high = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
        [from, to].map(|label| (label, [low - BESIDE, high + BESIDE]))
    }));
    places.sort_by_key(|&(label, _)| label);
    Ok(places)
}
