//! The tables of the certificate: a row for each label, a row for each larger component of the
//! image, and the list of defects.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{ComponentRow, Defect, DefectKind, LabelRow, MIN_COMPONENT_VOXELS, SmallLost};
use crate::Result;
use crate::image::LabelImage;
use crate::image::components::{ImageComponent, ImageComponents};
use crate::memory::{filled, room};
use crate::mesh::TetMesh;
use crate::verify::distance::{BothDistances, Distance, Sum};
use crate::verify::topology::boundary_surface::{BoundarySurfaces, NonManifold};
use crate::verify::topology::matching::{Fate, Matching, Role};
use crate::verify::topology::mesh_components::MeshComponents;

/// All that was measured on components.
pub(crate) struct Tables<'t> {
    pub mesh: &'t TetMesh,
    pub image: &'t LabelImage,
    pub matching: Matching,
    pub image_components: &'t ImageComponents,
    pub mesh_components: &'t MeshComponents,
    pub surfaces: &'t BoundarySurfaces,
    /// `None` where they were not measured.
    pub distances: Option<&'t BothDistances>,
}

/// A row, and the sums of distances from which it is completed.
#[derive(Default)]
struct Open<R> {
    row: R,
    mesh_to_image: Sum,
    image_to_mesh: Sum,
    mesh_to_surface: Sum,
    surface_to_mesh: Sum,
}

