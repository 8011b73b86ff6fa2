//! INRIMAGE-4 (`.inr`, `.inr.gz`), the format of the Inria image tools. A text header
//! `#INRIMAGE-4#{` ... `##}`, padded to a multiple of 256 bytes, then the voxels, x fastest.
//!
//! VX VY VZ are the spacings, TX TY TZ the place of the first voxel. The format does not say what
//! its axes mean in the patient.

use std::path::Path;

use super::fields::{Fields, Place, header_line};
use super::source::{Access, Source};
use super::voxels::{Coding, Layout, Scalar};
use super::{Opened, Volumes, frame_from_parts};
use crate::Result;

/// The header is a multiple of this long.
const BLOCK: u64 = 256;

pub(super) fn open<'a>(path: &Path, volumes: Volumes, access: Access<'a>) -> Result<Opened<'a>> {
    let mut source = Source::open_maybe_gzip(path, access)?;
    let fields = read_header(&mut source)?;
    let mut warnings = Vec::new();

    let size = |name: &str| Ok(fields.number::<u64>(name)?.unwrap_or(1));
    fields.required("XDIM")?;
    fields.required("YDIM")?;
    let sizes = [size("XDIM")?, size("YDIM")?, size("ZDIM")?];
    let values = size("VDIM")?;
    if values != 1 && volumes == Volumes::One {
        return Err(fields.refuse(
            "VDIM",
            "voxels have several values; labels have one each: --probabilities reads all as maps",
        ));
    }
    let layout = Layout::new(&source, sizes, scalar_of(&fields)?, byte_order(&fields)?)?;
    let layout = layout.with_volumes(&source, values, true)?;

    let triple = |names: [&str; 3], default: f64| -> Result<[f64; 3]> {
        let [x, y, z] = names.map(|name| Ok(fields.number::<f64>(name)?.unwrap_or(default)));
        Ok([x?, y?, z?])
    };
    let spacing = triple(["VX", "VY", "VZ"], 1.0)?;
    if ["VX", "VY", "VZ"].iter().any(|name| fields.get(name).is_none()) {
        warnings.push(
            "the header does not give VX, VY and VZ, the spacings; 1 is taken where one is missing"
                .into(),
        );
    }
    if triple(["RX", "RY", "RZ"], 0.0)? != [0.0; 3] {
        warnings.push(
            "the rotation RX, RY, RZ of the header is ignored: image axes are taken along \
                the world's"
                .into(),
        );
    }
    let origin = triple(["TX", "TY", "TZ"], 0.0)?;
    let frame = frame_from_parts(
        path,
        "VX, VY, VZ",
        origin,
        spacing,
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    )?;
    Ok(Opened { source, layout, frame, world: None, segments: None, is_reversed: false, warnings })
}

/// Reads the header with its padding.
fn read_header(source: &mut Source) -> Result<Fields> {
    if !source.starts_with(b"#INRIMAGE-4#{")? {
        return Err(source.error("not an INR file: it does not begin with '#INRIMAGE-4#{'"));
    }
    let mut fields = Fields::new(source.path());
    let mut read = Place::default();
    header_line(source, &mut read)?;
    while let Some(line) = header_line(source, &mut read)? {
        let line = line.trim();
        if line == "##}" {
            source.skip(read.bytes.next_multiple_of(BLOCK) - read.bytes, "header padding")?;
            return Ok(fields);
        }
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            return Err(fields.no_field(read, "NAME=value"));
        };
        fields.insert(name, value)?;
    }
    Err(fields.error("the header does not end with '##}'"))
}

fn scalar_of(fields: &Fields) -> Result<Scalar> {
    let kind = fields.required("TYPE")?.to_ascii_lowercase();
    let bits: Option<usize> =
        fields.required("PIXSIZE")?.split_whitespace().next().and_then(|word| word.parse().ok());
    let bytes = match bits {
        Some(bits @ (8 | 16 | 32 | 64)) => bits / 8,
        _ => return Err(fields.refuse("PIXSIZE", "must be 8, 16, 32 or 64 bits")),
    };
    if fields.get("SCALE").is_some_and(|scale| scale != "2**0" && !kind.starts_with("float")) {
        return Err(fields.refuse("SCALE", "fixed-point values are not labels; only 2**0 is read"));
    }
    let scalar = match (kind.as_str(), bytes) {
        ("unsigned fixed", _) => Scalar::integer(bytes, false),
        ("signed fixed", _) => Scalar::integer(bytes, true),
        ("float", 4) => Some(Scalar::F32),
        ("float", 8) => Some(Scalar::F64),
        _ => None,
    };
    scalar.ok_or_else(|| {
        fields.refuse("TYPE", format!("not a type of {} bits that is read", 8 * bytes))
    })
}

