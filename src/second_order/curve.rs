//! Curving: the nodes on interfaces go where the image has the interface, so that the facets follow
//! it.
//!
//! | the edge of a node | where the node goes |
//! |---|---|
//! | inside of a label | nowhere |
//! | between two facets of the same two labels | along their mean normal, to the change of label |
//! | on a line, where three labels meet or an interface a wall | to the nearest point of a line |
//! | in a wall, on an edge of the image | nowhere: it is there already |
//! | at a contact, or on a line that the image does not know (scans, probabilities) | nowhere |
//!
//! What must hold: the map from a straight tet to the curved one is one to one, with a determinant
//! of at least [`MIN_DETERMINANT`] times that of the straight tet ([`jacobian`](super::jacobian)).
//! Where a tet does not have that its nodes go half as far, then a quarter, an eighth, at last
//! nowhere. Straight tets have it, so that this ends.
//!
//! The result does not depend on the number of threads: what a round changes follows from what all
//! tets were before it.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::jacobian::min_and_mean;
use super::{FACET_EDGES, RANGE};
use crate::Result;
use crate::memory::{filled, room, zeroed};
use crate::mesh::{MidNodes, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::{Oracle, Walls};

/// The least determinant of a curved tet, in parts of that of the straight one. Far above rounding,
/// so its sign is sure.
const MIN_DETERMINANT: f64 = 0.1;

/// A node goes no farther than this part of its edge's length.
const FARTHEST: f64 = 0.25;

/// On a line a node moves by no more than this part of the length along its edge.
const ALONG: f64 = 0.1;

/// The distances, in parts of the edge's length, at which the two labels are to be on the two sides
/// of an interface.
const REACHES: [f64; 3] = [0.0625, 0.125, FARTHEST];

/// The squared sum of the unit normals of two facets in one plane, less what rounding may do.
const FLAT: f64 = 4.0 - 1e-6;

/// How often the way of a node is halved before it stays where it was.
const MAX_HALVINGS: u8 = 3;

/// What curving did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Curving {
    /// Nodes that were moved.
    pub curved: u64,
    /// Those among them that do not go all the way, so that tets stay valid.
    pub shortened: u64,
    /// Nodes that would go somewhere, but stay, so that tets stay valid.
    pub straight: u64,
    /// The largest distance of a node from the middle of its edge.
    pub max_move: f64,
    /// The least determinant of the Jacobian of a tet with a moved node, in parts of that of the
    /// straight tet.
    pub min_jacobian: f64,
    /// The volume of all tets.
    pub volume: f64,
}

/// What an edge is on.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    Inside,
    /// Between facets of two labels, so many, with this sum of their normals.
    Surface {
        labels: [i32; 2],
        facets: u8,
        normal: DVec3,
    },
    /// Where facets of several pairs of labels meet.
    Line,
}

/// Moves the nodes of `mesh` on interfaces to where `oracle` has them; `labels` has the label of
/// each of its ids.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory). The mesh is
/// unchanged then.
pub fn curve(
    mesh: &mut TetMesh,
    oracle: &Oracle,
    labels: &[i32],
    monitor: &Monitor<'_>,
) -> Result<Curving> {
    let Some(mid_nodes) = &mesh.mid_nodes else { return Ok(Curving::default()) };
    let first = mid_nodes.vertices;
    let ways = ways(mesh, mid_nodes, oracle, labels, monitor)?;
    let halvings = zeroed(ways.len(), "nodes")?;
    let mut course = Course { mesh, mid_nodes, ways, halvings };
    course.shorten(monitor)?;
    let done = course.summary();
    let mut places = room(course.ways.len(), "nodes")?;
    places.extend((0..course.ways.len()).map(|node| course.place(node).to_array()));
    mesh.points[first..].copy_from_slice(&places);
    Ok(done)
}

