//! A ground station that flies a plan over MAVLink.
//!
//! | in | out |
//! |---|---|
//! | messages of the autopilot, a [`FlightPlan`] | messages to it, [`Progress`] |
//!
//! It does what a person at a ground station does: waits for the autopilot and its position, uploads the mission, holds,
//! arms, takes off, flies the mission, lands, waits for the motors to stop. Everything is ordinary MAVLink, repeated
//! until it is seen to work, and in flight it does what its plan says ([`InFlight`]). So it flies a real PX4 or ArduCopter as well as the simulated ones. Every phase has a time
//! limit and ends in a named failure.

mod in_flight;
mod item;
mod make;
mod plan;
mod upload;

pub use in_flight::{Action, InFlight, When};
pub use item::PlanItem;
pub use make::Make;
pub use plan::{Ending, FlightPlan};

use in_flight::Acting;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use make::command;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, HEARTBEAT_DATA, MISSION_CLEAR_ALL_DATA, MavAutopilot, MavCmd,
    MavFrame, MavMessage, MavMissionType, MavModeFlag, MavParamType, MavResult, MavState, MavType,
    PARAM_SET_DATA,
};
use upload::Upload;

/// Our address: what ground stations use.
const SYSTEM_ID: u8 = 255;
const COMPONENT_ID: u8 = 190;
/// Requests that have shown no effect are repeated after this (s).
const REPEAT_S: f64 = 1.0;
/// A message without an answer is said so often.
const SAID_ENOUGH: u32 = 3;
/// A waypoint on the way, and the last one, counts as reached this near (m) when nobody says so: an autopilot that follows
/// setpoints (OFFBOARD, GUIDED) does not announce the items of its mission.
const REACHED_M: [f64; 2] = [1.0, 0.5];
/// Height missing to the take-off height at which the mission may start (m).
const TAKEOFF_SLACK_M: f64 = 0.4;
/// A vehicle that holds after this time (s), at this height (m) and more, goes on from there: it may not come higher where its sensors do
/// not look up.
const TAKEOFF_S: f64 = 12.0;
const TAKEOFF_LEAST_M: f64 = 1.0;

macro_rules! phases {
    ($( $(#[$meta:meta])* $name:ident = $text:literal, $limit_s:expr; )*) => {
        /// Where the flight is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Phase {
            $( $(#[$meta])* $name, )*
        }

        impl Phase {
            /// Name in lower case.
            pub fn name(self) -> &'static str {
                match self { $( Self::$name => $text, )* }
            }

            /// Longest time it may take (s).
            fn limit_s(self) -> f64 {
                match self { $( Self::$name => $limit_s, )* }
            }
        }
    };
}
phases! {
    /// Waiting for the autopilot's heartbeat.
    Connect = "connect", 60.0;
    /// Waiting for its position.
    Position = "position", 90.0;
    /// Uploading the mission.
    Upload = "upload", 30.0;
    /// Setting the mode in which motors are armed.
    Ready = "ready", 20.0;
    /// Arming; refusals are repeated, their reason is kept.
    Arm = "arm", 120.0;
    /// Climbing.
    Takeoff = "takeoff", 60.0;
    /// Setting and flying the mission. Its limit is the plan's own.
    Mission = "mission", f64::INFINITY;
    /// Coming down.
    Land = "land", 180.0;
    /// Over.
    Done = "done", f64::INFINITY;
}

/// How a flight ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Every item reached, ending as planned.
    Done,
    /// A phase took too long.
    TimedOut {
        /// Which one.
        phase: Phase,
        /// Its limit (s).
        limit_s: f64,
        /// The last thing the autopilot said, or what was missing.
        reason: String,
    },
    /// The autopilot refused the mission.
    MissionRefused {
        /// MAV_MISSION_RESULT.
        result: u32,
    },
}

/// What a person wants to see.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Phase.
    pub phase: Phase,
    /// Mode the autopilot reports.
    pub mode: NavMode,
    /// Waypoints reached.
    pub reached: usize,
    /// Waypoints.
    pub waypoints: usize,
    /// Distance to the last waypoint (m); NaN while unknown.
    pub to_goal_m: f64,
    /// Times the autopilot left the mission unasked.
    pub fell_out: u32,
    /// The last thing the autopilot said.
    pub said: String,
    /// Set when the flight is over.
    pub outcome: Option<Outcome>,
}

