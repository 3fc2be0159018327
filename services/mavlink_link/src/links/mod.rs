//! All links of the gateway: the one to the autopilot, and those to ground stations and other components.
//!
//! | in | out |
//! |---|---|
//! | [`LinkSetup`]s, the autopilot's first | open links; a lost link reopens by itself and delays no other |
//! | frames received on any link ([`Links::receive`]) | messages addressed to us; [`crate::router`] forwards the others |
//! | messages to send ([`Links::send`]) | bytes on every link they are for, numbered, signed and within its budget |
//!
//! Each frame passes these checks in order: frames of senders that are no peer are dropped; frames whose signature is
//! not what the link requires are rejected; the rest updates the router, is forwarded unchanged, and is handled if
//! addressed to us.
//!
//! A second process may receive and take over later, as with one [`Link`]: each link has its own handover socket, and
//! the carries what the next process needs to know.

mod forward_queue;
mod member;
mod setup;

pub use setup::{LinkSetup, SetupCause, SetupError};

use crate::budget::TrafficClass;
use crate::encoder::Encoder;
use crate::encoder::{sequences_of_bytes, sequences_to_bytes};
use crate::frame::MavlinkFrame;
use crate::link::{Endpoint, FrameFilter, Link, LinkError, Progress};
use crate::message::{Content, Destination, Outgoing, Received};
use crate::router::{LinkSet, OwnIds, Router, Sender};
use crate::signing::Verifier;
use crate::signing::stamps::{self, StampKeeper, Stamps};
use crate::tlog::Tlog;
use forward_queue::ForwardQueue;
use jink_runtime::config::{Purpose, Signing};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::link::{LINKS, LinkTraffic, TelemetryLog};
use jink_shared_types::{Coded, Timestamp};
use mavlink::MessageData;
use mavlink::dialect::{MavMessage, SETUP_SIGNING_DATA};
use member::{LinkRules, Member};
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};

/// Descriptors of all links.
pub const LINK_FDS: usize = 3 * LINKS;
/// Pending events about links.
const EVENTS_MAX: usize = 4 * LINKS;

/// What all links have counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinksReport {
    /// Intact messages whose content could not be decoded.
    pub undecodable: u64,
    /// What becomes of the telemetry log.
    pub telemetry_log: Coded<TelemetryLog>,
    /// Each link by itself.
    pub links: [LinkTraffic; LINKS],
}

impl LinksReport {
    /// Bytes that belonged to no message.
    pub fn garbage_bytes(&self) -> u64 {
        self.links.iter().map(|link| link.garbage_bytes).sum()
    }
}

/// The links.
#[derive(Debug)]
pub struct Links {
    members: Vec<Member>,
    shared: LinkShared,
    stamps: Option<StampKeeper>,
    events: Vec<EventSample>,
}

/// What all links share while they receive.
#[derive(Debug)]
struct LinkShared {
    router: Router,
    verifier: Verifier,
    forward_queue: ForwardQueue,
    log: Option<Tlog>,
    telemetry_log: TelemetryLog,
}

/// The filter of one link.
struct LinkFilter<'a> {
    shared: &'a mut LinkShared,
    rules: &'a mut LinkRules,
    origin: u8,
    /// Whether this process owns the link: only the owner forwards and logs what it receives.
    is_owner: bool,
    us: OwnIds,
    our_stamp: u64,
}

impl Links {
    /// Opens all links and lets a second process join each at its handover socket. What is not there yet is waited for; that the first
    /// one cannot be opened for another reason is an error.
    ///
    /// # Errors
    /// [`LinkError`] of the first link, or of a handover socket.
    pub fn open(
        setups: Vec<LinkSetup>,
        handover_sockets: &[PathBuf],
        first: impl FnOnce(&LinkSetup) -> Result<Link, LinkError>,
    ) -> Result<Self, LinkError> {
        let mut first = Some(first);
        Self::build(setups, handover_sockets, |setup, handover_socket| {
            let mut link = match first.take() {
                Some(first) => match first(setup) {
                    Err(error) if error.is_absence() => Link::lost(setup.endpoint.clone()),
                    opened => opened?,
                },
                None => with_numeric(setup, Link::lost),
            };
            link.share(handover_socket)?;
            Ok(link)
        })
    }

