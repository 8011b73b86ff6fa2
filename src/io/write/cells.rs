//! The cells of VTK's files: all tets, in the order of the mesh, then all interface facets.
//!
//! | cell array | of a tet | of a facet |
//! |---|---|---|
//! | `label` | its label | the first of its two labels |
//! | `BoundaryLabels` | its label, twice | its two labels: the smaller first, the background last |
//! | `boundary` | 0 | the number of its boundary, from 1 |
//!
//! A field array for each region and each boundary has its name, and two numbers: of a region its
//! label and 3, of a boundary its number and 2, the dimensions. So do readers of Gmsh's files hand
//! out the names of physical groups.

use super::WriteOptions;
use super::regions::{Boundaries, Regions};
use crate::Result;
use crate::mesh::TetMesh;

/// VTK's types of tets and triangles, of order 1 and 2. Nodes on edges come in the mesh's own
/// order.
pub(super) const TETRA: [u8; 2] = [10, 24];
pub(super) const TRIANGLE: [u8; 2] = [5, 22];

/// The cells of a mesh.
pub(super) struct Cells<'m> {
    mesh: &'m TetMesh,
    regions: Regions,
    boundaries: Boundaries<'m>,
}

impl<'m> Cells<'m> {
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(mesh: &'m TetMesh, options: &WriteOptions<'_>) -> Result<Self> {
        let regions = Regions::new(mesh, options);
        let boundaries = Boundaries::new(mesh, options, &regions)?;
        Ok(Self { mesh, regions, boundaries })
    }

    /// How many cells there are.
    pub fn count(&self) -> usize {
        self.mesh.tets.len() + self.mesh.facets.len()
    }

    /// How many nodes all cells have together.
    pub fn node_count(&self) -> usize {
        let Self { mesh, .. } = self;
        mesh.nodes_per_tet() * mesh.tets.len() + mesh.nodes_per_facet() * mesh.facets.len()
    }

    /// Which facet a cell is, behind the tets.
    fn facet(&self, c: usize) -> Option<usize> {
        c.checked_sub(self.mesh.tets.len())
    }

    /// VTK's type of a cell.
    pub fn kind(&self, c: usize) -> u8 {
        let order = usize::from(self.mesh.mid_nodes.is_some());
        if self.facet(c).is_some() { TRIANGLE[order] } else { TETRA[order] }
    }

    /// The nodes of a cell.
    pub fn nodes(&self, c: usize) -> impl ExactSizeIterator<Item = u32> {
        let Self { mesh, .. } = self;
        let (nodes, count) = match self.facet(c) {
            None => (mesh.tet_nodes(c), mesh.nodes_per_tet()),
            Some(f) => {
                let [a, b, c, ab, bc, ca] = mesh.facet_nodes(f);
                ([a, b, c, ab, bc, ca, 0, 0, 0, 0], mesh.nodes_per_facet())
            }
        };
        nodes.into_iter().take(count)
    }

    /// Node `i` in the list of the nodes of all cells.
    pub fn node(&self, i: usize) -> u32 {
        let Self { mesh, .. } = self;
        let (of_tet, of_facet) = (mesh.nodes_per_tet(), mesh.nodes_per_facet());
        match i.checked_sub(of_tet * mesh.tets.len()) {
            None => mesh.tet_nodes(i / of_tet)[i % of_tet],
            Some(i) => mesh.facet_nodes(i / of_facet)[i % of_facet],
        }
    }

    /// Where the nodes of a cell end in that list.
    pub fn end(&self, c: usize) -> i64 {
        let Self { mesh, .. } = self;
        let tets = (c + 1).min(mesh.tets.len());
        (mesh.nodes_per_tet() * tets + mesh.nodes_per_facet() * (c + 1 - tets)) as i64
    }

    /// The label of a cell.
    pub fn label(&self, c: usize) -> i32 {
        self.labels(c)[0]
    }

    /// The labels on both sides of a cell.
    pub fn labels(&self, c: usize) -> [i32; 2] {
        self.facet(c).map_or_else(|| [self.mesh.labels[c]; 2], |f| self.mesh.facet_labels[f])
    }

    /// The number of the boundary that a cell belongs to, 0 for a tet.
    pub fn boundary(&self, c: usize) -> i32 {
        self.facet(c).map_or(0, |f| self.boundaries.number(f) as i32)
    }

    /// Names of regions and boundaries, each with its number and its dimension.
    pub fn names(&self) -> impl Iterator<Item = (&str, [i32; 2])> {
        let regions = self.regions.iter().map(|(label, name)| (name, [label, 3]));
        let boundaries = self.boundaries.names.iter().zip(1..);
        regions.chain(boundaries.map(|(name, number)| (&**name, [number, 2])))
    }
}
