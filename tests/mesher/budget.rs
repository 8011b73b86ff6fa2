//! A number of tets that is asked for, and what is to be expected.

use lapd::image::phantom::{comb, helical_tube};
use lapd::image::{Frame, LabelImage};
use lapd::monitor::{Level, Monitor};
use lapd::params::{Adaptive, CertificateLevel, MeshParams};
use lapd::pipeline::estimate::{Estimate, estimate};
use lapd::pipeline::mesh_image;

use super::params;
use super::runs::busy_image;

/// Two balls, one inside the other, in voxels of other sides.
fn balls() -> LabelImage {
    let frame = Frame::axis_aligned([1.0, 0.8, 1.5]).unwrap();
    let label = |p: glam::DVec3| {
        let r = (p - glam::DVec3::new(19.5, 15.6, 29.25)).length();
        i32::from(r < 14.0) + i32::from(r < 8.0)
    };
    LabelImage::from_fn([40; 3], frame, label).unwrap()
}

fn quick(adaptive: Adaptive, target: Option<u64>) -> MeshParams {
    MeshParams { adaptive, target_tets: target, certificate: CertificateLevel::None, ..params(1.5) }
}

fn tets(mesh: &lapd::mesh::TetMesh) -> u64 {
    mesh.labels.iter().filter(|&&label| label != 0).count() as u64
}

#[test]
fn a_mesh_has_the_tets_asked_for() {
    for image in [balls(), busy_image()] {
        for adaptive in [Adaptive::Off, Adaptive::Thickness, Adaptive::Topology] {
            for target in [4_000, 20_000, 120_000] {
                let params = quick(adaptive, Some(target));
                let run = mesh_image(&image, &params, &Monitor::silent()).unwrap();
                let got = tets(&run.mesh);
                let ratio = got as f64 / target as f64;
                assert!((0.9..=1.1).contains(&ratio), "{adaptive:?}: {got} of {target}");
                // The factor says how to make it again.
                let scaled = MeshParams { target_tets: None, ..params.scaled(run.report.factor) };
                let again = mesh_image(&image, &scaled, &Monitor::silent()).unwrap();
                assert_eq!(again.mesh.tets, run.mesh.tets);
            }
        }
    }
}

/// So it has where it is made coarse, which the refined mesh tells nothing about.
#[test]
fn a_coarsened_mesh_has_the_tets_asked_for() {
    for target in [4_000, 20_000] {
        let params = MeshParams { coarsen: Some(15.0), ..quick(Adaptive::Thickness, Some(target)) };
        let run = mesh_image(&busy_image(), &params, &Monitor::silent()).unwrap();
        let ratio = tets(&run.mesh) as f64 / target as f64;
        assert!((0.9..=1.1).contains(&ratio), "{ratio} of {target}");
        // The floor of samples stays: what is thin must be found.
        assert_eq!(params.scaled(3.0).spacing_floor, params.spacing_floor);
    }
}

/// A limit that ends a later try leaves the mesh of an earlier one, where partial ones are allowed.
#[test]
fn a_limit_leaves_the_mesh_of_an_earlier_try() {
    let limited = MeshParams {
        max_vertices: Some(4200),
        partial: true,
        ..quick(Adaptive::Off, Some(20_000))
    };
    let run = mesh_image(&balls(), &limited, &Monitor::silent()).unwrap();
    assert!(run.ended_by.is_some());
    let whole = quick(Adaptive::Off, None).scaled(run.report.factor);
    let again = mesh_image(&balls(), &whole, &Monitor::silent()).unwrap();
    assert_eq!(again.mesh.tets, run.mesh.tets);
    let refused = MeshParams { partial: false, ..limited };
    mesh_image(&balls(), &refused, &Monitor::silent()).unwrap_err();
}

/// Of few tets there are not all numbers.
#[test]
fn what_cannot_be_had_is_said() {
    let mut missed = 0;
    for target in 1..16 {
        let mut warnings = Vec::new();
        let mut log = |level, line: &str| {
            if level == Level::Warning {
                warnings.push(line.to_owned());
            }
        };
        let monitor = Monitor::silent().with_log(Some(&mut log));
        let run = mesh_image(&balls(), &quick(Adaptive::Off, Some(target)), &monitor).unwrap();
        let said = warnings.iter().any(|line| line.contains("tets were asked for"));
        let off = (tets(&run.mesh) as f64 / target as f64 - 1.0).abs();
        assert_eq!(said, off > 0.1, "{target}: {warnings:?}");
        missed += u32::from(said);
    }
    assert!(missed > 0);
    assert!(quick(Adaptive::Off, Some(0)).validate().is_err());
}

#[test]
fn progress_of_a_search_is_monotone() {
    let mut seen = Vec::new();
    let mut record = |progress| {
        seen.push(progress);
        true
    };
    let params = quick(Adaptive::Topology, Some(15_000));
    mesh_image(&busy_image(), &params, &Monitor::new(Some(&mut record), None)).unwrap();
    assert!(seen.is_sorted_by(|a, b| a.phase <= b.phase && a.fraction <= b.fraction), "{seen:?}");
}

/// Phantoms are no atlases: smooth, without contacts; but the estimate is of their kind.
#[test]
fn tets_are_as_expected() {
    for image in [balls(), busy_image()] {
        for adaptive in [Adaptive::Off, Adaptive::Thickness, Adaptive::Topology] {
            for factor in [0.4, 0.6, 1.0] {
                let params = quick(adaptive, None).scaled(factor);
                let Estimate { tets: expected, peak_bytes, seconds } =
                    estimate(&image, &params, &Monitor::silent()).unwrap();
                let run = mesh_image(&image, &params, &Monitor::silent()).unwrap();
                let ratio = expected as f64 / tets(&run.mesh) as f64;
                assert!((0.65..=1.5).contains(&ratio), "{adaptive:?}, {factor}: {ratio}");
                assert!(peak_bytes > 0 && seconds > 0.0);
            }
        }
    }
}

/// So it is where the mesh is coarsened, and what is thin has the last word.
#[test]
fn tets_of_coarsened_meshes_are_as_expected() {
    for image in [comb(8).unwrap(), helical_tube([48; 3], 14.0, 3.0).unwrap(), busy_image()] {
        for factor in [0.6, 1.0, 2.0] {
            for adaptive in [Adaptive::Thickness, Adaptive::Topology] {
                let params = MeshParams { coarsen: Some(15.0), ..quick(adaptive, None) };
                let params = params.scaled(factor);
                let told = estimate(&image, &params, &Monitor::silent()).unwrap().tets;
                let run = mesh_image(&image, &params, &Monitor::silent()).unwrap();
                let ratio = told as f64 / tets(&run.mesh) as f64;
                assert!((0.5..=2.5).contains(&ratio), "{adaptive:?}, {factor}: {ratio}");
            }
        }
    }
}

/// Who asks for a number of tets is told of about as many.
#[test]
fn tets_that_are_asked_for_are_expected() {
    for adaptive in [Adaptive::Off, Adaptive::Thickness, Adaptive::Topology] {
        let params = MeshParams { coarsen: Some(15.0), ..quick(adaptive, Some(15_000)) };
        let told = estimate(&busy_image(), &params, &Monitor::silent()).unwrap().tets;
        assert!((13_500..=16_500).contains(&told), "{adaptive:?}: {told}");
    }
}
