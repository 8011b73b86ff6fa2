//! MetaImage (`.mha`, and `.mhd` beside a data file), the format of MetaIO and ITK. Source: the
//! MetaIO documentation.
//!
//! World axes are LPS and the rows of `TransformMatrix` are the directions of the image axes, as
//! ITK reads them; `AnatomicalOrientation` describes and does not place.

use std::path::Path;

use super::fields::{Fields, Place, header_line};
use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts};
use crate::Result;
use crate::image::{Frame, WorldAxes};

pub(super) fn open<'a>(path: &Path, volumes: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let mut source = Source::open(path, access)?;
    let fields = read_header(&mut source)?;
    let mut warnings = Vec::new();
    if fields.get("ObjectType").is_some_and(|kind| !kind.eq_ignore_ascii_case("image")) {
        return Err(fields.refuse("ObjectType", "only images are read"));
    }
    let rank = rank_of(&fields)?;
    let (sizes, values, interleaved) = sizes_of(&fields, rank, volumes)?;
    let frame = frame_of(path, &fields, rank, &mut warnings)?;
    let layout = Layout::new(&source, sizes, scalar_of(&fields)?, coding_of(&fields)?)?;
    let layout = layout.with_volumes(&source, values, interleaved)?;

    let data_file = fields.required("ElementDataFile")?;
    if !data_file.eq_ignore_ascii_case("local") {
        if data_file.starts_with("LIST") || data_file.contains('%') {
            return Err(
                fields.refuse("ElementDataFile", "data split over several files is not supported")
            );
        }
        source = source.open_data(data_file)?;
    }
    let header_size = fields.number::<i64>("HeaderSize")?.unwrap_or(0);
    if let Ok(skip @ 1..) = u64::try_from(header_size) {
        source.skip(skip, &format!("HeaderSize {skip}"))?;
    }
    if flag(&fields, "CompressedData")? {
        source =
            if source.starts_with(&[0x1f, 0x8b])? { source.gunzip() } else { source.inflate() };
    }
    match header_size {
        0.. => {}
        -1 if layout.coding != Coding::Text => source = source.seek_from_end(layout.bytes(), 0)?,
        _ => {
            return Err(fields.refuse(
                "HeaderSize",
                "must be -1 (binary data at the end of its file) or the bytes before the data",
            ));
        }
    }
    Ok(Opened {
        source,
        layout,
        frame,
        world: Some(WorldAxes::Lps),
        segments: None,
        is_reversed: false,
        warnings,
    })
}

/// Reads up to and including `ElementDataFile`, which ends the header.
fn read_header(source: &mut Source) -> Result<Fields> {
    let mut fields = Fields::new(source.path());
    let mut read = Place::default();
    while let Some(line) = header_line(source, &mut read)? {
        if line.trim().is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            return Err(fields.no_field(read, "name = value"));
        };
        fields.insert(name, value)?;
        if name.trim().eq_ignore_ascii_case("ElementDataFile") {
            return Ok(fields);
        }
    }
    Err(fields.error("header field 'ElementDataFile' is missing"))
}

/// The first of several spellings that the header uses.
fn spelled<'a>(fields: &Fields, names: &[&'a str]) -> Option<&'a str> {
    names.iter().copied().find(|name| fields.get(name).is_some())
}

fn flag(fields: &Fields, name: &str) -> Result<bool> {
    match fields.get(name).map(str::to_ascii_lowercase).as_deref() {
        None | Some("false" | "f" | "0") => Ok(false),
        Some("true" | "t" | "1") => Ok(true),
        Some(_) => Err(fields.refuse(name, "must be True or False")),
    }
}

fn rank_of(fields: &Fields) -> Result<usize> {
    fields.required("NDims")?;
    match fields.number::<usize>("NDims")? {
        Some(rank @ 3..=4) => Ok(rank),
        _ => {
            Err(fields
                .refuse("NDims", "only volumes are read: 3, or 4 with a last axis of samples"))
        }
    }
}

