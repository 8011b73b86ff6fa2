//! Parallel refinement under stress: many threads on few processors, every contention manager, both begging schemes, on small phantoms; what several threads make against what one
//! makes; and every way in which a run can end early.
//!
//! After each run the validator goes over the triangulation, no vertex may be owned and no tet marked, no rule unmet, and the certificate of the mesh must be clean.
//!
//! With the feature `force-conflicts` the same tests run while locks are refused at random at every step of an operation. `LAPD_STRESS_RUNS` is the number of
//! runs of the stress test, for builds that are slow (`verification/run.sh`).

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use glam::DVec3;
use lapd::Error;
use lapd::delaunay::Triangulation;
use lapd::image::LabelImage;
use lapd::image::phantom::*;
use lapd::mesh::certificate::Certificate;
use lapd::mesh::extract::extract;
use lapd::mesh::quality::Quality;
use lapd::mesher::{Meshing, mesh_image};
use lapd::monitor::{CancelFlag, Monitor, Phase, Progress};
use lapd::oracle::Oracle;
use lapd::parallel::machine::Machine;
use lapd::params::{Begging, Contention, MeshParams};
use lapd::refine::activity::Overhead;
use lapd::refine::podm::Refinement;
use lapd::refine::rules::Rules;
use lapd::refine::team::{Limits, Schedule};
use lapd::refine::{refine, unmet_rules};

/// Runs of the stress test, all with several threads.
const RUNS: usize = 200;
/// Seconds that a test may take, however slow the build; beyond, its threads hang.
const PATIENCE: u64 = 1500;

const MANAGERS: [Contention; 4] = [Contention::Local, Contention::Global, Contention::Random, Contention::Aggressive];
const SCHEMES: [Begging; 2] = [Begging::ByLevel, Begging::Flat];

/// Ends the process when it is not dropped in time: threads that hang cannot be ended otherwise.
struct Watchdog {
    _alive: Sender<()>,
}

