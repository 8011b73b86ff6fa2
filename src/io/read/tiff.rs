//! Stacks of TIFF pages (`.tif`, `.tiff`), classic and BigTIFF: pages of one size are the slices
//! along z. The crate `tiff` reads them.
//!
//! ImageJ writes the distance of slices into the description of the first page, and that of pixels
//! as a resolution; where these are given they are taken. Else voxels are cubes of side 1.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use tiff::decoder::{ChunkType, Decoder, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts};
use crate::memory::{Watch, zeroed};
use crate::{Error, Result};

const NO_SPACING: &str = "the file does not say how far apart its slices, or their pixels, are: 1 \
                          is taken along all axes; --spacing (lapd_image_set_spacing) gives \
                          another";

/// Values of the tag PhotometricInterpretation: gray, with 0 for white, and colours by a table.
const WHITE_IS_ZERO: u64 = 0;
const COLOR_TABLE: u64 = 3;

/// What the decoder needs beside the buffer that it is given, at most.
const BESIDE: usize = 16 << 20;

type Pages<'a> = Decoder<BufReader<Watched<'a>>>;

/// The most bytes that are read at once.
const AT_ONCE: usize = 1 << 20;

/// The file, of which every read asks whether to go on: a page may be one strip, which is decoded
/// at once.
struct Watched<'a> {
    file: File,
    access: Access<'a>,
    memory: Watch,
    /// Which part of the pages is done.
    done: f64,
}

impl Read for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let (from, share) = self.access.share;
        let going = (self.access.go_on)(from + share * self.done);
        going.and_then(|()| self.memory.check()).map_err(io::Error::other)?;
        let count = buffer.len().min(AT_ONCE);
        self.file.read(&mut buffer[..count])
    }
}

impl Seek for Watched<'_> {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

/// What ended a read, where the decoder hands it on; else the decoder's own error.
fn ended(error: TiffError) -> std::result::Result<Error, TiffError> {
    match error {
        TiffError::IoError(error) => error.downcast().map_err(TiffError::IoError),
        error => Err(error),
    }
}

pub(super) fn open<'a>(path: &Path, _: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let (file, length) = Source::open_file(path)?;
    let broken = |e: TiffError| {
        ended(e)
            .unwrap_or_else(|e| Error::format(path, format!("not a TIFF file that is read: {e}")))
    };
    let refused = |why: String| Err(Error::format(path, why));
    let file = Watched { file, access, memory: Watch::new(), done: 0.0 };
    let mut pages = Decoder::new(BufReader::new(file)).map_err(broken)?;
    let photometric = pages.find_tag_unsigned::<u64>(Tag::PhotometricInterpretation);
    let photometric = photometric.map_err(broken)?;
    if photometric == Some(COLOR_TABLE) {
        return refused(
            "pixels have colors by a table: only gray ones are read; save the labels as gray \
             values of 8 or 16 bits"
                .into(),
        );
    }
    let size = pages.dimensions().map_err(broken)?;
    let color = pages.colortype().map_err(broken)?;
    let ColorType::Gray(bits) = color else {
        return refused(format!(
            "pages are of color type {color:?}: only gray ones are read, a label each"
        ));
    };
    let scalar = scalar_of(path, &mut pages, bits)?;
    let is_unsigned = matches!(scalar, Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64);
    let is_white_zero = photometric == Some(WHITE_IS_ZERO);
    if is_white_zero && !is_unsigned {
        return refused("0 stands for white, and pixels are no unsigned integers".into());
    }
    let described = Described::new(&mut pages);
    let mut count = 1_u64;
    while pages.more_images() {
        (access.go_on)(access.share.0)?;
        pages.next_image().map_err(broken)?;
        let here = (pages.dimensions().map_err(broken)?, pages.colortype().map_err(broken)?);
        if here != (size, color) {
            return refused(format!(
                "page {count} is of {} x {} pixels, {:?}, and the first of {} x {}, {color:?}",
                here.0.0, here.0.1, here.1, size.0, size.1
            ));
        }
        count += 1;
    }
    described.check(path, count)?;
    pages.seek_to_image(0).map_err(broken)?;
    // Headers may name sizes beyond all numbers; memory for these is refused below.
    let pixels = u64::from(size.0) * u64::from(size.1);
    let page = pixels.saturating_mul(scalar.size() as u64);
    let bytes = page.saturating_mul(count);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = usize::try_from(page).unwrap_or(usize::MAX).max(BESIDE);
    limits.intermediate_buffer_size = BESIDE;
    let stream = Stream {
        pages: pages.with_limits(limits),
        access,
        memory: Watch::new(),
        inverted: is_white_zero,
        count,
        left: count,
        page,
        strip: 0,
        bytes: Vec::new(),
        at: 0,
    };
    let source = Source::of_decoder(path, access, BufReader::new(stream), length, bytes);
    // A page is decoded at once where it is in tiles, or in one strip.
    let labels = 2_u64.saturating_mul(bytes / scalar.size() as u64);
    source.check_memory(page.saturating_add(labels))?;
    let sizes = [u64::from(size.0), u64::from(size.1), count];
    // The decoder gives the machine's own numbers.
    let coding = if cfg!(target_endian = "big") { Coding::BigEndian } else { Coding::LittleEndian };
    let layout = Layout::new(&source, sizes, scalar, coding)?;
    let mut warnings = Vec::new();
    if described.spacing.is_none() {
        warnings.push(NO_SPACING.into());
    }
    let directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let spacing = described.spacing.unwrap_or([1.0; 3]);
    let frame = frame_from_parts(path, "XResolution, spacing", [0.0; 3], spacing, directions)?;
    let (world, segments, is_reversed) = (None, None, false);
    Ok(Opened { source, layout, frame, world, segments, is_reversed, warnings })
}

