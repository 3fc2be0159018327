//! How a process ended, kept until it ends again or the system stops: exit, last log lines, last heartbeat, and where a
//! core dump would be. `jink status` shows it.

use crate::supervision::{Exit, Supervision};
use jink_runtime::Instance;
use rustix::process::{Resource, getrlimit};
use serde::Serialize;
use std::time::{SystemTime, UNIX_EPOCH};

/// Signals that leave a core dump where that is allowed (signal(7)).
const CORE_SIGNALS: [u8; 10] = [3, 4, 5, 6, 7, 8, 11, 24, 25, 31];

/// One end.
#[derive(Debug, Serialize)]
pub struct PostMortem {
    process: String,
    generation: u32,
    pid: u32,
    exit: String,
    /// Time from its start to its end (s).
    lived_s: f64,
    /// Seconds since 1970.
    unix_s: f64,
    state: String,
    cycles: u64,
    cycle_last_us: u32,
    cycle_max_us: u32,
    last_lines: Vec<String>,
    core: Option<String>,
}

impl PostMortem {
    /// Of process `index`, which has just been found dead.
    pub fn new(
        supervision: &Supervision,
        index: usize,
        exit: Exit,
        lived_s: f64,
        last_lines: Vec<String>,
    ) -> std::io::Result<Self> {
        let heartbeat = supervision
            .heartbeat(index)
            .ok_or_else(|| std::io::Error::other("no such process"))?;
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Ok(Self {
            process: heartbeat.name.as_str().to_owned(),
            generation: heartbeat.generation,
            pid: heartbeat.pid,
            exit: exit.to_string(),
            lived_s,
            unix_s: since_1970.map_or(0.0, |time| time.as_secs_f64()),
            state: heartbeat.state.get().to_string(),
            cycles: heartbeat.cycles,
            cycle_last_us: heartbeat.cycle_last_us,
            cycle_max_us: heartbeat.cycle_max_us,
            last_lines,
            core: core_hint(exit),
        })
    }

    /// Logs it.
    pub fn log(&self) {
        tracing::error!(
            process = self.process,
            lived_s = self.lived_s,
            last_lines = self.last_lines.join("\n"),
            "ended: {}",
            self.exit
        );
    }

    /// Writes it down, in place of the one before.
    pub fn write(&self, instance: &Instance) -> std::io::Result<()> {
        let text = serde_json::to_string(self).map_err(std::io::Error::other)?;
        let path = instance.post_mortem(&self.process);
        let new = path.with_extension("new");
        std::fs::write(&new, text)?;
        std::fs::rename(new, path)
    }
}

/// Where to look for a core dump, or why there is none.
fn core_hint(exit: Exit) -> Option<String> {
    let Exit::Signal(signal) = exit else {
        return None;
    };
    if !CORE_SIGNALS.contains(&signal) {
        return None;
    }
    if getrlimit(Resource::Core).current == Some(0) {
        return Some(
            "none was written: the limit is 0 (`ulimit -c unlimited`, LimitCORE= in systemd)".to_owned(),
        );
    }
    let pattern = std::fs::read_to_string("/proc/sys/kernel/core_pattern").ok()?;
    Some(format!("kernel.core_pattern is {:?}", pattern.trim()))
}
