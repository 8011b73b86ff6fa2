//! Small inputs that show faults, each of a kind: the files of `shared/images/cases` beside the
//! checkout, or of the folder that `LAPD_IMAGES` names.

use std::path::{Path, PathBuf};
use std::time::Instant;

use lapd::image::{LabelImage, MapValues, WorldAxes};
use lapd::io::read::values::{read_gray, read_maps, read_probabilities};
use lapd::io::read::{ReadOptions, read_image};
use lapd::io::write::{WriteOptions, write_mesh_watching};
use lapd::mesh::TetMesh;
use lapd::monitor::{Level, Monitor};
use lapd::params::{CertificateLevel, ImageBorder, MeshParams};
use lapd::pipeline::mesh_image;
use lapd::verify::certificate::{DefectKind, SmallLost};

/// A case's file, or `None`, said loudly.
fn case(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LAPD_IMAGES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"),
        PathBuf::from,
    );
    let path = folder.join("cases").join(name);
    if path.is_file() {
        Some(path)
    } else {
        eprintln!("SKIPPED: {name}: no file {}", path.display());
        None
    }
}

/// The same object as labels to be smoothed, as a scan, and as probabilities.
fn fields(path: &Path) -> [(&'static str, LabelImage, f64); 3] {
    let options = ReadOptions::default();
    let gray =
        read_gray(path, &options, &|_| Ok(())).unwrap().image.label_image(&[0.5], None).unwrap();
    let likely = read_probabilities(&[path], None, &options, &|_| Ok(()))
        .unwrap()
        .image
        .label_image()
        .unwrap();
    [
        ("smoothed labels", read_image(path).unwrap().image, 1.0),
        ("scan", gray, 0.0),
        ("probabilities", likely, 0.0),
    ]
}

fn closed_smoothly(delta: f64, sigma: f64) -> MeshParams {
    MeshParams {
        delta,
        size: 2.0 * delta,
        sigma,
        border: ImageBorder::Smooth,
        ..MeshParams::default()
    }
}

fn volume(mesh: &TetMesh) -> f64 {
    let of_tet = |tet: &[u32; 4]| {
        let [a, b, c, d] = tet.map(|v| mesh.point(v));
        (b - a).cross(c - a).dot(d - a) / 6.0
    };
    mesh.tets.iter().map(of_tet).sum()
}

/// Half of an image of 12 voxels along each axis: closed at its border as a segmentation is,
/// rounded by about half a voxel at edges.
#[test]
fn a_smooth_border_closes_fields_as_it_does_labels() {
    let Some(path) = case("border_half.nrrd") else { return };
    let labels = read_image(&path).unwrap().image;
    let voxels = labels.ids().iter().filter(|&&id| id != 0).count() as f64;
    for (name, image, sigma) in fields(&path) {
        let mesh =
            mesh_image(&image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
        let part = volume(&mesh) / voxels;
        println!("{name}: {part}");
        assert!((0.95..1.02).contains(&part), "{name}: {part} of the voxels' volume");
    }
}

/// A ball that the border z = -0.5 cuts.
#[test]
fn a_smooth_border_is_where_it_is_for_labels() {
    let Some(path) = case("ball_at_border.nrrd") else { return };
    let lowest = |image: &LabelImage, sigma: f64| {
        let mesh =
            mesh_image(image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
        mesh.points.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min)
    };
    let wanted = lowest(&read_image(&path).unwrap().image, 0.0);
    for (name, image, sigma) in fields(&path) {
        let found = lowest(&image, sigma);
        println!("{name}: {found}, labels {wanted}");
        assert!(
            (found - wanted).abs() < 0.1 && (found + 0.5).abs() < 0.1,
            "{name}: {found}, labels {wanted}"
        );
    }
}

/// The volume of a mesh, the areas of its facets on the six walls of an axis-aligned image, lower
/// ones first, and how many outer facets are on none.
fn walls(mesh: &TetMesh, image: &LabelImage) -> (f64, [f64; 6], usize) {
    let (mut areas, mut off) = ([0.0; 6], 0);
    for (facet, _) in
        mesh.facets.iter().zip(&mesh.facet_labels).filter(|(_, labels)| labels.contains(&0))
    {
        let [a, b, c] = facet.map(|v| image.frame().to_index(mesh.point(v)));
        let on = (0..6).find(|&wall| {
            let at = if wall < 3 { -0.5 } else { image.dims()[wall % 3] as f64 - 0.5 };
            [a, b, c].iter().all(|p| (p[wall % 3] - at).abs() < 1e-6)
        });
        match on {
            Some(wall) => areas[wall] += 0.5 * (b - a).cross(c - a).length(),
            None => off += 1,
        }
    }
    (volume(mesh), areas, off)
}

fn flat(delta: f64, sigma: f64) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, sigma, ..MeshParams::default() }
}

