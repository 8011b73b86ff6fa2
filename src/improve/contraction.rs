//! Edge contraction: a vertex goes into one beside it, and the tets of their edge vanish. Where no
//! vertex beside it will do as it is, one of them moves ([`meeting`](super::meeting)).
//!
//! What is given up are tets and vertices. **What is connected stays**, of every label, exactly:
//! vertex u may go into v if
//! - *v belongs to what u belongs to*, and *the link condition* holds: see [`link`](super::link).
//! - *Every tet is positive afterwards*, by its exact sign, those of the background too. The tets
//!   around u are a ball. If v sees all of its boundary, the new tets fill the same ball, so no
//!   condition on the tets is needed beside this one. Where v moves, the new tets have the outer
//!   boundary of the old ones around both. All are positive, so they cover what is inside of it
//!   exactly once.
//!
//! What the mesh is asked for is kept: new tets have a circumradius of at most the size of their
//! label, new interface facets one of at most delta, and angles as large as
//! [`Bounds::facet_measure`] has it. The image has the labels of a new facet on its two sides, at
//! no more than 0.22 of delta from its centroid and the middles of its edges; of edges of a line
//! the facets beside them tell. Slivers may be made: [`improve`](super) is
//! for them.

use std::cell::OnceCell;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};

use glam::DVec3;

use super::blocks::owner;
use super::interfaces::Interfaces;
use super::link::{Support, has_link_condition};
use super::measure::{Measure, has_circumradius_within, is_positive};
use super::meeting::Meeting;
use super::report::Counts;
use super::shared::Shared;
use super::star::{Collected, Star, StarFacet};
use crate::Result;
use crate::geometry::measures::tet_centroid;
use crate::geometry::shape::triangle_circumcircle;
use crate::mesh::NONE;
use crate::oracle::Walls;

/// Vertices beside a vertex that it is tried to contract into, the nearest first.
const MAX_TRIED: usize = 12;

/// Vertices between two checks.
const REPORT_EVERY: usize = 16;

/// What stands for the tet of a vertex that has been tried; [`NONE`] is that of one that has not,
/// because its block owns no tet of it.
pub(super) const TRIED: u32 = NONE - 1;

/// What contractions keep to.
pub(super) struct Bounds<'a> {
    /// How far apart samples on the interface of two labels may be.
    pub delta: &'a (dyn Fn([i32; 2], DVec3) -> f64 + Sync),
    /// The largest circumradius of a label's tets.
    pub size: &'a (dyn Fn(i32, DVec3) -> f64 + Sync),
    /// No longer edge is contracted.
    pub longest: f64,
    /// The least measure of new tets, where those that they replace are no worse.
    pub tet_measure: f64,
    /// The squared sine of the least angle of new interface facets.
    pub facet_measure: f64,
}

/// What all blocks of a round share.
pub(super) struct Round<'a> {
    pub shared: Shared<'a>,
    /// The block of each vertex.
    pub blocks: &'a [u32],
    /// 1 for each vertex that is to be tried.
    pub to_try: &'a [u8],
    /// A tet of each vertex that is still to be tried, or [`NONE`] or [`TRIED`]; for the vertex's
    /// block alone.
    pub tets: &'a [AtomicU32],
    /// 1 for each vertex that is to be tried in the next round. Any block may set it, and none
    /// reads it.
    pub next: &'a [AtomicU8],
    pub interfaces: &'a Interfaces<'a>,
    pub measure: Measure,
    pub bounds: &'a Bounds<'a>,
    /// Told how many vertices were dealt with; an error ends the work.
    pub report_and_check: &'a (dyn Fn(usize) -> Result<()> + Sync),
}

/// What works in one block.
pub(super) struct Contractor<'r, 'a> {
    pub(super) round: &'r Round<'a>,
    me: u32,
    pub(super) other: Star,
    /// What was done.
    pub counts: Counts,
    /// Vertices that are where two met, with the place on the interface or line of the image.
    pub met: Vec<(u32, DVec3)>,
}

/// A vertex that is to go into one beside it, or to meet it.
pub(super) struct Leaving<'s> {
    pub star: &'s Star,
    pub support: Support,
    pub walls: Walls,
    pub at: DVec3,
    /// What [`Contractor::bound`] is, once it is known.
    bound: OnceCell<f64>,
}

impl<'s> Leaving<'s> {
    /// The vertex of a star.
    pub fn new(star: &'s Star, support: Support, walls: Walls, at: DVec3) -> Self {
        Self { star, support, walls, at, bound: OnceCell::new() }
    }

