//! Simulated refinements, one line of JSON for each; `study.py` beside this file runs it and draws
//! what comes out. docs/notes/scaling.md says what it means.
//!
//!     simulate IMAGE --tets N --workers P,P,...
//!         [--machine one|blacklight|NODESxCORES|SOCKETSxNODESxCORES] [--algorithm podm|lapd]
//!         [--contention local] [--begging flat|levels] [--set NAME=VALUE,...]
//!         [--level NODES:NANOSECONDS,...] [--delta D] [--real]
//!
//! `--tets` is for each worker: delta is searched, by real refinements, until their number is
//! within 3 % of P times N, unless `--delta` gives it. `--set` changes costs by name, `hop` and
//! `cached` among them; `--level` gives the routers of groups of nodes. Nodes are 1 hop apart, in
//! another socket 2. `--real` measures a real refinement with P threads as well, which the image is
//! sampled by, too. Every line but for that, and for `wall_s`, is the same in every run.

use std::path::Path;
use std::time::Instant;

use lapd::image::LabelImage;
use lapd::io::read::read_image;
use lapd::monitor::Monitor;
use lapd::oracle::Oracle;
use lapd::parallel::machine::Machine;
use lapd::params::{Algorithm, Begging, Contention, MeshParams};
use lapd::pipeline::refine::triangulation_around;
use lapd::refine::activity::Overhead;
use lapd::refine::options::RefineOptions;
use lapd::refine::refine;
use lapd::refine::rules::Rules;
use lapd::simulation::course::Mark;
use lapd::simulation::platform::{Costs, Level, Network, Platform};
use lapd::simulation::world::Traffic;
use lapd::simulation::{Simulated, simulate};
use lapd::sizing::Sizing;
use serde_json::{Value, json};

/// How far the number of tets may be from what was asked for.
const WITHIN: f64 = 0.03;
const TRIES: usize = 8;
/// Marks of a run's course that are reported: one for each twentieth of all tets made.
const MARKS: usize = 20;
/// The exponent of delta in the number of tets, as a first guess.
const EXPONENT: f64 = 2.6;

type Failure = Box<dyn std::error::Error>;

struct Options {
    image: String,
    tets: f64,
    workers: Vec<usize>,
    machine: String,
    algorithm: Algorithm,
    contention: Contention,
    begging: Begging,
    costs: Costs,
    network: Network,
    cached: u32,
    delta: Option<f64>,
    real: bool,
}

fn main() {
    if let Err(error) = options().and_then(|options| study(&options)) {
        eprintln!("simulate: {error}");
        std::process::exit(1);
    }
}

fn options() -> Result<Options, Failure> {
    let mut words = std::env::args().skip(1);
    let mut options = Options {
        image: words.next().ok_or("the image is missing")?,
        tets: 20_000.0,
        workers: vec![1],
        machine: "one".into(),
        algorithm: Algorithm::Podm,
        contention: Contention::Local,
        begging: Begging::ByLevel,
        costs: Costs::default(),
        network: Network::of_hops(0.0),
        cached: u32::MAX,
        delta: None,
        real: false,
    };
    while let Some(word) = words.next() {
        match word.as_str() {
            "--real" => options.real = true,
            _ => {
                let value = words.next().ok_or(format!("{word} needs a value"))?;
                set(&mut options, &word, &value)?;
            }
        }
    }
    Ok(options)
}

fn set(options: &mut Options, word: &str, value: &str) -> Result<(), Failure> {
    match word {
        "--tets" => options.tets = value.parse()?,
        "--delta" => options.delta = Some(value.parse()?),
        "--workers" => {
            options.workers = value.split(',').map(str::parse).collect::<Result<_, _>>()?
        }
        "--machine" => options.machine = value.into(),
        "--algorithm" => {
            options.algorithm = match value {
                "podm" => Algorithm::Podm,
                "lapd" => Algorithm::Lapd,
                _ => return Err(format!("no algorithm {value}").into()),
            }
        }
        "--contention" => {
            options.contention = match value {
                "local" => Contention::Local,
                "global" => Contention::Global,
                "random" => Contention::Random,
                "aggressive" => Contention::Aggressive,
                _ => return Err(format!("no contention manager {value}").into()),
            }
        }
        "--begging" => {
            options.begging = match value {
                "levels" => Begging::ByLevel,
                "flat" => Begging::Flat,
                _ => return Err(format!("no begging scheme {value}").into()),
            }
        }
        "--set" => {
            for pair in value.split(',') {
                let (name, number) =
                    pair.split_once('=').ok_or(format!("{pair} is no NAME=VALUE"))?;
                set_cost(options, name, number.parse()?)?;
            }
        }
        "--level" => {
            for pair in value.split(',') {
                let (nodes, service) =
                    pair.split_once(':').ok_or(format!("{pair} is no NODES:NANOSECONDS"))?;
                options
                    .network
                    .levels
                    .push(Level { nodes: nodes.parse()?, service: service.parse()? });
            }
        }
        _ => return Err(format!("no option {word}").into()),
    }
    Ok(())
}

