//! Topology that sampling could not make right: tunnels and bridges smaller than a voxel, mended in
//! the finished mesh.
//!
//! Refinement labels a tet by its circumcenter, which may lie outside of it. So a flat tet may have
//! another label than the image has in nearly all of it. Mostly that moves an interface by a part
//! of a voxel. But such a tet may leave open a tunnel through a thin label, or join two parts of
//! one. Samples closer than a voxel would be needed to get rid of it.
//!
//! **What is looked for.** For each component of the mesh that stands for one of the image: its
//! *excess*, the Euler characteristic that it has above that of the image's component. For a tunnel
//! too many it is -1. Around components whose excess is not 0, and those that stand for none of the
//! image, tets, and pairs of tets that share a facet, are candidates: if they have one label, and
//! the image has another one in most of their volume.
//!
//! **What is changed.** A candidate gets the label that the image has there, if the excess of each
//! component that changes comes nearer to 0 by it, or a piece that was torn off is joined again and
//! no excess gets larger. It is a ball, so what happens follows from the faces that it shares with
//! the other tets of a label ([`Faces`](crate::mesh::vicinity::Faces)). Let e be the Euler
//! characteristic of these faces. When a label gains the ball its own grows by 1 - e, when it loses
//! it by e - 1.
//!
//! - *Nothing is torn:* a label that loses a candidate shares one connected set of faces with it.
//!   The background alone may be parted: its components do not count.
//! - *Nothing is merged:* so does the label that gains it. Or it shares two, and both belong to one
//!   component, or one of the two is a piece that was torn off the other.
//! - *Nothing is lost:* each label shares some faces with a candidate that it loses; but for small
//!   pieces.
//! - *Facets:* none that comes to lie on an interface has an angle below half of what is asked for,
//!   or below the angle of a mesh that is coarsened, as long as the image's topology is found
//!   without; and no outer facet leaves the wall that it should lie on.
//! - *Vertices stay where they belong:* all corners of a candidate lie on interfaces already, and
//!   none is left with background alone around it.
//!
//! **Small pieces**, of a few tets, also go tet by tet, where the image has another label in these
//! and no excess gets larger by it. No piece gets larger, unless it is joined.
//!
//! So it is known all the time to which component a tet belongs, and what the excess of each is:
//! components and boundaries are measured once.
//!
//! **Order.** What was changed in an earlier mesh comes first, where there is one (`earlier`). Of
//! the others, those come first that bring no facet with a small angle to an interface, then those
//! where the new label's boundary touches itself in the fewest edges and corners, single tets
//! before pairs, and a larger part of the image before a smaller one. Each is judged again before
//! it is changed. Then candidates are looked for around what has changed, until there are none.
//!
//! **Limit.** Only Euler characteristics are compared. A tunnel too many and a cavity too many of
//! one component cancel out, and are not seen.
//!
//! Idea: handles too many are cut or filled where that changes least, as in I. Guskov and
//! Z. J. Wood, "Topological noise removal", 2001; here the image says where.
//!
//! | file | what it is |
//! |---|---|
//! | `earlier` | the tets that were changed in an earlier mesh, found again |
//! | `candidates` | the tets that the image says should have another label |
//! | `standings` | how components stand, and what becomes of them when tets change |
//!
//! While sampling goes on a mesh is mended for trial, too ([`trial`](super::trial)): what mending
//! can do needs no samples. Then a part of a mesh may be mended, which has all tets of some labels.
//! Components of others stay as they are, and so do tets at the rim of the part.
//!
//! Parallel but for the changes. The same for any number of threads, given the same mesh. Cost:
//! components and boundaries of the mesh, and a look at the image for each tet around components
//! that are not as in the image but for those that hold several of the image's.

mod candidates;
mod earlier;
mod standings;

use std::collections::HashSet;

use rayon::prelude::*;

use self::candidates::{Angles, Search, stars_around, suspects};
pub(super) use self::earlier::Earlier;
use self::standings::{Components, no_vertices};
pub(super) use self::standings::{Left, Mended};
use crate::Result;
use crate::delaunay::tet::FACET;
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::memory::bits::Bits;
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::params::{Adaptive, Improve, MeshParams};
use crate::verify::topology::measured::MeshTopology;

