//! A reset of the estimator moves the local frame, not the vehicle. If the jump is known, the map is moved with the
//! frame.
//!
//! | in | out |
//! |---|---|
//! | the last state before the reset, the first one after it | the jump, if it is known |
//! | the jump | whole cells, and the rest on each axis |
//!
//! The jump is the difference of both positions less the distance flown meanwhile (mean of both velocities times the
//! time between). That holds for a jump of the position alone: with a jump of the heading, a jump of the velocity, or a
//! long gap it is not known.

use crate::poses::MAX_GAP_S;
use jink_shared_types::map::CELL_M;
use nalgebra::{UnitQuaternion, Vector3};

/// A counted reset that moves the position by less is not one of the position (m): the gateway counts jumps from 0.3 m
/// on.
const SMALLEST_M: f64 = 0.1;
/// How far the attitude may be from the one predicted by the body rates (rad): at 12 m it moves a cell by 0.12 m, its
/// half width.
const TURN_RAD: f64 = 0.01;
/// Greatest acceleration of a multicopter (m/s2), and noise of its velocity (m/s): beyond, the velocity has jumped,
/// too.
const ACCELERATION_MPS2: f64 = 20.0;
const VELOCITY_NOISE_MPS: f64 = 0.2;
/// The rest of a jump beyond whole cells counts from here on (m): less is within the noise of every range sensor.
const LEFT_OVER_M: f64 = 0.01;

/// The estimator's state at one time.
pub(crate) struct Estimate {
    /// Position in the local frame (m).
    pub position_m: Vector3<f64>,
    /// Velocity in the local frame (m/s).
    pub velocity_mps: Vector3<f64>,
    /// `local_q_body`.
    pub local_q_body: UnitQuaternion<f64>,
    /// Body rates (rad/s).
    pub rates_radps: Vector3<f64>,
}

/// By how much (m) the local coordinates of everything changed between `before` and `after`, `step_s` later; nothing if
/// that is not known.
pub(crate) fn known_jump_m(before: &Estimate, after: &Estimate, step_s: f64) -> Option<Vector3<f64>> {
    if !(step_s > 0.0 && step_s <= MAX_GAP_S) {
        return None;
    }
    let turned = before.local_q_body * UnitQuaternion::from_scaled_axis(before.rates_radps * step_s);
    let turn_rad = turned.angle_to(&after.local_q_body);
    let velocity_step_mps = (after.velocity_mps - before.velocity_mps).norm();
    let flown_m = (before.velocity_mps + after.velocity_mps) * (0.5 * step_s);
    let jump_m = after.position_m - before.position_m - flown_m;
    let is_known = turn_rad <= TURN_RAD
        && velocity_step_mps <= ACCELERATION_MPS2 * step_s + VELOCITY_NOISE_MPS
        && jump_m.norm() >= SMALLEST_M;
    is_known.then_some(jump_m)
}

/// A jump in whole cells, and on which side (-1, 1) each cell reaches into its neighbour after that (0: it does not).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameShift {
    pub cells: [i32; 3],
    pub into: [i32; 3],
}

impl FrameShift {
    /// The shift of everything by `jump_m`.
    pub fn by(jump_m: &Vector3<f64>) -> Self {
        let cells = [0, 1, 2].map(|axis: usize| (jump_m[axis] / CELL_M).round() as i32);
        let into = [0, 1, 2].map(|axis: usize| {
            let left_m = jump_m[axis] - f64::from(cells[axis]) * CELL_M;
            if left_m.abs() < LEFT_OVER_M {
                0
            } else {
                left_m.signum() as i32
            }
        });
        Self { cells, into }
    }
}

#[cfg(test)]
mod tests {
    use super::{Estimate, FrameShift, known_jump_m};
    use nalgebra::{UnitQuaternion, Vector3};

    fn estimate(position_m: Vector3<f64>, yaw_rad: f64) -> Estimate {
        Estimate {
            position_m,
            velocity_mps: Vector3::new(5.0, 0.0, 0.0),
            local_q_body: UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
            rates_radps: Vector3::new(0.0, 0.0, 0.5),
        }
    }

    #[test]
    fn what_the_vehicle_has_flown_is_no_jump() {
        let before = estimate(Vector3::new(3.0, 0.0, -2.0), 0.1);
        let after = estimate(Vector3::new(3.1 + 0.5, -1.0, -2.0), 0.11);
        let jump_m = known_jump_m(&before, &after, 0.02).unwrap();
        assert!((jump_m - Vector3::new(0.5, -1.0, 0.0)).norm() < 1e-9, "{jump_m}");
    }

    #[test]
    fn a_jump_of_the_heading_or_the_velocity_a_long_gap_and_no_jump_are_not_known() {
        let before = || estimate(Vector3::zeros(), 0.1);
        let moved = Vector3::new(1.0, 0.0, 0.0);
        assert!(known_jump_m(&before(), &estimate(moved, 0.11), 0.02).is_some());
        assert!(
            known_jump_m(&before(), &estimate(moved, 0.13), 0.02).is_none(),
            "heading"
        );
        assert!(
            known_jump_m(&before(), &estimate(moved, 0.16), 0.12).is_none(),
            "gap"
        );
        assert!(
            known_jump_m(&before(), &estimate(moved, 0.1), 0.0).is_none(),
            "no time"
        );
        let flown = Vector3::new(0.1, 0.0, 0.0);
        assert!(
            known_jump_m(&before(), &estimate(flown, 0.11), 0.02).is_none(),
            "no jump"
        );
        let mut faster = estimate(moved, 0.11);
        faster.velocity_mps.y = 1.0;
        assert!(known_jump_m(&before(), &faster, 0.02).is_none(), "velocity");
    }

    #[test]
    fn a_jump_is_whole_cells_and_the_side_to_which_the_rest_reaches() {
        let by = |x: f64, y: f64, z: f64| FrameShift::by(&Vector3::new(x, y, z));
        assert_eq!(
            by(0.4, -0.6, 0.005),
            FrameShift {
                cells: [2, -3, 0],
                into: [0, 0, 0]
            }
        );
        assert_eq!(
            by(0.45, -0.65, 0.35),
            FrameShift {
                cells: [2, -3, 2],
                into: [1, -1, -1]
            }
        );
    }
}
