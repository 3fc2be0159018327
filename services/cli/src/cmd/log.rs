//! `jink log`: what the services have written, merged, in plain words; of the run that goes on, or of one before.

use jink_cli::view::log::{LogLine, merge};
use jink_control::{Problem, places};
use jink_runtime::Instance;
use jink_runtime::config::Config;
use jink_shared_types::suggestion::{DidYouMean, nearest};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use tracing::Level;

/// Which lines to show.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Of a run that goes on, what is in memory is shown: of each service the last megabyte at least. Logs are kept in log_dir of jink.toml, or
in /var/log/jink under deploy/jink.service, a folder for each run; without either they are gone with `jink down`.

Exit codes: 0 shown; 1 there are no such logs.")]
pub struct Args {
    /// Only of this service, as `jink status` names it; `supervisor` is one, too
    service: Option<String>,
    /// Follow the logs: print new lines as they are written
    #[arg(short, long)]
    follow: bool,
    /// Least severity of the lines: error, warn, info, debug
    #[arg(long)]
    level: Option<Level>,
    /// So many runs before the last one
    #[arg(long, value_name = "RUNS", default_value_t = 0, conflicts_with = "follow")]
    before: usize,
    /// Configuration folder, for an instance that is not running; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
}

/// Where deploy/jink.service has logs kept.
const SYSTEM_LOG_DIR: &str = "/var/log/jink";
/// How often a file that is followed is looked at.
const LOOK: Duration = Duration::from_millis(200);

/// Shows the lines.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let run = run_folder(instance, args)?;
    let services = services_in(&run);
    if let Some(service) = args
        .service
        .as_deref()
        .filter(|service| !services.contains(*service))
        && !args.follow
    {
        let near = DidYouMean(nearest(service, services.iter().map(String::as_str)));
        let all: Vec<_> = services.iter().map(String::as_str).collect();
        return Err(Problem::Other(format!(
            "{}: no log of {service:?}{near}; there are {}",
            run.display(),
            all.join(", ")
        )));
    }
    let mut reader = Reader::new(run);
    let mut is_read = reader.show(args, true);
    while args.follow && is_read {
        std::thread::sleep(LOOK);
        // Another run has another folder.
        if let Ok(run) = run_folder(instance, args)
            && run != reader.run
        {
            reader = Reader::new(run);
        }
        is_read = reader.show(args, false);
    }
    Ok(ExitCode::SUCCESS)
}

/// The folder of the run that is asked for.
fn run_folder(instance: &Instance, args: &Args) -> Result<PathBuf, Problem> {
    // Of a run that goes on, what is in memory: its disk may be what is wrong.
    let current = match instance.log_folder() {
        in_memory if in_memory.is_dir() => in_memory,
        _ => instance.log_place(),
    };
    if current.is_dir() && args.before == 0 {
        return Ok(current);
    }
    let on_disk = instance.log_on_disk().canonicalize().ok();
    let of_a_link = on_disk.as_deref().and_then(Path::parent);
    let mut places: Vec<PathBuf> = of_a_link.map(Path::to_owned).into_iter().collect();
    let config = places::config_folder(args.config.as_deref()).ok();
    let config = config.and_then(|folder| Config::load(&folder).ok());
    let configured = config.and_then(|config| config.log_dir);
    let on_disk = configured.into_iter().chain([PathBuf::from(SYSTEM_LOG_DIR)]);
    places.extend(on_disk.map(|folder| folder.join(instance.to_string())));
    let found = places.iter().find_map(|place| {
        let mut runs: Vec<(u64, PathBuf)> = std::fs::read_dir(place)
            .ok()?
            .flatten()
            .filter_map(|entry| Some((entry.file_name().to_str()?.parse().ok()?, entry.path())))
            .collect();
        runs.sort();
        runs.into_iter().rev().nth(args.before)
    });
    found.map(|(_, run)| run).ok_or_else(|| {
        let looked: Vec<_> = std::iter::once(&current)
            .chain(&places)
            .map(|place| place.display().to_string())
            .collect();
        Problem::Other(format!("jink {instance}: no such logs in {}", looked.join(", ")))
    })
}

