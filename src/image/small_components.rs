//! Small components of labels, and an image without them.

use std::collections::BTreeMap;

use glam::DVec3;

use super::LabelImage;
use super::components::{ImageComponent, ImageComponents};
use crate::memory::room;
use crate::{Error, Result};

/// A component of a label, of voxels joined with all 26 around them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallComponent {
    /// Its label; never 0.
    pub label: i32,
    /// World position of the centre of its first voxel (x fastest).
    pub position: [f64; 3],
    /// Its voxels.
    pub voxels: u64,
}

impl LabelImage {
    /// The image in which each component of fewer than `min` voxels has become a part of the
    /// label that most voxels around it have, background included (the smaller label on a tie), and
    /// these components. Labels of which nothing is left are gone. `go_on` is asked again and
    /// again, from several threads.
    ///
    /// Linear in the voxels and in those of small components. Parallel in the current rayon pool.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an image made of intensities or probabilities;
    /// [`Error::OutOfMemory`]; those of `go_on`.
    pub fn without_small_components(
        &self,
        min: u64,
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<(Self, Vec<SmallComponent>)> {
        if self.field().is_some() {
            return Err(Error::InvalidArgument(format!(
                "components of fewer than {min} voxels can be left out of label images only, not \
                 of those made of intensities or probabilities"
            )));
        }
        let components = ImageComponents::new(self, go_on)?;
        let is_small = |component: &ImageComponent| component.voxels < min;
        // How many voxels of each id are around each small component; one that has several voxels
        // of it for neighbours counts as often.
        let mut around: BTreeMap<(usize, u16), u64> = BTreeMap::new();
        for (component, first, count) in components.runs(self.dims(), is_small) {
            go_on(0)?;
            let own = self.ids()[first];
            for v in (first..first + count).flat_map(|v| self.around(v)) {
                if self.ids()[v] != own {
                    *around.entry((component, self.ids()[v])).or_default() += 1;
                }
            }
        }
        // Outside of the image there is background.
        let most_around = |component: usize| {
            let counts = around.range((component, 0)..=(component, u16::MAX)).rev();
            counts.max_by_key(|&(_, &count)| count).map_or(0, |(&(_, id), _)| id)
        };
        let mut ids = room(self.ids().len(), "voxels of an image")?;
        ids.extend_from_slice(self.ids());
        for (component, first, count) in components.runs(self.dims(), is_small) {
            ids[first..first + count].fill(most_around(component));
        }
        let small = components.list.iter().filter(|&component| is_small(component));
        let mut small_components = room(small.clone().count(), "small components")?;
        small_components.extend(small.map(|component| {
            let center = DVec3::from(component.first.map(|c| c as f64));
            SmallComponent {
                label: self.labels()[usize::from(component.id)],
                position: self.frame().to_world(center).to_array(),
                voxels: component.voxels,
            }
        }));
        let image = Self::from_ids(self.dims(), *self.frame(), ids, self.labels().to_vec())?;
        Ok((image, small_components))
    }

    /// The voxels around one, up to 26.
    fn around(&self, v: usize) -> impl Iterator<Item = usize> + use<> {
        let [nx, ny, nz] = self.dims();
        let at = [v % nx, v / nx % ny, v / (nx * ny)];
        let range =
            |axis: usize, count: usize| at[axis].saturating_sub(1)..(at[axis] + 2).min(count);
        let (xs, ys) = (range(0, nx), range(1, ny));
        range(2, nz)
            .flat_map(move |z| {
                let xs = xs.clone();
                ys.clone().flat_map(move |y| xs.clone().map(move |x| x + nx * (y + ny * z)))
            })
            .filter(move |&other| other != v)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Frame;
    use crate::image::phantom::sampled;

    #[test]
    fn small_components_become_what_is_around_them() {
        // A block of label 5 with a voxel of label 7 in it, two voxels of label 7 that touch in a
        // corner beside it, and one at the corner of the image.
        let image = sampled([12, 9, 9], [2.0, 1.0, 1.0], |p| {
            match (p / DVec3::new(2.0, 1.0, 1.0)).to_array() {
                [-0.5, 0.0, 0.0] | [-5.5, -4.0, -4.0] => 7,
                [3.5, 2.0, 2.0] | [4.5, 3.0, 3.0] => 7,
                [x, y, z] if x.abs() < 2.0 && y.abs() < 2.5 && z.abs() < 2.5 => 5,
                _ => 0,
            }
        })
        .unwrap();
        assert_eq!(image.voxel_counts(), [12 * 81 - 103, 99, 4]);
        let (without, small_components) = image.without_small_components(2, &|_| Ok(())).unwrap();
        assert_eq!(without.labels(), [0, 5, 7]);
        assert_eq!(without.voxel_counts(), [12 * 81 - 102, 100, 2]);
        let expected = [([-11.0, -4.0, -4.0], 1), ([-1.0, 0.0, 0.0], 1)];
        assert_eq!(
            small_components,
            expected.map(|(position, voxels)| SmallComponent { label: 7, position, voxels })
        );
        let (without, small_components) = image.without_small_components(3, &|_| Ok(())).unwrap();
        assert_eq!((without.labels(), small_components.len()), ([0, 5].as_slice(), 3));
        let (same, none) = image.without_small_components(1, &|_| Ok(())).unwrap();
        assert_eq!((same, none.len()), (image, 0));
    }

    proptest! {
        /// Against a flood fill from each voxel.
        #[test]
        fn as_a_flood_fill_finds_them(
            values in prop::collection::vec(0..4_i32, 6 * 5 * 4),
            min in 2..9_u64,
        ) {
            let dims = [6, 5, 4];
            let frame = Frame::axis_aligned([1.0; 3]).unwrap();
            let ids = values.iter().map(|&v| v as u16).collect();
            let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2, 3]).unwrap();
            let (without, small) = image.without_small_components(min, &|_| Ok(())).unwrap();
            let mut found = Vec::new();
            for v in 0..values.len() {
                let label = |v: usize| image.labels()[usize::from(image.ids()[v])];
                let now = without.labels()[usize::from(without.ids()[v])];
                let mut component = vec![v];
                let mut next = 0;
                while let Some(&here) = component.get(next) {
                    next += 1;
                    for other in image.around(here).filter(|&other| label(other) == label(v)) {
                        if !component.contains(&other) {
                            component.push(other);
                        }
                    }
                }
                if label(v) == 0 || component.len() as u64 >= min {
                    prop_assert_eq!(now, label(v));
                    continue;
                }
                let mut counts = [0; 4];
                for other in component.iter().flat_map(|&v| image.around(v)) {
                    counts[label(other) as usize] += usize::from(label(other) != label(v));
                }
                let max = *counts.iter().max().unwrap();
                prop_assert_eq!(now, counts.iter().position(|&n| n == max).unwrap() as i32);
                if component.iter().min() == Some(&v) {
                    found.push((label(v), component.len() as u64));
                }
            }
            let small: Vec<_> = small.iter().map(|s| (s.label, s.voxels)).collect();
            prop_assert_eq!(small, found);
        }
    }
}
