//! Connected components of an image's labels, and the Euler characteristic of each.
//!
//! Voxels of a label are joined with all 26 around them, across faces, edges and vertices, and what
//! is around a component is 6-connected. The other choice, 6 and 26, is farther from what a smooth
//! interface does between voxels that meet in an edge or a vertex (docs/reference/algorithm.md has
//! figures).
//!
//! The image is gone over run by run along x (as in He, Chao, Suzuki, "A run-based two-scan
//! labeling algorithm", 2008), so that memory goes with the number of runs, not of voxels. With
//! this connectivity a component is the union of its voxels as closed boxes, whose Euler
//! characteristic is vertices less edges plus faces less voxels (Kong and Rosenfeld, "Digital
//! topology: introduction and survey", 1989, section 5). Closed runs and what they have in common
//! are boxes, too, and each counts 1: by inclusion and exclusion over the four rows around every
//! line of the grid, what is left is the number of runs, less that of the common parts of two rows
//! (beside each other, or across from each other), plus that of three, less that of four.
//!
//! Parallel over slices in the current rayon pool, practically linear; the numbers of components do
//! not depend on the number of threads.

use glam::DVec3;
use rayon::prelude::*;

use crate::image::LabelImage;
use crate::image::bits::{gathered, ones};
use crate::memory::{room, zeroed};
use crate::reduce::UnionFind;
use crate::{Error, Result};

/// A slice of voxels counts as this many pieces of work, a tet as one.
pub(crate) const SLICE: usize = 4096;

/// A component of one label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageComponent {
    /// The dense id of its label.
    pub id: u16,
    /// Its voxels.
    pub voxels: u64,
    /// Its Euler characteristic as a solid; that of its boundary is twice as large.
    pub euler: i64,
    /// Its first voxel, x fastest.
    pub first: [usize; 3],
}

/// Voxels x in `start..end` of one row, all of one id; or a part of such a run.
#[derive(Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    /// The number of the run; in the end, of its component.
    number: u32,
    id: u16,
}

/// Where a row changes: bit i is set where voxels `from + i` and `from + i + 1` have different ids.
/// No bit is set for the last voxel. There are no branches, for where rows change can't be
/// predicted.
#[inline]
fn changes_from(row: &[u16], from: usize) -> u64 {
    let mut differ = [0; 64];
    for ((differ, a), b) in differ.iter_mut().zip(&row[from..]).zip(&row[from + 1..]) {
        *differ = u8::from(a != b);
    }
    gathered(&differ)
}

/// The runs of the object in one row of ids, of at least one: start, end, id.
fn runs_of(row: &[u16]) -> impl Iterator<Item = (u32, u32, u16)> {
    let words = (0..row.len() - 1).step_by(64);
    let ends = words.flat_map(|from| ones(changes_from(row, from)).map(move |i| from + i + 1));
    let mut start = 0;
    let runs = ends.chain(std::iter::once(row.len())).map(move |end| {
        let run = (start as u32, end as u32, row[start]);
        start = end;
        run
    });
    runs.filter(|run| run.2 != 0)
}

/// How many runs [`runs_of`] finds.
fn count_runs(row: &[u16]) -> usize {
    // Counted in numbers as small as the ids, so that many fit into a vector. Parts are so short
    // that their counts fit.
    let count = |part: &[u16], next: &[u16]| -> u16 {
        part.iter().zip(next).map(|(&a, &b)| u16::from((a != b) & (b != 0))).sum()
    };
    let (these, next) = (&row[..row.len() - 1], &row[1..]);
    let parts = these.chunks(1 << 12).zip(next.chunks(1 << 12));
    usize::from(row[0] != 0) + parts.map(|(a, b)| usize::from(count(a, b))).sum::<usize>()
}

/// The runs of a slice of voxels.
struct Slice {
    runs: Vec<Run>,
    /// Where the runs of each row end.
    ends: Vec<u32>,
    /// For voxels 0, [`MARK`], 2 [`MARK`] and so on of each row: how many runs of the row end
    /// before that voxel. The search for a voxel's run begins after these.
    marks: Vec<u32>,
}

/// Of so many voxels one is marked: few runs lie between two marks.
const MARK: usize = 32;

