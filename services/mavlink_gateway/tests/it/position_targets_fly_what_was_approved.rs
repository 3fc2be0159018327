//! Where the autopilot follows setpoints as they are: every one is a SET_POSITION_TARGET_LOCAL_NED with every field given.

use crate::support::*;
use jink_mavlink_gateway::{GatewayConfig, ProfileName};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::Verdict;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use mavlink::dialect::*;
use nalgebra::Vector3;
use proptest::prelude::*;

type Target = SET_POSITION_TARGET_LOCAL_NED_DATA;

const MODE_OFFBOARD: u32 = 6 << 16;
const MODE_GUIDED: u32 = 4;
const BOTH: [(ProfileName, u32); 2] = [
    (ProfileName::Px4Offboard, MODE_OFFBOARD),
    (ProfileName::ArdupilotGuided, MODE_GUIDED),
];
const HERE: Vector3<f64> = Vector3::new(4.0, -2.0, -3.0);

fn bench(profile: ProfileName) -> Bench {
    Bench::with(GatewayConfig::from_params(&ParamSet::default(), profile))
}

/// As [`Bench::telemetry`], of the make that belongs to the profile.
fn report(
    bench: &mut Bench,
    profile: ProfileName,
    t: f64,
    custom_mode: u32,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
) {
    let tick = (t * 100.0).round() as u32;
    if tick.is_multiple_of(100) {
        let MavMessage::HEARTBEAT(mut beat) = heartbeat(custom_mode, true) else {
            panic!("a heartbeat")
        };
        if profile == ProfileName::ArdupilotGuided {
            beat.autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
        }
        bench.receive(MavMessage::HEARTBEAT(beat));
    }
    if tick.is_multiple_of(20) {
        bench.receive(MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            landed_state: MavLandedState::MAV_LANDED_STATE_IN_AIR,
            ..EXTENDED_SYS_STATE_DATA::default()
        }));
    }
    if tick.is_multiple_of(3) {
        bench.receive_position(position, velocity);
    }
    if tick.is_multiple_of(2) {
        bench.receive_attitude(0.3);
    }
}

fn sent(bench: &Bench) -> Vec<(Timestamp, Target)> {
    let targets = bench.sent.iter().filter_map(|sent| match &sent.message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(data) => Some((sent.time, data.clone())),
        _ => None,
    });
    targets.collect()
}

fn vectors(target: &Target) -> [Vector3<f64>; 3] {
    [
        [target.x, target.y, target.z],
        [target.vx, target.vy, target.vz],
        [target.afx, target.afy, target.afz],
    ]
    .map(|[x, y, z]| Vector3::new(x, y, z).map(f64::from))
}

/// What holds for every setpoint, whatever has come.
fn assert_rules(target: &Target) {
    let numbers = vectors(target).into_iter().flat_map(|v| [v.x, v.y, v.z]);
    let yaw = [f64::from(target.yaw), f64::from(target.yaw_rate)];
    assert!(numbers.chain(yaw).all(f64::is_finite), "{target:?}");
    assert_eq!(target.type_mask, PositionTargetTypemask::empty());
    assert_eq!(target.coordinate_frame, MavFrame::MAV_FRAME_LOCAL_NED);
    assert_eq!((target.target_system, target.target_component), (SYSTEM, 1));
}

