//! What a vertex belongs to, and the link condition: when an edge may be contracted so that
//! all that is connected stays.
//!
//! The interfaces of a mesh are a complex of facets. Its *lines* are the edges where not just two
//! facets meet, as where three labels do, and the rims of walls, where one of two lies on a wall
//! and the other does not, or on another one. Corners are where lines meet or end.
//!
//! | vertex u | may go into v, which stays |
//! |---|---|
//! | inside of a label | any vertex beside it |
//! | on an interface of two labels | along an edge of this interface |
//! | on a line | along an edge of this line |
//! | a corner, or where a boundary touches itself | none |
//!
//! The same holds where v moves on what it belongs to ([`meeting`](super::meeting)).
//!
//! The *link condition* for an edge uv of the interfaces is the same for u and v:
//! 1. A vertex that both are joined with by interface edges has an interface facet with both.
//! 2. No edge makes an interface facet with each of them.
//! 3. No vertex has an edge of a line to each of them.
//!
//! Then the interfaces and their lines are homeomorphic before and after (T. K. Dey, H.
//! Edelsbrunner, S. Guha, D. V. Nekhayev, "Topology preserving edge contraction", 1999, for
//! 2-complexes). A vertex inside of a label takes no part in them.

use super::star::{Star, StarFacet};
use crate::oracle::Walls;

/// Where a vertex may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Support {
    /// Anywhere.
    Inside,
    /// Along the interface.
    Interface,
    /// To one of the two ends of the line's edges there.
    Line([u32; 2]),
}

impl Support {
    /// That of the vertex of a star; `None`: it stays. `walls_at` tells which walls a vertex is on.
    pub fn of(star: &Star, walls_at: impl Fn(u32) -> Walls + Copy) -> Option<Self> {
        if star.facets.is_empty() {
            return Some(Self::Inside);
        }
        let (mut seen, mut ends) = (Vec::with_capacity(16), Vec::with_capacity(2));
        for w in star.facets.iter().flat_map(|facet| facet.others) {
            if !seen.contains(&w) {
                seen.push(w);
                if is_line(star, w, walls_at) {
                    ends.push(w);
                }
            }
        }
        match ends[..] {
            [] => (star.two_labels().is_some() && star.is_one_fan()).then_some(Self::Interface),
            [from, to] => is_book(&star.facets, [from, to]).then_some(Self::Line([from, to])),
            _ => None,
        }
    }

    /// Whether a vertex that belongs to this, whose star is given, may go into `v`.
    pub fn allows(self, star: &Star, v: u32) -> bool {
        match self {
            Self::Inside => true,
            Self::Interface => has_vertex(&star.facets, v),
            Self::Line(ends) => ends.contains(&v),
        }
    }

    /// Whether an edge of a line leads to a vertex.
    pub fn is_end(self, v: u32) -> bool {
        matches!(self, Self::Line(ends) if ends.contains(&v))
    }
}

/// Whether the link condition holds for the vertices of two stars, the first of which is to go into
/// the second.
pub(super) fn has_link_condition(
    star: &Star,
    other: &Star,
    support: Support,
    walls_at: impl Fn(u32) -> Walls + Copy,
) -> bool {
    let v = other.vertex;
    let beyond = || star.facets.iter().filter(|facet| !facet.others.contains(&v));
    let is_beside = |w: u32| {
        w == v || star.facets.iter().any(|facet| [v, w].iter().all(|x| facet.others.contains(x)))
    };
    let has_both = |facet: &StarFacet| {
        let both = |of: &StarFacet| facet.others.iter().all(|w| of.others.contains(w));
        other.facets.iter().any(both)
    };
    let joined = || beyond().flat_map(|facet| facet.others);
    let ends = match support {
        Support::Line(ends) => ends.to_vec(),
        Support::Inside | Support::Interface => Vec::new(),
    };
    joined().all(|w| is_beside(w) || !has_vertex(&other.facets, w))
        && !beyond().any(has_both)
        && ends.into_iter().all(|w| w == v || !is_line(other, w, walls_at))
}

/// Whether an edge from the vertex of a star is one of a line.
fn is_line(star: &Star, w: u32, walls_at: impl Fn(u32) -> Walls) -> bool {
    let mut facets = star.facets.iter().filter(|facet| facet.others.contains(&w));
    let walls_of = |facet: &StarFacet| {
        let [p, q] = facet.others.map(&walls_at);
        walls_at(star.vertex).common(&p).common(&q)
    };
    match (facets.next(), facets.next(), facets.next()) {
        (None, ..) => false,
        (Some(first), Some(second), None) => {
            let is_outer = first.labels.contains(&0) && second.labels.contains(&0);
            is_outer && walls_of(first) != walls_of(second)
        }
        _ => true,
    }
}

fn has_vertex(facets: &[StarFacet], w: u32) -> bool {
    facets.iter().any(|facet| facet.others.contains(&w))
}

/// Whether the facets around a vertex are pages between the two edges of a line, all of them.
fn is_book(facets: &[StarFacet], [from, to]: [u32; 2]) -> bool {
    let beyond = |n: usize, at: u32| {
        let [p, q] = facets[n].others;
        if p == at { q } else { p }
    };
    let with = |w: u32| (0..facets.len()).filter(move |&n| facets[n].others.contains(&w));
    let mut seen = 0;
    for first in with(from) {
        let (mut facet, mut at) = (first, beyond(first, from));
        seen += 1;
        while at != to {
            let mut next = with(at).filter(|&n| n != facet);
            let (Some(n), None) = (next.next(), next.next()) else { return false };
            (facet, at) = (n, beyond(n, at));
            seen += 1;
            if at == from || seen > facets.len() {
                return false;
            }
        }
    }
    seen == facets.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facets<const N: usize>(others: [[u32; 2]; N]) -> [StarFacet; N] {
        others.map(|others| StarFacet { others, labels: [2, 1] })
    }

    #[test]
    fn books() {
        // Three pages of one, two and three facets between 1 and 2.
        let pages = facets([[1, 2], [1, 3], [3, 2], [1, 4], [4, 5], [5, 2]]);
        assert!(is_book(&pages, [1, 2]) && is_book(&pages, [2, 1]));
        // A page that goes back, one that ends, one that is not joined to the line.
        assert!(!is_book(&facets([[1, 2], [1, 3], [3, 4], [4, 1]]), [1, 2]));
        assert!(!is_book(&facets([[1, 2], [1, 3]]), [1, 2]));
        assert!(!is_book(&facets([[1, 2], [3, 4], [4, 5], [5, 3]]), [1, 2]));
    }
}