/// The sizes of the axes, the values per voxel, and whether these stand side by side.
fn sizes_of(fields: &Fields, rank: usize, volumes: Volumes) -> Result<([u64; 3], u64, bool)> {
    fields.required("DimSize")?;
    let sizes = fields.numbers::<u64>("DimSize", Some(rank))?.unwrap_or_default();
    let samples = sizes.get(3).copied().unwrap_or(1);
    let channels = fields.number::<u64>("ElementNumberOfChannels")?.unwrap_or(1);
    if samples != 1 && (volumes == Volumes::One || channels != 1) {
        return Err(fields.refuse(
            "DimSize",
            "there are several volumes; --volume (lapd_context_set_volume) reads one of them as \
             labels, --probabilities all as maps",
        ));
    }
    if channels != 1 && volumes == Volumes::One {
        return Err(fields.refuse(
            "ElementNumberOfChannels",
            "voxels have several values; labels have one each: save one channel, or read all \
                 as maps by --probabilities",
        ));
    }
    let (values, interleaved) = if channels == 1 { (samples, false) } else { (channels, true) };
    Ok(([sizes[0], sizes[1], sizes[2]], values, interleaved))
}

fn frame_of(
    path: &Path,
    fields: &Fields,
    rank: usize,
    warnings: &mut Vec<String>,
) -> Result<Frame> {
    let first3 = |list: Vec<f64>| [list[0], list[1], list[2]];
    let vector = |names: &[&str]| match spelled(fields, names) {
        Some(name) => fields.numbers::<f64>(name, Some(rank)).map(|list| list.map(first3)),
        None => Ok(None),
    };
    let origin = vector(&["Offset", "Position", "Origin"])?.unwrap_or([0.0; 3]);
    let spacing = match vector(&["ElementSpacing", "ElementSize"])? {
        Some(spacing) => spacing,
        None => {
            warnings.push("the header gives no ElementSpacing; 1 is taken".into());
            [1.0; 3]
        }
    };
    let Some(name) = spelled(fields, &["TransformMatrix", "Rotation", "Orientation"]) else {
        if fields
            .get("AnatomicalOrientation")
            .is_some_and(|o| !o.eq_ignore_ascii_case("RAI") && !o.contains('?'))
        {
            warnings.push(
                "AnatomicalOrientation without TransformMatrix is ignored, as ITK does: \
                image axes are taken along the world's"
                    .into(),
            );
        }
        return frame_from_parts(
            path,
            "ElementSpacing",
            origin,
            spacing,
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        );
    };
    let matrix = fields.numbers::<f64>(name, Some(rank * rank))?.unwrap_or_default();
    let directions = [0, 1, 2].map(|axis| first3(matrix[axis * rank..].to_vec()));
    frame_from_parts(path, name, origin, spacing, directions)
}

fn scalar_of(fields: &Fields) -> Result<Scalar> {
    Ok(match fields.required("ElementType")?.to_ascii_uppercase().as_str() {
        "MET_CHAR" => Scalar::I8,
        "MET_UCHAR" => Scalar::U8,
        "MET_SHORT" => Scalar::I16,
        "MET_USHORT" => Scalar::U16,
        // MetaIO's long has 4 bytes on every machine.
        "MET_INT" | "MET_LONG" => Scalar::I32,
        "MET_UINT" | "MET_ULONG" => Scalar::U32,
        "MET_LONG_LONG" => Scalar::I64,
        "MET_ULONG_LONG" => Scalar::U64,
        "MET_FLOAT" => Scalar::F32,
        "MET_DOUBLE" => Scalar::F64,
        _ => return Err(fields.refuse("ElementType", "unknown, or no type of single numbers")),
    })
}

