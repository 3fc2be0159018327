//! The command line of a program that measures transports.
//!
//! | command | |
//! |---|---|
//! | `list` | prints the names of its transports, one JSON array |
//! | `chain ...` | measures one of them, prints a [`Round`](crate::Round) as one JSON object |
//! | `stage ...` | is one process of it |

use crate::stage::{self, Incoming, Outgoing};
use crate::{Chain, Fault, StageArgs};
use clap::{Parser, Subcommand};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

/// Hands samples from process to process, for `jink bench transport`
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Print the names of the transports as one JSON array
    List,
    /// Measure one of them; prints one JSON object
    Chain(Chain),
    /// Be one process of a chain
    Stage(StageArgs),
}

/// The ends of the hops of one process.
pub type Ends = (Option<Box<dyn Incoming>>, Option<Box<dyn Outgoing>>);

/// The `main` of a program with these transports, whose processes open their hops with `open`.
pub fn run(transports: &[&str], open: impl Fn(&StageArgs) -> Result<Ends, Fault>) -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::List => serde_json::to_string(transports)
            .map(|json| println!("{json}"))
            .map_err(Fault::from),
        Command::Chain(chain) => own_chain(&chain),
        Command::Stage(args) => own_stage(&args, open),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("{fault}");
            ExitCode::FAILURE
        }
    }
}

fn own_chain(chain: &Chain) -> Result<(), Fault> {
    let stop = stage::prepare(None)?;
    let program = std::env::current_exe()?;
    let round = chain.measure(|place| chain.stage_command(&program, place), &|| {
        stop.load(Ordering::Relaxed)
    })?;
    println!("{}", serde_json::to_string(&round)?);
    Ok(())
}

/// Is one process of a chain.
///
/// # Errors
/// Those of `open` and of the transport.
pub fn own_stage(args: &StageArgs, open: impl Fn(&StageArgs) -> Result<Ends, Fault>) -> Result<(), Fault> {
    let stop = stage::prepare(args.core)?;
    let (incoming, outgoing) = open(args)?;
    stage::run(args, &stop, incoming, outgoing)
}
