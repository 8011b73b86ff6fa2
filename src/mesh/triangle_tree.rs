//! Nearest triangle of a set, by a hierarchy of bounding boxes split at the median (Ericson, "Real-Time Collision Detection", 2005,
//! sections 5.1.5 and 6.2).
//!
//! Built once, O(n log n), the halves in parallel in the current rayon pool; read-only afterwards, so any number of threads may ask. The hierarchy does
//! not depend on the number of threads. A query that starts from a triangle known to be near
//! visits only the few boxes that come closer; the surface is walked in scan order, and the answer for one point is that start for the
//! next. A query may ask for triangles of one label alone: a bit for every 64th label tells in which boxes there may be some.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::Result;
use crate::memory::room;
use crate::monitor::Monitor;

/// Triangles per leaf at most.
const LEAF: usize = 4;

/// The box around no points.
const NOTHING: [DVec3; 2] = [DVec3::INFINITY, DVec3::NEG_INFINITY];

/// Levels of boxes at most: halving as many triangles as u32 counts gives leaves after 30.
const LEVELS: usize = 32;

/// Hierarchies over at most twice as many triangles are built by one thread.
const ALONE: usize = 1 << 11;

/// Boxes between two looks at the cancel flag when their memory is touched.
const FILL: usize = 1 << 16;

/// A triangle, and the ids of the labels on its two sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle {
    pub corners: [DVec3; 3],
    pub ids: [u16; 2],
}

impl Triangle {
    fn labels(&self) -> u64 {
        self.ids.iter().fold(0, |labels, &id| labels | bit(id))
    }
}

/// The bit of a label among the labels of a box.
fn bit(id: u16) -> u64 {
    1 << (id % 64)
}

/// What is sorted instead of a triangle: five times smaller. Rounding costs nothing but the balance of boxes.
#[derive(Clone, Copy)]
struct Item {
    /// Three times the centre.
    centre: Vec3,
    index: u32,
}

/// A box of the hierarchy. Its left child follows it in the array.
#[derive(Clone, Copy)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// The bits of all labels in it.
    labels: u64,
    /// Of a leaf, its first triangle; of an inner node, its right child.
    link: u32,
    /// Triangles of a leaf; 0 marks an inner node.
    count: u32,
}

impl Node {
    const EMPTY: Self = Self { min: DVec3::ZERO, max: DVec3::ZERO, labels: 0, link: 0, count: 0 };

    /// Squared distance from `p` to the box; infinite if it has none of `labels`.
    #[inline]
    fn distance_squared(&self, p: DVec3, labels: u64) -> f64 {
        if self.labels & labels == 0 {
            return f64::INFINITY;
        }
        p.distance_squared(p.clamp(self.min, self.max))
    }
}

/// A triangle and its squared distance from the point that was asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// Index in the tree's own order; good for nothing but [`TriangleTree::nearest`]'s start.
    pub slot: usize,
    pub distance_squared: f64,
}

/// The hierarchy over a set of triangles.
pub(super) struct TriangleTree {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
    /// Whether any triangle has label id `i`.
    has_id: Vec<bool>,
}

