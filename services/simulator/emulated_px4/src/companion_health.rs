//! Whether PX4 believes in its companion: the heartbeat of component 196, with the observed delays and the known hole.
//!
//! * It counts if it comes from component 196 with the vehicle's own system id, or from any system if its type is a
//!   ground station's. Healthy means exactly MAV_STATE_ACTIVE; the type is free.
//! * A change of health shows [`REPORT_DELAY_US`] after the first heartbeat that says so (observed 0.5 to 0.65 s);
//!   silence counts as loss after [`LOSS_US`] (observed 6.1 s: 5 s in the commander plus the link's own 1.1 s).
//! * The hole: silence of an onboard controller (type 18, any component) is declared first and switches the check for the
//!   avoidance system off. If the only type 18 heartbeat is component 196 itself, its health stays as it was for good.
//! * Current PX4 judges nobody: it only says when onboard controllers or ground stations fall silent.

use super::firmware::Firmware;
use super::heartbeat_watch::{Change, HeartbeatWatch, Patience};
use jink_emulated_autopilot::link::COMPONENT_AVOIDANCE;

/// From the first heartbeat to the change of health (us).
const REPORT_DELAY_US: u64 = 550_000;
/// From the last heartbeat to the loss, beyond the commander's own time (us).
const LINK_DELAY_US: u64 = 1_100_000;
/// The commander's time for the avoidance system, hard-coded in the firmware (us).
const AVOIDANCE_LOSS_US: u64 = 5_000_000;
/// Onboard controllers of current PX4: observed 6.3 to 7.0 s, and about a second for the way back.
const CURRENT_CONTROLLER: Patience = Patience {
    loss_us: 6_600_000,
    back_us: 1_000_000,
};
/// Ground stations of current PX4: observed once, about 14 s; the way back was not watched.
const CURRENT_GROUND_STATION: Patience = Patience {
    loss_us: 14_000_000,
    back_us: 1_000_000,
};
/// MAV_STATE_ACTIVE.
const STATE_ACTIVE: u8 = 4;
/// MAV_TYPE_GCS.
const TYPE_GROUND_STATION: u8 = 6;
/// MAV_TYPE_ONBOARD_CONTROLLER.
const TYPE_ONBOARD_CONTROLLER: u8 = 18;

/// A heartbeat as far as it matters here.
#[derive(Clone, Copy, Debug)]
pub struct ForeignHeartbeat {
    /// Sender's system.
    pub system_id: u32,
    /// Sender's component.
    pub component_id: u8,
    /// MAV_TYPE.
    pub kind: u8,
    /// MAV_STATE.
    pub state: u8,
}

/// What changed in a check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CompanionChanges {
    /// Of the onboard controller.
    pub controller: Option<Change>,
    /// Of the ground station.
    pub ground_station: Option<Change>,
}

/// The judgement.
#[derive(Clone, Debug)]
pub struct CompanionHealth {
    firmware: Firmware,
    avoidance_us: Option<u64>,
    controller: HeartbeatWatch,
    ground_station: HeartbeatWatch,
    valid: bool,
    pending: Option<(u64, bool)>,
}

impl CompanionHealth {
    /// Nobody seen yet.
    pub fn new(firmware: Firmware) -> Self {
        Self {
            firmware,
            avoidance_us: None,
            controller: HeartbeatWatch::default(),
            ground_station: HeartbeatWatch::default(),
            valid: false,
            pending: None,
        }
    }

    /// Whether the avoidance system counts as healthy.
    pub fn is_valid(&self) -> bool {
        self.valid
    }

    /// Takes a heartbeat that is not the autopilot's own.
    pub fn receive(&mut self, now_us: u64, own_system_id: u8, heartbeat: &ForeignHeartbeat) {
        let own_system = heartbeat.system_id == u32::from(own_system_id);
        if !own_system && heartbeat.kind != TYPE_GROUND_STATION {
            return;
        }
        match heartbeat.kind {
            TYPE_ONBOARD_CONTROLLER => self.controller.receive(now_us),
            TYPE_GROUND_STATION => self.ground_station.receive(now_us),
            _ => {}
        }
        if self.firmware.has_trajectory_interface() && heartbeat.component_id == COMPONENT_AVOIDANCE {
            self.avoidance_us = Some(now_us);
            let healthy = heartbeat.state == STATE_ACTIVE;
            self.pending = match self.pending {
                _ if healthy == self.valid => None,
                Some(pending) if pending.1 == healthy => Some(pending),
                _ => Some((now_us + REPORT_DELAY_US, healthy)),
            };
        }
    }

