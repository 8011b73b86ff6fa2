//! Scans and probability maps from files: as [`super`], with real numbers instead of labels.
//!
//! Numbers of all types are read, scaled as the header says, and rounded to single precision. A
//! file may hold several volumes: a fourth axis (NIfTI, NRRD, MetaImage), or several values for
//! each voxel (NRRD, MetaImage, INR).

use std::path::Path;

use glam::DVec3;

use super::source::Access;
use super::voxels::read_values;
use super::{GoOn, Opened, ReadOptions, Volumes, open};
use crate::error::shown;
use crate::image::volume::reversed_axes;
use crate::image::{Frame, GrayImage, MapValues, ProbabilityImage, WorldAxes};
use crate::{Error, Result};

/// How far the places of the same voxel may be apart in two files, in voxels.
const SAME_PLACE: f64 = 1e-2;

/// What was read from one file or several.
#[derive(Clone, Debug)]
pub struct Read<T> {
    /// The image.
    pub image: T,
    /// What its world axes mean; `None` when the file does not say.
    pub world: Option<WorldAxes>,
    /// What a user should know, one line each.
    pub warnings: Vec<String>,
}

/// Reads a scan.
///
/// # Errors
/// Those of [`super::read_image_with`]; [`Error::Format`] for a file of several volumes, and for an
/// intensity that is not finite.
pub fn read_gray(path: &Path, options: &ReadOptions, go_on: &GoOn<'_>) -> Result<Read<GrayImage>> {
    let access = options.access(go_on, (0.0, 1.0));
    let Stack { dims, frame, mut volumes, world, warnings } = Stack::read(path, options, access)?;
    if volumes.len() != 1 {
        return Err(Error::format(
            path,
            format!("{} values per voxel, a gray image has one", volumes.len()),
        ));
    }
    let image = GrayImage::new(dims, frame, volumes.remove(0)).map_err(|e| of_file(path, e))?;
    Ok(Read { image, world, warnings })
}

/// Reads probability maps: all volumes of all files, in their order, which have the labels
/// `labels`, or 1, 2, ... without.
///
/// # Errors
/// Those of [`super::read_image_with`]; [`Error::InvalidArgument`] for no file, a label given
/// twice, and not as many labels as volumes; [`Error::Format`] for a file whose grid is not that of
/// the first, and for values that [`ProbabilityImage::new`] refuses.
pub fn read_probabilities(
    paths: &[&Path],
    labels: Option<&[i32]>,
    options: &ReadOptions,
    go_on: &GoOn<'_>,
) -> Result<Read<ProbabilityImage>> {
    read_maps(paths, MapValues::Probabilities, labels, options, go_on)
}

/// As [`read_probabilities`], maps whose values are those of `values`.
///
/// # Errors
/// Those of [`read_probabilities`].
pub fn read_maps(
    paths: &[&Path],
    values: MapValues,
    labels: Option<&[i32]>,
    options: &ReadOptions,
    go_on: &GoOn<'_>,
) -> Result<Read<ProbabilityImage>> {
    let Some((first, others)) = paths.split_first() else {
        return Err(Error::InvalidArgument("no file of probability maps is given".into()));
    };
    let share = 1.0 / paths.len() as f64;
    let mut all = Stack::read(first, options, options.access(go_on, (0.0, share)))?;
    // The file of each map.
    let mut files = vec![*first; all.volumes.len()];
    for (path, nth) in others.iter().zip(1..) {
        let access = options.access(go_on, (share * f64::from(nth), share));
        let stack = Stack::read(path, options, access)?;
        if stack.dims != all.dims {
            return Err(Error::format(
                path,
                format!(
                    "a grid of {:?} voxels, but {} has {:?}",
                    stack.dims,
                    shown(first),
                    all.dims
                ),
            ));
        }
        let far = DVec3::from(all.dims.map(|n| n as f64));
        for index in [DVec3::ZERO, far, far.with_x(0.0), far.with_y(0.0), far.with_z(0.0)] {
            let apart = all.frame.to_index(stack.frame.to_world(index)) - index;
            if apart.abs().max_element() > SAME_PLACE {
                let message = format!(
                    "another place in the world than {}: {apart} voxels apart",
                    shown(first)
                );
                return Err(Error::format(path, message));
            }
        }
        if let (Some(of_first), Some(world)) = (all.world, stack.world)
            && of_first != world
        {
            let message = format!(
                "its axes are {}, those of {} are {}: ask for one frame",
                world.name(),
                shown(first),
                of_first.name()
            );
            return Err(Error::format(path, message));
        }
        all.world = all.world.or(stack.world);
        files.resize(files.len() + stack.volumes.len(), *path);
        all.volumes.extend(stack.volumes);
        all.warnings.extend(stack.warnings);
    }
    let counted: Vec<i32> = (1..=all.volumes.len() as i32).collect();
    let labels = labels.unwrap_or(&counted);
    let of_map = |map: usize, error| of_file(files[map], error);
    let image =
        ProbabilityImage::with_source(all.dims, all.frame, values, all.volumes, labels, of_map)?;
    Ok(Read { image, world: all.world, warnings: all.warnings })
}