fn set_cost(options: &mut Options, name: &str, value: f64) -> Result<(), Failure> {
    let costs = &mut options.costs;
    *match name {
        "cached" => {
            options.cached = value as u32;
            return Ok(());
        }
        "hop" => &mut options.network.hop,
        "slowdown" => &mut costs.slowdown,
        "operation" => &mut costs.operation,
        "tet" => &mut costs.tet,
        "vertex" => &mut costs.vertex,
        "exact" => &mut costs.exact,
        "fill" => &mut costs.fill,
        "pair" => &mut costs.pair,
        "look" => &mut costs.look,
        "label" => &mut costs.label,
        "crossing" => &mut costs.crossing,
        "claim" => &mut costs.claim,
        "sharing" => &mut costs.sharing,
        _ => return Err(format!("no cost {name}").into()),
    } = value;
    Ok(())
}

/// A machine of at least so many cores.
fn machine(name: &str, workers: usize) -> Result<Machine, Failure> {
    Ok(match name {
        "one" => Machine::one_node(workers),
        "blacklight" => Machine::blacklight(workers.div_ceil(16)),
        _ => {
            let sizes = name.split('x').map(str::parse).collect::<Result<Vec<usize>, _>>();
            match *sizes.map_err(|_| format!("no machine {name}"))? {
                [nodes, cores] => Machine::uniform(nodes, cores),
                [sockets, nodes, cores] => {
                    let all = sockets * nodes;
                    let hops =
                        |a: usize, b: usize| u32::from(a != b) + u32::from(a / nodes != b / nodes);
                    let hops = (0..all).map(|a| (0..all).map(|b| hops(a, b)).collect()).collect();
                    Machine::new(vec![cores; all], hops)?
                }
                _ => return Err(format!("no machine {name}").into()),
            }
        }
    })
}

/// An image, and its oracle.
struct Subject {
    image: LabelImage,
    oracle: Oracle,
}