/// The type of the voxels, by the sample format of the first page.
fn scalar_of(path: &Path, pages: &mut Pages<'_>, bits: u8) -> Result<Scalar> {
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

/// What ImageJ says of a stack, in the description of its first page.
#[derive(Default)]
struct Described {
    /// The sides of a voxel, where all of them are given.
    spacing: Option<[f64; 3]>,
    /// Pages in all, and how many belong to each slice: channels, times.
    images: Option<u64>,
    for_each_slice: u64,
}

impl Described {
    fn new(pages: &mut Pages<'_>) -> Self {
        let text = pages.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
        if !text.starts_with("ImageJ") {
            return Self::default();
        }
        let word = |name: &str| {
            text.lines().find_map(|line| line.trim().strip_prefix(name)).map(str::trim)
        };
        let count = |name: &str| word(name).and_then(|word| word.parse::<u64>().ok());
        let mut side = |tag| {
            let [over, under] = pages.get_tag(tag).ok()?.into_u32_vec().ok()?.try_into().ok()?;
            // Pixels per unit.
            Some(f64::from(under) / f64::from(over))
        };
        let between = word("spacing=").and_then(|word| word.parse::<f64>().ok());
        let sides = (|| Some([side(Tag::XResolution)?, side(Tag::YResolution)?, between?.abs()]))();
        let is_good = |sides: &[f64; 3]| sides.iter().all(|side| side.is_finite() && *side > 0.0);
        Self {
            spacing: sides.filter(is_good),
            images: count("images="),
            for_each_slice: ["channels=", "frames="]
                .map(|name| count(name).unwrap_or(1).max(1))
                .into_iter()
                .fold(1, u64::saturating_mul),
        }
    }

    /// Refuses what is no stack of slices.
    fn check(&self, path: &Path, pages: u64) -> Result<()> {
        if self.for_each_slice > 1 {
            return Err(Error::format(
                path,
                format!(
                    "ImageJ's description tells of {} pages for each slice (channels, times): \
                     save one channel, of one time",
                    self.for_each_slice
                ),
            ));
        }
        match self.images {
            Some(images) if images != pages => Err(Error::format(
                path,
                format!(
                    "ImageJ's description tells of {images} images, and there are {pages} pages: \
                     stacks of 4 GB and more are no longer TIFF there; save them as NRRD"
                ),
            )),
            _ => Ok(()),
        }
    }
}

/// The pixels of all pages, as a stream of the machine's numbers.
struct Stream<'a> {
    pages: Pages<'a>,
    access: Access<'a>,
    memory: Watch,
    /// 0 stands for white, and the decoder has turned values around.
    inverted: bool,
    count: u64,
    /// Pages that are not finished.
    left: u64,
    /// Bytes of a page.
    page: u64,
    /// The strip of the page that comes next.
    strip: u32,
    bytes: Vec<u8>,
    at: usize,
}

