//! Who is listened to, who is answered, and how often what is said.

use crate::support::*;
use jink_ground_services::computer::BoardReading;
use jink_mavlink_gateway::{
    COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER, Destination, GatewayConfig, Receipt,
};
use jink_mavlink_link::profile_name::ProfileName;
use jink_mavlink_link::router::LinkSet;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::Health;
use jink_shared_types::link::AvoidanceState;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ring::SectorRing;
use mavlink::dialect::*;
use mavlink::{Message, MessageData};
use nalgebra::Vector3;

fn still() -> Vector3<f64> {
    Vector3::zeros()
}

fn acks(bench: &Bench) -> Vec<(u8, COMMAND_ACK_DATA)> {
    bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::COMMAND_ACK(ack) => Some((sent.component_id, ack.clone())),
            _ => None,
        })
        .collect()
}

fn command(command: MavCmd, param1: f32, target_system: u8, target_component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        command,
        target_system,
        target_component,
        ..COMMAND_LONG_DATA::default()
    })
}

/// A bench whose autopilot is known, with nothing logged yet.
fn acquainted() -> Bench {
    let mut bench = Bench::new();
    bench.receive_heartbeat(MODE_HOLD, false);
    bench.step();
    bench.sent.clear();
    bench
}

#[test]
fn only_the_autopilot_is_believed_and_the_rest_is_counted() {
    let mut bench = acquainted();
    bench.receive_position(Vector3::new(1.0, 0.0, 0.0), still());
    bench.receive_attitude(0.0);
    bench.step();
    let reported = bench.states.len();
    let intruder = MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
        time_boot_ms: 60_100,
        x: 99.0,
        ..LOCAL_POSITION_NED_DATA::default()
    });
    let station = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: MODE_MISSION,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        ..HEARTBEAT_DATA::default()
    });
    let mine = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: MODE_MISSION,
        ..HEARTBEAT_DATA::default()
    });
    for (system, component, message) in [
        (255, 190, station.clone()),
        (1, 190, station),
        (1, COMPONENT_AVOIDANCE, mine),
        (2, 1, heartbeat(MODE_MISSION, true)),
        (2, 1, intruder.clone()),
        (1, 158, intruder),
    ] {
        // The second autopilot comes after the doubtful first seconds.
        bench.now = bench.now.plus_seconds(4.0);
        bench.receive_from(system, component, message);
        bench.step();
    }
    bench.receive_attitude(0.0);
    bench.step();
    let (state, _) = *bench.states.last().unwrap();
    assert!(bench.states.len() > reported);
    assert_eq!(state.mode, jink_shared_types::vehicle::NavMode::Hold);
    assert!((state.position.x_m - 1.0).abs() < 1e-6);
    bench.idle_until(bench.now.plus_seconds(0.3));
    let status = bench.status.unwrap();
    assert_eq!((status.received, status.ignored, status.system_id), (4, 6, 1));
}

#[test]
fn two_autopilots_at_the_start_get_no_setpoint_until_one_is_named() {
    let run = |system_id| {
        let mut bench = Bench::with(GatewayConfig {
            system_id,
            ..GatewayConfig::default()
        });
        bench.fly(3.0, |bench, t| {
            bench.telemetry(t, MODE_HOLD, still(), still());
            bench.receive_from(9, 1, heartbeat(MODE_HOLD, false));
        });
        bench
    };
    let undecided = run(None);
    assert!(undecided.curves().len() <= 1);
    let decided = run(Some(1));
    assert!(decided.curves().len() > 50);
}

#[test]
fn a_request_for_our_time_is_answered_at_once_in_the_autopilots_clock() {
    let mut bench = acquainted();
    bench.now = at(0.1234567);
    let ts1 = 987_654_321_000;
    bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1,
        ..TIMESYNC_DATA::default()
    }));
    bench.step();
    let MavMessage::TIMESYNC(answer) = &bench.sent[0].message else {
        panic!("{:?} comes before the answer", bench.sent[0]);
    };
    assert_eq!((answer.tc1, answer.ts1), (ts1, ts1));
    assert_eq!((answer.target_system, answer.target_component), (1, 1));
    bench.sent.clear();
    bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1,
        target_system: 7,
        target_component: 0,
    }));
    bench.step();
    assert!(bench.sent.is_empty(), "a request to somebody else was answered");
}

#[test]
fn our_own_requests_go_out_ten_times_a_second() {
    let mut bench = acquainted();
    bench.idle_until(bench.now.plus_seconds(5.0));
    let requests = bench
        .sent
        .iter()
        .filter(|sent| matches!(&sent.message, MavMessage::TIMESYNC(sync) if sync.tc1 == 0));
    let count = requests.count();
    assert!((49..=51).contains(&count), "{count}");
}