impl Subject {
    /// What `work` gives, and the tets with a label that it leaves.
    fn with_rules<T>(
        &self,
        delta: f64,
        work: impl FnOnce(&Rules<'_>) -> lapd::Result<T>,
    ) -> Result<(T, usize), Failure> {
        let params = MeshParams { delta, size: 2.0 * delta, ..MeshParams::default() };
        let triangulation = triangulation_around(&self.oracle, delta)?;
        let sizing = Sizing::uniform(delta);
        let labels = self.image.labels();
        let rules = Rules::new(&triangulation, &self.oracle, &sizing, &params, labels);
        let done = work(&rules)?;
        let tets = triangulation.living_tets().filter(|&t| rules.label(t) != 0).count();
        Ok((done, tets))
    }

    /// The delta that makes so many tets, near to `guess`.
    fn find_delta(&self, wanted: f64, guess: f64) -> Result<f64, Failure> {
        // One thread makes the same mesh in every run.
        let count = |delta| {
            self.with_rules(delta, |rules| {
                refine(rules, &RefineOptions::solo(), &Monitor::silent())
            })
        };
        let (mut delta, mut exponent) = (guess, EXPONENT);
        let mut before: Option<(f64, f64)> = None;
        for _ in 0..TRIES {
            let tets = count(delta)?.1 as f64;
            if (tets / wanted - 1.0).abs() <= WITHIN {
                return Ok(delta);
            }
            if let Some((other, other_tets)) = before.replace((delta, tets)) {
                exponent = ((tets / other_tets).ln() / (other / delta).ln()).clamp(1.5, 4.0);
            }
            delta *= (tets / wanted).powf(1.0 / exponent);
        }
        Err(format!("no delta was found that makes {wanted} tets").into())
    }
}

fn study(options: &Options) -> Result<(), Failure> {
    let image = read_image(Path::new(&options.image))?.image;
    let oracle = Oracle::new(&image, MeshParams::default().surface, &|| Ok(()))?;
    let [lower, upper] = oracle.bounds();
    let first = options.tets * options.workers[0] as f64;
    let mut guess = 0.01 * (upper - lower).max_element() * (1e6 / first).powf(1.0 / EXPONENT);
    let subject = Subject { image, oracle };
    for &workers in &options.workers {
        let wanted = options.tets * workers as f64;
        let delta = match options.delta {
            Some(delta) => delta,
            None => subject.find_delta(wanted, guess)?,
        };
        let platform = Platform {
            machine: machine(&options.machine, workers)?,
            costs: options.costs,
            network: options.network.clone(),
            cached_records: options.cached,
        };
        run(options, &subject, delta, workers, &platform)?;
        guess = delta;
    }
    Ok(())
}

fn run(
    options: &Options,
    subject: &Subject,
    delta: f64,
    workers: usize,
    platform: &Platform,
) -> Result<(), Failure> {
    let how = RefineOptions {
        threads: workers,
        contention: options.contention,
        begging: options.begging,
        algorithm: options.algorithm,
        machine: platform.machine.clone(),
        timeline: true,
        ..RefineOptions::solo()
    };
    let real = if options.real {
        // Else the image would be sampled by as many threads as there are cores.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(workers).build()?;
        let mut seconds = 0.0;
        let timed = |rules: &Rules<'_>| {
            let clock = Instant::now();
            let refinement = pool.install(|| refine(rules, &how, &Monitor::silent()))?;
            seconds = clock.elapsed().as_secs_f64();
            Ok(refinement)
        };
        let tets = subject.with_rules(delta, timed)?.1;
        json!({ "seconds": seconds, "tets": tets })
    } else {
        Value::Null
    };
    let clock = Instant::now();
    let (simulated, tets) =
        subject.with_rules(delta, |rules| simulate(rules, &how, platform, &Monitor::silent()))?;
    let mut line = report(&simulated);
    line["workers"] = workers.into();
    line["delta"] = delta.into();
    line["tets"] = tets.into();
    line["real"] = real;
    line["wall_s"] = clock.elapsed().as_secs_f64().into();
    println!("{line}");
    Ok(())
}

fn report(simulated: &Simulated) -> Value {
    let Simulated { refinement, seconds, course: _, traffic, served, tally } = simulated;
    let course: Vec<Value> =
        (0..=MARKS).map(|at| mark(&simulated.mark_at(at as f64 / MARKS as f64))).collect();
    let mut lost = Overhead::default();
    refinement.threads.iter().for_each(|thread| lost.add(&thread.overhead));
    let by_hops = |of: fn(&Traffic) -> &Vec<u64>| {
        traffic.iter().fold(Vec::new(), |mut sum: Vec<u64>, one| {
            sum.resize(of(one).len(), 0);
            sum.iter_mut().zip(of(one)).for_each(|(sum, count)| *sum += count);
            sum
        })
    };
    let operations = &refinement.counters;
    json!({
        "seconds": seconds,
        "steady": mark(&simulated.steady()),
        "course": course,
        "insertions": operations.insertions,
        "removals": operations.removals,
        "rollbacks": operations.rollbacks,
        "rollback_s": lost.rollback_seconds,
        "contention_s": lost.contention_seconds,
        "idle_s": lost.idle_seconds,
        "gifts": lost.gifts,
        "travel_s": traffic.iter().map(|one| one.travel_seconds).sum::<f64>(),
        "queue_s": traffic.iter().map(|one| one.queue_seconds).sum::<f64>(),
        "served": served,
        "waits": lost.waits,
        "begs": lost.begs,
        "shared": traffic.iter().map(|one| one.shared).sum::<u64>(),
        "visits_by_hops": by_hops(|one| &one.visits_by_hops),
        "fetched_by_hops": by_hops(|one| &one.fetched_by_hops),
        "tally": {
            "operations": tally.operations, "tets": tally.tets, "vertices": tally.vertices,
            "exact": tally.exact, "fills": tally.fills, "pairs": tally.pairs,
            "inspections": tally.inspections, "labels": tally.labels,
            "crossings": tally.crossings, "claims": tally.claims,
        },
    })
}

/// Until a moment, or between two; what workers did in the order of `Doing`.
fn mark(mark: &Mark) -> Value {
    json!({
        "seconds": mark.seconds, "made": mark.made, "fetched": mark.fetched,
        "travel_s": mark.travel_seconds, "queue_s": mark.queue_seconds,
        "doing_s": mark.doing,
    })
}
