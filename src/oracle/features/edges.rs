//! Where dO crosses the edges of a grid: the places from which it is sampled.
//!
//! The grid is that of the voxel centres, its edges divided where they are much longer than the
//! caller's spacing. On an undivided edge only the labels of its two voxels have an indicator above
//! 0, and both are linear there, so the one crossing is known without a search; others are looked
//! for, as are all of intensities, probabilities and smoothed labels. Every interface of the image
//! crosses edges of the grid, however small or thin what it bounds.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::image::bits::ones;
use crate::image::bricks::Bricks;
use crate::image::palette::Palette;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{concatenated, reserve};
use crate::oracle::Oracle;
use crate::oracle::model::contacts::{self, Contacts};
use crate::oracle::model::weights::hash;

/// Most parts of an edge between two voxel centres: at a spacing below an eighth of a voxel the
/// surface model has no detail left.
const MAX_PARTS: f64 = 8.0;

/// Into how many parts a cell is divided along each axis, given by whole numbers that may be too
/// small or too large.
pub(crate) fn parts_of(numbers: DVec3) -> [usize; 3] {
    numbers.to_array().map(|n| n.clamp(1.0, MAX_PARTS) as usize)
}

/// How far what is sampled around contacts is moved along each axis, in voxels, at most and at
/// least: on the grid itself it would be massively cocircular.
const MAX_MOVE: f64 = 0.02;
const MIN_MOVE: f64 = 0.01;

/// How far beside a contact a label is looked for, in parts of the way along the cell's axes to a
/// voxel of it: farther than samples are moved.
const BESIDE_CONTACT: f64 = 0.24;

/// Points around a contact are so far from it at least, in halves of a voxel's side: farther than
/// they are moved.
const LEAST_REACH: f64 = 0.1;

/// So many rows of bricks are looked through for contacts at once.
const ROWS: usize = 32;

/// What a list of contacts holds, as errors name it.
const CONTACTS: &str = "contacts of voxels";

/// A *corner voxel* has its label in common with so many of the six beside it, as at the corner of
/// a block; a *narrow* one with fewer, as along a row of voxels and at the corner of a sheet of
/// one.
const CORNER_JOINED: u32 = 3;

/// What is sampled because of how voxels lie beside each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeaturePoint {
    /// A contact.
    Contact,
    /// A point beside it.
    Around,
    /// Where dO crosses an edge from a narrow voxel.
    Narrow,
    /// Where dO crosses an edge from a corner voxel of a label other than the background.
    Corner,
}

/// An edge of the grid, between points of different labels.
#[derive(Clone, Copy, Debug)]
pub struct CrossedEdge {
    /// Where dO crosses it first, in world coordinates.
    pub point: DVec3,
    /// How far apart samples are to be about it: the spacing of its cell.
    pub spacing: f64,
    /// Its ends, in region coordinates.
    ends: [DVec3; 2],
    axis: usize,
}

/// A grid of edges; see [`Oracle::edge_grid`].
pub struct EdgeGrid<'a> {
    pub(crate) oracle: &'a Oracle,
    divisions: Palette<'a, Division>,
    /// Whether crossings of undivided edges are looked for, too: not where labels alone tell.
    searches: bool,
}

/// How the edges of a cell are divided.
struct Division {
    /// How far apart samples are to be.
    spacing: f64,
    /// Into how many parts that divides the edges along each axis.
    parts: [usize; 3],
}

impl Oracle {
    /// The grid whose edges are about as long as `spacings` tell of their cell, at most half as
    /// long again; or as long as the distance of voxel centres where that is less.
    pub fn edge_grid<'a>(&'a self, spacings: &Palette<'a, f64>) -> EdgeGrid<'a> {
        let divisions = spacings.map(|&spacing| Division {
            spacing,
            parts: parts_of((self.grid.spacing / spacing).round()),
        });
        EdgeGrid { oracle: self, divisions, searches: self.field.is_some() }
    }

    /// Whether voxels are sampled as such: not those of intensities and probabilities.
    fn knows_voxels(&self) -> bool {
        self.field.is_none() || self.is_smoothed
    }