    /// Joins the links that another process owns.
    ///
    /// # Errors
    /// [`LinkError::Handover`] if nobody shares the first link.
    pub fn join(setups: Vec<LinkSetup>, handover_sockets: &[PathBuf]) -> Result<Self, LinkError> {
        let mut is_first = true;
        Self::build(setups, handover_sockets, |setup, handover_socket| {
            if std::mem::take(&mut is_first) {
                Link::join(setup.endpoint.clone(), handover_socket)
            } else {
                Ok(with_numeric(setup, |endpoint| {
                    Link::join_later(endpoint, handover_socket)
                }))
            }
        })
    }

    fn build(
        setups: Vec<LinkSetup>,
        handover_sockets: &[PathBuf],
        mut open: impl FnMut(&LinkSetup, &Path) -> Result<Link, LinkError>,
    ) -> Result<Self, LinkError> {
        let several = setups.len() > 1;
        let mut members = Vec::with_capacity(LINKS);
        for (index, (setup, handover_socket)) in
            setups.into_iter().zip(handover_sockets).enumerate().take(LINKS)
        {
            let mut link = open(&setup, handover_socket)?
                .with_reply_policy(setup.reply_policy())
                .with_peers(setup.peers.clone());
            if several {
                link = link.among_others(index as u8);
            }
            members.push(Member::new(link, setup));
        }
        Ok(Self {
            shared: LinkShared {
                router: Router::new(members.len()),
                verifier: Verifier::default(),
                forward_queue: ForwardQueue::default(),
                log: None,
                telemetry_log: TelemetryLog::None,
            },
            members,
            stamps: None,
            events: Vec::with_capacity(EVENTS_MAX),
        })
    }

    /// Writes everything that is received and sent to `log`. One that cannot be begun, or ends, is reported: a log is no reason not
    /// to fly.
    pub fn record(&mut self, log: std::io::Result<Tlog>) {
        match log {
            Ok(log) => {
                self.shared.log = Some(log);
                self.shared.telemetry_log = TelemetryLog::Written;
            }
            Err(error) => {
                tracing::error!("no telemetry log: {error}");
                self.lose_log();
            }
        }
    }

    fn lose_log(&mut self) {
        self.shared.telemetry_log = TelemetryLog::Lost;
        self.events
            .push(EventSample::new(&events::TELEMETRY_LOG_LOST, "", [0.0; 2]));
    }

    /// Signs with stamps whose bound is kept at `path`, where a link asks for signatures.
    ///
    /// # Errors
    /// The system's error about the file.
    pub fn sign_with_stamps_at(&mut self, path: &Path) -> std::io::Result<()> {
        let signs = |member: &Member| member.rules.setup.signing != Signing::Off;
        if !self.members.iter().any(signs) {
            return Ok(());
        }
        let mut keeper = StampKeeper::open(path)?;
        if self.is_owner() {
            keeper.begin(stamps::wall())?;
        }
        self.stamps = Some(keeper);
        Ok(())
    }

    /// Goes on with the stamps of others that an earlier process has received, and keeps those that come, in a file on tmpfs and, at the
    /// end, in its `copy` on a disk: what was recorded cannot be played back to the next process.
    ///
    /// # Errors
    /// The system's error about the file.
    pub fn remember_senders_at(&mut self, path: &Path, copy: Option<&Path>) -> std::io::Result<()> {
        let is_asked = |member: &Member| member.rules.setup.signing != Signing::Off;
        if self.members.iter().any(is_asked) {
            self.shared.verifier = Verifier::remembering(path, copy)?;
        }
        Ok(())
    }

    /// Links on which no autopilot is looked for.
    pub fn of_ground_stations(&self) -> LinkSet {
        let is_one = |member: &Member| member.rules.setup.purpose == Purpose::GroundStation;
        (0..)
            .zip(&self.members)
            .filter(|(_, member)| is_one(member))
            .fold(LinkSet::default(), |set, (index, _)| set.with(index))
    }

    /// Whether the first link carries `bytes_per_s`.
    pub fn carries(&self, bytes_per_s: f64) -> bool {
        let first = self.members.first();
        first.is_some_and(|first| {
            first
                .rules
                .setup
                .rate_bps
                .is_none_or(|rate_bps| rate_bps >= bytes_per_s)
        })
    }

    /// Whether this process owns the first link, and so sends.
    pub fn is_owner(&self) -> bool {
        self.members.first().is_some_and(|first| first.link.is_owner())
    }

