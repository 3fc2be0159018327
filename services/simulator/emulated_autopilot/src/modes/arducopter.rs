//! ArduCopter's flight modes and their numbers on the wire.

use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::MavModeFlag;

/// A flight mode; the number is `custom_mode` of HEARTBEAT.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Mode {
    /// Sticks set attitude and thrust.
    #[default]
    Stabilize = 0,
    /// Sticks set attitude and climb.
    AltHold = 2,
    /// The mission.
    Auto = 3,
    /// External setpoints.
    Guided = 4,
    /// Sticks set a velocity; the position is held.
    Loiter = 5,
    /// Home and down.
    Rtl = 6,
    /// Down here.
    Land = 9,
    /// Stop, and stay whatever the sticks say.
    Brake = 17,
}

impl Mode {
    /// All of them.
    pub const ALL: [Mode; 8] = [
        Mode::Stabilize,
        Mode::AltHold,
        Mode::Auto,
        Mode::Guided,
        Mode::Loiter,
        Mode::Rtl,
        Mode::Land,
        Mode::Brake,
    ];

    /// The mode with the number `custom_mode`; `None` for one this emulator does not fly.
    pub fn of_custom(custom_mode: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.custom() == custom_mode)
    }

    /// `custom_mode` of HEARTBEAT.
    pub fn custom(self) -> u32 {
        self as u32
    }

    /// What that is independent of the make.
    pub fn nav(self) -> NavMode {
        match self {
            Mode::Stabilize | Mode::AltHold => NavMode::Manual,
            Mode::Auto => NavMode::Mission,
            Mode::Guided => NavMode::Offboard,
            Mode::Loiter => NavMode::Position,
            Mode::Rtl => NavMode::Return,
            Mode::Land => NavMode::Land,
            Mode::Brake => NavMode::Hold,
        }
    }

    /// ArduCopter's name, as in its texts.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Stabilize => "STABILIZE",
            Mode::AltHold => "ALT_HOLD",
            Mode::Auto => "AUTO",
            Mode::Guided => "GUIDED",
            Mode::Loiter => "LOITER",
            Mode::Rtl => "RTL",
            Mode::Land => "LAND",
            Mode::Brake => "BRAKE",
        }
    }

    /// Whether it can only be entered with a position.
    pub fn needs_position(self) -> bool {
        !matches!(self, Mode::Stabilize | Mode::AltHold | Mode::Land)
    }

    /// Whether motors may be armed in it.
    pub fn allows_arming(self) -> bool {
        matches!(
            self,
            Mode::Stabilize | Mode::AltHold | Mode::Guided | Mode::Loiter
        )
    }

    /// Whether a pilot holds the sticks, so that a lost ground station changes nothing (FS_OPTIONS, default 16).
    pub fn is_piloted(self) -> bool {
        matches!(self, Mode::Stabilize | Mode::AltHold | Mode::Loiter)
    }
}

/// `base_mode` of HEARTBEAT.
pub fn base_mode(mode: Mode, armed: bool) -> MavModeFlag {
    use MavModeFlag as F;
    let mut flags = F::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        | F::MAV_MODE_FLAG_STABILIZE_ENABLED
        | F::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED;
    if matches!(
        mode,
        Mode::Auto | Mode::Guided | Mode::Loiter | Mode::Rtl | Mode::Brake
    ) {
        flags |= F::MAV_MODE_FLAG_GUIDED_ENABLED;
    }
    if armed {
        flags |= F::MAV_MODE_FLAG_SAFETY_ARMED;
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_arducopter_and_survive_the_wire() {
        let numbers: Vec<u32> = Mode::ALL.iter().map(|mode| mode.custom()).collect();
        assert_eq!(numbers, [0, 2, 3, 4, 5, 6, 9, 17]);
        for mode in Mode::ALL {
            assert_eq!(Mode::of_custom(mode.custom()), Some(mode));
        }
        assert_eq!(Mode::of_custom(21), None);
        assert_eq!(Mode::Guided.nav(), NavMode::Offboard);
    }
}
