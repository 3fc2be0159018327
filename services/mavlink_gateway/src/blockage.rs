//! A mission item that cannot be reached blocks the mission for ever: PX4 accepts it only within its radius, wherever the obstacle
//! stands. So somebody has to decide.
//!
//! | the planner says | done, by OA_BLOCKED |
//! |---|---|
//! | the item that is flown to has been out of reach for OA_BLOCKED_T | 0: the pilot is notified; 1: the next item is made current, or the mission stopped at the last one; 2: the mission is stopped (hold) |
//! | the same of a goal that is no item | the pilot is notified |
//!
//! The planner alone knows whether the way becomes shorter; the vehicle rests meanwhile.

use jink_shared_types::params::{OA_BLOCKED, ParamSet};
use jink_shared_types::{LocalNed, Point};

/// A goal that has moved less is the same (m).
const SAME_GOAL_M: f64 = 0.1;

/// What is to be done about an item that cannot be reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// The pilot is notified, nothing else.
    Wait,
    /// The next item is made current.
    Skip,
    /// The autopilot holds.
    Stop,
}

impl Remedy {
    /// As OA_BLOCKED says.
    pub fn from_params(params: &ParamSet) -> Self {
        match params.get(&OA_BLOCKED) as u8 {
            1 => Remedy::Skip,
            2 => Remedy::Stop,
            _ => Remedy::Wait,
        }
    }

    /// The word for it in the text to the pilot.
    pub fn word(self) -> &'static str {
        match self {
            Remedy::Wait => "waiting",
            Remedy::Skip => "skipped",
            Remedy::Stop => "mission stopped",
        }
    }
}

/// Helps with what is out of reach.
#[derive(Clone, Copy, Debug)]
pub struct Blockage {
    remedy: Remedy,
    /// The item that was reported last.
    reported: Option<u16>,
    /// The goal that is no item and was reported last.
    reported_goal: Option<Point<LocalNed>>,
}

impl Blockage {
    /// With that remedy.
    pub fn new(remedy: Remedy) -> Self {
        Self {
            remedy,
            reported: None,
            reported_goal: None,
        }
    }

    /// What to do about `item`, which is out of reach, or still is. Waiting is reported once per item; a remedy that
    /// has not helped is due again.
    pub fn remedy(&mut self, item: u16) -> Option<Remedy> {
        let before = self.reported.replace(item);
        let repeats = before == Some(item) && self.remedy == Remedy::Wait;
        (!repeats).then_some(self.remedy)
    }

    /// Whether the pilot is to be notified that `goal`, which is no item, is out of reach: once.
    pub fn is_new(&mut self, goal: Point<LocalNed>) -> bool {
        let before = self.reported_goal.replace(goal);
        before.is_none_or(|before| (before.vector() - goal.vector()).norm() > SAME_GOAL_M)
    }
}

#[cfg(test)]
mod tests {
    use super::{Blockage, Remedy};
    use jink_shared_types::Point;
    use jink_shared_types::params::ParamSet;

    fn remedies(policy: f64, items: [u16; 3]) -> Vec<Option<Remedy>> {
        let mut params = ParamSet::default();
        params.set("OA_BLOCKED", policy).unwrap();
        let mut blockage = Blockage::new(Remedy::from_params(&params));
        items.map(|item| blockage.remedy(item)).to_vec()
    }

    #[test]
    fn an_item_out_of_reach_is_helped_by_policy_and_waiting_is_reported_once() {
        let [wait, skip, stop] = [Remedy::Wait, Remedy::Skip, Remedy::Stop].map(Some);
        assert_eq!(remedies(0.0, [3, 3, 4]), [wait, None, wait]);
        assert_eq!(remedies(1.0, [3, 3, 4]), [skip; 3]);
        assert_eq!(remedies(2.0, [3, 3, 4]), [stop; 3]);
    }

    #[test]
    fn a_goal_that_is_no_item_is_reported_once() {
        let mut blockage = Blockage::new(Remedy::Skip);
        let goals = [1.0, 1.0, 5.0, 5.05, 1.0].map(|x| Point::new(x, 0.0, -3.0));
        let reported = goals.map(|goal| blockage.is_new(goal));
        assert_eq!(reported, [true, false, true, false, true]);
    }
}