fn coding_of(fields: &Fields) -> Result<Coding> {
    // Binary unless said otherwise, as MetaIO has it for images.
    let binary = fields.get("BinaryData").is_none() || flag(fields, "BinaryData")?;
    let big = match spelled(fields, &["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]) {
        Some(name) => flag(fields, name)?,
        None => false,
    };
    Ok(match (binary, big) {
        (false, _) => Coding::Text,
        (true, false) => Coding::LittleEndian,
        (true, true) => Coding::BigEndian,
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use glam::DVec3;

    use super::super::read_image;
    use super::super::tests::{Files, gzip, labels, read_bytes};

    const VALUES: [u16; 6] = [0, 1, 300, 5, 5, 0];

    fn little() -> Vec<u8> {
        VALUES.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    fn mha(lines: &str, data: &[u8]) -> Vec<u8> {
        let header = format!(
            "ObjectType = Image\nDimSize = 3 2 1\nElementType = \
             MET_USHORT\n{lines}\nElementDataFile = LOCAL\n"
        );
        [header.as_bytes(), data].concat()
    }

    fn zlib(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn every_coding_gives_the_same_labels() {
        let big: Vec<u8> = VALUES.iter().flat_map(|v| v.to_be_bytes()).collect();
        for file in [
            mha("NDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False", &little()),
            mha("NDims = 3\nElementByteOrderMSB = True", &big),
            mha("NDims = 3\nCompressedData = True\nCompressedDataSize = 20", &zlib(&little())),
            mha("NDims = 3\nCompressedData = True", &gzip(&little())),
            mha("NDims = 3\nBinaryData = False", b"0 1 300\n5 5 0\n"),
            mha("NDims = 3\nHeaderSize = 5", &[b"12345", &little()[..]].concat()),
            mha("NDims = 3\nHeaderSize = -1", &[b"1234567", &little()[..]].concat()),
        ] {
            let read = read_bytes("a.mha", &file).unwrap();
            assert_eq!(
                labels(&read.image),
                VALUES.map(i32::from),
                "{}",
                String::from_utf8_lossy(&file)
            );
        }
    }

    #[test]
    fn the_rows_of_the_matrix_are_the_directions() {
        let place = "ElementSpacing = 2 3 4\nOffset = 10 20 30\nTransformMatrix = 0 1 0 -1 0 0 0 0 \
         1\nAnatomicalOrientation = RAI";
        let read = read_bytes("a.mha", &mha(&format!("NDims = 3\n{place}"), &little())).unwrap();
        assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(7.0, 22.0, 34.0));
        assert!(read.warnings.is_empty());
        let four = "NDims = 4\nElementSpacing = 2 3 4 1\nOffset = 0 0 0 0\nTransformMatrix = 0 1 0 \
         0 -1 0 0 0 0 0 1 0 0 0 0 1";
        let file = String::from_utf8_lossy(&mha(four, &[]))
            .replace("DimSize = 3 2 1", "DimSize = 3 2 1 1");
        let read = read_bytes("a.mha", &[file.as_bytes(), &little()].concat()).unwrap();
        assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(-3.0, 2.0, 4.0));
        let read =
            read_bytes("a.mha", &mha("NDims = 3\nAnatomicalOrientation = LPS", &little())).unwrap();
        assert_eq!(read.warnings.len(), 2);
    }

    #[test]
    fn data_files_lie_beside_the_header() {
        let files = Files::new();
        files.write("a.zraw", &zlib(&little()));
        let header = String::from_utf8(mha("NDims = 3\nCompressedData = True", b"")).unwrap();
        let read = read_image(&files.write("a.mhd", header.replace("LOCAL", "a.zraw").as_bytes()))
            .unwrap();
        assert_eq!(labels(&read.image), VALUES.map(i32::from));
        for split in ["LIST", "a%03d.raw 1 2 1"] {
            assert!(
                read_bytes("b.mhd", header.replace("LOCAL", split).as_bytes())
                    .unwrap_err()
                    .contains("several files")
            );
        }
    }

    #[test]
    fn refuses_what_it_does_not_read() {
        for (lines, expected) in [
            ("", "'NDims' is missing"),
            ("NDims = 2", "only volumes"),
            ("NDims = 3\nNDims = 3", "given twice"),
            ("NDims = 3\nCompressedData = yes", "True or False"),
            ("NDims = 3\nElementNumberOfChannels = 3", "one channel"),
            ("NDims = 3\nElementSpacing = 1 1", "must give 3 number(s), got 2"),
            ("NDims = 3\nElementSpacing = 1 0 1", "spacing of axis 1"),
            ("NDims = 3\nTransformMatrix = 1 0 0 1 0 0 0 0 1", "orthonormal"),
            ("NDims = 3\nTransformMatrix = 1 0 0 0 0 0 0 0 1", "orthonormal"),
            ("NDims = 3\nHeaderSize = -2", "HeaderSize"),
            ("NDims = 3\nHeaderSize = 13", "HeaderSize 13 lies past the end"),
            ("NDims = 3\nCompressedData = True", "damaged"),
            ("nonsense", "line 4 of the header is not of the form 'name = value'"),
        ] {
            let message = read_bytes("a.mha", &mha(lines, &little())).unwrap_err();
            assert!(message.contains(expected), "{lines:?} gave {message:?}");
        }
        assert!(
            read_bytes("a.mha", &mha("NDims = 3", &little()[..11]))
                .unwrap_err()
                .contains("cut off")
        );
        assert!(
            read_bytes("a.mha", &mha("NDims = 3\nCompressedData = True", &zlib(&little()[..11])))
                .unwrap_err()
                .contains("cut off")
        );
    }
}
