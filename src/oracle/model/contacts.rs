//! Contacts: where voxels of a label meet in an edge or in a corner alone, and how the smooth model
//! joins them there.
//!
//! By 26-connectivity such voxels are joined. A smooth interface does not do that: between voxels
//! that meet in a corner it passes through, and where the labels A B / B A alternate around an edge
//! it joins one label and parts the other, as their weights have it. For closed bodies there is no
//! conflict: both can be joined when they touch, in the very place in which their voxels do.
//!
//! **The model.** The midpoint of an edge around which two labels alternate is the centre of a face
//! of two cells; the corner of eight voxels is the centre of a cell. A *contact* is such a face, or
//! such a cell where faces do not yet join what the image joins. A cell falls into eight octants,
//! one for each voxel. In an octant the weighted indicator of its own voxel's label is raised by a
//! bonus: a trilinear function that is [`BONUS`] at the contacts among the octant's corners and 0
//! at the others. So around a contact each octant has its own label, and the labels' bodies touch
//! in it as the voxels do; the bonus is 0 on all faces that are no contacts, so that cells agree
//! there as before. Within an octant the lead of one label over another stays trilinear, and a
//! cubic along a segment.
//!
//! **Why it is enough.** The Euler characteristic of a label's closed voxels is an alternating sum
//! over the cells between voxel centres, their faces, edges and corners, in which each counts 1
//! where a corner has the label: closed voxels around a common corner are star-shaped. That of the
//! label's closed body in the model is the same sum of the characteristics of its parts there.
//! Edges agree. In faces and cells the parts are contractible with the contacts, for each way in
//! which labels can lie on the corners of a cell; without them, just faces around which labels
//! alternate and cells with contacts are not. (Both counted on a lattice for all 4140 ways.)
//!
//! Which cells have a centre that is a contact: take the voxels of a label in the cell that are
//! joined across faces, and join these sets where they meet on a face whose other two voxels have
//! two other labels. If contacts on faces join what is left as a tree, that is enough; else the
//! centre is one. The background need not be joined: around it 6-connectivity holds.
//!
//! Cost: one cell in a hundred has contacts in an atlas; a question there takes some ten
//! nanoseconds more.

use super::indicator::{self, Corners};

/// By how much the indicator of an octant's own label is raised at contacts. At the middle of an
/// octant with one contact that makes it 7/16 + 1/2 of all labels' 1 at least.
const BONUS: f32 = 4.0;

/// The corners of a cell's faces, two across from each other and the other two: those across each
/// axis, on the side of the first corner and on the other.
pub(crate) const FACES: [[[usize; 4]; 2]; 3] =
    [[[0, 6, 2, 4], [1, 7, 3, 5]], [[0, 5, 1, 4], [2, 7, 3, 6]], [[0, 3, 1, 2], [4, 7, 5, 6]]];

/// The corners beside each corner, as bits.
const BESIDE: [u32; 8] = {
    let mut beside = [0; 8];
    let mut c = 0;
    while c < 8 {
        beside[c] = 1 << (c ^ 1) | 1 << (c ^ 2) | 1 << (c ^ 4);
        c += 1;
    }
    beside
};

/// Of each set of corners those that are joined with its first one across faces of their voxels.
const JOINED: [u8; 256] = {
    let mut joined = [0; 256];
    let mut own: usize = 0;
    while own < 256 {
        let mut piece = own as u32 & (own as u32).wrapping_neg();
        // No path along edges of the cell has more than seven.
        let mut step = 0;
        while step < 7 {
            let mut c = 0;
            while c < 8 {
                if piece >> c & 1 == 1 {
                    piece |= BESIDE[c] & own as u32;
                }
                c += 1;
            }
            step += 1;
        }
        joined[own] = piece as u8;
        own += 1;
    }
    joined
};

/// Of each set of corners whether a cell of two labels, one of which has these, has no contacts,
/// whatever the labels: both are joined across faces, and do not alternate.
pub(crate) const IS_PLAIN: [bool; 256] = {
    let mut is_plain = [false; 256];
    let mut own = 0;
    while own < 256 {
        let mut ids = [0; 8];
        let mut c = 0;
        while c < 8 {
            ids[c] = (own >> c & 1) as u16;
            c += 1;
        }
        let mut is_plain_so_far =
            JOINED[own] as usize == own && JOINED[255 - own] as usize == 255 - own;
        let mut n = 0;
        while n < 6 {
            is_plain_so_far &= !alternates(&ids, FACES.as_flattened()[n]);
            n += 1;
        }
        is_plain[own] = is_plain_so_far;
        own += 1;
    }
    is_plain
};

/// Which contacts a cell has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Contacts {
    /// None.
    None,
    /// On faces alone.
    Faces,
    /// Its centre, and may be some on faces.
    Center,
}

