//! An item of a mission that is no waypoint.

use jink_shared_types::frames::{LocalNed, Point};
use mavlink::dialect::MavCmd;

/// An item behind the waypoints.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanItem {
    /// What is done there.
    pub command: MavCmd,
    /// Where, in the frame of the autopilot's local position.
    pub place: Point<LocalNed>,
    /// Its first parameter.
    pub param1: f32,
}

impl PlanItem {
    /// A landing, there.
    pub fn landing(place: Point<LocalNed>) -> Self {
        Self {
            command: MavCmd::MAV_CMD_NAV_LAND,
            place,
            param1: 0.0,
        }
    }
}
