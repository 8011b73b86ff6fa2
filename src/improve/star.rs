//! The tets around a vertex, and what the vertex belongs to.

use glam::DVec3;

use super::report::Counts;
use super::shared::Shared;
use crate::mesh::NONE;

/// Vertices of more tets stay where they are.
const MAX_TETS: usize = 160;

/// The three other vertices of a tet seen from vertex i, in an order that makes (i, x, y, z)
/// positive.
const SEEN_FROM: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [3, 0, 1], [2, 1, 0]];

/// An interface facet at the vertex v of a star: (v, p, q), where (p - v) x (q - v) points from the
/// side with the larger label to the other one.
#[derive(Clone, Copy, Debug)]
pub(super) struct StarFacet {
    pub others: [u32; 2],
    pub labels: [i32; 2],
}

/// The tets around a vertex. Kept from one to the next for its memory.
#[derive(Default)]
pub(super) struct Star {
    pub vertex: u32,
    pub tets: Vec<u32>,
    /// The other vertices of each tet; (vertex, x, y, z) is positive.
    pub links: Vec<[u32; 3]>,
    /// Where these are.
    pub points: Vec<[DVec3; 3]>,
    pub labels: Vec<i32>,
    pub facets: Vec<StarFacet>,
    /// The two other vertices that each tet but the first has in common with the one that led to
    /// it; of collected stars.
    common: Vec<[u32; 2]>,
}

/// What came of collecting a star.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Collected {
    /// All tets.
    Star,
    /// A tet that the block does not own.
    Foreign,
    /// The border of what was kept of the triangulation, or too many tets.
    Open,
}

impl Star {
    /// Counts what the labels gain when its vertex goes from one place to another. One inside of a
    /// label changes no volume.
    pub fn count_move(&self, from: DVec3, to: DVec3, counts: &mut Counts) {
        if self.facets.is_empty() {
            return;
        }
        for (&label, &[x, y, z]) in self.labels.iter().zip(&self.points) {
            counts.add_volume(label, (from - to).dot((y - x).cross(z - x)) / 6.0);
        }
    }

    /// Empties it, for vertex `v`.
    pub fn clear(&mut self, v: u32) {
        self.vertex = v;
        self.tets.clear();
        self.links.clear();
        self.points.clear();
        self.labels.clear();
        self.facets.clear();
        self.common.clear();
    }

    /// Collects the tets around vertex `v`, one of which is `t`; all must be owned.
    pub fn collect(
        &mut self,
        shared: &Shared<'_>,
        t: u32,
        v: u32,
        is_owned: impl Fn([u32; 4]) -> bool,
    ) -> Collected {
        self.clear(v);
        self.tets.push(t);
        let mut next = 0;
        while next < self.tets.len() {
            let at = self.tets[next];
            next += 1;
            let tet = shared.tet(at);
            if !is_owned(tet) {
                return Collected::Foreign;
            }
            let Some(own) = (0..4).find(|&i| tet[i] == v) else { return Collected::Open };
            let seen = SEEN_FROM[own];
            let label = shared.label(at);
            let link = seen.map(|i| tet[i]);
            self.links.push(link);
            self.labels.push(label);
            let [x, y, z] = link;
            for (i, outward) in seen.into_iter().zip([[z, y], [x, z], [y, x]]) {
                let beside = shared.neighbor(at, i);
                if beside == NONE {
                    return Collected::Open;
                }
                if !self.tets.contains(&beside) {
                    if self.tets.len() == MAX_TETS {
                        return Collected::Open;
                    }
                    self.tets.push(beside);
                    self.common.push(outward);
                    // Its turn comes some tets later.
                    shared.prefetch(beside);
                }
                let other = shared.label(beside);
                if other < label {
                    self.facets.push(StarFacet { others: outward, labels: [label, other] });
                }
            }
        }
        self.points.extend(self.links.iter().map(|link| link.map(|v| shared.point(v))));
        Collected::Star
    }

