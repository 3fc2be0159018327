//! PX4's modes on the wire: `custom_mode = main << 16 | sub << 24`.

use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::MavModeFlag;

const MAIN_MANUAL: u8 = 1;
const MAIN_POSITION: u8 = 3;
const MAIN_AUTO: u8 = 4;
const MAIN_OFFBOARD: u8 = 6;

/// Main and sub mode of PX4; `None` for a mode it has no number for.
pub fn px4_mode(mode: NavMode) -> Option<(u8, u8)> {
    match mode {
        NavMode::Manual => Some((MAIN_MANUAL, 0)),
        NavMode::Position => Some((MAIN_POSITION, 0)),
        NavMode::Takeoff => Some((MAIN_AUTO, 2)),
        NavMode::Hold => Some((MAIN_AUTO, 3)),
        NavMode::Mission => Some((MAIN_AUTO, 4)),
        NavMode::Return => Some((MAIN_AUTO, 5)),
        NavMode::Land => Some((MAIN_AUTO, 6)),
        NavMode::Offboard => Some((MAIN_OFFBOARD, 0)),
        NavMode::Orbit => Some((MAIN_POSITION, 1)),
        // Not flown by this emulator.
        NavMode::Follow | NavMode::Unknown => None,
    }
}

/// `custom_mode` of HEARTBEAT; 0 for a mode without a number.
pub fn custom_mode(mode: NavMode) -> u32 {
    px4_mode(mode).map_or(0, |(main, sub)| u32::from(main) << 16 | u32::from(sub) << 24)
}

/// The mode of PX4's main and sub mode; `None` for one this emulator does not fly.
pub fn mode_of(main: u8, sub: u8) -> Option<NavMode> {
    use NavMode as M;
    let modes = [
        M::Manual,
        M::Position,
        M::Takeoff,
        M::Hold,
        M::Mission,
        M::Return,
        M::Land,
        M::Offboard,
    ];
    modes
        .into_iter()
        .find(|mode| px4_mode(*mode) == Some((main, sub)))
}

/// The mode in a `custom_mode`.
pub fn mode_of_custom(custom_mode: u32) -> Option<NavMode> {
    let [_, _, main, sub] = custom_mode.to_le_bytes();
    mode_of(main, sub)
}

/// `base_mode` of HEARTBEAT.
pub fn base_mode(mode: NavMode, armed: bool) -> MavModeFlag {
    use MavModeFlag as F;
    let mut flags = F::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    flags |= match mode {
        NavMode::Manual | NavMode::Position | NavMode::Unknown => {
            F::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | F::MAV_MODE_FLAG_STABILIZE_ENABLED
        }
        _ => {
            F::MAV_MODE_FLAG_AUTO_ENABLED
                | F::MAV_MODE_FLAG_STABILIZE_ENABLED
                | F::MAV_MODE_FLAG_GUIDED_ENABLED
        }
    };
    if armed {
        flags |= F::MAV_MODE_FLAG_SAFETY_ARMED;
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_survives_the_wire() {
        assert_eq!(custom_mode(NavMode::Mission), 4 << 16 | 4 << 24);
        assert_eq!(custom_mode(NavMode::Hold), 4 << 16 | 3 << 24);
        for mode in [NavMode::Manual, NavMode::Land, NavMode::Offboard] {
            assert_eq!(mode_of_custom(custom_mode(mode)), Some(mode));
        }
        assert_eq!(mode_of(4, 9), None);
    }
}