/// The ground station.
#[derive(Clone, Debug)]
pub struct GroundStation {
    plan: FlightPlan,
    progress: Progress,
    phase_since_s: f64,
    asked_s: f64,
    heartbeat_s: f64,
    sequence: u8,
    vehicle: Vehicle,
    upload: Option<Upload>,
    acting: Acting,
}

/// What is known of the vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct Vehicle {
    system_id: Option<u8>,
    make: Make,
    armed: bool,
    global: Option<GlobalPoint>,
    /// Height above the sea (m).
    altitude_m: f64,
    local: Option<Point<LocalNed>>,
    /// Down coordinate when the plan was made: the ground.
    ground_down_m: f64,
}

impl GroundStation {
    /// For one flight of `plan`.
    pub fn new(plan: FlightPlan) -> Self {
        Self {
            progress: Progress {
                phase: Phase::Connect,
                mode: NavMode::Unknown,
                reached: 0,
                waypoints: plan.waypoints.len(),
                to_goal_m: f64::NAN,
                fell_out: 0,
                said: String::new(),
                outcome: None,
            },
            plan,
            phase_since_s: 0.0,
            asked_s: f64::NEG_INFINITY,
            heartbeat_s: f64::NEG_INFINITY,
            sequence: 0,
            vehicle: Vehicle::default(),
            upload: None,
            acting: Acting::default(),
        }
    }

    /// The latest progress.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Takes what has arrived by `now_s` (any steady clock) and appends what is to be sent.
    pub fn step(
        &mut self,
        now_s: f64,
        inbox: &[(MavHeader, MavMessage)],
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) {
        for (header, message) in inbox {
            self.receive(now_s, header, message, outbox);
        }
        if now_s - self.heartbeat_s >= 1.0 {
            self.heartbeat_s = now_s;
            self.send(outbox, heartbeat());
        }
        if self.progress.outcome.is_none() {
            self.act(now_s, outbox);
            self.check_limit(now_s);
        }
    }

    fn receive(
        &mut self,
        now_s: f64,
        header: &MavHeader,
        message: &MavMessage,
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) {
        let from = header.system_id as u8;
        if header.component_id != 1 || self.vehicle.system_id.is_some_and(|id| id != from) {
            return;
        }
        match message {
            MavMessage::HEARTBEAT(beat) if beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID => {
                self.vehicle.system_id = Some(from);
                self.vehicle.armed = beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.vehicle.make = Make::of(beat.autopilot);
                self.note_mode(self.vehicle.make.mode(beat.custom_mode));
            }
            MavMessage::GLOBAL_POSITION_INT(p) => {
                self.vehicle.global = Some(GlobalPoint::from_e7(p.lat, p.lon));
                self.vehicle.altitude_m = f64::from(p.alt) * 1e-3;
            }
            MavMessage::LOCAL_POSITION_NED(p) => {
                let position = Point::new(f64::from(p.x), f64::from(p.y), f64::from(p.z));
                self.vehicle.local = Some(position);
                if let Some(goal) = self.plan.waypoints.last() {
                    self.progress.to_goal_m = (goal.vector() - position.vector()).norm();
                }
                self.note_place(position);
            }
            MavMessage::STATUSTEXT(text) => {
                self.progress.said = text.text.to_str().unwrap_or("").to_owned();
            }
            MavMessage::COMMAND_ACK(ack) if self.is_answer(ack.command) => {
                self.acting.answered |= ack.result == MavResult::MAV_RESULT_ACCEPTED;
            }
            // The autopilot flies it from now on; a heartbeat may report that only a second later.
            MavMessage::COMMAND_ACK(ack) if self.starts_mission(ack) => self.note_mode(NavMode::Mission),
            MavMessage::MISSION_CURRENT(current) if self.is_chosen(current.seq) => {
                self.acting.answered = true;
            }
            MavMessage::MISSION_ACK(_) if self.clears_mission() => self.acting.answered = true,
            MavMessage::COMMAND_ACK(ack)
                if ack.result != MavResult::MAV_RESULT_ACCEPTED && self.progress.said.is_empty() =>
            {
                self.progress.said = format!("{:?} answered {:?}", ack.command, ack.result);
            }
            MavMessage::MISSION_ITEM_REACHED(item) => self.note_reached(item.seq),
            _ => {}
        }
        let answer = self
            .upload
            .as_mut()
            .and_then(|upload| upload.receive(now_s, message));
        if let Some(answer) = answer {
            self.send(outbox, answer);
        }
    }

