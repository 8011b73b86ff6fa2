//! The Delaunay kernel against its validator: random, lattice (massively cospherical and coplanar)
//! and clustered points, inserted and removed.

use glam::DVec3;
use lapd::delaunay::{Insertion, Removal, Solo, Triangulation, VertexKind, Worker};
use proptest::prelude::*;

struct Kernel {
    triangulation: Triangulation,
    worker: Worker<Solo>,
}

impl Kernel {
    fn new() -> Self {
        let triangulation =
            Triangulation::new(DVec3::splat(-1.0), DVec3::splat(5.0)).expect("a valid box");
        Self { triangulation, worker: Worker::new(Solo, 0) }
    }

    fn insert(&mut self, p: DVec3) -> Option<u32> {
        let start = self
            .worker
            .created()
            .last()
            .copied()
            .filter(|&t| self.triangulation.is_living(t))
            .unwrap_or_else(|| self.triangulation.living_tets().next().expect("the box"));
        let t = self.triangulation.locate(start, p);
        match self.worker.insert(&self.triangulation, t, p, VertexKind::Free).expect("room") {
            Insertion::Done(v) => Some(v),
            Insertion::Duplicate => None,
            other => panic!("unexpected outcome {other:?}"),
        }
    }

    fn assert_sound(&self) {
        let check = self.triangulation.check();
        assert!(check.is_sound(), "{check:?}");
        assert_eq!(
            check.tets,
            self.worker.counters.created - self.worker.counters.destroyed + initial_tets()
        );
    }

    /// The triangulation as a set of tets, each a sorted list of positions.
    fn canonical(&self) -> Vec<Vec<[u64; 3]>> {
        let mut tets: Vec<_> = self
            .triangulation
            .living_tets()
            .map(|t| {
                let mut corners: Vec<_> = self
                    .triangulation
                    .corners(self.triangulation.tet(t).vertices())
                    .iter()
                    .map(|p| p.to_array().map(f64::to_bits))
                    .collect();
                corners.sort_unstable();
                corners
            })
            .collect();
        tets.sort_unstable();
        tets
    }
}

fn initial_tets() -> u64 {
    Kernel::new().triangulation.check().tets
}

fn lattice() -> impl Strategy<Value = DVec3> {
    (0..5_i32, 0..5_i32, 0..5_i32)
        .prop_map(|(x, y, z)| DVec3::new(f64::from(x), f64::from(y), f64::from(z)))
}

fn generic() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(0.0..4.0_f64).prop_map(DVec3::from)
}

#[test]
fn the_box_alone_is_sound() {
    Kernel::new().assert_sound();
}

#[test]
fn a_full_lattice_is_sound_whatever_the_order() {
    let mut points: Vec<_> = (0..125)
        .map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25)))
        .collect();
    let mut forward = Kernel::new();
    points.iter().for_each(|&p| assert!(forward.insert(p).is_some()));
    forward.assert_sound();
    points.reverse();
    points.swap(3, 70);
    let mut backward = Kernel::new();
    points.iter().for_each(|&p| assert!(backward.insert(p).is_some()));
    assert_eq!(forward.canonical(), backward.canonical());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_insertion_and_removal_keeps_the_triangulation_sound(
        points in prop::collection::vec(prop_oneof![lattice(), generic()], 1..60),
        out in prop::collection::vec(any::<prop::sample::Index>(), 0..40),
    ) {
        let mut kernel = Kernel::new();
        let mut ids: Vec<u32> = points.into_iter().filter_map(|p| kernel.insert(p)).collect();
        kernel.assert_sound();
        for index in out {
            if ids.is_empty() {
                break;
            }
            let v = ids.swap_remove(index.index(ids.len()));
            prop_assert_eq!(
                kernel.worker.remove(&kernel.triangulation, v).expect("room"),
                Removal::Done
            );
            prop_assert_eq!(
                kernel.worker.remove(&kernel.triangulation, v).expect("room"),
                Removal::Stale
            );
            kernel.assert_sound();
        }
    }

    #[test]
    fn removal_undoes_insertion(
        base in prop::collection::vec(lattice(), 0..40),
        more in prop::collection::vec(lattice(), 1..20),
    ) {
        let mut kernel = Kernel::new();
        for p in base {
            kernel.insert(p);
        }
        let before = kernel.canonical();
        let added: Vec<u32> = more.into_iter().filter_map(|p| kernel.insert(p)).collect();
        for v in added {
            prop_assert_eq!(
                kernel.worker.remove(&kernel.triangulation, v).expect("room"),
                Removal::Done
            );
        }
        prop_assert_eq!(kernel.canonical(), before);
    }
}

