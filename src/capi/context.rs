//! The context of calls: where their error message is kept, whom a run reports to, how it is
//! cancelled.

use std::cell::Cell;
use std::ffi::{CString, c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::boundary::{Failure, Out, Outcome, borrow, catch, status_of, value_or};
use super::status::lapd_status;
use crate::error::one_line;
use crate::io::read::{GoOn, ReadOptions};
use crate::memory::aside;
use crate::monitor::{CancelFlag, INTERVAL, Level, Phase, Progress};
use crate::{Error, Result};

/// What a call reports to. Holds the message of the last call that failed, the callbacks for
/// progress and log lines, and the cancel flag.
///
/// Use one context per thread that makes calls. Only lapd_context_cancel may be called while
/// another thread uses the context.
pub struct lapd_context {
    pub(super) cancel: CancelFlag,
    running: AtomicBool,
    last_error: Mutex<CString>,
    callbacks: Mutex<Callbacks>,
    /// What files may ask for; see [`ReadOptions`].
    max_read_bytes: AtomicU64,
    allow_outside: AtomicBool,
    /// Which volume of a file is read; below 0: a file has one.
    volume: AtomicI64,
}

/// The phases of a run, in their order. More may be added in between, with numbers of their own.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_phase {
    /// The image is prepared: volumes and weights of the labels, where the interfaces are.
    LAPD_PHASE_PREPARE = 0,
    /// Delaunay refinement.
    LAPD_PHASE_REFINE = 1,
    /// The mesh is collected, and the triangulation checked.
    LAPD_PHASE_EXTRACT = 2,
    /// Slivers are removed.
    LAPD_PHASE_IMPROVE = 3,
    /// Quality and certificate are measured.
    LAPD_PHASE_CERTIFY = 4,
    /// An image is read from files: before all others, in a call of its own.
    LAPD_PHASE_READ = 5,
}

impl From<Phase> for lapd_phase {
    fn from(phase: Phase) -> Self {
        match phase {
            Phase::Prepare => Self::LAPD_PHASE_PREPARE,
            Phase::Refine => Self::LAPD_PHASE_REFINE,
            Phase::Extract => Self::LAPD_PHASE_EXTRACT,
            Phase::Improve => Self::LAPD_PHASE_IMPROVE,
            Phase::Certify => Self::LAPD_PHASE_CERTIFY,
        }
    }
}

/// One report of progress. Later versions may append fields.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lapd_progress {
    /// The phase, a lapd_phase.
    pub phase: i32,
    /// Part of the call's work that is done, 0 to 1: an estimate that never decreases.
    pub fraction: f64,
    /// Tets of the triangulation so far, those outside of the object included.
    pub tets: u64,
}

/// How much a log line matters.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_log_level {
    /// The result may not be what the caller expects.
    LAPD_LOG_WARNING = 0,
    /// What the library does.
    LAPD_LOG_INFO = 1,
}

impl From<Level> for lapd_log_level {
    fn from(level: Level) -> Self {
        match level {
            Level::Warning => Self::LAPD_LOG_WARNING,
            Level::Info => Self::LAPD_LOG_INFO,
        }
    }
}

/// Receives progress on the thread that called lapd_mesh_image, or a function that reads an image.
/// Returns 0 to go on, anything else to cancel the call. `progress` is valid during the call only.
/// Must not throw, nor leave by longjmp; must not free the context.
pub type lapd_progress_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, progress: *const lapd_progress) -> i32>;

/// Receives a log line (UTF-8, without a line end) of a lapd_log_level, on the thread that made the
/// call. `message` is valid during the call only. Must not throw, nor leave by longjmp; must not
/// free the context.
pub type lapd_log_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, level: i32, message: *const c_char)>;

/// The caller's functions; copied out of the context for the time of a run, so that they may be
/// called without a lock.
#[derive(Clone, Copy)]
pub(super) struct Callbacks {
    progress: lapd_progress_fn,
    progress_user: *mut c_void,
    log: lapd_log_fn,
    log_user: *mut c_void,
}

impl Callbacks {
    const NONE: Self = Self {
        progress: None,
        progress_user: ptr::null_mut(),
        log: None,
        log_user: ptr::null_mut(),
    };

    pub fn has_progress(&self) -> bool {
        self.progress.is_some()
    }

    pub fn has_log(&self) -> bool {
        self.log.is_some()
    }

    /// Whether to go on.
    pub fn report(&self, progress: Progress) -> bool {
        let Progress { phase, fraction, tets } = progress;
        self.report_of(phase.into(), fraction, tets)
    }

