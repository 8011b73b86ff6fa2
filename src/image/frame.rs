//! The place of a voxel grid in the world, and what the world's axes mean.
//!
//! world = origin + direction * (index .* spacing); the origin is the centre of voxel (0, 0, 0).

use glam::{DMat3, DVec3};

use crate::{Error, Result};

/// What the axes of world coordinates mean in the patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorldAxes {
    /// Left, posterior, superior: DICOM, ITK.
    Lps,
    /// Right, anterior, superior: NIfTI, 3D Slicer.
    Ras,
    /// Left, anterior, superior.
    Las,
}

impl WorldAxes {
    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lps => "LPS",
            Self::Ras => "RAS",
            Self::Las => "LAS",
        }
    }

    /// Signs of the axes relative to LPS.
    pub(crate) fn signs(self) -> DVec3 {
        match self {
            Self::Lps => DVec3::new(1.0, 1.0, 1.0),
            Self::Ras => DVec3::new(-1.0, -1.0, 1.0),
            Self::Las => DVec3::new(1.0, -1.0, 1.0),
        }
    }
}

/// How far a direction matrix may be from orthonormal before it counts as shear. Headers store
/// single precision and rounded decimals.
const ORTHONORMAL_TOLERANCE: f64 = 1e-3;

/// The spacings that are taken, in world units. Inside of these bounds, and the two below, squared
/// radii fit the kernel's single precision, no product of the exact predicates over- or underflows,
/// and the parts of a voxel that the oracle tells apart differ in their coordinates
/// (`tests/frames.rs`).
const SPACINGS: [f64; 2] = [1e-12, 1e9];

/// Spacings may differ by this factor.
const MAX_RATIO: f64 = 1e5;

/// How far the origin may be from that of the world, in voxels of the smallest spacing.
const MAX_DISTANCE: f64 = 1e9;

/// Origin, spacing and direction of a voxel grid. The direction is orthonormal: a rotation, or a
/// rotation and a reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    origin: DVec3,
    spacing: DVec3,
    direction: DMat3,
}

impl Frame {
    /// A frame with axes along the world's axes and the origin at (0, 0, 0).
    ///
    /// # Errors
    /// As [`Frame::new`].
    pub fn axis_aligned(spacing: [f64; 3]) -> Result<Self> {
        Self::new([0.0; 3], spacing, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    }

    /// `direction[k]` is the world direction of image axis `k` (a column of the direction matrix).
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] when a value is not finite, the axes are not orthonormal
    /// (sheared), a spacing does not lie between 1e-12 and 1e9, spacings differ by more than a
    /// factor of 1e5, or the origin is more than 1e9 of the smallest spacing away.
    pub fn new(origin: [f64; 3], spacing: [f64; 3], direction: [[f64; 3]; 3]) -> Result<Self> {
        for (axis, &s) in spacing.iter().enumerate() {
            if !(s.is_finite() && s > 0.0) {
                return Err(Error::InvalidArgument(format!(
                    "spacing of axis {axis} must be a finite number above 0, got {s}"
                )));
            }
        }
        let [low, high] = SPACINGS;
        if let Some(axis) = spacing.iter().position(|s| !(low..=high).contains(s)) {
            return Err(Error::InvalidArgument(format!(
                "spacing of axis {axis} must lie between {low:e} and {high:e}, got {:e}: take \
                 another unit of length",
                spacing[axis]
            )));
        }
        let smallest = spacing.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = spacing.iter().copied().fold(0.0, f64::max);
        if largest / smallest > MAX_RATIO {
            return Err(Error::InvalidArgument(format!(
                "spacings {spacing:?} differ by more than a factor of {MAX_RATIO:e}: resample the \
                 image"
            )));
        }
        if let Some(x) = origin.iter().chain(direction.iter().flatten()).find(|x| !x.is_finite()) {
            return Err(Error::InvalidArgument(format!(
                "origin and direction must be finite, got {x}"
            )));
        }
        if let Some(x) = origin.iter().find(|x| x.abs() > MAX_DISTANCE * smallest) {
            return Err(Error::InvalidArgument(format!(
                "the origin is more than {MAX_DISTANCE:e} voxels away from that of the world, at \
                 {x:e}: move the image"
            )));
        }
        let direction = DMat3::from_cols_array_2d(&direction);
        if skew(direction) > ORTHONORMAL_TOLERANCE {
            return Err(Error::InvalidArgument(format!(
                "image axes must be orthonormal (no shear, no scale), got direction columns {:?} \
                 {:?} {:?}",
                direction.x_axis.to_array(),
                direction.y_axis.to_array(),
                direction.z_axis.to_array()
            )));
        }
        Ok(Self {
            origin: DVec3::from(origin),
            spacing: DVec3::from(spacing),
            direction: orthonormalized(direction),
        })
    }

