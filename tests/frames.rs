//! Frames of all sizes: inside of the range that is accepted every mesh is sound, outside of it
//! there is one clear error. `LAPD_FRAMES` is the number of frames to try (150).

mod random;

use std::path::Path;

use lapd::Error;
use lapd::image::{Frame, LabelImage};
use lapd::io::read::read_image;
use lapd::monitor::Monitor;
use lapd::params::{Adaptive, MeshParams};
use lapd::pipeline::mesh_image;
use random::Random;

impl Random {
    /// Ten to a power between these.
    fn power(&mut self, low: f64, high: f64) -> f64 {
        10_f64.powf(self.between(low, high))
    }

    /// Columns of a rotation by Euler angles.
    fn direction(&mut self) -> [[f64; 3]; 3] {
        let [a, b, c] = [0; 3].map(|_| self.between(0.0, 6.3));
        glam::DMat3::from_euler(glam::EulerRot::XYZ, a, b, c).to_cols_array_2d()
    }
}

/// Blobs of three labels.
fn image(frame: Frame, random: &mut Random) -> LabelImage {
    let dims = [6, 5, 4];
    let label = |random: &mut Random| (random.unit() * 4.0) as u16;
    let coarse: Vec<u16> = (0..12).map(|_| label(random)).collect();
    let ids = (0..120).map(|v: usize| {
        let [x, y, z] = [v % 6, v / 6 % 5, v / 30];
        coarse[x / 2 + 3 * (y / 3 + 2 * (z / 2))]
    });
    let mut ids: Vec<u16> = ids.collect();
    ids[0] = 1;
    LabelImage::from_ids(dims, frame, ids, vec![0, 1, 2, 3]).unwrap()
}

#[test]
fn every_frame_that_is_accepted_gives_a_sound_mesh() {
    let count = std::env::var("LAPD_FRAMES").map_or(150, |count| count.parse().unwrap());
    for seed in 0..count {
        let mut random = Random(100 + seed);
        let scale = random.power(-11.5, 8.5);
        // Mostly mild ratios, as images have them; sometimes far ones.
        let ratio = if seed % 8 == 0 { 1.5 } else { 0.4 };
        let spacing = [0; 3].map(|_| (scale * random.power(-ratio, ratio)).clamp(1e-12, 1e9));
        let smallest = spacing.iter().copied().fold(f64::INFINITY, f64::min);
        let far = random.power(-2.0, 9.0) * smallest;
        let origin = [0; 3].map(|_| random.between(-far, far));
        let what = format!("seed {seed}: spacing {spacing:?}, origin {origin:?}");
        let frame = Frame::new(origin, spacing, random.direction())
            .unwrap_or_else(|error| panic!("{what}: {error}"));
        let image = image(frame, &mut random);
        let mean = spacing.iter().product::<f64>().cbrt();
        let delta = mean * random.between(0.7, 3.0);
        let params = MeshParams {
            delta,
            size: 2.0 * delta,
            adaptive: if seed % 8 != 0 { Adaptive::Thickness } else { Adaptive::Off },
            max_vertices: Some(200_000),
            ..MeshParams::default()
        };
        let meshing = match mesh_image(&image, &params, &Monitor::silent()) {
            Ok(meshing) => meshing,
            // What has few voxels may have no tet at a large delta.
            Err(Error::InvalidArgument(message)) if message.contains("too coarse") => continue,
            Err(error) => panic!("{what}: {error}"),
        };
        let certificate = &meshing.report.certificate;
        let counts = [
            certificate.non_delaunay_facets.expect("counted by the run"),
            certificate.inverted_tets,
            certificate.orphan_vertices,
            certificate.open_edges,
        ];
        assert_eq!(counts, [0; 4], "{what}");
        let [.., r4, _, _] = certificate.unmet.expect("counted by the run");
        assert!(r4 <= 8, "{what}: R4 unmet {r4} times of {}", meshing.mesh.tets.len());
        let volume = certificate.mesh_volume() / certificate.image_volume();
        assert!((0.5..1.5).contains(&volume) || delta > mean, "{what}: {volume} of the volume");
    }
}

#[test]
fn every_other_frame_is_refused_with_one_line() {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for seed in 0..10_000 {
        let mut random = Random(seed);
        let (mut spacing, mut origin) = ([1.0; 3], [0.0; 3]);
        let axis = (random.unit() * 3.0) as usize;
        match seed % 5 {
            0 => spacing = [random.power(-300.0, -12.1); 3],
            1 => spacing = [random.power(9.1, 300.0); 3],
            2 => spacing[axis] = random.power(5.1, 8.9),
            3 => origin[axis] = -random.power(9.1, 300.0),
            _ => spacing[axis] = [f64::NAN, f64::INFINITY, 0.0, -1.0][seed as usize % 4],
        }
        let error = Frame::new(origin, spacing, axes).unwrap_err();
        assert!(matches!(error, Error::InvalidArgument(_)), "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

/// Files of which the walk never ended.
#[test]
fn files_with_huge_and_tiny_spacings_are_refused() {
    let folder = std::env::var_os("LAPD_IMAGES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/images"), Into::into);
    for name in ["spacing_huge.nrrd", "spacing_1e-300.nrrd"] {
        let path = folder.join("cases").join(name);
        if !path.exists() {
            println!("SKIPPED: {} is missing", path.display());
            continue;
        }
        let error = read_image(&path).unwrap_err().to_string();
        assert!(error.contains("must lie between 1e-12 and 1e9"), "{error}");
    }
}

/// A delta beyond all measure is one that is too coarse, or as good as that of the object's size.
#[test]
fn deltas_beyond_the_object_end_at_once() {
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let image = image(frame, &mut Random(5));
    for delta in [1e3, 1e10, 1e30, 1e60, 1e100, 1e200, 1e300] {
        let params = MeshParams { delta, size: delta, ..MeshParams::default() };
        match mesh_image(&image, &params, &Monitor::silent()) {
            Ok(meshing) => assert_eq!(meshing.report.certificate.inverted_tets, 0, "{delta}"),
            Err(error) => assert!(error.to_string().contains("too coarse"), "{delta}: {error}"),
        }
    }
}
