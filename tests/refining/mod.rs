//! What the tests of parallel refinement share: subjects, and what must hold for every run.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use glam::DVec3;
use lapd::Error;
use lapd::image::LabelImage;
use lapd::image::phantom::*;
use lapd::mesh::extract::Background;
use lapd::monitor::{CancelFlag, Monitor, Progress};
use lapd::oracle::Oracle;
use lapd::params::{CertificateLevel, Contention, MeshParams};
use lapd::pipeline::finish::measure;
use lapd::pipeline::refine::{Ordered, number, triangulation_around};
use lapd::pipeline::{MeshResult, mesh_image};
use lapd::refine::activity::Overhead;
use lapd::refine::options::RefineOptions;
use lapd::refine::podm::Refinement;
use lapd::refine::rules::Rules;
use lapd::refine::{Asked, examine, refine};
use lapd::sizing::Sizing;
use lapd::verify::{Certificate, Examined, Extent, Quality};

/// Seconds that a test may take, however slow the build; beyond, its threads hang.
const PATIENCE: u64 = 1500;

pub const MANAGERS: [Contention; 4] =
    [Contention::Local, Contention::Global, Contention::Random, Contention::Aggressive];

/// Whether locks are refused at random: in a build for that, where it is asked for.
pub fn conflicts_are_forced() -> bool {
    cfg!(feature = "force-conflicts") && std::env::var_os("LAPD_FORCE_CONFLICTS").is_some()
}

/// Ends the process when it is not dropped in time: threads that hang cannot be ended otherwise.
pub struct Watchdog {
    _alive: Sender<()>,
}

impl Watchdog {
    pub fn new(test: &'static str) -> Self {
        let (alive, ended) = channel();
        std::thread::spawn(move || {
            if ended.recv_timeout(Duration::from_secs(PATIENCE)) == Err(RecvTimeoutError::Timeout) {
                eprintln!("{test}: not ended after {PATIENCE} s");
                std::process::abort();
            }
        });
        Self { _alive: alive }
    }
}

/// An image and how it is meshed.
pub struct Subject {
    pub name: &'static str,
    pub image: LabelImage,
    pub oracle: Oracle,
    pub params: MeshParams,
}

impl Subject {
    pub fn new(name: &'static str, image: LabelImage, delta: f64) -> Self {
        let params = MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() };
        let oracle = Oracle::new(&image, params.surface, &|| Ok(())).unwrap();
        Self { name, image, oracle, params }
    }
}

/// Rows of labels, cut by the border of the image, with a corner in between: every rule has work
/// here.
pub fn busy_image(dims: usize) -> LabelImage {
    let radius = 0.45 * dims as f64;
    let shells = nested_shells([dims; 3], [1.0, 0.9, 1.1], &[0.5 * radius, radius]).unwrap();
    LabelImage::from_fn(shells.dims(), *shells.frame(), |p: DVec3| match p.length() {
        r if r <= 0.5 * radius => 1,
        r if r <= radius => 2 + i32::from(p.x > 0.0) + 2 * i32::from(p.y > 1.0),
        _ => 6 * i32::from(p.z > 0.8 * radius),
    })
    .unwrap()
}

pub fn small_subjects() -> Vec<Subject> {
    vec![
        Subject::new("busy", busy_image(18), 1.3),
        Subject::new(
            "four labels",
            four_labels_at_a_point([16; 3], [1.0, 1.1, 0.9], 6.0).unwrap(),
            1.0,
        ),
        Subject::new("torus", torus([28, 28, 12], [1.0; 3], 8.0, 3.0).unwrap(), 1.2),
        Subject::new("sheet", thin_sheet([24, 24, 8], [1.0; 3], 18.0, 2.0).unwrap(), 1.0),
        // Samples enough for several threads to insert at once.
        Subject::new(
            "eight labels",
            eight_labels_at_a_point([24; 3], [1.0; 3], 10.0).unwrap(),
            0.8,
        ),
    ]
}

/// Samples enough for four threads.
pub fn sampled_subject() -> Subject {
    let shells = nested_shells([48; 3], [1.0; 3], &[11.0, 21.0]).unwrap();
    let subject = Subject::new("shells", shells, 0.5);
    Subject { params: MeshParams { size: 4.0, ..subject.params }, ..subject }
}

/// Every rule has work for many threads.
pub fn large_subject() -> Subject {
    Subject::new("large", busy_image(44), 0.8)
}

/// What a run made.
pub struct Outcome {
    pub refinement: Refinement,
    pub seconds: f64,
    pub vertices: u64,
    pub certificate: Certificate,
    pub quality: Quality,
}

impl Outcome {
    pub fn overhead(&self) -> Overhead {
        let mut sum = Overhead::default();
        self.refinement.threads.iter().for_each(|thread| sum.add(&thread.overhead));
        sum
    }
}

