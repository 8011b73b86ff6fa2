//! Analytic label images for tests, benches and first steps.
//!
//! Each is centred: the world's origin is the centre of the grid, so that nothing depends on `dims`
//! but what is cut off at the border of the image. Lengths are in world units. A phantom's volumes
//! are given with it; the voxels' volume approaches them as the spacing goes to 0.

use std::f64::consts::PI;

use glam::DVec3;

use super::builder::voxel_count;
use super::{Frame, LabelImage, Voxels};
use crate::memory::zeroed;
use crate::{Error, Result};

/// A ball, label 1. Volume: [`ball_volume`].
///
/// # Errors
/// As [`sampled`].
pub fn ball(dims: [usize; 3], spacing: [f64; 3], radius: f64) -> Result<LabelImage> {
    nested_shells(dims, spacing, &[radius])
}

/// Concentric shells: label 1 is the ball of radius `radii[0]`, label `i + 1` what lies between
/// `radii[i - 1]` and `radii[i]`. Volumes: differences of [`ball_volume`].
///
/// # Errors
/// As [`sampled`]; [`Error::InvalidArgument`] when the radii do not increase.
pub fn nested_shells(dims: [usize; 3], spacing: [f64; 3], radii: &[f64]) -> Result<LabelImage> {
    if !radii.is_sorted_by(|a, b| a < b) {
        return Err(Error::InvalidArgument(format!(
            "radii of nested shells must increase, got {radii:?}"
        )));
    }
    sampled(dims, spacing, |p| {
        radii.iter().position(|r| p.length() <= *r).map_or(0, |i| i as i32 + 1)
    })
}

/// A torus about the z axis, label 1. Volume: [`torus_volume`].
///
/// # Errors
/// As [`sampled`].
pub fn torus(
    dims: [usize; 3],
    spacing: [f64; 3],
    major_radius: f64,
    minor_radius: f64,
) -> Result<LabelImage> {
    sampled(dims, spacing, |p| {
        i32::from((p.truncate().length() - major_radius).hypot(p.z) <= minor_radius)
    })
}

/// Three labels that meet in a line: a ball cut into sectors of 120 degrees about the z axis,
/// labels 1 to 3 in the order of the angle from the x axis. Each takes a third of [`ball_volume`].
///
/// # Errors
/// As [`sampled`].
pub fn three_labels_in_a_line(
    dims: [usize; 3],
    spacing: [f64; 3],
    radius: f64,
) -> Result<LabelImage> {
    sampled(dims, spacing, |p| {
        let turn = p.y.atan2(p.x).rem_euclid(2.0 * PI) / (2.0 * PI);
        if p.length() <= radius { 1 + ((3.0 * turn) as i32).min(2) } else { 0 }
    })
}

/// Four labels that meet in a point, the generic case: a ball cut into the Voronoi cells of the
/// corners of a regular tetrahedron, labels 1 to 4; four lines of three labels run out of the
/// centre. Each takes a quarter of [`ball_volume`].
///
/// # Errors
/// As [`sampled`].
pub fn four_labels_at_a_point(
    dims: [usize; 3],
    spacing: [f64; 3],
    radius: f64,
) -> Result<LabelImage> {
    let corners = [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(1.0, -1.0, -1.0),
        DVec3::new(-1.0, 1.0, -1.0),
        DVec3::new(-1.0, -1.0, 1.0),
    ];
    sampled(dims, spacing, |p| {
        let nearest = (1..4)
            .fold(0, |best, i| if corners[i].dot(p) > corners[best].dot(p) { i } else { best });
        if p.length() <= radius { nearest as i32 + 1 } else { 0 }
    })
}

/// Eight labels that meet in a point, a degenerate case: the octants of a ball, labels 1 to 8
/// (bits: x, y, z above 0); along the axes four labels meet in a line. Each takes an eighth of
/// [`ball_volume`].
///
/// # Errors
/// As [`sampled`].
pub fn eight_labels_at_a_point(
    dims: [usize; 3],
    spacing: [f64; 3],
    radius: f64,
) -> Result<LabelImage> {
    sampled(dims, spacing, |p| {
        if p.length() <= radius { 1 + p.cmpgt(DVec3::ZERO).bitmask() as i32 } else { 0 }
    })
}

/// A square plate across the z axis, label 1: `width` along x and y, `thickness` along z. Volume:
/// width^2 * thickness. A thickness of one or two spacings is a thin sheet.
///
/// # Errors
/// As [`sampled`].
pub fn thin_sheet(
    dims: [usize; 3],
    spacing: [f64; 3],
    width: f64,
    thickness: f64,
) -> Result<LabelImage> {
    let half = 0.5 * DVec3::new(width, width, thickness);
    sampled(dims, spacing, |p| i32::from(p.abs().cmple(half).all()))
}

