//! Flights side by side, each with ports, an instance and a folder of its own; progress on standard error.

use crate::autopilot::Build;
use crate::flight::{Means, fly};
use crate::judge::Verdict;
use crate::scenarios::Planned;
use crate::setup::{Autopilot, Setup};
use crate::table;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// How everything is flown.
#[derive(Clone, Debug)]
pub struct Options {
    /// Builds by autopilot.
    pub builds: BTreeMap<Autopilot, Build>,
    /// Flights at a time.
    pub jobs: u16,
    /// Instance number of the first of them.
    pub first_instance: u16,
    /// Where each flight's line goes as soon as it is over.
    pub json: Option<PathBuf>,
    /// Where pictures go.
    pub svg: Option<PathBuf>,
    /// Where logs go.
    pub keep: Option<PathBuf>,
    /// Folder of jink's programs.
    pub programs: PathBuf,
    /// jink's configuration.
    pub config: PathBuf,
}

impl Options {
    /// Numbers of the autopilots that are flown.
    pub fn instances(&self) -> impl Iterator<Item = u16> + use<> {
        self.first_instance..self.first_instance.saturating_add(self.jobs.max(1))
    }
}

/// Whether `setup` can be flown: its build is there and has what the profile needs.
///
/// # Errors
/// A sentence for the table.
pub fn is_flown(setup: Setup, builds: &BTreeMap<Autopilot, Build>) -> Result<&Build, String> {
    let autopilot = setup.autopilot();
    let build = builds
        .get(&autopilot)
        .ok_or_else(|| format!("no build of {} was named", autopilot.option()))?;
    if setup == Setup::Deviation && !has_external_avoidance(build) {
        return Err("this build has no EAV_EN".to_owned());
    }
    Ok(build)
}

/// Whether PX4's program knows the parameter of external avoidance.
fn has_external_avoidance(build: &Build) -> bool {
    let bytes = std::fs::read(build.program()).unwrap_or_default();
    bytes.windows(6).any(|window| window == b"EAV_EN")
}

/// Flies everything; the verdicts in the order in which they ended.
pub fn run(flights: &[Planned], options: &Options) -> Vec<Verdict> {
    let queue = Mutex::new(flights.iter().copied().enumerate().collect::<VecDeque<_>>());
    let verdicts = Mutex::new(Vec::new());
    let begin = Instant::now();
    std::thread::scope(|scope| {
        for job in 0..options.jobs.max(1) {
            let (queue, verdicts) = (&queue, &verdicts);
            scope.spawn(move || {
                while let Some((index, planned)) = next(queue) {
                    let Ok(build) = is_flown(planned.setup, &options.builds) else {
                        continue;
                    };
                    let verdict = one(index, &planned, build, job, options);
                    let mut verdicts = verdicts.lock().unwrap_or_else(PoisonError::into_inner);
                    verdicts.push(verdict);
                    let left = flights.len() - verdicts.len();
                    let each_s = begin.elapsed().as_secs_f64() / verdicts.len() as f64;
                    if let Some(verdict) = verdicts.last() {
                        eprintln!(
                            "[{}/{}, {:.0} min left] {}",
                            verdicts.len(),
                            flights.len(),
                            each_s * left as f64 / 60.0,
                            table::line(verdict)
                        );
                        append(options.json.as_deref(), verdict);
                    }
                }
            });
        }
    });
    verdicts.into_inner().unwrap_or_else(PoisonError::into_inner)
}

fn next(queue: &Mutex<VecDeque<(usize, Planned)>>) -> Option<(usize, Planned)> {
    queue.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
}

fn one(index: usize, planned: &Planned, build: &Build, job: u16, options: &Options) -> Verdict {
    let name = planned.name().replace('/', "_");
    let folder = match &options.keep {
        Some(keep) => keep.join(&name),
        None => std::env::temp_dir().join(format!("jink_real_{}_{index}", std::process::id())),
    };
    // An autopilot that finds the mission of an earlier flight goes on in it.
    let _none_before = std::fs::remove_dir_all(&folder);
    let means = Means {
        programs: options.programs.clone(),
        config: options.config.clone(),
        folder: folder.clone(),
        instance: options.first_instance + job,
        keeps_logs: options.keep.is_some(),
    };
    let (verdict, record) = fly(planned.scenario, planned.setup, build, &means);
    if let (Some(svg), Some(record)) = (&options.svg, &record)
        && let Err(error) = table::draw(&verdict, &record.lock(), &svg.join(format!("{name}.svg")))
    {
        eprintln!("{name}: no picture: {error}");
    }
    if options.keep.is_none() {
        let _missing = std::fs::remove_dir_all(&folder);
    }
    verdict
}

/// Adds a line; whoever stops the suite has all flights so far.
fn append(file: Option<&Path>, verdict: &Verdict) {
    let Some(file) = file else { return };
    let line = serde_json::to_string(verdict).unwrap_or_default();
    let written = File::options()
        .create(true)
        .append(true)
        .open(file)
        .and_then(|mut file| writeln!(file, "{line}"));
    if let Err(error) = written {
        eprintln!("{}: {error}", file.display());
    }
}

/// The folder of jink's programs: that of this one. They are built if one is missing or old.
///
/// # Errors
/// If they cannot be built.
pub fn programs() -> Result<PathBuf, String> {
    let own = std::env::current_exe().map_err(|error| error.to_string())?;
    let folder = own
        .ancestors()
        .skip(1)
        .find(|folder| !folder.ends_with("deps"))
        .unwrap_or(Path::new("."));
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet", "--bin", "jink", "--bin", "jink-lab"]);
    if folder.ends_with("release") {
        build.arg("--release");
    }
    let status = build
        .current_dir(workspace())
        .status()
        .map_err(|error| error.to_string())?;
    if status.success() {
        return Ok(folder.to_owned());
    }
    Err("jink's programs could not be built".to_owned())
}

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .map_or_else(PathBuf::new, Path::to_path_buf)
}
