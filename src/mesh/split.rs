//! Interfaces split: regions get nodes of their own there, for contact and cohesive elements.
//!
//! Around a node there are the regions whose tets have it. Two of them stay together at the node if
//! a facet that is not cut, with the node, lies between them, or a chain of such facets: so where
//! only some of the interfaces around a line are cut, the line is where the cut ends, and its nodes
//! stay one. Of the groups of regions that are left, that of the smallest label keeps the node,
//! each other one gets a copy.
//!
//! A facet whose nodes all stay one is not cut. A facet that was cut becomes two, one for each
//! side, each with its own label first; their tets are no neighbours any more. All else stays as it
//! was. The certificate of the mesh speaks of the mesh before.
//!
//! Cost: a pass over the elements, and a sort of the nodes on cut facets with their regions. The
//! result does not depend on the number of threads.

use std::collections::BTreeSet;

use super::{MidNodes, NONE, TetMesh};
use crate::memory::{filled, reserve, room};
use crate::monitor::Monitor;
use crate::reduce::UnionFind;
use crate::{Error, Result};

/// Elements between two looks at the cancel flag.
const CHUNK: usize = 1 << 12;

/// What is counted where there is no memory.
const WHAT: &str = "nodes of split interfaces";

/// Which interfaces are split.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Split {
    /// All between two regions.
    All,
    /// Those of these pairs of labels, in any order.
    Pairs(BTreeSet<[i32; 2]>),
}

impl Split {
    /// Pairs of labels.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for a label with itself.
    pub fn pairs(pairs: &[[i32; 2]]) -> Result<Self> {
        if let Some([label, _]) = pairs.iter().find(|[a, b]| a == b) {
            return Err(Error::InvalidArgument(format!(
                "label {label} has no interface with itself that could be split"
            )));
        }
        Ok(Self::Pairs(pairs.iter().map(|&pair| sorted(pair)).collect()))
    }

    fn has(&self, pair: [i32; 2]) -> bool {
        match self {
            Self::All => true,
            Self::Pairs(pairs) => pairs.contains(&sorted(pair)),
        }
    }
}

fn sorted([a, b]: [i32; 2]) -> [i32; 2] {
    [a.min(b), a.max(b)]
}

/// A mesh with split interfaces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplitMesh {
    /// The mesh.
    pub mesh: TetMesh,
    /// Each node that was made, behind the one that it is a copy of.
    pub pairs: Vec<[u32; 2]>,
}

impl TetMesh {
    /// The mesh with some of its interfaces split; vertices that were made stand behind the others.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for a pair of labels that do not meet; [`Error::LimitReached`]
    /// for too many nodes; [`Error::Cancelled`]; [`Error::OutOfMemory`].
    pub fn split(&self, split: &Split, monitor: &Monitor<'_>) -> Result<SplitMesh> {
        let cuts: Vec<bool> = (0..self.facets.len())
            .map(|f| {
                let labels = self.facet_labels[f];
                // The background is no region, even where it was kept.
                !self.facet_tets[f].contains(&NONE) && !labels.contains(&0) && split.has(labels)
            })
            .collect();
        if let Split::Pairs(pairs) = split {
            let met: BTreeSet<[i32; 2]> = (0..self.facets.len())
                .filter(|&f| cuts[f])
                .map(|f| sorted(self.facet_labels[f]))
                .collect();
            if let Some([a, b]) = pairs.iter().find(|pair| !met.contains(*pair)) {
                return Err(Error::InvalidArgument(format!(
                    "labels {a} and {b} have no interface that could be split"
                )));
            }
        }
        let sides = Sides::new(self, &cuts, monitor)?;
        // Where other regions hold all nodes of a facet together there is no gap.
        let cuts: Vec<bool> =
            cuts.into_iter().enumerate().map(|(f, is_cut)| is_cut && sides.part(self, f)).collect();
        sides.apply(self, &cuts, monitor)
    }
}