#[test]
fn an_approved_trajectory_is_sent_fifty_times_a_second_with_all_that_moves_it() {
    for (profile, mode) in BOTH {
        let mut bench = bench(profile);
        bench.fly(1.0, |bench, t| {
            report(bench, profile, t, mode, HERE, Vector3::zeros());
            bench.approve(Verdict::Passed, mirror());
        });
        let begin = bench.now;
        let plan = flight(7, begin, HERE, Vector3::new(5.0, 1.0, 0.0), 4.0);
        bench.approve(Verdict::Passed, plan);
        bench.fly(2.5, |bench, t| {
            let there = plan.at(bench.now).unwrap();
            report(
                bench,
                profile,
                t,
                mode,
                there.position.vector(),
                there.velocity.vector(),
            );
            bench.approved.as_mut().unwrap().header.publish = bench.now;
        });
        let flown: Vec<_> = sent(&bench)
            .into_iter()
            .filter(|(time, _)| time.seconds_since(begin) > 0.1)
            .collect();
        let rate_hz = (flown.len() - 1) as f64 / flown[flown.len() - 1].0.seconds_since(flown[0].0);
        assert!((48.0..=56.0).contains(&rate_hz), "{rate_hz} Hz");
        let lead_s = match profile {
            ProfileName::Px4Offboard => 0.15,
            _ => 0.0,
        };
        for (time, target) in flown {
            assert_rules(&target);
            let [position, velocity, acceleration] = vectors(&target);
            let now = plan.at(time).unwrap();
            let later = plan.at(time.plus_seconds(lead_s)).unwrap();
            assert!((position - now.position.vector()).norm() < 1e-3);
            // The vehicle is where it should be, so the lead stays about what it was.
            assert!(
                (velocity - later.velocity.vector()).norm() < 0.03,
                "{velocity} {later:?}"
            );
            assert!((acceleration - later.acceleration.vector()).norm() < 0.25);
            assert!((f64::from(target.yaw) - 0.3).abs() < 1e-3);
        }
    }
}

/// A vehicle that corrects its position fast and still lags has the longer delay.
#[test]
fn the_lead_is_learned_with_the_position_gain_that_is_set_on_the_autopilot() {
    let profile = ProfileName::Px4Offboard;
    let lead_s = |gain_per_s: f64| {
        let mut params = ParamSet::default();
        params.set("MPC_XY_P", gain_per_s).unwrap();
        // So high that nothing is added to it.
        params.set("MPC_XY_VEL_P_ACC", 5.0).unwrap();
        let mut bench = bench(profile);
        bench.parameters = Some(ParameterValues::of(&params));
        bench.fly(1.0, |bench, t| {
            report(bench, profile, t, MODE_OFFBOARD, HERE, Vector3::zeros());
            bench.approve(Verdict::Passed, mirror());
        });
        let begin = bench.now;
        let plan = flight(7, begin, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0);
        bench.approve(Verdict::Passed, plan);
        bench.fly(1.5, |bench, t| {
            let there = plan.at(bench.now).unwrap();
            let behind = there.position.vector() - 0.2 * Vector3::x();
            report(bench, profile, t, MODE_OFFBOARD, behind, there.velocity.vector());
            bench.approved.as_mut().unwrap().header.publish = bench.now;
        });
        let (time, target) = sent(&bench).pop().unwrap();
        let now = plan.at(time).unwrap();
        (f64::from(target.vx) - now.velocity.x_mps) / now.acceleration.x_mps2
    };
    let leads_s = [0.0, 0.5, 1.0, 2.0].map(lead_s);
    assert!(
        (leads_s[0] - 0.15).abs() < 0.03,
        "nothing is learned: {leads_s:?}"
    );
    for pair in leads_s.windows(2) {
        assert!(pair[1] > pair[0] + 0.01, "{leads_s:?}");
    }
}

/// What PX4's own gains leave of an error is sent besides; ArduCopter's is left to itself, and high gains are not raised.
#[test]
fn an_error_is_answered_as_if_the_gains_were_higher() {
    let sent_beside = |profile, mode, velocity_gain_per_s: f64| {
        let mut params = ParamSet::default();
        params.set("MPC_XY_VEL_P_ACC", velocity_gain_per_s).unwrap();
        let mut bench = bench(profile);
        bench.parameters = Some(ParameterValues::of(&params));
        bench.fly(1.0, |bench, t| {
            report(bench, profile, t, mode, HERE, Vector3::zeros());
            bench.approve(Verdict::Passed, mirror());
        });
        let begin = bench.now;
        let plan = flight(7, begin, HERE, Vector3::new(5.0, 0.0, 0.0), 4.0);
        bench.approve(Verdict::Passed, plan);
        bench.fly(1.5, |bench, t| {
            let there = plan.at(bench.now).unwrap();
            let [aside, drifts] = [0.2 * Vector3::y(), 0.1 * Vector3::y()];
            let (position, velocity) = (there.position.vector() + aside, there.velocity.vector() + drifts);
            report(bench, profile, t, mode, position, velocity);
            bench.approved.as_mut().unwrap().header.publish = bench.now;
        });
        let (_, target) = sent(&bench).pop().unwrap();
        [f64::from(target.vy), f64::from(target.afy)]
    };
    let [back_mps, push_mps2] = sent_beside(ProfileName::Px4Offboard, MODE_OFFBOARD, 1.8);
    let raised = 0.42 / 0.15 / 1.8 - 1.0;
    assert!((back_mps + raised * 0.95 * 0.2).abs() < 0.03, "{back_mps}");
    assert!((push_mps2 + raised * 1.8 * 0.1).abs() < 0.05, "{push_mps2}");
    for (profile, mode, gain_per_s) in [
        (ProfileName::Px4Offboard, MODE_OFFBOARD, 5.0),
        (ProfileName::ArdupilotGuided, MODE_GUIDED, 1.8),
    ] {
        let sent = sent_beside(profile, mode, gain_per_s);
        assert!(
            sent.iter().all(|sent| sent.abs() < 1e-3),
            "{profile:?} {gain_per_s}: {sent:?}"
        );
    }
}

