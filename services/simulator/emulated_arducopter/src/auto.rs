//! AUTO: the mission, item by item. Item 0 is home and is never flown; leaving the mode and coming back goes on at the item
//! that was flown last, from wherever the vehicle is then, or with MIS_RESTART at the first one.
//!
//! Before the mission has ever begun no item is current, which is reported as 0.

use super::land::{Return, descend};
use super::leg::Leg;
use super::parameters::{Parameter as P, Parameters};
use super::position_control::{Motion, PositionControl};
use super::takeoff::{Takeoff, TakeoffStep};
use jink_emulated_autopilot::mission::{Jumps, Mission, MissionFrame, Task, place_from};
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::{Vector2, Vector3};

/// The first item that is flown.
const FIRST: usize = 1;

/// What a step looks at.
#[derive(Clone, Copy, Debug)]
pub struct AutoInput<'a> {
    /// Time since boot (us).
    pub now_us: u64,
    /// Standing on the ground.
    pub landed: bool,
    /// Somebody wants to fly: MISSION_START was given, or it is in the air.
    pub may_take_off: bool,
    /// Where the vehicle is.
    pub estimate: &'a Estimate,
    /// Home, local NED (m).
    pub home: Vector3<f64>,
    /// Values in force.
    pub parameters: &'a Parameters,
    /// The items.
    pub mission: &'a Mission,
    /// How they become local.
    pub frame: &'a MissionFrame,
}

/// What a step leads to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AutoStep {
    /// The reference is to be followed; otherwise motors idle.
    pub flying: bool,
    /// Motors may be disarmed on the ground: it is a landing.
    pub landing: bool,
    /// An item was reached.
    pub reached: Option<u16>,
}

#[derive(Clone, Debug)]
enum Doing {
    /// The current item has not begun.
    Begin,
    TakeOff(Takeoff),
    Fly {
        leg: Leg,
        hold_us: u64,
        arrived_us: Option<u64>,
    },
    LoiterForever(Leg),
    Approach(Leg),
    Descend,
    Return(Return),
    /// Nothing is left: stay.
    Rest,
}

/// How far the mission is, whatever the mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Not begun, or left.
    #[default]
    Stopped,
    /// Being flown.
    Running,
    /// The last item is done.
    Complete,
}

/// The mode's state.
#[derive(Clone, Debug)]
pub struct Auto {
    /// `None` = the mission has not begun.
    current: Option<usize>,
    jumps: Jumps,
    state: State,
    doing: Doing,
    paused: bool,
    /// The last item was done since the mode was entered.
    finished: bool,
}

impl Default for Auto {
    fn default() -> Self {
        Self {
            current: None,
            jumps: Jumps::default(),
            state: State::Stopped,
            doing: Doing::Begin,
            paused: false,
            finished: false,
        }
    }
}

impl Auto {
    /// Enters the mode: the current item begins again, a finished mission from its start. `restarts`: so does any.
    pub fn enter(&mut self, mission: &Mission, restarts: bool) {
        let known = self.current.filter(|current| *current < mission.len());
        let resumed = known.filter(|_| !restarts && self.state != State::Complete);
        if resumed.is_none() {
            self.jumps.reset();
        }
        self.current = Some(resumed.unwrap_or(FIRST));
        self.state = State::Running;
        self.doing = Doing::Begin;
        self.paused = false;
        self.finished = false;
    }

    /// Another mode begins.
    pub fn leave(&mut self) {
        if self.state == State::Running {
            self.state = State::Stopped;
        }
    }

    /// Goes on at `item`, or the first behind it that leads somewhere. Returns whether there is one.
    pub fn jump_to(&mut self, item: usize, mission: &Mission) -> bool {
        let item = item.max(FIRST);
        self.doing = Doing::Begin;
        self.finished = false;
        if self.state == State::Running {
            self.current = Some(item);
            return true;
        }
        self.current = (item..mission.len()).find(|index| {
            let task = mission.task(*index);
            task.is_some_and(|task| task.has_place() || task == Task::Return)
        });
        self.state = State::Stopped;
        self.current.is_some()
    }

    /// The items are other ones; which is current stays. Returns whether the one that is flown begins anew.
    pub fn take_change(&mut self) -> bool {
        self.jumps.reset();
        let restarts = self.state == State::Running && matches!(self.doing, Doing::Fly { .. });
        if restarts {
            self.doing = Doing::Begin;
        }
        restarts
    }

    /// Motors stopped: the mission begins anew, at once with its first item if the mode is in force.
    pub fn rewind(&mut self, in_force: bool) {
        self.doing = Doing::Begin;
        self.jumps.reset();
        self.current = in_force.then_some(FIRST);
        self.state = if in_force { State::Running } else { State::Stopped };
    }

    /// There are no items any more.
    pub fn forget(&mut self) {
        self.current = None;
        self.state = State::Stopped;
        self.doing = Doing::Begin;
        self.paused = false;
        self.finished = false;
        self.jumps.reset();
    }

    /// Item being flown, or to be flown; 0 = the mission has not begun.
    pub fn current(&self) -> usize {
        self.current.unwrap_or(0)
    }

