//! The check as a process: `jink-link-check`, started by `jink check link`.
//!
//! | in | out, one JSON object a line |
//! |---|---|
//! | the configuration, merged, on standard input; `--seconds S --stamps FILE` | `{"progress": …}` while it listens |
//! | the links | `{"findings": […], "subject": …, "seconds": …}` at the end, or `{"refused": …}` if the configuration is no plan |

use super::{LinkCheck, PassiveProbe, Plan, PlanError};
use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::link::{Link, LinkError};
use jink_mavlink_link::links::LinkSetup;
use jink_mavlink_link::message::{Destination, Outgoing, Received};
use jink_mavlink_link::signing::stamps::{self, StampKeeper};
use jink_mavlink_link::signing::{SIGNED_FRAME_MAX, sign};
use jink_runtime::config::{CONFIG_FILE, Config, ConfigError, Signing};
use jink_shared_types::Timestamp;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde_json::{Value, json};
use std::fmt;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Time between two steps: a request each 50 ms needs no finer one (ns).
const POLL_NS: i64 = 10_000_000;
/// How often progress is reported_at (s).
const PROGRESS_S: f64 = 0.5;
/// Messages taken at once from one link.
const MESSAGES_MAX: usize = 256;
/// Without `--seconds`.
const SECONDS: f64 = 15.0;

/// Why nothing can be checked.
#[derive(Debug)]
enum ToolError {
    /// The configuration cannot be read.
    Input(std::io::Error),
    /// It is none.
    Config(ConfigError),
    /// It describes nothing that can be checked.
    Plan(PlanError),
    /// The stamps of signatures cannot be kept.
    Stamps {
        /// Their file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

impl fmt::Display for ToolError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(source) => write!(f, "standard input: {source}"),
            Self::Config(source) => write!(f, "{source}"),
            Self::Plan(source) => write!(f, "{source}"),
            Self::Stamps { path, source } => {
                write!(f, "{}: the stamps of signatures: {source}", path.display())
            }
        }
    }
}

/// One link, open.
struct OpenLink {
    index: usize,
    link: Link,
    passive_probe: PassiveProbe,
    encoder: Encoder,
    setup: LinkSetup,
    signed: Box<[u8; SIGNED_FRAME_MAX]>,
}

impl OpenLink {
    fn open(index: usize, setup: &LinkSetup) -> Result<Self, LinkError> {
        let number = u8::try_from(index).unwrap_or(u8::MAX);
        let link = Link::open(setup.endpoint.clone())?
            .with_reply_policy(setup.reply_policy())
            .with_peers(setup.peers.clone())
            // So that types which the dialect does not know are no garbage.
            .among_others(number);
        Ok(Self {
            index,
            link,
            passive_probe: PassiveProbe::new(setup.clone()),
            encoder: Encoder::new(),
            setup: setup.clone(),
            signed: Box::new([0; SIGNED_FRAME_MAX]),
        })
    }

    fn receive(&mut self, received: &mut Vec<Received>, check: &mut LinkCheck) {
        received.clear();
        // A link that breaks is found by its silence.
        let _ = self
            .link
            .receive_through(jink_runtime::now, received, &mut self.passive_probe);
        for message in received.iter() {
            check.take(message);
        }
        check.set_counts(
            self.index,
            self.passive_probe.counts().with_link(self.link.counters()),
        );
    }

    fn send(&mut self, message: &Outgoing, stamps: Option<&mut StampKeeper>) {
        let frame = self
            .encoder
            .encode(message.system_id, message.component_id, &message.body);
        let bytes = match &self.setup.key {
            Some(key) => stamps
                .and_then(|stamps| stamps.take(stamps::wall()))
                .and_then(|stamp| sign(frame, key, self.setup.link_id, stamp, &mut self.signed)),
            None => Some(frame),
        };
        if let Some(bytes) = bytes {
            // A message that does not leave is not answered, and that is reported.
            let _ = self.link.send(jink_runtime::now(), bytes);
        }
    }
}

