//! A flight of the emulated ArduCopter in lock-step.

use super::STEPS_PER_S;
use jink_emulated_arducopter::{ArduCopter, ArduCopterConfig};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_emulated_autopilot::{Link, Packet, script};
use jink_simulated_world::vehicle::VehicleConfig;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// All of a setpoint but its heading rate.
pub const PVA: u16 = 2_048;
/// Position and velocity.
pub const POSITION_VELOCITY: u16 = 2_048 + 448;
/// Velocity and acceleration.
pub const VELOCITY_ACCELERATION: u16 = 2_048 + 7;
/// Velocity alone.
pub const VELOCITY: u16 = 2_048 + 448 + 7;
/// Position alone.
pub const POSITION: u16 = 2_048 + 448 + 56;
/// Acceleration alone.
pub const ACCELERATION: u16 = 2_048 + 56 + 7;

/// The autopilot with a ground station and a companion played by the test.
pub struct CopterFlight {
    /// The autopilot.
    pub copter: ArduCopter,
    /// Everything it sent in the last step.
    pub received: Vec<Packet>,
    /// Sent to it in the next step.
    pub inbox: Vec<Packet>,
    /// Texts received on the ground station's link.
    pub texts: Vec<String>,
}

impl CopterFlight {
    /// On the ground, before the first step, with these parameters.
    pub fn with(parameters: &[(&str, f64)]) -> Self {
        Self::new(ArduCopterConfig {
            parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
            ..ArduCopterConfig::default()
        })
    }

    /// On the ground, heading `heading_deg`.
    pub fn heading(heading_deg: f64, parameters: &[(&str, f64)]) -> Self {
        Self::new(ArduCopterConfig {
            vehicle: VehicleConfig {
                heading_rad: heading_deg.to_radians(),
                ..ArduCopterConfig::default().vehicle
            },
            parameters: parameters.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect(),
            ..ArduCopterConfig::default()
        })
    }

    /// On the ground, before the first step.
    pub fn new(config: ArduCopterConfig) -> Self {
        Self {
            copter: ArduCopter::new(config).expect("known parameters"),
            received: Vec::with_capacity(256),
            inbox: Vec::with_capacity(64),
            texts: Vec::new(),
        }
    }

    /// At 5 m in GUIDED, at rest.
    pub fn airborne(parameters: &[(&str, f64)]) -> Self {
        Self::with(parameters).lifted(5.0)
    }

