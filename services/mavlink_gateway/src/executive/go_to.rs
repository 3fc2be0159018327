//! A ground station's "go to": where it shows, and how it is flown.
//!
//! | autopilot | a go-to is | it shows as |
//! |---|---|---|
//! | ArduCopter in GUIDED | DO_REPOSITION, or one SET_POSITION_TARGET with a position only: it flies there at once, until the next setpoint | POSITION_TARGET_LOCAL_NED with a position and no velocity, while every setpoint of jink has both |
//! | PX4 | DO_REPOSITION: it changes to Hold and flies there, also out of OFFBOARD | POSITION_TARGET_GLOBAL_INT in Hold, far from where the vehicle comes to rest |
//! | any, with the station on a link of jink's own | the message itself | the message itself |
//!
//! ArduCopter shows such a target only until jink's next setpoint. So where nothing is flown none is sent, as long as the
//! autopilot's target is jink's own; while something is flown a go-to may be overlooked, and has to be sent again. Behind a take-off
//! the target that shows may be an old one, until another kind was seen.

use super::items;
use super::{ENTERED_S, Executive, FlightGoal, Intent, Part, Scene};
use crate::demand::Demand;
use crate::vehicle::MAX_COORDINATE_M;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{GO_TO, GO_TO_REACHED, MISSION_CLEARED, NO_GOAL, UNGUARDED};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask};
use nalgebra::Vector3;

/// Targets that differ by less (m) are the same.
const SAME_M: f64 = 0.3;
/// The same target after this long (s) was asked for once more.
const AGAIN_S: f64 = 2.0;
/// A vehicle that is commanded to hold comes back to a place that is not farther than this from it (m) ...
const HOLDS_WITHIN_M: f64 = 4.0;
/// ... and, while it moves, than the way of a stop with this deceleration (m/s2).
const STOP_MPS2: f64 = 1.0;
/// A target that still shows after this long in Hold (s) is not that of the mode before ...
const SETTLED_S: f64 = 0.4;
/// ... and after this long where every change of mode is reported at once: meanwhile the autopilot flies there itself,
/// unguarded.
const SETTLED_AT_ONCE_S: f64 = 0.2;
/// There the mode that a target belongs to is reported within this time after it was seen first (s).
const REPORTED_AT_ONCE_S: f64 = 0.1;
/// A vehicle that is this near (m) has arrived.
const ARRIVED_M: f64 = 1.0;
/// Slower than this counts as at rest (m/s).
const REST_MPS: f64 = 0.2;

/// A place that was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoTo {
    /// In the local frame (m).
    pub place: Vector3<f64>,
    /// Counts them.
    pub serial: u32,
}

/// What the autopilot says that it flies to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Echo {
    place: Vector3<f64>,
    at: Timestamp,
}

/// Looks for places that were asked for.
#[derive(Clone, Copy, Debug)]
pub struct GoToWatch {
    last: Option<(GoTo, Timestamp)>,
    mode: NavMode,
    since: Timestamp,
    in_air: bool,
    /// The autopilot's target may be older than its mode.
    may_be_old: bool,
    /// Where the vehicle was when Hold was entered, and its speed (m/s); where it came to rest last.
    entered: Option<(Vector3<f64>, f64)>,
    /// A far target in Hold, and when it was seen first.
    candidate: Option<Echo>,
    /// The autopilot has reported its mode last.
    mode_reported: Timestamp,
    /// It reports every change of its mode at once.
    reports_at_once: bool,
    /// A target of jink's own, at rest.
    resting: Option<Echo>,
    received: Timestamp,
}

impl Default for GoToWatch {
    fn default() -> Self {
        Self {
            last: None,
            mode: NavMode::Unknown,
            since: Timestamp::NEVER,
            in_air: false,
            may_be_old: true,
            entered: None,
            candidate: None,
            mode_reported: Timestamp::NEVER,
            reports_at_once: false,
            resting: None,
            received: Timestamp::NEVER,
        }
    }
}

