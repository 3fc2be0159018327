//! PX4 in OFFBOARD and ArduCopter in GUIDED: every setpoint is a SET_POSITION_TARGET_LOCAL_NED, fifty times a second. So it is for
//! PX4 in its own mission mode with EAV_EN, but for positions and headings.
//!
//! | field | PX4 | ArduCopter | why |
//! |---|---|---|---|
//! | `coordinate_frame` | LOCAL_NED | LOCAL_NED | the only frame that neither refuses nor anchors anew at every message |
//! | `type_mask` | 0: everything is given | the same | PX4 stops where an axis has nothing; ArduCopter drops a whole group for one ignored axis, and without the acceleration it weaves metres off |
//! | position | of the reference at this moment | the same | sent ahead of time it would be reached ahead of time |
//! | velocity, acceleration | of the reference a little later ([`Lead`]) | of this moment | they are fed forward, and PX4 answers with a delay; ArduCopter was 0.6 m ahead with 0.15 s of lead |
//! | the same two | and towards the reference, as if the gains were higher ([`GAIN_BY_DELAY_RAD`]) | nothing more | PX4 comes with gains for every airframe, and an error lasts for a second; ArduCopter shapes what it is sent, and swung with 1.2 m |
//! | yaw, yaw rate | of the reference at this moment | the same | |
//! | every number | finite | finite | ArduCopter's process aborts at a NaN |
//! | `target_component` | 1 | 1 | PX4 takes its own or 0 only |
//! | in other modes | sent: the mode cannot be entered without | silence, unless the mode is about to be asked for | a setpoint that arrives just after the mode was entered would end the go-to with which a station has entered it |
//! | on the ground and while taking off | sent: the mode cannot be entered without | silence | the first setpoint ends ArduCopter's take-off in GUIDED, wherever it is; it needs no stream to enter the mode |
//!
//! With EAV_EN PX4 stays in its mission, which gives the heading; what is sent replaces velocity and acceleration, and the position is
//! not held any more: all of the gain of position is ours. Where nothing is planned nothing is sent, and PX4 flies on as it would alone half a second later.
//!
//! When the stream stops PX4 flies on the last setpoint for a second, then its fail-safe climbs and comes back; ArduCopter extrapolates
//! the last one for GUID_TIMEOUT: 5 to 20 m of travel. So there is always a setpoint, and without a plan it is a stop of our own.
//! When the stream is back PX4 enters the mode again by itself: a gateway that was just started begins where the vehicle is.

use super::lead::Lead;
use super::pilot::{Nearness, Pilot, Source};
use super::{Profile, Setpoint, Situation};
use jink_mavlink_link::message::COMPONENT_AUTOPILOT;
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA};
use nalgebra::Vector3;

/// A reference that is farther from the vehicle than this is not what the vehicle flies (m): three times the largest
/// error measured in OFFBOARD and GUIDED within the limits that are planned with.
const ASTRAY_M: f64 = 2.0;
/// The reference is where the vehicle is if both are this near (m) ...
const NEAR_M: f64 = 0.5;
/// ... and as fast, within this (m/s).
const AS_FAST_MPS: f64 = 0.7;
/// Gain of velocity that is asked for, times the delay with which the vehicle answers (rad): of a loop's 90 degrees of phase margin that
/// delay takes 24, and as much delay again on the link leaves 42.
const GAIN_BY_DELAY_RAD: f64 = 0.42;
/// An autopilot's gains are raised by this factor at most.
const RAISED_MAX: f64 = 1.6;
/// Highest velocity towards the reference beside which the vehicle is (m/s): from [`ASTRAY_M`] on it is not flown at all.
const BACK_MAX_MPS: f64 = 1.0;
/// Highest acceleration towards the reference's velocity (m/s^2): a tilt of nine degrees.
const PUSH_MAX_MPS2: f64 = 1.5;
/// Length of the pieces that are cut from a plan (s): the longest lead, and a little.
const PIECE_S: f64 = 0.35;

/// Positions and headings are not given: what a PX4 that stays in its own mode takes of a setpoint.
pub(crate) const NO_PLACE_NOR_HEADING: PositionTargetTypemask =
    PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE
        .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_Y_IGNORE)
        .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_Z_IGNORE)
        .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_IGNORE)
        .union(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE);

/// The profile.
#[derive(Debug)]
pub struct PositionTarget {
    pilot: Pilot,
    /// `None`: the autopilot needs none.
    lead: Option<Lead>,
    on_plan: bool,
    /// Nothing is sent before it is in the air.
    waits_for_air: bool,
    /// What is sent is sent in modes as well in which it is not flown.
    shadows: bool,
    /// The autopilot stays in its mission, and takes velocities and accelerations only.
    deviates: bool,
}

