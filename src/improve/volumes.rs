//! Volumes: labels get back what flips and moves took from them.
//!
//! A flip or move on an interface keeps within the tolerance, but takes some volume from one label
//! and gives it to another. Over many that evens out. In a small mesh, or where facets are large
//! for what they bound, it may not. So where more than [`OF_ALL`] or [`OF_LABEL`] has changed,
//! vertices of interfaces are moved along their normals in the end, those between the same two
//! labels by the same distance; in a large mesh a sample of them.
//!
//! # Which distance
//! Label L is to gain the volume g(L), and A(L, M) is the area that can be moved between L and M.
//! The interface between them moves from L towards M by p(L) - p(M), where p of the background is 0
//! and
//!
//! ```text
//! for each label L:  sum over M of A(L, M) (p(L) - p(M)) = g(L)
//! ```
//!
//! Of all distances that give each label what it is to gain, these have the least sum of squares,
//! weighted by area: p are the Lagrange multipliers. It is Laplace's equation on the graph of
//! labels, solved by conjugate gradients.
//!
//! A vertex stays where it is if a tet around it would fall below the target, or a facet below its
//! angle. So the rest is sought again, among those vertices that can move.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::blocks::Blocks;
use super::measure::Measure;
use super::rounds::Run;
use super::smoothing::{Support, is_valid};
use super::star::{Collected, Star};
use super::worker::{Round, Worker};
use crate::memory::{reserve, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::{Error, Result};

/// By how much the volume of the object may change, in parts of it.
const OF_ALL: f64 = 1e-4;
/// The same for a label that has so many voxels at least.
const OF_LABEL: f64 = 1e-3;
const LABEL_FROM: f64 = 1000.0;
/// Once volumes are given back, no more than this part of what may change is left.
const REST: f64 = 0.2;
/// Most rounds. What each gives back depends on how many vertices can move.
const MAX_ROUNDS: u32 = 12;
/// About so many vertices are moved in the first round, and twice as many in each that follows:
/// enough for what is mostly missing, so that a large mesh does not take seconds.
const SAMPLE: usize = 20_000;
/// 2^32 over the golden ratio.
const MIX: u32 = 0x9E37_79B9;
/// A vertex moves by no more than this part of the tolerance in a round.
const MAX_STEP: f64 = 0.25;
/// Parts of the way that are tried.
const PARTS: [f64; 2] = [1.0, 0.5];
/// The residual of the solution, in parts of what is to be gained.
const RESIDUAL: f64 = 1e-6;
/// Most steps towards it; labels are few steps from the background.
const MAX_STEPS: usize = 500;
/// Added to the diagonal, in parts of it: labels that meet only each other can't both gain.
const SHIFT: f64 = 1e-6;
/// Tets, or vertices, per piece of work.
const CHUNK: usize = 1 << 12;

/// A vertex of an interface.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Vertex {
    /// Where it lies in this round.
    block: u32,
    index: u32,
    /// One of its tets.
    tet: u32,
}

/// What a vertex is between.
struct Between {
    /// The labels below and above.
    labels: [i32; 2],
    ids: [usize; 2],
    /// By how much the one below grows with a move of the vertex: its derivative. This leads from
    /// the one below to the one above.
    area: DVec3,
}

