//! Connected components of a mesh's labels, and which of them lies in which component of the image.
//!
//! Tets of a label are joined across facets, to *parts*, and parts where they touch, to components:
//! as the voxels of the image are, which all 26 around join. So a component is a connected set of
//! closed tets, and where its parts only touch is listed as a place. A tet lies in the component of
//! the image that holds the voxel of its label nearest to its centroid, if that voxel is one of
//! those around it.
//!
//! Pure functions, parallel in the current rayon pool, practically linear. Which tets are joined
//! does not depend on the order of the unions, and volumes are summed in the order of the tets, so
//! equal input gives equal bits whatever the number of threads.

use std::ops::AddAssign;

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::geometry::measures::tet_centroid;
use crate::geometry::tet_block::{BLOCK, Places, TetBlock};
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::memory::{collected, filled, room};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::reduce::{KeyedSums, Sums};
use crate::reduce::{NO_SET, Numbered, UnionFind};

/// Tets of one piece of work, between two looks at the cancel flag; fixed, so that sums do not
/// depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// Tets and their volume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tets {
    /// How many.
    pub count: u64,
    /// Their volume, in cubic world units.
    pub volume: f64,
}

impl AddAssign for Tets {
    fn add_assign(&mut self, other: Self) {
        self.count += other.count;
        self.volume += other.volume;
    }
}

/// A component of one label.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshComponent {
    /// The label.
    pub label: i32,
    /// Its first tet.
    pub first: u32,
    /// All of its tets.
    pub tets: Tets,
}

impl MeshComponent {
    /// A place in it: the middle of its first tet.
    pub(crate) fn place(&self, mesh: &TetMesh) -> DVec3 {
        tet_centroid(&mesh.tets[self.first as usize].map(|v| mesh.point(v)))
    }
}

/// The tets of a component of the mesh that lie in one component of the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// The component of the mesh.
    pub mesh: u32,
    /// The component of the image; `None`: they lie in none of their label.
    pub image: Option<u32>,
    /// The tets.
    pub tets: Tets,
}

/// The components of a mesh: its parts, until those that touch are joined.
pub(crate) struct MeshComponents {
    /// The parts of the tets.
    parts: Numbered,
    of_parts: Vec<u32>,
    /// In the order of their first tets.
    pub list: Vec<MeshComponent>,
    /// In the order of mesh components, then of image components, none last.
    pub overlaps: Vec<Overlap>,
}

/// What lists of this module have, as errors name it.
const WHAT: &str = "components of the mesh";

