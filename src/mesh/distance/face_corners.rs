//! The corners of the voxel faces of one brick, each with a triangle that is thought to be near: an upper bound of its distance from the mesh.
//!
//! Up to twelve faces meet in a corner, each of which knows a triangle; mostly one of these is near enough to show that the corner is not the farthest one, so that no nearest triangle
//! need be searched for. Labels are held apart: the bounds of a component come from triangles of its label alone.

use glam::DVec3;

use super::super::triangle_bins::Nearest;
use super::super::voxel_faces::{BRICK, Face, VoxelFaces};

/// Corners along each axis of a brick.
const SIDE: usize = BRICK + 1;

/// The bounds that a corner can have: over the whole, and for the components of the eight voxels around it.
const BOUNDS: usize = 9;

/// Stands for the whole among the numbers of components.
const WHOLE: u32 = u32::MAX;

/// The bounds of one corner.
#[derive(Clone)]
struct Corner {
    /// How many bounds it has.
    len: u8,
    components: [u32; BOUNDS],
    bounds: [Nearest; BOUNDS],
}

/// The corners of the faces of one brick that were shown any triangles.
pub(super) struct FaceCorners {
    corners: Vec<Corner>,
    /// Those with bounds, each with where it is.
    met: Vec<(u16, DVec3)>,
}

impl FaceCorners {
    /// None has any bounds.
    pub fn new() -> Self {
        let unknown = Nearest { triangle: 0, distance_squared: f64::INFINITY };
        let corner = Corner { len: 0, components: [WHOLE; BOUNDS], bounds: [unknown; BOUNDS] };
        Self { corners: vec![corner; SIDE.pow(3)], met: Vec::new() }
    }

    /// Tells the corners of a face of a triangle, for the whole or for a component that has the face on one side; `bound` gives an upper bound of a corner's squared distance from the triangle.
    #[inline]
    pub fn meet(
        &mut self,
        face: Face,
        component: Option<u32>,
        triangle: u32,
        faces: &VoxelFaces<'_>,
        bound: impl Fn(DVec3) -> f64,
    ) {
        let component = component.unwrap_or(WHOLE);
        let [i, j, k] = face.cell.map(|cell| cell % BRICK);
        let steps = [1, SIDE, SIDE * SIDE];
        let (u, v) = (steps[(face.axis + 1) % 3], steps[(face.axis + 2) % 3]);
        let first = i + SIDE * (j + SIDE * k);
        for (at, position) in [first, first + u, first + v, first + u + v].into_iter().zip(faces.corners(face)) {
            let corner = &mut self.corners[at];
            let len = usize::from(corner.len);
            let slot = corner.components[..len].iter().position(|&known| known == component).unwrap_or(len);
            if slot == len {
                if len == 0 {
                    self.met.push((at as u16, position));
                }
                corner.len += 1;
                corner.components[slot] = component;
                corner.bounds[slot].distance_squared = f64::INFINITY;
            }
            let distance_squared = bound(position);
            if distance_squared < corner.bounds[slot].distance_squared {
                corner.bounds[slot] = Nearest { triangle, distance_squared };
            }
        }
    }

    /// Hands out every bound, with where its corner is and whose it is, and forgets it.
    pub fn drain(&mut self, mut each: impl FnMut(DVec3, Option<u32>, Nearest)) {
        for (at, position) in self.met.drain(..) {
            let corner = &mut self.corners[usize::from(at)];
            for (&component, &bound) in corner.components.iter().zip(&corner.bounds).take(corner.len.into()) {
                each(position, (component != WHOLE).then_some(component), bound);
            }
            corner.len = 0;
        }
    }
}
