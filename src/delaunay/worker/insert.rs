//! Filling: Bowyer-Watson insertion. The cavity's tets give way to the star of the new vertex, one
//! tet per boundary facet.
//!
//! Cost: proportional to the cavity (about 18 tets out, 24 in), some 50 ns for each new tet, half
//! of that for digging; no walk when the caller knows a tet in conflict, as refinement does.

use glam::DVec3;

use super::Worker;
use super::cavity::{CavityFacet, Dig};
use crate::Result;
use crate::delaunay::locks::Locks;
use crate::delaunay::ownership::OwnerId;
use crate::delaunay::probe::{Effort, Probe};
use crate::delaunay::tet::{Facet, TetId, VertexId, VertexKind};
use crate::delaunay::triangulation::Triangulation;
use crate::geometry::star::StarSpheres;
use crate::memory::{filled, reserve};

/// What came of an insertion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Insertion {
    /// The vertex is in; its star is what [`Worker::created`] lists.
    Done(VertexId),
    /// Another worker owned a tet of the cavity, or one beside it; nothing changed.
    Blocked,
    /// Another worker changed what the caller relied on; nothing changed.
    Stale,
    /// The tet to start from is not in conflict with the point; nothing changed.
    NotInConflict,
    /// A vertex lies exactly there; nothing changed.
    Duplicate,
}

impl<L: Locks, P: Probe> Worker<L, P> {
    /// Inserts `p`, which must lie strictly inside the box, starting from `start`, a living tet
    /// whose circumball holds `p`.
    ///
    /// # Errors
    /// [`crate::Error::LimitReached`] when ids run out; nothing changed then.
    pub fn insert(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        kind: VertexKind,
    ) -> Result<Insertion> {
        self.insert_if(triangulation, start, p, kind, || true, |_, _| Ok(()))
    }

    /// As [`Self::insert`], with others at work. `holds` is asked, once `start` is owned and its
    /// neighbours cannot change either, whether what the caller found out about them is still true;
    /// `note` is told the vertex and its tets while nobody else can have come to them.
    ///
    /// # Errors
    /// As [`Self::insert`]. Those of `note`; the vertex is in then.
    pub fn insert_if(
        &mut self,
        triangulation: &Triangulation,
        start: TetId,
        p: DVec3,
        kind: VertexKind,
        holds: impl FnOnce() -> bool,
        note: impl FnOnce(VertexId, &[TetId]) -> Result<()>,
    ) -> Result<Insertion> {
        self.probe.spend(Effort::Operation);
        match self.dig(triangulation, start, p, holds) {
            Dig::Done => {}
            Dig::Blocked => {
                self.counters.rollbacks += 1;
                return Ok(Insertion::Blocked);
            }
            Dig::Stale => return Ok(Insertion::Stale),
            Dig::NotInConflict => return Ok(Insertion::NotInConflict),
            Dig::Duplicate => return Ok(Insertion::Duplicate),
        }
        let count = self.boundary.len();
        if let Err(error) =
            self.star.reserve(count).and_then(|()| self.reserve(triangulation, count))
        {
            self.roll_back(triangulation);
            return Err(error);
        }
        let v = self.fill_star(triangulation, p, kind);
        let noted = note(v, &self.created);
        self.end_operation(triangulation);
        noted.map(|()| Insertion::Done(v))
    }

    /// Puts `p` in, for whose star there is room, in place of the cavity.
    fn fill_star(&mut self, triangulation: &Triangulation, p: DVec3, kind: VertexKind) -> VertexId {
        let apex = self.take_vertex(triangulation, p, kind);
        // What is still needed of the dead tets stands in the boundary records, so that their slots
        // serve the new ones.
        self.counters.cavity_tets += self.cavity.len() as u64;
        self.exchange_slots(triangulation, self.boundary.len());
        triangulation.vertex(apex).set_star(self.created[0]);
        self.probe.visit_vertex(apex);
        self.created.iter().for_each(|&t| self.probe.visit_tet(t));
        let made_by = (self.mark, self.locks.owner_of_new());
        let (boundary, slots, probe) = (&self.boundary, &self.created, &mut self.probe);
        self.star.fill(triangulation, boundary, slots, (apex, p), made_by, probe);
        self.probe.spend(Effort::Fill(self.created.len()));
        self.counters.insertions += 1;
        apex
    }
}

/// Numbers of one byte, one of them to spare: most vertices of a cavity's boundary that are
/// numbered.
const MAX_LOCALS: usize = u8::MAX as usize;
const TABLE: usize = (MAX_LOCALS + 1) * (MAX_LOCALS + 1);

/// The vertices of a cavity's boundary of so many facets.
fn vertices_of(facets: usize) -> usize {
    facets / 2 + 2
}

/// Scratch of filling, empty until it is first needed.
///
/// The boundary of a cavity is a closed surface without handles: F facets have F / 2 + 2 vertices,
/// and every directed edge is in one of them, its opposite in the neighbour. Vertices are numbered
/// as they are met, and each new facet is noted in a table under its three directed edges; a second
/// pass finds its neighbours there. Number l of a vertex counts when it is below the number of
/// vertices met and `locals[l]` is the vertex. So neither numbers nor table are ever cleared: every
/// entry that is read was written in the same operation, if each vertex has one number.
///
/// A vertex's number stands in its record, on a line that is read and written anyway. Another
/// worker may operate beside the same vertex, and write a number of its own there. What counts is
/// right all the same; but the vertex gets a second number, and then there are more numbers than
/// the facets have vertices. So this is seen, and the facets are joined without numbers.
pub struct StarScratch {
    locals: [VertexId; MAX_LOCALS + 1],
    /// The new facet over directed edge (a, b) of the boundary, at a << shift | b.
    sides: Vec<Facet>,
    /// The numbers of each boundary facet's vertices.
    numbers: Vec<[u8; 3]>,
    /// The new facet over each edge, its smaller vertex in the upper half: where numbers will not
    /// do.
    edges: Vec<(u64, Facet)>,
    spheres: StarSpheres,
}