/// How far nodes go. They are counted from the first one behind the vertices.
struct Course<'m> {
    mesh: &'m TetMesh,
    mid_nodes: &'m MidNodes,
    /// The whole way of each node; zero where it has none.
    ways: Vec<DVec3>,
    /// How often it was halved; more than [`MAX_HALVINGS`]: the node stays.
    halvings: Vec<u8>,
}

impl Course<'_> {
    fn is_moved(&self, node: usize) -> bool {
        self.ways[node] != DVec3::ZERO && self.halvings[node] <= MAX_HALVINGS
    }

    /// The middle of the node's edge.
    fn middle(&self, node: usize) -> DVec3 {
        DVec3::from_array(self.mesh.points[self.mid_nodes.vertices + node])
    }

    fn place(&self, node: usize) -> DVec3 {
        match self.halvings[node] {
            halved if halved > MAX_HALVINGS => self.middle(node),
            halved => self.middle(node) + self.ways[node] * 0.5_f64.powi(halved.into()),
        }
    }

    fn nodes_of(&self, t: usize) -> [usize; 6] {
        self.mid_nodes.tets[t].map(|node| node as usize - self.mid_nodes.vertices)
    }

    /// The least determinant of a tet with a moved node, in parts of the straight tet's; and six
    /// times the volume of any tet.
    fn measure(&self, t: usize) -> (Option<f64>, f64) {
        let corners = self.mesh.tets[t].map(|v| self.mesh.point(v));
        let [a, b, c, d] = corners;
        let straight = (b - a).cross(c - a).dot(d - a);
        let nodes = self.nodes_of(t);
        if !nodes.into_iter().any(|node| self.is_moved(node)) {
            return (None, straight);
        }
        let [min, mean] = min_and_mean(&corners, &nodes.map(|node| self.place(node)));
        (Some(min / straight), mean)
    }

    fn chunks(&self) -> impl IndexedParallelIterator<Item = Range<usize>> + use<> {
        let count = self.mesh.tets.len();
        let chunk = move |n: usize| n * RANGE..((n + 1) * RANGE).min(count);
        (0..count.div_ceil(RANGE)).into_par_iter().with_max_len(1).map(chunk)
    }

    /// Halves the ways of the nodes of tets that are not valid, until all are.
    fn shorten(&mut self, monitor: &Monitor<'_>) -> Result<()> {
        // Only tets with a node that has changed since they were inspected may be bad.
        let mut has_changed = room(self.ways.len(), "nodes")?;
        has_changed.extend(self.ways.iter().map(|way| *way != DVec3::ZERO));
        loop {
            let bad_of = |tets: Range<usize>| {
                monitor.advance(0)?;
                let is_bad = |&t: &usize| {
                    self.nodes_of(t).into_iter().any(|node| has_changed[node])
                        && self.measure(t).0.is_some_and(|min| min < MIN_DETERMINANT)
                };
                Ok(tets.filter(is_bad).collect())
            };
            let bad: Vec<Vec<usize>> = self.chunks().map(bad_of).collect::<Result<_>>()?;
            let nodes = bad
                .iter()
                .flatten()
                .flat_map(|&t| self.nodes_of(t))
                .filter(|&node| self.is_moved(node));
            let mut nodes: Vec<usize> = nodes.collect();
            if nodes.is_empty() {
                return Ok(());
            }
            nodes.sort_unstable();
            nodes.dedup();
            has_changed.fill(false);
            for node in nodes {
                self.halvings[node] += 1;
                has_changed[node] = true;
            }
        }
    }

    fn summary(&self) -> Curving {
        let of_chunk = |tets: Range<usize>| {
            tets.map(|t| self.measure(t)).fold((1.0_f64, 0.0), |(all, sum), (min, volume)| {
                (all.min(min.unwrap_or(1.0)), sum + volume)
            })
        };
        // Added in their order, whatever the number of threads.
        let of_chunks: Vec<(f64, f64)> = self.chunks().map(of_chunk).collect();
        let mut done = Curving { min_jacobian: 1.0, ..Curving::default() };
        for (min, volume) in of_chunks {
            done.min_jacobian = done.min_jacobian.min(min);
            done.volume += volume / 6.0;
        }
        for node in (0..self.ways.len()).filter(|&node| self.ways[node] != DVec3::ZERO) {
            if self.is_moved(node) {
                done.curved += 1;
                done.shortened += u64::from(self.halvings[node] > 0);
                done.max_move = done.max_move.max(self.place(node).distance(self.middle(node)));
            } else {
                done.straight += 1;
            }
        }
        done
    }
}