/// The stamps that the gateway uses, so that ours are newer than its last and its next are newer than ours; `None`
/// where no link is signed.
fn keeper(plan: &Plan, path: &Path) -> Result<Option<StampKeeper>, ToolError> {
    if plan.links.iter().all(|link| link.signing == Signing::Off) {
        return Ok(None);
    }
    let error = |source| ToolError::Stamps {
        path: path.to_owned(),
        source,
    };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(error)?;
    }
    let mut keeper = StampKeeper::open(path).map_err(error)?;
    keeper.begin(stamps::wall()).map_err(error)?;
    Ok(Some(keeper))
}

/// Runs `jink-link-check` with its arguments.
pub fn run(arguments: &[String]) -> ExitCode {
    let after = |flag: &str| {
        let at = arguments.iter().position(|argument| argument == flag)?;
        arguments.get(at + 1)
    };
    let seconds = after("--seconds")
        .and_then(|text| text.parse().ok())
        .unwrap_or(SECONDS);
    let stamps = after("--stamps").map_or_else(PathBuf::new, PathBuf::from);
    let planned = plan().and_then(|plan| {
        let keeper = keeper(&plan, &stamps)?;
        Ok((plan, keeper))
    });
    let (plan, keeper) = match planned {
        Ok(planned) => planned,
        Err(refused) => {
            print_line(&json!({ "refused": refused.to_string() }));
            return ExitCode::SUCCESS;
        }
    };
    check_links(plan, seconds, keeper);
    ExitCode::SUCCESS
}

fn plan() -> Result<Plan, ToolError> {
    let mut text = String::new();
    std::io::stdin()
        .read_to_string(&mut text)
        .map_err(ToolError::Input)?;
    let config = Config::parse(Path::new(CONFIG_FILE), &text).map_err(ToolError::Config)?;
    Plan::of(&config).map_err(ToolError::Plan)
}

fn check_links(plan: Plan, seconds: f64, mut stamps: Option<StampKeeper>) {
    let setups = plan.links.clone();
    let mut check = LinkCheck::new(plan, seconds);
    let mut lines = Vec::new();
    for (index, setup) in setups.iter().enumerate() {
        match OpenLink::open(index, setup) {
            Ok(line) => lines.push(line),
            Err(cause) => check.link_failed(index, cause.to_string()),
        }
    }
    let begin = jink_runtime::now();
    let mut received = Vec::with_capacity(MESSAGES_MAX);
    let mut out = Vec::new();
    let mut reported_at = Timestamp::NEVER;
    let end = loop {
        for line in &mut lines {
            line.receive(&mut received, &mut check);
        }
        let now = jink_runtime::now();
        check.step(now, &mut out);
        for message in out.drain(..) {
            let to = |line: &&mut OpenLink| message.to == Destination::Link(line.index as u8);
            if let Some(line) = lines.iter_mut().find(to) {
                line.send(&message, stamps.as_mut());
            }
        }
        if check.is_done(now) {
            break now;
        }
        if !reported_at.is_set() || now.seconds_since(reported_at) >= PROGRESS_S {
            reported_at = now;
            if !print_line(&json!({ "progress": check.progress(now) })) {
                return;
            }
        }
        wait(&lines);
    };
    let findings: Vec<Value> = check.findings(end).iter().map(super::Finding::to_json).collect();
    print_line(&json!({
        "findings": findings,
        "subject": check.subject(),
        "seconds": end.seconds_since(begin),
    }));
}

/// Until something has come, or for a moment.
fn wait(lines: &[OpenLink]) {
    let mut fds: Vec<_> = lines
        .iter()
        .filter_map(|line| line.link.fd())
        .map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
        .collect();
    let timeout = Timespec {
        tv_sec: 0,
        tv_nsec: POLL_NS,
    };
    // A signal only means that the wait ends sooner.
    let _ = poll(&mut fds, Some(&timeout));
}

/// One line of output; `false` if the reader is gone.
fn print_line(line: &Value) -> bool {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).is_ok()
}
