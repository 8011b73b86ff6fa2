//! Any image with any parameters: the run ends, and what it makes is sound.
//!
//! `LAPD_RANDOM_MESHES` is how many to try (300), `LAPD_RANDOM_FIRST` the seed of the first (0):
//! `LAPD_RANDOM_MESHES=20000 cargo test --test mesher anything`

use std::io::Write;
use std::panic::catch_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use glam::{DMat3, DVec3, EulerRot};
use lapd::Error;
use lapd::geometry::predicates::orient;
use lapd::image::{Frame, LabelImage};
use lapd::monitor::Monitor;
use lapd::parallel::machine::Machine;
use lapd::params::{Adaptive, Algorithm, ImageBorder, Improve, MeshParams, SurfaceModel};
use lapd::pipeline::{MeshResult, mesh_image};

use super::assert_sound;
use super::random::Random;

/// Seconds that one of these small runs may take.
const PATIENCE: u64 = 60;

/// Seeds that failed once: a search for a crossing without an end; improvement that took 35 s for
/// 110 000 tets; a facet at a wall that was asked again without an end.
const FAILED: [u64; 3] = [2199, 117_121, 501_120];

impl Random {
    /// A whole number below `end`.
    fn below(&mut self, end: usize) -> usize {
        (self.unit() * end as f64) as usize
    }

    fn is(&mut self, chance: f64) -> bool {
        self.unit() < chance
    }
}

fn frame(random: &mut Random) -> Frame {
    // Voxels as images have them, thick slices, and needles.
    let ratio = [0.0, 0.3, 1.3][random.below(3)];
    let spacing = [0; 3].map(|_| 10_f64.powf(random.between(-ratio, ratio)));
    let origin = [0; 3].map(|_| random.between(-300.0, 300.0).round());
    let turn = match random.below(3) {
        0 => DMat3::from_euler(EulerRot::XYZ, random.unit(), random.unit(), random.unit()),
        _ => DMat3::IDENTITY,
    };
    Frame::new(origin, spacing, turn.to_cols_array_2d()).unwrap()
}

/// Noise, blocks, half-spaces or little of all, with as many labels as come.
fn image(random: &mut Random) -> LabelImage {
    let dims = [0; 3].map(|_| 1 + random.below(9));
    let labels = 2 + random.below(5);
    let kind = random.below(4);
    let density = random.between(0.05, 1.0);
    let block = 1 + random.below(3);
    let coarse: Vec<u16> = (0..729).map(|_| random.below(labels) as u16).collect();
    let planes: Vec<DVec3> = (0..labels)
        .map(|_| 0.5 * DVec3::new(random.unit(), random.unit(), random.unit()) - 0.25)
        .collect();
    let mut ids = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let center = DVec3::new(i as f64, j as f64, k as f64);
                ids.push(match kind {
                    0 if random.is(density) => random.below(labels) as u16,
                    0 => 0,
                    1 => coarse[i / block + 9 * (j / block + 9 * (k / block))],
                    2 => planes.iter().filter(|plane| plane.dot(center) > density).count() as u16,
                    _ => u16::from(random.is(0.5 * density)),
                });
            }
        }
    }
    ids[0] = ids[0].max(1);
    LabelImage::from_ids(dims, frame(random), ids, (0..=labels as i32).collect()).unwrap()
}

fn params(image: &LabelImage, random: &mut Random) -> MeshParams {
    let spacing = image.frame().spacing();
    let side = match random.below(2) {
        0 => spacing.min_element(),
        _ => spacing.element_product().cbrt(),
    };
    let delta = side * [0.6, 1.0, 1.5, 3.0, 10.0][random.below(5)];
    let surface = [SurfaceModel::Smooth, SurfaceModel::Smooth, SurfaceModel::Voxel];
    let surface = surface[random.below(3)];
    let smooths = surface == SurfaceModel::Smooth && random.is(0.2);
    let order = if random.is(0.1) { 2 } else { 1 };
    MeshParams {
        delta,
        size: delta * [1.0, 2.0, 2.0, 10.0][random.below(4)],
        radius_edge: [2.0, 2.0, 2.5, 4.0][random.below(4)],
        facet_angle: [30.0, 30.0, 20.0, 0.0][random.below(4)],
        adaptive: if random.is(0.7) { Adaptive::Thickness } else { Adaptive::Off },
        min_voxels: [0, 0, 0, 2, 5][random.below(5)],
        improve: [Improve::Full, Improve::Full, Improve::Interior, Improve::None][random.below(4)],
        target_dihedral: [15.0, 15.0, 5.0, 20.0, 30.0][random.below(5)],
        order,
        curved: order == 2 && random.is(0.5),
        surface,
        sigma: if smooths { random.between(0.3, 2.0) } else { 0.0 },
        border: [ImageBorder::Flat, ImageBorder::Flat, ImageBorder::Smooth][random.below(3)],
        background: random.is(0.1),
        threads: 1 + random.below(3),
        algorithm: [Algorithm::Podm, Algorithm::Lapd][random.below(2)],
        machine: Some(Machine::uniform(2, 2)),
        max_vertices: Some(40_000),
        ..MeshParams::default()
    }
}

