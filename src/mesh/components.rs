//! Connected components per label, of the image and of the mesh.
//!
//! Voxels are joined across faces, tets across facets, each with neighbours of the same label only. Disjoint sets with path halving
//! and union by index (Tarjan and van Leeuwen 1984); the image is joined run by run along x (as in He, Chao, Suzuki, "A run-based two-scan
//! labeling algorithm", 2008), so that memory goes with the number of runs, not of voxels. A component is counted by counting every set
//! that is opened and every union that is made; no labels of components are stored.
//!
//! Pure functions, sequential, practically linear.

use super::{NONE, TetMesh};
use crate::image::LabelImage;
use crate::memory::filled;
use crate::monitor::Monitor;
use crate::{Error, Result};

/// Tets between two looks at the cancel flag.
const CHUNK: usize = 1 << 12;

/// A slice of voxels counts as this many pieces of work, a tet as one.
pub(super) const SLICE: usize = 4096;

/// Disjoint sets of numbers that are handed out in order.
#[derive(Default)]
struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// The number of a new set of one.
    fn open(&mut self) -> Result<u32> {
        let set = u32::try_from(self.parent.len())
            .map_err(|_| Error::LimitReached("more than 4294967295 runs of equal voxels".into()))?;
        self.parent
            .try_reserve(1)
            .map_err(|_| Error::OutOfMemory { count: set as usize, what: "runs of equal voxels" })?;
        self.parent.push(set);
        Ok(set)
    }

    fn root(&mut self, mut x: u32) -> u32 {
        while self.parent[x as usize] != x {
            let grandparent = self.parent[self.parent[x as usize] as usize];
            self.parent[x as usize] = grandparent;
            x = grandparent;
        }
        x
    }

    /// Joins two sets; whether they were different.
    fn join(&mut self, x: u32, y: u32) -> bool {
        let (x, y) = (self.root(x), self.root(y));
        // The older one becomes the root, which keeps paths short in scan order.
        self.parent[x.max(y) as usize] = x.min(y);
        x != y
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
    set: u32,
}

/// Counts per dense id of `image`, id 0 left at zero.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`]; [`Error::LimitReached`] for an image of more than 2^32 runs.
pub fn image_components(image: &LabelImage, monitor: &Monitor<'_>) -> Result<Vec<VoxelCount>> {
    let [nx, ny, _] = image.dims();
    let mut counts = vec![VoxelCount::default(); image.labels().len()];
    let mut sets = DisjointSets::default();
    // The runs of the slice before, and of this one as far as it is scanned; by row.
    let mut before: Vec<Vec<Run>> = Vec::new();
    for slice in image.ids().chunks(nx * ny) {
        monitor.advance(SLICE)?;
        let mut rows: Vec<Vec<Run>> = Vec::with_capacity(ny);
        for (j, row) in slice.chunks(nx).enumerate() {
            let mut runs = Vec::new();
            let mut start = 0;
            for equal in row.chunk_by(|a, b| a == b) {
                let (end, id) = (start + equal.len(), equal[0]);
                if id != 0 {
                    runs.push(Run { start, end, id, set: sets.open()? });
                    counts[usize::from(id)].voxels += equal.len() as u64;
                    counts[usize::from(id)].components += 1;
                }
                start = end;
            }
            let row_below = j.checked_sub(1).map(|j| &rows[j]);
            for other in [row_below, before.get(j)].into_iter().flatten() {
                join_rows(&runs, other, &mut sets, &mut counts);
            }
            rows.push(runs);
        }
        before = rows;
    }
    Ok(counts)
}

/// Joins the overlapping runs of equal id of two rows.
fn join_rows(runs: &[Run], others: &[Run], sets: &mut DisjointSets, counts: &mut [VoxelCount]) {
    let mut first = 0;
    for run in runs {
        while first < others.len() && others[first].end <= run.start {
            first += 1;
        }
        for other in others[first..].iter().take_while(|other| other.start < run.end) {
            if other.id == run.id && sets.join(run.set, other.set) {
                counts[usize::from(run.id)].components -= 1;
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

/// Counts per label of `mesh` in increasing order of label, label 0 left out.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn mesh_components(mesh: &TetMesh, monitor: &Monitor<'_>) -> Result<Vec<TetCount>> {
    // Neighbours mostly have the same label, and there are few.
    let mut labels = Vec::new();
    for part in mesh.labels.chunks(CHUNK) {
        monitor.check_cancelled()?;
        for run in part.chunk_by(|a, b| a == b) {
            if run[0] != 0
                && let Err(at) = labels.binary_search(&run[0])
            {
                labels.insert(at, run[0]);
            }
        }
    }
    let mut counts: Vec<TetCount> = labels.iter().map(|&label| TetCount { label, ..TetCount::default() }).collect();
    let mut sets = DisjointSets { parent: filled(mesh.tets.len(), 0, "sets of tets", || monitor.advance(0))? };
    for (t, (tet, &label)) in mesh.tets.iter().zip(&mesh.labels).enumerate() {
        if t % CHUNK == 0 {
            monitor.advance(CHUNK)?;
        }
        // Only tets before this one are joined below.
        sets.parent[t] = t as u32;
        let Ok(row) = labels.binary_search(&label) else { continue };
        let count = &mut counts[row];
        count.tets += 1;
        count.components += 1;
        count.volume += super::quality::tet_volume(&tet.map(|v| mesh.point(v)));
        for &u in &mesh.neighbors[t] {
            // Each pair once, and only with a set that is counted already.
            if u != NONE && (u as usize) < t && mesh.labels[u as usize] == label && sets.join(t as u32, u) {
                count.components -= 1;
            }
        }
    }
    Ok(counts)
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
}