#[test]
fn every_command_to_us_gets_exactly_one_answer() {
    let mut bench = acquainted();
    let refused = [
        (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_DENIED),
        (MavCmd::MAV_CMD_NAV_TAKEOFF, MavResult::MAV_RESULT_UNSUPPORTED),
        (MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, MavResult::MAV_RESULT_DENIED),
    ];
    for (i, (cmd, result)) in refused.into_iter().enumerate() {
        bench.receive_from(255, 190, command(cmd, 0.0, SYSTEM, COMPONENT_AVOIDANCE));
        bench.step();
        let (component, ack) = acks(&bench)[i].clone();
        assert_eq!((component, ack.command), (COMPONENT_AVOIDANCE, cmd));
        assert_eq!(ack.result, result);
        assert_eq!((ack.target_system, ack.target_component), (255, 190));
    }
    bench.receive_from(
        255,
        190,
        MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            command: MavCmd::MAV_CMD_DO_REPOSITION,
            target_system: SYSTEM,
            target_component: COMPONENT_ONBOARD_COMPUTER,
            ..COMMAND_INT_DATA::default()
        }),
    );
    bench.step();
    assert_eq!(acks(&bench).len(), 4);
    assert_eq!(acks(&bench)[3].0, COMPONENT_ONBOARD_COMPUTER);
}

/// A station on a link of jink's own asks the autopilot for another speed.
#[test]
fn a_speed_that_the_autopilot_is_asked_for_is_heard_and_told() {
    let mut bench = Bench::with(GatewayConfig::from_params(
        &ParamSet::default(),
        ProfileName::Px4Offboard,
    ));
    bench.receive_heartbeat(MODE_HOLD, false);
    bench.step();
    bench.sent.clear();
    for (system, told) in [(7, 0), (SYSTEM, 1)] {
        bench.receive_from(
            255,
            190,
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_DO_CHANGE_SPEED,
                param1: 1.0,
                param2: 2.0,
                target_system: system,
                target_component: 1,
                ..COMMAND_LONG_DATA::default()
            }),
        );
        bench.step();
        let reported = bench
            .outputs
            .events()
            .iter()
            .filter(|event| event.id == events::SPEED_COMMANDED.id && event.numbers[0] == 2.0);
        assert_eq!(reported.count(), told);
    }
    assert!(acks(&bench).is_empty(), "it is not ours to answer");
}

#[test]
fn commands_to_others_and_to_all_are_not_ours_to_answer() {
    let mut bench = acquainted();
    for (system, component) in [(SYSTEM, 1), (SYSTEM, 0), (0, 0), (7, COMPONENT_AVOIDANCE)] {
        bench.receive_from(
            255,
            190,
            command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 148.0, system, component),
        );
    }
    bench.step();
    assert!(acks(&bench).is_empty());
}

#[test]
fn whoever_asks_for_our_version_gets_it() {
    let mut bench = acquainted();
    bench.receive_from(
        255,
        190,
        command(
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            148.0,
            SYSTEM,
            COMPONENT_AVOIDANCE,
        ),
    );
    bench.step();
    assert_eq!(acks(&bench)[0].1.result, MavResult::MAV_RESULT_ACCEPTED);
    let version = bench.sent.iter().find_map(|sent| match &sent.message {
        MavMessage::AUTOPILOT_VERSION(version) => Some(version),
        _ => None,
    });
    let version = version.expect("the version was sent");
    assert!(
        version
            .capabilities
            .contains(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2)
    );
    let [kind, patch, minor, major] = version.flight_sw_version.to_le_bytes();
    assert_eq!(format!("{major}.{minor}.{patch}"), env!("CARGO_PKG_VERSION"));
    assert_eq!(kind, 255);
}

#[test]
fn the_avoidance_heartbeat_is_honest_and_prompt() {
    let mut bench = Bench::new();
    // Everything is healthy and flows for 4 s, then the ranges stop.
    bench.fly(6.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, still(), still());
        if t < 4.0 {
            bench.ranges();
        }
        if t >= 1.0 {
            bench.healthy(Health::Healthy);
        }
        bench.approve(jink_shared_types::motion::Verdict::Passed, mirror());
    });
    let heartbeats = bench.heartbeats(COMPONENT_AVOIDANCE);
    let state_at = |s: f64| {
        let before = heartbeats.iter().rfind(|(time, _)| *time <= at(s));
        before.expect("a heartbeat was sent").1.system_status
    };
    assert_eq!(state_at(0.9), MavState::MAV_STATE_BOOT);
    assert_eq!(state_at(1.25), MavState::MAV_STATE_ACTIVE);
    assert_eq!(state_at(4.1), MavState::MAV_STATE_ACTIVE);
    assert_eq!(state_at(4.45), MavState::MAV_STATE_CRITICAL);
    for pair in heartbeats.windows(2) {
        let gap_s = pair[1].0.seconds_since(pair[0].0);
        // What follows ACTIVE is said when it has lasted for a quarter of a second.
        assert!((0.2 - 1e-9..=0.75 + 1e-9).contains(&gap_s), "{gap_s} s");
    }
    for (_, heartbeat) in &heartbeats {
        assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
        assert_eq!(heartbeat.autopilot, MavAutopilot::MAV_AUTOPILOT_INVALID);
        assert_eq!(heartbeat.mavlink_version, 3);
    }
    assert_eq!(bench.status.unwrap().avoidance, AvoidanceState::Critical);
    let computer = bench.heartbeats(COMPONENT_ONBOARD_COMPUTER);
    assert_eq!(computer.len(), 7, "one at 0, 1, .. 6 s");
    assert!(
        computer
            .iter()
            .all(|(_, h)| h.mavtype == MavType::MAV_TYPE_ONBOARD_CONTROLLER)
    );
}

