//! Topology that sampling could not make right: tunnels and bridges smaller than a voxel, mended in
//! the finished mesh.
//!
//! Refinement labels a tet by its circumcenter, which may lie outside of it. So a flat tet may have
//! another label than the image has in nearly all of it. Mostly that moves an interface by a part
//! of a voxel. But such a tet may leave open a tunnel through a thin label, or join two parts of
//! one. The comparisons of [`adapt`](super::adapt) do not see it.
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
//! - *Vertices stay where they belong:* all corners of a candidate lie on interfaces already, and
//!   none is left with background alone around it.
//!
//! **Small pieces**, of a few tets, also go tet by tet, where the image has another label in these
//! and no excess gets larger by it. No piece gets larger, unless it is joined.
//!
//! So it is known all the time to which component a tet belongs, and what the excess of each is:
//! components and boundaries are measured once.
//!
//! **Order.** First come candidates that bring no facet with a small angle to an interface, then
//! those where the new label's boundary touches itself in the fewest edges and corners, single tets
//! before pairs, and a larger part of the image before a smaller one. Each is judged again before
//! it is changed. Then candidates are looked for around what has changed, until there are none.
//!
//! **Limit.** Only Euler characteristics are compared. A tunnel too many and a cavity too many of
//! one component cancel out, and are not seen.
//!
//! Idea: handles too many are cut or filled where that changes least, as in I. Guskov and
//! Z. J. Wood, "Topological noise removal", 2001; here the image says where.
//!
//! Parallel but for the changes. The same for any number of threads, given the same mesh. Cost:
//! components and boundaries of the mesh, and a look at the image for each tet around components
//! that are not as in the image.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::delaunay::tet::FACET;
use crate::geometry::measures::{tet_centroid, tet_volume, triangle_angles};
use crate::image::LabelImage;
use crate::image::components::ImageComponents;
use crate::memory::bits::Bits;
use crate::memory::{self, concatenated, filled, reserve, room};
use crate::mesh::vicinity::{Stars, Vicinity};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::reduce::NO_SET;
use crate::verify::topology::boundary_surface::BoundarySurfaces;
use crate::verify::topology::matching::{Fate, Matching, Role};
use crate::verify::topology::mesh_components::MeshComponents;

/// The image must have the new label in more than this part of a candidate.
const LEAST_PART: f64 = 0.5;

/// A piece that had so many tets, or fewer, may go.
const SMALL: u64 = 8;

/// Points along an edge of a tet at which the image is asked for its label, and in all of the tet.
const STEPS: usize = 5;
const POINTS: usize = STEPS * (STEPS + 1) * (STEPS + 2) / 6;

/// Tets of one piece of work.
const CHUNK: usize = 1 << 12;

/// A tet that got another label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mended {
    /// The label that it had.
    pub from: i32,
    /// The label that it has.
    pub to: i32,
    /// Its volume.
    pub volume: f64,
}

/// Mends the topology of a mesh that has the background around the object, and no facets; told are
/// the tets that got another label, in order. Facets that come to lie on an interface have angles
/// of `facet_angle` degrees at least, where there is a choice.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub(super) fn mend(
    mesh: &mut TetMesh,
    image: &LabelImage,
    oracle: &Oracle,
    facet_angle: f64,
    monitor: &Monitor<'_>,
) -> Result<Vec<Mended>> {
    let look = || monitor.advance(0);
    let quiet = Monitor::within(&look);
    let of_image = ImageComponents::new(image, &|_| look())?;
    let mut mended = Vec::new();
    mesh.collect_facets(&quiet)?;
    let mut components = Components::measure(mesh, image, &of_image, &quiet)?;
    // This ends: each change gives the label that the image has there to more than half of what
    // changes, so more and more of the mesh agrees with the image.
    let mut near = components.near_excess(mesh)?;
    while let Some(places) = near {
        let candidates =
            candidates(mesh, &components, &places, image, oracle, facet_angle, &quiet)?;
        near = None;
        for candidate in candidates {
            if components.change(mesh, &candidate, &mut mended)? {
                let changed = match near.take() {
                    Some(changed) => changed,
                    None => no_vertices(mesh)?,
                };
                // Those beside them may be the first one of a pair.
                let own = candidate.tets().iter().copied();
                let beside = own.clone().flat_map(|t| mesh.neighbors[t as usize]);
                let tets = own.chain(beside.filter(|&t| t != NONE));
                tets.flat_map(|t| mesh.tets[t as usize]).for_each(|v| changed.set(v));
                near = Some(changed);
            }
        }
    }
    if cfg!(debug_assertions) && !mended.is_empty() {
        mesh.collect_facets(&quiet)?;
        components.check(mesh, &Components::measure(mesh, image, &of_image, &quiet)?);
    }
    (mesh.facets, mesh.facet_labels, mesh.facet_tets) = Default::default();
    Ok(mended)
}

