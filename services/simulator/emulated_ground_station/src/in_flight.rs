//! What a person at a ground station does while the vehicle flies its mission.
//!
//! | action | message | counts as done |
//! |---|---|---|
//! | another mission | the mission protocol | MISSION_ACK |
//! | no mission | MISSION_CLEAR_ALL | MISSION_ACK |
//! | another item | MISSION_SET_CURRENT | MISSION_CURRENT names it, or it was said three times |
//! | a click on the map | DO_REPOSITION in COMMAND_INT, asking for the mode | COMMAND_ACK |
//! | another mode | DO_SET_MODE | COMMAND_ACK |
//!
//! Whoever sends the vehicle somewhere or chooses a mode no longer wants the mission, until he chooses that again.

use super::item::PlanItem;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::vehicle::NavMode;

/// What is done.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Another mission is uploaded.
    Upload {
        /// Its waypoints.
        waypoints: Vec<Point<LocalNed>>,
        /// What comes behind them.
        tail: Vec<PlanItem>,
    },
    /// The mission is cleared.
    ClearMission,
    /// The mission goes on at this item.
    SetCurrent {
        /// Its number in the mission.
        item: u16,
    },
    /// The vehicle is sent somewhere.
    GoTo(Point<LocalNed>),
    /// It is sent around a place (PX4): 5 m from it, at 2 m/s.
    Orbit(Point<LocalNed>),
    /// A mode is chosen.
    Mode(NavMode),
}

impl Action {
    /// What it means for the mission: `Some(false)` it is no longer wanted, `Some(true)` it is again.
    pub(super) fn wants_mission(&self) -> Option<bool> {
        match self {
            Self::Upload { .. } | Self::ClearMission | Self::SetCurrent { .. } => None,
            Self::GoTo(_) | Self::Orbit(_) => Some(false),
            Self::Mode(mode) => Some(*mode == NavMode::Mission),
        }
    }
}

/// When it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum When {
    /// As soon as the vehicle is this far north in its mission (m).
    North(f64),
    /// This long after the action before, or after the mission began (s).
    After(f64),
}

/// Something that is done in flight.
#[derive(Clone, Debug, PartialEq)]
pub struct InFlight {
    /// When.
    pub when: When,
    /// What.
    pub action: Action,
}

/// Where the station stands with its actions.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Acting {
    /// The next one, or the one under way.
    pub index: usize,
    /// It is under way.
    pub begun: bool,
    /// How often it was said.
    pub said: u32,
    /// When the one before was done (s); `None` before the mission.
    pub since_s: Option<f64>,
    /// It was answered.
    pub answered: bool,
    /// The mission is no longer wanted.
    pub hands_off: bool,
}

impl Acting {
    /// Whether an action is due now.
    pub fn is_due(&self, when: When, now_s: f64, north_m: Option<f64>) -> bool {
        match when {
            When::North(least_m) => north_m.is_some_and(|north_m| north_m >= least_m),
            When::After(seconds) => self.since_s.is_some_and(|since_s| now_s - since_s >= seconds),
        }
    }

    /// The action under way is done.
    pub fn finish(&mut self, now_s: f64, wants_mission: Option<bool>) {
        *self = Self {
            index: self.index + 1,
            since_s: Some(now_s),
            hands_off: wants_mission.map_or(self.hands_off, |wanted| !wanted),
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::{Acting, Action, When};
    use jink_shared_types::frames::Point;
    use jink_shared_types::vehicle::NavMode;

    #[test]
    fn an_action_waits_for_its_place_or_its_time() {
        let mut acting = Acting {
            since_s: Some(10.0),
            ..Acting::default()
        };
        assert!(!acting.is_due(When::North(5.0), 11.0, None));
        assert!(acting.is_due(When::North(5.0), 11.0, Some(5.1)));
        assert!(!acting.is_due(When::After(2.0), 11.0, None));
        acting.finish(20.0, Action::GoTo(Point::new(1.0, 2.0, -3.0)).wants_mission());
        assert!(acting.hands_off && acting.index == 1);
        assert!(acting.is_due(When::After(2.0), 22.0, None));
        acting.finish(23.0, Action::SetCurrent { item: 1 }.wants_mission());
        assert!(acting.hands_off);
        acting.finish(24.0, Action::Mode(NavMode::Mission).wants_mission());
        assert!(!acting.hands_off);
    }
}
