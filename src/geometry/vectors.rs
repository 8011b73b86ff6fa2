//! Loops over many values of a kind, compiled twice: for any processor, and for AVX2, which is
//! chosen when the program runs. Neither contracts a product and a sum to one rounding, so both
//! give the same bits.

/// Defines the function `$name`, which runs `$body` as the processor allows, and the two instances
/// that it chooses from. Generic parameters stand in brackets. `$body` is to be inlined always.
macro_rules! vectorized {
    (
        $(#[$attribute:meta])*
        fn $name:ident[$($generic:tt)*]($($argument:ident: $type:ty),*) = $body:path;
        $avx2:ident, $portably:ident
    ) => {
        $(#[$attribute])*
        fn $name<$($generic)*>($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2, the only thing that the function needs.
                return unsafe { $avx2($($argument),*) };
            }
            $portably($($argument),*);
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2")]
        fn $avx2<$($generic)*>($($argument: $type),*) {
            $body($($argument),*);
        }

        /// Not inlined: only the arguments of a function are known not to overlap.
        #[inline(never)]
        fn $portably<$($generic)*>($($argument: $type),*) {
            $body($($argument),*);
        }
    };
}
pub(crate) use vectorized;

/// A number in [0, 1) for each index, equally distributed (Weyl); squares, so that points in
/// sequence are not in line.
#[cfg(test)]
pub(crate) fn weyl(i: usize) -> f64 {
    ((i * i) as f64 * 0.618_033_988_749_894_9).fract()
}
