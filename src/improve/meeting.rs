//! Meeting: a vertex u goes into one beside it, v, which moves. It is tried where u may go into no
//! vertex as it is.
//!
//! | v is | they meet |
//! |---|---|
//! | inside of a label | on their edge |
//! | on an interface of two labels | near the image's, so that volumes stay |
//! | the same, all of it in one wall | on their edge |
//! | on a line; u, too, or on an interface | where the image has a line with these labels |
//!
//! The middle of their edge is tried first, then places a quarter of it from either end. From there
//! it goes to the nearest place on the image's line, or along the normal of the facets to its
//! interface, and on by as much as keeps the volumes of the two labels, within the tolerance.
//! (A u inside of a label is first projected onto the plane through v across that normal.)
//!
//! Corners don't move. No two meet on interfaces and lines where one is at a contact of voxels. In
//! walls only vertices meet that are in the same ones, and no new place is on a wall that the two
//! are not in.
//!
//! The tets and facets of both vertices must meet the same conditions as in any contraction
//! ([`contraction`](super::contraction)). Volumes are kept as by P. Lindstrom, G. Turk, "Fast and
//! memory efficient polygonal simplification", IEEE Visualization 1998.
//!
//! Sampled by thickness there are a sixth to a quarter fewer tets at deltas of 3 and 6 voxels than
//! where v always stays (docs/reference/coarsening.md).

use glam::DVec3;

use super::contraction::{Contractor, Leaving};
use super::link::{Support, has_link_condition};
use super::smoothing::TO_BORDER;
use super::star::{Collected, Star};
use crate::oracle::Walls;

/// Where on their edge two vertices may meet: parts of the way from the first to the second. With
/// the middle alone AAL at deltas of 3 and 6 has 4 to 5 % more tets.
const PARTS: [f64; 3] = [0.5, 0.75, 0.25];
/// The labels of a line are this near to its points, in voxels.
const BESIDE_LINE: f64 = 0.05;

/// What two vertices may do.
pub(super) enum Meeting {
    At(Place),
    Nowhere,
    /// Meet, perhaps, but that needs a tet that the block does not own.
    Foreign,
}

/// Where two vertices meet.
#[derive(Clone, Copy)]
pub(super) struct Place {
    at: DVec3,
    /// The place on what v belongs to; moves count from there.
    on: DVec3,
}

/// What v belongs to.
enum Ground {
    Inside,
    /// The interface of two labels; the normal leads from the first to the second one.
    Interface([i32; 2], DVec3),
    /// The same, in a wall.
    Wall(Walls),
    Line,
}

impl Contractor<'_, '_> {
    /// Where a vertex may meet `v`.
    pub fn meet(&mut self, leaving: &Leaving<'_>, v: u32) -> Meeting {
        // Its own turn comes in this round; mostly it may meet this one then. If it were tried now
        // as well, there would be 1 to 2 % fewer tets, in up to 1.25 times the time.
        if self.is_to_be_tried(v) {
            return Meeting::Nowhere;
        }
        // No other block moves v: this one owns a tet with it.
        if self.walls_at(v) != leaving.walls {
            return Meeting::Nowhere;
        }
        // v must be this block's own. If the block owns both stars then, it owns all tets that come
        // of them.
        if !self.is_mine(v) {
            return Meeting::Foreign;
        }
        let mut star = std::mem::take(&mut self.other);
        let met = self.meet_star(leaving, v, &mut star);
        self.other = star;
        met
    }

