//! Whether the profile is for the autopilot on the link: found out before the first setpoint, reported with the right
//! one, and chosen by jink where that is left to it.

use crate::support::*;
use jink_mavlink_gateway::{GatewayConfig, ProfileName};
use jink_shared_types::health::Health;
use jink_shared_types::link::ProfileFit;
use jink_shared_types::motion::Verdict;
use jink_shared_types::params::ParamSet;
use mavlink::dialect::*;
use mavlink::{Message, MessageData};
use nalgebra::Vector3;

/// What an autopilot says of itself.
#[derive(Clone, Copy)]
struct Firmware {
    autopilot: MavAutopilot,
    custom_mode: u32,
    /// COM_OBS_AVOID and EAV_EN; `None` = it has no such parameter.
    switches: [Option<i32>; 2],
    /// Unknown parameters are answered with PARAM_ERROR; else not at all.
    says_unknown: bool,
    answers: bool,
    /// A parameter about which it says nothing at all.
    leaves_open: &'static str,
}

const PX4_2021: Firmware = Firmware {
    autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
    custom_mode: 4 << 16 | 3 << 24,
    switches: [Some(1), None],
    says_unknown: false,
    answers: true,
    leaves_open: "",
};
const PX4_TODAY: Firmware = Firmware {
    switches: [None, None],
    ..PX4_2021
};
const ARDUCOPTER: Firmware = Firmware {
    autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
    custom_mode: 5,
    says_unknown: true,
    ..PX4_TODAY
};

/// What was seen of some seconds beside it.
struct Seen {
    states: Vec<MavState>,
    texts: Vec<String>,
    setpoints: usize,
    modes: usize,
    mission_requests: usize,
    fit: ProfileFit,
    profile: String,
}

fn is_setpoint(id: u32) -> bool {
    #[allow(deprecated)]
    let trajectories = [
        TRAJECTORY_REPRESENTATION_BEZIER_DATA::ID,
        TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID,
    ];
    id == SET_POSITION_TARGET_LOCAL_NED_DATA::ID || trajectories.contains(&id)
}

/// The rest of jink is healthy; the vehicle stands in the air.
fn play(bench: &mut Bench, firmware: Firmware, seconds: f64) -> Seen {
    let mut seen = Seen {
        states: Vec::new(),
        texts: Vec::new(),
        setpoints: 0,
        modes: 0,
        mission_requests: 0,
        fit: ProfileFit::Unknown,
        profile: String::new(),
    };
    let mut looked_at = bench.sent.len();
    bench.fly(seconds, |bench, t| {
        let tick = (t * 100.0).round() as u32;
        if tick.is_multiple_of(50) {
            let MavMessage::HEARTBEAT(beat) = heartbeat(firmware.custom_mode, true) else {
                return;
            };
            bench.receive(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                autopilot: firmware.autopilot,
                ..beat
            }));
        }
        if tick.is_multiple_of(20) {
            bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                landed_state: MavLandedState::MAV_LANDED_STATE_IN_AIR,
                ..EXTENDED_SYS_STATE_DATA::default()
            }));
        }
        if tick.is_multiple_of(3) {
            bench.receive_position(Vector3::new(1.0, 2.0, -3.0), Vector3::zeros());
        }
        if tick.is_multiple_of(2) {
            bench.receive_attitude(0.3);
        }
        bench.healthy(Health::Healthy);
        bench.ranges();
        bench.approve(Verdict::Passed, mirror());
        for sent in bench.sent.split_off(looked_at.min(bench.sent.len())) {
            match &sent.message {
                MavMessage::HEARTBEAT(beat) if sent.component_id == 196 => {
                    seen.states.push(beat.system_status);
                }
                MavMessage::STATUSTEXT(line) => seen.texts.push(line.text.to_str().unwrap().to_owned()),
                MavMessage::COMMAND_LONG(command) if command.command == MavCmd::MAV_CMD_DO_SET_MODE => {
                    seen.modes += 1;
                }
                MavMessage::PARAM_REQUEST_READ(request) if firmware.answers => {
                    if let Some(answer) = answer(firmware, request.param_id.to_str().unwrap()) {
                        bench.receive(answer);
                    }
                }
                MavMessage::MISSION_REQUEST_LIST(_) => seen.mission_requests += 1,
                message if is_setpoint(message.message_id()) => seen.setpoints += 1,
                _ => {}
            }
        }
        looked_at = bench.sent.len();
        if let Some(status) = &bench.status {
            seen.fit = status.profile_fit.get();
            seen.profile = status.profile.as_str().to_owned();
        }
    });
    seen
}

