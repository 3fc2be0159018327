//! `jink check`: what keeps jink from flying, before the flight.
//!
//! | command | examines |
//! |---|---|
//! | `jink check link` | the link to the autopilot |

mod link;

use super::Problem;
use jink_cli::findings::Findings;
use jink_runtime::Instance;
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
    action: Doing,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Doing {
    /// The link to the autopilot: what keeps jink from flying over it, and what to do about it
    #[command(after_help = "\
Opens the configured links itself, listens, and asks the autopilot for its version, parameters, streams and time. It sends no
setpoint, changes no mode and no parameter, and does not arm. While this instance runs, the gateway's own figures are shown
instead.

Exit codes: 0 ready (there may be warnings); 1 something keeps jink from flying; 2 wrong usage or configuration.")]
    Link(link::Args),
}

/// How an examination ended.
enum Outcome {
    Found(Findings),
    Refused(String),
    Interrupted,
}

/// Examines.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let (outcome, json) = match &args.action {
        Doing::Link(args) => (link::run(instance, args)?, args.json),
    };
    let code = match outcome {
        Outcome::Found(findings) => {
            if json {
                sayln!("{}", findings.json());
            } else {
                say!("{}", findings.text());
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
    };
    Ok(ExitCode::from(code))
}

/// One line that is written over itself, on a terminal only.
#[derive(Default)]
struct Progress {
    width: usize,
}

impl Progress {
    fn show(&mut self, text: &str) {
        let mut screen = std::io::stderr();
        if screen.is_terminal() {
            let width = self.width.max(text.chars().count());
            let _nobody_looks = write!(screen, "\r{text:width$}");
            self.width = width;
        }
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

    #[test]
    fn a_time_that_is_none_is_refused_and_fifteen_seconds_are_enough_without_one() {
        let parse = |line: &str| Line::try_parse_from(line.split_whitespace());
        let Doing::Link(args) = parse("check link").unwrap().args.action;
        assert_eq!((args.seconds, args.json), (15, false));
        for refused in [
            "check link --seconds 0",
            "check link --seconds soon",
            "check wind",
        ] {
            assert!(parse(refused).is_err(), "{refused}");
        }
    }
}