/// Nobody has planned anything: what is sent brings the vehicle smoothly to rest.
#[test]
fn a_mode_that_is_entered_in_motion_without_a_plan_begins_with_a_smooth_stop() {
    for (profile, mode) in BOTH {
        let mut bench = bench(profile);
        let speed = Vector3::new(4.5, 0.0, 0.0);
        let mut entered = None;
        // ArduCopter's own target is waited for a moment.
        let waits_s = if profile == ProfileName::ArdupilotGuided {
            0.5
        } else {
            0.0
        };
        bench.fly(3.0 + waits_s, |bench, t| {
            // The vehicle follows its commands from the moment in which the mode is reported.
            let custom_mode = if t < 1.0 {
                if profile == ProfileName::Px4Offboard {
                    MODE_POSITION
                } else {
                    5
                }
            } else {
                entered.get_or_insert(bench.now);
                mode
            };
            let stopped = sent(bench)
                .last()
                .filter(|_| t > 1.05 + waits_s)
                .map(|(_, target)| vectors(target));
            let (position, velocity) =
                stopped.map_or((speed * t, speed), |[position, velocity, _]| (position, velocity));
            report(bench, profile, t, custom_mode, position, velocity);
        });
        let entered = entered.unwrap();
        let stop: Vec<_> = sent(&bench)
            .into_iter()
            .filter(|(time, _)| time.seconds_since(entered) > 0.2)
            .collect();
        let mut before = Vector3::new(5.0, 0.0, 0.0);
        for (_, target) in &stop {
            assert_rules(target);
            let [_, velocity, acceleration] = vectors(target);
            assert!(velocity.norm() <= before.norm() + 1e-6 && velocity.x >= -1e-6);
            assert!(acceleration.norm() <= 2.6, "{acceleration}");
            before = velocity;
        }
        assert!(vectors(&stop[0].1)[1].x > 3.0, "it does not begin with a jolt");
        let [end, velocity, _] = vectors(&stop[stop.len() - 1].1);
        assert!(velocity.norm() < 1.5 && end.x > 5.0);
    }
}

#[test]
fn while_somebody_else_flies_the_setpoint_is_where_the_vehicle_is_or_there_is_none() {
    for (profile, mode) in [
        (ProfileName::Px4Offboard, MODE_MISSION),
        (ProfileName::Px4Offboard, MODE_POSITION),
        (ProfileName::ArdupilotGuided, 3),
        (ProfileName::ArdupilotGuided, 0),
    ] {
        let mut bench = bench(profile);
        let velocity = Vector3::new(2.0, 1.0, 0.0);
        let begin = bench.now;
        bench.fly(3.0, |bench, t| {
            report(bench, profile, t, mode, HERE + velocity * t, velocity);
            bench.approve(
                Verdict::Passed,
                flight(9, begin, HERE, Vector3::new(-30.0, 0.0, 0.0), 9.0),
            );
        });
        for (time, target) in sent(&bench) {
            if time.seconds_since(begin) < 0.1 {
                continue;
            }
            // A setpoint would end the go-to with which a station enters GUIDED.
            assert_eq!(profile, ProfileName::Px4Offboard, "ArduCopter needs none");
            assert_rules(&target);
            let [position, speed, _] = vectors(&target);
            let there = HERE + velocity * time.seconds_since(begin);
            assert!((position - there).norm() < 0.8, "{position} instead of {there}");
            assert_eq!(speed, Vector3::zeros());
        }
    }
}

