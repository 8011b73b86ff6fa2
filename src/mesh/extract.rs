//! From the triangulation to the finished mesh: the tets whose circumcenter lies in the object,
//! each with the label there.
//!
//! Tets and vertices come in the order of their places (`delaunay::spatial_order`), facets in that
//! of the tets that list them: what is near in space is mostly near in the arrays, which whoever
//! goes through them profits from, the certificate first of all. Vertices of no kept tet are left
//! out.
//!
//! # Passes
//! 1. *Keep*: a sweep over the slots notes the label ids of the tets that are kept, and the
//!    vertices in use.
//! 2. *Vertices*: those in use are numbered and copied.
//! 3. *Number*: the tets get their indices and labels.
//! 4. *Tets*: a sweep in the order of places writes vertices and neighbours in their new indices.
//!
//! The interface facets are listed last, when the mesh no longer changes: `facets`.
//!
//! Work goes by ranges of tets or vertices. A pass counts by range what the next one writes, so
//! that each range knows where it starts: the mesh does not depend on the number of threads, and
//! every array gets its memory at once, touched first by the thread that fills it.
//!
//! Cost: two reads of every record, and for each kept tet eight lookups in two tables: four bytes a
//! slot, four a vertex. Beside the mesh it holds these tables and two bytes a slot.
//!
//! Thread safety: runs in the current rayon pool; nobody may operate on the triangulation
//! meanwhile.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::TetMesh;
use crate::Result;
use crate::delaunay::check::{AHEAD, AHEAD_AROUND};
use crate::delaunay::tet::{NO_TAG, is_tet};
use crate::delaunay::{TetId, Triangulation};
use crate::memory::{parts, prefetch, reserve, zeroed};
use crate::monitor::Monitor;

/// Tets, or vertices, of one piece of work: some hundred microseconds, between two looks at the
/// cancel flag. No longer pieces, so that threads end together.
const RANGE: usize = 1 << 13;

/// Bytes per slot of a tet that extraction needs at most, mesh included: 36 for a kept tet, 5 for
/// the vertices (some six tets have one), 18 for the interface facets (fewer than one for two
/// tets), 4 for the order.
pub const BYTES_PER_SLOT: u64 = 64;

/// What becomes of tets of the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// They are left out.
    Dropped,
    /// They are kept, where their places are.
    Kept,
    /// They are kept behind the tets of the object, and the vertices that they alone have behind
    /// the others, so that they can be dropped later: `TetMesh::finish`.
    Last,
}

/// A mesh without its interface facets.
pub struct Extracted {
    /// The mesh.
    pub mesh: TetMesh,
    /// How many of its vertices, the first, belong to the object or were to be kept anyway.
    pub points_kept: usize,
}

/// Collects the mesh, in the `order` of [`Triangulation::tets_by_place`], which has the object
/// first afterwards where the background comes last. `label_id` is the dense id of a tet's label,
/// asked once for each tet; `labels` has the label of each id. Id 0 is the background.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn extract(
    triangulation: &Triangulation,
    order: &mut Vec<TetId>,
    label_id: impl Fn(TetId) -> u16 + Sync,
    labels: &[i32],
    background: Background,
    monitor: &Monitor<'_>,
) -> Result<Extracted> {
    let (kept, in_use) = Kept::new(triangulation, order, label_id, background, monitor)?;
    let Vertices { index, points, points_kept } = copy_vertices(triangulation, &in_use, monitor)?;
    drop(in_use);
    let mut mesh = TetMesh { points, ..TetMesh::default() };
    let tet_index = kept.number(labels, &mut mesh, monitor)?;
    copy_tets(&kept, &tet_index, &index, &mut mesh, monitor)?;
    Ok(Extracted { mesh, points_kept })
}

/// What becomes of the tets.
struct Kept<'o> {
    triangulation: &'o Triangulation,
    order: &'o [TetId],
    /// The label id of the tet in each slot, or [`NOT_KEPT`].
    ids: Vec<u16>,
    /// The indices in the mesh of the tets in each [`RANGE`] of the order.
    ranges: Vec<Range<usize>>,
}

/// The note on a slot without a tet of the mesh; no label's id.
const NOT_KEPT: u16 = NO_TAG;

