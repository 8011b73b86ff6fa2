//! The smooth model of images that know more than the labels of their voxels: what a cell of
//! several labels has at its corners.
//!
//! A field gives each voxel centre a value for some labels; between the centres values are
//! interpolated trilinearly, and the label with the largest one wins, the smaller id on a tie. A
//! cell's [`Rivals`] are the labels that may win in it, with their values at its eight corners. Two
//! kinds of fields:
//! - [`Intensities`], of a gray image. Between isovalues v1 < v2 < ... the labels follow each other
//!   with the intensity x. The values 0, x - v1, (x - v1) + (x - v2), ... change the lead at the
//!   isovalues, one after the other: the largest one is that of the interval that holds x. So
//!   interfaces are the trilinear isosurfaces themselves.
//! - [`Mixtures`], of probability maps and of smoothed labels.
//!
//! **A cell whose corners all have label a is uniform**, on which rings and distance bound rely. At
//! each corner the value of a is at least that of any other label b. Interpolation is a mean whose
//! weights are not negative, so that holds at each point of the cell. The two are equal only where
//! they tie at all corners that count there; a won these because its id is smaller, and so wins the
//! point, too. (Two intervals of intensity may have the same label, with another one between: where
//! intensity leaps over that one from each voxel to the next, the cell counts as uniform.)
//!
//! The values ask for one surface, so there are no weights of labels.
//!
//! **Beyond the image**, where a smooth border is asked for, there is one layer of background. At
//! its centres the background has what the nearest voxel's label is ahead of it by, and all other
//! labels have 0. So what is largest in a voxel at the border changes hands with the background
//! halfway, as it does in a segmentation.

use rayon::prelude::*;

use super::indicator::{descent_along, parts};
use super::mixtures::{MAX_SHARES, Mixtures, Source};
use super::smoothing::Smoothing;
use super::voxel::Voxel;
use crate::image::bricks::Bricks;
use crate::image::gray::MAX_ISOVALUES;
use crate::image::region::Region;
use crate::image::{self, LabelImage};
use crate::memory::zeroed_huge;
use crate::{Error, Result};

/// Values at the voxel centres of a region.
#[derive(Clone, Debug)]
pub(crate) enum Field {
    Intensities(Intensities),
    Mixtures(Mixtures),
}

/// Most labels that may win in one cell.
pub(crate) const MAX_RIVALS: usize =
    if MAX_ISOVALUES + 2 > 8 * MAX_SHARES { MAX_ISOVALUES + 2 } else { 8 * MAX_SHARES };

impl Field {
    /// The field of an image that has one, or of a segmentation whose labels are smoothed over
    /// `sigma` voxels; `None` for other segmentations. `voxels` are the region's records.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an image with a field that is to be smoothed;
    /// [`Error::OutOfMemory`]; whatever `check` returns.
    pub(crate) fn new(
        image: &LabelImage,
        sigma: Option<f64>,
        region: &Region,
        voxels: &[Voxel],
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Option<Self>> {
        let mixtures = |source: &Source<'_>| Mixtures::new(source, image, region, voxels, check);
        Ok(match (image.field(), sigma) {
            (None, None) => None,
            (None, Some(sigma)) => {
                Some(Self::Mixtures(mixtures(&Source::Smoothed(Smoothing::new(image, sigma)))?))
            }
            (Some(_), Some(sigma)) => {
                return Err(Error::InvalidArgument(format!(
                    "sigma {sigma} smooths label images only, not those made of intensities or \
                     probabilities"
                )));
            }
            (Some(image::Field::Probabilities(maps)), None) => {
                Some(Self::Mixtures(mixtures(&Source::of_maps(maps, image))?))
            }
            (Some(image::Field::Intensities { voxels, isovalues, labels }), None) => {
                Some(Self::Intensities(Intensities::new(
                    image,
                    region,
                    voxels,
                    (isovalues, labels),
                    check,
                )?))
            }
        })
    }

    /// Bytes of memory held.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Intensities(field) => size_of_val(&field.voxels[..]),
            Self::Mixtures(mixtures) => mixtures.bytes(),
        }
    }

    /// The label at a point of a mixed cell.
    #[inline(never)]
    pub(crate) fn label(&self, bricks: &Bricks, cell: [usize; 3], at: [f32; 3]) -> u16 {
        self.rivals(bricks, cell).label(at)
    }

    /// The first change from the label `from` on a segment within a mixed cell: its parameter in
    /// [0, 1], to within `tolerance`, and the label past it.
    #[inline(never)]
    pub(crate) fn overtaken(
        &self,
        bricks: &Bricks,
        cell: [usize; 3],
        from: u16,
        ends: [[f32; 3]; 2],
        tolerance: f64,
    ) -> Option<(f64, u16)> {
        self.rivals(bricks, cell).overtaken(from, ends, tolerance)
    }

    /// Calls `visit` for the labels that may win in a cell, each with its values at the corners. A
    /// label may come twice.
    pub(crate) fn visit_rivals(
        &self,
        bricks: &Bricks,
        cell: [usize; 3],
        mut visit: impl FnMut(u16, &[f32; 8]),
    ) {
        let Rivals { count, ids, values } = self.rivals(bricks, cell);
        ids.iter().zip(&values).take(count).for_each(|(&id, values)| visit(id, values));
    }

    fn rivals(&self, bricks: &Bricks, [i, j, k]: [usize; 3]) -> Rivals {
        let corner = |c: usize| bricks.index(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2));
        let mut rivals = Rivals { count: 0, ids: [0; MAX_RIVALS], values: [[0.0; 8]; MAX_RIVALS] };
        match self {
            Self::Intensities(field) => {
                field.add_rivals(std::array::from_fn(|c| field.voxels[corner(c)]), &mut rivals)
            }
            Self::Mixtures(mixtures) => {
                for c in 0..8 {
                    for share in mixtures.of(corner(c)) {
                        rivals.row(share.id)[c] = share.value;
                    }
                }
            }
        }
        rivals
    }
}

