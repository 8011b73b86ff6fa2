//! The machine as Linux tells it in `/sys/devices/system`: `cpu/cpuN/{topology,cache}` and
//! `node/nodeN/{cpulist,distance}` (the kernel's Documentation/ABI/stable/sysfs-devices-node and
//! sysfs-devices-system-cpu).
//!
//! Nothing is required: a processor whose core is not told is a core of its own, one whose node is
//! not told belongs to the first, caches and packages that are not told are those of the node.
//! Systems without `/sys` have no file there.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::assemble;
use crate::parallel::machine::{Core, Machine};

/// The processors under `root` that `may_use` names; `None` when there are none.
pub fn read(root: &Path, may_use: impl Fn(usize) -> bool) -> Option<Machine> {
    let nodes = numbered(&root.join("node"), "node");
    let members: Vec<Vec<usize>> = nodes
        .iter()
        .map(|node| list(&root.join(format!("node/node{node}/cpulist"))).unwrap_or_default())
        .collect();
    let mut cores: BTreeMap<(usize, usize), Core> = BTreeMap::new();
    for processor in
        numbered(&root.join("cpu"), "cpu").into_iter().filter(|&processor| may_use(processor))
    {
        let cpu = root.join(format!("cpu/cpu{processor}"));
        let node = members.iter().position(|members| members.contains(&processor)).unwrap_or(0);
        let node_name = members.get(node).and_then(|members| members.first()).copied().unwrap_or(0);
        // What processors share is named by the first of them.
        let core = first(&cpu.join("topology/thread_siblings_list")).unwrap_or(processor);
        cores
            .entry((node, core))
            .or_insert_with(|| Core {
                node,
                cache: last_cache(&cpu).unwrap_or(node_name),
                package: text(&cpu.join("topology/physical_package_id"))
                    .and_then(|id| id.parse().ok())
                    .unwrap_or(node),
                processors: Vec::new(),
            })
            .processors
            .push(processor);
    }
    // Packages and caches stand together, so that the first workers share as much as they can.
    let mut cores: Vec<Core> = cores.into_values().collect();
    cores.sort_by_key(|core| (core.node, core.package, core.cache));
    let count = nodes.len().max(1);
    let told = nodes.iter().map(|node| {
        let row = text(&root.join(format!("node/node{node}/distance")))?;
        let row: Vec<u64> =
            row.split_whitespace().map(|number| number.parse().ok()).collect::<Option<_>>()?;
        // One number for each node that is online, as there is a folder for each.
        (row.len() == count).then_some(row)
    });
    let told: Option<Vec<Vec<u64>>> = told.collect();
    let alike = || (0..count).map(|a| (0..count).map(|b| u64::from(a != b)).collect()).collect();
    assemble(cores, &told.filter(|rows| !rows.is_empty()).unwrap_or_else(alike))
}

/// The numbers of the entries of a folder that are `prefix` and a number, ascending.
fn numbered(folder: &Path, prefix: &str) -> Vec<usize> {
    let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let mut numbers: Vec<usize> =
        names.filter_map(|name| name.to_str()?.strip_prefix(prefix)?.parse().ok()).collect();
    numbers.sort_unstable();
    numbers
}

/// A file's text without the line's end.
fn text(path: &Path) -> Option<String> {
    Some(fs::read_to_string(path).ok()?.trim().to_owned())
}

/// A list of numbers and ranges such as `0-3,8`, as the kernel writes sets of processors.
fn list(path: &Path) -> Option<Vec<usize>> {
    let mut numbers = Vec::new();
    for range in text(path)?.split(',').filter(|range| !range.is_empty()) {
        let (from, to) = range.split_once('-').unwrap_or((range, range));
        numbers.extend(from.parse::<usize>().ok()?..=to.parse().ok()?);
    }
    Some(numbers)
}

fn first(path: &Path) -> Option<usize> {
    list(path)?.first().copied()
}

