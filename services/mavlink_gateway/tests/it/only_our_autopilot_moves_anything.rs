//! Once a vehicle is selected, only its own autopilot moves anything: address, mode, position, mission, parameters, time. Every message
//! of the dialect is tried from every kind of stranger. And what our own autopilot says must agree with itself.

use crate::support::*;
use jink_mavlink_gateway::executive::FlightGoal;
use jink_mavlink_gateway::executive::record::Record;
use jink_mavlink_gateway::landed_state::LandedState;
use jink_mavlink_gateway::{Body, Content, Encoder, Gateway, GatewayConfig, Inputs, ProfileName, Received};
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::router::LinkSet;
use jink_shared_types::Reading;
use jink_shared_types::events::AUTOPILOT_RESTARTED;
use jink_shared_types::health::Health;
use jink_shared_types::motion::Verdict;
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;
use mavlink::{MavlinkVersion, Message, consts};
use nalgebra::Vector3;
use std::fmt::Write as _;

/// The link of a ground station.
const GROUND: u8 = 1;
/// A system, a component, the link it comes in on, what it is.
const STRANGERS: [(u8, u8, u8, &str); 5] = [
    (42, 1, 0, "another vehicle's autopilot"),
    (SYSTEM, 100, 0, "another component of our vehicle"),
    (255, 190, 0, "a station behind the autopilot"),
    (
        SYSTEM,
        1,
        GROUND,
        "who says on a station's link that it is our autopilot",
    ),
    (42, 1, GROUND, "another vehicle on a station's link"),
];

fn config(profile: ProfileName) -> GatewayConfig {
    GatewayConfig {
        ground_station_links: LinkSet::default().with(GROUND),
        ..GatewayConfig::from_params(&ParamSet::default(), profile)
    }
}

fn place() -> Vector3<f64> {
    Vector3::new(1.0, 2.0, -5.0)
}

/// A vehicle that has been seen for some seconds, in the air.
fn airborne(profile: ProfileName) -> Bench {
    let mut bench = Bench::with(config(profile));
    bench.fly(5.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, place(), Vector3::zeros());
        bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            landed_state: MavLandedState::MAV_LANDED_STATE_IN_AIR,
            ..EXTENDED_SYS_STATE_DATA::default()
        }));
    });
    bench
}

/// The whole state of the gateway, without what knows of others by its purpose: who else is an autopilot, and since when, whether a
/// station stands behind the autopilot, and how much was passed over.
fn state(bench: &Bench) -> String {
    let mut text = format!("{:?}", bench.gateway);
    let fields = [
        ("selector: ", ", clock: "),
        ("two_heard: ", ", was_announced: "),
        ("radio: ", ", streams: "),
        ("ignored: ", ", last_setpoint: "),
    ];
    for (from, to) in fields {
        let begin = text.find(from).unwrap_or_else(|| panic!("no {from}in {text}"));
        let length = text[begin..]
            .find(to)
            .unwrap_or_else(|| panic!("no {to}behind {from}"));
        text.replace_range(begin..begin + length, "");
    }
    let (us, link) = (bench.gateway.us(bench.now), bench.gateway.autopilot_link());
    write!(text, "{us:?} {link}").unwrap();
    text
}

/// What a message of this type may hold: zeros, and bytes of all kinds as far as they can be decoded.
fn contents(id: u32) -> Vec<MavMessage> {
    let mut seed = u64::from(id) + 1;
    let mut byte = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 56) as u8
    };
    let drawn = (0..40).filter_map(|_| {
        let payload: [u8; consts::MAX_PAYLOAD_LEN] = std::array::from_fn(|_| byte());
        MavMessage::parse(MavlinkVersion::V2, id, &payload).ok()
    });
    let default = MavMessage::default_message_from_id(id);
    // What would move most if it were believed.
    let plausible = match id {
        0 => Some(heartbeat(MODE_LAND, false)),
        32 => Some(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: 65_000,
            x: 50.0,
            ..LOCAL_POSITION_NED_DATA::default()
        })),
        31 => Some(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms: 65_000,
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        })),
        _ => None,
    };
    default
        .into_iter()
        .chain(drawn.take(3))
        .chain(plausible)
        .collect()
}

