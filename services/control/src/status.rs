//! The state of a running system on one screen, and as JSON for scripts.

mod links;
mod profile;

pub use links::{LinkFigures, Refused};
pub use profile::unfit;

use crate::figures::{StageLatency, exit_text, latency_ms, latency_text, round};
use crate::known_space::KnownSpace;
use crate::planned_speed::PlannedSpeed;
use crate::watch::Watch;
use jink_runtime::Instance;
use jink_shared_types::health::{
    Health, ProcessStatus, ReplaceReason, ServiceState, SwapPhase, SystemStatus,
};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::topics::LINK_STATUS;
use jink_shared_types::{Stamped, Timestamp};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Everything there is to show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the instance.
    pub instance: String,
    /// Health of the whole.
    pub health: String,
    /// Time since the supervisor started (s).
    pub uptime_s: f64,
    /// Process id of the supervisor.
    pub supervisor_pid: u32,
    /// The processes, in start order.
    pub services: Vec<Service>,
    /// The link to the autopilot; `None` if the gateway has said nothing.
    pub link: Option<Link>,
    /// What it flies through, and whether its sensors suffice; `None` if map or planner say nothing.
    pub space: Option<KnownSpace>,
    /// How fast plans get; `None` if the planner does not say.
    pub speed: Option<PlannedSpeed>,
    /// Whether there is room for the logs.
    pub logs_have_room: bool,
    /// How processes ended that ended.
    pub ends: Vec<PostMortem>,
}

/// How a process ended last, as the supervisor wrote it down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PostMortem {
    /// The process.
    pub process: String,
    /// Which start of it.
    pub generation: u32,
    /// Its process id.
    pub pid: u32,
    /// Exit status or signal.
    pub exit: String,
    /// Time from its start to its end (s).
    pub lived_s: f64,
    /// When: seconds since 1970.
    pub unix_s: f64,
    /// State in its last heartbeat.
    pub state: String,
    /// Cycles it had run.
    pub cycles: u64,
    /// Its last cycle (us).
    pub cycle_last_us: u32,
    /// Its longest cycle (us).
    pub cycle_max_us: u32,
    /// The last lines it wrote, oldest first.
    pub last_lines: Vec<String>,
    /// Where to look for a core dump, or why there is none.
    pub core: Option<String>,
}

impl PostMortem {
    /// For people, at `unix_s`.
    fn text(&self, unix_s: f64) -> String {
        let mut out = format!(
            "{} (start {}, process id {}) ended {} ago with {}, after {} and {} cycles, {} then\n",
            self.process,
            self.generation,
            self.pid,
            duration(unix_s - self.unix_s),
            self.exit,
            duration(self.lived_s),
            self.cycles,
            self.state
        );
        if let Some(core) = &self.core {
            // Writing into a string cannot fail.
            let _infallible = writeln!(out, "      core dump: {core}");
        }
        let shown = self.last_lines.len().saturating_sub(LAST_LINES);
        for line in &self.last_lines[shown..] {
            let _infallible = writeln!(out, "      | {line}");
        }
        out
    }
}

/// Lines of a dead process that a screen has room for; `--json` has all.
const LAST_LINES: usize = 3;

/// One process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Service {
    /// Name in the process table.
    pub name: String,
    /// Process id; `None` if it does not run.
    pub pid: Option<u32>,
    /// State as the supervisor judges it.
    pub state: String,
    /// The system cannot fly without it.
    pub essential: bool,
    /// Which start of it this is; 0 = never seen.
    pub generation: u32,
    /// Time since this start (s); `None` if it does not run.
    pub uptime_s: Option<f64>,
    /// Restarts since the system came up.
    pub restarts: u32,
    /// How it ended last; `None` = never.
    pub last_exit: Option<String>,
    /// Why it was replaced last; `None` = never.
    pub reason: Option<String>,
    /// Where a hot swap of it stands; `None` = there is none.
    pub swap: Option<String>,
    /// Process id of its second instance; `None` = there is none.
    pub shadow_pid: Option<u32>,
    /// CPU used since its start (% of one core).
    pub cpu_percent: Option<f64>,
    /// Outputs over the end-to-end budget since its start.
    pub late_outputs: u64,
    /// From its last death to the first heartbeat of its replacement's loop (ms); `None` = no restart yet.
    pub recovery_ms: Option<f64>,
    /// Time since its last heartbeat (ms); `None` = none yet.
    pub heartbeat_age_ms: Option<f64>,
    /// Median cycle of the last seconds (us).
    pub cycle_p50_us: u32,
    /// 99th percentile of the last seconds (us).
    pub cycle_p99_us: u32,
    /// Longest cycle since the start (us).
    pub cycle_max_us: u32,
    /// Cycle budget (us); 0 = none.
    pub budget_us: u32,
    /// Cycles over budget.
    pub budget_misses: u64,
    /// Inputs that were late.
    pub deadline_misses: u64,
    /// CPU time since the start (ms).
    pub cpu_ms: u32,
    /// Inputs it needs.
    pub inputs_needed: u32,
    /// Of those, how many are fresh.
    pub inputs_fresh: u32,
}

