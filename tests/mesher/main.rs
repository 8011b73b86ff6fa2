//! The mesher as a whole, on images whose meshes can be judged without it: what is checked is
//! measured here from the arrays of the mesh, or by the certificate, which refinement does not use.
//!
//! | file | what |
//! |---|---|
//! | `phantoms` | analytic bodies: volumes, distances, topology |
//! | `thin` | what is thinner than the samples are apart, or touches itself |
//! | `across` | numbers of elements across layers |
//! | `placement` | spacing, direction, origin, parameters that choose what is meshed |
//! | `inputs` | intensities, probability maps, smoothed labels |
//! | `budget` | numbers of tets that are asked for, and what is expected |
//! | `awkward` | images and sizes that nobody plans for |
//! | `anything` | any image with any parameters, by random numbers |
//! | `runs` | one run against another: determinism, cancelling, limits, demands that are left |

mod across;
mod anything;
mod awkward;
mod budget;
mod inputs;
mod phantoms;
mod placement;
#[path = "../random/mod.rs"]
mod random;
mod runs;
mod thin;

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use lapd::geometry::measures::{radius_edge_ratio, tet_circumradius, tet_volume, triangle_angles};
use lapd::geometry::predicates::orient;
use lapd::image::LabelImage;
use lapd::mesh::{NONE, TetMesh};
use lapd::monitor::Monitor;
use lapd::params::{CertificateLevel, Improve, MeshParams};
use lapd::pipeline::{MeshResult, mesh_image};

/// Relative slack for figures that are computed in another way than the rules do.
const ROUNDING: f64 = 1e-9;

/// Parameters of the usual proportions; all that can be measured is.
fn params(delta: f64) -> MeshParams {
    let certificate = CertificateLevel::Full;
    MeshParams { delta, size: 2.0 * delta, certificate, ..MeshParams::default() }
}

/// Meshes without checking anything.
fn run(image: &LabelImage, params: &MeshParams) -> MeshResult {
    mesh_image(image, params, &Monitor::silent()).unwrap_or_else(|e| panic!("{e}"))
}

/// Meshes, and checks that the mesh is sound, that every bound of `params` holds, and that no rule
/// is unmet: as refinement leaves it, and as improved.
fn mesh(image: &LabelImage, params: &MeshParams) -> MeshResult {
    let checked = |params: &MeshParams| {
        let meshing = run(image, params);
        assert_sound(&meshing);
        assert_eq!(meshing.report.certificate.unmet, Some([0; 6]), "unmet rules");
        assert_bounds(&meshing, params);
        meshing
    };
    checked(&MeshParams { improve: Improve::None, ..params.clone() });
    checked(params)
}

/// Checks what holds for every mesh: the certificate's zeros, and that the arrays fit each other.
fn assert_sound(meshing: &MeshResult) {
    let (mesh, certificate) = (&meshing.mesh, &meshing.report.certificate);
    assert_eq!(certificate.non_delaunay_facets, Some(0), "facets that are not Delaunay");
    assert_eq!(certificate.inverted_tets, 0, "inverted tets");
    assert_eq!(certificate.orphan_vertices, 0, "vertices in no tet");
    assert_eq!(certificate.open_edges, 0, "open edges");
    assert!(meshing.report.quality.min_volume > 0.0 || mesh.tets.is_empty());

    for (t, neighbors) in mesh.neighbors.iter().enumerate() {
        for (i, &n) in neighbors.iter().enumerate().filter(|&(_, &n)| n != NONE) {
            let shared = facet_of(mesh, t, i);
            let back = mesh.neighbors[n as usize].iter().position(|&u| u as usize == t);
            let back =
                back.unwrap_or_else(|| panic!("tets {t} and {n} disagree about being neighbours"));
            assert_eq!(
                facet_of(mesh, n as usize, back),
                shared,
                "tets {t} and {n} name different facets"
            );
        }
    }
    // The interface is the set of all facets between tets of different label, each once, its normal
    // pointing from the first label to the second.
    let mut expected = BTreeSet::new();
    for t in 0..mesh.tets.len() {
        for (i, &n) in mesh.neighbors[t].iter().enumerate() {
            let other = if n == NONE { 0 } else { mesh.labels[n as usize] };
            if mesh.labels[t] != other {
                expected.insert(facet_of(mesh, t, i));
            }
        }
    }
    let found: BTreeSet<[u32; 3]> = mesh.facets.iter().map(|&facet| sorted(facet)).collect();
    assert_eq!(found.len(), mesh.facets.len(), "a facet is listed twice");
    assert!(found == expected, "{} interface facets, {} listed", expected.len(), found.len());
    for (f, facet) in mesh.facets.iter().enumerate() {
        let [from, to] = mesh.facet_labels[f];
        assert!(from != 0 && (to == 0 || from < to), "labels of facet {f}: {from}, {to}");
        let [a, b, c] = facet.map(|v| mesh.point(v));
        for (side, label, sign) in [(0, from, -1.0), (1, to, 1.0)] {
            let t = mesh.facet_tets[f][side];
            if t == NONE {
                assert_eq!(label, 0, "facet {f} has no tet on the side of label {label}");
                continue;
            }
            assert_eq!(mesh.labels[t as usize], label, "side {side} of facet {f}");
            let tet = mesh.tets[t as usize];
            let apex =
                tet.into_iter().find(|v| !facet.contains(v)).expect("a tet with four vertices");
            // Exactly: tets of images with thin voxels may be nearly flat.
            let above = orient(a, b, c, mesh.point(apex));
            assert!(sign * above > 0.0, "facet {f} points the wrong way");
        }
    }
}