/// Whether two labels alternate around a face.
#[inline(always)]
pub(crate) const fn alternates(ids: &Corners, [a, b, c, d]: [usize; 4]) -> bool {
    ids[a] == ids[b] && ids[c] == ids[d] && ids[a] != ids[c]
}

impl Contacts {
    /// Of the cell whose corners have these ids.
    pub(crate) fn of(ids: &Corners) -> Self {
        let on_faces = FACES.as_flattened().iter().any(|&face| alternates(ids, face));
        let across = (0..4).any(|c| ids[c] == ids[7 - c]);
        if !(on_faces || across) {
            return Self::None;
        }
        let needs = |id: u16| needs_center_of(ids, id);
        match () {
            () if indicator::labels(ids, 0xff).any(needs) => Self::Center,
            () if on_faces => Self::Faces,
            () => Self::None,
        }
    }
}

/// Whether a label needs the centre of a cell as a contact.
pub(crate) fn needs_center_of(ids: &Corners, id: u16) -> bool {
    id != 0 && needs_center(ids, indicator::corners_of(ids, id))
}

/// Whether contacts on faces do not join the corners `own` of one label as a tree.
fn needs_center(ids: &Corners, own: u32) -> bool {
    let first_piece = |own: u32| u32::from(JOINED[own as usize]);
    if first_piece(own) == own {
        return false;
    }
    // What is joined across faces: at most four sets.
    let (mut pieces, mut count, mut rest) = ([0; 4], 0, own);
    while rest != 0 {
        let piece = first_piece(rest);
        (pieces[count], count, rest) = (piece, count + 1, rest & !piece);
    }
    // The set of sets that each belongs to, by the number of one.
    let mut joined = [0, 1, 2, 3];
    let place =
        |c: usize| pieces[..count].iter().position(|piece| piece >> c & 1 == 1).unwrap_or(0);
    let pairs = || {
        let faces = FACES.as_flattened().iter();
        let both = faces.flat_map(|&[a, b, c, d]| [([a, b], [c, d]), ([c, d], [a, b])]);
        both.filter(|&([a, b], [c, d])| {
            [a, b].iter().all(|&c| own >> c & 1 == 1) && [c, d].iter().all(|&c| own >> c & 1 == 0)
        })
    };
    for ([a, b], [c, d]) in pairs() {
        if ids[c] != ids[d] {
            let (from, to) = (joined[place(a)], joined[place(b)]);
            joined.iter_mut().filter(|set| **set == from).for_each(|set| *set = to);
        }
    }
    for ([a, b], [c, d]) in pairs() {
        if ids[c] == ids[d] && place(a) != place(b) {
            let (from, to) = (joined[place(a)], joined[place(b)]);
            if from == to {
                return true;
            }
            joined.iter_mut().filter(|set| **set == from).for_each(|set| *set = to);
        }
    }
    joined[1..count].iter().any(|&set| set != joined[0])
}

/// A cell with contacts.
pub(crate) struct Cell<'a> {
    pub(crate) ids: Corners,
    pub(crate) weights: &'a [f32],
    /// Whether its centre is a contact.
    pub(crate) center: bool,
}

/// One eighth of a cell. In its own coordinates the voxel's centre is at 0 and the cell's at 1.
struct Octant {
    /// The corner of the cell that it has.
    corner: usize,
    /// The bonus at its corners.
    bonus: [f32; 8],
}

impl Octant {
    /// The place in the octant of a point of the cell, moved to the nearest in it: rounding may
    /// have it just outside.
    #[inline]
    fn place(&self, at: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|a| {
            (2.0 * if self.corner >> a & 1 == 1 { 1.0 - at[a] } else { at[a] }).clamp(0.0, 1.0)
        })
    }
}