/// Refines under `options` and asserts all that holds for every run; `complete`: no limit ends it.
pub fn outcome(subject: &Subject, options: &RefineOptions, complete: bool) -> Outcome {
    let Subject { name, image, oracle, params } = subject;
    let what = format!(
        "{name}, {} threads, {:?}, {:?}",
        options.threads, options.contention, options.begging
    );
    let monitor = Monitor::silent();
    let triangulation = triangulation_around(oracle, params.delta).unwrap();
    let sizing = Sizing::uniform(params.delta);
    let rules = Rules::new(&triangulation, oracle, &sizing, params, image.labels());
    let clock = Instant::now();
    let refinement = refine(&rules, options, &monitor).unwrap_or_else(|e| panic!("{what}: {e}"));
    let seconds = clock.elapsed().as_secs_f64();
    let Ordered { numbered, order } =
        number(&rules, image.labels(), Background::Dropped, &monitor).unwrap();
    let mut mesh = numbered.copy(triangulation.tets(), &monitor).unwrap();
    let (check, unmet) = examine(&rules, &order, Asked::All, &monitor).unwrap();
    assert!(check.is_sound(), "{what}: {check:?}");
    if complete {
        let asked = Asked::LeftOver(&refinement.left_over);
        let of_left_over = examine(&rules, &order, asked, &monitor).unwrap();
        assert_eq!(of_left_over, (check, unmet), "{what}: asked what is left over, and all");
    }
    assert_eq!(triangulation.left_over(), 0, "{what}: tets owned or free slots that do not say so");
    let counters = refinement.counters;
    assert_eq!(
        counters.insertions - counters.removals,
        check.vertices - 8,
        "{what}: vertices are lost"
    );
    assert_eq!(refinement.ended_by.is_none(), complete, "{what}: {:?}", refinement.ended_by);
    assert!(!complete || unmet == [0; 6], "{what}: unmet {unmet:?}");
    mesh.collect_facets(&monitor).unwrap();
    let (level, check_memory) = (CertificateLevel::Full, &|_| Ok(()));
    let extent = Extent { level, distances_until: None, check_memory };
    let (quality, certificate, _) =
        measure(&mesh, image, oracle, Examined::default(), &[], extent, &monitor).unwrap();
    let defects = [certificate.inverted_tets, certificate.orphan_vertices, certificate.open_edges];
    assert_eq!(defects, [0; 3], "{what}: inverted tets, orphan vertices, open edges");
    if complete {
        let rounding = 1.0 + 1e-9;
        assert!(
            quality.max_radius_edge <= params.radius_edge * rounding,
            "{what}: ratio {}",
            quality.max_radius_edge
        );
        assert!(
            quality.max_circumradius <= params.size * rounding,
            "{what}: radius {}",
            quality.max_circumradius
        );
        assert!(
            quality.min_facet_angle >= params.facet_angle - 1e-6,
            "{what}: angle {}",
            quality.min_facet_angle
        );
    }
    Outcome { refinement, seconds, vertices: check.vertices - 8, certificate, quality }
}

/// Asserts that two meshes of one image are as good as each other. Vertex counts within `spread`;
/// volumes within a percent of the label's, or the volume of a few tets where it is small; the
/// largest distances within `largest`, of a voxel, their means within a tenth.
pub fn assert_alike(name: &str, one: &Outcome, other: &Outcome, spread: f64, largest: f64) {
    let ratio = other.vertices as f64 / one.vertices as f64;
    assert!(
        (ratio - 1.0).abs() < spread,
        "{name}: {} vertices, {} with one thread",
        other.vertices,
        one.vertices
    );
    let (a, b) = (&one.certificate, &other.certificate);
    assert_eq!(a.labels.len(), b.labels.len(), "{name}");
    for (a, b) in a.labels.iter().zip(&b.labels) {
        let difference = (a.mesh_volume - b.mesh_volume).abs();
        assert!(
            difference < 0.01 * a.mesh_volume + 4.0,
            "{name}, label {}: {} and {}",
            a.label,
            a.mesh_volume,
            b.mesh_volume
        );
    }
    for (what, a, b, bound) in [
        ("mesh to image", a.mesh_to_image.unwrap().max, b.mesh_to_image.unwrap().max, largest),
        ("image to mesh", a.image_to_mesh.unwrap().max, b.image_to_mesh.unwrap().max, largest),
        ("mean, mesh to image", a.mesh_to_image.unwrap().mean, b.mesh_to_image.unwrap().mean, 0.1),
        ("mean, image to mesh", a.image_to_mesh.unwrap().mean, b.image_to_mesh.unwrap().mean, 0.1),
    ] {
        assert!((a - b).abs() < bound, "{name}, {what}: {a} and {b}");
    }
}

/// Meshes the large subject as `params` say, but for lengths; the callback is called on any thread.
pub fn mesh_reporting(
    params: MeshParams,
    report: &mut (dyn FnMut(Progress) -> bool + Send),
    flag: &CancelFlag,
) -> (Result<MeshResult, Error>, f64) {
    let Subject { image, params: MeshParams { delta, .. }, .. } = large_subject();
    let params = MeshParams { delta: 0.5 * delta, size: delta, ..params };
    let mut report = |progress| report(progress);
    let clock = Instant::now();
    (
        mesh_image(&image, &params, &Monitor::new(Some(&mut report), Some(flag))),
        clock.elapsed().as_secs_f64(),
    )
}
