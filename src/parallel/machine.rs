//! A machine as those see it who share work on it: its cores, the caches and memory nodes that they
//! belong to, and how far the nodes are from each other.
//!
//! A *memory node* (NUMA node; a blade of the paper's Blacklight, section 3) is some cores with
//! memory of their own, which they reach faster than that of other nodes. How much slower another
//! node's memory is, is counted in *hops*: 0 to the own, at least 1 to any other.
//!
//! Knows no mesh, and asks no system: `crate::system` reads the one that the library runs on. How a
//! group of nodes is halved is in [`bisection`](super::bisection).
//!
//! **Invariants.** Every node has a core, and a node's cores stand together, nodes in order. The
//! hops are a symmetric matrix that is 0 on its diagonal and nowhere else.
//!
//! Thread safety: a plain value. Cost: a core is a line of memory, the hops are nodes^2 numbers;
//! all questions but `bisect` are answered in constant time.

use crate::{Error, Result};

/// A core, and what it shares with others. The numbers of caches and packages are names: equal for
/// cores that share one, different otherwise.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Core {
    /// Its memory node.
    pub node: usize,
    /// Its last-level cache.
    pub cache: usize,
    /// Its package (socket).
    pub package: usize,
    /// The system's numbers of its processors (hardware threads); empty where no system is behind
    /// the machine.
    pub processors: Vec<usize>,
}

/// Cores, memory nodes, and the hops between these.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Machine {
    /// Node by node.
    cores: Vec<Core>,
    /// The first core of each node, and one past the last of all.
    first: Vec<usize>,
    hops: Vec<Vec<u32>>,
}

/// Cores of one of Blacklight's blades, of one of their two sockets, and blades of an individual
/// rack unit (paper, section 3).
const BLADE_CORES: usize = 16;
const SOCKET_CORES: usize = 8;
const UNIT_BLADES: usize = 16;
/// Most hops between two blades within a unit, and of different units (paper, Fig. 2).
const UNIT_HOPS: u32 = 3;
const FAR_HOPS: u32 = 5;

impl Machine {
    /// One memory node of `cores` cores, at least one, that share everything.
    pub fn one_node(cores: usize) -> Self {
        Self::uniform(1, cores)
    }

    /// Memory nodes of `cores` cores each, different ones 1 hop apart. There is at least one node,
    /// of at least one core.
    pub fn uniform(nodes: usize, cores: usize) -> Self {
        let nodes = nodes.max(1);
        let hops = (0..nodes).map(|a| (0..nodes).map(|b| u32::from(a != b)).collect()).collect();
        Self::assemble(alike(&vec![cores.max(1); nodes]), hops)
    }

    /// Blades of Blacklight, the paper's machine, at least one: 16 cores each in two sockets, 3
    /// hops apart within a rack unit of 16 blades, 5 hops across units.
    pub fn blacklight(blades: usize) -> Self {
        let blades = blades.max(1);
        let core = |core: usize| {
            let socket = core / SOCKET_CORES;
            Core {
                node: core / BLADE_CORES,
                cache: socket,
                package: socket,
                processors: Vec::new(),
            }
        };
        let hops = |a: usize, b: usize| match (a, b) {
            _ if a == b => 0,
            _ if a / UNIT_BLADES == b / UNIT_BLADES => UNIT_HOPS,
            _ => FAR_HOPS,
        };
        let hops = (0..blades).map(|a| (0..blades).map(|b| hops(a, b)).collect()).collect();
        Self::assemble((0..blades * BLADE_CORES).map(core).collect(), hops)
    }

    /// Memory nodes of `cores[node]` cores each, `hops[a][b]` apart. The cores of a node share
    /// cache and package.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] where there is no node, a node has no core, or `hops` is no
    /// symmetric matrix of a row for each node that is 0 on its diagonal and nowhere else.
    pub fn new(cores: Vec<usize>, hops: Vec<Vec<u32>>) -> Result<Self> {
        if let Some(node) = cores.iter().position(|&cores| cores == 0) {
            return Err(Error::InvalidArgument(format!(
                "memory node {node} of a machine must have a core, got 0"
            )));
        }
        Self::of_cores(alike(&cores), hops)
    }