    /// The same place with the world's axes turned around where `signs` is -1; exactly.
    pub(crate) fn reflected(&self, signs: DVec3) -> Self {
        let direction = DMat3::from_diagonal(signs) * self.direction;
        Self { origin: signs * self.origin, spacing: self.spacing, direction }
    }

    /// The frame of the parts of the voxels, so many along each axis.
    pub(crate) fn divided(&self, parts: [usize; 3]) -> Self {
        let parts = DVec3::from(parts.map(|n| n as f64));
        let origin = self.to_world(0.5 * (parts.recip() - 1.0));
        Self { origin, spacing: self.spacing / parts, direction: self.direction }
    }

    /// World position of the centre of voxel (0, 0, 0).
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Distance between voxel centres along each image axis.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// Columns are the world directions of the image axes.
    pub fn direction(&self) -> DMat3 {
        self.direction
    }

    /// World position of a continuous index.
    #[inline]
    pub fn to_world(&self, index: DVec3) -> DVec3 {
        self.origin + self.direction * (index * self.spacing)
    }

    /// Continuous index of a world position.
    #[inline]
    pub fn to_index(&self, world: DVec3) -> DVec3 {
        self.direction.transpose() * (world - self.origin) / self.spacing
    }
}

/// Directions that headers have rounded, to single precision as a rule, so by 6e-8, are multiples
/// of this before they are orthonormalized: programs that read the same header compute them with
/// other errors in the last digit, some 1e-16, and are to have the same mesh.
const DIRECTION_STEP: f64 = 1.0 / (1_u64 << 36) as f64;

/// Directions that are orthonormal to this were not rounded.
const EXACT: f64 = 1e-12;

/// How far a matrix is from orthonormal.
fn skew(m: DMat3) -> f64 {
    let gram = m.transpose() * m;
    (gram - DMat3::IDENTITY).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()))
}

