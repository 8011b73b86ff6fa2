//! R1: samples of dO, a net whose points keep delta from each other and come within delta of every
//! crossed edge of the image's grid.
//!
//! The paper's R1 lets circumcenters look for dO: it inserts their closest surface points as long
//! as these are delta away from all isovertices. What no circumcenter is near to it never finds,
//! and every tet has to be asked. Here the image is asked instead, once, before there are tets: an
//! interface, however small, crosses edges of the grid of voxel centres
//! (`oracle/features/edges.rs`; divided where voxels are larger than delta), and each such crossing
//! gets an isovertex within delta. Isovertices are never removed, so this holds from then on. The
//! greedy choice goes tile by tile of the image (`oracle/features/tiles`), of a size that spacing
//! and delta alone decide, in four colours: each tile is mindful of those beside it that come
//! before, and begins as soon as these are done. So the samples are the same whatever the number of
//! threads.
//!
//! **Junctions first.** The lines and points where labels meet, or touch themselves, are sampled
//! before all else (`junctions`), and crossings near to their samples get none.
//!
//! **Then what bulges.** A mesh with its vertices on a surface cuts off what is convex between
//! them, so it loses volume. The greedy choice is free in where it begins: it takes the crossings
//! around corner voxels first, those of a label that three of the six beside them have, too. So
//! vertices are where bodies bulge out, and half of the loss is gone at the same number of samples.
//! These are not moved by more than what keeps them from being cocircular: beside its edge the
//! surface falls off.
//!
//! **Moved crossings.** Crossings on a grid are massively cocircular. Any other sample is moved to
//! a point of dO nearby, by up to a fifth of a voxel beside its edge, less where delta is below a
//! voxel: exact arithmetic stays the exception, and facets are not all halves of squares. The move
//! is at most delta/2, so samples are at least delta/2 apart, and the crossing is within delta of
//! its own sample.
//!
//! **Order of insertion.** Rounds of growing size, each along a space-filling curve (N. Amenta, S.
//! Choi, G. Rote, "Incremental constructions con BRIO", SoCG 2003): cavities stay small, and a walk
//! from the last vertex to the next is short.
//!
//! **Denser later.** Where samples are to be closer than they were ([`Earlier`]) all of this is
//! offered again, to nets that know all isovertices there are. Elsewhere nothing is, so what held
//! there goes on to hold. Bricks of voxels that are not beside such a place are not looked at: what
//! is found in a brick lies in it, or a little beside it.
//!
//! | file | what it is |
//! |---|---|
//! | `junctions` | samples of lines and points where labels meet |
//! | `net` | which samples of a tile there are, and whether one is near |
//!
//! Cost: some tens of nanoseconds per crossed edge, some hundreds per sample. Memory: 56 bytes per
//! sample; while tiles are sampled 34, and 30 in each other tile that it matters in.

mod junctions;
mod net;

use std::ops::Range;
use std::sync::{PoisonError, RwLock};

use glam::DVec3;
use rayon::prelude::*;

use super::cell_table::MAX_HEADS;
use super::rules::DRAWN_TO_WALL;
use crate::geometry::morton;
use crate::image::voxel_blocks::NearBlocks;
use crate::memory::{self, filled, room};
use crate::oracle::{BrickRow, CrossedEdge, Oracle, Tiles};
use crate::sizing::Sizing;
use crate::{Error, Result};
use junctions::sample_junctions;
use net::Net;

/// How far samples are moved beside their edges at most, in voxels and in deltas.
const MOVE: f64 = 0.2;
/// How far a sample may be from the crossing that it stands for, in deltas.
const FARTHEST: f64 = 0.5;
/// How many times the points of the one before a round of insertion has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Growth {
    /// 4 times: half the spacing on a surface.
    Fourfold = 2,
    /// 8 times: half the spacing in space.
    Eightfold = 3,
}
/// A key of the order of insertion has, from its low end: the number of the sample, its place along
/// the curve by so many bits for each axis, its round.
const AT_BITS: u32 = 30;
const PLACE_BITS: u32 = morton::BITS;
const LAST_ROUND: u32 = 15;

