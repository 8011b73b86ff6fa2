//! Small blocks of memory where the system refuses them: an allocator that keeps some in reserve.
//!
//! Rust's collections end the process when a block is refused. Whatever grows with an image or a
//! mesh therefore asks first ([`super::room`], [`super::reserve`]) and ends in an error. The small
//! blocks, here and in the libraries that we use, come out of the reserve then: the call goes on
//! for a moment, notices it at its next look ([`super::Watch`]), and ends in the same error. C++
//! keeps a pool for exceptions in the same way.
//!
//! It is the process's allocator where the cargo feature `memory-reserve` is on, as in the C
//! library. The reserve costs no memory before it is needed: its pages are never touched.
//!
//! **Invariant.** `state` packs how many bytes of the reserve are used, and how many blocks are
//! out. Blocks that are out do not overlap, and all end within the used bytes. A new block begins
//! at the end of the used bytes. The used bytes shrink in two cases only: to none when no block is
//! out, and to the start of a block that ends where they end, when it comes back.

use std::alloc::{GlobalAlloc, Layout};
use std::cell::UnsafeCell;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::{AcqRel, Relaxed};

use super::Refusals;

/// The largest block that comes out of it. Larger ones grow with an image or a mesh, and whoever
/// asks for them takes a refusal.
pub const LARGEST: usize = 1 << 20;

/// The bytes of a reserve. They are apart from what uses them: a static of nothing but these takes
/// no room in the file of the library.
pub struct Bytes<const SIZE: usize>(UnsafeCell<[MaybeUninit<u8>; SIZE]>);

// SAFETY: only the allocator that has them touches them, see there.
unsafe impl<const SIZE: usize> Sync for Bytes<SIZE> {}

impl<const SIZE: usize> Bytes<SIZE> {
    /// Bytes that nobody uses yet.
    pub const fn new() -> Self {
        Self(UnsafeCell::new([MaybeUninit::uninit(); SIZE]))
    }
}

impl<const SIZE: usize> Default for Bytes<SIZE> {
    fn default() -> Self {
        Self::new()
    }
}

/// An allocator with `SIZE` bytes in reserve, less than 2^32.
pub struct WithReserve<A, const SIZE: usize> {
    system: A,
    bytes: &'static Bytes<SIZE>,
    /// Used bytes in the lower half, blocks that are out in the upper one.
    state: AtomicU64,
    /// Is told of each block that the system refused.
    refusals: &'static Refusals,
}

impl<A, const SIZE: usize> WithReserve<A, SIZE> {
    /// Asks `system` first, and tells `refusals` where it has to do without.
    ///
    /// # Safety
    /// Nobody else may use `bytes`. Then each of them belongs to at most one block that is out, by
    /// the invariant, and only whoever holds that block touches it.
    pub const unsafe fn new(
        system: A,
        bytes: &'static Bytes<SIZE>,
        refusals: &'static Refusals,
    ) -> Self {
        const { assert!(SIZE < 1 << 32) };
        Self { system, bytes, state: AtomicU64::new(0), refusals }
    }

    fn base(&self) -> *mut u8 {
        self.bytes.0.get().cast()
    }

    /// Where a block of the reserve begins; `None` for one of the system's.
    fn offset_of(&self, block: *mut u8) -> Option<usize> {
        block.addr().checked_sub(self.base().addr()).filter(|&offset| offset < SIZE)
    }

    /// A block of the reserve; NULL where it is too large or the reserve too small.
    fn take(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST {
            return ptr::null_mut();
        }
        let base = self.base();
        let mut start = 0;
        let taken = self.state.fetch_update(AcqRel, Relaxed, |state| {
            let used = state as u32 as usize;
            start = (base.addr() + used).next_multiple_of(layout.align()) - base.addr();
            let end = start.checked_add(layout.size()).filter(|&end| end <= SIZE)?;
            Some(((state >> 32) + 1) << 32 | end as u64)
        });
        match taken {
            Ok(_) => {
                self.refusals.note(layout.size());
                // SAFETY: `start` is within the reserve.
                unsafe { base.add(start) }
            }
            Err(_) => ptr::null_mut(),
        }
    }

