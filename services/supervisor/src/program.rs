//! `jink-supervisor`: one per instance; starts the processes of the table and keeps them running.
//!
//! Exit codes: 0 stopped on request (or nothing to sweep), 70 a process was given up whose row says that the system
//! then stops, 78 the system cannot start: wrong configuration, another supervisor holds the instance, a process cannot
//! start.
//!
//! The supervisor holds no flight data and its children do not depend on it: they write their logs to files, not into a
//! pipe, so that a supervisor that is killed or stopped neither blocks nor ends anybody. After `kill -9` of the
//! supervisor they fly on unsupervised; the next supervisor of the instance adopts them, and
//! `jink-supervisor --sweep` (which `jink down` uses) ends them.

mod args;
mod host;

use args::Args;
use clap::Parser;
use std::process::ExitCode;

/// Runs the supervisor that the command line asks for.
pub fn main() -> ExitCode {
    let args = Args::parse();
    jink_runtime::descriptors::reserve();
    jink_runtime::logging::init("supervisor", args.log);
    if args.fingerprint {
        println!("{:016x}", jink_shared_types::topics::FINGERPRINT);
        return ExitCode::SUCCESS;
    }
    if args.sweep {
        host::sweep(&args.instance)
    } else {
        host::run(&args)
    }
}
