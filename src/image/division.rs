//! Long voxels, divided into parts that are nearly cubes.
//!
//! Slices may be many times thicker than voxels are wide. The smooth surface model interpolates
//! between voxel centres. Between the centres of long voxels that makes labels bulge: where two
//! labels meet on top of a third, the third one rises between them by a sixth of the voxel's side,
//! and where four meet by three tenths. In voxels of 1 x 1 x 6 these are spikes twice as high as
//! wide, which no samples a voxel's width apart can follow. So bodies touch, and have holes, where
//! their voxels do not and have none.
//!
//! In cubes such bulges are flat. So a long voxel becomes a stack of parts with its label. The
//! boundaries of labels stay where they are, and so does what is connected; the model rounds them
//! within half of the smallest side, along each axis.
//!
//! Scans and probability maps are not divided: they are what is known between voxel centres.

use std::borrow::Cow;

use rayon::prelude::*;

use super::{Frame, LabelImage, voxel_count};
use crate::memory::zeroed;
use crate::{Error, Result};

/// Added to the ratio of a side to the smallest one before it is rounded down: a ratio of 1.7 gives
/// two parts of 0.85. Below that a side is not divided. Parts shorter than the smallest side cost
/// more tets than they mend: the abdomen, with a ratio of 1.6, two fifths more for one component
/// (docs/notes/design-notes.md).
const ROUNDED_UP: f64 = 0.3;

/// Most parts of a voxel along an axis.
const MAX_PARTS: f64 = 16.0;

/// An image is not divided into more voxels than this: voxels have fewer parts then, and an image
/// that has more is left as it is.
const MAX_VOXELS: usize = 1 << 29;

impl LabelImage {
    /// Voxels along each axis once long ones are divided.
    pub(crate) fn dims_in_cubes(&self) -> [usize; 3] {
        let (dims, parts) = (self.dims(), self.parts());
        [0, 1, 2].map(|a| parts[a] * dims[a])
    }

    fn parts(&self) -> [usize; 3] {
        if self.field().is_some() { [1; 3] } else { parts(self.dims(), self.frame()) }
    }

    /// Whether parts are longer than they would be in a smaller image.
    pub(crate) fn is_too_large_for_cubes(&self) -> bool {
        self.field().is_none() && self.parts() != parts([1; 3], self.frame())
    }

    /// The image with its long voxels divided, or itself where they are nearly cubes or where
    /// labels are not all that is known.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory); what `check_memory` returns, which is told how
    /// many bytes the voxels will take; what `go_on` returns, which is asked once per plane.
    pub(crate) fn with_cubes(
        &self,
        check_memory: &dyn Fn(u64) -> Result<()>,
        go_on: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Cow<'_, Self>> {
        let parts = self.parts();
        if parts == [1; 3] {
            return Ok(Cow::Borrowed(self));
        }
        let ([nx, ny, _], dims) = (self.dims(), self.dims_in_cubes());
        let count = voxel_count(dims)?;
        check_memory((size_of::<u16>() * count) as u64)?;
        let mut ids = zeroed(count, "parts of long voxels")?;
        ids.par_chunks_mut(dims[0] * dims[1]).enumerate().try_for_each(|(z, plane)| {
            go_on()?;
            for (y, row) in plane.chunks_mut(dims[0]).enumerate() {
                let from = nx * (y / parts[1] + ny * (z / parts[2]));
                let whole = &self.ids()[from..from + nx];
                row.chunks_mut(parts[0]).zip(whole).for_each(|(row, &id)| row.fill(id));
            }
            Ok::<_, Error>(())
        })?;
        let frame = self.frame().divided(parts);
        Ok(Cow::Owned(Self::assembled(ids, self.labels().to_vec(), dims, frame)))
    }
}

