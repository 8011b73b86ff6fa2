//! Voxels at which two labellings of a region differ, and not only by where boundaries lie.
//!
//! Voxel by voxel one labelling is made to the other, label by label: a voxel leaves a label, or
//! comes to it, when it is simple for it ([`simple`](super::simple)). That moves boundaries and
//! changes nothing of what is connected. Where no voxel can go on moving, one is left that would
//! join what is apart, part what is joined, or open or close a hole: there the labellings differ in
//! their topology. This is the warping of V. Jain et al., "Boundary learning by optimization with
//! topological constraints" (CVPR 2010).
//!
//! Which voxels are left depends on the order: first come, first served, from the first voxel on,
//! so the same input gives the same ones. That they are few is not promised; that none are left
//! where nothing differs is.
//!
//! Voxels that differ are in *clusters*: those that touch, even at a corner, are in one. Steps in
//! one do not matter to another. So where one labelling has changed in some blocks only
//! ([`Labellings::left_since`]), no others are looked at than clusters with voxels there or beside
//! them, and what is left is as if all were.
//!
//! Linear in the voxels of the region, or of the blocks, and in those that differ. Memory: a byte
//! per voxel, and some for each that differs.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::simple::is_simple;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{concatenated, reserve, zeroed};
use crate::{Error, Result};

/// Voxels that are compared at once, and steps between two looks at the cancel flag.
const CHUNK: usize = 1 << 14;

/// What lists of this module have, as errors name it.
const WHAT: &str = "voxels that differ";

/// What is noted of a voxel at which the labellings differ.
const DIFFERS: u8 = 1;
/// It has left the label that it had.
const LEFT: u8 = 2;
/// It has come to the label that it is to have.
const CAME: u8 = 4;

/// A region of voxels, x fastest, then y, and its two labellings; 0 is no label.
pub(super) struct Labellings<'a> {
    pub dims: [usize; 3],
    pub from: &'a [u16],
    pub to: &'a [u16],
}

