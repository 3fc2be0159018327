//! `jink lidar dump`.

use jink_control::Problem;
use jink_lidar_driver::dump::{self, DumpRequest};
use std::path::PathBuf;
use std::process::ExitCode;

/// What to do with recordings of lidars.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Debug, clap::Subcommand)]
enum Subcommand {
    /// Write every return of a recording (pcap, pcapng) as a line: scan,row,column,range_m,x_m,y_m,z_m in the sensor frame
    #[command(
        after_help = "Exit codes: 0 written; 1 the recording, or what belongs to it, is of no use; 2 wrong usage."
    )]
    Dump {
        /// The recording
        #[arg(long, value_name = "FILE")]
        pcap: PathBuf,
        /// Metadata of an Ouster sensor: the JSON file beside the recording, or of http://SENSOR/api/v1/sensor/metadata
        #[arg(long, value_name = "FILE")]
        metadata: Option<PathBuf>,
        /// ouster, vlp16, vlp16_hires, livox_mid360, livox_avia; guessed from metadata or packets without
        #[arg(long)]
        model: Option<String>,
        /// Where the table goes
        #[arg(long, value_name = "FILE")]
        csv: PathBuf,
    },
}

/// Runs the tool.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let Subcommand::Dump {
        pcap,
        metadata,
        model,
        csv,
    } = &args.command;
    Ok(dump::run(&DumpRequest {
        pcap: pcap.clone(),
        metadata: metadata.clone(),
        model: model.clone(),
        csv: csv.clone(),
    }))
}
