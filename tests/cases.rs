//! Small inputs that show faults, each of a kind: the files of `shared/images/cases` beside the checkout, or of the folder that
//! `LAPD_IMAGES` names.

use std::path::{Path, PathBuf};

use lapd::image::LabelImage;
use lapd::image::readers::values::{read_gray, read_probabilities};
use lapd::image::readers::{ReadOptions, read_image};
use lapd::mesh::TetMesh;
use lapd::mesher::mesh_image;
use lapd::monitor::Monitor;
use lapd::params::{ImageBorder, MeshParams};

/// A case's file, or `None`, said loudly.
fn case(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LAPD_IMAGES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"), PathBuf::from);
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
    let gray = read_gray(path, &options).unwrap().image.label_image(&[0.5], None).unwrap();
    let likely = read_probabilities(&[path], None, &options).unwrap().image.label_image().unwrap();
    [("smoothed labels", read_image(path).unwrap().image, 1.0), ("scan", gray, 0.0), ("probabilities", likely, 0.0)]
}

fn closed_smoothly(delta: f64, sigma: f64) -> MeshParams {
    MeshParams { delta, size: 2.0 * delta, sigma, border: ImageBorder::Smooth, ..MeshParams::default() }
}

fn volume(mesh: &TetMesh) -> f64 {
    let of_tet = |tet: &[u32; 4]| {
        let [a, b, c, d] = tet.map(|v| mesh.point(v));
        (b - a).cross(c - a).dot(d - a) / 6.0
    };
    mesh.tets.iter().map(of_tet).sum()
}

/// Half of an image of 12 voxels along each axis: closed at its border as a segmentation is, rounded by about half a voxel at edges.
#[test]
fn a_smooth_border_closes_fields_as_it_does_labels() {
    let Some(path) = case("border_half.nrrd") else { return };
    let labels = read_image(&path).unwrap().image;
    let voxels = labels.ids().iter().filter(|&&id| id != 0).count() as f64;
    for (name, image, sigma) in fields(&path) {
        let mesh = mesh_image(&image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
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
        let mesh = mesh_image(image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
        mesh.points.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min)
    };
    let wanted = lowest(&read_image(&path).unwrap().image, 0.0);
    for (name, image, sigma) in fields(&path) {
        let found = lowest(&image, sigma);
        println!("{name}: {found}, labels {wanted}");
        assert!((found - wanted).abs() < 0.1 && (found + 0.5).abs() < 0.1, "{name}: {found}, labels {wanted}");
    }
}

/// An object that fills its image is a rounded box.
#[test]
fn a_smooth_border_closes_what_fills_the_image() {
    let Some(path) = case("box_full.nrrd") else { return };
    for (name, image, sigma) in fields(&path) {
        let mesh = mesh_image(&image, &closed_smoothly(1.0, sigma), &Monitor::silent()).unwrap().mesh;
        let part = volume(&mesh) / (16.0 * 16.0 * 12.0);
        println!("{name}: {part}");
        assert!((0.95..1.0).contains(&part), "{name}: {part}");
    }
}
