//! Exact anisotropic Euclidean feature transform on a coarse grid of nodes: the nearest cell of a set from each node.
//!
//! Source: C. R. Maurer, R. Qi, V. Raghavan, "A linear time algorithm for computing exact Euclidean distance transforms of binary
//! images in arbitrary dimensions", IEEE PAMI 25(2), 2003 (section 3; the voxel spacing of section 4); the lower envelope of
//! parabolas is that of P. Felzenszwalb, D. Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 8, 2012.
//!
//! Cells are the unit cubes between integer points; cell (i, j, k) has its centre at (i, j, k) + 1/2. Nodes are the integer points whose coordinates are
//! multiples of [`STEP`]. One pass per axis: after the pass along x each node of a row knows the nearest site of the row, after y that of the plane, after z that of
//! the grid. In a pass, the candidates along a line are parabolas (squared distance so far at their vertex); those that appear
//! in the lower envelope are found by one scan with a stack and read off, at the nodes only, by a second scan: linear time.
//!
//! **Between nodes** the squared distance s^2 to the nearest site is bounded from below by its values at the eight nodes around: s^2(x) - |x|^2 is the least of linear functions, one per site, so
//! it is concave and no less than its values at the nodes interpolated trilinearly. With |x|^2 interpolated on the way, for a point at parts u of a box with the edges L,
//! s^2(x) >= sum of w_n s^2(n) - sum over the axes of u (1 - u) L^2. When the eight nodes have one nearest site, this is an equation. The nearest of the eight nodes' sites is
//! nearly the nearest of all.
//!
//! Ties go to the site that comes first in the order z, y, x. Lines are independent of each other, so the result does not depend on the number
//! of threads. Cost: some nanoseconds per cell. Memory: 12 bytes per node kept, while it is built 8 for each node of each plane.

mod bricks;

pub use bricks::Bricks;
use glam::DVec3;
use rayon::prelude::*;

use crate::memory::filled;
use crate::{Error, Result};

/// Cells from one node to the next.
pub const STEP: usize = 4;

/// "No site in this row or plane", in the passes only.
const NONE: u32 = u32::MAX;

/// The nearest site of every node of a grid.
#[derive(Clone, Debug)]
pub struct FeatureTransform {
    /// Nodes along each axis.
    nodes: [usize; 3],
    spacing: DVec3,
    /// Sites by node: x fastest, then z, then y.
    sites: Vec<[u32; 3]>,
}

/// What the eight nodes around a point know of it.
#[derive(Clone, Copy, Debug)]
pub struct Around {
    /// A lower bound of the squared distance to the centre of the nearest site, in the units of the spacing; may be negative.
    pub squared_distance: f64,
    /// A site that is nearly the nearest.
    pub site: [u32; 3],
}

impl FeatureTransform {
    /// Computes the transform for `cells` cells along each axis. `row(y, z)` has a bit for each cell of a row that is a site, in words of 64; bits past the last cell are 0.
    /// `check` is called before each plane or layer of lines, from several threads; its error ends the computation.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`]: no cell, no site, or 2^32 - 1 cells or more along an axis; [`Error::OutOfMemory`]; whatever `check` returns.
    pub fn compute<'a>(
        cells: [usize; 3],
        spacing: [f64; 3],
        row: impl Fn(usize, usize) -> &'a [u64] + Sync,
        check: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let [nx, ny, nz] = cells;
        if nx == 0 || ny == 0 || nz == 0 || cells.iter().any(|&n| n >= NONE as usize) {
            return Err(Error::InvalidArgument(format!(
                "a feature transform takes from 1 to {} cells along each axis, got {nx} x {ny} x {nz}",
                NONE - 1
            )));
        }
        let nodes = cells.map(Self::nodes_along);
        let count = |sizes: [usize; 3]| sizes.iter().try_fold(1_usize, |n, &size| n.checked_mul(size));
        let too_many = || Error::OutOfMemory { count: usize::MAX, what: "nodes of the feature transform" };

