//! From the mesh to the faces of the voxels.

use glam::DVec3;
use rayon::prelude::*;

use super::grid_corners::Corners;
use super::points::Points;
use super::triangle_bins::Triangle;
use super::voxel_faces::{Face, VoxelFaces};
use super::{CHECK_EVERY, CHUNK, Distance, MAX_ALONG, PART, Sum, TOLERANCE};
use crate::Result;
use crate::memory::reserve;
use crate::monitor::Monitor;
use crate::reduce::NO_SET;
use crate::reduce::{KeyedSums, Sums};

/// How often parts of a facet are halved by their centroids alone, which costs less than to look
/// for the faces nearest to their corners, and mostly suffices.
const HALVINGS: u32 = 2;

/// A side of an interface facet: component, the id of its label, and the face that was last found
/// to be nearest of that label.
struct Side {
    component: u64,
    id: u16,
    last: Option<Face>,
}

/// Distances from the mesh to the image: over the whole, and the sums of each component that has
/// any facets.
pub(crate) fn mesh_to_image(
    triangles: &[Triangle],
    faces: &VoxelFaces<'_>,
    monitor: &Monitor<'_>,
) -> Result<(Distance, Sums<Sum>)> {
    let spacing = faces.smallest_spacing();
    let parts = triangles.par_chunks(CHUNK).map(|triangles| {
        let mut whole = Sum::default();
        let mut keyed_sums = KeyedSums::default();
        let mut start = None;
        let mut corners = faces.corners_of_grid();
        let mut points = Points::default();
        // Samples since the last look at the cancel flag.
        let mut unchecked = 0;
        // Of each sample in turn, rounded up.
        let mut distances: Vec<f32> = Vec::new();
        let mut sides: [Option<Side>; 2] = [None, None];
        for triangle in triangles {
            for (side, (component, id)) in
                sides.iter_mut().zip(triangle.components.into_iter().zip(triangle.ids))
            {
                let last = side.take().filter(|side| side.id == id).and_then(|side| side.last);
                *side =
                    (component != NO_SET).then_some(Side { component: component.into(), id, last });
            }
            // A label that the image does not have is nowhere near.
            let are_there = sides.iter().flatten().all(|side| side.id != 0);
            // Of samples to which the same face is nearest of all, and of both labels: most.
            let mut of_each = Sum::default();
            let mut of_all = Sum::default();
            let mut of_sides = [Sum::default(); 2];
            let parts = Parts::new(&triangle.corners, PART * spacing);
            let weight = parts.area();
            let mut look_at = |p: DVec3, [near, of_labels @ ..]: [f64; 3]| {
                if are_there && near.is_finite() && of_labels == [near; 2] {
                    let distance = near.sqrt();
                    of_each += Sum::of(weight, distance);
                    return distance;
                }
                let far = if near.is_finite() { None } else { faces.nearest(p, start) };
                start = far.map(|(face, _)| face).or(start);
                let squared_of_all = far.map_or(near, |(_, squared)| squared);
                let distance = squared_of_all.sqrt();
                let sum_of_all = Sum::of(weight, distance);
                of_all += sum_of_all;
                for ((side, sum), near) in sides.iter_mut().zip(&mut of_sides).zip(of_labels) {
                    let Some(side) = side else { continue };
                    let squared = match near {
                        _ if side.id == 0 => f64::INFINITY,
                        near if near.is_finite() => near,
                        _ => {
                            let own = far.filter(|&(face, _)| faces.touches(face, side.id));
                            let own = own.or_else(|| faces.nearest_of(side.id, p, side.last));
                            side.last = own.map(|(face, _)| face).or(side.last);
                            own.map_or(f64::INFINITY, |(_, squared)| squared)
                        }
                    };
                    *sum += if squared == squared_of_all {
                        sum_of_all
                    } else {
                        Sum::of(weight, squared.sqrt())
                    };
                }
                distance
            };
            let mut look_at_all = |points: &mut Points| {
                if unchecked + points.len() > CHECK_EVERY {
                    monitor.advance(0)?;
                    unchecked = 0;
                }
                unchecked += points.len();
                reserve(&mut distances, points.len(), "distances of facets")?;
                // What is near a corner of the grid, as most is, is told by the voxels there.
                corners.near_distances(points, triangle.ids);
                distances.extend((0..points.len()).map(|i| {
                    let distance = look_at(points.get(i), points.distances(i));
                    rounded_up(distance)
                }));
                points.clear();
                Ok(())
            };
            parts.for_each(|p, _| {
                points.push(p);
                if points.is_full() { look_at_all(&mut points) } else { Ok(()) }
            })?;
            look_at_all(&mut points)?;
            of_all += of_each;
            whole += of_all;
            for (side, mut sum) in sides.iter().zip(of_sides) {
                if let Some(side) = side {
                    sum += of_each;
                    keyed_sums.add(side.component, sum);
                }
            }
        }
        monitor.advance(triangles.len())?;
        Ok((whole, (keyed_sums.sums(), distances)))
    });
    let (wholes, parts): (Vec<Sum>, Vec<_>) =
        parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let (sums, distances): (Vec<Sums<Sum>>, Vec<Vec<f32>>) = parts.into_iter().unzip();
    let sums = KeyedSums::total(sums);
    let sampled = wholes.into_iter().sum::<Sum>().distance();
    if sampled.max.is_infinite() {
        return Ok((sampled, sums));
    }
    // Each chunk starts from the maximum of the samples, not from what others have found, so that
    // equal input gives equal bits.
    let raised = triangles.par_chunks(CHUNK).zip(&distances).map(|(triangles, distances)| {
        monitor.advance(0)?;
        let (near, max) = (faces.corners_of_grid(), sampled.max);
        let (start, bounds, tolerance) = (None, [DVec3::ZERO; 2], TOLERANCE * spacing);
        let points = Points::default();
        let mut search = Search { faces, near, points, start, bounds, max, tolerance, monitor };
        let mut distances = &distances[..];
        triangles.iter().try_for_each(|triangle| search.look_at(triangle, &mut distances))?;
        Ok(search.max)
    });
    let max = raised.try_reduce(|| sampled.max, |a, b| Ok(a.max(b)))?;
    Ok((Distance { max, ..sampled }, sums))
}