/// The cache that is farthest from a processor, by its first processor.
fn last_cache(cpu: &Path) -> Option<usize> {
    let level = |index: &usize| {
        text(&cpu.join(format!("cache/index{index}/level")))
            .and_then(|level| level.parse::<usize>().ok())
    };
    let last = numbered(&cpu.join("cache"), "index").into_iter().max_by_key(level)?;
    first(&cpu.join(format!("cache/index{last}/shared_cpu_list")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(root: &Path, path: &str, text: &str) {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }

    /// Two packages of two nodes, a node of two cores of two threads: those of core c are c and c +
    /// 8. A cache for each package. Node 4 is memory alone.
    fn two_packages(root: &Path) {
        for processor in 0..16 {
            let (core, cpu) = (processor % 8, format!("cpu/cpu{processor}"));
            write(
                root,
                &format!("{cpu}/topology/thread_siblings_list"),
                &format!("{core},{}", core + 8),
            );
            write(root, &format!("{cpu}/topology/physical_package_id"), &format!("{}", core / 4));
            for (index, level, shared) in [
                (0, 1, format!("{core},{}", core + 8)),
                (1, 3, ["0-3,8-11", "4-7,12-15"][core / 4].into()),
            ] {
                write(root, &format!("{cpu}/cache/index{index}/level"), &format!("{level}"));
                write(root, &format!("{cpu}/cache/index{index}/shared_cpu_list"), &shared);
            }
        }
        let rows = [
            "10 12 32 32 20",
            "12 10 32 32 20",
            "32 32 10 12 20",
            "32 32 12 10 20",
            "20 20 20 20 10",
        ];
        for (node, row) in rows.into_iter().enumerate() {
            let (core, members) = (2 * node, format!("node/node{node}/cpulist"));
            let list = if node < 4 {
                format!("{core}-{},{}-{}", core + 1, core + 8, core + 9)
            } else {
                String::new()
            };
            write(root, &members, &list);
            write(root, &format!("node/node{node}/distance"), row);
        }
        // No processor and no node, though their names begin alike.
        write(root, "cpu/cpuidle/current_driver", "none");
        write(root, "node/online", "0-4");
    }

    #[test]
    fn nodes_cores_and_distances_are_read() {
        let folder = tempfile::tempdir().unwrap();
        two_packages(folder.path());
        let machine = read(folder.path(), |_| true).unwrap();
        assert_eq!((machine.nodes(), machine.total_cores()), (4, 8));
        assert_eq!([machine.hops(0, 1), machine.hops(0, 2), machine.hops(3, 2)], [1, 2, 1]);
        let fourth = machine.core_of_worker(3);
        assert_eq!(*fourth, Core { node: 1, cache: 0, package: 0, processors: vec![3, 11] });
        assert_eq!((machine.core_of_worker(4).cache, machine.core_of_worker(4).package), (4, 1));
    }

    #[test]
    fn what_the_caller_may_not_use_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        two_packages(folder.path());
        // One thread of a core of node 0, a core of node 3.
        let machine = read(folder.path(), |processor| [9, 7, 15].contains(&processor)).unwrap();
        assert_eq!((machine.nodes(), machine.total_cores(), machine.hops(0, 1)), (2, 2, 1));
        assert_eq!(
            (&machine.core_of_worker(0).processors[..], &machine.core_of_worker(1).processors[..]),
            (&[9][..], &[7, 15][..])
        );
        assert_eq!(read(folder.path(), |_| false), None);
    }

    #[test]
    fn little_is_enough() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read(folder.path(), |_| true), None);
        for processor in 0..3 {
            write(folder.path(), &format!("cpu/cpu{processor}/online"), "1");
        }
        let machine = read(folder.path(), |_| true).unwrap();
        assert_eq!((machine.nodes(), machine.total_cores()), (1, 3));
        // Nodes, but no distances that can be read.
        for (node, distances) in ["10 20", "nonsense"].into_iter().enumerate() {
            write(folder.path(), &format!("node/node{node}/cpulist"), &format!("{node}"));
            write(folder.path(), &format!("node/node{node}/distance"), distances);
        }
        let machine = read(folder.path(), |_| true).unwrap();
        assert_eq!((machine.nodes(), machine.cores(0), machine.hops(0, 1)), (2, 2, 1));
    }
}
