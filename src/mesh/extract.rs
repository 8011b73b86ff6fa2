//! From the triangulation to the finished mesh: the tets whose circumcenter lies in the object, each with the label there.
//!
//! Vertices keep the order in which they were inserted, tets that of their slots, facets that of the tets that list them; vertices of no kept tet are
//! left out.
//!
//! # Passes
//! 1. *Keep*: a sweep over the tets notes which are kept, their label ids, and the vertices in use.
//! 2. *Vertices*: those in use are numbered and copied.
//! 3. *Tets*: a second sweep writes vertices and neighbours in their new indices, and lists the interface facets.
//! 4. *Facets*: those that were listed are written.
//!
//! Work goes by ranges of slots or vertices. A pass counts by range what the next one writes, so that each range knows where it starts: the mesh does not
//! depend on the number of threads, and every array gets its memory at once, touched first by the thread that fills it.
//!
//! Cost: two reads of every record, and for each kept tet eight lookups anywhere in two tables: four bytes a slot, four a vertex. On one thread a third
//! of the time is the system's, for the pages of the new arrays. Beside the mesh it holds the tables, the first of which goes before the facets come,
//! and four to eight bytes an interface facet.
//!
//! Thread safety: runs in the current rayon pool; nobody may operate on the triangulation meanwhile.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::tet::{FACET, Facet, is_tet};
use crate::delaunay::{TetId, Triangulation};
use crate::memory::{reserve, zeroed};
use crate::monitor::Monitor;

/// Slots, or vertices, of one piece of work: some hundred microseconds, between two looks at the cancel flag.
const RANGE: usize = 1 << 13;

/// Slots whose tets are copied step by step, in the first-level cache.
const BLOCK: usize = 64;

/// A sweep asks for records this many slots ahead: the processor does not look beyond pages, nor far enough while other misses keep it waiting.
const AHEAD: u32 = 64;

/// Bytes per slot of a tet that extraction needs at most, mesh included: 36 for a kept tet, 5 for the vertices (some six tets have
/// one), 18 for the interface facets (fewer than one for two tets).
pub const BYTES_PER_SLOT: u64 = 60;

/// Collects the mesh. `label_id` is the dense id of a tet's label, asked once for each tet; `labels` has the label of each id. Id 0 is the background,
/// whose tets are left out unless `background`.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn extract(
    triangulation: &Triangulation,
    label_id: impl Fn(TetId) -> u16 + Sync,
    labels: &[i32],
    background: bool,
    monitor: &Monitor<'_>,
) -> Result<TetMesh> {
    let (slots, in_use) = Slots::new(triangulation, label_id, background, monitor)?;
    let (vertex_index, points) = copy_vertices(triangulation, &in_use, monitor)?;
    drop(in_use);
    let mut mesh = TetMesh { points, ..TetMesh::default() };
    let listed = copy_tets(triangulation, &slots, &vertex_index, &mut mesh, monitor)?;
    drop(vertex_index);
    mesh.labels = slots.labels(labels, monitor)?;
    drop(slots);
    copy_facets(&mut mesh, &listed, monitor)?;
    Ok(mesh)
}

/// What becomes of the tet in each slot.
struct Slots {
    /// Low half: the place of the tet among those kept in its [`RANGE`] of slots, or [`NOT_KEPT`]. High half: its label id, 0 where none is kept.
    notes: Vec<u32>,
    /// The indices in the mesh of the tets in each range.
    ranges: Vec<Range<usize>>,
}

/// The note on a slot without a tet of the mesh; as a place, none in a range.
const NOT_KEPT: u32 = 0xFFFF;
const _: () = assert!(RANGE < NOT_KEPT as usize);