impl PositionTarget {
    /// For PX4.
    pub fn px4() -> Self {
        Self {
            pilot: Pilot::new(PIECE_S, PIECE_S).near_the_vehicle(ASTRAY_M),
            lead: Some(Lead::default()),
            on_plan: false,
            waits_for_air: false,
            shadows: true,
            deviates: false,
        }
    }

    /// For PX4 with EAV_EN.
    pub fn px4_deviation() -> Self {
        Self {
            waits_for_air: true,
            shadows: false,
            deviates: true,
            ..Self::px4()
        }
    }

    /// For ArduCopter.
    pub fn arducopter() -> Self {
        Self {
            lead: None,
            waits_for_air: true,
            shadows: false,
            ..Self::px4()
        }
    }
}

impl Profile for PositionTarget {
    fn listens(&self, mode: NavMode) -> bool {
        !self.deviates && matches!(mode, NavMode::Offboard | NavMode::Unknown)
    }

    fn observe(&mut self, situation: &Situation<'_>) -> bool {
        self.pilot.observe(situation)
    }

    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint> {
        let is_wanted = situation.is_flown || self.shadows;
        if !is_wanted || self.waits_for_air() && !situation.in_air {
            self.on_plan = false;
            return None;
        }
        let now = situation.now;
        let vehicle = situation.vehicle?;
        let decision = self.pilot.decide(situation, now)?;
        let curve = &decision.curve;
        let error = curve.position_at(now) - vehicle.position;
        let slip = curve.velocity_at(now) - vehicle.velocity;
        self.on_plan =
            decision.source == Source::Planned && error.norm() <= NEAR_M && slip.norm() <= AS_FAST_MPS;
        let (later, raised) = match &mut self.lead {
            Some(lead) => {
                let follows = match self.deviates {
                    true => NavMode::Mission,
                    false => NavMode::Offboard,
                };
                let lead_s = lead.seconds();
                let asked_rad = lead_s * situation.velocity_gain_per_s;
                let raised = match self.deviates {
                    true => 1.0,
                    false => (GAIN_BY_DELAY_RAD / asked_rad).clamp(1.0, RAISED_MAX),
                };
                if self.on_plan && situation.mode == follows {
                    let gain_per_s = raised * situation.position_gain_per_s;
                    lead.learn(now, error, curve.acceleration_at(now), gain_per_s);
                }
                (now.plus_seconds(lead_s), raised)
            }
            None => (now, 1.0),
        };
        // Of positions PX4 holds nothing with EAV_EN.
        let held = if self.deviates { 0.0 } else { 1.0 };
        let [back, push] = match decision.source {
            Source::Planned => [
                ((raised - held) * situation.position_gain_per_s * error).cap_magnitude(BACK_MAX_MPS),
                ((raised - 1.0) * situation.velocity_gain_per_s * slip).cap_magnitude(PUSH_MAX_MPS2),
            ],
            _ => [Vector3::zeros(); 2],
        };
        let (position, velocity, acceleration) = (
            curve.position_at(now),
            curve.velocity_at(later) + back,
            curve.acceleration_at(later) + push,
        );
        let mut message = SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: (now.ns / 1_000_000) as u32,
            x: position.x as f32,
            y: position.y as f32,
            z: position.z as f32,
            vx: velocity.x as f32,
            vy: velocity.y as f32,
            vz: velocity.z as f32,
            afx: acceleration.x as f32,
            afy: acceleration.y as f32,
            afz: acceleration.z as f32,
            yaw: wrap_pi(curve.yaw_at(now)) as f32,
            yaw_rate: curve.yaw_rate_at(now) as f32,
            type_mask: PositionTargetTypemask::empty(),
            target_system: situation.system_id,
            target_component: COMPONENT_AUTOPILOT,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        };
        if self.deviates {
            [message.x, message.y, message.z] = [0.0; 3];
            [message.yaw, message.yaw_rate] = [0.0; 2];
            message.type_mask = NO_PLACE_NOR_HEADING;
        }
        Some(Setpoint {
            message: MavMessage::SET_POSITION_TARGET_LOCAL_NED(message),
            first_of: decision.first_of,
        })
    }

    fn waits_for_air(&self) -> bool {
        self.waits_for_air
    }

    fn nearness(&self) -> Nearness {
        if self.pilot.is_astray() {
            Nearness::Astray
        } else if self.on_plan {
            Nearness::OnPlan
        } else {
            Nearness::Apart
        }
    }

    fn reset(&mut self) {
        self.pilot.reset();
        self.on_plan = false;
    }
}
