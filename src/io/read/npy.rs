//! NumPy arrays of three axes (`.npy`), versions 1 to 3 of the format. Source: NumPy Enhancement
//! Proposal 1 and the documentation of `numpy.lib.format`.
//!
//! `array[i, j, k]` is the voxel at (i, j, k). Of an array in C order the last axis runs fastest,
//! of an image the first: its voxels are put in that order when they have been read. The format
//! says nothing of places: voxels are cubes of side 1, from 0 on.

use std::path::Path;

use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts};
use crate::Result;

const MAGIC: &[u8] = b"\x93NUMPY";

/// The longest header that is read; NumPy reads no longer ones by default, either.
const MAX_HEADER: usize = 10_000;

const NO_SPACING: &str = "the file has no spacing of voxels: 1 is taken along all axes; --spacing \
                          (lapd_image_set_spacing) gives another";

pub(super) fn open<'a>(path: &Path, _: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let mut source = Source::open(path, access)?;
    let header = read_header(&mut source)?;
    let Header { scalar, coding, is_fortran, shape: [x, y, z] } = parse(&source, &header)?;
    let sizes = if is_fortran { [x, y, z] } else { [z, y, x] };
    let directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let layout = Layout::new(&source, sizes, scalar, coding)?;
    let frame = frame_from_parts(path, "shape", [0.0; 3], [1.0; 3], directions)?;
    let warnings = vec![NO_SPACING.into()];
    let is_reversed = !is_fortran;
    Ok(Opened { source, layout, frame, world: None, segments: None, is_reversed, warnings })
}

/// What the header says.
struct Header {
    scalar: Scalar,
    coding: Coding,
    is_fortran: bool,
    shape: [u64; 3],
}

fn read_header(source: &mut Source) -> Result<String> {
    let mut start = [0; 8];
    if source.read_up_to(&mut start)? < start.len() || !start.starts_with(MAGIC) {
        return Err(source.error("not a NumPy file: it does not begin with '\\x93NUMPY'"));
    }
    let mut length = [0; 4];
    let bytes = if start[6] == 1 { 2 } else { 4 };
    let held = source.read_up_to(&mut length[..bytes])?;
    let length = u32::from_le_bytes(length) as usize;
    if held < bytes || !(1..=3).contains(&start[6]) || length > MAX_HEADER {
        return Err(source.error(format!(
            "version {}.{} with a header of {length} bytes is not read: only versions 1 to 3 with \
             at most {MAX_HEADER} are",
            start[6], start[7]
        )));
    }
    let mut header = vec![0; length];
    let held = source.read_up_to(&mut header)?;
    if held < length {
        return Err(source.error(format!("the header is cut off: {held} of {length} bytes")));
    }
    String::from_utf8(header).map_err(|_| source.error("the header is not UTF-8"))
}

/// What a header, a dictionary as Python writes it, says.
fn parse(source: &Source, header: &str) -> Result<Header> {
    let missing = |key: &str| source.error(format!("the header has no '{key}'"));
    // What follows a key.
    let after = |key: &str| {
        let at = [format!("'{key}':"), format!("\"{key}\":")];
        let found = at.iter().find_map(|key| header.split_once(key.as_str()));
        found.map(|(_, rest)| rest.trim_start()).ok_or_else(|| missing(key))
    };
    let descr = after("descr")?;
    let quoted = descr.strip_prefix(['\'', '"']).and_then(|rest| rest.split(['\'', '"']).next());
    let Some((scalar, coding)) = quoted.and_then(scalar_of) else {
        let shown: String = descr.chars().take(24).filter(|c| !c.is_control()).collect();
        return Err(source.error(format!(
            "descr is {shown} ...: only arrays of bool, and of integers and floats of up to 64 \
             bits, are read"
        )));
    };
    let is_fortran = after("fortran_order")?.starts_with("True");
    let shape = after("shape")?;
    let numbers = shape.strip_prefix('(').and_then(|rest| rest.split_once(')'));
    let (numbers, _) = numbers.ok_or_else(|| missing("shape"))?;
    let sizes: Option<Vec<u64>> = numbers
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok())
        .collect();
    let shape = sizes.and_then(|sizes| <[u64; 3]>::try_from(sizes).ok()).ok_or_else(|| {
        let shown: String = numbers.chars().take(48).filter(|c| !c.is_control()).collect();
        source.error(format!("shape is ({shown}): only arrays of three axes are read"))
    })?;
    Ok(Header { scalar, coding, is_fortran, shape })
}

