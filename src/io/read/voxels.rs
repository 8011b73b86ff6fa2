//! From the bytes of a file to labels or real numbers: the one place that knows number types, byte
//! orders and text, for all formats.

use super::LabelValues;
use super::distinct::{Distinct, Number, told};
use super::segments::{Finished, Segments};
use super::source::Source;
use crate::image::{Frame, LabelBuilder, LabelImage, LabelNames, voxel_count};
use crate::memory::{filled, reserve, room, zeroed};
use crate::{Error, Result};

/// Voxels decoded at a time.
const CHUNK: usize = 1 << 16;

/// What is counted where there is no memory for them.
const NUMBERS: &str = "numbers of a file";

/// Voxels per byte of the file for which room is made before they are seen; segmentations compress
/// about so well.
const TRUSTED_RATIO: u64 = 64;

/// How far a number may be from a whole one to be taken for this label anyway, with a warning.
/// Programs that resample or rescale labels leave such.
const NEARLY_WHOLE: f64 = 1e-3;

/// Values per voxel at most; as many as there are labels.
const MAX_VOLUMES: usize = u16::MAX as usize;

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
    /// Value = slope * stored + intercept.
    pub(super) scale: Option<(f64, f64)>,
    /// Values per voxel.
    pub(super) volumes: usize,
    /// Whether the values of a voxel stand side by side, and not each in a volume of its own.
    interleaved: bool,
}

impl Layout {
    /// Checks the sizes of a header: each axis, and the voxels and bytes they make.
    pub(super) fn new(
        source: &Source,
        sizes: [u64; 3],
        scalar: Scalar,
        coding: Coding,
    ) -> Result<Self> {
        let mut dims = [0; 3];
        for axis in 0..3 {
            dims[axis] = usize::try_from(sizes[axis]).unwrap_or(usize::MAX);
        }
        voxel_count(dims).map_err(|e| source.error(e.to_string()))?;
        Ok(Self { dims, scalar, coding, scale: None, volumes: 1, interleaved: false })
    }

    /// As [`Layout::new`], with several values per voxel.
    pub(super) fn with_volumes(
        self,
        source: &Source,
        volumes: u64,
        interleaved: bool,
    ) -> Result<Self> {
        match usize::try_from(volumes) {
            Ok(volumes @ 1..=MAX_VOLUMES) => Ok(Self { volumes, interleaved, ..self }),
            _ => Err(source.error(format!(
                "1 to {MAX_VOLUMES} values per voxel are read, the header says {volumes}"
            ))),
        }
    }

    /// That of each volume, where they follow each other and each has its place.
    pub(super) fn one_volume(&self) -> Option<Self> {
        let has_places = (self.volumes == 1 || !self.interleaved) && self.coding != Coding::Text;
        has_places.then_some(Self { volumes: 1, interleaved: false, ..*self })
    }

    /// Stored numbers. Cannot overflow: there are fewer than 2^32 voxels and 2^16 volumes.
    fn numbers(&self) -> usize {
        self.dims.iter().product::<usize>() * self.volumes
    }

    fn voxels(&self) -> u64 {
        self.dims.iter().product::<usize>() as u64
    }

    /// Bytes that the numbers take in the stream; for text, the least they can take.
    pub(super) fn bytes(&self) -> u64 {
        match self.coding {
            Coding::Text => 2 * self.numbers() as u64 - 1,
            _ => self.numbers() as u64 * self.scalar.size() as u64,
        }
    }
}

/// Numbers that were not whole, and what may be done about them.
#[derive(Default)]
struct Rounding {
    /// How far from a whole number they may be.
    max: f64,
    /// How many there were.
    count: u64,
    /// The first: voxel and value.
    first: Option<(usize, f64)>,
}

impl Rounding {
    /// The label for a number, with a note if it is not whole; `exact` is how far from a whole one
    /// it may be without.
    fn label(&mut self, value: f64, exact: f64, voxel: usize) -> Option<i32> {
        let whole = value.round();
        let off = (value - whole).abs();
        if off.is_nan() || off > exact.max(self.max) {
            return None;
        }
        if off > exact {
            self.count += 1;
            self.first.get_or_insert((voxel, value));
        }
        // The conversion saturates, so a number out of range does not come back equal.
        let label = whole as i32;
        (f64::from(label) == whole).then_some(label)
    }
}

