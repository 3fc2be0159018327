//! Hands samples from process to process with dora, for comparison.
//!
//! It is no member of the project's workspace and has its own lock file. Its processes are the nodes of a dataflow, which dora's own
//! command starts; that one has to have the version of the crate `dora-node-api` here:
//!
//! ```text
//! python3 -m venv /tmp/dora && /tmp/dora/bin/pip install dora-rs-cli==1.1.0
//! cargo build --release --manifest-path tests/transport_bench/dora/Cargo.toml
//! DORA=/tmp/dora/bin/dora tests/transport_bench/dora/target/release/jink-transport-dora chain --transport dora \
//!     --bytes 320064,393872,7456,4120,4144 --rate-hz 50 --seconds 5 --folder EMPTY_FOLDER
//! ```
//!
//! Without the environment variable `DORA` it is the `dora` of the search path. `dora run` needs neither a coordinator nor a daemon
//! that runs already, and leaves none behind.
//!
//! Dora puts messages of 4096 bytes and more into shared memory, which is filled and read in place; where it is goes through a TCP
//! connection between the two nodes. Besides, a node reports each message that it sends to dora. The processor time of the process
//! that is notified, `dora run`, is that of the chain too. What dora is built on, zenoh, has one thread in each process, with which
//! messages are faster than with the six that it has otherwise; the environment variable `ZENOH_RUNTIME` can say otherwise.
//!
//! | module | holds |
//! |---|---|
//! | `dataflow` | `dora run`, started, watched and ended |
//! | `node` | the ends of the hops of one process |

mod dataflow;
mod node;

use clap::{Parser, Subcommand};
use jink_transport_chain::{Chain, Fault, StageArgs, program, stage};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

/// Names of the transports.
const TRANSPORTS: [&str; 1] = ["dora"];

/// Hands samples from process to process with dora, for `jink bench transport`
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
    /// Be one process of a chain; only dora can start it
    Stage(StageArgs),
    /// Become `dora run`, which ends with who started it
    #[command(hide = true)]
    Run {
        /// What it runs
        dataflow: PathBuf,
    },
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::List => serde_json::to_string(&TRANSPORTS)
            .map(|json| println!("{json}"))
            .map_err(Fault::from),
        Command::Chain(chain) => own_chain(&chain),
        Command::Stage(args) => known(&args.transport).and_then(|()| program::own_stage(&args, node::open)),
        Command::Run { dataflow } => dataflow::become_dora(&dataflow),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("{fault}");
            ExitCode::FAILURE
        }
    }
}

/// An error if there is no such transport.
fn known(transport: &str) -> Result<(), Fault> {
    if TRANSPORTS.contains(&transport) {
        return Ok(());
    }
    Err(format!(
        "no transport {transport} here; there is {}",
        TRANSPORTS.join(", ")
    )
    .into())
}

fn own_chain(chain: &Chain) -> Result<(), Fault> {
    known(&chain.transport)?;
    let stop = stage::prepare(None)?;
    let outcome = dataflow::measure(chain, &|| stop.load(Ordering::Relaxed));
    // Dora leaves some.
    zenoh::shm::cleanup_orphaned_shm_segments();
    let round = outcome?;
    println!("{}", serde_json::to_string(&round)?);
    Ok(())
}