/// The type that NumPy's three letters name: the byte order, the kind, the bytes.
fn scalar_of(descr: &str) -> Option<(Scalar, Coding)> {
    let mut letters = descr.chars();
    let coding = match letters.next()? {
        '<' | '|' => Coding::LittleEndian,
        '>' => Coding::BigEndian,
        _ => return None,
    };
    let kind = letters.next()?;
    let bytes: usize = letters.as_str().parse().ok()?;
    let scalar = match (kind, bytes) {
        ('b', 1) => Scalar::U8,
        ('u', _) => Scalar::integer(bytes, false)?,
        ('i', _) => Scalar::integer(bytes, true)?,
        ('f', 4) => Scalar::F32,
        ('f', 8) => Scalar::F64,
        _ => return None,
    };
    Some((scalar, coding))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{labels, read_bytes};

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut header = header.to_owned();
        while !(10 + header.len() + 1).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    }

    fn header(descr: &str, order: &str, shape: &str) -> String {
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({shape}), }}")
    }

    #[test]
    fn both_orders_put_a_voxel_where_the_array_has_it() {
        // array[1, 0, 2] = 7 in shape (2, 3, 4).
        for (order, at) in [("False", 3 * 4 + 2), ("True", 1 + 2 * (3 * 2))] {
            let mut data = [0; 24];
            data[at] = 7;
            let read = read_bytes("a.npy", &npy(&header("|u1", order, "2, 3, 4"), &data)).unwrap();
            assert_eq!(read.image.dims(), [2, 3, 4]);
            assert_eq!(read.image.label_at([1, 0, 2]), Some(7), "{order}");
            assert_eq!(read.image.frame().direction(), glam::DMat3::IDENTITY);
            assert_eq!(read.image.voxel_counts(), [23, 1]);
            assert!(read.warnings[0].contains("--spacing"));
        }
    }

    #[test]
    fn types_are_read() {
        let values = [0_i16, 1, -300, 5];
        let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let read = read_bytes("a.npy", &npy(&header(">i2", "True", "4, 1, 1"), &big)).unwrap();
        assert_eq!(labels(&read.image), [0, 1, -300, 5]);
        let floats: Vec<u8> = [0.0_f64, 2.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let read = read_bytes("a.npy", &npy(&header("<f8", "True", "2, 1, 1"), &floats)).unwrap();
        assert_eq!(labels(&read.image), [0, 2]);
    }

    #[test]
    fn what_is_not_read_is_named() {
        let refused = |bytes: &[u8], what: &str| {
            let error = read_bytes("a.npy", bytes).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        refused(&npy(&header("|u1", "False", "8,"), &[0; 8]), "three axes");
        refused(&npy(&header("|u1", "False", "1, 2, 2, 2"), &[0; 8]), "three axes");
        refused(&npy(&header("<c16", "False", "1, 1, 1"), &[0; 16]), "descr is '<c16'");
        refused(&npy("{'descr': [('a', '<i4')], 'shape': (1, 1, 1)}", &[0; 4]), "descr");
        refused(&npy("{'descr': '|u1'}", &[0; 4]), "no 'fortran_order'");
        refused(b"\x93NUMPY\x09\x00\x10\x00", "version 9.0");
        refused(b"PK\x03\x04 a zip, as .npz is", "not a NumPy file");
        refused(&npy(&header("|u1", "False", "2, 2, 2"), &[0; 7]), "cut off");
    }
}