impl MeshComponents {
    /// Finds the parts of all labels but 0, and where in `image` they lie; each is a component of
    /// its own until [`join`](Self::join) is called.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(
        mesh: &TetMesh,
        image: &LabelImage,
        image_components: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let parts = joined_tets(mesh, monitor)?;
        Self::with(parts, &[], mesh, image, image_components, monitor)
    }

    /// The same for who asks which component stands for which alone: volumes are not told. Where a
    /// label has one part here and one component in the image, all of that part lies there if its
    /// first tet does.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn to_match(
        mesh: &TetMesh,
        image: &LabelImage,
        image_components: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let parts = joined_tets(mesh, monitor)?;
        // Of each label: how many parts, how many components of the image, and the last of these.
        let mut of_labels = filled(image.labels().len(), (0_u32, 0_u32, 0), WHAT, || Ok(()))?;
        for &first in &parts.roots {
            if let Some(id) = image.id_of(mesh.labels[first as usize]) {
                of_labels[usize::from(id)].0 += 1;
            }
        }
        for (n, component) in (0..).zip(&image_components.list) {
            let (_, count, last) = &mut of_labels[usize::from(component.id)];
            (*count, *last) = (*count + 1, n);
        }
        let only = |&first: &u32| {
            let id = image.id_of(mesh.labels[first as usize])?;
            let (1, 1, only) = of_labels[usize::from(id)] else { return None };
            let corners = mesh.tets[first as usize].map(|v| mesh.point(v));
            let index = image.frame().to_index(tet_centroid(&corners));
            (image_components.near(image, id, index) == Some(only)).then_some(only)
        };
        let only = collected(parts.roots.iter().map(only), WHAT)?;
        Self::with(parts, &only, mesh, image, image_components, monitor)
    }

    /// That of these parts. All tets of a part for which `only` names a component of the image lie
    /// there.
    fn with(
        parts: Numbered,
        only: &[Option<u32>],
        mesh: &TetMesh,
        image: &LabelImage,
        image_components: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let lie = |(chunk, tets): (usize, &[[u32; 4]])| {
            monitor.advance(tets.len())?;
            let mut sums = OverlapSums {
                image,
                image_components,
                id_of_label: (0, None),
                places: Places::default(),
                sums: KeyedSums::default(),
            };
            let (mut block, mut keys) = (TetBlock::default(), Vec::with_capacity(BLOCK));
            for (t, tet) in (chunk * CHUNK..).zip(tets).filter(|&(t, _)| mesh.labels[t] != 0) {
                let part = parts.of(t as u32);
                if let Some(&Some(only)) = only.get(part as usize) {
                    sums.sums.add(overlap_key(part, only), Tets { count: 1, volume: 0.0 });
                    continue;
                }
                block.push(tet.map(|v| mesh.points[v as usize]));
                keys.push((mesh.labels[t], part));
                if block.is_full() {
                    sums.add(&block, &keys);
                    block.clear();
                    keys.clear();
                }
            }
            sums.add(&block, &keys);
            let keyed_sums = sums.sums;
            Ok(keyed_sums.sums())
        };
        let pieces: Vec<Sums<Tets>> =
            mesh.tets.par_chunks(CHUNK).enumerate().map(lie).collect::<Result<_>>()?;
        let overlaps = overlaps(KeyedSums::total(pieces));

        let component = |&first: &u32| MeshComponent {
            label: mesh.labels[first as usize],
            first,
            tets: Tets::default(),
        };
        let (mut list, mut of_parts) =
            (room(parts.roots.len(), WHAT)?, room(parts.roots.len(), WHAT)?);
        list.extend(parts.roots.iter().map(component));
        of_parts.extend(0..list.len() as u32);
        for overlap in &overlaps {
            list[overlap.mesh as usize].tets += overlap.tets;
        }
        Ok(Self { of_parts, parts, list, overlaps })
    }

    /// Joins the parts of each of `groups`.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn join<'g>(
        &mut self,
        groups: impl Iterator<Item = &'g [u32]>,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        let sets = UnionFind::new(self.list.len(), WHAT)?;
        for group in groups {
            group.windows(2).for_each(|pair| _ = sets.join(pair[0], pair[1]));
        }
        let joined = sets.numbered(|_| true, WHAT, &|| monitor.advance(0))?;
        self.of_parts.iter_mut().for_each(|component| *component = joined.of(*component));
        let mut list: Vec<MeshComponent> = room(joined.roots.len(), WHAT)?;
        for (part, component) in (0..).zip(self.list.drain(..)) {
            match list.get_mut(joined.of(part) as usize) {
                Some(joined) => joined.tets += component.tets,
                None => list.push(component),
            }
        }
        self.list = list;
        let mut keyed_sums = KeyedSums::default();
        for overlap in &self.overlaps {
            keyed_sums.add(
                overlap_key(joined.of(overlap.mesh), overlap.image.unwrap_or(NO_SET)),
                overlap.tets,
            );
        }
        self.overlaps = overlaps(keyed_sums.sums());
        Ok(())
    }

    /// The component of each part.
    pub fn of_parts(&self) -> &[u32] {
        &self.of_parts
    }

    /// The component of tet `t`; `None` for label 0, and for no tet.
    #[inline]
    pub fn of(&self, t: u32) -> Option<u32> {
        let part = (t != NONE).then(|| self.parts.of(t)).filter(|&part| part != NO_SET);
        part.map(|part| self.of_parts[part as usize])
    }
}

