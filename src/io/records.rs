//! Records made in parallel and written in order, and the numbers in them.
//!
//! Shortest decimal forms come from `zmij` and `itoa`, several times as fast as the standard formatter.

use std::io::{self, Write};

use rayon::prelude::*;

/// Records per parallel work item.
const CHUNK: usize = 8192;

/// Calls `record(i, bytes)`, which appends record `i`, for all `i` below `count`, and writes the bytes in this order.
pub(super) fn write_records(
    out: &mut impl Write,
    count: usize,
    record: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    // Enough chunks to keep all threads busy, few enough that memory stays small.
    let round = CHUNK * 4 * rayon::current_num_threads();
    let mut buffers: Vec<Vec<u8>> = vec![Vec::new(); round.min(count).div_ceil(CHUNK)];
    for start in (0..count).step_by(round) {
        let end = (start + round).min(count);
        buffers.par_iter_mut().enumerate().for_each(|(chunk, buffer)| {
            buffer.clear();
            let first = start + chunk * CHUNK;
            (first..(first + CHUNK).min(end)).for_each(|i| record(i, buffer));
        });
        for buffer in &buffers {
            out.write_all(buffer)?;
        }
    }
    Ok(())
}

/// Appends an integer in decimal.
#[inline]
pub(super) fn push_int(bytes: &mut Vec<u8>, value: i64) {
    bytes.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

/// Appends integers in decimal with a space before each.
#[inline]
pub(super) fn push_ints(bytes: &mut Vec<u8>, values: impl IntoIterator<Item = i64>) {
    for value in values {
        bytes.push(b' ');
        push_int(bytes, value);
    }
}

/// Appends a number in the shortest decimal form that reads back to the same bits.
#[inline]
pub(super) fn push_float(bytes: &mut Vec<u8>, value: f64) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(value);
    bytes.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn records_keep_their_order() {
        for count in [0, 1, CHUNK, 70 * CHUNK + 3] {
            let mut bytes = Vec::new();
            write_records(&mut bytes, count, |i, bytes| bytes.extend_from_slice(&(i as u32).to_le_bytes())).unwrap();
            let values: Vec<u32> =
                bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
            assert!(values.iter().copied().eq(0..count as u32));
        }
    }

    proptest! {
        #[test]
        fn floats_read_back(value in any::<f64>().prop_filter("finite", |x| x.is_finite())) {
            let mut bytes = Vec::new();
            push_float(&mut bytes, value);
            let back: f64 = std::str::from_utf8(&bytes).unwrap().parse().unwrap();
            prop_assert_eq!(back.to_bits(), value.to_bits());
        }
    }

    #[test]
    fn numbers_are_short() {
        let mut bytes = Vec::new();
        for value in [1.0, -0.5, 1e300, 0.1, 0.0] {
            push_float(&mut bytes, value);
            bytes.push(b' ');
        }
        push_ints(&mut bytes, [-7, 4_294_967_295]);
        assert_eq!(String::from_utf8(bytes).unwrap(), "1 -0.5 1e+300 0.1 0  -7 4294967295");
    }
}