/// A sampling that is to become denser.
pub struct Earlier<'a> {
    /// How far apart its samples were.
    pub sizing: &'a Sizing,
    /// Where they are to be closer.
    pub denser: &'a NearBlocks,
    /// Where there are isovertices.
    pub isovertices: &'a [DVec3],
}

impl Earlier<'_> {
    /// The isovertices no farther from where samples are to be closer, in their order.
    fn isovertices_near(&self, reach: f64) -> Result<Vec<DVec3>> {
        const WHAT: &str = "isovertices";
        let near = |points: &[DVec3]| {
            let mut near = room(points.len(), WHAT)?;
            let is_near = |p: DVec3| self.denser.meet_ball(p, reach * reach);
            near.extend(points.iter().copied().filter(|&p| is_near(p)));
            Ok(near)
        };
        let parts = self.isovertices.par_chunks(16 * BOXED).map(near);
        memory::concatenated(parts.collect::<Result<_>>()?, WHAT)
    }
}

/// Isovertices that are passed over at once where a box around them is out of reach: those that
/// come one after the other were mostly inserted near each other.
const BOXED: usize = 256;

/// Samples of dO in the order in which they are best inserted.
pub struct Samples {
    /// Where they are.
    pub points: Vec<DVec3>,
    /// Where each round of insertion begins.
    pub rounds: Vec<usize>,
}

impl Samples {
    /// The rounds from sample `first`, the first of a round, on.
    pub fn rounds_from(&self, first: usize) -> impl Iterator<Item = Range<usize>> {
        let starts = self.rounds.iter().copied().filter(move |&start| start >= first);
        let ends = self
            .rounds
            .iter()
            .copied()
            .filter(move |&start| start > first)
            .chain([self.points.len()]);
        starts.zip(ends).map(|(start, end)| start..end)
    }
}

/// Samples dO, on all threads of the current rayon pool; with an `earlier` sampling, tells what
/// that one lacks to be as dense as `sizing` asks for. `go_on` is asked once per row of bricks of
/// voxels.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; those of `go_on`.
pub fn sample_isosurface(
    oracle: &Oracle,
    sizing: &Sizing,
    growth: Growth,
    earlier: Option<&Earlier<'_>>,
    go_on: impl Fn() -> Result<()> + Sync,
) -> Result<Samples> {
    let delta = sizing.max();
    let grid = oracle.edge_grid(&sizing.palette());
    let tiles = grid.tiles(2.0 * delta);
    let wanted = Wanted { sizing, earlier };
    let nets = Nets::new([delta, oracle.spacing().max_element()], &tiles, &wanted)?;
    let corner_voxels = sample_junctions(oracle, sizing, &grid, &nets, &wanted, &go_on)?;
    nets.offer(|tile, net| {
        let mut corners = corner_voxels[tile].iter().filter(|&&p| wanted.has(p));
        corners.try_for_each(|&p| net.offer(p, sizing.at(p), || p))?;
        for row in tiles.rows(tile).filter_map(|row| wanted.in_row(row)) {
            go_on()?;
            grid.visit_row(row, |edge| {
                // The spacing is that of the edge's cell, which is named by its first voxel.
                if wanted.has(edge.point) || wanted.has(oracle.first_voxel(&edge)) {
                    net.offer(edge.point, edge.spacing, || moved(oracle, &edge))?;
                }
                Ok(())
            })?;
        }
        Ok(())
    })?;
    insertion_order(nets.into_samples(), growth, go_on)
}

/// Where samples are wanted.
struct Wanted<'a> {
    sizing: &'a Sizing,
    earlier: Option<&'a Earlier<'a>>,
}

impl Wanted<'_> {
    fn has(&self, p: DVec3) -> bool {
        self.earlier.is_none_or(|earlier| self.sizing.is_below(earlier.sizing, p))
    }

    /// The bricks of a row where any may be.
    fn in_row(&self, row: usize) -> Option<BrickRow<'_>> {
        match self.earlier {
            None => Some(row.into()),
            Some(earlier) => {
                let near = earlier.denser.near();
                near.has_in_row(row).then(|| BrickRow::from(row).among(near))
            }
        }
    }
}

