//! Nearest triangle of a set, by bins: the triangles of each brick of cells of the image's grid.
//!
//! A triangle is listed in every brick that its bounding box, widened by a reach, overlaps. Who
//! asks for many points of a brick goes over its list once and finds all triangles within the
//! reach; [`TriangleBins::nearest`] answers for one point, however far away the triangles are: it
//! looks at bricks in growing shells, those apart that cannot hold anything nearer. The bricks at
//! the rim stand for all that is beyond them. A query may ask for triangles of one label alone: a
//! bit for every 64th label tells in which bricks there may be some.
//!
//! Built by a counting sort, in parallel in the current rayon pool; read-only afterwards, so any
//! number of threads may ask. Lists are in the order of the triangles: of several that are equally
//! near, any number of threads finds the same. Distance to a triangle: Ericson, "Real-Time
//! Collision Detection", 2005, section 5.1.5.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::voxel_faces::{BRICK, VoxelFaces};
use crate::geometry::shape::closest_point;
use crate::memory::{parts, room, zeroed};
use crate::monitor::Monitor;
use crate::{Error, Result};

/// Triangles of one piece of work.
const CHUNK: usize = 1 << 12;

/// Bricks of one piece of work.
const BRICKS: usize = 1 << 10;

/// An interface facet in the coordinates of [`VoxelFaces`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Triangle {
    pub corners: [DVec3; 3],
    /// The ids of the labels on its two sides.
    pub ids: [u16; 2],
    /// The components of the mesh there; [`NO_SET`](crate::reduce::NO_SET) for background.
    pub components: [u32; 2],
}

impl Triangle {
    /// Corners of the box around it.
    #[inline]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.corners;
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// Centre and radius of a sphere around it.
    fn sphere(&self) -> [f32; 4] {
        let centre = (self.corners.iter().sum::<DVec3>() / 3.0).as_vec3();
        let radius = self.corners.iter().map(|c| c.distance(centre.as_dvec3())).fold(0.0, f64::max);
        // Rounding to f32, and that of the distance to it, must leave the corners inside.
        [centre.x, centre.y, centre.z, (radius * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE]
    }

    /// Squared distance from `p`.
    #[inline]
    pub fn distance_squared(&self, p: DVec3) -> f64 {
        p.distance_squared(closest_point(&self.corners, p))
    }
}

/// The bit of a label among the labels of a brick. Not inlined: where no label is asked for, the
/// bit of whatever stands in the place of its id would be set in a word that has them all, which
/// changes nothing, but is a use of what was never written to a checker of memory.
#[inline(never)]
fn bit(id: u16) -> u64 {
    1 << (id % 64)
}

/// A triangle and its squared distance from the point that was asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    pub triangle: u32,
    pub distance_squared: f64,
}

/// The triangles by brick.
pub(crate) struct TriangleBins {
    pub triangles: Vec<Triangle>,
    /// Centre and radius of a sphere around each.
    spheres: Vec<[f32; 4]>,
    /// World size of a brick.
    size: DVec3,
    dims: [usize; 3],
    /// Where the list of each brick ends.
    ends: Vec<u32>,
    lists: Vec<u32>,
    /// The bits of all labels in each brick.
    labels: Vec<u64>,
    /// Whether any triangle has label id `i`.
    has_id: Vec<AtomicBool>,
}

impl TriangleBins {
    /// Bytes for so many triangles, beside the lists of the bricks.
    pub fn bytes(triangles: usize) -> u64 {
        (triangles * (size_of::<Triangle>() + size_of::<[f32; 4]>())) as u64
    }

