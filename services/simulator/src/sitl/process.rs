//! The autopilot as a process: a group of its own, its output in a log, and it never outlives the simulator.

use super::error::StartError;
use super::launch::Launch;
use rustix::process::{Pid, Signal, kill_process_group};
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Its log in its working folder, unless it is to be elsewhere.
pub const LOG_FILE: &str = "sitl.log";
/// A tool of util-linux that has the kernel end the autopilot when the simulator ends, however that ends.
const DEATH_SIGNAL_TOOL: &str = "setpriv";
/// How long the autopilot may take to end when it is asked to.
const STOP_PATIENCE: Duration = Duration::from_millis(500);
const LOOK: Duration = Duration::from_millis(20);
/// Lines of the log that are quoted when it died.
const LAST_LINES: usize = 5;

/// The running autopilot.
#[derive(Debug)]
pub struct AutopilotProcess {
    child: Child,
    log: PathBuf,
    ended: Option<ExitStatus>,
}

impl AutopilotProcess {
    /// Writes the files of `launch` into `folder` and starts its program there; its output goes to `log`.
    pub fn start(launch: &Launch, folder: &Path, log: &Path) -> Result<Self, StartError> {
        let io = |what: String| {
            move |cause: std::io::Error| StartError::Io {
                what,
                cause: cause.to_string(),
            }
        };
        std::fs::create_dir_all(folder).map_err(io(folder.display().to_string()))?;
        for name in &launch.stale {
            let path = folder.join(name);
            let _not_there = std::fs::remove_dir_all(&path).or_else(|_| std::fs::remove_file(&path));
        }
        for (name, content) in &launch.files {
            let path = folder.join(name);
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent).map_err(io(parent.display().to_string()))?;
            }
            std::fs::write(&path, content).map_err(io(path.display().to_string()))?;
        }
        let file = File::create(log).map_err(io(log.display().to_string()))?;
        let copy = file.try_clone().map_err(io(log.display().to_string()))?;
        let mut command = Command::new(DEATH_SIGNAL_TOOL);
        command
            .args(["--pdeathsig", "KILL"])
            .arg(&launch.program)
            .args(&launch.arguments)
            .envs(launch.environment.iter().map(|(name, value)| (name, value)))
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(copy)
            .process_group(0);
        let child = command.spawn().map_err(io(format!(
            "{DEATH_SIGNAL_TOOL} (of util-linux) for {}",
            launch.program.display()
        )))?;
        Ok(Self {
            child,
            log: log.to_owned(),
            ended: None,
        })
    }

    /// Its log.
    pub fn log(&self) -> &Path {
        &self.log
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        if self.ended.is_none() {
            self.ended = self.child.try_wait().ok().flatten();
        }
        self.ended
    }

    /// What its log says last.
    pub fn last_words(&self) -> String {
        let bytes = std::fs::read(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let mut last: Vec<&str> = text
            .lines()
            .rev()
            .filter(|line| !line.trim().is_empty())
            .take(LAST_LINES)
            .collect();
        last.reverse();
        last.join(" | ")
    }

    /// Ends it and everything it started.
    pub fn stop(&mut self) {
        self.signal(Signal::TERM);
        let begin = Instant::now();
        while self.ended().is_none() && begin.elapsed() < STOP_PATIENCE {
            std::thread::sleep(LOOK);
        }
        // What the start-up scripts left is in the same group.
        self.signal(Signal::KILL);
        if self.ended.is_none() {
            self.ended = self.child.wait().ok();
        }
    }

    fn signal(&self, signal: Signal) {
        let group = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        if let Some(group) = group {
            let _gone_already = kill_process_group(group, signal);
        }
    }
}

impl Drop for AutopilotProcess {
    fn drop(&mut self) {
        self.stop();
    }
}
