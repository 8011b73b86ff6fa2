//! NRRD (`.nrrd`, and `.nhdr` beside a data file). Source: Gordon Kindlmann, "Definition of NRRD
//! File Format", teem.
//!
//! Read: dimension 3, or 4 with one axis of samples, the first or the last, for labels of a single
//! one or of the layers of a segmentation of 3D Slicer (`segments`); encodings raw, gzip, text.
//! Data split over several files (`LIST`, numbered names), bzip2 and hex are refused. Axis units
//! and centerings do not matter to a mesh and are ignored.

use std::path::Path;

use super::fields::{Fields, MAX_HEADER, Place, header_line};
use super::segments::Segments;
use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts, frame_from_steps};
use crate::Result;
use crate::error::excerpt;
use crate::image::{Frame, WorldAxes};

/// One axis of the array.
#[derive(Debug)]
struct Axis {
    size: u64,
    kind: Option<String>,
    /// Step between samples in the world; `None` when the axis is not in space.
    step: Option<[f64; 3]>,
    /// NaN when the header does not give one.
    spacing: f64,
}

pub(super) fn open<'a>(path: &Path, volumes: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let mut source = Source::open(path, access)?;
    let fields = read_header(&mut source)?;
    let mut warnings = Vec::new();
    let segments = Segments::of_header(&fields)?;
    let (axes, values, interleaved) = three_axes(&fields, volumes, segments.is_some())?;
    let world = world_of(&fields)?;
    let frame = frame_of(path, &fields, &axes, &mut warnings)?;
    let scalar = scalar_of(&fields)?;
    let encoding = fields.required("encoding")?.to_ascii_lowercase();
    let (coding, gzipped) = match encoding.as_str() {
        "raw" => (byte_order(&fields, scalar)?, false),
        "gzip" | "gz" => (byte_order(&fields, scalar)?, true),
        "txt" | "text" | "ascii" => (Coding::Text, false),
        "bzip2" | "bz2" | "hex" => {
            return Err(
                fields.refuse("encoding", "not supported; supported are raw, gzip and text")
            );
        }
        _ => return Err(fields.refuse("encoding", "unknown; supported are raw, gzip and text")),
    };
    let layout = Layout::new(&source, axes.each_ref().map(|axis| axis.size), scalar, coding)?;
    let layout = layout.with_volumes(&source, values, interleaved)?;

    let mut source = match data_file(&fields)? {
        Some(name) => source.open_data(name)?,
        None => source,
    };
    skip_lines(&mut source, &fields)?;
    if gzipped {
        source = source.gunzip();
    }
    // As teem does: bytes are skipped after decompression, and -1 - n means that n bytes follow the
    // data, which lie at the end.
    match fields.number::<i64>("byte skip")?.unwrap_or(0) {
        0 => {}
        skip @ 1.. => source.skip(skip.unsigned_abs(), &format!("byte skip {skip}"))?,
        _ if coding == Coding::Text => {
            return Err(fields.refuse("byte skip", "text cannot be read from its end"));
        }
        skip => source = source.seek_from_end(layout.bytes(), skip.unsigned_abs() - 1)?,
    }
    Ok(Opened { source, layout, frame, world, segments, is_reversed: false, warnings })
}

/// Reads up to and including the empty line before the data, or to the end of a detached header.
fn read_header(source: &mut Source) -> Result<Fields> {
    if !source.starts_with(b"NRRD")? {
        return Err(source.error("not a NRRD file: it does not begin with 'NRRD'"));
    }
    let mut fields = Fields::new(source.path());
    let mut read = Place::default();
    header_line(source, &mut read)?;
    while let Some(line) = header_line(source, &mut read)? {
        if line.is_empty() {
            break;
        }
        if line.starts_with('#') {
            continue;
        }
        // Key/value pairs mean nothing to the format; 3D Slicer's tell of segments.
        if let Some((name, value)) = line.split_once(":=").filter(|(name, _)| !name.contains(':')) {
            if name.starts_with("Segment") {
                fields.insert_pair(name, value)?;
            }
            continue;
        }
        let Some((name, value)) = line.split_once(':') else {
            return Err(fields.no_field(read, "field: value"));
        };
        fields.insert(name, value)?;
        if fields.get("data file").is_some_and(|file| file.starts_with("LIST")) {
            // The rest of the header is a list of files.
            break;
        }
    }
    Ok(fields)
}

