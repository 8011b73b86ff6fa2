//! NIfTI-1 and NIfTI-2 in one file (`.nii`, `.nii.gz`), either byte order. Source: the headers
//! nifti1.h and nifti2.h of the NIfTI Data Format Working Group.
//!
//! The place comes from the sform if its code is above 0, else from the qform, else from pixdim
//! with a warning. Spacings are those of pixdim where the sform has them rounded. An sform that is
//! sheared, or singular, is passed over for the qform, with a warning, as ITK does. World axes are
//! RAS.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts, frame_from_steps};
use crate::image::{Frame, WorldAxes};
use crate::{Error, Result};

const NIFTI1_SIZE: usize = 348;
const NIFTI2_SIZE: usize = 540;

/// Bytes after the header that say whether extensions follow; voxels come after them at the
/// earliest.
const EXTENSION_FLAG: u64 = 4;

/// The header fields used, whatever the version and byte order.
#[derive(Debug)]
struct Header {
    size: usize,
    big_endian: bool,
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quaternion: [f64; 3],
    offset: [f64; 3],
    sform: [[f64; 4]; 3],
}

pub(super) fn open<'a>(path: &Path, volumes: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let mut source = Source::open_maybe_gzip(path, access)?;
    let header = Header::read(&mut source)?;
    let mut warnings = Vec::new();
    let (sizes, values) = header.sizes(&source, volumes)?;
    let (frame, world) = header.frame(path, &mut warnings)?;
    let coding = if header.big_endian { Coding::BigEndian } else { Coding::LittleEndian };
    let scalar = header.scalar(&source)?;
    if usize::try_from(header.bitpix).ok() != Some(8 * scalar.size()) {
        warnings.push(format!(
            "bitpix is {}, but datatype {} has {} bits; the datatype is taken",
            header.bitpix,
            header.datatype,
            8 * scalar.size()
        ));
    }
    let mut layout =
        Layout::new(&source, sizes, scalar, coding)?.with_volumes(&source, values, false)?;
    layout.scale = header.scale();
    header.skip_to_voxels(&mut source, &mut warnings)?;
    Ok(Opened { source, layout, frame, world, segments: None, is_reversed: false, warnings })
}

/// Numbers at their places in a header.
struct Raw<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Raw<'_> {
    fn take<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut raw = [0; N];
        raw.copy_from_slice(&self.bytes[at..at + N]);
        if self.big_endian {
            raw.reverse();
        }
        raw
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.take(at))
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.take(at))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.take(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.take(at)))
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.take(at))
    }
}

/// How far apart, in voxels, sform and qform may place the image without a word: both are rounded.
const FORMS_APART: f64 = 0.01;

/// How far lengths of the sform's columns may be from pixdim by rounding alone, relatively.
const SINGLE_PRECISION: f64 = 1e-6;

