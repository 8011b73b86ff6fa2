//! What stands between C and Rust: panics, pointers, failures.
//!
//! A panic must not unwind into C, and the default panic hook would print it on the host's stderr.
//! [`catch`] therefore keeps both away; the process's own hook still gets every panic that happens
//! outside of it.

use std::ffi::{CStr, c_char};

use super::status::lapd_status;
use crate::memory::Watch;
use crate::{Error, panics};

/// Why a call failed: the code, and the line for `lapd_context_last_error`.
#[derive(Debug)]
pub(super) struct Failure {
    pub status: lapd_status,
    pub message: String,
}

/// `Result` of what runs inside the boundary.
pub(super) type Outcome<T> = Result<T, Failure>;

impl Failure {
    pub fn new(status: lapd_status, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(lapd_status::LAPD_ERROR_INVALID_ARGUMENT, message)
    }
}

impl From<&Error> for Failure {
    fn from(error: &Error) -> Self {
        Self::new(error.into(), error.to_string())
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::from(&error)
    }
}

/// Runs `f`; a panic becomes an internal error that says where it happened. Libraries that we use
/// panic where memory is refused.
pub(super) fn catch<T>(f: impl FnOnce() -> Outcome<T>) -> Outcome<T> {
    let memory = Watch::new();
    // What `f` was changing is dropped or, in a context, kept behind mutexes that tolerate poison.
    panics::catch(f).unwrap_or_else(|line| {
        memory.check()?;
        Err(Error::Internal(line).into())
    })
}

/// Boundary of a function without a context: the status alone tells what went wrong.
pub(super) fn status_of(f: impl FnOnce() -> Outcome<()>) -> lapd_status {
    catch(f).map_or_else(|failure| failure.status, |()| lapd_status::LAPD_OK)
}

/// Boundary of a function that returns a value: `fallback` when it panics.
pub(super) fn value_or<T>(fallback: T, f: impl FnOnce() -> T) -> T {
    catch(|| Ok(f())).unwrap_or(fallback)
}

fn check_pointer<T>(pointer: *const T, name: &str) -> Outcome<()> {
    if pointer.is_null() {
        return Err(Failure::invalid(format!("{name} is NULL")));
    }
    if !pointer.is_aligned() {
        return Err(Failure::invalid(format!(
            "{name} is not aligned to {} bytes",
            align_of::<T>()
        )));
    }
    Ok(())
}

/// Refuses a caller's buffer that cannot take `needed` values.
pub(super) fn check_buffer<T>(buffer: *mut T, capacity: usize, needed: usize) -> Outcome<()> {
    if buffer.is_null() || !buffer.is_aligned() {
        return Err(Failure::invalid("buffer is NULL or not aligned"));
    }
    if capacity < needed {
        let message = format!("the buffer has room for {capacity} values, {needed} are needed");
        return Err(Failure::new(lapd_status::LAPD_ERROR_BUFFER_TOO_SMALL, message));
    }
    Ok(())
}

/// # Safety
/// `pointer` is NULL or points to a `T` that nobody writes to during `'a`.
pub(super) unsafe fn borrow<'a, T>(pointer: *const T, name: &str) -> Outcome<&'a T> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL, aligned; the rest is the caller's promise.
    Ok(unsafe { &*pointer })
}

/// # Safety
/// `pointer` is NULL or points to a `T` that nobody else uses during `'a`.
pub(super) unsafe fn borrow_mut<'a, T>(pointer: *mut T, name: &str) -> Outcome<&'a mut T> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL, aligned; the rest is the caller's promise.
    Ok(unsafe { &mut *pointer })
}

/// # Safety
/// `pointer` is NULL or points to `count` values of `T` that nobody writes to during `'a`.
pub(super) unsafe fn slice<'a, T>(pointer: *const T, count: usize, name: &str) -> Outcome<&'a [T]> {
    check_pointer(pointer, name)?;
    if count.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
        return Err(Failure::invalid(format!("{name}: {count} values do not fit in memory")));
    }
    // SAFETY: not NULL, aligned, not beyond isize::MAX bytes; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// Reads a C array of fixed length.
///
/// # Safety
/// As [`slice`], with `N` values.
pub(super) unsafe fn array<T: Copy, const N: usize>(
    pointer: *const T,
    name: &str,
) -> Outcome<[T; N]> {
    // SAFETY: the caller's promise; arrays are aligned as their elements.
    unsafe { borrow(pointer.cast::<[T; N]>(), name) }.copied()
}

