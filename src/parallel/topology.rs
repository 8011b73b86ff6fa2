//! Which workers are near to each other: the groups in which they beg.
//!
//! Worker i is taken to run on the machine's i-th core; where workers are not bound an idle system
//! spreads them much like that. Where nothing is told of what cores share, all are alike.

use super::machine::{Core, Machine};
use super::policy::Begging;

/// Groups of workers at each level, from the nearest to all.
#[derive(Clone, Debug)]
pub struct Levels {
    /// The group of each worker, by level.
    group: Vec<Vec<usize>>,
    /// How many workers each group has at the lowest level; how many groups of the level below,
    /// above.
    parts: Vec<Vec<usize>>,
}

impl Levels {
    /// The levels of a machine: last-level cache, memory node, package, from the smallest to the
    /// largest (a package may hold several nodes, or a node several packages), and all; or the last
    /// alone.
    pub fn of(machine: &Machine, workers: usize, begging: Begging) -> Self {
        let mut levels: Vec<Vec<usize>> = Vec::new();
        if begging == Begging::ByLevel {
            let what: [fn(&Core) -> usize; 3] =
                [|core| core.cache, |core| core.node, |core| core.package];
            levels.extend(what.map(|name| {
                (0..workers).map(|worker| name(machine.core_of_worker(worker))).collect()
            }));
            levels.sort_by_key(|names| {
                let mut names = names.clone();
                names.sort_unstable();
                names.dedup();
                std::cmp::Reverse(names.len())
            });
        }
        levels.push(vec![0; workers]);
        Self::new(&levels)
    }

    /// One level of groups with nothing above; each worker's group is given, by any number.
    pub fn apart(groups: &[usize]) -> Self {
        let count = groups.iter().max().map_or(0, |&max| max + 1);
        let members =
            (0..count).map(|group| groups.iter().filter(|&&g| g == group).count()).collect();
        Self { group: vec![groups.to_vec()], parts: vec![members] }
    }

    /// Levels from what each worker's group is called at each; the last level has one group. Left
    /// out are levels that say the same as the one before, that put every worker by itself, or
    /// whose groups cut through those of the level before.
    pub fn new(names: &[Vec<usize>]) -> Self {
        let mut levels = Self { group: Vec::new(), parts: Vec::new() };
        for names in names {
            let mut known = Vec::new();
            let mut members = Vec::new();
            let group = names.iter().map(|name| {
                let at = known.iter().position(|&k| k == name).unwrap_or_else(|| {
                    known.push(name);
                    members.push(0);
                    known.len() - 1
                });
                members[at] += 1;
                at
            });
            let group: Vec<usize> = group.collect();
            if members.iter().all(|&count| count == 1) && members.len() > 1 {
                continue;
            }
            let parts = match levels.group.last() {
                None => members,
                Some(below) if *below == group => continue,
                Some(below) => {
                    let mut pairs: Vec<_> = group.iter().zip(below).collect();
                    pairs.sort_unstable();
                    pairs.dedup();
                    if pairs.len() > levels.parts.last().map_or(0, Vec::len) {
                        continue;
                    }
                    (0..members.len())
                        .map(|at| pairs.iter().filter(|&&(&g, _)| g == at).count())
                        .collect()
                }
            };
            levels.group.push(group);
            levels.parts.push(parts);
        }
        levels
    }

    /// How many levels there are; at least 1.
    pub fn count(&self) -> usize {
        self.group.len()
    }

    /// How many workers there are.
    pub fn workers(&self) -> usize {
        self.group[0].len()
    }

    /// How many groups a level has.
    pub fn groups(&self, level: usize) -> usize {
        self.parts[level].len()
    }

    /// The group of a worker at a level.
    pub fn group(&self, level: usize, worker: usize) -> usize {
        self.group[level][worker]
    }

    /// Most workers that beg in a group's list, were all of them without work: its workers at the
    /// lowest level; above, the last of each group of the level below.
    pub fn max_beggars(&self, level: usize, group: usize) -> usize {
        self.parts[level][group]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_that_say_nothing_are_left_out() {
        let pairs = vec![7, 7, 3, 3];
        let levels =
            Levels::new(&[vec![1, 2, 3, 4], pairs.clone(), pairs, vec![0, 1, 1, 1], vec![5; 4]]);
        assert_eq!(levels.group, [[0, 0, 1, 1], [0, 0, 0, 0]]);
        assert_eq!(levels.parts, [vec![2, 2], vec![2]]);
    }

    #[test]
    fn one_worker_has_one_level() {
        for begging in [Begging::ByLevel, Begging::Flat] {
            let levels = Levels::of(&Machine::blacklight(2), 1, begging);
            assert_eq!((levels.count(), levels.workers(), levels.max_beggars(0, 0)), (1, 1, 1));
        }
    }

    #[test]
    fn flat_is_one_group_for_all() {
        let levels = Levels::of(&Machine::uniform(5, 1), 5, Begging::Flat);
        assert_eq!((levels.count(), levels.groups(0), levels.max_beggars(0, 0)), (1, 1, 5));
    }

    /// Sockets of eight cores, two on a blade; and packages of several nodes, of several caches
    /// each.
    #[test]
    fn levels_go_from_the_smallest_group_to_the_largest() {
        let levels = Levels::of(&Machine::blacklight(2), 32, Begging::ByLevel);
        assert_eq!(levels.parts, [vec![8; 4], vec![2; 2], vec![2]]);
        let core = |core: usize| Core {
            node: core / 4,
            cache: core / 2,
            package: core / 8,
            processors: Vec::new(),
        };
        let machine = Machine::of_cores((0..16).map(core).collect(), uniform_hops(4)).unwrap();
        let levels = Levels::of(&machine, 16, Begging::ByLevel);
        assert_eq!(levels.parts, [vec![2; 8], vec![2; 4], vec![2; 2], vec![2]]);
        // A cache for a package, of two nodes.
        let core = |core: usize| Core {
            node: core / 4,
            cache: core / 8,
            package: core / 8,
            processors: Vec::new(),
        };
        let machine = Machine::of_cores((0..16).map(core).collect(), uniform_hops(4)).unwrap();
        assert_eq!(
            Levels::of(&machine, 16, Begging::ByLevel).parts,
            [vec![4; 4], vec![2; 2], vec![2]]
        );
        // Workers beyond the cores share them with the first.
        assert_eq!(
            Levels::of(&machine, 20, Begging::ByLevel).parts,
            [vec![8, 4, 4, 4], vec![2; 2], vec![2]]
        );
    }

    fn uniform_hops(nodes: usize) -> Vec<Vec<u32>> {
        (0..nodes).map(|a| (0..nodes).map(|b| u32::from(a != b)).collect()).collect()
    }
}