/// The regions around the nodes of cut facets.
struct Sides {
    /// Each such node with each region around it, in increasing order.
    entries: Vec<(u32, i32)>,
    /// The node of each entry in the new mesh.
    nodes: Vec<u32>,
    /// For each new node, which entry it was made for.
    made: Vec<u32>,
    /// How many of these are vertices: the first ones.
    vertices: usize,
    /// Where the entries of each node begin, or [`NONE`] for one on no cut facet.
    starts: Vec<u32>,
}

impl Sides {
    fn new(mesh: &TetMesh, cuts: &[bool], monitor: &Monitor<'_>) -> Result<Self> {
        let mut starts = filled(mesh.points.len(), NONE, WHAT, || Ok(()))?;
        for (f, _) in cuts.iter().enumerate().filter(|&(_, &is_cut)| is_cut) {
            mesh.nodes_of_facet(f as u32).for_each(|node| starts[node as usize] = 0);
        }
        let mut entries: Vec<(u32, i32)> = Vec::new();
        for t in 0..mesh.tets.len() {
            if t.is_multiple_of(CHUNK) {
                monitor.advance(0)?;
            }
            for node in mesh.nodes_of_tet(t as u32).filter(|&node| starts[node as usize] != NONE) {
                reserve(&mut entries, 1, WHAT)?;
                entries.push((node, mesh.labels[t]));
            }
        }
        entries.sort_unstable();
        entries.dedup();
        for (i, &(node, _)) in entries.iter().enumerate().rev() {
            starts[node as usize] = i as u32;
        }
        let mut sides = Self { entries, nodes: Vec::new(), made: Vec::new(), vertices: 0, starts };
        sides.number(mesh, cuts, monitor)?;
        Ok(sides)
    }

    /// The entry of a node on cut facets and of a region around it.
    fn entry(&self, node: u32, label: i32) -> Option<usize> {
        let start = self.starts[node as usize];
        let mut of_node = (start != NONE)
            .then(|| self.entries[start as usize..].iter().zip(start as usize..))?
            .take_while(|((other, _), _)| *other == node);
        of_node.find(|((_, other), _)| *other == label).map(|(_, entry)| entry)
    }

    /// Whether the sides of a cut facet have different nodes.
    fn part(&self, mesh: &TetMesh, f: usize) -> bool {
        let [first, second] = mesh.facet_labels[f];
        let node_of = |node, label| self.entry(node, label).map(|entry| self.nodes[entry]);
        mesh.nodes_of_facet(f as u32).any(|node| node_of(node, first) != node_of(node, second))
    }

    /// Puts regions together that stay so at a node, and numbers the nodes of the new mesh.
    fn number(&mut self, mesh: &TetMesh, cuts: &[bool], monitor: &Monitor<'_>) -> Result<()> {
        let sets = UnionFind::new(self.entries.len(), WHAT)?;
        for (f, &is_cut) in cuts.iter().enumerate() {
            if f.is_multiple_of(CHUNK) {
                monitor.advance(0)?;
            }
            let [first, second] = mesh.facet_labels[f];
            for node in mesh.nodes_of_facet(f as u32).filter(|_| !is_cut) {
                let both = (self.entry(node, first), self.entry(node, second));
                if let (Some(one), Some(other)) = both {
                    sets.join(one as u32, other as u32);
                }
            }
        }
        // Roots are smallest entries, so that of the smallest label comes first.
        let is_copy = |entry: usize| {
            let (node, _) = self.entries[entry];
            sets.root(entry as u32) == entry as u32 && self.starts[node as usize] != entry as u32
        };
        let made: Vec<u32> =
            (0..self.entries.len()).filter(|&entry| is_copy(entry)).map(|e| e as u32).collect();
        let count = mesh.vertex_count();
        let is_vertex = |entry: u32| (self.entries[entry as usize].0 as usize) < count;
        let vertices = made.partition_point(|&entry| is_vertex(entry));
        if mesh.points.len() + made.len() >= NONE as usize {
            return Err(Error::LimitReached(format!(
                "{} nodes are too many after interfaces were split",
                mesh.points.len() + made.len()
            )));
        }
        let mut nodes: Vec<u32> = room(self.entries.len(), WHAT)?;
        for (entry, &(node, _)) in self.entries.iter().enumerate() {
            let root = sets.root(entry as u32);
            let place = |node: u32| moved(node, count, vertices);
            nodes.push(match made.binary_search(&root) {
                // Vertices stand behind vertices, nodes on edges behind all.
                Ok(copy) if copy < vertices => (count + copy) as u32,
                Ok(copy) => (mesh.points.len() + copy) as u32,
                Err(_) => place(node),
            });
        }
        (self.nodes, self.made, self.vertices) = (nodes, made, vertices);
        Ok(())
    }