/// Looks for points of facets that are farther from the faces than all that are known: branch and
/// bound.
struct Search<'s, 'i, 'm> {
    faces: &'s VoxelFaces<'i>,
    near: Corners<'i>,
    /// Holds the one point that is asked about.
    points: Points,
    /// The face that was found last.
    start: Option<Face>,
    /// Corners of the box around the facet.
    bounds: [DVec3; 2],
    /// The largest distance that is known.
    max: f64,
    /// What is farther by less is not looked for.
    tolerance: f64,
    monitor: &'s Monitor<'m>,
}

/// A part of a facet: its centroid with an upper bound of its distance from the faces, and from
/// there its corners.
#[derive(Clone, Copy)]
struct Part {
    centroid: DVec3,
    arms: [DVec3; 3],
    distance: f64,
}

impl Search<'_, '_, '_> {
    /// Raises the maximum to the largest distance from a facet, if that is larger by more than the
    /// tolerance; `distances` begins with those of its samples, which are taken off.
    fn look_at(&mut self, triangle: &Triangle, distances: &mut &[f32]) -> Result<()> {
        let parts = Parts::new(&triangle.corners, PART * self.faces.smallest_spacing());
        let mut sampled =
            distances.split_off(..parts.along * parts.along).unwrap_or_default().iter();
        let farthest = sampled.clone().fold(0.0, |max: f32, &distance| max.max(distance));
        if f64::from(farthest) + parts.radius <= self.max + self.tolerance {
            return Ok(());
        }
        self.bounds = triangle.bounds().into();
        parts.for_each(|centroid, arms| {
            let distance = sampled.next().map_or(f64::INFINITY, |&distance| distance.into());
            self.refine(Part { centroid, arms, distance }, parts.radius, HALVINGS, triangle.ids)
        })
    }

    /// The same for a part of a facet, no point of which is farther than `radius` from its
    /// centroid. Where parts of parts, `halvings` times, do not show that it is near enough, their
    /// corners are looked at.
    fn refine(&mut self, part: Part, radius: f64, halvings: u32, ids: [u16; 2]) -> Result<()> {
        if part.distance + radius <= self.max + self.tolerance {
            return Ok(());
        }
        if halvings > 0 {
            let arms = part.arms.map(|arm| 0.5 * arm);
            for arm in arms {
                let centroid = part.centroid + arm;
                let distance = self.distance(centroid, ids);
                self.max = self.max.max(distance);
                self.refine(Part { centroid, arms, distance }, 0.5 * radius, halvings - 1, ids)?;
            }
            // The one in the middle is upside down.
            return self.refine(
                Part { arms: arms.map(|arm| -arm), ..part },
                0.5 * radius,
                halvings - 1,
                ids,
            );
        }
        self.monitor.advance(0)?;
        // Rounding does not lead out of the facet's box: what ends at a face of the grid does so
        // exactly.
        let [low, high] = self.bounds;
        let at = part.arms.map(|arm| (part.centroid + arm).clamp(low, high));
        let corners = at.map(|at| Corner::new(at, self.faces, &mut self.start));
        if let [Some(a), Some(b), Some(c)] = corners {
            self.raise([a, b, c])?;
        }
        Ok(())
    }

    /// Distance to the nearest face; 0 where there is none.
    #[inline(never)]
    fn distance(&mut self, p: DVec3, ids: [u16; 2]) -> f64 {
        self.points.clear();
        self.points.push(p);
        self.near.near_distances(&mut self.points, ids);
        let [squared, ..] = self.points.distances(0);
        if squared.is_finite() {
            return squared.sqrt();
        }
        let found = self.faces.nearest(p, self.start);
        self.start = found.map(|(face, _)| face).or(self.start);
        found.map_or(0.0, |(_, squared)| squared.sqrt())
    }

    /// As [`refine`](Self::refine), for a part with these corners, by the faces nearest to them.
    fn raise(&mut self, corners: [Corner; 3]) -> Result<()> {
        self.max = corners.iter().fold(self.max, |max, corner| max.max(corner.distance));
        if self.bound(&corners) <= self.max + self.tolerance {
            return Ok(());
        }
        self.monitor.advance(0)?;
        let [a, b, c] = corners;
        let middle =
            |p: Corner, q: Corner| Corner::new(p.at.midpoint(q.at), self.faces, &mut Some(p.face));
        let (Some(ab), Some(bc), Some(ca)) = (middle(a, b), middle(b, c), middle(c, a)) else {
            return Ok(());
        };
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            .into_iter()
            .try_for_each(|part| self.raise(part))
    }

    /// No point of the triangle is farther than this. The distance to one face is convex, so
    /// largest at a corner. And a point x = sum(l_i p_i) is at most sum(l_i (d_i + |x - p_i|))
    /// away, where sum(l_i |x - p_i|) is at most the radius of a circle around the triangle, which
    /// need not exceed the longest edge over the root of 3.
    fn bound(&self, corners: &[Corner; 3]) -> f64 {
        let [a, b, c] = corners.map(|corner| corner.at);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let farthest = corners.iter().fold(0.0, |max: f64, corner| max.max(corner.distance));
        let to_one = |face: Face| {
            corners.iter().map(|p| self.faces.distance_squared(face, p.at)).fold(0.0, f64::max)
        };
        let convex = corners.iter().map(|p| to_one(p.face)).fold(f64::INFINITY, f64::min);
        (farthest + (longest / 3.0).sqrt()).min(convex.sqrt())
    }
}

