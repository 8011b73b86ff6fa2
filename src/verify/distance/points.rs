//! What is computed of points near the corners of a grid, some at a time: see
//! [`grid_corners`](super::grid_corners).
//!
//! The loops are written so that the compiler vectorises them
//! ([`vectors`](crate::geometry::vectors)).

use glam::DVec3;

use crate::geometry::shape::smaller;
use crate::geometry::vectors::vectorized;

/// Most points at once.
pub(super) const AT_ONCE: usize = 64;
/// A multiple of the lanes of a vector of f64.
const STEP: usize = 4;

/// A value of each point.
type Row<T> = [T; AT_ONCE];

/// Some points, at most [`AT_ONCE`], and what is known of them; what lies beyond the last one means
/// nothing.
#[repr(align(64))]
pub(crate) struct Points {
    /// By axis.
    at: [Row<f64>; 3],
    pub(super) len: usize,
    /// The nearest corner of the grid: its index along each axis in the low bits.
    pub(super) corners: [Row<f64>; 3],
    /// A bit for each axis along which the point is not below the corner.
    pub(super) octants: Row<u64>,
    /// The squared offsets from the corner.
    squares: [Row<f64>; 3],
    /// The squared distance of the planes of the grid beyond; negative outside of the grid.
    pub(super) beyond: Row<f64>,
    /// Where faces are: of all, and of two labels.
    pub(super) codes: [Row<u64>; 3],
    /// Squared distances: to the nearest face of all, and of two labels.
    distances: [Row<f64>; 3],
}

impl Default for Points {
    fn default() -> Self {
        let zero = [0.0; AT_ONCE];
        Self {
            at: [zero; 3],
            len: 0,
            corners: [zero; 3],
            octants: [0; AT_ONCE],
            squares: [zero; 3],
            beyond: zero,
            codes: [[0; AT_ONCE]; 3],
            distances: [zero; 3],
        }
    }
}

impl Points {
    /// How many there are.
    #[inline]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no room for another one.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.len == AT_ONCE
    }

    /// Leaves no point.
    #[inline]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a point, where there is room.
    #[inline(always)]
    pub fn push(&mut self, p: DVec3) {
        let [x, y, z] = &mut self.at;
        (x[self.len], y[self.len], z[self.len]) = p.into();
        self.len += 1;
    }

    /// Point `i`.
    #[inline]
    pub fn get(&self, i: usize) -> DVec3 {
        DVec3::new(self.at[0][i], self.at[1][i], self.at[2][i])
    }

    /// The squared distances of point `i`.
    #[inline]
    pub fn distances(&self, i: usize) -> [f64; 3] {
        self.distances.each_ref().map(|row| row[i])
    }

    /// Finds corners, octants, offsets, and what is beyond, in a grid of such a spacing; `last` is
    /// the index of its last corner.
    pub(super) fn offsets(&mut self, spacing: DVec3, per_spacing: DVec3, last: DVec3) {
        let grid = [spacing, per_spacing, last];
        offsets_of(self, &grid);
    }

    /// Finds the distances by the codes, which are three times the same ones where `is_one_code`.
    pub(super) fn nearest(&mut self, is_one_code: bool) {
        nearest_of(self, is_one_code);
    }

    /// How many are computed: those beyond the last one in vain.
    #[inline(always)]
    fn computed(&self) -> usize {
        self.len.next_multiple_of(STEP).min(AT_ONCE)
    }
}

vectorized! {
    fn offsets_of[](points: &mut Points, grid: &[DVec3; 3]) = find_offsets;
    offsets_avx2, offsets_portably
}