/// What a component of the mesh is, and how far it is from the image's.
#[derive(Clone, Copy, Debug)]
enum Standing {
    /// It stands for a component of the image, with such an excess.
    Main(i64),
    /// It was torn off that component of the mesh; with its Euler characteristic.
    Piece(u32, i64),
    /// It lies in no component of the image.
    Stray,
    /// It was a small piece, and has gone.
    Gone,
    /// It was torn off that component of the mesh, and has been joined to it again.
    JoinedTo(u32),
    /// None of these: it holds several components of the image.
    Other,
}

/// The components of a mesh.
struct Components {
    /// As they were measured.
    measured: MeshComponents,
    standings: Vec<Standing>,
    /// The component of each tet that got another label.
    moved: HashMap<u32, Option<u32>>,
    /// Labels with components that were not as in the image.
    wrong_labels: HashSet<i32>,
}

/// What follows when some tets get another label.
#[derive(Default)]
struct Outcome {
    /// The component to which they come; `None`: background.
    component: Option<u32>,
    /// Components that are then as follows.
    standings: Vec<(u32, Standing)>,
    /// How many edges and corners alone the tets share with their new label: there its boundary
    /// touches itself.
    loose: usize,
}

/// Tets that may get another label.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// One or two tets; the second one may be [`NONE`].
    tets: [u32; 2],
    from: i32,
    to: i32,
    /// The part of their volume in which the image has label `to`.
    part: f64,
    /// As [`Outcome`] has it.
    loose: usize,
    /// Whether a facet that comes to lie on an interface has an angle that is too small.
    is_sharp: bool,
}

impl Candidate {
    fn tets(&self) -> &[u32] {
        if self.tets[1] == NONE { &self.tets[..1] } else { &self.tets }
    }
}

impl Components {
    fn measure(
        mesh: &TetMesh,
        image: &LabelImage,
        of_image: &ImageComponents,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let mut parts = MeshComponents::to_match(mesh, image, of_image, monitor)?;
        let surfaces = BoundarySurfaces::measure(mesh, &mut parts, monitor)?;
        let Matching { roles, fates, .. } =
            Matching::new(&of_image.list, &parts.list, &parts.overlaps)?;
        // The characteristic of a boundary is twice that of what it bounds.
        let euler = |c: usize| surfaces.euler[c] / 2;
        let mut mains = filled(of_image.list.len(), NO_SET, "components", || Ok(()))?;
        for (c, role) in (0..).zip(&roles) {
            if let (Role::Main, Some(image)) = *role {
                mains[image as usize] = c;
            }
        }
        let standing = |(c, role): (usize, &(Role, Option<u32>))| match *role {
            (Role::Main, Some(i)) => Standing::Main(euler(c) - of_image.list[i as usize].euler),
            (Role::Piece, Some(i)) if mains[i as usize] != NO_SET => {
                Standing::Piece(mains[i as usize], euler(c))
            }
            (Role::Stray, _) => Standing::Stray,
            _ => Standing::Other,
        };
        let mut standings: Vec<Standing> = room(roles.len(), "components of the mesh")?;
        standings.extend(roles.iter().enumerate().map(standing));
        // What holds several components of the image has the characteristic of none.
        for overlap in &parts.overlaps {
            if overlap.image.is_some_and(|i| fates[i as usize] == Fate::Merged) {
                standings[overlap.mesh as usize] = Standing::Other;
            }
        }
        let (moved, wrong_labels) = Default::default();
        let mut all = Self { measured: parts, standings, moved, wrong_labels };
        for c in 0..all.standings.len() {
            if all.is_wrong(c as u32) {
                all.wrong_labels.insert(all.measured.list[c].label);
            }
        }
        Ok(all)
    }

    /// The component of a tet; `None` of one of the background.
    fn of(&self, t: u32) -> Option<u32> {
        let component = self.moved.get(&t).copied().unwrap_or_else(|| self.measured.of(t));
        component.map(|c| match self.standings[c as usize] {
            Standing::JoinedTo(main) => main,
            _ => c,
        })
    }

