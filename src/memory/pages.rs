//! Address space that becomes memory little by little, and never moves.
//!
//! Tables that grow while threads read them need places that stay. The addresses for all that such
//! a table may ever hold are reserved when it is made, which costs no memory; pages are made usable
//! as the table grows, and the system hands each one out, all zeros, when it is first touched.
//!
//! Addresses can be short: a limit of address space (`ulimit -v`) counts what is reserved, too.
//! [`Pages::reserve_part`] takes a part of what such a limit leaves.

use std::ops::Range;
use std::ptr::NonNull;

use rayon::prelude::*;

use super::aside::drop_aside;
use crate::Result;

/// No more than this part of the addresses that a limit leaves is taken: the rest is for all other
/// tables. Measured with AAL, abdomen and brain: the tets of a triangulation are 0.4 of what a run
/// needs at its peak.
const PART: (usize, usize) = (7, 16);

/// Sizes are multiples of this: the largest pages that systems have, but for huge ones.
pub const PAGE: usize = 1 << 16;

/// The huge pages that are most common. Another size costs time only.
const HUGE_PAGE: usize = 1 << 21;

/// A range of addresses. None of it is memory at first.
pub struct Pages {
    start: NonNull<u8>,
    bytes: usize,
}

// SAFETY: it owns a range of addresses, as a Box does, and does not read or write what is there.
unsafe impl Send for Pages {}
// SAFETY: as above.
unsafe impl Sync for Pages {}

impl Pages {
    /// So many bytes, a multiple of [`PAGE`] above 0; `None` where the system refuses.
    pub fn reserve(bytes: usize) -> Option<Self> {
        debug_assert!(bytes > 0 && bytes.is_multiple_of(PAGE));
        system::reserve(bytes).map(|start| Self { start, bytes })
    }

    /// So many bytes, a multiple of `unit`, or a part of the addresses that a limit leaves. `None`
    /// where that is not even one unit, itself a multiple of [`PAGE`].
    pub fn reserve_part(bytes: usize, unit: usize) -> Option<Self> {
        let wanted = part_of(system::addresses_left(), bytes, unit);
        let half = |bytes: usize| bytes / 2 / unit * unit;
        let mut part = wanted;
        while part >= unit {
            match Self::reserve(part) {
                None => part = half(part),
                // There are less than twice as many, and others need some: half of them will do.
                Some(pages) if part < wanted && part >= 2 * unit => {
                    drop(pages);
                    return Self::reserve(half(part));
                }
                pages => return pages,
            }
        }
        None
    }

    /// Where they begin.
    #[inline(always)]
    pub fn start(&self) -> NonNull<u8> {
        self.start
    }

    /// How many bytes there are.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Makes a range usable, whose ends are multiples of [`PAGE`]: all bytes are 0, and may be read
    /// and written until this is dropped. Returns whether the system does so. What is usable
    /// already stays as it is.
    #[must_use]
    pub fn make_usable(&self, range: Range<usize>) -> bool {
        debug_assert!(range.start.is_multiple_of(PAGE) && range.end.is_multiple_of(PAGE));
        range.start < range.end && range.end <= self.bytes && system::make_usable(self.start, range)
    }

    /// Asks the system for the memory of usable pages, which are about to be written for the first
    /// time, at once: that costs less than a fault for each. Where the system does not know how,
    /// they come by faults.
    pub fn populate(&self, range: Range<usize>) {
        if range.start < range.end && range.end <= self.bytes {
            system::populate(self.start, range);
        }
    }

    /// Gives the memory back, of which no more than the first `used` bytes were touched: in parts
    /// of so many bytes, many at a time, for it takes the system 50 to 200 ms for each GB. Each
    /// part is shown to `visit` before: where it begins, and its range. What is left when that
    /// fails is given back aside. Other systems than Linux get all at once.
    ///
    /// # Errors
    /// Those of `visit`.
    pub fn give_back(
        self,
        used: usize,
        part: usize,
        visit: &(dyn Fn(NonNull<u8>, Range<usize>) -> Result<()> + Sync),
    ) -> Result<()> {
        let used = used.min(self.bytes);
        let parts = (0..used.div_ceil(part)).into_par_iter().with_max_len(1);
        let given = parts.try_for_each(|i| {
            let range = i * part..((i + 1) * part).min(used);
            // SAFETY: the range lies within the pages.
            visit(unsafe { self.start().add(range.start) }, range.clone())?;
            // SAFETY: the pages are this call's, and nobody looks at this part any more.
            unsafe { system::forget(self.start(), range) };
            Ok(())
        });
        if given.is_err() {
            drop_aside(self);
        }
        given
    }
}