impl TriangleTree {
    /// Takes finite, possibly degenerate triangles.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(triangles: Vec<Triangle>, monitor: &Monitor<'_>) -> Result<Self> {
        let mut has_id = vec![false; usize::from(u16::MAX) + 1];
        for part in triangles.chunks(FILL) {
            monitor.advance(0)?;
            part.iter().flat_map(|t| t.ids).for_each(|id| has_id[usize::from(id)] = true);
        }
        let count = boxes(triangles.len());
        let mut nodes: Vec<Node> = room(count, "boxes around triangles")?;
        while nodes.len() < count {
            monitor.advance(0)?;
            let more = (count - nodes.len()).min(FILL);
            nodes.par_extend(rayon::iter::repeat_n(Node::EMPTY, more));
        }
        let mut items: Vec<Item> = room(triangles.len(), "triangles of the interfaces")?;
        for first in (0..triangles.len()).step_by(FILL) {
            monitor.advance(0)?;
            let part = first..(first + FILL).min(triangles.len());
            let centre = |i: usize| triangles[i].corners.iter().sum::<DVec3>().as_vec3();
            items.par_extend(part.into_par_iter().map(|i| Item { centre: centre(i), index: i as u32 }));
        }
        if count > 0 {
            build(&triangles, &mut items, 0, &mut nodes, 0, monitor)?;
        }
        let mut ordered: Vec<Triangle> = room(triangles.len(), "triangles of the interfaces")?;
        for part in items.chunks(FILL) {
            monitor.advance(0)?;
            ordered.par_extend(part.par_iter().map(|item| triangles[item.index as usize]));
        }
        let triangles = ordered;
        Ok(Self { triangles, nodes, has_id })
    }

    /// Squared distance from `p` to the triangle in `slot`.
    #[inline]
    pub fn distance_squared_to(&self, slot: usize, p: DVec3) -> f64 {
        p.distance_squared(closest_point(&self.triangles[slot].corners, p))
    }

    /// Whether label id `id` is on one side of the triangle in `slot`.
    #[inline]
    pub fn touches(&self, slot: usize, id: u16) -> bool {
        self.triangles[slot].ids.contains(&id)
    }

    /// The triangle nearest to `p`; `start` is one that is thought to be near and changes only the time taken. `None` if there are no
    /// triangles.
    pub fn nearest(&self, p: DVec3, start: Option<usize>) -> Option<Nearest> {
        let slot = start.unwrap_or(0);
        self.nodes.first()?;
        let best = Nearest { slot, distance_squared: self.distance_squared_to(slot, p) };
        Some(self.search(p, best, u64::MAX, |_| true))
    }

    /// The same among the triangles with label id `id` on one side; so has `start`.
    pub fn nearest_of(&self, id: u16, p: DVec3, start: Option<usize>) -> Option<Nearest> {
        if !self.has_id[usize::from(id)] {
            return None;
        }
        let to = |slot| Nearest { slot, distance_squared: self.distance_squared_to(slot, p) };
        let best = start.map_or(Nearest { slot: 0, distance_squared: f64::INFINITY }, to);
        Some(self.search(p, best, bit(id), |slot| self.touches(slot, id)))
    }

    /// The nearest of the `wanted` triangles, if it is nearer than `best`; otherwise `best`. Boxes without `labels` have none of them.
    #[inline]
    fn search(&self, p: DVec3, mut best: Nearest, labels: u64, wanted: impl Fn(usize) -> bool) -> Nearest {
        // Boxes left behind, each with a bound: at most one of each level.
        let mut stack = [(0.0, 0_u32); LEVELS];
        let mut depth = 0;
        let mut index = 0;
        loop {
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for slot in node.link as usize..(node.link + node.count) as usize {
                    let distance_squared = self.distance_squared_to(slot, p);
                    if distance_squared < best.distance_squared && wanted(slot) {
                        best = Nearest { slot, distance_squared };
                    }
                }
            } else {
                let mut near = (self.nodes[index as usize + 1].distance_squared(p, labels), index + 1);
                let mut far = (self.nodes[node.link as usize].distance_squared(p, labels), node.link);
                if far.0 < near.0 {
                    std::mem::swap(&mut near, &mut far);
                }
                if far.0 < best.distance_squared {
                    stack[depth] = far;
                    depth += 1;
                }
                if near.0 < best.distance_squared {
                    index = near.1;
                    continue;
                }
            }
            index = loop {
                if depth == 0 {
                    return best;
                }
                depth -= 1;
                let (bound, index) = stack[depth];
                if bound < best.distance_squared {
                    break index;
                }
            };
        }
    }
}

