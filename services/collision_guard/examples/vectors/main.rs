//! Reference vectors of PX4's collision prevention against ours: prints a report for each family; exit code 1 if a
//! scenario fails, 2 if it cannot be run.
//!
//! `cargo run --release -p jink-collision-guard --example vectors -- DIR`

mod bezier;
mod map;
mod oracle;
mod replay;
mod report;
mod run;
mod schema;
mod setpoint;
mod units;

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(directory) = std::env::args_os().nth(1) else {
        eprintln!("usage: vectors DIR, a directory of .jsonl files with scenarios");
        return ExitCode::from(2);
    };
    match run::run(Path::new(&directory)) {
        Ok(report) => {
            println!("{report}");
            println!("{} scenarios, {} failing", report.scenarios(), report.failing());
            ExitCode::from(u8::from(report.failing() > 0))
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}