/// A volume of labels, and the text of the value of each label from 1 on, read to the end of the
/// file; see [`LabelValues::Distinct`].
pub(super) fn read_distinct(
    source: &mut Source,
    layout: &Layout,
    frame: Frame,
    warnings: &mut Vec<String>,
) -> Result<(LabelImage, Vec<String>)> {
    let mut builder = LabelBuilder::new(layout.dims, trusted_labels(source, layout)?)?;
    let (mut distinct, mut numbers) = (Distinct::default(), Vec::new());
    read_numbers(
        source,
        layout,
        warnings,
        &mut Rounding::default(),
        |source, values: &[Number]| {
            numbers.clear();
            reserve(&mut numbers, values.len(), NUMBERS)?;
            distinct.number(values, &mut numbers)?;
            if distinct.are_too_many() {
                return Err(
                    source.error("more than 65534 different values: is this a segmentation?")
                );
            }
            builder.push(&numbers)
        },
    )?;
    let (labels, texts) = distinct.finish()?;
    builder.relabel(|number| labels[number as usize - 1]);
    warnings.push(told(&texts));
    Ok((builder.finish(frame)?, texts))
}

/// A volume of labels, read to the end of the file. Numbers that are not whole are rounded where
/// they are nearly so, or where `values` asks for it.
pub(super) fn read_labels(
    source: &mut Source,
    layout: &Layout,
    frame: Frame,
    values: LabelValues,
    warnings: &mut Vec<String>,
) -> Result<LabelImage> {
    let mut builder = LabelBuilder::new(layout.dims, trusted_labels(source, layout)?)?;
    read_whole(source, layout, values, warnings, |source, labels| {
        builder.push(labels).map_err(|e| of_source(source, e))
    })?;
    builder.finish(frame)
}

/// As [`read_labels`], where each voxel has a value in each of several layers; with the names of
/// labels.
pub(super) fn read_layers(
    source: &mut Source,
    layout: &Layout,
    frame: Frame,
    values: LabelValues,
    mut segments: Segments,
    warnings: &mut Vec<String>,
) -> Result<(LabelImage, LabelNames)> {
    let mut builder = LabelBuilder::new(layout.dims, trusted_labels(source, layout)?)?;
    // Values of a voxel whose others are still to come; numbers of segments of whole voxels.
    let (mut waiting, mut numbers) = (Vec::new(), Vec::new());
    read_whole(source, layout, values, warnings, |source, values| {
        waiting.extend_from_slice(values);
        let whole = waiting.len() - waiting.len() % layout.volumes;
        numbers.clear();
        for values in waiting[..whole].chunks_exact(layout.volumes) {
            numbers.push(segments.number(values)?);
        }
        waiting.drain(..whole);
        if segments.are_too_many() {
            return Err(source.error("more than 65534 segments: is this a segmentation?"));
        }
        builder.push(&numbers).map_err(|e| of_source(source, e))
    })?;
    let Finished { label, names, warnings: told } = segments.finish()?;
    builder.relabel(label);
    warnings.extend(told);
    Ok((builder.finish(frame)?, names))
}

/// An error about labels as one about the file that they come from.
fn of_source(source: &Source, error: Error) -> Error {
    match error {
        Error::InvalidArgument(message) => source.error(message),
        other => other,
    }
}

/// Hands all values to `push`, as whole numbers, and warns of those that were rounded.
fn read_whole(
    source: &mut Source,
    layout: &Layout,
    values: LabelValues,
    warnings: &mut Vec<String>,
    push: impl FnMut(&Source, &[i32]) -> Result<()>,
) -> Result<()> {
    let max = if values == LabelValues::Rounded { 0.5 } else { NEARLY_WHOLE };
    let mut rounding = Rounding { max, ..Rounding::default() };
    read_numbers(source, layout, warnings, &mut rounding, push)?;
    if let Some((voxel, value)) = rounding.first {
        let (place, count) = (place_of(layout, voxel), rounding.count);
        warnings.push(format!(
            "{count} voxels are no whole numbers and were rounded; the first, {place}, is {value}"
        ));
    }
    Ok(())
}

