//! All links of the gateway: the autopilot's, and those of whoever else is to hear and to be heard.
//!
//! | in | out |
//! |---|---|
//! | [`LinkSetup`]s, the autopilot's first | open links; one that is lost opens itself again and keeps nobody waiting |
//! | what comes in on any link ([`Links::receive`]) | messages for us; the others are passed on by [`crate::router`] |
//! | messages of ours ([`Links::send`]) | bytes on every link they are for, numbered, signed and within its budget |
//!
//! The rules of a frame, in this order: a sender that is no peer is not heard; a signature that is not as the link asks for
//! refuses the frame; what is left teaches the router, is passed on unchanged, and is handled if it is for us.
//!
//! A second process may listen and go on later, as with one [`Link`]: each link has a door of its own, and the first one
//! carries what the next process needs to know.

mod member;
mod setup;
mod transit;

pub use setup::{LinkSetup, SetupCause, SetupError};

use crate::budget::Class;
use crate::encoder::Encoder;
use crate::encoder::{sequences_of_bytes, sequences_to_bytes};
use crate::frame::Frame;
use crate::link::{Endpoint, Intake, Link, LinkError, Progress};
use crate::message::{Content, Destination, Outgoing, Received};
use crate::router::{LinkSet, Router, Sender, Us};
use crate::signing::Verifier;
use crate::signing::stamps::{self, StampKeeper, Stamps};
use crate::tlog::Tlog;
use jink_runtime::config::{Purpose, Signing};
use jink_shared_types::Timestamp;
use jink_shared_types::events::EventSample;
use jink_shared_types::link::{LINKS, LinkTraffic};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{MavMessage, SETUP_SIGNING_DATA};
use member::{Member, Rules};
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use transit::Transit;

/// Descriptors of all links.
pub const LINK_FDS: usize = 3 * LINKS;
/// Changes of links that wait to be told.
const NEWS: usize = 2 * LINKS;

/// What all links have counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinksReport {
    /// Intact messages whose content could not be decoded.
    pub undecodable: u64,
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
    hall: Hall,
    stamps: Option<StampKeeper>,
    news: Vec<EventSample>,
}

/// What all links share while they receive.
#[derive(Debug)]
struct Hall {
    router: Router,
    verifier: Verifier,
    transit: Transit,
    log: Option<Tlog>,
}

/// The intake of one link.
struct Gate<'a> {
    hall: &'a mut Hall,
    rules: &'a mut Rules,
    origin: u8,
    /// Whether this process passes on and logs what it hears.
    holds: bool,
    us: Us,
    our_stamp: u64,
}

impl Links {
    /// Opens all links and lets a second process join each at its door. The first one must open; the others may be
    /// found later.
    ///
    /// # Errors
    /// [`LinkError`] of the first link, or of a door.
    pub fn open(
        setups: Vec<LinkSetup>,
        doors: &[PathBuf],
        first: impl FnOnce(&LinkSetup) -> Result<Link, LinkError>,
    ) -> Result<Self, LinkError> {
        let mut first = Some(first);
        Self::build(setups, doors, |setup, door| {
            let mut link = match first.take() {
                Some(first) => first(setup)?,
                None => with_numeric(setup, Link::lost),
            };
            link.share(door)?;
            Ok(link)
        })
    }

    /// Joins the links that another process holds.
    ///
    /// # Errors
    /// [`LinkError::Handover`] if nobody shares the first link.
    pub fn join(setups: Vec<LinkSetup>, doors: &[PathBuf]) -> Result<Self, LinkError> {
        let mut is_first = true;
        Self::build(setups, doors, |setup, door| {
            if std::mem::take(&mut is_first) {
                Link::join(setup.endpoint.clone(), door)
            } else {
                Ok(with_numeric(setup, |endpoint| Link::join_later(endpoint, door)))
            }
        })
    }

    fn build(
        setups: Vec<LinkSetup>,
        doors: &[PathBuf],
        mut open: impl FnMut(&LinkSetup, &Path) -> Result<Link, LinkError>,
    ) -> Result<Self, LinkError> {
        let several = setups.len() > 1;
        let mut members = Vec::with_capacity(LINKS);
        for (index, (setup, door)) in setups.into_iter().zip(doors).enumerate().take(LINKS) {
            let mut link = open(&setup, door)?
                .answering(setup.answers())
                .with_peers(setup.peers.clone());
            if several {
                link = link.among_others(index as u8);
            }
            members.push(Member::new(link, setup));
        }
        Ok(Self {
            hall: Hall {
                router: Router::new(members.len()),
                verifier: Verifier::default(),
                transit: Transit::default(),
                log: None,
            },
            members,
            stamps: None,
            news: Vec::with_capacity(NEWS),
        })
    }

    /// Writes everything that is heard and sent to `log`.
    pub fn record(&mut self, log: Tlog) {
        self.hall.log = Some(log);
    }

