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
//! 4. *Tets*: a sweep over the slots writes vertices and neighbours in their new indices. Nothing
//!    of the triangulation is needed any more but the slot at hand, so the memory of each chunk can
//!    be given back behind the sweep: [`Numbered::copy_and_give_back`].
//!
//! The interface facets are listed last, when the mesh no longer changes: `facets`.
//!
//! **Background that comes last** is in the order of the slots, not of places. So its part of the
//! mesh takes memory only as the triangulation gives it back, and hardly adds to the peak.
//!
//! Work goes by ranges of tets or vertices. A pass counts by range what the next one writes, so
//! that each range knows where it starts: the mesh does not depend on the number of threads, and
//! every array gets its memory at once.
//!
//! Cost: two reads of every record, and for each kept tet eight lookups in two tables: four bytes a
//! slot, four a vertex. Beside the mesh it holds these tables, and two bytes a slot until the tets
//! have their numbers. While the triangulation is given back a second sweep, over the index of each
//! slot, gives the neighbours their places: a twentieth of the time of extraction, for 14 bytes of
//! the peak per tet.
//!
//! Thread safety: runs in the current rayon pool; nobody may operate on the triangulation
//! meanwhile.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::delaunay::tet::{NO_TAG, TetRecord, is_tet};
use crate::delaunay::triangulation::TetRecords;
use crate::delaunay::{TetId, Triangulation};
use crate::memory::aside::or_drop_aside;
use crate::memory::atomic::atomic;
use crate::memory::bits::Bits;
use crate::memory::{parts, prefetch, reserve, room, zeroed, zeroed_with_room};
use crate::monitor::{Monitor, Step};
use crate::sync::lock;

/// Tets, or vertices, of one piece of work: some hundred microseconds, between two looks at the
/// cancel flag. No longer pieces, so that threads end together.
const RANGE: usize = 1 << 13;

/// The pass over the tets fetches what a slot so many places ahead leads to.
const AHEAD: usize = 24;

/// A mesh whose background comes last, as it does before improvement, has room for one new tet, or
/// vertex, in so many: as many as improvement mostly needs. Tables that grow are copied, by one
/// thread.
const SPARE_OF: usize = 8;

/// Bytes per slot of a tet that extraction needs at most, mesh included: 36 for a kept tet, 5 for
/// the vertices (some six tets have one), 18 for the interface facets (fewer than one for two
/// tets), 4 for the order. Neighbours that are put aside take 16 more for a while, for each record
/// of 64 bytes that has been given back.
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

/// A mesh whose vertices and tets are numbered: all of it is known but the tets.
pub struct Numbered {
    /// Has points and labels.
    mesh: TetMesh,
    /// How many of its vertices, the first, belong to the object or were to be kept anyway.
    pub points_kept: usize,
    /// The index of the tet in each slot, with 1 added: 0 is none.
    tet_index: Vec<AtomicU32>,
    /// The index of each vertex of the triangulation.
    vertex_index: Vec<AtomicU32>,
}

