//! `jink topic`: which topics there are, how fast they come, what they say.

use super::meter::Meter;
use super::watch::{PROGRAM, Watch};
use super::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Interrupt, Problem, running};
use jink_cli::beat::Beat;
use jink_cli::digest::{Digest, header_line};
use jink_cli::topic_list::{Listed, Members};
use jink_runtime::config::{Config, SensorOutput, process_names};
use jink_runtime::{Checks, Instance, OpenError, Session};
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::{self, TABLE, Topic, TopicRow, Visitor};
use std::fmt::{Debug, Write as _};
use std::io::Write as _;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// How often unread samples are looked for: a reader that sleeps longer would miss some of the fastest topic.
const LOOK: Duration = Duration::from_millis(2);

/// What to do.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Doing,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Doing {
    /// Every topic with its payload, rate, age limit, producers and readers
    List {
        /// One JSON array instead of a table
        #[arg(long)]
        json: bool,
    },
    /// Measure the rate of a topic
    #[command(after_help = "Exit codes: 0 measured; 1 no such topic, or nothing came; 3 not running.")]
    Hz {
        /// Its name, e.g. range/cloud/front
        topic: String,
        /// How long to measure (s)
        #[arg(long = "for", value_name = "S", default_value_t = 5.0)]
        seconds: f64,
        /// One JSON object instead of a line
        #[arg(long)]
        json: bool,
    },
    /// Show samples as they come
    #[command(after_help = "Exit codes: 0 shown; 1 no such topic, or nothing came; 3 not running.")]
    Echo {
        /// Its name, e.g. vehicle/state
        topic: String,
        /// End after so many samples (default: with Ctrl-C)
        #[arg(long)]
        count: Option<u64>,
        /// Show long lists in full
        #[arg(long)]
        full: bool,
        /// End when nothing has come for so long (s)
        #[arg(long, value_name = "S")]
        timeout: Option<f64>,
    },
}

/// Runs `jink topic`.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    match &args.action {
        Doing::List { json } => list(instance, *json),
        Doing::Hz { topic, seconds, json } => {
            let Some(session) = open(instance)? else {
                return Ok(ExitCode::from(EXIT_NOT_RUNNING));
            };
            let (row, member) = find(instance, topic)?;
            let beat = measure(Meter::open(&session, row, &member)?, *seconds)?;
            if *json {
                sayln!("{}", beat.json(topic, row));
            } else {
                sayln!("{}", beat.line(topic, row));
            }
            Ok(came(beat.samples()))
        }
        Doing::Echo {
            topic,
            count,
            full,
            timeout,
        } => {
            let Some(session) = open(instance)? else {
                return Ok(ExitCode::from(EXIT_NOT_RUNNING));
            };
            let (row, member) = find(instance, topic)?;
            let echo = Echo {
                session: &session,
                member: &member,
                count: *count,
                full: *full,
                patience: timeout.map(Duration::try_from_secs_f64).transpose(),
            };
            let shown = topics::visit(row, echo).ok_or_else(|| unknown(instance, topic))??;
            Ok(came(shown))
        }
    }
}

fn came(samples: u64) -> ExitCode {
    match samples {
        0 => ExitCode::from(EXIT_PROBLEM),
        _ => ExitCode::SUCCESS,
    }
}

fn list(instance: &Instance, json: bool) -> Result<ExitCode, Problem> {
    let members = running::find(instance)?.map(|_| members(instance));
    let listed: Vec<Listed> = TABLE
        .iter()
        .flat_map(|row| Listed::of(row, members.as_ref()))
        .collect();
    if json {
        let json = serde_json::to_string(&listed).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    } else {
        say!("{}", jink_cli::topic_list::table(&listed));
    }
    Ok(ExitCode::SUCCESS)
}

/// Connects to the running instance; `None`, and a word about it, if it does not run.
fn open(instance: &Instance) -> Result<Option<Session>, Problem> {
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        eprintln!("jink {instance}: not running");
        return Ok(None);
    }
    Ok(Some(Session::open(instance, PROGRAM)?))
}