    /// Takes finite, possibly degenerate triangles, into the bricks of `faces`; each is listed
    /// where it comes within `reach`. `check_memory` is told the bytes of the lists before they are
    /// taken.
    ///
    /// # Errors
    /// [`Error::Cancelled`], [`Error::OutOfMemory`]; [`Error::LimitReached`] for lists of more than
    /// 2^32 triangles; those of `check_memory`.
    pub fn new(
        triangles: Vec<Triangle>,
        faces: &VoxelFaces<'_>,
        reach: f64,
        check_memory: &dyn Fn(u64) -> Result<()>,
        monitor: &Monitor<'_>,
    ) -> Result<Self> {
        let dims = faces.brick_dims();
        let size = faces.spacing() * BRICK as f64;
        let mut ends: Vec<AtomicU32> =
            zeroed(dims[0] * dims[1] * dims[2] + 1, "bricks of triangles")?;
        let each = |visit: &(dyn Fn(usize, u32) + Sync)| {
            triangles.par_chunks(CHUNK).enumerate().try_for_each(|(chunk, part)| {
                monitor.advance(0)?;
                for (triangle, number) in part.iter().zip((chunk * CHUNK) as u32..) {
                    let (low, high) = triangle.bounds();
                    let (low, high) = ((low - reach) / size, (high + reach) / size);
                    let [x, y, z] = [0, 1, 2]
                        .map(|axis| within(low[axis], dims[axis])..=within(high[axis], dims[axis]));
                    for k in z {
                        for j in y.clone() {
                            x.clone().for_each(|i| visit(i + dims[0] * (j + dims[1] * k), number));
                        }
                    }
                }
                Ok(())
            })
        };
        each(&|brick, _| _ = ends[brick + 1].fetch_add(1, Relaxed))?;
        let mut total = 0_u32;
        for end in &mut ends {
            let end = end.get_mut();
            let sum = total.checked_add(*end);
            total = sum.ok_or_else(|| {
                Error::LimitReached("more than 4294967295 triangles in bricks".into())
            })?;
            *end = total;
        }
        check_memory(u64::from(total) * size_of::<u32>() as u64)?;
        // `ends[b]` grows from the start of b's list to its end.
        let lists: Vec<AtomicU32> = zeroed(total as usize, "triangles of bricks")?;
        each(&|brick, number| {
            lists[ends[brick].fetch_add(1, Relaxed) as usize].store(number, Relaxed)
        })?;
        let mut lists: Vec<u32> = lists.into_iter().map(AtomicU32::into_inner).collect();
        let mut ends: Vec<u32> = ends.into_iter().map(AtomicU32::into_inner).collect();
        ends.pop();
        // With several threads the triangles of a brick come in no particular order.
        sort_parts(&mut lists, &ends, || monitor.advance(0))?;
        monitor.advance(0)?;
        let has_id: Vec<AtomicBool> = zeroed(usize::from(u16::MAX) + 1, "labels of triangles")?;
        triangles.par_iter().flat_map_iter(|triangle| triangle.ids).for_each(|id| {
            // Most are marked already: looking first lets threads share what they only read.
            if !has_id[usize::from(id)].load(Relaxed) {
                has_id[usize::from(id)].store(true, Relaxed);
            }
        });
        monitor.advance(0)?;
        let mut spheres: Vec<[f32; 4]> = zeroed(triangles.len(), "spheres of triangles")?;
        spheres
            .par_iter_mut()
            .zip(&triangles)
            .for_each(|(sphere, triangle)| *sphere = triangle.sphere());
        monitor.advance(0)?;
        let mut bins =
            Self { triangles, spheres, size, dims, ends, lists, labels: Vec::new(), has_id };
        let labels = |brick| {
            bins.list(brick).fold(0, |all, (_, t)| t.ids.iter().fold(all, |all, &id| all | bit(id)))
        };
        let bricks = dims[0] * dims[1] * dims[2];
        let mut of_bricks = room(bricks, "labels of bricks")?;
        (0..bricks).into_par_iter().map(labels).collect_into_vec(&mut of_bricks);
        bins.labels = of_bricks;
        Ok(bins)
    }

    /// The triangles listed in a brick, each with its number.
    #[inline]
    pub fn list(&self, brick: usize) -> impl Iterator<Item = (u32, &Triangle)> {
        self.numbers(brick).iter().map(|&number| (number, &self.triangles[number as usize]))
    }

    #[inline]
    fn numbers(&self, brick: usize) -> &[u32] {
        let start = if brick == 0 { 0 } else { self.ends[brick - 1] };
        &self.lists[start as usize..self.ends[brick] as usize]
    }