        // Passes along x and y, plane by plane: the nearest site of the same plane.
        let plane = nodes[0] * nodes[1];
        let of_planes = count([nodes[0], nodes[1], nz]).ok_or_else(too_many)?;
        let mut in_plane = filled(of_planes, [NONE; 2], "nodes of the feature transform", check)?;
        in_plane.par_chunks_mut(plane).enumerate().try_for_each_init(
            || (vec![NONE; nodes[0] * ny], Envelope::default()),
            |(in_row, envelope), (z, plane)| {
                check()?;
                let mut any = false;
                for (y, nearest) in in_row.chunks_mut(nodes[0]).enumerate() {
                    any |= nearest_in_row(row(y, z), nearest);
                }
                for x in (0..nodes[0]).take_while(|_| any) {
                    envelope.clear();
                    let at = (STEP * x) as f64 * spacing[0];
                    for y in 0..ny {
                        let site = in_row[x + nodes[0] * y];
                        if site != NONE {
                            let height = squared(at - centre(site) * spacing[0]);
                            envelope.push(centre(y as u32) * spacing[1], height, [site, y as u32]);
                        }
                    }
                    envelope.sweep(nodes[1], STEP as f64 * spacing[1], |y, site| plane[x + nodes[0] * y] = site);
                }
                Ok(())
            },
        )?;
        if in_plane.iter().step_by(plane).all(|site| site[0] == NONE) {
            return Err(Error::InvalidArgument("the feature transform needs at least one site".into()));
        }

        // The pass along z.
        let mut sites = filled(count(nodes).ok_or_else(too_many)?, [0; 3], "nodes of the feature transform", check)?;
        sites.par_chunks_mut(nodes[0] * nodes[2]).enumerate().try_for_each_init(
            Envelope::default,
            |envelope, (y, out)| {
                check()?;
                for x in 0..nodes[0] {
                    envelope.clear();
                    let at = [x, y].map(|c| (STEP * c) as f64);
                    for z in 0..nz {
                        let site = in_plane[x + nodes[0] * (y + nodes[1] * z)];
                        if site[0] != NONE {
                            let height = [0, 1].map(|a| squared((at[a] - centre(site[a])) * spacing[a]));
                            envelope.push(
                                centre(z as u32) * spacing[2],
                                height[0] + height[1],
                                [site[0], site[1], z as u32],
                            );
                        }
                    }
                    envelope.sweep(nodes[2], STEP as f64 * spacing[2], |z, site| out[x + nodes[0] * z] = site);
                }
                Ok(())
            },
        )?;
        Ok(Self { nodes, spacing: spacing.into(), sites })
    }

    /// Nodes along an axis of some cells: from 0 to the end of the last cell or beyond.
    fn nodes_along(cells: usize) -> usize {
        cells.div_ceil(STEP) + 1
    }

    /// Bytes held, and more that [`FeatureTransform::compute`] needs, for a grid of cells.
    pub fn bytes_needed(cells: [usize; 3]) -> [u64; 2] {
        let [nx, ny, nz] = cells.map(|n| Self::nodes_along(n) as u64);
        [nx * ny * nz * size_of::<[u32; 3]>() as u64, nx * ny * cells[2] as u64 * size_of::<[u32; 2]>() as u64]
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.sites.len() * size_of::<[u32; 3]>()
    }

    /// The site nearest to node (i, j, k), which lies at [`STEP`] times these numbers.
    ///
    /// # Panics
    /// May panic when the node is outside the grid.
    #[inline]
    pub fn site(&self, [i, j, k]: [usize; 3]) -> [u32; 3] {
        self.sites[i + self.nodes[0] * (k + self.nodes[2] * j)]
    }

    /// What is known of a point of the box of all cells, see the head comment.
    pub fn around(&self, x: DVec3) -> Around {
        let at = x * (1.0 / STEP as f64);
        let low = [0, 1, 2].map(|a| (at[a] as usize).min(self.nodes[a] - 2));
        let part = (at - DVec3::from(low.map(|c| c as f64))).clamp(DVec3::ZERO, DVec3::ONE);
        let edge = self.spacing * STEP as f64;
        let mut squared_distance = -(part * (1.0 - part) * edge * edge).element_sum();
        let mut nearest = (f64::INFINITY, [0; 3]);
        for c in 0..8 {
            let bits = [c & 1, c >> 1 & 1, c >> 2];
            let node = [0, 1, 2].map(|a| low[a] + bits[a]);
            let site = self.site(node);
            let place = DVec3::from(site.map(centre));
            let weight: f64 = (0..3).map(|a| if bits[a] == 1 { part[a] } else { 1.0 - part[a] }).product();
            let from_node = (place - DVec3::from(node.map(|c| (STEP * c) as f64))) * self.spacing;
            squared_distance += weight * from_node.length_squared();
            let from_here = ((place - x) * self.spacing).length_squared();
            if from_here < nearest.0 {
                nearest = (from_here, site);
            }
        }
        Around { squared_distance, site: nearest.1 }
    }
}