impl Slice {
    fn new(ids: &[u16], width: usize, runs: usize, first: u32) -> Result<Self> {
        let rows = ids.len() / width;
        let mut slice = Self {
            runs: room(runs, "runs of equal voxels")?,
            ends: room(rows, "rows of voxels")?,
            marks: room(rows * width.div_ceil(MARK), "rows of voxels")?,
        };
        for row in ids.chunks(width) {
            let before = slice.runs.len();
            let numbers = first + before as u32..;
            slice.runs.extend(runs_of(row).zip(numbers).map(|((start, end, id), number)| Run {
                start,
                end,
                number,
                id,
            }));
            slice.ends.push(slice.runs.len() as u32);
            let (runs, mut passed) = (&slice.runs[before..], 0);
            slice.marks.extend((0..width).step_by(MARK).map(|voxel| {
                let ends = runs[passed..].iter().take_while(|run| run.end as usize <= voxel);
                passed += ends.count();
                passed as u32
            }));
        }
        Ok(slice)
    }

    /// The run that holds voxel `i` of row `j`, if there is one.
    #[inline]
    fn run_at(&self, i: usize, j: usize) -> Option<&Run> {
        let per_row = self.marks.len() / self.ends.len();
        let passed = *self.marks.get(per_row * j..per_row * (j + 1))?.get(i / MARK)?;
        let mut runs = self.row(j)[passed as usize..].iter();
        runs.find(|run| run.end as usize > i).filter(|run| run.start as usize <= i)
    }

    fn row(&self, j: usize) -> &[Run] {
        let start = if j == 0 { 0 } else { self.ends[j - 1] as usize };
        &self.runs[start..self.ends[j] as usize]
    }
}

/// Visits what two rows of closed runs, or of such common parts, have in common, points included:
/// as parts of the first row's, with the numbers of the second row's. In both rows neither starts
/// nor ends ever decrease.
#[inline]
fn for_common(a: &[Run], b: &[Run], mut visit: impl FnMut(Run, u32)) {
    let mut first = 0;
    for x in a {
        // What ends before this run begins ends before all that follow.
        while first < b.len() && b[first].end < x.start {
            first += 1;
        }
        for y in &b[first..] {
            if y.start > x.end {
                break;
            }
            if y.id == x.id {
                visit(Run { start: x.start.max(y.start), end: x.end.min(y.end), ..*x }, y.number);
            }
        }
    }
}

/// The components of an image.
pub(crate) struct ImageComponents {
    slices: Vec<Slice>,
    /// In the order of their first voxels.
    pub list: Vec<ImageComponent>,
    /// The component of each id that has one alone.
    only: Vec<Option<u32>>,
}

impl ImageComponents {
    /// Finds the components of all labels but 0.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::OutOfMemory`]; [`Error::LimitReached`] for an image of more
    /// than 2^32 runs.
    pub fn new(image: &LabelImage, go_on: &(dyn Fn(usize) -> Result<()> + Sync)) -> Result<Self> {
        let [nx, ny, nz] = image.dims();
        let ids: Vec<&[u16]> = image.ids().chunks(nx * ny).collect();
        let runs_in = |ids: &&[u16]| {
            go_on(SLICE / 4)?;
            Ok(ids.chunks(nx).map(count_runs).sum())
        };
        let counts: Vec<usize> = ids.par_iter().map(runs_in).collect::<Result<_>>()?;
        let total: usize = counts.iter().sum();
        if u32::try_from(total).is_err() {
            return Err(Error::LimitReached("more than 4294967295 runs of equal voxels".into()));
        }
        let firsts: Vec<u32> = counts
            .iter()
            .scan(0, |next, &n| Some(std::mem::replace(next, *next + n as u32)))
            .collect();
        let slice = |k: usize| {
            go_on(SLICE / 4)?;
            Slice::new(ids[k], nx, counts[k], firsts[k])
        };
        let mut slices: Vec<Slice> = (0..nz).into_par_iter().map(slice).collect::<Result<_>>()?;
        let sets = UnionFind::new(total, "runs of equal voxels")?;
        let join = |k: usize| {
            go_on(SLICE / 4)?;
            join_slice(&slices[k], k.checked_sub(1).map(|below| &slices[below]), &sets)
        };
        // What each run contributes to the Euler characteristic of its component.
        let contributions: Vec<Vec<i32>> =
            (0..nz).into_par_iter().map(join).collect::<Result<_>>()?;
        let numbers = sets.numbered(|_| true, "runs of equal voxels", &|| go_on(0))?;

        let mut list: Vec<ImageComponent> = room(numbers.roots.len(), "components of the image")?;
        for (k, (slice, contributions)) in slices.iter_mut().zip(&contributions).enumerate() {
            go_on(SLICE / 4)?;
            let mut row = 0;
            for (r, (run, &euler)) in slice.runs.iter_mut().zip(contributions).enumerate() {
                while slice.ends[row] as usize <= r {
                    row += 1;
                }
                // A component's first run is that of its smallest number: components come in their
                // order.
                run.number = numbers.of(run.number);
                let component = run.number as usize;
                if component == list.len() {
                    list.push(ImageComponent {
                        id: run.id,
                        voxels: 0,
                        euler: 0,
                        first: [run.start as usize, row, k],
                    });
                }
                list[component].voxels += u64::from(run.end - run.start);
                list[component].euler += i64::from(euler);
            }
        }
        let mut counts = vec![0_u32; image.labels().len()];
        list.iter().for_each(|component| counts[usize::from(component.id)] += 1);
        let mut only = vec![None; counts.len()];
        for (c, component) in
            list.iter().enumerate().filter(|(_, component)| counts[usize::from(component.id)] == 1)
        {
            only[usize::from(component.id)] = Some(c as u32);
        }
        Ok(Self { slices, list, only })
    }

