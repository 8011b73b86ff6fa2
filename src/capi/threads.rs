//! Parameters of a run's threads.

use std::ffi::c_char;

use super::boundary::{Failure, Out, borrow, borrow_mut, c_str, status_of};
use super::context::{lapd_context, with_context};
use super::params::{change, flag, lapd_params, read, unknown};
use super::status::lapd_status;
use crate::parallel::machine::Machine;
use crate::params::{Begging, Contention};

/// Most threads of a run.
pub const LAPD_MAX_THREADS: usize = 254;

const _: () = assert!(LAPD_MAX_THREADS == crate::params::MAX_THREADS);

/// What a thread does after it met another one: it needed a vertex that the other one was using,
/// and has given its operation up.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_contention {
    /// It waits until the thread that it met has made some progress, unless that one waits itself.
    /// The default.
    LAPD_CONTENTION_LOCAL = 0,
    /// It waits, in one list for all threads, until others have made some progress; the last one
    /// that works never waits.
    LAPD_CONTENTION_GLOBAL = 1,
    /// After some conflicts in sequence it waits for a random time.
    LAPD_CONTENTION_RANDOM = 2,
    /// It goes on at once.
    LAPD_CONTENTION_AGGRESSIVE = 3,
}

/// Whom a thread without work asks for some first.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_begging {
    /// The threads of its own cache, then those of its processor, then those of the machine. The
    /// default.
    LAPD_BEGGING_BY_LEVEL = 0,
    /// All threads alike.
    LAPD_BEGGING_FLAT = 1,
}

use lapd_begging::*;
use lapd_contention::*;

/// Sets the number of threads of a run, 1 (the default) to LAPD_MAX_THREADS. lapd_mesh_image starts
/// them and joins them before it returns. More than there are processors work, but do not help.
///
/// With 1 the mesh is the same in every run. With more it is not, because it depends on which
/// thread is first; what the certificate and the bounds on quality promise holds all the same. No
/// other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the number is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_threads(
    context: *mut lapd_context,
    params: *mut lapd_params,
    threads: usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.threads = threads;
            Ok(())
        })
    }
}

/// The number of threads of a run. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_threads(
    params: *const lapd_params,
    threads: *mut usize,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, threads, "threads", |p| p.threads) }
}

/// Sets what threads do after conflicts, a lapd_contention. With 1 thread there are none. No other
/// thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_contention(
    context: *mut lapd_context,
    params: *mut lapd_params,
    contention: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.contention = match contention {
                c if c == LAPD_CONTENTION_LOCAL as i32 => Contention::Local,
                c if c == LAPD_CONTENTION_GLOBAL as i32 => Contention::Global,
                c if c == LAPD_CONTENTION_RANDOM as i32 => Contention::Random,
                c if c == LAPD_CONTENTION_AGGRESSIVE as i32 => Contention::Aggressive,
                _ => return Err(unknown("contention", "a lapd_contention", contention)),
            };
            Ok(())
        })
    }
}

/// What threads do after conflicts, a lapd_contention. Any thread, unless another one changes
/// `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_contention(
    params: *const lapd_params,
    contention: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, contention, "contention", |p| match p.contention {
            Contention::Local => LAPD_CONTENTION_LOCAL as i32,
            Contention::Global => LAPD_CONTENTION_GLOBAL as i32,
            Contention::Random => LAPD_CONTENTION_RANDOM as i32,
            Contention::Aggressive => LAPD_CONTENTION_AGGRESSIVE as i32,
        })
    }
}

/// Sets whom threads without work ask for some first, a lapd_begging. With 1 thread there is nobody
/// to ask. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_begging(
    context: *mut lapd_context,
    params: *mut lapd_params,
    begging: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.begging = match begging {
                b if b == LAPD_BEGGING_BY_LEVEL as i32 => Begging::ByLevel,
                b if b == LAPD_BEGGING_FLAT as i32 => Begging::Flat,
                _ => return Err(unknown("begging", "a lapd_begging", begging)),
            };
            Ok(())
        })
    }
}

