//! Position mode in a control cycle: its flight task, with collision prevention in it where the firmware has that.
//!
//! PX4 makes a new one whenever the mode is entered: what was seen before is forgotten, and its time without data
//! begins then. It says nothing to anybody of missing data, but switches to Hold after five seconds of it; a frame that
//! it does not understand is reported at every message. The command for Hold goes to system 1, whatever its own number.

use super::Px4;
use super::avoidance::HoldCause;
use super::collision_prevention::{Outcome, Settings};
use super::flight_task::CYCLE_S;
use super::parameters::{Parameter as P, Parameters};
use super::position_task::PositionInput;
use super::setpoint::{MotionSetpoint, SpeedCaps};
use super::takeoff::TakeoffState;
use jink_emulated_autopilot::link::Packet;
use mavlink::dialect::MavSeverity;
use nalgebra::Vector2;

impl Px4 {
    /// Setpoint, speed limits, and whether the sticks ask for take-off. `entered`: the mode begins.
    pub(super) fn fly_position(
        &mut self,
        entered: bool,
        outbox: &mut Vec<Packet>,
    ) -> (MotionSetpoint, SpeedCaps, bool) {
        if entered || self.takeoff.state() < TakeoffState::RampUp {
            self.position_task.activate(&self.last_setpoint, &self.estimate);
        }
        if entered {
            self.collision_prevention.restart();
        }
        let q = self.estimate.attitude;
        self.collision_prevention
            .attitude([q.w, q.x, q.y, q.z].map(|c| c as f32));
        self.collision_prevention.set(settings(&self.parameters));
        let input = PositionInput {
            dt_s: CYCLE_S,
            sticks: &self.sticks,
            estimate: &self.estimate,
            parameters: &self.parameters,
            followed_mps: self.controller.followed().velocity.xy(),
            tilt_limit_rad: self.tilt_limit_rad,
        };
        let (prevention, now_us) = (&mut self.collision_prevention, self.now_us);
        let mut outcome = None;
        let (setpoint, caps) = self.position_task.step(&input, |wanted, velocity| {
            let single = |v: Vector2<f64>| v.map(|c| c as f32);
            let outcome = outcome.insert(prevention.tick(now_us, single(wanted), single(velocity)));
            if outcome.active {
                outcome.setpoint_mps2.map(f64::from)
            } else {
                wanted
            }
        });
        if let Some(outcome) = outcome.filter(|outcome| outcome.active) {
            self.heed(&outcome, outbox);
        }
        (setpoint, caps, self.sticks.want_takeoff())
    }

    fn heed(&mut self, outcome: &Outcome, outbox: &mut Vec<Packet>) {
        self.fused_us = Some(self.now_us);
        if let Some(frame) = outcome.unsupported_frame {
            let text = format_args!("Obstacle message received in unsupported frame {frame}");
            self.wire
                .say_with(outbox, MavSeverity::MAV_SEVERITY_CRITICAL, text);
        }
        if outcome.wants_hold {
            let cause = HoldCause::NoObstacleData;
            self.commander
                .demand_hold(self.now_us, self.config.system_id, cause);
        }
    }
}

fn settings(parameters: &Parameters) -> Settings {
    let get = |p| parameters.get(p) as f32;
    Settings {
        distance_m: get(P::CP_DIST),
        delay_s: get(P::CP_DELAY),
        guide_deg: get(P::CP_GUIDE_ANG),
        go_without_data: parameters.get(P::CP_GO_NO_DATA) != 0.0,
        position_gain_per_s: get(P::MPC_XY_P),
        manual_speed_mps: get(P::MPC_VEL_MANUAL),
        jerk_mps3: get(P::MPC_JERK_MAX),
        acceleration_mps2: get(P::MPC_ACC_HOR),
        velocity_gain_per_s: get(P::MPC_XY_VEL_P_ACC),
    }
}