    /// The tets of its star that are still there once it is one with `v`.
    fn kept(&self, v: u32) -> impl Iterator<Item = usize> {
        (0..self.star.tets.len()).filter(move |&i| !self.star.links[i].contains(&v))
    }
}

impl<'r, 'a> Contractor<'r, 'a> {
    pub fn new(round: &'r Round<'a>, me: u32) -> Self {
        Self { round, me, other: Star::default(), counts: Counts::default(), met: Vec::new() }
    }

    /// Tries the vertices of `tets`, which the block owns, that with the shortest edge first. What
    /// changes is in order when this ends early, too.
    ///
    /// # Errors
    /// Those of the round's `report_and_check`.
    pub fn run(&mut self, tets: impl Iterator<Item = u32>) -> Result<()> {
        let round = self.round;
        (round.report_and_check)(0)?;
        let mut star = Star::default();
        let vertices = self.to_try(tets);
        let mut next = &vertices[..];
        for some in vertices.chunks(REPORT_EVERY) {
            for &(_, u) in some {
                next = &next[1..];
                // They come by their shortest edges, so they lie anywhere in the block.
                round.shared.prefetch_steps([3, 2, 1].map(|n| self.tet_of(next.get(n)?.1)));
                self.contract(&mut star, u);
            }
            (round.report_and_check)(some.len())?;
        }
        Ok(())
    }

    /// A tet of a vertex that is still to be tried, if one is known.
    fn tet_of(&self, v: u32) -> Option<u32> {
        let t = self.round.tets[v as usize].load(Relaxed);
        (t < TRIED).then_some(t)
    }

    /// Whether a vertex is one that this block is still to try.
    pub(super) fn is_to_be_tried(&self, v: u32) -> bool {
        self.is_mine(v) && self.tet_of(v).is_some()
    }

    /// Whether a vertex belongs to this block.
    pub(super) fn is_mine(&self, v: u32) -> bool {
        self.round.blocks[v as usize] == self.me
    }

    /// The vertices of the block that are to be tried, with the squares of the shortest edges in
    /// the tets that the block owns; notes a tet of each.
    fn to_try(&self, tets: impl Iterator<Item = u32>) -> Vec<(u64, u32)> {
        let round = self.round;
        let mut vertices = Vec::new();
        for t in tets {
            let tet = round.shared.tet(t);
            for v in tet {
                if !self.is_mine(v) || round.to_try[v as usize] == 0 {
                    continue;
                }
                round.tets[v as usize].store(t, Relaxed);
                let at = round.shared.point(v);
                let others = tet.into_iter().filter(|&w| w != v);
                let squares = others.map(|w| round.shared.point(w).distance_squared(at));
                // Squares are not negative, so their bits are in their order.
                vertices.push((v, squares.fold(f64::INFINITY, f64::min).to_bits()));
            }
        }
        vertices.sort_unstable();
        vertices.dedup_by_key(|(v, _)| *v);
        let mut vertices: Vec<_> = vertices.into_iter().map(|(v, square)| (square, v)).collect();
        vertices.sort_unstable();
        vertices
    }

    pub(super) fn owns(&self, vertices: [u32; 4]) -> bool {
        owner(vertices.map(|v| self.round.blocks[v as usize])) == Some(self.me)
    }

    pub(super) fn walls_at(&self, v: u32) -> Walls {
        self.round.interfaces.oracle.walls_at(self.round.shared.point(v))
    }

    /// Has a vertex tried in the next round.
    pub(super) fn try_later(&self, v: u32) {
        self.round.next[v as usize].store(1, Relaxed);
    }

    fn contract(&mut self, star: &mut Star, u: u32) {
        let round = self.round;
        let t = round.tets[u as usize].swap(TRIED, Relaxed);
        match star.collect(&round.shared, t, u, |tet| self.owns(tet)) {
            Collected::Star => {}
            Collected::Foreign => return self.try_later(u),
            Collected::Open => return,
        }
        let at = round.shared.point(u);
        let Some(support) = Support::of(star, |w| self.walls_at(w)) else { return };
        let walls = self.walls_at(u);
        if walls.count() == 3 {
            return;
        }
        let longest = round.bounds.longest * round.bounds.longest;
        let beside = star.vertices().into_iter().map(|(v, p)| (p.distance_squared(at), v));
        let mut near: Vec<_> =
            beside.filter(|&(square, v)| square <= longest && support.allows(star, v)).collect();
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if near.is_empty() {
            return;
        }
        near.truncate(MAX_TRIED);
        let leaving = Leaving::new(star, support, walls, at);
        let mut waits = false;
        for &(_, v) in &near {
            match self.check(&leaving, v) {
                Outcome::Sound => {
                    return self.carry_out(star, u, v);
                }
                Outcome::Foreign => waits = true,
                Outcome::Failed => {}
            }
        }
        for &(_, v) in &near {
            match self.meet(&leaving, v) {
                Meeting::At(place) => {
                    return self.carry_out_meeting(star, t, place);
                }
                Meeting::Foreign => waits = true,
                Meeting::Nowhere => {}
            }
        }
        if waits {
            self.try_later(u);
        }
    }

