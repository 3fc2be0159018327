//! `jink check sensors` as a user runs it, on a jink that runs: rates, coverage and blind directions of sensors that leave a gap, a
//! rangefinder that lies, and one that is unplugged. And `jink check memory`, beside what such a jink really takes, and `jink check host`.

use crate::real_sensors::Luna;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Answer, Handle, System, TempFolder, answer, program, until};
use serde_json::Value;
use std::path::Path;

const BLOCKED: Option<i32> = Some(1);
const WRONG_USAGE: Option<i32> = Some(2);
const NOT_RUNNING: Option<i32> = Some(3);

/// Examines for so long, and answers what the JSON says.
fn examined(jink: &Handle, seconds: &str) -> (Value, Answer) {
    let reported = jink.jink(&["check", "sensors", "--seconds", seconds, "--json"]);
    let json = serde_json::from_str(&reported.stdout).unwrap_or(Value::Null);
    (json, reported)
}

/// The sentences about `about` with `grade`.
fn reported<'a>(json: &'a Value, grade: &str, about: &str) -> Vec<&'a str> {
    let findings = json["findings"].as_array().unwrap();
    let matching = findings
        .iter()
        .filter(|one| one["grade"] == grade && one["about"] == about);
    matching.filter_map(|one| one["is"].as_str()).collect()
}

/// The figures of the sensor called `name`.
fn figures<'a>(json: &'a Value, name: &str) -> &'a Value {
    let sensors = json["sensors"].as_array().unwrap();
    sensors.iter().find(|sensor| sensor["name"] == name).unwrap()
}