impl Header {
    fn read(source: &mut Source) -> Result<Self> {
        let mut bytes = [0_u8; NIFTI2_SIZE];
        let cut_off = |source: &Source, held: usize, size: usize| {
            source.error(format!("the header is cut off: {held} of {size} bytes"))
        };
        let mut held = source.read_up_to(&mut bytes[..NIFTI1_SIZE])?;
        if held < NIFTI1_SIZE {
            return Err(cut_off(source, held, NIFTI1_SIZE));
        }
        let stated = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let (size, big_endian) =
            match (u32::from_le_bytes(stated) as usize, u32::from_be_bytes(stated) as usize) {
                (size @ (NIFTI1_SIZE | NIFTI2_SIZE), _) => (size, false),
                (_, size @ (NIFTI1_SIZE | NIFTI2_SIZE)) => (size, true),
                (size, _) => {
                    return Err(source.error(format!(
                        "not a NIfTI file: the header begins with {size}, not with 348 or 540"
                    )));
                }
            };
        if size == NIFTI2_SIZE {
            held += source.read_up_to(&mut bytes[NIFTI1_SIZE..])?;
            if held < NIFTI2_SIZE {
                return Err(cut_off(source, held, NIFTI2_SIZE));
            }
        }
        let raw = Raw { bytes: &bytes, big_endian };
        let (magic, ours, pair): (&[u8], &[u8], &[u8]) = if size == NIFTI1_SIZE {
            (&bytes[344..348], b"n+1\0", b"ni1\0")
        } else {
            (&bytes[4..12], b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n")
        };
        if magic == pair {
            return Err(source.error(
                "the voxels are in a separate .img file, which is not supported; \
                    convert to one file",
            ));
        }
        if magic != ours {
            return Err(source.error(format!(
                "not a NIfTI file: magic is '{}', not '{}'",
                magic.escape_ascii(),
                ours.escape_ascii()
            )));
        }
        Ok(if size == NIFTI1_SIZE { Self::version1(&raw) } else { Self::version2(&raw) })
    }

    fn version1(raw: &Raw<'_>) -> Self {
        Self {
            size: NIFTI1_SIZE,
            big_endian: raw.big_endian,
            dim: std::array::from_fn(|i| i64::from(raw.i16(40 + 2 * i))),
            datatype: raw.i16(70),
            bitpix: raw.i16(72),
            pixdim: std::array::from_fn(|i| raw.f32(76 + 4 * i)),
            vox_offset: raw.f32(108),
            slope: raw.f32(112),
            intercept: raw.f32(116),
            units: i32::from(raw.bytes[123]),
            qform_code: i32::from(raw.i16(252)),
            sform_code: i32::from(raw.i16(254)),
            quaternion: std::array::from_fn(|i| raw.f32(256 + 4 * i)),
            offset: std::array::from_fn(|i| raw.f32(268 + 4 * i)),
            sform: std::array::from_fn(|row| {
                std::array::from_fn(|i| raw.f32(280 + 16 * row + 4 * i))
            }),
        }
    }

    fn version2(raw: &Raw<'_>) -> Self {
        Self {
            size: NIFTI2_SIZE,
            big_endian: raw.big_endian,
            dim: std::array::from_fn(|i| raw.i64(16 + 8 * i)),
            datatype: raw.i16(12),
            bitpix: raw.i16(14),
            pixdim: std::array::from_fn(|i| raw.f64(104 + 8 * i)),
            // Exact: an offset past 2^53 lies past the end of any file.
            vox_offset: raw.i64(168) as f64,
            slope: raw.f64(176),
            intercept: raw.f64(184),
            units: raw.i32(500),
            qform_code: raw.i32(344),
            sform_code: raw.i32(348),
            quaternion: std::array::from_fn(|i| raw.f64(352 + 8 * i)),
            offset: std::array::from_fn(|i| raw.f64(376 + 8 * i)),
            sform: std::array::from_fn(|row| {
                std::array::from_fn(|i| raw.f64(400 + 32 * row + 8 * i))
            }),
        }
    }

    /// Voxels along the three axes, and values per voxel: of the further axes (time, values) only
    /// one may have several samples, and for labels none.
    fn sizes(&self, source: &Source, volumes: Volumes) -> Result<([u64; 3], u64)> {
        let rank = self.dim[0];
        if !(1..=7).contains(&rank) {
            return Err(source
                .error(format!("dim[0], the number of dimensions, is {rank}; it must be 1 to 7")));
        }
        if rank < 3 {
            return Err(source.error(format!("dim[0] is {rank}: only volumes are read")));
        }
        let mut values = 1;
        for axis in 1..=rank as usize {
            let n = self.dim[axis];
            if n < 1 {
                return Err(source.error(format!("dim[{axis}] is {n}; it must be at least 1")));
            }
            if axis > 3 && n > 1 {
                if volumes == Volumes::One || values > 1 {
                    return Err(source.error(format!(
                        "dim[{axis}] is {n}: there are several volumes; --volume \
                         (lapd_context_set_volume) reads one of them as labels, --probabilities \
                         all as maps"
                    )));
                }
                values = n.unsigned_abs();
            }
        }
        Ok(([1, 2, 3].map(|axis| self.dim[axis].unsigned_abs()), values))
    }

    fn scalar(&self, source: &Source) -> Result<Scalar> {
        Ok(match self.datatype {
            2 => Scalar::U8,
            4 => Scalar::I16,
            8 => Scalar::I32,
            16 => Scalar::F32,
            64 => Scalar::F64,
            256 => Scalar::I8,
            512 => Scalar::U16,
            768 => Scalar::U32,
            1024 => Scalar::I64,
            1280 => Scalar::U64,
            code => {
                let what = match code {
                    1 => " (bits)",
                    32 | 1792 | 2048 => " (complex numbers)",
                    128 | 2304 => " (colors)",
                    1536 => " (floats of 128 bits)",
                    _ => "",
                };
                return Err(source.error(format!(
                    "datatype {code}{what} is not read: only integers and floats of up to 64 bits \
                     are; save the labels as integers of 8 or 16 bits"
                )));
            }
        })
    }

    /// A slope of 0 or NaN means that voxels are not scaled.
    fn scale(&self) -> Option<(f64, f64)> {
        let intercept = if self.intercept.is_finite() { self.intercept } else { 0.0 };
        let scales =
            self.slope.is_finite() && self.slope != 0.0 && (self.slope, intercept) != (1.0, 0.0);
        scales.then_some((self.slope, intercept))
    }

    fn skip_to_voxels(&self, source: &mut Source, warnings: &mut Vec<String>) -> Result<()> {
        let min = self.size as u64 + EXTENSION_FLAG;
        if !(self.vox_offset.is_finite() && self.vox_offset >= 0.0) {
            return Err(source.error(format!("vox_offset is {}", self.vox_offset)));
        }
        let mut offset = self.vox_offset as u64;
        if offset < min {
            if offset != 0 {
                warnings.push(format!(
                    "vox_offset {offset} lies within the header; voxels are read from byte {min}"
                ));
            }
            offset = min;
        }
        source.skip(offset - self.size as u64, &format!("vox_offset {offset}"))
    }

    fn frame(&self, path: &Path, warnings: &mut Vec<String>) -> Result<(Frame, Option<WorldAxes>)> {
        match self.units & 7 {
            1 => warnings.push(
                "the header's unit of length is the metre, not the millimetre; \
                coordinates are kept in metres"
                    .into(),
            ),
            3 => warnings.push(
                "the header's unit of length is the micrometre, not the millimetre; \
                coordinates are kept in micrometres"
                    .into(),
            ),
            _ => {}
        }
        let spacing = [self.pixdim[1], self.pixdim[2], self.pixdim[3]];
        if self.sform_code > 0 {
            if let Some(axis) = spacing.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
                warnings.push(format!(
                    "pixdim[{}] is {}; spacings are taken from the sform",
                    axis + 1,
                    spacing[axis]
                ));
            }
            let steps = [0, 1, 2].map(|axis| self.sform.map(|row| row[axis]));
            let origin = self.sform.map(|row| row[3]);
            // The lengths of the sform's columns are rounded once more than pixdim, which ITK
            // takes, too.
            let spacing_of = |axis: usize, length: f64| {
                let is_same = (length - spacing[axis]).abs() <= SINGLE_PRECISION * length;
                if is_same { spacing[axis] } else { length }
            };
            let by_sform = frame_from_steps(path, "sform", origin, steps, spacing_of);
            let by_qform =
                if self.qform_code > 0 { self.by_qform(path, spacing).ok() } else { None };
            let frame = match (by_sform, by_qform) {
                (Ok(by_sform), Some(by_qform)) => {
                    let apart = self.apart(&by_sform, &by_qform);
                    if apart > FORMS_APART {
                        warnings.push(format!(
                            "sform and qform place the image differently, by up to {apart:.3} \
                             voxels; the sform is taken"
                        ));
                    }
                    by_sform
                }
                (Err(Error::Format { message, .. }), Some(by_qform)) => {
                    warnings.push(format!("the qform is taken, for {message}"));
                    by_qform
                }
                (by_sform, _) => by_sform?,
            };
            return Ok((frame, Some(WorldAxes::Ras)));
        }
        if let Some(axis) = spacing.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(Error::format(
                path,
                format!(
                    "pixdim[{}], a spacing, is {}; it must be above 0",
                    axis + 1,
                    spacing[axis]
                ),
            ));
        }
        if self.qform_code > 0 {
            return Ok((self.by_qform(path, spacing)?, Some(WorldAxes::Ras)));
        }
        warnings.push(
            "sform and qform codes are both 0, so the header gives no place; spacings \
            are taken, axes along the world's, origin 0"
                .into(),
        );
        let frame = frame_from_parts(
            path,
            "pixdim",
            [0.0; 3],
            spacing,
            DMat3::IDENTITY.to_cols_array_2d(),
        )?;
        Ok((frame, None))
    }

    fn by_qform(&self, path: &Path, spacing: [f64; 3]) -> Result<Frame> {
        let direction = self.qform_direction().to_cols_array_2d();
        frame_from_parts(path, "qform", self.offset, spacing, direction)
    }

    /// How far apart two frames place a corner of the image at most, in voxels of the first.
    fn apart(&self, first: &Frame, second: &Frame) -> f64 {
        let last = [1, 2, 3].map(|axis| (self.dim[axis] - 1).max(0) as f64);
        let corners = (0..8)
            .map(|c| DVec3::from([0, 1, 2].map(|a| if c >> a & 1 == 1 { last[a] } else { 0.0 })));
        corners.map(|x| (first.to_index(second.to_world(x)) - x).length()).fold(0.0, f64::max)
    }

    /// The rotation of a unit quaternion of which b, c, d are stored, with the third axis turned
    /// around when pixdim[0] is below 0.
    fn qform_direction(&self) -> DMat3 {
        let [b, c, d] = self.quaternion;
        let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
        let mut direction = DMat3::from_quat(DQuat::from_xyzw(b, c, d, a).normalize());
        if self.pixdim[0] < 0.0 {
            direction.z_axis = -direction.z_axis;
        }
        direction
    }
}

