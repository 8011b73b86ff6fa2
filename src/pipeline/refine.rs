//! The second stage: from the prepared image to the refined mesh.

use rayon::prelude::*;

use super::messages;
use super::prepare::Prepared;
use crate::Result;
use crate::delaunay::{TetId, Triangulation};
use crate::image::LabelImage;
use crate::image::voxel_blocks::NearBlocks;
use crate::memory::bits::Bits;
use crate::memory::{concatenated, reserve};
use crate::mesh::TetMesh;
use crate::mesh::extract::{self, Background, Numbered};
use crate::mesh::part::part;
use crate::monitor::{Monitor, Step};
use crate::oracle::Oracle;
use crate::parallel::machine::Machine;
use crate::params::MeshParams;
use crate::refine::options::{Limits, RefineOptions};
use crate::refine::rules::{Rules, TETS_PER_SIZE};
use crate::system::binding::CoreMap;

/// The box leaves this part of the object's longest side free on every side, so that the
/// circumcenters of tets between object and box lie inside it.
const BOX_MARGIN: f64 = 0.25;

/// The triangulation of a box around an object whose interfaces get samples `delta` apart.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn triangulation_around(oracle: &Oracle, delta: f64) -> Result<Triangulation> {
    let [lower, upper] = oracle.bounds();
    let longest = (upper - lower).max_element();
    // Samples are no farther apart than the object is long.
    let margin = longest * BOX_MARGIN + 4.0 * delta.min(longest);
    Triangulation::new(lower - margin, upper + margin)
}

/// Says so if there will be very many tets for the voxels of an image, and not because delta and
/// size ask for them.
pub(super) fn warn_of_many(
    image: &LabelImage,
    prepared: &Prepared,
    params: &MeshParams,
    monitor: &Monitor<'_>,
) {
    let Prepared { oracle, sizing, volume } = prepared;
    let by_volume = expected_by_volume(prepared, params);
    let about_interfaces = oracle.expected_tets(sizing.max(), &sizing.palette());
    let voxels = volume / image.voxel_volume();
    messages::warn_of_many(about_interfaces.map(|tets| tets + by_volume), voxels, monitor);
}

/// Tets to be expected for the size that is asked for, beside those about interfaces.
pub(super) fn expected_by_volume(prepared: &Prepared, params: &MeshParams) -> f64 {
    TETS_PER_SIZE * (prepared.volume / params.size.powi(3) + prepared.sizing.tets().cubes())
}

/// How `params` ask for the refinement to be done.
///
/// # Errors
/// [`Error::Unsupported`](crate::Error::Unsupported) where threads cannot be bound.
pub fn options(params: &MeshParams, limits: Limits, expected_tets: u64) -> Result<RefineOptions> {
    let machine = match &params.machine {
        Some(machine) => machine.clone(),
        // Has no others to be near to.
        None if params.threads == 1 => Machine::one_node(1),
        None => Machine::of_system(),
    };
    Ok(RefineOptions {
        expected_tets,
        parts: [0.0, 1.0],
        limits,
        threads: params.threads,
        contention: params.contention,
        begging: params.begging,
        places: params.bind.then(|| CoreMap::new(&machine)).transpose()?,
        machine,
        timeline: params.timeline,
        algorithm: params.algorithm,
        halving: false,
        count_accesses: params.count_accesses,
    })
}

/// What a finished mesh has of the background at first: improvement needs it around the object.
pub fn background_of(params: &MeshParams, is_improved: bool) -> Background {
    match (params.background, is_improved) {
        (true, _) => Background::Kept,
        (false, true) => Background::Last,
        (false, false) => Background::Dropped,
    }
}

/// A refined triangulation whose tets and vertices are numbered.
pub struct Ordered {
    /// The numbers.
    pub numbered: Numbered,
    /// The tets of the triangulation in the order of their places.
    pub order: Vec<TetId>,
}