/// Asks the system for huge pages where the bytes of `values` fill such pages. To be called before
/// they are first touched. Small pages cost a fault each, and the processor remembers the places of
/// few of them. Where the system has no huge pages to give, nothing changes.
pub fn prefer_huge<T>(values: &mut [T]) {
    let start = values.as_mut_ptr().addr();
    let offset = start.next_multiple_of(HUGE_PAGE) - start;
    let bytes = size_of_val(values).saturating_sub(offset) / HUGE_PAGE * HUGE_PAGE;
    if bytes > 0 {
        system::prefer_huge(values.as_mut_ptr().cast::<u8>().wrapping_add(offset), bytes);
    }
}

/// `bytes`, or the largest multiple of `unit` in [`PART`] of the bytes that are `left`.
fn part_of(left: Option<usize>, bytes: usize, unit: usize) -> usize {
    let (part, of) = PART;
    left.map_or(bytes, |left| bytes.min(left / of * part / unit * unit))
}

impl Drop for Pages {
    fn drop(&mut self) {
        system::release(self.start, self.bytes);
    }
}

#[cfg(unix)]
mod system {
    use std::ops::Range;
    use std::ptr::{NonNull, null_mut};

    use rustix::mm::{MapFlags, MprotectFlags, ProtFlags, mmap_anonymous, mprotect, munmap};

    /// How many bytes of addresses the process may still take, where there is a limit.
    #[cfg(target_os = "linux")]
    pub fn addresses_left() -> Option<usize> {
        use rustix::process::{Resource, getrlimit};
        let limit = getrlimit(Resource::As).current?;
        let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
        let pages: u64 = statm.split(' ').next()?.parse().ok()?;
        let used = pages.saturating_mul(rustix::param::page_size() as u64);
        usize::try_from(limit.saturating_sub(used)).ok()
    }

    #[cfg(not(target_os = "linux"))]
    pub fn addresses_left() -> Option<usize> {
        None
    }

    pub fn reserve(bytes: usize) -> Option<NonNull<u8>> {
        // What may not be touched counts for no limit but that of address space.
        let (access, flags) = (ProtFlags::empty(), MapFlags::PRIVATE);
        // Else the whole would count as soon as a part of it may be written.
        #[cfg(target_os = "linux")]
        let flags = flags | MapFlags::NORESERVE;
        // SAFETY: without an address that is asked for, nothing that is mapped is replaced.
        let start = unsafe { mmap_anonymous(null_mut(), bytes, access, flags) };
        start.ok().and_then(|start| NonNull::new(start.cast()))
    }

    pub fn make_usable(start: NonNull<u8>, range: Range<usize>) -> bool {
        let access = MprotectFlags::READ | MprotectFlags::WRITE;
        // SAFETY: the range lies within a reservation, and what is usable already stays so.
        unsafe { mprotect(start.as_ptr().add(range.start).cast(), range.len(), access).is_ok() }
    }

    #[cfg(target_os = "linux")]
    pub fn populate(start: NonNull<u8>, range: Range<usize>) {
        use rustix::mm::{Advice, madvise};
        // SAFETY: the range lies within a reservation, and no contents change.
        let _ = unsafe {
            let first = start.as_ptr().add(range.start).cast();
            madvise(first, range.len(), Advice::LinuxPopulateWrite)
        };
    }

    #[cfg(not(target_os = "linux"))]
    pub fn populate(_: NonNull<u8>, _: Range<usize>) {}

    #[cfg(target_os = "linux")]
    pub fn prefer_huge(start: *mut u8, bytes: usize) {
        use rustix::mm::{Advice, madvise};
        // SAFETY: no contents change, whatever is there.
        let _ = unsafe { madvise(start.cast(), bytes, Advice::LinuxHugepage) };
    }

    #[cfg(not(target_os = "linux"))]
    pub fn prefer_huge(_: *mut u8, _: usize) {}

    /// Gives memory back. The addresses stay reserved.
    ///
    /// # Safety
    /// The range must lie within a reservation, and nobody may look at it any more.
    #[cfg(target_os = "linux")]
    pub unsafe fn forget(start: NonNull<u8>, range: Range<usize>) {
        use rustix::mm::{Advice, madvise};
        // SAFETY: as promised.
        let _ = unsafe {
            let first = start.as_ptr().add(range.start).cast();
            madvise(first, range.len(), Advice::LinuxDontNeed)
        };
    }

    /// Elsewhere all is given back when the pages are dropped.
    #[cfg(not(target_os = "linux"))]
    pub unsafe fn forget(_: NonNull<u8>, _: Range<usize>) {}

    pub fn release(start: NonNull<u8>, bytes: usize) {
        // SAFETY: this is a whole reservation, whose owner is being dropped.
        let _ = unsafe { munmap(start.as_ptr().cast(), bytes) };
    }
}

#[cfg(windows)]
mod system {
    use std::ops::Range;
    use std::ptr::{NonNull, null};

    use windows_sys::Win32::System::Memory::{
        MEM_COMMIT, MEM_RELEASE, MEM_RESERVE, PAGE_NOACCESS, PAGE_READWRITE, VirtualAlloc,
        VirtualFree,
    };

    pub fn addresses_left() -> Option<usize> {
        None
    }