/// A tube two voxels wide along a helix about the z axis, label 1: `turns` turns of the given
/// radius, with the pitch that fills the grid but for a margin of eight voxels. Voxels are cubes of
/// edge 1.
///
/// # Errors
/// As [`sampled`]; [`Error::InvalidArgument`] for a grid without room within its margins, a radius
/// with which the tube would leave the grid, turns that are none or less than a voxel apart;
/// [`Error::OutOfMemory`].
pub fn helical_tube(dims: [usize; 3], radius: f64, turns: f64) -> Result<LabelImage> {
    let invalid = |message: String| Err(Error::InvalidArgument(message));
    let count = voxel_count(dims)?;
    let height = dims[2] as f64 - 16.0;
    if height <= 0.0 {
        return invalid(format!(
            "a helical tube needs more than 16 voxels along z, got {}",
            dims[2]
        ));
    }
    let widest = 0.5 * dims[0].min(dims[1]) as f64 - 1.0;
    if !(0.0..=widest).contains(&radius) {
        return invalid(format!(
            "the radius of a helical tube must lie in 0 to {widest} in {dims:?} voxels, got \
             {radius}"
        ));
    }
    if turns.is_nan() || turns <= 0.0 || turns > height {
        return invalid(format!(
            "the turns of a helical tube must be above 0 and at most {height}, got {turns}"
        ));
    }
    let half = 0.5 * height;
    // 16 for each voxel of the way, so that none is missed; along z where that is longer.
    let steps = (turns * 2.0 * PI * radius * 16.0).max(16.0 * height) as usize;
    let mut voxels: Vec<u8> = zeroed(count, "voxels of a phantom")?;
    for step in 0..=steps {
        let part = step as f64 / steps as f64;
        let angle = 2.0 * PI * turns * part;
        let p = [radius * angle.cos(), radius * angle.sin(), (2.0 * part - 1.0) * half];
        let first = [0, 1, 2].map(|axis| (p[axis] + 0.5 * dims[axis] as f64).floor() as usize - 1);
        for corner in 0..8 {
            let [i, j, k] = [0, 1, 2].map(|axis| first[axis] + (corner >> axis & 1));
            voxels[i + dims[0] * (j + dims[1] * k)] = 1;
        }
    }
    LabelImage::from_voxels(Voxels::U8(&voxels), dims, None, 0, Frame::axis_aligned([1.0; 3])?)
}

/// Cubes of `cell` voxels along each axis, `count` of them along each, in a margin of four voxels
/// of background. Cube (a, b, c) has the label `label([a, b, c])`. Voxels are cubes of edge 1.
///
/// # Errors
/// As [`sampled`]; [`Error::InvalidArgument`] for cubes of 0 voxels.
pub fn cubes(count: usize, cell: usize, label: impl Fn([usize; 3]) -> i32) -> Result<LabelImage> {
    if cell == 0 {
        return Err(Error::InvalidArgument(format!(
            "cubes must have a voxel along each axis at least, got {cell}"
        )));
    }
    // Too many are more voxels than an image can have.
    let size = count.saturating_mul(cell).saturating_add(8);
    let half = 0.5 * (size as f64 - 1.0);
    sampled([size; 3], [1.0; 3], |p| {
        let at =
            (p + half).round().to_array().map(|c| (c as usize).checked_sub(4).map(|c| c / cell));
        match at {
            [Some(a), Some(b), Some(c)] if a.max(b).max(c) < count => label([a, b, c]),
            _ => 0,
        }
    })
}

/// A comb, label 1: a block of `teeth` teeth of three voxels along x, with slits one voxel wide
/// between them that end seven voxels above its bottom. 30 voxels along y and z, in a margin of
/// five. Voxels are cubes of edge 1.
///
/// # Errors
/// As [`sampled`].
pub fn comb(teeth: usize) -> Result<LabelImage> {
    let dims = [4 * teeth + 9, 40, 40];
    let half = dims.map(|n| 0.5 * (n as f64 - 1.0));
    sampled(dims, [1.0; 3], |p| {
        let [i, j, k] = [p.x + half[0], p.y + half[1], p.z + half[2]].map(|c| c.round() as usize);
        let inside = (5..dims[0] - 5).contains(&i) && (5..35).contains(&j) && (5..35).contains(&k);
        i32::from(inside && (k < 12 || (i - 5) % 4 != 3))
    })
}

/// Samples any label function of the world position on a grid centred at the world's origin.
///
/// # Errors
/// [`Error::InvalidArgument`] for dims or spacing that no image can have.
pub fn sampled(
    dims: [usize; 3],
    spacing: [f64; 3],
    label: impl Fn(DVec3) -> i32,
) -> Result<LabelImage> {
    let origin = std::array::from_fn(|axis| -0.5 * (dims[axis] as f64 - 1.0) * spacing[axis]);
    let frame = Frame::new(origin, spacing, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])?;
    LabelImage::from_fn(dims, frame, label)
}

