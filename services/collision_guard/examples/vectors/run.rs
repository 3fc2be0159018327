//! Every scenario of a directory.

use super::oracle::Heard;
use super::replay::Replay;
use super::report::{Report, Verdict};
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
pub fn run(directory: &Path) -> Result<Report, RunError> {
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
    let mut report = Report::default();
    for file in files {
        let text = std::fs::read_to_string(&file).map_err(|cause| RunError::Unopened(file.clone(), cause))?;
        for (number, line) in text.lines().enumerate() {
            add(&mut report, line).map_err(|cause| RunError::Line(file.clone(), number + 1, cause))?;
        }
    }
    Ok(report)
}

fn add(report: &mut Report, line: &str) -> Result<(), String> {
    let value: Value = serde_json::from_str(line).map_err(|error| error.to_string())?;
    let scenario = Node::root(&value);
    let judged = || -> Result<(&str, &str, Verdict), Unreadable> {
        let (family, id) = (scenario.get("family")?.text()?, scenario.get("id")?.text()?);
        let mut verdict = Verdict::default();
        match family {
            "bezier" => bezier::judge(&scenario, &mut verdict)?,
            unit if unit.starts_with("unit_") => units::judge(unit, &scenario, &mut verdict)?,
            _ => fly(&scenario, family == "setpoint_constraint", &mut verdict)?,
        }
        Ok((family, id, verdict))
    };
    let (family, id, verdict) = judged().map_err(|error| error.to_string())?;
    report.add(family, id, &verdict);
    Ok(())
}

fn fly(scenario: &Node<'_>, with_setpoint: bool, verdict: &mut Verdict) -> Result<(), Unreadable> {
    let mut replay = Replay::new(scenario)?;
    let mut heard = Vec::new();
    for step in scenario.get("steps")?.list()? {
        let answer = replay.step(&step)?;
        heard.extend(answer.taken.iter().map(Heard::of));
        let fragile = fragile(&step)?;
        if replay.config.is_active() {
            map::judge(&step, &answer, &heard, &fragile, verdict)?;
        }
        if with_setpoint {
            let has_turned = map::has_turned(&answer, &heard);
            setpoint::judge(&step, &answer, &replay.config, has_turned, &fragile, verdict)?;
        }
    }
    Ok(())
}
