//! The readers over real and hostile files, and over random damage to valid ones.
//!
//! The files are those of `shared/images` beside the checkout, or of the folder that `LAPD_IMAGES`
//! names.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::DVec3;
use lapd::image::{LabelImage, WorldAxes};
use lapd::io::read::{LabelValues, ReadImage, ReadOptions, read_image, read_image_with};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

/// The folder of images, or `None`, said loudly.
fn images(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LAPD_IMAGES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"),
        PathBuf::from,
    );
    if folder.is_dir() {
        Some(folder)
    } else {
        eprintln!("SKIPPED: {test}: no folder {}", folder.display());
        None
    }
}

fn read(path: &Path) -> ReadImage {
    read_image(path).unwrap_or_else(|e| panic!("{e}"))
}

/// Small files that show faults, each of a kind.
#[test]
fn cases_are_read_as_expected() {
    let Some(folder) = images("cases_are_read_as_expected").map(|folder| folder.join("cases"))
    else {
        return;
    };
    let rounded = |name: &str| {
        read_image_with(
            &folder.join(name),
            &ReadOptions { values: LabelValues::Rounded, ..ReadOptions::default() },
            &|_| Ok(()),
        )
    };
    let nearly = read(&folder.join("near_int_slope.nii.gz"));
    assert!(
        nearly.warnings.iter().any(|warning| warning.contains("were rounded; the first, voxel ("))
    );
    let refused = read_image(&folder.join("near_int_petprep.nii.gz")).unwrap_err().to_string();
    assert!(refused.contains("7000.97") && refused.contains("--round"), "{refused}");
    assert!(rounded("near_int_petprep.nii.gz").unwrap().image.labels().contains(&7001));
    let refused = read_image(&folder.join("half_labels.nii.gz")).unwrap_err().to_string();
    assert!(refused.contains("42.5: labels must be whole numbers; --round"), "{refused}");
    let mapped = |name: &str| {
        let options = ReadOptions { values: LabelValues::Distinct, ..ReadOptions::default() };
        let read = read_image_with(&folder.join(name), &options, &|_| Ok(())).unwrap();
        assert!(read.warnings[0].contains("distinct values became labels"), "{:?}", read.warnings);
        assert!(read.image.labels().iter().copied().eq(0..=read.values.len() as i32));
        read.values
    };
    assert_eq!(mapped("half_labels.nii.gz"), ["42.5", "85"]);
    let ids: Vec<u64> = mapped("ids64.nii.gz").iter().map(|text| text.parse().unwrap()).collect();
    assert!(ids.is_sorted() && ids.iter().any(|&id| id > 1 << 31), "{ids:?}");
    let refused = read_image(&folder.join("ids64.nii.gz")).unwrap_err().to_string();
    assert!(refused.contains("--map (LAPD_LABELS_DISTINCT)"), "{refused}");
    let halves = rounded("half_labels.nii.gz").unwrap();
    assert_eq!(halves.image.labels(), [0, 43, 85]);
    assert!(read(&folder.join("gzip_zero_tail.nii.gz")).warnings.is_empty());
    let sheared = read(&folder.join("shear_sform.nii.gz"));
    assert!(
        sheared.warnings.iter().any(|warning| warning.starts_with("the qform is taken, for sform"))
    );
    let by_ends = read(&folder.join("axis_mins.nrrd"));
    assert_eq!(by_ends.image.frame().spacing(), DVec3::new(2.0, 1.5, 1.0));
    assert_eq!(by_ends.image.frame().origin(), DVec3::new(-20.0, 5.0, 3.0));
    assert!(by_ends.warnings.is_empty(), "{:?}", by_ends.warnings);
}

