//! The validator: checks the invariants of the module exactly. Runs in tests after operations, and as a part of every certificate.
//!
//! Checking every facet against the vertex across it suffices: a triangulation of a convex box that is locally Delaunay at each facet is
//! Delaunay (Delaunay 1934).

use super::tet::{FACET, TetId, VertexKind};
use super::triangulation::Triangulation;
use crate::Result;
use crate::geometry::predicates::{in_sphere_perturbed, orient};
use crate::geometry::sphere::Circumsphere;

/// Tets between two questions whether to go on.
pub const CHECK_EVERY: u64 = 1 << 12;

/// What the validator counted. All but `tets` and `vertices` are 0 for a sound triangulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Check {
    /// Living tets.
    pub tets: u64,
    /// Vertices in some tet.
    pub vertices: u64,
    /// Tets that are not positive.
    pub inverted_tets: u64,
    /// Facets whose two sides disagree about being neighbours.
    pub broken_adjacency: u64,
    /// Facets with the vertex across inside the circumball (perturbed).
    pub non_delaunay_facets: u64,
    /// Vertices that name a tet they are not part of, and tets that name a removed vertex.
    pub broken_stars: u64,
}

impl Check {
    /// Whether every invariant holds.
    pub fn is_sound(&self) -> bool {
        self.inverted_tets + self.broken_adjacency + self.non_delaunay_facets + self.broken_stars == 0
    }
}

impl Triangulation {
    /// Checks the whole triangulation. Not to be used while others operate.
    pub fn check(&self) -> Check {
        self.check_while(|| Ok(())).unwrap_or_default()
    }

    /// As [`Self::check`]; asks `go_on` every [`CHECK_EVERY`] tets.
    ///
    /// # Errors
    /// Those of `go_on`.
    pub fn check_while(&self, go_on: impl Fn() -> Result<()>) -> Result<Check> {
        let mut check = Check::default();
        for t in self.living_tets() {
            if check.tets % CHECK_EVERY == 0 {
                go_on()?;
            }
            check.tets += 1;
            self.check_tet(t, &mut check);
        }
        for v in 0..self.vertex_bound() {
            if u64::from(v).is_multiple_of(CHECK_EVERY) {
                go_on()?;
            }
            if self.vertex(v).kind() == VertexKind::Removed {
                continue;
            }
            check.vertices += 1;
            let star = self.vertex(v).star();
            if !self.is_living(star) || !self.tet(star).vertices().contains(&v) {
                check.broken_stars += 1;
            }
        }
        Ok(check)
    }

    fn check_tet(&self, t: TetId, check: &mut Check) {
        let vertices = self.tet(t).vertices();
        let corners = self.corners(vertices);
        if vertices.iter().any(|&v| self.vertex(v).kind() == VertexKind::Removed) {
            check.broken_stars += 1;
        }
        if orient(corners[0], corners[1], corners[2], corners[3]) <= 0.0 {
            check.inverted_tets += 1;
        }
        let [a, b, c, d] = corners;
        let sphere = Circumsphere::of_tet(a, b, c, d);
        for i in 0..4 {
            let twin = self.tet(t).neighbor(i);
            if twin.is_none() {
                let [a, b, c] = FACET[i].map(|k| corners[k]);
                let on_box = (0..3)
                    .any(|x| a[x] == b[x] && b[x] == c[x] && (a[x] == self.lower()[x] || a[x] == self.upper()[x]));
                check.broken_adjacency += u64::from(!on_box);
                continue;
            }
            let other = self.tet(twin.tet()).vertices();
            let mut facet = FACET[i].map(|k| vertices[k]);
            let mut facet_across = FACET[twin.index()].map(|k| other[k]);
            facet.sort_unstable();
            facet_across.sort_unstable();
            let back = self.tet(twin.tet()).neighbor(twin.index());
            if self.is_cleared(twin.tet())
                || back.is_none()
                || back.tet() != t
                || back.index() != i
                || facet != facet_across
            {
                check.broken_adjacency += 1;
                continue;
            }
            // Each facet once.
            if t < twin.tet() {
                let across = self.position(other[twin.index()]);
                // The sphere made anew: what the tet keeps is not trusted here. Its bounds are proved, so an answer is the exact one.
                let inside = sphere.contains(across).unwrap_or_else(|| in_sphere_perturbed(corners, across));
                check.non_delaunay_facets += u64::from(inside);
            }
        }
    }
}
