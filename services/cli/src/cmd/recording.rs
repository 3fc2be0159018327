//! `jink recording`: what recordings hold.

use jink_cli::view::recording::{CsvTable, Overview};
use jink_control::{EXIT_NOT_RUNNING, Problem, places, running, sayln};
use jink_recorder::reading::{Ends, Message, ReadError, Reading};
use jink_recorder::{Channel, CopyError, RecordingCopy};
use jink_runtime::Instance;
use jink_runtime::config::Config;
use jink_shared_types::Timestamp;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What to do with recordings.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Debug, clap::Subcommand)]
enum Subcommand {
    /// List the recordings of a folder
    #[command(after_help = "Exit codes: 0 shown; 1 there is no such folder.")]
    Ls {
        /// The folder; without it recorder.folder of jink.toml, else that of demonstrations
        folder: Option<PathBuf>,
        /// Configuration folder, for an instance that is not running; without it ./config, /etc/jink or that of the checkout
        #[arg(long, value_name = "DIR")]
        config: Option<PathBuf>,
    },
    /// Show what a recording holds: topics, samples, what is missing
    #[command(after_help = "Exit codes: 0 shown; 1 the file is no recording of jink, or damaged.")]
    Info {
        /// The recording
        file: PathBuf,
        /// One JSON object instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Write the configuration that a recorded flight was started with into a folder, e.g. to fly it again with --config
    #[command(
        after_help = "Exit codes: 0 written; 1 the file is no recording of jink, holds no configuration, or the folder holds one."
    )]
    Config {
        /// The recording
        file: PathBuf,
        /// The folder, made if it is not there
        folder: PathBuf,
    },
    /// Keep the last seconds, where the recorder writes only what is before and after an event (before_event_s in jink.toml)
    #[command(after_help = "Exit codes: 0 asked for; 1 nothing is recorded; 3 nothing is running.")]
    Keep,
    /// Write a part of a recording as a recording
    #[command(
        after_help = "Exit codes: 0 written; 1 the file is no recording of jink, damaged, or holds nothing of that time."
    )]
    Cut {
        /// The recording
        file: PathBuf,
        /// Begin so long after its first sample (s)
        #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = seconds_or_zero)]
        from: f64,
        /// End so long after its first sample (s); without it at its end
        #[arg(long, value_name = "S", value_parser = seconds_or_zero)]
        to: Option<f64>,
        /// Where it goes
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Write the samples of a topic as a CSV table, a line for each
    #[command(after_help = "\
Columns are named as fields are by `jink topic echo --json`; lists of more than 16 elements are left out.

Exit codes: 0 written; 1 the file is no recording of jink, damaged, of another layout, or has no such topic.")]
    Export {
        /// The recording
        file: PathBuf,
        /// The topic, e.g. vehicle/state
        topic: String,
        /// Where the table goes; without it to the terminal
        #[arg(long, value_name = "FILE")]
        csv: Option<PathBuf>,
    },
}

/// Runs `jink recording`.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    match &args.command {
        Subcommand::Ls { folder, config } => {
            ls(&recordings_of(instance, folder.as_deref(), config.as_deref())?)
        }
        Subcommand::Info { file, json } => info(file, *json),
        Subcommand::Config { file, folder } => write_config(file, folder),
        Subcommand::Keep => keep(instance),
        Subcommand::Cut { file, from, to, out } => cut(file, *from, *to, out),
        Subcommand::Export { file, topic, csv } => export(file, topic, csv.as_deref()),
    }
}

fn other(error: &ReadError) -> Problem {
    Problem::Other(error.to_string())
}

/// The folder that was asked for, else that of the configuration, which of a running instance is its own.
fn recordings_of(
    instance: &Instance,
    folder: Option<&Path>,
    config: Option<&Path>,
) -> Result<PathBuf, Problem> {
    if let Some(folder) = folder {
        return Ok(folder.to_owned());
    }
    let running = Some(instance.run_config()).filter(|folder| config.is_none() && folder.is_dir());
    let config = running.map_or_else(|| places::config_folder(config), Ok)?;
    let config = Config::load(&config).map_err(|error| Problem::Other(error.to_string()))?;
    let folder = config.recorder.folder.or_else(places::recordings_folder);
    folder.ok_or_else(|| {
        Problem::Other(
            "nothing is recorded: [recorder] of jink.toml names no folder; name one here".to_owned(),
        )
    })
}

