//! Distances to the interfaces of a label image near the corners of its grid, where most of what is
//! asked lies: within half a voxel of an interface the eight voxels around the nearest corner tell
//! the distance, exactly. Coordinates are those of [`voxel_faces`](super::voxel_faces).
//!
//! Around a corner twelve faces meet. From a point of one octant the nearest of those on one plane,
//! line or point through the corner is as far as the point's offset from that, so seven squared
//! distances are all there are; which of them count is told by a table from the set of voxels that
//! have a label.
//!
//! Points come some at a time ([`Points`]), so that what is computed of each is vectorised, as in
//! [`star`](crate::geometry::star); only the voxels around a corner are looked up point by point.
//!
//! A memory of corners belongs to who asks; any number of threads may have one each. Some hundred
//! instructions a point.

use glam::DVec3;

use super::points::Points;
use crate::image::LabelImage;

/// The voxels around a corner of the grid, x fastest.
#[derive(Clone, Copy)]
struct Corner {
    /// The corner, in the order of cells.
    at: usize,
    /// Two labels, and the set of voxels that each has: a bit for each voxel.
    ids: [u16; 2],
    sets: [u8; 2],
    around: [u16; 8],
}

/// The last corners of the grid that distances were asked at, one of each place modulo 4: who goes
/// along an interface comes to most of them many times.
pub(crate) struct Corners<'i> {
    image: &'i LabelImage,
    spacing: DVec3,
    per_spacing: DVec3,
    /// The last corner of the grid.
    last: DVec3,
    known: [Corner; 64],
}

impl<'i> Corners<'i> {
    /// Of the grid of an image; none is known yet.
    pub fn new(image: &'i LabelImage) -> Self {
        let spacing = image.frame().spacing();
        let last = DVec3::from(image.dims().map(|n| n as f64));
        let unknown = Corner { at: usize::MAX, ids: [0; 2], sets: [0; 2], around: [0; 8] };
        Self { image, spacing, per_spacing: 1.0 / spacing, last, known: [unknown; 64] }
    }

    /// Squared distances from `points` to the nearest face of all, and to the nearest ones of two
    /// labels, as far as the corner of the grid nearest to each tells: twelve faces meet there, and
    /// all others are no nearer than the planes of the grid beyond. What it does not tell is
    /// infinite.
    #[inline]
    pub fn near_distances(&mut self, points: &mut Points, ids: [u16; 2]) {
        points.offsets(self.spacing, self.per_spacing, self.last);
        let mut is_one_code = true;
        for i in 0..points.len {
            points.codes.iter_mut().for_each(|row| row[i] = 0);
            if points.beyond[i] < 0.0 {
                continue;
            }
            let corner = points.corners.each_ref().map(|row| row[i].to_bits() as u32 as usize);
            let codes = self.codes(corner, points.octants[i] as usize, ids);
            is_one_code &= codes[1] == codes[0] && codes[2] == codes[0];
            for (row, code) in points.codes.iter_mut().zip(codes) {
                row[i] = code.into();
            }
        }
        points.nearest(is_one_code);
    }

    /// Where faces are around a corner of the grid, for a point in `octant`: of all, and of two
    /// labels; see [`CODES`].
    #[inline(always)]
    fn codes(&mut self, corner: [usize; 3], octant: usize, ids: [u16; 2]) -> [u8; 3] {
        let [i, j, k] = corner;
        let place = (i & 3) | (j & 3) << 2 | (k & 3) << 4;
        let [nx, ny, _] = self.image.dims();
        let at = i + (nx + 1) * (j + (ny + 1) * k);
        if self.known[place].at != at || self.known[place].ids != ids {
            self.known[place] = look_at(self.image, corner, at, ids);
        }
        let known = &self.known[place];
        let [one, other] = known.sets.map(|set| CODES[octant][usize::from(set)]);
        let all = if known.sets[0] | known.sets[1] == 255 {
            one
        } else {
            around_code(&known.around, octant) as u8
        };
        [all, one, other]
    }
}

/// What is around a corner of the grid, number `at`.
#[inline(never)]
fn look_at(image: &LabelImage, corner: [usize; 3], at: usize, ids: [u16; 2]) -> Corner {
    let around = around(image, corner);
    let sets = ids.map(|id| (0..8).fold(0, |bits, o| bits | u8::from(around[o] == id) << o));
    Corner { at, ids, sets, around }
}

