//! Assisted flight on the link: what is sent, how it is chosen, and every way out of it.

use crate::support::*;
use jink_mavlink_gateway::{COMPONENT_AVOIDANCE, Gateway, GatewayConfig, ProfileName};
use jink_shared_types::link::AssistState;
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::{PreventedDemand, PreventionState};
use jink_shared_types::{Coded, Timestamp, Velocity};
use mavlink::dialect::*;
use nalgebra::Vector3;

const BOTH: [ProfileName; 2] = [ProfileName::Px4Offboard, ProfileName::ArdupilotGuided];
/// Channel of the switch.
const SWITCH: f64 = 7.0;
/// A setpoint is missing when none has come for longer than this (s).
const GAP_S: f64 = 0.03;

/// The autopilot, the pilot and the guard around a gateway.
struct Flight {
    bench: Bench,
    profile: ProfileName,
    mode: u32,
    obeys: bool,
    /// Forward and up, -1 to 1.
    sticks: Option<[f64; 2]>,
    switch_us: u16,
    guard: Option<PreventionState>,
    landed: MavLandedState,
    /// Whether heartbeats come: they do once a second only.
    beats: bool,
    /// Messages that were looked at.
    looked_at: usize,
    /// Modes that were asked for.
    asked: Vec<u32>,
    texts: Vec<String>,
    acks: Vec<MavResult>,
    setpoints: Vec<(Timestamp, SET_POSITION_TARGET_LOCAL_NED_DATA)>,
}

impl Flight {
    fn params() -> ParamSet {
        let mut params = ParamSet::default();
        for (name, value) in [
            ("CP_DIST", 2.0),
            ("MPC_VEL_MANUAL", 5.0),
            ("OA_ASSIST_CH", SWITCH),
        ] {
            params.set(name, value).unwrap();
        }
        params
    }

    fn config(profile: ProfileName) -> GatewayConfig {
        GatewayConfig {
            is_proven: true,
            ..GatewayConfig::from_params(&Self::params(), profile)
        }
    }

    /// In the air, in the pilot's mode, for as long as it takes to know all that is asked for.
    fn new(profile: ProfileName) -> Self {
        let mut bench = Bench::with(Self::config(profile));
        bench.gateway = Gateway::new(Self::config(profile)).with_params(&Self::params());
        let mut flight = Self {
            bench,
            profile,
            mode: pilots(profile),
            obeys: true,
            sticks: Some([0.0; 2]),
            switch_us: 1000,
            guard: Some(PreventionState::Free),
            landed: MavLandedState::MAV_LANDED_STATE_IN_AIR,
            beats: true,
            looked_at: 0,
            asked: Vec::new(),
            texts: Vec::new(),
            acks: Vec::new(),
            setpoints: Vec::new(),
        };
        flight.run(6.0);
        assert_eq!(flight.assist(), AssistState::Off);
        flight
    }

    fn engaged(profile: ProfileName) -> Self {
        let mut flight = Self::new(profile);
        flight.command(1.0);
        flight.run(1.0);
        assert_eq!(flight.assist(), AssistState::On, "{:?}", flight.texts);
        flight.forget();
        flight
    }

    fn forget(&mut self) {
        self.asked.clear();
        self.texts.clear();
        self.setpoints.clear();
    }

    fn assist(&self) -> AssistState {
        self.bench.status.unwrap().assist.get()
    }