#[inline(always)]
fn find_offsets(points: &mut Points, &[spacing, per_spacing, last]: &[DVec3; 3]) {
    // The sum with 2^52 has the nearest integer in its low bits; a call of `floor` takes several
    // times as long.
    const SHIFT: f64 = (1_u64 << 52) as f64;
    for i in 0..points.computed() {
        let p = points.get(i);
        let shifted = p * per_spacing + SHIFT;
        let corner = shifted - SHIFT;
        let offset = p - corner * spacing;
        let room = spacing - offset.abs();
        let inside = (corner.x >= 0.0)
            & (corner.y >= 0.0)
            & (corner.z >= 0.0)
            & (corner.x <= last.x)
            & (corner.y <= last.y)
            & (corner.z <= last.z);
        let beyond = smaller(smaller(room.x, room.y), room.z);
        points.corners[0][i] = shifted.x;
        points.corners[1][i] = shifted.y;
        points.corners[2][i] = shifted.z;
        points.octants[i] = u64::from(offset.x >= 0.0)
            | u64::from(offset.y >= 0.0) << 1
            | u64::from(offset.z >= 0.0) << 2;
        points.squares[0][i] = offset.x * offset.x;
        points.squares[1][i] = offset.y * offset.y;
        points.squares[2][i] = offset.z * offset.z;
        points.beyond[i] = if inside { beyond * beyond } else { -1.0 };
    }
}

vectorized! {
    fn nearest_of[](points: &mut Points, is_one_code: bool) = find_nearest;
    nearest_avx2, nearest_portably
}

#[inline(always)]
fn find_nearest(points: &mut Points, is_one_code: bool) {
    let count = points.computed();
    for which in 0..if is_one_code { 1 } else { 3 } {
        for i in 0..count {
            let [x, y, z] = [points.squares[0][i], points.squares[1][i], points.squares[2][i]];
            let code = points.codes[which][i];
            // No branch on the bits, which could not be foreseen.
            let nearer = |nearest: f64, bit: u64, square: f64| {
                let is_there = (code >> bit & 1 == 1) & (square < nearest);
                if is_there { square } else { nearest }
            };
            let nearest = nearer(f64::INFINITY, 0, x);
            let nearest = nearer(nearest, 1, y);
            let nearest = nearer(nearest, 2, z);
            let nearest = nearer(nearest, 3, x + y);
            let nearest = nearer(nearest, 4, x + z);
            let nearest = nearer(nearest, 5, y + z);
            let nearest = nearer(nearest, 6, x + y + z);
            let is_known = nearest <= points.beyond[i];
            points.distances[which][i] = if is_known { nearest } else { f64::INFINITY };
        }
    }
    if is_one_code {
        let [all, one, other] = &mut points.distances;
        one[..count].copy_from_slice(&all[..count]);
        other[..count].copy_from_slice(&all[..count]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vectors::weyl;

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn every_instance_of_the_loops_gives_the_same_bits() {
        if !std::arch::is_x86_feature_detected!("avx2") {
            println!("SKIPPED: this processor has no AVX2");
            return;
        }
        let spacing = DVec3::new(0.9, 0.7, 3.0);
        let grid = [spacing, 1.0 / spacing, DVec3::new(5.0, 6.0, 7.0)];
        let points = || {
            let mut points = Points::default();
            for i in 0..AT_ONCE {
                // Some of them outside.
                points.push(8.0 * DVec3::new(weyl(i), weyl(7 * i + 1), weyl(31 * i + 2)) - 1.0);
                (0..3).for_each(|which| points.codes[which][i] = (37 * i + which) as u64 % 128);
            }
            points
        };
        let known = |points: &Points| {
            let [x, y, z] = points.distances;
            [x, y, z, points.beyond].map(|row| row.map(f64::to_bits))
        };
        for is_one_code in [true, false] {
            let (mut portable, mut vector) = (points(), points());
            offsets_portably(&mut portable, &grid);
            nearest_portably(&mut portable, is_one_code);
            // SAFETY: the processor has AVX2, see above.
            unsafe {
                offsets_avx2(&mut vector, &grid);
                nearest_avx2(&mut vector, is_one_code);
            }
            assert_eq!(known(&portable), known(&vector));
            assert_eq!(portable.octants, vector.octants);
            let is_outside = portable.beyond.iter().any(|&beyond| beyond < 0.0);
            assert!(
                is_outside && portable.distances[0].iter().any(|distance| distance.is_finite())
            );
        }
    }
}