impl<'o> Kept<'o> {
    /// The keep pass. Returns besides which vertices are in use.
    fn new(
        triangulation: &'o Triangulation,
        order: &'o mut Vec<TetId>,
        label_id: impl Fn(TetId) -> u16 + Sync,
        background: Background,
        monitor: &Monitor<'_>,
    ) -> Result<(Self, InUse)> {
        let in_use = InUse::new(triangulation.vertex_bound(), background)?;
        let mut ids = zeroed(triangulation.tet_bound() as usize, "slots of tets")?;
        ids.par_chunks_mut(RANGE).enumerate().with_max_len(1).try_for_each(|(range, ids)| {
            monitor.advance(ids.len() / 2)?;
            for (id, t) in ids.iter_mut().zip((range * RANGE) as TetId..) {
                *id = NOT_KEPT;
                triangulation.prefetch_next(t);
                let vertices = triangulation.tet(t).vertices();
                if !is_tet(vertices) {
                    continue;
                }
                let label = label_id(t);
                if label == 0 && background == Background::Dropped {
                    continue;
                }
                *id = label;
                let is_last = label == 0 && background == Background::Last;
                vertices.into_iter().for_each(|v| in_use.note(v, is_last));
            }
            Ok(())
        })?;
        if background == Background::Last {
            object_first(order, &ids, monitor)?;
        }
        let order: &[TetId] = order;
        let kept = |tets: &[TetId]| {
            monitor.advance(0)?;
            Ok(tets.iter().filter(|&&t| ids[t as usize] != NOT_KEPT).count())
        };
        let ranges =
            consecutive(order.par_chunks(RANGE).with_max_len(1).map(kept).collect::<Result<_>>()?);
        Ok((Self { triangulation, order, ids, ranges }, in_use))
    }

    /// The tets of a range that are kept, each with its label id, and the tets that are to be
    /// fetched meanwhile: one, and what another one leads to.
    fn of_range(&self, range: usize) -> impl Iterator<Item = (TetId, u16, [TetId; 2])> {
        let tets = &self.order[range * RANGE..((range + 1) * RANGE).min(self.order.len())];
        let ahead = move |i: usize| {
            [AHEAD, AHEAD_AROUND].map(|ahead| tets[(i + ahead).min(tets.len() - 1)])
        };
        let tets = tets.iter().enumerate().map(move |(i, &t)| (t, self.ids[t as usize], ahead(i)));
        tets.filter(|&(_, id, _)| id != NOT_KEPT)
    }

    /// The number pass: fills in the labels. Returns the index of the tet in each slot, [`NONE`]
    /// where none is kept.
    fn number(
        &self,
        labels: &[i32],
        mesh: &mut TetMesh,
        monitor: &Monitor<'_>,
    ) -> Result<Vec<AtomicU32>> {
        // What is zero stands for none, so indices are kept with 1 added.
        let tet_index: Vec<AtomicU32> = zeroed(self.ids.len(), "slots of tets")?;
        mesh.labels = zeroed(end_of(&self.ranges), "tets of the mesh")?;
        let pieces = split(&mut mesh.labels, &self.ranges)?
            .into_par_iter()
            .zip(&self.ranges)
            .enumerate()
            .with_max_len(1);
        pieces.try_for_each(|(range, (own, indices))| {
            monitor.advance(0)?;
            for (((t, id, _), label), index) in self.of_range(range).zip(own).zip(indices.clone()) {
                *label = labels[usize::from(id)];
                tet_index[t as usize].store(index as u32 + 1, Relaxed);
            }
            Ok(())
        })?;
        Ok(tet_index)
    }
}

/// Puts the tets of the object first; otherwise they stay in the same order.
fn object_first(order: &mut Vec<TetId>, ids: &[u16], monitor: &Monitor<'_>) -> Result<()> {
    let mut last: Vec<TetId> = Vec::new();
    let mut first = 0;
    for from in (0..order.len()).step_by(RANGE) {
        monitor.advance(0)?;
        reserve(&mut last, RANGE, "tets of the background")?;
        for at in from..(from + RANGE).min(order.len()) {
            let t = order[at];
            if ids[t as usize] == 0 {
                last.push(t);
            } else {
                order[first] = t;
                first += 1;
            }
        }
    }
    order.truncate(first);
    // There is room: all came from here.
    order.append(&mut last);
    Ok(())
}

/// Which vertices tets have that are kept: a bit for each.
struct InUse {
    /// Those of all tets, or only of those of the object where `last` has the others.
    first: Vec<AtomicU32>,
    /// Those of the background that comes last; empty where there is none.
    last: Vec<AtomicU32>,
}

impl InUse {
    fn new(bound: u32, background: Background) -> Result<Self> {
        let words = bound.div_ceil(u32::BITS) as usize;
        let last = if background == Background::Last { words } else { 0 };
        Ok(Self {
            first: zeroed(words, "vertices of the mesh")?,
            last: zeroed(last, "vertices of the mesh")?,
        })
    }

