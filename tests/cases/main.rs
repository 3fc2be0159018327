//! Inputs that reports from the field lead to, as they lie in `../shared/cases` beside the checkout: each is fed as its README says and
//! judged by what must come out. `cargo cases` runs them; where the folder is absent, they say so and pass.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod flown;
mod given;

use given::{Case, figure};
use jink_tests::not_tested;
use jink_tests::permit;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Answer, TempFolder, answer, program, until};
use rustix::process::{Pid, Signal, kill_process};
use std::path::Path;
use std::process::Command;

#[test]
fn case_1_an_altitude_of_zero_keeps_the_altitude_that_is_flown() {
    let Some(flight) = flown::mission("altitude_zero.waypoints", &[]) else {
        return;
    };
    assert!(figure(&flight, "lowest ") >= 9.5, "{flight}");
    assert!(figure(&flight, "item ") >= 4.0, "{flight}");
}

#[test]
fn case_2_a_speed_of_type_0_is_obeyed_beside_arducopter() {
    slow("ardupilot");
}

#[test]
fn case_2_a_speed_of_type_0_is_obeyed_beside_px4() {
    slow("px4");
}

fn slow(make: &str) {
    let Some(flight) = flown::mission("speed_type_0.waypoints", &["--make", make]) else {
        return;
    };
    let speed_mps = figure(&flight, "mean speed while it moved ");
    assert!((0.3..1.05).contains(&speed_mps), "{flight}");
}

#[test]
fn case_3_a_jump_to_home_is_never_flown_and_the_pilot_is_told() {
    let Some(flight) = flown::mission("jump_to_item_0.waypoints", &[]) else {
        return;
    };
    assert!(figure(&flight, "lowest ") >= 9.0, "{flight}");
    let told = |line: &str| line.contains("jink:") && (line.contains("item") || line.contains("mission"));
    assert!(flight.lines().any(told), "{flight}");
}

#[test]
fn case_4_a_return_ends_where_home_is_now() {
    let Some(flight) = flown::mission("return.waypoints", &["--home-moves", "0,15"]) else {
        return;
    };
    assert!(figure(&flight, "mean speed while it moved ") > 0.3, "{flight}");
    let end = [figure(&flight, "end north "), figure(&flight, " east ")];
    assert!(end[0].abs() < 1.0 && (end[1] - 15.0).abs() < 1.0, "{flight}");
}

#[test]
fn case_5_a_second_vehicle_on_the_port_gets_nothing_and_takes_nothing() {
    let Some(said) = flown::beside("second", "second_vehicle.py", &[]) else {
        return;
    };
    let alone = figure(&said, "alone: ");
    assert!(alone > 30.0, "{said}");
    let beside = said.matches("with the second vehicle: ").count();
    assert_eq!(beside, 3, "{said}");
    for line in said.lines().filter(|line| line.starts_with("with the")) {
        // Of a busy machine; shared by two addresses it would be half of it.
        assert!(figure(line, "with the second vehicle: ") > 0.8 * alone, "{said}");
    }
    assert!(said.contains("the second vehicle was sent {}"), "{said}");
}

#[test]
fn case_6_a_sensor_whose_clock_is_set_back_is_dated_anew_or_reported() {
    let Some(case) = Case::find() else { return };
    let Some(python) = case.python() else { return };
    let [link, lidar] = [free_udp_port(), free_udp_port()];
    let folder = TempFolder::new("case_6");
    let metadata = case.path("os16.json");
    let sensor = std::fs::read_to_string(case.path("ouster_udp.toml"))
        .unwrap()
        .replace("7502", &lidar.to_string())
        .replace("os16.json", metadata.to_str().unwrap());
    let table = folder.write("sensor.toml", &sensor);
    let address = format!("udpin:127.0.0.1:{link}");
    let jink = jink_tests::processes::System::up(
        "case_6",
        &["--sensor", table.to_str().unwrap(), "--link", &address],
    );
    let mut clock = python.script("sensor_clock.py", &["-300", "120"], &[("7502", lidar)]);
    let mut clock = clock.spawn().unwrap();
    // Its age, and whether it is reported.
    let seen = || {
        let checked = jink.jink(&["check", "sensors", "--seconds", "2", "--json"]);
        let seen: serde_json::Value = serde_json::from_str(&checked.stdout).unwrap_or_default();
        let findings = seen["findings"].as_array().cloned().unwrap_or_default();
        let is_bad = |one: &serde_json::Value| one["about"] == "top" && one["grade"] != "good";
        (
            seen["sensors"][0]["age_p50_ms"].as_f64(),
            findings.iter().any(is_bad),
        )
    };
    let mut before = (None, false);
    until("the sensor's data", || {
        before = seen();
        before.0.is_some()
    });
    // It is set ten seconds after its start; some seconds later it is judged.
    std::thread::sleep(std::time::Duration::from_secs(16));
    let after = seen();
    let _gone_already = clock.kill();
    let _not_ours = clock.wait();
    let aged_ms = after.0.unwrap_or(f64::INFINITY) - before.0.unwrap();
    assert!(aged_ms < 60.0 || after.1, "{before:?}, then {after:?}");
}