/// The link to the autopilot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Link {
    /// Age of these figures (ms).
    pub age_ms: f64,
    /// The autopilot has been seen within 1.5 s.
    pub autopilot_alive: bool,
    /// Its MAVLink system id; 0 = not known.
    pub system_id: u8,
    /// What the avoidance heartbeat says.
    pub avoidance: String,
    /// How setpoints are sent; empty = not chosen yet.
    pub profile: String,
    /// Whether that fits the autopilot.
    pub profile_fit: String,
    /// Whether a pilot is assisted.
    pub assist: String,
    /// Why jink is not ready, and what to do; `None` if the profile fits.
    pub unfit: Option<String>,
    /// Rate of the autopilot's clock (1 = that of the board).
    pub clock_rate: f64,
    /// The autopilot's clock is mapped.
    pub timesync_converged: bool,
    /// Shortest round trip of a time synchronisation (ms).
    pub round_trip_ms: f64,
    /// Bytes that belonged to no message.
    pub garbage_bytes: u64,
    /// Messages that could not be decoded, or came from somebody who does not concern us.
    pub ignored: u64,
    /// Setpoints sent.
    pub setpoints: u64,
    /// Largest time between two of them (ms).
    pub setpoint_gap_max_ms: f64,
    /// Capture of the newest range behind a setpoint to its bytes handed to the kernel, median (ms); `None` before the first.
    pub capture_to_wire_p50_ms: Option<f64>,
    /// 99th percentile (ms).
    pub capture_to_wire_p99_ms: Option<f64>,
    /// Longest (ms).
    pub capture_to_wire_max_ms: Option<f64>,
    /// What each stage adds to it.
    pub stages: Vec<StageLatency>,
    /// Each link by itself, the autopilot's first.
    pub links: Vec<LinkFigures>,
    /// What becomes of the telemetry log.
    pub telemetry_log: String,
}

impl Report {
    /// The report of a running `instance` now: what `jink status` and the live page show. `space` and `speed` are what map and planner
    /// say ([`crate::watch::SpaceWatch`]).
    pub fn of_instance(
        instance: &Instance,
        status: &SystemStatus,
        watch: &mut Watch,
        space: Option<KnownSpace>,
        speed: Option<PlannedSpeed>,
    ) -> Self {
        let ends = post_mortems(instance, status);
        Self::new(
            &instance.to_string(),
            jink_runtime::now(),
            status,
            watch.link(),
            ends,
        )
        .with_space(space)
        .with_speed(speed)
        .with_log_room(instance.logs_have_room() && !instance.logs_lost().exists())
    }

    /// As `jink status --json` prints it: one JSON object in one line.
    ///
    /// # Errors
    /// Those of the JSON library; none is known.
    pub fn json(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }

    /// The report of `instance` at `now`.
    pub fn new(
        instance: &str,
        now: Timestamp,
        status: &SystemStatus,
        link: Option<Stamped<'_, LinkStatus>>,
        ends: Vec<PostMortem>,
    ) -> Self {
        Self {
            ends,
            logs_have_room: true,
            space: None,
            speed: None,
            instance: instance.to_owned(),
            health: status.health.get().to_string(),
            uptime_s: round(now.seconds_since(status.started)),
            supervisor_pid: status.pid,
            services: status
                .processes()
                .iter()
                .map(|process| Service::new(now, process))
                .collect(),
            link: link.map(|link| Link::new(now, link, gateway_uptime_s(now, status))),
        }
    }

    /// The same with what map and planner say.
    pub fn with_space(mut self, space: Option<KnownSpace>) -> Self {
        self.space = space;
        self
    }

    /// The same with whether there is room for the logs.
    pub fn with_log_room(mut self, logs_have_room: bool) -> Self {
        self.logs_have_room = logs_have_room;
        self
    }

