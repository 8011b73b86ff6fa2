//! What an image knows beside the labels of its voxels: values at the voxel centres, from which the labels come and between which the smooth surface model interpolates.
//!
//! A field has *classes*, each with a label: the intervals of an intensity between isovalues, or probability maps. The label of a voxel is that of its class; merging and
//! selecting labels is done by giving classes other labels. Several maps of one label count as one, their sum: the probability of "one or the other".
//!
//! Values are shared between images that differ in the labels of classes only. Never changes, so any number of threads may read it.

use std::sync::Arc;

use super::builder::LabelBuilder;
use super::{Frame, LabelImage};
use crate::Result;

/// Values at the voxel centres, x fastest, with the labels of their classes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Field {
    /// A voxel of intensity x belongs to the class whose number is that of the isovalues that are not above x. `labels` has one element more than `isovalues`, which increase.
    Intensities { voxels: Arc<Vec<f32>>, isovalues: Vec<f32>, labels: Vec<i32> },
    /// A voxel belongs to the label whose maps add up to most, on a tie to the background or else the smallest label.
    Probabilities(Maps),
}

/// Probability maps, all of the same grid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Maps {
    maps: Arc<Vec<Vec<f32>>>,
    /// The label of each map, and at the end, where it counts, of what all of them leave to 1.
    labels: Vec<i32>,
    /// The different ones of `labels`, 0 first, the others increasing.
    pub(crate) distinct: Vec<i32>,
    /// The place in `distinct` of each of `labels`.
    places: Vec<usize>,
}

impl Maps {
    /// `labels`: of each map, and maybe one more, of what they leave to 1.
    pub(super) fn new(maps: Arc<Vec<Vec<f32>>>, labels: Vec<i32>) -> Self {
        let mut distinct = labels.clone();
        distinct.push(0);
        // 0 before all others: as ids are ordered.
        distinct.sort_unstable_by_key(|&label| (label != 0, label));
        distinct.dedup();
        let place =
            |&label: &i32| distinct.binary_search_by_key(&(label != 0, label), |&known| (known != 0, known)).ok();
        let places = labels.iter().filter_map(place).collect();
        Self { maps, labels, distinct, places }
    }

    /// The probability at a voxel of each of the distinct labels. Values below 0, which resampling leaves, count as 0.
    #[inline]
    pub(crate) fn of_voxel(&self, voxel: usize, shares: &mut Vec<f32>) {
        shares.clear();
        shares.resize(self.distinct.len(), 0.0);
        let mut rest = 1.0;
        for (map, &place) in self.maps.iter().zip(&self.places) {
            let value = map[voxel].max(0.0);
            shares[place] += value;
            rest -= value;
        }
        if let Some(&place) = self.places.get(self.maps.len()) {
            shares[place] += rest.max(0.0);
        }
    }
}

impl Field {
    /// The field in which classes of label l have label `new(l)`.
    pub(super) fn relabelled(&self, new: impl Fn(i32) -> i32) -> Self {
        let renew = |labels: &[i32]| labels.iter().map(|&label| new(label)).collect();
        match self {
            Self::Intensities { voxels, isovalues, labels } => {
                Self::Intensities { voxels: voxels.clone(), isovalues: isovalues.clone(), labels: renew(labels) }
            }
            Self::Probabilities(maps) => Self::Probabilities(Maps::new(maps.maps.clone(), renew(&maps.labels))),
        }
    }

    /// The image of the labels at the voxel centres, with this field. One pass over the values.
    ///
    /// # Errors
    /// [`crate::Error::InvalidArgument`] for more than 65534 labels; [`crate::Error::OutOfMemory`].
    pub(super) fn label_image(self, dims: [usize; 3], frame: Frame) -> Result<LabelImage> {
        let mut builder = LabelBuilder::new(dims, usize::MAX)?;
        let mut row = vec![0; dims[0]];
        let mut shares = Vec::new();
        for first in (0..dims.iter().product()).step_by(dims[0]) {
            match &self {
                Self::Intensities { voxels, isovalues, labels } => {
                    for (slot, &x) in row.iter_mut().zip(&voxels[first..]) {
                        *slot = labels[isovalues.partition_point(|&isovalue| isovalue <= x)];
                    }
                }
                Self::Probabilities(maps) => {
                    for (i, slot) in row.iter_mut().enumerate() {
                        maps.of_voxel(first + i, &mut shares);
                        let best = (1..shares.len()).fold(0, |best, n| if shares[n] > shares[best] { n } else { best });
                        *slot = maps.distinct[best];
                    }
                }
            }
            builder.push(&row)?;
        }
        Ok(builder.finish(frame)?.with_field(self))
    }
}