    /// Signs with stamps whose bound is kept at `path`, where a link asks for signatures.
    ///
    /// # Errors
    /// What the system says about the file.
    pub fn sign_with_stamps_at(&mut self, path: &Path) -> std::io::Result<()> {
        let signs = |member: &Member| member.rules.setup.signing != Signing::Off;
        if !self.members.iter().any(signs) {
            return Ok(());
        }
        let mut keeper = StampKeeper::open(path)?;
        if self.holds() {
            keeper.begin(stamps::wall())?;
        }
        self.stamps = Some(keeper);
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

    /// Whether this process speaks: whether it holds the first link.
    pub fn holds(&self) -> bool {
        self.members.first().is_some_and(|first| first.link.holds())
    }

    /// Takes in what has come on all links, the first one first. Messages for `us` end in `messages`, up to its capacity;
    /// the rest goes where it belongs.
    pub fn receive(
        &mut self,
        clock: impl Fn() -> Timestamp + Copy,
        us: Us,
        messages: &mut Vec<Received>,
    ) -> Progress {
        let speaks = self.holds();
        let mut progress = Progress::Drained;
        for origin in 0..self.members.len() {
            let member = &mut self.members[origin];
            if speaks && member.link.is_orphaned() {
                member.link.take();
            }
            let mut gate = Gate {
                holds: member.link.holds(),
                hall: &mut self.hall,
                rules: &mut member.rules,
                origin: origin as u8,
                us,
                our_stamp: self.stamps.as_ref().map_or(0, |stamps| stamps.stamps().next()),
            };
            let answer = member.link.receive_through(clock, messages, &mut gate);
            member.tell(answer.as_ref().err());
            if origin > 0
                && let Some(sequences) = member
                    .link
                    .take_baton()
                    .and_then(|baton| sequences_of_bytes(&baton))
            {
                member.encoder.go_on_from(sequences);
            }
            if answer.is_ok_and(|answer| answer == Progress::More) {
                progress = Progress::More;
            }
            self.pass_on(clock());
        }
        let now = clock();
        let room = NEWS - self.news.len();
        let changes = self.members.iter_mut().filter_map(|member| member.judge(now));
        self.news.extend(changes.take(room));
        progress
    }

    fn pass_on(&mut self, now: Timestamp) {
        for (to, frame) in self.hall.transit.frames() {
            for (index, member) in (0..).zip(&mut self.members) {
                if to.contains(index) {
                    member.pass_on(now, frame);
                }
            }
        }
        self.hall.transit.clear();
    }

    /// Sends a message of ours over every link it is for. Returns the links that have it.
    pub fn send(&mut self, now: Timestamp, message: &Outgoing) -> LinkSet {
        let to = match message.to {
            Destination::Link(index) => LinkSet::default().with(index),
            Destination::Everyone => self.hall.router.reaches(message.body.target()),
        };
        let mut sent = LinkSet::default();
        for (index, member) in (0..).zip(&mut self.members) {
            if to.contains(index) && member.send(now, message, self.stamps.as_mut(), self.hall.log.as_mut()) {
                sent = sent.with(index);
            }
        }
        sent
    }

    /// What has changed about the links since the last call.
    pub fn news(&mut self) -> impl Iterator<Item = EventSample> {
        self.news.drain(..)
    }

    /// Passes all links on, the first one with `baton`. Returns whether there was somebody to take it; this process hears
    /// on then.
    pub fn release(&mut self, baton: &[u8]) -> bool {
        let Some((first, others)) = self.members.split_first_mut() else {
            return false;
        };
        if !first.link.release(baton) {
            return false;
        }
        for member in others.iter_mut().filter(|member| member.link.holds()) {
            if !member
                .link
                .release(&sequences_to_bytes(member.encoder.sequences()))
            {
                member.link.let_go();
            }
        }
        true
    }

    /// What the former holder wanted this one to know; once, after it has passed the links on.
    pub fn take_baton(&mut self) -> Option<Vec<u8>> {
        self.members.first_mut()?.link.take_baton()
    }

    /// Signs on where the former holder has stopped.
    pub fn go_on_from(&mut self, stamps: Stamps) {
        if let Some(keeper) = &mut self.stamps {
            keeper.go_on_from(stamps);
        }
    }

    /// Whether this process hears nothing on the first link because its holder is gone.
    pub fn is_orphaned(&self) -> bool {
        self.members.first().is_some_and(|first| first.link.is_orphaned())
    }

    /// Goes on with the links of a holder that has died. Only for whom the control record names the owner.
    pub fn take(&mut self) {
        for member in &mut self.members {
            if member.link.is_orphaned() {
                member.link.take();
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

    /// When a lost link will be opened, or its next holder be looked for, again.
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
        let mut report = LinksReport::default();
        for (index, (link, member)) in report.links.iter_mut().zip(&self.members).enumerate() {
            *link = member.traffic();
            link.dropped[Class::Forwarded as usize] += self.hall.transit.lost[index];
            report.undecodable += member.link.counters().undecodable;
        }
        report
    }
}

/// A link to the endpoint with a number for its host. If its name has none now the link stays closed: to ask for it again
/// and again would keep the autopilot waiting.
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

impl Intake for Gate<'_> {
    fn admits(&mut self, frame: &Frame<'_>) -> bool {
        let setup = &self.rules.setup;
        let verified = self
            .hall
            .verifier
            .verify(frame, setup.signing, setup.key.as_ref(), self.our_stamp);
        match verified {
            Ok(()) => {
                // The log is read by many, a key by nobody.
                let is_key = frame.message_id == SETUP_SIGNING_DATA::ID;
                if let Some(log) = self.hall.log.as_mut().filter(|_| self.holds && !is_key) {
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

    fn wants(&mut self, frame: &Frame<'_>, content: Option<&Content>) -> bool {
        let sender = Sender {
            system_id: frame.header.system_id,
            component_id: frame.header.component_id,
        };
        if self.us.sent(sender) {
            return false;
        }
        let router = &mut self.hall.router;
        if frame.is_verified {
            router.learn(self.origin, sender);
        }
        if let Some(Content::Message(MavMessage::SYSTEM_TIME(time))) = content {
            router.hear_clock(self.origin, sender, time.time_boot_ms);
        }
        let target = content.map(Content::target).unwrap_or_default();
        if self.holds {
            let to = router.passes_to(self.origin, frame.message_id, target);
            self.hall.transit.add(to, frame.bytes);
        }
        self.us.are_meant(target)
    }
}
