//! A flight in lock-step with a scripted companion.

#![allow(deprecated)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod current;
pub mod obstacles;
pub mod tracking;
pub mod tracking_current;
pub mod travel;

use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::modes::px4::custom_mode;
use jink_emulated_autopilot::{Link, Packet, script};
use jink_emulated_px4::{Px4, Px4Config};
use jink_shared_types::geo::Projection;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// Steps a second.
pub const STEPS_PER_S: f64 = 250.0;

/// DO_REPOSITION by COMMAND_INT to `place` (local NED, m), its height above the sea.
pub fn reposition(place: Vector3<f64>, flags: f32) -> MavMessage {
    let config = Px4Config::default();
    let (x, y) = Projection::new(config.origin).to_global(place.xy()).to_e7();
    MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        target_system: 1,
        target_component: 1,
        frame: MavFrame::MAV_FRAME_GLOBAL,
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        param1: -1.0,
        param2: flags,
        param4: f32::NAN,
        x,
        y,
        z: (config.origin_altitude_m - place.z) as f32,
        ..COMMAND_INT_DATA::default()
    })
}

/// Where the vehicle truly is (local NED, m).
pub fn position(flight: &Flight) -> Vector3<f64> {
    flight.autopilot.truth().position.vector()
}

/// What the companion sends in answer to the desired path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// Nothing.
    Silent,
    /// Point 0 of each question, at once.
    Echo,
    /// Point 0 of the last question, at this interval (s), asked or not.
    Stream(f64),
}

/// Autopilot, companion and a hand at the ground station.
pub struct Flight {
    /// The autopilot.
    pub autopilot: Px4,
    /// Everything it sent in the last step.
    pub received: Vec<Packet>,
    /// Sent to it in the next step.
    pub inbox: Vec<Packet>,
    /// Companion's heartbeat: component, type, state; sent at 2 Hz.
    pub heartbeat: Option<(u8, MavType, MavState)>,
    /// Companion's answers.
    pub answer: Answer,
    /// Companion answers TIMESYNC with its clock this far ahead of boot time (us).
    pub clock_ahead_us: Option<i64>,
    /// Texts received on the ground station's link.
    pub texts: Vec<String>,
    /// Last desired path with its time (s).
    pub desired: Option<(f64, TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA)>,
    /// Desired paths received.
    pub questions: usize,
    next_answer_s: f64,
}

impl Flight {
    /// On the ground, before the first step.
    pub fn new(config: Px4Config) -> Self {
        Self {
            autopilot: Px4::new(config).expect("known parameters"),
            received: Vec::with_capacity(256),
            inbox: Vec::with_capacity(64),
            heartbeat: Some((
                196,
                MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                MavState::MAV_STATE_ACTIVE,
            )),
            answer: Answer::Stream(0.05),
            clock_ahead_us: None,
            texts: Vec::new(),
            desired: None,
            questions: 0,
            next_answer_s: 0.0,
        }
    }

    /// With these parameters.
    pub fn with(parameters: &[(&str, f64)]) -> Self {
        Self::new(Px4Config {
            parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
            ..Px4Config::default()
        })
    }

    /// Boot time (s).
    pub fn now_s(&self) -> f64 {
        self.autopilot.time_s()
    }

    /// Queues a message of system 1 from the companion's side.
    pub fn companion(&mut self, component: u8, message: MavMessage) {
        self.from(Link::Companion, 1, component, message);
    }

    /// Queues a message from anybody.
    pub fn from(&mut self, link: Link, system: u32, component: u8, message: MavMessage) {
        self.inbox.push(script::packet(link, system, component, message));
    }

    /// Queues a command from the ground station.
    pub fn command(&mut self, command: MavCmd, parameters: [f32; 7]) {
        self.from(
            Link::GroundStation,
            255,
            190,
            script::command(command, parameters),
        );
    }

    /// Runs until the acknowledgement of `command` and returns its result.
    pub fn ask(&mut self, command: MavCmd, parameters: [f32; 7]) -> MavResult {
        self.command(command, parameters);
        for _ in 0..250 {
            self.step();
            if let Some(result) = script::result_of(&self.received, Link::GroundStation, command) {
                return result;
            }
        }
        panic!("no acknowledgement of {command:?}");
    }

    /// Sets a mode.
    pub fn set_mode(&mut self, mode: NavMode) -> MavResult {
        let [_, _, main, sub] = custom_mode(mode).to_le_bytes();
        let parameters = [1.0, f32::from(main), f32::from(sub), 0.0, 0.0, 0.0, 0.0];
        self.ask(MavCmd::MAV_CMD_DO_SET_MODE, parameters)
    }

