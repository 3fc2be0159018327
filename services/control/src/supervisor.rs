//! The supervisor as a child of this program: how an instance is started, and stopped by whoever has started it.

use crate::findings::Findings;
use crate::watch::Watch;
use crate::{EXIT_PROBLEM, Interrupt, Problem, places};
use jink_runtime::service::EXIT_CANNOT_START;
use jink_runtime::{Instance, programs};
use std::io::Read;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest stop: every process may take a second to be killed, and the memory is removed.
const STOP_PATIENCE: Duration = Duration::from_secs(40);
/// How often it is looked at while it starts or stops.
const LOOK: Duration = Duration::from_millis(5);
/// Longest time until the memory is there: the configuration is read and topics are created, no process has started yet.
const MEMORY_PATIENCE: Duration = Duration::from_secs(20);

/// What to start.
#[derive(Clone, Debug)]
pub struct StartOptions {
    /// Folder of the programs.
    pub programs: PathBuf,
    /// Configuration folder.
    pub config: PathBuf,
    /// Profile.
    pub profile: Option<String>,
    /// Set of sensors.
    pub sensors: Option<String>,
    /// `section.key=value` in the order in which they apply.
    pub overrides: Vec<String>,
    /// `real`, `virtual_world` or `simulated_vehicle`.
    pub mode: &'static str,
    /// Keep the logs after the stop even if nothing went wrong.
    pub keep_logs: bool,
}

/// A supervisor that is killed is started again so often; it goes on with the processes it finds.
const COMEBACKS: u32 = 5;

/// A supervisor that this command has started.
pub struct Supervisor {
    child: Child,
    instance: Instance,
    options: StartOptions,
    comebacks: u32,
    stopping: bool,
}

impl Supervisor {
    /// The instance.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    /// Starts one for `instance`, if `jink check config` finds nothing wrong.
    ///
    /// # Errors
    /// Every mistake of the configuration, or why no supervisor can be started; nothing is left behind.
    pub fn start(instance: &Instance, options: &StartOptions) -> Result<Self, Problem> {
        check(options)?;
        Ok(Self {
            child: spawn(instance, options)?,
            instance: instance.clone(),
            options: options.clone(),
            comebacks: 0,
            stopping: false,
        })
    }

    /// Waits until the memory is prepared and connects to it.
    pub fn watch(&mut self, interrupt: &Interrupt) -> Result<Watch, Problem> {
        let begin = Instant::now();
        while !self.holds_the_instance() {
            if let Some(status) = self.ended()? {
                return Err(Problem::NotUp {
                    reason: self.reason(),
                    code: exit_code(status),
                });
            }
            if interrupt.has_come() || begin.elapsed() > MEMORY_PATIENCE {
                return Err(Problem::Other(
                    "interrupted before the system had started".to_owned(),
                ));
            }
            std::thread::sleep(LOOK);
        }
        Watch::open(&self.instance)
    }

    fn holds_the_instance(&self) -> bool {
        let held_by = std::fs::read_to_string(self.instance.lock_file()).unwrap_or_default();
        held_by.trim() == self.child.id().to_string() && Watch::is_ready(&self.instance)
    }