    /// How far the mission is.
    pub fn state(&self) -> State {
        self.state
    }

    /// The last one is done.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// DO_PAUSE_CONTINUE: only on the way to a waypoint. Returns whether that can be done.
    pub fn pause(&mut self, paused: bool, control: &PositionControl) -> bool {
        let Doing::Fly { leg, .. } = &mut self.doing else {
            return false;
        };
        if !paused {
            *leg = Leg::new(control.desired(), leg.destination());
        }
        self.paused = paused;
        true
    }

    /// Moves the reference on by a step.
    pub fn step(&mut self, input: &AutoInput<'_>, control: &mut PositionControl) -> AutoStep {
        let mut step = AutoStep::default();
        if !input.may_take_off {
            return step;
        }
        if matches!(self.doing, Doing::Begin) {
            self.begin(input, control);
        }
        step.flying = true;
        let mut done = false;
        match &mut self.doing {
            Doing::Begin | Doing::Rest => {
                step.flying = !input.landed;
                step.landing = input.landed && self.state == State::Complete;
                stay(control);
            }
            Doing::TakeOff(takeoff) => {
                match takeoff.step(input.now_us, input.estimate, input.parameters, control) {
                    TakeoffStep::Wait => step.flying = false,
                    TakeoffStep::Climb => {}
                    TakeoffStep::Done => done = true,
                }
            }
            Doing::Fly { .. } if self.paused => stay(control),
            Doing::Fly {
                leg,
                hold_us,
                arrived_us,
            } => {
                let limits = control.limits;
                leg.step(&limits, control);
                let radius_m = input.parameters.hundredth(P::WPNAV_RADIUS);
                let near = (input.estimate.position.vector() - leg.destination()).norm() < radius_m;
                if near && (leg.has_arrived() || *hold_us == 0) {
                    let since_us = *arrived_us.get_or_insert(input.now_us);
                    done = input.now_us >= since_us + *hold_us;
                }
            }
            Doing::LoiterForever(leg) => {
                let limits = control.limits;
                leg.step(&limits, control);
            }
            Doing::Approach(leg) => {
                let limits = control.limits;
                leg.step(&limits, control);
                if leg.has_arrived() {
                    self.doing = Doing::Descend;
                }
            }
            Doing::Descend => {
                descend(input.estimate, input.home.z, input.parameters, control);
                step.landing = input.landed;
                done = input.landed;
            }
            Doing::Return(back) => {
                back.step(
                    input.now_us,
                    input.home,
                    input.estimate,
                    input.parameters,
                    control,
                );
                step.landing = input.landed && back.is_landing();
                done = step.landing;
            }
        }
        if done {
            let reached = self.current();
            step.reached = Some(reached as u16);
            self.current = Some(reached + 1);
            self.doing = Doing::Begin;
            self.begin(input, control);
        }
        step
    }

    /// Begins the current item, passing over those that are done at once.
    fn begin(&mut self, input: &AutoInput<'_>, control: &mut PositionControl) {
        loop {
            let followed = self.jumps.follow(input.mission, self.current());
            let Some((current, item)) = followed.and_then(|at| Some((at, input.mission.get(at)?))) else {
                self.current = Some(input.mission.len().saturating_sub(1));
                self.state = State::Complete;
                self.finished = true;
                self.doing = Doing::Rest;
                return;
            };
            self.current = Some(current);
            let place = place_from(item, input.frame, control.desired().position);
            let leg = |to: Vector3<f64>| Leg::new(control.desired(), to);
            self.doing = match input.mission.task(current) {
                Some(Task::Takeoff) => {
                    let mut takeoff = Takeoff::default();
                    takeoff.begin(input.now_us, place.z.min(input.estimate.position.z_m));
                    Doing::TakeOff(takeoff)
                }
                Some(Task::Waypoint { hold_s, .. }) => Doing::Fly {
                    leg: leg(place),
                    hold_us: (hold_s * 1e6) as u64,
                    arrived_us: None,
                },
                Some(Task::LoiterForever) => Doing::LoiterForever(leg(place)),
                Some(Task::Land) => {
                    // At the height the vehicle has; without a place, here.
                    let at = control.desired().position;
                    let somewhere = item.x != 0 || item.y != 0;
                    let over = if somewhere { place } else { at };
                    Doing::Approach(leg(Vector3::new(over.x, over.y, at.z)))
                }
                Some(Task::Return) => {
                    let mut back = Return::default();
                    back.begin(input.home, input.estimate, input.parameters, control);
                    Doing::Return(back)
                }
                Some(Task::Speed(mps)) => {
                    if mps > 0.0 {
                        control.limits.speed_mps = mps;
                    }
                    self.current = Some(current + 1);
                    continue;
                }
                Some(Task::Jump { .. }) | None => {
                    self.current = Some(current + 1);
                    continue;
                }
            };
            return;
        }
    }
}

fn stay(control: &mut PositionControl) {
    control.follow_velocity(Vector2::zeros(), Vector2::zeros());
    let level = Motion {
        position: control.desired().position,
        ..Motion::default()
    };
    control.follow_height(&level);
}