impl Tables<'_> {
    /// Every label of the image, lost ones included, and those that only the mesh has, in
    /// increasing order.
    pub fn labels(&self) -> Vec<LabelRow> {
        let mut rows: BTreeMap<i32, Open<LabelRow>> = BTreeMap::new();
        for (c, component) in self.image_components.list.iter().enumerate() {
            let open = rows.entry(self.label(component)).or_default();
            open.row.image_voxels += component.voxels;
            open.row.components_image += 1;
            open.row.euler_image += 2 * component.euler;
            let listed = |fate| {
                u64::from(
                    component.voxels >= MIN_COMPONENT_VOXELS && self.matching.fates[c] == fate,
                )
            };
            open.row.components_lost += listed(Fate::Lost);
            open.row.components_merged += listed(Fate::Merged);
            if let Some(BothDistances { faces, surface }) = self.distances {
                open.image_to_mesh += faces.of_image[c];
                open.surface_to_mesh += surface.of_image[c];
            }
        }
        for (c, component) in self.mesh_components.list.iter().enumerate() {
            let open = rows.entry(component.label).or_default();
            open.row.tets += component.tets.count;
            open.row.mesh_volume += component.tets.volume;
            open.row.components_mesh += 1;
            open.row.pieces += u64::from(self.matching.roles[c].0 != Role::Main);
            open.row.euler_mesh += self.surfaces.euler[c];
            if let Some(BothDistances { faces, surface }) = self.distances {
                open.mesh_to_image += faces.of_mesh[c];
                open.mesh_to_surface += surface.of_mesh[c];
            }
        }
        for place in &self.surfaces.non_manifold {
            let row = &mut rows.entry(place.label).or_default().row;
            *if place.is_edge() {
                &mut row.non_manifold_edges
            } else {
                &mut row.non_manifold_vertices
            } += 1;
        }
        let complete = |(label, open): (i32, Open<LabelRow>)| LabelRow {
            label,
            image_volume: open.row.image_voxels as f64 * self.image.voxel_volume(),
            mesh_to_image: self.measured(open.mesh_to_image),
            image_to_mesh: self.measured(open.image_to_mesh),
            mesh_to_surface: self.measured(open.mesh_to_surface),
            surface_to_mesh: self.measured(open.surface_to_mesh),
            ..open.row
        };
        rows.into_iter().map(complete).collect()
    }

    /// The components of the image that have at least [`MIN_COMPONENT_VOXELS`].
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn components(&self) -> Result<Vec<ComponentRow>> {
        const WHAT: &str = "components of the image";
        // The place of each in the table.
        let mut places = filled(self.image_components.list.len(), None, WHAT, || Ok(()))?;
        let is_listed = |component: &&ImageComponent| component.voxels >= MIN_COMPONENT_VOXELS;
        let mut rows: Vec<Open<ComponentRow>> =
            room(self.image_components.list.iter().filter(is_listed).count(), WHAT)?;
        for (c, component) in self.image_components.list.iter().enumerate() {
            if component.voxels < MIN_COMPONENT_VOXELS {
                continue;
            }
            places[c] = Some(rows.len());
            let row = ComponentRow {
                label: self.label(component),
                fate: self.matching.fates[c],
                position: self.position(component),
                image_voxels: component.voxels,
                image_volume: component.voxels as f64 * self.image.voxel_volume(),
                tets: self.matching.tets[c].count,
                mesh_volume: self.matching.tets[c].volume,
                euler_image: 2 * component.euler,
                image_to_mesh: self.distances.map(|both| both.faces.of_image[c].distance()),
                surface_to_mesh: self.distances.map(|both| both.surface.of_image[c].distance()),
                ..ComponentRow::default()
            };
            rows.push(Open { row, ..Open::default() });
        }
        for (c, &(_, lies_in)) in self.matching.roles.iter().enumerate() {
            if let Some(place) = lies_in.and_then(|image| places[image as usize]) {
                rows[place].row.components_mesh += 1;
                rows[place].row.euler_mesh += self.surfaces.euler[c];
                if let Some(BothDistances { faces, surface }) = self.distances {
                    rows[place].mesh_to_image += faces.of_mesh[c];
                    rows[place].mesh_to_surface += surface.of_mesh[c];
                }
            }
        }
        let complete = |open: Open<ComponentRow>| ComponentRow {
            mesh_to_image: self.measured(open.mesh_to_image),
            mesh_to_surface: self.measured(open.mesh_to_surface),
            ..open.row
        };
        Ok(rows.into_iter().map(complete).collect())
    }

    /// The components of fewer than [`MIN_COMPONENT_VOXELS`] that are lost.
    pub fn small_lost(&self) -> SmallLost {
        let components = self.image_components.list.iter().zip(&self.matching.fates);
        let lost = components.filter(|&(component, &fate)| {
            component.voxels < MIN_COMPONENT_VOXELS && fate == Fate::Lost
        });
        lost.fold(SmallLost::default(), |sum, (component, _)| SmallLost {
            count: sum.count + 1,
            voxels: sum.voxels + component.voxels,
            first: sum.first.or_else(|| Some((self.label(component), self.position(component)))),
        })
    }

    /// Where the topology is at fault, by kind.
    pub fn defects(&self) -> Vec<Defect> {
        let of_image = self.image_components.list.iter().zip(&self.matching.fates).filter_map(
            |(component, &fate)| {
                let kind = match fate {
                    Fate::Kept => return None,
                    Fate::Merged => DefectKind::Merged,
                    Fate::Lost => DefectKind::Lost,
                };
                let (label, position, size) =
                    (self.label(component), self.position(component), component.voxels);
                (size >= MIN_COMPONENT_VOXELS).then_some(Defect { kind, label, position, size })
            },
        );
        let of_mesh = self.mesh_components.list.iter().zip(&self.matching.roles).filter_map(
            |(component, &(role, _))| {
                let kind = match role {
                    Role::Main => return None,
                    Role::Piece => DefectKind::Torn,
                    Role::Stray => DefectKind::Stray,
                };
                let position = component.place(self.mesh).to_array();
                Some(Defect { kind, label: component.label, position, size: component.tets.count })
            },
        );
        let non_manifold = self.surfaces.non_manifold.iter().map(|place| Defect {
            kind: if place.is_edge() {
                DefectKind::NonManifoldEdge
            } else {
                DefectKind::NonManifoldVertex
            },
            label: place.label,
            position: self.middle(place).to_array(),
            size: 0,
        });
        let mut defects: Vec<Defect> = of_image.chain(of_mesh).chain(non_manifold).collect();
        // Stable: within a kind they keep their order.
        defects.sort_by_key(|defect| defect.kind);
        defects
    }

    /// The distance of a sum, if any was measured.
    fn measured(&self, sum: Sum) -> Option<Distance> {
        self.distances.map(|_| sum.distance())
    }

    fn label(&self, component: &ImageComponent) -> i32 {
        self.image.labels()[usize::from(component.id)]
    }

    fn position(&self, component: &ImageComponent) -> [f64; 3] {
        self.image.frame().to_world(DVec3::from(component.first.map(|i| i as f64))).to_array()
    }

    fn middle(&self, place: &NonManifold) -> DVec3 {
        let [v, w] = place.ends;
        self.mesh.point(v).midpoint(self.mesh.point(w))
    }
}
