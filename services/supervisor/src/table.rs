//! The process table (`services.toml`): which processes there are, in which order they start, and what is expected of
//! each.
//!
//! | key | default | meaning |
//! |---|---|---|
//! | `name` | - | name in logs, status and commands; 1 to 20 lower-case letters, digits, underscores |
//! | `program` | - | one of jink's programs, a file beside jink, or an absolute path |
//! | `arguments` | `[]` | arguments of this kind of service after `--` |
//! | `arguments_external` | as `arguments` | the same where the autopilot is not the simulated one |
//! | `when` | `"always"` | `"always"`, `"real"`, `"simulated_vehicle"`, `"virtual_world"` (sensors are rendered), `"recording"` (recordings, logs or telemetry logs have a folder on a disk), `"viewer"` (the live page has an address) |
//! | `per_sensor` | none | one process for each `[[sensor]]` of this kind that has a `device`; its name stands for `{sensor}` in `name` and `arguments` |
//! | `publishes`, `reads` | none | topics that a process called `user_...` may use besides what is open to everybody ([`Foreign`]) |
//! | `output` | `false` | it sends to the autopilot: `on_failure = "stop_output"` stops it |
//! | `essential` | `true` | the system cannot fly without it |
//! | `cycle_budget_us` | `0` | longest cycle; 0 = none |
//! | `end_to_end_ms` | `0` | oldest range data behind an output; older ones are reported with the stage that took most of the time; 0 = any |
//! | `slow` | `{ event = 3, degrade = 5, replace = 9 }` | what so many cycles over budget within a second lead to; 0 = never |
//! | `shadow` | `true` | the program can run as a second instance that publishes nothing (`--shadow`); without it a swap ends the old one first |
//! | `hot_shadow` | `false` | a second instance runs beside it and takes over when it dies |
//! | `heartbeat_timeout_ms` | `100` | silence that counts as a hang: two heartbeat periods, so that one late heartbeat is none |
//! | `start_grace_ms` | `3000` | time from start to the first heartbeat of its loop: opening devices may take that long |
//! | `restart` | see `RestartRule::default` | `{ floor_ms, ceiling_ms, factor, intensity, period_s }` |
//! | `on_failure` | `"hold"` | see [`OnFailure`] |
//! | `core`, `priority`, `lock_memory` | none, `0`, `false` | CPU to stay on, SCHED_FIFO priority, pages kept in memory |
//! | `log` | the supervisor's | `"error"`, `"warn"`, `"info"`, `"debug"`, `"trace"` |
//!
//! A `[defaults]` section may give any key but the first nine; a row wins over it. Whatever is not understood is
//! refused with file, line and the nearest valid word. The same file declares topics of others, `[[topic]]`
//! ([`Foreign`]).

mod check;

use crate::policy::RestartRule;
use crate::slowness::SlowRule;
use jink_runtime::config::{
    Config, ConfigError, Foreign, Grants, PROCESS_FILE, Sensor, all_mistakes, line_of, of_sensor, parse_toml,
    plugged_in, read,
};
use jink_runtime::{Instance, programs, spool};
use jink_shared_types::topics::FINGERPRINT;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use toml::Spanned;

/// What flies and where the sensors' data come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// A real vehicle with real sensors.
    Real,
    /// An external autopilot (real, or another simulator's) in a virtual world: only the sensors are rendered.
    VirtualWorld,
    /// Vehicle, autopilot and sensors are simulated.
    SimulatedVehicle,
}

impl Mode {
    /// Every mode with its name on the command line.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("real", Self::Real),
        ("virtual_world", Self::VirtualWorld),
        ("simulated_vehicle", Self::SimulatedVehicle),
    ];
}

/// In which modes a process is started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// In all.
    Always,
    /// Where the sensors are real.
    Real,
    /// Where the vehicle is simulated.
    SimulatedVehicle,
    /// Where sensors are rendered, around the simulated or an external vehicle.
    VirtualWorld,
    /// Where something is to be kept on a disk: recordings, logs, telemetry logs.
    Recording,
    /// Where the live page is to be served.
    Viewer,
}

