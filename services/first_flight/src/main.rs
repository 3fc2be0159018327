//! `cargo demo`: builds what flies in simulation, nothing else, and becomes `jink demo` with the same arguments.

use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// What flies, and what simulates. Campaigns, benchmarks and tests have programs of their own, built when they are called.
const PROGRAMS: [&str; 2] = ["jink", "jink-lab"];

fn main() -> ExitCode {
    let mut build = Command::new("cargo");
    build.args(["build", "--release"]);
    for program in PROGRAMS {
        build.args(["--bin", program]);
    }
    let problem = match build.status() {
        Ok(status) if status.success() => {
            let own = std::env::current_exe().unwrap_or_default();
            let lab = own.with_file_name("jink-lab");
            let error = Command::new(&lab)
                .arg("demo")
                .args(std::env::args_os().skip(1))
                .exec();
            format!("{}: {error}", lab.display())
        }
        Ok(status) => format!("the build failed ({status})"),
        Err(error) => format!("cargo: {error}"),
    };
    eprintln!("jink: {problem}");
    ExitCode::FAILURE
}
