//! The finished mesh: plain arrays, collected from the triangulation, or made elsewhere.

mod compact;
mod delaunay;
pub mod extract;
mod facets;
mod from_arrays;
pub mod part;
pub mod split;
pub(crate) mod vicinity;

#[cfg(test)]
pub(crate) mod testing;

use glam::DVec3;

use crate::image::Wall;

/// "No tet" in [`TetMesh::neighbors`] and [`TetMesh::facet_tets`].
pub const NONE: u32 = u32::MAX;

/// A finished tetrahedral mesh in world coordinates.
///
/// Sign convention: every tet (a, b, c, d) has (b - a) x (c - a) . (d - a) > 0, as in VTK. Facet i
/// of a tet is the one opposite to its vertex i. Interface facets are ordered so that their normal
/// (b - a) x (c - a) points from `facet_labels[f][0]` to `facet_labels[f][1]`. Of the two labels
/// the smaller one comes first, and the background, 0, last: facets on the outside point outwards.
/// This is the order of `BoundaryLabels` in VTK's surface filters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    /// Vertex positions; behind them those of the nodes in the middles of edges, if there are any.
    pub points: Vec<[f64; 3]>,
    /// Vertex indices of each tet.
    pub tets: Vec<[u32; 4]>,
    /// Label of each tet.
    pub labels: Vec<i32>,
    /// Neighbour across facet i of each tet, or [`NONE`].
    pub neighbors: Vec<[u32; 4]>,
    /// Vertex indices of each interface facet.
    pub facets: Vec<[u32; 3]>,
    /// The labels on the two sides of each interface facet.
    pub facet_labels: Vec<[i32; 2]>,
    /// The tets on the two sides of each interface facet; [`NONE`] where that side is background
    /// that was not kept.
    pub facet_tets: Vec<[u32; 2]>,
    /// The face of the image's box that each interface facet lies on, where the image cuts the
    /// object off. Empty where nobody has looked for them: no image is known.
    pub facet_walls: Vec<Wall>,
    /// The nodes in the middles of edges, of a mesh of second order.
    pub mid_nodes: Option<MidNodes>,
}

/// The nodes in the middles of the edges of tets of second order; see
/// [`second_order`](crate::second_order).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MidNodes {
    /// The number of vertices: these nodes are the points behind them.
    pub vertices: usize,
    /// The nodes of each tet (a, b, c, d), on its edges ab, bc, ca, ad, bd, cd.
    pub tets: Vec<[u32; 6]>,
    /// The nodes of each interface facet (a, b, c), on its edges ab, bc, ca.
    pub facets: Vec<[u32; 3]>,
}

impl TetMesh {
    /// The bytes of its arrays.
    pub fn bytes(&self) -> u64 {
        let of_nodes = self.mid_nodes.as_ref().map_or(0, |nodes| {
            size_of_val(nodes.tets.as_slice()) + size_of_val(nodes.facets.as_slice())
        });
        let of_tets = size_of_val(self.tets.as_slice())
            + size_of_val(self.labels.as_slice())
            + size_of_val(self.neighbors.as_slice());
        let of_facets = size_of_val(self.facets.as_slice())
            + size_of_val(self.facet_labels.as_slice())
            + size_of_val(self.facet_tets.as_slice())
            + size_of_val(self.facet_walls.as_slice());
        (size_of_val(self.points.as_slice()) + of_tets + of_facets + of_nodes) as u64
    }

    /// The number of vertices, corners of tets.
    pub fn vertex_count(&self) -> usize {
        self.mid_nodes.as_ref().map_or(self.points.len(), |nodes| nodes.vertices)
    }

    /// How many nodes a tet has: 4, or 10 in a mesh of second order.
    pub fn nodes_per_tet(&self) -> usize {
        if self.mid_nodes.is_some() { 10 } else { 4 }
    }

    /// How many nodes a facet has: 3, or 6 in a mesh of second order.
    pub fn nodes_per_facet(&self) -> usize {
        if self.mid_nodes.is_some() { 6 } else { 3 }
    }

    /// The nodes of a tet, vertices first.
    #[inline]
    pub fn nodes_of_tet(&self, t: u32) -> impl Iterator<Item = u32> + use<> {
        self.tet_nodes(t as usize).into_iter().take(self.nodes_per_tet())
    }

    /// The nodes of a facet, vertices first.
    #[inline]
    pub fn nodes_of_facet(&self, f: u32) -> impl Iterator<Item = u32> + use<> {
        self.facet_nodes(f as usize).into_iter().take(self.nodes_per_facet())
    }

    /// The nodes of a tet, vertices first; of the array as many count as [`Self::nodes_per_tet`].
    #[inline]
    pub fn tet_nodes(&self, t: usize) -> [u32; 10] {
        let of_edges = self.mid_nodes.as_ref().map_or([NONE; 6], |nodes| nodes.tets[t]);
        let ([a, b, c, d], [ab, bc, ca, ad, bd, cd]) = (self.tets[t], of_edges);
        [a, b, c, d, ab, bc, ca, ad, bd, cd]
    }

    /// The nodes of a facet, vertices first; of the array as many count as
    /// [`Self::nodes_per_facet`].
    #[inline]
    pub fn facet_nodes(&self, f: usize) -> [u32; 6] {
        let of_edges = self.mid_nodes.as_ref().map_or([NONE; 3], |nodes| nodes.facets[f]);
        let ([a, b, c], [ab, bc, ca]) = (self.facets[f], of_edges);
        [a, b, c, ab, bc, ca]
    }

    /// The face of the image's box that facet `f` lies on, as far as is known.
    #[inline]
    pub fn facet_wall(&self, f: usize) -> Wall {
        self.facet_walls.get(f).copied().unwrap_or_default()
    }

    /// Position of vertex `v`.
    #[inline]
    pub fn point(&self, v: u32) -> DVec3 {
        DVec3::from_array(self.points[v as usize])
    }
}
