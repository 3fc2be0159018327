//! One link that opens itself again: bytes in and out, without ever blocking.
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
//!
//! A link can be shared with a second process that is to have it next ([`Link::share`], [`Link::join`],
//! [`Link::release`]): the second one hears everything, and not a byte is lost or doubled when it passes on.

mod backlog;
mod endpoint;
mod error;
mod handover;
mod transport;

pub use endpoint::{ACCEPTED_FORMS, Endpoint, EndpointError};
pub use error::LinkError;
pub use transport::Sent;

use crate::frame::{Frame, Splitter};
use crate::message::{COMPONENT_AUTOPILOT, Content, Received};
use handover::{Handover, Letter};
use jink_shared_types::Timestamp;
use std::net::IpAddr;
use std::os::fd::BorrowedFd;
use std::path::Path;
use transport::{Chunk, Transport};

/// Bytes read at once: half of what the splitter holds, so that a chunk always fits behind an unfinished frame.
const CHUNK_BYTES: usize = crate::frame::SPLITTER_BYTES / 2;
/// Chunks read per call at most, so that a flood of garbage cannot keep the caller from its setpoints.
const CHUNKS_PER_CALL: usize = 32;
/// First pause before a lost link is opened again (s): a restarted peer is back soon.
const RETRY_FIRST_S: f64 = 0.1;
/// Longest pause (s): a plugged-in cable should be noticed at once by human standards.
const RETRY_LONGEST_S: f64 = 1.0;
/// Pause before a guest whose holder is gone looks for the next one (s).
const REJOIN_S: f64 = 0.1;

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
    /// Datagrams and connections of those who are not among the peers.
    pub strangers: u64,
}

/// What becomes of the frames that a link receives.
pub trait Intake {
    /// Whether `frame` is to be heard at all; asked before anything else is done with it.
    fn admits(&mut self, frame: &Frame<'_>) -> bool;
    /// Whether a message is wanted here; `content` is `None` if it cannot be decoded.
    fn wants(&mut self, frame: &Frame<'_>, content: Option<&Content>) -> bool;
}

/// Takes every message.
struct Everything;

impl Intake for Everything {
    fn admits(&mut self, _: &Frame<'_>) -> bool {
        true
    }
    fn wants(&mut self, _: &Frame<'_>, _: Option<&Content>) -> bool {
        true
    }
}

/// Whom a listening UDP link answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answers {
    /// The last sender that spoke as an autopilot: a ground station on the same port changes nothing.
    Autopilot,
    /// The last sender of an intact message.
    Anybody,
}

/// One link.
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
    handover: Option<Handover>,
    letter_box: Box<[u8]>,
    /// When the bytes in the splitter were read.
    read_at: Timestamp,
    baton: Option<Vec<u8>>,
    index: u8,
    answers: Answers,
    peers: Vec<IpAddr>,
    /// It is opened again when it is lost.
    reopens: bool,
}

impl Link {
    /// Opens the link.
    ///
    /// # Errors
    /// [`LinkError`] with what the operator needs to know.
    pub fn open(endpoint: Endpoint) -> Result<Self, LinkError> {
        let transport = Transport::open(&endpoint)?;
        Ok(Self::new(endpoint, Some(transport)))
    }

    fn new(endpoint: Endpoint, transport: Option<Transport>) -> Self {
        Self {
            endpoint,
            transport,
            splitter: Splitter::new(),
            chunk: vec![0; CHUNK_BYTES].into_boxed_slice(),
            counters: LinkCounters::default(),
            generation: 0,
            retry_at: Timestamp::NEVER,
            retry_pause_s: RETRY_FIRST_S,
            handover: None,
            letter_box: Box::default(),
            read_at: Timestamp::NEVER,
            baton: None,
            index: 0,
            answers: Answers::Autopilot,
            peers: Vec::new(),
            reopens: true,
        }
    }

    /// A link that is opened at the first reception, and lost until then.
    pub fn lost(endpoint: Endpoint) -> Self {
        Self::new(endpoint, None)
    }

    /// That is not opened again while it is lost.
    #[must_use]
    pub fn kept_closed(mut self) -> Self {
        self.reopens = false;
        self
    }

    /// As number `index` of several links: its messages carry that, and frames to be passed on come out, too.
    #[must_use]
    pub fn among_others(mut self, index: u8) -> Self {
        self.index = index;
        self.splitter.with_unknown();
        self
    }

    /// With another rule for whom a listening UDP link answers than [`Answers::Autopilot`].
    #[must_use]
    pub fn answering(mut self, answers: Answers) -> Self {
        self.answers = answers;
        self
    }

    /// Listening to nobody but `peers`, unless that is empty.
    #[must_use]
    pub fn with_peers(mut self, peers: Vec<IpAddr>) -> Self {
        self.peers = peers;
        self
    }

