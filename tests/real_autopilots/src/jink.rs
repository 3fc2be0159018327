//! The jink that flies: the real programs, in an instance of its own.

use serde_json::Value;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What a shell says of a program that Ctrl-C has ended.
const INTERRUPTED: i32 = 130;

/// Name of the instance that flies beside the autopilot of that number.
pub fn instance_name(autopilot: u16) -> String {
    format!("real_{}_{autopilot}", std::process::id())
}

/// On Ctrl-C, SIGTERM and SIGHUP takes down what flies beside these autopilots, and ends this process. The autopilots end with it.
///
/// # Errors
/// Signals cannot be watched.
pub fn end_with_us(
    programs: &Path,
    autopilots: impl Iterator<Item = u16> + Send + 'static,
) -> std::io::Result<()> {
    let (mut read, write) = UnixStream::pair()?;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
    }
    let programs = programs.to_owned();
    std::thread::spawn(move || {
        let _end = read.read(&mut [0]);
        eprintln!("stopped; what flies is taken down");
        for autopilot in autopilots {
            let _reported = operate(&programs, &instance_name(autopilot)).arg("down").output();
        }
        std::process::exit(INTERRUPTED);
    });
    Ok(())
}

/// `jink` for one instance.
fn operate(programs: &Path, instance: &str) -> Command {
    let mut command = Command::new(programs.join("jink"));
    command.args(["--instance", instance]).stdin(Stdio::null());
    command
}

/// What to fly with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder of the programs.
    pub programs: PathBuf,
    /// Configuration folder.
    pub config: PathBuf,
    /// Name of the instance.
    pub instance: String,
    /// Where it waits for the autopilot.
    pub port: u16,
    /// The virtual world that its sensors see.
    pub world: &'static str,
    /// Its seed.
    pub seed: u64,
    /// `section.key=value`.
    pub overrides: Vec<String>,
}

/// A jink; it is taken down with this.
#[derive(Debug)]
pub struct Jink {
    options: Options,
    is_up: bool,
}

impl Jink {
    /// Not up yet.
    pub fn new(options: Options) -> Self {
        Self {
            options,
            is_up: false,
        }
    }

    /// `jink up`; returns once it is ready or waits for somebody else.
    ///
    /// # Errors
    /// What it said.
    pub fn up(&mut self) -> Result<(), String> {
        let link = format!("udpin:127.0.0.1:{}", self.options.port);
        let seed = self.options.seed.to_string();
        let mut command = self.command(&[
            "up",
            "--detach",
            "--link",
            &link,
            "--world",
            self.options.world,
            "--seed",
            &seed,
        ]);
        command.arg("--config").arg(&self.options.config);
        for text in &self.options.overrides {
            command.args(["--set", text]);
        }
        self.is_up = true;
        let output = command
            .output()
            .map_err(|error| format!("jink cannot be started: {error}"))?;
        if output.status.success() {
            return Ok(());
        }
        Err(format!(
            "jink up: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        ))
    }

    /// `jink down`.
    pub fn down(&mut self) {
        if std::mem::take(&mut self.is_up) {
            let _reported = self.command(&["down"]).output();
        }
    }

    /// What `jink status --json` says; null if it says nothing.
    pub fn status(&self) -> Value {
        let output = self.command(&["status", "--json"]).output();
        output
            .ok()
            .and_then(|output| serde_json::from_slice(&output.stdout).ok())
            .unwrap_or(Value::Null)
    }

    /// Kills a service as the kernel would: without a word. Whether there was one.
    pub fn kill(&self, service: &str) -> bool {
        let status = self.status();
        let services = status["services"].as_array().cloned().unwrap_or_default();
        let pid = services
            .iter()
            .find(|row| row["name"] == service)
            .and_then(|row| row["pid"].as_i64());
        let pid = pid
            .and_then(|pid| i32::try_from(pid).ok())
            .and_then(rustix::process::Pid::from_raw);
        pid.is_some_and(|pid| rustix::process::kill_process(pid, rustix::process::Signal::KILL).is_ok())
    }

    /// Restarts of all services since it came up.
    pub fn restarts(&self) -> u64 {
        let status = self.status();
        let services = status["services"].as_array().cloned().unwrap_or_default();
        services.iter().filter_map(|row| row["restarts"].as_u64()).sum()
    }

    /// Where its processes write.
    pub fn log_folder(&self) -> PathBuf {
        Path::new("/dev/shm")
            .join(format!("jink_{}", self.options.instance))
            .join("log")
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = operate(&self.options.programs, &self.options.instance);
        command.args(arguments);
        command
    }
}

impl Drop for Jink {
    fn drop(&mut self) {
        self.down();
    }
}
