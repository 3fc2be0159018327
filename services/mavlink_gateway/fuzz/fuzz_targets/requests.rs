//! See the law book of the same name.
#![no_main]

#[path = "../../tests/it/harness/mod.rs"]
mod harness;

libfuzzer_sys::fuzz_target!(|data: &[u8]| harness::requests::laws(data));
