//! From the mesh to the faces of the voxels.

use glam::DVec3;
use rayon::prelude::*;

use super::super::ledger::{Ledger, Sums};
use super::super::sets::NO_SET;
use super::super::triangle_bins::Triangle;
use super::super::voxel_faces::{Face, VoxelFaces};
use super::{CHECK_EVERY, CHUNK, Distance, PART, Sum, TOLERANCE};
use crate::Result;
use crate::memory::zeroed;
use crate::monitor::Monitor;

/// A side of an interface facet: component, the id of its label, and the face that was last found to be nearest of that label.
struct Side {
    component: u64,
    id: u16,
    last: Option<Face>,
}

/// Distances from the mesh to the image: over the whole, and the sums of each component that has any facets.
pub(super) fn mesh_to_image(
    triangles: &[Triangle],
    faces: &VoxelFaces<'_>,
    monitor: &Monitor<'_>,
) -> Result<(Distance, Sums<Sum>)> {
    let spacing = faces.smallest_spacing();
    // No point of a triangle is farther than this.
    let mut bounds: Vec<f64> = zeroed(triangles.len(), "distances of facets")?;
    let chunks = triangles.par_chunks(CHUNK).zip(bounds.par_chunks_mut(CHUNK));
    let parts = chunks.map(|(triangles, bounds)| {
        let mut whole = Sum::default();
        let mut ledger = Ledger::default();
        let mut start = None;
        let mut corners = faces.corners_of_grid();
        let mut samples = 0_usize;
        let mut sides: [Option<Side>; 2] = [None, None];
        for (triangle, bound) in triangles.iter().zip(bounds) {
            for (side, (component, id)) in sides.iter_mut().zip(triangle.components.into_iter().zip(triangle.ids)) {
                let last = side.take().filter(|side| side.id == id).and_then(|side| side.last);
                *side = (component != NO_SET).then_some(Side { component: component.into(), id, last });
            }
            // A label that the image does not have is nowhere near.
            let are_there = sides.iter().flatten().all(|side| side.id != 0);
            // Of samples to which the same face is nearest of all, and of both labels: most.
            let mut of_each = Sum::default();
            let mut of_all = Sum::default();
            let mut of_sides = [Sum::default(); 2];
            let radius = for_each_sample(&triangle.corners, PART * spacing, |p, weight| {
                samples += 1;
                if samples.is_multiple_of(CHECK_EVERY) {
                    monitor.advance(0)?;
                }
                // What is near a corner of the grid, as most is, is told by the voxels there.
                let [near, of_labels @ ..] = corners.near_distances(p, triangle.ids);
                if are_there && near.is_finite() && of_labels == [near; 2] {
                    of_each += Sum::of(weight, near.sqrt());
                    return Ok(());
                }
                let far = if near.is_finite() { None } else { faces.nearest(p, start) };
                start = far.map(|(face, _)| face).or(start);
                let squared_of_all = far.map_or(near, |(_, squared)| squared);
                let sum_of_all = Sum::of(weight, squared_of_all.sqrt());
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
                    *sum += if squared == squared_of_all { sum_of_all } else { Sum::of(weight, squared.sqrt()) };
                }
                Ok(())
            })?;
            of_all += of_each;
            whole += of_all;
            *bound = of_all.max + radius;
            for (side, mut sum) in sides.iter().zip(of_sides) {
                if let Some(side) = side {
                    sum += of_each;
                    ledger.add(side.component, sum);
                }
            }
        }
        monitor.advance(triangles.len())?;
        Ok((whole, ledger.sums()))
    });
    let (wholes, sums): (Vec<Sum>, Vec<Sums<Sum>>) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let sums = Ledger::total(sums);
    let sampled = wholes.into_iter().sum::<Sum>().distance();
    if sampled.max.is_infinite() {
        return Ok((sampled, sums));
    }
    let enough = sampled.max + TOLERANCE * spacing;
    // Each chunk starts from the maximum of the samples, not from what others have found, so that equal input gives equal bits.
    let raised = triangles.par_chunks(CHUNK).zip(bounds.par_chunks(CHUNK)).map(|(triangles, bounds)| {
        monitor.advance(0)?;
        let mut max = sampled.max;
        let mut start = None;
        for (triangle, _) in triangles.iter().zip(bounds).filter(|&(_, &bound)| bound > enough) {
            if let Some(facet) = Facet::new(&triangle.corners, faces, &mut start) {
                facet.raise(faces, TOLERANCE * spacing, &mut max, &mut || monitor.advance(0))?;
            }
        }
        Ok(max)
    });
    let max = raised.try_reduce(|| sampled.max, |a, b| Ok(a.max(b)))?;
    Ok((Distance { max, ..sampled }, sums))
}