    /// The same with how fast plans get.
    pub fn with_speed(mut self, speed: Option<PlannedSpeed>) -> Self {
        self.speed = speed;
        self
    }

    /// Whether jink is not ready, however well its services are: the profile is not for the autopilot, or sensors do not suffice.
    pub fn is_unfit(&self) -> bool {
        let link = self.link.as_ref().is_some_and(|link| link.unfit.is_some());
        link || self
            .space
            .as_ref()
            .is_some_and(|space| space.cannot_plan.is_some())
    }

    /// For people, at `unix_s` (seconds since 1970): one line per service, then the link, then who ended how.
    pub fn text(&self, unix_s: f64) -> String {
        let restarts: u32 = self.services.iter().map(|service| service.restarts).sum();
        let mut out = format!(
            "jink {}: {}{}, up {}, {} restart{}\n\n",
            self.instance,
            self.health,
            if self.is_unfit() { ", NOT READY" } else { "" },
            duration(self.uptime_s),
            restarts,
            if restarts == 1 { "" } else { "s" }
        );
        write_table(&mut out, &self.table());
        out.push('\n');
        out.push_str(&self.link.as_ref().map_or_else(
            || "link: the gateway has said nothing yet\n".to_owned(),
            |link| link.line() + &LinkFigures::lines(&link.links) + link.log_line(),
        ));
        if let Some(space) = &self.space {
            out.push_str(&space.lines());
        }
        if let Some(speed) = &self.speed {
            out.push_str(&speed.line());
        }
        out.push_str(&self.late_line());
        if !self.logs_have_room {
            out.push_str("logs: full\n");
        }
        if !self.ends.is_empty() {
            out.push('\n');
        }
        for end in &self.ends {
            out.push_str(&end.text(unix_s));
        }
        out
    }
}

impl Report {
    /// Which services have put out samples older than their end-to-end budget.
    fn late_line(&self) -> String {
        let late: Vec<String> = self
            .services
            .iter()
            .filter(|service| service.late_outputs > 0)
            .map(|service| format!("{} {}", service.name, service.late_outputs))
            .collect();
        if late.is_empty() {
            return String::new();
        }
        format!("late outputs since the start: {}\n", late.join(", "))
    }

    /// The services as a table, the first row its header.
    pub fn table(&self) -> Vec<[String; COLUMNS]> {
        std::iter::once(HEADER.map(str::to_owned))
            .chain(self.services.iter().map(Service::cells))
            .collect()
    }

    /// The same in the columns that matter most, for a screen of 80.
    pub fn narrow_table(&self) -> Vec<[String; NARROW_COLUMNS]> {
        std::iter::once(NARROW_HEADER.map(str::to_owned))
            .chain(self.services.iter().map(Service::narrow_cells))
            .collect()
    }
}

/// What the supervisor has written down about processes that ended.
fn post_mortems(instance: &Instance, status: &SystemStatus) -> Vec<PostMortem> {
    let read = |name: &str| {
        let text = std::fs::read_to_string(instance.post_mortem(name)).ok()?;
        serde_json::from_str(&text).ok()
    };
    let processes = status.processes().iter();
    processes
        .filter_map(|process| read(process.heartbeat.name.as_str()))
        .collect()
}

/// Exit code of `jink status`: 0 healthy, 1 degraded, starting or stopping, 2 failed.
pub fn exit_code(health: Health) -> u8 {
    match health {
        Health::Healthy => 0,
        Health::Starting | Health::Degraded | Health::Stopping => 1,
        Health::Failed => 2,
    }
}

/// What the columns of the table of services say, for the help of whatever shows it.
pub const LEGEND: &str = "\
Columns of the services:
  state      active, or why not; ! it is essential and not active
  restarts   since the system came up; last exit is how it ended, and why it was replaced
  beat ms    age of its last heartbeat: one comes every 50 ms, and two missed ones are a hang (heartbeat_timeout_ms)
  cycle ms   how long it computed each time, in the last seconds: median, 99th percentile, and the longest since its start
  budget ms  how long a cycle may be
  misses     cycles over the budget, and inputs that came too late
  inputs     how many of the inputs that it needs are fresh, of how many
  cpu %      of one core, since its start
";

/// Columns of the table of services.
pub const COLUMNS: usize = 12;
const HEADER: [&str; COLUMNS] = [
    "service",
    "state",
    "pid",
    "up",
    "restarts",
    "last exit",
    "beat ms",
    "cycle ms p50/p99/max",
    "budget ms",
    "misses",
    "inputs",
    "cpu %",
];

