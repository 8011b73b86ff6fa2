//! The machine that the library runs on, and synthetic ones: the one place that asks the system
//! about processors, memory, and what kind of file a name stands for.
//!
//! | file | what |
//! |---|---|
//! | `sysfs` | cores, caches and memory nodes as Linux tells them in `/sys` |
//! | `hwloc` | the same by hwloc, and machines that it describes; the cargo feature `hwloc` |
//! | [`files`] | files opened without waiting, and only below a folder |
//! | [`memory`] | how much memory there is |
//! | [`binding`] | the processors that a thread may use; threads bound to cores |
//!
//! hwloc knows more machines and systems than `/sys` does, and its descriptions, but it is a
//! library to be found when ours is built; so the default is to do without. Both readers hand over
//! the same: cores, and a matrix of distances between memory nodes.
//!
//! **Only processors that the calling thread may use count** (its affinity, hence also its cpuset).
//! Memory nodes without such a processor are left out: those of others, and memory that no core is
//! near to.
//!
//! **Distances become hops by rank**: the least one between different nodes is 1 hop, the next
//! larger one 2. What firmware tells (the ACPI's SLIT) compares, but measures nothing: 10 to the
//! own node, then 11 and 12, or 16 and 22, or 20 and 40.
//!
//! Thread safety: everything may be called from any thread; files are read, nothing is kept. Cost:
//! some file reads for each processor, or hwloc's discovery: milliseconds.

pub mod binding;
pub mod files;
#[cfg(feature = "hwloc")]
mod hwloc;
pub mod memory;
mod sysfs;

use std::path::Path;
use std::thread::available_parallelism;

use crate::parallel::machine::{Core, Machine};
use crate::{Error, Result};

/// Most processors of a synthetic machine: hwloc makes an object for each.
const MAX_SYNTHETIC: usize = 1 << 16;

impl Machine {
    /// The cores and memory nodes of the system that the calling thread may use. Where the system
    /// does not tell, one node of as many cores as there seem to be.
    pub fn of_system() -> Self {
        let allowed = binding::allowed();
        let may_use = |processor: usize| {
            allowed.as_ref().is_none_or(|allowed| allowed.binary_search(&processor).is_ok())
        };
        #[cfg(feature = "hwloc")]
        if let Some(machine) = hwloc::system(may_use) {
            return machine;
        }
        sysfs::read(Path::new("/sys/devices/system"), may_use)
            .unwrap_or_else(|| Self::one_node(available_parallelism().map_or(1, usize::from)))
    }

    /// The machine of one of hwloc's synthetic descriptions, such as `numa:4 core:4 pu:1`: four
    /// memory nodes of four cores. A description that ends with its cores may leave out the `pu:1`.
    ///
    /// Nodes are 1 hop apart, and 1 more for each level of packages or groups of several nodes that
    /// parts them: `group:2 pack:2 numa:2 core:4` has hops from 1 to 3.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] where hwloc does not understand the description, or it has more
    /// than 65536 processors; [`Error::Unsupported`] where the library was built without the cargo
    /// feature `hwloc`.
    pub fn synthetic(description: &str) -> Result<Self> {
        let levels = description.split_whitespace().filter_map(|level| {
            let count = level.rsplit(':').next()?;
            count[..count.find(|c: char| !c.is_ascii_digit()).unwrap_or(count.len())]
                .parse::<usize>()
                .ok()
        });
        if levels.fold(1, usize::saturating_mul) > MAX_SYNTHETIC {
            return Err(Error::InvalidArgument(format!(
                "topology '{description}' has more than {MAX_SYNTHETIC} processors"
            )));
        }
        #[cfg(feature = "hwloc")]
        return hwloc::synthetic(description);
        #[cfg(not(feature = "hwloc"))]
        Err(Error::Unsupported(format!(
            "topology '{description}': synthetic topologies need the cargo feature hwloc, without \
             which this library was built"
        )))
    }
}

