//! Volumes: labels get back what flips and moves took from them.
//!
//! A flip or move on an interface keeps within the tolerance, but takes some volume from one label
//! and gives it to another. Over many that evens out. In a small mesh, or where facets are large
//! for what they bound, it may not; nor where edges were contracted, which cuts corners. So where
//! more than [`OF_ALL`] or [`OF_LABEL`] has changed, vertices of interfaces are moved along their
//! normals in the end.
//!
//! # How far
//! Label L is to gain the volume g(L), and A(L, M) is the area between L and M. The interface
//! between them is to move from L towards M by p(L) - p(M), where p of the background is 0 and
//!
//! ```text
//! for each label L:  sum over M of A(L, M) (p(L) - p(M)) = g(L)
//! ```
//!
//! Of all distances that give each label what it is to gain, these have the least sum of squares,
//! weighted by area: p are the Lagrange multipliers. It is Laplace's equation on the graph of
//! labels, solved by conjugate gradients.
//!
//! Not all vertices can move, so less is gained than that. What is missing then is sought again. An
//! interface counts with its area times its *mobility*: the part of what it was to give that it
//! gave in the round before. So it is asked for more, and others take over what it can't give. A
//! mobility falls by [`SLOWEST`] in a round at most, and never below [`LEAST_MOBILITY`].
//!
//! # Which vertices
//! These distances are mostly below a hundredth of what a vertex may move. Where all vertices were
//! to move by so little, some of them move farther, by [`STEP`] at most, chosen by their numbers:
//! so the work grows with the volume that is missing, not with the mesh.
//!
//! A vertex stays where it is if it is on a line, or a tet around it would fall below the target,
//! or a facet below its angle.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::blocks::Blocks;
use super::measure::Measure;
use super::rounds::Run;
use super::smoothing::{Support, TO_BORDER, is_valid};
use super::star::{Collected, Star};
use super::worker::{Round, Worker};
use crate::delaunay::tet::FACET;
use crate::geometry::measures::triangle_area;
use crate::memory::{reserve, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::{Error, Result};

/// By how much the volume of the object may change, in parts of it.
const OF_ALL: f64 = 1e-4;
/// The same for a label that has so many voxels at least.
const OF_LABEL: f64 = 1e-3;
const LABEL_FROM: f64 = 1000.0;
/// Once volumes are given back, no more than this part of what may change is left.
const REST: f64 = 0.5;
/// Most rounds. What each gives back depends on how many vertices can move.
const MAX_ROUNDS: u32 = 12;
/// A vertex moves by no more than this part of the tolerance in a round.
const STEP: f64 = 0.4;
/// No fewer vertices are chosen between two labels, on average, if there are as many.
const FEWEST: f64 = 4.0;
/// Mobilities fall to this part of what they were in a round at most: what a few vertices give is
/// as good as random.
const SLOWEST: f64 = 0.4;
/// The least mobility: hardly any vertex may be able to move.
const LEAST_MOBILITY: f64 = 1.0 / 30.0;
/// Where interfaces are to move by less than this part of the tolerance they stay.
const LEAST: f64 = 1e-4;
/// The residual of the solution, in parts of what is to be gained.
const RESIDUAL: f64 = 1e-6;
/// Most steps towards it; labels are few steps from the background.
const MAX_STEPS: usize = 500;
/// Added to the diagonal, in parts of it: labels that meet only each other can't both gain.
const SHIFT: f64 = 1e-8;
/// Tets, or vertices, per piece of work.
const CHUNK: usize = 1 << 12;

/// The ids of two labels, the smaller one first.
type Pair = [u16; 2];

/// A vertex of an interface.
#[derive(Clone, Copy)]
struct Vertex {
    index: u32,
    /// One of its tets, which has an interface facet with it.
    tet: u32,
    /// Of that facet.
    pair: Pair,
}

/// A vertex that is to be moved.
#[derive(Clone, Copy)]
struct Chosen {
    /// Where it lies in this round.
    block: u32,
    vertex: Vertex,
    /// How far, from the first of the pair to the other.
    distance: f64,
}

/// The interfaces between the ids of two labels.
#[derive(Clone, Copy)]
struct Between {
    area: f64,
    /// How many vertices have their pair.
    vertices: f64,
    /// Which part of what it is to give it gives.
    mobility: f64,
    /// How far it is to move, from the first of the pair to the other.
    distance: f64,
    /// How far it was to when it last gave anything.
    last: f64,
}

impl Default for Between {
    fn default() -> Self {
        Self { area: 0.0, vertices: 0.0, mobility: 1.0, distance: 0.0, last: 0.0 }
    }
}

impl Between {
    /// What it gives for a move by 1.
    fn conductance(&self) -> f64 {
        self.area * self.mobility
    }

    /// Sets how far it is to move: by `distance` if it went on as it did, and by no more than
    /// `step`.
    fn set_distance(&mut self, mut distance: f64, step: f64) {
        // What has moved can move back.
        if distance * self.last < 0.0 {
            distance *= self.mobility;
            self.mobility = 1.0;
        }
        self.distance = distance.clamp(-step, step);
    }

    /// Notes what it has given.
    fn note_given(&mut self, given: f64) {
        let least = (SLOWEST * self.mobility).max(LEAST_MOBILITY);
        let wanted = self.area * self.distance;
        self.mobility = if wanted == 0.0 { least } else { (given / wanted).clamp(least, 1.0) };
        if given != 0.0 {
            self.last = self.distance;
        }
    }
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
        let ids = self.ids_of_tets()?;
        let vertices = vertices_of_interfaces(self.mesh, &ids)?;
        let mut interfaces = areas(self.mesh, &ids);
        for vertex in &vertices {
            interfaces.entry(vertex.pair).or_default().vertices += 1.0;
        }
        drop(ids);
        let [least, step] = [LEAST, STEP].map(|part| part * self.interfaces.tolerance);
        for _ in 0..MAX_ROUNDS {
            let Some(missing) = self.missing(volumes, REST) else { break };
            if let Err(ended) = (self.report_and_check)(0) {
                return Ok(Some(ended));
            }
            let potentials = potentials(missing, &interfaces);
            for ([a, b], between) in &mut interfaces {
                let distance = potentials[usize::from(*a)] - potentials[usize::from(*b)];
                between.set_distance(distance, step);
            }
            let of_vertices = blocks.of_vertices(self.mesh, self.rounds)?;
            self.rounds += 1;
            let mut chosen = self.choose(&vertices, &of_vertices, &interfaces)?;
            chosen.par_sort_unstable_by_key(|chosen| (chosen.block, chosen.vertex.index));
            let jobs: Vec<&[Chosen]> = chosen.chunk_by(|a, b| a.block == b.block).collect();
            let lengths = jobs.iter().map(|job| job.len());
            let done = self.side_by_side(&of_vertices, lengths, |round, job, scratch| {
                let mut worker = Worker::new(round, jobs[job][0].block, 0..0, 0..0, scratch);
                let mut given = BTreeMap::new();
                let done = worker.shift(jobs[job], &mut given);
                let (done, scratch) = worker.end(done.err());
                ((done, given), scratch)
            });
            let (mut given, mut ended) = (BTreeMap::<Pair, f64>::new(), None);
            for (done, of_block) in done {
                self.counts.add(&done.counts);
                ended = ended.or(done.error);
                of_block.into_iter().for_each(|(pair, v)| *given.entry(pair).or_default() += v);
            }
            for (pair, between) in &mut interfaces {
                if between.distance.abs() >= least {
                    between.note_given(given.get(pair).copied().unwrap_or(0.0));
                }
            }
            if ended.is_some() {
                return Ok(ended);
            }
        }
        Ok(None)
    }

    /// Those vertices that are to be moved in the next round, so that interfaces move as far as
    /// they are to.
    fn choose(
        &self,
        vertices: &[Vertex],
        of_vertices: &[u32],
        interfaces: &BTreeMap<Pair, Between>,
    ) -> Result<Vec<Chosen>> {
        let tolerance = self.interfaces.tolerance;
        // One in how many, and how far.
        let move_of = |pair: Pair| {
            let Between { vertices, mobility, distance, .. } = interfaces[&pair];
            let step = STEP * tolerance;
            let part = (distance.abs() / step).max(FEWEST / (mobility * vertices)).min(1.0);
            match distance.abs() < LEAST * tolerance {
                true => (0.0, 0.0),
                false => (part, (distance / part).clamp(-step, step)),
            }
        };
        let (mut chosen, mut last) = (Vec::new(), None);
        for &vertex in vertices {
            // Mostly that of the vertex before.
            let (part, distance) = match last {
                Some((pair, it)) if pair == vertex.pair => it,
                _ => move_of(vertex.pair),
            };
            last = Some((vertex.pair, (part, distance)));
            if at_random(vertex.index, self.rounds) < part {
                reserve(&mut chosen, 1, "vertices of interfaces")?;
                let block = of_vertices[vertex.index as usize];
                chosen.push(Chosen { block, vertex, distance });
            }
        }
        Ok(chosen)
    }

    /// What the id of each label is to gain; `None` where no more than this part of what may change
    /// has changed.
    fn missing(&self, volumes: &[f64], part: f64) -> Option<Vec<f64>> {
        let of_voxel = self.interfaces.oracle.spacing().element_product();
        let mut missing = vec![0.0; volumes.len()];
        for &(label, gained) in self.volumes.iter().chain(&self.counts.volumes) {
            if let Some(missing) = missing.get_mut(usize::from(self.interfaces.id(label))) {
                *missing -= gained;
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
        if !is_off {
            return None;
        }
        // Where all are right together, what is right alone stays.
        if all[0].abs() <= part * OF_ALL * all[1] {
            for (missing, volume) in missing.iter_mut().zip(volumes) {
                if missing.abs() <= part * OF_LABEL * volume {
                    *missing = 0.0;
                }
            }
        }
        Some(missing)
    }

    /// The id of each tet's label.
    fn ids_of_tets(&self) -> Result<Vec<u16>> {
        let mut ids = zeroed(self.mesh.tets.len(), "tets of the mesh")?;
        let pieces = ids.par_chunks_mut(CHUNK).zip(self.mesh.labels.par_chunks(CHUNK));
        pieces.for_each(|(ids, labels)| {
            let mut last = (0, 0);
            for (id, &label) in ids.iter_mut().zip(labels) {
                // Mostly that of the tet before.
                if label != last.0 {
                    last = (label, self.interfaces.id(label));
                }
                *id = last.1;
            }
        });
        Ok(ids)
    }
}

impl Worker<'_, '_> {
    /// Moves these vertices, if they can be moved; adds what the first of each pair of labels
    /// gained.
    fn shift(&mut self, chosen: &[Chosen], given: &mut BTreeMap<Pair, f64>) -> Result<()> {
        (self.round.report_and_check)(0)?;
        for &Chosen { vertex, distance, .. } in chosen {
            let Some((labels, normal)) = self.surface_at(vertex) else { continue };
            let first = self.round.interfaces.id(labels[0]);
            let distance = if first == vertex.pair[0] { distance } else { -distance };
            let (star, at) = (std::mem::take(&mut self.star), self.point(vertex.index));
            let to = at + normal * distance;
            if self.may_be(&star, at, to) {
                let support = Support::Interface { labels, normal, off: DVec3::ZERO };
                let label = self.round.interfaces.labels[usize::from(vertex.pair[0])];
                let before = self.counts.volume_of(label);
                self.move_vertex(&star, support, to);
                *given.entry(vertex.pair).or_default() += self.counts.volume_of(label) - before;
                star.tets.iter().for_each(|&t| self.round.shared.note_changed(t));
            }
            self.star = star;
        }
        Ok(())
    }

    /// The labels below and above a vertex, and the normal between them, if all around it is the
    /// block's, and only two labels meet there, in a surface that nothing holds. Its star is then
    /// at hand.
    fn surface_at(&mut self, vertex: Vertex) -> Option<([i32; 2], DVec3)> {
        let mut star = std::mem::take(&mut self.star);
        let Vertex { index, tet, .. } = vertex;
        let collected = star.collect(&self.round.shared, tet, index, |tet| self.owns(tet));
        self.star = star;
        let labels = (collected == Collected::Star).then(|| self.star.surface()).flatten()?;
        let (at, oracle) = (self.point(index), self.round.interfaces.oracle);
        let is_near_contact = [at, self.refined(index)].iter().any(|&p| oracle.is_near_contact(p));
        if is_near_contact || oracle.walls_at(at).count() > 0 {
            return None;
        }
        let areas = self.star.facets.iter().map(|facet| {
            let [p, q] = facet.others.map(|v| self.point(v) - at);
            p.cross(q)
        });
        Some((labels, areas.sum::<DVec3>().try_normalize()?))
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
            && self.distance_from_refined(star, to) <= TO_BORDER * interfaces.tolerance
            && keeps(*measure)
            && keeps(measure.last())
            && is_valid(star, to)
            && self.keeps_facets(star, to)
    }
}

/// A number from 0 to below 1 for a vertex, another one in each round, as good as random.
fn at_random(vertex: u32, round: u32) -> f64 {
    let mut bits = vertex ^ round.rotate_right(5);
    // The finalizer of MurmurHash3 (A. Appleby).
    bits = (bits ^ bits >> 16).wrapping_mul(0x85EB_CA6B);
    bits = (bits ^ bits >> 13).wrapping_mul(0xC2B2_AE35);
    f64::from(bits ^ bits >> 16) / 2.0_f64.powi(32)
}

/// The ids on the two sides of a tet's facet, if these differ and there are two sides.
fn pair_at(mesh: &TetMesh, ids: &[u16], t: usize, facet: usize) -> Option<Pair> {
    let (id, other) = (ids[t], *ids.get(mesh.neighbors[t][facet] as usize)?);
    (id != other).then_some([id.min(other), id.max(other)])
}

/// The area between the ids of each two labels.
fn areas(mesh: &TetMesh, ids: &[u16]) -> BTreeMap<Pair, Between> {
    let of_chunk = |chunk: usize| {
        let mut areas: BTreeMap<Pair, f64> = BTreeMap::new();
        for t in chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.tets.len()) {
            if mesh.tets[t][0] == NONE {
                continue;
            }
            for (facet, corners) in FACET.iter().enumerate() {
                // Each facet once.
                if let Some(pair) = pair_at(mesh, ids, t, facet)
                    && ids[t] == pair[1]
                {
                    let corners = corners.map(|i| mesh.point(mesh.tets[t][i]));
                    *areas.entry(pair).or_insert(0.0) += triangle_area(&corners);
                }
            }
        }
        areas
    };
    let chunks = mesh.tets.len().div_ceil(CHUNK);
    let of_chunks: Vec<_> = (0..chunks).into_par_iter().map(of_chunk).collect();
    let mut all: BTreeMap<Pair, Between> = BTreeMap::new();
    for (pair, area) in of_chunks.into_iter().flatten() {
        all.entry(pair).or_default().area += area;
    }
    all
}

/// The vertices of interface facets, each with the last of its tets that has such a facet there.
fn vertices_of_interfaces(mesh: &TetMesh, ids: &[u16]) -> Result<Vec<Vertex>> {
    // With 1 added: zero is none.
    let last: Vec<AtomicU32> = zeroed(mesh.points.len(), "vertices of interfaces")?;
    mesh.tets.par_iter().enumerate().with_min_len(CHUNK).for_each(|(t, tet)| {
        if tet[0] == NONE {
            return;
        }
        let is_interface = [0, 1, 2, 3].map(|facet| pair_at(mesh, ids, t, facet).is_some());
        for (i, &v) in tet.iter().enumerate() {
            if (0..4).any(|facet| facet != i && is_interface[facet]) {
                last[v as usize].fetch_max(t as u32 + 1, Relaxed);
            }
        }
    });
    let mut vertices = Vec::new();
    for (index, last) in (0..).zip(last) {
        let Some(tet) = last.into_inner().checked_sub(1) else { continue };
        let own = mesh.tets[tet as usize].iter().position(|&v| v == index);
        let mut facets = (0..4).filter(|&facet| Some(facet) != own);
        if let Some(pair) = facets.find_map(|facet| pair_at(mesh, ids, tet as usize, facet)) {
            reserve(&mut vertices, 1, "vertices of interfaces")?;
            vertices.push(Vertex { index, tet, pair });
        }
    }
    Ok(vertices)
}

/// The potentials of ids that give each what it is to gain; id 0 has 0.
fn potentials(gains: Vec<f64>, interfaces: &BTreeMap<Pair, Between>) -> Vec<f64> {
    let count = gains.len();
    let mut diagonal = vec![0.0; count];
    for (&ids, between) in interfaces {
        let conductance = (1.0 + SHIFT) * between.conductance();
        ids.into_iter().for_each(|id| diagonal[usize::from(id)] += conductance);
    }
    diagonal[0] = 0.0;
    let times = |x: &[f64]| {
        let mut product: Vec<f64> = x.iter().zip(&diagonal).map(|(x, d)| x * d).collect();
        for (ids, between) in interfaces.iter().filter(|(ids, _)| !ids.contains(&0)) {
            let [a, b] = ids.map(usize::from);
            product[a] -= between.conductance() * x[b];
            product[b] -= between.conductance() * x[a];
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

    fn of_area(area: f64) -> Between {
        Between { area, ..Between::default() }
    }

    proptest! {
        /// Labels in a chain, each with the next one, and some with others and the background.
        #[test]
        fn labels_gain_what_they_are_to_gain(
            gains in prop::collection::vec(-1.0..1.0_f64, 2..40),
            more in prop::collection::vec((0_u16..40, 0_u16..40, 0.01..10.0_f64), 1..60),
        ) {
            let count = gains.len() as u16;
            let mut areas: BTreeMap<Pair, Between> =
                (1..count).map(|id| ([id - 1, id], of_area(1.0))).collect();
            for (a, b, area) in more {
                let (a, b) = (a % count, b % count);
                if a != b {
                    areas.entry([a.min(b), a.max(b)]).or_default().area += area;
                }
            }
            let potentials = potentials(gains.clone(), &areas);
            prop_assert_eq!(potentials[0], 0.0);
            let mut gained = vec![0.0; gains.len()];
            for (ids, Between { area, .. }) in &areas {
                let [a, b] = ids.map(usize::from);
                gained[a] += area * (potentials[a] - potentials[b]);
                gained[b] -= area * (potentials[a] - potentials[b]);
            }
            for id in 1..gains.len() {
                prop_assert!((gained[id] - gains[id]).abs() < 1e-3, "{gained:?} is not {gains:?}");
            }
        }
    }

    /// An interface of which a tenth can move is asked for more and more, until it moves as far as
    /// it is to; one that can't move at all is asked for no more than the least mobility has it.
    #[test]
    fn what_hardly_moves_is_asked_for_more() {
        let mut between = of_area(2.0);
        let mut missing = 1.0;
        for _ in 0..4 {
            between.set_distance(missing / between.conductance(), 100.0);
            let given = 0.1 * between.area * between.distance;
            between.note_given(given);
            missing -= given;
        }
        assert!(missing.abs() < 1e-9, "{missing}");
        assert!((between.mobility - 0.1).abs() < 1e-9);
        // Back it may go as easily as others.
        between.set_distance(-0.5, 100.0);
        assert_eq!([between.distance, between.mobility], [-0.05, 1.0]);
        (0..9).for_each(|_| between.note_given(0.0));
        assert_eq!(between.mobility, LEAST_MOBILITY);
        // Steps that are cut short do not count as what could not be given.
        let mut between = of_area(2.0);
        between.set_distance(1.0, 0.25);
        between.note_given(0.5);
        assert_eq!([between.distance, between.mobility], [0.25, 1.0]);
    }

    #[test]
    fn what_cannot_move_gains_nothing() {
        assert_eq!(potentials(vec![0.0, 1.0], &BTreeMap::new()), [0.0, 0.0]);
        // Two that meet only each other: one gains what the other loses.
        let areas = BTreeMap::from([([1, 2], of_area(2.0))]);
        let [_, a, b] = potentials(vec![0.0, 1.0, -1.0], &areas)[..] else { panic!() };
        assert!((a - b - 0.5).abs() < 1e-5);
    }
}