/// A triangle, each corner with the voxel face nearest to it and that distance.
struct Facet([Corner; 3]);

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

impl Facet {
    /// `None` when there is no face.
    fn new(triangle: &[DVec3; 3], faces: &VoxelFaces<'_>, start: &mut Option<Face>) -> Option<Self> {
        let [a, b, c] = triangle.map(|at| Corner::new(at, faces, start));
        Some(Self([a?, b?, c?]))
    }

    /// Raises `max` to the largest distance from the triangle to the faces, if that is larger by more than `tolerance`: branch and bound.
    fn raise(
        &self,
        faces: &VoxelFaces<'_>,
        tolerance: f64,
        max: &mut f64,
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<()> {
        *max = self.0.iter().fold(*max, |max, corner| max.max(corner.distance));
        if self.bound(faces) <= *max + tolerance {
            return Ok(());
        }
        check()?;
        let [a, b, c] = self.0;
        let middle = |p: Corner, q: Corner| Corner::new(p.at.midpoint(q.at), faces, &mut Some(p.face));
        let (Some(ab), Some(bc), Some(ca)) = (middle(a, b), middle(b, c), middle(c, a)) else { return Ok(()) };
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            Self(part).raise(faces, tolerance, max, check)?;
        }
        Ok(())
    }

    /// No point of the triangle is farther than this. The distance to one face is convex, so largest at a corner. And a point x = sum(l_i p_i) is at most
    /// sum(l_i (d_i + |x - p_i|)) away, where sum(l_i |x - p_i|) is at most the radius of a circle around the triangle, which need not exceed the
    /// longest edge over the root of 3.
    fn bound(&self, faces: &VoxelFaces<'_>) -> f64 {
        let [a, b, c] = self.0.map(|corner| corner.at);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let farthest = self.0.iter().fold(0.0, |max: f64, corner| max.max(corner.distance));
        let to_one = |face: Face| self.0.iter().map(|p| faces.distance_squared(face, p.at)).fold(0.0, f64::max);
        let convex = self.0.iter().map(|p| to_one(p.face)).fold(f64::INFINITY, f64::min);
        (farthest + (longest / 3.0).sqrt()).min(convex.sqrt())
    }
}

/// Calls `sample` with the centroids of a subdivision of the triangle into n x n similar ones, so that no point of it is farther than `most` from one of them, and with the area of each. Returns how far
/// one is. An error of `sample` ends the calls.
pub(super) fn for_each_sample(
    &[a, b, c]: &[DVec3; 3],
    most: f64,
    mut sample: impl FnMut(DVec3, f64) -> Result<()>,
) -> Result<f64> {
    let (ab, ac) = (b - a, c - a);
    let middle = (ab + ac) / 3.0;
    let radius =
        [DVec3::ZERO, ab, ac].into_iter().map(|corner| corner.distance_squared(middle)).fold(0.0, f64::max).sqrt();
    let n = ((radius / most).ceil() as usize).max(1);
    let scale = 1.0 / n as f64;
    let area = ab.cross(ac).length() * 0.5 * scale * scale;
    let (u, v) = (ab * scale, ac * scale);
    let third = middle * scale;
    for i in 0..n {
        let row = a + u * i as f64 + third;
        for j in 0..n - i {
            // One triangle like the whole, and one upside down, which the last of a row lacks.
            let centroid = row + v * j as f64;
            sample(centroid, area)?;
            if i + j + 1 < n {
                sample(centroid + third, area)?;
            }
        }
    }
    Ok(radius * scale)
}
