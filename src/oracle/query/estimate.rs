//! How many tets a mesh may have, before it is made: only to warn of very many.
//!
//! Tets are smallest at interfaces, and grow away from them. So their number follows from the area
//! of the interfaces and the distance of samples there: for each mixed cell its largest face over
//! the square of that distance. Where two walls are closer than that the walls' distance counts: no
//! tet of good shape is larger.

use rayon::prelude::*;

use crate::image::palette::Palette;
use crate::oracle::{EdgeGrid, Oracle};

/// Tets for each square whose side is the distance of samples; measured on the atlases, where it is
/// 3 to 6.
const TETS_PER_SQUARE: f64 = 4.0;

impl Oracle {
    /// The tets to be expected about interfaces: of samples `delta` apart, and of those as far
    /// apart as `spacings` tell. The latter is right within a factor of two for most images.
    pub fn expected_tets(&self, delta: f64, spacings: &Palette<'_, f64>) -> [f64; 2] {
        let sides = self.grid.spacing;
        let largest_face = sides.element_product() / sides.min_element();
        let between_walls = (0..3).filter(|&a| {
            self.walls.lower[a] < self.walls.first[a] && self.walls.last[a] < self.walls.upper[a]
        });
        let thickness = between_walls
            .map(|a| (self.walls.upper[a] - self.walls.lower[a]) * sides[a])
            .fold(f64::INFINITY, f64::min);
        let squares = spacings.map(|&spacing| largest_face / spacing.min(thickness).powi(2));
        let grid: EdgeGrid<'_> = self.edge_grid(spacings);
        let of_row = |row: usize| {
            let (mut cells, mut sum) = (0.0, 0.0);
            // Never an error.
            let _ = self.visit_mixed_cells(row.into(), |[i, j, k]| {
                cells += 1.0;
                sum += squares.at(self.grid.bricks.index(i, j, k));
                Ok(())
            });
            [cells * largest_face / (delta * delta), sum]
        };
        let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        (0..grid.rows())
            .into_par_iter()
            .map(of_row)
            .reduce(|| [0.0; 2], add)
            .map(|squares| TETS_PER_SQUARE * squares)
    }
}
