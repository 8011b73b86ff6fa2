//! What improvement asks about the interfaces: how far they may change, and where a moved vertex
//! belongs.

use glam::DVec3;
use rayon::prelude::*;

use super::{CHUNK, Settings};
use crate::Result;
use crate::delaunay::tet::FACET;
use crate::geometry::shape::has_angle_below;
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::{Oracle, Walls};
use crate::params::Improve;
use crate::refine::rules::FACET_DISTANCE;
use crate::sizing::Sizing;

/// Distances at which the labels beside a facet are looked for, in parts of the largest. What lies
/// wholly between two of them is thinner than 0.3 of the larger one.
const NEARER: [f64; 7] = [1.0, 0.71, 0.5, 0.35, 0.25, 0.18, 0.125];

/// The interfaces of a run.
pub(super) struct Interfaces<'a> {
    pub oracle: &'a Oracle,
    /// The label of each id of the oracle.
    pub labels: &'a [i32],
    pub sizing: &'a Sizing,
    /// How far a vertex of an interface may be moved in all, and how far a facet may be from those
    /// it replaces.
    pub tolerance: f64,
    /// The squared cosine of the smallest angle of an interface facet.
    pub facet_cosine_squared: f64,
    /// Whether interfaces are changed at all.
    pub change: bool,
}

impl<'a> Interfaces<'a> {
    /// Those of a run with these settings.
    pub fn new(settings: &Settings<'a>) -> Self {
        let &Settings { oracle, labels, sizing, tolerance, facet_angle, improve, .. } = settings;
        Self {
            oracle,
            labels,
            sizing,
            tolerance,
            facet_cosine_squared: facet_angle.to_radians().cos().powi(2),
            change: improve == Improve::Full,
        }
    }

    /// The label at a point.
    pub fn label(&self, p: DVec3) -> i32 {
        self.labels[usize::from(self.oracle.label(p))]
    }

    /// The id of a label of the image.
    pub fn id(&self, label: i32) -> u16 {
        // The background comes first, the others in order.
        let before = || 1 + self.labels[1..].partition_point(|&other| other < label) as u16;
        if label == 0 { 0 } else { before() }
    }

    /// Whether a facet between two labels is where the image has that interface: has the first
    /// label below it and the second one above, in the direction of (b - a) x (c - a), within the
    /// facet distance of refinement (rule R3).
    pub fn holds_facet(&self, [a, b, c]: [DVec3; 3], [below, above]: [i32; 2]) -> bool {
        let center = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let off = FACET_DISTANCE * self.sizing.at(center) * normal;
        self.label(center - off) == below && self.label(center + off) == above
    }

    /// Whether a place is near the image's interface of two labels: whether the first label is
    /// below it and the second one above, each at some distance of at most the facet distance for
    /// samples that are `delta` apart. Where a label is thin only small ones will do, and on the
    /// far side of the interface not the smallest.
    pub fn is_between(&self, at: DVec3, normal: DVec3, delta: f64, pair: [i32; 2]) -> bool {
        let [below, above] = pair;
        let off = FACET_DISTANCE * delta * normal;
        NEARER.iter().any(|part| self.label(at - part * off) == below)
            && NEARER.iter().any(|part| self.label(at + part * off) == above)
    }

    /// Whether a label is below a place, at one of these distances.
    pub fn is_below(&self, at: DVec3, normal: DVec3, delta: f64, label: i32) -> bool {
        NEARER.iter().any(|part| self.label(at - part * FACET_DISTANCE * delta * normal) == label)
    }

    /// Whether the squared sine of the least angle of a triangle is at least `measure`.
    pub fn has_angles(&self, [a, b, c]: [DVec3; 3], measure: f64) -> bool {
        !has_angle_below(a, b, c, 1.0 - measure)
    }

    /// Whether all angles of an interface facet are as large as asked for.
    pub fn is_well_shaped(&self, [a, b, c]: [DVec3; 3]) -> bool {
        !has_angle_below(a, b, c, self.facet_cosine_squared)
    }

    /// Whether interface facets that take the place of `old` ones have angles as large as asked
    /// for, or at least the least angle that there was.
    fn keep_angles<const N: usize>(&self, new: [[DVec3; 3]; N], old: [[DVec3; 3]; N]) -> bool {
        if new.iter().all(|&facet| self.is_well_shaped(facet)) {
            return true;
        }
        let least = |facets: [[DVec3; 3]; N]| {
            facets.iter().map(|[a, b, c]| facet_measure(*a, &[*b, *c])).fold(1.0, f64::min)
        };
        least(new) >= least(old)
    }

