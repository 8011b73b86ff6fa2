//! The machine by hwloc (F. Broquedis et al., "hwloc: a generic framework for managing hardware
//! affinities in HPC applications", 2010), through the bindings of the crate hwlocality.
//!
//! **Distances.** The matrix of latencies between memory nodes where the system gives one; else
//! that of bandwidths, the larger the nearer; else counted in the tree: 1, and 1 more for each
//! package or group of several nodes that holds the one, but not the other.
//!
//! hwloc reads environment variables of its own (`HWLOC_...`), as its manual tells. A topology that
//! these put in place of the system's is not taken for it.

use hwlocality::Topology;
use hwlocality::object::TopologyObject;
use hwlocality::object::distance::DistancesKind;
use hwlocality::object::types::ObjectType;
use hwlocality::topology::builder::TopologyBuilder;

use super::assemble;
use crate::parallel::machine::{Core, Machine};
use crate::{Error, Result, memory};

/// Bytes that hwloc must be able to have before it is asked. Where memory is refused it does not
/// look at what it gets, or tries for ever (2.9, in `hwloc_linux_get_tid_cpubind`).
const ROOM: usize = 8 << 20;

fn has_room() -> Result<()> {
    memory::room::<u8>(ROOM, "bytes for hwloc").map(drop)
}

/// The system's processors that `may_use` names; `None` when hwloc finds none, or has no room.
pub fn system(may_use: impl Fn(usize) -> bool) -> Option<Machine> {
    has_room().ok()?;
    let topology = Topology::new().ok().filter(Topology::is_this_system)?;
    let nodes = memory_nodes(&topology);
    assemble(cores(&topology, &nodes, may_use), &distances(&topology, &nodes))
}

/// The machine of a synthetic description.
///
/// # Errors
/// [`Error::InvalidArgument`] where hwloc does not understand it; [`Error::OutOfMemory`].
pub fn synthetic(description: &str) -> Result<Machine> {
    has_room()?;
    let build =
        |description: &str| TopologyBuilder::new().from_synthetic(description).ok()?.build().ok();
    let machine = || {
        let ends_with_cores =
            description.split_whitespace().last().is_some_and(|level| level.starts_with("core"));
        let topology = if ends_with_cores {
            build(&format!("{description} pu:1"))?
        } else {
            build(description)?
        };
        let nodes = memory_nodes(&topology);
        let mut cores = cores(&topology, &nodes, |_| true);
        cores.iter_mut().for_each(|core| core.processors.clear());
        assemble(cores, &distances(&topology, &nodes))
    };
    machine().ok_or_else(|| {
        Error::InvalidArgument(format!(
            "topology '{description}' is no synthetic description that hwloc understands"
        ))
    })
}

fn memory_nodes(topology: &Topology) -> Vec<&TopologyObject> {
    topology.objects_with_type(ObjectType::NUMANode).collect()
}

/// The cores that have processors of `may_use`, in hwloc's order, in which what shares caches and
/// packages stands together. Objects' own numbers are the names of caches and packages.
fn cores(
    topology: &Topology,
    nodes: &[&TopologyObject],
    may_use: impl Fn(usize) -> bool,
) -> Vec<Core> {
    let mut cores = Vec::new();
    let mut last = None;
    for unit in topology.objects_with_type(ObjectType::PU) {
        let (Some(processor), Some(set)) = (unit.os_index(), unit.cpuset()) else { continue };
        // The first: memory of several kinds may lie at the same cores, the ordinary one first.
        let Some(node) = nodes.iter().position(|node| node.covers_cpuset(set)) else { continue };
        if !may_use(processor) {
            continue;
        }
        let core = unit
            .first_ancestor_with_type(ObjectType::Core)
            .unwrap_or(unit)
            .global_persistent_index();
        if last.replace(core) != Some(core) {
            let name = |object: Option<&TopologyObject>| {
                object.unwrap_or(nodes[node]).global_persistent_index() as usize
            };
            cores.push(Core {
                node,
                cache: name(
                    unit.ancestors()
                        .filter(|object| object.object_type().is_cpu_data_cache())
                        .last(),
                ),
                package: name(unit.first_ancestor_with_type(ObjectType::Package)),
                processors: Vec::new(),
            });
        }
        if let Some(core) = cores.last_mut() {
            core.processors.push(processor);
        }
    }
    cores
}