    /// Arms.
    pub fn arm(&mut self) -> MavResult {
        self.ask(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// Uploads waypoints in the local frame.
    pub fn upload(&mut self, waypoints: &[[f64; 3]]) {
        let items: Vec<MISSION_ITEM_INT_DATA> = waypoints
            .iter()
            .map(|w| {
                let [x, y] = [w[0], w[1]].map(|m| (m * 1e4).round() as i32);
                waypoint_item(MavFrame::MAV_FRAME_LOCAL_NED, x, y, w[2] as f32)
            })
            .collect();
        self.upload_items(&items);
    }

    /// Uploads items as they are, numbered in order.
    pub fn upload_items(&mut self, items: &[MISSION_ITEM_INT_DATA]) -> MavMissionResult {
        let count = script::mission_count(items.len());
        self.from(Link::GroundStation, 255, 190, count);
        for _ in 0..2_000 {
            self.step();
            match script::uploaded(&self.received, items) {
                Some(Ok(item)) => self.from(Link::GroundStation, 255, 190, item),
                Some(Err(result)) => return result,
                None => {}
            }
        }
        panic!("no acknowledgement of the mission");
    }

    /// The ground station removes the mission.
    pub fn clear_mission(&mut self) {
        let clear = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
            target_system: 1,
            target_component: 1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
        });
        self.from(Link::GroundStation, 255, 190, clear);
    }

    /// Runs for `seconds`.
    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * STEPS_PER_S).round() as usize {
            self.step();
        }
    }

    /// Runs until `done`, at most `seconds`; returns whether it came to that.
    pub fn run_until(&mut self, seconds: f64, mut done: impl FnMut(&Self) -> bool) -> bool {
        for _ in 0..(seconds * STEPS_PER_S).round() as usize {
            self.step();
            if done(self) {
                return true;
            }
        }
        false
    }

    /// Takes off in AUTO.TAKEOFF with the mission uploaded, and enters AUTO.MISSION.
    pub fn start_mission(&mut self, waypoints: &[[f64; 3]]) {
        self.run(2.5);
        self.upload(waypoints);
        assert_eq!(self.set_mode(NavMode::Hold), MavResult::MAV_RESULT_ACCEPTED);
        self.take_off();
        assert_eq!(self.set_mode(NavMode::Mission), MavResult::MAV_RESULT_ACCEPTED);
    }

    /// From boot to a take-off that nobody waits for: the companion may have failed it by then.
    pub fn begin_take_off(&mut self) {
        self.run(2.0);
        self.set_mode(NavMode::Hold);
        self.run(1.0);
        self.arm();
        self.set_mode(NavMode::Takeoff);
    }

    /// From Hold on the ground to Hold in the air. The companion's stream must run before it is asked for, so wait for it.
    pub fn take_off(&mut self) {
        self.run(1.0);
        assert_eq!(self.arm(), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(self.set_mode(NavMode::Takeoff), MavResult::MAV_RESULT_ACCEPTED);
        assert!(self.run_until(60.0, |f| f.autopilot.mode() == NavMode::Hold));
        self.run(4.0);
        assert_eq!(self.autopilot.hold_count(), 0, "{:?}", self.autopilot.holds());
    }

    /// One step of 4 ms.
    pub fn step(&mut self) {
        self.talk();
        let inbox = std::mem::take(&mut self.inbox);
        self.received.clear();
        self.autopilot.step(&inbox, &mut self.received);
        self.inbox = inbox;
        self.inbox.clear();
        self.listen();
    }

    fn talk(&mut self) {
        let now_s = self.now_s();
        if let Some((component, mavtype, system_status)) = self.heartbeat
            && ((now_s * STEPS_PER_S).round() as u64).is_multiple_of(125)
        {
            let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                mavtype,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status,
                ..HEARTBEAT_DATA::default()
            });
            self.companion(component, heartbeat);
        }
        if let Answer::Stream(interval_s) = self.answer
            && now_s + 1e-9 >= self.next_answer_s
            && let Some((_, desired)) = &self.desired
        {
            self.next_answer_s = now_s + interval_s;
            let reply = mirror(desired);
            self.companion(196, reply);
        }
    }

    fn listen(&mut self) {
        let now_s = self.now_s();
        let mut replies = Vec::new();
        for packet in &self.received {
            match &packet.message {
                MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(desired)
                    if packet.header.component_id == 1 && packet.link == Link::Companion =>
                {
                    self.questions += 1;
                    self.desired = Some((now_s, desired.clone()));
                    if self.answer == Answer::Echo {
                        replies.push(mirror(desired));
                    }
                }
                MavMessage::STATUSTEXT(text) if packet.link == Link::GroundStation => {
                    let part = text.text.to_str().unwrap_or("");
                    match self.texts.last_mut().filter(|_| text.chunk_seq > 0) {
                        Some(begun) => begun.push_str(part),
                        None => self.texts.push(part.to_owned()),
                    }
                }
                MavMessage::TIMESYNC(request) if request.tc1 == 0 => {
                    if let Some(ahead_us) = self.clock_ahead_us {
                        replies.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                            tc1: ((now_s * 1e6).round() as i64 + ahead_us) * 1_000,
                            ts1: request.ts1,
                            ..TIMESYNC_DATA::default()
                        }));
                    }
                }
                _ => {}
            }
        }
        for reply in replies {
            self.companion(196, reply);
        }
    }
}

