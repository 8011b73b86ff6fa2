//! Distances whose values are known, or found by brute force.

use std::sync::Mutex;

use super::from_mesh::Parts;
use super::*;
use crate::geometry::shape::closest_point;
use crate::image::Frame;
use crate::mesh::testing;
use crate::params::SurfaceModel;
use crate::refine::options::Limits;

fn oracle(image: &LabelImage, model: SurfaceModel) -> Oracle {
    Oracle::new(image, model, &|| Ok(())).unwrap()
}

fn measured(mesh: &TetMesh, image: &LabelImage) -> Distances {
    both(mesh, image, SurfaceModel::Voxel).faces
}

fn both(mesh: &TetMesh, image: &LabelImage, model: SurfaceModel) -> BothDistances {
    let monitor = Monitor::silent();
    let image_components = ImageComponents::new(image, &|_| Ok(())).unwrap();
    let mesh_components = MeshComponents::new(mesh, image, &image_components, &monitor).unwrap();
    Distances::measure(
        mesh,
        image,
        &mesh_components,
        &image_components,
        &oracle(image, model),
        &|_| Ok(()),
        &monitor,
    )
    .unwrap()
}

fn close(a: f64, b: f64) {
    assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{a} is not {b}");
}

/// An image and the mesh that reproduces its voxels exactly, both in the same turned and reflected
/// frame.
fn pair(label: impl Fn(usize, usize, usize) -> i32 + Copy) -> (TetMesh, LabelImage) {
    let (dims, spacing) = ([5, 4, 3], [0.5, 1.0, 2.0]);
    let direction = [[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [1.0, 0.0, 0.0]];
    let frame = Frame::new([10.0, -20.0, 30.0], spacing, direction).unwrap();
    let mut mesh = testing::kuhn_box(dims, [1.0; 3], label);
    for p in &mut mesh.points {
        *p = frame.to_world(DVec3::from_array(*p) - 0.5).to_array();
    }
    (mesh, testing::image(dims, frame, label))
}

fn two_labels(i: usize, j: usize, k: usize) -> i32 {
    if j == 0 && k == 0 { 0 } else { 1 + i32::from(i > 1) }
}

#[test]
fn a_mesh_of_the_voxels_has_no_distance() {
    let (mesh, image) = pair(two_labels);
    let distance = measured(&mesh, &image).whole;
    for side in [distance.mesh_to_image, distance.image_to_mesh] {
        assert!(side.max < 1e-12 && side.mean < 1e-12, "{distance:?}");
    }
}

#[test]
fn a_shift_is_the_distance() {
    // A box shifted along its first axis: its two ends are 0.25 off, the sides do not notice but
    // for the rim.
    let (mut mesh, image) = pair(|_, _, _| 1);
    for p in &mut mesh.points {
        *p = (DVec3::from_array(*p) + image.frame().direction().x_axis * 0.25).to_array();
    }
    let distance = measured(&mesh, &image).whole;
    close(distance.mesh_to_image.max, 0.25);
    close(distance.image_to_mesh.max, 0.25);
    // The ends have area 2 * 24, the sides 2.5 * 20; of these only the samples near the rim (and
    // none of the face centres) are off.
    close(distance.image_to_mesh.mean, 0.25 * 48.0 / 98.0);
    assert!(
        distance.mesh_to_image.mean > 0.25 * 48.0 / 98.0
            && distance.mesh_to_image.mean < 0.25 * 60.0 / 98.0
    );
}

#[test]
fn both_sides_against_brute_force() {
    let (mut mesh, image) = pair(|i, j, k| ((i * 7 + j * 5 + k * 3) % 4) as i32);
    for (v, p) in mesh.points.iter_mut().enumerate() {
        *p = p.map(|x| x + 0.4 * ((v * 37 % 11) as f64 / 11.0 - 0.5));
    }
    let measured = measured(&mesh, &image).whole;

    let faces = VoxelFaces::new(&image, &Monitor::silent()).unwrap();
    let all = faces.all();
    let frame = image.frame();
    let triangles: Vec<[DVec3; 3]> = mesh
        .facets
        .iter()
        .map(|f| f.map(|v| (frame.to_index(mesh.point(v)) + 0.5) * frame.spacing()))
        .collect();
    let sampled = |step: f64| {
        let mut sum = Sum::default();
        for triangle in &triangles {
            let parts = Parts::new(triangle, step);
            let each = |p: DVec3, _| {
                let squared =
                    all.iter().map(|&f| faces.distance_squared(f, p)).fold(f64::INFINITY, f64::min);
                sum += Sum::of(parts.area(), squared.sqrt());
                Ok(())
            };
            parts.for_each(each).unwrap();
        }
        sum
    };
    let (there, finely) = (sampled(PART * 0.5), sampled(0.02));
    let to_mesh = |p: DVec3| {
        triangles.iter().map(|t| p.distance(closest_point(t, p))).fold(f64::INFINITY, f64::min)
    };
    let mut back = Sum::default();
    for &face in &all {
        back += Sum::of(faces.area(face), to_mesh(faces.centre(face)));
        for corner in faces.corners(face) {
            back.max = back.max.max(to_mesh(corner));
        }
    }
    let (there, finely, back) = (there.distance(), finely.distance(), back.distance());
    close(measured.mesh_to_image.mean, there.mean);
    // Fine samples find no more than the tolerance allows, and miss no more than lies between them.
    let tolerance = TOLERANCE * 0.5;
    assert!(
        finely.max <= measured.mesh_to_image.max + tolerance,
        "{} {}",
        finely.max,
        measured.mesh_to_image.max
    );
    assert!(
        measured.mesh_to_image.max <= finely.max + 0.02,
        "{} {}",
        finely.max,
        measured.mesh_to_image.max
    );
    assert!(finely.max > there.max + tolerance, "the test's samples would have done");
    close(measured.image_to_mesh.mean, back.mean);
    close(measured.image_to_mesh.max, back.max);
    assert!(there.max > 0.1 && back.max > 0.1);
}

#[test]
fn components_are_held_against_their_own_label() {
    let (mut mesh, image) = pair(|i, j, k| ((i * 7 + j * 5 + k * 3) % 4) as i32);
    for (v, p) in mesh.points.iter_mut().enumerate() {
        *p = p.map(|x| x + 0.4 * ((v * 37 % 11) as f64 / 11.0 - 0.5));
    }
    let monitor = Monitor::silent();
    let components = ImageComponents::new(&image, &|_| Ok(())).unwrap();
    let parts = MeshComponents::new(&mesh, &image, &components, &monitor).unwrap();
    let measured = Distances::measure(
        &mesh,
        &image,
        &parts,
        &components,
        &oracle(&image, SurfaceModel::Voxel),
        &|_| Ok(()),
        &monitor,
    )
    .unwrap()
    .faces;
    let faces = VoxelFaces::new(&image, &monitor).unwrap();
    let all = faces.all();
    let frame = image.frame();
    let local = |v: u32| (frame.to_index(mesh.point(v)) + 0.5) * frame.spacing();

    let mut of_image = vec![Sum::default(); components.list.len()];
    for &face in &all {
        for component in
            faces.voxels(face).into_iter().flatten().filter_map(|voxel| components.at(voxel))
        {
            let label = image.labels()[usize::from(components.list[component as usize].id)];
            let own = || {
                mesh.facets
                    .iter()
                    .zip(&mesh.facet_labels)
                    .filter(|(_, labels)| labels.contains(&label))
            };
            let to_mesh = |p: DVec3| {
                let distances = own().map(|(f, _)| p.distance(closest_point(&f.map(local), p)));
                distances.fold(f64::INFINITY, f64::min)
            };
            let sum = &mut of_image[component as usize];
            *sum += Sum::of(faces.area(face), to_mesh(faces.centre(face)));
            sum.max = faces
                .corners(face)
                .into_iter()
                .fold(sum.max, |max, corner| max.max(to_mesh(corner)));
        }
    }
    let mut of_mesh = vec![Sum::default(); parts.list.len()];
    for (f, facet) in mesh.facets.iter().enumerate() {
        for component in mesh.facet_tets[f].into_iter().filter_map(|t| parts.of(t)) {
            let id = image.id_of(parts.list[component as usize].label).unwrap();
            let own: Vec<_> = all.iter().filter(|&&face| faces.touches(face, id)).collect();
            let parts = Parts::new(&facet.map(local), PART * 0.5);
            let each = |p: DVec3, _| {
                let squared = own
                    .iter()
                    .map(|&&face| faces.distance_squared(face, p))
                    .fold(f64::INFINITY, f64::min);
                of_mesh[component as usize] += Sum::of(parts.area(), squared.sqrt());
                Ok(())
            };
            parts.for_each(each).unwrap();
        }
    }
    assert!(of_image.len() >= 3 && of_mesh.len() > 8);
    for (found, expected) in
        measured.of_image.iter().zip(&of_image).chain(measured.of_mesh.iter().zip(&of_mesh))
    {
        close(found.distance().mean, expected.distance().mean);
        close(found.distance().max, expected.distance().max);
    }
}

#[test]
fn equal_bits_on_any_number_of_threads() {
    let dims = [14, 12, 11];
    let label = |i: usize, j: usize, k: usize| ((i / 2 + j / 3 * k) % 3) as i32;
    let frame = Frame::new(
        [3.0, 2.0, 1.0],
        [0.5, 1.0, 0.8],
        [[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [1.0, 0.0, 0.0]],
    );
    let image = testing::image(dims, frame.unwrap(), label);
    let mut mesh = testing::kuhn_box(dims, [1.0; 3], label);
    for (v, p) in mesh.points.iter_mut().enumerate() {
        let index = DVec3::from_array(*p) - 0.5 + 0.4 * ((v * 37 % 101) as f64 / 101.0 - 0.5);
        *p = image.frame().to_world(index).to_array();
    }
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let both = both(&mesh, &image, SurfaceModel::Smooth);
            (both.faces.whole, both.surface.whole, both.surface.of_image)
        })
    };
    assert!(mesh.facets.len() > 5 * CHUNK);
    let measured = on(1);
    assert!(measured.0.mesh_to_image.max > 0.1 && measured.0.image_to_mesh.max > 0.1);
    assert_eq!(measured, on(3));
}

