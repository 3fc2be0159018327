//! `jink check link`.
//!
//! The examination belongs to the gateway, which alone knows MAVLink: this command starts its program as a tool and shows what
//! that finds. While jink runs here the link is the gateway's, and is looked at through its figures instead.

use super::{Outcome, Progress};
use jink_cli::running_link::{Seen, judge};
use jink_control::findings::{Finding, Findings, Grade};
use jink_control::watch::{PROGRAM, Watch};
use jink_control::{Interrupt, Problem, places, running};
use jink_runtime::config::Config;
use jink_runtime::{Instance, Session};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::topics;
use serde::Deserialize;
use serde_json::Map;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// How long a running gateway is looked at: three heartbeats of an autopilot, fifteen figures of the gateway.
const LOOK_AT_RUNNING: Duration = Duration::from_secs(3);
/// How often its new samples are read; its queue of states holds sixteen, 320 ms.
const LOOK: Duration = Duration::from_millis(20);

/// Which link, and for how long.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Profile laid over jink.toml: profiles/PROFILE.toml
    #[arg(long)]
    profile: Option<String>,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Where the autopilot is: udpin:ADDRESS:PORT, udpout:ADDRESS:PORT or serial:DEVICE:BAUD
    #[arg(long, value_name = "ADDRESS")]
    link: Option<String>,
    /// Value laid over the configuration, e.g. link.profile=px4_offboard (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// How long to look at most (s); what is clear sooner ends sooner
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=600))]
    pub(super) seconds: u32,
    /// One JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
}

/// A line of the program that examines.
#[derive(Deserialize)]
#[serde(untagged)]
enum Said {
    Progress { progress: String },
    Refused { refused: String },
    Done(Findings),
}

/// Examines the link.
pub fn run(instance: &Instance, args: &Args) -> Result<Outcome, Problem> {
    match configuration(args) {
        Err(problem) => Ok(Outcome::Refused(problem.to_string())),
        Ok((text, config)) => match holder(instance, &config, args)? {
            Some(address) => look_at_running(instance, &address),
            None => examine(&text, &config, args),
        },
    }
}

/// The configuration as text and as values, or what is wrong with it.
fn configuration(args: &Args) -> Result<(String, Config), Problem> {
    let folder = places::config_folder(args.config.as_deref())?;
    let link = args
        .link
        .as_ref()
        .map(|address| format!("link.address={address}"));
    let overrides: Vec<String> = link.into_iter().chain(args.overrides.iter().cloned()).collect();
    let resolved = Config::resolve(&folder, args.profile.as_deref(), None, &overrides);
    resolved
        .map(|resolved| (resolved.text, resolved.config))
        .map_err(|error| Problem::Other(error.to_string()))
}

/// The address of the autopilot's link, if this instance runs and no other address is asked for.
fn holder(instance: &Instance, config: &Config, args: &Args) -> Result<Option<String>, Problem> {
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        return Ok(None);
    }
    let names_address =
        args.link.is_some() || args.overrides.iter().any(|text| text.starts_with("link.address"));
    let is_named = names_address || args.profile.is_some() || args.config.is_some();
    let held = Config::load(&instance.run_config()).map(|config| config.link.address);
    Ok(held.ok().filter(|held| !is_named || *held == config.link.address))
}

/// Has the examining program look, and shows what it does meanwhile.
fn examine(text: &str, config: &Config, args: &Args) -> Result<Outcome, Problem> {
    let interrupt = Interrupt::listen()?;
    let stamps = Stamps::of(config);
    let mut command = places::program(&places::program_folder()?, "jink-link-check")?;
    command.args(["--seconds", &args.seconds.to_string(), "--stamps"]);
    command
        .arg(&stamps.path)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped());
    let mut child = command.spawn().map_err(Problem::io("jink-link-check"))?;
    let outcome = converse(&mut child, text, &interrupt);
    // Ended by itself, or no longer wanted.
    let _gone_already = child.kill();
    let _reaped = child.wait();
    outcome
}