impl When {
    /// Whether the process runs in `mode` with `config`.
    pub fn includes(self, mode: Mode, config: &Config) -> bool {
        match self {
            Self::Always => true,
            Self::Real => mode == Mode::Real,
            Self::SimulatedVehicle => mode == Mode::SimulatedVehicle,
            Self::VirtualWorld => mode != Mode::Real,
            Self::Recording => config.recorder.folder.is_some() || spool::is_wanted(config),
            Self::Viewer => config.viewer.address.is_some(),
        }
    }
}

/// What happens when a process has been given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnFailure {
    /// The system counts as failed and everything else continues: the committed stop is flown and the gateway keeps
    /// the autopilot holding.
    Hold,
    /// The system counts as failed and the row with `output = true` is stopped as well, so that the autopilot's own
    /// fail-safe for a lost companion decides what happens next.
    StopOutput,
    /// Nothing: the system counts as degraded at most.
    Ignore,
    /// The whole system is stopped.
    Shutdown,
}

/// One process as the state machine needs to know it.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessRules {
    /// Name.
    pub name: String,
    /// The system cannot fly without it.
    pub essential: bool,
    /// It sends to the autopilot: [`OnFailure::StopOutput`] of another process stops it.
    pub is_output: bool,
    /// Longest cycle (us); 0 = none.
    pub cycle_budget_us: u32,
    /// Oldest range data behind an output (us); 0 = any.
    pub end_to_end_us: u32,
    /// What cycles over budget lead to.
    pub slow: SlowRule,
    /// Its program can run as a second instance that publishes nothing.
    pub has_shadow: bool,
    /// A second instance runs beside it and takes over when it dies.
    pub hot_shadow: bool,
    /// Silence that counts as a hang (s).
    pub heartbeat_timeout_s: f64,
    /// Time from its start to the first heartbeat of its loop (s).
    pub start_grace_s: f64,
    /// How it is restarted.
    pub restart: RestartRule,
    /// What happens when it has been given up.
    pub on_failure: OnFailure,
}

/// One row of the table, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessRow {
    /// What the state machine needs.
    pub rules: ProcessRules,
    /// Program: a name beside the supervisor's own, or an absolute path.
    pub program: PathBuf,
    /// The name that it is started under, whichever file it is in.
    pub program_name: OsString,
    /// Arguments of this kind of service.
    pub arguments: Vec<String>,
    /// The same where the autopilot is an external one; `None` = no difference.
    pub arguments_external: Option<Vec<String>>,
    /// In which modes it runs.
    pub when: When,
    /// Kind of the sensors that have such a process each.
    pub per_sensor: Option<String>,
    /// Topics that it may use besides what is open to everybody.
    pub grants: Grants,
    /// Core to stay on.
    pub core: Option<usize>,
    /// SCHED_FIFO priority, 0 = ordinary scheduling.
    pub priority: u8,
    /// Keep all pages in memory.
    pub lock_memory: bool,
    /// Log level; `None` = the supervisor's.
    pub log: Option<tracing::Level>,
    /// Where in the table it stands, for errors.
    pub line: usize,
}

/// The whole table, in start order.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessTable {
    /// File it came from.
    pub file: PathBuf,
    /// Rows.
    pub rows: Vec<ProcessRow>,
}

