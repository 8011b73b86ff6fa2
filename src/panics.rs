//! Panics: caught, and turned into a line that says where.
//!
//! A panic is a bug of the library. It must not end the program that hosts it, nor write to its
//! terminal.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static SILENT: Cell<bool> = const { Cell::new(false) };
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs `f`; panics inside it, on this thread, are not printed.
pub fn silently<T>(f: impl FnOnce() -> T) -> T {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let outer = take_hook();
        set_hook(Box::new(move |info| {
            if SILENT.get() {
                PLACE.set(info.location().map(ToString::to_string));
            } else {
                outer(info);
            }
        }));
    });
    // Restores the flag on unwinding too.
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            SILENT.set(self.0);
        }
    }
    let _restore = Restore(SILENT.replace(true));
    f()
}

/// Runs `f`; a panic becomes a line that says where it happened. What `f` was changing is the
/// caller's to drop, or to keep where a panic cannot leave it broken.
///
/// # Errors
/// The line.
pub fn catch<T>(f: impl FnOnce() -> T) -> std::result::Result<T, String> {
    silently(|| catch_unwind(AssertUnwindSafe(f))).map_err(|payload| {
        let place = PLACE.take().unwrap_or_else(|| "unknown place".into());
        format!("panic at {place}: {}", text(&*payload))
    })
}

fn text(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message")
}
