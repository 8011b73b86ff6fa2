//! Where a label's mesh touches itself and its voxels do not, and where voxels touch and the mesh
//! does not.
//!
//! Voxels of a label that have an edge or a corner alone in common are joined there. The surface
//! model has them touch in *contacts* (`oracle/model/contacts`), which refinement samples where
//! samples are near enough to each other. A contact, or a point halfway between two of one cell, is
//! *open* when the label of a voxel there has no tet just beside it, on this voxel's side. Where
//! labels touch elsewhere, in an edge or a vertex of the mesh, samples are too far apart.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::boundary_surface::NonManifold;
use super::voxel_labels::{Corners, planes_of};
use crate::Result;
use crate::image::LabelImage;
use crate::image::bits::masks;
use crate::image::region::Region;
use crate::image::voxel_blocks::VoxelBlocks;
use crate::memory::{concatenated, reserve, room, zeroed};
use crate::mesh::TetMesh;
use crate::monitor::Monitor;
use crate::oracle::Oracle;

/// Vertices on contacts are this far from them at most, in voxels: the oracle moves them by 0.02
/// along each axis.
const AT_CONTACT: f64 = 0.05;

/// A touch so near to an edge or a corner that voxels have in common, in voxels, is theirs.
const NEAR: f64 = 0.2;

/// A place that the closed body of a label is to reach.
#[derive(Clone, Copy, Debug)]
struct Join {
    /// The number of the voxel behind which it lies.
    cell: u64,
    id: u16,
    /// In voxels of the image.
    index: DVec3,
}

/// The contacts of an image, and which of them a mesh reaches.
pub(super) struct Contacts {
    dims: [usize; 3],
    /// By cell.
    joins: Vec<Join>,
    reached: Vec<AtomicBool>,
    /// For each cell whether it has some.
    cells: Vec<u64>,
    /// How many there are before each 64 cells, and in all.
    firsts: Vec<u32>,
    /// The blocks around them: most tets are far from all.
    blocks: VoxelBlocks,
    region: Region,
}

impl Contacts {
    /// Those of all labels of an image.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); [`Cancelled`](crate::Error::Cancelled).
    pub fn new(
        image: &LabelImage,
        region: Region,
        oracle: &Oracle,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        // One more, for what is half a voxel before the first.
        let dims = image.dims().map(|n| n + 1);
        let rows = (0..oracle.rows()).into_par_iter().map(|row| {
            monitor.advance(0)?;
            let mut joins = Vec::new();
            oracle.visit_joins(row, |id, p| {
                let index = image.frame().to_index(p);
                if let Some(cell) = cell_of(index, dims) {
                    reserve(&mut joins, 1, "contacts")?;
                    joins.push(Join { cell, id, index });
                }
                Ok(())
            })?;
            Ok(joins)
        });
        let mut joins: Vec<Join> = concatenated(rows.collect::<Result<_>>()?, "contacts")?;
        joins.par_sort_by_key(|join| join.cell);
        let count = dims.iter().product::<usize>();
        let mut cells = zeroed::<u64>(count.div_ceil(64), "cells of the image")?;
        joins.iter().for_each(|join| cells[join.cell as usize / 64] |= 1 << (join.cell % 64));
        let mut firsts: Vec<u32> = room(cells.len() + 1, "cells of the image")?;
        let mut next = 0;
        firsts.extend((0..=cells.len() as u64).map(|word| {
            next += joins[next..].iter().take_while(|join| join.cell < 64 * word).count();
            next as u32
        }));
        let blocks = VoxelBlocks::none(image.frame(), &region)?;
        joins.iter().for_each(|join| blocks.add_box([region.offset(join.index); 2]));
        let reached = zeroed(joins.len(), "contacts")?;
        Ok(Self { dims, joins, reached, cells, firsts, blocks, region })
    }

    /// Calls `visit` for the contacts in the cells of a box, with their numbers.
    fn visit(&self, low: DVec3, high: DVec3, visit: impl Fn(usize, &Join)) {
        // Cells begin a voxel before the first one; what is below 0 falls to 0.
        let [from, to] = [low, high].map(|p| (p + 1.0).to_array().map(|c| c as usize));
        let range = |a: usize| from[a]..(to[a] + 1).min(self.dims[a]);
        if (0..3).any(|a| range(a).is_empty()) {
            return;
        }
        let [nx, ny, _] = self.dims;
        for z in range(2) {
            for y in range(1) {
                let row = nx * (y + ny * z);
                for (word, mask) in masks(&(row + range(0).start..row + range(0).end)) {
                    if self.cells[word] & mask != 0 {
                        let [from, to] = [word, word + 1].map(|word| self.firsts[word] as usize);
                        let is_here = |join: &Join| mask >> (join.cell % 64) & 1 == 1;
                        let joins = (from..to).zip(&self.joins[from..to]);
                        joins
                            .filter(|(_, join)| is_here(join))
                            .for_each(|(n, join)| visit(n, join));
                    }
                }
            }
        }
    }

