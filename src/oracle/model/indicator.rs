//! The smooth model inside one cell: indicators of labels, interpolated trilinearly.
//!
//! A cell is the cube between eight voxel centres. The indicator of a label is 1 at corners of that
//! label and 0 at the others; the label of a point is the one whose interpolated indicator times
//! the label's weight is largest, the smaller id on a tie. Weights are positive and belong to
//! labels, not to cells: neighbouring cells agree on their common face, because there only its four
//! corners count. Single precision: coordinates within a cell need no more than 1e-7 of it.

/// Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2).
pub(crate) type Corners = [u16; 8];

/// Which corners have label `id`, one bit each. Without branches: which corners differ is as good
/// as random.
#[inline(always)]
pub(crate) fn corners_of(ids: &Corners, id: u16) -> u32 {
    (0..8).fold(0, |mask, c| mask | u32::from(ids[c] == id) << c)
}

/// The different labels at some corners, given by their bits, in the order of their first corners.
#[inline(always)]
pub(crate) fn labels(ids: &Corners, mut among: u32) -> impl Iterator<Item = u16> {
    std::iter::from_fn(move || {
        let id = *ids.get(among.trailing_zeros() as usize)?;
        among &= !corners_of(ids, id);
        Some(id)
    })
}

/// The part each of the eight corners has in a point of the cell, given in [0, 1]^3.
#[inline(always)]
pub(crate) fn parts([x, y, z]: [f32; 3]) -> [f32; 8] {
    let xs = [1.0 - x, x];
    let yz = [(1.0 - y) * (1.0 - z), y * (1.0 - z), (1.0 - y) * z, y * z];
    std::array::from_fn(|c| xs[c & 1] * yz[c >> 1])
}

/// `inside` at the corners in the set `corners`, `outside` at the others. By bits: a choice may
/// become a branch, and which corners are in the set is as good as random.
#[inline(always)]
fn choose(corners: u32, inside: [f32; 8], outside: f32) -> [f32; 8] {
    std::array::from_fn(|c| {
        let mask = u32::from(corners & 1 << c == 0).wrapping_sub(1);
        f32::from_bits(inside[c].to_bits() & mask | outside.to_bits() & !mask)
    })
}

/// The sum of the parts of some corners: their interpolated indicator.
#[inline(always)]
pub(crate) fn sum_of(corners: u32, parts: &[f32; 8]) -> f32 {
    let w = choose(corners, *parts, 0.0);
    // Summed in pairs: one order, which vectorises.
    ((w[0] + w[4]) + (w[2] + w[6])) + ((w[1] + w[5]) + (w[3] + w[7]))
}

/// The interpolated indicator of `id`.
#[inline(always)]
pub(crate) fn indicator(ids: &Corners, parts: &[f32; 8], id: u16) -> f32 {
    sum_of(corners_of(ids, id), parts)
}

/// The label at a point of a cell of two labels, the first of which the `corners` have.
#[inline(always)]
pub(crate) fn label_of_two(
    corners: u32,
    [id, other]: [u16; 2],
    weights: &[f32],
    at: [f32; 3],
) -> u16 {
    let part = sum_of(corners, &parts(at));
    let (value, against) =
        (part * weights[usize::from(id)], (1.0 - part) * weights[usize::from(other)]);
    if value > against || (value == against && id < other) { id } else { other }
}

/// The label at a point of the cell. `weights`: of each id; `greatest`: the largest of them.
#[inline]
pub(crate) fn label(ids: &Corners, weights: &[f32], greatest: f32, at: [f32; 3]) -> u16 {
    let parts = parts(at);
    // The nearest corner has the label most often: far enough ahead it needs no rival.
    let nearest =
        usize::from(at[0] > 0.5) | usize::from(at[1] > 0.5) << 1 | usize::from(at[2] > 0.5) << 2;
    let mut best = ids[nearest];
    let first = indicator(ids, &parts, best);
    let mut largest = first * weights[usize::from(best)];
    let mut unseen = 1.0 - first;
    // The margin keeps rounding from deciding a tie among what was not looked at.
    if largest > (unseen + 1e-6) * greatest {
        return best;
    }
    let mut rest = !corners_of(ids, best) & 0xff;
    while rest != 0 {
        let id = ids[rest.trailing_zeros() as usize];
        rest &= !corners_of(ids, id);
        // Cells of two labels are most common: the last label has what the others leave.
        let part = if rest == 0 { unseen } else { indicator(ids, &parts, id) };
        let value = part * weights[usize::from(id)];
        if value > largest || (value == largest && id < best) {
            (best, largest) = (id, value);
        }
        unseen -= part;
        if largest > (unseen + 1e-6) * greatest {
            break;
        }
    }
    best
}