/// An item that is a waypoint.
pub fn waypoint_item(frame: MavFrame, x: i32, y: i32, z: f32) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_WAYPOINT,
        frame,
        x,
        y,
        z,
        param4: f32::NAN,
        autocontinue: 1,
        ..MISSION_ITEM_INT_DATA::default()
    }
}

/// On the ground without a companion, which nothing demands.
pub fn alone() -> Flight {
    let mut flight = Flight::with(&[("COM_OBS_AVOID", 0.0)]);
    flight.heartbeat = None;
    flight.answer = Answer::Silent;
    flight
}

/// PARAM_SET by the ground station that switches avoidance on, at vehicle `system`.
pub fn demand_avoidance(flight: &mut Flight, system: u8) {
    let mut set = script::parameter(
        "COM_OBS_AVOID",
        f32::from_bits(1),
        MavParamType::MAV_PARAM_TYPE_INT32,
    );
    if let MavMessage::PARAM_SET(set) = &mut set {
        set.target_system = system;
    }
    flight.from(Link::GroundStation, 255, 190, set);
}

/// Point 0 sent back as a companion would.
pub fn mirror(desired: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA) -> MavMessage {
    let at = |v: &[f32; 5]| v[0];
    waypoint(
        [at(&desired.pos_x), at(&desired.pos_y), at(&desired.pos_z)],
        [at(&desired.vel_x), at(&desired.vel_y), at(&desired.vel_z)],
        [desired.pos_yaw[0], desired.vel_yaw[0]],
    )
}

/// A WAYPOINTS message with one valid point.
pub fn waypoint(position: [f32; 3], velocity: [f32; 3], yaw: [f32; 2]) -> MavMessage {
    MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoint_data(position, velocity, yaw, 1))
}

/// A WAYPOINTS message without any valid point.
pub fn no_waypoint() -> MavMessage {
    let unset = [f32::NAN; 3];
    MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoint_data(unset, unset, [f32::NAN; 2], 0))
}

fn waypoint_data(
    position: [f32; 3],
    velocity: [f32; 3],
    yaw: [f32; 2],
    valid_points: u8,
) -> TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
    let unset = [f32::NAN; 5];
    let first = |value: f32| {
        let mut field = unset;
        field[0] = value;
        field
    };
    TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
        pos_x: first(position[0]),
        pos_y: first(position[1]),
        pos_z: first(position[2]),
        vel_x: first(velocity[0]),
        vel_y: first(velocity[1]),
        vel_z: first(velocity[2]),
        acc_x: unset,
        acc_y: unset,
        acc_z: unset,
        pos_yaw: first(yaw[0]),
        vel_yaw: first(yaw[1]),
        command: [u16::MAX; 5],
        valid_points,
        ..TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::default()
    }
}

/// At 5 m in AUTO.MISSION towards a far waypoint, the companion mirroring at 20 Hz.
pub fn cruising() -> Flight {
    let mut flight = Flight::with(&[("MIS_TAKEOFF_ALT", 5.0)]);
    flight.start_mission(&[[300.0, 0.0, -5.0]]);
    flight
}

/// Sends `reply` every 0.1 s for `seconds`, and nothing else.
pub fn reply(flight: &mut Flight, seconds: f64, mut reply: impl FnMut(&Flight) -> MavMessage) {
    flight.answer = Answer::Silent;
    for _ in 0..(seconds * 10.0) as usize {
        let message = reply(flight);
        flight.companion(196, message);
        flight.run(0.1);
    }
}

/// True position, north and east (m).
pub fn north_east(flight: &Flight) -> (f64, f64) {
    let position = flight.autopilot.truth().position;
    (position.x_m, position.y_m)
}

/// True horizontal speed (m/s).
pub fn speed(flight: &Flight) -> f64 {
    flight.autopilot.truth().velocity.vector().xy().norm()
}