/// Layers of a segmentation of 3D Slicer: each segment a label, that of the last layer where
/// several are.
#[test]
fn layers_of_segments_are_labels() {
    let Some(folder) = images("layers_of_segments_are_labels").map(|folder| folder.join("cases"))
    else {
        return;
    };
    for name in ["layers_plain.seg.nrrd", "layers_multi.seg.nrrd"] {
        let found = read(&folder.join(name));
        println!("{name}: {:?} {:?}", found.image.labels(), found.warnings);
        assert_eq!(
            (found.image.dims(), found.world),
            ([24, 20, 16], Some(WorldAxes::Lps)),
            "{name}"
        );
        let (labels, told) = match name {
            "layers_plain.seg.nrrd" => (
                [0, 1, 2],
                "segments of several layers have the same value, so they are numbered: 1 liver, 2 \
                 tumor",
            ),
            // The header names no segment of values 2 and 3; what has value 1 lies in segment 3 as
            // a whole.
            _ => ([0, 2, 3], "there are segments that the header does not name: "),
        };
        assert_eq!(found.image.labels(), labels, "{name}");
        assert!(
            found.warnings.iter().any(|warning| warning.starts_with(told)),
            "{:?}",
            found.warnings
        );
    }
}

/// Random segments in random layers against their definition.
#[test]
fn random_layers_are_combined_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.seg.nrrd");
    // For each segment its layer and value, and for each voxel and layer a value; some belong to no
    // segment.
    let segments = prop::collection::vec((0..3_usize, 1..4_i32), 1..6);
    let values = prop::collection::vec(0..4_u8, 3 * 60);
    // None for the order of the file.
    let orders = prop::option::of(Just(vec![0, 1, 2]).prop_shuffle());
    TestRunner::default()
        .run(
            &(segments, values, prop::bool::ANY, orders),
            |(mut segments, values, distinct, order)| {
                if distinct {
                    segments.iter_mut().zip(1..).for_each(|(segment, n)| segment.1 = n);
                } else {
                    segments.sort_unstable();
                    segments.dedup();
                }
                let pairs: String = segments
                    .iter()
                    .enumerate()
                    .map(|(n, (layer, value))| {
                        format!(
                            "Segment{n}_Name:=organ: {n}\nSegment{n}_LabelValue:={value}\n\
                         Segment{n}_Layer:={layer}\n"
                        )
                    })
                    .collect();
                let head = "NRRD0005\ntype: uint8\ndimension: 4\nspace: LPS\nsizes: 3 3 4 5\n\
                        space directions: none (1,0,0) (0,1,0) (0,0,1)\n\
                        kinds: list domain domain domain\n\
                        encoding: raw\n";
                let file = [head.as_bytes(), pairs.as_bytes(), b"\n", &values].concat();
                std::fs::write(&path, file).unwrap();
                // All that occur, first those of the header.
                let named = segments.len();
                let occurring = values.iter().enumerate().filter(|&(_, &value)| value != 0);
                let occurring: Vec<(usize, i32)> =
                    occurring.map(|(n, &value)| (n % 3, i32::from(value))).collect();
                for segment in &occurring {
                    if !segments.contains(segment) {
                        segments.push(*segment);
                    }
                }
                let mut of_segments: Vec<i32> = segments
                    .iter()
                    .filter(|segment| occurring.contains(segment))
                    .map(|segment| segment.1)
                    .collect();
                let count = of_segments.len();
                of_segments.sort_unstable();
                of_segments.dedup();
                let differ = of_segments.len() == count;
                let mut overlapping = 0;
                let wanted: Vec<i32> = values
                    .chunks(3)
                    .map(|layers| {
                        let (mut label, mut count) = (0, 0);
                        let in_order = order.clone().unwrap_or_else(|| vec![0, 1, 2]).into_iter();
                        for (layer, value) in
                            in_order.map(|layer| (layer, layers[layer])).filter(|&(_, v)| v != 0)
                        {
                            let n = segments
                                .iter()
                                .position(|&segment| segment == (layer, i32::from(value)))
                                .unwrap();
                            (label, count) =
                                (if differ { segments[n].1 } else { n as i32 + 1 }, count + 1);
                        }
                        overlapping += u32::from(count > 1);
                        label
                    })
                    .collect();
                let options = ReadOptions { layer_order: order.clone(), ..ReadOptions::default() };
                let found = read_image_with(&path, &options, &|_| Ok(())).unwrap();
                let labels = found.image.labels();
                let got: Vec<i32> =
                    found.image.ids().iter().map(|&id| labels[usize::from(id)]).collect();
                prop_assert_eq!(got, wanted);
                for (n, segment) in segments.iter().enumerate() {
                    let label = if differ { segment.1 } else { n as i32 + 1 };
                    let name = found.names.get(label).map(|name| name.name.clone());
                    let known = n < named && occurring.contains(segment);
                    let wanted = known.then(|| format!("organ: {n}"));
                    prop_assert!(name == wanted || differ && !known, "{name:?}");
                }
                let told =
                    |start: &str| found.warnings.iter().any(|warning| warning.starts_with(start));
                prop_assert_eq!(told("segments of several layers"), !differ);
                let overlap = format!("{overlapping} voxels are in several segments");
                prop_assert_eq!(told(&overlap), overlapping > 0);
                prop_assert_eq!(
                    told(
                        "there are segments that the \
                header"
                    ),
                    differ && segments.len() > named
                );
                Ok(())
            },
        )
        .unwrap();
}