impl Run<'_, '_> {
    /// Gives labels their volumes back where more has changed than may. `volumes` are those of the
    /// ids of labels in the image. Returns what ended the work early.
    ///
    /// # Errors
    /// [`OutOfMemory`](Error::OutOfMemory), with the mesh valid.
    pub fn give_back(&mut self, volumes: &[f64]) -> Result<Option<Error>> {
        if !self.interfaces.change || self.missing(volumes, 1.0).is_none() {
            return Ok(None);
        }
        let blocks = Blocks::new(&self.mesh.points, self.mesh.tets.len());
        let of_interfaces = vertices_of_interfaces(self.mesh)?;
        for round in 0..MAX_ROUNDS {
            let Some(missing) = self.missing(volumes, REST) else { break };
            let of_vertices = blocks.of_vertices(self.mesh, self.rounds)?;
            self.rounds += 1;
            let mut sample = sample_of(&of_interfaces, round)?;
            sample.par_iter_mut().for_each(|vertex| {
                vertex.block = of_vertices[vertex.index as usize];
            });
            sample.par_sort_unstable();
            let jobs: Vec<&[Vertex]> = sample.chunk_by(|a, b| a.block == b.block).collect();
            let lengths = || jobs.iter().map(|job| job.len());
            let mut areas = BTreeMap::new();
            for of_job in self.side_by_side(&of_vertices, lengths(), |round, job| {
                Worker::new(round, jobs[job][0].block, 0..0, 0..0).areas(jobs[job])
            }) {
                match of_job {
                    Ok(of_job) => of_job
                        .into_iter()
                        .for_each(|(ids, area)| *areas.entry(ids).or_insert(0.0) += area),
                    Err(ended) => return Ok(Some(ended)),
                }
            }
            let potentials = potentials(missing, &areas);
            let mut ended = None;
            for (counts, result) in self.side_by_side(&of_vertices, lengths(), |round, job| {
                let mut worker = Worker::new(round, jobs[job][0].block, 0..0, 0..0);
                let result = worker.shift(jobs[job], &potentials);
                (worker.counts, result)
            }) {
                self.counts.add(&counts);
                ended = ended.or(result.err());
            }
            if ended.is_some() {
                return Ok(ended);
            }
        }
        Ok(None)
    }

    /// What the id of each label is to gain; `None` where no more than this part of what may change
    /// has changed.
    fn missing(&self, volumes: &[f64], part: f64) -> Option<Vec<f64>> {
        let of_voxel = self.interfaces.oracle.spacing().element_product();
        let mut missing = vec![0.0; volumes.len()];
        for &(label, gained) in &self.counts.volumes {
            if let Some(missing) = missing.get_mut(self.interfaces.id(label)) {
                *missing = -gained;
            }
        }
        // The background gets what the object loses.
        let of_labels = || missing.iter().zip(volumes).skip(1);
        let all: [f64; 2] =
            of_labels().fold([0.0; 2], |[sum, of], (missing, volume)| [sum + missing, of + volume]);
        let is_off = all[0].abs() > part * OF_ALL * all[1]
            || of_labels().any(|(missing, &volume)| {
                volume >= LABEL_FROM * of_voxel && missing.abs() > part * OF_LABEL * volume
            });
        is_off.then_some(missing)
    }
}

impl Worker<'_, '_> {
    /// The areas between the ids of two labels that these vertices move.
    fn areas(&mut self, vertices: &[Vertex]) -> Result<BTreeMap<[usize; 2], f64>> {
        (self.round.report_and_check)(0)?;
        let mut areas = BTreeMap::new();
        for &vertex in vertices {
            if let Some(Between { ids, area, .. }) = self.between(vertex) {
                *areas.entry(ids).or_insert(0.0) += area.length();
            }
        }
        Ok(areas)
    }

    /// Moves these vertices by the differences of the potentials, as far as they can be.
    fn shift(&mut self, vertices: &[Vertex], potentials: &[f64]) -> Result<()> {
        let max = MAX_STEP * self.round.interfaces.tolerance;
        (self.round.report_and_check)(0)?;
        for &vertex in vertices {
            let Some(Between { labels, ids: [below, above], area }) = self.between(vertex) else {
                continue;
            };
            let (normal, at) = (area.normalize_or_zero(), self.point(vertex.index));
            let distance = (potentials[below] - potentials[above]).clamp(-max, max);
            let star = std::mem::take(&mut self.star);
            let places = PARTS.map(|part| at + normal * (part * distance));
            if let Some(to) = places.into_iter().find(|&to| self.may_be(&star, at, to)) {
                let support = Support::Interface { labels, normal, off: DVec3::ZERO };
                self.move_vertex(&star, support, to);
                star.tets.iter().for_each(|&t| self.round.shared.note_changed(t));
            }
            self.star = star;
        }
        Ok(())
    }