impl Default for StarScratch {
    fn default() -> Self {
        Self {
            locals: [0; MAX_LOCALS + 1],
            sides: Vec::new(),
            numbers: Vec::new(),
            edges: Vec::new(),
            spheres: StarSpheres::default(),
        }
    }
}

impl StarScratch {
    /// Makes sure that so many tets can be written without failing.
    fn reserve(&mut self, count: usize) -> Result<()> {
        if self.sides.is_empty() {
            self.sides = filled(TABLE, Facet::NONE, "edges of a cavity", || Ok(()))?;
        }
        self.numbers.clear();
        reserve(&mut self.numbers, count, "facets of a cavity")?;
        self.edges.clear();
        reserve(&mut self.edges, 3 * count, "edges of a cavity")?;
        self.spheres.reserve(count)
    }

    /// Writes the tets between the boundary's facets and vertex `apex` at `p` into `slots`, one for
    /// each facet: (facet, apex). There is [room](Self::reserve) for them. They get a
    /// mark and an owner. `probe` is told of the boundary's vertices, of each once unless it gets
    /// more than one number.
    #[inline(never)]
    fn fill(
        &mut self,
        triangulation: &Triangulation,
        boundary: &[CavityFacet],
        slots: &[TetId],
        (apex, p): (VertexId, DVec3),
        (mark, owner): (u8, OwnerId),
        probe: &mut impl Probe,
    ) {
        let vertices = vertices_of(boundary.len());
        let numbered = vertices <= MAX_LOCALS;
        let shift = vertices.next_power_of_two().trailing_zeros();
        // Of one length that the table has, so that no index needs a test.
        let sides: &mut [Facet; TABLE] =
            self.sides.as_mut_slice().try_into().expect("made of that length");
        let at = |a: u8, b: u8| (usize::from(a) << shift | usize::from(b)) % TABLE;
        // Numbers given; and the last one's, which may run out.
        let (mut given, mut met) = (0, 0_u8);
        for (i, (facet, &t)) in boundary.iter().zip(slots).enumerate() {
            let [a, b, c] = [0, 1, 2].map(|k: usize| {
                let v = facet.vertices[k];
                let record = triangulation.vertex(v);
                self.spheres.set(i, k, record.position());
                record.set_star(t);
                // Stores that may change nothing instead of branches that cannot be predicted.
                let local = record.local();
                let known = (local < met) & (self.locals[usize::from(local)] == v);
                if !known {
                    probe.visit_vertex(v);
                }
                let local = if known { local } else { met };
                met = met.wrapping_add(u8::from(!known));
                given += usize::from(!known);
                self.locals[usize::from(local)] = v;
                record.set_local(local);
                local
            });
            self.numbers.push([a, b, c]);
            // The facet opposite to a vertex lies over the edge of the other two.
            sides[at(b, c)] = Facet::new(t, 0);
            sides[at(c, a)] = Facet::new(t, 1);
            sides[at(a, b)] = Facet::new(t, 2);
        }
        debug_assert!(!numbered || given >= vertices);
        self.spheres.compute(boundary.len(), p);
        for (i, ((facet, &t), &[a, b, c])) in
            boundary.iter().zip(slots).zip(&self.numbers).enumerate()
        {
            let record = triangulation.tet(t);
            let [v0, v1, v2] = facet.vertices;
            record.fill([v0, v1, v2, apex], &self.spheres.get(i), mark, owner);
            record.set_neighbor(0, sides[at(c, b)]);
            record.set_neighbor(1, sides[at(a, c)]);
            record.set_neighbor(2, sides[at(b, a)]);
            record.set_neighbor(3, facet.outside);
            if !facet.outside.is_none() {
                triangulation
                    .tet(facet.outside.tet())
                    .set_neighbor(facet.outside.index(), Facet::new(t, 3));
            }
        }
        if given != vertices || !numbered {
            // A vertex has two numbers, or numbers ran out and were given twice: what the table
            // said is wrong.
            self.join_by_sorting(triangulation, boundary, slots);
        }
    }

    /// Makes the new tets neighbours over the boundary's edges, each of which two of them share.
    #[cold]
    fn join_by_sorting(
        &mut self,
        triangulation: &Triangulation,
        boundary: &[CavityFacet],
        slots: &[TetId],
    ) {
        for (facet, &t) in boundary.iter().zip(slots) {
            for index in 0..3 {
                let (a, b) = (facet.vertices[(index + 1) % 3], facet.vertices[(index + 2) % 3]);
                self.edges
                    .push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), Facet::new(t, index)));
            }
        }
        self.edges.sort_unstable_by_key(|&(edge, _)| edge);
        for pair in self.edges.chunks_exact(2) {
            let [(edge, one), (same, other)] = [pair[0], pair[1]];
            debug_assert_eq!(edge, same);
            triangulation.tet(one.tet()).set_neighbor(one.index(), other);
            triangulation.tet(other.tet()).set_neighbor(other.index(), one);
        }
    }
}