/// Numbers what is kept of a triangulation; `order` is that of [`Triangulation::tets_by_place`].
/// `label_id` is the dense id of a tet's label, asked once for each tet; `labels` has the label of
/// each id. Id 0 is the background.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn number(
    triangulation: &Triangulation,
    order: &[TetId],
    label_id: impl Fn(TetId) -> u16 + Sync,
    labels: &[i32],
    background: Background,
    monitor: &Monitor<'_>,
) -> Result<Numbered> {
    let (ids, in_use) = keep(triangulation, label_id, background, monitor)?;
    let Vertices { index, points, points_kept } = copy_vertices(triangulation, &in_use, monitor)?;
    drop(in_use);
    let is_last = |id: u16| id == 0 && background == Background::Last;
    let by_place = |tets: &[TetId]| {
        monitor.advance(0)?;
        let ids = tets.iter().map(|&t| ids[t as usize]);
        Ok(ids.filter(|&id| id != NOT_KEPT && !is_last(id)).count())
    };
    let last = |ids: &[u16]| {
        monitor.advance(0)?;
        Ok(ids.iter().filter(|&&id| is_last(id)).count())
    };
    let ranges: Vec<Range<usize>> =
        consecutive(0, order.par_chunks(RANGE).map(by_place).collect::<Result<_>>()?);
    let first = end_of(&ranges);
    let ranges_of_last: Vec<Range<usize>> = match background {
        Background::Last => {
            consecutive(first, ids.par_chunks(RANGE).map(last).collect::<Result<_>>()?)
        }
        Background::Dropped | Background::Kept => Vec::new(),
    };
    let tet_index: Vec<AtomicU32> = zeroed(ids.len(), "slots of tets")?;
    // Those of the background that comes last are zero already, and never written.
    let count = end_of(&ranges_of_last).max(first);
    let spare = if background == Background::Last { count / SPARE_OF } else { 0 };
    let mut mesh = TetMesh {
        points,
        labels: zeroed_with_room(count, spare, "tets of the mesh")?,
        ..TetMesh::default()
    };
    let pieces = split(&mut mesh.labels[..first], &ranges)?
        .into_par_iter()
        .zip(ranges.par_iter().zip(order.par_chunks(RANGE)))
        .with_max_len(1);
    pieces.try_for_each(|(own, (indices, tets))| {
        monitor.advance(0)?;
        let tets = tets.iter().map(|&t| (t, ids[t as usize]));
        let kept = tets.filter(|&(_, id)| id != NOT_KEPT && !is_last(id));
        for ((t, id), (label, index)) in kept.zip(own.iter_mut().zip(indices.clone())) {
            *label = labels[usize::from(id)];
            tet_index[t as usize].store(index as u32 + 1, Relaxed);
        }
        Ok(())
    })?;
    let pieces =
        ranges_of_last.into_par_iter().zip(ids.par_chunks(RANGE)).zip(tet_index.par_chunks(RANGE));
    pieces.with_max_len(1).try_for_each(|((mut indices, ids), tet_index)| {
        monitor.advance(0)?;
        let last = ids.iter().zip(tet_index).filter(|&(&id, _)| is_last(id));
        for ((_, own), index) in last.zip(&mut indices) {
            own.store(index as u32 + 1, Relaxed);
        }
        Ok(())
    })?;
    Ok(Numbered { mesh, points_kept, tet_index, vertex_index: index })
}

impl Numbered {
    /// The labels of its tets.
    pub fn labels(&self) -> &[i32] {
        &self.mesh.labels
    }

