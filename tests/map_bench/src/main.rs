//! `jink-map-bench`, behind `jink bench map`: the map measured beside OctoMap, with the same clouds and poses, in one run.
//!
//! | module | holds |
//! |---|---|
//! | [`flight`] | the line that is flown |
//! | [`clouds`], [`recording`] | clouds along it, and out of a recording |
//! | [`rays`] | their rays in the local frame |
//! | [`jink`] | jink's map, measured by stage |
//! | [`octomap`] | OctoMap, measured |
//! | [`agreement`] | both compared cell by cell |
//! | [`report`] | the tables |

mod agreement;
mod clouds;
mod flight;
mod jink;
mod octomap;
mod rays;
mod recording;
mod report;

use clap::Parser;
use clouds::{SOURCES, Series};
use jink_control::provenance;
use jink_shared_types::params::ParamSet;
use octomap::OctoMap;
use report::{Head, Row};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Measure the map beside OctoMap
#[derive(Debug, Parser)]
#[command(name = "jink bench map", bin_name = "jink bench map")]
struct Args {
    /// One JSON object instead of the tables
    #[arg(long)]
    json: bool,
    /// Flown time (s)
    #[arg(long, default_value_t = 2.0, value_parser = seconds)]
    seconds: f64,
    /// Maps that every cloud is entered into, one after the other
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    repeats: u32,
    /// Seed of the forest and of the sensors' noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only these clouds, separated by commas: 20k, 100k, 200k, mid360, os0, os1, vlp16, d435, 2048x128; all without
    #[arg(long, value_delimiter = ',', value_parser = clap::builder::PossibleValuesParser::new(SOURCES.map(|(name, _)| name)))]
    clouds: Vec<String>,
    /// Also the scans of this recording of an Ouster (pcap, pcapng)
    #[arg(long, value_name = "FILE", requires = "metadata")]
    pcap: Option<PathBuf>,
    /// Its metadata: the JSON file beside the recording
    #[arg(long, value_name = "FILE", requires = "pcap")]
    metadata: Option<PathBuf>,
    /// Without OctoMap
    #[arg(long)]
    no_octomap: bool,
}

/// A flight is as long as the forest at most; the error of a longer one names the limit.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number of seconds".to_owned())?;
    if (0.3..=60.0).contains(&seconds) {
        Ok(seconds)
    } else {
        Err("not within 0.3 to 60 s".to_owned())
    }
}

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(text) => {
            use std::io::Write as _;
            // Somebody who reads no further (`| head`) is no reason to fail.
            let _nobody_reads = std::io::stdout().write_all(text.as_bytes());
            ExitCode::SUCCESS
        }
        Err(problem) => {
            eprintln!("jink: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<String, String> {
    let params = ParamSet::default();
    let octomap = if args.no_octomap {
        Err("not asked for".to_owned())
    } else {
        OctoMap::compile()
    };
    let head = Head {
        seed: args.seed,
        seconds: args.seconds,
        repeats: args.repeats,
        commit: provenance::commit(Path::new(env!("CARGO_MANIFEST_DIR"))),
        cpu: provenance::cpu(),
        no_octomap: octomap.as_ref().err().cloned(),
    };
    let mut rows = Vec::new();
    for (name, source) in SOURCES {
        if args.clouds.is_empty() || args.clouds.iter().any(|asked| asked == name) {
            // Minutes pass: each of them says that it goes on.
            eprintln!("{name} ...");
            let series = clouds::series(name, source, args.seed, args.seconds)?;
            rows.push(measured(&series, &params, args.repeats, octomap.as_ref().ok())?);
        }
    }
    if let (Some(pcap), Some(metadata)) = (&args.pcap, &args.metadata) {
        let series = recording::series(pcap, metadata)?;
        rows.push(measured(&series, &params, args.repeats, octomap.as_ref().ok())?);
    }
    Ok(if args.json {
        format!("{}\n", report::json(&head, &rows))
    } else {
        report::text(&head, &rows)
    })
}

fn measured(
    series: &Series,
    params: &ParamSet,
    repeats: u32,
    octomap: Option<&OctoMap>,
) -> Result<Row, String> {
    let run = jink::run(series, params, repeats);
    let there = match octomap {
        Some(octomap) => Some(octomap.run(series, params, run.map.min_cell)?),
        None => None,
    };
    let agreement = there
        .as_ref()
        .map(|there| agreement::compare(series, params, &run.map, &run.windows, &there.cells));
    let points: usize = series.shots.iter().map(|shot| shot.cloud.points().len()).sum();
    let scans = series.shots.len().div_ceil(series.clouds_per_scan).max(1);
    Ok(Row::new(
        &series.name,
        points as f64 / scans as f64,
        series.clouds_per_scan,
        &run,
        there.as_ref(),
        agreement,
    ))
}
