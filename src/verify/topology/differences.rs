//! Where a mesh differs from its image in what is connected, or does not reach the walls where the
//! image cuts the object off, while it is being made.
//!
//! The certificate tells of each component whether it is torn, merged, or has the image's Euler
//! characteristic; here it is found out where. Five things are looked at:
//!
//! | difference | what it is | file |
//! |---|---|---|
//! | [`Kind::Voxel`] | labels at voxel centres, compared but for where boundaries lie | `deform` |
//! | [`Kind::Touch`] | a label's mesh touches itself, its voxels do not | `touching` |
//! | [`Kind::Contact`] | voxels touch, the label's mesh does not | `touching` |
//! | [`Kind::Piece`] | a piece of a label is torn off, or where the image has none | `matching` |
//! | [`Kind::Nick`] | the mesh ends before a wall, the object on it | `off_walls` |
//!
//! A mesh without any may still differ where it has a hole or a bridge smaller than a voxel: the
//! certificate has the last word.

use glam::DVec3;

use super::deform::Labellings;
use super::matching::{Matching, Role};
use super::measured::MeshTopology;
use super::mesh_components::MeshComponents;
use super::touching::{Contacts, stray_touches};
use super::voxel_labels::{Corners, VoxelLabels, visit_tets};
use crate::Result;
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::image::region::Region;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{filled, reserve, room, zeroed};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::verify::off_walls::facets_off_walls;

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
    /// An outer facet should lie on a wall, and does not.
    Nick,
}

/// A place where the mesh differs from the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// What differs.
    pub kind: Kind,
    /// Where, in voxels of the image.
    pub index: DVec3,
    /// The ids of the labels that it is about: what the image has there, and what the mesh has.
    /// Most are about one; nicks about none.
    pub ids: [u16; 2],
    /// Whether it is farther than a voxel: here, or at one of the 26 voxels around, the label that
    /// the image has is in none of the 27 voxels around in the mesh, or the other way round. So it
    /// is in the middle of a hole three voxels wide, and where something is lost. Voxels alone are.
    pub is_far: bool,
}

/// Where a mesh has changed since it was compared last.
pub struct Change<'a> {
    /// The blocks in which it has.
    pub blocks: &'a VoxelBlocks,
    /// Tets of the part of the mesh that is given, beyond which there are others of their label.
    pub cut: &'a [u32],
}

/// Finds differences of a mesh from an image, again and again while the mesh is made.
///
/// What was found is kept, with a label for each voxel. So of a mesh that has changed in some
/// places no more is needed than the part near these.
pub struct Differences<'a> {
    image: &'a LabelImage,
    region: Region,
    oracle: &'a Oracle,
    /// The ids of the region's voxels, x fastest, then y.
    ids: Vec<u16>,
    components: ImageComponents,
    contacts: Contacts,
    /// The ids of the mesh's labels at these voxels.
    found: Vec<u16>,
    /// The voxels that are left.
    left: Vec<usize>,
    touches: Vec<(u16, DVec3)>,
    pieces: Vec<Piece>,
    nicks: Vec<DVec3>,
}

/// A component of the mesh that stands for none of the image.
#[derive(Clone, Copy)]
struct Piece {
    /// The id of its label.
    id: u16,
    /// A place in it, in voxels.
    index: DVec3,
    /// The box around it, in voxels of the region.
    bounds: [DVec3; 2],
    /// The component of the image in which most of it lies.
    of: Option<u32>,
    /// A place in the component of the mesh that stands for that one, in voxels.
    main: Option<DVec3>,
}

