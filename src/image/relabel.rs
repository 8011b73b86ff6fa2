//! Other labels for the same voxels: merging, another background, selection.
//!
//! A pass over the voxels each, linear; the image itself stays as it is.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{LabelImage, MAX_IDS};
use crate::memory::room;
use crate::{Error, Result};

impl LabelImage {
    /// The image in which each key of `merge` has become its value, all at once (so labels can be
    /// exchanged), and in which label `background` then counts as background. The values need not
    /// occur. 0 is a label like any other here: as a key it gives voxels of label 0 a label to be
    /// meshed with, as a value it makes a label background.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`], naming the label: one that does not occur in the image, one that
    /// does not fit into the table of labels, or label 0 beside another background, which would
    /// leave two of them.
    pub fn merged(&self, merge: &BTreeMap<i32, i32>, background: i32) -> Result<Self> {
        let mut label_of: Vec<Option<i32>> = vec![None; self.labels().len()];
        for (&from, &to) in merge {
            let id = self.id_of(from).filter(|&id| id != 0 || self.ids().contains(&0)).ok_or_else(
                || {
                    Error::InvalidArgument(format!(
                        "label {from} is to become {to}, but does not occur in the image"
                    ))
                },
            )?;
            label_of[usize::from(id)] = Some(to);
        }
        let new_labels = label_of.iter().zip(self.labels()).map(|(new, &old)| new.unwrap_or(old));
        let merged = self.with_labels(new_labels.collect())?;
        if background == 0 {
            return Ok(merged);
        }
        let Some(id) = merged.id_of(background) else {
            return Err(Error::InvalidArgument(format!(
                "label {background} is to be the background, but does not occur in the image"
            )));
        };
        if merged.ids().contains(&0) {
            return Err(Error::InvalidArgument(format!(
                "label 0 occurs beside the background label {background}: merge it into \
                 {background} or into another label"
            )));
        }
        let mut labels = merged.labels().to_vec();
        labels[usize::from(id)] = 0;
        merged.with_labels(labels)
    }

    /// The image in which every label not in `keep` is background. 0 in `keep` has no effect.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] names a kept label that does not occur.
    pub fn restricted_to(&self, keep: &[i32]) -> Result<Self> {
        let mut labels = vec![0; self.labels().len()];
        for &label in keep {
            let id = self.id_of(label).ok_or_else(|| {
                Error::InvalidArgument(format!(
                    "label {label} is to be kept, but does not occur in the image"
                ))
            })?;
            labels[usize::from(id)] = label;
        }
        self.with_labels(labels)
    }

    /// The image in which id `i` has become label `label_of[i]`.
    fn with_labels(&self, label_of: Vec<i32>) -> Result<Self> {
        if let Some(field) = self.field() {
            // A class whose label has no voxel keeps it: the sums of others only grow, so it stays
            // without.
            let new = |label: i32| self.id_of(label).map_or(label, |id| label_of[usize::from(id)]);
            return field.relabelled(new).label_image(self.dims(), *self.frame());
        }
        let mut labels: Vec<i32> = label_of.iter().copied().filter(|&label| label != 0).collect();
        labels.sort_unstable();
        labels.dedup();
        labels.insert(0, 0);
        if labels.len() > MAX_IDS {
            return Err(Error::InvalidArgument(format!(
                "{} labels besides the background are more than {}",
                labels.len() - 1,
                MAX_IDS - 1
            )));
        }
        let new_id =
            |label: &i32| labels[1..].binary_search(label).map_or(0, |place| (place + 1) as u16);
        let new_ids: Vec<u16> = label_of.iter().map(new_id).collect();
        let mut ids = room(self.ids().len(), "voxels of an image")?;
        ids.par_extend(self.ids().par_iter().map(|&id| new_ids[usize::from(id)]));
        // Each label is that of some voxels: all ids but 0 were, and 0 becomes another label only
        // where it was.
        Ok(Self::assembled(ids, labels, self.dims(), *self.frame()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Frame, Voxels};

    fn image(labels: &[i32]) -> LabelImage {
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        LabelImage::from_voxels(Voxels::I32(labels), [labels.len(), 1, 1], None, 0, frame).unwrap()
    }

    fn labels_of(image: &LabelImage) -> Vec<i32> {
        image.ids().iter().map(|&id| image.labels()[usize::from(id)]).collect()
    }

    #[test]
    fn restriction_keeps_only_the_named_labels() {
        let image = image(&[0, -5, 3, 7, 7, 3, -5, 0]);
        let kept = image.restricted_to(&[7, -5, 0, 7]).unwrap();
        assert_eq!(labels_of(&kept), [0, -5, 0, 7, 7, 0, -5, 0]);
        assert_eq!(kept.labels(), [0, -5, 7]);
        assert!(image.restricted_to(&[]).unwrap().is_all_background());
        assert_eq!(
            image.restricted_to(&[3, 4]).unwrap_err().to_string(),
            "label 4 is to be kept, but does not occur in the image"
        );
    }

    #[test]
    fn merging_is_simultaneous() {
        let image = image(&[0, i32::MAX, 3, 4, i32::MIN, 3]);
        let merged = |merge: &[(i32, i32)]| {
            image.merged(&merge.iter().copied().collect(), 0).map(|merged| labels_of(&merged))
        };
        assert_eq!(merged(&[]).unwrap(), labels_of(&image));
        assert_eq!(merged(&[(3, 10), (4, 10)]).unwrap(), [0, i32::MAX, 10, 10, i32::MIN, 10]);
        assert_eq!(merged(&[(3, 4), (4, 3)]).unwrap(), [0, i32::MAX, 4, 3, i32::MIN, 4]);
        assert_eq!(
            merged(&[(i32::MIN, i32::MAX), (0, i32::MIN)]).unwrap(),
            [i32::MIN, i32::MAX, 3, 4, i32::MAX, 3]
        );
        assert_eq!(merged(&[(3, 0)]).unwrap(), [0, i32::MAX, 0, 4, i32::MIN, 0]);
        let message = |merge: &[(i32, i32)]| merged(merge).unwrap_err().to_string();
        assert_eq!(
            message(&[(3, 4), (5, 4)]),
            "label 5 is to become 4, but does not occur in the image"
        );
    }

    #[test]
    fn any_label_may_be_the_background() {
        let image = image(&[7, -2, 7, 9]);
        assert_eq!(labels_of(&image.merged(&BTreeMap::new(), 7).unwrap()), [0, -2, 0, 9]);
        assert_eq!(labels_of(&image.merged(&BTreeMap::from([(9, 7)]), 7).unwrap()), [0, -2, 0, 0]);
        let message = |merge: &[(i32, i32)], background| {
            image.merged(&merge.iter().copied().collect(), background).unwrap_err().to_string()
        };
        assert_eq!(
            message(&[], 3),
            "label 3 is to be the background, but does not occur in the image"
        );
        assert_eq!(
            message(&[(0, 1)], 0),
            "label 0 is to become 1, but does not occur in the image"
        );
        assert!(message(&[(9, 0)], 7).starts_with("label 0 occurs beside the background label 7"));
        let both = self::image(&[0, 7, 1]);
        assert_eq!(labels_of(&both.merged(&[(0, 5)].into(), 7).unwrap()), [5, 0, 1]);
    }
}