    /// For debug builds: tets are in the same components as those measured now are, which stand as
    /// they do. But for what is a piece: that depends on how much of it lies where.
    fn check(&self, mesh: &TetMesh, now: &Self) {
        let mut pairs = HashMap::new();
        for t in (0..mesh.tets.len() as u32).filter(|&t| mesh.labels[t as usize] != 0) {
            let [component, other] = [self, now].map(|all| all.of(t).expect("of a label"));
            let pair = *pairs.entry(component).or_insert(other);
            debug_assert_eq!(pair, other, "tet {t} of component {component}");
        }
        let distinct: HashSet<u32> = pairs.values().copied().collect();
        debug_assert_eq!(distinct.len(), pairs.len(), "components that have been joined");
        for (component, other) in pairs {
            let known = (self.standings[component as usize], now.standings[other as usize]);
            if let (Standing::Main(known), Standing::Main(measured)) = known {
                debug_assert_eq!(known, measured, "excess of component {component}");
            }
        }
    }

    fn is_wrong(&self, component: u32) -> bool {
        !matches!(self.standings[component as usize], Standing::Main(0))
    }

    /// Whether a component was torn off, or lies in none of the image.
    fn is_piece(&self, component: u32) -> bool {
        matches!(self.standings[component as usize], Standing::Piece(..) | Standing::Stray)
    }

    /// The vertices on boundaries of components that are not as in the image, if there are such.
    fn near_excess(&self, mesh: &TetMesh) -> Result<Option<Bits>> {
        if self.wrong_labels.is_empty() {
            return Ok(None);
        }
        let near = no_vertices(mesh)?;
        let is_wrong = |&t: &u32| self.of(t).is_some_and(|c| self.is_wrong(c));
        mesh.facets.par_iter().zip(&mesh.facet_tets).for_each(|(facet, tets)| {
            if tets.iter().any(is_wrong) {
                facet.iter().for_each(|&v| near.set(v));
            }
        });
        Ok(Some(near))
    }

    /// What follows when tet `t`, or it and another one, whose vicinity is given, go from one label
    /// to another; `None` if that is no gain, or not allowed.
    fn outcome(
        &self,
        mesh: &TetMesh,
        t: u32,
        vicinity: &Vicinity,
        [from, to]: [i32; 2],
    ) -> Option<Outcome> {
        let has = |label: i32| move |t: u32| mesh.labels[t as usize] == label;
        let mut outcome = Outcome::default();
        let mut gain = 0;
        let is_small = |&c: &u32| self.measured.list[c as usize].tets.count <= SMALL;
        let small_piece = self.of(t).filter(|&c| self.is_piece(c)).filter(is_small);
        for (label, joins) in [(from, false), (to, true)] {
            let faces = vicinity.shared_with(has(label));
            let (pieces, euler) = (faces.pieces(), faces.euler());
            if let Some(piece) = small_piece.filter(|_| !joins && pieces == 0) {
                outcome.standings.push((piece, Standing::Gone));
                gain += 1;
                continue;
            }
            // What the background consists of does not count, so it may be parted.
            let most = if label == 0 || joins { 2 } else { 1 };
            // All around it there would be a cavity in the label.
            let is_sphere = pieces == 1 && euler == 2;
            if !(1..=most).contains(&pieces) || is_sphere && !joins {
                return None;
            }
            if joins {
                outcome.loose = faces.loose();
                // Of two it is the one to which the other one is joined.
                outcome.component =
                    vicinity.around().find(|&t| has(to)(t)).and_then(|t| self.of(t));
                if pieces == 1 && outcome.component.is_some_and(|c| self.is_piece(c)) {
                    return None;
                }
            }
            let grows = if joins { 1 - euler } else { euler - 1 };
            match (label, grows, pieces) {
                (0, ..) => {}
                // A small piece that gets smaller is a gain.
                (_, 0, 1) => gain += i64::from(!joins && small_piece.is_some()),
                // Two components might be joined.
                (_, 0, _) => return None,
                _ => gain += self.grown(mesh, vicinity, label, grows, &mut outcome.standings)?,
            }
        }
        // No vertex inside of a label gets on an interface, and none loses its last label.
        let is_allowed = vicinity.all_corners_on(|t| !has(from)(t))
            && (to != 0 || vicinity.all_corners_on(|t| !has(0)(t)));
        (gain > 0 && is_allowed).then_some(outcome)
    }

