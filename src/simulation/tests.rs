//! Simulated refinements: as deterministic as a lone worker's, as sound as real ones, and of the
//! speed that real ones have where these can be measured.

use std::path::PathBuf;

use glam::DVec3;

use super::course::STEADY;
use super::platform::{Costs, Level, Network, Platform};
use super::world::Traffic;
use super::{Simulated, simulate};
use crate::image::LabelImage;
use crate::image::phantom::{nested_shells, torus};
use crate::io::read::read_image;
use crate::mesh::extract::Background;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::parallel::machine::Machine;
use crate::params::{Algorithm, Begging, CertificateLevel, Contention, MeshParams};
use crate::pipeline::finish::measure;
use crate::pipeline::refine::{Ordered, number, triangulation_around};
use crate::refine::activity::Doing;
use crate::refine::options::RefineOptions;
use crate::refine::rules::Rules;
use crate::refine::{Asked, examine, refine};
use crate::sizing::Sizing;
use crate::verify::{Examined, Extent};

struct Subject {
    image: LabelImage,
    oracle: Oracle,
    params: MeshParams,
}

impl Subject {
    fn new(image: LabelImage, delta: f64) -> Self {
        let params = MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() };
        let oracle = Oracle::new(&image, params.surface, &|| Ok(())).unwrap();
        Self { image, oracle, params }
    }

    /// Octants in a ball: every rule has work.
    fn octants(delta: f64) -> Self {
        let ball = nested_shells([32; 3], [1.0, 0.9, 1.1], &[13.0]).unwrap();
        let octant =
            |p: DVec3| i32::from(p.x > 0.0) + 2 * i32::from(p.y > 0.0) + 4 * i32::from(p.z > 0.0);
        let label = |p: DVec3| if p.length() < 13.0 { 1 + octant(p) } else { 0 };
        Self::new(LabelImage::from_fn(ball.dims(), *ball.frame(), label).unwrap(), delta)
    }

    /// What `work` gives, with all tets of the triangulation that it leaves, in the order of their
    /// slots. The mesh is sound and complete.
    fn with_rules<T>(
        &self,
        what: &str,
        work: impl FnOnce(&Rules<'_>) -> crate::Result<T>,
    ) -> (T, Vec<[u32; 4]>) {
        let Self { image, oracle, params } = self;
        let monitor = Monitor::silent();
        let triangulation = triangulation_around(oracle, params.delta).unwrap();
        let sizing = Sizing::uniform(params.delta);
        let rules = Rules::new(&triangulation, oracle, &sizing, params, image.labels());
        let done = work(&rules).unwrap_or_else(|error| panic!("{what}: {error}"));
        let Ordered { numbered, order } =
            number(&rules, image.labels(), Background::Dropped, &monitor).unwrap();
        let mut mesh = numbered.copy(triangulation.tets(), &monitor).unwrap();
        let (check, unmet) = examine(&rules, &order, Asked::All, &monitor).unwrap();
        assert!(check.is_sound(), "{what}: {check:?}");
        assert_eq!(
            triangulation.left_over(),
            0,
            "{what}: tets owned or free slots that do not say so"
        );
        assert_eq!(unmet, [0; 6], "{what}: unmet rules");
        mesh.collect_facets(&monitor).unwrap();
        let (level, check_memory) = (CertificateLevel::Sound, &|_| Ok(()));
        let extent = Extent { level, distances_until: None, check_memory };
        let (_, certificate, _) =
            measure(&mesh, image, oracle, Examined::default(), &[], extent, &monitor).unwrap();
        let defects =
            [certificate.inverted_tets, certificate.orphan_vertices, certificate.open_edges];
        assert_eq!(defects, [0; 3], "{what}: inverted tets, orphan vertices, open edges");
        let tets = triangulation.living_tets().map(|t| triangulation.tet(t).vertices()).collect();
        (done, tets)
    }

    fn simulate(
        &self,
        what: &str,
        options: &RefineOptions,
        platform: &Platform,
    ) -> (Simulated, Vec<[u32; 4]>) {
        self.with_rules(what, |rules| simulate(rules, options, platform, &Monitor::silent()))
    }
}

/// Nodes of four cores, two to a router.
fn platform(nodes: usize) -> Platform {
    let levels = vec![Level { nodes: 2, service: 20.0 }, Level { nodes: 64, service: 50.0 }];
    Platform {
        machine: Machine::uniform(nodes, 4),
        costs: Costs::default(),
        network: Network { hop: 300.0, levels },
        cached_records: u32::MAX,
    }
}