impl<'a> Differences<'a> {
    /// For meshes of `image`, whose object lies in `region`.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(
        image: &'a LabelImage,
        region: Region,
        oracle: &'a Oracle,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let [nx, ny, nz] = region.dims;
        let mut ids: Vec<u16> = zeroed(nx * ny * nz, VOXELS)?;
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
        let contacts = Contacts::new(image, region, oracle, monitor)?;
        let found = zeroed(ids.len(), VOXELS)?;
        Ok(Self {
            image,
            region,
            oracle,
            ids,
            components,
            contacts,
            found,
            left: Vec::new(),
            touches: Vec::new(),
            pieces: Vec::new(),
            nicks: Vec::new(),
        })
    }

    /// The components of the image.
    pub(crate) fn of_image(&self) -> &ImageComponents {
        &self.components
    }

    /// Where it looks.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// Bytes that are held between two comparisons.
    pub fn bytes(&self) -> u64 {
        (size_of_val(self.ids.as_slice()) + size_of_val(self.found.as_slice())) as u64
    }

    /// Bytes that are needed at once, beside the mesh and what finds its boundaries.
    pub fn bytes_needed(image: &LabelImage, region: &Region) -> u64 {
        let [voxels, of_image] =
            [region.dims, image.dims()].map(|dims| dims.iter().map(|&n| n as u64).product::<u64>());
        // The labels of image and mesh, and what is noted of each voxel; in bits, 1.5 of contacts
        // per cell, and 1 of runs per voxel.
        5 * voxels + of_image * 5 / 16
    }

    /// Adds to the blocks in which a mesh has changed those of pieces that may have: whether they
    /// are pieces still is known when all of their tets are.
    pub fn add_pieces(&self, changed: &VoxelBlocks) {
        let mut any = true;
        // One may reach another.
        while any {
            any = false;
            let met = self.pieces.iter().filter(|piece| changed.meet(piece.bounds));
            for piece in met.filter(|piece| !changed.hold(piece.bounds)) {
                changed.add_box(piece.bounds);
                any = true;
            }
        }
    }

    /// The voxels that are farther than a voxel ([`Difference::is_far`]) in a mesh: those alone, so
    /// no topology is needed. `visit_tets` is to call what it gets for each tet of a label, with
    /// the label's id and its corners: for all, or for those near to some blocks, where the mesh
    /// has changed only in these since the last time.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory); those of
    /// `visit_tets`.
    pub(crate) fn far(
        &mut self,
        changed: Option<&VoxelBlocks>,
        visit_tets: impl Fn(&(dyn Fn(u16, [DVec3; 4]) + Sync)) -> Result<()>,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<Difference>> {
        self.forget_voxels(changed)?;
        let labels = VoxelLabels::new(&mut self.found, &self.region);
        let frame = self.image.frame();
        visit_tets(&|id, corners| {
            labels.add(id, &Corners::of(corners.map(|p| frame.to_index(p))))
        })?;
        // What is far is such a voxel, or has one beside it, so it is in the same cluster.
        let labellings = self.labellings();
        let left = labellings.left_with(|v| self.is_off_by_two(v), || monitor.advance(0))?;
        let mut far = room(left.len(), WHAT)?;
        far.extend(left.into_iter().map(|v| self.of_voxel(v)).filter(|found| found.is_far));
        Ok(far)
    }

    /// The differences of a mesh that has its facets, and of which `topology` was measured. With a
    /// `change`, which tells how it differs from the mesh before, all of its tets that come near to
    /// the blocks are enough; the blocks have those of [`Self::add_pieces`].
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub(crate) fn of(
        &mut self,
        mesh: &TetMesh,
        topology: &MeshTopology,
        change: Option<&Change<'_>>,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<Difference>> {
        let pieces = self.find_pieces(mesh, &topology.components, change)?;
        self.pieces.retain(|piece| change.is_some_and(|change| !change.blocks.meet(piece.bounds)));
        reserve(&mut self.pieces, pieces.len(), WHAT)?;
        self.pieces.extend(pieces);

        let region = self.region;
        let has_changed =
            |index: DVec3| change.is_none_or(|change| change.blocks.has(region.offset(index)));
        // At the rim of a part a mesh seems to touch itself, and to end, where it does not.
        let touches = stray_touches(&topology.surfaces.non_manifold, mesh, self.image);
        self.touches.retain(|&(_, index)| !has_changed(index));
        reserve(&mut self.touches, touches.len(), WHAT)?;
        self.touches.extend(touches.into_iter().filter(|&(_, index)| has_changed(index)));
        let nicks = facets_off_walls(mesh, self.oracle, monitor)?;
        let nicks = nicks.into_iter().map(|centroid| self.image.frame().to_index(centroid));
        self.nicks.retain(|&index| !has_changed(index));
        reserve(&mut self.nicks, nicks.len(), WHAT)?;
        self.nicks.extend(nicks.filter(|&index| has_changed(index)));
        self.contacts.forget(has_changed);
        self.look_at_tets(mesh, change, monitor)?;
        self.compare_voxels(change, monitor)?;

        self.all()
    }

    /// Whether a mesh that has its facets ends before a wall somewhere.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub(crate) fn has_nicks(&self, mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<bool> {
        Ok(!facets_off_walls(mesh, self.oracle, monitor)?.is_empty())
    }

    /// All that are known.
    fn all(&self) -> Result<Vec<Difference>> {
        let mut all = Vec::new();
        let open = self.contacts.open().count();
        let count =
            [self.left.len(), open, self.touches.len(), self.pieces.len(), self.nicks.len()];
        reserve(&mut all, count.iter().sum(), WHAT)?;
        let of_kind =
            |kind| move |(id, index)| Difference { kind, index, ids: [id; 2], is_far: false };
        all.extend(self.left.iter().map(|&v| self.of_voxel(v)));
        all.extend(self.touches.iter().copied().map(of_kind(Kind::Touch)));
        all.extend(self.contacts.open().map(of_kind(Kind::Contact)));
        let pieces = self.pieces.iter().map(|piece| (piece.id, piece.index));
        all.extend(pieces.map(of_kind(Kind::Piece)));
        all.extend(self.nicks.iter().map(|&index| (0, index)).map(of_kind(Kind::Nick)));
        Ok(all)
    }

    /// The difference at a voxel of the region.
    fn of_voxel(&self, v: usize) -> Difference {
        let [nx, ny, _] = self.region.dims;
        let [x, y, z] = [v % nx, v / nx % ny, v / (nx * ny)];
        let ids = [self.ids[v], self.found[v]];
        let is_far = self.around(v).any(|u| self.is_off_by_two(u));
        let first = DVec3::from(self.region.first.map(|c| c as f64));
        let index = first + DVec3::from([x, y, z].map(|c| c as f64));
        Difference { kind: Kind::Voxel, index, ids, is_far }
    }

    /// Finds the mesh's labels at voxels, and which contacts it reaches.
    fn look_at_tets(
        &mut self,
        mesh: &TetMesh,
        change: Option<&Change<'_>>,
        monitor: &Monitor<'_>,
    ) -> Result<()> {
        self.forget_voxels(change.map(|change| change.blocks))?;
        let labels = VoxelLabels::new(&mut self.found, &self.region);
        visit_tets(mesh, self.image, monitor, |id, corners| {
            labels.add(id, corners);
            self.contacts.add(id, corners);
        })
    }

    /// Forgets the mesh's labels at all voxels, or at those of some blocks.
    fn forget_voxels(&mut self, changed: Option<&VoxelBlocks>) -> Result<()> {
        let [nx, ny, _] = self.region.dims;
        let Some(blocks) = changed else {
            self.found.fill(0);
            return Ok(());
        };
        blocks.try_visit_voxels(0, |[x, y, z], count| {
            self.found[x + nx * (y + ny * z)..][..count].fill(0);
            Ok(())
        })
    }

    /// Finds the voxels that are left.
    fn compare_voxels(&mut self, change: Option<&Change<'_>>, monitor: &Monitor<'_>) -> Result<()> {
        let (before, go_on) = (std::mem::take(&mut self.left), || monitor.advance(0));
        self.left = match change {
            None => self.labellings().left(go_on)?,
            Some(change) => self.labellings().left_since(before, change.blocks, go_on)?,
        };
        Ok(())
    }

    /// The labels at voxels, in the mesh and in the image.
    fn labellings(&self) -> Labellings<'_> {
        Labellings { dims: self.region.dims, from: &self.found, to: &self.ids }
    }

    /// Whether the label of a voxel in the image is two voxels away at least in the mesh, or the
    /// other way round.
    fn is_off_by_two(&self, v: usize) -> bool {
        let (in_image, in_mesh) = (self.ids[v], self.found[v]);
        in_image != in_mesh
            && (self.around(v).all(|u| self.found[u] != in_image)
                || self.around(v).all(|u| self.ids[u] != in_mesh))
    }

    /// A voxel of the region and those around it. Voxels beyond the region are background in image
    /// and mesh, as those at its rim are.
    fn around(&self, v: usize) -> impl Iterator<Item = usize> + Clone {
        let [nx, ny, nz] = self.region.dims;
        let beside = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
        let [xs, ys, zs] = [beside(v % nx, nx), beside(v / nx % ny, ny), beside(v / (nx * ny), nz)];
        let rows = zs.flat_map(move |z| ys.clone().map(move |y| nx * (y + ny * z)));
        rows.flat_map(move |row| xs.clone().map(move |x| row + x))
    }

    /// The pieces of a mesh; of a part of one those whose tets may have changed and are all in it.
    /// Components that go on beyond the part are left out: they are larger than a block, and where
    /// such a piece is torn off voxels differ, too.
    fn find_pieces(
        &self,
        mesh: &TetMesh,
        components: &MeshComponents,
        change: Option<&Change<'_>>,
    ) -> Result<Vec<Piece>> {
        let mut is_cut = filled(components.list.len(), false, WHAT, || Ok(()))?;
        let of_cut = change.map_or(&[][..], |change| change.cut).iter();
        of_cut.filter_map(|&t| components.of(t)).for_each(|c| is_cut[c as usize] = true);
        // Of where most of it lies it has more tets than are seen.
        let (list, mut overlaps) = (&components.list, components.overlaps.clone());
        let mut largest = filled(components.list.len(), None, WHAT, || Ok(()))?;
        for (n, overlap) in overlaps.iter().enumerate() {
            let most: &mut Option<(usize, u64)> = &mut largest[overlap.mesh as usize];
            if most.is_none_or(|(_, count)| overlap.tets.count > count) {
                *most = Some((n, overlap.tets.count));
            }
        }
        let of_cut = largest.into_iter().zip(&is_cut).filter(|(_, is_cut)| **is_cut);
        for (n, _) in of_cut.filter_map(|(largest, _)| largest) {
            overlaps[n].tets.count += MANY;
        }
        let Matching { roles, .. } = Matching::new(&self.components.list, list, &overlaps)?;

        let mut main_of_image = filled(self.components.list.len(), None, WHAT, || Ok(()))?;
        for (c, &(role, of)) in roles.iter().enumerate() {
            if let Some(of) = of.filter(|_| role == Role::Main) {
                main_of_image[of as usize] = Some(c);
            }
        }
        let frame = self.image.frame();
        let place = |c: usize| frame.to_index(list[c].place(mesh));
        let mut found: Vec<Option<Piece>> = room(list.len(), WHAT)?;
        found.extend((0..list.len()).map(|c| {
            let (role, of) = roles[c];
            let main = match role {
                Role::Main => self.main_elsewhere(of?, change?),
                _ => of.and_then(|of| main_of_image[of as usize]).map(place),
            };
            let is_piece = !is_cut[c] && (role != Role::Main || main.is_some());
            let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
            let id = self.image.id_of(list[c].label).unwrap_or(0);
            is_piece.then(|| Piece { id, index: place(c), bounds, of, main })
        }));
        if found.iter().any(Option::is_some) {
            for (t, tet) in (0..).zip(&mesh.tets) {
                let component = components.of(t).and_then(|c| found[c as usize].as_mut());
                if let Some(Piece { bounds: [low, high], .. }) = component {
                    for at in tet.map(|v| self.region.offset(frame.to_index(mesh.point(v)))) {
                        (*low, *high) = (low.min(at), high.max(at));
                    }
                }
            }
        }
        let is_one = |(c, piece): &(usize, Piece)| {
            let [low, high] = piece.bounds;
            let holds = |p: DVec3| p.cmpge(low).all() && p.cmple(high).all();
            let is_main = roles[*c].0 == Role::Main
                && piece.main.is_some_and(|p| holds(self.region.offset(p)));
            !is_main && change.is_none_or(|change| change.blocks.meet(piece.bounds))
        };
        let found = (0..).zip(found).filter_map(|(c, piece)| Some((c, piece?)));
        Ok(found.filter(is_one).map(|(_, piece)| piece).collect())
    }

    /// A place in what stands for a component of the image, if a piece that may have changed was
    /// torn off from it and it itself has not changed there. It need not be in the part.
    fn main_elsewhere(&self, of: u32, change: &Change<'_>) -> Option<DVec3> {
        let known = self.pieces.iter().filter(|piece| change.blocks.meet(piece.bounds));
        let mut mains = known.filter(|piece| piece.of == Some(of)).filter_map(|piece| piece.main);
        mains.find(|&p| !change.blocks.has(self.region.offset(p)))
    }
}

