//! One link with what belongs to it alone: its numbering, its budget, its counters.

use super::LinkSetup;
use crate::budget::{Budget, CapacityChange, TrafficClass};
use crate::encoder::Encoder;
use crate::link::{Endpoint, Link, LinkError, Sent};
use crate::message::Outgoing;
use crate::signing::stamps::{self, StampKeeper};
use crate::signing::{SIGNATURE_BYTES, SIGNED_FRAME_MAX, SignatureRefusal, sign};
use crate::tlog::Tlog;
use jink_runtime::config::Signing;
use jink_shared_types::events::{
    EventSample, LINK_FAST_AGAIN, LINK_OPEN, LINK_SLOW, LINK_WAITED, SECOND_SENDER,
};
use jink_shared_types::health::{NAME_BYTES, Name};
use jink_shared_types::link::LinkTraffic;
use jink_shared_types::{Flag, Timestamp};

/// One of the links.
#[derive(Debug)]
pub(super) struct Member {
    pub(super) link: Link,
    pub(super) rules: LinkRules,
    pub(super) encoder: Encoder,
    name: String,
    budget: Option<Budget>,
    signed: Box<[u8; SIGNED_FRAME_MAX]>,
    is_lost: bool,
}

/// What a link asks of what comes in, and what it has counted.
#[derive(Debug)]
pub(super) struct LinkRules {
    pub(super) setup: LinkSetup,
    pub(super) traffic: LinkTraffic,
}

impl LinkRules {
    pub(super) fn count(&mut self, refusal: SignatureRefusal) {
        let counter = match refusal {
            SignatureRefusal::Signature => &mut self.traffic.signature_refused,
            SignatureRefusal::Replayed => &mut self.traffic.replayed,
            SignatureRefusal::Unsigned => &mut self.traffic.unsigned_refused,
        };
        *counter += 1;
    }
}

impl Member {
    pub(super) fn new(link: Link, setup: LinkSetup) -> Self {
        Self {
            link,
            encoder: Encoder::new(),
            name: setup.name.clone(),
            budget: setup.rate_bps.map(Budget::new),
            signed: Box::new([0; SIGNED_FRAME_MAX]),
            is_lost: false,
            rules: LinkRules {
                traffic: LinkTraffic {
                    name: Name::new(&setup.name),
                    ..LinkTraffic::default()
                },
                setup,
            },
        }
    }

    pub(super) fn traffic(&self) -> LinkTraffic {
        let counters = self.link.counters();
        LinkTraffic {
            unknown_peers: counters.unknown_peers,
            garbage_bytes: counters.garbage_bytes,
            reopened: counters.reopened,
            is_waited_for: Flag::from(self.is_lost),
            ..self.rules.traffic
        }
    }

    /// Sends a message of ours, if the budget allows it. Returns whether the kernel has it.
    pub(super) fn send(
        &mut self,
        now: Timestamp,
        message: &Outgoing,
        stamps: Option<&mut StampKeeper>,
        log: Option<&mut Tlog>,
    ) -> bool {
        let class = TrafficClass::of(message.body.message_id());
        let frame = self
            .encoder
            .encode(message.system_id, message.component_id, &message.body);
        let signing = self.rules.setup.signing;
        let signature_bytes = if signing == Signing::Off {
            0
        } else {
            SIGNATURE_BYTES
        };
        if let Some(budget) = &mut self.budget
            && !budget.admits(now, class, frame.len() + signature_bytes)
        {
            self.rules.traffic.dropped[class as usize] += 1;
            self.encoder.take_back(message.component_id);
            return false;
        }
        let bytes = match (signing, &self.rules.setup.key) {
            (Signing::Off, _) | (_, None) => Some(frame),
            (_, Some(key)) => stamps
                .and_then(|stamps| stamps.take(stamps::wall()))
                .and_then(|stamp| sign(frame, key, self.rules.setup.link_id, stamp, &mut self.signed)),
        };
        // A broken link shows at the next reception, where it is logged and reopened.
        let sent = bytes
            .filter(|bytes| matches!(self.link.send(now, bytes), Ok(Sent::Yes)))
            .inspect(|bytes| {
                if let Some(log) = log {
                    log.add(bytes);
                }
            });
        let sent_bytes = sent.map(<[u8]>::len);
        match sent_bytes {
            Some(len) => self.rules.traffic.sent_bytes[class as usize] += len as u64,
            None => self.encoder.take_back(message.component_id),
        }
        sent_bytes.is_some()
    }

    /// Sends what came in on another link, as it is, if the budget allows it.
    pub(super) fn pass_on(&mut self, now: Timestamp, frame: &[u8]) {
        let class = TrafficClass::Forwarded;
        if let Some(budget) = &mut self.budget
            && !budget.admits(now, class, frame.len())
        {
            self.rules.traffic.dropped[class as usize] += 1;
            return;
        }
        if matches!(self.link.send(now, frame), Ok(Sent::Yes)) {
            self.rules.traffic.sent_bytes[class as usize] += frame.len() as u64;
            self.rules.traffic.forwarded += 1;
        }
    }

    /// Whether the link has become too slow, or fast enough again.
    pub(super) fn judge(&mut self, now: Timestamp) -> Option<EventSample> {
        let event = match self.budget.as_mut()?.judge(now)? {
            CapacityChange::Slow {
                carries_bps,
                needed_bps,
            } => EventSample::new(&LINK_SLOW, &self.name, [carries_bps.round(), needed_bps.round()]),
            CapacityChange::FastAgain => EventSample::new(&LINK_FAST_AGAIN, &self.name, [0.0; 2]),
        };
        Some(event)
    }

    /// Whether somebody else speaks as our autopilot.
    pub(super) fn impostor(&mut self) -> Option<EventSample> {
        let is_heard = self.link.take_impostor();
        is_heard.then(|| EventSample::new(&SECOND_SENDER, &self.name, [0.0; 2]))
    }

    /// Logs and reports a link that is lost or not there yet once, and that it is open once.
    pub(super) fn report_state(&mut self, lost: Option<&LinkError>) -> Option<EventSample> {
        let was_lost = std::mem::replace(&mut self.is_lost, self.link.is_lost());
        let event = match (was_lost, self.is_lost) {
            (false, true) => {
                match lost {
                    Some(cause) => tracing::warn!("link {}: waiting for it: {cause}", self.name),
                    None => tracing::warn!("link {}: waiting for {}", self.name, self.rules.setup.endpoint),
                }
                &LINK_WAITED
            }
            (true, false) => {
                tracing::info!("link {} is open", self.name);
                &LINK_OPEN
            }
            _ => return None,
        };
        Some(EventSample::new(event, &self.device(), [0.0; 2]))
    }

    /// What a person looks for when the link is not there: the serial port, if its path fits a text, else the link's name.
    fn device(&self) -> String {
        match &self.rules.setup.endpoint {
            Endpoint::Serial { path, .. } if path.len() <= NAME_BYTES => path.clone(),
            _ => format!("link {}", self.name),
        }
    }
}
