//! What is done when somebody is about to end jink: the vehicle is brought to rest and left to the autopilot.
//!
//! | mode | done |
//! |---|---|
//! | OFFBOARD, GUIDED | nothing is wanted any more, so what is committed is flown to its end, which is at rest in space known to be free; then the autopilot is asked to hold |
//! | any other in which the autopilot follows jink, or its own mission | the autopilot is asked to hold |
//! | the pilot's own | nothing: he flies |

use super::Gateway;
use crate::demand::Demand;
use crate::io::Outputs;
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, STOPPING_TO_END};
use jink_shared_types::vehicle::NavMode;

/// Slower than this (m/s) the vehicle counts as at rest.
const REST_MPS: f64 = 0.3;
/// A way that is committed ends within this time (s); then the autopilot is asked to hold, at rest or not.
const REST_WITHIN_S: f64 = 8.0;
/// The demand is repeated this often (Hz).
const REPEAT_HZ: f64 = 1.0;

/// Somebody has asked for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ControlledStop {
    since: Timestamp,
    repeat: Ticker,
}

impl Gateway {
    /// Somebody is about to end jink.
    pub fn request_stop(&mut self) {
        self.controlled_stop.get_or_insert(ControlledStop {
            since: Timestamp::NEVER,
            repeat: Ticker::new(REPEAT_HZ),
        });
    }

    /// Does what is due of it; `false`: nobody has asked.
    pub(super) fn run_controlled_stop(&mut self, now: Timestamp, outputs: &mut Outputs) -> bool {
        let Some(mut controlled_stop) = self.controlled_stop else {
            return false;
        };
        if !controlled_stop.since.is_set() {
            controlled_stop.since = now;
            outputs.report(EventSample::new(&STOPPING_TO_END, "", [0.0; 2]));
        }
        let mode = self.vehicle.mode();
        let present = self.vehicle.present(now);
        let is_at_rest = present.is_some_and(|present| present.velocity.norm() < REST_MPS);
        let is_due = match mode {
            NavMode::Offboard => is_at_rest || now.seconds_since(controlled_stop.since) > REST_WITHIN_S,
            NavMode::Mission | NavMode::Return => true,
            _ => false,
        };
        let flies = self.was_alive && self.vehicle.is_armed() && self.vehicle.has_taken_off();
        if is_due && flies && controlled_stop.repeat.take(now) {
            self.demand(now, Demand::Hold, outputs);
        }
        self.controlled_stop = Some(controlled_stop);
        true
    }
}
