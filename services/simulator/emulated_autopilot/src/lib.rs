//! What emulated autopilots have in common: what flies the vehicle, whichever autopilot it is.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`link`] | messages to send | [`Packet`]s on two links, numbered and addressed |
//! | [`messages`] | time, estimate, mission frame | the messages that all of them say alike |
//! | [`modes`] | a mode | its numbers on the wire, for each make |
//! | [`mission`], [`mission_protocol`] | items uploaded | the mission, and what each item asks for |
//! | [`parameters`](mod@parameters) | names, kinds, defaults | the table of parameters, and the protocol that reads and sets them |
//! | [`command_place`] | a command | where it leads |
//! | [`land_detector`], [`attitude`] | contact and thrust | landed or not, the attitude that gives a thrust |
//! | [`statistics`], [`truth`] | setpoints, autopilot, world | ground truth of the flight |
//! | [`reference`](mod@reference) | | the motions on which tracking is measured |
//! | [`script`] | what a test asks | messages to an autopilot, and what it answered |
//!
//! Processes, lock-step flights and the [`Observer`](truth::Observer) use an [`Autopilot`] and need not know the make.

pub mod attitude;
pub mod command_place;
pub mod land_detector;
pub mod link;
pub mod messages;
pub mod mission;
pub mod mission_protocol;
pub mod modes;
pub mod parameters;
pub mod reference;
pub mod script;
pub mod statistics;
pub mod truth;

pub use link::{Link, Packet};
pub use statistics::SetpointStatistics;

use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::VehicleTruth;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::Vector3;

/// How far a mission has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MissionProgress {
    /// Item being flown.
    pub current: u16,
    /// Items.
    pub total: u16,
    /// The last one is done.
    pub done: bool,
}

/// A parameter the emulator does not have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownParameter {
    /// The name that was asked for.
    pub name: String,
}

impl std::fmt::Display for UnknownParameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the autopilot has no parameter {}", self.name)
    }
}
impl std::error::Error for UnknownParameter {}

/// The end of the autopilot's process: a number that is none in a setpoint that counts. From then on it sends nothing and
/// the motors are off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Abort {
    /// When, boot time (s).
    pub time_s: f64,
    /// Which group of the setpoint: position, acceleration or yaw.
    pub group: &'static str,
}

/// An autopilot with the vehicle it flies.
pub trait Autopilot {
    /// 4 ms: takes `inbox`, flies, and appends what it has to say to `outbox`.
    fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>);

    /// Time since boot (s).
    fn time_s(&self) -> f64;

    /// Where the vehicle really is.
    fn truth(&self) -> &VehicleTruth;

    /// Where it believes to be.
    fn estimate(&self) -> &Estimate;

    /// Mode in force.
    fn mode(&self) -> NavMode;

    /// Motors armed.
    fn is_armed(&self) -> bool;

    /// On the ground, as the land detector says.
    fn is_landed(&self) -> bool;

    /// How far the mission has come.
    fn mission(&self) -> MissionProgress;

    /// What arrived from the companion.
    fn setpoint_statistics(&self) -> &SetpointStatistics;

    /// Lets the estimated position jump by `by` (m, local NED), as a reset of the estimator does.
    fn jump_estimate(&mut self, by: Vector3<f64>);

    /// How often it fell to Hold because its companion failed it: only PX4 does.
    fn hold_count(&self) -> u32 {
        0
    }

    /// What ended the autopilot's process, if something did.
    fn aborted(&self) -> Option<Abort> {
        None
    }
}
