//! Hands samples from process to process with zenoh, for comparison.
//!
//! It is no member of the project's workspace and has its own lock file:
//!
//! ```text
//! cargo build --release --manifest-path tests/transport_bench/zenoh/Cargo.toml
//! tests/transport_bench/zenoh/target/release/jink-transport-zenoh chain --transport zenoh-unix \
//!     --bytes 320064,393872,7456,4120,4144 --rate-hz 50 --seconds 5 --folder EMPTY_FOLDER
//! ```
//!
//! | transport | is |
//! |---|---|
//! | `zenoh-unix` | a stream socket of the file system between any two neighbours |
//! | `zenoh-tcp` | a TCP connection over the loopback interface between any two neighbours |
//! | `zenoh-shm` | shared memory, filled and read in place; where it is goes through a socket as in `zenoh-unix` |
//!
//! Neighbours are peers that know of each other from their configuration; nothing searches for others. Whoever receives listens.
//! Each end of a hop is a session of its own, so that each hop has the settings that are fastest for its size. All of zenoh's work in
//! a process is one thread's: with zenoh's own threads for sending, receiving and the rest a message wakes more of them. The
//! environment variable `ZENOH_RUNTIME` can say otherwise.
//!
//! | module | holds |
//! |---|---|
//! | `hop` | the sessions of the two ends of a hop |
//! | `incoming` | the end that messages come out of |
//! | `outgoing` | the ends that messages go into |

mod hop;
mod incoming;
mod outgoing;

use hop::Kind;
use jink_transport_chain::program::{self, Ends};
use jink_transport_chain::{Fault, StageArgs};
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

/// Where zenoh reads which threads it is to have.
const RUNTIME: &str = "ZENOH_RUNTIME";
/// One for everything.
const ONE_THREAD: &str = "(rx: (handover: app), tx: (handover: app), acc: (handover: app), net: (handover: app), \
    app: (worker_threads: 1))";

fn main() -> ExitCode {
    if std::env::var_os(RUNTIME).is_none() {
        // The same again with the variable, for this process and those that it starts.
        let fault = again();
        eprintln!("{fault}");
        return ExitCode::FAILURE;
    }
    let code = program::run(&Kind::NAMES, open);
    // The memory of a process that had to be killed.
    zenoh::shm::cleanup_orphaned_shm_segments();
    code
}

/// Starts this program anew in this process. Comes back only with why it cannot.
fn again() -> Fault {
    match std::env::current_exe() {
        Ok(program) => Command::new(program)
            .args(std::env::args_os().skip(1))
            .env(RUNTIME, ONE_THREAD)
            .exec()
            .into(),
        Err(error) => error.into(),
    }
}

fn open(args: &StageArgs) -> Result<Ends, Fault> {
    let kind = Kind::of(&args.transport)?;
    let mut ends: Ends = (None, None);
    // The incoming end first: it is waited for.
    if let (Some(hop), Some(bytes)) = (args.place.checked_sub(1), args.bytes_in()) {
        ends.0 = Some(Box::new(incoming::Subscription::new(args, kind, hop, bytes)?));
    }
    if let Some(bytes) = args.bytes_out() {
        ends.1 = Some(match kind {
            Kind::Unix | Kind::Tcp => Box::new(outgoing::Sockets::new(args, kind, bytes)?),
            Kind::Memory => Box::new(outgoing::Memory::new(args, bytes)?),
        });
    }
    Ok(ends)
}
