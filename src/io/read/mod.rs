//! Readers of images, chosen by the file's name ending.
//!
//! | ending | format | frame of its world coordinates |
//! |---|---|---|
//! | `.nrrd` `.nhdr` | NRRD, attached or detached header | as `space` says: LPS, RAS, LAS, none |
//! | `.nii` `.nii.gz` | NIfTI-1 and NIfTI-2, one file | RAS |
//! | `.mha` `.mhd` | MetaImage | LPS, as ITK reads it |
//! | `.inr` `.inr.gz` | INRIMAGE-4 | not said |
//!
//! LPS means that x, y, z grow towards the patient's left, posterior, superior. By default
//! coordinates stay as the file gives them; [`ReadOptions`] asks for another frame.
//!
//! Files may be damaged or hostile. Whatever they hold, a reader gives the whole image or one
//! error; it never panics, and memory stays in proportion to the file: sizes are multiplied with
//! checks, a header that promises more than the file can hold even compressed (deflate reaches 1032
//! to 1) is refused before anything is allocated, and voxels are read as a stream, so that only the
//! dense ids, 2 bytes per voxel, are ever held.
//!
//! Labels are integers, or numbers with whole values; what is within 1e-3 of one is rounded with a
//! warning, the rest where [`LabelValues::Rounded`] asks for it. [`values`] reads scans and
//! probability maps, of any numbers, from the same formats.
//!
//! The layers: `source` gives bytes (and decompresses), `fields` parses header values, `voxels`
//! turns bytes into labels or real numbers; the file of each format knows its header only.

mod distinct;
mod fields;
mod inr;
mod metaimage;
mod nifti;
mod nrrd;
mod segments;
mod source;
pub mod values;
mod voxels;

use std::path::Path;

use glam::DVec3;
use segments::Segments;
use source::Source;
use voxels::{Layout, read_distinct, read_labels, read_layers};

use crate::image::{Frame, LabelImage, WorldAxes};
use crate::{Error, Result};

/// The frame that the image, and so the mesh, is to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum WorldFrame {
    /// Coordinates as the file gives them.
    #[default]
    AsStored,
    /// Left, posterior, superior.
    Lps,
    /// Right, anterior, superior.
    Ras,
}

/// How to read.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// The frame wanted. A file that does not say its own is kept as stored, with a warning.
    pub world: WorldFrame,
    /// What becomes of numbers that are no labels.
    pub values: LabelValues,
    /// The layers of a segmentation, from 0 on, in the order in which they count: of segments that
    /// overlap, that of the later one. `None` for the order of the file.
    pub layer_order: Option<Vec<usize>>,
}

/// What becomes of numbers of a label image that are no whole ones, or too large for labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LabelValues {
    /// They are refused, but for those within 1e-3 of a whole one, which are rounded with a
    /// warning.
    #[default]
    Whole,
    /// They are rounded, with a warning.
    Rounded,
    /// Each distinct value becomes a label: 0 stays 0, the others become 1, 2, ... in increasing
    /// order. Not of images with several values per voxel.
    Distinct,
}

/// An image from a file.
#[derive(Clone, Debug)]
pub struct ReadImage {
    /// The image.
    pub image: LabelImage,
    /// What its world axes mean; `None` when the file does not say.
    pub world: Option<WorldAxes>,
    /// What a user should know, one line each: doubtful or contradicting headers that did not
    /// prevent reading.
    pub warnings: Vec<String>,
    /// With [`LabelValues::Distinct`] the values that became labels 1, 2, ..., with all their
    /// digits.
    pub values: Vec<String>,
    /// The names that a segmentation of 3D Slicer gives to labels.
    pub names: Vec<(i32, String)>,
}

/// Reads a label image, coordinates as stored.
///
/// # Errors
/// As [`read_image_with`].
pub fn read_image(path: &Path) -> Result<ReadImage> {
    read_image_with(path, &ReadOptions::default())
}