/// The tets of all labels but 0, joined across facets.
fn joined_tets(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Numbered> {
    let sets = UnionFind::new(mesh.tets.len(), "sets of tets")?;
    mesh.neighbors.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, neighbors)| {
        monitor.advance(neighbors.len())?;
        for (t, neighbors) in (chunk * CHUNK..).zip(neighbors) {
            let label = mesh.labels[t];
            // Each pair once.
            let is_same =
                |u: u32| u != NONE && (u as usize) < t && mesh.labels[u as usize] == label;
            if label != 0 {
                neighbors.iter().filter(|&&u| is_same(u)).for_each(|&u| _ = sets.join(t as u32, u));
            }
        }
        Ok(())
    })?;
    sets.numbered(|t| mesh.labels[t as usize] != 0, WHAT, &|| monitor.advance(0))
}

/// Sums of tets by the component of the image that they lie in.
struct OverlapSums<'a> {
    image: &'a LabelImage,
    image_components: &'a ImageComponents,
    /// The label of the tet before, and its id in the image: tets mostly have the same.
    id_of_label: (i32, Option<u16>),
    /// Of the tets of a block.
    places: Places,
    sums: KeyedSums<Tets>,
}

impl OverlapSums<'_> {
    /// Adds tets, each with its label and the part it belongs to.
    fn add(&mut self, block: &TetBlock, tets: &[(i32, u32)]) {
        let (image, frame) = (self.image, self.image.frame());
        block.places(|centroid| frame.to_index(centroid), &mut self.places);
        for (i, &(label, part)) in tets.iter().enumerate() {
            if label != self.id_of_label.0 {
                self.id_of_label = (label, image.id_of(label));
            }
            let [x, y, z] = &self.places.centroid;
            let index = DVec3::new(x[i], y[i], z[i]);
            let near = |id| self.image_components.near(image, id, index);
            let in_image = self.id_of_label.1.and_then(near).unwrap_or(NO_SET);
            let tet = Tets { count: 1, volume: self.places.volume[i] };
            self.sums.add(overlap_key(part, in_image), tet);
        }
    }
}

/// The key of a sum over what a component of the mesh has in one of the image, or in [`NO_SET`].
fn overlap_key(mesh: u32, in_image: u32) -> u64 {
    u64::from(mesh) << 32 | u64::from(in_image)
}