    /// Where the contacts of the image are, in world coordinates: places in which the bodies of
    /// labels touch as their voxels do, in an edge or a corner alone. Parallel; their order does
    /// not depend on the number of threads. `go_on` is asked once per 512 rows of voxels.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; those of `go_on`.
    pub fn contacts(&self, go_on: &(dyn Fn() -> Result<()> + Sync)) -> Result<Vec<DVec3>> {
        if !self.knows_voxels() {
            return Ok(Vec::new());
        }
        let rows = self.rows();
        let parts = (0..rows.div_ceil(ROWS)).into_par_iter().map(|part| {
            go_on()?;
            let mut found = Vec::new();
            for row in part * ROWS..rows.min((part + 1) * ROWS) {
                self.visit_mixed_cells(row.into(), |cell| {
                    for contact in self.contacts_of(cell) {
                        reserve(&mut found, 1, CONTACTS)?;
                        found.push(self.near_half(contact));
                    }
                    Ok(())
                })?;
            }
            Ok(found)
        });
        concatenated(parts.collect::<Result<_>>()?, CONTACTS)
    }

    /// The contacts at the centre of a cell and on its lower faces, in half voxels; none on walls,
    /// where a point moved off the wall would dent it.
    fn contacts_of(&self, cell: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
        let contacts = self.at(cell).contacts();
        let of_cell = (contacts != Contacts::None).then(|| {
            let corners = self.corners(cell);
            // In half voxels, where centres of cells are odd.
            let center = cell.map(|c| 2 * c + 1);
            // A face belongs to the cell of which it is the lower one.
            let lower = (0..3)
                .filter(move |&axis| contacts::alternates(&corners, contacts::FACES[axis][0]));
            let of_face = lower.map(move |axis| step(center, axis, -1));
            of_face.chain((contacts == Contacts::Center).then_some(center))
        });
        of_cell.into_iter().flatten().filter(|&contact| self.is_between_walls(contact))
    }

    /// A point at a place given in half voxels, moved a little: to and fro across each plane of the
    /// grid in turn, so that no four around a square stay in a plane.
    fn near_half(&self, half: [usize; 3]) -> DVec3 {
        self.near_contact(half, half)
    }

    /// The same, drawn to a contact as far as half a side of the voxel is longer than half of its
    /// smallest one.
    fn near_contact(&self, contact: [usize; 3], half: [usize; 3]) -> DVec3 {
        let spacing = self.grid.spacing;
        // Along sides that are longer still, moving the two points could exchange them.
        let reach = (spacing.min_element() / spacing).max(DVec3::splat(LEAST_REACH));
        let turns = [0, 1, 2].map(|a| (half[(a + 1) % 3] + half[(a + 2) % 3]) % 2 == 1);
        let [from, to] = [contact, half].map(|half| DVec3::from(half.map(|h| h as f64 / 2.0)));
        let at = from + reach * (to - from);
        self.grid.point_at(moved(at, turns, hash(half)))
    }
}

/// A row of bricks of voxels along x, or some bricks of one.
#[derive(Clone, Copy)]
pub struct BrickRow<'a> {
    number: usize,
    among: Option<&'a VoxelBlocks>,
}

impl From<usize> for BrickRow<'_> {
    /// All of it.
    fn from(number: usize) -> Self {
        Self { number, among: None }
    }
}

impl<'a> BrickRow<'a> {
    /// Those of its bricks that are among some blocks.
    pub fn among(self, blocks: &'a VoxelBlocks) -> Self {
        Self { among: Some(blocks), ..self }
    }
}

