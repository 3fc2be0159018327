//! The avoidance heartbeat: what component 196 says about the whole chain, and when.
//!
//! | state | when |
//! |---|---|
//! | BOOT | no system status yet, or a process that has not begun its work |
//! | STANDBY | every process works, but something that the chain needs has never come |
//! | ACTIVE | healthy, and position, ranges and approved trajectories flow |
//! | CRITICAL | degraded or stopping, the system status is stale, or something that flowed has stopped |
//! | FLIGHT TERMINATION | an essential service has been given up |
//!
//! PX4 lets the vehicle arm only while it receives ACTIVE. It is said here and nowhere else, from what is known in this
//! very step. What follows ACTIVE is said when it has lasted for [`DEBOUNCE_S`]; meanwhile nothing is said at all.

use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::health::{Health, ProcessStatus, ServiceState, SystemStatus};
use jink_shared_types::link::AvoidanceState;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Reading, Timestamp};
use mavlink::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};

/// Rate of the avoidance heartbeat (Hz): two to five are asked for, the hard limit is one every 1.5 s.
pub const AVOIDANCE_RATE_HZ: f64 = 2.0;
/// Rate of the on-board computer's own heartbeat (Hz), the customary one.
pub const COMPUTER_RATE_HZ: f64 = 1.0;
/// A change of state is said at once, but not sooner after the last heartbeat than this (s): a flapping input must
/// not flood the link.
const SOONEST_S: f64 = 0.2;
/// An autopilot may be silent for 0.1 to 0.16 s when it arms (PX4 in simulation opens its log), and its state is stale after
/// 0.1 s. A lack that lasts less than this (s) has no consequence in flight, where every setpoint ends at rest.
const DEBOUNCE_S: f64 = 0.25;
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
    let status = match system {
        Reading::Never => return AvoidanceState::Boot,
        Reading::Stale { .. } => return AvoidanceState::Critical,
        Reading::Fresh(status) => status,
    };
    match status.health.get() {
        Health::Starting if is_up(&status) => AvoidanceState::Standby,
        Health::Starting => AvoidanceState::Boot,
        Health::Degraded | Health::Stopping => AvoidanceState::Critical,
        Health::Failed => AvoidanceState::Termination,
        Health::Healthy if inputs.contains(&Input::Lost) => AvoidanceState::Critical,
        Health::Healthy if inputs.contains(&Input::Missing) => AvoidanceState::Standby,
        Health::Healthy => AvoidanceState::Active,
    }
}

/// Whether every process works, or waits for its inputs.
fn is_up(status: &SystemStatus) -> bool {
    let waits = |process: &ProcessStatus| {
        let state = process.state.get();
        matches!(state, ServiceState::Standby | ServiceState::Active)
    };
    !status.processes().is_empty() && status.processes().iter().all(waits)
}

/// When which heartbeat is due.
#[derive(Clone, Debug)]
pub struct Heartbeats {
    state: AvoidanceState,
    said: Option<(AvoidanceState, Timestamp)>,
    /// While it is not certain that what follows ACTIVE lasts: when that will be said.
    debounce_until: Option<Timestamp>,
    avoidance: Ticker,
    computer: Ticker,
}

impl Default for Heartbeats {
    fn default() -> Self {
        Self {
            state: AvoidanceState::Uninit,
            said: None,
            debounce_until: None,
            avoidance: Ticker::new(AVOIDANCE_RATE_HZ),
            computer: Ticker::new(COMPUTER_RATE_HZ),
        }
    }
}

impl Heartbeats {
    /// Takes the state as judged at `now`.
    pub fn set_state(&mut self, now: Timestamp, state: AvoidanceState) {
        self.state = state;
        let Some((said, time)) = self.said.filter(|(said, _)| *said != state) else {
            self.debounce_until = None;
            return;
        };
        // Termination is final, and said at once.
        if said == AvoidanceState::Active && state != AvoidanceState::Termination {
            self.debounce_until.get_or_insert(now.plus_seconds(DEBOUNCE_S));
        }
        self.avoidance.schedule_early(time.plus_seconds(SOONEST_S));
    }

    fn avoidance_due(&self) -> Timestamp {
        let due = self.avoidance.due();
        self.debounce_until.map_or(due, |until| due.max(until))
    }

    /// Somebody asks for the avoidance heartbeat, or that of the computer, now.
    pub fn ask(&mut self, now: Timestamp, of_computer: bool) {
        if of_computer {
            self.computer.schedule_early(now);
        } else {
            let soonest = self.said.map_or(now, |(_, time)| time.plus_seconds(SOONEST_S));
            self.avoidance.schedule_early(soonest.max(now));
        }
    }

