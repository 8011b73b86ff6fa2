//! Samples of the junctions of dO, from which R1 starts: first contacts and what is around them,
//! then the corners where lines meet, then the lines, at equal spacing, and last the sides of
//! narrow voxels.
//!
//! Why their edges then are edges of the mesh: a line is followed by mesh edges where the nearest
//! samples of each of its points are its own. Let its samples be g apart and all others rho or more
//! from these. A point of the line is no more than g/2 from a sample of it, and another sample is
//! at least sqrt(rho^2 - g^2/4) from the line: farther, if rho > g / sqrt(2). Here rho is delta,
//! and g from [`SPACING`] delta on; candidates come one after the other along a line, [`FINENESS`]
//! of the spacing apart, so that g is hardly more than the spacing. Only where two runs of samples
//! along a line meet it may be up to twice that.
//!
//! **Contacts** (`oracle/model/contacts`) are places in which the bodies of labels touch as their
//! voxels do. Each is a sample, with points around it on the lines of the grid, half of a voxel's
//! smallest side away: so it is a vertex whose tets have the labels of the voxels there, if nothing
//! else is inserted within these octahedra.
//!
//! **Narrow voxels** are those that have their label in common with two or fewer of the six beside
//! them: single ones, pairs, rows, and the corners of sheets of one voxel. Where dO crosses the
//! edges to the others is sampled as well: around a single voxel these six points hold a tet with
//! its circumcenter in the voxel, so a component or a cavity of one voxel is not lost, nor one of
//! two whose neighbours' weights leave it little. These come after the lines: where the label of a
//! row of voxels changes, its body is thinnest, and a crossing in the middle of the interface there
//! would keep the line around it from being sampled; then the label around the row would touch
//! itself in this one vertex.
//!
//! Where samples are sparser than that, because sampling does not adapt, they are thinned out like
//! others.
//!
//! Each tile of the image thins out what it has, one colour after the other: see `sampling`. So the
//! samples do not depend on the number of threads.

use glam::DVec3;
use rayon::prelude::*;

use super::{Nets, Wanted, drawn};
use crate::Result;
use crate::memory::{reserve, room};
use crate::oracle::{EdgeGrid, FeaturePoint, JunctionKind, Oracle};
use crate::sizing::Sizing;

/// Distance of samples on junctions, in deltas. At least a half: the proof of termination needs it.
const SPACING: f64 = 0.6;
/// The same around contacts, and narrow voxels.
const CONTACT_SPACING: f64 = 0.5;
/// The same of the corners of the image's box: those there already are not sampled again.
const SAME_PLACE: f64 = 1e-9;
/// Distance of the planes on which candidates lie, in spacings.
const FINENESS: f64 = 0.4;

/// The points of the junctions of a tile, and those of its corner voxels.
#[derive(Default)]
struct Candidates {
    box_corners: Vec<DVec3>,
    contacts: Vec<DVec3>,
    around: Vec<DVec3>,
    narrow: Vec<DVec3>,
    corners: Vec<DVec3>,
    lines: Vec<DVec3>,
    corner_voxels: Vec<DVec3>,
}

/// Notes a point.
fn keep(points: &mut Vec<DVec3>, p: DVec3) -> Result<()> {
    reserve(points, 1, "points of junctions")?;
    points.push(p);
    Ok(())
}

/// Samples the junctions in each tile, where samples are wanted. Returns, for each, the crossings
/// that are to be sampled before others: where dO crosses the edges from corner voxels.
///
/// # Errors
/// [`crate::Error::OutOfMemory`]; those of `go_on`, which is asked once per row of bricks of
/// voxels.
pub(super) fn sample_junctions(
    oracle: &Oracle,
    sizing: &Sizing,
    grid: &EdgeGrid<'_>,
    nets: &Nets<'_>,
    wanted: &Wanted<'_>,
    go_on: &(impl Fn() -> Result<()> + Sync),
) -> Result<Vec<Vec<DVec3>>> {
    let planes =
        oracle.junction_planes(&sizing.palette().map(|spacing| FINENESS * SPACING * spacing));
    let tiles = nets.tiles;
    let of_tile = |(tile, found): (usize, &mut Candidates)| {
        for row in tiles.rows(tile).filter_map(|row| wanted.in_row(row)) {
            go_on()?;
            planes.visit_row(row, |kind, p| match kind {
                JunctionKind::BoxCorner => keep(&mut found.box_corners, p),
                JunctionKind::Corner => keep(&mut found.corners, p),
                JunctionKind::Line => keep(&mut found.lines, p),
            })?;
            grid.visit_features(row, |kind, p| match kind {
                FeaturePoint::Contact => keep(&mut found.contacts, p),
                FeaturePoint::Around => keep(&mut found.around, p),
                FeaturePoint::Narrow => keep(&mut found.narrow, p),
                FeaturePoint::Corner => keep(&mut found.corner_voxels, p),
            })?;
        }
        Ok(())
    };
    let mut found = room(tiles.count(), "points of junctions")?;
    found.resize_with(tiles.count(), Candidates::default);
    // One at a time: those at the rim of the image have next to nothing.
    found.par_iter_mut().enumerate().with_max_len(1).try_for_each(of_tile)?;
    let thin = |part: f64, points: fn(&Candidates) -> &[DVec3], draws: bool| {
        if found.iter().all(|of_tile| points(of_tile).is_empty()) {
            return Ok(());
        }
        let sample = |p: DVec3, spacing: f64| if draws { drawn(oracle, p, spacing) } else { p };
        nets.offer(|tile, net| {
            points(&found[tile]).iter().filter(|&&p| wanted.has(p)).try_for_each(|&p| {
                let spacing = sizing.at(p);
                net.offer(p, part * spacing, || sample(p, spacing))
            })
        })
    };
    // All of them: without one the mesh would not fill its corner of the image.
    thin(SAME_PLACE, |found| &found.box_corners, false)?;
    thin(CONTACT_SPACING, |found| &found.contacts, false)?;
    thin(CONTACT_SPACING, |found| &found.around, false)?;
    thin(SPACING, |found| &found.corners, true)?;
    thin(SPACING, |found| &found.lines, true)?;
    thin(CONTACT_SPACING, |found| &found.narrow, true)?;
    Ok(found.into_iter().map(|found| found.corner_voxels).collect())
}
