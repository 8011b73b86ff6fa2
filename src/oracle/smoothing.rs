//! Smoothed labels, for coarse segmentations: the indicator of each label convolved with a Gaussian.
//!
//! **The Gaussian** has the same standard deviation, in voxels, along each axis of the image, and so a longer one in the world where voxels are longer: the steps of a segmentation are one
//! voxel high along each axis. It is cut off at three times that. Beyond the image its outermost voxels go on, as in the unsmoothed model, so that objects end at the border at right angles.
//!
//! **No voxel centre changes hands.** Smoothing alone rounds off what is thinner than about the deviation, and takes all of a small component. So the *lead* of a voxel's own label (its
//! share less the largest other one) is held at
//!
//! > max(least, min(1, -2 lead)).
//!
//! That is done by mixing in the unsmoothed indicator, whose lead is 1, as far as needed. Where smoothing would move the surface just past a voxel centre, as on slopes, the surface is held back at the
//! centre: `least` is small. Where it would move it far, as across a sheet of one voxel or into a corner, the voxel gets about the lead that its neighbours on the other side keep, which puts the
//! surface between them about where the unsmoothed one is. As each voxel keeps its label, all of the following holds whatever the deviation: the labels at the voxel centres are those of the
//! image; every component keeps them all; mixed cells are where they were.
//!
//! **Volumes** are not restored by weights. A surface of principal radii R1 and R2 moves inwards by about half of the variance times 1/R1 + 1/R2.
//!
//! Cost: per voxel beside an interface a look at the rows around it, most of which have one label; some hundred nanoseconds at a deviation of 1, growing with its square.

use super::mixtures::Share;
use crate::image::LabelImage;

/// Where the Gaussian ends, in standard deviations.
const CUT_OFF: f64 = 3.0;

/// Least lead of a voxel's own label; that of a flat interface some hundredths of the deviation away from the voxel's centre.
const LEAST_LEAD: f32 = 0.05;

/// An image's labels, smoothed.
pub(super) struct Smoothing<'a> {
    image: &'a LabelImage,
    /// The Gaussian's values at distances 0, 1, ... in voxels, of sum 1 over both sides.
    kernel: Vec<f32>,
}

impl<'a> Smoothing<'a> {
    /// `sigma`: the standard deviation in voxels; above 0.
    pub(super) fn new(image: &'a LabelImage, sigma: f64) -> Self {
        let radius = (CUT_OFF * sigma).ceil() as usize;
        let values: Vec<f64> = (0..=radius).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
        let sum = 2.0 * values.iter().sum::<f64>() - values[0];
        Self { image, kernel: values.iter().map(|v| (v / sum) as f32).collect() }
    }

    /// The shares of voxel number `voxel`, whose label is `own`, in no particular order.
    pub(super) fn shares(&self, voxel: usize, own: u16, shares: &mut Vec<Share>) {
        let [nx, ny, nz] = self.image.dims();
        let (x, y, z) = (voxel % nx, voxel / nx % ny, voxel / (nx * ny));
        let radius = self.kernel.len() - 1;
        let steps = || -(radius as isize)..=radius as isize;
        let weight = |d: isize| self.kernel[d.unsigned_abs()];
        let clamped = |c: usize, d: isize, n: usize| c.saturating_add_signed(d).min(n - 1);
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(nx - 1));
        for dz in steps() {
            for dy in steps() {
                let row = &self.image.ids()[nx * (clamped(y, dy, ny) + ny * clamped(z, dz, nz))..][..nx];
                let part = weight(dy) * weight(dz);
                if row[left..=right].iter().all(|&id| id == row[left]) {
                    add(shares, row[left], part);
                } else {
                    steps().for_each(|dx| add(shares, row[clamped(x, dx, nx)], part * weight(dx)));
                }
            }
        }
        keep_lead(own, shares);
    }
}

fn add(shares: &mut Vec<Share>, id: u16, value: f32) {
    match shares.iter_mut().find(|share| share.id == id) {
        Some(share) => share.value += value,
        None => shares.push(Share { id, value }),
    }
}

/// Gives the label `own`, which has a share, the lead that it needs.
fn keep_lead(own: u16, shares: &mut [Share]) {
    let largest = |is_own: bool| {
        shares
            .iter()
            .filter(|share| (share.id == own) == is_own)
            .fold(0.0_f32, |largest, share| largest.max(share.value))
    };
    let lead = largest(true) - largest(false);
    let needed = (-2.0 * lead).clamp(LEAST_LEAD, 1.0);
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
        let ids: Vec<u16> =
            (0..dims.iter().product::<usize>()).map(|n| u16::from(n % 9 > 3) + u16::from(n > 200)).collect();
        let image =
            LabelImage::from_ids(dims, Frame::axis_aligned([1.0, 2.0, 3.0]).unwrap(), ids, vec![0, 1, 2]).unwrap();
        let sigma = 0.9;
        for voxel in 0..image.ids().len() {
            let at = [voxel % 9, voxel / 9 % 8, voxel / 72].map(|c| c as i64);
            let (mut sums, mut all) = ([0.0; 3], 0.0);
            for n in 0..343 {
                let d = [n % 7 - 3, n / 7 % 7 - 3, n / 49 - 3_i64];
                let weight = (-0.5 * d.map(|d| (d * d) as f64).iter().sum::<f64>() / (sigma * sigma)).exp();
                let to = [0, 1, 2].map(|a| (at[a] + d[a]).clamp(0, dims[a] as i64 - 1) as usize);
                sums[usize::from(image.ids()[to[0] + 9 * (to[1] + 8 * to[2])])] += weight;
                all += weight;
            }
            let own = usize::from(image.ids()[voxel]);
            let other = (0..3).filter(|&n| n != own).map(|n| sums[n] / all).fold(0.0, f64::max);
            let lead = sums[own] / all - other;
            let needed = lead.max((-2.0 * lead).clamp(f64::from(LEAST_LEAD), 1.0));
            let indicator = (needed - lead) / (1.0 - lead).max(1e-9);
            for share in smoothed(&image, sigma, voxel) {
                let n = usize::from(share.id);
                let expected = sums[n] / all * (1.0 - indicator) + if n == own { indicator } else { 0.0 };
                assert!((f64::from(share.value) - expected).abs() < 1e-5, "voxel {voxel}: {share:?}, {expected}");
            }
        }
    }

    /// A single voxel, and one in a sheet: their label leads by twice what it would lack, up to 1.
    #[test]
    fn thin_parts_keep_a_lead() {
        let dims = [13, 13, 13];
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let centre = 6 + 13 * (6 + 13 * 6);
        for (is_sheet, sigma, expected) in [(true, 1.0, 0.40), (true, 2.0, 1.0), (false, 1.0, 1.0)] {
            let ids = (0..13 * 13 * 13).map(|n| u16::from(if is_sheet { n / 169 == 6 } else { n == centre })).collect();
            let image = LabelImage::from_ids(dims, frame, ids, vec![0, 1]).unwrap();
            let shares = smoothed(&image, sigma, centre);
            let lead = shares[1].value - shares[0].value;
            assert!((lead - expected).abs() < 0.01, "{lead} {shares:?}");
        }
    }
}
