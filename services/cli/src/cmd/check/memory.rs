//! `jink check memory`.

use super::Outcome;
use jink_cli::memory_need::{TopicNeed, of_topics};
use jink_control::findings::{Finding, Findings, Grade};
use jink_control::{Problem, places};
use jink_runtime::Instance;
use jink_runtime::config::{Config, process_names};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Where shared memory lies.
const SHARED_MEMORY: &str = "/dev/shm";
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
    // The supervisor publishes, too.
    let needs = of_topics(process_names(&folder).len() + 1, &config.sensors);
    let needed: usize = needs.iter().map(|need| need.bytes).sum();
    let largest = needs.first().map_or(0, |need| need.bytes);
    let used = used_by(instance);
    let space = rustix::fs::statvfs(SHARED_MEMORY)
        .map_err(|errno| Problem::Other(format!("{SHARED_MEMORY}: {errno}")))?;
    let free = space.f_bavail.saturating_mul(space.f_frsize);
    let available = usize::try_from(free).unwrap_or(usize::MAX).saturating_add(used);

    let mut findings: Vec<Finding> = needs.iter().take(SHOWN).map(of_topic).collect();
    findings.push(Finding {
        grade: Grade::Good,
        about: "others".to_owned(),
        is: format!(
            "{} topics, {}",
            needs.len().saturating_sub(SHOWN),
            megabytes(needs.iter().skip(SHOWN).map(|need| need.bytes).sum())
        ),
        remedy: String::new(),
    });
    findings.push(of_space(needed, largest, available));
    if used > 0 {
        findings.push(Finding {
            grade: Grade::Good,
            about: "in use".to_owned(),
            is: format!("{} by instance {instance}, which is there", megabytes(used)),
            remedy: String::new(),
        });
    }
    let findings = Findings {
        findings,
        subject: format!("shared memory in {SHARED_MEMORY}"),
        seconds: begin.elapsed().as_secs_f64(),
    };
    Ok(Outcome::Found(
        findings,
        figures(&needs, needed, available, used),
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
            "{}: {publishers}{} samples, {}",
            need.topic,
            need.slots,
            megabytes(need.bytes)
        ),
        remedy: String::new(),
    }
}

fn of_space(needed: usize, largest: usize, available: usize) -> Finding {
    let is = format!(
        "{} needed, {} available; swapping the process with the largest topic takes {} more for a moment",
        megabytes(needed),
        megabytes(available),
        megabytes(largest)
    );
    let (grade, remedy) = if needed > available {
        (
            Grade::Blocker,
            "make /dev/shm larger (mount -o remount,size=256M /dev/shm) or configure fewer sensors",
        )
    } else if needed + largest > available {
        (
            Grade::Warning,
            "do not swap that process, or make /dev/shm larger",
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

fn figures(needs: &[TopicNeed], needed: usize, available: usize, used: usize) -> Map<String, Value> {
    let topics: Vec<Value> = needs
        .iter()
        .map(|need| json!({ "topic": need.topic, "publishers": need.publishers, "slots": need.slots, "bytes": need.bytes }))
        .collect();
    let mut figures = Map::new();
    figures.insert("needed_bytes".to_owned(), json!(needed));
    figures.insert("available_bytes".to_owned(), json!(available));
    figures.insert("used_bytes".to_owned(), json!(used));
    figures.insert("topics".to_owned(), json!(topics));
    figures
}

/// Sizes of the instance's files in shared memory.
fn used_by(instance: &Instance) -> usize {
    let prefix = instance.shm_prefix();
    let files = std::fs::read_dir(Path::new(SHARED_MEMORY))
        .into_iter()
        .flatten()
        .flatten();
    files
        .filter(|file| file.file_name().to_string_lossy().starts_with(&prefix))
        .filter_map(|file| file.metadata().ok())
        .filter(std::fs::Metadata::is_file)
        .map(|metadata| usize::try_from(metadata.len()).unwrap_or(usize::MAX))
        .sum()
}

/// With one digit, in millions of bytes.
fn megabytes(bytes: usize) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}