/// A gateway that starts while an old plan is still approved must not send the vehicle back to it.
#[test]
fn a_plan_that_lies_far_from_the_vehicle_is_not_flown_and_a_new_one_is_wanted() {
    let (profile, mode) = BOTH[0];
    let mut bench = bench(profile);
    let begin = bench.now;
    let far = HERE + Vector3::new(6.0, 0.0, 0.0);
    bench.fly(2.0, |bench, t| {
        report(bench, profile, t, mode, HERE, Vector3::zeros());
        bench.approve(
            Verdict::Passed,
            flight(9, begin, far, Vector3::new(8.0, 0.0, 0.0), 6.0),
        );
    });
    for (_, target) in sent(&bench) {
        assert_rules(&target);
        assert!((vectors(&target)[0] - HERE).norm() < 0.1);
    }
    let wish = bench.paths.last().expect("the planner is notified").0;
    assert!(!wish.wants_planning());
    // From here it is flown again.
    let begin = bench.now;
    bench.fly(1.0, |bench, t| {
        report(bench, profile, t, mode, HERE, Vector3::zeros());
        bench.approve(
            Verdict::Passed,
            flight(10, begin, HERE, Vector3::new(1.0, 0.0, 0.0), 6.0),
        );
    });
    assert!(vectors(&sent(&bench).last().unwrap().1)[1].x > 0.05);
}

/// ArduCopter refuses a setpoint without a word; that it follows no position is all that shows.
#[test]
fn setpoints_that_the_autopilot_ignores_are_reported_once_and_their_return_once() {
    let (profile, mode) = BOTH[1];
    let mut bench = bench(profile);
    let mut texts = Vec::new();
    bench.fly(36.0, |bench, t| {
        report(bench, profile, t, mode, HERE, Vector3::zeros());
        if ((t * 100.0).round() as u32).is_multiple_of(20) {
            let stopped = PositionTargetTypemask::from_bits_truncate(3079);
            let followed = PositionTargetTypemask::from_bits_truncate(3072);
            bench.receive(MavMessage::POSITION_TARGET_LOCAL_NED(
                POSITION_TARGET_LOCAL_NED_DATA {
                    type_mask: if (2.0..8.0).contains(&t) {
                        stopped
                    } else {
                        followed
                    },
                    ..POSITION_TARGET_LOCAL_NED_DATA::default()
                },
            ));
        }
    });
    for sent in &bench.sent {
        if let MavMessage::STATUSTEXT(line) = &sent.message {
            texts.push(line.text.to_str().unwrap().to_owned());
        }
    }
    let about: Vec<_> = texts.iter().filter(|text| text.contains("setpoints")).collect();
    assert_eq!(
        about,
        [
            "jink: autopilot ignores setpoints",
            "jink: autopilot follows setpoints again"
        ]
    );
}

fn any_vector() -> impl Strategy<Value = Vector3<f64>> {
    let number = prop_oneof![
        8 => -50.0..50.0f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY)
    ];
    prop::array::uniform3(number).prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// ArduCopter's process aborts at a number that is none.
    #[test]
    fn whatever_comes_every_number_that_is_sent_is_finite(
        which in 0..2usize,
        ticks in prop::collection::vec(
            (prop_oneof![Just(MODE_OFFBOARD), Just(MODE_GUIDED), Just(MODE_MISSION), any::<u32>()], any_vector(), any_vector(), any_vector(), 0.01..9.0f64, any::<bool>()),
            1..80,
        ),
    ) {
        let (profile, _) = BOTH[which];
        let mut bench = bench(profile);
        for (i, (mode, position, velocity, way, duration_s, approves)) in ticks.into_iter().enumerate() {
            let now = bench.now;
            report(&mut bench, profile, if i % 7 == 0 { 0.0 } else { 0.06 }, mode, position, velocity);
            if approves {
                bench.approve(Verdict::Passed, flight(i as u64 + 1, now, position, way, duration_s));
            }
            bench.step();
            bench.idle_until(now.plus_seconds(0.05));
        }
        for (_, target) in sent(&bench) {
            assert_rules(&target);
        }
    }
}
