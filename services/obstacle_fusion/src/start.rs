//! Where the start bubble is declared: around the vehicle on the ground, and while it climbs from there for the first time.
//!
//! The mode does not say it: PX4 takes off in a mode of its own or in a mission, ArduPilot in GUIDED or AUTO. The place does: as long as the
//! vehicle is above the place where it stood, it takes off.

use jink_shared_types::vehicle::VehicleState;
use nalgebra::{Vector2, Vector3};

/// Farther aside than this (m) from where it stood, the vehicle has left its start. Copters in wind drift less while they climb.
const ASIDE_M: f64 = 0.5;

/// The start of a flight.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Start {
    /// Where the vehicle stood (local, north and east, m); `None` once it has left that place, and if it never stood.
    stood: Option<Vector2<f64>>,
}

impl Start {
    /// Whether the vehicle stands, or is still above the place where it stood.
    pub fn update(&mut self, state: &VehicleState) -> bool {
        let here = state.position.vector().xy();
        if !state.armed.is_set() || state.landed.is_set() {
            self.stood = Some(here);
        }
        self.stood = self.stood.filter(|stood| (here - stood).norm() <= ASIDE_M);
        self.stood.is_some()
    }

    /// The local frame was moved by `jump_m`.
    pub fn shift(&mut self, jump_m: &Vector3<f64>) {
        if let Some(stood) = &mut self.stood {
            *stood += jump_m.xy();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Start;
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Flag, Point};
    use nalgebra::Vector3;

    fn state(north_m: f64, down_m: f64, landed: bool) -> VehicleState {
        VehicleState {
            position: Point::new(north_m, 0.0, down_m),
            armed: Flag::from(!landed),
            landed: Flag::from(landed),
            ..VehicleState::default()
        }
    }

    #[test]
    fn it_lasts_from_the_ground_until_the_vehicle_has_left_the_place_in_any_mode() {
        let mut start = Start::default();
        assert!(start.update(&state(3.0, 0.0, true)));
        assert!(start.update(&state(3.3, -1.0, false)));
        assert!(start.update(&state(2.8, -2.5, false)));
        assert!(!start.update(&state(3.6, -2.5, false)));
        assert!(!start.update(&state(3.0, -2.5, false)), "back above it in the same flight");
        assert!(start.update(&state(9.0, 0.0, true)), "the next flight");
    }

    #[test]
    fn a_vehicle_that_is_first_seen_in_flight_has_no_start() {
        assert!(!Start::default().update(&state(0.0, -2.0, false)));
    }

    #[test]
    fn a_jump_of_the_frame_does_not_end_it() {
        let mut start = Start::default();
        start.update(&state(0.0, 0.0, true));
        start.shift(&Vector3::new(4.0, 0.0, 0.0));
        assert!(start.update(&state(4.1, -1.0, false)));
    }
}