    /// The same flight, `height_m` above the ground in GUIDED.
    pub fn lifted(mut self, height_m: f32) -> Self {
        self.run(6.0);
        assert_eq!(self.set_mode(Mode::Guided), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(self.arm(), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(self.take_off(height_m), MavResult::MAV_RESULT_ACCEPTED);
        self.run(8.0 + f64::from(height_m));
        assert!(
            (self.position().z + f64::from(height_m)).abs() < 0.1,
            "{}",
            self.position()
        );
        self
    }

    /// Boot time (s).
    pub fn now_s(&self) -> f64 {
        self.copter.time_s()
    }

    /// True position (m).
    pub fn position(&self) -> Vector3<f64> {
        self.copter.truth().position.vector()
    }

    /// True velocity (m/s).
    pub fn velocity(&self) -> Vector3<f64> {
        self.copter.truth().velocity.vector()
    }

    /// True horizontal speed (m/s).
    pub fn speed(&self) -> f64 {
        self.velocity().xy().norm()
    }

    /// True heading (deg).
    pub fn heading_deg(&self) -> f64 {
        self.copter.truth().attitude.yaw_rad().to_degrees()
    }

    /// Queues a message from anybody.
    pub fn from(&mut self, link: Link, system: u32, component: u8, message: MavMessage) {
        self.inbox.push(script::packet(link, system, component, message));
    }

    /// Queues a message of the companion.
    pub fn companion(&mut self, message: MavMessage) {
        self.from(Link::Companion, 1, 191, message);
    }

    /// Queues a message of the ground station.
    pub fn station(&mut self, message: MavMessage) {
        self.from(Link::GroundStation, 255, 190, message);
    }

    /// Asks from the companion and returns the result.
    pub fn ask(&mut self, command: MavCmd, parameters: [f32; 7]) -> MavResult {
        self.ask_on(Link::Companion, command, parameters)
    }

    /// Asks on a link and returns the result.
    pub fn ask_on(&mut self, link: Link, command: MavCmd, parameters: [f32; 7]) -> MavResult {
        self.from(link, 1, 191, script::command(command, parameters));
        self.step();
        script::result_of(&self.received, link, command).expect("an acknowledgement")
    }

    /// Sets a mode.
    pub fn set_mode(&mut self, mode: Mode) -> MavResult {
        let number = mode.custom() as f32;
        self.ask(
            MavCmd::MAV_CMD_DO_SET_MODE,
            [1.0, number, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// Arms.
    pub fn arm(&mut self) -> MavResult {
        self.ask(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// NAV_TAKEOFF.
    pub fn take_off(&mut self, height_m: f32) -> MavResult {
        self.ask(
            MavCmd::MAV_CMD_NAV_TAKEOFF,
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m],
        )
    }

    /// SET_MESSAGE_INTERVAL at a rate.
    pub fn want(&mut self, link: Link, id: u32, rate_hz: f64) -> MavResult {
        let interval_us = (1e6 / rate_hz) as f32;
        self.ask_on(
            link,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            [id as f32, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    /// PARAM_SET.
    pub fn set(&mut self, name: &str, value: f32) {
        let kind = MavParamType::MAV_PARAM_TYPE_REAL32;
        self.companion(script::parameter(name, value, kind));
    }

    /// Sticks of the ground station: roll, pitch, throttle, yaw.
    pub fn sticks(&mut self, channels: [u16; 4]) {
        let [chan1_raw, chan2_raw, chan3_raw, chan4_raw] = channels;
        self.station(MavMessage::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA {
            chan1_raw,
            chan2_raw,
            chan3_raw,
            chan4_raw,
            target_system: 1,
            target_component: 1,
            ..RC_CHANNELS_OVERRIDE_DATA::default()
        }));
    }

    /// One step of 4 ms.
    pub fn step(&mut self) {
        let inbox = std::mem::take(&mut self.inbox);
        self.received.clear();
        self.copter.step(&inbox, &mut self.received);
        self.inbox = inbox;
        self.inbox.clear();
        for packet in &self.received {
            if let (MavMessage::STATUSTEXT(text), Link::GroundStation) = (&packet.message, packet.link) {
                self.texts.push(text.text.to_str().unwrap_or("").to_owned());
            }
        }
    }

    /// Runs for `seconds`.
    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * STEPS_PER_S).round() as usize {
            self.step();
        }
    }

    /// Runs for `seconds`, sending `message` at `rate_hz` first and then on.
    pub fn stream(&mut self, seconds: f64, rate_hz: f64, mut message: impl FnMut(f64) -> MavMessage) {
        let every = (STEPS_PER_S / rate_hz).round() as usize;
        for step in 0..(seconds * STEPS_PER_S).round() as usize {
            if step % every == 0 {
                self.companion(message(step as f64 / STEPS_PER_S));
            }
            self.step();
        }
    }

    /// Runs until `done`, at most `seconds`; returns after how long (s).
    pub fn run_until(&mut self, seconds: f64, mut done: impl FnMut(&Self) -> bool) -> Option<f64> {
        let begin_s = self.now_s();
        for _ in 0..(seconds * STEPS_PER_S).round() as usize {
            self.step();
            if done(self) {
                return Some(self.now_s() - begin_s);
            }
        }
        None
    }

    /// Messages received in `seconds`, as `pick` picks them.
    pub fn collect<T>(&mut self, seconds: f64, mut pick: impl FnMut(&Packet) -> Option<T>) -> Vec<T> {
        let mut picked = Vec::new();
        for _ in 0..(seconds * STEPS_PER_S).round() as usize {
            self.step();
            picked.extend(self.received.iter().filter_map(&mut pick));
        }
        picked
    }

    /// Uploads items from the ground station.
    pub fn upload(&mut self, items: &[MISSION_ITEM_INT_DATA]) -> MavMissionResult {
        self.station(script::mission_count(items.len()));
        for _ in 0..2_000 {
            self.step();
            match script::uploaded(&self.received, items) {
                Some(Ok(item)) => self.station(item),
                Some(Err(result)) => return result,
                None => {}
            }
        }
        panic!("no acknowledgement of the mission");
    }

    /// POSITION_TARGET_LOCAL_NED now.
    pub fn target(&mut self) -> POSITION_TARGET_LOCAL_NED_DATA {
        let asked = [85.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        self.ask(MavCmd::MAV_CMD_REQUEST_MESSAGE, asked);
        self.received
            .iter()
            .find_map(|packet| match &packet.message {
                MavMessage::POSITION_TARGET_LOCAL_NED(target) => Some(target.clone()),
                _ => None,
            })
            .expect("a target")
    }
}

/// An item of a mission in the frame of relative heights.
pub fn item(command: MavCmd, north: f64, east: f64, height_m: f32) -> MISSION_ITEM_INT_DATA {
    let origin = jink_emulated_arducopter::ArduCopterConfig::default().origin;
    let projection = jink_shared_types::geo::Projection::new(origin);
    let (x, y) = projection.to_global(nalgebra::Vector2::new(north, east)).to_e7();
    MISSION_ITEM_INT_DATA {
        command,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        x,
        y,
        z: height_m,
        autocontinue: 1,
        ..MISSION_ITEM_INT_DATA::default()
    }
}

/// Home, take-off to 5 m, 30 m north, 30 m east of that, land.
pub fn square() -> Vec<MISSION_ITEM_INT_DATA> {
    vec![
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0, 0.0, 0.0),
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 5.0),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, 60.0, 0.0, 5.0),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, 60.0, 30.0, 5.0),
        item(MavCmd::MAV_CMD_NAV_LAND, 60.0, 30.0, 0.0),
    ]
}

/// A setpoint in the local frame.
pub fn setpoint(
    mask: u16,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
) -> MavMessage {
    setpoint_in(
        MavFrame::MAV_FRAME_LOCAL_NED,
        mask,
        position,
        velocity,
        acceleration,
    )
}

/// A setpoint in any frame.
pub fn setpoint_in(
    frame: MavFrame,
    mask: u16,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
) -> MavMessage {
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: frame,
        ..script::setpoint(mask, [position, velocity, acceleration])
    })
}

/// North `x`, east `y`, at 5 m.
pub fn at(x: f64, y: f64) -> Vector3<f64> {
    Vector3::new(x, y, -5.0)
}

/// North `x`, east `y`, level.
pub fn level(x: f64, y: f64) -> Vector3<f64> {
    Vector3::new(x, y, 0.0)
}