/// Who the families' members are in a running instance.
pub fn members(instance: &Instance) -> Members {
    let folder = instance.run_config();
    let mut processes = process_names(&folder);
    processes.push("supervisor".to_owned());
    let sensors = Config::load(&folder)
        .map(|config| config.sensors)
        .unwrap_or_default();
    let of = |output: SensorOutput| {
        let publishing = sensors.iter().filter(|sensor| sensor.output == output);
        publishing.map(|sensor| sensor.name.clone()).collect()
    };
    Members {
        clouds: of(SensorOutput::Cloud),
        scans: of(SensorOutput::Scan),
        processes,
    }
}

/// The row and the member of a topic that exists in this instance.
fn find(instance: &Instance, name: &str) -> Result<(&'static TopicRow, String), Problem> {
    let members = members(instance);
    TABLE
        .iter()
        .find_map(|row| {
            let member = row.member_of(name)?;
            let known = !row.is_family() || members.of(row).iter().any(|known| known == member);
            known.then(|| (row, member.to_owned()))
        })
        .ok_or_else(|| unknown(instance, name))
}

fn unknown(instance: &Instance, name: &str) -> Problem {
    let mut text = format!("jink {instance} has no topic {name}; `jink topic list` names them");
    let members = members(instance);
    let all = TABLE.iter().flat_map(|row| Listed::of(row, Some(&members)));
    let last_part = name.rsplit('/').next().unwrap_or(name);
    let near: Vec<String> = all
        .map(|listed| listed.name)
        .filter(|known| known.contains(last_part))
        .collect();
    if !near.is_empty() && !last_part.is_empty() {
        // Writing into a string cannot fail.
        let _infallible = write!(text, " (perhaps {})", near.join(", "));
    }
    Problem::Other(text)
}

/// Listens to one topic for so long.
fn measure(mut meter: Meter, seconds: f64) -> Result<Beat, Problem> {
    let span = Duration::try_from_secs_f64(seconds)
        .map_err(|error| Problem::Other(format!("--for {seconds}: {error}")))?;
    let interrupt = Interrupt::listen()?;
    let begin = Instant::now();
    let mut beat = Beat::default();
    while begin.elapsed() < span && !interrupt.has_come() {
        meter.look(|header| beat.take(header));
        std::thread::sleep(LOOK);
    }
    Ok(beat)
}

struct Echo<'a> {
    session: &'a Session,
    member: &'a str,
    count: Option<u64>,
    full: bool,
    patience: Result<Option<Duration>, std::time::TryFromFloatSecsError>,
}

impl Visitor for Echo<'_> {
    type Output = Result<u64, Problem>;

    fn visit<T: Layout + Debug + 'static>(self, topic: Topic<T>) -> Self::Output {
        let patience = self
            .patience
            .map_err(|error| Problem::Other(format!("--timeout: {error}")))?;
        let interrupt = Interrupt::listen()?;
        let mut input = self
            .session
            .input(topic, self.member)
            .map_err(|error: OpenError| Problem::Memory(error))?
            .of_all_producers()
            .with_checks(Checks::None);
        let (mut shown, mut last) = (0, Instant::now());
        let mut broken = None;
        let enough = |shown: u64| self.count.is_some_and(|count| shown >= count);
        while !enough(shown) && !interrupt.has_come() && patience.is_none_or(|most| last.elapsed() < most) {
            input.each(|stamped| {
                if enough(shown) || broken.is_some() {
                    return;
                }
                let mut text = Digest::new(self.full);
                // Writing into a string cannot fail.
                let _infallible = writeln!(text, "{:#?}", stamped.sample);
                let header = header_line(stamped.header);
                broken = writeln!(std::io::stdout(), "{header}\n{}---", text.finish()).err();
                shown += 1;
                last = Instant::now();
            });
            // Whoever read our output has seen enough.
            if broken.is_some() {
                break;
            }
            std::thread::sleep(LOOK);
        }
        Ok(shown)
    }
}