impl ProcessTable {
    /// Reads `services.toml` in `folder`.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let file = folder.join(PROCESS_FILE);
        let text = read(&file)?;
        Self::parse(&file, &text)
    }

    /// Reads the text of a table; `file` only appears in errors.
    ///
    /// # Errors
    /// [`ConfigError`] naming file and line.
    pub fn parse(file: &Path, text: &str) -> Result<Self, ConfigError> {
        let parsed: File = parse_toml(file, text)?;
        let at = |offset: usize, message: String| ConfigError {
            file: file.to_owned(),
            line: line_of(text, offset),
            message,
        };
        parsed.defaults.check_as_defaults(&at)?;
        let foreign = Foreign::parse(file, text)?;
        let mut rows: Vec<ProcessRow> = Vec::new();
        for written in &parsed.process {
            let line = line_of(text, written.span().start);
            let mut row = check::row(written, &parsed.defaults, line, &at)?;
            row.grants = foreign.grants_as_written(&row.rules.name);
            // Sensors have names of their own: rows for two kinds of them never make the same process.
            let is_other_kind = |other: &ProcessRow| {
                let kinds = other.per_sensor.as_ref().zip(row.per_sensor.as_ref());
                kinds.is_some_and(|(other, kind)| other != kind)
            };
            let is_same = |other: &&ProcessRow| other.rules.name == row.rules.name && !is_other_kind(other);
            if let Some(other) = rows.iter().find(is_same) {
                let message = format!(
                    "{:?} is already the process of line {}",
                    row.rules.name, other.line
                );
                return Err(at(written.get_ref().name_offset(written), message));
            }
            rows.push(row);
        }
        check::size(&rows, &at)?;
        check::output_is_there(&rows, file)?;
        Ok(Self {
            file: file.to_owned(),
            rows,
        })
    }

    /// The rows that run in `mode`, with the arguments for it and with the full path of their programs, which must be
    /// executable files: absolute, or in `folder`. What is there per sensor is there once for each sensor of `config` that it
    /// is for.
    ///
    /// # Errors
    /// [`ConfigError`] naming the line of the row, and the path that was tried, the name that is taken, or the output
    /// that it lacks.
    pub fn select(&self, mode: Mode, folder: &Path, config: &Config) -> Result<Vec<ProcessRow>, ConfigError> {
        let (selected, mistakes) = self.select_all(mode, folder, config);
        mistakes.into_iter().next().map_or(Ok(selected), Err)
    }

    /// Why logs stay in memory until the end of the run although `config` has a folder for them: none of `rows` carries them.
    pub fn nobody_carries(rows: &[ProcessRow], config: &Config) -> Option<String> {
        let carries = |row: &ProcessRow| row.program_name == programs::RECORDER;
        (spool::is_wanted(config) && !rows.iter().any(carries)).then(|| {
            format!(
                "no row has the program {}, which carries logs to the disk: they stay in memory until the end",
                programs::RECORDER
            )
        })
    }

    /// Every mistake of `services.toml` in `config_folder`, with the rows that [`Self::select`] would give, wrong ones among them.
    pub fn examine(
        config_folder: &Path,
        mode: Mode,
        folder: &Path,
        config: &Config,
    ) -> (Vec<ProcessRow>, Vec<ConfigError>) {
        let file = config_folder.join(PROCESS_FILE);
        let text = match read(&file) {
            Ok(text) => text,
            Err(error) => return (Vec::new(), vec![error]),
        };
        let found = all_mistakes(&text, |text| Self::parse(&file, text));
        let selected = found.value.map(|table| table.select_all(mode, folder, config));
        let (rows, of_rows) = selected.unwrap_or_default();
        (rows, found.mistakes.into_iter().chain(of_rows).collect())
    }

    /// What [`Self::select`] selects, and everything that is wrong with it.
    fn select_all(&self, mode: Mode, folder: &Path, config: &Config) -> (Vec<ProcessRow>, Vec<ConfigError>) {
        let sensors = config.sensors.as_slice();
        let (mut selected, mut mistakes): (Vec<ProcessRow>, Vec<ConfigError>) = (Vec::new(), Vec::new());
        let rows = self.rows.iter().filter(|row| row.when.includes(mode, config));
        for mut row in rows.flat_map(|row| row.per_sensor_of(sensors)) {
            row.program_name = row.program.file_name().unwrap_or_default().to_owned();
            row.program = programs::file_of(&folder.join(&row.program));
            if !check::is_executable(&row.program) {
                mistakes.push(ConfigError {
                    file: self.file.clone(),
                    line: row.line,
                    message: format!(
                        "the program of {:?} is missing: {} is no executable file",
                        row.rules.name,
                        row.program.display()
                    ),
                });
            }
            if mode == Mode::VirtualWorld
                && let Some(external) = row.arguments_external.take()
            {
                row.arguments = external;
            }
            let joins = check::joins(&row, &selected, &self.file);
            let publishes = joins.and_then(|()| check::publishes(&row, &selected, sensors, &self.file));
            mistakes.extend(publishes.err());
            selected.push(row);
        }
        if mode == Mode::Real {
            mistakes.extend(check::not_measured(&selected, sensors));
        }
        mistakes.extend(check::output_is_there(&selected, &self.file).err());
        (selected, mistakes)
    }
}

