//! Replays vectors of PX4's collision prevention and prints where the emulated one answers otherwise.
//!
//! `cargo run --release -p jink-emulated-px4 --example px4_vectors -- DIR`; without DIR the committed sample. Ends with 1
//! on a mismatch, or if there is nothing to compare.

#[path = "../tests/it/collision_vectors/mod.rs"]
mod collision_vectors;

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/collision_prevention");
    let folder = std::env::args_os()
        .nth(1)
        .map_or_else(|| PathBuf::from(sample), PathBuf::from);
    let report = collision_vectors::replay_folder(&folder);
    print!("{report}");
    let total = report.total();
    ExitCode::from(u8::from(total.compared == 0 || total.mismatches > 0))
}