    /// The runs of voxels along x of the components that `wanted` is true of: the component, the
    /// first voxel's place in the image, and how many there are.
    pub fn runs<'a>(
        &'a self,
        [nx, ny, _]: [usize; 3],
        wanted: impl Fn(&ImageComponent) -> bool + 'a,
    ) -> impl Iterator<Item = (usize, usize, usize)> + 'a {
        let rows = self.slices.iter().flat_map(|slice| (0..slice.ends.len()).map(|j| slice.row(j)));
        debug_assert!(self.slices.iter().all(|slice| slice.ends.len() == ny));
        rows.enumerate().flat_map(|(row, runs)| runs.iter().map(move |run| (row, run))).filter_map(
            move |(row, run)| {
                let component = run.number as usize;
                let place = row * nx + run.start as usize;
                wanted(&self.list[component]).then_some((
                    component,
                    place,
                    (run.end - run.start) as usize,
                ))
            },
        )
    }

    /// The component of a voxel; `None` in the background and outside the image.
    #[inline]
    pub fn at(&self, [i, j, k]: [usize; 3]) -> Option<u32> {
        self.slices.get(k)?.run_at(i, j).map(|run| run.number)
    }

    /// The component of label id `id` at continuous index `p`: that of the voxel that holds it, or
    /// else of the nearest of the eight voxels around it.
    pub fn near(&self, image: &LabelImage, id: u16, p: DVec3) -> Option<u32> {
        let [nx, ny, nz] = image.dims();
        // The voxel with the whole part of a place as its index.
        let found = |place: DVec3| {
            if !place.cmpge(DVec3::ZERO).all() {
                return None;
            }
            let [i, j, k] = place.to_array().map(|x| x as usize);
            let inside = i < nx && j < ny && k < nz;
            (inside && image.ids()[i + nx * (j + ny * k)] == id).then_some([i, j, k])
        };
        let component = |voxel| self.only[usize::from(id)].or_else(|| self.at(voxel));
        if let Some(voxel) = found(p + 0.5) {
            return component(voxel);
        }
        let low = p.floor();
        let corners = (0..8_u32).map(|bits| {
            low + DVec3::new((bits & 1).into(), (bits >> 1 & 1).into(), (bits >> 2).into())
        });
        let distance = |voxel: &DVec3| ((*voxel - p) * image.frame().spacing()).length_squared();
        let with_id = corners.filter_map(|corner| Some((distance(&corner), found(corner)?)));
        with_id.min_by(|a, b| a.0.total_cmp(&b.0)).and_then(|(_, voxel)| component(voxel))
    }
}

