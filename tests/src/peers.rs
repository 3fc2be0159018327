//! Programs of others beside a jink: each kind in a Python environment of its own with pinned versions, commanded
//! line by line.
//!
//! | peer | is |
//! |---|---|
//! | [`Station`] | a ground station made of pymavlink (`tests/peers/station.py`) |
//! | [`Terminal`] | a program for people, with its keyboard and its screen |
//! | [`Network`] | the jink they talk to: a simulated autopilot, the gateway, and links for ground stations |
// A harness for tests: without its programs there is nothing to test.
#![allow(clippy::expect_used, clippy::panic)]

use crate::not_tested;
use crate::ports::free_udp_ports;
use crate::processes::{System, TempFolder, answer, programs, workspace};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Lines, Read, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Packages that some tests need, with what shows that they are there.
#[derive(Clone, Copy, Debug)]
pub struct Kit {
    /// Folder of the environment, beside the programs.
    pub folder: &'static str,
    /// Statement that works once they are installed.
    pub proof: &'static str,
    /// What pip is called with, command by command.
    pub installs: &'static [&'static str],
}

/// iceoryx2's own binding, of the version that jink is built with.
pub const ICEORYX2: Kit = Kit {
    folder: "python_iceoryx2",
    proof: "import iceoryx2",
    installs: &["iceoryx2==0.10.0"],
};

/// The same with numpy, for sensors.
pub const CLOUDS: Kit = Kit {
    folder: "python_clouds",
    proof: "import iceoryx2, numpy",
    installs: &["iceoryx2==0.10.0 numpy==2.4.6"],
};

/// The same with the SDK of Ouster's lidars.
pub const OUSTER: Kit = Kit {
    folder: "python_ouster",
    proof: "import iceoryx2, numpy, ouster.sdk",
    installs: &["iceoryx2==0.10.0 numpy==2.4.6 ouster-sdk==1.0.1"],
};

/// MAVLink in Python, as its makers publish it.
pub const PYMAVLINK: Kit = Kit {
    folder: "python",
    proof: "import pymavlink",
    installs: &["pymavlink==2.4.50"],
};

/// MAVSDK's C++ library with its Python binding.
pub const MAVSDK: Kit = Kit {
    folder: "python_mavsdk",
    proof: "import mavsdk",
    installs: &["mavsdk==4.1.0"],
};

/// MAVProxy with what it needs without a screen: the maps and windows it would bring along are half a gigabyte.
pub const MAVPROXY: Kit = Kit {
    folder: "python_mavproxy",
    proof: "import MAVProxy, pymavlink, serial, numpy",
    installs: &[
        "pymavlink==2.4.50 pyserial==3.5 numpy==2.4.6 defusedxml==0.7.1",
        "--no-deps MAVProxy==1.8.75",
    ],
};

/// MCAP in Python, as its makers publish it.
pub const MCAP: Kit = Kit {
    folder: "python_mcap",
    proof: "import mcap, lz4",
    installs: &["mcap==1.6.0"],
};

/// The Python of `kit`, made at the first call; `Err` = why there is none.
///
/// # Errors
/// A text saying what is missing on this machine.
pub fn python(kit: &Kit) -> Result<PathBuf, String> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let venv = programs().with_file_name(kit.folder);
    let python = venv.join("bin/python");
    let works = || {
        let asked = Command::new(&python).args(["-c", kit.proof]).output();
        asked.is_ok_and(|output| output.status.success())
    };
    if works() {
        return Ok(python);
    }
    let mut script = "python3 -m venv \"$0\"".to_owned();
    for packages in kit.installs {
        // Writing into a string cannot fail.
        let _infallible = write!(script, " && \"$0/bin/pip\" install --quiet {packages}");
    }
    let made = answer(Command::new("sh").arg("-c").arg(script).arg(&venv));
    if works() {
        Ok(python)
    } else {
        Err(format!(
            "no Python with {} (python3, python3-venv and a package index are needed): {}",
            kit.installs.join(" "),
            made.stderr.trim()
        ))
    }
}

/// The Python of `kit`; `None`, and said on standard error, where it cannot be had.
pub fn python_or_say(kit: &Kit) -> Option<PathBuf> {
    python(kit).inspect_err(|missing| not_tested(missing)).ok()
}