/// How many boxes a hierarchy over so many triangles has.
fn boxes(triangles: usize) -> usize {
    // Halves of one level differ by one at most: boxes of a size, and of that size less one.
    let (mut smaller, mut larger) = (0, usize::from(triangles > 0));
    let (mut size, mut total) = (triangles, 0);
    while smaller + larger > 0 {
        total += smaller + larger;
        let split = |size: usize, boxes: usize| if size > LEAF { boxes } else { 0 };
        let (from_smaller, from_larger) = (split(size - 1, smaller), split(size, larger));
        // A box of an even number 2 m gives m and m, one of 2 m + 1 gives m and m + 1.
        (smaller, larger) = if size % 2 == 0 {
            (from_smaller, from_smaller + 2 * from_larger)
        } else {
            (2 * from_smaller + from_larger, from_larger)
        };
        size = size.div_ceil(2);
    }
    total
}

/// Builds the hierarchy over the `triangles` of `items`, the first of which comes to place `first`, in `nodes`, the first of which has index `index`, and brings the
/// items into its order. Returns the corners of the box around them, and their labels.
fn build(
    triangles: &[Triangle],
    items: &mut [Item],
    first: usize,
    nodes: &mut [Node],
    index: usize,
    monitor: &Monitor<'_>,
) -> Result<([DVec3; 2], u64)> {
    monitor.advance(0)?;
    let around = |[min, max]: [DVec3; 2], p: DVec3| [min.min(p), max.max(p)];
    if items.len() <= LEAF {
        let own = || items.iter().map(|item| &triangles[item.index as usize]);
        let [min, max] = own().flat_map(|t| t.corners).fold(NOTHING, around);
        let labels = own().fold(0, |labels, t| labels | t.labels());
        nodes[0] = Node { min, max, labels, link: first as u32, count: items.len() as u32 };
        return Ok(([min, max], labels));
    }
    let centres = items.iter().map(|item| item.centre);
    let (least, most) =
        centres.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(least, most), p| (least.min(p), most.max(p)));
    let axis = (most - least).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |s, t| s.centre[axis].total_cmp(&t.centre[axis]));
    let (left, right) = items.split_at_mut(middle);
    let (own, below) = nodes.split_at_mut(1);
    let (left_nodes, right_nodes) = below.split_at_mut(boxes(middle));
    let right_index = index + 1 + left_nodes.len();
    let mut build_left = || build(triangles, left, first, left_nodes, index + 1, monitor);
    let mut build_right = || build(triangles, right, first + middle, right_nodes, right_index, monitor);
    let (on_left, on_right) =
        if middle > ALONE { rayon::join(build_left, build_right) } else { (build_left(), build_right()) };
    let ((left_box, left_labels), (right_box, right_labels)) = (on_left?, on_right?);
    let [min, max] = right_box.into_iter().fold(left_box, around);
    let labels = left_labels | right_labels;
    own[0] = Node { min, max, labels, link: right_index as u32, count: 0 };
    Ok(([min, max], labels))
}