#[test]
fn samples_cover_the_triangle() {
    let triangle = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(1.0, 2.0, 0.0)];
    let (mut area, mut moment, mut samples) = (0.0, DVec3::ZERO, Vec::new());
    let mut radius = 0.0_f64;
    let parts = Parts::new(&triangle, 0.18);
    let weight = parts.area();
    close(weight, 3.0 / 100.0);
    let each = |p: DVec3, arms: [DVec3; 3]| {
        for corner in arms.map(|arm| p + arm) {
            // Inside of the triangle: corners of the parts are those of the grid that cuts it.
            let v = 10.0 * corner.y / triangle[2].y;
            let u = (10.0 * corner.x - v * triangle[2].x) / triangle[1].x;
            assert!(u > -1e-9 && v > -1e-9 && u + v < 10.0 + 1e-9, "{corner}");
            assert!((u - u.round()).abs() < 1e-9 && (v - v.round()).abs() < 1e-9, "{corner}");
            radius = radius.max(corner.distance(p));
        }
        area += weight;
        moment += p * weight;
        samples.push(p);
        Ok(())
    };
    parts.for_each(each).unwrap();
    assert_eq!(samples.len(), 10 * 10);
    assert!(radius <= 0.18);
    close(area, 3.0);
    assert!((moment / area).distance(DVec3::new(4.0, 2.0, 0.0) / 3.0) < 1e-12);
    for (i, j) in (0..=60).flat_map(|i| (0..=60 - i).map(move |j| (i, j))) {
        let p = triangle[1] * (f64::from(i) / 60.0) + triangle[2] * (f64::from(j) / 60.0);
        assert!(samples.iter().any(|sample| sample.distance(p) <= radius * (1.0 + 1e-12)), "{p}");
    }
}