/// The axes of the volume, fastest first; the values per voxel, and whether these stand side by
/// side.
fn three_axes(
    fields: &Fields,
    volumes: Volumes,
    has_segments: bool,
) -> Result<([Axis; 3], u64, bool)> {
    let dimension: usize = fields
        .number("dimension")?
        .ok_or_else(|| fields.error("header field 'dimension' is missing"))?;
    if !(3..=4).contains(&dimension) {
        return Err(fields.refuse(
            "dimension",
            "only volumes are read: dimension 3, or 4 with one axis of samples",
        ));
    }
    fields.required("sizes")?;
    let sizes = fields.numbers::<u64>("sizes", Some(dimension))?.unwrap_or_default();
    let spacings = fields.numbers::<f64>("spacings", Some(dimension))?;
    let kinds = match fields.get("kinds") {
        None => vec![None; dimension],
        Some(value) => {
            value.split_whitespace().map(|kind| Some(kind.to_ascii_lowercase())).collect()
        }
    };
    let steps = match fields.get("space directions") {
        None => vec![None; dimension],
        Some(value) => vectors(value).ok_or_else(|| {
            fields.refuse("space directions", "not a list of vectors (x,y,z) or 'none'")
        })?,
    };
    for (name, count) in [("kinds", kinds.len()), ("space directions", steps.len())] {
        if count != dimension {
            return Err(fields.refuse(name, format!("{count} axes, but dimension is {dimension}")));
        }
    }
    let in_space = fields.get("space directions").is_some();
    let mut axes: Vec<Axis> = sizes
        .into_iter()
        .zip(kinds)
        .zip(steps)
        .enumerate()
        .map(|(i, ((size, kind), step))| Axis {
            size,
            kind,
            step,
            spacing: spacings.as_ref().map_or(f64::NAN, |s| s[i]),
        })
        .collect();
    let (mut values, mut interleaved) = (1, false);
    if axes.len() == 4 {
        // The axis to drop is one outside space, if the header tells; of several values per voxel
        // it is the first or the last.
        let is_single = |axis: &Axis| axis.size == 1;
        let is_outside = |axis: &Axis| in_space && axis.step.is_none() || !is_spatial(axis);
        let single = axes.iter().position(|axis| is_single(axis) && is_outside(axis));
        let other = || match volumes {
            // Layers of segments.
            Volumes::One if has_segments && is_outside(&axes[0]) => Some(0),
            Volumes::One => axes.iter().rposition(is_single),
            Volumes::Many => match axes.iter().position(is_outside) {
                Some(outside) => Some(outside).filter(|outside| [0, 3].contains(outside)),
                None => Some(3),
            },
        };
        match single.or_else(other) {
            Some(axis) => (values, interleaved) = (axes.remove(axis).size, axis == 0),
            None => {
                return Err(fields.refuse(
                    "sizes",
                    "four axes of more than one sample: labels have one value a voxel, and layers \
                     of 3D Slicer's segments are the first axis; --volume \
                     (lapd_context_set_volume) reads one of several volumes, --probabilities all \
                     as maps",
                ));
            }
        };
    }
    for (i, axis) in axes.iter().enumerate() {
        if !is_spatial(axis) {
            let kind = axis.kind.as_deref().unwrap_or_default();
            return Err(fields.refuse(
                "kinds",
                format!("axis {i} is of kind '{}', not an axis of space", excerpt(kind)),
            ));
        }
        if in_space && axis.step.is_none() {
            return Err(
                fields.refuse("space directions", format!("axis {i} is not an axis of space"))
            );
        }
    }
    let axes = axes.try_into().map_err(|_| fields.error("not three axes"))?;
    Ok((axes, values, interleaved))
}

fn is_spatial(axis: &Axis) -> bool {
    axis.kind.as_deref().is_none_or(|kind| matches!(kind, "domain" | "space" | "???" | "none"))
}

/// Vectors of three numbers in parentheses, or `none`; blanks may stand anywhere.
fn vectors(text: &str) -> Option<Vec<Option<[f64; 3]>>> {
    let mut list = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        rest = if let Some(after) = rest.strip_prefix("none") {
            list.push(None);
            after
        } else {
            let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
            let numbers: Vec<f64> =
                inside.split(',').map(|x| x.trim().parse().ok()).collect::<Option<_>>()?;
            list.push(Some(numbers.try_into().ok()?));
            after
        }
        .trim_start();
    }
    Some(list)
}