#[cfg(test)]
mod tests {
    use super::super::ReadImage;
    use super::super::tests::{gzip, labels, read_bytes};
    use super::*;

    /// A header under construction: numbers go to their places in either version and byte order.
    struct Made {
        bytes: Vec<u8>,
        version: usize,
        big: bool,
    }

    impl Made {
        /// 3 x 2 x 1 voxels of i16, sform code 2 with spacings 2, 3, 4 and origin (10, 20, 30).
        fn new(version: usize, big: bool) -> Self {
            let size = if version == 1 { NIFTI1_SIZE } else { NIFTI2_SIZE };
            let mut made = Self { bytes: vec![0; size + 4], version, big };
            made.put(0, &(size as i32).to_le_bytes());
            if version == 1 {
                made.bytes[344..348].copy_from_slice(b"n+1\0")
            } else {
                made.bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n")
            }
            made.dims(&[3, 3, 2, 1]).short(70, 12, 4).short(72, 14, 16).real(
                76,
                104,
                &[1.0, 2.0, 3.0, 4.0],
            );
            made.codes(0, 2).real(
                280,
                400,
                &[2.0, 0.0, 0.0, 10.0, 0.0, 3.0, 0.0, 20.0, 0.0, 0.0, 4.0, 30.0],
            );
            made.offset((size + 4) as i64);
            made
        }