#[test]
fn rates_coverage_and_what_nobody_sees_are_reported_of_a_vehicle_with_a_gap() {
    // Ahead 182 degrees, behind 82, so sectors of 185 and 85: 45 degrees are missing to each side.
    let sensors = "[[sensor]]\nname = \"front\"\nkind = \"lidar_2d\"\nfov_horizontal_deg = 182\nbeams = 182\nrate_hz = 12\n\
                   [[sensor]]\nname = \"rear\"\nkind = \"lidar_2d\"\nfov_horizontal_deg = 82\nbeams = 82\nyaw_deg = 180\n";
    let folder = TempFolder::with_sensors("sensors_gap", sensors);
    let address = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(
        "gap",
        &[
            "--config",
            folder.text(),
            "--world",
            "forest",
            "--set",
            &address,
            "--set",
            "simulation.ground_station_port=0",
        ],
    );
    let mut json = Value::Null;
    // The vehicle's position is known some seconds after the start.
    until("a guard that sees", || {
        json = examined(&jink, "2").0;
        reported(&json, "blocker", "vehicle/state").is_empty() && json["ring"]["known_deg"] == 270.0
    });
    let blind = serde_json::json!([
        {"from_deg": 92.5, "to_deg": 137.5},
        {"from_deg": 222.5, "to_deg": 267.5},
    ]);
    assert_eq!(json["ring"]["blind"], blind, "{json:#}");
    let said = "blind: 92.5 to 137.5 deg (right, behind), 222.5 to 267.5 deg (behind, left); 270 deg known";
    let warnings = reported(&json, "warning", "blind");
    assert!(warnings.iter().any(|is| is.starts_with(said)), "{json:#}");

    let (front, rear) = (figures(&json, "front"), figures(&json, "rear"));
    assert_eq!(front["coverage_deg"], 185.0, "{front:#}");
    assert_eq!(
        front["coverage"],
        serde_json::json!([{"from_deg": 267.5, "to_deg": 92.5}])
    );
    assert_eq!(rear["coverage_deg"], 85.0, "{rear:#}");
    assert_eq!(
        rear["coverage"],
        serde_json::json!([{"from_deg": 137.5, "to_deg": 222.5}])
    );
    for (sensor, expected_hz) in [(front, 12.0), (rear, 10.0)] {
        assert_eq!(sensor["expected_hz"], expected_hz);
        let rate_hz = sensor["rate_hz"].as_f64().unwrap();
        // A busy machine may make it slower, nothing makes it faster.
        assert!(rate_hz > 0.0 && rate_hz < 1.5 * expected_hz, "{sensor:#}");
        assert!(sensor["age_p99_ms"].as_f64().unwrap() >= sensor["age_p50_ms"].as_f64().unwrap());
    }
    assert!(json["ring"]["rate_hz"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_rangefinder_that_repeats_itself_is_stuck_and_one_that_is_unplugged_is_silent() {
    let place = TempFolder::new("sensors_lines");
    let [lying, honest] = ["ttyLIES", "ttyTRUE"].map(|name| place.path().join(name));
    let _lies = Luna::plug_in(&lying, |_| 300);
    // Two of a kind, then another: what is said twice within a scan is believed.
    let mut speaks = Luna::plug_in(&honest, |number| 400 + 7 * (number / 12 % 5));
    let table = |name: &str, device: &Path, orientation: &str| {
        format!(
            "[[sensor]]\nname = \"{name}\"\nkind = \"rangefinder\"\nmodel = \"tf_luna\"\ndevice = {device:?}\n\
             orientation = \"{orientation}\"\n"
        )
    };
    let sensors = table("lies", &lying, "forward") + &table("speaks", &honest, "right");
    let folder = TempFolder::with_sensors("sensors_lies", &sensors);
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up("lies", &["--config", folder.text(), "--link", &link]);

    let mut json = Value::Null;
    until("both to send", || {
        json = examined(&jink, "3").0;
        let has_blocker = |name: &str| !reported(&json, "blocker", name).is_empty();
        has_blocker("lies") && !has_blocker("speaks")
    });
    let stuck = reported(&json, "blocker", "lies");
    assert!(
        stuck
            .iter()
            .any(|is| is.starts_with("stuck: says 3.000 m in all of ")),
        "{json:#}"
    );
    assert_eq!(figures(&json, "lies")["coverage_deg"], 5.0);
    assert_eq!(
        figures(&json, "speaks")["coverage"],
        serde_json::json!([{"from_deg": 87.5, "to_deg": 92.5}])
    );
    // No autopilot is there.
    assert_eq!(reported(&json, "blocker", "vehicle/state").len(), 1, "{json:#}");

    speaks.unplug();
    let mut last = None;
    until("the silence", || {
        let (json, answer) = examined(&jink, "2");
        let is_silent = reported(&json, "blocker", "speaks")
            .iter()
            .any(|is| is.starts_with("silent: nothing has come from it in 2 s"));
        // On a busy machine too little comes from the other in so short a time to call it stuck.
        let is_stuck = !reported(&json, "blocker", "lies").is_empty();
        last = Some((json, answer));
        is_silent && is_stuck
    });
    let (json, answer) = last.unwrap();
    assert_eq!(
        (&json["ready"], answer.code),
        (&false.into(), BLOCKED),
        "{json:#}"
    );
    assert_eq!(
        json["mend_first"]["about"], "lies",
        "in the order of the configuration"
    );
}

#[test]
fn the_board_is_examined_without_anything_running() {
    let reported = answer(&mut program(
        "jink",
        &["check", "host", "--seconds", "1", "--json"],
    ));
    assert_eq!(reported.code, Some(0), "{reported:?}");
    let json: Value = serde_json::from_str(&reported.stdout).unwrap();
    let late = &json["wake_up_ordinary"];
    assert!(
        late["n"].as_u64().unwrap() > 10 && late["max_ms"].as_f64().unwrap() > 0.0,
        "{json:#}"
    );
    let about: Vec<&str> = json["findings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|finding| finding["about"].as_str().unwrap())
        .collect();
    for line in [
        "wake-up", "rights", "governor", "kernel", "cores", "clock", "throttle", "swap", "heat",
    ] {
        assert!(about.contains(&line), "{line} is not in {about:?}");
    }
    let refused = answer(&mut program("jink", &["check", "host", "--config", "/nowhere"]));
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("/nowhere/services.toml"), "{refused:?}");
}

#[test]
fn the_memory_that_the_topics_take_is_what_was_foretold() {
    let address = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let quiet = ["--set", &address, "--set", "simulation.ground_station_port=0"];
    let arguments: Vec<&str> = ["--world", "empty"].into_iter().chain(quiet).collect();
    let jink = System::up("memory", &arguments);
    until("good health", || jink.status()["health"] == "healthy");
    let reported = jink.jink(&["check", "memory", "--json"]);
    assert_eq!(reported.code, Some(0), "{reported:?}");
    let json: Value = serde_json::from_str(&reported.stdout).unwrap();
    let bytes = |name: &str| json[name].as_f64().unwrap();
    let (needed, used) = (bytes("needed_bytes"), bytes("used_bytes"));
    // Besides samples there are the lists of who reads what.
    assert!((0.95..1.05).contains(&(used / needed)), "{used} of {needed}");
    assert!(used < 100e6, "{used}");
    assert_eq!(reported.code, jink.jink(&["check"]).code);

    // Nor does any process wait for the kernel to make room for descriptors when somebody joins its topics.
    for service in jink.status()["services"].as_array().unwrap() {
        let status = std::fs::read_to_string(format!("/proc/{}/status", service["pid"])).unwrap();
        let room = status
            .lines()
            .find_map(|line| line.strip_prefix("FDSize:"))
            .unwrap();
        assert!(room.trim().parse::<u32>().unwrap() >= 512, "{service}: {room}");
    }
}

#[test]
fn where_nothing_runs_it_says_so_and_a_time_that_is_none_is_wrong_usage() {
    let instance = format!("t_nosensors_{}", std::process::id());
    let check = |further: &[&str]| {
        let arguments = [&["--instance", &instance, "check", "sensors"], further].concat();
        answer(&mut program("jink", &arguments))
    };
    let absent = check(&[]);
    assert_eq!(absent.code, NOT_RUNNING, "{absent:?}");
    assert!(absent.stderr.contains("`jink up` starts it"), "{absent:?}");
    assert_eq!(check(&["--seconds", "0"]).code, WRONG_USAGE);
    assert_eq!(check(&["--seconds", "601"]).code, WRONG_USAGE);
}
