//! `jink param`: the parameters in force, and changing them while jink runs.
//!
//! A change is asked of the parameter server, which owns them: it decides, keeps the value and publishes it to every service; the
//! gateway sends it to ground stations. This command waits for its answer.

use jink_control::parameters::{Listed, table};
use jink_control::watch::{PROGRAM, Watch};
use jink_control::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Problem, running};
use jink_control::{say, sayln};
use jink_runtime::config::Config;
use jink_runtime::{Input, Instance, Session};
use jink_shared_types::param_messages::{ParameterChange, ParameterValues, table_of};
use jink_shared_types::params::{Apply, ParamError, ParamSet};
use jink_shared_types::{Reserved, SampleHeader, topics};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// The values come once a second, and the parameter server may just be restarting.
const PATIENCE: Duration = Duration::from_secs(4);
/// How often an answer is looked for.
const LOOK: Duration = Duration::from_millis(5);
/// How often an unanswered change is asked for again.
const AGAIN: Duration = Duration::from_millis(300);

/// What to do.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Exit codes: 0 done; 1 refused, or no answer; 3 nothing is running.")]
pub struct Args {
    #[command(subcommand)]
    action: Doing,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Doing {
    /// Every parameter with its value, unit and range
    List {
        /// One JSON object a line instead of a table
        #[arg(long)]
        json: bool,
    },
    /// The value of one
    Get {
        /// Its name, e.g. OA_SPD_MAX
        name: String,
        /// One JSON object instead of the value
        #[arg(long)]
        json: bool,
    },
    /// Change one, now
    Set {
        /// Its name, e.g. OA_SPD_MAX
        name: String,
        /// Its value
        #[arg(allow_negative_numbers = true)]
        value: f64,
    },
}

/// Does it.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    // Which rows there are is a matter of the configuration that runs, if any does.
    let known =
        Config::load(&instance.run_config()).map_or_else(|_| ParamSet::default(), |config| config.params);
    if let Doing::Set { name, value } = &args.action {
        // Said before anything is asked for: a typing error needs no running system.
        known.clone().set(name, *value).map_err(refused)?;
    }
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let session = Session::open(instance, PROGRAM)?;
    let mut values = session.input(topics::PARAMETERS, "")?;
    match &args.action {
        Doing::List { json } => {
            let rows = rows(&newest(&mut values, &known)?, &known);
            if *json {
                for row in &rows {
                    print_json(row)?;
                }
            } else {
                say!("{}", table(&rows));
            }
            Ok(ExitCode::SUCCESS)
        }
        Doing::Get { name, json } => {
            let rows = rows(&newest(&mut values, &known)?, &known);
            let Some(row) = rows.iter().find(|row| row.name == name) else {
                // The table's own words, with the nearest name.
                let unknown = known.clone().set(name, 0.0);
                return Err(Problem::Other(
                    unknown.err().map_or_else(String::new, |e| e.to_string()),
                ));
            };
            if *json {
                print_json(row)?;
            } else {
                sayln!("{}", row.value);
            }
            Ok(ExitCode::SUCCESS)
        }
        Doing::Set { name, value } => {
            let mut now = known.clone();
            for (row, value) in newest(&mut values, &known)?.rows(&known) {
                now.set(row.name, value).map_err(refused)?;
            }
            now.change(name, *value).map_err(refused)?;
            set(&session, &mut values, &known, name, *value)
        }
    }
}

fn refused(error: ParamError) -> Problem {
    Problem::Other(error.to_string())
}

fn rows(values: &ParameterValues, known: &ParamSet) -> Vec<Listed> {
    values
        .rows(known)
        .map(|(row, value)| Listed::of(row, value))
        .collect()
}

fn print_json(row: &Listed) -> Result<(), Problem> {
    let text = serde_json::to_string(row).map_err(|error| Problem::Other(error.to_string()))?;
    sayln!("{text}");
    Ok(())
}

fn no_answer() -> Problem {
    Problem::Other("the parameter server gives no answer: does it run? `jink status` shows it".to_owned())
}

/// The values as the parameter server publishes them.
fn newest(values: &mut Input<ParameterValues>, known: &ParamSet) -> Result<ParameterValues, Problem> {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(sample) = values.latest(jink_runtime::now()).fresh() {
            return match sample.sample.rows(known).next() {
                Some(_) => Ok(*sample.sample),
                None => Err(Problem::Other(
                    "the parameter server has another parameter table: use binaries of one build".to_owned(),
                )),
            };
        }
        std::thread::sleep(LOOK);
    }
    Err(no_answer())
}

/// Asks until it is answered.
fn set(
    session: &Session,
    values: &mut Input<ParameterValues>,
    known: &ParamSet,
    name: &str,
    value: f64,
) -> Result<ExitCode, Problem> {
    let number = known.number_of(name);
    let Some((number, row)) = number.and_then(|number| Some((number, known.row(number)?))) else {
        return Ok(ExitCode::from(EXIT_PROBLEM));
    };
    let mut requests = session.output(topics::PARAMETER_CHANGE, "", std::process::id())?;
    let change = ParameterChange {
        table: table_of(known),
        // Never 0, and no other request's.
        id: jink_runtime::now().ns | 1,
        value,
        row: number as u32,
        reserved: Reserved::ZERO,
    };
    let end = Instant::now() + PATIENCE;
    let mut ask_at = Instant::now();
    while Instant::now() < end {
        if Instant::now() >= ask_at {
            requests.send(SampleHeader::at(jink_runtime::now()), &change);
            ask_at = Instant::now() + AGAIN;
        }
        let answer = values.latest(jink_runtime::now()).fresh();
        if let Some(answer) = answer.filter(|answer| answer.sample.answered == change.id) {
            let now = answer.sample.rows(known).find(|(one, _)| one.name == row.name);
            return Ok(match now {
                Some((_, now)) if now == value => {
                    let when = match row.apply {
                        Apply::Live => "",
                        Apply::Restart => " (after a restart of jink)",
                    };
                    sayln!("{name} = {value} {}{when}", row.unit);
                    ExitCode::SUCCESS
                }
                _ => {
                    eprintln!("jink: the parameter server refuses {name} = {value}");
                    ExitCode::from(EXIT_PROBLEM)
                }
            });
        }
        std::thread::sleep(LOOK);
    }
    Err(no_answer())
}