/// A point of a facet with the voxel face nearest to it and that distance.
#[derive(Clone, Copy)]
struct Corner {
    at: DVec3,
    face: Face,
    distance: f64,
}

impl Corner {
    fn new(at: DVec3, faces: &VoxelFaces<'_>, start: &mut Option<Face>) -> Option<Self> {
        let (face, squared) = faces.nearest(at, *start)?;
        *start = Some(face);
        Some(Self { at, face, distance: squared.sqrt() })
    }
}

/// No less than `x`, in half the space.
fn rounded_up(x: f64) -> f32 {
    (x as f32).next_up()
}

/// A subdivision of a triangle into n x n similar parts, half of them, but for n, upside down.
pub(crate) struct Parts {
    /// A corner of the triangle.
    corner: DVec3,
    /// The edges of a part from there.
    edges: [DVec3; 2],
    /// n.
    along: usize,
    /// From the centroid to the corners of a part that is not upside down.
    arms: [DVec3; 3],
    /// No point of a part is farther from its centroid.
    radius: f64,
}

impl Parts {
    /// Parts with a radius of no more than `max`, or of a [`MAX_ALONG`]th of the triangle's.
    pub fn new(&[a, b, c]: &[DVec3; 3], max: f64) -> Self {
        // By differences: what lies in a plane of the grid stays there.
        let (ab, ac) = (b - a, c - a);
        let middle = (ab + ac) / 3.0;
        let arms = [-middle, ab - middle, ac - middle];
        let radius = arms.iter().map(|arm| arm.length_squared()).fold(0.0, f64::max).sqrt();
        let along = ((radius / max).ceil() as usize).clamp(1, MAX_ALONG);
        let scale = 1.0 / along as f64;
        let (edges, arms) = ([ab, ac].map(|edge| edge * scale), arms.map(|arm| arm * scale));
        Self { corner: a, edges, along, arms, radius: radius * scale }
    }

    /// Area of a part.
    pub fn area(&self) -> f64 {
        let [u, v] = self.edges;
        0.5 * u.cross(v).length()
    }

    /// Calls `sample` with the centroid and the arms of each part. An error of `sample` ends the
    /// calls.
    pub fn for_each(&self, mut sample: impl FnMut(DVec3, [DVec3; 3]) -> Result<()>) -> Result<()> {
        let (n, [u, v], third) = (self.along, self.edges, -self.arms[0]);
        for i in 0..n {
            let row = self.corner + u * i as f64 + third;
            for j in 0..n - i {
                // One triangle like the whole, and one upside down, which the last of a row lacks.
                let centroid = row + v * j as f64;
                sample(centroid, self.arms)?;
                if i + j + 1 < n {
                    sample(centroid + third, self.arms.map(|arm| -arm))?;
                }
            }
        }
        Ok(())
    }
}
