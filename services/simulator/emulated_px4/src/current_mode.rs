//! CURRENT_MODE: the mode in force and the one that was asked for.
//!
//! PX4 sends it only when its commander has published its status since the last time: twice a second, and after every
//! change. So somebody who asks for it at a high rate sees changes at once and receives little in between, and somebody
//! who does not ask sees them up to two seconds late.

use jink_emulated_autopilot::link::Link;
use jink_emulated_autopilot::modes::px4::custom_mode;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{CURRENT_MODE_DATA, MavMessage, MavStandardMode};

/// The status is published at least this often (us).
const STATUS_PERIOD_US: u64 = 500_000;
/// From a change to its message (us): 20 to 30 ms were seen from the command to the message.
const PUBLISH_US: u64 = 20_000;

/// Whether there is something new to say, for each link.
#[derive(Clone, Debug, Default)]
pub struct ModeUpdates {
    reported: Option<(NavMode, NavMode)>,
    published_us: u64,
    /// From when on a change is to be sent.
    update_us: [Option<u64>; 2],
}

impl ModeUpdates {
    /// Looks at the modes once a step.
    pub fn step(&mut self, now_us: u64, mode: NavMode, intended: NavMode) {
        let changed = self.reported.replace((mode, intended)) != Some((mode, intended));
        if !changed && now_us - self.published_us < STATUS_PERIOD_US {
            return;
        }
        self.published_us = now_us;
        for update_us in &mut self.update_us {
            update_us.get_or_insert(now_us + PUBLISH_US);
        }
    }

    /// Whether `link` has not received the latest.
    pub fn is_due(&self, now_us: u64, link: Link) -> bool {
        self.update_us[link as usize].is_some_and(|from_us| now_us >= from_us)
    }

    /// `link` has received it.
    pub fn reported(&mut self, link: Link) {
        self.update_us[link as usize] = None;
    }
}

/// The message.
pub fn message(mode: NavMode, intended: NavMode) -> MavMessage {
    MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
        custom_mode: custom_mode(mode),
        intended_custom_mode: custom_mode(intended),
        standard_mode: standard_mode(mode),
    })
}

fn standard_mode(mode: NavMode) -> MavStandardMode {
    use MavStandardMode as S;
    match mode {
        NavMode::Position => S::MAV_STANDARD_MODE_POSITION_HOLD,
        NavMode::Return => S::MAV_STANDARD_MODE_SAFE_RECOVERY,
        NavMode::Mission => S::MAV_STANDARD_MODE_MISSION,
        NavMode::Land => S::MAV_STANDARD_MODE_LAND,
        NavMode::Takeoff => S::MAV_STANDARD_MODE_TAKEOFF,
        NavMode::Orbit => S::MAV_STANDARD_MODE_ORBIT,
        NavMode::Manual | NavMode::Hold | NavMode::Offboard | NavMode::Follow | NavMode::Unknown => {
            S::MAV_STANDARD_MODE_NON_STANDARD
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_update_is_sent_twice_a_second_and_shortly_after_a_change() {
        let mut update = ModeUpdates::default();
        let mut received_us = Vec::new();
        for now_us in (0..2_000_000u64).step_by(4_000) {
            let mode = if now_us < 700_000 {
                NavMode::Hold
            } else {
                NavMode::Mission
            };
            update.step(now_us, mode, mode);
            if update.is_due(now_us, Link::Companion) {
                update.reported(Link::Companion);
                received_us.push(now_us);
            }
        }
        assert_eq!(received_us, [20_000, 520_000, 720_000, 1_220_000, 1_720_000]);
    }
}