#[test]
fn a_point_that_is_there_already_changes_nothing() {
    let mut kernel = Kernel::new();
    kernel.insert(DVec3::splat(1.0));
    let before = kernel.canonical();
    assert!(kernel.insert(DVec3::splat(1.0)).is_none());
    assert_eq!(kernel.canonical(), before);
    kernel.assert_sound();
}

/// More vertices on the boundary of one cavity than have a number of one byte, then twice as many.
#[test]
fn a_star_of_hundreds_of_vertices_is_sound_and_can_be_undone() {
    for count in [200, 254, 255, 256, 257, 600] {
        let mut kernel = Kernel::new();
        let center = DVec3::splat(2.0);
        // Fibonacci's lattice on a sphere.
        for i in 0..count {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
            let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
            let ring = (1.0 - z * z).sqrt();
            assert!(kernel.insert(center + DVec3::new(ring * cos, ring * sin, z)).is_some());
        }
        let before = kernel.canonical();
        let v = kernel.insert(center).expect("not there yet");
        assert_eq!(kernel.worker.created().len(), 2 * count as usize - 4);
        kernel.assert_sound();
        assert_eq!(kernel.worker.remove(&kernel.triangulation, v).expect("room"), Removal::Done);
        kernel.assert_sound();
        assert_eq!(kernel.canonical(), before);
    }
}

/// A stamp is current as long as the tet is the same: of all tets, after insertions; after a
/// removal of those that are there still, and of none that has gone, unless another one with the
/// same last vertex came in its place.
#[test]
fn stamps_tell_which_tets_are_still_there() {
    let mut kernel = Kernel::new();
    let point = |i: u32| {
        (DVec3::new(0.754_877_666, 0.569_840_291, 0.430_159_709) * f64::from(i)).fract() * 4.0
    };
    let mut inserted = Vec::new();
    let (mut stale, mut taken_again) = (0, 0);
    for i in 1..400 {
        let triangulation = &kernel.triangulation;
        let vertices = |t| triangulation.tet(t).vertices();
        let before: Vec<_> =
            triangulation.living_tets().map(|t| (triangulation.stamp(t), vertices(t))).collect();
        let removes = i % 4 == 0;
        if removes {
            let v = inserted.swap_remove(inserted.len() / 2);
            assert_eq!(
                kernel.worker.remove(&kernel.triangulation, v).expect("room"),
                Removal::Done
            );
        } else {
            inserted.extend(kernel.insert(point(i)));
        }
        let triangulation = &kernel.triangulation;
        for (stamp, vertices) in before {
            let now = triangulation.tet(stamp.tet).vertices();
            let lives = triangulation.is_living(stamp.tet) && now == vertices;
            if removes && !lives && triangulation.is_current(stamp) {
                assert!(triangulation.is_living(stamp.tet) && now[3] == vertices[3]);
                taken_again += 1;
            } else {
                assert_eq!(triangulation.is_current(stamp), lives);
            }
            stale += u32::from(!lives);
        }
    }
    assert!(stale > 3000 && taken_again * 20 < stale, "{taken_again} of {stale}");
}
