//! Makes a checked row of a written one.

use super::{At, OnFailure, ProcessRow, ProcessRules, When, WrittenRestart, WrittenRow, WrittenSlow, choose};
use crate::policy::RestartRule;
use crate::slowness::SlowRule;
use jink_runtime::config::{
    CONFIG_FILE, ConfigError, Grants, SENSOR_KINDS, Sensor, SensorOutput, is_user_kind, of_sensor,
};
use jink_runtime::heartbeat::HEARTBEAT_PERIOD_S;
use jink_shared_types::health::PROCESSES;
use jink_shared_types::suggestion::DidYouMean;
use jink_shared_types::topics;
use std::ops::RangeInclusive;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Longest name of a process: fits a status line of 50 characters together with the longest event text.
const NAME_MAX: usize = 20;
/// The supervisor's own name on the event topic.
const RESERVED_NAME: &str = "supervisor";
/// One late heartbeat must not be a hang.
const HEARTBEAT_TIMEOUT_MIN_MS: i64 = (2.0 * HEARTBEAT_PERIOD_S * 1e3) as i64;

/// Kinds of sensors whose ranges come over MAVLink.
const OVER_MAVLINK: [&str; 2] = ["autopilot_rangefinder", "obstacle_row"];

const DEFAULT_START_GRACE_MS: i64 = 3_000;

const WHEN: [(&str, When); 6] = [
    ("always", When::Always),
    ("real", When::Real),
    ("simulated_vehicle", When::SimulatedVehicle),
    ("virtual_world", When::VirtualWorld),
    ("recording", When::Recording),
    ("viewer", When::Viewer),
];

const ON_FAILURE: [(&str, OnFailure); 4] = [
    ("hold", OnFailure::Hold),
    ("stop_output", OnFailure::StopOutput),
    ("ignore", OnFailure::Ignore),
    ("shutdown", OnFailure::Shutdown),
];

const LOG_LEVELS: [(&str, tracing::Level); 5] = [
    ("error", tracing::Level::ERROR),
    ("warn", tracing::Level::WARN),
    ("info", tracing::Level::INFO),
    ("debug", tracing::Level::DEBUG),
    ("trace", tracing::Level::TRACE),
];

/// Whether `path` is an executable file.
pub(super) fn is_executable(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

/// There is something to start, and not more than a status sample can hold.
pub(super) fn size(rows: &[ProcessRow], at: &At<'_>) -> Result<(), ConfigError> {
    match rows.len() {
        0 => Err(at(0, "there is no [[process]] row".to_owned())),
        n if n > PROCESSES => Err(at(0, format!("{n} processes; at most {PROCESSES} are possible"))),
        _ => Ok(()),
    }
}

/// The process that `on_failure = "stop_output"` stops is among the rows: the autopilot's own fail-safe is counted on.
pub(super) fn output_is_there(rows: &[ProcessRow], file: &Path) -> Result<(), ConfigError> {
    let stops_it = |row: &&ProcessRow| row.rules.on_failure == OnFailure::StopOutput;
    match rows.iter().find(stops_it) {
        Some(row) if !rows.iter().any(|row| row.rules.is_output) => Err(ConfigError {
            file: file.to_owned(),
            line: row.line,
            message: format!(
                "on_failure = \"stop_output\" of {:?} would stop nothing: no row says `output = true`",
                row.rules.name
            ),
        }),
        _ => Ok(()),
    }
}

/// Those of `sensors` that nothing measures, where they are real: no driver of ours, no program of others, not the autopilot.
pub(super) fn not_measured<'a>(
    rows: &'a [ProcessRow],
    sensors: &'a [Sensor],
) -> impl Iterator<Item = ConfigError> + 'a {
    let is_measured = |sensor: &Sensor| {
        let topic = match sensor.output {
            SensorOutput::Cloud => topics::RANGE_CLOUD.row.name,
            SensorOutput::Scan => topics::RANGE_SCAN.row.name,
        };
        let topic = topic.replace('*', &sensor.name);
        let is_driver = |row: &ProcessRow| sensor.has_device && row.per_sensor.as_ref() == Some(&sensor.kind);
        OVER_MAVLINK.contains(&sensor.kind.as_str())
            || rows
                .iter()
                .any(|row| is_driver(row) || row.grants.may_publish(&topic))
    };
    sensors.iter().filter(move |sensor| !is_measured(sensor)).map(|sensor| {
        let remedy = match is_user_kind(&sensor.kind) {
            true => "the process table needs a row that publishes its topic (docs/bring_your_own_process.md)",
            false => {
                "give it the `device` and the `model` that it has (docs/lidars.md, docs/depth_cameras.md, docs/rangefinders.md), or \
                 remove its table; `--world forest` simulates it"
            }
        };
        ConfigError {
            file: PathBuf::from(CONFIG_FILE),
            line: 0,
            message: format!("sensor {:?}: no driver reads this {}: {remedy}", sensor.name, sensor.kind),
        }
    })
}

