//! The avoidance heartbeat: what component 196 says about the whole chain, and when.
//!
//! | state | when |
//! |---|---|
//! | BOOT | no system status yet, or the supervisor has not judged yet |
//! | STANDBY | healthy, but something that the chain needs has never come |
//! | ACTIVE | healthy, and position, ranges and approved trajectories flow |
//! | CRITICAL | degraded or stopping, the system status is stale, or something that flowed has stopped |
//! | FLIGHT TERMINATION | an essential service has been given up |
//!
//! PX4 lets the vehicle arm only while it hears ACTIVE. It is said here and nowhere else, from what is known in this
//! very step.

use crate::ticker::Ticker;
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::link::AvoidanceState;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Reading, Timestamp};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};

/// Rate of the avoidance heartbeat (Hz): two to five are asked for, the hard limit is one every 1.5 s.
pub const AVOIDANCE_RATE_HZ: f64 = 2.0;
/// Rate of the on-board computer's own heartbeat (Hz), the customary one.
pub const COMPUTER_RATE_HZ: f64 = 1.0;
/// A change of state is said at once, but not sooner after the last heartbeat than this (s): a flapping input must
/// not flood the link.
const SOONEST_S: f64 = 0.2;
/// A ring counts as fed while some sector was measured within this time (s): the ring itself comes on without ranges.
const RANGES_S: f64 = 0.5;

/// Whether something that is needed is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Input {
    /// Never come.
    #[default]
    Missing,
    /// There.
    Flowing,
    /// Has come, comes no more.
    Lost,
}

impl Input {
    /// From whether it is there now, remembering whether it ever was.
    pub fn notice(&mut self, there: bool) {
        *self = match (there, *self) {
            (true, _) => Input::Flowing,
            (false, Input::Missing) => Input::Missing,
            (false, _) => Input::Lost,
        };
    }
}

/// Whether `ring` is made from ranges that still come.
pub fn ranges_flow(now: Timestamp, ring: Reading<'_, SectorRing>) -> bool {
    ring.fresh().is_some_and(|ring| {
        ring.seen
            .iter()
            .any(|seen| seen.is_set() && now.seconds_since(*seen) <= RANGES_S)
    })
}

/// The state that follows from the system's health and the inputs.
pub fn judge(system: Reading<'_, SystemStatus>, inputs: &[Input]) -> AvoidanceState {
    let health = match system {
        Reading::Never => return AvoidanceState::Boot,
        Reading::Stale { .. } => return AvoidanceState::Critical,
        Reading::Fresh(status) => status.health.get(),
    };
    match health {
        Health::Starting => AvoidanceState::Boot,
        Health::Degraded | Health::Stopping => AvoidanceState::Critical,
        Health::Failed => AvoidanceState::Termination,
        Health::Healthy if inputs.contains(&Input::Lost) => AvoidanceState::Critical,
        Health::Healthy if inputs.contains(&Input::Missing) => AvoidanceState::Standby,
        Health::Healthy => AvoidanceState::Active,
    }
}

/// When which heartbeat is due.
#[derive(Clone, Debug)]
pub struct Heartbeats {
    state: AvoidanceState,
    said: Option<(AvoidanceState, Timestamp)>,
    avoidance: Ticker,
    computer: Ticker,
}

impl Default for Heartbeats {
    fn default() -> Self {
        Self {
            state: AvoidanceState::Uninit,
            said: None,
            avoidance: Ticker::new(AVOIDANCE_RATE_HZ),
            computer: Ticker::new(COMPUTER_RATE_HZ),
        }
    }
}

impl Heartbeats {
    /// Takes the state as judged now.
    pub fn set_state(&mut self, state: AvoidanceState) {
        self.state = state;
        if let Some((said, time)) = self.said
            && said != state
        {
            self.avoidance.hasten(time.plus_seconds(SOONEST_S));
        }
    }

    /// Somebody wants to hear the avoidance heartbeat, or that of the computer, now.
    pub fn ask(&mut self, now: Timestamp, of_computer: bool) {
        if of_computer {
            self.computer.hasten(now);
        } else {
            let soonest = self.said.map_or(now, |(_, time)| time.plus_seconds(SOONEST_S));
            self.avoidance.hasten(soonest.max(now));
        }
    }

    /// The state last said.
    pub fn said(&self) -> AvoidanceState {
        self.said.map_or(AvoidanceState::Uninit, |(state, _)| state)
    }

    /// The avoidance heartbeat, if it is due.
    pub fn avoidance(&mut self, now: Timestamp) -> Option<MavMessage> {
        if now < self.avoidance.due() {
            return None;
        }
        self.avoidance.restart(now);
        self.said = Some((self.state, now));
        Some(heartbeat(self.state))
    }

    /// The on-board computer's own heartbeat, if it is due.
    pub fn computer(&mut self, now: Timestamp) -> Option<MavMessage> {
        self.computer.take(now).then(|| heartbeat(AvoidanceState::Active))
    }