/// What the world's axes mean; checks that the world has three.
fn world_of(fields: &Fields) -> Result<Option<WorldAxes>> {
    if let Some(n) = fields.number::<u64>("space dimension")? {
        return if n == 3 {
            Ok(None)
        } else {
            Err(fields.refuse("space dimension", "only 3 is read"))
        };
    }
    let Some(space) = fields.get("space") else { return Ok(None) };
    match space.to_ascii_lowercase().as_str() {
        "left-posterior-superior" | "lps" => Ok(Some(WorldAxes::Lps)),
        "right-anterior-superior" | "ras" => Ok(Some(WorldAxes::Ras)),
        "left-anterior-superior" | "las" => Ok(Some(WorldAxes::Las)),
        "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => Ok(None),
        _ => Err(fields.refuse("space", "unknown, or not of three dimensions")),
    }
}

fn frame_of(
    path: &Path,
    fields: &Fields,
    axes: &[Axis; 3],
    warnings: &mut Vec<String>,
) -> Result<Frame> {
    let origin = match fields.get("space origin") {
        None => [0.0; 3],
        Some(value) => match vectors(value).as_deref() {
            Some([Some(origin)]) => *origin,
            _ => return Err(fields.refuse("space origin", "not a vector (x,y,z)")),
        },
    };
    if let [Some(x), Some(y), Some(z)] = axes.each_ref().map(|axis| axis.step) {
        return frame_from_steps(path, "space directions", origin, [x, y, z], |_, length| length);
    }
    let along_the_world = |what: &str, origin: [f64; 3], spacing: [f64; 3]| {
        frame_from_parts(
            path,
            what,
            origin,
            spacing,
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        )
    };
    if let Some((origin, spacing)) = place_by_ends(fields, axes)? {
        return along_the_world("axis mins and axis maxs", origin, spacing);
    }
    if fields.get("axis mins").is_some() {
        warnings.push(
            "'axis mins' is ignored: the first voxel is taken to lie at the space origin or at 0"
                .into(),
        );
    }
    let spacing =
        axes.each_ref().map(|axis| if axis.spacing.is_nan() { 1.0 } else { axis.spacing });
    if axes.iter().any(|axis| axis.spacing.is_nan()) {
        warnings.push(
            "the header gives no spacing for every axis; 1 is taken where it is missing".into(),
        );
    }
    along_the_world("spacings", origin, spacing)
}

/// Origin and spacings by `axis mins` and `axis maxs`, where these alone tell the place of the
/// volume. They are the outer faces of the first and the last voxel, or with `centers: node` their
/// centres (Teem, "Definition of NRRD File Format").
fn place_by_ends(fields: &Fields, axes: &[Axis; 3]) -> Result<Option<([f64; 3], [f64; 3])>> {
    let is_told = fields.get("spacings").is_some() || fields.get("space origin").is_some();
    let (mins, maxs) =
        (fields.numbers::<f64>("axis mins", None)?, fields.numbers::<f64>("axis maxs", None)?);
    let (Some(mins), Some(maxs)) = (mins, maxs) else { return Ok(None) };
    if is_told || mins.len() != 3 || maxs.len() != 3 {
        return Ok(None);
    }
    let centers = fields
        .get("centers")
        .or_else(|| fields.get("centerings"))
        .unwrap_or_default()
        .to_ascii_lowercase();
    let centers: Vec<&str> = centers.split_whitespace().collect();
    let (mut origin, mut spacing) = ([0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let is_node = centers.get(a) == Some(&"node");
        let intervals = if is_node { axes[a].size.saturating_sub(1) } else { axes[a].size };
        spacing[a] = (maxs[a] - mins[a]) / intervals as f64;
        origin[a] = if is_node { mins[a] } else { mins[a] + 0.5 * spacing[a] };
    }
    // One node has no spacing, and values that run the other way would turn the axis around.
    Ok(spacing.iter().all(|&s| s.is_finite() && s > 0.0).then_some((origin, spacing)))
}

fn scalar_of(fields: &Fields) -> Result<Scalar> {
    let name = fields.required("type")?.to_ascii_lowercase();
    Ok(match name.as_str() {
        "signed char" | "int8" | "int8_t" => Scalar::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Scalar::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Scalar::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Scalar::U16,
        "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Scalar::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Scalar::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            Scalar::U64
        }
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        _ => return Err(fields.refuse("type", "unknown, or no type of numbers")),
    })
}

