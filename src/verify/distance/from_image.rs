//! From the faces of the voxels to the mesh, brick by brick: the triangles listed in a brick are
//! gone through once, each looks at the faces within its reach, and a face keeps the nearest
//! triangles it has met. What no triangle reaches is searched for. The corners of the faces only
//! count for the maximum: mostly a triangle that one of the faces around a corner has met shows
//! that it is near enough. With each face goes the point where dO crosses the edge between the
//! centres of its two voxels.

use glam::DVec3;
use rayon::prelude::*;

use super::triangle_bins::{Nearest, Triangle, TriangleBins};
use super::voxel_faces::{BRICK, Face, VoxelFaces};
use super::{CHECK_EVERY, Distance, Max, Sum, spread};
use crate::Result;
use crate::geometry::shape::closest_point;
use crate::image::components::ImageComponents;
use crate::memory::room;
use crate::monitor::Monitor;
use crate::oracle::Oracle;
use crate::reduce::{KeyedSums, Sums};

/// "No triangle yet".
const NONE: u32 = u32::MAX;

/// A voxel face, and what is known of the triangles near its centre.
struct Target {
    face: Face,
    centre: DVec3,
    /// The components on its two sides with the ids of their labels; `None` for the background.
    sides: [Option<(u32, u16)>; 2],
    /// The nearest triangle of all, and the nearest one of the label of each side; none where all
    /// are out of reach.
    best: [Nearest; 3],
    /// The largest of their squared distances: a triangle that is farther changes none.
    limit: f64,
}

/// The plane of a triangle, and those through its edges at right angles to it: directions, and what
/// turns the square of a product with them into a squared distance.
struct Planes {
    corners: [DVec3; 3],
    normal: (DVec3, f64),
    /// Pointing out.
    sides: [(DVec3, f64); 3],
    is_flat: bool,
}

impl Planes {
    #[inline]
    fn of(triangle: &Triangle) -> Self {
        let corners @ [a, b, c] = triangle.corners;
        let edges = [b - a, c - b, a - c];
        let normal = edges[0].cross(c - a);
        let squared = normal.length_squared();
        // A triangle without area has no planes.
        let is_flat = !(squared > 0.0 && squared.is_normal());
        let per = |squared: f64| if is_flat { 0.0 } else { squared.recip() };
        let sides = edges.map(|edge| (edge.cross(normal), per(edge.length_squared() * squared)));
        Self { corners, normal: (normal, per(squared)), sides, is_flat }
    }

    /// A lower bound of the squared distance from `p`, and whether it is the distance.
    #[inline]
    fn bound(&self, p: DVec3) -> (f64, bool) {
        let [a, ..] = self.corners;
        let height = self.normal.0.dot(p - a);
        let mut outside = 0.0_f64;
        for (&(side, per), corner) in self.sides.iter().zip(self.corners) {
            let beyond = side.dot(p - corner).max(0.0);
            outside = outside.max(beyond * beyond * per);
        }
        (height * height * self.normal.1 + outside, outside == 0.0 && !self.is_flat)
    }
}

/// The faces of one brick.
#[derive(Default)]
struct Targets {
    list: Vec<Target>,
    /// Where the faces of each cell begin.
    first: Vec<u32>,
    low: [usize; 3],
    high: [usize; 3],
}

/// Finds the components of voxels one after the other along a row.
struct Cursor {
    id: u16,
    component: Option<u32>,
}

impl Cursor {
    const NEW: Self = Self { id: 0, component: None };

    fn go_to(&mut self, id: u16) {
        if id != self.id {
            *self = Self { id, component: None };
        }
    }

    /// The component and label id of the voxel that was gone to.
    fn get(&mut self, voxel: [usize; 3], components: &ImageComponents) -> Option<(u32, u16)> {
        if self.id != 0 && self.component.is_none() {
            self.component = components.at(voxel);
        }
        self.component.map(|component| (component, self.id))
    }
}

impl Target {
    /// The triangle that was found to be nearest, over the whole or of the label of a component on
    /// one side.
    fn triangle_of(&self, component: Option<u32>) -> Option<u32> {
        let best = match component {
            None => &self.best[0],
            Some(_) => {
                let is_on = |side: &Option<(u32, u16)>| side.map(|(own, _)| own) == component;
                &self.best[1 + self.sides.iter().position(is_on)?]
            }
        };
        Some(best.triangle).filter(|&triangle| triangle != NONE)
    }

