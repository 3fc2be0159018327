//! The viewer as a process.

use crate::access::{Access, own_token, read_token};
use crate::board::{Board, Change};
use crate::server::Server;
use crate::spectator::Spectator;
use jink_runtime::config::{Config, Foreign};
use jink_runtime::members::Members;
use jink_runtime::{Cycle, Instance, Output, Ports, Service, Session, StartError, Wake};
use jink_shared_types::param_messages::{ParameterChange, table_of};
use jink_shared_types::params::ParamSet;
use jink_shared_types::{Reserved, SampleHeader, Timestamp, topics};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;

/// How often everything is looked at (Hz).
const LOOK_HZ: u32 = 10;
/// How often a change that is not answered is asked for again (s).
const AGAIN_S: f64 = 0.3;
/// The longest that it is (s): the parameter server may just be restarting.
const CHANGE_PATIENCE_S: f64 = 4.0;

/// The service: see [`crate`].
#[derive(Debug)]
pub struct ViewerService {
    board: Arc<Board>,
    spectator: Spectator,
    known: ParamSet,
    generation: u32,
    /// Opened with the first change.
    changes: Option<Output<ParameterChange>>,
    asked: Option<Asked>,
}

/// A change that was asked for, and is not answered.
#[derive(Debug)]
struct Asked {
    change: Change,
    sample: ParameterChange,
    since: Timestamp,
    again_at: Timestamp,
}

impl Service for ViewerService {
    const PROGRAM: &'static str = "viewer";
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let (setup, config) = (ports.setup(), ports.config());
        let needs = |cause: String| StartError::Needs {
            what: "the live page".to_owned(),
            cause,
        };
        let address = config
            .viewer
            .address
            .ok_or_else(|| needs("[viewer] names no address".to_owned()))?;
        let listener = listen(&setup.instance, address).map_err(needs)?;
        let access = access(&setup.instance, config, address).map_err(needs)?;
        // Found by whoever wants to open it, and by the next start, which takes the same port.
        let file = setup.instance.viewer_address();
        let served = listener.local_addr().map_err(|error| needs(error.to_string()))?;
        replace(&file, &format!("http://{served}/\n"))
            .map_err(|error| needs(format!("{}: {error}", file.display())))?;
        tracing::info!("the live page is at http://{served}/");
        let board = Arc::new(Board::default());
        Server::new(Arc::clone(&board), access, config.recorder.folder.clone())
            .serve(listener)
            .map_err(|error| needs(error.to_string()))?;
        let session = Session::open(&setup.instance, Self::PROGRAM)?.with(&Foreign::load(&setup.config)?);
        let members = Members::of_config(&setup.config);
        Ok(Self {
            board,
            spectator: Spectator::open(&setup.instance, session, members, config.params.clone())?,
            known: config.params.clone(),
            generation: setup.generation,
            changes: None,
            asked: None,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        self.spectator.look(cycle.now, &self.board);
        self.change(cycle.now);
        Wake::at(cycle.now.next_beat(LOOK_HZ))
    }
}

impl ViewerService {
    /// Has parameters changed, one after the other, as `jink param set` does.
    fn change(&mut self, now: Timestamp) {
        if self.asked.is_none()
            && let Some(change) = self.board.next_change()
        {
            match self.sample(now, &change) {
                Ok(sample) => {
                    self.asked = Some(Asked {
                        change,
                        sample,
                        since: now,
                        again_at: now,
                    });
                }
                Err(why) => answer(&change, Err(why)),
            }
        }
        let Some(asked) = &mut self.asked else { return };
        let values = self.spectator.parameters(now);
        let answered = values.filter(|values| values.answered == asked.sample.id);
        let result = if let Some(values) = answered {
            let mut rows = values.rows(&self.known);
            let in_force = rows
                .find(|(row, _)| row.name == asked.change.name)
                .map(|(_, value)| value);
            match in_force {
                Some(value) if value == asked.sample.value => Ok(value),
                _ => Err(format!(
                    "the parameter server refuses {} = {}",
                    asked.change.name, asked.sample.value
                )),
            }
        } else if now.seconds_since(asked.since) > CHANGE_PATIENCE_S {
            Err("the parameter server gives no answer: does it run?".to_owned())
        } else {
            if now >= asked.again_at {
                asked.again_at = now.plus_seconds(AGAIN_S);
                if let Some(changes) = &mut self.changes {
                    changes.send(SampleHeader::at(now), &asked.sample);
                }
            }
            return;
        };
        answer(&asked.change, result);
        self.asked = None;
    }