/// An order of layers names each of them once; images without layers have none, and their values
/// are not mapped.
#[test]
fn orders_of_layers_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let head = "NRRD0005\ntype: uint8\nencoding: text\n";
    let named = "Segment0_Name:=skull\nSegment0_LabelValue:=7\nSegment0_Layer:=0\n";
    let one = write("one.seg.nrrd", &format!("{head}dimension: 3\nsizes: 2 1 1\n{named}\n0 7\n"));
    let two = format!(
        "{head}dimension: 4\nsizes: 2 2 1 1\nkinds: list domain domain domain\n{named}\n7 3 7 0\n"
    );
    let two = write("two.seg.nrrd", &two);
    let read = |path: &Path, order: Option<&[usize]>, values| {
        let layer_order = order.map(<[usize]>::to_vec);
        read_image_with(
            path,
            &ReadOptions { layer_order, values, ..ReadOptions::default() },
            &|_| Ok(()),
        )
    };
    let error = |path: &Path, order: Option<&[usize]>, values| {
        read(path, order, values).unwrap_err().to_string()
    };
    let labels = |order: &[usize]| {
        read(&two, Some(order), LabelValues::Whole).unwrap().image.labels().to_vec()
    };
    assert_eq!((labels(&[0, 1]), labels(&[1, 0])), (vec![0, 3, 7], vec![0, 7]));
    for order in [&[][..], &[0], &[0, 0], &[1, 2], &[0, 1, 2]] {
        let message = error(&two, Some(order), LabelValues::Whole);
        assert!(message.ends_with("must name each layer, 0 to 1, once"), "{message}");
    }
    let message = error(&one, Some(&[0]), LabelValues::Whole);
    assert!(
        message.contains("an order of layers is for segmentations of several layers"),
        "{message}"
    );
    let message = error(&two, None, LabelValues::Distinct);
    assert!(
        message.contains("distinct values are numbered where voxels have one value each"),
        "{message}"
    );
    let named = read(&one, None, LabelValues::Whole).unwrap().names;
    let named: Vec<_> = named.iter().map(|(label, name)| (label, &*name.name)).collect();
    assert_eq!(named, [(7, "skull")]);
    let mapped = read(&one, None, LabelValues::Distinct).unwrap();
    assert_eq!((mapped.image.labels(), &mapped.values[..]), (&[0, 1][..], &["7".to_string()][..]));
}

/// A volume of 3 x 4 x 5 numbers as text, which all have the same label but one.
fn text_volume(numbers: &[f64]) -> String {
    let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:?}")).collect();
    format!(
        "NRRD0004\ntype: double\ndimension: 3\nsizes: 3 4 5\nencoding: text\n\n{}\n",
        numbers.join(" ")
    )
}

