//! A mesh from arrays that another program made: checked, its tets connected, its interface facets
//! listed.
//!
//! Two tets are neighbours where they have a facet in common. Facets are put together by their
//! smallest vertex, of which a tet mesh has some dozen each, so all of this is linear. One thread.

use super::{NONE, TetMesh};
use crate::delaunay::tet::{FACET, Facet, MAX_TETS};
use crate::geometry::predicates::orient;
use crate::memory::{collected, reserve, room, zeroed};
use crate::monitor::Monitor;
use crate::{Error, Result};

/// Tets, or vertices, between two looks at the cancel flag.
const CHUNK: usize = 1 << 12;

/// What is connected, as errors name it.
const WHAT: &str = "facets of the mesh";

impl TetMesh {
    /// A mesh of these points, tets and labels of tets; tets of label 0 are background.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for a coordinate that is not finite, a vertex that is not there,
    /// a tet that has a vertex twice, a facet of more than two tets, two positive tets on the same
    /// side of a facet, and a number of labels that is not that of the tets;
    /// [`Error::LimitReached`] for more tets than can be numbered; [`Error::Cancelled`];
    /// [`Error::OutOfMemory`].
    pub fn from_arrays(
        points: &[[f64; 3]],
        tets: &[[u32; 4]],
        labels: &[i32],
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        check_counts(points.len(), tets.len(), labels.len())?;
        for (piece, points) in points.chunks(CHUNK).enumerate() {
            monitor.advance(0)?;
            if let Some(v) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
                return Err(Error::InvalidArgument(format!(
                    "vertex {} is at {:?}; coordinates must be finite",
                    piece * CHUNK + v,
                    points[v]
                )));
            }
        }
        for (piece, tets) in tets.chunks(CHUNK).enumerate() {
            monitor.advance(0)?;
            for (t, tet) in (piece * CHUNK..).zip(tets) {
                check_vertices(t, tet, points.len())?;
            }
        }
        let mut mesh = Self {
            points: collected(points.iter().copied(), "vertices of the mesh")?,
            tets: collected(tets.iter().copied(), "tets of the mesh")?,
            labels: collected(labels.iter().copied(), "tets of the mesh")?,
            neighbors: zeroed(tets.len(), "tets of the mesh")?,
            ..Self::default()
        };
        mesh.connect(monitor)?;
        mesh.collect_facets(monitor)?;
        Ok(mesh)
    }

    /// Finds the neighbours of all tets.
    fn connect(&mut self, monitor: &Monitor<'_>) -> Result<()> {
        let sides = Sides::new(&self.tets, self.points.len(), monitor)?;
        self.neighbors.fill([NONE; 4]);
        let mut around: Vec<Side> = Vec::new();
        for smallest in 0..self.points.len() {
            if smallest.is_multiple_of(CHUNK) {
                monitor.advance(0)?;
            }
            let listed = sides.of(smallest);
            around.clear();
            reserve(&mut around, listed.len(), WHAT)?;
            around.extend_from_slice(listed);
            around.sort_unstable();
            for same in around.chunk_by(|a, b| a.others == b.others) {
                match *same {
                    [_] => {}
                    [one, other] => self.join(one.facet(), other.facet())?,
                    _ => {
                        let [b, c] = same[0].others;
                        let tets: Vec<String> =
                            same.iter().map(|side| side.facet().tet().to_string()).collect();
                        return Err(Error::InvalidArgument(format!(
                            "facet ({smallest}, {b}, {c}) is one of {} tets: {}; at most two can \
                             have it",
                            tets.len(),
                            tets.join(", ")
                        )));
                    }
                }
            }
        }
        Ok(())
    }

    /// Makes the tets of two facets with the same vertices neighbours.
    fn join(&mut self, one: Facet, other: Facet) -> Result<()> {
        if is_even(self.corners(one)) == is_even(self.corners(other))
            && self.is_positive(one.tet())
            && self.is_positive(other.tet())
        {
            let (s, t) = (one.tet(), other.tet());
            let [a, b, c] = self.corners(one);
            return Err(Error::InvalidArgument(format!(
                "tets {s} and {t} overlap: both lie on the same side of facet ({a}, {b}, {c})"
            )));
        }
        self.neighbors[one.tet() as usize][one.index()] = other.tet();
        self.neighbors[other.tet() as usize][other.index()] = one.tet();
        Ok(())
    }

    /// The vertices of a facet, in the order in which its normal points into a positive tet.
    fn corners(&self, facet: Facet) -> [u32; 3] {
        FACET[facet.index()].map(|i| self.tets[facet.tet() as usize][i])
    }

    fn is_positive(&self, t: u32) -> bool {
        let [a, b, c, d] = self.tets[t as usize].map(|v| self.point(v));
        orient(a, b, c, d) > 0.0
    }
}

