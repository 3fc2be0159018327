//! What an automatic mode means as waypoints: take-off, hold, mission, return, landing.
//!
//! | in | out |
//! |---|---|
//! | mode, estimate, mission, parameters | a [`Triplet`] for the flight task |
//! | | [`NavigatorEvents`]: item reached, mission finished, take-off finished |

pub mod input;
mod mission_run;
mod work;

use super::firmware::Firmware;
use super::parameters::Parameter as P;
use super::return_home::ReturnHome;
use super::setpoint::{CurrentPoint, PointKind, Triplet};
use input::NavigatorInput;
use jink_emulated_autopilot::mission::{Jumps, single};
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;
use work::{HeightPatience, Work};

/// Time at full speed that current PX4 allows for before it decelerates (s). From the ways it was observed to go on in Hold
/// after the loss of OFFBOARD setpoints at 4.5 and 8 m/s: all of them end at `v^2 / (2 MPC_ACC_HOR) + 0.6 s v`.
const STOP_DELAY_S: f64 = 0.6;

/// What happened in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NavigatorEvents {
    /// This item has been reached.
    pub reached: Option<usize>,
    /// The last item is done.
    pub mission_finished: bool,
    /// The take-off height has been reached.
    pub takeoff_finished: bool,
    /// The mission asks for a return.
    pub wants_return: bool,
    /// A return begins, at this height above home (m), and somebody is to be notified of it.
    pub return_started: Option<f64>,
}

/// A place to go to, as DO_REPOSITION names it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reposition {
    /// Where, local NED (m).
    pub position: Vector3<f64>,
    /// Speed (m/s); not positive or NaN = that of the mission.
    pub speed_mps: f64,
    /// Heading (rad); NaN = none.
    pub yaw_rad: f64,
}

/// The navigator.
#[derive(Clone, Debug)]
pub struct Navigator {
    firmware: Firmware,
    triplet: Triplet,
    mode: NavMode,
    may_loiter_at_point: bool,
    takeoff_reached: bool,
    item: usize,
    jumps: Jumps,
    /// The item that MISSION_CURRENT names.
    shown_item: usize,
    reposition: Option<CurrentPoint>,
    work: Work,
    finished: bool,
    /// What MISSION_CURRENT says: a take-off that is over counts as a mission that is done.
    says_finished: bool,
    has_reached_items: bool,
    stayed_s: f64,
    speed_mps: f64,
    return_home: ReturnHome,
    height: HeightPatience,
}

impl Navigator {
    /// Going nowhere.
    pub fn new(firmware: Firmware) -> Self {
        Self {
            firmware,
            triplet: Triplet::default(),
            mode: NavMode::Unknown,
            may_loiter_at_point: false,
            takeoff_reached: false,
            item: 0,
            jumps: Jumps::default(),
            shown_item: 0,
            reposition: None,
            work: Work::Item,
            finished: false,
            says_finished: false,
            has_reached_items: false,
            stayed_s: 0.0,
            speed_mps: -1.0,
            return_home: ReturnHome::default(),
            height: HeightPatience::default(),
        }
    }

    /// The waypoints in force.
    pub fn triplet(&self) -> &Triplet {
        &self.triplet
    }

    /// Mission item being flown.
    pub fn item(&self) -> usize {
        self.item
    }

    /// The item that MISSION_CURRENT names. A command that sets another one while the mission is not flown does not show.
    pub fn shown_item(&self) -> usize {
        self.shown_item
    }

    /// Whether the last item is done.
    pub fn mission_finished(&self) -> bool {
        self.finished
    }

    /// Whether a take-off or the last item is done, and the mission was not entered since.
    pub fn says_finished(&self) -> bool {
        self.says_finished
    }

    /// Whether an item was reached since the mission was uploaded.
    pub fn has_reached_items(&self) -> bool {
        self.has_reached_items
    }

