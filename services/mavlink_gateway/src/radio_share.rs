//! What of jink's stream goes out over a ground station's radio, and how it is kept small.
//!
//! An autopilot that passes messages on does so in both directions: a ground station that is seen on the autopilot's
//! link has a radio that carries what jink says to nobody in particular. Setpoints to OFFBOARD and GUIDED have an addressee and stay off it; curves have
//! none. So while such a station is there
//!
//! | stream | instead of | is |
//! |---|---|---|
//! | curves that say what is flown already | twenty a second | repeated 10.8 times a second |
//! | curves that say something new | at once | at once |
//! | TIMESYNC answers | every one | one a second |
//! | OBSTACLE_DISTANCE that no collision prevention of the autopilot reads | five a second | not sent, unless somebody asks for it |
//!
//! which is below 1.5 kB/s together. A curve lasts 0.8 s, and PX4 gives up after 0.5 s without any.

use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use mavlink::dialect::{HEARTBEAT_DATA, MavType};

/// Repetitions of what is flown already (Hz): 1.3 kB/s, and less than 100 ms between two curves.
pub const REPEATED_HZ: f64 = 10.8;
/// TIMESYNC answers (Hz): as often as jink itself asks once it knows the clock.
const ANSWERED_HZ: f64 = 1.0;
/// A ground station that is silent for so long is gone (s): ten of its heartbeats.
const GONE_AFTER_S: f64 = 10.0;

/// Whether a radio carries what jink says.
#[derive(Debug)]
pub struct RadioShare {
    station: Timestamp,
    answers: Ticker,
}

impl Default for RadioShare {
    fn default() -> Self {
        Self {
            station: Timestamp::NEVER,
            answers: Ticker::new(ANSWERED_HZ),
        }
    }
}

impl RadioShare {
    /// A heartbeat on the autopilot's link that is not the autopilot's.
    pub fn observe(&mut self, time: Timestamp, heartbeat: &HEARTBEAT_DATA) {
        if heartbeat.mavtype == MavType::MAV_TYPE_GCS {
            self.station = self.station.max(time);
        }
    }

    /// Whether a ground station stands behind the autopilot.
    pub fn is_carried(&self, now: Timestamp) -> bool {
        self.station.is_set() && now.seconds_since(self.station) < GONE_AFTER_S
    }

    /// Whether a question for the time is answered; all are where nobody pays for the answer.
    pub fn answers(&mut self, now: Timestamp, spares: bool) -> bool {
        !spares || self.answers.take(now)
    }
}
