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
mod in_flight_execution;
mod item;
mod make;
mod plan;
mod progress;
mod receive;
mod upload;

pub use in_flight::{Action, InFlight, When};
pub use item::PlanItem;
pub use make::Make;
pub use plan::{Ending, FlightPlan};
pub use progress::{Outcome, Phase, Progress};

use in_flight::Acting;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::GlobalPoint;
use jink_shared_types::vehicle::NavMode;
use make::command;
use mavlink::MavHeader;
use mavlink::dialect::{
    HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavParamType, MavState, MavType,
    PARAM_SET_DATA,
};
use upload::Upload;

/// Our address: what ground stations use.
const SYSTEM_ID: u8 = 255;
const COMPONENT_ID: u8 = 190;
/// Requests that have shown no effect are repeated after this (s).
const REPEAT_S: f64 = 1.0;
/// Height missing to the take-off height at which the mission may start (m).
const TAKEOFF_SLACK_M: f64 = 0.4;
/// A vehicle that holds after this time (s), at this height (m) and more, goes on from there: it may not come higher where its sensors do
/// not look up.
const TAKEOFF_S: f64 = 12.0;
const TAKEOFF_LEAST_M: f64 = 1.0;

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