    /// Takes a block of the reserve back.
    ///
    /// Acquire and release, here and in `take`: what was written to a block happens before it is
    /// handed out again, on whatever thread.
    fn take_back(&self, offset: usize, size: usize) {
        let _ = self.state.fetch_update(AcqRel, Relaxed, |state| {
            let (used, out) = (state as u32 as usize, (state >> 32) - 1);
            let used = match out {
                0 => 0,
                _ if offset + size == used => offset,
                _ => used,
            };
            Some(out << 32 | used as u64)
        });
    }
}

// SAFETY: blocks are the system's, or, by the invariant, parts of the reserve that nothing else
// uses, of the size and alignment asked for. Nothing here panics: sizes are within the reserve,
// sums of them far below overflow.
unsafe impl<A: GlobalAlloc, const SIZE: usize> GlobalAlloc for WithReserve<A, SIZE> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        let block = unsafe { self.system.alloc(layout) };
        if block.is_null() { self.take(layout) } else { block }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        let block = unsafe { self.system.alloc_zeroed(layout) };
        if !block.is_null() {
            return block;
        }
        let block = self.take(layout);
        if !block.is_null() {
            // SAFETY: the block has this size.
            unsafe { block.write_bytes(0, layout.size()) };
        }
        block
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        match self.offset_of(block) {
            Some(offset) => self.take_back(offset, layout.size()),
            // SAFETY: the caller's promise; the block is the system's.
            None => unsafe { self.system.dealloc(block, layout) },
        }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let is_systems = self.offset_of(block).is_none();
        if is_systems {
            // SAFETY: the caller's promise; the block is the system's.
            let grown = unsafe { self.system.realloc(block, layout, size) };
            if !grown.is_null() {
                return grown;
            }
        }
        // SAFETY: the caller promises that the size fits the alignment, and is not 0.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        // What the system refused it need not be asked for again; of a block of the reserve it may
        // have the larger one now.
        // SAFETY: as above.
        let moved = if is_systems { self.take(new) } else { unsafe { self.alloc(new) } };
        if !moved.is_null() {
            // SAFETY: both have so many bytes, and do not overlap.
            unsafe {
                moved.copy_from_nonoverlapping(block, size.min(layout.size()));
                self.dealloc(block, layout);
            }
        }
        moved
    }
}

/// The process's allocator, with 4 MiB in reserve.
#[cfg(feature = "memory-reserve")]
#[global_allocator]
static ALLOCATOR: WithReserve<std::alloc::System, RESERVE> = {
    // SAFETY: no other code names the bytes.
    unsafe { WithReserve::new(std::alloc::System, &BYTES, &super::REFUSALS) }
};

#[cfg(feature = "memory-reserve")]
const RESERVE: usize = 4 << 20;

#[cfg(feature = "memory-reserve")]
static BYTES: Bytes<RESERVE> = Bytes::new();

#[cfg(test)]
mod tests {
    use std::alloc::System;
    use std::sync::atomic::AtomicBool;

    use super::*;

    /// The system, which may be told to refuse.
    struct Moody(AtomicBool);

    // SAFETY: the system's blocks, or NULL.
    unsafe impl GlobalAlloc for Moody {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            if self.0.load(Relaxed) { ptr::null_mut() } else { unsafe { System.alloc(layout) } }
        }

        unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
            unsafe { System.dealloc(block, layout) }
        }
    }

    fn moody<const SIZE: usize>(refuses: bool) -> Box<WithReserve<Moody, SIZE>> {
        // The process's own would end what runs beside this test.
        let refusals = Box::leak(Box::new(Refusals::new()));
        let bytes = Box::leak(Box::default());
        // SAFETY: nobody else has the bytes.
        Box::new(unsafe { WithReserve::new(Moody(AtomicBool::new(refuses)), bytes, refusals) })
    }

    fn layout(size: usize) -> Layout {
        Layout::from_size_align(size, 64).unwrap()
    }

    fn used<const SIZE: usize>(allocator: &WithReserve<Moody, SIZE>) -> u64 {
        allocator.state.load(Relaxed)
    }

    #[test]
    fn refused_blocks_come_from_the_reserve_and_are_noticed() {
        let allocator = moody::<4096>(true);
        let blocks: Vec<*mut u8> =
            (0..10).map(|_| unsafe { allocator.alloc_zeroed(layout(100)) }).collect();
        for (k, &block) in blocks.iter().enumerate() {
            assert!(allocator.offset_of(block).is_some() && block.addr().is_multiple_of(64));
            let bytes = unsafe { std::slice::from_raw_parts_mut(block, 100) };
            assert!(bytes.iter().all(|&byte| byte == 0));
            bytes.fill(k as u8 + 1);
        }
        for (k, &block) in blocks.iter().enumerate() {
            let bytes = unsafe { std::slice::from_raw_parts(block, 100) };
            assert!(bytes.iter().all(|&byte| byte == k as u8 + 1));
        }
        assert_eq!(allocator.refusals.count.load(Relaxed), 10);
        assert_eq!(allocator.refusals.size.load(Relaxed), 100);
        // The last one makes room; with all of them gone the reserve is as new.
        let before = used(&allocator);
        let more = unsafe { allocator.alloc(layout(200)) };
        unsafe { allocator.dealloc(more, layout(200)) };
        assert!(used(&allocator) as u32 >= before as u32 && used(&allocator) >> 32 == 10);
        blocks.iter().for_each(|&block| unsafe { allocator.dealloc(block, layout(100)) });
        assert_eq!(used(&allocator), 0);
    }

    #[test]
    fn the_reserve_has_an_end() {
        let allocator = moody::<4096>(true);
        unsafe {
            assert!(allocator.alloc(layout(LARGEST + 1)).is_null());
            let block = allocator.alloc(layout(3000));
            assert!(!block.is_null() && allocator.alloc(layout(2000)).is_null());
            assert!(allocator.alloc_zeroed(layout(2000)).is_null());
            assert!(allocator.realloc(block, layout(3000), 4000).is_null());
            allocator.dealloc(block, layout(3000));
            assert!(!allocator.alloc(layout(4000)).is_null());
        }
    }

    #[test]
    fn blocks_move_between_the_system_and_the_reserve() {
        let allocator = moody::<4096>(false);
        unsafe {
            let block = allocator.alloc(layout(64));
            assert!(allocator.offset_of(block).is_none());
            block.write_bytes(7, 64);
            allocator.system.0.store(true, Relaxed);
            let reserved = allocator.realloc(block, layout(64), 128);
            assert!(allocator.offset_of(reserved).is_some());
            allocator.system.0.store(false, Relaxed);
            let back = allocator.realloc(reserved, layout(128), 4096);
            assert!(allocator.offset_of(back).is_none() && used(&allocator) == 0);
            assert!(std::slice::from_raw_parts(back, 64).iter().all(|&byte| byte == 7));
            allocator.dealloc(back, layout(4096));
        }
    }

    #[test]
    fn threads_do_not_get_the_same_bytes() {
        let allocator = moody::<{ 1 << 16 }>(true);
        std::thread::scope(|scope| {
            for thread in 0..4_u8 {
                let allocator = &allocator;
                scope.spawn(move || {
                    for turn in 0..20_000_usize {
                        let layout = layout(1 + turn % 500);
                        let block = unsafe { allocator.alloc(layout) };
                        if block.is_null() {
                            continue;
                        }
                        unsafe {
                            block.write_bytes(thread, layout.size());
                            let bytes = std::slice::from_raw_parts(block, layout.size());
                            assert!(bytes.iter().all(|&byte| byte == thread));
                            allocator.dealloc(block, layout);
                        }
                    }
                });
            }
        });
        assert_eq!(used(&allocator), 0);
    }
}