#[test]
fn a_missing_side_is_infinitely_far() {
    let (_, image) = pair(|_, _, _| 1);
    let measured = measured(&TetMesh::default(), &image).whole;
    assert_eq!(measured.mesh_to_image, Distance::default());
    assert_eq!(measured.image_to_mesh, Distance { mean: f64::INFINITY, max: f64::INFINITY });
    let surface = both(&TetMesh::default(), &image, SurfaceModel::Smooth).surface.whole;
    assert_eq!(surface.image_to_mesh, Distance { mean: f64::INFINITY, max: f64::INFINITY });
    // Label 3 is in the mesh alone.
    let (stray, _) = pair(|_, _, _| 3);
    let (_, image) = pair(two_labels);
    assert_eq!(
        both(&stray, &image, SurfaceModel::Smooth).faces.of_mesh[0].distance().max,
        f64::INFINITY
    );
}

/// In the voxel model dO is the faces of the voxels.
#[test]
fn distances_to_the_surface_of_the_voxel_model() {
    let (mesh, image) = pair(two_labels);
    let BothDistances { surface, .. } = both(&mesh, &image, SurfaceModel::Voxel);
    // The crossings of the oracle are found to a thousandth of a voxel.
    assert!(surface.whole.mesh_to_image.max < 2e-3, "{:?}", surface.whole);
    assert!(surface.whole.image_to_mesh.max < 1e-9, "{:?}", surface.whole);

    let (mut mesh, image) = pair(|_, _, _| 1);
    for p in &mut mesh.points {
        *p = (DVec3::from_array(*p) + image.frame().direction().x_axis * 0.25).to_array();
    }
    let BothDistances { faces, surface } = both(&mesh, &image, SurfaceModel::Voxel);
    // What is looked for beside a facet is a little too far.
    let right = 0.248..0.27;
    assert!(right.contains(&surface.whole.mesh_to_image.max), "{:?}", surface.whole);
    close(surface.whole.image_to_mesh.max, 0.25);
    close(surface.whole.image_to_mesh.mean, faces.whole.image_to_mesh.mean);
    close(surface.of_image[0].distance().max, 0.25);
    assert!(right.contains(&surface.of_mesh[0].distance().max));
}

