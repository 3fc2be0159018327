//! Lock-step with a process of its own, in any language: what it and the scheduler say to each other over a socket.
//!
//! Both speak in turn, the scheduler first, in messages. A message is a row of records, little endian, each of them: kind (u8), length of
//! the name (u8), length of the rest (u32), name, rest. The time of the board stands still from a message to its answer.
//!
//! | kind | name | rest |
//! |---|---|---|
//! | `R` | a topic that the process reads from now on | size of the payload (u32), name of its type |
//! | `T` | a topic that it reads, and whose samples wake it | the same |
//! | `W` | a topic that it publishes | the same |
//! | `S` | topic of a sample | user header, payload |
//! | `C` | empty: it is a replay. In the first message and in each that makes the process run a cycle | which of the samples the cycle takes at which look at their topics: entries of [`CycleEntries`](jink_shared_types::cycles::CycleEntries) |
//! | `E` | empty: the message ends | the board's time (u64, ns); 0: the process is to end. In an answer: when it wants to be woken at the latest |

use super::LocalBus;
use super::replay::Known;
use crate::cycle_log::CycleLog;
use crate::transport::local::{Publisher, Subscriber};
use crate::transport::{PayloadType, header_of};
use jink_shared_types::cycles::CycleEntry;
use jink_shared_types::layout::{bytes_of, from_bytes};
use jink_shared_types::{SampleHeader, Timestamp};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{BufReader, Error, ErrorKind, Read, Result, Write};
use std::os::unix::net::UnixStream;
use std::rc::Rc;
use std::time::Duration;

const READS: u8 = b'R';
const WOKEN_BY: u8 = b'T';
const PUBLISHES: u8 = b'W';
const SAMPLE: u8 = b'S';
const CYCLE: u8 = b'C';
const END: u8 = b'E';
/// Longest record (bytes): far more than the largest topic.
const RECORD_MAX: usize = 64 << 20;

/// The topics of a bus that a process on the other end of a socket takes part in.
pub struct Relay {
    bus: LocalBus,
    input: BufReader<UnixStream>,
    output: UnixStream,
    readers: Vec<Reader>,
    /// Topics whose samples come from there.
    writers: BTreeMap<String, Publisher>,
    /// What the other end was told of the bus: topic, and whether it is one that is published here.
    announced: BTreeSet<(String, bool)>,
    /// What the other end said of its own: the same.
    announced_there: Vec<(String, bool, PayloadType)>,
    /// When the process wants to be woken.
    wake: Timestamp,
    message: Vec<u8>,
    /// The process' side, in a replay: what its cycles take.
    cycle_log: Option<Rc<CycleLog>>,
}

/// A topic whose samples go to the other end.
struct Reader {
    topic: String,
    payload: PayloadType,
    wakes: bool,
    subscriber: Subscriber,
}

impl fmt::Debug for Relay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Relay({} topics)", self.readers.len() + self.writers.len())
    }
}

impl Relay {
    /// Between `bus` and the other end of `socket`.
    ///
    /// # Errors
    /// What the kernel says.
    pub fn new(bus: &LocalBus, socket: UnixStream) -> Result<Self> {
        Ok(Self {
            bus: bus.clone(),
            input: BufReader::new(socket.try_clone()?),
            output: socket,
            readers: Vec::new(),
            writers: BTreeMap::new(),
            announced: BTreeSet::new(),
            announced_there: Vec::new(),
            wake: Timestamp::NEVER,
            message: Vec::new(),
            cycle_log: None,
        })
    }

    /// The scheduler's side: whether it is time, or something has come that wakes the process.
    pub fn is_due(&self) -> bool {
        let has_data = |reader: &Reader| reader.wakes && !reader.subscriber.is_empty();
        self.bus.now() >= self.wake || self.readers.iter().any(has_data)
    }

    /// The scheduler's side: what is new for the process, and what comes of it, at the time that the clock of the bus shows. An answer
    /// may take `patience` of real time.
    ///
    /// # Errors
    /// The socket's, [`ErrorKind::UnexpectedEof`] if the process has ended; [`ErrorKind::InvalidData`] in words if it knows a topic
    /// otherwise.
    pub fn exchange(&mut self, patience: Duration) -> Result<()> {
        self.output.set_read_timeout(Some(patience))?;
        self.send(self.bus.now())?;
        self.wake = self.receive()?;
        Ok(())
    }

    /// The scheduler's side of a replay: the samples that one cycle takes are on the bus; it takes them as `entries` say, and runs at the
    /// time that the clock of the bus shows.
    ///
    /// # Errors
    /// As [`Self::exchange`].
    pub fn replay(&mut self, entries: &[CycleEntry], patience: Duration) -> Result<()> {
        let parts: Vec<&[u8]> = entries.iter().map(bytes_of).collect();
        record(&mut self.message, CYCLE, "", &parts);
        self.exchange(patience)
    }

    /// The topics that the other end has opened, and whether it publishes them.
    pub(super) fn announced(&self) -> impl Iterator<Item = (Known, bool)> {
        self.announced_there.iter().map(|(topic, is_published, payload)| {
            let known = Known {
                topic: topic.clone(),
                type_name: payload.name.to_owned(),
                payload_bytes: payload.size,
            };
            (known, *is_published)
        })
    }

    /// The process' side: whether it is a replay.
    pub(super) fn is_replay(&self) -> bool {
        self.cycle_log.is_some()
    }

    /// The scheduler's side: asks the process to end, and takes its last samples.
    ///
    /// # Errors
    /// As [`Self::exchange`].
    pub fn end(&mut self, patience: Duration) -> Result<()> {
        self.output.set_read_timeout(Some(patience))?;
        self.send(Timestamp::NEVER)?;
        self.receive().map(drop)
    }