    /// A machine of these cores, in any order, with `hops[a][b]` between its memory nodes `a` and
    /// `b`. The order of a node's cores stays as it is.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_cores(mut cores: Vec<Core>, hops: Vec<Vec<u32>>) -> Result<Self> {
        let invalid = |what: String| Err(Error::InvalidArgument(what));
        let nodes = hops.len();
        if nodes == 0 {
            return invalid("a machine must have a memory node, got 0".into());
        }
        if let Some(core) = cores.iter().find(|core| core.node >= nodes) {
            return invalid(format!(
                "a core lies in memory node {} of a machine of {nodes}",
                core.node
            ));
        }
        if let Some(node) = (0..nodes).find(|&node| cores.iter().all(|core| core.node != node)) {
            return invalid(format!("memory node {node} of a machine must have a core, got 0"));
        }
        if let Some(row) = hops.iter().find(|row| row.len() != nodes) {
            return invalid(format!(
                "a row of hops must have {nodes} numbers, one for each node, got {}",
                row.len()
            ));
        }
        for (a, row) in hops.iter().enumerate() {
            for (b, &hops_ab) in row.iter().enumerate() {
                if (hops_ab == 0) != (a == b) {
                    let wanted = if a == b { "0" } else { "at least 1" };
                    return invalid(format!(
                        "the hops from memory node {a} to {b} must be {wanted}, got {hops_ab}"
                    ));
                }
                if hops_ab != hops[b][a] {
                    let back = hops[b][a];
                    return invalid(format!(
                        "there are {hops_ab} hops from memory node {a} to {b}, but {back} on the \
                         way back"
                    ));
                }
            }
        }
        cores.sort_by_key(|core| core.node);
        Ok(Self::assemble(cores, hops))
    }

    /// From cores that stand node by node, and hops as they must be.
    fn assemble(cores: Vec<Core>, hops: Vec<Vec<u32>>) -> Self {
        let first =
            (0..=hops.len()).map(|node| cores.partition_point(|core| core.node < node)).collect();
        Self { cores, first, hops }
    }

    /// How many memory nodes there are; at least 1.
    pub fn nodes(&self) -> usize {
        self.hops.len()
    }

    /// How many cores a memory node has; at least 1.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn cores(&self, node: usize) -> usize {
        self.first[node + 1] - self.first[node]
    }

    /// How many cores there are; at least 1.
    pub fn total_cores(&self) -> usize {
        self.cores.len()
    }

    /// The hops between two memory nodes: 0 for the same one, at least 1 otherwise.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn hops(&self, a: usize, b: usize) -> u32 {
        self.hops[a][b]
    }

    /// All cores, node by node.
    pub fn all_cores(&self) -> &[Core] {
        &self.cores
    }

    /// The core of a worker: workers take the cores in order, node by node. Those beyond the last
    /// begin anew at the first.
    pub fn core_of_worker(&self, worker: usize) -> &Core {
        &self.cores[worker % self.cores.len()]
    }

    /// The memory node of a worker's core.
    pub fn node_of_worker(&self, worker: usize) -> usize {
        self.core_of_worker(worker).node
    }
}

/// Cores of nodes that have so many each, alike within a node.
fn alike(cores: &[usize]) -> Vec<Core> {
    let core = |node| Core { node, cache: node, package: node, processors: Vec::new() };
    cores
        .iter()
        .enumerate()
        .flat_map(|(node, &count)| std::iter::repeat_n(core(node), count))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_fill_node_after_node_and_begin_anew() {
        let machine =
            Machine::new(vec![2, 1, 3], vec![vec![0, 1, 2], vec![1, 0, 2], vec![2, 2, 0]]).unwrap();
        assert_eq!((machine.nodes(), machine.total_cores(), machine.hops(0, 2)), (3, 6, 2));
        assert_eq!((0..3).map(|node| machine.cores(node)).collect::<Vec<_>>(), [2, 1, 3]);
        let nodes: Vec<usize> = (0..8).map(|worker| machine.node_of_worker(worker)).collect();
        assert_eq!(nodes, [0, 0, 1, 2, 2, 2, 0, 0]);
    }

    #[test]
    fn cores_in_any_order_are_put_node_by_node() {
        let core =
            |node, processor| Core { node, cache: 0, package: 0, processors: vec![processor] };
        let cores = vec![core(1, 1), core(0, 0), core(1, 3), core(0, 2)];
        let machine = Machine::of_cores(cores, vec![vec![0, 1], vec![1, 0]]).unwrap();
        let processors: Vec<usize> =
            machine.all_cores().iter().map(|core| core.processors[0]).collect();
        assert_eq!(processors, [0, 2, 1, 3]);
    }

    #[test]
    fn blacklight_is_as_in_the_paper() {
        let machine = Machine::blacklight(18);
        assert_eq!((machine.nodes(), machine.total_cores(), machine.cores(17)), (18, 288, 16));
        assert_eq!(
            [machine.hops(3, 3), machine.hops(0, 15), machine.hops(15, 16), machine.hops(16, 17)],
            [0, 3, 5, 3]
        );
        assert_eq!(machine.node_of_worker(31), 1);
        assert_ne!(machine.core_of_worker(7).cache, machine.core_of_worker(8).cache);
    }

    #[test]
    fn machines_have_at_least_a_core() {
        assert_eq!(Machine::uniform(0, 0), Machine::one_node(1));
        assert_eq!(Machine::blacklight(0), Machine::blacklight(1));
    }

    #[test]
    fn what_is_no_machine_is_refused_with_the_value() {
        let refused = |cores: &[usize], hops: &[&[u32]]| {
            let hops = hops.iter().map(|row| row.to_vec()).collect();
            Machine::new(cores.to_vec(), hops).unwrap_err().to_string()
        };
        assert!(refused(&[], &[]).contains("got 0"));
        assert!(
            refused(&[2, 0], &[&[0, 1], &[1, 0]]).contains("node 1 of a machine must have a core")
        );
        assert!(
            refused(&[2], &[&[0, 1], &[1, 0]]).contains("node 1 of a machine must have a core")
        );
        assert!(refused(&[2, 2], &[&[0]]).contains("node 1 of a machine of 1"));
        assert!(refused(&[2, 2], &[&[0, 1], &[1]]).contains("2 numbers, one for each node, got 1"));
        assert!(
            refused(&[2, 2], &[&[0, 1], &[1, 3]])
                .contains("from memory node 1 to 1 must be 0, got 3")
        );
        assert!(
            refused(&[2, 2], &[&[0, 0], &[0, 0]])
                .contains("from memory node 0 to 1 must be at least 1, got 0")
        );
        assert!(
            refused(&[2, 2], &[&[0, 1], &[2, 0]]).contains("1 hops from memory node 0 to 1, but 2")
        );
    }
}
