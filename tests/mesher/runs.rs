//! One run against another: equal input gives equal meshes, a run can be stopped anywhere. And how
//! long a demand is true, and that in the end there is none.

use std::time::Duration;

use lapd::Error;
use lapd::image::phantom::*;
use lapd::image::{Frame, LabelImage};
use lapd::monitor::{CancelFlag, Level, Monitor, Phase, Progress, Step};
use lapd::oracle::Oracle;
use lapd::params::{Adaptive, CertificateLevel, MeshParams, SurfaceModel};
use lapd::pipeline::mesh_image;
use lapd::pipeline::refine::triangulation_around;
use lapd::refine::options::{Limits, RefineOptions};
use lapd::refine::rules::{Facets, Lookups, Rule, Rules};
use lapd::refine::{Asked, examine, refine};
use lapd::sizing::Sizing;
use lapd::verify::distance::Distance;
use lapd::verify::{Certificate, Quality};

use super::{params, run};

/// All facets of a tet: no run here has so many workers that a neighbour could wait in the list of
/// this one.
const NO_WORKER: Facets = Facets::Second(u8::MAX - 1);

/// Rows of labels, cut by the border, with a corner in between: every rule has work here.
pub(super) fn busy_image() -> LabelImage {
    let shells = nested_shells([18; 3], [1.0, 0.9, 1.1], &[4.0, 7.5]).unwrap();
    LabelImage::from_fn(shells.dims(), *shells.frame(), |p| match p.length() {
        r if r <= 4.0 => 1,
        r if r <= 7.5 => 2 + i32::from(p.x > 0.0) + 2 * i32::from(p.y > 1.0),
        _ => 6 * i32::from(p.z > 6.0),
    })
    .unwrap()
}

#[test]
fn equal_input_gives_equal_meshes() {
    let image = busy_image();
    for surface in [SurfaceModel::Smooth, SurfaceModel::Voxel] {
        let params = MeshParams { surface, ..params(1.3) };
        let first = run(&image, &params);
        let again = run(&image, &params);
        assert!(first.mesh == again.mesh);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let pooled = pool.install(|| run(&image, &params));
            assert!(first.mesh == pooled.mesh, "in a pool of {threads}");
            assert_eq!(first.report.certificate, pooled.report.certificate);
            assert_eq!(first.report.quality, pooled.report.quality);
        }
    }
}

/// To go on would change nothing: asked anew no tet demands anything, nor does a facet from either
/// of its sides; the run asked most of them once, before their surroundings were as they are now.
#[test]
fn nothing_is_demanded_when_refinement_has_ended() {
    let image = busy_image();
    for surface in [SurfaceModel::Smooth, SurfaceModel::Voxel] {
        let params = params(1.3);
        let oracle = Oracle::new(&image, surface, &|| Ok(())).unwrap();
        let triangulation = triangulation_around(&oracle, params.delta).unwrap();
        let sizing = Sizing::uniform(params.delta);
        let rules = Rules::new(&triangulation, &oracle, &sizing, &params, image.labels());
        let counters = refine(&rules, &RefineOptions::solo(), &Monitor::silent()).unwrap().counters;
        println!("{surface:?}: {counters:?}");
        assert!(counters.insertions > 1000);
        let order = triangulation.tets_by_place(|| Ok(())).unwrap();
        let (check, unmet) = examine(&rules, &order, Asked::All, &Monitor::silent()).unwrap();
        assert!(check.is_sound(), "{surface:?}: {check:?}");
        assert_eq!(unmet, [0; 6], "{surface:?}");
        let mut facets = 0;
        for t in order {
            let record = triangulation.tet(t);
            let mut interfaces = rules.interfaces(t, record, NO_WORKER);
            facets += interfaces.count_ones();
            let wanted = rules.surface_point(t, &mut interfaces, &mut Lookups::default());
            let wanted = wanted.or_else(|| rules.volume_point(t, record));
            assert!(wanted.is_none(), "{surface:?}: {wanted:?}");
        }
        assert!(facets > 1000, "{surface:?}: {facets} sides of interface facets");
    }
}