/// The point of triangle (a, b, c) closest to `p`, by the Voronoi region of the feature that holds it.
pub(super) fn closest_point(&[a, b, c]: &[DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let area = va + vb + vc;
    // Also false for a degenerate triangle, which has no interior and whose regions above overlap.
    if va > 0.0 && vb > 0.0 && vc > 0.0 && area > 0.0 {
        return a + (ab * vb + ac * vc) / area;
    }
    let candidates = [closest_on_segment(a, b, p), closest_on_segment(b, c, p), closest_on_segment(c, a, p)];
    candidates.into_iter().min_by(|q, r| p.distance_squared(*q).total_cmp(&p.distance_squared(*r))).unwrap_or(a)
}

fn closest_on_segment(a: DVec3, b: DVec3, p: DVec3) -> DVec3 {
    let ab = b - a;
    let length_squared = ab.length_squared();
    if length_squared == 0.0 {
        return a;
    }
    a + ab * ((p - a).dot(ab) / length_squared).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-4..=4i32, -4..=4, -4..=4].prop_map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into()) * 0.5)
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        [point(), point(), point()]
    }

    /// Labels of which two have the same bit.
    fn labelled() -> impl Strategy<Value = Triangle> {
        let id = || prop::sample::select(vec![1, 2, 3, 65]);
        (triangle(), [id(), id()]).prop_map(|(corners, ids)| Triangle { corners, ids })
    }

    proptest! {
        /// The closest point is on the triangle and no point of a fine sampling is closer. Small integer coordinates meet every
        /// degenerate case: coinciding vertices, vertices on a line, query points on the triangle.
        #[test]
        fn closest_point_against_samples(t in triangle(), p in point()) {
            let q = closest_point(&t, p);
            prop_assert!(q.is_finite());
            let n = 60;
            let mut sampled = f64::INFINITY;
            for i in 0..=n {
                for j in 0..=n - i {
                    let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    sampled = sampled.min(p.distance(t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v));
                }
            }
            prop_assert!(p.distance(q) <= sampled + 1e-12);
            prop_assert!(p.distance(q) >= sampled - 0.25);
        }

        #[test]
        fn nearest_against_all(triangles in prop::collection::vec(labelled(), 1..60), p in point(), start in 0usize..60) {
            let of = |wanted: &dyn Fn(&Triangle) -> bool| {
                let distances = triangles.iter().filter(|t| wanted(t)).map(|t| p.distance_squared(closest_point(&t.corners, p)));
                distances.fold(f64::INFINITY, f64::min)
            };
            let (expected, of_label) = (of(&|_| true), [1, 65, 2].map(|id| of(&|t| t.ids.contains(&id))));
            let start = (start < triangles.len()).then_some(start);
            let tree = TriangleTree::new(triangles.clone(), &Monitor::silent()).unwrap();
            let found = tree.nearest(p, start).unwrap();
            prop_assert_eq!(found.distance_squared, expected);
            prop_assert_eq!(tree.distance_squared_to(found.slot, p), expected);
            for (id, expected) in [1, 65, 2].into_iter().zip(of_label) {
                let start = start.filter(|&slot| tree.touches(slot, id));
                let found = tree.nearest_of(id, p, start);
                prop_assert_eq!(found.map_or(f64::INFINITY, |found| found.distance_squared), expected);
                prop_assert!(found.is_none_or(|found| tree.touches(found.slot, id)));
            }
        }
    }

    #[test]
    fn boxes_are_counted_without_building() {
        fn slowly(triangles: usize) -> usize {
            let middle = triangles / 2;
            1 + if triangles > LEAF { slowly(middle) + slowly(triangles - middle) } else { 0 }
        }
        assert_eq!(boxes(0), 0);
        (1..3000).for_each(|n| assert_eq!(boxes(n), slowly(n), "{n}"));
    }

    #[test]
    fn one_hierarchy_on_any_number_of_threads() {
        let triangles: Vec<Triangle> = (0..3 * ALONE + 77)
            .map(|i| {
                let at = |n: usize| DVec3::new((i * n % 97) as f64, (i * n % 89) as f64, (i * n % 83) as f64);
                let corners = [at(3), at(3) + DVec3::X, at(3) + DVec3::Y + at(5) * 0.01];
                Triangle { corners, ids: [(i % 5) as u16, 7] }
            })
            .collect();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let tree = pool.install(|| TriangleTree::new(triangles.clone(), &Monitor::silent()).unwrap());
            (tree.triangles, tree.nodes.iter().map(|n| (n.min, n.max, n.labels, n.link, n.count)).collect::<Vec<_>>())
        };
        let tree = on(1);
        assert!(tree.1.iter().all(|&(min, max, ..)| min.cmplt(max).any()));
        assert!(tree == on(3));
    }

    #[test]
    fn no_triangles() {
        assert!(TriangleTree::new(Vec::new(), &Monitor::silent()).unwrap().nearest(DVec3::ZERO, None).is_none());
    }
}