#[test]
fn on_a_silent_link_we_speak_first() {
    let mut bench = Bench::new();
    bench.idle_until(at(2.0));
    let heartbeats = bench.heartbeats(COMPONENT_AVOIDANCE);
    assert!(heartbeats.len() >= 4);
    assert!(
        heartbeats
            .iter()
            .all(|(_, h)| h.system_status == MavState::MAV_STATE_BOOT)
    );
    let others = bench
        .sent
        .iter()
        .filter(|sent| !matches!(sent.message, MavMessage::HEARTBEAT(_)));
    assert_eq!(others.count(), 0);
}

#[test]
fn the_obstacle_map_goes_out_as_often_as_the_autopilot_needs_it_with_or_without_a_ring() {
    let mut bench = acquainted();
    bench.idle_until(bench.now.plus_seconds(4.0));
    let maps: Vec<_> = bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::OBSTACLE_DISTANCE(map) => Some(map),
            _ => None,
        })
        .collect();
    assert!((19..=21).contains(&maps.len()), "{}", maps.len());
    assert!(maps.iter().all(|map| map.distances == [u16::MAX; 72]));
    assert_eq!(bench.status.unwrap().obstacle_distances, maps.len() as u64);
    bench.receive(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_id: "CP_DIST".into(),
        param_value: 4.0,
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        ..PARAM_VALUE_DATA::default()
    }));
    bench.step();
    bench.sent.clear();
    bench.idle_until(bench.now.plus_seconds(4.0));
    let maps = |sent: &&Sent| matches!(sent.message, MavMessage::OBSTACLE_DISTANCE(_));
    let count = bench.sent.iter().filter(maps).count();
    assert!((39..=41).contains(&count), "{count}");
    // The same with a ring: something stands 3 m away, all around.
    bench.sent.clear();
    for _ in 0..40 {
        bench.ring = Some(Sample::new(
            SectorRing {
                distance_m: [3.0; 72],
                range_max_m: [12.0; 72],
                ..SectorRing::default()
            },
            bench.now,
        ));
        bench.idle_until(bench.now.plus_seconds(0.1));
    }
    let maps: Vec<_> = bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::OBSTACLE_DISTANCE(map) => Some(map),
            _ => None,
        })
        .collect();
    assert!((39..=41).contains(&maps.len()), "{}", maps.len());
    assert!(maps.iter().skip(1).all(|map| map.distances == [300; 72]));
}

#[test]
fn news_reach_the_pilot_as_one_line_each() {
    let mut bench = acquainted();
    for _ in 0..10 {
        bench
            .events
            .push(EventSample::new(&events::RANGES_LOST, "", [0.0; 2]));
    }
    bench.events.push(EventSample::new(
        &events::PROCESS_RESTARTED,
        "planner",
        [12.0, 0.0],
    ));
    bench.step();
    bench.idle_until(bench.now.plus_seconds(1.2));
    let lines: Vec<_> = bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::STATUSTEXT(line) => Some((line.severity, line.text.to_str().unwrap().to_owned())),
            _ => None,
        })
        .collect();
    assert_eq!(
        lines,
        [
            (
                MavSeverity::MAV_SEVERITY_CRITICAL,
                "jink: range data lost, stopping".to_owned()
            ),
            (
                MavSeverity::MAV_SEVERITY_WARNING,
                "jink: planner restarted".to_owned()
            ),
            // That it is connected has been so for a second.
            (
                MavSeverity::MAV_SEVERITY_INFO,
                "jink: autopilot connected, system 1".to_owned()
            ),
        ]
    );
}

#[test]
fn missing_streams_are_asked_for_and_what_comes_is_not() {
    let mut bench = Bench::new();
    bench.fly(8.0, |bench, t| {
        bench.telemetry(t, MODE_POSITION, still(), still());
    });
    let requests: Vec<_> = bench
        .sent
        .iter()
        .filter_map(|sent| match &sent.message {
            MavMessage::COMMAND_LONG(request) => Some(request),
            _ => None,
        })
        .collect();
    assert!(!requests.is_empty());
    for request in requests {
        assert_eq!((request.target_system, request.target_component), (1, 1));
        assert!(
            [42.0, 141.0, 148.0, 242.0, 245.0].contains(&request.param1),
            "{request:?}"
        );
    }
}

