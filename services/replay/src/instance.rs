//! One start of a process in a recorded flight, and the program that does the same once more.

use crate::ReplayError;
use jink_recorder::PARAMETERS_FILE;
use jink_runtime::config::{CONFIG_FILE, Config, PROCESS_FILE};
use jink_runtime::lockstep::replay::{Known, Replayed};
use jink_runtime::programs;
use jink_shared_types::Timestamp;
use jink_shared_types::cycles::CycleEntry;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::{Apply, ParamSet};
use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Which start of which process.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct InstanceName {
    /// The process.
    pub process: String,
    /// Which start of it.
    pub generation: u32,
}

/// A cycle as it was recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct RecordedCycle {
    pub(crate) begin: Timestamp,
    pub(crate) number: u32,
    pub(crate) takes: Vec<CycleEntry>,
}

/// The cycles of one start of a process, as they are read.
#[derive(Debug, Default)]
pub(crate) struct Instance {
    pub(crate) cycles: VecDeque<RecordedCycle>,
    pub(crate) is_shadow: bool,
    /// Low half of the sequence number of the last sample of cycles.
    last_sample: u32,
    /// Why it cannot be replayed from here on.
    pub(crate) broken: Option<String>,
    pub(crate) replayed: Option<Replayed>,
    /// The topics that the program publishes.
    pub(crate) publishes: Vec<Known>,
}

impl Instance {
    /// Takes a sample of its cycles, the `sample`-th of this start.
    pub(crate) fn read(&mut self, sample: u32, is_shadow: bool, entries: &[CycleEntry]) {
        if self.broken.is_some() {
            return;
        }
        if sample != self.last_sample + 1 {
            self.broken = Some(match self.last_sample {
                0 => {
                    "its first cycles are not in the recording: what it knew by then is not known".to_owned()
                }
                _ => format!(
                    "{} samples of its cycles are missing",
                    sample.saturating_sub(self.last_sample + 1)
                ),
            });
            return;
        }
        self.last_sample = sample;
        self.is_shadow = is_shadow;
        for entry in entries {
            match (entry.topic, self.cycles.back_mut()) {
                (0, _) => self.cycles.push_back(RecordedCycle {
                    begin: entry.time,
                    number: entry.number,
                    takes: Vec::new(),
                }),
                (_, Some(cycle)) => cycle.takes.push(*entry),
                // The cycle has been replayed already: it has lasted for longer than is waited for.
                (_, None) => self.broken = Some("a cycle took too long".to_owned()),
            }
        }
    }
}

/// What the parameters of one start are made of, besides what the flight was started with.
#[derive(Debug)]
pub(crate) struct Params<'a> {
    /// The last that were published before.
    pub(crate) published: Option<&'a ParameterValues>,
    /// Those that are to have other values.
    pub(crate) changed: &'a [(String, f64)],
}

/// What is said about a process in `services.toml`.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProcessRow {
    program: String,
    arguments: Vec<OsString>,
}

/// What a flight was started with, and where replays of it work.
#[derive(Debug)]
pub(crate) struct Start {
    folder: PathBuf,
    files: BTreeMap<String, String>,
    rows: BTreeMap<String, ProcessRow>,
    params: ParamSet,
}