impl Slots {
    /// The keep pass. Returns besides which vertices are in use, a bit for each.
    fn new(
        triangulation: &Triangulation,
        label_id: impl Fn(TetId) -> u16 + Sync,
        background: bool,
        monitor: &Monitor<'_>,
    ) -> Result<(Self, Vec<AtomicU32>)> {
        let words = triangulation.vertex_bound().div_ceil(u32::BITS) as usize;
        let in_use: Vec<AtomicU32> = zeroed(words, "vertices of the mesh")?;
        let mut notes = zeroed(triangulation.tet_bound() as usize, "slots of tets")?;
        let keep = |(range, notes): (usize, &mut [u32])| {
            monitor.advance(notes.len() / 2)?;
            let mut kept = 0;
            for (slot, note) in notes.iter_mut().enumerate() {
                *note = NOT_KEPT;
                let t = (range * RANGE + slot) as TetId;
                triangulation.prefetch(t + AHEAD);
                let vertices = triangulation.tet(t).vertices();
                if !is_tet(vertices) {
                    continue;
                }
                let id = label_id(t);
                if id == 0 && !background {
                    continue;
                }
                *note = u32::from(id) << 16 | kept;
                kept += 1;
                for v in vertices {
                    let (word, bit): (&AtomicU32, u32) = (&in_use[(v / u32::BITS) as usize], 1 << (v % u32::BITS));
                    // Most are in use already: looking first spares the locked operation.
                    if word.load(Relaxed) & bit == 0 {
                        word.fetch_or(bit, Relaxed);
                    }
                }
            }
            Ok(kept as usize)
        };
        let kept = notes.par_chunks_mut(RANGE).enumerate().map(keep).collect::<Result<_>>()?;
        Ok((Self { notes, ranges: consecutive(kept) }, in_use))
    }

    /// The labels of the mesh's tets.
    fn labels(&self, labels: &[i32], monitor: &Monitor<'_>) -> Result<Vec<i32>> {
        let mut list = zeroed(end_of(&self.ranges), "tets of the mesh")?;
        let pieces = split(&mut list, &self.ranges).into_par_iter().zip(self.notes.par_chunks(RANGE));
        pieces.try_for_each(|(list, notes)| {
            monitor.check_cancelled()?;
            let kept = notes.iter().filter(|&note| note & NOT_KEPT != NOT_KEPT);
            list.iter_mut().zip(kept).for_each(|(label, note)| *label = labels[(note >> 16) as usize]);
            Ok(())
        })?;
        Ok(list)
    }
}

/// The vertex pass: the new index of each vertex, and the positions in their order.
fn copy_vertices(
    triangulation: &Triangulation,
    in_use: &[AtomicU32],
    monitor: &Monitor<'_>,
) -> Result<(Vec<u32>, Vec<[f64; 3]>)> {
    const BITS: usize = u32::BITS as usize;
    let count = |words: &[AtomicU32]| words.iter().map(|word| word.load(Relaxed).count_ones() as usize).sum();
    let ranges = consecutive(in_use.par_chunks(RANGE / BITS).map(count).collect());
    let mut index: Vec<u32> = zeroed(in_use.len() * BITS, "vertices of the mesh")?;
    let mut points = zeroed(end_of(&ranges), "vertices of the mesh")?;
    let pieces = index.par_chunks_mut(RANGE).zip(split(&mut points, &ranges)).zip(&ranges).enumerate();
    pieces.try_for_each(|(at, ((index, points), range))| {
        monitor.check_cancelled()?;
        let first = at * RANGE;
        let is_in_use = |v: &usize| in_use[(first + v) / BITS].load(Relaxed) >> (v % BITS) & 1 == 1;
        for (k, (v, point)) in (0..index.len()).filter(is_in_use).zip(points).enumerate() {
            index[v] = (range.start + k) as u32;
            *point = triangulation.position((first + v) as u32).to_array();
        }
        Ok(())
    })?;
    Ok((index, points))
}

/// What the tet pass fills in: four vertices, or four neighbours, of each tet of a range.
type Fours<'a> = &'a mut [[u32; 4]];

