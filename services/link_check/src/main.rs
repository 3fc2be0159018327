//! The check of the links before the flight: see the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    jink_link_check::run(&arguments)
}
