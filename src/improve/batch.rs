//! The measures of many tets at once, by vector instructions: those of [`Measure::of`].

use glam::DVec3;

use super::measure::{Measure, lesser};
use crate::geometry::tet_block::{BLOCK, Row, TetBlock};
use crate::geometry::vectors::vectorized;

/// A multiple of the lanes of a vector of f64.
const STEP: usize = 8;

/// Tets that are measured together. Kept from one use to the next for its memory.
#[derive(Default)]
pub(super) struct Batch {
    blocks: Vec<Measured>,
    len: usize,
}

/// Some of the tets, and their measures.
#[repr(align(64))]
struct Measured {
    tets: TetBlock,
    measures: Row,
}

impl Batch {
    /// Leaves no tet.
    pub fn clear(&mut self) {
        self.in_use().for_each(|block| block.tets.clear());
        self.len = 0;
    }

    /// Adds a tet.
    #[inline]
    pub fn push(&mut self, corners: [[f64; 3]; 4]) {
        let block = self.len / BLOCK;
        if block == self.blocks.len() {
            self.blocks.push(Measured { tets: TetBlock::default(), measures: [0.0; BLOCK] });
        }
        self.blocks[block].tets.push(corners);
        self.len += 1;
    }

    /// Moves the first vertex of all tets to `p`.
    pub fn set_first(&mut self, p: DVec3) {
        self.in_use().for_each(|block| block.tets.set_first(p));
    }

    /// The vertices of tet `i`.
    #[inline]
    pub fn corners(&self, i: usize) -> [DVec3; 4] {
        self.blocks[i / BLOCK].tets.corners(i % BLOCK)
    }

    /// Measures all tets. Returns the least measure; infinite without tets.
    pub fn measure(&mut self, measure: &Measure) -> f64 {
        self.in_use().for_each(|block| measures_of(&block.tets, measure, &mut block.measures));
        self.measures().flatten().copied().fold(f64::INFINITY, lesser)
    }

    /// The measures of the tets, block by block, as [`Self::measure`] found them.
    pub fn measures(&self) -> impl Iterator<Item = &[f64]> {
        let in_use = self.blocks.iter().take(self.len.div_ceil(BLOCK));
        in_use.map(|block| &block.measures[..block.tets.len()])
    }

    fn in_use(&mut self) -> impl Iterator<Item = &mut Measured> {
        self.blocks.iter_mut().take(self.len.div_ceil(BLOCK))
    }
}

vectorized! {
    fn measures_of[](tets: &TetBlock, measure: &Measure, measures: &mut Row) = measure_tets;
    measures_avx2, measures_portably
}

#[inline(always)]
fn measure_tets(tets: &TetBlock, measure: &Measure, measures: &mut Row) {
    // What lies beyond the last tet is what lay there before, measured in vain.
    for i in 0..tets.len().next_multiple_of(STEP).min(BLOCK) {
        measures[i] = measure.of(&tets.corners(i));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn tet() -> impl Strategy<Value = [DVec3; 4]> {
        let point = prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from_array);
        prop::array::uniform4(point)
    }

    proptest! {
        /// Of any number of tets, also after the first corners have moved.
        #[test]
        fn each_measure_is_that_of_its_tet(
            tets in prop::collection::vec(tet(), 0..3 * BLOCK),
            p in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let (measure, p) = (Measure::new(15.0, 2.0), DVec3::from_array(p));
            let mut batch = Batch::default();
            // What was there before does not matter.
            (0..3 * BLOCK).for_each(|_| batch.push([p.to_array(); 4]));
            batch.clear();
            tets.iter().for_each(|tet| batch.push(tet.map(|p| p.to_array())));
            for moved in [false, true] {
                let first = |a: DVec3| if moved { p } else { a };
                if moved {
                    batch.set_first(p);
                }
                let expected: Vec<f64> =
                    tets.iter().map(|&[a, b, c, d]| measure.of(&[first(a), b, c, d])).collect();
                let least = batch.measure(&measure);
                let measures = batch.measures().collect::<Vec<_>>().concat();
                prop_assert_eq!(&measures, &expected);
                prop_assert_eq!(least, expected.iter().copied().fold(f64::INFINITY, f64::min));
                for (i, tet) in tets.iter().enumerate() {
                    prop_assert_eq!(batch.corners(i), [first(tet[0]), tet[1], tet[2], tet[3]]);
                }
            }
        }

        /// With and without AVX2.
        #[test]
        fn every_instance_of_the_loop_gives_the_same_bits(
            corners in prop::collection::vec(tet(), BLOCK),
        ) {
            let measure = Measure::new(20.0, 2.0);
            let mut batch = Batch::default();
            corners.iter().for_each(|tet| batch.push(tet.map(|p| p.to_array())));
            batch.measure(&measure);
            let mut portable = [0.0; BLOCK];
            measures_portably(&batch.blocks[0].tets, &measure, &mut portable);
            prop_assert_eq!(
                portable.map(f64::to_bits),
                batch.blocks[0].measures.map(f64::to_bits)
            );
        }
    }
}
