//! The report of a run, as plain structs that may grow; the tables of its certificate are in
//! [`tables`](super::tables).

use super::boundary::{Failure, Growing, Out, Outcome, borrow, fill_struct, status_of};
use super::level::lapd_certificate_level;
use super::mesh::lapd_mesh;
use super::status::lapd_status;
use crate::params::CertificateLevel;
use crate::pipeline::MeshResult;
use crate::verify::Certificate;
use crate::verify::distance::Distance;

/// How large a mesh is. Set struct_size to sizeof(lapd_counts) before the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_counts {
    /// sizeof(lapd_counts), set by the caller.
    pub struct_size: u64,
    /// Vertices of the mesh.
    pub vertices: u64,
    /// Tets of the mesh, the background included where it was kept.
    pub tets: u64,
    /// Tets of the mesh with a label other than 0.
    pub tissue_tets: u64,
    /// Facets between two labels.
    pub interface_facets: u64,
    /// Vertices of the whole triangulation, when refinement ended, the corners of the box around it
    /// included.
    pub all_vertices: u64,
    /// Tets of the whole triangulation, when refinement ended.
    pub all_tets: u64,
    /// Bytes of what refinement keeps of the image: labels, and where interfaces are.
    pub oracle_bytes: u64,
}

/// Wall-clock seconds of the phases of a run. Set struct_size to sizeof(lapd_timings) before the
/// call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_timings {
    /// sizeof(lapd_timings), set by the caller.
    pub struct_size: u64,
    /// Preparing the image: volumes and weights of the labels, where the interfaces are.
    pub prepare: f64,
    /// From there to the last rule satisfied.
    pub refine: f64,
    /// Collecting the mesh, and giving back the memory of the triangulation.
    pub extract: f64,
    /// Measuring quality and certificate.
    pub certify: f64,
    /// Removing slivers.
    pub improve: f64,
}

/// What refinement did, all threads together. Set struct_size to sizeof(lapd_operations) before the
/// call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_operations {
    /// sizeof(lapd_operations), set by the caller.
    pub struct_size: u64,
    /// Vertices inserted.
    pub insertions: u64,
    /// Vertices removed.
    pub removals: u64,
    /// Operations given up because of a conflict with another thread: 0 with 1 thread.
    /// lapd_thread_report has more about them.
    pub rollbacks: u64,
    /// Predicates that floating point could not decide.
    pub exact_predicates: u64,
    /// In-sphere tests of insertions.
    pub in_sphere_tests: u64,
    /// Tets created, living or not.
    pub tets_created: u64,
    /// Tets that insertions destroyed: the tets of all cavities.
    pub cavity_tets: u64,
    /// Tets that the rules were asked of.
    pub inspections: u64,
    /// Labels of points that the rules asked for.
    pub label_lookups: u64,
    /// Crossings of segments with the interfaces that the rules asked for.
    pub crossing_lookups: u64,
    /// Vertices that each of rules R1 to R5 inserted, and those that R6 removed, in this order.
    pub by_rule: [u64; 6],
}

