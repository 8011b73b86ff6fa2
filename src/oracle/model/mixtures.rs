//! Fields of labels with shares: at each voxel centre some labels have a part of the voxel, and the
//! one with the largest part has the voxel.
//!
//! Kept are the shares of the voxels at the corners of mixed cells, all others are never looked at,
//! and of each voxel the largest few. Which are kept belongs to the voxel, not to a cell, so that
//! neighbouring cells agree on their common face. The voxel's own label is always among them:
//! [`super::field`] relies on that.
//!
//! Memory: 4 bytes per voxel of the region, and 8 per share, of two to three a voxel near
//! interfaces.

use rayon::prelude::*;

use super::smoothing::{Share, Smoothing};
use super::voxel::Voxel;
use crate::image::bricks::Bricks;
use crate::image::region::Region;
use crate::image::{LabelImage, Maps};
use crate::memory::{room, zeroed};
use crate::{Error, Result};

/// Shares kept of a voxel.
pub(crate) const MAX_SHARES: usize = 4;

/// Where shares come from.
pub(crate) enum Source<'a> {
    /// Probability maps, and the dense id of each of their distinct labels that has one.
    Maps(&'a Maps, Vec<Option<u16>>),
    /// Labels of an image, smoothed.
    Smoothed(Smoothing<'a>),
}

impl<'a> Source<'a> {
    pub(crate) fn of_maps(maps: &'a Maps, image: &LabelImage) -> Self {
        Self::Maps(maps, maps.distinct.iter().map(|&label| image.id_of(label)).collect())
    }

    /// The shares of voxel number `voxel` of the image, whose label is `own`.
    fn shares(&self, voxel: usize, own: u16, values: &mut Vec<f32>, shares: &mut Vec<Share>) {
        shares.clear();
        match self {
            Self::Maps(maps, ids) => {
                maps.of_voxel(voxel, values);
                shares.extend(
                    values
                        .iter()
                        .zip(ids)
                        .filter_map(|(&value, id)| id.map(|id| Share { id, value })),
                );
            }
            Self::Smoothed(smoothing) => smoothing.shares(voxel, own, shares),
        }
    }
}

/// The shares of a region's voxels.
#[derive(Clone, Debug)]
pub(crate) struct Mixtures {
    /// Where the shares of each voxel begin, in the bricked layout; and at the end, how many there
    /// are.
    starts: Vec<u32>,
    shares: Vec<Share>,
}

impl Mixtures {
    /// `voxels` are the region's records.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`]; whatever `check` returns.
    pub(crate) fn new(
        source: &Source<'_>,
        image: &LabelImage,
        region: &Region,
        voxels: &[Voxel],
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let bricks = Bricks::new(region.dims);
        let mut starts: Vec<u32> = zeroed(bricks.len() + 1, "places of shares of voxels")?;
        let layer = bricks.layer();
        // First how many shares each voxel has; the shares themselves layer by layer.
        let layers: Vec<Vec<Share>> = starts[..bricks.len()]
            .par_chunks_mut(layer)
            .enumerate()
            .map(|(n, counts)| {
                check()?;
                shares_of_layer(source, image, region, (&bricks, voxels), n * layer, counts, check)
            })
            .collect::<Result<_>>()?;
        let count: usize = layers.iter().map(Vec::len).sum();
        let short = Error::OutOfMemory { count, what: "shares of voxels" };
        if u32::try_from(count).is_err() {
            return Err(short);
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        let mut shares = room(count, "shares of voxels")?;
        layers.iter().for_each(|layer| shares.extend_from_slice(layer));
        Ok(Self { starts, shares })
    }

    /// The shares of the voxel at an address, the largest first; none away from mixed cells.
    #[inline]
    pub(crate) fn of(&self, index: usize) -> &[Share] {
        &self.shares[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Bytes of memory held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.shares[..])
    }
}

/// The shares of the voxels from address `first` on, as many as there are `counts`.
///
/// # Errors
/// [`Error::OutOfMemory`]; whatever `check` returns.
fn shares_of_layer(
    source: &Source<'_>,
    image: &LabelImage,
    region: &Region,
    (bricks, voxels): (&Bricks, &[Voxel]),
    first: usize,
    counts: &mut [u32],
    check: &(dyn Fn() -> Result<()> + Sync),
) -> Result<Vec<Share>> {
    /// Voxels with shares between two questions whether to go on.
    const AT_ONCE: usize = 1 << 10;
    let [nx, ny, _] = image.dims();
    let (mut values, mut of_voxel) = (Vec::new(), Vec::new());
    let (mut all, mut done) = (Vec::new(), 0);
    for (n, count) in counts.iter_mut().enumerate() {
        let voxel = bricks.voxel(first + n);
        if !is_corner_of_mixed(bricks, voxels, voxel) {
            continue;
        }
        let [x, y, z] = [0, 1, 2].map(|a| region.nearest(voxel, a, image.dims()[a]));
        let is_beyond = (0..3).any(|a| region.place(voxel, a, image.dims()[a]).is_none());
        let at = [x, y, z].map(|c| c as isize);
        let in_region = [0, 1, 2].map(|a| (at[a] - region.first[a]) as usize);
        let own = voxels[bricks.index(in_region[0], in_region[1], in_region[2])].id();
        source.shares(x + nx * (y + ny * z), own, &mut values, &mut of_voxel);
        // The own label is first on a tie, too.
        of_voxel.sort_unstable_by(|a, b| {
            b.value.total_cmp(&a.value).then((a.id != own, a.id).cmp(&(b.id != own, b.id)))
        });
        let kept = of_voxel
            .iter()
            .take(MAX_SHARES)
            .filter(|share| share.value > 0.0 || share.id == own)
            .count();
        if is_beyond {
            // Background, so much that it draws level with the nearest voxel's label halfway: see
            // `super::field`.
            let background = of_voxel[..kept]
                .iter()
                .find(|share| share.id == 0)
                .map_or(0.0, |share| share.value);
            let value = of_voxel[0].value - if own == 0 { 0.0 } else { background };
            of_voxel[0] = Share { id: 0, value };
        }
        let kept = if is_beyond { 1 } else { kept };
        all.try_reserve(kept)
            .map_err(|_| Error::OutOfMemory { count: kept, what: "shares of voxels" })?;
        all.extend_from_slice(&of_voxel[..kept]);
        *count = kept as u32;
        done += 1;
        if done % AT_ONCE == 0 {
            check()?;
        }
    }
    Ok(all)
}

/// Whether one of the eight cells around a voxel is mixed; not for the addresses beyond the grid.
fn is_corner_of_mixed(bricks: &Bricks, voxels: &[Voxel], [i, j, k]: [usize; 3]) -> bool {
    let [nx, ny, nz] = bricks.dims();
    let in_grid = i < nx && j < ny && k < nz;
    // Two rings: the cells around this one are uniform.
    in_grid && voxels[bricks.index(i, j, k)].rings() < 2 && (0..8).any(|c| {
        let cell = [i.checked_sub(c & 1), j.checked_sub(c >> 1 & 1), k.checked_sub(c >> 2)];
        matches!(cell, [Some(x), Some(y), Some(z)] if voxels[bricks.index(x, y, z)].rings() == 0)
    })
}
