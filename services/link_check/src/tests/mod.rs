//! Every finding by its own sentence, on a scripted autopilot and a clock that is only counted.

mod cases;
mod scripted_autopilot;

use super::{Finding, Severity};
use cases::cases;
use jink_mavlink_link::profile_name::ProfileName;
use mavlink::dialect::{MavMessage, MavType};
use proptest::prelude::*;
use scripted_autopilot::{ScriptedAutopilot, good};

const PROFILES: [ProfileName; 4] = [
    ProfileName::Px4Trajectory,
    ProfileName::Px4Offboard,
    ProfileName::Px4Deviation,
    ProfileName::ArdupilotGuided,
];

#[test]
fn where_everything_is_as_it_should_be_nothing_else_is_reported_and_it_ends_soon() {
    for profile in PROFILES {
        let (findings, _, seconds) = good(profile).run();
        for finding in &findings {
            assert_eq!(
                (finding.grade, finding.remedy.as_str()),
                (Severity::Good, ""),
                "{finding:?}"
            );
        }
        assert!(findings.len() >= 8, "{findings:?}");
        assert!((5.0..8.0).contains(&seconds), "{seconds}");
    }
}

#[test]
fn every_fault_is_reported_by_its_own_sentence_with_what_to_do() {
    let mut wrong = Vec::new();
    for (sentence, profile, break_it, grade) in cases() {
        let mut script = good(profile);
        break_it(&mut script);
        let (findings, _, _) = script.run();
        let reported: Vec<_> = findings
            .iter()
            .filter(|finding| finding.is.contains(sentence))
            .collect();
        let fits = |finding: &&Finding| {
            finding.grade == grade && finding.remedy.is_empty() == (grade == Severity::Good)
        };
        if reported.len() != 1 || !reported.iter().all(fits) {
            wrong.push((sentence, findings));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_fault_is_reported_where_there_is_none() {
    let good: Vec<_> = PROFILES
        .into_iter()
        .flat_map(|profile| good(profile).run().0)
        .collect();
    for (sentence, _, _, grade) in cases() {
        let reported = good.iter().any(|finding| finding.is.contains(sentence));
        assert_eq!(reported, grade == Severity::Good, "{sentence}");
    }
}

#[test]
fn what_follows_from_a_fault_is_not_reported_beside_it() {
    let mut wrong = Vec::new();
    for (sentence, profile, break_it, grade) in cases() {
        let mut script = good(profile);
        break_it(&mut script);
        let (mut findings, _, _) = script.run();
        findings.retain(|finding| finding.grade == Severity::Blocker);
        if findings.len() != usize::from(grade == Severity::Blocker) {
            wrong.push((sentence, findings));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn it_never_sends_a_setpoint_changes_a_mode_or_poses_as_avoidance() {
    let heartbeats_of = |script: &ScriptedAutopilot| {
        let (_, sent, _) = script.run();
        let mut heartbeats = 0;
        for (component_id, message) in sent {
            assert_eq!(component_id, 191);
            match message {
                MavMessage::HEARTBEAT(heartbeat) => {
                    assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
                    heartbeats += 1;
                }
                // The script that answers checks their content.
                MavMessage::COMMAND_LONG(_) | MavMessage::PARAM_REQUEST_READ(_) => {}
                MavMessage::TIMESYNC(sync) => assert_eq!(sync.tc1, 0),
                other => panic!("{other:?}"),
            }
        }
        heartbeats
    };
    for (_, profile, break_it, _) in cases() {
        let mut script = good(profile);
        break_it(&mut script);
        heartbeats_of(&script);
    }
    let mut alone = good(ProfileName::Px4Trajectory);
    alone.remove_autopilot();
    assert_eq!(
        heartbeats_of(&alone),
        16,
        "once a second while nobody is connected"
    );
    assert!(
        heartbeats_of(&good(ProfileName::Px4Trajectory)) <= 2,
        "and not once somebody is"
    );
}

#[test]
fn another_vehicle_is_asked_nothing() {
    let mut script = good(ProfileName::Px4Trajectory);
    script.link("system_id = 7\n");
    let (_, sent, _) = script.run();
    assert!(
        sent.iter()
            .all(|(_, message)| matches!(message, MavMessage::HEARTBEAT(_)))
    );
}

#[test]
fn a_ground_stations_link_is_never_taken_for_the_autopilots() {
    let mut script = good(ProfileName::Px4Trajectory);
    script.link("[[link.also]]\nname = \"ground\"\naddress = \"udpin:14550\"\n");
    let (findings, _, _) = script.run();
    let ground = findings
        .iter()
        .find(|finding| finding.about == "link ground")
        .unwrap();
    assert_eq!(ground.grade, Severity::Good);
    assert!(
        ground.is.contains("nobody speaks on udpin:127.0.0.1:14550 yet"),
        "{ground:?}"
    );
}

proptest! {
    /// Whatever parameters say, the check ends with a verdict in which every fault has a remedy.
    #[test]
    fn no_value_of_a_parameter_upsets_it(
        which in 0..3usize,
        values in proptest::collection::vec(any::<f32>(), 6),
    ) {
        let mut script = good(PROFILES[which]);
        for ((_, value), drawn) in script.parameters.iter_mut().zip(values) {
            *value = f64::from(drawn);
        }
        let (findings, _, _) = script.run();
        for finding in findings {
            prop_assert_eq!(finding.remedy.is_empty(), finding.grade == Severity::Good, "{:?}", finding);
        }
    }
}