/// A row that is about to join `others` has a name of its own and a place: what is there per sensor can have taken
/// either.
pub(super) fn joins(row: &ProcessRow, others: &[ProcessRow], file: &Path) -> Result<(), ConfigError> {
    let name = &row.rules.name;
    let refused = |message: String| ConfigError {
        file: file.to_owned(),
        line: row.line,
        message,
    };
    if let Some(other) = others.iter().find(|other| other.rules.name == *name) {
        return Err(refused(format!(
            "{name:?} is already the process of line {}; rename the sensor",
            other.line
        )));
    }
    if !is_name(name) || name == RESERVED_NAME {
        return Err(refused(format!(
            "{name:?} cannot be the name of a process; rename the sensor (at most {NAME_MAX} characters in all)"
        )));
    }
    if others.len() == PROCESSES {
        return Err(refused(format!(
            "more than {PROCESSES} processes with those of the sensors"
        )));
    }
    Ok(())
}

/// What a row that is about to join `others` is granted to publish has a reader and no other producer among them.
pub(super) fn publishes(
    row: &ProcessRow,
    others: &[ProcessRow],
    sensors: &[Sensor],
    file: &Path,
) -> Result<(), ConfigError> {
    let name = &row.rules.name;
    let refused = |message: String| ConfigError {
        file: file.to_owned(),
        line: row.line,
        message,
    };
    if let Some((topic, near)) = row.grants.without_sensor(sensors) {
        return Err(refused(format!(
            "{name:?} publishes {topic}, and no [[sensor]] of jink.toml has this topic{}",
            DidYouMean(near.as_deref())
        )));
    }
    for other in others {
        if let Some(topic) = row.grants.published_by_both(&other.grants) {
            return Err(refused(format!(
                "{name:?} publishes {topic}, as does {:?} of line {}: a topic has one producer",
                other.rules.name, other.line
            )));
        }
    }
    Ok(())
}