/// The first point of a segment inside the cell at which another label overtakes `id`, which leads
/// at the start: its parameter in [0, 1], to within `tolerance`, and the label that overtakes.
/// Exact but for rounding: no overtaking is missed, however short.
///
/// The lead of `id` over one other label is trilinear, so along the segment it is a cubic
/// polynomial.
#[inline]
pub(crate) fn overtaken(
    ids: &Corners,
    weights: &[f32],
    id: u16,
    [start, end]: [[f32; 3]; 2],
    tolerance: f64,
) -> Option<(f64, u16)> {
    let weight = weights[usize::from(id)];
    let lead = |other: u16| {
        let against = weights[usize::from(other)];
        std::array::from_fn(|c| {
            let ahead = if ids[c] == id { weight } else { 0.0 };
            let behind = if ids[c] == other { against } else { 0.0 };
            ahead - behind
        })
    };
    first_overtaking(ids, id, [start, end], tolerance, lead)
}

/// As [`overtaken`], where `lead` tells the lead of `id` over another label at the corners of the
/// cell, or of a part of it, in which the segment is given.
#[inline(always)]
pub(crate) fn first_overtaking(
    ids: &Corners,
    id: u16,
    ends: [[f32; 3]; 2],
    tolerance: f64,
    lead: impl Fn(u16) -> [f32; 8],
) -> Option<(f64, u16)> {
    let mut first: Option<(f64, u16)> = None;
    for other in labels(ids, !corners_of(ids, id) & 0xff) {
        if let Some(s) = descent_along(&lead(other), ends, tolerance)
            && first.is_none_or(|f| (s, other) < f)
        {
            first = Some((s, other));
        }
    }
    first
}

/// As [`overtaken`], in a cell of two labels, of which the `corners` have `id`.
#[inline]
pub(crate) fn overtaken_by_other(
    corners: u32,
    weight: f32,
    against: f32,
    ends: [[f32; 3]; 2],
    tolerance: f64,
) -> Option<f64> {
    descent_along(&choose(corners, [weight; 8], -against), ends, tolerance)
}

/// Where a trilinear function, given by its values at the corners and not negative at the start of
/// a segment, first descends below 0 on it: the parameter in [0, 1], to within `tolerance`.
#[inline(always)]
pub(crate) fn descent_along(
    corners: &[f32; 8],
    [start, end]: [[f32; 3]; 2],
    tolerance: f64,
) -> Option<f64> {
    let cubic = along(corners, start, end);
    if cubic.iter().all(|&b| b >= 0.0) {
        return None;
    }
    first_descent(cubic.map(f64::from), [0.0, 1.0], tolerance)
}

/// The Bernstein coefficients of a trilinear function, given by its values at the corners, along a
/// segment. They are means of its blossom: of its values where some coordinates are those of the
/// segment's start and the others those of its end (L. Ramshaw, "Blossoms are polar forms", CAGD 6,
/// 1989).
#[inline(always)]
fn along(corners: &[f32; 8], start: [f32; 3], end: [f32; 3]) -> [f32; 4] {
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    // One axis after the other, x first: the lowest bit of the index is consumed, and comes back on
    // top as "start or end".
    let mut v = *corners;
    for axis in 0..3 {
        let old = v;
        for n in 0..4 {
            v[n] = mix(old[2 * n], old[2 * n + 1], start[axis]);
            v[n + 4] = mix(old[2 * n], old[2 * n + 1], end[axis]);
        }
    }
    [v[0], (v[1] + v[2] + v[4]) / 3.0, (v[3] + v[5] + v[6]) / 3.0, v[7]]
}