impl Stream<'_> {
    /// Decodes the next strip, or the next page where it is in tiles.
    fn decode(&mut self) -> io::Result<()> {
        let damaged = |e: TiffError| {
            ended(e).map_or_else(
                |e| io::Error::new(io::ErrorKind::InvalidData, e.to_string()),
                io::Error::other,
            )
        };
        let (from, share) = self.access.share;
        let done = 1.0 - self.left as f64 / self.count as f64;
        let going = (self.access.go_on)(from + share * done).and_then(|()| self.memory.check());
        going.map_err(io::Error::other)?;
        self.pages.inner().get_mut().done = done;
        let strips = match self.pages.get_chunk_type() {
            ChunkType::Strip => self.pages.strip_count().map_err(damaged)?,
            ChunkType::Tile => 1,
        };
        let size = if strips > 1 {
            let (_, rows) = self.pages.chunk_data_dimensions(self.strip);
            let (_, height) = self.pages.dimensions().map_err(damaged)?;
            let row = self.page / u64::from(height).max(1);
            row * u64::from(rows)
        } else {
            self.page
        };
        let size = usize::try_from(size).map_err(io::Error::other)?;
        if self.bytes.len() != size {
            self.bytes = Vec::new();
            self.bytes = zeroed(size, "pixels of a page").map_err(io::Error::other)?;
        }
        if strips > 1 {
            self.pages.read_chunk_bytes(self.strip, &mut self.bytes).map_err(damaged)?;
        } else {
            self.pages.read_image_bytes(&mut self.bytes).map_err(damaged)?;
        }
        if self.inverted {
            // As they are stored: the largest number less what the decoder made of them.
            self.bytes.iter_mut().for_each(|byte| *byte = !*byte);
        }
        self.at = 0;
        self.strip += 1;
        if self.strip >= strips {
            self.strip = 0;
            self.left -= 1;
            if self.left > 0 {
                self.pages.next_image().map_err(damaged)?;
            }
        }
        Ok(())
    }
}

