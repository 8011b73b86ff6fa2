//! What joins the parts of a label where they are not thin themselves: voxels that meet in an edge
//! or a corner alone, and throats.

use rayon::prelude::*;

use super::runs::{Check, Labels, Set};
use crate::Result;
use crate::image::bits::ones;
use crate::image::region::Rows;
use crate::memory::reserve;

/// A way in which two voxels of a label can meet. Corner c of a cell is at (c & 1, c >> 1 & 1, c >>
/// 2).
struct Meeting {
    /// The edges of a cell along which the label must change: the corner where each begins, and its
    /// axis.
    edges: Vec<(usize, usize)>,
    /// The corners of which either two may be those that meet.
    pairs: Vec<[usize; 2]>,
    /// Whether all other corners of the cell must have other labels, too.
    alone: bool,
}

impl Meeting {
    /// In the edge across a cell's lower face along two axes.
    fn across_face([u, v]: [usize; 2]) -> Self {
        let edges = vec![(0, u), (0, v), (1 << u, v), (1 << v, u)];
        Self { edges, pairs: vec![[0, 1 << u | 1 << v], [1 << u, 1 << v]], alone: false }
    }

    /// In the middle of a cell, from one of its corners on.
    fn across_cell(corner: usize) -> Self {
        let ends = [corner, 7 - corner];
        let edges = (0..3).flat_map(|a| ends.map(|c| (c & !(1 << a), a))).collect();
        Self { edges, pairs: vec![ends], alone: true }
    }
}

/// Voxels of a label, not background, that meet in an edge alone: two of the four around it, across
/// from each other, while the others have other labels; or in a corner alone, around which all
/// others have.
pub(super) fn contacts(
    rows: &Rows,
    labels: &Labels,
    all: &[u64],
    pad: usize,
    check: Check<'_>,
) -> Result<Vec<u32>> {
    let [nx, ny, nz] = rows.dims();
    let faces = [[0, 1], [1, 2], [2, 0]].map(Meeting::across_face);
    let cells = [0, 1, 2, 3].map(Meeting::across_cell);
    let [equal, ..] = &labels.equal;
    let mut candidates = Set::new(equal.words, equal.rows)?;
    let mut found = Vec::new();
    for Meeting { edges, pairs, alone } in faces.into_iter().chain(cells) {
        candidates.change(check, |first, block, [room, ..]| {
            block.copy_from_slice(&all[..block.len()]);
            for &(corner, axis) in &edges {
                let beside = labels.equal[axis].beside(
                    first,
                    equal.steps([0, 1, 2].map(|a| (corner >> a & 1) as isize)),
                    room,
                );
                block.iter_mut().zip(beside).for_each(|(word, equal)| *word &= !equal);
            }
        })?;
        let layers = (0..ny - 1).into_par_iter().map(|j| {
            let mut numbers = Vec::new();
            for k in 0..nz - 1 {
                let around = rows.around(j, k);
                for (w, &word) in candidates.row(j + pad, k + pad).iter().enumerate() {
                    for i in ones(word)
                        .map(|bit| (64 * w + bit).wrapping_sub(pad))
                        .filter(|&i| i < nx - 1)
                    {
                        let id = |c: usize| around[c >> 1][i + (c & 1)];
                        let number = |c: usize| {
                            (((j + (c >> 1 & 1)) * nz + k + (c >> 2)) * nx + i + (c & 1)) as u32
                        };
                        for &pair in &pairs {
                            let own = id(pair[0]);
                            let meets = own != 0 && own == id(pair[1]);
                            if meets
                                && (!alone || (0..8).all(|c| pair.contains(&c) || id(c) != own))
                            {
                                reserve(&mut numbers, 2, "thin voxels")?;
                                numbers.extend(pair.map(number));
                            }
                        }
                    }
                }
            }
            Ok(numbers)
        });
        let layers: Vec<Vec<u32>> = layers.collect::<Result<_>>()?;
        reserve(&mut found, layers.iter().map(Vec::len).sum(), "thin voxels")?;
        layers.iter().for_each(|layer| found.extend_from_slice(layer));
    }
    Ok(found)
}

impl Labels {
    /// Calls `found` for each plate of a throat that is thinner than `cube`: with its first voxel,
    /// and how many voxels it has along each axis. `thick` are the voxels in cubes about twice as
    /// large.
    pub fn throats(
        &self,
        all: &[u64],
        cube: [usize; 3],
        thick: &Set,
        [cubes, runs, plates]: [&mut Set; 3],
        check: Check<'_>,
        mut found: impl FnMut([usize; 3], [usize; 3]) -> Result<()>,
    ) -> Result<()> {
        self.begin_cubes(all, cube, cubes, runs, check)?;
        // The axis across a plate, and the two along it.
        for [across, one, other] in [[2, 0, 1], [1, 0, 2], [0, 1, 2]] {
            if across != 1 {
                // Plates across y are made of the same runs as those before.
                self.begin_runs(thick, runs, one, cube[one], check)?;
            }
            plates.change(check, |first, block, [room, ..]| {
                block.copy_from_slice(runs.at(first, block));
                self.keep_runs(block, runs, first, other, cube[other], room);
                for by in 0..cube[across] as isize {
                    let cubes = cubes.beside(first, cubes.along(across, -by), room);
                    block.iter_mut().zip(cubes).for_each(|(word, cube)| *word &= !cube);
                }
            })?;
            let plate = [0, 1, 2].map(|axis| if axis == across { 1 } else { cube[axis] });
            for (n, &word) in plates.bits.iter().enumerate().filter(|&(_, &word)| word != 0) {
                check()?;
                let (row, word_of_row) = (n / plates.words, n % plates.words);
                let [j, k] = [row / plates.rows[1], row % plates.rows[1]];
                for bit in ones(word) {
                    found([64 * word_of_row + bit, j, k], plate)?;
                }
            }
        }
        Ok(())
    }
}
