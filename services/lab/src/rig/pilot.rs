//! The ground station that uploads the mission, arms and starts it: `jink-simulator fly` as a child.

use super::Plan;
use jink_control::{Problem, places};
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::process::{Child, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};

/// The running ground station; it ends with this.
pub struct Pilot {
    child: Child,
    lines: Receiver<String>,
    last_words: String,
}

impl Pilot {
    /// Starts it on the port to which the simulated autopilot sends.
    pub fn start(plan: &Plan, port: u16) -> Result<Self, Problem> {
        let mut command = places::program(&plan.programs, "jink-simulator")?;
        command.args(["fly", "--port", &port.to_string()]);
        command.args(["--world", &plan.world, "--seed", &plan.seed.to_string()]);
        command.args(["--legs", &plan.legs.to_string()]);
        command.args(["--timeout", &plan.limit_s.to_string()]);
        if let Some(density) = plan.density {
            command.args(["--density", &density.to_string()]);
        }
        if let Some(speed) = plan.speed {
            command.args(["--speed", &speed.to_string()]);
        }
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0);
        let mut child = command.spawn().map_err(Problem::io("jink-simulator fly"))?;
        let (sender, lines) = channel();
        if let Some(stdout) = child.stdout.take() {
            forward(stdout, sender.clone());
        }
        if let Some(stderr) = child.stderr.take() {
            forward(stderr, sender);
        }
        Ok(Self {
            child,
            lines,
            last_words: String::new(),
        })
    }

    /// What it said since the last call, one event per line.
    pub fn update(&mut self) -> Vec<String> {
        let lines: Vec<String> = self.lines.try_iter().map(|line| plain(&line)).collect();
        if let Some(last) = lines.last() {
            self.last_words.clone_from(last);
        }
        lines
    }

    /// The last thing it said.
    pub fn last_words(&self) -> &str {
        &self.last_words
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>, Problem> {
        self.child.try_wait().map_err(Problem::io("jink-simulator fly"))
    }
}

impl Drop for Pilot {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _gone_already = self.child.kill();
        let _gone_already = self.child.wait();
    }
}

/// Reads lines in a thread of its own, until the other end closes.
fn forward(stream: impl Read + Send + 'static, sender: Sender<String>) {
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
}

/// The words of a JSON line, or the line itself.
fn plain(line: &str) -> String {
    let json: Option<serde_json::Value> = serde_json::from_str(line).ok();
    let words = json.as_ref().and_then(|json| {
        ["message", "text", "event"]
            .iter()
            .find_map(|key| json.get(key)?.as_str())
    });
    words.unwrap_or(line).to_owned()
}