    fn note(&self, v: u32, is_last: bool) {
        let bits = if is_last { &self.last } else { &self.first };
        let (word, bit): (&AtomicU32, u32) =
            (&bits[(v / u32::BITS) as usize], 1 << (v % u32::BITS));
        // Most are in use already: looking first spares the locked operation.
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
    }

    fn is_first(&self, v: u32) -> bool {
        has_bit(&self.first, v)
    }

    fn is_last(&self, v: u32) -> bool {
        !self.last.is_empty() && has_bit(&self.last, v) && !self.is_first(v)
    }
}

fn has_bit(bits: &[AtomicU32], v: u32) -> bool {
    bits[(v / u32::BITS) as usize].load(Relaxed) >> (v % u32::BITS) & 1 == 1
}

/// The vertices of the mesh.
struct Vertices {
    /// The index of each vertex of the triangulation.
    index: Vec<AtomicU32>,
    /// The positions in this order.
    points: Vec<[f64; 3]>,
    /// How many come before those of the background that comes last.
    points_kept: usize,
}

/// The vertex pass.
fn copy_vertices(
    triangulation: &Triangulation,
    in_use: &InUse,
    monitor: &Monitor<'_>,
) -> Result<Vertices> {
    let mut order =
        triangulation.vertices_by_place(|v| in_use.is_first(v), || monitor.advance(0))?;
    let points_kept = order.len();
    if !in_use.last.is_empty() {
        let last = triangulation.vertices_by_place(|v| in_use.is_last(v), || monitor.advance(0))?;
        reserve(&mut order, last.len(), "vertices of the mesh")?;
        order.extend(last);
    }
    let index: Vec<AtomicU32> =
        zeroed(triangulation.vertex_bound() as usize, "vertices of the mesh")?;
    let mut points: Vec<[f64; 3]> = zeroed(order.len(), "vertices of the mesh")?;
    order
        .par_chunks(RANGE)
        .zip(points.par_chunks_mut(RANGE))
        .enumerate()
        .with_max_len(1)
        .try_for_each(|(range, (vertices, points))| {
            monitor.advance(0)?;
            for ((&v, point), new) in vertices.iter().zip(points).zip((range * RANGE) as u32..) {
                index[v as usize].store(new, Relaxed);
                *point = triangulation.position(v).to_array();
            }
            Ok(())
        })?;
    Ok(Vertices { index, points, points_kept })
}

/// What the tet pass fills in: four vertices, or four neighbours, of each tet of a range.
type Fours<'a> = &'a mut [[u32; 4]];

/// The tet pass: fills in vertices and neighbours.
fn copy_tets(
    kept: &Kept<'_>,
    tet_index: &[AtomicU32],
    vertex_index: &[AtomicU32],
    mesh: &mut TetMesh,
    monitor: &Monitor<'_>,
) -> Result<()> {
    let count = end_of(&kept.ranges);
    mesh.tets = zeroed(count, "tets of the mesh")?;
    mesh.neighbors = zeroed(count, "tets of the mesh")?;
    let copy = |(range, (tets, neighbors)): (usize, (Fours<'_>, Fours<'_>))| {
        monitor.advance(RANGE / 2)?;
        for ((t, _, [far, near]), (vertices, neighbors)) in
            kept.of_range(range).zip(tets.iter_mut().zip(neighbors))
        {
            kept.triangulation.prefetch(far);
            let record = kept.triangulation.tet(near);
            for i in 0..4 {
                prefetch(vertex_index.as_ptr().wrapping_add(record.vertex(i) as usize));
                prefetch(tet_index.as_ptr().wrapping_add(record.neighbor(i).tet() as usize));
            }
            let record = kept.triangulation.tet(t);
            *vertices = record.vertices().map(|v| vertex_index[v as usize].load(Relaxed));
            // A facet on the box names a slot far beyond all that exist. Less 1, 0 becomes `NONE`.
            let index_of = |slot: TetId| {
                tet_index.get(slot as usize).map_or(0, |index| index.load(Relaxed)).wrapping_sub(1)
            };
            *neighbors = [0, 1, 2, 3].map(|i| index_of(record.neighbor(i).tet()));
        }
        Ok(())
    };
    let pieces = split(&mut mesh.tets, &kept.ranges)?
        .into_par_iter()
        .zip(split(&mut mesh.neighbors, &kept.ranges)?);
    pieces.enumerate().with_max_len(1).try_for_each(copy)
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
fn split<'v, T>(values: &'v mut [T], ranges: &[Range<usize>]) -> Result<Vec<&'v mut [T]>> {
    parts(values, ranges.iter().map(Range::len), "ranges of tets")
}