/// The tet pass: fills in vertices and neighbours. Returns the interface facets of each range of tets.
fn copy_tets(
    triangulation: &Triangulation,
    slots: &Slots,
    vertex_index: &[u32],
    mesh: &mut TetMesh,
    monitor: &Monitor<'_>,
) -> Result<Vec<Vec<Facet>>> {
    let count = end_of(&slots.ranges);
    mesh.tets = zeroed(count, "tets of the mesh")?;
    mesh.neighbors = zeroed(count, "tets of the mesh")?;
    let copy = |(range, (mut tets, mut neighbors)): (usize, (Fours<'_>, Fours<'_>))| {
        monitor.advance(RANGE / 2)?;
        let mut listed = Vec::new();
        let mut index = slots.ranges[range].start as u32;
        for first in (range * RANGE..(range + 1) * RANGE).step_by(BLOCK) {
            // Each step is a loop of its own: in a short one the processor has many lookups under way at once.
            let mut ids = [0; BLOCK];
            let mut kept = 0;
            for (slot, &note) in (first..).zip(&slots.notes[first..first + BLOCK]) {
                triangulation.prefetch(slot as TetId + AHEAD);
                if note & NOT_KEPT != NOT_KEPT {
                    let record = triangulation.tet(slot as TetId);
                    tets[kept] = record.vertices();
                    neighbors[kept] = [0, 1, 2, 3].map(|i| record.neighbor(i).tet());
                    ids[kept] = note >> 16;
                    kept += 1;
                }
            }
            let tets = tets.split_off_mut(..kept).expect("the range holds its tets");
            let neighbors = neighbors.split_off_mut(..kept).expect("the range holds its tets");
            for v in tets.as_flattened_mut() {
                *v = vertex_index[*v as usize];
            }
            let mut notes = [[NOT_KEPT; 4]; BLOCK];
            for (note, &slot) in notes.as_flattened_mut().iter_mut().zip(neighbors.as_flattened()) {
                // A facet on the box names a slot far beyond all that exist.
                *note = slots.notes.get(slot as usize).copied().unwrap_or(NOT_KEPT);
            }
            let mut facets = [Facet::NONE; 4 * BLOCK];
            let mut count = 0;
            for ((neighbors, notes), id) in neighbors.iter_mut().zip(notes).zip(ids) {
                for i in 0..4 {
                    let (place, other) = (notes[i] & NOT_KEPT, notes[i] >> 16);
                    let start = slots.ranges.get(neighbors[i] as usize / RANGE).map_or(0, |range| range.start as u32);
                    neighbors[i] = if place == NOT_KEPT { NONE } else { start + place };
                    // Each interface facet once: from its tet with the larger id. What is not kept has id 0, and so has what lies outside of the box: in
                    // a finished refinement nothing else lies along it, but a partial mesh may reach it. No branch, for it could not be foreseen.
                    facets[count] = Facet::new(index, i);
                    count += usize::from(id > other);
                }
                index += 1;
            }
            reserve(&mut listed, count, "interface facets of the mesh")?;
            listed.extend_from_slice(&facets[..count]);
        }
        Ok(listed)
    };
    let pieces = split(&mut mesh.tets, &slots.ranges).into_par_iter().zip(split(&mut mesh.neighbors, &slots.ranges));
    pieces.enumerate().map(copy).collect()
}

/// The facet pass: the interface facets, from the side with the larger label to that with the smaller one.
fn copy_facets(mesh: &mut TetMesh, listed: &[Vec<Facet>], monitor: &Monitor<'_>) -> Result<()> {
    let ranges = consecutive(listed.iter().map(Vec::len).collect());
    let count = end_of(&ranges);
    mesh.facets = zeroed(count, "interface facets of the mesh")?;
    mesh.facet_labels = zeroed(count, "interface facets of the mesh")?;
    mesh.facet_tets = zeroed(count, "interface facets of the mesh")?;
    let (tets, neighbors, labels) = (&mesh.tets, &mesh.neighbors, &mesh.labels);
    let pieces = split(&mut mesh.facets, &ranges)
        .into_par_iter()
        .zip(split(&mut mesh.facet_labels, &ranges))
        .zip(split(&mut mesh.facet_tets, &ranges))
        .zip(listed);
    pieces.try_for_each(|(((facets, facet_labels), facet_tets), listed)| {
        monitor.advance(0)?;
        for (k, facet) in listed.iter().enumerate() {
            let (t, i) = (facet.tet(), facet.index());
            let other = neighbors[t as usize][i];
            let (here, there) = (labels[t as usize], if other == NONE { 0 } else { labels[other as usize] });
            let [a, b, c] = FACET[i].map(|j| tets[t as usize][j]);
            // FACET's normals point into the tet.
            (facets[k], facet_labels[k], facet_tets[k]) = if here > there {
                ([a, c, b], [here, there], [t, other])
            } else {
                ([a, b, c], [there, here], [other, t])
            };
        }
        Ok(())
    })
}

