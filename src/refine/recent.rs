//! The points that were found last. Crossed edges come brick after brick, so mostly one of them is near the next place that is asked about.

use glam::DVec3;

/// How many are remembered.
const COUNT: usize = 8;

/// The last few points, none at first.
pub struct Recent {
    points: [DVec3; COUNT],
    /// The next one to be forgotten.
    oldest: usize,
}

impl Recent {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { points: [DVec3::INFINITY; COUNT], oldest: 0 }
    }

    /// Whether one is closer than `radius` to `p`.
    #[inline]
    pub fn any_within(&self, p: DVec3, radius: f64) -> bool {
        // All are asked: no branch on one of them would be foreseen.
        self.points.iter().fold(false, |is, q| is | (q.distance_squared(p) < radius * radius))
    }

    /// Remembers a point in place of the oldest.
    #[inline]
    pub fn remember(&mut self, p: DVec3) {
        self.points[self.oldest] = p;
        self.oldest = (self.oldest + 1) % COUNT;
    }
}
