//! Probability maps: for each label a volume that says how likely a voxel has it, as statistical
//! segmentation and neural networks give them.
//!
//! The interfaces of the label image made of them are where the largest of the interpolated
//! probabilities changes hands.

use std::sync::Arc;

use super::field::{Field, MapValues, Maps};
use super::gray::{check_voxels, index_of};
use super::{Frame, LabelImage};
use crate::{Error, Result};

/// How far a probability may be above 1, or below 0 without a word, for the rounding of files.
const TOLERANCE: f32 = 1e-3;

/// What is below this is no probability: resampling by splines overshoots by less.
const MIN: f32 = -0.5;

/// Probability maps, or level sets, of several labels on one grid. 4 bytes per voxel and map, which
/// the label image made of them shares.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbabilityImage {
    dims: [usize; 3],
    frame: Frame,
    values: MapValues,
    maps: Arc<Vec<Vec<f32>>>,
    labels: Vec<i32>,
}

impl ProbabilityImage {
    /// `maps[n]`, x fastest, is that of `labels[n]`. Where label 0, the background, is among them,
    /// only the ratio of values counts, and they may be of any scale; else the background has what
    /// all maps leave to 1. Values below 0 count as 0: [`Self::below_zero`] tells of them.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: no maps, or not as many as labels; a label given twice; a map
    /// whose size differs; a value that is not finite, or above 1 or below -0.5 where the
    /// background is taken from what the maps leave to 1.
    pub fn new(
        dims: [usize; 3],
        frame: Frame,
        maps: Vec<Vec<f32>>,
        labels: &[i32],
    ) -> Result<Self> {
        Self::with_source(dims, frame, MapValues::Probabilities, maps, labels, |_, error| error)
    }

    /// As [`Self::new`] of level sets: functions above 0 inside of their label, such as signed
    /// distances, of any scale, the same for all. The largest one wins. The background has the
    /// level 0, unless it has a map.
    ///
    /// # Errors
    /// Those of [`Self::new`], but for values out of a range.
    pub fn level_sets(
        dims: [usize; 3],
        frame: Frame,
        maps: Vec<Vec<f32>>,
        labels: &[i32],
    ) -> Result<Self> {
        Self::with_source(dims, frame, MapValues::LevelSets, maps, labels, |_, error| error)
    }

    /// As [`Self::new`]; `of_source` makes the error of a map, given by its number, that of where
    /// it comes from.
    pub(crate) fn with_source(
        dims: [usize; 3],
        frame: Frame,
        values: MapValues,
        maps: Vec<Vec<f32>>,
        labels: &[i32],
        of_source: impl Fn(usize, Error) -> Error,
    ) -> Result<Self> {
        if maps.is_empty() || maps.len() != labels.len() {
            return Err(Error::InvalidArgument(format!(
                "as many probability maps as labels are needed, at least one: got {} and {}",
                maps.len(),
                labels.len()
            )));
        }
        if let Some(n) = (1..labels.len()).find(|&n| labels[..n].contains(&labels[n])) {
            return Err(Error::InvalidArgument(format!(
                "two probability maps are given for label {}",
                labels[n]
            )));
        }
        for (n, (map, &label)) in maps.iter().zip(labels).enumerate() {
            let any_scale = values == MapValues::LevelSets || labels.contains(&0);
            check_map(dims, map, label, any_scale).map_err(|error| of_source(n, error))?;
        }
        Ok(Self { dims, frame, values, maps: Arc::new(maps), labels: labels.to_vec() })
    }

