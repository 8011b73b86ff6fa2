//! Which cells are mixed, and which are near those: sets of cells as rows of bits, 64 cells at a
//! time.
//!
//! A cell is *uniform* when its eight corners have one label, *mixed* otherwise. dO lies in the
//! mixed cells, in both surface models. A uniform cell has one *ring*; it has n + 1 when it and the
//! 26 cells around it have n. As neighbouring uniform cells share corners, all cells within the
//! rings have the same label, and dO is no nearer than the faces of that block of cells. This holds
//! as well where a cell outside of the region would be needed: there all is background, as the
//! outermost voxels are.
//!
//! Cost: about a nanosecond per voxel.

use rayon::prelude::*;

use crate::image::bits::gathered;
use crate::image::region::Rows;
use crate::{Result, memory::zeroed};

/// A set of cells of the region; bit i of row (j, k) is the cell between voxels (i, j, k) and (i +
/// 1, j + 1, k + 1). There is a row for each row of voxels; the last cell of each axis lies outside
/// of the region, and is uniform.
#[derive(Clone, Debug)]
pub(crate) struct Cells {
    words: usize,
    rows: [usize; 2],
    bits: Vec<u64>,
}

impl Cells {
    /// The mixed cells.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub(crate) fn mixed(voxels: &Rows, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let [nx, ny, nz] = voxels.dims();
        let words = nx.div_ceil(64);
        let mut bits: Vec<u64> = zeroed(words * ny * nz, "words of the sets of cells")?;
        bits.par_chunks_mut(words * nz).enumerate().take(ny - 1).try_for_each(|(j, layer)| {
            check()?;
            for (k, row) in layer.chunks_mut(words).enumerate().take(nz - 1) {
                let rows = voxels.around(j, k);
                for (w, word) in row.iter_mut().enumerate() {
                    *word = differ(rows.map(|row| &row[64 * w..64 * w + 65]));
                }
            }
            Ok(())
        })?;
        Ok(Self { words, rows: [ny, nz], bits })
    }

    /// The words of all rows of each `count` layers of cells, one after the other.
    pub(crate) fn layers_mut(
        &mut self,
        count: usize,
    ) -> impl IndexedParallelIterator<Item = &mut [u64]> {
        self.bits.par_chunks_mut(self.words * self.rows[1] * count)
    }

    /// A bit for each of `count` cells from `first` on, at most 64: whether it is in the set.
    #[inline]
    pub(crate) fn bits(&self, [i, j, k]: [usize; 3], count: usize) -> u64 {
        let row = self.row(j, k);
        let word = |w: usize| row.get(w).copied().unwrap_or(0);
        let (w, shift) = (i / 64, i % 64);
        // The word after it, by two shifts: one by 64 would be none.
        (word(w) >> shift | word(w + 1) << 1 << (63 - shift)) & (u64::MAX >> (64 - count))
    }

    /// Bytes of memory held.
    pub(crate) fn held(&self) -> usize {
        size_of::<u64>() * self.bits.len()
    }

    /// Bytes that one set of a region of `dims` voxels takes.
    pub(crate) fn bytes([nx, ny, nz]: [usize; 3]) -> u64 {
        size_of::<u64>() as u64 * nx.div_ceil(64) as u64 * ny as u64 * nz as u64
    }

    #[inline]
    pub(crate) fn row(&self, j: usize, k: usize) -> &[u64] {
        &self.bits[(j * self.rows[1] + k) * self.words..][..self.words]
    }

    /// The cells of the set and the 26 around each.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`]; whatever `check` returns.
    pub(crate) fn dilated(&self, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let [ny, nz] = self.rows;
        let mut bits: Vec<u64> = zeroed(self.bits.len(), "words of the sets of cells")?;
        bits.par_chunks_mut(self.words * nz).enumerate().try_for_each(|(j, layer)| {
            check()?;
            for (k, out) in layer.chunks_mut(self.words).enumerate() {
                for j in j.saturating_sub(1)..(j + 2).min(ny) {
                    for k in k.saturating_sub(1)..(k + 2).min(nz) {
                        out.iter_mut().zip(self.row(j, k)).for_each(|(out, row)| *out |= row);
                    }
                }
                // Along x last: each word's first and last bit look at the words beside it.
                let mut before = 0;
                for w in 0..out.len() {
                    let (word, after) = (out[w], out.get(w + 1).map_or(0, |next| next & 1));
                    out[w] |= word << 1 | before | word >> 1 | after << 63;
                    before = word >> 63;
                }
            }
            Ok(())
        })?;
        Ok(Self { bits, ..*self })
    }
}

/// A bit for each of 64 cells: whether its corners differ.
#[inline]
fn differ(rows: [&[u16]; 4]) -> u64 {
    let [a, b, c, d] = rows.map(|row| &row[..65]);
    // Bytes first, which vectorises.
    let flags: [u8; 64] = std::array::from_fn(|i| {
        let id = a[i];
        let near = (id ^ a[i + 1]) | (id ^ b[i]) | (id ^ b[i + 1]);
        let far = (id ^ c[i]) | (id ^ c[i + 1]) | (id ^ d[i]) | (id ^ d[i + 1]);
        u8::from(near | far != 0)
    });
    gathered(&flags)
}
