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
//! per loss and per failed attempt, for its log.
//!
//! A link can be shared with a second process that will take it over ([`Link::share`], [`Link::join`],
//! [`Link::release`]): the standby receives everything, and no byte is lost or doubled at the handover.

mod backlog;
mod endpoint;
mod error;
mod handover;
mod transport;
mod write;

pub use endpoint::{ACCEPTED_FORMS, Endpoint, EndpointError};
pub use error::LinkError;
pub use write::Sent;

use crate::frame::{MavlinkFrame, Splitter};
use crate::message::{COMPONENT_AUTOPILOT, Content, Received};
use crate::router::Sender;
use crate::vehicle_selector::ALIVE_S;
use handover::{Handover, HandoverMessage};
use jink_shared_types::Timestamp;
use mavlink::Message;
use mavlink::dialect::MavMessage;
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
/// Pause before a standby whose owner is gone looks for the next one (s).
const RECONNECT_S: f64 = 0.1;

/// A sender that speaks as another one is reported again when it was silent for so long (s).
const IMPOSTOR_GONE_S: f64 = 30.0;

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
    /// Intact frames of messages that are spoken here, whose content could not be decoded.
    pub undecodable: u64,
    /// Frames that were dropped because the link was too slow or had no peer.
    pub unsent: u64,
    /// Times the link was opened again.
    pub reopened: u64,
    /// Datagrams and connections from addresses that are not among the peers, and messages that speak as the autopilot from another
    /// address than it does.
    pub unknown_peers: u64,
}

/// What becomes of the frames that a link receives.
pub trait FrameFilter {
    /// Whether `frame` is accepted at all; called before anything else is done with it.
    fn admits(&mut self, frame: &MavlinkFrame<'_>) -> bool;
    /// Whether a message is wanted here; `content` is `None` if it cannot be decoded.
    fn wants(&mut self, frame: &MavlinkFrame<'_>, content: Option<&Content>) -> bool;
    /// Whether `sender` may be the autopilot that the link is for.
    fn is_autopilot(&self, sender: Sender) -> bool {
        sender.component_id == COMPONENT_AUTOPILOT
    }
}

/// Accepts every message.
struct AcceptAll;

impl FrameFilter for AcceptAll {
    fn admits(&mut self, _: &MavlinkFrame<'_>) -> bool {
        true
    }
    fn wants(&mut self, _: &MavlinkFrame<'_>, _: Option<&Content>) -> bool {
        true
    }
}

/// Where a listening UDP link replies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplyPolicy {
    /// Our autopilot: a ground station or another vehicle on the same port changes nothing, nor does who speaks with our autopilot's
    /// id from another address, as long as it is heard from its own.
    Autopilot,
    /// The last sender of an intact message.
    Anybody,
}

/// Whom a listening UDP link answers.
#[derive(Clone, Copy, Debug)]
struct Answered {
    /// Its system; `None`: another process has found it.
    system_id: Option<u32>,
    heard: Timestamp,
}

/// Senders that speak as the autopilot from another address.
#[derive(Clone, Copy, Debug)]
struct Impostors {
    heard: Timestamp,
    is_reported: bool,
}

impl Impostors {
    fn hear(&mut self, now: Timestamp) {
        let is_new = !self.heard.is_set() || now.seconds_since(self.heard) > IMPOSTOR_GONE_S;
        self.is_reported &= !is_new;
        self.heard = now;
    }
}

/// One link.
#[derive(Debug)]
pub struct Link {
    endpoint: Endpoint,
    transport: Option<Transport>,
    splitter: Splitter,
    chunk: Box<[u8]>,
    counters: LinkCounters,
    /// It was open before, or another process had it.
    was_open: bool,
    retry_at: Timestamp,
    retry_pause_s: f64,
    handover: Option<Handover>,
    message_buffer: Box<[u8]>,
    /// When the bytes in the splitter were read.
    read_at: Timestamp,
    handover_state: Option<Vec<u8>>,
    index: u8,
    reply_policy: ReplyPolicy,
    answered: Option<Answered>,
    impostors: Impostors,
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
            was_open: false,
            retry_at: Timestamp::NEVER,
            retry_pause_s: RETRY_FIRST_S,
            handover: None,
            message_buffer: Box::default(),
            read_at: Timestamp::NEVER,
            handover_state: None,
            index: 0,
            reply_policy: ReplyPolicy::Autopilot,
            answered: None,
            impostors: Impostors {
                heard: Timestamp::NEVER,
                is_reported: true,
            },
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

    /// Sets where a listening UDP link replies; the default is [`ReplyPolicy::Autopilot`].
    #[must_use]
    pub fn with_reply_policy(mut self, reply_policy: ReplyPolicy) -> Self {
        self.reply_policy = reply_policy;
        self
    }

    /// Receives only from `peers`, unless that is empty.
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
        self.message_buffer = handover::message_buffer(CHUNK_BYTES);
        Ok(())
    }