/// The first root in `range` of a cubic that is not negative at the start of the range; `b` are its
/// Bernstein coefficients there. A polynomial has at most as many roots as its coefficients have
/// changes of sign, and the same parity.
fn first_descent(b: [f64; 4], [low, high]: [f64; 2], tolerance: f64) -> Option<f64> {
    let negative = [false, b[1] < 0.0, b[2] < 0.0, b[3] < 0.0];
    let changes = negative.windows(2).filter(|w| w[0] != w[1]).count();
    if changes == 0 {
        return None;
    }
    if changes == 1 {
        return Some(
            low + (high - low)
                * descent([b[0].max(0.0), b[1], b[2], b[3]], tolerance / (high - low)),
        );
    }
    if high - low <= tolerance {
        return negative[3].then_some(0.5 * (low + high));
    }
    // De Casteljau's subdivision at the middle.
    let mean = |a: f64, b: f64| 0.5 * (a + b);
    let (p, q, r) = (mean(b[0], b[1]), mean(b[1], b[2]), mean(b[2], b[3]));
    let (pq, qr) = (mean(p, q), mean(q, r));
    let (middle, value) = (mean(low, high), mean(pq, qr));
    first_descent([b[0], p, pq, value], [low, middle], tolerance)
        .or_else(|| first_descent([value, qr, r, b[3]], [middle, high], tolerance))
}

/// Secant steps before the bracket is halved instead; a guard, three are usual.
const SECANT_STEPS: usize = 8;