    /// Receives on all links, the first one first. Messages addressed to `us` are appended to `messages`, up to its
    /// capacity; the rest goes where it belongs.
    pub fn receive(
        &mut self,
        clock: impl Fn() -> Timestamp + Copy,
        us: OwnIds,
        messages: &mut Vec<Received>,
    ) -> Progress {
        let is_owner = self.is_owner();
        let mut progress = Progress::Drained;
        for origin in 0..self.members.len() {
            let member = &mut self.members[origin];
            if is_owner && member.link.has_lost_owner() {
                member.link.take_over();
            }
            let mut filter = LinkFilter {
                is_owner: member.link.is_owner(),
                shared: &mut self.shared,
                rules: &mut member.rules,
                origin: origin as u8,
                us,
                our_stamp: self
                    .stamps
                    .as_ref()
                    .map_or(0, |stamps| stamps.stamps().next().max(stamps::wall())),
            };
            let answer = member.link.receive_through(clock, messages, &mut filter);
            let change = member.report_state(answer.as_ref().err());
            if self.events.len() < EVENTS_MAX {
                self.events.extend(change);
            }
            if origin > 0
                && let Some(sequences) = member
                    .link
                    .take_handover_state()
                    .and_then(|state| sequences_of_bytes(&state))
            {
                member.encoder.resume_from(sequences);
            }
            if answer.is_ok_and(|answer| answer == Progress::More) {
                progress = Progress::More;
            }
            self.pass_on(clock());
        }
        let now = clock();
        let room = EVENTS_MAX.saturating_sub(self.events.len());
        let changes = self
            .members
            .iter_mut()
            .flat_map(|member| [member.judge(now), member.impostor()])
            .flatten();
        self.events.extend(changes.take(room));
        progress
    }

    fn pass_on(&mut self, now: Timestamp) {
        for (to, frame) in self.shared.forward_queue.frames() {
            for (index, member) in (0..).zip(&mut self.members) {
                if to.contains(index) {
                    member.pass_on(now, frame);
                }
            }
        }
        self.shared.forward_queue.clear();
    }

    /// Sends a message of ours over every link it is for. Returns the links that have it.
    pub fn send(&mut self, now: Timestamp, message: &Outgoing) -> LinkSet {
        let to = match message.to {
            Destination::Link(index) => LinkSet::default().with(index),
            Destination::Everyone => self.shared.router.links_to(message.body.target()),
        };
        let mut sent = LinkSet::default();
        for (index, member) in (0..).zip(&mut self.members) {
            if to.contains(index) && member.send(now, message, self.stamps.as_mut(), self.shared.log.as_mut())
            {
                sent = sent.with(index);
            }
        }
        sent
    }

    /// What has changed about the links since the last call.
    pub fn take_events(&mut self) -> impl Iterator<Item = EventSample> {
        if let Some(log) = self.shared.log.take_if(|log| log.failure().is_some()) {
            tracing::error!(
                "the telemetry log ends here: {}",
                log.failure().unwrap_or_default()
            );
            self.lose_log();
        }
        self.events.drain(..)
    }

    /// Hands all links over, the first one with `state`. Returns whether a process took it; this one then stays as the
    /// standby.
    pub fn release(&mut self, state: &[u8]) -> bool {
        let Some((first, others)) = self.members.split_first_mut() else {
            return false;
        };
        if !first.link.release(state) {
            return false;
        }
        for member in others.iter_mut().filter(|member| member.link.is_owner()) {
            if !member
                .link
                .release(&sequences_to_bytes(member.encoder.sequences()))
            {
                member.link.abandon();
            }
        }
        true
    }

    /// The handover state of the former owner; `Some` once, after it has handed the links over.
    pub fn take_handover_state(&mut self) -> Option<Vec<u8>> {
        self.members.first_mut()?.link.take_handover_state()
    }

    /// Continues signing after the last stamp of the former owner.
    pub fn resume_from(&mut self, stamps: Stamps) {
        if let Some(keeper) = &mut self.stamps {
            keeper.resume_from(stamps);
        }
    }

    /// Whether this process receives nothing on the first link because its owner is gone.
    pub fn has_lost_owner(&self) -> bool {
        self.members
            .first()
            .is_some_and(|first| first.link.has_lost_owner())
    }

