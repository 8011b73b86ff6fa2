//! Values that one thread owns, for many threads: as atomics, which are read and written with
//! relaxed order. So no access can be a data race, whoever makes it.

use std::sync::atomic::{AtomicI32, AtomicU16, AtomicU32, AtomicU64};

/// A type that is the atomic form of another one.
///
/// # Safety
/// `Self` must have the size, the alignment and the valid bits of `Plain`, and allow changes
/// through a shared reference.
pub unsafe trait Atomic {
    /// The plain form.
    type Plain;
}

// SAFETY: the standard library promises the same size, alignment and bit validity for each of these
// pairs.
unsafe impl Atomic for AtomicU16 {
    type Plain = u16;
}
// SAFETY: as above.
unsafe impl Atomic for AtomicU32 {
    type Plain = u32;
}
// SAFETY: as above.
unsafe impl Atomic for AtomicI32 {
    type Plain = i32;
}
// SAFETY: as above of u64, which has the size of f64, and its alignment where that is asserted
// below; every bit pattern is valid for both.
unsafe impl Atomic for AtomicU64 {
    type Plain = f64;
}

/// Lets many threads use values that one thread owns; f64 as their bits.
pub fn atomic<A: Atomic>(values: &mut [A::Plain]) -> &[A] {
    const {
        assert!(
            size_of::<A>() == size_of::<A::Plain>() && align_of::<A>() == align_of::<A::Plain>()
        )
    };
    // SAFETY: the layouts agree by the trait's contract. The exclusive borrow lasts as long as the
    // result, so nobody reads or writes the values by plain accesses meanwhile.
    unsafe { std::slice::from_raw_parts(std::ptr::from_mut(values).cast::<A>(), values.len()) }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering::Relaxed;

    use super::*;

    #[test]
    fn what_is_written_by_many_is_there() {
        let (mut ids, mut places) = ([1_u32, 2], [0.5, -1.0]);
        atomic::<AtomicU32>(&mut ids)[1].store(7, Relaxed);
        let bits = atomic::<AtomicU64>(&mut places);
        assert_eq!(f64::from_bits(bits[0].load(Relaxed)), 0.5);
        bits[1].store(3.25_f64.to_bits(), Relaxed);
        assert_eq!((ids, places), ([1, 7], [0.5, 3.25]));
    }
}