/// Removes the rounding of headers: signed axis permutations become exact, others are
/// orthonormalized (Gram-Schmidt).
fn orthonormalized(m: DMat3) -> DMat3 {
    let rounded = DMat3::from_cols(m.x_axis.round(), m.y_axis.round(), m.z_axis.round());
    let off = (m - rounded).to_cols_array().iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if off < 1e-9 {
        return rounded;
    }
    let on_step = |x: f64| (x / DIRECTION_STEP).round() * DIRECTION_STEP;
    let m =
        if skew(m) > EXACT { DMat3::from_cols_array(&m.to_cols_array().map(on_step)) } else { m };
    let x = m.x_axis.normalize();
    let y = (m.y_axis - x * x.dot(m.y_axis)).normalize();
    let z = x.cross(y);
    let z = if z.dot(m.z_axis) < 0.0 { -z } else { z };
    DMat3::from_cols(x, y, z)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    #[test]
    fn the_origin_is_the_centre_of_the_first_voxel() {
        let frame = Frame::new(
            [10.0, 20.0, 30.0],
            [1.0, 2.0, 3.0],
            [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        )
        .unwrap();
        assert_eq!(frame.to_world(DVec3::ZERO), DVec3::new(10.0, 20.0, 30.0));
        assert_eq!(frame.to_world(DVec3::X), DVec3::new(10.0, 20.0, 31.0));
        assert_eq!(frame.to_world(DVec3::Y), DVec3::new(8.0, 20.0, 30.0));
        assert_eq!(frame.to_index(DVec3::new(8.0, 23.0, 31.0)), DVec3::ONE);
    }

    #[test]
    fn a_reflection_is_a_direction_and_shear_is_not() {
        let mut reflected = IDENTITY;
        reflected[1][1] = -1.0;
        assert_eq!(
            Frame::new([0.0; 3], [1.0; 3], reflected).unwrap().direction().determinant(),
            -1.0
        );
        let mut sheared = IDENTITY;
        sheared[1][0] = 0.01;
        assert!(
            Frame::new([0.0; 3], [1.0; 3], sheared).unwrap_err().to_string().contains("no shear")
        );
        assert!(Frame::new([0.0; 3], [1.0; 3], [[1.0, 0.0, 0.0]; 3]).is_err());
    }

    #[test]
    fn refuses_what_is_not_a_place() {
        for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let message = Frame::axis_aligned([1.0, spacing, 1.0]).unwrap_err().to_string();
            assert_eq!(
                message,
                format!("spacing of axis 1 must be a finite number above 0, got {spacing}")
            );
        }
        assert!(Frame::new([f64::NAN, 0.0, 0.0], [1.0; 3], IDENTITY).is_err());
        assert!(
            Frame::new([0.0; 3], [1.0; 3], [[f64::INFINITY, 0.0, 0.0], IDENTITY[1], IDENTITY[2]])
                .is_err()
        );
    }

    #[test]
    fn rounding_of_headers_is_removed() {
        let (sin, cos) = (0.7_f64.sin() as f32 as f64, 0.7_f64.cos() as f32 as f64);
        let frame = Frame::new(
            [0.0; 3],
            [1.0; 3],
            [[cos, sin, 0.0], [-sin, cos + 1e-5, 0.0], [0.0, 1e-5, 1.0]],
        )
        .unwrap();
        let gram = frame.direction().transpose() * frame.direction();
        assert!((gram - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-15));
        let exact =
            Frame::new([0.0; 3], [1.0; 3], [[1.0, 1e-12, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
                .unwrap();
        assert_eq!(exact.direction(), DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)));
    }

    proptest! {
        #[test]
        fn last_digits_of_directions_do_not_count(
            angles in prop::array::uniform3(-3.0..3.0_f64),
            mirror in any::<bool>(),
        ) {
            let rotation = DMat3::from_rotation_x(angles[0])
                * DMat3::from_rotation_y(angles[1])
                * DMat3::from_rotation_z(angles[2]);
            let z_axis = if mirror { -rotation.z_axis } else { rotation.z_axis };
            // As a header has them.
            let stored = DMat3::from_cols(rotation.x_axis, rotation.y_axis, z_axis)
                .to_cols_array_2d()
                .map(|column| column.map(|x| f64::from(x as f32)));
            let other = stored.map(|column| {
                let length = DVec3::from(column).length();
                column.map(|x| x / length)
            });
            // Between two steps the last digit decides.
            let is_between = |x: f64| ((x / DIRECTION_STEP).fract().abs() - 0.5).abs() < 1e-3;
            prop_assume!(!other.iter().flatten().any(|&x| is_between(x)));
            let again = other.map(|column| {
                let length = column.iter().rev().map(|x| x * x).sum::<f64>().sqrt();
                column.map(|x| x / length)
            });
            let frame = |direction| Frame::new([5.0, 6.0, 7.0], [1.0, 2.0, 3.0], direction);
            let frame = frame(other).unwrap();
            prop_assert_eq!(frame, Frame::new([5.0, 6.0, 7.0], [1.0, 2.0, 3.0], again).unwrap());
            let there = frame.reflected(DVec3::new(-1.0, -1.0, 1.0));
            prop_assert_eq!(there.reflected(DVec3::new(-1.0, -1.0, 1.0)), frame);
        }

        #[test]
        fn world_and_index_are_inverse(
            angles in prop::array::uniform3(-3.0..3.0_f64),
            spacing in prop::array::uniform3(0.1..5.0_f64),
            origin in prop::array::uniform3(-500.0..500.0_f64),
            index in prop::array::uniform3(-10.0..600.0_f64),
            mirror in any::<bool>(),
        ) {
            let rotation = DMat3::from_rotation_x(angles[0])
                * DMat3::from_rotation_y(angles[1])
                * DMat3::from_rotation_z(angles[2]);
            let mut direction = rotation.to_cols_array_2d();
            if mirror {
                direction[2] = direction[2].map(|x| -x);
            }
            let frame = Frame::new(origin, spacing, direction).unwrap();
            let index = DVec3::from(index);
            prop_assert!((frame.to_index(frame.to_world(index)) - index).length() < 1e-9);
        }
    }
}
