//! The surfaces that bound the components of a mesh: their Euler characteristic, and where they touch themselves.
//!
//! The boundary of a component is taken as a closed surface that lies just inside of it: so it is one whatever touches, and its Euler characteristic is 2 - 2 * (genus)
//! for each of its parts. It is counted on the boundary facets, V - E + F. At an edge the surface passes once through each wedge of the component's tets;
//! which of its facets bound one wedge is found
//! out, where there are more than two, by going around the edge from tet to tet. At a vertex the component's facets form cycles, *umbrellas*; where the
//! tets there are joined across their facets at the vertex to a cone with n umbrellas, the surface passes through it as a disk with n - 1 holes, which counts
//! 2 - n: mostly 1.
//!
//! **Touching.** The union of a component's closed tets is another solid: there wedges that meet in an edge are one, cones that meet in a vertex too, and so is a cone with several umbrellas around its vertex. Its
//! characteristic, twice V - E + F - T, is that of the boundary, and at each such vertex 2 (1 - c), at each such edge 2 (c - 1) more: c is the characteristic of what the solid just inside of the tets has around there, 2 - n
//! for a cone with n umbrellas and 1 for a wedge. These places are listed: [`Touch`].
//!
//! A place where a label's boundary is no surface is a *pinch*: an edge with more than two of its facets, or a vertex, at no such edge, with more than one
//! umbrella. An edge where the boundary of a label (0 included) has an odd number of facets is *open*: the boundary of a union of tets has none.
//!
//! Deterministic whatever the number of threads; parallel in the current rayon pool. Facets are gathered by vertex with a counting sort: linear in them.

use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};

use rayon::prelude::*;

use super::ledger::{Ledger, Sums};
use super::mesh_components::MeshComponents;
use super::{NONE, TetMesh};
use crate::Result;
use crate::memory::zeroed;
use crate::monitor::Monitor;

/// Facets, or vertices, per work item.
const CHUNK: usize = 1 << 12;

/// Most tets around an edge that are gone through; a sound mesh has some ten.
const MOST_AROUND: usize = 1 << 12;

/// A place where the boundary of a label touches itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pinch {
    /// The ends of the edge, or twice the vertex.
    pub ends: [u32; 2],
    /// The label.
    pub label: i32,
}

impl Pinch {
    /// Whether it is an edge, and not a vertex.
    pub fn is_edge(&self) -> bool {
        self.ends[0] != self.ends[1]
    }
}

/// A vertex or edge where tets of one label touch that are not joined there as in a solid.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Touch {
    /// Whether it is an edge, and not a vertex.
    pub is_edge: bool,
    /// The component of each cone or wedge, and its characteristic just inside of the tets.
    pub parts: Vec<(u32, i64)>,
}

impl Touch {
    /// What it adds to the characteristic when the components that `belongs` names are taken for one union of closed tets.
    pub fn of_union(&self, belongs: impl Fn(u32) -> bool) -> i64 {
        let own = || self.parts.iter().filter(|&&(component, _)| belongs(component));
        let beyond = 2 * (1 - own().map(|&(_, euler)| euler).sum::<i64>());
        match own().next() {
            None => 0,
            Some(_) if self.is_edge => -beyond,
            Some(_) => beyond,
        }
    }
}

/// What is measured on the boundaries of components.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheets {
    /// Edges where the boundary of some label is open.
    pub open_edges: u64,
    /// The Euler characteristic of each component's boundary.
    pub euler: Vec<i64>,
    /// In the order of their vertices.
    pub pinches: Vec<Pinch>,
    /// Sorted.
    pub touches: Vec<Touch>,
}