/// The service of a log file, and whether the file was moved aside.
fn service_of(path: &Path) -> Option<(String, bool)> {
    let name = path.file_name()?.to_str()?;
    let aside = name
        .strip_suffix(".log.1")
        .map(|service| (service.to_owned(), true));
    aside.or_else(|| Some((name.strip_suffix(".log")?.to_owned(), false)))
}

fn files_in(run: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(run).into_iter().flatten().flatten();
    let mut files: Vec<_> = entries.map(|entry| entry.path()).collect();
    files.sort();
    files
}

fn services_in(run: &Path) -> BTreeSet<String> {
    let files = files_in(run);
    files
        .iter()
        .filter_map(|path| service_of(path))
        .map(|(service, _)| service)
        .collect()
}

/// The logs of a run, read up to somewhere.
struct Reader {
    run: PathBuf,
    /// Each file's bytes read so far, and its last line while that has no end yet.
    read: BTreeMap<PathBuf, (u64, String)>,
}

impl Reader {
    fn new(run: PathBuf) -> Self {
        let read = BTreeMap::new();
        Self { run, read }
    }

    /// Prints new lines of all files, at the first call those of rotated files too. Returns whether the output is still open.
    fn show(&mut self, args: &Args, with_aside: bool) -> bool {
        let mut lines = Vec::new();
        for path in files_in(&self.run) {
            let Some((service, is_aside)) = service_of(&path) else {
                continue;
            };
            let is_asked_for = args.service.as_ref().is_none_or(|asked| *asked == service);
            if !is_asked_for || is_aside && !with_aside {
                continue;
            }
            // A file that has just gone has nothing new.
            let text = self.new_text(&path).unwrap_or_default();
            lines.extend(LogLine::all(&service, &text));
        }
        merge(&mut lines);
        let level = args.level.unwrap_or(Level::TRACE);
        let mut out = std::io::stdout().lock();
        let mut lines = lines.iter().filter(|line| line.is_at_least(level));
        lines.try_for_each(|line| writeln!(out, "{line}")).is_ok() && out.flush().is_ok()
    }

    /// Whole lines that were not read yet.
    fn new_text(&mut self, path: &Path) -> std::io::Result<String> {
        let (position, rest) = self.read.entry(path.to_owned()).or_default();
        let mut file = File::open(path)?;
        // Moved aside meanwhile: it begins anew.
        if file.metadata()?.len() < *position {
            *position = 0;
        }
        file.seek(SeekFrom::Start(*position))?;
        let mut bytes = Vec::new();
        *position += file.read_to_end(&mut bytes)? as u64;
        let mut text = std::mem::take(rest) + &String::from_utf8_lossy(&bytes);
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        *rest = text.split_off(whole);
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::{Reader, service_of};
    use std::io::Write;
    use std::path::Path;

    #[test]
    fn a_log_that_is_followed_is_shown_line_by_line_and_from_its_begin_when_it_was_moved_aside() {
        let run = std::env::temp_dir().join(format!("jink_follow_{}", std::process::id()));
        std::fs::create_dir_all(&run).unwrap();
        let path = run.join("planner.log");
        let mut log = std::fs::File::options()
            .create(true)
            .append(true)
            .open(&path)
            .unwrap();
        let mut reader = Reader::new(run.clone());
        write!(log, "one\ntw").unwrap();
        assert_eq!(reader.new_text(&path).unwrap(), "one\n");
        writeln!(log, "o").unwrap();
        assert_eq!(reader.new_text(&path).unwrap(), "two\n");
        assert_eq!(reader.new_text(&path).unwrap(), "");
        log.set_len(0).unwrap();
        writeln!(log, "a").unwrap();
        assert_eq!(reader.new_text(&path).unwrap(), "a\n");
        std::fs::remove_dir_all(&run).unwrap();
    }

    #[test]
    fn logs_are_known_by_their_names() {
        let of = |name: &str| service_of(Path::new(name));
        assert_eq!(of("planner.log"), Some(("planner".to_owned(), false)));
        assert_eq!(
            of("planner.shadow.log.1"),
            Some(("planner.shadow".to_owned(), true))
        );
        assert_eq!(of("planner.end.json"), None);
    }
}