impl Labellings<'_> {
    /// The voxels that are left, in their order.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]; those of `go_on`, which is asked again and again.
    pub fn left(&self, go_on: impl Fn() -> Result<()> + Sync) -> Result<Vec<usize>> {
        let differing = self.differing(&go_on)?;
        let mut notes = self.no_notes()?;
        differing.iter().for_each(|&v| notes[v] = DIFFERS);
        self.deform(differing, &mut notes, &go_on)
    }

    /// Those of [`Self::left`] that are in clusters with a voxel that is `wanted`.
    ///
    /// # Errors
    /// As [`Self::left`].
    pub fn left_with(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        go_on: impl Fn() -> Result<()> + Sync,
    ) -> Result<Vec<usize>> {
        let differing = self.differing(&go_on)?;
        let pieces = differing.par_chunks(CHUNK).map(|differing| {
            go_on()?;
            let mut seeds = Vec::new();
            for &v in differing.iter().filter(|&&v| wanted(v)) {
                reserve(&mut seeds, 1, WHAT)?;
                seeds.push(v);
            }
            Ok(seeds)
        });
        let seeds = concatenated(pieces.collect::<Result<_>>()?, WHAT)?;
        drop(differing);
        if seeds.is_empty() {
            return Ok(seeds);
        }
        let mut notes = self.no_notes()?;
        seeds.iter().for_each(|&v| notes[v] = DIFFERS);
        let differing = self.clusters_with(seeds, &mut notes)?;
        self.deform(differing, &mut notes, &go_on)
    }

    /// As [`Self::left`], where `before` are those of the labellings as they were before `from`
    /// changed in these blocks.
    ///
    /// # Errors
    /// As [`Self::left`].
    pub fn left_since(
        &self,
        mut before: Vec<usize>,
        changed: &VoxelBlocks,
        go_on: impl Fn() -> Result<()> + Sync,
    ) -> Result<Vec<usize>> {
        let mut notes = self.no_notes()?;
        let differing = self.differing_near(changed, &mut notes)?;
        let [nx, ny, _] = self.dims;
        // Of clusters that are gone, or looked at again.
        before
            .retain(|&v| notes[v] == 0 && !changed.has_voxel([v % nx, v / nx % ny, v / (nx * ny)]));
        let left = self.deform(differing, &mut notes, &go_on)?;
        reserve(&mut before, left.len(), WHAT)?;
        before.extend(left);
        before.sort_unstable();
        Ok(before)
    }

    fn no_notes(&self) -> Result<Vec<u8>> {
        zeroed(self.to.len(), "voxels of the region")
    }

    /// Those of the noted voxels that are left.
    fn deform(
        &self,
        differing: Vec<usize>,
        notes: &mut [u8],
        go_on: &(impl Fn() -> Result<()> + Sync),
    ) -> Result<Vec<usize>> {
        // For each label apart: what one has done with a voxel does not matter to the other.
        let count = 2 * differing.len();
        let mut waiting: VecDeque<(usize, u16)> = VecDeque::new();
        waiting.try_reserve(count).map_err(|_| Error::OutOfMemory { count, what: WHAT })?;
        let labels = |v: usize| [self.to[v], self.from[v]].into_iter().filter(|&id| id != 0);
        waiting.extend(differing.iter().flat_map(|&v| labels(v).map(move |id| (v, id))));
        let mut steps = 0_usize;
        while let Some((v, id)) = waiting.pop_front() {
            steps += 1;
            if steps.is_multiple_of(CHUNK) {
                go_on()?;
            }
            let note = self.note_of(v, id);
            if notes[v] & note != 0 || !is_simple(self.neighbourhood(v, id, notes)) {
                continue;
            }
            notes[v] |= note;
            // Around it others may have become simple.
            self.visit_around(v, |_, u| {
                let differs = notes[u] != 0 && (self.to[u] == id || self.from[u] == id);
                if differs && notes[u] & self.note_of(u, id) == 0 {
                    waiting.push_back((u, id));
                }
            });
        }
        let is_left = |v: usize| labels(v).any(|id| notes[v] & self.note_of(v, id) == 0);
        Ok(differing.into_iter().filter(|&v| is_left(v)).collect())
    }

    fn differing(&self, go_on: &(impl Fn() -> Result<()> + Sync)) -> Result<Vec<usize>> {
        let pairs = self.from.par_chunks(CHUNK).zip(self.to.par_chunks(CHUNK)).enumerate();
        let pieces = pairs.map(|(chunk, (from, to))| {
            go_on()?;
            let mut differing = Vec::new();
            // Mostly none.
            if from != to {
                let pairs = from.iter().zip(to).enumerate().filter(|(_, (from, to))| from != to);
                for (n, _) in pairs {
                    reserve(&mut differing, 1, WHAT)?;
                    differing.push(chunk * CHUNK + n);
                }
            }
            Ok(differing)
        });
        concatenated(pieces.collect::<Result<_>>()?, WHAT)
    }

    /// Finds the voxels that differ of the clusters with voxels in some blocks or beside them, in
    /// their order, and notes them. A cluster that is parted has its parts beside what parts it.
    fn differing_near(&self, blocks: &VoxelBlocks, notes: &mut [u8]) -> Result<Vec<usize>> {
        let [nx, ny, _] = self.dims;
        let mut differing = Vec::new();
        blocks.try_visit_voxels(1, |[x, y, z], count| {
            let first = x + nx * (y + ny * z);
            (first..first + count).try_for_each(|v| self.note(v, notes, &mut differing))
        })?;
        self.clusters_with(differing, notes)
    }

    /// Notes and lists a voxel that differs, if it is not yet.
    fn note(&self, v: usize, notes: &mut [u8], differing: &mut Vec<usize>) -> Result<()> {
        if self.from[v] != self.to[v] && notes[v] == 0 {
            notes[v] = DIFFERS;
            reserve(differing, 1, WHAT)?;
            differing.push(v);
        }
        Ok(())
    }

    /// All voxels of the clusters in which some noted voxels are, in their order; they are noted.
    fn clusters_with(&self, mut differing: Vec<usize>, notes: &mut [u8]) -> Result<Vec<usize>> {
        let mut next = 0;
        while let Some(&v) = differing.get(next) {
            next += 1;
            let mut noted = Ok(());
            self.visit_around(v, |_, u| {
                if noted.is_ok() {
                    noted = self.note(u, notes, &mut differing);
                }
            });
            noted?;
        }
        differing.sort_unstable();
        Ok(differing)
    }

    /// What is noted when a voxel that differs has done its step for a label.
    fn note_of(&self, v: usize, id: u16) -> u8 {
        if self.to[v] == id { CAME } else { LEFT }
    }

    /// Whether a label has a voxel by now.
    fn has(&self, v: usize, id: u16, notes: &[u8]) -> bool {
        match notes[v] {
            0 => self.to[v] == id,
            note => self.from[v] == id && note & LEFT == 0 || self.to[v] == id && note & CAME != 0,
        }
    }

    /// Which voxels around one, and itself, a label has by now, as bits, x fastest.
    fn neighbourhood(&self, v: usize, id: u16, notes: &[u8]) -> u32 {
        let mut own = 0;
        self.visit_around(v, |n, u| own |= u32::from(self.has(u, id, notes)) << n);
        own
    }

    /// Calls `visit` for the voxels of the region around one and itself, numbered x fastest.
    fn visit_around(&self, v: usize, mut visit: impl FnMut(usize, usize)) {
        let [nx, ny, nz] = self.dims;
        let at = [v % nx, v / nx % ny, v / (nx * ny)];
        for n in 0..27 {
            let [x, y, z] = [at[0] + n % 3, at[1] + n / 3 % 3, at[2] + n / 9];
            if (1..=nx).contains(&x) && (1..=ny).contains(&y) && (1..=nz).contains(&z) {
                visit(n, x - 1 + nx * (y - 1 + ny * (z - 1)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Frame;
    use crate::image::region::Region;

    const DIMS: [usize; 3] = [7, 6, 5];

    fn left(from: &[u16], to: &[u16]) -> Vec<usize> {
        Labellings { dims: DIMS, from, to }.left(|| Ok(())).unwrap()
    }

    fn labelled(label: impl Fn(usize, usize, usize) -> u16) -> Vec<u16> {
        let [nx, ny, nz] = DIMS;
        (0..nx * ny * nz).map(|v| label(v % nx, v / nx % ny, v / (nx * ny))).collect()
    }

    #[test]
    fn boundaries_that_lie_elsewhere_leave_nothing() {
        let flat = labelled(|x, _, _| 1 + u16::from(x > 3));
        let wavy = labelled(|x, y, z| 1 + u16::from(x > 1 + (y + z) % 4));
        assert!(left(&flat, &wavy).is_empty());
        assert!(left(&wavy, &flat).is_empty());
    }

    #[test]
    fn a_hole_in_a_sheet_is_left() {
        let sheet = labelled(|_, _, z| u16::from(z == 2));
        let holed = labelled(|x, y, z| u16::from(z == 2 && !((2..4).contains(&x) && y == 3)));
        assert_eq!(left(&holed, &sheet).len(), 1);
        // None of the two can be the first.
        assert_eq!(left(&sheet, &holed).len(), 2);
    }

    #[test]
    fn what_is_lost_torn_or_merged_is_left() {
        let with = labelled(|x, y, z| u16::from([x, y, z] == [3, 3, 2]));
        let without = labelled(|_, _, _| 0);
        assert_eq!(left(&without, &with).len(), 1);
        let row = labelled(|_, y, z| u16::from(y == 3 && z == 2));
        let torn = labelled(|x, y, z| u16::from(x != 3 && y == 3 && z == 2));
        assert_eq!(left(&torn, &row).len(), 1);
        assert_eq!(left(&row, &torn).len(), 1);
    }

    proptest! {
        /// Where nothing is left one labelling was made to the other by simple steps; equal ones
        /// leave nothing. Each voxel that is left differs.
        #[test]
        fn random_labellings(
            from in prop::collection::vec(0..3_u16, 7 * 6 * 5),
            to in prop::collection::vec(0..3_u16, 7 * 6 * 5),
        ) {
            prop_assert!(left(&to, &to).is_empty());
            for v in left(&from, &to) {
                prop_assert_ne!(from[v], to[v]);
            }
        }

        /// What is left of the clusters with some voxels is part of what is left, and all of that
        /// which touches these voxels.
        #[test]
        fn clusters_with_some_voxels(
            to in prop::collection::vec(0..3_u16, 13 * 9 * 10),
            differ in prop::collection::vec((0..13 * 9 * 10_usize, 0..3_u16), 0..200),
            wanted in prop::collection::btree_set(0..13 * 9 * 10_usize, 0..20),
        ) {
            let dims = [13, 9, 10];
            let mut from = to.clone();
            differ.into_iter().for_each(|(v, id)| from[v] = id);
            let labellings = Labellings { dims, from: &from, to: &to };
            let all = labellings.left(|| Ok(())).unwrap();
            let some = labellings.left_with(|v| wanted.contains(&v), || Ok(())).unwrap();
            prop_assert!(some.iter().all(|v| all.contains(v)));
            for v in all {
                let mut touches = false;
                labellings.visit_around(v, |_, u| {
                    touches |= wanted.contains(&u) && from[u] != to[u];
                });
                prop_assert!(!touches || some.contains(&v));
            }
        }

        /// What is left after a change in some blocks is what is left where all is looked at.
        #[test]
        fn changes_in_blocks(
            to in prop::collection::vec(0..3_u16, 13 * 9 * 10),
            differ in prop::collection::vec((0..13 * 9 * 10_usize, 0..3_u16), 0..200),
            change in prop::collection::vec((0..13 * 9 * 10_usize, 0..3_u16), 0..20),
        ) {
            let dims = [13, 9, 10];
            let mut from = to.clone();
            differ.into_iter().for_each(|(v, id)| from[v] = id);
            let before = Labellings { dims, from: &from, to: &to }.left(|| Ok(())).unwrap();
            let region = Region { first: [0; 3], dims };
            let blocks = VoxelBlocks::none(&Frame::axis_aligned([1.0; 3]).unwrap(), &region);
            let blocks = blocks.unwrap();
            for (v, id) in change {
                from[v] = id;
                blocks.add_voxel([v % 13, v / 13 % 9, v / (13 * 9)]);
            }
            let after = Labellings { dims, from: &from, to: &to };
            let left = after.left_since(before, &blocks, || Ok(())).unwrap();
            prop_assert_eq!(left, after.left(|| Ok(())).unwrap());
        }
    }
}
