//! Uniform cells folded into a table of chain heads: where to look for points near a point.

use glam::{DVec3, I64Vec3};

/// Most chain heads that all tables of one purpose have together; more cells share them.
pub const MAX_HEADS: usize = 1 << 22;

/// Which head a point's chain has.
pub struct CellTable {
    lower: DVec3,
    per_cell: f64,
    row: u64,
    slice: u64,
    mask: u64,
}

impl CellTable {
    /// Cells of edge `cell` over a box, with no more than `max` heads, at least 1. Points and
    /// queries beyond the box share cells with others, which costs time alone.
    pub fn new(lower: DVec3, upper: DVec3, cell: f64, max: usize) -> Self {
        let cells = ((upper - lower) / cell).ceil().max(DVec3::ONE);
        // A power of two, not above the most.
        let heads = ((cells.x * cells.y * cells.z).min(max as f64) as usize)
            .next_power_of_two()
            .min(1 << max.ilog2());
        Self {
            lower,
            per_cell: 1.0 / cell,
            row: cells.x as u64,
            slice: (cells.x * cells.y) as u64,
            mask: heads as u64 - 1,
        }
    }

    /// How many heads there are.
    pub fn heads(&self) -> usize {
        self.mask as usize + 1
    }

    /// The cell of a point.
    #[inline]
    pub fn cell(&self, p: DVec3) -> I64Vec3 {
        ((p - self.lower) * self.per_cell).as_i64vec3()
    }

    /// The head of a cell.
    #[inline]
    pub fn head(&self, x: i64, y: i64, z: i64) -> usize {
        let index = (x as u64)
            .wrapping_add((y as u64).wrapping_mul(self.row))
            .wrapping_add((z as u64).wrapping_mul(self.slice));
        (index & self.mask) as usize
    }

    /// The head of a point's cell.
    #[inline]
    pub fn head_of(&self, p: DVec3) -> usize {
        let cell = self.cell(p);
        self.head(cell.x, cell.y, cell.z)
    }
}