    fn command(&mut self, on: f32) {
        self.bench.receive_from(
            255,
            190,
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_USER_1,
                param1: on,
                target_system: SYSTEM,
                target_component: COMPONENT_AVOIDANCE,
                ..COMMAND_LONG_DATA::default()
            }),
        );
    }

    fn run(&mut self, seconds: f64) {
        for i in 0..(seconds * 100.0).round() as u32 {
            let due = self.bench.now.plus_seconds(0.01);
            self.bench.idle_until(due);
            self.telemetry(i);
            self.bench.step();
            self.look();
        }
    }

    fn telemetry(&mut self, tick: u32) {
        let bench = &mut self.bench;
        if tick.is_multiple_of(50) && self.beats {
            let MavMessage::HEARTBEAT(mut beat) = heartbeat(self.mode, true) else {
                panic!("a heartbeat")
            };
            if self.profile == ProfileName::ArdupilotGuided {
                beat.autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
            }
            bench.receive(MavMessage::HEARTBEAT(beat));
            bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                landed_state: self.landed,
                ..EXTENDED_SYS_STATE_DATA::default()
            }));
        }
        if tick.is_multiple_of(20) && self.profile == ProfileName::Px4Offboard {
            bench.receive(MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
                custom_mode: self.mode,
                ..CURRENT_MODE_DATA::default()
            }));
        }
        if tick.is_multiple_of(3) {
            bench.receive_position(Vector3::new(1.0, 2.0, -5.0), Vector3::zeros());
        }
        if tick.is_multiple_of(2) {
            bench.receive_attitude(0.0);
        }
        if tick.is_multiple_of(5) {
            bench.ranges();
            let pulse_us = |share: f64| (1500.0 + 500.0 * share) as u16;
            let [forward, up] = self.sticks.unwrap_or_default();
            if self.profile == ProfileName::ArdupilotGuided && self.sticks.is_some() {
                bench.receive(MavMessage::RC_CHANNELS(RC_CHANNELS_DATA {
                    chan1_raw: 1500,
                    chan2_raw: pulse_us(-forward),
                    chan3_raw: pulse_us(up),
                    chan4_raw: 1500,
                    chan7_raw: self.switch_us,
                    chancount: 8,
                    ..RC_CHANNELS_DATA::default()
                }));
            } else if self.sticks.is_some() {
                bench.receive(MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                    x: (1000.0 * forward) as i16,
                    z: (500.0 + 500.0 * up) as i16,
                    ..MANUAL_CONTROL_DATA::default()
                }));
                bench.receive(MavMessage::RC_CHANNELS(RC_CHANNELS_DATA {
                    chan7_raw: self.switch_us,
                    chancount: 8,
                    ..RC_CHANNELS_DATA::default()
                }));
            }
        }
        bench.prevented = self.guard.map(|state| {
            let prevented = PreventedDemand {
                velocity: Velocity::new(1.5, -0.5, 0.0),
                state: Coded::new(state),
                ..PreventedDemand::default()
            };
            Sample::new(prevented, bench.now)
        });
    }

    /// Reads what was sent as the autopilot and the pilot do.
    fn look(&mut self) {
        let sent: Vec<_> = self.bench.sent[self.looked_at..].to_vec();
        self.looked_at = self.bench.sent.len();
        for sent in sent {
            match sent.message {
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => self.setpoints.push((sent.time, target)),
                MavMessage::STATUSTEXT(line) => self.texts.push(line.text.to_str().unwrap().to_owned()),
                MavMessage::COMMAND_ACK(ack) if ack.command == MavCmd::MAV_CMD_USER_1 => {
                    self.acks.push(ack.result);
                }
                MavMessage::COMMAND_LONG(command) if command.command == MavCmd::MAV_CMD_DO_SET_MODE => {
                    let (main, sub) = (command.param2 as u32, command.param3 as u32);
                    let mode = match self.profile {
                        ProfileName::Px4Offboard => main << 16 | sub << 24,
                        _ => main,
                    };
                    self.asked.push(mode);
                    if self.obeys {
                        self.mode = mode;
                        let autopilot = match self.profile {
                            ProfileName::Px4Offboard => MavAutopilot::MAV_AUTOPILOT_PX4,
                            _ => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                        };
                        let MavMessage::HEARTBEAT(beat) = heartbeat(mode, true) else {
                            panic!("a heartbeat")
                        };
                        self.bench
                            .receive(MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, ..beat }));
                    }
                }
                MavMessage::PARAM_REQUEST_READ(question) => self.answer(question.param_id.to_str().unwrap()),
                _ => {}
            }
        }
    }

    fn answer(&mut self, name: &str) {
        let value = match name {
            "RCMAP_ROLL" => 1.0,
            "RCMAP_PITCH" => 2.0,
            "RCMAP_THROTTLE" => 3.0,
            "RCMAP_YAW" => 4.0,
            "MAN_OVERRIDE_SPD" => -1.0,
            _ if name.ends_with("_MIN") => 1000.0,
            _ if name.ends_with("_MAX") => 2000.0,
            _ if name.ends_with("_TRIM") => 1500.0,
            _ if name.ends_with("_REVERSED") => 0.0,
            _ => return,
        };
        self.bench.receive(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: name.into(),
            param_value: value,
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            ..PARAM_VALUE_DATA::default()
        }));
    }

    fn set_parameter(&mut self, name: &str, value: f32) {
        self.bench.receive_from(
            255,
            190,
            MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_id: name.into(),
                param_value: value,
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
                target_system: SYSTEM,
                target_component: COMPONENT_AVOIDANCE,
            }),
        );
    }

    fn reported(&self, text: &str) -> bool {
        self.texts.iter().any(|reported| reported == text)
    }

    /// Setpoints have come without a gap.
    fn assert_streamed(&self) {
        for pair in self.setpoints.windows(2) {
            let gap_s = pair[1].0.seconds_since(pair[0].0);
            assert!(gap_s <= GAP_S, "{:?}: silent for {gap_s} s", self.profile);
        }
    }
}

