//! Gray images: an intensity per voxel, cut into labels at isovalues.
//!
//! The interfaces of the label image made of one are isosurfaces of the intensity, interpolated
//! trilinearly between voxel centres: much closer to what was scanned than those of a segmentation,
//! whose voxels only know on which side they are.

use std::sync::Arc;

use super::builder::voxel_count;
use super::field::Field;
use super::{Frame, LabelImage};
use crate::{Error, Result};

/// Isovalues of an image at most: so many labels may meet in one cell of it, where intensity leaps.
pub const MAX_ISOVALUES: usize = 31;

/// A scan: an intensity for each voxel, x fastest, and its place in the world. 4 bytes per voxel,
/// which the label images made of it share.
#[derive(Clone, Debug, PartialEq)]
pub struct GrayImage {
    dims: [usize; 3],
    frame: Frame,
    voxels: Arc<Vec<f32>>,
}

impl GrayImage {
    /// # Errors
    /// [`Error::InvalidArgument`]: dims that are impossible or differ from the number of voxels; an
    /// intensity that is not finite.
    pub fn new(dims: [usize; 3], frame: Frame, voxels: Vec<f32>) -> Result<Self> {
        check_voxels(dims, &voxels, "intensity")?;
        Ok(Self { dims, frame, voxels: Arc::new(voxels) })
    }

    /// Voxels along each axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Place in the world.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The intensities, x fastest.
    pub fn voxels(&self) -> &[f32] {
        &self.voxels
    }

    /// The image of labels between isovalues v1 < v2 < ...: background below v1, `labels[0]` from
    /// v1 on, `labels[1]` from v2 on, and so forth. Without `labels` these are 1, 2, ... Label 0 is
    /// background and may stand there too, so that an interval of intensities is meshed; two
    /// intervals may have the same label.
    ///
    /// Isovalues are rounded to single precision, as the intensities are. An isovalue that many
    /// voxels have exactly puts the surface through their centres; half a unit beside it is better.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: no isovalue, more than [`MAX_ISOVALUES`], one that is not
    /// finite, or not above the one before it; not as many labels; no voxel from an isovalue to the
    /// next one, so that the label between would have none. [`Error::OutOfMemory`].
    pub fn label_image(&self, isovalues: &[f64], labels: Option<&[i32]>) -> Result<LabelImage> {
        let invalid = |message: String| Err(Error::InvalidArgument(message));
        if !(1..=MAX_ISOVALUES).contains(&isovalues.len()) {
            return invalid(format!(
                "1 to {MAX_ISOVALUES} isovalues are needed, got {}",
                isovalues.len()
            ));
        }
        let rounded: Vec<f32> = isovalues.iter().map(|&v| v as f32).collect();
        if let Some(n) = rounded.iter().position(|v| !v.is_finite()) {
            return invalid(format!("isovalues must be finite, got {}", isovalues[n]));
        }
        if let Some(n) = (1..rounded.len()).find(|&n| rounded[n] <= rounded[n - 1]) {
            return invalid(format!(
                "isovalues must increase, got {} after {}",
                isovalues[n],
                isovalues[n - 1]
            ));
        }
        let mut of_class = vec![0];
        match labels {
            Some(labels) if labels.len() != isovalues.len() => {
                return invalid(format!(
                    "{} isovalues need as many labels, got {}",
                    isovalues.len(),
                    labels.len()
                ));
            }
            Some(labels) => of_class.extend(labels),
            None => of_class.extend(1..=isovalues.len() as i32),
        }
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut seen = vec![false; of_class.len()];
        for &x in self.voxels.iter() {
            (min, max) = (min.min(x), max.max(x));
            seen[rounded.partition_point(|&v| v <= x)] = true;
        }
        if let Some(n) = (1..seen.len()).find(|&n| !seen[n]) {
            let up_to = isovalues.get(n).map_or(String::new(), |next| format!(" and below {next}"));
            return invalid(format!(
                "no voxel has an intensity of {} or more{up_to}; the image has {min} to {max}",
                isovalues[n - 1]
            ));
        }
        let field = Field::Intensities {
            voxels: self.voxels.clone(),
            isovalues: rounded,
            labels: of_class,
        };
        field.label_image(self.dims, self.frame)
    }
}

