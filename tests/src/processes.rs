//! The real programs, run as a user runs them.
// A harness for tests: without its programs, ports and folders there is nothing to test.
#![allow(clippy::expect_used)]

use crate::peers;
use crate::permit::{self, Permit};
use jink_runtime::Instance;
use serde_json::Value;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::str::FromStr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(PathBuf::new, Path::to_path_buf)
}

/// The folder with all programs of the profile this test was built in; builds what is missing there.
///
/// # Panics
/// If the programs cannot be built: without them there is nothing to test.
pub fn programs() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let test = std::env::current_exe().unwrap_or_default();
        // target/<profile>/deps/<test>
        let folder = test
            .ancestors()
            .nth(2)
            .map_or_else(PathBuf::new, Path::to_path_buf);
        let mut build = Command::new(env!("CARGO"));
        build
            .args(["build", "--workspace", "--bins", "--quiet"])
            .current_dir(workspace());
        if folder.ends_with("release") {
            build.arg("--release");
        }
        let built = build.status().is_ok_and(|status| status.success());
        assert!(
            built,
            "the programs could not be built: cargo build --workspace --bins"
        );
        folder
    })
}

/// One program of ours with `arguments`, started in the workspace.
pub fn program(name: &str, arguments: &[&str]) -> Command {
    let file = jink_runtime::programs::file_of(&programs().join(name));
    let mut command = jink_runtime::programs::command(&file, name.as_ref());
    command.args(arguments).current_dir(workspace());
    command
}

/// What a program answered.
#[derive(Debug)]
pub struct Answer {
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
    /// Its exit code; `None` if it was killed.
    pub code: Option<i32>,
}

/// Runs a command to its end.
///
/// # Panics
/// If it cannot be started: then there is nothing to test.
pub fn answer(command: &mut Command) -> Answer {
    let output = command.stdin(Stdio::null()).output();
    let output = output.expect("a program can be started");
    Answer {
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        code: output.status.code(),
    }
}

/// One instance of jink, looked at and meddled with from outside.
#[derive(Debug)]
pub struct Handle {
    instance: String,
}

impl Handle {
    /// Its name.
    pub fn instance(&self) -> &str {
        &self.instance
    }

    /// Where its programs write their logs.
    fn log_folder(&self) -> PathBuf {
        Instance::from_str(&self.instance).map_or_else(|_| PathBuf::new(), |instance| instance.log_folder())
    }

    /// Shows the last lines of every log of it if the test has failed, and removes what `jink down` keeps.
    fn end_logs(&self) {
        let folder = self.log_folder();
        if !std::thread::panicking() {
            let _none_kept = folder.parent().map(std::fs::remove_dir_all);
            return;
        }
        let files = std::fs::read_dir(folder);
        for file in files.into_iter().flatten().flatten() {
            let text = std::fs::read_to_string(file.path()).unwrap_or_default();
            let lines: Vec<&str> = text.lines().collect();
            let last = &lines[lines.len().saturating_sub(LAST_LINES)..];
            eprintln!("{}:\n{}", file.path().display(), last.join("\n"));
        }
    }

    /// The jink command for this instance.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = program("jink", &["--instance", &self.instance]);
        command.args(arguments);
        command
    }

    /// Runs a command of jink on this instance.
    pub fn jink(&self, arguments: &[&str]) -> Answer {
        answer(&mut self.command(arguments))
    }

    /// What `jink status --json` says; null if it says nothing.
    pub fn status(&self) -> Value {
        let status = self.jink(&["status", "--json"]);
        serde_json::from_str(&status.stdout).unwrap_or(Value::Null)
    }

    /// What that says of one service; null if it is not there.
    pub fn service(&self, name: &str) -> Value {
        let services = self.status()["services"].as_array().cloned().unwrap_or_default();
        let mut services = services.into_iter();
        services
            .find(|service| service["name"] == name)
            .unwrap_or(Value::Null)
    }

    /// Kills a process of this name (SIGKILL); answers which it was.
    ///
    /// # Panics
    /// If there is none.
    pub fn kill(&self, name: &str) -> i64 {
        let mut killed = None;
        until("a process to kill", || {
            killed = self.service(name)["pid"].as_i64();
            killed.is_some()
        });
        let pid = killed.and_then(|pid| rustix::process::Pid::from_raw(i32::try_from(pid).ok()?));
        rustix::process::kill_process(pid.expect("a process id"), rustix::process::Signal::KILL)
            .expect("a process that can be killed");
        killed.unwrap_or_default()
    }

    /// The ground truth; `null` before there is one.
    pub fn truth(&self) -> Value {
        let echo = [
            "topic",
            "echo",
            "sim/truth",
            "--json",
            "--count",
            "1",
            "--timeout",
            "2",
        ];
        let said: Value = serde_json::from_str(&self.jink(&echo).stdout).unwrap_or_default();
        said["sample"].clone()
    }

    /// One number of the ground truth; `None` before there is one.
    pub fn truth_number(&self, field: &str) -> Option<f64> {
        self.truth()[field].as_f64()
    }

    /// How far the vehicle has flown (m).
    pub fn flown_m(&self) -> f64 {
        self.truth_number("flown_m").unwrap_or(0.0)
    }

    /// Waits until the vehicle is on its mission.
    ///
    /// # Panics
    /// If that never happens.
    pub fn until_it_flies(&self) {
        until("the mission", || self.truth()["mode"] == "mission");
    }

    /// Waits until the vehicle stands still.
    ///
    /// # Panics
    /// If that never happens.
    pub fn until_it_rests(&self) {
        until("rest", || {
            let before = self.truth_number("flown_m");
            std::thread::sleep(Duration::from_millis(700));
            let after = self.truth_number("flown_m");
            before
                .zip(after)
                .is_some_and(|(before, after)| after - before < 0.1)
        });
    }
}