impl Start {
    /// Of a recording with these attachments.
    pub(crate) fn of(files: &BTreeMap<String, String>) -> Result<Self, ReplayError> {
        let text = files.get(PROCESS_FILE).ok_or(ReplayError::NoStart)?;
        let table: toml::Table = text
            .parse()
            .map_err(|error| ReplayError::Start(format!("{PROCESS_FILE}: {error}")))?;
        let rows = table.get("process").and_then(toml::Value::as_array);
        let rows = rows.into_iter().flatten().filter_map(|row| {
            let text = |key: &str| row.get(key)?.as_str().map(str::to_owned);
            let arguments = row.get("arguments").and_then(toml::Value::as_array);
            let arguments = arguments.into_iter().flatten();
            let row = ProcessRow {
                program: text("program")?,
                arguments: arguments
                    .filter_map(|argument| argument.as_str().map(OsString::from))
                    .collect(),
            };
            Some((text("name")?, row))
        });
        let folder = std::env::temp_dir().join(format!("jink_replay_{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|error| ReplayError::Folder(folder.clone(), error))?;
        let config = files.get(CONFIG_FILE).ok_or(ReplayError::NoStart)?;
        let config = Config::parse(Path::new(CONFIG_FILE), config)
            .map_err(|error| ReplayError::Start(error.to_string()))?;
        Ok(Self {
            folder,
            params: config.params,
            rows: rows.collect(),
            files: files.clone(),
        })
    }

    /// The numbers of the rows of these parameters, with their values.
    pub(crate) fn rows<'a>(&'a self, params: &'a [(String, f64)]) -> impl Iterator<Item = (usize, f64)> + 'a {
        params
            .iter()
            .filter_map(|(name, value)| Some((self.params.number_of(name)?, *value)))
    }

    /// Starts the program of `name`, or `program` in its place, with the parameters that it was started with.
    pub(crate) fn start(
        &self,
        name: &InstanceName,
        is_shadow: bool,
        program: Option<&Path>,
        params: &Params<'_>,
        begin: Timestamp,
    ) -> Result<Replayed, ReplayError> {
        let row = self.rows.get(&name.process).cloned().unwrap_or_default();
        let program = match program {
            Some(program) => program.to_owned(),
            None => beside_this(Path::new(&row.program)),
        };
        let folder = self.folder.join(format!("{}_{}", name.process, name.generation));
        let written = self.write(&folder, params);
        written.map_err(|error| ReplayError::Folder(folder.clone(), error))??;
        let mut arguments: Vec<OsString> = vec![
            "--process".into(),
            name.process.clone().into(),
            "--instance".into(),
            instance_name().into(),
            "--config".into(),
            folder.clone().into(),
            "--generation".into(),
            name.generation.to_string().into(),
            // What it has to say stands in the log of the flight.
            "--log".into(),
            "error".into(),
        ];
        if let Some(service) = Path::new(&row.program).file_name().and_then(programs::service_of) {
            arguments.extend(["--program".into(), service.into()]);
        }
        if is_shadow {
            arguments.push("--shadow".into());
        }
        if !row.arguments.is_empty() {
            arguments.push("--".into());
            arguments.extend(row.arguments);
        }
        Replayed::start(&program, arguments, &folder.join("socket"), begin)
            .map_err(|error| ReplayError::Program(name.process.clone(), without_json(&error.to_string())))
    }

    /// Writes the configuration of one start: nothing of it is recorded, kept, or read from elsewhere.
    fn write(&self, folder: &Path, params: &Params<'_>) -> std::io::Result<Result<(), ReplayError>> {
        std::fs::create_dir_all(folder)?;
        for (name, text) in self.files.iter().filter(|(name, _)| *name != CONFIG_FILE) {
            // A name of a recording leads nowhere else.
            std::fs::write(folder.join(Path::new(name).file_name().unwrap_or_default()), text)?;
        }
        let text = self.files.get(CONFIG_FILE).map_or("", String::as_str);
        match self.with_parameters(text, params) {
            Ok(text) => std::fs::write(folder.join(CONFIG_FILE), text).map(Ok),
            Err(error) => Ok(Err(error)),
        }
    }

    /// The configuration with the parameters that were in force.
    fn with_parameters(&self, text: &str, of_start: &Params<'_>) -> Result<String, ReplayError> {
        let wrong =
            |what: &str, error: &dyn std::fmt::Display| ReplayError::Start(format!("{what}: {error}"));
        let stored = self.files.get(PARAMETERS_FILE).map_or("", String::as_str);
        let stored: BTreeMap<String, f64> =
            toml::from_str(stored).map_err(|error| wrong(PARAMETERS_FILE, &error))?;
        let mut params = self.params.clone();
        for (name, value) in stored {
            params
                .set(&name, value)
                .map_err(|error| wrong(PARAMETERS_FILE, &error))?;
        }
        let known = params.clone();
        let live = of_start
            .published
            .into_iter()
            .flat_map(|values| values.rows(&known));
        for (row, value) in live.filter(|(row, _)| row.apply == Apply::Live) {
            // They were in force: the order in which they are set here is another one.
            let _in_range = params.set(row.name, value);
        }
        for (name, value) in of_start.changed {
            params
                .set(name, *value)
                .map_err(|error| ReplayError::Param(error.to_string()))?;
        }
        let mut table: toml::Table = text.parse().map_err(|error| wrong(CONFIG_FILE, &error))?;
        for key in ["recorder", "param_store", "log_dir"] {
            table.remove(key);
        }
        let section = params
            .rows()
            .map(|(row, value)| (row.name.to_owned(), value.into()));
        table.insert("params".to_owned(), toml::Value::Table(section.collect()));
        Ok(table.to_string())
    }
}

impl Drop for Start {
    fn drop(&mut self) {
        // It is in the folder for what is temporary.
        let _stays = std::fs::remove_dir_all(&self.folder);
        // What a parameter server has kept.
        if let Ok(instance) = instance_name().parse::<jink_runtime::Instance>() {
            let _was_none = std::fs::remove_dir_all(instance.folder());
        }
    }
}

/// The instance whose name replayed services bear.
fn instance_name() -> String {
    format!("replay_{}", std::process::id())
}

/// A text that ends in a line of a log, with what that says.
fn without_json(text: &str) -> String {
    let said = text.split_once('{').and_then(|(before, line)| {
        let line: serde_json::Value = serde_json::from_str(&format!("{{{line}")).ok()?;
        Some(format!("{before}{}", line["message"].as_str()?))
    });
    said.unwrap_or_else(|| text.to_owned())
}

/// Programs of ours lie beside this one.
fn beside_this(program: &Path) -> PathBuf {
    let own = std::env::current_exe().ok();
    let beside = own.and_then(|own| Some(own.parent()?.join(program)));
    match beside {
        Some(beside) if program.is_relative() && programs::file_of(&beside).is_file() => beside,
        _ => program.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{CycleEntry, Instance, without_json};
    use jink_shared_types::Timestamp;

    fn entries(begins: &[(u64, u64)]) -> Vec<CycleEntry> {
        let entry = |ns, topic, number| CycleEntry {
            time: Timestamp::from_ns(ns),
            topic,
            number,
        };
        let of_cycle = |(begin, taken): &(u64, u64)| [entry(*begin, 0, 1), entry(*taken, 7, 0)];
        begins.iter().flat_map(of_cycle).collect()
    }

    #[test]
    fn what_a_program_logged_is_shown_as_a_sentence() {
        let logged = r#"planner: exit status: 78: {"level":"ERROR","message":"cannot start: no"}"#;
        assert_eq!(without_json(logged), "planner: exit status: 78: cannot start: no");
        assert_eq!(without_json("a {b"), "a {b");
    }

    #[test]
    fn a_cycle_may_go_on_in_the_next_sample() {
        let mut instance = Instance::default();
        let all = entries(&[(10, 9), (20, 19)]);
        instance.read(1, false, &all[..3]);
        instance.read(2, false, &all[3..]);
        assert_eq!(instance.broken, None);
        let takes: Vec<usize> = instance.cycles.iter().map(|cycle| cycle.takes.len()).collect();
        assert_eq!(takes, [1, 1]);
    }

    #[test]
    fn an_instance_whose_first_or_later_cycles_are_missing_is_not_replayed_from_there() {
        let mut late = Instance::default();
        late.read(4, false, &entries(&[(10, 9)]));
        assert!(late.broken.unwrap().contains("first cycles"));
        let mut gap = Instance::default();
        gap.read(1, false, &entries(&[(10, 9)]));
        gap.read(4, false, &entries(&[(20, 19)]));
        assert_eq!(gap.cycles.len(), 1);
        assert!(gap.broken.unwrap().contains("2 samples"));
    }
}