    /// What new tets must measure more than: what is asked for, or what the worst tet measures that
    /// is there.
    fn bound(&self, leaving: &Leaving<'_>) -> f64 {
        let (measure, least) = (self.round.measure, self.round.bounds.tet_measure);
        let of_worst = || {
            let Leaving { star, at, .. } = *leaving;
            let old = star.labels.iter().zip(&star.points).filter(|(label, _)| **label != 0);
            let old = old.map(|(_, &[x, y, z])| [at, x, y, z]);
            let below = old.filter(|tet| !measure.exceeds(tet, least));
            below.map(|tet| measure.of(&tet)).fold(least, f64::min).next_down()
        };
        *leaving.bound.get_or_init(of_worst)
    }

    /// Whether a vertex may go into `v`.
    fn check(&mut self, leaving: &Leaving<'_>, v: u32) -> Outcome {
        let Leaving { star, support, walls, .. } = *leaving;
        if walls.count() > 0 && walls.common(&self.walls_at(v)) != walls {
            return Outcome::Failed;
        }
        if !self.may_become(&[(leaving, v)], self.round.shared.point(v)) {
            return Outcome::Failed;
        }
        let is_mine = |i: usize| {
            let [x, y, z] = star.links[i];
            self.owns([v, x, y, z])
        };
        if !leaving.kept(v).all(is_mine) {
            return Outcome::Foreign;
        }
        if star.facets.is_empty() { Outcome::Sound } else { self.keeps_topology(star, v, support) }
    }