/// Distances between memory nodes, the larger the farther.
fn distances(topology: &Topology, nodes: &[&TopologyObject]) -> Vec<Vec<u64>> {
    let told = |kind: DistancesKind, distance: fn(u64) -> u64| -> Option<Vec<Vec<u64>>> {
        topology.distances(Some(kind)).ok()?.iter().find_map(|matrix| {
            let places: Vec<usize> =
                nodes.iter().map(|node| matrix.object_idx(node)).collect::<Option<_>>()?;
            let (all, values) = (matrix.num_objects(), matrix.distances());
            let row = |&a: &usize| places.iter().map(|b| distance(values[a * all + b])).collect();
            Some(places.iter().map(row).collect())
        })
    };
    told(DistancesKind::MEANS_LATENCY, |latency| latency)
        .or_else(|| told(DistancesKind::MEANS_BANDWIDTH, |bandwidth| u64::MAX - bandwidth))
        .unwrap_or_else(|| {
            nodes
                .iter()
                .map(|a| nodes.iter().map(|b| distance_in_tree(nodes, a, b)).collect())
                .collect()
        })
}

fn distance_in_tree(nodes: &[&TopologyObject], a: &TopologyObject, b: &TopologyObject) -> u64 {
    let holds = |unit: &TopologyObject, node: &TopologyObject| {
        node.ancestors().any(|object| std::ptr::eq(object, unit))
    };
    let units_without = |a: &TopologyObject, b: &TopologyObject| {
        let units = a
            .ancestors()
            .filter(|unit| matches!(unit.object_type(), ObjectType::Package | ObjectType::Group));
        units
            .filter(|unit| {
                !holds(unit, b) && nodes.iter().filter(|node| holds(unit, node)).count() > 1
            })
            .count()
    };
    if std::ptr::eq(a, b) { 0 } else { 1 + units_without(a, b).max(units_without(b, a)) as u64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hops(machine: &Machine) -> Vec<u32> {
        (0..machine.nodes()).map(|b| machine.hops(0, b)).collect()
    }

    #[test]
    fn descriptions_become_machines() {
        for description in ["numa:4 core:4 pu:1", "numa:4 core:4", "node:4 core:4 pu:2"] {
            let machine = Machine::synthetic(description).unwrap();
            assert_eq!(
                (machine.nodes(), machine.total_cores(), machine.cores(3)),
                (4, 16, 4),
                "{description}"
            );
            assert_eq!(hops(&machine), [0, 1, 1, 1], "{description}");
            assert!(machine.all_cores().iter().all(|core| core.processors.is_empty()));
        }
    }

    #[test]
    fn packages_and_groups_are_farther_apart() {
        let machine = Machine::synthetic("pack:2 numa:2 l3:2 core:2 pu:2").unwrap();
        assert_eq!(hops(&machine), [0, 1, 2, 2]);
        let caches: Vec<bool> = (0..7)
            .map(|worker| {
                machine.core_of_worker(worker).cache == machine.core_of_worker(worker + 1).cache
            })
            .collect();
        assert_eq!(caches, [true, false, true, false, true, false, true]);
        assert_eq!(machine.core_of_worker(7).package, machine.core_of_worker(0).package);
        assert_ne!(machine.core_of_worker(8).package, machine.core_of_worker(0).package);

        let machine = Machine::synthetic("group:2 pack:2 numa:2 core:4 pu:1").unwrap();
        assert_eq!(hops(&machine), [0, 1, 2, 2, 3, 3, 3, 3]);
        // Packages of one node each, and sockets within a node, as on Blacklight.
        let machine = Machine::synthetic("group:2 numa:3 pack:2 core:8 pu:1").unwrap();
        assert_eq!((hops(&machine), machine.cores(5)), (vec![0, 1, 1, 2, 2, 2], 16));
    }

    /// What hwloc would write about four packages of one core and one node each, with a matrix of
    /// distances.
    fn four_packages(kind: u32, distances: &str) -> String {
        let sets = |set: u32| {
            let words = ["cpuset", "complete_cpuset", "nodeset", "complete_nodeset"];
            words.map(|word| format!("{word}=\"{set:#010x}\"")).join(" ")
        };
        let package = |at: u32| {
            let (sets, id) = (sets(1 << at), 10 * at);
            let object = |kind: &str, id: u32, more: &str| {
                format!("<object type=\"{kind}\" os_index=\"{at}\" {sets} gp_index=\"{id}\"{more}")
            };
            [
                object("Package", id + 2, ">"),
                object("NUMANode", id + 3, " local_memory=\"1073741824\"/>"),
                object("Core", id + 4, ">"),
                object("PU", id + 5, "/></object></object>"),
            ]
            .concat()
        };
        let packages: String = (0..4).map(package).collect();
        let (all, length) = (sets(15), distances.len());
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <!DOCTYPE topology SYSTEM \"hwloc2.dtd\">\n\
             <topology version=\"2.0\"><object type=\"Machine\" os_index=\"0\" {all} \
             allowed_cpuset=\"0xf\" allowed_nodeset=\"0xf\" gp_index=\"1\">{packages}</object>\
             <distances2 type=\"NUMANode\" nbobjs=\"4\" kind=\"{kind}\" indexing=\"os\">\
             <indexes length=\"8\">0 1 2 3 </indexes>\
             <u64values length=\"{length}\">{distances}</u64values></distances2></topology>\n"
        )
    }

    #[test]
    fn the_systems_distances_count() {
        // A ring, by latencies (kind 4) and by bandwidths (8), both told by the system (1).
        let latencies = "10 16 22 16 16 10 16 22 22 16 10 16 16 22 16 10 ";
        let bandwidths = "90 40 20 40 40 90 40 20 20 40 90 40 40 20 40 90 ";
        for (kind, distances_told) in [(5, latencies), (9, bandwidths)] {
            let xml = four_packages(kind, distances_told);
            let topology = TopologyBuilder::new().from_xml(&xml).unwrap().build().unwrap();
            let nodes = memory_nodes(&topology);
            let may_use = |processor| processor != 1;
            let machine =
                assemble(cores(&topology, &nodes, may_use), &distances(&topology, &nodes)).unwrap();
            assert_eq!(
                (machine.total_cores(), hops(&machine), machine.hops(1, 2)),
                (3, vec![0, 2, 1], 1)
            );
            let processors: Vec<usize> =
                machine.all_cores().iter().map(|core| core.processors[0]).collect();
            assert_eq!(processors, [0, 2, 3]);
        }
    }

    #[test]
    fn nonsense_is_refused() {
        for description in
            ["numa", " ", "core", "many:4", "", "numa:0 core:4 pu:1", "numa:4\0 core:4"]
        {
            let error = Machine::synthetic(description).unwrap_err();
            assert!(matches!(error, Error::InvalidArgument(_)), "{description:?}: {error:?}");
        }
    }

    #[test]
    fn both_readers_see_the_same_system() {
        let may_use = |_| true;
        let (ours, theirs) =
            (super::super::sysfs::read("/sys/devices/system".as_ref(), may_use), system(may_use));
        if let (Some(ours), Some(theirs)) = (ours, theirs) {
            let processors = |machine: &Machine| {
                let mut cores: Vec<_> = machine
                    .all_cores()
                    .iter()
                    .map(|core| (core.node, core.processors.clone()))
                    .collect();
                cores.sort();
                cores
            };
            assert_eq!(processors(&ours), processors(&theirs));
        }
    }
}
