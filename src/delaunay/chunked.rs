//! An array that grows without moving, by chunks of a fixed size.
//!
//! Any number of threads may read existing elements while one makes others.
//!
//! **Addresses.** Those of all elements that there may ever be are reserved when the array is made
//! (`memory::pages`): an element is found by its index alone, without a table. Refinement is 4 to
//! 5 % faster so.
//!
//! **Placement.** The system takes a page from the node of the thread that touches it first, and
//! that is the worker that claimed the chunk. An allocator is not asked: for records aligned to
//! cache lines it would write the zeros itself, at once, and it extends the heaps of threads little
//! by little, which halts the page faults of all other threads.

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use bytemuck::Zeroable;

use crate::memory::pages::{PAGE, Pages};
use crate::memory::prefetch;
use crate::sync::lock;
use crate::{Error, Result};

/// Elements of one chunk; a power of two.
pub const CHUNK: usize = 1 << 14;

/// Chunks that are made usable at a time, so that the system is seldom asked.
const BLOCK: usize = 16;

/// The array. `T` holds atomics, so that shared references suffice to write; nothing of it is ever
/// dropped.
pub struct Chunked<T> {
    pages: Pages,
    /// Elements before this exist: whole chunks, all bytes zero until they are written.
    len: AtomicUsize,
    growing: Mutex<()>,
    elements: PhantomData<T>,
}

impl<T: Zeroable + Sync> Chunked<T> {
    /// Bytes of one chunk.
    pub const CHUNK_BYTES: usize = {
        // Pages are aligned to more than any record.
        assert!(!std::mem::needs_drop::<T>() && align_of::<T>() <= 4096);
        assert!(size_of::<T>() > 0 && (CHUNK * size_of::<T>()).is_multiple_of(PAGE));
        CHUNK * size_of::<T>()
    };

    /// An empty array with room for `capacity` elements, rounded up to whole chunks.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn with_capacity(capacity: usize) -> Result<Self> {
        Self::of(Pages::reserve(Self::bytes_for(capacity)))
    }

    /// The same; where a limit leaves not as many addresses, with room for what fits in a part of
    /// these.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn with_capacity_at_most(capacity: usize) -> Result<Self> {
        Self::of(Pages::reserve_part(Self::bytes_for(capacity), Self::CHUNK_BYTES))
    }

    fn bytes_for(capacity: usize) -> usize {
        let most = isize::MAX as usize / Self::CHUNK_BYTES;
        capacity.div_ceil(CHUNK).clamp(1, most) * Self::CHUNK_BYTES
    }

    fn of(pages: Option<Pages>) -> Result<Self> {
        let pages = pages.ok_or(Self::lack(1))?;
        Ok(Self { pages, len: AtomicUsize::new(0), growing: Mutex::new(()), elements: PhantomData })
    }

    fn lack(chunks: usize) -> Error {
        Error::OutOfMemory {
            count: chunks * Self::CHUNK_BYTES,
            what: "bytes for the triangulation",
        }
    }

    /// Number of elements that there is room for.
    pub fn capacity(&self) -> usize {
        self.max_chunks() * CHUNK
    }

    fn max_chunks(&self) -> usize {
        self.pages.bytes() / Self::CHUNK_BYTES
    }

    /// Makes all chunks up to `chunk` exist.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    #[inline]
    pub fn make_chunk(&self, chunk: usize) -> Result<()> {
        if (chunk + 1) * CHUNK <= self.len.load(Ordering::Acquire) {
            return Ok(());
        }
        self.make_block(chunk)
    }

    #[cold]
    fn make_block(&self, chunk: usize) -> Result<()> {
        let _growing = lock(&self.growing);
        let made = self.len.load(Ordering::Relaxed) / CHUNK;
        if chunk < made {
            return Ok(());
        }
        let end = (chunk / BLOCK + 1).saturating_mul(BLOCK).min(self.max_chunks());
        let bytes = made * Self::CHUNK_BYTES..end * Self::CHUNK_BYTES;
        if chunk >= end || !self.pages.make_usable(bytes) {
            return Err(Self::lack(end.saturating_sub(made).max(1)));
        }
        // Release: who finds the length may touch the elements.
        self.len.store(end * CHUNK, Ordering::Release);
        Ok(())
    }

    /// Gives the memory back, as long as `go_on` says so; then aside.
    ///
    /// # Errors
    /// Those of `go_on`.
    pub fn give_back(self, go_on: &(dyn Fn() -> Result<()> + Sync)) -> Result<()> {
        let used = self.len.into_inner() * size_of::<T>();
        self.pages.give_back(used, BLOCK * Self::CHUNK_BYTES, &|_, _| go_on())
    }

    /// The same, chunk by chunk, each of which is shown before to `visit`: the index of its first
    /// element, and all of them.
    ///
    /// # Errors
    /// Those of `visit`.
    pub fn drain(self, visit: &(dyn Fn(usize, &[T]) -> Result<()> + Sync)) -> Result<()> {
        let used = self.len.into_inner() * size_of::<T>();
        self.pages.give_back(used, Self::CHUNK_BYTES, &|start, range| {
            let count = range.len() / size_of::<T>();
            // SAFETY: these are elements before the length, as in `get`; the pages outlive the
            // call.
            let elements = unsafe { std::slice::from_raw_parts(start.cast::<T>().as_ptr(), count) };
            visit(range.start / size_of::<T>(), elements)
        })
    }

    /// Asks the processor to fetch element `index`, which is inspected soon. Does nothing when
    /// there is no such element.
    #[inline(always)]
    pub fn prefetch(&self, index: u32) {
        prefetch(self.pages.start().cast::<T>().as_ptr().wrapping_add(index as usize));
    }

    /// Asks the system for the memory of existing elements, which are about to be written for the
    /// first time.
    pub fn populate(&self, elements: Range<u32>) {
        let size = size_of::<T>();
        self.pages.populate(elements.start as usize * size..elements.end as usize * size);
    }

    /// The element `index`.
    ///
    /// # Panics
    /// When its chunk was never made.
    #[inline(always)]
    pub fn get(&self, index: u32) -> &T {
        let index = index as usize;
        // Acquire: pairs with the release of make_block; a plain load on x86.
        if index >= self.len.load(Ordering::Acquire) {
            missing_chunk();
        }
        // SAFETY: elements before the length are zeroed, hence valid, and usable as long as the
        // pages are, which is as long as self; nobody reaches them in another way. T is Sync, so
        // sharing them is fine.
        unsafe { &*self.pages.start().cast::<T>().as_ptr().add(index) }
    }
}

