//! Which vehicle is ours: the configured system id, or the only autopilot on the links.
//!
//! Without a configured id the first autopilot is selected at once, so that a restarted gateway does not keep a flying
//! vehicle waiting. If a second one appears within three seconds, the choice is ambiguous: neither is selected until
//! only one is left, which then stays selected. Later autopilots are not ours, and so is system 0, the broadcast
//! address: losing the vehicle in flight to another autopilot would stop its setpoints. A gateway that is started again
//! in flight keeps the vehicle of the one before ([`VehicleSelector::resume`]), whoever else is heard.
//!
//! The vehicle may be received on several links. One of them is selected: the one on which it appeared first, until it
//! is silent there for `SILENT_S` and received on another. What comes on the other links is a duplicate.

use jink_shared_types::Timestamp;
use mavlink::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};

/// The autopilot counts as alive for this long after its last message (s): one lost heartbeat at 1 Hz is tolerated.
pub const ALIVE_S: f64 = 1.5;
/// How long a second autopilot puts the first in doubt (s).
const DEBOUNCE_S: f64 = 3.0;

/// How long the autopilot's link is silent before another one on which it is last_received becomes its own (s): as long
/// as the autopilot counts as alive.
const SILENT_S: f64 = 1.5;

/// An autopilot that may be ours.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    system_id: u8,
    since: Timestamp,
    last_received: Timestamp,
}

impl Candidate {
    fn is_silent(&self, now: Timestamp) -> bool {
        now.seconds_since(self.last_received) > DEBOUNCE_S
    }
}

/// Finds and keeps our vehicle.
#[derive(Clone, Copy, Debug)]
pub struct VehicleSelector {
    configured: Option<u8>,
    first: Option<Candidate>,
    /// The last other autopilot that was received.
    rival: Option<Candidate>,
    /// The rival appeared together with the first: either may be ours.
    is_ambiguous: bool,
    link: u8,
    link_received: Timestamp,
}

impl VehicleSelector {
    /// With the system id from the configuration, if it names one.
    pub fn new(configured: Option<u8>) -> Self {
        Self {
            configured,
            first: None,
            rival: None,
            is_ambiguous: false,
            link: 0,
            link_received: Timestamp::NEVER,
        }
    }

    /// Keeps the vehicle and the link that the gateway before has flown until `now`, unless another one is configured.
    pub fn resume(&mut self, system_id: u8, link: u8, now: Timestamp) {
        if system_id == 0 || self.configured.is_some_and(|configured| configured != system_id) {
            return;
        }
        self.first = Some(Candidate {
            system_id,
            since: Timestamp::NEVER,
            last_received: now,
        });
        self.link = link;
        self.link_received = now;
    }

    /// Our autopilot was last_received on `link`; answers whether that is its own.
    pub fn is_selected_link(&mut self, link: u8, time: Timestamp) -> bool {
        if link != self.link && time.seconds_since(self.link_received) > SILENT_S {
            self.link = link;
        }
        if link == self.link {
            self.link_received = time;
        }
        link == self.link
    }

    /// Our autopilot's link; the first one before it was last_received.
    pub fn link(&self) -> u8 {
        self.link
    }

    /// Processes the reception of an autopilot's message.
    pub fn observe(&mut self, system_id: u8, time: Timestamp) {
        let is_another = self.configured.is_some_and(|configured| configured != system_id);
        if is_another || system_id == 0 {
            return;
        }
        self.settle(time);
        let last_received = Candidate {
            system_id,
            since: time,
            last_received: time,
        };
        let Some(first) = &mut self.first else {
            self.first = Some(last_received);
            return;
        };
        if first.system_id == system_id {
            first.last_received = time;
        } else {
            self.is_ambiguous |= time.seconds_since(first.since) <= DEBOUNCE_S;
            self.rival = Some(last_received);
        }
    }

    /// When one of two is silent, the other is selected from now on.
    fn settle(&mut self, now: Timestamp) {
        let (Some(first), Some(rival)) = (self.first, self.rival.filter(|_| self.is_ambiguous)) else {
            return;
        };
        let left = match (first.is_silent(now), rival.is_silent(now)) {
            (_, true) => first,
            (true, false) => rival,
            (false, false) => return,
        };
        self.rival = None;
        self.is_ambiguous = false;
        // Nobody is a second one within three seconds of this any more.
        self.first = Some(Candidate {
            since: Timestamp::NEVER,
            ..left
        });
    }

    /// Our vehicle's system id; `None` before an autopilot was last_received, and while there are two.
    pub fn system_id(&self, now: Timestamp) -> Option<u8> {
        let mut settled = *self;
        settled.settle(now);
        let is_decided = !settled.is_ambiguous;
        settled.first.filter(|_| is_decided).map(|first| first.system_id)
    }

    /// Two autopilots of which the configuration does not say which one is ours, while both are heard: the first one, which is
    /// kept if it was there before the other, and the other.
    pub fn two(&self, now: Timestamp) -> Option<[u8; 2]> {
        let heard = |one: Option<Candidate>| one.filter(|one| !one.is_silent(now));
        let (first, rival) = heard(self.first).zip(heard(self.rival))?;
        Some([first.system_id, rival.system_id])
    }

