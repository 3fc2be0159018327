//! `jink report`: a recorded flight as one page.

use jink_control::{Problem, sayln};
use jink_report::{AutopilotLog, Flight};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Which flight.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page opens in any browser, without a network. A recording without clouds is enough (docs/reports.md).

Exit codes: 0 written; 1 the file is no recording of jink, or of another layout, or the page cannot be written.")]
pub struct Args {
    /// The recordings of one flight, in the order in which they were begun
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Lay the autopilot's own log over it: a ULog of PX4 (.ulg) or a DataFlash log of ArduPilot (.bin)
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Where the page goes; without it beside the first recording, as .html
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

/// Runs `jink report`.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let other = |error: jink_report::ReportError| Problem::Other(error.to_string());
    let log = match &args.log {
        Some(file) => Some((file, AutopilotLog::read(file).map_err(other)?)),
        None => None,
    };
    let is_shown = std::io::stderr().is_terminal();
    let mut shown = 0;
    let flight = Flight::read(&args.files, &mut |read, total| {
        let percent = 100 * read / total.max(1);
        if is_shown && percent > shown {
            shown = percent;
            eprint!("\r{percent} % read");
            // It is only for show.
            let _unseen = std::io::stderr().flush();
        }
    });
    if is_shown {
        eprint!("\r\x1b[K");
    }
    let mut flight = flight.map_err(other)?;
    if let Some((file, log)) = log {
        flight.lay_over(file, log).map_err(other)?;
    }
    let beside = || args.files[0].with_extension("html");
    let out = args.out.clone().unwrap_or_else(beside);
    if args.files.contains(&out) || args.log.as_ref() == Some(&out) {
        return Err(Problem::Other(format!(
            "{}: is read, and would be written over",
            out.display()
        )));
    }
    // A page that could not be written whole leaves the one before.
    let unfinished = out.with_extension("html.new");
    let written =
        std::fs::write(&unfinished, flight.page()).and_then(|()| std::fs::rename(&unfinished, &out));
    if written.is_err() {
        let _not_there = std::fs::remove_file(&unfinished);
    }
    written.map_err(Problem::io(out.display().to_string()))?;
    sayln!("{}", out.display());
    Ok(ExitCode::SUCCESS)
}