/// The mark of a voxel beyond the image.
const BEYOND: f32 = f32::NAN;

/// A gray image's region.
#[derive(Clone, Debug)]
pub(crate) struct Intensities {
    /// In the bricked layout; [`BEYOND`] beyond the image.
    voxels: Vec<f32>,
    /// Those between different labels, each lowered to the next smaller number: x is above that
    /// where it reaches the isovalue.
    isovalues: Vec<f32>,
    /// The dense ids below the first of `isovalues` and above each.
    ids: Vec<u16>,
}

impl Intensities {
    /// # Errors
    /// [`Error::OutOfMemory`]; [`Error::Internal`] for a label that the image does not have;
    /// whatever `check` returns.
    fn new(
        image: &LabelImage,
        region: &Region,
        voxels: &[f32],
        (isovalues, labels): (&[f32], &[i32]),
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let bricks = Bricks::new(region.dims);
        let [nx, ny, nz] = image.dims();
        let mut bricked: Vec<f32> = zeroed_huge(bricks.len(), "intensities of the region")?;
        bricked.par_chunks_mut(bricks.layer()).enumerate().try_for_each(|(layer, out)| {
            check()?;
            for (n, slot) in out.iter_mut().enumerate() {
                let at = bricks.voxel(layer * bricks.layer() + n);
                let place = |a: usize, n: usize| region.place(at, a, n);
                *slot = match (place(0, nx), place(1, ny), place(2, nz)) {
                    (Some(x), Some(y), Some(z)) => voxels[x + nx * (y + ny * z)],
                    _ => BEYOND,
                };
            }
            Ok(())
        })?;
        let id_of = |label: i32| {
            image.id_of(label).ok_or_else(|| {
                Error::Internal(format!("label {label} of an interval has no voxel"))
            })
        };
        let mut field =
            Self { voxels: bricked, isovalues: Vec::new(), ids: vec![id_of(labels[0])?] };
        for (isovalue, &label) in isovalues.iter().zip(&labels[1..]) {
            let id = id_of(label)?;
            if field.ids.last() != Some(&id) {
                field.isovalues.push(isovalue.next_down());
                field.ids.push(id);
            }
        }
        Ok(field)
    }

