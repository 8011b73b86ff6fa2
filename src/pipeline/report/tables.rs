//! The tables of a report: labels, components, defects.

use serde::Serialize;

use crate::verify::distance::Distance;
use crate::verify::{ComponentRow, Defect, DefectKind, Fate, LabelRow};

/// A distance, or that there is none.
struct Parts {
    max: Option<f64>,
    mean: Option<f64>,
}

impl From<Option<Distance>> for Parts {
    fn from(distance: Option<Distance>) -> Self {
        Self {
            max: distance.map(|distance| distance.max),
            mean: distance.map(|distance| distance.mean),
        }
    }
}

/// Largest and mean distances, to the faces of the image's voxels and to the smooth interfaces.
#[derive(Serialize)]
pub(super) struct Distances {
    hausdorff_mesh_to_image: Option<f64>,
    hausdorff_image_to_mesh: Option<f64>,
    mean_mesh_to_image: Option<f64>,
    mean_image_to_mesh: Option<f64>,
    hausdorff_mesh_to_surface: Option<f64>,
    hausdorff_surface_to_mesh: Option<f64>,
    mean_mesh_to_surface: Option<f64>,
    mean_surface_to_mesh: Option<f64>,
}

impl Distances {
    /// From mesh to image and back, from mesh to smooth interfaces and back; `None`, in a file
    /// `null`, where they were not measured.
    pub(super) fn new(distances: [Option<Distance>; 4]) -> Self {
        let [to_image, from_image, to_surface, from_surface] = distances.map(Parts::from);
        Self {
            hausdorff_mesh_to_image: to_image.max,
            hausdorff_image_to_mesh: from_image.max,
            mean_mesh_to_image: to_image.mean,
            mean_image_to_mesh: from_image.mean,
            hausdorff_mesh_to_surface: to_surface.max,
            hausdorff_surface_to_mesh: from_surface.max,
            mean_mesh_to_surface: to_surface.mean,
            mean_surface_to_mesh: from_surface.mean,
        }
    }
}

#[derive(Serialize)]
pub(super) struct Label<'a> {
    label: i32,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<&'a str>,
    tets: u64,
    mesh_volume: f64,
    image_volume: f64,
    image_voxels: u64,
    components_image: u64,
    components_mesh: u64,
    components_lost: u64,
    components_merged: u64,
    pieces: u64,
    euler_image: i64,
    euler_mesh: i64,
    non_manifold_edges: u64,
    non_manifold_vertices: u64,
    #[serde(flatten)]
    distances: Distances,
    volume_change: f64,
}

impl<'a> Label<'a> {
    pub(super) fn new(row: &LabelRow, name: Option<&'a str>, volume_change: f64) -> Self {
        Self {
            label: row.label,
            name,
            tets: row.tets,
            mesh_volume: row.mesh_volume,
            image_volume: row.image_volume,
            image_voxels: row.image_voxels,
            components_image: row.components_image,
            components_mesh: row.components_mesh,
            components_lost: row.components_lost,
            components_merged: row.components_merged,
            pieces: row.pieces,
            euler_image: row.euler_image,
            euler_mesh: row.euler_mesh,
            non_manifold_edges: row.non_manifold_edges,
            non_manifold_vertices: row.non_manifold_vertices,
            distances: Distances::new([
                row.mesh_to_image,
                row.image_to_mesh,
                row.mesh_to_surface,
                row.surface_to_mesh,
            ]),
            volume_change,
        }
    }
}

#[derive(Serialize)]
pub(super) struct Component {
    label: i32,
    fate: &'static str,
    position: [f64; 3],
    image_voxels: u64,
    image_volume: f64,
    tets: u64,
    mesh_volume: f64,
    components_mesh: u64,
    euler_image: i64,
    euler_mesh: i64,
    #[serde(flatten)]
    distances: Distances,
}

impl Component {
    pub(super) fn new(row: &ComponentRow) -> Self {
        Self {
            label: row.label,
            fate: match row.fate {
                Fate::Kept => "kept",
                Fate::Merged => "merged",
                Fate::Lost => "lost",
            },
            position: row.position,
            image_voxels: row.image_voxels,
            image_volume: row.image_volume,
            tets: row.tets,
            mesh_volume: row.mesh_volume,
            components_mesh: row.components_mesh,
            euler_image: row.euler_image,
            euler_mesh: row.euler_mesh,
            distances: Distances::new([
                row.mesh_to_image,
                row.image_to_mesh,
                row.mesh_to_surface,
                row.surface_to_mesh,
            ]),
        }
    }
}

#[derive(Serialize)]
pub(super) struct DefectJson {
    kind: &'static str,
    label: i32,
    position: [f64; 3],
    size: u64,
}

impl From<&Defect> for DefectJson {
    fn from(defect: &Defect) -> Self {
        let &Defect { kind, label, position, size } = defect;
        Self { kind: name_of_defect(kind), label, position, size }
    }
}

fn name_of_defect(kind: DefectKind) -> &'static str {
    match kind {
        DefectKind::Lost => "lost",
        DefectKind::Merged => "merged",
        DefectKind::Torn => "torn",
        DefectKind::Stray => "stray",
        DefectKind::NonManifoldEdge => "non_manifold_edge",
        DefectKind::NonManifoldVertex => "non_manifold_vertex",
        DefectKind::Dropped => "dropped",
    }
}
