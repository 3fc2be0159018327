//! Programs that stand beside this one and have a command line of their own: `jink demo`.

use crate::{Problem, places};
use std::ffi::{OsStr, OsString};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

/// What is passed on as it is.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    /// Its own arguments; --help shows them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    pub arguments: Vec<OsString>,
}

/// Becomes `program`, for `command` of the user, with `arguments`: exit code and signals are then its own. In a checkout it is built
/// first. Comes back only if that fails.
pub fn become_program<A: AsRef<OsStr>>(
    command: &str,
    program: &str,
    arguments: impl IntoIterator<Item = A>,
) -> Problem {
    let folder = match places::program_folder() {
        Ok(folder) => folder,
        Err(problem) => return problem,
    };
    if let Err(problem) = build(command, program, &folder) {
        return problem;
    }
    let path = folder.join(program);
    if !path.is_file() {
        return Problem::Other(format!(
            "{command} needs {program}, which is for simulations and not in {}: build it with `cargo build --release --bin {program}`, \
             or copy it there from such a build",
            folder.display()
        ));
    }
    let error = Command::new(&path).args(arguments).exec();
    Problem::io(path.display().to_string())(error)
}

/// Where `folder` is one that cargo builds into, in a checkout: brings `program` there up to date with its sources.
fn build(command: &str, program: &str, folder: &Path) -> Result<(), Problem> {
    let is_built_into = folder.join(".fingerprint").is_dir();
    let (true, Some(workspace)) = (is_built_into, places::workspace(folder)) else {
        return Ok(());
    };
    if !folder.join(program).is_file() {
        eprintln!("{command}: {program} is built when it is called, which takes a minute or two");
    }
    let profile = match folder.file_name().and_then(OsStr::to_str) {
        Some("debug") | None => "dev",
        Some(profile) => profile,
    };
    let mut cargo = Command::new("cargo");
    cargo.args(["build", "--profile", profile, "--bin", program]);
    if folder.join(program).is_file() {
        cargo.arg("--quiet");
    }
    match cargo.current_dir(workspace).status() {
        Ok(status) if !status.success() => Err(Problem::Other(format!(
            "{command}: {program} could not be built ({status})"
        ))),
        // Without cargo the program that lies there is started.
        Ok(_) | Err(_) => Ok(()),
    }
}