    /// The triangle nearest to `p`, or the nearest of those with label id `id` on one side; `start`
    /// is one of them that is thought to be near, and changes only the time taken. `None` if there
    /// is none.
    pub fn nearest(&self, id: Option<u16>, p: DVec3, start: Option<u32>) -> Option<Nearest> {
        if self.triangles.is_empty()
            || id.is_some_and(|id| !self.has_id[usize::from(id)].load(Relaxed))
        {
            return None;
        }
        let mut best = match start {
            Some(triangle) => Nearest {
                triangle,
                distance_squared: self.triangles[triangle as usize].distance_squared(p),
            },
            None => Nearest { triangle: u32::MAX, distance_squared: f64::INFINITY },
        };
        let centre = [0, 1, 2].map(|axis| within(p[axis] / self.size[axis], self.dims[axis]));
        for shell in 0.. {
            let range = [0, 1, 2].map(|axis| {
                (
                    centre[axis].saturating_sub(shell),
                    (centre[axis] + shell).min(self.dims[axis] - 1),
                )
            });
            for k in range[2].0..=range[2].1 {
                for j in range[1].0..=range[1].1 {
                    let inner = k.abs_diff(centre[2]) < shell && j.abs_diff(centre[1]) < shell;
                    // Of a row within the shell only its ends.
                    let step = if inner { (2 * shell).max(1) } else { 1 };
                    let first =
                        if inner && centre[0] < shell { centre[0] + shell } else { range[0].0 };
                    for i in (first..=range[0].1).step_by(step) {
                        self.search([i, j, k], id, p, &mut best);
                    }
                }
            }
            // Where the shell touches the rim of the grid there is nothing beyond.
            let beyond = (0..3).fold(f64::INFINITY, |nearest, axis| {
                let [low, high] = self.extent(axis, range[axis]);
                nearest.min(p[axis] - low).min(high - p[axis])
            });
            if beyond.is_infinite() || beyond > 0.0 && beyond * beyond >= best.distance_squared {
                break;
            }
        }
        (best.triangle != u32::MAX).then_some(best)
    }

    /// The range of bricks along an axis, those at the rim without end.
    #[inline]
    fn extent(&self, axis: usize, (first, last): (usize, usize)) -> [f64; 2] {
        let low = if first == 0 { f64::NEG_INFINITY } else { first as f64 * self.size[axis] };
        let high = if last + 1 == self.dims[axis] {
            f64::INFINITY
        } else {
            (last + 1) as f64 * self.size[axis]
        };
        [low, high]
    }

    /// Looks at the triangles of a brick, if they may be nearer than `best`.
    fn search(&self, at: [usize; 3], id: Option<u16>, p: DVec3, best: &mut Nearest) {
        let brick = at[0] + self.dims[0] * (at[1] + self.dims[1] * at[2]);
        if self.labels[brick] & id.map_or(u64::MAX, bit) == 0 {
            return;
        }
        let [x, y, z] = [0, 1, 2].map(|axis| self.extent(axis, (at[axis], at[axis])));
        let (low, high) = (DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1]));
        if p.distance_squared(p.clamp(low, high)) >= best.distance_squared {
            return;
        }
        let mut reach = best.distance_squared.sqrt();
        for &number in self.numbers(brick) {
            // Most are seen to be too far by a few bytes.
            let [x, y, z, radius] = self.spheres[number as usize].map(f64::from);
            if p.distance_squared(DVec3::new(x, y, z)) > (reach + radius) * (reach + radius) {
                continue;
            }
            let triangle = &self.triangles[number as usize];
            let (low, high) = triangle.bounds();
            if id.is_some_and(|id| !triangle.ids.contains(&id))
                || p.distance_squared(p.clamp(low, high)) >= best.distance_squared
            {
                continue;
            }
            let distance_squared = triangle.distance_squared(p);
            if distance_squared < best.distance_squared {
                *best = Nearest { triangle: number, distance_squared };
                reach = distance_squared.sqrt();
            }
        }
    }
}

/// Sorts each part of a list, of which `ends` has the ends.
///
/// # Errors
/// Those of `go_on`, which is asked every some thousand numbers.
fn sort_parts(list: &mut [u32], ends: &[u32], go_on: impl Fn() -> Result<()> + Sync) -> Result<()> {
    let first_of = |piece: usize| (piece * BRICKS).checked_sub(1).map_or(0, |before| ends[before]);
    let lengths = ends
        .chunks(BRICKS)
        .enumerate()
        .map(|(n, ends)| (ends[ends.len() - 1] - first_of(n)) as usize);
    let pieces = parts(list, lengths, "pieces of the lists of bricks")?;
    pieces.into_par_iter().zip(ends.par_chunks(BRICKS)).enumerate().try_for_each(
        |(n, (piece, ends))| {
            go_on()?;
            let (first, mut start) = (first_of(n), 0);
            for end in ends.iter().map(|end| (end - first) as usize) {
                piece[start..end].sort_unstable();
                start = end;
            }
            Ok(())
        },
    )
}