/// A ground station made of pymavlink: `tests/peers/station.py`.
#[derive(Debug)]
pub struct Station {
    child: Child,
    orders: Option<ChildStdin>,
    answers: Lines<BufReader<ChildStdout>>,
}

impl Station {
    /// Starts it.
    ///
    /// # Panics
    /// If it does not start.
    pub fn start(python: &Path) -> Self {
        let mut child = Command::new(python)
            .arg(workspace().join("tests/peers/station.py"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a ground station can be started");
        let answers = child.stdout.take().expect("its output");
        Self {
            orders: child.stdin.take(),
            answers: BufReader::new(answers).lines(),
            child,
        }
    }

    /// Has it carry out an order; its answer.
    ///
    /// # Panics
    /// If it could not: the text is its own.
    pub fn ask(&mut self, order: &Value) -> Value {
        let orders = self.orders.as_mut().expect("it listens");
        writeln!(orders, "{order}").expect("it listens");
        let answer = self
            .answers
            .next()
            .expect("an answer")
            .expect("an answer in UTF-8");
        let answer: Value = serde_json::from_str(&answer).expect("an answer in JSON");
        assert!(
            answer.get("error").is_none(),
            "{order}\n{}",
            answer["error"].as_str().unwrap_or_default()
        );
        answer
    }

    /// Opens a line to the gateway's `port` as a ground station 255/190.
    pub fn open(&mut self, line: &str, port: u16) {
        self.ask(&json!({"do": "open", "line": line, "port": port}));
    }

    /// Sends one message; everything received until all that was to be said about it has been said.
    pub fn send(&mut self, line: &str, kind: &str, fields: &Value, until: &Value) -> Vec<Value> {
        let order = json!({"do": "send", "line": line, "kind": kind, "fields": fields, "until": until});
        received(&self.ask(&order))
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        self.orders = None;
        end(&mut self.child);
    }
}

/// The messages in an answer.
pub fn received(answer: &Value) -> Vec<Value> {
    answer["received"].as_array().cloned().unwrap_or_default()
}

/// Those of one kind from one component.
pub fn of<'a>(messages: &'a [Value], component: u8, kind: &str) -> Vec<&'a Value> {
    let is_it = |message: &&Value| message["component"] == component && message["kind"] == kind;
    messages.iter().filter(is_it).collect()
}

/// A program for people, with its keyboard and its screen.
#[derive(Debug)]
pub struct Terminal {
    child: Child,
    keyboard: Option<ChildStdin>,
    screen: Arc<Mutex<String>>,
}

/// Patience with what a person would wait for.
const PATIENCE: Duration = Duration::from_secs(60);

impl Terminal {
    /// Starts it.
    ///
    /// # Panics
    /// If it does not start.
    pub fn start(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a program can be started");
        let screen = Arc::new(Mutex::new(String::new()));
        let outputs: [Option<Box<dyn Read + Send>>; 2] = [
            child.stdout.take().map(|output| Box::new(output) as _),
            child.stderr.take().map(|output| Box::new(output) as _),
        ];
        for mut output in outputs.into_iter().flatten() {
            let screen = Arc::clone(&screen);
            std::thread::spawn(move || {
                let mut bytes = [0; 4096];
                while let Ok(len @ 1..) = output.read(&mut bytes) {
                    let text = String::from_utf8_lossy(&bytes[..len]).into_owned();
                    screen
                        .lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .push_str(&text);
                }
            });
        }
        Self {
            keyboard: child.stdin.take(),
            child,
            screen,
        }
    }

    /// Types a line.
    ///
    /// # Panics
    /// If the program has gone.
    pub fn types(&mut self, line: &str) {
        let typed = self
            .keyboard
            .as_mut()
            .map(|keyboard| writeln!(keyboard, "{line}"));
        assert!(matches!(typed, Some(Ok(()))), "{line}: {}", self.screen());
    }

