//! Where a command leads: COMMAND_LONG gives a place in floats, to half a metre, COMMAND_INT in 1e-7 degrees.

use super::mission::MissionFrame;
use jink_shared_types::geo::GlobalPoint;
use mavlink::dialect::{COMMAND_INT_DATA, COMMAND_LONG_DATA, MavFrame, MavMessage};
use nalgebra::Vector2;

/// The place that a command names; what it does not name is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CommandPlace {
    /// On the globe.
    level: Option<GlobalPoint>,
    /// Height (m).
    height_m: Option<f64>,
    /// The height is above home; otherwise above the sea.
    is_relative: bool,
}

impl CommandPlace {
    /// `param5`, `param6`, `param7`; NaN = not given.
    fn of_long(command: &COMMAND_LONG_DATA) -> Self {
        let given = command.param5.is_finite() && command.param6.is_finite();
        Self {
            level: given.then(|| GlobalPoint {
                latitude_deg: f64::from(command.param5),
                longitude_deg: f64::from(command.param6),
            }),
            height_m: command.param7.is_finite().then(|| f64::from(command.param7)),
            is_relative: false,
        }
    }

    /// `x`, `y`, `z`; the largest integer in both = not given.
    fn of_int(command: &COMMAND_INT_DATA) -> Self {
        let given = (command.x, command.y) != (i32::MAX, i32::MAX);
        // Ground stations still use the older names of the global frames.
        #[allow(deprecated)]
        let is_relative = matches!(
            command.frame,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        );
        Self {
            level: given.then(|| GlobalPoint::from_e7(command.x, command.y)),
            height_m: command.z.is_finite().then(|| f64::from(command.z)),
            is_relative,
        }
    }

    /// North and east (m).
    pub fn level(&self, frame: &MissionFrame) -> Option<Vector2<f64>> {
        self.level.map(|point| frame.projection.to_local(point))
    }

    /// Down coordinate (m).
    pub fn down_m(&self, frame: &MissionFrame) -> Option<f64> {
        let above_m = if self.is_relative {
            frame.home_down_m
        } else {
            frame.origin_altitude_m
        };
        self.height_m.map(|height_m| above_m - height_m)
    }

    /// The same with its height above the sea, whatever the frame says: PX4 does not look at it.
    pub fn above_the_sea(self) -> Self {
        Self {
            is_relative: false,
            ..self
        }
    }
}

/// The command in `message`, if that is one, as COMMAND_LONG carries it, and where it leads.
pub fn command_of(message: &MavMessage) -> Option<(COMMAND_LONG_DATA, CommandPlace)> {
    match message {
        MavMessage::COMMAND_LONG(command) => Some((command.clone(), CommandPlace::of_long(command))),
        MavMessage::COMMAND_INT(command) => Some((long_of(command), CommandPlace::of_int(command))),
        _ => None,
    }
}

/// The command as COMMAND_LONG carries it, its place to the precision of that.
fn long_of(command: &COMMAND_INT_DATA) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        param1: command.param1,
        param2: command.param2,
        param3: command.param3,
        param4: command.param4,
        param5: (f64::from(command.x) * 1e-7) as f32,
        param6: (f64::from(command.y) * 1e-7) as f32,
        param7: command.z,
        command: command.command,
        target_system: command.target_system,
        target_component: command.target_component,
        confirmation: 0,
    }
}