    /// The mesh, without its facets, of the triangulation that was numbered, which stays.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn copy(mut self, tets: &TetRecords, monitor: &Monitor<'_>) -> Result<TetMesh> {
        monitor.enter(Step::Extract, self.slots())?;
        let mut mesh = std::mem::take(&mut self.mesh);
        mesh.tets = of_tets(&mesh)?;
        mesh.neighbors = of_tets(&mesh)?;
        let (to_tets, to_neighbors) = (column(&mut mesh.tets), column(&mut mesh.neighbors));
        let ranges = self.slots().div_ceil(RANGE);
        (0..ranges).into_par_iter().with_max_len(1).try_for_each(|range| {
            monitor.advance(RANGE)?;
            let slots = range * RANGE..((range + 1) * RANGE).min(self.slots());
            let fetch = |slot, index| {
                prefetch(&raw const to_tets[index]);
                prefetch(&raw const to_neighbors[index]);
                self.fetch_indices(tets.get(slot as TetId));
            };
            self.visit_kept(slots, fetch, |slot, index| {
                let record = tets.get(slot as TetId);
                put(&to_tets[index], self.vertices_of(record));
                put(&to_neighbors[index], self.neighbors_of(record));
            });
            Ok(())
        })?;
        Ok(mesh)
    }

    /// The same; the memory of the triangulation is given back meanwhile.
    ///
    /// A column of the mesh is all in memory soon after the sweep over the slots begins, for its
    /// order is another one. So that sweep fills one column only. Neighbours are put aside in the
    /// order of the slots, in a quarter of the memory that is given back, and get their places when
    /// the triangulation is gone.
    ///
    /// # Errors
    /// As [`Self::copy`].
    pub fn copy_and_give_back(
        mut self,
        triangulation: Triangulation,
        monitor: &Monitor<'_>,
    ) -> Result<TetMesh> {
        let (triangulation, ()) =
            or_drop_aside(triangulation, |_| monitor.enter(Step::Extract, self.slots()))?;
        let tets = triangulation.into_tets(&|| monitor.advance(0))?;
        let all = (std::mem::take(&mut self.mesh), Mutex::<Vec<Aside>>::default(), self);
        let ((mesh, ..), ()) = or_drop_aside(all, |(mesh, aside, numbered)| {
            mesh.tets = of_tets(mesh)?;
            let to = column(&mut mesh.tets);
            tets.drain(&|first, records| {
                monitor.advance(records.len())?;
                let slots = first..(first + records.len()).min(numbered.slots());
                let kept = slots.clone().filter(|&slot| numbered.index_of(slot) != NONE).count();
                let mut neighbors = room(kept, NEIGHBORS)?;
                let record = |slot: usize| &records[slot - first];
                let fetch = |slot, index| {
                    prefetch(&raw const to[index]);
                    numbered.fetch_indices(record(slot));
                };
                numbered.visit_kept(slots.clone(), fetch, |slot, index| {
                    put(&to[index], numbered.vertices_of(record(slot)));
                    neighbors.push(numbered.neighbors_of(record(slot)));
                });
                let mut aside = lock(aside);
                reserve(&mut aside, 1, NEIGHBORS)?;
                aside.push((slots, neighbors));
                Ok(())
            })?;
            mesh.neighbors = of_tets(mesh)?;
            let to = column(&mut mesh.neighbors);
            let mut aside = lock(aside);
            aside.par_iter_mut().with_max_len(1).try_for_each(|(slots, neighbors)| {
                monitor.advance(0)?;
                let mut neighbors = std::mem::take(neighbors).into_iter();
                let fetch = |_, index| prefetch(&raw const to[index]);
                numbered.visit_kept(slots.clone(), fetch, |_, index| {
                    if let Some(of_tet) = neighbors.next() {
                        put(&to[index], of_tet);
                    }
                });
                debug_assert!(neighbors.next().is_none(), "a tet has no place");
                Ok(())
            })
        })?;
        Ok(mesh)
    }

    /// How many slots there are.
    fn slots(&self) -> usize {
        self.tet_index.len()
    }

    /// Calls `visit` for each of these slots whose tet is kept, with its index; and `fetch` some
    /// slots before.
    #[inline(always)]
    fn visit_kept(
        &self,
        slots: Range<usize>,
        fetch: impl Fn(usize, usize),
        mut visit: impl FnMut(usize, usize),
    ) {
        let end = slots.end;
        for slot in slots {
            let ahead = (slot + AHEAD).min(end - 1);
            let (index, index_ahead) = (self.index_of(slot), self.index_of(ahead));
            if index_ahead != NONE {
                fetch(ahead, index_ahead as usize);
            }
            if index != NONE {
                visit(slot, index as usize);
            }
        }
    }

    /// The index of the tet in a slot, or [`NONE`]. A facet on the box names a slot far beyond all
    /// that exist.
    #[inline(always)]
    fn index_of(&self, slot: usize) -> u32 {
        // Less 1, no index is `NONE`.
        self.tet_index.get(slot).map_or(0, |index| index.load(Relaxed)).wrapping_sub(1)
    }

    /// Fetches what [`Self::vertices_of`] and [`Self::neighbors_of`] look up.
    #[inline(always)]
    fn fetch_indices(&self, record: &TetRecord) {
        for i in 0..4 {
            prefetch(self.vertex_index.as_ptr().wrapping_add(record.vertex(i) as usize));
            let beyond = record.neighbor(i).tet() as usize;
            prefetch(self.tet_index.as_ptr().wrapping_add(beyond));
        }
    }

    /// The vertices of a tet, as the mesh numbers them.
    #[inline(always)]
    fn vertices_of(&self, record: &TetRecord) -> [u32; 4] {
        record.vertices().map(|v| self.vertex_index[v as usize].load(Relaxed))
    }

    /// The neighbours of a tet, as the mesh numbers them.
    #[inline(always)]
    fn neighbors_of(&self, record: &TetRecord) -> [u32; 4] {
        [0, 1, 2, 3].map(|i| self.index_of(record.neighbor(i).tet() as usize))
    }
}

/// Some slots, and the neighbours of the tets there that are kept.
type Aside = (Range<usize>, Vec<[u32; 4]>);

/// What errors call the neighbours of all tets.
const NEIGHBORS: &str = "neighbors of tets";

/// A column of the mesh, all zeros, with as much room as its labels have.
fn of_tets(mesh: &TetMesh) -> Result<Vec<[u32; 4]>> {
    let (count, room) = (mesh.labels.len(), mesh.labels.capacity());
    zeroed_with_room(count, room - count, "tets of the mesh")
}

