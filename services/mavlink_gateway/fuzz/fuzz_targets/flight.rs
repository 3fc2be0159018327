//! See the law book of the same name.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| harness::flight::laws(data));
