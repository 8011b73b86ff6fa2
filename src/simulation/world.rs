//! What workers' work costs, and where their data lies: the state of a simulated
//! [platform](Platform).
//!
//! **Records.** Every tet and every vertex is a record that lies in the memory of one node, its
//! *home*: that of the worker which touched its chunk first, as systems place pages. A visit to a
//! record whose home is another node is a *remote access*, as the paper's section 3 counts them.
//!
//! **Caches.** A record is in the cache of the core that visited it last, until its node has
//! brought in [`Platform::cached_records`] others since. A visit finds it there, or brings it: from
//! the core that has it, of this or another node; when it is in no cache, from its home. The model
//! takes every visit for one that may write: a record is in one cache at a time. What that
//! overstates, records that several nodes only read, are few in a mesh that all refine.
//!
//! **Routers** serve one record after the other, in the order of virtual time in which they were
//! asked for; so they saturate by themselves.
//!
//! Cost: some nanoseconds for a visit, a switch of workers for a record from another node.

use super::course::Mark;
use super::platform::{Costs, Network, Platform};
use crate::delaunay::chunked::CHUNK;
use crate::delaunay::probe::Effort;
use crate::sync::Ticks;
use crate::sync::virtual_time::{self, NANOSECOND};

/// What has a price, beside visits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// A part of an operation.
    Kernel(Effort),
    /// A tet is inspected for what the rules ask.
    Look,
    /// Labels looked up.
    Labels(u64),
    /// Crossings looked up.
    Crossings(u64),
    /// A tet is asked for.
    Claim,
}

/// What a worker did, and what it waited for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traffic {
    /// Visits to records, by the hops to their home nodes: the first are local.
    pub visits_by_hops: Vec<u64>,
    /// Records that came from another core of the node.
    pub shared: u64,
    /// Records that came from another node, by hops.
    pub fetched_by_hops: Vec<u64>,
    /// Virtual seconds that these took, routers idle.
    pub travel_seconds: f64,
    /// Virtual seconds that they waited for routers.
    pub queue_seconds: f64,
}

/// Work by kind, for the fit of costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Insertions and removals begun.
    pub operations: u64,
    /// Visits to tets.
    pub tets: u64,
    /// Visits to vertices.
    pub vertices: u64,
    /// Exact predicates.
    pub exact: u64,
    /// Tets made.
    pub fills: u64,
    /// Facets and vertices of removals.
    pub pairs: u64,
    /// Looks.
    pub inspections: u64,
    /// Labels.
    pub labels: u64,
    /// Crossings.
    pub crossings: u64,
    /// Locks asked for.
    pub claims: u64,
}

/// Which records.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Tet = 0,
    Vertex = 1,
}

/// The records of one kind.
#[derive(Default)]
struct Records {
    lines: Vec<Line>,
    /// The node of each chunk.
    home_nodes: Vec<u16>,
}

/// Who visited a record last, from 1, and how many records its node had brought in then.
#[derive(Clone, Copy, Default)]
struct Line {
    worker: u16,
    stamp: u32,
}

/// [`Costs`] in ticks.
struct Prices {
    operation: Ticks,
    tet: Ticks,
    vertex: Ticks,
    exact: Ticks,
    fill: Ticks,
    pair: Ticks,
    look: Ticks,
    label: Ticks,
    crossing: Ticks,
    claim: Ticks,
    sharing: Ticks,
}

fn to_ticks(nanoseconds: f64) -> Ticks {
    (nanoseconds * NANOSECOND as f64).round() as Ticks
}

fn to_seconds(ticks: Ticks) -> f64 {
    ticks as f64 * virtual_time::SECONDS_PER_TICK
}

/// The routers of one level's groups.
struct Routers {
    nodes: usize,
    service: Ticks,
    /// Until when each is in use, and how many records it has served.
    busy: Vec<(Ticks, u64)>,
}