impl Read for Stream<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.bytes.len() && self.left > 0 {
            self.decode()?;
        }
        let count = buffer.len().min(self.bytes.len() - self.at);
        buffer[..count].copy_from_slice(&self.bytes[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::io::Cursor;

    use tiff::encoder::colortype::{ColorType, Gray8, Gray16, GrayI32, RGB8};
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue};

    use super::super::tests::{labels, read_bytes};
    use super::super::{ReadOptions, read_image_with};
    use crate::Error;

    /// Pages of 3 x 2 pixels.
    fn stack<C: ColorType>(
        compression: Compression,
        rows: u32,
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
            image.rows_per_strip(rows).unwrap();
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

    /// A page of such a size, without any pixels.
    fn header_alone(width: u32, height: u32, bits: u32) -> Vec<u8> {
        let mut bytes = b"II*\0\x08\0\0\0\x07\0".to_vec();
        // Width, height, bits, no compression, 0 is black, place and bytes of the strip.
        let tags = [256, 257, 258, 259, 262, 273, 279_u16];
        for (tag, value) in tags.into_iter().zip([width, height, bits, 1, 1, 2, 0]) {
            bytes.extend(
                [&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0], &value.to_le_bytes()].concat(),
            );
        }
        bytes.extend([0; 4]);
        bytes
    }

    #[test]
    fn sizes_beyond_all_numbers_are_refused() {
        for (width, height) in [(0xffff_0002, 0x8000_0002), (u32::MAX, u32::MAX), (u32::MAX, 1)] {
            for bits in [8, 16, 64] {
                let error = read_bytes("a.tif", &header_alone(width, height, bits)).unwrap_err();
                assert!(error.contains("max-read-bytes"), "{width} x {height}: {error}");
            }
        }
    }

    fn values<T: From<u8>>() -> [Vec<T>; 2] {
        [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]].map(|page| page.map(T::from).into())
    }

    const EXPECTED: [i32; 12] = [0, 1, 2, 3, 4, 5, 5, 4, 3, 2, 1, 0];

    #[test]
    fn pages_are_slices() {
        let deflate = Compression::Deflate(DeflateLevel::Fast);
        for compression in [Compression::Uncompressed, Compression::Lzw, deflate] {
            for rows in [1, 2] {
                let bytes = stack::<Gray8>(compression, rows, &values(), None);
                let read = read_bytes("a.tif", &bytes).unwrap();
                assert_eq!(read.image.dims(), [3, 2, 2]);
                assert_eq!(labels(&read.image), EXPECTED);
                assert!(read.warnings[0].contains("--spacing"), "{:?}", read.warnings);
            }
            let bytes = stack::<Gray16>(compression, 2, &values(), None);
            assert_eq!(labels(&read_bytes("a.TIFF", &bytes).unwrap().image), EXPECTED);
        }
        let pages = [vec![0, -1, 2, 3, 4, 5], vec![5, 4, 3, 2, 1, 70_000]];
        let read =
            read_bytes("a.tif", &stack::<GrayI32>(Compression::Lzw, 1, &pages, None)).unwrap();
        assert_eq!(labels(&read.image)[1], -1);
        assert_eq!(labels(&read.image)[11], 70_000);
    }

    /// A page of one strip is decoded at once, but the file is not read at once.
    #[test]
    fn a_page_can_be_left() {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        let mut image = encoder.new_image::<Gray8>(4096, 1024).unwrap();
        image.rows_per_strip(1024).unwrap();
        image.write_data(&vec![0; 4096 * 1024]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        std::fs::write(&path, bytes.into_inner()).unwrap();
        let asked = |most: u32| {
            let count = Cell::new(0);
            let go_on = |_| {
                count.set(count.get() + 1);
                if count.get() > most { Err(Error::Cancelled) } else { Ok(()) }
            };
            let read = read_image_with(&path, &ReadOptions::default(), &go_on).map(|_| ());
            (read, count.get())
        };
        let (read, all) = asked(u32::MAX);
        read.unwrap();
        assert!(all > 5, "asked {all} times");
        for most in 0..all {
            let (read, count) = asked(most);
            assert!(matches!(read, Err(Error::Cancelled)), "{most} of {all}: {read:?}");
            assert_eq!(count, most + 1);
        }
    }

    #[test]
    fn the_spacing_of_imagej_is_taken() {
        let text = "ImageJ=1.53t\nimages=2\nslices=2\nunit=micron\nspacing=3.5\n";
        let bytes = stack::<Gray8>(Compression::Uncompressed, 2, &values(), Some(text));
        let read = read_bytes("a.tif", &bytes).unwrap();
        assert_eq!(read.image.frame().spacing().to_array(), [0.25, 0.5, 3.5]);
        assert!(read.warnings.is_empty());
    }

    /// A stack whose tag 262 says something else.
    fn photometric(value: u8) -> Vec<u8> {
        let mut bytes = stack::<Gray8>(Compression::Uncompressed, 2, &values(), None);
        let tag = [6, 1, 3, 0, 1, 0, 0, 0];
        let places: Vec<usize> =
            (0..bytes.len() - 8).filter(|&at| bytes[at..].starts_with(&tag)).collect();
        assert_eq!(places.len(), 2);
        places.into_iter().for_each(|at| bytes[at + 8] = value);
        bytes
    }

    #[test]
    fn labels_are_as_stored() {
        // Masks of ImageJ with 0 for white.
        assert_eq!(labels(&read_bytes("a.tif", &photometric(0)).unwrap().image), EXPECTED);
        let error = read_bytes("a.tif", &photometric(3)).unwrap_err().to_string();
        assert!(error.contains("colors by a table"), "{error}");
    }

    #[test]
    fn what_is_no_stack_of_slices_is_refused() {
        for (text, what) in [
            ("ImageJ=1.53t\nimages=12\nslices=12\n", "tells of 12 images"),
            ("ImageJ=1.53t\nimages=2\nchannels=2\n", "2 pages for each slice"),
            ("ImageJ=1.53t\nimages=2\nframes=2\n", "2 pages for each slice"),
            ("ImageJ=1\nchannels=18446744073709551615\nframes=2\n", "pages for each slice"),
        ] {
            let bytes = stack::<Gray8>(Compression::Uncompressed, 2, &values(), Some(text));
            let error = read_bytes("a.tif", &bytes).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
    }

    #[test]
    fn what_is_not_read_is_named() {
        let refused = |bytes: &[u8], what: &str| {
            let error = read_bytes("a.tif", bytes).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        let page = vec![0_u8; 18];
        let colors = stack::<RGB8>(Compression::Uncompressed, 2, &[page], None);
        refused(&colors, "only gray ones are read");
        refused(b"II*\0\x08\0\0\0", "not a TIFF file that is read");
        refused(b"neither", "not a TIFF file that is read");
        let whole = stack::<Gray8>(Compression::Lzw, 1, &values(), None);
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
