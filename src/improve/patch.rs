//! A patch: some vertices that are moved at the same time, with all that is around them.

use glam::DVec3;

use super::climb::DIFFERENCE;
use super::minmax::{Gradient, NO_VERTEX};
use super::smoothing::{Place, Support};
use super::star::{Collected, Star};
use super::worker::Worker;

/// No more vertices are moved together; mostly there are some forty. So one attempt, which mostly
/// takes milliseconds, ends within tenths of a second, whatever the mesh.
const MAX_MOVERS: usize = 80;

/// A vertex that is moved.
pub(super) struct Mover {
    pub star: Star,
    pub place: Place,
}

/// Some vertices with all that is around them. Vertices are numbered within it, the movers first.
#[derive(Default)]
pub(super) struct Patch {
    pub movers: Vec<Mover>,
    vertices: Vec<u32>,
    /// Where they are.
    pub start: Vec<DVec3>,
    /// The tets of the object with a mover.
    pub tets: Vec<[usize; 4]>,
    /// Those of the background.
    pub background: Vec<[usize; 4]>,
    /// The slots of both.
    pub slots: Vec<u32>,
    /// The interface facets with a mover.
    pub facets: Vec<PatchFacet>,
}

/// An interface facet of a patch: its normal points from the first label to the second.
pub(super) struct PatchFacet {
    pub vertices: [usize; 3],
    pub labels: [i32; 2],
}

impl Worker<'_, '_> {
    /// The stars of the vertices of a tet; `None` where the block does not own them.
    pub fn stars_of(&self, t: u32) -> Option<Vec<Star>> {
        let mut stars = Vec::new();
        for v in self.round.shared.tet(t) {
            let mut star = Star::default();
            match star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) {
                Collected::Star => stars.push(star),
                Collected::Foreign => return None,
                Collected::Open => {}
            }
        }
        Some(stars)
    }

    /// The stars of the vertices of some stars, and whether the block owns all of them; it gets
    /// those that it owns.
    pub fn stars_around(&self, of_tet: &[Star]) -> (Vec<Star>, bool) {
        let mut around: Vec<(u32, u32)> = Vec::new();
        for star in of_tet {
            for (link, &t) in star.links.iter().zip(&star.tets) {
                for v in link.iter().copied().chain([star.vertex]) {
                    if !around.iter().any(|&(w, _)| w == v) {
                        around.push((v, t));
                    }
                }
            }
        }
        let (mut stars, mut are_all) = (Vec::new(), true);
        for (v, t) in around {
            let mut star = Star::default();
            match star.collect(&self.round.shared, t, v, |tet| self.owns(tet)) {
                Collected::Star if stars.len() < MAX_MOVERS => stars.push(star),
                Collected::Foreign => are_all = false,
                Collected::Star | Collected::Open => {}
            }
        }
        (stars, are_all)
    }

    /// What the vertices of some stars have around them.
    pub fn patch(&self, stars: Vec<Star>) -> Patch {
        let mut patch = Patch::default();
        for star in stars {
            let at = self.point(star.vertex);
            let place = self.place(&star, at);
            if place.support != Support::Fixed {
                patch.vertices.push(star.vertex);
                patch.start.push(at);
                patch.movers.push(Mover { star, place });
            }
        }
        for mover in 0..patch.movers.len() {
            let star = std::mem::take(&mut patch.movers[mover].star);
            for ((&t, &[x, y, z]), &label) in star.tets.iter().zip(&star.links).zip(&star.labels) {
                if !patch.slots.contains(&t) {
                    patch.slots.push(t);
                    let tet = [star.vertex, x, y, z].map(|v| self.number(&mut patch, v));
                    let tets = if label == 0 { &mut patch.background } else { &mut patch.tets };
                    tets.push(tet);
                }
            }
            for facet in &star.facets {
                let [p, q] = facet.others;
                let vertices = [star.vertex, p, q].map(|v| self.number(&mut patch, v));
                let is_same =
                    |known: &PatchFacet| vertices.iter().all(|v| known.vertices.contains(v));
                if !patch.facets.iter().any(is_same) {
                    patch.facets.push(PatchFacet { vertices, labels: facet.labels });
                }
            }
            patch.movers[mover].star = star;
        }
        patch
    }

    /// The number of a vertex in a patch, which gets one if it has none.
    fn number(&self, patch: &mut Patch, v: u32) -> usize {
        patch.vertices.iter().position(|&w| w == v).unwrap_or_else(|| {
            patch.vertices.push(v);
            patch.start.push(self.point(v));
            patch.vertices.len() - 1
        })
    }
}

impl Patch {
    /// The gradients of some functions of a tet's or a facet's `vertices`, which have these
    /// `values`, by the places of the movers; each in the directions in which it may go.
    pub fn gradients<const N: usize, const M: usize>(
        &self,
        at: &[DVec3],
        vertices: &[usize; N],
        values: [f64; M],
        of: impl Fn(&[DVec3; N]) -> [f64; M],
    ) -> [Gradient; M] {
        let there = vertices.map(|v| at[v]);
        let mut gradients = [[(NO_VERTEX, DVec3::ZERO); 4]; M];
        for (i, &v) in vertices.iter().enumerate() {
            let Some(mover) = self.movers.get(v) else { continue };
            let step = DIFFERENCE * there[(i + 1) % N].distance(there[i]);
            let beside = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
                let mut beside = there;
                beside[i] += axis * step;
                of(&beside)
            });
            for ((m, gradient), value) in gradients.iter_mut().enumerate().zip(values) {
                let free = DVec3::from(beside.map(|values| (values[m] - value) / step));
                gradient[i] = (v, mover.place.support.allowed(free));
            }
        }
        gradients
    }
}
