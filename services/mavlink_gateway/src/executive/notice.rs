//! What has changed since the last step: arming, mode, mission, current item; and whose wish it was.

use super::items::{self, Course, first_item};
use super::{ENTERED_S, Executive, FlightGoal, Intent, Part, REQUESTED_MAX, Scene};
use crate::demand::Demand;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{
    ITEM_CHOSEN, ITEM_WILL_HOLD, LEFT_ALONE, MISSION_CHANGED, MISSION_CLEARED, MISSION_READ, SPEED_COMMANDED,
    TAKEN_AGAIN,
};
use jink_shared_types::vehicle::NavMode;

/// A requested item that has not shown after this long (s) will not: later it is somebody else's choice.
const REQUESTED_S: f64 = 10.0;
/// Who chooses a mode again that jink has taken him out of within this time (s) means it.
pub(crate) const MEANT_S: f64 = 10.0;

impl Executive {
    /// A flight ends with the motors.
    pub(super) fn notice_arming(&mut self, scene: &Scene<'_>) {
        if std::mem::replace(&mut self.was_armed, scene.armed) && !scene.armed {
            self.flight_goal = FlightGoal::None;
            self.go_on_at(None);
            self.course = Course::default();
            self.given_back = None;
            self.was_taken = false;
            self.commanded_mps = None;
        }
    }

    /// A speed that a station asks for holds for the mission until its next change of speed, and for go-tos.
    pub(super) fn notice_speed(&mut self, scene: &Scene<'_>) {
        let Some(command) = scene
            .speed_command
            .filter(|command| command.serial != self.speed_serial)
        else {
            return;
        };
        self.speed_serial = command.serial;
        let after = |before| items::speed_after(scene.make, before, command.kind, command.speed_mps);
        self.commanded_mps = after(self.commanded_mps);
        self.course.speed_mps = after(self.course.speed_mps);
        if let Some(speed_mps) = self.commanded_mps {
            self.report(&SPEED_COMMANDED, "", f64::from(speed_mps));
        }
    }

    pub(super) fn notice_mode(&mut self, scene: &Scene<'_>) {
        let before = std::mem::replace(&mut self.before, scene.mode);
        if before == scene.mode {
            return;
        }
        let asked = self.asked.take().map(|(demand, ..)| demand);
        self.entered = scene.now;
        self.preparing = None;
        self.leaving = None;
        self.attempts = 0;
        self.unguarded = None;
        self.yielded = false;
        self.reported = None;
        self.halted = (before, scene.mode, asked) == (NavMode::Mission, NavMode::Hold, Some(Demand::Hold))
            && !self.is_refused;
        self.is_refused = false;
        let is_ours = match scene.mode {
            NavMode::Offboard => asked == Some(Demand::Follow),
            NavMode::Mission => asked == Some(Demand::Mission),
            NavMode::Land => asked == Some(Demand::Land),
            _ => false,
        };
        self.flown_alone = self.flown_alone.filter(|_| is_ours);
        self.is_told = false;
        match (before, scene.mode) {
            (_, NavMode::Offboard) => self.enter(is_ours),
            (_, NavMode::Mission) if is_ours => {
                self.flight_goal = FlightGoal::None;
                self.given_back = self.given_back.map(|given| given.taken(scene.now));
            }
            (_, NavMode::Mission) => {
                self.notice_leaving(scene, before);
                self.begin_mission();
            }
            // Whoever holds or lands or flies by hand ends a go-to; a mission may be resumed.
            (NavMode::Offboard | NavMode::Hold, _) if matches!(self.flight_goal, FlightGoal::GoTo(_)) => {
                self.flight_goal = FlightGoal::None;
            }
            _ => {}
        }
    }

    /// The autopilot follows setpoints from now on: because it was asked to, or because somebody wants it.
    fn enter(&mut self, is_ours: bool) {
        self.given_back = None;
        self.began_at = None;
        self.reached = None;
        if is_ours {
            return;
        }
        if (self.part, self.flight_goal) == (Part::WhenChosen, FlightGoal::None) {
            self.begin_mission();
        }
    }

