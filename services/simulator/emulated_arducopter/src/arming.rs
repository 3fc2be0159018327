//! Who may arm, and when motors stop by themselves.

use super::ArduCopter;
use super::parameters::Parameter as P;
use jink_emulated_autopilot::link::Packet;
use jink_emulated_autopilot::mission::single;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::{MavResult, MavSeverity};

/// `param2` of MAV_CMD_COMPONENT_ARM_DISARM that forces it.
const FORCE: f32 = 21_196.0;

impl ArduCopter {
    /// MAV_CMD_COMPONENT_ARM_DISARM.
    pub(super) fn arm_or_disarm(&mut self, arm: bool, magic: f32, outbox: &mut Vec<Packet>) -> MavResult {
        let forced = magic == FORCE;
        if !arm {
            if !forced && !self.land_detector.is_landed() {
                return MavResult::MAV_RESULT_FAILED;
            }
            self.disarm(outbox);
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if self.armed {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if let (false, Some(reason)) = (forced, self.arming_obstacle()) {
            self.wire.say(outbox, MavSeverity::MAV_SEVERITY_CRITICAL, reason);
            return MavResult::MAV_RESULT_FAILED;
        }
        self.armed = true;
        self.landed_since_us = self.now_us;
        self.home = single(self.estimate.position.vector());
        self.frame.home_down_m = self.home.z;
        self.store_home_item();
        let text = "Arming motors";
        self.wire.say(outbox, MavSeverity::MAV_SEVERITY_INFO, text);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// What prevents arming.
    fn arming_obstacle(&self) -> Option<&'static str> {
        if !self.is_ready() {
            return Some("Arm: Need Position Estimate");
        }
        if !self.mode.allows_arming() {
            return Some("Arm: Mode not armable");
        }
        if self.proximity.is_enabled() && !self.proximity.is_healthy(self.now_us) {
            return Some("Arm: PRX1: No Data");
        }
        None
    }

    pub(super) fn disarm(&mut self, outbox: &mut Vec<Packet>) {
        if !self.armed {
            return;
        }
        self.armed = false;
        self.may_take_off = false;
        self.auto.rewind(self.mode == Mode::Auto);
        let text = "Disarming motors";
        self.wire.say(outbox, MavSeverity::MAV_SEVERITY_INFO, text);
    }

    /// Standing on the ground for DISARM_DELAY with nobody wanting to fly.
    pub(super) fn disarm_idle(&mut self, outbox: &mut Vec<Packet>) {
        let wanted = self.may_take_off && self.guided_is_taking_off()
            || self.mode.is_piloted() && self.sticks.throttle() > 0.05;
        if !self.land_detector.is_landed() || wanted {
            self.landed_since_us = self.now_us;
        }
        let delay_s = self.parameters.get(P::DISARM_DELAY);
        let idle_s = (self.now_us - self.landed_since_us) as f64 * 1e-6;
        if self.armed && delay_s > 0.0 && idle_s > delay_s {
            self.disarm(outbox);
        }
    }

    fn guided_is_taking_off(&self) -> bool {
        self.mode == Mode::Auto || self.mode == Mode::Guided && self.guided.is_taking_off()
    }
}
