//! The tets that may get another label: alone, and with a neighbour.

use glam::DVec3;
use rayon::prelude::*;

use super::standings::{Candidate, Components, Outcome, corners, no_vertices};
use crate::Result;
use crate::delaunay::tet::FACET;
use crate::geometry::measures::{tet_centroid, tet_volume, triangle_angles};
use crate::image::LabelImage;
use crate::memory::bits::Bits;
use crate::memory::{concatenated, reserve};
use crate::mesh::vicinity::{Stars, Vicinity};
use crate::mesh::{NONE, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// The image must have the new label in more than this part of a candidate.
const LEAST_PART: f64 = 0.5;

/// Points along an edge of a tet at which the image is asked for its label, and in all of the tet.
const STEPS: usize = 5;
const POINTS: usize = STEPS * (STEPS + 1) * (STEPS + 2) / 6;

/// Tets of one piece of work.
const CHUNK: usize = 1 << 10;

/// The tets with a vertex of `near` at whose middle the image has another label, with this label;
/// one of the two is that of a component for which something could be gained.
pub(super) fn suspects(
    mesh: &TetMesh,
    components: &Components<'_>,
    near: &Bits,
    image: &LabelImage,
    oracle: &Oracle,
    monitor: &Monitor<'_>,
) -> Result<Vec<(u32, i32)>> {
    let of_chunk = |(chunk, tets): (usize, &[[u32; 4]])| {
        monitor.advance(0)?;
        let mut found = Vec::new();
        for (t, vertices) in ((chunk * CHUNK) as u32..).zip(tets) {
            if vertices[0] == NONE || !vertices.iter().any(|&v| near.has(v)) {
                continue;
            }
            let from = mesh.labels[t as usize];
            let centroid = tet_centroid(&corners(mesh, t));
            let to = image.labels()[usize::from(oracle.label(centroid))];
            let is_open = || [from, to].iter().any(|l| components.open_labels.contains(l));
            if to != from && is_open() {
                reserve(&mut found, 1, SUSPECTS)?;
                found.push((t, to));
            }
        }
        Ok(found)
    };
    let chunks = mesh.tets.par_chunks(CHUNK).enumerate().map(of_chunk);
    concatenated(chunks.collect::<Result<_>>()?, SUSPECTS)
}

/// What lists of suspects have, as errors name it.
const SUSPECTS: &str = "tets with another label than the image";

/// The stars of the corners of these tets, and of their neighbours.
pub(super) fn stars_around(
    mesh: &TetMesh,
    suspects: &[(u32, i32)],
    monitor: &Monitor<'_>,
) -> Result<Stars> {
    let vertices = no_vertices(mesh)?;
    suspects.par_iter().for_each(|&(t, _)| {
        let neighbors = mesh.neighbors[t as usize].into_iter().filter(|&n| n != NONE);
        let corners = neighbors.chain([t]).flat_map(|t| mesh.tets[t as usize]);
        corners.for_each(|v| vertices.set(v));
    });
    Stars::new(mesh, vertices, monitor)
}

/// Angles of facets that come to lie on an interface, in degrees: none has less than the first, and
/// where there is a choice none has less than the second.
pub(super) type Angles = [f64; 2];

/// What tells which tets may get another label.
pub(super) struct Search<'a> {
    pub mesh: &'a TetMesh,
    pub components: &'a Components<'a>,
    pub image: &'a LabelImage,
    pub oracle: &'a Oracle,
    /// As [`Angles`] has them.
    pub angles: Angles,
    /// The vertices around which there may be other tets, if the mesh is a part of one.
    pub rim: Option<&'a Bits>,
}