/// Reads a label image. The file's name ending, in any case, chooses the format.
///
/// # Errors
/// [`Error::InvalidArgument`]: no reader for this ending; an order of layers that is not one of
/// this file's layers; [`LabelValues::Distinct`] of several layers. [`Error::Io`]: the file, or the
/// data file that it names, cannot be opened or read. [`Error::Format`]: it is damaged, cut off, or
/// uses what this library does not read. [`Error::OutOfMemory`].
pub fn read_image_with(path: &Path, options: &ReadOptions) -> Result<ReadImage> {
    let Opened { mut source, layout, frame, world, segments, mut warnings } =
        open(path, Volumes::One, options)?;
    let names = segments.as_ref().map(Segments::names_of_values).unwrap_or_default();
    let mut layers = segments.filter(|_| layout.volumes > 1);
    if let Some(order) = &options.layer_order {
        set_layer_order(path, order, layers.as_mut(), layout.volumes)?;
    }
    let (image, values, names) = match (options.values, layers) {
        (LabelValues::Distinct, Some(_)) => {
            return Err(Error::InvalidArgument(format!(
                "{}: distinct values are numbered where voxels have one value each; here they have \
                 one per layer, and segments become labels without that",
                path.display()
            )));
        }
        // The labels are others than the values that the header names.
        (LabelValues::Distinct, None) => {
            let (image, values) = read_distinct(&mut source, &layout, frame, &mut warnings)?;
            (image, values, Vec::new())
        }
        (whole, None) => {
            let image = read_labels(&mut source, &layout, frame, whole, &mut warnings)?;
            (image, Vec::new(), names)
        }
        (whole, Some(layers)) => {
            let (image, names) =
                read_layers(&mut source, &layout, frame, whole, layers, &mut warnings)?;
            (image, Vec::new(), names)
        }
    };
    Ok(ReadImage { image, world, warnings, values, names })
}

/// Has the layers of a file, of which there are `count`, count in this order.
fn set_layer_order(
    path: &Path,
    order: &[usize],
    layers: Option<&mut Segments>,
    count: usize,
) -> Result<()> {
    let path = path.display();
    let Some(layers) = layers else {
        return Err(Error::InvalidArgument(format!(
            "{path}: an order of layers is for segmentations of several layers; this has one"
        )));
    };
    if !layers.set_order(order, count) {
        return Err(Error::InvalidArgument(format!(
            "{path}: the order of layers {order:?} must name each layer, 0 to {}, once",
            count - 1
        )));
    }
    Ok(())
}

/// Values per voxel that a reader may find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Volumes {
    /// One: labels.
    One,
    Many,
}

/// A file whose header has been read.
struct Opened {
    /// At the first voxel.
    source: Source,
    layout: Layout,
    frame: Frame,
    world: Option<WorldAxes>,
    /// Segments in layers.
    segments: Option<Segments>,
    warnings: Vec<String>,
}

/// Reads the header of a file, up to the first voxel.
type ReadHeader = fn(&Path, Volumes) -> Result<Opened>;

/// Every ending that is known, in lower case.
const ENDINGS: [(&str, ReadHeader); 8] = [
    (".nrrd", nrrd::open),
    (".nhdr", nrrd::open),
    (".nii", nifti::open),
    (".nii.gz", nifti::open),
    (".mha", metaimage::open),
    (".mhd", metaimage::open),
    (".inr", inr::open),
    (".inr.gz", inr::open),
];

/// Reads a header, and turns the frame as asked for.
fn open(path: &Path, volumes: Volumes, options: &ReadOptions) -> Result<Opened> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let Some((_, read_header)) = ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)) else {
        return Err(Error::InvalidArgument(format!(
            "{}: no reader for this name ending; read are {}",
            path.display(),
            ENDINGS.map(|(ending, _)| ending).join(" ")
        )));
    };
    let mut opened = read_header(path, volumes)?;
    let wanted = match options.world {
        WorldFrame::AsStored => return Ok(opened),
        WorldFrame::Lps => WorldAxes::Lps,
        WorldFrame::Ras => WorldAxes::Ras,
    };
    match opened.world {
        Some(stored) => {
            opened.frame = reflected(&opened.frame, stored.signs() * wanted.signs())?;
            opened.world = Some(wanted);
        }
        None => {
            let warning = format!(
                "the file does not say what its axes mean: coordinates stay as stored, not {}",
                wanted.name()
            );
            opened.warnings.push(warning);
        }
    }
    Ok(opened)
}

/// The frame with its world axes turned around where `signs` is -1.
fn reflected(frame: &Frame, signs: DVec3) -> Result<Frame> {
    let columns =
        frame.direction().to_cols_array_2d().map(|column| (signs * DVec3::from(column)).to_array());
    Frame::new((signs * frame.origin()).to_array(), frame.spacing().to_array(), columns)
}