/// Shape of the tets with a label other than 0, and of the interface facets. Set struct_size to
/// sizeof(lapd_quality) before the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_quality {
    /// sizeof(lapd_quality), set by the caller.
    pub struct_size: u64,
    /// Smallest dihedral angle, degrees.
    pub min_dihedral: f64,
    /// Largest dihedral angle, degrees.
    pub max_dihedral: f64,
    /// Largest ratio of circumradius to shortest edge.
    pub max_radius_edge: f64,
    /// Smallest planar angle of interface facets, degrees.
    pub min_facet_angle: f64,
    /// Dihedral angles, six for each tet, in bins of 10 degrees.
    pub dihedral_histogram: [u64; 18],
    /// Least scaled Jacobian: 1 for a regular tet, 0 for a flat one. This and the measures below
    /// are those of Verdict and VTK.
    pub min_scaled_jacobian: f64,
    /// Largest scaled Jacobian.
    pub max_scaled_jacobian: f64,
    /// Scaled Jacobians in bins of 1/20 from 0 on.
    pub scaled_jacobian_histogram: [u64; 20],
    /// Least ratio of longest to shortest edge; 1 for a regular tet.
    pub min_edge_ratio: f64,
    /// Largest ratio of longest to shortest edge.
    pub max_edge_ratio: f64,
    /// Edge ratios in bins of 1/4 from 1 on; the last one has all beyond, too.
    pub edge_ratio_histogram: [u64; 20],
    /// Least ratio of circumradius to three inradii; 1 for a regular tet.
    pub min_radius_ratio: f64,
    /// Largest ratio of circumradius to three inradii; infinite with a flat tet.
    pub max_radius_ratio: f64,
    /// Radius ratios in bins of 1/4 from 1 on; the last one has all beyond, too.
    pub radius_ratio_histogram: [u64; 20],
}

/// What was checked on the finished mesh. Set struct_size to sizeof(lapd_certificate) before the
/// call. Lengths are in world units.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_certificate {
    /// sizeof(lapd_certificate), set by the caller.
    pub struct_size: u64,
    /// Facets with a vertex of a neighbour inside the circumsphere, by exact arithmetic, as
    /// refinement left the mesh: 0, as that is Delaunay. lapd_improvement tells of the mesh without
    /// slivers. LAPD_NOT_COUNTED where the run had no certificate and the mesh was improved since.
    /// In a mesh that lapd_mesh_from_arrays made, those of that mesh.
    pub non_delaunay_facets: u64,
    /// Tets without positive volume, by exact arithmetic.
    pub inverted_tets: u64,
    /// Vertices of no tet.
    pub orphan_vertices: u64,
    /// Edges where an interface is open.
    pub open_edges: u64,
    /// What stayed unmet of rules R1 to R6, in this order; LAPD_NOT_COUNTED where the run had no
    /// certificate, and in a mesh that lapd_mesh_from_arrays made.
    pub unmet: [u64; 6],
    /// Mean distance from the mesh's interfaces to those of the image.
    pub mesh_to_image_mean: f64,
    /// Largest distance from the mesh's interfaces to those of the image, to within a hundredth of
    /// the smallest spacing.
    pub mesh_to_image_max: f64,
    /// Mean distance from the image's interfaces to those of the mesh.
    pub image_to_mesh_mean: f64,
    /// Largest distance from the image's interfaces to those of the mesh.
    pub image_to_mesh_max: f64,
    /// Mean distance from the mesh's interfaces to the smooth ones: from the centroids of facets
    /// along their normals, two largest spacings at most.
    pub mesh_to_surface_mean: f64,
    /// The largest such distance.
    pub mesh_to_surface_max: f64,
    /// Mean distance from the smooth interfaces, where they cross the edges between voxel centres,
    /// to those of the mesh.
    pub surface_to_mesh_mean: f64,
    /// The largest such distance.
    pub surface_to_mesh_max: f64,
    /// Outer facets that should lie on a wall, a face of the image's box where it cuts the object
    /// off, and do not.
    pub facets_off_walls: u64,
    /// Components of the image, of fewer than LAPD_MIN_COMPONENT_VOXELS, in which the mesh has no
    /// tet.
    pub small_components_lost: u64,
    /// The world position of the first voxel of the first of these; 0 without any.
    pub small_component_lost_at: [f64; 3],
    /// What was measured, a lapd_certificate_level: LAPD_CERTIFICATE_SOUND or more. Without
    /// LAPD_CERTIFICATE_FULL all distances are NaN.
    pub level: i64,
}