fn squared(x: f64) -> f64 {
    x * x
}

#[inline(always)]
fn centre(cell: u32) -> f64 {
    f64::from(cell) + 0.5
}

/// For each node of a row its nearest site in the row, the left one on a tie; whether there is any.
fn nearest_in_row(row: &[u64], nearest: &mut [u32]) -> bool {
    if row.iter().all(|&word| word == 0) {
        nearest.fill(NONE);
        return false;
    }
    // The cells between a node and the next one are STEP bits of a word.
    const _: () = assert!(64 % STEP == 0 && STEP < 8);
    let cells =
        |n: usize| (row.get(STEP * n / 64).map_or(0, |word| word >> (STEP * n % 64)) & ((1 << STEP) - 1)) as u32;
    let mut left = NONE;
    for (n, out) in nearest.iter_mut().enumerate() {
        *out = left;
        let bits = cells(n);
        left = if bits != 0 { (STEP * n) as u32 + bits.ilog2() } else { left };
    }
    let mut right = NONE;
    for (n, out) in nearest.iter_mut().enumerate().rev() {
        let (bits, at) = (cells(n), (STEP * n) as u32);
        right = if bits != 0 { at + bits.trailing_zeros() } else { right };
        // From the node to the left cell's centre it is at - left - 1/2, to the right one's right - at + 1/2; nothing is farther than NONE.
        let is_left = *out != NONE && (right == NONE || at - *out - 1 <= right - at);
        *out = if is_left { *out } else { right };
    }
    true
}

/// The lower envelope of parabolas height + (q - position)^2 along a line; each belongs to a site.
struct Envelope<S> {
    stack: Vec<Parabola<S>>,
}

impl<S> Default for Envelope<S> {
    fn default() -> Self {
        Self { stack: Vec::new() }
    }
}

#[derive(Clone, Copy)]
struct Parabola<S> {
    position: f64,
    height: f64,
    site: S,
}

impl<S: Copy> Envelope<S> {
    fn clear(&mut self) {
        self.stack.clear();
    }

    /// Adds a parabola; positions must increase. Drops those before it that it hides from the envelope.
    #[inline]
    fn push(&mut self, position: f64, height: f64, site: S) {
        while let [.., u, v] = self.stack[..] {
            // v lies on or above the envelope of u and the new one (Maurer et al., RemoveFT).
            let (a, b) = (v.position - u.position, position - v.position);
            let c = a + b;
            if c * v.height - b * u.height - a * height - a * b * c < 0.0 {
                break;
            }
            self.stack.pop();
        }
        self.stack.push(Parabola { position, height, site });
    }