    /// The state last said.
    pub fn said(&self) -> AvoidanceState {
        self.said.map_or(AvoidanceState::Uninit, |(state, _)| state)
    }

    /// The avoidance heartbeat, if it is due.
    pub fn avoidance(&mut self, now: Timestamp) -> Option<MavMessage> {
        if now < self.avoidance_due() {
            return None;
        }
        self.debounce_until = None;
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
        let avoidance = self.avoidance_due();
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
    use jink_shared_types::health::{Health, ServiceState, SystemStatus};
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
    fn active_is_reported_only_while_everything_is_healthy_and_flows() {
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

    #[test]
    fn a_process_that_waits_for_its_inputs_is_up() {
        let judged = |states: [ServiceState; 2]| {
            let mut status = SystemStatus {
                health: Coded::new(Health::Starting),
                ..SystemStatus::default()
            };
            status.len = 2;
            for (process, state) in status.processes.iter_mut().zip(states) {
                process.state = Coded::new(state);
            }
            let header = SampleHeader::default();
            let reading = Reading::Fresh(Stamped {
                sample: &status,
                header: &header,
            });
            judge(reading, &[Input::Missing])
        };
        use ServiceState::{Active, Standby, Starting};
        assert_eq!(judged([Active, Standby]), AvoidanceState::Standby);
        assert_eq!(judged([Active, Starting]), AvoidanceState::Boot);
    }

    /// States that begin at these times (s), and what is said when.
    fn said(states: &[(f64, AvoidanceState)]) -> Vec<(f64, u8)> {
        let mut heartbeats = Heartbeats::default();
        let mut said = Vec::new();
        for step in 0..300 {
            let time_s = f64::from(step) * 0.01;
            let now = Timestamp::from_seconds(100.0 + time_s);
            let state = states.iter().rev().find(|(begin_s, _)| *begin_s <= time_s);
            heartbeats.set_state(now, state.map_or(AvoidanceState::Boot, |(_, state)| *state));
            if heartbeats.avoidance(now).is_some() {
                said.push((time_s, heartbeats.said() as u8));
            }
        }
        said
    }

    #[test]
    fn a_stall_of_a_moment_is_not_reported_as_critical_and_one_that_lasts_is() {
        use AvoidanceState::{Active, Critical, Termination};
        let short = said(&[(0.0, Active), (1.05, Critical), (1.21, Active)]);
        assert!(short.iter().all(|(_, state)| *state == Active as u8), "{short:?}");
        // Nor is ACTIVE said while it is not so.
        let over_a_beat = said(&[(0.0, Active), (0.95, Critical), (1.11, Active)]);
        assert!(
            over_a_beat
                .iter()
                .all(|(time_s, _)| !(0.95..1.1).contains(time_s)),
            "{over_a_beat:?}"
        );
        let long = said(&[(0.0, Active), (1.05, Critical)]);
        let first = long.iter().find(|(_, state)| *state == Critical as u8).unwrap();
        assert!((first.0 - 1.3).abs() < 0.02, "{long:?}");
        let ended = said(&[(0.0, Active), (1.25, Termination)]);
        assert!(ended.contains(&(1.25, Termination as u8)), "{ended:?}");
    }

    proptest! {
        #[test]
        fn a_change_is_reported_soon_and_never_more_than_five_times_a_second(
            states in proptest::collection::vec((0u8..3, 1u64..60), 1..300),
        ) {
            let mut heartbeats = Heartbeats::default();
            let mut now = Timestamp::from_seconds(1.0);
            let mut last: Option<Timestamp> = None;
            let mut changed_since: Option<Timestamp> = None;
            for (state, pause_ms) in states {
                now = Timestamp::from_ns(now.ns + pause_ms * 1_000_000);
                let state = match state {
                    0 => AvoidanceState::Standby,
                    1 => AvoidanceState::Active,
                    _ => AvoidanceState::Critical,
                };
                heartbeats.set_state(now, state);
                let since_s = last.map_or(f64::INFINITY, |last| now.seconds_since(last));
                let sent = heartbeats.avoidance(now).is_some();
                prop_assert!(!sent || since_s >= 0.2 - 1e-9);
                // Half a second, a moment of doubt, and up to 60 ms until the next look.
                prop_assert!(sent || since_s < 0.5 + 0.25 + 0.06);
                if sent {
                    last = Some(now);
                    prop_assert_eq!(heartbeats.said(), state);
                }
                if heartbeats.said() == state {
                    changed_since = None;
                } else {
                    let since = *changed_since.get_or_insert(now);
                    prop_assert!(now.seconds_since(since) < 0.25 + 0.06 + 1e-9 || since_s < 0.2);
                }
            }
        }
    }
}
