//! From the bytes of a file to labels: the one place that knows number types, byte orders and text, for all formats.

use super::super::LabelImage;
use super::super::builder::{LabelBuilder, voxel_count};
use super::super::frame::Frame;
use super::fields::excerpt;
use super::source::Source;
use crate::{Error, Result};

/// Voxels decoded at a time.
const CHUNK: usize = 1 << 16;

/// Voxels per byte of the file for which room is made before they are seen; segmentations compress about so well.
const TRUSTED_RATIO: u64 = 64;

/// The longest number in text.
const MAX_WORD: usize = 64;

/// Type of a stored voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Scalar {
    pub(super) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// An integer type by its width.
    pub(super) fn integer(bytes: usize, signed: bool) -> Option<Self> {
        Some(match (bytes, signed) {
            (1, false) => Self::U8,
            (1, true) => Self::I8,
            (2, false) => Self::U16,
            (2, true) => Self::I16,
            (4, false) => Self::U32,
            (4, true) => Self::I32,
            (8, false) => Self::U64,
            (8, true) => Self::I64,
            _ => return None,
        })
    }
}

/// How the voxels stand in the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    LittleEndian,
    BigEndian,
    /// Numbers in text, separated by white space.
    Text,
}

/// What a header says of its voxels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) dims: [usize; 3],
    pub(super) scalar: Scalar,
    pub(super) coding: Coding,
    /// Label = slope * stored + intercept.
    pub(super) scale: Option<(f64, f64)>,
}

impl Layout {
    /// Checks the sizes of a header: each axis, and the voxels and bytes they make.
    pub(super) fn new(source: &Source, sizes: [u64; 3], scalar: Scalar, coding: Coding) -> Result<Self> {
        let mut dims = [0; 3];
        for axis in 0..3 {
            dims[axis] = usize::try_from(sizes[axis]).unwrap_or(usize::MAX);
        }
        voxel_count(dims).map_err(|e| source.error(e.to_string()))?;
        Ok(Self { dims, scalar, coding, scale: None })
    }

    /// Cannot overflow: `new` saw to it that there are fewer than 2^32 voxels.
    fn voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// Bytes that the voxels take in the stream; for text, the least they can take.
    pub(super) fn bytes(&self) -> u64 {
        match self.coding {
            Coding::Text => 2 * self.voxels() as u64 - 1,
            _ => self.voxels() as u64 * self.scalar.size() as u64,
        }
    }
}

/// Reads the voxels and whatever follows them. Warns about bytes left over.
pub(super) fn read_labels(
    source: &mut Source,
    layout: &Layout,
    frame: Frame,
    warnings: &mut Vec<String>,
) -> Result<LabelImage> {
    let (claimed, held) = (layout.bytes(), source.remaining());
    if claimed > held {
        let [nx, ny, nz] = layout.dims;
        let compressed = if source.is_compressed() { " even if perfectly compressed" } else { "" };
        return Err(source.error(format!(
            "the voxel data is cut off: {nx} x {ny} x {nz} voxels need {claimed} bytes, the file can hold {held}{compressed}"
        )));
    }
    // In proportion to what the file holds, not to what it claims.
    let file_bytes = if source.is_compressed() { held / 1032 } else { held };
    let reserve = usize::try_from(file_bytes.saturating_mul(TRUSTED_RATIO)).unwrap_or(usize::MAX);
    let mut builder = LabelBuilder::new(layout.dims, reserve)?;
    match layout.coding {
        Coding::Text => read_text(source, layout, &mut builder)?,
        _ => read_binary(source, layout, &mut builder)?,
    }
    let excess = source.drain()?;
    if excess > 0 && layout.coding != Coding::Text {
        warnings.push(format!(
            "the file holds {excess} bytes or more after the voxels that its header describes; they are ignored"
        ));
    }
    builder.finish(frame)
}

fn push(source: &Source, builder: &mut LabelBuilder, labels: &[i32]) -> Result<()> {
    builder.push(labels).map_err(|e| match e {
        Error::InvalidArgument(message) => source.error(message),
        other => other,
    })
}

/// Why a voxel is no label.
fn bad_voxel(source: &Source, layout: &Layout, voxel: usize, value: f64) -> Error {
    let [nx, ny, _] = layout.dims;
    let (i, j, k) = (voxel % nx, voxel / nx % ny, voxel / (nx * ny));
    let why =
        if value.fract() == 0.0 { "labels must fit a 32-bit signed integer" } else { "labels must be whole numbers" };
    source.error(format!("voxel ({i}, {j}, {k}) is {value}: {why}"))
}

fn read_binary(source: &mut Source, layout: &Layout, builder: &mut LabelBuilder) -> Result<()> {
    let (total, size) = (layout.voxels(), layout.scalar.size());
    let mut bytes = vec![0_u8; CHUNK.min(total) * size];
    let mut labels = vec![0_i32; CHUNK.min(total)];
    let mut done = 0;
    while done < total {
        let count = CHUNK.min(total - done);
        let (bytes, labels) = (&mut bytes[..count * size], &mut labels[..count]);
        let filled = source.read_up_to(bytes)?;
        if filled < bytes.len() {
            let held = done * size + filled;
            return Err(source
                .error(format!("the voxel data is cut off: {} bytes are needed, {held} are there", layout.bytes())));
        }
        if let Err((at, value)) = decode(bytes, layout, labels) {
            return Err(bad_voxel(source, layout, done + at, value));
        }
        push(source, builder, labels)?;
        done += count;
    }
    Ok(())
}