/// Where each node is to go, from the middle of its edge; zero: nowhere.
fn ways(
    mesh: &TetMesh,
    mid_nodes: &MidNodes,
    oracle: &Oracle,
    labels: &[i32],
    monitor: &Monitor<'_>,
) -> Result<Vec<DVec3>> {
    let vertices = mid_nodes.vertices;
    let count = mesh.points.len() - vertices;
    // Which facet lists each node first, and what all that do say of its edge.
    let mut places = filled(count, Place::Inside, "nodes", || monitor.advance(0))?;
    let mut first: Vec<u32> = zeroed(count, "nodes")?;
    for (f, nodes) in mid_nodes.facets.iter().enumerate() {
        if f % RANGE == 0 {
            monitor.advance(0)?;
        }
        let [a, b, c] = mesh.facets[f].map(|v| mesh.point(v));
        let of_facet = (b - a).cross(c - a).normalize_or_zero();
        for &node in nodes {
            let node = node as usize - vertices;
            let place = &mut places[node];
            *place = match *place {
                Place::Inside => {
                    first[node] = f as u32;
                    Place::Surface { labels: mesh.facet_labels[f], facets: 1, normal: of_facet }
                }
                Place::Surface { labels, facets, normal }
                    if labels == mesh.facet_labels[f] && facets < 2 =>
                {
                    Place::Surface { labels, facets: facets + 1, normal: normal + of_facet }
                }
                _ => Place::Line,
            };
        }
    }
    let mut ways = filled(count, DVec3::ZERO, "nodes", || monitor.advance(0))?;
    ways.par_chunks_mut(RANGE).enumerate().try_for_each(|(chunk, ways)| {
        monitor.advance(0)?;
        for (i, way) in ways.iter_mut().enumerate() {
            let node = chunk * RANGE + i;
            if places[node] == Place::Inside {
                continue;
            }
            let facet = first[node] as usize;
            let edge = mid_nodes.facets[facet].iter().position(|&n| n as usize == vertices + node);
            let ends = FACET_EDGES[edge.expect("the facet lists the node")]
                .map(|i| mesh.point(mesh.facets[facet][i]));
            *way = on_interface(oracle, labels, places[node], ends).unwrap_or_default();
        }
        Ok(())
    })?;
    Ok(ways)
}

/// Where the node of an edge on an interface is to go, from the middle of its ends.
fn on_interface(
    oracle: &Oracle,
    labels: &[i32],
    place: Place,
    [a, b]: [DVec3; 2],
) -> Option<DVec3> {
    let (middle, length) = ((a + b) * 0.5, a.distance(b));
    let walls: Walls = oracle.walls_at(a).common(&oracle.walls_at(b));
    let max = FARTHEST * length;
    let on_line = || Some(oracle.onto_walls(oracle.nearest_junction(middle, max)?, walls));
    let to = match (place, walls.count()) {
        (Place::Surface { labels: pair, facets: 2, normal }, 0) => {
            let normal = normal.normalize_or_zero();
            REACHES
                .iter()
                .find_map(|&reach| oracle.project(middle, normal, reach * length, pair, labels))?
        }
        // One of the two facets leaves the wall.
        (Place::Surface { facets: 2, normal, .. }, 1) if normal.length_squared() < FLAT => {
            on_line()?
        }
        (Place::Line, 0 | 1) => on_line()?,
        _ => return None,
    };
    let way = to - middle;
    let along = way.dot(b - a).abs();
    (way.length() <= max && along <= ALONG * length * length).then_some(way)
}
