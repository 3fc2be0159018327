//! `cargo demo`: builds what flies in simulation, nothing else, and becomes `jink demo` with the same arguments.

use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// The programs of a simulated flight, and `jink` to look at it. The drivers of real sensors, campaigns and benchmarks are none.
const PROGRAMS: [&str; 12] = [
    "jink",
    "jink-lab",
    "jink-supervisor",
    "jink-simulator",
    "jink-obstacle-fusion",
    "jink-planner",
    "jink-bezier-generator",
    "jink-collision-guard",
    "jink-mavlink-gateway",
    "jink-parameter-server",
    "jink-ground-services",
    "jink-link-check",
];

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