    /// Calls `assign` with each of `count` nodes of the line, `step` apart from 0 on, and the site of the lowest parabola there; the first on a tie.
    /// Without any parabola nothing is assigned.
    #[inline]
    fn sweep(&self, count: usize, step: f64, mut assign: impl FnMut(usize, S)) {
        let Some((&first, rest)) = self.stack.split_first() else { return };
        let mut rest = rest.iter();
        let (mut current, mut next) = (first, rest.next());
        for q in 0..count {
            let at = q as f64 * step;
            let value = |p: &Parabola<S>| p.height + squared(at - p.position);
            let mut lowest = value(&current);
            while let Some(&candidate) = next {
                let v = value(&candidate);
                if v >= lowest {
                    break;
                }
                (current, lowest, next) = (candidate, v, rest.next());
            }
            assign(q, current.site);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Rows of bits, as the transform takes them.
    fn rows(cells: [usize; 3], sites: &[bool]) -> Vec<Vec<u64>> {
        let words = cells[0].div_ceil(64);
        let row = |bits: &[bool]| {
            let mut row = vec![0; words];
            bits.iter().enumerate().for_each(|(i, &is_site)| row[i / 64] |= u64::from(is_site) << (i % 64));
            row
        };
        sites.chunks(cells[0]).map(row).collect()
    }

    fn transform(cells: [usize; 3], spacing: [f64; 3], sites: &[bool]) -> Result<FeatureTransform> {
        let rows = rows(cells, sites);
        FeatureTransform::compute(cells, spacing, |y, z| &rows[y + cells[1] * z], &|| Ok(()))
    }

    /// Nearest site by looking at all of them; the first in the order z, y, x on a tie.
    fn brute_force(cells: [usize; 3], spacing: DVec3, sites: &[bool], x: DVec3) -> ([u32; 3], f64) {
        let [nx, ny, _] = cells;
        let mut best = ([0; 3], f64::INFINITY);
        for at in (0..sites.len()).filter(|&at| sites[at]) {
            let site = [at % nx, at / nx % ny, at / nx / ny].map(|c| c as u32);
            let squared = ((DVec3::from(site.map(centre)) - x) * spacing).length_squared();
            if squared < best.1 {
                best = (site, squared);
            }
        }
        best
    }

    fn assert_exact(cells: [usize; 3], spacing: [f64; 3], sites: &[bool], ties: bool) {
        let ft = transform(cells, spacing, sites).unwrap();
        let spacing = DVec3::from(spacing);
        for k in 0..ft.nodes[2] {
            for j in 0..ft.nodes[1] {
                for i in 0..ft.nodes[0] {
                    let node = DVec3::from([i, j, k].map(|c| (STEP * c) as f64));
                    let (site, squared) = brute_force(cells, spacing, sites, node);
                    let got = ft.site([i, j, k]);
                    let distance = ((DVec3::from(got.map(centre)) - node) * spacing).length_squared();
                    assert!((distance - squared).abs() <= 1e-12 * squared, "{cells:?} {spacing:?} at {node}");
                    if ties {
                        assert_eq!(got, site, "{cells:?} {spacing:?} at {node}");
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn equals_brute_force(
            cells in prop_oneof![prop::array::uniform3(1_usize..12), Just([1, 17, 9]), Just([73, 1, 5]), Just([7, 19, 1]), Just([1, 1, 31])],
            spacing in prop::array::uniform3(0.1_f64..3.0),
            dyadic in prop::array::uniform3(1_u32..5),
            density in 0.003_f64..0.3,
            seed: u64,
        ) {
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            let mut sites: Vec<bool> = (0..cells.iter().product()).map(|_| random() > 1.0 - density).collect();
            let len = sites.len();
            sites[seed as usize % len] = true;
            assert_exact(cells, spacing, &sites, false);
            // Squared distances are exact here, so the rule for ties is seen.
            assert_exact(cells, dyadic.map(|d| f64::from(d) * 0.5), &sites, true);

            let ft = transform(cells, spacing, &sites).unwrap();
            for _ in 0..50 {
                let x = DVec3::new(random(), random(), random()) * DVec3::from(cells.map(|n| n as f64));
                let around = ft.around(x);
                let (_, squared) = brute_force(cells, spacing.into(), &sites, x);
                prop_assert!(around.squared_distance <= squared * (1.0 + 1e-12) + 1e-12);
                // No worse than what interpolation may lose.
                let edges = DVec3::from(spacing) * STEP as f64;
                let found = ((DVec3::from(around.site.map(centre)) - x) * DVec3::from(spacing)).length();
                prop_assert!(found <= squared.sqrt() + edges.length());
            }
        }
    }

    #[test]
    fn one_site_is_known_exactly_everywhere() {
        let mut sites = vec![false; 13 * 9 * 6];
        sites[77] = true;
        let (cells, spacing) = ([13, 9, 6], [0.3, 1.1, 2.0]);
        let ft = transform(cells, spacing, &sites).unwrap();
        for x in [DVec3::ZERO, DVec3::new(12.9, 8.2, 5.1), DVec3::new(4.4, 6.6, 3.3)] {
            let (site, squared) = brute_force(cells, spacing.into(), &sites, x);
            assert_eq!(ft.around(x).site, site);
            assert!((ft.around(x).squared_distance - squared).abs() < 1e-9);
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same() {
        let cells = [31, 22, 27];
        let sites: Vec<bool> = (0..31 * 22 * 27).map(|at: usize| at.wrapping_mul(2654435761) % 97 == 3).collect();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| transform(cells, [1.0, 1.0, 2.0], &sites).unwrap().sites)
        };
        assert_eq!(on(1), on(4));
    }

    #[test]
    fn refuses_what_it_cannot_do() {
        assert!(matches!(transform([2, 2, 1], [1.0; 3], &[false; 4]), Err(Error::InvalidArgument(_))));
        let none = FeatureTransform::compute([0, 2, 1], [1.0; 3], |_, _| &[], &|| Ok(()));
        assert!(matches!(none, Err(Error::InvalidArgument(_))));
        let cancelled = FeatureTransform::compute([4, 4, 4], [1.0; 3], |_, _| &[15], &|| Err(Error::Cancelled));
        assert!(matches!(cancelled, Err(Error::Cancelled)));
    }
}
