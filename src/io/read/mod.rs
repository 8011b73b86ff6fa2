//! Readers of images, chosen by the file's name ending.
//!
//! | ending | format | frame of its world coordinates |
//! |---|---|---|
//! | `.nrrd` `.nhdr` | NRRD, attached or detached header | as `space` says: LPS, RAS, LAS, none |
//! | `.nii` `.nii.gz` | NIfTI-1 and NIfTI-2, one file | RAS |
//! | `.mha` `.mhd` | MetaImage | LPS, as ITK reads it |
//! | `.inr` `.inr.gz` | INRIMAGE-4 | not said |
//! | `.npy` | NumPy's arrays | not said, nor the spacing |
//! | `.tif` `.tiff` | stacks of TIFF pages, with the feature `tiff` | not said; ImageJ's spacing |
//!
//! LPS means that x, y, z grow towards the patient's left, posterior, superior. By default
//! coordinates stay as the file gives them; [`ReadOptions`] asks for another frame.
//!
//! Files may be damaged or hostile. Whatever they hold, a reader gives the whole image or one
//! error; it never panics, and memory stays in proportion to the file: sizes are multiplied with
//! checks, a header that promises more than the file can hold even compressed (deflate reaches 1032
//! to 1), or more than [`ReadOptions::max_bytes`], is refused before anything is allocated, and
//! voxels are read as a stream, so that only the dense ids, 2 bytes per voxel, are ever held. A
//! detached header names a file below its own folder, or is refused
//! ([`ReadOptions::allow_outside`]). No error quotes voxels that are no numbers.
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
pub mod label_table;
mod metaimage;
mod nifti;
mod npy;
mod nrrd;
mod segments;
mod source;
#[cfg(feature = "tiff")]
mod tiff;
pub mod values;
mod voxels;

use std::path::Path;

use glam::DVec3;
use segments::Segments;
use source::{Access, Source};
use voxels::{Layout, read_distinct, read_labels, read_layers};

use crate::error::shown;
use crate::image::{Frame, LabelImage, LabelNames, WorldAxes};
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
    /// Detached headers may name data files that are not below the header's own folder, links that
    /// lead outside included.
    pub allow_outside: bool,
    /// Which volume to read of a file that has several, from 0 on. `None`: a file of labels or of a
    /// scan has one.
    pub volume: Option<u64>,
    /// The most bytes that the image may take in memory. `None` for 1000 times the file's bytes, or
    /// 1 GiB where that is more, and no more than half of the machine's memory.
    pub max_bytes: Option<u64>,
}

impl ReadOptions {
    /// What a file may do, of which reading is this part of the call's work.
    fn access<'a>(&self, go_on: &'a GoOn<'a>, share: (f64, f64)) -> Access<'a> {
        let &Self { allow_outside, max_bytes, .. } = self;
        Access { go_on, allow_outside, max_bytes, share }
    }
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
    /// The names and colours that a segmentation of 3D Slicer gives to labels.
    pub names: LabelNames,
}

/// Reads a label image, coordinates as stored.
///
/// # Errors
/// As [`read_image_with`].
pub fn read_image(path: &Path) -> Result<ReadImage> {
    read_image_with(path, &ReadOptions::default(), &|_| Ok(()))
}

/// Is told how much of a call's work is done, 0 to 1, some thousand times a second; its error ends
/// the call.
pub type GoOn<'a> = dyn Fn(f64) -> Result<()> + 'a;

/// Reads a label image. The file's name ending, in any case, chooses the format.
///
/// # Errors
/// [`Error::InvalidArgument`]: no reader for this ending; an order of layers that is not one of
/// this file's layers; [`LabelValues::Distinct`] of several layers. [`Error::Io`]: the file, or the
/// data file that it names, cannot be opened or read. [`Error::Format`]: it is damaged, cut off, or
/// uses what this library does not read. [`Error::MemoryLimit`]: it asks for more memory than it
/// may. [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn read_image_with(path: &Path, options: &ReadOptions, go_on: &GoOn<'_>) -> Result<ReadImage> {
    let access = options.access(go_on, (0.0, 1.0));
    let Opened { mut source, layout, frame, world, segments, is_reversed, mut warnings } =
        open(path, Volumes::One, options, access)?;
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
                shown(path)
            )));
        }
        // The labels are others than the values that the header names.
        (LabelValues::Distinct, None) => {
            let (image, values) = read_distinct(&mut source, &layout, frame, &mut warnings)?;
            (image, values, LabelNames::default())
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
    let image = if is_reversed { image.with_reversed_axes()? } else { image };
    Ok(ReadImage { image, world, warnings, values, names })
}

