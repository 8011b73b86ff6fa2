//! One run, on threads of its own.
//!
//! The work is done by a thread pool that exists during the call only, so that whatever the engine
//! spawns through rayon is counted by `threads` and joined at return; the caller's thread, which is
//! not changed in any way, waits and runs the callbacks: the worker hands each progress report over
//! and waits for the answer.

use std::sync::mpsc;

use super::boundary::{Failure, Out};
use super::boundary::{Outcome, borrow, catch};
use super::context::{Callbacks, lapd_context, with_context};
use super::image::lapd_image;
use super::mesh::lapd_mesh;
use super::params::lapd_params;
use super::pool::with_pool;
use super::status::lapd_status;
use crate::monitor::{CancelFlag, Level, Monitor, Progress};
use crate::pipeline::mesh_image;

/// Meshes an image.
///
/// The call returns when the mesh is done, or the run was cancelled or failed. A mesh comes with
/// LAPD_OK; a partial one, where lapd_params_set_partial asks for it, with the status of the limit.
/// With any other status `*mesh` stays as it is. Progress and log callbacks of the context are
/// called on this thread. The work is done by threads that are joined at return, but for one that
/// gives memory back after a cancel (lapd_context_free waits for it); the calling thread is neither
/// pinned nor moved. Any number of runs may go on at once, in different threads, each with its own
/// context; they may share the image and the parameters. With 1 thread the same image and
/// parameters give the same mesh, byte for byte, unless a limit of time ended it; with more they do
/// not, see lapd_params_set_threads.
///
/// The caller owns `*mesh` and frees it with lapd_mesh_free; it needs none of the other handles to
/// live on.
///
/// No other thread may use the context meanwhile, but to cancel, nor change `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, a label is to be merged, the
/// background, kept, or of a size of its own that the image does not have, label 0 occurs beside
/// another background, merging makes more than 65534 labels besides 0, sigma is above 0 or small
/// components are to be left out (lapd_params_set_sigma, lapd_params_set_min_voxels) of an image
/// made of intensities or probabilities, the box of the object, a voxel more on each side, has more
/// than 2^32 - 1 voxels, or delta is so coarse that no tet lies in the object;
/// LAPD_ERROR_UNSUPPORTED when threads are to be bound to cores and cannot be, see
/// lapd_params_set_bind; LAPD_ERROR_EMPTY_IMAGE when there is no label to mesh;
/// LAPD_ERROR_CANCELLED; LAPD_ERROR_LIMIT_REACHED, LAPD_ERROR_TIME_LIMIT, LAPD_ERROR_MEMORY_LIMIT,
/// see lapd_params_set_partial; LAPD_ERROR_OUT_OF_MEMORY; LAPD_ERROR_BUSY when the context is in
/// use by a run.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_mesh_image(
    context: *mut lapd_context,
    image: *const lapd_image,
    params: *const lapd_params,
    mesh: *mut *mut lapd_mesh,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        with_context(context, |context| {
            let out = Out::new(mesh, "mesh")?;
            let image = borrow(image, "image")?;
            let params = borrow(params, "params")?.params.clone();
            let _run = context.start_run()?;
            let callbacks = context.callbacks();
            let threads = params.threads;
            let result = run(threads, &context.cancel, &callbacks, |monitor| {
                Ok(mesh_image(&image.image, &params, monitor)?)
            })?;
            // The one call that hands something out beside an error: the caller has asked for it.
            let ended_by = result.ended_by.as_ref().map(Failure::from);
            let (names, values) = (image.names.merged(&params.merge), image.values());
            let world = image.world;
            let params = Some(params.scaled(result.report.factor));
            let node_pairs = None;
            let mesh = lapd_mesh { result, world, node_pairs, params, names, values };
            out.set(Box::into_raw(Box::new(mesh)));
            ended_by.map_or(Ok(()), Err)
        })
    }
}

/// What the run's thread hands over to the caller's.
enum Message {
    /// An answer is waited for: whether to go on.
    Progress(Progress),
    Log(Level, String),
}

/// Does `work` on a pool of `threads`, and calls the callbacks on this thread.
pub(super) fn run<T: Send>(
    threads: usize,
    cancel: &CancelFlag,
    callbacks: &Callbacks,
    work: impl FnOnce(&Monitor<'_>) -> Outcome<T> + Send,
) -> Outcome<T> {
    let (sender, messages) = mpsc::channel::<Message>();
    let (answer, answer_receiver) = mpsc::channel::<bool>();
    let (listening, logging) = (callbacks.has_progress(), callbacks.has_log());
    let job = move || {
        // Dropped at the end of the job, by unwinding too: that ends the loop below.
        let log_sender = sender.clone();
        let mut tell = move |p| {
            sender.send(Message::Progress(p)).is_ok() && answer_receiver.recv().unwrap_or(false)
        };
        let mut log = move |level, line: &str| {
            // The receiver stays until the last sender has gone.
            let _ = log_sender.send(Message::Log(level, line.to_owned()));
        };
        let monitor = Monitor::new(listening.then_some(&mut tell as _), Some(cancel))
            .with_log(logging.then_some(&mut log as _));
        work(&monitor)
    };
    let mut result = None;
    with_pool(threads, |pool| {
        pool.in_place_scope(|scope| {
            scope.spawn(|_| result = Some(catch(job)));
            for message in messages {
                match message {
                    // The worker waits for this; it cannot have gone.
                    Message::Progress(progress) => _ = answer.send(callbacks.report(progress)),
                    Message::Log(level, line) => callbacks.log(level.into(), &line),
                }
            }
        });
    })?;
    result.unwrap_or_else(|| Err(crate::Error::Internal("the run gave no result".into()).into()))
}
