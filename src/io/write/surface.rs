//! The vertices of the interfaces, numbered for files that hold nothing else.

use crate::Result;
use crate::memory::{filled, room};
use crate::mesh::{NONE, TetMesh};

/// The vertices of facets, in the order of the mesh. 4 bytes per vertex of the mesh and per vertex
/// here.
pub(super) struct SurfaceVertices {
    /// Indices in the mesh.
    pub used: Vec<u32>,
    /// The place in `used` of each vertex of the mesh, or [`NONE`].
    places: Vec<u32>,
}

impl SurfaceVertices {
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(mesh: &TetMesh) -> Result<Self> {
        let mut places = filled(mesh.points.len(), NONE, "places of vertices", || Ok(()))?;
        mesh.facets.iter().flatten().for_each(|&v| places[v as usize] = 0);
        let is_used = |&place: &u32| place != NONE;
        let mut used: Vec<u32> =
            room(places.iter().copied().filter(is_used).count(), "vertices of interfaces")?;
        used.extend((0..).zip(&places).filter(|&(_, place)| is_used(place)).map(|(v, _)| v));
        (0..).zip(&used).for_each(|(place, &v)| places[v as usize] = place);
        Ok(Self { used, places })
    }

    /// The facet's vertices as places.
    pub fn facet(&self, facet: &[u32; 3]) -> [u32; 3] {
        facet.map(|v| self.places[v as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inner_vertices_are_left_out() {
        let mesh = TetMesh {
            points: vec![[0.0; 3]; 7],
            facets: vec![[5, 1, 3], [3, 1, 6]],
            ..TetMesh::default()
        };
        let vertices = SurfaceVertices::new(&mesh).unwrap();
        assert_eq!(vertices.used, [1, 3, 5, 6]);
        assert_eq!(
            mesh.facets.iter().map(|facet| vertices.facet(facet)).collect::<Vec<_>>(),
            [[2, 0, 1], [1, 0, 3]]
        );
    }
}
