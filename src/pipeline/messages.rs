//! What a run says as it goes on, and what a caller should know in the end.

use crate::delaunay::worker::Counters;
use crate::image::LabelImage;
use crate::improve::Improvement;
use crate::mesh::TetMesh;
use crate::monitor::{Level, Monitor};
use crate::params::MeshParams;
use crate::verify::certificate::{
    Certificate, Defect, DefectKind, MIN_COMPONENT_VOXELS, SmallLost,
};

/// A line about what is meshed.
pub(super) fn describe(image: &LabelImage, params: &MeshParams) -> String {
    let [nx, ny, nz] = image.dims();
    let spacing = image.frame().spacing();
    format!(
        "meshing {} labels of {nx} x {ny} x {nz} voxels of {} x {} x {} at delta {}, size {}",
        image.labels().len() - 1,
        spacing.x,
        spacing.y,
        spacing.z,
        params.delta,
        params.size
    )
}

/// Says so where long voxels are not divided as far as they would be.
pub(super) fn warn_of_long_voxels(monitor: &Monitor<'_>) {
    let line = "the image is too large for its long voxels to be divided into cubes: meshes of \
                thick slices may have holes and bridges that it does not have; crop it to the \
                object";
    monitor.log(Level::Warning, line);
}

/// A line about an image whose long voxels were divided.
pub(super) fn describe_division(image: &LabelImage, divided: &LabelImage) -> String {
    let [x, y, z] = [0, 1, 2].map(|a| divided.dims()[a] / image.dims()[a]);
    let spacing = divided.frame().spacing();
    format!(
        "long voxels divided into {x} x {y} x {z} parts of {:.4} x {:.4} x {:.4}",
        spacing.x, spacing.y, spacing.z
    )
}

pub(super) fn log_refinement(monitor: &Monitor<'_>, counters: &Counters, seconds: f64) {
    let Counters { insertions, removals, created, destroyed, .. } = counters;
    let tets = created.saturating_sub(*destroyed);
    let rate = tets as f64 / seconds.max(1e-9);
    let line = format!(
        "refinement done in {seconds:.2} s: {tets} tets, {insertions} insertions, {removals} \
         removals, {rate:.0} tets per second"
    );
    monitor.log(Level::Info, &line);
}

pub(super) fn log_extraction(monitor: &Monitor<'_>, mesh: &TetMesh, seconds: f64) {
    let (tets, vertices) = (mesh.tets.len(), mesh.points.len());
    let line = format!("mesh of {tets} tets, {vertices} vertices collected in {seconds:.2} s");
    monitor.log(Level::Info, &line);
}

pub(super) fn log_try(monitor: &Monitor<'_>, params: &MeshParams, tets: u64) {
    let MeshParams { delta, size, .. } = params;
    monitor.log(Level::Info, &format!("delta {delta:.4}, size {size:.4}: {tets} tets"));
}

pub(super) fn log_differences(monitor: &Monitor<'_>, round: usize, count: usize, goes_on: bool) {
    let what = if goes_on { ", sampled more densely" } else { "" };
    let line = match count {
        0 => format!("round {round}: what is connected is as in the image"),
        _ => format!(
            "round {round}: the mesh differs from the image in what is connected, or ends before \
             a wall, at {count} places{what}"
        ),
    };
    monitor.log(Level::Info, &line);
}

pub(super) fn log_improvement(monitor: &Monitor<'_>, improvement: &Improvement, seconds: f64) {
    let Improvement { below_before, left, counts, .. } = improvement;
    let (operations, left) = (counts.operations(), left.len());
    let line = format!(
        "slivers removed in {seconds:.2} s: {below_before} tets below the target, {operations} \
         operations, {left} left"
    );
    monitor.log(Level::Info, &line);
}

