//! The curve of G. M. Morton ("A computer oriented geodetic data base", 1966) through the cells of
//! a grid: cells that follow on each other along it are mostly near in space.

/// Bits of a coordinate.
pub const BITS: u32 = 10;

/// The place along the curve of a cell, whose coordinates have [`BITS`] bits at most.
#[inline]
pub fn place(cell: [u32; 3]) -> u32 {
    let [x, y, z] = cell.map(spread);
    x | y << 1 | z << 2
}

/// Puts two zeros behind each bit.
#[inline]
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00FF;
    let x = (x | x << 8) & 0x0300_F00F;
    let x = (x | x << 4) & 0x030C_30C3;
    (x | x << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread() {
        for x in 0..1_u32 << BITS {
            let expected = (0..BITS).fold(0, |bits, i| bits | (x >> i & 1) << (3 * i));
            assert_eq!(spread(x), expected, "{x}");
        }
        assert_eq!(place([1, 2, 4]), 0b100_010_001);
    }
}