impl GoToWatch {
    /// The last place that was asked for.
    pub fn go_to(&self) -> Option<GoTo> {
        self.last.map(|(go_to, _)| go_to)
    }

    /// Takes note of the mode, and whether the vehicle flies.
    pub fn notice(&mut self, now: Timestamp, mode: NavMode, in_air: bool) {
        if mode != self.mode {
            // Entered in flight, the mode begins with a target of its own.
            self.may_be_old = !(self.mode != NavMode::Unknown && mode == NavMode::Offboard && in_air);
            self.mode = mode;
            self.since = now;
            self.entered = None;
            self.candidate = None;
            self.resting = None;
            self.received = Timestamp::NEVER;
        }
        self.may_be_old |= !in_air;
        self.in_air = in_air;
    }

    /// Somebody asks for a place in a message that is seen.
    pub fn take_place(&mut self, now: Timestamp, place: Vector3<f64>) {
        if !place.iter().all(|c| c.abs() <= MAX_COORDINATE_M) {
            return;
        }
        let is_known = self.last.is_some_and(|(last, seen)| {
            (last.place - place).norm() <= SAME_M && now.seconds_since(seen) <= AGAIN_S
        });
        let serial = self.last.map_or(0, |(last, _)| last.serial) + u32::from(!is_known);
        self.last = Some((GoTo { place, serial }, now));
    }

    /// What ArduCopter says that it flies to.
    pub fn take_echo(&mut self, now: Timestamp, echo: &POSITION_TARGET_LOCAL_NED_DATA) {
        if self.mode != NavMode::Offboard || !self.in_air {
            return;
        }
        self.received = now;
        let has = |ignored| !echo.type_mask.contains(ignored);
        let has_position = has(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_X_IGNORE);
        let has_velocity = has(PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VX_IGNORE);
        let place = Vector3::new(echo.x, echo.y, echo.z).map(f64::from);
        self.resting = None;
        match (has_position, has_velocity) {
            (true, false) if !self.may_be_old => self.take_place(now, place),
            (true, false) => {}
            (has_position, _) => {
                self.may_be_old = false;
                let velocity = Vector3::new(echo.vx, echo.vy, echo.vz);
                let rests = has_position && velocity.norm() < 0.05;
                self.resting = rests.then_some(Echo { place, at: now });
            }
        }
    }

    /// The autopilot has reported its mode.
    pub fn receive_mode(&mut self, now: Timestamp) {
        self.mode_reported = now;
    }

    /// Whether every change of the mode is reported at once.
    pub fn reports_at_once(&self) -> bool {
        self.reports_at_once
    }

    /// The same, in CURRENT_MODE, which comes at every change.
    pub fn receive_current_mode(&mut self, now: Timestamp) {
        self.receive_mode(now);
        self.reports_at_once = true;
    }

    /// Where PX4 says that it flies to in Hold, and where the vehicle is. A target shows before the mode that it belongs to, which
    /// an older PX4 reports once a second: there it counts once Hold was reported after it.
    pub fn take_target(
        &mut self,
        now: Timestamp,
        target: Vector3<f64>,
        position: Vector3<f64>,
        speed_mps: f64,
    ) {
        let settled_s = if self.reports_at_once {
            SETTLED_AT_ONCE_S
        } else {
            SETTLED_S
        };
        let is_settled = now.seconds_since(self.since) >= settled_s;
        if self.mode == NavMode::Hold && self.entered.is_none() {
            self.entered = Some((position, speed_mps));
        }
        // Whoever enters Hold fast runs past its place, and comes back to it.
        if speed_mps <= REST_MPS && (target - position).norm() <= HOLDS_WITHIN_M {
            self.entered = Some((position, 0.0));
        }
        let holds = |(from, speed_mps): (Vector3<f64>, f64)| {
            (target - from).norm() <= HOLDS_WITHIN_M + 0.5 * speed_mps * speed_mps / STOP_MPS2
        };
        let is_held = holds((position, speed_mps)) || self.entered.is_some_and(holds);
        let is_known = self
            .last
            .is_some_and(|(last, seen)| (last.place - target).norm() <= SAME_M && seen >= self.since);
        if !self.in_air || self.mode != NavMode::Hold || is_held || is_known {
            self.candidate = None;
            return;
        }
        let before = self
            .candidate
            .filter(|echo| (echo.place - target).norm() <= SAME_M);
        let candidate = *self.candidate.insert(before.unwrap_or(Echo {
            place: target,
            at: now,
        }));
        let is_reported = self.mode_reported > candidate.at
            || self.reports_at_once && now.seconds_since(candidate.at) >= REPORTED_AT_ONCE_S;
        if is_settled && is_reported {
            self.take_place(now, target);
        }
    }

