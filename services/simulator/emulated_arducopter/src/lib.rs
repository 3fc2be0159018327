//! An autopilot that speaks MAVLink as ArduCopter 4.7 was observed to, and flies like it.
//!
//! | in | out |
//! |---|---|
//! | [`Packet`]s received on two links | [`Packet`]s to send |
//! | | the motion of the [`Vehicle`] it flies |
//!
//! [`step`](Autopilot::step) is 4 ms of autopilot and vehicle; boot time starts at 0 and knows no other clock. The same
//! packets in the same steps give the same flight to the bit. The parts, in the order of a step:
//!
//! | file | idea |
//! |---|---|
//! | `receive`, `command`, `setpoint` | messages in, acknowledgements, what a setpoint asks for |
//! | `parameters`, `sticks` | what is set: values, overrides of the sticks |
//! | `arming`, `failsafe`, `proximity` | who may arm, the lost ground station, obstacles reported by a companion |
//! | `guided`, `takeoff`, `auto`, `leg`, `land`, `loiter`, `avoid` | what a mode makes of the reference |
//! | `shaping`, `position_control`, `auto_yaw`, `flight` | the reference to attitude and thrust |
//! | `streams`, `telemetry` | messages out |
//!
//! docs/emulated_autopilots.md says what was observed, what is emulated, and which test shows it.

mod arming;
mod auto;
mod auto_yaw;
mod avoid;
mod command;
mod failsafe;
mod flight;
mod guided;
mod land;
mod leg;
mod loiter;
mod parameters;
mod position_control;
mod proximity;
mod receive;
mod setpoint;
mod shaping;
mod sticks;
mod streams;
mod takeoff;
mod telemetry;

use auto::Auto;
use auto_yaw::AutoYaw;
use avoid::Avoid;
use failsafe::{Change, GroundStationWatch};
use guided::Guided;
use jink_emulated_autopilot::land_detector::LandDetector;
use jink_emulated_autopilot::link::{Link, Packet, Wire};
use jink_emulated_autopilot::mission::{Dialect, ITEMS_MAX, Mission, MissionFrame, single};
use jink_emulated_autopilot::mission_protocol::MissionProtocol;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_emulated_autopilot::parameters::ParameterProtocol;
use jink_emulated_autopilot::{Abort, Autopilot, MissionProgress, SetpointStatistics, UnknownParameter};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::estimator::{Estimate, Estimator, EstimatorConfig};
use jink_simulated_world::vehicle::{ActuatorCommand, STEP_US, Vehicle, VehicleConfig, VehicleTruth};
use land::Return;
use loiter::Loiter;
use mavlink::dialect::MavSeverity;
use nalgebra::Vector3;
use parameters::{Parameter, Parameters};
use position_control::PositionControl;
use proximity::Proximity;
use std::collections::VecDeque;
use sticks::Sticks;
use streams::Streams;

/// What an autopilot is given at its start.
#[derive(Clone, Debug)]
pub struct ArduCopterConfig {
    /// MAVLink system id.
    pub system_id: u8,
    /// The vehicle.
    pub vehicle: VehicleConfig,
    /// The estimator.
    pub estimator: EstimatorConfig,
    /// Local origin on the globe.
    pub origin: GlobalPoint,
    /// Height of the local origin above sea level (m).
    pub origin_altitude_m: f64,
    /// From boot until the estimator has a position (s).
    pub ready_after_s: f64,
    /// Wall clock at boot, for SYSTEM_TIME only (us since 1970).
    pub unix_start_us: u64,
    /// Parameters that differ from the defaults, by ArduCopter's name.
    pub parameters: Vec<(String, f64)>,
}

impl Default for ArduCopterConfig {
    fn default() -> Self {
        Self {
            system_id: 1,
            // The drag with which the tracking and stopping errors measured on ArduCopter come out (test
            // `arducopter_tracking`), of a simulated quadrotor with more drag than PX4's.
            vehicle: VehicleConfig {
                drag_linear: 0.2,
                drag_quadratic: 0.075,
                ..VehicleConfig::default()
            },
            estimator: EstimatorConfig::default(),
            origin: GlobalPoint {
                latitude_deg: 47.397_742,
                longitude_deg: 8.545_594,
            },
            origin_altitude_m: 488.1,
            // Long enough that a companion which does not wait for it is refused.
            ready_after_s: 5.0,
            unix_start_us: 1_764_547_200_000_000,
            parameters: Vec::new(),
        }
    }
}

/// Autopilot and vehicle.
#[derive(Clone, Debug)]
pub struct ArduCopter {
    config: ArduCopterConfig,
    now_us: u64,
    vehicle: Vehicle,
    estimator: Estimator,
    estimate: Estimate,
    resets_handled: u32,
    parameters: Parameters,
    frame: MissionFrame,
    home: Vector3<f64>,
    mode: Mode,
    armed: bool,
    /// Somebody asked for a take-off since arming.
    may_take_off: bool,
    landed_since_us: u64,
    land_detector: LandDetector,
    station: GroundStationWatch,
    sticks: Sticks,
    proximity: Proximity,
    avoid: Avoid,
    guided: Guided,
    auto: Auto,
    returning: Return,
    loiter: Loiter,
    control: PositionControl,
    yaw: AutoYaw,
    command: Option<ActuatorCommand>,
    aborted: Option<Abort>,
    wire: Wire,
    /// MAVn_OPTIONS of the companion's and the station's link, as they were at the start.
    link_options: [u32; 2],
    streams: Streams,
    mission: Mission,
    mission_protocol: MissionProtocol,
    parameter_protocol: ParameterProtocol,
    reached_items: VecDeque<u16>,
    last_reached: u16,
    statistics: SetpointStatistics,
}