/// A platform at work.
pub(super) struct World {
    prices: Prices,
    hop: Ticks,
    routers: Vec<Routers>,
    hops: Vec<Vec<u32>>,
    node_of: Vec<u16>,
    cached: u32,
    records: [Records; 2],
    /// Records that each node has brought in; wraps.
    stamps: Vec<u32>,
    pub traffic: Vec<Traffic>,
    pub tally: Tally,
    /// The course of the run, a mark every [`MARK_EVERY`] tets made.
    pub course: Vec<Mark>,
}

/// Tets made between two marks, at least.
const MARK_EVERY: u64 = 1 << 12;

impl World {
    pub fn new(platform: &Platform, workers: usize) -> Self {
        let Platform { machine, costs, network: Network { hop, levels }, cached_records } =
            platform;
        let nodes = machine.nodes();
        let hops: Vec<Vec<u32>> =
            (0..nodes).map(|a| (0..nodes).map(|b| machine.hops(a, b)).collect()).collect();
        let max = hops.iter().flatten().max().map_or(0, |&max| max as usize);
        let routers = levels.iter().map(|level| {
            let groups = nodes.div_ceil(level.nodes.max(1));
            Routers {
                nodes: level.nodes.max(1),
                service: to_ticks(level.service),
                busy: vec![(0, 0); groups],
            }
        });
        let none = vec![0; max + 1];
        let traffic =
            Traffic { visits_by_hops: none.clone(), fetched_by_hops: none, ..Traffic::default() };
        Self {
            prices: Prices::new(costs),
            hop: to_ticks(*hop),
            routers: routers.collect(),
            hops,
            node_of: (0..workers).map(|worker| machine.node_of_worker(worker) as u16).collect(),
            cached: *cached_records,
            records: Default::default(),
            stamps: vec![0; nodes],
            traffic: vec![traffic; workers],
            tally: Tally::default(),
            course: Vec::new(),
        }
    }

    /// Records that each router has served, by level and group.
    pub fn served(&self) -> Vec<Vec<u64>> {
        self.routers
            .iter()
            .map(|level| level.busy.iter().map(|&(_, count)| count).collect())
            .collect()
    }

    /// What work costs.
    pub fn price(&mut self, work: Work) -> Ticks {
        if matches!(work, Work::Kernel(Effort::Fill(_)))
            && self.tally.fills >= MARK_EVERY * self.course.len() as u64
        {
            self.mark();
        }
        let (tally, prices) = (&mut self.tally, &self.prices);
        let (sum, price, count) = match work {
            Work::Kernel(Effort::Operation) => (&mut tally.operations, prices.operation, 1),
            Work::Kernel(Effort::Exact(count)) => (&mut tally.exact, prices.exact, count),
            Work::Kernel(Effort::Fill(count)) => (&mut tally.fills, prices.fill, count as u64),
            Work::Kernel(Effort::Pairs(count)) => (&mut tally.pairs, prices.pair, count as u64),
            Work::Look => (&mut tally.inspections, prices.look, 1),
            Work::Labels(count) => (&mut tally.labels, prices.label, count),
            Work::Crossings(count) => (&mut tally.crossings, prices.crossing, count),
            Work::Claim => (&mut tally.claims, prices.claim, 1),
        };
        *sum += count;
        price * count
    }

    /// Marks where the run is.
    fn mark(&mut self) {
        self.course.push(self.mark_at(virtual_time::now()));
    }

    /// Where the run is at its end.
    pub fn mark_end(&mut self, end: Ticks) {
        self.course.push(self.mark_at(end));
    }

    fn mark_at(&self, now: Ticks) -> Mark {
        // Clocks run ahead of each other by what workers do between two pauses.
        let before = self.course.last().map_or(0.0, |mark| mark.seconds);
        let mut mark = Mark {
            seconds: to_seconds(now).max(before),
            made: self.tally.fills,
            ..Mark::default()
        };
        for traffic in &self.traffic {
            mark.fetched += traffic.fetched_by_hops.iter().sum::<u64>();
            mark.travel_seconds += traffic.travel_seconds;
            mark.queue_seconds += traffic.queue_seconds;
        }
        mark
    }