/// Numbers within 1e-3 of whole ones become these, with one warning that counts them; others on
/// request only.
#[test]
fn numbers_that_are_not_quite_whole_are_rounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let numbers =
        prop::collection::vec((-9..9_i32, -0.0011..0.0011_f64, prop::bool::weighted(0.3)), 60);
    TestRunner::default()
        .run(&numbers, |numbers| {
            let off = |&(_, off, is_off): &(i32, f64, bool)| if is_off { off } else { 0.0 };
            let values: Vec<f64> = numbers.iter().map(|n| f64::from(n.0) + off(n)).collect();
            std::fs::write(&path, text_volume(&values)).unwrap();
            let is_far = |x: &f64| (x - x.round()).abs() > 1e-3;
            let labels = |read: &ReadImage| {
                read.image
                    .ids()
                    .iter()
                    .map(|&id| read.image.labels()[usize::from(id)])
                    .collect::<Vec<_>>()
            };
            let wanted: Vec<i32> = values.iter().map(|x| x.round() as i32).collect();
            let count = values.iter().filter(|&&x| x != x.round()).count();
            let check = |read: ReadImage| {
                assert_eq!(labels(&read), wanted);
                let told =
                    read.warnings.iter().filter(|warning| warning.contains("were rounded")).count();
                assert_eq!(told, usize::from(count > 0));
                assert!(
                    count == 0
                        || read
                            .warnings
                            .iter()
                            .any(|warning| warning.starts_with(&format!("{count} voxels")))
                );
            };
            match read_image(&path) {
                Ok(read) if !values.iter().any(is_far) => check(read),
                Err(error) if values.iter().any(is_far) => {
                    assert!(error.to_string().contains("--round"))
                }
                other => panic!("{other:?}"),
            }
            check(
                read_image_with(
                    &path,
                    &ReadOptions { values: LabelValues::Rounded, ..ReadOptions::default() },
                    &|_| Ok(()),
                )
                .unwrap(),
            );
            Ok(())
        })
        .unwrap();
}

/// What is no number, or no label, stays refused whatever is asked for.
#[test]
fn rounding_takes_no_number_that_is_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    for (value, why) in [
        (f64::NAN, "must be numbers"),
        (f64::INFINITY, "must be numbers"),
        (2_147_483_648.0, "must fit a 32-bit"),
        (-2_147_483_648.7, "must fit a 32-bit"),
        (1e300, "must fit a 32-bit"),
    ] {
        let mut values = [1.0; 60];
        values[7] = value;
        std::fs::write(&path, text_volume(&values)).unwrap();
        let error = read_image_with(
            &path,
            &ReadOptions { values: LabelValues::Rounded, ..ReadOptions::default() },
            &|_| Ok(()),
        )
        .unwrap_err();
        assert!(error.to_string().contains(why), "{error}");
    }
}

/// Zeros after the members of a gzip file are ignored, as gzip does; anything else there is damage.
#[test]
fn zeros_after_a_gzip_member_are_ignored() {
    let plain =
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 3 4\nspacings: 1 1 1\nencoding: gzip\n\n"
            .as_bytes();
    let gzip = |bytes: &[u8]| {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut encoder, bytes).unwrap();
        encoder.finish().unwrap()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let members = [gzip(&[1; 10]), gzip(&[2; 14])].concat();
    for zeros in [0, 1, 2, 511, 65_536, 200_000] {
        std::fs::write(&path, [plain, &members, &vec![0; zeros]].concat()).unwrap();
        let found = read(&path);
        assert_eq!((found.image.labels(), found.warnings.len()), (&[0, 1, 2][..], 0), "{zeros}");
        // Zeros between members, too.
        std::fs::write(&path, [plain, &gzip(&[1; 10]), &vec![0; zeros], &gzip(&[2; 14])].concat())
            .unwrap();
        assert_eq!(read(&path).image.labels(), [0, 1, 2]);
        std::fs::write(&path, [plain, &members, &vec![0; zeros], b"no gzip member"].concat())
            .unwrap();
        assert!(read_image(&path).unwrap_err().to_string().contains("damaged"), "{zeros}");
    }
}