impl Sheets {
    /// Measures the boundaries of all components.
    ///
    /// # Errors
    /// [`Cancelled`](crate::Error::Cancelled), [`OutOfMemory`](crate::Error::OutOfMemory).
    pub(super) fn measure(mesh: &TetMesh, components: &MeshComponents, monitor: &Monitor<'_>) -> Result<Self> {
        let (ends, stars) = facets_of_vertices(mesh, monitor)?;
        let measure = |chunk: usize| {
            monitor.advance(CHUNK)?;
            let mut umbrellas = Umbrellas::new(mesh, components);
            let mut start = if chunk == 0 { 0 } else { ends[chunk * CHUNK - 1].load(Relaxed) };
            for v in chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.points.len()) {
                let end = ends[v].load(Relaxed);
                if start < end {
                    umbrellas.look_at(v as u32, stars[start..end].iter().map(|facet| facet.load(Relaxed)));
                }
                start = end;
            }
            let Umbrellas { open_edges, pinches, touches, euler, .. } = umbrellas;
            Ok((Self { open_edges, pinches, touches, ..Self::default() }, euler.sums()))
        };
        let chunks = (0..mesh.points.len().div_ceil(CHUNK)).into_par_iter();
        let pieces: Vec<(Self, Sums<i64>)> = chunks.map(measure).collect::<Result<_>>()?;
        let mut sheets = Self { euler: vec![0; components.list.len()], ..Self::default() };
        for (piece, euler) in pieces {
            sheets.open_edges += piece.open_edges;
            sheets.pinches.extend(piece.pinches);
            sheets.touches.extend(piece.touches);
            euler.into_iter().for_each(|(component, part)| sheets.euler[component as usize] += part);
        }
        // Around one vertex they come in no particular order.
        sheets.pinches.sort_unstable();
        sheets.touches.iter_mut().for_each(|touch| touch.parts.sort_unstable());
        sheets.touches.sort_unstable();
        Ok(sheets)
    }
}

/// The facets of each vertex, where those of each vertex end.
fn facets_of_vertices(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<(Vec<AtomicUsize>, Vec<AtomicU32>)> {
    let mut ends: Vec<AtomicUsize> = zeroed(mesh.points.len() + 1, "vertices")?;
    mesh.facets.par_chunks(CHUNK).try_for_each(|facets| {
        monitor.advance(facets.len())?;
        facets.as_flattened().iter().for_each(|&v| _ = ends[v as usize + 1].fetch_add(1, Relaxed));
        Ok(())
    })?;
    let mut end = 0;
    for part in ends.chunks_mut(CHUNK) {
        monitor.check_cancelled()?;
        for count in part {
            end += *count.get_mut();
            *count.get_mut() = end;
        }
    }
    // `ends[v]` grows from the start of v's part to its end; who comes first does not matter to what is made of them.
    let stars: Vec<AtomicU32> = zeroed(3 * mesh.facets.len(), "facets of vertices")?;
    mesh.facets.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, facets)| {
        monitor.advance(facets.len())?;
        for (facet, f) in facets.iter().zip((chunk * CHUNK) as u32..) {
            for &v in facet {
                stars[ends[v as usize].fetch_add(1, Relaxed)].store(f, Relaxed);
            }
        }
        Ok(())
    })?;
    Ok((ends, stars))
}

/// The side of a facet at some edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    label: i32,
    /// Twice the place of the facet among those of the vertex, and 1 for its second side.
    node: u32,
}

/// Looks at one vertex after the other, and keeps what it finds. The tables are room to work in.
struct Umbrellas<'m> {
    mesh: &'m TetMesh,
    components: &'m MeshComponents,
    open_edges: u64,
    pinches: Vec<Pinch>,
    touches: Vec<Touch>,
    euler: Ledger<i64>,
    /// The facets of the vertex.
    facets: Vec<u32>,
    /// The edge of each facet that is across from the vertex.
    rim: Vec<[u32; 2]>,
    /// Its edges on the interfaces, each with the place of a facet there: sorted, those of one edge beside each other.
    edges: Vec<(u32, u32)>,
    /// The sides of the facets at one edge.
    sides: Vec<Side>,
    /// Which sides are on one sheet: a forest, whose roots point to themselves.
    parents: Vec<u32>,
    /// The labels whose boundary touches itself along an edge of the vertex.
    pinched: Vec<i32>,
    /// A side of each umbrella.
    tops: Vec<Side>,
    /// Tets at the vertex that are joined to each other there.
    cone: Vec<u32>,
}