fn byte_order(fields: &Fields) -> Result<Coding> {
    match fields.get("CPU").map(str::to_ascii_lowercase).as_deref() {
        Some("decm" | "alpha" | "pc") => Ok(Coding::LittleEndian),
        Some("sun" | "sgi") => Ok(Coding::BigEndian),
        None => Err(fields.error("header field 'CPU', the byte order, is missing")),
        Some(_) => {
            Err(fields.refuse("CPU", "unknown byte order; known are decm, alpha, pc, sun, sgi"))
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::tests::{gzip, labels, read_bytes};

    const VALUES: [i16; 6] = [0, 1, -300, 5, 5, 0];

    fn inr(lines: &str, data: &[u8]) -> Vec<u8> {
        let mut header = format!("#INRIMAGE-4#{{\n# comment\nXDIM=3\nYDIM=2\n{lines}\n");
        let end = (header.len() + 4).next_multiple_of(256);
        while header.len() + 4 < end {
            header.push('\n');
        }
        header.push_str("##}\n");
        [header.as_bytes(), data].concat()
    }

    fn bytes(order: fn(i16) -> [u8; 2]) -> Vec<u8> {
        VALUES.iter().flat_map(|&v| order(v)).collect()
    }

    const SHORT: &str =
        "ZDIM=1\nVDIM=1\nTYPE=signed fixed\nPIXSIZE=16 bits\nSCALE=2**0\nVX=0.5\nVY=2\nVZ=3";

    #[test]
    fn both_byte_orders_gzipped_or_not() {
        let little = inr(&format!("{SHORT}\nCPU=decm\nTX=1\nTY=2\nTZ=3"), &bytes(i16::to_le_bytes));
        let big = inr(&format!("{SHORT}\nCPU=sun\nTX=1\nTY=2\nTZ=3"), &bytes(i16::to_be_bytes));
        for read in [
            read_bytes("a.inr", &little),
            read_bytes("a.inr", &big),
            read_bytes("a.inr.gz", &gzip(&little)),
        ] {
            let read = read.unwrap();
            assert_eq!(
                (labels(&read.image), read.world, read.warnings.len()),
                (VALUES.map(i32::from).to_vec(), None, 0)
            );
            assert_eq!(read.image.frame().to_world(DVec3::ONE), DVec3::new(1.5, 4.0, 6.0));
        }
    }

    #[test]
    fn floats_with_whole_values_are_labels() {
        let data: Vec<u8> = VALUES.iter().flat_map(|&v| f32::from(v).to_le_bytes()).collect();
        let read = read_bytes("a.inr", &inr("TYPE=float\nPIXSIZE=32 bits\nCPU=pc", &data)).unwrap();
        assert_eq!((labels(&read.image), read.warnings.len()), (VALUES.map(i32::from).to_vec(), 1));
    }

    #[test]
    fn refuses_what_it_does_not_read() {
        let data = bytes(i16::to_le_bytes);
        for (lines, expected) in [
            (SHORT.to_owned(), "'CPU', the byte order, is missing"),
            (format!("{SHORT}\nCPU=vax"), "unknown byte order"),
            (format!("{}\nCPU=pc", SHORT.replace("16 bits", "12 bits")), "PIXSIZE"),
            (format!("{}\nCPU=pc", SHORT.replace("signed fixed", "packed")), "TYPE"),
            (format!("{}\nCPU=pc", SHORT.replace("2**0", "2**3")), "SCALE"),
            (format!("{}\nCPU=pc", SHORT.replace("VDIM=1", "VDIM=3")), "several values"),
            (format!("{}\nCPU=pc", SHORT.replace("VX=0.5", "VX=0")), "spacing of axis 0"),
            (format!("{}\nCPU=pc", SHORT.replace("ZDIM=1", "ZDIM=2")), "cut off"),
        ] {
            let message = read_bytes("a.inr", &inr(&lines, &data)).unwrap_err();
            assert!(message.contains(expected), "{lines:?} gave {message:?}");
        }
        assert!(
            read_bytes("a.inr", b"#INRIMAGE-4#{\nXDIM=3\n")
                .unwrap_err()
                .contains("does not end with")
        );
        assert!(
            read_bytes("a.inr", b"#INRIMAGE-4#{\nXDIM=3\n##}\n")
                .unwrap_err()
                .contains("header padding lies past the end")
        );
        assert!(read_bytes("a.inr", b"nothing").unwrap_err().contains("not an INR file"));
    }
}