    /// What is asked of the parameter server, or why nothing is.
    fn sample(&mut self, now: Timestamp, change: &Change) -> Result<ParameterChange, String> {
        let values = self.spectator.parameters(now);
        let values = values.ok_or("the parameter server gives no answer: does it run?")?;
        let mut set = self.known.clone();
        for (row, value) in values.rows(&self.known) {
            set.set(row.name, value).map_err(|error| error.to_string())?;
        }
        let before = set.named(&change.name);
        set.change(&change.name, change.value)
            .map_err(|error| error.to_string())?;
        let number = self.known.number_of(&change.name);
        let row = number.and_then(|number| self.known.row(number));
        let is_loosened = row
            .zip(before)
            .is_some_and(|(row, before)| row.is_loosened(before, change.value));
        // The same rule as for ground stations.
        if is_loosened && self.spectator.may_be_armed(now) {
            return Err(format!(
                "{} = {} leaves less safety: only while the vehicle is disarmed",
                change.name, change.value
            ));
        }
        if self.changes.is_none() {
            let opened = self
                .spectator
                .session()
                .output(topics::PARAMETER_CHANGE, "", self.generation);
            self.changes = Some(opened.map_err(|error| error.to_string())?);
        }
        Ok(ParameterChange {
            table: table_of(&self.known),
            // Never 0, and no other request's.
            id: now.ns | 1,
            value: change.value,
            row: number.unwrap_or_default() as u32,
            reserved: Reserved::ZERO,
        })
    }
}

/// Whoever asked may have gone.
fn answer(change: &Change, result: Result<f64, String>) {
    match &result {
        Ok(value) => tracing::info!("{} = {value}, changed on the live page", change.name),
        Err(why) => tracing::info!("{} is not changed: {why}", change.name),
    }
    let _gone = change.answer.send(result);
}

/// Listens at `address`; of any port at the one that an earlier start of the same run had, so that pages find it again.
fn listen(instance: &Instance, address: SocketAddr) -> Result<TcpListener, String> {
    if address.port() == 0 {
        let before = std::fs::read_to_string(instance.viewer_address()).unwrap_or_default();
        let before = before.trim().trim_start_matches("http://").trim_end_matches('/');
        let before = before
            .parse::<SocketAddr>()
            .ok()
            .filter(|before| before.ip() == address.ip());
        if let Some(listener) = before.and_then(|before| TcpListener::bind(before).ok()) {
            return Ok(listener);
        }
    }
    TcpListener::bind(address).map_err(|error| {
        format!(
            "address of [viewer], {address}: {error}; nothing is served, and the flight goes on without it"
        )
    })
}

fn access(instance: &Instance, config: &Config, address: SocketAddr) -> Result<Access, String> {
    // Said by the configuration's check, too; but it may be another program's that has let this pass.
    if let Some(refusal) = config.viewer.refusal() {
        return Err(refusal);
    }
    let token = match &config.viewer.token_file {
        Some(file) => read_token(file)?,
        None => own_token(&instance.viewer_token())?,
    };
    Ok(Access::new(&token, !address.ip().is_loopback()))
}

/// Writes a file anew in one step.
fn replace(file: &Path, text: &str) -> std::io::Result<()> {
    let new = file.with_extension(format!("{}.new", std::process::id()));
    std::fs::write(&new, text)?;
    std::fs::rename(&new, file)
}
