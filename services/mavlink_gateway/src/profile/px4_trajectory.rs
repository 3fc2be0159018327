//! PX4 1.11 to 1.15: every setpoint is a TRAJECTORY_REPRESENTATION_BEZIER, or every one a TRAJECTORY_REPRESENTATION_WAYPOINTS.
//!
//! | field of BEZIER | value | why |
//! |---|---|---|
//! | `time_usec` | autopilot's clock, 10 ms ago, and not ahead of its newest stamp and the time since | the clock in which TIMESYNC is answered; a start in the autopilot's future is refused, so the error of the synchronisation is given away |
//! | `valid_points` | 5 | a quartic; no field is left unused |
//! | `pos_*`, `pos_yaw` | control points, always finite | a NaN would be evaluated to NaN and flown |
//! | `delta` | duration in the last point, 0 in the others | PX4 reads only the last; NaN there would mean "without velocity" |
//!
//! | field of WAYPOINTS | value | why |
//! |---|---|---|
//! | `time_usec` | board clock | PX4 does not read it |
//! | `valid_points` | 1 | PX4 reads only point 0, and writes past its memory if more than 5 are sent |
//! | point 0 | position, velocity, heading and its rate at this moment; acceleration NaN | the velocity is added ahead of PX4's own smoothing; acceleration is not read |
//! | point 0, mirrored | the autopilot's own, bit by bit | an axis for which it gives neither position nor velocity stays where it is: all NaN would be accepted, and the vehicle drift |
//! | points 1 to 4, `command` | NaN, 65535 | unused |
//!
//! The two are never mixed: a valid waypoint takes precedence over every later curve, however old it is. A companion that
//! spoke in waypoints before may have left one, so curves are preceded by one WAYPOINTS message without a valid point.

use super::curve::{CONTROL_POINTS, Curve};
use super::pilot::{Decision, Pilot, Source};
use super::{Profile, Representation, Setpoint, Situation};
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::vehicle::{COMMAND_NONE, DesiredPoint, NavMode};
use jink_shared_types::{SampleHeader, Timestamp};
use mavlink::dialect::MavMessage;
#[allow(deprecated)] // Gone from PX4 1.16 on; this profile is for the versions before.
use mavlink::dialect::{TRAJECTORY_REPRESENTATION_BEZIER_DATA, TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA};

/// How far in the past curves start (s): more than the error of a converged time synchronisation, which is below
/// half of a round trip of at most 10 ms.
const BACK_DATING_S: f64 = 0.010;

/// The profile.
#[derive(Debug)]
pub struct Px4Trajectory {
    representation: Representation,
    pilot: Pilot,
    /// The trajectory observed last, if the autopilot flies what it says already.
    reported: Option<SampleHeader>,
}

impl Px4Trajectory {
    /// Curves last `horizon_s`, or down to `shortest_s` where the plan is too lively for a quartic.
    pub fn new(representation: Representation, horizon_s: f64, shortest_s: f64) -> Self {
        Self {
            representation,
            reported: None,
            pilot: Pilot::new(horizon_s, shortest_s),
        }
    }

    fn curve(&mut self, situation: &Situation<'_>) -> Option<(MavMessage, Decision)> {
        let start = situation.now.plus_seconds(-BACK_DATING_S);
        let start_ns = situation.clock.to_autopilot_ns(situation.now, start)?;
        let decision = self.pilot.decide(situation, start)?;
        Some((curve_message(&decision.curve, start_ns / 1000), decision))
    }

    fn waypoint(&mut self, situation: &Situation<'_>) -> Option<(MavMessage, Decision)> {
        let now = situation.now;
        let decision = self.pilot.decide(situation, now)?;
        let own = Point0::on(&decision.curve, now);
        let point = match (decision.source, situation.desired) {
            (Source::Mirror, Some(path)) => Point0::mirrored(&path.points[0], own),
            _ => own,
        };
        Some((waypoint_message(now, Some(&point)), decision))
    }
}

impl Profile for Px4Trajectory {
    fn listens(&self, mode: NavMode) -> bool {
        mode.is_automatic() || matches!(mode, NavMode::Follow | NavMode::Unknown)
    }