    /// What a vertex is between, if all around it is the block's, and two labels meet there in a
    /// surface that nothing holds. Its star is then at hand.
    fn between(&mut self, vertex: Vertex) -> Option<Between> {
        let mut star = std::mem::take(&mut self.star);
        let Vertex { index, tet, .. } = vertex;
        let collected = star.collect(&self.round.shared, tet, index, |tet| self.owns(tet));
        self.star = star;
        let labels = (collected == Collected::Star).then(|| self.star.surface()).flatten()?;
        let (at, interfaces) = (self.point(index), self.round.interfaces);
        if interfaces.oracle.walls_at(at).count() > 0 || interfaces.oracle.is_near_contact(at) {
            return None;
        }
        let areas = self.star.facets.iter().map(|facet| {
            let [p, q] = facet.others.map(|v| self.point(v) - at);
            p.cross(q) / 6.0
        });
        Some(Between { labels, ids: labels.map(|label| interfaces.id(label)), area: areas.sum() })
    }

    /// Whether the vertex of a star may go from one place to another: no tet and no facet comes
    /// below what was asked for, or gets worse if it is below already.
    fn may_be(&self, star: &Star, from: DVec3, to: DVec3) -> bool {
        let Round { measure, interfaces, .. } = self.round;
        // Where nothing else helped a tet may be long: such a one is to keep its angles, too.
        let keeps = |measure: Measure| {
            let mut tets = star.labels.iter().zip(&star.points);
            tets.all(|(&label, &[x, y, z])| {
                label == 0
                    || measure.exceeds(&[to, x, y, z], measure.target)
                    || measure.of(&[to, x, y, z]) >= measure.of(&[from, x, y, z])
            })
        };
        let farthest = self.farthest() * interfaces.tolerance;
        to.distance(self.refined(star.vertex)) <= farthest
            && self.distance_from_refined(star, to) <= interfaces.tolerance
            && keeps(*measure)
            && keeps(measure.last())
            && is_valid(star, to)
            && self.keeps_facets(star, to)
    }
}

/// The vertices of interface facets, each with the first of its tets that has one.
fn vertices_of_interfaces(mesh: &TetMesh) -> Result<Vec<Vertex>> {
    let first: Vec<AtomicU32> = zeroed(mesh.points.len(), "vertices of interfaces")?;
    mesh.tets.par_iter().enumerate().with_min_len(CHUNK).for_each(|(t, tet)| {
        let label_across = |i: usize| mesh.labels.get(mesh.neighbors[t][i] as usize);
        let is_interface = |i| label_across(i).is_some_and(|&label| label != mesh.labels[t]);
        if tet[0] == NONE {
            return;
        }
        for (i, &v) in tet.iter().enumerate() {
            if (0..4).any(|facet| facet != i && is_interface(facet)) {
                // Counted down, so that zero is none.
                first[v as usize].fetch_max(u32::MAX - t as u32, Relaxed);
            }
        }
    });
    let count = first.par_iter().filter(|first| first.load(Relaxed) != 0).count();
    let mut vertices = Vec::new();
    reserve(&mut vertices, count, "vertices of interfaces")?;
    for (index, first) in (0..).zip(first) {
        let first = first.into_inner();
        if first != 0 {
            vertices.push(Vertex { block: 0, index, tet: u32::MAX - first });
        }
    }
    Ok(vertices)
}

/// The vertices that may be moved in a round: of many one in so many, others each time.
fn sample_of(vertices: &[Vertex], round: u32) -> Result<Vec<Vertex>> {
    let stride = (vertices.len() / (SAMPLE << round)).max(1) as u32;
    // Mixed, so that neighbours, whose numbers are near, are not chosen together.
    let is_chosen =
        |vertex: &&Vertex| (vertex.index.wrapping_mul(MIX) >> 8).wrapping_add(round) % stride == 0;
    let mut sample = Vec::new();
    reserve(&mut sample, vertices.len() / stride as usize, "vertices of interfaces")?;
    for &vertex in vertices.iter().filter(is_chosen) {
        reserve(&mut sample, 1, "vertices of interfaces")?;
        sample.push(vertex);
    }
    Ok(sample)
}