    /// Whether what is kept of the stars of some vertices is as it is asked to be once they are one
    /// at `to`. With each vertex comes the other one of the edge.
    pub(super) fn may_become(&self, leaving: &[(&Leaving<'_>, u32)], to: DVec3) -> bool {
        let round = self.round;
        let kept =
            || leaving.iter().flat_map(|(leaving, v)| leaving.kept(*v).map(|i| (leaving.star, i)));
        let moved = |star: &Star, i: usize| {
            let [x, y, z] = star.points[i];
            [to, x, y, z]
        };
        let size_of = |label, tet: &[DVec3; 4]| (round.bounds.size)(label, tet_centroid(tet));
        let is_end = |w| leaving.iter().any(|(leaving, _)| leaving.support.is_end(w));
        let is_good = |(star, i): (&Star, usize), bound: f64| {
            let (label, tet) = (star.labels[i], moved(star, i));
            label == 0
                || round.measure.exceeds(&tet, bound)
                    && has_circumradius_within(&tet, size_of(label, &tet))
        };
        // What costs least is asked first.
        if !leaving.iter().all(|(leaving, v)| self.has_good_facets(leaving.star, *v, to)) {
            return false;
        }
        let bound = leaving.iter().map(|(leaving, _)| self.bound(leaving)).fold(1.0, f64::min);
        kept().all(|tet| is_good(tet, bound))
            && kept().all(|(star, i)| is_positive(&moved(star, i)))
            && leaving
                .iter()
                .all(|(leaving, v)| self.has_facets_in_place(leaving.star, *v, to, is_end))
    }

    /// The facets that vertex `v`, at `to`, takes from a star, by their corners.
    fn taken(
        &self,
        star: &Star,
        v: u32,
        to: DVec3,
    ) -> impl Iterator<Item = (StarFacet, [DVec3; 3])> {
        let facets = star.facets.iter().filter(move |facet| !facet.others.contains(&v));
        facets.map(move |&facet| {
            let [p, q] = facet.others.map(|w| self.round.shared.point(w));
            (facet, [to, p, q])
        })
    }

    /// Whether the facets that `v` takes are as they are asked to be.
    fn has_good_facets(&self, star: &Star, v: u32, to: DVec3) -> bool {
        let Round { interfaces, bounds, .. } = self.round;
        self.taken(star, v, to).all(|(facet, corners @ [a, b, c])| {
            let delta = (bounds.delta)(facet.labels, (a + b + c) / 3.0);
            interfaces.has_angles(corners, bounds.facet_measure)
                && triangle_circumcircle(a, b, c).is_some_and(|(_, square)| square <= delta * delta)
        })
    }

    /// Whether the facets that `v` takes are where the image has them. `is_end` tells of a vertex
    /// whether an edge of a line leads to it.
    fn has_facets_in_place(
        &self,
        star: &Star,
        v: u32,
        to: DVec3,
        is_end: impl Fn(u32) -> bool,
    ) -> bool {
        let Round { interfaces, bounds, .. } = self.round;
        self.taken(star, v, to).all(|(facet, corners @ [a, b, c])| {
            let delta = (bounds.delta)(facet.labels, (a + b + c) / 3.0);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            if facet.labels.contains(&0) && interfaces.oracle.has_walls() {
                let outwards = if facet.labels[1] == 0 { 1.0 } else { -1.0 };
                // The image ends at a wall. The label must reach it there, and nothing of it may be
                // left out beside a wall.
                if interfaces.walls_of(corners).count() > 0 {
                    let label = facet.labels[usize::from(facet.labels[0] == 0)];
                    return interfaces.is_below((a + b + c) / 3.0, outwards * normal, delta, label);
                }
                if interfaces.is_off_wall(corners, facet.labels) {
                    return false;
                }
            }
            let is_there = |at| interfaces.is_between(at, normal, delta, facet.labels);
            // Beside an edge of a line are other labels, too.
            let [with_b, with_c] = facet.others.map(&is_end);
            is_there((a + b + c) / 3.0)
                && (with_b || is_there((a + b) / 2.0))
                && (with_c || is_there((a + c) / 2.0))
        })
    }

    /// Whether the link condition holds for `v` and the vertex of a star in the interfaces and
    /// their lines.
    fn keeps_topology(&mut self, star: &Star, v: u32, support: Support) -> Outcome {
        let Some(i) = star.links.iter().position(|link| link.contains(&v)) else {
            return Outcome::Failed;
        };
        let mut other = std::mem::take(&mut self.other);
        let outcome = match other.collect(&self.round.shared, star.tets[i], v, |t| self.owns(t)) {
            Collected::Star if has_link_condition(star, &other, support, |w| self.walls_at(w)) => {
                Outcome::Sound
            }
            Collected::Foreign => Outcome::Foreign,
            _ => Outcome::Failed,
        };
        self.other = other;
        outcome
    }

    pub(super) fn carry_out(&mut self, star: &Star, u: u32, v: u32) {
        let round = self.round;
        let shared = &round.shared;
        self.counts.contractions += 1;
        // Of a tet that vanishes nothing is left: v is one of its three others.
        star.count_move(shared.point(u), shared.point(v), &mut self.counts);
        for (link, &t) in star.links.iter().zip(&star.tets) {
            if !link.contains(&v) {
                continue;
            }
            // The tets across the facets without u and without v are beside each other from now
            // on. Neither vanishes: each has one of u and v.
            let tet = shared.tet(t);
            let facet = |w: u32| (0..4).find(|&i| tet[i] == w).unwrap_or(0);
            let [beyond_u, beyond_v] = [u, v].map(|w| shared.neighbor(t, facet(w)));
            for (at, beside) in [(beyond_u, beyond_v), (beyond_v, beyond_u)] {
                if at != NONE
                    && let Some(i) = shared.facet_to(at, t)
                {
                    shared.set_neighbor(at, i, beside);
                }
            }
        }
        for ((link, &t), &label) in star.links.iter().zip(&star.tets).zip(&star.labels) {
            if link.contains(&v) {
                shared.free(t);
                continue;
            }
            shared.put(t, shared.tet(t).map(|w| if w == u { v } else { w }), label);
        }
        // What is around may be contracted by now.
        for (link, &t) in star.links.iter().zip(&star.tets) {
            if link.contains(&v) {
                continue;
            }
            for w in link.iter().copied().chain([v]) {
                self.try_later(w);
                // What it had may be gone.
                if self.is_mine(w) && round.tets[w as usize].load(Relaxed) < TRIED {
                    round.tets[w as usize].store(t, Relaxed);
                }
            }
        }
    }
}

/// What became of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The edge may be contracted.
    Sound,
    /// It may not.
    Failed,
    /// It may, perhaps, but that needs a tet that the block does not own.
    Foreign,
}
