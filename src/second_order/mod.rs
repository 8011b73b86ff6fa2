//! Tets of second order: a node in the middle of every edge.
//!
//! The six edges of a tet (a, b, c, d) come in VTK's order: ab, bc, ca, ad, bd, cd. Those of a
//! facet (a, b, c): ab, bc, ca.
//!
//! Nodes are numbered behind the vertices: by the smaller vertex of their edge, then by the larger
//! one. So the numbers do not depend on the number of threads.
//!
//! Nodes stand halfway between their vertices, or, where asked for, on the interfaces of the image:
//! [`curve()`].
//!
//! Cost: four passes through the tets. Memory: [`BYTES_PER_TET`].

mod curve;
mod jacobian;

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::Result;
use crate::memory::{parts, reserve, room, zeroed};
use crate::mesh::{MidNodes, TetMesh};
use crate::monitor::Monitor;

pub use curve::{Curving, curve};

/// The vertices of the edges of a tet, in the order of their nodes.
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

/// The vertices of the edges of a facet, in the order of their nodes.
pub const FACET_EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Bytes that a tet needs at most: 24 for the numbers of its nodes, 24 while edges are numbered, 32
/// for the positions of nodes (a tet has some 1.2 edges of its own), 6 for the facets' nodes.
pub const BYTES_PER_TET: u64 = 96;

/// Tets, facets or vertices of one piece of work.
const RANGE: usize = 1 << 13;

/// What is known of the nodes of second order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SecondOrder {
    /// The nodes in the middle of edges.
    pub nodes: u64,
    /// What curving did; all is 0 without it.
    pub curving: Curving,
}

/// The other ends of the edges of each vertex that are larger than it, in increasing order.
struct Edges {
    /// The edges of vertex v are `starts[v]..starts[v + 1]`.
    starts: Vec<u32>,
    others: Vec<u32>,
}

impl Edges {
    fn new(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Self> {
        let vertices = mesh.points.len();
        // First every tet lists its edges, so that an edge stands there once for each of its tets.
        let counts: Vec<AtomicU32> = zeroed(vertices + 1, "edges of vertices")?;
        let for_each_edge = |visit: &(dyn Fn(u32, u32) + Sync)| {
            mesh.tets.par_chunks(RANGE).try_for_each(|tets| {
                monitor.advance(0)?;
                for tet in tets {
                    for [i, j] in TET_EDGES {
                        visit(tet[i].min(tet[j]), tet[i].max(tet[j]));
                    }
                }
                Ok(())
            })
        };
        // Relaxed: sums, read when all threads are done.
        for_each_edge(&|low, _| _ = counts[low as usize].fetch_add(1, Relaxed))?;
        let mut places: Vec<u64> = room(vertices + 1, "edges of vertices")?;
        let mut end = 0;
        for count in &counts {
            places.push(end);
            end += u64::from(count.swap(0, Relaxed));
        }
        let listed: Vec<AtomicU32> = zeroed(end as usize, "edges of tets")?;
        for_each_edge(&|low, high| {
            let place = counts[low as usize].fetch_add(1, Relaxed);
            listed[places[low as usize] as usize + place as usize].store(high, Relaxed);
        })?;
        drop(counts);
        let mut listed: Vec<u32> = listed.into_iter().map(AtomicU32::into_inner).collect();
        // Then they are sorted, and each stays once.
        let lengths = places.windows(2).map(|ends| (ends[1] - ends[0]) as usize);
        let lists = parts(&mut listed, lengths, "edges of vertices")?;
        let mut counted: Vec<(&mut [u32], u32)> = room(vertices, "edges of vertices")?;
        counted.extend(lists.into_iter().map(|list| (list, 0)));
        let mut lists = counted;
        drop(places);
        lists.par_chunks_mut(RANGE).try_for_each(|lists| {
            monitor.advance(0)?;
            for (list, count) in lists {
                list.sort_unstable();
                for i in 0..list.len() {
                    if i == 0 || list[i] != list[i - 1] {
                        list[*count as usize] = list[i];
                        *count += 1;
                    }
                }
            }
            Ok(())
        })?;
        let mut edges = Self { starts: room(vertices + 1, "edges")?, others: Vec::new() };
        reserve(&mut edges.others, lists.iter().map(|&(_, count)| count as usize).sum(), "edges")?;
        for (list, count) in lists {
            edges.starts.push(edges.others.len() as u32);
            edges.others.extend_from_slice(&list[..count as usize]);
        }
        edges.starts.push(edges.others.len() as u32);
        Ok(edges)
    }

    fn count(&self) -> usize {
        self.others.len()
    }

    /// The number of an edge that there is.
    fn number(&self, a: u32, b: u32) -> u32 {
        let (low, high) = (a.min(b) as usize, a.max(b));
        let from = self.starts[low];
        let others = &self.others[from as usize..self.starts[low + 1] as usize];
        from + others.partition_point(|&other| other < high) as u32
    }
}

/// Gives a mesh nodes in the middles of its edges: appends their positions to `points`, and tells
/// of each tet and facet which they are.
///
/// # Errors
/// [`LimitReached`](crate::Error::LimitReached) for more nodes than can be numbered;
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory). The mesh is
/// unchanged then.
pub fn add_mid_nodes(mesh: &mut TetMesh, monitor: &Monitor<'_>) -> Result<SecondOrder> {
    let edges = Edges::new(mesh, monitor)?;
    let vertices = mesh.points.len();
    if vertices + edges.count() >= u32::MAX as usize {
        return Err(crate::Error::LimitReached(format!(
            "{vertices} vertices and {} edges are more nodes than the 4294967294 that can be \
             numbered",
            edges.count()
        )));
    }
    let mut tets = zeroed(mesh.tets.len(), "nodes of tets")?;
    let mut facets = zeroed(mesh.facets.len(), "nodes of facets")?;
    number(&mesh.tets, &mut tets, TET_EDGES, &edges, vertices as u32, monitor)?;
    number(&mesh.facets, &mut facets, FACET_EDGES, &edges, vertices as u32, monitor)?;
    reserve(&mut mesh.points, edges.count(), "nodes")?;
    for low in 0..vertices {
        for &high in &edges.others[edges.starts[low] as usize..edges.starts[low + 1] as usize] {
            mesh.points.push(((mesh.point(low as u32) + mesh.point(high)) * 0.5).to_array());
        }
    }
    mesh.mid_nodes = Some(MidNodes { vertices, tets, facets });
    Ok(SecondOrder { nodes: edges.count() as u64, curving: Curving::default() })
}