/// All volumes as real numbers, read to the end of the file, x fastest.
pub(super) fn read_values(
    source: &mut Source,
    layout: &Layout,
    warnings: &mut Vec<String>,
) -> Result<Vec<Vec<f32>>> {
    const WHAT: &str = "values of an image";
    let trusted = trusted(source, layout)?.min(layout.numbers());
    // Volumes are parted at the end, which takes as much again.
    let copies = if layout.volumes > 1 { 2 } else { 1 };
    source.check_memory(copies * layout.numbers() as u64 * size_of::<f32>() as u64)?;
    let mut values: Vec<f32> = room(trusted, WHAT)?;
    read_numbers(source, layout, warnings, &mut Rounding::default(), |_, more: &[f32]| {
        reserve(&mut values, more.len(), WHAT)?;
        values.extend_from_slice(more);
        Ok(())
    })?;
    let volumes = layout.volumes;
    if volumes == 1 {
        return Ok(vec![values]);
    }
    let voxels = values.len() / volumes;
    let volume = |n: usize| {
        let mut volume = room(voxels, WHAT)?;
        if layout.interleaved {
            volume.extend(values[n..].iter().step_by(volumes));
        } else {
            volume.extend_from_slice(&values[n * voxels..][..voxels]);
        }
        Ok(volume)
    };
    (0..volumes).map(volume).collect()
}

/// Numbers for which room is made before they are seen: in proportion to what the file holds, not
/// to what it claims.
///
/// # Errors
/// [`Error::Format`] when the file cannot hold what it claims.
fn trusted(source: &Source, layout: &Layout) -> Result<usize> {
    let (claimed, held) = (layout.bytes(), source.remaining());
    if claimed > held {
        let [nx, ny, nz] = layout.dims;
        let each = if layout.volumes > 1 {
            format!(" of {} values", layout.volumes)
        } else {
            String::new()
        };
        let compressed = if source.is_compressed() { " even if perfectly compressed" } else { "" };
        return Err(source.error(format!(
            "the voxel data is cut off: {nx} x {ny} x {nz} voxels{each} need {claimed} bytes, the \
             file can hold {held}{compressed}"
        )));
    }
    let file_bytes = if source.is_compressed() { held / 1032 } else { held };
    Ok(usize::try_from(file_bytes.saturating_mul(TRUSTED_RATIO)).unwrap_or(usize::MAX))
}

/// As [`trusted`], for labels.
///
/// # Errors
/// Also [`Error::MemoryLimit`] when these may not take so much memory.
fn trusted_labels(source: &Source, layout: &Layout) -> Result<usize> {
    let trusted = trusted(source, layout)?;
    source.check_memory(layout.voxels() * size_of::<u16>() as u64)?;
    Ok(trusted)
}

/// Hands the numbers over, chunk by chunk in their order, and reads whatever follows them. Warns
/// about bytes left over.
fn read_numbers<V: Value>(
    source: &mut Source,
    layout: &Layout,
    warnings: &mut Vec<String>,
    rounding: &mut Rounding,
    push: impl FnMut(&Source, &[V]) -> Result<()>,
) -> Result<()> {
    match layout.coding {
        Coding::Text => read_text(source, layout, rounding, push)?,
        _ => read_binary(source, layout, rounding, push)?,
    }
    let excess = source.drain()?;
    if excess > 0 && layout.coding != Coding::Text {
        warnings.push(format!(
            "the file holds {excess} bytes or more after the voxels that its header describes; \
             they are ignored"
        ));
    }
    Ok(())
}

/// The indices of the voxel that a number is of.
fn place_of(layout: &Layout, number: usize) -> String {
    let [nx, ny, nz] = layout.dims;
    let voxel = if layout.interleaved { number / layout.volumes } else { number % (nx * ny * nz) };
    format!("voxel ({}, {}, {})", voxel % nx, voxel / nx % ny, voxel / (nx * ny))
}

/// Why a voxel is no label.
fn bad_voxel(source: &Source, layout: &Layout, voxel: usize, value: f64) -> Error {
    let why = match () {
        () if !value.is_finite() => "labels must be numbers",
        () if f64::from(value.round() as i32) != value.round() => {
            "labels must fit a 32-bit signed integer; --map (LAPD_LABELS_DISTINCT) numbers \
             distinct values"
        }
        () => {
            "labels must be whole numbers; --round (LAPD_LABELS_ROUNDED) takes the nearest ones, \
             --map (LAPD_LABELS_DISTINCT) numbers distinct values"
        }
    };
    source.error(format!("{} is {value}: {why}", place_of(layout, voxel)))
}

