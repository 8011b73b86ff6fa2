//! Contacts that follow each other along a line: where bodies touch along an edge some voxels long.
//!
//! A contact alone may be sampled when the mesh is found not to reach it. Along a line that is too
//! late: samples that are there already lie in the octahedra of the next contacts and stay, and
//! bodies part between two contacts.

use std::collections::HashMap;

use glam::DVec3;

use crate::Result;
use crate::memory::{self, reserve};

/// So many contacts in a row are a line. In segmentations these are rare. With 3 a brain has a
/// tenth more tets at a delta of three voxels, and every fourth slice of it up to a quarter more.
const LINE: usize = 6;

/// What lists of this module have, as errors name it.
const WHAT: &str = "contacts along lines";

/// Those contacts, given in voxels, that others follow along an axis, a voxel apart.
///
/// # Errors
/// [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn along_lines(contacts: &[DVec3]) -> Result<Vec<DVec3>> {
    Ok(divided_by_lines(contacts)?.0)
}

/// These contacts, and the others.
///
/// # Errors
/// [`OutOfMemory`](crate::Error::OutOfMemory).
pub fn divided_by_lines(contacts: &[DVec3]) -> Result<(Vec<DVec3>, Vec<DVec3>)> {
    // In half voxels they lie at whole numbers, but for how they were moved.
    let place = |p: DVec3| (2.0 * p).round().as_i64vec3().to_array();
    let mut places = HashMap::new();
    for &p in contacts {
        memory::insert(&mut places, place(p), (), WHAT)?;
    }
    let in_line = |p: DVec3| {
        (0..3).any(|axis| {
            let so_many = |step: i64| {
                let mut at = place(p);
                let next = std::iter::repeat_with(move || {
                    at[axis] += step;
                    at
                });
                next.take(LINE - 1).take_while(|at| places.contains_key(at)).count()
            };
            1 + so_many(2) + so_many(-2) >= LINE
        })
    };
    let (mut in_lines, mut others) = (Vec::new(), Vec::new());
    for &p in contacts {
        let list = if in_line(p) { &mut in_lines } else { &mut others };
        reserve(list, 1, WHAT)?;
        list.push(p);
    }
    Ok((in_lines, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_six_are_lines() {
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let row: Vec<DVec3> = (1..=6).map(|z| at(0.5, 0.48, f64::from(z) + 0.02)).collect();
        // In other rows, of two at most, and half a voxel off.
        let others = [at(1.5, 0.5, 1.0), at(1.5, 0.5, 2.0), at(0.5, 0.5, 8.0), at(0.5, 0.5, 1.5)];
        let all: Vec<DVec3> = row.iter().chain(&others).copied().collect();
        assert_eq!(along_lines(&all).unwrap(), row);
        assert_eq!(along_lines(&row[..5]).unwrap(), []);
    }
}