/// A frame from the steps between neighbouring voxels along each axis: directions times spacings.
/// `what` names the header fields.
fn frame_from_steps(
    path: &Path,
    what: &str,
    origin: [f64; 3],
    steps: [[f64; 3]; 3],
) -> Result<Frame> {
    let mut spacing = [0.0; 3];
    let mut direction = steps;
    for axis in 0..3 {
        spacing[axis] = DVec3::from(steps[axis]).length();
        if spacing[axis] == 0.0 {
            return Err(Error::format(
                path,
                format!("{what} is singular: image axis {axis} has length 0"),
            ));
        }
        // A step that is not finite, or under- or overflows when squared, is refused by the frame.
        direction[axis] = steps[axis].map(|x| x / spacing[axis]);
    }
    frame_from_parts(path, what, origin, spacing, direction)
}

/// As [`Frame::new`], with the error naming the file and its header fields.
fn frame_from_parts(
    path: &Path,
    what: &str,
    origin: [f64; 3],
    spacing: [f64; 3],
    direction: [[f64; 3]; 3],
) -> Result<Frame> {
    Frame::new(origin, spacing, direction).map_err(|e| Error::format(path, format!("{what}: {e}")))
}

#[cfg(test)]
pub(crate) mod tests {
    use std::io::Write;
    use std::path::PathBuf;

    use super::*;

    /// A directory for the files of one test.
    pub(crate) struct Files(tempfile::TempDir);

    impl Files {
        pub(crate) fn new() -> Self {
            Self(tempfile::tempdir().unwrap())
        }

        pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
            let path = self.0.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        }
    }

    pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    /// Labels, x fastest.
    pub(crate) fn labels(image: &LabelImage) -> Vec<i32> {
        image.ids().iter().map(|&id| image.labels()[usize::from(id)]).collect()
    }

    /// Reads bytes under a name; errors come without the path.
    pub(crate) fn read_bytes(name: &str, bytes: &[u8]) -> std::result::Result<ReadImage, String> {
        let files = Files::new();
        let path = files.write(name, bytes);
        read_image(&path).map_err(|e| e.to_string().replace(&format!("{}: ", path.display()), ""))
    }

    /// A NRRD of one voxel at (1, 2, 3) whose x axis is the world's y axis.
    fn tilted(space: &str) -> Vec<u8> {
        format!(
            "NRRD0005\ntype: uint8\ndimension: 3\n{space}\nsizes: 1 1 1\n\
             space directions: (0,2,0) (1,0,0) (0,0,1)\n\
             space origin: (1,2,3)\nencoding: raw\n\n\x07"
        )
        .into_bytes()
    }

    #[test]
    fn the_world_frame_is_selectable_where_it_is_known() {
        let files = Files::new();
        let read = |space: &str, world| {
            read_image_with(
                &files.write("a.NRRD", &tilted(space)),
                &ReadOptions { world, ..ReadOptions::default() },
            )
            .unwrap()
        };
        let lps = read("space: LPS", WorldFrame::AsStored);
        assert_eq!(lps.world, Some(WorldAxes::Lps));
        assert_eq!(lps.image.frame().origin(), DVec3::new(1.0, 2.0, 3.0));
        let ras = read("space: left-posterior-superior", WorldFrame::Ras);
        assert_eq!(ras.world, Some(WorldAxes::Ras));
        assert_eq!(ras.image.frame().origin(), DVec3::new(-1.0, -2.0, 3.0));
        assert_eq!(ras.image.frame().to_world(DVec3::X), DVec3::new(-1.0, -4.0, 3.0));
        let from_las = read("space: LAS", WorldFrame::Lps);
        assert_eq!(from_las.image.frame().origin(), DVec3::new(1.0, -2.0, 3.0));
        let unknown = read("space dimension: 3", WorldFrame::Ras);
        assert_eq!(
            (unknown.world, unknown.image.frame().origin()),
            (None, DVec3::new(1.0, 2.0, 3.0))
        );
        assert!(
            unknown.warnings[0].contains("does not say")
                && unknown.warnings[0].ends_with("not RAS")
        );
    }

    #[test]
    fn what_is_no_image_file_is_named() {
        assert!(read_bytes("a.png", b"x").unwrap_err().contains("no reader for this name ending"));
        assert!(matches!(read_image(Path::new("a.png")), Err(Error::InvalidArgument(_))));
        assert_eq!(read_bytes("a.nrrd", b"").unwrap_err(), "the file is empty");
        assert!(
            read_bytes("a.mha", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
                .unwrap_err()
                .contains("Git LFS pointer")
        );
        assert!(matches!(read_image(Path::new("/nonexistent/a.nii")), Err(Error::Io { .. })));
        let directory = tempfile::Builder::new().suffix(".nii").tempdir().unwrap();
        assert!(
            read_image(directory.path()).unwrap_err().to_string().contains("not a regular file")
        );
    }
}