    /// The new mesh.
    fn apply(&self, mesh: &TetMesh, cuts: &[bool], monitor: &Monitor<'_>) -> Result<SplitMesh> {
        let count = mesh.vertex_count();
        let node_of = |node: u32, label: i32| {
            let known = self.entry(node, label).map(|entry| self.nodes[entry]);
            known.unwrap_or_else(|| moved(node, count, self.vertices))
        };
        let mut points: Vec<[f64; 3]> = room(mesh.points.len() + self.made.len(), WHAT)?;
        let copies = |made: &[u32]| {
            let originals = made.iter().map(|&entry| self.entries[entry as usize].0);
            originals.map(|node| mesh.points[node as usize]).collect::<Vec<_>>()
        };
        points.extend_from_slice(&mesh.points[..count]);
        points.extend(copies(&self.made[..self.vertices]));
        points.extend_from_slice(&mesh.points[count..]);
        points.extend(copies(&self.made[self.vertices..]));

        let mut tets: Vec<[u32; 4]> = room(mesh.tets.len(), WHAT)?;
        let mut of_tets: Vec<[u32; 6]> = Vec::new();
        for (t, (tet, &label)) in mesh.tets.iter().zip(&mesh.labels).enumerate() {
            if t.is_multiple_of(CHUNK) {
                monitor.advance(0)?;
            }
            tets.push(tet.map(|v| node_of(v, label)));
            if let Some(nodes) = &mesh.mid_nodes {
                reserve(&mut of_tets, 1, WHAT)?;
                of_tets.push(nodes.tets[t].map(|node| node_of(node, label)));
            }
        }
        let mut neighbors = room(mesh.neighbors.len(), WHAT)?;
        neighbors.extend_from_slice(&mesh.neighbors);
        let cut_count = cuts.iter().filter(|&&is_cut| is_cut).count();
        let facet_count = mesh.facets.len() + cut_count;
        let mut split = TetMesh {
            points,
            tets,
            labels: mesh.labels.clone(),
            neighbors,
            facets: room(facet_count, WHAT)?,
            facet_labels: room(facet_count, WHAT)?,
            facet_tets: room(facet_count, WHAT)?,
            facet_walls: mesh.facet_walls.clone(),
            mid_nodes: None,
        };
        let mut of_facets: Vec<[u32; 3]> = Vec::new();
        // Each facet with its first side; behind them, of those that were cut, the second.
        for (f, &is_cut) in cuts.iter().enumerate() {
            let ([first, second], [tet, other]) = (mesh.facet_labels[f], mesh.facet_tets[f]);
            // Background that was not kept has no nodes.
            let side = if tet == NONE { second } else { first };
            split.facets.push(mesh.facets[f].map(|v| node_of(v, side)));
            split.facet_labels.push([first, second]);
            split.facet_tets.push(if is_cut { [tet, NONE] } else { [tet, other] });
            if let Some(nodes) = &mesh.mid_nodes {
                of_facets.push(nodes.facets[f].map(|node| node_of(node, side)));
            }
        }
        for f in (0..cuts.len()).filter(|&f| cuts[f]) {
            let ([first, second], [tet, other]) = (mesh.facet_labels[f], mesh.facet_tets[f]);
            let [a, b, c] = mesh.facets[f].map(|v| node_of(v, second));
            split.facets.push([a, c, b]);
            split.facet_labels.push([second, first]);
            split.facet_tets.push([other, NONE]);
            if !split.facet_walls.is_empty() {
                split.facet_walls.push(mesh.facet_wall(f));
            }
            if let Some(nodes) = &mesh.mid_nodes {
                let [ab, bc, ca] = nodes.facets[f].map(|node| node_of(node, second));
                of_facets.push([ca, bc, ab]);
            }
            for (here, there) in [(tet, other), (other, tet)] {
                let sides = split.neighbors[here as usize].iter_mut();
                sides.filter(|side| **side == there).for_each(|side| *side = NONE);
            }
        }
        split.mid_nodes = mesh.mid_nodes.as_ref().map(|_| MidNodes {
            vertices: count + self.vertices,
            tets: of_tets,
            facets: of_facets,
        });
        let pairs = self.made.iter().map(|&entry| {
            let (node, _) = self.entries[entry as usize];
            [moved(node, count, self.vertices), self.nodes[entry as usize]]
        });
        Ok(SplitMesh { mesh: split, pairs: pairs.collect() })
    }
}

