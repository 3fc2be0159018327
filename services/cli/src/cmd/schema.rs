//! `jink schema`: what the topics say, for people and for programs in other languages.

use jink_cli::view::schema::{self, Schema};
use jink_control::Problem;
use jink_control::say;
use std::process::ExitCode;

/// What to show, and how.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Exit codes: 0 shown; 1 no topic has such a payload.")]
pub struct Args {
    /// Payloads to show, e.g. VehicleState Route (default: those of every topic)
    #[arg(value_name = "TYPE")]
    types: Vec<String>,
    /// A C11 header instead of a table
    #[arg(long, group = "language")]
    c: bool,
    /// A Python module instead of a table
    #[arg(long, group = "language")]
    python: bool,
    /// One JSON object instead of a table
    #[arg(long, group = "language")]
    json: bool,
}

/// Runs `jink schema`.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let schema = Schema::of(&args.types).map_err(|unknown| Problem::Other(unknown.to_string()))?;
    let text = match (args.c, args.python, args.json) {
        (true, ..) => schema::header(&schema),
        (_, true, _) => schema::module(&schema),
        (.., true) => schema::json(&schema),
        _ => schema::table(&schema),
    };
    say!("{text}");
    Ok(ExitCode::SUCCESS)
}