    /// Lists how the one component of a label around some tets stands when its Euler characteristic
    /// has grown; told is by how much the excess gets smaller. Two components may become one, if
    /// one is a piece of the other: then there is one piece less, which counts 1. `None`: nothing
    /// is gained, or it is not known.
    fn grown(
        &self,
        mesh: &TetMesh,
        vicinity: &Vicinity,
        label: i32,
        grows: i64,
        standings: &mut Vec<(u32, Standing)>,
    ) -> Option<i64> {
        let mut around = Vec::new();
        for t in vicinity.around().filter(|&t| mesh.labels[t as usize] == label) {
            around.push(self.of(t)?);
        }
        around.sort_unstable();
        around.dedup();
        let standing = |c: u32| self.standings[c as usize];
        match around[..] {
            [c] => {
                let Standing::Main(excess) = standing(c) else { return None };
                let gain = excess.abs() - (excess + grows).abs();
                standings.push((c, Standing::Main(excess + grows)));
                (gain > 0).then_some(gain)
            }
            [a, b] => {
                let (main, excess, piece, euler) = match (standing(a), standing(b)) {
                    (Standing::Main(excess), Standing::Piece(of, euler)) if of == a => {
                        (a, excess, b, euler)
                    }
                    (Standing::Piece(of, euler), Standing::Main(excess)) if of == b => {
                        (b, excess, a, euler)
                    }
                    _ => return None,
                };
                let joined = excess + euler + grows;
                standings
                    .extend([(main, Standing::Main(joined)), (piece, Standing::JoinedTo(main))]);
                (joined.abs() <= excess.abs()).then_some(1)
            }
            _ => None,
        }
    }

    /// Gives a candidate its new label, if that still is a gain; told is whether it has it then.
    fn change(
        &mut self,
        mesh: &mut TetMesh,
        candidate: &Candidate,
        mended: &mut Vec<Mended>,
    ) -> Result<bool> {
        const WHAT: &str = "tets that are mended";
        let &Candidate { from, to, .. } = candidate;
        if candidate.tets().iter().any(|&t| mesh.labels[t as usize] != from) {
            return Ok(false);
        }
        let ([t, other], stars) = (candidate.tets, &mut Stars::default());
        let mut vicinity = Vicinity::new(mesh, t, stars);
        if other != NONE {
            vicinity = vicinity.with(mesh, other, stars);
        }
        let Some(outcome) = self.outcome(mesh, t, &vicinity, [from, to]) else {
            return Ok(false);
        };
        for (component, standing) in outcome.standings {
            self.standings[component as usize] = standing;
        }
        reserve(mended, candidate.tets().len(), WHAT)?;
        for &t in candidate.tets() {
            mesh.labels[t as usize] = to;
            memory::insert(&mut self.moved, t, outcome.component, WHAT)?;
            mended.push(Mended { from, to, volume: tet_volume(&corners(mesh, t)) });
        }
        Ok(true)
    }
}

fn no_vertices(mesh: &TetMesh) -> Result<Bits> {
    Bits::new(mesh.points.len(), "vertices of the mesh")
}

fn corners(mesh: &TetMesh, t: u32) -> [DVec3; 4] {
    mesh.tets[t as usize].map(|v| mesh.point(v))
}