fn read_binary<V: Value>(
    source: &mut Source,
    layout: &Layout,
    rounding: &mut Rounding,
    mut push: impl FnMut(&Source, &[V]) -> Result<()>,
) -> Result<()> {
    let (total, size) = (layout.numbers(), layout.scalar.size());
    let mut bytes = zeroed::<u8>(CHUNK.min(total) * size, "bytes of a file")?;
    let mut values = filled(CHUNK.min(total), V::default(), NUMBERS, || Ok(()))?;
    let mut done = 0;
    while done < total {
        let count = CHUNK.min(total - done);
        let (bytes, values) = (&mut bytes[..count * size], &mut values[..count]);
        let filled = source.read_up_to(bytes)?;
        if filled < bytes.len() {
            let held = done * size + filled;
            return Err(source.error(format!(
                "the voxel data is cut off: {} bytes are needed, {held} are there",
                layout.bytes()
            )));
        }
        if let Err((voxel, value)) = decode(bytes, layout, values, done, rounding) {
            return Err(bad_voxel(source, layout, voxel, value));
        }
        push(source, values)?;
        done += count;
    }
    Ok(())
}

/// A stored number.
trait Sample: Copy {
    /// The number as a label, if it is one or nearly so; `voxel` is whose it is.
    fn label(self, voxel: usize, rounding: &mut Rounding) -> Option<i32>;
    fn real(self) -> f64;
    /// The number as it is, if it is finite.
    fn number(self) -> Option<Number>;
}

macro_rules! integer_samples {
    ($($t:ty)*) => { $(impl Sample for $t {
        fn label(self, _: usize, _: &mut Rounding) -> Option<i32> {
            i32::try_from(self).ok()
        }
        fn real(self) -> f64 {
            self as f64
        }
        fn number(self) -> Option<Number> {
            Some(Number::Whole(i128::from(self)))
        }
    })* };
}
integer_samples!(u8 i8 u16 i16 u32 i32 u64 i64);

impl Sample for f64 {
    fn label(self, voxel: usize, rounding: &mut Rounding) -> Option<i32> {
        rounding.label(self, 0.0, voxel)
    }
    fn real(self) -> f64 {
        self
    }
    fn number(self) -> Option<Number> {
        Number::of_real(self)
    }
}

impl Sample for f32 {
    fn label(self, voxel: usize, rounding: &mut Rounding) -> Option<i32> {
        rounding.label(f64::from(self), 0.0, voxel)
    }
    fn real(self) -> f64 {
        f64::from(self)
    }
    fn number(self) -> Option<Number> {
        Number::of_single(self)
    }
}

/// What stored numbers are read as.
trait Value: Copy + Default {
    /// The number of a voxel as it is, if it can be read so.
    fn plain(stored: impl Sample, voxel: usize, rounding: &mut Rounding) -> Option<Self>;
    /// slope * stored + intercept, if it can be read so.
    fn scaled(
        stored: f64,
        scale: (f64, f64),
        voxel: usize,
        rounding: &mut Rounding,
    ) -> Option<Self>;
}

/// Labels.
impl Value for i32 {
    #[inline]
    fn plain(stored: impl Sample, voxel: usize, rounding: &mut Rounding) -> Option<Self> {
        stored.label(voxel, rounding)
    }

    #[inline]
    fn scaled(
        stored: f64,
        (slope, intercept): (f64, f64),
        voxel: usize,
        rounding: &mut Rounding,
    ) -> Option<Self> {
        let (product, value) = (slope * stored, slope * stored + intercept);
        // Headers store the slope in single precision: a product is exact to 2^-24 of itself only.
        let exact = 1e-7 * product.abs().max(intercept.abs()).max(value.abs());
        rounding.label(value, exact, voxel)
    }
}

/// Values of any kind.
impl Value for Number {
    #[inline]
    fn plain(stored: impl Sample, _: usize, _: &mut Rounding) -> Option<Self> {
        stored.number()
    }

    #[inline]
    fn scaled(
        stored: f64,
        (slope, intercept): (f64, f64),
        _: usize,
        _: &mut Rounding,
    ) -> Option<Self> {
        Self::of_real(slope * stored + intercept)
    }
}

