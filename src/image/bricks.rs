//! Where a voxel lies in memory: small cubes of voxels, one after the other.
//!
//! A point query reads a voxel and its neighbours along all three axes. In rows they lie on four
//! cache lines far apart; in bricks mostly on one or two. The address is separable: it is a sum of
//! one term per axis, so the eight corners of a cell need six terms. Bricks are ordered x fastest,
//! then z, then y: all bricks of one range of y are contiguous, so that ranges can be filled in in
//! parallel.

/// log2 of the edge of a brick; 0 gives plain rows. Chosen by `benches/micro/oracle.rs`.
const LOG: usize = 2;
const EDGE: usize = 1 << LOG;
const MASK: usize = EDGE - 1;
const VOLUME: usize = EDGE * EDGE * EDGE;

/// The layout of a grid in bricks; sizes are rounded up to whole bricks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bricks {
    dims: [usize; 3],
    /// Elements from one brick to the next along z.
    z_stride: usize,
    /// Elements from one brick to the next along y.
    y_stride: usize,
}

impl Bricks {
    /// Voxels along each axis of one brick.
    pub(crate) const EDGE: usize = EDGE;
    /// Voxels of one brick.
    pub(crate) const VOLUME: usize = VOLUME;

    /// The layout of a grid of `dims` voxels.
    pub(crate) fn new(dims: [usize; 3]) -> Self {
        let z_stride = dims[0].div_ceil(EDGE) * VOLUME;
        Self { dims, z_stride, y_stride: dims[2].div_ceil(EDGE) * z_stride }
    }

    /// Voxels along each axis, without the rounding.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Elements to allocate.
    pub(crate) fn len(&self) -> usize {
        self.dims[1].div_ceil(EDGE) * self.y_stride
    }

    /// Elements of all bricks that share a range of y: those of `y` in `EDGE * b .. EDGE * (b + 1)`
    /// are `b * layer() .. (b + 1) * layer()`.
    pub(crate) fn layer(&self) -> usize {
        self.y_stride
    }

    /// The term of x in the address.
    #[inline(always)]
    pub(crate) fn x(&self, i: usize) -> usize {
        (i >> LOG) * VOLUME + (i & MASK)
    }

    /// The term of y in the address.
    #[inline(always)]
    pub(crate) fn y(&self, j: usize) -> usize {
        (j >> LOG) * self.y_stride + ((j & MASK) << (2 * LOG))
    }

    /// The term of z in the address.
    #[inline(always)]
    pub(crate) fn z(&self, k: usize) -> usize {
        (k >> LOG) * self.z_stride + ((k & MASK) << LOG)
    }

    /// The voxel at an address; beyond the grid where its size was rounded up.
    pub(crate) fn voxel(&self, index: usize) -> [usize; 3] {
        let (y, in_layer) = (index / self.y_stride, index % self.y_stride);
        let (z, in_row) = (in_layer / self.z_stride, in_layer % self.z_stride);
        let (x, within) = (in_row / VOLUME, in_row % VOLUME);
        [x << LOG | within & MASK, y << LOG | within >> (2 * LOG), z << LOG | within >> LOG & MASK]
    }

    /// The address of voxel (i, j, k).
    #[inline(always)]
    pub(crate) fn index(&self, i: usize, j: usize, k: usize) -> usize {
        self.x(i) + self.y(j) + self.z(k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_distinct_and_layers_contiguous() {
        for dims in [[1, 1, 1], [5, 3, 9], [4, 8, 4], [1, 13, 2]] {
            let bricks = Bricks::new(dims);
            let mut seen = vec![false; bricks.len()];
            for k in 0..dims[2] {
                for j in 0..dims[1] {
                    for i in 0..dims[0] {
                        let at = bricks.index(i, j, k);
                        assert!(!std::mem::replace(&mut seen[at], true), "two voxels at {at}");
                        assert_eq!(at / bricks.layer(), j / Bricks::EDGE);
                        assert_eq!(bricks.voxel(at), [i, j, k]);
                    }
                }
            }
        }
    }
}
