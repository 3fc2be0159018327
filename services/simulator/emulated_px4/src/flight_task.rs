//! Which flight task flies a mode, and how often one is run.

use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::STEP_S;

/// Steps per control cycle: PX4's estimator hands out positions at about this rate, and everything hangs on them.
pub const CONTROL_STEPS: u64 = 2;
/// Duration of a control cycle (s).
pub const CYCLE_S: f64 = STEP_S * CONTROL_STEPS as f64;

/// Which flight task flies a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightTask {
    /// No setpoints: motors idle.
    None,
    /// Sticks.
    Position,
    /// Waypoints.
    Auto,
    /// External setpoints.
    Offboard,
    /// A circle.
    Orbit,
}

impl FlightTask {
    /// The one that flies `mode`.
    pub fn of(mode: NavMode) -> Self {
        match mode {
            NavMode::Manual | NavMode::Unknown => FlightTask::None,
            NavMode::Position => FlightTask::Position,
            NavMode::Offboard => FlightTask::Offboard,
            NavMode::Orbit => FlightTask::Orbit,
            _ => FlightTask::Auto,
        }
    }
}
