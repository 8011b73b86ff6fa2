//! Sets of voxels or cells of a row as words of 64 bits.

use std::ops::Range;

/// The places of the bits of a word, from the lowest on.
#[inline]
pub(crate) fn ones(mut word: u64) -> impl Iterator<Item = usize> + Clone {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        // 0 has no lowest bit.
        word &= word.wrapping_sub(1);
        (bit < 64).then_some(bit)
    })
}

/// A bit for each of 64 flags, 0 or 1.
#[inline]
pub(crate) fn gathered(flags: &[u8; 64]) -> u64 {
    // The product moves the lowest bits of eight bytes side by side to the top.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let (bytes, _) = flags.as_chunks::<8>();
    bytes.iter().enumerate().fold(0, |word, (n, &eight)| {
        word | (u64::from_le_bytes(eight).wrapping_mul(GATHER) >> 56) << (8 * n)
    })
}

/// The words of 64 bits in which a range has bits, and which bits. The range must not be empty.
#[inline]
pub(crate) fn masks(range: &Range<usize>) -> impl Iterator<Item = (usize, u64)> {
    let (from, last) = (range.start, range.end - 1);
    (from / 64..=last / 64).map(move |word| {
        let low = if word == from / 64 { from % 64 } else { 0 };
        let high = if word == last / 64 { last % 64 } else { 63 };
        (word, (u64::MAX >> (63 - high)) & (u64::MAX << low))
    })
}