fn converse(child: &mut Child, text: &str, interrupt: &Interrupt) -> Result<Outcome, Problem> {
    if let Some(mut input) = child.stdin.take() {
        input
            .write_all(text.as_bytes())
            .map_err(Problem::io("jink-link-check"))?;
    }
    let mut screen = Progress::default();
    for line in child
        .stdout
        .take()
        .map(BufReader::new)
        .into_iter()
        .flat_map(BufRead::lines)
    {
        let line = line.map_err(Problem::io("jink-link-check"))?;
        match serde_json::from_str(&line) {
            Ok(Said::Progress { progress }) => screen.show(&progress),
            Ok(Said::Refused { refused }) => return Ok(Outcome::Refused(refused)),
            Ok(Said::Done(findings)) => {
                screen.clear();
                return Ok(Outcome::Found(findings, Map::new(), String::new()));
            }
            Err(error) => return Err(Problem::Other(format!("jink-link-check: {error}: {line}"))),
        }
        if interrupt.has_come() {
            return Ok(Outcome::Interrupted);
        }
    }
    match interrupt.has_come() {
        true => Ok(Outcome::Interrupted),
        false => Err(Problem::Other(
            "jink-link-check ended without a verdict".to_owned(),
        )),
    }
}

/// Where the stamps of signatures are kept: the gateway's own, or, where those are kept in memory only, a file that is removed
/// with this. Stamps follow the clock, so the gateway's next ones are newer.
struct Stamps {
    path: PathBuf,
    is_temporary: bool,
}

impl Stamps {
    fn of(config: &Config) -> Self {
        match config.link.state.as_str() {
            "" => Self {
                path: std::env::temp_dir().join(format!("jink_check_{}.stamps", std::process::id())),
                is_temporary: true,
            },
            folder => Self {
                path: Path::new(folder).join("mavlink_gateway.stamps"),
                is_temporary: false,
            },
        }
    }
}

impl Drop for Stamps {
    fn drop(&mut self) {
        if self.is_temporary {
            // There is none unless something was signed.
            let _none = std::fs::remove_file(&self.path);
        }
    }
}

/// Looks at a running gateway.
fn look_at_running(instance: &Instance, address: &str) -> Result<Outcome, Problem> {
    let interrupt = Interrupt::listen()?;
    let session = Session::open(instance, PROGRAM)?;
    let mut figures = session.input(topics::LINK_STATUS, "")?;
    let mut states = session.input(topics::VEHICLE_STATE, "")?;
    let mut events = session.input(topics::EVENT, "")?.of_all_producers();
    let (mut first, mut last): (Option<Box<LinkStatus>>, Option<Box<LinkStatus>>) = (None, None);
    let (mut count, mut reported) = (0, Vec::new());
    let begin = Instant::now();
    // What had come before is not of this time.
    states.each(|_| {});
    while begin.elapsed() < LOOK_AT_RUNNING && !interrupt.has_come() {
        figures.each(|status| {
            let status = Box::new(*status.sample);
            if first.is_none() {
                first = Some(status.clone());
            }
            last = Some(status);
        });
        states.each(|_| count += 1);
        events.each(|event| reported.push(*event.sample));
        std::thread::sleep(LOOK);
    }
    let seconds = begin.elapsed().as_secs_f64();
    let mut findings = vec![Finding {
        grade: Grade::Good,
        about: "link".to_owned(),
        is: format!("jink {instance} runs and holds {address}: this is what its gateway sees"),
        remedy: String::new(),
    }];
    findings.extend(judge(&Seen {
        figures: first.as_deref().zip(last.as_deref()),
        seconds,
        states: count,
        events: &reported,
    }));
    let findings = Findings {
        findings,
        subject: "as the running gateway sees it; `jink down` first for versions and parameters".to_owned(),
        seconds,
    };
    Ok(Outcome::Found(findings, Map::new(), String::new()))
}