/// Numbers the edges of elements.
fn number<const N: usize, const E: usize>(
    elements: &[[u32; N]],
    nodes: &mut [[u32; E]],
    edges_of: [[usize; 2]; E],
    edges: &Edges,
    first: u32,
    monitor: &Monitor<'_>,
) -> Result<()> {
    nodes.par_chunks_mut(RANGE).zip(elements.par_chunks(RANGE)).try_for_each(|(nodes, elements)| {
        monitor.advance(0)?;
        for (nodes, element) in nodes.iter_mut().zip(elements) {
            *nodes = edges_of.map(|[i, j]| first + edges.number(element[i], element[j]));
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_in_the_middle_and_shared() {
        // Two tets with a facet in common.
        let mut mesh = TetMesh {
            points: vec![
                [0.0; 3],
                [2.0, 0.0, 0.0],
                [0.0, 2.0, 0.0],
                [0.0, 0.0, 2.0],
                [2.0, 2.0, 2.0],
            ],
            tets: vec![[0, 1, 2, 3], [4, 2, 1, 3]],
            facets: vec![[1, 2, 3]],
            ..TetMesh::default()
        };
        let found = add_mid_nodes(&mut mesh, &Monitor::silent()).unwrap();
        assert_eq!((found.nodes, mesh.points.len()), (9, 14));
        let nodes = mesh.mid_nodes.as_ref().unwrap();
        assert_eq!(nodes.vertices, 5);
        for (tet, nodes) in mesh.tets.iter().zip(&nodes.tets) {
            for ([i, j], &node) in TET_EDGES.into_iter().zip(nodes) {
                assert_eq!(mesh.point(node), (mesh.point(tet[i]) + mesh.point(tet[j])) * 0.5);
            }
        }
        for ([i, j], &node) in FACET_EDGES.into_iter().zip(&nodes.facets[0]) {
            assert_eq!(
                mesh.point(node),
                (mesh.point(mesh.facets[0][i]) + mesh.point(mesh.facets[0][j])) * 0.5
            );
        }
        let mut all: Vec<u32> = nodes.tets.as_flattened().to_vec();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all, (5..14).collect::<Vec<_>>());
    }
}