impl Watchdog {
    fn new(test: &'static str) -> Self {
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
struct Subject {
    name: &'static str,
    image: LabelImage,
    oracle: Oracle,
    params: MeshParams,
}

impl Subject {
    fn new(name: &'static str, image: LabelImage, delta: f64) -> Self {
        let params = MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() };
        let oracle = Oracle::new(&image, params.surface, &|| Ok(())).unwrap();
        Self { name, image, oracle, params }
    }
}

/// Rows of labels, cut by the border of the image, with a corner in between: every rule has work here.
fn busy_image(dims: usize) -> LabelImage {
    let radius = 0.45 * dims as f64;
    let shells = nested_shells([dims; 3], [1.0, 0.9, 1.1], &[0.5 * radius, radius]).unwrap();
    LabelImage::from_fn(shells.dims(), *shells.frame(), |p: DVec3| match p.length() {
        r if r <= 0.5 * radius => 1,
        r if r <= radius => 2 + i32::from(p.x > 0.0) + 2 * i32::from(p.y > 1.0),
        _ => 6 * i32::from(p.z > 0.8 * radius),
    })
    .unwrap()
}

fn small_subjects() -> Vec<Subject> {
    vec![
        Subject::new("busy", busy_image(18), 1.3),
        Subject::new("four labels", four_labels_at_a_point([16; 3], [1.0, 1.1, 0.9], 6.0).unwrap(), 1.0),
        Subject::new("torus", torus([28, 28, 12], [1.0; 3], 8.0, 3.0).unwrap(), 1.2),
        Subject::new("sheet", thin_sheet([24, 24, 8], [1.0; 3], 18.0, 2.0).unwrap(), 1.0),
        // Samples enough for several threads to insert at once.
        Subject::new("eight labels", eight_labels_at_a_point([24; 3], [1.0; 3], 10.0).unwrap(), 0.8),
    ]
}

/// Samples enough for four threads.
fn sampled_subject() -> Subject {
    let shells = nested_shells([48; 3], [1.0; 3], &[11.0, 21.0]).unwrap();
    let subject = Subject::new("shells", shells, 0.5);
    Subject { params: MeshParams { size: 4.0, ..subject.params }, ..subject }
}

/// Every rule has work for many threads.
fn large_subject() -> Subject {
    Subject::new("large", busy_image(44), 0.8)
}

/// What a run made.
struct Outcome {
    refinement: Refinement,
    seconds: f64,
    vertices: u64,
    certificate: Certificate,
    quality: Quality,
}

impl Outcome {
    fn overhead(&self) -> Overhead {
        let mut sum = Overhead::default();
        self.refinement.threads.iter().for_each(|thread| sum.add(&thread.overhead));
        sum
    }
}

/// Refines under `schedule` and asserts all that holds for every run; `complete`: no limit ends it.
fn outcome(subject: &Subject, schedule: &Schedule, complete: bool) -> Outcome {
    let Subject { name, image, oracle, params } = subject;
    let what = format!("{name}, {} threads, {:?}, {:?}", schedule.threads, schedule.contention, schedule.begging);
    let monitor = Monitor::silent();
    let [lower, upper] = oracle.bounds();
    let triangulation = Triangulation::new(lower - 8.0, upper + 8.0).unwrap();
    let rules = Rules::new(&triangulation, oracle, params, image.labels()).unwrap();
    let clock = Instant::now();
    let refinement = refine(&rules, schedule, &monitor).unwrap_or_else(|e| panic!("{what}: {e}"));
    let seconds = clock.elapsed().as_secs_f64();
    let check = triangulation.check();
    assert!(check.is_sound(), "{what}: {check:?}");
    assert_eq!(triangulation.left_over(), 0, "{what}: vertices owned or tets marked");
    let counters = refinement.counters;
    assert_eq!(counters.insertions - counters.removals, check.vertices - 8, "{what}: vertices are lost");
    assert_eq!(refinement.ended_by.is_none(), complete, "{what}: {:?}", refinement.ended_by);
    let unmet = unmet_rules(&rules, &monitor).unwrap();
    assert!(!complete || unmet == [0; 6], "{what}: unmet {unmet:?}");
    let mesh = extract(&triangulation, |t| rules.label(t), image.labels(), false, &monitor).unwrap();
    let certificate = Certificate::measure(&mesh, image, check.non_delaunay_facets, unmet, &monitor).unwrap();
    let defects = [certificate.inverted_tets, certificate.orphan_vertices, certificate.open_edges];
    assert_eq!(defects, [0; 3], "{what}: inverted tets, orphan vertices, open edges");
    let quality = Quality::measure(&mesh, &monitor).unwrap();
    if complete {
        let rounding = 1.0 + 1e-9;
        assert!(quality.max_radius_edge <= params.radius_edge * rounding, "{what}: ratio {}", quality.max_radius_edge);
        assert!(quality.max_circumradius <= params.size * rounding, "{what}: radius {}", quality.max_circumradius);
        assert!(quality.min_facet_angle >= params.facet_angle - 1e-6, "{what}: angle {}", quality.min_facet_angle);
    }
    Outcome { refinement, seconds, vertices: check.vertices - 8, certificate, quality }
}

fn team(threads: usize, contention: Contention, begging: Begging) -> Schedule {
    // Two nodes, so that begging has levels.
    Schedule { threads, contention, begging, machine: Machine::uniform(2, threads.div_ceil(2)), ..Schedule::solo() }
}

/// Asserts that two meshes of one image are as good as each other. Vertex counts within `spread`; volumes within a percent of the label's, or the volume of a few
/// tets where it is small; the largest distances within `largest`, of a voxel, their means within a tenth.
fn assert_alike(name: &str, one: &Outcome, other: &Outcome, spread: f64, largest: f64) {
    let ratio = other.vertices as f64 / one.vertices as f64;
    assert!((ratio - 1.0).abs() < spread, "{name}: {} vertices, {} with one thread", other.vertices, one.vertices);
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
        ("mesh to image", a.hausdorff_mesh_to_image, b.hausdorff_mesh_to_image, largest),
        ("image to mesh", a.hausdorff_image_to_mesh, b.hausdorff_image_to_mesh, largest),
        ("mean, mesh to image", a.mean_mesh_to_image, b.mean_mesh_to_image, 0.1),
        ("mean, image to mesh", a.mean_image_to_mesh, b.mean_image_to_mesh, 0.1),
    ] {
        assert!((a - b).abs() < bound, "{name}, {what}: {a} and {b}");
    }
}

