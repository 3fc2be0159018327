//! Programs that stand beside `jink` and have a command line of their own: `jink campaign`.

use super::{Problem, places};
use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// What is passed on as it is.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    /// Its own arguments; --help shows them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<OsString>,
}

/// Becomes `program`.
pub fn run(program: &str, args: &Args) -> Result<ExitCode, Problem> {
    let path = places::program(&places::program_folder()?, program)?;
    let error = Command::new(&path).args(&args.arguments).exec();
    Err(Problem::io(path.display().to_string())(error))
}