/// Intensities and probabilities, rounded to single precision.
impl Value for f32 {
    #[inline]
    fn plain(stored: impl Sample, _: usize, _: &mut Rounding) -> Option<Self> {
        Some(stored.real() as f32)
    }

    #[inline]
    fn scaled(
        stored: f64,
        (slope, intercept): (f64, f64),
        _: usize,
        _: &mut Rounding,
    ) -> Option<Self> {
        Some((slope * stored + intercept) as f32)
    }
}

/// Decodes as many numbers as `values` has, from voxel `first` on. The error is the first that
/// cannot be read so: its voxel and value.
fn decode<V: Value>(
    bytes: &[u8],
    layout: &Layout,
    values: &mut [V],
    first: usize,
    rounding: &mut Rounding,
) -> std::result::Result<(), (usize, f64)> {
    macro_rules! each {
        ($t:ty) => {
            match layout.coding {
                Coding::BigEndian => {
                    decode_as(bytes, <$t>::from_be_bytes, layout.scale, values, first, rounding)
                }
                _ => decode_as(bytes, <$t>::from_le_bytes, layout.scale, values, first, rounding),
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

fn decode_as<T: Sample, V: Value, const N: usize>(
    bytes: &[u8],
    sample: impl Fn([u8; N]) -> T,
    scale: Option<(f64, f64)>,
    values: &mut [V],
    first: usize,
    rounding: &mut Rounding,
) -> std::result::Result<(), (usize, f64)> {
    let stored = bytes.as_chunks::<N>().0.iter().map(|raw| sample(*raw));
    match scale {
        None => {
            for ((slot, stored), voxel) in values.iter_mut().zip(stored).zip(first..) {
                *slot = V::plain(stored, voxel, rounding).ok_or((voxel, stored.real()))?;
            }
        }
        Some((slope, intercept)) => {
            for ((slot, stored), voxel) in values.iter_mut().zip(stored.map(T::real)).zip(first..) {
                let value = slope * stored + intercept;
                *slot =
                    V::scaled(stored, (slope, intercept), voxel, rounding).ok_or((voxel, value))?;
            }
        }
    }
    Ok(())
}

fn read_text<V: Value>(
    source: &mut Source,
    layout: &Layout,
    rounding: &mut Rounding,
    mut push: impl FnMut(&Source, &[V]) -> Result<()>,
) -> Result<()> {
    let total = layout.numbers();
    let mut bytes = zeroed::<u8>(CHUNK, "bytes of a file")?;
    let mut values: Vec<V> = room(CHUNK, NUMBERS)?;
    let mut word: Vec<u8> = Vec::new();
    let mut done = 0;
    loop {
        let filled = source.read_up_to(&mut bytes)?;
        // A blank after the last byte ends the last word.
        let end = (filled < bytes.len()).then_some(b' ');
        for byte in bytes[..filled].iter().copied().chain(end) {
            if !byte.is_ascii_whitespace() {
                if word.len() == MAX_WORD {
                    return Err(no_number(source, layout, done + values.len()));
                }
                word.push(byte);
                continue;
            }
            if word.is_empty() {
                continue;
            }
            if done + values.len() == total {
                return Err(source.error(format!(
                    "there are more than the {total} numbers that the header describes"
                )));
            }
            values.push(value_of_word(source, layout, done + values.len(), &word, rounding)?);
            word.clear();
        }
        push(source, &values)?;
        done += values.len();
        values.clear();
        if end.is_some() {
            break;
        }
    }
    if done < total {
        return Err(source.error(format!(
            "the voxel data is cut off: {total} numbers are needed, {done} are there"
        )));
    }
    Ok(())
}

/// What is no number is not quoted: a header may have named any file.
fn no_number(source: &Source, layout: &Layout, voxel: usize) -> Error {
    source.error(format!("{} is not a number", place_of(layout, voxel)))
}

fn value_of_word<V: Value>(
    source: &Source,
    layout: &Layout,
    voxel: usize,
    word: &[u8],
    rounding: &mut Rounding,
) -> Result<V> {
    let text = std::str::from_utf8(word).unwrap_or_default();
    let value: f64 = text.parse().map_err(|_| no_number(source, layout, voxel))?;
    V::plain(value, voxel, rounding).ok_or_else(|| bad_voxel(source, layout, voxel, value))
}