#[test]
fn many_short_runs_end_in_clean_meshes() {
    let _watchdog = Watchdog::new("many_short_runs_end_in_clean_meshes");
    let subjects = small_subjects();
    let alone: Vec<Outcome> = subjects.iter().map(|subject| outcome(subject, &Schedule::solo(), true)).collect();
    let runs = std::env::var("LAPD_STRESS_RUNS").map_or(RUNS, |runs| runs.parse().expect("LAPD_STRESS_RUNS: a number"));
    let mut lost = Overhead::default();
    let mut ratios = vec![Vec::new(); subjects.len()];
    for run in 0..runs {
        // Counted through like a clock's hands, so that each meets each.
        let (threads, rest) = ([2, 3, 4, 8, 16][run % 5], run / 5);
        let (manager, rest) = (MANAGERS[rest % 4], rest / 4);
        let (scheme, rest) = (SCHEMES[rest % 2], rest / 2);
        let which = (rest + run) % subjects.len();
        let together = outcome(&subjects[which], &team(threads, manager, scheme), true);
        // Of few vertices a few more are many, and the largest distance is that of one corner that got a vertex or not.
        assert_alike(subjects[which].name, &alone[which], &together, 0.2, 0.5);
        ratios[which].push(together.vertices as f64 / alone[which].vertices as f64);
        lost.add(&together.overhead());
    }
    println!("{runs} runs: {lost:?}");
    for (subject, ratios) in subjects.iter().zip(ratios).filter(|(_, ratios)| !ratios.is_empty()) {
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let range = ratios.iter().fold([f64::INFINITY, 0.0_f64], |[low, high], &r| [low.min(r), high.max(r)]);
        println!("{}: vertices {mean:.3} times those of one thread, {range:.3?}", subject.name);
        assert!(ratios.len() < 10 || (mean - 1.0).abs() < 0.06, "{}: {mean} times the vertices", subject.name);
    }
    if cfg!(feature = "force-conflicts") {
        // R2 is next to never the first that applies, and few samples are inserted by one thread.
        let [.., r3, r4, r5, r6] = lost.rollbacks;
        assert!([r3, r4, r5, r6].iter().all(|&count| count > 0), "a rule met no conflict: {:?}", lost.rollbacks);
    }
}

#[test]
fn several_threads_mesh_as_well_as_one() {
    let _watchdog = Watchdog::new("several_threads_mesh_as_well_as_one");
    let subject = large_subject();
    let alone = outcome(&subject, &Schedule::solo(), true);
    assert!(alone.vertices > 20_000, "{}", alone.vertices);
    for (threads, manager, scheme) in [
        (2, Contention::Local, Begging::ByLevel),
        (4, Contention::Global, Begging::Flat),
        (16, Contention::Local, Begging::ByLevel),
    ] {
        let together = outcome(&subject, &team(threads, manager, scheme), true);
        println!(
            "{threads} threads, {manager:?}: {} vertices, {} with one; {:?}",
            together.vertices,
            alone.vertices,
            together.overhead()
        );
        assert_alike(subject.name, &alone, &together, 0.02, 0.25);
        let dihedral = |outcome: &Outcome| outcome.quality.mean_radius_edge;
        assert!((dihedral(&alone) / dihedral(&together) - 1.0).abs() < 0.02);
        assert_eq!(together.refinement.threads.len(), threads);
    }
}

