//! The region: the bounding box of the object and one voxel more on each side, filled with what the queries need of each voxel.

use rayon::prelude::*;

use super::{
    Voxel,
    border::Border,
    corners,
    rings::Rings,
    weights::{Sampling, Tally},
};
use crate::{
    Error, Result,
    distance::{Bricks, FeatureTransform},
    image::LabelImage,
    memory::filled,
};

/// First voxel (may be -1) and dims of the object's bounding box with one voxel more on each side.
pub(super) fn region(image: &LabelImage, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<([isize; 3], [usize; 3])> {
    let [nx, ny, _] = image.dims();
    let empty = ([usize::MAX; 3], [0; 3]);
    let join = |a: ([usize; 3], [usize; 3]), b: ([usize; 3], [usize; 3])| {
        ([0, 1, 2].map(|i| a.0[i].min(b.0[i])), [0, 1, 2].map(|i| a.1[i].max(b.1[i])))
    };
    let (low, high) = image
        .ids()
        .par_chunks(nx * ny)
        .enumerate()
        .map(|(z, plane)| {
            check()?;
            let mut bounds = empty;
            for (y, row) in plane.chunks(nx).enumerate() {
                if let Some(left) = row.iter().position(|&id| id != 0) {
                    let right = row.iter().rposition(|&id| id != 0).unwrap_or(left);
                    bounds = join(bounds, ([left, y, z], [right, y, z]));
                }
            }
            Ok(bounds)
        })
        .try_reduce(|| empty, |a, b| Ok(join(a, b)))?;
    if low[0] > high[0] {
        return Err(Error::EmptyImage);
    }
    Ok((low.map(|c| c as isize - 1), [0, 1, 2].map(|a| high[a] - low[a] + 3)))
}

/// The voxels of the region in the bricked layout, without their distances.
pub(super) fn region_voxels(
    image: &LabelImage,
    first: [isize; 3],
    bricks: &Bricks,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<Voxel>> {
    let [nx, ny, nz] = image.dims();
    let dims = bricks.dims();
    let mut voxels = filled(bricks.len(), Voxel::default(), "voxels of the label volume", check)?;
    voxels.par_chunks_mut(bricks.layer()).enumerate().try_for_each(|(layer, out)| {
        let base = layer * Bricks::EDGE;
        for j in base..(base + Bricks::EDGE).min(dims[1]) {
            check()?;
            for k in 0..dims[2] {
                let (Some(y), Some(z)) = (inside(first[1], j, ny), inside(first[2], k, nz)) else {
                    continue;
                };
                let at = bricks.y(j) + bricks.z(k) - layer * bricks.layer();
                for i in 0..dims[0] {
                    if let Some(x) = inside(first[0], i, nx) {
                        out[at + bricks.x(i)].id = image.ids()[x + nx * (y + ny * z)];
                    }
                }
            }
        }
        Ok(())
    })?;
    Ok(voxels)
}

/// Image coordinate of a region coordinate, when it is in the image.
fn inside(first: isize, at: usize, count: usize) -> Option<usize> {
    first.checked_add_unsigned(at).and_then(|c| usize::try_from(c).ok()).filter(|&c| c < count)
}

/// Marks the surface voxels of a row. Outside the region is background, as its outermost voxels are, so a neighbour there never differs.
pub(super) fn mark_surface(voxels: &[Voxel], bricks: &Bricks, y: usize, z: usize, row: &mut [bool]) {
    let [nx, ny, nz] = bricks.dims();
    let at = bricks.y(y) + bricks.z(z);
    let beside = [
        bricks.y(y.saturating_sub(1)) + bricks.z(z),
        bricks.y((y + 1).min(ny - 1)) + bricks.z(z),
        bricks.y(y) + bricks.z(z.saturating_sub(1)),
        bricks.y(y) + bricks.z((z + 1).min(nz - 1)),
    ];
    let mut previous = voxels[at].id;
    for (x, is_site) in row.iter_mut().enumerate() {
        let column = bricks.x(x);
        let id = voxels[at + column].id;
        let next = voxels[at + bricks.x((x + 1).min(nx - 1))].id;
        *is_site = previous != id || next != id || beside.iter().any(|&b| voxels[b + column].id != id);
        previous = id;
    }
}

/// Fills in rings and distances.
pub(super) fn set_room(
    voxels: &mut [Voxel],
    rings: Option<Rings>,
    features: &FeatureTransform,
    quantum: f64,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<()> {
    let bricks = features.bricks();
    let [nx, ny, nz] = bricks.dims();
    voxels.par_chunks_mut(bricks.layer()).enumerate().try_for_each(|(layer, out)| {
        let base = layer * Bricks::EDGE;
        for j in base..(base + Bricks::EDGE).min(ny) {
            check()?;
            for k in 0..nz {
                let rings = rings.as_ref().map(|rings| rings.row(j, k));
                for i in 0..nx {
                    let at = bricks.index(i, j, k) - layer * bricks.layer();
                    let distance = ((features.distance(i, j, k) / quantum) as u16).min(Voxel::DISTANCES);
                    out[at].room = Voxel::pack(rings.as_ref().map_or(0, |rings| rings(i)), distance);
                }
            }
        }
        Ok(())
    })
}

/// The weights of `labels` dense ids, for voxels whose rings are filled in.
pub(super) fn calibrate(
    voxels: &[Voxel],
    bricks: &Bricks,
    border: &Border,
    labels: usize,
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<f32>> {
    // Every fourth voxel along each axis: enough to tell large labels from small ones.
    const STEP: usize = 4;
    let [nx, ny, nz] = bricks.dims();
    let mut counts = vec![0_u64; labels];
    for j in (0..ny).step_by(STEP) {
        for k in (0..nz).step_by(STEP) {
            for i in (0..nx).step_by(STEP) {
                counts[usize::from(voxels[bricks.index(i, j, k)].id)] += (STEP * STEP * STEP) as u64;
            }
        }
    }
    let sampling = Sampling::new(counts.into_iter());
    let layer = |mut tally, j: usize| {
        check()?;
        for k in 0..nz - 1 {
            for i in 0..nx - 1 {
                if voxels[bricks.index(i, j, k)].rings() == 0 {
                    Tally::add(&mut tally, border, [i, j, k], &corners(voxels, bricks, [i, j, k]))?;
                }
            }
        }
        Ok(tally)
    };
    let none = || Tally::new(&sampling);
    let tally = (0..ny - 1).into_par_iter().try_fold(none, layer).try_reduce(none, Tally::merge)?;
    tally.weights(&|| check())
}