/// More tets than a part of a mesh has.
const MANY: u64 = 1 << 40;

/// What tables and lists of this module have, as errors name it.
const VOXELS: &str = "voxels of the region";
const WHAT: &str = "differences";

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::testing;
    use crate::params::SurfaceModel;

    /// Cubes of the mesh along a side of a voxel; the middle one holds the voxel's centre.
    const CUBES: usize = 3;

    /// An image that is longer than some blocks, cubes of its meshes along the side of a voxel, and
    /// all cubes.
    const LONG: [usize; 3] = [22, 3, 2];
    const PER_SIDE: usize = 2;
    const OF_LONG: usize = 22 * 3 * 2 * PER_SIDE * PER_SIDE * PER_SIDE;

    /// A mesh of cubes with these labels, and the corners of a cube's tets in voxels.
    fn mesh_of(labels: &[i32]) -> TetMesh {
        let [nx, ny, nz] = LONG.map(|n| PER_SIDE * n);
        testing::kuhn_box([nx, ny, nz], [1.0 / PER_SIDE as f64; 3], |i, j, k| {
            labels[i + nx * (j + ny * k)]
        })
    }

    /// The differences of a mesh that has its facets.
    fn found(
        differences: &mut Differences<'_>,
        mesh: &TetMesh,
        change: Option<&Change<'_>>,
    ) -> Vec<Difference> {
        let monitor = Monitor::silent();
        let of_image = &differences.components;
        let topology = MeshTopology::measure(mesh, differences.image, of_image, &monitor).unwrap();
        differences.of(mesh, &topology, change, &monitor).unwrap()
    }

    /// All but pieces.
    fn sorted(differences: &[Difference]) -> Vec<(u8, [f64; 3])> {
        let chosen = differences.iter().filter(|d| d.kind != Kind::Piece);
        let mut chosen: Vec<_> = chosen.map(|d| (d.kind as u8, d.index.to_array())).collect();
        chosen.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap());
        chosen
    }

    #[test]
    fn what_has_not_changed_needs_no_tets() {
        let image = testing::image([3; 3], testing::box_frame([1.0; 3]), |_, _, _| 1);
        let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
        let (monitor, region) = (Monitor::silent(), Region::new(&image, &|| Ok(())).unwrap());
        let mut differences = Differences::new(&image, region, &oracle, &monitor).unwrap();
        let mut mesh = testing::kuhn_box([3; 3], [1.0; 3], |i, _, _| i32::from(i != 1));
        mesh.collect_facets(&monitor).unwrap();
        let before = found(&mut differences, &mesh, None);
        assert!(!before.is_empty());
        let blocks = VoxelBlocks::none(image.frame(), &region).unwrap();
        let change = Change { blocks: &blocks, cut: &[] };
        let mut part = TetMesh::default();
        part.collect_facets(&monitor).unwrap();
        let after = found(&mut differences, &part, Some(&change));
        assert_eq!(after, before);
    }

    /// A plate of one voxel with a hole so many voxels wide, and a voxel that is lost.
    #[test]
    fn holes_three_voxels_wide_are_far() {
        let frame = testing::box_frame([1.0; 3]);
        let plate = |k: usize| if k == 4 { 1 } else { 2 };
        let found_in = |image: &LabelImage, label: &dyn Fn(usize, usize, usize) -> i32| {
            let oracle = Oracle::new(image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
            let region = Region::new(image, &|| Ok(())).unwrap();
            let monitor = Monitor::silent();
            let mut differences = Differences::new(image, region, &oracle, &monitor).unwrap();
            let mut mesh = testing::kuhn_box([9; 3], [1.0; 3], label);
            mesh.collect_facets(&monitor).unwrap();
            let mut found = found(&mut differences, &mesh, None);
            found.retain(|difference| difference.kind == Kind::Voxel);
            found
        };
        let whole = testing::image([9; 3], frame, |_, _, k| plate(k));
        for (wide, is_far) in [(1, false), (2, false), (3, true), (5, true)] {
            let is_hole = |c: usize| (2..2 + wide).contains(&c);
            let found = found_in(&whole, &|i, j, k| {
                if is_hole(i) && is_hole(j) { 2 } else { plate(k) }
            });
            assert!(!found.is_empty(), "{wide} voxels");
            assert_eq!(found.iter().any(|found| found.is_far), is_far, "{wide} voxels");
        }
        let with_voxel =
            testing::image(
                [9; 3],
                frame,
                |i, j, k| {
                    if [i, j, k] == [4, 4, 7] { 3 } else { plate(k) }
                },
            );
        let found = found_in(&with_voxel, &|_, _, k| plate(k));
        let ids = [3, 2].map(|label| with_voxel.id_of(label).unwrap());
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].ids, found[0].is_far), (ids, true));
    }

    proptest! {
        /// Of a mesh that has changed here and there the part near the changes tells what all of it
        /// does. Of pieces it need not tell all. Where several components of the mesh lie in one of
        /// the image the largest one stands for it; how large one is that goes on elsewhere a part
        /// does not know. So any of them may be told, but nothing else.
        #[test]
        fn a_part_tells_what_all_does(
            voxels in prop::collection::vec(prop::sample::select(vec![0, 1, 1, 1, 2]), 22 * 3 * 2),
            faults in prop::collection::vec((0..OF_LONG, 0..3_i32), 0..30),
            changes in prop::collection::vec(
                prop::collection::vec((0..OF_LONG, 0..3_i32), 0..4), 1..4),
        ) {
            prop_assume!(voxels.iter().any(|&label| label != 0));
            let [nx, ny, _] = LONG;
            let frame = testing::box_frame([1.0; 3]);
            let image = testing::image(LONG, frame, |i, j, k| voxels[i + nx * (j + ny * k)]);
            let frame = image.frame();
            let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
            let (monitor, region) = (Monitor::silent(), Region::new(&image, &|| Ok(())).unwrap());
            let all = || Differences::new(&image, region, &oracle, &monitor).unwrap();

            let [wide, high] = [PER_SIDE * nx, PER_SIDE * ny];
            let at = |cube: usize| [cube % wide, cube / wide % high, cube / (wide * high)];
            let mut labels: Vec<i32> = (0..OF_LONG).map(|cube| {
                let [i, j, k] = at(cube).map(|c| c / PER_SIDE);
                voxels[i + nx * (j + ny * k)]
            }).collect();
            faults.into_iter().for_each(|(cube, label)| labels[cube] = label);
            let mut mesh = mesh_of(&labels);
            mesh.collect_facets(&monitor).unwrap();
            let mut differences = all();
            found(&mut differences, &mesh, None);

            for change in changes {
                let blocks = VoxelBlocks::none(image.frame(), &region).unwrap();
                for (cube, label) in change {
                    labels[cube] = label;
                    let corners = [0, 1].map(|by| at(cube).map(|c| (c + by) as f64 / 2.0));
                    blocks.add_around(corners.map(DVec3::from));
                }
                let mesh = mesh_of(&labels);
                differences.add_pieces(&blocks);
                let near = blocks.and_around().unwrap();
                let near_tets: Vec<bool> = mesh.tets.iter().map(|tet| {
                    let corners = tet.map(|v| mesh.point(v));
                    let middle = corners.iter().sum::<DVec3>() / 4.0;
                    let reach = corners.iter().map(|p| p.distance_squared(middle));
                    near.meet_ball(middle, reach.fold(0.0, f64::max))
                }).collect();
                let mut part = mesh_of(&labels);
                let mut cut = Vec::new();
                for (t, &is_near) in near_tets.iter().enumerate() {
                    let label = mesh.labels[t];
                    let goes_on = |u: &u32| {
                        let other = mesh.labels.get(*u as usize);
                        other == Some(&label) && !near_tets[*u as usize]
                    };
                    if !is_near {
                        part.labels[t] = 0;
                    } else if mesh.neighbors[t].iter().any(goes_on) {
                        cut.push(t as u32);
                    }
                }
                testing::connect(&mut part);
                part.collect_facets(&monitor).unwrap();
                let change = Change { blocks: near.blocks(), cut: &cut };
                let told = found(&mut differences, &part, Some(&change));
                let expected = found(&mut all(), &mesh, None);
                prop_assert_eq!(sorted(&told), sorted(&expected));
                let parts =
                    MeshComponents::new(&mesh, &image, &differences.components, &monitor).unwrap();
                let overlaps = parts.overlaps.iter();
                let may_be_told = |c: u32| {
                    let own = overlaps.clone().filter(|o| o.mesh == c).filter_map(|o| o.image);
                    let has_others =
                        |i| overlaps.clone().any(|o| o.mesh != c && o.image == Some(i));
                    own.clone().next().is_none() || own.clone().any(has_others)
                };
                for piece in told.iter().filter(|told| told.kind == Kind::Piece) {
                    let place = |c: u32| frame.to_index(parts.list[c as usize].place(&mesh));
                    let told = (0..parts.list.len() as u32).find(|&c| place(c) == piece.index);
                    prop_assert!(told.is_some_and(may_be_told), "{piece:?} is none");
                }
            }
        }

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
            let mut differences = Differences::new(&image, region, &oracle, &monitor).unwrap();
            let mut found_with = |piece: Option<[usize; 3]>| {
                let cubes = [6, 3, 3].map(|n| n * CUBES);
                let mut mesh = testing::kuhn_box(cubes, [1.0 / CUBES as f64; 3], |i, j, k| {
                    if Some([i, j, k]) == piece { 1 } else { label(i / CUBES) }
                });
                mesh.collect_facets(&monitor).unwrap();
                found(&mut differences, &mesh, None)
            };
            prop_assert_eq!(found_with(None), []);
            let found = found_with(Some([x, y, z]));
            prop_assert_eq!(found.len(), 1);
            prop_assert_eq!(found[0].kind, Kind::Piece);
            let at = DVec3::from([x, y, z].map(|c| (c as f64 + 0.5) / CUBES as f64 - 0.5));
            prop_assert!((found[0].index - at).abs().max_element() < 0.5 / CUBES as f64);
        }
    }
}
