//! What the oracle's queries cost on the brain atlas: nanoseconds per call on points near the interfaces, in random order and in an order in which
//! neighbours follow each other, as refinement makes them. `cargo bench --bench oracle [image.nrrd]`; one thread.

use std::{hint::black_box, io::Read, time::Instant};

use glam::DVec3;
use lapd::{
    Error, Result,
    image::{Frame, LabelImage},
    oracle::Oracle,
    params::SurfaceModel,
};

const POINTS: usize = 1_000_000;
const BLOCKS: usize = 1000;
const PASSES: usize = 6;

fn main() -> Result<()> {
    let shared = std::env::var("LAPD_IMAGES")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/images").into());
    let path = std::env::args().skip(1).find(|a| a.ends_with(".nrrd")).unwrap_or(format!("{shared}/spl/brain.nrrd"));
    let Ok(file) = std::fs::read(&path) else {
        println!("SKIPPED: {path} is not there");
        return Ok(());
    };
    let image =
        read(&file).ok_or_else(|| Error::InvalidArgument(format!("{path}: not a gzip NRRD of i16 voxels")))??;
    for model in [SurfaceModel::Smooth, SurfaceModel::Voxel] {
        let start = Instant::now();
        let oracle = Oracle::new(&image, model, &|| Ok(()))?;
        println!(
            "{model:?} model: built in {:.0} ms, {:.1} MB",
            start.elapsed().as_secs_f64() * 1e3,
            oracle.bytes() as f64 / 1e6
        );
        measure(&oracle);
        excess(&oracle);
    }
    Ok(())
}

fn measure(oracle: &Oracle) {
    let points = points_near_surface(oracle);
    let mut coherent = points.clone();
    coherent.sort_by_key(|p| morton((*p - oracle.bounds()[0]) / 2.0));
    println!("{:24}{:>12}{:>12}   ns per call", "", "random", "coherent");
    let row = |name: &str, query: &dyn Fn(&[DVec3], usize) -> f64| {
        // Each block of points at its best of some passes over all: other programs only make it slower.
        let time = |points: &[DVec3]| {
            let mut best = [f64::INFINITY; BLOCKS];
            for _ in 0..PASSES {
                for (block, best) in best.iter_mut().enumerate() {
                    let start = Instant::now();
                    let range = block * POINTS / BLOCKS..(block + 1) * POINTS / BLOCKS;
                    black_box(range.map(|at| query(points, at)).sum::<f64>());
                    *best = best.min(start.elapsed().as_secs_f64());
                }
            }
            best.iter().sum::<f64>() * 1e9 / POINTS as f64
        };
        println!("{name:24}{:12.1}{:12.1}", time(&points), time(&coherent));
    };
    row("label", &|p, at| f64::from(oracle.label(p[at])));
    row("clearance", &|p, at| oracle.clearance(p[at]));
    row("sample", &|p, at| oracle.sample(p[at]).clearance);
    row("closest_surface_point", &|p, at| oracle.closest_surface_point(p[at], 5.0).map_or(0.0, |q| q.x));
    // Segments of about the length of the dual of a facet.
    let end = |p: &[DVec3], at: usize| {
        let h = (at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        p[at] + DVec3::new((h >> 56) as f64, (h >> 48 & 255) as f64, (h >> 40 & 255) as f64) / 64.0 - 2.0
    };
    row("first_crossing", &|p, at| oracle.first_crossing(p[at], end(p, at)).map_or(0.0, |c| c.point.x));
}

/// How much farther the closest surface point is than the nearest of many rays' first crossings, in units of length.
fn excess(oracle: &Oracle) {
    const RAYS: usize = 2000;
    let mut excess: Vec<f64> = points_near_surface(oracle)
        .iter()
        .take(2000)
        .filter_map(|&p| {
            let d = oracle.closest_surface_point(p, f64::INFINITY)?.distance(p);
            let nearest = (0..RAYS).fold(d, |nearest, n| {
                // Directions spread evenly by the golden angle.
                let z = (2 * n + 1) as f64 / RAYS as f64 - 1.0;
                let (sin, cos) = (n as f64 * 2.399_963_229_728_653).sin_cos();
                let way = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                oracle.first_crossing(p, p + way * nearest).map_or(nearest, |c| c.point.distance(p).min(nearest))
            });
            Some(d - nearest)
        })
        .collect();
    excess.sort_by(f64::total_cmp);
    let at = |part: f64| excess[((excess.len() - 1) as f64 * part) as usize];
    println!(
        "closest_surface_point beyond the closest: mean {:.3}, median {:.3}, 90 % {:.3}, 99 % {:.3}, maximum {:.3}\n",
        excess.iter().sum::<f64>() / excess.len() as f64,
        at(0.5),
        at(0.9),
        at(0.99),
        at(1.0)
    );
}

/// Points whose clearance is under two units, from all over the image.
fn points_near_surface(oracle: &Oracle) -> Vec<DVec3> {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let [low, high] = oracle.bounds();
    let mut points = Vec::with_capacity(POINTS);
    while points.len() < POINTS {
        let p = low + (high - low) * DVec3::new(random(), random(), random());
        if oracle.clearance(p) < 2.0 {
            points.push(p);
        }
    }
    points
}

/// Interleaves the bits of the coordinates.
fn morton(p: DVec3) -> u64 {
    (0..20).fold(0, |m, bit| (0..3).fold(m, |m, a| m | ((p[a].max(0.0) as u64 >> bit) & 1) << (3 * bit + a)))
}

/// An attached gzip NRRD of little-endian i16 voxels, as the atlases are; `None` when it is something else. Only the spacing matters here.
fn read(file: &[u8]) -> Option<Result<LabelImage>> {
    let blank = file.windows(2).position(|w| w == b"\n\n")?;
    let header = std::str::from_utf8(&file[..blank]).ok()?;
    let field = |name: &str| header.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix(": "));
    let dims: Vec<usize> = field("sizes")?.split_whitespace().filter_map(|w| w.parse().ok()).collect();
    let lengths: Vec<f64> = field("space directions")?
        .split_whitespace()
        .map(|v| {
            v.trim_matches(['(', ')'])
                .split(',')
                .filter_map(|c| c.parse::<f64>().ok())
                .map(|c| c * c)
                .sum::<f64>()
                .sqrt()
        })
        .collect();
    let mut voxels = Vec::new();
    flate2::read::GzDecoder::new(&file[blank + 2..]).read_to_end(&mut voxels).ok()?;
    let voxels: Vec<i32> = voxels.chunks_exact(2).map(|b| i32::from(i16::from_le_bytes([b[0], b[1]]))).collect();
    let mut labels: Vec<i32> = voxels.clone();
    labels.push(0);
    labels.sort_unstable();
    labels.dedup();
    labels.retain(|&l| l != 0);
    labels.insert(0, 0);
    let id: std::collections::HashMap<i32, u16> = labels.iter().enumerate().map(|(id, &l)| (l, id as u16)).collect();
    let ids = voxels.iter().map(|l| id[l]).collect();
    let frame = Frame::axis_aligned(lengths.try_into().ok()?);
    Some(frame.and_then(|frame| LabelImage::from_ids(dims.try_into().unwrap_or([0; 3]), frame, ids, labels)))
}
