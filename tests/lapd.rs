//! LAPD under stress, as `tests/podm.rs` does it for PODM: what the threads of several memory nodes
//! make against what one thread makes, on synthetic machines with many more cores than there are
//! processors; every way in which a run can end early; one memory node; and where the memory was
//! that operations visited.

mod refining;

use std::time::{Duration, Instant};

use lapd::Error;
use lapd::delaunay::TetId;
use lapd::monitor::{CancelFlag, Monitor, Phase, Progress};
use lapd::parallel::machine::Machine;
use lapd::params::{Algorithm, Contention, MeshParams};
use lapd::pipeline::mesh_image;
use lapd::pipeline::refine::triangulation_around;
use lapd::refine::activity::{Accesses, Overhead};
use lapd::refine::options::{Limits, RefineOptions};
use lapd::refine::refine;
use lapd::refine::rules::Rules;
use lapd::sizing::Sizing;
use lapd::system::binding::CoreMap;
use refining::*;

/// Runs of the stress test.
const RUNS: usize = 60;

fn team(machine: Machine, threads: usize, contention: Contention) -> RefineOptions {
    RefineOptions {
        threads,
        contention,
        algorithm: Algorithm::Lapd,
        machine,
        ..RefineOptions::solo()
    }
}

/// The visits of all threads.
fn accesses(outcome: &Outcome) -> Accesses {
    let mut sum = Accesses::default();
    outcome.refinement.threads.iter().for_each(|thread| sum.add(&thread.accesses));
    sum
}

#[test]
fn many_short_runs_on_several_nodes_end_in_clean_meshes() {
    let _watchdog = Watchdog::new("many_short_runs_on_several_nodes_end_in_clean_meshes");
    let subjects = small_subjects();
    let alone: Vec<Outcome> =
        subjects.iter().map(|subject| outcome(subject, &RefineOptions::solo(), true)).collect();
    let runs = std::env::var("LAPD_STRESS_RUNS")
        .map_or(RUNS, |runs| runs.parse().expect("LAPD_STRESS_RUNS: a number"));
    let mut lost = Overhead::default();
    for run in 0..runs {
        let (nodes, rest) = ([2, 4, 8][run % 3], run / 3);
        let (cores, rest) = ([1, 2, 3][rest % 3], rest / 3);
        let (manager, rest) = (MANAGERS[rest % 4], rest / 4);
        // Fewer threads than cores, as many, and more: then some nodes have one more than others.
        let threads = (nodes * cores + rest % 3).saturating_sub(1).max(2);
        let which = (rest + run) % subjects.len();
        let options = RefineOptions {
            halving: run % 4 == 3,
            count_accesses: run % 5 == 4,
            ..team(Machine::uniform(nodes, cores), threads, manager)
        };
        let together = outcome(&subjects[which], &options, true);
        assert_alike(subjects[which].name, &alone[which], &together, 0.2, 0.5);
        lost.add(&together.overhead());
    }
    println!("{runs} runs: {lost:?}");
    assert!(runs < 10 || lost.gifts > 0, "nothing was handed over");
    let rollbacks: u64 = lost.rollbacks.iter().sum();
    assert!(!conflicts_are_forced() || rollbacks > 1000, "{rollbacks} rollbacks");
}

/// How much less LAPD visits far memory is held against a bar where it is the same in every run: in
/// virtual time, by `remote_visits_are_less_than_half_of_podms` in src/simulation/tests.rs. Here it
/// depends on which threads the system lets run.
#[test]
fn several_nodes_mesh_as_well_as_one_thread() {
    let _watchdog = Watchdog::new("several_nodes_mesh_as_well_as_one_thread");
    let subject = large_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true);
    for (name, machine, threads) in [
        ("2 nodes of 2", Machine::uniform(2, 2), 4),
        ("4 nodes of 2", Machine::uniform(4, 2), 8),
        ("8 nodes of 1", Machine::uniform(8, 1), 8),
        ("Blacklight, 2 blades", Machine::blacklight(2), 32),
    ] {
        let share = |algorithm| {
            let machine = machine.clone();
            let options = RefineOptions {
                algorithm,
                count_accesses: true,
                ..team(machine, threads, Contention::default())
            };
            let together = outcome(&subject, &options, true);
            assert_alike(subject.name, &alone, &together, 0.03, 0.3);
            let ratio = alone.quality.mean_radius_edge / together.quality.mean_radius_edge;
            assert!((ratio - 1.0).abs() < 0.02, "{name}: mean radius-edge ratio");
            let visits = accesses(&together);
            assert!(visits.local() > 0 && visits.remote() > 0, "{name}: {visits:?}");
            100.0 * visits.remote_share()
        };
        let (podm, lapd) = (share(Algorithm::Podm), share(Algorithm::Lapd));
        println!("{name}: {podm:.1} % of visits remote under PODM, {lapd:.1} % under LAPD");
    }
}