impl Cell<'_> {
    /// The octant of a point.
    fn octant(&self, at: [f32; 3]) -> Octant {
        let corner = (0..3).fold(0, |corner, a| corner | usize::from(at[a] > 0.5) << a);
        let mut bonus = [0.0; 8];
        if self.center {
            bonus[7] = BONUS;
        }
        for (axis, faces) in FACES.iter().enumerate() {
            if alternates(&self.ids, faces[corner >> axis & 1]) {
                bonus[7 ^ 1 << axis] = BONUS;
            }
        }
        Octant { corner, bonus }
    }

    /// The label at a point; the smaller id on a tie.
    pub(crate) fn label(&self, at: [f32; 3]) -> u16 {
        self.label_in(&self.octant(at), at)
    }

    fn label_in(&self, octant: &Octant, at: [f32; 3]) -> u16 {
        let parts = indicator::parts(at);
        let near: f32 = indicator::parts(octant.place(at))
            .iter()
            .zip(&octant.bonus)
            .map(|(part, bonus)| part * bonus)
            .sum();
        let own = self.ids[octant.corner];
        let (mut best, mut largest) = (own, f32::NEG_INFINITY);
        for id in indicator::labels(&self.ids, 0xff) {
            let bonus = if id == own { near } else { 0.0 };
            let value = (indicator::indicator(&self.ids, &parts, id) + bonus)
                * self.weights[usize::from(id)];
            if value > largest || (value == largest && id < best) {
                (best, largest) = (id, value);
            }
        }
        best
    }

    /// The weighted indicator of a label at the corners of an octant.
    fn values(&self, octant: &Octant, id: u16) -> [f32; 8] {
        let corners = indicator::corners_of(&self.ids, id);
        let weight = self.weights[usize::from(id)];
        std::array::from_fn(|c| {
            // The mean over the cell's corners around: what differs from the octant's own in axes
            // that `c` has.
            let among = (0..8).filter(|b| b & !c == 0);
            let held = among.filter(|b| corners >> (octant.corner ^ b) & 1 == 1).count();
            let bonus = if id == self.ids[octant.corner] { octant.bonus[c] } else { 0.0 };
            weight * (held as f32 / (1 << c.count_ones()) as f32 + bonus)
        })
    }

    /// The first point of a segment at which another label overtakes `id`, as
    /// [`indicator::overtaken`] has it: here also where it enters another octant.
    pub(crate) fn overtaken(
        &self,
        id: u16,
        [start, end]: [[f32; 3]; 2],
        tolerance: f64,
    ) -> Option<(f64, u16)> {
        let at = |s: f64| {
            [0, 1, 2].map(|a| {
                (f64::from(start[a]) + (f64::from(end[a]) - f64::from(start[a])) * s) as f32
            })
        };
        let mut cuts = [0, 1, 2].map(|a| {
            let s = (0.5 - f64::from(start[a])) / (f64::from(end[a]) - f64::from(start[a]));
            // Also where this is no number.
            if s > 0.0 && s < 1.0 { s } else { 1.0 }
        });
        cuts.sort_unstable_by(f64::total_cmp);
        let mut from = 0.0;
        for to in cuts.into_iter().chain([1.0]) {
            if to <= from {
                continue;
            }
            let octant = self.octant(at(0.5 * (from + to)));
            if from > 0.0 {
                let label = self.label_in(&octant, at(from));
                if label != id {
                    return Some((from, label));
                }
            }
            let ends = [at(from), at(to)].map(|p| octant.place(p));
            let own = self.values(&octant, id);
            let lead = |other: u16| {
                let against = self.values(&octant, other);
                std::array::from_fn(|c| own[c] - against[c])
            };
            if let Some((s, other)) =
                indicator::first_overtaking(&self.ids, id, ends, tolerance / (to - from), lead)
            {
                return Some((from + (to - from) * s, other));
            }
            from = to;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Points of the lattice between the centre of an octant's voxel and that of the cell.
    const STEPS: usize = 6;
    const SIDE: usize = 2 * STEPS + 1;

    /// All ways in which labels can lie on the corners, but for their names; the first one's id is
    /// 0.
    fn all_ways() -> Vec<Corners> {
        let mut ways = vec![(Vec::new(), 0)];
        for _ in 0..8 {
            let longer = |(ids, count): &(Vec<u16>, u16)| -> Vec<(Vec<u16>, u16)> {
                (0..=*count).map(|id| ([&ids[..], &[id]].concat(), (*count).max(id + 1))).collect()
            };
            ways = ways.iter().flat_map(longer).collect();
        }
        ways.into_iter().map(|(ids, _)| std::array::from_fn(|c| ids[c])).collect()
    }

    /// Where no label is ahead of `id` in some octant of a cell: the points of a lattice in its
    /// closed body.
    fn closed_body(cell: &Cell<'_>, id: u16) -> Vec<bool> {
        let mut body = vec![false; SIDE.pow(3)];
        for corner in 0..8 {
            let octant =
                cell.octant([0, 1, 2].map(|a| if corner >> a & 1 == 1 { 0.75 } else { 0.25 }));
            let mut ids = cell.ids.to_vec();
            ids.sort_unstable();
            ids.dedup();
            let values: Vec<(u16, [f32; 8])> =
                ids.into_iter().map(|id| (id, cell.values(&octant, id))).collect();
            for n in 0..(STEPS + 1).pow(3) {
                let steps =
                    [n % (STEPS + 1), n / (STEPS + 1) % (STEPS + 1), n / (STEPS + 1).pow(2)];
                let parts = indicator::parts(steps.map(|s| s as f32 / STEPS as f32));
                let value = |values: &[f32; 8]| {
                    parts.iter().zip(values).map(|(part, value)| part * value).sum::<f32>()
                };
                let max = values.iter().map(|(_, values)| value(values)).fold(0.0, f32::max);
                let own = values
                    .iter()
                    .filter(|(other, _)| *other == id)
                    .map(|(_, values)| value(values))
                    .fold(0.0, f32::max);
                let place = [0, 1, 2]
                    .map(|a| if corner >> a & 1 == 1 { 2 * STEPS - steps[a] } else { steps[a] });
                body[place[0] + SIDE * (place[1] + SIDE * place[2])] |= own >= max - 1e-5;
            }
        }
        body
    }

    /// The Euler characteristic of the points of a lattice in a box and the edges, squares and
    /// cubes between them.
    fn euler(body: &[bool], sides: [usize; 3]) -> i64 {
        let at = |p: [usize; 3]| {
            p.iter().zip(&sides).all(|(c, side)| c < side)
                && body[p[0] + SIDE * (p[1] + SIDE * p[2])]
        };
        let mut sum = 0;
        for n in 0..sides.iter().product() {
            let p = [n % sides[0], n / sides[0] % sides[1], n / (sides[0] * sides[1])];
            for axes in 0..8_usize {
                let corners = (0..8).filter(|c| c & !axes == 0);
                let full = corners.map(|c| [0, 1, 2].map(|a| p[a] + (c >> a & 1))).all(at);
                sum += if full { 1 - 2 * i64::from(axes.count_ones() % 2) } else { 0 };
            }
        }
        sum
    }

    /// What the head of this file says: bodies are contractible in each cell and in its faces,
    /// however labels lie.
    #[test]
    fn closed_bodies_are_those_of_closed_voxels() {
        let ways = all_ways();
        assert_eq!(ways.len(), 4140);
        let mut with = [0; 3];
        for ids in ways {
            let contacts = Contacts::of(&ids);
            with[contacts as usize] += 1;
            let weights = [1.0, 1.1, 0.95, 1.15, 1.0, 1.05, 0.98, 1.0];
            let cell = Cell { ids, weights: &weights, center: contacts == Contacts::Center };
            for id in 1..8 {
                if indicator::corners_of(&ids, id) != 0 {
                    let body = closed_body(&cell, id);
                    assert_eq!(euler(&body, [SIDE; 3]), 1, "label {id} of {ids:?}");
                    assert!(euler(&body, [SIDE, SIDE, 1]) <= 1, "label {id} on a face of {ids:?}");
                }
            }
        }
        assert!(with.iter().all(|&count| count > 100), "{with:?}");
    }

    #[test]
    fn plain_sets_of_corners_have_no_contacts() {
        for (own, is_plain) in IS_PLAIN.into_iter().enumerate().take(255).skip(1) {
            let has_contacts = [[0, 1], [1, 0], [1, 2]].map(|labels| {
                let ids = std::array::from_fn(|c| labels[own >> c & 1]);
                Contacts::of(&ids) != Contacts::None
            });
            // Of two labels that are not the background all contacts are told.
            assert_eq!(is_plain, !has_contacts[2], "corners {own:b}");
            assert!(!(is_plain && has_contacts.contains(&true)), "corners {own:b}");
        }
    }

    proptest! {
        #[test]
        fn overtaken_is_the_first_change_on_dense_samples(
            ids in prop::array::uniform8(0_u16..3),
            start in prop::array::uniform3(0.0_f32..=1.0),
            end in prop::array::uniform3(0.0_f32..=1.0),
        ) {
            let contacts = Contacts::of(&ids);
            prop_assume!(contacts != Contacts::None);
            let cell =
                Cell { ids, weights: &[1.0, 1.25, 0.875], center: contacts == Contacts::Center };
            const SAMPLES: u32 = 2000;
            let at = |s: f64| -> [f32; 3] {
                std::array::from_fn(|a| {
                    (f64::from(start[a]) + (f64::from(end[a]) - f64::from(start[a])) * s) as f32
                })
            };
            let id = cell.label(start);
            let labels: Vec<(f64, u16)> = (0..=SAMPLES)
                .map(|n| f64::from(n) / f64::from(SAMPLES))
                .map(|s| (s, cell.label(at(s))))
                .collect();
            let change = labels.iter().find(|(_, label)| *label != id).map(|(s, _)| *s);
            match (cell.overtaken(id, [start, end], 1e-4), change) {
                (Some((s, _)), Some(change)) => {
                    prop_assert!(s <= change + 1e-3, "late: {s}, sampled {change}")
                }
                (None, Some(change)) => {
                    // A stay too short to be more than rounding.
                    prop_assert!(
                        labels.iter().filter(|(_, label)| *label != id).count() <= 1,
                        "missed at {change}"
                    );
                }
                _ => {}
            }
        }
    }
}