    /// Keeps the triangle where it is the nearest one so far.
    #[inline]
    fn meet(&mut self, triangle: u32, ids: [u16; 2], distance_squared: f64) {
        let [one, other] = self.sides.map(|side| side.is_some_and(|(_, id)| ids.contains(&id)));
        self.limit = 0.0;
        for (best, wanted) in self.best.iter_mut().zip([true, one, other]) {
            if wanted && distance_squared < best.distance_squared {
                *best = Nearest { triangle, distance_squared };
            }
        }
        let wanted = [true, self.sides[0].is_some(), self.sides[1].is_some()];
        for (best, _) in self.best.iter().zip(wanted).filter(|(_, wanted)| *wanted) {
            self.limit = self.limit.max(best.distance_squared);
        }
    }
}

impl Targets {
    /// Collects the faces of a brick.
    fn collect(
        &mut self,
        brick: [usize; 3],
        faces: &VoxelFaces<'_>,
        components: &ImageComponents,
        reach: f64,
    ) {
        let dims = faces.dims();
        self.low = brick.map(|i| i * BRICK);
        self.high = [0, 1, 2].map(|axis| (self.low[axis] + BRICK).min(dims[axis]));
        self.list.clear();
        self.first.clear();
        let none = Nearest { triangle: NONE, distance_squared: reach * reach };
        for k in self.low[2]..self.high[2] {
            for j in self.low[1]..self.high[1] {
                // The voxels of the row, and of the rows below it along y and z. Below 0 wraps to
                // what is outside just as well.
                let rows = [(j, k), (j.wrapping_sub(1), k), (j, k.wrapping_sub(1))];
                let mut cursors = [Cursor::NEW, Cursor::NEW, Cursor::NEW];
                let mut left = None;
                if let Some(i) = self.low[0].checked_sub(1) {
                    cursors[0].go_to(faces.id([i, j, k]));
                    left = cursors[0].get([i, j, k], components);
                }
                for i in self.low[0]..self.high[0] {
                    self.first.push(self.list.len() as u32);
                    for (cursor, (j, k)) in cursors.iter_mut().zip(rows) {
                        cursor.go_to(faces.id([i, j, k]));
                    }
                    let mask = faces.mask([i, j, k]);
                    let own = cursors[0].get([i, j, k], components);
                    for axis in (0..3).filter(|axis| mask >> axis & 1 == 1) {
                        let face = Face { cell: [i, j, k], axis };
                        let below = match axis {
                            0 => left,
                            _ => cursors[axis].get([i, rows[axis].0, rows[axis].1], components),
                        };
                        let centre = faces.centre(face);
                        self.list.push(Target {
                            face,
                            centre,
                            sides: [below, own],
                            best: [none; 3],
                            limit: reach * reach,
                        });
                    }
                    left = own;
                }
            }
        }
        self.first.push(self.list.len() as u32);
    }

    /// The faces that have a corner of the grid, as far as they are in the brick.
    fn around(&self, corner: [usize; 3]) -> impl Iterator<Item = &Target> {
        let cells = (0..8).filter_map(move |bits: usize| {
            let mut cell = [0; 3];
            for axis in 0..3 {
                cell[axis] = corner[axis].checked_sub(bits >> axis & 1)?;
                if !(self.low[axis]..self.high[axis]).contains(&cell[axis]) {
                    return None;
                }
            }
            Some((cell, bits))
        });
        cells.flat_map(move |(cell, bits)| {
            let [i, j, k] = [0, 1, 2].map(|axis| cell[axis] - self.low[axis]);
            let at = i + (self.high[0] - self.low[0]) * (j + (self.high[1] - self.low[1]) * k);
            let own = &self.list[self.first[at] as usize..self.first[at + 1] as usize];
            // A lower face of a cell has the corners of the cell's lower side along its axis.
            own.iter().filter(move |target| bits >> target.face.axis & 1 == 0)
        })
    }

    /// Whether a corner of the grid, at `p`, is farther than `max` from the triangles that the
    /// faces there have met, over the whole or of the label of a component.
    fn is_far(
        &self,
        corner: [usize; 3],
        component: Option<u32>,
        p: DVec3,
        max: f64,
        bins: &TriangleBins,
    ) -> bool {
        let mut met = self.around(corner).filter_map(|target| target.triangle_of(component));
        met.all(|triangle| bins.triangles[triangle as usize].distance_squared(p) > max * max)
    }

