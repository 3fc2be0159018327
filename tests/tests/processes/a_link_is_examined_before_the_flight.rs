//! `jink check link` as a user runs it, against emulated autopilots over UDP: each fault is reported by its own
//! sentence and exit code, and where there is none, jink is ready.

use jink_emulated_arducopter::{ArduCopter, ArduCopterConfig};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_px4::{Px4, Px4Config};
use jink_mavlink_link::signing::Key;
use jink_tests::on_udp::{Faults, OnUdp};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Answer, System, TempFolder, answer, program};
use mavlink::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};
use serde_json::Value;

/// Numbers of the messages that get lost here.
const TIMESYNC: u32 = 111;
const LOCAL_POSITION_NED: u32 = 32;
const ATTITUDE_QUATERNION: u32 = 31;

const READY: i32 = 0;
const BLOCKED: i32 = 1;
const WRONG_USAGE: i32 = 2;

type Pilot = Option<Box<dyn Autopilot + Send>>;

/// PX4 with the trajectory interface.
fn px4(system_id: u8, parameters: &[(&str, f64)]) -> Pilot {
    let config = Px4Config {
        system_id,
        parameters: owned(parameters),
        ..Px4Config::default()
    };
    Some(Box::new(Px4::new(config).unwrap()))
}

/// PX4 without it.
fn current_px4(parameters: &[(&str, f64)]) -> Pilot {
    let config = Px4Config {
        parameters: owned(parameters),
        ..Px4Config::current(0.1)
    };
    Some(Box::new(Px4::new(config).unwrap()))
}

fn arducopter(parameters: &[(&str, f64)]) -> Pilot {
    let config = ArduCopterConfig {
        parameters: owned(parameters),
        ..ArduCopterConfig::default()
    };
    Some(Box::new(ArduCopter::new(config).unwrap()))
}

fn owned(parameters: &[(&str, f64)]) -> Vec<(String, f64)> {
    parameters
        .iter()
        .map(|(name, value)| ((*name).to_owned(), *value))
        .collect()
}

fn heartbeat(mavtype: MavType, autopilot: MavAutopilot) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// `jink check link` on a link to `port`, with further `settings`.
fn check(port: u16, settings: &[&str], further: &[&str]) -> Answer {
    // No instance of this name runs.
    let instance = format!("t_check_{}_{port}", std::process::id());
    let mut command = program("jink", &["--instance", &instance, "check", "link"]);
    command.args(["--link", &format!("udpin:127.0.0.1:{port}")]);
    // A profile is examined as it is named; which one "auto" chooses has tests of its own.
    if !settings
        .iter()
        .any(|setting| setting.starts_with("link.profile="))
    {
        command.args(["--set", "link.profile=px4_trajectory"]);
    }
    for setting in settings {
        command.args(["--set", setting]);
    }
    answer(command.args(further))
}

/// What is reported beside `pilot`, with `faults` and `settings`: in words, and the exit code.
fn reported(pilot: Pilot, faults: Faults, settings: &[&str]) -> Answer {
    let port = free_udp_port();
    let _speaks = OnUdp::begin(port, pilot, faults);
    let reported = check(port, settings, &[]);
    println!("{}exit code {:?}\n", reported.stdout, reported.code);
    reported
}

/// Asserts that `sentence` is reported with `grade`, and the exit code that follows from it.
fn assert_reported(reported: &Answer, grade: &str, sentence: &str) {
    let line = reported
        .stdout
        .lines()
        .find(|line| line.starts_with(grade) && line.contains(sentence));
    assert!(line.is_some(), "no {grade} {sentence:?} in {reported:?}");
    match grade {
        "BLOCKER" => {
            assert_eq!(reported.code, Some(BLOCKED));
            assert!(reported.stdout.starts_with("NOT READY: "), "{reported:?}");
            let first = reported.stdout.lines().nth(1).unwrap();
            assert!(
                first.starts_with("First: ") && first.contains(sentence),
                "{first}"
            );
        }
        _ => {
            assert_eq!(reported.code, Some(READY), "{reported:?}");
            assert!(reported.stdout.starts_with("READY: "), "{reported:?}");
        }
    }
}

#[test]
fn where_nothing_is_wrong_each_profile_is_ready() {
    for (pilot, profile, whom) in [
        (
            px4(1, &[]),
            "px4_trajectory",
            "PX4 1.13.0 (development), quadrotor, system 1",
        ),
        (
            current_px4(&[("COM_OBL_RC_ACT", 5.0)]),
            "px4_offboard",
            "PX4 1.17.0 (development), quadrotor, system 1",
        ),
        (
            current_px4(&[("EAV_EN", 1.0)]),
            "px4_deviation",
            "PX4 1.17.0 (development), quadrotor, system 1",
        ),
        (
            arducopter(&[("GUID_TIMEOUT", 0.5), ("PRX1_TYPE", 2.0), ("PRX_FILT", 0.0)]),
            "ardupilot_guided",
            "ArduPilot 4.7.0 (development), quadrotor, system 1",
        ),
    ] {
        let reported = reported(pilot, Faults::default(), &[&format!("link.profile={profile}")]);
        assert_eq!(reported.code, Some(READY), "{reported:?}");
        assert_eq!(
            reported.stdout.lines().next().unwrap(),
            format!("READY: {whom}; 0 warnings")
        );
        let waits = "listening for an autopilot (15 s at most)\n";
        assert_eq!(
            reported.stderr, waits,
            "what is waited for, once; progress is for terminals"
        );
    }
}