    /// The same; the memory of `star` is used for that of `v`.
    fn meet_star(&self, leaving: &Leaving<'_>, v: u32, star: &mut Star) -> Meeting {
        let shared = &self.round.shared;
        let Some(i) = leaving.star.links.iter().position(|link| link.contains(&v)) else {
            return Meeting::Nowhere;
        };
        match star.collect(shared, leaving.star.tets[i], v, |tet| self.owns(tet)) {
            Collected::Star => {}
            Collected::Foreign => return Meeting::Foreign,
            Collected::Open => return Meeting::Nowhere,
        }
        let walls_at = |w| self.walls_at(w);
        let Some(support) = Support::of(star, walls_at) else { return Meeting::Nowhere };
        let staying = Leaving::new(star, support, leaving.walls, shared.point(v));
        let both = [leaving, &staying];
        let Some(ground) = self.ground(both) else { return Meeting::Nowhere };
        if leaving.support != Support::Inside
            && !has_link_condition(leaving.star, star, leaving.support, walls_at)
        {
            return Meeting::Nowhere;
        }
        let places = PARTS.into_iter().filter_map(|part| self.place(both, &ground, part));
        let pairs = [(leaving, v), (&staying, leaving.star.vertex)];
        let mut sound = places.filter(|place| {
            self.may_become(&pairs, place.at) && self.has_labels_beside(both, &ground, place.on)
        });
        sound.next().map_or(Meeting::Nowhere, Meeting::At)
    }

