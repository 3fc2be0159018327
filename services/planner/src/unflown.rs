//! Plans that are not flown: the generator makes no curve of them, or the guard refuses them.

use jink_shared_types::Timestamp;
use jink_shared_types::motion::Trajectory;

/// Plans none of which is flown for this time are not flown (s): generator and guard take some 10 ms, a restart of one of them some
/// 100, and in narrow places some are refused one after the other.
const UNFLOWN_S: f64 = 5.0;

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

    /// Whether plans have not been flown for too long, by what is `committed`; any later plan that is flown counts.
    pub fn are_there(&mut self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let Some((route_id, since)) = self.first else {
            return false;
        };
        if committed.is_some_and(|committed| committed.route_id >= route_id) {
            self.first = None;
        }
        self.first.is_some() && now.seconds_since(since) > UNFLOWN_S
    }
}
