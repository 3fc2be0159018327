//! One control cycle: navigation, flight task, take-off ramp, controller. 125 times a second.

use super::Px4;
use super::auto_task::{AutoInput, AutoOutput};
use super::external_avoidance;
use super::flight_task::{CYCLE_S, FlightTask};
use super::navigator::input::NavigatorInput;
use super::parameters::Parameter as P;
use super::position_control::ControlLimits;
use super::setpoint::{MotionSetpoint, SpeedCaps};
use super::takeoff::TakeoffState;
use jink_emulated_autopilot::link::Packet;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::HOVER_THRUST;
use mavlink::dialect::MavSeverity;

/// How fast the tilt limit may widen after take-off (rad/s).
const TILT_LIMIT_SLEW_RADPS: f64 = 0.2;

impl Px4 {
    /// Runs the cycle and leaves the command for the vehicle.
    pub(super) fn control(&mut self, outbox: &mut Vec<Packet>) {
        self.land_detector.step(
            self.vehicle.truth().on_ground,
            -self.controller.followed().velocity.z,
            self.command.map_or(0.0, |c| c.thrust / HOVER_THRUST),
            CYCLE_S,
        );
        if self.is_ready() {
            self.navigate(outbox);
        }
        self.handle_estimator_reset();
        let (own, caps, want_takeoff) = self.fly_task(outbox);
        let mut setpoint = self.deviated(own);
        let armed = self.commander.is_armed();
        self.takeoff.step(
            armed,
            self.land_detector.is_landed(),
            want_takeoff && armed,
            &self.parameters,
            CYCLE_S,
        );
        let state = self.takeoff.state();
        let flying = state == TakeoffState::Flight;
        if !flying {
            // The ramp must not be bypassed by feed-forward.
            setpoint.acceleration.z = f64::NAN;
        }
        if state < TakeoffState::RampUp || (flying && self.land_detector.has_contact()) {
            setpoint = MotionSetpoint::idle();
            self.controller.reset_integral();
        }
        if !armed {
            self.command = None;
            return;
        }
        let limits = self.control_limits(&caps, flying);
        let command = self
            .controller
            .step(&setpoint, &self.estimate, &limits, &self.parameters, CYCLE_S);
        // A setpoint that leaves an axis open is not followed; PX4 then stops where it is.
        self.command = command.or_else(|| {
            let stop = MotionSetpoint {
                velocity: nalgebra::Vector3::zeros(),
                ..MotionSetpoint::unset()
            };
            self.controller
                .step(&stop, &self.estimate, &limits, &self.parameters, CYCLE_S)
        });
        self.last_setpoint = setpoint;
    }

    fn navigate(&mut self, outbox: &mut Vec<Packet>) {
        let input = NavigatorInput {
            dt_s: CYCLE_S,
            mode: self.commander.mode(),
            armed: self.commander.is_armed(),
            landed: self.land_detector.is_landed(),
            estimate: &self.estimate,
            home: self.home,
            parameters: &self.parameters,
            mission: &self.mission,
            frame: &self.frame,
        };
        let events = self.navigator.step(&input);
        if let Some(item) = events.reached {
            self.reached_items.push_back(item as u16);
        }
        let leaves = events.mission_finished && self.config.firmware.leaves_finished_missions();
        if events.takeoff_finished || leaves {
            self.commander.proceed_to(NavMode::Hold);
        }
        if events.wants_return {
            self.commander.proceed_to(NavMode::Return);
        }
        if let Some(height_m) = events.return_started {
            let above_sea_m = self.frame.origin_altitude_m - self.home.z + height_m;
            let text =
                format_args!("RTL: start return at {above_sea_m:.0} m ({height_m:.0} m above destination)");
            self.wire.say_with(outbox, MavSeverity::MAV_SEVERITY_INFO, text);
        }
    }

    /// The estimate jumped: trajectories continue from the new position, without a step in the derivative.
    fn handle_estimator_reset(&mut self) {
        if self.estimate.resets == self.resets_handled {
            return;
        }
        self.resets_handled = self.estimate.resets;
        self.auto_task.position_reset(&self.estimate);
        self.position_task.position_reset(&self.estimate);
    }

