//! Any bytes as a file that ends in .npy.
#![no_main]

mod reading;

libfuzzer_sys::fuzz_target!(|data: &[u8]| reading::read("npy", data));
