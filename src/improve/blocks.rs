//! Who may change what: blocks of space that are improved side by side, with the same result on any
//! number of threads.
//!
//! Space is cut into cubes, the *blocks*. At the start of a round each vertex belongs to the block
//! where it lies, and keeps to it until the round ends, wherever it is moved. **A block owns the
//! tets with at least three vertices in it.** A block works alone, one operation after the other,
//! and an operation may only
//! - replace tets that the block owns by others that it owns,
//! - move a vertex all of whose tets it owns.
//!
//! What follows, and why blocks can work at the same time without locks:
//! 1. No tet is owned by two blocks: they would share two of its four vertices.
//! 2. A tet of one block never shares a facet with a tet of another. One has two of the facet's
//!    three vertices at least in its block, and so has the other in its own. So the tets beside an
//!    owned one are the block's own or nobody's.
//! 3. Nobody changes the vertices or the label of a tet that nobody owns. So a block may read those
//!    beside its own. When it replaces one of its tets it writes the number of the new one into the
//!    tet on the other side of the facet. That is one word, which belongs to this facet alone.
//! 4. A moved vertex is in tets of the block alone, so nobody else reads where it is.
//!
//! So what a block does depends on nothing that happens in another block during the round. The
//! blocks, the tets that each begins with and the slots that it may fill are the same on any number
//! of threads. Hence the same bytes.
//!
//! What lies on the border of a block has to wait. In the next round the blocks are shifted.

use glam::DVec3;
use rayon::prelude::*;

use crate::Result;
use crate::memory::zeroed_with_room;
use crate::mesh::TetMesh;

/// Tets of the object in a block, about: enough that few lie at its border, few enough that each
/// thread has many blocks, and that a block fits in a processor's cache.
const TETS_PER_BLOCK: f64 = 6_000.0;
/// Most blocks along an axis; their numbers fit in 32 bits.
const MAX_ALONG: f64 = 1000.0;
/// Vertices per piece of work.
const CHUNK: usize = 1 << 14;
/// By how much of a block's edge the blocks of a round are shifted against those of the round
/// before, along each axis: powers of the root of x^4 = x + 1, so that no border comes near an
/// earlier one soon (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
const SHIFT: DVec3 =
    DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3);

/// The blocks of all rounds.
pub(super) struct Blocks {
    lower: DVec3,
    edge: f64,
    /// Blocks along each axis, one more than fit, for the shift.
    along: DVec3,
}

impl Blocks {
    /// Blocks for a mesh of so many tets whose vertices are `points`.
    pub fn new(points: &[[f64; 3]], tets: usize) -> Self {
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let join = |a: [DVec3; 2], b: [DVec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let bounds = points.par_chunks(CHUNK).map(|points| {
            // Vertices that nobody has are nowhere.
            let points = points.iter().map(|&p| DVec3::from_array(p)).filter(|p| !p.is_nan());
            points.fold(start, |bounds, p| join(bounds, [p, p]))
        });
        let [lower, upper] = bounds.reduce(|| start, join);
        let is_empty = lower.x > upper.x;
        let (lower, size) =
            if is_empty { (DVec3::ZERO, DVec3::ONE) } else { (lower, upper - lower) };
        // A box that is flat, or has no extent at all, is one block thick.
        let longest = size.max_element().max(f64::MIN_POSITIVE);
        let size = size.max(DVec3::splat(longest * 1e-3));
        let blocks = (tets as f64 / TETS_PER_BLOCK).max(1.0);
        let edge = (size.element_product() / blocks).cbrt().max(longest / MAX_ALONG);
        Self { lower, edge, along: (size / edge).ceil() + 1.0 }
    }

    /// How many there are.
    #[cfg(test)]
    pub fn count(&self) -> usize {
        self.along.element_product() as usize
    }

    /// The block of each vertex in a round, with as much room behind them as behind the vertices.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn of_vertices(&self, mesh: &TetMesh, round: u32) -> Result<Vec<u32>> {
        let (count, more) = (mesh.points.len(), mesh.points.capacity() - mesh.points.len());
        let mut blocks = zeroed_with_room(count, more, "blocks of vertices")?;
        let shift = (SHIFT * f64::from(round)).fract();
        let (along, per_edge) = (self.along.as_uvec3(), 1.0 / self.edge);
        blocks.par_chunks_mut(CHUNK).zip(mesh.points.par_chunks(CHUNK)).for_each(
            |(blocks, points)| {
                for (block, &p) in blocks.iter_mut().zip(points) {
                    let at = (DVec3::from_array(p) - self.lower) * per_edge + shift;
                    // Rounded down; what is below 0 becomes 0.
                    let at = at.as_uvec3().min(along - 1);
                    *block = at.x + along.x * (at.y + along.y * at.z);
                }
            },
        );
        Ok(blocks)
    }
}

/// The block that owns a tet, by the blocks of its vertices.
#[inline]
pub(super) fn owner([a, b, c, d]: [u32; 4]) -> Option<u32> {
    match () {
        () if a == b && (c == a || d == a) => Some(a),
        () if c == d && (a == c || b == c) => Some(c),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_vertices_of_four_make_an_owner() {
        for code in 0..81_u32 {
            let of = [code % 3, code / 3 % 3, code / 9 % 3, code / 27];
            let max = (0..3).find(|b| of.iter().filter(|&x| x == b).count() >= 3);
            assert_eq!(owner(of), max, "{of:?}");
        }
    }

    #[test]
    fn vertices_are_in_blocks_of_the_grid() {
        let point = |i: usize| [(i % 31) as f64, (i / 31 % 17) as f64 * 0.5, (i / 527) as f64];
        let mesh = TetMesh { points: (0..5000).map(point).collect(), ..TetMesh::default() };
        let blocks = Blocks::new(&mesh.points, 1_000_000);
        let mut of = Vec::new();
        for round in 0..3 {
            of.push(blocks.of_vertices(&mesh, round).unwrap());
            assert!(of[round as usize].iter().all(|&b| (b as usize) < blocks.count()));
        }
        assert!(of[0] != of[1] && of[1] != of[2]);
        assert!(blocks.count() > 150 && blocks.count() < 500, "{}", blocks.count());
    }

    #[test]
    fn vertices_that_are_nowhere_do_not_matter() {
        let point = |i: usize| [(i % 31) as f64, (i / 31 % 17) as f64 * 0.5, (i / 527) as f64];
        let points: Vec<[f64; 3]> = (0..3 * CHUNK).map(point).collect();
        let expected = Blocks::new(&points, 1_000_000);
        let nowhere = [f64::NAN; 3];
        for places in [vec![0], vec![7, CHUNK - 1, 2 * CHUNK], vec![3 * CHUNK], vec![]] {
            let mut points = points.clone();
            places.iter().for_each(|&place| points.insert(place, nowhere));
            points.extend([nowhere; 2]);
            let blocks = Blocks::new(&points, 1_000_000);
            assert_eq!(
                (blocks.lower, blocks.edge, blocks.along),
                (expected.lower, expected.edge, expected.along),
                "{places:?}"
            );
        }
    }

    #[test]
    fn meshes_without_extent_have_blocks() {
        for points in
            [vec![], vec![[f64::NAN; 3]; 4], vec![[3.0; 3]; 4], vec![[0.0; 3], [1.0, 0.0, 0.0]]]
        {
            let mesh = TetMesh { points, ..TetMesh::default() };
            let blocks = Blocks::new(&mesh.points, 10);
            let of = blocks.of_vertices(&mesh, 1).unwrap();
            assert!(of.iter().all(|&b| (b as usize) < blocks.count()));
        }
    }
}