impl EdgeGrid<'_> {
    /// Rows of bricks of voxels; [`EdgeGrid::visit_row`] takes one at a time.
    pub fn rows(&self) -> usize {
        self.oracle.rows()
    }

    /// Calls `visit` for the crossed edges of one row, brick after brick. The rows hold each
    /// crossed edge of the grid once.
    ///
    /// # Errors
    /// What `visit` returns; the first ends the visit.
    pub fn visit_row<'b>(
        &self,
        row: impl Into<BrickRow<'b>>,
        mut visit: impl FnMut(CrossedEdge) -> Result<()>,
    ) -> Result<()> {
        // The outermost voxels are background, so no edge of theirs is crossed.
        self.oracle.visit_mixed_cells(row.into(), |voxel @ [i, j, k]| {
            let division = self.divisions.at(self.oracle.grid.bricks.index(i, j, k));
            if division.parts == [1; 3] && !self.searches {
                self.visit_edges_of(voxel, division, &mut visit)
            } else {
                self.visit_parts_of(voxel, division, &mut visit)
            }
        })
    }

    /// Calls `visit` for what is to be sampled at the contacts of a row, see `contacts`, and at its
    /// narrow and its corner voxels, in world coordinates. Around a contact those are the points of
    /// an octahedron: the contact itself, and on each of the three lines through it that follow the
    /// grid a point on both sides, half of the smallest side of a voxel away; the tets between it
    /// and three of these have their circumcenters in the octants, and so the labels of the voxels
    /// there. Half a voxel away along long sides, their circumspheres would hold other samples.
    /// Neighbours share such points in cubes, where these are told more often. Intensities and
    /// probabilities say themselves what is joined, and know no voxels: with these there are none.
    /// Smoothed labels have no contacts.
    ///
    /// # Errors
    /// What `visit` returns; the first ends the visit.
    pub fn visit_features<'b>(
        &self,
        row: impl Into<BrickRow<'b>>,
        mut visit: impl FnMut(FeaturePoint, DVec3) -> Result<()>,
    ) -> Result<()> {
        let oracle = self.oracle;
        if !oracle.knows_voxels() {
            return Ok(());
        }
        oracle.visit_mixed_cells(row.into(), |cell| {
            match self.joined(cell) {
                Some(0..CORNER_JOINED) => {
                    self.visit_sides(cell, &mut |p| visit(FeaturePoint::Narrow, p))?
                }
                Some(CORNER_JOINED) if oracle.at(cell).id() != 0 => {
                    self.visit_sides(cell, &mut |p| visit(FeaturePoint::Corner, p))?;
                }
                _ => {}
            }
            for contact in oracle.contacts_of(cell) {
                visit(FeaturePoint::Contact, oracle.near_half(contact))?;
                for axis in 0..3 {
                    for beside in [step(contact, axis, -1), step(contact, axis, 1)] {
                        if oracle.is_between_walls(beside) {
                            visit(FeaturePoint::Around, oracle.near_contact(contact, beside))?;
                        }
                    }
                }
            }
            Ok(())
        })
    }

    /// How many of the six voxels beside one, not outermost, have its label; labels go on beyond
    /// walls.
    #[inline(always)]
    fn joined(&self, voxel: [usize; 3]) -> Option<u32> {
        const BESIDE: u32 = 1 << 1 | 1 << 2 | 1 << 4;
        if voxel.contains(&0) {
            return None;
        }
        let record = self.oracle.at(voxel);
        let below =
            (0..3).filter(|&axis| self.oracle.at(step(voxel, axis, -1)).id() == record.id());
        let beside = (record.first_corners() & BESIDE).count_ones() + below.count() as u32;
        let of_object = self.oracle.walls.has_walls && record.id() != 0;
        let beyond = if of_object { self.oracle.walls.faces_of(voxel) } else { 0 };
        Some(beside + beyond)
    }

    /// Where dO crosses the edges from a voxel, not outermost, to those beside it.
    fn visit_sides(
        &self,
        voxel: [usize; 3],
        visit: &mut impl FnMut(DVec3) -> Result<()>,
    ) -> Result<()> {
        for axis in 0..3 {
            for from in [step(voxel, axis, -1), voxel] {
                let ids = [from, step(from, axis, 1)].map(|v| self.oracle.at(v).id());
                if ids[0] == ids[1] {
                    continue;
                }
                // The four in a plane: two to one side of it, two to the other.
                let backwards = [0, 1, 2].map(|a| a == (axis + 1) % 3);
                let mut x = moved(
                    DVec3::from(voxel.map(|c| c as f64)),
                    backwards,
                    hash(from) >> (4 * axis),
                );
                if self.searches {
                    // On the edge itself: beside it the smoothed surface may be elsewhere.
                    let ends =
                        [from, step(from, axis, 1)].map(|v| DVec3::from(v.map(|c| c as f64)));
                    let Some((crossing, _)) = self.oracle.trace(ends[0], ends[1], ids[0]) else {
                        continue;
                    };
                    x = crossing;
                } else {
                    x[axis] = self.oracle.crossing_between(from[axis] as f64, axis, ids);
                }
                visit(self.oracle.grid.point_at(x))?;
            }
        }
        Ok(())
    }

    /// The edges from a voxel to the next one along each axis; all belong to the cell from this
    /// voxel on.
    #[inline(always)]
    fn visit_edges_of(
        &self,
        voxel: [usize; 3],
        division: &Division,
        visit: &mut impl FnMut(CrossedEdge) -> Result<()>,
    ) -> Result<()> {
        for axis in 0..3 {
            if let Some(crossing) = self.crossing_of(voxel, axis) {
                let ends = [voxel, step(voxel, axis, 1)].map(|v| DVec3::from(v.map(|c| c as f64)));
                let point = self.oracle.grid.point_at(crossing);
                visit(CrossedEdge { point, spacing: division.spacing, ends, axis })?;
            }
        }
        Ok(())
    }

    /// The parts of edges that belong to the cell from a voxel on, those of its upper faces left to
    /// the next cells.
    fn visit_parts_of(
        &self,
        voxel: [usize; 3],
        &Division { spacing, parts }: &Division,
        visit: &mut impl FnMut(CrossedEdge) -> Result<()>,
    ) -> Result<()> {
        let oracle = self.oracle;
        let place = |part: [usize; 3]| {
            DVec3::from_array([0, 1, 2].map(|a| voxel[a] as f64 + part[a] as f64 / parts[a] as f64))
        };
        for z in 0..parts[2] {
            for y in 0..parts[1] {
                for x in 0..parts[0] {
                    let part = [x, y, z];
                    let from = place(part);
                    let mut label = None;
                    for axis in 0..3 {
                        let mut next = part;
                        next[axis] += 1;
                        let to = place(next);
                        let is_of_grid = (0..3).all(|a| a == axis || part[a] == 0);
                        let crossing = if is_of_grid && !self.searches {
                            self.crossing_of(voxel, axis).filter(|x| {
                                let crossed =
                                    ((x[axis] - voxel[axis] as f64) * parts[axis] as f64) as usize;
                                crossed.min(parts[axis] - 1) == part[axis]
                            })
                        } else {
                            let label = *label.get_or_insert_with(|| oracle.label_at(from));
                            let differs = oracle.label_at(to) != label;
                            differs
                                .then(|| oracle.trace(from, to, label))
                                .flatten()
                                .map(|(crossing, _)| crossing)
                        };
                        if let Some(crossing) = crossing {
                            let point = oracle.grid.point_at(crossing);
                            visit(CrossedEdge { point, spacing, ends: [from, to], axis })?;
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Where dO crosses the edge from a voxel to the next one along an axis.
    #[inline(always)]
    fn crossing_of(&self, voxel: [usize; 3], axis: usize) -> Option<DVec3> {
        let ids = [voxel, step(voxel, axis, 1)].map(|v| self.oracle.at(v).id());
        if ids[0] == ids[1] {
            return None;
        }
        let mut x = DVec3::from(voxel.map(|c| c as f64));
        x[axis] = self.oracle.crossing_between(x[axis], axis, ids);
        Some(x)
    }
}

/// The place one step away along an axis.
#[inline(always)]
fn step(from: [usize; 3], axis: usize, by: isize) -> [usize; 3] {
    [0, 1, 2].map(|a| if a == axis { from[a].wrapping_add_signed(by) } else { from[a] })
}

/// A point, in region coordinates, moved a little: backwards along the axes that are given.
fn moved(x: DVec3, backwards: [bool; 3], random: u64) -> DVec3 {
    let by = |a: usize| {
        let part = (random >> (16 * a) & 0xffff) as f64 / f64::from(1 << 16);
        let by = MIN_MOVE + (MAX_MOVE - MIN_MOVE) * part;
        if backwards[a] { -by } else { by }
    };
    x + DVec3::new(by(0), by(1), by(2))
}

impl Oracle {
    /// Where the first voxel of the cell is to which an edge belongs.
    pub fn first_voxel(&self, edge: &CrossedEdge) -> DVec3 {
        // Not below 0, and no part of a cell lies on the next cell's faces.
        let [x, y, z] = edge.ends[0].to_array().map(|c| c as usize);
        self.grid.point_at(DVec3::from([x, y, z].map(|c| c as f64)))
    }

    /// Rows of bricks of voxels.
    pub fn rows(&self) -> usize {
        let [_, ny, nz] = self.grid.bricks.dims();
        ny.div_ceil(Bricks::EDGE) * nz.div_ceil(Bricks::EDGE)
    }

    /// Whether a point, given in half voxels, is not outside of a wall.
    fn is_between_walls(&self, half: [usize; 3]) -> bool {
        let at = half.map(|h| h as f64 / 2.0);
        (0..3).all(|a| at[a] >= self.walls.first[a] && at[a] <= self.walls.last[a])
    }

    /// Calls `visit` for points, in world coordinates, that belong to a label other than the
    /// background, given by its id, in the surface model: one just beside each contact for each
    /// voxel there, and halfway from the centre of a cell that is one to those on the cell's
    /// faces, between which a body would else have a hole. So the body of each of these voxels
    /// reaches the contact, not only that of one. Of one row; a point may come more often.
    ///
    /// # Errors
    /// What `visit` returns; the first ends the visit.
    pub fn visit_joins(
        &self,
        row: usize,
        mut visit: impl FnMut(u16, DVec3) -> Result<()>,
    ) -> Result<()> {
        if self.field.is_some() {
            return Ok(());
        }
        self.visit_mixed_cells(row.into(), |cell| {
            let contacts = self.at(cell).contacts();
            if contacts == Contacts::None {
                return Ok(());
            }
            let corners = self.corners(cell);
            let center = cell.map(|c| 2 * c + 1);
            let has_center = contacts == Contacts::Center && self.is_between_walls(center);
            let at = |half: [usize; 3]| DVec3::from(half.map(|h| h as f64 / 2.0));
            // From the cell's centre to that of a voxel.
            let way = |c: usize| DVec3::from([0, 1, 2].map(|a| (c >> a & 1) as f64 - 0.5));
            let mut tell = |id: u16, x: DVec3, way: DVec3| match id {
                0 => Ok(()),
                id => visit(id, self.grid.point_at(x + BESIDE_CONTACT * way)),
            };
            // The voxels whose bodies reach the centre.
            let mut at_center = [false; 8];
            for axis in 0..3 {
                for (side, by) in [(0, -1), (1, 1)] {
                    let face = contacts::FACES[axis][side];
                    let half = step(center, axis, by);
                    if !contacts::alternates(&corners, face) || !self.is_between_walls(half) {
                        continue;
                    }
                    for c in face {
                        let mut across = way(c);
                        across[axis] = 0.0;
                        // The upper one is the next cell's.
                        if side == 0 {
                            tell(corners[c], at(half), across)?;
                        }
                        if has_center {
                            tell(corners[c], at(half).midpoint(at(center)), across)?;
                            at_center[c] = true;
                        }
                    }
                }
            }
            if has_center {
                let needs =
                    |&c: &usize| at_center[c] || contacts::needs_center_of(&corners, corners[c]);
                (0..8).filter(needs).try_for_each(|c| tell(corners[c], at(center), way(c)))?;
            }
            Ok(())
        })
    }

    /// Whether a contact may be within a voxel of a point.
    pub fn is_near_contact(&self, p: DVec3) -> bool {
        let x = self.grid.index_at(p);
        (0..8).any(|c| {
            let beside = DVec3::from([0, 1, 2].map(|a| if c >> a & 1 == 1 { 0.5 } else { -0.5 }));
            self.at(self.grid.cell(self.grid.inside(x + beside))).contacts() != Contacts::None
        })
    }
}

impl Oracle {
    /// Calls `visit` for the mixed cells of one row of bricks of voxels, brick after brick.
    #[inline(always)]
    pub(crate) fn visit_mixed_cells(
        &self,
        row: BrickRow<'_>,
        visit: impl FnMut([usize; 3]) -> Result<()>,
    ) -> Result<()> {
        let is_mixed = |cell: [usize; 3]| {
            let [i, j, k] = cell;
            let along_x = &self.voxels[self.grid.bricks.index(i, j, k)..][..Bricks::EDGE];
            let bits = along_x
                .iter()
                .enumerate()
                .fold(0, |bits, (n, voxel)| bits | u64::from(voxel.rings() == 0) << n);
            // Beyond the last cell are voxels without one, and those by which bricks are filled up.
            bits & ((1 << (self.grid.bricks.dims()[0] - 1 - i).min(Bricks::EDGE)) - 1)
        };
        self.visit_cells(row, is_mixed, visit)
    }

    /// As [`Self::visit_mixed_cells`], for those cells that can have points of junctions.
    #[inline(always)]
    pub(crate) fn visit_junction_cells(
        &self,
        row: BrickRow<'_>,
        visit: impl FnMut([usize; 3]) -> Result<()>,
    ) -> Result<()> {
        self.visit_cells(row, |cell| self.junction_cells.bits(cell, Bricks::EDGE), visit)
    }

    /// Calls `visit` for cells of one row of bricks, brick after brick: those that `among` tells,
    /// by bits, of the cells of a brick from one on along x.
    #[inline(always)]
    fn visit_cells(
        &self,
        BrickRow { number, among: bricks }: BrickRow<'_>,
        among: impl Fn([usize; 3]) -> u64,
        mut visit: impl FnMut([usize; 3]) -> Result<()>,
    ) -> Result<()> {
        let [nx, ny, nz] = self.grid.bricks.dims();
        let per_layer = nz.div_ceil(Bricks::EDGE);
        let along = |brick: usize, count: usize| {
            brick * Bricks::EDGE..((brick + 1) * Bricks::EDGE).min(count - 1)
        };
        let [y, z] = [number / per_layer, number % per_layer];
        for first in (0..nx - 1).step_by(Bricks::EDGE) {
            let brick = [first, Bricks::EDGE * y, Bricks::EDGE * z];
            if bricks.is_some_and(|bricks| !bricks.has_voxel(brick)) {
                continue;
            }
            for j in along(y, ny) {
                for k in along(z, nz) {
                    for n in ones(among([first, j, k])) {
                        visit([first + n, j, k])?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Where the label changes between two voxel centres of these labels, from `at` to `at + 1`
    /// along an axis.
    fn crossing_between(&self, at: f64, axis: usize, ids: [u16; 2]) -> f64 {
        // Beyond the outermost centres that count there is no interpolation: the crossing is on the
        // wall.
        if at < self.border.first[axis] {
            return self.border.lower[axis];
        }
        if at >= self.border.last[axis] {
            return self.border.upper[axis];
        }
        let [here, there] =
            ids.map(|id| self.weights.get(usize::from(id)).map_or(1.0, |&w| f64::from(w)));
        at + here / (here + there)
    }

    /// How far along the edge between the centres of two voxels that differ dO crosses it first, 0
    /// to 1: the first has index `voxel` (-1 outside of the image), the second the next one along
    /// `axis`; their dense ids are `ids`.
    pub fn crossed_at(&self, voxel: [isize; 3], axis: usize, ids: [u16; 2]) -> f64 {
        let at = DVec3::from([0, 1, 2].map(|a| (voxel[a] - self.grid.first[a]) as f64));
        if self.field.is_none() {
            return self.crossing_between(at[axis], axis, ids) - at[axis];
        }
        let mut next = at;
        next[axis] += 1.0;
        // Two voxels that differ have a crossing.
        self.trace(at, next, ids[0]).map_or(0.5, |(x, _)| x[axis] - at[axis])
    }

    /// The crossing of the segment beside a crossed edge, moved by `offset` (world units, along the
    /// image axes that are not the edge's). `None` where the ends of that segment have the same
    /// label.
    pub fn crossing_beside(&self, edge: &CrossedEdge, offset: [f64; 2]) -> Option<DVec3> {
        let mut shift = DVec3::ZERO;
        for (axis, offset) in [(edge.axis + 1) % 3, (edge.axis + 2) % 3].into_iter().zip(offset) {
            shift[axis] = offset / self.grid.spacing[axis];
        }
        let [from, to] = edge.ends.map(|end| end + shift);
        let label = self.label_at(from);
        if label == self.label_at(to) {
            return None;
        }
        self.trace(from, to, label).map(|(x, _)| self.grid.point_at(x))
    }
}