#[test]
fn case_7_packets_of_other_interfaces_are_passed_over() {
    let Some(case) = Case::find() else { return };
    let folder = TempFolder::new("case_7");
    let dump = |recording: &str| {
        let out = folder.path().join(format!("{recording}.csv"));
        let recording = case.path(recording);
        dumped(&[("--pcap", &recording), ("--csv", &out)])
    };
    let (same, two) = (
        dump("vlp16_same_packets.pcap"),
        dump("vlp16_two_interfaces.pcapng"),
    );
    assert_eq!(returns(&same), 30_720);
    assert!(same == two, "{} and {} returns", returns(&same), returns(&two));
}

#[test]
fn case_8_metadata_with_a_byte_order_mark_are_read() {
    let Some(case) = Case::find() else { return };
    let folder = TempFolder::new("case_8");
    let dump = |metadata: &str| {
        let out = folder.path().join(format!("{metadata}.csv"));
        let (recording, metadata) = (case.path("os16.pcap"), case.path(metadata));
        dumped(&[("--pcap", &recording), ("--metadata", &metadata), ("--csv", &out)])
    };
    let (same, marked) = (dump("os16.json"), dump("os16_bom.json"));
    assert_eq!(returns(&same), 24_576);
    assert!(
        same == marked,
        "{} and {} returns",
        returns(&same),
        returns(&marked)
    );
}

/// What `jink lidar dump` with these files writes into the last of them.
fn dumped(files: &[(&str, &Path)]) -> String {
    let mut command = program("jink", &["lidar", "dump"]);
    for (option, file) in files {
        command.arg(option).arg(file);
    }
    let said = answer(&mut command);
    assert_eq!(said.code, Some(0), "{said:?}");
    std::fs::read_to_string(files.last().unwrap().1).unwrap()
}

/// Lines of a table, its head aside.
fn returns(table: &str) -> usize {
    table.lines().count().saturating_sub(1)
}

#[test]
fn case_9_after_a_hard_end_the_first_start_works() {
    if Case::find().is_none() {
        return;
    }
    let _permit = permit::share();
    let instance = format!("case_9_{}", std::process::id());
    let address = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let jink = |arguments: &[&str]| -> Answer {
        let mut command = program("jink", &["--instance", &instance]);
        answer(command.args(arguments))
    };
    let up = [
        "up",
        "--detach",
        "--world",
        "empty",
        "--set",
        &address,
        "--set",
        "simulation.ground_station_port=0",
    ];
    let first = jink(&up);
    assert_eq!(first.code, Some(0), "{first:?}");
    let pids = given::processes_of(&instance);
    assert!(pids.len() > 5, "{pids:?}");
    for pid in &pids {
        let _gone_already = Pid::from_raw(*pid).map(|pid| kill_process(pid, Signal::KILL));
    }
    until("the end of all", || given::processes_of(&instance).is_empty());
    let second = jink(&up);
    let down = jink(&["down", "--now"]);
    assert_eq!(second.code, Some(0), "{second:?}");
    assert_eq!(down.code, Some(0), "{down:?}");
}

#[test]
fn case_10_too_little_shared_memory_is_refused_in_words() {
    if Case::find().is_none() {
        return;
    }
    let _permit = permit::share();
    let in_room = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c"]);
        let script = format!("mount -t tmpfs -o size=4m tmpfs /dev/shm && {script}");
        answer(
            command
                .arg(script)
                .current_dir(jink_tests::processes::workspace()),
        )
    };
    let allowed = Command::new("unshare").args(["--mount", "true"]).status();
    if !allowed.is_ok_and(|status| status.success()) || in_room("true").code != Some(0) {
        not_tested("only root can make /dev/shm small");
        return;
    }
    let jink = jink_tests::processes::programs().join("jink");
    let link = free_udp_port();
    let said = in_room(&format!(
        "{} demo --world forest --seed 3 --sensor mid360 --headless --set link.address=udpin:127.0.0.1:{link}",
        jink.display()
    ));
    let text = format!("{}{}", said.stdout, said.stderr);
    assert_ne!(said.code, Some(0), "{text}");
    assert!(!text.contains("signal 7"), "{text}");
    assert!(text.contains("/dev/shm"), "{text}");
}
