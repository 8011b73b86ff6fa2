//! The end of coarsening: gaps between tets are closed, and vertices that no tet has any more go.

use rayon::prelude::*;

use super::{NONE, TetMesh};
use crate::Result;
use crate::memory::{reserve, zeroed};
use crate::monitor::Monitor;

impl TetMesh {
    /// Drops empty slots of tets, and vertices that no tet has. Tets keep their order; so do
    /// vertices, but those of tets with a label come first; `places` has another place of each, and
    /// goes along. Returns how many vertices of tets with a label there are. For a mesh without
    /// facets.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory) and [`Cancelled`](crate::Error::Cancelled), with
    /// the mesh unchanged.
    pub(crate) fn compact(
        &mut self,
        places: &mut Vec<[f64; 3]>,
        monitor: &Monitor<'_>,
    ) -> Result<usize> {
        debug_assert_eq!(places.len(), self.points.len());
        let (of_object, of_background) = (2_u8, 1_u8);
        let mut uses = zeroed(self.points.len(), "vertices of the mesh")?;
        for (tet, &label) in self.tets.iter().zip(&self.labels).filter(|(tet, _)| tet[0] != NONE) {
            let of_tet = if label == 0 { of_background } else { of_object };
            tet.iter().for_each(|&v| {
                let uses: &mut u8 = &mut uses[v as usize];
                *uses = of_tet.max(*uses);
            });
        }
        monitor.check_cancelled()?;
        let count = |of: u8| uses.par_iter().filter(|&&uses| uses == of).count();
        let points_kept = count(of_object);
        let mut points = Vec::new();
        reserve(&mut points, points_kept + count(of_background), "vertices of the mesh")?;
        let mut numbers: Vec<u32> = zeroed(self.points.len(), "vertices of the mesh")?;
        let mut slots: Vec<u32> = zeroed(self.tets.len(), "tets of the mesh")?;
        let mut places_left = Vec::new();
        reserve(&mut places_left, points.capacity(), "vertices of the mesh")?;
        for of in [of_object, of_background] {
            let both = self.points.iter().zip(&*places).enumerate();
            for (v, (&point, &place)) in both.filter(|(v, _)| uses[*v] == of) {
                numbers[v] = points.len() as u32;
                points.push(point);
                places_left.push(place);
            }
        }
        monitor.check_cancelled()?;
        self.points = points;
        *places = places_left;
        let mut live = 0;
        for (slot, tet) in slots.iter_mut().zip(&self.tets) {
            *slot = if tet[0] == NONE { NONE } else { live };
            live += u32::from(tet[0] != NONE);
        }
        for (t, &slot) in slots.iter().enumerate().filter(|(_, slot)| **slot != NONE) {
            let slot = slot as usize;
            // Never behind `t`, so what is overwritten has been moved.
            self.tets[slot] = self.tets[t].map(|v| numbers[v as usize]);
            self.labels[slot] = self.labels[t];
            let moved = |n: u32| if n == NONE { NONE } else { slots[n as usize] };
            self.neighbors[slot] = self.neighbors[t].map(moved);
        }
        self.tets.truncate(live as usize);
        self.labels.truncate(live as usize);
        self.neighbors.truncate(live as usize);
        Ok(points_kept)
    }
}