    /// The mission is another one now.
    pub fn start_over(&mut self) {
        self.jump_to(0);
        self.jumps.reset();
        self.show_item();
        self.says_finished = false;
        self.has_reached_items = false;
    }

    /// Goes on with the mission at `item`.
    pub fn jump_to(&mut self, item: usize) {
        self.item = item;
        self.finished = false;
        self.stayed_s = 0.0;
        self.work = Work::Item;
        if self.mode == NavMode::Mission {
            // Entered anew in the next cycle, on a leg that begins where the vehicle is.
            self.mode = NavMode::Unknown;
            self.triplet = Triplet::default();
        }
    }

    /// MISSION_CURRENT names the item that is flown, or will be.
    pub fn show_item(&mut self) {
        self.shown_item = self.item;
    }

    /// Goes to a place in Hold, from wherever the vehicle is then.
    pub fn reposition(&mut self, place: &Reposition, acceptance_m: f64) {
        let cruise_mps = if place.speed_mps > 0.0 {
            place.speed_mps
        } else {
            self.speed_mps
        };
        self.reposition = Some(CurrentPoint {
            kind: PointKind::Loiter,
            position: single(place.position),
            yaw_rad: place.yaw_rad,
            acceptance_m,
            cruise_mps,
        });
    }

    /// Another mission speed (m/s); not positive = the default.
    pub fn set_speed(&mut self, speed_mps: f64) {
        self.speed_mps = if speed_mps > 0.0 { speed_mps } else { -1.0 };
        if let Some(current) = &mut self.triplet.current {
            current.cruise_mps = self.speed_mps;
        }
    }

    /// One cycle.
    pub fn step(&mut self, input: &NavigatorInput) -> NavigatorEvents {
        let mut events = NavigatorEvents::default();
        if input.mode != self.mode {
            self.mode = input.mode;
            self.enter(input, &mut events);
        }
        match self.mode {
            NavMode::Hold => {
                self.hold_on_ground(input);
                self.go_to_reposition(input);
            }
            NavMode::Takeoff => self.watch_takeoff(input, &mut events),
            NavMode::Mission => self.run_mission(input, &mut events),
            NavMode::Return => {
                if let Some(point) = self.return_home.step(input) {
                    self.go_to(point);
                }
            }
            _ => {}
        }
        if self.mode == NavMode::Mission {
            self.show_item();
        }
        self.says_finished |= events.takeoff_finished || events.mission_finished;
        self.has_reached_items |= events.reached.is_some();
        events
    }

    /// The leg begins where the vehicle is, whatever it flew before.
    fn go_to_reposition(&mut self, input: &NavigatorInput) {
        let Some(point) = self.reposition.take_if(|_| input.armed) else {
            return;
        };
        self.triplet = Triplet {
            previous: Some(single(input.estimate.position.vector())),
            current: Some(point),
            next: None,
        };
        self.may_loiter_at_point = true;
    }

    fn enter(&mut self, input: &NavigatorInput, events: &mut NavigatorEvents) {
        match self.mode {
            NavMode::Hold => self.enter_hold(input),
            NavMode::Takeoff => self.enter_takeoff(input),
            NavMode::Mission => {
                if self.finished {
                    self.item = 0;
                    self.jumps.reset();
                    self.finished = false;
                }
                self.says_finished = false;
                self.may_loiter_at_point = false;
                self.start_item(input, events);
            }
            NavMode::Return => {
                let point = self.return_home.start(input);
                self.may_loiter_at_point = false;
                self.speed_mps = -1.0;
                self.go_to(point);
                if self.firmware.announces_returns() {
                    events.return_started = Some(self.return_home.height_m());
                }
            }
            NavMode::Land => self.enter_land(input),
            _ => {
                self.triplet = Triplet::default();
                self.may_loiter_at_point = false;
            }
        }
    }