/// The volumes of one file.
struct Stack {
    dims: [usize; 3],
    frame: Frame,
    volumes: Vec<Vec<f32>>,
    world: Option<WorldAxes>,
    warnings: Vec<String>,
}

impl Stack {
    fn read(path: &Path, options: &ReadOptions, access: Access<'_>) -> Result<Self> {
        let Opened { mut source, layout, frame, world, is_reversed, mut warnings, .. } =
            open(path, Volumes::Many, options, access)?;
        let mut volumes = read_values(&mut source, &layout, &mut warnings)?;
        let mut dims = layout.dims;
        if is_reversed {
            for volume in &mut volumes {
                *volume = reversed_axes(volume, dims)?;
            }
            dims.reverse();
        }
        Ok(Self { dims, frame, volumes, world, warnings })
    }
}

/// The error names the file.
fn of_file(path: &Path, error: Error) -> Error {
    match error {
        Error::InvalidArgument(message) => Error::format(path, message),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Files;
    use super::*;

    const VALUES: [f32; 12] = [0.0, 0.5, 0.25, 1.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.0, 1.0, 0.5];

    fn bytes() -> Vec<u8> {
        VALUES.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    /// The same two volumes of 3 x 2 x 1 voxels, one after the other or voxel by voxel.
    fn stacks() -> Vec<(&'static str, Vec<u8>)> {
        let side_by_side: Vec<u8> =
            (0..6).flat_map(|n| [VALUES[n], VALUES[n + 6]]).flat_map(f32::to_le_bytes).collect();
        let nrrd = |lines: &str, data: &[u8]| {
            let head = format!(
                "NRRD0004\ntype: float\ndimension: 4\nencoding: raw\nendian: little\n{lines}\n\n"
            );
            [head.as_bytes(), data].concat()
        };
        let mha = |lines: &str, data: &[u8]| {
            let head = format!(
                "ObjectType = Image\n{lines}\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n"
            );
            [head.as_bytes(), data].concat()
        };
        let mut inr =
            b"#INRIMAGE-4#{\nXDIM=3\nYDIM=2\nZDIM=1\nVDIM=2\nTYPE=float\nPIXSIZE=32 bits\nCPU=pc\n"
                .to_vec();
        inr.resize(252, b'\n');
        inr.extend(b"##}\n");
        inr.extend(&side_by_side);
        let mut nifti = vec![0; 352];
        let mut put = |at: usize, bytes: &[u8]| nifti[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &348_i32.to_le_bytes());
        put(344, b"n+1\0");
        for (n, dim) in [4_i16, 3, 2, 1, 2].into_iter().enumerate() {
            put(40 + 2 * n, &dim.to_le_bytes());
        }
        put(70, &16_i16.to_le_bytes());
        put(72, &32_i16.to_le_bytes());
        for n in 0..4 {
            put(76 + 4 * n, &1.0_f32.to_le_bytes());
        }
        put(108, &352.0_f32.to_le_bytes());
        nifti.extend(bytes());
        vec![
            (
                "a.nrrd",
                nrrd(
                    "sizes: 3 2 1 2\nspacings: 1 1 1 1\nkinds: domain domain domain list",
                    &bytes(),
                ),
            ),
            (
                "a.nrrd",
                nrrd(
                    "sizes: 3 2 1 2\nspacings: 1 1 1 1\nkinds: domain domain domain ???",
                    &bytes(),
                ),
            ),
            (
                "a.nrrd",
                nrrd(
                    "sizes: 2 3 2 1\nspacings: 1 1 1 1\nkinds: vector domain domain domain",
                    &side_by_side,
                ),
            ),
            ("a.mha", mha("NDims = 4\nDimSize = 3 2 1 2\nElementSpacing = 1 1 1 1", &bytes())),
            (
                "a.mha",
                mha(
                    "NDims = 3\nDimSize = 3 2 1\nElementNumberOfChannels = 2\nElementSpacing = 1 1 \
                     1",
                    &side_by_side,
                ),
            ),
            ("a.inr", inr),
            ("a.nii", nifti),
        ]
    }

    fn stack(path: &Path) -> Result<Stack> {
        let options = ReadOptions::default();
        Stack::read(path, &options, options.access(&|_| Ok(()), (0.0, 1.0)))
    }

    #[test]
    fn volumes_of_every_format_and_order() {
        let files = Files::new();
        for (name, file) in stacks() {
            let path = files.write(name, &file);
            let stack = stack(&path).unwrap();
            let head = String::from_utf8_lossy(&file[..file.len() - 48]).into_owned();
            assert_eq!((stack.dims, stack.volumes.len()), ([3, 2, 1], 2), "{head}");
            assert_eq!(stack.volumes.concat(), VALUES, "{head}");
            let read =
                read_probabilities(&[&path], Some(&[4, 0]), &ReadOptions::default(), &|_| Ok(()))
                    .unwrap();
            assert_eq!(read.image.label_image().unwrap().label_at([1, 0, 0]), Some(4));
            let message =
                read_gray(&path, &ReadOptions::default(), &|_| Ok(())).unwrap_err().to_string();
            assert!(message.ends_with("2 values per voxel, a gray image has one"), "{message}");
            assert!(super::super::read_image(&path).is_err(), "labels of {head}");
        }
    }

    fn text(files: &Files, name: &str, lines: &str, values: &str) -> std::path::PathBuf {
        let file = format!(
            "NRRD0004\ntype: double\ndimension: 3\nsizes: 2 1 1\nspacings: 1 1 1\nencoding: \
             text\n{lines}\n{values}"
        );
        files.write(name, file.as_bytes())
    }

    #[test]
    fn errors_name_the_file_and_the_value() {
        let files = Files::new();
        let options = ReadOptions::default();
        let good = text(&files, "good.nrrd", "", "0.5 1");
        assert_eq!(read_gray(&good, &options, &|_| Ok(())).unwrap().image.voxels(), [0.5, 1.0]);
        let nan = text(&files, "nan.nrrd", "", "0.5 nan");
        let message = read_gray(&nan, &options, &|_| Ok(())).unwrap_err().to_string();
        assert!(
            message.ends_with("nan.nrrd: intensity of voxel [1, 0, 0] is NaN; it must be finite"),
            "{message}"
        );
        let message = |paths: &[&Path], labels: Option<&[i32]>| {
            read_probabilities(paths, labels, &options, &|_| Ok(())).unwrap_err().to_string()
        };
        assert_eq!(message(&[], None), "no file of probability maps is given");
        assert_eq!(
            message(&[&good, &good], Some(&[1, 1])),
            "two probability maps are given for label 1"
        );
        assert_eq!(
            message(&[&good], Some(&[4, -4])),
            "as many probability maps as labels are needed, at least one: got 1 and 2"
        );
        assert_eq!(
            message(&[&good, &good], Some(&[])),
            "as many probability maps as labels are needed, at least one: got 2 and 0"
        );
        let invalid = |paths: &[&Path], labels: &[i32]| {
            matches!(
                read_probabilities(paths, Some(labels), &options, &|_| Ok(())),
                Err(Error::InvalidArgument(_))
            )
        };
        assert!(
            invalid(&[&good], &[4, -4])
                && invalid(&[&good, &good], &[5])
                && invalid(&[&good, &good], &[5, 5])
        );
        // What a file holds is the file's fault, whichever it is.
        let high = text(&files, "high.nrrd", "", "0.5 2");
        for bad in [&nan, &high] {
            let error =
                read_probabilities(&[&good, bad, &good], Some(&[1, 12, 2]), &options, &|_| Ok(()))
                    .unwrap_err();
            let named = error
                .to_string()
                .starts_with(&format!("{}: the probability of label 12 of", bad.display()));
            assert!(matches!(error, Error::Format { .. }) && named, "{error:?}");
        }
        let elsewhere =
            text(&files, "elsewhere.nrrd", "space dimension: 3\nspace origin: (1,0,0)\n", "0.5 1");
        assert!(
            message(&[&good, &elsewhere], None)
                .contains("elsewhere.nrrd: another place in the world than")
        );
        let tilted = |name: &str, space: &str| {
            text(&files, name, &format!("space: {space}\nspace origin: (0,0,0)\n"), "0.5 1")
        };
        let (lps, ras) = (tilted("lps.nrrd", "LPS"), tilted("ras.nrrd", "RAS"));
        assert!(message(&[&lps, &ras], None).ends_with("lps.nrrd are LPS: ask for one frame"));
        let known = read_probabilities(&[&good, &ras], None, &options, &|_| Ok(())).unwrap();
        assert_eq!(known.world, Some(WorldAxes::Ras));
        let larger = files.write(
            "larger.nrrd",
            b"NRRD0004\ntype: double\ndimension: 3\nsizes: 3 1 1\nencoding: text\n\n0 0 0",
        );
        assert!(
            message(&[&good, &larger], None)
                .contains("larger.nrrd: a grid of [3, 1, 1] voxels, but")
        );
    }

    #[test]
    fn scales_of_headers_count() {
        let files = Files::new();
        let (_, mut nifti) = stacks().pop().unwrap();
        nifti[112..116].copy_from_slice(&2.0_f32.to_le_bytes());
        nifti[116..120].copy_from_slice(&(-1.0_f32).to_le_bytes());
        let stack = stack(&files.write("a.nii", &nifti)).unwrap();
        assert_eq!(stack.volumes.concat(), VALUES.map(|v| 2.0 * v - 1.0));
    }
}
