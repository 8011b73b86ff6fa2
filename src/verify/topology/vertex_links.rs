//! What the boundaries of the parts of a mesh are around one vertex, and along the edges from it;
//! see `boundary_surface`.

use super::mesh_components::MeshComponents;
use crate::mesh::{NONE, TetMesh};
use crate::reduce::KeyedSums;

/// A place where the boundary of a label touches itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NonManifold {
    /// The ends of the edge, or twice the vertex.
    pub ends: [u32; 2],
    /// The label.
    pub label: i32,
}

impl NonManifold {
    /// Whether it is an edge, and not a vertex.
    pub fn is_edge(&self) -> bool {
        self.ends[0] != self.ends[1]
    }
}

/// Most tets around an edge that are gone through; a sound mesh has some ten.
const MAX_AROUND: usize = 1 << 12;

/// A vertex or edge where tets of one label touch that are not joined there as in a solid.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Touch {
    /// The part of each cone or wedge.
    pub parts: Vec<u32>,
    /// What the place adds to the characteristic of the boundary when these are taken for one union
    /// of closed tets.
    pub euler: i64,
}

/// A vertex of a facet.
#[derive(Clone, Copy)]
pub(crate) struct Corner {
    /// The facet.
    pub facet: u32,
    /// Which of its three vertices.
    pub place: usize,
}

/// The side of a facet at some edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    label: i32,
    /// Twice the place of the facet among those of the vertex, and 1 for its second side.
    node: u32,
}

/// Looks at one vertex after the other, and keeps what it finds. The tables are room to work in.
pub(crate) struct VertexLinks<'m> {
    mesh: &'m TetMesh,
    parts: &'m MeshComponents,
    /// Edges where the boundary of some label is open.
    pub open_edges: u64,
    pub non_manifold: Vec<NonManifold>,
    pub touches: Vec<Touch>,
    /// The Euler characteristic of the boundary of each part, just inside of it.
    pub euler: KeyedSums<i64>,
    /// The facets of the vertex.
    facets: Vec<u32>,
    /// The edge of each facet that is across from the vertex.
    rim: Vec<[u32; 2]>,
    /// Its edges on the interfaces, each with the place of a facet there: sorted, those of one edge
    /// beside each other.
    edges: Vec<(u32, u32)>,
    /// The sides of the facets at one edge.
    sides: Vec<Side>,
    /// Which sides are on one sheet: a forest, whose roots point to themselves.
    parents: Vec<u32>,
    /// The labels whose boundary touches itself along an edge of the vertex.
    at_edges: Vec<i32>,
    /// A side of each cycle of facets.
    tops: Vec<Side>,
    /// Tets at the vertex that are joined to each other there.
    cone: Vec<u32>,
}

impl<'m> VertexLinks<'m> {
    pub fn new(mesh: &'m TetMesh, parts: &'m MeshComponents) -> Self {
        let (facets, edges, sides, parents) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (non_manifold, touches, at_edges, tops, cone) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let euler = KeyedSums::default();
        Self {
            mesh,
            parts,
            open_edges: 0,
            non_manifold,
            touches,
            euler,
            facets,
            rim: Vec::new(),
            edges,
            sides,
            parents,
            at_edges,
            tops,
            cone,
        }
    }

    /// Counts at vertex `v`, which stands at the given corners of facets, its cycles, and the edges
    /// and facets of which it is the smallest vertex.
    pub fn look_at(&mut self, v: u32, corners: impl Iterator<Item = Corner>) {
        self.facets.clear();
        self.rim.clear();
        for Corner { facet, place } in corners {
            let vertices = self.mesh.facets[facet as usize];
            debug_assert_eq!(vertices[place], v);
            self.facets.push(facet);
            self.rim.push([vertices[(place + 1) % 3], vertices[(place + 2) % 3]]);
        }
        if !self.facets.is_empty() && !self.is_disk(v) {
            self.follow_link(v);
        }
    }

    fn label(&self, node: u32) -> i32 {
        self.mesh.facet_labels[self.facets[node as usize / 2] as usize][node as usize % 2]
    }

