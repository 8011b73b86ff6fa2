//! Which component of the mesh stands for which component of the image, and what is lost, merged or
//! torn.
//!
//! A component of the image and one of the mesh belong together when each holds more of the other's
//! tets than any third one does. What is left over tells what went wrong: an image component
//! without tets is *lost*; one most of whose tets belong to a mesh component that stands for
//! another is *merged*; a mesh component most of whose tets lie in an image component that another
//! one stands for is a *piece* torn off; one that lies in no component of its label is *stray*.
//! Ties go to the one that comes first. Linear in the overlaps.

use std::collections::HashSet;

use super::mesh_components::{MeshComponent, Overlap, Tets};
use crate::Result;
use crate::image::components::ImageComponent;
use crate::memory::{filled, room};

/// What the mesh made of a component of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fate {
    /// A component of the mesh stands for it.
    Kept,
    /// It is part of a component of the mesh that stands for another one.
    Merged,
    /// No tet lies in it.
    #[default]
    Lost,
}

/// What a component of the mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It stands for a component of the image.
    Main,
    /// It is torn off from the one that stands for the component of the image in which it lies.
    Piece,
    /// It lies in no component of its label.
    Stray,
}

/// What belongs together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Matching {
    /// What became of each component of the image.
    pub fates: Vec<Fate>,
    /// The tets that lie in each component of the image.
    pub tets: Vec<Tets>,
    /// What each component of the mesh is, and the component of the image in which most of it lies.
    pub roles: Vec<(Role, Option<u32>)>,
}

impl Matching {
    /// Matches components by their `overlaps`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        image: &[ImageComponent],
        mesh: &[MeshComponent],
        overlaps: &[Overlap],
    ) -> Result<Self> {
        let mut tets = default(image.len())?;
        // The component with most tets, and how many.
        let mut of_image: Vec<Option<(u32, u64)>> = default(image.len())?;
        let mut of_mesh: Vec<Option<(u32, u64)>> = default(mesh.len())?;
        let raise = |best: &mut Option<(u32, u64)>, component, count| {
            if best.is_none_or(|(_, max)| count > max) {
                *best = Some((component, count));
            }
        };
        for &Overlap { mesh, image, tets: shared } in overlaps {
            if let Some(image) = image {
                tets[image as usize] += shared;
                raise(&mut of_image[image as usize], mesh, shared.count);
                raise(&mut of_mesh[mesh as usize], image, shared.count);
            }
        }
        let main_of_image = |image: u32| of_image[image as usize].map(|(mesh, _)| mesh);
        let main_of_mesh = |mesh: u32| of_mesh[mesh as usize].map(|(image, _)| image);
        let fate = |image: u32| match main_of_image(image) {
            None => Fate::Lost,
            Some(mesh) if main_of_mesh(mesh) == Some(image) => Fate::Kept,
            Some(_) => Fate::Merged,
        };
        let role = |mesh: u32| match main_of_mesh(mesh) {
            None => (Role::Stray, None),
            Some(image) if main_of_image(image) == Some(mesh) => (Role::Main, Some(image)),
            Some(image) => (Role::Piece, Some(image)),
        };
        let (mut fates, mut roles) =
            (room(image.len(), COMPONENTS)?, room(mesh.len(), COMPONENTS)?);
        fates.extend((0..image.len() as u32).map(fate));
        roles.extend((0..mesh.len() as u32).map(role));
        Ok(Self { fates, roles, tets })
    }

    /// The components of the image that are lost.
    pub fn lost(&self) -> HashSet<u32> {
        let lost = (0..).zip(&self.fates).filter(|(_, fate)| **fate == Fate::Lost);
        lost.map(|(component, _)| component).collect()
    }
}

/// What tables of this module have a row for, as errors name it.
const COMPONENTS: &str = "components";

/// A table of `count` components.
fn default<T: Clone + Default>(count: usize) -> Result<Vec<T>> {
    filled(count, T::default(), COMPONENTS, || Ok(()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mutual_majorities() {
        let image = vec![ImageComponent { id: 1, voxels: 1, euler: 1, first: [0; 3] }; 5];
        let mesh = vec![MeshComponent { label: 1, first: 0, tets: Tets::default() }; 4];
        let overlap = |mesh, image, count| Overlap {
            mesh,
            image,
            tets: Tets { count, volume: 0.5 * count as f64 },
        };
        // Mesh component 0 covers images 0 and 1; 1 is torn off image 0; 2 lies nowhere; 3 is image
        // 3, and has a tet in image 4, as much as in none.
        let overlaps = [
            overlap(0, Some(0), 10),
            overlap(0, Some(1), 5),
            overlap(1, Some(0), 3),
            overlap(1, None, 9),
            overlap(2, None, 2),
            overlap(3, Some(3), 7),
            overlap(3, Some(4), 1),
        ];
        let matching = Matching::new(&image, &mesh, &overlaps).unwrap();
        assert_eq!(
            matching.fates,
            [Fate::Kept, Fate::Merged, Fate::Lost, Fate::Kept, Fate::Merged]
        );
        let expected = [
            (Role::Main, Some(0)),
            (Role::Piece, Some(0)),
            (Role::Stray, None),
            (Role::Main, Some(3)),
        ];
        assert_eq!(matching.roles, expected);
        assert_eq!(
            matching.tets.iter().map(|tets| tets.count).collect::<Vec<_>>(),
            [13, 5, 0, 7, 1]
        );
    }
}
