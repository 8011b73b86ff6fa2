//! Any bytes as a file that ends in .tif.
#![no_main]

mod reading;

libfuzzer_sys::fuzz_target!(|data: &[u8]| reading::read("tif", data));