fn byte_order(fields: &Fields, scalar: Scalar) -> Result<Coding> {
    match fields.get("endian").map(str::to_ascii_lowercase).as_deref() {
        Some("little") => Ok(Coding::LittleEndian),
        Some("big") => Ok(Coding::BigEndian),
        None if scalar.size() == 1 => Ok(Coding::LittleEndian),
        None => Err(fields.error("header field 'endian' is missing")),
        Some(_) => Err(fields.refuse("endian", "must be little or big")),
    }
}

/// The data file of a detached header.
fn data_file(fields: &Fields) -> Result<Option<&str>> {
    let Some(name) = fields.get("data file") else { return Ok(None) };
    if name.starts_with("LIST") || name.contains('%') {
        return Err(fields.refuse("data file", "data split over several files is not supported"));
    }
    Ok(Some(name))
}

fn skip_lines(source: &mut Source, fields: &Fields) -> Result<()> {
    let count = fields.number::<u64>("line skip")?.unwrap_or(0);
    let mut line = Vec::new();
    for skipped in 0..count {
        line.clear();
        if source.read_line(MAX_HEADER, &mut line)? == 0 {
            return Err(fields.refuse("line skip", format!("the data has {skipped} lines only")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::read_image;
    use super::super::tests::{Files, gzip, labels, read_bytes};

    const VALUES: [i16; 8] = [0, 1, -2, 300, 300, 0, 7, 7];

    fn little() -> Vec<u8> {
        VALUES.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    fn nrrd(lines: &str, data: &[u8]) -> Vec<u8> {
        let mut file = format!(
            "NRRD0004\n# comment\nkey:=value: with colon\ntype: short\nsizes: 2 2 2\n{lines}\n\n"
        )
        .into_bytes();
        file.extend_from_slice(data);
        file
    }

    fn assert_values(name: &str, file: &[u8]) {
        let read = read_bytes(name, file).unwrap();
        assert_eq!(labels(&read.image), VALUES.map(i32::from), "{}", String::from_utf8_lossy(file));
    }

    fn refusal(lines: &str) -> String {
        read_bytes("a.nrrd", &nrrd(lines, &little())).unwrap_err()
    }

    #[test]
    fn every_encoding_gives_the_same_labels() {
        let big: Vec<u8> = VALUES.iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_values("a.nrrd", &nrrd("dimension: 3\nencoding: raw\nendian: little", &little()));
        assert_values("a.nhdr", &nrrd("Dimension: 3\nEncoding: RAW\nEndian: Big", &big));
        assert_values("a.nrrd", &nrrd("dimension: 3\nencoding: gz\nendian: big", &gzip(&big)));
        for name in ["txt", "text", "ascii"] {
            let header = format!("dimension: 3\nencoding: {name}");
            assert_values("a.nrrd", &nrrd(&header, b"0 1 -2\n300 3e2\t0.0\r\n7 7"));
        }
        let unix = String::from_utf8(nrrd("dimension: 3\nencoding: text", b"0 1 -2 300 300 0 7 7"))
            .unwrap();
        assert_values("a.nrrd", unix.replace('\n', "\r\n").as_bytes());
    }

    #[test]
    fn gzip_of_several_members_is_one_stream() {
        let mut members = gzip(&little()[..6]);
        members.extend(gzip(&little()[6..]));
        assert_values("a.nrrd", &nrrd("dimension: 3\nencoding: gzip\nendian: little", &members));
    }

    #[test]
    fn skips_count_lines_then_bytes() {
        let with = |before: &[u8], after: &[u8]| [before, &little(), after].concat();
        let raw = "dimension: 3\nencoding: raw\nendian: little\n";
        assert_values(
            "a.nrrd",
            &nrrd(&format!("{raw}line skip: 2\nbyte skip: 3"), &with(b"one\ntwo\nabc", b"")),
        );
        assert_values("a.nrrd", &nrrd(&format!("{raw}byteskip: -1"), &with(b"anything", b"")));
        assert_values("a.nrrd", &nrrd(&format!("{raw}byte skip: -5"), &with(b"anything", b"tail")));
        let gz = "dimension: 3\nencoding: gzip\nendian: little\n";
        assert_values("a.nrrd", &nrrd(&format!("{gz}byte skip: 3"), &gzip(&with(b"abc", b""))));
        assert_values(
            "a.nrrd",
            &nrrd(&format!("{gz}byte skip: -5"), &gzip(&with(b"abc", b"tail"))),
        );
        assert!(
            refusal(&format!("{raw}byte skip: -2"))
                .contains("17 bytes are to be found at the end of the data, which has 16")
        );
        assert!(
            refusal(&format!("{raw}byte skip: -9223372036854775808"))
                .contains("at the end of the data")
        );
        assert!(refusal(&format!("{raw}byte skip: 99")).contains("byte skip 99 lies past the end"));
        assert!(refusal(&format!("{raw}line skip: 99999999999")).contains("lines only"));
        assert!(refusal(&format!("{raw}line skip: -1")).contains("'-1' is not a number that fits"));
    }

    #[test]
    fn data_files_lie_beside_the_header() {
        let files = Files::new();
        files.write("voxels.raw", &little());
        let header =
            nrrd("dimension: 3\nencoding: raw\nendian: little\ndata file: ./voxels.raw", b"");
        assert_eq!(
            labels(&read_image(&files.write("a.nhdr", &header)).unwrap().image),
            VALUES.map(i32::from)
        );
        let missing = nrrd("dimension: 3\nencoding: raw\nendian: little\ndatafile: none.raw", b"");
        assert!(
            read_image(&files.write("b.nhdr", &missing))
                .unwrap_err()
                .to_string()
                .contains("none.raw")
        );
        for split in ["LIST\na.raw\nb.raw", "slice%03d.raw 1 2 1"] {
            assert!(
                refusal(&format!(
                    "dimension: 3\nendian: little\nencoding: raw\ndata file: {split}"
                ))
                .contains("several files")
            );
        }
    }

    #[test]
    fn the_place_comes_from_directions_or_spacings() {
        let read = |lines: &str| {
            read_bytes(
                "a.nrrd",
                &nrrd(&format!("{lines}\nencoding: raw\nendian: little"), &little()),
            )
            .unwrap()
        };
        let tilted = read(
            "dimension: 3\nspace: lps\nspace directions: (0, 0, -2) (3,0,0) (0,.5,0)\nspace \
             origin: (1, 2, 3)",
        );
        assert_eq!(tilted.image.frame().spacing(), DVec3::new(2.0, 3.0, 0.5));
        assert_eq!(tilted.image.frame().to_world(DVec3::ONE), DVec3::new(4.0, 2.5, 1.0));
        let spaced = read("dimension: 3\nspacings: 1 2 3");
        assert_eq!(
            (spaced.image.frame().spacing(), spaced.warnings.len()),
            (DVec3::new(1.0, 2.0, 3.0), 0)
        );
        assert!(read("dimension: 3").warnings[0].contains("no spacing"));
    }

    #[test]
    fn a_fourth_axis_of_one_sample_is_dropped() {
        let file = |sizes: &str, rest: &str| {
            let header = format!(
                "NRRD0004\ntype: short\ndimension: 4\nsizes: {sizes}\nencoding: raw\nendian: \
                 little\n{rest}\n\n"
            );
            read_bytes("a.nrrd", &[header.as_bytes(), &little()].concat())
        };
        let read =
            file("1 1 4 2", "kinds: domain list domain domain\nspacings: 5 nan 6 7").unwrap();
        assert_eq!(
            (read.image.dims(), read.image.frame().spacing()),
            ([1, 4, 2], DVec3::new(5.0, 6.0, 7.0))
        );
        let read =
            file("1 2 2 2", "space: RAS\nspace directions: none (1,0,0) (0,1,0) (0,0,1)").unwrap();
        assert_eq!(read.image.dims(), [2, 2, 2]);
        assert_eq!(file("2 2 2 1", "").unwrap().image.dims(), [2, 2, 2]);
        assert!(
            file("2 2 1 2", "kinds: vector domain domain domain")
                .unwrap_err()
                .contains("axis 0 is of kind 'vector'")
        );
        assert!(file("2 2 2 2", "").unwrap_err().contains("four axes"));
    }

    #[test]
    fn refuses_what_it_does_not_read() {
        let rest = "endian: little\nencoding: raw";
        for (lines, expected) in [
            ("dimension: 3\nencoding: raw", "'endian' is missing"),
            ("dimension: 3\nendian: little", "'encoding' is missing"),
            ("dimension: 3\nendian: middle\nencoding: raw", "must be little or big"),
            ("dimension: 3\nendian: little\nencoding: bzip2", "not supported"),
            ("dimension: 3\nendian: little\nencoding: lzma", "'encoding: lzma': unknown"),
            (rest, "'dimension' is missing"),
            ("dimension: 2\nencoding: raw", "only volumes"),
            ("dimension: 3\ndimension: 3\nencoding: raw", "given twice"),
            (
                "dimension: 3\nencoding raw",
                "line 7 of the header is not of the form 'field: value'",
            ),
            (
                "dimension: 3\nspace directions: (1,0,0) (0,1,0)\nencoding: raw",
                "2 axes, but dimension is 3",
            ),
            (
                "dimension: 3\nspace directions: (1,0,0) (0,1) (0,0,1)\nencoding: raw",
                "not a list of vectors",
            ),
            (
                "dimension: 3\nspace directions: none (0,1,0) (0,0,1)\nencoding: raw",
                "axis 0 is not an axis of space",
            ),
            (
                "dimension: 3\nspace directions: (1,0,0) (0,0,0) (0,0,1)\nencoding: raw",
                "singular: image axis 1",
            ),
            (
                "dimension: 3\nspace directions: (1,0,0) (1,1,0) (0,0,1)\nencoding: raw",
                "orthonormal",
            ),
            ("dimension: 3\nspace directions: (nan,0,0) (0,1,0) (0,0,1)\nencoding: raw", "finite"),
            ("dimension: 3\nspacings: 1 0 1\nencoding: raw", "spacing of axis 1"),
            ("dimension: 3\nspace: LPST\nencoding: raw", "not of three dimensions"),
            ("dimension: 3\nspace dimension: 2\nencoding: raw", "only 3"),
            ("dimension: 3\nkinds: domain RGB-color domain\nencoding: raw", "kind 'rgb-color'"),
        ] {
            let message = refusal(lines);
            assert!(message.contains(expected), "{lines:?} gave {message:?}");
        }
        assert!(read_bytes("a.nrrd", b"PNG").unwrap_err().contains("not a NRRD file"));
        assert!(
            read_bytes("a.nrrd", &nrrd(&format!("dimension: 3\n{rest}"), &little()[..15]))
                .unwrap_err()
                .contains("cut off")
        );
        assert!(
            read_bytes("a.nrrd", &nrrd("dimension: 3\nencoding: text", b"1 2 3 4 5 6 7"))
                .unwrap_err()
                .contains("cut off")
        );
        assert!(
            read_bytes("a.nrrd", &nrrd("dimension: 3\nencoding: text", b"1 2 3 4 5 6 7 8 9"))
                .unwrap_err()
                .contains("more than the 8")
        );
        assert!(
            read_bytes("a.nrrd", &nrrd("dimension: 3\nencoding: text", b"1 2 3 4 5 6 7 x"))
                .unwrap_err()
                .contains("voxel (1, 1, 1) is not a number")
        );
        assert!(
            read_bytes("a.nrrd", &nrrd("dimension: 3\nencoding: text", b"1 2 3 4 5 6 7 0.5"))
                .unwrap_err()
                .contains("voxel (1, 1, 1) is 0.5")
        );
        let longer = read_bytes(
            "a.nrrd",
            &nrrd(&format!("dimension: 3\n{rest}"), &[little(), vec![0; 3]].concat()),
        )
        .unwrap();
        assert!(longer.warnings.iter().any(|w| w.contains("3 bytes or more after")));
    }

    #[test]
    fn gzip_is_checked_to_its_end() {
        let header = "dimension: 3\nencoding: gzip\nendian: little";
        let whole = gzip(&little());
        for cut in 1..whole.len() {
            assert!(read_bytes("a.nrrd", &nrrd(header, &whole[..cut])).is_err(), "cut at {cut}");
        }
        let mut corrupt = whole.clone();
        let crc = whole.len() - 8;
        corrupt[crc] ^= 1;
        assert!(read_bytes("a.nrrd", &nrrd(header, &corrupt)).unwrap_err().contains("damaged"));
    }
}