    /// The process' side: tells the other end of topics that have been opened here.
    pub(super) fn announce(&mut self) -> Result<()> {
        for topic in self.bus.topics() {
            let reads = if topic.wakes { WOKEN_BY } else { READS };
            for (kind, is_used) in [(reads, topic.is_read), (PUBLISHES, topic.is_published)] {
                let is_output = kind == PUBLISHES;
                // Our own end of a topic is no use of it.
                let is_ours = self.announced.contains(&(topic.name.clone(), !is_output));
                if !is_used || is_ours || !self.announced.insert((topic.name.clone(), is_output)) {
                    continue;
                }
                let size = u32::try_from(topic.payload.size)
                    .unwrap_or(u32::MAX)
                    .to_le_bytes();
                let parts = [&size[..], topic.payload.name.as_bytes()];
                record(&mut self.message, kind, &topic.name, &parts);
                match is_output {
                    true => self.read(&topic.name, topic.payload, false)?,
                    false => self.publish(&topic.name, topic.payload)?,
                }
            }
        }
        Ok(())
    }

    /// From now on what is published here of the topic goes to the other end.
    fn read(&mut self, topic: &str, payload: PayloadType, wakes: bool) -> Result<()> {
        // Each message takes all that wait.
        let subscriber = self.bus.raw_subscriber(topic, payload, usize::MAX);
        self.readers.push(Reader {
            topic: topic.to_owned(),
            payload,
            wakes,
            subscriber: subscriber.map_err(invalid)?,
        });
        Ok(())
    }

    /// From now on what comes from the other end of the topic is published here.
    fn publish(&mut self, topic: &str, payload: PayloadType) -> Result<()> {
        let writer = self.bus.raw_publisher(topic, payload).map_err(invalid)?;
        self.writers.insert(topic.to_owned(), writer);
        Ok(())
    }

    /// Sends what has not been read yet, and that it is `time`.
    pub(super) fn send(&mut self, time: Timestamp) -> Result<()> {
        for reader in &mut self.readers {
            while let Some(slot) = reader.subscriber.receive() {
                let parts = [bytes_of(&slot.header), slot.bytes(reader.payload.size)];
                record(&mut self.message, SAMPLE, &reader.topic, &parts);
            }
        }
        record(&mut self.message, END, "", &[&time.ns.to_le_bytes()]);
        let sent = self.output.write_all(&self.message);
        self.message.clear();
        sent
    }

    /// Publishes here what the other end sends, up to the end of its message, and answers the time in it.
    pub(super) fn receive(&mut self) -> Result<Timestamp> {
        loop {
            let mut head = [0; 6];
            self.input.read_exact(&mut head)?;
            let [kind, name_len, len @ ..] = head;
            let len = u32::from_le_bytes(len) as usize;
            if len > RECORD_MAX {
                return Err(invalid(format!("a record of {len} bytes")));
            }
            let mut bytes = vec![0; usize::from(name_len) + len];
            self.input.read_exact(&mut bytes)?;
            let (name, rest) = bytes.split_at(usize::from(name_len));
            let name = std::str::from_utf8(name).map_err(invalid)?;
            match kind {
                READS | WOKEN_BY | PUBLISHES => {
                    let (size, type_name) = rest
                        .split_first_chunk()
                        .ok_or_else(|| invalid("a record is cut off"))?;
                    let type_name = std::str::from_utf8(type_name).map_err(invalid)?;
                    let payload = PayloadType::raw(type_name, u32::from_le_bytes(*size) as usize);
                    self.announced_there
                        .push((name.to_owned(), kind == PUBLISHES, payload));
                    match kind == PUBLISHES {
                        true => self.publish(name, payload)?,
                        false => self.read(name, payload, kind == WOKEN_BY)?,
                    }
                }
                SAMPLE => {
                    let (header, payload) = rest
                        .split_at_checked(size_of::<SampleHeader>())
                        .ok_or_else(|| invalid("a sample is cut off"))?;
                    let writer = self.writers.get_mut(name);
                    let is_sent = writer.is_some_and(|writer| writer.send_bytes(header_of(header), payload));
                    if !is_sent {
                        return Err(invalid(format!(
                            "a sample of {} bytes for topic {name:?}",
                            payload.len()
                        )));
                    }
                }
                CYCLE => {
                    let log = self.cycle_log.get_or_insert_with(|| self.bus.replay());
                    let entries = rest.chunks_exact(size_of::<CycleEntry>());
                    log.follow(entries.map(|entry| *from_bytes::<CycleEntry>(entry)).collect());
                }
                END => {
                    let time = rest.first_chunk().ok_or_else(|| invalid("a record is cut off"))?;
                    return Ok(Timestamp::from_ns(u64::from_le_bytes(*time)));
                }
                other => return Err(invalid(format!("a record of kind {other}"))),
            }
        }
    }
}

fn invalid(cause: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
    Error::new(ErrorKind::InvalidData, cause)
}

fn record(message: &mut Vec<u8>, kind: u8, name: &str, rest: &[&[u8]]) {
    let len: usize = rest.iter().map(|part| part.len()).sum();
    // Names of topics and sizes of samples are far below.
    let (name_len, len) = (
        u8::try_from(name.len()).unwrap_or(u8::MAX),
        u32::try_from(len).unwrap_or(u32::MAX),
    );
    message.extend([kind, name_len]);
    message.extend(len.to_le_bytes());
    message.extend(name.bytes());
    for part in rest {
        message.extend(*part);
    }
}