/// To the autopilot, or to all, as its type has it.
fn addressed(mut message: MavMessage, component: u8) -> MavMessage {
    if let Some(target) = message.target_system_id_mut() {
        *target = SYSTEM;
    }
    if let Some(target) = message.target_component_id_mut() {
        *target = component;
    }
    message
}

/// A step of the gateway alone, in which nothing is due but `message`: questions go to the ground services, which are not asked here.
fn take(bench: &mut Bench, message: Option<(u8, u8, u8, MavMessage)>) {
    let received: Vec<_> = message
        .into_iter()
        .map(|(system, component, link, message)| {
            let body = Body::Message(message);
            let bytes = Encoder::new().encode(system, component, &body).to_vec();
            let mut splitter = Splitter::new();
            splitter.load_datagram(&bytes);
            let frame = splitter.next_frame().unwrap();
            Received {
                header: frame.header,
                content: Content::of(&frame).unwrap(),
                time: bench.now,
                link,
            }
        })
        .collect();
    let inputs = Inputs {
        messages: &received,
        link: Default::default(),
        approved: Reading::Never,
        prevented: Reading::Never,
        ring: Reading::Never,
        system: Reading::Never,
        events: &[],
        parameters: None,
        answers: &[],
    };
    bench.gateway.step(bench.now, &inputs, &mut bench.outputs);
}

#[test]
fn no_message_of_a_stranger_moves_anything() {
    for profile in [
        ProfileName::Px4Offboard,
        ProfileName::Px4Trajectory,
        ProfileName::Px4Deviation,
        ProfileName::ArdupilotGuided,
    ] {
        let mut bench = airborne(profile);
        take(&mut bench, None);
        let before = state(&bench);
        take(&mut bench, None);
        assert_eq!(state(&bench), before, "a step without a message moves something");
        let mut moved = Vec::new();
        for id in MavMessage::all_ids() {
            for (system, component, link, who) in STRANGERS {
                for message in contents(*id) {
                    for target in [0, 1] {
                        let message = addressed(message.clone(), target);
                        take(&mut bench, Some((system, component, link, message.clone())));
                        let is_sent = !bench.outputs.messages().is_empty();
                        let is_said = bench.outputs.vehicle_state.is_some()
                            || bench.outputs.desired_path.is_some()
                            || !bench.outputs.scans().is_empty();
                        if state(&bench) != before || is_sent || is_said {
                            moved.push(format!("{} of {who}", message.message_name()));
                        }
                    }
                }
            }
        }
        moved.dedup();
        assert!(moved.is_empty(), "{profile:?}: {moved:#?}");
    }
}

/// A record of a flight, as the next gateway reads it.
fn read(record: &Record) -> Option<Record> {
    Record::of_bytes(&record.to_bytes())
}

#[test]
fn a_gateway_that_is_started_again_beside_a_second_autopilot_flies_on_with_its_own() {
    for profile in [ProfileName::Px4Trajectory, ProfileName::Px4Offboard] {
        let before = airborne(profile);
        let record = before.gateway.record(before.now).unwrap();
        let mut bench = Bench::with(config(profile));
        bench.now = before.now.plus_seconds(0.05);
        bench.gateway = Gateway::new(GatewayConfig {
            is_proven: true,
            ..config(profile)
        })
        .resuming(bench.now, read(&record));
        let (mut undecided, mut foreign) = (0, 0);
        bench.fly(8.0, |bench, t| {
            bench.receive_from(9, 1, heartbeat(MODE_HOLD, false));
            bench.receive_from(
                9,
                1,
                MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                    time_boot_ms: 1,
                    x: 70.0,
                    ..LOCAL_POSITION_NED_DATA::default()
                }),
            );
            if t > 0.2 {
                bench.telemetry(t, MODE_HOLD, place(), Vector3::zeros());
            }
            undecided += usize::from(bench.gateway.us(bench.now).system_id != Some(SYSTEM));
            foreign += bench
                .states
                .drain(..)
                .filter(|(state, _)| state.position.x_m > 2.0)
                .count();
        });
        assert_eq!((undecided, foreign), (0, 0), "{profile:?}");
        assert!(profile != ProfileName::Px4Trajectory || bench.curves().len() > 100);
    }
}

fn texts(bench: &Bench) -> Vec<String> {
    let lines = bench.sent.iter().filter_map(|sent| match &sent.message {
        MavMessage::STATUSTEXT(line) => line.text.to_str().map(str::to_owned).ok(),
        _ => None,
    });
    lines.collect()
}