/// Where samples are many, each node inserts those of its own region.
#[test]
fn nodes_insert_the_samples_of_their_regions() {
    let _watchdog = Watchdog::new("nodes_insert_the_samples_of_their_regions");
    let subject = sampled_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true);
    for halving in [false, true] {
        let options =
            RefineOptions { halving, ..team(Machine::uniform(4, 1), 4, Contention::Local) };
        let together = outcome(&subject, &options, true);
        assert_alike(subject.name, &alone, &together, 0.02, 0.25);
        let parts: Vec<u64> =
            together.refinement.threads.iter().map(|thread| thread.work.by_rule[0]).collect();
        let mean = parts.iter().sum::<u64>() as f64 / 4.0;
        println!("halving {halving}: samples by node: {parts:?}");
        // Those that each pair of nodes may share are a quarter, those that all may share a part of
        // the rest.
        let spread = if halving { 0.8 } else { 0.3 };
        assert!(parts.iter().all(|&part| (part as f64 / mean - 1.0).abs() < spread), "{parts:?}");
    }
}

#[test]
fn on_one_node_it_is_podm() {
    let Subject { image, params, .. } = &small_subjects()[0];
    let mesh = |params: &MeshParams| {
        let made = mesh_image(image, params, &Monitor::silent()).unwrap();
        (
            made.mesh.points,
            made.mesh.tets,
            made.mesh.labels,
            made.report.operations,
            made.report.work,
        )
    };
    let podm = mesh(params);
    let machine = Some(Machine::uniform(4, 2));
    for params in [
        MeshParams { algorithm: Algorithm::Lapd, ..params.clone() },
        MeshParams { algorithm: Algorithm::Lapd, machine, count_accesses: true, ..params.clone() },
    ] {
        assert!(podm == mesh(&params), "one thread made another mesh");
    }
    // Several threads on one node beg from each other, and hand nothing over.
    let options = team(Machine::one_node(4), 4, Contention::Local);
    let subject = large_subject();
    let counted = RefineOptions { count_accesses: true, ..options };
    let together = outcome(&subject, &counted, true);
    let accesses = accesses(&together);
    assert!(accesses.local() > 0 && accesses.remote() == 0, "{accesses:?}");
}

#[test]
fn visits_are_counted_by_hops_when_asked() {
    let subject = large_subject();
    let hops = vec![vec![0, 1, 3], vec![1, 0, 2], vec![3, 2, 0]];
    let machine = Machine::new(vec![1, 1, 1], hops).unwrap();
    let options = team(machine, 3, Contention::Local);
    let silent = outcome(&subject, &options, true);
    assert_eq!(accesses(&silent), Accesses::default());
    let counted = outcome(&subject, &RefineOptions { count_accesses: true, ..options }, true);
    let sum = accesses(&counted);
    let counters = counted.refinement.counters;
    assert_eq!(sum.by_hops.len(), 4);
    // The first and the last node are neighbours of each other too; all tets that are tested and
    // made are visited, and their vertices.
    assert!(sum.by_hops.iter().all(|&visits| visits > 0), "{sum:?}");
    assert!(sum.local() + sum.remote() > counters.in_sphere_tests + counters.created);
    assert!(sum.remote() <= sum.hops() && sum.hops() <= 3 * sum.remote());
}

#[test]
fn a_limit_of_vertices_ends_all_nodes() {
    let _watchdog = Watchdog::new("a_limit_of_vertices_ends_all_nodes");
    let subject = large_subject();
    for max in [500, 7000, 15_000] {
        let limits = Limits { max_vertices: Some(max), ..Limits::default() };
        let options =
            RefineOptions { limits, ..team(Machine::uniform(4, 2), 8, Contention::Local) };
        let ended = outcome(&subject, &options, false);
        assert!(matches!(ended.refinement.ended_by, Some(Error::LimitReached(_))));
        let vertices = ended.vertices as usize;
        assert!((max.saturating_sub(64 * 8)..=max).contains(&vertices), "{vertices} of {max}");
    }
}

#[test]
fn limits_of_time_and_memory_end_all_nodes() {
    let _watchdog = Watchdog::new("limits_of_time_and_memory_end_all_nodes");
    let subject = large_subject();
    let alone = outcome(&subject, &RefineOptions::solo(), true).seconds;
    for part in [0.01, 0.05, 0.1] {
        let deadline = Some((Instant::now() + Duration::from_secs_f64(part * alone), part * alone));
        let limits = Limits { deadline, ..Limits::default() };
        let options =
            RefineOptions { limits, ..team(Machine::uniform(2, 3), 6, Contention::Global) };
        let ended = outcome(&subject, &options, false);
        assert!(matches!(ended.refinement.ended_by, Some(Error::TimeLimit(_))));
    }
    let limits = Limits { max_memory: Some(12 << 20), bytes_per_slot: 60, ..Limits::default() };
    let options = RefineOptions { limits, ..team(Machine::uniform(4, 1), 4, Contention::Random) };
    let ended = outcome(&subject, &options, false);
    assert!(matches!(ended.refinement.ended_by, Some(Error::MemoryLimit(_))));
}

