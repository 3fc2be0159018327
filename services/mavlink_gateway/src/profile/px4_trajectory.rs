//! PX4 1.11 to 1.15: every setpoint is a TRAJECTORY_REPRESENTATION_BEZIER.
//!
//! | field | value | why |
//! |---|---|---|
//! | `time_usec` | board clock, 10 ms ago | the clock in which TIMESYNC is answered; a start in the autopilot's future is refused, so the error of the synchronisation is given away |
//! | `valid_points` | 5 | a quartic; no field is left unused |
//! | `pos_*`, `pos_yaw` | control points, always finite | a NaN would be evaluated to NaN and flown |
//! | `delta` | duration in the last point, 0 in the others | PX4 reads only the last; NaN there would mean "without velocity" |
//!
//! TRAJECTORY_REPRESENTATION_WAYPOINTS is never sent, not even to mirror one back: a valid waypoint takes precedence
//! over every later curve, however old it is.

use super::curve::{CONTROL_POINTS, Curve};
use super::pilot::Pilot;
use super::{Profile, Setpoint, Situation};
use jink_shared_types::Timestamp;
use mavlink::dialects::ardupilotmega::MavMessage;
#[allow(deprecated)] // Gone from PX4 1.16 on; this profile is for the versions before.
use mavlink::dialects::ardupilotmega::TRAJECTORY_REPRESENTATION_BEZIER_DATA;

/// How far in the past curves start (s): more than the error of a converged time synchronisation, which is below
/// half of a round trip of at most 10 ms.
const BACK_DATING_S: f64 = 0.010;

/// The profile.
#[derive(Debug)]
pub struct Px4Trajectory {
    pilot: Pilot,
}

impl Px4Trajectory {
    /// Curves last `horizon_s`, or down to `shortest_s` where the plan is too lively for a quartic.
    pub fn new(horizon_s: f64, shortest_s: f64) -> Self {
        Self {
            pilot: Pilot::new(horizon_s, shortest_s),
        }
    }
}

impl Profile for Px4Trajectory {
    fn observe(&mut self, situation: &Situation<'_>) -> bool {
        self.pilot.observe(situation)
    }

    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint> {
        let start = back_dated(situation.now);
        let decision = self.pilot.decide(situation, start)?;
        Some(Setpoint {
            message: message(&decision.curve),
            source: decision.source,
            first_of: decision.first_of,
        })
    }

    fn reset(&mut self) {
        self.pilot.reset();
    }
}

/// The start of a curve that is sent at `now`: a whole microsecond, because that is what the message can say.
fn back_dated(now: Timestamp) -> Timestamp {
    Timestamp::from_ns(now.plus_seconds(-BACK_DATING_S).ns / 1000 * 1000)
}

#[allow(deprecated)]
fn message(curve: &Curve) -> MavMessage {
    let mut delta = [0.0; CONTROL_POINTS];
    delta[CONTROL_POINTS - 1] = curve.duration_s as f32;
    MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
        time_usec: curve.start.ns / 1000,
        pos_x: curve.position.map(|p| p.x as f32),
        pos_y: curve.position.map(|p| p.y as f32),
        pos_z: curve.position.map(|p| p.z as f32),
        delta,
        pos_yaw: curve.yaw_rad.map(|yaw| yaw as f32),
        valid_points: CONTROL_POINTS as u8,
    })
}