    /// When the next heartbeat is due.
    pub fn next_wake(&self, with_computer: bool) -> Timestamp {
        let computer = self.computer.due();
        let avoidance = self.avoidance.due();
        if with_computer {
            avoidance.min(computer)
        } else {
            avoidance
        }
    }
}

fn heartbeat(state: AvoidanceState) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: match state {
            AvoidanceState::Uninit => MavState::MAV_STATE_UNINIT,
            AvoidanceState::Boot => MavState::MAV_STATE_BOOT,
            AvoidanceState::Standby => MavState::MAV_STATE_STANDBY,
            AvoidanceState::Active => MavState::MAV_STATE_ACTIVE,
            AvoidanceState::Critical => MavState::MAV_STATE_CRITICAL,
            AvoidanceState::Termination => MavState::MAV_STATE_FLIGHT_TERMINATION,
        },
        mavlink_version: 3,
    })
}

#[cfg(test)]
mod tests {
    use super::{Heartbeats, Input, judge, ranges_flow};
    use jink_shared_types::health::{Health, SystemStatus};
    use jink_shared_types::link::AvoidanceState;
    use jink_shared_types::ring::SectorRing;
    use jink_shared_types::{Coded, Reading, SampleHeader, Stamped, Timestamp};
    use proptest::prelude::*;

    fn judged(health: Health, inputs: &[Input]) -> AvoidanceState {
        let status = SystemStatus {
            health: Coded::new(health),
            ..SystemStatus::default()
        };
        let header = SampleHeader::default();
        judge(
            Reading::Fresh(Stamped {
                sample: &status,
                header: &header,
            }),
            inputs,
        )
    }

    #[test]
    fn active_is_said_only_while_everything_is_healthy_and_flows() {
        let flowing = [Input::Flowing; 3];
        assert_eq!(judged(Health::Healthy, &flowing), AvoidanceState::Active);
        for health in [
            Health::Starting,
            Health::Degraded,
            Health::Failed,
            Health::Stopping,
        ] {
            assert_ne!(judged(health, &flowing), AvoidanceState::Active);
        }
        for spoilt in [Input::Missing, Input::Lost] {
            for i in 0..3 {
                let mut inputs = flowing;
                inputs[i] = spoilt;
                assert_ne!(judged(Health::Healthy, &inputs), AvoidanceState::Active);
            }
        }
    }

    #[test]
    fn the_other_states_tell_the_reason() {
        assert_eq!(judge(Reading::Never, &[]), AvoidanceState::Boot);
        assert_eq!(
            judge(Reading::Stale { age_s: 1.0 }, &[]),
            AvoidanceState::Critical
        );
        assert_eq!(judged(Health::Degraded, &[]), AvoidanceState::Critical);
        assert_eq!(judged(Health::Failed, &[]), AvoidanceState::Termination);
        assert_eq!(
            judged(Health::Healthy, &[Input::Missing]),
            AvoidanceState::Standby
        );
        assert_eq!(
            judged(Health::Healthy, &[Input::Missing, Input::Lost]),
            AvoidanceState::Critical
        );
    }

    #[test]
    fn a_ring_without_new_measurements_does_not_count_as_flowing() {
        let now = Timestamp::from_seconds(10.0);
        let header = SampleHeader::at(now);
        let mut ring = SectorRing::default();
        let flows = |ring: &SectorRing| {
            ranges_flow(
                now,
                Reading::Fresh(Stamped {
                    sample: ring,
                    header: &header,
                }),
            )
        };
        assert!(!flows(&ring));
        ring.seen[11] = Timestamp::from_seconds(9.0);
        assert!(!flows(&ring));
        ring.seen[11] = Timestamp::from_seconds(9.8);
        assert!(flows(&ring));
    }

    proptest! {
        #[test]
        fn a_change_is_said_at_once_and_never_more_than_five_times_a_second(
            states in proptest::collection::vec((0u8..3, 1u64..60), 1..300),
        ) {
            let mut heartbeats = Heartbeats::default();
            let mut now = Timestamp::from_seconds(1.0);
            let mut last: Option<Timestamp> = None;
            for (state, pause_ms) in states {
                now = Timestamp::from_ns(now.ns + pause_ms * 1_000_000);
                let state = match state {
                    0 => AvoidanceState::Standby,
                    1 => AvoidanceState::Active,
                    _ => AvoidanceState::Critical,
                };
                heartbeats.set_state(state);
                let since_s = last.map_or(f64::INFINITY, |last| now.seconds_since(last));
                let changed = heartbeats.said() != state;
                let sent = heartbeats.avoidance(now).is_some();
                prop_assert!(!sent || since_s >= 0.2 - 1e-9);
                prop_assert!(sent || since_s < 0.5);
                prop_assert!(sent || !changed || since_s < 0.2);
                if sent {
                    last = Some(now);
                    prop_assert_eq!(heartbeats.said(), state);
                }
            }
        }
    }
}