/// Columns of the table of services on a narrow screen.
pub const NARROW_COLUMNS: usize = 8;
const NARROW_HEADER: [&str; NARROW_COLUMNS] = [
    "service", "state", "pid", "restarts", "p99 ms", "misses", "inputs", "cpu %",
];

impl Service {
    fn new(now: Timestamp, process: &ProcessStatus) -> Self {
        let beat = &process.heartbeat;
        let runs = process.pid != 0;
        let ended = process.restarts > 0 || process.last_exit != 0;
        Self {
            name: beat.name.as_str().to_owned(),
            pid: runs.then_some(process.pid),
            state: process.state.get().to_string(),
            essential: process.essential.is_set(),
            generation: beat.generation,
            uptime_s: runs.then(|| round(now.seconds_since(process.started))),
            restarts: process.restarts,
            last_exit: ended.then(|| exit_text(process.last_exit)),
            reason: (process.reason != ReplaceReason::Never).then(|| process.reason.get().to_string()),
            swap: (process.swap != SwapPhase::Idle).then(|| process.swap.get().to_string()),
            shadow_pid: (process.shadow_pid != 0).then_some(process.shadow_pid),
            cpu_percent: runs
                .then(|| now.seconds_since(process.started))
                .filter(|up_s| *up_s > 0.0)
                .map(|up_s| round(f64::from(beat.cpu_ms) * 0.1 / up_s)),
            late_outputs: beat.late_outputs,
            recovery_ms: (process.recovery_us > 0).then(|| round(f64::from(process.recovery_us) * 1e-3)),
            heartbeat_age_ms: process
                .heartbeat_time
                .is_set()
                .then(|| round(now.seconds_since(process.heartbeat_time) * 1e3)),
            cycle_p50_us: beat.cycle_p50_us,
            cycle_p99_us: beat.cycle_p99_us,
            cycle_max_us: beat.cycle_max_us,
            budget_us: process.cycle_budget_us,
            budget_misses: beat.budget_misses,
            deadline_misses: beat.deadline_misses,
            cpu_ms: beat.cpu_ms,
            inputs_needed: beat.inputs_needed.count_ones(),
            inputs_fresh: (beat.inputs_fresh & beat.inputs_needed).count_ones(),
        }
    }

    fn narrow_cells(&self) -> [String; NARROW_COLUMNS] {
        let [name, state, pid, _, restarts, _, _, _, _, misses, inputs, cpu] = self.cells();
        let p99_ms = format!("{:.1}", f64::from(self.cycle_p99_us) * 1e-3);
        [name, state, pid, restarts, p99_ms, misses, inputs, cpu]
    }

    fn cells(&self) -> [String; COLUMNS] {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let ms = |us: u32| format!("{:.1}", f64::from(us) * 1e-3);
        let mark = if self.state == ServiceState::Active.to_string() || !self.essential {
            ""
        } else {
            " !"
        };
        [
            self.name.clone(),
            match (&self.swap, self.shadow_pid) {
                (Some(phase), _) => format!("{}{mark} (swap: {phase})", self.state),
                (None, Some(_)) => format!("{}{mark} (shadow)", self.state),
                (None, None) => format!("{}{mark}", self.state),
            },
            or_dash(self.pid.map(|pid| pid.to_string())),
            or_dash(self.uptime_s.map(duration)),
            self.restarts.to_string(),
            or_dash(match (&self.last_exit, &self.reason) {
                (Some(exit), Some(reason)) => Some(format!("{exit}, {reason}")),
                (exit, reason) => exit.clone().or(reason.clone()),
            }),
            or_dash(self.heartbeat_age_ms.map(|age| format!("{age:.0}"))),
            [self.cycle_p50_us, self.cycle_p99_us, self.cycle_max_us]
                .map(ms)
                .join(" / "),
            if self.budget_us == 0 {
                "-".to_owned()
            } else {
                ms(self.budget_us)
            },
            format!("{}", self.budget_misses + self.deadline_misses),
            format!("{}/{}", self.inputs_fresh, self.inputs_needed),
            or_dash(self.cpu_percent.map(|percent| format!("{percent:.1}"))),
        ]
    }
}

/// How long the process behind the link's figures has been running (s).
fn gateway_uptime_s(now: Timestamp, status: &SystemStatus) -> Option<f64> {
    let gateway = |process: &&ProcessStatus| LINK_STATUS.row.may_publish(process.heartbeat.name.as_str());
    let gateway = status.processes().iter().find(gateway)?;
    (gateway.pid != 0).then(|| now.seconds_since(gateway.started))
}

