//! Parallel refinement under stress: many threads on few processors, every contention manager, both
//! begging schemes, on small phantoms; what several threads make against what one makes; and every
//! way in which a run can end early.
//!
//! After each run the validator goes over the triangulation, no tet may be owned, no rule unmet,
//! and the certificate of the mesh must be clean.
//!
//! With the feature `force-conflicts`, and `LAPD_FORCE_CONFLICTS` set, the same tests run while
//! locks are refused at random at every step of an operation. `LAPD_STRESS_RUNS` is the number of
//! runs of the stress test, for builds that are slow (`verification/run.sh`).

mod refining;

use std::time::{Duration, Instant};

use lapd::Error;
use lapd::monitor::{CancelFlag, Monitor, Phase, Progress};
use lapd::parallel::machine::Machine;
use lapd::params::{Adaptive, Begging, Contention, MeshParams};
use lapd::pipeline::mesh_image;
use lapd::refine::activity::Overhead;
use lapd::refine::options::{Limits, RefineOptions};
use refining::*;

/// Runs of the stress test, all with several threads.
const RUNS: usize = 200;
const SCHEMES: [Begging; 2] = [Begging::ByLevel, Begging::Flat];

fn team(threads: usize, contention: Contention, begging: Begging) -> RefineOptions {
    // Two nodes, so that begging has levels.
    RefineOptions {
        threads,
        contention,
        begging,
        machine: Machine::uniform(2, threads.div_ceil(2)),
        ..RefineOptions::solo()
    }
}

#[test]
fn many_short_runs_end_in_clean_meshes() {
    let _watchdog = Watchdog::new("many_short_runs_end_in_clean_meshes");
    let subjects = small_subjects();
    let alone: Vec<Outcome> =
        subjects.iter().map(|subject| outcome(subject, &RefineOptions::solo(), true)).collect();
    let runs = std::env::var("LAPD_STRESS_RUNS")
        .map_or(RUNS, |runs| runs.parse().expect("LAPD_STRESS_RUNS: a number"));
    let mut lost = Overhead::default();
    let mut ratios = vec![Vec::new(); subjects.len()];
    for run in 0..runs {
        // Counted through like a clock's hands, so that each meets each.
        let (threads, rest) = ([2, 3, 4, 8, 16][run % 5], run / 5);
        let (manager, rest) = (MANAGERS[rest % 4], rest / 4);
        let (scheme, rest) = (SCHEMES[rest % 2], rest / 2);
        let which = (rest + run) % subjects.len();
        let together = outcome(&subjects[which], &team(threads, manager, scheme), true);
        // Of few vertices a few more are many, and the largest distance is that of one corner that
        // got a vertex or not.
        assert_alike(subjects[which].name, &alone[which], &together, 0.2, 0.5);
        ratios[which].push(together.vertices as f64 / alone[which].vertices as f64);
        lost.add(&together.overhead());
    }
    println!("{runs} runs: {lost:?}");
    for (subject, ratios) in subjects.iter().zip(ratios).filter(|(_, ratios)| !ratios.is_empty()) {
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let range = ratios
            .iter()
            .fold([f64::INFINITY, 0.0_f64], |[low, high], &r| [low.min(r), high.max(r)]);
        println!("{}: vertices {mean:.3} times those of one thread, {range:.3?}", subject.name);
        assert!(
            ratios.len() < 10 || (mean - 1.0).abs() < 0.06,
            "{}: {mean} times the vertices",
            subject.name
        );
    }
    if conflicts_are_forced() {
        // R2 is next to never the first that applies, and few samples are inserted by one thread.
        let [.., r3, r4, r5, r6] = lost.rollbacks;
        assert!(
            [r3, r4, r5, r6].iter().all(|&count| count > 0),
            "a rule met no conflict: {:?}",
            lost.rollbacks
        );
    }
}

#[test]
fn several_threads_mesh_as_well_as_one() {
    let _watchdog = Watchdog::new("several_threads_mesh_as_well_as_one");
    let subject = large_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true);
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
        let ratio = |outcome: &Outcome| outcome.quality.mean_radius_edge;
        assert!((ratio(&alone) / ratio(&together) - 1.0).abs() < 0.02);
        assert_eq!(together.refinement.threads.len(), threads);
    }
}

/// Where samples are many all threads insert them at once.
#[test]
fn several_threads_insert_the_samples() {
    let _watchdog = Watchdog::new("several_threads_insert_the_samples");
    let subject = sampled_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true);
    for (threads, manager) in [
        (2, Contention::Local),
        (4, Contention::Aggressive),
        (4, Contention::Local),
        (4, Contention::Global),
    ] {
        let together = outcome(&subject, &team(threads, manager, Begging::ByLevel), true);
        println!(
            "{threads} threads, {manager:?}: {} vertices, {} with one",
            together.vertices, alone.vertices
        );
        assert_alike(subject.name, &alone, &together, 0.02, 0.25);
        let parts = together.refinement.threads.iter().map(|thread| thread.work.by_rule[0]);
        let shares = parts.filter(|&samples| samples > 0).count();
        assert_eq!(shares, threads, "threads that inserted samples");
        let conflicts = together.overhead().rollbacks[0];
        assert!(!conflicts_are_forced() || conflicts > 1000, "{conflicts} conflicts of samples");
    }
}

