//! Turns a stream of labels into dense ids in one pass.
//!
//! Ids are handed out in order of first appearance while the stream lasts, and put in order of
//! label at its end by one pass over the ids. Memory: 2 bytes per voxel, one table of 192 KiB for
//! the common labels, a hash map for the others. Cost: linear; equal neighbours, the usual case in
//! a segmentation, cost one look-up per run. One thread suffices: the pass is bound by memory (a
//! few ns per voxel), and most streams come out of a decompressor that is slower.

use std::collections::HashMap;

use super::{Frame, LabelImage, MAX_IDS};
use crate::{Error, Result};

/// Labels from `TABLE_FIRST` on, `TABLE_LEN` of them (all of i16 and u16), are looked up in a
/// table.
const TABLE_FIRST: i32 = i16::MIN as i32;
const TABLE_LEN: usize = 3 << 15;

/// The number of voxels of a grid; `None` where u32 cannot number them.
pub(crate) fn numbered_voxels(dims: [usize; 3]) -> Option<usize> {
    let count = dims.iter().try_fold(1_usize, |product, &n| product.checked_mul(n))?;
    u32::try_from(count).is_ok().then_some(count)
}

/// As [`numbered_voxels`], with an error.
///
/// # Errors
/// [`Error::InvalidArgument`] when an axis is empty or the voxels cannot be numbered by u32.
pub(crate) fn voxel_count(dims: [usize; 3]) -> Result<usize> {
    if let Some(axis) = dims.iter().position(|&n| n == 0) {
        return Err(Error::InvalidArgument(format!("image axis {axis} has 0 voxels")));
    }
    numbered_voxels(dims).ok_or_else(|| {
        Error::InvalidArgument(format!(
            "an image of {} x {} x {} voxels is too large: at most 2^32 - 1 voxels",
            dims[0], dims[1], dims[2]
        ))
    })
}

/// Collects the labels of an image, x fastest.
pub(crate) struct LabelBuilder {
    dims: [usize; 3],
    total: usize,
    ids: Vec<u16>,
    /// By id, in order of first appearance; `labels[0]` is 0.
    labels: Vec<i32>,
    /// Id of label `TABLE_FIRST + i`; 0 is "not seen yet" (label 0 never asks).
    table: Vec<u16>,
    rare: HashMap<i32, u16>,
}

impl LabelBuilder {
    /// A builder for an image of `dims`; room for `reserve` voxels is made at once, the rest as
    /// labels come.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for impossible `dims`, [`Error::OutOfMemory`].
    pub(crate) fn new(dims: [usize; 3], reserve: usize) -> Result<Self> {
        let total = voxel_count(dims)?;
        let mut builder = Self {
            dims,
            total,
            ids: Vec::new(),
            labels: vec![0],
            table: vec![0; TABLE_LEN],
            rare: HashMap::new(),
        };
        builder.grow(reserve.min(total))?;
        Ok(builder)
    }

    /// Appends the labels of the next voxels.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] on the 65535th label other than 0, [`Error::OutOfMemory`].
    pub(crate) fn push(&mut self, labels: &[i32]) -> Result<()> {
        if self.ids.capacity() - self.ids.len() < labels.len() {
            // At least doubling, so that growth stays linear, yet never past the end of the image.
            let room = self.ids.len().max(labels.len()).min(self.total - self.ids.len());
            self.grow(room)?;
        }
        for run in labels.chunk_by(|a, b| a == b) {
            let id = self.id_of(run[0])?;
            self.ids.extend(std::iter::repeat_n(id, run.len()));
        }
        Ok(())
    }

    /// Gives each label but 0 another one, all different and none 0.
    pub(crate) fn relabel(&mut self, label: impl Fn(i32) -> i32) {
        self.labels[1..].iter_mut().for_each(|known| *known = label(*known));
        (self.table, self.rare) = (Vec::new(), HashMap::new());
    }

    /// The finished image. All voxels must have been pushed.
    pub(crate) fn finish(mut self, frame: Frame) -> Result<LabelImage> {
        if self.ids.len() != self.total {
            return Err(Error::Internal(format!(
                "{} of {} voxels were given",
                self.ids.len(),
                self.total
            )));
        }
        if !self.labels[1..].is_sorted() {
            let mut order: Vec<usize> = (1..self.labels.len()).collect();
            order.sort_unstable_by_key(|&id| self.labels[id]);
            let mut sorted_id = vec![0_u16; self.labels.len()];
            for (rank, &id) in order.iter().enumerate() {
                sorted_id[id] = (rank + 1) as u16;
            }
            for id in &mut self.ids {
                *id = sorted_id[usize::from(*id)];
            }
            self.labels[1..].sort_unstable();
        }
        Ok(LabelImage::assembled(self.ids, self.labels, self.dims, frame))
    }

    fn grow(&mut self, room: usize) -> Result<()> {
        self.ids
            .try_reserve_exact(room)
            .map_err(|_| Error::OutOfMemory { count: self.total, what: "voxels of an image" })
    }

    fn id_of(&mut self, label: i32) -> Result<u16> {
        if label == 0 {
            return Ok(0);
        }
        let slot = usize::try_from(i64::from(label) - i64::from(TABLE_FIRST))
            .ok()
            .and_then(|i| self.table.get_mut(i));
        let known = match &slot {
            Some(id) => **id,
            None => self.rare.get(&label).copied().unwrap_or(0),
        };
        if known != 0 {
            return Ok(known);
        }
        if self.labels.len() == MAX_IDS {
            return Err(Error::InvalidArgument(format!(
                "more than {} different labels: is this a segmentation, and not an intensity \
                 image?",
                MAX_IDS - 1
            )));
        }
        let id = self.labels.len() as u16;
        self.labels.push(label);
        match slot {
            Some(entry) => *entry = id,
            None => {
                self.rare.insert(label, id);
            }
        }
        Ok(id)
    }
}
