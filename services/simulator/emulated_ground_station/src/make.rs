//! What depends on whose firmware it is.
//!
//! | | PX4 | ArduCopter |
//! |---|---|---|
//! | a mode | main mode, sub mode | one number |
//! | what it sends unasked | everything | heartbeats: positions are asked for |
//! | item 0 of a mission | its first item | home |
//! | armed in | Hold | GUIDED |
//! | takes off | in a mode of its own, to MIS_TAKEOFF_ALT | with the first item of the mission, once it is started |

use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_emulated_autopilot::modes::px4::{custom_mode, mode_of_custom};
use jink_shared_types::vehicle::NavMode;
use mavlink::MessageData;
use mavlink::dialect::{
    COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd, MavMessage,
    MavModeFlag,
};

/// A make of autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Make {
    /// PX4.
    #[default]
    Px4,
    /// ArduPilot; of its vehicles the Copter.
    ArduCopter,
}

/// Positions that are asked for: message type and interval (us).
const WANTED: [(u32, u32); 2] = [
    (LOCAL_POSITION_NED_DATA::ID, 100_000),
    (GLOBAL_POSITION_INT_DATA::ID, 200_000),
];

impl Make {
    /// From a heartbeat's field.
    pub(super) fn of(autopilot: MavAutopilot) -> Self {
        match autopilot {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Make::ArduCopter,
            _ => Make::Px4,
        }
    }

    /// The mode behind its number.
    pub fn mode(self, custom: u32) -> NavMode {
        let mode = match self {
            Make::Px4 => mode_of_custom(custom),
            Make::ArduCopter => Mode::of_custom(custom).map(Mode::nav),
        };
        mode.unwrap_or(NavMode::Unknown)
    }

    /// The mode in which motors are armed.
    pub(super) fn arming_mode(self) -> NavMode {
        match self {
            Make::Px4 => NavMode::Hold,
            Make::ArduCopter => NavMode::Offboard,
        }
    }

    /// The command that sets `mode` of the autopilot with the system id `target`; `None` if it has none like it.
    pub fn mode_command(self, mode: NavMode, target: u8) -> Option<MavMessage> {
        let [main, sub] = match self {
            Make::Px4 => {
                let [_, _, main, sub] = custom_mode(mode).to_le_bytes();
                [f32::from(main), f32::from(sub)]
            }
            Make::ArduCopter => {
                let mode = Mode::ALL.into_iter().find(|known| known.nav() == mode)?;
                [mode.custom() as f32, 0.0]
            }
        };
        let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
        let params = [f32::from(custom), main, sub];
        Some(command(MavCmd::MAV_CMD_DO_SET_MODE, params, target))
    }

    /// What must be asked for to learn where the vehicle is.
    pub(super) fn requests(self, target: u8) -> impl Iterator<Item = MavMessage> {
        let wanted = match self {
            Make::Px4 => &WANTED[..0],
            Make::ArduCopter => &WANTED[..],
        };
        wanted.iter().map(move |(id, interval_us)| {
            let params = [*id as f32, *interval_us as f32, 0.0];
            command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, params, target)
        })
    }

    /// Whether the mission itself takes off, behind an item that is home.
    pub(super) fn takes_off_with_the_mission(self) -> bool {
        self == Make::ArduCopter
    }
}

/// A command with up to three parameters.
pub(super) fn command(command: MavCmd, [param1, param2, param3]: [f32; 3], target: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: target,
        target_component: 1,
        command,
        param1,
        param2,
        param3,
        ..COMMAND_LONG_DATA::default()
    })
}

#[cfg(test)]
mod tests {
    use super::Make;
    use jink_shared_types::vehicle::NavMode;
    use mavlink::dialect::MavMessage;

    #[test]
    fn the_mode_that_is_asked_for_is_the_one_that_is_received() {
        for make in [Make::Px4, Make::ArduCopter] {
            for mode in [
                NavMode::Mission,
                NavMode::Offboard,
                NavMode::Land,
                NavMode::Return,
                NavMode::Hold,
            ] {
                let Some(MavMessage::COMMAND_LONG(command)) = make.mode_command(mode, 1) else {
                    panic!("{make:?} has no {mode:?}");
                };
                let (main, sub) = (command.param2 as u32, command.param3 as u32);
                let custom = match make {
                    Make::Px4 => main << 16 | sub << 24,
                    Make::ArduCopter => main,
                };
                assert_eq!(make.mode(custom), mode);
            }
        }
        assert_eq!(Make::ArduCopter.mode_command(NavMode::Takeoff, 1), None);
    }
}
