//! Halving a group of memory nodes, so that each half lies close together: LAPD does it before each
//! step (paper, line 10 of Fig. 4: blades are divided "based on their physical locations").
//!
//! A group is cut between its two nodes that are farthest apart, then nodes are moved and exchanged
//! as long as that helps, the best first (in the manner of B. W. Kernighan, S. Lin, "An efficient
//! heuristic procedure for partitioning graphs", 1970). What helps, in this order: halves of about
//! equal cores, fewer hops between the nodes of each half, halves of more equal cores. "About" is
//! less than the cores of the group's smallest node, so that a core more or less in a node (those
//! that the caller may not use) does not tear apart what lies together.
//!
//! The result is a local optimum; where nodes come in units, all within a unit being nearer to each
//! other than to any other, halves fall along the units where the numbers allow it. It depends on
//! nothing but the group and the machine.
//!
//! Cost: each step takes time and memory in the square of the group's nodes, and there are hardly
//! more steps than nodes.

use super::machine::Machine;

/// What a bisection costs; the less the better, in this order: the difference of cores in units of
/// the smallest node's, hops within the halves, the difference of cores.
type Cost = (u64, i64, u64);

impl Machine {
    /// Halves a group of memory nodes into two of about equal cores, each physically compact: with
    /// a small sum of hops between its nodes.
    ///
    /// Each half keeps the order of the group; the first has the group's first node. Halves of two
    /// nodes or more are not empty; of one node, or none, the second half is.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn bisect(&self, group: &[usize]) -> [Vec<usize>; 2] {
        if group.len() < 2 {
            return [group.to_vec(), Vec::new()];
        }
        let mut bisection = Bisection::between_the_farthest(self, group);
        while bisection.improve() {}
        let first = bisection.side[0];
        let (mut halves, side) = ([Vec::new(), Vec::new()], bisection.side);
        for (&node, side) in group.iter().zip(side) {
            halves[side ^ first].push(node);
        }
        halves
    }
}

/// A group of at least two nodes, and the side, 0 or 1, of each. Nodes are named by their place in
/// the group.
struct Bisection<'a> {
    machine: &'a Machine,
    group: &'a [usize],
    side: Vec<usize>,
    /// The cores of the smallest node.
    unit: u64,
}

impl<'a> Bisection<'a> {
    /// Nodes go to the nearer one of the two that are farthest apart, as many as makes the cores of
    /// both sides most equal.
    fn between_the_farthest(machine: &'a Machine, group: &'a [usize]) -> Self {
        let hops = |a: usize, b: usize| i64::from(machine.hops(group[a], group[b]));
        let (mut farthest, mut max) = ((0, 1), hops(0, 1));
        for a in 0..group.len() {
            for b in a + 1..group.len() {
                // Of pairs that are as far the one whose nodes stand farthest apart in the group:
                // its order decides where distance does not.
                if hops(a, b) > max || (hops(a, b) == max && a == farthest.0) {
                    (farthest, max) = ((a, b), hops(a, b));
                }
            }
        }
        let mut order: Vec<usize> = (0..group.len()).collect();
        order.sort_by_key(|&x| hops(farthest.0, x) - hops(farthest.1, x));
        let cores = |x: usize| machine.cores(group[x]) as u64;
        let all: u64 = order.iter().map(|&x| cores(x)).sum();
        let (mut taken, mut cut, mut min) = (0, 1, u64::MAX);
        for (count, &x) in order[..order.len() - 1].iter().enumerate() {
            taken += cores(x);
            // Of two that are as good the later: the first side is the larger one.
            if all.abs_diff(2 * taken) <= min {
                (cut, min) = (count + 1, all.abs_diff(2 * taken));
            }
        }
        let mut side = vec![0; group.len()];
        order[cut..].iter().for_each(|&x| side[x] = 1);
        let unit = (0..group.len()).map(cores).min().unwrap_or(1);
        Self { machine, group, side, unit }
    }

    fn cores(&self, x: usize) -> i64 {
        self.machine.cores(self.group[x]) as i64
    }

    fn hops(&self, a: usize, b: usize) -> i64 {
        i64::from(self.machine.hops(self.group[a], self.group[b]))
    }