    /// Worker `me` visits a record. What that costs, but for the way from another node; then this
    /// node, to be told to [`Self::fetch`].
    pub fn visit(&mut self, me: usize, kind: Kind, id: u32) -> (Ticks, Option<u16>) {
        let node = self.node_of[me];
        let price = match kind {
            Kind::Tet => {
                self.tally.tets += 1;
                self.prices.tet
            }
            Kind::Vertex => {
                self.tally.vertices += 1;
                self.prices.vertex
            }
        };
        let records = &mut self.records[kind as usize];
        let (at, chunk) = (id as usize, id as usize / CHUNK);
        if at >= records.lines.len() {
            records.lines.resize((chunk + 1) * CHUNK, Line::default());
            // Nobody's yet.
            records.home_nodes.resize(chunk + 1, u16::MAX);
        }
        let home = &mut records.home_nodes[chunk];
        if *home == u16::MAX {
            *home = node;
        }
        let home = *home;
        let hops = &self.hops[usize::from(node)];
        self.traffic[me].visits_by_hops[hops[usize::from(home)] as usize] += 1;
        let line = &mut records.lines[at];
        let holder =
            usize::from(line.worker).checked_sub(1).map(|worker| (worker, self.node_of[worker]));
        let source = match holder {
            // No longer, when its node has brought in too many others since.
            Some((worker, of))
                if self.stamps[usize::from(of)].wrapping_sub(line.stamp) < self.cached =>
            {
                if worker == me {
                    line.stamp = self.stamps[usize::from(node)];
                    return (price, None);
                }
                of
            }
            _ => home,
        };
        let shared =
            source == node && holder.is_some_and(|(worker, of)| worker != me && of == node);
        self.stamps[usize::from(node)] = self.stamps[usize::from(node)].wrapping_add(1);
        *line = Line { worker: me as u16 + 1, stamp: self.stamps[usize::from(node)] };
        if source != node {
            return (price, Some(source));
        }
        self.traffic[me].shared += u64::from(shared);
        (price + if shared { self.prices.sharing } else { 0 }, None)
    }

    /// When the record is here that worker `me` asks for now, of node `source`.
    pub fn fetch(&mut self, me: usize, source: u16) -> Ticks {
        let (from, to) = (usize::from(source), usize::from(self.node_of[me]));
        let begin = virtual_time::now();
        let (mut at, mut served) = (begin, 0);
        for Routers { nodes, service, busy } in &mut self.routers {
            let groups = [from / *nodes, to / *nodes];
            let met = groups[0] == groups[1];
            for &group in if met { &groups[..1] } else { &groups } {
                let (until, count) = &mut busy[group];
                at = at.max(*until) + *service;
                *until = at;
                *count += 1;
                served += *service;
            }
            if met {
                break;
            }
        }
        let hops = self.hops[from][to];
        let way = self.hop * Ticks::from(hops);
        let traffic = &mut self.traffic[me];
        traffic.fetched_by_hops[hops as usize] += 1;
        traffic.travel_seconds += to_seconds(way + served);
        traffic.queue_seconds += to_seconds(at - begin - served);
        at + way
    }
}

impl Prices {
    fn new(costs: &Costs) -> Self {
        let ticks = |nanoseconds: f64| to_ticks(nanoseconds * costs.slowdown);
        Self {
            operation: ticks(costs.operation),
            tet: ticks(costs.tet),
            vertex: ticks(costs.vertex),
            exact: ticks(costs.exact),
            fill: ticks(costs.fill),
            pair: ticks(costs.pair),
            look: ticks(costs.look),
            label: ticks(costs.label),
            crossing: ticks(costs.crossing),
            claim: to_ticks(costs.claim),
            sharing: to_ticks(costs.sharing),
        }
    }
}