fn pilots(profile: ProfileName) -> u32 {
    match profile {
        ProfileName::Px4Offboard => MODE_POSITION,
        _ => 5,
    }
}

fn following(profile: ProfileName) -> u32 {
    match profile {
        ProfileName::Px4Offboard => 6 << 16,
        _ => 4,
    }
}

fn holding(profile: ProfileName) -> u32 {
    match profile {
        ProfileName::Px4Offboard => MODE_HOLD,
        _ => 17,
    }
}

#[test]
fn chosen_by_command_it_streams_first_and_then_asks_for_the_mode_once() {
    for profile in BOTH {
        let mut flight = Flight::new(profile);
        assert!(flight.asked.is_empty());
        flight.forget();
        flight.command(1.0);
        flight.run(2.0);
        assert_eq!(flight.acks, [MavResult::MAV_RESULT_ACCEPTED]);
        assert_eq!(flight.asked, [following(profile)]);
        assert!(flight.reported("jink: assisted flight on"), "{:?}", flight.texts);
        assert!(flight.setpoints.len() > 90, "{profile:?}");
        flight.assert_streamed();
        // Numbers that mean nothing.
        flight.command(0.5);
        flight.run(0.1);
        assert_eq!(flight.acks.last(), Some(&MavResult::MAV_RESULT_DENIED));
        assert_eq!(flight.assist(), AssistState::On);
    }
}

#[test]
fn what_is_sent_is_what_the_guard_allows_and_climb_is_the_pilots() {
    for profile in BOTH {
        let mut flight = Flight::engaged(profile);
        flight.sticks = Some([1.0, 1.0]);
        flight.run(2.0);
        let (_, target) = flight.setpoints.last().unwrap();
        assert_eq!((target.vx, target.vy), (1.5, -0.5), "{profile:?}");
        assert_eq!(target.vz, -1.5, "OA_SPD_CLIMB");
        let place_ignored = if profile == ProfileName::Px4Offboard { 3 } else { 7 };
        assert_eq!(target.type_mask.bits() & 0x1ff, place_ignored);
        let (demand, _) = flight.bench.outputs.pilot_demand.unwrap_or_else(|| {
            // It is reported twenty times a second.
            flight.run(0.05);
            flight.bench.outputs.pilot_demand.unwrap_or_default()
        });
        assert!(demand.velocity.x_mps == 5.0 || demand == Default::default());
    }
}

#[test]
fn a_switch_chooses_it_and_must_be_down_first() {
    for profile in BOTH {
        let mut flight = Flight::new(profile);
        flight.switch_us = 1900;
        flight.run(1.0);
        assert_eq!(flight.assist(), AssistState::On, "{:?}", flight.texts);
        flight.switch_us = 1100;
        flight.run(1.0);
        assert_eq!(flight.asked, [following(profile), pilots(profile)]);
        assert_eq!(flight.assist(), AssistState::Off);
        // The pilot takes it by his mode: the switch, still up, does not ask for it back.
        flight.switch_us = 1900;
        flight.run(1.0);
        flight.forget();
        flight.mode = pilots(profile);
        flight.run(10.0);
        assert!(flight.asked.is_empty() && flight.reported("jink: assisted flight off: mode changed"));
    }
}

#[test]
fn what_speaks_against_it_is_answered_and_reported() {
    type Change = fn(&mut Flight);
    let cases: [(&str, Change); 5] = [
        ("set CP_DIST", |flight| flight.set_parameter("CP_DIST", -1.0)),
        ("not in the air", |flight| {
            flight.landed = MavLandedState::MAV_LANDED_STATE_ON_GROUND;
        }),
        ("choose Position first", |flight| {
            flight.mode = holding(flight.profile);
        }),
        ("no sticks", |flight| flight.sticks = None),
        ("centre the throttle", |flight| flight.sticks = Some([0.0, -1.0])),
    ];
    for profile in BOTH {
        for (word, change) in cases {
            let mut flight = Flight::new(profile);
            change(&mut flight);
            flight.run(2.0);
            flight.command(1.0);
            flight.run(2.0);
            assert_eq!(
                flight.acks,
                [MavResult::MAV_RESULT_TEMPORARILY_REJECTED],
                "{word}"
            );
            assert!(
                flight.reported(&format!("jink: no assisted flight: {word}")),
                "{word}: {:?}",
                flight.texts
            );
            assert!(flight.asked.is_empty(), "{word}");
        }
    }
}

