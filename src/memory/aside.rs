//! Memory that is given back by a thread of its own, so that a call that was cancelled need not
//! wait for it: the system takes 50 to 200 ms for each GB.
//!
//! The thread begins when the call ends ([`AtEnd`]): while the system takes one large table back,
//! whoever gives it another one has to wait. Of calls that run at the same time the first to end
//! begins with what all of them put aside: the others may wait then, and nothing else happens.
//!
//! These threads run the library's code, so it may not be unloaded before they have ended. The C
//! library waits for them when a context is freed.

use std::any::Any;
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

use crate::{Error, Result};

/// The threads that may still be at work, each with the process that it is a thread of: after a
/// fork the child has the list, and not the threads.
static AT_WORK: Mutex<Vec<(u32, JoinHandle<()>)>> = Mutex::new(Vec::new());

/// What waits for the end of a call.
static WAITING: Mutex<Vec<Box<dyn Any + Send>>> = Mutex::new(Vec::new());

/// A list is whole between any two operations on it, whoever panicked.
fn lock<T>(list: &Mutex<T>) -> MutexGuard<'_, T> {
    list.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Drops a large value in another thread, when a call that has an [`AtEnd`] ends.
pub fn drop_aside<T: Send + 'static>(value: T) {
    lock(&WAITING).push(Box::new(value));
}

/// The end of a call. What was put aside is dropped by a new thread then; by this one, if there can
/// be no thread. To be made before the tables of the call, so that it is dropped after them.
#[derive(Debug)]
pub struct AtEnd;

impl Drop for AtEnd {
    fn drop(&mut self) {
        let waiting = std::mem::take(&mut *lock(&WAITING));
        if waiting.is_empty() {
            return;
        }
        let name = String::from("lapd-memory");
        // A closure that no thread could be made for is dropped, and the values with it.
        if let Ok(thread) = Builder::new().name(name).spawn(move || drop(waiting)) {
            // Locked until they are joined: who waits for all must not miss one.
            let mut at_work = lock(&AT_WORK);
            at_work.push((process::id(), thread));
            let (ended, others) =
                std::mem::take(&mut *at_work).into_iter().partition(|(_, t)| t.is_finished());
            *at_work = others;
            join(ended);
        }
    }
}

/// Works on a large value, which is dropped aside if that is cancelled. After other errors it is
/// dropped here: who tries again with less needs the memory.
///
/// # Errors
/// Those of `work`.
pub fn or_drop_aside<T: Send + 'static, R>(
    mut value: T,
    work: impl FnOnce(&mut T) -> Result<R>,
) -> Result<(T, R)> {
    match work(&mut value) {
        Ok(result) => Ok((value, result)),
        Err(error) => {
            if matches!(error, Error::Cancelled) {
                drop_aside(value);
            }
            Err(error)
        }
    }
}

/// Waits until all that was to be dropped aside is gone. Where several threads call this at the
/// same time the first waits, and the others return at once.
pub fn wait() {
    let at_work = std::mem::take(&mut *lock(&AT_WORK));
    join(at_work);
}

fn join(threads: Vec<(u32, JoinHandle<()>)>) {
    for (process, thread) in threads {
        if process == process::id() {
            // One that panicked has ended as well.
            let _ = thread.join();
        } else {
            // Not dropped: in the child of a fork there is no such thread, and its memory may be
            // another one's.
            std::mem::forget(thread);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;

    /// Takes a while to drop, and tells when it is done.
    struct Slow(mpsc::Sender<()>);

    impl Drop for Slow {
        fn drop(&mut self) {
            std::thread::sleep(Duration::from_millis(50));
            let _ = self.0.send(());
        }
    }

    #[test]
    fn values_are_gone_after_waiting() {
        let (sender, receiver) = mpsc::channel();
        {
            let _end = AtEnd;
            for _ in 0..3 {
                drop_aside(Slow(sender.clone()));
            }
            assert_eq!(receiver.try_iter().count(), 0);
        }
        wait();
        assert_eq!(receiver.try_iter().count(), 3);
    }
}