    fn report_of(&self, phase: lapd_phase, fraction: f64, tets: u64) -> bool {
        let Some(callback) = self.progress else { return true };
        let progress = lapd_progress { phase: phase as i32, fraction, tets };
        // SAFETY: whoever set the callback promised that it may be called so.
        unsafe { callback(self.progress_user, &raw const progress) == 0 }
    }

    pub fn log(&self, level: lapd_log_level, line: &str) {
        let Some(callback) = self.log else { return };
        let line = to_c_string(line);
        // SAFETY: as in `report`.
        unsafe { callback(self.log_user, level as i32, line.as_ptr()) }
    }
}

impl lapd_context {
    fn set_error(&self, message: &str) {
        *lock(&self.last_error) = to_c_string(message);
    }

    pub(super) fn callbacks(&self) -> Callbacks {
        *lock(&self.callbacks)
    }

    /// Calls `read` with `options` that have what the context lets files ask for, and with what is
    /// to be told how much has been read: it reports to the callback and asks whether to go on.
    pub(super) fn reading<T>(
        &self,
        mut options: ReadOptions,
        read: impl FnOnce(&ReadOptions, &GoOn<'_>) -> Result<T>,
    ) -> Outcome<T> {
        // Relaxed: no other thread may use the context meanwhile.
        let max_bytes = self.max_read_bytes.load(Ordering::Relaxed);
        options.max_bytes = (max_bytes > 0).then_some(max_bytes);
        options.allow_outside = self.allow_outside.load(Ordering::Relaxed);
        options.volume = u64::try_from(self.volume.load(Ordering::Relaxed)).ok();
        let callbacks = self.callbacks();
        let last = Cell::new(None::<Instant>);
        let go_on = |part: f64| {
            let mut stops = self.cancel.is_cancelled();
            if !stops && last.get().is_none_or(|last| last.elapsed() >= INTERVAL) {
                stops = !callbacks.report_of(lapd_phase::LAPD_PHASE_READ, part, 0);
                last.set(Some(Instant::now()));
            }
            if stops { Err(Error::Cancelled) } else { Ok(()) }
        };
        Ok(read(&options, &go_on)?)
    }

    /// Marks the context as used by a run until the guard is dropped.
    pub(super) fn start_run(&self) -> Outcome<RunGuard<'_>> {
        // Acquire and release: what the callbacks of one run did is seen by the next one, on
        // whatever thread.
        if self.running.swap(true, Ordering::Acquire) {
            return Err(Failure::new(
                lapd_status::LAPD_ERROR_BUSY,
                "the context is in use by a run that has not returned yet",
            ));
        }
        Ok(RunGuard(&self.running))
    }
}

pub(super) struct RunGuard<'a>(&'a AtomicBool);

impl Drop for RunGuard<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

/// A panic while a lock is held leaves complete values behind: both mutexes guard single
/// assignments.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn to_c_string(text: &str) -> CString {
    // Without control characters, NUL is none of them.
    CString::new(one_line(text)).unwrap_or_default()
}

/// Boundary of a function with a context: the message of a failure is kept there.
///
/// # Safety
/// `context` is NULL or alive.
pub(super) unsafe fn with_context(
    context: *const lapd_context,
    f: impl FnOnce(&lapd_context) -> Outcome<()>,
) -> lapd_status {
    status_of(|| {
        // SAFETY: the caller's promise.
        let context = unsafe { borrow(context, "context") }?;
        catch(|| f(context)).inspect_err(|failure| context.set_error(&failure.message))
    })
}

/// Creates a context: no message, no callbacks, not cancelled.
///
/// The caller owns `*context` and frees it with lapd_context_free. Any thread.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_create(context: *mut *mut lapd_context) -> lapd_status {
    status_of(|| {
        // SAFETY: the caller's promise.
        let out = unsafe { Out::new(context, "context") }?;
        out.set(Box::into_raw(Box::new(lapd_context {
            cancel: CancelFlag::default(),
            running: AtomicBool::new(false),
            last_error: Mutex::default(),
            callbacks: Mutex::new(Callbacks::NONE),
            max_read_bytes: AtomicU64::new(0),
            allow_outside: AtomicBool::new(false),
            volume: AtomicI64::new(-1),
        })));
        Ok(())
    })
}

/// Frees a context. NULL is allowed and does nothing. No other thread may use the context, nor a
/// call be under way with it. Images, parameters and meshes made with it live on.
///
/// Waits until the memory of calls of the process that were cancelled is given back: some 0.1 s for
/// each GB.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_free(context: *mut lapd_context) {
    value_or((), || {
        if !context.is_null() {
            // SAFETY: the caller's promise.
            drop(unsafe { Box::from_raw(context) });
            // The library may be unloaded once its contexts are gone.
            aside::wait();
        }
    });
}

