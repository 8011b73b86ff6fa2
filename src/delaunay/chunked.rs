//! An array that grows without moving: fixed-size chunks, each made once, found through a fixed
//! table.
//!
//! Any number of threads may read existing chunks while one makes another.
//!
//! **Placement.** Chunks are parts of blocks of fresh pages of the system, which read as zeros. The
//! system takes a page from the node of the thread that touches it first, and that is the worker
//! that claimed the chunk. An allocator is not asked: for records aligned to cache lines it would
//! write the zeros itself, at once, and it extends the heaps of threads little by little, which
//! halts the page faults of all other threads.
//!
//! Cost: one access is two dependent loads, the first of them always hot, and a test that the chunk
//! exists.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicPtr, Ordering};

use bytemuck::Zeroable;
use memmap2::MmapMut;
use rayon::prelude::*;

use crate::memory::aside::drop_aside;
use crate::memory::{prefetch, zeroed_box};
use crate::sync::lock;
use crate::{Error, Result};

/// Elements of one chunk; a power of two.
pub const CHUNK: usize = 1 << 14;

/// Most chunks of one block; a power of two. What is not used of a block is address space, not
/// memory; so that it is not much of that either, the first blocks are smaller.
const BLOCK: usize = 16;

/// The chunks of the block of chunk `chunk`: 1, 1, 2, 4, and so on, then [`BLOCK`] each.
fn block_of(chunk: usize) -> Range<usize> {
    match chunk {
        0 => 0..1,
        1..BLOCK => {
            let first = 1 << chunk.ilog2();
            first..2 * first
        }
        _ => {
            let first = chunk / BLOCK * BLOCK;
            first..first + BLOCK
        }
    }
}

/// Entries of the table: any u32 finds its chunk without a test of bounds. The table is zeroed
/// memory, of which only the used part is ever touched.
const TABLE: usize = (1 << 32) / CHUNK;

/// The array. `T` holds atomics, so that shared references suffice to write; nothing of it is ever
/// dropped.
pub struct Chunked<T> {
    /// Null, or the first element of a chunk, which is a part of a block; never changes once it is
    /// not null.
    chunks: Box<[AtomicPtr<T>; TABLE]>,
    max_chunks: usize,
    /// What the chunks are parts of.
    blocks: Mutex<Vec<MmapMut>>,
}