/// The potentials of ids that give each what it is to gain, where so large areas can be moved
/// between two of them; id 0 has 0.
fn potentials(gains: Vec<f64>, areas: &BTreeMap<[usize; 2], f64>) -> Vec<f64> {
    let count = gains.len();
    let mut diagonal = vec![0.0; count];
    for (&ids, area) in areas {
        ids.into_iter().for_each(|id| diagonal[id] += (1.0 + SHIFT) * area);
    }
    diagonal[0] = 0.0;
    let times = |x: &[f64]| {
        let mut product: Vec<f64> = x.iter().zip(&diagonal).map(|(x, d)| x * d).collect();
        for (&[a, b], area) in areas.iter().filter(|([a, b], _)| *a != 0 && *b != 0) {
            product[a] -= area * x[b];
            product[b] -= area * x[a];
        }
        product
    };
    // What can't be moved at all gains nothing.
    let divided = |x: &[f64]| -> Vec<f64> {
        x.iter().zip(&diagonal).map(|(x, &d)| if d > 0.0 { x / d } else { 0.0 }).collect()
    };
    let dot = |x: &[f64], y: &[f64]| -> f64 { x.iter().zip(y).map(|(x, y)| x * y).sum() };
    let (mut solution, mut rest) = (vec![0.0; count], gains);
    let mut next = divided(&rest);
    let (mut way, mut size) = (next.clone(), dot(&rest, &next));
    let enough = RESIDUAL * RESIDUAL * size;
    for _ in 0..MAX_STEPS {
        if size <= enough {
            break;
        }
        let product = times(&way);
        let step = size / dot(&way, &product);
        for i in 0..count {
            solution[i] += step * way[i];
            rest[i] -= step * product[i];
        }
        next = divided(&rest);
        let before = std::mem::replace(&mut size, dot(&rest, &next));
        way.iter_mut().zip(&next).for_each(|(way, next)| *way = next + size / before * *way);
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Labels in a chain, each with the next one, and some with others and the background.
        #[test]
        fn labels_gain_what_they_are_to_gain(
            gains in prop::collection::vec(-1.0..1.0_f64, 2..40),
            more in prop::collection::vec((0_usize..40, 0_usize..40, 0.01..10.0_f64), 1..60),
        ) {
            let count = gains.len();
            let mut areas: BTreeMap<[usize; 2], f64> =
                (1..count).map(|id| ([id, id - 1], 1.0)).collect();
            for (a, b, area) in more {
                let (a, b) = (a % count, b % count);
                if a != b {
                    *areas.entry([a, b]).or_insert(0.0) += area;
                }
            }
            let potentials = potentials(gains.clone(), &areas);
            prop_assert_eq!(potentials[0], 0.0);
            let mut gained = vec![0.0; count];
            for (&[a, b], area) in &areas {
                gained[a] += area * (potentials[a] - potentials[b]);
                gained[b] -= area * (potentials[a] - potentials[b]);
            }
            for id in 1..count {
                prop_assert!((gained[id] - gains[id]).abs() < 1e-3, "{gained:?} is not {gains:?}");
            }
        }
    }

    #[test]
    fn what_cannot_move_gains_nothing() {
        assert_eq!(potentials(vec![0.0, 1.0], &BTreeMap::new()), [0.0, 0.0]);
        // Two that meet only each other: one gains what the other loses.
        let areas = BTreeMap::from([([1, 2], 2.0)]);
        let [_, a, b] = potentials(vec![0.0, 1.0, -1.0], &areas)[..] else { panic!() };
        assert!((a - b - 0.5).abs() < 1e-5);
    }
}