    fn note_mode(&mut self, mode: NavMode) {
        let flown = matches!(self.progress.mode, NavMode::Mission | NavMode::Offboard);
        let left = flown && mode == NavMode::Hold;
        if self.progress.phase == Phase::Mission && left && !self.is_finished() {
            self.progress.fell_out += 1;
        }
        self.progress.mode = mode;
    }

    fn note_reached(&mut self, sequence: u16) {
        let first = self.plan.items_before_waypoints(self.vehicle.make);
        let reached = (usize::from(sequence) + 1).saturating_sub(first);
        self.progress.reached = self.progress.reached.max(reached.min(self.plan.waypoints.len()));
    }

    /// Waypoints that were flown to by setpoints.
    fn note_place(&mut self, position: Point<LocalNed>) {
        if self.progress.phase != Phase::Mission || self.progress.mode != NavMode::Offboard {
            return;
        }
        let Some(next) = self.plan.waypoints.get(self.progress.reached) else {
            return;
        };
        let [on_the_way_m, last_m] = REACHED_M;
        let is_last = self.progress.reached + 1 == self.plan.waypoints.len();
        let near_m = if is_last { last_m } else { on_the_way_m };
        if (next.vector() - position.vector()).norm() < near_m {
            self.progress.reached += 1;
        }
    }

    fn is_finished(&self) -> bool {
        self.progress.reached >= self.plan.waypoints.len()
    }

    fn enter(&mut self, phase: Phase, now_s: f64) {
        self.progress.phase = phase;
        self.phase_since_s = now_s;
        self.asked_s = f64::NEG_INFINITY;
        if phase == Phase::Done {
            self.progress.outcome = Some(Outcome::Done);
        }
    }

    /// Whether it is time to ask again.
    fn may_ask(&mut self, now_s: f64) -> bool {
        let due = now_s - self.asked_s >= REPEAT_S;
        if due {
            self.asked_s = now_s;
        }
        due
    }

    fn act(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        match self.progress.phase {
            Phase::Connect => {
                if self.vehicle.system_id.is_some() {
                    self.enter(Phase::Position, now_s);
                }
            }
            Phase::Position => {
                if let (Some(_), Some(local)) = (self.vehicle.global, self.vehicle.local) {
                    self.vehicle.ground_down_m = local.z_m;
                    self.set_takeoff_height(outbox);
                    self.enter(Phase::Upload, now_s);
                } else if self.may_ask(now_s) {
                    for request in self.vehicle.make.requests(self.target()) {
                        self.send(outbox, request);
                    }
                }
            }
            Phase::Upload => self.act_upload(now_s, outbox),
            Phase::Ready => self.reach_mode(self.vehicle.make.arming_mode(), Phase::Arm, now_s, outbox),
            Phase::Arm => {
                if self.vehicle.armed {
                    self.enter(Phase::Takeoff, now_s);
                } else if self.may_ask(now_s) {
                    self.arm(outbox);
                }
            }
            Phase::Takeoff => self.act_takeoff(now_s, outbox),
            Phase::Mission => self.act_mission(now_s, outbox),
            Phase::Land => {
                let mode = self.plan.ending.mode();
                if !self.vehicle.armed {
                    self.enter(Phase::Done, now_s);
                } else if let Some(mode) = mode.filter(|mode| self.progress.mode != *mode)
                    && self.progress.mode != NavMode::Land
                    && self.may_ask(now_s)
                {
                    self.set_mode(outbox, mode);
                }
            }
            Phase::Done => {}
        }
    }

    fn act_upload(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        if self.upload_plan(now_s, outbox) {
            self.enter(Phase::Ready, now_s);
        }
    }

    /// Uploads the plan's mission. Returns whether the autopilot has it.
    fn upload_plan(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) -> bool {
        let (Some(global), Some(local)) = (self.vehicle.global, self.vehicle.local) else {
            return false;
        };
        let target = self.target();
        let (plan, vehicle) = (&self.plan, self.vehicle);
        let upload = self.upload.get_or_insert_with(|| {
            let items = plan.items(vehicle.make, global, local, vehicle.ground_down_m, target);
            Upload::new(items, target)
        });
        match upload.result() {
            Some(0) => {
                self.upload = None;
                return true;
            }
            Some(result) => self.progress.outcome = Some(Outcome::MissionRefused { result }),
            None => {
                if let Some(message) = upload.announce(now_s) {
                    self.send(outbox, message);
                }
            }
        }
        false
    }