    /// Looks at the clock. `required`: COM_OBS_AVOID; `controller_loss_s`: COM_OBC_LOSS_T, which current PX4 does not have.
    pub fn check(&mut self, now_us: u64, required: bool, controller_loss_s: f64) -> CompanionChanges {
        let mut changes = CompanionChanges::default();
        if let Some((due_us, healthy)) = self.pending
            && now_us >= due_us
        {
            self.valid = healthy;
            self.pending = None;
        }
        let controller = match self.firmware {
            Firmware::Trajectory(_) => Patience {
                loss_us: (controller_loss_s * 1e6) as u64 + LINK_DELAY_US,
                back_us: 0,
            },
            Firmware::Current => CURRENT_CONTROLLER,
        };
        changes.controller = self.controller.check(now_us, &controller);
        if !self.firmware.has_trajectory_interface() {
            changes.ground_station = self.ground_station.check(now_us, &CURRENT_GROUND_STATION);
        }
        let silent = self
            .avoidance_us
            .is_some_and(|last_us| now_us - last_us > AVOIDANCE_LOSS_US + LINK_DELAY_US);
        if required && !self.controller.is_lost() && silent {
            self.valid = false;
            self.pending = None;
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends the heartbeat at 2 Hz from `from_s` to `until_s` and returns the times (s) at which validity changed.
    fn changes(heartbeat: ForeignHeartbeat, from_s: f64, until_s: f64) -> (CompanionHealth, Vec<f64>) {
        let mut health = CompanionHealth::new(Firmware::default());
        let mut times = Vec::new();
        for now_us in (0..30_000_000u64).step_by(4_000) {
            let now_s = now_us as f64 * 1e-6;
            if now_s >= from_s && now_s <= until_s && now_us % 500_000 == 0 {
                health.receive(now_us, 1, &heartbeat);
            }
            let before = health.is_valid();
            health.check(now_us, true, 5.0);
            if health.is_valid() != before {
                times.push(now_s);
            }
        }
        (health, times)
    }

    fn heartbeat(component_id: u8, kind: u8, state: u8) -> ForeignHeartbeat {
        ForeignHeartbeat {
            system_id: 1,
            component_id,
            kind,
            state,
        }
    }

    #[test]
    fn healthy_half_a_second_after_the_first_heartbeat_and_lost_six_seconds_after_the_last() {
        let (_, times) = changes(heartbeat(196, 0, 4), 1.0, 10.0);
        assert_eq!(times.len(), 2);
        assert!((0.5..=0.65).contains(&(times[0] - 1.0)));
        assert!((times[1] - 16.1).abs() < 0.1);
    }

    #[test]
    fn only_component_196_of_the_own_system_counts_except_from_a_ground_station() {
        assert!(changes(heartbeat(191, 18, 4), 1.0, 30.0).1.is_empty());
        let mut foreign = heartbeat(196, 18, 4);
        foreign.system_id = 2;
        assert!(changes(foreign, 1.0, 30.0).1.is_empty());
        foreign.system_id = 255;
        foreign.kind = 6;
        assert_eq!(changes(foreign, 1.0, 30.0).1.len(), 1);
    }

    #[test]
    fn only_the_state_active_is_healthy() {
        for state in [0, 1, 2, 3, 5, 6, 8] {
            assert!(changes(heartbeat(196, 18, state), 1.0, 30.0).1.is_empty());
        }
        assert_eq!(changes(heartbeat(196, 18, 4), 1.0, 30.0).1.len(), 1);
        assert_eq!(changes(heartbeat(196, 0, 4), 1.0, 30.0).1.len(), 1);
    }

    #[test]
    fn hole_1_a_lone_type_18_heartbeat_stays_healthy_for_good() {
        let (health, times) = changes(heartbeat(196, 18, 4), 1.0, 10.0);
        assert_eq!(times.len(), 1);
        assert!(health.is_valid());
    }

    #[test]
    fn a_second_onboard_controller_keeps_the_avoidance_check_alive() {
        let mut health = CompanionHealth::new(Firmware::default());
        for now_us in (0..30_000_000u64).step_by(4_000) {
            if now_us % 500_000 == 0 {
                health.receive(now_us, 1, &heartbeat(191, 18, 4));
                if now_us < 10_000_000 {
                    health.receive(now_us, 1, &heartbeat(196, 18, 4));
                }
            }
            health.check(now_us, true, 5.0);
            if now_us == 9_000_000 {
                assert!(health.is_valid());
            }
        }
        assert!(!health.is_valid());
    }
}