/// Has the layers of a file, of which there are `count`, count in this order.
fn set_layer_order(
    path: &Path,
    order: &[usize],
    layers: Option<&mut Segments>,
    count: usize,
) -> Result<()> {
    let path = shown(path);
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
struct Opened<'a> {
    /// At the first voxel.
    source: Source<'a>,
    layout: Layout,
    frame: Frame,
    world: Option<WorldAxes>,
    /// Segments in layers.
    segments: Option<Segments>,
    /// The last axis runs fastest, and sizes are those of the reversed axes.
    is_reversed: bool,
    warnings: Vec<String>,
}

impl Opened<'_> {
    /// One of the volumes of a file.
    fn only(self, path: &Path, volume: u64) -> Result<Self> {
        let Self { source, layout, .. } = self;
        let count = layout.volumes as u64;
        if volume >= count {
            return Err(Error::InvalidArgument(format!(
                "{}: volume {volume} is asked for, and there are {count}, from 0 on",
                shown(path)
            )));
        }
        let Some(one) = layout.one_volume() else {
            return Err(Error::InvalidArgument(format!(
                "{}: volume {volume} is asked for, and the values of a voxel stand side by side \
                 here, or as text",
                shown(path)
            )));
        };
        if count == 1 {
            return Ok(Self { source, ..self });
        }
        let source = source.part(volume * one.bytes(), one.bytes())?;
        Ok(Self { source, layout: one, segments: None, ..self })
    }
}

/// Reads the header of a file, up to the first voxel.
type ReadHeader = for<'a> fn(&Path, Volumes, Access<'a>) -> Result<Opened<'a>>;

/// Every ending that is known, in lower case.
const ENDINGS: &[(&str, ReadHeader)] = &[
    (".nrrd", nrrd::open),
    (".nhdr", nrrd::open),
    (".nii", nifti::open),
    (".nii.gz", nifti::open),
    (".mha", metaimage::open),
    (".mhd", metaimage::open),
    (".inr", inr::open),
    (".inr.gz", inr::open),
    (".npy", npy::open),
    #[cfg(feature = "tiff")]
    (".tif", tiff::open),
    #[cfg(feature = "tiff")]
    (".tiff", tiff::open),
];

