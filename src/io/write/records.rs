//! Batches of bytes made in parallel and written in order, records in them, and the numbers in
//! those.
//!
//! While one round of batches is written, the next one is made. Rounds are as large as the pool, so
//! memory is a few batches for each thread; what is written does not depend on the number of
//! threads.
//!
//! Shortest decimal forms come from `zmij` and `itoa`, several times as fast as the standard
//! formatter.

use std::io::{self, Write};
use std::ops::Range;

use rayon::prelude::*;

/// Records of one batch.
const CHUNK: usize = 1024;

/// Batches of one round, for each thread: enough to keep all threads busy, few enough that memory
/// stays small.
const BATCHES: usize = 4;

/// Calls `make(batch, bytes)`, which appends the bytes of a batch, for all numbers below `count`,
/// and `write` with the bytes in this order.
pub(super) fn write_batches(
    count: usize,
    make: impl Fn(usize, &mut Vec<u8>) -> io::Result<()> + Sync,
    mut write: impl FnMut(&[u8]) -> io::Result<()> + Send,
) -> io::Result<()> {
    let round = BATCHES * rayon::current_num_threads();
    let mut made: Vec<Vec<u8>> = Vec::new();
    let mut next: Vec<Vec<u8>> = Vec::new();
    // One step more than there are rounds: the last one only writes.
    for start in (0..count + round).step_by(round) {
        let batches = round.min(count.saturating_sub(start));
        next.resize_with(batches, Vec::new);
        let (written, result) = rayon::join(
            || made.iter().try_for_each(|bytes| write(bytes)),
            || {
                next.par_iter_mut().enumerate().try_for_each(|(batch, bytes)| {
                    bytes.clear();
                    make(start + batch, bytes)
                })
            },
        );
        written.and(result)?;
        std::mem::swap(&mut made, &mut next);
    }
    Ok(())
}

/// Calls `record(i, bytes)`, which appends record `i`, for all `i` below `count`, and writes the
/// bytes in this order.
pub(super) fn write_records(
    out: &mut (impl Write + Send),
    count: usize,
    record: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    write_ranges(out, count, |range, bytes| range.for_each(|i| record(i, bytes)))
}

/// As [`write_records`], with a call `records(range, bytes)` for some records at once.
pub(super) fn write_ranges(
    out: &mut (impl Write + Send),
    count: usize,
    records: impl Fn(Range<usize>, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    let make = |batch: usize, bytes: &mut Vec<u8>| {
        records(batch * CHUNK..((batch + 1) * CHUNK).min(count), bytes);
        Ok(())
    };
    write_batches(count.div_ceil(CHUNK), make, |bytes| out.write_all(bytes))
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

/// Appends numbers as [`push_float`] does, with a character between them.
#[inline]
pub(super) fn push_floats(bytes: &mut Vec<u8>, values: &[f64], between: u8) {
    for (i, &value) in values.iter().enumerate() {
        if i > 0 {
            bytes.push(between);
        }
        push_float(bytes, value);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn records_keep_their_order() {
        for count in [0, 1, CHUNK, 70 * CHUNK + 3] {
            let mut bytes = Vec::new();
            write_records(&mut bytes, count, |i, bytes| {
                bytes.extend_from_slice(&(i as u32).to_le_bytes())
            })
            .unwrap();
            let values: Vec<u32> = bytes
                .chunks_exact(4)
                .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect();
            assert!(values.iter().copied().eq(0..count as u32));
        }
    }

    #[test]
    fn errors_end_the_writing() {
        let make = |batch: usize, bytes: &mut Vec<u8>| {
            bytes.push(batch as u8);
            if batch == 30 { Err(io::Error::other("batch 30")) } else { Ok(()) }
        };
        let mut bytes = Vec::new();
        let collect = |batch: &[u8]| {
            bytes.extend_from_slice(batch);
            Ok(())
        };
        assert_eq!(write_batches(100, make, collect).unwrap_err().to_string(), "batch 30");
        assert!(bytes.len() <= 30 && bytes.iter().copied().eq(0..bytes.len() as u8));
        let refuse = |_: &[u8]| Err(io::Error::other("disk full"));
        assert_eq!(write_batches(20, make, refuse).unwrap_err().to_string(), "disk full");
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