fn ls(folder: &Path) -> Result<ExitCode, Problem> {
    let entries = std::fs::read_dir(folder).map_err(Problem::io(&folder.display().to_string()))?;
    let mut files: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"))
        .collect();
    // Two that were begun in one second have names in no order.
    files.sort_by_key(|file| {
        std::fs::metadata(file)
            .and_then(|metadata| metadata.modified())
            .ok()
    });
    for file in &files {
        match Reading::open(file) {
            Ok(reading) => sayln!("{}  {}", file.display(), Overview::of(&reading).line()),
            Err(error) => sayln!("{error}"),
        }
    }
    if files.is_empty() {
        sayln!("{}: no recordings", folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn write_config(file: &Path, folder: &Path) -> Result<ExitCode, Problem> {
    let reading = Reading::open(file).map_err(|error| other(&error))?;
    if reading.files.is_empty() {
        return Err(Problem::Other(format!(
            "{}: holds no configuration",
            file.display()
        )));
    }
    let problem = |path: &Path| Problem::io(path.display().to_string());
    std::fs::create_dir_all(folder).map_err(problem(folder))?;
    for (name, text) in &reading.files {
        // A name of a recording leads nowhere else.
        let path = folder.join(Path::new(name).file_name().unwrap_or_default());
        let mut new = File::create_new(&path).map_err(problem(&path))?;
        new.write_all(text.as_bytes()).map_err(problem(&path))?;
        sayln!("{}", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// The recorder looks for the file twice a second.
fn keep(instance: &Instance) -> Result<ExitCode, Problem> {
    if running::find(instance)?.is_none() {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let config = Config::load(&instance.run_config()).map_err(|error| Problem::Other(error.to_string()))?;
    if config.recorder.folder.is_none() {
        return Err(Problem::Other(format!(
            "jink {instance}: nothing is recorded: [recorder] of jink.toml names no folder"
        )));
    }
    let file = instance.recording_asked();
    std::fs::write(&file, "").map_err(Problem::io(file.display().to_string()))?;
    match config.recorder.before_event_s {
        Some(before_s) => sayln!("asked for: the last {before_s} s, and as much from now on"),
        None => sayln!("everything is recorded anyway"),
    }
    Ok(ExitCode::SUCCESS)
}

fn info(file: &Path, json: bool) -> Result<ExitCode, Problem> {
    let reading = Reading::open(file).map_err(|error| other(&error))?;
    let overview = Overview::of(&reading);
    if json {
        sayln!("{}", overview.json());
    } else {
        sayln!("{}  {}\n\n{}", file.display(), overview.line(), overview.table());
    }
    match overview.damage {
        Some(damage) => Err(Problem::Other(damage)),
        None => Ok(ExitCode::SUCCESS),
    }
}

fn seconds_or_zero(text: &str) -> Result<f64, String> {
    jink_control::arguments::number(text, 0.0..=f64::MAX)
}

fn cut(file: &Path, from_s: f64, to_s: Option<f64>, out: &Path) -> Result<ExitCode, Problem> {
    let reading = Reading::open(file).map_err(|error| other(&error))?;
    let problem = |error: CopyError| Problem::Other(error.to_string());
    let mut first = None;
    let ended = reading.each(|message| {
        if let Message::Sample(sample) = message {
            let time = sample.header.publish;
            first = Some(first.map_or(time, |first: Timestamp| first.min(time)));
        }
        true
    });
    ended.map_err(|error| other(&error))?;
    let first = first.unwrap_or(Timestamp::NEVER);
    let is_wanted = |time: Timestamp| {
        let t_s = time.seconds_since(first);
        t_s >= from_s && to_s.is_none_or(|to_s| t_s <= to_s)
    };
    let mut copy = RecordingCopy::begin(out, &reading, &[file.to_owned()]).map_err(problem)?;
    let (mut samples, mut failed, mut now) = (0_u64, None, first);
    let ended = reading.each(|message| {
        let written = match message {
            Message::Sample(sample) if is_wanted(sample.header.publish) => {
                samples += 1;
                now = sample.header.publish;
                copy.write(&Channel::from(sample), sample.header, sample.payload)
            }
            Message::Lost(topic, count) if is_wanted(now) => copy.write_lost(now, topic, *count),
            _ => Ok(()),
        };
        failed = written.err();
        failed.is_none()
    });
    ended.map_err(|error| other(&error))?;
    if let Some(error) = failed {
        return Err(problem(error));
    }
    if samples == 0 {
        return Err(Problem::Other(format!(
            "{}: holds nothing of that time",
            file.display()
        )));
    }
    copy.finish().map_err(problem)?;
    sayln!("{}: {samples} samples", out.display());
    Ok(ExitCode::SUCCESS)
}

fn export(file: &Path, topic: &str, csv: Option<&Path>) -> Result<ExitCode, Problem> {
    let reading = Reading::open(file).map_err(|error| other(&error))?;
    let mut table = CsvTable::new(topic);
    let mut topics = std::collections::BTreeSet::new();
    let mut refused = None;
    let mut lines = Vec::new();
    let ended = reading.each(|message| {
        if let Message::Sample(sample) = message {
            topics.insert(sample.topic.to_owned());
            if sample.topic == topic {
                match table.line(sample) {
                    Ok(line) => lines.push(line),
                    Err(why) => refused = Some(why),
                }
            }
        }
        refused.is_none()
    });
    if let Some(why) = refused {
        return Err(Problem::Other(format!("{}: {why}", file.display())));
    }
    let ended = ended.map_err(|error| other(&error))?;
    if lines.is_empty() {
        let all: Vec<&str> = topics.iter().map(String::as_str).collect();
        return Err(Problem::Other(format!(
            "{}: no sample of {topic}; there are {}",
            file.display(),
            all.join(", ")
        )));
    }
    let write = |out: &mut dyn Write| -> std::io::Result<()> {
        writeln!(out, "{}", table.header())?;
        lines.iter().try_for_each(|line| writeln!(out, "{line}"))?;
        out.flush()
    };
    match csv {
        Some(path) => File::create(path)
            .and_then(|file| write(&mut BufWriter::new(file)))
            .map_err(Problem::io(&path.display().to_string()))?,
        None => write(&mut std::io::stdout().lock()).map_err(Problem::io("the terminal"))?,
    }
    if ended == Ends::CutOff {
        eprintln!("{}: was cut off; this is what came before", file.display());
    }
    Ok(ExitCode::SUCCESS)
}