    pub fn reserve(bytes: usize) -> Option<NonNull<u8>> {
        // SAFETY: without an address that is asked for, nothing that is reserved is touched.
        NonNull::new(unsafe { VirtualAlloc(null(), bytes, MEM_RESERVE, PAGE_NOACCESS) }.cast())
    }

    pub fn make_usable(start: NonNull<u8>, range: Range<usize>) -> bool {
        // SAFETY: the range lies within a reservation, and what is usable already stays so.
        let made = unsafe {
            let first = start.as_ptr().add(range.start).cast();
            VirtualAlloc(first, range.len(), MEM_COMMIT, PAGE_READWRITE)
        };
        !made.is_null()
    }

    pub fn populate(_: NonNull<u8>, _: Range<usize>) {}

    pub fn prefer_huge(_: *mut u8, _: usize) {}

    /// All is given back when the pages are dropped.
    pub unsafe fn forget(_: NonNull<u8>, _: Range<usize>) {}

    pub fn release(start: NonNull<u8>, _: usize) {
        // SAFETY: this is a whole reservation, whose owner is being dropped.
        unsafe { VirtualFree(start.as_ptr().cast(), 0, MEM_RELEASE) };
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;
    use std::sync::atomic::Ordering::Relaxed;

    use super::*;

    /// More than any machine has addresses for.
    const TOO_MANY: usize = 1 << (usize::BITS - 4);

    #[test]
    fn pages_are_zeros_until_they_are_written() {
        let pages = Pages::reserve(64 * PAGE).unwrap();
        assert!(pages.make_usable(0..PAGE) && pages.make_usable(3 * PAGE..5 * PAGE));
        let first = pages.start();
        let at = |i: usize| first.as_ptr().wrapping_add(i);
        for i in [0, PAGE - 1, 3 * PAGE, 5 * PAGE - 1] {
            // SAFETY: these are usable, and nobody else has them.
            unsafe {
                assert_eq!(*at(i), 0);
                *at(i) = 7;
            }
        }
        pages.populate(3 * PAGE..5 * PAGE);
        assert!(pages.make_usable(0..6 * PAGE));
        // SAFETY: as above.
        unsafe { assert_eq!([*at(0), *at(3 * PAGE), *at(5 * PAGE)], [7, 7, 0]) };
        let (seen, address) = (AtomicUsize::new(0), first.addr().get());
        let visit = |start: NonNull<u8>, range: Range<usize>| {
            assert_eq!(start.addr().get(), address + range.start);
            seen.fetch_add(range.len(), Relaxed);
            Ok(())
        };
        pages.give_back(6 * PAGE, PAGE, &visit).unwrap();
        assert_eq!(seen.into_inner(), 6 * PAGE);
    }

    #[test]
    fn huge_pages_keep_what_is_there() {
        for bytes in [0, 1, PAGE, HUGE_PAGE - 1, HUGE_PAGE, 3 * HUGE_PAGE + 5] {
            let mut values: Vec<u8> = (0..bytes).map(|i| i as u8).collect();
            prefer_huge(&mut values);
            assert!(values.into_iter().eq((0..bytes).map(|i| i as u8)));
        }
    }

    #[test]
    fn what_is_not_reserved_is_not_made_usable() {
        let pages = Pages::reserve(2 * PAGE).unwrap();
        assert!(!pages.make_usable(PAGE..3 * PAGE) && !pages.make_usable(PAGE..PAGE));
    }

    #[test]
    fn a_part_is_taken_of_what_a_limit_leaves() {
        let unit = 16 * PAGE;
        assert_eq!(part_of(None, 64 * unit, unit), 64 * unit);
        assert_eq!(part_of(Some(usize::MAX), 64 * unit, unit), 64 * unit);
        assert_eq!(part_of(Some(32 * unit), 64 * unit, unit), 14 * unit);
        // Also where the limit leaves a little more than what was asked for.
        assert_eq!(part_of(Some(65 * unit), 64 * unit, unit), 28 * unit);
        assert_eq!(part_of(Some(unit), 64 * unit, unit), 0);
    }

    #[test]
    fn what_the_system_refuses_is_halved() {
        let unit = 16 * PAGE;
        assert!(Pages::reserve(TOO_MANY).is_none());
        let part = Pages::reserve_part(TOO_MANY, unit).unwrap();
        assert!(part.bytes().is_multiple_of(unit) && part.bytes() < TOO_MANY / 2);
        // As many are there for others.
        assert!(Pages::reserve(part.bytes()).is_some());
        assert_eq!(Pages::reserve_part(8 * unit, unit).unwrap().bytes(), 8 * unit);
    }

    #[test]
    fn memory_is_given_back_aside_after_a_failure() {
        let pages = Pages::reserve(4 * PAGE).unwrap();
        assert!(pages.make_usable(0..4 * PAGE));
        let given = pages.give_back(4 * PAGE, PAGE, &|_, _| Err(crate::Error::Cancelled));
        assert!(matches!(given, Err(crate::Error::Cancelled)));
    }
}