/// What one thread of the refinement did, and with what it lost time. Set struct_size to
/// sizeof(lapd_thread_report) before the call.
///
/// Of the seconds that refinement took (lapd_timings) a thread worked those that it did not lose.
/// With 1 thread none are lost.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_thread_report {
    /// sizeof(lapd_thread_report), set by the caller.
    pub struct_size: u64,
    /// Vertices inserted.
    pub insertions: u64,
    /// Vertices removed.
    pub removals: u64,
    /// Tets created, living or not.
    pub tets_created: u64,
    /// Operations given up because another thread was using a vertex.
    pub rollbacks: u64,
    /// Of these, the insertions for each of rules R1 to R5, and the removals for R6, in this order.
    pub rollbacks_by_rule: [u64; 6],
    /// Operations given up because another thread had changed the place before it was locked.
    pub stale: u64,
    /// Seconds spent in operations that were given up.
    pub rollback_seconds: f64,
    /// Seconds spent waiting after conflicts.
    pub contention_seconds: f64,
    /// Seconds spent without work.
    pub idle_seconds: f64,
    /// How often the thread waited after a conflict.
    pub waits: u64,
    /// How often it asked others for work.
    pub begs: u64,
    /// How often it gave work to another thread.
    pub gifts: u64,
    /// Tets and vertices that its operations visited in the memory of its own node; 0 where
    /// accesses were not counted (lapd_params_set_count_accesses).
    pub local_accesses: u64,
    /// Those that they visited in the memory of other nodes.
    pub remote_accesses: u64,
    /// The hops to other nodes' memory, summed up over all accesses.
    pub access_hops: u64,
}

/// "Not counted", as one of the counts of lapd_certificate that say so.
pub const LAPD_NOT_COUNTED: u64 = -1_i64 as u64;

// cbindgen knows no u64::MAX.
const _: () = assert!(LAPD_NOT_COUNTED == u64::MAX);

/// "The sum of all threads", as the number of a thread.
pub const LAPD_ALL_THREADS: usize = -1_isize as usize;

// cbindgen knows no usize::MAX.
const _: () = assert!(LAPD_ALL_THREADS == usize::MAX);

// SAFETY of all six: repr(C), numbers only, `struct_size: u64` first. FIRST_SIZE is that of version
// 0.1 and stays when fields are appended.
unsafe impl Growing for lapd_counts {
    const FIRST_SIZE: u64 = 56;
}
unsafe impl Growing for lapd_timings {
    const FIRST_SIZE: u64 = 40;
}
unsafe impl Growing for lapd_operations {
    const FIRST_SIZE: u64 = 40;
}
unsafe impl Growing for lapd_quality {
    const FIRST_SIZE: u64 = 184;
}
unsafe impl Growing for lapd_certificate {
    const FIRST_SIZE: u64 = 120;
}
unsafe impl Growing for lapd_thread_report {
    const FIRST_SIZE: u64 = 144;
}

/// `size_of` as the value of `struct_size`; [`fill_struct`] puts the caller's there.
pub(super) const fn own_size<T: Growing>() -> u64 {
    let size = size_of::<T>() as u64;
    assert!(T::FIRST_SIZE <= size);
    size
}

/// The largest distance; NaN where none was measured.
pub(super) fn max(distance: Option<Distance>) -> f64 {
    distance.map_or(f64::NAN, |distance| distance.max)
}

/// The mean distance; NaN where none was measured.
pub(super) fn mean(distance: Option<Distance>) -> f64 {
    distance.map_or(f64::NAN, |distance| distance.mean)
}

/// The certificate of a mesh, if there is one.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn certificate_of<'a>(mesh: *const lapd_mesh) -> Outcome<&'a Certificate> {
    // SAFETY: the caller's pointer, as the module's head demands.
    let certificate = unsafe { &borrow(mesh, "mesh")?.result.report.certificate };
    match certificate.level {
        CertificateLevel::None => Err(Failure::new(
            lapd_status::LAPD_ERROR_NOT_MEASURED,
            "nothing was measured on the mesh (lapd_params_set_certificate, lapd_mesh_certify)",
        )),
        CertificateLevel::Sound | CertificateLevel::Full => Ok(certificate),
    }
}

