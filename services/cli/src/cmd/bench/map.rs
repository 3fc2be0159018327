//! `jink bench map`: services depend on no other service, so a program of its own measures them.

use crate::cmd::{Problem, places};
use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// How to measure: `jink bench map --help`.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    /// Arguments of the program that measures
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<OsString>,
}

/// Becomes the program that measures.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    const PROGRAM: &str = "jink-map-bench";
    let mut command = Command::new(places::program(&places::program_folder()?, PROGRAM)?);
    Err(Problem::io(PROGRAM)(command.args(&args.arguments).exec()))
}
