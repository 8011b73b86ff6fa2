//! What is simulated: a machine, what work costs on its cores, and what it costs to bring data from
//! another node.
//!
//! Costs are nanoseconds of a core that has its data in its cache; docs/notes/scaling.md says how
//! they were measured, and which were fitted.

use crate::parallel::machine::Machine;

/// A machine as simulated workers find it.
#[derive(Clone, Debug, PartialEq)]
pub struct Platform {
    /// Cores and memory nodes, and the hops between these. Worker i runs on core i.
    pub machine: Machine,
    /// What work costs.
    pub costs: Costs,
    /// What brings data from node to node.
    pub network: Network,
    /// Records, of tets and vertices, that the caches of a node hold; the largest number is no
    /// limit.
    pub cached_records: u32,
}

/// Nanoseconds of work of each kind; all but the last two are multiplied by `slowdown`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// How much slower a core is than the one on which the others were measured.
    pub slowdown: f64,
    /// An insertion or removal, beside what follows.
    pub operation: f64,
    /// A visit to a tet: in a walk, digging, filling.
    pub tet: f64,
    /// A visit to a vertex.
    pub vertex: f64,
    /// A predicate by exact arithmetic.
    pub exact: f64,
    /// Making a tet, its sphere and its place among its neighbours.
    pub fill: f64,
    /// A pair of a facet and a vertex in a removal.
    pub pair: f64,
    /// A look at a tet for what the rules wanted.
    pub look: f64,
    /// A lookup of a point's label.
    pub label: f64,
    /// A lookup of a segment's first crossing.
    pub crossing: f64,
    /// Asking for the lock of a tet that nobody holds. One worker alone has no locks.
    pub claim: f64,
    /// A record that another core of the same node has written: from its cache.
    pub sharing: f64,
}

/// What a record costs that comes from another node: the hops, and the wait for routers that are in
/// use. Routers form a tree: neighbouring nodes belong to a group at every level, as eight blades
/// do to a router of Blacklight, and two of these to a rack unit. A group has one router, which
/// stands for all links among its parts. A record passes the routers of the groups that hold either
/// its source or its reader, and of the smallest that holds both.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// Nanoseconds of one hop, there and back.
    pub hop: f64,
    /// The groups, from the smallest; none: no router is ever full.
    pub levels: Vec<Level>,
}

/// Groups of nodes and their routers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Neighbouring nodes in each group.
    pub nodes: usize,
    /// Nanoseconds for which a record occupies the group's router.
    pub service: f64,
}

impl Default for Costs {
    /// Those of the machine that docs/notes/scaling.md names.
    fn default() -> Self {
        Self {
            slowdown: 1.0,
            operation: 400.0,
            tet: 10.0,
            vertex: 4.0,
            exact: 300.0,
            fill: 20.0,
            pair: 4.0,
            look: 15.0,
            label: 20.0,
            crossing: 200.0,
            claim: 5.0,
            sharing: 35.0,
        }
    }
}

impl Network {
    /// One whose routers are never full.
    pub fn of_hops(hop: f64) -> Self {
        Self { hop, levels: Vec::new() }
    }
}
