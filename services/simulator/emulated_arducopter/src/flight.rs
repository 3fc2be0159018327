//! One step of flight: what the mode makes of the reference, and the command that follows it.

use super::ArduCopter;
use super::auto::AutoInput;
use super::guided::{GuidedInput, GuidedStep};
use super::land::descend;
use super::loiter::lean_max_rad;
use super::parameters::Parameter as P;
use super::position_control::{Limits, idle};
use super::shaping::ShapeLimits;
use jink_emulated_autopilot::attitude::attitude_for;
use jink_emulated_autopilot::link::Packet;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_simulated_world::vehicle::{ActuatorCommand, GRAVITY_MPS2, HOVER_THRUST, STEP_S};
use nalgebra::{Vector2, Vector3};

/// Deceleration of BRAKE (m/s^2): BRAKE_MODE_DECEL_RATE. With a jerk of 5 m/s^3 it is never reached: BRAKE is slower than a stop
/// in GUIDED.
const BRAKE_MPS2: f64 = 7.5;
/// Heading rate at full stick (rad/s): PILOT_Y_RATE.
const PILOT_TURN_RADPS: f64 = 202.5 * std::f64::consts::PI / 180.0;

impl ArduCopter {
    /// Leaves the command for the vehicle.
    pub(super) fn fly(&mut self, outbox: &mut Vec<Packet>) {
        self.land_detector.step(
            self.vehicle.truth().on_ground,
            -self.control.desired().velocity.z,
            self.command.map_or(0.0, |c| c.thrust / HOVER_THRUST),
            STEP_S,
        );
        if self.estimate.resets != self.resets_handled {
            self.resets_handled = self.estimate.resets;
            self.control.follow_reset(&self.estimate);
        }
        self.disarm_idle(outbox);
        if !self.armed {
            self.rest();
            self.command = None;
            return;
        }
        self.avoid.begin(self.now_us);
        let landed = self.land_detector.is_landed();
        let (flying, landing) = match self.mode {
            Mode::Stabilize => return self.fly_by_attitude(landed),
            Mode::AltHold => self.fly_sticks(landed),
            Mode::Loiter => self.fly_sticks(landed),
            Mode::Guided => (self.fly_guided(landed), false),
            Mode::Auto => self.fly_auto(landed),
            Mode::Rtl => {
                self.returning.step(
                    self.now_us,
                    self.home,
                    &self.estimate,
                    &self.parameters,
                    &mut self.control,
                );
                (true, landed)
            }
            Mode::Land => {
                descend(&self.estimate, self.home.z, &self.parameters, &mut self.control);
                (true, landed)
            }
            Mode::Brake => {
                self.control.follow_velocity(Vector2::zeros(), Vector2::zeros());
                self.control.follow_sink(0.0, 0.0);
                (!landed, false)
            }
        };
        if landing {
            self.disarm(outbox);
            self.command = None;
            return;
        }
        if !flying {
            self.rest();
            self.command = Some(idle(&self.estimate));
            return;
        }
        let speed_mps = self.control.limits.speed_mps;
        let yaw = self.yaw.step(self.control.desired(), speed_mps);
        self.command = Some(self.control.command(&self.estimate, yaw, &self.parameters));
    }

    /// On the ground: the reference is where the vehicle stands.
    fn rest(&mut self) {
        self.control.relax(&self.estimate);
        self.yaw.rest(self.estimate.attitude.yaw_rad());
    }

    fn fly_guided(&mut self, landed: bool) -> bool {
        let input = GuidedInput {
            now_us: self.now_us,
            landed,
            estimate: &self.estimate,
            parameters: &self.parameters,
            proximity: &self.proximity,
        };
        let step = self
            .guided
            .step(&input, &mut self.control, &mut self.yaw, &mut self.avoid);
        step == GuidedStep::Fly
    }