/// `axis mins` and `axis maxs` tell the place of voxels where nothing else does.
#[test]
fn the_ends_of_axes_tell_their_spacing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let numbers = ((1..9_u32, 1..9_u32, 1..9_u32), prop::array::uniform3(-50.0..50.0_f64));
    TestRunner::default()
        .run(
            &(numbers, prop::array::uniform3(0.1..5.0_f64), prop::bool::ANY),
            |(((x, y, z), from), spacing, node)| {
                let sizes = [x, y, z].map(|n| n + u32::from(node));
                let ends =
                    [0, 1, 2].map(|a| from[a] + spacing[a] * f64::from(sizes[a] - u32::from(node)));
                let list = |values: [f64; 3]| format!("{} {} {}", values[0], values[1], values[2]);
                let center = if node { "node" } else { "cell" };
                let header = format!(
                    "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {} {} {}\nencoding: raw\n\
                 axis mins: {}\naxis maxs: {}\n\
                 centers: {center} {center} {center}\n\n",
                    sizes[0],
                    sizes[1],
                    sizes[2],
                    list(from),
                    list(ends)
                );
                let count = sizes.iter().product::<u32>() as usize;
                std::fs::write(&path, [header.as_bytes(), &vec![1; count]].concat()).unwrap();
                let found = read(&path);
                let first =
                    DVec3::from(from) + if node { DVec3::ZERO } else { DVec3::from(spacing) * 0.5 };
                prop_assert!(
                    (found.image.frame().spacing() - DVec3::from(spacing)).abs().max_element()
                        < 1e-9
                );
                prop_assert!((found.image.frame().origin() - first).abs().max_element() < 1e-9);
                prop_assert!(found.warnings.is_empty());
                Ok(())
            },
        )
        .unwrap();
}

/// Labels without 0.
fn label_count(image: &LabelImage) -> usize {
    image.labels().len() - 1
}

#[test]
fn atlases_have_their_labels_and_places() {
    let Some(folder) = images("atlases_have_their_labels_and_places") else { return };
    let brain = read(&folder.join("spl/brain.nrrd"));
    assert_eq!((brain.image.dims(), label_count(&brain.image)), ([256; 3], 312));
    assert_eq!(brain.world, Some(WorldAxes::Lps));
    assert!(brain.warnings.is_empty(), "{:?}", brain.warnings);
    let frame = brain.image.frame();
    assert_eq!((frame.origin(), frame.spacing()), (DVec3::new(-128.0, -128.0, 128.0), DVec3::ONE));
    assert_eq!(frame.direction().to_cols_array(), [0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0]);

    let abdomen = read(&folder.join("spl/abdomen.nrrd"));
    assert_eq!((abdomen.image.dims(), label_count(&abdomen.image)), ([256, 256, 113], 95));
    let frame = abdomen.image.frame();
    assert!((frame.spacing() - DVec3::new(0.9375, 0.9375, 1.5)).length() < 1e-12);
    assert_eq!(frame.direction().to_cols_array(), [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]);

    let small = read(&folder.join("formats/abdomen_3mm.nii.gz"));
    assert_eq!((small.image.dims(), label_count(&small.image)), ([122, 101, 30], 41));
    assert_eq!(
        (small.image.frame().spacing(), small.world),
        (DVec3::splat(3.0), Some(WorldAxes::Ras))
    );
}

