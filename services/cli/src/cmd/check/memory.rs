//! `jink check memory`.

use super::Outcome;
use jink_control::findings::{Finding, Findings, Grade};
use jink_control::{Problem, places};
use jink_runtime::Instance;
use jink_runtime::config::{Config, Foreign, process_names};
use jink_runtime::room::{self, Need, REMEDY, SHARED_MEMORY, TopicNeed, megabytes};
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::time::Instant;

/// Topics that are shown one by one.
const SHOWN: usize = 4;

/// For which configuration.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Args {
    /// Profile laid over jink.toml: profiles/PROFILE.toml
    #[arg(long)]
    profile: Option<String>,
    /// Sensors instead of those of jink.toml: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (docs/sensors), several
    /// with a plus between them, or FILE.toml with tables of sensors and parameters
    #[arg(long, value_name = "NAME|FILE.toml")]
    sensor: Option<String>,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Value laid over the configuration (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// One JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
}

/// Compares what the topics take with what there is.
pub fn run(instance: &Instance, args: &Args) -> Result<Outcome, Problem> {
    let begin = Instant::now();
    let folder = places::config_folder(args.config.as_deref())?;
    let config = match Config::resolve(
        &folder,
        args.profile.as_deref(),
        args.sensor.as_deref(),
        &args.overrides,
    ) {
        Ok(resolved) => resolved.config,
        Err(problem) => return Ok(Outcome::Refused(problem.to_string())),
    };
    let foreign = match Foreign::load(&folder) {
        Ok(foreign) => foreign,
        Err(problem) => return Ok(Outcome::Refused(problem.to_string())),
    };
    // The supervisor publishes, too.
    let need = Need::of(process_names(&folder).len() + 1, &config, &foreign.topics);
    let used = room::used_bytes(instance);
    let free = room::available_bytes().map_err(Problem::io(SHARED_MEMORY))?;
    let available = free.saturating_add(used);

    let mut findings: Vec<Finding> = need.topics.iter().take(SHOWN).map(of_topic).collect();
    let others = need.topics.get(SHOWN..).unwrap_or_default();
    findings.push(Finding {
        grade: Grade::Good,
        about: "others".to_owned(),
        is: format!(
            "{} topics, {}",
            others.len(),
            megabytes(others.iter().map(|need| need.bytes as u64).sum())
        ),
        remedy: String::new(),
    });
    findings.push(of_space(&need, available));
    if used > 0 {
        findings.push(Finding {
            grade: Grade::Good,
            about: "in use".to_owned(),
            is: format!("{} by instance {instance}, which is there", megabytes(used)),
            remedy: String::new(),
        });
    }
    findings.extend(of_rights(&instance.open_to_others()));
    let findings = Findings {
        findings,
        subject: format!("shared memory in {SHARED_MEMORY}"),
        seconds: begin.elapsed().as_secs_f64(),
    };
    Ok(Outcome::Found(
        findings,
        figures(&need, available, used),
        String::new(),
    ))
}

fn of_topic(need: &TopicNeed) -> Finding {
    let publishers = match need.publishers {
        1 => String::new(),
        count => format!("{count} times "),
    };
    Finding {
        grade: Grade::Good,
        about: "topic".to_owned(),
        is: format!(
            "{}: {publishers}{} samples, {}{}",
            need.topic,
            need.slots,
            megabytes(need.bytes as u64),
            match need.reserved_bytes < need.bytes {
                true => format!(", {} of it at the start", megabytes(need.reserved_bytes as u64)),
                false => String::new(),
            }
        ),
        remedy: String::new(),
    }
}

fn of_space(need: &Need, available: u64) -> Finding {
    let (reserved, most) = (need.reserved_bytes() as u64, need.most_bytes() as u64);
    let largest = need.topics.iter().map(|topic| topic.reserved_bytes as u64).max();
    let largest = largest.unwrap_or(0);
    let is = format!(
        "{} needed at the start, {} available; swapping the process with the largest topic takes {} more for a moment, \
         and {} is all that readers can hold",
        megabytes(reserved),
        megabytes(available),
        megabytes(largest),
        megabytes(most)
    );
    let (grade, remedy) = if reserved > available {
        (Grade::Blocker, REMEDY)
    } else if reserved + largest > available {
        (
            Grade::Warning,
            "do not swap that process, or make /dev/shm larger",
        )
    } else if most > available {
        (
            Grade::Warning,
            "many slow readers at once would miss samples: make /dev/shm larger",
        )
    } else {
        (Grade::Good, "")
    };
    Finding {
        grade,
        about: "memory".to_owned(),
        is,
        remedy: remedy.to_owned(),
    }
}

/// Whether files of the instance are open to other users.
fn of_rights(open: &[PathBuf]) -> Option<Finding> {
    let first = open.first()?;
    Some(Finding {
        grade: Grade::Warning,
        about: "rights".to_owned(),
        is: format!("other users may open {} ({} files)", first.display(), open.len()),
        remedy: "start jink again; who can write there can end it".to_owned(),
    })
}

fn figures(need: &Need, available: u64, used: u64) -> Map<String, Value> {
    let topics: Vec<Value> = need
        .topics
        .iter()
        .map(|need| {
            json!({
                "topic": need.topic,
                "publishers": need.publishers,
                "slots": need.slots,
                "bytes": need.bytes,
                "reserved_bytes": need.reserved_bytes,
            })
        })
        .collect();
    let mut figures = Map::new();
    figures.insert("needed_bytes".to_owned(), json!(need.reserved_bytes()));
    figures.insert("most_bytes".to_owned(), json!(need.most_bytes()));
    figures.insert("available_bytes".to_owned(), json!(available));
    figures.insert("used_bytes".to_owned(), json!(used));
    figures.insert("topics".to_owned(), json!(topics));
    figures
}