/// The only root in [0, 1] of a cubic that is not negative at 0 and negative at 1, by the Illinois
/// variant of the secant method.
fn descent(b: [f64; 4], tolerance: f64) -> f64 {
    let c = [
        b[0],
        3.0 * (b[1] - b[0]),
        3.0 * (b[0] - 2.0 * b[1] + b[2]),
        b[3] - b[0] + 3.0 * (b[1] - b[2]),
    ];
    let (mut low, mut high, mut ahead, mut behind) = (0.0_f64, 1.0_f64, b[0], -b[3]);
    // Which end moved last: when it is the same twice, the other end's value is halved, so that it
    // moves too.
    let mut moved_low = None;
    let mut step = 0;
    loop {
        let secant = low + (high - low) * (ahead / (ahead + behind));
        if high - low <= tolerance {
            return secant;
        }
        let s = if step < SECANT_STEPS { secant } else { 0.5 * (low + high) };
        // At least half a tolerance from both ends: once one end has converged, the next step
        // passes the root and closes the bracket.
        let s = s.max(low + 0.5 * tolerance).min(high - 0.5 * tolerance);
        // Where half a tolerance is lost in rounding the secant may stay at an end.
        let middle = 0.5 * (low + high);
        let s = if low < s && s < high { s } else { middle };
        if !(low < s && s < high) {
            // No number lies between the ends.
            return middle;
        }
        let value = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        let leads = value >= 0.0;
        if leads {
            (low, ahead) = (s, value);
            if moved_low == Some(true) {
                behind *= 0.5;
            }
        } else {
            (high, behind) = (s, -value);
            if moved_low == Some(false) {
                ahead *= 0.5;
            }
        }
        moved_low = Some(leads);
        step += 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Weights for the ids of the tests: all equal, or different and exact in binary.
    const WEIGHTS: [[f32; 5]; 2] = [[1.0; 5], [1.0, 1.5, 0.75, 1.25, 0.875]];

    /// Sum by definition, in double precision: the label and by how much it leads.
    fn naive(ids: &Corners, weights: &[f32], at: [f32; 3]) -> (u16, f64) {
        let mut sums = std::collections::BTreeMap::new();
        for (c, &id) in ids.iter().enumerate() {
            let w: f64 = (0..3)
                .map(|a| if c >> a & 1 == 1 { f64::from(at[a]) } else { 1.0 - f64::from(at[a]) })
                .product();
            *sums.entry(id).or_insert(0.0) += w * f64::from(weights[usize::from(id)]);
        }
        let mut sums: Vec<(u16, f64)> = sums.into_iter().collect();
        sums.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        (sums[0].0, sums[0].1 - sums.get(1).map_or(0.0, |s| s.1))
    }

    #[test]
    fn any_tolerance_ends_the_search_for_a_descent() {
        let b = [1.0, 0.7, -0.3, -1.0];
        let root = descent(b, 1e-9);
        for tolerance in [1e-300, 1e-18, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            let s = descent(b, tolerance);
            assert!((0.0..=1.0).contains(&s), "{s} at {tolerance}");
            let ends_at_once = tolerance.is_nan() || tolerance > 1.0;
            assert!(ends_at_once || (s - root).abs() < 1e-6, "{s} at {tolerance}");
        }
        // The first secant is exact, and stays at the root.
        assert!((descent([1.0, 0.0, -1.0, -2.0], 0.0) - 1.0 / 3.0).abs() < 1e-15);
        // It ends, whatever it says.
        descent([f64::NAN, 1.0, 1.0, -1.0], 1e-9);
        descent([1.0, f64::NAN, 1.0, -1.0], 0.0);
    }

    proptest! {
        #[test]
        fn label_is_the_naive_argmax(
            ids in prop::array::uniform8(0_u16..5),
            at in prop::array::uniform3(0.0_f32..=1.0),
            set in 0..2_usize,
        ) {
            let weights = &WEIGHTS[set];
            let (expected, ahead) = naive(&ids, weights, at);
            if ahead > 1e-6 {
                prop_assert_eq!(label(&ids, weights, 1.5, at), expected);
            }
        }

        #[test]
        fn two_labels_agree_with_many(
            corners in 1_u32..255,
            pair in prop_oneof![Just([1_u16, 3]), Just([4, 2])],
            start in prop::array::uniform3(0.0_f32..=1.0),
            end in prop::array::uniform3(0.0_f32..=1.0),
            set in 0..2_usize,
        ) {
            let weights = &WEIGHTS[set];
            let ids = std::array::from_fn(|c| pair[usize::from(corners >> c & 1 == 0)]);
            let (expected, ahead) = naive(&ids, weights, start);
            prop_assume!(ahead > 1e-5);
            prop_assert_eq!(label_of_two(corners, pair, weights, start), expected);
            let (of_expected, to) =
                if expected == pair[0] { (corners, pair[1]) } else { (!corners, pair[0]) };
            let [weight, against] = [expected, to].map(|id| weights[usize::from(id)]);
            let s = overtaken_by_other(of_expected, weight, against, [start, end], 1e-4);
            prop_assert_eq!(
                s.map(|s| (s, to)),
                overtaken(&ids, weights, expected, [start, end], 1e-4)
            );
        }

        #[test]
        fn ties_go_to_the_smaller_id(
            ids in prop::array::uniform8(0_u16..5),
            at in prop::array::uniform3(0_u8..=4),
            set in 0..2_usize,
        ) {
            let weights = &WEIGHTS[set];
            // At quarters of the cell all sums are exact.
            let at = at.map(|q| f32::from(q) / 4.0);
            let (expected, _) = naive(&ids, weights, at);
            prop_assert_eq!(label(&ids, weights, 1.5, at), expected);
        }

        #[test]
        fn overtaken_is_the_first_change_on_dense_samples(
            ids in prop::array::uniform8(0_u16..4),
            start in prop::array::uniform3(0.0_f32..=1.0),
            end in prop::array::uniform3(0.0_f32..=1.0),
            set in 0..2_usize,
        ) {
            let weights = &WEIGHTS[set];
            const SAMPLES: u32 = 2000;
            let at = |s: f64| {
                std::array::from_fn(|a| {
                    (f64::from(start[a]) + (f64::from(end[a]) - f64::from(start[a])) * s) as f32
                })
            };
            let (id, ahead) = naive(&ids, weights, start);
            prop_assume!(ahead > 1e-5);
            let change = (1..=SAMPLES)
                .map(|n| f64::from(n) / f64::from(SAMPLES))
                .find(|&s| naive(&ids, weights, at(s)).0 != id);
            let found = overtaken(&ids, weights, id, [start, end], 1e-4);
            match (found, change) {
                (None, None) => {}
                (Some((s, to)), Some(change)) => {
                    prop_assert!(s <= change + 1e-3, "late: {s}, sampled {change}");
                    // Earlier than the samples saw: then a short stay in `to`, or a touch, is
                    // really there.
                    let lead = |l: u16| indicator(&ids, &parts(at(s)), l) * weights[usize::from(l)];
                    prop_assert!(
                        (lead(id) - lead(to)).abs() < 2e-3,
                        "no tie of {id} and {to} at {s}"
                    );
                }
                // Nearly a touch: rounding decides.
                (Some((s, _)), None) => prop_assert!(naive(&ids, weights, at(s)).1 < 1e-3),
                (None, Some(change)) => {
                    prop_assert!(naive(&ids, weights, at(change)).1 < 1e-5, "missed at {change}")
                }
            }
        }
    }
}