impl ArduCopter {
    /// Boots on the ground, disarmed, in STABILIZE.
    ///
    /// # Errors
    /// [`UnknownParameter`] for a name in the configuration that does not exist here.
    pub fn new(config: ArduCopterConfig) -> Result<Self, UnknownParameter> {
        let mut parameters = Parameters::default();
        for (name, value) in &config.parameters {
            let parameter = parameters::find(name).ok_or_else(|| UnknownParameter { name: name.clone() })?;
            parameters.set(parameter, *value);
        }
        let vehicle = Vehicle::new(&config.vehicle);
        let mut estimator = Estimator::new(&config.estimator, vehicle.truth());
        let estimate = estimator.step(vehicle.truth());
        let home = single(config.vehicle.start.vector());
        let mut yaw = AutoYaw::default();
        yaw.hold(estimate.attitude.yaw_rad());
        Ok(Self {
            now_us: 0,
            estimator,
            resets_handled: 0,
            frame: MissionFrame {
                projection: Projection::new(config.origin),
                origin_altitude_m: config.origin_altitude_m,
                home_down_m: home.z,
            },
            home,
            mode: Mode::default(),
            armed: false,
            may_take_off: false,
            landed_since_us: 0,
            land_detector: LandDetector::default(),
            station: GroundStationWatch::default(),
            sticks: Sticks::default(),
            proximity: Proximity::new(&parameters),
            avoid: Avoid::default(),
            guided: Guided::default(),
            auto: Auto::default(),
            returning: Return::default(),
            loiter: Loiter::default(),
            control: PositionControl::new(&parameters, &estimate),
            yaw,
            command: None,
            aborted: None,
            wire: Wire::new(config.system_id),
            link_options: [Parameter::MAV2_OPTIONS, Parameter::MAV1_OPTIONS]
                .map(|p| parameters.get(p) as u32),
            streams: Streams::default(),
            mission: Mission::new(Dialect::ArduCopter),
            mission_protocol: MissionProtocol::default(),
            parameter_protocol: ParameterProtocol::default(),
            reached_items: VecDeque::with_capacity(ITEMS_MAX),
            last_reached: 0,
            statistics: SetpointStatistics::default(),
            estimate,
            parameters,
            vehicle,
            config,
        })
    }

    /// The process has ended: nobody flies.
    fn fall(&mut self) {
        self.armed = false;
        self.command = None;
        self.move_on();
    }

    fn move_on(&mut self) {
        self.vehicle.step(self.command.as_ref());
        self.estimate = self.estimator.step(self.vehicle.truth());
        self.now_us += STEP_US;
    }

    fn watch_ground_station(&mut self, outbox: &mut Vec<Packet>) {
        let enabled = self.armed && self.parameters.get(Parameter::FS_GCS_ENABLE) != 0.0;
        let timeout_s = self.parameters.get(Parameter::FS_GCS_TIMEOUT);
        let severity = MavSeverity::MAV_SEVERITY_WARNING;
        match self.station.step(self.now_us, enabled, timeout_s) {
            Change::None => {}
            Change::Back => self.wire.say(outbox, severity, "GCS Failsafe Cleared"),
            Change::Lost => {
                self.wire.say(outbox, severity, "GCS Failsafe");
                if !self.mode.is_piloted() && self.mode != Mode::Land {
                    self.change_mode(Mode::Rtl, outbox);
                }
            }
        }
    }

    fn is_ready(&self) -> bool {
        self.time_s() >= self.config.ready_after_s
    }

    /// Mode in force, as ArduCopter calls it.
    pub fn flight_mode(&self) -> Mode {
        self.mode
    }

    /// Whether the companion's time stamps are believed: never. ArduCopter asks for the time and does nothing with it.
    pub fn timesync_converged(&self, _link: Link) -> bool {
        false
    }

    /// The value of the parameter with ArduCopter's name `name`.
    pub fn parameter(&self, name: &str) -> Option<f64> {
        parameters::find(name).map(|p| self.parameters.get(p))
    }
}

impl Autopilot for ArduCopter {
    fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>) {
        for packet in inbox {
            if self.aborted.is_none() {
                self.receive(packet, outbox);
            }
        }
        if self.aborted.is_some() {
            self.fall();
            return;
        }
        self.sticks.begin(self.now_us);
        self.watch_ground_station(outbox);
        self.mission_protocol.step(self.now_us, &mut self.wire, outbox);
        self.parameter_protocol
            .step(&self.parameters, &mut self.wire, outbox);
        self.fly(outbox);
        self.move_on();
        let in_air = self.armed && !self.land_detector.is_landed();
        self.statistics
            .step(self.now_us, self.mode == Mode::Guided && in_air);
        self.send_streams(outbox);
    }

    fn time_s(&self) -> f64 {
        self.now_us as f64 * 1e-6
    }

    fn truth(&self) -> &VehicleTruth {
        self.vehicle.truth()
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn mode(&self) -> NavMode {
        self.mode.nav()
    }

    fn is_armed(&self) -> bool {
        self.armed
    }

    fn is_landed(&self) -> bool {
        self.land_detector.is_landed()
    }

    fn mission(&self) -> MissionProgress {
        // Item 0 is home.
        MissionProgress {
            current: self.auto.current() as u16,
            total: self.mission.len() as u16,
            done: self.auto.is_finished(),
        }
    }

    fn setpoint_statistics(&self) -> &SetpointStatistics {
        &self.statistics
    }

    fn jump_estimate(&mut self, by: Vector3<f64>) {
        self.estimator.jump(by);
    }

    fn aborted(&self) -> Option<Abort> {
        self.aborted
    }
}
