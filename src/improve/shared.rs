//! The arrays of a mesh as several threads see them while they improve it.
//!
//! Every element is an atomic, read and written with relaxed order. That is enough: which thread
//! may touch which element is settled before the threads start (see [`blocks`](super::blocks)), and
//! they are joined before anybody reads what another one wrote.

use std::sync::atomic::{AtomicI32, AtomicU32, AtomicU64, Ordering::Relaxed};

use glam::DVec3;

use crate::memory::atomic::atomic;
use crate::memory::bits::Bits;
use crate::memory::prefetch;
use crate::mesh::{NONE, TetMesh};

/// The arrays of a mesh, for all threads.
pub(super) struct Shared<'m> {
    points: &'m [[AtomicU64; 3]],
    tets: &'m [[AtomicU32; 4]],
    neighbors: &'m [[AtomicU32; 4]],
    labels: &'m [AtomicI32],
    /// Which tets are not those that refinement made.
    changed: &'m Bits,
}

impl<'m> Shared<'m> {
    /// Shares the arrays of `mesh`, and which tets have `changed`.
    pub fn new(mesh: &'m mut TetMesh, changed: &'m Bits) -> Self {
        Self {
            points: atomic::<AtomicU64>(mesh.points.as_flattened_mut()).as_chunks().0,
            tets: atomic::<AtomicU32>(mesh.tets.as_flattened_mut()).as_chunks().0,
            neighbors: atomic::<AtomicU32>(mesh.neighbors.as_flattened_mut()).as_chunks().0,
            labels: atomic(&mut mesh.labels),
            changed,
        }
    }

    #[inline(always)]
    pub fn point(&self, v: u32) -> DVec3 {
        DVec3::from_array(
            self.points[v as usize].each_ref().map(|x| f64::from_bits(x.load(Relaxed))),
        )
    }

    pub fn set_point(&self, v: u32, p: DVec3) {
        for (to, x) in self.points[v as usize].iter().zip(p.to_array()) {
            to.store(x.to_bits(), Relaxed);
        }
    }

    /// The vertices of a tet; the first is [`NONE`] in a slot without a tet.
    #[inline(always)]
    pub fn tet(&self, t: u32) -> [u32; 4] {
        self.tets[t as usize].each_ref().map(|v| v.load(Relaxed))
    }

    #[inline(always)]
    pub fn corners(&self, vertices: [u32; 4]) -> [DVec3; 4] {
        vertices.map(|v| self.point(v))
    }

    #[inline(always)]
    pub fn label(&self, t: u32) -> i32 {
        self.labels[t as usize].load(Relaxed)
    }

    /// The tet across facet `i` of tet `t`, or [`NONE`].
    #[inline(always)]
    pub fn neighbor(&self, t: u32, i: usize) -> u32 {
        self.neighbors[t as usize][i].load(Relaxed)
    }

    pub fn set_neighbor(&self, t: u32, i: usize, neighbor: u32) {
        self.neighbors[t as usize][i].store(neighbor, Relaxed);
    }

    /// Asks for what tells of a tet.
    #[inline(always)]
    pub fn prefetch(&self, t: u32) {
        prefetch(self.tets.as_ptr().wrapping_add(t as usize));
        prefetch(self.neighbors.as_ptr().wrapping_add(t as usize));
        prefetch(self.labels.as_ptr().wrapping_add(t as usize));
    }

    /// Asks for the vertices of a tet and for the tets beside it.
    #[inline(always)]
    pub fn prefetch_around(&self, t: u32) {
        for (i, v) in self.tet(t).into_iter().enumerate() {
            prefetch(self.points.as_ptr().wrapping_add(v as usize));
            self.prefetch(self.neighbor(t, i));
        }
    }

    /// Asks for what is around tets that are looked at soon, step by step: the first tet, what is
    /// around the second one, and what is around the tets beside the third one. Each tet is the
    /// first at one call, the second at a later one and the third at one later still, so that each
    /// step finds what the step before has fetched. A neighbour that another block is just changing
    /// is no more than an address to fetch: nothing depends on it.
    #[inline(always)]
    pub fn prefetch_steps(&self, [first, second, third]: [Option<u32>; 3]) {
        if let Some(t) = first {
            self.prefetch(t);
        }
        if let Some(t) = second {
            self.prefetch_around(t);
        }
        if let Some(t) = third {
            let beside = (0..4).map(|i| self.neighbor(t, i)).filter(|&other| other != NONE);
            beside.for_each(|other| self.prefetch_around(other));
        }
    }

    /// Which facet of `t` lies between it and `neighbor`.
    pub fn facet_to(&self, t: u32, neighbor: u32) -> Option<usize> {
        (0..4).find(|&i| self.neighbor(t, i) == neighbor)
    }

    /// Puts a tet into a slot; its neighbours are to be set next.
    pub fn put(&self, t: u32, vertices: [u32; 4], label: i32) {
        for (to, v) in self.tets[t as usize].iter().zip(vertices) {
            to.store(v, Relaxed);
        }
        self.labels[t as usize].store(label, Relaxed);
        self.note_changed(t);
    }

    /// Empties a slot. Its label is that of the background then.
    pub fn free(&self, t: u32) {
        self.tets[t as usize][0].store(NONE, Relaxed);
        self.labels[t as usize].store(0, Relaxed);
    }

    /// Notes that a tet is not the one that refinement made.
    pub fn note_changed(&self, t: u32) {
        self.changed.set(t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shared_is_the_mesh() {
        let mut mesh = TetMesh {
            points: vec![[0.5, -1.0, 2.0]; 4],
            tets: vec![[0, 1, 2, 3]],
            labels: vec![-7],
            neighbors: vec![[NONE, 4, 5, 6]],
            ..TetMesh::default()
        };
        let changed = Bits::new(1, "tets").unwrap();
        let shared = Shared::new(&mut mesh, &changed);
        assert_eq!(shared.point(3), DVec3::new(0.5, -1.0, 2.0));
        assert_eq!((shared.tet(0), shared.label(0)), ([0, 1, 2, 3], -7));
        assert_eq!((shared.neighbor(0, 0), shared.facet_to(0, 6)), (NONE, Some(3)));
        shared.set_point(1, DVec3::splat(3.25));
        shared.set_neighbor(0, 2, 9);
        shared.put(0, [3, 2, 1, 0], 8);
        assert_eq!((mesh.points[1], mesh.points[2]), ([3.25; 3], [0.5, -1.0, 2.0]));
        assert_eq!(
            (mesh.tets[0], mesh.labels[0], mesh.neighbors[0]),
            ([3, 2, 1, 0], 8, [NONE, 4, 9, 6])
        );
        assert!(changed.has(0));
    }
}