#[test]
fn a_line_that_brings_nothing_or_something_else_is_distinguished_from_one_that_brings_mavlink() {
    let port = free_udp_port();
    let silent = check(port, &[], &["--seconds", "2"]);
    println!("{}", silent.stdout);
    assert_reported(
        &silent,
        "BLOCKER",
        &format!("nothing arrives on udpin:127.0.0.1:{port}"),
    );

    let port = free_udp_port();
    let _noise = OnUdp::noise(port);
    let noise = check(port, &[], &["--seconds", "2"]);
    println!("{}", noise.stdout);
    assert_reported(&noise, "BLOCKER", "but no MAVLink message among them");

    let old = Faults {
        version_1: true,
        ..Faults::default()
    };
    assert_reported(
        &reported(px4(1, &[]), old, &[]),
        "BLOCKER",
        "the autopilot speaks MAVLink 1 only",
    );

    let deaf = Faults {
        is_deaf: true,
        ..Faults::default()
    };
    assert_reported(
        &reported(px4(1, &[]), deaf, &[]),
        "BLOCKER",
        "the autopilot sends, but answers nothing",
    );
}

#[test]
fn whoever_is_not_the_one_autopilot_that_is_meant_is_named() {
    let with = |system_id, component_id, message| Faults {
        others: vec![(system_id, component_id, message)],
        ..Faults::default()
    };
    let station = heartbeat(MavType::MAV_TYPE_GCS, MavAutopilot::MAV_AUTOPILOT_INVALID);
    let alone = reported(None, with(255, 190, station), &[]);
    assert_reported(
        &alone,
        "BLOCKER",
        "no autopilot's heartbeat: only a ground station (255/190)",
    );

    let unknown_peer = reported(px4(3, &[]), Faults::default(), &["link.system_id=7"]);
    assert_reported(
        &unknown_peer,
        "BLOCKER",
        "link.system_id = 7, and the autopilot that is connected has system id 3",
    );

    let rival = heartbeat(MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_PX4);
    let two = reported(px4(1, &[]), with(9, 1, rival), &[]);
    assert_reported(
        &two,
        "BLOCKER",
        "are connected, and link.system_id = 0 does not say which one is meant",
    );

    let companion = heartbeat(
        MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        MavAutopilot::MAV_AUTOPILOT_INVALID,
    );
    let other = reported(px4(1, &[]), with(1, 196, companion), &[]);
    assert_reported(
        &other,
        "BLOCKER",
        "somebody else speaks as obstacle avoidance (1/196)",
    );
}

#[test]
fn a_profile_that_does_not_fit_make_or_version_is_reported_with_the_one_that_does() {
    let make = reported(arducopter(&[]), Faults::default(), &[]);
    assert_reported(
        &make,
        "BLOCKER",
        "the autopilot is ArduPilot, and link.profile = \"px4_trajectory\" is for PX4",
    );
    assert!(
        make.stdout
            .contains("-> set link.profile to auto, or to ardupilot_guided")
    );

    let version = reported(current_px4(&[]), Faults::default(), &[]);
    assert_reported(
        &version,
        "BLOCKER",
        "PX4 1.17.0 (development) has no trajectory interface any more",
    );
    assert!(version.stdout.contains("-> set link.profile to \"px4_offboard\""));
}

#[test]
fn parameters_that_keep_jink_from_flying_or_make_its_loss_dangerous_are_reported() {
    let off = reported(px4(1, &[("COM_OBS_AVOID", 0.0)]), Faults::default(), &[]);
    assert_reported(
        &off,
        "BLOCKER",
        "COM_OBS_AVOID = 0: PX4 flies its missions without asking jink",
    );

    let guided = ["link.profile=ardupilot_guided"];
    let long = reported(arducopter(&[]), Faults::default(), &guided);
    assert_reported(&long, "warning", "GUID_TIMEOUT = 3.0 s is too long");
    let short = reported(arducopter(&[("GUID_TIMEOUT", 0.05)]), Faults::default(), &guided);
    assert_reported(&short, "BLOCKER", "GUID_TIMEOUT = 0.05 s is too short");

    let motors = reported(
        current_px4(&[("COM_OBL_RC_ACT", 7.0)]),
        Faults::default(),
        &["link.profile=px4_offboard"],
    );
    assert_reported(
        &motors,
        "BLOCKER",
        "COM_OBL_RC_ACT = 7: if the board dies, PX4 stops the motors in the air",
    );
}