/// How many times as large as refinement's the circumradius of an improved tet may be.
const IMPROVED: f64 = 3.0;

/// Checks the bounds on radius-edge ratio, circumradius and facet angle. Improvement gives up the
/// first, and some of the second.
fn assert_bounds(meshing: &MeshResult, params: &MeshParams) {
    let mesh = &meshing.mesh;
    let size_of = |label: i32| params.label_sizes.get(&label).copied().unwrap_or(params.size);
    // A tet that mending gave its label may be flat, so that its circumradius is large. Such a tet
    // is listed as left.
    let improvement = &meshing.report.improvement;
    let is_left =
        |t: u32| improvement.tets_mended > 0 && improvement.left.iter().any(|left| left.tet == t);
    let labelled = (0..).zip(&mesh.tets).zip(&mesh.labels).filter(|&(_, &label)| label != 0);
    for ((t, tet), &label) in labelled {
        let corners = tet.map(|v| mesh.point(v));
        let (ratio, radius) = (radius_edge_ratio(&corners), tet_circumradius(&corners));
        if params.improve == Improve::None {
            assert!(ratio <= params.radius_edge * (1.0 + ROUNDING), "radius-edge ratio {ratio}");
            assert!(
                radius <= size_of(label) * (1.0 + ROUNDING),
                "circumradius {radius}, label {label}"
            );
        } else {
            let is_small = radius <= IMPROVED * size_of(label);
            assert!(is_small || is_left(t), "circumradius {radius}, label {label}");
        }
    }
    let is_sharp = |facet: &&[u32; 3]| {
        let angles = triangle_angles(&facet.map(|v| mesh.point(v)));
        angles.iter().any(|&angle| angle < params.facet_angle - 1e-6)
    };
    // Where topology is mended some are, and are counted.
    let allowed = if improvement.tets_mended > 0 { improvement.facets_below } else { 0 };
    let sharp = mesh.facets.iter().filter(is_sharp).count() as u64;
    assert!(sharp <= allowed, "{sharp} facets are sharp, {allowed} are counted");
}

fn sorted(mut facet: [u32; 3]) -> [u32; 3] {
    facet.sort_unstable();
    facet
}

/// The vertices of facet i of a tet, sorted.
fn facet_of(mesh: &TetMesh, t: usize, i: usize) -> [u32; 3] {
    sorted([1, 2, 3].map(|k| mesh.tets[t][(i + k) % 4]))
}

/// Volume of each label other than 0.
fn volumes(mesh: &TetMesh) -> BTreeMap<i32, f64> {
    let mut volumes = BTreeMap::new();
    for (tet, &label) in mesh.tets.iter().zip(&mesh.labels).filter(|&(_, &label)| label != 0) {
        *volumes.entry(label).or_default() += tet_volume(&tet.map(|v| mesh.point(v)));
    }
    volumes
}

/// Euler characteristic of the boundary of a union of labels, and the edges at which not exactly
/// two of its facets meet.
fn boundary_topology(mesh: &TetMesh, labels: &[i32]) -> (i64, usize) {
    let mut vertices = BTreeSet::new();
    let mut edges: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    let mut facets = 0;
    for (facet, sides) in mesh.facets.iter().zip(&mesh.facet_labels) {
        if labels.contains(&sides[0]) == labels.contains(&sides[1]) {
            continue;
        }
        facets += 1;
        let [a, b, c] = sorted(*facet);
        vertices.extend([a, b, c]);
        for edge in [[a, b], [a, c], [b, c]] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    let odd = edges.values().filter(|&&n| n != 2).count();
    (vertices.len() as i64 - edges.len() as i64 + facets, odd)
}

/// Lower and upper corner of the mesh.
fn bounds(mesh: &TetMesh) -> [DVec3; 2] {
    let points = mesh.points.iter().map(|&p| DVec3::from_array(p));
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}