#[test]
fn a_demand_is_true_while_its_tets_are_as_they_were_seen() {
    let image = busy_image();
    let oracle = Oracle::new(&image, SurfaceModel::Smooth, &|| Ok(())).unwrap();
    let triangulation = triangulation_around(&oracle, 2.6).unwrap();
    let [coarse, fine] = [2.6, 0.8].map(Sizing::uniform);
    let labels = image.labels();
    let coarse = Rules::new(&triangulation, &oracle, &coarse, &params(2.6), labels);
    refine(&coarse, &RefineOptions::solo(), &Monitor::silent()).unwrap();
    let fine = Rules::new(&triangulation, &oracle, &fine, &params(0.8), labels);
    let (mut demands, mut of_two) = (0, 0);
    for t in triangulation.living_tets() {
        let record = triangulation.tet(t);
        let surface = fine.surface_point(
            t,
            &mut fine.interfaces(t, record, NO_WORKER),
            &mut Lookups::default(),
        );
        for wanted in surface.into_iter().chain(fine.volume_point(t, record)) {
            assert!(fine.still_applies(t, &wanted), "{wanted:?}");
            let relabelled = |other: u32| {
                let record = triangulation.tet(other);
                let tag = record.tag();
                record.set_tag(tag ^ 1);
                let still_applies = fine.still_applies(t, &wanted);
                record.set_tag(tag);
                !still_applies
            };
            let beside =
                (0..4).map(|i| triangulation.tet(t).neighbor(i)).filter(|facet| !facet.is_none());
            let others = beside.clone().filter(|facet| relabelled(facet.tet())).count();
            assert!(relabelled(t) && others == usize::from(wanted.rule == Rule::R3), "{wanted:?}");
            assert!(
                beside.into_iter().all(|facet| !fine.still_applies(facet.tet(), &wanted)),
                "{wanted:?}"
            );
            demands += 1;
            of_two += others;
        }
    }
    assert!(of_two > 100 && demands - of_two > 100, "{demands}, of two tets {of_two}");
}

#[test]
fn what_stays_unmet_is_the_same_on_any_number_of_threads() {
    let image = busy_image();
    let params = params(0.5);
    let oracle = Oracle::new(&image, params.surface, &|| Ok(())).unwrap();
    let triangulation = triangulation_around(&oracle, params.delta).unwrap();
    let sizing = Sizing::uniform(params.delta);
    let rules = Rules::new(&triangulation, &oracle, &sizing, &params, image.labels());
    // Ended early, so that rules still apply.
    let limits = Limits { max_vertices: Some(5000), ..Limits::default() };
    let ended =
        refine(&rules, &RefineOptions { limits, ..RefineOptions::solo() }, &Monitor::silent())
            .unwrap();
    assert!(matches!(ended.ended_by, Some(Error::LimitReached(_))));
    let order = triangulation.tets_by_place(|| Ok(())).unwrap();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| examine(&rules, &order, Asked::All, &Monitor::silent()).unwrap())
    };
    let counted = on(1);
    assert!(counted.1.iter().sum::<u64>() > 100, "{:?}", counted.1);
    assert_eq!(counted, on(3));
}

#[test]
fn progress_is_monotone_and_complete() {
    let mut seen: Vec<Progress> = Vec::new();
    let mut record = |progress| {
        seen.push(progress);
        true
    };
    let meshing =
        mesh_image(&busy_image(), &params(0.7), &Monitor::new(Some(&mut record), None)).unwrap();
    assert!(seen.is_sorted_by(|a, b| a.phase <= b.phase && a.fraction <= b.fraction), "{seen:?}");
    assert!(seen.iter().all(|p| (0.0..=1.0).contains(&p.fraction)));
    for phase in [Phase::Prepare, Phase::Refine, Phase::Extract, Phase::Certify] {
        assert!(seen.iter().any(|p| p.phase == phase), "{phase:?} was not reported");
    }
    let last = seen.last().unwrap();
    assert_eq!(
        (last.phase, last.fraction, last.tets),
        (Phase::Certify, 1.0, meshing.report.all_tets)
    );
}

#[test]
fn what_is_lost_is_said_with_its_place() {
    // A box, a voxel of another label inside, and eight voxels of its label far away: too small for
    // delta.
    let (box_of_16, far) = (|x: f64| x > 1.0 && x < 18.0, |x: f64| x > 19.0 && x < 22.0);
    let frame = Frame::axis_aligned([1.0; 3]).unwrap();
    let image = LabelImage::from_fn([24; 3], frame, |p| match p.to_array() {
        [6.0, 6.0, 6.0] => 2,
        p => i32::from(p.into_iter().all(box_of_16) || p.into_iter().all(far)),
    });
    let mut warnings = Vec::new();
    let mut log = |level, line: &str| {
        if level == Level::Warning {
            warnings.push(line.to_owned());
        }
    };
    let monitor = Monitor::silent().with_log(Some(&mut log));
    mesh_image(&image.unwrap(), &MeshParams { adaptive: Adaptive::Off, ..params(4.0) }, &monitor)
        .unwrap();
    let said = |line: &str| warnings.iter().any(|warning| warning == line);
    assert!(said("labels without a tet: 1, of 1 voxels in all; the first is 2"), "{warnings:?}");
    assert!(
        said("components without a tet: 1; the first, of label 1, at (20.00, 20.00, 20.00)"),
        "{warnings:?}"
    );
}

