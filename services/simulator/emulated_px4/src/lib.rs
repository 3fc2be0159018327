//! An autopilot that speaks MAVLink as two firmwares of PX4 were observed to, and flies like them.
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
//! | `config`, `firmware`, `pace` | which PX4 on which vehicle, where that matters, how its time passes |
//! | `receive`, `command`, `refusal` | messages in, acknowledgements |
//! | `parameters` | what a ground station sets |
//! | `companion_health`, `heartbeat_watch`, `stick_speed` | who is alive, who wants the vehicle |
//! | `commander` | who may arm, which mode, which failsafe |
//! | `navigator`, `return_home`, `takeoff` | what a mode means as waypoints and phases |
//! | `auto_task`, `track`, `heading`, `trajectory`, `speed_rules`, `smoothing` | waypoints to smooth setpoints |
//! | `avoidance`, `bezier`, `timesync` | the companion's trajectory in between, with all known traps |
//! | `offboard`, `orbit`, `position_task`, `position_mode`, `stick_acceleration` | the other sources of setpoints |
//! | [`collision_prevention`], `obstacle_messages` | what keeps a pilot in Position mode from obstacles |
//! | `position_control`, `flight_task`, `control` | setpoints to attitude and thrust |
//! | `streams`, `telemetry`, `current_mode`, `desired_path` | messages out, observations |

mod auto_task;
mod avoidance;
mod bezier;
pub mod collision_prevention;
mod command;
mod commander;
mod companion_health;
mod config;
mod control;
mod current_mode;
mod desired_path;
mod external_avoidance;
mod firmware;
mod flight_task;
mod heading;
mod heartbeat_watch;
mod navigator;
mod obstacle_messages;
mod offboard;
mod orbit;
mod pace;
mod parameters;
mod position_control;
mod position_mode;
mod position_task;
mod receive;
mod refusal;
mod return_home;
mod setpoint;
mod smoothing;
mod speed_rules;
mod stick_acceleration;
mod stick_speed;
mod streams;
mod takeoff;
mod telemetry;
mod timesync;
mod track;
mod trajectory;

pub use avoidance::{HoldCause, Variant};
pub use commander::HoldFall;
pub use config::Px4Config;
pub use firmware::Firmware;
pub use pace::Pace;

use auto_task::AutoTask;
use avoidance::AvoidanceConsumer;
use collision_prevention::{CollisionPrevention, Settings};
use commander::{Commander, Situation};
use current_mode::ModeUpdates;
use flight_task::{CONTROL_STEPS, FlightTask};
use jink_emulated_autopilot::land_detector::LandDetector;
use jink_emulated_autopilot::link::Wire;
use jink_emulated_autopilot::mission::{Dialect, ITEMS_MAX, Mission, MissionFrame, single};
use jink_emulated_autopilot::mission_protocol::MissionProtocol;
use jink_emulated_autopilot::parameters::ParameterProtocol;
use jink_emulated_autopilot::{
    Autopilot, Link, MissionProgress, Packet, SetpointStatistics, UnknownParameter,
};
use jink_shared_types::geo::Projection;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::estimator::{Estimate, Estimator};
use jink_simulated_world::vehicle::{ActuatorCommand, STEP_US, Vehicle, VehicleTruth};
use nalgebra::Vector3;
use navigator::Navigator;
use offboard::Offboard;
use orbit::Orbit;
use pace::StepGate;
use parameters::{Parameter, Parameters};
use position_control::PositionController;
use position_task::{PositionTask, Sticks};
use setpoint::MotionSetpoint;
use std::collections::VecDeque;
use stick_speed::StickSpeed;
use streams::Streams;
use takeoff::Takeoff;
use timesync::Timesync;

/// Autopilot and vehicle.
#[derive(Clone, Debug)]
pub struct Px4 {
    config: Px4Config,
    now_us: u64,
    steps: u64,
    step_gate: StepGate,
    /// What arrived while its time stood still.
    unread: Vec<Packet>,
    vehicle: Vehicle,
    estimator: Estimator,
    estimate: Estimate,
    resets_handled: u32,
    parameters: Parameters,
    frame: MissionFrame,
    home: Vector3<f64>,
    commander: Commander,
    navigator: Navigator,
    mission: Mission,
    land_detector: LandDetector,
    takeoff: Takeoff,
    task: FlightTask,
    auto_task: AutoTask,
    position_task: PositionTask,
    collision_prevention: CollisionPrevention,
    /// When the fused map was published last.
    fused_us: Option<u64>,
    sticks: Sticks,
    stick_speed: StickSpeed,
    offboard: Offboard,
    orbit: Option<Orbit>,
    avoidance: AvoidanceConsumer,
    controller: PositionController,
    tilt_limit_rad: f64,
    last_setpoint: MotionSetpoint,
    command: Option<ActuatorCommand>,
    wire: Wire,
    streams: Streams,
    mode_update: ModeUpdates,
    timesync: [Timesync; 2],
    mission_protocol: MissionProtocol,
    parameter_protocol: ParameterProtocol,
    reached_items: VecDeque<u16>,
    statistics: SetpointStatistics,
}