/// The ids of the eight voxels at a corner of the grid, x fastest.
#[inline]
fn around(image: &LabelImage, [i, j, k]: [usize; 3]) -> [u16; 8] {
    let [nx, ny, nz] = image.dims();
    if (1..nx).contains(&i) && (1..ny).contains(&j) && (1..nz).contains(&k) {
        let ids = image.ids();
        let pair = |j: usize, k: usize| {
            let at = i + nx * (j + ny * k);
            [ids[at - 1], ids[at]]
        };
        let [[a, b], [c, d], [e, f], [g, h]] =
            [pair(j - 1, k - 1), pair(j, k - 1), pair(j - 1, k), pair(j, k)];
        return [a, b, c, d, e, f, g, h];
    }
    // Below 0 wraps to what is outside just as well.
    let id = |i: usize, j: usize, k: usize| {
        if i < nx && j < ny && k < nz { image.ids()[i + nx * (j + ny * k)] } else { 0 }
    };
    let (x, y, z) = ([i.wrapping_sub(1), i], [j.wrapping_sub(1), j], [k.wrapping_sub(1), k]);
    std::array::from_fn(|o| id(x[o & 1], y[o >> 1 & 1], z[o >> 2]))
}

/// For each octant around a corner of the grid, and for each set of the eight voxels there, where
/// the faces lie that have one voxel of the set on one side: a bit for each set of axes along which
/// a point of the octant is beside them, x, y, z, xy, xz, yz, xyz.
static CODES: [[u8; 256]; 8] = {
    let mut codes = [[0; 256]; 8];
    let mut octant = 0;
    while octant < 8 {
        let mut bits = 0;
        while bits < 256 {
            let mut near = [0; 8];
            let mut o = 0;
            while o < 8 {
                near[o] = (bits >> (o ^ octant) & 1) as u16;
                o += 1;
            }
            codes[octant][bits] = code(&near) as u8;
            bits += 1;
        }
        octant += 1;
    }
    codes
};

/// Where faces are between eight voxels, the first of which holds a point near the corner that they
/// share: see [`CODES`].
const fn code(ids: &[u16; 8]) -> u32 {
    // The bit of each set of axes.
    const BIT: [u32; 8] = [7, 0, 1, 3, 2, 4, 5, 6];
    let (mut code, mut o) = (0, 0);
    while o < 8 {
        let mut axis = 0;
        while axis < 3 {
            let across = o | 1 << axis;
            if across != o && ids[o] != ids[across] {
                code |= 1 << BIT[across];
            }
            axis += 1;
        }
        o += 1;
    }
    code
}

/// The same for voxels in the order of the grid, the point in `octant`.
#[cold]
fn around_code(around: &[u16; 8], octant: usize) -> u32 {
    code(&std::array::from_fn(|o| around[o ^ octant]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::VoxelFaces;
    use super::*;
    use crate::image::Frame;
    use crate::monitor::Monitor;

    proptest! {
        /// What the corner of the grid nearest to a point tells is right, and it tells all that is
        /// within half a voxel.
        #[test]
        fn near_distances_against_all(
            seed in prop::collection::vec(0u16..4, 5 * 4 * 3),
            p in [-1.0..6.0f64, -1.0..5.0, -1.0..4.0],
            spacing in prop::sample::select(vec![[1.0, 1.0, 1.0], [0.5, 0.75, 2.0]]),
            ids in [0u16..4, 0u16..4],
        ) {
            let ids_of = seed.clone();
            let frame = Frame::axis_aligned(spacing).unwrap();
            let image = LabelImage::from_ids([5, 4, 3], frame, ids_of, vec![0, 3, 5, 9]).unwrap();
            let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
            let all = faces.all();
            let p = DVec3::from(p) * DVec3::from(spacing);
            let ids = ids.map(|id| id.min(image.labels().len() as u16 - 1));
            let mut points = Points::default();
            points.push(p);
            Corners::new(&image).near_distances(&mut points, ids);
            let found = points.distances(0);
            let wanted = |id: Option<u16>| {
                let of = all.iter().filter(|&&f| id.is_none_or(|id| faces.touches(f, id)));
                of.map(|&f| faces.distance_squared(f, p)).fold(f64::INFINITY, f64::min)
            };
            let inside = p.cmpge(DVec3::ZERO).all()
                && p.cmple(DVec3::new(5.0, 4.0, 3.0) * DVec3::from(spacing)).all();
            let half = 0.5 * faces.smallest_spacing();
            for (found, expected) in
                found.into_iter().zip([None, Some(ids[0]), Some(ids[1])].map(wanted))
            {
                if found.is_finite() {
                    prop_assert!((found - expected).abs() <= 1e-12, "{found} {expected}");
                } else {
                    prop_assert!(!inside || expected > half * half * (1.0 - 1e-12), "{expected}");
                }
            }
        }
    }
}
