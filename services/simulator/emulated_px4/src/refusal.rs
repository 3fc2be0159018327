//! Why a demand was refused, in PX4's words.

use super::firmware::Firmware;

/// What current PX4 says whenever a check before arming fails.
const HEALTH_FAILURE: &str = "Arming denied: Resolve system health failures first";

/// Why a demand was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// COM_OBS_AVOID without a healthy companion.
    AvoidanceNotReady,
    /// The estimator has no position yet.
    NoPosition,
    /// No mission to fly.
    NoMission,
    /// OFFBOARD without a stream of setpoints.
    NoOffboardSignal,
    /// Disarming in the air.
    NotLanded,
    /// A mode that sticks must fly, without sticks, in the air.
    NoSticks,
    /// Arming in a mode that cannot be flown now.
    UnhealthyToArm,
}

impl Refusal {
    /// What `firmware` says.
    pub fn text(self, firmware: Firmware) -> &'static str {
        match (self, firmware) {
            (Refusal::NoOffboardSignal, Firmware::Current) => {
                "Switching to Offboard is currently not available"
            }
            (Refusal::NoMission, Firmware::Current) => "Switching to Mission is currently not available",
            (Refusal::NoSticks, Firmware::Current) => "Switching to Position is currently not available",
            (Refusal::AvoidanceNotReady, _) => "Arming denied! Avoidance system not ready",
            (Refusal::NoPosition, _) => "Preflight Fail: ekf2 missing data",
            (Refusal::NoMission, _) => "No valid mission available, refusing",
            (Refusal::NoOffboardSignal, _) => "Rejecting mode switch: no offboard signal",
            (Refusal::NotLanded, _) => "Disarming denied! Not landed",
            (Refusal::NoSticks, _) => "Rejecting mode switch: no manual control",
            (Refusal::UnhealthyToArm, _) => HEALTH_FAILURE,
        }
    }
}