    /// Whether the autopilot holds a place of jink's own, near `position`, so that nothing needs to be sent.
    pub fn holds_ours(&self, now: Timestamp, position: Vector3<f64>) -> bool {
        self.resting
            .is_some_and(|echo| now.seconds_since(echo.at) <= 1.0 && (echo.place - position).norm() <= 1.0)
    }

    /// Whether it is not known yet what the autopilot flies to in the mode that it has just entered; not for long.
    pub fn is_waited_for(&self, now: Timestamp) -> bool {
        const ECHO_S: f64 = 0.4;
        self.mode == NavMode::Offboard && !self.received.is_set() && now.seconds_since(self.since) <= ECHO_S
    }
}

impl Executive {
    /// A place that was asked for is flown to instead of anything else.
    pub(super) fn notice_go_to(&mut self, scene: &Scene<'_>) {
        let Some(go_to) = scene.go_to.filter(|go_to| go_to.serial != self.go_to_serial) else {
            return;
        };
        self.go_to_serial = go_to.serial;
        let in_hold = scene.mode == NavMode::Hold && self.part == Part::TakesOver && !self.halted;
        let in_offboard = scene.mode == NavMode::Offboard && self.part != Part::ShowsTheWay;
        if !scene.in_air || !scene.armed || !(in_hold || in_offboard) {
            return;
        }
        self.go_on_at(None);
        self.flight_goal = FlightGoal::GoTo(go_to.place);
        self.returns_to_hold = in_hold || self.returns_to_hold && in_offboard;
        self.asked = None;
        let away_m = scene
            .position
            .map_or(0.0, |position| (go_to.place - position).norm());
        self.report(&GO_TO, "", away_m.round());
    }

    /// Whether the autopilot flies to a place while it should be flown there.
    pub(super) fn is_going(&self, scene: &Scene<'_>) -> bool {
        self.part == Part::TakesOver
            && scene.armed
            && scene.in_air
            && matches!(self.flight_goal, FlightGoal::GoTo(_))
    }

    /// The way there is planned while the autopilot still flies itself, and it is taken over at once: it has just begun to move.
    pub(super) fn prepare_go_to(&mut self, scene: &Scene<'_>) -> Intent {
        let FlightGoal::GoTo(place) = self.flight_goal else {
            return Intent::default();
        };
        if !scene.ready {
            self.report(&UNGUARDED, "", 0.0);
            return Intent::default();
        }
        Intent {
            path: Some(items::path(place, f32::NAN, None, self.commanded_mps)),
            ..Intent::asking(self.ask(scene.now, Demand::Follow))
        }
    }