/// A jink that runs in the background in an instance of its own; it is taken down with this.
#[derive(Debug)]
pub struct System {
    handle: Handle,
    _permit: Permit,
}

impl System {
    /// `jink up --detach` with further `arguments`, in an instance named after `role` and this process; waits until there is
    /// room for it.
    ///
    /// # Panics
    /// If it does not come up: the text says why.
    pub fn up(role: &str, arguments: &[&str]) -> Self {
        // A process id has seven digits at most, the name of an instance 22 characters.
        let instance = format!("t_{role}_{}", std::process::id());
        let system = Self {
            handle: Handle { instance },
            _permit: permit::share(),
        };
        let mut command = system.command(&["up", "--detach"]);
        let up = answer(command.args(arguments));
        assert_eq!(up.code, Some(0), "{up:?}");
        system
    }
}

impl Deref for System {
    type Target = Handle;
    fn deref(&self) -> &Handle {
        &self.handle
    }
}

/// A test that has failed shows what the services have said, and where the vehicle was.
impl Drop for System {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}\n{}", self.truth(), self.jink(&["status"]).stdout);
        }
        let down = self.jink(&["down", "--now"]);
        if down.code != Some(0) {
            eprintln!("{}: {down:?}", self.handle.instance);
        }
        self.handle.end_logs();
    }
}

/// A folder that is removed with this.
#[derive(Debug)]
pub struct TempFolder {
    path: PathBuf,
}

impl TempFolder {
    /// A new, empty folder; `role` and this process make its name.
    ///
    /// # Panics
    /// If it cannot be made.
    pub fn new(role: &str) -> Self {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("jink_{role}_{}_{number}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a temporary folder");
        Self { path }
    }

    /// The same with a copy of the workspace's configuration in it.
    ///
    /// # Panics
    /// If it cannot be made.
    pub fn with_config(role: &str) -> Self {
        let folder = Self::new(role);
        let from = workspace().join("config");
        for file in ["jink.toml", "services.toml", "profiles/px4_trajectory.toml"] {
            let text = std::fs::read_to_string(from.join(file)).expect("the configuration");
            folder.write(file, &text);
        }
        folder
    }

    /// As [`Self::with_config`], with `sensors` in the place of the configuration's own.
    ///
    /// # Panics
    /// If it cannot be made.
    pub fn with_sensors(role: &str, sensors: &str) -> Self {
        let folder = Self::with_config(role);
        let text = std::fs::read_to_string(folder.path().join("jink.toml")).expect("the configuration");
        let (before, rest) = text.split_once("\n[[sensor]]\n").expect("a sensor");
        let (_, behind) = rest
            .split_once("\n[simulation]\n")
            .expect("what is behind the sensors");
        folder.write(
            "jink.toml",
            &format!("{before}\n{sensors}\n[simulation]\n{behind}"),
        );
        folder
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where it is, as an argument.
    pub fn text(&self) -> &str {
        self.path.to_str().expect("a path in UTF-8")
    }

    /// Writes `file` in it.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn write(&self, file: &str, text: &str) -> PathBuf {
        let path = self.path.join(file);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).expect("a temporary folder");
        }
        std::fs::write(&path, text).expect("a temporary file");
        path
    }
}