/// Ranges of these lengths, one after the other from 0.
fn consecutive(lengths: Vec<usize>) -> Vec<Range<usize>> {
    let mut end = 0;
    let next = |length| {
        end += length;
        end - length..end
    };
    lengths.into_iter().map(next).collect()
}

/// Where consecutive ranges end.
fn end_of(ranges: &[Range<usize>]) -> usize {
    ranges.last().map_or(0, |last| last.end)
}

/// Splits `values` at consecutive ranges that cover them.
fn split<'v, T>(mut values: &'v mut [T], ranges: &[Range<usize>]) -> Vec<&'v mut [T]> {
    ranges.iter().map(|range| values.split_off_mut(..range.len()).expect("the ranges cover the values")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delaunay::{Solo, VertexKind, Worker};
    use glam::DVec3;
    use std::collections::HashMap;

    /// Some ranges of slots: thousands of points, of which some are removed, so that slots in between are free.
    fn triangulation() -> Triangulation {
        let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut worker = Worker::new(Solo, 0);
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        let mut start = 0;
        for i in 0..4000 {
            let p = DVec3::new(random(), random(), random());
            start = triangulation.locate(start, p);
            worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
            if i % 5 == 4 {
                worker.remove(&triangulation, 8 + i - 2).unwrap();
            }
            start = worker.created()[0];
        }
        assert!(triangulation.tet_bound() as usize > 3 * RANGE);
        triangulation
    }

    fn check(labels: &[i32], background: bool) {
        let triangulation = triangulation();
        let label_id = |t| {
            let center = triangulation.tet(t).sphere().center;
            if center.distance(DVec3::splat(0.5)) > 0.4 { 0 } else { 1 + u16::from(center.x > 0.5) }
        };
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| extract(&triangulation, label_id, labels, background, &Monitor::silent()).unwrap())
        };
        let mesh = on(1);
        assert_eq!(mesh, on(3));

        let kept: Vec<TetId> = triangulation.living_tets().filter(|&t| background || label_id(t) != 0).collect();
        let index: HashMap<TetId, u32> = kept.iter().zip(0..).map(|(&t, i)| (t, i)).collect();
        assert_eq!(mesh.tets.len(), kept.len());
        let mut facets = 0;
        for (k, &t) in kept.iter().enumerate() {
            let record = triangulation.tet(t);
            let label = labels[usize::from(label_id(t))];
            assert_eq!(mesh.labels[k], label);
            assert_eq!(mesh.tets[k].map(|v| mesh.point(v)), triangulation.corners(record.vertices()));
            for i in 0..4 {
                let neighbor = record.neighbor(i);
                let beyond = if neighbor.is_none() { None } else { index.get(&neighbor.tet()).copied() };
                assert_eq!(mesh.neighbors[k][i], beyond.unwrap_or(NONE));
                facets += usize::from(label > beyond.map_or(0, |n| mesh.labels[n as usize]));
                facets += usize::from(label < 0 && beyond.is_none());
            }
        }
        assert_eq!(mesh.facets.len(), facets);
        for (f, &[a, b, c]) in mesh.facets.iter().enumerate() {
            let [a, b, c] = [a, b, c].map(|v| mesh.point(v));
            assert!(mesh.facet_labels[f][0] > mesh.facet_labels[f][1]);
            for (side, t) in mesh.facet_tets[f].into_iter().enumerate().filter(|&(_, t)| t != NONE) {
                assert_eq!(mesh.facet_labels[f][side], mesh.labels[t as usize]);
                let center = mesh.tets[t as usize].iter().fold(DVec3::ZERO, |sum, &v| sum + mesh.point(v) * 0.25);
                assert_eq!((b - a).cross(c - a).dot(center - a) > 0.0, side == 1);
            }
        }
    }

    #[test]
    fn every_kept_tet_and_interface_facet_is_there() {
        check(&[0, 3, 7], false);
        check(&[0, 3, 7], true);
    }

    #[test]
    fn negative_labels_lie_below_the_background() {
        check(&[0, -3, 7], false);
        check(&[0, -3, 7], true);
    }
}