    /// Forgets what is known of those in places where the mesh has changed: the tets near to these
    /// are to be added.
    pub fn forget(&mut self, has_changed: impl Fn(DVec3) -> bool) {
        for (join, reached) in self.joins.iter().zip(&mut self.reached) {
            *reached.get_mut() &= !has_changed(join.index);
        }
    }

    /// Adds a tet of the mesh, of the label `id`.
    #[inline]
    pub fn add(&self, id: u16, corners: &Corners) {
        // Blocks have a larger margin than `AT_CONTACT`.
        if !self.blocks.meet(corners.bounds.map(|p| self.region.offset(p))) {
            return;
        }
        let [low, high] = corners.bounds;
        let (low, high) = (low - AT_CONTACT, high + AT_CONTACT);
        self.visit(low, high, |n, join| {
            // Planes that are moved out meet far from a tet where it is sharp.
            let is_near = || join.index.cmpge(low).all() && join.index.cmple(high).all();
            if join.id == id && is_near() && reaches(&corners.points, join.index) {
                // Relaxed: read when all is done.
                self.reached[n].store(true, Relaxed);
            }
        });
    }

    /// Those that the mesh does not reach, in voxels, with the ids of their labels.
    pub fn open(&self) -> impl Iterator<Item = (u16, DVec3)> {
        let open = self.joins.iter().zip(&self.reached);
        open.filter(|(_, reached)| !reached.load(Relaxed)).map(|(join, _)| (join.id, join.index))
    }
}

/// Those of `places` in which labels other than 0 touch and their voxels do not, in voxels, with
/// the ids of these labels.
pub(super) fn stray_touches(
    places: &[NonManifold],
    mesh: &TetMesh,
    image: &LabelImage,
) -> Vec<(u16, DVec3)> {
    let stray = |place: &NonManifold| {
        let id = image.id_of(place.label).filter(|&id| id != 0)?;
        let [from, to] = place.ends.map(|v| image.frame().to_index(mesh.point(v)));
        let index = from.midpoint(to);
        (!voxels_touch(image, id, index)).then_some((id, index))
    };
    places.iter().filter_map(stray).collect()
}

/// Whether voxels of a label have an edge or a corner alone in common near a point.
fn voxels_touch(image: &LabelImage, id: u16, index: DVec3) -> bool {
    let dims = image.dims();
    let has = |at: [i64; 3]| {
        let inside = (0..3).all(|a| (0..dims[a] as i64).contains(&at[a]));
        let [x, y, z] = at.map(|c| c as usize);
        inside && image.ids()[x + dims[0] * (y + dims[1] * z)] == id
    };
    // The voxels before the edges and corners around.
    let first = index.floor().as_i64vec3().to_array();
    (0..27).any(|n| {
        let at = [0, 1, 2].map(|a| first[a] + n / [1, 3, 9][a] % 3 - 1);
        let corner = DVec3::from(at.map(|c| c as f64 + 0.5));
        let beside = |by: i64| has([0, 1, 2].map(|a| at[a] + (by >> a & 1)));
        let is_corner = || (0..4).any(|c| beside(c) && beside(7 - c));
        (corner.distance(index) < NEAR && is_corner())
            || (0..3).any(|axis| {
                // The edge along an axis that leads through the voxel's middle plane.
                let mut apart = index - corner;
                apart[axis] = ((apart[axis] + 0.5).abs() - 0.5).max(0.0);
                let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
                let around = [0, u, v, u | v].map(beside);
                let alternates = around[0] == around[3] && around[1] == around[2];
                apart.length() < NEAR && alternates && around[0] != around[1]
            })
    })
}

/// The number of the cell of a point; one along each axis lies before the first voxel.
fn cell_of(index: DVec3, dims: [usize; 3]) -> Option<u64> {
    let at = index + 1.0;
    let inside = (0..3).all(|a| at[a] >= 0.0 && at[a] < dims[a] as f64);
    let [x, y, z] = at.to_array().map(|c| c as u64);
    inside.then_some(x + dims[0] as u64 * (y + dims[1] as u64 * z))
}

/// Whether a tet, or its planes moved out by [`AT_CONTACT`], holds a point.
fn reaches(corners: &[DVec3; 4], p: DVec3) -> bool {
    let planes = planes_of(corners);
    planes.iter().all(|(normal, offset)| normal.dot(p) + offset >= -AT_CONTACT * normal.length())
}
