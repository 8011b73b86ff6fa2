//! How many rings of cells around a cell have one label: clearance near dO.
//!
//! A cell is *uniform* when its eight corners have one label; in the smooth model dO lies in the other cells, the *mixed* ones. A uniform cell has one ring; it has
//! n + 1 when it and the 26 cells around it have n. As neighbouring uniform cells share corners, all cells within the rings have the same label, and dO is no nearer than the faces of
//! that block of cells. This holds as well where a cell outside of the region would be needed: there all is background, as the outermost voxels are.
//!
//! Computed on rows of bits, 64 cells at a time: some milliseconds for 256^3 cells.

use rayon::prelude::*;

use super::Voxel;
use crate::{Result, distance::Bricks, memory::filled};

/// Rings that are told apart.
pub(super) const MOST: usize = 3;

/// A bit for each cell of the region, in rows along x; bit i of row (j, k) is the cell between voxels (i, j, k) and (i + 1, j + 1, k + 1).
struct Cells {
    words: usize,
    rows: [usize; 2],
    bits: Vec<u64>,
}

/// For each cell its number of rings, 0 for a mixed one, at most [`MOST`].
pub(super) struct Rings([Cells; MOST]);

impl Rings {
    pub(super) fn new(voxels: &[Voxel], bricks: &Bricks, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let one = Cells::uniform(voxels, bricks, check)?;
        let two = one.within(check)?;
        let three = two.within(check)?;
        Ok(Self([one, two, three]))
    }

    /// Bytes that the rings of a region of `dims` voxels take.
    pub(super) fn bytes([nx, ny, nz]: [usize; 3]) -> u64 {
        (MOST * size_of::<u64>()) as u64 * nx.div_ceil(64) as u64 * ny as u64 * nz as u64
    }

    /// The rings of the cells in row (j, k), for `i` from 0 on.
    pub(super) fn row(&self, j: usize, k: usize) -> impl Fn(usize) -> u16 {
        let rows = self.0.each_ref().map(|cells| cells.row(j, k));
        move |i| rows.iter().map(|row| (row[i / 64] >> (i % 64) & 1) as u16).sum()
    }
}

impl Cells {
    /// Rows of voxels: the last cell of each axis lies outside of the region, and is uniform.
    fn uniform(voxels: &[Voxel], bricks: &Bricks, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let [nx, ny, nz] = bricks.dims();
        let words = nx.div_ceil(64);
        let mut bits = filled(words * ny * nz, u64::MAX, "words of the rings of cells", check)?;
        bits.par_chunks_mut(words * nz).enumerate().try_for_each(|(j, layer)| {
            check()?;
            if j + 1 == ny {
                return Ok(());
            }
            let gather = |j: usize, k: usize, row: &mut Vec<u16>| {
                let at = bricks.y(j) + bricks.z(k);
                row.clear();
                row.extend((0..nx).map(|i| voxels[at + bricks.x(i)].id));
            };
            let mut near = [Vec::with_capacity(nx), Vec::with_capacity(nx)];
            let mut far = near.clone();
            gather(j, 0, &mut near[0]);
            gather(j + 1, 0, &mut near[1]);
            for (k, row) in layer.chunks_mut(words).enumerate().take(nz - 1) {
                gather(j, k + 1, &mut far[0]);
                gather(j + 1, k + 1, &mut far[1]);
                for i in 0..nx - 1 {
                    let id = near[0][i];
                    let corners = [&near[0], &near[1], &far[0], &far[1]];
                    let differ = corners.iter().fold(0, |all, row| all | (row[i] ^ id) | (row[i + 1] ^ id));
                    row[i / 64] ^= u64::from(differ != 0) << (i % 64);
                }
                std::mem::swap(&mut near, &mut far);
            }
            Ok(())
        })?;
        Ok(Self { words, rows: [ny, nz], bits })
    }

    fn row(&self, j: usize, k: usize) -> &[u64] {
        &self.bits[(j * self.rows[1] + k) * self.words..][..self.words]
    }

    /// The cells whose 26 neighbours are all marked, as they are themselves. Cells outside count as marked.
    fn within(&self, check: &(dyn Fn() -> Result<()> + Sync)) -> Result<Self> {
        let [ny, nz] = self.rows;
        let mut bits = filled(self.bits.len(), u64::MAX, "words of the rings of cells", check)?;
        bits.par_chunks_mut(self.words * nz).enumerate().try_for_each(|(j, layer)| {
            check()?;
            for (k, out) in layer.chunks_mut(self.words).enumerate() {
                for j in j.saturating_sub(1)..(j + 2).min(ny) {
                    for k in k.saturating_sub(1)..(k + 2).min(nz) {
                        out.iter_mut().zip(self.row(j, k)).for_each(|(out, row)| *out &= row);
                    }
                }
                // Along x last: each word's first and last bit look at the words beside it.
                let mut before = 1;
                for w in 0..out.len() {
                    let (word, after) = (out[w], out.get(w + 1).map_or(1, |next| next & 1));
                    out[w] &= (word << 1 | before) & (word >> 1 | after << 63);
                    before = word >> 63;
                }
            }
            Ok(())
        })?;
        Ok(Self { bits, ..*self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_are_those_of_the_definition() {
        let dims = [70, 9, 8];
        let bricks = Bricks::new(dims);
        let mut voxels = vec![Voxel::default(); bricks.len()];
        // Few voxels of another label, at both ends of words too; the outermost ones are background.
        for [i, j, k] in [[5, 4, 4], [40, 1, 6], [62, 3, 3], [68, 7, 1]] {
            voxels[bricks.index(i, j, k)].id = 1;
        }
        let rings = Rings::new(&voxels, &bricks, &|| Ok(())).unwrap();
        let id = |at: [isize; 3]| {
            let inside = (0..3).all(|a| (0..dims[a] as isize).contains(&at[a]));
            if inside { voxels[bricks.index(at[0] as usize, at[1] as usize, at[2] as usize)].id } else { 0 }
        };
        for k in 0..dims[2] - 1 {
            for j in 0..dims[1] - 1 {
                for i in 0..dims[0] - 1 {
                    let corner = [i, j, k].map(|c| c as isize);
                    let is_one_label = |n: isize| {
                        let range = |a: usize| corner[a] - n..=corner[a] + 1 + n;
                        let mut at =
                            range(0).flat_map(|x| range(1).flat_map(move |y| range(2).map(move |z| [x, y, z])));
                        at.all(|at| id(at) == id(corner))
                    };
                    let expected = (0..MOST as isize).take_while(|&n| is_one_label(n)).count();
                    assert_eq!(usize::from(rings.row(j, k)(i)), expected, "cell {i} {j} {k}");
                }
            }
        }
    }
}