/// Fills a caller's struct with what a run did.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn of_run<T: Growing>(
    mesh: *const lapd_mesh,
    out: *mut T,
    name: &str,
    value: impl FnOnce(&MeshResult) -> T,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    status_of(|| unsafe {
        let mesh = borrow(mesh, "mesh")?;
        if mesh.params.is_none() {
            let message = "no run made the mesh: lapd_mesh_from_arrays did";
            return Err(Failure::new(lapd_status::LAPD_ERROR_NOT_MEASURED, message));
        }
        fill_struct(out, value(&mesh.result), name)
    })
}

/// Fills a caller's struct from the report.
///
/// # Safety
/// See the module's head.
pub(super) unsafe fn fill<T: Growing>(
    mesh: *const lapd_mesh,
    out: *mut T,
    name: &str,
    value: impl FnOnce(&MeshResult) -> T,
) -> lapd_status {
    // SAFETY: passed on to the caller.
    status_of(|| unsafe { fill_struct(out, value(&borrow(mesh, "mesh")?.result), name) })
}

/// How large the mesh is. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_counts(
    mesh: *const lapd_mesh,
    counts: *mut lapd_counts,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        fill(mesh, counts, "counts", |result| lapd_counts {
            struct_size: own_size::<lapd_counts>(),
            vertices: result.mesh.vertex_count() as u64,
            tets: result.mesh.tets.len() as u64,
            tissue_tets: result.mesh.labels.iter().filter(|&&label| label != 0).count() as u64,
            interface_facets: result.mesh.facets.len() as u64,
            all_vertices: result.report.all_vertices,
            all_tets: result.report.all_tets,
            oracle_bytes: result.report.oracle_bytes,
        })
    }
}

/// How long the run took. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_timings(
    mesh: *const lapd_mesh,
    timings: *mut lapd_timings,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        fill(mesh, timings, "timings", |result| {
            let seconds = &result.report.seconds;
            lapd_timings {
                struct_size: own_size::<lapd_timings>(),
                prepare: seconds.prepare,
                refine: seconds.refine,
                extract: seconds.extract,
                certify: seconds.certify,
                improve: seconds.improve,
            }
        })
    }
}

/// What refinement did, all threads together; lapd_mesh_get_thread_report tells what each of them
/// did. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_operations(
    mesh: *const lapd_mesh,
    operations: *mut lapd_operations,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        of_run(mesh, operations, "operations", |result| {
            let (operations, work) = (&result.report.operations, &result.report.work);
            lapd_operations {
                struct_size: own_size::<lapd_operations>(),
                insertions: operations.insertions,
                removals: operations.removals,
                rollbacks: operations.rollbacks,
                exact_predicates: operations.exact_predicates,
                in_sphere_tests: operations.in_sphere_tests,
                tets_created: operations.created,
                cavity_tets: operations.cavity_tets,
                inspections: work.inspections,
                label_lookups: work.lookups.labels,
                crossing_lookups: work.lookups.crossings,
                by_rule: work.by_rule,
            }
        })
    }
}

/// The quality of the mesh. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version; LAPD_ERROR_NOT_MEASURED when the mesh has no certificate.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_quality(
    mesh: *const lapd_mesh,
    quality: *mut lapd_quality,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        certificate_of(mesh)?;
        let measured = &borrow(mesh, "mesh")?.result.report.quality;
        let value = lapd_quality {
            struct_size: own_size::<lapd_quality>(),
            min_dihedral: measured.min_dihedral,
            max_dihedral: measured.max_dihedral,
            max_radius_edge: measured.max_radius_edge,
            min_facet_angle: measured.min_facet_angle,
            dihedral_histogram: measured.dihedral_histogram,
            min_scaled_jacobian: measured.scaled_jacobian.min,
            max_scaled_jacobian: measured.scaled_jacobian.max,
            scaled_jacobian_histogram: measured.scaled_jacobian.histogram,
            min_edge_ratio: measured.edge_ratio.min,
            max_edge_ratio: measured.edge_ratio.max,
            edge_ratio_histogram: measured.edge_ratio.histogram,
            min_radius_ratio: measured.radius_ratio.min,
            max_radius_ratio: measured.radius_ratio.max,
            radius_ratio_histogram: measured.radius_ratio.histogram,
        };
        fill_struct(quality, value, "quality")
    })
}