/// The brick, of `n`, that holds a coordinate in bricks, or the first or last one. (`as`
/// saturates.)
#[inline]
fn within(x: f64, n: usize) -> usize {
    (x.max(0.0) as usize).min(n - 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::image::Frame;
    use crate::mesh::testing;
    use crate::reduce::NO_SET;

    fn point() -> impl Strategy<Value = DVec3> {
        [-4..=4i32, -4..=4, -4..=4]
            .prop_map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into()) * 0.5)
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        [point(), point(), point()]
    }

    /// Labels of which two have the same bit.
    fn labelled() -> impl Strategy<Value = Triangle> {
        let id = || prop::sample::select(vec![1, 2, 3, 65]);
        (triangle(), [id(), id()]).prop_map(|(corners, ids)| Triangle {
            corners,
            ids,
            components: [NO_SET; 2],
        })
    }

    proptest! {
        /// Against all of them; the grid of bricks is smaller than what the triangles fill.
        #[test]
        fn nearest_against_all(
            triangles in prop::collection::vec(labelled(), 1..60),
            p in point(),
            start in 0u32..60,
        ) {
            let triangles: Vec<Triangle> = triangles
                .into_iter()
                .map(|t| Triangle { corners: t.corners.map(|c| c * 8.0), ..t })
                .collect();
            let p = p * 8.0;
            let of = |wanted: &dyn Fn(&Triangle) -> bool| {
                triangles
                    .iter()
                    .filter(|t| wanted(t))
                    .map(|t| t.distance_squared(p))
                    .fold(f64::INFINITY, f64::min)
            };
            let image = testing::image(
                [12, 20, 9],
                Frame::axis_aligned([1.0, 0.5, 2.0]).unwrap(),
                |_, _, _| 1,
            );
            let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
            let (any, silent) = (&|_| Ok(()), &Monitor::silent());
            let bins = TriangleBins::new(triangles.clone(), &faces, 0.5, any, silent).unwrap();
            for id in [None, Some(1), Some(65), Some(2)] {
                let wanted = |t: &Triangle| id.is_none_or(|id| t.ids.contains(&id));
                let start =
                    Some(start).filter(|&start| triangles.get(start as usize).is_some_and(wanted));
                let found = bins.nearest(id, p, start);
                prop_assert_eq!(
                    found.map_or(f64::INFINITY, |found| found.distance_squared),
                    of(&wanted)
                );
                prop_assert!(
                    found.is_none_or(|found| wanted(&bins.triangles[found.triangle as usize]))
                );
            }
        }
    }

    #[test]
    fn every_triangle_is_in_the_bricks_that_it_reaches() {
        let image =
            testing::image([30, 30, 30], Frame::axis_aligned([1.0; 3]).unwrap(), |_, _, _| 1);
        let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
        let at = |x: f64| Triangle {
            corners: [DVec3::splat(x), DVec3::splat(x) + DVec3::X, DVec3::splat(x)],
            ids: [1, 0],
            components: [NO_SET; 2],
        };
        let triangles: Vec<Triangle> = (0..60).map(|i| at(0.5 * f64::from(i))).collect();
        let bins =
            TriangleBins::new(triangles.clone(), &faces, 0.25, &|_| Ok(()), &Monitor::silent())
                .unwrap();
        let [nx, ny, nz] = faces.brick_dims();
        for brick in 0..nx * ny * nz {
            let low = DVec3::from(
                [brick % nx, brick / nx % ny, brick / (nx * ny)].map(|i| (i * BRICK) as f64),
            );
            let expected: Vec<u32> = (0..60)
                .filter(|&i| {
                    let (min, max) = triangles[i as usize].bounds();
                    (min - 0.25).cmplt(low + BRICK as f64).all() && (max + 0.25).cmpge(low).all()
                })
                .collect();
            let mut listed: Vec<u32> = bins.list(brick).map(|(number, _)| number).collect();
            listed.sort_unstable();
            assert_eq!(listed, expected);
            assert_eq!(bins.labels[brick], if expected.is_empty() { 0 } else { bit(0) | bit(1) });
        }
    }

    #[test]
    fn no_triangles() {
        let image = testing::image([3, 3, 3], Frame::axis_aligned([1.0; 3]).unwrap(), |_, _, _| 1);
        let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
        let bins =
            TriangleBins::new(Vec::new(), &faces, 0.5, &|_| Ok(()), &Monitor::silent()).unwrap();
        assert!(bins.nearest(None, DVec3::ZERO, None).is_none());
    }
}