/// Whom threads without work ask for some first, a lapd_begging. Any thread, unless another one
/// changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_begging(
    params: *const lapd_params,
    begging: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        read(params, begging, "begging", |p| match p.begging {
            Begging::ByLevel => LAPD_BEGGING_BY_LEVEL as i32,
            Begging::Flat => LAPD_BEGGING_FLAT as i32,
        })
    }
}

/// Sets the machine that the threads are taken to run on, for LAPD_ALGORITHM_LAPD and
/// LAPD_BEGGING_BY_LEVEL, by one of hwloc's synthetic descriptions, such as "numa:4 core:4 pu:1":
/// four memory nodes of four cores each. An empty text (the default) means the machine at hand.
///
/// It serves tests and planning. The text is copied. No other thread may use `params` or the
/// context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or hwloc does not understand the
/// text; LAPD_ERROR_UNSUPPORTED when the library was built without its feature hwloc.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_topology(
    context: *mut lapd_context,
    params: *mut lapd_params,
    description: *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |_| {
            let params = borrow_mut(params, "params")?;
            let description = c_str(description, "description")?;
            params.params.machine = if description.is_empty() {
                None
            } else {
                let text = description
                    .to_str()
                    .map_err(|_| Failure::invalid("description is not UTF-8"))?;
                Some(Machine::synthetic(text)?)
            };
            params.topology = description.to_owned();
            Ok(())
        })
    }
}

/// The description of the machine that the threads are taken to run on; empty for the machine at
/// hand.
///
/// `*description` belongs to the parameters and is valid until they are changed or freed. Any
/// thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_topology(
    params: *const lapd_params,
    description: *mut *const c_char,
) -> lapd_status {
    // SAFETY: see the module's head.
    status_of(|| unsafe {
        let description = Out::new(description, "description")?;
        description.set(borrow(params, "params")?.topology.as_ptr());
        Ok(())
    })
}

/// Whether to bind each thread of the refinement to a core of its own (1) or not (0, the default).
/// Cores are taken memory node by memory node, among those that the calling thread may use; more
/// threads than cores share them. The caller's thread itself is never bound. No other thread may
/// use `params` or the context meanwhile.
///
/// Where threads cannot be bound, lapd_mesh_image fails with LAPD_ERROR_UNSUPPORTED: on other
/// systems than Linux, where a machine has more than 1024 processors, and where the calling thread
/// may use none of them. The feature hwloc is not needed.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_bind(
    context: *mut lapd_context,
    params: *mut lapd_params,
    bind: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.bind = flag(bind, "bind")?;
            Ok(())
        })
    }
}

/// Whether threads are bound to cores, 1 or 0. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_bind(
    params: *const lapd_params,
    bind: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, bind, "bind", |p| i32::from(p.bind)) }
}

/// Whether to count, for lapd_mesh_get_thread_report, the tets and vertices that each thread visits
/// in the memory of its own and of other nodes (1), or not (0, the default). Counting takes some
/// percent of the time. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_count_accesses(
    context: *mut lapd_context,
    params: *mut lapd_params,
    count_accesses: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.count_accesses = flag(count_accesses, "count_accesses")?;
            Ok(())
        })
    }
}

/// Whether accesses are counted, 1 or 0. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_count_accesses(
    params: *const lapd_params,
    count_accesses: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, count_accesses, "count_accesses", |p| i32::from(p.count_accesses)) }
}

/// Whether to keep what each thread did when (1), for lapd_mesh_write_timeline, or not (0, the
/// default). It takes memory while the mesh lives, some ten bytes for each time that a thread
/// begins something else. No other thread may use `params` or the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_timeline(
    context: *mut lapd_context,
    params: *mut lapd_params,
    timeline: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.timeline = flag(timeline, "timeline")?;
            Ok(())
        })
    }
}

/// Whether a timeline is kept, 1 or 0. Any thread, unless another one changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_timeline(
    params: *const lapd_params,
    timeline: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, timeline, "timeline", |p| i32::from(p.timeline)) }
}