/// The row that starts at `line`, completed by `defaults`.
pub(super) fn row(
    written: &Spanned<WrittenRow>,
    defaults: &WrittenRow,
    line: usize,
    at: &At<'_>,
) -> Result<ProcessRow, ConfigError> {
    let start = written.span().start;
    let written = written.get_ref();
    let name = name(written, start, at)?;
    let program = program(written, start, &name, at)?;
    let timeout_ms = integer(
        "heartbeat_timeout_ms",
        [&written.heartbeat_timeout_ms, &defaults.heartbeat_timeout_ms],
        HEARTBEAT_TIMEOUT_MIN_MS,
        HEARTBEAT_TIMEOUT_MIN_MS..=60_000,
        at,
    )?;
    let grace_ms = integer(
        "start_grace_ms",
        [&written.start_grace_ms, &defaults.start_grace_ms],
        DEFAULT_START_GRACE_MS,
        100..=120_000,
        at,
    )?;
    let budget_us = integer(
        "cycle_budget_us",
        [&written.cycle_budget_us, &defaults.cycle_budget_us],
        0,
        0..=1_000_000,
        at,
    )?;
    let end_to_end_ms = integer(
        "end_to_end_ms",
        [&written.end_to_end_ms, &defaults.end_to_end_ms],
        0,
        0..=10_000,
        at,
    )?;
    let priority = integer("priority", [&written.priority, &defaults.priority], 0, 0..=98, at)?;
    let core = integer("core", [&written.core, &defaults.core], -1, 0..=1023, at)?;
    let has_shadow = written.shadow.or(defaults.shadow).unwrap_or(true);
    let hot = written.hot_shadow.as_ref().or(defaults.hot_shadow.as_ref());
    let hot_shadow = hot.is_some_and(|hot| *hot.get_ref());
    if hot_shadow && !has_shadow {
        let message = format!("{name:?} has `shadow = false`: it cannot have a hot shadow");
        return Err(at(hot.map_or(start, |hot| hot.span().start), message));
    }
    let word =
        |of: fn(&WrittenRow) -> &Option<Spanned<String>>| of(written).as_ref().or(of(defaults).as_ref());
    Ok(ProcessRow {
        rules: ProcessRules {
            is_output: written.output.as_ref().is_some_and(|output| *output.get_ref()),
            name,
            essential: written.essential.or(defaults.essential).unwrap_or(true),
            cycle_budget_us: u32::try_from(budget_us).unwrap_or(0),
            end_to_end_us: u32::try_from(end_to_end_ms * 1000).unwrap_or(0),
            slow: slow(written, defaults, at)?,
            has_shadow,
            hot_shadow,
            heartbeat_timeout_s: timeout_ms as f64 * 1e-3,
            start_grace_s: grace_ms as f64 * 1e-3,
            restart: restart(written, defaults, at)?,
            on_failure: match word(|row| &row.on_failure) {
                Some(word) => choose("on_failure", word, &ON_FAILURE, at)?,
                None => OnFailure::Hold,
            },
        },
        program_name: program.file_name().unwrap_or_default().to_owned(),
        program,
        arguments: list(&written.arguments).unwrap_or_default(),
        arguments_external: list(&written.arguments_external),
        when: match &written.when {
            Some(word) => choose("when", word, &WHEN, at)?,
            None => When::Always,
        },
        per_sensor: per_sensor(written, at)?,
        grants: Grants::default(),
        core: usize::try_from(core).ok(),
        priority: u8::try_from(priority).unwrap_or(0),
        lock_memory: written.lock_memory.or(defaults.lock_memory).unwrap_or(false),
        log: match word(|row| &row.log) {
            Some(word) => Some(choose("log level", word, &LOG_LEVELS, at)?),
            None => None,
        },
        line,
    })
}

fn list(written: &Option<Spanned<Vec<String>>>) -> Option<Vec<String>> {
    written.as_ref().map(|list| list.get_ref().clone())
}

fn name(written: &WrittenRow, start: usize, at: &At<'_>) -> Result<String, ConfigError> {
    let Some(name) = &written.name else {
        return Err(at(start, "a process needs a `name`".to_owned()));
    };
    let text = name.get_ref();
    // The name of a sensor takes the place of its own.
    let is_name = match &written.per_sensor {
        Some(_) => is_name(&of_sensor(text, "s")) && *text != of_sensor(text, "s"),
        None => is_name(text),
    };
    if !is_name && let Some(kind) = &written.per_sensor {
        let message = format!(
            "process name {text:?}: of a row for each {}, it needs {{sensor}} in it, and else lower-case letters, digits \
             and underscores",
            kind.get_ref()
        );
        return Err(at(name.span().start, message));
    }
    if !is_name {
        let message =
            format!("process name {text:?}: use 1 to {NAME_MAX} lower-case letters, digits and underscores");
        return Err(at(name.span().start, message));
    }
    if text == RESERVED_NAME {
        let message = format!("process name {text:?} is the supervisor's own");
        return Err(at(name.span().start, message));
    }
    Ok(text.clone())
}

fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    (1..=NAME_MAX).contains(&text.len()) && text.chars().all(plain)
}

/// The kind of the sensors that have such a process each.
fn per_sensor(written: &WrittenRow, at: &At<'_>) -> Result<Option<String>, ConfigError> {
    let Some(kind) = &written.per_sensor else {
        return Ok(None);
    };
    if is_user_kind(kind.get_ref()) {
        return Ok(Some(kind.get_ref().clone()));
    }
    let kinds: Vec<(&'static str, &'static str)> =
        SENSOR_KINDS.iter().map(|(kind, _)| (*kind, *kind)).collect();
    choose("kind of sensor", kind, &kinds, at).map(|kind| Some(kind.to_owned()))
}

fn program(written: &WrittenRow, start: usize, name: &str, at: &At<'_>) -> Result<PathBuf, ConfigError> {
    let Some(program) = &written.program else {
        return Err(at(start, format!("process {name:?} needs a `program`")));
    };
    let path = PathBuf::from(program.get_ref());
    // A relative path would depend on where the supervisor was started from.
    let bare = path.components().count() == 1 && path.file_name().is_some();
    if bare || path.is_absolute() {
        return Ok(path);
    }
    let message = format!(
        "program {:?}: give a name beside the supervisor's own, or an absolute path",
        program.get_ref()
    );
    Err(at(program.span().start, message))
}