/// A station's go-to is flown by PX4 itself until the change of mode is known.
#[test]
fn a_px4_that_reports_changes_of_its_mode_late_is_asked_for_it_in_flight() {
    const MODE_OFFBOARD: u32 = 6 << 16;
    let questions = |has_current_mode: bool, is_up: bool| {
        let mut bench = Bench::with(GatewayConfig::from_params(
            &Default::default(),
            jink_mavlink_gateway::ProfileName::Px4Offboard,
        ));
        bench.fly(10.0, |bench, t| {
            bench.telemetry(t, MODE_OFFBOARD, still(), still());
            if ((t * 100.0).round() as u32).is_multiple_of(50) {
                let landed_state = if is_up {
                    MavLandedState::MAV_LANDED_STATE_IN_AIR
                } else {
                    MavLandedState::MAV_LANDED_STATE_ON_GROUND
                };
                bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                    landed_state,
                    ..EXTENDED_SYS_STATE_DATA::default()
                }));
                if has_current_mode {
                    bench.receive(MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
                        custom_mode: MODE_OFFBOARD,
                        ..CURRENT_MODE_DATA::default()
                    }));
                }
            }
        });
        let asks = |sent: &&Sent| {
            matches!(&sent.message, MavMessage::COMMAND_LONG(question)
                if question.command == MavCmd::MAV_CMD_REQUEST_MESSAGE && question.param1 == 0.0)
        };
        bench.sent.iter().filter(asks).count()
    };
    assert!(
        (40..52).contains(&questions(false, true)),
        "{}",
        questions(false, true)
    );
    assert!(questions(true, true) <= 1, "only until the first is received");
    assert_eq!(questions(false, false), 0);
}

#[test]
fn what_was_not_written_is_not_counted_as_sent() {
    let mut bench = acquainted();
    let sent = |bench: &mut Bench| {
        bench.idle_until(bench.now.plus_seconds(0.25));
        bench.status.unwrap().sent
    };
    let before = sent(&mut bench);
    bench.gateway.wire(bench.now, Receipt::Plain);
    let log = bench.sent.len();
    let after = sent(&mut bench);
    assert!(after > before && after - before <= 1 + (bench.sent.len() - log) as u64);
}

#[test]
fn who_speaks_as_an_autopilot_on_a_ground_stations_link_is_nobodys_autopilot() {
    let mut bench = Bench::with(GatewayConfig {
        ground_station_links: LinkSet::default().with(1),
        ..GatewayConfig::default()
    });
    bench.link = 1;
    bench.receive_heartbeat(MODE_MISSION, true);
    bench.step();
    assert_eq!(bench.gateway.us(bench.now).system_id, None);
    bench.link = 0;
    bench.receive_heartbeat(MODE_MISSION, true);
    bench.step();
    assert_eq!(bench.gateway.us(bench.now).system_id, Some(SYSTEM));
}

#[test]
#[allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.
fn the_autopilot_is_spoken_to_where_it_is_received_and_whoever_asks_where_he_asked() {
    let mut bench = Bench::new();
    bench.ground.board = Some(BoardReading::default());
    bench.link = 1;
    bench.fly(2.0, |bench, t| {
        bench.link = 1;
        bench.telemetry(t, MODE_MISSION, still(), Vector3::zeros());
        if t == 1.0 {
            bench.link = 2;
            let asked = command(MavCmd::MAV_CMD_DO_SET_SERVO, 0.0, SYSTEM, 196);
            bench.receive_from(255, 190, asked);
        }
    });
    assert_eq!(bench.gateway.autopilot_link(), 1);
    let of = |message_id: u32| {
        let sent = bench
            .sent
            .iter()
            .filter(|one| one.message.message_id() == message_id);
        let mut destinations: Vec<_> = sent.map(|one| one.to).collect();
        destinations.dedup();
        destinations
    };
    assert_eq!(
        of(TRAJECTORY_REPRESENTATION_BEZIER_DATA::ID),
        [Destination::Link(1)]
    );
    assert_eq!(of(TIMESYNC_DATA::ID), [Destination::Link(1)]);
    assert_eq!(of(COMMAND_ACK_DATA::ID), [Destination::Link(2)]);
    for for_all in [
        HEARTBEAT_DATA::ID,
        OBSTACLE_DISTANCE_DATA::ID,
        ONBOARD_COMPUTER_STATUS_DATA::ID,
    ] {
        assert_eq!(of(for_all), [Destination::Everyone]);
    }
}