impl Search<'_> {
    /// Those of `suspects`, alone and with a neighbour, that would gain by the label that the image
    /// has in most of them.
    pub fn candidates(
        &self,
        suspects: &[(u32, i32)],
        stars: &Stars,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<Candidate>> {
        const WHAT: &str = "candidates";
        let &Self { mesh, components, angles: [least_angle, facet_angle], .. } = self;
        let of_chunk = |suspects: &[(u32, i32)]| {
            monitor.advance(0)?;
            let mut found = Vec::new();
            for &(t, to) in suspects {
                let from = mesh.labels[t as usize];
                let is_like = |&n: &u32| n != NONE && mesh.labels[n as usize] == from;
                let neighbors = mesh.neighbors[t as usize].into_iter().filter(is_like);
                let alone = Vicinity::new(mesh, t, |v| stars.of(v));
                for other in neighbors.chain([NONE]) {
                    let candidate = Candidate {
                        tets: [t, other],
                        from,
                        to,
                        part: 0.0,
                        loose: 0,
                        is_sharp: false,
                    };
                    let tets = candidate.tets();
                    let is_at_rim = |rim: &Bits| {
                        tets.iter().flat_map(|&t| mesh.tets[t as usize]).any(|v| rim.has(v))
                    };
                    if self.rim.is_some_and(is_at_rim) {
                        continue;
                    }
                    let outcome = if other == NONE {
                        components.outcome(mesh, t, &alone, [from, to])
                    } else {
                        let pair = alone.with(mesh, other, |v| stars.of(v));
                        components.outcome(mesh, t, &pair, [from, to])
                    };
                    let Some(Outcome { loose, .. }) = outcome else { continue };
                    let angle = least_new_angle(mesh, tets);
                    if angle < least_angle || self.makes_nicks(tets, to) {
                        continue;
                    }
                    let part = self.part_of(tets, to);
                    if part > LEAST_PART {
                        reserve(&mut found, 1, WHAT)?;
                        let is_sharp = angle < facet_angle;
                        found.push(Candidate { part, loose, is_sharp, ..candidate });
                    }
                }
            }
            Ok(found)
        };
        let chunks = suspects.par_chunks(CHUNK).map(of_chunk);
        let mut all: Vec<Candidate> = concatenated(chunks.collect::<Result<_>>()?, WHAT)?;
        all.sort_by(|a, b| {
            let [first, second] = [a, b].map(|c| (c.is_sharp, c.loose, c.tets().len()));
            first.cmp(&second).then(b.part.total_cmp(&a.part)).then(a.tets.cmp(&b.tets))
        });
        Ok(all)
    }

    /// Whether an outer facet that comes with label `to` of some tets should lie on a wall, and
    /// does not.
    fn makes_nicks(&self, tets: &[u32], to: i32) -> bool {
        let &Self { mesh, oracle, .. } = self;
        let is_nick = |t: u32, i: usize| {
            let n = mesh.neighbors[t as usize][i];
            let beyond = if n == NONE { 0 } else { mesh.labels[n as usize] };
            let was_background = mesh.labels[t as usize] == 0;
            let is_outer = beyond != to && (to == 0 || beyond == 0 && was_background);
            let is_new = !tets.contains(&n) && is_outer;
            // FACET's normals point into the tet.
            let outwards = if to == 0 { 1.0 } else { -1.0 };
            let corners = || FACET[i].map(|k| mesh.point(mesh.tets[t as usize][k]));
            is_new && oracle.is_off_wall(corners(), outwards)
        };
        oracle.has_walls() && tets.iter().any(|&t| (0..4).any(|i| is_nick(t, i)))
    }

    /// The part of the volume of tets in which the image has a label.
    fn part_of(&self, tets: &[u32], label: i32) -> f64 {
        let &Self { mesh, image, oracle, .. } = self;
        let sums = tets.iter().fold([0.0; 2], |[all, part], &t| {
            let corners = corners(mesh, t);
            let volume = tet_volume(&corners);
            let is_label = |p: &DVec3| image.labels()[usize::from(oracle.label(*p))] == label;
            let hits = points_within(&corners).filter(is_label).count();
            [all + volume, part + volume * hits as f64 / POINTS as f64]
        });
        sums[1] / sums[0]
    }
}

/// The least angle, in degrees, of facets that come to lie on an interface when `tets` lose their
/// label.
fn least_new_angle(mesh: &TetMesh, tets: &[u32]) -> f64 {
    let of_tet = |&t: &u32| {
        let label = mesh.labels[t as usize];
        let comes =
            move |n: u32| n != NONE && !tets.contains(&n) && mesh.labels[n as usize] == label;
        (0..4)
            .filter(move |&i| comes(mesh.neighbors[t as usize][i]))
            .map(move |i| FACET[i].map(|k| mesh.point(mesh.tets[t as usize][k])))
    };
    let angles = tets.iter().flat_map(of_tet).flat_map(|facet| triangle_angles(&facet));
    angles.fold(f64::INFINITY, f64::min)
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