/// Where an old node stands: nodes on edges make room for so many new vertices.
fn moved(node: u32, count: usize, vertices: usize) -> u32 {
    if (node as usize) < count { node } else { node + vertices as u32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing::{connect, kuhn_box};
    use crate::second_order::add_mid_nodes;

    /// Four columns around a line, of labels 1 to 4; 1 and 4 meet along the line alone.
    fn columns() -> TetMesh {
        kuhn_box([2, 2, 3], [1.0; 3], |i, j, _| [[1, 2], [3, 4]][j][i])
    }

    fn check(mesh: &TetMesh, split: &Split) -> SplitMesh {
        let found = mesh.split(split, &Monitor::silent()).unwrap();
        let SplitMesh { mesh: after, pairs } = &found;
        assert_eq!(after.tets.len(), mesh.tets.len());
        // What was made stands where it was copied from, and is used.
        for &[old, new] in pairs {
            assert_eq!(after.points[old as usize], after.points[new as usize]);
        }
        let mut used = vec![false; after.points.len()];
        for t in 0..after.tets.len() as u32 {
            for (new, old) in after.nodes_of_tet(t).zip(mesh.nodes_of_tet(t)) {
                used[new as usize] = true;
                assert_eq!(after.points[new as usize], mesh.points[old as usize]);
            }
        }
        assert!(used.iter().all(|&used| used));
        // Neighbours and facets are those that the new tets have, found anew.
        let mut anew = TetMesh {
            points: after.points.clone(),
            tets: after.tets.clone(),
            labels: after.labels.clone(),
            ..TetMesh::default()
        };
        connect(&mut anew);
        assert_eq!(after.neighbors, anew.neighbors);
        let rotated = |mesh: &TetMesh| {
            let mut all: Vec<_> = mesh
                .facets
                .iter()
                .zip(&mesh.facet_tets)
                .map(|(&[a, b, c], tets)| {
                    let least = a.min(b).min(c);
                    let facet = [[a, b, c], [b, c, a], [c, a, b]].into_iter();
                    (facet.filter(|facet| facet[0] == least).collect::<Vec<_>>(), *tets)
                })
                .collect();
            all.sort();
            all
        };
        assert_eq!(rotated(after), rotated(&anew));
        found
    }

    #[test]
    fn all_regions_have_their_own_nodes() {
        let mesh = columns();
        let found = check(&mesh, &Split::All);
        // Four columns of 2 x 2 x 4 nodes each.
        assert_eq!(found.mesh.points.len(), 4 * 16);
        assert_eq!(found.pairs.len(), 4 * 16 - 36);
        assert_eq!(found.mesh.facets.len(), 4 * 2 * (2 + 4 * 3));
        assert!(found.mesh.facet_labels.contains(&[2, 1]));
    }

    #[test]
    fn a_cut_ends_where_other_regions_hold_together() {
        let mesh = columns();
        // Between 1 and 2 alone: along the line in the middle 3 and 4 hold both.
        let found = check(&mesh, &Split::pairs(&[[2, 1]]).unwrap());
        assert_eq!(found.pairs.len(), 4);
        // Round about 1: it comes loose.
        let found = check(&mesh, &Split::pairs(&[[1, 2], [3, 1]]).unwrap());
        assert_eq!(found.pairs.len(), 3 * 4);
        for wrong in [[1, 1], [1, 4], [1, 9]] {
            let split = Split::pairs(&[wrong]);
            let result = split.and_then(|split| mesh.split(&split, &Monitor::silent()));
            assert!(matches!(result, Err(Error::InvalidArgument(_))), "{wrong:?}");
        }
    }

    #[test]
    fn facets_that_others_hold_are_not_cut() {
        // In the middle of label 3 a tet of label 1, and one of label 2 beside it.
        let mut mesh = kuhn_box([3, 3, 3], [1.0; 3], |_, _, _| 3);
        let tet = 6 * 13;
        let other = mesh.neighbors[tet].into_iter().find(|&other| other != NONE).unwrap();
        (mesh.labels[tet], mesh.labels[other as usize]) = (1, 2);
        connect(&mut mesh);
        let found = check(&mesh, &Split::pairs(&[[1, 2]]).unwrap());
        assert_eq!((found.pairs.len(), &found.mesh), (0, &mesh));
    }

    #[test]
    fn the_background_is_no_region() {
        let mesh = kuhn_box([3, 1, 1], [1.0; 3], |i, _, _| [0, 1, 2][i]);
        let found = check(&mesh, &Split::All);
        assert_eq!(found.pairs.len(), 4);
        let split = Split::pairs(&[[0, 1]]).unwrap();
        assert!(mesh.split(&split, &Monitor::silent()).is_err());
    }

    #[test]
    fn nodes_on_edges_are_split_as_well() {
        let mut mesh = columns();
        add_mid_nodes(&mut mesh, &Monitor::silent()).unwrap();
        let found = mesh.split(&Split::All, &Monitor::silent()).unwrap();
        let nodes = found.mesh.mid_nodes.as_ref().unwrap();
        assert_eq!(nodes.vertices, 64);
        // Each node on an edge is in its middle.
        for (tet, of_edges) in found.mesh.tets.iter().zip(&nodes.tets) {
            let [a, b, c, d] = *tet;
            let edges = [[a, b], [b, c], [c, a], [a, d], [b, d], [c, d]];
            for ([a, b], &node) in edges.into_iter().zip(of_edges) {
                let middle = (found.mesh.point(a) + found.mesh.point(b)) / 2.0;
                assert_eq!(middle, found.mesh.point(node));
            }
        }
        for (facet, of_edges) in found.mesh.facets.iter().zip(&nodes.facets) {
            let [a, b, c] = *facet;
            for ([a, b], &node) in [[a, b], [b, c], [c, a]].into_iter().zip(of_edges) {
                let middle = (found.mesh.point(a) + found.mesh.point(b)) / 2.0;
                assert_eq!(middle, found.mesh.point(node));
            }
        }
        // No region has a node of another's.
        let mut owners = vec![None; found.mesh.points.len()];
        for t in 0..found.mesh.tets.len() as u32 {
            for node in found.mesh.nodes_of_tet(t) {
                let label = found.mesh.labels[t as usize];
                assert_eq!(*owners[node as usize].get_or_insert(label), label);
            }
        }
    }
}