fn check_counts(points: usize, tets: usize, labels: usize) -> Result<()> {
    if tets != labels {
        return Err(Error::InvalidArgument(format!("{labels} labels are given for {tets} tets")));
    }
    if tets > MAX_TETS || points > NONE as usize {
        return Err(Error::LimitReached(format!(
            "a mesh can have {MAX_TETS} tets and {NONE} vertices, got {tets} and {points}"
        )));
    }
    Ok(())
}

fn check_vertices(t: usize, tet: &[u32; 4], points: usize) -> Result<()> {
    let fault = if let Some(v) = tet.iter().find(|&&v| v as usize >= points) {
        format!("tet {t} has vertex {v}, but there are {points} vertices")
    } else if (1..4).any(|i| tet[..i].contains(&tet[i])) {
        format!("tet {t} has a vertex twice: {tet:?}")
    } else {
        return Ok(());
    };
    Err(Error::InvalidArgument(fault))
}

/// Whether it takes an even number of swaps to sort three different numbers.
fn is_even([a, b, c]: [u32; 3]) -> bool {
    // The number of pairs that are the wrong way round.
    ([a > b, b > c, a > c].map(u32::from).iter().sum::<u32>()).is_multiple_of(2)
}

/// A facet of a tet: its two larger vertices, and which one it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    others: [u32; 2],
    /// The tet, and the number of the facet.
    tet: u32,
    index: u32,
}

impl Side {
    fn facet(self) -> Facet {
        Facet::new(self.tet, self.index as usize)
    }
}

/// The facets of all tets, by their smallest vertices.
struct Sides {
    sides: Vec<Side>,
    /// Where those of each vertex begin, and the end.
    starts: Vec<usize>,
}

impl Sides {
    fn new(tets: &[[u32; 4]], points: usize, monitor: &Monitor<'_>) -> Result<Self> {
        // By turns the count, the place for the next one, and where those of the next vertex begin.
        let mut starts: Vec<usize> = zeroed(points + 1, WHAT)?;
        for tets in tets.chunks(CHUNK) {
            monitor.advance(0)?;
            sides(0, tets).for_each(|(smallest, _)| starts[smallest as usize + 1] += 1);
        }
        let mut sum = 0;
        for start in &mut starts[1..] {
            sum += std::mem::replace(start, sum);
        }
        let mut all = room(sum, WHAT)?;
        all.resize(sum, Side { others: [0; 2], tet: 0, index: 0 });
        for (piece, tets) in tets.chunks(CHUNK).enumerate() {
            monitor.advance(0)?;
            for (smallest, side) in sides(piece * CHUNK, tets) {
                let next = &mut starts[smallest as usize + 1];
                all[*next] = side;
                *next += 1;
            }
        }
        Ok(Self { sides: all, starts })
    }

    fn of(&self, smallest: usize) -> &[Side] {
        &self.sides[self.starts[smallest]..self.starts[smallest + 1]]
    }
}