/// What fills its image is a box, whatever the image is made of.
#[test]
fn what_fills_the_image_has_its_walls() {
    let Some(path) = case("box_full.nrrd") else { return };
    for (name, image, sigma) in fields(&path) {
        for delta in [0.75, 1.5, 3.0] {
            let mesh = mesh_image(&image, &flat(delta, sigma), &Monitor::silent()).unwrap().mesh;
            let (volume, areas, off) = walls(&mesh, &image);
            assert_eq!(off, 0, "{name}: facets on no wall");
            let wanted = [192.0, 192.0, 256.0, 192.0, 192.0, 256.0];
            assert!(
                areas.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6),
                "{name}: {areas:?}"
            );
            assert!((volume - 3072.0).abs() < 1e-6, "{name}: {volume}");
        }
    }
}

/// Two labels whose interface meets the walls at a slant: no nicks.
#[test]
fn an_oblique_interface_leaves_no_nicks() {
    let Some(path) = case("wall_two.nrrd") else { return };
    let image = read_image(&path).unwrap().image;
    for delta in [0.75, 1.0, 1.5, 2.0, 3.0] {
        let meshing = mesh_image(&image, &flat(delta, 0.0), &Monitor::silent()).unwrap();
        let (volume, _, off) = walls(&meshing.mesh, &image);
        assert_eq!((off, meshing.report.certificate.facets_off_walls), (0, 0), "delta {delta}");
        assert!((volume - 3072.0).abs() < 1e-6, "delta {delta}: {volume}");
    }
}

/// A tube of radius 6 through both ends of the image, whose caps are discs.
#[test]
fn a_tube_has_its_caps() {
    let [Some(labels), Some(scan)] = ["tube_lab.nrrd", "tube_ct.nrrd"].map(case) else { return };
    let scan = read_gray(&scan, &ReadOptions::default(), &|_| Ok(()))
        .unwrap()
        .image
        .label_image(&[300.0], None)
        .unwrap();
    let labels = read_image(&labels).unwrap().image;
    // Smoothing moves a surface inwards, by a twelfth of a voxel here.
    for (name, image, sigma, radius) in [
        ("labels", &labels, 0.0, 6.0),
        ("smoothed", &labels, 1.0, 6.0 - 1.0 / 12.0),
        ("scan", &scan, 0.0, 6.0),
    ] {
        for delta in [0.75, 1.5] {
            let mesh = mesh_image(image, &flat(delta, sigma), &Monitor::silent()).unwrap().mesh;
            let (_, areas, _) = walls(&mesh, image);
            for cap in [areas[2], areas[5]] {
                let part = cap / (std::f64::consts::PI * radius * radius);
                println!("{name}, delta {delta}: {part}");
                assert!((part - 1.0).abs() < 0.02, "{name}, delta {delta}: {part} of the cap");
            }
        }
    }
}

/// The level set of a ball of radius 6: values from -7 to 1.
#[test]
fn level_sets_are_meshed_as_such_or_refused() {
    let Some(path) = case("levelset1.nrrd") else { return };
    let options = ReadOptions::default();
    let error = read_probabilities(&[&path], None, &options, &|_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("--level-sets"), "{error}");
    let image = read_maps(&[&path], MapValues::LevelSets, None, &options, &|_| Ok(()))
        .unwrap()
        .image
        .label_image()
        .unwrap();
    let mesh = mesh_image(&image, &flat(0.75, 0.0), &Monitor::silent()).unwrap().mesh;
    let part = volume(&mesh) / (4.0 / 3.0 * std::f64::consts::PI * 216.0);
    println!("level set: {part}");
    assert!((0.97..1.0).contains(&part), "{part}");
}