#[test]
fn streams_and_times_that_do_not_come_are_reported_one_by_one() {
    let lost = |id| Faults {
        lost: vec![id],
        ..Faults::default()
    };
    let blind = reported(px4(1, &[]), lost(LOCAL_POSITION_NED), &[]);
    assert_reported(
        &blind,
        "BLOCKER",
        "LOCAL_POSITION_NED does not come, and not when asked for",
    );

    let slow = Faults {
        thinned: Some((ATTITUDE_QUATERNION, 10)),
        ..Faults::default()
    };
    let slow = reported(px4(1, &[]), slow, &[]);
    assert_reported(
        &slow,
        "BLOCKER",
        "times a second, and 50 are needed; it reports how it is turned",
    );

    let timeless = reported(px4(1, &[]), lost(TIMESYNC), &[]);
    assert_reported(&timeless, "warning", "the autopilot does not answer TIMESYNC");
}

#[test]
fn signatures_that_are_missing_or_of_another_key_are_reported() {
    let folder = TempFolder::new("check_signing");
    let ours = b"passphrase:correct horse battery staple\n";
    let file = folder.write("our.key", std::str::from_utf8(ours).unwrap());
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    std::fs::set_permissions(&file, permissions).unwrap();
    let key_file = format!("link.key_file={}", file.display());
    let require = ["link.signing=require", key_file.as_str()];

    let unsigned = reported(px4(1, &[]), Faults::default(), &require);
    assert_reported(&unsigned, "BLOCKER", "and what arrives is not signed");

    let signing = |content: &[u8]| Faults {
        key: Key::of_bytes(content),
        ..Faults::default()
    };
    let other = reported(px4(1, &[]), signing(b"passphrase:another\n"), &require);
    assert_reported(
        &other,
        "BLOCKER",
        "messages are signed with another key than link.key_file holds",
    );

    let right = reported(px4(1, &[]), signing(ours), &require);
    assert_reported(&right, "good", "the autopilot's signatures fit the key");
}

#[test]
fn scripts_get_the_same_as_json() {
    let port = free_udp_port();
    let _speaks = OnUdp::begin(port, px4(1, &[("COM_OBS_AVOID", 0.0)]), Faults::default());
    let reported = check(port, &[], &["--json"]);
    let json: Value = serde_json::from_str(&reported.stdout).unwrap();
    assert_eq!(
        (reported.code, &json["ready"]),
        (Some(BLOCKED), &Value::Bool(false))
    );
    assert_eq!(json["mend_first"]["about"], "COM_OBS_AVOID");
    assert!(json["findings"].as_array().unwrap().len() > 8, "{json}");
}

#[test]
fn wrong_usage_and_a_wrong_configuration_are_no_examination() {
    let port = free_udp_port();
    for (settings, further, said) in [
        (
            &["link.profile=px5"][..],
            &[][..],
            "unknown profile px5; there are: auto px4_trajectory px4_offboard px4_deviation ardupilot_guided",
        ),
        (
            &["link.addres=udpin:1"],
            &[],
            "unknown key `addres`; did you mean `address`?",
        ),
        (
            &["link.signing=require"],
            &[],
            "signatures are asked for, and no file holds the key",
        ),
        (&[], &["--seconds", "0"], "--seconds"),
        (
            &[],
            &["--profile", "px4_trajectry"],
            "did you mean `px4_trajectory`?",
        ),
    ] {
        let reported = check(port, settings, further);
        assert_eq!(
            (reported.code, reported.stdout.as_str()),
            (Some(WRONG_USAGE), ""),
            "{reported:?}"
        );
        assert!(reported.stderr.contains(said), "{reported:?}");
    }
}

#[test]
fn a_port_that_somebody_else_holds_is_a_blocker_with_his_trace() {
    let holder = std::net::UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let port = holder.local_addr().unwrap().port();
    let reported = check(port, &[], &[]);
    assert_reported(
        &reported,
        "BLOCKER",
        &format!("port {port} is taken by another program"),
    );
}

#[test]
fn while_jink_runs_its_gateways_own_figures_are_shown() {
    let port = free_udp_port();
    let address = format!("link.address=udpin:127.0.0.1:{port}");
    let station = "simulation.ground_station_port=0";
    let system = System::up(
        "running",
        &["--world", "empty", "--set", &address, "--set", station],
    );
    // Whether or not the address is named again.
    for further in [&["--set", address.as_str()][..], &[]] {
        let reported = system.jink(&[&["check", "link"], further].concat());
        println!("{}exit code {:?}\n", reported.stdout, reported.code);
        let held = format!("runs and holds udpin:127.0.0.1:{port}: this is what its gateway sees");
        assert_reported(&reported, "good", &held);
        assert_reported(&reported, "good", "system 1 is connected");
    }
}