fn integer(
    key: &str,
    sources: [&Option<Spanned<i64>>; 2],
    default: i64,
    range: RangeInclusive<i64>,
    at: &At<'_>,
) -> Result<i64, ConfigError> {
    match sources.into_iter().flatten().next() {
        None => Ok(default),
        Some(value) if range.contains(value.get_ref()) => Ok(*value.get_ref()),
        Some(value) => {
            let message = format!(
                "{key} = {} is outside {} to {}",
                value.get_ref(),
                range.start(),
                range.end()
            );
            Err(at(value.span().start, message))
        }
    }
}

fn number(
    key: &str,
    sources: [Option<&Spanned<f64>>; 2],
    default: f64,
    range: RangeInclusive<f64>,
    at: &At<'_>,
) -> Result<f64, ConfigError> {
    match sources.into_iter().flatten().next() {
        None => Ok(default),
        Some(value) if range.contains(value.get_ref()) => Ok(*value.get_ref()),
        Some(value) => {
            let message = format!(
                "{key} = {} is outside {} to {}",
                value.get_ref(),
                range.start(),
                range.end()
            );
            Err(at(value.span().start, message))
        }
    }
}

fn slow(written: &WrittenRow, defaults: &WrittenRow, at: &At<'_>) -> Result<SlowRule, ConfigError> {
    let [own, shared] = [&written.slow, &defaults.slow].map(|table| table.as_ref().map(Spanned::get_ref));
    let default = SlowRule::default();
    let none = None;
    type RowKey = fn(&WrittenSlow) -> &Option<Spanned<i64>>;
    let get = |key: &str, of: RowKey, default: u32| {
        let sources = [own, shared].map(|table| table.map_or(&none, of));
        let count = integer(key, sources, i64::from(default), 0..=1000, at)?;
        Ok::<u32, ConfigError>(u32::try_from(count).unwrap_or(default))
    };
    Ok(SlowRule {
        event: get("slow.event", |table| &table.event, default.event)?,
        degrade: get("slow.degrade", |table| &table.degrade, default.degrade)?,
        replace: get("slow.replace", |table| &table.replace, default.replace)?,
    })
}

fn restart(written: &WrittenRow, defaults: &WrittenRow, at: &At<'_>) -> Result<RestartRule, ConfigError> {
    let [own, shared] =
        [&written.restart, &defaults.restart].map(|table| table.as_ref().map(Spanned::get_ref));
    let default = RestartRule::default();
    type RowKey = fn(&WrittenRestart) -> &Option<Spanned<f64>>;
    let get = |key: &str, of: RowKey, default: f64, range: RangeInclusive<f64>| {
        let sources = [own, shared].map(|table| table.and_then(|table| of(table).as_ref()));
        number(key, sources, default, range, at)
    };
    let none = None;
    let intensity = [own, shared].map(|table| table.map_or(&none, |table| &table.intensity));
    let rule = RestartRule {
        floor_s: get("floor_ms", |t| &t.floor_ms, default.floor_s * 1e3, 0.0..=60_000.0)? * 1e-3,
        ceiling_s: get(
            "ceiling_ms",
            |t| &t.ceiling_ms,
            default.ceiling_s * 1e3,
            1.0..=60_000.0,
        )? * 1e-3,
        factor: get("factor", |t| &t.factor, default.factor, 1.0..=10.0)?,
        intensity: integer("intensity", intensity, i64::from(default.intensity), 0..=1000, at)?
            .try_into()
            .unwrap_or(default.intensity),
        period_s: get("period_s", |t| &t.period_s, default.period_s, 0.1..=3600.0)?,
    };
    if rule.floor_s > rule.ceiling_s {
        let place = written.restart.as_ref().or(defaults.restart.as_ref());
        let message = format!(
            "restart: floor_ms = {} is above ceiling_ms = {}",
            rule.floor_s * 1e3,
            rule.ceiling_s * 1e3
        );
        return Err(at(place.map_or(0, |table| table.span().start), message));
    }
    Ok(rule)
}