/// Reads a header, and turns the frame as asked for.
fn open<'a>(
    path: &Path,
    volumes: Volumes,
    options: &ReadOptions,
    access: Access<'a>,
) -> Result<Opened<'a>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let Some((_, read_header)) = ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)) else {
        return Err(Error::InvalidArgument(format!(
            "{}: no reader for this name ending; read are {}",
            shown(path),
            ENDINGS.iter().map(|(ending, _)| *ending).collect::<Vec<_>>().join(" ")
        )));
    };
    let volumes = if options.volume.is_some() { Volumes::Many } else { volumes };
    let mut opened = read_header(path, volumes, access)?;
    if let Some(volume) = options.volume {
        opened = opened.only(path, volume)?;
    }
    let wanted = match options.world {
        WorldFrame::AsStored => return Ok(opened),
        WorldFrame::Lps => WorldAxes::Lps,
        WorldFrame::Ras => WorldAxes::Ras,
    };
    match opened.world {
        // Nothing is turned, nor rounded once more.
        Some(stored) if stored == wanted => {}
        Some(stored) => {
            opened.frame = opened.frame.reflected(stored.signs() * wanted.signs());
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

/// A frame from the steps between neighbouring voxels along each axis: directions times spacings.
/// `what` names the header fields; `spacing_of` tells the spacing of an axis by the length of its
/// step.
fn frame_from_steps(
    path: &Path,
    what: &str,
    origin: [f64; 3],
    steps: [[f64; 3]; 3],
    spacing_of: impl Fn(usize, f64) -> f64,
) -> Result<Frame> {
    let mut spacing = [0.0; 3];
    let mut direction = steps;
    for axis in 0..3 {
        let length = DVec3::from(steps[axis]).length();
        if length == 0.0 {
            return Err(Error::format(
                path,
                format!("{what} is singular: image axis {axis} has length 0"),
            ));
        }
        // A step that is not finite, or under- or overflows when squared, is refused by the frame.
        direction[axis] = steps[axis].map(|x| x / length);
        spacing[axis] = spacing_of(axis, length);
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
                &|_| Ok(()),
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

    /// A MetaImage header of 4 voxels in another file.
    fn header_of(data: &str) -> Vec<u8> {
        format!("NDims = 3\nDimSize = 4 1 1\nElementType = MET_UCHAR\nElementDataFile = {data}\n")
            .into_bytes()
    }

    #[test]
    #[cfg(unix)]
    fn headers_name_files_below_their_own_folder_only() {
        use std::os::unix::fs::symlink;
        let outer = tempfile::tempdir().unwrap();
        let at = |name: &str| outer.path().join(name);
        std::fs::create_dir_all(at("inner/deep")).unwrap();
        for (name, text) in [("secret", "\x01\x02\x03\x04"), ("inner/deep/data", "\0\x01\x02\x03")]
        {
            std::fs::write(at(name), text).unwrap();
        }
        symlink(at("secret"), at("inner/link_out")).unwrap();
        symlink("deep/data", at("inner/link_in")).unwrap();
        symlink(outer.path(), at("inner/folder_out")).unwrap();
        let read = |name: &str, allow_outside| {
            std::fs::write(at("inner/a.mhd"), header_of(name)).unwrap();
            let options = ReadOptions { allow_outside, ..ReadOptions::default() };
            read_image_with(&at("inner/a.mhd"), &options, &|_| Ok(())).map_err(|e| e.to_string())
        };
        for inside in ["deep/data", "./deep/data", "link_in", "deep/../deep/data"] {
            assert!(read(inside, false).is_ok(), "{inside}");
        }
        let absolute = at("inner/deep/data");
        assert!(read(absolute.to_str().unwrap(), false).is_ok());
        let secret = at("secret");
        for outside in ["../secret", "link_out", "folder_out/secret", secret.to_str().unwrap()] {
            let refused = read(outside, false).unwrap_err();
            assert!(refused.contains("lies outside of the header's folder"), "{refused}");
            assert!(refused.contains("--allow-outside"), "{refused}");
            assert!(read(outside, true).is_ok(), "{outside}");
        }
        // What does not exist elsewhere is refused as what does.
        for missing in ["/nonexistent/x", "../missing"] {
            assert!(read(missing, false).unwrap_err().contains("lies outside"), "{missing}");
        }
        assert!(read("missing", false).unwrap_err().contains("No such file"));
        let refused = read("deep", false).unwrap_err();
        assert!(refused.contains("not a regular file"), "{refused}");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_pipe_without_a_writer_is_refused_at_once() {
        let files = Files::new();
        let path = files.write("gone", b"").with_file_name("pipe.nii");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        assert!(read_image(&path).unwrap_err().to_string().contains("not a regular file"));
    }

    /// Text instead of binary voxels: what is no number stays unsaid, as it may be of any file.
    #[test]
    fn errors_quote_no_voxels() {
        let files = Files::new();
        files.write("secret", b"root:x:0 is a secret");
        let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: text\n\
                      data file: secret\n\n";
        let refused = read_image(&files.write("a.nhdr", header.as_bytes())).unwrap_err();
        let refused = refused.to_string();
        assert!(refused.contains("voxel (0, 0, 0) is not a number"), "{refused}");
        assert!(!refused.contains("root"), "{refused}");
    }

    #[test]
    fn a_small_file_may_not_ask_for_much_memory() {
        let files = Files::new();
        let header =
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1000 1000 700\nencoding: gzip\n\n";
        let mut file = header.as_bytes().to_vec();
        // More bytes than zeros would take: the promise is one that deflate could keep.
        file.resize(file.len() + 800_000, 1);
        let path = files.write("a.nrrd", &file);
        let error = read_image(&path).unwrap_err();
        assert!(matches!(error, Error::MemoryLimit(_)), "{error}");
        let error = error.to_string();
        assert!(error.contains("takes 1400000000 bytes") && error.contains("--max-read-bytes"));
        // With more allowed the file itself is the fault.
        let options = ReadOptions { max_bytes: Some(2 << 30), ..ReadOptions::default() };
        let error = read_image_with(&path, &options, &|_| Ok(())).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{error}");
        // Scans take twice as much.
        let small = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: raw\n\n\x01\x02";
        let path = files.write("b.nrrd", small);
        let options = ReadOptions { max_bytes: Some(4), ..ReadOptions::default() };
        assert!(read_image_with(&path, &options, &|_| Ok(())).is_ok());
        let error = values::read_gray(&path, &options, &|_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("takes 8 bytes"), "{error}");
    }

    #[test]
    fn reading_tells_how_far_it_is_and_ends_where_it_is_told_to() {
        let files = Files::new();
        let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 100 100 100\nencoding: raw\n\n";
        let path = files.write("a.nrrd", &[&header[..], &[1; 1_000_000]].concat());
        let parts = std::cell::RefCell::new(Vec::new());
        let watch = |part| {
            parts.borrow_mut().push(part);
            Ok(())
        };
        read_image_with(&path, &ReadOptions::default(), &watch).unwrap();
        let parts = parts.into_inner();
        assert!(parts.len() > 10 && parts.is_sorted(), "{parts:?}");
        assert!(parts[0] == 0.0 && parts[parts.len() - 1] > 0.9, "{parts:?}");
        let stop = |part| if part > 0.5 { Err(Error::Cancelled) } else { Ok(()) };
        let error = read_image_with(&path, &ReadOptions::default(), &stop).unwrap_err();
        assert!(matches!(error, Error::Cancelled), "{error}");
    }
}
