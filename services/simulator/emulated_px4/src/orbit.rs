//! PX4's orbit, MAV_CMD_DO_ORBIT: straight to the circle, then around it, whatever stands there.

use super::setpoint::MotionSetpoint;
use jink_emulated_autopilot::command_place::CommandPlace;
use jink_emulated_autopilot::mission::MissionFrame;
use jink_shared_types::{LocalNed, Point};
use mavlink::dialect::{COMMAND_LONG_DATA, MavFrame, MavMessage, ORBIT_EXECUTION_STATUS_DATA};
use nalgebra::{Vector2, Vector3};

/// Speed towards the circle for each metre that is missing (1/s).
const APPROACH_PER_S: f64 = 0.95;

/// A circle that is flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orbit {
    /// North and east (m).
    centre: Vector2<f64>,
    /// Radius (m).
    radius_m: f64,
    /// Speed along the circle, clockwise from above if positive (m/s).
    speed_mps: f64,
    /// Down coordinate (m).
    down_m: f64,
}

impl Orbit {
    /// As the command has it; what it does not give is where the vehicle is, 20 m and 1 m/s.
    pub(super) fn of(
        command: &COMMAND_LONG_DATA,
        place: CommandPlace,
        frame: &MissionFrame,
        here: Vector3<f64>,
    ) -> Self {
        let given = |value: f32, other: f64| {
            if value.is_finite() {
                f64::from(value)
            } else {
                other
            }
        };
        let (radius_m, speed_mps) = (given(command.param1, 20.0), given(command.param2, 1.0));
        let place = place.above_the_sea();
        Self {
            centre: place.level(frame).unwrap_or(here.xy()),
            radius_m: radius_m.abs(),
            speed_mps: speed_mps.copysign(radius_m),
            down_m: place.down_m(frame).unwrap_or(here.z),
        }
    }

    /// The report of the circle.
    pub(super) fn status(&self, now_us: u64, frame: &MissionFrame) -> MavMessage {
        let (x, y) = frame.projection.to_global(self.centre).to_e7();
        MavMessage::ORBIT_EXECUTION_STATUS(ORBIT_EXECUTION_STATUS_DATA {
            time_usec: now_us,
            radius: self.radius_m.copysign(self.speed_mps) as f32,
            x,
            y,
            z: (frame.origin_altitude_m - self.down_m) as f32,
            frame: MavFrame::MAV_FRAME_GLOBAL,
        })
    }

    /// What the controller follows at `position`; the approach at up to `cruise_mps`.
    pub(super) fn setpoint(&self, position: Point<LocalNed>, cruise_mps: f64) -> MotionSetpoint {
        let from_centre = position.vector().xy() - self.centre;
        let outwards = from_centre
            .try_normalize(1e-3)
            .unwrap_or_else(|| Vector2::new(1.0, 0.0));
        let missing_m = self.radius_m - from_centre.norm();
        let towards_mps = (APPROACH_PER_S * missing_m).clamp(-cruise_mps, cruise_mps);
        // PX4 begins to circle once it is there.
        let along_mps = if missing_m.abs() < 1.0 {
            self.speed_mps
        } else {
            0.0
        };
        let clockwise = Vector2::new(-outwards.y, outwards.x);
        let velocity = outwards * towards_mps + clockwise * along_mps;
        MotionSetpoint {
            position: Vector3::new(f64::NAN, f64::NAN, self.down_m),
            velocity: Vector3::new(velocity.x, velocity.y, f64::NAN),
            yaw_rad: (-outwards.y).atan2(-outwards.x),
            ..MotionSetpoint::unset()
        }
    }
}
