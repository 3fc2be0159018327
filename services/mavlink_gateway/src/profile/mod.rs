//! How setpoints are sent: one trait, chosen by configuration, never mixed within one flight.

pub mod curve;
pub mod lead;
pub mod pilot;
pub mod position_target;
pub mod px4_trajectory;

use pilot::Nearness;
use position_target::PositionTarget;
use px4_trajectory::Px4Trajectory;

use crate::vehicle::Present;
use jink_mavlink_link::clock_map::ClockMap;
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Reading, SampleHeader, Timestamp};
use mavlink::dialect::MavMessage;
use std::fmt;

/// Everything a setpoint may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// Now.
    pub now: Timestamp,
    /// Where the vehicle is; `None` before the first position.
    pub vehicle: Option<Present>,
    /// Its system id.
    pub system_id: u8,
    /// Mode in force.
    pub mode: NavMode,
    /// It has taken off, as the autopilot says.
    pub in_air: bool,
    /// What is sent is flown ([`Profile::listens`]), or is about to be.
    pub is_flown: bool,
    /// With which velocity the autopilot answers each metre beside its setpoint (1/s): `MPC_XY_P`, as it is set on it.
    pub position_gain_per_s: f64,
    /// With which acceleration it answers each m/s of wrong velocity (1/s): `MPC_XY_VEL_P_ACC`, likewise.
    pub velocity_gain_per_s: f64,
    /// A radio carries what is sent: what says nothing new waits for the beat of the stream.
    pub spares_radio: bool,
    /// The autopilot's clock.
    pub clock: &'a ClockMap,
    /// What the autopilot wants, if that was asked for in the mode in force by an autopilot that is alive.
    pub desired: Option<&'a DesiredPath>,
    /// What the guard lets through.
    pub approved: Reading<'a, ApprovedTrajectory>,
}

/// A setpoint ready to be sent.
#[derive(Clone, Debug)]
pub struct Setpoint {
    /// The message.
    pub message: MavMessage,
    /// Of the approved trajectory, if this is the first setpoint cut from it.
    pub first_of: Option<SampleHeader>,
}

/// A way of sending setpoints to an autopilot.
pub trait Profile: fmt::Debug + Send {
    /// Whether the autopilot flies in this mode what it is sent. It may in one that is not known yet, or has no name here.
    fn listens(&self, mode: NavMode) -> bool;

    /// Takes note of the inputs, at every step. Returns `true` if there is a new trajectory that should not wait
    /// for the beat of the stream.
    fn observe(&mut self, situation: &Situation<'_>) -> bool;

    /// Of the trajectory observed last, if the autopilot flies what it says already, so that nothing of it need be sent.
    fn reported(&self) -> Option<SampleHeader> {
        None
    }

    /// The setpoint for now; `None` only while no position was ever known, for a moment after the start in which the
    /// guard's samples may yet arrive, and before the vehicle is in the air if it
    /// [waits for that](Profile::waits_for_air).
    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint>;

    /// Whether nothing is sent before the vehicle is in the air: the first setpoint would break its take-off off.
    fn waits_for_air(&self) -> bool {
        false
    }

    /// How what was sent last lies to the vehicle.
    fn nearness(&self) -> Nearness {
        Nearness::Apart
    }

    /// What must be sent to an autopilot once before the first setpoint.
    fn announcement(&self) -> Option<MavMessage> {
        None
    }

    /// The autopilot has started anew: every coordinate held so far means nothing any more.
    fn reset(&mut self);
}

/// The profile of that name; where it sends curves, these last `horizon_s`, or down to `shortest_s`.
pub fn build(
    profile: ProfileName,
    representation: Representation,
    horizon_s: f64,
    shortest_s: f64,
) -> Box<dyn Profile> {
    match profile {
        ProfileName::Px4Trajectory => Box::new(Px4Trajectory::new(representation, horizon_s, shortest_s)),
        ProfileName::Px4Offboard => Box::new(PositionTarget::px4()),
        ProfileName::Px4Deviation => Box::new(PositionTarget::px4_deviation()),
        ProfileName::ArdupilotGuided => Box::new(PositionTarget::arducopter()),
    }
}