/// The nets of the tiles of an image where samples are wanted.
pub(super) struct Nets<'a> {
    tiles: &'a Tiles,
    /// Whether any are wanted in a tile.
    wanted: Vec<bool>,
    /// Nobody ever waits for one of the locks: while a tile is visited those beside it are not.
    nets: Vec<RwLock<Net>>,
}

impl<'a> Nets<'a> {
    /// Nets that have nothing but what is there already; no spacing will be above `max`, and no
    /// side of a voxel is above `side`.
    fn new([max, side]: [f64; 2], tiles: &'a Tiles, wanted: &Wanted<'_>) -> Result<Self> {
        let earlier = wanted.earlier;
        let mut of_tiles = room(tiles.count(), "nets of tiles")?;
        of_tiles.extend(
            (0..tiles.count()).map(|tile| tiles.rows(tile).any(|row| wanted.in_row(row).is_some())),
        );
        // A quarter of what the grid of vertices may have: there are fewer samples than vertices,
        // and a limit of memory counts them only when all are there.
        let max_heads = (MAX_HEADS / 4 / tiles.count().max(1)).max(1);
        let mut nets = room(tiles.count(), "nets of tiles")?;
        nets.extend(
            (0..tiles.count())
                .map(|tile| RwLock::new(Net::new(max, tiles.bounds(tile), max_heads))),
        );
        // All before there are samples: lists that grow between the tables would leave gaps.
        for_each_wanted(&mut nets, &of_tiles, Net::open)?;
        // Samples are wanted where the field is smaller, or a voxel beside that. Isovertices that
        // are farther away than the largest spacing cover nothing there.
        let there = match earlier {
            Some(earlier) => earlier.isovertices_near(max + side)?,
            None => Vec::new(),
        };
        let box_of = |points: &[DVec3]| {
            points.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &p| {
                [low.min(p), high.max(p)]
            })
        };
        let boxes: Vec<[DVec3; 2]> = there.par_chunks(BOXED).map(box_of).collect();
        for_each_wanted(&mut nets, &of_tiles, |net| {
            let [lower, upper] = net.reach;
            let near = boxes
                .iter()
                .zip(there.chunks(BOXED))
                .filter(|([low, high], _)| low.cmple(upper).all() && high.cmpge(lower).all());
            for &p in near.flat_map(|(_, points)| points) {
                if net.reaches(p) {
                    net.push(p)?;
                }
            }
            Ok(())
        })?;
        Ok(Self { tiles, wanted: of_tiles, nets })
    }

    /// Has `points` offer those of each tile to its net, which knows by then what those beside it
    /// have taken: of these points, if they come before it, and of all that were offered earlier.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `points`.
    pub fn offer(&self, points: impl Fn(usize, &mut Net) -> Result<()> + Sync) -> Result<()> {
        self.tiles.in_colors(|tile| {
            if !self.wanted[tile] {
                return Ok(());
            }
            let mut net = self.nets[tile].write().unwrap_or_else(PoisonError::into_inner);
            for (n, beside) in self.tiles.beside(tile).enumerate() {
                net.learn(n, &self.nets[beside].read().unwrap_or_else(PoisonError::into_inner))?;
            }
            points(tile, &mut net)
        })
    }

    /// The samples of each tile, in the order in which they came.
    fn into_samples(self) -> Vec<Vec<DVec3>> {
        let nets = self
            .nets
            .into_iter()
            .map(|net| net.into_inner().unwrap_or_else(PoisonError::into_inner));
        nets.map(Net::into_own).collect()
    }
}

/// Visits the nets of tiles where samples are wanted.
fn for_each_wanted(
    nets: &mut [RwLock<Net>],
    wanted: &[bool],
    visit: impl Fn(&mut Net) -> Result<()> + Sync,
) -> Result<()> {
    let nets = nets.par_iter_mut().zip(wanted).filter(|(_, wanted)| **wanted);
    nets.map(|(net, _)| net.get_mut().unwrap_or_else(PoisonError::into_inner)).try_for_each(&visit)
}