#[test]
fn a_callback_cancels_at_any_report() {
    let image = busy_image();
    let mut count = 0;
    let mut counting = |_| {
        count += 1;
        true
    };
    mesh_image(&image, &params(1.0), &Monitor::new(Some(&mut counting), None)).unwrap();
    // Each step is reported when it begins; what comes between depends on the time it takes.
    let steps = Step::Done as i32 + 1;
    assert!(count >= steps);
    for stop in 0..steps {
        let mut left = stop;
        let mut calls = 0;
        let mut stopping = |_| {
            calls += 1;
            left -= 1;
            left >= 0
        };
        let result = mesh_image(&image, &params(1.0), &Monitor::new(Some(&mut stopping), None));
        assert!(matches!(result, Err(Error::Cancelled)), "at report {stop}");
        assert_eq!(calls, stop + 1, "the callback was called after it had cancelled");
    }
}

#[test]
fn a_certificate_has_the_level_that_is_asked_for() {
    let image = busy_image();
    let of = |certificate| run(&image, &MeshParams { certificate, ..params(1.0) });
    let full = of(CertificateLevel::Full);
    assert_eq!(full.report.certificate.level, CertificateLevel::Full);
    assert!(full.report.certificate.mesh_to_image.unwrap().mean > 0.0);
    // All but the distances is the same.
    let sound = of(CertificateLevel::Sound);
    let mut expected = full.report.certificate.clone();
    expected.level = CertificateLevel::Sound;
    let clear = |distances: [&mut Option<Distance>; 4]| distances.map(|distance| *distance = None);
    for row in &mut expected.labels {
        clear([
            &mut row.mesh_to_image,
            &mut row.image_to_mesh,
            &mut row.mesh_to_surface,
            &mut row.surface_to_mesh,
        ]);
    }
    for row in &mut expected.components {
        clear([
            &mut row.mesh_to_image,
            &mut row.image_to_mesh,
            &mut row.mesh_to_surface,
            &mut row.surface_to_mesh,
        ]);
    }
    clear([
        &mut expected.mesh_to_image,
        &mut expected.image_to_mesh,
        &mut expected.mesh_to_surface,
        &mut expected.surface_to_mesh,
    ]);
    assert_eq!(sound.report.certificate, expected);
    assert_eq!(sound.report.quality, full.report.quality);
    let none = of(CertificateLevel::None);
    assert_eq!(none.report.certificate, Certificate::none());
    assert_eq!(none.report.quality, Quality::default());
    for other in [sound, none] {
        assert!(other.mesh == full.mesh);
        assert_eq!(other.report.all_tets, full.report.all_tets);
        assert_eq!(other.report.all_vertices, full.report.all_vertices);
    }
}

/// The limit of time is reached while the certificate is measured. Where the mesh may be partial
/// only the distances are left out.
#[test]
fn a_limit_of_time_counts_for_the_certificate() {
    let image = busy_image();
    // At the beginning of the certificate, and at that of the distances.
    for from in [0.55, 0.71] {
        for partial in [false, true] {
            let mut slept = false;
            let mut sleeping = |progress: Progress| {
                if !slept && progress.phase == Phase::Certify && progress.fraction >= from {
                    std::thread::sleep(Duration::from_millis(3100));
                    slept = true;
                }
                true
            };
            let monitor = Monitor::new(Some(&mut sleeping), None);
            let limited = MeshParams { time_limit: Some(3.0), partial, ..params(1.0) };
            // A pool of its own: that of all tests may be busy for seconds.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let meshing = pool.install(|| mesh_image(&image, &limited, &monitor));
            match (partial, meshing) {
                (false, Err(Error::TimeLimit(_))) => {}
                (true, Ok(meshing)) => {
                    assert!(matches!(meshing.ended_by, Some(Error::TimeLimit(_))));
                    assert_eq!(meshing.report.certificate.level, CertificateLevel::Sound);
                    assert!(!meshing.mesh.tets.is_empty());
                }
                (_, other) => panic!("{partial}: {:?}", other.map(|_| ())),
            }
        }
    }
}

