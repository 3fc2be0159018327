//! `jink replay`: a recorded flight once more.

use jink_control::{Problem, sayln};
use jink_replay::{Compared, Options, Progress, Report, replay};
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// The replay differs from the flight.
const EXIT_DIFFERS: u8 = 4;
/// How often progress is shown.
const SHOWN_EACH: Duration = Duration::from_millis(500);

/// Which flight, and what of it.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each service gets, cycle by cycle, the samples that it took in the flight, and what it publishes is compared bit by bit with what it
published then. That needs a recording from the start of the flight (docs/recordings.md), and for obstacle_fusion and collision_guard
one with the clouds of the sensors that have them.

Exit codes: 0 the same; 1 it cannot be replayed, or not to its end; 4 it differs, the first difference is shown.")]
pub struct Args {
    /// The recordings of one flight, in the order in which they were begun
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Only this process; may be given several times
    #[arg(long, value_name = "PROCESS")]
    service: Vec<String>,
    /// A program in the place of the service's own
    #[arg(long, value_name = "FILE", requires = "service")]
    program: Option<PathBuf>,
    /// Give a parameter another value than in the flight; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = param)]
    param: Vec<(String, f64)>,
    /// Services take what the others publish now, not what was recorded of them: what a change leads to
    #[arg(long)]
    chain: bool,
    /// At the pace of the flight, not as fast as it goes
    #[arg(long)]
    realtime: bool,
    /// Write a recording of the replay
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs `jink replay`.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let options = Options {
        files: args.files.clone(),
        services: args.service.clone(),
        program: args.program.clone(),
        params: args.param.clone(),
        is_chain: args.chain,
        is_realtime: args.realtime,
        out: args.out.clone(),
    };
    let is_shown = std::io::stderr().is_terminal();
    let mut shown = Instant::now();
    let report = replay(&options, &mut |progress: Progress| {
        if is_shown && shown.elapsed() >= SHOWN_EACH {
            shown = Instant::now();
            eprint!(
                "\r{:.1} s of the flight, {} cycles",
                progress.flight_s, progress.cycles
            );
            // It is only for show.
            let _unseen = std::io::stderr().flush();
        }
    });
    if is_shown {
        eprint!("\r\x1b[K");
    }
    let report = report.map_err(|error| Problem::Other(error.to_string()))?;
    match args.json {
        true => sayln!("{}", json_of(&report)),
        false => show(&report),
    }
    Ok(match report.first() {
        Some(_) => ExitCode::from(EXIT_DIFFERS),
        None if report.is_whole() => ExitCode::SUCCESS,
        None => ExitCode::FAILURE,
    })
}

fn param(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("not NAME=VALUE")?;
    let value = value.parse().map_err(|_| format!("{value:?} is no number"))?;
    Ok((name.to_owned(), value))
}

fn show(report: &Report) {
    let header = ["process", "start", "cycles", "samples", "differ", ""].map(str::to_owned);
    let rows: Vec<[String; 6]> = std::iter::once(header)
        .chain(report.instances.iter().map(|compared| {
            [
                compared.instance.process.clone(),
                compared.instance.generation.to_string(),
                compared.cycles.to_string(),
                compared.samples.to_string(),
                compared.differing.to_string(),
                compared.ends.clone().unwrap_or_default(),
            ]
        }))
        .collect();
    let mut table = String::new();
    jink_control::status::write_table(&mut table, &rows);
    sayln!("{table}");
    match report.first() {
        Some(first) => sayln!("first difference: {first}"),
        None if report.is_whole() => sayln!("every sample is the same, bit by bit"),
        None => sayln!("what could be compared is the same; not everything could"),
    }
}

fn json_of(report: &Report) -> Value {
    let of_instance = |compared: &Compared| {
        json!({
            "process": compared.instance.process,
            "start": compared.instance.generation,
            "cycles": compared.cycles,
            "samples": compared.samples,
            "differ": compared.differing,
            "first": compared.first.as_ref().map(ToString::to_string),
            "ends": compared.ends,
        })
    };
    json!({
        "flight_s": report.flight_s,
        "instances": report.instances.iter().map(of_instance).collect::<Vec<_>>(),
        "first": report.first().map(ToString::to_string),
    })
}
