//! Which autopilot flies a simulated vehicle: an emulated one, or somebody's build of a real one.

use super::{Problem, places};
use jink_cli::sitl::{Choice, Description, Wind};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The options of `jink up --world` and `jink demo`.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Autopilot of the simulated vehicle")]
pub struct Args {
    /// Whose autopilot: px4, px4_current (as emulated: PX4 without the trajectory interface), ardupilot
    #[arg(long, value_name = "NAME", value_parser = ["px4", "px4_current", "ardupilot"])]
    autopilot: Option<String>,
    /// A real one in simulation instead of an emulated one: source folder with a build for SITL, or the build folder
    #[arg(long, value_name = "DIR")]
    sitl: Option<PathBuf>,
    /// How it is simulated [default: the best the build offers]: hil, sih (PX4), json (ArduPilot)
    #[arg(long, value_name = "NAME", requires = "sitl", value_parser = ["hil", "sih", "json"])]
    sitl_interface: Option<String>,
    /// Its instance number, 0 to 9 [default: the first one whose ports are free]
    #[arg(long, value_name = "N", requires = "sitl", value_parser = clap::value_parser!(u8).range(0..=9))]
    sitl_instance: Option<u8>,
    /// Parameter it starts with, over its defaults and those jink's profile needs (repeatable)
    #[arg(long = "sitl-param", value_name = "NAME=NUMBER", requires = "sitl")]
    sitl_parameters: Vec<String>,
    /// Its working folder, kept afterwards with its logs [default: a temporary one]
    #[arg(long, value_name = "DIR", requires = "sitl")]
    sitl_folder: Option<PathBuf>,
    /// Wind in m/s, where the air moves to, and the standard deviation of its gusts
    #[arg(long, value_name = "NORTH,EAST[,GUST]", allow_hyphen_values = true)]
    wind: Option<Wind>,
}

impl Args {
    /// Whether anything was asked for.
    pub fn is_given(&self) -> bool {
        self.autopilot.is_some() || self.sitl.is_some() || self.wind.is_some()
    }

    /// Whether a real autopilot flies.
    pub fn is_sitl(&self) -> bool {
        self.sitl.is_some()
    }

    /// What a person wants to know about the build that was found; `None` for an emulated autopilot.
    pub fn describe(&self, programs: &Path) -> Result<Option<Description>, Problem> {
        let Some(folder) = &self.sitl else {
            return Ok(None);
        };
        let answer = Command::new(places::program(programs, "jink-simulator")?)
            .arg("sitl")
            .arg("--json")
            .arg(folder)
            .output()
            .map_err(Problem::io("jink-simulator"))?;
        if !answer.status.success() {
            let words = String::from_utf8_lossy(&answer.stderr);
            let words = words.trim().trim_start_matches("jink-simulator sitl: ");
            return Err(Problem::Other(words.to_owned()));
        }
        let description = serde_json::from_slice(&answer.stdout).map_err(|error| {
            Problem::Other(format!("the description of the build is not understood: {error}"))
        })?;
        Ok(Some(description))
    }

    /// What is laid over the configuration, before the user's own `overrides`; `description` as [`Args::describe`] gave it.
    pub fn overrides(
        &self,
        description: Option<&Description>,
        profile_is_given: bool,
        overrides: &[String],
    ) -> Result<Vec<String>, Problem> {
        let absolute =
            |path: &PathBuf| std::path::absolute(path).map_err(Problem::io(path.display().to_string()));
        let choice = Choice {
            autopilot: self.autopilot.as_deref(),
            sitl: self.sitl.as_ref().map(absolute).transpose()?,
            interface: self.sitl_interface.as_deref(),
            instance: self.sitl_instance,
            parameters: &self.sitl_parameters,
            folder: self.sitl_folder.as_ref().map(absolute).transpose()?,
            wind: self.wind,
        };
        choice
            .overrides(description, profile_is_given, overrides)
            .map_err(Problem::Other)
    }
}
