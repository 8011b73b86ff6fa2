//! Which workers are near to each other.
//!
//! Workers are not bound to processors; worker i is taken to run on the i-th, as an idle system spreads them. Where the system does not say what processors share, all are alike.

use std::fs;

use crate::params::Begging;

/// Groups of workers at each level, from the nearest to all.
#[derive(Clone, Debug)]
pub struct Levels {
    /// The group of each worker, by level.
    group: Vec<Vec<usize>>,
    /// How many workers each group has at the lowest level; how many groups of the level below, above.
    parts: Vec<Vec<usize>>,
}

impl Levels {
    /// The levels of this machine: last-level cache, socket, machine; or the last alone.
    pub fn of_machine(workers: usize, begging: Begging) -> Self {
        let mut levels = Vec::new();
        if begging == Begging::ByLevel {
            for what in ["cache/index3/shared_cpu_list", "topology/package_cpus_list"] {
                let name = |cpu: usize| fs::read_to_string(format!("/sys/devices/system/cpu/cpu{cpu}/{what}")).ok();
                let names: Vec<Option<String>> = (0..workers).map_while(|cpu| name(cpu).map(Some)).collect();
                // Workers beyond the processors share them with the first.
                if !names.is_empty() {
                    levels.push((0..workers).map(|worker| names[worker % names.len()].clone()).collect());
                }
            }
        }
        levels.push(vec![None; workers]);
        Self::new(&levels)
    }

    /// One level of groups with nothing above; each worker's group is given, by any number.
    pub fn apart(groups: &[usize]) -> Self {
        let count = groups.iter().max().map_or(0, |&most| most + 1);
        let members = (0..count).map(|group| groups.iter().filter(|&&g| g == group).count()).collect();
        Self { group: vec![groups.to_vec()], parts: vec![members] }
    }

    /// Levels from what each worker's group is called at each; the last level has one group. Levels that say the same as the one before, or put every worker
    /// by itself, are left out.
    pub fn new(names: &[Vec<Option<String>>]) -> Self {
        let mut levels = Self { group: Vec::new(), parts: Vec::new() };
        for names in names {
            let mut known: Vec<&Option<String>> = Vec::new();
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
            if levels.group.last() == Some(&group) {
                continue;
            }
            let parts = match levels.group.last() {
                None => members,
                Some(below) => {
                    let mut pairs: Vec<_> = group.iter().zip(below).collect();
                    pairs.sort_unstable();
                    pairs.dedup();
                    (0..members.len()).map(|at| pairs.iter().filter(|&&(&g, _)| g == at).count()).collect()
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

    /// Most workers that beg in a group's list, were all of them without work: its workers at the lowest level; above, the last of each group of the level below.
    pub fn most_beggars(&self, level: usize, group: usize) -> usize {
        self.parts[level][group]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<Option<String>> {
        names.iter().map(|&name| Some(name.to_owned())).collect()
    }

    #[test]
    fn levels_that_say_nothing_are_left_out() {
        let pairs = names(&["a", "a", "b", "b"]);
        let levels = Levels::new(&[names(&["1", "2", "3", "4"]), pairs.clone(), pairs, names(&["m"; 4])]);
        assert_eq!(levels.count(), 2);
        assert_eq!(levels.group, [[0, 0, 1, 1], [0, 0, 0, 0]]);
        assert_eq!(levels.parts, [vec![2, 2], vec![2]]);
    }

    #[test]
    fn one_worker_has_one_level() {
        for begging in [Begging::ByLevel, Begging::Flat] {
            let levels = Levels::of_machine(1, begging);
            assert_eq!((levels.count(), levels.workers(), levels.most_beggars(0, 0)), (1, 1, 1));
        }
    }

    #[test]
    fn flat_is_one_group_for_all() {
        let levels = Levels::of_machine(5, Begging::Flat);
        assert_eq!((levels.count(), levels.groups(0), levels.most_beggars(0, 0)), (1, 1, 5));
    }
}