/// Volume of a ball.
pub fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius.powi(3)
}

/// Volume of a torus; `minor_radius` at most `major_radius`.
pub fn torus_volume(major_radius: f64, minor_radius: f64) -> f64 {
    2.0 * PI * PI * major_radius * minor_radius * minor_radius
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volumes of the labels other than 0.
    fn volumes(image: &LabelImage) -> Vec<f64> {
        image.voxel_counts()[1..].iter().map(|&n| n as f64 * image.voxel_volume()).collect()
    }

    fn assert_volumes(image: Result<LabelImage>, expected: &[f64]) {
        let image = image.unwrap();
        let labels: Vec<i32> = (0..=expected.len() as i32).collect();
        assert_eq!(image.labels(), labels);
        for (i, (found, wanted)) in volumes(&image).iter().zip(expected).enumerate() {
            assert!(
                (found / wanted - 1.0).abs() < 0.02,
                "label {}: {found}, expected {wanted}",
                i + 1
            );
        }
    }

    const DIMS: [usize; 3] = [64, 64, 43];
    const SPACING: [f64; 3] = [0.5, 0.5, 0.75];

    #[test]
    fn voxels_fill_the_analytic_volumes() {
        let r = 14.0;
        let v = ball_volume(r);
        assert_volumes(ball(DIMS, SPACING, r), &[v]);
        assert_volumes(
            nested_shells(DIMS, SPACING, &[6.0, 10.0, r]),
            &[ball_volume(6.0), ball_volume(10.0) - ball_volume(6.0), v - ball_volume(10.0)],
        );
        assert_volumes(torus(DIMS, SPACING, 10.0, 4.0), &[torus_volume(10.0, 4.0)]);
        assert_volumes(three_labels_in_a_line(DIMS, SPACING, r), &[v / 3.0; 3]);
        assert_volumes(four_labels_at_a_point([80; 3], [0.4, 0.41, 0.39], r), &[v / 4.0; 4]);
        assert_volumes(eight_labels_at_a_point([64; 3], [0.5; 3], r), &[v / 8.0; 8]);
        assert_volumes(thin_sheet(DIMS, SPACING, 20.0, 2.25), &[900.0]);
    }

    #[test]
    fn the_grid_is_centred() {
        let image = ball([4, 5, 6], [1.0, 2.0, 3.0], 1.0).unwrap();
        assert_eq!(image.frame().to_world(DVec3::new(1.5, 2.0, 2.5)), DVec3::ZERO);
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(ball([0, 4, 4], [1.0; 3], 1.0).is_err());
        assert!(ball([4; 3], [0.0; 3], 1.0).is_err());
        assert!(nested_shells([4; 3], [1.0; 3], &[2.0, 1.0]).is_err());
        assert!(cubes(usize::MAX, 2, |_| 1).is_err());
        assert!(helical_tube([64, 0, 64], 20.0, 4.0).is_err());
        let message = |image: Result<LabelImage>| image.unwrap_err().to_string();
        assert_eq!(
            message(cubes(2, 0, |_| 1)),
            "cubes must have a voxel along each axis at least, got 0"
        );
        assert_eq!(
            message(helical_tube([64, 64, 16], 20.0, 4.0)),
            "a helical tube needs more than 16 voxels along z, got 16"
        );
        for radius in [-0.5, 31.5, f64::NAN] {
            assert_eq!(
                message(helical_tube([64, 80, 64], radius, 4.0)),
                format!(
                    "the radius of a helical tube must lie in 0 to 31 in [64, 80, 64] voxels, got \
                     {radius}"
                )
            );
        }
        for turns in [0.0, -1.0, 48.5, f64::NAN] {
            assert_eq!(
                message(helical_tube([64; 3], 20.0, turns)),
                format!("the turns of a helical tube must be above 0 and at most 48, got {turns}")
            );
        }
    }

    /// At the limits of what is allowed no index is out of range, and the tube goes through all
    /// layers but the margins'.
    #[test]
    fn tubes_fit_their_grid() {
        for (dims, radius, turns) in
            [([64, 80, 64], 31.0, 4.0), ([5, 4, 17], 1.0, 1.0), ([9, 9, 40], 0.0, 24.0)]
        {
            let image = helical_tube(dims, radius, turns).unwrap();
            let mut layers =
                image.ids().chunks(dims[0] * dims[1]).map(|layer| layer.iter().any(|&id| id != 0));
            assert!(
                (0..dims[2]).all(|k| layers.next() == Some((7..=dims[2] - 8).contains(&k))),
                "{dims:?}"
            );
        }
    }
}