#[test]
fn beside_a_second_autopilot_nobody_is_ready_to_arm_and_a_flight_goes_on() {
    let run = |armed: bool, system_id| {
        let mut bench = Bench::with(GatewayConfig {
            system_id,
            ..GatewayConfig::default()
        });
        bench.fly(14.0, |bench, t| {
            let tick = (t * 100.0).round() as u32;
            if tick.is_multiple_of(50) {
                bench.receive_heartbeat(MODE_HOLD, armed);
            }
            bench.receive_position(place(), Vector3::zeros());
            bench.receive_attitude(0.3);
            bench.healthy(Health::Healthy);
            bench.ranges();
            bench.approve(Verdict::Passed, mirror());
            // From the fifth second to the eighth.
            if (500..800).contains(&tick) {
                bench.receive_from(9, 1, heartbeat(MODE_HOLD, false));
            }
        });
        let said = |from_s: f64, to_s: f64| {
            let beats = bench.heartbeats(196).into_iter();
            let within = beats.filter(|(time, _)| (at(from_s)..at(to_s)).contains(time));
            within.map(|(_, beat)| beat.system_status).collect::<Vec<_>>()
        };
        // The only state that was said within that time.
        let only = |from_s, to_s| {
            let states = said(from_s, to_s);
            let first = *states.first().expect("a heartbeat");
            assert!(states.iter().all(|state| *state == first), "{states:?}");
            first
        };
        assert_eq!(only(2.0, 5.0), MavState::MAV_STATE_ACTIVE, "before");
        assert_eq!(only(12.0, 14.0), MavState::MAV_STATE_ACTIVE, "afterwards");
        let told = texts(&bench)
            .iter()
            .filter(|text| *text == "jink: two autopilots, systems 1 and 9")
            .count();
        (only(6.0, 10.5), told)
    };
    assert_eq!(
        run(false, None),
        (MavState::MAV_STATE_STANDBY, 1),
        "on the ground"
    );
    assert_eq!(run(true, None), (MavState::MAV_STATE_ACTIVE, 1), "in flight");
    assert_eq!(
        run(false, Some(SYSTEM)),
        (MavState::MAV_STATE_ACTIVE, 0),
        "it is named"
    );
}

#[test]
fn a_message_that_is_very_late_ends_no_flight_however_often_it_comes() {
    let mut bench = airborne(ProfileName::Px4Offboard);
    let flown = Record {
        flight_goal: FlightGoal::Mission,
        mode: NavMode::Offboard,
        armed: true,
        landed_state: LandedState::InAir,
        ..bench.gateway.record(bench.now).unwrap()
    };
    bench.gateway = Gateway::new(GatewayConfig {
        is_proven: true,
        ..config(ProfileName::Px4Offboard)
    })
    .resuming(bench.now, read(&flown));
    let late = |time_boot_ms| {
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            x: 30.0,
            ..LOCAL_POSITION_NED_DATA::default()
        })
    };
    let offboard = 6 << 16;
    bench.states.clear();
    bench.fly(3.0, |bench, t| {
        bench.telemetry(t, offboard, place(), Vector3::zeros());
        // Once alone, then again and again between the others, then one that is repeated by the network.
        if t > 1.0 {
            bench.receive(late(1));
            bench.receive(late(1));
        }
    });
    assert!(
        bench
            .states
            .iter()
            .all(|(state, _)| state.estimator_resets == 0 && state.position.x_m < 2.0)
    );
    assert!(!texts(&bench).iter().any(|text| text == AUTOPILOT_RESTARTED.text));
    let goal = |bench: &Bench| bench.gateway.record(bench.now).unwrap().flight_goal;
    assert_eq!(goal(&bench), FlightGoal::Mission);

    // It does start anew, in flight: that is said, and the mission is kept.
    bench.boot_ms_at_zero = 0;
    bench.fly(2.0, |bench, t| {
        bench.telemetry(t, offboard, place(), Vector3::zeros());
    });
    assert_eq!(bench.states.last().unwrap().0.estimator_resets, 1);
    let told = texts(&bench)
        .iter()
        .filter(|text| *text == AUTOPILOT_RESTARTED.text)
        .count();
    assert_eq!((told, goal(&bench)), (1, FlightGoal::Mission));
}