fn answer(firmware: Firmware, name: &str) -> Option<MavMessage> {
    let index = ["COM_OBS_AVOID", "EAV_EN"]
        .iter()
        .position(|known| *known == name);
    let value = match index {
        _ if name == firmware.leaves_open => return None,
        Some(index) => firmware.switches[index],
        None => Some(1),
    };
    match value {
        Some(value) => Some(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: name.into(),
            param_value: f32::from_bits(value as u32),
            param_type: MavParamType::MAV_PARAM_TYPE_INT32,
            param_count: 900,
            param_index: 1,
        })),
        None => firmware.says_unknown.then(|| {
            MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
                param_id: name.into(),
                param_index: -1,
                ..PARAM_ERROR_DATA::default()
            })
        }),
    }
}

fn with(profile: ProfileName) -> Bench {
    Bench::unproven(GatewayConfig::from_params(&ParamSet::default(), profile))
}

fn auto() -> Bench {
    Bench::unproven(GatewayConfig {
        chooses_profile: true,
        ..GatewayConfig::default()
    })
}

const PROFILES: [ProfileName; 4] = [
    ProfileName::Px4Trajectory,
    ProfileName::Px4Offboard,
    ProfileName::Px4Deviation,
    ProfileName::ArdupilotGuided,
];

/// Firmware with the profile that is for it.
fn pairs() -> [(Firmware, ProfileName); 7] {
    let with_switches = |switches| Firmware { switches, ..PX4_2021 };
    [
        (PX4_2021, ProfileName::Px4Trajectory),
        (with_switches([Some(0), None]), ProfileName::Px4Offboard),
        (PX4_TODAY, ProfileName::Px4Offboard),
        (
            Firmware {
                says_unknown: true,
                ..PX4_TODAY
            },
            ProfileName::Px4Offboard,
        ),
        (with_switches([None, Some(0)]), ProfileName::Px4Offboard),
        (with_switches([None, Some(1)]), ProfileName::Px4Deviation),
        (ARDUCOPTER, ProfileName::ArdupilotGuided),
    ]
}

#[test]
fn only_what_fits_becomes_active_and_sends_setpoints() {
    for (firmware, right) in pairs() {
        for profile in PROFILES {
            let mut bench = with(profile);
            let seen = play(&mut bench, firmware, 8.0);
            let case = format!("{} on {:?}", profile.name(), firmware.switches);
            // A PX4 with external avoidance can be flown in OFFBOARD as well.
            let fits =
                profile == right || right == ProfileName::Px4Deviation && profile == ProfileName::Px4Offboard;
            assert_eq!(seen.fit == ProfileFit::Fits, fits, "{case}: {:?}", seen.fit);
            let is_active = seen.states.contains(&MavState::MAV_STATE_ACTIVE);
            assert_eq!(is_active, fits, "{case}: {:?}", seen.states);
            if !fits {
                assert_eq!((seen.setpoints, seen.modes), (0, 0), "{case}");
                let reported: Vec<_> = seen
                    .texts
                    .iter()
                    .filter(|text| text.contains("not ready"))
                    .collect();
                assert!(!reported.is_empty(), "{case}: {:?}", seen.texts);
                let names_it = reported
                    .iter()
                    .all(|text| text.contains(right.name()) || text.contains(" to 1"));
                assert!(names_it, "{case}: {reported:?}");
            }
        }
    }
}