/// Where samples are many all threads insert them at once.
#[test]
fn several_threads_insert_the_samples() {
    let _watchdog = Watchdog::new("several_threads_insert_the_samples");
    let subject = sampled_subject();
    let alone = outcome(&subject, &Schedule::solo(), true);
    for (threads, manager) in
        [(2, Contention::Local), (4, Contention::Aggressive), (4, Contention::Local), (4, Contention::Global)]
    {
        let together = outcome(&subject, &team(threads, manager, Begging::ByLevel), true);
        println!("{threads} threads, {manager:?}: {} vertices, {} with one", together.vertices, alone.vertices);
        assert_alike(subject.name, &alone, &together, 0.02, 0.25);
        let parts = together.refinement.threads.iter().map(|thread| thread.work.by_rule[0]);
        let shares = parts.filter(|&samples| samples > 0).count();
        assert_eq!(shares, threads, "threads that inserted samples");
        let conflicts = together.overhead().rollbacks[0];
        assert!(!cfg!(feature = "force-conflicts") || conflicts > 1000, "{conflicts} conflicts of samples");
    }
}

/// Many more threads than processors slow each other down by little: who waits leaves the processor to others.
#[test]
fn more_threads_than_processors_do_not_crawl() {
    let _watchdog = Watchdog::new("more_threads_than_processors_do_not_crawl");
    let subject = large_subject();
    let alone = outcome(&subject, &Schedule::solo(), true).seconds;
    for manager in MANAGERS {
        // The best of three: the machine may have other work.
        let runs = (0..3).map(|_| outcome(&subject, &team(16, manager, Begging::ByLevel), true).seconds);
        let together = runs.fold(f64::INFINITY, f64::min);
        println!("{manager:?}: {together:.3} s with 16 threads, {alone:.3} s with one");
        // Those who are refused by force wait for no reason.
        let bound = if cfg!(feature = "force-conflicts") { 40.0 } else { 4.0 };
        assert!(together < bound * alone, "{manager:?}: {together} s with 16 threads, {alone} s with one");
    }
}

#[test]
fn a_limit_of_vertices_is_never_exceeded() {
    let _watchdog = Watchdog::new("a_limit_of_vertices_is_never_exceeded");
    let subject = large_subject();
    // While samples are inserted by one thread, by all, and when circumcenters are.
    for most in [500, 7000, 15_000] {
        for threads in [1, 2, 8] {
            let limits = Limits { max_vertices: Some(most), ..Limits::default() };
            let schedule = Schedule { limits, ..team(threads, Contention::Local, Begging::ByLevel) };
            let ended = outcome(&subject, &schedule, false);
            assert!(matches!(ended.refinement.ended_by, Some(Error::LimitReached(_))));
            let vertices = ended.vertices as usize;
            // With several threads some permits are with those that do not need them.
            let unused = if threads == 1 { 0 } else { 64 * threads };
            assert!(
                (most.saturating_sub(unused)..=most).contains(&vertices),
                "{threads} threads: {vertices} of {most}"
            );
        }
    }
}

#[test]
fn limits_of_time_and_memory_end_all_threads() {
    let _watchdog = Watchdog::new("limits_of_time_and_memory_end_all_threads");
    let subject = large_subject();
    let alone = outcome(&subject, &Schedule::solo(), true).seconds;
    for threads in [2, 8] {
        for part in [0.01, 0.05, 0.1] {
            let deadline = Some((Instant::now() + Duration::from_secs_f64(part * alone), part * alone));
            let limits = Limits { deadline, ..Limits::default() };
            let schedule = Schedule { limits, ..team(threads, Contention::Global, Begging::Flat) };
            let ended = outcome(&subject, &schedule, false);
            assert!(matches!(ended.refinement.ended_by, Some(Error::TimeLimit(_))));
        }
        let limits = Limits { max_memory: Some(12 << 20), bytes_per_slot: 60, ..Limits::default() };
        let schedule = Schedule { limits, ..team(threads, Contention::Random, Begging::Flat) };
        let ended = outcome(&subject, &schedule, false);
        assert!(matches!(ended.refinement.ended_by, Some(Error::MemoryLimit(_))));
    }
}