/// Every tet has a positive volume by exact arithmetic, which neither refinement nor certificate is
/// asked about.
fn assert_positive(meshing: &MeshResult) {
    let mesh = &meshing.mesh;
    for tet in &mesh.tets {
        let [a, b, c, d] = tet.map(|v| mesh.point(v));
        assert!(orient(a, b, c, d) > 0.0, "tet {tet:?} is not positive");
    }
}

fn case(seed: u64) -> (LabelImage, MeshParams) {
    let mut random = Random(seed);
    let image = image(&mut random);
    let mut params = params(&image, &mut random);
    // Not those that failed once: they keep what they failed with.
    if params.adaptive == Adaptive::Thickness && seed % 5 == 3 {
        params.adaptive = Adaptive::Topology;
    }
    if seed % 4 == 2 {
        params.across = Some([1.0, 2.0, 3.5][seed as usize % 3]);
        params.gradation = [0.4, 0.1, 2.0][seed as usize / 4 % 3];
    }
    if seed % 3 == 2 && params.improve == Improve::Full && !FAILED.contains(&seed) {
        params.coarsen = Some([15.0, 5.0, 30.0][seed as usize % 9 / 3]);
    }
    (image, params)
}

fn check(seed: u64) {
    let (image, params) = case(seed);
    let meshing = match mesh_image(&image, &params, &Monitor::silent()) {
        Ok(meshing) => meshing,
        Err(Error::InvalidArgument(message)) if message.contains("too coarse") => return,
        Err(Error::EmptyImage | Error::LimitReached(_)) => return,
        Err(error) => panic!("{error}, of {params:?}"),
    };
    assert_sound(&meshing);
    assert_positive(&meshing);
    let quality = &meshing.report.quality;
    assert!(quality.max_radius_edge.is_finite(), "radius-edge ratio {}", quality.max_radius_edge);
}

#[test]
fn any_image_with_any_parameters_gives_a_sound_mesh() {
    let of = |name: &str, usual| std::env::var(name).map_or(usual, |n| n.parse().unwrap());
    let first: u64 = of("LAPD_RANDOM_FIRST", 0);
    let mut failed = Vec::new();
    for seed in FAILED.into_iter().chain(first..first + of("LAPD_RANDOM_MESHES", 300)) {
        let (ended, wait) = channel::<()>();
        // A run that hangs cannot be ended otherwise.
        std::thread::spawn(move || {
            let waited = wait.recv_timeout(Duration::from_secs(PATIENCE));
            if waited == Err(RecvTimeoutError::Timeout) {
                // Past the test's own output, which ends with the process.
                let _ = writeln!(std::io::stderr(), "seed {seed}: not ended in {PATIENCE} s");
                std::process::abort();
            }
        });
        // The panic's own message has been printed.
        if catch_unwind(|| check(seed)).is_err() {
            failed.push(seed);
        }
        drop(ended);
    }
    assert!(failed.is_empty(), "seeds {failed:?} failed");
}

/// R3 asks for nothing at a wall where a vertex is close. These were not asked again when that
/// vertex was gone, and from 1 to 19 facets stayed unmet.
#[test]
fn facets_at_walls_are_asked_again() {
    for seed in [300_247, 300_585, 300_783, 301_052, 301_348] {
        let (image, params) = case(seed);
        // One worker alone asks again. These failed with what is thin sampled more densely.
        let params = MeshParams { threads: 1, adaptive: Adaptive::Thickness, ..params };
        let meshing = mesh_image(&image, &params, &Monitor::silent()).unwrap();
        let [_, _, r3, ..] = meshing.report.certificate.unmet.unwrap();
        assert_eq!(r3, 0, "seed {seed}");
    }
}

/// Where the bounds of a sphere did not tell whether R3's point lies in it, insertion began in the
/// tet across the facet, even if the point lay outside of that one's sphere. Then it was dropped,
/// and from 2 to 6 facets stayed unmet.
#[test]
fn surface_centers_begin_in_a_tet_that_they_are_in_conflict_with() {
    for (seed, spacing_floor) in
        [(300_247, 0.9), (300_585, 0.4), (300_585, 0.6), (300_585, 0.8), (300_783, 0.9)]
    {
        let (image, params) = case(seed);
        let adaptive = Adaptive::Thickness;
        let params = MeshParams { threads: 1, adaptive, spacing_floor, ..params };
        let meshing = mesh_image(&image, &params, &Monitor::silent()).unwrap();
        let unmet = meshing.report.certificate.unmet;
        assert_eq!(unmet, Some([0; 6]), "seed {seed}, floor {spacing_floor}");
    }
}

/// Where three labels met at a wall the way to the background went to and fro between two of them.
#[test]
fn labels_that_meet_at_a_wall_do_not_hold_up_the_way_out() {
    let ids = "000010001120112011201120100001201120112011221200100000001000012031201120112";
    let ids: Vec<u16> = ids.bytes().map(|id| u16::from(id - b'0')).collect();
    let frame = Frame::new([1.0, 0.0, 0.0], [0.125, 1.0, 1.0], DMat3::IDENTITY.to_cols_array_2d());
    let image = LabelImage::from_ids([3, 5, 5], frame.unwrap(), ids, vec![0, 1, 2, 3]).unwrap();
    let params =
        MeshParams { adaptive: Adaptive::Off, surface: SurfaceModel::Voxel, ..Default::default() };
    assert_sound(&mesh_image(&image, &params, &Monitor::silent()).unwrap());
}
