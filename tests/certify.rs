//! Meshes that are certified later than they are made, and meshes from other programs' arrays.

use lapd::Error;
use lapd::image::{LabelImage, phantom};
use lapd::mesh::TetMesh;
use lapd::monitor::{CancelFlag, Monitor};
use lapd::params::{CertificateLevel, Improve, MeshParams};
use lapd::pipeline::certify::{certify, from_elsewhere};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::verify::{Certificate, Examined};

fn params(certificate: CertificateLevel, improve: Improve) -> MeshParams {
    MeshParams {
        delta: 1.5,
        size: 3.0,
        min_voxels: 3,
        certificate,
        improve,
        ..MeshParams::default()
    }
}

/// A torus, and specks beside it.
fn image() -> LabelImage {
    let torus = phantom::torus([30, 30, 14], [1.0; 3], 9.0, 4.0).unwrap();
    let mut ids = torus.ids().to_vec();
    ids[2 + 30 * 2] = 2;
    ids[5 + 30 * 2] = 2;
    ids[6 + 30 * 2] = 2;
    ids[7 + 30 * 2] = 2;
    LabelImage::from_ids(torus.dims(), *torus.frame(), ids, vec![0, 1, 2]).unwrap()
}

fn made(image: &LabelImage, params: &MeshParams) -> MeshResult {
    mesh_image(image, params, &Monitor::silent()).unwrap()
}

/// What is counted on the triangulation aside.
fn without_counts(certificate: &Certificate) -> Certificate {
    let Examined { non_delaunay_facets, unmet } = Examined::default();
    Certificate { non_delaunay_facets, unmet, ..certificate.clone() }
}

#[test]
fn measured_later_it_is_the_certificate_of_the_run() {
    let image = image();
    for improve in [Improve::None, Improve::Full] {
        let full = params(CertificateLevel::Full, improve);
        let at_once = made(&image, &full);
        assert!(at_once.report.improvement.counts.operations() > 0 || improve == Improve::None);
        for level in [CertificateLevel::None, CertificateLevel::Sound] {
            let mut later = made(&image, &params(level, improve));
            assert!(later.mesh == at_once.mesh);
            certify(&mut later, &image, &full, &Monitor::silent()).unwrap();
            let (found, expected) = (&later.report.certificate, &at_once.report.certificate);
            assert_eq!(later.report.quality, at_once.report.quality);
            assert_eq!(without_counts(found), without_counts(expected));
            let (counted, zeros) = match (level, improve) {
                (CertificateLevel::None, Improve::None) => (Some(0), None),
                (CertificateLevel::None, _) => (None, None),
                _ => (Some(0), Some([0; 6])),
            };
            assert_eq!((found.non_delaunay_facets, found.unmet), (counted, zeros));
            assert!(later.report.seconds.certify > 0.0);
        }
    }
}

/// The nodes of second order are no vertices without a tet, nor does their bending count: distances
/// are those of flat facets.
#[test]
fn nodes_of_second_order_do_not_count() {
    let image = image();
    let full =
        MeshParams { order: 2, curved: true, ..params(CertificateLevel::Full, Improve::Full) };
    let at_once = made(&image, &full);
    let mut later = made(&image, &full);
    certify(&mut later, &image, &full, &Monitor::silent()).unwrap();
    assert!(later.mesh.mid_nodes.is_some());
    assert_eq!(later.report.certificate, at_once.report.certificate);
    assert_eq!(later.report.quality, at_once.report.quality);
}

#[test]
fn arrays_have_the_certificate_of_their_mesh() {
    let image = image();
    let full = params(CertificateLevel::Full, Improve::Full);
    let run = made(&image, &full);
    // Any order of the tets will do, and of vertices within a tet what leaves it positive.
    let turned = |[a, b, c, d]: [u32; 4]| [b, c, a, d];
    let tets: Vec<_> = run.mesh.tets.iter().rev().map(|&tet| turned(tet)).collect();
    let labels: Vec<_> = run.mesh.labels.iter().rev().copied().collect();
    let again = TetMesh::from_arrays(&run.mesh.points, &tets, &labels, &Monitor::silent()).unwrap();
    let mut found = from_elsewhere(again);
    certify(&mut found, &image, &full, &Monitor::silent()).unwrap();
    let (found, expected) = (&found.report.certificate, &run.report.certificate);
    assert_eq!(found.unmet, None);
    // The improvement counts those of the object, which is all that there is.
    assert_eq!(found.non_delaunay_facets, Some(run.report.improvement.non_delaunay_facets));
    assert!(found.non_delaunay_facets > Some(0));
    assert_eq!(found.labels.len(), expected.labels.len());
    for (found, expected) in found.labels.iter().zip(&expected.labels) {
        let counts = |row: &lapd::verify::LabelRow| {
            (row.label, row.tets, row.components_mesh, row.euler_mesh, row.components_lost)
        };
        assert_eq!(counts(found), counts(expected));
        assert!((found.mesh_volume - expected.mesh_volume).abs() < 1e-9 * expected.image_volume);
    }
    let largest = |certificate: &Certificate| certificate.mesh_to_image.unwrap().max;
    assert!((largest(found) - largest(expected)).abs() < 0.02);
    assert_eq!(found.defects.len(), expected.defects.len());
}

