//! The examination as a process: `jink-link-check`, started by `jink check link`.
//!
//! | in | out, one JSON object a line |
//! |---|---|
//! | the configuration, merged, on standard input; `--seconds S --stamps FILE` | `{"progress": …}` while it listens |
//! | the links | `{"findings": […], "subject": …, "seconds": …}` at the end, or `{"refused": …}` if the configuration is no plan |

use super::{Ear, Examination, Plan, PlanError};
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

/// What the examination may say between two looks at the clock: a request each 50 ms needs no finer one.
const LOOK_NS: i64 = 10_000_000;
/// How often progress is told (s).
const PROGRESS_S: f64 = 0.5;
/// Messages taken at once from one link.
const MESSAGES_MAX: usize = 256;
/// Without `--seconds`.
const SECONDS: f64 = 15.0;

/// Why nothing can be examined.
#[derive(Debug)]
enum ToolError {
    /// The configuration cannot be read.
    Input(std::io::Error),
    /// It is none.
    Config(ConfigError),
    /// It describes nothing that can be examined.
    Plan(PlanError),
    /// The stamps of signatures cannot be kept.
    Stamps {
        /// Their file.
        path: PathBuf,
        /// What the system says.
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
struct Line {
    index: usize,
    link: Link,
    ear: Ear,
    encoder: Encoder,
    setup: LinkSetup,
    signed: Box<[u8; SIGNED_FRAME_MAX]>,
}

impl Line {
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
            ear: Ear::new(setup.clone()),
            encoder: Encoder::new(),
            setup: setup.clone(),
            signed: Box::new([0; SIGNED_FRAME_MAX]),
        })
    }

    fn hear(&mut self, received: &mut Vec<Received>, examination: &mut Examination) {
        received.clear();
        // A line that breaks is seen by its silence.
        let _broken = self
            .link
            .receive_through(jink_runtime::now, received, &mut self.ear);
        for message in received.iter() {
            examination.take(message);
        }
        examination.notice(self.index, self.ear.counts().with_link(self.link.counters()));
    }

    fn say(&mut self, message: &Outgoing, stamps: Option<&mut StampKeeper>) {
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
            // What does not leave is not answered, and that is told.
            let _unsent = self.link.send(jink_runtime::now(), bytes);
        }
    }
}

/// The stamps that the gateway uses, so that ours are newer than its last and its next are newer than ours; `None` where no link
/// is signed.
fn keeper(plan: &Plan, path: &Path) -> Result<Option<StampKeeper>, ToolError> {
    if plan.links.iter().all(|link| link.signing == Signing::Off) {
        return Ok(None);
    }
    let said = |source| ToolError::Stamps {
        path: path.to_owned(),
        source,
    };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(said)?;
    }
    let mut keeper = StampKeeper::open(path).map_err(said)?;
    keeper.begin(stamps::wall()).map_err(said)?;
    Ok(Some(keeper))
}

/// Runs `jink-link-check` with the arguments behind that word.
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
            say(&json!({ "refused": refused.to_string() }));
            return ExitCode::SUCCESS;
        }
    };
    examine(plan, seconds, keeper);
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

fn examine(plan: Plan, seconds: f64, mut stamps: Option<StampKeeper>) {
    let setups = plan.links.clone();
    let mut examination = Examination::new(plan, seconds);
    let mut lines = Vec::new();
    for (index, setup) in setups.iter().enumerate() {
        match Line::open(index, setup) {
            Ok(line) => lines.push(line),
            Err(cause) => examination.fail(index, cause.to_string()),
        }
    }
    let begin = jink_runtime::now();
    let mut received = Vec::with_capacity(MESSAGES_MAX);
    let mut out = Vec::new();
    let mut told = Timestamp::NEVER;
    let end = loop {
        for line in &mut lines {
            line.hear(&mut received, &mut examination);
        }
        let now = jink_runtime::now();
        examination.step(now, &mut out);
        for message in out.drain(..) {
            let to = |line: &&mut Line| message.to == Destination::Link(line.index as u8);
            if let Some(line) = lines.iter_mut().find(to) {
                line.say(&message, stamps.as_mut());
            }
        }
        if examination.is_done(now) {
            break now;
        }
        if !told.is_set() || now.seconds_since(told) >= PROGRESS_S {
            told = now;
            if !say(&json!({ "progress": examination.progress(now) })) {
                return;
            }
        }
        wait(&lines);
    };
    let findings: Vec<Value> = examination
        .findings(end)
        .iter()
        .map(super::Finding::to_json)
        .collect();
    say(&json!({
        "findings": findings,
        "subject": examination.subject(),
        "seconds": end.seconds_since(begin),
    }));
}

/// Until something has come, or for a moment.
fn wait(lines: &[Line]) {
    let mut fds: Vec<_> = lines
        .iter()
        .filter_map(|line| line.link.fd())
        .map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
        .collect();
    let look = Timespec {
        tv_sec: 0,
        tv_nsec: LOOK_NS,
    };
    // A signal in between only means to look sooner.
    let _interrupted = poll(&mut fds, Some(&look));
}

/// One line for whoever has started this; `false` if nobody reads any more.
fn say(line: &Value) -> bool {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).is_ok()
}
