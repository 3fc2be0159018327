//! `jink lidar dump`.
//!
//! Formats of lidars belong to their driver: this command starts its program as a tool.

use jink_control::{Problem, places};
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// What to do with recordings of lidars.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Debug, clap::Subcommand)]
enum Subcommand {
    /// Write every return of a recording (pcap, pcapng) as a line: scan,row,column,range_m,x_m,y_m,z_m in the sensor frame
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
    const PROGRAM: &str = "jink-lidar-driver";
    let Subcommand::Dump {
        pcap,
        metadata,
        model,
        csv,
    } = &args.command;
    let mut command = Command::new(places::program(&places::program_folder()?, PROGRAM)?);
    command.arg("dump").arg("--pcap").arg(pcap).arg("--csv").arg(csv);
    if let Some(metadata) = metadata {
        command.arg("--metadata").arg(metadata);
    }
    if let Some(model) = model {
        command.args(["--model", model]);
    }
    let status = command.status().map_err(Problem::io(PROGRAM))?;
    let code = status.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.map_or(ExitCode::FAILURE, ExitCode::from))
}