    /// The vertices beside that of the star, each once, with where they are; of a star that
    /// [`Self::collect`] found whole. Of each tet but the first only one can be new: that which it
    /// has not in common with the tet that led to it.
    pub fn vertices(&self) -> Vec<(u32, DVec3)> {
        debug_assert_eq!(self.links.len(), self.points.len());
        debug_assert_eq!(self.links.len(), self.common.len() + usize::from(!self.links.is_empty()));
        let Some(&first) = self.links.first() else { return Vec::new() };
        let mut vertices = Vec::with_capacity(24);
        vertices.extend(first.into_iter().zip(self.points[0]));
        let later = self.links.iter().zip(&self.points).skip(1).zip(&self.common);
        for ((link, points), common) in later {
            let new = link.iter().zip(points).find(|(v, _)| !common.contains(v));
            if let Some((&v, &p)) = new
                && vertices.iter().all(|&(known, _)| known != v)
            {
                vertices.push((v, p));
            }
        }
        vertices
    }

    /// The labels of the facets, if all have the same two.
    pub fn two_labels(&self) -> Option<[i32; 2]> {
        let first = self.facets.first()?.labels;
        let same = self.facets.iter().all(|facet| facet.labels == first);
        (same && self.labels.iter().all(|label| first.contains(label))).then_some(first)
    }

    /// The labels of the facets, if these are a surface around the vertex between the same two.
    pub fn surface(&self) -> Option<[i32; 2]> {
        self.two_labels().filter(|_| self.line_edges().1 == 0 && self.is_one_fan())
    }

    /// The ends of the edges at the vertex where not just two interface facets meet: edges of
    /// lines. At most three.
    pub fn line_edges(&self) -> ([u32; 3], usize) {
        let (mut ends, mut count) = ([NONE; 3], 0);
        for facet in &self.facets {
            for v in facet.others {
                let of_edge = self.facets.iter().filter(|facet| facet.others.contains(&v)).count();
                if of_edge != 2 && !ends[..count].contains(&v) && count < 3 {
                    ends[count] = v;
                    count += 1;
                }
            }
        }
        (ends, count)
    }

    /// Whether the interface facets form one fan around the vertex, so that the interface is a
    /// surface there. For stars of two labels.
    pub fn is_one_fan(&self) -> bool {
        let Some(first) = self.facets.first() else { return false };
        let (mut at, mut steps) = (first.others[1], 1);
        // The facets of one orientation follow on each other around the vertex.
        while at != first.others[0] {
            let mut next = self.facets.iter().filter(|facet| facet.others[0] == at);
            let (Some(facet), None) = (next.next(), next.next()) else { return false };
            at = facet.others[1];
            steps += 1;
            if steps > self.facets.len() {
                return false;
            }
        }
        steps == self.facets.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::bits::Bits;
    use crate::mesh::testing::kuhn_box;

    #[test]
    fn the_vertices_of_a_star_are_those_of_its_tets() {
        let mut mesh = kuhn_box([4, 3, 3], [1.0; 3], |i, j, k| ((i + j * k) % 3) as i32);
        let changed = Bits::new(mesh.tets.len(), "tets").unwrap();
        let tets = mesh.tets.clone();
        let shared = Shared::new(&mut mesh, &changed);
        let (mut star, mut stars) = (Star::default(), 0);
        for (t, &tet) in (0..).zip(&tets) {
            for v in tet {
                if star.collect(&shared, t, v, |_| true) != Collected::Star {
                    continue;
                }
                stars += 1;
                let with_v = || tets.iter().filter(|tet| tet.contains(&v));
                assert_eq!(star.tets.len(), with_v().count());
                let mut expected: Vec<u32> =
                    with_v().flatten().copied().filter(|&w| w != v).collect();
                expected.sort_unstable();
                expected.dedup();
                let mut found = star.vertices();
                assert!(found.iter().all(|&(w, p)| p == shared.point(w)));
                found.sort_unstable_by_key(|&(w, _)| w);
                assert!(found.into_iter().map(|(w, _)| w).eq(expected));
            }
        }
        assert!(stars > 0);
        star.clear(0);
        assert!(star.vertices().is_empty());
    }
}
