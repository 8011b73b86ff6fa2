//! Connected components per label, of the image and of the mesh.
//!
//! Voxels are joined across faces, tets across facets, each with neighbours of the same label only. The image is joined run by run along x (as in He, Chao,
//! Suzuki, "A run-based two-scan labeling algorithm", 2008), so that memory goes with the number of runs, not of voxels. A component is counted by counting
//! every set that there is and every union that is made; no labels of components are stored.
//!
//! Pure functions, parallel in the current rayon pool, practically linear. How many unions are made does not depend on their order, and volumes are
//! summed in the order of the tets, so equal input gives equal bits whatever the number of threads.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::quality::tet_volume;
use super::{NONE, TetMesh};
use crate::image::LabelImage;
use crate::memory::{room, zeroed};
use crate::monitor::Monitor;
use crate::{Error, Result};

/// Tets of one piece of work, between two looks at the cancel flag; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// Slices of voxels of one piece of work.
const SLAB: usize = 4;

/// A slice of voxels counts as this many pieces of work, a tet as one.
pub(super) const SLICE: usize = 4096;

/// Disjoint sets of the numbers from 0 on, which any number of threads may join at once.
///
/// Path halving and union by index (Tarjan and van Leeuwen 1984), the union by compare-and-swap of the root (Anderson and Woll, "Wait-free parallel
/// algorithms for the union-find problem", 1991). What must hold: a number that is no root never becomes one again, and what it points to is a smaller
/// number of the same set. So there are no cycles, a shortcut written late is still right, and of two threads that give a root a parent one fails and
/// looks again. Relaxed order suffices: the words carry no other data, and each is changed in one order that all threads agree on.
struct DisjointSets {
    /// How far below a number its parent is; 0 for a root. Zeroed memory holds sets of one.
    steps: Vec<AtomicU32>,
}

impl DisjointSets {
    /// As many sets of one.
    fn new(count: usize, what: &'static str) -> Result<Self> {
        Ok(Self { steps: zeroed(count, what)? })
    }

    fn root(&self, mut x: u32) -> u32 {
        loop {
            let step = self.steps[x as usize].load(Relaxed);
            let parent = x - step;
            let next = self.steps[parent as usize].load(Relaxed);
            if next == 0 {
                return parent;
            }
            self.steps[x as usize].store(step + next, Relaxed);
            x = parent - next;
        }
    }

    /// Joins two sets; whether they were different.
    fn join(&self, mut x: u32, mut y: u32) -> bool {
        loop {
            (x, y) = (self.root(x), self.root(y));
            if x == y {
                return false;
            }
            // The older one becomes the root, which keeps paths short in scan order.
            let (root, other) = (x.min(y), x.max(y));
            if self.steps[other as usize].compare_exchange(0, other - root, Relaxed, Relaxed).is_ok() {
                return true;
            }
        }
    }
}

/// Voxels and components of one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoxelCount {
    /// Voxels with the label.
    pub voxels: u64,
    /// Face-connected components they form.
    pub components: u64,
}

/// Voxels x in `start..end` of one row, all of one id.
struct Run {
    start: usize,
    end: usize,
    id: u16,
}

/// The runs of the object in one row of ids.
fn runs_of(row: &[u16]) -> impl Iterator<Item = Run> {
    let mut end = 0;
    let runs = row.chunk_by(|a, b| a == b).map(move |equal| {
        end += equal.len();
        Run { start: end - equal.len(), end, id: equal[0] }
    });
    runs.filter(|run| run.id != 0)
}

/// The runs of a slice of voxels.
struct Slice {
    runs: Vec<Run>,
    /// Where the runs of each row end.
    ends: Vec<usize>,
    /// The number of the first run's set; the others follow.
    first_set: usize,
}

impl Slice {
    fn new(ids: &[u16], width: usize, runs: usize, first_set: usize) -> Result<Self> {
        let mut slice = Self {
            runs: room(runs, "runs of equal voxels")?,
            ends: room(ids.len() / width, "rows of voxels")?,
            first_set,
        };
        for row in ids.chunks(width) {
            slice.runs.extend(runs_of(row));
            slice.ends.push(slice.runs.len());
        }
        Ok(slice)
    }

    /// The runs of a row, each with the number of its set.
    fn row(&self, j: usize) -> impl Iterator<Item = (&Run, u32)> + Clone {
        let start = if j == 0 { 0 } else { self.ends[j - 1] };
        self.runs[start..self.ends[j]].iter().zip((self.first_set + start) as u32..)
    }
}

