//! Predicates by what decides them: the cached circumsphere, as nearly always in a run; what it
//! leaves open, the static filter of the exact predicate; its exact arithmetic; the tie-break by
//! perturbation.

use std::hint::black_box;

use criterion::{Criterion, Throughput};
use glam::DVec3;
use lapd::geometry::predicates::{in_sphere, in_sphere_perturbed, orient};
use lapd::geometry::sphere::Circumsphere;

use crate::Random;

const TETS: usize = 4096;

/// A tet and a point to test against it.
type Case = ([DVec3; 4], DVec3);

pub fn run(criterion: &mut Criterion) {
    let mut random = Random(1);
    let tets: Vec<[DVec3; 4]> =
        std::iter::repeat_with(|| positive([(); 4].map(|()| random.point())))
            .filter(|&[a, b, c, d]| orient(a, b, c, d) > 0.01)
            .take(TETS)
            .collect();
    let spheres: Vec<Circumsphere> =
        tets.iter().map(|&[a, b, c, d]| Circumsphere::of_tet(a, b, c, d)).collect();
    // At this part of the radius from the circumcenter, above 1 or below.
    let mut at = |part: f64| -> Vec<Case> {
        let mut side = 1.0;
        tets.iter()
            .zip(&spheres)
            .map(|(&tet, sphere)| {
                side = -side;
                (
                    tet,
                    sphere.center
                        + random.direction() * sphere.center.distance(tet[0]) * (1.0 + side * part),
                )
            })
            .collect()
    };
    let (far, near, on) = (at(0.3), at(1e-9), at(0.0));
    let undecided =
        on.iter().zip(&spheres).filter(|((_, p), sphere)| sphere.contains(*p).is_none()).count();
    assert!(undecided > TETS * 9 / 10, "the cached spheres decide what they cannot know");
    // Corners of cubes, as voxels have them.
    let cube = |i: usize| DVec3::from([i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| bit as f64));
    let cospherical: Vec<Case> = (0..TETS)
        .map(|i| {
            let origin = DVec3::from([i % 16, i / 16 % 16, i / 256].map(|x| x as f64));
            let tet = [0, 1, 2, 4].map(|corner| origin + cube(corner ^ (i & 7)));
            (positive(tet), origin + cube(i & 7 ^ 7))
        })
        .collect();
    assert!(cospherical.iter().all(|&([a, b, c, d], p)| in_sphere(a, b, c, d, p) == 0.0));
    let coplanar: Vec<Case> = tets
        .iter()
        .map(|&[a, b, c, d]| ([a, b, c, d], a + (b - a) * 0.3 + (c - a) * 0.4))
        .collect();

    let mut group = criterion.benchmark_group("geometry");
    group.throughput(Throughput::Elements(TETS as u64));
    group.bench_function("circumsphere", |bencher| {
        bencher.iter(|| {
            tets.iter().map(|&[a, b, c, d]| Circumsphere::of_tet(a, b, c, d).center.x).sum::<f64>()
        });
    });
    group.bench_function("in_sphere/cached", |bencher| {
        bencher.iter(|| {
            let inside =
                |(case, sphere): &(&Case, &Circumsphere)| sphere.contains(case.1) == Some(true);
            black_box(&far).iter().zip(&spheres).filter(inside).count()
        });
    });
    for (name, cases) in [("static filter", &near), ("exact", &on), ("perturbation", &cospherical)]
    {
        group.bench_function(format!("in_sphere/{name}"), |bencher| {
            bencher.iter(|| {
                black_box(cases).iter().filter(|&&(tet, p)| in_sphere_perturbed(tet, p)).count()
            });
        });
    }
    for (name, cases) in [("static filter", &far), ("exact", &coplanar)] {
        group.bench_function(format!("orient/{name}"), |bencher| {
            bencher.iter(|| {
                black_box(cases)
                    .iter()
                    .filter(|&&([a, b, c, _], p)| orient(a, b, c, p) > 0.0)
                    .count()
            });
        });
    }
    group.finish();
}

/// The tet in the order that makes it positive.
fn positive([a, b, c, d]: [DVec3; 4]) -> [DVec3; 4] {
    if orient(a, b, c, d) > 0.0 { [a, b, c, d] } else { [b, a, c, d] }
}