    /// The image in which each voxel has its most likely label; on a tie the background, or else
    /// the smaller label.
    ///
    /// Interfaces do not come between labels that are nowhere the most likely at a voxel centre:
    /// such a label has no voxel, and no tet; [`Self::nowhere_likeliest`] names them.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn label_image(&self) -> Result<LabelImage> {
        let mut labels = self.labels.clone();
        if !labels.contains(&0) {
            labels.push(0);
        }
        Field::Probabilities(Maps::new(self.values, self.maps.clone(), labels))
            .label_image(self.dims, self.frame)
    }

    /// A line for each label that tells how many of its values are below 0, and so count as 0, and
    /// which is the first.
    pub fn below_zero(&self) -> Vec<String> {
        if self.values == MapValues::LevelSets {
            return Vec::new();
        }
        let line = |(map, label): (&Vec<f32>, &i32)| {
            let is_below = |&p: &f32| p < -TOLERANCE;
            let first = map.iter().position(is_below)?;
            let (count, place) =
                (map.iter().copied().filter(is_below).count(), index_of(first, self.dims));
            let value = map[first];
            Some(format!(
                "{count} values of the probability of label {label} are below 0 and count as 0; \
                 the first, of voxel {place:?}, is {value}"
            ))
        };
        self.maps.iter().zip(&self.labels).filter_map(line).collect()
    }

    /// A line that tells how many voxels of the object several labels claim alike, if a hundredth
    /// or more do: such maps may be masks that overlap.
    pub fn ties(&self) -> Option<String> {
        const TOLD_FROM: usize = 100;
        let mut labels = self.labels.clone();
        if !labels.contains(&0) {
            labels.push(0);
        }
        let maps = Maps::new(self.values, self.maps.clone(), labels);
        let mut shares = Vec::new();
        let (mut count, mut of_object, mut first) = (0_usize, 0_usize, None);
        for voxel in 0..self.dims.iter().product() {
            maps.of_voxel(voxel, &mut shares);
            let max = shares.iter().copied().fold(0.0, f32::max);
            let mut leaders = (0..shares.len()).filter(|&n| shares[n] == max);
            // The background is the first of all, and wins ties.
            let [leader, other] = [leaders.next(), leaders.next()];
            of_object += usize::from(leader != Some(0));
            if let (Some(leader @ 1..), Some(other)) = (leader, other) {
                count += 1;
                first.get_or_insert((voxel, leader, other));
            }
        }
        let (voxel, leader, other) = first?;
        (count * TOLD_FROM >= of_object).then(|| {
            let [a, b] = [leader, other].map(|n| maps.distinct[n]);
            format!(
                "{count} of {of_object} voxels are as likely of one label as of another and went \
                 to the smaller; the first, {:?}, is of {a} and {b}",
                index_of(voxel, self.dims)
            )
        })
    }

    /// The labels with a map but without a voxel in `image`, which was made of these maps.
    pub fn nowhere_likeliest(&self, image: &LabelImage) -> Vec<i32> {
        self.labels.iter().copied().filter(|&label| image.id_of(label).is_none()).collect()
    }
}

