//! Any bytes as a file that ends in .nrrd.
#![no_main]

mod reading;

libfuzzer_sys::fuzz_target!(|data: &[u8]| reading::read("nrrd", data));