#[cold]
#[inline(never)]
fn missing_chunk() -> ! {
    panic!("an id names memory that was never made")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    #[test]
    fn elements_stay_while_the_array_grows() {
        let array = Chunked::<AtomicU32>::with_capacity(3 * CHUNK).unwrap();
        array.make_chunk(0).unwrap();
        let first = array.get(7);
        first.store(42, Ordering::Relaxed);
        array.make_chunk(2).unwrap();
        array.make_chunk(0).unwrap();
        assert_eq!(first.load(Ordering::Relaxed), 42);
        assert_eq!(array.get(2 * CHUNK as u32).load(Ordering::Relaxed), 0);
    }

    #[test]
    fn threads_that_make_the_same_chunk_share_it() {
        let array = Chunked::<AtomicU32>::with_capacity(CHUNK).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    array.make_chunk(0).unwrap();
                    array.get(1).fetch_add(1, Ordering::Relaxed);
                });
            }
        });
        assert_eq!(array.get(1).load(Ordering::Relaxed), 4);
    }

    #[test]
    fn all_is_shown_before_it_is_given_back() {
        let array = Chunked::<AtomicU32>::with_capacity(40 * CHUNK).unwrap();
        array.make_chunk(20).unwrap();
        let count = 32 * CHUNK;
        (0..count as u32).for_each(|i| array.get(i).store(i + 1, Ordering::Relaxed));
        let seen = AtomicUsize::new(0);
        let visit = |first: usize, elements: &[AtomicU32]| {
            let values = elements.iter().map(|value| value.load(Ordering::Relaxed));
            assert!(values.eq(first as u32 + 1..(first + elements.len()) as u32 + 1));
            seen.fetch_add(elements.len(), Ordering::Relaxed);
            Ok(())
        };
        array.drain(&visit).unwrap();
        assert_eq!(seen.into_inner(), count);
    }

    #[test]
    #[should_panic(expected = "never made")]
    fn an_element_of_no_chunk_is_refused() {
        Chunked::<AtomicU32>::with_capacity(CHUNK).unwrap().get(0);
    }

    #[test]
    fn an_array_is_no_larger_than_its_room() {
        let array = Chunked::<AtomicU32>::with_capacity(2 * CHUNK + 1).unwrap();
        assert_eq!(array.capacity(), 3 * CHUNK);
        array.make_chunk(2).unwrap();
        array.get(3 * CHUNK as u32 - 1);
        for chunk in [3, usize::MAX / CHUNK - 1] {
            assert!(matches!(array.make_chunk(chunk), Err(Error::OutOfMemory { .. })));
        }
    }
}