/// Checks the map of a label: its size, and its values, which may be of any scale where the
/// background has a map.
fn check_map(dims: [usize; 3], map: &[f32], label: i32, any_scale: bool) -> Result<()> {
    let what = format!("the probability of label {label}");
    check_voxels(dims, map, &what)?;
    match map.iter().position(|&p| p > 1.0 + TOLERANCE) {
        Some(voxel) if !any_scale => Err(Error::InvalidArgument(format!(
            "{what} of voxel {:?} is {}: without a map of label 0 probabilities must not exceed 1",
            index_of(voxel, dims),
            map[voxel]
        ))),
        _ => match map.iter().position(|&p| p < MIN) {
            Some(voxel) if !any_scale => Err(Error::InvalidArgument(format!(
                "{what} of voxel {:?} is {}: probabilities lie between 0 and 1; level sets are \
                 read as such (--level-sets)",
                index_of(voxel, dims),
                map[voxel]
            ))),
            _ => Ok(()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn probabilities(maps: &[&[f32]], labels: &[i32]) -> Result<ProbabilityImage> {
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let maps: Vec<Vec<f32>> = maps.iter().map(|map| map.to_vec()).collect();
        ProbabilityImage::new([3, 1, 1], frame, maps, labels)
    }

    fn labels_of(image: &LabelImage) -> Vec<i32> {
        image.ids().iter().map(|&id| image.labels()[usize::from(id)]).collect()
    }

    #[test]
    fn values_below_0_are_told_or_refused() {
        let told = |maps: &[&[f32]], labels: &[i32]| {
            probabilities(maps, labels).map(|found| found.below_zero())
        };
        let maps: [&[f32]; 2] = [&[0.3, 1.0, -0.0005], &[-0.1, 0.1, -0.5]];
        let line = "2 values of the probability of label 4 are below 0 and count as 0; the first, \
         of voxel [0, 0, 0], is -0.1";
        assert_eq!(told(&maps, &[7, 4]).unwrap(), [line]);
        let level_set: [&[f32]; 1] = [&[0.3, -7.0, 0.0]];
        let refused = told(&level_set, &[3]).unwrap_err().to_string();
        assert!(
            refused.contains("voxel [1, 0, 0] is -7: probabilities lie between 0 and 1"),
            "{refused}"
        );
        // Of any scale, where the background has a map.
        let scores: [&[f32]; 2] = [&[0.3, -7.0, 0.0], &[1.0, 9.0, 5.0]];
        assert_eq!(told(&scores, &[3, 0]).unwrap().len(), 1);
    }

    #[test]
    fn the_most_likely_label_wins_and_the_background_has_the_rest() {
        let maps: [&[f32]; 3] = [&[0.3, 0.6, -0.1], &[0.3, 0.1, 0.6], &[0.1, 0.2, 0.3]];
        let image = probabilities(&maps, &[7, -2, 3]).unwrap();
        let labelled = image.label_image().unwrap();
        // A tie of 7 and -2, less than the rest of 0.3 or not is rounding's: so kept off here.
        assert_eq!(labels_of(&labelled)[1..], [7, -2]);
        assert_eq!(image.nowhere_likeliest(&labelled), [3]);
        // Merged labels have the sum of their probabilities.
        let merged = labelled.merged(&[(7, 5), (-2, 5)].into(), 0).unwrap();
        assert_eq!(labels_of(&merged), [5, 5, 5]);
        // Labels that are not kept are background: 0.3 against 0.7, 0.6 against 0.4.
        assert_eq!(labels_of(&labelled.restricted_to(&[7]).unwrap()), [0, 7, 0]);
        let scaled: [&[f32]; 2] = [&[200.0, 10.0, 90.0], &[55.0, 245.0, 90.0]];
        assert_eq!(
            labels_of(&probabilities(&scaled, &[0, 4]).unwrap().label_image().unwrap()),
            [0, 4, 0]
        );
    }

    #[test]
    fn overlapping_masks_are_told() {
        let ties = |maps: &[&[f32]], labels: &[i32]| probabilities(maps, labels).unwrap().ties();
        let masks: [&[f32]; 2] = [&[1.0, 1.0, 0.0], &[0.0, 1.0, 0.0]];
        let told = ties(&masks, &[9, 4]).unwrap();
        assert!(
            told.starts_with("1 of 2 voxels are as likely of one label as of another"),
            "{told}"
        );
        assert!(told.ends_with("the first, [1, 0, 0], is of 4 and 9"), "{told}");
        // Ties with the background are its own.
        let apart: [&[f32]; 2] = [&[0.5, 0.6, 0.0], &[0.0, 0.1, 0.5]];
        assert_eq!(ties(&apart, &[9, 4]), None);
    }

    #[test]
    fn the_largest_level_wins_and_the_background_has_level_0() {
        let level_sets = |maps: &[&[f32]], labels: &[i32]| {
            let frame = Frame::axis_aligned([1.0; 3]).unwrap();
            ProbabilityImage::level_sets(
                [3, 1, 1],
                frame,
                maps.iter().map(|map| map.to_vec()).collect(),
                labels,
            )
        };
        let maps: [&[f32]; 2] = [&[-7.0, 3.0, -1.0], &[-0.5, 2.0, 9.0]];
        let image = level_sets(&maps, &[4, 5]).unwrap();
        assert!(image.below_zero().is_empty());
        let labelled = image.label_image().unwrap();
        assert_eq!(labels_of(&labelled), [0, 4, 5]);
        // Merged labels have the larger level, those that are not kept leave theirs to the
        // background.
        assert_eq!(labels_of(&labelled.merged(&[(4, 6), (5, 6)].into(), 0).unwrap()), [0, 6, 6]);
        assert_eq!(labels_of(&labelled.restricted_to(&[5]).unwrap()), [0, 0, 5]);
        // A map of the background takes the place of the level 0.
        assert_eq!(
            labels_of(&level_sets(&maps, &[0, 5]).unwrap().label_image().unwrap()),
            [5, 0, 5]
        );
    }

    #[test]
    fn errors_name_the_value() {
        let message =
            |maps: &[&[f32]], labels: &[i32]| probabilities(maps, labels).unwrap_err().to_string();
        let map: &[f32] = &[0.0, 0.5, 1.0];
        assert_eq!(
            message(&[], &[]),
            "as many probability maps as labels are needed, at least one: got 0 and 0"
        );
        assert!(message(&[map], &[1, 2]).ends_with("got 1 and 2"));
        assert_eq!(message(&[map, map], &[4, 4]), "two probability maps are given for label 4");
        assert_eq!(
            message(&[map, &map[1..]], &[1, 2]),
            "3 voxels need as many values of the probability of label 2, got 2"
        );
        assert_eq!(
            message(&[&[0.0, f32::INFINITY, 0.0]], &[1]),
            "the probability of label 1 of voxel [1, 0, 0] is inf; it must be finite"
        );
        assert_eq!(
            message(&[&[0.0, 0.0, 255.0]], &[1]),
            "the probability of label 1 of voxel [2, 0, 0] is 255: without a map of label 0 \
             probabilities must not exceed 1"
        );
    }
}
