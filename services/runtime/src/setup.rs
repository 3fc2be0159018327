//! What a service is started with, and why it could not be.

use crate::config::ConfigError;
use crate::instance::Instance;
use crate::open_error::OpenError;
use clap::{CommandFactory, FromArgMatches, Parser};
use jink_shared_types::topics::FINGERPRINT;
use std::ffi::OsString;
use std::fmt;
use std::num::ParseIntError;
use std::path::PathBuf;

/// What the supervisor passes to a process when it starts it.
#[derive(Clone, Debug, Parser)]
#[command(
    about = "A jink service. It is started by jink-supervisor; by hand only for tests.",
    version
)]
pub struct Setup {
    /// Name of the process in the process table
    #[arg(long)]
    pub process: String,
    /// Instance to join
    #[arg(long, default_value = "default")]
    pub instance: Instance,
    /// Program that the row of the process table is for; another one refuses to start
    #[arg(long)]
    pub program: Option<String>,
    /// Fingerprint of the topics that the supervisor knows; a build with others refuses to start
    #[arg(long, value_parser = fingerprint)]
    pub topics: Option<u64>,
    /// Folder with jink.toml
    #[arg(long, default_value = "config")]
    pub config: PathBuf,
    /// Which start of this process it is
    #[arg(long, default_value_t = 1)]
    pub generation: u32,
    /// Cycle budget (us), 0 = none
    #[arg(long, default_value_t = 0)]
    pub budget_us: u32,
    /// Oldest range data behind an output (us), 0 = any
    #[arg(long, default_value_t = 0)]
    pub end_to_end_us: u32,
    /// Compute, but publish nothing before the control record says so
    #[arg(long)]
    pub shadow: bool,
    /// SCHED_FIFO priority, 0 = ordinary scheduling
    #[arg(long, default_value_t = 0)]
    pub priority: u8,
    /// Core to stay on
    #[arg(long)]
    pub core: Option<usize>,
    /// Keep all pages in memory
    #[arg(long)]
    pub lock_memory: bool,
    /// Log level: error, warn, info, debug, trace
    #[arg(long, default_value = "info")]
    pub log: tracing::Level,
    /// Socket of a scheduler with which the process runs in lock-step, instead of shared memory
    #[arg(long)]
    pub lockstep: Option<PathBuf>,
    /// Arguments of this kind of service
    #[arg(last = true)]
    pub arguments: Vec<String>,
    /// Its process id; in a simulation within one process a number of its own.
    #[arg(skip = std::process::id())]
    pub pid: u32,
}

impl Setup {
    /// What a command line says, the program's name first.
    ///
    /// # Errors
    /// [`StartError::Needs`] with what is wrong with it.
    pub fn of_command_line(line: impl IntoIterator<Item = OsString>) -> Result<Self, StartError> {
        Self::try_parse_from(line).map_err(|error| StartError::Needs {
            what: "the command line".to_owned(),
            cause: error.to_string(),
        })
    }

    /// Whether this build of `program` is what the process table wants to be started.
    ///
    /// # Errors
    /// [`StartError::Needs`] if the row is another program's, or the topics differ.
    pub(crate) fn wants(&self, program: &str) -> Result<(), StartError> {
        let refused = |what: &str, cause: String| {
            Err(StartError::Needs {
                what: what.to_owned(),
                cause,
            })
        };
        match (&self.program, self.topics) {
            (Some(wanted), _) if wanted != program => refused(
                "another program",
                format!("the process {} is one of {wanted}", self.process),
            ),
            (_, Some(topics)) if topics != FINGERPRINT => refused(
                "other topics",
                format!("its layouts differ ({FINGERPRINT:016x}, the supervisor's are {topics:016x})"),
            ),
            _ => Ok(()),
        }
    }

    /// The name behind `--sensor`, the only argument of a sensor's driver.
    ///
    /// # Errors
    /// [`StartError::Needs`] if it is not that.
    pub fn sensor_name(&self) -> Result<String, StartError> {
        match self.arguments.as_slice() {
            [option, name] if option == "--sensor" => Ok(name.clone()),
            arguments => Err(StartError::Needs {
                what: "--sensor NAME".to_owned(),
                cause: format!("the arguments are {arguments:?}"),
            }),
        }
    }

    /// The command line of the program called `name`.
    pub(crate) fn try_parse_as(name: &str) -> Result<Self, clap::Error> {
        let command = Self::command().display_name(name).bin_name(name);
        let matches = command.try_get_matches()?;
        Self::from_arg_matches(&matches)
    }
}

/// A fingerprint of topics as it is written on command lines.
fn fingerprint(text: &str) -> Result<u64, ParseIntError> {
    u64::from_str_radix(text, 16)
}

/// Why a service could not start.
#[derive(Debug)]
pub enum StartError {
    /// A topic could not be opened.
    Topic(OpenError),
    /// The configuration is wrong.
    Config(ConfigError),
    /// Something else the service needs is not to be had.
    Needs {
        /// What it needs.
        what: String,
        /// Why it is not there.
        cause: String,
    },
}

impl StartError {
    /// Whether another start may succeed at once: a place was taken that somebody will leave.
    pub fn passes(&self) -> bool {
        matches!(self, Self::Topic(OpenError::Taken { .. }))
    }
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Topic(error) => write!(f, "{error}"),
            Self::Config(error) => write!(f, "{error}"),
            Self::Needs { what, cause } => write!(f, "{what}: {cause}"),
        }
    }
}
impl std::error::Error for StartError {}
impl From<OpenError> for StartError {
    fn from(error: OpenError) -> Self {
        Self::Topic(error)
    }
}
impl From<ConfigError> for StartError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

#[cfg(test)]
mod tests {
    use super::Setup;
    use clap::Parser;
    use jink_shared_types::topics::FINGERPRINT;

    #[test]
    fn a_program_starts_only_in_a_row_of_its_own_and_with_the_topics_of_the_supervisor() {
        let own = format!("{FINGERPRINT:016x}");
        let other = format!("{:016x}", FINGERPRINT ^ 1);
        let started = |more: &[&str]| {
            let line = ["jink", "--process", "front"].iter().chain(more);
            let setup = Setup::try_parse_from(line).unwrap();
            setup.wants("lidar_driver").map_err(|error| error.to_string())
        };
        assert_eq!(started(&[]), Ok(()), "by hand");
        assert_eq!(started(&["--program", "lidar_driver", "--topics", &own]), Ok(()));
        let another = started(&["--program", "depth_driver", "--topics", &own]);
        assert_eq!(
            another.unwrap_err(),
            "another program: the process front is one of depth_driver"
        );
        let differs = started(&["--program", "lidar_driver", "--topics", &other]).unwrap_err();
        assert!(
            differs.contains("its layouts differ") && differs.contains(&other),
            "{differs}"
        );
    }
}
