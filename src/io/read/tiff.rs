//! Stacks of TIFF pages (`.tif`, `.tiff`), classic and BigTIFF: pages of one size are the slices
//! along z. The crate `tiff` reads them.
//!
//! ImageJ writes the distance of slices into the description of the first page, and that of pixels
//! as a resolution; where these are given they are taken. Else voxels are cubes of side 1.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts};
use crate::{Error, Result};

const NO_SPACING: &str = "the file does not say how far apart its slices, or their pixels, are: 1 \
                          is taken along all axes; --spacing (lapd_image_set_spacing) gives \
                          another";

type Pages = Decoder<BufReader<File>>;

pub(super) fn open<'a>(path: &Path, _: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let (file, length) = Source::open_file(path)?;
    let broken = |e: TiffError| Error::format(path, format!("not a TIFF file that is read: {e}"));
    // One page, as decoded, and what the decoder needs for it, may be as large as the file says:
    // what the whole image takes is checked below, before anything is read.
    let mut pages = Decoder::new(BufReader::new(file)).map_err(broken)?;
    let size = pages.dimensions().map_err(broken)?;
    let color = pages.colortype().map_err(broken)?;
    let ColorType::Gray(bits) = color else {
        return Err(Error::format(
            path,
            format!("pages are of color type {color:?}: only gray ones are read, a label each"),
        ));
    };
    let scalar = scalar_of(path, &mut pages, bits)?;
    let spacing = spacing_of(&mut pages);
    let mut count = 1_u64;
    while pages.more_images() {
        (access.go_on)(access.share.0)?;
        pages.next_image().map_err(broken)?;
        let here = (pages.dimensions().map_err(broken)?, pages.colortype().map_err(broken)?);
        if here != (size, color) {
            return Err(Error::format(
                path,
                format!(
                    "page {count} is of {} x {} pixels, {:?}, and the first of {} x {}, {color:?}",
                    here.0.0, here.0.1, here.1, size.0, size.1
                ),
            ));
        }
        count += 1;
    }
    pages.seek_to_image(0).map_err(broken)?;
    let page = u64::from(size.0) * u64::from(size.1) * scalar.size() as u64;
    let most = usize::try_from(page).unwrap_or(usize::MAX);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = most;
    limits.intermediate_buffer_size = most.max(1 << 20);
    let pages = pages.with_limits(limits);
    let stream = Stream { pages, access, count, left: count, page: Vec::new(), at: 0 };
    let stream = BufReader::with_capacity(1 << 16, stream);
    let source = Source::of_decoder(path, access, stream, length, page.saturating_mul(count));
    let sizes = [u64::from(size.0), u64::from(size.1), count];
    let layout = Layout::new(&source, sizes, scalar, Coding::LittleEndian)?;
    let mut warnings = Vec::new();
    if spacing.is_none() {
        warnings.push(NO_SPACING.into());
    }
    let directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let spacing = spacing.unwrap_or([1.0; 3]);
    let frame = frame_from_parts(path, "XResolution, spacing", [0.0; 3], spacing, directions)?;
    Ok(Opened { source, layout, frame, world: None, segments: None, warnings })
}

/// The type of the voxels, by the sample format of the first page.
fn scalar_of(path: &Path, pages: &mut Pages, bits: u8) -> Result<Scalar> {
    /// Values of the tag: unsigned, signed, IEEE float.
    const UNSIGNED: u64 = 1;
    const SIGNED: u64 = 2;
    const FLOAT: u64 = 3;
    let formats = pages.find_tag_unsigned_vec::<u64>(Tag::SampleFormat).ok().flatten();
    let format = formats.and_then(|formats| formats.first().copied()).unwrap_or(UNSIGNED);
    let bytes = usize::from(bits) / 8;
    let scalar = match format {
        _ if !bits.is_multiple_of(8) => None,
        UNSIGNED => Scalar::integer(bytes, false),
        SIGNED => Scalar::integer(bytes, true),
        FLOAT if bytes == 4 => Some(Scalar::F32),
        FLOAT if bytes == 8 => Some(Scalar::F64),
        _ => None,
    };
    scalar.ok_or_else(|| {
        Error::format(
            path,
            format!(
                "pixels have {bits} bits of sample format {format}: integers of 8, 16, 32 or 64 \
                 bits are read, and floats of 32 or 64; save the labels with 8 or 16 bits"
            ),
        )
    })
}

/// The sides of a voxel, where ImageJ has written all of them.
fn spacing_of(pages: &mut Pages) -> Option<[f64; 3]> {
    let text = pages.get_tag_ascii_string(Tag::ImageDescription).ok()?;
    let value = |name: &str| {
        text.lines().find_map(|line| line.trim().strip_prefix(name)?.trim().parse::<f64>().ok())
    };
    if !text.starts_with("ImageJ") {
        return None;
    }
    let mut side = |tag| {
        let [over, under] = pages.get_tag(tag).ok()?.into_u32_vec().ok()?.try_into().ok()?;
        // Pixels per unit.
        Some(f64::from(under) / f64::from(over))
    };
    let sides = [side(Tag::XResolution)?, side(Tag::YResolution)?, value("spacing=")?.abs()];
    sides.iter().all(|side| side.is_finite() && *side > 0.0).then_some(sides)
}

/// The pixels of all pages, as a stream of little-endian numbers.
struct Stream<'a> {
    pages: Pages,
    access: Access<'a>,
    count: u64,
    /// Those that are to be decoded yet.
    left: u64,
    page: Vec<u8>,
    at: usize,
}