/// The sample of an edge: its crossing, moved.
fn moved(oracle: &Oracle, edge: &CrossedEdge) -> DVec3 {
    let (p, delta) = (edge.point, edge.spacing);
    let max = MOVE * delta.min(oracle.spacing().min_element());
    let mut state = p.to_array().map(f64::to_bits).into_iter().fold(0, mix);
    let mut random = || {
        state = mix(state, 1);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let offset = [max * random(), max * random()];
    let near = |q: &DVec3| q.distance(p) <= FARTHEST * delta;
    let q = oracle.crossing_beside(edge, offset).filter(near).unwrap_or(p);
    oracle.drawn_to_walls(q, DRAWN_TO_WALL * delta).find(near).unwrap_or(q)
}

/// A point of a junction, moved onto walls that are close.
pub(super) fn drawn(oracle: &Oracle, p: DVec3, delta: f64) -> DVec3 {
    oracle.drawn_to_walls(p, DRAWN_TO_WALL * delta).next().unwrap_or(p)
}

/// A hash of the two (the finaliser of SplitMix64).
fn mix(state: u64, next: u64) -> u64 {
    let mut z = (state ^ next).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

/// Sorts points, which are in parts, into rounds, and along a space-filling curve in each.
fn insertion_order(
    parts: Vec<Vec<DVec3>>,
    growth: Growth,
    go_on: impl Fn() -> Result<()>,
) -> Result<Samples> {
    // As a power of two.
    let growth = growth as u32;
    let mut starts = Vec::with_capacity(parts.len());
    let mut total = 0;
    for part in &parts {
        starts.push(total);
        total += part.len();
    }
    if total >= 1 << AT_BITS {
        return Err(Error::LimitReached(format!(
            "there would be {total} samples of the isosurface, 2^{AT_BITS} or more"
        )));
    }
    let (mut lower, mut upper) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &p in parts.iter().flatten() {
        (lower, upper) = (lower.min(p), upper.max(p));
    }
    let scale =
        f64::from((1 << PLACE_BITS) - 1) / (upper - lower).max_element().max(f64::MIN_POSITIVE);
    let key_of = |at: usize, p: DVec3| {
        let round = (mix(at as u64, 0) | 1 << (growth * LAST_ROUND)).trailing_zeros() / growth;
        let place = morton::place(((p - lower) * scale).to_array().map(|c| c as u32));
        // The last round holds most of the points.
        let round = u64::from(LAST_ROUND - round) << (3 * PLACE_BITS);
        (round | u64::from(place)) << AT_BITS | at as u64
    };
    let mut keys = filled(total, 0, "places in the order of insertion", &go_on)?;
    let keys_of = memory::parts(&mut keys, parts.iter().map(Vec::len), "samples of tiles")?;
    keys_of.into_par_iter().zip(&parts).zip(&starts).for_each(|((keys, part), &start)| {
        for ((key, &p), at) in keys.iter_mut().zip(part).zip(start..) {
            *key = key_of(at, p);
        }
    });
    go_on()?;
    keys.par_sort_unstable();
    go_on()?;
    let point = |key: u64| {
        let at = (key % (1 << AT_BITS)) as usize;
        // The last part that begins there or before: those that begin at the same place are empty,
        // but for it.
        let part = starts.partition_point(|&start| start <= at) - 1;
        parts[part][at - starts[part]]
    };
    let mut sorted = room(total, "samples of the isosurface")?;
    keys.par_iter().map(|&key| point(key)).collect_into_vec(&mut sorted);
    let round = |at: usize| keys[at] >> (3 * PLACE_BITS + AT_BITS);
    // Rounds grow by a factor: few ends have to be looked for.
    let mut rounds = Vec::new();
    let mut at = 0;
    while at < keys.len() {
        rounds.push(at);
        let this = round(at);
        at += keys[at..].partition_point(|key| key >> (3 * PLACE_BITS + AT_BITS) == this);
    }
    Ok(Samples { points: sorted, rounds })
}