/// Counts per dense id of `image`, id 0 left at zero.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]; [`Error::LimitReached`] for an image of more than 2^32 runs.
pub fn image_components(image: &LabelImage, monitor: &Monitor<'_>) -> Result<Vec<VoxelCount>> {
    let [nx, ny, nz] = image.dims();
    let slices: Vec<&[u16]> = image.ids().chunks(nx * ny).collect();
    let runs_in = |ids: &&[u16]| {
        monitor.advance(SLICE / 2)?;
        Ok(ids.chunks(nx).map(|row| runs_of(row).count()).sum())
    };
    let run_counts: Vec<usize> = slices.par_iter().map(runs_in).collect::<Result<_>>()?;
    let mut first_sets: Vec<usize> = Vec::with_capacity(nz);
    let total = run_counts.iter().fold(0, |first, runs| {
        first_sets.push(first);
        first + runs
    });
    if u32::try_from(total).is_err() {
        return Err(Error::LimitReached("more than 4294967295 runs of equal voxels".into()));
    }
    let sets = DisjointSets::new(total, "runs of equal voxels")?;
    let slice = |k: usize| Slice::new(slices[k], nx, run_counts[k], first_sets[k]);
    let no_counts = || vec![VoxelCount::default(); image.labels().len()];
    let slabs = (0..nz.div_ceil(SLAB)).into_par_iter().try_fold(no_counts, |mut counts, slab| {
        let slab = slab * SLAB..((slab + 1) * SLAB).min(nz);
        // The slice below belongs to another slab; only what it has in common with this one is counted here. So more sets may be joined than there are
        // runs, and components wrap around until all are added up.
        let mut below = slab.start.checked_sub(1).map(slice).transpose()?;
        for k in slab {
            monitor.advance(SLICE / 2)?;
            let here = slice(k)?;
            for run in &here.runs {
                counts[usize::from(run.id)].voxels += (run.end - run.start) as u64;
                let components = &mut counts[usize::from(run.id)].components;
                *components = components.wrapping_add(1);
            }
            for j in 0..ny {
                if let Some(j_before) = j.checked_sub(1) {
                    join_rows(here.row(j), here.row(j_before), &sets, &mut counts);
                }
                if let Some(below) = &below {
                    join_rows(here.row(j), below.row(j), &sets, &mut counts);
                }
            }
            below = Some(here);
        }
        Ok(counts)
    });
    slabs.try_reduce(no_counts, |mut counts, others| {
        for (count, other) in counts.iter_mut().zip(others) {
            count.voxels += other.voxels;
            count.components = count.components.wrapping_add(other.components);
        }
        Ok(counts)
    })
}

/// Joins the overlapping runs of equal id of two rows.
fn join_rows<'a>(
    runs: impl Iterator<Item = (&'a Run, u32)>,
    mut others: impl Iterator<Item = (&'a Run, u32)> + Clone,
    sets: &DisjointSets,
    counts: &mut [VoxelCount],
) {
    for (run, set) in runs {
        // What ends before this run ends before all that follow.
        let mut rest = others.clone();
        while let Some((other, other_set)) = rest.next() {
            if other.end <= run.start {
                others = rest.clone();
            } else if other.start >= run.end {
                break;
            } else if other.id == run.id && sets.join(set, other_set) {
                let components = &mut counts[usize::from(run.id)].components;
                *components = components.wrapping_sub(1);
            }
        }
    }
}

/// Tets, volume and components of one label.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TetCount {
    /// The label.
    pub label: i32,
    /// Tets with the label.
    pub tets: u64,
    /// Their volume.
    pub volume: f64,
    /// Components they form, joined across facets.
    pub components: u64,
}

/// The counts of some labels, in increasing order of label. Within a part of the mesh more sets may be joined than there are tets, so that components wrap
/// around until all are added up.
#[derive(Default)]
struct TetCounts(Vec<TetCount>);

impl TetCounts {
    /// The place of a label's count, which is made if there is none.
    fn place(&mut self, label: i32) -> usize {
        self.0.binary_search_by_key(&label, |count| count.label).unwrap_or_else(|at| {
            self.0.insert(at, TetCount { label, ..TetCount::default() });
            at
        })
    }

    fn add(&mut self, other: &TetCount) {
        let at = self.place(other.label);
        let count = &mut self.0[at];
        count.tets += other.tets;
        count.volume += other.volume;
        count.components = count.components.wrapping_add(other.components);
    }
}