impl<T: Zeroable + Sync> Chunked<T> {
    /// An empty array with room for `capacity` elements, rounded up to whole chunks.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn with_capacity(capacity: usize) -> Result<Self> {
        const { assert!(!std::mem::needs_drop::<T>() && size_of::<T>() > 0) };
        let chunks = zeroed_box("bytes for a table of chunks")?;
        Ok(Self {
            chunks,
            max_chunks: capacity.div_ceil(CHUNK).min(TABLE),
            blocks: Mutex::new(Vec::new()),
        })
    }

    /// Bytes of one chunk.
    pub const CHUNK_BYTES: usize = CHUNK * size_of::<T>();

    /// Number of chunks that fit.
    pub fn max_chunks(&self) -> usize {
        self.max_chunks
    }

    /// Makes chunk `chunk` exist, all bytes zero, unless it does.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    #[inline]
    pub fn make_chunk(&self, chunk: usize) -> Result<()> {
        if self.chunks[chunk].load(Ordering::Acquire).is_null() {
            self.make_block(chunk)
        } else {
            Ok(())
        }
    }

    #[cold]
    fn make_block(&self, chunk: usize) -> Result<()> {
        // Pages are aligned to more than any record.
        const { assert!(align_of::<T>() <= 4096 && TABLE.is_multiple_of(BLOCK)) };
        let mut blocks = lock(&self.blocks);
        if !self.chunks[chunk].load(Ordering::Relaxed).is_null() {
            return Ok(());
        }
        let chunks = block_of(chunk);
        let count = chunks.len() * Self::CHUNK_BYTES;
        let lack = Error::OutOfMemory { count, what: "bytes for the triangulation" };
        let (Ok(mut block), Ok(())) = (MmapMut::map_anon(count), blocks.try_reserve(1)) else {
            return Err(lack);
        };
        let made = block.as_mut_ptr().cast::<T>();
        blocks.push(block);
        for (i, slot) in self.chunks[chunks].iter().enumerate() {
            // Release: whoever finds the pointer finds zeroed memory.
            slot.store(made.wrapping_add(i * CHUNK), Ordering::Release);
        }
        Ok(())
    }

    /// Gives the memory back, many blocks at a time: it takes the system 50 to 200 ms for each GB.
    /// What is left when `go_on` fails is given back aside.
    pub fn give_back(self, go_on: &(dyn Fn() -> Result<()> + Sync)) {
        let blocks = std::mem::take(&mut *lock(&self.blocks));
        let left = Mutex::new(Vec::new());
        blocks.into_par_iter().with_max_len(1).for_each(|block| match go_on() {
            Ok(()) => drop(block),
            Err(_) => lock(&left).push(block),
        });
        let left = std::mem::take(&mut *lock(&left));
        if !left.is_empty() {
            drop_aside(left);
        }
    }

    /// Asks the processor to fetch element `index`, which is inspected soon. Does nothing when
    /// there is no such element.
    #[inline(always)]
    pub fn prefetch(&self, index: u32) {
        let chunk = self.chunks[index as usize / CHUNK].load(Ordering::Relaxed);
        prefetch(chunk.wrapping_add(index as usize % CHUNK));
    }

    /// Asks the system for the pages of elements `elements` of one chunk, which are about to be
    /// written for the first time, at once: that costs less than a fault for each. Where the system
    /// does not know how, they come by faults.
    #[cfg_attr(not(target_os = "linux"), allow(unused_variables))]
    pub fn populate(&self, elements: Range<u32>) {
        #[cfg(target_os = "linux")]
        {
            let elements = elements.start as usize..elements.end as usize;
            let chunk = self.chunks[elements.start / CHUNK].load(Ordering::Acquire);
            let first = elements.start % CHUNK;
            let count = elements.len().min(CHUNK - first);
            if !chunk.is_null() {
                // SAFETY: first + count <= CHUNK, so these are bytes of one chunk, which stays
                // mapped as long as self; their contents do not change.
                unsafe {
                    let pages = chunk.add(first).cast();
                    let _ = rustix::mm::madvise(
                        pages,
                        count * size_of::<T>(),
                        rustix::mm::Advice::LinuxPopulateWrite,
                    );
                }
            }
        }
    }

    /// The element `index`.
    ///
    /// # Panics
    /// When its chunk was never made.
    #[inline(always)]
    pub fn get(&self, index: u32) -> &T {
        let index = index as usize;
        // Acquire: pairs with the release of make_chunk; a plain load on x86.
        let chunk = self.chunks[index / CHUNK].load(Ordering::Acquire);
        if chunk.is_null() {
            missing_chunk();
        }
        // SAFETY: a pointer that is not null is a chunk of CHUNK zeroed, hence valid elements of a
        // block that is unmapped with self, and not reached by another way; index % CHUNK < CHUNK.
        // T is Sync, so sharing it is fine.
        unsafe { &*chunk.add(index % CHUNK) }
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
    fn each_chunk_is_in_one_block() {
        let mut next = 0;
        while next < 5 * BLOCK {
            let block = block_of(next);
            assert_eq!(block.start, next);
            block.clone().for_each(|chunk| assert_eq!(block_of(chunk), block));
            next = block.end;
        }
        assert_eq!(next, 5 * BLOCK);
    }

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
    #[should_panic(expected = "never made")]
    fn an_element_of_no_chunk_is_refused() {
        Chunked::<AtomicU32>::with_capacity(CHUNK).unwrap().get(0);
    }
}