    /// A take-off that was under way goes on, because its waypoint counts as a place to hold. Otherwise the place is where
    /// the vehicle is or can stop, and on the ground there is none.
    fn enter_hold(&mut self, input: &NavigatorInput) {
        let place = match self.triplet.current {
            Some(current) if self.may_loiter_at_point => current.position,
            _ if input.landed => {
                self.triplet = Triplet::default();
                return;
            }
            _ if self.firmware.holds_where_it_can_stop() => single(stopping_point(input)),
            _ => single(input.estimate.position.vector()),
        };
        self.may_loiter_at_point = true;
        self.go_to(self.point(input, PointKind::Loiter, place));
    }

    /// Disarmed on the ground there is no waypoint at all; armed, the motors idle until somebody wants to fly.
    fn hold_on_ground(&mut self, input: &NavigatorInput) {
        if !input.armed && input.landed {
            self.triplet = Triplet::default();
            self.may_loiter_at_point = false;
        } else if self.triplet.current.is_none() {
            let kind = if input.landed {
                PointKind::Idle
            } else {
                PointKind::Loiter
            };
            let place = single(input.estimate.position.vector());
            self.go_to(self.point(input, kind, place));
        }
    }

    fn enter_takeoff(&mut self, input: &NavigatorInput) {
        let here = single(input.estimate.position.vector());
        let wanted_down = input.home.z - input.parameters.get(P::MIS_TAKEOFF_ALT);
        let place = single(Vector3::new(here.x, here.y, wanted_down.min(here.z)));
        self.takeoff_reached = false;
        self.may_loiter_at_point = true;
        self.triplet = Triplet::default();
        self.go_to(self.point(input, PointKind::Takeoff, place));
    }

    fn watch_takeoff(&mut self, input: &NavigatorInput, events: &mut NavigatorEvents) {
        let Some(current) = self.triplet.current else {
            return;
        };
        let left_m = input.estimate.position.z_m - current.position.z;
        if !self.takeoff_reached && !input.landed && left_m < input.parameters.get(P::NAV_MC_ALT_RAD) {
            self.takeoff_reached = true;
            events.takeoff_finished = true;
        }
    }

    /// The landing place is where the vehicle is, and its height is the sea's: PX4 asks for "altitude 0".
    fn enter_land(&mut self, input: &NavigatorInput) {
        let place = Vector3::new(f64::NAN, f64::NAN, input.frame.origin_altitude_m);
        self.may_loiter_at_point = false;
        self.triplet = Triplet::default();
        self.go_to(self.point(input, PointKind::Land, place));
    }

    fn point(&self, input: &NavigatorInput, kind: PointKind, position: Vector3<f64>) -> CurrentPoint {
        CurrentPoint {
            kind,
            position,
            yaw_rad: f64::NAN,
            acceptance_m: input.parameters.get(P::NAV_ACC_RAD),
            cruise_mps: self.speed_mps,
        }
    }

    /// Makes `point` the current waypoint and the one before it the previous.
    fn go_to(&mut self, point: CurrentPoint) {
        let before = self.triplet.current.map(|c| c.position);
        let moved = before.is_none_or(|p| p != point.position);
        if moved {
            self.triplet.previous = before.filter(|p| p.iter().all(|c| c.is_finite()));
        }
        self.triplet.current = Some(point);
        self.triplet.next = None;
    }
}

/// Where a gentle stop ends: constant deceleration MPC_ACC_HOR after [`STOP_DELAY_S`] at full speed. It is level: vertical
/// speed dies out on the way.
fn stopping_point(input: &NavigatorInput) -> Vector3<f64> {
    let position = input.estimate.position.vector();
    let velocity = input.estimate.velocity.vector().xy();
    let speed_mps = velocity.norm();
    let deceleration_mps2 = input.parameters.get(P::MPC_ACC_HOR).max(f64::EPSILON);
    let ahead = velocity * (speed_mps / (2.0 * deceleration_mps2) + STOP_DELAY_S);
    position + Vector3::new(ahead.x, ahead.y, 0.0)
}