        fn put(&mut self, at: usize, little: &[u8]) {
            let slot = &mut self.bytes[at..at + little.len()];
            slot.copy_from_slice(little);
            if self.big {
                slot.reverse();
            }
        }

        fn dims(&mut self, dims: &[i64]) -> &mut Self {
            for (i, &n) in dims.iter().enumerate() {
                if self.version == 1 {
                    self.put(40 + 2 * i, &(n as i16).to_le_bytes())
                } else {
                    self.put(16 + 8 * i, &n.to_le_bytes())
                }
            }
            self
        }

        fn short(&mut self, at1: usize, at2: usize, value: i16) -> &mut Self {
            self.put(if self.version == 1 { at1 } else { at2 }, &value.to_le_bytes());
            self
        }

        fn real(&mut self, at1: usize, at2: usize, values: &[f64]) -> &mut Self {
            for (i, &x) in values.iter().enumerate() {
                if self.version == 1 {
                    self.put(at1 + 4 * i, &(x as f32).to_le_bytes())
                } else {
                    self.put(at2 + 8 * i, &x.to_le_bytes())
                }
            }
            self
        }

        fn codes(&mut self, qform: i16, sform: i16) -> &mut Self {
            if self.version == 1 {
                self.short(252, 0, qform).short(254, 0, sform)
            } else {
                self.put(344, &i32::from(qform).to_le_bytes());
                self.put(348, &i32::from(sform).to_le_bytes());
                self
            }
        }