    /// The point of the interface near `p`, along `normal`, that has the first label below and the
    /// second one above, both at a distance of `reach`.
    pub fn project(&self, p: DVec3, normal: DVec3, reach: f64, pair: [i32; 2]) -> Option<DVec3> {
        self.oracle.project(p, normal, reach, pair, self.labels)
    }

    /// The point of the interface near `p`, along `normal`, that has the first label below and the
    /// second one above, both at the same distance of at most `reach` and the facet distance for
    /// samples that are `delta` apart. Of several distances the smallest that will do: farther away
    /// may be another interface of the two.
    pub fn find(
        &self,
        p: DVec3,
        normal: DVec3,
        delta: f64,
        reach: f64,
        pair: [i32; 2],
    ) -> Option<DVec3> {
        let reach = reach.min(FACET_DISTANCE * delta);
        NEARER.iter().rev().find_map(|part| self.project(p, normal, part * reach, pair))
    }

    /// Whether `to` is no farther from the interface than `from`, measured along the line through
    /// both.
    pub fn is_closer(&self, to: DVec3, from: DVec3, up: DVec3, labels: [i32; 2]) -> bool {
        let way = (to - from).normalize_or_zero();
        let normal = if way.dot(up) < 0.0 { -way } else { way };
        let reach = to.distance(from) + self.tolerance;
        self.project(to, normal, reach, labels)
            .is_some_and(|at| at.distance_squared(to) <= at.distance_squared(from))
    }

    /// Whether interface facets between two labels may take the place of `old` ones: they keep
    /// their angles, and none is off the wall that it should lie on, unless an old one was.
    pub fn keep_facets<const N: usize>(
        &self,
        new: [[DVec3; 3]; N],
        old: [[DVec3; 3]; N],
        labels: [i32; 2],
    ) -> bool {
        let is_off_wall = |facet| self.is_off_wall(facet, labels);
        self.keep_angles(new, old)
            && (!new.into_iter().any(is_off_wall) || old.into_iter().any(is_off_wall))
    }

    /// Whether an outer facet between two labels, the second one above it in the direction of
    /// (b - a) x (c - a), is off the wall that it should lie on.
    pub fn is_off_wall(&self, facet: [DVec3; 3], [below, above]: [i32; 2]) -> bool {
        let outwards = if above == 0 { 1.0 } else { -1.0 };
        self.oracle.has_walls()
            && (below == 0 || above == 0)
            && self.oracle.is_off_wall(facet, outwards)
    }

    /// The walls that all three points are on.
    pub fn walls_of(&self, points: [DVec3; 3]) -> Walls {
        let [a, b, c] = points.map(|p| self.oracle.walls_at(p));
        a.common(&b).common(&c)
    }
}

/// The squared sine of the least angle of a triangle.
pub(super) fn facet_measure(a: DVec3, &[b, c]: &[DVec3; 2]) -> f64 {
    let (u, v, w) = ((b - a).length_squared(), (c - a).length_squared(), (c - b).length_squared());
    // Opposite to the shortest edge, between the two others.
    (b - a).cross(c - a).length_squared() * u.min(v).min(w) / (u * v * w)
}

/// How many interface facets of a mesh have an angle below so many degrees.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled).
pub fn facets_below(mesh: &TetMesh, degrees: f64, monitor: &Monitor<'_>) -> Result<u64> {
    let cosine_squared = degrees.to_radians().cos().powi(2);
    let of_tet = |t: usize| {
        let (tet, label) = (mesh.tets[t], mesh.labels[t]);
        // Each facet once, from the side with the larger label.
        let is_interface =
            |n: u32| if n == NONE { label != 0 } else { mesh.labels[n as usize] < label };
        let is_below = |i: &usize| {
            let [a, b, c]: [DVec3; 3] = FACET[*i].map(|k| mesh.point(tet[k]));
            has_angle_below(a, b, c, cosine_squared)
        };
        let facets = (0..4).filter(|&i| tet[0] != NONE && is_interface(mesh.neighbors[t][i]));
        facets.filter(is_below).count() as u64
    };
    let of_chunk = |chunk: usize| {
        monitor.advance(0)?;
        let tets = chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.tets.len());
        Ok(tets.map(of_tet).sum::<u64>())
    };
    let chunks = (0..mesh.tets.len().div_ceil(CHUNK)).into_par_iter();
    chunks.map(of_chunk).try_reduce(|| 0, |a, b| Ok(a + b))
}
