//! What navigation is made from.

use crate::parameters::Parameters;
use jink_emulated_autopilot::mission::{Mission, MissionFrame};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::Vector3;

/// What the navigator needs in a cycle.
pub struct NavigatorInput<'a> {
    /// Since the last cycle (s).
    pub dt_s: f64,
    /// Mode in force.
    pub mode: NavMode,
    /// Motors armed.
    pub armed: bool,
    /// On the ground.
    pub landed: bool,
    /// Where the vehicle believes to be.
    pub estimate: &'a Estimate,
    /// Home, local NED (m).
    pub home: Vector3<f64>,
    /// Parameters in force.
    pub parameters: &'a Parameters,
    /// The mission.
    pub mission: &'a Mission,
    /// How its items become local.
    pub frame: &'a MissionFrame,
}
