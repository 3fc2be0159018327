//! A mission item that cannot be reached blocks the mission for ever: PX4 accepts it only within its radius, wherever the obstacle
//! stands. So somebody has to notice, and decide.
//!
//! | noticed | done, by OA_BLOCKED |
//! |---|---|
//! | a way is wanted, the vehicle has been standing for OA_BLOCKED_T, and is not at the item | 0: told; 1: the next item is made current, or the mission stopped at the last one; 2: the mission is stopped (hold) |
//!
//! Standing is the sign, not the lack of progress: a detour leads away from the item for a while, and a planner that finds nothing
//! comes to rest.

use jink_shared_types::Timestamp;
use jink_shared_types::params::{OA_BLOCKED, ParamSet};

/// Slower than this counts as standing (m/s).
const STANDING_MPS: f64 = 0.3;
/// Nearer to the item than this, the autopilot itself has accepted it or is waiting there on purpose (m).
const AT_ITEM_M: f64 = 1.5;

/// What is to be done about an item that cannot be reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// The pilot is told, nothing else.
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

    /// How the pilot is told.
    pub fn word(self) -> &'static str {
        match self {
            Remedy::Wait => "waiting",
            Remedy::Skip => "skipped",
            Remedy::Stop => "mission stopped",
        }
    }
}

/// What is seen at one moment.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Now.
    pub now: Timestamp,
    /// Speed of the vehicle (m/s).
    pub speed_mps: f64,
    /// The mission item that is flown to.
    pub item: u16,
    /// Distance to it (m); `None` no way to it is wanted.
    pub away_m: Option<f64>,
}

/// Watches for it.
#[derive(Clone, Copy, Debug)]
pub struct Blockage {
    remedy: Remedy,
    patience_s: f64,
    standing_since: Option<Timestamp>,
    /// The item that was told of last.
    told: Option<u16>,
}

impl Blockage {
    /// `remedy` is due after standing for `patience_s`.
    pub fn new(remedy: Remedy, patience_s: f64) -> Self {
        Self {
            remedy,
            patience_s,
            standing_since: None,
            told: None,
        }
    }

    /// The remedy, at the moment when it is due. Waiting is told once per item; a remedy that has not helped is due again after the
    /// same time.
    pub fn step(&mut self, view: &View) -> Option<Remedy> {
        let stuck = view.speed_mps < STANDING_MPS && view.away_m.is_some_and(|away_m| away_m > AT_ITEM_M);
        if !stuck {
            self.standing_since = None;
            return None;
        }
        let since = *self.standing_since.get_or_insert(view.now);
        if view.now.seconds_since(since) < self.patience_s {
            return None;
        }
        self.standing_since = Some(view.now);
        let before = self.told.replace(view.item);
        let repeats = before == Some(view.item) && self.remedy == Remedy::Wait;
        (!repeats).then_some(self.remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::{Blockage, Remedy, View};
    use jink_shared_types::Timestamp;
    use jink_shared_types::params::ParamSet;

    fn blockage(policy: f64) -> Blockage {
        let mut params = ParamSet::default();
        params.set("OA_BLOCKED", policy).unwrap();
        Blockage::new(Remedy::from_params(&params), 10.0)
    }

    /// When, and with which remedy, within 35 s of `speed_mps` at `away_m` of the item.
    fn remedies(policy: f64, speed_mps: f64, away_m: Option<f64>) -> Vec<(f64, Remedy)> {
        let mut blockage = blockage(policy);
        let seconds = (0..350).map(|i| f64::from(i) * 0.1);
        seconds
            .filter_map(|s| {
                let now = Timestamp::from_seconds(100.0 + s);
                let view = View {
                    now,
                    speed_mps,
                    item: 3,
                    away_m,
                };
                blockage.step(&view).map(|remedy| (s, remedy))
            })
            .collect()
    }

    #[test]
    fn who_stands_before_an_item_for_too_long_is_helped() {
        for (policy, remedy) in [(1.0, Remedy::Skip), (2.0, Remedy::Stop)] {
            let due = remedies(policy, 0.1, Some(4.0));
            assert_eq!(due.len(), 3, "{due:?}");
            assert!((due[0].0 - 10.0).abs() < 0.2 && due.iter().all(|(_, due)| *due == remedy));
        }
        assert_eq!(remedies(0.0, 0.1, Some(4.0)).len(), 1, "waiting is told once");
    }

    #[test]
    fn who_moves_or_has_arrived_or_wants_nothing_is_left_alone() {
        assert!(remedies(1.0, 1.0, Some(4.0)).is_empty());
        assert!(remedies(1.0, 0.0, Some(1.0)).is_empty());
        assert!(remedies(1.0, 0.0, None).is_empty());
    }
}