/// Joins the runs of a slice with each other and with those of the slice below. Returns what each
/// contributes to the Euler characteristic.
fn join_slice(here: &Slice, below: Option<&Slice>, sets: &UnionFind) -> Result<Vec<i32>> {
    let mut euler: Vec<i32> = zeroed(here.runs.len(), "runs of equal voxels")?;
    euler.fill(1);
    let Some(first) = here.runs.first().map(|run| run.number) else { return Ok(euler) };
    let mut count = |run: Run, sign: i32| euler[(run.number - first) as usize] += sign;
    let (mut pairs, mut pairs_below): (Vec<Run>, Vec<Run>) = (Vec::new(), Vec::new());
    for j in 0..here.ends.len() {
        let (row, before): (&[Run], &[Run]) =
            (here.row(j), if j > 0 { here.row(j - 1) } else { &[] });
        let mut join = |a, b| {
            for_common(a, b, |run, other| {
                sets.join(run.number, other);
                count(run, -1);
            })
        };
        join(row, before);
        let Some(below) = below else { continue };
        let (row_below, before_below): (&[Run], &[Run]) =
            (below.row(j), if j > 0 { below.row(j - 1) } else { &[] });
        join(row, row_below);
        join(row, before_below);
        join(before, row_below);
        // What is common to three and four of the rows around the line.
        pairs.clear();
        for_common(row, before, |run, _| pairs.push(run));
        pairs_below.clear();
        for_common(row_below, before_below, |run, _| pairs_below.push(run));
        for_common(&pairs, row_below, |run, _| count(run, 1));
        for_common(&pairs, before_below, |run, _| count(run, 1));
        for_common(row, &pairs_below, |run, _| count(run, 1));
        for_common(before, &pairs_below, |run, _| count(run, 1));
        for_common(&pairs, &pairs_below, |run, _| count(run, -1));
    }
    Ok(euler)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::image::{Frame, phantom};
    use crate::mesh::testing;

    const DIMS: [usize; 3] = [7, 5, 4];

    /// Voxel (i, j, k) of `values`, 0 outside.
    fn value(values: &[i32], at: [isize; 3]) -> i32 {
        let inside = (0..3).all(|axis| (0..DIMS[axis] as isize).contains(&at[axis]));
        if inside {
            values[at[0] as usize + DIMS[0] * (at[1] as usize + DIMS[1] * at[2] as usize)]
        } else {
            0
        }
    }

    fn voxels() -> impl Iterator<Item = [isize; 3]> {
        let [nx, ny, nz] = DIMS.map(|n| n as isize);
        (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
    }

    /// The component of each voxel by flood fill, in the order of first voxels.
    fn flood_fill(values: &[i32]) -> BTreeMap<[isize; 3], usize> {
        let mut component = BTreeMap::new();
        let mut count = 0;
        for seed in voxels().filter(|&at| value(values, at) != 0).map(|[i, j, k]| [k, j, i]) {
            if component.contains_key(&seed) {
                continue;
            }
            let mut stack = vec![seed];
            while let Some([k, j, i]) = stack.pop() {
                if component.insert([k, j, i], count).is_some() {
                    continue;
                }
                let around = (0..27).map(|n| [i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1]);
                let same = around.filter(|&at| value(values, at) == value(values, [i, j, k]));
                stack.extend(same.map(|[i, j, k]| [k, j, i]));
            }
            count += 1;
        }
        component
    }

    proptest! {
        #[test]
        fn against_flood_fill_and_the_complex(
            values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2]),
        ) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let found = ImageComponents::new(&image, &|_| Ok(())).unwrap();
            let component = flood_fill(&values);
            let mut counts =
                vec![(0_u64, 0_i64); component.values().max().map_or(0, |last| last + 1)];
            for at in voxels() {
                let expected = component.get(&[at[2], at[1], at[0]]).map(|&c| c as u32);
                prop_assert_eq!(found.at(at.map(|i| i as usize)), expected);
                let Some(c) = expected else { continue };
                counts[c as usize].0 += 1;
                // Voxel, faces, edges and vertices of the closed box, each counted at the first
                // voxel of the component that has it: steps to the upper side, to the lower one, or
                // along.
                for sides in 0..27_isize {
                    let side = [sides % 3 - 1, sides / 3 % 3 - 1, sides / 9 - 1];
                    let sharing = (0..8_isize).map(|bits| {
                        [0, 1, 2].map(|axis| at[axis] + side[axis] * (bits >> axis & 1))
                    });
                    let mut with_label =
                        sharing.filter(|&other| value(&values, other) == value(&values, at));
                    let is_first = with_label.all(|[i, j, k]| [at[2], at[1], at[0]] <= [k, j, i]);
                    let sign =
                        if side.iter().filter(|&&s| s == 0).count() % 2 == 0 { 1 } else { -1 };
                    counts[c as usize].1 += if is_first { sign } else { 0 };
                }
            }
            prop_assert_eq!(
                found.list.iter().map(|c| (c.voxels, c.euler)).collect::<Vec<_>>(),
                counts
            );
            for (c, listed) in found.list.iter().enumerate() {
                let first = component
                    .iter()
                    .find(|&(_, &of)| of == c)
                    .map(|(&[k, j, i], _)| [i, j, k].map(|i| i as usize));
                prop_assert_eq!(Some(listed.first), first);
                prop_assert_eq!(
                    image.labels()[usize::from(listed.id)],
                    label(listed.first[0], listed.first[1], listed.first[2])
                );
            }
        }
    }

    proptest! {
        #[test]
        fn runs_are_found_in_rows_of_any_length(
            lengths in prop::collection::vec((1..150_usize, 0..3_u16), 1..60),
        ) {
            let row: Vec<u16> =
                lengths.iter().flat_map(|&(length, id)| vec![id; length]).collect();
            let mut at = 0;
            let runs = row.chunk_by(|a, b| a == b).map(|run| {
                at += run.len() as u32;
                (at - run.len() as u32, at, run[0])
            });
            let expected: Vec<_> = runs.filter(|run| run.2 != 0).collect();
            prop_assert_eq!(count_runs(&row), expected.len());
            prop_assert!(runs_of(&row).eq(expected));
        }
    }

    fn euler(image: &LabelImage) -> Vec<(i32, i64)> {
        let components = ImageComponents::new(image, &|_| Ok(())).unwrap();
        components.list.iter().map(|c| (image.labels()[usize::from(c.id)], c.euler)).collect()
    }

    #[test]
    fn phantoms_have_their_euler_characteristic() {
        let (dims, spacing) = ([40, 40, 30], [1.0; 3]);
        assert_eq!(euler(&phantom::ball(dims, spacing, 9.3).unwrap()), [(1, 1)]);
        assert_eq!(euler(&phantom::torus(dims, spacing, 12.0, 4.0).unwrap()), [(1, 0)]);
        // A ball, and shells with a cavity each; in the order of their first voxels.
        let shells = phantom::nested_shells(dims, spacing, &[4.0, 8.0, 12.5]).unwrap();
        assert_eq!(euler(&shells), [(3, 2), (2, 2), (1, 1)]);
        let two = |p: DVec3| {
            i32::from((p - DVec3::X * 8.0).length() < 6.5 || (p + DVec3::X * 8.0).length() < 6.5)
        };
        assert_eq!(euler(&phantom::sampled(dims, spacing, two).unwrap()), [(1, 1), (1, 1)]);
        assert!(euler(&phantom::ball([3; 3], spacing, 0.0).unwrap()).len() <= 1);
    }

    #[test]
    fn the_nearest_voxel_of_the_label() {
        let frame = Frame::axis_aligned([1.0, 1.0, 3.0]).unwrap();
        let label = |i: usize, j: usize, k: usize| [[1, 0, 2, 1], [0, 2, 0, 1]][(j + k) % 2][i];
        let image = testing::image([4, 2, 2], frame, label);
        let components = ImageComponents::new(&image, &|_| Ok(())).unwrap();
        let near = |id, x, y, z| {
            components
                .near(&image, id, DVec3::new(x, y, z))
                .map(|c| components.list[c as usize].first)
        };
        assert_eq!(near(1, 0.4, -0.4, 0.4), Some([0, 0, 0]));
        assert_eq!(near(1, 0.6, 0.4, 0.3), Some([0, 0, 0]));
        assert_eq!(near(1, 1.6, 0.4, 0.3), None);
        assert_eq!(near(2, 1.6, 0.4, 0.3), Some([2, 0, 0]));
        // (1, 1, 0) is the nearest, and joined to (2, 0, 0) across an edge.
        assert_eq!(near(2, 1.6, 0.8, 0.4), Some([2, 0, 0]));
        for outside in [-1.1, -1e300, f64::NAN, 1e300, f64::INFINITY] {
            assert_eq!(near(1, outside, 0.0, 0.0), None, "{outside}");
        }
    }

    #[test]
    fn any_number_of_threads_finds_the_same_components() {
        // A maze of slabs: long paths through many of them.
        let label = |i: usize, j: usize, k: usize| {
            let wall = j % 2 == 1 && i != (if j % 4 == 1 { 0 } else { 29 });
            if wall { 7 + (k % 3) as i32 } else { i32::from(k % 5 != 4) }
        };
        let image = testing::image([30, 21, 24], Frame::axis_aligned([1.0; 3]).unwrap(), label);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ImageComponents::new(&image, &|_| Ok(())).unwrap().list)
        };
        let list = on(1);
        let count = |id| list.iter().filter(|c| c.id == id).count();
        assert_eq!([1, 2, 3, 4].map(count), [5, 8 * 10, 8 * 10, 8 * 10]);
        (0..20).for_each(|_| assert_eq!(list, on(3)));
    }
}