/// # Safety
/// `pointer` is NULL or a NUL-terminated string that nobody writes to during `'a`.
pub(super) unsafe fn c_str<'a>(pointer: *const c_char, name: &str) -> Outcome<&'a CStr> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL; the rest is the caller's promise.
    Ok(unsafe { CStr::from_ptr(pointer) })
}

/// A place to write a result to, checked before any work is done.
pub(super) struct Out<T>(*mut T);

impl<T> Out<T> {
    /// # Safety
    /// `pointer` is NULL or may be written to until the call returns.
    pub unsafe fn new(pointer: *mut T, name: &str) -> Outcome<Self> {
        check_pointer(pointer, name)?;
        Ok(Self(pointer))
    }

    pub fn set(self, value: T) {
        // SAFETY: checked and promised in `new`. The old value is plain data of the caller's and is
        // not dropped.
        unsafe { self.0.write(value) }
    }
}

/// A plain struct that may grow at its end in later versions; its first field is
/// `struct_size: u64`, set by the caller.
///
/// # Safety
/// `repr(C)`, plain data, `struct_size: u64` first.
pub(super) unsafe trait Growing: Copy {
    /// Its size when it was first released; callers never have a smaller one.
    const FIRST_SIZE: u64;
}

/// Above this, `struct_size` was forgotten and holds garbage.
const LARGEST_STRUCT: u64 = 1 << 16;

/// Fills a caller's struct: as much of `value` as its version of the struct holds; what only a
/// later version knows becomes 0.
///
/// # Safety
/// `out` is NULL or points to `struct_size` writable bytes, `struct_size` being its first eight
/// bytes.
pub(super) unsafe fn fill_struct<T: Growing>(out: *mut T, value: T, name: &str) -> Outcome<()> {
    check_pointer(out, name)?;
    // SAFETY: not NULL, aligned; `Growing` says that a u64 stands first.
    let size = unsafe { out.cast::<u64>().read() };
    if !(T::FIRST_SIZE..=LARGEST_STRUCT).contains(&size) {
        return Err(Failure::invalid(format!(
            "{name}->struct_size must be sizeof *{name}, got {size}"
        )));
    }
    let known = (size_of::<T>() as u64).min(size) as usize;
    // SAFETY: the caller promises `size` bytes; `value` has at least `known`.
    unsafe {
        let bytes = out.cast::<u8>();
        bytes.copy_from_nonoverlapping((&raw const value).cast::<u8>(), known);
        bytes.add(known).write_bytes(0, size as usize - known);
        out.cast::<u64>().write(size);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_internal_error_with_its_place() {
        let failure = catch::<()>(|| panic!("broken {}", 1)).unwrap_err();
        assert_eq!(failure.status, lapd_status::LAPD_ERROR_INTERNAL);
        assert!(failure.message.contains("boundary.rs"), "{}", failure.message);
        assert!(failure.message.contains("broken 1"), "{}", failure.message);
        assert_eq!(value_or(7, || panic!("again")), 7);
    }

    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Grown {
        struct_size: u64,
        first: u64,
        later: u64,
    }
    unsafe impl Growing for Grown {
        const FIRST_SIZE: u64 = 16;
    }

    #[test]
    fn structs_of_older_and_newer_callers_are_filled() {
        let value = Grown { struct_size: 24, first: 1, later: 2 };
        let mut older = Grown { struct_size: 16, first: 9, later: 9 };
        unsafe { fill_struct(&mut older, value, "out") }.unwrap();
        assert_eq!(older, Grown { struct_size: 16, first: 1, later: 9 });

        let mut newer = [Grown { struct_size: 48, first: 9, later: 9 }; 2];
        unsafe { fill_struct(newer.as_mut_ptr(), value, "out") }.unwrap();
        assert_eq!(
            newer,
            [
                Grown { struct_size: 48, first: 1, later: 2 },
                Grown { struct_size: 0, first: 0, later: 0 }
            ]
        );

        for wrong in [0, 15, u64::MAX] {
            let mut out = Grown { struct_size: wrong, first: 9, later: 9 };
            assert!(unsafe { fill_struct(&mut out, value, "out") }.is_err());
            assert_eq!(out.first, 9);
        }
    }

    #[test]
    fn null_and_misaligned_pointers_are_refused() {
        assert!(unsafe { borrow::<u32>(std::ptr::null(), "p") }.is_err());
        assert!(
            unsafe { borrow::<u32>(std::ptr::without_provenance(2), "p") }
                .unwrap_err()
                .message
                .contains("aligned")
        );
        assert!(unsafe { slice::<u32>(&1, usize::MAX, "p") }.is_err());
    }
}