    /// The tet on a side; none outside of the mesh.
    fn tet(&self, node: u32) -> Option<u32> {
        let t = self.mesh.facet_tets[self.facets[node as usize / 2] as usize][node as usize % 2];
        (t != NONE).then_some(t)
    }

    fn part(&self, node: u32) -> Option<u32> {
        self.tet(node).and_then(|t| self.parts.of(t))
    }

    fn add(&mut self, node: u32, count: i64) {
        if let Some(part) = self.part(node) {
            self.euler.add(part.into(), count);
        }
    }

    /// Whether the facets around `v` are one cycle between two labels, as most are; then they are
    /// counted.
    fn is_disk(&mut self, v: u32) -> bool {
        let labels = self.mesh.facet_labels[self.facets[0] as usize];
        if self.facets.iter().any(|&f| self.mesh.facet_labels[f as usize] != labels) {
            return false;
        }
        // Each facet leads from one of its vertices to the next: those of one interface are all
        // turned the same way.
        let [first, mut end] = self.rim[0];
        let mut steps = 1;
        while end != first && steps < self.rim.len() {
            let Some(&[_, next]) = self.rim.iter().find(|step| step[0] == end) else {
                return false;
            };
            (end, steps) = (next, steps + 1);
        }
        // A way that comes to its start after as many steps as there are facets goes through all of
        // them: a second one from the same vertex would not be met.
        if end != first || steps != self.rim.len() {
            return false;
        }
        let own_edges = self.rim.iter().filter(|step| step[0] > v).count() as i64;
        let own_facets = self.rim.iter().filter(|[a, b]| *a >= v && *b >= v).count() as i64;
        for node in [0, 1] {
            self.add(node, 1 - own_edges + own_facets);
        }
        true
    }

    /// Counts where more than two labels meet, or something touches itself.
    fn follow_link(&mut self, v: u32) {
        self.edges.clear();
        for (rim, place) in self.rim.iter().zip(0..) {
            self.edges.extend(rim.map(|w| (w, place)));
        }
        self.edges.sort_unstable();
        self.parents.clear();
        self.parents.extend(0..2 * self.facets.len() as u32);
        self.at_edges.clear();
        let mut start = 0;
        while let Some(&(w, _)) = self.edges.get(start) {
            let end = start + self.edges[start..].iter().take_while(|edge| edge.0 == w).count();
            self.sides.clear();
            for e in start..end {
                let place = self.edges[e].1;
                let sides =
                    [2 * place, 2 * place + 1].map(|node| Side { label: self.label(node), node });
                self.sides.extend(sides);
            }
            self.sides.sort_unstable();
            self.follow_edge(v, w);
            start = end;
        }

        self.tops.clear();
        for node in 0..2 * self.facets.len() as u32 {
            let label = self.label(node);
            if label != 0 && self.parents[node as usize] == node {
                self.tops.push(Side { label, node });
            }
            if self.rim[node as usize / 2].iter().all(|&w| w >= v) {
                self.add(node, 1);
            }
        }
        self.tops.sort_unstable();
        let tops = std::mem::take(&mut self.tops);
        for tops in tops.chunk_by(|a, b| a.label == b.label) {
            if let &[top] = tops {
                self.add(top.node, 1);
                continue;
            }
            if !self.at_edges.contains(&tops[0].label) {
                self.non_manifold.push(NonManifold { ends: [v; 2], label: tops[0].label });
            }
            self.cone.clear();
            // The parts of the cones, and the characteristic of what the solid just inside of the
            // tets has around `v`.
            let (mut parts, mut around) = (Vec::new(), 0);
            for top in tops {
                // The first cycle of a cone makes a disk, each further one a hole in it.
                let Some(t) = self.tet(top.node) else { continue };
                if self.cone.contains(&t) {
                    self.add(top.node, -1);
                    around -= 1;
                } else {
                    self.add(top.node, 1);
                    around += 1;
                    self.gather_cone(v, top.node);
                    parts.extend(self.parts.of(t));
                }
            }
            if !parts.is_empty() {
                self.touches.push(Touch { parts, euler: 2 * (1 - around) });
            }
        }
        self.tops = tops;
    }

