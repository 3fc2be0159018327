//! A program that does once more what another instance did in a recorded flight: its cycles begin at the same times and take the same
//! samples.

use super::LocalBus;
use super::program::{PATIENCE, Program};
use super::relay::Relay;
use crate::setup::StartError;
use crate::transport::PayloadType;
use crate::transport::local::{Publisher, Subscriber};
use jink_shared_types::cycles::CycleEntry;
use jink_shared_types::{SampleHeader, Timestamp};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

/// A topic as the program knows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// Its name.
    pub topic: String,
    /// Type of its payload with the hash of the layout.
    pub type_name: String,
    /// Size of its payload (bytes).
    pub payload_bytes: usize,
}

/// The program in its replay.
pub struct Replayed {
    bus: LocalBus,
    program: Program,
    reads: BTreeMap<String, (usize, Publisher)>,
    publishes: Vec<(String, usize, Subscriber)>,
    payload: Vec<u8>,
    seen: usize,
    log: PathBuf,
}

impl fmt::Debug for Replayed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Replayed({} topics)", self.reads.len() + self.publishes.len())
    }
}

impl Replayed {
    /// Starts `program` with `arguments` shortly before `begin`. `socket` is a file that is not there yet; beside it lies then what the
    /// program logs.
    ///
    /// # Errors
    /// [`StartError::Needs`]: there is no such program, it ended, or does not know what a replay is.
    pub fn start(
        program: &Path,
        arguments: impl IntoIterator<Item = OsString>,
        socket: &Path,
        begin: Timestamp,
    ) -> Result<Self, StartError> {
        let bus = LocalBus::new(begin);
        let log = socket.with_extension("log");
        let needs = |error: std::io::Error| StartError::Needs {
            what: log.display().to_string(),
            cause: error.to_string(),
        };
        let output = std::fs::File::create(&log).map_err(needs)?;
        let begin = |relay: &mut Relay| relay.replay(&[], PATIENCE);
        let started = Program::start(&bus, program, arguments, socket, output.into(), begin);
        let started = started.map_err(|error| match last_line(&log) {
            Some(said) => StartError::Needs {
                what: error.to_string(),
                cause: said,
            },
            None => error,
        })?;
        let mut replayed = Self {
            bus,
            program: started,
            reads: BTreeMap::new(),
            publishes: Vec::new(),
            payload: Vec::new(),
            seen: 0,
            log,
        };
        replayed.connect();
        Ok(replayed)
    }

    /// Opens here what the program has opened since the last time.
    fn connect(&mut self) {
        let known: Vec<(Known, bool)> = self.program.relay.announced().skip(self.seen).collect();
        self.seen += known.len();
        for (known, is_published) in known {
            let payload = PayloadType::raw(&known.type_name, known.payload_bytes);
            if is_published {
                if let Ok(subscriber) = self.bus.raw_subscriber(&known.topic, payload, usize::MAX) {
                    self.publishes
                        .push((known.topic, known.payload_bytes, subscriber));
                }
            } else if let Ok(publisher) = self.bus.raw_publisher(&known.topic, payload) {
                self.reads.insert(known.topic, (known.payload_bytes, publisher));
            }
        }
    }

    /// The topics that the program reads, or those that it publishes, so far.
    pub fn topics(&self, is_published: bool) -> impl Iterator<Item = Known> {
        let topics = self.program.relay.announced();
        topics.filter_map(move |(known, published)| (published == is_published).then_some(known))
    }

    /// Whether the program reads the topic.
    pub fn reads(&self, topic: &str) -> bool {
        self.reads.contains_key(topic)
    }

    /// Hands over a sample for the next cycle: of a list whose unused end is missing the rest is zero.
    pub fn take(&mut self, topic: &str, header: &SampleHeader, payload: &[u8]) {
        if let Some((size, publisher)) = self.reads.get_mut(topic) {
            self.payload.clear();
            self.payload
                .extend_from_slice(&payload[..payload.len().min(*size)]);
            self.payload.resize(*size, 0);
            publisher.send_bytes(*header, &self.payload);
        }
    }

    /// Runs the cycle that began at `now`, which takes what was handed over as `entries` say, and gives what it publishes to `visit`.
    ///
    /// # Errors
    /// What became of the program.
    pub fn cycle(
        &mut self,
        now: Timestamp,
        entries: &[CycleEntry],
        mut visit: impl FnMut(&str, &SampleHeader, &[u8]),
    ) -> Result<(), String> {
        self.bus.set_clock(now);
        if let Err(error) = self.program.relay.replay(entries, PATIENCE) {
            let said = last_line(&self.log).map_or(String::new(), |said| format!(": {said}"));
            return Err(format!("{error}; it ended with {}{said}", self.program.ended()));
        }
        self.connect();
        for (topic, size, subscriber) in &mut self.publishes {
            while let Some(slot) = subscriber.receive() {
                visit(topic, &slot.header, slot.bytes(*size));
            }
        }
        Ok(())
    }
}

/// The last line of a log.
fn last_line(log: &Path) -> Option<String> {
    let text = std::fs::read_to_string(log).ok()?;
    text.lines().rfind(|line| !line.is_empty()).map(str::to_owned)
}