impl<'m> Umbrellas<'m> {
    fn new(mesh: &'m TetMesh, components: &'m MeshComponents) -> Self {
        let (facets, edges, sides, parents) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (pinches, touches, pinched, tops, cone) = (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let euler = Ledger::default();
        Self {
            mesh,
            components,
            open_edges: 0,
            pinches,
            touches,
            euler,
            facets,
            rim: Vec::new(),
            edges,
            sides,
            parents,
            pinched,
            tops,
            cone,
        }
    }

    /// Counts at vertex `v`, whose facets are given, its umbrellas, and the edges and facets of which it is the smallest vertex.
    fn look_at(&mut self, v: u32, facets: impl Iterator<Item = u32>) {
        self.facets.clear();
        self.facets.extend(facets);
        if !self.is_disk(v) {
            self.look_closely(v);
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

    fn component(&self, node: u32) -> Option<u32> {
        self.tet(node).and_then(|t| self.components.of(t))
    }

    fn add(&mut self, node: u32, count: i64) {
        if let Some(component) = self.component(node) {
            self.euler.add(component.into(), count);
        }
    }

    /// Whether the facets around `v` are one cycle between two labels, as most are; then they are counted.
    fn is_disk(&mut self, v: u32) -> bool {
        let labels = self.mesh.facet_labels[self.facets[0] as usize];
        if self.facets.iter().any(|&f| self.mesh.facet_labels[f as usize] != labels) {
            return false;
        }
        // Each facet leads from one of its vertices to the next: those of one interface are all turned the same way.
        self.rim.clear();
        for &f in &self.facets {
            let facet = self.mesh.facets[f as usize];
            let Some(i) = facet.iter().position(|&w| w == v) else { return false };
            self.rim.push([facet[(i + 1) % 3], facet[(i + 2) % 3]]);
        }
        let [first, mut end] = self.rim[0];
        let mut steps = 1;
        while end != first && steps < self.rim.len() {
            let Some(&[_, next]) = self.rim.iter().find(|step| step[0] == end) else { return false };
            (end, steps) = (next, steps + 1);
        }
        // A way that comes to its start after as many steps as there are facets goes through all of them: a second one from the same vertex would not be met.
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
    fn look_closely(&mut self, v: u32) {
        self.edges.clear();
        for (&f, place) in self.facets.iter().zip(0..) {
            let others = self.mesh.facets[f as usize].into_iter().filter(|&w| w != v);
            self.edges.extend(others.map(|w| (w, place)));
        }
        self.edges.sort_unstable();
        self.parents.clear();
        self.parents.extend(0..2 * self.facets.len() as u32);
        self.pinched.clear();
        let mut start = 0;
        while let Some(&(w, _)) = self.edges.get(start) {
            let end = start + self.edges[start..].iter().take_while(|edge| edge.0 == w).count();
            self.sides.clear();
            for e in start..end {
                let place = self.edges[e].1;
                let sides = [2 * place, 2 * place + 1].map(|node| Side { label: self.label(node), node });
                self.sides.extend(sides);
            }
            self.sides.sort_unstable();
            self.look_along(v, w);
            start = end;
        }

        self.tops.clear();
        for node in 0..2 * self.facets.len() as u32 {
            let label = self.label(node);
            if label != 0 && self.parents[node as usize] == node {
                self.tops.push(Side { label, node });
            }
            if self.mesh.facets[self.facets[node as usize / 2] as usize].iter().all(|&w| w >= v) {
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
            if !self.pinched.contains(&tops[0].label) {
                self.pinches.push(Pinch { ends: [v; 2], label: tops[0].label });
            }
            self.cone.clear();
            let mut parts: Vec<(u32, i64)> = Vec::new();
            let mut starts = Vec::new();
            for top in tops {
                // The first umbrella of a cone makes a disk, each further one a hole in it.
                let Some(t) = self.tet(top.node) else { continue };
                if let Some(place) = self.cone.iter().position(|&other| other == t) {
                    self.add(top.node, -1);
                    parts[starts.partition_point(|&start| start <= place) - 1].1 -= 1;
                } else {
                    self.add(top.node, 1);
                    starts.push(self.cone.len());
                    self.gather_cone(v, top.node);
                    parts.extend(self.components.of(t).map(|component| (component, 1)));
                }
            }
            if !parts.is_empty() {
                self.touches.push(Touch { is_edge: false, parts });
            }
        }
        self.tops = tops;
    }

    /// Adds the tets that are joined to that at the side `node` across facets at `v`, all of its label.
    fn gather_cone(&mut self, v: u32, node: u32) {
        let mesh = self.mesh;
        let label = self.label(node);
        let mut next = self.cone.len();
        self.cone.extend(self.tet(node));
        while next < self.cone.len().min(MOST_AROUND) {
            let t = self.cone[next] as usize;
            for (&across, &opposite) in mesh.neighbors[t].iter().zip(&mesh.tets[t]) {
                let is_same = opposite != v && across != NONE && mesh.labels[across as usize] == label;
                if is_same && !self.cone.contains(&across) {
                    self.cone.push(across);
                }
            }
            next += 1;
        }
    }

    /// Joins the sheets across the edge from `v` to `w`, whose sides are listed, and counts the edge if `v` is its smaller vertex.
    fn look_along(&mut self, v: u32, w: u32) {
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
            self.pinched.push(label);
            if own && sides.len() > 2 {
                self.pinches.push(Pinch { ends: [v, w], label });
            }
            let mut wedges = Vec::new();
            for side in sides {
                let other = self.beyond(side.node, v, w).and_then(|x| {
                    sides.iter().find(|other| other.node != side.node && self.third(other.node, v, w) == Some(x))
                });
                if let Some(other) = other {
                    join(&mut self.parents, side.node, other.node);
                }
                // Each pair once.
                if own && other.is_none_or(|other| side.node < other.node) {
                    self.add(side.node, -1);
                    wedges.extend(self.component(side.node).map(|component| (component, 1)));
                }
            }
            if wedges.len() > 1 {
                self.touches.push(Touch { is_edge: true, parts: wedges });
            }
        }
        self.open_edges += u64::from(own && is_open);
        self.sides = sides;
    }

    /// The vertex of a facet besides `v` and `w`.
    fn third(&self, node: u32, v: u32, w: u32) -> Option<u32> {
        self.mesh.facets[self.facets[node as usize / 2] as usize].into_iter().find(|&x| x != v && x != w)
    }

    /// Goes around the edge from `v` to `w`, from tet to tet of one label, from this side of a facet to the next facet of the label's boundary; its third
    /// vertex.
    fn beyond(&self, node: u32, v: u32, w: u32) -> Option<u32> {
        let mesh = self.mesh;
        let mut t = self.tet(node)?;
        let mut x = self.third(node, v, w)?;
        let label = self.label(node);
        for _ in 0..MOST_AROUND {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::image_components::ImageComponents;
    use super::super::testing;
    use super::*;
    use crate::image::{Frame, LabelImage};

    fn measured(mesh: &TetMesh, image: &LabelImage) -> (Sheets, MeshComponents) {
        let monitor = Monitor::silent();
        let of_image = ImageComponents::new(image, &monitor).unwrap();
        let of_mesh = MeshComponents::new(mesh, image, &of_image, &monitor).unwrap();
        (Sheets::measure(mesh, &of_mesh, &monitor).unwrap(), of_mesh)
    }

    fn of_voxels(dims: [usize; 3], label: impl Fn(usize, usize, usize) -> i32 + Copy) -> Sheets {
        let image = testing::image(dims, Frame::axis_aligned([1.0; 3]).unwrap(), label);
        measured(&testing::kuhn_box(dims, [1.0; 3], label), &image).0
    }

    const DIMS: [usize; 3] = [6, 4, 4];

    proptest! {
        /// The closed tets of a Kuhn mesh fill the closed voxels.
        #[test]
        fn touching_tets_against_closed_voxels(values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2])) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            let (sheets, components) = measured(&mesh, &image);
            let of_image = ImageComponents::new(&image, &Monitor::silent()).unwrap();
            for (label, id) in [(1, image.id_of(1)), (2, image.id_of(2))] {
                let is_own = |component: u32| components.list[component as usize].label == label;
                let bounds: i64 = (0..).zip(&sheets.euler).filter(|&(component, _)| is_own(component)).map(|(_, &euler)| euler).sum();
                let touching: i64 = sheets.touches.iter().map(|touch| touch.of_union(is_own)).sum();
                let voxels: i64 = of_image.list.iter().filter(|component| Some(component.id) == id).map(|component| component.euler).sum();
                prop_assert_eq!(bounds + touching, 2 * voxels);
            }
        }

        /// The tets of a Kuhn mesh fill the voxels: the solid just inside is that of voxels, pairs across a face, squares of four and cubes of eight.
        #[test]
        fn a_mesh_of_voxels_against_their_complex(values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2])) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            let (sheets, components) = measured(&mesh, &image);
            let mut expected = vec![0_i64; sheets.euler.len()];
            for (cell, component) in (0..values.len()).filter_map(|cell| Some((cell, components.of(6 * cell as u32)?))) {
                let at = [cell % DIMS[0], cell / DIMS[0] % DIMS[1], cell / (DIMS[0] * DIMS[1])];
                for size in 0..8 {
                    let upper = [size & 1, size >> 1 & 1, size >> 2];
                    let bricks = (0..8).map(|bits| [0, 1, 2].map(|axis| at[axis] + upper[axis] * (bits >> axis & 1)));
                    let mut bricks = bricks.map(|at| (0..3).all(|axis| at[axis] < DIMS[axis]) && label(at[0], at[1], at[2]) == values[cell]);
                    let sign = if upper.iter().sum::<usize>() % 2 == 0 { 1 } else { -1 };
                    expected[component as usize] += if bricks.all(|same| same) { 2 * sign } else { 0 };
                }
            }
            prop_assert_eq!(sheets.euler, expected);
            prop_assert_eq!(sheets.open_edges, 0);
            // An edge of the grid is pinched where two of the four voxels around it are of a label and across from each other, and the others are not.
            let at = |[i, j, k]: [isize; 3]| {
                let inside = (0..DIMS[0] as isize).contains(&i) && (0..DIMS[1] as isize).contains(&j) && (0..DIMS[2] as isize).contains(&k);
                if inside { values[i as usize + DIMS[0] * (j as usize + DIMS[1] * k as usize)] } else { 0 }
            };
            let mut edges = 0;
            for (i, j, k, axis) in (0..7).flat_map(|i| (0..5).flat_map(move |j| (0..5).flat_map(move |k| (0..3).map(move |axis| (i, j, k, axis))))) {
                let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                    let mut cell = [i, j, k];
                    cell[(axis + 1) % 3] -= u;
                    cell[(axis + 2) % 3] -= v;
                    at(cell)
                });
                for (one, other) in [(0, 1), (1, 0)] {
                    let label = around[one];
                    let touches = label != 0 && around[one + 2] == label && around[other] != label && around[(other + 2) % 4] != label;
                    edges += usize::from(touches);
                }
            }
            prop_assert_eq!(sheets.pinches.iter().filter(|pinch| pinch.is_edge()).count(), edges);
        }
    }

    #[test]
    fn surfaces_that_everyone_knows() {
        let euler = |dims, label: fn(usize, usize, usize) -> i32| {
            let sheets = of_voxels(dims, label);
            assert_eq!((sheets.open_edges, sheets.pinches), (0, Vec::new()));
            sheets.euler
        };
        assert_eq!(euler([3; 3], |_, _, _| 1), [2], "a ball");
        assert_eq!(euler([3, 3, 1], |i, j, _| i32::from(!(i == 1 && j == 1))), [0], "a torus");
        assert_eq!(euler([5, 3, 1], |i, j, _| i32::from(!(i % 2 == 1 && j == 1))), [-2], "two holes");
        assert_eq!(euler([3; 3], |i, j, k| 2 - i32::from(i == 1 && j == 1 && k == 1)), [2 + 2, 2], "a ball in a shell");
        assert_eq!(euler([3, 1, 1], |i, _, _| i32::from(i != 1)), [2, 2], "two balls");
        assert_eq!(euler([2; 3], |i, j, k| 1 + (i + 2 * j + 4 * k) as i32), [2; 8], "eight balls");
    }

    #[test]
    fn what_touches_is_listed_and_does_not_count() {
        // Two cubes with one edge in common, two with one vertex, and a ring of cubes closed by an edge.
        let sheets = of_voxels([2, 2, 1], |i, j, _| i32::from(i == j));
        assert_eq!(sheets.euler, [2, 2]);
        assert_eq!(sheets.pinches, [Pinch { ends: [4, 13], label: 1 }]);
        let sheets = of_voxels([2; 3], |i, j, k| i32::from(i == j && j == k));
        assert_eq!((sheets.euler, sheets.pinches), (vec![2, 2], vec![Pinch { ends: [13, 13], label: 1 }]));
        // Two cavities with a vertex in common: just inside, one surface goes around both.
        let cavities = |i: usize, j: usize, k: usize| i32::from([i, j, k] != [1; 3] && [i, j, k] != [2; 3]);
        let sheets = of_voxels([4; 3], cavities);
        assert_eq!((sheets.euler, sheets.pinches), (vec![4], vec![Pinch { ends: [62, 62], label: 1 }]));
        let ring = |i: usize, j: usize, _: usize| [[1, 1, 1], [1, 0, 2], [1, 1, 0]][j][i];
        let sheets = of_voxels([3, 3, 1], ring);
        assert_eq!(sheets.euler, [2, 2], "a bent bar and a cube");
        assert_eq!(sheets.pinches, []);
        let closed = |i: usize, j: usize, _: usize| i32::from([[1, 1, 1], [1, 0, 1], [1, 1, 0]][j][i] == 1);
        let sheets = of_voxels([3, 3, 1], closed);
        assert_eq!(sheets.euler, [2]);
        assert_eq!(sheets.pinches, [Pinch { ends: [10, 26], label: 1 }]);
    }

    #[test]
    fn many_labels_at_an_edge_are_closed() {
        // Cubes in a checkerboard of four labels and background meet in every way along edges.
        let sheets = of_voxels([4, 4, 3], |i, j, k| ((i * 3 + j * 5 + k * 7 + i * j) % 5) as i32);
        assert_eq!(sheets.open_edges, 0);
    }

    #[test]
    fn faults_are_survived_and_counted() {
        let label = |i: usize, j: usize, _: usize| i32::from(i == j);
        let image = testing::image([2, 2, 1], Frame::axis_aligned([1.0; 3]).unwrap(), label);
        let mut mesh = testing::kuhn_box([2, 2, 1], [1.0; 3], label);
        // One facet fewer leaves its three edges open; a tet that names a vertex twice leads nowhere.
        mesh.facets.pop();
        mesh.facet_labels.pop();
        mesh.facet_tets.pop();
        for t in 0..mesh.tets.len() {
            mesh.tets[t][1] = mesh.tets[t][0];
        }
        assert_eq!(measured(&mesh, &image).0.open_edges, 3);
    }

    #[test]
    fn equal_on_any_number_of_threads() {
        let label = |i: usize, j: usize, k: usize| ((i / 3 + j / 4 * k) % 4) as i32;
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| of_voxels([18, 16, 12], label))
        };
        let one = on(1);
        assert!(one.pinches.len() > 10);
        assert_eq!(one, on(3));
    }
}