impl Px4 {
    /// Boots on the ground, disarmed, in MANUAL.
    ///
    /// # Errors
    /// [`UnknownParameter`] for a name in the configuration that does not exist here.
    pub fn new(config: Px4Config) -> Result<Self, UnknownParameter> {
        let mut parameters = Parameters::new(config.firmware);
        for (name, value) in &config.parameters {
            let parameter = parameters
                .find(name)
                .ok_or_else(|| UnknownParameter { name: name.clone() })?;
            parameters.set(parameter, *value);
        }
        let vehicle = Vehicle::new(&config.vehicle);
        let mut estimator = Estimator::new(&config.estimator, vehicle.truth());
        let estimate = estimator.step(vehicle.truth());
        let home = single(config.vehicle.start.vector());
        // Current PX4 never asks its companion for a trajectory: COM_OBS_AVOID does not exist.
        let variant = match config.firmware {
            Firmware::Trajectory(variant) => variant,
            Firmware::Current => Variant::default(),
        };
        Ok(Self {
            now_us: 0,
            steps: 0,
            step_gate: StepGate::default(),
            unread: Vec::new(),
            estimator,
            estimate,
            resets_handled: 0,
            tilt_limit_rad: parameters.radians(Parameter::MPC_TILTMAX_LND),
            parameters,
            frame: MissionFrame {
                projection: Projection::new(config.origin),
                origin_altitude_m: config.origin_altitude_m,
                home_down_m: home.z,
            },
            home,
            commander: Commander::new(config.firmware),
            navigator: Navigator::new(config.firmware),
            mission: Mission::new(Dialect::Px4),
            land_detector: LandDetector::default(),
            takeoff: Takeoff::default(),
            task: FlightTask::None,
            auto_task: AutoTask::new(),
            position_task: PositionTask::new(config.firmware),
            collision_prevention: CollisionPrevention::new(Settings::default()),
            fused_us: None,
            sticks: Sticks::default(),
            stick_speed: StickSpeed::default(),
            offboard: Offboard::default(),
            orbit: None,
            avoidance: AvoidanceConsumer::new(variant),
            controller: PositionController::default(),
            last_setpoint: MotionSetpoint::unset(),
            command: None,
            wire: Wire::new(config.system_id),
            streams: Streams::new(config.firmware),
            mode_update: ModeUpdates::default(),
            timesync: [Timesync::default(), Timesync::default()],
            mission_protocol: MissionProtocol::default(),
            parameter_protocol: ParameterProtocol::default(),
            reached_items: VecDeque::with_capacity(ITEMS_MAX),
            statistics: SetpointStatistics::default(),
            vehicle,
            config,
        })
    }

    fn watch_setpoints(&mut self) {
        let mode = self.commander.mode();
        let by_companion = match mode {
            NavMode::Offboard => true,
            NavMode::Mission if self.may_be_deviated() => true,
            _ => mode.is_automatic() && self.parameters.avoidance_enabled(),
        };
        let in_air = self.commander.is_armed() && !self.land_detector.is_landed();
        self.statistics.step(self.now_us, by_companion && in_air);
    }

    fn situation(&self) -> Situation {
        let timeout_s = self.parameters.get(Parameter::COM_OF_LOSS_T);
        Situation {
            now_us: self.now_us,
            landed: self.land_detector.is_landed(),
            position_ready: self.is_ready(),
            has_mission: !self.mission.is_empty(),
            offboard_alive: self.offboard.is_alive(self.now_us, timeout_s),
        }
    }

    fn is_ready(&self) -> bool {
        self.time_s() >= self.config.ready_after_s
    }

    /// The mode somebody asked for last; another one is in force in a failsafe.
    pub fn intended_mode(&self) -> NavMode {
        self.commander.intended()
    }

    /// When and why it fell to Hold or out of OFFBOARD, the first 64 times.
    pub fn holds(&self) -> &[HoldFall] {
        self.commander.falls()
    }

    /// Whether the companion's time stamps on `link` are believed.
    pub fn timesync_converged(&self, link: Link) -> bool {
        self.timesync[link as usize].is_converged()
    }

    /// The value of the parameter with PX4's name `name`.
    pub fn parameter(&self, name: &str) -> Option<f64> {
        self.parameters.find(name).map(|p| self.parameters.get(p))
    }
}

impl Autopilot for Px4 {
    fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>) {
        // Where its time stands still it does nothing.
        if !self.step_gate.passes(&self.config.pace) {
            self.unread.extend_from_slice(inbox);
            return;
        }
        for packet in &std::mem::take(&mut self.unread) {
            self.receive(packet, outbox);
        }
        for packet in inbox {
            self.receive(packet, outbox);
        }
        let situation = self.situation();
        let wire = &mut self.wire;
        self.commander
            .step(&situation, &self.parameters, |(severity, text)| {
                wire.say_with(outbox, severity, text);
            });
        self.mission_protocol.step(self.now_us, &mut self.wire, outbox);
        self.parameter_protocol
            .step(&self.parameters, &mut self.wire, outbox);
        if self.steps.is_multiple_of(CONTROL_STEPS) {
            self.control(outbox);
        }
        self.vehicle.step(self.command.as_ref());
        self.estimate = self.estimator.step(self.vehicle.truth());
        self.steps += 1;
        self.now_us += STEP_US;
        self.watch_setpoints();
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
        self.commander.mode()
    }

    fn is_armed(&self) -> bool {
        self.commander.is_armed()
    }

    fn is_landed(&self) -> bool {
        self.land_detector.is_landed()
    }

    fn mission(&self) -> MissionProgress {
        MissionProgress {
            current: self.navigator.item() as u16,
            total: self.mission.len() as u16,
            done: self.navigator.mission_finished(),
        }
    }

    fn setpoint_statistics(&self) -> &SetpointStatistics {
        &self.statistics
    }

    fn jump_estimate(&mut self, by: Vector3<f64>) {
        self.estimator.jump(by);
    }

    fn hold_count(&self) -> u32 {
        self.commander.fall_count()
    }
}
