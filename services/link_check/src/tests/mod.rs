//! Every finding by its own sentence, on a scripted autopilot and a clock that is only counted.

mod cases;
mod scene;

use super::{Finding, Grade};
use cases::cases;
use jink_mavlink_link::profile_name::ProfileName;
use mavlink::dialects::ardupilotmega::{MavMessage, MavType};
use proptest::prelude::*;
use scene::{Scene, good};

const PROFILES: [ProfileName; 4] = [
    ProfileName::Px4Trajectory,
    ProfileName::Px4Offboard,
    ProfileName::Px4Deviation,
    ProfileName::ArdupilotGuided,
];

#[test]
fn where_everything_is_as_it_should_be_nothing_else_is_told_and_it_ends_soon() {
    for profile in PROFILES {
        let (findings, _, seconds) = good(profile).play();
        for finding in &findings {
            assert_eq!(
                (finding.grade, finding.remedy.as_str()),
                (Grade::Good, ""),
                "{finding:?}"
            );
        }
        assert!(findings.len() >= 8, "{findings:?}");
        assert!((5.0..8.0).contains(&seconds), "{seconds}");
    }
}

#[test]
fn every_fault_is_told_by_its_own_sentence_with_what_to_do() {
    let mut wrong = Vec::new();
    for (sentence, profile, spoil, grade) in cases() {
        let mut scene = good(profile);
        spoil(&mut scene);
        let (findings, _, _) = scene.play();
        let told: Vec<_> = findings
            .iter()
            .filter(|finding| finding.is.contains(sentence))
            .collect();
        let fits = |finding: &&Finding| {
            finding.grade == grade && finding.remedy.is_empty() == (grade == Grade::Good)
        };
        if told.len() != 1 || !told.iter().all(fits) {
            wrong.push((sentence, findings));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_fault_is_told_where_there_is_none() {
    let good: Vec<_> = PROFILES
        .into_iter()
        .flat_map(|profile| good(profile).play().0)
        .collect();
    for (sentence, _, _, grade) in cases() {
        let told = good.iter().any(|finding| finding.is.contains(sentence));
        assert_eq!(told, grade == Grade::Good, "{sentence}");
    }
}

#[test]
fn what_follows_from_a_fault_is_not_told_beside_it() {
    let mut wrong = Vec::new();
    for (sentence, profile, spoil, grade) in cases() {
        let mut scene = good(profile);
        spoil(&mut scene);
        let (mut findings, _, _) = scene.play();
        findings.retain(|finding| finding.grade == Grade::Blocker);
        if findings.len() != usize::from(grade == Grade::Blocker) {
            wrong.push((sentence, findings));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn it_never_sends_a_setpoint_changes_a_mode_or_speaks_as_avoidance() {
    let greets = |scene: &Scene| {
        let (_, said, _) = scene.play();
        let mut heartbeats = 0;
        for (component_id, message) in said {
            assert_eq!(component_id, 191);
            match message {
                MavMessage::HEARTBEAT(beat) => {
                    assert_eq!(beat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
                    heartbeats += 1;
                }
                // What they ask for is checked by the script that answers.
                MavMessage::COMMAND_LONG(_) | MavMessage::PARAM_REQUEST_READ(_) => {}
                MavMessage::TIMESYNC(sync) => assert_eq!(sync.tc1, 0),
                other => panic!("{other:?}"),
            }
        }
        heartbeats
    };
    for (_, profile, spoil, _) in cases() {
        let mut scene = good(profile);
        spoil(&mut scene);
        greets(&scene);
    }
    let mut alone = good(ProfileName::Px4Trajectory);
    alone.nobody();
    assert_eq!(greets(&alone), 16, "once a second while nobody is heard");
    assert!(
        greets(&good(ProfileName::Px4Trajectory)) <= 2,
        "and not once somebody is"
    );
}

#[test]
fn the_vehicle_of_somebody_else_is_asked_nothing() {
    let mut scene = good(ProfileName::Px4Trajectory);
    scene.link("system_id = 7\n");
    let (_, said, _) = scene.play();
    assert!(
        said.iter()
            .all(|(_, message)| matches!(message, MavMessage::HEARTBEAT(_)))
    );
}

#[test]
fn a_ground_stations_link_is_never_taken_for_the_autopilots() {
    let mut scene = good(ProfileName::Px4Trajectory);
    scene.link("[[link.also]]\nname = \"ground\"\naddress = \"udpin:14550\"\n");
    let (findings, _, _) = scene.play();
    let ground = findings
        .iter()
        .find(|finding| finding.about == "link ground")
        .unwrap();
    assert_eq!(ground.grade, Grade::Good);
    assert!(
        ground.is.contains("nobody speaks on udpin:127.0.0.1:14550 yet"),
        "{ground:?}"
    );
}

proptest! {
    /// Whatever parameters say, the examination ends with a verdict in which every fault has a remedy.
    #[test]
    fn no_value_of_a_parameter_upsets_it(
        which in 0..3usize,
        values in proptest::collection::vec(any::<f32>(), 6),
    ) {
        let mut scene = good(PROFILES[which]);
        for ((_, value), drawn) in scene.parameters.iter_mut().zip(values) {
            *value = f64::from(drawn);
        }
        let (findings, _, _) = scene.play();
        for finding in findings {
            prop_assert_eq!(finding.remedy.is_empty(), finding.grade == Grade::Good, "{:?}", finding);
        }
    }
}