    /// Lets a second process join at `path`, a socket that is made now.
    ///
    /// # Errors
    /// [`LinkError::Handover`] if the socket cannot be made.
    pub fn share(&mut self, path: &Path) -> Result<(), LinkError> {
        let handover = Handover::host(path).map_err(|source| LinkError::Handover {
            path: path.to_owned(),
            source,
        })?;
        self.handover = Some(handover);
        self.letter_box = handover::letter_box(CHUNK_BYTES);
        Ok(())
    }

    /// Joins the link that another process shares at `path`: hears what it hears, says nothing.
    ///
    /// # Errors
    /// [`LinkError::Handover`] if nobody shares a link there.
    pub fn join(endpoint: Endpoint, path: &Path) -> Result<Self, LinkError> {
        let handover = Handover::join(path).map_err(|source| LinkError::Handover {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            handover: Some(handover),
            letter_box: handover::letter_box(CHUNK_BYTES),
            ..Self::new(endpoint, None)
        })
    }

    /// As [`Self::join`], and if nobody shares the link yet, as soon as somebody does.
    pub fn join_later(endpoint: Endpoint, path: &Path) -> Self {
        Self::join(endpoint.clone(), path).unwrap_or_else(|_nobody_yet| Self {
            handover: Some(Handover::wait(path)),
            letter_box: handover::letter_box(CHUNK_BYTES),
            ..Self::new(endpoint, None)
        })
    }

