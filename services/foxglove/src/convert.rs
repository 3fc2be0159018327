//! `jink-foxglove convert`: what `live` would have shown of a recorded flight, in an MCAP file.

use crate::views::{self, View, Views, Visitor};
use foxglove::{Context, McapCompression, McapWriteOptions};
use jink_control::{Interrupt, Problem, sayln};
use jink_recorder::reading::{Ends, Message, Reading, RecordedSample};
use jink_shared_types::Stamped;
use jink_shared_types::layout::{from_bytes, type_name};
use std::fs::File;
use std::io::{BufWriter, IsTerminal, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// What to convert.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit codes: 0 written; 1 the recording is none of jink, damaged, of another layout, or has nothing that can be shown; OUT is there already, or cannot
be written. Of a recording that was cut off everything up to there is written.")]
pub struct Args {
    /// The recording
    file: PathBuf,
    /// The new file
    #[arg(long, value_name = "VIEWS.mcap")]
    out: PathBuf,
}

/// How often the progress is shown on a terminal.
const PROGRESS_PERIOD: Duration = Duration::from_millis(200);

/// Converts a recording.
///
/// # Errors
/// [`Problem`] if it cannot be read, or the views cannot be written; then there is no new file.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let interrupt = Interrupt::listen()?;
    let other = |error: &dyn std::fmt::Display| Problem::Other(error.to_string());
    let reading = Reading::open(&args.file).map_err(|error| other(&error))?;
    let part = Part::begin(&args.out)?;
    let context = Context::new();
    let mut views = Views::new(&context, ahead_ns(&reading)).map_err(|error| other(&error))?;
    let failure = Arc::new(OnceLock::new());
    let target = Target {
        file: BufWriter::new(File::create(&part.path).map_err(Problem::io(part.path.display().to_string()))?),
        failure: Arc::clone(&failure),
    };
    let options = McapWriteOptions::new().compression(Some(McapCompression::Lz4));
    let writer = context.mcap_writer_with_options(options).create(target);
    let writer = writer.map_err(|error| other(&error))?;
    let mut progress = Progress::default();
    let mut shown = 0u64;
    let mut refused = None;
    let ended = reading.each(|message| {
        if let Message::Sample(sample) = message {
            let mut show = Show {
                views: &mut views,
                sample,
                result: Ok(0),
            };
            views::each(&mut show);
            match show.result {
                Ok(samples) => shown += samples,
                Err(why) => refused = Some(why),
            }
            progress.show(sample.header.publish.seconds(), shown);
        }
        refused.is_none() && failure.get().is_none() && !interrupt.has_come()
    });
    progress.clear();
    let ended = ended.map_err(|error| other(&error))?;
    let closed = writer.close();
    if let Some(cause) = failure.get() {
        return Err(Problem::Other(format!("{}: {cause}", args.out.display())));
    }
    closed.map_err(|error| Problem::Other(format!("{}: {error}", args.out.display())))?;
    let why_not = match shown {
        _ if interrupt.has_come() => Some("interrupted; nothing is written".to_owned()),
        0 => Some("no sample in it can be shown".to_owned()),
        _ => None,
    };
    if let Some(why) = refused.or(why_not) {
        return Err(Problem::Other(format!("{}: {why}", args.file.display())));
    }
    part.keep(&args.out)?;
    sayln!("{}: views of {shown} samples", args.out.display());
    if ended == Ends::CutOff {
        eprintln!("{}: was cut off; this is what came before", args.file.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Time of the day minus the clock of the samples (ns), as the recording says.
fn ahead_ns(reading: &Reading) -> i64 {
    let number = |key: &str| reading.about.get(key)?.parse::<u64>().ok();
    let ahead_ns = number("unix_ns").zip(number("monotonic_ns"));
    // One that was cut off before it says so has no samples.
    ahead_ns.map_or(0, |(unix_ns, monotonic_ns)| {
        unix_ns.wrapping_sub(monotonic_ns).cast_signed()
    })
}

/// Shows one recorded sample.
struct Show<'a, 'b> {
    views: &'a mut Views,
    sample: &'a RecordedSample<'b>,
    /// How many were shown, or why not.
    result: Result<u64, String>,
}

impl Visitor for Show<'_, '_> {
    fn visit<V: View>(&mut self) {
        let RecordedSample {
            topic,
            type_name: recorded,
            header,
            payload,
            ..
        } = *self.sample;
        let Some(member) = V::TOPIC.row.member_of(topic) else {
            return;
        };
        let ours = type_name::<V>();
        if recorded != ours {
            self.result = Err(format!(
                "{topic} was recorded with another layout: {recorded}, this build has {ours}"
            ));
            return;
        }
        let sample = &*from_bytes::<V>(payload);
        if sample.is_plausible() {
            V::show(Stamped { sample, header }, member, self.views);
            self.result = Ok(1);
        }
    }
}

/// A file that has another name until it is whole, and is removed if it never is.
struct Part {
    path: PathBuf,
}

impl Part {
    fn begin(out: &Path) -> Result<Self, Problem> {
        // Also where the recording itself is meant.
        if out.symlink_metadata().is_ok() {
            return Err(Problem::Other(format!(
                "{}: is there already; name another file",
                out.display()
            )));
        }
        let mut path = out.as_os_str().to_owned();
        path.push(".part");
        Ok(Self { path: path.into() })
    }

    fn keep(self, out: &Path) -> Result<(), Problem> {
        std::fs::rename(&self.path, out).map_err(Problem::io(out.display().to_string()))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // It has its own name by now if it is whole.
        let _is_gone = std::fs::remove_file(&self.path);
    }
}

/// Where views are written. Foxglove's library drops what cannot be written: here it is noted.
struct Target {
    file: BufWriter<File>,
    failure: Arc<OnceLock<String>>,
}

impl Target {
    fn noted<T>(&self, result: std::io::Result<T>) -> std::io::Result<T> {
        result.inspect_err(|error| {
            // The first one counts.
            let _is_not_first = self.failure.set(error.to_string());
        })
    }
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes);
        self.noted(written)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        let flushed = self.file.flush();
        self.noted(flushed)
    }
}

impl Seek for Target {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = self.file.seek(to);
        self.noted(at)
    }
}

/// How far it has come, on a terminal.
#[derive(Default)]
struct Progress {
    began_s: Option<f64>,
    last: Option<Instant>,
}

impl Progress {
    fn show(&mut self, at_s: f64, samples: u64) {
        let began_s = *self.began_s.get_or_insert(at_s);
        let is_due = self.last.is_none_or(|last| last.elapsed() > PROGRESS_PERIOD);
        if is_due && std::io::stderr().is_terminal() {
            self.last = Some(Instant::now());
            eprint!("\r{:.0} s of the flight, {samples} samples", at_s - began_s);
        }
    }

    fn clear(&self) {
        if self.last.is_some() {
            eprint!("\r\x1b[K");
        }
    }
}