/// The overlaps with such sums.
fn overlaps(sums: Sums<Tets>) -> Vec<Overlap> {
    let overlap = |(key, tets): (u64, Tets)| {
        let in_image = key as u32;
        Overlap { mesh: (key >> 32) as u32, image: (in_image != NO_SET).then_some(in_image), tets }
    };
    sums.into_iter().map(overlap).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::testing;
    use crate::verify::topology::matching::Matching;

    const DIMS: [usize; 3] = [7, 5, 4];

    fn both(mesh: &TetMesh, image: &LabelImage) -> (ImageComponents, MeshComponents) {
        let monitor = Monitor::silent();
        let of_image = ImageComponents::new(image, &|_| Ok(())).unwrap();
        let of_mesh = MeshComponents::new(mesh, image, &of_image, &monitor).unwrap();
        (of_image, of_mesh)
    }

    proptest! {
        /// Which component stands for which does not depend on what is left out.
        #[test]
        fn what_is_told_to_match_matches_alike(
            voxels in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2]),
            moved in prop::collection::vec((0..DIMS[0] * DIMS[1] * DIMS[2], 0..3i32), 0..20),
        ) {
            let at = |i: usize, j: usize, k: usize| i + DIMS[0] * (j + DIMS[1] * k);
            let image =
                testing::image(DIMS, testing::box_frame([1.0; 3]), |i, j, k| voxels[at(i, j, k)]);
            let mut labels = voxels.clone();
            moved.into_iter().for_each(|(cell, label)| labels[cell] = label);
            let mesh = testing::kuhn_box(DIMS, [1.0; 3], |i, j, k| labels[at(i, j, k)]);
            let (of_image, all) = both(&mesh, &image);
            let monitor = Monitor::silent();
            let some = MeshComponents::to_match(&mesh, &image, &of_image, &monitor).unwrap();
            let [all, some] = [all, some].map(|MeshComponents { list, overlaps, .. }| {
                let counts: Vec<_> = list.iter().map(|c| (c.first, c.tets.count)).collect();
                (Matching::new(&of_image.list, &list, &overlaps).unwrap().roles, counts)
            });
            prop_assert_eq!(all, some);
        }

        /// The cubes of a Kuhn mesh share whole faces or nothing that joins tets: components are
        /// those of voxels joined across faces.
        #[test]
        fn a_mesh_of_voxels_against_flood_fill(
            values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2]),
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, testing::box_frame([1.0; 3]), label);
            let (of_image, of_mesh) = both(&testing::kuhn_box(DIMS, [1.0; 3], label), &image);
            let place = |cell: usize| {
                [cell % DIMS[0], cell / DIMS[0] % DIMS[1], cell / (DIMS[0] * DIMS[1])]
            };
            let mut seen = vec![false; values.len()];
            let mut components = of_mesh.list.iter().zip(&of_mesh.overlaps);
            for seed in (0..values.len()).filter(|&cell| values[cell] != 0) {
                let (mut stack, mut cells) = (vec![seed], 0_u64);
                while let Some(cell) = stack.pop() {
                    if std::mem::replace(&mut seen[cell], true) {
                        continue;
                    }
                    cells += 1;
                    let step = [1, DIMS[0], DIMS[0] * DIMS[1]];
                    for (axis, i) in place(cell).into_iter().enumerate() {
                        let below = (i > 0).then(|| cell - step[axis]);
                        let around = below
                            .into_iter()
                            .chain((i + 1 < DIMS[axis]).then(|| cell + step[axis]));
                        stack.extend(around.filter(|&other| values[other] == values[cell]));
                    }
                }
                if cells == 0 {
                    continue;
                }
                let (component, overlap) = components.next().unwrap();
                prop_assert_eq!(
                    (component.label, component.first as usize),
                    (values[seed], 6 * seed)
                );
                prop_assert_eq!(component.tets.count, 6 * cells);
                prop_assert!((component.tets.volume - cells as f64).abs() < 1e-9);
                prop_assert_eq!(of_mesh.of(6 * seed as u32), Some(overlap.mesh));
                prop_assert_eq!(
                    (overlap.image, overlap.tets),
                    (of_image.at(place(seed)), component.tets)
                );
            }
            prop_assert!(components.next().is_none());
        }
    }

    #[test]
    fn tets_that_lie_elsewhere() {
        let image =
            testing::image([5, 1, 1], testing::box_frame([1.0; 3]), |i, _, _| [1, 0, 1, 0, 0][i]);
        let mut mesh = testing::kuhn_box([5, 1, 1], [1.0; 3], |i, _, _| [1, 1, 1, 0, 2][i]);
        mesh.labels[6 * 3] = 7;
        testing::connect(&mut mesh);
        let (_, of_mesh) = both(&mesh, &image);
        let overlaps: Vec<_> =
            of_mesh.overlaps.iter().map(|o| (o.mesh, o.image, o.tets.count)).collect();
        // Tets of the cube in the middle lie near either voxel beside it.
        assert_eq!(overlaps, [(0, Some(0), 8), (0, Some(1), 10), (1, None, 1), (2, None, 6)]);
        assert_eq!(of_mesh.list.iter().map(|c| c.label).collect::<Vec<_>>(), [1, 7, 2]);
        assert_eq!(
            (of_mesh.of(6 * 3 + 1), of_mesh.of(NONE), of_mesh.of(6 * 4)),
            (None, None, Some(2))
        );
    }

    #[test]
    fn equal_bits_on_any_number_of_threads() {
        let label = |i: usize, j: usize, k: usize| {
            let wall = j % 2 == 1 && i != (if j % 4 == 1 { 0 } else { 29 });
            if wall { 7 + (k % 2) as i32 } else { i32::from(k % 5 != 4) }
        };
        let spacing = [0.3, 0.7, 1.1];
        let image = testing::image([30, 21, 24], testing::box_frame(spacing), label);
        let mut mesh = testing::kuhn_box([30, 21, 24], spacing, label);
        mesh.points.iter_mut().enumerate().for_each(|(v, p)| p[0] += 1e-3 * (v % 17) as f64);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| both(&mesh, &image).1)
        };
        let one = on(1);
        assert!(mesh.tets.len() > 3 * CHUNK);
        assert_eq!(one.list.len(), 5 + 120 + 120);
        for _ in 0..20 {
            let several = on(3);
            assert_eq!((&one.list, &one.overlaps), (&several.list, &several.overlaps));
        }
    }
}