/// What a caller should know before relying on the mesh, a line for each kind of defect.
pub(super) fn warnings(certificate: &Certificate) -> Vec<String> {
    let mut lines = Vec::new();
    for (rule, &unmet) in
        certificate.unmet.iter().flatten().enumerate().filter(|&(_, &unmet)| unmet > 0)
    {
        lines.push(format!("rule R{} stays unmet {unmet} times", rule + 1));
    }
    let lost = || certificate.labels.iter().filter(|row| row.tets == 0);
    if let Some(first) = lost().next() {
        let voxels: u64 = lost().map(|row| row.image_voxels).sum();
        lines.push(format!(
            "labels without a tet: {}, of {voxels} voxels in all; the first is {}",
            lost().count(),
            first.label
        ));
    }
    let topology = [
        (DefectKind::Lost, "components without a tet"),
        (DefectKind::Merged, "components merged with another one of their label"),
        (DefectKind::Torn, "pieces torn off from their component"),
        (DefectKind::Stray, "pieces where the image does not have their label"),
        (DefectKind::Dropped, "components left out, as asked"),
        (DefectKind::NonManifoldEdge, "edges where a label's boundary touches itself"),
        (DefectKind::NonManifoldVertex, "vertices where a label's boundary touches itself"),
    ];
    for (kind, what) in topology {
        let mut of_kind = certificate.defects.iter().filter(|defect| defect.kind == kind);
        if let Some(Defect { label, position: [x, y, z], .. }) = of_kind.next() {
            let count = 1 + of_kind.count();
            lines.push(format!(
                "{what}: {count}; the first, of label {label}, at ({x:.2}, {y:.2}, {z:.2})"
            ));
        }
    }
    let SmallLost { count, voxels, first } = certificate.small_lost;
    if let Some((label, [x, y, z])) = first {
        lines.push(format!(
            "components of fewer than {MIN_COMPONENT_VOXELS} voxels without a tet: {count}, of \
             {voxels} voxels in all; the first, of label {label}, at ({x:.2}, {y:.2}, {z:.2})"
        ));
    }
    let defects = [
        (certificate.non_delaunay_facets.unwrap_or(0), "facets that are not Delaunay"),
        (certificate.inverted_tets, "inverted tets"),
        (certificate.orphan_vertices, "vertices in no tet"),
        (certificate.open_edges, "open edges of interfaces"),
        (certificate.facets_off_walls, "outer facets that should lie where the image ends"),
    ];
    for (count, what) in defects.into_iter().filter(|&(count, _)| count > 0) {
        lines.push(format!("certificate: {count} {what}"));
    }
    lines
}

/// Says so if the size of tets asks for denser samples than delta does.
pub(super) fn warn_of_lowered(params: &MeshParams, lowered: f64, monitor: &Monitor<'_>) {
    if lowered < params.delta {
        let line = format!(
            "size {} needs samples of the interfaces no more than {lowered} apart: delta {} is \
             lowered to that",
            params.size, params.delta
        );
        monitor.log(Level::Warning, &line);
    }
}

/// Says so if a mesh has another number of tets of labels than was asked for.
pub(super) fn warn_of_missed(target: u64, mesh: &TetMesh, monitor: &Monitor<'_>) {
    /// What is promised: a tenth.
    const WITHIN: f64 = 0.1;
    let tets = mesh.labels.iter().filter(|&&label| label != 0).count();
    if (tets as f64 / target as f64 - 1.0).abs() > WITHIN {
        let line = format!(
            "{target} tets were asked for, and the nearest mesh that was found has {tets}: no \
             distance of samples leads to that many for this image"
        );
        monitor.log(Level::Warning, &line);
    }
}

/// Says so if a mesh will have very many tets for its image, and not because delta and size ask for
/// them: `asked_for` are those that these alone make.
pub(super) fn warn_of_many([asked_for, expected]: [f64; 2], voxels: f64, monitor: &Monitor<'_>) {
    /// At half a voxel between samples a mesh has some ten tets per voxel.
    const MANY_PER_VOXEL: f64 = 100.0;
    /// How many times as many as asked for are worth a word.
    const MANY_TIMES: f64 = 4.0;
    if expected > MANY_PER_VOXEL * voxels && expected > MANY_TIMES * asked_for {
        let line = format!(
            "about {expected:.1e} tets are to be expected, {:.0} for each voxel of the object: \
             what is thin makes all around it small; a larger delta with --adaptive topology or \
             off, or a larger --spacing-floor, makes fewer, unless the image itself is thin",
            expected / voxels
        );
        monitor.log(Level::Warning, &line);
    }
}