#[test]
fn all_forms_of_the_ball_hold_the_same_voxels() {
    let Some(folder) = images("all_forms_of_the_ball_hold_the_same_voxels") else { return };
    let folder = folder.join("formats");
    let reference = read(&folder.join("BallBinary30x30x30.nrrd")).image;
    assert_eq!(label_count(&reference), 1);
    for name in [
        "BallBinary30x30x30.nhdr",
        "BallBinary30x30x30_gz.nrrd",
        "BallBinary30x30x30_gz_lineskip.nrrd",
    ] {
        let other = read(&folder.join(name));
        assert!(other.image == reference, "{name}");
        assert!(other.warnings.is_empty(), "{name}: {:?}", other.warnings);
    }
    let nifti = read(&folder.join("BallBinary30x30x30.nii.gz"));
    assert!(nifti.image.ids() == reference.ids());
    // Four bytes are said to follow the voxels, and the file has none to spare.
    let message = read_image(&folder.join("BallBinary30x30x30_byteskip_minus_five.nhdr"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("54004 bytes are to be found at the end of the data, which has 54000"),
        "{message}"
    );
}

#[test]
fn awkward_files_give_an_image_or_one_clear_line() {
    let Some(folder) = images("awkward_files_give_an_image_or_one_clear_line") else { return };
    let table: [(&str, std::result::Result<&[i32], &str>); 19] = [
        ("empty.nrrd", Err("the file is empty")),
        (
            "inr_truncated.inr",
            Err("438 x 353 x 165 voxels need 25511310 bytes, the file can hold 3840"),
        ),
        ("lfs_pointer.inr", Err("Git LFS pointer")),
        ("nifti_all_background.nii.gz", Ok(&[0])),
        ("nifti_bad_magic.nii.gz", Err(r"magic is 'xxx\x00'")),
        ("nifti_checkerboard.nii.gz", Ok(&[0, 1])),
        ("nifti_dim0_is_0.nii.gz", Err("dim[0], the number of dimensions, is 0")),
        ("nifti_float_nonintegral_labels.nii.gz", Err("labels must be whole numbers")),
        ("nifti_gz_truncated.nii.gz", Err("cut off")),
        // The file stores 255 where its maker had -1.
        ("nifti_negative_label.nii.gz", Ok(&[0, 1, 2, 255])),
        ("nifti_pixdim_zero.nii.gz", Ok(&[0, 1, 2])),
        ("nifti_sform_singular.nii.gz", Err("sform is singular")),
        ("nifti_single_slice.nii.gz", Ok(&[0, 1, 2])),
        ("nifti_vox_offset_past_end.nii.gz", Err("vox_offset 1000000000 lies past the end")),
        ("nrrd_dimension_mismatch.nrrd", Err("'sizes' must give 4 number(s), got 3")),
        ("nrrd_header_only.nrrd", Err("need 54000 bytes, the file can hold 0")),
        ("nrrd_sizes_overflow.nrrd", Err("too large")),
        ("nrrd_unknown_encoding.nrrd", Err("'encoding: lzma'")),
        ("ok.nii.gz", Ok(&[0, 1, 2])),
    ];
    let mut failures = Vec::new();
    for (name, expected) in &table {
        let start = Instant::now();
        let found = read_image(&folder.join("awkward").join(name)).map_err(|e| e.to_string());
        let time = start.elapsed();
        let agrees = match (&found, expected) {
            (Ok(read), Ok(labels)) => read.image.labels() == *labels,
            (Err(message), Err(part)) => {
                message.contains(part) && !message.contains('\n') && message.contains(name)
            }
            _ => false,
        };
        if !agrees || time > Duration::from_millis(500) {
            let found = found.map(|r| format!("{:?} {:?}", r.image.labels(), r.warnings));
            failures.push(format!("{name}: expected {expected:?}, got {found:?} in {time:?}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    let listed = std::fs::read_dir(folder.join("awkward")).unwrap().count();
    assert_eq!(listed, table.len(), "every awkward file is in the table");
    assert!(!read(&folder.join("awkward/nifti_pixdim_zero.nii.gz")).warnings.is_empty());
}

/// A small valid file of each format: name and bytes.
fn valid_files() -> Vec<(&'static str, Vec<u8>)> {
    let text = |header: &str, data: &[u8]| [header.as_bytes(), data].concat();
    let data = [0_u8, 1, 2, 2, 1, 0, 0, 3];
    let mut nifti = vec![0_u8; 352];
    nifti[0..4].copy_from_slice(&348_i32.to_le_bytes());
    for (i, n) in [3_i16, 2, 2, 2, 1].iter().enumerate() {
        nifti[40 + 2 * i..42 + 2 * i].copy_from_slice(&n.to_le_bytes());
    }
    nifti[70] = 2;
    nifti[72] = 8;
    for i in 0..4 {
        nifti[76 + 4 * i..80 + 4 * i].copy_from_slice(&1_f32.to_le_bytes());
    }
    nifti[108..112].copy_from_slice(&352_f32.to_le_bytes());
    nifti[252] = 1;
    nifti[344..348].copy_from_slice(b"n+1\0");
    nifti.extend(data);
    let mut gzipped = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut gzipped, &data).unwrap();
    let gzipped = gzipped.finish().unwrap();
    let mut inr = "#INRIMAGE-4#{\nXDIM=2\nYDIM=2\nZDIM=2\nVDIM=1\nTYPE=unsigned fixed\nPIXSIZE=8 \
     bits\nCPU=decm\nVX=1\nVY=1\nVZ=1\n"
        .to_owned();
    inr.extend(std::iter::repeat_n('\n', 252 - inr.len()));
    inr.push_str("##}\n");
    let nrrd = "NRRD0004\ntype: uchar\ndimension: 3\nspace: LPS\nsizes: 2 2 2\nspace directions: \
     (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n";
    let meta = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementSpacing = 1 1 \
     1\nOffset = 0 0 0\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n";
    vec![
        ("a.nrrd", text(&format!("{nrrd}byte skip: -1\nencoding: raw\n\n"), &data)),
        ("b.nrrd", text(&format!("{nrrd}line skip: 0\nencoding: gzip\n\n"), &gzipped)),
        ("c.nrrd", text(&format!("{nrrd}encoding: text\n\n"), b"0 1 2 2 1 0 0 3")),
        ("d.nii", nifti),
        ("e.mha", text(&format!("{meta}ElementDataFile = LOCAL\n"), &data)),
        (
            "f.mha",
            text(&format!("{meta}CompressedData = True\nElementDataFile = LOCAL\n"), &gzipped),
        ),
        ("g.inr", text(&inr, &data)),
    ]
}

#[test]
fn the_valid_files_are_valid_and_none_may_be_cut() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in valid_files() {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let image = read(&path).image;
        assert_eq!(image.ids(), [0, 1, 2, 2, 1, 0, 0, 3], "{name}");
        for length in 0..bytes.len() {
            // A new file: truncating one makes some file systems wait for the disk.
            std::fs::remove_file(&path).unwrap();
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(
                read_image(&path).is_err(),
                "{name} cut to {length} of {} bytes is read",
                bytes.len()
            );
        }
    }
}

/// Damage: at a place (as a part of the file), what is put there.
#[derive(Clone, Debug)]
enum Damage {
    Byte(u8),
    Insert(String),
    Remove(usize),
    Repeat(usize),
}

fn damages() -> impl Strategy<Value = Vec<(f64, Damage)>> {
    let words = prop_oneof![
        Just("99999999999999999999"),
        Just("4294967296"),
        Just("-1"),
        Just("nan"),
        Just("1e308"),
        Just("\n"),
        Just("\n\n"),
        Just("0"),
        Just("("),
        Just(":"),
        Just("="),
        Just("\u{fffd}"),
        Just("%"),
        Just(" 1")
    ];
    let damage = prop_oneof![
        any::<u8>().prop_map(Damage::Byte),
        words.prop_map(|word| Damage::Insert(word.to_owned())),
        (1..12_usize).prop_map(Damage::Remove),
        (1..40_usize).prop_map(Damage::Repeat),
    ];
    prop::collection::vec((0.0..1.0, damage), 1..5)
}

/// Whatever the damage: an image with as many voxels as its dims say, or one line.
#[test]
fn damaged_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let config =
        ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() };
    let result = TestRunner::new(config).run(&(0..7_usize, damages()), |(which, damages)| {
        let (name, bytes) = valid_files().swap_remove(which);
        let path = folder.path().join(name);
        std::fs::write(&path, damaged(bytes, damages)).unwrap();
        let read = read_image(&path);
        std::fs::remove_file(&path).unwrap();
        match read {
            Ok(read) => {
                prop_assert_eq!(read.image.ids().len(), read.image.dims().iter().product::<usize>())
            }
            Err(e) => prop_assert!(!e.to_string().contains('\n'), "{}", e),
        }
        Ok(())
    });
    result.unwrap_or_else(|e| panic!("{e}"));
}

fn damaged(mut bytes: Vec<u8>, damages: Vec<(f64, Damage)>) -> Vec<u8> {
    for (place, damage) in damages {
        let at = (place * bytes.len() as f64) as usize;
        let piece = |n: usize| at..(at + n).min(bytes.len());
        match damage {
            Damage::Byte(byte) => {
                bytes.splice(piece(1), [byte]);
            }
            Damage::Insert(word) => {
                bytes.splice(at..at, word.into_bytes());
            }
            Damage::Remove(n) => {
                bytes.drain(piece(n));
            }
            Damage::Repeat(n) => {
                let again = bytes[piece(n)].to_vec();
                bytes.splice(at..at, again);
            }
        }
    }
    bytes
}
