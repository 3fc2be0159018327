//! Command lines: how numbers are taken, and refused with what is possible.

use clap::{Command, Parser};
use std::ops::RangeInclusive;

/// A day: longer than anything that is waited for here (s).
const LONGEST_S: f64 = 86_400.0;
/// A timer's step (s).
const SHORTEST_S: f64 = 0.001;

/// The command line of this program; ends it where it cannot be understood.
pub fn parse<P: Parser>() -> P {
    let matches = with_negative_numbers(P::command()).get_matches();
    P::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Takes a negative number for the value of an option, so that the option says which ones are possible; else it would be an
/// unexpected argument.
pub fn with_negative_numbers(command: Command) -> Command {
    command
        .mut_args(|argument| match argument.get_action().takes_values() {
            true => argument.allow_negative_numbers(true),
            false => argument,
        })
        .mut_subcommands(with_negative_numbers)
}

/// A number within `range`.
///
/// # Errors
/// What is possible.
pub fn number(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let number = text.parse::<f64>().ok();
    number
        .filter(|number| range.contains(number))
        .ok_or_else(|| format!("possible are {} to {}", range.start(), range.end()))
}

/// A time that something may take (s).
///
/// # Errors
/// What is possible.
pub fn seconds(text: &str) -> Result<f64, String> {
    number(text, SHORTEST_S..=LONGEST_S)
}

/// A seed of something random.
///
/// # Errors
/// What is possible.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse()
        .map_err(|_| format!("possible are whole numbers from 0 to {}", u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::{seconds, seed, with_negative_numbers};
    use clap::{CommandFactory, Parser, Subcommand};

    #[derive(Debug, Parser)]
    struct Line {
        #[command(subcommand)]
        command: Fly,
    }

    #[derive(Debug, Subcommand)]
    enum Fly {
        Demo {
            #[arg(long, value_parser = seconds)]
            timeout: Option<f64>,
            #[arg(long, value_parser = seed)]
            seed: Option<u64>,
            #[arg(long)]
            json: bool,
        },
    }

    fn error(line: &str) -> String {
        let command = with_negative_numbers(Line::command());
        let matches = command.try_get_matches_from(line.split_whitespace());
        matches.unwrap_err().to_string()
    }

    #[test]
    fn a_negative_number_is_answered_with_the_range_and_a_wrong_option_with_the_right_one() {
        let timeout = error("jink demo --timeout -3");
        assert!(
            timeout.contains("'-3' for '--timeout <TIMEOUT>': possible are 0.001 to 86400"),
            "{timeout}"
        );
        assert!(error("jink demo --timeout 0").contains("possible are 0.001 to"));
        assert!(error("jink demo --timeout nan").contains("possible are 0.001 to"));
        assert!(error("jink demo --seed -1").contains("possible are whole numbers from 0"));
        assert!(error("jink demo --sed 3").contains("'--seed'"));
        assert!(error("jink demo -3").contains("unexpected argument '-3'"));
    }
}