    fn begin_mission(&mut self) {
        self.flight_goal = FlightGoal::Mission;
        self.given_back = None;
        self.course = Course::default();
        self.go_on_at(None);
    }

    /// Somebody lets the autopilot fly its mission while jink has flown. Once that may be a way to go on; twice it is meant.
    fn notice_leaving(&mut self, scene: &Scene<'_>, before: NavMode) {
        if before != NavMode::Offboard || self.part != Part::TakesOver || !scene.in_air {
            return;
        }
        let is_meant = self.left.is_set() && scene.now.seconds_since(self.left) <= MEANT_S;
        self.yielded = is_meant;
        self.left = if is_meant { Timestamp::NEVER } else { scene.now };
        self.report(if is_meant { &LEFT_ALONE } else { &TAKEN_AGAIN }, "", 0.0);
    }

    /// Another mission than before. What will not be flown is told before the flight.
    pub(super) fn notice_mission(&mut self, scene: &Scene<'_>) {
        let before = std::mem::replace(&mut self.version, scene.version);
        if before == scene.version {
            return;
        }
        let first = usize::from(first_item(scene.make));
        let items = scene.items.unwrap_or_default();
        let has_items = items.iter().skip(first).any(items::navigates);
        if has_items && self.part != Part::None && (before != 0 || !scene.armed) {
            if !scene.armed {
                self.report(&MISSION_READ, "", (items.len() - first) as f64);
            }
            if let Some((item, name)) = items::first_held(scene.make, items, scene.lets_fly_unguarded) {
                self.report(&ITEM_WILL_HOLD, name, f64::from(item));
            }
        }
        if before == 0 {
            return;
        }
        self.course = Course::default();
        self.go_on_at(None);
        self.given_back = None;
        self.was_taken = false;
        if has_items && scene.mode == NavMode::Offboard && self.flight_goal == FlightGoal::Mission {
            let current = scene.current.unwrap_or(0).max(first_item(scene.make));
            self.is_told = true;
            self.report(&MISSION_CHANGED, "", f64::from(current));
        }
    }

    /// There is nothing left to fly of the mission that was flown.
    pub(super) fn clear(&mut self) -> Intent {
        self.flight_goal = FlightGoal::None;
        self.go_on_at(None);
        self.report(&MISSION_CLEARED, "", 0.0);
        Intent::default()
    }

    /// Another current item than before: what jink has asked for, the autopilot's own progress, or somebody's choice.
    pub(super) fn notice_current(&mut self, scene: &Scene<'_>) {
        let before = std::mem::replace(&mut self.current, scene.current);
        let Some(current) = scene.current.filter(|_| before != scene.current) else {
            return;
        };
        let is_ours = self
            .requested
            .iter()
            .flatten()
            .any(|(item, since)| *item == current && scene.now.seconds_since(*since) <= REQUESTED_S);
        if is_ours {
            self.requested = [None; REQUESTED_MAX];
            return;
        }
        let flies_it = self.index.is_some_and(|index| index == usize::from(current));
        if before.is_none() || flies_it {
            return;
        }
        self.requested = [None; REQUESTED_MAX];
        // An autopilot that changes its mode reports its own item again.
        let is_leaving = self
            .asked
            .is_some_and(|(asked, ..)| matches!(asked, Demand::Mission | Demand::Land | Demand::Hold));
        if is_leaving && scene.mode == NavMode::Offboard {
            return;
        }
        self.go_on_at(None);
        // It may be the current item of another mission.
        let flies = scene.mode == NavMode::Offboard && self.part != Part::ShowsTheWay;
        self.reads_again |= flies && self.flight_goal == FlightGoal::Mission;
        let is_choice =
            scene.now.seconds_since(self.entered) > ENTERED_S && current >= first_item(scene.make);
        if is_choice && scene.mode == NavMode::Offboard && self.flight_goal == FlightGoal::Mission {
            self.asked = None;
            self.report(&ITEM_CHOSEN, "", f64::from(current));
        }
    }
}