fn options(platform: &Platform) -> RefineOptions {
    RefineOptions {
        threads: platform.machine.total_cores(),
        machine: platform.machine.clone(),
        ..RefineOptions::solo()
    }
}

#[test]
fn two_runs_are_the_same() {
    let (subject, platform) = (Subject::octants(0.8), platform(4));
    for algorithm in [Algorithm::Podm, Algorithm::Lapd] {
        let options = RefineOptions { algorithm, ..options(&platform) };
        let what = format!("{algorithm:?}");
        let (one, tets) = subject.simulate(&what, &options, &platform);
        let (other, other_tets) = subject.simulate(&what, &options, &platform);
        assert!(tets == other_tets, "{what}: two meshes");
        assert_eq!(
            (one.seconds, &one.course, one.tally),
            (other.seconds, &other.course, other.tally),
            "{what}"
        );
        assert_eq!(one.traffic, other.traffic, "{what}");
        let overheads = |run: &Simulated| {
            run.refinement.threads.iter().map(|one| one.overhead).collect::<Vec<_>>()
        };
        assert_eq!(overheads(&one), overheads(&other), "{what}");
        assert!(one.refinement.counters.rollbacks > 0, "{what}: nobody met anybody");
    }
}

#[test]
fn one_worker_does_what_a_lone_thread_does() {
    let (subject, one) =
        (Subject::octants(0.8), Platform { machine: Machine::one_node(1), ..platform(1) });
    let (real, tets) = subject
        .with_rules("real", |rules| refine(rules, &RefineOptions::solo(), &Monitor::silent()));
    let (simulated, simulated_tets) = subject.simulate("simulated", &RefineOptions::solo(), &one);
    assert!(tets == simulated_tets);
    assert_eq!(real.counters, simulated.refinement.counters);
    assert_eq!(real.work, simulated.refinement.work);
    assert!(simulated.seconds > 0.0);
    // Costs are all that time is made of.
    let costs = Costs { slowdown: 2.0, ..one.costs };
    let (slower, _) =
        subject.simulate("slower", &RefineOptions::solo(), &Platform { costs, ..one });
    let ratio = slower.seconds / simulated.seconds;
    assert!((ratio - 2.0).abs() < 1e-6, "{ratio}");
}