    /// Takes the links of a dead owner over. Only for the process that the control record names as the owner.
    pub fn take_over(&mut self) {
        for member in &mut self.members {
            if member.link.has_lost_owner() {
                member.link.take_over();
            }
        }
        if let Some(keeper) = &mut self.stamps
            && let Err(error) = keeper.begin(stamps::wall())
        {
            tracing::error!("the stamps of signatures: {error}");
        }
    }

    /// The descriptors to watch.
    pub fn fds(&self) -> [Option<BorrowedFd<'_>>; LINK_FDS] {
        let mut fds = [None; LINK_FDS];
        for (three, member) in fds.chunks_exact_mut(3).zip(&self.members) {
            three.copy_from_slice(&member.link.fds());
        }
        fds
    }

    /// When to reopen a lost link, or to look for its next owner.
    pub fn next_wake(&self) -> Option<Timestamp> {
        self.members
            .iter()
            .filter_map(|member| member.link.next_wake())
            .min()
    }

    /// The numbering of the first link.
    pub fn encoder(&mut self) -> Option<&mut Encoder> {
        self.members.first_mut().map(|first| &mut first.encoder)
    }

    /// Which stamps are used up.
    pub fn stamps(&self) -> Stamps {
        self.stamps
            .as_ref()
            .map_or_else(Stamps::default, StampKeeper::stamps)
    }

    /// What was counted so far.
    pub fn report(&self) -> LinksReport {
        let mut report = LinksReport {
            telemetry_log: Coded::new(self.shared.telemetry_log),
            ..LinksReport::default()
        };
        for (index, (link, member)) in report.links.iter_mut().zip(&self.members).enumerate() {
            *link = member.traffic();
            link.dropped[TrafficClass::Forwarded as usize] += self.shared.forward_queue.lost[index];
            report.undecodable += member.link.counters().undecodable;
        }
        report
    }
}

/// A link to the endpoint with a number for its host. If its name has none now the link stays closed: to ask for it
/// again and again would keep the autopilot waiting.
fn with_numeric(setup: &LinkSetup, link: impl FnOnce(Endpoint) -> Link) -> Link {
    match setup.numeric_endpoint() {
        Ok(endpoint) => link(endpoint),
        Err(error) => {
            tracing::warn!(
                "link {}: stays closed, its host has no address (write a number): {error}",
                setup.name
            );
            link(setup.endpoint.clone()).kept_closed()
        }
    }
}

impl FrameFilter for LinkFilter<'_> {
    fn admits(&mut self, frame: &MavlinkFrame<'_>) -> bool {
        let setup = &self.rules.setup;
        let verified = self
            .shared
            .verifier
            .verify(frame, setup.signing, setup.key.as_ref(), self.our_stamp);
        match verified {
            Ok(()) => {
                self.shared.verifier.store(self.is_owner);
                // Many may read the log; keys are not written to it.
                let is_key = frame.message_id == SETUP_SIGNING_DATA::ID;
                if let Some(log) = self.shared.log.as_mut().filter(|_| self.is_owner && !is_key) {
                    log.add(frame.bytes);
                }
                true
            }
            Err(refusal) => {
                self.rules.count(refusal);
                false
            }
        }
    }

    fn wants(&mut self, frame: &MavlinkFrame<'_>, content: Option<&Content>) -> bool {
        let sender = Sender {
            system_id: frame.header.system_id,
            component_id: frame.header.component_id,
        };
        if self.us.sent(sender) {
            return false;
        }
        let router = &mut self.shared.router;
        // Whoever says on a ground station's link that it is our autopilot takes nothing of it there.
        let is_where_it_says =
            self.rules.setup.purpose == Purpose::Autopilot || !self.us.is_autopilot(sender);
        if frame.is_verified && is_where_it_says {
            router.learn(self.origin, sender);
            if let Some(Content::Message(MavMessage::SYSTEM_TIME(time))) = content {
                router.on_system_time(self.origin, sender, time.time_boot_ms);
            }
        }
        let target = frame.target();
        if self.is_owner {
            let to = router.forwards_to(self.origin, frame.message_id, target);
            self.shared.forward_queue.add(to, frame.bytes);
        }
        self.us.accepts(target)
    }

    fn is_autopilot(&self, sender: Sender) -> bool {
        self.us.is_autopilot(sender)
    }
}