/// The message of the last call that failed with this context: one line, UTF-8; empty when none
/// failed yet. Calls that succeed leave it as it is. For NULL a message that says so.
///
/// The string belongs to the context and is valid until the next failing call with it, or until it
/// is freed. No other thread may use the context meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_last_error(context: *const lapd_context) -> *const c_char {
    value_or(c"internal error: no message".as_ptr(), || {
        // SAFETY: the caller's promise.
        match unsafe { borrow(context, "context") } {
            Ok(context) => lock(&context.last_error).as_ptr(),
            Err(_) => c"context is NULL".as_ptr(),
        }
    })
}

/// Sets the function that receives progress, and the pointer handed to it. A NULL `callback` means
/// none. Takes effect with the next call that meshes or reads an image.
///
/// The library keeps `user` but never looks at it; both must stay valid until replaced or the
/// context is freed. No other thread may use the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_set_progress(
    context: *mut lapd_context,
    callback: lapd_progress_fn,
    user: *mut c_void,
) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            let mut callbacks = lock(&context.callbacks);
            callbacks.progress = callback;
            callbacks.progress_user = user;
            Ok(())
        })
    }
}

/// Sets the function that receives log lines, and the pointer handed to it. A NULL `callback` means
/// none.
///
/// The library keeps `user` but never looks at it; both must stay valid until replaced or the
/// context is freed. No other thread may use the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_set_log(
    context: *mut lapd_context,
    callback: lapd_log_fn,
    user: *mut c_void,
) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            let mut callbacks = lock(&context.callbacks);
            callbacks.log = callback;
            callbacks.log_user = user;
            Ok(())
        })
    }
}

/// The most bytes that an image which is read with this context may take in memory; 0 for the
/// default. A file that asks for more is refused before anything is allocated: few bytes of a
/// compressed file can ask for a thousand times as many. By default that is 1000 times the file's
/// own bytes, or 1 GiB where that is more, and never more than half of the machine's memory.
///
/// A label takes 2 bytes, an intensity or probability 4. No other thread may use the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_set_max_read_bytes(
    context: *mut lapd_context,
    bytes: u64,
) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            context.max_read_bytes.store(bytes, Ordering::Relaxed);
            Ok(())
        })
    }
}

/// Which volume is read with this context of files that hold several, as images over time and NIfTI
/// files of four axes do, from 0 on. With -1, the default, such files are refused, but as
/// probability maps. No other thread may use the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL, or `volume` is below -1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_set_volume(
    context: *mut lapd_context,
    volume: i64,
) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            if volume < -1 {
                return Err(Failure::invalid(format!(
                    "volume must be at least 0, or -1 for files of one volume, got {volume}"
                )));
            }
            context.volume.store(volume, Ordering::Relaxed);
            Ok(())
        })
    }
}

/// Whether headers that are read with this context may name a data file outside of their own
/// folder: not 0 for yes. By default (0) they may not, links that lead outside included, so that a
/// header from a stranger can't have other files read.
///
/// No other thread may use the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_set_allow_outside(
    context: *mut lapd_context,
    allow: i32,
) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            context.allow_outside.store(allow != 0, Ordering::Relaxed);
            Ok(())
        })
    }
}

/// Asks the run of this context to end, or the reading or writing of a file with it; the call
/// returns LAPD_ERROR_CANCELLED within 100 ms. The memory of triangulation and mesh is given back
/// by another thread after that, see lapd_context_free. Time in callbacks, and waiting for the disk
/// when a file is complete, comes on top. The calls that obey are lapd_mesh_image, those that read
/// an image from files, lapd_mesh_write and lapd_mesh_write_timeline; all others, those that make
/// an image from memory too, run to their end.
/// The request stays until lapd_context_reset_cancel: without a call under way that obeys, the next
/// one ends at once, so that no request is ever lost.
///
/// May be called from any thread at any time in the life of the context, from its callbacks, and
/// from a signal handler.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_cancel(context: *const lapd_context) -> lapd_status {
    // One atomic store and no boundary: nothing here can panic, and nothing else would be safe in a
    // signal handler.
    if context.is_null() || !context.is_aligned() {
        return lapd_status::LAPD_ERROR_INVALID_ARGUMENT;
    }
    // SAFETY: the caller's promise.
    unsafe { &(*context).cancel }.cancel();
    lapd_status::LAPD_OK
}

/// Takes back what lapd_context_cancel asked for, so that the context can be used for another run.
/// No other thread may use the context meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL; LAPD_ERROR_BUSY while a run is under
/// way.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_context_reset_cancel(context: *mut lapd_context) -> lapd_status {
    // SAFETY: the caller's promise.
    unsafe {
        with_context(context, |context| {
            let _no_run = context.start_run()?;
            context.cancel.reset();
            Ok(())
        })
    }
}