    /// Joins the link that another process shares at `path`: receives what the owner receives, and never sends.
    ///
    /// # Errors
    /// [`LinkError::Handover`] if no process shares a link there.
    pub fn join(endpoint: Endpoint, path: &Path) -> Result<Self, LinkError> {
        let handover = Handover::join(path).map_err(|source| LinkError::Handover {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            handover: Some(handover),
            message_buffer: handover::message_buffer(CHUNK_BYTES),
            ..Self::new(endpoint, None)
        })
    }

    /// As [`Self::join`]; if no process shares the link yet, it joins as soon as one does.
    pub fn join_later(endpoint: Endpoint, path: &Path) -> Self {
        Self::join(endpoint.clone(), path).unwrap_or_else(|_| Self {
            handover: Some(Handover::wait(path)),
            message_buffer: handover::message_buffer(CHUNK_BYTES),
            ..Self::new(endpoint, None)
        })
    }

    /// Closes the link and becomes the standby of whichever process opens it next: for when no process takes what is
    /// released.
    pub fn abandon(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.abandon();
            self.transport = None;
            self.was_open = true;
        }
    }

    /// Whether this process reads and writes the link; if not, it is the standby and receives what the owner reads.
    pub fn is_owner(&self) -> bool {
        !self.handover.as_ref().is_some_and(Handover::is_standby)
    }

    /// Hands the link over, with `state` (at most 255 bytes) for the next owner. Returns whether a process took it;
    /// this one then stays as the standby.
    pub fn release(&mut self, state: &[u8]) -> bool {
        let Self {
            transport, handover, ..
        } = self;
        let mut backlog = transport.as_mut().and_then(Transport::backlog);
        let unsent = backlog.as_ref().map_or(&[][..], |backlog| backlog.bytes());
        let released = handover
            .as_mut()
            .is_some_and(|handover| handover.release(state, unsent));
        if released {
            self.was_open = true;
            if let Some(backlog) = &mut backlog {
                backlog.replace(&[]);
            }
        }
        released
    }

    /// The handover state of the former owner; `Some` once, after it has handed the link over.
    pub fn take_handover_state(&mut self) -> Option<Vec<u8>> {
        self.handover_state.take()
    }

    /// Whether this process receives nothing because the owner is gone.
    pub fn has_lost_owner(&self) -> bool {
        !self.is_owner() && self.handover.as_ref().is_some_and(|one| !one.has_peer())
    }

    /// Takes the link of a dead owner over. Only for the process that the control record names as the owner.
    pub fn take_over(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.become_owner();
            self.was_open = true;
        }
    }

    /// The descriptors to watch. While the link is lost call [`Self::receive`] at [`Self::next_wake`].
    pub fn fds(&self) -> [Option<BorrowedFd<'_>>; 3] {
        let [peer, handover_socket] = self.handover.as_ref().map_or([None; 2], Handover::fds);
        [self.fd().filter(|_| self.is_owner()), peer, handover_socket]
    }

    /// The link's own descriptor; `None` while it is lost.
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.transport.as_ref().map(Transport::fd)
    }

    /// Whether this process has the link and it is not open, and is tried again and again.
    pub fn is_lost(&self) -> bool {
        self.is_owner() && self.transport.is_none() && self.reopens
    }

    /// When to reopen a lost link, or to look for its next owner.
    pub fn next_wake(&self) -> Option<Timestamp> {
        (self.is_lost() || self.has_lost_owner()).then_some(self.retry_at)
    }

    /// What was counted so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            garbage_bytes: self.splitter.garbage_bytes(),
            ..self.counters
        }
    }

    /// Whether somebody speaks as our autopilot from another address than it does; `true` once, and again after half a minute without.
    pub fn take_impostor(&mut self) -> bool {
        self.is_owner() && !std::mem::replace(&mut self.impostors.is_reported, true)
    }

    /// Reads until nothing is left or `messages` has no spare capacity; nothing is allocated. The time of reception is
    /// read from `clock` after each read: the autopilot's clock is measured with it.
    ///
    /// # Errors
    /// [`LinkError`] if the link was lost just now or could not be opened again; it will be tried again.
    pub fn receive(
        &mut self,
        clock: impl Fn() -> Timestamp,
        messages: &mut Vec<Received>,
    ) -> Result<Progress, LinkError> {
        self.receive_through(clock, messages, &mut AcceptAll)
    }

    /// As [`Self::receive`], with `filter` deciding about each frame.
    ///
    /// # Errors
    /// The same.
    pub fn receive_through(
        &mut self,
        clock: impl Fn() -> Timestamp,
        messages: &mut Vec<Received>,
        filter: &mut impl FrameFilter,
    ) -> Result<Progress, LinkError> {
        if !self.is_owner() {
            return Ok(self.receive_as_standby(clock(), messages, filter));
        }
        self.serve_standby(clock());
        self.reopen_if_due(clock())?;
        for _ in 0..CHUNKS_PER_CALL {
            if self.take_frames(messages, filter) == Progress::More {
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
                Ok(Chunk::UnknownPeer) => self.counters.unknown_peers += 1,
                Ok(Chunk::DescriptorChanged) => {
                    self.splitter.reset();
                    self.send_link();
                }
                Err(source) => return Err(self.lose(now, source)),
            }
        }
        Ok(Progress::More)
    }

    /// Sends the standby the descriptors that the link has now.
    fn send_link(&mut self) {
        if let Some(handover) = &mut self.handover {
            handover.send_link(self.transport.as_ref().map(Transport::parts).as_ref());
        }
    }

    /// Accepts a standby and sends it what it needs to start in the middle of a stream.
    fn serve_standby(&mut self, now: Timestamp) {
        let Some(handover) = &mut self.handover else {
            return;
        };
        handover.detect_disconnect();
        if handover.accept() {
            handover.send_link(self.transport.as_ref().map(Transport::parts).as_ref());
            if self.splitter.pending() > 0 {
                handover.send_stream(now, self.splitter.rest());
            }
        }
    }

    /// Of a standby: reads handover messages instead of the link, until none is left, `messages` is full, or it owns
    /// the link.
    fn receive_as_standby(
        &mut self,
        now: Timestamp,
        messages: &mut Vec<Received>,
        filter: &mut impl FrameFilter,
    ) -> Progress {
        for _ in 0..CHUNKS_PER_CALL {
            if self.take_frames(messages, filter) == Progress::More {
                return Progress::More;
            }
            let Some(handover) = &mut self.handover else {
                return Progress::Drained;
            };
            if !handover.has_peer() {
                if now >= self.retry_at && !handover.reconnect() {
                    self.retry_at = now.plus_seconds(RECONNECT_S);
                }
                return Progress::Drained;
            }
            match handover.next_message(&mut self.message_buffer) {
                HandoverMessage::Nothing => return Progress::Drained,
                HandoverMessage::Link(parts) => {
                    self.splitter.reset();
                    self.transport = parts.and_then(Transport::of_parts);
                    self.answered = Some(Answered {
                        system_id: None,
                        heard: now,
                    });
                }
                HandoverMessage::Stream(time, range) => {
                    self.read_at = time;
                    self.splitter.push(&self.message_buffer[range]);
                }
                HandoverMessage::Datagram(time, sender, range) => {
                    self.read_at = time;
                    if let Some(transport) = &mut self.transport {
                        transport.set_last_sender(sender);
                    }
                    self.splitter.load_datagram(&self.message_buffer[range]);
                }
                HandoverMessage::Released { state, unsent } => {
                    if let Some(backlog) = self.transport.as_mut().and_then(Transport::backlog) {
                        backlog.replace(&self.message_buffer[unsent]);
                    }
                    self.handover_state = Some(self.message_buffer[state].to_vec());
                    self.take_over();
                    // The former owner handles what it has read; this process handles what comes from now on.
                    return Progress::More;
                }
                HandoverMessage::Gone => {
                    self.retry_at = now.plus_seconds(RECONNECT_S);
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
        let is_owner = self.is_owner();
        let Some(transport) = self.transport.as_mut().filter(|_| is_owner) else {
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

    fn take_frames(&mut self, messages: &mut Vec<Received>, filter: &mut impl FrameFilter) -> Progress {
        while messages.len() < messages.capacity() {
            let Some(frame) = self.splitter.next_frame() else {
                return Progress::Drained;
            };
            if !filter.admits(&frame) {
                continue;
            }
            if let Some(transport) = &mut self.transport {
                let sender = Sender {
                    system_id: frame.header.system_id,
                    component_id: frame.header.component_id,
                };
                let is_autopilot = self.reply_policy == ReplyPolicy::Autopilot && filter.is_autopilot(sender);
                let is_heard_elsewhere = self.answered.is_some_and(|answered| {
                    let is_it = answered
                        .system_id
                        .is_none_or(|system_id| system_id == sender.system_id);
                    is_it && self.read_at.seconds_since(answered.heard) <= ALIVE_S
                });
                if is_autopilot && is_heard_elsewhere && !transport.is_from_peer() {
                    self.counters.unknown_peers += 1;
                    self.impostors.hear(self.read_at);
                    continue;
                }
                if frame.is_verified && (is_autopilot || self.reply_policy == ReplyPolicy::Anybody) {
                    transport.set_peer_to_last_sender();
                    self.answered = Some(Answered {
                        system_id: Some(sender.system_id),
                        heard: self.read_at,
                    });
                }
            }
            let content = Content::of(&frame).filter(|_| frame.is_verified);
            let is_spoken = MavMessage::extra_crc(frame.message_id) != 0;
            self.counters.undecodable += u64::from(frame.is_verified && is_spoken && content.is_none());
            if filter.wants(&frame, content.as_ref())
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
        self.was_open = true;
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
                self.counters.reopened += u64::from(self.was_open);
                self.was_open = true;
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
