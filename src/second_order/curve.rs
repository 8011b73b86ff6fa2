//! Curving: the nodes on interfaces go where the image has the interface, so that the facets follow it.
//!
//! | the edge of a node | where the node goes |
//! |---|---|
//! | inside of a label | nowhere |
//! | between two facets of the same two labels | along their mean normal, to the change of label |
//! | on a line, where three labels meet or an interface meets a wall | to the nearest point of such a line |
//! | in a wall, on an edge of the image | nowhere: it is there already |
//! | at a contact, or on a line that the image does not know (scans, probabilities) | nowhere |
//!
//! What must hold: the map from a straight tet to the curved one is one to one, with a determinant of at least [`LEAST`] times
//! that of the straight tet ([`jacobian`](super::jacobian)). Where a tet does not have that its nodes go half as far, then a
//! quarter, an eighth, at last nowhere. Straight tets have it, so that this ends.
//!
//! The result does not depend on the number of threads: what a round changes follows from what all tets were before it.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::jacobian::least_and_mean;
use super::{FACET_EDGES, RANGE};
use crate::Result;
use crate::memory::zeroed;
use crate::mesh::{MidNodes, TetMesh};
use crate::monitor::Monitor;
use crate::oracle::{Oracle, Walls};

/// The least determinant of a curved tet, in parts of that of the straight one. Far above rounding, so its sign is sure.
const LEAST: f64 = 0.1;

/// A node goes no farther than this part of its edge's length.
const FARTHEST: f64 = 0.25;

/// On a line a node moves by no more than this part of the length along its edge.
const ALONG: f64 = 0.1;

/// The distances, in parts of the edge's length, at which the two labels are to be on the two sides of an interface.
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
    /// The least determinant of the Jacobian of a tet with a moved node, in parts of that of the straight tet.
    pub least_jacobian: f64,
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

/// Moves the nodes of `mesh` on interfaces to where `oracle` has them; `labels` has the label of each of its ids.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn curve(mesh: &mut TetMesh, oracle: &Oracle, labels: &[i32], monitor: &Monitor<'_>) -> Result<Curving> {
    let Some(mid_nodes) = mesh.mid_nodes.take() else { return Ok(Curving::default()) };
    let moved = move_nodes(mesh, &mid_nodes, oracle, labels, monitor);
    mesh.mid_nodes = Some(mid_nodes);
    moved
}