    /// Shows a triangle to the faces whose centres are within `reach` of the box around it.
    fn show(&mut self, number: u32, triangle: &Triangle, faces: &VoxelFaces<'_>, reach: f64) {
        let (low, high) = triangle.bounds();
        let (low, high) = ((low - reach) / faces.spacing(), (high + reach) / faces.spacing());
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let cell = |x: f64| x.max(0.0) as usize;
            cell(low[axis]).max(self.low[axis])
                ..cell(high[axis]).saturating_add(1).min(self.high[axis])
        });
        let planes = Planes::of(triangle);
        let (width, depth) = (self.high[0] - self.low[0], self.high[1] - self.low[1]);
        for k in z {
            for j in y.clone() {
                if x.is_empty() {
                    continue;
                }
                let row = width * (j - self.low[1] + depth * (k - self.low[2]));
                let targets =
                    self.first[row + x.start - self.low[0]]..self.first[row + x.end - self.low[0]];
                for target in &mut self.list[targets.start as usize..targets.end as usize] {
                    let (bound, is_exact) = planes.bound(target.centre);
                    // The margin keeps rounding from deciding.
                    if bound * (1.0 - 1e-12) >= target.limit {
                        continue;
                    }
                    let distance_squared =
                        if is_exact { bound } else { triangle.distance_squared(target.centre) };
                    if distance_squared < target.limit {
                        target.meet(number, triangle.ids, distance_squared);
                    }
                }
            }
        }
    }
}

/// A corner of the grid that may be farther from the mesh, or from the triangles of a component's
/// label, than all that is known.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Corner {
    at: [usize; 3],
    component: Option<u32>,
    /// One that is thought to be near.
    triangle: u32,
}

/// A distance over the whole, and the sums of each component.
type Measured = (Distance, Vec<Sum>);

/// Distances from the image to the mesh: from the faces of voxels, and from dO. All triangles
/// within `reach` of a brick are listed there.
pub(crate) fn image_to_mesh(
    bins: &TriangleBins,
    reach: f64,
    faces: &VoxelFaces<'_>,
    components: &ImageComponents,
    oracle: &Oracle,
    monitor: &Monitor<'_>,
) -> Result<[Measured; 2]> {
    let [nx, ny, nz] = faces.brick_dims();
    // The oracle may know the parts of long voxels.
    let parts = (faces.spacing() / oracle.spacing()).round().to_array().map(|n| n as isize);
    // What is no farther than the maximum that any thread knows need not be looked at.
    let maximum = Maxima::default();
    let mut maxima: Vec<Maxima> = room(components.list.len(), "components of the image")?;
    maxima.resize_with(components.list.len(), Maxima::default);
    let scratch = || (Targets::default(), Vec::new());
    let parts = (0..ny * nz).into_par_iter().map_init(scratch, |(targets, corners), row| {
        monitor.advance(1)?;
        let mut whole = [Sum::default(); 2];
        let mut keyed_sums = [KeyedSums::default(), KeyedSums::default()];
        for brick in (nx * row..nx * (row + 1)).filter(|&brick| faces.has_faces(brick)) {
            monitor.advance(0)?;
            targets.collect([brick % nx, row % ny, row / ny], faces, components, reach);
            for (number, triangle) in bins.list(brick) {
                targets.show(number, triangle, faces, reach);
            }
            // The triangle that was found last, for the next that is searched for.
            let mut last = None;
            for (t, target) in targets.list.iter().enumerate() {
                if t.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                let area = faces.area(target.face);
                let crossing = crossing(target, parts, oracle);
                // Mostly one triangle is the nearest of all three.
                let mut known: Option<Met> = None;
                // That is asked for first.
                let mut of_all: Option<Nearest> = None;
                let mut measure = |best: Nearest, side: Option<(u32, u16)>, max: &Maxima| {
                    let id = side.map(|(_, id)| id);
                    let has_id =
                        |t: u32| id.is_none_or(|id| bins.triangles[t as usize].ids.contains(&id));
                    // All triangles within the reach have been met. Farther away, the nearest of
                    // all may be that of the label.
                    let found = if best.triangle != NONE {
                        Some(best)
                    } else {
                        of_all.filter(|all| has_id(all.triangle))
                    };
                    let found = found
                        .or_else(|| bins.nearest(id, target.centre, last.filter(|&t| has_id(t))));
                    last = found.map(|found| found.triangle).or(last);
                    of_all = of_all.or(found);
                    let distance =
                        found.map_or(f64::INFINITY, |found| found.distance_squared.sqrt());
                    max.faces.raise(distance);
                    let Some(Nearest { triangle, .. }) = found else {
                        max.surface.raise(distance);
                        return [Sum::of(area, distance); 2];
                    };
                    let met = known.filter(|met| met.triangle == triangle);
                    let met =
                        *known.insert(met.unwrap_or_else(|| Met::new(triangle, crossing, bins)));
                    // A corner with any triangle within the maximum so far cannot raise it: bounds
                    // of the distance, the cheapest first. The margin keeps rounding from deciding.
                    let so_far = max.faces.get();
                    if distance + faces.half_diagonal(target.face) > so_far * (1.0 - 1e-12) {
                        let component = side.map(|(component, _)| component);
                        let corner = faces.corner_cells(target.face).map(|at| Corner {
                            at,
                            component,
                            triangle,
                        });
                        corners.extend(corner.into_iter().filter(|corner| {
                            let p = faces.corner(corner.at);
                            p.distance_squared(met.point) > so_far * so_far
                                && bins.triangles[triangle as usize].distance_squared(p)
                                    > so_far * so_far
                        }));
                    }
                    if met.distance > max.surface.get()
                        && let Some(nearest) = bins.nearest(id, crossing, Some(triangle))
                    {
                        max.surface.raise(nearest.distance_squared.sqrt());
                    }
                    [distance, met.distance].map(|distance| Sum::of(area, distance))
                };
                let [best, of_sides @ ..] = target.best;
                let sums = measure(best, None, &maximum);
                whole.iter_mut().zip(sums).for_each(|(whole, sum)| *whole += sum);
                for (side, best) in target.sides.into_iter().zip(of_sides) {
                    if let Some((component, _)) = side {
                        let sums = measure(best, side, &maxima[component as usize]);
                        keyed_sums
                            .iter_mut()
                            .zip(sums)
                            .for_each(|(keyed_sums, sum)| keyed_sums.add(component.into(), sum));
                    }
                }
            }
            corners.sort_unstable();
            corners.dedup_by_key(|corner| (corner.at, corner.component));
            for Corner { at, component, triangle } in corners.drain(..) {
                let (max, id) = match component {
                    None => (&maximum.faces, None),
                    Some(c) => (&maxima[c as usize].faces, Some(components.list[c as usize].id)),
                };
                let p = faces.corner(at);
                if targets.is_far(at, component, p, max.get(), bins) {
                    monitor.advance(0)?;
                    let nearest = bins.nearest(id, p, Some(triangle));
                    nearest.iter().for_each(|nearest| max.raise(nearest.distance_squared.sqrt()));
                }
            }
        }
        Ok((whole, keyed_sums.map(KeyedSums::sums)))
    });
    let (wholes, sums): (Vec<[Sum; 2]>, Vec<[Sums<Sum>; 2]>) =
        parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let (of_faces, of_surface): (Vec<Sums<Sum>>, Vec<Sums<Sum>>) =
        sums.into_iter().map(<(_, _)>::from).unzip();
    let measured = |which: usize, sums, max: fn(&Maxima) -> &Max| {
        let whole = Sum { max: max(&maximum).get(), ..wholes.iter().map(|sums| sums[which]).sum() };
        let mut of_components = spread(KeyedSums::total(sums), components.list.len())?;
        of_components.iter_mut().zip(&maxima).for_each(|(sum, maxima)| sum.max = max(maxima).get());
        Ok((whole.distance(), of_components))
    };
    Ok([measured(0, of_faces, |max| &max.faces)?, measured(1, of_surface, |max| &max.surface)?])
}