#[cfg(test)]
mod tests {
    use super::super::NONE;
    use super::*;
    use crate::delaunay::{Insertion, Removal, Solo, VertexKind, Worker};
    use glam::DVec3;
    use std::collections::HashMap;

    /// Some ranges of slots: thousands of points, of which some are removed, so that slots in
    /// between are free.
    fn triangulation() -> Triangulation {
        let triangulation = Triangulation::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut worker = Worker::new(Solo, 0);
        let mut state = 1_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        let mut start = 0;
        for i in 0..4000 {
            let p = DVec3::new(random(), random(), random());
            start = triangulation.locate(start, p);
            let inserted = worker.insert(&triangulation, start, p, VertexKind::Free).unwrap();
            let Insertion::Done(v) = inserted else { panic!("{inserted:?}") };
            if i % 5 == 4 {
                assert_eq!(worker.remove(&triangulation, v - 2).unwrap(), Removal::Done);
            }
            start = worker.created()[0];
        }
        assert!(triangulation.tet_bound() as usize > 3 * RANGE);
        triangulation
    }

    fn check(labels: &[i32], kept: Background) {
        let background = kept != Background::Dropped;
        let triangulation = triangulation();
        let label_id = |t| {
            let center = triangulation.tet(t).sphere().center;
            if center.distance(DVec3::splat(0.5)) > 0.4 { 0 } else { 1 + u16::from(center.x > 0.5) }
        };
        let order = triangulation.tets_by_place(|| Ok(())).unwrap();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let monitor = Monitor::silent();
                let mut order = order.clone();
                let mut mesh =
                    extract(&triangulation, &mut order, label_id, labels, kept, &monitor)
                        .unwrap()
                        .mesh;
                mesh.collect_facets(&monitor).unwrap();
                mesh
            })
        };
        let mesh = on(1);
        assert_eq!(mesh, on(3));

        let mut kept_tets: Vec<TetId> =
            order.iter().copied().filter(|&t| background || label_id(t) != 0).collect();
        if kept == Background::Last {
            kept_tets.sort_by_key(|&t| label_id(t) == 0);
        }
        let kept = kept_tets;
        let index: HashMap<TetId, u32> = kept.iter().zip(0..).map(|(&t, i)| (t, i)).collect();
        assert_eq!(mesh.tets.len(), kept.len());
        let mut facets = 0;
        for (k, &t) in kept.iter().enumerate() {
            let record = triangulation.tet(t);
            let label = labels[usize::from(label_id(t))];
            assert_eq!(mesh.labels[k], label);
            assert_eq!(
                mesh.tets[k].map(|v| mesh.point(v)),
                triangulation.corners(record.vertices())
            );
            for i in 0..4 {
                let neighbor = record.neighbor(i);
                let beyond =
                    if neighbor.is_none() { None } else { index.get(&neighbor.tet()).copied() };
                assert_eq!(mesh.neighbors[k][i], beyond.unwrap_or(NONE));
                let other = beyond.map_or(0, |n| mesh.labels[n as usize]);
                facets += usize::from(label != 0 && (other == 0 || label < other));
            }
        }
        assert_eq!(mesh.facets.len(), facets);
        for (f, &[a, b, c]) in mesh.facets.iter().enumerate() {
            let [a, b, c] = [a, b, c].map(|v| mesh.point(v));
            let [first, second] = mesh.facet_labels[f];
            assert!(first != 0 && (second == 0 || first < second));
            for (side, t) in mesh.facet_tets[f].into_iter().enumerate().filter(|&(_, t)| t != NONE)
            {
                assert_eq!(mesh.facet_labels[f][side], mesh.labels[t as usize]);
                let center = mesh.tets[t as usize]
                    .iter()
                    .fold(DVec3::ZERO, |sum, &v| sum + mesh.point(v) * 0.25);
                assert_eq!((b - a).cross(c - a).dot(center - a) > 0.0, side == 1);
            }
        }
    }

    #[test]
    fn every_kept_tet_and_interface_facet_is_there() {
        check(&[0, 3, 7], Background::Dropped);
        check(&[0, 3, 7], Background::Kept);
        check(&[0, 3, 7], Background::Last);
    }

    #[test]
    fn negative_labels_come_first() {
        check(&[0, -3, 7], Background::Dropped);
        check(&[0, -3, 7], Background::Kept);
        check(&[0, -3, 7], Background::Last);
    }
}