    /// What the second of two vertices belongs to, if it may move there.
    fn ground(&self, both: [&Leaving<'_>; 2]) -> Option<Ground> {
        let [one, other] = both;
        let (walls, oracle) = (one.walls, self.round.interfaces.oracle);
        match other.support {
            Support::Inside => (walls.count() == 0).then_some(Ground::Inside),
            _ if both.iter().any(|vertex| oracle.is_near_contact(vertex.at)) => None,
            // From inside of a label a line's nearest point is mostly v.
            Support::Line(_) => {
                (walls.count() == 0 && one.support != Support::Inside).then_some(Ground::Line)
            }
            Support::Interface if walls.count() == 0 => {
                let corners = both.into_iter().flat_map(|vertex| self.facets_of(vertex));
                let areas = corners.map(|[a, b, c]| (b - a).cross(c - a));
                let normal = areas.sum::<DVec3>().normalize_or_zero();
                Some(Ground::Interface(other.star.surface()?, normal))
            }
            Support::Interface => {
                let others = both.into_iter().flat_map(|vertex| &vertex.star.facets);
                let mut others = others.flat_map(|facet| facet.others);
                let is_in_walls = |w| walls.common(&self.walls_at(w)) == walls;
                let is_flat = walls.count() == 1 && others.all(is_in_walls);
                is_flat.then_some(Ground::Wall(walls))
            }
        }
    }

    /// The corners of the facets of a vertex.
    fn facets_of(&self, vertex: &Leaving<'_>) -> impl Iterator<Item = [DVec3; 3]> {
        vertex.star.facets.iter().map(|facet| {
            let [b, c] = facet.others.map(|w| self.round.shared.point(w));
            [vertex.at, b, c]
        })
    }

    /// The place where two vertices may meet, such a part of the way from the first to the second.
    fn place(&self, both: [&Leaving<'_>; 2], ground: &Ground, part: f64) -> Option<Place> {
        let interfaces = self.round.interfaces;
        let [a, b] = both.map(|vertex| vertex.at);
        let half = 0.5 * a.distance(b);
        let from = match *ground {
            // From inside of a label it may be far to the interface, where v is.
            Ground::Interface(_, normal) if both[0].support == Support::Inside => {
                a - (a - b).project_onto_normalized(normal)
            }
            _ => a,
        };
        let p = from.lerp(b, part);
        let (on, off) = match *ground {
            Ground::Inside => (p, DVec3::ZERO),
            Ground::Wall(walls) => (interfaces.oracle.onto_walls(p, walls), DVec3::ZERO),
            Ground::Line => (interfaces.oracle.nearest_junction(p, half)?, DVec3::ZERO),
            Ground::Interface(labels, normal) => {
                let delta = (self.round.bounds.delta)(labels, p);
                let on = interfaces.find(p, normal, delta, half, labels)?;
                (on, self.off(both, on, normal) * normal)
            }
        };
        let place = Place { at: on + off, on };
        let walls = both[0].walls;
        let is_beside_others = [on, place.at].into_iter().any(|p| {
            interfaces.oracle.walls_at(p) != walls || interfaces.oracle.is_beyond_walls(p)
        });
        (!is_beside_others).then_some(place)
    }

    /// Whether a place on a line has all labels beside it that are beside the two vertices: the
    /// image's nearest line may be another one.
    fn has_labels_beside(&self, both: [&Leaving<'_>; 2], ground: &Ground, on: DVec3) -> bool {
        let interfaces = self.round.interfaces;
        let mut labels = both.into_iter().flat_map(|vertex| &vertex.star.labels);
        !matches!(ground, Ground::Line)
            || labels.all(|&label| {
                interfaces.oracle.has_label_near(on, interfaces.id(label), BESIDE_LINE)
            })
    }

    /// How far along the normal from `on` two vertices meet so that the volumes on both sides of
    /// the interface stay, or as far as the tolerance allows.
    fn off(&self, both: [&Leaving<'_>; 2], on: DVec3, normal: DVec3) -> f64 {
        let [one, other] = both;
        // Facets of both count once.
        let of_other = self.facets_of(other).zip(&other.star.facets);
        let of_other = of_other.filter(|(_, facet)| !facet.others.contains(&one.star.vertex));
        let facets = self.facets_of(one).chain(of_other.map(|(corners, _)| corners));
        let off = off_for_volume(facets, on, normal);
        let max = TO_BORDER * self.round.interfaces.tolerance;
        if off.is_finite() { off.clamp(-max, max) } else { 0.0 }
    }

    /// Lets the vertex of a star, one of whose tets is `t`, meet the one that [`Self::meet`] has
    /// found a place for.
    pub fn carry_out_meeting(&mut self, star: &mut Star, t: u32, place: Place) {
        let shared = &self.round.shared;
        let (u, other) = (star.vertex, std::mem::take(&mut self.other));
        let v = other.vertex;
        other.count_move(shared.point(v), place.at, &mut self.counts);
        if !other.facets.is_empty() {
            let moved = place.at.distance(place.on);
            self.counts.max_interface_move = self.counts.max_interface_move.max(moved);
            self.met.push((v, place.on));
        }
        other.links.iter().flatten().filter(|&&w| w != u).for_each(|&w| self.try_later(w));
        self.other = other;
        shared.set_point(v, place.at);
        // With v where it is now.
        star.collect(shared, t, u, |_| true);
        self.carry_out(star, u, v);
    }
}

/// How far along the normal from `on` facets must meet that replace others with the same rim, so
/// that the volume below them stays.
fn off_for_volume(replaced: impl Iterator<Item = [DVec3; 3]>, on: DVec3, normal: DVec3) -> f64 {
    // Six times the volume between these facets and those that meet in `on`, and by how much less
    // it is for a point one farther along the normal.
    let (volume, rate) = replaced.fold((0.0, 0.0), |(volume, rate), [a, b, c]| {
        let area = (b - a).cross(c - a);
        (volume + (a - on).dot(area), rate + area.dot(normal))
    });
    volume / rate
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A fan of facets about a point is replaced by one about another point.
        #[test]
        fn volumes_stay(
            heights in prop::collection::vec(-1.0..1.0f64, 3..12),
            apex in [-0.3..0.3f64, -0.3..0.3, -2.0..2.0],
            on in [-0.3..0.3f64, -0.3..0.3, -2.0..2.0],
            way in [-0.3..0.3f64, -0.3..0.3],
        ) {
            let n = heights.len();
            let rim: Vec<_> = heights.iter().enumerate().map(|(i, &z)| {
                let angle = TAU * i as f64 / n as f64;
                DVec3::new(angle.cos(), angle.sin(), z)
            }).collect();
            let fan = |p: DVec3| (0..n).map(|i| [p, rim[i], rim[(i + 1) % n]]).collect::<Vec<_>>();
            let normal = DVec3::new(way[0], way[1], 1.0).normalize();
            let (old, on) = (fan(apex.into()), DVec3::from(on));
            let new = fan(on + off_for_volume(old.iter().copied(), on, normal) * normal);
            // As seen from the origin; what closes the body is the same.
            let below = |fan: &[[DVec3; 3]]| {
                fan.iter().map(|[a, b, c]| a.dot(b.cross(*c)) / 6.0).sum::<f64>()
            };
            prop_assert!((below(&old) - below(&new)).abs() < 1e-9);
        }
    }
}