/// At first no facet that comes to lie on an interface has less than this part of the angle that is
/// asked for; where meshes are coarsened, than the angle that is asked for then.
const LEAST_ANGLE: f64 = 0.5;

/// What came of mending a mesh.
#[derive(Debug)]
pub(super) struct Mending {
    /// The tets that got another label, in order.
    pub tets: Vec<Mended>,
    /// What is not as in the image still.
    pub left: Left,
}

/// Whether what `params` ask for is mended: not where interfaces are to stay as refinement made
/// them.
pub(super) fn is_mended(params: &MeshParams) -> bool {
    params.improve == Improve::Full && params.adaptive == Adaptive::Topology
}

/// The angles that facets are to have which come to lie on an interface: at first, and where
/// something is not as in the image even so.
pub(super) fn passes(params: &MeshParams) -> [Angles; 2] {
    let least = params.coarsen.unwrap_or(LEAST_ANGLE * params.facet_angle);
    [least, 0.0].map(|least| [least, params.facet_angle])
}

/// Mends the topology of a mesh that has the background around the object, and no facets. Facets
/// that come to lie on an interface have the angles of the first of some [`passes`], or of the next
/// one while something is not as in the image.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub(super) fn mend(
    mesh: &mut TetMesh,
    image: &LabelImage,
    oracle: &Oracle,
    passes: &[Angles],
    monitor: &Monitor<'_>,
) -> Result<Mending> {
    let look = || monitor.advance(0);
    let quiet = Monitor::within(&look);
    let of_image = ImageComponents::new(image, &|_| look())?;
    mesh.collect_facets(&quiet)?;
    let topology = MeshTopology::measure(mesh, image, &of_image, &quiet)?;
    let (topology, earlier) = (&topology, &Earlier::default());
    let known = Known { topology, of_image: &of_image, earlier, labels: None };
    let mending = mend_measured(mesh, known, image, oracle, passes, &quiet)?;
    (mesh.facets, mesh.facet_labels, mesh.facet_tets) = Default::default();
    Ok(mending)
}

/// What is known of a mesh that is to be mended.
#[derive(Clone, Copy)]
pub(super) struct Known<'a> {
    /// Its topology.
    pub topology: &'a MeshTopology,
    /// The components of the image.
    pub of_image: &'a ImageComponents,
    /// The tets that were changed in an earlier mesh: they are tried first.
    pub earlier: &'a Earlier,
    /// The labels of which all tets are there, and those around them; `None`: that is so of all.
    /// Components of others stay as they are, and nothing is told of them.
    pub labels: Option<&'a HashSet<i32>>,
}

/// What is left where nothing is mended.
///
/// # Errors
/// [`OutOfMemory`](crate::Error::OutOfMemory).
pub(super) fn left_unmended(known: Known<'_>, image: &LabelImage) -> Result<Left> {
    Ok(Components::new(known, image)?.left())
}

/// The vertices of facets beyond which a part of a mesh has no tet.
fn rim_of(mesh: &TetMesh) -> Result<Bits> {
    let rim = no_vertices(mesh)?;
    mesh.tets.par_iter().zip(&mesh.neighbors).for_each(|(tet, neighbors)| {
        for i in (0..4).filter(|&i| neighbors[i] == NONE) {
            FACET[i].into_iter().for_each(|k| rim.set(tet[k]));
        }
    });
    Ok(rim)
}