/// A machine of what a reader found: cores, and the distances between the memory nodes that these
/// name, the larger the farther. Nodes without a core are left out. `None` if nothing is left.
fn assemble(mut cores: Vec<Core>, distances: &[Vec<u64>]) -> Option<Machine> {
    let mut nodes: Vec<usize> = cores.iter().map(|core| core.node).collect();
    nodes.sort_unstable();
    nodes.dedup();
    for core in &mut cores {
        core.node = nodes.binary_search(&core.node).ok()?;
    }
    // The longer of both ways: hops have no direction.
    let distance = |a: usize, b: usize| -> Option<u64> {
        Some(*distances.get(nodes[a])?.get(nodes[b])?.max(distances.get(nodes[b])?.get(nodes[a])?))
    };
    let pairs = || {
        (0..nodes.len()).flat_map(|a| (0..nodes.len()).map(move |b| (a, b))).filter(|(a, b)| a != b)
    };
    let mut ranks = pairs().map(|(a, b)| distance(a, b)).collect::<Option<Vec<u64>>>()?;
    ranks.sort_unstable();
    ranks.dedup();
    let mut hops = vec![vec![0; nodes.len()]; nodes.len()];
    for (a, b) in pairs() {
        hops[a][b] = ranks.binary_search(&distance(a, b)?).ok()? as u32 + 1;
    }
    Machine::of_cores(cores, hops).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn core(node: usize) -> Core {
        Core { node, cache: node, package: node, processors: vec![node] }
    }

    #[test]
    fn distances_become_hops_by_rank() {
        let distances =
            [[10, 16, 22, 16], [16, 10, 16, 22], [22, 16, 10, 16], [17, 22, 16, 10]].map(Vec::from);
        let machine = assemble((0..4).map(core).collect(), &distances).unwrap();
        let hops: Vec<u32> = (1..4).map(|b| machine.hops(0, b)).collect();
        // One way says 16, the other 17.
        assert_eq!(hops, [1, 3, 2]);
        assert_eq!(machine.hops(3, 0), 2);
    }

    #[test]
    fn nodes_without_cores_are_left_out() {
        let distances =
            [[10, 12, 20, 30], [12, 10, 30, 30], [20, 30, 10, 40], [30, 30, 40, 10]].map(Vec::from);
        let machine = assemble(vec![core(3), core(0), core(0), core(2)], &distances).unwrap();
        assert_eq!((machine.nodes(), machine.total_cores(), machine.cores(0)), (3, 4, 2));
        assert_eq!([machine.hops(0, 1), machine.hops(0, 2), machine.hops(1, 2)], [1, 2, 3]);
        assert_eq!(assemble(Vec::new(), &distances), None);
        assert_eq!(assemble(vec![core(4), core(0)], &distances), None);
    }

    #[test]
    fn the_system_has_the_processors_that_the_caller_may_use() {
        let machine = Machine::of_system();
        assert!(machine.total_cores() >= 1 && machine.nodes() >= 1);
        if let Some(allowed) = binding::allowed() {
            let mut processors: Vec<usize> = machine
                .all_cores()
                .iter()
                .flat_map(|core| core.processors.iter().copied())
                .collect();
            processors.sort_unstable();
            assert_eq!(processors, allowed);
        }
    }

    #[test]
    fn descriptions_of_too_many_processors_are_refused() {
        for description in
            ["numa:1000 core:1000 pu:1", "99999999999 9999999999", "numa:65536(memory=1G) pu:2"]
        {
            let error = Machine::synthetic(description).unwrap_err();
            assert!(matches!(error, Error::InvalidArgument(_)), "{error:?}");
            assert!(error.to_string().contains("65536 processors"), "{error}");
        }
    }

    #[cfg(not(feature = "hwloc"))]
    #[test]
    fn synthetic_machines_need_the_feature() {
        let error = Machine::synthetic("numa:4 core:4 pu:1").unwrap_err();
        assert!(matches!(error, Error::Unsupported(_)), "{error:?}");
        assert!(error.to_string().contains("cargo feature hwloc"), "{error}");
    }
}
