//! Large tables: an error that names the table where `Vec` alone would end the process; and
//! fetching ahead of a sweep through them.

use bytemuck::Zeroable;

use crate::{Error, Result};

/// Values between two questions whether to go on: the system hands out memory when it is first
/// written to, which takes its time for large tables.
const STEP: usize = 1 << 16;

/// Room for exactly `count` values, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn room<T>(count: usize, what: &'static str) -> Result<Vec<T>> {
    let mut values = Vec::new();
    values.try_reserve_exact(count).map_err(|_| Error::OutOfMemory { count, what })?;
    Ok(values)
}

/// Room for `more` values behind those that are there, counted as `what`; amortized as in `Vec`.
///
/// # Errors
/// [`Error::OutOfMemory`].
#[inline(always)]
pub fn reserve<T>(values: &mut Vec<T>, more: usize, what: &'static str) -> Result<()> {
    values.try_reserve(more).map_err(|_| Error::OutOfMemory { count: values.len() + more, what })
}

/// `count` values of all bytes zero, counted as `what`. The system hands out the memory of a large
/// table where it is first written to, by the thread that writes.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn zeroed<T: Zeroable>(count: usize, what: &'static str) -> Result<Vec<T>> {
    bytemuck::try_zeroed_vec(count).map_err(|()| Error::OutOfMemory { count, what })
}

/// A value of all bytes zero, counted by its bytes as `what`; otherwise as [`zeroed`].
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn zeroed_box<T: Zeroable>(what: &'static str) -> Result<Box<T>> {
    bytemuck::try_zeroed_box().map_err(|()| Error::OutOfMemory { count: size_of::<T>(), what })
}

/// `count` copies of a value, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`]; those of `go_on`, which is asked every some thousand values.
pub fn filled<T: Clone>(
    count: usize,
    value: T,
    what: &'static str,
    go_on: impl Fn() -> Result<()>,
) -> Result<Vec<T>> {
    let mut values = room(count, what)?;
    while values.len() < count {
        go_on()?;
        values.resize((values.len() + STEP).min(count), value.clone());
    }
    Ok(values)
}

/// Cuts `values` into consecutive parts of so many values each, together as many as there are, or
/// fewer; counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn parts<'v, T>(
    mut values: &'v mut [T],
    lengths: impl ExactSizeIterator<Item = usize>,
    what: &'static str,
) -> Result<Vec<&'v mut [T]>> {
    let mut parts = room(lengths.len(), what)?;
    parts.extend(
        lengths.map(|length| values.split_off_mut(..length).expect("parts are within the values")),
    );
    Ok(parts)
}

/// Asks the processor to fetch what is looked at soon. Does nothing where there is nothing.
#[inline(always)]
pub fn prefetch<T>(element: *const T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: prefetching never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(element.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = element;
}