/// Meshes the large subject with four threads; the callback is called on any of them.
fn mesh_reporting(
    report: &mut (dyn FnMut(Progress) -> bool + Send),
    flag: &CancelFlag,
) -> (Result<Meshing, Error>, f64) {
    let Subject { image, params, .. } = large_subject();
    let params = MeshParams { threads: 4, delta: 0.5 * params.delta, size: params.delta, ..params };
    let mut report = |progress| report(progress);
    let clock = Instant::now();
    (mesh_image(&image, &params, &Monitor::new(Some(&mut report), Some(flag))), clock.elapsed().as_secs_f64())
}

#[test]
fn a_cancel_ends_all_threads() {
    let _watchdog = Watchdog::new("a_cancel_ends_all_threads");
    for calls_before in [1, 3, 6] {
        let (mut calls, mut asked) = (0, None);
        let flag = CancelFlag::default();
        let mut raise = |progress: Progress| {
            calls += i32::from(progress.phase == Phase::Refine);
            if calls == calls_before {
                flag.cancel();
                asked.get_or_insert_with(Instant::now);
            }
            true
        };
        let (result, _) = mesh_reporting(&mut raise, &flag);
        let took = asked.expect("refinement reports often enough").elapsed();
        assert!(matches!(result, Err(Error::Cancelled)));
        assert!(took < Duration::from_secs(1), "{took:?} to cancel after {calls_before} reports");
    }
}

/// Those that refine have the cores of their places while they do; no other thread of the run ever has, nor has the caller afterwards.
#[cfg(target_os = "linux")]
#[test]
fn threads_are_bound_while_they_refine() {
    use lapd::system::binding::{Places, allowed};
    let _watchdog = Watchdog::new("threads_are_bound_while_they_refine");
    let before = allowed().unwrap();
    let places = Places::new(&Machine::of_system()).unwrap();
    let Subject { image, params, .. } = large_subject();
    for threads in [1, 4] {
        let params =
            MeshParams { threads, bind: true, delta: 0.5 * params.delta, size: params.delta, ..params.clone() };
        let mut seen = Vec::new();
        let mut look = |progress: Progress| {
            seen.push((progress.phase, allowed().unwrap()));
            true
        };
        mesh_image(&image, &params, &Monitor::new(Some(&mut look), None)).unwrap();
        assert_eq!(allowed().unwrap(), before);
        let refining = |(phase, _): &(Phase, _)| *phase == Phase::Refine;
        let (refining, others): (Vec<_>, Vec<_>) = seen.into_iter().partition(refining);
        assert!(others.iter().all(|(_, processors)| *processors == before), "{others:?}");
        // The first report comes before the sampling, which all threads do.
        assert!(refining.len() > 1, "refinement reports often enough");
        let bound = |processors: &[usize]| (0..threads).any(|worker| places.of_worker(worker) == processors);
        assert!(refining[1..].iter().all(|(_, processors)| bound(processors)), "{refining:?}");
    }
}

#[test]
fn a_panic_in_a_worker_ends_all_threads() {
    let _watchdog = Watchdog::new("a_panic_in_a_worker_ends_all_threads");
    let mut at = None;
    let mut panics = |_| {
        if std::thread::current().name().is_some_and(|name| name.starts_with("lapd-")) {
            at.get_or_insert_with(Instant::now);
            panic!("the host's own bug");
        }
        true
    };
    let (result, _) = mesh_reporting(&mut panics, &CancelFlag::default());
    let took = at.expect("a worker reports sooner or later").elapsed();
    match result {
        Err(Error::Internal(line)) => assert!(line.contains("the host's own bug"), "{line}"),
        other => panic!("{:?}", other.map(|meshing| meshing.ended_by)),
    }
    assert!(took < Duration::from_secs(1), "{took:?}");
}