/// Numbers what is kept of a triangulation that is at rest, labelled by `rules`.
///
/// # Errors
/// [`Cancelled`](crate::Error::Cancelled); [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn number(
    rules: &Rules<'_>,
    labels: &[i32],
    background: Background,
    monitor: &Monitor<'_>,
) -> Result<Ordered> {
    let triangulation = rules.triangulation();
    monitor.enter(Step::Number, triangulation.tet_bound() as usize)?;
    let order = triangulation.tets_by_place(|| monitor.advance(0))?;
    let label = |t| rules.label(t);
    let numbered = extract::number(triangulation, &order, label, labels, background, monitor)?;
    Ok(Ordered { numbered, order })
}

/// The mesh of such a triangulation, without its facets; the triangulation stays.
///
/// # Errors
/// As [`number`].
pub fn collect(
    rules: &Rules<'_>,
    labels: &[i32],
    background: Background,
    monitor: &Monitor<'_>,
) -> Result<TetMesh> {
    let Ordered { numbered, order } = number(rules, labels, background, monitor)?;
    drop(order);
    numbered.copy(rules.triangulation().tets(), monitor)
}

/// A part of a mesh.
pub struct Part {
    /// As of a whole mesh; beyond tets that are not in the part there is none.
    pub mesh: TetMesh,
    /// The tets beyond which there is another one of their label, not in the part.
    pub cut: Vec<u32>,
}

/// The part of such a mesh that some tets are, in the order of the slots of the triangulation.
///
/// # Errors
/// As [`number`].
pub fn collect_part(
    rules: &Rules<'_>,
    labels: &[i32],
    order: &[TetId],
    monitor: &Monitor<'_>,
) -> Result<Part> {
    let triangulation = rules.triangulation();
    let is_in_part = Bits::new(triangulation.tet_bound() as usize, WHAT)?;
    order.par_iter().for_each(|&t| is_in_part.set(t));
    let is_cut = |t: TetId| {
        let record = triangulation.tet(t);
        let beyond = (0..4).map(|i| record.neighbor(i)).filter(|facet| !facet.is_none());
        let mut others = beyond.map(|facet| facet.tet()).filter(|&u| !is_in_part.has(u));
        others.any(|u| rules.label(u) == rules.label(t))
    };
    let pieces = order.par_chunks(CHUNK as usize).enumerate().map(|(piece, tets)| {
        monitor.advance(0)?;
        let mut cut = Vec::new();
        for (n, &t) in (piece as u32 * CHUNK..).zip(tets) {
            if is_cut(t) {
                reserve(&mut cut, 1, WHAT)?;
                cut.push(n);
            }
        }
        Ok(cut)
    });
    let cut = concatenated(pieces.collect::<Result<_>>()?, WHAT)?;
    let label = |t| labels[usize::from(rules.label(t))];
    Ok(Part { mesh: part(triangulation, order, &is_in_part, label, monitor)?, cut })
}

/// The tets of labels that come near to some blocks, in the order of their slots; `None` if the
/// blocks are not few ([`NearBlocks::are_few`]).
pub(super) fn tets_near(
    rules: &Rules<'_>,
    blocks: &NearBlocks,
    monitor: &Monitor<'_>,
) -> Result<Option<Vec<TetId>>> {
    let triangulation = rules.triangulation();
    let mut near = rules.few_near(blocks, || monitor.advance(0))?;
    if let Some(near) = &mut near {
        // Boxes are smaller than the circumballs that were found.
        near.retain(|&t| {
            let vertices = triangulation.tet(t).vertices();
            let is_near = || blocks.blocks().meet_around(triangulation.corners(vertices));
            triangulation.is_living(t) && rules.label(t) != 0 && is_near()
        });
    }
    Ok(near)
}

/// What lists of tets have, as errors name it.
const WHAT: &str = "tets of the mesh";

/// Tets that are looked at between two looks at the cancel flag.
const CHUNK: u32 = 1 << 12;
