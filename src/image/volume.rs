//! The voxels of a label image, as dense ids.
//!
//! A [`LabelImage`] is immutable once made and may be shared between threads. It takes 2 bytes per
//! voxel; making one is linear in the voxels (see the builder beside this file).

use std::fmt::Display;
use std::sync::Arc;

use bytemuck::Zeroable;
use glam::DVec3;
use rayon::prelude::*;

use super::builder::{LabelBuilder, voxel_count};
use super::field::Field;
use super::{Frame, MAX_IDS};
use crate::memory::zeroed;
use crate::{Error, Result};

/// Voxels that are counted in one piece.
const COUNTED_AT_ONCE: usize = 1 << 18;

/// A caller's voxels, in any of the integer types. Strides are given beside it, in elements.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub enum Voxels<'a> {
    U8(&'a [u8]),
    I8(&'a [i8]),
    U16(&'a [u16]),
    I16(&'a [i16]),
    U32(&'a [u32]),
    I32(&'a [i32]),
    U64(&'a [u64]),
    I64(&'a [i64]),
}

/// A label image. Labels are kept as dense ids (u16): id 0 is label 0, the background; ids are
/// handed out to the other labels in increasing order of label. Voxel (i, j, k) is
/// `ids()[i + nx * (j + ny * k)]`.
///
/// Made of a [`GrayImage`](super::GrayImage) or a [`ProbabilityImage`](super::ProbabilityImage) it
/// also holds their values, between which the smooth surface model then interpolates.
///
/// Every id but 0 occurs; there are fewer than 2^32 voxels, so that u32 numbers them.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelImage {
    dims: [usize; 3],
    frame: Frame,
    ids: Vec<u16>,
    labels: Vec<i32>,
    /// The values that the labels come from, where they are not all that is known.
    field: Option<Arc<Field>>,
}

impl LabelImage {
    /// Copies a caller's voxels. `strides[axis]` is the distance in elements between neighbours
    /// along the axis (may be negative; then `offset` is where voxel (0, 0, 0) lies); `None` is x
    /// fastest, packed.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: a dimension of 0, 2^32 voxels or more, a slice too short for
    /// dims and strides, a label that does not fit i32, more than 65534 different labels besides 0.
    /// [`Error::OutOfMemory`].
    pub fn from_voxels(
        voxels: Voxels<'_>,
        dims: [usize; 3],
        strides: Option<[isize; 3]>,
        offset: usize,
        frame: Frame,
    ) -> Result<Self> {
        match voxels {
            Voxels::U8(v) => copied(v, dims, strides, offset, frame),
            Voxels::I8(v) => copied(v, dims, strides, offset, frame),
            Voxels::U16(v) => copied(v, dims, strides, offset, frame),
            Voxels::I16(v) => copied(v, dims, strides, offset, frame),
            Voxels::U32(v) => copied(v, dims, strides, offset, frame),
            Voxels::I32(v) => copied(v, dims, strides, offset, frame),
            Voxels::U64(v) => copied(v, dims, strides, offset, frame),
            Voxels::I64(v) => copied(v, dims, strides, offset, frame),
        }
    }

    /// Samples a label function at the world positions of the voxel centres.
    ///
    /// # Errors
    /// As [`LabelImage::from_voxels`].
    pub fn from_fn(dims: [usize; 3], frame: Frame, label: impl Fn(DVec3) -> i32) -> Result<Self> {
        let mut builder = LabelBuilder::new(dims, usize::MAX)?;
        let mut row = vec![0; dims[0]];
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for (i, slot) in row.iter_mut().enumerate() {
                    *slot = label(frame.to_world(DVec3::new(i as f64, j as f64, k as f64)));
                }
                builder.push(&row)?;
            }
        }
        builder.finish(frame)
    }

    /// Takes over dense ids, x fastest, and the label of each. Ids that do not occur are dropped
    /// from the table.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: dims that are impossible or differ from the number of ids, an id
    /// without label, `labels[0]` other than 0, labels after it that are 0, not increasing, or more
    /// than 65534.
    pub fn from_ids(
        dims: [usize; 3],
        frame: Frame,
        mut ids: Vec<u16>,
        mut labels: Vec<i32>,
    ) -> Result<Self> {
        let count = voxel_count(dims)?;
        if ids.len() != count {
            return Err(Error::InvalidArgument(format!(
                "{count} voxels need as many ids, got {}",
                ids.len()
            )));
        }
        if labels.first() != Some(&0) {
            return Err(Error::InvalidArgument(format!(
                "the label of id 0 must be 0, got {:?}",
                labels.first()
            )));
        }
        if labels[1..].contains(&0) || !labels[1..].is_sorted_by(|a, b| a < b) {
            return Err(Error::InvalidArgument(
                "labels of ids above 0 must increase and differ from 0".into(),
            ));
        }
        if labels.len() > MAX_IDS {
            return Err(Error::InvalidArgument(format!(
                "labels of {} ids are more than {MAX_IDS}",
                labels.len()
            )));
        }
        // All ids that u16 can hold, so that an id without label is found and not indexed with.
        let mut occurs = vec![false; usize::from(u16::MAX) + 1];
        for run in ids.chunk_by(|a, b| a == b) {
            occurs[usize::from(run[0])] = true;
        }
        if let Some(id) = (labels.len()..occurs.len()).find(|&id| occurs[id]) {
            return Err(Error::InvalidArgument(format!(
                "id {id} occurs, but there are labels for {} ids only",
                labels.len()
            )));
        }
        occurs[0] = true;
        if occurs[..labels.len()].contains(&false) {
            let mut next = 0_u16;
            let renumbered: Vec<u16> = (0..labels.len())
                .map(|id| {
                    let new = next;
                    next += u16::from(occurs[id]);
                    new
                })
                .collect();
            for id in &mut ids {
                *id = renumbered[usize::from(*id)];
            }
            let mut id = 0..;
            labels.retain(|_| id.next().is_some_and(|id: usize| occurs[id]));
        }
        Ok(Self { dims, frame, ids, labels, field: None })
    }

    /// Puts together what the builder made; the invariants above must hold.
    pub(crate) fn assembled(
        ids: Vec<u16>,
        labels: Vec<i32>,
        dims: [usize; 3],
        frame: Frame,
    ) -> Self {
        Self { dims, frame, ids, labels, field: None }
    }

    /// The image with the values that its labels come from.
    pub(crate) fn with_field(self, field: Field) -> Self {
        Self { field: Some(Arc::new(field)), ..self }
    }

    /// The values that the labels come from; `None` for a segmentation.
    pub(crate) fn field(&self) -> Option<&Field> {
        self.field.as_deref()
    }

    /// The same voxels at another place in the world.
    pub fn with_frame(self, frame: Frame) -> Self {
        Self { frame, ..self }
    }

    /// The image whose voxel (i, j, k) is the voxel (k, j, i) of this one, of labels, in the same
    /// frame.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn with_reversed_axes(self) -> Result<Self> {
        let ids = reversed_axes(&self.ids, self.dims)?;
        let [x, y, z] = self.dims;
        Ok(Self { ids, dims: [z, y, x], ..self })
    }

    /// Puts the voxels at another place in the world.
    pub fn set_frame(&mut self, frame: Frame) {
        self.frame = frame;
    }

    /// Voxels along each axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Place in the world.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The dense ids, x fastest.
    pub fn ids(&self) -> &[u16] {
        &self.ids
    }

    /// The label of each id; `labels()[0]` is 0, whether it occurs or not.
    pub fn labels(&self) -> &[i32] {
        &self.labels
    }

    /// The id of a label; `None` if the label does not occur. Label 0 always has id 0.
    pub fn id_of(&self, label: i32) -> Option<u16> {
        if label == 0 {
            return Some(0);
        }
        self.labels[1..].binary_search(&label).ok().map(|i| (i + 1) as u16)
    }

    /// The label of voxel (i, j, k); `None` outside the image.
    pub fn label_at(&self, index: [usize; 3]) -> Option<i32> {
        let [nx, ny, _] = self.dims;
        let inside = (0..3).all(|axis| index[axis] < self.dims[axis]);
        inside
            .then(|| self.labels[usize::from(self.ids[index[0] + nx * (index[1] + ny * index[2])])])
    }

    /// Voxels of each id; a pass over the image, in parallel in the current rayon pool.
    pub fn voxel_counts(&self) -> Vec<u64> {
        let of_piece = |ids: &[u16]| {
            let mut counts = vec![0; self.labels.len()];
            for run in ids.chunk_by(|a, b| a == b) {
                counts[usize::from(run[0])] += run.len() as u64;
            }
            counts
        };
        let sum = |mut counts: Vec<u64>, others: Vec<u64>| {
            counts.iter_mut().zip(others).for_each(|(count, other)| *count += other);
            counts
        };
        let pieces = self.ids.par_chunks(COUNTED_AT_ONCE).map(of_piece);
        pieces.reduce(|| vec![0; self.labels.len()], sum)
    }

    /// World volume of one voxel, in cubed world units.
    pub fn voxel_volume(&self) -> f64 {
        self.frame.spacing().element_product()
    }

    /// Whether no voxel has a label other than 0: nothing to mesh.
    pub fn is_all_background(&self) -> bool {
        self.labels.len() == 1
    }
}

/// Values of voxels, x fastest, as those of the image with z fastest; `dims` are of the one given.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub(crate) fn reversed_axes<T: Copy + Zeroable>(values: &[T], dims: [usize; 3]) -> Result<Vec<T>> {
    let [nx, ny, nz] = dims;
    let mut reversed = zeroed(values.len(), "voxels in the order of images")?;
    for (z, plane) in values.chunks(nx * ny).enumerate() {
        for (y, row) in plane.chunks(nx).enumerate() {
            for (x, &value) in row.iter().enumerate() {
                reversed[z + nz * (y + ny * x)] = value;
            }
        }
    }
    Ok(reversed)
}

/// Strides of voxels that lie packed, x fastest.
pub(crate) fn packed_strides(dims: [usize; 3]) -> [isize; 3] {
    [1, dims[0] as isize, (dims[0] * dims[1]) as isize]
}

/// Checks that every voxel lies within the slice.
fn check_extent(len: usize, dims: [usize; 3], strides: [isize; 3], offset: usize) -> Result<()> {
    // Wide integers: no stride can overflow them.
    let (mut first, mut last) = (offset as i128, offset as i128);
    for axis in 0..3 {
        let span = (dims[axis] - 1) as i128 * strides[axis] as i128;
        first += span.min(0);
        last += span.max(0);
    }
    if first < 0 || last >= len as i128 {
        return Err(Error::InvalidArgument(format!(
            "voxels {dims:?} with strides {strides:?} and offset {offset} reach from element \
             {first} to {last}, but the buffer has {len}"
        )));
    }
    Ok(())
}

fn copied<T: Copy + Display + TryInto<i32>>(
    voxels: &[T],
    dims: [usize; 3],
    strides: Option<[isize; 3]>,
    offset: usize,
    frame: Frame,
) -> Result<LabelImage> {
    voxel_count(dims)?;
    let strides = strides.unwrap_or_else(|| packed_strides(dims));
    check_extent(voxels.len(), dims, strides, offset)?;
    let mut builder = LabelBuilder::new(dims, usize::MAX)?;
    let mut row = vec![0_i32; dims[0]];
    let label = |value: T, i: usize, j: usize, k: usize| {
        value.try_into().map_err(|_| {
            Error::InvalidArgument(format!(
                "label {value} of voxel ({i}, {j}, {k}) does not fit a 32-bit signed integer"
            ))
        })
    };
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            // In bounds by check_extent, so neither the sums nor the conversions can go wrong.
            let start = offset as isize + j as isize * strides[1] + k as isize * strides[2];
            if strides[0] == 1 {
                let packed = &voxels[start as usize..start as usize + dims[0]];
                for (i, (slot, &value)) in row.iter_mut().zip(packed).enumerate() {
                    *slot = label(value, i, j, k)?;
                }
            } else {
                for (i, slot) in row.iter_mut().enumerate() {
                    *slot = label(voxels[(start + i as isize * strides[0]) as usize], i, j, k)?;
                }
            }
            builder.push(&row)?;
        }
    }
    builder.finish(frame)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    fn unit() -> Frame {
        Frame::axis_aligned([1.0; 3]).unwrap()
    }

    fn labels_of(image: &LabelImage) -> Vec<i32> {
        image.ids().iter().map(|&id| image.labels()[usize::from(id)]).collect()
    }

    proptest! {
        #[test]
        fn dense_ids_give_every_label_back_in_increasing_order(
            labels in prop::collection::vec(
                prop_oneof![Just(0), -3..4_i32, 60_000..70_000_i32, any::<i32>()],
                60,
            ),
        ) {
            let image =
                LabelImage::from_voxels(Voxels::I32(&labels), [3, 4, 5], None, 0, unit()).unwrap();
            prop_assert_eq!(&labels_of(&image), &labels);
            let distinct: BTreeSet<i32> = labels.iter().copied().filter(|&l| l != 0).collect();
            let expected: Vec<i32> = std::iter::once(0).chain(distinct).collect();
            prop_assert_eq!(image.labels(), &expected[..]);
            let counts = image.voxel_counts();
            for (id, &label) in image.labels().iter().enumerate() {
                prop_assert_eq!(image.id_of(label), Some(id as u16));
                prop_assert_eq!(counts[id], labels.iter().filter(|&&l| l == label).count() as u64);
            }
        }

        #[test]
        fn strides_address_what_the_caller_means(
            flips in prop::array::uniform3(any::<bool>()),
            order in 0..6_usize,
        ) {
            let dims = [4, 3, 2];
            let axes = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]][order];
            let mut strides = [0_isize; 3];
            let mut step = 1;
            for axis in axes {
                strides[axis] = step;
                step *= dims[axis] as isize;
            }
            let mut offset = 0;
            for axis in 0..3 {
                if flips[axis] {
                    offset += (dims[axis] as isize - 1) * strides[axis];
                    strides[axis] = -strides[axis];
                }
            }
            let at = |i: usize, j: usize, k: usize| {
                (offset
                    + i as isize * strides[0]
                    + j as isize * strides[1]
                    + k as isize * strides[2]) as usize
            };
            let mut buffer = vec![0_u16; 24];
            for k in 0..2 {
                for j in 0..3 {
                    for i in 0..4 {
                        buffer[at(i, j, k)] = (i + 10 * j + 100 * k) as u16;
                    }
                }
            }
            let image = LabelImage::from_voxels(
                Voxels::U16(&buffer),
                dims,
                Some(strides),
                offset as usize,
                unit(),
            )
            .unwrap();
            for k in 0..2 {
                for j in 0..3 {
                    for i in 0..4 {
                        prop_assert_eq!(
                            image.label_at([i, j, k]),
                            Some((i + 10 * j + 100 * k) as i32)
                        );
                    }
                }
            }
        }
    }

    fn error(result: Result<LabelImage>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn refuses_what_it_cannot_hold() {
        let from = |v: Voxels<'_>, dims, strides, offset| {
            error(LabelImage::from_voxels(v, dims, strides, offset, unit()))
        };
        assert_eq!(from(Voxels::U8(&[]), [0, 1, 1], None, 0), "image axis 0 has 0 voxels");
        assert!(from(Voxels::U8(&[1]), [1 << 16, 1 << 16, 1], None, 0).contains("too large"));
        assert!(from(Voxels::U8(&[1]), [usize::MAX, usize::MAX, 2], None, 0).contains("too large"));
        assert!(from(Voxels::U8(&[1; 7]), [2, 2, 2], None, 0).contains("buffer has 7"));
        assert!(from(Voxels::U8(&[1; 8]), [2, 2, 2], None, 1).contains("to 8"));
        assert!(
            from(Voxels::U8(&[1; 8]), [2, 2, 2], Some([-1, 2, 4]), 0).contains("from element -1")
        );
        assert!(
            from(Voxels::U8(&[1; 8]), [2, 2, 2], Some([isize::MAX; 3]), usize::MAX)
                .contains("buffer has 8")
        );
        assert!(
            from(Voxels::U32(&[1, u32::MAX]), [1, 2, 1], None, 0)
                .contains("label 4294967295 of voxel (0, 1, 0)")
        );
        assert!(from(Voxels::I64(&[i64::MIN]), [1, 1, 1], None, 0).contains("does not fit"));
    }

    #[test]
    fn as_many_labels_as_ids_and_not_one_more() {
        let mut labels: Vec<i32> = (0..65_535).rev().map(|i| i * 3).collect();
        let image =
            LabelImage::from_voxels(Voxels::I32(&labels), [65_535, 1, 1], None, 0, unit()).unwrap();
        assert_eq!(image.labels().len(), 65_535);
        assert_eq!(labels_of(&image), labels);
        labels.push(-1);
        assert!(
            error(LabelImage::from_voxels(Voxels::I32(&labels), [65_536, 1, 1], None, 0, unit()))
                .contains("more than 65534")
        );
        let increasing: Vec<i32> = (0..65_536).collect();
        assert!(
            error(LabelImage::from_ids([1, 1, 1], unit(), vec![0], increasing))
                .contains("more than 65535")
        );
    }

    #[test]
    fn ids_are_checked_and_unused_ones_dropped() {
        let from = |ids: &[u16], labels: &[i32]| {
            LabelImage::from_ids([2, 1, 1], unit(), ids.to_vec(), labels.to_vec())
        };
        let image = from(&[3, 1], &[0, -2, 5, 9]).unwrap();
        assert_eq!((image.ids(), image.labels()), (&[2, 1][..], &[0, -2, 9][..]));
        assert!(error(from(&[2, 0], &[0, 1])).contains("id 2 occurs"));
        assert!(error(from(&[0], &[0])).contains("2 voxels"));
        assert!(error(from(&[0, 0], &[])).contains("id 0 must be 0"));
        assert!(error(from(&[0, 1], &[0, 4, 4])).contains("must increase"));
        assert!(error(from(&[0, 1], &[0, -4, 0])).contains("differ from 0"));
    }

    #[test]
    fn without_background_id_0_still_stands_for_label_0() {
        let image =
            LabelImage::from_voxels(Voxels::U8(&[4; 8]), [2, 2, 2], None, 0, unit()).unwrap();
        assert_eq!((image.labels(), image.voxel_counts()), (&[0, 4][..], vec![0, 8]));
        assert_eq!(image.label_at([2, 0, 0]), None);
    }

    #[test]
    fn voxel_volume_follows_the_spacing() {
        let image = LabelImage::from_voxels(
            Voxels::U8(&[1]),
            [1, 1, 1],
            None,
            0,
            Frame::axis_aligned([2.0, 3.0, 0.5]).unwrap(),
        )
        .unwrap();
        assert_eq!(image.voxel_volume(), 3.0);
    }
}