/// A stored number.
trait Sample: Copy {
    /// The number as a label, if it is one.
    fn label(self) -> Option<i32>;
    fn real(self) -> f64;
}

macro_rules! integer_samples {
    ($($t:ty)*) => { $(impl Sample for $t {
        fn label(self) -> Option<i32> {
            i32::try_from(self).ok()
        }
        fn real(self) -> f64 {
            self as f64
        }
    })* };
}
integer_samples!(u8 i8 u16 i16 u32 i32 u64 i64);

impl Sample for f64 {
    fn label(self) -> Option<i32> {
        // The conversion saturates, so a number out of range does not come back equal.
        let label = self as i32;
        (f64::from(label) == self).then_some(label)
    }
    fn real(self) -> f64 {
        self
    }
}

impl Sample for f32 {
    fn label(self) -> Option<i32> {
        f64::from(self).label()
    }
    fn real(self) -> f64 {
        f64::from(self)
    }
}

/// Decodes as many voxels as `labels` has. The error is the first that is no label: its place and value.
fn decode(bytes: &[u8], layout: &Layout, labels: &mut [i32]) -> std::result::Result<(), (usize, f64)> {
    macro_rules! each {
        ($t:ty) => {
            match layout.coding {
                Coding::BigEndian => decode_as(bytes, <$t>::from_be_bytes, layout.scale, labels),
                _ => decode_as(bytes, <$t>::from_le_bytes, layout.scale, labels),
            }
        };
    }
    match layout.scalar {
        Scalar::U8 => each!(u8),
        Scalar::I8 => each!(i8),
        Scalar::U16 => each!(u16),
        Scalar::I16 => each!(i16),
        Scalar::U32 => each!(u32),
        Scalar::I32 => each!(i32),
        Scalar::U64 => each!(u64),
        Scalar::I64 => each!(i64),
        Scalar::F32 => each!(f32),
        Scalar::F64 => each!(f64),
    }
}

fn decode_as<T: Sample, const N: usize>(
    bytes: &[u8],
    sample: impl Fn([u8; N]) -> T,
    scale: Option<(f64, f64)>,
    labels: &mut [i32],
) -> std::result::Result<(), (usize, f64)> {
    let stored = bytes.as_chunks::<N>().0.iter().map(|raw| sample(*raw));
    match scale {
        None => {
            for (at, (slot, value)) in labels.iter_mut().zip(stored).enumerate() {
                *slot = value.label().ok_or((at, value.real()))?;
            }
        }
        Some((slope, intercept)) => {
            for (at, (slot, value)) in labels.iter_mut().zip(stored).enumerate() {
                let (product, value) = (slope * value.real(), slope * value.real() + intercept);
                // Headers store the slope in single precision: a product is exact to 2^-24 of itself only.
                let tolerance = 1e-7 * product.abs().max(intercept.abs()).max(value.abs());
                let whole = value.round();
                *slot = if (value - whole).abs() <= tolerance { whole.label() } else { None }.ok_or((at, value))?;
            }
        }
    }
    Ok(())
}

fn read_text(source: &mut Source, layout: &Layout, builder: &mut LabelBuilder) -> Result<()> {
    let total = layout.voxels();
    let mut bytes = vec![0_u8; CHUNK];
    let mut labels: Vec<i32> = Vec::with_capacity(CHUNK);
    let mut word: Vec<u8> = Vec::new();
    let mut done = 0;
    loop {
        let filled = source.read_up_to(&mut bytes)?;
        // A blank after the last byte ends the last word.
        let end = (filled < bytes.len()).then_some(b' ');
        for byte in bytes[..filled].iter().copied().chain(end) {
            if !byte.is_ascii_whitespace() {
                if word.len() == MAX_WORD {
                    return Err(source.error(format!("'{}' is not a number", excerpt(&String::from_utf8_lossy(&word)))));
                }
                word.push(byte);
                continue;
            }
            if word.is_empty() {
                continue;
            }
            if done + labels.len() == total {
                return Err(source.error(format!("there are more than the {total} numbers that the header describes")));
            }
            labels.push(label_of_word(source, layout, done + labels.len(), &word)?);
            word.clear();
        }
        push(source, builder, &labels)?;
        done += labels.len();
        labels.clear();
        if end.is_some() {
            break;
        }
    }
    if done < total {
        return Err(source.error(format!("the voxel data is cut off: {total} numbers are needed, {done} are there")));
    }
    Ok(())
}

fn label_of_word(source: &Source, layout: &Layout, voxel: usize, word: &[u8]) -> Result<i32> {
    let text = String::from_utf8_lossy(word);
    let value: f64 = text.parse().map_err(|_| source.error(format!("'{}' is not a number", excerpt(&text))))?;
    value.label().ok_or_else(|| bad_voxel(source, layout, voxel, value))
}
