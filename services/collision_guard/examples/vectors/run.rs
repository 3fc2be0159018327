//! Every scenario of a directory.

use super::oracle::ReceivedMessage;
use super::replay::Replay;
use super::report::{ScenarioResult, VectorReport};
use super::schema::{Node, Unreadable, fragile};
use super::{bezier, map, setpoint, units};
use serde_json::Value;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why a directory cannot be judged.
#[derive(Debug)]
pub enum RunError {
    /// It or a file in it cannot be read.
    Unopened(PathBuf, std::io::Error),
    /// There is no file of scenarios in it.
    Empty(PathBuf),
    /// A line of a file is no scenario.
    Line(PathBuf, usize, String),
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RunError::Unopened(path, cause) => write!(f, "{}: {cause}", path.display()),
            RunError::Empty(path) => write!(f, "{}: no .jsonl file in it", path.display()),
            RunError::Line(path, line, cause) => write!(f, "{}:{line}: {cause}", path.display()),
        }
    }
}
impl std::error::Error for RunError {}

/// Judges every `.jsonl` file in `directory`.
pub fn run(directory: &Path) -> Result<VectorReport, RunError> {
    let unopened = |cause| RunError::Unopened(directory.to_owned(), cause);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(unopened)? {
        let path = entry.map_err(unopened)?.path();
        if path.extension().is_some_and(|extension| extension == "jsonl") {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(RunError::Empty(directory.to_owned()));
    }
    let mut report = VectorReport::default();
    for file in files {
        let text = std::fs::read_to_string(&file).map_err(|cause| RunError::Unopened(file.clone(), cause))?;
        for (number, line) in text.lines().enumerate() {
            add(&mut report, line).map_err(|cause| RunError::Line(file.clone(), number + 1, cause))?;
        }
    }
    Ok(report)
}

fn add(report: &mut VectorReport, line: &str) -> Result<(), String> {
    let value: Value = serde_json::from_str(line).map_err(|error| error.to_string())?;
    let scenario = Node::root(&value);
    let judged = || -> Result<(&str, &str, ScenarioResult), Unreadable> {
        let (family, id) = (scenario.get("family")?.text()?, scenario.get("id")?.text()?);
        let mut result = ScenarioResult::default();
        match family {
            "bezier" => bezier::judge(&scenario, &mut result)?,
            unit if unit.starts_with("unit_") => units::judge(unit, &scenario, &mut result)?,
            _ => fly(&scenario, family == "setpoint_constraint", &mut result)?,
        }
        Ok((family, id, result))
    };
    let (family, id, result) = judged().map_err(|error| error.to_string())?;
    report.add(family, id, &result);
    Ok(())
}

fn fly(scenario: &Node<'_>, with_setpoint: bool, result: &mut ScenarioResult) -> Result<(), Unreadable> {
    let mut replay = Replay::new(scenario)?;
    let mut received = Vec::new();
    for step in scenario.get("steps")?.list()? {
        let replayed = replay.step(&step)?;
        received.extend(replayed.accepted.iter().map(ReceivedMessage::of));
        let fragile = fragile(&step)?;
        if replay.config.is_active() {
            map::judge(&step, &replayed, &received, &fragile, result)?;
        }
        if with_setpoint {
            let has_turned = map::has_turned(&replayed, &received);
            setpoint::judge(&step, &replayed, &replay.config, has_turned, &fragile, result)?;
        }
    }
    Ok(())
}