fn four_nodes() -> MeshParams {
    MeshParams {
        threads: 4,
        algorithm: Algorithm::Lapd,
        machine: Some(Machine::uniform(4, 1)),
        ..MeshParams::default()
    }
}

#[test]
fn a_cancel_ends_all_nodes() {
    let _watchdog = Watchdog::new("a_cancel_ends_all_nodes");
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
        let (result, _) = mesh_reporting(four_nodes(), &mut raise, &flag);
        let took = asked.expect("refinement reports often enough").elapsed();
        assert!(matches!(result, Err(Error::Cancelled)));
        assert!(took < Duration::from_secs(1), "{took:?} to cancel after {calls_before} reports");
    }
}

#[test]
fn a_panic_on_a_node_ends_all_nodes() {
    let _watchdog = Watchdog::new("a_panic_on_a_node_ends_all_nodes");
    let mut at = None;
    let mut panics = |_| {
        if std::thread::current().name().is_some_and(|name| name.starts_with("lapd-")) {
            at.get_or_insert_with(Instant::now);
            panic!("the host's own bug");
        }
        true
    };
    let (result, _) = mesh_reporting(four_nodes(), &mut panics, &CancelFlag::default());
    let took = at.expect("a worker reports sooner or later").elapsed();
    match result {
        Err(Error::Internal(line)) => assert!(line.contains("the host's own bug"), "{line}"),
        other => panic!("{:?}", other.map(|meshing| meshing.ended_by)),
    }
    assert!(took < Duration::from_secs(1), "{took:?}");
}

/// The system's number of each memory node of a machine; `None` where it does not tell.
#[cfg(target_os = "linux")]
fn system_nodes(machine: &Machine) -> Option<Vec<i32>> {
    let mut numbers = vec![None; machine.nodes()];
    for core in machine.all_cores() {
        let folder = format!("/sys/devices/system/cpu/cpu{}", core.processors.first()?);
        let entries = std::fs::read_dir(folder).ok()?;
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        numbers[core.node] =
            names.filter_map(|name| name.strip_prefix("node")?.parse().ok()).next();
    }
    numbers.into_iter().collect()
}

/// The system itself says where pages are. On a machine of one node that is this node.
#[cfg(target_os = "linux")]
#[test]
fn tets_lie_in_the_memory_of_their_node() {
    const PAGE: usize = 4096;
    let machine = Machine::of_system();
    let (nodes, map) = (system_nodes(&machine), CoreMap::new(&machine));
    let (Some(nodes), Ok(map)) = (nodes, map) else {
        println!("SKIPPED: the system does not tell memory nodes, or binds no threads");
        return;
    };
    let Subject { image, oracle, params, .. } = large_subject();
    let triangulation = triangulation_around(&oracle, params.delta).unwrap();
    let sizing = Sizing::uniform(params.delta);
    let rules = Rules::new(&triangulation, &oracle, &sizing, &params, image.labels());
    let threads = machine.total_cores().min(8);
    let options =
        RefineOptions { places: Some(map), ..team(machine, threads, Contention::default()) };
    refine(&rules, &options, &Monitor::silent()).unwrap();
    let tets: Vec<TetId> = triangulation.living_tets().step_by(16).collect();
    let page = |&t: &TetId| std::ptr::from_ref(triangulation.tet(t)) as usize & !(PAGE - 1);
    let pages: Vec<usize> = tets.iter().map(page).collect();
    let mut found = vec![-1_i32; pages.len()];
    // SAFETY: without a list of nodes the call moves nothing. It reads as many addresses and writes
    // as many answers as is said.
    let status = unsafe {
        libc::syscall(
            libc::SYS_move_pages,
            0,
            pages.len(),
            pages.as_ptr(),
            std::ptr::null::<i32>(),
            found.as_mut_ptr(),
            0,
        )
    };
    if status != 0 {
        println!("SKIPPED: move_pages: {}", std::io::Error::last_os_error());
        return;
    }
    let map = triangulation.node_map();
    let elsewhere =
        tets.iter().zip(&found).filter(|&(&t, &at)| at != nodes[usize::from(map.of_tet(t))]);
    assert_eq!(elsewhere.count(), 0, "of {} tets", tets.len());
}