#[test]
fn a_flag_cancels_in_every_phase() {
    let image = busy_image();
    for phase in [Phase::Prepare, Phase::Refine, Phase::Extract, Phase::Certify] {
        let flag = CancelFlag::default();
        let mut raise = |progress: Progress| {
            if progress.phase == phase {
                flag.cancel();
            }
            true
        };
        let result = mesh_image(&image, &params(1.0), &Monitor::new(Some(&mut raise), Some(&flag)));
        assert!(matches!(result, Err(Error::Cancelled)), "{phase:?}");
    }
    let raised = CancelFlag::default();
    raised.cancel();
    assert!(matches!(
        mesh_image(&image, &params(1.0), &Monitor::new(None, Some(&raised))),
        Err(Error::Cancelled)
    ));
}

#[test]
fn another_thread_cancels_a_run_that_would_take_minutes() {
    let image = ball([20; 3], [1.0; 3], 8.0).unwrap();
    let flag = CancelFlag::default();
    let started = CancelFlag::default();
    let start = std::time::Instant::now();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !started.is_cancelled() {
                std::thread::yield_now();
            }
            flag.cancel();
        });
        let mut in_refinement = |progress: Progress| {
            if progress.phase == Phase::Refine {
                started.cancel();
            }
            true
        };
        let result =
            mesh_image(&image, &params(0.02), &Monitor::new(Some(&mut in_refinement), Some(&flag)));
        assert!(matches!(result, Err(Error::Cancelled)));
    });
    assert!(start.elapsed().as_secs() < 5, "cancelling took {:?}", start.elapsed());
}

#[test]
fn max_vertices_is_exact() {
    let image = ball([16; 3], [1.0; 3], 6.0).unwrap();
    let free = run(&image, &params(1.0));
    let limited = |max: u64| {
        let params = MeshParams { max_vertices: Some(max as usize), ..params(1.0) };
        mesh_image(&image, &params, &Monitor::silent())
    };
    // The least limit that suffices: the most vertices that were there at any time, by bisection.
    let (mut fails, mut suffices) = (0, free.report.operations.insertions);
    assert!(limited(suffices).is_ok());
    while suffices - fails > 1 {
        let middle = fails.midpoint(suffices);
        match limited(middle) {
            Ok(_) => suffices = middle,
            Err(Error::LimitReached(message)) => {
                assert!(message.contains(&middle.to_string()), "{message}");
                fails = middle;
            }
            Err(e) => panic!("{e}"),
        }
    }
    let end = free.report.operations.insertions - free.report.operations.removals;
    println!(
        "{end} vertices, {suffices} at the peak, {} removals",
        free.report.operations.removals
    );
    assert_eq!(
        end + 8,
        free.report.all_vertices,
        "all vertices are those inserted, and the corners of the box"
    );
    assert!((end..=end + free.report.operations.removals).contains(&suffices));
    assert!(limited(suffices).unwrap().mesh == free.mesh);
}

#[test]
fn a_limit_gives_a_partial_mesh_where_asked() {
    let image = busy_image();
    let free = run(&image, &params(1.0));
    assert!(free.ended_by.is_none());
    let limited = |params: MeshParams| mesh_image(&image, &params, &Monitor::silent());
    let half =
        MeshParams { max_vertices: Some(free.mesh.points.len() / 2), partial: true, ..params(1.0) };
    let partial = limited(half.clone()).unwrap();
    assert!(matches!(partial.ended_by, Some(Error::LimitReached(_))));
    let certificate = &partial.report.certificate;
    assert_eq!(
        [
            certificate.non_delaunay_facets.expect("counted by the run"),
            certificate.inverted_tets,
            certificate.orphan_vertices,
            certificate.open_edges
        ],
        [0; 4]
    );
    assert!(certificate.unmet.unwrap().iter().sum::<u64>() > 0);
    assert!(partial.mesh.points.len() < free.mesh.points.len());
    // Limits of vertices and memory are reached at the same operation in every run.
    assert!(limited(half).unwrap().mesh == partial.mesh);
    let scarce = MeshParams { max_memory: Some(12 << 20), partial: true, ..params(0.3) };
    let partial = limited(scarce.clone()).unwrap();
    assert!(matches!(partial.ended_by, Some(Error::MemoryLimit(_))));
    assert!(limited(scarce).unwrap().mesh == partial.mesh);

    let none = limited(MeshParams { max_vertices: Some(1), partial: true, ..params(1.0) });
    assert!(matches!(none, Err(Error::LimitReached(_))));
    let late = limited(MeshParams { time_limit: Some(1e-9), partial: true, ..params(1.0) });
    assert!(matches!(late, Err(Error::TimeLimit(_))));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = limited(MeshParams { time_limit: Some(bad), ..params(1.0) });
        assert!(matches!(refused, Err(Error::InvalidArgument(_))), "{bad}");
    }
}
