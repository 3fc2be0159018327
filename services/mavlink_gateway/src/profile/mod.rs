//! How setpoints are spoken: one trait, chosen by configuration, never mixed within one flight.

pub mod curve;
pub mod pilot;
pub mod px4_trajectory;

use pilot::Source;
use px4_trajectory::Px4Trajectory;

use crate::vehicle::Present;
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Reading, SampleHeader, Timestamp};
use mavlink::dialects::ardupilotmega::MavMessage;
use std::fmt;
use std::str::FromStr;

/// Everything a setpoint may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// Now.
    pub now: Timestamp,
    /// Where the vehicle is; `None` before the first position.
    pub vehicle: Option<Present>,
    /// Mode in force.
    pub mode: NavMode,
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
    /// What it was made from.
    pub source: Source,
    /// Of the approved trajectory, if this is the first setpoint cut from it.
    pub first_of: Option<SampleHeader>,
}

/// A way of speaking to an autopilot.
pub trait Profile: fmt::Debug + Send {
    /// Takes note of the inputs, at every step. Returns `true` if there is a new trajectory that should not wait
    /// for the beat of the stream.
    fn observe(&mut self, situation: &Situation<'_>) -> bool;

    /// The setpoint for now; `None` only while no position was ever known, and for a moment after the start in which the
    /// guard may yet be heard.
    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint>;

    /// The autopilot has started anew: every coordinate held so far means nothing any more.
    fn reset(&mut self);
}

/// The profiles there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileName {
    /// PX4 1.11 to 1.15 with `COM_OBS_AVOID=1`: TRAJECTORY_REPRESENTATION_BEZIER.
    Px4Trajectory,
}

/// Every profile with its name in the configuration.
const NAMES: [(&str, ProfileName); 1] = [("px4_trajectory", ProfileName::Px4Trajectory)];

/// A profile name that does not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownProfile {
    /// What was asked for.
    pub name: String,
}

impl fmt::Display for UnknownProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown profile {}; there are:", self.name)?;
        NAMES.iter().try_for_each(|(name, _)| write!(f, " {name}"))
    }
}
impl std::error::Error for UnknownProfile {}

impl FromStr for ProfileName {
    type Err = UnknownProfile;
    fn from_str(text: &str) -> Result<Self, UnknownProfile> {
        NAMES
            .iter()
            .find(|(name, _)| *name == text)
            .map(|(_, profile)| *profile)
            .ok_or(UnknownProfile {
                name: text.to_owned(),
            })
    }
}

impl ProfileName {
    /// The profile, with curves that last `horizon_s`.
    pub fn build(self, horizon_s: f64, shortest_s: f64) -> Box<dyn Profile> {
        match self {
            ProfileName::Px4Trajectory => Box::new(Px4Trajectory::new(horizon_s, shortest_s)),
        }
    }
}
