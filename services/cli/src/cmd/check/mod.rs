//! `jink check`: what keeps jink from flying, before the flight.
//!
//! | command | examines |
//! |---|---|
//! | `jink check config` | the configuration: every mistake in it, with file and line |
//! | `jink check host` | what the board is set up for, and how late it wakes a thread |
//! | `jink check link` | the link to the autopilot |
//! | `jink check memory` | whether the topics have room in shared memory; also without a word behind `check` |
//! | `jink check sensors` | the sensors of a jink that runs, and what the guard sees with them |

mod config;
mod host;
mod link;
mod memory;
mod sensors;

use jink_control::findings::Findings;
use jink_control::{EXIT_NOT_RUNNING, Problem};
use jink_control::{say, sayln};
use jink_runtime::Instance;
use serde_json::{Map, Value};
use std::io::{IsTerminal, Write};
use std::process::ExitCode;

/// Nothing keeps jink from flying.
const EXIT_READY: u8 = 0;
/// Something does.
const EXIT_BLOCKED: u8 = 1;
/// The command or the configuration is wrong: nothing was examined.
const EXIT_USAGE: u8 = 2;

/// What to examine.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Option<Doing>,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Doing {
    /// The configuration: every mistake in it at once, with file, line and the nearest valid word
    #[command(after_help = "\
Reads jink.toml, what lies over it and services.toml as jink and its drivers read them, and the keys and metadata that they name.
Nothing is opened or started, and nothing has to run. `jink up` and `jink demo` ask the same before they start anything.

Exit codes: 0 ready; 1 there are mistakes; 2 wrong usage.")]
    Config(config::Args),
    /// The board: scheduler, rights, frequency, cores, clock, swap, heat, and how late it wakes a thread
    #[command(after_help = "\
Reads what the kernel says and measures for a few seconds how late a thread is woken that sleeps a millisecond, with and without
SCHED_FIFO. Nothing has to run and nothing is changed; run it once on a quiet board and once while jink flies.

Exit codes: 0 ready (there may be warnings); 1 interrupted; 2 wrong usage or configuration.")]
    Host(host::Args),
    /// The link to the autopilot: what keeps jink from flying over it, and what to do about it
    #[command(after_help = "\
Opens the configured links itself, listens, and asks the autopilot for its version, parameters, streams and time. It sends no
setpoint, changes no mode and no parameter, and does not arm. While this instance runs, the gateway's own figures are shown
instead.

Exit codes: 0 ready (there may be warnings); 1 something keeps jink from flying; 2 wrong usage or configuration.")]
    Link(link::Args),
    /// The sensors of a running jink: whether each sends data, in time and credibly, and which directions no sensor covers
    #[command(after_help = "\
Listens to what every configured sensor says and to what the guard makes of it, and changes nothing. It works on a running
instance (`jink up`), real or simulated: on the ground before the take-off, with people and things at a distance.

With --calibrate it says where three-dimensional sensors are mounted, how sure that is, and which rows of jink.toml follow.

Exit codes: 0 ready (there may be warnings); 1 something keeps jink from flying; 2 wrong usage or configuration; 3 not
running.")]
    Sensors(sensors::Args),
    /// Shared memory: what the topics of this configuration take, and what there is
    #[command(after_help = "\
Computed from the configuration; nothing has to run. It is what a plain `jink check` does.

Exit codes: 0 ready (there may be warnings); 1 something keeps jink from flying; 2 wrong usage or configuration.")]
    Memory(memory::Args),
}

impl Doing {
    /// Where nothing is said.
    fn usual() -> Self {
        Self::Memory(memory::Args::default())
    }
}

/// How an examination ended.
enum Outcome {
    /// With figures for scripts, which stand beside the findings, and rows of a configuration to copy.
    Found(Findings, Map<String, Value>, String),
    Refused(String),
    Interrupted,
    NotRunning,
}

/// Examines.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let usual = Doing::usual();
    let (outcome, json) = match args.action.as_ref().unwrap_or(&usual) {
        Doing::Config(args) => (config::run(args)?, args.json),
        Doing::Host(args) => (host::run(args)?, args.json),
        Doing::Memory(args) => (memory::run(instance, args)?, args.json),
        Doing::Link(args) => (link::run(instance, args)?, args.json),
        Doing::Sensors(args) => (sensors::run(instance, args)?, args.json),
    };
    let code = match outcome {
        Outcome::Found(findings, figures, rows) => {
            if json {
                let mut object = findings.json();
                if let Some(object) = object.as_object_mut() {
                    object.extend(figures);
                }
                sayln!("{object}");
            } else {
                say!("{}{rows}", findings.text());
            }
            if findings.is_ready() {
                EXIT_READY
            } else {
                EXIT_BLOCKED
            }
        }
        Outcome::Refused(problem) => {
            eprintln!("jink: {problem}");
            EXIT_USAGE
        }
        Outcome::Interrupted => EXIT_BLOCKED,
        Outcome::NotRunning => {
            eprintln!("jink {instance}: not running; `jink up` starts it");
            EXIT_NOT_RUNNING
        }
    };
    Ok(ExitCode::from(code))
}

/// One line that is written over itself on a terminal; elsewhere the first one, so that nobody waits without knowing for what.
#[derive(Default)]
struct Progress {
    width: usize,
    has_begun: bool,
}

impl Progress {
    fn show(&mut self, text: &str) {
        let mut screen = std::io::stderr();
        if screen.is_terminal() {
            let width = self.width.max(text.chars().count());
            let _nobody_looks = write!(screen, "\r{text:width$}");
            self.width = width;
        } else if !self.has_begun {
            let _nobody_looks = writeln!(screen, "{text}");
        }
        self.has_begun = true;
    }

    fn clear(&mut self) {
        self.show("");
        if self.width > 0 {
            let _nobody_looks = write!(std::io::stderr(), "\r");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Args, Doing};
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    fn parse(line: &str) -> Result<Doing, clap::Error> {
        let line = Line::try_parse_from(line.split_whitespace())?;
        Ok(line.args.action.unwrap_or_else(Doing::usual))
    }

    #[test]
    fn a_time_that_is_none_is_refused_and_without_one_there_is_a_usual_one() {
        let Doing::Link(link) = parse("check link").unwrap() else {
            panic!("another command");
        };
        assert_eq!((link.seconds, link.json), (15, false));
        let Doing::Sensors(sensors) = parse("check sensors --json").unwrap() else {
            panic!("another command");
        };
        assert_eq!((sensors.seconds, sensors.json), (5, true));
        assert!(matches!(parse("check").unwrap(), Doing::Memory(_)));
        assert!(matches!(parse("check host --seconds 2").unwrap(), Doing::Host(host) if host.seconds == 2));
        let Doing::Sensors(sensors) =
            parse("check sensors --calibrate --against top --height-m 0.4").unwrap()
        else {
            panic!("another command");
        };
        assert!(
            sensors.calibrate && sensors.against.as_deref() == Some("top") && sensors.height_m == Some(0.4)
        );
        for refused in [
            "check link --seconds 0",
            "check link --seconds soon",
            "check sensors --seconds 0",
            "check sensors --seconds 601",
            "check wind",
            "check sensors --against top",
            "check sensors --height-m 0.4",
            "check sensors --calibrate --height-m 9",
            "check sensors --calibrate --height-m high",
        ] {
            assert!(parse(refused).is_err(), "{refused}");
        }
    }
}
