//! Plans that are not flown: the generator makes no curve of them, the guard refuses them, or one of the two is gone.

use jink_shared_types::Timestamp;
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Verdict};

/// A plan that is not flown after this time is not flown (s): generator and guard take some 10 ms, a restart of one of
/// them some 100.
const UNFLOWN_S: f64 = 1.0;

/// Why plans are not flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unflown {
    /// Nobody answers them.
    Unanswered,
    /// The guard refuses them.
    Refused,
}

/// The first plan of those that are not flown.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct UnflownPlans {
    first: Option<(u64, Timestamp)>,
}

impl UnflownPlans {
    /// There is no plan any more.
    pub fn reset(&mut self) {
        self.first = None;
    }

    /// The plan `route_id` is given out.
    pub fn give_out(&mut self, route_id: u64, now: Timestamp) {
        self.first.get_or_insert((route_id, now));
    }

    /// Whether plans have not been flown for too long by what is `approved`, and why. Any later plan that is flown
    /// counts.
    pub fn check(&mut self, now: Timestamp, approved: Option<&ApprovedTrajectory>) -> Option<Unflown> {
        let (route_id, since) = self.first?;
        if approved.is_some_and(|approved| approved.trajectory.route_id >= route_id) {
            self.first = None;
            return None;
        }
        if now.seconds_since(since) < UNFLOWN_S {
            return None;
        }
        let is_refused = approved.is_some_and(|approved| {
            matches!(approved.verdict.get(), Verdict::Kept | Verdict::Hold)
                && approved.reason != GuardReason::None
        });
        Some(if is_refused {
            Unflown::Refused
        } else {
            Unflown::Unanswered
        })
    }
}