#[test]
fn the_right_profile_is_chosen_and_reported() {
    for (firmware, right) in pairs() {
        let mut bench = auto();
        let seen = play(&mut bench, firmware, 5.0);
        assert_eq!(
            (seen.profile.as_str(), seen.fit),
            (right.name(), ProfileFit::Fits)
        );
        assert!(
            seen.texts
                .contains(&format!("jink: profile {} chosen", right.name()))
        );
        assert!(seen.states.contains(&MavState::MAV_STATE_ACTIVE));
        assert_eq!(bench.gateway.proven_profile(), Some(right));
        assert_eq!(seen.mission_requests > 0, right.reads_the_mission(), "{right:?}");
    }
}

#[test]
fn nothing_is_chosen_while_the_autopilot_answers_nothing() {
    let mut bench = auto();
    let mute = Firmware {
        answers: false,
        ..PX4_TODAY
    };
    let seen = play(&mut bench, mute, 8.0);
    assert_eq!((seen.profile.as_str(), seen.fit), ("", ProfileFit::Unknown));
    assert!(!seen.states.contains(&MavState::MAV_STATE_ACTIVE));
    assert_eq!((seen.setpoints, seen.modes), (0, 0));
    assert!(
        seen.texts
            .iter()
            .any(|text| text == "jink: not ready, no answer to anything")
    );
}

#[test]
fn an_autopilot_that_leaves_one_question_open_is_not_said_to_answer_nothing() {
    for (firmware, leaves_open, right) in [
        (PX4_2021, "MAV_SYS_ID", ProfileName::Px4Trajectory),
        (PX4_2021, "CP_DIST", ProfileName::Px4Trajectory),
        (PX4_2021, "COM_OBS_AVOID", ProfileName::Px4Offboard),
        (PX4_TODAY, "MAV_SYS_ID", ProfileName::Px4Offboard),
    ] {
        let mut bench = auto();
        let firmware = Firmware {
            leaves_open,
            ..firmware
        };
        let seen = play(&mut bench, firmware, 8.0);
        assert_eq!(
            (seen.profile.as_str(), seen.fit),
            (right.name(), ProfileFit::Fits),
            "{leaves_open}"
        );
        assert!(
            !seen.texts.iter().any(|text| text.contains("no answer")),
            "{:?}",
            seen.texts
        );
    }
}

#[test]
fn a_switch_that_is_set_on_the_ground_makes_it_ready_and_one_that_is_cleared_ends_it() {
    let mut bench = with(ProfileName::Px4Trajectory);
    let off = Firmware {
        switches: [Some(0), None],
        ..PX4_2021
    };
    let seen = play(&mut bench, off, 4.0);
    assert_eq!(seen.fit, ProfileFit::SwitchedOff);
    assert!(
        seen.texts
            .iter()
            .any(|text| text == "jink: not ready, set COM_OBS_AVOID to 1")
    );
    let seen = play(&mut bench, PX4_2021, 4.0);
    assert_eq!(seen.states.last(), Some(&MavState::MAV_STATE_ACTIVE));
    // PX4 notifies everybody of a parameter that somebody has set.
    bench.receive(answer(off, "COM_OBS_AVOID").unwrap());
    let seen = play(&mut bench, off, 2.0);
    assert_eq!(seen.states.last(), Some(&MavState::MAV_STATE_CRITICAL));
    assert!(seen.setpoints > 0, "what is under way is flown to its end");
}

#[test]
fn a_gateway_started_again_goes_on_at_once_with_what_was_proven() {
    let config = GatewayConfig {
        chooses_profile: true,
        is_proven: true,
        ..GatewayConfig::from_params(&ParamSet::default(), ProfileName::Px4Offboard)
    };
    let mut bench = Bench::unproven(config);
    let seen = play(&mut bench, PX4_TODAY, 0.7);
    assert!(
        seen.setpoints > 10 && seen.states.contains(&MavState::MAV_STATE_ACTIVE),
        "{:?}",
        seen.states
    );
}
