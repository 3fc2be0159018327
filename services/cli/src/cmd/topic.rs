//! `jink topic`: which topics there are, how fast they come, what they say.

use jink_cli::view::sample_json;
use jink_cli::view::sample_text::{self, header_line};
use jink_cli::view::topic_statistics::TopicStatistics;
use jink_cli::view::topics::Listed;
use jink_control::meter::Meter;
use jink_control::watch::{PROGRAM, Watch};
use jink_control::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Interrupt, Problem, arguments, running};
use jink_control::{say, sayln};
use jink_runtime::config::Foreign;
use jink_runtime::members::Members;
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
    #[command(after_help = "Exit codes: 0 shown; 1 anything else.")]
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
        #[arg(long = "for", value_name = "S", default_value_t = 5.0, value_parser = arguments::seconds)]
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
        #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
        count: Option<u64>,
        /// Show long lists in full
        #[arg(long)]
        full: bool,
        /// One JSON object a sample, on one line
        #[arg(long, conflicts_with = "full")]
        json: bool,
        /// End when nothing has come for so long (s)
        #[arg(long, value_name = "S", value_parser = arguments::seconds)]
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
            let (row, meter) = match find(instance, topic)? {
                Found::InTable(row, member) => (*row, Some(Meter::open(&session, row, &member)?)),
                Found::Declared(row) => (row, Meter::open_declared(&session, &row)?),
            };
            let statistics = measure(meter.ok_or_else(|| unused(topic))?, *seconds)?;
            if *json {
                sayln!("{}", statistics.json(topic, &row));
            } else {
                sayln!("{}", statistics.line(topic, &row));
            }
            Ok(came(statistics.samples()))
        }
        Doing::Echo {
            topic,
            count,
            full,
            json,
            timeout,
        } => {
            let Some(session) = open(instance)? else {
                return Ok(ExitCode::from(EXIT_NOT_RUNNING));
            };
            let patience = timeout.map(Duration::try_from_secs_f64).transpose();
            let limits = Limits {
                count: *count,
                full: *full,
                json: *json,
                patience: patience.map_err(|error| Problem::Other(format!("--timeout: {error}")))?,
            };
            let shown = match find(instance, topic)? {
                Found::InTable(row, member) => {
                    let echo = Echo {
                        session: &session,
                        name: topic,
                        member: &member,
                        limits,
                    };
                    topics::visit(row, echo).ok_or_else(|| unknown(instance, topic))??
                }
                Found::Declared(row) => echo_bytes(&session, &row, limits)?,
            };
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
    let is_running = running::find(instance)?.is_some();
    let members = is_running.then(|| Members::of_instance(instance));
    let declared = if is_running {
        declared(instance)
    } else {
        Vec::new()
    };
    let rows = TABLE.iter().copied().chain(declared.iter().copied());
    let listed: Vec<Listed> = rows.flat_map(|row| Listed::of(&row, members.as_ref())).collect();
    if json {
        let json = serde_json::to_string(&listed).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    } else {
        say!("{}", jink_cli::view::topics::table(&listed));
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

/// The topics that a running instance's configuration declares.
pub fn declared(instance: &Instance) -> Vec<TopicRow> {
    // The supervisor has checked it.
    Foreign::load(&instance.run_config()).map_or_else(|_| Vec::new(), |foreign| foreign.topics)
}

/// A topic that exists in an instance.
enum Found {
    /// Its row and, of a family, which member.
    InTable(&'static TopicRow, String),
    /// The configuration declares it: its payload is not known here.
    Declared(TopicRow),
}

fn find(instance: &Instance, name: &str) -> Result<Found, Problem> {
    if let Some(row) = declared(instance).into_iter().find(|row| row.name == name) {
        return Ok(Found::Declared(row));
    }
    let members = Members::of_instance(instance);
    TABLE
        .iter()
        .find_map(|row| {
            let member = row.member_of(name)?;
            let known = !row.is_family() || members.of(row).iter().any(|known| known == member);
            known.then(|| Found::InTable(row, member.to_owned()))
        })
        .ok_or_else(|| unknown(instance, name))
}

/// A declared topic comes into being with its first user, who alone knows its payload.
fn unused(name: &str) -> Problem {
    Problem::Other(format!("{name} is declared, and no process has opened it yet"))
}

fn unknown(instance: &Instance, name: &str) -> Problem {
    let mut text = format!("jink {instance} has no topic {name}; `jink topic list` names them");
    let members = Members::of_instance(instance);
    let declared = declared(instance);
    let rows = TABLE.iter().copied().chain(declared.iter().copied());
    let all = rows.flat_map(|row| Listed::of(&row, Some(&members)));
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
fn measure(mut meter: Meter, seconds: f64) -> Result<TopicStatistics, Problem> {
    let span = Duration::try_from_secs_f64(seconds)
        .map_err(|error| Problem::Other(format!("--for {seconds}: {error}")))?;
    let interrupt = Interrupt::listen()?;
    let begin = Instant::now();
    let mut statistics = TopicStatistics::default();
    while begin.elapsed() < span && !interrupt.has_come() {
        meter.look(|header| statistics.take(header));
        std::thread::sleep(LOOK);
    }
    Ok(statistics)
}

/// What ends an echo, and how much of a sample it shows.
struct Limits {
    count: Option<u64>,
    full: bool,
    json: bool,
    patience: Option<Duration>,
}

impl Limits {
    /// Prints what `look` finds until it is enough: `look` hands each text to its argument, which says whether another is wanted.
    fn echo(&self, mut look: impl FnMut(&mut dyn FnMut(String) -> bool)) -> Result<u64, Problem> {
        let interrupt = Interrupt::listen()?;
        let (mut shown, mut last, mut broken) = (0, Instant::now(), false);
        let enough = |shown: u64| self.count.is_some_and(|count| shown >= count);
        while !enough(shown)
            && !broken
            && !interrupt.has_come()
            && self.patience.is_none_or(|most| last.elapsed() < most)
        {
            look(&mut |text| {
                if !enough(shown) && !broken {
                    // Whoever read our output has seen enough.
                    broken = match self.json {
                        true => writeln!(std::io::stdout(), "{text}"),
                        false => writeln!(std::io::stdout(), "{text}---"),
                    }
                    .is_err();
                    shown += 1;
                    last = Instant::now();
                }
                !enough(shown) && !broken
            });
            std::thread::sleep(LOOK);
        }
        Ok(shown)
    }
}

struct Echo<'a> {
    session: &'a Session,
    name: &'a str,
    member: &'a str,
    limits: Limits,
}

impl Visitor for Echo<'_> {
    type Output = Result<u64, Problem>;

    fn visit<T: Layout + Debug + 'static>(self, topic: Topic<T>) -> Self::Output {
        let input = self.session.input(topic, self.member);
        let mut input = input
            .map_err(|error: OpenError| Problem::Memory(error))?
            .of_all_producers()
            .with_checks(Checks::None);
        let (mut wanted, full, json, name) = (true, self.limits.full, self.limits.json, self.name);
        self.limits.echo(|show| {
            input.each(|stamped| {
                if wanted && json {
                    wanted = show(sample_json::sample(name, stamped.header, stamped.sample).to_string());
                } else if wanted {
                    let text = sample_text::text(stamped.sample, full);
                    wanted = show(format!("{}\n{text}", header_line(stamped.header)));
                }
            });
        })
    }
}

/// Bytes of a sample that are shown unless all are asked for.
const BYTES_SHOWN: usize = 128;

/// Shows samples whose payload only their own programs know.
fn echo_bytes(session: &Session, row: &TopicRow, limits: Limits) -> Result<u64, Problem> {
    let mut input = session
        .raw_input(row, row.name)?
        .ok_or_else(|| unused(row.name))?;
    if !limits.json {
        sayln!(
            "{} bytes of {}, known to its own programs only",
            input.size(),
            input.type_name()
        );
    }
    let most = if limits.full { usize::MAX } else { BYTES_SHOWN };
    limits.echo(|show| {
        input.each(|header, bytes| {
            show(match limits.json {
                true => sample_json::unknown(row.name, header, bytes).to_string(),
                false => format!("{}\n{}", header_line(header), hex(bytes, most)),
            });
        });
    })
}

/// Sixteen bytes a line, with the offset of the first.
fn hex(bytes: &[u8], most: usize) -> String {
    let mut text = String::new();
    for (line, chunk) in bytes[..bytes.len().min(most)].chunks(16).enumerate() {
        let numbers: Vec<String> = chunk.iter().map(|byte| format!("{byte:02x}")).collect();
        // Writing into a string cannot fail.
        let _infallible = writeln!(text, "{:6}  {}", 16 * line, numbers.join(" "));
    }
    if bytes.len() > most {
        let _infallible = writeln!(text, "        ... {} more", bytes.len() - most);
    }
    text
}
