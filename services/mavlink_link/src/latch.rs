//! Which vehicle is ours: the configured system id, or the only autopilot heard.
//!
//! Without a configured id the first autopilot heard is taken at once, so that a restarted gateway does not keep a flying
//! vehicle waiting. If a second one is heard within three seconds of that, nobody can tell which is meant: then neither is
//! ours until only one is left, which is ours for good. Later strangers are ignored, and so is system 0, which is nobody: to lose the
//! vehicle in flight to a stranger would stop its setpoints.
//!
//! It may be heard on several links. One of them is its own: the one it was heard on first, until it is silent there for
//! `SILENT_S` and heard on another. What it says elsewhere is said twice.

use jink_shared_types::Timestamp;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};

/// The autopilot counts as alive for this long after its last message (s): one lost heartbeat at 1 Hz is forgiven.
pub const ALIVE_S: f64 = 1.5;
/// How long a second autopilot puts the first in doubt (s).
const DEBOUNCE_S: f64 = 3.0;

/// How long the autopilot's link is silent before another one on which it is heard becomes its own (s): as long as the
/// autopilot counts as alive.
const SILENT_S: f64 = 1.5;

/// One that may be ours.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    system_id: u8,
    since: Timestamp,
    heard: Timestamp,
}

impl Candidate {
    fn is_silent(&self, now: Timestamp) -> bool {
        now.seconds_since(self.heard) > DEBOUNCE_S
    }
}

/// Finds and keeps our vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Latch {
    configured: Option<u8>,
    first: Option<Candidate>,
    rival: Option<Candidate>,
    link: u8,
    heard_on_link: Timestamp,
}

impl Latch {
    /// With the system id from the configuration, if it names one.
    pub fn new(configured: Option<u8>) -> Self {
        Self {
            configured,
            first: None,
            rival: None,
            link: 0,
            heard_on_link: Timestamp::NEVER,
        }
    }

    /// Our autopilot was heard on `link`; answers whether that is its own.
    pub fn is_heard_on(&mut self, link: u8, time: Timestamp) -> bool {
        if link != self.link && time.seconds_since(self.heard_on_link) > SILENT_S {
            self.link = link;
        }
        if link == self.link {
            self.heard_on_link = time;
        }
        link == self.link
    }

    /// Our autopilot's link; the first one before it was heard.
    pub fn link(&self) -> u8 {
        self.link
    }

    /// Takes note of an autopilot's message.
    pub fn hear(&mut self, system_id: u8, time: Timestamp) {
        let is_another = self.configured.is_some_and(|configured| configured != system_id);
        if is_another || system_id == 0 {
            return;
        }
        self.settle(time);
        let heard = Candidate {
            system_id,
            since: time,
            heard: time,
        };
        let Some(first) = &mut self.first else {
            self.first = Some(heard);
            return;
        };
        if first.system_id == system_id {
            first.heard = time;
        } else if self.rival.is_some() || time.seconds_since(first.since) <= DEBOUNCE_S {
            self.rival = Some(heard);
        }
    }

    /// One of two that is left is ours from now on.
    fn settle(&mut self, now: Timestamp) {
        let (Some(first), Some(rival)) = (self.first, self.rival) else {
            return;
        };
        let left = match (first.is_silent(now), rival.is_silent(now)) {
            (_, true) => first,
            (true, false) => rival,
            (false, false) => return,
        };
        self.rival = None;
        // Nobody is a second one within three seconds of this any more.
        self.first = Some(Candidate {
            since: Timestamp::NEVER,
            ..left
        });
    }

    /// Our vehicle's system id; `None` before an autopilot was heard, and while there are two.
    pub fn system_id(&self, now: Timestamp) -> Option<u8> {
        let mut settled = *self;
        settled.settle(now);
        let undecided = settled.rival.is_some();
        settled.first.filter(|_| !undecided).map(|first| first.system_id)
    }

    /// The second autopilot that puts the first in doubt.
    pub fn rival(&self, now: Timestamp) -> Option<u8> {
        let mut settled = *self;
        settled.settle(now);
        settled.rival.map(|rival| rival.system_id)
    }

    /// The system id to sign with while no autopilot was heard: somebody has to speak first on some links. 1 is what
    /// autopilots are delivered with.
    pub fn greeting_id(&self) -> u8 {
        self.configured.unwrap_or(1)
    }
}

/// Whether a message comes from an autopilot and nobody else.
#[allow(deprecated)]
pub fn speaks_as_autopilot(message: &MavMessage) -> bool {
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
    use super::Latch;
    use jink_shared_types::Timestamp;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + s)
    }

    #[test]
    fn the_only_autopilot_is_taken_at_once_and_kept() {
        let mut latch = Latch::new(None);
        assert_eq!(latch.system_id(at(0.0)), None);
        latch.hear(7, at(0.0));
        assert_eq!(latch.system_id(at(0.0)), Some(7));
        latch.hear(9, at(60.0));
        assert_eq!(latch.system_id(at(60.0)), Some(7));
    }

    #[test]
    fn two_autopilots_at_the_start_are_nobodys_until_one_is_left() {
        for left in [7, 9] {
            let mut latch = Latch::new(None);
            latch.hear(7, at(0.0));
            latch.hear(9, at(1.0));
            assert_eq!((latch.system_id(at(1.0)), latch.rival(at(1.0))), (None, Some(9)));
            for i in 0..20 {
                latch.hear(7, at(f64::from(i)));
                latch.hear(9, at(f64::from(i) + 0.5));
            }
            assert_eq!(latch.system_id(at(20.0)), None, "both are still there");
            for i in 20..40 {
                latch.hear(left, at(f64::from(i)));
            }
            assert_eq!(latch.system_id(at(40.0)), Some(left), "the other is gone");
        }
    }

    #[test]
    fn in_flight_the_vehicle_is_not_lost_to_a_stranger_that_was_there_at_the_start() {
        let mut latch = Latch::new(None);
        latch.hear(9, at(0.0));
        latch.hear(7, at(1.0));
        for i in 2..60 {
            latch.hear(7, at(f64::from(i)));
        }
        assert_eq!(latch.system_id(at(60.0)), Some(7));
        latch.hear(9, at(60.1));
        assert_eq!(
            (latch.system_id(at(60.1)), latch.rival(at(60.1))),
            (Some(7), None)
        );
    }

    #[test]
    fn nobody_is_not_our_vehicle() {
        for configured in [None, Some(0)] {
            let mut latch = Latch::new(configured);
            latch.hear(0, at(0.0));
            assert_eq!(latch.system_id(at(0.0)), None);
        }
    }

    #[test]
    fn its_link_is_the_first_it_was_heard_on_until_it_is_silent_there() {
        let mut latch = Latch::new(None);
        latch.hear(7, at(0.0));
        assert!(latch.is_heard_on(1, at(0.0)));
        assert!(!latch.is_heard_on(0, at(0.1)), "said twice");
        assert!(latch.is_heard_on(1, at(1.0)) && !latch.is_heard_on(0, at(2.4)));
        assert!(latch.is_heard_on(0, at(2.6)), "its link was silent for 1.6 s");
        assert_eq!(latch.link(), 0);
    }

    #[test]
    fn the_configured_one_is_ours_whoever_else_speaks() {
        let mut latch = Latch::new(Some(9));
        latch.hear(7, at(0.0));
        assert_eq!((latch.system_id(at(0.0)), latch.greeting_id()), (None, 9));
        latch.hear(9, at(0.1));
        latch.hear(7, at(0.2));
        assert_eq!(latch.system_id(at(0.2)), Some(9));
    }
}
