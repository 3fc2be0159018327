//! Whose firmware it is, and how it numbers its modes.
//!
//! | | HEARTBEAT and DO_SET_MODE | mode that follows setpoints | mode that holds |
//! |---|---|---|---|
//! | PX4 | main mode, sub mode ([`px4_mode`]) | OFFBOARD (6) | AUTO.LOITER (4, 3) |
//! | ArduCopter | one number | GUIDED (4) | BRAKE (17): LOITER would follow the sticks, and sink without a remote control |

use crate::px4_mode;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::MavAutopilot;

/// A make of autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotType {
    /// PX4.
    Px4,
    /// ArduPilot; of its vehicles the Copter.
    ArduPilot,
}

/// ArduCopter's modes that have a name here; every other one is the pilot's.
const COPTER_MODES: [(u32, NavMode); 12] = [
    (3, NavMode::Mission),   // AUTO
    (4, NavMode::Offboard),  // GUIDED
    (5, NavMode::Position),  // LOITER
    (6, NavMode::Return),    // RTL
    (7, NavMode::Orbit),     // CIRCLE
    (9, NavMode::Land),      // LAND
    (16, NavMode::Position), // POSHOLD
    (17, NavMode::Hold),     // BRAKE
    (18, NavMode::Hold),     // THROW
    (21, NavMode::Return),   // SMART_RTL
    (23, NavMode::Follow),   // FOLLOW
    (27, NavMode::Return),   // AUTO_RTL
];
/// BRAKE.
const COPTER_BRAKE: u32 = 17;
/// ArduCopter's modes in which a pilot flies and the height is held: ALT_HOLD, LOITER, POSHOLD.
const COPTER_PILOTS_MODES: [u32; 3] = [2, 5, 16];

impl AutopilotType {
    /// From the heartbeat's field; `None` for makes that are not known here.
    pub fn of(autopilot: MavAutopilot) -> Option<Self> {
        match autopilot {
            MavAutopilot::MAV_AUTOPILOT_PX4 => Some(AutopilotType::Px4),
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Some(AutopilotType::ArduPilot),
            _ => None,
        }
    }

    /// The mode behind its number.
    pub fn nav_mode(self, custom_mode: u32) -> NavMode {
        match self {
            AutopilotType::Px4 => px4_mode::nav_mode(custom_mode),
            AutopilotType::ArduPilot => COPTER_MODES
                .iter()
                .find(|(number, _)| *number == custom_mode)
                .map_or(NavMode::Manual, |(_, mode)| *mode),
        }
    }

    /// Whether a mode without a name here may be one in which trajectories are followed.
    pub fn is_unnamed_auto(self, custom_mode: u32) -> bool {
        self == AutopilotType::Px4 && px4_mode::is_auto(custom_mode)
    }

    /// Whether a pilot flies in this mode and the autopilot holds the height, and in most of them the place.
    pub fn is_pilots_mode(self, custom_mode: u32) -> bool {
        match self {
            // POSCTL, and POSCTL_SLOW; its other sub modes fly by themselves.
            AutopilotType::Px4 => {
                let [_, _, main, sub] = custom_mode.to_le_bytes();
                main == 3 && matches!(sub, 0 | 2)
            }
            AutopilotType::ArduPilot => COPTER_PILOTS_MODES.contains(&custom_mode),
        }
    }

    /// Parameters 2 and 3 of MAV_CMD_DO_SET_MODE for the mode that the autopilot reports under this number.
    pub fn numbers_of(self, custom_mode: u32) -> (u32, u32) {
        match self {
            AutopilotType::Px4 => {
                let [_, _, main, sub] = custom_mode.to_le_bytes();
                (u32::from(main), u32::from(sub))
            }
            AutopilotType::ArduPilot => (custom_mode, 0),
        }
    }

    /// Parameters 2 and 3 of MAV_CMD_DO_SET_MODE for the modes that jink asks for; `None` for others.
    pub fn mode_numbers(self, mode: NavMode) -> Option<(u32, u32)> {
        match (self, mode) {
            (AutopilotType::Px4, NavMode::Offboard) => Some((6, 0)),
            (AutopilotType::Px4, NavMode::Hold) => Some((4, 3)),
            (AutopilotType::Px4, NavMode::Mission) => Some((4, 4)),
            (AutopilotType::Px4, NavMode::Land) => Some((4, 6)),
            (AutopilotType::ArduPilot, NavMode::Offboard) => Some((4, 0)),
            (AutopilotType::ArduPilot, NavMode::Hold) => Some((COPTER_BRAKE, 0)),
            (AutopilotType::ArduPilot, NavMode::Mission) => Some((3, 0)),
            (AutopilotType::ArduPilot, NavMode::Land) => Some((9, 0)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::AutopilotType;
    use jink_shared_types::vehicle::NavMode;

    #[test]
    fn a_mode_that_is_requested_is_the_one_that_is_reported() {
        for mode in [NavMode::Offboard, NavMode::Hold, NavMode::Mission, NavMode::Land] {
            let (main, sub) = AutopilotType::Px4.mode_numbers(mode).unwrap();
            assert_eq!(AutopilotType::Px4.nav_mode(main << 16 | sub << 24), mode);
            let (number, _) = AutopilotType::ArduPilot.mode_numbers(mode).unwrap();
            assert_eq!(AutopilotType::ArduPilot.nav_mode(number), mode);
        }
    }

    #[test]
    fn copter_modes_without_a_name_are_the_pilots() {
        for number in [0, 1, 2, 13, 15, 20, 999] {
            assert_eq!(AutopilotType::ArduPilot.nav_mode(number), NavMode::Manual);
        }
    }
}