/// Counts per label of `mesh` in increasing order of label, label 0 left out.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn mesh_components(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Vec<TetCount>> {
    let sets = DisjointSets::new(mesh.tets.len(), "sets of tets")?;
    let count_chunk = |chunk: usize| {
        let tets = chunk * CHUNK..((chunk + 1) * CHUNK).min(mesh.tets.len());
        monitor.advance(tets.len())?;
        let mut counts = TetCounts::default();
        let mut at = 0;
        for t in tets {
            let label = mesh.labels[t];
            if label == 0 {
                continue;
            }
            // Neighbours mostly have the same label.
            if counts.0.get(at).is_none_or(|count| count.label != label) {
                at = counts.place(label);
            }
            let count = &mut counts.0[at];
            count.tets += 1;
            count.volume += tet_volume(&mesh.tets[t].map(|v| mesh.point(v)));
            // Each pair once.
            let joined = mesh.neighbors[t].into_iter().filter(|&u| {
                u != NONE && (u as usize) < t && mesh.labels[u as usize] == label && sets.join(t as u32, u)
            });
            count.components = count.components.wrapping_add(1).wrapping_sub(joined.count() as u64);
        }
        Ok(counts)
    };
    let chunks: Vec<TetCounts> =
        (0..mesh.tets.len().div_ceil(CHUNK)).into_par_iter().map(count_chunk).collect::<Result<_>>()?;
    let mut all = TetCounts::default();
    chunks.iter().flat_map(|chunk| &chunk.0).for_each(|count| all.add(count));
    Ok(all.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing;
    use super::*;
    use crate::image::Frame;

    /// Components of equal values by flood fill over any adjacency.
    fn flood_fill(values: &[i32], neighbors: impl Fn(usize) -> Vec<usize>) -> std::collections::BTreeMap<i32, u64> {
        let mut seen = vec![false; values.len()];
        let mut counts = std::collections::BTreeMap::new();
        for seed in 0..values.len() {
            if std::mem::replace(&mut seen[seed], true) {
                continue;
            }
            *counts.entry(values[seed]).or_default() += 1;
            let mut stack = vec![seed];
            while let Some(x) = stack.pop() {
                for y in neighbors(x) {
                    if values[y] == values[x] && !std::mem::replace(&mut seen[y], true) {
                        stack.push(y);
                    }
                }
            }
        }
        counts.remove(&0);
        counts
    }

    const DIMS: [usize; 3] = [7, 5, 4];

    proptest! {
        #[test]
        fn against_flood_fill(values in prop::collection::vec(0..3i32, DIMS[0] * DIMS[1] * DIMS[2])) {
            let label = |i: usize, j: usize, k: usize| values[i + DIMS[0] * (j + DIMS[1] * k)];
            let image = testing::image(DIMS, Frame::axis_aligned([1.0; 3]).unwrap(), label);
            let counts = image_components(&image, &Monitor::silent()).unwrap();
            let expected = flood_fill(&values, |x| {
                let c = [x % DIMS[0], x / DIMS[0] % DIMS[1], x / (DIMS[0] * DIMS[1])];
                let step = [1, DIMS[0], DIMS[0] * DIMS[1]];
                (0..3)
                    .flat_map(|a| [(c[a] > 0).then(|| x - step[a]), (c[a] + 1 < DIMS[a]).then(|| x + step[a])])
                    .flatten()
                    .collect()
            });
            for (count, label) in counts.iter().zip(image.labels()) {
                prop_assert_eq!(count.components, expected.get(label).copied().unwrap_or(0));
                let voxels = values.iter().filter(|&v| v == label && *v != 0).count() as u64;
                prop_assert_eq!(count.voxels, voxels);
            }

            // The cubes of a Kuhn mesh share whole faces, so its components are those of the voxels.
            let mesh = testing::kuhn_box(DIMS, [1.0; 3], label);
            let tets = mesh_components(&mesh, &Monitor::silent()).unwrap();
            prop_assert_eq!(tets.iter().map(|c| (c.label, c.components)).collect::<std::collections::BTreeMap<_, _>>(), expected);
            for count in tets {
                let voxels = values.iter().filter(|&&v| v == count.label).count() as u64;
                prop_assert_eq!(count.tets, 6 * voxels);
                prop_assert!((count.volume - voxels as f64).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn any_number_of_threads_joins_the_same_sets() {
        // A maze of slabs and chunks: long paths through many of them.
        let label = |i: usize, j: usize, k: usize| {
            let wall = j % 2 == 1 && i != (if j % 4 == 1 { 0 } else { 29 });
            if wall { 7 + (k % 2) as i32 } else { i32::from(k % 5 != 4) }
        };
        let image = testing::image([30, 21, 24], Frame::axis_aligned([1.0; 3]).unwrap(), label);
        let mut mesh = testing::kuhn_box([30, 21, 24], [0.3, 0.7, 1.1], label);
        mesh.points.iter_mut().enumerate().for_each(|(v, p)| p[0] += 1e-3 * (v % 17) as f64);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let monitor = Monitor::silent();
            pool.install(|| (image_components(&image, &monitor).unwrap(), mesh_components(&mesh, &monitor).unwrap()))
        };
        let (voxels, tets) = on(1);
        assert!(mesh.tets.len() > 3 * CHUNK);
        assert_eq!(voxels.iter().map(|c| c.components).collect::<Vec<_>>(), [0, 5, 12 * 10, 12 * 10]);
        assert_eq!(tets.iter().map(|c| (c.label, c.components)).collect::<Vec<_>>(), [(1, 5), (7, 120), (8, 120)]);
        for _ in 0..20 {
            assert_eq!((voxels.clone(), tets.clone()), on(3));
        }
    }

    #[test]
    fn sets_joined_by_many_threads_at_once() {
        let sets = DisjointSets::new(10_000, "numbers").unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        // Each thread joins x with x + 7, in another order: 7 sets remain.
        let joins = pool.install(|| {
            let order = |n: u32| (0..9_993_u32).map(move |i| i * (2 * n + 1) % 9_993);
            let joined = |n| order(n).filter(|&x| sets.join(x, x + 7)).count();
            (0..6_u32).into_par_iter().map(joined).sum::<usize>()
        });
        let roots = (0..10_000).filter(|&x| sets.root(x) == x).count();
        assert_eq!((roots, joins), (7, 10_000 - 7));
    }
}