    /// Makes the one move or exchange of nodes that saves most; false when none saves anything.
    fn improve(&mut self) -> bool {
        let nodes = self.group.len();
        // The hops of each node to all of each side.
        let mut to = vec![[0_i64; 2]; nodes];
        let (mut count, mut cores) = ([0, 0], [0_i64, 0]);
        for a in 0..nodes {
            count[self.side[a]] += 1;
            cores[self.side[a]] += self.cores(a);
            for b in 0..nodes {
                to[a][self.side[b]] += self.hops(a, b);
            }
        }
        let cost = |more_hops: i64, difference: i64| -> Cost {
            (difference.unsigned_abs() / self.unit, more_hops, difference.unsigned_abs())
        };
        let difference = cores[0] - cores[1];
        let mut best = (cost(0, difference), [None, None]);
        let mut consider = |cost: Cost, change| {
            if cost < best.0 {
                best = (cost, change);
            }
        };
        for a in 0..nodes {
            let (own, other) = (self.side[a], 1 - self.side[a]);
            let sign = if own == 0 { -2 } else { 2 };
            if count[own] > 1 {
                let more_hops = to[a][other] - to[a][own];
                consider(cost(more_hops, difference + sign * self.cores(a)), [Some(a), None]);
            }
            for b in (a + 1..nodes).filter(|&b| self.side[b] == other) {
                // The hops between the two stand in two of the sums, and lie between the halves
                // before and after.
                let more_hops =
                    to[a][other] - to[a][own] + to[b][own] - to[b][other] - 2 * self.hops(a, b);
                consider(
                    cost(more_hops, difference + sign * (self.cores(a) - self.cores(b))),
                    [Some(a), Some(b)],
                );
            }
        }
        best.1.iter().flatten().for_each(|&x| self.side[x] ^= 1);
        best.1[0].is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_fall_along_the_units() {
        let machine = Machine::blacklight(32);
        // Six blades of each unit, interleaved.
        let group: Vec<usize> = (0..6).flat_map(|blade| [2 * blade, 16 + blade]).collect();
        let [first, second] = machine.bisect(&group);
        assert_eq!(first, [0, 2, 4, 6, 8, 10]);
        assert_eq!(second, [16, 17, 18, 19, 20, 21]);
        // Eight of one, four of the other: these stay together.
        let group = [0, 1, 16, 2, 3, 17, 4, 5, 18, 6, 7, 19];
        let halves = machine.bisect(&group);
        assert_eq!(halves.each_ref().map(Vec::len), [6, 6]);
        assert!(
            halves.iter().any(|half| [16, 17, 18, 19].iter().all(|blade| half.contains(blade))),
            "{halves:?}"
        );
    }

    #[test]
    fn odd_numbers_differ_by_one_node() {
        let machine = Machine::uniform(7, 4);
        let halves = machine.bisect(&[6, 5, 4, 3, 2, 1, 0]);
        assert_eq!(halves, [vec![6, 5, 4, 3], vec![2, 1, 0]]);
    }

    #[test]
    fn one_node_has_no_second_half() {
        let machine = Machine::uniform(2, 4);
        assert_eq!(machine.bisect(&[1]), [vec![1], vec![]]);
        assert_eq!(machine.bisect(&[]), [Vec::<usize>::new(), Vec::new()]);
        assert_eq!(machine.bisect(&[1, 0]), [vec![1], vec![0]]);
    }

    #[test]
    fn a_core_less_does_not_part_what_lies_together() {
        let hops = |a: usize, b: usize| if a == b { 0 } else { 1 + u32::from(a / 2 != b / 2) };
        let hops: Vec<Vec<u32>> = (0..4).map(|a| (0..4).map(|b| hops(a, b)).collect()).collect();
        let machine = Machine::new(vec![8, 8, 7, 7], hops.clone()).unwrap();
        assert_eq!(machine.bisect(&[0, 1, 2, 3]), [vec![0, 1], vec![2, 3]]);
        // A node as large as three others stands against them.
        let machine = Machine::new(vec![12, 4, 4, 4], hops).unwrap();
        assert_eq!(machine.bisect(&[0, 1, 2, 3]), [vec![0], vec![1, 2, 3]]);
    }

    /// The hops within both halves, and the difference of cores.
    fn measure(machine: &Machine, halves: &[Vec<usize>; 2]) -> (u32, usize) {
        let within = |half: &[usize]| -> u32 {
            half.iter()
                .flat_map(|&a| half.iter().map(move |&b| (a, b)))
                .map(|(a, b)| machine.hops(a, b))
                .sum()
        };
        let cores = |half: &[usize]| half.iter().map(|&node| machine.cores(node)).sum::<usize>();
        (
            halves.iter().map(|half| within(half)).sum(),
            cores(&halves[0]).abs_diff(cores(&halves[1])),
        )
    }

    /// Nodes in units of units, of every shape up to ten nodes, against all bisections of the same
    /// balance.
    #[test]
    fn nested_units_are_halved_as_well_as_possible() {
        for (nodes, unit, subunit) in
            [(10, 5, 2), (9, 4, 2), (8, 4, 2), (8, 3, 3), (10, 4, 1), (7, 2, 1), (6, 4, 2)]
        {
            let hops = |a: usize, b: usize| {
                u32::from(a != b)
                    + u32::from(a / subunit != b / subunit)
                    + 2 * u32::from(a / unit != b / unit)
            };
            let hops = (0..nodes).map(|a| (0..nodes).map(|b| hops(a, b)).collect()).collect();
            let machine = Machine::new(vec![8; nodes], hops).unwrap();
            let group: Vec<usize> = (0..nodes).map(|k| k * 7 % nodes).collect();
            let group = if nodes == 7 { (0..7).rev().collect() } else { group };
            let (within, difference) = measure(&machine, &machine.bisect(&group));
            assert_eq!(difference, nodes % 2 * 8);
            let min = (1..1_u32 << nodes)
                .filter(|set| (set.count_ones() as usize) == nodes / 2)
                .map(|set| {
                    let half = |side| (0..nodes).filter(|&node| set >> node & 1 == side).collect();
                    measure(&machine, &[half(1), half(0)]).0
                });
            assert_eq!(Some(within), min.min(), "{nodes} nodes in units of {unit} and {subunit}");
        }
    }
}