fn move_nodes(
    mesh: &mut TetMesh,
    mid_nodes: &MidNodes,
    oracle: &Oracle,
    labels: &[i32],
    monitor: &Monitor<'_>,
) -> Result<Curving> {
    let vertices = mid_nodes.vertices;
    let ways = ways(mesh, mid_nodes, oracle, labels, monitor)?;
    // How often the way of each node was halved.
    let halvings: Vec<AtomicU8> = zeroed(ways.len(), "nodes")?;
    let at = |node: usize| {
        let straight = DVec3::from_array(mesh.points[vertices + node]);
        match halvings[node].load(Relaxed) {
            halved if halved > MAX_HALVINGS => straight,
            halved => straight + ways[node] * 0.5_f64.powi(halved.into()),
        }
    };
    let is_moved = |node: usize| ways[node] != DVec3::ZERO && halvings[node].load(Relaxed) <= MAX_HALVINGS;
    // The least determinant of a tet with a moved node in parts of the straight tet's, and six times the volume of any tet.
    let measure = |t: usize| {
        let corners = mesh.tets[t].map(|v| mesh.point(v));
        let [a, b, c, d] = corners;
        let straight = (b - a).cross(c - a).dot(d - a);
        let nodes = mid_nodes.tets[t].map(|node| node as usize - vertices);
        if !nodes.into_iter().any(is_moved) {
            return (None, straight);
        }
        let [least, mean] = least_and_mean(&corners, &nodes.map(at));
        (Some(least / straight), mean)
    };
    let chunks = || (0..mesh.tets.len().div_ceil(RANGE)).into_par_iter().with_max_len(1);
    let of_chunk = |chunk: usize| chunk * RANGE..((chunk + 1) * RANGE).min(mesh.tets.len());
    // The tets that have changed since they were looked at, and so may be bad: those with one of these nodes.
    let mut changed = ways.iter().map(|way| *way != DVec3::ZERO).collect::<Vec<bool>>();
    loop {
        let bad = |chunk: usize| {
            monitor.check_cancelled()?;
            let has_changed = |t: usize| mid_nodes.tets[t].iter().any(|&node| changed[node as usize - vertices]);
            let is_bad = |t: usize| has_changed(t) && measure(t).0.is_some_and(|least| least < LEAST);
            Ok(of_chunk(chunk).filter(|&t| is_bad(t)).collect())
        };
        let bad: Vec<Vec<usize>> = chunks().map(bad).collect::<Result<_>>()?;
        let nodes = || bad.iter().flatten().flat_map(|&t| mid_nodes.tets[t].map(|node| node as usize - vertices));
        changed.fill(false);
        nodes().for_each(|node| changed[node] = is_moved(node));
        if !changed.contains(&true) {
            break;
        }
        for node in nodes() {
            // Once for all of its tets.
            if std::mem::take(&mut changed[node]) {
                halvings[node].fetch_add(1, Relaxed);
            }
        }
        nodes().for_each(|node| changed[node] = ways[node] != DVec3::ZERO);
    }
    let mut done = Curving { least_jacobian: 1.0, ..Curving::default() };
    let of_chunks: Vec<(f64, f64)> = chunks()
        .map(|chunk| {
            let start = (1.0_f64, 0.0);
            of_chunk(chunk)
                .map(measure)
                .fold(start, |(all, sum), (least, volume)| (all.min(least.unwrap_or(1.0)), sum + volume))
        })
        .collect();
    for (least, volume) in of_chunks {
        done.least_jacobian = done.least_jacobian.min(least);
        done.volume += volume / 6.0;
    }
    let mut places = Vec::new();
    crate::memory::reserve(&mut places, ways.len(), "nodes")?;
    for node in 0..ways.len() {
        let place = at(node);
        places.push(place);
        match halvings[node].load(Relaxed) {
            _ if ways[node] == DVec3::ZERO => continue,
            0 => {}
            halved if halved > MAX_HALVINGS => {
                done.straight += 1;
                continue;
            }
            _ => done.shortened += 1,
        }
        done.curved += 1;
        done.max_move = done.max_move.max(place.distance(DVec3::from_array(mesh.points[vertices + node])));
    }
    for (point, place) in mesh.points[vertices..].iter_mut().zip(places) {
        *point = place.to_array();
    }
    Ok(done)
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
    let mut places = crate::memory::filled(count, Place::Inside, "nodes", || monitor.check_cancelled())?;
    let mut first: Vec<u32> = zeroed(count, "nodes")?;
    for (f, nodes) in mid_nodes.facets.iter().enumerate() {
        if f % RANGE == 0 {
            monitor.check_cancelled()?;
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
                Place::Surface { labels, facets, normal } if labels == mesh.facet_labels[f] && facets < 2 => {
                    Place::Surface { labels, facets: facets + 1, normal: normal + of_facet }
                }
                _ => Place::Line,
            };
        }
    }
    let mut ways: Vec<DVec3> = Vec::new();
    crate::memory::reserve(&mut ways, count, "nodes")?;
    ways.resize(count, DVec3::ZERO);
    ways.par_chunks_mut(RANGE).enumerate().try_for_each(|(chunk, ways)| {
        monitor.check_cancelled()?;
        for (i, way) in ways.iter_mut().enumerate() {
            let node = chunk * RANGE + i;
            if places[node] == Place::Inside {
                continue;
            }
            let facet = first[node] as usize;
            let edge = mid_nodes.facets[facet].iter().position(|&n| n as usize == vertices + node);
            let ends = FACET_EDGES[edge.expect("the facet lists the node")].map(|i| mesh.point(mesh.facets[facet][i]));
            *way = on_interface(oracle, labels, places[node], ends).unwrap_or_default();
        }
        Ok(())
    })?;
    Ok(ways)
}

/// Where the node of an edge on an interface is to go, from the middle of its ends.
fn on_interface(oracle: &Oracle, labels: &[i32], place: Place, [a, b]: [DVec3; 2]) -> Option<DVec3> {
    let (middle, length) = ((a + b) * 0.5, a.distance(b));
    let walls: Walls = oracle.walls_at(a).common(&oracle.walls_at(b));
    let most = FARTHEST * length;
    let on_line = || Some(oracle.onto_walls(oracle.nearest_junction(middle, most)?, walls));
    let to = match (place, walls.count()) {
        (Place::Surface { labels: pair, facets: 2, normal }, 0) => {
            let normal = normal.normalize_or_zero();
            REACHES.iter().find_map(|&reach| oracle.project(middle, normal, reach * length, pair, labels))?
        }
        // One of the two facets leaves the wall.
        (Place::Surface { facets: 2, normal, .. }, 1) if normal.length_squared() < FLAT => on_line()?,
        (Place::Line, 0 | 1) => on_line()?,
        _ => return None,
    };
    let way = to - middle;
    let along = way.dot(b - a).abs();
    (way.length() <= most && along <= ALONG * length * length).then_some(way)
}