/// The largest distances so far.
#[derive(Default)]
struct Maxima {
    /// From the faces of voxels.
    faces: Max,
    /// From dO.
    surface: Max,
}

/// Where dO crosses the line between the centres of the two voxels of a face, each of which has so
/// many `parts` along each axis.
fn crossing(target: &Target, parts: [isize; 3], oracle: &Oracle) -> DVec3 {
    let Face { cell, axis } = target.face;
    let ids = target.sides.map(|side| side.map_or(0, |(_, id)| id));
    let mut point = target.centre;
    // Of the parts at the face the one in the middle is taken; along the axis it is the last one
    // before the face.
    let mut part = [0, 1, 2].map(|a| parts[a] * cell[a] as isize + parts[a] / 2);
    part[axis] = parts[axis] * cell[axis] as isize - 1;
    point[axis] += (oracle.crossed_at(part, axis, ids) - 0.5) * oracle.spacing()[axis];
    point
}

/// A triangle near a voxel face: that which is nearest to the centre.
#[derive(Clone, Copy)]
struct Met {
    triangle: u32,
    /// Its point closest to where dO crosses the edge through the face.
    point: DVec3,
    /// How far that is.
    distance: f64,
}

impl Met {
    fn new(triangle: u32, crossing: DVec3, bins: &TriangleBins) -> Self {
        let point = closest_point(&bins.triangles[triangle as usize].corners, crossing);
        Self { triangle, point, distance: point.distance(crossing) }
    }
}