#[test]
fn faults_of_other_programs_are_counted() {
    let image = image();
    let sound = params(CertificateLevel::Sound, Improve::Full);
    let mut mesh = made(&image, &sound).mesh;
    let faulty = mesh.tets.len() / 2;
    mesh.tets[faulty].swap(0, 1);
    mesh.points.push([0.5; 3]);
    // A tet of a label that the image does not have.
    mesh.labels[7] = 9;
    let mesh = TetMesh::from_arrays(&mesh.points, &mesh.tets, &mesh.labels, &Monitor::silent());
    let mut result = from_elsewhere(mesh.unwrap());
    assert_eq!(result.report.certificate.level, CertificateLevel::None);
    certify(&mut result, &image, &sound, &Monitor::silent()).unwrap();
    let certificate = &result.report.certificate;
    assert_eq!((certificate.inverted_tets, certificate.orphan_vertices), (1, 1));
    let row = certificate.labels.iter().find(|row| row.label == 9).unwrap();
    assert_eq!((row.tets, row.image_voxels, row.pieces), (1, 0, 1));
}

#[test]
fn what_cannot_be_measured_is_refused_and_changes_nothing() {
    let image = image();
    let sound = params(CertificateLevel::Sound, Improve::Full);
    let mut result = made(&image, &sound);
    let before = result.report.certificate.clone();
    let none = params(CertificateLevel::None, Improve::Full);
    let error = certify(&mut result, &image, &none, &Monitor::silent()).unwrap_err();
    assert!(error.to_string().contains("nothing to measure"), "{error}");
    let absent = MeshParams { keep: vec![77], ..sound.clone() };
    let error = certify(&mut result, &image, &absent, &Monitor::silent()).unwrap_err();
    assert!(matches!(error, Error::InvalidArgument(_)), "{error}");
    let cancel = CancelFlag::default();
    cancel.cancel();
    let error = certify(&mut result, &image, &sound, &Monitor::new(None, Some(&cancel)));
    assert!(matches!(error, Err(Error::Cancelled)));
    let hurried = MeshParams { time_limit: Some(1e-9), ..sound.clone() };
    let error = certify(&mut result, &image, &hurried, &Monitor::silent());
    assert!(matches!(error, Err(Error::TimeLimit(_))));
    assert_eq!(result.report.certificate, before);
}

#[test]
fn distances_of_a_fine_mesh_count_under_the_limit_of_memory() {
    let image = image();
    let fine =
        MeshParams { delta: 0.4, size: 0.8, ..params(CertificateLevel::Sound, Improve::None) };
    let mut result = made(&image, &fine);
    let before = result.report.certificate.clone();
    let within = |bytes| MeshParams {
        certificate: CertificateLevel::Full,
        max_memory: Some(bytes),
        ..fine.clone()
    };
    // Each facet is a triangle of 88 bytes there.
    let held = result.mesh.bytes() + result.report.oracle_bytes;
    let least = held + 88 * result.mesh.facets.len() as u64;
    let error = certify(&mut result, &image, &within(least), &Monitor::silent());
    assert!(matches!(error, Err(Error::MemoryLimit(_))), "{error:?}");
    assert_eq!(result.report.certificate, before);
    certify(&mut result, &image, &within(2 * least), &Monitor::silent()).unwrap();
    assert_eq!(result.report.certificate.level, CertificateLevel::Full);
}

#[test]
fn progress_goes_from_nothing_to_all() {
    let image = image();
    let full = params(CertificateLevel::Full, Improve::Full);
    let mut result = made(&image, &params(CertificateLevel::None, Improve::Full));
    let mut seen = Vec::new();
    let mut note = |progress: lapd::monitor::Progress| {
        seen.push(progress.fraction);
        true
    };
    certify(&mut result, &image, &full, &Monitor::new(Some(&mut note), None)).unwrap();
    assert_eq!((seen[0], *seen.last().unwrap()), (0.0, 1.0));
    assert!(seen.is_sorted());
}

/// A mesh that has nothing to do with the image ends as soon as one that has.
#[test]
fn meshes_that_lie_elsewhere_are_measured() {
    let image = image();
    let full = params(CertificateLevel::Full, Improve::Full);
    let mesh = made(&image, &full).mesh;
    for (scale, shift) in [(1.0, 1e4), (10.0, 0.0), (1e-3, 5.0)] {
        let points: Vec<[f64; 3]> =
            mesh.points.iter().map(|p| p.map(|x| scale * x + shift)).collect();
        let moved = TetMesh::from_arrays(&points, &mesh.tets, &mesh.labels, &Monitor::silent());
        let mut result = from_elsewhere(moved.unwrap());
        let start = std::time::Instant::now();
        certify(&mut result, &image, &full, &Monitor::silent()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let certificate = &result.report.certificate;
        println!("{scale} {shift}: {seconds:.2} s, {:?}", certificate.mesh_to_image);
        assert!(certificate.mesh_to_image.unwrap().max.is_finite());
        assert!(certificate.labels.iter().any(|row| row.pieces + row.components_lost > 0));
        assert!(seconds < 30.0, "{scale} {shift}: {seconds} s");
    }
}