    /// The intervals of a cell's corners and all between, as rivals.
    fn add_rivals(&self, corners: [f32; 8], rivals: &mut Rivals) {
        if corners.iter().any(|x| x.is_nan()) {
            return self.add_rivals_at_border(corners, rivals);
        }
        let (min, max) = corners
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)));
        let first = self.isovalues.partition_point(|&v| v < min);
        let mut values = [0.0; 8];
        rivals.push(self.ids[first], values);
        for n in (first..self.isovalues.len()).take_while(|&n| self.isovalues[n] < max) {
            values = std::array::from_fn(|c| values[c] + (corners[c] - self.isovalues[n]));
            rivals.push(self.ids[n + 1], values);
        }
    }
}

impl Intensities {
    /// As [`Self::add_rivals`], in a cell that has corners beyond the image.
    #[cold]
    fn add_rivals_at_border(&self, corners: [f32; 8], rivals: &mut Rivals) {
        let inside = |c: &usize| !corners[*c].is_nan();
        // The nearest corner in the image: the one that differs along the fewest axes.
        let nearest = |c: usize| (0..8).filter(inside).min_by_key(|n| (n ^ c).count_ones());
        let lead = |x: f32| self.isovalues.iter().map(|&v| (x - v).max(0.0)).sum::<f32>();
        let beyond = std::array::from_fn(|c| match nearest(c) {
            Some(n) if n != c => lead(corners[n]),
            _ => 0.0,
        });
        rivals.push(0, beyond);
        let mut values = [0.0; 8];
        // Nowhere is the background's own interval ahead of the row above.
        if self.ids[0] != 0 {
            rivals.push(self.ids[0], values);
        }
        let max = corners.into_iter().fold(f32::NEG_INFINITY, f32::max);
        for n in (0..self.isovalues.len()).take_while(|&n| self.isovalues[n] < max) {
            let more = |c: usize| if inside(&c) { corners[c] - self.isovalues[n] } else { 0.0 };
            values = std::array::from_fn(|c| values[c] + more(c));
            rivals.push(self.ids[n + 1], values);
        }
    }
}

/// What may win in a cell. A label may be there twice, with different values.
struct Rivals {
    count: usize,
    ids: [u16; MAX_RIVALS],
    /// Of each rival, at the corners.
    values: [[f32; 8]; MAX_RIVALS],
}

impl Rivals {
    fn push(&mut self, id: u16, values: [f32; 8]) {
        (self.ids[self.count], self.values[self.count]) = (id, values);
        self.count += 1;
    }

    /// The values of a label.
    fn row(&mut self, id: u16) -> &mut [f32; 8] {
        let known = self.ids[..self.count].iter().position(|&known| known == id);
        let row = known.unwrap_or_else(|| {
            self.push(id, [0.0; 8]);
            self.count - 1
        });
        &mut self.values[row]
    }

    /// The best of the rivals that `may` tells, at a point of the cell.
    fn best(&self, at: [f32; 3], may: impl Fn(u16) -> bool) -> Option<usize> {
        let parts = parts(at);
        let value = |row: usize| {
            let w: [f32; 8] = std::array::from_fn(|c| self.values[row][c] * parts[c]);
            ((w[0] + w[4]) + (w[2] + w[6])) + ((w[1] + w[5]) + (w[3] + w[7]))
        };
        let rows = (0..self.count).filter(|&row| may(self.ids[row])).map(|row| (value(row), row));
        let ahead = |a: (f32, usize), b: (f32, usize)| {
            b.0 > a.0 || (b.0 == a.0 && self.ids[b.1] < self.ids[a.1])
        };
        rows.reduce(|a, b| if ahead(a, b) { b } else { a }).map(|(_, row)| row)
    }

    fn label(&self, at: [f32; 3]) -> u16 {
        self.best(at, |_| true).map_or(0, |row| self.ids[row])
    }

    fn overtaken(&self, from: u16, ends: [[f32; 3]; 2], tolerance: f64) -> Option<(f64, u16)> {
        let Some(leader) = self.best(ends[0], |id| id == from) else {
            // Rounding may find another label where the segment enters the cell.
            return Some((0.0, self.label(ends[0])));
        };
        let mut first: Option<(f64, u16)> = None;
        for row in (0..self.count).filter(|&row| self.ids[row] != from) {
            let lead = std::array::from_fn(|c| self.values[leader][c] - self.values[row][c]);
            if let Some(s) = descent_along(&lead, ends, tolerance)
                && first.is_none_or(|f| (s, self.ids[row]) < f)
            {
                first = Some((s, self.ids[row]));
            }
        }
        first
    }
}