/// Mends a mesh that has its facets. Facets stay those of before where there is one pass.
///
/// # Errors
/// As [`mend`].
pub(super) fn mend_measured(
    mesh: &mut TetMesh,
    known: Known<'_>,
    image: &LabelImage,
    oracle: &Oracle,
    passes: &[Angles],
    quiet: &Monitor<'_>,
) -> Result<Mending> {
    let mut tets = Vec::new();
    let mut components = Components::new(known, image)?;
    let rim = known.labels.map(|_| rim_of(mesh)).transpose()?;
    let mut change = |mesh: &mut TetMesh,
                      components: &mut Components<'_>,
                      suspects: &[(u32, i32)],
                      angles: Angles| {
        let stars = stars_around(mesh, suspects, quiet)?;
        let search = Search { mesh, components, image, oracle, angles, rim: rim.as_ref() };
        let candidates = search.candidates(suspects, &stars, quiet)?;
        components.change_all(mesh, &candidates, &stars, &mut tets)
    };
    for (n, &angles) in passes.iter().enumerate() {
        if n > 0 {
            if components.left() == Left::default() {
                break;
            }
            mesh.collect_facets(quiet)?;
        }
        // This ends: each change gives the label that the image has there to more than half of what
        // changes, so more and more of the mesh agrees with the image.
        let again = if n == 0 { known.earlier.found_in(mesh, quiet)? } else { Vec::new() };
        let changed = match again.is_empty() {
            true => None,
            false => change(mesh, &mut components, &again, angles)?,
        };
        let mut near = components.near_open(mesh, changed)?;
        while let Some(places) = near {
            let suspects = suspects(mesh, &components, &places, image, oracle, quiet)?;
            near = change(mesh, &mut components, &suspects, angles)?;
        }
    }
    if cfg!(debug_assertions) && !tets.is_empty() {
        let mut mesh = mesh.clone();
        mesh.collect_facets(quiet)?;
        let topology = &MeshTopology::measure(&mesh, image, known.of_image, quiet)?;
        components.check(&mesh, &Components::new(Known { topology, ..known }, image)?);
    }
    Ok(Mending { tets, left: components.left() })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::testing;
    use crate::params::SurfaceModel;
    use crate::verify::topology::boundary_surface::BoundarySurfaces;
    use crate::verify::topology::matching::{Fate, Matching, Role};
    use crate::verify::topology::mesh_components::MeshComponents;

    const DIMS: [usize; 3] = [5, 4, 4];
    const VOXELS: usize = DIMS[0] * DIMS[1] * DIMS[2];
    /// Of a mesh that has parts.
    const LONG: [usize; 3] = [12, 4, 3];

    /// How far a mesh is from the image: components lost or merged, pieces and stray ones, and the
    /// sum of all excesses. A component that holds several of the image has none: for which one it
    /// stands may depend on a single tet. Told besides: the tets of pieces and stray ones.
    fn faults(mesh: &TetMesh, image: &LabelImage) -> ([u64; 3], u64) {
        let (monitor, mut mesh) = (Monitor::silent(), mesh.clone());
        mesh.collect_facets(&monitor).unwrap();
        let of_image = ImageComponents::new(image, &|_| Ok(())).unwrap();
        let mut parts = MeshComponents::new(&mesh, image, &of_image, &monitor).unwrap();
        let surfaces = BoundarySurfaces::measure(&mesh, &mut parts, &monitor).unwrap();
        let matching = Matching::new(&of_image.list, &parts.list, &parts.overlaps).unwrap();
        let not_kept = matching.fates.iter().filter(|&&fate| fate != Fate::Kept).count();
        let not_main = matching.roles.iter().filter(|(role, _)| *role != Role::Main).count();
        let holds_several = |c: usize| {
            let of_mesh = parts.overlaps.iter().filter(|overlap| overlap.mesh as usize == c);
            let mut images = of_mesh.filter_map(|overlap| overlap.image);
            images.any(|i| matching.fates[i as usize] == Fate::Merged)
        };
        let excess = |(c, role): (usize, &(Role, Option<u32>))| match *role {
            (Role::Main, Some(i)) if !holds_several(c) => {
                (surfaces.euler[c] / 2 - of_image.list[i as usize].euler).unsigned_abs()
            }
            _ => 0,
        };
        let excess = matching.roles.iter().enumerate().map(excess).sum();
        let parts = matching.roles.iter().zip(&parts.list);
        let pieces = parts.filter(|((role, _), _)| *role != Role::Main);
        let tets = pieces.map(|(_, part)| part.tets.count).sum();
        ([not_kept as u64, not_main as u64, excess], tets)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Voxels of random labels, and their tets, of which some have a wrong label. Mending them
        /// leaves no more faults of any kind, and no vertex without a label that had one.
        #[test]
        fn no_fault_is_made(
            values in prop::collection::vec(0..3_i32, VOXELS),
            wrong in prop::collection::vec((0..6 * VOXELS, 0..3_i32), 0..25),
            others in prop::collection::vec((0..6 * VOXELS, 0..3_i32), 0..10),
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, testing::box_frame([1.0; 3]), label);
            let mut mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            wrong.iter().for_each(|&(t, label)| mesh.labels[t] = label);
            let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
            // What was changed in another mesh is tried first.
            let mut other = mesh.clone();
            others.iter().for_each(|&(t, label)| other.labels[t] = label);
            let mending = |mesh: &mut TetMesh, earlier: &Earlier| {
                let monitor = Monitor::silent();
                mesh.collect_facets(&monitor).unwrap();
                let of_image = ImageComponents::new(&image, &|_| Ok(())).unwrap();
                let topology = MeshTopology::measure(mesh, &image, &of_image, &monitor).unwrap();
                let (topology, of_image) = (&topology, &of_image);
                let known = Known { topology, of_image, earlier, labels: None };
                mend_measured(mesh, known, &image, &oracle, &[[0.0, 30.0]], &monitor).unwrap()
            };
            let earlier = mending(&mut other, &Earlier::default()).tets;
            let earlier = Earlier::new(&other, &earlier).unwrap();
            let before = mesh.clone();
            let Mending { tets: mended, left } = mending(&mut mesh, &earlier);
            let [was, is] = [&before, &mesh].map(|mesh| faults(mesh, &image));
            let no_more = |(was, is): (&u64, &u64)| is <= was;
            prop_assert!(was.0.iter().zip(&is.0).all(no_more), "{was:?}, then {is:?}");
            let sum = |(faults, tets): ([u64; 3], u64)| faults.iter().sum::<u64>() + tets;
            prop_assert!(mended.is_empty() || sum(is) < sum(was));
            prop_assert_eq!(left == Left::default(), is.0 == [0; 3]);
            let has_label = |mesh: &TetMesh| {
                let mut has = vec![false; mesh.points.len()];
                let labelled = mesh.tets.iter().zip(&mesh.labels).filter(|(_, label)| **label != 0);
                labelled.flat_map(|(tet, _)| tet).for_each(|&v| has[v as usize] = true);
                has
            };
            let [had, has] = [&before, &mesh].map(has_label);
            prop_assert!(had.iter().zip(&has).all(|(had, has)| has >= had));
        }
    }

    /// A mesh of some tets of another one, without its facets.
    fn part_of(mesh: &TetMesh, is_in_part: impl Fn(usize) -> bool) -> TetMesh {
        let tets: Vec<usize> = (0..mesh.tets.len()).filter(|&t| is_in_part(t)).collect();
        let number = |t: u32| tets.binary_search(&(t as usize)).map_or(NONE, |n| n as u32);
        TetMesh {
            points: mesh.points.clone(),
            tets: tets.iter().map(|&t| mesh.tets[t]).collect(),
            neighbors: tets.iter().map(|&t| mesh.neighbors[t].map(number)).collect(),
            labels: tets.iter().map(|&t| mesh.labels[t]).collect(),
            ..TetMesh::default()
        }
    }

    proptest! {
        /// A part that holds all tets of some labels, those that share a vertex with them, and
        /// those that share one with these. What mending it leaves of these labels is what all of
        /// the mesh has then, and how others stand is not changed.
        #[test]
        fn a_part_is_mended_as_far_as_it_is_known(
            values in prop::collection::vec(0..6_i32, LONG[0] * LONG[1] * LONG[2]),
            wrong in prop::collection::vec((0..6 * LONG[0] * LONG[1] * LONG[2], 0..6_i32), 0..60),
            chosen in 1..4_i32,
        ) {
            // The last label is in one half only.
            let label = |i: usize, j: usize, k: usize| {
                let label = values[i + LONG[0] * (j + LONG[1] * k)];
                if label <= 3 && i >= LONG[0] / 2 { 5 } else { label }
            };
            let chosen = HashSet::from([chosen]);
            let image = testing::image(LONG, testing::box_frame([1.0; 3]), label);
            let mut mesh = testing::kuhn_box(LONG, [1.0; 3], label);
            wrong.iter().for_each(|&(t, label)| mesh.labels[t] = label);
            let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
            let of_image = ImageComponents::new(&image, &|_| Ok(())).unwrap();
            let (monitor, earlier) = (Monitor::silent(), &Earlier::default());
            let stand = |mesh: &TetMesh, labels: &HashSet<i32>| {
                let mut mesh = mesh.clone();
                mesh.collect_facets(&monitor).unwrap();
                let topology = &MeshTopology::measure(&mesh, &image, &of_image, &monitor).unwrap();
                let known = Known { topology, of_image: &of_image, earlier, labels: Some(labels) };
                left_unmended(known, &image).unwrap()
            };
            let others: HashSet<i32> = (1..6).filter(|label| !chosen.contains(label)).collect();
            let before = stand(&mesh, &others);

            let mut near: Vec<bool> = mesh.labels.iter().map(|l| chosen.contains(l)).collect();
            for _ in 0..2 {
                let mut is_corner = vec![false; mesh.points.len()];
                for (tet, _) in mesh.tets.iter().zip(&near).filter(|(_, is_near)| **is_near) {
                    tet.iter().for_each(|&v| is_corner[v as usize] = true);
                }
                let has_corner = |tet: &[u32; 4]| tet.iter().any(|&v| is_corner[v as usize]);
                near = mesh.tets.iter().map(has_corner).collect();
            }
            let mut part = part_of(&mesh, |t| near[t]);
            part.collect_facets(&monitor).unwrap();
            let topology = &MeshTopology::measure(&part, &image, &of_image, &monitor).unwrap();
            let known = Known { topology, of_image: &of_image, earlier, labels: Some(&chosen) };
            let passes = &[[0.0, 30.0]];
            let mending =
                mend_measured(&mut part, known, &image, &oracle, passes, &monitor).unwrap();
            let numbers: Vec<usize> = (0..mesh.tets.len()).filter(|&t| near[t]).collect();
            numbers.iter().zip(&part.labels).for_each(|(&t, &label)| mesh.labels[t] = label);
            prop_assert_eq!(mending.left, stand(&mesh, &chosen));
            prop_assert_eq!(before, stand(&mesh, &others));
        }
    }

    /// Tets of a plate, one voxel thick, that are background: alone, and with a neighbour. Where
    /// that opens a tunnel they come back, and nothing is changed where it does not.
    #[test]
    fn tunnels_through_a_plate_are_filled() {
        let dims = [5, 5, 3];
        let label = |i: usize, j: usize, k: usize| {
            i32::from((1..4).contains(&i) && (1..4).contains(&j) && k == 1)
        };
        let image = testing::image(dims, testing::box_frame([1.0; 3]), label);
        let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
        let whole = testing::kuhn_box(dims, [1.0; 3], label);
        let mut tunnels = 0;
        let middle = 6 * (2 + 5 * (2 + 5)) as u32;
        for t in middle..middle + 6 {
            for other in whole.neighbors[t as usize].into_iter().chain([t]) {
                let mut mesh = whole.clone();
                mesh.labels[t as usize] = 0;
                mesh.labels[other as usize] = 0;
                let (before, _) = faults(&mesh, &image);
                let Mending { tets: mended, left } =
                    mend(&mut mesh, &image, &oracle, &[[0.0; 2]], &Monitor::silent()).unwrap();
                assert_eq!(left, Left::default());
                tunnels += usize::from(before[2] > 0);
                assert_eq!(!mended.is_empty(), before[2] > 0, "{before:?}");
                assert_eq!(faults(&mesh, &image), ([0; 3], 0));
            }
        }
        assert!(tunnels > 0);
    }
}
