//! Smoothed labels, for coarse segmentations: the indicator of each label convolved with a
//! Gaussian.
//!
//! **The Gaussian** has the same standard deviation, in voxels, along each axis of the image, and
//! so a longer one in the world where voxels are longer: the steps of a segmentation are one voxel
//! high along each axis. It is cut off at three times that. Beyond the image its outermost voxels
//! go on, as in the unsmoothed model, so that objects end at the border at right angles.
//!
//! **No voxel centre changes hands.** Smoothing alone rounds off what is thinner than about the
//! deviation, and takes all of a small component. So the *lead* of a voxel's own label (its share
//! less the largest other one) is held at
//!
//! > max(least, min(1, -2 lead)).
//!
//! That is done by mixing in the unsmoothed indicator, whose lead is 1, as far as needed. Where
//! smoothing would move the surface just past a voxel centre, as on slopes, it is held back at the
//! centre: `min` is small. Where it would move it far, as into a corner or across what is much
//! thinner than the deviation, the voxel gets about the lead that its neighbours on the other side
//! keep, which puts the surface between them about where the unsmoothed one is. In *thin* places
//! `min` is large, for the same reason: where neither the voxel nor one beside it is interior,
//! that is, has its label on the other side of all six faces. Sheets, lines and blocks of one or
//! two voxels are thin all over. No half-space is thin anywhere, whatever its slope: from one of
//! its voxels go a step inwards along the axis that its normal is nearest to; a step back outwards
//! along any axis leads no farther out than the first voxel.
//!
//! As each voxel keeps its label, all of the following holds whatever the deviation: the labels at
//! the voxel centres are those of the image; every component keeps them all; mixed cells are where
//! they were.
//!
//! **Volumes** are not restored by weights. A surface of principal radii R1 and R2 moves inwards by
//! about half of the variance times 1/R1 + 1/R2.
//!
//! Cost: per voxel beside an interface a look at the runs of labels in the rows around it; about
//! half a microsecond at a deviation of 1, growing with about its square.

use crate::image::LabelImage;

/// Where the Gaussian ends, in standard deviations.
const CUT_OFF: f64 = 3.0;

/// Least lead of a voxel's own label; that of a flat interface some hundredths of the deviation
/// away from the voxel's centre.
const MIN_LEAD: f32 = 0.05;

/// The same in thin places: about the lead that the voxels beside sheets, lines and blocks of one
/// or two voxels keep, for all deviations: from 0.5 (a sheet, 1) to 0.85 (a block, 2).
const MIN_LEAD_THIN: f32 = 0.75;

/// Part of a voxel that a label has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Share {
    pub(crate) id: u16,
    pub(crate) value: f32,
}

/// An image's labels, smoothed.
pub(crate) struct Smoothing<'a> {
    image: &'a LabelImage,
    /// The Gaussian's values at distances 0, 1, ... in voxels, of sum 1 over both sides.
    kernel: Vec<f32>,
    /// Sums of the Gaussian's values, from one end on: element n is that of the first n.
    sums: Vec<f32>,
}

impl<'a> Smoothing<'a> {
    /// `sigma`: the standard deviation in voxels; above 0.
    pub(crate) fn new(image: &'a LabelImage, sigma: f64) -> Self {
        let radius = (CUT_OFF * sigma).ceil() as usize;
        let values: Vec<f64> =
            (0..=radius).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
        let sum = 2.0 * values.iter().sum::<f64>() - values[0];
        let kernel: Vec<f32> = values.iter().map(|v| (v / sum) as f32).collect();
        let mut sums = vec![0.0];
        for n in 0..=2 * radius {
            sums.push(sums[n] + kernel[n.abs_diff(radius)]);
        }
        Self { image, kernel, sums }
    }

    /// The shares of voxel number `voxel`, whose label is `own`, in no particular order.
    pub(crate) fn shares(&self, voxel: usize, own: u16, shares: &mut Vec<Share>) {
        let [nx, ny, nz] = self.image.dims();
        let (x, y, z) = (voxel % nx, voxel / nx % ny, voxel / (nx * ny));
        let radius = self.kernel.len() - 1;
        let steps = || -(radius as isize)..=radius as isize;
        let weight = |d: isize| self.kernel[d.unsigned_abs()];
        let clamped = |c: usize, d: isize, n: usize| c.saturating_add_signed(d).min(n - 1);
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(nx - 1));
        for dz in steps() {
            for dy in steps() {
                let start = nx * (clamped(y, dy, ny) + ny * clamped(z, dz, nz));
                let row = &self.image.ids()[start + left..=start + right];
                let part = weight(dy) * weight(dz);
                // Run by run. What lies beyond the image counts to the row's ends.
                let (mut at, mut before) = (0, 0.0);
                while at < row.len() {
                    let id = row[at];
                    at += row[at..].iter().take_while(|&&other| other == id).count();
                    let up_to =
                        if at == row.len() { 1.0 } else { self.sums[left + at + radius - x] };
                    add(shares, id, part * (up_to - before));
                    before = up_to;
                }
            }
        }
        keep_lead(own, if self.is_thin([x, y, z], own) { MIN_LEAD_THIN } else { MIN_LEAD }, shares);
    }

    /// Whether neither the voxel `at` nor a neighbour across a face is interior to the label `own`
    /// of both.
    fn is_thin(&self, at: [usize; 3], own: u16) -> bool {
        let dims = self.image.dims();
        let is_own = |at: [isize; 3]| {
            // Objects go on beyond the image.
            let [x, y, z] = [0, 1, 2].map(|a| at[a].clamp(0, dims[a] as isize - 1) as usize);
            self.image.ids()[x + dims[0] * (y + dims[1] * z)] == own
        };
        let beside = |at: [isize; 3], face: usize| {
            let step = if face < 3 { 1 } else { -1 };
            [0, 1, 2].map(|a| if a == face % 3 { at[a] + step } else { at[a] })
        };
        let is_interior =
            |at: [isize; 3]| is_own(at) && (0..6).all(|face| is_own(beside(at, face)));
        let at = at.map(|c| c as isize);
        !is_interior(at) && !(0..6).any(|face| is_interior(beside(at, face)))
    }
}