/// One start of a process.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// The instance it belongs to.
    pub instance: &'a Instance,
    /// Folder of its configuration.
    pub config: &'a Path,
    /// Log level, where the row gives none.
    pub log: tracing::Level,
    /// Which start of it this is.
    pub generation: u32,
    /// It computes, but publishes nothing until the control record makes it the owner.
    pub is_shadow: bool,
}

impl ProcessRow {
    /// Which of jink's services the row is for, whichever program it names; `None`: somebody else's, whose identity are the topics
    /// that the row grants.
    fn service(&self) -> Option<String> {
        let by_name =
            || programs::service_of(OsStr::new(&format!("jink-{}", self.rules.name.replace('_', "-"))));
        programs::service_of(&self.program_name).or_else(by_name)
    }

    /// The command line of a start, without the program's name: [`jink_runtime::Setup`] reads it.
    pub fn arguments_of(&self, start: &Start<'_>) -> Vec<OsString> {
        let text = |text: &dyn ToString| OsString::from(text.to_string());
        let mut arguments: Vec<OsString> = vec![
            "--process".into(),
            text(&self.rules.name),
            "--instance".into(),
            text(start.instance),
            "--config".into(),
            start.config.into(),
            "--generation".into(),
            text(&start.generation),
            "--budget-us".into(),
            text(&self.rules.cycle_budget_us),
            "--end-to-end-us".into(),
            text(&self.rules.end_to_end_us),
            "--priority".into(),
            text(&self.priority),
            "--log".into(),
            text(&self.log.unwrap_or(start.log).to_string().to_lowercase()),
        ];
        if let Some(program) = self.service() {
            let topics = format!("{FINGERPRINT:016x}");
            arguments.extend([
                "--program".into(),
                program.into(),
                "--topics".into(),
                topics.into(),
            ]);
        }
        if let Some(core) = self.core {
            arguments.extend(["--core".into(), text(&core)]);
        }
        if start.is_shadow {
            arguments.push("--shadow".into());
        }
        if self.lock_memory {
            arguments.push("--lock-memory".into());
        }
        if !self.arguments.is_empty() {
            arguments.push("--".into());
            arguments.extend(self.arguments.iter().map(OsString::from));
        }
        arguments
    }

    /// The row once, or once for each of `sensors` that it is for.
    fn per_sensor_of(&self, sensors: &[Sensor]) -> Vec<Self> {
        let Some(kind) = &self.per_sensor else {
            return vec![self.clone()];
        };
        let of = |sensor: &Sensor| {
            let mut row = self.clone();
            row.rules.name = of_sensor(&row.rules.name, &sensor.name);
            row.grants = row.grants.of_sensor(&sensor.name);
            for argument in &mut row.arguments {
                *argument = of_sensor(argument, &sensor.name);
            }
            row
        };
        plugged_in(sensors, kind).map(of).collect()
    }
}