    /// The system id to send with before an autopilot was received: on some links the companion has to send first. 1 is
    /// what autopilots are delivered with.
    pub fn default_id(&self) -> u8 {
        self.configured.unwrap_or(1)
    }
}

/// Whether only an autopilot sends a message like this.
#[allow(deprecated)]
pub fn is_from_autopilot(message: &MavMessage) -> bool {
    match message {
        MavMessage::HEARTBEAT(heartbeat) => is_autopilot(heartbeat),
        MavMessage::LOCAL_POSITION_NED(_)
        | MavMessage::ATTITUDE_QUATERNION(_)
        | MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_) => true,
        _ => false,
    }
}

/// Whether a heartbeat is that of an autopilot.
pub fn is_autopilot(heartbeat: &HEARTBEAT_DATA) -> bool {
    heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
        && !matches!(
            heartbeat.mavtype,
            MavType::MAV_TYPE_GCS | MavType::MAV_TYPE_ONBOARD_CONTROLLER
        )
}

#[cfg(test)]
mod tests {
    use super::VehicleSelector;
    use jink_shared_types::Timestamp;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + s)
    }

    #[test]
    fn the_only_autopilot_is_taken_at_once_and_kept() {
        let mut selector = VehicleSelector::new(None);
        assert_eq!(selector.system_id(at(0.0)), None);
        selector.observe(7, at(0.0));
        assert_eq!(selector.system_id(at(0.0)), Some(7));
        selector.observe(9, at(60.0));
        assert_eq!(selector.system_id(at(60.0)), Some(7));
    }

    #[test]
    fn two_autopilots_at_the_start_are_nobodys_until_one_is_left() {
        for left in [7, 9] {
            let mut selector = VehicleSelector::new(None);
            selector.observe(7, at(0.0));
            selector.observe(9, at(1.0));
            assert_eq!(
                (selector.system_id(at(1.0)), selector.two(at(1.0))),
                (None, Some([7, 9]))
            );
            for i in 0..20 {
                selector.observe(7, at(f64::from(i)));
                selector.observe(9, at(f64::from(i) + 0.5));
            }
            assert_eq!(selector.system_id(at(20.0)), None, "both are still there");
            for i in 20..40 {
                selector.observe(left, at(f64::from(i)));
            }
            assert_eq!(selector.system_id(at(40.0)), Some(left), "the other is gone");
        }
    }

    #[test]
    fn in_flight_the_vehicle_is_not_lost_to_another_autopilot_that_was_there_at_the_start() {
        let mut selector = VehicleSelector::new(None);
        selector.observe(9, at(0.0));
        selector.observe(7, at(1.0));
        for i in 2..60 {
            selector.observe(7, at(f64::from(i)));
        }
        assert_eq!(selector.system_id(at(60.0)), Some(7));
        selector.observe(9, at(60.1));
        assert_eq!(
            (selector.system_id(at(60.1)), selector.two(at(60.1))),
            (Some(7), Some([7, 9])),
            "kept, and the other one is known of"
        );
        assert_eq!(selector.two(at(64.0)), None, "the other one is gone");
    }

    #[test]
    fn a_vehicle_that_was_flown_is_kept_whoever_else_is_heard() {
        let mut selector = VehicleSelector::new(None);
        selector.resume(7, 1, at(0.0));
        for i in 0..20 {
            selector.observe(9, at(0.1 + f64::from(i)));
            selector.observe(7, at(0.2 + f64::from(i)));
        }
        assert_eq!((selector.system_id(at(20.0)), selector.link()), (Some(7), 1));
        let mut named = VehicleSelector::new(Some(9));
        named.resume(7, 1, at(0.0));
        assert_eq!(
            (named.system_id(at(0.0)), named.link()),
            (None, 0),
            "another one is configured"
        );
    }

    #[test]
    fn system_0_is_not_our_vehicle() {
        for configured in [None, Some(0)] {
            let mut selector = VehicleSelector::new(configured);
            selector.observe(0, at(0.0));
            assert_eq!(selector.system_id(at(0.0)), None);
        }
    }

    #[test]
    fn its_link_is_the_first_it_was_received_on_until_it_is_silent_there() {
        let mut selector = VehicleSelector::new(None);
        selector.observe(7, at(0.0));
        assert!(selector.is_selected_link(1, at(0.0)));
        assert!(!selector.is_selected_link(0, at(0.1)), "said twice");
        assert!(selector.is_selected_link(1, at(1.0)) && !selector.is_selected_link(0, at(2.4)));
        assert!(
            selector.is_selected_link(0, at(2.6)),
            "its link was silent for 1.6 s"
        );
        assert_eq!(selector.link(), 0);
    }

    #[test]
    fn the_configured_one_is_ours_whichever_others_there_are() {
        let mut selector = VehicleSelector::new(Some(9));
        selector.observe(7, at(0.0));
        assert_eq!((selector.system_id(at(0.0)), selector.default_id()), (None, 9));
        selector.observe(9, at(0.1));
        selector.observe(7, at(0.2));
        assert_eq!(selector.system_id(at(0.2)), Some(9));
    }
}