fn add(shares: &mut Vec<Share>, id: u16, value: f32) {
    match shares.iter_mut().find(|share| share.id == id) {
        Some(share) => share.value += value,
        None => shares.push(Share { id, value }),
    }
}

/// Gives the label `own`, which has a share, the lead that it needs, at least `min`.
fn keep_lead(own: u16, min: f32, shares: &mut [Share]) {
    let largest = |is_own: bool| {
        shares
            .iter()
            .filter(|share| (share.id == own) == is_own)
            .fold(0.0_f32, |largest, share| largest.max(share.value))
    };
    let lead = largest(true) - largest(false);
    let needed = (-2.0 * lead).clamp(min, 1.0);
    if lead < needed {
        let indicator = (needed - lead) / (1.0 - lead);
        for share in shares {
            share.value *= 1.0 - indicator;
            if share.id == own {
                share.value += indicator;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Frame;

    fn smoothed(image: &LabelImage, sigma: f64, voxel: usize) -> Vec<Share> {
        let mut shares = Vec::new();
        Smoothing::new(image, sigma).shares(voxel, image.ids()[voxel], &mut shares);
        shares.sort_by_key(|share| share.id);
        shares
    }

    /// By definition: sums over all voxels around.
    #[test]
    fn shares_are_those_of_the_convolution() {
        let dims = [9, 8, 7];
        let ids: Vec<u16> = (0..dims.iter().product::<usize>())
            .map(|n| u16::from(n % 9 > 3) + u16::from(n > 200))
            .collect();
        let image = LabelImage::from_ids(
            dims,
            Frame::axis_aligned([1.0, 2.0, 3.0]).unwrap(),
            ids,
            vec![0, 1, 2],
        )
        .unwrap();
        let sigma = 0.9;
        for voxel in 0..image.ids().len() {
            let at = [voxel % 9, voxel / 9 % 8, voxel / 72].map(|c| c as i64);
            let (mut sums, mut all) = ([0.0; 3], 0.0);
            for n in 0..343 {
                let d = [n % 7 - 3, n / 7 % 7 - 3, n / 49 - 3_i64];
                let weight =
                    (-0.5 * d.map(|d| (d * d) as f64).iter().sum::<f64>() / (sigma * sigma)).exp();
                let to = [0, 1, 2].map(|a| (at[a] + d[a]).clamp(0, dims[a] as i64 - 1) as usize);
                sums[usize::from(image.ids()[to[0] + 9 * (to[1] + 8 * to[2])])] += weight;
                all += weight;
            }
            let own = usize::from(image.ids()[voxel]);
            let other = (0..3).filter(|&n| n != own).map(|n| sums[n] / all).fold(0.0, f64::max);
            let lead = sums[own] / all - other;
            let own_at = |at: [i64; 3]| {
                let to = [0, 1, 2].map(|a| at[a].clamp(0, dims[a] as i64 - 1) as usize);
                usize::from(image.ids()[to[0] + 9 * (to[1] + 8 * to[2])]) == own
            };
            let faces = |at: [i64; 3]| {
                (0..6).map(move |face| {
                    [0, 1, 2].map(|a| at[a] + i64::from(face == a) - i64::from(face == a + 3))
                })
            };
            let is_interior = |at: [i64; 3]| own_at(at) && faces(at).all(own_at);
            let thick = is_interior(at) || faces(at).any(is_interior);
            let min = if thick { MIN_LEAD } else { MIN_LEAD_THIN };
            let needed = lead.max((-2.0 * lead).clamp(f64::from(min), 1.0));
            let indicator = (needed - lead) / (1.0 - lead).max(1e-9);
            for share in smoothed(&image, sigma, voxel) {
                let n = usize::from(share.id);
                let expected =
                    sums[n] / all * (1.0 - indicator) + if n == own { indicator } else { 0.0 };
                assert!(
                    (f64::from(share.value) - expected).abs() < 1e-5,
                    "voxel {voxel}: {share:?}, {expected}"
                );
            }
        }
    }

    /// A single voxel, one in a sheet of one, and one in a sheet of three: what is thin leads by
    /// 3/4 at least, and else by twice what it would lack.
    #[test]
    fn thin_parts_keep_a_lead() {
        let dims = [13, 13, 13];
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let centre = 6 + 13 * (6 + 13 * 6);
        for (thickness, sigma, expected) in
            [(1, 1.0, 0.75), (1, 2.0, 1.0), (0, 1.0, 1.0), (3, 3.0, 0.46), (3, 0.5, 0.995)]
        {
            let is_in = |n: usize| {
                if thickness == 0 { n == centre } else { (n / 169).abs_diff(6) <= thickness / 2 }
            };
            let ids = (0..13 * 13 * 13).map(|n| u16::from(is_in(n))).collect();
            let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1]).unwrap();
            let shares = smoothed(&image, sigma, centre);
            let lead = shares[1].value - shares[0].value;
            assert!((lead - expected).abs() < 0.01, "{lead} {shares:?}");
        }
    }
}
