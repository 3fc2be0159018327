//! Where the start bubble is declared: around the vehicle on the ground, and while it climbs from there for the first
//! time.
//!
//! The mode is no criterion: PX4 takes off in a mode of its own or in a mission, ArduPilot in GUIDED or AUTO. The place
//! is: as long as the vehicle is above the place where it stood and has not rested up there, it takes off. Without the
//! rest the bubble would rise with the vehicle without end: into the ceiling, with every climb to see more.

use jink_shared_types::Timestamp;
use jink_shared_types::vehicle::VehicleState;
use nalgebra::Vector3;

/// Farther aside than this (m) from where it stood, the vehicle has left its start. Copters in wind drift less while
/// they climb.
const ASIDE_M: f64 = 0.5;
/// Slower than this (m/s) for so long (s), a vehicle in flight is at rest: PX4 pauses for a second between its take-off
/// and a mission.
const REST_MPS: f64 = 0.1;
const REST_S: f64 = 2.0;
/// Lower than this (m) above the place where it stood, it has not taken off, whatever the autopilot says of the ground:
/// motors spin up for some seconds after the land detector has reported the take-off.
const TAKEN_OFF_M: f64 = 0.3;

/// The state of the take-off.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StartBubble {
    /// Where the vehicle stood (local NED, m); `None` once it has taken off, and if it never stood.
    ground_m: Option<Vector3<f64>>,
    /// When it last stood or moved.
    moved: Timestamp,
}

impl StartBubble {
    /// Whether the vehicle stands or takes off at `capture`.
    pub fn update(&mut self, state: &VehicleState, capture: Timestamp) -> bool {
        let here = state.position.vector();
        let stands = !state.armed.is_set() || state.landed.is_set();
        if stands {
            self.ground_m = Some(here);
        }
        let is_up = self
            .ground_m
            .is_some_and(|ground_m| ground_m.z - here.z > TAKEN_OFF_M);
        if !is_up || state.velocity.vector().norm() > REST_MPS {
            self.moved = capture;
        }
        let rested = capture.seconds_since(self.moved) >= REST_S;
        self.ground_m = self
            .ground_m
            .filter(|ground_m| !rested && (here - ground_m).xy().norm() <= ASIDE_M);
        self.ground_m.is_some()
    }

    /// The local frame was moved by `jump_m`.
    pub fn shift(&mut self, jump_m: &Vector3<f64>) {
        if let Some(ground_m) = &mut self.ground_m {
            *ground_m += jump_m;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::StartBubble;
    use jink_shared_types::frames::Velocity;
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Flag, Point, Timestamp};
    use nalgebra::Vector3;

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(t_s)
    }

    fn on_ground(north_m: f64) -> VehicleState {
        VehicleState {
            position: Point::new(north_m, 0.0, 0.0),
            landed: Flag::from(true),
            ..VehicleState::default()
        }
    }

    fn in_flight(north_m: f64, down_m: f64, climb_mps: f64) -> VehicleState {
        VehicleState {
            position: Point::new(north_m, 0.0, down_m),
            velocity: Velocity::new(0.0, 0.0, -climb_mps),
            armed: Flag::from(true),
            ..VehicleState::default()
        }
    }

    #[test]
    fn it_lasts_from_the_ground_until_the_vehicle_has_left_the_place_in_any_mode() {
        let mut start = StartBubble::default();
        assert!(start.update(&on_ground(3.0), at(1.0)));
        assert!(start.update(&in_flight(3.3, -1.0, 1.0), at(2.0)));
        assert!(start.update(&in_flight(2.8, -2.5, 1.0), at(3.0)));
        assert!(!start.update(&in_flight(3.6, -2.5, 1.0), at(4.0)));
        assert!(
            !start.update(&in_flight(3.0, -2.5, 1.0), at(5.0)),
            "back above it in the same flight"
        );
        assert!(start.update(&on_ground(9.0), at(6.0)), "the next flight");
    }

    #[test]
    fn a_rest_in_flight_ends_it_and_a_pause_does_not() {
        let mut start = StartBubble::default();
        assert!(start.update(&on_ground(0.0), at(50.0)));
        assert!(start.update(&in_flight(0.0, -0.5, 0.5), at(51.0)));
        assert!(start.update(&in_flight(0.0, -0.6, 0.0), at(52.0)));
        assert!(start.update(&in_flight(0.0, -0.8, 0.5), at(52.5)));
        assert!(start.update(&in_flight(0.0, -1.1, 0.05), at(54.0)));
        assert!(!start.update(&in_flight(0.0, -1.1, 0.05), at(54.6)));
        assert!(!start.update(&in_flight(0.0, -1.3, 0.5), at(55.0)));
    }

    #[test]
    fn motors_that_spin_up_for_long_do_not_end_it() {
        let mut start = StartBubble::default();
        assert!(start.update(&on_ground(0.0), at(1.0)));
        for second in 2..8 {
            assert!(start.update(&in_flight(0.0, -0.05, 0.0), at(f64::from(second))));
        }
        assert!(start.update(&in_flight(0.0, -1.1, 0.5), at(9.0)));
    }

    #[test]
    fn a_vehicle_that_is_first_seen_in_flight_has_no_start() {
        assert!(!StartBubble::default().update(&in_flight(0.0, -2.0, 1.0), at(1.0)));
    }

    #[test]
    fn a_jump_of_the_frame_does_not_end_it() {
        let mut start = StartBubble::default();
        start.update(&on_ground(0.0), at(1.0));
        start.shift(&Vector3::new(4.0, 0.0, 0.0));
        assert!(start.update(&in_flight(4.1, -1.0, 1.0), at(2.0)));
    }
}