    /// Closes the link and listens to whoever opens it next: for when nobody takes what is released.
    pub fn let_go(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.let_go();
            self.transport = None;
            self.generation += 1;
        }
    }

    /// Whether this process reads and writes the link; if not, it only hears what the holder hears.
    pub fn holds(&self) -> bool {
        !self.handover.as_ref().is_some_and(Handover::is_guest)
    }

    /// Passes the link on, with `baton` (at most 255 bytes) for the next holder. Returns whether there was somebody to
    /// take it; this process hears on then.
    pub fn release(&mut self, baton: &[u8]) -> bool {
        let Self {
            transport, handover, ..
        } = self;
        let mut backlog = transport.as_mut().and_then(Transport::backlog);
        let unsent = backlog.as_ref().map_or(&[][..], |backlog| backlog.bytes());
        let released = handover
            .as_mut()
            .is_some_and(|handover| handover.release(baton, unsent));
        if released {
            self.generation += 1;
            if let Some(backlog) = &mut backlog {
                backlog.replace(&[]);
            }
        }
        released
    }

    /// What the former holder wanted this one to know; once, after it has passed the link on.
    pub fn take_baton(&mut self) -> Option<Vec<u8>> {
        self.baton.take()
    }

    /// Whether this process hears nothing because the holder is gone.
    pub fn is_orphaned(&self) -> bool {
        !self.holds() && self.handover.as_ref().is_some_and(|one| !one.has_peer())
    }

    /// Goes on with the link of a holder that has died. Only for whom the control record names the owner.
    pub fn take(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.become_holder();
            self.generation += 1;
        }
    }

    /// The descriptors to watch. While the link is lost call [`Self::receive`] at [`Self::next_wake`].
    pub fn fds(&self) -> [Option<BorrowedFd<'_>>; 3] {
        let [peer, door] = self.handover.as_ref().map_or([None; 2], Handover::fds);
        [self.fd().filter(|_| self.holds()), peer, door]
    }

    /// The link's own descriptor; `None` while it is lost.
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.transport.as_ref().map(Transport::fd)
    }

    /// Changes whenever [`Self::fd`] is another descriptor than before.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// When a lost link will be opened, or its next holder be looked for, again.
    pub fn next_wake(&self) -> Option<Timestamp> {
        let lost = self.holds() && self.transport.is_none() && self.reopens;
        (lost || self.is_orphaned()).then_some(self.retry_at)
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
        self.receive_through(clock, messages, &mut Everything)
    }

    /// As [`Self::receive`], with `intake` deciding about each frame.
    ///
    /// # Errors
    /// The same.
    pub fn receive_through(
        &mut self,
        clock: impl Fn() -> Timestamp,
        messages: &mut Vec<Received>,
        intake: &mut impl Intake,
    ) -> Result<Progress, LinkError> {
        if !self.holds() {
            return Ok(self.overhear(clock(), messages, intake));
        }
        self.look_after_guest(clock());
        self.reopen_if_due(clock())?;
        for _ in 0..CHUNKS_PER_CALL {
            if self.take_frames(messages, intake) == Progress::More {
                return Ok(Progress::More);
            }
            let Some(transport) = &mut self.transport else {
                return Ok(Progress::Drained);
            };
            let chunk = transport.read(&mut self.chunk, &self.peers);
            let now = clock();
            self.read_at = now;
            match chunk {
                Ok(Chunk::Stream(len)) => {
                    self.retry_pause_s = RETRY_FIRST_S;
                    let bytes = &self.chunk[..len];
                    self.splitter.push(bytes);
                    if let Some(handover) = &mut self.handover {
                        handover.send_stream(now, bytes);
                    }
                }
                Ok(Chunk::Datagram(len)) => {
                    let bytes = &self.chunk[..len];
                    self.splitter.load_datagram(bytes);
                    if let Some(handover) = &mut self.handover {
                        handover.send_datagram(now, transport.last_sender(), bytes);
                    }
                }
                Ok(Chunk::Nothing) => return Ok(Progress::Drained),
                Ok(Chunk::Stranger) => self.counters.strangers += 1,
                Ok(Chunk::Moved) => {
                    self.splitter.reset();
                    self.generation += 1;
                    self.send_link();
                }
                Err(source) => return Err(self.lose(now, source)),
            }
        }
        Ok(Progress::More)
    }

    /// Tells the guest what the link is made of now.
    fn send_link(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.send_link(self.transport.as_ref().map(Transport::parts).as_ref());
        }
    }

    /// Lets a guest in, with what it needs to begin in the middle of a stream.
    fn look_after_guest(&mut self, now: Timestamp) {
        let Some(handover) = &mut self.handover else {
            return;
        };
        handover.notice_departure();
        if handover.accept() {
            handover.send_link(self.transport.as_ref().map(Transport::parts).as_ref());
            if self.splitter.pending() > 0 {
                handover.send_stream(now, self.splitter.rest());
            }
        }
    }

    /// Of a guest: reads letters instead of the link, until none is left, `messages` is full, or the link is its own.
    fn overhear(
        &mut self,
        now: Timestamp,
        messages: &mut Vec<Received>,
        intake: &mut impl Intake,
    ) -> Progress {
        for _ in 0..CHUNKS_PER_CALL {
            if self.take_frames(messages, intake) == Progress::More {
                return Progress::More;
            }
            let Some(handover) = &mut self.handover else {
                return Progress::Drained;
            };
            if !handover.has_peer() {
                if now >= self.retry_at && !handover.rejoin() {
                    self.retry_at = now.plus_seconds(REJOIN_S);
                }
                return Progress::Drained;
            }
            match handover.next_letter(&mut self.letter_box) {
                Letter::Nothing => return Progress::Drained,
                Letter::Link(parts) => {
                    self.splitter.reset();
                    self.transport = parts.and_then(Transport::of_parts);
                }
                Letter::Stream(time, range) => {
                    self.read_at = time;
                    self.splitter.push(&self.letter_box[range]);
                }
                Letter::Datagram(time, sender, range) => {
                    self.read_at = time;
                    if let Some(transport) = &mut self.transport {
                        transport.heard_of(sender);
                    }
                    self.splitter.load_datagram(&self.letter_box[range]);
                }
                Letter::Released { baton, unsent } => {
                    if let Some(backlog) = self.transport.as_mut().and_then(Transport::backlog) {
                        backlog.replace(&self.letter_box[unsent]);
                    }
                    self.baton = Some(self.letter_box[baton].to_vec());
                    self.take();
                    // What was read by the former holder is the former holder's; what comes now is this one's.
                    return Progress::More;
                }
                Letter::Gone => {
                    self.retry_at = now.plus_seconds(REJOIN_S);
                    return Progress::Drained;
                }
            }
        }
        Progress::More
    }

    /// Hands one frame to the kernel.
    ///
    /// # Errors
    /// [`LinkError::Lost`] if the link broke; it will be opened again.
    pub fn send(&mut self, now: Timestamp, frame: &[u8]) -> Result<Sent, LinkError> {
        let holds = self.holds();
        let Some(transport) = self.transport.as_mut().filter(|_| holds) else {
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

    fn take_frames(&mut self, messages: &mut Vec<Received>, intake: &mut impl Intake) -> Progress {
        while messages.len() < messages.capacity() {
            let Some(frame) = self.splitter.next_frame() else {
                return Progress::Drained;
            };
            if !intake.admits(&frame) {
                continue;
            }
            let is_peer =
                self.answers == Answers::Anybody || frame.header.component_id == COMPONENT_AUTOPILOT;
            if frame.is_verified
                && is_peer
                && let Some(transport) = &mut self.transport
            {
                transport.last_sender_is_peer();
            }
            let content = Content::of(&frame).filter(|_| frame.is_verified);
            self.counters.undecodable += u64::from(frame.is_verified && content.is_none());
            if intake.wants(&frame, content.as_ref())
                && let Some(content) = content
            {
                messages.push(Received {
                    header: frame.header,
                    content,
                    time: self.read_at,
                    link: self.index,
                });
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
        self.send_link();
        LinkError::Lost {
            endpoint: self.endpoint.clone(),
            source,
        }
    }

    fn reopen_if_due(&mut self, now: Timestamp) -> Result<(), LinkError> {
        if self.transport.is_some() || !self.reopens || now < self.retry_at {
            return Ok(());
        }
        match Transport::open(&self.endpoint) {
            Ok(transport) => {
                self.transport = Some(transport);
                // The first time is no second time.
                self.counters.reopened += u64::from(self.generation > 0);
                self.generation += 1;
                self.send_link();
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
