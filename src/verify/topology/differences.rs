//! Where a mesh differs from its image in what is connected, while it is being made.
//!
//! The certificate tells of each component whether it is torn, merged, or has the image's Euler
//! characteristic; here it is found out where. Four things are looked at:
//!
//! | difference | what it is | file |
//! |---|---|---|
//! | [`Kind::Voxel`] | labels at voxel centres, compared but for where boundaries lie | `deform` |
//! | [`Kind::Touch`] | a label's mesh touches itself, its voxels do not | `touching` |
//! | [`Kind::Contact`] | voxels touch, the label's mesh does not | `touching` |
//! | [`Kind::Piece`] | a piece of a label is torn off, or where the image has none | `matching` |
//!
//! A mesh without any may still differ where it has a hole or a bridge smaller than a voxel: the
//! certificate has the last word.

use glam::DVec3;

use super::boundary_surface::BoundarySurfaces;
use super::deform::Labellings;
use super::matching::{Matching, Role};
use super::mesh_components::MeshComponents;
use super::touching::{Contacts, stray_touches};
use super::voxel_labels::labels_at_voxels;
use crate::Result;
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::image::region::Region;
use crate::memory::{reserve, room, zeroed};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// What differs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The label of a voxel's centre.
    Voxel,
    /// The mesh touches itself.
    Touch,
    /// The mesh does not touch itself.
    Contact,
    /// A component of the mesh stands for none of the image. It may hold no voxel's centre.
    Piece,
}

/// A place where the mesh differs from the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// What differs.
    pub kind: Kind,
    /// Where, in voxels of the image.
    pub index: DVec3,
}

/// Finds differences of meshes from one image.
pub struct Differences<'a> {
    image: &'a LabelImage,
    region: Region,
    /// The ids of the region's voxels, x fastest, then y.
    ids: Vec<u16>,
    components: ImageComponents,
    contacts: Contacts,
}

impl<'a> Differences<'a> {
    /// For meshes of `image`, whose object lies in `region`.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(
        image: &'a LabelImage,
        region: Region,
        oracle: &Oracle,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let [nx, ny, nz] = region.dims;
        let mut ids: Vec<u16> = zeroed(nx * ny * nz, "voxels of the region")?;
        let [wide, high, _] = image.dims();
        let first = region.first.map(|c| (c + 1) as usize);
        for z in 1..nz - 1 {
            monitor.advance(0)?;
            for y in 1..ny - 1 {
                let from = first[0] + wide * (first[1] + y - 1 + high * (first[2] + z - 1));
                ids[1 + nx * (y + ny * z)..][..nx - 2]
                    .copy_from_slice(&image.ids()[from..][..nx - 2]);
            }
        }
        let components = ImageComponents::new(image, &|_| monitor.advance(0))?;
        let contacts = Contacts::new(image, oracle, monitor)?;
        Ok(Self { image, region, ids, components, contacts })
    }

    /// Bytes that are needed at once, beside the mesh and what finds its boundaries.
    pub fn bytes_needed(image: &LabelImage, region: &Region) -> u64 {
        let [voxels, of_image] =
            [region.dims, image.dims()].map(|dims| dims.iter().map(|&n| n as u64).product::<u64>());
        // The labels of image and mesh, what is noted of each voxel, and a bit per cell.
        5 * voxels + of_image / 8
    }

    /// The differences of a mesh that has its facets.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn of(&self, mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Vec<Difference>> {
        let dims = self.region.dims;
        let [nx, ny, _] = dims;
        let from = labels_at_voxels(mesh, self.image, &self.region, monitor)?;
        let labellings = Labellings { dims, from: &from, to: &self.ids };
        let voxels = labellings.left(|| monitor.advance(0))?;
        drop(from);
        let first = DVec3::from(self.region.first.map(|c| c as f64));
        let of_voxel = |&v: &usize| {
            first + DVec3::from([v % nx, v / nx % ny, v / (nx * ny)].map(|c| c as f64))
        };
        let mut parts = MeshComponents::new(mesh, self.image, &self.components, monitor)?;
        let surfaces = BoundarySurfaces::measure(mesh, &mut parts, monitor)?;
        let touches = stray_touches(&surfaces.non_manifold, mesh, self.image);
        let open = self.contacts.open(mesh, self.image, monitor)?;
        let pieces = self.pieces(mesh, &parts)?;
        let mut all = Vec::new();
        let count = voxels.len() + touches.len() + open.len() + pieces.len();
        reserve(&mut all, count, "differences")?;
        let kind = |kind| move |index| Difference { kind, index };
        all.extend(voxels.iter().map(of_voxel).map(kind(Kind::Voxel)));
        all.extend(touches.into_iter().map(kind(Kind::Touch)));
        all.extend(open.into_iter().map(kind(Kind::Contact)));
        all.extend(pieces.into_iter().map(kind(Kind::Piece)));
        Ok(all)
    }

    /// A place in each component of the mesh that stands for none of the image, in voxels.
    fn pieces(&self, mesh: &TetMesh, components: &MeshComponents) -> Result<Vec<DVec3>> {
        let MeshComponents { list, overlaps, .. } = components;
        let matching = Matching::new(&self.components.list, list, overlaps)?;
        let pieces = list.iter().zip(&matching.roles).filter(|(_, (role, _))| *role != Role::Main);
        let mut places = room(list.len(), "components of the mesh")?;
        places.extend(pieces.map(|(piece, _)| self.image.frame().to_index(piece.place(mesh))));
        Ok(places)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::testing;
    use crate::params::SurfaceModel;

    /// Cubes of the mesh along a side of a voxel; the middle one holds the voxel's centre.
    const CUBES: usize = 3;

    proptest! {
        /// Two labels side by side, and a piece of the first within the second that holds no
        /// voxel's centre.
        #[test]
        fn a_piece_smaller_than_a_voxel_is_found(
            x in 3 * CUBES + 1..6 * CUBES,
            y in 0..3 * CUBES,
            z in 0..3 * CUBES,
        ) {
            let is_middle = |c: usize| c % CUBES == CUBES / 2;
            prop_assume!(![x, y, z].into_iter().all(is_middle));
            let label = |i: usize| if i < 3 { 1 } else { 2 };
            let frame = testing::box_frame([1.0; 3]);
            let image = testing::image([6, 3, 3], frame, |i, _, _| label(i));
            let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
            let (monitor, region) = (Monitor::silent(), Region::new(&image, &|| Ok(())).unwrap());
            let differences = Differences::new(&image, region, &oracle, &monitor).unwrap();
            let found = |piece: Option<[usize; 3]>| {
                let cubes = [6, 3, 3].map(|n| n * CUBES);
                let mut mesh = testing::kuhn_box(cubes, [1.0 / CUBES as f64; 3], |i, j, k| {
                    if Some([i, j, k]) == piece { 1 } else { label(i / CUBES) }
                });
                mesh.collect_facets(&monitor).unwrap();
                differences.of(&mesh, &monitor).unwrap()
            };
            prop_assert_eq!(found(None), []);
            let found = found(Some([x, y, z]));
            prop_assert_eq!(found.len(), 1);
            prop_assert_eq!(found[0].kind, Kind::Piece);
            let at = DVec3::from([x, y, z].map(|c| (c as f64 + 0.5) / CUBES as f64 - 0.5));
            prop_assert!((found[0].index - at).abs().max_element() < 0.5 / CUBES as f64);
        }
    }
}