impl Stream<'_> {
    /// Decodes the page that is at hand, and goes on to the next.
    fn decode(&mut self) -> io::Result<()> {
        fn little<const N: usize, T: Copy>(values: &[T], bytes: fn(T) -> [u8; N]) -> Vec<u8> {
            values.iter().flat_map(|&value| bytes(value)).collect()
        }
        let damaged = |e: TiffError| io::Error::new(io::ErrorKind::InvalidData, e.to_string());
        let (from, share) = self.access.share;
        let done = 1.0 - self.left as f64 / self.count as f64;
        (self.access.go_on)(from + share * done).map_err(io::Error::other)?;
        self.page = match self.pages.read_image().map_err(damaged)? {
            DecodingResult::U8(values) => values,
            DecodingResult::I8(values) => little(&values, i8::to_le_bytes),
            DecodingResult::U16(values) => little(&values, u16::to_le_bytes),
            DecodingResult::I16(values) => little(&values, i16::to_le_bytes),
            DecodingResult::U32(values) => little(&values, u32::to_le_bytes),
            DecodingResult::I32(values) => little(&values, i32::to_le_bytes),
            DecodingResult::U64(values) => little(&values, u64::to_le_bytes),
            DecodingResult::I64(values) => little(&values, i64::to_le_bytes),
            DecodingResult::F32(values) => little(&values, f32::to_le_bytes),
            DecodingResult::F64(values) => little(&values, f64::to_le_bytes),
            _ => return Err(io::Error::new(io::ErrorKind::InvalidData, "pixels of a new kind")),
        };
        self.at = 0;
        self.left -= 1;
        if self.left > 0 {
            self.pages.next_image().map_err(damaged)?;
        }
        Ok(())
    }
}

impl Read for Stream<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.page.len() && self.left > 0 {
            self.decode()?;
        }
        let count = buffer.len().min(self.page.len() - self.at);
        buffer[..count].copy_from_slice(&self.page[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use tiff::encoder::colortype::{ColorType, Gray8, Gray16, GrayI32, RGB8};
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue};

    use super::super::tests::{labels, read_bytes};

    /// Pages of 3 x 2 pixels.
    fn stack<C: ColorType>(
        compression: Compression,
        pages: &[Vec<C::Inner>],
        description: Option<&str>,
    ) -> Vec<u8>
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
        for page in pages {
            let mut image = encoder.new_image::<C>(3, 2).unwrap();
            if let Some(text) = description {
                let tag = tiff::tags::Tag::ImageDescription;
                image.encoder().write_tag(tag, text).unwrap();
                image.x_resolution(tiff::encoder::Rational { n: 4, d: 1 });
                image.y_resolution(tiff::encoder::Rational { n: 2, d: 1 });
            }
            image.write_data(page).unwrap();
        }
        bytes.into_inner()
    }

    fn values<T: From<u8>>() -> [Vec<T>; 2] {
        [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]].map(|page| page.map(T::from).into())
    }

    const EXPECTED: [i32; 12] = [0, 1, 2, 3, 4, 5, 5, 4, 3, 2, 1, 0];

    #[test]
    fn pages_are_slices() {
        let deflate = Compression::Deflate(DeflateLevel::Fast);
        for compression in [Compression::Uncompressed, Compression::Lzw, deflate] {
            let bytes = stack::<Gray8>(compression, &values(), None);
            let read = read_bytes("a.tif", &bytes).unwrap();
            assert_eq!(read.image.dims(), [3, 2, 2]);
            assert_eq!(labels(&read.image), EXPECTED);
            assert!(read.warnings[0].contains("--spacing"), "{:?}", read.warnings);
            let bytes = stack::<Gray16>(compression, &values(), None);
            assert_eq!(labels(&read_bytes("a.TIFF", &bytes).unwrap().image), EXPECTED);
        }
        let pages = [vec![0, -1, 2, 3, 4, 5], vec![5, 4, 3, 2, 1, 70_000]];
        let read = read_bytes("a.tif", &stack::<GrayI32>(Compression::Lzw, &pages, None)).unwrap();
        assert_eq!(labels(&read.image)[1], -1);
        assert_eq!(labels(&read.image)[11], 70_000);
    }

    #[test]
    fn the_spacing_of_imagej_is_taken() {
        let text = "ImageJ=1.53t\nimages=2\nslices=2\nunit=micron\nspacing=3.5\n";
        let bytes = stack::<Gray8>(Compression::Uncompressed, &values(), Some(text));
        let read = read_bytes("a.tif", &bytes).unwrap();
        assert_eq!(read.image.frame().spacing().to_array(), [0.25, 0.5, 3.5]);
        assert!(read.warnings.is_empty());
    }

    #[test]
    fn what_is_not_read_is_named() {
        let refused = |bytes: &[u8], what: &str| {
            let error = read_bytes("a.tif", bytes).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        let page = vec![0_u8; 18];
        let colors = stack::<RGB8>(Compression::Uncompressed, &[page], None);
        refused(&colors, "only gray ones are read");
        refused(b"II*\0\x08\0\0\0", "not a TIFF file that is read");
        refused(b"neither", "not a TIFF file that is read");
        let whole = stack::<Gray8>(Compression::Lzw, &values(), None);
        for length in 0..whole.len() - 1 {
            let _ = read_bytes("a.tif", &whole[..length]);
        }
        // Any byte may be damaged: an image or an error, no panic.
        for at in 0..whole.len() {
            for flip in [1, 0x40, 0xff] {
                let mut bytes = whole.clone();
                bytes[at] ^= flip;
                let _ = read_bytes("a.tif", &bytes);
            }
        }
    }
}