    fn fly_task(&mut self, outbox: &mut Vec<Packet>) -> (MotionSetpoint, SpeedCaps, bool) {
        let task = FlightTask::of(self.commander.mode());
        let entered = task != self.task;
        if entered && self.task == FlightTask::Offboard && self.config.firmware.forgets_offboard_setpoint() {
            self.last_setpoint = MotionSetpoint::unset();
        }
        self.task = task;
        match task {
            FlightTask::None => (MotionSetpoint::idle(), self.plain_caps(), false),
            FlightTask::Position => self.fly_position(entered, outbox),
            FlightTask::Offboard => {
                let up = self.offboard.wants_takeoff(self.estimate.position.z_m);
                (*self.offboard.setpoint(), self.plain_caps(), up)
            }
            FlightTask::Orbit => {
                let cruise_mps = self.parameters.get(P::MPC_XY_CRUISE);
                let setpoint = self.orbit.map_or(MotionSetpoint::idle(), |orbit| {
                    orbit.setpoint(self.estimate.position, cruise_mps)
                });
                (setpoint, self.plain_caps(), false)
            }
            FlightTask::Auto if !self.is_ready() => (MotionSetpoint::idle(), self.plain_caps(), false),
            FlightTask::Auto => {
                if entered {
                    self.auto_task.activate(&self.last_setpoint, &self.estimate);
                }
                if self.takeoff.state() < TakeoffState::RampUp {
                    self.auto_task.wait_on_ground(&self.estimate);
                }
                let AutoOutput {
                    setpoint,
                    caps,
                    want_takeoff,
                    hold,
                } = self.fly_auto();
                if let Some(cause) = hold {
                    self.commander
                        .demand_hold(self.now_us, self.config.system_id, cause);
                }
                (setpoint, caps, want_takeoff)
            }
        }
    }

    fn fly_auto(&mut self) -> AutoOutput {
        let input = AutoInput {
            now_us: self.now_us,
            dt_s: CYCLE_S,
            mode: self.commander.mode(),
            estimate: &self.estimate,
            triplet: self.navigator.triplet(),
            height_m: self.home.z - self.estimate.position.z_m,
            parameters: &self.parameters,
        };
        self.auto_task.step(&input, &mut self.avoidance)
    }

    fn plain_caps(&self) -> SpeedCaps {
        SpeedCaps {
            horizontal_mps: self.parameters.get(P::MPC_XY_VEL_MAX),
            up_mps: self.parameters.get(P::MPC_Z_VEL_MAX_UP),
            down_mps: self.parameters.get(P::MPC_Z_VEL_MAX_DN),
        }
    }

    /// With what a companion gives, where it may.
    fn deviated(&self, own: MotionSetpoint) -> MotionSetpoint {
        let timeout_s = self.parameters.get(P::EAV_TIMEOUT);
        if self.may_be_deviated() && self.offboard.is_alive(self.now_us, timeout_s) {
            external_avoidance::fuse(&own, self.offboard.setpoint())
        } else {
            own
        }
    }

    pub(super) fn may_be_deviated(&self) -> bool {
        self.parameters.get(P::EAV_EN) != 0.0 && external_avoidance::is_taken_in(self.commander.mode())
    }

    fn control_limits(&mut self, caps: &SpeedCaps, flying: bool) -> ControlLimits {
        let wanted_rad = if flying {
            self.parameters.radians(P::MPC_TILTMAX_AIR)
        } else {
            self.parameters.radians(P::MPC_TILTMAX_LND)
        };
        let step_rad = TILT_LIMIT_SLEW_RADPS * CYCLE_S;
        self.tilt_limit_rad += (wanted_rad - self.tilt_limit_rad).clamp(-step_rad, step_rad);
        let up_mps = self.takeoff.climb_limit_mps(caps.up_mps, &self.parameters);
        ControlLimits {
            speed: SpeedCaps {
                up_mps: up_mps.min(self.parameters.get(P::MPC_Z_VEL_MAX_UP)),
                ..*caps
            },
            tilt_rad: self.tilt_limit_rad,
            thrust_min: if flying {
                self.parameters.get(P::MPC_THR_MIN)
            } else {
                0.0
            },
        }
    }
}