    fn act_takeoff(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        let height_m = self
            .vehicle
            .local
            .map_or(0.0, |p| self.vehicle.ground_down_m - p.z_m);
        let holds = self.progress.mode == NavMode::Hold
            && height_m >= TAKEOFF_LEAST_M
            && now_s - self.phase_since_s >= TAKEOFF_S;
        if holds || height_m >= self.plan.takeoff_height_m - TAKEOFF_SLACK_M {
            self.enter(Phase::Mission, now_s);
        } else if self.vehicle.make.takes_off_with_the_mission() {
            if self.progress.mode != NavMode::Mission && height_m < 0.5 && self.may_ask(now_s) {
                let target = self.target();
                self.send(outbox, command(MavCmd::MAV_CMD_MISSION_START, [0.0; 3], target));
            }
        } else if self.progress.mode != NavMode::Takeoff && height_m < 0.5 && self.may_ask(now_s) {
            // Again, in case the first one was lost.
            self.set_takeoff_height(outbox);
            self.set_mode(outbox, NavMode::Takeoff);
        }
    }

    fn act_mission(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        if self.act_in_flight(now_s, outbox) || self.acting.hands_off {
            return;
        }
        let is_by_pilot = matches!(self.progress.mode, NavMode::Position | NavMode::Manual);
        if self.is_finished() {
            match self.plan.ending {
                Ending::Hold => self.enter(Phase::Done, now_s),
                Ending::Land | Ending::Return | Ending::Mission => self.enter(Phase::Land, now_s),
            }
        } else if !matches!(self.progress.mode, NavMode::Mission | NavMode::Offboard)
            && (self.plan.resume || self.progress.fell_out == 0 && !is_by_pilot)
            && self.may_ask(now_s)
        {
            self.set_mode(outbox, NavMode::Mission);
        }
    }

    /// The action under way, if there is one.
    fn action(&self) -> Option<&Action> {
        let action = self.plan.in_flight.get(self.acting.index);
        action.filter(|_| self.acting.begun).map(|step| &step.action)
    }

    fn is_answer(&self, to: MavCmd) -> bool {
        match self.action() {
            Some(Action::GoTo(_)) => to == MavCmd::MAV_CMD_DO_REPOSITION,
            Some(Action::Orbit(_)) => to == MavCmd::MAV_CMD_DO_ORBIT,
            Some(Action::Mode(_)) => to == MavCmd::MAV_CMD_DO_SET_MODE,
            _ => false,
        }
    }

    fn is_chosen(&self, sequence: u16) -> bool {
        matches!(self.action(), Some(Action::SetCurrent { item }) if *item == sequence)
    }

    fn clears_mission(&self) -> bool {
        matches!(self.action(), Some(Action::ClearMission))
    }

    /// Whether the request to fly the mission was accepted.
    fn starts_mission(&self, ack: &COMMAND_ACK_DATA) -> bool {
        ack.command == MavCmd::MAV_CMD_DO_SET_MODE
            && ack.result == MavResult::MAV_RESULT_ACCEPTED
            && self.progress.phase == Phase::Mission
            && self.action().is_none()
    }

    /// What the plan wants done in flight. Returns whether something is under way.
    fn act_in_flight(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) -> bool {
        self.acting.since_s.get_or_insert(now_s);
        let Some(step) = self.plan.in_flight.get(self.acting.index).cloned() else {
            return false;
        };
        if !self.acting.begun {
            let north_m = self.vehicle.local.map(|local| local.x_m);
            if !self.acting.is_due(step.when, now_s, north_m) {
                return false;
            }
            self.acting.begun = true;
            self.asked_s = f64::NEG_INFINITY;
        }
        let done = match &step.action {
            Action::Upload { waypoints, tail } => self.upload_in_flight(now_s, waypoints, tail, outbox),
            _ => self.say_in_flight(now_s, &step.action, outbox),
        };
        if done {
            self.acting.finish(now_s, step.action.wants_mission());
        }
        !done
    }

    fn upload_in_flight(
        &mut self,
        now_s: f64,
        waypoints: &[Point<LocalNed>],
        tail: &[PlanItem],
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) -> bool {
        if self.upload.is_none() {
            self.plan.waypoints = waypoints.to_vec();
            self.plan.tail = tail.to_vec();
            self.progress.waypoints = waypoints.len();
            self.progress.reached = 0;
        }
        self.upload_plan(now_s, outbox)
    }

    fn say_in_flight(
        &mut self,
        now_s: f64,
        action: &Action,
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) -> bool {
        if self.acting.answered || self.acting.said >= SAID_ENOUGH {
            return true;
        }
        if self.may_ask(now_s)
            && let Some(message) = self.message_for(action)
        {
            self.acting.said += 1;
            self.send(outbox, message);
        }
        false
    }