/// A slab of 60 x 60 x 1 voxels, a fiftieth as thick as they are wide: no tet of good shape is
/// larger than the slab is thick, so there are very many, which is told before.
#[test]
fn very_many_tets_are_told_before() {
    let warned = |name: &str, delta: f64| {
        let image = read_image(&case(name)?).unwrap().image;
        let mut warnings = Vec::new();
        let mut note = |level: Level, line: &str| {
            if level == Level::Warning {
                warnings.push(line.to_owned());
            }
        };
        let params = MeshParams { max_vertices: Some(20_000), ..flat(delta, 0.0) };
        let _ = mesh_image(&image, &params, &Monitor::silent().with_log(Some(&mut note)));
        Some(warnings.iter().any(|line| line.contains("tets are to be expected")))
    };
    let Some(of_slab) = warned("slab_thin.nrrd", 0.4) else { return };
    assert!(of_slab);
    assert_eq!(["box_full.nrrd", "tube_lab.nrrd"].map(|name| warned(name, 0.75)), [Some(false); 2]);
}

/// Sheets, rows and diagonal lines of voxels, smoothed: none is lost. Diagonal lines come apart,
/// which is told.
#[test]
fn smoothing_loses_nothing() {
    let Some(path) = case("gauss_thin.nrrd") else { return };
    let image = read_image(&path).unwrap().image;
    for sigma in [0.5, 1.0, 2.0] {
        let certificate =
            mesh_image(&image, &flat(1.5, sigma), &Monitor::silent()).unwrap().report.certificate;
        assert_eq!(certificate.small_lost, SmallLost::default());
        for row in &certificate.labels {
            assert!(
                row.tets > 0 && row.components_lost == 0,
                "sigma {sigma}: label {} is lost",
                row.label
            );
        }
        let torn =
            certificate.defects.iter().filter(|defect| defect.kind == DefectKind::Torn).count()
                as u64;
        assert_eq!(torn, certificate.labels.iter().map(|row| row.pieces).sum::<u64>());
    }
}

/// An object that fills its image is a rounded box.
#[test]
fn a_smooth_border_closes_what_fills_the_image() {
    let Some(path) = case("box_full.nrrd") else { return };
    for (name, image, sigma) in fields(&path) {
        let mesh =
            mesh_image(&image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
        let part = volume(&mesh) / (16.0 * 16.0 * 12.0);
        println!("{name}: {part}");
        assert!((0.95..1.0).contains(&part), "{name}: {part}");
    }
}

/// The files of a mesh say what its axes mean, as the image did.
#[test]
fn meshes_say_the_frame_of_their_image() {
    let Some(path) = case("frame_ras.nii.gz") else { return };
    let read = read_image(&path).unwrap();
    assert_eq!(read.world, Some(WorldAxes::Ras));
    let mesh = mesh_image(&read.image, &flat(2.0, 0.0), &Monitor::silent()).unwrap().mesh;
    let folder = tempfile::tempdir().unwrap();
    let options = WriteOptions { world: read.world, ..WriteOptions::default() };
    for ending in ["stl", "ply", "vtk"] {
        let path = folder.path().join(format!("a.{ending}"));
        write_mesh_watching(&mesh, &path, options, None).unwrap();
        let file = std::fs::read(&path).unwrap();
        assert!(file.windows(9).any(|part| part == b"SPACE=RAS"), "{ending}");
    }
}

/// Slices 4000 times as thick as pixels: distances need what the image and the mesh do, and limits
/// hold for them, too.
#[test]
fn distances_of_thick_slices_are_bounded() {
    let Some(path) = case("spacing_1_1_4000.nrrd") else { return };
    let image = read_image(&path).unwrap().image;
    for mebibytes in [20, 64] {
        let start = Instant::now();
        let params = MeshParams {
            certificate: CertificateLevel::Full,
            max_memory: Some(mebibytes << 20),
            time_limit: Some(20.0),
            ..flat(24.0, 0.0)
        };
        let ended = mesh_image(&image, &params, &Monitor::silent());
        assert!(start.elapsed().as_secs_f64() < 30.0, "{:?}", start.elapsed());
        match ended {
            Ok(made) => assert!(made.report.certificate.mesh_to_image.is_some()),
            Err(error) => assert!(error.is_limit(), "{error}"),
        }
    }
}
