//! Which component of the image each component of a mesh stands for, how far its Euler
//! characteristic is from that one's, and what becomes of both when tets get another label.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use rayon::prelude::*;

use super::Known;
use crate::Result;
use crate::geometry::measures::tet_volume;
use crate::image::LabelImage;
use crate::memory::bits::Bits;
use crate::memory::{self, filled, reserve, room};
use crate::mesh::vicinity::{Faces, Stars, Vicinity};
use crate::mesh::{NONE, TetMesh};
use crate::reduce::NO_SET;
use crate::verify::topology::matching::{Fate, Matching, Role};
use crate::verify::topology::measured::MeshTopology;
use crate::verify::topology::mesh_components::MeshComponents;

/// A piece that had so many tets, or fewer, may go.
const SMALL: u64 = 8;

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
    /// None of these: it holds several components of the image, or is of a label that is not
    /// looked at.
    Other,
}

/// The components of a mesh.
pub(super) struct Components<'a> {
    /// As they were measured.
    measured: &'a MeshComponents,
    /// The labels that are looked at; `None`: all.
    labels: Option<&'a HashSet<i32>>,
    standings: Vec<Standing>,
    /// The component of each tet that got another label.
    moved: HashMap<u32, Option<u32>>,
    /// Labels with components that mending might bring nearer to the image.
    pub open_labels: HashSet<i32>,
    /// The components of the image that are lost.
    lost: HashSet<u32>,
}

/// Tets that may get another label.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// One or two tets; the second one may be [`NONE`].
    pub tets: [u32; 2],
    pub from: i32,
    pub to: i32,
    /// The part of their volume in which the image has label `to`.
    pub part: f64,
    /// As [`Outcome`] has it.
    pub loose: usize,
    /// Whether a facet that comes to lie on an interface has an angle that is too small.
    pub is_sharp: bool,
}

impl Candidate {
    pub fn tets(&self) -> &[u32] {
        if self.tets[1] == NONE { &self.tets[..1] } else { &self.tets }
    }
}

/// A tet that got another label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::pipeline) struct Mended {
    /// Its number.
    pub tet: u32,
    /// The label that it had.
    pub from: i32,
    /// The label that it has.
    pub to: i32,
    /// Its volume.
    pub volume: f64,
}

/// What is not as in the image when a mesh has been mended, or measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::pipeline) struct Left {
    /// The labels of components that are merged, torn, stray, or of another Euler characteristic.
    pub labels: HashSet<i32>,
    /// The components of the image that are lost.
    pub lost: HashSet<u32>,
}

/// What follows when some tets get another label.
#[derive(Default)]
pub(super) struct Outcome {
    /// The component to which they come; `None`: background.
    component: Option<u32>,
    /// Components that are then as follows.
    standings: Vec<(u32, Standing)>,
    /// How many edges and corners alone the tets share with their new label: there its boundary
    /// touches itself.
    pub loose: usize,
}

impl<'a> Components<'a> {
    /// Those of all labels, or of some.
    pub fn new(known: Known<'a>, image: &LabelImage) -> Result<Self> {
        let Known { topology, of_image, labels, .. } = known;
        let MeshTopology { components: parts, surfaces } = topology;
        let matching = Matching::new(&of_image.list, &parts.list, &parts.overlaps)?;
        let lost = matching.lost();
        let Matching { roles, fates, .. } = matching;
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
        let (moved, open_labels) = Default::default();
        let mut all = Self { measured: parts, labels, standings, moved, open_labels, lost };
        let label_of = |&c: &u32| image.labels()[usize::from(of_image.list[c as usize].id)];
        all.lost.retain(|c| labels.is_none_or(|labels| labels.contains(&label_of(c))));
        for c in 0..all.standings.len() {
            if !all.is_looked_at(all.measured.list[c].label) {
                all.standings[c] = Standing::Other;
            }
            if all.is_open(c as u32) {
                all.open_labels.insert(all.measured.list[c].label);
            }
        }
        Ok(all)
    }

    fn is_looked_at(&self, label: i32) -> bool {
        self.labels.is_none_or(|labels| labels.contains(&label))
    }

