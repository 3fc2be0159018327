//! Programs that stand beside this one and have a command line of their own: `jink demo`.

use crate::{Problem, places};
use std::ffi::{OsStr, OsString};
use std::os::unix::process::CommandExt;
use std::process::Command;

/// What is passed on as it is.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    /// Its own arguments; --help shows them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    pub arguments: Vec<OsString>,
}

/// Becomes `program`, for `command` of the user, with `arguments`: exit code and signals are then its own. Comes back only if that
/// fails.
pub fn become_program<A: AsRef<OsStr>>(
    command: &str,
    program: &str,
    arguments: impl IntoIterator<Item = A>,
) -> Problem {
    let folder = match places::program_folder() {
        Ok(folder) => folder,
        Err(problem) => return problem,
    };
    let path = folder.join(program);
    if !path.is_file() {
        return Problem::Other(format!(
            "{command} needs {program}, which is for simulations and not in {}: build it with `cargo build --release --workspace \
             --bins`, or copy it there from such a build",
            folder.display()
        ));
    }
    let error = Command::new(&path).args(arguments).exec();
    Problem::io(path.display().to_string())(error)
}