    /// Everything on the screen so far.
    pub fn screen(&self) -> String {
        self.screen.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Types a line again and again until the screen shows `text` behind it.
    ///
    /// # Panics
    /// If it never does.
    pub fn types_until(&mut self, line: &str, text: &str) {
        let before = self.screen().len();
        let begin = Instant::now();
        loop {
            self.types(line);
            for _ in 0..20 {
                if self.screen().get(before..).is_some_and(|new| new.contains(text)) {
                    return;
                }
                std::thread::sleep(Duration::from_millis(100));
            }
            let screen = self.screen();
            assert!(
                begin.elapsed() < PATIENCE,
                "{line:?} was never answered with {text:?}:\n{screen}"
            );
        }
    }

    /// Closes the keyboard and waits for the end; the screen.
    pub fn close(mut self) -> String {
        self.keyboard = None;
        end(&mut self.child);
        self.screen()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.keyboard = None;
        end(&mut self.child);
    }
}

/// Waits for a child that has been asked to end, and ends it if it does not.
fn end(child: &mut Child) {
    let begin = Instant::now();
    while matches!(child.try_wait(), Ok(None)) && begin.elapsed() < Duration::from_secs(10) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let _gone_already = child.kill();
    let _not_ours = child.wait();
}

/// The simulated autopilot, the gateway, the parameters and the ground services, and nothing that flies.
pub const GATEWAY_ONLY: &str = r#"
[[process]]
name = "recorder"
program = "jink-recorder"
when = "recording"
essential = false
on_failure = "ignore"
shadow = false
heartbeat_timeout_ms = 2000

[[process]]
name = "simulator"
program = "jink-simulator"
arguments = ["vehicle"]
when = "simulated_vehicle"
heartbeat_timeout_ms = 500

[[process]]
name = "mavlink_gateway"
program = "jink-mavlink-gateway"
output = true

[[process]]
name = "parameter_server"
program = "jink-parameter-server"
essential = false
on_failure = "ignore"
shadow = false

[[process]]
name = "ground_services"
program = "jink-ground-services"
essential = false
on_failure = "ignore"
shadow = false
"#;

/// The process table of a host with nothing but an autopilot and its vehicle.
pub const AUTOPILOT_ONLY: &str = r#"
[[process]]
name = "simulator"
program = "jink-simulator"
arguments = ["vehicle"]
when = "simulated_vehicle"
heartbeat_timeout_ms = 500
"#;

/// A jink with a simulated autopilot and links for ground stations.
#[derive(Debug)]
pub struct Network {
    system: System,
    /// UDP ports of the links for ground stations.
    pub ports: Vec<u16>,
    /// Its configuration; goes after the system that reads it.
    pub folder: TempFolder,
}

impl Network {
    /// Comes up with a link for each of `links`: its name, and further lines of its table. `services` is the process table;
    /// `None` = the usual one.
    ///
    /// # Panics
    /// If it does not come up: the text says why.
    pub fn up(role: &str, services: Option<&str>, links: &[(&str, &str)], sets: &[&str]) -> Self {
        let folder = TempFolder::with_config(role);
        if let Some(services) = services {
            folder.write("services.toml", services);
        }
        let mut config = std::fs::read_to_string(folder.path().join("jink.toml")).expect("the configuration");
        let mut ports = free_udp_ports(1 + links.len());
        let first = ports.remove(0);
        for ((name, further), port) in links.iter().zip(&ports) {
            // Writing into a string cannot fail.
            let _infallible = write!(
                config,
                "\n[[link.also]]\nname = \"{name}\"\naddress = \"udpin:127.0.0.1:{port}\"\n{further}\n"
            );
        }
        folder.write("jink.toml", &config);
        let address = format!("link.address=udpin:127.0.0.1:{first}");
        // Messages are what matters here: with a lidar that answers where there is nothing, too.
        let mut arguments = vec![
            "--world",
            "empty",
            "--sensor",
            "sphere",
            "--config",
            folder.text(),
        ];
        for set in [address.as_str(), "simulation.ground_station_port=0"]
            .iter()
            .chain(sets)
        {
            arguments.extend(["--set", set]);
        }
        let system = System::up(role, &arguments);
        Self {
            system,
            ports,
            folder,
        }
    }

    /// What `jink param list --json` says.
    ///
    /// # Panics
    /// If it says nothing that can be read.
    pub fn parameters(&self) -> Vec<Value> {
        let listed = self.jink(&["param", "list", "--json"]);
        listed
            .stdout
            .lines()
            .map(|line| serde_json::from_str(line).expect("a parameter in JSON"))
            .collect()
    }
}

impl Deref for Network {
    type Target = System;
    fn deref(&self) -> &System {
        &self.system
    }
}