/// The file as written.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct File {
    defaults: WrittenRow,
    process: Vec<Spanned<WrittenRow>>,
    /// Read by [`Foreign`].
    #[serde(rename = "topic")]
    _topics: Vec<IgnoredAny>,
}

/// A row, or the defaults, as written.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct WrittenRow {
    name: Option<Spanned<String>>,
    program: Option<Spanned<String>>,
    arguments: Option<Spanned<Vec<String>>>,
    arguments_external: Option<Spanned<Vec<String>>>,
    when: Option<Spanned<String>>,
    per_sensor: Option<Spanned<String>>,
    /// This and the next are read by [`Foreign`].
    publishes: Option<Spanned<IgnoredAny>>,
    reads: Option<Spanned<IgnoredAny>>,
    output: Option<Spanned<bool>>,
    essential: Option<bool>,
    cycle_budget_us: Option<Spanned<i64>>,
    end_to_end_ms: Option<Spanned<i64>>,
    slow: Option<Spanned<WrittenSlow>>,
    shadow: Option<bool>,
    hot_shadow: Option<Spanned<bool>>,
    heartbeat_timeout_ms: Option<Spanned<i64>>,
    start_grace_ms: Option<Spanned<i64>>,
    restart: Option<Spanned<WrittenRestart>>,
    on_failure: Option<Spanned<String>>,
    core: Option<Spanned<i64>>,
    priority: Option<Spanned<i64>>,
    lock_memory: Option<bool>,
    log: Option<Spanned<String>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct WrittenSlow {
    event: Option<Spanned<i64>>,
    degrade: Option<Spanned<i64>>,
    replace: Option<Spanned<i64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct WrittenRestart {
    floor_ms: Option<Spanned<f64>>,
    ceiling_ms: Option<Spanned<f64>>,
    factor: Option<Spanned<f64>>,
    intensity: Option<Spanned<i64>>,
    period_s: Option<Spanned<f64>>,
}

/// Makes an error of a place in the file and a sentence.
type At<'a> = dyn Fn(usize, String) -> ConfigError + 'a;

impl WrittenRow {
    fn name_offset(&self, row: &Spanned<WrittenRow>) -> usize {
        self.name
            .as_ref()
            .map_or(row.span().start, |name| name.span().start)
    }

    fn check_as_defaults(&self, at: &At<'_>) -> Result<(), ConfigError> {
        let of_a_row = [
            ("name", self.name.as_ref().map(Spanned::span)),
            ("program", self.program.as_ref().map(Spanned::span)),
            ("arguments", self.arguments.as_ref().map(Spanned::span)),
            (
                "arguments_external",
                self.arguments_external.as_ref().map(Spanned::span),
            ),
            ("when", self.when.as_ref().map(Spanned::span)),
            ("per_sensor", self.per_sensor.as_ref().map(Spanned::span)),
            ("publishes", self.publishes.as_ref().map(Spanned::span)),
            ("reads", self.reads.as_ref().map(Spanned::span)),
            ("output", self.output.as_ref().map(Spanned::span)),
        ];
        for (key, span) in of_a_row {
            if let Some(span) = span {
                return Err(at(
                    span.start,
                    format!("`{key}` belongs into a [[process]] row, not into [defaults]"),
                ));
            }
        }
        Ok(())
    }
}

/// The value called `word` among `known`, or an error with all of them.
fn choose<T: Copy>(
    what: &str,
    word: &Spanned<String>,
    known: &[(&'static str, T)],
    at: &At<'_>,
) -> Result<T, ConfigError> {
    match known.iter().find(|(name, _)| name == word.get_ref()) {
        Some((_, value)) => Ok(*value),
        None => {
            let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
            let message = format!(
                "unknown {what} {:?}; use one of {}",
                word.get_ref(),
                names.join(", ")
            );
            Err(at(word.span().start, message))
        }
    }
}

#[cfg(test)]
mod tests;