    /// How it ended, if it has. One that was killed comes back and goes on with the processes it finds.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>, Problem> {
        let status = self.child.try_wait().map_err(Problem::io("supervisor"))?;
        let killed = status.is_some_and(|status| status.signal().is_some());
        if killed && !self.stopping && self.comebacks < COMEBACKS {
            self.comebacks += 1;
            self.child = spawn(&self.instance, &self.options)?;
            return Ok(None);
        }
        Ok(status)
    }

    /// Why it ended, in its own words.
    pub fn reason(&mut self) -> String {
        let mut early = String::new();
        if let Some(mut stderr) = self.child.stderr.take() {
            // Whatever could be read is better than nothing.
            let _incomplete = stderr.read_to_string(&mut early);
        }
        // Before it holds the instance, the log there is that of another one.
        if let Some(reason) = last_error(&early) {
            return reason;
        }
        let late = std::fs::read_to_string(self.log_file()).unwrap_or_default();
        match last_error(&late) {
            Some(reason) => format!("{reason}\nlogs: {}", self.instance.log_place().display()),
            None => format!("the supervisor ended without a word\n{early}"),
        }
    }

    /// The last error that a process has logged.
    pub fn last_error_of(&self, process: &str) -> Option<String> {
        let file = self.instance.log_folder().join(format!("{process}.log"));
        last_error(&std::fs::read_to_string(file).unwrap_or_default())
    }

    fn log_file(&self) -> PathBuf {
        self.instance.log_folder().join("supervisor.log")
    }

    /// Asks it to stop and waits for its end. All readers must have let go of shared memory.
    pub fn stop(&mut self) -> Result<ExitStatus, Problem> {
        self.stopping = true;
        if let Some(status) = self.ended()? {
            return Ok(status);
        }
        let pid = i32::try_from(self.child.id())
            .ok()
            .and_then(rustix::process::Pid::from_raw);
        if let Some(pid) = pid {
            // Not yet waited for, so the number is still its own.
            let _gone_already = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let begin = Instant::now();
        loop {
            if let Some(status) = self.ended()? {
                return Ok(status);
            }
            if begin.elapsed() > STOP_PATIENCE {
                let message = format!(
                    "the supervisor (process id {}) does not stop; see {}",
                    self.child.id(),
                    self.log_file().display()
                );
                return Err(Problem::Other(message));
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// Has the configuration examined, by the drivers' own parsers too.
fn check(options: &StartOptions) -> Result<(), Problem> {
    let mut command = places::program(&options.programs, programs::JINK)?;
    command.args(["check", "config", "--json", "--mode", options.mode]);
    command.arg("--config").arg(&options.config);
    for (option, value) in [("--profile", &options.profile), ("--sensor", &options.sensors)] {
        command.args(value.iter().flat_map(|value| [option, value.as_str()]));
    }
    command.args(options.overrides.iter().flat_map(|text| ["--set", text.as_str()]));
    let answer = command
        .stdin(Stdio::null())
        .output()
        .map_err(Problem::io("jink check config"))?;
    let found: Findings = serde_json::from_slice(&answer.stdout).map_err(|_| {
        Problem::Other(
            String::from_utf8_lossy(&answer.stderr)
                .trim()
                .trim_start_matches("jink: ")
                .to_owned(),
        )
    })?;
    let mistakes: Vec<String> = found.findings.into_iter().map(|finding| finding.is).collect();
    if mistakes.is_empty() {
        return Ok(());
    }
    Err(Problem::NotUp {
        reason: format!("cannot start: {}", mistakes.join("\n")),
        code: EXIT_CANNOT_START,
    })
}

fn spawn(instance: &Instance, options: &StartOptions) -> Result<Child, Problem> {
    let mut command = places::program(&options.programs, "jink-supervisor")?;
    command.args([
        "--instance",
        &instance.to_string(),
        "--mode",
        options.mode,
        "--log-to-file",
    ]);
    command.arg("--config").arg(&options.config);
    if options.keep_logs {
        command.arg("--keep-logs");
    }
    if let Some(profile) = &options.profile {
        command.args(["--profile", profile]);
    }
    if let Some(sensors) = &options.sensors {
        command.args(["--sensors", sensors]);
    }
    for text in &options.overrides {
        command.args(["--set", text]);
    }
    // Before it has a log file it writes its reasons to standard error. A process group of its own: Ctrl-C reaches
    // this command, which asks the supervisor to stop.
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .process_group(0);
    command.spawn().map_err(Problem::io("jink-supervisor"))
}

/// The code of `status`; that of any problem for a supervisor that was killed.
pub fn exit_code(status: ExitStatus) -> u8 {
    let code = status.code().and_then(|code| u8::try_from(code).ok());
    code.unwrap_or(EXIT_PROBLEM)
}

/// The message of the last record of level ERROR.
fn last_error(log: &str) -> Option<String> {
    log.lines().rev().find_map(|line| {
        let record: serde_json::Value = serde_json::from_str(line).ok()?;
        let message = record.get("message")?.as_str()?;
        (record.get("level")?.as_str()? == "ERROR").then(|| message.to_owned())
    })
}

/// Ends what a killed supervisor of `instance` left running and removes its memory.
pub fn sweep(programs: &Path, instance: &Instance) -> Result<(), Problem> {
    let swept = places::program(programs, "jink-supervisor")?
        .args(["--instance", &instance.to_string(), "--sweep"])
        .stdin(Stdio::null())
        .output()
        .map_err(Problem::io("jink-supervisor"))?;
    if swept.status.success() {
        return Ok(());
    }
    let log = String::from_utf8_lossy(&swept.stderr);
    Err(Problem::Other(
        last_error(&log).unwrap_or_else(|| log.into_owned()),
    ))
}
