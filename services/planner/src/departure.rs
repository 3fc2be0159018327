//! Where the next plan departs from: the committed trajectory a little ahead, or the vehicle as it moves or rests.

use crate::committed_trajectory::is_flown;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::motion::{MotionState, SPLICE_LEAD_S, Trajectory};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Stamped, Timestamp};

/// A vehicle without a plan that is faster than this is in motion (m/s): below, its stopping distance stays within the
/// tube.
pub(super) const MOVING_MPS: f64 = 0.5;
/// A reference slower than this rests (m/s).
const RESTING_MPS: f64 = 0.05;

/// Where the next plan departs from: a committed motion, or the vehicle as it moves or rests.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departure {
    pub(super) base_id: u64,
    pub(super) splice: Timestamp,
    pub(super) state: MotionState,
    /// The tube of the committed motion, and how far the vehicle is from its reference (m); zeros for none.
    pub(super) tube_m: f64,
    pub(super) error_m: f64,
}

impl Departure {
    /// Whether the vehicle moves without a plan, as when a pilot switches to the mission in flight: if none is found it
    /// must be stopped.
    pub(super) fn is_unplanned_motion(&self) -> bool {
        self.base_id == 0 && self.state.velocity.vector().norm() > 0.0
    }

    /// Whether the vehicle is where a motion with a tube of `tube_m` (m) would have it: what it has strayed in a wider one, or runs on
    /// ahead of hard braking, is over.
    pub(super) fn is_within(&self, tube_m: f64) -> bool {
        self.tube_m <= tube_m || self.error_m <= tube_m
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.state.velocity.vector().norm() < RESTING_MPS
    }
}

/// Where the next plan departs from: the committed trajectory a little ahead, or the vehicle at its extrapolated
/// position; at rest where it stands if it hardly moves.
pub(super) fn departure(
    now: Timestamp,
    committed: Option<&Trajectory>,
    state: &Stamped<'_, VehicleState>,
) -> Departure {
    let splice = now.plus_seconds(SPLICE_LEAD_S);
    if let Some(committed) = committed.filter(|trajectory| is_flown(trajectory))
        && let Some(reference) = committed.at(splice)
    {
        return Departure {
            base_id: committed.id,
            splice,
            state: reference,
            tube_m: committed.limits.tube_m,
            error_m: committed.at(state.header.capture).map_or(0.0, |reference| {
                (reference.position.vector() - state.position.vector()).norm()
            }),
        };
    }
    let mut start = MotionState::at_rest(state.position, state.attitude.yaw_rad());
    let velocity = state.velocity.vector();
    if velocity.norm() > MOVING_MPS {
        let ahead_s = splice.seconds_since(state.header.capture);
        start.position = Point::from_vector(state.position.vector() + velocity * ahead_s);
        start.velocity = state.velocity;
    }
    Departure {
        base_id: 0,
        splice,
        state: start,
        tube_m: 0.0,
        error_m: 0.0,
    }
}

/// Whether the reference rests at `goal` already.
pub(super) fn is_at(reference: &MotionState, goal: &Point<LocalNed>) -> bool {
    const HERE_M: f64 = 0.05;
    (reference.position.vector() - goal.vector()).norm() < HERE_M
        && reference.velocity.vector().norm() < RESTING_MPS
}

#[cfg(test)]
mod tests {
    use super::departure;
    use jink_shared_types::bezier::quintic_between;
    use jink_shared_types::motion::{BezierPiece, MotionLimits, MotionState, Trajectory, TrajectoryMode};
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Coded, Point, SampleHeader, Stamped, Timestamp};
    use nalgebra::Vector3;

    #[test]
    fn a_narrower_tube_is_not_entered_before_the_vehicle_is_inside_it() {
        let start = Timestamp::from_seconds(10.0);
        let mut committed = Trajectory {
            id: 7,
            start,
            mode: Coded::new(TrajectoryMode::Plan),
            limits: MotionLimits {
                tube_m: 0.486,
                ..MotionLimits::default()
            },
            ..Trajectory::default()
        };
        let rest = |x_m: f64| MotionState::at_rest(Point::new(x_m, 0.0, -2.0), 0.0).end();
        let points = quintic_between(&rest(0.0), &rest(4.0), 4.0);
        assert!(committed.push(BezierPiece::new(&points, [0.0; 6], 4.0)));
        let now = start.plus_seconds(2.0);
        let from = |aside_m: f64| {
            let state = VehicleState {
                position: Point::from_vector(Vector3::new(2.0, aside_m, -2.0)),
                ..VehicleState::default()
            };
            let header = SampleHeader::at(now);
            departure(
                now,
                Some(&committed),
                &Stamped {
                    sample: &state,
                    header: &header,
                },
            )
        };
        for (aside_m, narrow, same) in [
            (0.0, true, true),
            (0.29, true, true),
            (0.33, false, true),
            (0.6, false, true),
        ] {
            let departure = from(aside_m);
            assert_eq!(
                (departure.is_within(0.306), departure.is_within(0.486)),
                (narrow, same),
                "{aside_m}"
            );
        }
    }
}
