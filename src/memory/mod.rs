//! Large tables: an error that names the table where `Vec` alone would end the process; and
//! fetching ahead of a sweep through them. Tables that grow in place: `pages`. Small blocks:
//! `reserve`. What a cancelled call need not wait for: `aside`. Tables that many threads write at
//! the same time: `atomic`, `bits`.

pub mod aside;
pub mod atomic;
pub mod bits;
pub mod pages;
#[cfg(any(test, feature = "memory-reserve"))]
pub mod reserve;

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use bytemuck::Zeroable;

use crate::{Error, Result};

/// Values between two questions whether to go on: the system hands out memory when it is first
/// written to, which takes its time for large tables.
const STEP: usize = 1 << 16;

/// What the system refused and the reserve gave.
static REFUSALS: Refusals = Refusals::new();

/// How often the system refused a small block. Relaxed: it only has to be seen in the end.
pub struct Refusals {
    count: AtomicUsize,
    /// Bytes of the last block.
    size: AtomicUsize,
}

impl Refusals {
    const fn new() -> Self {
        Self { count: AtomicUsize::new(0), size: AtomicUsize::new(0) }
    }

    #[cfg(any(test, feature = "memory-reserve"))]
    fn note(&self, size: usize) {
        self.size.store(size, Relaxed);
        self.count.fetch_add(1, Relaxed);
    }
}

/// Notices that the system refused small blocks, to whichever call of the process, since it was
/// made.
#[derive(Clone, Copy, Debug)]
pub struct Watch(usize);

impl Watch {
    /// From now on.
    pub fn new() -> Self {
        Self(REFUSALS.count.load(Relaxed))
    }

    /// Ends a call before the reserve is used up.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    #[inline]
    pub fn check(&self) -> Result<()> {
        match REFUSALS.count.load(Relaxed) {
            count if count == self.0 => Ok(()),
            _ => Err(Error::OutOfMemory { count: REFUSALS.size.load(Relaxed), what: "bytes" }),
        }
    }
}

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

/// The values of an iterator that says how many there are, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn collected<T>(
    values: impl ExactSizeIterator<Item = T>,
    what: &'static str,
) -> Result<Vec<T>> {
    let mut all = room(values.len(), what)?;
    all.extend(values);
    Ok(all)
}

/// The values of several lists, one after the other, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn concatenated<T>(lists: Vec<Vec<T>>, what: &'static str) -> Result<Vec<T>> {
    let mut all = room(lists.iter().map(Vec::len).sum(), what)?;
    lists.into_iter().for_each(|list| all.extend(list));
    Ok(all)
}

/// A copy of a text, counted by its bytes as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn text(text: &str, what: &'static str) -> Result<String> {
    let mut copy = String::new();
    let lack = |_| Error::OutOfMemory { count: text.len(), what };
    copy.try_reserve_exact(text.len()).map_err(lack)?;
    copy.push_str(text);
    Ok(copy)
}

/// Puts a value into a table by its key, counted as `what`; returns the value that was there.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn insert<K: Eq + Hash, V>(
    table: &mut HashMap<K, V>,
    key: K,
    value: V,
    what: &'static str,
) -> Result<Option<V>> {
    table.try_reserve(1).map_err(|_| Error::OutOfMemory { count: table.len() + 1, what })?;
    Ok(table.insert(key, value))
}

/// `count` values of all bytes zero, counted as `what`. The system hands out the memory of a large
/// table where it is first written to, by the thread that writes.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn zeroed<T: Zeroable>(count: usize, what: &'static str) -> Result<Vec<T>> {
    bytemuck::try_zeroed_vec(count).map_err(|()| Error::OutOfMemory { count, what })
}

/// As [`zeroed`], on huge pages where the system has them: for a table of all voxels, which is read
/// at random as long as a mesh is made.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn zeroed_huge<T: Zeroable>(count: usize, what: &'static str) -> Result<Vec<T>> {
    let mut values = zeroed(count, what)?;
    pages::prefer_huge(&mut values);
    Ok(values)
}

/// As [`zeroed`], with room for `more` values behind them, if that can be had. Most systems hand
/// out memory for it only where it is written to.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn zeroed_with_room<T: Zeroable>(
    count: usize,
    more: usize,
    what: &'static str,
) -> Result<Vec<T>> {
    let mut values = zeroed(count + more, what).or_else(|_| zeroed(count, what))?;
    values.truncate(count);
    Ok(values)
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