/// The certificate of the mesh. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
/// known version; LAPD_ERROR_NOT_MEASURED when the mesh has none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_certificate(
    mesh: *const lapd_mesh,
    certificate: *mut lapd_certificate,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let measured = certificate_of(mesh)?;
        let value = lapd_certificate {
            struct_size: own_size::<lapd_certificate>(),
            non_delaunay_facets: measured.non_delaunay_facets.unwrap_or(LAPD_NOT_COUNTED),
            inverted_tets: measured.inverted_tets,
            orphan_vertices: measured.orphan_vertices,
            open_edges: measured.open_edges,
            unmet: measured.unmet.unwrap_or([LAPD_NOT_COUNTED; 6]),
            mesh_to_image_mean: mean(measured.mesh_to_image),
            mesh_to_image_max: max(measured.mesh_to_image),
            image_to_mesh_mean: mean(measured.image_to_mesh),
            image_to_mesh_max: max(measured.image_to_mesh),
            mesh_to_surface_mean: mean(measured.mesh_to_surface),
            mesh_to_surface_max: max(measured.mesh_to_surface),
            surface_to_mesh_mean: mean(measured.surface_to_mesh),
            surface_to_mesh_max: max(measured.surface_to_mesh),
            facets_off_walls: measured.facets_off_walls,
            small_components_lost: measured.small_lost.count,
            small_component_lost_at: measured
                .small_lost
                .first
                .map_or([0.0; 3], |(_, position)| position),
            level: lapd_certificate_level::from(measured.level) as i64,
        };
        fill_struct(certificate, value, "certificate")
    })
}

/// The number of threads that refined. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_thread_count(
    mesh: *const lapd_mesh,
    count: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let out = Out::new(count, "count")?;
        out.set(borrow(mesh, "mesh")?.result.report.threads.len());
        Ok(())
    })
}

/// What thread `index` (from 0) of the refinement did, or, for LAPD_ALL_THREADS, the sum of what
/// all of them did. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is neither below the count
/// nor LAPD_ALL_THREADS, or struct_size is not that of a known version.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_get_thread_report(
    mesh: *const lapd_mesh,
    index: usize,
    report: *mut lapd_thread_report,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let run = &borrow(mesh, "mesh")?.result.report;
        let sum;
        let found = if index == LAPD_ALL_THREADS {
            sum = run.all_threads();
            &sum
        } else {
            run.threads
                .get(index)
                .ok_or_else(|| Failure::invalid(format!("there is no thread {index}")))?
        };
        let (operations, overhead) = (&found.operations, &found.overhead);
        let value = lapd_thread_report {
            struct_size: own_size::<lapd_thread_report>(),
            insertions: operations.insertions,
            removals: operations.removals,
            tets_created: operations.created,
            rollbacks: operations.rollbacks,
            rollbacks_by_rule: overhead.rollbacks,
            stale: overhead.stale,
            rollback_seconds: overhead.rollback_seconds,
            contention_seconds: overhead.contention_seconds,
            idle_seconds: overhead.idle_seconds,
            waits: overhead.waits,
            begs: overhead.begs,
            gifts: overhead.gifts,
            local_accesses: found.accesses.local(),
            remote_accesses: found.accesses.remote(),
            access_hops: found.accesses.hops(),
        };
        fill_struct(report, value, "report")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_sizes_fit() {
        own_size::<lapd_counts>();
        own_size::<lapd_timings>();
        own_size::<lapd_operations>();
        own_size::<lapd_quality>();
        own_size::<lapd_certificate>();
        own_size::<lapd_thread_report>();
    }
}