impl Drop for TempFolder {
    fn drop(&mut self) {
        let _gone_already = std::fs::remove_dir_all(&self.path);
    }
}

/// A Python with pymavlink, made beside the programs at the first call; `Err` = why there is none.
///
/// # Errors
/// A text saying what is missing on this machine.
pub fn python_with_pymavlink() -> Result<PathBuf, String> {
    peers::python(&peers::PYMAVLINK)
}

/// What a demonstration flight said: its whole output, and the JSON object on the last line.
#[derive(Debug)]
pub struct Demo {
    /// Standard output and error.
    pub text: String,
    /// The figures; null if there are none.
    pub figures: Value,
    /// Its exit code.
    pub code: Option<i32>,
}

/// A demonstration that records nothing, unless a test says where.
const DEMO: [&str; 5] = ["demo", "--headless", "--json", "--set", "recorder.folder="];

/// Flies `jink demo --headless --json` with further `arguments`, as soon as there is room for it.
pub fn demo(arguments: &[&str]) -> Demo {
    let _permit = permit::share();
    let mut all = DEMO.to_vec();
    all.extend(arguments);
    let Answer { stdout, stderr, code } = answer(&mut program("jink", &all));
    let last = stdout.lines().last().unwrap_or_default();
    Demo {
        figures: serde_json::from_str(last).unwrap_or(Value::Null),
        text: format!("{stdout}\n{stderr}"),
        code,
    }
}

/// Patience with a flight that is to end at once.
const END: Duration = Duration::from_secs(20);
/// Patience with a flight, take-off to landing.
const WATCHDOG: Duration = Duration::from_secs(180);

/// A demonstration flight under way, which can be meddled with.
#[derive(Debug)]
pub struct Flight {
    demo: Option<Child>,
    handle: Handle,
    _permit: Permit,
}

impl Flight {
    /// `jink demo --headless --json` with further `arguments`, as soon as there is room for it.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn begin(arguments: &[&str]) -> Self {
        Self::begin_in(arguments, &[])
    }

    /// The same with further variables of the environment.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn begin_in(arguments: &[&str], environment: &[(&str, &Path)]) -> Self {
        let mut command = program("jink", &DEMO);
        command.envs(environment.iter().copied());
        let permit = permit::share();
        let demo = command.args(arguments).stdout(Stdio::piped()).spawn();
        let demo = demo.expect("jink demo can be started");
        let instance = format!("demo_{}", demo.id());
        Self {
            demo: Some(demo),
            handle: Handle { instance },
            _permit: permit,
        }
    }

    /// Waits for the end of the flight; its figures.
    ///
    /// # Panics
    /// If its end cannot be waited for.
    pub fn end(mut self) -> Value {
        let demo = self.demo.take().expect("a flight ends once");
        let output = demo.wait_with_output().expect("jink demo ends");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        serde_json::from_str(text.lines().last().unwrap_or_default()).unwrap_or(Value::String(text))
    }
}

impl Deref for Flight {
    type Target = Handle;
    fn deref(&self) -> &Handle {
        &self.handle
    }
}

/// A test leaves nothing flying; one that has failed shows what the flight has said.
impl Drop for Flight {
    fn drop(&mut self) {
        if let Some(mut demo) = self.demo.take() {
            // Asked to end, it takes down all that it has started.
            let asked = rustix::process::kill_process(
                rustix::process::Pid::from_child(&demo),
                rustix::process::Signal::TERM,
            );
            let begin = Instant::now();
            while asked.is_ok() && begin.elapsed() < END && matches!(demo.try_wait(), Ok(None)) {
                std::thread::sleep(Duration::from_millis(50));
            }
            let _gone_already = demo.kill();
            let output = demo.wait_with_output();
            let down = self.jink(&["down", "--now"]);
            if std::thread::panicking() {
                if let Ok(output) = output {
                    eprintln!("{}", String::from_utf8_lossy(&output.stdout));
                }
                eprintln!("{}: {}", self.handle.instance, down.stdout.trim());
            }
        }
        self.handle.end_logs();
    }
}

/// Lines of each log that a test which has failed shows.
const LAST_LINES: usize = 30;

/// Waits for `condition`, looking five times a second.
///
/// # Panics
/// If it does not come true in minutes.
pub fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !condition() {
        assert!(begin.elapsed() < WATCHDOG, "{what} never came");
        std::thread::sleep(Duration::from_millis(200));
    }
}
