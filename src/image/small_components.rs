//! Small components of labels, and an image without them.

use std::collections::BTreeMap;

use glam::DVec3;

use super::LabelImage;
use crate::memory::{filled, reserve, room};
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

/// Voxels of a component that are reached between two questions whether to go on.
const ASK_EVERY: usize = 1 << 14;

/// What is known of a voxel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Known {
    Nothing,
    /// It was reached by the search that goes on.
    Reached,
    /// Its component is small.
    Small,
    /// Its component is not small.
    Large,
}

impl LabelImage {
    /// The image in which each component of fewer than `least` voxels has become a part of the
    /// label that most voxels around it have, background included (the smaller label on a tie), and
    /// these components. Labels of which nothing is left are gone. `go_on` is asked for each row of
    /// voxels, and every some thousand voxels of a component.
    ///
    /// Linear in the voxels and in those of small components.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an image made of intensities or probabilities;
    /// [`Error::OutOfMemory`]; those of `go_on`.
    pub fn without_small_components(
        &self,
        least: u64,
        go_on: impl Fn() -> Result<()>,
    ) -> Result<(Self, Vec<SmallComponent>)> {
        if self.field().is_some() {
            return Err(Error::InvalidArgument(format!(
                "components of fewer than {least} voxels can be left out of label images only, not \
                 of those made of intensities or probabilities"
            )));
        }
        let [nx, ny, _] = self.dims();
        let mut known = filled(self.ids().len(), Known::Nothing, "voxels of an image", &go_on)?;
        let mut ids = room(self.ids().len(), "voxels of an image")?;
        ids.extend_from_slice(self.ids());
        let mut small_components = Vec::new();
        let mut reached = Vec::new();
        for first in 0..self.ids().len() {
            if first % nx == 0 {
                go_on()?;
            }
            if self.ids()[first] == 0 || known[first] != Known::Nothing {
                continue;
            }
            let is_small = self.reach(first, least, &mut known, &mut reached, &go_on)?;
            reached
                .iter()
                .for_each(|&v| known[v] = if is_small { Known::Small } else { Known::Large });
            if is_small {
                let around = self.most_around(&reached);
                reached.iter().for_each(|&v| ids[v] = around);
                let center = DVec3::new(
                    (first % nx) as f64,
                    (first / nx % ny) as f64,
                    (first / (nx * ny)) as f64,
                );
                reserve(&mut small_components, 1, "small components")?;
                small_components.push(SmallComponent {
                    label: self.labels()[usize::from(self.ids()[first])],
                    position: self.frame().to_world(center).to_array(),
                    voxels: reached.len() as u64,
                });
            }
        }
        let image = Self::from_ids(self.dims(), *self.frame(), ids, self.labels().to_vec())?;
        Ok((image, small_components))
    }

    /// Reaches voxels of the component of `first` until there are no more, which is told, or it is
    /// not small.
    fn reach(
        &self,
        first: usize,
        least: u64,
        known: &mut [Known],
        reached: &mut Vec<usize>,
        go_on: impl Fn() -> Result<()>,
    ) -> Result<bool> {
        reached.clear();
        reached.push(first);
        known[first] = Known::Reached;
        let mut next = 0;
        while next < reached.len() {
            if reached.len() as u64 >= least {
                return Ok(false);
            }
            if next % ASK_EVERY == ASK_EVERY - 1 {
                go_on()?;
            }
            reserve(reached, 26, "voxels of a small component")?;
            let here = reached[next];
            next += 1;
            for v in self.around(here).filter(|&v| self.ids()[v] == self.ids()[first]) {
                match known[v] {
                    Known::Large => return Ok(false),
                    Known::Nothing => {
                        known[v] = Known::Reached;
                        reached.push(v);
                    }
                    Known::Reached | Known::Small => {}
                }
            }
        }
        Ok((reached.len() as u64) < least)
    }

    /// The id that most voxels around those of a component have.
    fn most_around(&self, component: &[usize]) -> u16 {
        let own = self.ids()[component[0]];
        let mut counts = BTreeMap::new();
        for v in component.iter().flat_map(|&v| self.around(v)).filter(|&v| self.ids()[v] != own) {
            *counts.entry(self.ids()[v]).or_insert(0_u64) += 1;
        }
        // Outside of the image there is background.
        counts.into_iter().rev().max_by_key(|&(_, count)| count).map_or(0, |(id, _)| id)
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
    use super::*;
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
        let (without, small_components) = image.without_small_components(2, || Ok(())).unwrap();
        assert_eq!(without.labels(), [0, 5, 7]);
        assert_eq!(without.voxel_counts(), [12 * 81 - 102, 100, 2]);
        let expected = [([-11.0, -4.0, -4.0], 1), ([-1.0, 0.0, 0.0], 1)];
        assert_eq!(
            small_components,
            expected.map(|(position, voxels)| SmallComponent { label: 7, position, voxels })
        );
        let (without, small_components) = image.without_small_components(3, || Ok(())).unwrap();
        assert_eq!((without.labels(), small_components.len()), ([0, 5].as_slice(), 3));
        let (same, none) = image.without_small_components(1, || Ok(())).unwrap();
        assert_eq!((same, none.len()), (image, 0));
    }
}