    fn fly_auto(&mut self, landed: bool) -> (bool, bool) {
        let input = AutoInput {
            now_us: self.now_us,
            landed,
            may_take_off: self.may_take_off || !landed,
            estimate: &self.estimate,
            home: self.home,
            parameters: &self.parameters,
            mission: &self.mission,
            frame: &self.frame,
        };
        let step = self.auto.step(&input, &mut self.control);
        if let Some(item) = step.reached {
            self.reached_items.push_back(item);
        }
        (step.flying, step.landing)
    }

    /// LOITER and ALT_HOLD: sticks set a velocity or a lean, and a climb.
    fn fly_sticks(&mut self, landed: bool) -> (bool, bool) {
        let climb = self.sticks.climb();
        if landed && climb <= 0.0 {
            return (false, false);
        }
        let speed = if climb > 0.0 {
            P::PILOT_SPEED_UP
        } else {
            P::PILOT_SPEED_DN
        };
        self.control
            .follow_sink(-climb * self.parameters.hundredth(speed), 0.0);
        self.yaw.turn(self.sticks.turn() * PILOT_TURN_RADPS);
        let lean = self.sticks.lean();
        if self.mode == Mode::Loiter {
            self.loiter.step(
                lean,
                &self.estimate,
                &self.parameters,
                &self.proximity,
                &mut self.avoid,
                &mut self.control,
            );
        } else {
            let at = self.estimate.position.vector().xy();
            let velocity = self.estimate.velocity.vector().xy();
            let heading = nalgebra::Rotation2::new(self.estimate.attitude.yaw_rad());
            let most = GRAVITY_MPS2 * self.parameters.hundredth(P::ANGLE_MAX).to_radians().tan();
            self.control.set_horizontal(at, velocity, heading * lean * most);
        }
        (true, false)
    }

    /// STABILIZE: sticks are the attitude and the thrust.
    fn fly_by_attitude(&mut self, landed: bool) {
        self.rest();
        let throttle = self.sticks.throttle();
        if landed && throttle < 0.05 {
            self.command = Some(idle(&self.estimate));
            return;
        }
        let heading = nalgebra::Rotation2::new(self.estimate.attitude.yaw_rad());
        let lean = heading * self.sticks.lean() * lean_max_rad(&self.parameters).tan();
        let thrust = Vector3::new(lean.x, lean.y, -1.0);
        self.command = Some(ActuatorCommand {
            attitude: attitude_for(&thrust, self.estimate.attitude.yaw_rad()),
            yaw_rate_radps: self.sticks.turn() * PILOT_TURN_RADPS,
            thrust: throttle,
        });
    }

    /// The mode begins: its controller starts from where the vehicle is and how it moves.
    pub(super) fn enter(&mut self, mode: Mode) {
        if self.mode == Mode::Auto {
            self.auto.leave();
        }
        self.mode = mode;
        let mut limits = Limits::automatic(&self.parameters);
        match mode {
            Mode::Brake => limits.horizontal.acceleration_mps2 = BRAKE_MPS2,
            Mode::Loiter | Mode::AltHold => {
                limits.vertical = ShapeLimits {
                    acceleration_mps2: self.parameters.hundredth(P::PILOT_ACCEL_Z),
                    ..limits.vertical
                };
            }
            _ => {}
        }
        self.control.start(&self.estimate, limits);
        self.yaw.hold(self.estimate.attitude.yaw_rad());
        match mode {
            Mode::Guided => self.guided.enter(
                self.now_us,
                &self.estimate,
                &self.parameters,
                &mut self.control,
                &mut self.yaw,
            ),
            Mode::Auto => {
                let restarts = self.parameters.get(P::MIS_RESTART) == 1.0;
                self.auto.enter(&self.mission, restarts);
                self.yaw.set_default(&self.parameters);
            }
            Mode::Rtl => {
                self.returning
                    .begin(self.home, &self.estimate, &self.parameters, &self.control);
                // WP_YAW_BEHAVIOR 2 is "along the track except in RTL".
                self.yaw.hold(self.estimate.attitude.yaw_rad());
            }
            Mode::Loiter => self.loiter = super::loiter::Loiter::default(),
            _ => {}
        }
    }
}