    /// Adds the tets that are joined to that at the side `node` across facets at `v`, all of its
    /// label.
    fn gather_cone(&mut self, v: u32, node: u32) {
        let mesh = self.mesh;
        let label = self.label(node);
        let mut next = self.cone.len();
        self.cone.extend(self.tet(node));
        while next < self.cone.len().min(MAX_AROUND) {
            let t = self.cone[next] as usize;
            for (&across, &opposite) in mesh.neighbors[t].iter().zip(&mesh.tets[t]) {
                let is_same =
                    opposite != v && across != NONE && mesh.labels[across as usize] == label;
                if is_same && !self.cone.contains(&across) {
                    self.cone.push(across);
                }
            }
            next += 1;
        }
    }

    /// Joins the sheets across the edge from `v` to `w`, whose sides are listed, and counts the
    /// edge if `v` is its smaller vertex.
    fn follow_edge(&mut self, v: u32, w: u32) {
        let sides = std::mem::take(&mut self.sides);
        let own = v < w;
        let mut is_open = false;
        for sides in sides.chunk_by(|a, b| a.label == b.label) {
            is_open |= sides.len() % 2 == 1;
            let (label, first) = (sides[0].label, sides[0].node);
            if label == 0 {
                continue;
            }
            if let &[one, other] = sides {
                join(&mut self.parents, one.node, other.node);
                if own {
                    self.add(first, -1);
                }
                continue;
            }
            self.at_edges.push(label);
            if own && sides.len() > 2 {
                self.non_manifold.push(NonManifold { ends: [v, w], label });
            }
            let mut wedges = Vec::new();
            for side in sides {
                let other = self.beyond(side.node, v, w).and_then(|x| {
                    sides.iter().find(|other| {
                        other.node != side.node && self.third(other.node, v, w) == Some(x)
                    })
                });
                if let Some(other) = other {
                    join(&mut self.parents, side.node, other.node);
                }
                // Each pair once.
                if own && other.is_none_or(|other| side.node < other.node) {
                    self.add(side.node, -1);
                    wedges.extend(self.part(side.node));
                }
            }
            if wedges.len() > 1 {
                let euler = 2 * (wedges.len() as i64 - 1);
                self.touches.push(Touch { parts: wedges, euler });
            }
        }
        self.open_edges += u64::from(own && is_open);
        self.sides = sides;
    }

    /// The vertex of a facet besides `v` and `w`.
    fn third(&self, node: u32, v: u32, w: u32) -> Option<u32> {
        self.mesh.facets[self.facets[node as usize / 2] as usize]
            .into_iter()
            .find(|&x| x != v && x != w)
    }

    /// Goes around the edge from `v` to `w`, from tet to tet of one label, from this side of a
    /// facet to the next facet of the label's boundary; its third vertex.
    fn beyond(&self, node: u32, v: u32, w: u32) -> Option<u32> {
        let mesh = self.mesh;
        let mut t = self.tet(node)?;
        let mut x = self.third(node, v, w)?;
        let label = self.label(node);
        for _ in 0..MAX_AROUND {
            let tet = &mesh.tets[t as usize];
            let y = tet.iter().copied().find(|y| ![v, w, x].contains(y))?;
            let across = mesh.neighbors[t as usize][tet.iter().position(|&z| z == x)?];
            if across == NONE || mesh.labels[across as usize] != label {
                return Some(y);
            }
            (t, x) = (across, y);
        }
        None
    }
}

/// Joins the trees of `x` and `y`.
fn join(parents: &mut [u32], x: u32, y: u32) {
    let root = |mut x: u32| {
        while parents[x as usize] != x {
            x = parents[x as usize];
        }
        x
    };
    let (x, y) = (root(x), root(y));
    parents[x.max(y) as usize] = x.min(y);
}
