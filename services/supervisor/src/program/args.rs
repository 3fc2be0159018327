//! The command line.

use crate::table::Mode;
use clap::Parser;
use jink_runtime::Instance;
use std::path::PathBuf;

/// Starts, watches and restarts the processes of one jink instance
#[derive(Clone, Debug, Parser)]
#[command(version)]
pub struct Args {
    /// Instance to run; its folder is /dev/shm/jink_INSTANCE
    #[arg(long, default_value = "default")]
    pub instance: Instance,
    /// Folder with jink.toml, services.toml and profiles/
    #[arg(long, default_value = "config")]
    pub config: PathBuf,
    /// Profile laid over jink.toml: profiles/PROFILE.toml
    #[arg(long)]
    pub profile: Option<String>,
    /// Set of sensors instead of those of jink.toml: its name, several with a plus between them, or FILE.toml
    #[arg(long)]
    pub sensors: Option<String>,
    /// Value laid over the configuration, e.g. link.address=udpin:0.0.0.0:14540 (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub overrides: Vec<String>,
    /// What flies: real, virtual_world (external autopilot, rendered sensors) or simulated_vehicle
    #[arg(long, default_value = "real", value_parser = mode)]
    pub mode: Mode,
    /// Log level: error, warn, info, debug, trace
    #[arg(long, default_value = "info")]
    pub log: tracing::Level,
    /// Write the log to the instance's log folder instead of standard error
    #[arg(long)]
    pub log_to_file: bool,
    /// Keep the logs after the stop even if nothing went wrong
    #[arg(long)]
    pub keep_logs: bool,
    /// End what a killed supervisor of this instance left running, remove its memory, and leave
    #[arg(long)]
    pub sweep: bool,
    /// Print a number that two builds have in common if they can talk to each other, and leave
    #[arg(long)]
    pub fingerprint: bool,
}

fn mode(text: &str) -> Result<Mode, String> {
    let known = Mode::NAMES.iter().find(|(name, _)| *name == text);
    known.map(|(_, mode)| *mode).ok_or_else(|| {
        let names = Mode::NAMES.map(|(name, _)| name);
        format!("use one of {}", names.join(", "))
    })
}