/// Two labels of which one is heavier: the smooth interface is off the voxel faces, and a mesh that
/// has it there has no distance to it.
#[test]
fn distances_to_the_smooth_surface() {
    let label =
        |i: usize, j: usize, k: usize| 1 + i32::from(i > 1 && (1..3).contains(&j) && k == 1);
    let (mut mesh, image) = pair(label);
    let oracle = oracle(&image, SurfaceModel::Smooth);
    let at = oracle.crossed_at([1, 0, 0], 0, [1, 2]);
    assert!((at - 0.5).abs() > 0.01, "{at}");
    let before = both(&mesh, &image, SurfaceModel::Smooth).surface;
    // The plane between the labels across the first axis comes to where dO crosses the edges
    // between centres.
    for p in &mut mesh.points {
        let mut index = image.frame().to_index(DVec3::from_array(*p));
        if (index.x - 1.5).abs() < 1e-9 {
            index.x = 1.0 + at;
        }
        *p = image.frame().to_world(index).to_array();
    }
    let after = both(&mesh, &image, SurfaceModel::Smooth).surface;
    assert!(after.of_image[1].distance().mean < before.of_image[1].distance().mean, "{at}");
    assert!(before.whole.mesh_to_image.max > 0.01 && before.whole.mesh_to_image.max <= 2.0 * 2.0);
}

#[test]
fn bad_vertices_and_cancellation_are_errors() {
    let (mut mesh, image) = pair(|_, _, _| 1);
    let silent = Monitor::silent();
    let components = ImageComponents::new(&image, &|_| Ok(())).unwrap();
    let parts = MeshComponents::new(&mesh, &image, &components, &silent).unwrap();
    let oracle = oracle(&image, SurfaceModel::Smooth);
    let flag = crate::monitor::CancelFlag::default();
    flag.cancel();
    let cancelled = Distances::measure(
        &mesh,
        &image,
        &parts,
        &components,
        &oracle,
        &|_| Ok(()),
        &Monitor::new(None, Some(&flag)),
    );
    assert!(matches!(cancelled, Err(Error::Cancelled)));
    mesh.points[3][1] = f64::NAN;
    let measure = |mesh: &TetMesh, check_memory: &(dyn Fn(u64) -> Result<()> + Sync)| {
        Distances::measure(mesh, &image, &parts, &components, &oracle, check_memory, &silent).err()
    };
    let refused = measure(&mesh, &|_| Ok(())).unwrap().to_string();
    assert!(refused.starts_with("vertex 3 is not finite"), "{refused}");
    mesh.points[3][1] = 0.0;
    // First what mesh and image need for sure, then the lists of the bricks, too.
    let asked = Mutex::new(Vec::new());
    let note = |bytes| {
        asked.lock().unwrap().push(bytes);
        Ok(())
    };
    assert!(measure(&mesh, &note).is_none());
    let asked = asked.into_inner().unwrap();
    assert!(asked.len() == 2 && asked[0] > 0 && asked[0] < asked[1], "{asked:?}");
    for most in [asked[0] - 1, asked[1] - 1] {
        let limits = Limits { max_memory: Some(most), ..Limits::default() };
        let ended = measure(&mesh, &|bytes| limits.check_memory(bytes));
        assert!(matches!(ended, Some(Error::MemoryLimit(_))));
    }
}
