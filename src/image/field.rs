//! What an image knows beside the labels of its voxels: values at the voxel centres, from which the
//! labels come and between which the smooth surface model interpolates.
//!
//! A field has *classes*, each with a label: the intervals of an intensity between isovalues, or
//! probability maps. The label of a voxel is that of its class; merging and selecting labels is
//! done by giving classes other labels. Several maps of one label count as one, their sum: the
//! probability of "one or the other".
//!
//! Values are shared between images that differ in the labels of classes only. Never changes, so
//! any number of threads may read it.

use std::sync::Arc;

use super::builder::LabelBuilder;
use super::{Frame, LabelImage};
use crate::Result;

/// Values at the voxel centres, x fastest, with the labels of their classes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Field {
    /// A voxel of intensity x belongs to the class whose number is that of the isovalues that are
    /// not above x. `labels` has one element more than `isovalues`, which increase.
    Intensities { voxels: Arc<Vec<f32>>, isovalues: Vec<f32>, labels: Vec<i32> },
    /// A voxel belongs to the label of the largest value, on a tie to the background or else the
    /// smallest label.
    Probabilities(Maps),
}

/// What the values of maps are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapValues {
    /// Probabilities. Several maps of one label count as their sum, values below 0 as 0.
    Probabilities,
    /// Level sets: functions above 0 inside of their label, such as signed distances. Several maps
    /// of one label count as the largest of them.
    LevelSets,
}

/// Maps of values, all of the same grid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Maps {
    values: MapValues,
    maps: Arc<Vec<Vec<f32>>>,
    /// The label of each map, and at the end, where it counts, of what all of them leave to 1, or
    /// of the level 0.
    labels: Vec<i32>,
    /// The different ones of `labels`, 0 first, the others increasing.
    pub(crate) distinct: Vec<i32>,
    /// The place in `distinct` of each of `labels`.
    places: Vec<usize>,
}

impl Maps {
    /// `labels`: of each map, and maybe one more, of what they leave to 1, or of the level 0.
    pub(super) fn new(values: MapValues, maps: Arc<Vec<Vec<f32>>>, labels: Vec<i32>) -> Self {
        let mut distinct = labels.clone();
        distinct.push(0);
        // 0 before all others: as ids are ordered.
        distinct.sort_unstable_by_key(|&label| (label != 0, label));
        distinct.dedup();
        let place = |&label: &i32| {
            distinct.binary_search_by_key(&(label != 0, label), |&known| (known != 0, known)).ok()
        };
        let places = labels.iter().filter_map(place).collect();
        Self { values, maps, labels, distinct, places }
    }

    /// The value at a voxel of each of the distinct labels, from 0 on.
    #[inline]
    pub(crate) fn of_voxel(&self, voxel: usize, shares: &mut Vec<f32>) {
        if self.values == MapValues::LevelSets {
            return self.levels_of_voxel(voxel, shares);
        }
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

impl Maps {
    /// The levels of a voxel less the smallest of them. The same is taken from all labels, so that
    /// the largest one stays the largest, between voxel centres too.
    fn levels_of_voxel(&self, voxel: usize, shares: &mut Vec<f32>) {
        shares.clear();
        shares.resize(self.distinct.len(), f32::NEG_INFINITY);
        let levels = self.maps.iter().map(|map| map[voxel]).chain([0.0]);
        let mut min = f32::INFINITY;
        for (level, &place) in levels.zip(&self.places) {
            shares[place] = level.max(shares[place]);
            min = level.min(min);
        }
        // A label that lost its maps to others has no level.
        shares.iter_mut().for_each(|share| *share = (*share - min).max(0.0));
    }
}

impl Field {
    /// The field in which classes of label l have label `new(l)`.
    pub(super) fn relabelled(&self, new: impl Fn(i32) -> i32) -> Self {
        let renew = |labels: &[i32]| labels.iter().map(|&label| new(label)).collect();
        match self {
            Self::Intensities { voxels, isovalues, labels } => Self::Intensities {
                voxels: voxels.clone(),
                isovalues: isovalues.clone(),
                labels: renew(labels),
            },
            Self::Probabilities(maps) => {
                Self::Probabilities(Maps::new(maps.values, maps.maps.clone(), renew(&maps.labels)))
            }
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
                        let best = (1..shares.len())
                            .fold(0, |best, n| if shares[n] > shares[best] { n } else { best });
                        *slot = maps.distinct[best];
                    }
                }
            }
            builder.push(&row)?;
        }
        Ok(builder.finish(frame)?.with_field(self))
    }
}
