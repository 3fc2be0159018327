//! A supervisor of its own with stand-ins for services, in an instance of its own, that leaves nothing behind.

use jink_runtime::request::{Answer, Request};
use jink_runtime::{Input, Instance, Session};
use jink_shared_types::health::{Health, ProcessStatus, ServiceState, SystemStatus};
use jink_shared_types::topics;
use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Nothing in these tests takes this long, however busy the machine is.
const WATCHDOG: Duration = Duration::from_secs(60);

/// The table's defaults for tests: a busy machine is no hang.
const DEFAULTS: &str = "[defaults]\nheartbeat_timeout_ms = 2000\nstart_grace_ms = 20000\n";

/// A row that starts the stand-in with `arguments` (a TOML list) and `extra` keys.
pub fn row(name: &str, arguments: &str, extra: &str) -> String {
    let program = stand_in();
    format!("[[process]]\nname = \"{name}\"\nprogram = \"{program}\"\narguments = {arguments}\n{extra}\n")
}

pub fn stand_in() -> String {
    example("stand_in")
}

/// The supervisor's program, alone.
pub fn supervisor() -> String {
    example("supervisor")
}

fn example(name: &str) -> String {
    let own = std::env::current_exe().unwrap();
    let folder = own.parent().and_then(|deps| deps.parent()).unwrap();
    folder.join("examples").join(name).to_str().unwrap().to_owned()
}

/// Waits until `condition` yields something.
pub fn wait_for<T>(what: &str, mut condition: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(value) = condition() {
            return value;
        }
        assert!(begin.elapsed() < WATCHDOG, "{what} did not happen");
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub struct Rig {
    pub instance: Instance,
    pub config: PathBuf,
    supervisor: Option<Child>,
    status: Option<Input<SystemStatus>>,
}

impl Rig {
    /// An instance with the process table `rows`, nothing started.
    pub fn new(rows: &[String]) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("sv{}x{number}", std::process::id());
        let config = std::env::temp_dir().join(format!("jink_{name}"));
        std::fs::create_dir_all(&config).unwrap();
        std::fs::write(config.join("jink.toml"), "").unwrap();
        std::fs::write(
            config.join("services.toml"),
            format!("{DEFAULTS}{}", rows.concat()),
        )
        .unwrap();
        Self {
            instance: name.parse().unwrap(),
            config,
            supervisor: None,
            status: None,
        }
    }

    /// The command that starts a supervisor on the instance.
    pub fn command(&self) -> Command {
        let mut command = Command::new(supervisor());
        command
            .args(["--instance", &self.instance.to_string()])
            .arg("--config")
            .arg(&self.config);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Starts it and connects to its status.
    pub fn start(&mut self) {
        let command = self.command();
        self.start_as(command);
    }

    /// Starts `command` as the supervisor and connects to its status.
    pub fn start_as(&mut self, mut command: Command) {
        let started = command.spawn().unwrap();
        let pid = started.id().to_string();
        self.supervisor = Some(started);
        wait_for("the start", || {
            let holder = std::fs::read_to_string(self.instance.lock_file()).unwrap_or_default();
            let is_prepared = self.instance.run_config().join("jink.toml").exists();
            (holder.trim() == pid && is_prepared).then_some(())
        });
        self.reconnect();
    }

    /// Reads the status of the present supervisor.
    pub fn reconnect(&mut self) {
        let session = Session::open(&self.instance, "cli").unwrap();
        self.status = Some(session.input(topics::SYSTEM_STATUS, "").unwrap());
    }

    /// The newest status, once there is one.
    pub fn status(&mut self) -> Option<SystemStatus> {
        let input = self.status.as_mut().unwrap();
        input.latest(jink_runtime::now());
        input.newest().map(|status| *status.sample)
    }

    /// Waits until the process called `name` is as wanted.
    pub fn wait_process(&mut self, name: &str, wanted: impl Fn(&ProcessStatus) -> bool) -> ProcessStatus {
        wait_for(name, || {
            let status = self.status()?;
            let process = status
                .processes()
                .iter()
                .find(|process| process.heartbeat.name.as_str() == name)?;
            wanted(process).then_some(*process)
        })
    }

    pub fn wait_active(&mut self, name: &str) -> ProcessStatus {
        self.wait_process(name, |process| process.state == ServiceState::Active)
    }

    pub fn wait_health(&mut self, wanted: Health) -> SystemStatus {
        wait_for("health", || {
            self.status().filter(|status| status.health == wanted)
        })
    }

    /// Sends a request to the supervisor and returns everything it answers.
    pub fn ask(&self, request: &Request) -> Vec<Answer> {
        self.ask_beside(request).join().unwrap()
    }

    /// The same from a thread.
    pub fn ask_beside(&self, request: &Request) -> JoinHandle<Vec<Answer>> {
        let socket = self.instance.request_socket();
        let mut stream = wait_for("the socket", || UnixStream::connect(&socket).ok());
        let line = serde_json::to_string(request).unwrap() + "\n";
        stream.write_all(line.as_bytes()).unwrap();
        std::thread::spawn(move || {
            let mut answers: Vec<Answer> = Vec::new();
            for line in BufReader::new(stream).lines() {
                answers.push(serde_json::from_str(&line.unwrap()).unwrap());
                if answers.last().is_some_and(|answer| answer.last) {
                    break;
                }
            }
            answers
        })
    }

    pub fn signal_supervisor(&self, signal: Signal) {
        send(self.supervisor.as_ref().unwrap().id(), signal);
    }

    /// Waits for the end of the supervisor; its exit status and what it logged.
    pub fn ended(&mut self) -> (ExitStatus, String) {
        // Readers let go first, as the supervisor removes the memory under them.
        self.status = None;
        let mut supervisor = self.supervisor.take().unwrap();
        let status = wait_for("the end", || supervisor.try_wait().unwrap());
        let mut log = String::new();
        supervisor
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut log)
            .unwrap();
        (status, log)
    }

    /// Stops it as a service manager would.
    pub fn stop(&mut self) -> (ExitStatus, String) {
        self.signal_supervisor(Signal::TERM);
        self.ended()
    }

    /// What of the instance is left in shared memory.
    pub fn stale_resources(&self) -> Vec<String> {
        let own = format!("jink_{}", self.instance);
        // Not those of an instance whose number begins with the digits of this one.
        let is_own = |name: &String| {
            let rest = name.strip_prefix(&own);
            rest.is_some_and(|rest| !rest.starts_with(|next: char| next.is_ascii_digit()))
        };
        let names = std::fs::read_dir("/dev/shm").unwrap().flatten();
        names
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter(is_own)
            .collect()
    }
}

/// Sends `signal` to a process that this test started.
pub fn send(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).unwrap();
}

pub fn is_alive(pid: u32) -> bool {
    jink_runtime::procfs::ProcessStat::now(pid).is_some_and(|stat| stat.state != 'Z')
}

impl Drop for Rig {
    fn drop(&mut self) {
        if let Some(mut supervisor) = self.supervisor.take() {
            let _ = supervisor.kill();
            let mut log = String::new();
            if let (true, Some(mut stderr)) = (std::thread::panicking(), supervisor.stderr.take()) {
                let _ = stderr.read_to_string(&mut log);
                eprintln!("{log}");
            }
            let _ = supervisor.wait();
        }
        let swept = self.command().arg("--sweep").status();
        let _ = std::fs::remove_dir_all(&self.config);
        assert!(std::thread::panicking() || swept.is_ok_and(|status| status.success()));
    }
}
