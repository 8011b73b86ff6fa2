//! R1: samples of dO, a net whose points keep delta from each other and come within delta of every crossed edge of the image's grid.
//!
//! The paper's R1 lets circumcenters look for dO: it inserts their closest surface points as long as these are delta away from all isovertices. What no circumcenter
//! is near to it never finds, and every tet has to be asked. Here the image is asked instead, once, before there are tets: an interface, however small,
//! crosses edges of the grid of voxel centres (`oracle/edges.rs`; divided where voxels are larger than delta), and each such crossing gets an isovertex
//! within delta. Isovertices are never removed, so this holds from then on. The order of edges is that of the image, and the greedy choice depends on it alone.
//!
//! **Moved crossings.** Crossings on a grid are massively cocircular. A sample is moved to a point of dO nearby, by up to a fifth of a voxel beside its edge, less where
//! delta is below a voxel: exact arithmetic stays the exception, and facets are not all halves of squares. The move is at most delta/2, so samples
//! are at least delta/2 apart, and the crossing is within delta of its own sample.
//!
//! **Order of insertion.** Rounds of growing size, each along a space-filling curve (N. Amenta, S. Choi, G. Rote, "Incremental constructions con BRIO", SoCG
//! 2003): cavities stay small, and a walk from the last vertex to the next is short.
//!
//! Cost: some tens of nanoseconds per crossed edge, some hundreds per sample. Memory: 36 bytes per sample.

use glam::DVec3;

use super::cell_table::CellTable;
use crate::Result;
use crate::memory::{filled, reserve, room};
use crate::oracle::{CrossedEdge, Oracle};

/// How far samples are moved beside their edges at most, in voxels and in deltas.
const MOVE: f64 = 0.2;
/// How far a sample may be from the crossing that it stands for, in deltas.
const FARTHEST: f64 = 0.5;
/// A round of insertion has this many times the points of the one before, as a power of two.
const ROUND_LOG: u32 = 3;
/// No sample.
const NONE: u32 = u32::MAX;

/// Samples of dO in the order in which they are best inserted. `go_on` is asked once per row of bricks of voxels.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; those of `go_on`.
pub fn sample_isosurface(oracle: &Oracle, delta: f64, go_on: impl Fn() -> Result<()>) -> Result<Vec<DVec3>> {
    let mut net = Net::new(oracle, delta)?;
    let grid = oracle.edge_grid(delta);
    for row in 0..grid.rows() {
        go_on()?;
        grid.visit_row(row, |edge| if net.covers(edge.point) { Ok(()) } else { net.add(&edge) })?;
    }
    insertion_order(&mut net.points)?;
    Ok(net.points)
}

/// The samples so far, in chains by cells of twice delta.
struct Net<'a> {
    oracle: &'a Oracle,
    delta: f64,
    cells: CellTable,
    heads: Vec<u32>,
    next: Vec<u32>,
    points: Vec<DVec3>,
    /// The sample that covered a point last: it is likely to cover the next one.
    last: DVec3,
}

impl<'a> Net<'a> {
    fn new(oracle: &'a Oracle, delta: f64) -> Result<Self> {
        let [lower, upper] = oracle.bounds();
        // Queries reach delta beyond the bounds.
        let cells = CellTable::new(lower - 2.0 * delta, upper + 2.0 * delta, 2.0 * delta);
        let heads = filled(cells.heads(), NONE, "cells of the net of samples", || Ok(()))?;
        Ok(Self { oracle, delta, cells, heads, next: Vec::new(), points: Vec::new(), last: DVec3::INFINITY })
    }

    /// Whether a sample is closer than delta to `p`.
    #[inline]
    fn covers(&mut self, p: DVec3) -> bool {
        if self.last.distance_squared(p) < self.delta * self.delta {
            return true;
        }
        // The cell of the point most likely has it.
        let own = self.cells.head_of(p);
        if self.is_in_chain(own, p) {
            return true;
        }
        let (from, to) = (self.cells.cell(p - self.delta), self.cells.cell(p + self.delta));
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let head = self.cells.head(x, y, z);
                    if head != own && self.is_in_chain(head, p) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Whether a sample of a chain is closer than delta to `p`.
    #[inline]
    fn is_in_chain(&mut self, head: usize, p: DVec3) -> bool {
        let mut at = self.heads[head];
        while at != NONE {
            let q = self.points[at as usize];
            if q.distance_squared(p) < self.delta * self.delta {
                self.last = q;
                return true;
            }
            at = self.next[at as usize];
        }
        false
    }

    /// Adds the sample of an edge that no sample covers.
    fn add(&mut self, edge: &CrossedEdge) -> Result<()> {
        let p = self.moved(edge);
        reserve(&mut self.next, 1, "samples of the isosurface")?;
        reserve(&mut self.points, 1, "samples of the isosurface")?;
        let head = self.cells.head_of(p);
        self.next.push(self.heads[head]);
        self.heads[head] = self.points.len() as u32;
        self.points.push(p);
        self.last = p;
        Ok(())
    }

    fn moved(&self, edge: &CrossedEdge) -> DVec3 {
        let p = edge.point;
        let most = MOVE * self.delta.min(self.oracle.spacing().min_element());
        let mut state = p.to_array().map(f64::to_bits).into_iter().fold(0, mix);
        let mut random = || {
            state = mix(state, 1);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let offset = [most * random(), most * random()];
        let near = |q: &DVec3| q.distance(p) <= FARTHEST * self.delta;
        self.oracle.crossing_beside(edge, offset).filter(near).unwrap_or(p)
    }
}

/// A hash of the two (the finaliser of SplitMix64).
fn mix(state: u64, next: u64) -> u64 {
    let mut z = (state ^ next).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

/// Sorts points into rounds, and along a space-filling curve in each.
fn insertion_order(points: &mut Vec<DVec3>) -> Result<()> {
    const BITS: u32 = 16;
    let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &p in points.iter() {
        (lower, upper) = (lower.min(p), upper.max(p));
    }
    let scale = f64::from((1 << BITS) - 1) / (upper - lower).max_element().max(f64::MIN_POSITIVE);
    let mut keys = room(points.len(), "places in the order of insertion")?;
    for (at, &p) in points.iter().enumerate() {
        let round = (mix(at as u64, 0) | 1 << (ROUND_LOG * 15)).trailing_zeros() / ROUND_LOG;
        let place = ((p - lower) * scale).to_array().map(|c| spread(c as u64));
        // The last round holds most of the points.
        let key = u64::from(15 - round) << (3 * BITS) | place[0] | place[1] << 1 | place[2] << 2;
        keys.push((key, at as u32));
    }
    keys.sort_unstable();
    let mut sorted = room(points.len(), "samples of the isosurface")?;
    sorted.extend(keys.iter().map(|&(_, at)| points[at as usize]));
    *points = sorted;
    Ok(())
}

/// Puts two zeros behind each of the 16 low bits: three such numbers interleave to a place on the Z-order curve.
fn spread(x: u64) -> u64 {
    let x = (x | x << 16) & 0x0000_0000_FF00_00FF;
    let x = (x | x << 8) & 0x0000_00F0_0F00_F00F;
    let x = (x | x << 4) & 0x0000_0C30_C30C_30C3;
    (x | x << 2) & 0x0000_2492_4924_9249
}