/// Checks that there is a finite value for each voxel; `what` names the values.
pub(super) fn check_voxels(dims: [usize; 3], values: &[f32], what: &str) -> Result<()> {
    let count = voxel_count(dims)?;
    if values.len() != count {
        return Err(Error::InvalidArgument(format!(
            "{count} voxels need as many values of {what}, got {}",
            values.len()
        )));
    }
    match values.iter().position(|x| !x.is_finite()) {
        Some(voxel) => Err(Error::InvalidArgument(format!(
            "{what} of voxel {:?} is {}; it must be finite",
            index_of(voxel, dims),
            values[voxel]
        ))),
        None => Ok(()),
    }
}

/// Where voxel number `voxel` lies in the grid.
pub(super) fn index_of(voxel: usize, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    [voxel % nx, voxel / nx % ny, voxel / (nx * ny)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(voxels: &[f32]) -> Result<GrayImage> {
        GrayImage::new(
            [voxels.len(), 1, 1],
            Frame::axis_aligned([1.0; 3]).unwrap(),
            voxels.to_vec(),
        )
    }

    fn labels_of(image: &LabelImage) -> Vec<i32> {
        image.ids().iter().map(|&id| image.labels()[usize::from(id)]).collect()
    }

    #[test]
    fn voxels_are_labelled_by_the_isovalues_that_they_reach() {
        let image = gray(&[-5.0, 1.0, 1.5, 2.0, 9.0]).unwrap();
        let labelled = |isovalues: &[f64], labels: Option<&[i32]>| {
            labels_of(&image.label_image(isovalues, labels).unwrap())
        };
        assert_eq!(labelled(&[1.0, 2.0], None), [0, 1, 1, 2, 2]);
        assert_eq!(labelled(&[1.0, 2.0], Some(&[-7, 0])), [0, -7, -7, 0, 0]);
        assert_eq!(labelled(&[1.0, 2.0], Some(&[4, 4])), [0, 4, 4, 4, 4]);
        let merged = image
            .label_image(&[1.2, 2.0, 3.0], None)
            .unwrap()
            .merged(&[(1, 3), (0, 8)].into(), 0)
            .unwrap();
        assert_eq!(labels_of(&merged), [8, 8, 3, 2, 3]);
        assert_eq!(labels_of(&merged.restricted_to(&[2]).unwrap()), [0, 0, 0, 2, 0]);
    }

    #[test]
    fn errors_name_the_value() {
        let message = |isovalues: &[f64], labels: Option<&[i32]>| {
            gray(&[0.0, 1.0, 4.0]).unwrap().label_image(isovalues, labels).unwrap_err().to_string()
        };
        assert_eq!(message(&[], None), "1 to 31 isovalues are needed, got 0");
        assert_eq!(message(&[0.0; 32], None), "1 to 31 isovalues are needed, got 32");
        assert_eq!(message(&[f64::NAN], None), "isovalues must be finite, got NaN");
        assert_eq!(message(&[2.0, 1.0], None), "isovalues must increase, got 1 after 2");
        assert_eq!(
            message(&[1.0, 1.0 + 1e-12], None),
            "isovalues must increase, got 1.000000000001 after 1"
        );
        assert_eq!(message(&[1.0], Some(&[1, 2])), "1 isovalues need as many labels, got 2");
        assert_eq!(
            message(&[5.0], None),
            "no voxel has an intensity of 5 or more; the image has 0 to 4"
        );
        assert_eq!(
            message(&[2.0, 3.0], None),
            "no voxel has an intensity of 2 or more and below 3; the image has 0 to 4"
        );
        assert_eq!(
            gray(&[0.0, f32::NAN]).unwrap_err().to_string(),
            "intensity of voxel [1, 0, 0] is NaN; it must be finite"
        );
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        assert_eq!(
            GrayImage::new([2, 2, 1], frame, vec![0.0; 3]).unwrap_err().to_string(),
            "4 voxels need as many values of intensity, got 3"
        );
    }
}