        fn offset(&mut self, offset: i64) -> &mut Self {
            if self.version == 1 {
                self.real(108, 0, &[offset as f64])
            } else {
                self.put(168, &offset.to_le_bytes());
                self
            }
        }

        fn with(&self, values: &[i16]) -> Vec<u8> {
            let voxels = values
                .iter()
                .flat_map(|v| if self.big { v.to_be_bytes() } else { v.to_le_bytes() });
            self.bytes.iter().copied().chain(voxels).collect()
        }
    }

    const VALUES: [i16; 6] = [0, 1, -300, 5, 5, 0];

    fn read_made(made: &Made) -> std::result::Result<ReadImage, String> {
        read_bytes("a.nii", &made.with(&VALUES))
    }

    #[test]
    fn both_versions_and_byte_orders_gzipped_or_not() {
        for (version, big) in [(1, false), (1, true), (2, false), (2, true)] {
            let bytes = Made::new(version, big).with(&VALUES);
            for read in [
                read_bytes("a.nii", &bytes),
                read_bytes("a.nii.gz", &gzip(&bytes)),
                read_bytes("a.NII", &gzip(&bytes)),
            ] {
                let read = read.unwrap();
                assert_eq!(
                    (labels(&read.image), read.image.dims()),
                    (VALUES.map(i32::from).to_vec(), [3, 2, 1])
                );
                assert_eq!((read.world, read.warnings.len()), (Some(WorldAxes::Ras), 0));
                assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(12.0, 23.0, 34.0));
            }
        }
    }

    #[test]
    fn the_qform_stands_in_for_a_sheared_sform() {
        for version in [1, 2] {
            let mut made = Made::new(version, false);
            // The same place by both; then elsewhere by the qform.
            made.codes(1, 2).real(268, 376, &[10.0, 20.0, 30.0]);
            let both = read_made(&made).unwrap();
            assert_eq!(both.warnings, Vec::<String>::new());
            made.real(268, 376, &[10.0, 20.0, 31.0]);
            let apart = read_made(&made).unwrap();
            assert_eq!(apart.image.frame().origin(), DVec3::new(10.0, 20.0, 30.0));
            assert!(
                apart.warnings[0].starts_with(
                    "sform and qform place the image differently, by up to 0.250 voxels"
                )
            );
            // Sheared, singular, or no numbers: the qform, if there is one.
            for bad in [[3.0, 3.0], [0.0, 0.0], [f64::NAN, 0.0]] {
                made.real(280, 400, &bad);
                let read = read_made(made.codes(1, 2)).unwrap();
                assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(12.0, 23.0, 35.0));
                assert!(
                    read.warnings[0].starts_with("the qform is taken, for sform"),
                    "{:?}",
                    read.warnings
                );
                assert!(read_made(made.codes(0, 2)).unwrap_err().starts_with("sform"));
            }
        }
    }

    #[test]
    fn the_place_comes_from_sform_then_qform_then_pixdim() {
        for version in [1, 2] {
            let mut made = Made::new(version, false);
            // Half a turn about z, as (b, c, d) = (0, 0, 1), and the third axis turned around.
            made.codes(1, 0)
                .real(256, 352, &[0.0, 0.0, 1.0])
                .real(268, 376, &[7.0, 8.0, 9.0])
                .real(76, 104, &[-1.0]);
            let read = read_made(&made).unwrap();
            assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(5.0, 5.0, 5.0));
            let bare = read_made(made.codes(0, 0)).unwrap();
            assert_eq!(
                (bare.image.frame().to_world(DVec3::ONE), bare.world),
                (DVec3::new(2.0, 3.0, 4.0), None)
            );
            assert!(bare.warnings[0].contains("codes are both 0"));
            made.real(76, 104, &[1.0, 2.0, 0.0, 4.0]);
            assert_eq!(
                read_made(&made).unwrap_err(),
                "pixdim[2], a spacing, is 0; it must be above 0"
            );
            assert!(read_made(made.codes(0, 1)).unwrap().warnings[0].contains("pixdim[2] is 0"));
            made.real(280, 400, &[0.0]);
            assert_eq!(
                read_made(&made).unwrap_err(),
                "sform is singular: image axis 0 has length 0"
            );
            made.real(280, 400, &[3.0, 3.0]);
            assert!(read_made(&made).unwrap_err().contains("orthonormal"));
            made.real(280, 400, &[f64::NAN]);
            assert!(read_made(&made).unwrap_err().contains("finite"));
        }
    }

    #[test]
    fn spacings_are_those_of_pixdim_where_the_sform_has_them_rounded() {
        let (sin, cos) = 0.7_f64.sin_cos();
        let sform = |second: f64| {
            [2.0 * cos, -second * sin, 0.0, 1.0, 2.0 * sin, second * cos, 0.0, 2.0]
                .map(|x| f64::from(x as f32))
        };
        let mut made = Made::new(1, false);
        made.codes(0, 1).real(280, 400, &sform(3.0));
        let spacing = |made: &Made| read_made(made).unwrap().image.frame().spacing();
        assert_eq!(spacing(&made), DVec3::new(2.0, 3.0, 4.0));
        made.real(280, 400, &sform(3.1));
        assert!((spacing(&made).y - 3.1).abs() < 1e-6);
    }

    #[test]
    fn scaled_voxels_must_stay_whole() {
        let mut made = Made::new(1, false);
        made.real(112, 176, &[2.0, 1.0]);
        assert_eq!(labels(&read_made(&made).unwrap().image), [1, 3, -599, 11, 11, 1]);
        made.real(112, 176, &[f64::NAN, 5.0]);
        assert_eq!(labels(&read_made(&made).unwrap().image), VALUES.map(i32::from));
        made.real(112, 176, &[0.5, 0.0]);
        assert_eq!(
            read_made(&made).unwrap_err(),
            "voxel (1, 0, 0) is 0.5: labels must be whole numbers; --round (LAPD_LABELS_ROUNDED) \
             takes the nearest ones, --map (LAPD_LABELS_DISTINCT) numbers distinct values"
        );
        made.real(112, 176, &[1e9, 0.0]);
        assert!(read_made(&made).unwrap_err().contains("must fit"));
        // A tenth in single precision.
        made.real(112, 176, &[0.1, 0.0]);
        assert_eq!(
            labels(&read_bytes("a.nii", &made.with(&[10, 20, -30, 30000, 0, 0])).unwrap().image),
            [1, 2, -3, 3000, 0, 0]
        );
    }

    #[test]
    fn every_number_type() {
        let check = |code: i16, bytes: &[u8]| {
            let mut made = Made::new(2, false);
            made.short(70, 12, code).dims(&[4, 2, 1, 1, 1]).short(72, 14, (bytes.len() * 4) as i16);
            let read = read_bytes("a.nii", &[&made.bytes[..], bytes].concat()).unwrap();
            assert_eq!(
                (labels(&read.image), read.warnings.len()),
                (vec![100, 7], 0),
                "datatype {code}"
            );
        };
        macro_rules! each {
            ($($code:literal $t:ty),*) => {
                $(
                    let values = [100 as $t, 7 as $t];
                    check($code, &values.map(|value| value.to_le_bytes()).concat());
                )*
            }
        }
        each!(2 u8, 4 i16, 8 i32, 16 f32, 64 f64, 256 i8, 512 u16, 768 u32, 1024 i64, 1280 u64);
        for value in [0.5, f64::NAN, f64::INFINITY, 3e9] {
            let mut made = Made::new(1, false);
            made.short(70, 12, 64).dims(&[3, 2, 1, 1]);
            let message = read_bytes(
                "a.nii",
                &[&made.bytes[..], &1f64.to_le_bytes(), &f64::to_le_bytes(value)].concat(),
            )
            .unwrap_err();
            assert!(
                message.starts_with(&format!("voxel (1, 0, 0) is {value}: labels must")),
                "{message}"
            );
        }
    }

    #[test]
    fn refuses_what_is_damaged() {
        for version in [1, 2] {
            let refusal = |change: &dyn Fn(&mut Made)| {
                let mut made = Made::new(version, version == 1);
                change(&mut made);
                read_made(&made).unwrap_err()
            };
            assert!(
                refusal(&|m| {
                    m.dims(&[0]);
                })
                .starts_with("dim[0], the number of dimensions, is 0")
            );
            assert!(
                refusal(&|m| {
                    m.dims(&[2]);
                })
                .contains("only volumes")
            );
            assert!(
                refusal(&|m| {
                    m.dims(&[3, 3, -2]);
                })
                .contains("dim[2] is -2")
            );
            assert!(
                refusal(&|m| {
                    m.dims(&[4, 3, 2, 1, 2]);
                })
                .contains("several volumes")
            );
            assert!(
                refusal(&|m| {
                    m.dims(&[3, 30000, 30000, 30000]);
                })
                .contains("too large")
            );
            assert!(
                refusal(&|m| {
                    m.dims(&[3, 1000, 1000, 1000]);
                })
                .contains("need 2000000000 bytes, the file can hold 12")
            );
            assert!(
                refusal(&|m| {
                    m.offset(1 << 40);
                })
                .contains("vox_offset 1099511627776 lies past the end")
            );
            assert!(
                refusal(&|m| {
                    m.offset(-1);
                })
                .contains("vox_offset is -1")
            );
            assert!(
                refusal(&|m| {
                    m.short(70, 12, 128);
                })
                .contains("datatype 128 (colors) is not read")
            );
            assert!(
                refusal(&|m| {
                    m.offset(m.bytes.len() as i64 + 1);
                })
                .contains("cut off")
            );
        }
        let mut made = Made::new(1, false);
        made.bytes[344..348].copy_from_slice(b"ni1\0");
        assert!(read_made(&made).unwrap_err().contains("separate .img"));
        made.bytes[344] = b'x';
        assert!(read_made(&made).unwrap_err().contains(r"magic is 'xi1\x00'"));
        made.bytes[0] = 1;
        assert!(read_made(&made).unwrap_err().contains("not a NIfTI file"));
        assert!(
            read_bytes("a.nii", &Made::new(2, false).bytes[..500])
                .unwrap_err()
                .contains("cut off: 500 of 540")
        );
        assert!(
            read_bytes("a.nii.gz", &gzip(&Made::new(1, false).with(&VALUES[..5])))
                .unwrap_err()
                .contains("cut off: 12 bytes are needed, 10")
        );
        let mut early = Made::new(1, false);
        assert!(read_made(early.offset(100)).unwrap().warnings[0].contains("within the header"));
    }

    #[test]
    fn one_of_several_volumes_is_read() {
        let mut made = Made::new(1, false);
        made.dims(&[4, 3, 2, 1, 2]);
        let stored: Vec<u8> = (0..12_i16).flat_map(i16::to_le_bytes).collect();
        made.bytes.extend(stored);
        for (name, bytes) in [("a.nii", made.bytes.clone()), ("a.nii.gz", gzip(&made.bytes))] {
            let files = super::super::tests::Files::new();
            let path = files.write(name, &bytes);
            let read = |volume| {
                let options = super::super::ReadOptions { volume, ..Default::default() };
                super::super::read_image_with(&path, &options, &|_| Ok(()))
            };
            for volume in 0..2 {
                let image = read(Some(volume)).unwrap();
                let first = 6 * volume as i32;
                assert_eq!(labels(&image.image), (first..first + 6).collect::<Vec<_>>());
                assert!(image.warnings.is_empty(), "{:?}", image.warnings);
            }
            assert!(read(None).unwrap_err().to_string().contains("--volume"));
            assert!(read(Some(2)).unwrap_err().to_string().contains("there are 2"));
        }
    }
}