    /// What says it; `None` while the vehicle's place is not known, or for a mode that the make has not.
    fn message_for(&self, action: &Action) -> Option<MavMessage> {
        let target_system = self.target();
        let message = match action {
            Action::Upload { .. } => return None,
            Action::ClearMission => MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
                target_system,
                target_component: 1,
                mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
            }),
            Action::SetCurrent { item } => set_current(*item, target_system),
            Action::Mode(mode) => return self.vehicle.make.mode_command(*mode, target_system),
            Action::GoTo(place) | Action::Orbit(place) => {
                // Its own speed, and the mode that goes there; radius and speed of the circle.
                let (command, param1, param2) = match action {
                    Action::Orbit(_) => (MavCmd::MAV_CMD_DO_ORBIT, 5.0, 2.0),
                    _ => (MavCmd::MAV_CMD_DO_REPOSITION, -1.0, 1.0),
                };
                let (global, local) = self.vehicle.global.zip(self.vehicle.local)?;
                let offset = (place.vector() - local.vector()).xy();
                let (x, y) = Projection::new(global).to_global(offset).to_e7();
                MavMessage::COMMAND_INT(COMMAND_INT_DATA {
                    target_system,
                    target_component: 1,
                    frame: MavFrame::MAV_FRAME_GLOBAL,
                    command,
                    param1,
                    param2,
                    param4: f32::NAN,
                    x,
                    y,
                    z: (self.vehicle.altitude_m + local.z_m - place.z_m) as f32,
                    ..COMMAND_INT_DATA::default()
                })
            }
        };
        Some(message)
    }

    fn reach_mode(
        &mut self,
        mode: NavMode,
        next: Phase,
        now_s: f64,
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) {
        if self.progress.mode == mode {
            self.enter(next, now_s);
        } else if self.may_ask(now_s) {
            self.set_mode(outbox, mode);
        }
    }

    fn check_limit(&mut self, now_s: f64) {
        let phase = self.progress.phase;
        let limit_s = if phase == Phase::Mission {
            self.plan.mission_limit_s
        } else {
            phase.limit_s()
        };
        if now_s - self.phase_since_s > limit_s {
            let missing = match phase {
                Phase::Connect => "no heartbeat of an autopilot",
                Phase::Position => "no position",
                _ => "no progress",
            };
            let said = &self.progress.said;
            self.progress.outcome = Some(Outcome::TimedOut {
                phase,
                limit_s,
                reason: if said.is_empty() {
                    missing.to_owned()
                } else {
                    said.clone()
                },
            });
        }
    }

    fn target(&self) -> u8 {
        self.vehicle.system_id.unwrap_or(1)
    }

    fn set_mode(&mut self, outbox: &mut Vec<(MavHeader, MavMessage)>, mode: NavMode) {
        if let Some(command) = self.vehicle.make.mode_command(mode, self.target()) {
            self.send(outbox, command);
        }
    }

    /// PX4's mode "take off" climbs to a height that is a parameter.
    fn set_takeoff_height(&mut self, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        if self.vehicle.make.takes_off_with_the_mission() {
            return;
        }
        let message = MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: self.plan.takeoff_height_m as f32,
            target_system: self.target(),
            target_component: 1,
            param_id: "MIS_TAKEOFF_ALT".into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        });
        self.send(outbox, message);
    }

    fn arm(&mut self, outbox: &mut Vec<(MavHeader, MavMessage)>) {
        let arm = command(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [1.0, 0.0, 0.0],
            self.target(),
        );
        self.send(outbox, arm);
    }

    fn send(&mut self, outbox: &mut Vec<(MavHeader, MavMessage)>, message: MavMessage) {
        let header = MavHeader {
            system_id: SYSTEM_ID.into(),
            component_id: COMPONENT_ID,
            sequence: self.sequence,
        };
        self.sequence = self.sequence.wrapping_add(1);
        outbox.push((header, message));
    }
}

// PX4 before July 2026 has no command for it.
#[allow(deprecated)]
fn set_current(seq: u16, target_system: u8) -> MavMessage {
    MavMessage::MISSION_SET_CURRENT(mavlink::dialects::ardupilotmega::MISSION_SET_CURRENT_DATA {
        seq,
        target_system,
        target_component: 1,
    })
}

/// What a ground station says of itself once a second.
pub fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}