/// Into how many parts the voxels of an image are divided along each axis.
fn parts(dims: [usize; 3], frame: &Frame) -> [usize; 3] {
    let spacing = frame.spacing();
    let ratios = spacing / spacing.min_element();
    let mut most = MAX_PARTS;
    loop {
        let parts =
            ratios.to_array().map(|ratio| (ratio + ROUNDED_UP).floor().clamp(1.0, most) as usize);
        let sides = dims.into_iter().zip(parts);
        let voxels = sides.fold(1_usize, |all, (n, parts)| all.saturating_mul(n * parts));
        if voxels <= MAX_VOXELS || most <= 1.0 {
            return parts;
        }
        most -= 1.0;
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::image::GrayImage;

    fn frame(spacing: [f64; 3]) -> Frame {
        Frame::new([5.0, -3.0, 2.0], spacing, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
            .unwrap()
    }

    #[test]
    fn long_sides_are_divided() {
        let of = |spacing| parts([10; 3], &frame(spacing));
        assert_eq!(of([1.0, 1.6, 1.0]), [1; 3]);
        assert_eq!(of([0.9, 0.9, 6.0]), [1, 1, 6]);
        assert_eq!(of([3.0, 1.0, 1.75]), [3, 1, 2]);
        assert_eq!(of([1.0, 1.0, 4000.0]), [1, 1, 16]);
        // Fewer where there would be too many.
        assert_eq!(parts([512, 512, 700], &frame([1.0, 1.0, 6.0])), [1, 1, 2]);
        assert_eq!(parts([2000, 2000, 1000], &frame([1.0, 1.0, 6.0])), [1; 3]);
        let small = LabelImage::from_fn([4; 3], frame([1.0, 1.0, 6.0]), |_| 1).unwrap();
        assert!(!small.is_too_large_for_cubes());
    }

    #[test]
    fn cubes_and_scans_are_left_as_they_are() {
        let cubes = LabelImage::from_fn([4; 3], frame([1.0, 1.2, 1.6]), |p| i32::from(p.x > 4.0));
        assert!(matches!(cubes.unwrap().with_cubes(&|_| Ok(()), &|| Ok(())), Ok(Cow::Borrowed(_))));
        let values = (0..64_u8).map(f32::from).collect();
        let scan = GrayImage::new([4; 3], frame([1.0, 1.0, 5.0]), values).unwrap();
        let labels = scan.label_image(&[20.0], None).unwrap();
        assert!(matches!(labels.with_cubes(&|_| Ok(()), &|| Ok(())), Ok(Cow::Borrowed(_))));
    }

    #[test]
    fn what_it_takes_is_asked_for_first() {
        let long = LabelImage::from_fn([4; 3], frame([1.0, 1.0, 5.0]), |p| i32::from(p.x > 4.0));
        let long = long.unwrap();
        let refuse = |bytes| {
            assert_eq!(bytes, 2 * 4 * 4 * 20);
            Err(Error::Cancelled)
        };
        assert!(matches!(long.with_cubes(&refuse, &|| Ok(())), Err(Error::Cancelled)));
        let stop = || Err(Error::Cancelled);
        assert!(matches!(long.with_cubes(&|_| Ok(()), &stop), Err(Error::Cancelled)));
    }

    proptest! {
        /// Each part has the label of the voxel that holds its centre, and all together the same
        /// place in the world.
        #[test]
        fn parts_are_where_their_voxel_is(
            seed in any::<u32>(),
            sides in prop::array::uniform3(1.0..7.0_f64),
            dims in prop::array::uniform3(1..6_usize),
        ) {
            let label = |p: DVec3| (p.x * 3.1 + p.y * 1.7 + p.z * 0.9 + f64::from(seed)) as i32 % 4;
            let image = LabelImage::from_fn(dims, frame(sides), label).unwrap();
            let cubes = image.with_cubes(&|_| Ok(()), &|| Ok(())).unwrap();
            let ratios = cubes.frame().spacing() / cubes.frame().spacing().min_element();
            prop_assert!(ratios.max_element() < 2.0);
            let [nx, ny, _] = cubes.dims();
            for (n, &id) in cubes.ids().iter().enumerate() {
                let at = DVec3::from([n % nx, n / nx % ny, n / (nx * ny)].map(|c| c as f64));
                let index = image.frame().to_index(cubes.frame().to_world(at)).round();
                let index = index.to_array().map(|c| c as usize);
                prop_assert_eq!(image.label_at(index), Some(cubes.labels()[usize::from(id)]));
            }
            for corner in [DVec3::splat(-0.5), DVec3::from(dims.map(|n| n as f64 - 0.5))] {
                let world = image.frame().to_world(corner);
                let index = cubes.frame().to_index(world);
                let end = DVec3::from(cubes.dims().map(|n| n as f64 - 0.5));
                let of_cubes = if corner.x < 0.0 { DVec3::splat(-0.5) } else { end };
                prop_assert!((index - of_cubes).length() < 1e-9);
            }
        }
    }
}