impl Link {
    fn new(now: Timestamp, link: Stamped<'_, LinkStatus>, uptime_s: Option<f64>) -> Self {
        let [p50_ms, p99_ms, max_ms] = latency_ms(&link.sample.capture_to_wire);
        let us = |us: f64| round(us * 1e-3);
        Self {
            age_ms: round(now.seconds_since(link.header.publish) * 1e3),
            autopilot_alive: link.sample.autopilot_alive.is_set(),
            system_id: link.sample.system_id,
            avoidance: link.sample.avoidance.get().to_string(),
            profile: link.sample.profile.as_str().to_owned(),
            profile_fit: link.sample.profile_fit.get().to_string(),
            assist: link.sample.assist.get().to_string(),
            unfit: unfit(link.sample).map(|[is, remedy]| format!("{is}; {remedy}")),
            clock_rate: 1.0 + f64::from(link.sample.clock_rate_ppm) * 1e-6,
            timesync_converged: link.sample.timesync_converged.is_set(),
            round_trip_ms: us(f64::from(link.sample.round_trip_us)),
            garbage_bytes: link.sample.garbage_bytes,
            ignored: link.sample.ignored,
            setpoints: link.sample.setpoints,
            setpoint_gap_max_ms: us(f64::from(link.sample.setpoint_gap_max_us)),
            capture_to_wire_p50_ms: p50_ms,
            capture_to_wire_p99_ms: p99_ms,
            capture_to_wire_max_ms: max_ms,
            stages: StageLatency::of(&link.sample.stages, &link.sample.hops),
            links: LinkFigures::of(link.sample, uptime_s),
            telemetry_log: link.sample.telemetry_log.get().to_string(),
        }
    }

    /// Only a telemetry log that has ended is worth a line.
    fn log_line(&self) -> &'static str {
        match self.telemetry_log.as_str() {
            "full" => "telemetry log: full\n",
            _ => "",
        }
    }

    /// For people: which autopilot is seen, the clock, the setpoints, and the way from capture to wire.
    pub fn line(&self) -> String {
        if !self.autopilot_alive {
            return format!(
                "link: the autopilot is not connected ({} bytes that are no MAVLink, {} messages of others)\n",
                self.garbage_bytes, self.ignored
            );
        }
        let clock = if self.timesync_converged && self.clock_rate != 1.0 {
            format!(
                "clock mapped (round trip {:.1} ms, runs at {:.4})",
                self.round_trip_ms, self.clock_rate
            )
        } else if self.timesync_converged {
            format!("clock mapped (round trip {:.1} ms)", self.round_trip_ms)
        } else {
            "clock not mapped yet".to_owned()
        };
        let stages = match self.stages.as_slice() {
            [] => String::new(),
            stages => format!("      of that p50/p99: {}\n", StageLatency::line(stages)),
        };
        let profile = match (&self.unfit, self.profile.as_str()) {
            (Some(unfit), _) => format!("      NOT READY: {unfit}\n"),
            (None, "") => "      profile not chosen yet\n".to_owned(),
            (None, profile) => format!("      profile {profile}\n"),
        };
        let assist = match self.assist.as_str() {
            "off" => String::new(),
            assist => format!("      assisted flight {assist}\n"),
        };
        format!(
            "link: autopilot {} connected, {clock}, avoidance {}\n{profile}{assist}      {} setpoints, largest gap {:.0} ms; capture to \
             wire {}\n{stages}",
            self.system_id,
            self.avoidance,
            self.setpoints,
            self.setpoint_gap_max_ms,
            latency_text([
                self.capture_to_wire_p50_ms,
                self.capture_to_wire_p99_ms,
                self.capture_to_wire_max_ms
            ])
        )
    }
}

/// Appends `rows` with every column as wide as its widest cell.
pub fn write_table<const COLUMNS: usize>(out: &mut String, rows: &[[String; COLUMNS]]) {
    let widths: [usize; COLUMNS] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].len()).max().unwrap_or(0));
    for row in rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            // Writing into a string cannot fail.
            let _infallible = write!(line, "{cell:<width$}  ");
        }
        out.push_str(line.trim_end());
        out.push('\n');
    }
}

/// `12 s`, `3 min 5 s`, `2 h 4 min`.
fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0) as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests;