#[test]
fn every_exit_is_the_pilots_mode_or_hold_and_the_stream_lasts_until_it_is_there() {
    type Change = fn(&mut Flight);
    let cases: [(&str, f64, bool, Change); 6] = [
        ("switched off", 1.0, true, |flight| flight.command(0.0)),
        ("CP_DIST is off", 1.0, true, |flight| {
            flight.set_parameter("CP_DIST", -1.0);
        }),
        ("landed", 1.5, true, |flight| {
            flight.landed = MavLandedState::MAV_LANDED_STATE_ON_GROUND;
        }),
        ("no sticks", 3.0, false, |flight| flight.sticks = None),
        ("no range data", 6.0, false, |flight| {
            flight.guard = Some(PreventionState::Blind);
        }),
        ("no range data", 6.0, false, |flight| flight.guard = None),
    ];
    for profile in BOTH {
        for (word, within_s, is_pilots, change) in cases {
            let mut flight = Flight::engaged(profile);
            change(&mut flight);
            let mut seconds = 0.0;
            while flight.asked.is_empty() {
                flight.run(0.05);
                seconds += 0.05;
                assert!(seconds < within_s + 0.5, "{profile:?} {word}: {:?}", flight.texts);
            }
            flight.assert_streamed();
            flight.run(10.0);
            let mode = if is_pilots {
                pilots(profile)
            } else {
                holding(profile)
            };
            assert_eq!(flight.asked, [mode], "{profile:?} {word}");
            assert!(
                flight.reported(&format!("jink: assisted flight off: {word}")),
                "{word}: {:?}",
                flight.texts
            );
            assert_eq!(flight.assist(), AssistState::Off);
        }
    }
}

#[test]
fn while_nobody_watches_or_steers_it_stands_still() {
    type Change = fn(&mut Flight);
    let cases: [Change; 3] = [
        |flight| flight.guard = None,
        |flight| flight.guard = Some(PreventionState::Blind),
        |flight| flight.guard = Some(PreventionState::Off),
    ];
    for profile in BOTH {
        for change in cases {
            let mut flight = Flight::engaged(profile);
            flight.sticks = Some([1.0, 0.0]);
            change(&mut flight);
            flight.run(2.0);
            let (_, target) = flight.setpoints.last().unwrap();
            assert_eq!((target.vx, target.vy), (0.0, 0.0), "{profile:?}");
            assert_eq!(target.type_mask.bits() & 0x1ff, 0, "its place is held");
        }
    }
}

#[test]
fn a_gateway_that_is_started_again_goes_on_from_the_record_and_only_from_it() {
    for profile in BOTH {
        let mut flight = Flight::engaged(profile);
        flight.sticks = Some([0.5, 0.0]);
        flight.run(1.0);
        let record = flight.bench.gateway.record(flight.bench.now);
        let bytes = record.unwrap().to_bytes();
        let record = jink_mavlink_gateway::executive::record::Record::of_bytes(&bytes);
        assert_eq!(
            record.and_then(|record| record.assist).unwrap().pilots_mode,
            pilots(profile)
        );
        for (record, goes_on) in [(record, true), (None, false)] {
            flight.bench.gateway = Gateway::new(Flight::config(profile))
                .with_params(&Flight::params())
                .resuming(flight.bench.now, record);
            flight.mode = following(profile);
            flight.forget();
            flight.run(3.0);
            assert_eq!(
                flight.assist() == AssistState::On,
                goes_on,
                "{profile:?}: {:?}",
                flight.texts
            );
            assert!(flight.asked.is_empty(), "{profile:?}");
            let (_, target) = flight.setpoints.last().unwrap();
            assert_eq!(target.vx != 0.0, goes_on, "{profile:?}");
        }
    }
}

#[test]
fn an_autopilot_that_has_started_anew_is_not_assisted() {
    for profile in BOTH {
        let mut flight = Flight::engaged(profile);
        flight.bench.boot_ms_at_zero = 1000;
        flight.mode = pilots(profile);
        flight.run(1.0);
        assert_eq!(flight.assist(), AssistState::Off);
        assert!(flight.asked.is_empty());
    }
}

#[test]
fn when_jink_is_ended_it_stops_and_the_autopilot_holds() {
    for profile in BOTH {
        let mut flight = Flight::engaged(profile);
        flight.sticks = Some([1.0, 1.0]);
        flight.run(1.0);
        flight.forget();
        flight.bench.gateway.request_stop();
        flight.run(2.0);
        assert_eq!(flight.asked.first(), Some(&holding(profile)), "{profile:?}");
        assert_eq!(flight.assist(), AssistState::Off);
        // Nothing brings it back while jink is about to end.
        flight.command(1.0);
        flight.run(1.0);
        assert_eq!(
            flight.acks.last(),
            Some(&MavResult::MAV_RESULT_TEMPORARILY_REJECTED)
        );
        assert!(!flight.asked.contains(&following(profile)), "{profile:?}");
    }
}
