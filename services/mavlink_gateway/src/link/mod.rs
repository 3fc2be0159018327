//! A link to the autopilot that opens itself again: bytes in and out, without ever blocking.
//!
//! | in | out |
//! |---|---|
//! | [`Endpoint`] text from the configuration | a file descriptor for the event loop ([`Link::fd`]) |
//! | readiness of that descriptor ([`Link::receive`]) | verified, decoded messages |
//! | frames ([`Link::send`]) | bytes handed to the kernel, or the reason why not ([`Sent`]) |
//!
//! Nothing that the other side sends closes a link: malformed bytes are counted, refused datagrams are ignored. A lost
//! stream (unplugged serial port, closed connection) is opened again with a growing pause; the caller sees one error
//! per loss and per failed attempt, for its log, and a new [`Link::generation`] when another descriptor must be watched.

mod backlog;
mod endpoint;
mod error;
mod serial;
mod transport;

pub use endpoint::{ACCEPTED_FORMS, Endpoint, EndpointError};
pub use error::LinkError;
pub use transport::Sent;

use crate::frame::Splitter;
use crate::message::{COMPONENT_AUTOPILOT, Content, Received};
use jink_shared_types::Timestamp;
use std::os::fd::BorrowedFd;
use transport::{Chunk, Transport};

/// Bytes read at once: half of what the splitter holds, so that a chunk always fits behind an unfinished frame.
const CHUNK_BYTES: usize = crate::frame::SPLITTER_BYTES / 2;
/// Chunks read per call at most, so that a flood of garbage cannot keep the caller from its setpoints.
const CHUNKS_PER_CALL: usize = 32;
/// First pause before a lost link is opened again (s): a restarted peer is back soon.
const RETRY_FIRST_S: f64 = 0.1;
/// Longest pause (s): a plugged-in cable should be noticed at once by human standards.
const RETRY_LONGEST_S: f64 = 1.0;

/// Whether a call to [`Link::receive`] took everything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing is left: wait for the descriptor.
    Drained,
    /// There may be more: handle what came and call again before waiting.
    More,
}

/// What a link has counted since it was opened first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Bytes that belonged to no frame.
    pub garbage_bytes: u64,
    /// Intact frames whose content could not be decoded.
    pub undecodable: u64,
    /// Frames that were dropped because the link was too slow or had no peer.
    pub unsent: u64,
    /// Times the link was opened again.
    pub reopened: u64,
}

/// A link to an autopilot.
#[derive(Debug)]
pub struct Link {
    endpoint: Endpoint,
    transport: Option<Transport>,
    splitter: Splitter,
    chunk: Box<[u8]>,
    counters: LinkCounters,
    generation: u64,
    retry_at: Timestamp,
    retry_pause_s: f64,
}

impl Link {
    /// Opens the link.
    ///
    /// # Errors
    /// [`LinkError`] with what the operator needs to know.
    pub fn open(endpoint: Endpoint) -> Result<Self, LinkError> {
        let transport = Transport::open(&endpoint)?;
        Ok(Self {
            endpoint,
            transport: Some(transport),
            splitter: Splitter::new(),
            chunk: vec![0; CHUNK_BYTES].into_boxed_slice(),
            counters: LinkCounters::default(),
            generation: 0,
            retry_at: Timestamp::NEVER,
            retry_pause_s: RETRY_FIRST_S,
        })
    }

    /// The descriptor to watch for input; `None` while the link is lost (then call [`Self::receive`] at
    /// [`Self::next_wake`]).
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.transport.as_ref().map(Transport::fd)
    }

    /// Changes whenever [`Self::fd`] is another descriptor than before.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// When a lost link will be opened again.
    pub fn next_wake(&self) -> Option<Timestamp> {
        self.transport.is_none().then_some(self.retry_at)
    }

    /// What was counted so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            garbage_bytes: self.splitter.garbage_bytes(),
            ..self.counters
        }
    }

    /// Reads until nothing is left or `messages` has no spare capacity; nothing is allocated. The
    /// time of reception is read from `clock` after each read: the autopilot's clock is measured with it.
    ///
    /// # Errors
    /// [`LinkError`] if the link was lost just now or could not be opened again; it will be tried again.
    pub fn receive(
        &mut self,
        clock: impl Fn() -> Timestamp,
        messages: &mut Vec<Received>,
    ) -> Result<Progress, LinkError> {
        let mut now = clock();
        self.reopen_if_due(now)?;
        for _ in 0..CHUNKS_PER_CALL {
            if self.take_frames(now, messages) == Progress::More {
                return Ok(Progress::More);
            }
            let Some(transport) = &mut self.transport else {
                return Ok(Progress::Drained);
            };
            let chunk = transport.read(&mut self.chunk);
            now = clock();
            match chunk {
                Ok(Chunk::Stream(len)) => {
                    self.retry_pause_s = RETRY_FIRST_S;
                    self.splitter.push(&self.chunk[..len]);
                }
                Ok(Chunk::Datagram(len)) => self.splitter.load_datagram(&self.chunk[..len]),
                Ok(Chunk::Nothing) => return Ok(Progress::Drained),
                Ok(Chunk::Moved) => {
                    self.splitter.reset();
                    self.generation += 1;
                }
                Err(source) => return Err(self.lose(now, source)),
            }
        }
        Ok(Progress::More)
    }

    /// Hands one frame to the kernel.
    ///
    /// # Errors
    /// [`LinkError::Lost`] if the link broke; it will be opened again.
    pub fn send(&mut self, now: Timestamp, frame: &[u8]) -> Result<Sent, LinkError> {
        let Some(transport) = &mut self.transport else {
            self.counters.unsent += 1;
            return Ok(Sent::NoPeer);
        };
        match transport.write(frame) {
            Ok(Sent::Yes) => Ok(Sent::Yes),
            Ok(unsent) => {
                self.counters.unsent += 1;
                Ok(unsent)
            }
            Err(source) => Err(self.lose(now, source)),
        }
    }

    fn take_frames(&mut self, now: Timestamp, messages: &mut Vec<Received>) -> Progress {
        while messages.len() < messages.capacity() {
            let Some(frame) = self.splitter.next_frame() else {
                return Progress::Drained;
            };
            if frame.header.component_id == COMPONENT_AUTOPILOT
                && let Some(transport) = &mut self.transport
            {
                transport.last_sender_is_autopilot();
            }
            match Content::of(&frame) {
                Some(content) => messages.push(Received {
                    header: frame.header,
                    content,
                    time: now,
                }),
                None => self.counters.undecodable += 1,
            }
        }
        Progress::More
    }

    fn lose(&mut self, now: Timestamp, source: std::io::Error) -> LinkError {
        self.transport = None;
        self.splitter.reset();
        self.generation += 1;
        self.retry_at = now.plus_seconds(self.retry_pause_s);
        self.retry_pause_s = (self.retry_pause_s * 2.0).min(RETRY_LONGEST_S);
        LinkError::Lost {
            endpoint: self.endpoint.clone(),
            source,
        }
    }

    fn reopen_if_due(&mut self, now: Timestamp) -> Result<(), LinkError> {
        if self.transport.is_some() || now < self.retry_at {
            return Ok(());
        }
        match Transport::open(&self.endpoint) {
            Ok(transport) => {
                self.transport = Some(transport);
                self.generation += 1;
                self.counters.reopened += 1;
                Ok(())
            }
            Err(error) => {
                self.retry_at = now.plus_seconds(self.retry_pause_s);
                self.retry_pause_s = (self.retry_pause_s * 2.0).min(RETRY_LONGEST_S);
                Err(error)
            }
        }
    }
}