#[test]
fn many_workers_make_sound_meshes_under_every_manager() {
    let torus = Subject::new(torus([28, 28, 12], [1.0; 3], 8.0, 3.0).unwrap(), 1.2);
    for (number, (subject, sizes)) in
        [(torus, [1, 3]), (Subject::octants(1.2), [3, 12])].iter().enumerate()
    {
        for &nodes in sizes {
            let platform = platform(nodes);
            for contention in
                [Contention::Local, Contention::Global, Contention::Random, Contention::Aggressive]
            {
                for (algorithm, begging) in
                    [(Algorithm::Podm, Begging::Flat), (Algorithm::Lapd, Begging::ByLevel)]
                {
                    let what = format!(
                        "subject {number}, {nodes} nodes, {contention:?}, {algorithm:?}, \
                         {begging:?}"
                    );
                    let options =
                        RefineOptions { contention, algorithm, begging, ..options(&platform) };
                    let (run, _) = subject.simulate(&what, &options, &platform);
                    let threads = &run.refinement.threads;
                    assert_eq!(threads.len(), 4 * nodes, "{what}");
                    for thread in threads {
                        let lost = &thread.overhead;
                        let seconds =
                            lost.rollback_seconds + lost.contention_seconds + lost.idle_seconds;
                        assert!(
                            seconds <= run.seconds * (1.0 + 1e-9),
                            "{what}: {seconds} s of {} lost",
                            run.seconds
                        );
                    }
                    assert_eq!(
                        run.traffic.iter().any(|one| one.travel_seconds > 0.0),
                        nodes > 1,
                        "{what}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_steady_state_is_the_middle_of_a_run() {
    let (subject, platform) = (Subject::octants(0.6), platform(4));
    let workers = platform.machine.total_cores() as f64;
    let run = subject
        .simulate("steady", &RefineOptions { timeline: true, ..options(&platform) }, &platform)
        .0;
    let (steady, all) = (run.steady(), run.mark_at(1.0));
    assert_eq!((all.seconds, all.made), (run.seconds, run.tally.fills));
    assert_eq!(run.traffic.iter().flat_map(|one| &one.fetched_by_hops).sum::<u64>(), all.fetched);
    let part = steady.made as f64 / all.made as f64;
    assert!((part - (STEADY[1] - STEADY[0])).abs() < 0.05, "{part} of all tets");
    let doing: f64 = steady.doing.iter().sum();
    assert!(
        (doing / (workers * steady.seconds) - 1.0).abs() < 1e-6,
        "{doing} s of {workers} workers are accounted for"
    );
    assert!(steady.doing[Doing::Refining as usize] > all.doing[Doing::Refining as usize] * part);
}

#[test]
fn far_data_and_full_routers_cost_time() {
    let (subject, base) = (Subject::octants(0.7), platform(4));
    let seconds = |hop: f64, service: f64| {
        let network = Network { hop, levels: vec![Level { nodes: 4, service }] };
        let run =
            subject.simulate("network", &options(&base), &Platform { network, ..base.clone() }).0;
        (run.seconds, run.traffic.iter().map(|one| one.queue_seconds).sum::<f64>())
    };
    let (near, (far, _), (full, queue)) =
        (seconds(0.0, 0.0), seconds(2000.0, 0.0), seconds(0.0, 1000.0));
    assert!(far > 1.2 * near.0 && full > 1.2 * near.0, "{} s, {far} s far, {full} s full", near.0);
    assert!(near.1 == 0.0 && queue > 0.0);
}

/// The part of all visits that were to memory of other nodes.
fn remote_share(run: &Simulated) -> f64 {
    let visits = |far: bool| -> u64 {
        let of = |one: &Traffic| one.visits_by_hops[usize::from(far)..].iter().sum::<u64>();
        run.traffic.iter().map(of).sum()
    };
    visits(true) as f64 / visits(false) as f64
}

/// What LAPD is for: workers keep to the memory of their node (paper, section 4).
#[test]
fn remote_visits_are_less_than_half_of_podms() {
    let subject = Subject::octants(0.45);
    // Of so small a mesh 32 workers on 8 nodes leave each too little to keep to itself.
    for nodes in [2, 4] {
        let platform = platform(nodes);
        let share = |algorithm| {
            let options = RefineOptions { algorithm, ..options(&platform) };
            remote_share(&subject.simulate("shares", &options, &platform).0)
        };
        let (podm, lapd) = (share(Algorithm::Podm), share(Algorithm::Lapd));
        println!("{nodes} nodes: {podm:.3} of visits remote under PODM, {lapd:.3} under LAPD");
        assert!(lapd < 0.5 * podm, "{nodes} nodes: {lapd} of visits, {podm} under PODM");
    }
}

#[test]
fn more_workers_than_cores_are_refused() {
    let (subject, one) = (Subject::octants(2.0), platform(1));
    let options = RefineOptions { threads: 5, ..RefineOptions::solo() };
    subject.with_rules("refused", |rules| {
        let error = simulate(rules, &options, &one, &Monitor::silent()).unwrap_err();
        assert!(error.to_string().contains("5 workers"), "{error}");
        refine(rules, &RefineOptions::solo(), &Monitor::silent())
    });
}

/// Two threads of the machine on which the costs were measured are 1.82 to 1.85 times as fast as
/// one (docs/notes/benchmarks.md).
#[test]
fn two_workers_are_as_fast_as_was_measured() {
    let folder = std::env::var_os("LAPD_IMAGES").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/images")),
        PathBuf::from,
    );
    let path = folder.join("spl/abdomen.nrrd");
    if !path.exists() {
        println!("SKIPPED: {} is missing, no simulation of the abdomen", path.display());
        return;
    }
    let subject = Subject::new(read_image(&path).unwrap().image, 2.6);
    let two =
        Platform { machine: Machine::one_node(2), network: Network::of_hops(0.0), ..platform(1) };
    let run = |threads| {
        let options =
            RefineOptions { threads, machine: two.machine.clone(), ..RefineOptions::solo() };
        let (run, tets) = subject.simulate("abdomen", &options, &two);
        tets.len() as f64 / run.seconds
    };
    let speedup = run(2) / run(1);
    assert!((1.75..1.92).contains(&speedup), "speedup {speedup}");
}