    /// What is flown while the autopilot follows setpoints.
    pub(super) fn fly(
        &mut self,
        scene: &Scene<'_>,
        place: &impl Fn(&super::client::Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        match self.flight_goal {
            FlightGoal::None => {
                // A ground station's go-to that has changed the mode shows within this time.
                let is_known = self
                    .reported
                    .is_some_and(|reported| reported.event == &MISSION_CLEARED);
                let is_due = scene.now.seconds_since(self.entered) > ENTERED_S && !is_known;
                if scene.in_air && scene.armed && is_due {
                    self.report(&NO_GOAL, "", 0.0);
                }
                Intent::default()
            }
            FlightGoal::Mission => self.fly_mission(scene, place),
            FlightGoal::GoTo(goal) => self.fly_go_to(scene, goal),
        }
    }

    fn fly_go_to(&mut self, scene: &Scene<'_>, goal: Vector3<f64>) -> Intent {
        let Some(position) = scene.position.filter(|_| scene.in_air) else {
            return Intent::default();
        };
        let is_there = (position - goal).norm() <= ARRIVED_M && scene.speed_mps <= REST_MPS;
        if is_there {
            self.report(&GO_TO_REACHED, "", 0.0);
        }
        let demand = (is_there && self.returns_to_hold)
            .then(|| self.ask(scene.now, Demand::Hold))
            .flatten();
        Intent {
            path: Some(items::path(goal, f32::NAN, None, self.commanded_mps)),
            ..Intent::asking(demand)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::GoToWatch;
    use jink_shared_types::Timestamp;
    use jink_shared_types::vehicle::NavMode;
    use nalgebra::Vector3;

    /// Hovers in Hold; from 20 s on another target shows. `reported_s` is when the mode is reported, and which one.
    fn seen(reported: &[(f64, NavMode)]) -> bool {
        let mut watch = GoToWatch::default();
        let mut mode = NavMode::Hold;
        for tick in 0..300 {
            let s = 10.0 + f64::from(tick) * 0.1;
            let now = Timestamp::from_seconds(s);
            if let Some((_, reported)) = reported.iter().find(|(at_s, _)| (at_s - s).abs() < 0.05) {
                mode = *reported;
                watch.receive_mode(now);
            }
            watch.notice(now, mode, true);
            let north_m = if s >= 20.0 { 60.0 } else { 0.0 };
            watch.take_target(
                now,
                Vector3::new(north_m, 0.0, -3.0),
                Vector3::new(0.0, 0.0, -3.0),
                0.0,
            );
        }
        watch.go_to().is_some()
    }

    /// Holds in flight at 10 s, and flies to another place at once, as after DO_REPOSITION. When that is known (s).
    fn known_s(reports_at_once: bool) -> f64 {
        let mut watch = GoToWatch::default();
        watch.notice(Timestamp::from_seconds(9.0), NavMode::Offboard, true);
        for tick in 0..300 {
            let now = Timestamp::from_seconds(10.0 + f64::from(tick) * 0.1);
            if reports_at_once && tick == 0 {
                watch.receive_current_mode(now);
            } else if tick % 10 == 0 {
                watch.receive_mode(now);
            }
            watch.notice(now, NavMode::Hold, true);
            let target = Vector3::new(60.0, 0.0, -3.0);
            watch.take_target(now, target, Vector3::new(0.0, 0.0, -3.0), 3.0);
            if watch.go_to().is_some() {
                return now.seconds_since(Timestamp::from_seconds(10.0));
            }
        }
        f64::INFINITY
    }

    #[test]
    fn who_reports_changes_of_mode_at_once_is_taken_over_from_at_once() {
        assert!(known_s(true) < 0.35, "{}", known_s(true));
        assert!((0.9..1.2).contains(&known_s(false)), "{}", known_s(false));
    }

    #[test]
    fn the_target_of_a_mission_that_is_reported_later_is_no_go_to() {
        assert!(!seen(&[(15.0, NavMode::Hold)]), "not known yet whose it is");
        assert!(!seen(&[(15.0, NavMode::Hold), (20.8, NavMode::Mission)]));
        assert!(seen(&[(15.0, NavMode::Hold), (20.8, NavMode::Hold)]));
    }
}
