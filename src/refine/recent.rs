//! The points that were found last. Crossed edges come brick after brick, so mostly one of them is
//! near the next place that is asked about.

use glam::DVec3;

/// How many are remembered.
const COUNT: usize = 8;

/// The last few points, none at first.
pub struct Recent {
    /// Their coordinates, those along one axis side by side.
    coordinates: [[f64; COUNT]; 3],
    /// The next one to be forgotten.
    oldest: usize,
}

impl Recent {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { coordinates: [[f64::INFINITY; COUNT]; 3], oldest: 0 }
    }

    /// Whether one is closer than `radius` to `p`.
    #[inline(always)]
    pub fn any_within(&self, p: DVec3, radius: f64) -> bool {
        // All are asked: no branch on one of them would be foreseen.
        let [x, y, z] = &self.coordinates;
        let squared = |n: usize| (x[n] - p.x).powi(2) + (y[n] - p.y).powi(2) + (z[n] - p.z).powi(2);
        let squared: [f64; COUNT] = std::array::from_fn(squared);
        squared.iter().fold(false, |is, &squared| is | (squared < radius * radius))
    }

    /// Remembers a point in place of the oldest.
    #[inline]
    pub fn remember(&mut self, p: DVec3) {
        for (coordinates, c) in self.coordinates.iter_mut().zip(p.to_array()) {
            coordinates[self.oldest] = c;
        }
        self.oldest = (self.oldest + 1) % COUNT;
    }
}