/// A column of the mesh, for all threads, each of which writes others of its tets.
fn column(values: &mut [[u32; 4]]) -> &[[AtomicU32; 4]] {
    atomic::<AtomicU32>(values.as_flattened_mut()).as_chunks().0
}

/// Writes what a column has of a tet.
#[inline(always)]
fn put(to: &[AtomicU32; 4], values: [u32; 4]) {
    for (to, value) in to.iter().zip(values) {
        to.store(value, Relaxed);
    }
}

/// The note on a slot without a tet of the mesh; no label's id.
const NOT_KEPT: u16 = NO_TAG;

/// The keep pass: the label id of the tet in each slot, or [`NOT_KEPT`], and which vertices are in
/// use.
fn keep(
    triangulation: &Triangulation,
    label_id: impl Fn(TetId) -> u16 + Sync,
    background: Background,
    monitor: &Monitor<'_>,
) -> Result<(Vec<u16>, InUse)> {
    let in_use = InUse::new(triangulation.vertex_bound(), background)?;
    let mut ids = zeroed(triangulation.tet_bound() as usize, "slots of tets")?;
    ids.par_chunks_mut(RANGE).enumerate().with_max_len(1).try_for_each(|(range, ids)| {
        monitor.advance(ids.len())?;
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
    Ok((ids, in_use))
}

/// Which vertices tets have that are kept.
struct InUse {
    /// Those of all tets, or only of those of the object where `last` has the others.
    first: Bits,
    /// Those of the background that comes last; empty where there is none.
    last: Bits,
}

impl InUse {
    fn new(bound: u32, background: Background) -> Result<Self> {
        let bits = || Bits::new(bound as usize, "vertices of the mesh");
        let last = if background == Background::Last { bits()? } else { Bits::default() };
        Ok(Self { first: bits()?, last })
    }

    fn note(&self, v: u32, is_last: bool) {
        if is_last { self.last.set(v) } else { self.first.set(v) }
    }

    fn is_first(&self, v: u32) -> bool {
        self.first.has(v)
    }

    fn is_last(&self, v: u32) -> bool {
        !self.last.is_empty() && self.last.has(v) && !self.is_first(v)
    }
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
    let spare = if in_use.last.is_empty() { 0 } else { order.len() / SPARE_OF };
    let mut points: Vec<[f64; 3]> = zeroed_with_room(order.len(), spare, "vertices of the mesh")?;
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

/// Ranges of these lengths, one after the other from `start`.
fn consecutive(start: usize, lengths: Vec<usize>) -> Vec<Range<usize>> {
    let mut end = start;
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

    fn check(labels: &[i32], kept: Background, threads: usize) {
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
                let numbered =
                    number(&triangulation, &order, label_id, labels, kept, &monitor).unwrap();
                let mut mesh = numbered.copy(triangulation.tets(), &monitor).unwrap();
                mesh.collect_facets(&monitor).unwrap();
                mesh
            })
        };
        let mesh = on(1);
        assert_eq!(mesh, on(3));

        let mut kept_tets: Vec<TetId> =
            order.iter().copied().filter(|&t| background || label_id(t) != 0).collect();
        if kept == Background::Last {
            // Behind the others, in the order of their slots.
            kept_tets.sort_by_key(|&t| if label_id(t) == 0 { 1 + t } else { 0 });
        }
        let numbered =
            number(&triangulation, &order, label_id, labels, kept, &Monitor::silent()).unwrap();
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
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let same = pool.install(|| {
            let mut same = numbered.copy_and_give_back(triangulation, &Monitor::silent()).unwrap();
            same.collect_facets(&Monitor::silent()).unwrap();
            same
        });
        assert_eq!(same, mesh);
    }

    #[test]
    fn every_kept_tet_and_interface_facet_is_there() {
        check(&[0, 3, 7], Background::Dropped, 1);
        check(&[0, 3, 7], Background::Kept, 3);
        check(&[0, 3, 7], Background::Last, 2);
    }

    #[test]
    fn negative_labels_come_first() {
        check(&[0, -3, 7], Background::Dropped, 1);
        check(&[0, -3, 7], Background::Kept, 3);
        check(&[0, -3, 7], Background::Last, 2);
    }
}