/// The facets of tets, the first of which is number `first`, each after its smallest vertex.
fn sides(first: usize, tets: &[[u32; 4]]) -> impl Iterator<Item = (u32, Side)> {
    (first as u32..).zip(tets).flat_map(|(tet, vertices)| {
        (0..4).map(move |index| {
            let mut corners = FACET[index as usize].map(|i| vertices[i]);
            corners.sort_unstable();
            let [smallest, b, c] = corners;
            (smallest, Side { others: [b, c], tet, index })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::testing::kuhn_box;

    fn again(mesh: &TetMesh) -> Result<TetMesh> {
        TetMesh::from_arrays(&mesh.points, &mesh.tets, &mesh.labels, &Monitor::silent())
    }

    fn message(mesh: &TetMesh) -> String {
        again(mesh).unwrap_err().to_string()
    }

    #[test]
    fn a_mesh_is_found_again_in_its_arrays() {
        let mesh = kuhn_box([9, 11, 10], [1.0, 0.5, 2.0], |i, j, k| ((i / 2 + j * k) % 4) as i32);
        assert!(mesh.tets.len() > CHUNK);
        let mut found = again(&mesh).unwrap();
        assert_eq!(found.neighbors, mesh.neighbors);
        let facets = |mesh: &TetMesh| {
            let rows = mesh.facets.iter().zip(&mesh.facet_labels).zip(&mesh.facet_tets);
            // The same orientation, whichever vertex comes first.
            let turned =
                |f: &[u32; 3]| (0..3).map(|i| [f[i], f[(i + 1) % 3], f[(i + 2) % 3]]).min();
            let mut rows: Vec<_> = rows.map(|((f, l), t)| (turned(f), *l, *t)).collect();
            rows.sort_unstable();
            rows
        };
        assert_eq!(facets(&found), facets(&mesh));
        // A tet that is turned inside out is kept; the certificate counts it.
        found.tets[7].swap(0, 1);
        assert_eq!(again(&found).unwrap().tets, found.tets);
    }

    #[test]
    fn faults_are_named() {
        let mesh = kuhn_box([2; 3], [1.0; 3], |_, _, _| 1);
        type Change = fn(&mut TetMesh);
        let with = |change: Change| {
            let mut mesh = mesh.clone();
            change(&mut mesh);
            message(&mesh)
        };
        let cases: [(Change, &str); 6] = [
            (|m| m.points[5][1] = f64::NAN, "vertex 5 is at [2.0, NaN, 0.0]"),
            (|m| m.tets[3][2] = 27, "tet 3 has vertex 27, but there are 27 vertices"),
            (|m| m.tets[4] = [1, 2, 1, 3], "tet 4 has a vertex twice: [1, 2, 1, 3]"),
            (|m| _ = m.labels.pop(), "47 labels are given for 48 tets"),
            (|m| m.tets.push(m.tets[1]), "48 labels are given for 49 tets"),
            (
                |m| {
                    m.points.push([2.0, 0.3, 0.1]);
                    m.tets.push([0, 1, 4, 27]);
                    m.labels.push(1);
                },
                "tets 0 and 48 overlap: both lie on the same side of facet",
            ),
        ];
        for (change, expected) in cases {
            let found = with(change);
            assert!(found.contains(expected), "{found}");
        }
        let thrice = with(|m| {
            m.tets.extend([m.tets[1]; 2]);
            m.labels.extend([1; 2]);
        });
        assert!(thrice.contains("at most two can have it"), "{thrice}");
    }

    #[test]
    fn nothing_makes_an_empty_mesh() {
        assert_eq!(again(&TetMesh::default()).unwrap(), TetMesh::default());
    }

    #[test]
    fn parity() {
        assert!([[0, 1, 2], [1, 2, 0], [2, 0, 1]].into_iter().all(is_even));
        assert!(![[0, 2, 1], [1, 0, 2], [2, 1, 0]].into_iter().any(is_even));
    }
}