    /// What is not as in the image now.
    pub fn left(&self) -> Left {
        let of_mesh = self.standings.iter().zip(&self.measured.list);
        let is_right = |standing: &Standing| {
            matches!(standing, Standing::Main(0) | Standing::Gone | Standing::JoinedTo(_))
        };
        let wrong = of_mesh.filter(|(standing, _)| !is_right(standing));
        let labels = wrong.map(|(_, component)| component.label);
        let labels = labels.filter(|&label| self.is_looked_at(label)).collect();
        Left { labels, lost: self.lost.clone() }
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
    pub fn check(&self, mesh: &TetMesh, now: &Components<'_>) {
        let mut pairs = HashMap::new();
        let is_checked = |&t: &u32| {
            let label = mesh.labels[t as usize];
            label != 0 && self.is_looked_at(label)
        };
        for t in (0..mesh.tets.len() as u32).filter(is_checked) {
            let [component, other] = [self.of(t), now.of(t)].map(|c| c.expect("of a label"));
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

    /// Whether something can be gained for a component: not if it is as in the image, or if it
    /// holds several of the image's.
    fn is_open(&self, component: u32) -> bool {
        match self.standings[component as usize] {
            Standing::Main(excess) => excess != 0,
            Standing::Piece(..) | Standing::Stray => true,
            Standing::Gone | Standing::JoinedTo(_) | Standing::Other => false,
        }
    }

    /// Whether a component was torn off, or lies in none of the image.
    fn is_piece(&self, component: u32) -> bool {
        matches!(self.standings[component as usize], Standing::Piece(..) | Standing::Stray)
    }

    /// The vertices on boundaries of components that mending might bring nearer to the image, if
    /// there are such; and those of `changed`, around tets that were changed since facets were
    /// listed.
    pub fn near_open(&self, mesh: &TetMesh, changed: Option<Bits>) -> Result<Option<Bits>> {
        if !(0..self.standings.len() as u32).any(|c| self.is_open(c)) {
            return Ok(None);
        }
        let near = match changed {
            Some(changed) => changed,
            None => no_vertices(mesh)?,
        };
        let is_open = |&t: &u32| self.of(t).is_some_and(|c| self.is_open(c));
        mesh.facets.par_iter().zip(&mesh.facet_tets).for_each(|(facet, tets)| {
            if tets.iter().any(is_open) {
                facet.iter().for_each(|&v| near.set(v));
            }
        });
        Ok(Some(near))
    }

    /// What follows when tet `t`, or it and another one, whose vicinity is given, go from one label
    /// to another; `None` if that is no gain, or not allowed.
    pub fn outcome(
        &self,
        mesh: &TetMesh,
        t: u32,
        vicinity: &Vicinity,
        [from, to]: [i32; 2],
    ) -> Option<Outcome> {
        let has = |label: i32| move |t: u32| mesh.labels[t as usize] == label;
        let mut outcome = Outcome::default();
        let (mut gain, mut gained) = (0, None);
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
                gained = Some(faces);
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
        if gain <= 0 {
            return None;
        }
        // No vertex inside of a label gets on an interface, and none loses its last label.
        let is_allowed = vicinity.all_corners_on(|t| !has(from)(t))
            && (to != 0 || vicinity.all_corners_on(|t| !has(0)(t)));
        outcome.loose = gained.map_or(0, Faces::loose);
        is_allowed.then_some(outcome)
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

    /// Gives candidates their new labels, in order, if that still is a gain; told are the vertices
    /// of tets that have changed and of those beside them, if any have.
    pub fn change_all(
        &mut self,
        mesh: &mut TetMesh,
        candidates: &[Candidate],
        stars: &Stars,
        mended: &mut Vec<Mended>,
    ) -> Result<Option<Bits>> {
        let (mut near, mut beside_changed) = (None, HashMap::new());
        for candidate in candidates {
            // Other facets than those that were looked at may come to lie on an interface. It is
            // found again.
            if candidate.tets().iter().any(|t| beside_changed.contains_key(t)) {
                continue;
            }
            if self.change(mesh, candidate, stars, mended)? {
                let changed = match near.take() {
                    Some(changed) => changed,
                    None => no_vertices(mesh)?,
                };
                // Those beside them may be the first one of a pair.
                let own = candidate.tets().iter().copied();
                let beside = own.clone().flat_map(|t| mesh.neighbors[t as usize]);
                for t in own.chain(beside.filter(|&t| t != NONE)) {
                    mesh.tets[t as usize].into_iter().for_each(|v| changed.set(v));
                    memory::insert(&mut beside_changed, t, (), "tets beside mended ones")?;
                }
                near = Some(changed);
            }
        }
        Ok(near)
    }

    /// Gives a candidate its new label, if that still is a gain; told is whether it has it then.
    fn change(
        &mut self,
        mesh: &mut TetMesh,
        candidate: &Candidate,
        stars: &Stars,
        mended: &mut Vec<Mended>,
    ) -> Result<bool> {
        const WHAT: &str = "tets that are mended";
        let &Candidate { from, to, .. } = candidate;
        if candidate.tets().iter().any(|&t| mesh.labels[t as usize] != from) {
            return Ok(false);
        }
        let [t, other] = candidate.tets;
        let mut vicinity = Vicinity::new(mesh, t, |v| stars.of(v));
        if other != NONE {
            vicinity = vicinity.with(mesh, other, |v| stars.of(v));
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
            mended.push(Mended { tet: t, from, to, volume: tet_volume(&corners(mesh, t)) });
        }
        Ok(true)
    }
}

/// A bit for each vertex of a mesh.
pub(super) fn no_vertices(mesh: &TetMesh) -> Result<Bits> {
    Bits::new(mesh.points.len(), "vertices of the mesh")
}

/// The corners of tet `t`.
pub(super) fn corners(mesh: &TetMesh, t: u32) -> [DVec3; 4] {
    mesh.tets[t as usize].map(|v| mesh.point(v))
}
