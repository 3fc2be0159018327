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
}

impl Departure {
    /// Whether the vehicle moves without a plan, as when a pilot switches to the mission in flight: if none is found it
    /// must be stopped.
    pub(super) fn is_unplanned_motion(&self) -> bool {
        self.base_id == 0 && self.state.velocity.vector().norm() > 0.0
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
    }
}

/// Whether the reference rests at `goal` already.
pub(super) fn is_at(reference: &MotionState, goal: &Point<LocalNed>) -> bool {
    const HERE_M: f64 = 0.05;
    (reference.position.vector() - goal.vector()).norm() < HERE_M
        && reference.velocity.vector().norm() < RESTING_MPS
}