    fn observe(&mut self, situation: &Situation<'_>) -> bool {
        let is_new = self.pilot.observe(situation);
        self.reported = (is_new && situation.spares_radio)
            .then(|| self.pilot.reported(situation.now))
            .flatten();
        is_new && self.reported.is_none()
    }

    fn reported(&self) -> Option<SampleHeader> {
        self.reported
    }

    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint> {
        let (message, decision) = match self.representation {
            Representation::Bezier => self.curve(situation),
            Representation::Waypoints => self.waypoint(situation),
        }?;
        Some(Setpoint {
            message,
            first_of: decision.first_of,
        })
    }

    fn announcement(&self) -> Option<MavMessage> {
        let curves = self.representation == Representation::Bezier;
        curves.then(|| waypoint_message(Timestamp::NEVER, None))
    }

    fn reset(&mut self) {
        self.pilot.reset();
    }
}

/// A curve that starts when the autopilot's clock shows `time_usec`.
#[allow(deprecated)]
fn curve_message(curve: &Curve, time_usec: u64) -> MavMessage {
    let mut delta = [0.0; CONTROL_POINTS];
    delta[CONTROL_POINTS - 1] = curve.duration_s as f32;
    MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
        time_usec,
        pos_x: curve.position.map(|p| p.x as f32),
        pos_y: curve.position.map(|p| p.y as f32),
        pos_z: curve.position.map(|p| p.z as f32),
        delta,
        pos_yaw: curve.yaw_rad.map(|yaw| yaw as f32),
        valid_points: CONTROL_POINTS as u8,
    })
}

/// The point of a WAYPOINTS message that counts. NaN: not given.
struct Point0 {
    /// Local frame (m).
    position: [f32; 3],
    /// Local frame (m/s).
    velocity: [f32; 3],
    yaw_rad: f32,
    yaw_rate_radps: f32,
}

impl Point0 {
    fn on(curve: &Curve, time: Timestamp) -> Self {
        let (position, velocity) = (curve.position_at(time), curve.velocity_at(time));
        Self {
            position: [position.x as f32, position.y as f32, position.z as f32],
            velocity: [velocity.x as f32, velocity.y as f32, velocity.z as f32],
            yaw_rad: wrap_pi(curve.yaw_at(time)) as f32,
            yaw_rate_radps: curve.yaw_rate_at(time) as f32,
        }
    }

    /// What the autopilot asked for; an axis without position and velocity stays where `own` has it.
    fn mirrored(asked: &DesiredPoint, own: Self) -> Self {
        let (position, velocity) = (asked.position, asked.velocity);
        let mut mirrored = Self {
            position: [position.x_m as f32, position.y_m as f32, position.z_m as f32],
            velocity: [
                velocity.x_mps as f32,
                velocity.y_mps as f32,
                velocity.z_mps as f32,
            ],
            yaw_rad: asked.yaw_rad,
            yaw_rate_radps: asked.yaw_rate_radps,
        };
        for axis in 0..3 {
            if !mirrored.position[axis].is_finite() && !mirrored.velocity[axis].is_finite() {
                mirrored.position[axis] = own.position[axis];
            }
        }
        mirrored
    }
}

/// With `point` as its only valid one, or with none.
#[allow(deprecated)]
fn waypoint_message(now: Timestamp, point: Option<&Point0>) -> MavMessage {
    const UNUSED: [f32; 5] = [f32::NAN; 5];
    let mut message = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
        time_usec: now.ns / 1000,
        pos_x: UNUSED,
        pos_y: UNUSED,
        pos_z: UNUSED,
        vel_x: UNUSED,
        vel_y: UNUSED,
        vel_z: UNUSED,
        acc_x: UNUSED,
        acc_y: UNUSED,
        acc_z: UNUSED,
        pos_yaw: UNUSED,
        vel_yaw: UNUSED,
        command: [COMMAND_NONE; 5],
        valid_points: 0,
    };
    if let Some(point) = point {
        [message.pos_x[0], message.pos_y[0], message.pos_z[0]] = point.position;
        [message.vel_x[0], message.vel_y[0], message.vel_z[0]] = point.velocity;
        message.pos_yaw[0] = point.yaw_rad;
        message.vel_yaw[0] = point.yaw_rate_radps;
        message.valid_points = 1;
    }
    MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(message)
}