/// The tets with a vertex of `near`, alone and with a neighbour, that would gain by the label that
/// the image has in most of them.
fn candidates(
    mesh: &TetMesh,
    components: &Components,
    near: &Bits,
    image: &LabelImage,
    oracle: &Oracle,
    facet_angle: f64,
    monitor: &Monitor<'_>,
) -> Result<Vec<Candidate>> {
    // The volume of tets, and the part of it in which the image has a label.
    let part_of = |tets: &[u32], label: i32| {
        let sums = tets.iter().fold([0.0; 2], |[all, part], &t| {
            let corners = corners(mesh, t);
            let volume = tet_volume(&corners);
            let is_label = |p: &DVec3| image.labels()[usize::from(oracle.label(*p))] == label;
            let hits = points_within(&corners).filter(is_label).count();
            [all + volume, part + volume * hits as f64 / POINTS as f64]
        });
        sums[1] / sums[0]
    };
    let of_chunk = |(chunk, tets): (usize, &[[u32; 4]])| {
        monitor.advance(0)?;
        let (mut found, mut stars) = (Vec::new(), Stars::default());
        for (t, vertices) in ((chunk * CHUNK) as u32..).zip(tets) {
            if vertices[0] == NONE || !vertices.iter().any(|&v| near.has(v)) {
                continue;
            }
            let from = mesh.labels[t as usize];
            let centroid = tet_centroid(&corners(mesh, t));
            let to = image.labels()[usize::from(oracle.label(centroid))];
            if to == from || ![from, to].iter().any(|label| components.wrong_labels.contains(label))
            {
                continue;
            }
            let is_like = |&n: &u32| n != NONE && mesh.labels[n as usize] == from;
            let neighbors = mesh.neighbors[t as usize].into_iter().filter(is_like);
            let alone = Vicinity::new(mesh, t, &mut stars);
            for other in neighbors.chain([NONE]) {
                let candidate =
                    Candidate { tets: [t, other], from, to, part: 0.0, loose: 0, is_sharp: false };
                let tets = candidate.tets();
                let outcome = if other == NONE {
                    components.outcome(mesh, t, &alone, [from, to])
                } else {
                    let pair = alone.with(mesh, other, &mut stars);
                    components.outcome(mesh, t, &pair, [from, to])
                };
                let Some(Outcome { loose, .. }) = outcome else { continue };
                let part = part_of(tets, to);
                if part > LEAST_PART {
                    reserve(&mut found, 1, "candidates")?;
                    let is_sharp = is_sharp(mesh, tets, facet_angle);
                    found.push(Candidate { part, loose, is_sharp, ..candidate });
                }
            }
        }
        Ok(found)
    };
    let chunks = mesh.tets.par_chunks(CHUNK).enumerate().map(of_chunk);
    let mut all: Vec<Candidate> = concatenated(chunks.collect::<Result<_>>()?, "candidates")?;
    all.sort_by(|a, b| {
        let [first, second] = [a, b].map(|c| (c.is_sharp, c.loose, c.tets().len()));
        first.cmp(&second).then(b.part.total_cmp(&a.part)).then(a.tets.cmp(&b.tets))
    });
    Ok(all)
}

/// Whether a facet that comes to lie on an interface, when `tets` lose their label, has an angle
/// below so many degrees.
fn is_sharp(mesh: &TetMesh, tets: &[u32], degrees: f64) -> bool {
    tets.iter().any(|&t| {
        let label = mesh.labels[t as usize];
        let comes = |n: u32| n != NONE && !tets.contains(&n) && mesh.labels[n as usize] == label;
        let mut facets = (0..4)
            .filter(|&i| comes(mesh.neighbors[t as usize][i]))
            .map(|i| FACET[i].map(|k| mesh.point(mesh.tets[t as usize][k])));
        facets.any(|facet| triangle_angles(&facet).into_iter().any(|angle| angle < degrees))
    })
}

/// Points spread evenly within a tet.
fn points_within(corners: &[DVec3; 4]) -> impl Iterator<Item = DVec3> {
    // Barycentric coordinates (i + 1/4) / STEPS, whose sum is 1.
    let rows = (0..STEPS).flat_map(|i| (0..STEPS - i).map(move |j| [i, j]));
    let points = rows.flat_map(|[i, j]| (0..STEPS - i - j).map(move |k| [i, j, k]));
    points.map(move |weights| {
        let [a, b, c] = weights.map(|w| (w as f64 + 0.25) / STEPS as f64);
        corners[0] * a + corners[1] * b + corners[2] * c + corners[3] * (1.0 - a - b - c)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::testing;
    use crate::params::SurfaceModel;

    const DIMS: [usize; 3] = [5, 4, 4];
    const VOXELS: usize = DIMS[0] * DIMS[1] * DIMS[2];

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
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, testing::box_frame([1.0; 3]), label);
            let mut mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            wrong.iter().for_each(|&(t, label)| mesh.labels[t] = label);
            let oracle = Oracle::new(&image, SurfaceModel::Voxel, &|| Ok(())).unwrap();
            let before = mesh.clone();
            let mended = mend(&mut mesh, &image, &oracle, 30.0, &Monitor::silent()).unwrap();
            let [was, is] = [&before, &mesh].map(|mesh| faults(mesh, &image));
            let no_more = |(was, is): (&u64, &u64)| is <= was;
            prop_assert!(was.0.iter().zip(&is.0).all(no_more), "{was:?}, then {is:?}");
            let sum = |(faults, tets): ([u64; 3], u64)| faults.iter().sum::<u64>() + tets;
            prop_assert!(mended.is_empty() || sum(is) < sum(was));
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
                let mended = mend(&mut mesh, &image, &oracle, 0.0, &Monitor::silent()).unwrap();
                tunnels += usize::from(before[2] > 0);
                assert_eq!(!mended.is_empty(), before[2] > 0, "{before:?}");
                assert_eq!(faults(&mesh, &image), ([0; 3], 0));
            }
        }
        assert!(tunnels > 0);
    }
}
