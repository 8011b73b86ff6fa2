//! Simple voxels: those that a label may lose or gain without a change of what is connected.
//!
//! A label is 26-connected here, what is around it 6-connected, as its components are counted
//! (`image/components`). A voxel is *simple* when the label's voxels among the 26 around it are one
//! piece, and those of the others that it has a face in common with are one piece, joined across
//! faces within the 18 around it that have a face or an edge in common (G. Bertrand and
//! G. Malandain, "A new characterization of three-dimensional simple points", 1994). Then the label
//! has as many components, cavities and tunnels with it as without it.
//!
//! Sets of the 27 voxels of a neighbourhood are bits, x fastest; bit 13 is the voxel itself.

/// The voxel in the middle.
const MIDDLE: usize = 13;

/// For each voxel of the neighbourhood, but for the middle, those that have at least a corner in
/// common with it.
const BESIDE: [u32; 27] = beside(3);

/// The same of those that have a face in common.
const ACROSS_FACES: [u32; 27] = beside(1);

/// Those that have a face in common with the middle.
const FACES: u32 = around_middle(1);

/// Those that have a face or an edge in common with it.
const FACES_AND_EDGES: u32 = around_middle(1) | around_middle(2);

/// How far apart two voxels are: along how many axes, or more than 3 if by two along one.
const fn steps(i: usize, j: usize) -> usize {
    let (a, b) = ([i % 3, i / 3 % 3, i / 9], [j % 3, j / 3 % 3, j / 9]);
    let (mut axis, mut sum) = (0, 0);
    while axis < 3 {
        sum += match a[axis].abs_diff(b[axis]) {
            0 => 0,
            1 => 1,
            _ => 4,
        };
        axis += 1;
    }
    sum
}

const fn beside(most: usize) -> [u32; 27] {
    let mut sets = [0; 27];
    let mut i = 0;
    while i < 27 {
        let mut j = 0;
        while j < 27 {
            if i != j && i != MIDDLE && j != MIDDLE && steps(i, j) <= most {
                sets[i] |= 1 << j;
            }
            j += 1;
        }
        i += 1;
    }
    sets
}

const fn around_middle(apart: usize) -> u32 {
    let (mut set, mut i) = (0, 0);
    while i < 27 {
        if steps(i, MIDDLE) == apart {
            set |= 1 << i;
        }
        i += 1;
    }
    set
}

/// What of `set` is joined with its first voxel of `from`.
fn joined(set: u32, from: u32, beside: &[u32; 27]) -> u32 {
    let first = set & from & (set & from).wrapping_neg();
    let (mut piece, mut front) = (first, first);
    while front != 0 {
        let more = beside[front.trailing_zeros() as usize] & set & !piece;
        front = front & (front - 1) | more;
        piece |= more;
    }
    piece
}

/// Whether the voxel in the middle of a neighbourhood is simple for the label that `own` has.
pub(super) fn is_simple(own: u32) -> bool {
    let own = own & !(1 << MIDDLE);
    let other = !own & FACES_AND_EDGES;
    let faces = other & FACES;
    own != 0
        && faces != 0
        && joined(own, own, &BESIDE) == own
        && joined(other, faces, &ACROSS_FACES) & faces == faces
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::components::ImageComponents;
    use crate::image::{Frame, LabelImage};

    /// Components of a set of the neighbourhood's voxels, in a box with a rim, and the sum of their
    /// Euler characteristics.
    fn counts(set: u32) -> (usize, i64) {
        if set == 0 {
            return (0, 0);
        }
        let frame = Frame::axis_aligned([1.0; 3]).unwrap();
        let image = LabelImage::from_fn([5, 5, 5], frame, |p| {
            let at = p.to_array().map(|c| c.round() as usize);
            let inside = at.iter().all(|c| (1..4).contains(c));
            i32::from(inside && set >> (at[0] - 1 + 3 * (at[1] - 1) + 9 * (at[2] - 1)) & 1 == 1)
        });
        let components = ImageComponents::new(&image.unwrap(), &|_| Ok(())).unwrap();
        (components.list.len(), components.list.iter().map(|c| c.euler).sum())
    }

    #[test]
    fn known_neighbourhoods() {
        assert!(!is_simple(0), "a voxel alone");
        assert!(!is_simple(u32::MAX), "the inside of a body");
        assert!(is_simple(1), "the end of a row");
        assert!(!is_simple(1 | 1 << 26), "the middle of a row");
        assert!(is_simple(FACES & !(1 << 4)), "the end of a pocket");
        assert!(!is_simple(FACES & !(1 << 4 | 1 << 22)), "the middle of a tunnel");
        assert!(!is_simple(FACES), "a cavity");
        let half = (0..18).fold(0, |set, i| set | 1 << i);
        assert!(is_simple(half), "the boundary of a half-space");
        let layer = (9..18).fold(0, |set, i| set | 1 << i);
        assert!(!is_simple(layer), "a sheet of one voxel");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        /// A simple voxel changes neither the number of components nor the characteristic.
        #[test]
        fn simple_voxels_change_no_counts(set in 0_u32..1 << 27) {
            if is_simple(set) {
                prop_assert_eq!(counts(set | 1 << MIDDLE), counts(set & !(1 << MIDDLE)));
            }
        }

        /// Sparse sets, in which more voxels are simple.
        #[test]
        fn simple_voxels_of_sparse_sets(a in 0_u32..1 << 27, b in 0_u32..1 << 27) {
            for set in [a & b, a | b] {
                if is_simple(set) {
                    prop_assert_eq!(counts(set | 1 << MIDDLE), counts(set & !(1 << MIDDLE)));
                }
            }
        }
    }
}