/// Many more threads than processors slow each other down by little: who waits leaves the processor
/// to others.
#[test]
fn more_threads_than_processors_do_not_crawl() {
    let _watchdog = Watchdog::new("more_threads_than_processors_do_not_crawl");
    let subject = large_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true).seconds;
    for manager in MANAGERS {
        // The best of three: the machine may have other work.
        let runs =
            (0..3).map(|_| outcome(&subject, &team(16, manager, Begging::ByLevel), true).seconds);
        let together = runs.fold(f64::INFINITY, f64::min);
        println!("{manager:?}: {together:.3} s with 16 threads, {alone:.3} s with one");
        // Those who are refused by force wait for no reason.
        let bound = if conflicts_are_forced() { 40.0 } else { 4.0 };
        assert!(
            together < bound * alone,
            "{manager:?}: {together} s with 16 threads, {alone} s with one"
        );
    }
}

#[test]
fn a_limit_of_vertices_is_never_exceeded() {
    let _watchdog = Watchdog::new("a_limit_of_vertices_is_never_exceeded");
    let subject = large_subject();
    // While samples are inserted by one thread, by all, and when circumcenters are.
    for max in [500, 7000, 15_000] {
        for threads in [1, 2, 8] {
            let limits = Limits { max_vertices: Some(max), ..Limits::default() };
            let options =
                RefineOptions { limits, ..team(threads, Contention::Local, Begging::ByLevel) };
            let ended = outcome(&subject, &options, false);
            assert!(matches!(ended.refinement.ended_by, Some(Error::LimitReached(_))));
            let vertices = ended.vertices as usize;
            // With several threads some permits are with those that do not need them.
            let unused = if threads == 1 { 0 } else { 64 * threads };
            assert!(
                (max.saturating_sub(unused)..=max).contains(&vertices),
                "{threads} threads: {vertices} of {max}"
            );
        }
    }
}

#[test]
fn limits_of_time_and_memory_end_all_threads() {
    let _watchdog = Watchdog::new("limits_of_time_and_memory_end_all_threads");
    let subject = large_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true).seconds;
    for threads in [2, 8] {
        for part in [0.01, 0.05, 0.1] {
            let deadline =
                Some((Instant::now() + Duration::from_secs_f64(part * alone), part * alone));
            let limits = Limits { deadline, ..Limits::default() };
            let options =
                RefineOptions { limits, ..team(threads, Contention::Global, Begging::Flat) };
            let ended = outcome(&subject, &options, false);
            assert!(matches!(ended.refinement.ended_by, Some(Error::TimeLimit(_))));
        }
        let limits = Limits { max_memory: Some(12 << 20), bytes_per_slot: 60, ..Limits::default() };
        let options = RefineOptions { limits, ..team(threads, Contention::Random, Begging::Flat) };
        let ended = outcome(&subject, &options, false);
        assert!(matches!(ended.refinement.ended_by, Some(Error::MemoryLimit(_))));
    }
}

fn four_threads() -> MeshParams {
    MeshParams { threads: 4, ..MeshParams::default() }
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
        let (result, _) = mesh_reporting(four_threads(), &mut raise, &flag);
        let took = asked.expect("refinement reports often enough").elapsed();
        assert!(matches!(result, Err(Error::Cancelled)));
        assert!(took < Duration::from_secs(1), "{took:?} to cancel after {calls_before} reports");
    }
}

/// Those that refine have the cores of their places while they do; no other thread of the run ever
/// has, nor has the caller afterwards.
#[cfg(target_os = "linux")]
#[test]
fn threads_are_bound_while_they_refine() {
    use lapd::system::binding::{CoreMap, allowed};
    let _watchdog = Watchdog::new("threads_are_bound_while_they_refine");
    let before = allowed().unwrap();
    let places = CoreMap::new(&Machine::of_system()).unwrap();
    let Subject { image, params, .. } = large_subject();
    for threads in [1, 4] {
        // Threads that compare the mesh with the image are not bound.
        let params = MeshParams {
            threads,
            bind: true,
            adaptive: Adaptive::Thickness,
            delta: 0.5 * params.delta,
            size: params.delta,
            ..params.clone()
        };
        let mut seen = Vec::new();
        let mut look = |progress: Progress| {
            seen.push((progress.phase, progress.tets, allowed().unwrap()));
            true
        };
        mesh_image(&image, &params, &Monitor::new(Some(&mut look), None)).unwrap();
        assert_eq!(allowed().unwrap(), before);
        let (refining, others): (Vec<_>, Vec<_>) =
            seen.into_iter().partition(|(phase, _, _)| *phase == Phase::Refine);
        assert!(others.iter().all(|(_, _, processors)| *processors == before), "{others:?}");
        let bound = |processors: &[usize]| {
            (0..threads).any(|worker| places.of_worker(worker) == processors)
        };
        // Before there are tets, the image is sampled, by threads that are not bound.
        let sampling = |tets: u64, processors: &[usize]| {
            tets == 0 && !bound(processors) && processors == before
        };
        let sampled =
            refining.iter().take_while(|(_, tets, processors)| sampling(*tets, processors)).count();
        assert!(sampled < refining.len(), "refinement reports often enough");
        assert!(
            refining[sampled..].iter().all(|(_, _, processors)| bound(processors)),
            "{refining:?}"
        );
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
    let (result, _) = mesh_reporting(four_threads(), &mut panics, &CancelFlag::default());
    let took = at.expect("a worker reports sooner or later").elapsed();
    match result {
        Err(Error::Internal(line)) => assert!(line.contains("the host's own bug"), "{line}"),
        other => panic!("{:?}", other.map(|meshing| meshing.ended_by)),
    }
    assert!(took < Duration::from_secs(1), "{took:?}");
}
